"""From an ephemeris and a site to where an object is seen at an instant, and how fast it moves there."""

from __future__ import annotations

import math
from copy import copy
from typing import TYPE_CHECKING, Literal, Protocol, get_args

import numpy as np

from tle.bias import NO_BIAS, Bias
from tle.direction import Direction, Sight, stacked, teme_axis, unit_of
from tle.earth import EarthOrientation, Rotation, Triple, turned
from tle.elements import Elements, gravity_km_s2
from tle.errors import ElementsError, PlaceError, SiteError
from tle.instants import ARRAYS, FLOATS, Functions, Utc, as_utc
from tle.site import Site
from tle.sun import LIGHT_KM_S, earth_velocity_km_s

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tle.elements import State
    from tle.ephemeris import Ephemeris
    from tle.instants import Instant, Quantity
    from tle.refraction import Refraction

Place = Literal["apparent", "geometric", "astrometric"]
_FOREIGN = "of skyfield's objects tle.skyfield.from_skyfield makes ours"


class Pointing(Protocol):
    """What a mount's pointing errors do to a direction: it must be fed another one."""

    def applied(self, u: Triple, u_rate: Triple, up: Triple, up_rate: Triple) -> tuple[Triple, Triple]:
        """Return the direction to feed and its rate; the third axis of the vectors is the pole."""

    def on_side(self, beyond_pole: bool) -> Pointing:
        """Return the same for a side of the pole."""


