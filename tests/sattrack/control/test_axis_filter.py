"""The axis filter against least squares over the whole history, and its own claims against made-up noise."""

from __future__ import annotations

import math
import random
import re
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from sattrack.control import axis_filter
from sattrack.control.axis_filter import (
    BEFORE_S,
    SHARES,
    AxisFilter,
    Commanded,
    LeanKalmanFilter,
    LoopTurn,
    Noise,
    Step,
)
from sattrack.core.angles import wrap180

if TYPE_CHECKING:
    from collections.abc import Iterator

STEP_S = 0.05
ARCSEC = 1.0 / 3600.0
NEVER_S = 1e99
QUIET = Noise(
    position_deg=1e-5,
    timing_s=0.0,
    walk_deg_sqrt_s=0.0,
    rate_walk_deg_s_sqrt_s=0.0,
    rate_fades_s=NEVER_S,
    first_rate_deg_s=0.1,
    gain_walk_sqrt_s=0.0,
    late_walk_sqrt_s=0.0,
    learning=0.0,
)


def moved(rate_deg_s: float) -> np.ndarray:
    """Effects of a rate that has been commanded since long before."""
    return np.full(SHARES, rate_deg_s * STEP_S)


@pytest.mark.parametrize(
    "changes", [{"timing_s": -1e-9}, {"turn": math.inf}, {"late": math.nan}, {"rate_fades_s": 0.0}]
)
def test_noise_that_no_filter_can_compute_with_is_refused(changes: dict[str, float]) -> None:
    ((name, value),) = changes.items()
    with pytest.raises(ValueError, match=re.escape(f"{name} is {value:g}: give one above 0")):
        Noise(**changes)
    assert QUIET.timing_s == 0.0


def test_four_steps_make_as_uncertain_as_one_of_their_length() -> None:
    """Nothing is measured meanwhile: what noise does in a span does not depend on how it is cut."""
    noise = Noise(rate_fades_s=NEVER_S)
    once, cut = AxisFilter(30.0, noise), AxisFilter(30.0, noise)
    once.advance(4.0 * STEP_S, 0.0, 4.0 * moved(0.1), rough_deg=2e-5)
    for _ in range(4):
        cut.advance(STEP_S, 0.0, moved(0.1), rough_deg=1e-5)
    whole, parts = (one._kalman.covariance for one in (once, cut))
    assert parts[:2, :2] == pytest.approx(whole[:2, :2], rel=1e-9)
    # Rate noise alone, against its integrals: q T, q T²/2, q T³/3.
    q, span_s = noise.rate_walk_deg_s_sqrt_s**2, 4.0 * STEP_S
    first = noise.first_rate_deg_s**2
    assert whole[1, 1] == pytest.approx(first + q * span_s, rel=1e-9)
    assert whole[0, 1] == pytest.approx(first * span_s + q * span_s**2 / 2.0, rel=1e-9)


def test_without_process_noise_it_is_least_squares_over_the_whole_history() -> None:
    """Position, rate and all shares; the prior counts as one measurement of each."""
    rng = np.random.default_rng(7)
    roots = prior_roots(QUIET)
    true = np.concatenate(
        [[30.0, 0.002], axis_filter.expected_shares(QUIET.first_lag_s) + 0.3 * roots.sum(axis=1)]
    )
    axis, rows, values = AxisFilter(30.0, QUIET), [], []
    gone = np.concatenate([[1.0, 0.0], np.zeros(SHARES)])
    for _ in range(80):
        effect = rng.normal(0.0, 0.02, SHARES)
        gone[1] += STEP_S
        gone[2:] += effect
        measured = float(gone @ true) + rng.normal(0.0, 1e-5)
        rows.append(gone.copy())
        values.append(measured)
        axis.advance(STEP_S, 0.0, effect)
        # As noise is drawn, single samples may surprise: that is judged elsewhere.
        axis.measure(measured, 0.0)
    # Unknowns: position and rate in their sigmas, and the shares along the roots of their covariance.
    first = np.concatenate([[30.0, 0.0], axis_filter.expected_shares(QUIET.first_lag_s)])
    turn = np.zeros((2 + SHARES, 2 + roots.shape[1]))
    turn[0, 0], turn[1, 1] = 1e-2, 0.1
    turn[2:, 2:] = roots
    weighed = np.vstack([np.array(rows) @ turn / 1e-5, np.eye(turn.shape[1])])
    left = np.concatenate([(np.array(values) - np.array(rows) @ first) / 1e-5, np.zeros(turn.shape[1])])
    best = first + turn @ np.linalg.lstsq(weighed, left, rcond=None)[0]
    assert axis.disturbance_deg_s == pytest.approx(best[1], abs=1e-9)
    assert axis.position_deg == pytest.approx(float(gone @ best), abs=1e-9)
    assert axis.gain_error == pytest.approx(best[2:].sum() - 1.0, abs=1e-6)
    assert axis.shares[0] == pytest.approx(best[2], abs=1e-6)
    assert abs(axis.gain_error) > 1e-3


def prior_roots(noise: Noise) -> np.ndarray:
    """Return columns whose squares sum to the covariance of the shares of an unknown axis."""
    values, vectors = np.linalg.eigh(axis_filter.share_spread(noise.late, noise.turn, noise.first_gain))
    return vectors[:, values > 1e-12] * np.sqrt(values[values > 1e-12])


def test_a_place_that_is_taken_as_seen_tells_nothing_of_rate_and_response() -> None:
    axis = AxisFilter(10.0)
    for i in range(1, 40):
        axis.advance(STEP_S, 0.0, moved(0.8))
        axis.measure(10.0 + 0.0405 * i, 0.8)
    rate, gain = axis.disturbance_deg_s, axis.gain_error
    assert (rate, gain) != (0.0, 0.0)
    axis.stand_at(370.0 - 9.0)
    assert axis.position_deg % 360.0 == pytest.approx(1.0)
    axis.measure(1.0001, 0.0)
    assert 1.00001 < axis.position_deg % 360.0 < 1.0001
    assert (axis.disturbance_deg_s, axis.gain_error) == pytest.approx((rate, gain), abs=1e-15)


