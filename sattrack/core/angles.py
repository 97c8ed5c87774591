"""Angles in degrees: wrapped, apart on the sky, above the horizon."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing

Angles = TypeVar("Angles", float, "np.typing.NDArray[np.float64]")


def wrap180(angle_deg: Angles) -> Angles:
    """Return an angle, or each of an array, in -180 to 180."""
    return (angle_deg + 180.0) % 360.0 - 180.0


def altitude_deg(hour_angle_deg: float, dec_deg: float, latitude_deg: float) -> float:
    """Return the altitude of a direction given by hour angle and declination, without air."""
    h, d, p = (math.radians(x) for x in (hour_angle_deg, dec_deg, latitude_deg))
    return arcsine_deg(math.sin(p) * math.sin(d) + math.cos(p) * math.cos(d) * math.cos(h))


def azimuth_deg(hour_angle_deg: float, dec_deg: float, latitude_deg: float) -> float:
    """Return the azimuth of a direction from north through east, 0 to below 360."""
    h, d, p = (math.radians(x) for x in (hour_angle_deg, dec_deg, latitude_deg))
    east = -math.cos(d) * math.sin(h)
    north = math.cos(p) * math.sin(d) - math.sin(p) * math.cos(d) * math.cos(h)
    return math.degrees(math.atan2(east, north)) % 360.0


def separation_deg(longitude_1: float, dec_1: float, longitude_2: float, dec_2: float) -> float:
    """Return the great-circle angle between two directions, by hour angle or right ascension."""
    h, d1, d2 = (math.radians(x) for x in (longitude_1 - longitude_2, dec_1, dec_2))
    across = math.hypot(
        math.cos(d2) * math.sin(h),
        math.cos(d1) * math.sin(d2) - math.sin(d1) * math.cos(d2) * math.cos(h),
    )
    return math.degrees(
        math.atan2(across, math.sin(d1) * math.sin(d2) + math.cos(d1) * math.cos(d2) * math.cos(h))
    )


def arcsine_deg(sine: float) -> float:
    """Return an arcsine; what rounding leaves beyond 1 counts as 1."""
    return math.degrees(math.asin(max(-1.0, min(1.0, sine))))
