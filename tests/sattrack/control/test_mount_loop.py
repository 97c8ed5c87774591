"""The mount's loop foretold, with timers made here."""

from __future__ import annotations

import math
import random

import numpy as np
import pytest

from sattrack.control.axes import MountLoop

GRAIN_S = 1.0 / 64.0


def windows_timer(count: int, phase_s: float, seed: int) -> list[float]:
    """Instants of a timer that is due every 50 ms and fires at the next of 64 marks a second, and late."""
    rng = random.Random(seed)
    marks = (math.ceil((0.05 * k - phase_s) / GRAIN_S) for k in range(count))
    return [100.0 + phase_s + mark * GRAIN_S + rng.uniform(0.0, 0.001) for mark in marks]


@pytest.mark.parametrize("seed", range(10))
def test_turns_of_a_coarse_timer_are_foretold_without_a_bias(seed: int) -> None:
    instants = windows_timer(1200, 0.0016 * seed, seed)
    loop = MountLoop(0.05)
    off = []
    for number, instant in enumerate(instants[:-1]):
        loop.note(number, instant)
        if number > 300:
            off.append(instants[number + 1] - loop.turn_utc_s(number + 1))
    assert abs(sum(off) / len(off)) < 0.0005
    assert max(abs(x) for x in off) < GRAIN_S


@pytest.mark.parametrize("seed", range(10))
def test_the_mean_of_a_coarse_timers_turns_does_not_wander(seed: int) -> None:
    """As it would by half of a mark, if the period were taken from the first turn and the last."""
    instants = windows_timer(1200, 0.0016 * seed, seed)
    loop = MountLoop(0.05)
    off = []
    for number, instant in enumerate(instants):
        loop.note(number, instant)
        if number > 300:
            off.append(loop.turn_utc_s(number) - 0.05 * number)
    assert max(off) - min(off) < 0.001


@pytest.mark.parametrize("turns", [150, 250, 1000, 30_000])
def test_turns_are_foretold_by_the_line_of_least_squares_through_the_last_200(turns: int) -> None:
    rng, loop, count, noted = random.Random(turns), MountLoop(0.05), 7, []
    for _ in range(turns):
        count += 1 + (rng.random() < 0.1)
        noted.append((count, 1.79e9 + 0.0547 * count + rng.uniform(0.0, 0.004)))
        loop.note(*noted[-1])
    counts, instants = np.array(noted[-200:]).T
    line = np.polynomial.Polynomial.fit(counts - count, instants - instants[-1], 1).convert()
    assert loop.mean_period_s == pytest.approx(line.coef[1], abs=1e-9)
    assert loop.turn_utc_s(count + 20) - instants[-1] == pytest.approx(line(20), abs=2e-6)


def test_lost_statuses_and_a_wrong_nominal_period_do_not_matter() -> None:
    rng = random.Random(5)
    loop = MountLoop(0.05)
    for number in range(400):
        if rng.random() < 0.7:
            loop.note(number, 50.0 + 0.0525 * number)
    assert loop.turn_utc_s(410) == pytest.approx(50.0 + 0.0525 * 410, abs=1e-9)
    assert loop.first_from(50.0 + 0.0525 * 405.2) == pytest.approx(50.0 + 0.0525 * 406, abs=1e-9)
    assert loop.first_from(50.0 + 0.0525 * 405) == pytest.approx(50.0 + 0.0525 * 405, abs=1e-9)


def test_a_loop_that_stood_still_or_began_anew_is_learnt_anew() -> None:
    loop = MountLoop(0.05)
    for number in range(100):
        loop.note(number, 0.05 * number)
    loop.note(100, 9.0)
    assert loop.turn_utc_s(101) == pytest.approx(9.05)
    loop.note(1, 20.0)
    assert loop.turn_utc_s(2) == pytest.approx(20.05)


