"""The runner of a schedule as a table: in a state, at an event, on a condition: what to do, the next state.

Pure: from what is known and an event, `step` gives what is known then and what to do. The driver keeps every
event before it acts on what follows; the same events give the same again, which is how a run continues after
its end at any instant. Instants are POSIX seconds of UTC. Conditions and actions say in their first lines
what the table in the documentation says of them.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

from msgspec.structs import replace

from sattrack.schedule.night import (
    AskWeather,
    ClockSet,
    DoStep,
    Due,
    End,
    Event,
    FinishedPass,
    Follow,
    Followed,
    MakePlan,
    Mount,
    NotPlanned,
    Order,
    Parked,
    ParkMount,
    PassPrepared,
    Planned,
    Prepare,
    Reread,
    Result,
    Run,
    RunState,
    Started,
    StepDone,
    StopAsked,
    SummedUp,
    SumUp,
    Wait,
    WeatherReported,
    actions_of,
    at_of,
    enough_left,
    first_night,
    near_night,
    next_night,
    prepared_from_s,
    recovered_night,
    run_begun,
    stepped,
    with_settings,
)
from sattrack.schedule.schema import CommandAction, WebhookAction
from sattrack.schedule.summary import attempt_of, limits_text, result_of

if TYPE_CHECKING:
    from collections.abc import Callable

    Judge = Callable[[Run, Any], bool]
    """The event is of the row's type."""
    Change = Callable[[Run, Any], tuple[Run, Order]]

REVISION = 3
"""Of these rules: what an earlier one decided in a journal is decided again by that."""
TO_PARK_S = 300.0
"""For a shorter wait a mount does not go to its park position."""
TRY_PLAN_AGAIN_S = 600.0
TRY_PARK_AGAIN_S = 60.0
LONGEST_PAUSE_S = 30.0
"""Before a session that broke off is begun again: 1 s at first, then twice as long each time."""


def make_plan(run: Run, _: Event) -> tuple[Run, Order]:
    """Make the night's plan."""
    return run, MakePlan()


def make_plan_anew(run: Run, event: Reread) -> tuple[Run, Order]:
    """Plan anew what is not over."""
    return with_settings(run, event.settings), MakePlan()


def rest_anew(run: Run, event: Reread) -> tuple[Run, Order]:
    """Take what it says, and wait for the next night."""
    run = with_settings(run, event.settings)
    if not run_begun(run, event.utc_s):
        run = first_night(run, event.utc_s)
    return rest_until_the_night(run, event)


def try_again_later(run: Run, event: Event) -> tuple[Run, Order]:
    """Report why, and try again in ten minutes."""
    words = event.words if isinstance(event, NotPlanned) else None
    message = None if words is None else f"no plan: {words}"
    if message is not None and run.notes and run.notes[-1] == message:
        message = None
    return replace(run, message=message), Wait(until_utc_s=event.utc_s + TRY_PLAN_AGAIN_S)


def take_plan(run: Run, event: Planned) -> tuple[Run, Order]:
    """Take the plan, for what is not over."""
    # What has a result already is not followed again.
    kept = run.passes[: len(run.results)]
    over = (
        *run.over,
        *(FinishedPass(one.object_number, one.culminate_utc_s, one.end_utc_s) for one in kept),
    )
    left = [one for one in event.passes if not any(each.is_pass(one) for each in over)]
    new = [replace(one, number=len(kept) + k) for k, one in enumerate(left, start=1)]
    count = len(new)
    message = f"night {run.night}: {count} {'pass' if count == 1 else 'passes'} planned" + (
        f"; {event.words}" if event.words else ""
    )
    notes = run.notes if run.noted_night == run.night else ()
    run = replace(run, passes=(*kept, *new), others=event.others, notes=notes, message=message)
    return _fresh(run), Wait(until_utc_s=event.utc_s)


def keep_plan(run: Run, event: NotPlanned) -> tuple[Run, Order]:
    """Report why, and keep the plan in force."""
    end = run.settings.to_utc_s
    over, left = run.passes[: len(run.results)], run.passes[len(run.results) :]
    kept = tuple(one for one in left if end is None or one.end_utc_s <= end + 1.0)
    message = f"not planned anew, the plan in force stays: {event.words}"
    run = replace(run, passes=(*over, *kept), message=message)
    return _fresh(run), Wait(until_utc_s=event.utc_s)


