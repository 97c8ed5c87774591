"""The runner of a schedule as a table: in a state, at an event, on a condition: what to do, the next state.

Pure: from what is known and an event, `step` gives what is known then and what to do. The driver keeps every
event before it acts on what follows; the same events give the same again, which is how a run continues after
its end at any instant. Instants are POSIX seconds of UTC. Actions say in their first lines what the
table in the documentation says of them; so do the conditions (`conditions.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

from msgspec.structs import replace

from sattrack.schedule import conditions as when
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
    decided_since,
    first_night,
    near_night,
    next_night,
    prepared_from_s,
    recovered_night,
    run_begun,
    stepped,
    with_settings,
)
from sattrack.schedule.summary import attempt_of, limits_text, result_of

if TYPE_CHECKING:
    from collections.abc import Callable

    Judge = Callable[[Run, Any], bool]
    """The event is of the row's type."""
    Change = Callable[[Run, Any], tuple[Run, Order]]

REVISION = 4
"""Of these rules: what an earlier one decided in a journal is decided again by that."""
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
    until, again = prepared_from_s(run), when.sent_again_s(run, event.utc_s)
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
    return replace(run, waking=wake and decided_since(run, 3)), Prepare(index=len(run.results), wake=wake)


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
    run = _woken(run, event) if decided_since(run, 3) else run
    return _lose(run, event, event.cause or "error", event.words)


def lose_to_weather(run: Run, event: WeatherReported) -> tuple[Run, Order]:
    """Lose it to the weather."""
    return _lose(replace(run, weather=event.words), event, "weather", event.words)


def lose_to_action(run: Run, event: Event) -> tuple[Run, Order]:
    """Lose it to what failed before it."""
    return _lose(run, event, "command", _wrong(run, event))


def finish(run: Run, event: Event) -> tuple[Run, Order]:
    """Lose it to that, and begin with the actions after it."""
    if isinstance(event, WeatherReported):
        run, _ = lose_to_weather(run, event)
    elif isinstance(event, Started):
        run, _ = lose_to_restart(run, event)
    elif isinstance(event, StepDone) and when.failed_and_skips(run, event):
        run, _ = lose_to_action(run, event)
    else:
        run, _ = lose_to_delay(run, event)
    return _after_pass(run, event)


