"""All offsets of a run, the orders upon them, and the direction that is fed with them.

Along and across the track, on the sky, of the axes, of a camera; the operator's, a search's, the estimate's.

Along and across go through the propagator's own bias (`tle.bias` states the signs), the others turn the
direction on the sky; rates are derivatives of the positions given. Orders are checked against sizes and the
mount: their functions return why they did nothing, as text, or None where they were obeyed.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from sattrack.control.camera_image import UPRIGHT, Camera
from sattrack.control.offset import (
    REST,
    START_S,
    ChangeLimits,
    Offset,
    Pattern,
    State,
    added,
    spiral_acceleration_deg_s2,
    spiral_lasts_s,
)
from sattrack.control.target import LEAST_PACE_DEG_S, Course
from tle.bias import Bias
from tle.direction import SkyTurn
from tle.instants import Utc
from tle.orbit_fit import Image

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

    from sattrack.control.estimate import EstimatedBiases
    from sattrack.control.target import AxisPace
    from sattrack.mount.model import MountProfile
    from sattrack.views.messages import OffsetBy, Search
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
FOLLOWED_S, CLOSE_S = 0.5, 0.2
"""Within so much an estimate is followed: what observations move it by is small, and late is off. In the
shorter time where it lies close."""
CLOSE_DEG = 5.0 / 3600.0
RATE_SHARE = 0.8
"""Of the rate that the mount has to spare beyond following."""
LEAST_SPARE = 0.1
"""Share of an axis' rate that counts as spare where the target takes it all."""
AHEAD_S = 2.0
DRIFT_S = 0.05
LONG_CHANGE_S = 1.0
PATTERNS_KEPT = 4


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
        frame = profile.frame
        self._frame = frame if frame is not None and frame.turns_field else None
        """The axes of a mount whose camera turns on the sky; None where it stands still."""
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
        return direction.turned(self._turn(utc_s, direction)) if self._turned else direction

    @property
    def known_since_utc_s(self) -> float:
        """From when on it is known what was fed."""
        every = (*self.offsets.values(), self.estimated_along, self.estimated_cross_km)
        return max(one.known_since_utc_s for one in every)

    def image_at(self, utc_s: float, dx: float, dy: float, camera: Camera, name: str) -> Image:
        """Return a place in a camera's image: tangents of the angles right and up of its middle.

        The offsets on the sky are left out: they make up for what the mount does wrong.
        """
        fed = self._on_track(utc_s)
        right, up = self._image_axes(fed, camera)
        return Image(name, camera.kind == "coarse", fed.unit, fed.unit_rate, right, up, dx, dy)

    def predicted_at(self, utc_s: float, camera: Camera) -> complex:
        """Return where elements alone would have the satellite in an image: right and i times up, rad.

        That is beside where the mount is fed to, with all offsets.
        """
        fed = self._on_track(utc_s)
        pointed = fed.turned(self._turn(utc_s, fed)) if self._turned else fed
        away = self._propagator.at(Utc(utc_s)).unit - pointed.unit
        right, up = self._image_axes(fed, camera)
        return complex(away @ right, away @ up)

    def motion_at(self, utc_s: float, camera: Camera) -> complex:
        """Return how the satellite moves by its elements, in the directions of an image, rad/s."""
        right, up = self._image_axes(self._on_track(utc_s), camera)
        rate = self._propagator.at(Utc(utc_s)).unit_rate
        return complex(rate @ right, rate @ up)

    def _image_axes(self, fed: Direction, camera: Camera) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return where right and up of an image lead, unit vectors."""
        x, y, z = (float(value) for value in fed.unit)
        flat = max(1e-9, math.hypot(x, y))
        east, north = np.array([-y, x, 0.0]) / flat, np.array([-z * x, -z * y, flat * flat]) / flat
        lies = math.radians(camera.rotation_deg) + self._field(fed)[0]
        c, s = math.cos(lies), math.sin(lies)
        right = (east * c - north * s) * (1.0 if camera.flip else -1.0)
        return right, north * c + east * s

    def _field(self, fed: Direction) -> tuple[float, float]:
        """Return how the tube is turned against the sky where it is fed to, and how fast: rad, rad/s."""
        if self._frame is None:
            return 0.0, 0.0
        axes = self._frame.angles(
            float(fed.ha_deg), float(fed.dec_deg), float(fed.ha_rate_deg_s), float(fed.dec_rate_deg_s)
        )
        turned = self._frame.field_angle_deg(axes.first_deg, axes.second_deg)
        return math.radians(turned), math.radians(self._frame.field_rate_deg_s(*axes))

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

    def _turn(self, utc_s: float, fed: Direction) -> SkyTurn:
        at = {what: self.offsets[what].state(utc_s) for what in self._turned}
        east, north, pole, x, y = (
            at.get("ra_cos_dec_deg", REST),
            added(at.get("dec_deg", REST), at.get("dec_axis_deg", REST)),
            at.get("ra_axis_deg", REST),
            at.get("camera_x_deg", REST),
            at.get("camera_y_deg", REST),
        )
        turned, turning = self._field(fed) if x.value or y.value or x.rate or y.rate else (0.0, 0.0)
        c, s = math.cos(self._rotation + turned), math.sin(self._rotation + turned)
        to_east, to_north = x.value * c + y.value * s, y.value * c - x.value * s
        return SkyTurn(
            east.value + to_east,
            north.value + to_north,
            pole.value,
            east.rate + x.rate * c + y.rate * s + turning * to_north,
            north.rate - x.rate * s + y.rate * c - turning * to_east,
            pole.rate,
        )

    def bounds(
        self, what: str, begins_utc_s: float, from_s: float, to_s: float, share: float = SHARE
    ) -> ChangeLimits:
        """Return what a change from an instant on may ask, in the unit of `what`.

        `from_s` and `to_s` are the along-track biases between which it happens, `share` that of the mount's
        acceleration.
        """
        needs = [self._need(what, pace, to_s - from_s) for pace in self._paces(begins_utc_s, from_s, to_s)]
        rate, acceleration = (min(numbers) for numbers in zip(*needs, strict=True))
        return ChangeLimits(rate, share * acceleration)

    def _paces(self, begins_utc_s: float, from_s: float, to_s: float) -> Iterable[AxisPace]:
        if abs(to_s - from_s) <= LONG_CHANGE_S:
            return [self.course.axis_pace(begins_utc_s + ahead_s, to_s) for ahead_s in (0.0, AHEAD_S)]
        steps = (from_s + (to_s - from_s) * i / 6.0 for i in range(7))
        return [self.course.axis_pace(begins_utc_s + AHEAD_S, along_s) for along_s in steps]

    def _need(self, what: str, pace: AxisPace, change_s: float) -> ChangeLimits:
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
        return ChangeLimits(rate, acceleration)


MOST_ALONG_S = 60.0
MOST_CROSS_DEG = 5.0
"""Biases beyond these are slips of the finger: no elements that are worth following are so far off."""
MOST_ALONG_RATE = 1.0
MOST_RATE_DEG_S = 0.5
MOST_SECONDS = 3600.0
SPACING_DEG = (0.001, 2.0)
SPEED_DEG_S = (0.0001, 2.0)
PERIOD_S = (2.0, 600.0)
LEAST_REACH_S = 0.01
SLOWEST_DEG_S = 1.01 * LEAST_PACE_DEG_S
"""A target that moves no faster than this for each second of bias is not searched along its track."""


def nudge_biases(biases: Biases, along_s: float, cross_deg: float, begins_utc_s: float) -> str | None:
    """Add to the biases along and across the track; one that is beyond its limit may only come back."""
    nudges = ((ALONG, along_s, MOST_ALONG_S), (CROSS, cross_deg, MOST_CROSS_DEG))
    if not all(_may_add(biases.offsets[what], by, most, begins_utc_s) for what, by, most in nudges):
        return f"nudge refused: biases go to {MOST_ALONG_S:g} s along and {MOST_CROSS_DEG:g}° across"
    if along_s:
        _change(biases, ALONG, "add", along_s, 0.0, begins_utc_s)
    if cross_deg:
        _change(biases, CROSS, "add", cross_deg, 0.0, begins_utc_s)
    return None


def _may_add(one: Offset, by: float, most: float, begins_utc_s: float) -> bool:
    before = one.total_at(begins_utc_s)
    total = before + by
    return by == 0.0 or abs(total) <= most or abs(total) < abs(before)


def change_offset(biases: Biases, order: OffsetBy, begins_utc_s: float) -> str | None:
    """Change one offset."""
    what, value, seconds = order.what, order.value or 0.0, order.seconds or 0.0
    most, most_rate, unit = MOST_CROSS_DEG, MOST_RATE_DEG_S, "°"
    if what == ALONG:
        most, most_rate, unit = MOST_ALONG_S, MOST_ALONG_RATE, " s"
    before = biases.offsets[what].total_at(begins_utc_s)
    total = before + value if order.how == "add" else value
    if order.how == "rate":
        if not abs(value) <= most_rate:
            return f"{what} refused: a rate of {value:g}{unit}/s; it goes to {most_rate:g}{unit}/s"
    elif not (abs(total) <= most or abs(total) < abs(before)):
        return f"{what} refused: {total:g}{unit}; it goes to {most:g}{unit} either way"
    if not 0.0 <= seconds <= MOST_SECONDS:
        return f"{what} refused: {seconds:g} seconds; give 0 to {MOST_SECONDS:g}"
    _change(biases, what, order.how, value, seconds, begins_utc_s)
    return None


def _change(biases: Biases, what: str, how: str, value: float, seconds: float, begins_utc_s: float) -> None:
    """Change an offset within what the mount can do."""
    one = biases.offsets[what]
    here_s = to_s = biases.along_without_search(begins_utc_s).value
    if what == ALONG and how != "rate":
        to_s += (value if how == "add" else value - one.total_at(begins_utc_s)) if how != "stop" else 0.0
    bounds = biases.bounds(what, begins_utc_s, here_s, to_s)
    match how:
        case "add":
            one.add(value, begins_utc_s, bounds)
        case "set":
            one.set(value, begins_utc_s, bounds)
        case "rate":
            one.run(value, begins_utc_s, bounds)
        case "gradual":
            one.gradual(value, seconds, begins_utc_s, bounds)
        case "stop":
            one.stop(begins_utc_s, bounds)
        case _:
            one.reset(begins_utc_s, bounds)
    biases.touched(what)


def clear_biases(biases: Biases, begins_utc_s: float) -> None:
    """Take everything away: the operator's offsets, the search's and the estimate's."""
    along, cross = biases.end_pattern(begins_utc_s)
    here_s = biases.along_without_search(begins_utc_s).value + along.value
    cross = added(cross, _estimate_given_up(biases, begins_utc_s))
    along = added(along, biases.estimated_along.give_up(begins_utc_s))
    for what, one in biases.offsets.items():
        bounds = biases.bounds(what, begins_utc_s, here_s, 0.0)
        if what in {ALONG, CROSS}:
            one.take_over(along if what == ALONG else cross, 0.0, begins_utc_s, bounds)
        elif not one.idle:
            one.reset(begins_utc_s, bounds)
    biases.touched()