def look(run: Run, event: Event) -> tuple[Run, Order]:
    """See what is next."""
    run = replace(run, message=run.message or _failure(run, event))
    return _fresh(run), Wait(until_utc_s=event.utc_s)


def wait(run: Run, event: Event) -> tuple[Run, Order]:
    """Wait until it must be prepared, or the mount sent to its park position again."""
    until, again = prepared_from_s(run), _sent_again_s(run, event.utc_s)
    if event.utc_s < again < until - run.settings.rest_after_s:
        until = again
    return run, Wait(until_utc_s=until)


def wait_anew(run: Run, event: ClockSet) -> tuple[Run, Order]:
    """Report it, and look at the clock again."""
    hours = abs(event.seconds) / 3600.0
    size = f"{hours:.2f} h" if hours >= 0.5 else f"{abs(event.seconds):.0f} s"
    if event.slept:
        words = f"the computer slept for {size}"
    else:
        words = f"the computer's clock was set {'ahead' if event.seconds > 0.0 else 'back'} by {size}"
    until = event.utc_s
    if run.state is RunState.RESTING:
        until = max(until, run.night_from_utc_s)
    elif run.state is RunState.PAUSING:
        until += TRY_PARK_AGAIN_S
    return replace(run, message=words), Wait(until_utc_s=until)


def prepare(run: Run, _: Event) -> tuple[Run, Order]:
    """Prepare it."""
    wake = run.mount is Mount.PARKED
    return replace(run, waking=wake and _since(run, 3)), Prepare(index=len(run.results), wake=wake)


def ask_weather(run: Run, event: Event) -> tuple[Run, Order]:
    """Ask about the weather."""
    if isinstance(event, PassPrepared):
        run = _woken(replace(run, message=event.words), event)
        if event.elements is not None:
            run = _with_elements(run, event)
    return run, AskWeather()


def hold(run: Run, event: WeatherReported) -> tuple[Run, Order]:
    """Ask again later."""
    message = (
        None if run.weather == event.words else f"{at_of(run).name}: the weather is unsafe: {event.words}"
    )
    run = replace(run, weather=event.words, message=message)
    return run, Wait(until_utc_s=event.utc_s + run.settings.weather_every_s)


def hold_at_park(run: Run, event: WeatherReported) -> tuple[Run, Order]:
    """Ask again later, and let the mount wait at its park position, drives on."""
    run, _ = hold(run, event)
    return wait_at_park(run, event)


def first_action(run: Run, event: Event) -> tuple[Run, Order]:
    """Begin with the actions before it."""
    run = replace(run, weather=event.words if isinstance(event, WeatherReported) else None, step=0)
    return _moving(run, event), DoStep(index=len(run.results), when="before", step=0)


def next_action(run: Run, event: Event) -> tuple[Run, Order]:
    """Report what went wrong, and do the next."""
    return _action(run, event, run.step + 1, _failure(run, event))


def same_action(run: Run, event: Event) -> tuple[Run, Order]:
    """Do it again."""
    return _action(run, event, run.step, None)


def next_action_untold(run: Run, event: Event) -> tuple[Run, Order]:
    """Do not repeat it: go on with what follows."""
    words = f"{actions_of(run)[run.step].words}: cut off by a restart, not repeated"
    # What is next is seen as if this one had ended.
    return _action(run, event, run.step + 1, words)


def follow(run: Run, event: Event) -> tuple[Run, Order]:
    """Follow it."""
    failed = _failure(run, event) if isinstance(event, StepDone) else None
    weather = event.words if isinstance(event, WeatherReported) else run.weather
    run = replace(run, weather=weather, message=failed, part=1, attempts=(), part_from_utc_s=event.utc_s)
    return _moving(run, event), Follow(index=len(run.results), part=1, from_utc_s=event.utc_s)


def follow_on(run: Run, event: Event) -> tuple[Run, Order]:
    """Follow what is left of it."""
    attempt = attempt_of(event)
    words = "the runner was restarted" if isinstance(event, Started) else attempt.words or attempt.ended_by
    part = run.part + 1
    message = f"{at_of(run).name}: {words}: following on, part {part}"
    run = replace(
        run, attempts=(*run.attempts, attempt), part=part, part_from_utc_s=event.utc_s, message=message
    )
    pause_s = 0.0 if isinstance(event, Started) else min(LONGEST_PAUSE_S, 2.0 ** (len(run.attempts) - 1))
    order = Follow(index=len(run.results), part=part, from_utc_s=event.utc_s, pause_s=pause_s)
    return _moving(run, event), order


