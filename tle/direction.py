"""A direction and what follows from it: coordinates, rates, range, sunlight; each computed on first use.

Written out although skyfield and astropy turn frames too: rates here are the derivatives of the coordinates,
with light time, aberration, biases and refraction in them, which neither has, and take a fraction of the time
(`bench/ephemeris.py`).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from tle.earth import to_tirs, turned
from tle.instants import Functions, functions_for
from tle.sun import is_sunlit, sun_km

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tle.earth import EarthOrientation, Rotation, Triple
    from tle.instants import Quantity, Utc
    from tle.site import Site, Vector


_SMALL = 1e-4
_DEG = 180.0 / math.pi
# Far below the rounding of any real direction, it keeps the division at an exact pole or zenith defined.
_TINY = 1e-40

# What is known before any angle is taken, in TEME of date, km and km/s: a vector of any length to where the
# satellite is seen and its derivative, the range and its derivative, the geocentric satellite, SGP4's error
# number, and for an astrometric place the direction and its derivative in the ICRF.
Sight = tuple[
    "Triple", "Triple", "Quantity", "Quantity", "Triple", "Quantity", "tuple[Triple, Triple] | None"
]


class SkyTurn(NamedTuple):
    """How far a direction is turned, and how fast that grows: degrees, degrees a second.

    First along a great circle, `east` towards growing right ascension and `north` towards the pole, both
    measured on the sky; then by `pole`, about the pole, which adds to the right ascension itself.
    """

    east_deg: float = 0.0
    north_deg: float = 0.0
    pole_deg: float = 0.0
    east_deg_s: float = 0.0
    north_deg_s: float = 0.0
    pole_deg_s: float = 0.0


def turned_on_sky(q: Vector, q_rate: Vector, turn: SkyTurn) -> tuple[Vector, Vector]:
    """Return a vector turned by `turn`, and its derivative; its length is kept.

    By Rodrigues' formula, its derivative taken term by term. A direction that is turned beyond a pole comes
    down on the other side.
    """
    (x, y, z), (dx, dy, dz) = q, q_rate
    xy2 = x * x + y * y + _TINY
    xy = math.sqrt(xy2)
    length = math.sqrt(xy2 + z * z)
    # East and north as vectors of the direction's own length, and how they turn with it.
    k = length / xy
    k_rate = (x * dx + y * dy + z * dz) / (length * xy) - k * (x * dx + y * dy) / xy2
    ex, ey = -y * k, x * k
    dex, dey = -dy * k - y * k_rate, dx * k + x * k_rate
    xy_rate = (x * dx + y * dy) / xy
    z_xy, z_xy_rate = z / xy, (dz - z * xy_rate / xy) / xy
    nx, ny, nz = -x * z_xy, -y * z_xy, xy
    dnx, dny, dnz = -dx * z_xy - x * z_xy_rate, -dy * z_xy - y * z_xy_rate, xy_rate

    east, north = math.radians(turn.east_deg), math.radians(turn.north_deg)
    east_rate, north_rate = math.radians(turn.east_deg_s), math.radians(turn.north_deg_s)
    rho2 = east * east + north * north
    rho = math.sqrt(rho2)
    c = math.cos(rho)
    s = math.sin(rho) / rho if rho > _SMALL else 1.0 - rho2 / 6.0
    half = east * east_rate + north * north_rate
    c_rate = -s * half
    s_rate = half * ((c - s) / rho2 if rho > _SMALL else -1.0 / 3.0)
    a, b = east * s, north * s
    a_rate, b_rate = east_rate * s + east * s_rate, north_rate * s + north * s_rate

    px, py, pz = x * c + ex * a + nx * b, y * c + ey * a + ny * b, z * c + nz * b
    dpx = dx * c + x * c_rate + dex * a + ex * a_rate + dnx * b + nx * b_rate
    dpy = dy * c + y * c_rate + dey * a + ey * a_rate + dny * b + ny * b_rate
    dpz = dz * c + z * c_rate + dnz * b + nz * b_rate
    return _about_pole((px, py, pz), (dpx, dpy, dpz), turn)


def _about_pole(q: Vector, q_rate: Vector, turn: SkyTurn) -> tuple[Vector, Vector]:
    if not (turn.pole_deg or turn.pole_deg_s):
        return q, q_rate
    angle, spin = math.radians(turn.pole_deg), math.radians(turn.pole_deg_s)
    c, s = math.cos(angle), math.sin(angle)
    (x, y, z), (dx, dy, dz) = q, q_rate
    x, y, dx, dy = x * c - y * s, x * s + y * c, dx * c - dy * s, dx * s + dy * c
    return (x, y, z), (dx - spin * y, dy + spin * x, dz)


class Direction:
    """Where a satellite is seen from a site: floats for one instant, arrays of shape (n,) for n instants.

    Degrees, degrees a second, km and km/s; every rate is the derivative of the quantity it is named after,
    and `ra_rate_deg_s` is dRA/dt itself, not times cos Dec. RA and Dec are topocentric, of the true equator
    and equinox of date (ICRF for an astrometric place). `range_km` is the way of the light,
    `range_rate_km_s` its derivative; both are geometric for the geometric place. `error` is SGP4's number, 0
    where all is well; elsewhere in an array all quantities are NaN.
    """

    __slots__ = (
        "_equatorial",
        "_horizontal",
        "_icrf",
        "_observer",
        "_q",
        "_q_rate",
        "_satellite",
        "_turn",
        "error",
        "range_km",
        "range_rate_km_s",
        "utc",
    )

    def __init__(
        self, utc: Utc, sight: Sight, turn: Rotation, observer: tuple[EarthOrientation, Site]
    ) -> None:
        """Keep what the angles will be made of; made by Propagator.at."""
        self.utc = utc
        (
            self._q,
            self._q_rate,
            self.range_km,
            self.range_rate_km_s,
            self._satellite,
            self.error,
            self._icrf,
        ) = sight
        self._turn = turn
        self._observer = observer
        self._equatorial: tuple[Quantity, Quantity, Quantity, Quantity] | None = None
        self._horizontal: tuple[Quantity, Quantity, Quantity, Quantity] | None = None

    @property
    def ra_deg(self) -> Quantity:
        """Right ascension, from 0 up to 360."""
        return (self._equatorial or self._make_equatorial())[0]

    @property
    def dec_deg(self) -> Quantity:
        """Declination."""
        return (self._equatorial or self._make_equatorial())[1]

    @property
    def ra_rate_deg_s(self) -> Quantity:
        """Derivative of right ascension, without cos Dec."""
        return (self._equatorial or self._make_equatorial())[2]

    @property
    def dec_rate_deg_s(self) -> Quantity:
        """Derivative of declination."""
        return (self._equatorial or self._make_equatorial())[3]

    @property
    def alt_deg(self) -> Quantity:
        """Altitude above the horizon of the ellipsoid."""
        return (self._horizontal or self._make_horizontal())[0]

    @property
    def az_deg(self) -> Quantity:
        """Azimuth from north through east, from 0 up to 360."""
        return (self._horizontal or self._make_horizontal())[1]

    @property
    def alt_rate_deg_s(self) -> Quantity:
        """Derivative of altitude."""
        return (self._horizontal or self._make_horizontal())[2]

    @property
    def az_rate_deg_s(self) -> Quantity:
        """Derivative of azimuth, without cos Alt."""
        return (self._horizontal or self._make_horizontal())[3]

    @property
    def ha_deg(self) -> Quantity:
        """Local apparent sidereal time minus right ascension of date, above -180 up to 180."""
        fn = functions_for(self.range_km)
        ra = fn.atan2(self._q[1], self._q[0])
        turn = (self._turn[0] - ra) * _DEG + self._observer[1].longitude_deg
        return 180.0 - (180.0 - turn) % 360.0

    @property
    def ha_rate_deg_s(self) -> Quantity:
        """Derivative of hour angle."""
        (x, y, _), (dx, dy, _) = self._q, self._q_rate
        return (self._turn[1] - (x * dy - y * dx) / (x * x + y * y + _TINY)) * _DEG

    @property
    def unit(self) -> NDArray[np.float64]:
        """Unit vector in the frame of `ra_deg`, shape (3,) or (n, 3)."""
        q, _ = self._in_frame()
        return stacked(unit_of(q, q, functions_for(q[0]))[0])

    @property
    def unit_rate(self) -> NDArray[np.float64]:
        """Derivative of `unit`, 1/s."""
        q, q_rate = self._in_frame()
        return stacked(unit_of(q, q_rate, functions_for(q[0]))[1])

    @property
    def sunlit(self) -> Quantity:
        """Whether the Sun's centre is above the Earth's limb for the satellite; bool or array of bool."""
        to_date = self._observer[0].celestial_matrix(self.utc)
        sun = np.einsum("...ij,...j->...i", to_date, sun_km(self.utc))
        lit = is_sunlit(stacked(turned(self._satellite, self._turn[2])), sun)
        return lit if self.utc.is_array else bool(lit)

    def to_astropy(self) -> Any:
        """Return the direction as an astropy SkyCoord. Raises PackageError without astropy.

        Frame TETE (true equator and equinox of date) of the instant and the site, with the range; it becomes
        altitude and azimuth by `.transform_to(AltAz(obstime=..., location=...))`. An astrometric place is a
        SkyCoord of frame ICRS without range, because astropy counts that from the barycentre. What astropy
        makes of TEME over ITRS is a geometric place, without light time and aberration.
        """
        time = self.utc.to_astropy()
        from astropy import units
        from astropy.coordinates import TETE, SkyCoord

        ra, dec = self.ra_deg * units.deg, self.dec_deg * units.deg
        if self._icrf is not None:
            return SkyCoord(ra, dec, frame="icrs", obstime=time)
        frame = TETE(obstime=time, location=self._observer[1].to_astropy())
        return SkyCoord(ra, dec, self.range_km * units.km, frame=frame)

    def __repr__(self) -> str:
        """Show when, where on the sky, and how far; of an array when and how many."""
        if self.utc.is_array:
            return f"<Direction at {len(self.utc)} instants: {self.utc!r}>"
        return (
            f"<Direction at {self.utc}: RA {self.ra_deg:.5f}°, Dec {self.dec_deg:.5f}°, "
            f"altitude {self.alt_deg:.4f}°, azimuth {self.az_deg:.4f}°, {self.range_km:.3f} km>"
        )

    def turned(self, turn: SkyTurn) -> Direction:
        """Return the same sight of one instant with its direction turned on the sky, all rates with it.

        East and north are those of this direction, of date; not for an astrometric place, nor for arrays.
        """
        q, q_rate = turned_on_sky(self._q, self._q_rate, turn)
        sight: Sight = (q, q_rate, self.range_km, self.range_rate_km_s, self._satellite, self.error, None)
        return Direction(self.utc, sight, self._turn, self._observer)

    def drifting(self, sooner: Direction, later: Direction, apart_s: float) -> Direction:
        """Return the same sight of one instant, moving as well from `sooner` to `later` in `apart_s` seconds.

        For what changes with time beside the satellite and the Earth: the two are sights of the same instant
        with that changed. Not for an astrometric place, nor for arrays.
        """
        x, y, z = (
            rate + (after - before) / apart_s
            for rate, before, after in zip(self._q_rate, sooner._q, later._q, strict=True)
        )
        sight: Sight = (
            self._q,
            (x, y, z),
            self.range_km,
            self.range_rate_km_s,
            self._satellite,
            self.error,
            None,
        )
        return Direction(self.utc, sight, self._turn, self._observer)

    def _make_equatorial(self) -> tuple[Quantity, Quantity, Quantity, Quantity]:
        fn = functions_for(self.range_km)
        if self._icrf is None:
            (x, y, z), (dx, dy, dz) = self._q, self._q_rate
            equinoxes, equinoxes_rate = self._turn[2], self._turn[3]
        else:
            (x, y, z), (dx, dy, dz) = self._icrf
            equinoxes = equinoxes_rate = 0.0
        xy2 = x * x + y * y + _TINY
        xy = fn.sqrt(xy2)
        made = (
            # Twice, because the first leaves 360 itself of an angle that is barely negative.
            (fn.atan2(y, x) + equinoxes) * _DEG % 360.0 % 360.0,
            fn.atan2(z, xy) * _DEG,
            ((x * dy - y * dx) / xy2 + equinoxes_rate) * _DEG,
            (dz * xy2 - z * (x * dx + y * dy)) / (xy * (xy2 + z * z)) * _DEG,
        )
        self._equatorial = made
        return made

    def _make_horizontal(self) -> tuple[Quantity, Quantity, Quantity, Quantity]:
        fn = functions_for(self.range_km)
        site = self._observer[1]
        (e, de), (n, dn), (u, du) = (self._along(axis, fn) for axis in (site.east, site.north, site.up))
        en2 = e * e + n * n + _TINY
        en = fn.sqrt(en2)
        made = (
            fn.atan2(u, en) * _DEG,
            fn.atan2(e, n) * _DEG % 360.0 % 360.0,
            (du * en2 - u * (e * de + n * dn)) / (en * (en2 + u * u)) * _DEG,
            (n * de - e * dn) / en2 * _DEG,
        )
        self._horizontal = made
        return made

    def _along(self, axis: Vector, fn: Functions) -> tuple[Quantity, Quantity]:
        """Return the component of the direction along an axis fixed to the Earth, and its rate."""
        (ax, ay, az), (bx, by, _) = teme_axis(axis, self._turn, fn)
        (x, y, z), (dx, dy, dz) = self._q, self._q_rate
        return x * ax + y * ay + z * az, dx * ax + dy * ay + dz * az + x * bx + y * by

    def _in_frame(self) -> tuple[Triple, Triple]:
        """Return direction and derivative in the frame of `ra_deg`."""
        if self._icrf is not None:
            return self._icrf
        _, _, equinoxes, rate, _, _ = self._turn
        q, q_rate = turned(self._q, equinoxes), turned(self._q_rate, equinoxes)
        return q, (q_rate[0] - rate * q[1], q_rate[1] + rate * q[0], q_rate[2])


def teme_axis(axis: Vector, turn: Rotation, fn: Functions) -> tuple[Triple, Triple]:
    """Return a vector fixed to the Earth (ITRS) in TEME, and its rate a second."""
    theta, spin, _, _, xp, yp = turn
    x, y, z = to_tirs(axis, xp, yp)
    c, s = fn.cos(theta), fn.sin(theta)
    tx, ty = x * c - y * s, x * s + y * c
    return (tx, ty, z), (-spin * ty, spin * tx, 0.0 * z)


def unit_of(q: Triple, q_rate: Triple, fn: Functions) -> tuple[Triple, Triple]:
    """Return the unit vector along q, and the derivative of that."""
    length = fn.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2])
    u = (q[0] / length, q[1] / length, q[2] / length)
    along = (u[0] * q_rate[0] + u[1] * q_rate[1] + u[2] * q_rate[2]) / length
    return u, (
        q_rate[0] / length - u[0] * along,
        q_rate[1] / length - u[1] * along,
        q_rate[2] / length - u[2] * along,
    )


def stacked(q: Triple) -> NDArray[np.float64]:
    """Return the components of a vector as an array, shape (3,) or (n, 3)."""
    if isinstance(q[0], float):
        return np.array(q)
    return np.stack(np.broadcast_arrays(*q), axis=-1)