class Propagator:
    """Directions of one object from one site; `at` an instant or an array of instants.

    The object is given by elements, which SGP4 propagates, or by another ephemeris.
    Places: "apparent" (light time and diurnal aberration: where a mount must point without air), "geometric"
    (neither), "astrometric" (light time as the Solar System's barycentre has it; RA and Dec in the ICRF, as
    a plate solution gives them; altitude, azimuth and hour angle are those of the apparent place).
    `diurnal_aberration=False` leaves that effect of at most 0.3″ out. With `refraction` all quantities are
    those of the raised direction, and with `pointing` those of the direction that a mount must be fed to look
    there; neither goes with the astrometric place. Earth orientation is that of the
    installed IERS table unless `earth` is given. Not to be shared between threads.

    Raises PlaceError, PropagationError where SGP4 refuses the elements, and EphemerisError for a table that
    cannot be interpolated.
    """

    def __init__(
        self,
        elements: Elements | Ephemeris,
        site: Site,
        bias: Bias = NO_BIAS,
        earth: EarthOrientation | None = None,
        refraction: Refraction | None = None,
        place: Place = "apparent",
        diurnal_aberration: bool = True,
        pointing: Pointing | None = None,
    ) -> None:
        """Start SGP4 and look the Earth's orientation up."""
        if not hasattr(elements, "states"):
            raise ElementsError(f"{elements!r} is no tle.Elements and no ephemeris: {_FOREIGN}")
        if not isinstance(site, Site):
            raise SiteError(f"{site!r} is no tle.Site: {_FOREIGN}")
        if place not in get_args(Place):
            raise PlaceError(f"{place!r} is no kind of place: give one of {', '.join(get_args(Place))}")
        if place == "astrometric" and (refraction is not None or pointing is not None):
            raise PlaceError(
                "an astrometric place knows no air: leave refraction out, or ask for the apparent place"
            )
        self.elements = elements
        self.site = site
        self.bias = bias
        self.earth = earth or EarthOrientation.installed()
        self.refraction = refraction
        self.pointing = pointing
        self.place: Place = place
        self.diurnal_aberration = diurnal_aberration
        self._states = elements.states(self.earth, bent=place == "apparent")
        self._observer = (self.earth, site)
        self._aberrated = diurnal_aberration and place != "geometric"

    def __repr__(self) -> str:
        """Show what is seen from where, and what is taken into account."""
        site, elements = self.site, self.elements
        air = f", {self.refraction!r}" if self.refraction is not None else ""
        bias = f", {self.bias!r}" if self.bias != NO_BIAS else ""
        return (
            f"<Propagator of {elements.label} ({elements.catalog_number}) from {site.latitude_deg:g}, "
            f"{site.longitude_deg:g}, {site.height_m:g} m: {self.place} place{air}{bias}>"
        )

    def with_elements(self, elements: Elements | Ephemeris) -> Propagator:
        """Return the same propagator for another object, without a bias. Raises PropagationError."""
        return Propagator(
            elements,
            self.site,
            NO_BIAS,
            self.earth,
            self.refraction,
            self.place,
            self.diurnal_aberration,
            self.pointing,
        )

    def pointed(self, pointing: Pointing | None) -> Propagator:
        """Return the same propagator for a mount with other pointing errors."""
        made = copy(self)
        made.pointing = pointing
        return made

    def of_date(self, t: Utc, vectors: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return vectors in TEME at one instant, shape (3,) or (3, n), by the true equator and equinox."""
        equinoxes = self.earth.rotation(t.unix_s)[2]
        c, s = math.cos(equinoxes), math.sin(equinoxes)
        return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ vectors

    def with_place(self, place: Place) -> Propagator:
        """Return the same propagator for another kind of place, without refraction and pointing errors."""
        return Propagator(
            self.elements, self.site, self.bias, self.earth, None, place, self.diurnal_aberration
        )

    def at(self, t: Instant, bias: Bias | None = None) -> Direction:
        """Return where the satellite is seen at an instant, or at each of an array of instants.

        An instant is a Utc, an aware datetime, or a Time of astropy or skyfield. A bias given here takes the
        place of the propagator's own.
        Raises TimeRangeError; DecayedError or another PropagationError for one instant at which SGP4 fails,
        or that a table does not cover (in an array, that instant is NaN and its `error` is not 0).
        """
        t = as_utc(t)
        bias = self.bias if bias is None else bias
        unix_s = t.unix_s
        turn = self.earth.rotation(unix_s)
        along_s = bias.along_s if bias.epoch is None else bias.along_at_s(unix_s)
        if isinstance(unix_s, np.ndarray):
            fn, state = ARRAYS, self._states.at_many(unix_s, along_s)
        else:
            fn, state = FLOATS, self._states.at(unix_s, along_s)
        return Direction(t, self._sight(fn, t, turn, state, bias), turn, self._observer)

    def _sight(self, fn: Functions, t: Utc, turn: Rotation, state: State, bias: Bias) -> Sight:
        theta, spin, equinoxes, _, xp, yp = turn
        x, y, z, vx, vy, vz, ax, ay, az, error = state
        if bias.along_rate:
            faster = 1.0 + bias.along_rate
            vx, vy, vz = vx * faster, vy * faster, vz * faster
        # The site in TEME and its velocity: polar motion as in `to_tirs`, then the Earth's turn.
        sx, sy, sz = self.site.itrs_km
        tx, ty, tz = sx - xp * sz, sy + yp * sz, sz + xp * sx - yp * sy
        c, s = fn.cos(theta), fn.sin(theta)
        ox, oy = tx * c - ty * s, tx * s + ty * c
        wx, wy = -spin * oy, spin * ox
        qx, qy, qz = x - ox, y - oy, z - tz
        distance = fn.sqrt(qx * qx + qy * qy + qz * qz)
        if self.place == "geometric":
            dx, dy, dz = vx - wx, vy - wy, vz
            distance_rate = (qx * dx + qy * dy + qz * dz) / distance
        else:
            # Light left the satellite `delay` earlier; the observer is where it is at the instant itself.
            delay = distance / (LIGHT_KM_S + (qx * vx + qy * vy + qz * vz) / distance)
            qx, qy, qz = qx - delay * vx, qy - delay * vy, qz - delay * vz
            vx, vy, vz = vx - delay * ax, vy - delay * ay, vz - delay * az
            distance = delay * LIGHT_KM_S
            receding = (qx * vx + qy * vy + qz * vz) / distance
            delay_rate = (receding - (qx * wx + qy * wy) / distance) / (LIGHT_KM_S + receding)
            slower = 1.0 - delay_rate
            dx, dy, dz = vx * slower - wx, vy * slower - wy, vz * slower
            distance_rate = delay_rate * LIGHT_KM_S
        if bias.cross_deg or bias.cross_rate_deg_s:
            angle = math.pi / 180.0 * bias.cross_at_deg(t.unix_s)
            angle_rate = math.pi / 180.0 * bias.cross_rate_deg_s
            pull = gravity_km_s2(x, y, z) if isinstance(self.elements, Elements) else (ax, ay, az)
            bend = tuple(k * (1.0 + bias.along_rate) ** 2 for k in pull)
            (qx, qy, qz), (dx, dy, dz) = _crossed(
                fn, (qx, qy, qz), (dx, dy, dz), (vx, vy, vz), (bend[0], bend[1], bend[2]), (angle, angle_rate)
            )
        icrf = None
        if self.place == "astrometric":
            icrf = self._icrf(t, (qx, qy, qz), (dx, dy, dz), (delay, delay_rate), equinoxes)
        if self._aberrated:
            qx, qy = qx + delay * wx, qy + delay * wy
            dx, dy = dx + delay_rate * wx, dy + delay_rate * wy
        q, q_rate = (qx, qy, qz), (dx, dy, dz)
        if self.refraction is not None:
            up, up_rate = teme_axis(self.site.up, turn, fn)
            q, q_rate = self.refraction.refract(*unit_of(q, q_rate, fn), up, up_rate)
        if self.pointing is not None:
            up, up_rate = teme_axis(self.site.up, turn, fn)
            q, q_rate = self.pointing.applied(*unit_of(q, q_rate, fn), up, up_rate)
        return q, q_rate, distance, distance_rate, (x, y, z), error, icrf

    def _icrf(
        self, t: Utc, q: Triple, q_rate: Triple, delay: tuple[Quantity, Quantity], equinoxes: Quantity
    ) -> tuple[Triple, Triple]:
        """Return direction and rate in the ICRF, the Earth's own way during the light time taken back."""
        to_date = self.earth.celestial_matrix(t)
        velocity = earth_velocity_km_s(t)
        seen = np.einsum("...ij,...i->...j", to_date, stacked(turned(q, equinoxes)))
        moving = np.einsum("...ij,...i->...j", to_date, stacked(turned(q_rate, equinoxes)))
        seen = seen - np.asarray(delay[0])[..., None] * velocity
        moving = moving - np.asarray(delay[1])[..., None] * velocity
        return _columns(seen), _columns(moving)


def _crossed(
    fn: Functions, q: Triple, q_rate: Triple, v: Triple, a: Triple, turn: tuple[Quantity, Quantity]
) -> tuple[Triple, Triple]:
    """Return direction and rate turned by an angle (rad, rad/s) towards q x v, keeping the length of q."""
    angle, angle_rate = turn
    length2 = _dot(q, q)
    length = fn.sqrt(length2)
    length_rate = _dot(q, q_rate) / length
    normal = _cross(q, v)
    normal_rate = tuple(i + j for i, j in zip(_cross(q_rate, v), _cross(q, a), strict=True))
    size2 = _dot(normal, normal) + 1e-40
    size = fn.sqrt(size2)
    growth = _dot(normal, normal_rate) / size2
    s, c = fn.sin(angle), fn.cos(angle)
    turned, turned_rate = [], []
    for k, k_rate, m, m_rate in zip(q, q_rate, normal, normal_rate, strict=True):
        side = m * (length / size)
        side_rate = m_rate * (length / size) + side * (length_rate / length - growth)
        turned.append(k * c + side * s)
        turned_rate.append((k_rate + side * angle_rate) * c + (side_rate - k * angle_rate) * s)
    return (turned[0], turned[1], turned[2]), (turned_rate[0], turned_rate[1], turned_rate[2])


def _dot(a: Triple, b: Triple) -> Quantity:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _cross(a: Triple, b: Triple) -> Triple:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def _columns(rows: Quantity) -> Triple:
    if rows.ndim == 1:
        return float(rows[0]), float(rows[1]), float(rows[2])
    return rows[:, 0], rows[:, 1], rows[:, 2]
