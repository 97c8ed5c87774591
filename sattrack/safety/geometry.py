"""How axes stand and where they point, and bounds over whole boxes of axis angles. Degrees.

Axes stand at 0 on the meridian and the equator; the hour angle axis turns west, and a declination axis
beyond 90° either way points past a pole. All rules for a direction hold there too. A box is what
lies between two angles of either axis: a way between two places lies in it with any timing of the axes.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from sattrack.core.angles import wrap180
from sattrack.mount.model import SIDEREAL_RATE_DEG_S

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from sattrack.mount.model import MoveAxes, Stance

    Array = NDArray[np.float64]
    Bools = NDArray[np.bool_]
    Sides = tuple[float, float, float, float] | tuple[Array, Array, Array, Array]

TURN_DEG = 360.0
TWO_PI = 2.0 * math.pi


class Place(NamedTuple):
    """How the axes stand: hour angle with turns counted, declination axis; degrees."""

    ha_deg: float
    dec_deg: float


class Circle(NamedTuple):
    """A circle on the sky: its middle as a unit vector (meridian on the equator, west, pole), its radius."""

    x: float
    y: float
    z: float
    radius_deg: float


class Box(NamedTuple):
    """All axis angles between a least and a most one of either axis, degrees."""

    ha_low_deg: float
    ha_high_deg: float
    dec_low_deg: float
    dec_high_deg: float

    @property
    def circle(self) -> Circle:
        """A circle that holds everything in the box, about its middle."""
        ha = math.radians(0.5 * (self.ha_low_deg + self.ha_high_deg))
        dec = math.radians(0.5 * (self.dec_low_deg + self.dec_high_deg))
        cos_dec = math.cos(dec)
        half_dec = math.radians(0.5 * (self.dec_high_deg - self.dec_low_deg))
        half_ha = min(math.pi, math.radians(0.5 * (self.ha_high_deg - self.ha_low_deg)))
        # The haversine of the farthest corner, with the largest cosine of declination that the box can have.
        widest = min(1.0, abs(cos_dec) + math.sin(min(0.5 * math.pi, half_dec)))
        chord2 = math.sin(min(math.pi, half_dec) / 2.0) ** 2
        chord2 += abs(cos_dec) * widest * math.sin(half_ha / 2.0) ** 2
        radius = 2.0 * math.degrees(math.asin(min(1.0, math.sqrt(chord2))))
        return Circle(cos_dec * math.cos(ha), cos_dec * math.sin(ha), math.sin(dec), radius)

    @classmethod
    def between(cls, one: tuple[float, float], other: tuple[float, float]) -> Box:
        """Return the box between two places of the axes, hour angle and declination."""
        return cls(min(one[0], other[0]), max(one[0], other[0]), min(one[1], other[1]), max(one[1], other[1]))

    @property
    def middle(self) -> Box:
        """The middle as a box of no size."""
        ha = 0.5 * (self.ha_low_deg + self.ha_high_deg)
        dec = 0.5 * (self.dec_low_deg + self.dec_high_deg)
        return Box(ha, ha, dec, dec)

    @property
    def widest_deg(self) -> float:
        """The longer side."""
        return max(self.ha_high_deg - self.ha_low_deg, self.dec_high_deg - self.dec_low_deg)

    def grown(self, ha_low: float, ha_high: float, dec_low: float, dec_high: float) -> Box:
        """Return the box with each of its sides moved out by so much."""
        return Box(
            self.ha_low_deg - ha_low,
            self.ha_high_deg + ha_high,
            self.dec_low_deg - dec_low,
            self.dec_high_deg + dec_high,
        )

    def holds(self, place: tuple[float, float]) -> bool:
        """Tell whether a place of the axes lies in the box."""
        ha_deg, dec_deg = place
        return (
            self.ha_low_deg <= ha_deg <= self.ha_high_deg and self.dec_low_deg <= dec_deg <= self.dec_high_deg
        )

    def with_box(self, other: Box) -> Box:
        """Return the least box that holds this one and another."""
        return Box(
            min(self.ha_low_deg, other.ha_low_deg),
            max(self.ha_high_deg, other.ha_high_deg),
            min(self.dec_low_deg, other.dec_low_deg),
            max(self.dec_high_deg, other.dec_high_deg),
        )

    def halves(self) -> tuple[Box, Box]:
        """Return both halves along the longer side."""
        if self.ha_high_deg - self.ha_low_deg >= self.dec_high_deg - self.dec_low_deg:
            ha = 0.5 * (self.ha_low_deg + self.ha_high_deg)
            return (
                Box(self.ha_low_deg, ha, self.dec_low_deg, self.dec_high_deg),
                Box(ha, self.ha_high_deg, self.dec_low_deg, self.dec_high_deg),
            )
        dec = 0.5 * (self.dec_low_deg + self.dec_high_deg)
        return (
            Box(self.ha_low_deg, self.ha_high_deg, self.dec_low_deg, dec),
            Box(self.ha_low_deg, self.ha_high_deg, dec, self.dec_high_deg),
        )


def nearest_deg(box: Box, hour_angle_deg: float, dec_deg: float) -> float:
    """Return the least great-circle angle between a direction and anything in a box, degrees; exact."""
    return Toward(hour_angle_deg, dec_deg).nearest_deg(box)


class Toward:
    """A direction from which one box after another is looked at."""

    def __init__(self, hour_angle_deg: float, dec_deg: float) -> None:
        self._hour_angle_deg = hour_angle_deg
        dec = math.radians(dec_deg)
        self._sine, self._cosine = math.sin(dec), math.cos(dec)

    def nearest_deg(self, box: Box) -> float:
        """Return the least great-circle angle between the direction and anything in a box, degrees; exact.

        Its cosine is linear in that of the hour angle between them, at any declination, and a sine of the
        declination with a phase, at any hour angle: largest at an end of either, or on the sine's crest.
        """
        ha_low, ha_high, dec_low, dec_high = box
        low, high = ha_low - self._hour_angle_deg, ha_high - self._hour_angle_deg
        sine, cosine = self._sine, self._cosine
        first, last = math.cos(math.radians(low)), math.cos(math.radians(high))
        over = TURN_DEG * math.ceil(low / TURN_DEG) <= high
        most = 1.0 if over else max(first, last)
        largest = _largest_cosine(sine, cosine * most, dec_low, dec_high)
        if dec_low < -90.0 or dec_high > 90.0:
            # Past a pole, it is the least cosine of the hour angle that leads there.
            half = 0.5 * TURN_DEG
            turned = half + TURN_DEG * math.ceil((low - half) / TURN_DEG) <= high
            least = -1.0 if turned else min(first, last)
            largest = max(largest, _largest_cosine(sine, cosine * least, dec_low, dec_high))
        if largest >= 1.0:
            return 0.0
        return math.degrees(math.acos(largest)) if largest > -1.0 else 180.0

    def apart_deg(self, places: Array) -> Array:
        """Return the great-circle angle between the direction and each of many places, rows of two angles."""
        ha, dec = np.radians(places).T
        cosines = self._cosine * np.cos(dec) * np.cos(ha - math.radians(self._hour_angle_deg))
        apart: Array = np.degrees(np.arccos(np.clip(cosines + self._sine * np.sin(dec), -1.0, 1.0)))
        return apart


def _largest_cosine(sine: float, across: float, low_deg: float, high_deg: float) -> float:
    """Return the largest of sine * sin(d) + across * cos(d) for d from a least to a most angle, degrees."""
    low, high = math.radians(low_deg), math.radians(high_deg)
    crest = math.atan2(sine, across)
    crest += TWO_PI * math.ceil((low - crest) / TWO_PI)
    if crest <= high:
        return math.hypot(sine, across)
    first = sine * math.sin(low) + across * math.cos(low)
    last = sine * math.sin(high) + across * math.cos(high)
    return first if first > last else last


def lowest_altitude_deg(box: Box, latitude_deg: float) -> float:
    """Return the least altitude of anything in a box, degrees: how far it keeps from the nadir."""
    return nearest_deg(box, 180.0, -latitude_deg) - 90.0


def meets_polygon(sides: Sides, corners: tuple[tuple[float, float], ...]) -> bool | Bools:
    """Tell whether a box and a polygon of hour angles and declinations have a point in common.

    They have where a line of the polygon passes between corners of the box, or the box lies inside. The sides
    may be those of many boxes.
    """
    left, right, low, high = sides
    met: bool | Bools = False
    inside: bool | Bools = False
    for (x1, y1), (x2, y2) in zip(corners, (*corners[1:], corners[0]), strict=True):
        dx, dy = x2 - x1, y2 - y1
        x, far_x = (left, right) if dy > 0.0 else (right, left)
        y, far_y = (high, low) if dx > 0.0 else (low, high)
        about = (left <= max(x1, x2)) & (right >= min(x1, x2)) & (low <= max(y1, y2)) & (high >= min(y1, y2))
        met |= about & (dy * (x - x1) <= dx * (y - y1)) & (dy * (far_x - x1) >= dx * (far_y - y1))
        if dy:
            inside ^= ((y1 > low) != (y2 > low)) & (left < x1 + (low - y1) / dy * dx)
    return met | inside


FOLLOWED_WITHIN_DEG = 1.5
"""So near to where the sky has led it, an axis has followed it: clocks may differ by minutes."""


class AxesState:
    """Follows one mount's axes; turns are taken to begin within half a turn of `middle_deg`, or as told."""

    def __init__(self, latitude_deg: float, middle_deg: float = 0.0) -> None:
        self._latitude_deg, self._middle_deg = latitude_deg, middle_deg
        self.hour_angle_deg: float | None = None
        """The hour angle axis' angle, turns counted; None before the first status."""
        self.beyond_pole = False
        self._anchor_deg: float | None = None
        """Where the axis stood before the first status, where that is known."""
        self._expected_deg: float | None = None
        """Where it is if it has followed the sky since a session before; None once a place is taken."""

    def begin_anew(self) -> None:
        """Forget how the first status had the axis stand."""
        self.hour_angle_deg = self._anchor_deg

    def begin_at(self, first_axis_deg: float) -> None:
        """Take where a session before left the first axis, turns counted, until the first status."""
        if self.hour_angle_deg is None:
            self.hour_angle_deg = self._anchor_deg = first_axis_deg

    def expect_at(self, first_axis_deg: float) -> None:
        """Take where the first axis is, turns counted, if it has followed the sky since a session before.

        The first status decides: whatever stopped the mount meanwhile, its own limits or a person, leaves it
        elsewhere.
        """
        if self.hour_angle_deg is None and self._expected_deg is None:
            self._expected_deg = first_axis_deg

    def follow_on(self, former: AxesState) -> None:
        """Take over how far the cables are wound."""
        self.hour_angle_deg, self.beyond_pole = former.hour_angle_deg, former.beyond_pole
        self._anchor_deg = former.hour_angle_deg

    def take(self, place: Place, beyond_pole: bool) -> None:
        """Take a place for where the axes stand."""
        if self._is_expected(place.ha_deg):
            self._anchor_deg = self._expected_deg
        self._expected_deg = None
        self.hour_angle_deg, self.beyond_pole = place.ha_deg, beyond_pole

    def place(self, hour_angle_deg: float, dec_deg: float, beyond_pole: bool) -> Place:
        """Return the axes' angles that go with a reported direction, the hour angle on the nearest turn.

        Beyond the pole the hour angle axis stands half a turn from the reported hour angle.
        """
        before = self._middle_deg if self.hour_angle_deg is None else self.hour_angle_deg
        axis_deg = hour_angle_deg + (180.0 if beyond_pole else 0.0)
        if self.hour_angle_deg is None and self._is_expected(axis_deg):
            before = self._expected_deg or 0.0
        dec_axis_deg = math.copysign(180.0, self._latitude_deg) - dec_deg if beyond_pole else dec_deg
        return Place(before + wrap180(axis_deg - before), dec_axis_deg)

    def _is_expected(self, axis_deg: float) -> bool:
        expected_deg = self._expected_deg
        return expected_deg is not None and abs(wrap180(axis_deg - expected_deg)) <= FOLLOWED_WITHIN_DEG

    def of(self, stance: Stance) -> Place:
        """Return the axes' angles as a mount stands."""
        return self.place(stance.sidereal_deg - stance.ra_deg, stance.dec_deg, stance.beyond_pole)


def stance_at(stance: Stance, place: Place) -> Stance:
    """Return how a mount would stand with its axes at another place."""
    ha, dec = place.ha_deg, math.remainder(place.dec_deg, 360.0)
    beyond_pole = abs(dec) > 90.0
    if beyond_pole:
        ha, dec = ha - 180.0, math.copysign(180.0, dec) - dec
    return stance._replace(ra_deg=stance.sidereal_deg - ha, dec_deg=dec, beyond_pole=beyond_pole)


def axis_rates(move: MoveAxes, beyond_pole: bool) -> tuple[float, float]:
    """Return the rates of the axes, hour angle and declination, that go with reported ones."""
    sense = -1.0 if beyond_pole else 1.0
    return SIDEREAL_RATE_DEG_S - move.ra_rate_deg_s, sense * move.dec_rate_deg_s
