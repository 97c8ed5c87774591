"""The runner's machine: rows for whatever may happen, every pass accounted for, taken up after any end."""

from __future__ import annotations

import dataclasses
from random import Random

import msgspec
import pytest
from msgspec.structs import replace
from night_draws import BEGIN, World, drawn_passes, settings

from sattrack.schedule import machine
from sattrack.schedule.night import (
    AskWeather,
    ClockSet,
    DoStep,
    Due,
    End,
    Event,
    Follow,
    Followed,
    MakePlan,
    Mount,
    NightPass,
    NotPlanned,
    Parked,
    ParkMount,
    PassAttempt,
    PassPrepared,
    Planned,
    Prepare,
    Result,
    Run,
    RunSettings,
    RunState,
    Started,
    StepDone,
    StopAsked,
    SummedUp,
    Wait,
    WeatherReported,
)
from sattrack.schedule.schema import CommandAction, Terms
from tle.instants import Utc

NIGHTS = 3.0


def started(world: World, at: RunSettings, last: float | None = None) -> Started:
    return Started(utc_s=world.now, settings=at, last_utc_s=last)


def carried_out(world: World, at: RunSettings, ends: Random | None = None) -> tuple[Run, list[Run]]:
    """Run to the end; with `ends`, the runner dies now and then: before an order, or with it half done."""
    run, order = machine.step(Run(), started(world, at))
    nights: list[Run] = []
    for _ in range(20_000):
        if isinstance(order, End):
            return run, nights
        if ends is not None and ends.random() < 0.15:
            half_done = ends.random() < 0.5
            if half_done:
                world.answer(order, run)
            last = world.now
            world.now += ends.choice((5.0, 5.0, 5.0, 300.0, 4000.0))
            event: Event = started(world, at, last)
        else:
            event = world.answer(order, run)
        before = run
        run, order = machine.step(run, event)
        if run.state is RunState.SUMMING_UP and before.state is not RunState.SUMMING_UP:
            nights.append(run)
    raise AssertionError("it does not end")


@pytest.mark.parametrize("dies", [False, True])
def test_every_pass_of_every_night_ends_done_or_lost_to_a_named_cause(dies: bool) -> None:
    planned = 0
    for seed in range(60):
        world = World(seed)
        _, nights = carried_out(world, settings(NIGHTS), Random(seed) if dies else None)
        for night in nights:
            planned += len(night.passes)
            assert len(night.results) == len(night.passes)
            for result in night.results:
                assert result.state in ("done", "partly", "lost")
                assert result.state == "done" or result.cause
    assert planned > 400


@pytest.mark.parametrize("dies", [False, True])
def test_the_mount_is_parked_at_each_nights_end_as_far_as_it_obeys(dies: bool) -> None:
    for seed in range(40):
        world = World(seed, harm=0.1)
        _, nights = carried_out(world, settings(NIGHTS), Random(seed) if dies else None)
        assert nights
        for night in nights:
            if night.passes:
                assert night.mount is Mount.PARKED


def test_no_instant_of_a_pass_is_followed_twice_and_no_command_is_run_twice() -> None:
    for seed in range(60):
        world = World(seed, harm=0.1)
        carried_out(world, settings(NIGHTS), Random(seed))
        assert len(world.commands) == len(set(world.commands))
        keys = [key for key, _, _ in world.followed]
        # Goes at one pass come one after the other, and none comes back to it later.
        assert keys == sorted(keys, key=keys.index)


def test_without_harm_a_run_that_dies_loses_only_what_it_was_dead_for() -> None:
    for seed in range(40):
        whole = World(seed, harm=0.0)
        _, undisturbed = carried_out(whole, settings(NIGHTS))
        world = World(seed, harm=0.0)
        _, disturbed = carried_out(world, settings(NIGHTS), Random(seed))
        reached = [(night.night, len(night.passes)) for night in disturbed]
        assert reached == [(night.night, len(night.passes)) for night in undisturbed][: len(reached)]
        for one, other in zip(undisturbed, disturbed, strict=False):
            for result, again in zip(one.results, other.results, strict=True):
                assert result.state == "done"
                assert again.state == "done" or again.cause in ("restart", "missed", "delay", "late")


