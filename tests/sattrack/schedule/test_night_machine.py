"""The runner's machine: rows for whatever may happen, every pass accounted for, taken up after any end."""

from __future__ import annotations

import dataclasses
from itertools import pairwise
from random import Random
from typing import TYPE_CHECKING, Any

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
    FinishedPass,
    Follow,
    Followed,
    MakePlan,
    Mount,
    NightPass,
    NotPlanned,
    Order,
    Parked,
    ParkMount,
    PassAttempt,
    PassPrepared,
    Planned,
    Prepare,
    Recovered,
    Reread,
    Result,
    Run,
    RunSettings,
    RunState,
    Started,
    StepDone,
    StopAsked,
    SummedUp,
    SumUp,
    Wait,
    WeatherReported,
    first_night,
    mean_noon_s,
    object_number,
)
from sattrack.schedule.schema import CommandAction, SlewAction, Terms
from tle.instants import Utc

if TYPE_CHECKING:
    from collections.abc import Iterator

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
    assert order == Follow(index=0, part=2, from_utc_s=one.start_utc_s + 30.0, pause_s=0.0)
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
    run, order = machine.step(run, StepDone(utc_s=one.end_utc_s + 2.0, done=False, words="exit 2"))
    assert order == Wait(until_utc_s=one.end_utc_s + 2.0)
    assert run.notes[-1] == f"{one.name}: {one.terms.after[1].words}: exit 2"
    assert run.state is RunState.WAITING


def test_a_pass_that_an_action_may_cost_is_lost_to_it_in_its_words() -> None:
    one = one_pass(before=(CommandAction(run=("x",), if_it_fails="skip"),))
    run, order = machine.step(readying(one), StepDone(utc_s=one.leave_utc_s, done=False, words="exit 1"))
    assert isinstance(order, Wait)
    (result,) = run.results
    assert (result.state, result.cause) == ("lost", "command")
    assert result.words == f"{one.terms.before[0].words}: exit 1"


def test_what_was_opened_for_a_pass_is_closed_whatever_it_is_lost_to() -> None:
    lost = set()
    for seed in range(60):
        world = World(seed)
        _, nights = carried_out(world, settings(NIGHTS))
        opened = {key for key, place, _ in world.commands if place == "before"}
        for night in nights:
            for one, result in zip(night.passes, night.results, strict=True):
                if one.key in opened:
                    after = {k for k, each in enumerate(one.terms.after) if not isinstance(each, SlewAction)}
                    closed = {k for key, place, k in world.commands if (key, place) == (one.key, "after")}
                    assert closed == after, (seed, one.key, result)
                    lost.add((result.state, result.cause))
    assert lost >= {("lost", "weather"), ("lost", "command"), ("lost", "delay")}


OPEN, CLOSE = CommandAction(run=("open",), if_it_fails="skip"), CommandAction(run=("close",))


def rain_at(utc_s: float) -> WeatherReported:
    return WeatherReported(utc_s=utc_s, safe=False, words="rain")


def test_before_anything_was_done_for_a_pass_it_waits_for_the_weather_again() -> None:
    """The runner was restarted before the first action, and the weather had turned meanwhile."""
    long = one_pass(before=(OPEN,), after=(CLOSE,))
    run, order = machine.step(readying(long), rain_at(long.leave_utc_s - 5.0))
    assert (order, run.results) == (ParkMount(power_off=False), ())
    one = replace(long, end_utc_s=long.start_utc_s + 200.0)
    run, order = machine.step(readying(one), rain_at(one.leave_utc_s - 5.0))
    assert (run.state, run.results) == (S.HOLDING, ())
    assert isinstance(order, Wait)
    run, order = machine.step(run, Due(utc_s=order.until_utc_s))
    run, order = machine.step(run, replace(rain_at(one.leave_utc_s), safe=True))
    assert order == DoStep(index=0, when="before", step=0)
    skips = one_pass(before=(OPEN,), if_weather_unsafe="skip")
    run, _ = machine.step(readying(skips), rain_at(skips.leave_utc_s - 5.0))
    assert (run.state, run.results[0].cause) == (S.WAITING, "weather")
    late = one_pass(before=(OPEN,), least_s=60.0)
    run, _ = machine.step(readying(late), rain_at(late.end_utc_s - 61.0))
    assert (run.state, run.results[0].cause) == (S.WAITING, "weather")


def test_weather_that_turns_while_a_pass_is_readied_loses_it_and_closes_what_was_opened() -> None:
    for after in ((CLOSE,), ()):
        one = one_pass(before=(OPEN, SlewAction(star="Vega")), after=after)
        run, order = machine.step(readying(one), StepDone(utc_s=one.leave_utc_s, done=True))
        assert order == DoStep(index=0, when="before", step=1)
        run, order = machine.step(run, rain_at(one.leave_utc_s + 1.0))
        (result,) = run.results
        assert (result.state, result.cause, result.words) == ("lost", "weather", "rain")
        assert run.state is (S.FINISHING if after else S.WAITING)
        assert isinstance(order, DoStep) == bool(after)
        if isinstance(order, DoStep):
            assert (order.when, order.action_of(one)) == ("after", CLOSE)
            run, order = machine.step(run, StepDone(utc_s=one.leave_utc_s + 2.0, done=True))
        assert (run.state, order) == (S.WAITING, Wait(until_utc_s=one.leave_utc_s + (2.0 if after else 1.0)))


def test_an_action_that_fails_or_comes_too_late_loses_a_pass_and_closes_what_was_opened() -> None:
    one = one_pass(before=(OPEN,), after=(CLOSE,), least_s=60.0)
    run = readying(one)
    late_s, restarted = one.end_utc_s - 5.0, replace(again(one.end_utc_s - 5.0), settings=run.settings)
    for event, cause in (
        (StepDone(utc_s=one.leave_utc_s, done=False, words="exit 1"), "command"),
        (StepDone(utc_s=late_s, done=True), "delay"),
        (Due(utc_s=late_s), "delay"),
        (restarted, "missed"),
    ):
        after, order = machine.step(run, event)
        assert order == DoStep(index=0, when="after", step=0)
        assert (after.state, after.results[0].cause) == (S.FINISHING, cause)
        # By the rules that a journal of an earlier version was written by.
        at = replace(run.settings, revision=3)
        begun = replace(event, settings=at) if isinstance(event, Started) else event
        after, order = machine.step(replace(run, settings=at), begun)
        assert (after.state, after.results[0].cause) == (S.WAITING, cause)
        assert isinstance(order, Wait)


