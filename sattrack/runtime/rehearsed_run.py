"""One rehearsed run: the very engine and a simulated mount without faults or noise, and what they did.

Directions are looked up in a table. While nothing depends on the next status, because the mount is well on
its target or far behind it, every second one is left out, as the link might lose it: most of a turn's work is
in saying and hearing them.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import msgspec

from sattrack.control.engine import Engine, safety_of
from sattrack.control.tracker import ACQUIRED_AFTER_SAMPLES, FOLLOWING, Phase
from sattrack.core.collector import without_collector
from sattrack.mount.model import SIDEREAL_RATE_DEG_S
from sattrack.mount.simulator.mount import SimulatedMount, SimulatedSite, StartPosition
from sattrack.mount.simulator.settings import SimulatorProfile, simulator_profile
from sattrack.planning.table import TabledPropagator
from sattrack.planning.trace import Performance, Trace
from sattrack.recording.recorder import NoRecording
from sattrack.runtime import practice
from sattrack.runtime.facts import build_engine
from sattrack.runtime.virtual import VirtualRun

if TYPE_CHECKING:
    from sattrack.mount.model import MountProfile
    from sattrack.planning.sides import Rule
    from sattrack.runtime.facts import RunFacts

MARGIN_S = 10.0
FULL_PERIOD_S, SLOW_PERIOD_S = 0.05, 0.1
WELL_WITHIN, FAR_BEYOND = 0.3, 5.0
"""Off the target by less than such a share of what counts as on it, or more, it is clear which it is."""


@dataclass(slots=True)
class RehearsedRun(VirtualRun):
    """A virtual run that notes each status' row."""

    trace: Trace = field(default_factory=Trace)
    thinned: bool = False
    """Whether statuses are left out while nothing depends on them."""
    _said: bool = True
    """Whether the mount's last turn was told of."""

    def _mount_turn(self, now_utc_s: float, _: None) -> None:
        self._said = not (self.thinned and self._said and self._is_clear())
        if self._said:
            VirtualRun._mount_turn(self, now_utc_s, _)
            return
        self.mount.tick_unsaid(now_utc_s)
        self._at(self._installation.next_turn_s(now_utc_s), self._mount_turn, None)

    def _is_clear(self) -> bool:
        """Tell whether the mount is well on its target or far behind it, and no limit holds it."""
        tracker, safety = self.engine.tracker, self.engine.safety
        if tracker.phase not in FOLLOWING or safety.holding is not None or tracker.error is None:
            return False
        share = tracker.error.total_arcsec / tracker.plan.on_target_arcsec
        if tracker.phase is Phase.TRACKING:
            return share < WELL_WITHIN
        return safety.clamping and share > FAR_BEYOND

    def _status_arrives(self, now_utc_s: float, what: Any) -> None:
        status, truth = what
        engine = self.engine
        engine.receive(status, now_utc_s)
        tracker = engine.tracker
        error = tracker.error
        if error is None:
            return
        trace = self.trace
        trace.utc_s.append(error.utc_s)
        trace.total_arcsec.append(error.total_arcsec)
        trace.along_arcsec.append(error.along_arcsec)
        trace.across_arcsec.append(error.across_arcsec)
        trace.moving.append(tracker.phase in FOLLOWING)
        trace.acquired.append(tracker.acquired_utc_s is not None)
        trace.clamping.append(engine.safety.clamping)
        trace.holding.append(engine.safety.holding)
        trace.hour_angle_axis_deg.append(truth.hour_angle_axis_deg)
        trace.dec_axis_deg.append(truth.dec_axis_deg)
        trace.hour_angle_rate_deg_s.append(SIDEREAL_RATE_DEG_S - truth.ra_rate_deg_s)
        trace.dec_rate_deg_s.append(-truth.dec_rate_deg_s if truth.beyond_pole else truth.dec_rate_deg_s)


def rule_of(profile: MountProfile, hardware: SimulatorProfile) -> Rule:
    """Return the rule of the pier's sides: the profile's, or that of its simulated mount."""
    return "hour_angle" if "hour_angle" in {profile.pier_rule, hardware.flip} else "never"


def ideal_hardware(table: dict[str, Any]) -> SimulatorProfile:
    """Return the simulated mount of a rehearsal: the profile's ways, without what is random or of the servo.

    Kept are the rule of the pier's sides, the hard stops, refraction and the slews' jerk; friction, ripple,
    noise, drift, jitter and faults are left out. Raises BadInputError.
    """
    said = simulator_profile(table)
    return SimulatorProfile(
        flip=said.flip,
        hard_margin_deg=said.hard_margin_deg,
        does_refraction=said.does_refraction,
        slew_jerk_deg_s3=said.slew_jerk_deg_s3,
    )


def perform(
    facts: RunFacts, table: dict[str, Any], period_s: float, start: StartPosition = practice.START
) -> Performance:
    """Run a pass with its plan, profile and limits; `table` is the profile's `[simulator]`.

    The loop runs every `period_s` on both sides, from where the axes stand at `start`. Raises BadInputError,
    PropagationError.
    """
    real = facts.profile
    # Nothing is lost on the way, so nothing would be sent twice.
    profile = msgspec.structs.replace(real, period_s=period_s, repeat_rates="never")
    facts = msgspec.structs.replace(facts, profile=profile, recording=None)
    spec = build_engine(facts).spec
    plan = facts.plan
    begin, end = facts.started_utc_s - MARGIN_S, plan.end_utc_s + MARGIN_S
    tabled = TabledPropagator(spec.propagator, spec.bias, begin, end)
    if_refracts = tabled
    if spec.if_mount_refracts is not spec.propagator:
        if_refracts = TabledPropagator(spec.if_mount_refracts, spec.bias, begin, end)
    # Nobody asks for the true errors: the axes themselves are noted.
    spec = replace(spec, propagator=tabled, if_mount_refracts=if_refracts, simulated=False)
    site = SimulatedSite(facts.site.latitude_deg, facts.site.longitude_deg, facts.site.height_m)
    hardware = ideal_hardware(table)
    hardware = msgspec.structs.replace(hardware, flip=rule_of(profile, hardware))
    mount = SimulatedMount(profile, site, start, hardware)
    engine = Engine(spec)
    # How soon rates are held before a limit depends on the steps of the real loop.
    engine.safety = safety_of(replace(spec, profile=real))
    run = RehearsedRun(engine, mount, facts.started_utc_s, NoRecording(), thinned=period_s <= FULL_PERIOD_S)
    with without_collector():
        ended_utc_s = run.run()
    trace = run.trace.arrays()
    tracker = run.engine.tracker
    # Acquisition takes so many samples: with longer steps it was there, unseen, so much sooner.
    sooner_s = ACQUIRED_AFTER_SAMPLES * max(0.0, period_s - FULL_PERIOD_S)
    acquired_utc_s = tracker.acquired_utc_s
    if acquired_utc_s is not None and sooner_s:
        acquired_utc_s -= sooner_s
        trace = replace(trace, acquired=trace.acquired | (trace.utc_s > acquired_utc_s))
    return Performance(
        trace=trace,
        acquired_utc_s=acquired_utc_s,
        followable_utc_s=tracker.followable_utc_s,
        ended_utc_s=ended_utc_s,
        ended_by=tracker.ended_by or "error",
        period_s=period_s,
        message=run.engine.message,
    )
