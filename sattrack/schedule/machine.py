"""The runner of a schedule as a table: in a state, at an event, on a condition: what to do, the next state.

Pure: from what is known and an event, `step` gives what is known then and what to do. The driver keeps every
event before it acts on what follows; the same events give the same again, which is how a run continues after
its end at any instant. Instants are POSIX seconds of UTC. Conditions and actions say in their first lines
what the table in the documentation says of them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

from msgspec.structs import replace

from sattrack.schedule import steps as do
from sattrack.schedule.night import (
    ClockSet,
    Due,
    Event,
    Followed,
    Mount,
    NotPlanned,
    Order,
    Parked,
    PassPrepared,
    Planned,
    Reread,
    Run,
    RunState,
    Started,
    StepDone,
    StopAsked,
    SummedUp,
    WeatherReported,
    actions_of,
    at_of,
    enough_left,
    first_night,
    prepared_from_s,
    recovered_night,
    stepped,
)
from sattrack.schedule.schema import CommandAction, WebhookAction

if TYPE_CHECKING:
    from collections.abc import Callable

    Judge = Callable[[Run, Any], bool]
    """The event is of the row's type."""
    Change = Callable[[Run, Any], tuple[Run, Order]]


MOST_PARTS = 12
"""Attempts at one pass that broke off by themselves; restarts of the runner do not count."""
MOST_PARK_TRIES = 5
BROKE_OFF = frozenset({"link", "error", "crash", "hang"})


def always(_: Run, __: Event) -> bool:
    """Otherwise."""
    return True


def before_the_night(run: Run, event: Event) -> bool:
    """The night has not begun."""
    return event.utc_s < run.night_from_utc_s


def night_is_over(run: Run, event: Event) -> bool:
    """The night is over."""
    return event.utc_s >= run.night_to_utc_s


def night_is_over_to_park(run: Run, event: Event) -> bool:
    """The night is over, and the mount must be parked."""
    return night_is_over(run, event) and none_left_to_park(run, event)


def has_a_plan(run: Run, _: Event) -> bool:
    """The night has a plan."""
    return run.passes != ()


def passes_left(run: Run, _: Event) -> bool:
    """Passes are left."""
    return run.at is not None


def none_left(run: Run, _: Event) -> bool:
    """No pass is left."""
    return run.at is None


def none_left_to_park(run: Run, event: Event) -> bool:
    """No pass is left, and the mount must be parked."""
    return none_left(run, event) and run.settings.park and run.mount is not Mount.PARKED


def missed(run: Run, event: Event) -> bool:
    """Too little is left of the next pass."""
    return not worth_following(run, event)


def too_early(run: Run, event: Event) -> bool:
    """It is too early to prepare the next pass."""
    return event.utc_s < prepared_from_s(run)


def long_to_wait(run: Run, event: Event) -> bool:
    """The wait is long, and the mount was not sent to its park position for as long."""
    left_s, again_s = prepared_from_s(run) - event.utc_s, run.parked_utc_s + run.settings.rest_after_s
    stands = run.mount is Mount.AT_REST or (run.mount is Mount.AT_PARK and event.utc_s >= again_s)
    return run.settings.park and left_s > run.settings.rest_after_s and stands


def cannot_be_taken(_: Run, event: PassPrepared) -> bool:
    """The pass cannot be taken."""
    return event.cause is not None


def unsafe(run: Run, event: WeatherReported) -> bool:
    """The weather is unsafe."""
    return event.safe is False and at_of(run).terms.if_weather_unsafe != "run"


def unsafe_and_skipped(run: Run, event: WeatherReported) -> bool:
    """The weather is unsafe, and the pass must be skipped then."""
    return unsafe(run, event) and at_of(run).terms.if_weather_unsafe == "skip"


def unsafe_and_too_late(run: Run, event: WeatherReported) -> bool:
    """The weather is unsafe, and too little would be left of the pass when it is asked for next."""
    return unsafe(run, event) and not enough_left(run, event.utc_s + run.settings.weather_every_s)