def test_a_pass_is_prepared_a_minute_and_a_half_before_the_mount_sets_out() -> None:
    one = one_pass()
    run, order = machine.step(replace(waiting_for(one), mount=Mount.PARKED), Due(utc_s=BEGIN + 1.0))
    assert order == Wait(until_utc_s=one.leave_utc_s - 90.0)
    _, order = machine.step(run, Due(utc_s=one.leave_utc_s - 90.0))
    assert order == Prepare(index=0, wake=True)


@pytest.mark.parametrize(("mount", "sooner_s"), [(Mount.PARKED, 300.0), (Mount.AT_PARK, 0.0)])
def test_drives_without_power_are_woken_as_much_sooner_as_that_may_take(
    mount: Mount, sooner_s: float
) -> None:
    run = waiting_for(one_pass())
    run = replace(run, mount=mount, parked_utc_s=BEGIN, settings=replace(run.settings, wake_s=300.0))
    due_s = one_pass().leave_utc_s - 90.0 - sooner_s
    for utc_s, order in (
        (due_s - 1.0, Wait(until_utc_s=due_s)),
        (due_s, Prepare(index=0, wake=mount is Mount.PARKED)),
    ):
        assert machine.step(run, Due(utc_s=utc_s))[1] == order


def test_after_a_night_the_next_begins_empty_and_after_the_last_the_run_ends() -> None:
    over = (FinishedPass(25544, BEGIN),)
    run = replace(following(one_pass()), settings=settings(2.0), others={"lost": 3}, over=over)
    run = replace(run, state=RunState.SUMMING_UP, mount=Mount.PARKED, results=(Result("done"),))
    first_end = run.night_to_utc_s
    run, order = machine.step(run, SummedUp(utc_s=run.night_to_utc_s))
    assert (run.night, run.passes, run.results, run.others, run.over) == (2, (), (), {}, ())
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
        assert order.part == run.part == k + 2
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


def test_passes_that_no_new_plan_could_be_made_of_are_missed_and_the_mount_is_parked() -> None:
    run = replace(NIGHT, state=S.WAITING, passes=(ONE, replace(ONE, key="2")))
    run, _ = machine.step(run, Reread(utc_s=NOW, settings=run.settings))
    run, _ = machine.step(run, NotPlanned(utc_s=NOW, words="the provider is silent"))
    event: Event = Due(utc_s=MORNING)
    for _ in range(5):
        run, order = machine.step(run, event)
        if isinstance(order, SumUp):
            break
        is_parked = isinstance(order, ParkMount) and order.power_off
        event = Parked(utc_s=MORNING, mount=Mount.PARKED) if is_parked else Due(utc_s=MORNING)
    assert (run.state, run.mount) == (S.SUMMING_UP, Mount.PARKED)
    assert [result.cause for result in run.results] == ["missed", "missed"]


@pytest.mark.parametrize("state", [RunState.WAITING, RunState.PREPARING, RunState.HOLDING, RunState.STOPPED])
def test_a_run_that_is_begun_again_with_an_earlier_end_ends_then(state: RunState) -> None:
    later = replace(later_by(7200.0, ONE), key="later")
    end_s = ONE.end_utc_s + 60.0
    sooner = replace(NIGHT.settings, to_utc_s=end_s)
    run = replace(NIGHT, state=state, passes=(ONE, later))
    run, _ = machine.step(run, Started(utc_s=NOW, settings=sooner))
    run, order = machine.step(run, Due(utc_s=NOW))
    assert (order, run.night_to_utc_s) == (MakePlan(), end_s)
    run, _ = machine.step(run, Planned(utc_s=NOW, passes=(ONE,)))
    run, order = machine.step(run, Due(utc_s=NOW))
    assert [one.key for one in run.passes] == [ONE.key]
    assert not isinstance(order, MakePlan)


def test_the_rest_of_a_pass_that_is_over_is_not_begun_again_by_a_new_plan() -> None:
    """Of a pass that ended early, as for the weather, what is left culminates where it is joined."""
    later_s = ONE.culminate_utc_s + 130.0
    long = replace(ONE, end_utc_s=later_s + 200.0)
    rest = replace(long, key="rest", start_utc_s=later_s, culminate_utc_s=later_s)
    coming = replace(rest, key="coming", start_utc_s=long.end_utc_s, end_utc_s=long.end_utc_s + 400.0)
    planned = Planned(utc_s=later_s - 60.0, passes=(rest, coming))
    run, _ = machine.step(replace(NIGHT, state=S.PLANNING, passes=(long,), results=DONE), planned)
    assert [one.key for one in run.passes] == [long.key, "coming"]
    over = FinishedPass(long.object_number, long.culminate_utc_s, long.end_utc_s)
    run, _ = machine.step(replace(NIGHT, state=S.PLANNING, over=(over,)), planned)
    assert [one.key for one in run.passes] == ["coming"]


def test_elements_that_are_renewed_before_a_pass_are_those_that_are_followed() -> None:
    one = one_pass()
    later = replace(one, key="later", number=2)
    run, _ = machine.step(waiting_for(one), Due(utc_s=one.leave_utc_s - 10.0))
    run = replace(run, passes=(one, later, later), results=())
    assert one.elements is not None
    newer = dataclasses.replace(one.elements, name="NEWER")
    run, _ = machine.step(run, PassPrepared(utc_s=one.leave_utc_s - 9.0, elements=newer, words="renewed"))
    assert run.passes == (replace(one, elements=newer), later, later)
    assert run.notes[-1] == "renewed"


def test_the_nights_summary_is_where_it_was_written_until_another_is() -> None:
    run, _ = machine.step(Run(), Started(utc_s=BEGIN, settings=settings(5.0)))
    for file, kept in (("one.txt", "one.txt"), (None, "one.txt"), ("two.txt", "two.txt")):
        run = replace(run, state=RunState.SUMMING_UP, mount=Mount.PARKED)
        run, _ = machine.step(run, SummedUp(utc_s=run.night_from_utc_s + 3600.0, file=file, words="written"))
        assert (run.summary, run.message, run.notes) == (kept, "written", ())


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
    lost = [(one.state, one.cause, one.words) for one in run.results]
    assert lost == ([("lost", "weather", "rain")] if policy == "skip" else [])
    assert run.weather == "rain"


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


