"""A mount's clock that goes in steps, beside one that does not: loops, delays and clocks are made here."""

from __future__ import annotations

import math
import random

import numpy as np
import pytest

from sattrack.control.latency import SIDEREAL_SECONDS_PER_SECOND, MountClock, SteppedClock, TurnLine

BEGIN_S = 1_790_000_000.0
DELAY_S = 0.003


def dated(
    period_s: float,
    step_s: float,
    jitter_s: float,
    uneven_s: float = 0.0,
    turns: int = 1200,
    delay_s: float = DELAY_S,
) -> tuple[SteppedClock, list[float]]:
    """Return the clock after so many turns, and by how much the last 600 were dated late, seconds."""
    rng, clock, off = random.Random(5), SteppedClock(0.05), []
    for number in range(turns):
        true_s = 0.0071 + number * period_s + rng.uniform(-0.5, 0.5) * uneven_s
        shown_s = math.floor(true_s / step_s) * step_s if step_s else true_s
        arrival_s = true_s + delay_s + rng.uniform(0.0, jitter_s)
        if rng.random() < 0.02:
            continue
        found_s = clock.date(number + 7, BEGIN_S + shown_s, BEGIN_S + arrival_s)
        if number >= turns - 600:
            off.append(found_s - BEGIN_S - true_s)
    return clock, off


@pytest.mark.parametrize("period_s", [0.05001, 0.0507, 0.0489])
@pytest.mark.parametrize("jitter_s", [0.0, 0.01])
def test_coarse_steps_are_found_and_averaged(period_s: float, jitter_s: float) -> None:
    step_s = 0.015625
    clock, off = dated(period_s, step_s, jitter_s)
    assert clock.coarse
    assert clock.step_s == pytest.approx(step_s, rel=0.1)
    # As shown, dates are half a step early in the mean, and up to a whole one.
    assert max(abs(s) for s in off) < 0.003
    assert abs(math.fsum(off) / len(off)) < 0.0005


def test_coarse_steps_are_found_of_a_mount_that_is_far_away() -> None:
    """Its statuses take a quarter of a second; how evenly is what counts."""
    clock, off = dated(0.0507, 0.015625, 0.005, delay_s=0.25)
    assert clock.coarse
    assert max(abs(s) for s in off) < 0.003


@pytest.mark.parametrize(("step_s", "coarse"), [(0.0004, False), (0.0008, True)])
def test_steps_whose_dates_scatter_by_less_than_150_microseconds_are_fine(
    step_s: float, coarse: bool
) -> None:
    """The sigma of what lies evenly within a step is the step over √12: 0.115 ms and 0.231 ms."""
    clock, off = dated(0.050713, step_s, 0.0)
    assert clock.coarse is coarse
    assert clock.step_s == pytest.approx(step_s, rel=0.1)
    assert max(off) - min(off) == pytest.approx(0.0 if coarse else step_s, abs=0.2 * step_s)


def test_within_the_first_five_seconds_a_step_is_that_of_all_dates_about_the_line() -> None:
    """Each about the line through those before it; the variance is numpy's."""
    clock, line, off_s = SteppedClock(0.05), TurnLine(0.05), []
    for number in range(100):
        true_s = 0.0507 * number
        shown_s = BEGIN_S + math.floor(true_s / 0.015625) * 0.015625
        if number:
            line.advance(number)
            off_s.append(shown_s - line.utc_s)
            line.note(shown_s)
            clock.date(number, shown_s, BEGIN_S + true_s)
            assert clock.step_s == pytest.approx(math.sqrt(12.0 * float(np.var(off_s))), rel=1e-6, abs=1e-12)
        else:
            line.begin(number, shown_s)
            clock.date(number, shown_s, BEGIN_S + true_s)
            assert clock.step_s == 0.0


