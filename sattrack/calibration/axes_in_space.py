"""Where a mount's axes point, found from small motions: each axis in turn, and where the tube points then.

Nothing but rigid axes is presumed: while one axis turns, the angle of the other stays. A pole is looked for
with which that holds for all motions, with the angle between the axes and the cone where they show. A tube
that moves otherwise has no such pole, and its mount is refused.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import msgspec
import numpy as np

from sattrack.control.driver import Driver, StopProcedure, limit_text
from sattrack.core.angles import separation_deg
from sattrack.core.errors import SattrackError
from sattrack.mount.geometry import MOST_OFF_DEG, AxisFrame, AxisGeometry
from sattrack.mount.model import SIDEREAL_RATE_DEG_S, Hold, Motion, MoveAxes, Stop
from sattrack.mount.xerxes.link import LinkState
from sattrack.safety.probe import ProbeSafety

if TYPE_CHECKING:
    from collections.abc import Generator, Iterator

    from numpy.typing import NDArray

    from sattrack.mount.model import MountProfile, SitePlace, StatusSample
    from sattrack.safety import SafetyLimits

    Array = NDArray[np.float64]

LEGS = ((0, 1), (0, 1), (1, 1), (1, 1), (0, -1), (0, -1), (1, -1), (1, -1))
"""Axis and sense of each motion: round a square, in two steps a side."""
LEG_DEG, LEG_DEG_S = 4.0, 1.0
REACH_DEG, STOP_DEG = 16.0, 3.0
"""How far motions with a gain of 1.4 lead at most on the sky, and how much farther a stop does."""
SETTLES_S, STANDS_S, SETTLES_AT_MOST_S = 1.0, 1.5, 15.0
"""After a motion, for how long a place is averaged, and how long a servo may take until it stands."""
STANDS_DEG_S = 1.0 / 3600.0
"""A mount that moves faster than this, commanded to stand, does not."""
LEAST_MOVED, MOST_MOVED = 0.5, 1.6
"""Share of the commanded angle that an axis must go, and may."""
NEAR_POLE_DEG = 70.0
FITS_DEG = 30.0 / 3600.0
"""How far off the places may be from what rigid axes make of them."""
PLACE_SIGMA_DEG = 0.5 / 3600.0
SQUARE_SIGMA_DEG = 1.0
"""What is presumed of the angle between the axes and of the cone, one sigma."""
GAIN_UNSURE, AT_ZENITH_DEG = 0.05, 89.999
ALIGNED_DEG = 2.0
"""How near to celestial pole or zenith the first axis of an equatorial or an alt-azimuth mount is."""
ROUNDS, STEP_DEG = 30, 1e-4
STEPS_BACK = 8


class AxisTurn(NamedTuple):
    """One motion: the axis, the angle commanded, and where the tube pointed before and after.

    Places are hour angle and declination, degrees.
    """

    axis: int
    asked_deg: float
    before: tuple[float, float]
    after: tuple[float, float]


class FoundAxes(NamedTuple):
    """The geometry that fits, the sense and gain of each axis' rate, and how well all fits, degrees."""

    geometry: AxisGeometry
    gains: tuple[float, float]
    left_deg: float


def find_axes(legs: list[AxisTurn], latitude_deg: float) -> FoundAxes:
    """Return the axes that explain motions at a latitude. Raises SattrackError, with the reason."""
    for leg in legs:
        name = ("first", "second")[leg.axis]
        if separation_deg(*leg.before, *leg.after) < 0.02 * abs(leg.asked_deg):
            raise SattrackError(f"the {name} axis does not move at its MoveAxis")
    found = [_fitted(pole, legs, latitude_deg) for pole in _first_guesses(legs, latitude_deg)]
    parameters, left, _ = min(found, key=lambda one: one[2])
    geometry = _geometry(parameters)
    if left > FITS_DEG:
        raise SattrackError(
            f"the tube does not move as two axes make it: the nearest axes leave {left:.2f}°; is MoveAxis 0 "
            "and 1 each one axis, and does the mount stand while no rate is commanded?"
        )
    frame = AxisFrame(geometry, latitude_deg)
    if max(abs(frame.angles(*leg.after).second_deg) for leg in legs) > NEAR_POLE_DEG:
        raise SattrackError(
            f"the tube points within {90.0 - NEAR_POLE_DEG:g}° of where the first axis does: turn the second "
            "axis away from there, and begin again"
        )
    gains = _gain(legs, frame, 0), _gain(legs, frame, 1)
    for name, gain in zip(("first", "second"), gains, strict=True):
        if not LEAST_MOVED <= abs(gain) <= MOST_MOVED:
            raise SattrackError(
                f"the {name} axis went {abs(gain):.2f} times as far as commanded: its rates are not degrees "
                "a second, or add to tracking"
            )
    return FoundAxes(geometry, gains, left)