def test_of_nights_that_were_all_slept_through_the_last_is_gone_on_with() -> None:
    run, _ = machine.step(Run(), Started(utc_s=BEGIN, settings=settings(5.0)))
    late = SummedUp(utc_s=BEGIN + 40.0 * 86_400.0)
    run, order = machine.step(replace(run, state=RunState.SUMMING_UP), late)
    assert (run.state, run.night_to_utc_s) == (RunState.RESTING, BEGIN + 5.0 * 86_400.0)
    assert order == Wait(until_utc_s=run.night_from_utc_s)
    _, order = machine.step(replace(run, state=RunState.SUMMING_UP), late)
    assert isinstance(order, End)


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


def test_a_mount_that_waits_for_the_weather_through_a_long_pass_is_sent_to_its_park_position() -> None:
    """Nothing else ends its tracking of the sky: through a pass of four hours it would go on by 60°."""
    begin = ONE.start_utc_s
    for hours, sent in ((0.5, 1), (4.0, 8)):
        long = replace(PLAIN, end_utc_s=begin + hours * 3600.0)
        run = replace(NIGHT, state=S.WAITING, passes=(long,))
        now, parked = begin, 0
        run, order = machine.step(run, Due(utc_s=now))
        while not run.results:
            event: Event
            if isinstance(order, ParkMount):
                assert not order.power_off
                parked += 1
                event = Parked(utc_s=now + 20.0, mount=Mount.AT_PARK)
            elif isinstance(order, Prepare):
                event = PassPrepared(utc_s=now)
            elif isinstance(order, AskWeather):
                event = WeatherReported(utc_s=now, safe=False, words="rain")
            else:
                assert isinstance(order, Wait)
                event = Due(utc_s=max(now, order.until_utc_s))
            now = event.utc_s
            run, order = machine.step(run, event)
        assert (run.results[0].cause, parked) == ("weather", sent)
        assert run.weather == "rain"


@pytest.mark.parametrize("days", [0.0, 2.0, 5.0])
def test_a_run_that_has_not_begun_begins_when_its_schedule_says_now(days: float) -> None:
    at, moved = (RunSettings(BEGIN + begin * 86_400.0, None, 41_522.0) for begin in (3.0, days))
    resting, _ = machine.step(Run(), Started(utc_s=BEGIN, settings=at))
    stopped, _ = machine.step(resting, StopAsked(utc_s=BEGIN + 60.0))
    for run, event in (
        (resting, Reread(utc_s=BEGIN + 60.0, settings=moved)),
        (resting, Started(utc_s=BEGIN + 60.0, settings=moved)),
        (stopped, Started(utc_s=BEGIN + 60.0, settings=moved)),
    ):
        after, order = machine.step(run, event)
        begin = max(moved.from_utc_s, BEGIN + 60.0)
        assert after.night_from_utc_s == begin
        assert after.night_to_utc_s == first_night(Run(settings=moved), begin).night_to_utc_s
        assert after.state is RunState.RESTING or not days
        assert isinstance(order, MakePlan) or order == Wait(until_utc_s=begin)


def test_an_event_that_means_nothing_is_a_defect_that_is_named() -> None:
    with pytest.raises(machine.NoRowError, match="StepDone while planning"):
        machine.step(Run(), StepDone(utc_s=BEGIN, done=True))


NIGHT = Run(
    settings=settings(3.0),
    mount=Mount.AT_REST,
    night=1,
    night_from_utc_s=BEGIN,
    night_to_utc_s=BEGIN + 86_000.0,
)
SLEW, PROGRAM = SlewAction(star="Vega"), CommandAction(run=("x",))
ONE = one_pass(before=(SLEW, PROGRAM, SLEW), after=(SLEW, PROGRAM))
BEFORE = one_pass(before=(SLEW, PROGRAM, SLEW))
PLAIN, LATE_S = one_pass(), ONE.end_utc_s - 5.0
PREPARED_S = ONE.leave_utc_s - 90.0
TIMES = ("leave_utc_s", "start_utc_s", "culminate_utc_s", "end_utc_s")
NOW, MORNING = BEGIN + 3000.0, NIGHT.night_to_utc_s
DONE = (Result("done"),)
S = RunState


def later_by(seconds: float, one: NightPass) -> NightPass:
    """Return the same pass so much later."""
    return replace(one, **{name: getattr(one, name) + seconds for name in TIMES})


def again(utc_s: float, nights: float = 3.0) -> Started:
    return Started(utc_s=utc_s, settings=settings(nights))


@pytest.mark.parametrize(
    ("state", "known", "event", "order", "next_state"),
    [
        # The night begins, or is taken up.
        (S.PLANNING, {}, again(MORNING), SumUp(), S.SUMMING_UP),
        (S.PLANNING, {"passes": (ONE,)}, again(MORNING), Wait(until_utc_s=MORNING), S.WAITING),
        (S.PLANLESS, {}, Due(utc_s=NOW), MakePlan(), S.PLANNING),
        (S.PLANLESS, {}, Due(utc_s=MORNING), ParkMount(power_off=True), S.PARKING),
        (S.PLANLESS, {"mount": Mount.PARKED}, Due(utc_s=MORNING), SumUp(), S.SUMMING_UP),
        (S.PLANLESS, {"passes": (ONE,)}, Due(utc_s=MORNING), Wait(until_utc_s=MORNING), S.WAITING),
        (S.PLANLESS, {}, Reread(utc_s=NOW, settings=settings(3.0)), MakePlan(), S.PLANNING),
        (S.ENDED, {}, again(MORNING), Wait(until_utc_s=MORNING), S.RESTING),
        (S.ENDED, {}, again(MORNING, 86_000.5 / 86_400.0), End(why="all nights are over"), S.ENDED),
        (S.RESTING, {}, Due(utc_s=BEGIN - 9.0), Wait(until_utc_s=BEGIN), S.RESTING),
        # Actions before a pass: a slew may come twice, a program may not.
        (S.READYING, {"passes": (ONE,), "step": 1}, again(NOW), DoStep(index=0, when="before", step=2),
         S.READYING),
        (S.READYING, {"passes": (BEFORE,)}, again(LATE_S), Wait(until_utc_s=LATE_S), S.WAITING),
        (S.READYING, {"passes": (ONE,), "step": 3}, Due(utc_s=NOW), Follow(index=0, part=1, from_utc_s=NOW),
         S.FOLLOWING),
        (S.READYING, {"passes": (ONE,), "step": 3}, Due(utc_s=LATE_S), DoStep(index=0, when="after", step=0),
         S.FINISHING),
        (S.READYING, {"passes": (BEFORE,), "step": 3}, Due(utc_s=LATE_S), Wait(until_utc_s=LATE_S),
         S.WAITING),
        # Those after it.
        (S.FOLLOWING, {"passes": (PLAIN,), "part": 1}, again(PLAIN.end_utc_s),
         Wait(until_utc_s=PLAIN.end_utc_s), S.FINISHING),
        (S.FINISHING, {"passes": (ONE,), "results": DONE}, Due(utc_s=NOW), Wait(until_utc_s=NOW), S.WAITING),
        # Parking: five times, a minute apart.
        (S.PARKING, {"passes": (ONE,), "tries": 3}, again(NOW), ParkMount(power_off=False), S.PARKING),
        (S.PAUSING, {"tries": 3}, Due(utc_s=NOW), ParkMount(power_off=True), S.PARKING),
        # The morning, and the end.
        (S.SUMMING_UP, {"settings": replace(settings(3.0), to_utc_s=None)}, SummedUp(utc_s=MORNING),
         Wait(until_utc_s=MORNING), S.RESTING),
    ],
)  # fmt: skip
def test_what_is_done_in_a_state_follows_from_the_event_and_from_what_is_left(
    state: RunState, known: dict[str, Any], event: Event, order: Order, next_state: RunState
) -> None:
    run, given = machine.step(replace(NIGHT, state=state, **known), event)
    assert (given, run.state) == (order, next_state)