def worth_following(run: Run, event: Event) -> bool:
    """Enough is left of the pass."""
    return enough_left(run, event.utc_s)


def more_before(run: Run, event: Event) -> bool:
    """The pass has an action before it, and enough is left of it."""
    return run.step < len(at_of(run).terms.before) and worth_following(run, event)


def another_before(run: Run, event: Event) -> bool:
    """Another action comes before the pass, and enough is left of it."""
    return run.step + 1 < len(at_of(run).terms.before) and worth_following(run, event)


def more_after(run: Run, _: Event) -> bool:
    """The pass has an action after it."""
    place = run.step if run.state is RunState.FINISHING else 0
    return place < len(stepped(run).terms.after)


def another_after(run: Run, _: Event) -> bool:
    """Another action comes after the pass."""
    return run.step + 1 < len(stepped(run).terms.after)


def action_may_not_come_twice(run: Run, event: Event) -> bool:
    """A command or a webhook may have begun, and enough is left of what it is for."""
    wanted = run.state is RunState.FINISHING or worth_following(run, event)
    actions = actions_of(run)
    return wanted and run.step < len(actions) and isinstance(actions[run.step], CommandAction | WebhookAction)


def failed_and_skips(run: Run, event: StepDone) -> bool:
    """The action failed, and the pass must be skipped then."""
    action = actions_of(run)[run.step]
    return isinstance(action, CommandAction) and action.if_it_fails == "skip" and not event.done


def worth_another_attempt(run: Run, event: Event) -> bool:
    """Enough is left of the pass for another attempt."""
    return enough_left(run, event.utc_s, another=True)


def broke_off_early(run: Run, event: Followed) -> bool:
    """The session broke off by itself, and enough is left of the pass for another attempt."""
    if event.attempt.ended_by not in BROKE_OFF:
        return False
    broken = sum(attempt.ended_by in BROKE_OFF for attempt in (*run.attempts, event.attempt))
    return broken < MOST_PARTS and worth_another_attempt(run, event)


def operator_stopped(_: Run, event: Followed) -> bool:
    """Somebody stopped the mount."""
    return event.attempt.ended_by in ("operator", "stopped")


def not_parked(run: Run, event: Parked) -> bool:
    """The mount is not at its park position, and tries are left."""
    return event.mount not in (Mount.AT_PARK, Mount.PARKED) and run.tries < MOST_PARK_TRIES


def was_the_last(run: Run, _: Event) -> bool:
    """It was the last night."""
    end = run.settings.to_utc_s
    return end is not None and run.night_to_utc_s >= end - 1.0


MOST_NOTES = 12


class TableRow(NamedTuple):
    """One row: the first of a state and an event whose condition holds is taken."""

    state: RunState
    event: type[Event]
    condition: Judge
    action: Change
    next_state: RunState


S = RunState
_WAITING_STATES = (
    *(S.WAITING, S.HOLDING, S.RESTING, S.PLANLESS, S.PAUSING),
    # After a restart in the last action of a pass.
    *(S.READYING, S.FINISHING),
)

