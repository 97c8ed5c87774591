"""Trajectories of the antenna's two axes: of constant rates, and of sources and satellites on the sky.

"Ideal Field System Antenna Interface", sections 4.1.1, 7.0 and 8.0. Angles are degrees of the antenna's axes.
Hour angles are local apparent sidereal time less right ascension of date, so that a mount steered by reported
right ascension points as commanded, independent of its own clock. Horizontal angles are those of the
ellipsoid's horizon with polar motion, as in `tle`. Positions that are sent are taken without refraction.

The reduction of a target: the place of date (for J2000 by precession, nutation and aberration; for satellites
by SGP4), plus the offsets in right ascension and declination; the hour angle by local apparent sidereal time,
plus the offsets in hour angle and declination; azimuth and elevation, plus theirs; for equatorial axes the
pointing model at last.

Elements come a line or a value at a time, and are checked as they come. The checks of lines are those of the
Field System's `tle` command: the line's number, the catalogue number, the check-sum.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from decimal import Decimal
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, Protocol

from sattrack.pointing.terms import first_order_deg
from sattrack.servers.antenna.protocol import NS, Nak
from tle.bias import NO_BIAS, Bias
from tle.earth import EarthOrientation, to_tirs
from tle.elements import Elements, parse_alpha5
from tle.errors import ElementsError, FieldRangeError, MissingFieldError
from tle.formats.omm import KEYWORDS, TextPlace, elements_of
from tle.formats.tle import checksum, parse_set
from tle.instants import Utc
from tle.observed import apparent_unit
from tle.propagator import Propagator
from tle.refraction import Refraction

if TYPE_CHECKING:
    from sattrack.pointing import terms
    from sattrack.servers.antenna.protocol import AntennaRequest
    from tle.site import Site

DIFFERENCE_NS = 50_000_000
"""Half of the interval over which rates are taken as differences of positions."""
INVERSE_ROUNDS = 8
LINE_LENGTH = 69
NAME_LENGTH = 24
MODEL_TERMS = ("ih", "id", "ch", "np", "ma", "me")
VALID_OMM = {
    "OBJECT_NAME": "A",
    "EPOCH": "2000-01-01T12:00:00",
    "MEAN_MOTION": "15",
    "ECCENTRICITY": "0",
    "INCLINATION": "0",
    "RA_OF_ASC_NODE": "0",
    "ARG_OF_PERICENTER": "0",
    "MEAN_ANOMALY": "0",
    "NORAD_CAT_ID": "1",
    "BSTAR": "0",
    "MEAN_MOTION_DOT": "0",
    "MEAN_MOTION_DDOT": "0",
}
"""Well-formed values: with them, a single value is read by itself."""
NO_OFFSET = (0.0, 0.0)
AxisKind = Literal["hadec", "azel"]
Triple = tuple[float, float, float]


class AxisState(NamedTuple):
    """Where two axes are, degrees, and how fast they turn, degrees a second; turns of the first count."""

    first_deg: float
    second_deg: float
    first_rate_deg_s: float
    second_rate_deg_s: float


class ExactState(NamedTuple):
    """The same as an AxisState, to the last digit that was sent."""

    first_deg: Decimal
    second_deg: Decimal
    first_rate_deg_s: Decimal
    second_rate_deg_s: Decimal


class Path(Protocol):
    """A trajectory of the antenna's axes."""

    def at(self, utc_ns: int) -> AxisState:
        """Return the commanded state at an instant."""


@dataclass(frozen=True, slots=True)
class Straight:
    """A trajectory of constant rates: a position at an epoch, extrapolated to future and past."""

    start: ExactState
    epoch_ns: int

    @classmethod
    def standing(cls, first_deg: float, second_deg: float, since_ns: int) -> Straight:
        """Return the trajectory of axes at rest."""
        zero = Decimal(0)
        return cls(ExactState(Decimal(first_deg), Decimal(second_deg), zero, zero), since_ns)

    def exact(self, utc_ns: int) -> ExactState:
        """Return the state at an instant, in the digits that were sent."""
        seconds = Decimal(utc_ns - self.epoch_ns) / NS
        first, second, first_rate, second_rate = self.start
        return ExactState(first + first_rate * seconds, second + second_rate * seconds, *self.start[2:])

    def at(self, utc_ns: int) -> AxisState:
        """Return the state at an instant."""
        return AxisState(*(float(figure) for figure in self.exact(utc_ns)))

    def turned(self, turns: int) -> Straight:
        """Return the trajectory moved by whole turns of the first axis."""
        return Straight(self.start._replace(first_deg=self.start.first_deg + 360 * turns), self.epoch_ns)


