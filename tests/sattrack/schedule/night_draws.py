"""Nights drawn at random for the runner's machine, and a world that answers its orders at random."""

from __future__ import annotations

from dataclasses import dataclass, field
from random import Random

from sattrack.runtime import demo_pass
from sattrack.schedule.machine import REVISION
from sattrack.schedule.night import (
    AskWeather,
    ClockSet,
    DoStep,
    Due,
    Event,
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
    Run,
    RunSettings,
    StepDone,
    SummedUp,
    Wait,
    WeatherReported,
)
from sattrack.schedule.schema import CommandAction, SlewAction, Terms, WebhookAction

BEGIN = 1_790_942_400.0
NOON_S = 41_522.0
ACTIONS = (
    SlewAction(star="Vega"),
    CommandAction(run=("x",), if_it_fails="skip"),
    CommandAction(run=("y",)),
    WebhookAction(url="https://example.org/"),
)


def settings(nights: float) -> RunSettings:
    return RunSettings(BEGIN, BEGIN + nights * 86400.0, NOON_S, revision=REVISION)


def drawn_passes(random: Random, night: int, begin: float, end: float) -> tuple[NightPass, ...]:
    """Return passes that do not overlap, with actions of all kinds about them."""
    found = []
    at = begin + random.uniform(0.0, 3600.0)
    while at < end - 1200.0 and len(found) < 5:
        before = tuple(random.sample(ACTIONS, random.randint(0, 3)))
        leave, start = at, at + 25.0 * len(before) + random.uniform(10.0, 60.0)
        last = start + random.uniform(70.0, 600.0)
        terms = Terms(
            before=before,
            after=tuple(random.sample(ACTIONS[2:], random.randint(0, 2))),
            if_weather_unsafe=random.choice(("wait", "skip", "run")),
        )
        found.append(
            NightPass(
                key=f"{night}/{len(found)}",
                number=len(found) + 1,
                elements=demo_pass.elements(),
                start_utc_s=start,
                culminate_utc_s=0.5 * (start + last),
                end_utc_s=last,
                leave_utc_s=leave,
                max_alt_deg=50.0,
                priority=1.0,
                useful_s=last - start,
                terms=terms,
                asked_by="a draw",
            )
        )
        at = last + 70.0 + random.choice((20.0, 300.0, 5000.0)) * random.uniform(0.2, 1.0)
    return tuple(found)


@dataclass
class World:
    """Answers orders at random, and keeps what it was told to do; `harm` is the share that goes wrong."""

    seed: int
    harm: float = 0.2
    now: float = BEGIN
    followed: list[tuple[str, float, float]] = field(default_factory=list)
    commands: list[tuple[str, str, int]] = field(default_factory=list)
    power: bool = True

    def __post_init__(self) -> None:
        self.random = Random(self.seed)

    def goes_wrong(self, share: float = 1.0) -> bool:
        return self.random.random() < self.harm * share

    def answer(self, order: Order, run: Run) -> Event:
        match order:
            case Wait():
                return self._wait(order.until_utc_s)
            case MakePlan():
                if self.goes_wrong():
                    return NotPlanned(utc_s=self.now, words="no elements")
                passes = drawn_passes(
                    Random(f"{self.seed} {run.night}"),
                    run.night,
                    max(self.now, run.night_from_utc_s),
                    run.night_to_utc_s,
                )
                return Planned(utc_s=self.now, passes=passes)
            case Prepare():
                self.now += 1.0
                cause = "elements too old" if self.goes_wrong(0.3) else None
                self.power = self.power or order.wake
                return PassPrepared(utc_s=self.now, cause=cause, woken=order.wake)
            case AskWeather():
                return WeatherReported(utc_s=self.now, safe=not self.goes_wrong(), words="rain")
            case DoStep():
                if order.asks_weather(run.passes[order.index]) and self.goes_wrong(0.3):
                    return WeatherReported(utc_s=self.now, safe=False, words="rain")
                action = order.action_of(run.passes[order.index])
                if not isinstance(action, SlewAction):
                    self.commands.append((run.passes[order.index].key, order.when, order.step))
                self.now += self.random.uniform(0.0, 20.0)
                return StepDone(utc_s=self.now, done=not self.goes_wrong(), words="failed")
            case Follow():
                return self._follow(order, run.passes[order.index])
            case ParkMount():
                self.now += 10.0
                if self.goes_wrong():
                    return Parked(utc_s=self.now, mount=Mount.AT_REST, words="no answer")
                self.power = not order.power_off
                return Parked(utc_s=self.now, mount=Mount.PARKED if order.power_off else Mount.AT_PARK)
        return SummedUp(utc_s=self.now, file="summary")

    def _wait(self, until: float) -> Event:
        if self.goes_wrong(0.1):
            seconds = self.random.choice((-3600.0, 1800.0, 90000.0))
            self.now = max(self.now, min(until, self.now + 100.0)) + seconds
            return ClockSet(utc_s=self.now, seconds=seconds, slept=seconds > 0.0)
        self.now = max(self.now, until)
        return Due(utc_s=self.now)

    def _follow(self, order: Follow, one: NightPass) -> Followed:
        assert self.power
        begin = max(self.now, one.start_utc_s)
        ended_by, end = "set", one.end_utc_s
        if self.goes_wrong():
            ended_by = self.random.choice(("link", "crash", "limit:sun", "weather"))
            end = self.random.uniform(begin, one.end_utc_s)
        self.followed.append((one.key, begin, end))
        self.now = max(self.now, end)
        attempt = PassAttempt(ended_by, self.now, on_target_s=max(0.0, end - begin), rms_arcsec=0.5)
        return Followed(utc_s=self.now, attempt=attempt)