def with_axes(profile: MountProfile, found: FoundAxes, site: SitePlace) -> MountProfile:
    """Return a profile with the axes that were found at a site, and the signs of their rates."""
    own = found.geometry
    angles = (own.pole_azimuth_deg, own.pole_altitude_deg, own.axes_deg, own.cone_deg)
    azimuth, altitude, axes, cone = (round(angle, 4) for angle in angles)
    if altitude > AT_ZENITH_DEG:
        # An azimuth says no more there than where the first angle is 0: at the south, as usual.
        azimuth = 0.0
    rounded = AxisGeometry(azimuth, altitude, axes, cone)
    first, second = found.gains
    return msgspec.structs.replace(
        profile,
        additive=False,
        geometry=rounded,
        stands_at=site,
        ra_rate_sign=1 if first > 0.0 else -1,
        dec_rate_sign=1 if second > 0.0 else -1,
        ra_rate_gain=_told(abs(first)),
        dec_rate_gain=_told(abs(second)),
    )


def _told(gain: float) -> float:
    """Return a gain where it surely is not 1: commands last about as long as they are meant to."""
    return 1.0 if abs(gain - 1.0) < GAIN_UNSURE else round(gain, 3)


def kind_of(geometry: AxisGeometry, latitude_deg: float) -> str:
    """Return what a mount with such axes is called at a latitude."""
    if AxisFrame(geometry, latitude_deg).from_celestial_deg < ALIGNED_DEG:
        return "equatorial"
    return "alt-azimuth" if geometry.pole_altitude_deg > 90.0 - ALIGNED_DEG else "neither"


def _gain(legs: list[AxisTurn], frame: AxisFrame, axis: int) -> float:
    """Return the angle that an axis went over the one that was commanded."""
    own = [leg for leg in legs if leg.axis == axis]
    went = [
        math.remainder(frame.angles(*leg.after)[axis] - frame.angles(*leg.before)[axis], 360.0) for leg in own
    ]
    asked = [leg.asked_deg for leg in own]
    return sum(a * w for a, w in zip(asked, went, strict=True)) / sum(a * a for a in asked)


def _first_guesses(legs: list[AxisTurn], latitude_deg: float) -> Iterator[tuple[float, float]]:
    """Yield azimuth and altitude of poles: square to the chords of the first axis, and all over the sky."""
    horizon = AxisFrame(AxisGeometry(0.0, 90.0), latitude_deg)
    places = [_unit(horizon, leg) for leg in ([legs[0].before] + [leg.after for leg in legs])]
    chords = [b - a for leg, (a, b) in zip(legs, pairwise(places), strict=True) if leg.axis == 0]
    for one, other in pairwise(chords):
        normal = np.cross(one, other)
        if np.linalg.norm(normal) > 1e-9:
            yield _up(normal)
    for azimuth in range(0, 360, 45):
        for altitude in (10.0, 45.0):
            yield float(azimuth), altitude
    yield 0.0, 85.0


def _unit(horizon: AxisFrame, place: tuple[float, float]) -> Array:
    """Return a unit vector east, north, up."""
    first, altitude, _, _ = horizon.angles(*place)
    azimuth = math.radians(first + 180.0)
    level = math.cos(math.radians(altitude))
    return np.array([level * math.sin(azimuth), level * math.cos(azimuth), math.sin(math.radians(altitude))])


def _up(vector: Array) -> tuple[float, float]:
    """Return azimuth and altitude of the end of an axis that is above the horizon."""
    east, north, up = vector if vector[2] >= 0.0 else -vector
    return math.degrees(math.atan2(east, north)) % 360.0, math.degrees(
        math.atan2(up, math.hypot(east, north))
    )


