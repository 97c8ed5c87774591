"""Where a mount's axes point, found from small motions: each axis in turn, and where the tube points then.

Nothing but rigid axes is presumed: while one axis turns, the angle of the other stays. A pole is looked for
with which that holds for all motions, with the angle between the axes and the cone where they show. A tube
that moves otherwise has no such pole, and its mount is refused.

With a camera, fields say where the tube points, and what the mount reports is compared with them: it is the
sky, or azimuth and altitude, either with zero points, or the angles of the axes, or nothing that is known.
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING, Literal, NamedTuple

import msgspec
import numpy as np

from sattrack.control.driver import Driver, StopProcedure, limit_text
from sattrack.core.angles import separation_deg, wrap180
from sattrack.core.errors import LinkLostError, SafetyLimitError, SattrackError
from sattrack.mount.geometry import MOST_OFF_DEG, AxisFrame, AxisGeometry
from sattrack.mount.model import SIDEREAL_RATE_DEG_S, Hold, Motion, MoveAxes, Stop
from sattrack.mount.xerxes.link import LinkState
from sattrack.pointing.fields import ALIKE_DEG, FieldWait
from sattrack.safety.probe import ProbeSafety

if TYPE_CHECKING:
    from collections.abc import Generator, Iterable, Iterator

    from numpy.typing import NDArray

    from sattrack.mount.model import MountProfile, SitePlace, StatusSample
    from sattrack.pointing.fields import FieldCamera, FieldSky, Solved
    from sattrack.safety import SafetyLimits

    Array = NDArray[np.float64]
    Place = tuple[float, float]
    """Hour angle and declination, degrees."""

LEGS = ((0, 1), (0, 1), (1, 1), (1, 1), (0, -1), (0, -1), (1, -1), (1, -1))
"""Axis and sense of each motion: round a square, in two steps a side."""
SEEN_LEGS = ((0, 0.25), (1, 0.25), (0, 0.75), (0, 1), (1, 0.75), (1, 1), *LEGS[4:])
"""The same with a camera: short at first, until it is known how far reports lead. Parts of LEG_DEG."""
LEG_DEG, LEG_DEG_S = 4.0, 1.0
REACH_DEG, STOP_DEG = 16.0, 3.0
"""How far motions with a gain of 1.4 lead at most on the sky, and how much farther a stop does."""
SETTLES_S, STANDS_S, SETTLES_AT_MOST_S = 1.0, 1.5, 15.0
"""After a motion, for how long a place is averaged, and how long a servo may take until it stands."""
STANDS_DEG_S = 1.0 / 3600.0
"""A mount that moves faster than this, commanded to stand, does not."""
LEAST_MOVED, MOST_MOVED = 0.5, 1.6
"""Share of the commanded angle that an axis must go, and may."""
NEAR_POLE_DEG, TOLD_POLE_DEG = 70.0, 80.0
FITS_DEG = 30.0 / 3600.0
"""How far off the places may be from what rigid axes make of them."""
PLACE_SIGMA_DEG = 0.5 / 3600.0
SQUARE_SIGMA_DEG = 1.0
"""What is presumed of the angle between the axes and of the cone, one sigma."""
GAIN_UNSURE, AT_ZENITH_DEG = 0.05, 89.999
ALIGNED_DEG = 2.0
"""How near to celestial pole or zenith the first axis of an equatorial or an alt-azimuth mount is."""
FIELD_SIGMA_DEG = 2.0 / 3600.0
STRAYS_DEG = MOST_MOVED * LEG_DEG + 1.0
"""How far a field may be from the one before; farther it is taken for a wrong one."""
FOLLOWS = 0.1
"""Share of a true motion that reports must show."""
ALIGNED_REPORTS_DEG, REPORTS_FIT_DEG = 0.05, 0.1
"""Reports nearer to the sky than the first have no zero points; those that fit nothing better than the second
mean something else."""
FITS_AS_WELL, CLEARLY = 2.0, 3.0
ROUNDS, STEP_DEG = 30, 1e-4
STEPS_BACK = 8
ABOUT_S = 0.3
"""How long before and after an exposure statuses count for it."""
KEPT = 1000
"""Statuses: more than come until a frame is solved."""


class AxisTurn(NamedTuple):
    """One motion: the axis, the angle commanded, and where the tube pointed before and after.

    Places are hour angle and declination, degrees.
    """

    axis: int
    asked_deg: float
    before: tuple[float, float]
    after: tuple[float, float]


class Stood(NamedTuple):
    """Where the tube looked while the mount stood, and what it reported: hour angle and declination, degrees.

    `fast_deg` is the mount's sidereal clock ahead of the true one.
    """

    looks: tuple[float, float]
    told: tuple[float, float]
    fast_deg: float


class Meaning(NamedTuple):
    """What reports are taken to mean, and where the mount stood."""

    reports: Literal["sky", "horizon", "axes"]
    stood: list[Stood]
    senses: tuple[int, int] = (1, 1)

    @property
    def looks(self) -> list[tuple[float, float]]:
        """Where the tube looked, by the mount's own clock where it reports the sky."""
        by_clock = 1.0 if self.reports == "sky" else 0.0
        return [(one.looks[0] + by_clock * one.fast_deg, one.looks[1]) for one in self.stood]

    def geometry(self, bare: AxisGeometry) -> AxisGeometry:
        """Return a geometry with this meaning, without zero points."""
        first, second = self.senses
        return msgspec.structs.replace(bare, reports=self.reports, first_sense=first, second_sense=second)

    def ahead_deg(self, bare: AxisGeometry, latitude_deg: float) -> Array:
        """Return by how much reported angles are ahead of the axes', a row a place; the first on one turn."""
        frame = AxisFrame(self.geometry(bare), latitude_deg)
        rows = []
        for looks, one in zip(self.looks, self.stood, strict=True):
            axes, told = frame.angles(*looks), frame.of_report(*one.told)
            rows.append((told.first_deg - axes.first_deg, told.second_deg - axes.second_deg))
        ahead = np.array(rows)
        ahead[:, 0] = ahead[0, 0] + wrap180(ahead[:, 0] - ahead[0, 0])
        return ahead


