"""A satellite as the target that is followed: its course, its place, and the error of a pointing. Pure.

Round the celestial pole, or through it, the hour angle turns faster than the mount can. Between two
instants the hour angle axis leaves the target and runs by a trapezoid of rates; the declination axis keeps
the telescope as near to the target as that lets it. At both ends the axes have the target's place and rate.
A mount reports a direction and takes rates of it: past the pole the declination that it reports falls as
its axis goes on, and the right ascension is half a turn from the axis'. Within a plan with detours
everything that steers uses the axes' sense: as on the side of the pier on which following began.
"""

from __future__ import annotations

import math
from collections import deque
from typing import TYPE_CHECKING, NamedTuple, Protocol

import msgspec

from sattrack.core.angles import wrap180
from sattrack.mount.model import MoveAxes, StatusSample
from sattrack.views.run import ErrorView
from tle.bias import Bias
from tle.instants import Utc

if TYPE_CHECKING:
    from collections.abc import Callable

    from tle.direction import Direction
    from tle.propagator import Propagator

POLE_WITHIN_DEG = 15.0
"""A target that is too fast and so near the celestial pole is in the keyhole."""
SAME_INSTANT_S = 0.0005
PREDICTIONS_KEPT = 12
Pair = tuple[float, float]
"""A value of the right ascension axis, and one of the declination axis."""


class TargetSpan(NamedTuple):
    """A target over the interval in which a command acts: right ascension and declination of the axes.

    Degrees and seconds. `bound_deg` is where the axes are bound for, on the turns that the target is on.
    """

    begin_deg: Pair
    move_deg: Pair
    acceleration_deg_s2: Pair
    bound_deg: Pair


class Target(Protocol):
    """What is followed."""

    def span(self, begin_utc_s: float, interval_s: float, bound_deg: Pair) -> TargetSpan:
        """Return the target from an instant on; `bound_deg` is where commands so far lead the axes."""


class TargetState(msgspec.Struct, frozen=True, gc=False):
    """Where the satellite is fed, degrees, and how fast that changes, degrees a second."""

    ra_deg: float
    dec_deg: float
    ra_rate_deg_s: float
    dec_rate_deg_s: float

    @classmethod
    def at(cls, known: Direction | TargetState, late_s: float = 0.0) -> TargetState:
        """Return a known direction's target, so much later that its rates make up for that."""
        ra_rate, dec_rate = float(known.ra_rate_deg_s), float(known.dec_rate_deg_s)
        ra, dec = float(known.ra_deg), float(known.dec_deg)
        return cls(ra + ra_rate * late_s, dec + dec_rate * late_s, ra_rate, dec_rate)


def sky_error(utc_s: float, ra_deg: float, dec_deg: float, target: Direction | TargetState) -> ErrorView:
    """Return the error on the sky of a pointing against a target's direction at the same instant."""
    target_dec = float(target.dec_deg)
    cos_dec, cos_target = math.cos(math.radians(dec_deg)), math.cos(math.radians(target_dec))
    ra_gap = wrap180(ra_deg - float(target.ra_deg))
    dec_gap = dec_deg - target_dec
    half_ra, half_dec = math.radians(ra_gap) / 2.0, math.radians(dec_gap) / 2.0
    # Haversine: exact for any separation and without loss for the smallest.
    chord = math.sin(half_dec) ** 2 + cos_dec * cos_target * math.sin(half_ra) ** 2
    total = 2.0 * math.degrees(math.asin(min(1.0, math.sqrt(chord)))) * 3600.0
    east, north = ra_gap * cos_dec * 3600.0, dec_gap * 3600.0
    rate_east = float(target.ra_rate_deg_s) * cos_target
    rate_north = float(target.dec_rate_deg_s)
    speed = math.hypot(rate_east, rate_north)
    along = (east * rate_east + north * rate_north) / speed if speed else 0.0
    # Along û × m̂, with û towards the satellite: for a northward motion overhead that is west.
    across = (north * rate_east - east * rate_north) / speed if speed else 0.0
    return ErrorView(utc_s, total, east, north, along, across)