def end_pass(run: Run, event: Followed) -> tuple[Run, Order]:
    """Note its result."""
    run = _with_result(run, result_of(at_of(run), (*run.attempts, event.attempt)))
    return _after_pass(run, event)


def end_cut_off(run: Run, event: Event) -> tuple[Run, Order]:
    """Note its result, as far as it is known."""
    run = _with_result(run, result_of(at_of(run), (*run.attempts, attempt_of(event))))
    return _after_pass(run, event)


def stop_in_pass(run: Run, event: Followed) -> tuple[Run, Order]:
    """End: nothing is moved any more."""
    run = _with_result(run, result_of(at_of(run), (*run.attempts, event.attempt)))
    why = event.attempt.words or "stopped by the operator"
    return _fresh(run), End(why=why, interrupted=True)


def lose_missed(run: Run, event: Event) -> tuple[Run, Order]:
    """Lose it: it was missed."""
    late_s = event.utc_s - at_of(run).start_utc_s
    words = f"nothing could begin it until {late_s:.0f} s after its start"
    return _lose(run, event, "missed", words)


def lose_to_restart(run: Run, event: Event) -> tuple[Run, Order]:
    """Lose it: the runner was restarted too late."""
    return _lose(run, event, "missed", "the runner was restarted too late for it")


def lose_to_delay(run: Run, event: Event) -> tuple[Run, Order]:
    """Lose it: the actions before it took too long."""
    return _lose(run, event, "delay", _wrong(run, event) or "what is done before it took too long")


def lose_unprepared(run: Run, event: PassPrepared) -> tuple[Run, Order]:
    """Lose it to what kept it from being taken."""
    run = _woken(run, event) if _since(run, 3) else run
    return _lose(run, event, event.cause or "error", event.words)


def lose_to_weather(run: Run, event: WeatherReported) -> tuple[Run, Order]:
    """Lose it to the weather."""
    return _lose(replace(run, weather=event.words), event, "weather", event.words)


def lose_to_action(run: Run, event: Event) -> tuple[Run, Order]:
    """Lose it to what failed before it."""
    return _lose(run, event, "command", _wrong(run, event))


def wait_at_park(run: Run, _: Event) -> tuple[Run, Order]:
    """Let the mount wait at its park position, drives on."""
    # What has failed often is tried once each time: a pass is not to be late for it.
    tries = MOST_PARK_TRIES if run.mount is Mount.UNKNOWN else 1
    return replace(run, tries=tries), ParkMount(power_off=False)


def park(run: Run, _: Event) -> tuple[Run, Order]:
    """Park the mount: at its park position, the drives' power cut."""
    return replace(run, tries=1), ParkMount(power_off=True)


def park_anew(run: Run, event: Event) -> tuple[Run, Order]:
    """Begin that again."""
    return park_again(replace(run, tries=0), event)


def park_again(run: Run, _: Event) -> tuple[Run, Order]:
    """Try again."""
    return replace(run, tries=run.tries + 1), ParkMount(power_off=run.at is None)


def pause(run: Run, event: Parked) -> tuple[Run, Order]:
    """Report it, and try again in a minute."""
    run = replace(run, mount=event.mount, message=f"the mount is not parked: {event.words}")
    return run, Wait(until_utc_s=event.utc_s + TRY_PARK_AGAIN_S)


def look_parked(run: Run, event: Event) -> tuple[Run, Order]:
    """See what is next."""
    run = _parked(run, event)
    if run.mount is Mount.AT_REST:
        # It was tried often enough for now.
        run = replace(run, mount=Mount.UNKNOWN)
    return look(run, event)


def sum_up(run: Run, event: Event) -> tuple[Run, Order]:
    """Write the night's summary."""
    return _parked(run, event), SumUp()


def rest(run: Run, event: Event) -> tuple[Run, Order]:
    """Wait for the next night."""
    if isinstance(event, SummedUp):
        run = replace(run, summary=event.file or run.summary, message=event.words)
        run = _near(next_night(run, event.utc_s), event)
    return run, Wait(until_utc_s=run.night_from_utc_s)


