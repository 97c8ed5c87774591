"""What a pass loses to a mount's limits by kinematics alone, and whether the mount can follow it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from sattrack.control.stages import KEYHOLE, RATE
from sattrack.mount.model import SIDEREAL_RATE_DEG_S
from sattrack.planning.keyhole import find_keyholes
from sattrack.planning.path import axis_path, margins_deg, stretches
from tle.bias import NO_BIAS
from tle.propagator import Propagator
from tle.refraction import Refraction

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from sattrack.mount.model import AxisLimits, MountProfile
    from sattrack.planning.keyhole import Keyhole
    from sattrack.planning.path import AxisPath
    from sattrack.safety.limits import SafetyLimits
    from tle.earth import EarthOrientation
    from tle.elements import Elements
    from tle.site import Site

    Array = NDArray[np.float64]
    Bools = NDArray[np.bool_]


NEAR_DEG = 0.1
"""How near to a limit of place the mount is let."""
FAR_DEG = 360.0
NO_WAY_ROUND = ("sun", "moon", "pier")
"""Behind these a target goes on where the mount cannot follow, and does not come back to it."""
CREEPING_DEG_S = 0.02
"""A target that is slower than this on the sky is not left behind by a mount that goes along an edge."""
LEAST_SHARE = 0.9
"""Share of a pass that must be followed for a "go"."""


@dataclass(frozen=True, slots=True)
class Ability:
    """What is followed with: the mount, the site's limits and latitude, and how near counts as on target."""

    profile: MountProfile
    limits: SafetyLimits
    latitude_deg: float
    tolerance_deg: float
    detours: bool = False
    """Whether what follows takes the best way past the pole, and does not clip."""


@dataclass(frozen=True, slots=True)
class ForetoldLoss:
    """A stretch that is lost: POSIX seconds of UTC, the limit's name, what is asked against what can be.

    Where an axis is too slow, `asked_deg_s` is the most that is asked of it, and `can_deg_s` what it can.
    """

    begin_utc_s: float
    end_utc_s: float
    limit: str
    words: str
    asked_deg_s: float | None = None
    can_deg_s: float | None = None

    @property
    def seconds(self) -> float:
        """How long it is."""
        return self.end_utc_s - self.begin_utc_s


def losses(path: AxisPath, ability: Ability, keyholes: list[Keyhole] | None = None) -> list[ForetoldLoss]:
    """Return what of a path cannot be followed, in order, not overlapping.

    At a limit of place the mount is held until the target comes back. The path must hold no NaN; where its
    keyholes are known already they need not be searched.
    """
    found: list[ForetoldLoss] = []
    every = [*outside(path, ability), *_too_fast(path, ability, keyholes)]
    for loss in sorted(every, key=lambda one: one.begin_utc_s):
        begin = max([loss.begin_utc_s, *(other.end_utc_s for other in found)])
        if begin < loss.end_utc_s:
            found.append(replace(loss, begin_utc_s=begin))
    return found


def outside(path: AxisPath, ability: Ability) -> list[ForetoldLoss]:
    """Return the stretches in which a path is past a limit of place, by limit.

    On the way to a limit the axes are held so much sooner that they would stop inside if nothing were heard
    from this side for the longest fault.
    """
    found = []
    limits = ability.limits
    margins = margins_deg(path.pointing, ability.profile, limits, ability.latitude_deg)
    speed = np.hypot(path.hour_angle_rate_deg_s, path.dec_rate_deg_s) + SIDEREAL_RATE_DEG_S
    for name, margin in margins.items():
        finite = np.where(np.isfinite(margin), margin, FAR_DEG)
        # A body that comes above the horizon comes no nearer by that.
        closing = np.clip(-np.gradient(finite, path.utc_s), 0.0, 1.1 * speed)
        for first, last in stretches(margin < NEAR_DEG + limits.longest_fault_s * closing):
            least = float(np.min(margin[first : last + 1]))
            words = f"goes {-least:.1f}° past the limit" if least < 0.0 else f"comes to {least:.1f}° from it"
            speed_deg_s = float(np.max(path.sky_rate_deg_s[first : last + 1])) - SIDEREAL_RATE_DEG_S
            left_behind = name in NO_WAY_ROUND and speed_deg_s > CREEPING_DEG_S
            end = -1 if left_behind else last
            found.append(ForetoldLoss(float(path.utc_s[first]), float(path.utc_s[end]), name, words))
            if left_behind:
                break
    return found


def _too_fast(path: AxisPath, ability: Ability, keyholes: list[Keyhole] | None) -> list[ForetoldLoss]:
    profile = ability.profile
    if keyholes is None:
        keyholes = find_keyholes(path, profile, ability.tolerance_deg, ways=ability.detours)
    begin_utc_s, end_utc_s = float(path.utc_s[0]), float(path.utc_s[-1])
    found = [
        ForetoldLoss(
            *_lost_span(k, ability.detours),
            KEYHOLE,
            f"{k.polar_distance_deg:.2f}° from the pole the hour angle turns {k.peak_rate_deg_s:.3g} °/s "
            f"of {profile.ra.max_rate_deg_s:.3g} °/s",
            k.peak_rate_deg_s,
            profile.ra.max_rate_deg_s,
        )
        for k in keyholes
        if begin_utc_s <= k.begin_utc_s < end_utc_s
    ]
    cos_dec = np.abs(np.cos(np.radians(path.pointing.dec_axis_deg)))
    axes = (
        ("hour angle", path.pointing.hour_angle_axis_deg, path.hour_angle_rate_deg_s, profile.ra, cos_dec),
        (
            "declination",
            path.pointing.dec_axis_deg,
            path.dec_rate_deg_s,
            profile.dec,
            np.ones_like(cos_dec),
        ),
    )
    for axis, place, rate, can, scale in axes:
        peak = float(np.max(np.abs(rate)))
        if peak <= can.max_rate_deg_s:
            continue
        behind = np.abs(_follow(place, path.utc_s, can.max_rate_deg_s) - place) * scale
        for first, last in stretches(behind > ability.tolerance_deg):
            begin, end = float(path.utc_s[first]), float(path.utc_s[last])
            if any(begin < loss.end_utc_s and end > loss.begin_utc_s for loss in found):
                continue
            most = float(np.max(np.abs(rate[first : last + 1])))
            words = f"{axis} turns {most:.3g} °/s of {can.max_rate_deg_s:.3g} °/s"
            found.append(ForetoldLoss(begin, end, RATE, words, most, can.max_rate_deg_s))
    return sorted(found, key=lambda loss: loss.begin_utc_s)


