"""The commanded rate and the intercept, against what mechanics says."""

from __future__ import annotations

import math

import pytest

from sattrack.control.acquisition import plan_intercept, slew_time_s
from sattrack.control.feeder import correction_deg_s, rate_deg_s
from sattrack.mount import AxisLimits, MountProfile


def test_the_rate_is_the_mean_over_the_interval() -> None:
    assert rate_deg_s(0.05, 0.05, 0.0, 0.0, 10.0, 6.0) == pytest.approx(1.0)
    assert rate_deg_s(0.05, 0.05, 0.3, 0.0, 10.0, 6.0) == pytest.approx(0.7)


@pytest.mark.parametrize("error", [1e-7, 1e-4, 0.01, 1.0, 40.0])
def test_a_correction_opposes_its_error_and_can_be_braked(error: float) -> None:
    rate = correction_deg_s(error, 10.0, 6.0)
    assert rate < 0.0
    assert correction_deg_s(-error, 10.0, 6.0) == -rate
    assert abs(rate) <= 6.0
    # From that rate the axis, braking with its acceleration, stops before the error is used up.
    assert rate * rate / (2.0 * 10.0) <= error


def test_no_error_no_correction() -> None:
    assert correction_deg_s(0.0, 10.0, 6.0) == 0.0


def test_slew_time_is_that_of_a_ramp_up_a_run_and_a_ramp_down() -> None:
    axis = AxisLimits(slew_rate_deg_s=10.0, max_acceleration_deg_s2=10.0)
    assert slew_time_s(100.0, axis) == pytest.approx(11.5)
    assert slew_time_s(-100.0, axis) == slew_time_s(100.0, axis)
    assert slew_time_s(0.0, axis) == 0.0
    assert slew_time_s(1.0, axis) == pytest.approx(2.0 * math.sqrt(0.15))


def test_the_intercept_is_where_the_target_will_be_and_in_time() -> None:
    def target(utc_s: float) -> tuple[float, float, float]:
        return 10.0 + 0.5 * utc_s, 20.0 - 0.2 * utc_s, 90.0 - 0.5 * utc_s

    met = plan_intercept(0.0, -5.0, (0.0, 60.0), target, MountProfile())
    assert (met.ra_deg, met.dec_deg) == pytest.approx(target(met.utc_s)[:2])
    longest = max(
        slew_time_s(target(met.utc_s)[2], AxisLimits()), slew_time_s(met.dec_deg - 60.0, AxisLimits())
    )
    assert longest < met.utc_s < longest + 2.0


def test_the_way_round_the_lower_meridian_is_the_long_one() -> None:
    """From 10° on one side of it to 10° on the other, a mount whose cables end there turns 340°."""
    met = plan_intercept(0.0, 0.0, (170.0, 40.0), lambda _: (5.0, 40.0, -170.0), MountProfile())
    assert met.utc_s > slew_time_s(340.0, AxisLimits())


def test_a_target_still_to_come_is_waited_for() -> None:
    met = plan_intercept(0.0, 300.0, (1.0, 2.0), lambda _: (1.5, 2.5, 0.5), MountProfile())
    assert met.utc_s == 300.0
