"""What the controller reduces by itself: sources, satellites by their elements, offsets, the pointing model.

"Ideal Field System Antenna Interface", sections 7.0 and 8.0. The reduction: the place of date (for J2000 by
precession, nutation and aberration; for satellites by SGP4), plus the offsets in right ascension and
declination; the hour angle by local apparent sidereal time, plus the offsets in hour angle and declination;
azimuth and elevation, plus theirs; for equatorial axes the pointing model at last.

Elements come a line or a value at a time, and are checked as they come. The checks of lines are those of the
Field System's `tle` command: the line's number, the catalogue number, the check-sum.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Protocol

from sattrack.servers.antenna.sky import AxisKind, AzEl, HaDec, RaDec, Sky
from sattrack.servers.antenna.trajectory import NS, AxisState
from sattrack.servers.antenna.transactions import Nak
from tle.bias import NO_BIAS, Bias
from tle.elements import Elements, parse_alpha5
from tle.errors import ElementsError, FieldRangeError, MissingFieldError
from tle.formats.omm import KEYWORDS, TextPlace, elements_of
from tle.formats.tle import checksum, parse_set
from tle.instants import Utc
from tle.propagator import Propagator
from tle.refraction import Refraction

if TYPE_CHECKING:
    from sattrack.servers.antenna.transactions import Request

DIFFERENCE_NS = 50_000_000
"""Half of the interval over which rates are taken as differences of positions."""
INVERSE_ROUNDS = 8
HARMLESS = {
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
"""Values that are well formed: among them, one that came is read by itself."""
LINE_LENGTH = 69
NAME_LENGTH = 24
MODEL_TERMS = ("ih", "id", "ch", "np", "ma", "me")


class SkyTarget(Protocol):
    """Something in the sky."""

    def place(self, utc_s: float) -> RaDec:
        """Return its topocentric right ascension and declination of date, degrees."""


@dataclass(frozen=True, slots=True)
class OfDate:
    """A source by topocentric coordinates of date."""

    coordinates: RaDec

    def place(self, utc_s: float) -> RaDec:
        """Return them."""
        del utc_s
        return self.coordinates


@dataclass(frozen=True, slots=True)
class Mean:
    """A source by mean coordinates of J2000 (ICRS)."""

    coordinates: RaDec
    sky: Sky

    def place(self, utc_s: float) -> RaDec:
        """Return its apparent place."""
        return self.sky.of_date(self.coordinates, utc_s)


@dataclass(frozen=True, slots=True)
class Satellite:
    """A satellite by its elements, with biases along and across its track."""

    propagator: Propagator
    bias: Bias

    def place(self, utc_s: float) -> RaDec:
        """Return where it is seen. Raises PropagationError where its elements end."""
        seen = self.propagator.at(Utc(utc_s), self.bias)
        return RaDec(float(seen.ra_deg), float(seen.dec_deg))


@dataclass(frozen=True, slots=True)
class PointingModel:
    """Corrections of equatorial axes, degrees, added to hour angle and declination to give axis positions.

    ΔHA = ih + ch/cos δ + np·tan δ - ma·cos h·tan δ + me·sin h·tan δ; ΔDec = id + ma·sin h + me·cos h.
    """

    ih: float = 0.0
    id: float = 0.0
    ch: float = 0.0
    np: float = 0.0
    ma: float = 0.0
    me: float = 0.0

    def correction(self, place: HaDec) -> HaDec:
        """Return what is added at a direction; within 0.1° of the pole as it is there."""
        h = math.radians(place.ha_deg)
        d = math.radians(max(-89.9, min(89.9, place.dec_deg)))
        tan, sec = math.tan(d), 1.0 / math.cos(d)
        turn = self.ih + self.ch * sec + self.np * tan
        turn += (self.me * math.sin(h) - self.ma * math.cos(h)) * tan
        return HaDec(turn, self.id + self.ma * math.sin(h) + self.me * math.cos(h))

    def axes(self, place: HaDec) -> HaDec:
        """Return the axes' positions for a direction."""
        added = self.correction(place)
        return HaDec(place.ha_deg + added.ha_deg, place.dec_deg + added.dec_deg)

    def inverse(self, axes: HaDec) -> HaDec:
        """Return the direction that axes' positions point at: `axes` turned round, by iteration."""
        place = axes
        for _ in range(INVERSE_ROUNDS):
            added = self.correction(place)
            place = HaDec(axes.ha_deg - added.ha_deg, axes.dec_deg - added.dec_deg)
        return place