@dataclass(frozen=True, slots=True)
class AxisRange:
    """The range of the axes, degrees, and the origin of the first axis' turns.

    `base_deg` begins wrap 0: a whole turn from there on. A second axis that goes beyond 90° plunges.
    """

    base_deg: float
    first_least_deg: float
    first_most_deg: float
    second_least_deg: float
    second_most_deg: float

    def wrap_of(self, first_deg: float) -> tuple[float, int]:
        """Return a position of the first axis as an angle of wrap 0, and its wrap."""
        turns = math.floor((first_deg - self.base_deg) / 360.0)
        return first_deg - 360.0 * turns, turns

    def turns_to(self, first_deg: float, wrap: int) -> int:
        """Return the turns that move a position into a wrap."""
        return wrap - self.wrap_of(first_deg)[1]

    def shortest_turns(self, first_deg: float, from_deg: float) -> int:
        """Return the turns that move a position to where the path is shortest, within the range.

        Where no turn of it is in the range, the nearest to the range counts.
        """
        nearest = round((from_deg - first_deg) / 360.0)
        candidates = range(nearest - 2, nearest + 3)

        def cost(turns: int) -> tuple[float, float]:
            place = first_deg + 360.0 * turns
            outside = max(0.0, place - self.first_most_deg, self.first_least_deg - place)
            return outside, abs(place - from_deg)

        return min(candidates, key=cost)


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


class SiteSky:
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
        """Return azimuth and elevation of a direction; the instant decides polar motion."""
        v = self._tirs(place)
        e, n, u = (_dot(axis, v) for axis in self._axes(utc_s))
        return AzEl(math.degrees(math.atan2(e, n)) % 360.0, math.degrees(math.atan2(u, math.hypot(e, n))))

    def equatorial(self, place: AzEl, utc_s: float) -> HaDec:
        """Return hour angle and declination of a horizontal direction; past 90° the antenna is plunged."""
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


class SkyTarget(Protocol):
    """A target on the sky."""

    def place(self, utc_s: float) -> RaDec:
        """Return its topocentric right ascension and declination of date, degrees."""


@dataclass(frozen=True, slots=True)
class SourceOfDate:
    """A source by topocentric coordinates of date."""

    coordinates: RaDec

    def place(self, utc_s: float) -> RaDec:
        """Return them."""
        del utc_s
        return self.coordinates


@dataclass(frozen=True, slots=True)
class J2000Source:
    """A source by mean coordinates of J2000 (ICRS)."""

    coordinates: RaDec
    sky: SiteSky

    def place(self, utc_s: float) -> RaDec:
        """Return its apparent place."""
        return self.sky.of_date(self.coordinates, utc_s)


@dataclass(frozen=True, slots=True)
class ElementsTarget:
    """A satellite by its elements, with biases along and across its track."""

    propagator: Propagator
    bias: Bias

    def place(self, utc_s: float) -> RaDec:
        """Return its apparent place. Raises PropagationError where its elements end."""
        seen = self.propagator.at(Utc(utc_s), self.bias)
        return RaDec(float(seen.ra_deg), float(seen.dec_deg))


@dataclass(frozen=True, slots=True)
class AxisCorrections:
    """Corrections of equatorial axes, degrees, added to hour angle and declination to give axis positions.

    ΔHA = ih + ch/cos δ + np·tan δ - ma·cos h·tan δ + me·sin h·tan δ; ΔDec = id + ma·sin h + me·cos h: the
    first order that `sattrack.pointing.terms` has of these terms.
    """

    ih: float = 0.0
    id: float = 0.0
    ch: float = 0.0
    np: float = 0.0
    ma: float = 0.0
    me: float = 0.0

    def correction(self, place: HaDec) -> HaDec:
        """Return the correction at a direction; within 0.1° of the pole, that at 0.1°."""
        terms = {name.upper(): getattr(self, name) for name in MODEL_TERMS}
        return HaDec(*first_order_deg(terms, place.ha_deg, place.dec_deg))

    def axes(self, place: HaDec) -> HaDec:
        """Return the axes' positions for a direction."""
        added = self.correction(place)
        return HaDec(place.ha_deg + added.ha_deg, place.dec_deg + added.dec_deg)

    def inverse(self, axes: HaDec) -> HaDec:
        """Return the direction of axes' positions: the inverse of `axes`, by iteration."""
        place = axes
        for _ in range(INVERSE_ROUNDS):
            added = self.correction(place)
            place = HaDec(axes.ha_deg - added.ha_deg, axes.dec_deg - added.dec_deg)
        return place


