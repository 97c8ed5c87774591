"""Calibration against simulated mounts drawn at random: a few by default, two hundred as a soak."""

from __future__ import annotations

import calibration
import pytest
from calibration import Outcome

GAIN = 1e-3
ROUND_TRIP_S = 0.003
EXCESS_S = 0.006


def check(outcome: Outcome) -> None:
    assert outcome.semantics_right
    assert max(map(abs, outcome.gains)) < GAIN
    assert abs(outcome.round_trip_s) < ROUND_TRIP_S
    assert outcome.intervals_hold
    assert outcome.widest_excess_s < EXCESS_S


@pytest.mark.parametrize("number", range(8))
def test_a_drawn_simulated_mount_is_found_out(number: int) -> None:
    drawn = calibration.draw(number, seed=2)
    check(calibration.judge(drawn, *calibration.run_drawn(drawn)))


@pytest.mark.soak
@pytest.mark.parametrize("number", range(200))
def test_two_hundred_drawn_simulated_mounts_are_found_out(number: int) -> None:
    drawn = calibration.draw(number, seed=1)
    check(calibration.judge(drawn, *calibration.run_drawn(drawn)))
