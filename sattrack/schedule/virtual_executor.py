"""A schedule's run in virtual time: idle time is skipped, passes are flown on one simulated mount.

Troubles are drawn from a seed: the same seed, the same troubles. Each draw has a name of its own, so that it
does not depend on what was drawn before it: a run that was interrupted meets the same troubles as one that
was not.
"""

from __future__ import annotations

import math
import os
from dataclasses import dataclass, field, replace
from pathlib import Path
from random import Random
from typing import TYPE_CHECKING, NamedTuple

import msgspec

from sattrack.control.console import Console
from sattrack.control.engine import Engine
from sattrack.control.manual_operation import ManualOperation
from sattrack.control.procedures import ParkThere, SlewThere
from sattrack.control.tracker import TrackPlan
from sattrack.core.errors import SattrackError
from sattrack.core.process import gc_paused
from sattrack.mount.requests import TicketState
from sattrack.mount.simulator.mount import SimulatedMount, StartPosition
from sattrack.mount.simulator.profile import simulator_profile
from sattrack.planning.trace import TabledPropagator
from sattrack.recording.recorder import NoRecording
from sattrack.runtime.connection import simulated_site
from sattrack.runtime.facts import RunFacts, build_engine, with_detours, with_followed
from sattrack.runtime.flight import VirtualRun, summarise
from sattrack.runtime.mounts import SIMULATED
from sattrack.schedule.night import (
    AskWeather,
    ClockSet,
    DoStep,
    Due,
    End,
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
    StepDone,
    StopAsked,
    SummedUp,
    SumUp,
    Wait,
    WeatherReported,
)
from sattrack.schedule.night_folder import Heartbeat, attempt_name
from sattrack.schedule.night_processes import search_times
from sattrack.schedule.night_stop import NightRequests
from sattrack.schedule.schema import CommandAction, SlewAction
from sattrack.schedule.summary import headline
from sattrack.schedule.transitions import slew_of
from sattrack.settings import SiteSettings
from sattrack.views.messages import Search, StopNow
from tle.elements import Elements
from tle.errors import TleError
from tle.refraction import Refraction

if TYPE_CHECKING:
    from collections.abc import Callable

    from sattrack.control.procedures import Outcome, Procedure
    from sattrack.mount.model import MountProfile
    from sattrack.mount.profiles import ProfileFile
    from sattrack.mount.simulator.mount import Truth
    from sattrack.safety import SafetyLimits
    from sattrack.schedule.candidates import Candidate
    from sattrack.schedule.night import Event, Order, Run
    from sattrack.schedule.night_folder import Journal
    from sattrack.schedule.schema import Terms
    from sattrack.views.messages import Message
    from tle.site import Site

    Plan = Callable[[float, float, float], Planned]
    """Makes the plan of a night, from one instant to another, at an instant."""
    SumUpNight = Callable[[Run], str]
    Watch = Callable[[float, float], str | None]
    """Called with the instant and the seconds on target; returns why the run must end, if it must."""


FAULTS: tuple[tuple[float, str], ...] = (
    (0.66, ""),
    (0.06, "loss=15%"),
    (0.05, "cut@{at}s+4s"),
    (0.05, "cut@{at}s+90s"),
    (0.04, "crash@{at}s+5s"),
    (0.03, "drive@{at}s"),
    (0.03, "freeze@{at}s+2s"),
    (0.03, "silent@0s"),
)
"""The mount's faults in a pass, by share, as `sattrack sim --faults` has it; else a session ends."""
FAULTS_WITHIN_S = 180.0
UNSAFE_NIGHTS = 0.3
UNSAFE_LEAST_S, UNSAFE_MOST_S = 600.0, 5400.0
OLD_ELEMENTS, ACTION_FAILS, ACTION_HANGS, PARK_FAILS, WAKE_FAILS = 0.03, 0.1, 0.1, 0.15, 0.02
JUMP_NIGHTS = 0.4
JUMPS: tuple[tuple[bool, float], ...] = ((False, -3600.0), (False, 900.0), (True, 1800.0))
"""Jumps of the clock: the computer slept, or not, and by how many seconds."""


class Jump(NamedTuple):
    """A jump of the machine's clock, at an instant of it."""

    utc_s: float
    seconds: float
    slept: bool


class Unsafe(NamedTuple):
    """Unsafe weather, from one instant to another."""

    begin_utc_s: float
    end_utc_s: float