@pytest.mark.parametrize("later_s", [0.05, 0.035, 0.012, -0.012])
@pytest.mark.parametrize("late_s", [0.0, 0.02])
def test_a_loop_that_left_a_turn_out_or_goes_on_at_other_instants_is_foretold_soon(
    later_s: float, late_s: float
) -> None:
    """The mean of the turns before says nothing of those after it."""
    rng = random.Random(3)
    loop = MountLoop(0.05)
    for number in range(400):
        loop.note(number, 0.0501 * number + rng.uniform(0.0, 0.001))
    loop.note(400, 0.0501 * 400 + later_s + late_s)
    for number in range(401, 406):
        loop.note(number, 0.0501 * number + later_s + rng.uniform(0.0, 0.001))
    for number in range(406, 700):
        assert loop.turn_utc_s(number) == pytest.approx(0.0501 * number + later_s, abs=0.0025)
        loop.note(number, 0.0501 * number + later_s + rng.uniform(0.0, 0.001))


def even(turns: int) -> MountLoop:
    """Return a loop of which so many turns were seen, every 50 ms to the last bit."""
    loop = MountLoop(0.05)
    for number in range(turns):
        loop.note(number, 0.05 * number)
    return loop


def is_counted(loop: MountLoop, number: int, off_s: float) -> bool:
    """Tell whether a turn that is so far from where it was predicted moves those that are predicted next."""
    before_s = loop.turn_utc_s(number + 1)
    loop.note(number, loop.turn_utc_s(number) + off_s)
    return loop.turn_utc_s(number + 1) != pytest.approx(before_s, abs=1e-9)


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_a_turn_off_beyond_the_usual_is_left_out_of_the_mean(sense: float) -> None:
    """Of five milliseconds at least, and of four sigmas: here those of turns 2 ms to either side."""
    assert is_counted(even(100), 100, sense * 0.0049)
    assert not is_counted(even(100), 100, sense * 0.0051)
    for off_s, counted in ((0.0076, True), (0.0086, False)):
        loop = MountLoop(0.05)
        for number in range(400):
            loop.note(number, 0.05 * number + 0.002 * (-1.0) ** (number % 199))
        assert is_counted(loop, 400, sense * off_s) is counted
    # What is usual is not known before there are twenty.
    assert is_counted(even(19), 19, sense * 0.03)
    assert not is_counted(even(20), 20, sense * 0.03)


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_a_turn_a_fifth_of_a_second_off_begins_another_loop(sense: float) -> None:
    for off_s, begins in ((0.19, False), (0.21, True)):
        loop = even(100)
        loop.note(100, 5.0 + sense * off_s)
        assert loop.turn_utc_s(101) == pytest.approx(5.05 + (sense * off_s if begins else 0.0), abs=1e-9)


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_five_turns_in_a_row_that_are_off_to_one_side_begin_the_mean_anew(sense: float) -> None:
    loop = even(100)
    for number in range(100, 105):
        assert loop.turn_utc_s(110) == pytest.approx(5.5, abs=1e-9)
        loop.note(number, 0.05 * number + sense * 0.03)
    assert loop.turn_utc_s(110) == pytest.approx(5.5 + sense * 0.03, abs=1e-9)
    # Their mean, but for the first: that was late itself where the loop was held up.
    uneven = even(100)
    for number, off_s in zip(range(100, 105), (0.04, 0.031, 0.029, 0.033, 0.027), strict=True):
        uneven.note(number, 0.05 * number + sense * off_s)
    assert uneven.turn_utc_s(110) == pytest.approx(5.5 + sense * 0.03, abs=1e-9)
    # Not those that are off to both sides, or that have one between them where it should be.
    swings, returns = even(100), even(100)
    for number in range(100, 140):
        swings.note(number, 0.05 * number + sense * 0.03 * (-1.0) ** number)
        returns.note(number, 0.05 * number + (sense * 0.03 if number % 5 else 0.0))
    for loop in (swings, returns):
        assert loop.turn_utc_s(150) == pytest.approx(7.5, abs=1e-9)