def _geometry(parameters: Array) -> AxisGeometry:
    """Return the geometry of a pole, as a vector east, north, up, and of skew and cone in degrees."""
    azimuth, altitude = _up(parameters[:3])
    most = MOST_OFF_DEG
    skew, cone = (float(max(-most, min(most, one))) for one in parameters[3:])
    return AxisGeometry(azimuth, altitude, 90.0 - skew, cone)


def _fitted(
    pole: tuple[float, float], legs: list[AxisTurn], latitude_deg: float
) -> tuple[Array, float, float]:
    """Return the parameters from a first guess of the pole on, what is left, degrees, and what that costs.

    Gauss and Newton's steps, with skew and cone held to be small where motions do not show them.
    """
    azimuth, altitude = (math.radians(angle) for angle in pole)
    level = math.cos(altitude)
    vector = [level * math.sin(azimuth), level * math.cos(azimuth), math.sin(altitude), 0.0, 0.0]
    now: Array = np.array(vector)
    left, cost = _left(now, legs, latitude_deg)
    for _ in range(ROUNDS):
        basis = _tangents(now[:3])
        columns = [
            _left(_stepped(now, basis, np.eye(4)[k] * STEP_DEG), legs, latitude_deg)[0] for k in range(4)
        ]
        jacobian = (np.array(columns).T - left[:, None]) / STEP_DEG
        step: Array = np.linalg.lstsq(jacobian, -left, rcond=None)[0].astype(np.float64)
        for _ in range(STEPS_BACK):
            there = _stepped(now, basis, step)
            left_there, cost_there = _left(there, legs, latitude_deg)
            if cost_there < cost:
                break
            step = 0.5 * step
        else:
            break
        done = cost - cost_there < 1e-9 * cost
        now, left, cost = there, left_there, cost_there
        if done:
            break
    misfit = left[: 2 * len(legs)] * PLACE_SIGMA_DEG
    return now, float(np.sqrt(np.sum(misfit * misfit) / len(legs))), cost


def _tangents(pole: Array) -> tuple[Array, Array]:
    aside = np.cross(pole, [0.0, 0.0, 1.0] if abs(pole[2]) < 0.9 else [1.0, 0.0, 0.0])
    aside /= np.linalg.norm(aside)
    return aside, np.cross(pole, aside)


def _stepped(parameters: Array, basis: tuple[Array, Array], step: Array) -> Array:
    pole = parameters[:3] + np.radians(step[0]) * basis[0] + np.radians(step[1]) * basis[1]
    return np.concatenate([pole / np.linalg.norm(pole), parameters[3:] + step[2:]])


def _left(parameters: Array, legs: list[AxisTurn], latitude_deg: float) -> tuple[Array, float]:
    """Return what motions and presumptions leave, in sigmas, and the sum of its squares."""
    frame = AxisFrame(_geometry(parameters), latitude_deg)
    rows = []
    for leg in legs:
        before, after = frame.angles(*leg.before), frame.angles(*leg.after)
        if leg.axis == 0:
            rows.append((after.second_deg - before.second_deg) / PLACE_SIGMA_DEG)
        else:
            across = math.cos(math.radians(0.5 * (after.second_deg + before.second_deg)))
            turned = math.remainder(after.first_deg - before.first_deg, 360.0)
            rows.append(turned * across / PLACE_SIGMA_DEG)
        # Axes that do not reach a place say nothing of their angles there.
        missed = separation_deg(*leg.after, *frame.direction(*after[:2]))
        rows.append(missed / PLACE_SIGMA_DEG)
    left = np.array([*rows, *(parameters[3:] / SQUARE_SIGMA_DEG)])
    return left, float(left @ left)


