"""Where axes may not be, and whether a whole box is clear of it: travel, floor, skyline, pier, Sun.

Each region bounds from below by how many degrees anything in a box is clear of it. All but the skyline know
it exactly; a box for which the skyline's bound is not enough is halved until it is, or until some of it is
found inside.
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections import deque
from functools import partial
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np

from sattrack.core.angles import azimuth_deg
from sattrack.safety.geometry import TURN_DEG, Box, Toward, lowest_altitude_deg, meets_polygon

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from sattrack.mount.model import MountProfile, PierZone
    from sattrack.safety.bodies import BodyDirection
    from sattrack.safety.geometry import Array, Bools
    from sattrack.safety.limits import HorizonPoint, SafetyLimits

SMALLEST_DEG = 0.05
MOST_BOXES = 4000
"""A box that takes more halvings than this to be judged counts as not clear."""
MOST_STRUCK = 16
"""So many places in a skyline are remembered: a box that holds one need not be halved."""
FAR_DEG = 2.0
"""More than any margin: so far above all of a skyline, how far above its nearest part need not be known."""


class Clearance(NamedTuple):
    """How far a box is clear of a region, degrees: a lower bound for all of it, and that of some place in it.

    They are the same where it is known exactly, and for a single place.
    """

    least_deg: float
    some_deg: float


class Region(Protocol):
    """A part of axis space that is forbidden."""

    @property
    def name(self) -> str:
        """The row of the table that it stands for."""

    def clearance(self, box: Box) -> Clearance:
        """Return how far a box is clear of it."""

    def clearances(self, places: Array) -> Array:
        """Return how far many places, rows of two angles, are clear of it; NaN where that is not known."""


class Travel:
    """Angles of one axis outside its travel."""

    def __init__(self, name: str, low_deg: float, high_deg: float) -> None:
        self.name = name
        self._low_deg, self._high_deg = low_deg, high_deg

    def clearance(self, box: Box) -> Clearance:
        """See Region."""
        if self.name == "hour_angle":
            low, high = box.ha_low_deg, box.ha_high_deg
        else:
            low, high = box.dec_low_deg, box.dec_high_deg
        clear = min(low - self._low_deg, self._high_deg - high)
        return Clearance(clear, clear)

    def clearances(self, places: Array) -> Array:
        """See Region."""
        angles = places[:, 0 if self.name == "hour_angle" else 1]
        return np.minimum(angles - self._low_deg, self._high_deg - angles)

    def is_clear(self, box: Box, margin_deg: float) -> bool:
        """See `is_clear`."""
        return self.clearance(box).least_deg >= margin_deg


class Around:
    """Directions within a circle about one."""

    def __init__(self, name: str, toward: Toward, radius_deg: float) -> None:
        self.name = name
        self._toward, self._radius_deg = toward, radius_deg

    def clearance(self, box: Box) -> Clearance:
        """See Region."""
        clear = self._toward.nearest_deg(box) - self._radius_deg
        return Clearance(clear, clear)

    def clearances(self, places: Array) -> Array:
        """See Region."""
        return self._toward.apart_deg(places) - self._radius_deg

    def is_clear(self, box: Box, margin_deg: float) -> bool:
        """See `is_clear`."""
        return self._toward.nearest_deg(box) - self._radius_deg >= margin_deg


class Floor(Around):
    """Directions below an altitude."""

    def __init__(self, floor_deg: float, latitude_deg: float) -> None:
        super().__init__("altitude", Toward(180.0, -latitude_deg), 90.0 + floor_deg)


STRUCK, APART = Clearance(-1.0, -1.0), Clearance(2.0, 2.0)
BESIDE_DEG = 0.09
"""Less than what is held before any limit: all of a zone's margin counts as that."""
PIER_HALVINGS = 6


