"""The mount's clock against ours, with clocks and delays made here."""

from __future__ import annotations

import random

import numpy as np
import pytest

from sattrack.control.latency import SIDEREAL_SECONDS_PER_SECOND, Envelope, MountClock, lower_envelope


def sidereal_h(mount_s: float, start_h: float = 3.0) -> float:
    return (start_h + mount_s * SIDEREAL_SECONDS_PER_SECOND / 3600.0) % 24.0


def line_under_by_linear_programme(points: list[tuple[float, float]]) -> tuple[float, float]:
    """Offset at 0 and slope of the line under all points with the least mean distance to them."""
    from scipy.optimize import linprog

    t, y = np.array(points).T
    solved = linprog(
        [-len(t), -t.sum()], A_ub=np.column_stack([np.ones_like(t), t]), b_ub=y, bounds=[(None, None)] * 2
    )
    return float(solved.x[0]), float(solved.x[1])


@pytest.mark.parametrize("seed", range(20))
def test_the_envelope_is_the_best_line_under_all_points(seed: int) -> None:
    rng = random.Random(seed)
    points = [(float(t), 0.5 + 3e-5 * t + rng.expovariate(400.0)) for t in range(60)]
    envelope = lower_envelope(points)
    at_zero, slope = line_under_by_linear_programme(points)
    assert envelope.drift == pytest.approx(slope, abs=1e-9)
    assert envelope.offset_at(0.0) == pytest.approx(at_zero, abs=1e-7)


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("count", [1, 2, 5, 30])
def test_a_usual_slope_is_likelier_than_another(seed: int, count: int) -> None:
    """Held against all slopes of a fine grid: exponential lateness, a slope that is normal about zero."""
    rng = random.Random(seed)
    points = [(float(t), 0.5 + 5e-5 * t + rng.expovariate(4000.0)) for t in range(count)]
    lateness_s, usual = 1.0 / 4000.0, 3e-5
    slopes = np.arange(-200e-6, 200e-6, 1e-8)
    t, y = np.array(points).T
    offsets = (y - slopes[:, None] * t).min(axis=1)
    late_s = (y - offsets[:, None] - slopes[:, None] * t).sum(axis=1)
    best = int((late_s / lateness_s + 0.5 * (slopes / usual) ** 2).argmin())
    envelope = lower_envelope(points, stiffness_s=lateness_s / usual**2)
    assert envelope.drift == pytest.approx(slopes[best], abs=2e-8)
    assert envelope.offset_at(0.0) == pytest.approx(offsets[best], abs=1e-6)


def test_one_point_gives_no_drift() -> None:
    assert lower_envelope([(5.0, 0.1)]) == Envelope(5.0, 0.1)


@pytest.mark.parametrize("drift", [100e-6, -150e-6])
def test_a_clock_that_drifts_dates_within_half_a_millisecond_from_the_first_seconds(drift: float) -> None:
    rng = random.Random(6)
    clock, worst = MountClock(status_delay_s=0.002), 0.0
    for i in range(1200):
        sampled = 1_000_000.0 + i * 0.05
        arrival = sampled + 0.002 + rng.uniform(0.0, 0.002)
        dated = clock.date(sidereal_h((sampled - 1_000_000.0) * (1.0 - drift)), arrival)
        worst = max(worst, abs(dated - sampled)) if i > 60 else 0.0
    assert worst < 5e-4


def test_a_slope_no_clock_has_is_bounded() -> None:
    assert lower_envelope([(float(t), 0.01 * t) for t in range(30)]).drift == pytest.approx(200e-6)


@pytest.mark.parametrize(("drift", "offset_s"), [(0.0, 0.0), (40e-6, 2.7), (-60e-6, -31.0)])
def test_samples_are_dated_through_delays_and_drift(drift: float, offset_s: float) -> None:
    rng = random.Random(4)
    clock = MountClock(status_delay_s=0.002)
    worst = 0.0
    for i in range(2400):
        sampled = 1_000_000.0 + i * 0.05
        arrival = sampled + 0.002 + rng.expovariate(1000.0)
        dated = clock.date(sidereal_h((sampled - 1_000_000.0) * (1.0 - drift) + offset_s), arrival)
        if i > 1000:
            worst = max(worst, abs(dated - sampled))
    assert worst < 2e-4
    assert clock.drift == pytest.approx(drift, abs=8e-6)


def test_dates_run_on_through_sidereal_midnight() -> None:
    clock = MountClock(status_delay_s=0.0)
    dated = [clock.date(sidereal_h(i * 0.05, start_h=23.9999), 50.0 + i * 0.05) for i in range(40)]
    assert np.diff(dated) == pytest.approx([0.05] * 39, abs=1e-8)


def test_a_clock_that_stands_still_is_not_believed() -> None:
    clock = MountClock(status_delay_s=0.01)
    dated = [clock.date(7.0, 100.0 + i * 0.05) for i in range(60)]
    assert not clock.trusted
    assert dated[-1] == pytest.approx(100.0 + 59 * 0.05 - 0.01)


@pytest.mark.parametrize("period_s", [0.05, 0.0625])
def test_bursts_are_dated_by_count_where_the_clock_is_not_believed(period_s: float) -> None:
    """Four at a time, the first of them three turns late; the clock stands still."""
    clock = MountClock(status_delay_s=0.01)
    worst = 0.0
    for i in range(200):
        sampled = 100.0 + i * period_s
        arrival = 100.0 + (i // 4 * 4 + 3) * period_s + 0.01
        dated = clock.date(7.0, arrival, counter=i)
        if i > 80:
            worst = max(worst, abs(dated - sampled))
    assert not clock.trusted
    assert worst < 0.3 * period_s


def test_unevenness_of_a_coarse_timer_is_no_burst() -> None:
    rng = random.Random(8)
    clock = MountClock(status_delay_s=0.01)
    for i in range(200):
        arrival = 100.0 + np.ceil(i * 0.05 * 64.0) / 64.0 + rng.uniform(0.0, 0.001) + 0.01
        dated = clock.date(7.0, arrival, counter=i)
    assert dated == pytest.approx(arrival - 0.01, abs=1e-9)
