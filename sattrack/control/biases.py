"""All offsets of a run, and the direction that is fed with them.

Along and across the track, on the sky, of the axes, of a camera; the operator's, a search's, the estimate's.

Along and across go through the propagator's own bias (`tle.bias` states the signs), the others turn the
direction on the sky; rates are derivatives of the positions given.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from sattrack.control.course import Course
from sattrack.control.offset import REST, Bounds, Offset, State, added
from tle.bias import Bias
from tle.direction import Turn
from tle.instants import Utc

if TYPE_CHECKING:
    from collections.abc import Iterable

    from sattrack.control.course import AxisPace
    from sattrack.control.pattern import Pattern
    from sattrack.mount.model import MountProfile
    from tle.direction import Direction
    from tle.propagator import Propagator

ALONG = "along_s"
CROSS = "cross_deg"
ON_SKY = (
    "ra_cos_dec_deg",
    "dec_deg",
    "ra_axis_deg",
    "dec_axis_deg",
    "camera_x_deg",
    "camera_y_deg",
)
SHARE = 0.45
"""Of the mount's acceleration, what one offset's change may ask: several may come together."""
GENTLE_SHARE = 0.15
"""The same for what is in no hurry: rates that are held for a period are off by its square times that."""
RATE_SHARE = 0.8
"""Of the rate that the mount has to spare beyond following."""
LEAST_SPARE = 0.1
"""Share of an axis' rate that counts as spare where the target takes it all."""
AHEAD_S = 2.0
DRIFT_S = 0.05
LONG_CHANGE_S = 1.0
PATTERNS_KEPT = 4


class Camera(NamedTuple):
    """How a camera's image lies on the sky: the position angle of its y axis, and whether it is mirrored.

    Not mirrored, north up has east to the left.
    """

    rotation_deg: float = 0.0
    flip: bool = False


UPRIGHT = Camera()


