"""The actions of the machine's rows; each says in its first line what the table says of it."""

from __future__ import annotations

from msgspec.structs import replace

from sattrack.schedule.night import (
    AskWeather,
    ClockSet,
    DoStep,
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
    next_night,
    prepared_from_s,
    stepped,
    with_settings,
)
from sattrack.schedule.summary import attempt_of, held_words, result_of

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
    return rest_until_the_night(with_settings(run, event.settings), event)


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
    over = (*run.over, *(FinishedPass(one.elements.catalog_number, one.culminate_utc_s) for one in kept))
    left = [one for one in event.passes if not any(each.is_pass(one) for each in over)]
    new = [replace(one, number=len(kept) + k) for k, one in enumerate(left, start=1)]
    count = len(new)
    message = f"night {run.night}: {count} {'pass' if count == 1 else 'passes'} planned" + (
        f"; {event.words}" if event.words else ""
    )
    notes = run.notes if run.noted_night == run.night else ()
    run = replace(run, passes=(*kept, *new), others=event.others, notes=notes, message=message)
    return _fresh(run), Wait(until_utc_s=event.utc_s)


def look(run: Run, event: Event) -> tuple[Run, Order]:
    """See what is next."""
    run = replace(run, message=run.message or _failure(run, event))
    return _fresh(run), Wait(until_utc_s=event.utc_s)


def wait(run: Run, event: Event) -> tuple[Run, Order]:
    """Wait until it must be prepared, or the mount sent to its park position again."""
    until, again = prepared_from_s(run), run.parked_utc_s + run.settings.rest_after_s
    if run.mount is Mount.AT_PARK and event.utc_s < again < until - run.settings.rest_after_s:
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
    return run, Prepare(index=len(run.results), wake=run.mount is Mount.PARKED)


def ask_weather(run: Run, event: Event) -> tuple[Run, Order]:
    """Ask about the weather."""
    if isinstance(event, PassPrepared):
        run = replace(run, message=event.words)
        if event.woken:
            run = replace(run, mount=Mount.AT_REST)
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


def first_action(run: Run, event: Event) -> tuple[Run, Order]:
    """Begin with the actions before it."""
    run = replace(run, weather=event.words if isinstance(event, WeatherReported) else None, step=0)
    return _moving(run), DoStep(index=len(run.results), when="before", step=0)


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
    return _moving(run), Follow(index=len(run.results), part=1, from_utc_s=event.utc_s)


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
    return _moving(run), order


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
    return _lose(run, event, event.cause or "error", event.words)


def lose_to_weather(run: Run, event: WeatherReported) -> tuple[Run, Order]:
    """Lose it to the weather."""
    return _lose(replace(run, weather=event.words), event, "weather", event.words)


def lose_to_action(run: Run, event: Event) -> tuple[Run, Order]:
    """Lose it to what failed before it."""
    return _lose(run, event, "command", _wrong(run, event))


def wait_at_park(run: Run, _: Event) -> tuple[Run, Order]:
    """Let the mount wait at its park position, drives on."""
    return replace(run, tries=1), ParkMount(power_off=False)


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
        # It was tried often enough: not again until the mount has moved.
        run = replace(run, mount=Mount.UNKNOWN)
    return look(run, event)


def sum_up(run: Run, event: Event) -> tuple[Run, Order]:
    """Write the night's summary."""
    return _parked(run, event), SumUp()


def rest(run: Run, event: Event) -> tuple[Run, Order]:
    """Wait for the next night."""
    if isinstance(event, SummedUp):
        run = replace(run, summary=event.file or run.summary, message=event.words)
        run = next_night(run, event.utc_s)
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


def _fresh(run: Run) -> Run:
    """Return the run with nothing begun of the next pass."""
    return replace(run, step=0, part=0, attempts=(), tries=0)


def _action(run: Run, event: Event, place: int, message: str | None) -> tuple[Run, Order]:
    """Return the order for an action, or what follows where there is none at that place."""
    run = replace(run, step=place, message=message)
    finishing = run.state is RunState.FINISHING
    if place < len(actions_of(run)):
        index = len(run.results) - (1 if finishing else 0)
        return _moving(run), DoStep(index=index, when="after" if finishing else "before", step=place)
    return run, Wait(until_utc_s=event.utc_s)


def _moving(run: Run) -> Run:
    return replace(run, mount=Mount.AT_REST)


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
    held = held_words(result)
    words += f"; {held}" if held else ""
    return replace(run, results=(*run.results, result), message=words)


def _lose(run: Run, event: Event, cause: str, words: str | None) -> tuple[Run, Order]:
    run = _with_result(run, Result("lost", cause, words))
    return _fresh(run), Wait(until_utc_s=event.utc_s)


def _after_pass(run: Run, event: Event) -> tuple[Run, Order]:
    place = len(run.results) - 1
    run = _fresh(run)
    if run.passes[place].terms.after:
        return run, DoStep(index=place, when="after", step=0)
    return run, Wait(until_utc_s=event.utc_s)