def _estimate_given_up(biases: Biases, begins_utc_s: float) -> State:
    if biases.estimated_cross_km.idle:
        return State(0.0, 0.0, 0.0)
    _, all_cross = biases.applied(begins_utc_s)
    own = biases.offsets[CROSS].state(begins_utc_s)
    biases.estimated_cross_km.give_up(begins_utc_s)
    return State(*(a - b for a, b in zip(all_cross, own, strict=True)))


def begin_search(biases: Biases, order: Search, begins_utc_s: float) -> str | None:
    """Begin a pattern, or end the one that runs: keeping where it is, or going back."""
    if order.how in {"stop", "cancel"}:
        return end_search(biases, order.how == "stop", begins_utc_s)
    along_s = biases.along_without_search(begins_utc_s).value
    if biases.course.going(begins_utc_s + along_s).pace_deg_s <= SLOWEST_DEG_S:
        return (
            f"{order.how} refused: the target hardly moves along a track; offset ra_cos_dec_deg and dec_deg"
        )
    limits = biases.bounds(CROSS if order.how == "spiral" else ALONG, begins_utc_s, along_s, along_s)
    if order.how == "spiral":
        first, second = order.spacing_deg or 0.0, order.speed_deg_s or 0.0
        why = _spiral_trouble(first, second, limits.rate, limits.acceleration)
    else:
        first, second = order.reach_s or 0.0, order.period_s or 0.0
        why = _sweep_trouble(first, second, limits.rate, limits.acceleration)
    if why is not None:
        return f"{order.how} refused: {why}"
    end_search(biases, False, begins_utc_s)
    biases.begin_pattern(Pattern(order.how, first, second, begins_utc_s, math.inf))
    return None


