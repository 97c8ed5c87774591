"""From a rehearsed run and the target's path to what will be lost, when, to which limit: the verdict."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sattrack.planning.kinematics import LEAST_SHARE, Ability, Loss, losses
from sattrack.planning.limits import margins_deg
from sattrack.planning.report import Cables, CutMoment, KeyholeView, LinkLossView, LostStretch, Margin, Peak
from tle.instants import Utc

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from sattrack.control.tracker import TrackPlan
    from sattrack.mount.model import MountProfile
    from sattrack.planning.keyhole import Keyhole
    from sattrack.planning.link_loss import HeldWay, LinkLoss
    from sattrack.planning.path import AxisPath
    from sattrack.planning.trace import Performance

    Bools = NDArray[np.bool_]

SETTLED_S = 1.5
"""A loss at the beginning that is no longer than this is the control's settling; longer, the way there."""
NEAR_S = 3.0
"""How far from a stretch that kinematics foretell a lost one of the run may be and have its cause."""
JOIN_S = 1.0
AXIS_LIMITS = ("hour_angle", "declination", "pier")
"""Limits of the axes' places: others are of directions on the sky, whatever side they are seen from."""
HELD_SHARE = 0.3
"""Held for so much of a stretch, the mount lost it to that limit; the rest is catching up."""


@dataclass(frozen=True, slots=True)
class Causes:
    """What kinematics say of a path: stretches that are too fast, or past a limit of place."""

    foretold: list[Loss]
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


def _overlap(loss: Loss, begin: float, end: float) -> float:
    """Return what a foretold loss and a stretch have in common, as a share of what both take together."""
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
    for axis, asked, can in (
        ("hour angle", path.hour_angle_acceleration_deg_s2, causes.profile.ra.max_acceleration_deg_s2),
        ("declination", path.dec_acceleration_deg_s2, causes.profile.dec.max_acceleration_deg_s2),
    ):
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


def cables(way: HeldWay, profile: MountProfile) -> Cables:
    """Return how far the cables are wound on the way that the mount goes."""
    turned = way.pointing.hour_angle_axis_deg
    return Cables(float(np.min(turned)), float(np.max(turned)), profile.hour_angle_limit_deg)


def margins(path: AxisPath, way: HeldWay, ability: Ability) -> tuple[Margin, ...]:
    """Return how near a pass comes to each limit of place; bodies below the horizon have none.

    To limits of the sky as the target goes, which may be past them; to limits of the axes as the mount goes.
    """
    found = []
    limits = ability.profile, ability.limits, ability.latitude_deg
    of_target, of_axes = margins_deg(path.pointing, *limits), margins_deg(way.pointing, *limits)
    for name, by_target in of_target.items():
        margin, utc_s = by_target, path.utc_s
        if name in AXIS_LIMITS:
            margin, utc_s = of_axes[name], way.pointing.utc_s
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


def link_loss_view(loss: LinkLoss, watchdog_s: float | None, looked_s: float) -> LinkLossView:
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
    return LinkLossView(watchdog_s, looked_s, moments[loss.worst], inside, moments)


def _iso(utc_s: float) -> str:
    return Utc(utc_s).isoformat("milliseconds")
