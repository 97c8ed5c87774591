"""From a rehearsed run and the target's path to what will be lost, when, to which limit: the report.

The report is plain data with units in its names, as `sattrack rehearse --json` prints it. It also says how
long a mount may hold its last rates, once its link is cut, before it meets a limit.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import msgspec
import numpy as np

from sattrack.control.stages import measuring
from sattrack.mount.model import MountProfile
from sattrack.planning.budget import Budget
from sattrack.planning.kinematics import LEAST_SHARE, Ability, PredictedLoss, Sides, losses
from sattrack.planning.path import JOIN_S, AxisSamples, margins_deg
from tle.instants import Utc

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from sattrack.control.tracker import TrackPlan
    from sattrack.planning.path import AxisPath, Keyhole
    from sattrack.planning.trace import Performance, TraceArrays
    from sattrack.safety.limits import SafetyLimits

    Bools = NDArray[np.bool_]
    Array = NDArray[np.float64]


LOOK_STEP_S, SOON_S, LATER_STEP_S = 0.25, 30.0, 2.0
"""What lies ahead is looked at in short steps at first, and in longer ones later."""
LATER_S, LOOKED_S = 240.0, 900.0
MOMENTS = 400


class MountPath(NamedTuple):
    """How the axes stand and turn at instants, degrees and degrees a second, shape (n,)."""

    pointing: AxisSamples
    hour_angle_rate_deg_s: Array
    dec_rate_deg_s: Array


def mount_path(path: AxisPath, trace: TraceArrays | None) -> MountPath:
    """Return how the mount went in a rehearsed run; as the target goes if there is none or it failed."""
    p = path.pointing
    rows = np.zeros(0, dtype=bool) if trace is None else trace.moving
    if trace is None or not rows.any():
        return MountPath(p, path.hour_angle_rate_deg_s, path.dec_rate_deg_s)
    utc_s = trace.utc_s[rows]
    bodies = (p.sun_hour_angle_deg, p.sun_dec_deg, p.moon_hour_angle_deg, p.moon_dec_deg)
    turned = (np.degrees(np.unwrap(np.radians(column))) for column in bodies)
    there = (np.interp(utc_s, p.utc_s, column) for column in turned)
    pointing = AxisSamples(utc_s, trace.hour_angle_axis_deg[rows], trace.dec_axis_deg[rows], *there)
    return MountPath(pointing, trace.hour_angle_rate_deg_s[rows], trace.dec_rate_deg_s[rows])


@dataclass(frozen=True, slots=True)
class LinkLoss:
    """For moments of a pass, how long after a cut of the link the first limit is met, and which; shape (n,).

    `seconds` is infinite where none is met within `LOOKED_S`. With a watchdog in the mount, `rests_s` is when
    the axes are at rest, and `rests_inside` whether that is before the limit; both None without one.
    """

    utc_s: Array
    seconds: Array
    limits: list[str | None]
    rests_s: Array | None
    rests_inside: NDArray[np.bool_] | None

    @property
    def worst(self) -> int:
        """Index of the moment with the least time."""
        return int(np.argmin(self.seconds))


def link_loss(taken: MountPath, profile: MountProfile, limits: SafetyLimits, latitude_deg: float) -> LinkLoss:
    """Return what a cut at moments spread over a path comes to if both axes hold their rates from then on.

    Rates beyond what the axes can do count as their limits. The path must hold no NaN.
    """
    p = taken.pointing
    count = len(p.utc_s)
    chosen = np.unique(np.linspace(0, count - 1, min(count, MOMENTS)).astype(int))
    most_ha, most_dec = profile.ra.max_rate_deg_s, profile.dec.max_rate_deg_s
    ha_rate = np.clip(taken.hour_angle_rate_deg_s[chosen], -most_ha, most_ha)
    dec_rate = np.clip(taken.dec_rate_deg_s[chosen], -most_dec, most_dec)
    seconds = np.full(len(chosen), np.inf)
    names: list[str | None] = [None] * len(chosen)
    for k, i in enumerate(chosen.tolist()):
        for ahead in STRETCHES_S:
            held = AxisSamples(
                p.utc_s[i] + ahead,
                p.hour_angle_axis_deg[i] + ha_rate[k] * ahead,
                p.dec_axis_deg[i] + dec_rate[k] * ahead,
                p.sun_hour_angle_deg[i] + SUN_RATE_DEG_S * ahead,
                p.sun_dec_deg[i],
                p.moon_hour_angle_deg[i] + SUN_RATE_DEG_S * ahead,
                p.moon_dec_deg[i],
            )
            for name, margin in margins_deg(held, profile, limits, latitude_deg).items():
                at = _first_below_zero(margin, ahead)
                if at < seconds[k]:
                    seconds[k], names[k] = at, name
            if names[k] is not None:
                break
    rests = inside = None
    if profile.watchdog_s is not None:
        ha_braking, dec_braking = profile.braking_deg_s2
        braking = np.maximum(np.abs(ha_rate) / ha_braking, np.abs(dec_rate) / dec_braking)
        braking += max(profile.ra.lag_s, profile.dec.lag_s)
        rests = profile.watchdog_s + profile.period_s + braking
        inside = rests < seconds
    return LinkLoss(p.utc_s[chosen], seconds, names, rests, inside)


SUN_RATE_DEG_S = 360.0 / 86400.0
STRETCHES_S = (
    np.append(np.arange(0.0, SOON_S, LOOK_STEP_S), SOON_S),
    np.arange(SOON_S, LATER_S + LATER_STEP_S, LATER_STEP_S),
    np.arange(LATER_S, LOOKED_S + LATER_STEP_S, LATER_STEP_S),
)
"""Most limits are met in the first two; each begins with the end of the one before."""


def _first_below_zero(margin: Array, ahead_s: Array) -> float:
    """Return the seconds after which a margin, seen at some, falls below 0; infinity if never."""
    below = np.flatnonzero(margin < 0.0)
    if not len(below):
        return float("inf")
    i = int(below[0])
    if i == 0:
        return 0.0
    share = float(margin[i - 1] / (margin[i - 1] - margin[i]))
    return float(ahead_s[i - 1] + share * (ahead_s[i] - ahead_s[i - 1]))


PRESUMED_OFF_S = 0.02
"""Delay that may well be missing in a profile that was not measured."""


def uncalibrated_text(profile: MountProfile, fastest_deg_s: float) -> str:
    """Return what a profile that was not measured costs where the satellite is fastest on the sky."""
    default = profile.name == MountProfile().name
    whose = "the default profile's" if default else f"those of the profile {profile.name!r}, not measured"
    return (
        f"uncalibrated: delays and gains are {whose}; {1000.0 * PRESUMED_OFF_S:g} ms of delay are up to "
        f"{3600.0 * PRESUMED_OFF_S * fastest_deg_s:.0f}″ at this pass's fastest; {measuring(profile)}"
    )


class LostStretch(msgspec.Struct, frozen=True):
    """A stretch of the pass off target: when, to which limit, and what was asked."""

    from_utc: str
    to_utc: str
    seconds: float
    limit: str
    why: str


class Peak(msgspec.Struct, frozen=True):
    """The most that a pass asks of one axis and that it reached on target when rehearsed, and its limits."""

    axis: str
    asked_rate_deg_s: float
    asked_rate_utc: str
    reached_rate_deg_s: float | None
    """From a second after each joining on, catching up left out; null where none was so long."""
    limit_rate_deg_s: float
    asked_acceleration_deg_s2: float
    limit_acceleration_deg_s2: float


class Margin(msgspec.Struct, frozen=True):
    """How near the pass comes to one limit, degrees inside it; negative where it would be passed."""

    limit: str
    least_deg: float
    utc: str


class KeyholeView(msgspec.Struct, frozen=True):
    """One keyhole: how near the pole, and the seconds lost by clipping and by the ways past it."""

    utc: str
    polar_distance_deg: float
    peak_rate_deg_s: float
    clipped_s: float
    round_s: float
    through_pole_s: float | None
    chosen: str


class Cables(msgspec.Struct, frozen=True):
    """Between what angles the hour angle axis stands over the pass as rehearsed, degrees, turns counted."""

    low_deg: float
    high_deg: float
    limit_deg: float
    """The axis may turn so far either way of the meridian."""


class CutMoment(msgspec.Struct, frozen=True):
    """What a cut of the link at one moment leads to; null seconds where no limit is met for long."""

    utc: str
    seconds_to_limit: float | None
    limit: str | None
    seconds_to_rest: float | None
    """With a watchdog in the mount, when it is at rest."""


class LinkLossView(msgspec.Struct, frozen=True):
    """The worst moment for the link to be cut, and all of them."""

    watchdog_s: float | None
    looked_s: float
    worst: CutMoment
    rests_inside: bool | None
    """Whether the mount's watchdog stops it before any limit at all moments; null without one."""
    curve: tuple[CutMoment, ...]