class Skyline:
    """Directions below a horizon of points, straight between them.

    The tube may point up to `beside_deg` away from where the angles of the axes say, to any side.
    """

    name = "horizon"

    def __init__(self, points: Sequence[HorizonPoint], latitude_deg: float, beside_deg: float = 0.0) -> None:
        self._latitude_deg, self._beside_deg = latitude_deg, beside_deg
        self._sine, self._cosine = math.sin(math.radians(latitude_deg)), math.cos(math.radians(latitude_deg))
        self._points = [
            (azimuth + turn, altitude) for turn in (-TURN_DEG, 0.0, TURN_DEG) for azimuth, altitude in points
        ]
        self._azimuths = [azimuth for azimuth, _ in self._points]
        self._altitudes = [altitude for _, altitude in self._points]
        self._highest_deg = max(altitude for _, altitude in points)
        self.struck: deque[tuple[tuple[float, ...], float]] = deque(maxlen=MOST_STRUCK)
        """Places that were found too near lately, and how far they are clear."""

    def clearance(self, box: Box) -> Clearance:
        """See Region."""
        lowest = lowest_altitude_deg(box, self._latitude_deg) - self._beside_deg
        above = lowest - self._highest_deg
        if above >= FAR_DEG:
            return Clearance(above, above)
        circle = box.circle
        sine = self._cosine * circle.x + self._sine * circle.z
        altitude = math.degrees(math.asin(max(-1.0, min(1.0, sine))))
        middle = box.middle
        azimuth = azimuth_deg(middle.ha_low_deg, middle.dec_low_deg, self._latitude_deg)
        beside = self._beside_deg
        own = altitude - beside - self._highest_within(azimuth, altitude, beside)
        if not circle.radius_deg:
            return Clearance(own, own)
        highest = self._highest_within(azimuth, altitude, circle.radius_deg + beside)
        return Clearance(lowest - highest, own)

    def clearances(self, places: Array) -> Array:
        """See Region; not known at a wall and the zenith, nor, of a tube that leans, near a skyline."""
        ha, dec = np.radians(places).T
        north = self._cosine * np.sin(dec) - self._sine * np.cos(dec) * np.cos(ha)
        azimuth = np.degrees(np.arctan2(-np.cos(dec) * np.sin(ha), north)) % TURN_DEG
        above = Toward(180.0, -self._latitude_deg).apart_deg(places) - 90.0 - self._beside_deg
        clear, other = (
            above - np.interp(azimuth + by, self._azimuths, self._altitudes) for by in (-1e-9, 1e-9)
        )
        known = (above < 89.0) & (np.abs(clear - other) < NO_MORE_DEG)
        known &= (clear < 0.0) | (self._beside_deg == 0.0)
        above -= self._highest_deg
        return np.where(above >= FAR_DEG, above, np.where(known, clear, np.nan))

    def _highest_within(self, azimuth: float, altitude: float, radius_deg: float) -> float:
        """Return the highest of the skyline in the azimuths that a circle on the sky covers."""
        if not radius_deg:
            return self._altitude_deg(azimuth)
        if abs(altitude) + radius_deg >= 89.9:
            return self._highest_deg
        spread = math.degrees(
            math.asin(min(1.0, math.sin(math.radians(radius_deg)) / math.cos(math.radians(altitude))))
        )
        first, last = azimuth - spread, azimuth + spread
        between = self._altitudes[bisect_left(self._azimuths, first) : bisect_right(self._azimuths, last)]
        return max(self._altitude_deg(first), self._altitude_deg(last), *between)

    def _altitude_deg(self, azimuth: float) -> float:
        """Return the altitude of the skyline at an azimuth, the highest one at a wall."""
        azimuth %= TURN_DEG
        first, last = bisect_left(self._azimuths, azimuth), bisect_right(self._azimuths, azimuth)
        if first != last:
            return max(altitude for _, altitude in self._points[first:last])
        (z1, a1), (z2, a2) = self._points[first - 1], self._points[first]
        return a1 + (a2 - a1) * (azimuth - z1) / (z2 - z1)


