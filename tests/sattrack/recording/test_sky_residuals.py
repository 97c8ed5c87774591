"""What cameras saw, held against the axes: observations that a run might have had."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from sattrack.cli.recording import engine_of, open_recording
from sattrack.recording import sky_residuals as module
from sattrack.recording.trace import trace
from sattrack.views.messages import ObservationMessage
from tle.instants import Utc
from tle.propagator import Propagator

if TYPE_CHECKING:
    from pathlib import Path


@pytest.mark.parametrize("frame", ["of_date", "icrs"])
def test_places_of_the_satellite_as_predicted_leave_nothing(
    frame: str, short: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Those of date are seen through the air, where the run includes it."""
    recording, facts = open_recording(short, 1)
    run = trace(recording, engine_of)
    fed = run.engine.tracker.steering.biases.course.propagator
    assert fed.refraction is not None
    there = fed if frame == "of_date" else Propagator(fed.elements, fed.site, place="astrometric")

    def seen(_: object) -> list[tuple[float, Any]]:
        times = np.linspace(*run.utc_s[run.following][[5, -5]], 50).tolist()
        rows: list[tuple[float, Any]] = []
        for utc_s in times:
            place = there.at(Utc(utc_s))
            angles = float(place.ra_deg), float(place.dec_deg)
            rows.append((utc_s, ObservationMessage(Utc(utc_s).isoformat(), *angles, frame, 2.0)))
        return rows

    monkeypatch.setattr(module, "messages", seen)
    found = module.sky_residuals(recording, run, facts.profile)
    assert isinstance(found, module.PassResiduals)
    assert float(np.abs(found.left).max()) < 0.01