def test_what_was_learnt_is_changed_by_what_a_changed_delay_says() -> None:
    axis = AxisFilter(10.0)
    axis.change(np.array([0.5, -0.02, *np.full(SHARES, 0.01 / SHARES)]))
    assert axis.position_deg == pytest.approx(10.5)
    assert axis.disturbance_deg_s == pytest.approx(-0.02)
    assert axis.gain_error == pytest.approx(0.01)


def test_a_rate_that_nobody_asked_for_fades_while_nothing_is_measured() -> None:
    axis = AxisFilter(10.0, replace(QUIET, rate_fades_s=2.0))
    axis.change(np.array([0.0, -0.02, *np.zeros(SHARES)]))
    for _ in range(40):
        axis.advance(STEP_S, 0.0, None)
    assert axis.position_deg - 10.0 == pytest.approx(-0.02 * 2.0 * (1.0 - math.exp(-1.0)), rel=0.03)


def test_how_surprising_a_turn_is_counts_both_axes() -> None:
    turn = LoopTurn((3.0, -4.0), (0.5, 0.25), (2.0, 5.0), Step(0.0, 1.0, 2.0))
    assert turn.surprise(Step(0.0, 1.0, 2.0)) == pytest.approx(1.5**2 + 0.8**2)
    # 2°/s more of the first is a degree, and 4°/s less of the second a degree the other way.
    assert turn.surprise(Step(0.0, 3.0, -2.0)) == pytest.approx(1.0**2 + 0.6**2)


def test_a_commanded_move_is_no_surprise() -> None:
    axis = AxisFilter(10.0)
    for i in range(1, 100):
        axis.advance(STEP_S, 0.0, moved(0.8))
        axis.measure(10.0 + 0.04 * i, 0.8)
    assert axis.disturbance_deg_s == pytest.approx(0.0, abs=1e-12)
    assert abs(axis.innovation_sigmas) < 1e-3


def test_positions_unwrap() -> None:
    axis = AxisFilter(359.99)
    for i in range(1, 20):
        axis.advance(STEP_S, 0.0, moved(0.08))
        axis.measure((359.99 + 0.004 * i) % 360.0, 0.08)
    assert axis.position_deg == pytest.approx(359.99 + 0.004 * 19, abs=1e-9)


def test_its_sigma_is_what_errors_are() -> None:
    """Axes drawn from what the filter expects of one: rate, servo and gain, noise of motion and readings."""
    rng = np.random.default_rng(1)
    noise = Noise()
    roots = prior_roots(noise)
    sigmas = []
    for _ in range(150):
        position, rate = 50.0, rng.normal(0.0, noise.first_rate_deg_s)
        shares = axis_filter.expected_shares(noise.first_lag_s) + roots @ rng.normal(0.0, 1.0, roots.shape[1])
        axis = AxisFilter(position, noise)
        for _ in range(60):
            effect = rng.normal(0.0, 0.002, SHARES)
            walked = rng.normal(0.0, noise.walk_deg_sqrt_s * STEP_S**0.5)
            position += rate * STEP_S + walked + float(effect @ shares)
            rate += rng.normal(0.0, noise.rate_walk_deg_s_sqrt_s * STEP_S**0.5)
            axis.advance(STEP_S, 0.0, effect)
            axis.measure(position + rng.normal(0.0, noise.position_deg), 0.0)
        assert axis.begun_anew == 0
        sigmas.append((axis.position_deg - position) / axis._kalman.covariance[0, 0] ** 0.5)
    assert 0.85 < float(np.std(sigmas)) < 1.15


@pytest.mark.parametrize(
    ("angle", "wrapped"), [(0.0, 0.0), (190.0, -170.0), (-190.0, 170.0), (720.5, 0.5), (-180.0, -180.0)]
)
def test_wrap180(angle: float, wrapped: float) -> None:
    assert wrap180(angle) == pytest.approx(wrapped)


@pytest.mark.parametrize("size", [3, 2 + SHARES])
def test_the_lean_filter_gives_the_numbers_of_filterpy(size: int) -> None:
    from filterpy.kalman import KalmanFilter

    dice = np.random.default_rng(8)
    first, spreads = np.array([10.0, *[0.0] * (size - 1)]), np.array([1e-4, 1e-5, *[4e-4] * (size - 2)])
    theirs, ours = KalmanFilter(dim_x=size, dim_z=1, dim_u=1), LeanKalmanFilter(first, np.diag(spreads))
    theirs.x, theirs.P = first[:, None].copy(), np.diag(spreads)
    theirs.H, given = np.eye(size)[:1], np.eye(size)[:, :1]
    for _ in range(600):
        by_plan, seconds = dice.normal(0.0, 0.05), dice.uniform(0.04, 0.06)
        moves = np.array([seconds, *(dice.normal(0.0, 0.05, size - 2) * (dice.random() < 0.8))])
        share = dice.uniform(0.99, 1.0)
        transition = np.eye(size)
        transition[0, 1:], transition[1, 1] = moves, share
        own, rate, gain = dice.uniform(1e-12, 1e-9, 3)
        cross, shares = 0.5 * min(own, rate), np.eye(size - 2) * gain + 0.1 * gain
        process = np.zeros((size, size))
        process[:2, :2], process[2:, 2:] = [[own, cross], [cross, rate]], shares
        seen, variance = 10.0 + dice.normal(0.0, 0.01), dice.uniform(1e-10, 1e-8)
        theirs.predict(u=np.array([[by_plan]]), B=given, F=transition, Q=process)
        ours.foretell(moves, by_plan)
        ours.fade(share)
        ours.blur(own, cross, rate, shares)
        assert ours.state == pytest.approx(theirs.x[:, 0], rel=1e-9, abs=1e-12)
        theirs.update(seen, R=np.array([[variance]]))
        ours.correct(seen, variance)
        assert ours.state == pytest.approx(theirs.x[:, 0], rel=1e-8, abs=1e-11)
        spread = np.sqrt(np.diag(theirs.P))
        assert np.abs((ours.covariance - theirs.P) / np.outer(spread, spread)).max() < 1e-8
        assert ours.innovation_deg == pytest.approx(theirs.y[0, 0], rel=1e-6, abs=1e-11)
        assert ours.innovation_variance == pytest.approx(theirs.S[0, 0], rel=1e-8)


