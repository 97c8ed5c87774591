"""Orbital elements: one frozen type, units in its names, and the motion that SGP4 makes of them.

SGP4's own velocities are not the derivatives of its positions: they miss them by 0.02 to 0.10 m/s. The
velocities of `Motion` are derivatives, by differences.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.polynomial import chebyshev
from sgp4.api import SGP4_ERRORS, WGS72, Satrec

from tle.errors import (
    DecayedError,
    MeanElementsError,
    MeanMotionError,
    PerturbedElementsError,
    PropagationError,
    SemiLatusRectumError,
    SubOrbitalError,
    TimeRangeError,
)
from tle.instants import DAY_S, UNIX_EPOCH_JD, Utc, as_utc, functions_for

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from tle.earth import EarthOrientation
    from tle.instants import Instant, Quantity

_SGP4_EPOCH_JD = 2433281.5
REV_DAY_PER_RAD_MIN = 1440.0 / (2.0 * math.pi)
DEG = math.pi / 180.0
_LEAST_INCLINATION_DEG = 1e-100
DECAYED = 6
# The Earth as SGP4 has it (WGS 72).
RADIUS_KM = 6378.135
MU_KM3_S2 = 398600.8
_NAMED_ERRORS: dict[int, type[PropagationError]] = {
    1: MeanElementsError,
    2: MeanMotionError,
    3: PerturbedElementsError,
    4: SemiLatusRectumError,
}
# About 0.4 km of a low orbit, at the epoch and again for each day of age.
_AT_EPOCH_S = 0.05
_A_DAY_S = 0.05
_SHARE_OF_DRAG = 0.15
# Below this height nothing is in orbit, and angles would grow without bound.
_LOWEST_KM = 100.0


@dataclass(frozen=True, slots=True)
class Elements:
    """Mean elements of SGP4 (Vallado 2006), in the frame TEME of their epoch, for one object.

    `designator` is written like "1998-067A", empty where unknown. `mean_motion_dot_rev_day2` is half the
    first derivative and `mean_motion_ddot_rev_day3` a sixth of the second, as element sets give them.
    """

    name: str
    catalog_number: int
    classification: str
    designator: str
    epoch: Utc
    inclination_deg: float
    raan_deg: float
    eccentricity: float
    arg_perigee_deg: float
    mean_anomaly_deg: float
    mean_motion_rev_day: float
    mean_motion_dot_rev_day2: float
    mean_motion_ddot_rev_day3: float
    bstar_per_earth_radius: float
    ephemeris_type: int = 0
    element_set_number: int = 0
    revolution_number: int = 0
    source: str = field(default="", compare=False)
    """The name of the file or download that they were taken from, without folders; empty where not known."""

    def __post_init__(self) -> None:
        """Take a datetime or a Time of another package as the epoch."""
        if type(self.epoch) is not Utc:
            object.__setattr__(self, "epoch", as_utc(self.epoch))

    def __repr__(self) -> str:
        """Show which object's elements these are, of when, and what orbit it has."""
        names = " ".join(part for part in (self.name, str(self.catalog_number), self.designator) if part)
        return (
            f"<Elements of {names}: epoch {self.epoch}, {self.mean_motion_rev_day:g} rev/day, "
            f"inclination {self.inclination_deg:g}°>"
        )

    @classmethod
    def from_tle(cls, line1: str, line2: str, name: str | None = None) -> Elements:
        """Return the elements of a two-line set; every column is checked.

        Raises a subclass of ElementsError that says which line and columns are wrong.
        """
        # Imported here, because the readers import this class.
        parse_set: Callable[[str, str, str], Elements] = import_module("tle.formats.tle").parse_set
        return parse_set(line1, line2, name or "")

    @property
    def label(self) -> str:
        """Give the name, or the catalogue number where there is none."""
        return self.name or str(self.catalog_number)

    @property
    def period_s(self) -> float:
        """Give the time of one revolution, in seconds."""
        return DAY_S / self.mean_motion_rev_day

    @property
    def semi_major_axis_km(self) -> float:
        """Give the semi-major axis that Kepler's third law makes of the mean motion (WGS 72), in km."""
        return float((MU_KM3_S2 * (self.period_s / (2.0 * math.pi)) ** 2) ** (1.0 / 3.0))

    @property
    def perigee_km(self) -> float:
        """Give the lowest height above an Earth of 6378.135 km radius, in km, as catalogues do."""
        return self.semi_major_axis_km * (1.0 - self.eccentricity) - RADIUS_KM

    @property
    def apogee_km(self) -> float:
        """Give the greatest height above an Earth of 6378.135 km radius, in km, as catalogues do."""
        return self.semi_major_axis_km * (1.0 + self.eccentricity) - RADIUS_KM

    def age_s(self, at: Instant) -> Quantity:
        """Return seconds from the epoch of the elements to an instant; negative before the epoch."""
        at = as_utc(at)
        return at.unix_s - self.epoch.unix_s

    @property
    def frame(self) -> str:
        """Name the frame of what SGP4 gives: TEME of date."""
        return "TEME"

    @property
    def provenance(self) -> str:
        """Say for a reader what the places are made of."""
        return f"SGP4, elements of {self.epoch.isoformat('seconds')}"

    @property
    def spans(self) -> tuple[tuple[Utc, Utc], ...]:
        """Give no span: elements have no first and no last instant."""
        return ()

    @property
    def ranged(self) -> bool:
        """Tell that the distance is known."""
        return True

    def states(self, earth: EarthOrientation, bent: bool = False) -> Motion:
        """Return what propagates the elements by SGP4. Raises PropagationError where it refuses them."""
        return Motion(self)

    def covariance(self, at: Utc) -> None:
        """Return none: element sets come without; see `expected_along_s`."""

    def satrec(self) -> Satrec:
        """Return a new SGP4 record, improved mode, WGS 72, as the elements are made for.

        From a TLE it is the record that reading the lines with SGP4's own code makes, to the last bit.
        Raises PropagationError where SGP4 refuses the elements at their epoch.
        """
        jd, fraction = epoch_jd(self.epoch)
        record = Satrec()
        record.sgp4init(
            WGS72,
            "i",
            0,  # the number plays no part in the motion, and nine-digit ones do not fit
            (jd + fraction) - _SGP4_EPOCH_JD,
            self.bstar_per_earth_radius,
            self.mean_motion_dot_rev_day2 / (REV_DAY_PER_RAD_MIN * 1440.0),
            self.mean_motion_ddot_rev_day3 / (REV_DAY_PER_RAD_MIN * 1440.0 * 1440.0),
            self.eccentricity,
            self.arg_perigee_deg * DEG,
            # SGP4 divides by its sine, unless that is naught.
            self.inclination_deg * DEG if self.inclination_deg > _LEAST_INCLINATION_DEG else 0.0,
            self.mean_anomaly_deg * DEG,
            self.mean_motion_rev_day / REV_DAY_PER_RAD_MIN,
            self.raan_deg * DEG,
        )
        # The epoch above is one float, good to 20 µs, because that is what enters SGP4's lunisolar
        # terms when it reads a TLE itself; the time since epoch comes from the two parts below.
        record.jdsatepoch = jd
        record.jdsatepochF = fraction
        if record.error not in (0, DECAYED):
            raise propagation_error(record.error, self, self.epoch)
        return record


