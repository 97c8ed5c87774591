"""One offset's algebra: what is asked for is reached exactly, and nothing on the way is a step."""

from __future__ import annotations

import numpy as np
import pytest

from sattrack.control.offset import SHORTEST_S, ChangeLimits, Offset

WIDE = ChangeLimits(100.0, 100.0)


def test_an_added_half_second_is_there_in_full_within_two() -> None:
    offset = Offset()
    offset.add(0.5, 10.0, WIDE)
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
