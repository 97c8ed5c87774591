"""A feed with one view, a clock moved by hand, and screens that look only when a test has them look."""

from __future__ import annotations

import pytest
from tui_builders import VIEW, FakeFeed, HandClock

from sattrack.tui.feeds import News
from sattrack.tui.look import ScreenApp


@pytest.fixture(autouse=True)
def untimed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let no timer have a screen look or draw: how often it did would depend on how busy the machine is."""
    monkeypatch.setattr(ScreenApp, "every", lambda *_: None)


@pytest.fixture
def feed() -> FakeFeed:
    return FakeFeed([News((VIEW,))])


@pytest.fixture
def hand_clock() -> HandClock:
    return HandClock()