def test_the_same_events_lead_to_the_same_states_after_a_way_through_json() -> None:
    world = World(7)
    at = settings(NIGHTS)
    event: Event = started(world, at)
    run, order = machine.step(Run(), event)
    again = Run()
    for _ in range(20_000):
        told = msgspec.json.encode(event, enc_hook=lambda value: float(value.unix_s))
        back = msgspec.json.decode(told, type=Event, dec_hook=lambda _, value: Utc(float(value)))
        again, same = machine.step(again, back)
        assert (again, same) == (run, order)
        if isinstance(order, End):
            return
        event = world.answer(order, run)
        run, order = machine.step(run, event)
    raise AssertionError("it does not end")


def test_every_state_knows_what_to_do_after_a_restart_and_when_asked_to_stop() -> None:
    for state in RunState:
        rows = [row for row in machine.TABLE if row.state is state]
        for event in (Started, StopAsked):
            last = [row for row in rows if row.event is event]
            assert last, f"{state} {event.__name__}"
            assert machine.text_of(last[-1].condition) == "Otherwise"
        for kind in {row.event for row in rows}:
            fallback = [row for row in rows if row.event is kind][-1]
            assert machine.text_of(fallback.condition) == "Otherwise"
    for row in machine.TABLE:
        assert machine.text_of(row.condition)
        assert machine.text_of(row.action)


def one_pass(**terms: object) -> NightPass:
    (first, *_) = drawn_passes(Random(1), 1, BEGIN + 3000.0, BEGIN + 80000.0)
    return replace(first, terms=Terms(**terms))  # type: ignore[arg-type]


def waiting_for(one: NightPass) -> Run:
    run, order = machine.step(Run(), Started(utc_s=BEGIN, settings=settings(1.0)))
    assert isinstance(order, MakePlan)
    run, order = machine.step(run, Planned(utc_s=BEGIN, passes=(one,)))
    assert isinstance(order, Wait)
    return run


def following(one: NightPass) -> Run:
    run = waiting_for(one)
    run, _ = machine.step(run, Due(utc_s=one.leave_utc_s - 10.0))
    run, order = machine.step(run, PassPrepared(utc_s=one.leave_utc_s - 9.0))
    assert isinstance(order, AskWeather)
    run, order = machine.step(run, WeatherReported(utc_s=one.leave_utc_s - 8.0, safe=None))
    assert isinstance(order, Follow)
    return run


def test_a_pass_in_progress_is_followed_on_after_a_restart_while_it_is_up() -> None:
    one = one_pass()
    run = following(one)
    again = Started(
        utc_s=one.start_utc_s + 30.0,
        settings=settings(1.0),
        last_utc_s=one.start_utc_s + 20.0,
        on_target_s=19.0,
    )
    run, order = machine.step(run, again)
    assert isinstance(order, Follow)
    assert order.part == 2
    length = one.end_utc_s - one.start_utc_s - 30.0
    run, _ = machine.step(
        run, Followed(utc_s=one.end_utc_s, attempt=PassAttempt("set", one.end_utc_s, on_target_s=length))
    )
    (result,) = run.results
    assert result.on_target_s == pytest.approx(19.0 + length, abs=1e-3)
    assert result.lost_s == pytest.approx(11.0, abs=1e-3)
    assert result.parts == 2


def test_a_pass_that_was_over_at_the_restart_is_accounted_for_by_what_was_known() -> None:
    one = one_pass()
    run = following(one)
    again = Started(
        utc_s=one.end_utc_s + 500.0,
        settings=settings(1.0),
        last_utc_s=one.start_utc_s + 20.0,
        on_target_s=15.0,
    )
    run, order = machine.step(run, again)
    (result,) = run.results
    assert (result.state, result.cause, result.on_target_s) == ("partly", "restart", 15.0)
    assert not isinstance(order, Follow)


