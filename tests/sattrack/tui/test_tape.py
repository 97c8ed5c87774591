"""The tape of a recording without a screen: what it hands out when, by hand-counted instants."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from tui_builders import UTC_S, changed

from sattrack.tui.replay_app import FASTEST, LONGEST_PAUSE_S, SLOWEST, SPEEDS, Tape

if TYPE_CHECKING:
    from sattrack.views.run import TrackView


def views(*seconds: float) -> list[TrackView]:
    return [changed(utc_s=UTC_S + s) for s in seconds]


def tape_of(*seconds: float, speed: float = 1.0) -> Tape:
    tape = Tape("pass.mcap", speed)
    tape.add(views(*seconds))
    return tape


def due(tape: Tape) -> list[float]:
    """Return the instants handed out, seconds from UTC_S."""
    return [round(view.utc_s - UTC_S, 6) for view in tape.next().views]


def test_each_view_is_shown_once_when_it_is_due() -> None:
    tape = tape_of(0.0, 0.1, 0.2, 0.3, 1.0)
    assert due(tape) == [0.0]
    assert due(tape) == []
    tape.run(0.1)
    assert due(tape) == [0.1]
    tape.run(0.25)
    assert due(tape) == [0.2, 0.3]
    tape.run(10.0)
    assert due(tape) == [1.0]
    assert not tape.view.ended, "more may come"
    tape.whole = True
    assert tape.view.ended


@pytest.mark.parametrize(("speed", "shown"), [(0.5, [0, 1]), (1.0, [0, 1, 2]), (2.0, [0, 1, 2, 3, 4])])
def test_two_seconds_on_the_clock_are_so_many_of_the_run(speed: float, shown: list[int]) -> None:
    tape = tape_of(*range(20), speed=speed)
    tape.run(2.0)
    assert due(tape) == shown


def test_paused_it_stands_still_and_goes_on_from_there() -> None:
    tape = tape_of(*range(20))
    tape.run(2.0)
    tape.pause()
    tape.run(5.0)
    assert due(tape) == [0, 1, 2]
    tape.pause()
    tape.run(1.0)
    assert due(tape) == [3]


def test_a_jump_hands_out_what_a_plot_of_the_last_three_minutes_needs() -> None:
    tape = tape_of(*range(0, 600, 4))
    tape.next()
    tape.seek(400.0)
    shown = tape.next()
    assert shown.rewound
    assert [view.utc_s - UTC_S for view in shown.views] == pytest.approx(list(range(224, 401, 4)))
    assert not tape.next().rewound
    tape.wind(-390.0)
    assert due(tape) == [0, 4, 8]
    tape.wind(-100.0)
    assert due(tape) == [0]
    tape.wind(1e9)
    assert tape.view.at_s == tape.length_s == 596.0


def test_steps_go_from_view_to_view_and_stand_still() -> None:
    tape = tape_of(0.0, 0.1, 0.25, 0.3)
    tape.next()
    seen = []
    for by in (1, 1, 1, 1, -1, -1, -1, -1):
        tape.step(by)
        tape.run(9.0)
        seen.append(tape.next().views[-1].utc_s - UTC_S)
    assert seen == pytest.approx([0.1, 0.25, 0.3, 0.3, 0.25, 0.1, 0.0, 0.0], abs=1e-6)
    assert not tape.playing


def test_speeds_go_in_steps_and_end_at_both_ends() -> None:
    tape = Tape("x", 3.0)
    seen = []
    for by in (-1, 1, 1, *[1] * 9, *[-1] * 20):
        tape.change_speed(by)
        seen.append(tape.speed)
    assert seen[:4] == [2.0, 5.0, 10.0, 20.0]
    assert max(seen) == FASTEST == 100.0
    assert seen[-1] == SLOWEST == 0.1
    assert set(seen) <= set(SPEEDS)
    assert Tape("x", 1000.0).speed == FASTEST


def test_a_clock_set_back_or_a_gap_is_no_reason_to_wait() -> None:
    tape = tape_of(0.0, 1.0, -500.0, -499.0, 9000.0)
    assert tape.length_s == pytest.approx(1.0 + 0.0 + 1.0 + LONGEST_PAUSE_S)
    tape.run(2.0)
    assert due(tape) == [0.0, 1.0, -500.0, -499.0]


def test_at_its_end_it_begins_anew() -> None:
    tape = tape_of(0.0, 1.0)
    tape.whole = True
    tape.run(5.0)
    assert due(tape) == [0.0, 1.0]
    tape.pause()
    assert tape.playing
    shown = tape.next()
    assert shown.rewound
    assert [view.utc_s for view in shown.views] == [UTC_S]


def test_what_is_still_being_read_is_awaited_and_an_empty_tape_does_nothing() -> None:
    tape = Tape("x")
    for act in (tape.pause, lambda: tape.step(1), lambda: tape.wind(5.0), lambda: tape.run(1.0)):
        act()
        assert tape.next().views == ()
    tape = tape_of(0.0, 0.1)
    tape.run(50.0)
    assert due(tape) == [0.0, 0.1]
    tape.add(views(0.2, 0.3))
    tape.run(0.1)
    assert due(tape) == [0.2]