def held_up(from_: int, samples: int, commanded_deg_s: float, meanwhile_deg_s: float) -> Iterator[AxisFilter]:
    """The filter after each sample of an axis that does what is commanded, but stands for ten samples."""
    axis, true_deg = AxisFilter(0.0), 0.0
    for number in range(samples):
        stands = from_ <= number < from_ + 10
        rate_deg_s = meanwhile_deg_s if stands else commanded_deg_s
        true_deg += 0.0 if stands else rate_deg_s * STEP_S
        axis.advance(STEP_S, 0.0, moved(rate_deg_s))
        axis.measure(true_deg, rate_deg_s)
        yield axis


def test_a_large_rate_that_has_gone_is_unlearnt_at_once_though_the_axis_is_slow() -> None:
    """An abort by other hands stops a slow axis for half a second, and lets it go again."""
    # What is commanded while it stands is more, to catch up.
    for number, axis in enumerate(held_up(200, 260, 0.013, 0.12)):
        if number == 209:
            assert axis.disturbance_deg_s < -0.02
    assert abs(axis.disturbance_deg_s) < 0.001


def test_an_axis_that_sticks_near_rest_is_no_rate() -> None:
    *_, axis = held_up(200, 240, 0.013, 0.013)
    assert abs(axis.disturbance_deg_s) < 0.002


def test_near_rest_a_rate_that_is_over_is_unlearnt_in_three_samples_of_an_axis_that_is_hardly_known() -> None:
    """An abort by other hands: it was three seconds on its way, stood for half a second, and goes on."""
    for number, axis in enumerate(held_up(60, 90, 0.013, 0.12)):
        if number in (69, 71):
            assert axis.disturbance_deg_s < -0.1
        elif number >= 72:
            assert abs(axis.disturbance_deg_s) < 0.001


@pytest.mark.parametrize("stuck_deg_s", [0.03, 0.04])
def test_near_rest_an_axis_that_sticks_is_not_taken_for_one_with_all_of_that_rate(stuck_deg_s: float) -> None:
    """However long it sticks, and where more is commanded meanwhile: 0.04°/s are 144″/s."""
    for axis in held_up(60, 70, stuck_deg_s, 0.04):
        assert abs(axis.disturbance_deg_s) * 3600.0 < 60.0


def sum_sigma(axis: AxisFilter) -> float:
    """Return one sigma of the gain."""
    return math.sqrt(float(axis._kalman.covariance[2:, 2:].sum()))


def test_of_a_motion_at_its_roughest_the_gain_is_as_uncertain_as_at_first_after_two_seconds_and_no_more() -> (
    None
):
    for rough_share, after_2_s, after_6_s in ((1.0, 0.0, 0.0), (16.0, 0.019, 0.02)):
        axis = AxisFilter(0.0, replace(QUIET, first_gain=0.02))
        known = axis._kalman
        # A third comes a turn early, and that is known.
        known.state[2:] = 0.0
        known.state[2:4] = 0.3, 0.7
        known.covariance[:] = 0.0
        axis._rough_share = rough_share
        for seconds, sigma in ((2.0, after_2_s), (4.0, after_6_s)):
            for _ in range(round(seconds / STEP_S)):
                axis.advance(STEP_S, 0.0, moved(0.3))
            assert sum_sigma(axis) == pytest.approx(sigma, abs=1e-4)


@pytest.mark.parametrize(("shaken", "of_jolt", "of_rate"), [(False, 9.0, 9.0), (True, 1.0, 81.0)])
def test_what_is_rough_after_a_jolt_is_a_rate_that_nobody_asked_for(
    shaken: bool, of_jolt: float, of_rate: float
) -> None:
    """Of a motion nine times as rough as expected; the jolt's own answer is no rougher for that."""
    variances = []
    for rough_deg in (0.0, 1e-4):
        axis = AxisFilter(0.0, replace(QUIET, rate_walk_deg_s_sqrt_s=2e-4))
        axis._kalman.covariance[:] = 0.0
        axis._rough_share = 9.0
        axis.advance(STEP_S, 0.0, moved(0.3), rough_deg, shaken)
        variances.append(axis._kalman.covariance[:2, :2].copy())
    assert variances[0][1, 1] == pytest.approx(of_rate * 2e-4**2 * STEP_S)
    assert variances[1] - variances[0] == pytest.approx(np.diag([of_jolt * 1e-4**2, 0.0]), abs=1e-14)


def go_on(axis: AxisFilter, samples: int) -> None:
    """Have an axis do what its filter expects."""
    for _ in range(samples):
        axis.advance(STEP_S, 0.0, moved(0.3))
        axis.measure(axis.position_deg, 0.3)


def gain_after_beginning_anew(axis: AxisFilter) -> float:
    axis.begin_anew(50.0)
    assert (axis.position_deg, axis.disturbance_deg_s) == (50.0, 0.0)
    return axis.gain_error