@dataclass(frozen=True, slots=True)
class Troubles:
    """All that goes wrong in a run; with `seed` None, nothing does."""

    seed: int | None = None

    def _random(self, *name: object) -> Random:
        return Random(" ".join(str(part) for part in (self.seed, *name)))

    def faults(self, key: str, part: int) -> str | None:
        """Return the mount's faults in an attempt at a pass; None where the session itself ends."""
        if self.seed is None:
            return ""
        random = self._random("fault", key, part)
        drawn, at = random.random(), round(random.uniform(5.0, FAULTS_WITHIN_S), 1)
        for share, faults in FAULTS:
            if drawn < share:
                return faults.format(at=at)
            drawn -= share
        return None

    def ends_after_s(self, key: str, part: int) -> float:
        """Return after how many seconds the session ends by itself."""
        return self._random("end", key, part).uniform(5.0, FAULTS_WITHIN_S)

    def unsafe(self, night: int, begin_utc_s: float, end_utc_s: float) -> Unsafe | None:
        """Return when the weather is unsafe in a night's hours; None where it is not."""
        if self.seed is None:
            return None
        random = self._random("weather", night)
        if random.random() >= UNSAFE_NIGHTS:
            return None
        begin = random.uniform(begin_utc_s - UNSAFE_LEAST_S, end_utc_s)
        return Unsafe(begin, begin + random.uniform(UNSAFE_LEAST_S, UNSAFE_MOST_S))

    def jumps(self, night: int, begin_utc_s: float, end_utc_s: float) -> Jump | None:
        """Return how the clock jumps in a night's hours; None where it does not."""
        if self.seed is None:
            return None
        random = self._random("clock", night)
        if random.random() >= JUMP_NIGHTS:
            return None
        slept, seconds = random.choice(JUMPS)
        return Jump(random.uniform(begin_utc_s, end_utc_s), seconds, slept)

    def happens(self, share: float, *name: object) -> bool:
        """Return whether something with a share of so much happens."""
        return self.seed is not None and self._random(*name).random() < share


LEAD_S = 5.0
LOOK_EVERY_TURNS = 20
MARGIN_S = 60.0
ERRAND_WITHIN_S = 300.0


class SessionDiedError(Exception):
    """The session's process ended without a word."""


class WatchedMount(SimulatedMount):
    """A simulated mount that was on before: its encoders know the cables' turns; with its last position."""

    last: Truth | None = None

    def __post_init__(self) -> None:
        """See SimulatedMount."""
        super().__post_init__()
        for driven, cable_deg in ((self._ra, self.start.hour_angle_deg), (self._dec, self.start.dec_deg)):
            driven.turns_deg = 0.0
            driven.axis.place(cable_deg, driven.sky_rate_deg_s)

    def tick(self, now_utc_s: float) -> tuple[bytes, Truth]:
        """See SimulatedMount."""
        status, self.last = super().tick(now_utc_s)
        return status, self.last


class WatchedRun(VirtualRun):
    """A virtual run that is looked at once a second."""

    watcher: Callable[[float], None] | None = None

    def _client_turn(self, now_utc_s: float, turn: int) -> None:
        super()._client_turn(now_utc_s, turn)
        if turn % LOOK_EVERY_TURNS == 0 and self.watcher is not None:
            self.watcher(now_utc_s)