def epoch_jd(epoch: Utc) -> tuple[float, float]:
    """Return an epoch as Julian date of 0h and fraction of day.

    A fraction within the resolution of `Utc` of eight decimals is taken as exactly those eight decimals,
    which is what a TLE holds.
    """
    days, second = divmod(epoch.unix_s, DAY_S)
    fraction = second / DAY_S
    eight = round(fraction, 8)
    return days + UNIX_EPOCH_JD, eight if abs(eight - fraction) < 3e-12 else fraction


def propagation_error(code: int, elements: Elements, at: Utc) -> PropagationError:
    """Return the exception for an SGP4 error number, saying for what object and when."""
    try:
        when = at.isoformat("seconds")
    except TimeRangeError:
        when = f"{at.unix_s} s since 1970"
    age_days = elements.age_s(at) / DAY_S
    if code == DECAYED and elements.perigee_km < 0.0:
        return SubOrbitalError(
            f"{elements.label} ({elements.catalog_number}) is below the ground at {when}: it is sub-orbital, "
            f"its elements have their perigee {-elements.perigee_km:.0f} km inside the Earth",
            code,
        )
    if code == DECAYED:
        way_out = "newer elements or an earlier time" if age_days > 0.0 else "older elements or a later time"
        return DecayedError(
            f"{elements.label} ({elements.catalog_number}) has decayed at {when}, "
            f"{age_days:+.1f} days from the epoch of its elements: use {way_out}",
            code,
        )
    reason = SGP4_ERRORS.get(code, "unknown error")
    return _NAMED_ERRORS.get(code, PropagationError)(
        f"{elements.label} ({elements.catalog_number}) cannot be propagated to {when}, "
        f"{age_days:+.1f} days from the epoch of its elements (SGP4 error {code}: {reason}): "
        "use newer elements or a nearer time",
        code,
    )