def test_a_response_that_held_for_eighty_samples_is_kept_for_the_next_beginning_and_no_further() -> None:
    """The first twenty of a filter are not judged; what has changed since counts every twenty samples."""

    def learnt() -> AxisFilter:
        axis = AxisFilter(0.0)
        axis.change(np.array([0.0, 0.0, 0.01, *np.zeros(SHARES - 1)]))
        return axis

    for samples, kept in ((99, 0.0), (100, 0.01)):
        axis = learnt()
        go_on(axis, samples)
        assert gain_after_beginning_anew(axis) == pytest.approx(kept, abs=1e-9)
        assert gain_after_beginning_anew(axis) == pytest.approx(0.0, abs=1e-9)
    for samples, kept in ((19, 0.01), (20, 0.015)):
        axis = learnt()
        go_on(axis, 100)
        axis.change(np.array([0.0, 0.0, 0.005, *np.zeros(SHARES - 1)]))
        go_on(axis, samples)
        assert gain_after_beginning_anew(axis) == pytest.approx(kept, abs=1e-9)
    # A surprise has them counted anew: here the mean of the squares is above two for one sample yet.
    for samples, kept in ((80, 0.0), (81, 0.01)):
        axis = learnt()
        go_on(axis, 60)
        axis._surprises = 2.2
        go_on(axis, samples)
        assert gain_after_beginning_anew(axis) == pytest.approx(kept, abs=1e-9)


@pytest.mark.parametrize("glitch_arcsec", [20.0, -20.0, 3600.0])
def test_one_glitch_however_large_unlearns_nothing(glitch_arcsec: float) -> None:
    axis = steady(100)
    gain = axis.gain_error
    axis.advance(STEP_S, 0.0, moved(0.3))
    expected_deg = axis.position_deg
    axis.measure(expected_deg + glitch_arcsec / 3600.0, 0.3)
    assert abs(axis.position_deg - expected_deg) * 3600.0 < 0.3
    assert abs(axis.disturbance_deg_s) * 3600.0 < 2.0
    assert axis.gain_error == pytest.approx(gain, abs=0.003)
    go_on(axis, 30)
    assert (axis.begun_anew, axis.has_just_begun) == (0, False)


def test_a_gain_that_was_learnt_wrongly_and_too_surely_is_learnt_anew() -> None:
    """On the way to a target, a drive at its limit teaches a wrong gain, and a rate that cancels it."""
    axis, true_deg, rate_deg_s, wrong = AxisFilter(0.0), 0.0, 0.35, -0.08
    for number in range(700):
        if number == 200:
            known = axis._kalman
            known.state[1] -= wrong * rate_deg_s
            known.state[2:] *= 1.0 + wrong
            known.covariance[1:] *= 0.1
            known.covariance[:, 1:] *= 0.1
        elif number > 200:
            rate_deg_s += 0.03 * STEP_S
        true_deg += rate_deg_s * STEP_S
        axis.advance(STEP_S, 0.0, moved(rate_deg_s))
        axis.measure(true_deg, rate_deg_s)
    assert abs(axis.gain_error) < 0.02


def steady(samples: int = 60) -> AxisFilter:
    """Return the filter of an axis that was commanded a steady rate, and obeyed."""
    axis = AxisFilter(0.0)
    for number in range(1, samples + 1):
        axis.advance(STEP_S, 0.0, moved(0.3))
        axis.measure(0.3 * number * STEP_S, 0.3)
    assert axis.begun_anew == 0
    return axis


@pytest.mark.parametrize(
    ("gain_error", "rate_arcsec_s", "kept"),
    [
        (0.024, 0.0, True),
        (-0.024, 0.0, True),
        (0.026, 0.0, False),
        (-0.026, 0.0, False),
        (0.0, 24.0, True),
        (0.0, -24.0, True),
        (0.0, 26.0, False),
        (0.0, -26.0, False),
        (0.024, -24.0, True),
        (0.026, -24.0, False),
        (0.024, 26.0, False),
    ],
)
def test_what_a_disturbed_motion_has_taught_is_kept_where_gain_and_rate_are_likely(
    gain_error: float, rate_arcsec_s: float, kept: bool
) -> None:
    """Within 1.25 sigmas of an unknown axis' 2 % and 20″/s; else it is forgotten, and that is counted."""
    axis = steady(39)
    axis._disturbed = True
    axis.advance(STEP_S, 0.0, moved(0.3))
    axis.measure(axis.position_deg, 0.3)
    # A filter is given forty samples.
    assert not axis.has_just_begun
    known = axis._kalman
    known.state[2] += gain_error - axis.gain_error
    axis.advance(STEP_S, 0.0, moved(0.3))
    known.state[1] = rate_arcsec_s / 3600.0
    axis.measure(axis.position_deg, 0.3)
    assert axis.has_just_begun
    assert axis.begun_anew == (0 if kept else 1)
    assert axis.gain_error == pytest.approx(gain_error if kept else 0.0, abs=1e-9)
    assert axis.disturbance_deg_s * 3600.0 == pytest.approx(rate_arcsec_s if kept else 0.0, abs=1e-6)
    # That is over then.
    for _ in range(50):
        axis.advance(STEP_S, 0.0, moved(0.3))
        axis.measure(axis.position_deg, 0.3)
        assert not axis.has_just_begun


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_an_axis_that_was_known_and_is_stopped_may_go_on_at_any_time_for_three_seconds(sense: float) -> None:
    """Beyond 40″/s beside its commands: the variance of that rate grows by its square in a second."""

    def grown(axis: AxisFilter, rate_deg_s: float) -> float:
        axis._kalman.state[1] = sense * rate_deg_s
        faded = float(axis._kalman.covariance[1, 1]) * (1.0 - STEP_S / Noise().rate_fades_s) ** 2
        axis.advance(STEP_S, 0.0, moved(0.3))
        return float(axis._kalman.covariance[1, 1]) - faded

    axis, beyond_deg_s = steady(100), 40.0 / 3600.0
    usual = grown(axis, 0.0)
    for again in range(2):
        for number in range(70):
            more = grown(axis, beyond_deg_s + 0.3) - usual
            if number != 59:
                assert more == pytest.approx(0.3**2 * STEP_S if number < 59 else 0.0, abs=1e-9), (
                    again,
                    number,
                )
        assert grown(axis, 0.99 * beyond_deg_s) == pytest.approx(usual, abs=1e-9)
    # Of one that is not known yet, it may be its gain.
    assert grown(steady(60), beyond_deg_s + 0.3) == pytest.approx(usual, abs=1e-9)