@pytest.mark.parametrize("counted", [True, False])
def test_statuses_of_a_clock_in_steps_are_dated_by_their_count(counted: bool) -> None:
    """By sixteenths of a second of sidereal time, and turns of 50.7 ms."""
    clock, off = MountClock(status_delay_s=DELAY_S), []
    for number in range(1200):
        true_s = 0.0071 + number * 0.0507
        shown_h = math.floor(16.0 * true_s) / 16.0 * SIDEREAL_SECONDS_PER_SECOND / 3600.0
        found_s = clock.date(shown_h, BEGIN_S + true_s + DELAY_S, number + 7 if counted else None)
        if number >= 600:
            off.append(found_s - BEGIN_S - true_s)
    assert clock.coarse_step_s == (pytest.approx(1.0 / 16.0, rel=0.1) if counted else None)
    assert (max(off) - min(off) < 0.01) == counted


@pytest.mark.parametrize("step_s", [0.01, 0.02])
def test_a_turn_that_is_late_or_left_out_moves_no_other_date(step_s: float) -> None:
    """A turn at 25 s is 45 ms late; from 35 s on the loop is a turn behind its count."""
    rng, clock, off = random.Random(3), SteppedClock(0.05), []
    for number in range(1200):
        late_s = 0.045 if number == 500 else 0.05 if number >= 700 else 0.0
        true_s = 0.0501 * number + rng.uniform(0.0, 0.0005) + late_s
        shown_s = math.floor(true_s / step_s) * step_s
        arrival_s = true_s + DELAY_S + rng.uniform(0.0, 0.001)
        off.append(abs(clock.date(number, BEGIN_S + shown_s, BEGIN_S + arrival_s) - BEGIN_S - true_s))
    assert clock.coarse
    assert max(off) < 1.01 * step_s
    assert max(off[400:500] + off[501:700]) < 0.2 * step_s
    assert max(off[705:]) < 0.6 * step_s
    assert np.mean(off[705:]) < 0.15 * step_s


class Swinging:
    """A clock that dates turns 1 ms early and late in turn, and statuses that arrive with a part of that."""

    def __init__(self) -> None:
        self.clock, self.turns = SteppedClock(0.05), 0

    def go_on(self, turns: int, shared: float, varies_s: float = 0.0) -> bool:
        """Have the arrivals share so much of what a date is off, and vary; tell whether it is coarse."""
        for number in range(self.turns, self.turns + turns):
            true_s = BEGIN_S + 0.05 * number
            off_s = 0.001 if number % 2 else -0.001
            varies = varies_s if number // 2 % 2 else -varies_s
            arrival_s = true_s + DELAY_S + (1.0 - shared) * off_s + varies
            self.clock.date(number, true_s + off_s, arrival_s)
        self.turns += turns
        return self.clock.coarse


def test_a_clock_is_coarse_where_arrivals_share_three_fifths_until_they_share_three_tenths() -> None:
    """Of what a date is off the line through the turns."""
    assert Swinging().go_on(400, 0.55) is False
    one = Swinging()
    assert one.go_on(400, 0.65) is True
    assert one.go_on(600, 0.35) is True
    assert one.go_on(600, 0.25) is False
    assert one.go_on(600, 0.55) is False


@pytest.mark.parametrize(("varies_s", "coarse"), [(0.00175, True), (0.0024, False)])
def test_delays_that_vary_by_more_than_twice_the_steps_say_nothing(varies_s: float, coarse: bool) -> None:
    """The share is known to 0.15 where the delays' variance is 4.5 times that of the dates, or less.

    Theirs is that of what they share, 1 ms, and of what they vary by.
    """
    assert Swinging().go_on(600, 1.0, varies_s) is coarse


def test_a_clock_is_called_coarse_once_120_turns_were_seen() -> None:
    one = Swinging()
    assert one.go_on(120, 1.0) is False
    assert one.go_on(1, 1.0) is True


