"""Who may say what to a run: control is one's at a time, a stop is anybody's."""

from __future__ import annotations

import pytest

from sattrack.runtime.control_arbiter import NAMED, ControlArbiter
from sattrack.views.messages import (
    Arm,
    ClearBias,
    Go,
    Jog,
    LeaveRunning,
    Nudge,
    ObservationMessage,
    OffsetBy,
    Pause,
    Search,
    StopNow,
    TakeControl,
    YieldControl,
)
from sattrack.views.run import STARTER

MOVING = [
    Nudge(along_s=0.1),
    ClearBias(),
    OffsetBy("along_s", "add", 0.1),
    Search("stop"),
    Pause(),
    Go(),
    Jog(dec_rate_deg_s=0.1),
    ObservationMessage("2026-10-02T13:05:24Z", 1.0, 2.0, "icrs", 5.0),
]


def arbiter(with_starter: bool = True, *names: str) -> ControlArbiter:
    made = ControlArbiter(with_starter)
    for number, name in enumerate(names, start=1):
        made.came(number, name)
    return made


@pytest.mark.parametrize("message", MOVING)
def test_the_starter_has_control_first_and_nobody_else_moves_the_target(message) -> None:
    before = arbiter(True, "anna")

    assert before.hear(STARTER, message) is message
    assert before.hear(1, message) is None


@pytest.mark.parametrize("message", MOVING)
def test_whoever_took_control_moves_the_target_and_who_had_it_no_more(message) -> None:
    before = arbiter(True, "anna", "ben")
    assert before.hear(1, TakeControl()) is None
    assert before.view().said == "anna took control from where it was started"

    assert before.hear(1, message) is message
    assert before.hear(STARTER, message) is None
    assert before.hear(2, message) is None
    assert before.view().controller == 1


def test_everybody_is_told_who_paused_the_run_and_had_it_go_on() -> None:
    before = arbiter(True, "anna")
    told = []
    for number, message in ((STARTER, Pause()), (1, Go()), (STARTER, Jog()), (STARTER, Go())):
        version = before.version
        before.hear(number, message)
        told.append(before.view().said if before.version != version else None)

    assert told == ["paused from where it was started", None, None, "set going from where it was started"]


def test_a_stop_is_obeyed_from_anybody_also_from_one_who_was_never_let_in() -> None:
    before = arbiter(True, "anna", "ben")
    before.hear(1, TakeControl())

    assert all(before.hear(number, StopNow()) == StopNow() for number in (STARTER, 1, 2, 77))
    assert before.view().said == "stopped from watcher 77"


def test_a_run_without_a_starter_is_nobodys_until_control_is_taken() -> None:
    before = arbiter(False, "anna")
    assert before.view().controller is None
    assert before.hear(STARTER, Nudge(along_s=1.0)) is None
    assert before.hear(1, Nudge(along_s=1.0)) is None

    before.hear(1, TakeControl())
    assert before.hear(1, Nudge(along_s=1.0)) == Nudge(along_s=1.0)


def test_control_that_is_given_up_or_left_behind_goes_back_to_the_starter() -> None:
    before = arbiter(True, "anna", "ben")
    before.hear(1, TakeControl())
    before.hear(1, YieldControl())
    assert before.hear(STARTER, Nudge(along_s=1.0)) == Nudge(along_s=1.0)
    before.hear(2, TakeControl())
    before.gone(2)
    assert before.view().controller == STARTER
    before.hear(STARTER, YieldControl())
    assert before.view().controller is None


def test_where_nobody_started_it_here_control_that_is_left_is_nobodys() -> None:
    before = arbiter(False, "anna", "ben")
    before.hear(1, TakeControl())
    before.hear(2, YieldControl())
    assert before.view().controller == 1, "only one's own can be given up"
    before.hear(1, YieldControl())
    assert before.view().controller is None

    before.hear(2, TakeControl())
    before.gone(2)
    assert before.view().controller is None
    assert before.view().said == "ben had control, and has gone"
    assert before.view().watching == 1


def test_only_the_starter_leaves_a_run_running() -> None:
    before = arbiter(True, "anna")
    before.hear(1, LeaveRunning())
    assert not before.left_running
    assert before.view().controller == STARTER

    before.hear(STARTER, LeaveRunning())
    assert before.left_running
    assert before.view().controller is None


def test_a_run_left_running_stays_with_whoever_has_control() -> None:
    before = arbiter(True, "anna")
    before.hear(1, TakeControl())
    before.hear(STARTER, LeaveRunning())

    assert before.view().controller == 1


def test_a_view_names_a_bounded_number_and_always_whoever_has_control() -> None:
    before = arbiter(False, *(f"w{number}" for number in range(1, 60)))
    before.hear(59, TakeControl())
    view = before.view()

    assert len(view.watchers) == NAMED
    assert view.name_of(59) == "w59"
    assert view.watching == 59


def test_a_pass_armed_while_the_run_ends_for_another_does_not_come_before_it() -> None:
    before = ControlArbiter(True, takes_others=True)
    assert before.hear(STARTER, Arm(3, 3000.0, "third")) is None
    assert before.hear(STARTER, Arm(2, 2000.0, "now", now=True)) == StopNow()
    assert before.hear(STARTER, Arm(1, 1000.0, "earlier")) is None

    taken = [before.take_next() for _ in range(4)]
    assert [None if one is None else one.name for one in taken] == ["now", "earlier", "third", None]
