"""The runner of a schedule as a table: in a state, at an event, on a condition: what to do, the next state.

Pure: `step` makes of what is known and what happened what is known then and what to do. Whoever drives it
keeps every event before he acts on what follows from it; the same events give the same again, which is how a
run is taken up after its end at any instant. Instants are POSIX seconds of UTC.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from msgspec.structs import replace

from sattrack.schedule import conditions as on
from sattrack.schedule import steps as do
from sattrack.schedule.night import (
    ClockSet,
    Doing,
    Due,
    Followed,
    Happening,
    Laid,
    NotPlanned,
    Planned,
    Prepared,
    Reread,
    Run,
    Started,
    State,
    StepDone,
    StopAsked,
    SummedUp,
    WeatherTold,
    first_night,
    recovered_night,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    Judge = Callable[[Run, Happening], bool]
    Change = Callable[[Run, Happening], tuple[Run, Doing]]

MOST_NOTES = 12


class Row(NamedTuple):
    """One row: the first of a state and an event whose condition holds is taken."""

    state: State
    event: type[Happening]
    condition: Judge
    action: Change
    next_state: State


S = State
_WAITING_STATES = (
    *(S.WAITING, S.HOLDING, S.RESTING, S.PLANLESS, S.PAUSING),
    # After a restart in the last action of a pass.
    *(S.READYING, S.FINISHING),
)

TABLE: tuple[Row, ...] = (
    # A run begins, or goes on where it was when it ended.
    Row(S.PLANNING, Started, on.before_the_night, do.rest_until_the_night, S.RESTING),
    Row(S.PLANNING, Started, on.night_is_over, do.sum_up, S.SUMMING_UP),
    Row(S.PLANNING, Started, on.always, do.make_plan, S.PLANNING),
    Row(S.PLANLESS, Started, on.always, do.try_again_later, S.PLANLESS),
    Row(S.WAITING, Started, on.always, do.look, S.WAITING),
    Row(S.PREPARING, Started, on.always, do.look, S.WAITING),
    Row(S.ASKING, Started, on.always, do.look, S.WAITING),
    Row(S.HOLDING, Started, on.always, do.look, S.WAITING),
    Row(S.READYING, Started, on.action_may_not_come_twice, do.next_action_untold, S.READYING),
    Row(S.READYING, Started, on.more_before, do.same_action, S.READYING),
    Row(S.READYING, Started, on.worth_following, do.follow, S.FOLLOWING),
    Row(S.READYING, Started, on.always, do.lose_to_restart, S.WAITING),
    Row(S.FOLLOWING, Started, on.worth_another_go, do.follow_on, S.FOLLOWING),
    Row(S.FOLLOWING, Started, on.always, do.end_cut_off, S.FINISHING),
    Row(S.FINISHING, Started, on.action_may_not_come_twice, do.next_action_untold, S.FINISHING),
    Row(S.FINISHING, Started, on.more_after, do.same_action, S.FINISHING),
    Row(S.FINISHING, Started, on.always, do.look, S.WAITING),
    Row(S.PARKING, Started, on.always, do.lay_down_anew, S.PARKING),
    Row(S.PAUSING, Started, on.always, do.lay_down_anew, S.PARKING),
    Row(S.SUMMING_UP, Started, on.always, do.sum_up, S.SUMMING_UP),
    Row(S.RESTING, Started, on.always, do.rest, S.RESTING),
    Row(S.STOPPED, Started, on.before_the_night, do.rest_until_the_night, S.RESTING),
    Row(S.STOPPED, Started, on.has_a_plan, do.look, S.WAITING),
    Row(S.STOPPED, Started, on.always, do.make_plan, S.PLANNING),
    Row(S.ENDED, Started, on.was_the_last, do.end, S.ENDED),
    Row(S.ENDED, Started, on.always, do.go_on, S.RESTING),
    # The night's plan.
    Row(S.PLANNING, Planned, on.always, do.take_plan, S.WAITING),
    Row(S.PLANNING, NotPlanned, on.always, do.try_again_later, S.PLANLESS),
    Row(S.PLANLESS, Due, on.night_is_over_to_park, do.lay_down_for_the_day, S.PARKING),
    Row(S.PLANLESS, Due, on.night_is_over, do.sum_up, S.SUMMING_UP),
    Row(S.PLANLESS, Due, on.always, do.make_plan, S.PLANNING),
    # The schedule's file was read again.
    Row(S.WAITING, Reread, on.always, do.make_plan_anew, S.PLANNING),
    Row(S.PLANLESS, Reread, on.always, do.make_plan_anew, S.PLANNING),
    Row(S.RESTING, Reread, on.always, do.rest_anew, S.RESTING),
    # Between passes.
    Row(S.WAITING, Due, on.none_left_to_park, do.lay_down_for_the_day, S.PARKING),
    Row(S.WAITING, Due, on.none_left, do.sum_up, S.SUMMING_UP),
    Row(S.WAITING, Due, on.missed, do.lose_missed, S.WAITING),
    Row(S.WAITING, Due, on.long_to_wait, do.lay_down, S.PARKING),
    Row(S.WAITING, Due, on.too_early, do.wait, S.WAITING),
    Row(S.WAITING, Due, on.always, do.prepare, S.PREPARING),
    # Before a pass.
    Row(S.PREPARING, Prepared, on.cannot_be_taken, do.lose_unprepared, S.WAITING),
    Row(S.PREPARING, Prepared, on.always, do.ask_weather, S.ASKING),
    Row(S.ASKING, WeatherTold, on.unsafe_and_skipped, do.lose_to_weather, S.WAITING),
    Row(S.ASKING, WeatherTold, on.unsafe_and_too_late, do.lose_to_weather, S.WAITING),
    Row(S.ASKING, WeatherTold, on.unsafe, do.hold, S.HOLDING),
    Row(S.ASKING, WeatherTold, on.more_before, do.first_action, S.READYING),
    Row(S.ASKING, WeatherTold, on.worth_following, do.follow, S.FOLLOWING),
    Row(S.ASKING, WeatherTold, on.always, do.lose_missed, S.WAITING),
    Row(S.HOLDING, Due, on.always, do.ask_weather, S.ASKING),
    Row(S.READYING, StepDone, on.failed_and_skips, do.lose_to_action, S.WAITING),
    Row(S.READYING, StepDone, on.another_before, do.next_action, S.READYING),
    Row(S.READYING, StepDone, on.worth_following, do.follow, S.FOLLOWING),
    Row(S.READYING, StepDone, on.always, do.lose_to_delay, S.WAITING),
    Row(S.READYING, Due, on.worth_following, do.follow, S.FOLLOWING),
    Row(S.READYING, Due, on.always, do.lose_to_delay, S.WAITING),
    # A pass.
    Row(S.FOLLOWING, Followed, on.operator_stopped, do.stop_in_pass, S.STOPPED),
    Row(S.FOLLOWING, Followed, on.broke_off_early, do.follow_on, S.FOLLOWING),
    Row(S.FOLLOWING, Followed, on.more_after, do.end_pass, S.FINISHING),
    Row(S.FOLLOWING, Followed, on.always, do.end_pass, S.WAITING),
    Row(S.FINISHING, StepDone, on.another_after, do.next_action, S.FINISHING),
    Row(S.FINISHING, StepDone, on.always, do.look, S.WAITING),
    Row(S.FINISHING, Due, on.always, do.look, S.WAITING),
    # The mount laid down, the morning.
    Row(S.PARKING, Laid, on.not_laid_down, do.pause, S.PAUSING),
    Row(S.PARKING, Laid, on.passes_left, do.look_laid_down, S.WAITING),
    Row(S.PARKING, Laid, on.always, do.sum_up, S.SUMMING_UP),
    Row(S.PAUSING, Due, on.always, do.lay_down_again, S.PARKING),
    Row(S.SUMMING_UP, SummedUp, on.was_the_last, do.end, S.ENDED),
    Row(S.SUMMING_UP, SummedUp, on.always, do.rest, S.RESTING),
    Row(S.RESTING, Due, on.before_the_night, do.rest_until_the_night, S.RESTING),
    Row(S.RESTING, Due, on.always, do.make_plan, S.PLANNING),
    # Whatever is waited for, time may jump.
    *(Row(state, ClockSet, on.always, do.wait_anew, state) for state in _WAITING_STATES),
    *(Row(state, StopAsked, on.always, do.stop, S.STOPPED) for state in State),
)


class NoRowError(Exception):
    """An event came in a state in which it means nothing: a defect of whoever drives the machine."""


def step(run: Run, event: Happening) -> tuple[Run, Doing]:
    """Return what is known after an event, and what to do next. Raises NoRowError."""
    if isinstance(event, Started):
        run = replace(run, ways=event.ways)
        if event.recovered is not None:
            run = recovered_night(run, event.recovered, event.utc_s)
        elif not run.night:
            run = first_night(run, event.utc_s)
    told = event.words if isinstance(event, Started) else None
    for row in TABLE:
        if row.state is run.state and isinstance(event, row.event) and row.condition(run, event):
            after, doing = row.action(replace(run, told=told), event)
            return replace(_noted(run, event, after), state=row.next_state), doing
    raise NoRowError(f"{type(event).__name__} while {run.state}")


def _noted(run: Run, event: Happening, after: Run) -> Run:
    """Return the run with what is worth noting of an event.

    What became of passes is told by their results, what is planned by the plan, a night by its summary.
    """
    if after.told is None or after.results != run.results or isinstance(event, Planned | SummedUp):
        return after
    notes = after.notes if after.noted_night == after.night else ()
    return replace(after, notes=(*notes, after.told)[-MOST_NOTES:], noted_night=after.night)


def words_of(function: Judge | Change) -> str:
    """Return what a condition or an action is in words: its description's first line."""
    return (function.__doc__ or "").strip().splitlines()[0].rstrip(".")