_ALPHA5 = "ABCDEFGHJKLMNPQRSTUVWXYZ"
_ALPHA5_FIELD = re.compile(rf"(?=.*\d$) *(\d{{1,9}})|([{_ALPHA5}])(\d{{4}})", re.ASCII)


def parse_alpha5(field: str) -> int | None:
    """Return the catalogue number that up to nine digits or an Alpha-5 field say, None where it is none.

    Alpha-5 (Space-Track): a letter for the two leading digits, A = 10 to Z = 33 without I and O.
    """
    match = _ALPHA5_FIELD.fullmatch(field)
    if match is None:
        return None
    if match.group(1):
        return int(match.group(1))
    return (10 + _ALPHA5.index(match.group(2))) * 10000 + int(match.group(3))


def format_alpha5(number: int) -> str | None:
    """Return a catalogue number as a TLE's five columns hold it, None above 339999, where Alpha-5 ends."""
    if number <= 99_999:
        return f"{number:05d}"
    if number <= 339_999:
        return f"{_ALPHA5[number // 10_000 - 10]}{number % 10_000:04d}"
    return None


def expected_along_s(elements: Elements, at: Instant) -> float:
    """Return the along-track error to expect at an instant, in seconds; at most half a revolution.

    A typical figure, not a bound, and as large before the epoch as after it. It joins three parts as the root
    of their squares: what elements miss at their own epoch, what errors of mean motion add a day, and a share
    of what drag has done since by the elements, because drag changes with the Sun's activity. The three
    constants describe objects in low orbit that do not manoeuvre; one that does may be anywhere on its orbit.
    """
    days = abs(elements.age_s(at)) / DAY_S
    revolutions_by_drag = abs(elements.mean_motion_dot_rev_day2) * days * days
    by_drag_s = revolutions_by_drag * elements.period_s
    error_s = math.hypot(_AT_EPOCH_S, _A_DAY_S * days, _SHARE_OF_DRAG * by_drag_s)
    return min(error_s, 0.5 * elements.period_s)


def expected_along_arcsec(elements: Elements, at: Instant) -> float:
    """Return what `expected_along_s` is on the sky, in arcsec, at its largest: perigee straight overhead."""
    height_km = max(elements.perigee_km, _LOWEST_KM)
    speed_km_s = math.sqrt(MU_KM3_S2 * (2.0 / (RADIUS_KM + height_km) - 1.0 / elements.semi_major_axis_km))
    return math.degrees(math.atan(expected_along_s(elements, at) * speed_km_s / height_km)) * 3600.0