@dataclass(slots=True)
class SimulatedStation:
    """The simulated mount at its site between runs, and what each run begins with."""

    site: Site
    profile: ProfileFile
    limits: SafetyLimits
    hour_angle_deg: float
    dec_deg: float

    def fly(self, one: NightPass, now_utc_s: float, faults: str, watch: Watch) -> PassAttempt:
        """Follow a pass from an instant on, with the mount's faults; `watch` may end it.

        Raises SessionDiedError where it says "crash"; the mount is at rest then as its guardian leaves it.
        """
        facts = self._facts(one, now_utc_s)
        engine = _tabled_engine(facts)
        mount = self._mount(faults)
        messages = _searches(one, facts.plan)
        ended: list[str] = []

        def look(utc_s: float) -> None:
            why = watch(utc_s, engine.on_target_s)
            if why == "crash":
                raise SessionDiedError
            if why is not None and not ended:
                ended.append(why)
                engine.operate(StopNow(), utc_s)

        run = WatchedRun(engine, mount, facts.started_utc_s, NoRecording(), messages)
        run.watcher = look
        try:
            with gc_paused():
                ended_utc_s = run.run()
        finally:
            self._note(mount)
        summary = summarise(engine, run.statistics, ended_utc_s)
        return PassAttempt(
            ended_by=ended[0] if ended else summary.ended_by,
            ended_utc_s=ended_utc_s,
            on_target_s=summary.on_target_s,
            rms_arcsec=_rounded(summary.reported_rms_arcsec),
            peak_arcsec=_rounded(summary.reported_peak_arcsec),
            words=summary.message,
            held_s=summary.held_s,
            rejoining_s=summary.rejoining_s,
            lost_peak_arcsec=_rounded(summary.lost_peak_arcsec),
        )

    def perform(self, procedure: Procedure, now_utc_s: float) -> tuple[Outcome | None, float]:
        """Carry out a manual operation of the mount; return its outcome, and when it ended."""
        profile = self.profile.mount
        console = Console(profile, self.limits, self.site, SIMULATED)
        errand = ManualOperation(console, procedure, now_utc_s, ERRAND_WITHIN_S)
        mount = self._mount("")
        period_s, turns = profile.period_s, 0
        with gc_paused():
            while not errand.finished:
                now_utc_s += period_s
                turns += 1
                status, _ = mount.tick(now_utc_s)
                errand.receive(status, now_utc_s)
                datagram = errand.tick(now_utc_s)
                if datagram is not None:
                    mount.receive(datagram)
        self._note(mount)
        return errand.outcome, now_utc_s

    def _mount(self, faults: str) -> WatchedMount:
        hardware = simulator_profile(self.profile.simulator)
        if faults:
            both = ",".join(part for part in (hardware.faults, faults) if part)
            hardware = msgspec.structs.replace(hardware, faults=both)
        site = simulated_site(self.site)
        start = StartPosition(self.hour_angle_deg, self.dec_deg)
        return WatchedMount(self.profile.mount, site, start, hardware)

    def _note(self, mount: WatchedMount) -> None:
        if mount.last is not None:
            self.hour_angle_deg = round(mount.last.hour_angle_axis_deg, 6)
            self.dec_deg = round(mount.last.dec_axis_deg, 6)

    def _facts(self, one: NightPass, now_utc_s: float) -> RunFacts:
        plan = TrackPlan(start_utc_s=max(one.start_utc_s, now_utc_s), end_utc_s=one.end_utc_s)
        started_utc_s = max(now_utc_s, plan.start_utc_s - plan.approach_s - LEAD_S)
        mount = self.profile.mount
        return planned_facts(one, one.terms, plan, started_utc_s, self.site, mount, self.limits)


def _searches(one: NightPass, plan: TrackPlan) -> tuple[tuple[float, Message], ...]:
    """Return the searches of a pass as an operator's messages, each with its instant."""
    found: list[tuple[float, Message]] = []
    for search, begin, end in search_times(one, plan.start_utc_s):
        found.append((begin, search))
        found.append((end, Search("cancel")))
    return tuple(found)


def _tabled_engine(facts: RunFacts) -> Engine:
    """Return an engine whose directions come from a table, which is as good and takes less time."""
    spec = build_engine(facts).spec
    begin, end = facts.started_utc_s - MARGIN_S, facts.plan.end_utc_s + MARGIN_S
    tabled = TabledPropagator(spec.propagator, spec.bias, begin, end)
    return Engine(replace(spec, propagator=tabled, if_mount_refracts=tabled))


def _rounded(arcsec: float | None) -> float | None:
    return None if arcsec is None or not math.isfinite(arcsec) else round(arcsec, 4)


BEAT_EVERY_S = 5.0
RESTART_S = 5.0
"""How long it takes until a runner that was killed is up again."""
NEVER = 1e18