def end_search(biases: Biases, keep: bool, utc_s: float) -> str | None:
    """End the pattern that runs."""
    if biases.pattern_at(utc_s) is None:
        return "no search is running"
    along, cross = biases.end_pattern(utc_s)
    back_s = biases.along_without_search(utc_s).value
    here_s = back_s + along.value
    for what, moving in ((ALONG, along), (CROSS, cross)):
        one = biases.offsets[what]
        bounds = biases.bounds(what, utc_s, here_s, here_s if keep else back_s)
        if keep:
            one.keep(moving, utc_s, bounds)
        else:
            one.take_over(moving, one.total_at(utc_s), utc_s, bounds)
    return None


def end_reached(biases: Biases, utc_s: float) -> str | None:
    """End what has gone as far as it may: spirals and rates; return what was ended, in words."""
    pattern = biases.pattern_at(utc_s)
    if pattern is not None and pattern.how == "spiral":
        pace = biases.course.going(utc_s + biases.along_without_search(utc_s).value).pace_deg_s
        reach_deg = min(MOST_CROSS_DEG, MOST_ALONG_S * pace)
        if utc_s - pattern.begins_utc_s >= spiral_lasts_s(reach_deg, pattern.first, pattern.second):
            end_search(biases, False, utc_s)
            return f"the spiral found nothing within {reach_deg:.1f}° and went back"
    for what, one in biases.offsets.items():
        most = MOST_ALONG_S if what == ALONG else MOST_CROSS_DEG
        total = one.total_at(utc_s)
        if one.rate and abs(total) > most and total * one.rate > 0.0:
            _change(biases, what, "stop", 0.0, 0.0, utc_s)
            return f"{what} went as far as it may, {most:g}, and was stopped"
    return None


