"""Which rate acts when, by hand-made timelines."""

from __future__ import annotations

import pytest

from sattrack.control.history import CommandHistory, SentRates
from sattrack.control.mount_loop import MountLoop


def history(*sent: tuple[float, float]) -> CommandHistory:
    loop = MountLoop(0.050)
    loop.note(7, 1.020)
    made = CommandHistory(delay_s=0.010, loop=loop)
    for at, rate in sent:
        made.add(SentRates(at, rate, -rate))
    return made


def test_a_command_acts_from_the_first_loop_after_it_arrived() -> None:
    made = history((1.000, 1.0), (1.050, 2.0))
    assert made.acting(1.009).ra_rate_deg_s == 0.0
    assert made.acting(1.010).ra_rate_deg_s == 1.0
    assert made.acting(1.059).ra_rate_deg_s == 1.0
    assert made.acting(1.060).ra_rate_deg_s == 2.0


def test_displacement_over_several_loops() -> None:
    made = history((1.000, 1.0), (1.050, 2.0), (1.100, 4.0))
    # Loops of the mount at 1.020, 1.070, 1.120: rates 1, 2, 4, the last for 30 ms.
    assert made.displacement(1.020, 1.150) == pytest.approx((0.050 + 0.100 + 0.120, -0.270))


def test_a_loop_that_comes_late_or_early_is_no_further_loop() -> None:
    made = history((1.000, 1.0), (1.050, 2.0))
    assert made.displacement(1.020, 1.074) == pytest.approx((0.054, -0.054))
    assert made.displacement(1.020, 1.066) == pytest.approx((0.046, -0.046))


def test_what_another_command_would_have_done_is_told_for_one_turn() -> None:
    made = history((1.000, 1.0), (1.050, 2.0), (1.100, 4.0))
    assert made.is_one_turn(1.070, 1.120)
    assert not made.is_one_turn(1.070, 1.170)
    assert made.displacement_by(-1, 1.070, 1.120) == pytest.approx((0.05, -0.05))
    assert made.displacement_by(1, 1.070, 1.120) == pytest.approx((0.20, -0.20))
    assert made.displacement_by(-2, 1.070, 1.120) is None
    assert made.displacement_by(2, 1.070, 1.120) is None


def test_nothing_sent_moves_nothing() -> None:
    assert history().displacement(5.0, 6.0) == (0.0, 0.0)
