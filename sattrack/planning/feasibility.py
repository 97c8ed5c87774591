"""Whether a mount can follow a pass, by kinematics: what `passes --feasible` asks for each of many."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from sattrack.planning.kinematics import Ability, why_not
from sattrack.planning.path import axis_path
from tle.bias import NO_BIAS
from tle.propagator import Propagator
from tle.refraction import Refraction

if TYPE_CHECKING:
    from sattrack.mount import MountProfile
    from sattrack.safety.limits import SafetyLimits
    from tle.earth import EarthOrientation
    from tle.elements import Elements
    from tle.site import Site

STEP_S, FINE_STEP_S = 1.0, 0.05
FEWEST, MOST = 60, 20_000
POLAR_DEG = 75.0
"""From this declination on the hour angle may turn fast, and the path is looked at in fine steps."""
ON_TARGET_DEG = 2.0 / 3600.0


def ability_at(site: Site, profile: MountProfile, limits: SafetyLimits) -> Ability:
    """Return what passes at a site are judged by."""
    return Ability(profile, limits, site.latitude_deg, ON_TARGET_DEG, profile.through_pole)


def why_not_feasible(
    elements: Elements,
    site: Site,
    span: tuple[float, float],
    ability: Ability,
    earth: EarthOrientation | None,
) -> str | None:
    """Return in words why a mount cannot follow a pass, POSIX seconds of UTC; None where it can.

    Where SGP4 fails within the span the reason says so. Raises TimeRangeError.
    """
    begin, end = span
    if not end > begin:
        return "the pass has no duration"
    propagator = Propagator(elements, site, earth=earth, refraction=Refraction.standard(site.height_m))
    path = axis_path(propagator, NO_BIAS, _instants(begin, end, STEP_S))
    dec = path.pointing.dec_axis_deg
    if not np.isfinite(dec).all():
        return "the elements have it come down before the pass ends"
    if float(np.max(np.abs(dec))) > POLAR_DEG:
        path = axis_path(propagator, NO_BIAS, _instants(begin, end, FINE_STEP_S))
    beyond = ability.profile.pier_rule == "hour_angle" and _is_west(path.pointing.hour_angle_axis_deg[0])
    return why_not(path.seen_from(beyond, ability.latitude_deg), ability)


def _instants(begin: float, end: float, step_s: float) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    count = max(FEWEST, math.ceil((end - begin) / step_s) + 1)
    return np.linspace(begin, end, min(count, MOST))


def _is_west(hour_angle_deg: float) -> bool:
    return (float(hour_angle_deg) + 180.0) % 360.0 - 180.0 > 0.0
