"""All regions of one mount at one site at one instant, and the margins by which they are kept.

A box of axis angles found clear of regions: what lies within it need not be judged again.

A stream of rates is judged many times a second, in nearly the same place.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from sattrack.core.angles import altitude_deg
from sattrack.mount.model import SIDEREAL_RATE_DEG_S, horizon_latitude_deg
from sattrack.safety.geometry import Box
from sattrack.safety.regions import Cone, Region, Travel, closed_places, fixed_regions, is_clear, judge_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from sattrack.mount.geometry import AxisFrame
    from sattrack.mount.model import MountProfile
    from sattrack.safety.bodies import BodyDirection, Wanderer
    from sattrack.safety.geometry import Array, Bools
    from sattrack.safety.limits import SafetyLimits

ROOM_DEG = 4.0
"""How far on each side a box is tried to be grown."""
NEAR_ROOM_DEG = 1.0
"""The same for each region by itself, where one of them is too near for room from all."""
TRY_EVERY = 16
"""Judgements from one try that found no room to the next."""


class ClearRoom:
    """The last box found clear of regions that stay as they are, and by what margin."""

    def __init__(self, room_deg: float = ROOM_DEG) -> None:
        self._room_deg = room_deg
        self._box: Box | None = None
        self._margin_deg = 0.0
        self._wait = 0

    def forget(self) -> None:
        """Let the regions have moved."""
        self._box = None
        self._wait = 0

    def holds(self, box: Box, margin_deg: float) -> bool:
        """Tell whether a box is within the one that is known to be clear by this margin."""
        room = self._box
        return (
            room is not None
            and margin_deg <= self._margin_deg
            and room.ha_low_deg <= box.ha_low_deg
            and box.ha_high_deg <= room.ha_high_deg
            and room.dec_low_deg <= box.dec_low_deg
            and box.dec_high_deg <= room.dec_high_deg
        )

    def widen(self, regions: Iterable[Region], box: Box, margin_deg: float) -> None:
        """Look for room about a box that is clear; where there is none, there is no haste to look again.

        What is held at a limit is judged by boxes that have little in common, so the room that is known is
        kept with the new one where all between is clear.
        """
        if self._wait:
            self._wait -= 1
            return
        wide = self._room_deg
        room = box.grown(wide, wide, wide, wide)
        rooms = [room]
        if self._box is not None and margin_deg <= self._margin_deg:
            rooms.insert(0, room.with_box(self._box))
        for one in rooms:
            if all(region.clearance(one).least_deg >= margin_deg for region in regions):
                self._box, self._margin_deg = one, margin_deg
                return
        self._wait = TRY_EVERY


class Memory:
    """Regions that stay as they are, and what is known to be clear of them."""

    def __init__(self, regions: Sequence[Region]) -> None:
        self._regions = regions
        self._of_all = ClearRoom()
        # The ends of a travel are judged faster than looked up.
        self._each = [
            (region, judge_of(region), None if isinstance(region, Travel) else ClearRoom(NEAR_ROOM_DEG))
            for region in regions
        ]

    def violated(self, box: Box, margins: Mapping[str, float], margin_deg: float) -> str | None:
        """Return the name of the first region of which a box is not clear, or None.

        `margins` are those of single regions, which they only lower; `margin_deg` is that of the others.
        """
        if self._of_all.holds(box, margin_deg):
            return None
        for region, clear, room in self._each:
            if room is not None and room.holds(box, margin_deg):
                continue
            if not clear(box, margins.get(region.name, margin_deg) if margins else margin_deg):
                return region.name
            if room is not None:
                room.widen((region,), box, margin_deg)
        self._of_all.widen(self._regions, box, margin_deg)
        return None


HOLD_MARGIN_DEG = 0.1
"""How far inside a limit rates are held: what servo, encoder and clocks may be off."""
INSIDE_MARGIN_DEG = 0.01
"""Axes nearer to a limit than this have passed what holds them, and are stopped."""
PIER_MARGIN_DEG = 0.5
UP_DEG = -3.2
"""Below -3° the Sun's light does not reach the site, however high that is. Its cone is there a little before:
axes that it finds inside have most of a minute to leave."""
LOOK_S = 1.0
"""How long a look at the Sun and the Moon holds; their cones are wider by what they come meanwhile."""
RETREAT_DEG_S = 0.05
ESCAPE_DEG_S, ESCAPE_S = 1.0, 1.0
"""Inside of a cone, axes make for its edge so fast, and slower than this near it."""
RETREAT_STEP_DEG = 0.05
BESIDE_DEG = (15.0, 30.0, 45.0, 60.0, 70.0, 80.0)
"""Directions beside the best way out of a cone that are tried as well."""
ESCAPE_NEAR_DEG = 0.3
"""On the way out of a cone, axes may go along limits this near, but no nearer to them."""
SAME_DEG = 1e-6
CONES = frozenset({"sun", "moon"})
"""Rows that move by themselves."""
PARTS = (0.25, 0.5, 1.0)


class Bounds:
    """The regions; `look` puts the Sun and the Moon where they stand at an instant."""

    def __init__(
        self, profile: MountProfile, limits: SafetyLimits, latitude_deg: float, longitude_deg: float | None
    ) -> None:
        self._limits = limits
        self.longest_fault_s = limits.longest_fault_s
        self._latitude_deg = latitude_deg
        self._longitude_deg = longitude_deg
        frame = profile.frame
        self._frame = None if frame is None else frame.square
        self.horizon_latitude_deg = horizon_latitude_deg(profile, latitude_deg)
        """The latitude at which an equatorial mount sees the horizon as this one does."""
        self._loose_deg = 0.0 if frame is None else frame.geometry.off_square_deg
        self._fixed = fixed_regions(profile, limits, self.horizon_latitude_deg, PIER_MARGIN_DEG)
        self._beside_deg = 0.0 if profile.pointing is None else profile.pointing.most_deg
        """How far the telescope may look beside what the mount reports."""
        self._wanderers: list[tuple[str, Wanderer, float]] | None = None
        self._cones: list[Cone] = []
        self._memory, self._memory_of_cones = Memory(self._fixed), Memory(())
        self._last_clear: tuple[tuple[float, float], dict[str, float]] | None = None
        """The place of which clearances were asked for last, and these."""
        self.sun_is_up = False
        """Whether the Sun's light may reach optics; True where nobody knows."""
        self.utc_s: float | None = None
        """The instant of the last look that found the Sun, POSIX seconds."""

    def look(self, utc_s: float | None, clock_gap_deg: float) -> bool:
        """Put Sun and Moon where they stand; False where they matter and are unknown.

        A mount's clock that is off by an angle makes its directions off by as much: cones grow by it, and by
        what the profile's pointing model has between reports and the sky.
        """
        if utc_s is not None and self.utc_s is not None and 0.0 <= utc_s - self.utc_s < LOOK_S:
            return True
        self._put([])
        self.utc_s = None
        wanted = self._limits.sun_deg > 0.0 or self._limits.moon_cone_deg > 0.0
        self.sun_is_up = self._limits.optical
        if not wanted:
            return True
        if utc_s is None or self._longitude_deg is None:
            return False
        self.utc_s = utc_s
        cones = []
        for name, wanderer, cone_deg in self._bodies(self._longitude_deg):
            body = wanderer.at(utc_s)
            up = self._is_up(body)
            if name == "sun":
                self.sun_is_up = up and self._limits.optical
            if up and cone_deg > 0.0:
                wide_deg = cone_deg + self._loose_deg + self._beside_deg
                wide_deg += clock_gap_deg + SIDEREAL_RATE_DEG_S * LOOK_S
                seen = body if self._frame is None else seen_by(body, self._frame)
                cones.append(Cone(name, seen, wide_deg))
        self._put(cones)
        return True

    @property
    def cones(self) -> tuple[Cone, ...]:
        """The cones about what is up, as of the last look."""
        return tuple(self._cones)

    def _put(self, cones: list[Cone]) -> None:
        self._cones, self._memory_of_cones, self._last_clear = cones, Memory(cones), None

    def violated(
        self, box: Box, margins: Mapping[str, float], seconds: float, margin_deg: float = HOLD_MARGIN_DEG
    ) -> str | None:
        """Return the name of a region of which a box is not clear for so many seconds, or None.

        `margins` are those of single regions, which they only lower; `margin_deg` is that of the others.
        """
        name = self._memory.violated(box, margins, margin_deg)
        if name is not None or not self._cones:
            return name
        moves_deg = SIDEREAL_RATE_DEG_S * seconds
        return self._memory_of_cones.violated(box, margins, margin_deg + moves_deg)

    def in_way(self, box: Box, seconds: float, margins: Mapping[str, float] | None = None) -> str | None:
        """Return what `violated` does; about boxes all over the sky, room is not worth a look."""
        moves_deg = SIDEREAL_RATE_DEG_S * seconds
        for region in (*self._fixed, *self._cones):
            margin_deg = HOLD_MARGIN_DEG + (moves_deg if region.name in CONES else 0.0)
            if not is_clear(region, box, (margins or {}).get(region.name, margin_deg)):
                return region.name
        return None

    def closed(self, places: Array) -> Bools:
        """Tell of each of many places, rows of two angles, whether `in_way` names a region there now."""
        return closed_places([*self._fixed, *self._cones], places, HOLD_MARGIN_DEG)

    def near(
        self, place: tuple[float, float], seconds: float = 0.0, margin_deg: float = HOLD_MARGIN_DEG
    ) -> dict[str, float]:
        """Return how far a place is clear of those regions whose margin it does not keep for so many seconds.

        From there, axes may move along and away but not nearer. Zones of the pier have no such way out.
        """
        moves_deg = SIDEREAL_RATE_DEG_S * seconds
        return {
            name: clear
            for name, clear in self._clearances(place).items()
            if clear < margin_deg + (moves_deg if name in CONES else 0.0)
            and not (name == "pier" and clear < 0.0)
        }

    def _clearances(self, place: tuple[float, float]) -> dict[str, float]:
        """Return how far a place is clear of each row's regions, degrees."""
        if self._last_clear is None or self._last_clear[0] != place:
            here = Box.between(place, place)
            regions: list[Region] = [*self._fixed, *self._cones]
            found: dict[str, float] = {}
            for region in regions:
                clear = region.clearance(here).some_deg
                found[region.name] = min(clear, found.get(region.name, clear))
            self._last_clear = place, found
        return self._last_clear[1]

    def leaving(self, place: tuple[float, float], seconds: float = 0.0) -> dict[str, float]:
        """Return margins for a way that begins at a place: no nearer than that where it keeps no margin.

        The sky may carry the axes on for so many seconds until the way begins, and what is asked of a way
        includes that: a place that keeps its margin, but not by so much, would otherwise have no way at all.
        """
        drift_deg = SIDEREAL_RATE_DEG_S * seconds
        found = {}
        for name, clear in self._clearances(place).items():
            left = clear - SAME_DEG - drift_deg
            if clear > SAME_DEG:
                left = max(0.0, left)
            usual = HOLD_MARGIN_DEG + (drift_deg if name in CONES else 0.0)
            if left < usual and not (name == "pier" and clear < 0.0):
                found[name] = left
        return found

    def dazzled(self, place: tuple[float, float]) -> float:
        """Return how deep a place is inside of a cone about the Sun or the Moon, degrees; 0 outside."""
        here = Box.between(place, place)
        return max([0.0, *(-cone.clearance(here).some_deg for cone in self._cones)])

    def comes_nearer(
        self,
        near: Mapping[str, float],
        place: tuple[float, float],
        rates: tuple[float, float],
        seconds: float,
    ) -> str | None:
        """Return the name of a region of `near` to which rates lead nearer from a place, or None."""
        for region in (*self._fixed, *self._cones):
            if region.name not in near:
                continue
            for part in PARTS:
                there = (place[0] + rates[0] * seconds * part, place[1] + rates[1] * seconds * part)
                if region.clearance(Box.between(there, there)).some_deg < near[region.name] - SAME_DEG:
                    return region.name
        return None

    def away(self, place: tuple[float, float], seconds: float) -> list[tuple[float, float]]:
        """Return rates of the axes that lead away from the Sun or the Moon, the best first.

        None where neither comes too near within so many seconds. The deeper a place is inside of a cone, the
        faster. Where a limit stands in the best way, one axis alone may still have one, or a direction beside
        it, as along the horizon.
        """
        here = Box.between(place, place)
        crowding = [(cone.clearance(here).some_deg, cone) for cone in self._cones]
        clear, cone = min(crowding, key=lambda pair: pair[0], default=(math.inf, None))
        if cone is None or clear >= HOLD_MARGIN_DEG + SIDEREAL_RATE_DEG_S * seconds:
            return []
        ha, dec = (_gain_deg(cone, place, axis) for axis in (0, 1))
        rate_deg_s = min(ESCAPE_DEG_S, RETREAT_DEG_S + max(0.0, -clear) / ESCAPE_S)
        ways = [(ha, dec), (0.0, dec), (ha, 0.0), *_beside((ha, dec), place)]
        largest = [max(abs(ha), abs(dec)) for ha, dec in ways]
        return [
            (ha / most * rate_deg_s, dec / most * rate_deg_s)
            for (ha, dec), most in zip(ways, largest, strict=True)
            if most > SAME_DEG
        ]

    def _bodies(self, longitude_deg: float) -> list[tuple[str, Wanderer, float]]:
        if self._wanderers is None:
            # ERFA is imported where the sky matters, and not on the way to --help.
            from sattrack.safety.bodies import moon_over, sun_over

            limits = self._limits
            self._wanderers = [("sun", sun_over(self._latitude_deg, longitude_deg), limits.sun_deg)]
            if limits.moon_cone_deg:
                self._wanderers.append(
                    ("moon", moon_over(self._latitude_deg, longitude_deg), limits.moon_cone_deg)
                )
        return self._wanderers

    def _is_up(self, body: BodyDirection) -> bool:
        return altitude_deg(body.hour_angle_deg, body.dec_deg, self._latitude_deg) > UP_DEG