NO_OFFSET = (0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Reduction:
    """From a place of date to the antenna's axes."""

    sky: Sky
    axes: AxisKind
    radec: tuple[float, float] = NO_OFFSET
    hadec: tuple[float, float] = NO_OFFSET
    azel: tuple[float, float] = NO_OFFSET
    model: PointingModel = field(default_factory=PointingModel)

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
    """The way of a target as the axes follow it, turns of the first axis counted from `near_deg` on."""

    def __init__(self, target: SkyTarget, reduction: Reduction, near_deg: float) -> None:
        self.target = target
        self._reduction = reduction
        self._last_deg = near_deg

    def at(self, utc_ns: int) -> AxisState:
        """Return where the axes must be at an instant."""
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
        """Count so many turns of the first axis more."""
        self._last_deg += 360.0 * turns

    def reduced_by(self, reduction: Reduction) -> SkyPath:
        """Return the same target's way by another reduction."""
        return SkyPath(self.target, reduction, self._last_deg)

    def _place(self, utc_ns: int) -> tuple[float, float]:
        utc_s = utc_ns / NS
        return self._reduction.positions(self.target.place(utc_s), utc_s)


class StoreError(Exception):
    """Elements that cannot be taken, or are not there; `why` is the number of the refusal."""

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
        """Take a name (line 0) or an element line (1 or 2). Raises StoreError; what was there stays."""
        if line == 0:
            if len(text) > NAME_LENGTH:
                raise StoreError(Nak.RANGE)
        else:
            _check_line(line, number, text)
        self._begin(number, self._values)
        self._lines[line] = text

    def take_value(self, number: int, keyword: str, value: str) -> None:
        """Take the value of one OMM keyword. Raises StoreError; what was there stays."""
        if keyword not in KEYWORDS:
            raise StoreError(Nak.VALUE)
        if keyword == "NORAD_CAT_ID" and value != str(number):
            raise StoreError(Nak.ELEMENTS_NUMBER)
        try:
            elements_of(HARMLESS | {keyword: value}, TextPlace())
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


def _check_line(line: int, number: int, text: str) -> None:
    if not text.startswith(f"{line} "):
        raise StoreError(Nak.ELEMENTS_LINE)
    if parse_alpha5(text[2:7].replace(" ", "0")) != number:
        raise StoreError(Nak.ELEMENTS_NUMBER)
    if len(text) != LINE_LENGTH or text[-1] != str(checksum(text)):
        raise StoreError(Nak.ELEMENTS_CHECK)


class Reckoning:
    """What has been sent of it so far, for one antenna."""

    def __init__(self, sky: Sky, axes: AxisKind) -> None:
        self.reduction = Reduction(sky, axes)
        self.elements = ElementStore()
        self.bias: Bias = NO_BIAS
        self.hold = False
        """Whether satellites are stood at, not tracked."""
        self._sky = sky

    def offset(self, request: Request) -> None:
        """Take the offsets of one kind."""
        pair = (request.number("first"), request.number("second"))
        match request.text("kind"):
            case "RADEC":
                self.reduction = replace(self.reduction, radec=pair)
            case "HADEC":
                self.reduction = replace(self.reduction, hadec=pair)
            case _:
                self.reduction = replace(self.reduction, azel=pair)

    def model(self, request: Request) -> None:
        """Take a pointing model."""
        model = PointingModel(*(request.number(term) for term in MODEL_TERMS))
        self.reduction = replace(self.reduction, model=model)

    def source(self, request: Request) -> SkyTarget:
        """Return the source that a command names."""
        coordinates = RaDec(request.number("ra"), request.number("dec"))
        return OfDate(coordinates) if request.text("frame") == "DATE" else Mean(coordinates, self._sky)

    def satellite(self, number: int, refracted: bool) -> Satellite:
        """Return the satellite whose elements were sent. Raises StoreError or TleError."""
        site = self._sky.site
        air = Refraction.standard(site.height_m) if refracted else None
        propagator = Propagator(self.elements.elements(number), site, earth=self._sky.earth, refraction=air)
        return Satellite(propagator, self.bias)

    def path(self, target: SkyTarget, near_deg: float = 0.0) -> SkyPath:
        """Return the way of a target, turns of the first axis counted from near a place."""
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