class PierCollision:
    """A zone of the profile, in the axes' own angles; hour angles are the same after a turn."""

    name = "pier"

    def __init__(self, zone: PierZone, margin_deg: float) -> None:
        self._margin_deg = margin_deg
        # Box angles are taken to within a turn of the first corner's, so that of it three stand near.
        self._polygons = [
            (corners[0], [_Polygon(_moved(corners, k)) for k in (-1, 0, 1)])
            for corners in _axis_polygons(zone)
        ]

    def clearance(self, box: Box) -> Clearance:
        """See Region: whether the zone is met, what is left of its margin, or all of it."""
        m = self._margin_deg
        if not self._meets(box.grown(m, m, m, m)):
            return APART
        if self._meets(box):
            return STRUCK
        clear, met = 0.0, m
        for _ in range(PIER_HALVINGS):
            middle = 0.5 * (clear + met)
            if self._meets(box.grown(middle, middle, middle, middle)):
                met = middle
            else:
                clear = middle
        left = BESIDE_DEG * clear / m
        return Clearance(left, left)

    def clearances(self, places: Array) -> Array:
        """See Region: what counts is whether the margin is left."""
        met, m = np.zeros(len(places), dtype=bool), self._margin_deg
        for first, polygons in self._polygons:
            ha, dec = (places + TURN_DEG * np.round((np.array(first) - places) / TURN_DEG)).T
            for polygon in polygons:
                met |= meets_polygon((ha - m, ha + m, dec - m, dec + m), polygon.corners)
        return np.where(met, STRUCK.least_deg, APART.least_deg)

    def is_clear(self, box: Box, margin_deg: float) -> bool:
        """See `is_clear`; what `clearance` tells of a margin, without looking for how much is left of it."""
        if margin_deg <= STRUCK.least_deg:
            return True
        share = 1.0 if margin_deg > BESIDE_DEG else max(0.0, margin_deg / BESIDE_DEG)
        m = share * self._margin_deg
        return margin_deg <= APART.least_deg and not self._meets(box.grown(m, m, m, m))

    def _meets(self, box: Box) -> bool:
        for first, polygons in self._polygons:
            if not polygons[0].is_turns_off(box):
                near = _turned(box, first)
                if any(polygon.meets(near) for polygon in polygons):
                    return True
        return False


class _Polygon:
    """Corners of hour angle and declination, and the box about them: what does not meet that is apart."""

    def __init__(self, corners: tuple[tuple[float, float], ...]) -> None:
        self.corners = corners
        self._left, self._right = min(x for x, _ in corners), max(x for x, _ in corners)
        self._low, self._high = min(y for _, y in corners), max(y for _, y in corners)

    def is_turns_off(self, box: Box) -> bool:
        """Tell whether the box about the corners is apart from another by any number of turns."""
        left, right, low, high = box
        ha = math.remainder(left + right - self._left - self._right, 2.0 * TURN_DEG)
        dec = math.remainder(low + high - self._low - self._high, 2.0 * TURN_DEG)
        wide, tall = right - left + self._right - self._left, high - low + self._high - self._low
        return abs(ha) > wide + NO_MORE_DEG or abs(dec) > tall + NO_MORE_DEG

    def meets(self, box: Box) -> bool:
        left, right, low, high = box
        if left > self._right or right < self._left or low > self._high or high < self._low:
            return False
        return bool(meets_polygon(box, self.corners))


class Cone(Around):
    """Directions within a cone about the Sun or the Moon, as it stands at one instant."""

    def __init__(self, name: str, body: BodyDirection, cone_deg: float) -> None:
        super().__init__(name, Toward(body.hour_angle_deg, body.dec_deg), cone_deg)
        self.body, self.cone_deg = body, cone_deg


def fixed_regions(
    profile: MountProfile, limits: SafetyLimits, latitude_deg: float, pier_margin_deg: float
) -> list[Region]:
    """Return all regions that stay where they are; the latitude is `Bounds.horizon_latitude_deg`.

    Axes that are not square, and a tube that leans, point elsewhere than their angles say by no more than
    both together: so much wider are the limits of the sky.
    """
    limit, geometry = profile.hour_angle_limit_deg, profile.geometry
    loose_deg = 0.0 if geometry is None else geometry.off_square_deg
    horizon = [*limits.horizon]
    if geometry is not None:
        horizon = _turned_horizon(horizon, geometry.pole_azimuth_deg)
    regions: list[Region] = [
        Travel("hour_angle", -limit, limit),
        Travel("declination", *profile.dec_axis_limits_deg),
        Floor(limits.floor_altitude_deg + loose_deg, latitude_deg),
    ]
    if horizon:
        regions.append(Skyline(horizon, latitude_deg, loose_deg))
    regions.extend(PierCollision(zone, pier_margin_deg) for zone in profile.pier_zones)
    return regions