@pytest.mark.parametrize("sense", [1.0, -1.0])
@pytest.mark.parametrize(
    ("gain_error", "rate_arcsec_s", "samples", "parts"),
    [
        (0.03, -32.0, 41, True),
        (0.03, -32.0, 40, False),
        # One of them is likely.
        (0.03, -24.0, 41, False),
        (0.024, -26.0, 41, False),
        # They do not cancel: 0.03 of 0.3 °/s are 32″/s, and 25 of those may be left.
        (0.03, 32.0, 41, False),
        (0.03, -58.0, 41, False),
        (0.03, -56.0, 41, True),
    ],
)
def test_a_gain_and_a_rate_that_are_both_unlikely_and_cancel_are_parted_once(
    gain_error: float, rate_arcsec_s: float, samples: int, parts: bool, sense: float
) -> None:
    axis = steady(samples - 1)
    known = axis._kalman
    axis.advance(STEP_S, 0.0, moved(0.3))
    known.state[2:] *= 1.0 + sense * gain_error
    known.state[1] = sense * rate_arcsec_s * ARCSEC
    axis._look()
    axis.measure(axis.position_deg, 0.3)
    assert axis.has_just_begun is parts
    assert axis.gain_error == pytest.approx(0.0 if parts else sense * gain_error, abs=1e-6)
    left_arcsec_s = sense * (rate_arcsec_s + gain_error * 0.3 * 3600.0 if parts else rate_arcsec_s)
    assert axis.disturbance_deg_s / ARCSEC == pytest.approx(left_arcsec_s, abs=0.2)
    # Where that happens again, it is the motion that is rough.
    assert axis._parted is parts
    assert axis.begun_anew == 0


@pytest.mark.parametrize("gain_error", [0.014, -0.02])
def test_a_gain_that_is_doubted_is_told_from_a_rate_by_the_next_change_of_the_command(
    gain_error: float,
) -> None:
    """An axis of another gain, whose filter is sure of it and takes what it sees for a rate beside it."""
    seen = {}
    for doubted in (False, True):
        axis = steady()
        known = axis._kalman
        known.state[1] = 0.3 * gain_error
        known.covariance[1:, :] = known.covariance[:, 1:] = 0.0
        known.covariance[1, 1], known.covariance[2, 2] = (1.0 * ARCSEC) ** 2, 1e-4**2
        both = np.concatenate([[0.0, 1.0], np.full(SHARES, 0.3)])
        before = float(both @ known.covariance @ both)
        if doubted:
            axis.doubt_gain(0.3)
            shares = np.concatenate([[0.0, 0.0], np.ones(SHARES)])
            assert shares @ known.covariance @ shares == pytest.approx(0.005**2, rel=0.01)
        assert both @ known.covariance @ both == pytest.approx(before, rel=1e-6)
        place_deg = axis.position_deg
        for k in range(400):
            rate = 0.3 + 0.2 * k / 400.0
            place_deg += (1.0 + gain_error) * rate * STEP_S
            axis.advance(STEP_S, 0.0, moved(rate))
            axis.measure(place_deg, rate)
        seen[doubted] = axis.gain_error, axis.disturbance_deg_s / ARCSEC
    assert seen[True] == (pytest.approx(gain_error, abs=5e-4), pytest.approx(0.0, abs=0.5))
    assert abs(seen[False][1]) > 10.0


def test_what_contradicts_its_readings_begins_anew_and_trusts_them_half_as_much() -> None:
    axis = steady()
    shares = []
    for number in range(1, 4):
        axis._kalman.state[2:] *= 1.01
        axis._surprises, axis._taken = 100.0, 60
        before = axis._noise_share
        axis.advance(STEP_S, 0.0, moved(0.3))
        axis.measure(axis.position_deg, 0.3)
        assert (axis.has_just_begun, axis.begun_anew) == (True, number)
        assert axis.gain_error == pytest.approx(0.0, abs=1e-9)
        shares.append(axis._noise_share / before)
    assert shares == pytest.approx([2.0] * 3, rel=0.05)


@pytest.mark.parametrize("seed", range(4))
def test_commands_that_follow_the_readings_noise_teach_no_gain(seed: int) -> None:
    """An ideal axis and encoder steps, in a loop: the rate doubles, and is corrected by what the filter sees.

    Whatever else the filter says of gain and rate is of its own making: each cancels most of the other, so
    both may go far before a position shows it.
    """
    dice = random.Random(seed)
    axis, commanded = AxisFilter(0.0), Commanded(-STEP_S)
    true_deg, wanted_deg, asked = 0.0, 0.0, [0.0, 0.0]
    surprises = []
    for turn in range(1600):
        rate_deg_s = 0.08 * 2.0 ** (turn / 1600.0)
        wanted_deg += rate_deg_s * STEP_S
        acts = asked.pop(0)
        commanded.add(Step(turn * STEP_S, acts, 0.0))
        true_deg += acts * STEP_S
        axis.advance(STEP_S, 0.0, commanded.effects(turn * STEP_S, (turn + 1) * STEP_S)[0])
        axis.measure(true_deg + dice.uniform(-0.5, 0.5) * 0.02 / 3600.0, acts)
        left_deg = wanted_deg + sum((rate_deg_s - one) * STEP_S for one in asked) - axis.position_deg
        asked.append(rate_deg_s + max(-0.05, min(0.05, left_deg / 0.2)))
        if turn >= 800:
            surprises.append(axis.innovation_sigmas)
            assert abs(axis.gain_error) < 0.001
            assert abs(axis.disturbance_deg_s) < 0.3 / 3600.0
    # What it expects of its readings is what they are, and none tells of the next.
    assert 0.7 < float(np.std(surprises)) < 1.4
    assert abs(float(np.corrcoef(surprises[1:], surprises[:-1])[0, 1])) < 0.25


