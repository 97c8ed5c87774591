"""The commanded rate and the intercept, against what mechanics says."""

from __future__ import annotations

import math
from types import SimpleNamespace

import pytest

from sattrack.control.approach import plan_intercept, slew_time_s
from sattrack.control.axis_filter import Lag
from sattrack.control.following import LAW, AxisCourse, correction_deg_s, ramped_deg_s, rate_deg_s, settling_s
from sattrack.mount.model import AxisLimits, MountProfile

MOST_DEG_S2 = 10.0


def known(disturbance_deg_s: float = 0.0, gain_error: float = 0.0, lag: Lag | None = None) -> SimpleNamespace:
    """Return an axis as its filter knows it."""
    return SimpleNamespace(
        disturbance_deg_s=disturbance_deg_s,
        gain_error=gain_error,
        lag=lag or Lag(0.0, 0.0),
        lag_sigma_s=0.0,
    )


def test_the_rate_is_the_mean_over_the_interval() -> None:
    way = AxisCourse(7.0, 0.05, 0.05, 0.0, 0.0)
    assert rate_deg_s(way, 7.0, known(), MOST_DEG_S2, 6.0) == pytest.approx(1.0)
    assert rate_deg_s(way, 7.0, known(disturbance_deg_s=0.3), MOST_DEG_S2, 6.0) == pytest.approx(0.7)
    assert rate_deg_s(way, 7.0, known(gain_error=0.25), MOST_DEG_S2, 6.0) == pytest.approx(0.8)


def test_an_error_is_taken_out_with_its_time_constant_and_no_faster_than_it_may() -> None:
    way = AxisCourse(7.0, 0.05, 0.05, 0.0, 0.0)
    assert rate_deg_s(way, 7.01, known(), MOST_DEG_S2, 6.0) == pytest.approx(1.0 - 0.01 / LAW.settling_s)
    assert rate_deg_s(way, 9.0, known(), MOST_DEG_S2, 0.6) == pytest.approx(0.4)


@pytest.mark.parametrize(
    ("axis", "asked"),
    [
        (known(gain_error=-0.5), 1.35),
        (known(disturbance_deg_s=-3.0), 1.35),
        (known(gain_error=0.9), 0.65),
        (known(gain_error=0.2, disturbance_deg_s=0.5), 0.65),
    ],
)
def test_an_axis_that_seems_deaf_is_not_sent_ever_more(axis: SimpleNamespace, asked: float) -> None:
    """A quarter of the rate and 0.1 °/s: what goes beyond that would come out when it hears again."""
    way = AxisCourse(7.0, 0.05, 0.05, 0.0, 0.0)
    assert rate_deg_s(way, 7.0, axis, MOST_DEG_S2, 6.0) == pytest.approx(asked)


@pytest.mark.parametrize(("rate", "most"), [(0.0, 0.1), (0.4, 0.2), (4.0, 1.1), (-4.0, 1.1)])
def test_what_is_made_up_for_is_a_quarter_of_the_rate_and_a_tenth_of_a_degree_a_second(
    rate: float, most: float
) -> None:
    way = AxisCourse(7.0, 0.05 * rate, 0.05, 0.0, 0.0)
    for disturbance, sense in ((-5.0, 1.0), (5.0, -1.0)):
        asked = rate_deg_s(way, 7.0, known(disturbance_deg_s=disturbance), MOST_DEG_S2, 6.0)
        assert asked == pytest.approx(rate + sense * most)


@pytest.mark.parametrize("ahead_s", [0.0, 0.05, 0.1])
def test_a_lag_is_led_however_far_ahead_the_way_is_told(ahead_s: float) -> None:
    """A parabola: the axis, once what was commanded has come out, is where the way is a mean lag later."""
    lag, interval_s, bend = Lag(0.08, 0.0), 0.05, 0.6

    def at(utc_s: float) -> float:
        return 20.0 + 0.9 * utc_s + 0.5 * bend * utc_s * utc_s

    way = AxisCourse(at(ahead_s), at(ahead_s + interval_s) - at(ahead_s), interval_s, bend, ahead_s)
    mean = (at(lag.mean_s + interval_s) - at(lag.mean_s)) / interval_s
    assert rate_deg_s(way, at(lag.mean_s), known(lag=lag), MOST_DEG_S2, 6.0) == pytest.approx(mean, abs=1e-9)


