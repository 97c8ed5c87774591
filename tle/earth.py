"""How the Earth is turned: sidereal angle, equinoxes, pole; offline, from IERS data or from given values.

The sidereal angle of TEME is GMST82 of UT1 (Vallado 2006); the step from TEME to the true equator and equinox
of date is a turn about the pole by GAST06A - GMST82 (IAU 2006/2000A, IERS Conventions 2010, 5.5.7). Both, and
the polar motion, are held as polynomials a day long, made by ERFA on first use: its series of nutation,
evaluated for every direction, would cost more than all the rest.

The IERS table finals2000A.all has one record of fixed width a day since 1973-01-02, so that a day's place in
the file is known and the 3.7 MB need not be parsed. Layout: the IERS's readme.finals2000A.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Literal, Protocol

import erfa
import numpy as np

from tle.errors import EarthOrientationWarning, SourceError, TimeRangeError
from tle.instants import (
    DAY_S,
    MJD_JD,
    TT_MINUS_TAI_S,
    UNIX_EPOCH_MJD,
    Utc,
    as_utc,
    functions_for,
    tai_minus_utc_s,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tle.instants import Instant, Quantity
    from tle.site import Site, Vector

    Array = NDArray[np.float64]

_RECORD = 188
_TAIL_RECORDS = 800
FIRST_MJD = 41684
Status = Literal["observed", "predicted", "extrapolated", "fixed"]

ARCSEC = math.pi / 648000.0
# Two-digit years of element sets end with 2056, and nobody knows the Earth's rotation so far ahead.
_END = Utc.parse("2057-01-01")
_FIXED_START = Utc.parse("1957-01-01")
_NODES_S = np.array([0.0, DAY_S / 3.0, 2.0 * DAY_S / 3.0, DAY_S])
_TO_CUBIC = np.linalg.inv(np.vander(_NODES_S / DAY_S, increasing=True)) / DAY_S ** np.arange(4.0)[:, None]

# θ = GMST82 and its rate, E = GAST06A - GMST82 and its rate, pole x and y: rad and rad/s.
Rotation = tuple["Quantity", "Quantity", "Quantity", "Quantity", "Quantity", "Quantity"]
Triple = tuple["Quantity", "Quantity", "Quantity"]
MOST_DUT1_S, MOST_POLE_ARCSEC = 1.0, 10.0
# A revolution in a mean sidereal day.
EVEN_TURN_RAD_S = 7.292115855e-5


@dataclass(frozen=True, slots=True)
class Orientation:
    """Earth orientation at 0h UTC of one day: UT1-UTC in seconds, pole in arcseconds."""

    mjd: int
    dut1_s: float
    xp_arcsec: float
    yp_arcsec: float


class IersTable:
    """finals2000A.all (Bulletin A): days read on demand, last observed and last predicted day known."""

    def __init__(self, path: str | Path) -> None:
        """Open the table and find its end. Raises SourceError where the file is no such table."""
        self._path = Path(path)
        try:
            self._text = self._path.read_bytes()
        except OSError as error:
            raise SourceError(f"{path}: cannot read Earth orientation: {error.strerror}") from None
        count = len(self._text) // _RECORD
        tail = range(max(0, count - _TAIL_RECORDS), count)
        last = [i for i in tail if self._field(i, 58, 68).strip()]
        observed = [i for i in last if self._field(i, 57, 58) == "I" and self._field(i, 16, 17) == "I"]
        if not observed or self._mjd(0) != FIRST_MJD:
            raise SourceError(
                f"{path}: is no finals2000A.all as the IERS publishes it: install astropy-iers-data"
            )
        self.last_observed_mjd = FIRST_MJD + observed[-1]
        self.last_mjd = FIRST_MJD + last[-1]

    def day(self, mjd: int) -> Orientation:
        """Return the record of a day from FIRST_MJD to `last_mjd`. Raises SourceError where it is damaged."""
        index = mjd - FIRST_MJD
        try:
            if index < 0 or self._mjd(index) != mjd:
                raise ValueError
            return Orientation(
                mjd,
                dut1_s=float(self._field(index, 58, 68)),
                xp_arcsec=float(self._field(index, 18, 27)),
                yp_arcsec=float(self._field(index, 37, 46)),
            )
        except ValueError:
            raise SourceError(
                f"{self._path}: no Earth orientation for MJD {mjd}: install astropy-iers-data again"
            ) from None

    def _field(self, index: int, first: int, last: int) -> str:
        start = index * _RECORD
        return self._text[start + first : start + last].decode("ascii", errors="replace")

    def _mjd(self, index: int) -> int:
        return int(float(self._field(index, 7, 15)))


@lru_cache(maxsize=1)
def installed_table() -> IersTable:
    """Return the table of the installed astropy-iers-data."""
    import astropy_iers_data

    return IersTable(astropy_iers_data.IERS_A_FILE)


@dataclass(frozen=True, slots=True)
class EarthOrientationAge:
    """How good the Earth orientation for an instant is.

    `age_s` counts from the last observed day to the instant, negative where the instant is before it.
    `status` is "observed", "predicted" (by the IERS, errors growing to 0.1″ in a month and 1″ in a year),
    "extrapolated" (last value held: seconds of arc to 15″) or "fixed" (given by the caller).
    """

    age_s: float | None
    status: Status
    observed_until: Utc | None
    predicted_until: Utc | None


class OrientationTable(Protocol):
    """UT1 and polar motion by day, and up to where: None for `last_observed_mjd` where that is not known."""

    @property
    def last_observed_mjd(self) -> int | None: ...  # noqa: D102
    @property
    def last_mjd(self) -> int: ...  # noqa: D102
    def day(self, mjd: int) -> Orientation: ...  # noqa: D102


class EarthOrientation:
    """UT1 and polar motion for any instant, and what follows from them for any site."""

    def __init__(self, table: OrientationTable | None, fixed: Orientation | None = None) -> None:
        """Take a table, or the one orientation of all instants; see `installed` and `fixed`."""
        self._table = table
        self._fixed = fixed
        self._days: dict[int, tuple[float, ...]] = {}
        self._matrices: dict[int, NDArray[np.float64]] = {}
        self._latest: tuple[float, ...] = (math.inf,) * 11
        self._warned = False
        self._start_s = _FIXED_START.unix_s if table is None else (FIRST_MJD - UNIX_EPOCH_MJD) * DAY_S

    @staticmethod
    @lru_cache(maxsize=1)
    def installed() -> EarthOrientation:
        """Return the Earth orientation of the installed astropy-iers-data (IERS Bulletin A)."""
        return EarthOrientation(installed_table())

    @classmethod
    def fixed(cls, dut1_s: float, xp_arcsec: float = 0.0, yp_arcsec: float = 0.0) -> EarthOrientation:
        """Return an orientation with the same UT1-UTC (s) and pole for all instants.

        Raises TimeRangeError for a UT1-UTC of a second or more, or a pole of 10″, which Earth never has.
        """
        if not (abs(dut1_s) < MOST_DUT1_S and math.hypot(xp_arcsec, yp_arcsec) < MOST_POLE_ARCSEC):
            raise TimeRangeError(
                f"UT1-UTC {dut1_s:g} s and pole {xp_arcsec:g}″, {yp_arcsec:g}″ are not Earth's: give seconds "
                "between -1 and 1, and arcseconds"
            )
        return cls(None, Orientation(0, dut1_s, xp_arcsec, yp_arcsec))

    def __repr__(self) -> str:
        """Show where UT1 and polar motion come from."""
        if self._fixed is not None:
            one = self._fixed
            return (
                f"<EarthOrientation, UT1-UTC {one.dut1_s:g} s, pole {one.xp_arcsec:g}″, {one.yp_arcsec:g}″>"
            )
        assert self._table is not None
        until = Utc((self._table.last_mjd - UNIX_EPOCH_MJD) * DAY_S)
        return f"<EarthOrientation by a table until {until.isoformat('seconds')}>"

    def rotation(self, unix_s: Quantity) -> Rotation:
        """Return θ and dθ/dt, E and dE/dt, x_p and y_p for POSIX seconds of UTC, in rad and rad/s.

        θ is GMST82, E is GAST06A - GMST82. Raises TimeRangeError outside 1973-01-02 to 2057 (1957 to 2057
        for a fixed orientation); emits EarthOrientationWarning, once, beyond the end of the table.
        """
        if isinstance(unix_s, np.ndarray):
            day = self._days_of(unix_s)
        else:
            day = self._latest
            if not 0.0 <= unix_s - day[0] < DAY_S:
                day = self._latest = self._day(self._index(unix_s))
        start, theta, theta_rate, e0, e1, e2, e3, x0, x1, y0, y1 = day
        s = unix_s - start
        return (
            theta + theta_rate * s,
            theta_rate,
            e0 + s * (e1 + s * (e2 + s * e3)),
            e1 + s * (2.0 * e2 + s * (3.0 * e3)),
            x0 + x1 * s,
            y0 + y1 * s,
        )

    def celestial_matrix(self, at: Instant) -> NDArray[np.float64]:
        """Return the matrices, shape (3, 3) or (n, 3, 3), from GCRS to true equator and equinox of date.

        Bias, precession and nutation of IAU 2006/2000A (ERFA's pnm06a), without the IERS's celestial pole
        offsets of under a milliarcsecond. Raises TimeRangeError.
        """
        at = as_utc(at)
        if at.is_array:
            self._check(at.unix_s)
            index = np.floor(at.unix_s / DAY_S).astype(np.int64)
            found, inverse = np.unique(index, return_inverse=True)
            table = np.array([self._matrix(int(i)) for i in found]).reshape(-1, 4, 3, 3)
            x = at.unix_s - index * DAY_S
            powers = np.stack([np.ones_like(x), x, x * x, x * x * x], axis=1)
            if len(found) == 1:
                return np.asarray(np.tensordot(powers, table[0], axes=1))
            matrices: NDArray[np.float64] = np.einsum("nk,nkij->nij", powers, table[inverse])
            return matrices
        one = self._index(at.unix_s)
        x = at.unix_s - one * DAY_S
        matrix: NDArray[np.float64] = np.tensordot([1.0, x, x * x, x * x * x], self._matrix(one), axes=1)
        return matrix

    def local_apparent_sidereal_deg(self, at: Instant, site: Site) -> Quantity:
        """Return local apparent sidereal time, GAST06A plus the site's longitude, degrees from 0 to 360."""
        at = as_utc(at)
        theta, _, equinoxes, _, _, _ = self.rotation(at.unix_s)
        return ((theta + equinoxes) * (180.0 / math.pi) + site.longitude_deg) % 360.0

    def sidereal_rate_deg_s(self, at: Instant) -> Quantity:
        """Return the rate of apparent sidereal time, degrees in a second of UTC."""
        at = as_utc(at)
        _, theta_rate, _, equinoxes_rate, _, _ = self.rotation(at.unix_s)
        return (theta_rate + equinoxes_rate) * (180.0 / math.pi)

    def orientation(self, at: Instant) -> Orientation:
        """Return UT1-UTC and pole at one instant, linear between the table's days."""
        at = as_utc(at)
        index = self._index(at.unix_s)
        first, last = self._ends(index)
        part = at.unix_s / DAY_S - index
        return Orientation(
            index + UNIX_EPOCH_MJD,
            first.dut1_s + part * (last.dut1_s - first.dut1_s),
            first.xp_arcsec + part * (last.xp_arcsec - first.xp_arcsec),
            first.yp_arcsec + part * (last.yp_arcsec - first.yp_arcsec),
        )

    def age(self, at: Instant) -> EarthOrientationAge:
        """Tell how good the orientation for one instant is."""
        at = as_utc(at)
        if self._table is None or self._table.last_observed_mjd is None:
            return EarthOrientationAge(None, "fixed", None, None)
        observed = Utc((self._table.last_observed_mjd - UNIX_EPOCH_MJD) * DAY_S)
        predicted = Utc((self._table.last_mjd - UNIX_EPOCH_MJD) * DAY_S)
        status: Status = "extrapolated"
        if at <= observed:
            status = "observed"
        elif at <= predicted:
            status = "predicted"
        return EarthOrientationAge(at - observed, status, observed, predicted)

    def _check(self, unix_s: Quantity) -> None:
        good = (unix_s >= self._start_s) & (unix_s < _END.unix_s)
        if not np.all(good):
            bad = unix_s if not isinstance(unix_s, np.ndarray) else float(unix_s[~good][0])
            instant = (
                Utc(bad).isoformat("seconds")
                if math.isfinite(bad) and abs(bad) < 6e10
                else f"{bad} s since 1970"
            )
            raise TimeRangeError(
                f"{instant} is outside the time for which the Earth's orientation is known or guessed: "
                f"give one from {Utc(self._start_s).isoformat('seconds')} to {_END.isoformat('seconds')}"
            )

    def _index(self, unix_s: float) -> int:
        self._check(unix_s)
        return math.floor(unix_s / DAY_S)

    def _ends(self, index: int) -> tuple[Orientation, Orientation]:
        """Return the orientation at both ends of a day, both with the UT1-UTC that holds within the day."""
        if self._table is None:
            assert self._fixed is not None
            return self._fixed, self._fixed
        mjd, last = index + UNIX_EPOCH_MJD, self._table.last_mjd
        if mjd > last:
            self._warn()
            return self._table.day(last), self._table.day(last)
        end = self._table.day(min(mjd + 1, last))
        leap_s = tai_minus_utc_s(end.mjd) - tai_minus_utc_s(mjd)
        return self._table.day(mjd), Orientation(end.mjd, end.dut1_s - leap_s, end.xp_arcsec, end.yp_arcsec)

    def _warn(self) -> None:
        if not self._warned:
            assert self._table is not None
            self._warned = True
            until = Utc((self._table.last_mjd - UNIX_EPOCH_MJD) * DAY_S).isoformat("seconds")
            warnings.warn(
                f"Earth orientation is extrapolated: the table ends at {until}; directions may be off by "
                "seconds of arc: install a newer astropy-iers-data",
                EarthOrientationWarning,
                stacklevel=2,
            )

    def _day(self, index: int) -> tuple[float, ...]:
        """Return start, GMST82 and its rate, four coefficients of E, two of each pole coordinate of a day."""
        if index not in self._days:
            first, last = self._ends(index)
            mjd = index + UNIX_EPOCH_MJD
            ut1_rate = (last.dut1_s - first.dut1_s) / DAY_S
            ut1 = (_NODES_S + first.dut1_s + ut1_rate * _NODES_S) / DAY_S
            whole = MJD_JD + mjd
            mean = np.unwrap(erfa.gmst82(whole, ut1))
            true = erfa.gst06a(whole, ut1, whole, self._tt(mjd))
            equinoxes = _TO_CUBIC @ (np.remainder(true - mean + math.pi, 2.0 * math.pi) - math.pi)
            poles = (v * ARCSEC for v in (first.xp_arcsec, last.xp_arcsec, first.yp_arcsec, last.yp_arcsec))
            x0, x1, y0, y1 = poles
            numbers = (
                mean[0],
                (mean[3] - mean[0]) / DAY_S,
                *equinoxes,
                x0,
                (x1 - x0) / DAY_S,
                y0,
                (y1 - y0) / DAY_S,
            )
            self._days[index] = (index * DAY_S, *(float(n) for n in numbers))
        return self._days[index]

    def _days_of(self, unix_s: NDArray[np.float64]) -> tuple[Quantity, ...]:
        """Return the coefficients for an array of instants: floats where all are of one day, else arrays."""
        if unix_s.size == 0:
            return (0.0,) * 11
        self._check(unix_s)
        low, high = math.floor(unix_s.min() / DAY_S), math.floor(unix_s.max() / DAY_S)
        if low == high:
            return self._day(low)
        found, inverse = np.unique(np.floor(unix_s / DAY_S).astype(np.int64), return_inverse=True)
        return tuple(np.array([self._day(int(i)) for i in found]).T[:, inverse])

    def _matrix(self, index: int) -> NDArray[np.float64]:
        """Return four coefficients of a day's GCRS-to-date matrix, shape (4, 3, 3), by seconds since 0h."""
        if index not in self._matrices:
            mjd = index + UNIX_EPOCH_MJD
            nodes = erfa.pnm06a(MJD_JD + mjd, self._tt(mjd))
            self._matrices[index] = np.einsum("kn,nij->kij", _TO_CUBIC, nodes)
        return self._matrices[index]

    @staticmethod
    def _tt(mjd: int) -> Array:
        tt: Array = (_NODES_S + tai_minus_utc_s(mjd) + TT_MINUS_TAI_S) / DAY_S
        return tt


def earth_orientation_age(at: Instant, earth: EarthOrientation | None = None) -> EarthOrientationAge:
    """Tell whether Earth orientation for an instant is observed, predicted or extrapolated, and its age."""
    return (earth or EarthOrientation.installed()).age(at)


def turned(q: Triple, angle: Quantity) -> Triple:
    """Return a vector turned about the pole by an angle in rad."""
    fn = functions_for(angle)
    c, s = fn.cos(angle), fn.sin(angle)
    return q[0] * c - q[1] * s, q[0] * s + q[1] * c, q[2]


def to_tirs(vector: Vector, xp: Quantity, yp: Quantity) -> Triple:
    """Return a vector of the ITRS in the TIRS, for a pole in rad (IERS Conventions 2010, 5.4.1).

    To first order: poles stay within 1″, so the second order is below 1e-11. The locator s', 0.00001″, is
    left out.
    """
    x, y, z = vector
    return x - xp * z, y + yp * z, z + xp * x - yp * y


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
        self.axes = (site.east, site.north, site.up)
        self.equatorial_km = self.equatorial(np.array(self.axes) @ np.array(site.itrs_km))

    def turn_rad(self, start_s: float, since_s: Array) -> Array:
        """Return the Earth's turn, GMST82, with the middle day's offset: good to a thousandth of a second."""
        return _even(since_s, self._knots_s[0] - start_s) + self._turn

    def equatorial(self, place: Array) -> Array:
        """Return a place or direction east, north, up, shape (3, ...), in the axes of the equator.

        They are to the meridian on the equator, to the west, and to the pole. `equatorial_km` is where the
        site itself is in these axes, from the Earth's centre.
        """
        east, north, up = place
        cos, sin = self.up_axis
        return np.stack([cos * up - sin * north, -east, sin * up + cos * north])

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
