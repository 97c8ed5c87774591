"""The orders of a schedule's run carried out in virtual time: idle time is skipped, passes are flown."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from sattrack.control.manual.procedures import ParkThere, SlewThere
from sattrack.core.errors import SattrackError
from sattrack.mount.requests import TicketState
from sattrack.schedule import night_troubles as troubles
from sattrack.schedule.actions import CommandAction, SlewAction
from sattrack.schedule.night import (
    AskWeather,
    ClockSet,
    DoStep,
    Due,
    End,
    Follow,
    Followed,
    Go,
    Laid,
    LayDown,
    MakePlan,
    Mount,
    NotPlanned,
    Planned,
    Prepare,
    Prepared,
    StepDone,
    StopAsked,
    SummedUp,
    SumUp,
    Wait,
    WeatherTold,
)
from sattrack.schedule.night_flight import Airspace, SessionDiedError
from sattrack.schedule.night_journal import Beat, go_name
from sattrack.schedule.night_stop import NightRequests
from sattrack.schedule.summary import headline
from sattrack.schedule.transitions import slew_of
from tle.errors import TleError

if TYPE_CHECKING:
    from collections.abc import Callable

    from sattrack.schedule.night import Doing, Happening, NightPass, Run
    from sattrack.schedule.night_journal import Journal

    Plan = Callable[[float, float, float], Planned]
    """Makes the plan of a night, from one instant to another, at an instant."""
    SumUpNight = Callable[[Run], str]

BEAT_EVERY_S = 5.0
RESTART_S = 5.0
"""How long it takes until a runner that was killed is up again."""
NEVER = 1e18


@dataclass(slots=True)
class VirtualHands:
    """A simulated mount and a clock that is told."""

    air: Airspace
    plan: Plan
    sum_up: SumUpNight
    journal: Journal
    troubles: troubles.Troubles = field(default_factory=troubles.Troubles)
    weather_asked: bool = False
    requests: NightRequests = field(default_factory=lambda: NightRequests(Path(os.devnull)))
    now_utc_s: float = 0.0
    _power: bool = True
    _jumped: int = 0
    """Of the nights up to this number the clock's jump was had."""

    def begin(self, beat: Beat | None) -> float:
        """See Hands."""
        if beat is not None:
            self.now_utc_s = beat.utc_s + RESTART_S
            self._power, self._jumped = beat.power, beat.jumps
            if beat.hour_angle_deg is not None and beat.dec_deg is not None:
                self.air.hour_angle_deg, self.air.dec_deg = beat.hour_angle_deg, beat.dec_deg
        self._beat()
        return self.now_utc_s

    def perform(self, doing: Doing, run: Run) -> Happening | None:
        """See Hands."""
        found = self._perform(doing, run)
        if not isinstance(found, Followed):
            self._beat()
        if self.requests.restarts:
            return None
        if self.requests.asked and not isinstance(found, Followed):
            return StopAsked(utc_s=self.now_utc_s, words=self.requests.words)
        return found

    def _perform(self, doing: Doing, run: Run) -> Happening:
        found: Happening
        match doing:
            case Wait():
                found = self._wait(doing.until_utc_s, run)
            case MakePlan():
                found = self._make_plan(run)
            case Prepare():
                found = self._prepare(run.passes[doing.index], doing.wake)
            case AskWeather():
                words = self._unsafe(run, self.now_utc_s)
                safe = None if not self.weather_asked else words is None
                found = WeatherTold(utc_s=self.now_utc_s, safe=safe, words=words)
            case DoStep():
                found = self._do(doing, run.passes[doing.index])
            case Follow():
                found = self._follow(doing, run)
            case LayDown():
                found = self._lay_down(doing, run)
            case SumUp():
                file = self.sum_up(run)
                found = SummedUp(utc_s=self.now_utc_s, file=file, words=headline(run))
            case End():
                raise ValueError("an end is not performed")
        return found

    def _beat(self, go: str | None = None, on_target_s: float = 0.0) -> None:
        self.journal.beat(
            Beat(
                utc_s=self.now_utc_s,
                go=go,
                on_target_s=on_target_s,
                hour_angle_deg=self.air.hour_angle_deg,
                dec_deg=self.air.dec_deg,
                power=self._power,
                jumps=self._jumped,
            )
        )

    def _wait(self, until_utc_s: float, run: Run) -> Happening:
        jump = self.troubles.jumps(run.night, *_evening(run))
        if jump is not None and run.night > self._jumped and jump.utc_s < until_utc_s:
            self._jumped = run.night
            self.now_utc_s = max(self.now_utc_s, jump.utc_s) + jump.seconds
            return ClockSet(utc_s=self.now_utc_s, seconds=jump.seconds, slept=jump.slept)
        self.now_utc_s = max(self.now_utc_s, until_utc_s)
        return Due(utc_s=self.now_utc_s)

    def _make_plan(self, run: Run) -> Happening:
        begin = max(self.now_utc_s, run.night_from_utc_s)
        try:
            planned = self.plan(begin, run.night_to_utc_s, self.now_utc_s)
        except (SattrackError, TleError) as error:
            return NotPlanned(utc_s=self.now_utc_s, words=str(error).splitlines()[0])
        return planned

    def _prepare(self, one: NightPass, wake: bool) -> Prepared:
        now = self.now_utc_s
        if wake:
            if self.troubles.happens(troubles.WAKE_FAILS, "wake", one.key):
                return Prepared(utc_s=now, cause="power", words="the drives' power did not come back")
            self._power = True
        if self.troubles.happens(troubles.OLD_ELEMENTS, "elements", one.key):
            return Prepared(utc_s=now, cause="elements too old", words="none newer were to be had")
        return Prepared(utc_s=now, woken=wake)

    def _unsafe(self, run: Run, utc_s: float) -> str | None:
        if not self.weather_asked:
            return None
        unsafe = self.troubles.unsafe(run.night, *_evening(run))
        if unsafe is None or not unsafe.begin_utc_s <= utc_s < unsafe.end_utc_s:
            return None
        return "clouds, made up"

    def _do(self, doing: DoStep, one: NightPass) -> StepDone:
        action = doing.action_of(one)
        if isinstance(action, SlewAction):
            return self._slew(action)
        words = None
        if isinstance(action, CommandAction):
            name = (one.key, doing.when, doing.step)
            if self.troubles.happens(troubles.ACTION_HANGS, "hangs", *name):
                words = f"not done within {action.timeout_s:g} s"
                self.now_utc_s += action.timeout_s if action.wait else 0.0
            elif self.troubles.happens(troubles.ACTION_FAILS, "fails", *name):
                words = "ended with 1"
        return StepDone(utc_s=self.now_utc_s, done=words is None, words=words)

    def _slew(self, action: SlewAction) -> StepDone:
        slew = slew_of(action, self.now_utc_s, self.air.site, self.air.profile.mount)
        outcome, self.now_utc_s = self.air.go(SlewThere(slew), self.now_utc_s)
        self.now_utc_s += action.wait_s
        done = outcome is not None and outcome.state is TicketState.COMPLETE
        words = None if done else "no outcome" if outcome is None else outcome.reason or outcome.state.value
        return StepDone(utc_s=self.now_utc_s, done=done, words=words)

    def _follow(self, doing: Follow, run: Run) -> Followed:
        one = run.passes[doing.index]
        self.now_utc_s += doing.pause_s
        if not self._power:
            go = Go("error", self.now_utc_s, words="the drives have no power")
            return Followed(utc_s=self.now_utc_s, go=go)
        faults = self.troubles.faults(one.key, doing.part)
        dies_at = NEVER
        if faults is None:
            begin = max(one.start_utc_s, self.now_utc_s)
            dies_at = begin + self.troubles.ends_after_s(one.key, doing.part)
        on_target = [0.0]
        beaten = [self.now_utc_s]

        def watch(utc_s: float, on_target_s: float) -> str | None:
            self.now_utc_s, on_target[0] = utc_s, on_target_s
            if utc_s - beaten[0] >= BEAT_EVERY_S:
                beaten[0] = utc_s
                self._beat(go_name(one, doing.part), on_target_s)
            if utc_s >= dies_at:
                return "crash"
            if self.requests.asked:
                return "stopped"
            unsafe = self._unsafe(run, utc_s) if one.terms.if_weather_unsafe != "run" else None
            return None if unsafe is None else "weather"

        try:
            go = self.air.fly(one, self.now_utc_s, faults or "", watch)
        except SessionDiedError:
            words = "the session's process ended without a word"
            go = Go("crash", self.now_utc_s, on_target_s=round(on_target[0], 3), words=words)
        self.now_utc_s = max(self.now_utc_s, go.ended_utc_s)
        self._beat(go_name(one, doing.part), go.on_target_s)
        return Followed(utc_s=self.now_utc_s, go=go)

    def _lay_down(self, doing: LayDown, run: Run) -> Laid:
        if self.troubles.happens(troubles.PARK_FAILS, "park", run.night, run.tries, len(run.results)):
            self.now_utc_s += RESTART_S
            return Laid(utc_s=self.now_utc_s, mount=Mount.AT_REST, words="the mount did not answer, made up")
        if not self._power:
            return Laid(utc_s=self.now_utc_s, mount=Mount.PARKED)
        park = ParkThere(self.air.profile.mount, power_off=doing.power_off)
        outcome, self.now_utc_s = self.air.go(park, self.now_utc_s)
        if outcome is None or outcome.state not in (TicketState.COMPLETE, TicketState.UNCONFIRMED):
            words = "no outcome" if outcome is None else outcome.reason or outcome.state.value
            return Laid(utc_s=self.now_utc_s, mount=Mount.AT_REST, words=words)
        self._power = not doing.power_off
        return Laid(utc_s=self.now_utc_s, mount=Mount.PARKED if doing.power_off else Mount.AT_PARK)


def _evening(run: Run) -> tuple[float, float]:
    """Return from when to when there is something to do in a night."""
    if not run.passes:
        return run.night_from_utc_s, run.night_from_utc_s
    return run.passes[0].leave_utc_s, run.passes[-1].end_utc_s