def _lost_span(keyhole: Keyhole, detours: bool) -> tuple[float, float]:
    """Return from when to when a keyhole is lost, POSIX seconds."""
    if detours and keyhole.detour is not None:
        return keyhole.detour.begin_utc_s, keyhole.detour.end_utc_s
    return keyhole.begin_utc_s, keyhole.begin_utc_s + keyhole.clipped_s


def _follow(place: Array, utc_s: Array, limit_deg_s: float) -> Array:
    """Return where an axis is that follows as fast as it can."""
    at = place.copy()
    most = np.diff(utc_s) * limit_deg_s
    fast = np.flatnonzero(np.abs(np.diff(place)) > most).tolist()
    after = 0
    for first in fast:
        if first < after:
            continue
        # It is there until the place goes too fast, and again once it has caught up.
        here, after = float(place[first]), first
        for there, can in zip(place[first + 1 :].tolist(), most[first:].tolist(), strict=True):
            after += 1
            here += max(-can, min(can, there - here))
            at[after] = here
            if here == there:
                break
    return at


def why_not(lost: Sequence[ForetoldLoss], whole_s: float) -> str | None:
    """Return in words what keeps the mount from following enough of so long a pass; None where it can."""
    lost_s = sum(loss.seconds for loss in lost)
    if lost_s <= (1.0 - LEAST_SHARE) * whole_s:
        return None
    worst = max(lost, key=lambda loss: loss.seconds)
    return f"{worst.limit}: {worst.words}; {lost_s:.0f} s of {whole_s:.0f} s lost"


STEP_S, FINE_STEP_S = 1.0, 0.05
FEWEST, MOST = 60, 20_000
BOUND_SHARE = 0.8
"""Share of the hour angle axis' limits that a bound on what is asked may take before fine steps decide."""
ON_TARGET_DEG = 2.0 / 3600.0


def ability_at(site: Site, profile: MountProfile, limits: SafetyLimits) -> Ability:
    """Return what passes at a site are judged by."""
    return Ability(profile, limits, site.latitude_deg, ON_TARGET_DEG, profile.through_pole)


class Verdict(NamedTuple):
    """Why a mount cannot follow a pass, in words, None where it can; and what it loses of it."""

    why_not: str | None
    lost: tuple[ForetoldLoss, ...] = ()


def verdict_on(
    elements: Elements,
    site: Site,
    span: tuple[float, float],
    ability: Ability,
    earth: EarthOrientation | None,
) -> Verdict:
    """Return the verdict on a pass, POSIX seconds of UTC.

    Where SGP4 fails within the span the reason says so. Raises TimeRangeError.
    """
    begin, end = span
    if not end > begin:
        return Verdict("the pass has no duration")
    propagator = Propagator(elements, site, earth=earth, refraction=Refraction.standard(site.height_m))
    path = axis_path(propagator, NO_BIAS, _instants(begin, end, STEP_S))
    dec = path.pointing.dec_axis_deg
    if not np.isfinite(dec).all():
        return Verdict("the elements have it come down before the pass ends")
    if _may_be_too_fast(path, ability.profile.ra):
        path = axis_path(propagator, NO_BIAS, _instants(begin, end, FINE_STEP_S))
    beyond = ability.profile.pier_rule == "hour_angle" and _is_west(path.pointing.hour_angle_axis_deg[0])
    lost = losses(path.seen_from(beyond, ability.latitude_deg), ability)
    return Verdict(why_not(lost, end - begin), tuple(lost))


def _may_be_too_fast(path: AxisPath, can: AxisLimits) -> bool:
    """Tell whether the hour angle may turn, or its rate change, too fast between the samples of a path.

    A target at a speed s and a distance p from the pole turns it by s / sin p at most, which changes by no
    more than 2 (s / sin p)², and comes nearer by half a step's way between two samples.
    """
    speed = float(np.max(path.sky_rate_deg_s))
    step_s = float(np.max(np.diff(path.utc_s)))
    polar = 90.0 - float(np.max(np.abs(path.pointing.dec_axis_deg))) - 0.5 * step_s * speed
    if polar <= 0.0:
        return True
    rate = speed / math.sin(math.radians(polar))
    change = 2.0 * rate * math.radians(rate)
    return rate > BOUND_SHARE * can.max_rate_deg_s or change > BOUND_SHARE * can.max_acceleration_deg_s2


def _instants(begin: float, end: float, step_s: float) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    count = max(FEWEST, math.ceil((end - begin) / step_s) + 1)
    return np.linspace(begin, end, min(count, MOST))


def _is_west(hour_angle_deg: float) -> bool:
    return (float(hour_angle_deg) + 180.0) % 360.0 - 180.0 > 0.0