def _turned_horizon(points: list[HorizonPoint], by_deg: float) -> list[HorizonPoint]:
    """Return a skyline by azimuths from another zero, in order; walls keep the order of their two points."""
    if not by_deg % TURN_DEG:
        return points
    turned = [
        ((azimuth - by_deg) % TURN_DEG, azimuth < by_deg % TURN_DEG, altitude) for azimuth, altitude in points
    ]
    return [(azimuth, altitude) for azimuth, _, altitude in sorted(turned, key=lambda one: one[:2])]


def judge_of(region: Region) -> Callable[[Box, float], bool]:
    """Return what tells of boxes and margins what `is_clear` does of a region."""
    return region.is_clear if isinstance(region, EXACT) else partial(is_clear, region)


EXACT = (Travel, Floor, PierCollision, Cone)
"""Regions that know exactly how far a box is clear of them."""


def is_clear(region: Region, box: Box, margin_deg: float) -> bool:
    """Tell whether everything in a box is clear of a region by a margin; doubtful boxes are not."""
    if isinstance(region, EXACT):
        return region.is_clear(box, margin_deg)
    struck = region.struck if isinstance(region, Skyline) else []
    ha_low, ha_high, dec_low, dec_high = box
    for (ha, dec), some_deg in struck:
        if some_deg < margin_deg and ha_low <= ha <= ha_high and dec_low <= dec <= dec_high:
            return False
    waiting = [box]
    for _ in range(MOST_BOXES + 5):
        part = waiting.pop()
        clearance = region.clearance(part)
        if clearance.least_deg < margin_deg:
            if clearance.some_deg < margin_deg:
                struck.append((part.middle[::2], clearance.some_deg))
                return False
            if part.widest_deg < SMALLEST_DEG:
                return False
            waiting.extend(part.halves())
            if part is box:
                waiting.extend(_smallest_at_corners(box))
        if not waiting:
            return True
    return False


def _smallest_at_corners(box: Box) -> Iterator[Box]:
    """Yield the last parts that halving leads to at a box's corners: a way is in doubt at its ends first."""
    ha_low, ha_high, dec_low, dec_high = box
    wide, high = ha_high - ha_low, dec_high - dec_low
    while max(wide, high) >= SMALLEST_DEG:
        wide, high = (0.5 * wide, high) if wide >= high else (wide, 0.5 * high)
    for ha in (ha_low, ha_high - wide):
        for dec in (dec_low, dec_high - high):
            yield Box(ha, ha + wide, dec, dec + high)


NO_MORE_DEG = 1e-7
"""More than rounding may come to."""


def closed_places(regions: Sequence[Region], places: Array, margin_deg: float) -> Bools:
    """Tell of each of many places, rows of two angles, whether a region is nearer than a margin.

    Where rounding decides, or nothing is known, a place is judged by itself.
    """
    closed = np.zeros(len(places), dtype=bool)
    for region in regions:
        left = np.flatnonzero(~closed)
        off = region.clearances(places[left]) - margin_deg
        closed[left] = off < 0.0
        for k in left[~(np.abs(off) > NO_MORE_DEG)].tolist():
            ha, dec = places[k].tolist()
            closed[k] = not is_clear(region, Box(ha, ha, dec, dec), margin_deg)
    return closed


def _axis_polygons(zone: PierZone) -> Iterator[tuple[tuple[float, float], ...]]:
    if zone.side != "beyond_pole":
        yield zone.corners
    if zone.side != "normal":
        yield tuple((ha + 180.0, 180.0 - dec) for ha, dec in zone.corners)


def _turned(box: Box, corner: tuple[float, float]) -> Box:
    """Return the same axis angles within a turn of a corner's, both axes."""
    ha = TURN_DEG * round((corner[0] - 0.5 * (box.ha_low_deg + box.ha_high_deg)) / TURN_DEG)
    dec = TURN_DEG * round((corner[1] - 0.5 * (box.dec_low_deg + box.dec_high_deg)) / TURN_DEG)
    return box.grown(-ha, ha, -dec, dec)


def _moved(corners: tuple[tuple[float, float], ...], turns: int) -> tuple[tuple[float, float], ...]:
    return tuple((ha + turns * TURN_DEG, dec) for ha, dec in corners)