class RehearsalReport(msgspec.Struct, frozen=True):
    """All that a rehearsal tells."""

    name: str
    catalog_number: int | None
    elements_epoch: str | None
    profile: str
    calibrated: bool
    """Whether the profile was measured."""
    start_utc: str
    culminate_utc: str
    end_utc: str
    max_alt_deg: float
    go: bool
    verdict: str
    pass_s: float
    on_target_s: float
    lost_s: float
    lost: tuple[LostStretch, ...]
    rehearsed_until_utc: str
    step_s: float
    ended_by: str
    acquired_after_s: float | None
    peaks: tuple[Peak, Peak]
    margins: tuple[Margin, ...]
    keyholes: tuple[KeyholeView, ...]
    sides: Sides
    cables: Cables
    link_loss: LinkLossView
    budget: Budget
    notes: tuple[str, ...] = ()


SETTLED_S = 1.5
"""A loss at the beginning that is no longer than this is the control's settling; longer, the way there."""
NEAR_S = 3.0
"""How far from a stretch that kinematics predict a lost one of the run may be and have its cause."""
AXIS_LIMITS = ("hour_angle", "declination", "pier")
"""Limits of the axes' places: others are of directions on the sky, the same from either side."""
HELD_SHARE = 0.3
"""Held for so much of a stretch, the mount lost it to that limit; the rest is catching up."""