def test_how_often_parking_was_tried_is_counted_from_one_and_anew_after_a_restart() -> None:
    for known in ({}, {"passes": (replace(ONE, leave_utc_s=NOW + 1900.0),)}):
        run, order = machine.step(replace(NIGHT, state=S.WAITING, **known), Due(utc_s=NOW))
        assert isinstance(order, ParkMount)
        assert run.tries == 1
    run, _ = machine.step(replace(run, state=S.PAUSING, tries=3), Due(utc_s=NOW))
    assert run.tries == 4
    assert machine.step(run, again(NOW))[0].tries == 1


@pytest.mark.parametrize(
    ("state", "seconds", "slept", "words", "waits_s"),
    [
        (S.WAITING, 1799.0, False, "the computer's clock was set ahead by 1799 s", 0.0),
        (S.WAITING, -1800.0, False, "the computer's clock was set back by 0.50 h", 0.0),
        (S.HOLDING, 9000.0, True, "the computer slept for 2.50 h", 0.0),
        (S.PAUSING, 90.0, False, "the computer's clock was set ahead by 90 s", 60.0),
        (S.RESTING, 90.0, False, "the computer's clock was set ahead by 90 s", 500.0),
    ],
)
def test_a_clock_that_was_set_is_reported_and_what_is_waited_for_is_waited_for_anew(
    state: RunState, seconds: float, slept: bool, words: str, waits_s: float
) -> None:
    run = replace(NIGHT, state=state, night_from_utc_s=NOW + 500.0)
    run, order = machine.step(run, ClockSet(utc_s=NOW, seconds=seconds, slept=slept))
    assert (run.message, run.notes) == (words, (words,))
    assert order == Wait(until_utc_s=NOW + waits_s)


YEARS_S = 10.0 * 365.25 * 86_400.0


def ahead(revision: int = machine.REVISION) -> Run:
    """Return a run in its fourth night, made to wait for another by a clock that was ten years ahead."""
    at = replace(settings(3.0), to_utc_s=None, revision=revision)
    run, order = machine.step(Run(), Started(utc_s=BEGIN, settings=at))
    run = replace(run, state=S.RESTING, mount=Mount.PARKED, night=4)
    event: Event = Started(utc_s=BEGIN + YEARS_S, settings=at)
    for _ in range(12):
        run, order = machine.step(run, event)
        if isinstance(order, Wait) and order.until_utc_s > event.utc_s:
            assert (run.state, run.night) == (S.RESTING, 6)
            return run
        event = Due(utc_s=event.utc_s)
        if isinstance(order, MakePlan):
            event = Planned(utc_s=event.utc_s, passes=())
        elif isinstance(order, SumUp):
            event = SummedUp(utc_s=event.utc_s)
    raise AssertionError("it does not wait")


@pytest.mark.parametrize("restarted", [False, True])
@pytest.mark.parametrize(
    ("now_s", "revision", "waits"),
    [
        (86_400.0, 2, False),
        # What would be waited for is the next night, at most.
        (YEARS_S - 3600.0, 2, True),
        # A clock that is behind the run's beginning is wrong itself: nothing is begun by it.
        (-YEARS_S, 2, True),
        (86_400.0, 1, True),
    ],
)
def test_a_clock_that_was_years_ahead_does_not_keep_a_run_waiting_for_them(
    now_s: float, revision: int, waits: bool, restarted: bool
) -> None:
    run, now = ahead(revision), BEGIN + now_s
    if not waits:
        # Whichever night of the run it is, but the first.
        run = replace(run, night=2)
    event: Event = ClockSet(utc_s=now, seconds=now_s - YEARS_S)
    if restarted:
        event = Started(utc_s=now, settings=run.settings)
    run, order = machine.step(run, event)
    assert order == Wait(until_utc_s=run.night_from_utc_s if waits else now)
    assert run.state is S.RESTING
    if waits:
        assert run.night_from_utc_s > BEGIN + YEARS_S
        return
    assert machine.step(run, Due(utc_s=now))[1] == MakePlan()
    assert now < run.night_to_utc_s <= now + 86_400.0


def test_a_plan_for_years_ahead_is_given_up_and_a_stopped_run_is_resumed_now() -> None:
    run, now = ahead(), BEGIN + 86_400.0
    far = replace(ONE, start_utc_s=BEGIN + YEARS_S + 9e4, leave_utc_s=BEGIN + YEARS_S + 9e4)
    begun = {"night_from_utc_s": BEGIN + YEARS_S, "night_to_utc_s": BEGIN + YEARS_S + 86_400.0}
    for state in (S.WAITING, S.STOPPED, S.PLANLESS):
        kept = () if state is S.PLANLESS else (far,)
        later, _ = machine.step(
            replace(run, state=state, passes=kept, **begun), Started(utc_s=now, settings=run.settings)
        )
        assert (later.passes, later.night_from_utc_s) == ((), now)
    # A summary that is written only now.
    later, order = machine.step(
        replace(run, state=S.SUMMING_UP, passes=(far,), results=DONE, **begun), SummedUp(utc_s=now)
    )
    assert (later.state, order) == (S.RESTING, Wait(until_utc_s=now))


