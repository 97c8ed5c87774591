"""A feed with one view, a clock moved by hand, and screens that look and draw when a test has them do it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest
from textual._compositor import Compositor
from textual._context import visible_screen_stack
from tui_builders import VIEW, FakeFeed, HandClock

from sattrack.tui.feeds import News
from sattrack.tui.look import ScreenApp

if TYPE_CHECKING:
    from rich.console import RenderableType
    from textual.geometry import Size
    from textual.strip import Strip


@pytest.fixture(autouse=True)
def untimed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let no timer have a screen look or draw: how often it did would depend on how busy the machine is."""
    monkeypatch.setattr(ScreenApp, "every", lambda *_: None)


@pytest.fixture(autouse=True)
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let nothing be drawn for a terminal that is not there: what a test reads is drawn when it reads it.

    It is drawn twice then: a plot fills its canvas while it is drawn itself. Pictures are drawn as ever.
    """
    draw, strips = Compositor.render_update, Compositor.render_strips

    def update(self: Compositor, full: bool = False, **given: Any) -> RenderableType | None:
        if full:
            return draw(self, full, **given)
        self._dirty_regions.clear()
        return None

    def read(self: Compositor, size: Size | None = None) -> list[Strip]:
        for _ in range(2):
            if self.root is not None:
                # What lies under a dialog is drawn with it.
                visible_screen_stack.set(self.root.app._background_screens)
            drawn = strips(self, size)
        return drawn

    monkeypatch.setattr(Compositor, "render_update", update)
    monkeypatch.setattr(Compositor, "render_strips", read)


@pytest.fixture
def feed() -> FakeFeed:
    return FakeFeed([News((VIEW,))])


@pytest.fixture
def hand_clock() -> HandClock:
    return HandClock()
