"""The antenna's axes against the sky over one site: hour angle and declination, azimuth and elevation.

Hour angles are local apparent sidereal time less right ascension of date, so that a mount steered by reported
right ascension stands where it should, independent of its own clock. Horizontal angles are those of the
ellipsoid's horizon with polar motion, as `tle` has them. Airless: whoever sends positions has thought of air.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from tle.bias import apparent_unit
from tle.earth import EarthOrientation, to_tirs
from tle.instants import Utc

if TYPE_CHECKING:
    from tle.site import Site

AxisKind = Literal["hadec", "azel"]
Triple = tuple[float, float, float]


class HaDec(NamedTuple):
    """Hour angle within half a turn of the meridian, and declination, degrees."""

    ha_deg: float
    dec_deg: float


class AzEl(NamedTuple):
    """Azimuth from north through east, 0 to 360, and elevation, degrees."""

    az_deg: float
    el_deg: float


class RaDec(NamedTuple):
    """Right ascension and declination, degrees."""

    ra_deg: float
    dec_deg: float


class Sky:
    """The sky over one site."""

    def __init__(self, site: Site, earth: EarthOrientation | None = None) -> None:
        self.site = site
        self.earth = earth or EarthOrientation.installed()

    def sidereal_deg(self, utc_s: float) -> float:
        """Return local apparent sidereal time, 0 to 360."""
        return float(self.earth.local_apparent_sidereal_deg(Utc(utc_s), self.site))

    def sidereal_rate_deg_s(self, utc_s: float) -> float:
        """Return its rate."""
        return float(self.earth.sidereal_rate_deg_s(Utc(utc_s)))

    def horizontal(self, place: HaDec, utc_s: float) -> AzEl:
        """Return azimuth and elevation of a direction that stands at an hour angle; polar motion changes."""
        v = self._tirs(place)
        e, n, u = (_dot(axis, v) for axis in self._axes(utc_s))
        return AzEl(math.degrees(math.atan2(e, n)) % 360.0, math.degrees(math.atan2(u, math.hypot(e, n))))

    def equatorial(self, place: AzEl, utc_s: float) -> HaDec:
        """Return hour angle and declination of a horizontal direction; past 90° it is plunged."""
        az, el = math.radians(place.az_deg), math.radians(place.el_deg)
        parts = (math.cos(el) * math.sin(az), math.cos(el) * math.cos(az), math.sin(el))
        axes = self._axes(utc_s)
        x, y, z = (sum(p * axis[i] for p, axis in zip(parts, axes, strict=True)) for i in range(3))
        ha_deg = self.site.longitude_deg - math.degrees(math.atan2(y, x))
        return HaDec(math.remainder(ha_deg, 360.0), math.degrees(math.atan2(z, math.hypot(x, y))))

    def of_date(self, mean: RaDec, utc_s: float) -> RaDec:
        """Return the topocentric apparent place of date of a star at J2000 (ICRS), without proper motion.

        Light bending by the Sun (0.05″ at 5° from it) is left out.
        """
        unit = apparent_unit(mean.ra_deg, mean.dec_deg, Utc(utc_s), "icrf", self.site, self.earth)
        x, y, z = (float(c) for c in unit)
        return RaDec(math.degrees(math.atan2(y, x)) % 360.0, math.degrees(math.atan2(z, math.hypot(x, y))))

    def _tirs(self, place: HaDec) -> Triple:
        longitude = math.radians(self.site.longitude_deg - place.ha_deg)
        dec = math.radians(place.dec_deg)
        return math.cos(dec) * math.cos(longitude), math.cos(dec) * math.sin(longitude), math.sin(dec)

    def _axes(self, utc_s: float) -> tuple[Triple, Triple, Triple]:
        """Return east, north and up in the frame of the Earth's pole of rotation and its own longitudes."""
        _, _, _, _, xp, yp = self.earth.rotation(utc_s)
        east, north, up = (to_tirs(axis, xp, yp) for axis in (self.site.east, self.site.north, self.site.up))
        return _floats(east), _floats(north), _floats(up)


def _floats(v: tuple[Any, Any, Any]) -> Triple:
    return float(v[0]), float(v[1]), float(v[2])


def _dot(a: Triple, b: Triple) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
