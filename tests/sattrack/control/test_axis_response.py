"""How an axis answers commands, against numerical integration and the closed forms of servos."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from sattrack.control.axis_filter import (
    JUMPS_S,
    KNOTS_S,
    SETTLED_S,
    SHARES,
    Commanded,
    Step,
    answers_of,
    expected_shares,
    lag_of,
    lag_sigma_s,
    rest_of,
    share_spread,
)

GRAIN_S = 0.0005
LONG_AGO = Step(-math.inf, 0.4, -0.2)


def effects(steps: list[Step], from_s: float, to_s: float) -> np.ndarray:
    """Return the effects of steps, the first of which has acted since long before the span."""
    commanded = Commanded(min(from_s, steps[1].utc_s if len(steps) > 1 else from_s) - 5.0, *steps[0][1:])
    for step in steps[1:]:
        commanded.add(step)
    return commanded.effects(from_s, to_s)


def step_response(share: int, lags_s: np.ndarray) -> np.ndarray:
    """Return how much of a change has come out by lags, of what is all in one share."""
    if share < len(JUMPS_S):
        return (lags_s >= JUMPS_S[share]).astype(float)
    begins, ends = KNOTS_S[share - len(JUMPS_S)], KNOTS_S[share - len(JUMPS_S) + 1]
    return np.interp(lags_s, [begins, ends], [0.0, 1.0])


def integrated(share: int, steps: list[Step], from_s: float, to_s: float) -> tuple[float, float]:
    """Return how far both axes move, by the midpoint rule over their rates."""
    times = np.arange(from_s + 0.5 * GRAIN_S, to_s, GRAIN_S)
    rates = np.tile(np.array(steps[0][1:])[:, None], times.size)
    for before, now in itertools.pairwise(steps):
        change = np.array(now[1:]) - np.array(before[1:])
        rates = rates + change[:, None] * step_response(share, times - now.utc_s)
    ra, dec = rates.sum(axis=1) * GRAIN_S
    return float(ra), float(dec)


def steps_until(count: int, seed: int, every_s: float = 0.05) -> list[Step]:
    dice = np.random.default_rng(seed)
    return [LONG_AGO, *(Step(every_s * k, *dice.normal(0.0, 1.0, 2)) for k in range(count))]


def test_a_response_is_told_in_turns_at_first_and_to_its_end() -> None:
    """As docs/feeder.md has it: after 50, 100, 150 ms, and so on to 1.4 s; a turn is 50 ms."""
    assert KNOTS_S[:4] == (0.0, 0.05, 0.1, 0.15)
    assert (KNOTS_S[-1], SETTLED_S) == (1.4, 1.4)
    assert sorted(set(KNOTS_S)) == list(KNOTS_S)
    assert JUMPS_S == (-0.05, 0.0, 0.05)


@pytest.mark.parametrize("share", range(SHARES))
@pytest.mark.parametrize(
    ("from_s", "to_s"),
    [
        (0.5, 0.55),
        # Before all changes, from before the first to within them, and long after.
        (-0.5, -0.1),
        (-0.2, 0.33),
        (3.0, 3.1),
        # Samples were lost.
        (0.4, 0.75),
    ],
)
def test_effects_are_those_of_rates_integrated(share: int, from_s: float, to_s: float) -> None:
    steps = steps_until(12, seed=share)
    effect = effects(steps, from_s, to_s)
    assert effect.shape == (2, SHARES)
    # A jump within a grain is off by half of it.
    assert effect[:, share] == pytest.approx(integrated(share, steps, from_s, to_s), abs=12 * GRAIN_S)
    fine = len(JUMPS_S) <= share
    if fine:
        assert effect[:, share] == pytest.approx(integrated(share, steps, from_s, to_s), abs=1e-5)


def test_effects_over_two_spans_are_those_over_both() -> None:
    steps = steps_until(30, seed=3)
    whole = effects(steps, 0.12, 1.4)
    assert effects(steps, 0.12, 0.61) + effects(steps, 0.61, 1.4) == pytest.approx(whole, abs=1e-12)


def test_one_step_that_has_always_acted_is_its_rate_times_the_time() -> None:
    assert effects([LONG_AGO], 2.0, 2.5)[0] == pytest.approx(0.2)
    assert effects([LONG_AGO], 2.0, 2.5)[1] == pytest.approx(-0.1)


def test_a_step_less_its_rest_leaves_what_its_lags_leave() -> None:
    """What a rate has yet to bring out, once settled, is itself over its lag: each share's own middle."""
    step = Step(0.0, 2.0, -1.0)
    moved = effects([Step(-9.0, 0.0, 0.0), step], 0.0, SETTLED_S)
    early = JUMPS_S[0]
    assert rest_of(step, SETTLED_S)[:, 1:] == pytest.approx(moved[:, 1:])
    # What comes a turn early has moved the axis before the command was to act.
    assert rest_of(step, SETTLED_S)[:, 0] == pytest.approx(moved[:, 0] - early * np.array([2.0, -1.0]))
    behind = 2.0 * SETTLED_S - rest_of(step, SETTLED_S)[0]
    middles = [*JUMPS_S, *(0.5 * (a + b) for a, b in itertools.pairwise(KNOTS_S))]
    assert behind == pytest.approx(2.0 * np.array(middles), abs=1e-12)


