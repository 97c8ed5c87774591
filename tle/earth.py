"""How the Earth is turned: sidereal angle, equinoxes, pole; offline, from IERS data or from given values.

The sidereal angle of TEME is GMST82 of UT1 (Vallado 2006); the step from TEME to the true equator and equinox
of date is a turn about the pole by GAST06A - GMST82 (IAU 2006/2000A, IERS Conventions 2010, 5.5.7). Both, and
the polar motion, are held as polynomials a day long, made on first use.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Literal

import erfa
import numpy as np

from tle.errors import EarthOrientationWarning, TimeRangeError
from tle.iers import (
    FIRST_MJD,
    UNIX_EPOCH_MJD,
    IersTable,
    Orientation,
    installed_table,
    tai_minus_utc_s,
)
from tle.instants import DAY_S, Utc
from tle.site import Site, Vector

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tle.quantities import Quantity

__all__ = ["EarthOrientation", "EarthOrientationAge", "Rotation", "Site", "earth_orientation_age", "to_tirs"]

Status = Literal["observed", "predicted", "extrapolated", "fixed"]

_MJD_JD = 2400000.5
_TT_MINUS_TAI_S = 32.184
_ARCSEC = math.pi / 648000.0
# Two-digit years of element sets end with 2056, and nobody knows the Earth's rotation so far ahead.
_END = Utc.parse("2057-01-01")
_FIXED_START = Utc.parse("1957-01-01")
_NODES_S = np.array([0.0, DAY_S / 3.0, 2.0 * DAY_S / 3.0, DAY_S])
_TO_CUBIC = np.linalg.inv(np.vander(_NODES_S / DAY_S, increasing=True)) / DAY_S ** np.arange(4.0)[:, None]

# θ = GMST82 and its rate, E = GAST06A - GMST82 and its rate, pole x and y: rad and rad/s.
Rotation = tuple["Quantity", "Quantity", "Quantity", "Quantity", "Quantity", "Quantity"]


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


class EarthOrientation:
    """UT1 and polar motion for any instant, and what follows from them for any site."""

    def __init__(self, table: IersTable | None, fixed: Orientation | None = None) -> None:
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
        """Return an orientation with the same UT1-UTC and pole for all instants."""
        return cls(None, Orientation(0, dut1_s, xp_arcsec, yp_arcsec))

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

    def celestial_matrix(self, at: Utc) -> NDArray[np.float64]:
        """Return the matrices, shape (3, 3) or (n, 3, 3), from GCRS to true equator and equinox of date.

        Bias, precession and nutation of IAU 2006/2000A (ERFA's pnm06a), without the IERS's celestial pole
        offsets of under a milliarcsecond. Raises TimeRangeError.
        """
        if at.is_array:
            self._check(at.unix_s)
            index = np.floor(at.unix_s / DAY_S).astype(np.int64)
            found, inverse = np.unique(index, return_inverse=True)
            table = np.array([self._matrix(int(i)) for i in found]).reshape(-1, 4, 3, 3)
            x = at.unix_s - index * DAY_S
            powers = np.stack([np.ones_like(x), x, x * x, x * x * x], axis=1)
            matrices: NDArray[np.float64] = np.einsum("nk,nkij->nij", powers, table[inverse])
            return matrices
        one = self._index(at.unix_s)
        x = at.unix_s - one * DAY_S
        matrix: NDArray[np.float64] = np.tensordot([1.0, x, x * x, x * x * x], self._matrix(one), axes=1)
        return matrix

    def local_apparent_sidereal_deg(self, at: Utc, site: Site) -> Quantity:
        """Return local apparent sidereal time, GAST06A plus the site's longitude, degrees from 0 to 360."""
        theta, _, equinoxes, _, _, _ = self.rotation(at.unix_s)
        return ((theta + equinoxes) * (180.0 / math.pi) + site.longitude_deg) % 360.0

    def sidereal_rate_deg_s(self, at: Utc) -> Quantity:
        """Return the rate of apparent sidereal time, degrees in a second of UTC."""
        _, theta_rate, _, equinoxes_rate, _, _ = self.rotation(at.unix_s)
        return (theta_rate + equinoxes_rate) * (180.0 / math.pi)

    def orientation(self, at: Utc) -> Orientation:
        """Return UT1-UTC and pole at one instant, linear between the table's days."""
        index = self._index(at.unix_s)
        first, last = self._ends(index)
        part = at.unix_s / DAY_S - index
        return Orientation(
            index + UNIX_EPOCH_MJD,
            first.dut1_s + part * (last.dut1_s - first.dut1_s),
            first.xp_arcsec + part * (last.xp_arcsec - first.xp_arcsec),
            first.yp_arcsec + part * (last.yp_arcsec - first.yp_arcsec),
        )

    def age(self, at: Utc) -> EarthOrientationAge:
        """Tell how good the orientation for one instant is."""
        if self._table is None:
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
            told = (
                Utc(bad).isoformat("seconds")
                if math.isfinite(bad) and abs(bad) < 6e10
                else f"{bad} s since 1970"
            )
            raise TimeRangeError(
                f"{told} is outside the time for which the Earth's orientation is known or guessed: "
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
            whole = _MJD_JD + mjd
            mean = np.unwrap(erfa.gmst82(whole, ut1))
            true = erfa.gst06a(whole, ut1, whole, self._tt(mjd))
            equinoxes = _TO_CUBIC @ (np.remainder(true - mean + math.pi, 2.0 * math.pi) - math.pi)
            poles = (v * _ARCSEC for v in (first.xp_arcsec, last.xp_arcsec, first.yp_arcsec, last.yp_arcsec))
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
            nodes = erfa.pnm06a(_MJD_JD + mjd, self._tt(mjd))
            self._matrices[index] = np.einsum("kn,nij->kij", _TO_CUBIC, nodes)
        return self._matrices[index]

    @staticmethod
    def _tt(mjd: int) -> NDArray[np.float64]:
        return (_NODES_S + tai_minus_utc_s(mjd) + _TT_MINUS_TAI_S) / DAY_S


def earth_orientation_age(at: Utc, earth: EarthOrientation | None = None) -> EarthOrientationAge:
    """Tell whether Earth orientation for an instant is observed, predicted or extrapolated, and its age."""
    return (earth or EarthOrientation.installed()).age(at)


def to_tirs(vector: Vector, xp: Quantity, yp: Quantity) -> tuple[Quantity, Quantity, Quantity]:
    """Return a vector of the ITRS in the TIRS, for a pole in rad (IERS Conventions 2010, 5.4.1).

    To first order: poles stay within 1″, so the second order is below 1e-11. The locator s', 0.00001″, is
    left out.
    """
    x, y, z = vector
    return x - xp * z, y + yp * z, z + xp * x - yp * y