class SatelliteTarget:
    """A satellite by its direction at an instant, led round the celestial pole by detours."""

    def __init__(
        self, direction_at: Callable[[float], Direction | TargetState], detours: tuple[Detour, ...]
    ) -> None:
        self._direction_at = direction_at
        self.passage = Passage(detours) if detours else None
        """The detours that are ahead."""
        self._predicted: deque[tuple[float, Direction | TargetState]] = deque(maxlen=PREDICTIONS_KEPT)
        """The target at the ends of the intervals that the last commands are for."""

    def forget(self) -> None:
        """Forget what was predicted: offsets or elements have changed."""
        self._predicted.clear()

    def state(self, utc_s: float) -> TargetState:
        """Return the target at an instant: that of an interval's end, where it is the same.

        Commands end, and samples are taken, at the loop's turns, predicted a little differently each time.
        Over SAME_INSTANT_S the target's rate makes up for that to a thousandth of an arcsecond.
        """
        for at_utc_s, known in reversed(self._predicted):
            if abs(utc_s - at_utc_s) <= SAME_INSTANT_S:
                return TargetState.at(known, utc_s - at_utc_s)
        return TargetState.at(self._direction_at(utc_s))

    def span(self, begin_utc_s: float, interval_s: float, bound_deg: Pair) -> TargetSpan:
        """Return where the axes must be over an interval."""
        end_utc_s = begin_utc_s + interval_s
        begin, end = self.state(begin_utc_s), self._direction_at(end_utc_s)
        self._predicted.append((end_utc_s, end))
        if self.passage is None:
            first, last = (begin.ra_deg, begin.dec_deg), (float(end.ra_deg), float(end.dec_deg))
            bend = (
                (float(end.ra_rate_deg_s) - begin.ra_rate_deg_s) / interval_s,
                (float(end.dec_rate_deg_s) - begin.dec_rate_deg_s) / interval_s,
            )
        else:
            self.passage.across = abs(bound_deg[1]) > 90.0
            first = self.passage.place(begin_utc_s, begin.ra_deg, begin.dec_deg)
            last = self.passage.place(end_utc_s, float(end.ra_deg), float(end.dec_deg))
            bend = (0.0, 0.0)
        move = (wrap180(last[0] - first[0]), last[1] - first[1])
        return TargetSpan(first, move, bend, (first[0] + wrap180(bound_deg[0] - first[0]), bound_deg[1]))


class DetourPlace(NamedTuple):
    """Where the axes must be, degrees; past 90° of declination, right ascension is half a turn away."""

    ra_deg: float
    dec_deg: float


class Passage:
    """The detours of a plan, in order of time, and the side from which following began."""

    def __init__(self, detours: tuple[Detour, ...]) -> None:
        self._detours = detours
        self._turn_deg = 2.0 * detours[0].pole_dec_deg
        self._first_beyond: bool | None = None
        self.across = False
        """Whether the mount stands on the other side of the pole than at first, as last foreseen."""

    def from_instant(self, utc_s: float) -> Passage | None:
        """Return the passage for following that begins at an instant: what began before is not gone through.

        None where nothing is left.
        """
        ahead = tuple(detour for detour in self._detours if detour.begin_utc_s > utc_s)
        return Passage(ahead) if ahead else None

    def unfolded(self, sample: StatusSample) -> StatusSample:
        """Return a sample in the axes' sense. What comes before the first detour tells the first side."""
        begun = sample.arrival_utc_s >= self._detours[0].begin_utc_s
        if self._first_beyond is None or not begun:
            self._first_beyond = sample.beyond_pole
        if sample.beyond_pole == self._first_beyond:
            return sample
        return msgspec.structs.replace(
            sample, ra_deg=(sample.ra_deg + 180.0) % 360.0, dec_deg=self._turn_deg - sample.dec_deg
        )

    def place(self, utc_s: float, ra_deg: float, dec_deg: float) -> DetourPlace:
        """Return where the axes must be at an instant, for a target seen in a direction."""
        across = False
        for detour in self._detours:
            if utc_s >= detour.end_utc_s:
                across ^= detour.through_pole
            elif utc_s >= detour.begin_utc_s:
                if not across:
                    return DetourPlace(*detour.axes_at(utc_s, ra_deg, dec_deg))
                ra, dec = detour.axes_at(utc_s, ra_deg, dec_deg)
                return DetourPlace(ra + 180.0, self._turn_deg - dec)
        if not across:
            return DetourPlace(ra_deg, dec_deg)
        return DetourPlace((ra_deg + 180.0) % 360.0, self._turn_deg - dec_deg)

    def turned(self, rates: MoveAxes) -> MoveAxes:
        """Return rates from the one sense to the other, whichever of both they are in."""
        return MoveAxes(rates.ra_rate_deg_s, -rates.dec_rate_deg_s) if self.across else rates


class Detour(msgspec.Struct, frozen=True):
    """One such way, as rates of the right ascension that is fed. Degrees, seconds, POSIX seconds of UTC.

    From `ra_deg` at `begin_utc_s` the right ascension changes at `first_deg_s`, goes over to `cruise_deg_s`
    with `acceleration_deg_s2`, and in time to `last_deg_s`, which it has at `end_utc_s`. `through_pole` where
    the mount ends on the other side of the pier, its declination axis past 90°, with a right ascension that
    is half a turn from the target's.
    """

    begin_utc_s: float
    end_utc_s: float
    ra_deg: float
    first_deg_s: float
    cruise_deg_s: float
    last_deg_s: float
    acceleration_deg_s2: float
    through_pole: bool
    pole_dec_deg: float = 90.0
    """Which pole it is, 90 or -90."""

    def ra_at(self, utc_s: float) -> float:
        """Return the right ascension of the axis at an instant of the detour, unwrapped."""
        time_s = utc_s - self.begin_utc_s
        duration_s = self.end_utc_s - self.begin_utc_s
        ramp_on_s = abs(self.cruise_deg_s - self.first_deg_s) / self.acceleration_deg_s2
        ramp_off_s = abs(self.last_deg_s - self.cruise_deg_s) / self.acceleration_deg_s2
        on_s = min(time_s, ramp_on_s)
        ra = self.ra_deg + self.cruise_deg_s * time_s
        ra += (self.first_deg_s - self.cruise_deg_s) * (
            on_s - (0.5 * on_s * on_s / ramp_on_s if on_s else 0.0)
        )
        off_s = time_s - (duration_s - ramp_off_s)
        if off_s > 0.0 and ramp_off_s > 0.0:
            ra += (self.last_deg_s - self.cruise_deg_s) * 0.5 * off_s * off_s / ramp_off_s
        return ra

    def axes_at(self, utc_s: float, target_ra_deg: float, target_dec_deg: float) -> tuple[float, float]:
        """Return where the axes must be: right ascension as `ra_at`, declination past 90° beyond the pole.

        Of all declinations that the axis can have with that right ascension it is the nearest to the target.
        """
        ra = self.ra_at(utc_s)
        return ra, self._nearest_dec(ra, target_ra_deg, target_dec_deg)

    def _nearest_dec(self, ra_deg: float, target_ra_deg: float, target_dec_deg: float) -> float:
        dec, apart = math.radians(target_dec_deg), math.radians(target_ra_deg - ra_deg)
        nearest = math.degrees(math.atan2(math.sin(dec), math.cos(dec) * math.cos(apart)))
        return nearest if self.through_pole else max(-90.0, min(90.0, nearest))