def test_a_run_that_begins_next_month_waits_for_that_whatever_is_done_to_the_clock() -> None:
    at = replace(settings(3.0), from_utc_s=BEGIN + 30.0 * 86_400.0, to_utc_s=None)
    run, order = machine.step(Run(), Started(utc_s=BEGIN, settings=at))
    for event in (ClockSet(utc_s=BEGIN + 60.0, seconds=-3600.0), Started(utc_s=BEGIN + 90.0, settings=at)):
        run, order = machine.step(run, event)
        assert order == Wait(until_utc_s=at.from_utc_s)


@pytest.mark.parametrize("late_s", [0.0, 3600.0])
def test_a_resting_run_whose_clock_was_set_into_its_night_begins_at_once(late_s: float) -> None:
    run = replace(NIGHT, state=S.RESTING)
    _, order = machine.step(run, ClockSet(utc_s=BEGIN + late_s, seconds=late_s))
    assert order == Wait(until_utc_s=BEGIN + late_s)


def test_bad_weather_is_asked_about_again_and_reported_where_it_has_changed() -> None:
    run, found = replace(NIGHT, state=S.ASKING, passes=(PLAIN,), mount=Mount.AT_PARK), []
    for words in ("rain", "rain", "fog"):
        run, order = machine.step(run, WeatherReported(utc_s=NOW, safe=False, words=words))
        assert order == Wait(until_utc_s=NOW + 30.0)
        found.append(run.message)
        run, _ = machine.step(run, Due(utc_s=NOW))
    told = f"{PLAIN.name}: the weather is unsafe: "
    assert found == [told + "rain", None, told + "fog"]
    for one in (PLAIN, ONE):
        clear = WeatherReported(utc_s=NOW, safe=True, words="clear")
        assert machine.step(replace(run, passes=(one,)), clear)[0].weather == "clear"


@pytest.mark.parametrize(
    ("attempt", "message"),
    [
        (PassAttempt("set", NOW, 1000.0, rms_arcsec=0.234), "done, 1000 s on target, 0.23″ RMS"),
        (PassAttempt("set", NOW, 1000.0), "done"),
        (PassAttempt("limit:sun", NOW, 10.0, 0.2, words="the Sun"), "partly, limit:sun: the Sun"),
        (PassAttempt("weather", NOW), "lost, weather"),
        (PassAttempt("set", NOW, 1000.0, held_s={"sun": 9.0}), "done; 9 s to the sun limit"),
    ],
)
def test_the_result_of_a_pass_is_told_in_a_line_and_is_no_note(attempt: PassAttempt, message: str) -> None:
    begun = PassAttempt("link", NOW)
    run = replace(following(PLAIN), notes=("x",), noted_night=1, attempts=(begun,), step=2, tries=3)
    run, _ = machine.step(run, Followed(utc_s=PLAIN.end_utc_s, attempt=attempt))
    assert run.message == f"{PLAIN.name}: {message}"
    assert run.notes == ("x",)
    assert (run.step, run.part, run.attempts, run.tries) == (0, 0, (), 0)


def test_what_is_planned_is_told_and_notes_are_of_one_night_and_the_last_twelve() -> None:
    run, _ = machine.step(Run(), again(BEGIN))
    for passes, words in (((PLAIN,), "1 pass planned"), ((), "0 passes planned")):
        planned, _ = machine.step(
            run, Planned(utc_s=BEGIN, passes=passes, words="2 are lost", others={"x": 2})
        )
        assert planned.message == f"night 1: {words}; 2 are lost"
        assert (planned.notes, planned.others) == ((), {"x": 2})
        for night, notes in ((1, ("x",)), (2, ())):
            before = replace(run, notes=("x",), noted_night=1, night=night)
            assert machine.step(before, Planned(utc_s=BEGIN, passes=passes))[0].notes == notes
    noted = planned
    for k in range(14):
        noted, _ = machine.step(noted, ClockSet(utc_s=BEGIN, seconds=float(k)))
    assert noted.notes == tuple(f"the computer's clock was set ahead by {k} s" for k in range(2, 14))
    assert machine.step(replace(noted, night=2), ClockSet(utc_s=BEGIN, seconds=60.0))[0].notes == (
        "the computer's clock was set ahead by 60 s",
    )


def test_a_mount_that_was_not_parked_is_told_of_and_is_sent_there_after_half_an_hour() -> None:
    failed = Parked(utc_s=NOW, mount=Mount.AT_REST, words="no answer")
    run, _ = machine.step(replace(NIGHT, state=S.PARKING, tries=1), failed)
    assert run.message == "the mount is not parked: no answer"
    run, _ = machine.step(replace(NIGHT, state=S.PARKING, tries=5, passes=(ONE,)), failed)
    assert (run.message, run.mount, run.parked_utc_s) == ("NOT PARKED: no answer", Mount.UNKNOWN, NOW)
    for utc_s, order in (
        (NOW, Wait(until_utc_s=NOW + 1800.0)),
        (NOW + 1800.0, ParkMount(power_off=False)),
        # Less than half an hour is left.
        (LONG.leave_utc_s - 1880.0, Wait(until_utc_s=LONG.leave_utc_s - 90.0)),
    ):
        assert machine.step(replace(run, passes=(LONG,)), Due(utc_s=utc_s))[1] == order
    there = Parked(utc_s=NOW, mount=Mount.AT_PARK, words="at park")
    run, _ = machine.step(replace(NIGHT, state=S.PARKING, tries=1, passes=(ONE,)), there)
    assert (run.message, run.mount) == ("at park", Mount.AT_PARK)


LONG = later_by(28_800.0, ONE)


def waits(run: Run, utc_s: float) -> list[float]:
    """Return when a mount that cannot be parked is sent to its park position until it must be prepared."""
    sent: list[float] = []
    event: Event = Due(utc_s=utc_s)
    for _ in range(300):
        run, order = machine.step(run, event)
        if isinstance(order, Prepare):
            return sent
        if isinstance(order, ParkMount):
            assert not order.power_off
            sent.append(event.utc_s)
            event = Parked(utc_s=event.utc_s + 600.0, mount=Mount.AT_REST, words="no answer")
        else:
            assert isinstance(order, Wait)
            event = Due(utc_s=max(event.utc_s, order.until_utc_s))
    raise AssertionError("it does not end")


def test_a_mount_that_cannot_be_parked_is_sent_there_again_every_half_hour_of_a_long_wait() -> None:
    sent = waits(replace(NIGHT, state=S.WAITING, passes=(LONG,)), NOW)
    # Five times at first, each of which takes ten minutes; then once, and never so late that a pass waits.
    gaps = [later - one for one, later in pairwise(sent)]
    assert gaps == [660.0] * 4 + [600.0 + 1800.0] * (len(sent) - 5)
    assert 0.0 < LONG.leave_utc_s - 90.0 - (sent[-1] + 600.0) <= 3600.0