class AxesFinder(Driver):
    """Makes the motions with one mount, and keeps where it pointed; `legs` is complete once `done`."""

    def __init__(
        self,
        profile: MountProfile,
        limits: SafetyLimits,
        site: tuple[float, float],
        begin_utc_s: float,
        fastest_deg_s: tuple[float, float] | None = None,
    ) -> None:
        fastest = fastest_deg_s or (profile.ra.max_rate_deg_s, profile.dec.max_rate_deg_s)
        self._rates = tuple(min(LEG_DEG_S, 0.8 * one) for one in fastest)
        super().__init__(profile, ProbeSafety(profile, limits, site, REACH_DEG, STOP_DEG))
        self.legs: list[AxisTurn] = []
        self.words: str | None = None
        """Why the motions ended before their time."""
        self.done = False
        self._begin_utc_s = self._now_s = begin_utc_s
        self._wanted: Motion = Hold()
        self._places: list[tuple[float, float, float]] = []
        """Instant, hour angle and declination of the last statuses."""
        self._script = self._run()

    @property
    def part_done(self) -> float:
        """The part of the motions that is made."""
        return 1.0 if self.done else len(self.legs) / len(LEGS)

    def receive(self, data: bytes, arrival_utc_s: float) -> StatusSample | None:
        """Take one datagram from the mount."""
        sample = super().receive(data, arrival_utc_s)
        if sample is not None:
            self._places.append((arrival_utc_s, sample.sidereal_h * 15.0 - sample.ra_deg, sample.dec_deg))
            del self._places[:-200]
        return sample

    def tick(self, now_utc_s: float) -> bytes:
        """Return the datagram to send now; call once a period."""
        self._now_s = now_utc_s
        self.link_state = self.session.link_state(now_utc_s)
        if self.words is None and not self.done:
            self._go_on()
        ending = self.words is not None or self.done
        self.session.apply(self.clear(Stop() if ending else self._wanted, now_utc_s))
        if self.safety.tripped is not None and self.words is None:
            self.end(limit_text(self.safety.tripped))
        if ending and self.stop is None:
            self.stop = StopProcedure(now_utc_s, needed=bool(self.legs) or not isinstance(self._wanted, Hold))
        return self.compose(now_utc_s)

    def end(self, words: str) -> None:
        """Bring the mount to rest, for a reason; the first one is kept."""
        self.words = self.words or words

    def _go_on(self) -> None:
        if self.link_state is LinkState.LOST:
            self.end("the mount is not heard any more")
            return
        try:
            next(self._script)
        except StopIteration:
            self.done = True
        except SattrackError as error:
            self.end(str(error))

    def _run(self) -> Iterator[None]:
        yield from self._for(STANDS_S + SETTLES_S)
        if not self._places:
            raise SattrackError("the mount has not been heard")
        self._wanted = MoveAxes(SIDEREAL_RATE_DEG_S, 0.0)
        place = yield from self._stands()
        for axis, sense in LEGS:
            rate = sense * self._rates[axis]
            begun_s = self._now_s
            self._wanted = (
                MoveAxes(SIDEREAL_RATE_DEG_S - rate, 0.0)
                if axis == 0
                else MoveAxes(SIDEREAL_RATE_DEG_S, rate)
            )
            yield from self._for(LEG_DEG / abs(rate))
            asked_deg = rate * (self._now_s - begun_s)
            self._wanted = MoveAxes(SIDEREAL_RATE_DEG_S, 0.0)
            after = yield from self._stands()
            self.legs.append(AxisTurn(axis, asked_deg, place, after))
            place = after

    def _for(self, seconds: float) -> Iterator[None]:
        until_s = self._now_s + seconds
        while self._now_s < until_s - 1e-6:
            yield

    def _stands(self) -> Generator[None, None, tuple[float, float]]:
        """Wait until the mount stands; return where it points in the mean."""
        yield from self._for(SETTLES_S)
        until_s = self._now_s + SETTLES_AT_MOST_S
        drift_deg_s = math.inf
        while drift_deg_s > STANDS_DEG_S:
            if self._now_s > until_s:
                raise SattrackError(
                    f"the mount moves by {3600.0 * drift_deg_s:.0f}″/s where it should stand: MoveAxis "
                    "adds to its tracking, or it does not obey; switch tracking off, and begin again"
                )
            yield from self._for(STANDS_S)
            seen = [one for one in self._places if one[0] > self._now_s - STANDS_S]
            if len(seen) < 3:
                raise SattrackError("the mount is heard too rarely")
            (begin_s, *first), (end_s, *last) = seen[0], seen[-1]
            drift_deg_s = separation_deg(*first, *last) / (end_s - begin_s)
        turns = seen[0][1]
        mean = turns + sum(math.remainder(one[1] - turns, 360.0) for one in seen) / len(seen)
        return mean, sum(one[2] for one in seen) / len(seen)
