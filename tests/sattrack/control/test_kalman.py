"""The axis filter against least squares over the whole history, and its own claims against made-up noise."""

from __future__ import annotations

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter

from sattrack.control.kalman import AxisFilter, LeanKalmanFilter, Noise, wrap180

STEP_S = 0.05
QUIET = Noise(
    position_deg=1e-5,
    timing_s=0.0,
    walk_deg_sqrt_s=0.0,
    rate_walk_deg_s_sqrt_s=0.0,
    first_rate_deg_s=0.1,
    learning=0.0,
)


def test_without_process_noise_it_is_the_straight_line_of_least_squares() -> None:
    rng = np.random.default_rng(7)
    times = np.arange(1, 41) * STEP_S
    measured = 30.0 + 0.002 * times + rng.normal(0.0, 1e-5, times.size)
    axis = AxisFilter(30.0, QUIET)
    for value in measured:
        axis.advance(STEP_S, 0.0)
        axis.measure(float(value), 0.0)
    # The prior counts as one measurement of the position at 0 (variance 1e-4) and one of the rate (0.01).
    rows = np.column_stack([np.ones(42), np.concatenate([times, [0.0, 0.0]])])
    rows[-1] = (0.0, 1.0)
    values = np.concatenate([measured, [30.0, 0.0]])
    weights = 1.0 / np.concatenate([np.full(40, 1e-5), [1e-2, 0.1]])
    line = np.linalg.lstsq(rows * weights[:, None], values * weights, rcond=None)[0]
    assert axis.disturbance_deg_s == pytest.approx(line[1], rel=1e-6)
    assert axis.position_deg == pytest.approx(line[0] + line[1] * times[-1], abs=1e-10)


def test_a_commanded_move_is_no_surprise() -> None:
    axis = AxisFilter(10.0)
    for i in range(1, 100):
        axis.advance(STEP_S, 0.04)
        axis.measure(10.0 + 0.04 * i, 0.8)
    assert axis.disturbance_deg_s == pytest.approx(0.0, abs=1e-12)
    assert abs(axis.innovation_sigmas) < 1e-3


def test_positions_unwrap() -> None:
    axis = AxisFilter(359.99)
    for i in range(1, 20):
        axis.advance(STEP_S, 0.004)
        axis.measure((359.99 + 0.004 * i) % 360.0, 0.08)
    assert axis.position_deg == pytest.approx(359.99 + 0.004 * 19, abs=1e-9)


def test_its_sigma_is_what_errors_are() -> None:
    rng = np.random.default_rng(1)
    noise = Noise()
    sigmas = []
    for _ in range(150):
        position, rate = 50.0, rng.normal(0.0, noise.first_rate_deg_s)
        axis = AxisFilter(position, noise)
        for _ in range(60):
            step = rate * STEP_S + rng.normal(0.0, noise.walk_deg_sqrt_s * STEP_S**0.5)
            position += step + 0.01
            rate += rng.normal(0.0, noise.rate_walk_deg_s_sqrt_s * STEP_S**0.5)
            axis.advance(STEP_S, 0.01)
            axis.measure(position + rng.normal(0.0, noise.position_deg), 0.0)
        sigmas.append((axis.position_deg - position) / axis.position_sigma_deg)
    assert 0.85 < float(np.std(sigmas)) < 1.15


@pytest.mark.parametrize(
    ("angle", "wrapped"), [(0.0, 0.0), (190.0, -170.0), (-190.0, 170.0), (720.5, 0.5), (-180.0, -180.0)]
)
def test_wrap180(angle: float, wrapped: float) -> None:
    assert wrap180(angle) == pytest.approx(wrapped)


def test_the_lean_filter_gives_the_numbers_of_filterpy() -> None:
    dice = np.random.default_rng(8)
    theirs, ours = KalmanFilter(dim_x=3, dim_z=1, dim_u=1), LeanKalmanFilter(10.0, (1e-4, 1e-5, 4e-4))
    theirs.x = np.array([[10.0], [0.0], [0.0]])
    theirs.P = np.diag([1e-4, 1e-5, 4e-4])
    theirs.H = np.array([[1.0, 0.0, 0.0]])
    given = np.array([[1.0], [0.0], [0.0]])
    for _ in range(2000):
        moved, seconds = dice.normal(0.0, 0.05), dice.uniform(0.04, 0.06)
        known = moved if dice.random() < 0.8 else 0.0
        transition = np.array([[1.0, seconds, known], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
        own, rate, gain = dice.uniform(1e-12, 1e-9, 3)
        cross = 0.5 * min(own, rate)
        process = np.array([[own, cross, 0.0], [cross, rate, 0.0], [0.0, 0.0, gain]])
        seen, variance = 10.0 + dice.normal(0.0, 0.01), dice.uniform(1e-10, 1e-8)
        theirs.predict(u=np.array([[moved]]), B=given, F=transition, Q=process)
        ours.foretell(seconds, moved, known, (own, cross, rate, gain))
        assert ours.x == pytest.approx(theirs.x, rel=1e-9, abs=1e-12)
        theirs.update(seen, R=np.array([[variance]]))
        ours.correct(seen, variance)
        assert ours.x == pytest.approx(theirs.x, rel=1e-9, abs=1e-12)
        spread = np.sqrt(np.diag(theirs.P))
        assert np.abs((ours.P - theirs.P) / np.outer(spread, spread)).max() < 1e-9
        assert ours.innovation_deg == pytest.approx(theirs.y[0, 0], rel=1e-6, abs=1e-12)
        assert ours.innovation_variance == pytest.approx(theirs.S[0, 0], rel=1e-9)


def test_a_large_rate_that_has_gone_is_unlearnt_at_once_though_the_axis_is_slow() -> None:
    """An abort by other hands stops a slow axis for half a second, and lets it go again."""
    axis, true_deg, step_s = AxisFilter(0.0), 0.0, 0.05
    for number in range(260):
        stopped = 200 <= number < 210
        # What is commanded while it stands is more, to catch up.
        commanded_deg_s = 0.12 if stopped else 0.013
        true_deg += 0.0 if stopped else commanded_deg_s * step_s
        axis.advance(step_s, commanded_deg_s * step_s)
        axis.measure(true_deg, commanded_deg_s)
        if number == 209:
            assert axis.disturbance_deg_s < -0.02
    assert abs(axis.disturbance_deg_s) < 0.001


def test_an_axis_that_sticks_near_rest_is_no_rate() -> None:
    axis, true_deg, step_s = AxisFilter(0.0), 0.0, 0.05
    for number in range(240):
        stuck = 200 <= number < 210
        true_deg += 0.0 if stuck else 0.013 * step_s
        axis.advance(step_s, 0.013 * step_s)
        axis.measure(true_deg, 0.013)
    assert abs(axis.disturbance_deg_s) < 0.002