@dataclass(frozen=True, slots=True)
class Causes:
    """What kinematics say of a path: stretches that are too fast, or past a limit of place."""

    foretold: list[PredictedLoss]
    path: AxisPath
    profile: MountProfile


def lost_stretches(
    performance: Performance, plan: TrackPlan, path: AxisPath, ability: Ability, keyholes: list[Keyhole]
) -> tuple[LostStretch, ...]:
    """Return the stretches of a plan's window in which the run was off target, each with its cause."""
    trace = performance.trace
    inside = (trace.utc_s > plan.start_utc_s) & (trace.utc_s <= plan.end_utc_s)
    utc_s, on = trace.utc_s[inside], trace.on_target(plan.on_target_arcsec)[inside]
    edges = [plan.start_utc_s, *utc_s.tolist(), plan.end_utc_s]
    off = [not x for x in on.tolist()]
    # What is left after the last status was lost where the run ended early.
    off.append(performance.ended_by != "set" and plan.end_utc_s - edges[-2] > performance.period_s)
    spans: list[tuple[float, float]] = []
    for begin, end, lost in zip(edges, edges[1:], off, strict=False):
        if not lost:
            continue
        if spans and begin - spans[-1][1] < JOIN_S:
            spans[-1] = (spans[-1][0], end)
        else:
            spans.append((begin, end))
    causes = Causes(losses(path, ability, keyholes), path, ability.profile)
    return tuple(_named(span, performance, plan, causes) for span in spans)


def _named(
    span: tuple[float, float], performance: Performance, plan: TrackPlan, causes: Causes
) -> LostStretch:
    begin, end = span
    limit, why = _cause(begin, end, performance, plan, causes)
    return LostStretch(_iso(begin), _iso(end), round(end - begin, 3), limit, why)