def seen_by(body: BodyDirection, frame: AxisFrame) -> BodyDirection:
    """Return a body by the angles of axes that point to it."""
    from sattrack.safety.bodies import BodyDirection

    first, second, _, _ = frame.angles(body.hour_angle_deg, body.dec_deg)
    h, d = math.radians(first), math.radians(second)
    return BodyDirection(first, second, math.cos(d) * math.cos(h), math.cos(d) * math.sin(h), math.sin(d))


def _beside(way: tuple[float, float], place: tuple[float, float]) -> list[tuple[float, float]]:
    """Return ways that lead in directions on the sky beside that of a gradient, the nearest to it first."""
    cos_dec = max(0.02, abs(math.cos(math.radians(place[1]))))
    # What an hour angle gains, it gains by less of the sky near the pole.
    across, up = way[0] / cos_dec, way[1]
    turns = [math.radians(sense * turn) for turn in BESIDE_DEG for sense in (1.0, -1.0)]
    return [
        (
            (across * math.cos(turn) - up * math.sin(turn)) / cos_dec,
            across * math.sin(turn) + up * math.cos(turn),
        )
        for turn in turns
    ]


def _gain_deg(cone: Cone, place: tuple[float, float], axis: int) -> float:
    """Return how much farther from a cone an axis gets by two steps."""
    clear = []
    for step in (-RETREAT_STEP_DEG, RETREAT_STEP_DEG):
        there = (place[0] + step, place[1]) if axis == 0 else (place[0], place[1] + step)
        clear.append(cone.clearance(Box.between(there, there)).some_deg)
    return clear[1] - clear[0]
