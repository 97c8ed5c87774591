"""The margins that `bench/margins.py` prints, against closed forms, roots of the closed loop, and bounds."""

from __future__ import annotations

import math

import margins
import numpy as np
import pytest
from margins import Loop

from sattrack.control.following import settling_s


@pytest.mark.parametrize(("interval_s", "dead_time_s", "lag_s"), [(0.05, 0.0, 0.0), (0.2, 0.35, 0.08)])
def test_a_lag_that_is_known_exactly_leaves_an_integrator(
    interval_s: float, dead_time_s: float, lag_s: float
) -> None:
    """a / (z - 1): -a/2 at half the turns' rate; |L| is 1 where sin(ωT/2) is a/2, at -90° - ωT/2."""
    step = interval_s / settling_s(interval_s, lag_s, 0.0)
    gain_db, phase_deg = margins.margins(Loop(interval_s, dead_time_s, lag_s, 0.0, 0.0))
    assert gain_db == pytest.approx(20.0 * math.log10(2.0 / step), abs=0.02)
    assert phase_deg == pytest.approx(90.0 - math.degrees(math.asin(0.5 * step)), abs=0.3)


@pytest.mark.parametrize(
    "loop",
    [
        Loop(0.05, 0.1, 0.03, 0.05, 0.1),
        Loop(0.15, 0.2, 0.03, 0.05, -0.1),
        Loop(0.15, 0.35, 0.0, 0.05, 0.1),
        Loop(0.35, 0.05, 0.16, 0.1, 0.2),
    ],
)
def test_the_closed_loop_rings_for_ever_where_its_gain_has_grown_by_the_margin(loop: Loop) -> None:
    sent = -margins.answers(loop)
    rest = sent[-1]
    # 1 + g L = 0, with L the transform of what was sent, times 1 - 1/z for its integrator.
    opened = np.convolve([0.0, *(sent - rest)], [1.0, -1.0])
    opened[1] += rest
    closed = np.zeros(opened.size)
    closed[:2] = 1.0, -1.0
    grown = 10.0 ** (margins.margins(loop).gain_db / 20.0)
    largest = [np.abs(np.roots(closed + share * grown * opened)).max() for share in (0.97, 1.03)]
    assert largest[0] < 1.0 < largest[1]


@pytest.mark.parametrize(
    ("error", "least_db", "least_deg"), [(0.0, 8.5, 65.0), (1.0, 7.5, 60.0), (2.0, 6.0, 55.0)]
)
def test_the_margins_are_what_the_document_says(error: float, least_db: float, least_deg: float) -> None:
    for interval_s in (0.05, 0.15, 0.35):
        gain_db, phase_deg = margins.worst(interval_s, (0.0, 0.1, 0.35), error)
        assert gain_db >= least_db
        assert phase_deg >= least_deg