def test_a_command_that_was_under_way_at_the_restart_is_not_run_again() -> None:
    one = one_pass(before=(CommandAction(run=("x",)), CommandAction(run=("y",))))
    run = waiting_for(one)
    run, _ = machine.step(run, Due(utc_s=one.leave_utc_s - 10.0))
    run, _ = machine.step(run, PassPrepared(utc_s=one.leave_utc_s - 9.0))
    run, order = machine.step(run, WeatherReported(utc_s=one.leave_utc_s - 8.0, safe=True))
    assert order == DoStep(index=0, when="before", step=0)
    run, order = machine.step(run, Started(utc_s=one.leave_utc_s, settings=settings(1.0)))
    assert order == DoStep(index=0, when="before", step=1)
    assert "not repeated" in run.notes[-1]


def readying(one: NightPass) -> Run:
    run = waiting_for(one)
    run, _ = machine.step(run, Due(utc_s=one.leave_utc_s - 10.0))
    run, _ = machine.step(run, PassPrepared(utc_s=one.leave_utc_s - 9.0))
    run, order = machine.step(run, WeatherReported(utc_s=one.leave_utc_s - 8.0, safe=True))
    assert isinstance(order, DoStep)
    assert order.action_of(one) == one.terms.before[0]
    return run


def test_the_actions_before_a_pass_come_one_after_the_other_and_then_the_pass() -> None:
    one = one_pass(
        before=(CommandAction(run=("x",)), CommandAction(run=("y",))),
        after=(CommandAction(run=("z",)), CommandAction(run=("w",))),
    )
    run = readying(one)
    run, order = machine.step(run, StepDone(utc_s=one.leave_utc_s, done=True))
    assert order == DoStep(index=0, when="before", step=1)
    assert order.action_of(one) == one.terms.before[1]
    run, order = machine.step(run, StepDone(utc_s=one.leave_utc_s + 1.0, done=True))
    assert order == Follow(index=0, part=1, from_utc_s=one.leave_utc_s + 1.0)
    attempt = PassAttempt("set", one.end_utc_s, on_target_s=one.end_utc_s - one.start_utc_s)
    run, order = machine.step(run, Followed(utc_s=one.end_utc_s, attempt=attempt))
    assert order == DoStep(index=0, when="after", step=0)
    assert order.action_of(one) == one.terms.after[0]
    assert run.results[0].state == "done"
    run, order = machine.step(run, StepDone(utc_s=one.end_utc_s + 1.0, done=False, words="exit 1"))
    assert order == DoStep(index=0, when="after", step=1)
    assert run.notes[-1] == f"{one.name}: {one.terms.after[0].words}: exit 1"
    run, order = machine.step(run, StepDone(utc_s=one.end_utc_s + 2.0, done=True))
    assert order == Wait(until_utc_s=one.end_utc_s + 2.0)
    assert run.state is RunState.WAITING


def test_a_pass_that_an_action_may_cost_is_lost_to_it_in_its_words() -> None:
    one = one_pass(before=(CommandAction(run=("x",), if_it_fails="skip"),))
    run, order = machine.step(readying(one), StepDone(utc_s=one.leave_utc_s, done=False, words="exit 1"))
    assert isinstance(order, Wait)
    (result,) = run.results
    assert (result.state, result.cause) == ("lost", "command")
    assert result.words == f"{one.terms.before[0].words}: exit 1"


def test_a_pass_is_prepared_a_minute_and_a_half_before_the_mount_sets_out() -> None:
    one = one_pass()
    run, order = machine.step(replace(waiting_for(one), mount=Mount.PARKED), Due(utc_s=BEGIN + 1.0))
    assert order == Wait(until_utc_s=one.leave_utc_s - 90.0)
    _, order = machine.step(run, Due(utc_s=one.leave_utc_s - 90.0))
    assert order == Prepare(index=0, wake=True)


