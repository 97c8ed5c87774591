"""Passes of schedules in virtual time are flown from shortly before each on."""

from __future__ import annotations

from functools import partial

import pytest
from late_start import APPROACH_S

from sattrack.control.tracker import TrackPlan
from sattrack.schedule import virtual_executor


@pytest.fixture(autouse=True)
def late_flights(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the slew to a pass begin less than a minute before it: the mount would only wait there."""
    monkeypatch.setattr(virtual_executor, "TrackPlan", partial(TrackPlan, approach_s=APPROACH_S))
