"""Which rate acts when, by hand-made timelines."""

from __future__ import annotations

import math

import pytest

from sattrack.control.axes import CommandHistory, MountLoop, SentRates


def history(*sent: tuple[float, float], delay_s: float = 0.010) -> CommandHistory:
    loop = MountLoop(0.050)
    loop.note(7, 1.020)
    made = CommandHistory(delay_s=delay_s, loop=loop)
    for at, rate in sent:
        made.add(SentRates(at, rate, -rate))
    return made


def steps(made: CommandHistory, from_utc_s: float, to_utc_s: float) -> list[tuple[float, float, float]]:
    return [pytest.approx(tuple(step)) for step in made.steps(from_utc_s, to_utc_s)]


def test_a_command_acts_from_the_first_loop_after_it_arrived() -> None:
    made = history((1.000, 1.0), (1.050, 2.0))
    assert made.acting(1.009).ra_rate_deg_s == 0.0
    assert made.acting(1.010).ra_rate_deg_s == 1.0
    assert made.acting(1.059).ra_rate_deg_s == 1.0
    assert made.acting(1.060).ra_rate_deg_s == 2.0


def test_steps_over_several_loops() -> None:
    made = history((1.000, 1.0), (1.050, 2.0), (1.100, 4.0))
    # Loops of the mount at 1.020, 1.070, 1.120.
    assert steps(made, 1.020, 1.150) == [(1.020, 1.0, -1.0), (1.070, 2.0, -2.0), (1.120, 4.0, -4.0)]


def test_a_loop_that_comes_late_or_early_is_no_further_loop() -> None:
    made = history((1.000, 1.0), (1.050, 2.0))
    assert steps(made, 1.020, 1.074) == [(1.020, 1.0, -1.0)]
    assert steps(made, 1.020, 1.066) == [(1.020, 1.0, -1.0)]


def test_another_command_is_told_for_one_turn() -> None:
    made = history((1.000, 1.0), (1.050, 2.0), (1.100, 4.0))
    assert made.other(-1, 1.070) == SentRates(1.000, 1.0, -1.0)
    assert made.other(1, 1.070) == SentRates(1.100, 4.0, -4.0)
    assert made.other(-2, 1.070) is None
    assert made.other(2, 1.070) is None


def test_nothing_sent_moves_nothing() -> None:
    made = history().steps(5.020, 6.020)
    assert len(made) == 20
    assert {step[1:] for step in made} == {(0.0, 0.0)}


def test_what_was_sent_is_forgotten_of_a_mount_that_is_on_its_own_again() -> None:
    made = history((1.000, 1.0), (1.050, 2.0))
    made.clear()
    assert made.acting(1.070).ra_rate_deg_s == 0.0
    made.add(SentRates(1.100, 3.0, 4.0))
    assert steps(made, 1.070, 1.170) == [(1.070, 0.0, 0.0), (1.120, 3.0, 4.0)]


def test_the_delay_changes_within_45_ms_of_the_profiles() -> None:
    made, short = history(delay_s=0.050), history(delay_s=0.010)
    assert made.change_delay(0.006)
    assert made.delay_s == pytest.approx(0.056)
    assert made.acting(1.060, longer_s=-0.006) == made.acting(1.066)
    for by_s in (0.02, -0.02):
        for _ in range(10):
            made.change_delay(by_s)
            short.change_delay(by_s)
        assert not made.change_delay(by_s)
        assert made.delay_s == pytest.approx(0.050 + math.copysign(0.045, by_s))
    # It is against the instants of samples: of those that are dated too early, it is less than nothing.
    assert short.delay_s == pytest.approx(0.010 - 0.045)
