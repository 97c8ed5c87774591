"""Whether there is to be a screen, and how it is started: light, so that the screen is there soon."""

from __future__ import annotations

import importlib.util
import sys
from typing import TYPE_CHECKING

from sattrack.own_program import own_program

if TYPE_CHECKING:
    from sattrack.tui.appearance import Appearance
    from sattrack.tui.beside import Beside


def tui_possible() -> bool:
    """Tell whether there is a terminal to draw on, and what it takes to draw."""
    return sys.stdin.isatty() and sys.stdout.isatty() and importlib.util.find_spec("textual_plot") is not None


def with_tui(appearance: Appearance, stay: bool = True, beside: Beside | None = None) -> int:
    """Run this very command line headless in a process of its own, and the terminal UI here on top of it.

    With `stay`, the screen of an ended run remains until it is left. `beside`: what the screen starts itself.
    The loop that feeds the mount must not share a process with anything that draws.
    """
    from sattrack.tui.launch import fly_with_tui

    arguments = [*sys.argv[1:], "--stream", "--control", "--scene"]
    return fly_with_tui([*own_program(), *arguments], appearance, stay, beside=beside)
