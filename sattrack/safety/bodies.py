"""Where the Sun and the Moon stand over a site: hour angle and declination of date, to a minute of arc.

The Sun by ERFA's epv00 without aberration (20″), the Moon by moon98 with its parallax; both are looked up
once in LOOK_S and carried round by sidereal time meanwhile (IAU 2006 precession, IAU 2000A nutation).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import erfa

from sattrack.mount.model import mean_sidereal_deg
from tle.instants import Utc
from tle.sun import moon_km, sun_km, terrestrial_time

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy as np
    from numpy.typing import NDArray

LOOK_S = 30.0
"""In that time the Sun comes 1.2″ of right ascension, the Moon 16″."""
EARTH_RADIUS_KM = 6378.1


class BodyDirection(NamedTuple):
    """One of them at one instant: hour angle and declination, degrees, and the unit vector of `Box`."""

    hour_angle_deg: float
    dec_deg: float
    x: float
    y: float
    z: float


class Wanderer:
    """The Sun or the Moon over one site; ask it for instants in any order."""

    def __init__(
        self, place_km: Callable[[Utc], NDArray[np.float64]], latitude_deg: float, longitude_deg: float
    ) -> None:
        self._place_km = place_km
        self._latitude_deg, self._longitude_deg = latitude_deg, longitude_deg
        self._looked_at: float | None = None
        self._ra_deg = self._dec_deg = 0.0

    def at(self, utc_s: float) -> BodyDirection:
        """Return where it stands at an instant of UTC (POSIX seconds)."""
        look = math.floor(utc_s / LOOK_S)
        if look != self._looked_at:
            self._look((look + 0.5) * LOOK_S)
            self._looked_at = look
        hour_angle_deg = mean_sidereal_deg(utc_s, self._longitude_deg) - self._ra_deg
        h, d = math.radians(hour_angle_deg), math.radians(self._dec_deg)
        cos_dec = math.cos(d)
        return BodyDirection(
            hour_angle_deg, self._dec_deg, cos_dec * math.cos(h), cos_dec * math.sin(h), math.sin(d)
        )

    def _look(self, utc_s: float) -> None:
        at = Utc(utc_s)
        first, second = terrestrial_time(at)
        x, y, z = (float(c) for c in erfa.pnm06a(first[0], second[0]) @ self._place_km(at))
        # As seen from the site: a minute of arc for a ball of an Earth, a degree without this for the Moon.
        sidereal = math.radians(mean_sidereal_deg(utc_s, self._longitude_deg))
        latitude = math.radians(self._latitude_deg)
        x -= EARTH_RADIUS_KM * math.cos(latitude) * math.cos(sidereal)
        y -= EARTH_RADIUS_KM * math.cos(latitude) * math.sin(sidereal)
        z -= EARTH_RADIUS_KM * math.sin(latitude)
        self._ra_deg = math.degrees(math.atan2(y, x))
        self._dec_deg = math.degrees(math.atan2(z, math.hypot(x, y)))


def sun_over(latitude_deg: float, longitude_deg: float) -> Wanderer:
    """Return the Sun over a site, degrees north and east."""
    return Wanderer(sun_km, latitude_deg, longitude_deg)


def moon_over(latitude_deg: float, longitude_deg: float) -> Wanderer:
    """Return the Moon over a site, degrees north and east."""
    return Wanderer(moon_km, latitude_deg, longitude_deg)