_TERMS = 10
_FEWEST_A_PART = 40
# The last two terms say how well the polynomial fits, in km.
_FIT_KM = 1e-6
# Lower than this SGP4 is about to call the satellite decayed, which each instant must find out for itself.
_FLIES_ABOVE_KM = 6500.0
_NODES = chebyshev.chebpts1(_TERMS)
_TO_CHEBYSHEV = np.linalg.inv(chebyshev.chebvander(_NODES, _TERMS - 1))
_POLYNOMIALS = [chebyshev.cheb2poly(row) for row in np.eye(_TERMS)]
_TO_POWERS = np.array([np.pad(p, (0, _TERMS - len(p))) for p in _POLYNOMIALS]).T
# x, y, z of position (km), velocity (km/s) and acceleration (km/s2, good to a thousandth: enough for the
# change of velocity within a light time), then SGP4's error number.
State = tuple["Quantity", ...]
# The formula below errs by _STEP_S**2/12 of the third derivative, 2e-7 km/s in low orbit; a shorter step
# would let the rounding of SGP4's mean anomaly through instead.
_STEP_S = 0.5
_J2_RADIUS2_KM2 = 1.082616e-3 * RADIUS_KM**2
_PARTS_PER_TURN = 24
_FEWEST_SHARED = 100


class Motion:
    """SGP4 for one set of elements, TEME, for floats and arrays. Not to be shared between threads."""

    def __init__(self, elements: Elements) -> None:
        """Start SGP4. Raises PropagationError where it refuses the elements."""
        self.elements = elements
        self._record = elements.satrec()
        self._sgp4 = self._record.sgp4
        e = elements.eccentricity
        self._part_s = elements.period_s * (1.0 - e) ** 1.5 / math.sqrt(1.0 + e) / _PARTS_PER_TURN

    def at(self, unix_s: float, later_s: float) -> State:
        """Return the state at POSIX seconds of UTC plus `later_s`, last item 0. Raises PropagationError."""
        days = unix_s // DAY_S
        jd = days + UNIX_EPOCH_JD
        second = unix_s - days * DAY_S + later_s
        code, r, v = self._sgp4(jd, second / DAY_S)
        next_code, r1, v1 = self._sgp4(jd, (second + _STEP_S) / DAY_S)
        if code or next_code:
            raise propagation_error(code or next_code, self.elements, Utc(unix_s))
        x, y, z = r
        vx, vy, vz = v
        x1, y1, z1 = r1
        vx1, vy1, vz1 = v1
        dx, dy, dz = vx1 - vx, vy1 - vy, vz1 - vz
        return (
            x,
            y,
            z,
            # The chord is the velocity half a step later; SGP4's own velocities lead back well enough.
            (x1 - x) / _STEP_S - 0.5 * dx,
            (y1 - y) / _STEP_S - 0.5 * dy,
            (z1 - z) / _STEP_S - 0.5 * dz,
            dx / _STEP_S,
            dy / _STEP_S,
            dz / _STEP_S,
            0,
        )

    def at_many(self, unix_s: NDArray[np.float64], later_s: Quantity) -> State:
        """Return the states at an array of instants; where SGP4 fails, NaN, and its error number last.

        Where many instants share a small part of the orbit, SGP4 is asked at a few of them only.
        """
        days = np.floor(unix_s / DAY_S)
        second = unix_s - days * DAY_S + later_s
        jd = days + UNIX_EPOCH_JD
        if len(second) >= _FEWEST_SHARED:
            state = shared_states(self._record, jd, second, self._part_s)
            if state is not None:
                return (*state, np.zeros(len(second), dtype=np.uint8))
        code, r, v = self._record.sgp4_array(jd, second / DAY_S)
        late, r1, v1 = self._record.sgp4_array(jd, (second + _STEP_S) / DAY_S)
        code = np.where(code == 0, late, code)
        r, v, r1, v1 = (np.ascontiguousarray(a.T) for a in (r, v, r1, v1))
        velocity = (r1 - r) / _STEP_S - 0.5 * (v1 - v)
        r[:, code != 0] = np.nan
        return (*r, *velocity, *((v1 - v) / _STEP_S), code)


