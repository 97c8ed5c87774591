"""The rehearsal of a pass: the very engine and a simulated mount in virtual time.

Directions are looked up in a table, and the mount has neither faults nor noise; the limits that it meets are
named, and choices compared, by the kinematics of `planning`. While nothing depends on the next status, as the
mount is well on its target or far behind it, every second one is left out, as the link might lose it: most of
a turn's work is in composing and reading them.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import msgspec
import numpy as np

from sattrack.control.approach import slew_time_s
from sattrack.control.engine import Engine, safety_of
from sattrack.control.tracker import ACQUIRED_AFTER_SAMPLES, FOLLOWING, Phase
from sattrack.core import local_time
from sattrack.core.errors import BadInputError, SattrackError
from sattrack.core.process import gc_paused
from sattrack.mount.model import SIDEREAL_RATE_DEG_S, horizon_latitude_deg
from sattrack.mount.simulator.mount import SimulatedMount, StartPosition
from sattrack.mount.simulator.profile import SimulatorProfile, simulator_profile
from sattrack.planning.budget import Circumstances, error_budget
from sattrack.planning.kinematics import (
    Ability,
    Lost,
    Sides,
    choose_sides,
    losses,
    outside,
    sides_of,
    with_flips,
)
from sattrack.planning.path import axis_path, find_keyholes, margins_deg, skyline_deg
from sattrack.planning.rehearsal import (
    LostStretch,
    MountPath,
    RehearsalReport,
    cables,
    keyhole_view,
    link_loss,
    link_loss_view,
    lost_stretches,
    margins,
    mount_path,
    peaks,
    uncalibrated_text,
    verdict,
)
from sattrack.planning.trace import Performance, RehearsalTrace, TabledPropagator
from sattrack.recording.recorder import NoRecording
from sattrack.runtime import demo_pass
from sattrack.runtime.connection import simulated_site
from sattrack.runtime.facts import (
    SEARCH_HOURS,
    build_engine,
    plan_for,
    with_detours,
    with_followed,
)
from sattrack.runtime.flight import VirtualRun
from sattrack.runtime.pass_scene import fastest_deg_s
from sattrack.safety.bounds import CONES
from sattrack.views.formatting import counted, iso_unix_s
from tle.earth import Ground
from tle.instants import Utc
from tle.passes import find_passes
from tle.propagator import Propagator
from tle.sun import SunAndMoon

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from sattrack.control.tracker import TrackPlan
    from sattrack.mount.model import MountProfile, PierRule
    from sattrack.planning.path import AxisPath, Keyhole
    from sattrack.planning.trace import TraceArrays
    from sattrack.runtime.facts import Prepared, RunFacts

    Array = NDArray[np.float64]

MARGIN_S = 10.0
FULL_PERIOD_S, SLOW_PERIOD_S = 0.05, 0.1
WELL_WITHIN, FAR_BEYOND = 0.3, 5.0
"""Off the target by less than such a share of what counts as on it, or more, it is clear which it is."""


SHOWN_EVERY = 100
"""Statuses from one report of the progress to the next."""


@dataclass(slots=True)
class RehearsedRun(VirtualRun):
    """A virtual run that notes each status' row."""

    trace: RehearsalTrace = field(default_factory=RehearsalTrace)
    shown: Callable[[float], None] | None = None
    """Takes the share of the pass that is done, now and then."""
    thinned: bool = False
    """Whether statuses are left out while nothing depends on them."""
    _sent: bool = True
    """Whether the mount's last turn sent a status."""

    def _mount_turn(self, now_utc_s: float, _: None) -> None:
        self._sent = not (self.thinned and self._sent and self._is_clear())
        if self._sent:
            VirtualRun._mount_turn(self, now_utc_s, _)
            return
        self.mount.tick_silently(now_utc_s)
        self._at(self._installation.next_turn_s(now_utc_s), self._mount_turn, None)

    def _is_clear(self) -> bool:
        """Return whether the mount is well on its target or far behind it, and no limit holds it."""
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
        if self.shown is not None and len(trace.utc_s) % SHOWN_EVERY == 0:
            plan = tracker.plan
            share = (now_utc_s - plan.start_utc_s) / (plan.end_utc_s - plan.start_utc_s)
            self.shown(min(1.0, max(0.0, share)))
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