def test_the_same_bad_weather_is_told_once() -> None:
    first, second = drawn_passes(Random(1), 1, BEGIN + 3000.0, BEGIN + 80000.0)[:2]
    passes = [replace(one, terms=Terms(if_weather_unsafe="skip")) for one in (first, second)]
    run, _ = machine.step(Run(), Started(utc_s=BEGIN, settings=settings(1.0)))
    run, _ = machine.step(run, Planned(utc_s=BEGIN, passes=tuple(passes)))
    run, _ = machine.step(run, Due(utc_s=first.leave_utc_s - 10.0))
    run, _ = machine.step(run, PassPrepared(utc_s=first.leave_utc_s - 9.0))
    run, _ = machine.step(run, WeatherReported(utc_s=first.leave_utc_s - 8.0, safe=False, words="rain"))
    assert (run.results[0].cause, run.results[0].words, run.weather) == ("weather", "rain", "rain")


def test_after_a_night_the_next_begins_empty_and_after_the_last_the_run_ends() -> None:
    run = replace(following(one_pass()), settings=settings(2.0), others={"lost": 3})
    run = replace(run, state=RunState.SUMMING_UP, mount=Mount.PARKED, results=(Result("done"),))
    first_end = run.night_to_utc_s
    run, order = machine.step(run, SummedUp(utc_s=run.night_to_utc_s))
    assert (run.night, run.passes, run.results, run.others) == (2, (), (), {})
    assert order == Wait(until_utc_s=first_end)
    assert run.night_from_utc_s == first_end
    # The machine sleeps through all the rest.
    late = BEGIN + 40.0 * 86400.0
    run, order = machine.step(replace(run, state=RunState.SUMMING_UP), SummedUp(utc_s=late))
    while not isinstance(order, End):
        run, order = machine.step(replace(run, state=RunState.SUMMING_UP), SummedUp(utc_s=late))
        assert run.night < 5
    assert run.night_to_utc_s == settings(2.0).to_utc_s


@pytest.mark.parametrize("count", [1, 2])
def test_actions_that_last_into_the_pass_until_too_little_is_left_lose_it(count: int) -> None:
    one = one_pass(before=(CommandAction(run=("x",)),) * count, least_s=60.0)
    for left_s, order_type in ((61.0, Follow if count == 1 else DoStep), (58.0, Wait)):
        run, order = machine.step(readying(one), StepDone(utc_s=one.end_utc_s - left_s, done=True))
        assert isinstance(order, order_type)
        assert [(one.state, one.cause) for one in run.results] == (
            [("lost", "delay")] if left_s < 60.0 else []
        )


def test_a_pass_that_breaks_off_is_followed_on_after_pauses_that_grow_until_too_little_is_left() -> None:
    one = one_pass()
    one = replace(one, end_utc_s=one.start_utc_s + 600.0)
    run, pauses = following(one), []
    for k in range(8):
        at = one.start_utc_s + 10.0 * k
        run, order = machine.step(run, Followed(utc_s=at, attempt=PassAttempt("link", at, words="gone")))
        assert isinstance(order, Follow)
        pauses.append(order.pause_s)
    assert pauses == [1.0, 2.0, 4.0, 8.0, 16.0, 30.0, 30.0, 30.0]
    for left_s, goes_on in ((10.0, True), (8.0, False)):
        at = one.end_utc_s - left_s
        _, order = machine.step(following(one), Followed(utc_s=at, attempt=PassAttempt("link", at)))
        assert isinstance(order, Follow) == goes_on


def test_why_there_is_no_plan_is_noted_once_and_it_is_tried_again_in_ten_minutes() -> None:
    run, _ = machine.step(Run(), Started(utc_s=BEGIN, settings=settings(1.0)))
    at = BEGIN
    for words, notes in (("no elements", 1), ("no elements", 1), ("no site", 2)):
        run, order = machine.step(run, NotPlanned(utc_s=at, words=words))
        assert order == Wait(until_utc_s=at + 600.0)
        assert len(run.notes) == notes
        assert run.notes[-1] == f"no plan: {words}"
        at += 600.0
        run, order = machine.step(run, Due(utc_s=at))
        assert order == MakePlan()