@pytest.mark.parametrize("sense", [1.0, -1.0])
@pytest.mark.parametrize(("off_s", "anew"), [(0.09, False), (0.11, True)])
def test_a_date_a_tenth_of_a_second_off_is_of_a_loop_that_stood_still_or_a_clock_that_was_set(
    off_s: float, anew: bool, sense: float
) -> None:
    one = Swinging()
    assert one.go_on(200, 1.0) is True
    there_s = BEGIN_S + 0.05 * 200 + sense * off_s
    assert one.clock.date(200, there_s, there_s) == there_s
    assert one.clock.coarse is not anew
    assert (one.clock.step_s == 0.0) is anew


@pytest.mark.parametrize("late_s", [0.02, -0.02])
def test_five_turns_in_a_row_off_the_line_move_it_and_four_do_not(late_s: float) -> None:
    """Five are of a loop that goes on at other instants."""

    def dated_off_s(one: Swinging, off_s: float) -> float:
        """Have one more turn come so much off; return by how much it is dated wrongly."""
        number, one.turns = one.turns, one.turns + 1
        true_s = BEGIN_S + 0.05 * number + off_s
        shown_s = true_s + (0.001 if number % 2 else -0.001)
        return one.clock.date(number, shown_s, true_s + DELAY_S) - true_s

    returns, moves = Swinging(), Swinging()
    for one in (returns, moves):
        assert one.go_on(400, 1.0) is True
    # The clock shows the beginning of a step of 3.5 ms, and a turn comes half of that later.
    usual_s = 0.5 * returns.clock.step_s
    for _ in range(4):
        assert dated_off_s(returns, 0.0) == pytest.approx(usual_s, abs=2e-4)
        for _ in range(4):
            dated_off_s(returns, late_s)
    # By as much again at once, too.
    for turns_late in (1, 2):
        for _ in range(5):
            dated_off_s(moves, turns_late * late_s)
    for _ in range(4):
        assert dated_off_s(moves, 2.0 * late_s) == pytest.approx(usual_s, abs=5e-4)


def test_nothing_is_called_coarse_within_the_first_six_seconds() -> None:
    for turns, coarse in ((110, False), (400, True)):
        clock, _ = dated(0.0507, 0.015625, 0.0, turns=turns)
        assert clock.coarse is coarse


@pytest.mark.parametrize("jitter_s", [0.0005, 0.01])
@pytest.mark.parametrize("uneven_s", [0.0, 0.0005, 0.02])
def test_a_fine_clock_is_believed_to_the_last_bit(jitter_s: float, uneven_s: float) -> None:
    clock, off = dated(0.05, 0.0, jitter_s, uneven_s)
    assert not clock.coarse
    assert max(abs(s) for s in off) < 1e-6


def test_a_loop_that_runs_by_the_same_coarse_timer_is_dated_rightly_by_its_clock() -> None:
    """As a Windows timer makes it: turns come at the clock's own steps."""
    rng, clock, worst_s = random.Random(2), SteppedClock(0.05), 0.0
    step_s = 1.0 / 64.0
    for number in range(1200):
        true_s = math.ceil(number * 0.05 / step_s) * step_s
        found_s = clock.date(number, BEGIN_S + true_s, BEGIN_S + true_s + DELAY_S + rng.uniform(0.0, 0.01))
        worst_s = max(worst_s, abs(found_s - BEGIN_S - true_s))
    assert worst_s < 1e-6


def test_a_loop_that_stood_still_is_learnt_anew() -> None:
    clock = SteppedClock(0.05)
    for number in range(300):
        shown_s = math.floor(number * 0.0507 / 0.015625) * 0.015625
        clock.date(number, BEGIN_S + shown_s, BEGIN_S + number * 0.0507)
    assert clock.coarse
    stood_s = BEGIN_S + 300 * 0.0507 + 4.0
    assert clock.date(300, stood_s, stood_s) == stood_s
    assert not clock.coarse