TABLE: tuple[TableRow, ...] = (
    # A run begins, or goes on where it was when it ended.
    TableRow(S.PLANNING, Started, before_the_night, do.rest_until_the_night, S.RESTING),
    TableRow(S.PLANNING, Started, night_is_over, do.sum_up, S.SUMMING_UP),
    TableRow(S.PLANNING, Started, always, do.make_plan, S.PLANNING),
    TableRow(S.PLANLESS, Started, always, do.try_again_later, S.PLANLESS),
    TableRow(S.WAITING, Started, always, do.look, S.WAITING),
    TableRow(S.PREPARING, Started, always, do.look, S.WAITING),
    TableRow(S.ASKING, Started, always, do.look, S.WAITING),
    TableRow(S.HOLDING, Started, always, do.look, S.WAITING),
    TableRow(S.READYING, Started, action_may_not_come_twice, do.next_action_untold, S.READYING),
    TableRow(S.READYING, Started, more_before, do.same_action, S.READYING),
    TableRow(S.READYING, Started, worth_following, do.follow, S.FOLLOWING),
    TableRow(S.READYING, Started, always, do.lose_to_restart, S.WAITING),
    TableRow(S.FOLLOWING, Started, worth_another_attempt, do.follow_on, S.FOLLOWING),
    TableRow(S.FOLLOWING, Started, always, do.end_cut_off, S.FINISHING),
    TableRow(S.FINISHING, Started, action_may_not_come_twice, do.next_action_untold, S.FINISHING),
    TableRow(S.FINISHING, Started, more_after, do.same_action, S.FINISHING),
    TableRow(S.FINISHING, Started, always, do.look, S.WAITING),
    TableRow(S.PARKING, Started, always, do.park_anew, S.PARKING),
    TableRow(S.PAUSING, Started, always, do.park_anew, S.PARKING),
    TableRow(S.SUMMING_UP, Started, always, do.sum_up, S.SUMMING_UP),
    TableRow(S.RESTING, Started, always, do.rest, S.RESTING),
    TableRow(S.STOPPED, Started, before_the_night, do.rest_until_the_night, S.RESTING),
    TableRow(S.STOPPED, Started, has_a_plan, do.look, S.WAITING),
    TableRow(S.STOPPED, Started, always, do.make_plan, S.PLANNING),
    TableRow(S.ENDED, Started, was_the_last, do.end, S.ENDED),
    TableRow(S.ENDED, Started, always, do.go_on, S.RESTING),
    # The night's plan.
    TableRow(S.PLANNING, Planned, always, do.take_plan, S.WAITING),
    TableRow(S.PLANNING, NotPlanned, always, do.try_again_later, S.PLANLESS),
    TableRow(S.PLANLESS, Due, night_is_over_to_park, do.park, S.PARKING),
    TableRow(S.PLANLESS, Due, night_is_over, do.sum_up, S.SUMMING_UP),
    TableRow(S.PLANLESS, Due, always, do.make_plan, S.PLANNING),
    # The schedule's file was read again.
    TableRow(S.WAITING, Reread, always, do.make_plan_anew, S.PLANNING),
    TableRow(S.PLANLESS, Reread, always, do.make_plan_anew, S.PLANNING),
    TableRow(S.RESTING, Reread, always, do.rest_anew, S.RESTING),
    # Between passes.
    TableRow(S.WAITING, Due, none_left_to_park, do.park, S.PARKING),
    TableRow(S.WAITING, Due, none_left, do.sum_up, S.SUMMING_UP),
    TableRow(S.WAITING, Due, missed, do.lose_missed, S.WAITING),
    TableRow(S.WAITING, Due, long_to_wait, do.wait_at_park, S.PARKING),
    TableRow(S.WAITING, Due, too_early, do.wait, S.WAITING),
    TableRow(S.WAITING, Due, always, do.prepare, S.PREPARING),
    # Before a pass.
    TableRow(S.PREPARING, PassPrepared, cannot_be_taken, do.lose_unprepared, S.WAITING),
    TableRow(S.PREPARING, PassPrepared, always, do.ask_weather, S.ASKING),
    TableRow(S.ASKING, WeatherReported, unsafe_and_skipped, do.lose_to_weather, S.WAITING),
    TableRow(S.ASKING, WeatherReported, unsafe_and_too_late, do.lose_to_weather, S.WAITING),
    TableRow(S.ASKING, WeatherReported, unsafe, do.hold, S.HOLDING),
    TableRow(S.ASKING, WeatherReported, more_before, do.first_action, S.READYING),
    TableRow(S.ASKING, WeatherReported, worth_following, do.follow, S.FOLLOWING),
    TableRow(S.ASKING, WeatherReported, always, do.lose_missed, S.WAITING),
    TableRow(S.HOLDING, Due, always, do.ask_weather, S.ASKING),
    TableRow(S.READYING, StepDone, failed_and_skips, do.lose_to_action, S.WAITING),
    TableRow(S.READYING, StepDone, another_before, do.next_action, S.READYING),
    TableRow(S.READYING, StepDone, worth_following, do.follow, S.FOLLOWING),
    TableRow(S.READYING, StepDone, always, do.lose_to_delay, S.WAITING),
    TableRow(S.READYING, Due, worth_following, do.follow, S.FOLLOWING),
    TableRow(S.READYING, Due, always, do.lose_to_delay, S.WAITING),
    # A pass.
    TableRow(S.FOLLOWING, Followed, operator_stopped, do.stop_in_pass, S.STOPPED),
    TableRow(S.FOLLOWING, Followed, broke_off_early, do.follow_on, S.FOLLOWING),
    TableRow(S.FOLLOWING, Followed, more_after, do.end_pass, S.FINISHING),
    TableRow(S.FOLLOWING, Followed, always, do.end_pass, S.WAITING),
    TableRow(S.FINISHING, StepDone, another_after, do.next_action, S.FINISHING),
    TableRow(S.FINISHING, StepDone, always, do.look, S.WAITING),
    TableRow(S.FINISHING, Due, always, do.look, S.WAITING),
    # The mount parked, the morning.
    TableRow(S.PARKING, Parked, not_parked, do.pause, S.PAUSING),
    TableRow(S.PARKING, Parked, passes_left, do.look_parked, S.WAITING),
    TableRow(S.PARKING, Parked, always, do.sum_up, S.SUMMING_UP),
    TableRow(S.PAUSING, Due, always, do.park_again, S.PARKING),
    TableRow(S.SUMMING_UP, SummedUp, was_the_last, do.end, S.ENDED),
    TableRow(S.SUMMING_UP, SummedUp, always, do.rest, S.RESTING),
    TableRow(S.RESTING, Due, before_the_night, do.rest_until_the_night, S.RESTING),
    TableRow(S.RESTING, Due, always, do.make_plan, S.PLANNING),
    # Whatever is waited for, time may jump.
    *(TableRow(state, ClockSet, always, do.wait_anew, state) for state in _WAITING_STATES),
    *(TableRow(state, StopAsked, always, do.stop, S.STOPPED) for state in RunState),
)


