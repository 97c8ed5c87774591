"""The options of the terminal's screen, whether there can be one, and how it is started."""

from __future__ import annotations

import importlib.util
import os
import sys
from typing import TYPE_CHECKING, Any, NoReturn

import click

from sattrack.cli.output import CANNOT_DRAW
from sattrack.core.errors import BadInputError, how_to_install
from sattrack.core.process import self_command

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from sattrack.cli.common import CommandContext
    from sattrack.tui.feeds import HelperOptions
    from sattrack.tui.scene import Appearance

NO_PASSES = "no passes: give --elements FILE and --site, or run `sattrack init`"


def screen_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options of the terminal's screen, of which `appearance` makes what the screen takes."""
    function = click.option("--scene", is_flag=True, hidden=True)(function)
    function = click.option(
        "--ascii",
        "plain",
        is_flag=True,
        help="Draw the screen in ASCII only; automatic if the terminal has nothing else.",
    )(function)
    return click.option(
        "--theme",
        type=click.Choice(("night", "red", "contrast")),
        help="Colours of the screen: night, red (for eyes used to the dark) or contrast; key t changes them.",
    )(function)


def appearance(context: CommandContext, theme: str | None, plain: bool) -> Appearance:
    """Return how to draw the screen: by the options, else the settings, else as the terminal can."""
    from sattrack.tui.scene import Appearance, can_show

    screen = context.settings.screen
    return Appearance(theme or screen.theme, plain or screen.ascii or not can_show(sys.stdout.encoding))


def tui_possible() -> bool:
    """Tell whether there is a terminal that can be drawn on, and what it takes to draw."""
    if os.environ.get("TERM") in CANNOT_DRAW:
        return False
    return sys.stdin.isatty() and sys.stdout.isatty() and importlib.util.find_spec("textual_plot") is not None


def needed_terminal() -> str:
    """Return what a screen needs, as text: why the present terminal is not enough, if there is one."""
    term = os.environ.get("TERM")
    return f"a terminal that can draw (TERM={term} cannot)" if term in CANNOT_DRAW else "a terminal"


def refuse_screen(what: str, instead: str = "") -> NoReturn:
    """Raise BadInputError: what needs a screen has no terminal, or no textual; `instead` ends the message."""
    if importlib.util.find_spec("textual_plot") is None:
        raise BadInputError(f"{what} needs textual: {how_to_install('tui')}")
    raise BadInputError(f"{what} needs {needed_terminal()}{instead}")


def with_tui(appearance: Appearance, stay: bool = True, helpers: HelperOptions | None = None) -> int:
    """Run this very command line headless in a process of its own, and the terminal UI here on top of it.

    With `stay`, the screen of an ended run remains until it is left. `helpers`: what the screen starts.
    The loop that feeds the mount must not share a process with anything that draws.
    """
    from sattrack.tui.launch import fly_with_tui

    arguments = [*sys.argv[1:], "--stream", "--control", "--scene"]
    return fly_with_tui([*self_command(), *arguments], appearance, stay, helpers=helpers)


def helper_options(
    context: CommandContext,
    profile: Path | None,
    min_alt_deg: float | None,
    practising: bool,
    mount_url: str | None = None,
) -> HelperOptions:
    """Return how a screen calls `passes` and `mount watch`; `practising`: with the built-in satellite."""
    from sattrack.tui.feeds import HelperOptions

    there = None if mount_url == "sim" else mount_url
    shared = _option_words("--config", context.settings_file) + _option_words("--profile", profile)
    if context.utc:
        shared += ("--utc",)
    site = context.site_option
    if site is None and not context.has_site():
        from sattrack.runtime import demo_pass

        where = demo_pass.SITE
        site = f"{where.latitude_deg},{where.longitude_deg},{where.height_m}"
    watch = shared + _option_words("--site", site)
    least = _option_words("--min-alt", min_alt_deg)
    sources = context.sources()
    if practising:
        from sattrack.runtime import demo_pass

        lines = f"{demo_pass.NAME}\n{demo_pass.LINE_1}\n{demo_pass.LINE_2}\n"
        return HelperOptions((*watch, *least, "--elements", "-"), watch, lines.encode(), mount_url=there)
    if not sources or "-" in sources or not context.has_site():
        return HelperOptions(None, watch, why=NO_PASSES, mount_url=there)
    named = tuple(word for source in context.element_sources for word in ("--elements", source))
    return HelperOptions((*watch, *least, *named), watch, mount_url=there)


def _option_words(name: str, value: object | None) -> tuple[str, ...]:
    return () if value is None else (name, str(value))
