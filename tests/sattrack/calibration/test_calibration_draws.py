"""Calibration against simulated mounts drawn at random: a few by default, the others as a soak."""

from __future__ import annotations

from typing import TYPE_CHECKING

import calibration
import pytest
from calibration import Outcome

if TYPE_CHECKING:
    from collections.abc import Iterable

GAIN = 1e-3
ROUND_TRIP_S = 0.003
EXCESS_S = 0.006


def check(outcome: Outcome) -> None:
    assert outcome.semantics_right
    assert max(map(abs, outcome.gains)) < GAIN
    assert abs(outcome.round_trip_s) < ROUND_TRIP_S
    assert outcome.intervals_hold
    assert outcome.widest_excess_s < EXCESS_S


FEW = (1,)
"""Runs with mounts in closed form are of every kind by default (`test_calibration_runs.py`)."""
STRANGERS = (0, 4, 11)
"""One of each kind."""


def few(numbers: Iterable[int], chosen: tuple[int, ...]) -> list[object]:
    return [one if one in chosen else pytest.param(one, marks=pytest.mark.soak) for one in numbers]


@pytest.mark.parametrize("number", few(range(8), FEW))
def test_a_drawn_simulated_mount_is_found_out(number: int) -> None:
    drawn = calibration.draw(number, seed=2)
    check(calibration.judge(drawn, *calibration.run_drawn(drawn), motions=False))


@pytest.mark.soak
@pytest.mark.parametrize("number", range(200))
def test_two_hundred_drawn_simulated_mounts_are_found_out(number: int) -> None:
    drawn = calibration.draw(number, seed=1)
    check(calibration.judge(drawn, *calibration.run_drawn(drawn), motions=False))


@pytest.mark.parametrize("number", few((0, 1, 3, 4, 11, 17), STRANGERS))
def test_the_motion_of_a_mount_written_from_the_paper_is_found_out(number: int) -> None:
    pytest.importorskip("strangers.velocity_servo")
    result = calibration.judge_stranger(number, seed=1)
    assert not isinstance(result, str)
    axes, fields_right = result
    assert fields_right
    for axis in axes:
        assert axis.value is not None
        assert axis.sigma is not None
        assert axis.lag_s is not None
        assert axis.lag_sigma_s is not None
        assert abs(axis.value - axis.true_deg_s2) < 2.0 * axis.sigma
        assert not axis.stops_too_short
        assert axis.sigma <= 0.1 * axis.value
        assert abs(axis.lag_s - axis.true.lag_s) < 2.0 * axis.lag_sigma_s