class FoundAxes(NamedTuple):
    """The geometry that fits, the sense and gain of each axis' rate, and how well all fits, degrees.

    `reports_left_arcsec` is how well what the mount reports does; None where no field told.
    """

    geometry: AxisGeometry
    gains: tuple[float, float]
    left_deg: float
    reports_left_arcsec: float | None = None


def find_axes(legs: list[AxisTurn], latitude_deg: float, stood: list[Stood] | None = None) -> FoundAxes:
    """Return the axes that explain motions at a latitude. Raises SattrackError, with the reason.

    With `stood`, where the mount stood before, between and after the motions, what it reports is explained.
    """
    for leg in legs:
        _check_moved(leg)
    geometry, left, _ = _nearest(legs, latitude_deg)
    if left > FITS_DEG:
        wrong = "" if stood is None else _wrong_field(legs, latitude_deg)
        raise SattrackError(
            f"the tube does not move as two axes make it: the nearest axes leave {left:.2f}°; {wrong}is "
            "MoveAxis 0 and 1 each one axis, and does the mount stand while no rate is commanded?"
        )
    reports_left = None
    if stood is not None:
        geometry, reports_left_deg = _meant(legs, latitude_deg, stood, geometry)
        reports_left = round(3600.0 * reports_left_deg, 2)
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
    return FoundAxes(geometry, gains, left, reports_left)


def _check_moved(leg: AxisTurn) -> None:
    if separation_deg(*leg.before, *leg.after) < 0.02 * abs(leg.asked_deg):
        raise SattrackError(f"the {('first', 'second')[leg.axis]} axis does not move at its MoveAxis")


def _wrong_field(legs: list[AxisTurn], latitude_deg: float) -> str:
    """Return which field contradicts the others, in words; nothing where no single one does."""
    # The ends first: a field between two motions goes with both.
    for k in (0, len(legs), *range(1, len(legs))):
        others = [leg for j, leg in enumerate(legs) if j not in {k - 1, k}]
        if _nearest(others, latitude_deg)[1] <= FITS_DEG:
            when = f"after motion {k}" if k else "before motion 1"
            return f"the field {when} contradicts the others, as one that was solved wrongly; else, "
    return ""


