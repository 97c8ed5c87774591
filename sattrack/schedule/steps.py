"""The actions of the machine's rows; each says in its first line what the table says of it."""

from __future__ import annotations

from msgspec.structs import replace

from sattrack.schedule.night import (
    AskWeather,
    ClockSet,
    Doing,
    DoStep,
    End,
    Follow,
    Followed,
    Happening,
    Laid,
    LayDown,
    MakePlan,
    Mount,
    NotPlanned,
    Over,
    Planned,
    Prepare,
    Prepared,
    Reread,
    Result,
    Run,
    Started,
    State,
    StepDone,
    StopAsked,
    SummedUp,
    SumUp,
    Wait,
    WeatherTold,
    actions_of,
    at_of,
    next_night,
    prepared_from_s,
    stepped,
    with_ways,
)
from sattrack.schedule.summary import go_of, held_words, result_of

TRY_PLAN_AGAIN_S = 600.0
TRY_PARK_AGAIN_S = 60.0
LONGEST_PAUSE_S = 30.0
"""Before a session that broke off is begun again: 1 s at first, then twice as long each time."""
"""Share of a pass that must have been on target for "done"."""


def make_plan(run: Run, _: Happening) -> tuple[Run, Doing]:
    """Make the night's plan."""
    return run, MakePlan()


def make_plan_anew(run: Run, event: Happening) -> tuple[Run, Doing]:
    """Plan anew what is not over."""
    assert isinstance(event, Reread)
    return with_ways(run, event.ways), MakePlan()


def rest_anew(run: Run, event: Happening) -> tuple[Run, Doing]:
    """Take what it says, and wait for the next night."""
    assert isinstance(event, Reread)
    return rest_until_the_night(with_ways(run, event.ways), event)


def try_again_later(run: Run, event: Happening) -> tuple[Run, Doing]:
    """Tell why, and try again in ten minutes."""
    words = event.words if isinstance(event, NotPlanned) else None
    told = None if words is None else f"no plan: {words}"
    if told is not None and run.notes and run.notes[-1] == told:
        told = None
    return replace(run, told=told), Wait(until_utc_s=event.utc_s + TRY_PLAN_AGAIN_S)


def take_plan(run: Run, event: Happening) -> tuple[Run, Doing]:
    """Take the plan, for what is not over."""
    assert isinstance(event, Planned)
    # What has a result already is not followed again.
    kept = run.passes[: len(run.results)]
    over = (*run.over, *(Over(one.elements.catalog_number, one.culminate_utc_s) for one in kept))
    left = [one for one in event.passes if not any(each.is_pass(one) for each in over)]
    new = [replace(one, number=len(kept) + k) for k, one in enumerate(left, start=1)]
    count = len(new)
    told = f"night {run.night}: {count} {'pass' if count == 1 else 'passes'} planned" + (
        f"; {event.words}" if event.words else ""
    )
    notes = run.notes if run.noted_night == run.night else ()
    run = replace(run, passes=(*kept, *new), others=event.others, notes=notes, told=told)
    return _fresh(run), Wait(until_utc_s=event.utc_s)


def look(run: Run, event: Happening) -> tuple[Run, Doing]:
    """See what is next."""
    run = replace(run, told=run.told or _failure(run, event))
    return _fresh(run), Wait(until_utc_s=event.utc_s)


def wait(run: Run, event: Happening) -> tuple[Run, Doing]:
    """Wait until it is to be prepared, or until the mount is to be sent to its park position again."""
    until, again = prepared_from_s(run), run.laid_utc_s + run.ways.rest_after_s
    if run.mount is Mount.AT_PARK and event.utc_s < again < until - run.ways.rest_after_s:
        until = again
    return run, Wait(until_utc_s=until)


def wait_anew(run: Run, event: Happening) -> tuple[Run, Doing]:
    """Tell it, and look at the clock again."""
    assert isinstance(event, ClockSet)
    hours = abs(event.seconds) / 3600.0
    size = f"{hours:.2f} h" if hours >= 0.5 else f"{abs(event.seconds):.0f} s"
    if event.slept:
        words = f"the computer slept for {size}"
    else:
        words = f"the computer's clock was set {'ahead' if event.seconds > 0.0 else 'back'} by {size}"
    until = event.utc_s
    if run.state is State.RESTING:
        until = max(until, run.night_from_utc_s)
    elif run.state is State.PAUSING:
        until += TRY_PARK_AGAIN_S
    return replace(run, told=words), Wait(until_utc_s=until)


def prepare(run: Run, _: Happening) -> tuple[Run, Doing]:
    """Prepare it."""
    return run, Prepare(index=len(run.results), wake=run.mount is Mount.PARKED)


def ask_weather(run: Run, event: Happening) -> tuple[Run, Doing]:
    """Ask about the weather."""
    if isinstance(event, Prepared):
        run = replace(run, told=event.words)
        if event.woken:
            run = replace(run, mount=Mount.AT_REST)
        if event.elements is not None:
            run = _with_elements(run, event)
    return run, AskWeather()