def test_the_mean_is_that_of_the_last_two_hundred_turns() -> None:
    """The first of them is 4 ms late."""
    loop = MountLoop(0.05)
    loop.note(0, 0.004)
    for number in range(1, 200):
        loop.note(number, 0.05 * number)
        assert loop.turn_utc_s(300) != pytest.approx(15.0, abs=1e-6)
    loop.note(200, 10.0)
    assert loop.turn_utc_s(300) == pytest.approx(15.0, abs=1e-9)


def test_a_period_is_measured_over_twenty_turns_and_more() -> None:
    loop = MountLoop(0.05)
    for number in range(40):
        loop.note(number + 7, 0.0525 * number)
        assert loop.mean_period_s == pytest.approx(0.0525 if number >= 20 else 0.05)


def test_a_turn_that_was_late_says_nothing_of_the_next() -> None:
    loop = MountLoop(0.05)
    for number in range(100):
        loop.note(number, 0.05 * number + (0.03 if number in {60, 61, 80, 99} else 0.0))
    assert loop.turn_utc_s(100) == pytest.approx(5.0, abs=1e-9)


@pytest.mark.parametrize("seed", range(4))
def test_a_turn_of_a_coarse_timer_that_was_left_out_is_made_up_for(seed: int) -> None:
    instants = windows_timer(600, 0.0016 * seed, seed)
    loop = MountLoop(0.05)
    for number, instant in enumerate(instants[:300] + instants[301:311]):
        loop.note(number, instant)
    off = []
    for number, instant in enumerate(instants[311:], start=310):
        off.append(instant - loop.turn_utc_s(number))
        loop.note(number, instant)
    assert max(abs(x) for x in off) < GRAIN_S
    assert abs(sum(off) / len(off)) < 0.0025


def test_sending_falls_into_step_halfway_between_turns() -> None:
    loop = MountLoop(0.05)
    for number in range(100):
        loop.note(number, 0.05 * number)
    for arrival in (5.001, 5.024, 5.026, 5.049):
        shifted = (arrival + loop.shift_s(arrival)) % 0.05
        assert shifted == pytest.approx(0.025, abs=1e-9)
        assert abs(loop.shift_s(arrival)) <= 0.0251
        early = (arrival + loop.shift_s(arrival, early_s=0.01)) % 0.05
        assert early == pytest.approx(0.04, abs=1e-9)
        assert abs(loop.shift_s(arrival, early_s=0.01)) <= 0.0251


@pytest.mark.parametrize(
    ("arrival_s", "shift_s"),
    [(5.001, 0.0002), (5.020, 0.0001), (5.025, 0.0), (5.030, -0.0001), (5.049, -0.0002)],
)
def test_sending_falls_into_step_slowly(arrival_s: float, shift_s: float) -> None:
    """By a fiftieth of what is left, and by no more than 0.2 ms; where no turn was seen yet, not at all."""
    loop = MountLoop(0.05)
    assert loop.send_shift_s(arrival_s) == 0.0
    for number in range(100):
        loop.note(number, 0.05 * number)
    assert loop.send_shift_s(arrival_s) == pytest.approx(shift_s, abs=1e-9)
    assert loop.send_shift_s(arrival_s, 1.0, 1.0) == pytest.approx(5.025 - arrival_s, abs=1e-9)


def test_turns_whose_count_means_something_else_are_foretold_by_the_nominal_period() -> None:
    """A count that goes up by two each turn; one that is off by a third is believed."""
    for period_s, believed_s in ((0.024, 0.05), (0.0333, 0.0333), (0.0667, 0.0667), (0.076, 0.05)):
        loop = MountLoop(0.05)
        for number in range(60):
            loop.note(number, period_s * number)
        assert loop.mean_period_s == pytest.approx(believed_s)