@dataclass(slots=True)
class VirtualExecutor:
    """A simulated mount and a simulated clock."""

    station: SimulatedStation
    plan: Plan
    sum_up: SumUpNight
    journal: Journal
    troubles: Troubles = field(default_factory=Troubles)
    weather_asked: bool = False
    requests: NightRequests = field(default_factory=lambda: NightRequests(Path(os.devnull)))
    now_utc_s: float = 0.0
    _power: bool = True
    _jumped: int = 0
    """Of the nights up to this number the clock's jump has come."""

    def begin(self, beat: Heartbeat | None) -> float:
        """See Executor."""
        if beat is not None:
            self.now_utc_s = beat.utc_s + RESTART_S
            self._power, self._jumped = beat.power, beat.jumps
            if beat.hour_angle_deg is not None and beat.dec_deg is not None:
                self.station.hour_angle_deg, self.station.dec_deg = beat.hour_angle_deg, beat.dec_deg
        self._beat()
        return self.now_utc_s

    def perform(self, order: Order, run: Run) -> Event | None:
        """See Executor."""
        found = self._perform(order, run)
        if not isinstance(found, Followed):
            self._beat()
        if self.requests.restarts:
            return None
        if self.requests.asked and not isinstance(found, Followed):
            return StopAsked(utc_s=self.now_utc_s, words=self.requests.words)
        return found

    def _perform(self, order: Order, run: Run) -> Event:
        found: Event
        match order:
            case Wait():
                found = self._wait(order.until_utc_s, run)
            case MakePlan():
                found = self._make_plan(run)
            case Prepare():
                found = self._prepare(run.passes[order.index], order.wake)
            case AskWeather():
                found = self._ask_weather(run)
            case DoStep():
                one = run.passes[order.index]
                report = self._ask_weather(run) if order.asks_weather(one) else None
                found = report if report is not None and report.safe is False else self._do(order, one)
            case Follow():
                found = self._follow(order, run)
            case ParkMount():
                found = self._park(order, run)
            case SumUp():
                file = self.sum_up(run)
                found = SummedUp(utc_s=self.now_utc_s, file=file, words=headline(run))
            case End():
                raise ValueError("an end is not performed")
        return found

    def _beat(self, attempt: str | None = None, on_target_s: float = 0.0) -> None:
        self.journal.beat(
            Heartbeat(
                utc_s=self.now_utc_s,
                attempt=attempt,
                on_target_s=on_target_s,
                hour_angle_deg=self.station.hour_angle_deg,
                dec_deg=self.station.dec_deg,
                power=self._power,
                jumps=self._jumped,
            )
        )

    def _wait(self, until_utc_s: float, run: Run) -> Event:
        jump = self.troubles.jumps(run.night, *_evening(run))
        if jump is not None and run.night > self._jumped and jump.utc_s < until_utc_s:
            self._jumped = run.night
            self.now_utc_s = max(self.now_utc_s, jump.utc_s) + jump.seconds
            return ClockSet(utc_s=self.now_utc_s, seconds=jump.seconds, slept=jump.slept)
        self.now_utc_s = max(self.now_utc_s, until_utc_s)
        return Due(utc_s=self.now_utc_s)

    def _make_plan(self, run: Run) -> Event:
        begin = max(self.now_utc_s, run.night_from_utc_s)
        try:
            planned = self.plan(begin, run.night_to_utc_s, self.now_utc_s)
        except (SattrackError, TleError) as error:
            return NotPlanned(utc_s=self.now_utc_s, words=str(error).splitlines()[0])
        return planned

    def _prepare(self, one: NightPass, wake: bool) -> PassPrepared:
        now = self.now_utc_s
        if wake:
            if self.troubles.happens(WAKE_FAILS, "wake", one.key):
                return PassPrepared(utc_s=now, cause="power", words="the drives' power did not come back")
            self._power = True
        if self.troubles.happens(OLD_ELEMENTS, "elements", one.key):
            return PassPrepared(utc_s=now, cause="elements too old", words="none newer are available")
        return PassPrepared(utc_s=now, woken=wake)

    def _ask_weather(self, run: Run) -> WeatherReported:
        words = self._unsafe(run, self.now_utc_s)
        safe = None if not self.weather_asked else words is None
        return WeatherReported(utc_s=self.now_utc_s, safe=safe, words=words)

    def _unsafe(self, run: Run, utc_s: float) -> str | None:
        if not self.weather_asked:
            return None
        unsafe = self.troubles.unsafe(run.night, *_evening(run))
        if unsafe is None or not unsafe.begin_utc_s <= utc_s < unsafe.end_utc_s:
            return None
        return "clouds, made up"

    def _do(self, order: DoStep, one: NightPass) -> StepDone:
        action = order.action_of(one)
        if isinstance(action, SlewAction):
            return self._slew(action)
        words = None
        if isinstance(action, CommandAction):
            name = (one.key, order.when, order.step)
            if self.troubles.happens(ACTION_HANGS, "hangs", *name):
                words = f"not done within {action.timeout_s:g} s"
                self.now_utc_s += action.timeout_s if action.wait else 0.0
            elif self.troubles.happens(ACTION_FAILS, "fails", *name):
                words = "ended with 1"
        return StepDone(utc_s=self.now_utc_s, done=words is None, words=words)

    def _slew(self, action: SlewAction) -> StepDone:
        slew = slew_of(action, self.now_utc_s, self.station.site, self.station.profile.mount)
        outcome, self.now_utc_s = self.station.perform(SlewThere(slew), self.now_utc_s)
        self.now_utc_s += action.wait_s
        done = outcome is not None and outcome.state is TicketState.COMPLETE
        words = None if done else "no outcome" if outcome is None else outcome.reason or outcome.state.value
        return StepDone(utc_s=self.now_utc_s, done=done, words=words)

    def _follow(self, order: Follow, run: Run) -> Followed:
        one = run.passes[order.index]
        self.now_utc_s += order.pause_s
        if not self._power:
            attempt = PassAttempt("error", self.now_utc_s, words="the drives have no power")
            return Followed(utc_s=self.now_utc_s, attempt=attempt)
        faults = self.troubles.faults(one.key, order.part)
        dies_at = NEVER
        if faults is None:
            begin = max(one.start_utc_s, self.now_utc_s)
            dies_at = begin + self.troubles.ends_after_s(one.key, order.part)
        on_target = [0.0]
        beaten = [self.now_utc_s]

        def watch(utc_s: float, on_target_s: float) -> str | None:
            self.now_utc_s, on_target[0] = utc_s, on_target_s
            if utc_s - beaten[0] >= BEAT_EVERY_S:
                beaten[0] = utc_s
                self._beat(attempt_name(one, order.part), on_target_s)
            if utc_s >= dies_at:
                return "crash"
            if self.requests.asked:
                return "stopped"
            unsafe = self._unsafe(run, utc_s) if one.terms.if_weather_unsafe != "run" else None
            return None if unsafe is None else "weather"

        try:
            attempt = self.station.fly(one, self.now_utc_s, faults or "", watch)
        except SessionDiedError:
            words = "the session's process ended without a word"
            attempt = PassAttempt("crash", self.now_utc_s, on_target_s=round(on_target[0], 3), words=words)
        self.now_utc_s = max(self.now_utc_s, attempt.ended_utc_s)
        self._beat(attempt_name(one, order.part), attempt.on_target_s)
        return Followed(utc_s=self.now_utc_s, attempt=attempt)

    def _park(self, order: ParkMount, run: Run) -> Parked:
        if self.troubles.happens(PARK_FAILS, "park", run.night, run.tries, len(run.results)):
            self.now_utc_s += RESTART_S
            return Parked(
                utc_s=self.now_utc_s, mount=Mount.AT_REST, words="the mount did not answer, made up"
            )
        if not self._power:
            return Parked(utc_s=self.now_utc_s, mount=Mount.PARKED)
        park = ParkThere(self.station.profile.mount, power_off=order.power_off)
        outcome, self.now_utc_s = self.station.perform(park, self.now_utc_s)
        if outcome is None or outcome.state not in (TicketState.COMPLETE, TicketState.UNCONFIRMED):
            words = "no outcome" if outcome is None else outcome.reason or outcome.state.value
            return Parked(utc_s=self.now_utc_s, mount=Mount.AT_REST, words=words)
        self._power = not order.power_off
        return Parked(utc_s=self.now_utc_s, mount=Mount.PARKED if order.power_off else Mount.AT_PARK)