def hold(run: Run, event: Happening) -> tuple[Run, Doing]:
    """Ask again later."""
    assert isinstance(event, WeatherTold)
    told = None if run.weather == event.words else f"{at_of(run).name}: the weather is unsafe: {event.words}"
    run = replace(run, weather=event.words, told=told)
    return run, Wait(until_utc_s=event.utc_s + run.ways.weather_every_s)


def first_action(run: Run, event: Happening) -> tuple[Run, Doing]:
    """Begin with what is done before it."""
    run = replace(run, weather=event.words if isinstance(event, WeatherTold) else None, step=0)
    return _moving(run), DoStep(index=len(run.results), when="before", step=0)


def next_action(run: Run, event: Happening) -> tuple[Run, Doing]:
    """Tell what went wrong, and do the next."""
    return _action(run, event, run.step + 1, _failure(run, event))


def same_action(run: Run, event: Happening) -> tuple[Run, Doing]:
    """Do it again."""
    return _action(run, event, run.step, None)


def next_action_untold(run: Run, event: Happening) -> tuple[Run, Doing]:
    """Do not repeat it: go on with what follows."""
    words = f"{actions_of(run)[run.step].words}: cut off by a restart, not repeated"
    # What is next is seen as if this one had ended.
    return _action(run, event, run.step + 1, words)


def follow(run: Run, event: Happening) -> tuple[Run, Doing]:
    """Follow it."""
    failed = _failure(run, event) if isinstance(event, StepDone) else None
    weather = event.words if isinstance(event, WeatherTold) else run.weather
    run = replace(run, weather=weather, told=failed, part=1, goes=(), part_from_utc_s=event.utc_s)
    return _moving(run), Follow(index=len(run.results), part=1, from_utc_s=event.utc_s)


def follow_on(run: Run, event: Happening) -> tuple[Run, Doing]:
    """Follow what is left of it."""
    go = go_of(event)
    words = "the runner was restarted" if isinstance(event, Started) else f"{go.words or go.ended_by}"
    part = run.part + 1
    told = f"{at_of(run).name}: {words}: following on, part {part}"
    run = replace(run, goes=(*run.goes, go), part=part, part_from_utc_s=event.utc_s, told=told)
    pause_s = 0.0 if isinstance(event, Started) else min(LONGEST_PAUSE_S, 2.0 ** (len(run.goes) - 1))
    order = Follow(index=len(run.results), part=part, from_utc_s=event.utc_s, pause_s=pause_s)
    return _moving(run), order


def end_pass(run: Run, event: Happening) -> tuple[Run, Doing]:
    """Note what became of it."""
    assert isinstance(event, Followed)
    run = _with_result(run, result_of(at_of(run), (*run.goes, event.go)))
    return _after_pass(run, event)


def end_cut_off(run: Run, event: Happening) -> tuple[Run, Doing]:
    """Note what became of it, as far as anybody knows."""
    run = _with_result(run, result_of(at_of(run), (*run.goes, go_of(event))))
    return _after_pass(run, event)


def stop_in_pass(run: Run, event: Happening) -> tuple[Run, Doing]:
    """End: nothing is moved any more."""
    assert isinstance(event, Followed)
    run = _with_result(run, result_of(at_of(run), (*run.goes, event.go)))
    why = event.go.words or "stopped by the operator"
    return _fresh(run), End(why=why, interrupted=True)


def lose_missed(run: Run, event: Happening) -> tuple[Run, Doing]:
    """Lose it: it was missed."""
    late_s = event.utc_s - at_of(run).start_utc_s
    words = f"nothing could begin it until {late_s:.0f} s after its start"
    return _lose(run, event, "missed", words)


def lose_to_restart(run: Run, event: Happening) -> tuple[Run, Doing]:
    """Lose it: the runner was restarted too late."""
    return _lose(run, event, "missed", "the runner was restarted too late for it")


def lose_to_delay(run: Run, event: Happening) -> tuple[Run, Doing]:
    """Lose it: what is done before it took too long."""
    return _lose(run, event, "delay", _wrong(run, event) or "what is done before it took too long")


def lose_unprepared(run: Run, event: Happening) -> tuple[Run, Doing]:
    """Lose it to what kept it from being taken."""
    assert isinstance(event, Prepared)
    return _lose(run, event, event.cause or "error", event.words)


def lose_to_weather(run: Run, event: Happening) -> tuple[Run, Doing]:
    """Lose it to the weather."""
    assert isinstance(event, WeatherTold)
    return _lose(replace(run, weather=event.words), event, "weather", event.words)


def lose_to_action(run: Run, event: Happening) -> tuple[Run, Doing]:
    """Lose it to what failed before it."""
    return _lose(run, event, "command", _wrong(run, event))