def rule_of(profile: MountProfile, hardware: SimulatorProfile) -> PierRule:
    """Return the rule of the pier's sides: the profile's, or that of its simulated mount."""
    return hardware.flip if profile.pier_rule == "never" else profile.pier_rule


def ideal_hardware(table: dict[str, Any]) -> SimulatorProfile:
    """Return the simulated mount of a rehearsal: the profile's ways, without what is random or of the servo.

    Kept are the rule of the pier's sides, the hard stops, refraction and the slews' jerk; friction, ripple,
    noise, drift, jitter and faults are left out. Raises BadInputError.
    """
    simulated = simulator_profile(table)
    return SimulatorProfile(
        flip=simulated.flip,
        hard_margin_deg=simulated.hard_margin_deg,
        does_refraction=simulated.does_refraction,
        slew_jerk_deg_s3=simulated.slew_jerk_deg_s3,
    )


def perform(
    facts: RunFacts,
    table: dict[str, Any],
    period_s: float,
    start: StartPosition = demo_pass.START,
    shown: Callable[[float], None] | None = None,
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
    site = simulated_site(facts.site)
    hardware = ideal_hardware(table)
    hardware = msgspec.structs.replace(hardware, flip=rule_of(profile, hardware))
    mount = SimulatedMount(profile, site, start, hardware)
    engine = Engine(spec)
    # How soon rates are held before a limit depends on the steps of the real loop.
    engine.safety = safety_of(replace(spec, profile=real))
    thinned = period_s <= FULL_PERIOD_S
    run = RehearsedRun(engine, mount, facts.started_utc_s, NoRecording(), shown=shown, thinned=thinned)
    with gc_paused():
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


SLOW_ERROR_SHARE = 0.1
"""A slow object's loop may leave so much of what counts as on target by holding its rates twice as long."""
SLOW_RATE_SHARE = 0.97
"""A slow object needs no more than this share of the axes' rates."""
LONGEST_RUN_S = 1200.0
"""Of longer passes the beginning is run, and kinematics alone tell the rest."""
LATE_S = 1.5
"""Following that begins so long after its time did not get there in time."""
PATH_STEP_S, MOST_SAMPLES = 0.05, 20_000
READY_S = 5.0
"""How long before its slew a rehearsal begins: the mount's loop and clock are learnt in that time."""


@dataclass(frozen=True, slots=True)
class Rehearsal:
    """A report with what it was made of, for pictures: the path as the mount takes it, and the run."""

    report: RehearsalReport
    path: AxisPath
    performance: Performance
    ability: Ability
    propagator: Propagator

    @property
    def sun_cone_deg(self) -> float:
        """Radius of the cone about the Sun that is kept out of, degrees; 0 for none."""
        return self.ability.limits.sun_deg

    def skyline_deg(self, azimuth_deg: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the least altitude at azimuths, degrees."""
        return skyline_deg(azimuth_deg, self.ability.limits)

    def bodies(self) -> list[tuple[str, str, tuple[float, float]]]:
        """Return name, colour, altitude and azimuth (degrees) of Sun and Moon in the middle of the pass."""
        site, earth = self.propagator.site, self.propagator.earth
        middle_s = 0.5 * float(self.path.utc_s[0] + self.path.utc_s[-1])
        span = (middle_s - 1.0, 2.0)
        places = SunAndMoon(Ground(site, earth, *span), earth, span).east_north_up(np.array(middle_s))
        found = []
        for name, colour, place in zip(("Sun", "Moon"), ("#edae49", "#c9c9d4"), places.T, strict=True):
            east, north, up = place.tolist()
            altitude = math.degrees(math.atan2(up, math.hypot(east, north)))
            found.append((name, colour, (altitude, math.degrees(math.atan2(east, north)) % 360.0)))
        return found


def rehearse(
    prepared: Prepared,
    clock_error_s: float | None = None,
    fov_deg: float | None = None,
    shown: Callable[[float], None] | None = None,
) -> Rehearsal:
    """Run a prepared pass beforehand, moving nothing.

    `clock_error_s` is what is known of the machine's clock, `fov_deg` the field of view;
    `shown` takes the share that is done, now and then. Raises
    BadInputError, SattrackError where the elements end before the pass does, TleError.
    """
    facts = prepared.facts
    plan = facts.plan
    spec = build_engine(facts).spec
    hardware = simulator_profile(prepared.simulator)
    propagator = spec.if_mount_refracts if hardware.does_refraction else spec.propagator
    ability = Ability(
        facts.profile,
        facts.limits,
        horizon_latitude_deg(facts.profile, facts.site.latitude_deg),
        plan.on_target_arcsec / 3600.0,
        detours=bool(plan.detours),
    )
    straight = axis_path(propagator, spec.bias, _instants(plan), facts.profile.frame)
    if not np.isfinite(straight.pointing.dec_axis_deg).all():
        label = spec.propagator.elements.label
        raise SattrackError(f"{label}: its elements have it come down before the pass ends; get newer ones")
    west = (float(straight.pointing.hour_angle_axis_deg[0]) + 180.0) % 360.0 > 180.0
    beyond = west and rule_of(facts.profile, hardware) == "hour_angle"
    period_s = loop_period_s(straight.seen_from(beyond, ability.latitude_deg), ability, plan)
    part = _beginning(facts)
    performance = _performance(part, straight, prepared.simulator, period_s, shown)
    path = _as_taken(straight, performance, ability)
    keyholes = find_keyholes(path, facts.profile, ability.tolerance_deg)
    lost = lost_stretches(performance, part.plan, path.until(part.plan.end_utc_s), ability, keyholes)
    later = _later(path, part.plan.end_utc_s, ability) if part is not facts else ()
    lost_s = performance.lost_s(part.plan) + sum(stretch.seconds for stretch in later)
    pass_s = plan.end_utc_s - plan.start_utc_s
    taken = _taken(path, performance.trace if part is facts else None, ability)
    go, words = verdict((*lost, *later), lost_s, pass_s)
    report = RehearsalReport(
        name=spec.propagator.elements.label,
        catalog_number=spec.propagator.elements.catalog_number or None,
        elements_epoch=None if facts.elements is None else facts.elements.epoch.isoformat("seconds"),
        profile=facts.profile.name,
        calibrated=facts.profile.calibration is not None,
        start_utc=_iso(plan.start_utc_s),
        culminate_utc=_iso(facts.culminate_utc_s),
        end_utc=_iso(plan.end_utc_s),
        max_alt_deg=facts.max_alt_deg,
        go=go,
        verdict=words,
        pass_s=round(pass_s, 3),
        on_target_s=round(pass_s - lost_s, 3),
        lost_s=round(lost_s, 3),
        lost=(*lost, *later),
        rehearsed_until_utc=_iso(min(performance.ended_utc_s, part.plan.end_utc_s)),
        step_s=period_s,
        ended_by=performance.ended_by,
        acquired_after_s=performance.acquired_after_s(plan),
        peaks=peaks(path, performance, facts.profile, plan.on_target_arcsec),
        margins=margins(path, taken, ability),
        keyholes=tuple(keyhole_view(k, followed=bool(plan.detours)) for k in keyholes),
        sides=_sides(
            part, straight, ability, keyholes, _RunLosses(performance, lost, lost_s, prepared.simulator)
        ),
        cables=cables(taken, facts.profile),
        link_loss=link_loss_view(
            link_loss(taken, facts.profile, facts.limits, ability.latitude_deg),
            facts.profile.watchdog_s,
        ),
        budget=error_budget(
            propagator,
            spec.bias,
            (plan.start_utc_s, plan.end_utc_s),
            facts.profile,
            _circumstances(performance, plan, clock_error_s, fov_deg, facts.refraction != "off"),
        ),
        notes=_notes(facts, part, performance),
    )
    return Rehearsal(report, path, performance, ability, propagator)


def _performance(
    facts: RunFacts,
    path: AxisPath,
    table: dict[str, Any],
    period_s: float,
    shown: Callable[[float], None] | None,
) -> Performance:
    """Run a pass from shortly before its beginning, or from as long before as a real run if that was late."""
    sooner = _sooner(facts, path)
    performance = perform(sooner, table, period_s, shown=shown)
    trace, acquired = performance.trace, performance.acquired_utc_s
    late = acquired is None or acquired > facts.plan.start_utc_s + LATE_S
    held = any(name is not None for name, got in zip(trace.holding, trace.acquired, strict=True) if not got)
    if late and not held and sooner.started_utc_s > facts.started_utc_s:
        # A slew that goes round what is in its way takes longer than a straight one.
        performance = perform(facts, table, period_s, shown=shown)
    return performance


class _RunLosses(NamedTuple):
    """A rehearsed run, with what it lost, and what the profile says of the simulated mount."""

    performance: Performance
    lost: tuple[LostStretch, ...]
    lost_s: float
    table: dict[str, Any]


def _sides(
    facts: RunFacts, path: AxisPath, ability: Ability, keyholes: list[Keyhole], run: _RunLosses
) -> Sides:
    """Return what can be done about sides and cables; another way than the mount's own is run as well."""
    worst = max(run.lost, key=lambda stretch: stretch.seconds, default=None)
    known = Lost(run.lost_s, None if worst is None else worst.limit)
    part = path.until(facts.plan.end_utc_s)
    rule = rule_of(facts.profile, simulator_profile(run.table))
    flips_utc = tuple(Utc(float(utc_s)).isoformat("seconds") for utc_s in run.performance.trace.crossings())
    found = with_flips(choose_sides(part, ability, rule, keyholes, known), flips_utc)
    other = found.recommended
    if other is found.by_itself or other.again_utc is None:
        return found
    again = facts
    if other.stop_utc is None:
        begin_utc_s, before_s, start = iso_unix_s(other.again_utc), 0.0, demo_pass.START
    else:
        begin_utc_s = iso_unix_s(other.stop_utc)
        before_s = run.performance.followed_s(facts.plan, until_utc_s=begin_utc_s)
        start = StartPosition(*run.performance.stands_at(begin_utc_s))
    plan = msgspec.structs.replace(facts.plan, start_utc_s=begin_utc_s)
    again = msgspec.structs.replace(facts, plan=plan, started_utc_s=begin_utc_s)
    if other.stop_utc is None:
        again = msgspec.structs.replace(again, started_utc_s=begin_utc_s - plan.approach_s - READY_S)
    second = perform(with_detours(again), run.table, run.performance.period_s, start)
    whole_s = facts.plan.end_utc_s - facts.plan.start_utc_s
    lost_s = run.lost_s - run.performance.lost_s(facts.plan)
    lost_s += whole_s - before_s - second.followed_s(again.plan)
    acquired = second.acquired_utc_s
    shown = msgspec.structs.replace(
        other,
        lost_s=lost_s,
        again_utc=other.again_utc if acquired is None else Utc(acquired).isoformat("seconds"),
    )
    return with_flips(sides_of(rule, found.by_itself, shown), flips_utc)


def choose_nth_pass(prepared: Prepared, number: int, min_alt_deg: float) -> Prepared:
    """Return a prepared run with the N-th pass, the one in progress or next being the first.

    Raises BadInputError for a number below 1, SattrackError where there are not so many in two days.
    """
    if number < 1:
        raise BadInputError(f"--pass {number}: passes count from 1, the one in progress or the next")
    if number == 1:
        return prepared
    facts = prepared.facts
    target = prepared.target or facts.target
    now = Utc(min(prepared.clock.utc_s(time.monotonic()), facts.plan.start_utc_s))
    found = find_passes(Propagator(target, facts.site.place()), now, SEARCH_HOURS, min_alt_deg)
    if number > len(found):
        many, since = counted(len(found), "pass", "passes"), local_time.instant(float(now.unix_s))
        raise SattrackError(
            f"--pass {number}: {target.label} has {many} above {min_alt_deg:g}° within "
            f"{SEARCH_HOURS:g} hours of {since}; give a number up to that"
        )
    chosen = found[number - 1]
    plan = plan_for(chosen, now, target)
    replaced = msgspec.structs.replace(
        facts,
        plan=plan,
        culminate_utc_s=float(chosen.culminate_utc.unix_s),
        max_alt_deg=float(chosen.max_alt_deg),
        started_utc_s=max(float(now.unix_s), plan.start_utc_s - plan.approach_s - READY_S),
    )
    return replace(prepared, facts=with_detours(with_followed(replaced, target)))


def loop_period_s(path: AxisPath, ability: Ability, plan: TrackPlan) -> float:
    """Return the period to run at: 50 ms, or twice that for an object so slow that it makes no difference."""
    profile = ability.profile
    if plan.end_utc_s - plan.start_utc_s > LONGEST_RUN_S:
        return SLOW_PERIOD_S
    if any(loss.limit in CONES for loss in outside(path, ability)):
        # The way along an edge that moves itself depends on the steps.
        return FULL_PERIOD_S
    cos_dec = np.abs(np.cos(np.radians(path.pointing.dec_axis_deg)))
    sky_deg_s2 = np.hypot(path.hour_angle_acceleration_deg_s2 * cos_dec, path.dec_acceleration_deg_s2)
    # A rate held for a time T leaves an error of a T² / 8.
    error_deg = float(np.max(sky_deg_s2)) * SLOW_PERIOD_S**2 / 8.0
    slow = error_deg <= SLOW_ERROR_SHARE * plan.on_target_arcsec / 3600.0
    for rate, can in ((path.hour_angle_rate_deg_s, profile.ra), (path.dec_rate_deg_s, profile.dec)):
        slow &= float(np.max(np.abs(rate))) <= SLOW_RATE_SHARE * can.max_rate_deg_s
    return SLOW_PERIOD_S if slow else FULL_PERIOD_S


def _instants(plan: TrackPlan) -> NDArray[np.float64]:
    """Return the instants of a pass' path, both ends included."""
    duration_s = plan.end_utc_s - plan.start_utc_s
    count = min(MOST_SAMPLES, max(8, math.ceil(duration_s / PATH_STEP_S) + 1))
    return np.linspace(plan.start_utc_s, plan.end_utc_s, count)


def _beginning(facts: RunFacts) -> RunFacts:
    """Return the facts with as much of the pass as is run."""
    plan = facts.plan
    if plan.end_utc_s - plan.start_utc_s <= LONGEST_RUN_S:
        return facts
    shorter = msgspec.structs.replace(plan, end_utc_s=plan.start_utc_s + LONGEST_RUN_S)
    return msgspec.structs.replace(facts, plan=shorter)


def _sooner(facts: RunFacts, path: AxisPath) -> RunFacts:
    """Return the facts with an approach no longer than the slew needs: waiting shows nothing."""
    start = demo_pass.START
    p = path.pointing
    # The hour angle ends within half a turn of the meridian, wherever it begins.
    far_deg = 360.0 if abs(p.dec_axis_deg[0]) > 90.0 else 180.0 + abs(start.hour_angle_deg)
    slew_s = max(
        slew_time_s(far_deg, facts.profile.ra),
        slew_time_s(abs(float(p.dec_axis_deg[0]) - start.dec_deg), facts.profile.dec),
    )
    approach_s = min(facts.plan.approach_s, slew_s + READY_S)
    plan = msgspec.structs.replace(facts.plan, approach_s=approach_s)
    started = max(facts.started_utc_s, plan.start_utc_s - approach_s - READY_S)
    return msgspec.structs.replace(facts, plan=plan, started_utc_s=started)


def _as_taken(path: AxisPath, performance: Performance, ability: Ability) -> AxisPath:
    """Return the path from the side of the pier on which the mount followed it, cables as it had them."""
    trace = performance.trace
    rows = np.flatnonzero(trace.moving)
    if not len(rows):
        return path.wound_anew()
    at = int(rows[0])
    beyond = bool(abs(trace.dec_axis_deg[at]) > 90.0)
    view = path.seen_from(beyond, ability.latitude_deg)
    there = float(np.interp(trace.utc_s[at], view.utc_s, view.pointing.hour_angle_axis_deg))
    turns = round((float(trace.hour_angle_axis_deg[at]) - there) / 360.0)
    return view.wound(360.0 * turns)


def _taken(path: AxisPath, trace: TraceArrays | None, ability: Ability) -> MountPath:
    """Return how the mount went; without the trace of a whole pass, the moments inside all limits.

    A mount is held outside them. All moments, where none are inside.
    """
    taken = mount_path(path, trace)
    if trace is not None:
        return taken
    margins = margins_deg(taken.pointing, ability.profile, ability.limits, ability.latitude_deg)
    inside = np.all([margin >= 0.0 for margin in margins.values()], axis=0)
    if not inside.any():
        return taken
    return MountPath(
        taken.pointing.at(inside), taken.hour_angle_rate_deg_s[inside], taken.dec_rate_deg_s[inside]
    )


def _later(path: AxisPath, from_utc_s: float, ability: Ability) -> tuple[LostStretch, ...]:
    """Return what kinematics say is lost after the part that was run."""
    first = int(np.searchsorted(path.utc_s, from_utc_s))
    if len(path.utc_s) - first < 3:
        return ()
    found = losses(path.part(first, len(path.utc_s)), ability, begun=True)
    return tuple(
        LostStretch(
            _iso(loss.begin_utc_s), _iso(loss.end_utc_s), round(loss.seconds, 3), loss.limit, loss.words
        )
        for loss in found
    )


def _circumstances(
    performance: Performance,
    plan: TrackPlan,
    clock_error_s: float | None,
    fov_deg: float | None,
    refraction_applied: bool,
) -> Circumstances:
    trace = performance.trace
    on = trace.on_target(plan.on_target_arcsec)
    along, across = (
        float(np.sqrt(np.mean(np.square(x[on])))) if on.any() else 0.0
        for x in (trace.along_arcsec, trace.across_arcsec)
    )
    why = "as rehearsed, without friction, ripple or wind" if on.any() else "not rehearsed: never on target"
    return Circumstances(clock_error_s, along, across, why, refraction_applied, fov_deg)


def _notes(facts: RunFacts, part: RunFacts, performance: Performance) -> tuple[str, ...]:
    notes = []
    if part is not facts:
        notes.append(
            f"only the first {LONGEST_RUN_S / 60.0:.0f} minutes were simulated; for the rest, rates and "
            "limits alone show what is lost"
        )
    if performance.period_s != facts.profile.period_s:
        notes.append(f"rehearsed in steps of {performance.period_s:g} s: this pass is slow enough for that")
    if facts.profile.calibration is None:
        notes.append(uncalibrated_text(facts.profile, fastest_deg_s(facts)))
    return tuple(notes)


def _iso(utc_s: float) -> str:
    return Utc(utc_s).isoformat("milliseconds")