def shares_of(reached: np.ndarray) -> np.ndarray:
    """Return the shares of a servo by what has come out at the knots."""
    return np.array([*[0.0] * len(JUMPS_S), *np.diff(reached)])


@pytest.mark.parametrize("share", range(SHARES))
def test_what_comes_out_at_once_or_evenly_has_the_moments_of_that(share: int) -> None:
    """At one lag: no variance. Evenly between two: their mean, and the square of their distance over 12."""
    shares = np.zeros(SHARES)
    shares[share] = 1.25
    jump = share < len(JUMPS_S)
    k = share - len(JUMPS_S)
    begins, ends = (JUMPS_S[share],) * 2 if jump else (KNOTS_S[k], KNOTS_S[k + 1])
    found = lag_of(shares)
    assert found == pytest.approx((0.5 * (begins + ends), (ends - begins) ** 2 / 12.0, 1.25), abs=1e-12)


@pytest.mark.parametrize("lag_s", [0.05, 0.1, 0.2])
def test_the_lag_of_a_first_order_servo(lag_s: float) -> None:
    """1 - exp(-t/τ): mean τ, variance τ²; what lies evenly between knots bends both by a little."""
    found = lag_of(shares_of(1.0 - np.exp(-np.array(KNOTS_S) / lag_s)))
    assert found.mean_s == pytest.approx(lag_s, abs=0.006)
    assert math.sqrt(found.variance_s2) == pytest.approx(lag_s, rel=0.12)


@pytest.mark.parametrize(("bandwidth_hz", "damping"), [(1.5, 0.7), (2.0, 1.0), (3.0, 0.8), (4.0, 0.6)])
def test_the_lag_of_a_second_order_servo(bandwidth_hz: float, damping: float) -> None:
    """ω²/(s² + 2ζωs + ω²): mean 2ζ/ω and variance (4ζ² - 2)/ω², by the moments of its impulse response."""
    omega = 2.0 * math.pi * bandwidth_hz
    times = np.arange(0.0, KNOTS_S[-1] + 1e-4, 1e-4)
    rate, accelerated, out = 0.0, 0.0, []
    for _ in times:
        out.append(rate)
        accelerated += (omega * omega * (1.0 - rate) - 2.0 * damping * omega * accelerated) * 1e-4
        rate += accelerated * 1e-4
    found = lag_of(shares_of(np.interp(KNOTS_S, times, out)))
    assert found.mean_s == pytest.approx(2.0 * damping / omega, abs=0.004)
    assert found.variance_s2 == pytest.approx((4.0 * damping**2 - 2.0) / omega**2, abs=0.0016)


@pytest.mark.parametrize("lag_s", [-0.1, 0.0, 0.01, 0.024, 0.025, 0.03, 0.06, 0.1, 0.2])
def test_the_expected_servo_is_of_first_order_and_has_its_lag(lag_s: float) -> None:
    shares = expected_shares(lag_s)
    assert shares.sum() == pytest.approx(1.0, abs=1e-12)
    assert (shares >= 0.0).all()
    assert lag_of(shares).mean_s == pytest.approx(max(0.0, lag_s), abs=0.003)
    for seconds in (0.05, 0.15, 0.55):
        true = seconds - lag_s * (1.0 - math.exp(-seconds / lag_s)) if lag_s > 0.0 else seconds
        assert shares.dot(answers_of(seconds)) == pytest.approx(true, abs=0.004)


@pytest.mark.parametrize(
    "sigmas", [(0.5, 0.3, 0.02), (0.003, 0.0, 1e-5), (0.0, 0.0, 0.02), (0.0, 0.3, 0.0), (0.0, 0.0, 0.0)]
)
def test_what_is_unknown_of_a_servo_is_a_covariance_and_says_what_it_is_told(
    sigmas: tuple[float, float, float],
) -> None:
    late, turn, gain = sigmas
    covariance = share_spread(late, turn, gain)
    assert covariance.shape == (SHARES, SHARES)
    assert covariance == pytest.approx(covariance.T, rel=1e-12, abs=1e-15)
    assert np.linalg.eigvalsh(covariance).min() > -1e-12
    every = np.ones(SHARES)
    # What has come out in the end: the last knot is long past where lateness fades.
    assert every @ covariance @ every == pytest.approx(gain**2, abs=1e-9)
    at_once = np.array([1.0] * len(JUMPS_S) + [0.0] * (SHARES - len(JUMPS_S)))
    assert at_once @ covariance @ at_once == pytest.approx(late**2 + gain**2)
    assert covariance[0, 0] == pytest.approx(turn**2)


def test_the_lags_sigma_is_that_of_drawn_servos() -> None:
    covariance = share_spread(0.05, 0.03, 0.002)
    values, vectors = np.linalg.eigh(covariance)
    roots = vectors * np.sqrt(np.maximum(values, 0.0))
    dice = np.random.default_rng(5)
    lags = [lag_of(expected_shares(0.08) + roots @ dice.normal(0.0, 1.0, SHARES)).mean_s for _ in range(4000)]
    assert lag_sigma_s(covariance) == pytest.approx(float(np.std(lags)), rel=0.05)