def test_a_motion_that_was_smooth_for_long_may_be_rough_at_once() -> None:
    axis, true_deg, off_arcsec = AxisFilter(0.0), 0.0, []
    dice = np.random.default_rng(6)
    for number in range(1260):
        shaken_deg_s = 1.0 / 3600.0 * math.sin(8.0 * (number - 1200) * STEP_S) if number >= 1200 else 0.0
        true_deg += (0.3 + shaken_deg_s) * STEP_S
        axis.advance(STEP_S, 0.0, moved(0.3))
        axis.measure(true_deg + dice.normal(0.0, 0.006 / 3600.0), 0.3)
        off_arcsec.append(abs(axis.position_deg - true_deg) * 3600.0)
    assert max(off_arcsec[1000:1200]) < 0.01
    assert max(off_arcsec[1200:]) < 0.3
    assert max(off_arcsec[1210:]) < 0.05


def test_a_motion_that_was_rough_is_smooth_again() -> None:
    """Then its surprises are a small part of what was expected, and their signs tell nothing."""
    axis, true_deg, rough_deg = AxisFilter(0.0), 0.0, 0.3 / 3600.0
    dice, shares = np.random.default_rng(4), []
    for number in range(600):
        shaken_deg_s = 60.0 / 3600.0 * math.sin(number * STEP_S) if number < 300 else 0.0
        true_deg += (0.3 + shaken_deg_s) * STEP_S
        axis.advance(STEP_S, 0.0, moved(0.3), rough_deg)
        axis.measure(true_deg + dice.normal(0.0, 0.003 / 3600.0), 0.3)
        shares.append(axis._rough_share)
    assert max(shares) > 8.0
    assert shares[-1] < 1.5


@pytest.mark.parametrize("stuck_s", [0.25, 1.0])
@pytest.mark.parametrize("seed", range(3))
def test_a_smooth_axis_that_sticks_as_it_turns_back_keeps_its_response(seed: int, stuck_s: float) -> None:
    """Friction holds it near rest, until it breaks loose. Taken for its response, that made a loop swing."""
    dice = random.Random(seed)
    slows_deg_s2, late_s, turns_s = -0.001, 0.02, 59.6
    axis, commanded, lags = AxisFilter(0.0, lag_s=late_s), Commanded(0.0, 0.06), []
    held_deg = None
    for turn in range(1, 1260):
        begin_s, end_s = (turn - 1) * STEP_S, turn * STEP_S
        commanded.add(Step(begin_s, 0.06 + slows_deg_s2 * (begin_s + 0.5 * STEP_S), 0.0))
        axis.advance(STEP_S, 0.0, commanded.effects(begin_s, end_s)[0])
        since_s = end_s - late_s
        true_deg = 0.06 * since_s + 0.5 * slows_deg_s2 * since_s * since_s
        if turns_s < end_s < turns_s + stuck_s:
            held_deg = true_deg if held_deg is None else held_deg
            true_deg = held_deg
        elif turns_s + stuck_s <= end_s < turns_s + stuck_s + 0.1:
            true_deg += 0.15 / 3600.0
        axis.measure(true_deg + dice.uniform(-0.5, 0.5) * 0.0193 / 3600.0, 0.06 + slows_deg_s2 * since_s)
        lags.append(axis.lag.mean_s)
    before_s, after_s = lags[1190], lags[1190:]
    assert before_s == pytest.approx(late_s, abs=0.006)
    assert max(abs(lag_s - before_s) for lag_s in after_s) < 0.003


def certain(noise: Noise | None = None) -> AxisFilter:
    """Return the filter of an axis of which everything is known for sure."""
    axis = AxisFilter(0.0, noise)
    axis._kalman.covariance[:] = 0.0
    return axis


@pytest.mark.parametrize(("rate_deg_s", "sigma_arcsec"), [(0.0, 0.03), (-20.0, math.hypot(0.03, 2.16))])
def test_a_reading_is_off_by_its_encoder_and_by_its_date(rate_deg_s: float, sigma_arcsec: float) -> None:
    """By 0.03″, and by what the axis moves in 30 µs."""
    axis = certain()
    axis.measure(0.0, rate_deg_s)
    assert axis.innovation_sigma_deg / ARCSEC == pytest.approx(sigma_arcsec)


def test_what_a_second_adds_to_what_is_not_known_of_an_axis() -> None:
    """With the root of time: 0.02″ of its place, 0.5″/s of its rate, 0.3 % of what comes out at once."""
    axis = certain(Noise(rate_fades_s=NEVER_S))
    for _ in range(20):
        axis.advance(STEP_S, 0.0, moved(0.0))
    known = axis._kalman.covariance
    assert math.sqrt(known[1, 1]) / ARCSEC == pytest.approx(0.5)
    # The place also goes with the rate: the root of a third of 0.5″ after a second.
    assert math.sqrt(known[0, 0]) / ARCSEC == pytest.approx(math.hypot(0.02, 0.5 / math.sqrt(3.0)), rel=2e-3)
    at_once = np.array([1.0] * 3 + [0.0] * (SHARES - 3))
    assert math.sqrt(at_once @ known[2:, 2:] @ at_once) == pytest.approx(0.003, rel=1e-4)
    assert sum_sigma(axis) == pytest.approx(1e-5, rel=1e-3)