@dataclass(frozen=True, slots=True)
class ProfileModel:
    """The pointing model of the mount's profile: in force until POINTING sets another, or none."""

    model: terms.PointingModel

    def axes(self, place: HaDec) -> HaDec:
        """Return the axes' positions for a direction, on the normal side of the pole."""
        return HaDec(*self.model.reported(place.ha_deg, place.dec_deg))

    def inverse(self, axes: HaDec) -> HaDec:
        """Return the direction of axes' positions."""
        return HaDec(*self.model.looks(axes.ha_deg, axes.dec_deg))


@dataclass(frozen=True, slots=True)
class Reduction:
    """From a place of date to the antenna's axes."""

    sky: SiteSky
    axes: AxisKind
    radec: tuple[float, float] = NO_OFFSET
    hadec: tuple[float, float] = NO_OFFSET
    azel: tuple[float, float] = NO_OFFSET
    model: AxisCorrections | ProfileModel = field(default_factory=AxisCorrections)

    def positions(self, place: RaDec, utc_s: float) -> tuple[float, float]:
        """Return both axes' positions, degrees, on any turn."""
        ha_deg = self.sky.sidereal_deg(utc_s) - place.ra_deg - self.radec[0]
        there = HaDec(ha_deg + self.hadec[0], place.dec_deg + self.radec[1] + self.hadec[1])
        if self.axes == "azel" or self.azel != NO_OFFSET:
            seen = self.sky.horizontal(there, utc_s)
            seen = AzEl(seen.az_deg + self.azel[0], seen.el_deg + self.azel[1])
            if self.axes == "azel":
                return seen
            there = self.sky.equatorial(seen, utc_s)
        return self.model.axes(there)


class SkyPath:
    """The path of a target as the axes follow it, turns of the first axis counted from `near_deg` on."""

    def __init__(self, target: SkyTarget, reduction: Reduction, near_deg: float) -> None:
        self.target = target
        self._reduction = reduction
        self._last_deg = near_deg

    def at(self, utc_ns: int) -> AxisState:
        """Return the commanded state at an instant."""
        first, second = self._place(utc_ns)
        early, late = self._place(utc_ns - DIFFERENCE_NS), self._place(utc_ns + DIFFERENCE_NS)
        apart_s = 2.0 * DIFFERENCE_NS / NS
        first += 360.0 * round((self._last_deg - first) / 360.0)
        self._last_deg = first
        return AxisState(
            first,
            second,
            math.remainder(late[0] - early[0], 360.0) / apart_s,
            (late[1] - early[1]) / apart_s,
        )

    def turn_by(self, turns: int) -> None:
        """Add turns of the first axis."""
        self._last_deg += 360.0 * turns

    def reduced_by(self, reduction: Reduction) -> SkyPath:
        """Return the same target's path by another reduction."""
        return SkyPath(self.target, reduction, self._last_deg)

    def _place(self, utc_ns: int) -> tuple[float, float]:
        utc_s = utc_ns / NS
        return self._reduction.positions(self.target.place(utc_s), utc_s)


class StoreError(Exception):
    """Elements that are refused or missing; `why` is the number of the refusal."""

    def __init__(self, why: Nak) -> None:
        super().__init__(why.name)
        self.why = why


