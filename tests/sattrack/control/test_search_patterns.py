"""Search patterns against geometry: arms, speeds, and no step at the start."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from sattrack.control.offset import (
    START_S,
    Pattern,
    State,
    eased_rate,
    eased_s,
    spiral,
    spiral_acceleration_deg_s2,
    spiral_lasts_s,
    sweep_rate,
    sweep_s,
)


@pytest.mark.parametrize(("spacing", "speed"), [(0.1, 0.05), (0.5, 0.2)])
def test_a_spiral_runs_at_its_speed_and_its_arms_lie_apart_by_its_spacing(
    spacing: float, speed: float
) -> None:
    times = np.arange(0.0, 120.0, 0.01)
    points = np.array([spiral(t, spacing, speed)[:2] for t in times])
    speeds = np.hypot(*np.gradient(points, times, axis=0).T)
    assert speeds[times > START_S + 0.1] == pytest.approx(speed, rel=2e-3)
    radius, angle = np.hypot(*points.T), np.unwrap(np.arctan2(points[:, 1], points[:, 0]))
    outer = radius > 0.1 * spacing
    turns = (angle[outer] - angle[outer][0]) / (2.0 * math.pi)
    assert radius[outer] - radius[outer][0] == pytest.approx(turns * spacing, abs=1e-9)


def test_a_spiral_begins_at_rest_and_keeps_to_its_acceleration() -> None:
    times = np.arange(-1.0, 60.0, 0.01)
    points = np.array([spiral(t, 0.1, 0.05)[:2] for t in times])
    velocity = np.gradient(points, times, axis=0)
    acceleration = np.hypot(*np.gradient(velocity, times, axis=0).T)
    assert tuple(points[0]) == (0.0, 0.0)
    assert np.hypot(*velocity[times < 0.0].T).max() < 1e-4
    assert acceleration.max() <= spiral_acceleration_deg_s2(0.1, 0.05) * 1.01


def test_a_sweep_reaches_both_ways_and_begins_at_rest() -> None:
    times = np.arange(0.0, 60.0, 0.01)
    along = np.array([sweep_s(t, 2.0, 20.0) for t in times])
    assert along.max() == pytest.approx(2.0, abs=1e-4)
    assert along.min() == pytest.approx(-2.0, abs=1e-4)
    rates = np.gradient(along, times)
    assert abs(rates[0]) < 1e-3
    assert np.abs(np.diff(rates)).max() / 0.01 < 2.0 * (2.0 * math.pi / 20.0) * 1.5 / START_S + 0.3
    assert sweep_s(START_S / 2.0 + 5.0, 2.0, 20.0) == pytest.approx(2.0)


def test_a_pattern_comes_up_to_its_speed_in_two_seconds() -> None:
    """The speed follows 3u² - 2u³, whose integral is u³ - u⁴/2."""
    assert [eased_rate(t) for t in (-1.0, 0.0, 0.5, 1.0, 2.0, 9.0)] == [0.0, 0.0, 0.15625, 0.5, 1.0, 1.0]
    assert [eased_s(t) for t in (-1.0, 0.0, 1.0, 2.0, 9.0)] == [0.0, 0.0, 0.1875, 1.0, 8.0]


@pytest.mark.parametrize(("spacing", "speed"), [(0.1, 0.05), (0.5, 0.2)])
def test_rates_are_those_of_the_points(spacing: float, speed: float) -> None:
    step = 1e-5
    for t in (0.3, 1.0, 3.0, 20.0, 100.0):
        before, here, after = (np.array(spiral(t + off, spacing, speed)) for off in (-step, 0.0, step))
        assert here[2:] == pytest.approx((after[:2] - before[:2]) / (2.0 * step), abs=1e-7)
        swept = (sweep_s(t + step, 2.0, 20.0) - sweep_s(t - step, 2.0, 20.0)) / (2.0 * step)
        assert sweep_rate(t, 2.0, 20.0) == pytest.approx(swept, abs=1e-8)


def test_a_spiral_lasts_until_it_is_as_far_out() -> None:
    for reach in (0.05, 0.3, 2.0):
        lasts_s = spiral_lasts_s(reach, 0.1, 0.05)
        point = spiral(lasts_s, 0.1, 0.05)
        assert math.hypot(point.along_deg, point.cross_deg) == pytest.approx(reach, rel=1e-6)


def test_a_spirals_acceleration_is_that_of_its_centre_while_it_comes_up_to_speed() -> None:
    """r = bθ bends with 2/b in its centre, b = spacing/2π; 3u² - 2u³ is steepest at 1.5 over two seconds."""
    assert spiral_acceleration_deg_s2(0.1, 0.05) == pytest.approx(
        math.hypot(0.05**2 * 2.0 * 2.0 * math.pi / 0.1, 0.05 * 1.5 / 2.0)
    )


PACE = SimpleNamespace(pace_deg_s=0.5, pace_rate=0.01)


def test_a_pattern_is_seconds_along_and_degrees_across() -> None:
    asked: list[float] = []

    def going(utc_s: float) -> SimpleNamespace:
        asked.append(utc_s)
        return PACE

    course: Any = SimpleNamespace(going=going)
    along = State(0.25, 0.02, 0.0)
    pattern = Pattern("spiral", 0.1, 0.05, 100.0, 200.0)
    ahead, left = pattern.states(112.0, along, course)
    assert asked == [112.25]
    point = spiral(12.0, 0.1, 0.05)
    # Seconds are degrees over the pace; the pace grows by 0.01°/s each second of the satellite's own time.
    assert ahead.value == pytest.approx(point.along_deg / 0.5)
    assert ahead.rate == pytest.approx(
        point.along_deg_s / 0.5 - point.along_deg * 0.01 * 1.02 / 0.5**2, rel=1e-9
    )
    assert (left.value, left.rate) == (point.cross_deg, point.cross_deg_s)
    assert (ahead.acceleration, left.acceleration) == (0.0, 0.0)
    still: Any = SimpleNamespace(going=lambda _: SimpleNamespace(pace_deg_s=0.5, pace_rate=0.0))
    ahead, left = pattern.full_states(112.0, State(0.0, 0.0, 0.0), still)
    step = 0.01
    sooner, later = spiral(12.0 - step, 0.1, 0.05), spiral(12.0 + step, 0.1, 0.05)
    assert ahead.value == pytest.approx(point.along_deg / 0.5)
    bend = (later.along_deg_s - sooner.along_deg_s) / (2.0 * step)
    assert ahead.acceleration == pytest.approx(bend / 0.5, rel=1e-4)
    bend = (later.cross_deg_s - sooner.cross_deg_s) / (2.0 * step)
    assert left.acceleration == pytest.approx(bend, rel=1e-4)


def test_a_sweep_is_seconds_along_alone_between_its_instants() -> None:
    pattern = Pattern("sweep", 2.0, 20.0, 100.0, 200.0)
    course: Any = None
    ahead, left = pattern.states(107.0, State(5.0, 1.0, 0.0), course)
    assert ahead == State(sweep_s(7.0, 2.0, 20.0), sweep_rate(7.0, 2.0, 20.0), 0.0)
    assert left == State(0.0, 0.0, 0.0)
    assert [pattern.runs(t) for t in (99.9, 100.0, 199.9, 200.0)] == [False, True, True, False]
    ended = pattern.ended(150.0)
    assert (ended.runs(149.9), ended.runs(150.0), ended.first) == (True, False, 2.0)