def test_what_is_expected_of_an_axis_before_it_was_seen_to_move() -> None:
    """A hundredth of a degree of its place, 20″/s, a gain within 2 %, half of what comes out at once."""
    known = AxisFilter(0.0)._kalman.covariance
    assert math.sqrt(known[0, 0]) == pytest.approx(0.01)
    assert math.sqrt(known[1, 1]) / ARCSEC == pytest.approx(20.0)
    assert sum_sigma(AxisFilter(0.0)) == pytest.approx(0.02, rel=1e-3)
    at_once = np.array([1.0] * 3 + [0.0] * (SHARES - 3))
    assert math.sqrt(at_once @ known[2:, 2:] @ at_once) == pytest.approx(math.hypot(0.5, 0.02))
    # Three tenths of a command may come a turn early, or late.
    assert np.sqrt(np.diag(known))[[2, 4]] == pytest.approx([0.3, 0.3])


def test_a_rate_that_is_not_seen_fades_in_a_minute() -> None:
    axis = AxisFilter(0.0)
    axis.change(np.array([0.0, -0.02, *np.zeros(SHARES)]))
    for _ in range(1200):
        axis.advance(STEP_S, 0.0, None)
    axis.stand_at(0.0)
    assert axis.disturbance_deg_s == pytest.approx(-0.02 / math.e, rel=1e-3)


def test_a_change_of_rate_comes_out_as_if_its_turn_were_3_ms_off() -> None:
    axis = certain()
    axis.measure(0.0, 0.0)
    assert axis.rough_deg(-0.5) == pytest.approx(0.0015)
    assert axis.expected_sigma_deg(0.5) == pytest.approx(math.hypot(0.03 * ARCSEC, 0.0015))


def test_a_changed_delay_makes_a_response_a_tenth_as_doubtful_as_that_of_an_unknown_axis() -> None:
    """In variance; a gain is the mount's own, and stays."""
    axis = certain()
    axis.change(np.zeros(2 + SHARES))
    known = axis._kalman.covariance
    at_once = np.array([1.0] * 3 + [0.0] * (SHARES - 3))
    assert at_once @ known[2:, 2:] @ at_once == pytest.approx(0.1 * 0.5**2)
    assert known[2, 2] == pytest.approx(0.1 * 0.3**2)
    assert sum_sigma(axis) == pytest.approx(0.0, abs=1e-6)
    assert known[:2, :2].tolist() == [[0.0, 0.0], [0.0, 0.0]]


def test_a_response_that_is_kept_is_half_as_well_known() -> None:
    axis = steady(100)
    known = axis._kalman.covariance[2:, 2:].copy()
    axis.begin_anew(3.0)
    assert axis._kalman.covariance[2:, 2:] == pytest.approx(4.0 * known, rel=1e-9)
    assert math.sqrt(axis._kalman.covariance[1, 1]) / ARCSEC == pytest.approx(20.0)


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_a_glitch_moves_an_axis_as_far_as_a_surprise_of_four_sigmas_does(sense: float) -> None:
    """It is believed with the variance by which it would be one."""
    for off_arcsec in (0.11, 0.13, 60.0):
        axis = certain()
        axis._kalman.covariance[0, 0] = (0.001 * ARCSEC) ** 2
        axis.measure(sense * off_arcsec * ARCSEC, 0.0)
        sigmas = min(4.0, off_arcsec / math.hypot(0.03, 0.001))
        assert axis.innovation_sigmas == pytest.approx(sense * sigmas, rel=1e-6)


@pytest.mark.parametrize("sense", [1.0, -1.0])
@pytest.mark.parametrize(
    ("rate_deg_s", "off_deg", "learnt_deg_s"),
    [(0.051, 0.001, 0.02), (-0.051, 0.004, 0.08), (0.051, 0.02, 0.1), (0.049, 0.001, 0.0)],
)
def test_a_second_large_surprise_to_one_side_is_a_rate_that_has_set_in(
    rate_deg_s: float, off_deg: float, learnt_deg_s: float, sense: float
) -> None:
    """Of as much as it takes in a turn, a tenth of a degree a second at most; near rest the axis sticks."""
    axis = certain()
    axis.advance(STEP_S, 0.0, moved(rate_deg_s))
    before = axis._kalman.covariance.copy()
    axis._surprised_deg = -sense * off_deg
    assert axis._sets_in(sense * off_deg, rate_deg_s) is False
    axis._surprised_deg = 0.0
    assert axis._sets_in(sense * off_deg, rate_deg_s) is False
    axis._surprised_deg = sense * 1e-5
    assert axis._sets_in(sense * off_deg, rate_deg_s) is True
    grown = axis._kalman.covariance - before
    assert grown[:2, :2] == pytest.approx(np.diag([off_deg**2, learnt_deg_s**2]), abs=1e-15)


@pytest.mark.parametrize(("rate_arcsec_s", "is_unlearnt"), [(41.0, True), (39.0, False), (-41.0, False)])
def test_near_rest_too_a_rate_that_no_axis_has_may_be_over(rate_arcsec_s: float, is_unlearnt: bool) -> None:
    """Surprises against a rate of 40″/s or more: what held the axis lets it go."""
    axis = certain()
    axis.advance(STEP_S, 0.0, moved(0.0))
    axis._kalman.state[1] = rate_arcsec_s * ARCSEC
    before = float(axis._kalman.covariance[1, 1])
    axis._surprised_deg = -1e-3
    assert axis._sets_in(-1e-3, 0.0) is True
    assert float(axis._kalman.covariance[1, 1]) - before == pytest.approx(0.02**2 if is_unlearnt else 0.0)


