"""Whether there is a screen, how it is started, lightly, and what it starts beside itself."""

from __future__ import annotations

import importlib.util
import os
import sys
from typing import TYPE_CHECKING

from sattrack.core.own_program import own_program

if TYPE_CHECKING:
    from pathlib import Path

    from sattrack.cli.common import CommandContext
    from sattrack.tui.appearance import Appearance
    from sattrack.tui.beside import Beside

CANNOT_DRAW = {"dumb", "unknown"}
"""Terminals, by the name in TERM, that have no cursor to place: they get lines."""
NO_ELEMENTS = "no passes: give --elements FILE and --site, or set them in sattrack.toml"


def tui_possible() -> bool:
    """Tell whether there is a terminal that can be drawn on, and what it takes to draw."""
    if os.environ.get("TERM") in CANNOT_DRAW:
        return False
    return sys.stdin.isatty() and sys.stdout.isatty() and importlib.util.find_spec("textual_plot") is not None


def needed_terminal() -> str:
    """Return what a screen needs, in words: where there is a terminal, why it is not enough."""
    term = os.environ.get("TERM")
    return f"a terminal that can draw (TERM={term} cannot)" if term in CANNOT_DRAW else "a terminal"


def can_draw_lines_anew() -> bool:
    """Tell whether what goes to standard error can be written over, as on a terminal that draws."""
    return sys.stderr.isatty() and os.environ.get("TERM") not in CANNOT_DRAW


def with_tui(appearance: Appearance, stay: bool = True, beside: Beside | None = None) -> int:
    """Run this very command line headless in a process of its own, and the terminal UI here on top of it.

    With `stay`, the screen of an ended run remains until it is left. `beside`: what the screen starts itself.
    The loop that feeds the mount must not share a process with anything that draws.
    """
    from sattrack.tui.launch import fly_with_tui

    arguments = [*sys.argv[1:], "--stream", "--control", "--scene"]
    return fly_with_tui([*own_program(), *arguments], appearance, stay, beside=beside)


def beside(
    context: CommandContext,
    profile: Path | None,
    min_alt_deg: float | None,
    practising: bool,
    mount_url: str | None = None,
) -> Beside:
    """Return how a screen calls `passes` and `mount watch`; `practising`: with the built-in satellite."""
    from sattrack.tui.beside import Beside

    there = None if mount_url == "sim" else mount_url
    shared = _option("--config", given("--config")) + _option("--profile", profile)
    site = context.site_option
    if site is None and not context.has_site():
        from sattrack.runtime import demo_pass

        where = demo_pass.SITE
        site = f"{where.latitude_deg},{where.longitude_deg},{where.height_m}"
    watch = shared + _option("--site", site)
    least = _option("--min-alt", min_alt_deg)
    sources = context.sources()
    if practising:
        from sattrack.runtime import demo_pass

        lines = f"{demo_pass.NAME}\n{demo_pass.LINE_1}\n{demo_pass.LINE_2}\n"
        return Beside((*watch, *least, "--elements", "-"), watch, lines.encode(), mount_url=there)
    if not sources or "-" in sources or not context.has_site():
        return Beside(None, watch, why=NO_ELEMENTS, mount_url=there)
    named = tuple(word for source in context.element_sources for word in ("--elements", source))
    return Beside((*watch, *least, *named), watch, mount_url=there)


def _option(name: str, value: object | None) -> tuple[str, ...]:
    return () if value is None else (name, str(value))


def given(name: str) -> str | None:
    """Return what this command line says of an option that the context does not keep."""
    for word, following in zip(sys.argv, [*sys.argv[1:], ""], strict=True):
        if word == name:
            return following
        if word.startswith(f"{name}="):
            return word.partition("=")[2]
    return None