def shared_states(
    record: Satrec, jd: NDArray[np.float64], second: NDArray[np.float64], part_s: float
) -> NDArray[np.float64] | None:
    """Return position, velocity, acceleration (km, km/s, km/s2), shape (9, n), from polynomials over parts.

    Instants are whole Julian dates `jd` and seconds since; `part_s` is how long one polynomial may serve.
    None where the instants are too few, or SGP4 not smooth or not sure enough, for that.
    """
    since = (jd - jd[0]) * DAY_S + second
    first, last = float(since.min()), float(since.max())
    if not math.isfinite(last - first):
        return None
    count = math.floor((last - first) / part_s) + 1
    if count * _FEWEST_A_PART > len(since):
        return None
    half_s = 0.5 * (last - first) / count or 1.0
    middles: NDArray[np.float64] = first + half_s * (2.0 * np.arange(count, dtype=np.float64) + 1.0)
    powers = _fit(record, float(jd[0]), middles, half_s)
    if powers is None:
        return None
    order = None if (np.diff(since) >= 0.0).all() else np.argsort(since)
    ordered = since if order is None else since[order]
    bounds = np.searchsorted(ordered, middles[:-1] + half_s)
    states = np.empty((9, len(since)))
    for part, start, stop in zip(range(count), [0, *bounds], [*bounds, len(since)], strict=True):
        x = (ordered[start:stop] - middles[part]) / half_s
        raised = np.empty((_TERMS, stop - start))
        raised[0] = 1.0
        for term in range(1, _TERMS):
            np.multiply(raised[term - 1], x, out=raised[term])
        states[:, start:stop] = powers[part] @ raised
    if order is None:
        return states
    back = np.empty_like(states)
    back[:, order] = states
    return back


def _fit(record: Satrec, jd: float, middles: NDArray[Any], half_s: float) -> NDArray[np.float64] | None:
    """Return coefficients of the powers of x, shape (parts, 9, terms), for x from -1 to 1 over each part."""
    nodes = (middles[:, None] + half_s * _NODES).ravel()
    code, r, _ = record.sgp4_array(np.full(nodes.shape, jd), nodes / DAY_S)
    if code.any() or np.linalg.norm(r, axis=1).min() < _FLIES_ABOVE_KM:
        return None
    terms = np.einsum("kn,pnc->pkc", _TO_CHEBYSHEV, r.reshape(len(middles), _TERMS, 3))
    if np.abs(terms[:, -2:]).max() > _FIT_KM:
        return None
    place = np.einsum("kn,pnc->pck", _TO_POWERS, terms)
    degree = np.arange(1.0, _TERMS)
    velocity, acceleration = np.zeros_like(place), np.zeros_like(place)
    velocity[..., :-1] = place[..., 1:] * degree / half_s
    acceleration[..., :-1] = velocity[..., 1:] * degree / half_s
    return np.concatenate([place, velocity, acceleration], axis=1)


def gravity_km_s2(x: Quantity, y: Quantity, z: Quantity) -> tuple[Quantity, Quantity, Quantity]:
    """Return the Earth's pull at a geocentric place in km, of its mass and flattening (WGS 72's μ and J2)."""
    r2 = x * x + y * y + z * z
    pull = -MU_KM3_S2 / (r2 * functions_for(r2).sqrt(r2))
    flat = 1.5 * _J2_RADIUS2_KM2 / r2
    tilt = 5.0 * z * z / r2
    equatorial, polar = pull * (1.0 + flat * (1.0 - tilt)), pull * (1.0 + flat * (3.0 - tilt))
    return equatorial * x, equatorial * y, polar * z
