"""Whether there is to be a screen, and how it is started: light, so that the screen is there soon."""

from __future__ import annotations

import importlib.util
import os
import sys
from typing import TYPE_CHECKING

from sattrack.core.own_program import own_program

if TYPE_CHECKING:
    from sattrack.tui.appearance import Appearance
    from sattrack.tui.beside import Beside

CANNOT_DRAW = {"dumb", "unknown"}
"""Terminals, by the name in TERM, that have no cursor to place: they get lines."""


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