def go_on(run: Run, event: Event) -> tuple[Run, Order]:
    """Go on with another night: the run's end was put off."""
    run = next_night(run, event.utc_s)
    return run, Wait(until_utc_s=run.night_from_utc_s)


def rest_until_the_night(run: Run, _: Event) -> tuple[Run, Order]:
    """Wait for the night."""
    return run, Wait(until_utc_s=run.night_from_utc_s)


def stop(run: Run, event: StopAsked) -> tuple[Run, Order]:
    """End: nothing is moved any more."""
    return run, End(why=event.words, interrupted=True)


def end(run: Run, event: Event) -> tuple[Run, Order]:
    """End."""
    if isinstance(event, SummedUp):
        run = replace(run, summary=event.file or run.summary, message=event.words)
    return run, End(why="all nights are over")


def _near(run: Run, event: Event) -> Run:
    return near_night(run, event.utc_s) if _since(run, 2) else run


def _fresh(run: Run) -> Run:
    """Return the run with nothing begun of the next pass."""
    return replace(run, step=0, part=0, attempts=(), tries=0)


def _action(run: Run, event: Event, place: int, message: str | None) -> tuple[Run, Order]:
    """Return the order for an action, or what follows where there is none at that place."""
    run = replace(run, step=place, message=message)
    finishing = run.state is RunState.FINISHING
    if place < len(actions_of(run)):
        index = len(run.results) - (1 if finishing else 0)
        return _moving(run, event), DoStep(index=index, when="after" if finishing else "before", step=place)
    return run, Wait(until_utc_s=event.utc_s)


def _moving(run: Run, event: Event) -> Run:
    return replace(run, mount=Mount.AT_REST, moved_utc_s=event.utc_s)


def _woken(run: Run, event: PassPrepared) -> Run:
    """Return the run with what is known of the drives' power once a pass was prepared."""
    run = replace(run, waking=False)
    return replace(run, mount=Mount.AT_REST, moved_utc_s=event.utc_s) if event.woken else run


def _since(run: Run, revision: int) -> bool:
    """Tell whether what is decided here is decided by the rules of a revision, or later ones."""
    return run.settings.revision >= revision


def _failure(run: Run, event: Event) -> str | None:
    words = _wrong(run, event)
    return None if words is None else f"{stepped(run).name}: {words}"


def _wrong(run: Run, event: Event) -> str | None:
    if isinstance(event, StepDone) and not event.done:
        return f"{actions_of(run)[run.step].words}: {event.words}"
    return None


def _parked(run: Run, event: Event) -> Run:
    if not isinstance(event, Parked):
        return run
    message = event.words if event.mount in (Mount.AT_PARK, Mount.PARKED) else f"NOT PARKED: {event.words}"
    return replace(run, mount=event.mount, parked_utc_s=event.utc_s, message=message)


def _with_elements(run: Run, event: PassPrepared) -> Run:
    assert event.elements is not None
    place = len(run.results)
    renewed = replace(at_of(run), elements=event.elements)
    return replace(run, passes=(*run.passes[:place], renewed, *run.passes[place + 1 :]))


def _with_result(run: Run, result: Result) -> Run:
    one = at_of(run)
    words = f"{one.name}: {result.state}"
    if result.cause is not None:
        words += f", {result.cause}: {result.words or ''}".rstrip(": ")
    elif result.rms_arcsec is not None:
        words += f", {result.on_target_s:.0f} s on target, {result.rms_arcsec:.2f}″ RMS"
    held = limits_text(result)
    words += f"; {held}" if held else ""
    return replace(run, results=(*run.results, result), message=words)


def _lose(run: Run, event: Event, cause: str, words: str | None) -> tuple[Run, Order]:
    run = _with_result(run, Result("lost", cause, words))
    return _fresh(run), Wait(until_utc_s=event.utc_s)


def _after_pass(run: Run, event: Event) -> tuple[Run, Order]:
    place = len(run.results) - 1
    run = replace(_fresh(run), moved_utc_s=event.utc_s)
    if run.passes[place].terms.after:
        return run, DoStep(index=place, when="after", step=0)
    return run, Wait(until_utc_s=event.utc_s)


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
    return _since(run, 3) and passes_left(run, event)


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
    if wait_s > TO_PARK_S and _since(run, 3):
        since_utc_s = max(run.moved_utc_s, run.parked_utc_s)
        # Moved in what is the future now: the clock was wrong then.
        known = since_utc_s > 0.0 and run.mount is not Mount.UNKNOWN
        stood = known and not 0.0 <= event.utc_s - since_utc_s < rest_s
        is_long = is_long or (left and lost) or stood
    stands = left or event.utc_s >= _sent_again_s(run, event.utc_s)
    return run.settings.park and is_long and stands


