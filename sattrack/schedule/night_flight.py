"""Passes, slews and parking of a schedule in virtual time: one simulated mount that stays where it was."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import msgspec

from sattrack.control.engine import Engine
from sattrack.control.manual.console import Console
from sattrack.control.manual.errand import Errand
from sattrack.control.tracker import TrackPlan
from sattrack.core.collector import without_collector
from sattrack.mount.simulator.mount import SimulatedMount, SimulatedSite, StartPosition
from sattrack.mount.simulator.settings import simulator_profile
from sattrack.planning.table import TabledPropagator
from sattrack.recording.recorder import NoRecording
from sattrack.runtime.facts import SIMULATED, RunFacts, build_engine
from sattrack.runtime.outcome import summarise
from sattrack.runtime.virtual import VirtualRun
from sattrack.schedule.actions import SearchAction
from sattrack.schedule.night import Go
from sattrack.schedule.planned import planned_facts
from sattrack.views.messages import Search, StopNow

if TYPE_CHECKING:
    from collections.abc import Callable

    from sattrack.control.manual.procedures import Outcome, Procedure
    from sattrack.mount.profiles import ProfileFile
    from sattrack.mount.simulator.mount import Truth
    from sattrack.safety import SafetyLimits
    from sattrack.schedule.night import NightPass
    from sattrack.views.messages import Message
    from tle.site import Site

    Watch = Callable[[float, float], str | None]
    """Hears now and then of the instant and the seconds on target; says why the run is to end, if it is."""

LEAD_S = 5.0
LOOK_EVERY_TURNS = 20
MARGIN_S = 60.0
ERRAND_WITHIN_S = 300.0


class SessionDiedError(Exception):
    """The session's process ended without a word."""


class WatchedMount(SimulatedMount):
    """A simulated mount that was on before: its encoders know the cables' turns; and it tells where it is."""

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
class Airspace:
    """The simulated mount at its site between runs, and what each run begins with."""

    site: Site
    profile: ProfileFile
    limits: SafetyLimits
    hour_angle_deg: float
    dec_deg: float

    def fly(self, one: NightPass, now_utc_s: float, faults: str, watch: Watch) -> Go:
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
            with without_collector():
                ended_utc_s = run.run()
        finally:
            self._note(mount)
        summary = summarise(engine, run.ledger, ended_utc_s)
        return Go(
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

    def go(self, procedure: Procedure, now_utc_s: float) -> tuple[Outcome | None, float]:
        """Carry out what is asked of the mount by hand; return how that ended, and when."""
        profile = self.profile.mount
        console = Console(profile, self.limits, self.site, SIMULATED)
        errand = Errand(console, procedure, now_utc_s, ERRAND_WITHIN_S)
        mount = self._mount("")
        period_s, turns = profile.period_s, 0
        with without_collector():
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
        site = SimulatedSite(self.site.latitude_deg, self.site.longitude_deg, self.site.height_m)
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


SEARCH_AFTER_S = 5.0


def search_times(one: NightPass, start_utc_s: float) -> list[tuple[Search, float, float]]:
    """Return the searches about a pass' satellite, from when to when, one after the other."""
    found, at = [], start_utc_s + SEARCH_AFTER_S
    for action in one.terms.before:
        if isinstance(action, SearchAction):
            order = Search(
                action.how, action.spacing_deg, action.speed_deg_s, action.reach_s, action.period_s
            )
            found.append((order, at, at + action.seconds))
            at += action.seconds
    return found


def _tabled_engine(facts: RunFacts) -> Engine:
    """Return an engine whose directions come from a table, which is as good and takes less time."""
    spec = build_engine(facts).spec
    begin, end = facts.started_utc_s - MARGIN_S, facts.plan.end_utc_s + MARGIN_S
    tabled = TabledPropagator(spec.propagator, spec.bias, begin, end)
    return Engine(replace(spec, propagator=tabled, if_mount_refracts=tabled))


def _rounded(arcsec: float | None) -> float | None:
    return None if arcsec is None or not math.isfinite(arcsec) else round(arcsec, 4)
