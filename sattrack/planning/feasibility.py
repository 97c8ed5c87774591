"""Whether a mount can follow a pass, by kinematics: what `passes --feasible` asks for each of many."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from sattrack.planning.kinematics import Ability, Loss, losses, why_not
from sattrack.planning.path import axis_path
from tle.bias import NO_BIAS
from tle.propagator import Propagator
from tle.refraction import Refraction

if TYPE_CHECKING:
    from sattrack.mount.model import AxisLimits, MountProfile
    from sattrack.planning.path import AxisPath
    from sattrack.safety.limits import SafetyLimits
    from tle.earth import EarthOrientation
    from tle.elements import Elements
    from tle.site import Site

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
    lost: tuple[Loss, ...] = ()


def why_not_feasible(
    elements: Elements,
    site: Site,
    span: tuple[float, float],
    ability: Ability,
    earth: EarthOrientation | None,
) -> str | None:
    """Return in words why a mount cannot follow a pass; None where it can. See `verdict_on`."""
    return verdict_on(elements, site, span, ability, earth).why_not


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
