"""A feed with one view, a clock moved by hand, and screens that look and draw when a test has them do it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest
from textual._compositor import Compositor
from textual._context import visible_screen_stack
from textual.css.stylesheet import Stylesheet
from textual_plot import PlotWidget
from tui_builders import VIEW, FakeFeed, HandClock

from sattrack.tui.feeds import News
from sattrack.tui.look import ScreenApp

if TYPE_CHECKING:
    from rich.console import RenderableType
    from textual.css.model import RuleSet
    from textual.geometry import Size
    from textual.strip import Strip


@pytest.fixture(autouse=True)
def untimed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let no timer have a screen look or draw: how often it did would depend on how busy the machine is."""
    monkeypatch.setattr(ScreenApp, "every", lambda *_: None)


@pytest.fixture(autouse=True)
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let nothing be drawn for a terminal that is not there: what a test reads is drawn when it reads it.

    Plots are filled before: one fills its canvas while it is drawn itself, and that may be too late. Pictures
    are drawn as ever.
    """
    draw, strips = Compositor.render_update, Compositor.render_strips

    def update(self: Compositor, full: bool = False, **given: Any) -> RenderableType | None:
        if full:
            return draw(self, full, **given)
        self._dirty_regions.clear()
        return None

    def read(self: Compositor, size: Size | None = None) -> list[Strip]:
        if self.root is not None:
            # What lies under a dialog is drawn with it.
            beneath = self.root.app._background_screens
            visible_screen_stack.set(beneath)
            for compositor in (self, *(screen._compositor for screen in beneath)):
                for widget in compositor.visible_widgets:
                    if isinstance(widget, PlotWidget):
                        widget.render()
        return strips(self, size)

    monkeypatch.setattr(Compositor, "render_update", update)
    monkeypatch.setattr(Compositor, "render_strips", read)


@pytest.fixture(scope="session")
def parsed() -> dict[Any, list[RuleSet]]:
    """Keep the rules of styles by what they were parsed from."""
    return {}


@pytest.fixture(autouse=True)
def parsed_once(monkeypatch: pytest.MonkeyPatch, parsed: dict[Any, list[RuleSet]]) -> None:
    """Let the styles of screens be parsed once for each theme, and not once for each screen."""
    parse = Stylesheet._parse_rules

    def parse_once(self: Stylesheet, *given: Any, **named: Any) -> list[RuleSet]:
        key = (frozenset(self._variables.items()), given, frozenset(named.items()))
        if key not in parsed:
            parsed[key] = parse(self, *given, **named)
        return parsed[key]

    monkeypatch.setattr(Stylesheet, "_parse_rules", parse_once)


@pytest.fixture
def feed() -> FakeFeed:
    return FakeFeed([News((VIEW,))])


@pytest.fixture
def hand_clock() -> HandClock:
    return HandClock()