def follow_estimate(
    biases: Biases, read: EstimatedBiases, first: bool, begins_utc_s: float, found: bool = True
) -> None:
    """Go to what observations say as of an instant, and on with its drift.

    The first takes the place of the operator's biases. A search ends where something was `found`.
    """
    along, cross = biases.end_pattern(begins_utc_s) if found else (REST, REST)
    here_s = biases.along_without_search(begins_utc_s).value + along.value
    if first:
        along = added(along, biases.offsets[ALONG].give_up(begins_utc_s))
        cross = added(cross, biases.offsets[CROSS].give_up(begins_utc_s))
    to_s = read.along_s + biases.offsets[ALONG].total_at(begins_utc_s)
    moving = biases.cross_km(begins_utc_s, cross)
    seconds = CLOSE_S if _way_deg(biases, read, begins_utc_s, here_s, moving) < CLOSE_DEG else FOLLOWED_S
    bounds = biases.bounds(ALONG, begins_utc_s, here_s, to_s, GENTLE_SHARE)
    biases.estimated_along.take_over(
        along, read.along_s, begins_utc_s, bounds, read.along_rate, read.along_curve, seconds
    )
    bounds = _bounds_km(biases, begins_utc_s, here_s, to_s)
    biases.estimated_cross_km.take_over(
        moving, read.cross_km, begins_utc_s, bounds, read.cross_rate_km_s, read.cross_curve_km_s2, seconds
    )
    biases.touched()


