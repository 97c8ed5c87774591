"""A feed with one view, and a clock moved by hand."""

from __future__ import annotations

import pytest
from tui_builders import VIEW, FakeFeed, HandClock

from sattrack.tui.seen_run import News


@pytest.fixture
def feed() -> FakeFeed:
    return FakeFeed([News((VIEW,))])


@pytest.fixture
def hand_clock() -> HandClock:
    return HandClock()