class ElementStore:
    """The elements of one satellite: another's number begins anew, and so does the other format."""

    def __init__(self) -> None:
        self._number: int | None = None
        self._lines: dict[int, str] = {}
        self._values: dict[str, str] = {}

    def take_line(self, line: int, number: int, text: str) -> None:
        """Take a name (line 0) or an element line (1 or 2). Raises StoreError, and then changes nothing."""
        if line == 0:
            if len(text) > NAME_LENGTH:
                raise StoreError(Nak.RANGE)
        else:
            _check_line(line, number, text)
        self._begin(number, self._values)
        self._lines[line] = text

    def take_value(self, number: int, keyword: str, value: str) -> None:
        """Take the value of one OMM keyword. Raises StoreError, and then changes nothing."""
        if keyword not in KEYWORDS:
            raise StoreError(Nak.VALUE)
        if keyword == "NORAD_CAT_ID" and value != str(number):
            raise StoreError(Nak.ELEMENTS_NUMBER)
        try:
            elements_of(VALID_OMM | {keyword: value}, TextPlace())
        except FieldRangeError as error:
            raise StoreError(Nak.RANGE) from error
        except ElementsError as error:
            raise StoreError(Nak.VALUE) from error
        self._begin(number, self._lines)
        self._values[keyword] = value

    def elements(self, number: int) -> Elements:
        """Return the elements of a satellite. Raises StoreError."""
        if self._number is None:
            raise StoreError(Nak.ELEMENTS_MISSING)
        if number != self._number:
            raise StoreError(Nak.ELEMENTS_NUMBER)
        try:
            if self._values:
                return elements_of({"NORAD_CAT_ID": str(number)} | self._values, TextPlace())
            if 1 not in self._lines or 2 not in self._lines:
                raise StoreError(Nak.ELEMENTS_MISSING)
            return parse_set(self._lines[1], self._lines[2], self._lines.get(0, ""))
        except ElementsError as error:
            missing = isinstance(error, MissingFieldError)
            raise StoreError(Nak.ELEMENTS_MISSING if missing else Nak.ELEMENTS_USELESS) from error

    def _begin(self, number: int, other_format: dict[int, str] | dict[str, str]) -> None:
        if number != self._number:
            self._lines.clear()
            self._values.clear()
        self._number = number
        other_format.clear()


class SkyTargets:
    """Makes targets and their paths of the commands sent so far, for one antenna."""

    def __init__(self, sky: SiteSky, axes: AxisKind) -> None:
        self.reduction = Reduction(sky, axes)
        self.elements = ElementStore()
        self.bias: Bias = NO_BIAS
        self.hold = False
        """Whether the antenna stands where a satellite is, and does not track it."""
        self._sky = sky

    def offset(self, request: AntennaRequest) -> None:
        """Take the offsets of one kind."""
        pair = (request.number("first"), request.number("second"))
        match request.text("kind"):
            case "RADEC":
                self.reduction = replace(self.reduction, radec=pair)
            case "HADEC":
                self.reduction = replace(self.reduction, hadec=pair)
            case _:
                self.reduction = replace(self.reduction, azel=pair)

    def model(self, request: AntennaRequest) -> None:
        """Take a pointing model."""
        model = AxisCorrections(*(request.number(term) for term in MODEL_TERMS))
        self.reduction = replace(self.reduction, model=model)

    def source(self, request: AntennaRequest) -> SkyTarget:
        """Return the source that a command names."""
        coordinates = RaDec(request.number("ra"), request.number("dec"))
        return (
            SourceOfDate(coordinates)
            if request.text("frame") == "DATE"
            else J2000Source(coordinates, self._sky)
        )

    def satellite(self, number: int, refracted: bool) -> ElementsTarget:
        """Return the satellite whose elements were sent. Raises StoreError or TleError."""
        site = self._sky.site
        air = Refraction.standard(site.height_m) if refracted else None
        propagator = Propagator(self.elements.elements(number), site, earth=self._sky.earth, refraction=air)
        return ElementsTarget(propagator, self.bias)

    def path(self, target: SkyTarget, near_deg: float = 0.0) -> SkyPath:
        """Return the path of a target, turns of the first axis counted from near a place."""
        return SkyPath(target, self.reduction, near_deg)

    def pointed_at(self, axes: AxisState, utc_s: float) -> tuple[float, float, float, float]:
        """Return where axes point: right ascension and declination of date, azimuth, elevation, degrees."""
        sky = self._sky
        if self.reduction.axes == "azel":
            seen = AzEl(axes.first_deg, axes.second_deg)
            place = sky.equatorial(seen, utc_s)
        else:
            place = self.reduction.model.inverse(HaDec(axes.first_deg, axes.second_deg))
            seen = sky.horizontal(place, utc_s)
        return (sky.sidereal_deg(utc_s) - place.ha_deg) % 360.0, place.dec_deg, seen.az_deg, seen.el_deg


def _check_line(line: int, number: int, text: str) -> None:
    if not text.startswith(f"{line} "):
        raise StoreError(Nak.ELEMENTS_LINE)
    if parse_alpha5(text[2:7].replace(" ", "0")) != number:
        raise StoreError(Nak.ELEMENTS_NUMBER)
    if len(text) != LINE_LENGTH or text[-1] != str(checksum(text)):
        raise StoreError(Nak.ELEMENTS_CHECK)


def _floats(v: tuple[Any, Any, Any]) -> Triple:
    return float(v[0]), float(v[1]), float(v[2])


def _dot(a: Triple, b: Triple) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