def _evening(run: Run) -> tuple[float, float]:
    """Return from when to when there is something to do in a night."""
    if not run.passes:
        return run.night_from_utc_s, run.night_from_utc_s
    return run.passes[0].leave_utc_s, run.passes[-1].end_utc_s


def planned_facts(
    one: Candidate | NightPass,
    terms: Terms,
    plan: TrackPlan,
    started_utc_s: float,
    site: Site,
    mount: MountProfile,
    limits: SafetyLimits,
) -> RunFacts:
    """Return the facts of a pass' run, by the terms of its schedule, in standard air."""
    air = Refraction.standard(site.height_m)
    facts = RunFacts(
        elements=one.elements if isinstance(one.elements, Elements) else None,
        followed=one.followed if isinstance(one, NightPass) else None,
        site=SiteSettings(site.latitude_deg, site.longitude_deg, site.height_m),
        refraction="auto",
        pressure_hpa=air.pressure_hpa,
        temperature_c=air.temperature_c,
        plan=plan,
        culminate_utc_s=one.culminate_utc_s,
        max_alt_deg=one.max_alt_deg,
        profile=mount,
        limits=limits,
        bias_along_s=terms.bias_along_s,
        bias_cross_deg=terms.bias_cross_deg,
        mount_name=SIMULATED,
        started_utc_s=started_utc_s,
    )
    return with_detours(facts if isinstance(one, NightPass) else with_followed(facts, one.elements))