def test_a_mount_that_was_sent_to_its_park_position_in_the_future_is_sent_there_now() -> None:
    """The clock was years ahead."""
    run = replace(NIGHT, state=S.WAITING, passes=(LONG,), mount=Mount.AT_PARK, parked_utc_s=NOW + 3e8)
    assert machine.step(run, Due(utc_s=NOW))[1] == ParkMount(power_off=False)
    run = replace(run, parked_utc_s=NOW + 60.0)
    assert machine.step(run, Due(utc_s=NOW))[1] == Wait(until_utc_s=NOW + 1860.0)


@pytest.mark.parametrize(
    ("cause", "moved_before_s", "parks"),
    [
        # A wait of twenty minutes, too short to park for its own sake.
        ("late", 0.0, False),
        ("late", 1790.0, False),
        ("weather", 0.0, True),
        # It has tracked the sky through waits before this one, for half an hour in all.
        ("late", 1800.0, True),
        # By a clock that was wrong then.
        ("late", -60.0, True),
        # Not known: the run begins with this.
        ("late", NOW, False),
    ],
)
def test_a_mount_is_parked_through_a_short_wait_in_bad_weather_or_once_it_has_stood_for_long(
    cause: str, moved_before_s: float, parks: bool
) -> None:
    coming = later_by(NOW + 1290.0 - PLAIN.leave_utc_s, PLAIN)
    run = replace(
        NIGHT,
        state=S.WAITING,
        passes=(PLAIN, coming),
        results=(Result("lost", cause),),
        moved_utc_s=NOW - moved_before_s,
    )
    waits = Wait(until_utc_s=NOW + 1200.0)
    assert machine.step(run, Due(utc_s=NOW))[1] == (ParkMount(power_off=False) if parks else waits)
    earlier = replace(run, settings=replace(run.settings, revision=2))
    assert machine.step(earlier, Due(utc_s=NOW))[1] == waits


def short_gaps(revision: int, safe: bool) -> Iterator[tuple[float, Order]]:
    """Yield the orders of ten passes 20 minutes apart, in rain or with old elements, and their instants."""
    passes = tuple(
        replace(later_by(NOW + 1200.0 * k - PLAIN.start_utc_s, PLAIN), number=k + 1) for k in range(10)
    )
    at = replace(settings(3.0), revision=revision)
    run = replace(NIGHT, state=S.WAITING, settings=at, passes=passes, moved_utc_s=NOW)
    now, (run, order) = NOW, machine.step(run, Due(utc_s=NOW))
    while run.at is not None:
        yield now, order
        event: Event
        if isinstance(order, ParkMount):
            event = Parked(utc_s=now + 20.0, mount=Mount.AT_PARK)
        elif isinstance(order, Prepare):
            old = "elements too old" if safe else None
            event = PassPrepared(utc_s=now, cause=old, words="9 days")
        elif isinstance(order, AskWeather):
            event = WeatherReported(utc_s=now, safe=False, words="rain")
        else:
            assert isinstance(order, Wait)
            event = Due(utc_s=max(now, order.until_utc_s))
        now = event.utc_s
        run, order = machine.step(run, event)


@pytest.mark.parametrize("safe", [True, False])
def test_through_many_short_waits_a_mount_is_sent_to_park_as_through_a_long_one(safe: bool) -> None:
    """Nothing else ends its tracking of the sky; in bad weather it does not wait for that."""
    parked = [now for now, order in short_gaps(3, safe) if isinstance(order, ParkMount)]
    assert len(parked) >= 4
    assert parked[0] - NOW <= (3000.0 if safe else 60.0)
    assert max(b - a for a, b in pairwise(parked)) <= 3000.0
    assert not any(isinstance(order, ParkMount) for _, order in short_gaps(2, safe))


def test_a_plan_that_cannot_be_made_anew_leaves_the_one_in_force() -> None:
    """But for passes after an end that was put earlier: no plan without them may come again at once."""
    run = replace(NIGHT, state=S.WAITING, passes=(PLAIN, LONG), mount=Mount.AT_REST)
    sooner = replace(run.settings, to_utc_s=PLAIN.end_utc_s + 60.0)
    run, order = machine.step(run, Reread(utc_s=NOW, settings=sooner))
    assert isinstance(order, MakePlan)
    run, order = machine.step(run, NotPlanned(utc_s=NOW, words="celestrak: no answer"))
    assert (run.state, run.passes, order) == (S.WAITING, (PLAIN,), Wait(until_utc_s=NOW))
    assert run.message == "not planned anew, the plan in force stays: celestrak: no answer"
    run, order = machine.step(run, Due(utc_s=NOW))
    assert run.state is not S.PLANNING
    earlier = replace(run, state=S.PLANNING, settings=replace(run.settings, revision=2))
    assert machine.step(earlier, NotPlanned(utc_s=NOW, words="no answer"))[0].state is S.PLANLESS


def test_drives_that_may_have_been_woken_are_parked_at_the_end() -> None:
    """Whether the pass was lost after they were, or somebody stopped the night or the runner meanwhile."""
    parked = replace(NIGHT, state=S.WAITING, passes=(PLAIN,), mount=Mount.PARKED)
    run, order = machine.step(parked, Due(utc_s=PLAIN.start_utc_s - 100.0))
    assert (order, run.waking) == (Prepare(index=0, wake=True), True)
    on = replace(parked, mount=Mount.AT_REST)
    after, order = machine.step(on, Due(utc_s=PLAIN.start_utc_s - 100.0))
    assert (order, after.waking) == (Prepare(index=0, wake=False), False)
    old = PassPrepared(utc_s=PLAIN.start_utc_s, cause="elements too old", words="9 days", woken=True)
    stop = StopAsked(utc_s=PLAIN.start_utc_s, words="by a person")
    for events in ((old,), (stop, again(LATE_S)), (again(LATE_S),)):
        after = run
        for event in events:
            after, order = machine.step(after, event)
        while order != ParkMount(power_off=True):
            assert isinstance(order, Wait)
            after, order = machine.step(after, Due(utc_s=max(order.until_utc_s, LATE_S)))
    failed = PassPrepared(utc_s=LATE_S, cause="power", words="wake: exit 1")
    after, order = machine.step(run, failed)
    while isinstance(order, Wait):
        after, order = machine.step(after, Due(utc_s=order.until_utc_s))
    assert isinstance(order, SumUp)