class Biases:
    """The offsets of one run. Instants from which changes act never fall."""

    def __init__(
        self, start: Bias, propagator: Propagator, profile: MountProfile, camera: Camera = UPRIGHT
    ) -> None:
        """Begin with the operator's bias."""
        self._propagator = propagator
        self._profile = profile
        self._camera = camera
        self._rotation = math.radians(camera.rotation_deg)
        self.course = Course(propagator)
        self.offsets = {ALONG: Offset(start.along_s), CROSS: Offset(start.cross_deg)}
        self.offsets |= {what: Offset() for what in ON_SKY}
        self.estimated_along = Offset()
        """Seconds."""
        self.estimated_cross_km = Offset()
        self.patterns: list[Pattern] = []
        self._plain: Bias | None = start
        """The bias while nothing has ever changed."""
        self._turned: list[str] = []

    def use(self, propagator: Propagator) -> None:
        """Take directions from another propagator of the same satellite."""
        self._propagator = propagator
        self.course = Course(propagator)

    def at(self, utc_s: float) -> Direction:
        """Return the direction to feed at an instant."""
        direction = self._on_track(utc_s)
        return direction.turned(self._turn(utc_s)) if self._turned else direction

    @property
    def known_since_utc_s(self) -> float:
        """From when on it is known what was fed."""
        every = (*self.offsets.values(), self.estimated_along, self.estimated_cross_km)
        return max(one.known_since_utc_s for one in every)

    def seen_at(self, utc_s: float, dx_deg: float, dy_deg: float) -> Direction:
        """Return the direction of what is seen off the middle of the camera's image, right and up.

        The offsets on the sky are left out: they make up for what the mount does wrong.
        """
        c, s = math.cos(self._rotation), math.sin(self._rotation)
        right = dx_deg if self._camera.flip else -dx_deg
        return self._on_track(utc_s).turned(Turn(right * c + dy_deg * s, dy_deg * c - right * s))

    def _on_track(self, utc_s: float) -> Direction:
        """Return the direction at an instant with all that is along the track and across it."""
        t = Utc(utc_s)
        if self._plain is not None:
            return self._propagator.at(t, self._plain)
        along, cross = self.applied(utc_s)
        direction = self._propagator.at(t, Bias(along.value, cross.value, 0.0, cross.rate, t))
        if along.rate:
            # A bias with a rate of its own would count the light's way from where that rate has led.
            sooner, later = (
                self._propagator.at(t, Bias(along.value + s * along.rate, cross.value))
                for s in (-DRIFT_S, DRIFT_S)
            )
            direction = direction.drifting(sooner, later, 2.0 * DRIFT_S)
        return direction

    @property
    def moving(self) -> bool:
        """Whether a search or a rate may run, and has to be watched."""
        return self._plain is None

    def begin_estimated(self, along_s: float, cross_km: float) -> None:
        """Begin with an estimate, seconds along and km across, as if observations had said so."""
        self.estimated_along, self.estimated_cross_km = Offset(along_s), Offset(cross_km)
        self.touched()

    def touched(self, what: str | None = None) -> None:
        """Note that something, or the offset named, may differ from nothing from here on."""
        self._plain = None
        if what in ON_SKY and what not in self._turned:
            self._turned.append(what)

    def applied(self, utc_s: float) -> tuple[State, State]:
        """Return what is in force along (seconds) and across (degrees) at an instant, all together."""
        along = self.offsets[ALONG].state(utc_s)
        cross = self.offsets[CROSS].state(utc_s)
        if not self.estimated_along.idle:
            along = added(along, self.estimated_along.state(utc_s))
        if not self.estimated_cross_km.idle:
            cross = added(cross, self._estimated_cross(utc_s, along))
        pattern = self.pattern_at(utc_s)
        if pattern is not None:
            more_along, more_cross = pattern.states(utc_s, along, self.course)
            along, cross = added(along, more_along), added(cross, more_cross)
        return along, cross

    def pattern_at(self, utc_s: float) -> Pattern | None:
        """Return the search that runs at an instant."""
        return next((one for one in reversed(self.patterns) if one.runs(utc_s)), None)

    def begin_pattern(self, pattern: Pattern) -> None:
        """Run a pattern from its beginning on."""
        self.patterns = [*self.patterns, pattern][-PATTERNS_KEPT:]
        self.touched()

    def end_pattern(self, utc_s: float) -> tuple[State, State]:
        """Let the pattern act until an instant only; return what it does then, along and across."""
        pattern = self.pattern_at(utc_s)
        if pattern is None:
            return REST, REST
        states = pattern.full_states(utc_s, self.along_without_search(utc_s), self.course)
        self.patterns[self.patterns.index(pattern)] = pattern.ended(utc_s)
        return states

    def along_without_search(self, utc_s: float) -> State:
        """Return what is in force along the track, seconds, without the search."""
        return added(self.offsets[ALONG].state(utc_s), self.estimated_along.state(utc_s))

    def totals(self, utc_s: float) -> tuple[float, float]:
        """Return what is asked for along (seconds) and across (degrees), the search apart."""
        along_s = self.offsets[ALONG].total_at(utc_s) + self.estimated_along.total_at(utc_s)
        cross_deg = self.offsets[CROSS].total_at(utc_s)
        if not self.estimated_cross_km.idle:
            range_km = self.course.going(utc_s + along_s).range_km
            cross_deg += math.degrees(math.atan(self.estimated_cross_km.total_at(utc_s) / range_km))
        return along_s, cross_deg

    def _estimated_cross(self, utc_s: float, along: State) -> State:
        going = self.course.going(utc_s + along.value)
        off = self.estimated_cross_km.state(utc_s)
        growth = going.range_rate_km_s * (1.0 + along.rate)
        square = going.range_km**2 + off.value**2
        rate = (off.rate * going.range_km - off.value * growth) / square
        return State(
            math.degrees(math.atan(off.value / going.range_km)),
            math.degrees(rate),
            math.degrees(off.acceleration / going.range_km),
        )

    def cross_km(self, utc_s: float, cross: State) -> State:
        """Return degrees across as a distance, where the satellite is fed at an instant."""
        going = self.course.going(utc_s + self.along_without_search(utc_s).value)
        slope, off = math.radians(going.range_km), math.radians(going.range_rate_km_s)
        return State(
            going.range_km * math.tan(math.radians(cross.value)),
            cross.rate * slope + cross.value * off,
            cross.acceleration * slope + 2.0 * cross.rate * off,
        )

    def _turn(self, utc_s: float) -> Turn:
        at = {what: self.offsets[what].state(utc_s) for what in self._turned}
        east, north, pole, x, y = (
            at.get("ra_cos_dec_deg", REST),
            added(at.get("dec_deg", REST), at.get("dec_axis_deg", REST)),
            at.get("ra_axis_deg", REST),
            at.get("camera_x_deg", REST),
            at.get("camera_y_deg", REST),
        )
        c, s = math.cos(self._rotation), math.sin(self._rotation)
        return Turn(
            east.value + x.value * c + y.value * s,
            north.value - x.value * s + y.value * c,
            pole.value,
            east.rate + x.rate * c + y.rate * s,
            north.rate - x.rate * s + y.rate * c,
            pole.rate,
        )

    def bounds(
        self, what: str, begins_utc_s: float, from_s: float, to_s: float, share: float = SHARE
    ) -> Bounds:
        """Return what a change from an instant on may ask, in the unit of `what`.

        `from_s` and `to_s` are the along-track biases between which it happens, `share` that of the mount's
        acceleration.
        """
        needs = [self._need(what, pace, to_s - from_s) for pace in self._paces(begins_utc_s, from_s, to_s)]
        rate, acceleration = (min(numbers) for numbers in zip(*needs, strict=True))
        return Bounds(rate, share * acceleration)

    def _paces(self, begins_utc_s: float, from_s: float, to_s: float) -> Iterable[AxisPace]:
        if abs(to_s - from_s) <= LONG_CHANGE_S:
            return [self.course.axis_pace(begins_utc_s + ahead_s, to_s) for ahead_s in (0.0, AHEAD_S)]
        steps = (from_s + (to_s - from_s) * i / 6.0 for i in range(7))
        return [self.course.axis_pace(begins_utc_s + AHEAD_S, along_s) for along_s in steps]

    def _need(self, what: str, pace: AxisPace, change_s: float) -> Bounds:
        ra_by, dec_by = 1.0 / pace.cos_dec, 1.0
        ra_moving, dec_moving = abs(pace.ra_rate_deg_s), abs(pace.dec_rate_deg_s)
        if what == ALONG:
            ra_by, dec_by = abs(pace.ra_by_along), abs(pace.dec_by_along)
            if change_s:
                # Back along the track an axis first loses the rate that it has.
                ra_moving = pace.ra_rate_deg_s * math.copysign(1.0, pace.ra_by_along * change_s)
                dec_moving = pace.dec_rate_deg_s * math.copysign(1.0, pace.dec_by_along * change_s)
        elif what == "ra_axis_deg":
            ra_by, dec_by = 1.0, 0.0
        elif what in {"dec_deg", "dec_axis_deg"}:
            ra_by = 0.0
        axes = (
            (ra_by, ra_moving, self._profile.ra),
            (dec_by, dec_moving, self._profile.dec),
        )
        rate = acceleration = math.inf
        for by, moving, limits in axes:
            if by > 0.0:
                spare = max(LEAST_SPARE * limits.max_rate_deg_s, limits.max_rate_deg_s - moving)
                rate = min(rate, RATE_SHARE * spare / by)
                acceleration = min(acceleration, limits.max_acceleration_deg_s2 / by)
        return Bounds(rate, acceleration)