def _meant(
    legs: list[AxisTurn], latitude_deg: float, stood: list[Stood], bare: AxisGeometry
) -> tuple[AxisGeometry, float]:
    """Return the geometry with what reports mean, and how well they fit, degrees.

    Of meanings that fit about as well the first is taken: the sky above all. Raises SattrackError where
    none fits.
    """
    senses = _senses(legs, latitude_deg, stood, bare)
    meanings = (Meaning("sky", stood), Meaning("horizon", stood), Meaning("axes", stood, senses))
    pole = bare.pole_azimuth_deg, bare.pole_altitude_deg
    fits = [(one, *_nearest(legs, latitude_deg, one, [pole])[:2]) for one in meanings]
    _, _, best_deg = nearest = min(fits, key=lambda fit: fit[2])
    if best_deg > REPORTS_FIT_DEG:
        raise SattrackError(
            "what the mount reports is neither the sky, nor azimuth and altitude, nor the angles of its axes:"
            f' the nearest, "{nearest[0].reports}", leaves {best_deg:.2f}°; align it anew, or not at all'
        )
    good_deg = FITS_AS_WELL * best_deg + CLEARLY * FIELD_SIGMA_DEG
    good = [fit for fit in fits if fit[2] <= good_deg]
    off = [
        max(separation_deg(*looks, *one.told) for looks, one in zip(fit[0].looks, stood, strict=True))
        for fit in good
        if fit[0].reports != "axes"
    ]
    if off and min(off) <= ALIGNED_REPORTS_DEG:
        clearly_deg = CLEARLY * (min(off) + FIELD_SIGMA_DEG)
        meaning, found, left = good[next(k for k, one in enumerate(off) if one <= clearly_deg)]
        return meaning.geometry(rounded(found)), left
    meaning, found, left = good[0]
    found = rounded(found)
    ahead = meaning.ahead_deg(found, latitude_deg)
    first, second = (
        math.remainder(sense * float(one), 360.0)
        for sense, one in zip(meaning.senses, np.mean(ahead, axis=0), strict=True)
    )
    return msgspec.structs.replace(
        meaning.geometry(found), first_zero_deg=round(first, 4), second_zero_deg=round(second, 4)
    ), left


def _senses(
    legs: list[AxisTurn], latitude_deg: float, stood: list[Stood], bare: AxisGeometry
) -> tuple[int, int]:
    """Return whether each reported angle grows with the angle of its axis, 1, or falls, -1."""
    frame = AxisFrame(bare, latitude_deg)
    along = [0.0, 0.0]
    for leg, before, after in zip(legs, stood, stood[1:], strict=False):
        k = leg.axis
        turned = frame.angles(*leg.after)[k] - frame.angles(*leg.before)[k]
        along[k] += math.remainder(turned, 360.0) * math.remainder(after.told[k] - before.told[k], 360.0)
    first, second = (1 if one >= 0.0 else -1 for one in along)
    return first, second


def rounded(geometry: AxisGeometry) -> AxisGeometry:
    """Return axes as a profile has them."""
    angles = (geometry.pole_azimuth_deg, geometry.pole_altitude_deg, geometry.axes_deg, geometry.cone_deg)
    azimuth, altitude, axes, cone = (round(angle, 4) for angle in angles)
    if altitude > AT_ZENITH_DEG:
        # An azimuth says no more there than where the first angle is 0: at the south, as usual.
        azimuth = 0.0
    return msgspec.structs.replace(
        geometry, pole_azimuth_deg=azimuth, pole_altitude_deg=altitude, axes_deg=axes, cone_deg=cone
    )