def test_a_mount_that_cannot_be_parked_is_sent_to_park_each_half_an_hour_since_the_second_rules() -> None:
    run = replace(NIGHT, state=S.WAITING, passes=(LONG,), mount=Mount.UNKNOWN, parked_utc_s=NOW)
    for revision, order in (
        (machine.REVISION, ParkMount(power_off=False)),
        (2, ParkMount(power_off=False)),
        (1, Wait(until_utc_s=PREPARED_S + 28_800.0)),
    ):
        at = replace(run.settings, revision=revision)
        assert machine.step(replace(run, settings=at), Due(utc_s=NOW + 1801.0))[1] == order


def test_a_journal_of_earlier_rules_is_read_as_it_was_written() -> None:
    """Then a mount that had not been parked was left alone until it had moved."""
    earlier = replace(NIGHT, settings=replace(settings(3.0), revision=1))
    assert len(waits(replace(earlier, state=S.WAITING, passes=(LONG,)), NOW)) == 5
    started = msgspec.json.encode(again(NOW), enc_hook=lambda value: float(value.unix_s))
    revision = f',"revision":{machine.REVISION}'.encode()
    older = msgspec.json.decode(started.replace(revision, b""), type=Event)
    assert isinstance(older, Started)
    assert older.settings == replace(settings(3.0), revision=1)


@pytest.mark.parametrize(
    ("event", "state", "cause", "words"),
    [
        (Due(utc_s=LATE_S), S.WAITING, "missed", "nothing could begin it until"),
        (again(LATE_S), S.READYING, "missed", "the runner was restarted too late for it"),
        (Due(utc_s=LATE_S), S.READYING, "delay", "what is done before it took too long"),
        (PassPrepared(utc_s=NOW, cause="elements too old", words="9 days"), S.PREPARING, "elements too old",
         "9 days"),
        (WeatherReported(utc_s=LATE_S, safe=True), S.ASKING, "missed", "nothing could begin it until"),
    ],
)  # fmt: skip
def test_a_pass_that_is_lost_is_lost_to_a_cause_in_words(
    event: Event, state: RunState, cause: str, words: str
) -> None:
    run, order = machine.step(replace(NIGHT, state=state, passes=(BEFORE,)), event)
    (result,) = run.results
    if cause == "missed" and state is not S.READYING:
        words += f" {LATE_S - ONE.start_utc_s:.0f} s after its start"
    assert (result.state, result.cause, result.words) == ("lost", cause, words)
    assert run.message == f"{ONE.name}: lost, {cause}: {words}"
    assert (order, run.state) == (Wait(until_utc_s=event.utc_s), S.WAITING)


def test_drives_that_were_woken_are_on_and_a_pass_that_is_prepared_waits_for_the_weather() -> None:
    run = replace(NIGHT, state=S.PREPARING, passes=(PLAIN,), mount=Mount.PARKED)
    for woken, mount in ((False, Mount.PARKED), (True, Mount.AT_REST)):
        after, order = machine.step(run, PassPrepared(utc_s=NOW, woken=woken))
        assert (after.mount, order, after.state) == (mount, AskWeather(), S.ASKING)


def test_whoever_stops_the_mount_in_a_pass_ends_the_run_with_what_was_said() -> None:
    for ended_by, words, why in (
        ("operator", None, "stopped by the operator"),
        ("stopped", "a hand", "a hand"),
    ):
        attempt = PassAttempt(ended_by, NOW, 3.0, words=words)
        run, order = machine.step(following(PLAIN), Followed(utc_s=NOW, attempt=attempt))
        assert (order, run.state) == (End(why=why, interrupted=True), S.STOPPED)


@pytest.mark.parametrize(
    ("ended_by", "words", "said"), [("link", "silent for 3 s", "silent for 3 s"), ("crash", None, "crash")]
)
def test_a_session_that_ended_is_followed_by_another_part_that_says_why(
    ended_by: str, words: str | None, said: str
) -> None:
    at_s = PLAIN.start_utc_s + 5.0
    run, order = machine.step(
        replace(following(PLAIN), mount=Mount.UNKNOWN),
        Followed(utc_s=at_s, attempt=PassAttempt(ended_by, at_s, 3.0, words=words)),
    )
    assert order == Follow(index=0, part=2, from_utc_s=at_s, pause_s=1.0)
    assert run.message == f"{PLAIN.name}: {said}: following on, part 2"
    assert (run.mount, run.moved_utc_s, run.part_from_utc_s) == (Mount.AT_REST, at_s, at_s)


def test_a_pass_is_begun_anew_after_its_actions_and_each_is_a_motion_of_now() -> None:
    """Whatever is left of another pass before it."""
    left = {"attempts": (PassAttempt("link", NOW, 3.0),), "part": 2, "step": 1, "message": "of before"}
    at_s = ONE.leave_utc_s
    run = replace(NIGHT, state=S.ASKING, passes=(ONE,), mount=Mount.AT_PARK, **left)
    run, order = machine.step(run, WeatherReported(utc_s=at_s, safe=True, words="clear"))
    assert order == DoStep(index=0, when="before", step=0)
    assert (run.step, run.weather) == (0, "clear")
    assert (run.mount, run.moved_utc_s) == (Mount.AT_REST, at_s)
    run = replace(run, step=2, attempts=left["attempts"])
    for event, message in (
        (StepDone(utc_s=at_s + 1.0, done=False, words="no answer"), f"{ONE.name}: {SLEW.words}: no answer"),
        (StepDone(utc_s=at_s + 1.0, done=True), None),
    ):
        after, order = machine.step(run, event)
        assert order == Follow(index=0, part=1, from_utc_s=at_s + 1.0)
        assert (after.message, after.attempts, after.part) == (message, (), 1)
        assert (after.part_from_utc_s, after.moved_utc_s, after.weather) == (at_s + 1.0, at_s + 1.0, "clear")


def test_what_is_known_of_a_mount_that_is_not_parked_is_kept_and_so_is_when_it_moved() -> None:
    paused, _ = machine.step(
        replace(NIGHT, state=S.PARKING, tries=1, mount=Mount.AT_PARK),
        Parked(utc_s=NOW, mount=Mount.UNKNOWN, words="no answer"),
    )
    assert (paused.state, paused.mount) == (S.PAUSING, Mount.UNKNOWN)
    ended = Followed(utc_s=NOW, attempt=PassAttempt("set", NOW, 3.0))
    after, _ = machine.step(replace(following(PLAIN), moved_utc_s=0.0), ended)
    assert (after.state, after.moved_utc_s) == (S.FINISHING if PLAIN.terms.after else S.WAITING, NOW)
    run = replace(NIGHT, state=S.PREPARING, passes=(PLAIN,), mount=Mount.PARKED)
    woken, _ = machine.step(run, PassPrepared(utc_s=NOW, woken=True))
    assert (woken.mount, woken.moved_utc_s) == (Mount.AT_REST, NOW)