def _way_deg(
    biases: Biases, read: EstimatedBiases, begins_utc_s: float, here_s: float, moving: State
) -> float:
    """Return how far an estimate lies from what is fed: `here_s` along, `moving` and the last one across."""
    going = biases.course.going(begins_utc_s + here_s)
    to_s = read.along_s + biases.offsets[ALONG].total_at(begins_utc_s)
    across_km = read.cross_km - biases.estimated_cross_km.state(begins_utc_s).value - moving.value
    return math.hypot((to_s - here_s) * going.pace_deg_s, math.degrees(across_km / going.range_km))


def forget_estimate(biases: Biases, begins_utc_s: float) -> None:
    """Go to where the satellite is without an estimate; the operator's offsets stay."""
    here_s = biases.along_without_search(begins_utc_s).value
    to_s = biases.offsets[ALONG].total_at(begins_utc_s)
    biases.estimated_along.reset(begins_utc_s, biases.bounds(ALONG, begins_utc_s, here_s, to_s, GENTLE_SHARE))
    biases.estimated_cross_km.reset(begins_utc_s, _bounds_km(biases, begins_utc_s, here_s, to_s))
    biases.touched()


def _bounds_km(biases: Biases, begins_utc_s: float, from_s: float, to_s: float) -> ChangeLimits:
    """Return what a change across the track may ask, as a distance."""
    range_km = biases.course.going(begins_utc_s + to_s).range_km
    on_sky = biases.bounds(CROSS, begins_utc_s, from_s, to_s, GENTLE_SHARE)
    return ChangeLimits(math.radians(on_sky.rate) * range_km, math.radians(on_sky.acceleration) * range_km)


def _spiral_trouble(spacing_deg: float, speed_deg_s: float, rate: float, acceleration: float) -> str | None:
    if not SPACING_DEG[0] <= spacing_deg <= SPACING_DEG[1]:
        return f"spacing_deg {spacing_deg:g}; give {SPACING_DEG[0]:g} to {SPACING_DEG[1]:g}"
    if not SPEED_DEG_S[0] <= speed_deg_s <= SPEED_DEG_S[1]:
        return f"speed_deg_s {speed_deg_s:g}; give {SPEED_DEG_S[0]:g} to {SPEED_DEG_S[1]:g}"
    if speed_deg_s > rate or spiral_acceleration_deg_s2(spacing_deg, speed_deg_s) > acceleration:
        return f"the mount cannot do {speed_deg_s:g}°/s with arms {spacing_deg:g}° apart: slower, or wider"
    return None


def _sweep_trouble(reach_s: float, period_s: float, rate: float, acceleration: float) -> str | None:
    if not LEAST_REACH_S <= reach_s <= MOST_ALONG_S:
        return f"reach_s {reach_s:g}; give {LEAST_REACH_S:g} to {MOST_ALONG_S:g}"
    if not PERIOD_S[0] <= period_s <= PERIOD_S[1]:
        return f"period_s {period_s:g}; give {PERIOD_S[0]:g} to {PERIOD_S[1]:g}"
    turning = 2.0 * math.pi / period_s
    if reach_s * turning > rate or reach_s * turning * max(turning, 1.5 / START_S) > acceleration:
        return f"the mount cannot sweep {reach_s:g} s in {period_s:g} s: less far, or slower"
    return None