def test_elements_that_are_renewed_before_a_pass_are_those_that_are_followed() -> None:
    one = one_pass()
    run = waiting_for(one)
    run, _ = machine.step(run, Due(utc_s=one.leave_utc_s - 10.0))
    assert one.elements is not None
    newer = dataclasses.replace(one.elements, name="NEWER")
    run, _ = machine.step(run, PassPrepared(utc_s=one.leave_utc_s - 9.0, elements=newer, words="renewed"))
    assert run.passes == (replace(one, elements=newer),)
    assert run.notes[-1] == "renewed"


def test_the_nights_summary_is_where_it_was_written_until_another_is() -> None:
    run, _ = machine.step(Run(), Started(utc_s=BEGIN, settings=settings(5.0)))
    for file, kept in (("one.txt", "one.txt"), (None, "one.txt"), ("two.txt", "two.txt")):
        run = replace(run, state=RunState.SUMMING_UP, mount=Mount.PARKED)
        run, _ = machine.step(run, SummedUp(utc_s=run.night_from_utc_s + 3600.0, file=file))
        assert run.summary == kept


def test_a_session_that_breaks_off_is_begun_again_while_enough_is_left_and_not_for_ever() -> None:
    one = one_pass()
    run = following(one)
    attempts = 1
    at = one.start_utc_s
    while True:
        at += 1.0
        run, order = machine.step(run, Followed(utc_s=at, attempt=PassAttempt("crash", at, words="gone")))
        if not isinstance(order, Follow):
            break
        attempts += 1
    assert 2 <= attempts <= 20
    (result,) = run.results
    assert (result.state, result.cause) == ("lost", "crash")


def test_unsafe_weather_is_waited_out_while_enough_is_left_and_then_costs_the_pass() -> None:
    one = one_pass(if_weather_unsafe="wait")
    run = waiting_for(one)
    run, _ = machine.step(run, Due(utc_s=one.leave_utc_s - 10.0))
    run, order = machine.step(run, PassPrepared(utc_s=one.leave_utc_s - 9.0))
    at, asked = one.leave_utc_s, 0
    while isinstance(order, AskWeather):
        asked += 1
        run, order = machine.step(run, WeatherReported(utc_s=at, safe=False, words="rain"))
        if run.state is RunState.HOLDING:
            assert isinstance(order, Wait)
            at = order.until_utc_s
            run, order = machine.step(run, Due(utc_s=at))
    assert asked > 1
    assert (run.results[0].state, run.results[0].cause) == ("lost", "weather")
    assert at <= one.end_utc_s


@pytest.mark.parametrize(("policy", "state"), [("skip", RunState.WAITING), ("run", RunState.FOLLOWING)])
def test_unsafe_weather_costs_the_pass_at_once_or_nothing_where_the_schedule_says_so(
    policy: str, state: RunState
) -> None:
    one = one_pass(if_weather_unsafe=policy)
    run = waiting_for(one)
    run, _ = machine.step(run, Due(utc_s=one.leave_utc_s - 10.0))
    run, _ = machine.step(run, PassPrepared(utc_s=one.leave_utc_s - 9.0))
    run, _ = machine.step(run, WeatherReported(utc_s=one.leave_utc_s, safe=False, words="rain"))
    assert run.state is state


def test_a_stop_from_any_terminal_ends_the_run_and_moves_nothing_more() -> None:
    one = one_pass()
    run = following(one)
    at = one.start_utc_s + 5.0
    run, order = machine.step(run, Followed(utc_s=at, attempt=PassAttempt("operator", at, on_target_s=3.0)))
    assert run.state is RunState.STOPPED
    assert isinstance(order, End)
    assert order.interrupted
    # Run again, it goes on with what is to come, and not with that pass.
    run, order = machine.step(run, Started(utc_s=at + 60.0, settings=settings(1.0)))
    assert isinstance(order, Wait)
    run, order = machine.step(run, Due(utc_s=at + 60.0))
    assert isinstance(order, ParkMount)


