"""The conditions of the runner's table: what must hold in a state, at an event, for a row to be taken.

Each says in its first line what the table in the documentation says of it. Instants are POSIX seconds of UTC.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from sattrack.schedule.night import (
    Mount,
    RunState,
    StepDone,
    WeatherReported,
    actions_of,
    at_of,
    decided_since,
    enough_left,
    prepared_from_s,
    stepped,
)
from sattrack.schedule.schema import CommandAction, WebhookAction

if TYPE_CHECKING:
    from sattrack.schedule.night import Event, Followed, Parked, PassPrepared, Run

TO_PARK_S = 300.0
"""For a shorter wait a mount does not go to its park position."""
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


def night_is_over_with_passes(run: Run, event: Event) -> bool:
    """The night is over, and passes are left."""
    return night_is_over(run, event) and passes_left(run, event)


def night_is_over_to_park(run: Run, event: Event) -> bool:
    """The night is over, and the mount must be parked."""
    return night_is_over(run, event) and none_left_to_park(run, event)


def has_a_plan(run: Run, _: Event) -> bool:
    """The night has a plan."""
    return run.passes != ()


def passes_left(run: Run, _: Event) -> bool:
    """Passes are left."""
    return run.at is not None


def plan_in_force(run: Run, event: Event) -> bool:
    """Passes of a plan are left."""
    return decided_since(run, 3) and passes_left(run, event)


def passes_past_the_end(run: Run, _: Event) -> bool:
    """A pass to come ends after the run, which was given an earlier end."""
    end = run.settings.to_utc_s
    return end is not None and any(one.end_utc_s > end + 1.0 for one in run.passes[len(run.results) :])


def none_left(run: Run, _: Event) -> bool:
    """No pass is left."""
    return run.at is None


def none_left_to_park(run: Run, event: Event) -> bool:
    """No pass is left, and the mount must be parked."""
    parked = run.mount is Mount.PARKED and not run.waking
    return none_left(run, event) and run.settings.park and not parked


def missed(run: Run, event: Event) -> bool:
    """Too little is left of the next pass."""
    return not worth_following(run, event)


def too_early(run: Run, event: Event) -> bool:
    """It is too early to prepare the next pass."""
    return event.utc_s < prepared_from_s(run)


def long_to_wait(run: Run, event: Event) -> bool:
    """The wait is long, the mount has stood for long, or the weather ended a pass; it is not at park."""
    lost = bool(run.results) and run.results[-1].cause == "weather"
    return _is_long(run, event, prepared_from_s(run), lost)


def _is_long(run: Run, event: Event, until_utc_s: float, lost: bool) -> bool:
    """Return whether a mount that waits until then must be sent to its park position.

    `lost`: the weather is unsafe. For many short waits a mount tracks the sky as in a long one.
    """
    rest_s, wait_s = run.settings.rest_after_s, until_utc_s - event.utc_s
    left = run.mount is Mount.AT_REST
    is_long = wait_s > rest_s
    if wait_s > TO_PARK_S and decided_since(run, 3):
        since_utc_s = max(run.moved_utc_s, run.parked_utc_s)
        # Moved in what is the future now: the clock was wrong then.
        known = since_utc_s > 0.0 and run.mount is not Mount.UNKNOWN
        stood = known and not 0.0 <= event.utc_s - since_utc_s < rest_s
        is_long = is_long or (left and lost) or stood
    stands = left or event.utc_s >= sent_again_s(run, event.utc_s)
    return run.settings.park and is_long and stands


def sent_again_s(run: Run, utc_s: float) -> float:
    """Return from when on the mount is sent to its park position again; infinite where it was not sent."""
    renewed, rest_s = decided_since(run, 2), run.settings.rest_after_s
    failed = renewed and run.mount is Mount.UNKNOWN and run.parked_utc_s > 0.0
    if not (failed or run.mount is Mount.AT_PARK):
        return math.inf
    # Sent there in what is the future now: the clock was wrong then.
    return utc_s if renewed and run.parked_utc_s - utc_s > rest_s else run.parked_utc_s + rest_s


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


def unsafe_for_long(run: Run, event: WeatherReported) -> bool:
    """The weather is unsafe, the pass long, and the mount was not sent to its park position for as long."""
    return unsafe(run, event) and _is_long(run, event, at_of(run).end_utc_s, True)


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


def begun_before(run: Run, _: Event) -> bool:
    """An action before the pass was begun."""
    return run.step > 0


def lost_with_more_after(run: Run, event: Event) -> bool:
    """The pass is lost once an action before it was begun, and has one after it."""
    if not (decided_since(run, 4) and at_of(run).terms.after):
        return False
    if isinstance(event, WeatherReported):
        return begun_before(run, event)
    failed = isinstance(event, StepDone) and failed_and_skips(run, event)
    return failed or not worth_following(run, event)


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