def _sent_again_s(run: Run, utc_s: float) -> float:
    """Return from when on the mount is sent to its park position again; infinite where it was not sent."""
    renewed, rest_s = _since(run, 2), run.settings.rest_after_s
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
    TableRow(S.PLANNING, Started, before_the_night, rest_until_the_night, S.RESTING),
    TableRow(S.PLANNING, Started, night_is_over_with_passes, look, S.WAITING),
    TableRow(S.PLANNING, Started, night_is_over, sum_up, S.SUMMING_UP),
    TableRow(S.PLANNING, Started, always, make_plan, S.PLANNING),
    TableRow(S.PLANLESS, Started, always, try_again_later, S.PLANLESS),
    TableRow(S.WAITING, Started, always, look, S.WAITING),
    TableRow(S.PREPARING, Started, always, look, S.WAITING),
    TableRow(S.ASKING, Started, always, look, S.WAITING),
    TableRow(S.HOLDING, Started, always, look, S.WAITING),
    TableRow(S.READYING, Started, action_may_not_come_twice, next_action_untold, S.READYING),
    TableRow(S.READYING, Started, more_before, same_action, S.READYING),
    TableRow(S.READYING, Started, worth_following, follow, S.FOLLOWING),
    TableRow(S.READYING, Started, always, lose_to_restart, S.WAITING),
    TableRow(S.FOLLOWING, Started, worth_another_attempt, follow_on, S.FOLLOWING),
    TableRow(S.FOLLOWING, Started, always, end_cut_off, S.FINISHING),
    TableRow(S.FINISHING, Started, action_may_not_come_twice, next_action_untold, S.FINISHING),
    TableRow(S.FINISHING, Started, more_after, same_action, S.FINISHING),
    TableRow(S.FINISHING, Started, always, look, S.WAITING),
    TableRow(S.PARKING, Started, always, park_anew, S.PARKING),
    TableRow(S.PAUSING, Started, always, park_anew, S.PARKING),
    TableRow(S.SUMMING_UP, Started, always, sum_up, S.SUMMING_UP),
    TableRow(S.RESTING, Started, always, rest, S.RESTING),
    TableRow(S.STOPPED, Started, before_the_night, rest_until_the_night, S.RESTING),
    TableRow(S.STOPPED, Started, has_a_plan, look, S.WAITING),
    TableRow(S.STOPPED, Started, always, make_plan, S.PLANNING),
    TableRow(S.ENDED, Started, was_the_last, end, S.ENDED),
    TableRow(S.ENDED, Started, always, go_on, S.RESTING),
    # The night's plan.
    TableRow(S.PLANNING, Planned, always, take_plan, S.WAITING),
    TableRow(S.PLANNING, NotPlanned, plan_in_force, keep_plan, S.WAITING),
    TableRow(S.PLANNING, NotPlanned, always, try_again_later, S.PLANLESS),
    TableRow(S.PLANLESS, Due, night_is_over_with_passes, look, S.WAITING),
    TableRow(S.PLANLESS, Due, night_is_over_to_park, park, S.PARKING),
    TableRow(S.PLANLESS, Due, night_is_over, sum_up, S.SUMMING_UP),
    TableRow(S.PLANLESS, Due, always, make_plan, S.PLANNING),
    # The schedule's file was read again.
    TableRow(S.WAITING, Reread, always, make_plan_anew, S.PLANNING),
    TableRow(S.PLANLESS, Reread, always, make_plan_anew, S.PLANNING),
    TableRow(S.RESTING, Reread, always, rest_anew, S.RESTING),
    # Between passes.
    TableRow(S.WAITING, Due, passes_past_the_end, make_plan, S.PLANNING),
    TableRow(S.WAITING, Due, none_left_to_park, park, S.PARKING),
    TableRow(S.WAITING, Due, none_left, sum_up, S.SUMMING_UP),
    TableRow(S.WAITING, Due, missed, lose_missed, S.WAITING),
    TableRow(S.WAITING, Due, long_to_wait, wait_at_park, S.PARKING),
    TableRow(S.WAITING, Due, too_early, wait, S.WAITING),
    TableRow(S.WAITING, Due, always, prepare, S.PREPARING),
    # Before a pass.
    TableRow(S.PREPARING, PassPrepared, cannot_be_taken, lose_unprepared, S.WAITING),
    TableRow(S.PREPARING, PassPrepared, always, ask_weather, S.ASKING),
    TableRow(S.ASKING, WeatherReported, unsafe_and_skipped, lose_to_weather, S.WAITING),
    TableRow(S.ASKING, WeatherReported, unsafe_and_too_late, lose_to_weather, S.WAITING),
    TableRow(S.ASKING, WeatherReported, unsafe_for_long, hold_at_park, S.PARKING),
    TableRow(S.ASKING, WeatherReported, unsafe, hold, S.HOLDING),
    TableRow(S.ASKING, WeatherReported, more_before, first_action, S.READYING),
    TableRow(S.ASKING, WeatherReported, worth_following, follow, S.FOLLOWING),
    TableRow(S.ASKING, WeatherReported, always, lose_missed, S.WAITING),
    TableRow(S.HOLDING, Due, always, ask_weather, S.ASKING),
    TableRow(S.READYING, StepDone, failed_and_skips, lose_to_action, S.WAITING),
    TableRow(S.READYING, StepDone, another_before, next_action, S.READYING),
    TableRow(S.READYING, StepDone, worth_following, follow, S.FOLLOWING),
    TableRow(S.READYING, StepDone, always, lose_to_delay, S.WAITING),
    TableRow(S.READYING, Due, worth_following, follow, S.FOLLOWING),
    TableRow(S.READYING, Due, always, lose_to_delay, S.WAITING),
    # A pass.
    TableRow(S.FOLLOWING, Followed, operator_stopped, stop_in_pass, S.STOPPED),
    TableRow(S.FOLLOWING, Followed, broke_off_early, follow_on, S.FOLLOWING),
    TableRow(S.FOLLOWING, Followed, more_after, end_pass, S.FINISHING),
    TableRow(S.FOLLOWING, Followed, always, end_pass, S.WAITING),
    TableRow(S.FINISHING, StepDone, another_after, next_action, S.FINISHING),
    TableRow(S.FINISHING, StepDone, always, look, S.WAITING),
    TableRow(S.FINISHING, Due, always, look, S.WAITING),
    # The mount parked, the morning.
    TableRow(S.PARKING, Parked, not_parked, pause, S.PAUSING),
    TableRow(S.PARKING, Parked, passes_left, look_parked, S.WAITING),
    TableRow(S.PARKING, Parked, always, sum_up, S.SUMMING_UP),
    TableRow(S.PAUSING, Due, always, park_again, S.PARKING),
    TableRow(S.SUMMING_UP, SummedUp, was_the_last, end, S.ENDED),
    TableRow(S.SUMMING_UP, SummedUp, always, rest, S.RESTING),
    TableRow(S.RESTING, Due, before_the_night, rest_until_the_night, S.RESTING),
    TableRow(S.RESTING, Due, always, make_plan, S.PLANNING),
    # Whatever is waited for, time may jump.
    *(TableRow(state, ClockSet, always, wait_anew, state) for state in _WAITING_STATES),
    *(TableRow(state, StopAsked, always, stop, S.STOPPED) for state in RunState),
)


class NoRowError(Exception):
    """An event came in a state that has no row for it: a defect of the machine's caller."""


def step(run: Run, event: Event) -> tuple[Run, Order]:
    """Return what is known after an event, and what to do next. Raises NoRowError."""
    if isinstance(event, Started):
        end_before, run = run.settings.to_utc_s, replace(run, settings=event.settings)
        if event.recovered is not None:
            run = recovered_night(run, event.recovered, event.utc_s)
        elif not run_begun(run, event.utc_s):
            first_utc_s = run.first_utc_s if run.night else event.utc_s
            run = first_night(replace(run, first_utc_s=first_utc_s), event.utc_s)
        elif end_before != run.settings.to_utc_s:
            run = with_settings(run, event.settings)
    if isinstance(event, Started | ClockSet):
        run = _near(run, event)
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


def text_of(function: Judge | Change) -> str:
    """Return what a condition or an action is in words: its description's first line."""
    return (function.__doc__ or "").strip().splitlines()[0].rstrip(".")
