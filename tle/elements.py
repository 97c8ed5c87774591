"""Orbital elements: one frozen type, units in its names, that SGP4 can be started from."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, NamedTuple

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
from tle.instants import DAY_S, UNIX_EPOCH_JD, Utc, as_utc

if TYPE_CHECKING:
    from collections.abc import Callable

    from tle.earth import EarthOrientation
    from tle.ephemeris import Covariance, Ephemeris, States
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
UNSTATED_M = 100.0
"""What a file that states no error is taken to miss: what laser predictions and operators do in some days."""


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

    def states(self, earth: EarthOrientation, bent: bool = False) -> States:
        """Return what propagates the elements by SGP4. Raises PropagationError where it refuses them."""
        # Looked up when it is asked for: what propagates is made of this class.
        made: States = import_module("tle.propagator").Motion(self)
        return made

    def covariance(self, at: Utc) -> Covariance | None:
        """Return none: element sets come without; see `expected_along_s`."""
        return None

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
        return DecayedError(
            f"{elements.label} ({elements.catalog_number}) has decayed at {when}, "
            f"{age_days:+.1f} days from the epoch of its elements: use newer elements or an earlier time",
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


def expected_error_m(source: Elements | Ephemeris, at: Utc) -> float | None:
    """Return the typical error of a source's places at an instant, metres.

    Of elements what `expected_along_s` is on the orbit, else what the source states; None where it does not.
    """
    if isinstance(source, Elements):
        speed_km_s = math.sqrt(MU_KM3_S2 / source.semi_major_axis_km)
        return 1000.0 * speed_km_s * expected_along_s(source, at)
    known = source.covariance(at)
    return None if known is None else 1000.0 * known.sigma_km


class SourceRank(NamedTuple):
    """How a source compares with others of the same object for a time; the least is the best."""

    over: bool
    """Its places end before."""
    in_part: bool
    """It has no places for some of the time."""
    error_m: float
    """By how much it misses its object, `UNSTATED_M` where it does not say."""


def source_rank(source: Elements | Ephemeris, first: Utc, at: Utc, last: Utc) -> SourceRank:
    """Return the rank of a source from one instant to another, whose error counts at a third."""
    spans, error_m = source.spans, expected_error_m(source, at)
    return SourceRank(
        bool(spans) and spans[-1][1] < first,
        bool(spans) and not any(low <= first and last <= high for low, high in spans),
        UNSTATED_M if error_m is None else error_m,
    )
