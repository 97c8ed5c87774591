"""One offset's algebra: what is asked for is reached exactly, and nothing on the way is a step."""

from __future__ import annotations

import numpy as np
import pytest

from sattrack.control.offset import SHORTEST_S, ChangeLimits, Offset, State

WIDE = ChangeLimits(100.0, 100.0)


def test_an_added_half_second_is_there_in_full_within_two() -> None:
    offset = Offset()
    offset.add(0.5, 10.0, WIDE)
    assert offset.ended_utc_s() == 11.5
    assert offset.state(9.0).value == 0.0
    assert offset.state(12.0) == (0.5, 0.0, 0.0)


def test_a_change_from_rest_is_the_minimum_jerk_curve() -> None:
    """Flash and Hogan 1985: 10 u³ - 15 u⁴ + 6 u⁵ between two rests."""
    offset = Offset(1.0)
    offset.set(3.0, 0.0, WIDE)
    for u in np.linspace(0.0, 1.0, 11):
        expected = 1.0 + 2.0 * (10 * u**3 - 15 * u**4 + 6 * u**5)
        assert offset.state(u * SHORTEST_S).value == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("bounds", [WIDE, ChangeLimits(0.5, 1.0)])
def test_changes_upon_changes_leave_no_step_in_value_or_rate(bounds: ChangeLimits) -> None:
    offset = Offset()
    offset.add(0.5, 0.0, bounds)
    offset.add(-0.2, 0.3, bounds)
    offset.run(0.1, 0.9, bounds)
    offset.stop(6.0, bounds)
    offset.reset(6.5, bounds)
    times = np.arange(-0.5, 12.0, 1e-3)
    values = np.array([offset.state(t).value for t in times])
    rates = np.array([offset.state(t).rate for t in times])
    assert np.allclose(np.gradient(values, times), rates, atol=2e-3)
    assert np.abs(np.diff(rates)).max() < 5e-3
    assert offset.state(20.0).value == 0.0


@pytest.mark.parametrize("amount", [0.01, 0.5, 3.0, -20.0])
def test_the_bounds_are_kept(amount: float) -> None:
    offset = Offset()
    bounds = ChangeLimits(2.0, 4.0)
    offset.add(amount, 0.0, bounds)
    states = [offset.state(t) for t in np.arange(0.0, 60.0, 0.01)]
    assert max(abs(s.rate) for s in states) <= 2.0 * 1.01
    assert max(abs(s.acceleration) for s in states) <= 4.0 * 1.01
    assert offset.state(60.0).value == amount


def test_a_rate_goes_on_through_an_addition_and_ends_with_a_stop() -> None:
    offset = Offset()
    offset.run(0.1, 0.0, WIDE)
    before = offset.total_at(10.0)
    offset.add(1.0, 10.0, WIDE)
    assert offset.rate == 0.1
    assert offset.state(20.0).value == pytest.approx(before + 1.0 + 1.0)
    offset.stop(20.0, WIDE)
    assert offset.rate == 0.0
    assert offset.state(30.0).value == offset.total_at(40.0) == pytest.approx(before + 2.0, abs=0.1)


def test_gradual_takes_its_time_and_no_longer() -> None:
    offset = Offset()
    offset.gradual(2.0, 30.0, 5.0, WIDE)
    assert offset.state(20.0).value == pytest.approx(1.0)
    assert offset.state(34.0).value < 2.0
    assert offset.state(35.0).value == 2.0


def test_gradual_takes_minutes_where_that_is_asked_for() -> None:
    """The longest that bounds may make a change is no bound of what an operator asks for."""
    offset = Offset()
    offset.gradual(2.0, 600.0, 5.0, WIDE)
    assert ended_after_s(offset, 5.0) == 600.0
    assert offset.state(305.0).value == pytest.approx(1.0)


def test_gradual_takes_longer_where_the_bounds_ask_for_it() -> None:
    """At a tenth a second at most: 15/8 of two over that."""
    offset = Offset()
    offset.gradual(2.0, 10.0, 5.0, ChangeLimits(0.1, 100.0))
    assert ended_after_s(offset, 5.0) == pytest.approx(1.875 * 2.0 / 0.1)
    assert offset.state(60.0) == State(2.0, 0.0, 0.0)


def test_what_is_set_while_it_runs_rests_there() -> None:
    offset = Offset()
    offset.run(0.1, 0.0, WIDE)
    offset.set(0.25, 10.0, WIDE)
    assert (offset.rate, offset.total_at(100.0)) == (0.0, 0.25)
    assert offset.state(100.0) == State(0.25, 0.0, 0.0)


def ended_after_s(offset: Offset, begins_utc_s: float) -> float:
    return offset.ended_utc_s() - begins_utc_s


@pytest.mark.parametrize(
    ("way", "bounds", "seconds"),
    [
        (3.0, ChangeLimits(1.0, 100.0), 1.875 * 3.0),
        (-3.0, ChangeLimits(100.0, 0.5), (10.0 / 3.0**0.5 * 3.0 / 0.5) ** 0.5),
        (0.1, ChangeLimits(1.0, 1.0), 1.5),
        (1e4, ChangeLimits(1.0, 1.0), 60.0),
    ],
)
def test_from_rest_to_rest_it_takes_what_the_peaks_of_the_quintic_ask_for(
    way: float, bounds: ChangeLimits, seconds: float
) -> None:
    """Its peaks are 15/8 of the mean rate, and 10/√3 of the way over the square of the time."""
    offset = Offset(2.0)
    offset.add(way, 100.0, bounds)
    assert ended_after_s(offset, 100.0) == pytest.approx(seconds, rel=1e-5)
    if way == -3.0:
        states = [offset.state(100.0 + t) for t in np.arange(0.0, seconds, 0.001)]
        assert max(abs(s.acceleration) for s in states) == pytest.approx(0.5, rel=1e-4)