def _cause(
    begin: float, end: float, performance: Performance, plan: TrackPlan, causes: Causes
) -> tuple[str, str]:
    if performance.ended_by != "set" and end >= plan.end_utc_s:
        limit = performance.ended_by.removeprefix("limit:")
        message = performance.message or f"the run ended: {performance.ended_by}"
        return limit, _words(limit, causes, (begin, end), message)
    held = _held_by(begin, end, performance)
    if held is not None:
        otherwise = (
            f"held at the {held.replace('_', ' ')} limit, which rates and their margins led too near to"
        )
        return held, _words(held, causes, (begin, end), otherwise)
    near = [loss for loss in causes.foretold if _overlap(loss, begin, end) > 0.0]
    if near:
        nearest = max(near, key=lambda loss: _overlap(loss, begin, end))
        return nearest.limit, nearest.words
    if begin <= plan.start_utc_s + performance.period_s:
        return _at_first(performance, plan)
    return _in_mid_pass(begin, end, performance, causes)


def _words(limit: str, causes: Causes, span: tuple[float, float], otherwise: str) -> str:
    near = [loss for loss in causes.foretold if loss.limit == limit and _overlap(loss, *span) > 0.0]
    return max(near, key=lambda loss: _overlap(loss, *span)).words if near else otherwise


def _held_by(begin: float, end: float, performance: Performance) -> str | None:
    """Return the limit at which safety held the mount for most of a stretch; None where that was shorter."""
    trace = performance.trace
    rows = np.flatnonzero((trace.utc_s > begin) & (trace.utc_s <= end))
    counts = Counter(trace.holding[i] for i in rows.tolist())
    if not counts:
        return None
    del counts[None]
    name, count = max(counts.items(), key=lambda item: item[1], default=(None, 0))
    return name if count > HELD_SHARE * len(rows) else None


def _overlap(loss: PredictedLoss, begin: float, end: float) -> float:
    """Return what a predicted loss and a stretch have in common, as a share of what both take together."""
    common = min(loss.end_utc_s + NEAR_S, end) - max(loss.begin_utc_s - NEAR_S, begin)
    return common / (max(loss.end_utc_s, end) - min(loss.begin_utc_s, begin) + NEAR_S)


def _at_first(performance: Performance, plan: TrackPlan) -> tuple[str, str]:
    acquired = performance.acquired_utc_s
    if acquired is None:
        return "approach", "the mount was not on the satellite before it set"
    if acquired - plan.start_utc_s > SETTLED_S:
        return "approach", "the mount's slew takes longer than there is time before"
    return "acquisition", "until the control has settled"


def _in_mid_pass(begin: float, end: float, performance: Performance, causes: Causes) -> tuple[str, str]:
    trace = performance.trace
    rows = (trace.utc_s > begin) & (trace.utc_s <= end)
    if bool(np.any(trace.clamping[rows])):
        return "rate", "the rate that the axes need to catch up is beyond their limit"
    path = causes.path
    part = (path.utc_s >= begin - NEAR_S) & (path.utc_s <= end + NEAR_S)
    profile = causes.profile
    asked_deg_s2 = path.hour_angle_acceleration_deg_s2, path.dec_acceleration_deg_s2
    can_deg_s2 = profile.ra.max_acceleration_deg_s2, profile.dec.max_acceleration_deg_s2
    for axis, asked, can in zip(profile.axis_names(), asked_deg_s2, can_deg_s2, strict=True):
        most = float(np.max(np.abs(asked[part]), initial=0.0))
        if most > can:
            return "acceleration", f"{axis} accelerates by {most:.1f} °/s² of {can:g} °/s²"
    return "control", "the error is beyond what counts as on target"


def peaks(
    path: AxisPath, performance: Performance, profile: MountProfile, within_arcsec: float
) -> tuple[Peak, Peak]:
    """Return the peaks of both axes, hour angle first; those reached are of following, not of catching up."""
    trace = performance.trace
    during = trace.settled(within_arcsec)
    found = [
        _peak(
            name,
            path,
            asked,
            acceleration,
            reached[during],
            (can.max_rate_deg_s, can.max_acceleration_deg_s2),
        )
        for name, asked, acceleration, reached, can in (
            (
                "hour_angle",
                path.hour_angle_rate_deg_s,
                path.hour_angle_acceleration_deg_s2,
                trace.hour_angle_rate_deg_s,
                profile.ra,
            ),
            ("dec", path.dec_rate_deg_s, path.dec_acceleration_deg_s2, trace.dec_rate_deg_s, profile.dec),
        )
    ]
    return found[0], found[1]