def test_the_corners_that_a_spread_answer_cuts_are_led_round() -> None:
    """Of a parabola an answer of variance σ² leaves the second derivative times σ²/2 on its inner side."""
    way, lag = AxisCourse(20.0, 0.05, 0.05, 0.6, 0.0), Lag(0.0, 0.01)
    assert rate_deg_s(way, 20.0 - 0.5 * 0.01 * 0.6, known(lag=lag), MOST_DEG_S2, 6.0) == pytest.approx(1.0)


def test_the_chord_of_a_rate_that_acts_for_several_turns_lies_on_the_way_in_the_mean() -> None:
    """What lies between chord and parabola, less that of a single turn, is led round."""
    interval_s, turn_s, bend = 0.25, 0.05, 0.6

    def mean_between_deg(seconds: float) -> float:
        steps = [seconds * (k + 0.5) / 1000.0 for k in range(1000)]
        return sum(0.5 * bend * t * (seconds - t) for t in steps) / 1000.0

    way = AxisCourse(20.0, interval_s, interval_s, bend, 0.0)
    beside_deg = mean_between_deg(interval_s) - mean_between_deg(turn_s)
    asked = rate_deg_s(way, 20.0 - beside_deg, known(), MOST_DEG_S2, 6.0)
    assert asked == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("error", [1e-7, 1e-4, 0.01, 1.0, 40.0])
def test_a_correction_opposes_its_error_and_can_be_braked(error: float) -> None:
    rate = correction_deg_s(error, 10.0, 6.0, LAW.settling_s)
    assert rate < 0.0
    assert correction_deg_s(-error, 10.0, 6.0, LAW.settling_s) == -rate
    assert abs(rate) <= 6.0
    # From that rate the axis, braking with its acceleration, stops before the error is used up.
    assert rate * rate / (2.0 * 10.0) <= error


def test_a_large_error_is_closed_along_a_curve_from_which_the_axis_can_brake() -> None:
    """v² = 2·a·s, by 35 % of 10 °/s²; nearer and farther off the time constant and the limit are less."""
    for error, rate in ((0.05, 0.5), (1.0, math.sqrt(7.0)), (-4.0, -math.sqrt(28.0)), (6.0, 6.0)):
        assert correction_deg_s(error, 10.0, 6.0, 0.1) == pytest.approx(-rate)


def test_no_error_no_correction() -> None:
    assert correction_deg_s(0.0, 10.0, 6.0, LAW.settling_s) == 0.0


def test_a_correction_is_as_slow_as_what_is_least_known_or_slowest() -> None:
    assert settling_s(0.05, 0.0, 0.0) == LAW.settling_s == 0.1
    assert settling_s(0.2, 0.0, 0.0) == pytest.approx(0.25)
    assert settling_s(0.2, 0.8, 0.0) == pytest.approx(0.4)
    assert settling_s(0.2, 0.8, 0.2) == pytest.approx(0.25 + 0.8)


def test_a_rate_changes_by_a_share_of_the_acceleration() -> None:
    most = 0.5 * MOST_DEG_S2 * 0.05
    assert ramped_deg_s(3.0, 1.0, MOST_DEG_S2, 0.05) == pytest.approx(1.0 + most)
    assert ramped_deg_s(-3.0, 1.0, MOST_DEG_S2, 0.05) == pytest.approx(1.0 - most)
    assert ramped_deg_s(1.1, 1.0, MOST_DEG_S2, 0.05) == 1.1


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