def test_a_night_that_is_begun_in_place_of_a_far_one_has_nothing_of_that() -> None:
    over = (FinishedPass(ONE.object_number, ONE.culminate_utc_s),)
    run = replace(ahead(), passes=(ONE,), results=DONE, over=over, others={"x": 1}, state=S.STOPPED)
    after, order = machine.step(run, Started(utc_s=BEGIN + 86_400.0, settings=run.settings))
    assert (after.passes, after.results, after.over, after.others) == ((), (), (), {})
    assert order == MakePlan()


def test_a_pass_that_ends_within_a_second_of_an_earlier_end_is_kept() -> None:
    run = replace(NIGHT, state=S.PLANNING, passes=(PLAIN, LONG))
    for end_s, kept in ((0.9, (PLAIN,)), (1.1, ())):
        at = replace(run.settings, to_utc_s=PLAIN.end_utc_s - end_s)
        after, _ = machine.step(replace(run, settings=at), NotPlanned(utc_s=NOW, words="no answer"))
        assert after.passes == kept
        # Begun again with that end, it plans anew only where a pass is past it.
        waiting = replace(run, state=S.WAITING, settings=at, passes=(PLAIN,))
        _, order = machine.step(waiting, Due(utc_s=NOW))
        assert isinstance(order, MakePlan) is (kept == ())


@pytest.mark.parametrize("late_s", [0.0, 5.0])
def test_a_pass_that_is_shorter_than_what_is_asked_for_is_followed_from_its_start_alone(
    late_s: float,
) -> None:
    long_s = PLAIN.end_utc_s - PLAIN.start_utc_s
    one = one_pass(least_s=long_s + 100.0)
    run = replace(NIGHT, state=S.WAITING, passes=(one,))
    _, order = machine.step(run, Due(utc_s=one.start_utc_s + late_s))
    assert order == (Wait(until_utc_s=one.start_utc_s + late_s) if late_s else Prepare(index=0, wake=False))


def test_a_run_whose_nights_are_over_ends_with_the_last_summary() -> None:
    end_s = NIGHT.settings.to_utc_s or 0.0
    run = replace(NIGHT, state=S.SUMMING_UP, night_to_utc_s=end_s, summary="one.html")
    for file, kept in (("two.html", "two.html"), (None, "one.html")):
        after, order = machine.step(run, SummedUp(utc_s=end_s, file=file, words="written"))
        assert (order, after.summary) == (End(why="all nights are over"), kept)
        assert after.message == "written"


def test_a_recovered_run_goes_on_in_its_night_with_what_is_known_of_it() -> None:
    over = FinishedPass(ONE.object_number, ONE.culminate_utc_s + 119.0)
    noon = BEGIN - 1678.0 + 86_400.0
    known = Recovered(4, BEGIN, noon, Mount.AT_PARK, (over,), "one.html")
    for at_s, night, kept in ((noon - 1.0, 4, (over,)), (noon, 5, ())):
        started = Started(utc_s=at_s, settings=settings(3.0), recovered=known, words="x")
        run, _ = machine.step(Run(), started)
        assert (run.night, run.over, run.mount, run.summary) == (night, kept, Mount.AT_PARK, "one.html")
        assert run.night_from_utc_s <= at_s < run.night_to_utc_s
    run, _ = machine.step(Run(), Started(utc_s=NOW, settings=settings(3.0), recovered=known))
    later = replace(ONE, key="other", culminate_utc_s=ONE.culminate_utc_s + 239.0 + 1.0)
    run, _ = machine.step(run, Planned(utc_s=NOW, passes=(ONE, later)))
    assert run.passes == (replace(later, number=1),)


def test_what_has_no_number_in_the_catalogue_has_one_of_its_own() -> None:
    numbers = [object_number(None, name) for name in ("Moon", "moon", "Mars", "Moon")]
    numbers += [object_number(number, name) for number in (0, 99_999) for name in ("OBJECT A", "OBJECT B")]
    assert max(numbers) < 0
    assert len(set(numbers)) == 5
    assert object_number(25544, "ISS") == 25544


@pytest.mark.parametrize(("longitude_deg", "noon_s"), [(0.0, 43_200.0), (4.5, 42_120.0), (-120.0, 72_000.0)])
def test_nights_change_at_the_sites_mean_noon(longitude_deg: float, noon_s: float) -> None:
    """Fifteen degrees east are an hour earlier."""
    assert mean_noon_s(longitude_deg) == noon_s


@pytest.mark.parametrize(
    ("from_s", "to_s", "ends"),
    [
        # BEGIN is noon in UTC: the site's, at 41522 s, was 1678 s before.
        (0.0, 3.0 * 86_400.0, [84_722.0, 171_122.0, 259_200.0]),
        (-1678.0, 86_400.0, [86_400.0]),
        (0.0, 84_722.0 + 14_399.0, [84_722.0 + 14_399.0]),
        (0.0, 84_722.0 + 14_401.0, [84_722.0, 84_722.0 + 14_401.0]),
    ],
)
def test_a_night_ends_at_noon_and_a_few_hours_at_the_end_are_no_night_of_their_own(
    from_s: float, to_s: float, ends: list[float]
) -> None:
    at = RunSettings(BEGIN + from_s, BEGIN + to_s, 41_522.0)
    run, order = machine.step(Run(), Started(utc_s=BEGIN - 9000.0, settings=at))
    assert (run.night_from_utc_s, run.state) == (BEGIN + from_s, S.RESTING)
    found = []
    while not isinstance(order, End):
        found.append(run.night_to_utc_s - BEGIN)
        run, order = machine.step(replace(run, state=S.SUMMING_UP), SummedUp(utc_s=run.night_to_utc_s - 60.0))
    assert found == pytest.approx(ends)


@pytest.mark.parametrize(("noon_s", "ends_s"), [(20_000.0, 63_200.0), (60_000.0, 16_800.0)])
def test_a_night_that_is_begun_at_noon_in_utc_ends_at_the_sites_next_noon(
    noon_s: float, ends_s: float
) -> None:
    run, _ = machine.step(Run(), Started(utc_s=BEGIN, settings=RunSettings(BEGIN, None, noon_s)))
    assert run.night_to_utc_s == BEGIN + ends_s
