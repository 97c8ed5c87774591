"""What the age of elements means for pointing: how far along its track an object is likely to be from them.

A typical figure, not a bound. It joins three parts as the root of their squares: what elements miss at their
own epoch, what errors of mean motion add a day, and a share of what drag has done since, as the elements tell
it, because drag changes with the Sun's activity. The three constants describe objects in low orbit that do
not manoeuvre; one that does may be anywhere along its orbit.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from tle.instants import DAY_S

if TYPE_CHECKING:
    from tle.elements import Elements
    from tle.instants import Utc

# About 0.4 km of a low orbit, at the epoch and again for each day of age.
_AT_EPOCH_S = 0.05
_A_DAY_S = 0.05
_SHARE_OF_DRAG = 0.15
_MU_KM3_S2 = 398600.8
_EARTH_RADIUS_KM = 6378.135
# Below this height nothing is in orbit, and angles would grow without bound.
_LOWEST_KM = 100.0


def expected_along_s(elements: Elements, at: Utc) -> float:
    """Return the along-track error to expect at an instant, in seconds; at most half a revolution.

    Before the epoch it is as large as after it.
    """
    days = abs(elements.age_s(at)) / DAY_S
    revolutions_by_drag = abs(elements.mean_motion_dot_rev_day2) * days * days
    by_drag_s = revolutions_by_drag * elements.period_s
    error_s = math.hypot(_AT_EPOCH_S, _A_DAY_S * days, _SHARE_OF_DRAG * by_drag_s)
    return min(error_s, 0.5 * elements.period_s)


def expected_along_arcsec(elements: Elements, at: Utc) -> float:
    """Return what `expected_along_s` is on the sky, in arcsec, at its largest: perigee straight overhead."""
    height_km = max(elements.perigee_km, _LOWEST_KM)
    speed_km_s = math.sqrt(
        _MU_KM3_S2 * (2.0 / (_EARTH_RADIUS_KM + height_km) - 1.0 / elements.semi_major_axis_km)
    )
    return math.degrees(math.atan(expected_along_s(elements, at) * speed_km_s / height_km)) * 3600.0