@pytest.mark.parametrize(
    ("rate_deg_s", "share"), [(0.0101, 0.01), (-0.0101, 0.01), (0.0099, 1.0), (0.0, 1.0)]
)
def test_no_less_than_the_usual_is_expected_of_an_axis_that_may_stick(
    rate_deg_s: float, share: float
) -> None:
    """A smooth one that moves by less than 0.01 °/s."""
    axis = certain()
    axis._rough_share = 0.01
    axis.advance(STEP_S, 0.0, moved(rate_deg_s))
    assert axis._kalman.covariance[1, 1] == pytest.approx(share * (0.5 * ARCSEC) ** 2 * STEP_S)


@pytest.mark.parametrize(("surprises", "begins"), [(9.4, False), (9.6, True)])
def test_a_filter_whose_squared_surprises_are_nine_in_the_mean_begins_anew(
    surprises: float, begins: bool
) -> None:
    """Of the twenty last: one that does not surprise takes a twentieth off."""
    axis = steady(60)
    axis._surprises = surprises
    go_on(axis, 1)
    assert axis.begun_anew == (1 if begins else 0)
    assert axis._disturbed is True


@pytest.mark.parametrize("off_deg", [0.01, -0.01])
@pytest.mark.parametrize("turns", [0.0, 360.0])
def test_a_filter_that_begins_anew_does_so_where_the_axis_is_seen(off_deg: float, turns: float) -> None:
    axis = steady(60)
    axis._surprises = 12.0
    axis.advance(STEP_S, 0.0, moved(0.3))
    expected_deg = axis.position_deg
    axis.measure((expected_deg + off_deg) % 360.0 - turns, 0.3)
    assert axis.begun_anew == 1
    assert axis.position_deg == pytest.approx(expected_deg + off_deg)


@pytest.mark.parametrize(("surprises", "disturbed"), [(4.1, False), (4.3, True)])
def test_a_motion_is_disturbed_from_a_mean_of_four_on(surprises: float, disturbed: bool) -> None:
    axis = steady(60)
    axis._surprises = surprises
    go_on(axis, 1)
    assert axis._disturbed is disturbed


def test_one_sample_counts_no_more_than_forty_in_the_mean_of_the_squared_surprises() -> None:
    axis = certain()
    axis.measure(1.0, 0.0)
    assert axis._surprises == pytest.approx(1.0 + (40.0 - 1.0) / 20.0)


def test_a_noise_of_readings_is_learnt_by_a_hundredth_each_within_bounds() -> None:
    """A twentieth of the expected sigma, or twenty times that."""
    for share, sigmas, learnt in (
        (1.0, 3.0, 1.0 + 0.01 * (9.0 - 1.0)),
        (1.0, 0.0, 1.0 - 0.01),
        (4.0, 6.0, 4.0 * (1.0 + 0.01 * (9.0 - 1.0))),
        (399.9, 60.0, 400.0),
        (0.002, 0.0, 0.002),
    ):
        axis = certain()
        axis._noise_share = share
        axis.measure(sigmas * 0.03 * ARCSEC, 0.0)
        assert axis._noise_share == pytest.approx(learnt)


@pytest.mark.parametrize(
    ("share", "before", "sigmas", "learnt"),
    [
        # By a twentieth of the product of two surprises in a row.
        (1.0, 1.0, 1.0, 1.05),
        (1.0, -1.0, -1.0, 1.05),
        (1.0, -1.0, 1.0, 0.95),
        (15.9, 3.0, 3.0, 16.0),
        (1e-4, -3.0, 3.0, 1e-4),
        # From a product of four on at once; up to what is usual.
        (0.01, 1.9, 2.0, 0.01 * (1.0 + 0.05 * 3.8)),
        (0.01, 2.5, 2.0, 0.05),
        (0.5, 2.5, 2.0, 1.0),
    ],
)
def test_a_motion_is_as_rough_as_surprises_in_a_row_go_to_one_side(
    share: float, before: float, sigmas: float, learnt: float
) -> None:
    """Of an axis that is hardly known, whose surprises tell nothing of its readings."""
    axis = certain()
    axis._rough_share, axis._last_ratio = share, before
    axis._square = 3.0
    axis._learn_noise(sigmas, 0.0)
    assert axis._rough_share == pytest.approx(learnt)
    assert axis._noise_share == 1.0


@pytest.mark.parametrize(
    ("one_sided", "measured", "may_stick", "learnt"),
    [
        (0.0, 0.0, False, 0.95),
        # As far as surprises are the motion's, and go to and fro.
        (0.0, 0.5, False, 0.975),
        (0.0, 1.0, False, 1.0),
        (0.25, 0.0, False, 0.975),
        (-0.25, 0.0, False, 0.95),
        (0.6, 0.0, False, 1.0),
        # Near rest less is expected than shows.
        (0.0, 0.0, True, 1.0),
    ],
)
def test_a_motion_without_surprises_is_smoother_than_expected(
    one_sided: float, measured: float, may_stick: bool, learnt: float
) -> None:
    """By a twentieth with each sample."""
    axis = certain()
    axis._square, axis._alike, axis._may_stick = 0.0, one_sided / 0.95, may_stick
    axis._learn_noise(0.0, measured)
    assert axis._rough_share == pytest.approx(learnt)


def test_what_has_acted_long_ago_is_forgotten_without_a_trace() -> None:
    """Steps that nothing answers any more: effects are those of the last of them alone."""
    dice = np.random.default_rng(3)
    steps = [Step(STEP_S * number, *dice.normal(0.0, 1.0, 2)) for number in range(700)]
    long, short = Commanded(-1.0), Commanded(steps[600].utc_s + BEFORE_S, *steps[600][1:])
    for step in steps:
        long.add(step)
        if step.utc_s > steps[600].utc_s:
            short.add(step)
    assert len(long._steps) < 300
    to_s = steps[-1].utc_s + STEP_S
    assert long.effects(to_s - 1.5, to_s) == pytest.approx(short.effects(to_s - 1.5, to_s), abs=1e-9)
