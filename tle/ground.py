"""A site on the turning Earth, for searches over many instants: from TEME to east, north and up."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from tle.instants import DAY_S
from tle.site import EARTH_RADIUS_KM, FLATTENING

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tle.earth import EarthOrientation
    from tle.site import Site, Vector

    Array = NDArray[np.float64]

# A revolution in a mean sidereal day.
EVEN_TURN_RAD_S = 7.292115855e-5


class Ground:
    """A site during a span. Earth orientation is linear between its values at 0h UTC, as `earth` has it.

    `place`, `axes` (east, north, up) and `direction` (unit, from the Earth's centre) are in the ITRS,
    `distance_km` is from the Earth's centre and `tilt_rad` bounds the angle of `up` from `direction`.
    """

    def __init__(self, site: Site, earth: EarthOrientation, start_s: float, span_s: float) -> None:
        """Look the Earth's orientation up for each day of the span. Raises TimeRangeError."""
        first, last = math.floor(start_s / DAY_S), math.floor((start_s + span_s) / DAY_S)
        # Both ends of each day, a second before its end: UT1-UTC may leap there.
        edges = [(day * DAY_S, (day + 1) * DAY_S - 1.0) for day in range(first, last + 1)]
        knots = np.array([edge for pair in edges for edge in pair])
        theta, _, _, _, xp, yp = earth.rotation(knots)
        self._knots_s = knots
        self._xp, self._yp = np.broadcast_to(xp, knots.shape), np.broadcast_to(yp, knots.shape)
        turn = theta - _even(knots, knots[0])
        # All are the same but for whole turns and the drift of UT1.
        self._theta = turn[0] + (turn - turn[0] + math.pi) % (2.0 * math.pi) - math.pi
        self._turn = float(self._theta.mean())
        self.place: Vector = site.itrs_km
        self.up: Vector = site.up
        self.distance_km = math.hypot(*site.itrs_km)
        x, y, z = (k / self.distance_km for k in site.itrs_km)
        self.direction: Vector = (x, y, z)
        cosine = sum(a * b for a, b in zip(self.direction, site.up, strict=True))
        # A metre of polar motion and rounding are within the last term.
        self.tilt_rad = math.acos(min(1.0, cosine)) + 1e-5
        # Cosine and sine of the latitude: how the vertical is made of the equator's plane and the pole.
        phi = math.radians(site.latitude_deg)
        self.up_axis = (math.cos(phi), math.sin(phi))
        self._centre = tuple(
            -sum(a * b for a, b in zip(axis, site.itrs_km, strict=True))
            for axis in (site.east, site.north, site.up)
        )
        self.axes = (site.east, site.north, site.up)

    def turn_rad(self, start_s: float, since_s: Array) -> Array:
        """Return the Earth's turn, GMST82, with the middle day's offset: good to a thousandth of a second."""
        return _even(since_s, self._knots_s[0] - start_s) + self._turn

    def stretched(self, place: Array, part: float = 1.0) -> Array:
        """Return a place east, north, up from the Earth's centre, in equatorial radii, shape (3, ...).

        Stretched along the pole so that the ellipsoid of WGS 84 becomes a ball of radius 1. With a `part` of
        0 the site is taken for the Earth's centre, as for differences of places.
        """
        east, north, up = (place[i] - part * self._centre[i] for i in range(3))
        cos, sin = self.up_axis
        more = (north * cos + up * sin) * (1.0 / (1.0 - FLATTENING) - 1.0)
        return np.stack([east, north + more * cos, up + more * sin]) / EARTH_RADIUS_KM

    def east_north_up(self, unix_s: Array, teme_km: tuple[Array, Array, Array]) -> Array:
        """Return places relative to the site, shape (3, ...), of positions in TEME at POSIX seconds."""
        x, y, z = teme_km
        theta = _even(unix_s, self._knots_s[0]) + np.interp(unix_s, self._knots_s, self._theta)
        c, s = np.cos(theta), np.sin(theta)
        x, y = x * c + y * s, y * c - x * s
        xp = np.interp(unix_s, self._knots_s, self._xp)
        yp = np.interp(unix_s, self._knots_s, self._yp)
        sx, sy, sz = self.place
        x, y, z = x + xp * z - sx, y - yp * z - sy, z - xp * x + yp * y - sz
        place = np.empty((3, *x.shape))
        for k, (a, b, c) in enumerate(self.axes):
            np.multiply(x, a, out=place[k])
            place[k] += y * b
            place[k] += z * c
        return place


def _even(instants: Array, zero: float) -> Array:
    """Return an even turn, a revolution in a mean sidereal day, since an instant."""
    return (instants - zero) * EVEN_TURN_RAD_S