def wait_at_park(run: Run, _: Event) -> tuple[Run, Order]:
    """Let the mount wait at its park position, drives on."""
    # What has failed often is tried once each time: a pass is not to be late for it.
    tries = when.MOST_PARK_TRIES if run.mount is Mount.UNKNOWN else 1
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
    return near_night(run, event.utc_s) if decided_since(run, 2) else run


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
    TableRow(S.PLANNING, Started, when.before_the_night, rest_until_the_night, S.RESTING),
    TableRow(S.PLANNING, Started, when.night_is_over_with_passes, look, S.WAITING),
    TableRow(S.PLANNING, Started, when.night_is_over, sum_up, S.SUMMING_UP),
    TableRow(S.PLANNING, Started, when.always, make_plan, S.PLANNING),
    TableRow(S.PLANLESS, Started, when.always, try_again_later, S.PLANLESS),
    TableRow(S.WAITING, Started, when.always, look, S.WAITING),
    TableRow(S.PREPARING, Started, when.always, look, S.WAITING),
    TableRow(S.ASKING, Started, when.always, look, S.WAITING),
    TableRow(S.HOLDING, Started, when.always, look, S.WAITING),
    TableRow(S.READYING, Started, when.lost_with_more_after, finish, S.FINISHING),
    TableRow(S.READYING, Started, when.action_may_not_come_twice, next_action_untold, S.READYING),
    TableRow(S.READYING, Started, when.more_before, same_action, S.READYING),
    TableRow(S.READYING, Started, when.worth_following, follow, S.FOLLOWING),
    TableRow(S.READYING, Started, when.always, lose_to_restart, S.WAITING),
    TableRow(S.FOLLOWING, Started, when.worth_another_attempt, follow_on, S.FOLLOWING),
    TableRow(S.FOLLOWING, Started, when.always, end_cut_off, S.FINISHING),
    TableRow(S.FINISHING, Started, when.action_may_not_come_twice, next_action_untold, S.FINISHING),
    TableRow(S.FINISHING, Started, when.more_after, same_action, S.FINISHING),
    TableRow(S.FINISHING, Started, when.always, look, S.WAITING),
    TableRow(S.PARKING, Started, when.always, park_anew, S.PARKING),
    TableRow(S.PAUSING, Started, when.always, park_anew, S.PARKING),
    TableRow(S.SUMMING_UP, Started, when.always, sum_up, S.SUMMING_UP),
    TableRow(S.RESTING, Started, when.always, rest, S.RESTING),
    TableRow(S.STOPPED, Started, when.before_the_night, rest_until_the_night, S.RESTING),
    TableRow(S.STOPPED, Started, when.has_a_plan, look, S.WAITING),
    TableRow(S.STOPPED, Started, when.always, make_plan, S.PLANNING),
    TableRow(S.ENDED, Started, when.was_the_last, end, S.ENDED),
    TableRow(S.ENDED, Started, when.always, go_on, S.RESTING),
    # The night's plan.
    TableRow(S.PLANNING, Planned, when.always, take_plan, S.WAITING),
    TableRow(S.PLANNING, NotPlanned, when.plan_in_force, keep_plan, S.WAITING),
    TableRow(S.PLANNING, NotPlanned, when.always, try_again_later, S.PLANLESS),
    TableRow(S.PLANLESS, Due, when.night_is_over_with_passes, look, S.WAITING),
    TableRow(S.PLANLESS, Due, when.night_is_over_to_park, park, S.PARKING),
    TableRow(S.PLANLESS, Due, when.night_is_over, sum_up, S.SUMMING_UP),
    TableRow(S.PLANLESS, Due, when.always, make_plan, S.PLANNING),
    # The schedule's file was read again.
    TableRow(S.WAITING, Reread, when.always, make_plan_anew, S.PLANNING),
    TableRow(S.PLANLESS, Reread, when.always, make_plan_anew, S.PLANNING),
    TableRow(S.RESTING, Reread, when.always, rest_anew, S.RESTING),
    # Between passes.
    TableRow(S.WAITING, Due, when.passes_past_the_end, make_plan, S.PLANNING),
    TableRow(S.WAITING, Due, when.none_left_to_park, park, S.PARKING),
    TableRow(S.WAITING, Due, when.none_left, sum_up, S.SUMMING_UP),
    TableRow(S.WAITING, Due, when.missed, lose_missed, S.WAITING),
    TableRow(S.WAITING, Due, when.long_to_wait, wait_at_park, S.PARKING),
    TableRow(S.WAITING, Due, when.too_early, wait, S.WAITING),
    TableRow(S.WAITING, Due, when.always, prepare, S.PREPARING),
    # Before a pass.
    TableRow(S.PREPARING, PassPrepared, when.cannot_be_taken, lose_unprepared, S.WAITING),
    TableRow(S.PREPARING, PassPrepared, when.always, ask_weather, S.ASKING),
    TableRow(S.ASKING, WeatherReported, when.unsafe_and_skipped, lose_to_weather, S.WAITING),
    TableRow(S.ASKING, WeatherReported, when.unsafe_and_too_late, lose_to_weather, S.WAITING),
    TableRow(S.ASKING, WeatherReported, when.unsafe_for_long, hold_at_park, S.PARKING),
    TableRow(S.ASKING, WeatherReported, when.unsafe, hold, S.HOLDING),
    TableRow(S.ASKING, WeatherReported, when.more_before, first_action, S.READYING),
    TableRow(S.ASKING, WeatherReported, when.worth_following, follow, S.FOLLOWING),
    TableRow(S.ASKING, WeatherReported, when.always, lose_missed, S.WAITING),
    TableRow(S.HOLDING, Due, when.always, ask_weather, S.ASKING),
    # It turned before an action.
    TableRow(S.READYING, WeatherReported, when.lost_with_more_after, finish, S.FINISHING),
    TableRow(S.READYING, WeatherReported, when.begun_before, lose_to_weather, S.WAITING),
    TableRow(S.READYING, WeatherReported, when.unsafe_and_skipped, lose_to_weather, S.WAITING),
    TableRow(S.READYING, WeatherReported, when.unsafe_and_too_late, lose_to_weather, S.WAITING),
    TableRow(S.READYING, WeatherReported, when.unsafe_for_long, hold_at_park, S.PARKING),
    TableRow(S.READYING, WeatherReported, when.always, hold, S.HOLDING),
    TableRow(S.READYING, StepDone, when.lost_with_more_after, finish, S.FINISHING),
    TableRow(S.READYING, StepDone, when.failed_and_skips, lose_to_action, S.WAITING),
    TableRow(S.READYING, StepDone, when.another_before, next_action, S.READYING),
    TableRow(S.READYING, StepDone, when.worth_following, follow, S.FOLLOWING),
    TableRow(S.READYING, StepDone, when.always, lose_to_delay, S.WAITING),
    TableRow(S.READYING, Due, when.lost_with_more_after, finish, S.FINISHING),
    TableRow(S.READYING, Due, when.worth_following, follow, S.FOLLOWING),
    TableRow(S.READYING, Due, when.always, lose_to_delay, S.WAITING),
    # A pass.
    TableRow(S.FOLLOWING, Followed, when.operator_stopped, stop_in_pass, S.STOPPED),
    TableRow(S.FOLLOWING, Followed, when.broke_off_early, follow_on, S.FOLLOWING),
    TableRow(S.FOLLOWING, Followed, when.more_after, end_pass, S.FINISHING),
    TableRow(S.FOLLOWING, Followed, when.always, end_pass, S.WAITING),
    TableRow(S.FINISHING, StepDone, when.another_after, next_action, S.FINISHING),
    TableRow(S.FINISHING, StepDone, when.always, look, S.WAITING),
    TableRow(S.FINISHING, Due, when.always, look, S.WAITING),
    # The mount parked, the morning.
    TableRow(S.PARKING, Parked, when.not_parked, pause, S.PAUSING),
    TableRow(S.PARKING, Parked, when.passes_left, look_parked, S.WAITING),
    TableRow(S.PARKING, Parked, when.always, sum_up, S.SUMMING_UP),
    TableRow(S.PAUSING, Due, when.always, park_again, S.PARKING),
    TableRow(S.SUMMING_UP, SummedUp, when.was_the_last, end, S.ENDED),
    TableRow(S.SUMMING_UP, SummedUp, when.always, rest, S.RESTING),
    TableRow(S.RESTING, Due, when.before_the_night, rest_until_the_night, S.RESTING),
    TableRow(S.RESTING, Due, when.always, make_plan, S.PLANNING),
    # Whatever is waited for, time may jump.
    *(TableRow(state, ClockSet, when.always, wait_anew, state) for state in _WAITING_STATES),
    *(TableRow(state, StopAsked, when.always, stop, S.STOPPED) for state in RunState),
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