class NoRowError(Exception):
    """An event came in a state in which it means nothing: a defect of whoever drives the machine."""


def step(run: Run, event: Event) -> tuple[Run, Order]:
    """Return what is known after an event, and what to do next. Raises NoRowError."""
    if isinstance(event, Started):
        run = replace(run, settings=event.settings)
        if event.recovered is not None:
            run = recovered_night(run, event.recovered, event.utc_s)
        elif not run.night:
            run = first_night(run, event.utc_s)
    message = event.words if isinstance(event, Started) else None
    for row in TABLE:
        if row.state is run.state and isinstance(event, row.event) and row.condition(run, event):
            after, order = row.action(replace(run, message=message), event)
            return replace(_noted(run, event, after), state=row.next_state), order
    raise NoRowError(f"{type(event).__name__} while {run.state}")


def _noted(run: Run, event: Event, after: Run) -> Run:
    """Return the run with what is worth noting of an event.

    Results report passes, the plan what is planned, a summary the night.
    """
    if after.message is None or after.results != run.results or isinstance(event, Planned | SummedUp):
        return after
    notes = after.notes if after.noted_night == after.night else ()
    return replace(after, notes=(*notes, after.message)[-MOST_NOTES:], noted_night=after.night)


def words_of(function: Judge | Change) -> str:
    """Return what a condition or an action is in words: its description's first line."""
    return (function.__doc__ or "").strip().splitlines()[0].rstrip(".")