PACE_STEP_S = 0.25
PACES_KEPT = 64
LEAST_PACE_DEG_S = 1e-3
"""Below it a satellite comes straight on, and a bias along its track is as good as none."""


class Going(NamedTuple):
    """Pace, degrees on the sky for each second of along-track bias, and range in km; each with its rate."""

    pace_deg_s: float
    pace_rate: float
    range_km: float
    range_rate_km_s: float


class AxisPace(NamedTuple):
    """What moves the axes: degrees for each second of bias along the track, and degrees a second by itself.

    Right ascension is that of the axis, not times cos Dec.
    """

    ra_by_along: float
    dec_by_along: float
    ra_rate_deg_s: float
    dec_rate_deg_s: float
    cos_dec: float


class Course:
    """The course of one satellite, as one propagator has it without any bias."""

    def __init__(self, propagator: Propagator) -> None:
        self.propagator = propagator
        """Gives the directions that are fed."""
        self._airless: Propagator | None = None
        self._known: dict[int, tuple[float, float]] = {}

    @property
    def airless(self) -> Propagator:
        """The same without refraction and pointing errors, which stars about a satellite share with it."""
        if self._airless is None:
            bent = self.propagator.refraction is not None or self.propagator.pointing is not None
            self._airless = self.propagator.with_place("apparent") if bent else self.propagator
        return self._airless

    def going(self, utc_s: float) -> Going:
        """Return pace and range at an instant, by cubics through whole seconds with continuous rates."""
        second = math.floor(utc_s)
        u = utc_s - second
        paces, ranges = zip(*(self._at(second + k) for k in (-1, 0, 1, 2)), strict=True)
        return Going(*_cubic(paces, u), *_cubic(ranges, u))

    def axis_pace(self, utc_s: float, along_s: float) -> AxisPace:
        """Return what a change of bias and the target's motion ask of the axes at an instant and a bias."""
        t = Utc(utc_s)
        here = self.propagator.at(t, Bias(along_s))
        later = self.propagator.at(t, Bias(along_s + PACE_STEP_S))
        dec_deg = float(here.dec_deg)
        return AxisPace(
            wrap180(float(later.ra_deg - here.ra_deg)) / PACE_STEP_S,
            (float(later.dec_deg) - dec_deg) / PACE_STEP_S,
            float(here.ra_rate_deg_s),
            float(here.dec_rate_deg_s),
            max(0.01, math.cos(math.radians(dec_deg))),
        )

    def _at(self, second: int) -> tuple[float, float]:
        found = self._known.get(second)
        if found is None:
            t = Utc(float(second))
            sooner, later = (self.propagator.at(t, Bias(s * PACE_STEP_S)) for s in (-1.0, 1.0))
            east_deg = wrap180(float(later.ra_deg - sooner.ra_deg))
            north_deg = float(later.dec_deg - sooner.dec_deg)
            middle = math.radians(0.5 * float(later.dec_deg + sooner.dec_deg))
            pace = math.hypot(east_deg * math.cos(middle), north_deg) / (2.0 * PACE_STEP_S)
            found = max(pace, LEAST_PACE_DEG_S), 0.5 * float(sooner.range_km + later.range_km)
            if len(self._known) >= PACES_KEPT:
                del self._known[next(iter(self._known))]
            self._known[second] = found
        return found


def _cubic(values: tuple[float, ...], u: float) -> tuple[float, float]:
    """Return value and derivative between the middle two of four values, by Catmull and Rom's spline."""
    a, b, c, d = values
    slope, bend, twist = 0.5 * (c - a), a - 2.5 * b + 2.0 * c - 0.5 * d, 1.5 * (b - c) + 0.5 * (d - a)
    return b + u * (slope + u * (bend + u * twist)), slope + u * (2.0 * bend + 3.0 * u * twist)