def _peak(
    name: str,
    path: AxisPath,
    asked: NDArray[np.float64],
    acceleration: NDArray[np.float64],
    reached: NDArray[np.float64],
    can: tuple[float, float],
) -> Peak:
    at = int(np.argmax(np.abs(asked)))
    return Peak(
        axis=name,
        asked_rate_deg_s=float(abs(asked[at])),
        asked_rate_utc=_iso(float(path.utc_s[at])),
        reached_rate_deg_s=float(np.max(np.abs(reached))) if len(reached) else None,
        limit_rate_deg_s=can[0],
        asked_acceleration_deg_s2=float(np.max(np.abs(acceleration))),
        limit_acceleration_deg_s2=can[1],
    )


def cables(taken: MountPath, profile: MountProfile) -> Cables:
    """Return how far the cables are wound on the way that the mount goes."""
    turned = taken.pointing.hour_angle_axis_deg
    return Cables(float(np.min(turned)), float(np.max(turned)), profile.hour_angle_limit_deg)


def margins(path: AxisPath, taken: MountPath, ability: Ability) -> tuple[Margin, ...]:
    """Return how near a pass comes to each limit of place; bodies below the horizon have none.

    To limits of the sky as the target goes, which may be past them; to limits of the axes as the mount goes.
    """
    found = []
    limits = ability.profile, ability.limits, ability.latitude_deg
    of_target, of_axes = margins_deg(path.pointing, *limits), margins_deg(taken.pointing, *limits)
    for name, by_target in of_target.items():
        margin, utc_s = by_target, path.utc_s
        if name in AXIS_LIMITS:
            margin, utc_s = of_axes[name], taken.pointing.utc_s
        at = int(np.argmin(margin))
        if math.isfinite(margin[at]):
            found.append(Margin(name, float(margin[at]), _iso(float(utc_s[at]))))
    return tuple(found)


def verdict(lost: tuple[LostStretch, ...], lost_s: float, pass_s: float) -> tuple[bool, str]:
    """Return whether the pass is worth beginning, and why, in one line."""
    go = lost_s <= (1.0 - LEAST_SHARE) * pass_s
    by_limit: dict[str, float] = {}
    for stretch in lost:
        by_limit[stretch.limit] = by_limit.get(stretch.limit, 0.0) + stretch.seconds
    parts = ", ".join(f"{s:.1f} s to {name}" for name, s in sorted(by_limit.items(), key=lambda x: -x[1]))
    share = f"{lost_s:.1f} s of {pass_s:.0f} s lost" + (f" ({parts})" if parts else "")
    if go:
        return True, f"go: {share}"
    return False, f"no-go: {share}; less than {LEAST_SHARE:.0%} can be followed"


def keyhole_view(keyhole: Keyhole, followed: bool) -> KeyholeView:
    """Return a keyhole as it is reported; `followed` where the tracker takes the better way."""
    chosen = "clipped"
    if followed and keyhole.detour is not None:
        chosen = "through the pole" if keyhole.detour.through_pole else "round the pole"
    return KeyholeView(
        utc=_iso(keyhole.nearest_utc_s),
        polar_distance_deg=keyhole.polar_distance_deg,
        peak_rate_deg_s=keyhole.peak_rate_deg_s,
        clipped_s=keyhole.clipped_s,
        round_s=keyhole.round_s,
        through_pole_s=keyhole.through_s,
        chosen=chosen,
    )


def link_loss_view(loss: LinkLoss, watchdog_s: float | None) -> LinkLossView:
    """Return the curve of a cut link as it is reported."""
    moments = tuple(
        CutMoment(
            utc=_iso(float(utc_s)),
            seconds_to_limit=None if math.isinf(seconds) else round(float(seconds), 2),
            limit=limit,
            seconds_to_rest=None if loss.rests_s is None else round(float(loss.rests_s[i]), 2),
        )
        for i, (utc_s, seconds, limit) in enumerate(zip(loss.utc_s, loss.seconds, loss.limits, strict=True))
    )
    inside = None if loss.rests_inside is None else bool(np.all(loss.rests_inside))
    return LinkLossView(watchdog_s, LOOKED_S, moments[loss.worst], inside, moments)


def _iso(utc_s: float) -> str:
    return Utc(utc_s).isoformat("milliseconds")
