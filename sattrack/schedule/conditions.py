"""The conditions of the machine's rows; each says in its first line what the table says of it."""

from __future__ import annotations

from sattrack.schedule.night import (
    Followed,
    Happening,
    Laid,
    Mount,
    Prepared,
    Run,
    State,
    StepDone,
    WeatherTold,
    actions_of,
    at_of,
    enough_left,
    prepared_from_s,
    stepped,
)
from sattrack.schedule.schema import CommandAction, WebhookAction

MOST_PARTS = 12
"""Goes at one pass that broke off by themselves; restarts of the runner do not count."""
MOST_PARK_TRIES = 5
BROKE_OFF = frozenset({"link", "error", "crash", "hang"})


def always(_: Run, __: Happening) -> bool:
    """Otherwise."""
    return True


def before_the_night(run: Run, event: Happening) -> bool:
    """The night has not begun."""
    return event.utc_s < run.night_from_utc_s


def night_is_over(run: Run, event: Happening) -> bool:
    """The night is over."""
    return event.utc_s >= run.night_to_utc_s


def night_is_over_to_park(run: Run, event: Happening) -> bool:
    """The night is over, and the mount is to be parked."""
    return night_is_over(run, event) and none_left_to_park(run, event)


def has_a_plan(run: Run, _: Happening) -> bool:
    """The night has a plan."""
    return run.passes != ()


def passes_left(run: Run, _: Happening) -> bool:
    """Passes are left."""
    return run.at is not None


def none_left(run: Run, _: Happening) -> bool:
    """No pass is left."""
    return run.at is None


def none_left_to_park(run: Run, event: Happening) -> bool:
    """No pass is left, and the mount is to be parked."""
    return none_left(run, event) and run.ways.park and run.mount is not Mount.PARKED


def missed(run: Run, event: Happening) -> bool:
    """Too little is left of the next pass."""
    return not worth_following(run, event)


def too_early(run: Run, event: Happening) -> bool:
    """The next pass is not to be prepared yet."""
    return event.utc_s < prepared_from_s(run)


def long_to_wait(run: Run, event: Happening) -> bool:
    """There is long to wait, and the mount was not sent to its park position for as long."""
    left_s, again_s = prepared_from_s(run) - event.utc_s, run.laid_utc_s + run.ways.rest_after_s
    stands = run.mount is Mount.AT_REST or (run.mount is Mount.AT_PARK and event.utc_s >= again_s)
    return run.ways.park and left_s > run.ways.rest_after_s and stands


def cannot_be_taken(_: Run, event: Happening) -> bool:
    """It cannot be taken."""
    return isinstance(event, Prepared) and event.cause is not None


def unsafe(run: Run, event: Happening) -> bool:
    """The weather is unsafe."""
    told = isinstance(event, WeatherTold) and event.safe is False
    return told and at_of(run).terms.if_weather_unsafe != "run"


def unsafe_and_skipped(run: Run, event: Happening) -> bool:
    """The weather is unsafe, and the pass is to be skipped then."""
    return unsafe(run, event) and at_of(run).terms.if_weather_unsafe == "skip"


def unsafe_and_too_late(run: Run, event: Happening) -> bool:
    """The weather is unsafe, and too little would be left of the pass when it is asked for next."""
    return unsafe(run, event) and not enough_left(run, event.utc_s + run.ways.weather_every_s)


def worth_following(run: Run, event: Happening) -> bool:
    """Enough is left of the pass."""
    return enough_left(run, event.utc_s)


def more_before(run: Run, event: Happening) -> bool:
    """There is something to do before the pass, and enough is left of it."""
    return run.step < len(at_of(run).terms.before) and worth_following(run, event)


def another_before(run: Run, event: Happening) -> bool:
    """There is more to do before the pass, and enough is left of it."""
    return run.step + 1 < len(at_of(run).terms.before) and worth_following(run, event)


def more_after(run: Run, _: Happening) -> bool:
    """There is something to do after the pass."""
    place = run.step if run.state is State.FINISHING else 0
    return place < len(stepped(run).terms.after)


def another_after(run: Run, _: Happening) -> bool:
    """There is more to do after the pass."""
    return run.step + 1 < len(stepped(run).terms.after)


def action_may_not_come_twice(run: Run, event: Happening) -> bool:
    """A command or a webhook may have been under way, and enough is left of what it is for."""
    wanted = run.state is State.FINISHING or worth_following(run, event)
    actions = actions_of(run)
    return wanted and run.step < len(actions) and isinstance(actions[run.step], CommandAction | WebhookAction)


def failed_and_skips(run: Run, event: Happening) -> bool:
    """The action failed, and the pass is to be skipped then."""
    action = actions_of(run)[run.step]
    skips = isinstance(action, CommandAction) and action.if_it_fails == "skip"
    return skips and isinstance(event, StepDone) and not event.done


def worth_another_go(run: Run, event: Happening) -> bool:
    """Enough is left of the pass for another go."""
    return enough_left(run, event.utc_s, another=True)


def broke_off_early(run: Run, event: Happening) -> bool:
    """The session broke off by itself, and enough is left of the pass for another go."""
    if not isinstance(event, Followed) or event.go.ended_by not in BROKE_OFF:
        return False
    broken = sum(go.ended_by in BROKE_OFF for go in (*run.goes, event.go))
    return broken < MOST_PARTS and worth_another_go(run, event)


def operator_stopped(_: Run, event: Happening) -> bool:
    """Somebody stopped the mount."""
    return isinstance(event, Followed) and event.go.ended_by in ("operator", "stopped")


def not_laid_down(run: Run, event: Happening) -> bool:
    """The mount is not there, and it was not tried often enough."""
    there = isinstance(event, Laid) and event.mount in (Mount.AT_PARK, Mount.PARKED)
    return not there and run.tries < MOST_PARK_TRIES


def was_the_last(run: Run, _: Happening) -> bool:
    """It was the last night."""
    end = run.ways.to_utc_s
    return end is not None and run.night_to_utc_s >= end - 1.0