@pytest.mark.parametrize("rate", [0.0, 0.3])
@pytest.mark.parametrize("curve", [0.0, -0.02])
@pytest.mark.parametrize("moving", [State(0.0, 0.0, 0.0), State(0.7, -0.4, 0.2)])
def test_a_change_joins_what_is_in_force_to_a_parabola(rate: float, curve: float, moving: State) -> None:
    """Value, rate and acceleration are those of both at its ends, and those of each other in between."""
    offset = Offset(1.0)
    offset.take_over(moving, 5.0, 10.0, WIDE, rate=rate, curve=curve)
    now = offset.state(10.0)
    assert now == pytest.approx((1.0 + moving.value, moving.rate, moving.acceleration))
    assert offset.state(9.0) == (1.0, 0.0, 0.0)
    for t in (10.0 + SHORTEST_S, 20.0, 50.0):
        gone = t - 10.0
        line = (5.0 + rate * gone + 0.5 * curve * gone * gone, rate + curve * gone, curve)
        assert offset.state(t) == pytest.approx(line, abs=1e-9)
        assert offset.total_at(t) == pytest.approx(line[0])
    step = 1e-4
    for t in np.arange(10.01, 11.49, 0.1):
        before, here, after = (offset.state(t + off) for off in (-step, 0.0, step))
        assert here.rate == pytest.approx((after.value - before.value) / (2.0 * step), abs=1e-5)
        assert here.acceleration == pytest.approx((after.rate - before.rate) / (2.0 * step), abs=1e-5)
    almost = offset.state(10.0 + SHORTEST_S - 1e-9)
    assert almost == pytest.approx(offset.state(10.0 + SHORTEST_S), abs=1e-6)


def test_what_is_on_the_wanted_parabola_already_goes_on_along_it() -> None:
    """Faster than a change may be, and ever more so; that is no reason to take longer."""
    offset = Offset()
    offset.take_over(State(5.0, 2.0, 0.125), 5.0, 10.0, ChangeLimits(1.0, 0.0625), rate=2.0, curve=0.125)
    assert ended_after_s(offset, 10.0) == SHORTEST_S
    for gone in (0.0, 0.7, 1.5, 4.0):
        line = (5.0 + 2.0 * gone + 0.0625 * gone * gone, 2.0 + 0.125 * gone, 0.125)
        assert offset.state(10.0 + gone) == pytest.approx(line)


def test_a_moving_offset_stops_where_an_even_ramp_ends() -> None:
    """A rate that falls evenly to nothing in 1.5 s takes it 0.75 s times the rate further."""
    offset = Offset()
    offset.run(0.4, 0.0, WIDE)
    assert offset.state(SHORTEST_S) == pytest.approx((0.3, 0.4, 0.0))
    assert offset.state(11.5) == pytest.approx((4.3, 0.4, 0.0))
    offset.stop(11.5, WIDE)
    assert (offset.rate, offset.total_at(30.0)) == (0.0, pytest.approx(4.6))
    other = Offset()
    other.keep(State(2.0, 0.4, 0.0), 5.0, WIDE)
    assert other.state(5.0) == pytest.approx((2.0, 0.4, 0.0))
    assert other.state(6.5) == pytest.approx((2.3, 0.0, 0.0), abs=1e-12)


def test_what_is_given_up_is_nothing_at_once() -> None:
    offset = Offset()
    offset.add(1.0, 0.0, WIDE)
    assert offset.give_up(0.75) == pytest.approx(offset.state(0.75 - 1e-9), abs=1e-6)
    for t in (0.75, 1.0, 3.0):
        assert offset.state(t) == State(0.0, 0.0, 0.0)
        assert offset.total_at(t) == 0.0
    assert (offset.rate, offset.ended_utc_s()) == (0.0, 1.75)


def test_what_it_tells_before_and_after_its_first_change() -> None:
    offset = Offset()
    assert offset.idle is True
    assert Offset(0.1).idle is False
    assert (offset.ended_utc_s(), offset.known_since_utc_s) == (float("-inf"), float("-inf"))
    assert (offset.rate, Offset(3.0).total_at(0.0)) == (0.0, 3.0)
    offset.reset(0.0, WIDE)
    assert offset.idle is False


def test_the_last_128_changes_are_remembered() -> None:
    offset = Offset()
    for number in range(127):
        offset.add(1.0, 10.0 * number, WIDE)
    assert offset.known_since_utc_s == float("-inf")
    offset.add(1.0, 1270.0, WIDE)
    assert offset.known_since_utc_s == 0.0
    assert offset.state(5.0).value == 1.0
    offset.add(1.0, 1280.0, WIDE)
    assert offset.known_since_utc_s == 10.0
    # Before what is remembered it is what it was then.
    assert offset.state(5.0).value == offset.start == 1.0
    assert offset.state(1300.0).value == 129.0


def test_a_change_upon_a_faster_motion_keeps_to_what_that_does_already() -> None:
    offset, bounds = Offset(), ChangeLimits(0.5, 1.0)
    offset.take_over(State(0.0, 3.0, 0.0), 0.0, 0.0, bounds)
    states = [offset.state(t) for t in np.arange(0.0, 60.0, 0.01)]
    assert max(abs(s.rate) for s in states) <= 3.0 + 1e-9
    assert max(abs(s.acceleration) for s in states) <= 1.0 * 1.02
    assert 1.5 < ended_after_s(offset, 0.0) < 60.0
    # Each longer try is a tenth longer than the one before.
    tries = np.log(ended_after_s(offset, 0.0) / SHORTEST_S) / np.log(1.1)
    assert tries == pytest.approx(round(tries), abs=1e-6)