def lay_down(run: Run, _: Happening) -> tuple[Run, Doing]:
    """Let the mount wait at its park position, drives on."""
    return replace(run, tries=1), LayDown(power_off=False)


def lay_down_for_the_day(run: Run, _: Happening) -> tuple[Run, Doing]:
    """Park the mount: at its park position, the drives' power cut."""
    return replace(run, tries=1), LayDown(power_off=True)


def lay_down_anew(run: Run, event: Happening) -> tuple[Run, Doing]:
    """Begin that again."""
    return lay_down_again(replace(run, tries=0), event)


def lay_down_again(run: Run, _: Happening) -> tuple[Run, Doing]:
    """Try again."""
    return replace(run, tries=run.tries + 1), LayDown(power_off=run.at is None)


def pause(run: Run, event: Happening) -> tuple[Run, Doing]:
    """Tell it, and try again in a minute."""
    assert isinstance(event, Laid)
    run = replace(run, mount=event.mount, told=f"the mount is not parked: {event.words}")
    return run, Wait(until_utc_s=event.utc_s + TRY_PARK_AGAIN_S)


def look_laid_down(run: Run, event: Happening) -> tuple[Run, Doing]:
    """See what is next."""
    run = _laid(run, event)
    if run.mount is Mount.AT_REST:
        # It was tried often enough: not again until the mount has moved.
        run = replace(run, mount=Mount.UNKNOWN)
    return look(run, event)


def sum_up(run: Run, event: Happening) -> tuple[Run, Doing]:
    """Write the night's summary."""
    return _laid(run, event), SumUp()


def rest(run: Run, event: Happening) -> tuple[Run, Doing]:
    """Wait for the next night."""
    if isinstance(event, SummedUp):
        run = replace(run, summary=event.file or run.summary, told=event.words)
        run = next_night(run, event.utc_s)
    return run, Wait(until_utc_s=run.night_from_utc_s)


def go_on(run: Run, event: Happening) -> tuple[Run, Doing]:
    """Go on with another night: the run's end was put off."""
    run = next_night(run, event.utc_s)
    return run, Wait(until_utc_s=run.night_from_utc_s)


def rest_until_the_night(run: Run, _: Happening) -> tuple[Run, Doing]:
    """Wait for the night."""
    return run, Wait(until_utc_s=run.night_from_utc_s)


def stop(run: Run, event: Happening) -> tuple[Run, Doing]:
    """End: nothing is moved any more."""
    assert isinstance(event, StopAsked)
    return run, End(why=event.words, interrupted=True)


def end(run: Run, event: Happening) -> tuple[Run, Doing]:
    """End."""
    if isinstance(event, SummedUp):
        run = replace(run, summary=event.file or run.summary, told=event.words)
    return run, End(why="all nights are over")


def _fresh(run: Run) -> Run:
    """Return the run with nothing begun of the next pass."""
    return replace(run, step=0, part=0, goes=(), tries=0)


def _action(run: Run, event: Happening, place: int, told: str | None) -> tuple[Run, Doing]:
    """Return the order for an action, or what follows where there is none at that place."""
    run = replace(run, step=place, told=told)
    finishing = run.state is State.FINISHING
    if place < len(actions_of(run)):
        index = len(run.results) - (1 if finishing else 0)
        return _moving(run), DoStep(index=index, when="after" if finishing else "before", step=place)
    return run, Wait(until_utc_s=event.utc_s)


def _moving(run: Run) -> Run:
    return replace(run, mount=Mount.AT_REST)


def _failure(run: Run, event: Happening) -> str | None:
    words = _wrong(run, event)
    return None if words is None else f"{stepped(run).name}: {words}"


def _wrong(run: Run, event: Happening) -> str | None:
    if isinstance(event, StepDone) and not event.done:
        return f"{actions_of(run)[run.step].words}: {event.words}"
    return None


def _laid(run: Run, event: Happening) -> Run:
    if not isinstance(event, Laid):
        return run
    told = event.words if event.mount in (Mount.AT_PARK, Mount.PARKED) else f"NOT PARKED: {event.words}"
    return replace(run, mount=event.mount, laid_utc_s=event.utc_s, told=told)


def _with_elements(run: Run, event: Prepared) -> Run:
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
    return replace(run, results=(*run.results, result), told=words)


def _lose(run: Run, event: Happening, cause: str, words: str | None) -> tuple[Run, Doing]:
    run = _with_result(run, Result("lost", cause, words))
    return _fresh(run), Wait(until_utc_s=event.utc_s)


def _after_pass(run: Run, event: Happening) -> tuple[Run, Doing]:
    place = len(run.results) - 1
    run = _fresh(run)
    if run.passes[place].terms.after:
        return run, DoStep(index=place, when="after", step=0)
    return run, Wait(until_utc_s=event.utc_s)
