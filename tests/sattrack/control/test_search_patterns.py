"""Search patterns against geometry: arms, speeds, and no step at the start."""

from __future__ import annotations

import math

import numpy as np
import pytest

from sattrack.control.offset import START_S, spiral, spiral_acceleration_deg_s2, sweep_s


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