def with_axes(profile: MountProfile, found: FoundAxes, site: SitePlace) -> MountProfile:
    """Return a profile with the axes that were found at a site, and the signs of their rates.

    What was learnt about its former axes and their zero points is left out: it would count twice.
    """
    first, second = found.gains
    return msgspec.structs.replace(
        msgspec.structs.replace(profile, stands_at=site).with_geometry(rounded(found.geometry)),
        pointing=None,
        periodic=None,
        sky=None,
        additive=False,
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
    chords = [_unit(horizon, leg.after) - _unit(horizon, leg.before) for leg in legs if leg.axis == 0]
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


def _up(vector: Array, this_end: bool = False) -> tuple[float, float]:
    """Return azimuth and altitude of an axis' end above the horizon, or of `this_end` wherever it is."""
    east, north, up = vector if this_end or vector[2] >= 0.0 else -vector
    return math.degrees(math.atan2(east, north)) % 360.0, math.degrees(
        math.atan2(up, math.hypot(east, north))
    )


def _geometry(parameters: Array, meaning: Meaning | None) -> AxisGeometry:
    """Return the geometry of a pole, as a vector east, north, up, and of skew and cone in degrees.

    The axis is given by its end above the horizon. Reports that mean something count their angles from
    one end, which may be below: then it is the vector's.
    """
    azimuth, altitude = _up(parameters[:3], this_end=meaning is not None)
    most = MOST_OFF_DEG
    skew, cone = (float(max(-most, min(most, one))) for one in parameters[3:])
    return AxisGeometry(azimuth, altitude, 90.0 - skew, cone)


def _nearest(
    legs: list[AxisTurn],
    latitude_deg: float,
    meaning: Meaning | None = None,
    poles: Iterable[tuple[float, float]] | None = None,
) -> tuple[AxisGeometry, float, float]:
    """Return the axes nearest to motions, and to what reports mean; what is left, degrees, and its cost.

    `poles` are first guesses, where they are known.
    """
    poles = _first_guesses(legs, latitude_deg) if poles is None else poles
    found = [_fitted(pole, (legs, latitude_deg, meaning)) for pole in poles]
    parameters, left, cost = min(found, key=lambda one: one[2])
    return _geometry(parameters, meaning), left, cost


def _fitted(
    pole: tuple[float, float], seen: tuple[list[AxisTurn], float, Meaning | None]
) -> tuple[Array, float, float]:
    """Return the parameters from a first guess of the pole on, what is left, degrees, and what that costs.

    Gauss and Newton's steps, with skew and cone held to be small where motions do not show them.
    """
    azimuth, altitude = (math.radians(angle) for angle in pole)
    level = math.cos(altitude)
    vector = [level * math.sin(azimuth), level * math.cos(azimuth), math.sin(altitude), 0.0, 0.0]
    now: Array = np.array(vector)
    left, cost, left_deg = _left(now, *seen)
    for _ in range(ROUNDS):
        basis = _tangents(now[:3])
        columns = [_left(_stepped(now, basis, np.eye(4)[k] * STEP_DEG), *seen)[0] for k in range(4)]
        jacobian = (np.array(columns).T - left[:, None]) / STEP_DEG
        step: Array = np.linalg.lstsq(jacobian, -left, rcond=None)[0].astype(np.float64)
        for _ in range(STEPS_BACK):
            there = _stepped(now, basis, step)
            left_there, cost_there, left_deg_there = _left(there, *seen)
            if cost_there < cost:
                break
            step = 0.5 * step
        else:
            break
        done = cost - cost_there < 1e-9 * cost
        now, left, cost, left_deg = there, left_there, cost_there, left_deg_there
        if done:
            break
    return now, left_deg, cost


def _tangents(pole: Array) -> tuple[Array, Array]:
    aside = np.cross(pole, [0.0, 0.0, 1.0] if abs(pole[2]) < 0.9 else [1.0, 0.0, 0.0])
    aside /= np.linalg.norm(aside)
    return aside, np.cross(pole, aside)


def _stepped(parameters: Array, basis: tuple[Array, Array], step: Array) -> Array:
    pole = parameters[:3] + np.radians(step[0]) * basis[0] + np.radians(step[1]) * basis[1]
    return np.concatenate([pole / np.linalg.norm(pole), parameters[3:] + step[2:]])


def _left(
    parameters: Array, legs: list[AxisTurn], latitude_deg: float, meaning: Meaning | None
) -> tuple[Array, float, float]:
    """Return what motions, reports and presumptions leave, in sigmas, the sum of its squares, and its RMS.

    That is of the motions, or of the reports where these are taken to mean something; degrees.
    """
    geometry = _geometry(parameters, meaning)
    frame = AxisFrame(geometry, latitude_deg)
    rows = []
    # Angles that are reported say all that is known of the turns.
    turns = legs if meaning is None or meaning.reports != "axes" else ()
    # Most motions begin where another ended.
    places = {place for leg in turns for place in (leg.before, leg.after)}
    angles = {place: frame.angles(*place) for place in places}
    for leg in turns:
        before, after = angles[leg.before], angles[leg.after]
        if leg.axis == 0:
            rows.append(after.second_deg - before.second_deg)
        else:
            across = math.cos(math.radians(0.5 * (after.second_deg + before.second_deg)))
            turned = math.remainder(after.first_deg - before.first_deg, 360.0)
            rows.append(turned * across)
        # Axes that do not reach a place say nothing of their angles there.
        rows.append(separation_deg(*leg.after, *frame.direction(*after[:2])))
    misfit, count = np.array(rows), len(legs)
    sigma_deg = PLACE_SIGMA_DEG
    if meaning is not None:
        ahead = meaning.ahead_deg(geometry, latitude_deg)
        ahead -= np.mean(ahead, axis=0)
        ahead[:, 0] *= [math.cos(math.radians(frame.angles(*looks).second_deg)) for looks in meaning.looks]
        misfit, count, sigma_deg = ahead.ravel(), len(ahead), FIELD_SIGMA_DEG
        rows += misfit.tolist()
    left = np.array([*(np.array(rows) / sigma_deg), *(parameters[3:] / SQUARE_SIGMA_DEG)])
    return left, float(left @ left), float(np.sqrt(np.sum(misfit * misfit) / count))


class AxesFinder(Driver):
    """Makes the motions with one mount, and keeps where it pointed; `legs` is complete once `done`."""

    def __init__(
        self,
        profile: MountProfile,
        limits: SafetyLimits,
        site: tuple[float, float],
        begin_utc_s: float,
        fastest_deg_s: tuple[float, float] | None = None,
        camera: tuple[FieldCamera, FieldSky] | None = None,
    ) -> None:
        fastest = fastest_deg_s or (profile.ra.max_rate_deg_s, profile.dec.max_rate_deg_s)
        self._rates = tuple(min(LEG_DEG_S, 0.8 * one) for one in fastest)
        motion_deg = None if camera is None else MOST_MOVED * LEG_DEG
        self.probe = ProbeSafety(profile, limits, site, REACH_DEG, STOP_DEG, motion_deg)
        super().__init__(profile, self.probe)
        self.legs: list[AxisTurn] = []
        self.stood: list[Stood] | None = None if camera is None else []
        """Where the mount stood before, between and after the motions, by the fields of a camera."""
        self._camera = camera
        self._wait = None if camera is None else FieldWait(camera[0])
        self._plan: tuple[tuple[int, float], ...] = LEGS if camera is None else SEEN_LEGS
        self.trouble: SattrackError | None = None
        """Why the motions ended before their time."""
        self.done = False
        self._begin_utc_s = self._now_s = begin_utc_s
        self._wanted: Motion = Hold()
        self._places: list[tuple[float, float, float, float]] = []
        """Instant, hour angle, declination and sidereal time of the last statuses."""
        self._begun = camera is None
        self._script = self._run()

    @property
    def part_done(self) -> float:
        """The part of the motions that is made."""
        return 1.0 if self.done else len(self.legs) / len(self._plan)

    @property
    def phase(self) -> str:
        """What goes on, in words."""
        return "turning one axis after the other" if self._begun else "waiting for the camera's first field"

    def receive(self, data: bytes, arrival_utc_s: float) -> StatusSample | None:
        """Take one datagram from the mount."""
        sample = super().receive(data, arrival_utc_s)
        if sample is not None:
            sidereal_deg = sample.sidereal_h * 15.0
            self._places.append((arrival_utc_s, sidereal_deg - sample.ra_deg, sample.dec_deg, sidereal_deg))
            del self._places[:-KEPT]
        return sample

    def tick(self, now_utc_s: float) -> bytes:
        """Return the datagram to send now; call once a period."""
        self._now_s = now_utc_s
        self.link_state = self.session.link_state(now_utc_s)
        if self.trouble is None and not self.done:
            self._go_on()
        ending = self.trouble is not None or self.done
        self.session.apply(self.clear(Stop() if ending else self._wanted, now_utc_s))
        if self.safety.tripped is not None:
            self.end(SafetyLimitError(limit_text(self.safety.tripped)))
        if ending and self.stop is None:
            self.stop = StopProcedure(now_utc_s, needed=bool(self.legs) or not isinstance(self._wanted, Hold))
        return self.compose(now_utc_s)

    def end(self, trouble: SattrackError) -> None:
        """Bring the mount to rest, for a reason; the first one is kept."""
        self.trouble = self.trouble or trouble

    def _go_on(self) -> None:
        if self.link_state is LinkState.LOST:
            self.end(LinkLostError("the mount is not heard any more"))
            return
        try:
            next(self._script)
        except StopIteration:
            self.done = True
        except SattrackError as error:
            self.end(error)

    def _run(self) -> Iterator[None]:
        yield from self._for(STANDS_S + SETTLES_S)
        if not self._places:
            raise LinkLostError("the mount has not been heard")
        before = None
        if self._camera is not None:
            # Nothing is moved, not even kept still, before it is known where the tube looks.
            first = yield from self._field("before the first motion", None)
            if abs(first.told[1]) > TOLD_POLE_DEG:
                raise SattrackError(
                    f"the mount reports a declination of {first.told[1]:.0f}°: so near a pole reports do not "
                    "show how far a motion leads; turn the second axis by 10° or more, and begin again"
                )
            self.probe.see_field(first.looks, first.told)
            before, self._begun = first.looks, True
        self._wanted = MoveAxes(SIDEREAL_RATE_DEG_S, 0.0)
        place = yield from self._stand("before the first motion", before)
        for number, (axis, part) in enumerate(self._plan, 1):
            rate = math.copysign(self._rates[axis], part)
            begun_s = self._now_s
            self._wanted = (
                MoveAxes(SIDEREAL_RATE_DEG_S - rate, 0.0)
                if axis == 0
                else MoveAxes(SIDEREAL_RATE_DEG_S, rate)
            )
            yield from self._for(LEG_DEG * abs(part / rate))
            asked_deg = rate * (self._now_s - begun_s)
            self._wanted = MoveAxes(SIDEREAL_RATE_DEG_S, 0.0)
            after = yield from self._stand(f"after motion {number}", place)
            self.legs.append(AxisTurn(axis, asked_deg, place, after))
            if self.stood is not None:
                _check_moved(self.legs[-1])
                _check_reported(self.stood[-2], self.stood[-1], number)
            place = after

    def _stand(self, when: str, before: Place | None) -> Generator[None, None, Place]:
        """Wait until the mount stands; return where it points, by a field where there is a camera."""
        place = yield from self._stands()
        if self.stood is None:
            return place
        field = yield from self._field(when, before)
        if separation_deg(*place, *field.told) > FITS_DEG:
            raise SattrackError(f"{when} the mount moves where it should stand: switch tracking off")
        self.stood.append(field)
        self.probe.see_field(field.looks, field.told)
        return field.looks

    def _field(self, when: str, before: Place | None) -> Generator[None, None, Stood]:
        """Wait for the field of a frame that begins from here on.

        It is not farther from the one `before` than a motion leads. Where there was none, two in a row must
        be alike: all limits are judged by it.
        """
        assert self._wait is not None
        self._wait.begin(self._now_s)
        within_deg, wrong = (ALIKE_DEG if before is None else STRAYS_DEG), None
        while True:
            for frame in self._wait.look(self._now_s):
                field = self._stood(frame)
                apart_deg = math.inf if before is None else separation_deg(*before, *field.looks)
                if apart_deg <= within_deg:
                    return field
                if within_deg == ALIKE_DEG:
                    before = field.looks
                else:
                    wrong = f"the field is {apart_deg:.1f}° from the one before, farther than a motion leads"
            trouble = self._wait.trouble(self._now_s)
            if trouble is not None:
                raise SattrackError(f"{when}: {wrong or trouble}")
            yield

    def _stood(self, frame: Solved) -> Stood:
        """Return where a frame looks, and what was reported about its exposure."""
        assert self._camera is not None
        sky, sample = self._camera[1], self.session.sample
        if sample is not None and sample.does_refraction:
            sky = replace(sky, air=None)
        hour_angle, dec, sidereal = sky.seen(frame)
        near = [one for one in self._places if abs(one[0] - frame.utc_s) <= 0.5 * frame.exposure_s + ABOUT_S]
        near = near or self._places[-1:]
        fast = [one[3] - SIDEREAL_RATE_DEG_S * (one[0] - frame.utc_s) for one in near]
        ahead = [math.remainder(one - sidereal, 360.0) for one in fast]
        return Stood((hour_angle, dec), _mean(near), sum(ahead) / len(ahead))

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
                raise LinkLostError("the mount is heard too rarely")
            first, last = seen[0], seen[-1]
            drift_deg_s = separation_deg(*first[1:3], *last[1:3]) / (last[0] - first[0])
        return _mean(seen)


def _mean(seen: list[tuple[float, float, float, float]]) -> Place:
    turns = seen[0][1]
    mean = turns + sum(math.remainder(one[1] - turns, 360.0) for one in seen) / len(seen)
    return mean, sum(one[2] for one in seen) / len(seen)


def _check_reported(before: Stood, after: Stood, number: int) -> None:
    """Raise SattrackError where the mount's reports do not show a motion."""
    angles = [math.remainder(b - a, 360.0) for a, b in zip(before.told, after.told, strict=True)]
    if math.hypot(*angles) < FOLLOWS * separation_deg(*before.looks, *after.looks):
        raise SattrackError(f"what the mount reports does not follow motion {number} of its tube")