def test_a_clock_set_back_while_waiting_is_told_and_no_pass_comes_twice() -> None:
    one = one_pass()
    run = following(one)
    run, _ = machine.step(
        run, Followed(utc_s=one.end_utc_s, attempt=PassAttempt("set", one.end_utc_s, on_target_s=500.0))
    )
    run, order = machine.step(run, ClockSet(utc_s=one.end_utc_s - 3600.0, seconds=-3600.0))
    assert isinstance(order, Wait)
    assert "set back by 1.00 h" in run.notes[-1]
    run, order = machine.step(run, Due(utc_s=one.end_utc_s - 3600.0))
    assert isinstance(order, ParkMount)


def test_a_mount_with_long_to_wait_is_sent_to_its_park_position_each_half_an_hour_as_it_drifts() -> None:
    at = RunSettings(BEGIN, BEGIN + 86400.0, 41_522.0)
    first, second = drawn_passes(Random(1), 1, BEGIN + 3000.0, BEGIN + 80000.0)[:2]
    second = replace(
        second,
        start_utc_s=first.end_utc_s + 9100.0,
        end_utc_s=first.end_utc_s + 9300.0,
        leave_utc_s=first.end_utc_s + 9090.0,
    )
    run, order = machine.step(Run(), Started(utc_s=BEGIN, settings=at))
    run, order = machine.step(run, Planned(utc_s=BEGIN, passes=(first, second)))
    run = replace(run, mount=Mount.AT_REST, results=(Result("done"),))
    now, sent = first.end_utc_s, 0
    run, order = machine.step(run, Due(utc_s=now))
    while not isinstance(order, Prepare):
        if isinstance(order, ParkMount):
            assert not order.power_off
            sent += 1
            run, order = machine.step(run, Parked(utc_s=now + 20.0, mount=Mount.AT_PARK))
        else:
            assert isinstance(order, Wait)
            assert order.until_utc_s >= now
            now = order.until_utc_s
            run, order = machine.step(run, Due(utc_s=now))
    # After 0, 1820, 3640 and 5460 s; what is left after 7280 is less than half an hour.
    assert sent == 4
    assert now == pytest.approx(second.leave_utc_s - at.prepare_s)


def test_a_night_slept_through_is_left_out_and_the_one_in_progress_planned() -> None:
    at = settings(5.0)
    run, _ = machine.step(Run(), Started(utc_s=BEGIN, settings=at))
    run, _ = machine.step(run, Planned(utc_s=BEGIN, passes=()))
    run, _ = machine.step(run, Due(utc_s=BEGIN))
    run = replace(run, state=RunState.SUMMING_UP)
    late = BEGIN + 3.3 * 86400.0
    run, order = machine.step(run, SummedUp(utc_s=late))
    assert isinstance(order, Wait)
    assert run.night_from_utc_s <= late < run.night_to_utc_s


def test_a_schedule_without_an_end_goes_on_night_after_night_at_the_sites_noon() -> None:
    at = RunSettings(BEGIN, None, 41_522.0)
    run, _ = machine.step(Run(), Started(utc_s=BEGIN, settings=at))
    for _ in range(30):
        end = run.night_to_utc_s
        assert (end - 41_522.0) % 86400.0 == pytest.approx(0.0, abs=1e-3)
        run = replace(run, state=RunState.SUMMING_UP, mount=Mount.PARKED)
        run, _ = machine.step(run, SummedUp(utc_s=run.night_from_utc_s + 3600.0))
        assert run.state is RunState.RESTING
        assert run.night_from_utc_s == end


def test_an_event_that_means_nothing_is_a_defect_that_is_named() -> None:
    with pytest.raises(machine.NoRowError, match="StepDone while planning"):
        machine.step(Run(), StepDone(utc_s=BEGIN, done=True))
