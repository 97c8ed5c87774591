"""Mounts whose axes point anywhere, each followed for a minute in virtual time; and their axes found.

python bench/axes_anywhere.py [--draws N] [--first N] [--jobs N] [--only follow|find] [--links N] [--verbose]

The drives, timers, links and passes are those of `bench/family.py`, with the mounts of `bench/strangers`.
What such a mount calls hour angle and declination are the angles of its axes, and these point anywhere: drawn
at random, with either sense and any zero. Half of the mounts report those angles, the others right ascension
and declination of where the tube points. That is computed by the rotations of `strangers/alpaca_two_axes.py`
and by ERFA, which know nothing of this program. Each draw is followed with those axes, and by the same drives
as an equatorial mount. That one follows a table of directions of which the hour angles and declinations are
the angles of the first one's axes: both sets of drives are asked the same. The error is that of the tube on
the sky. Which datagrams are lost or late is chance, and may hit one of both in the worst moment: with
`--links` both are followed so many times, each time by other chances.

Axes are found twice: by the reports of mounts that report the sky, and by fields of a camera on mounts that
report the sky, azimuth and altitude, or angles of axes, with zero points and a sidereal clock that is off.
The camera is made up: where the tube looks in the mean of an exposure, as ERFA has it in the ICRS, with noise
of 2". The errors of poles are compared with what such fields allow at all (Cramér and Rao's bound).
"""

from __future__ import annotations

import argparse
import functools
import math
import multiprocessing
import random
import statistics
import struct
import sys
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import erfa
import family
import msgspec
import numpy as np
from strangers.alpaca_two_axes import Parameters, Telescope

from sattrack.calibration.axes_in_space import AxesFinder, find_axes
from sattrack.control.engine import Engine
from sattrack.control.target import TargetState, sky_error
from sattrack.core.errors import SattrackError
from sattrack.mount.geometry import AxisFrame, AxisGeometry
from sattrack.mount.model import MountProfile, SitePlace
from sattrack.pointing.fields import FieldSky, Solved
from sattrack.safety import SafetyLimits
from tle.formats.ephemerides import parse_ephemerides
from tle.instants import Utc
from tle.propagator import Propagator

if TYPE_CHECKING:
    from collections.abc import Sequence

STRANGERS = ("velocity_servo", "position_servo", "planner")
STATUS_PLACE = struct.Struct("<24xd8xd8xd")
"""Where a status has declination, right ascension and sidereal time."""
FASTEST_DEG_S, WIDEST_DEG, STEEPEST_DEG = 3.0, 150.0, 80.0
"""Passes through a keyhole, or round the back, are no equatorial mount's either."""
BOUND = 1.5
PLANNED_S, SPARE_S = 600.0, 10.0
"""For so long a run of `bench/family.py` is planned; the table has so much more at either end."""
ROW_S = 0.5
"""Between rows of the table that an equatorial mount follows."""
CHANCES = 10_000
"""What is added to a draw's number for other chances."""
FOLLOWED_EVERY = 10
"""One mount of so many is followed with by the axes that were found."""
ANYWHERE = SafetyLimits(floor_altitude_deg=-90.0, optical=False)
LOOKED_AT, MOST_TOLD_DEG = 40, 78.0
LEAST_ARCSEC = 0.02
"""About what the encoders and the dates of samples allow: smaller errors count as this."""


class AxesDraw(NamedTuple):
    """Axes in space, and how the drives' angles count on them."""

    drawn: family.Draw
    geometry: AxisGeometry
    senses: tuple[int, int]
    zeros_deg: tuple[float, float]
    ahead_deg: tuple[float, float] = (0.0, 0.0)
    """By how much the angles of a reported direction are ahead of the axes'."""
    clock_s: float = 0.0
    """The mount's sidereal clock ahead."""


class Tube:
    """Where drives of certain angles point a tube, by a stranger's rotations and ERFA."""

    def __init__(self, axes: AxesDraw) -> None:
        own = axes.geometry
        self._latitude_deg = axes.drawn.site.latitude_deg
        self._counts = tuple(zip(axes.senses, axes.zeros_deg, strict=True))
        self._axes = axes
        self._telescope = Telescope(
            Parameters(
                latitude_deg=self._latitude_deg,
                pole_azimuth_deg=own.pole_azimuth_deg,
                pole_altitude_deg=own.pole_altitude_deg,
                axes_deg=own.axes_deg,
                cone_deg=own.cone_deg,
            ),
            0.0,
        )

    def horizontal(self, first_deg: float, second_deg: float) -> tuple[float, float]:
        """Return azimuth and altitude of the tube, degrees, from the angles of the drives."""
        first, second = (
            sense * (angle - zero)
            for angle, (sense, zero) in zip((first_deg, second_deg), self._counts, strict=True)
        )
        # It counts the first angle from the other end of the meridian.
        self._telescope.angles = [first - 180.0, second]
        return self._telescope.horizontal()

    def sky(self, first_deg: float, second_deg: float) -> tuple[float, float]:
        """Return hour angle and declination of the tube, degrees, from the angles of the drives."""
        azimuth, altitude = (math.radians(angle) for angle in self.horizontal(first_deg, second_deg))
        hour_angle, dec = erfa.ae2hd(azimuth, altitude, math.radians(self._latitude_deg))
        return math.degrees(hour_angle), math.degrees(dec)

    def status(self, status: bytes, clock_h: float = 0.0) -> bytes:
        """Return the drives' status with what the mount reports, by a sidereal clock that is so far ahead."""
        dec, ra_h, sidereal_h = STATUS_PLACE.unpack_from(status)
        hour_angle, dec = self.told(15.0 * (sidereal_h - ra_h), dec)
        # What reports the sky knows it; the others make right ascensions of hour angles by their clocks.
        by_clock_h = 0.0 if self._axes.geometry.reports == "sky" else clock_h
        ra_h = (sidereal_h + by_clock_h - hour_angle / 15.0) % 24.0
        packed = bytearray(status)
        for offset, value in ((24, dec), (40, ra_h), (56, (sidereal_h + clock_h) % 24.0)):
            struct.pack_into("<d", packed, offset, value)
        return bytes(packed)

    def told(self, first_deg: float, second_deg: float) -> tuple[float, float]:
        """Return the hour angle, by a clock that is right, and the declination that the mount reports."""
        axes = self._axes
        if axes.geometry.reports == "axes":
            return first_deg, second_deg
        (first, second), (first_sense, second_sense) = axes.ahead_deg, axes.senses
        return self.sky(first_deg + first_sense * first, second_deg + second_sense * second)


def draw(number: int) -> AxesDraw:
    """Draw a mount and its axes; the same number gives the same ones."""
    drawn = family.draw(number, STRANGERS)
    rng = random.Random(f"axes {number}")
    # Friction depends on which way an axis turns, and when it turns round: another axis has another.
    hardware = replace(drawn.hardware, additive=False, stiction=0.0, ripple=0.0)
    while True:
        pole_altitude = math.degrees(math.asin(rng.uniform(-1.0, 1.0)))
        geometry = AxisGeometry(
            rng.uniform(0.0, 360.0),
            pole_altitude,
            90.0 + rng.choice((0.0, rng.uniform(-2.0, 2.0))),
            rng.choice((0.0, rng.uniform(-1.0, 1.0))),
            reports=("sky", "axes")[number % 2],
        )
        path = _path(drawn, AxisFrame(geometry, drawn.site.latitude_deg))
        rates = np.max(np.abs(path[:, 2:]))
        if rates < FASTEST_DEG_S and np.max(np.abs(path[:, 0])) < WIDEST_DEG:
            break
    senses = (rng.choice((1, -1)), rng.choice((1, -1)))
    zeros = (rng.uniform(-30.0, 30.0), rng.uniform(-5.0, 5.0))
    # The drives' declination stays one that can be reported.
    if np.max(np.abs(path[:, 1])) > STEEPEST_DEG:
        zeros = (zeros[0], 0.0)
    stands = (
        path[0, 0] + rng.uniform(-20.0, 20.0),
        max(-80.0, min(80.0, path[0, 1] + rng.uniform(-20.0, 20.0))),
    )
    angles = tuple(zero + sense * angle for zero, sense, angle in zip(zeros, senses, stands, strict=True))
    drawn = replace(drawn, hardware=hardware, stands=(angles[0], angles[1]))
    return AxesDraw(drawn, geometry, senses, zeros)


def _path(drawn: family.Draw, frame: AxisFrame, instants_s: Sequence[float] = ()) -> Any:
    """Return angles and rates of the axes, a row an instant; all over the run where none are given."""
    propagator = Propagator(drawn.elements, drawn.site)
    step_s = family.LASTS_S / family.LOOKS
    rows = []
    for utc_s in instants_s or [drawn.start_s + k * step_s for k in range(family.LOOKS + 1)]:
        seen = propagator.at(Utc(utc_s))
        rows.append(frame.angles(seen.ha_deg, seen.dec_deg, seen.ha_rate_deg_s, seen.dec_rate_deg_s))
    return np.array(rows)


def profile_of(axes: AxesDraw) -> MountProfile:
    """Return what a calibration knows of the drives, and the axes."""
    hard = axes.drawn.hardware
    known = family.profile_of(hard, "truth")
    # A commanded rate of the stranger's turns the angle that it counts by its own sign.
    signs = [sign * sense for sign, sense in zip(hard.signs, axes.senses, strict=True)]
    site = axes.drawn.site
    return msgspec.structs.replace(
        known,
        geometry=known_geometry(axes),
        ra_rate_sign=signs[0],
        dec_rate_sign=signs[1],
        hour_angle_limit_deg=360.0,
        stands_at=SitePlace(site.latitude_deg, site.longitude_deg),
    )


def known_geometry(axes: AxesDraw) -> AxisGeometry:
    """Return the axes as a profile has them: with what the mount's reports mean."""
    if axes.geometry.reports != "axes":
        first, second = axes.ahead_deg
        return msgspec.structs.replace(axes.geometry, first_zero_deg=first, second_zero_deg=second)
    return msgspec.structs.replace(
        axes.geometry,
        first_sense=axes.senses[0],
        second_sense=axes.senses[1],
        first_zero_deg=axes.zeros_deg[0],
        second_zero_deg=axes.zeros_deg[1],
    )


class SkyStranger(family.Stranger):
    """A stranger that reports where its tube points, or the angles of its drives."""

    def __init__(self, axes: AxesDraw) -> None:
        super().__init__(axes.drawn)
        self._tube, self._clock_h = Tube(axes), axes.clock_s / 3600.0

    def turn(self) -> bytes:
        return self._tube.status(super().turn(), self._clock_h)


class AxesRun(family.Run):
    """One draw, with its own axes."""

    def __init__(
        self, axes: AxesDraw, profile: MountProfile | None = None, limits: SafetyLimits | None = None
    ) -> None:
        super().__init__(axes.drawn, profile=profile or profile_of(axes))
        if limits is not None:
            self.engine = Engine(replace(self.engine.spec, limits=limits))
        self.mount = SkyStranger(axes)
        self.tube_deg: list[tuple[float, float, float]] = []
        """Instant, azimuth and altitude of the tube, at every turn of the mount."""
        self._tube, self._reports_sky = Tube(axes), axes.geometry.reports == "sky"

    def _judge(self, truth: family.Axes) -> None:
        angles = truth.hour_angle_deg, truth.dec_axis_deg
        self.tube_deg.append((truth.utc_s, *self._tube.horizontal(*angles)))
        hour_angle, dec = self._tube.sky(*angles)
        sidereal = truth.ra_deg + truth.hour_angle_deg
        errors = []
        for utc_s in (truth.utc_s + self.dated_late_s, truth.utc_s):
            seen = self.propagator.at(Utc(utc_s))
            # What reports the sky is steered by what it reports: its sidereal clock is its own.
            target = float(seen.ra_deg) if self._reports_sky else -float(seen.ha_deg)
            ours = sidereal - hour_angle if self._reports_sky else -hour_angle
            goal = TargetState(target, float(seen.dec_deg), 0.0, 0.0)
            errors.append(sky_error(utc_s, ours, dec, goal).total_arcsec)
        self.errors.append(family.Error(truth.utc_s, *errors))


class Followed(NamedTuple):
    """RMS errors with a mount's own axes and as an equatorial one, arcseconds; NaN where never acquired."""

    number: int
    own_arcsec: float
    equatorial_arcsec: float
    hardware: family.Hardware
    why: str

    @property
    def ratio(self) -> float:
        """The error over the equatorial mount's, neither less than LEAST_ARCSEC."""
        return max(self.own_arcsec, LEAST_ARCSEC) / max(self.equatorial_arcsec, LEAST_ARCSEC)


def equatorial(axes: AxesDraw) -> family.Draw:
    """Return the same drives as an equatorial mount, which follows what asks the same of them."""
    drawn, site = axes.drawn, axes.drawn.site
    begin_s = drawn.begin_s - SPARE_S
    count = round((drawn.start_s + PLANNED_S + SPARE_S - begin_s) / ROW_S)
    instants_s = [begin_s + ROW_S * k for k in range(count)]
    path = np.radians(_path(drawn, AxisFrame(axes.geometry, site.latitude_deg), instants_s))
    seen_deg = np.degrees(erfa.hd2ae(path[:, 0], path[:, 1], math.radians(site.latitude_deg)))
    rows = ["utc,alt_deg,az_deg"]
    for utc_s, azimuth, altitude in zip(instants_s, *seen_deg, strict=True):
        rows.append(f"{Utc(utc_s).isoformat('microseconds')},{altitude:.9f},{azimuth:.9f}")
    (table,) = parse_ephemerides("\n".join(rows).encode(), "axes.csv", site)
    stands = [
        sense * (angle - zero)
        for angle, sense, zero in zip(drawn.stands, axes.senses, axes.zeros_deg, strict=True)
    ]
    return replace(drawn, elements=table, stands=(stands[0], stands[1]))


def follow(number: int, links: int = 1) -> Followed:
    """Follow a draw with both."""
    axes = draw(number)
    plain, own, by_slew, why = equatorial(axes), [], [], ""
    for link in range(links):
        chances = number + CHANCES * link
        run = AxesRun(axes._replace(drawn=replace(axes.drawn, number=chances))).run()
        own.append(run.settled_rms_arcsec())
        by_slew.append(family.Run(replace(plain, number=chances), "truth").run().settled_rms_arcsec())
        why = why if run.ended_by is None else f"{run.ended_by}: {run.message}"
    own_rms, by_slew_rms = (math.hypot(*errors) / math.sqrt(links) for errors in (own, by_slew))
    return Followed(number, own_rms, by_slew_rms, axes.drawn.hardware, why)


EXPOSURE_S, SOLVED_S = 1.0, 0.4
UNIX_EPOCH_JD = 2440587.5


class Found(NamedTuple):
    """How far a found geometry's axes are from the true ones; NaN and the reason where none was found."""

    number: int
    pole_deg: float
    axes_deg: float
    cone_deg: float
    own_arcsec: float
    true_arcsec: float
    why: str


class Finding(AxesRun):
    """The motions by which a draw's axes are found."""

    def __init__(self, axes: AxesDraw, camera: MadeUpCamera | None = None) -> None:
        super().__init__(axes)
        self.camera = camera
        self.engine = finder_of(axes, ANYWHERE, camera)  # type: ignore[assignment]

    def _client_turn(self, now_s: float, _: Any) -> None:
        finder: Any = self.engine
        if self.camera is not None:
            self.camera.tube_deg, self.camera.now_s = self.tube_deg, now_s
        self._command(now_s, finder.tick(now_s))
        self._at(now_s + family.PERIOD_S, self._client_turn, None)
        self.ended_by = "done" if finder.finished else None


class MadeUpCamera:
    """Exposes one frame after the other; `now_s` and `tube_deg` are those of the run that it sees."""

    source = "made up"

    def __init__(self, site: Any, seed: int, sigma_arcsec: float = 2.0) -> None:
        self.now_s, self.tube_deg = math.nan, [(math.nan, 0.0, 0.0)]
        self.ended = False
        self.wrong: dict[int, tuple[float, float] | None] = {}
        """What frames are solved as, by number, where not truly; None: not solved."""
        self._site, self._due_s, self._number = site, -math.inf, 0
        self._sigma_rad = math.radians(sigma_arcsec / 3600.0)
        self._rng = np.random.default_rng(seed)

    def poll(self) -> list[Solved]:
        """Return a frame whose exposure is over since a while."""
        if self.now_s < self._due_s:
            return []
        begun_s, ended_s = self.now_s - SOLVED_S - EXPOSURE_S, self.now_s - SOLVED_S
        self._due_s, self._number = self.now_s + EXPOSURE_S, self._number + 1
        seen = [one[1:] for one in self.tube_deg if begun_s <= one[0] <= ended_s]
        utc_s = 0.5 * (begun_s + ended_s)
        if not seen:
            return [Solved(utc_s, EXPOSURE_S, None)]
        icrs = self.wrong[self._number] if self._number in self.wrong else self._icrs(np.radians(seen), utc_s)
        return [Solved(utc_s, EXPOSURE_S, icrs)]

    def _icrs(self, horizontal: Any, utc_s: float) -> tuple[float, float]:
        mean = np.mean([erfa.s2c(azimuth, altitude) for azimuth, altitude in horizontal], axis=0)
        azimuth, altitude = erfa.c2s(erfa.pn(mean)[1] + self._rng.normal(0.0, self._sigma_rad, 3))
        ra, dec = erfa.atoc13(
            "A", azimuth, math.pi / 2.0 - altitude, UNIX_EPOCH_JD, utc_s / 86400.0, 0.0,
            math.radians(self._site.longitude_deg), math.radians(self._site.latitude_deg),
            self._site.height_m, 0.0, 0.0, 0.0, 0.0, 0.0, 0.55,
        )  # fmt: skip
        return math.degrees(ra), math.degrees(dec)


def finder_of(axes: AxesDraw, limits: SafetyLimits, camera: MadeUpCamera | None = None) -> AxesFinder:
    """Return what finds a draw's axes: it is told of the drives, and of the site."""
    plain = msgspec.structs.replace(
        profile_of(axes), geometry=None, ra_rate_sign=1, dec_rate_sign=1, ra_rate_gain=1.0, dec_rate_gain=1.0
    )
    site = axes.drawn.site
    fields = None if camera is None else (camera, FieldSky(site, None))
    place = (site.latitude_deg, site.longitude_deg)
    return AxesFinder(plain, limits, place, axes.drawn.begin_s, camera=fields)


def draw_to_find(number: int) -> AxesDraw:
    """Return a draw that reports the sky, not near where its first axis points: no angle is known there."""
    axes = draw(number)
    rng = random.Random(f"find {number}")
    stands = (axes.drawn.stands[0], axes.zeros_deg[1] + rng.uniform(-55.0, 55.0))
    return axes._replace(
        geometry=msgspec.structs.replace(axes.geometry, reports="sky"),
        drawn=replace(
            axes.drawn,
            stands=stands,
            start_s=axes.drawn.begin_s + 300.0,
            hardware=replace(axes.drawn.hardware, tracking=False),
        ),
    )


def draw_meaning(axes: AxesDraw) -> AxesDraw:
    """Return a draw whose reports mean something that is drawn."""
    rng = random.Random(f"meaning {axes.drawn.number}")
    reports = ("sky", "axes", "horizon")[axes.drawn.number % 3]
    zeros = reports != "axes" and rng.random() < 0.5
    axes = axes._replace(geometry=msgspec.structs.replace(axes.geometry, reports=reports))
    while zeros:
        axes = axes._replace(ahead_deg=(rng.uniform(-180.0, 180.0), rng.uniform(-8.0, 8.0)))
        # Nearer to a pole, reports do not show how far a motion leads.
        zeros = abs(Tube(axes).told(*axes.drawn.stands)[1]) > MOST_TOLD_DEG
    return axes


class FoundByFields(NamedTuple):
    """What fields told of a draw: its pole, what it reports near where it was, and all over; degrees."""

    number: int
    meaning: tuple[str, str]
    """As drawn and as found."""
    pole_deg: float
    allowed_deg: float
    """Least standard error of the pole."""
    near_deg: float
    far_deg: float
    own_arcsec: float
    true_arcsec: float
    why: str


def find_by_fields(number: int) -> FoundByFields:
    """Find axes and meaning of a draw, and follow with what was found."""
    axes = draw_meaning(draw_to_find(number))
    axes = axes._replace(clock_s=random.Random(f"clock {number}").uniform(-20.0, 20.0))
    drawn = axes.geometry.reports
    run = Finding(axes, MadeUpCamera(axes.drawn.site, number)).run()
    finder: Any = run.engine
    try:
        if finder.trouble is not None:
            raise finder.trouble
        found = find_axes(finder.legs, axes.drawn.site.latitude_deg, finder.stood)
    except SattrackError as error:
        return FoundByFields(number, (drawn, ""), *(math.nan,) * 6, str(error))
    own = true = math.nan
    if number % FOLLOWED_EVERY == 0:
        followed = draw_meaning(draw(number))
        signs = [1 if gain > 0.0 else -1 for gain in found.gains]
        profile = profile_of(followed).with_geometry(found.geometry)
        profile = msgspec.structs.replace(profile, ra_rate_sign=signs[0], dec_rate_sign=signs[1])
        own = AxesRun(followed, profile=profile).run().settled_rms_arcsec()
        true = AxesRun(followed).run().settled_rms_arcsec()
    return FoundByFields(
        number,
        (drawn, found.geometry.reports),
        poles_apart_deg(found.geometry, axes.geometry),
        least_pole_error_deg(axes, [(leg.axis, leg.asked_deg) for leg in finder.legs]),
        reports_off_deg(axes, found.geometry, 10.0),
        reports_off_deg(axes, found.geometry, 60.0),
        own,
        true,
        "",
    )


def least_pole_error_deg(axes: AxesDraw, turns: list[tuple[int, float]]) -> float:
    """Return the least standard error of the pole that fields of 2" allow while axes turn like that.

    Unknown are the pole, the angle between the axes and the cone (within a degree), and both angles at first;
    but for mounts that report angles of axes each turn, too.
    """
    own, step = axes.geometry, 1e-4
    first = [s * (a - z) for a, s, z in zip(axes.drawn.stands, axes.senses, axes.zeros_deg, strict=True)]
    known = profile_of(axes)
    turns = [(axis, (known.ra_rate_sign, known.dec_rate_sign)[axis] * turn) for axis, turn in turns]
    told = own.reports == "axes"
    count = 6 if told else 6 + len(turns)

    def fields(unknown: Any) -> Any:
        across = math.cos(math.radians(own.pole_altitude_deg))
        telescope = Telescope(
            Parameters(
                latitude_deg=axes.drawn.site.latitude_deg,
                pole_azimuth_deg=own.pole_azimuth_deg + unknown[0] / across,
                pole_altitude_deg=own.pole_altitude_deg + unknown[1],
                axes_deg=own.axes_deg + unknown[2],
                cone_deg=own.cone_deg + unknown[3],
            ),
            0.0,
        )
        angles = [first[0] - 180.0 + unknown[4], first[1] + unknown[5]]
        places = [telescope.direction(angles)]
        for k, (axis, turn) in enumerate(turns):
            angles[axis] += turn + (0.0 if told else unknown[6 + k])
            places.append(telescope.direction(angles))
        return np.degrees(np.ravel(places))

    there = fields(np.zeros(count))
    slopes = np.array([(fields(step * row) - there) / step for row in np.eye(count)])
    information = slopes @ slopes.T * (3600.0 / 2.0) ** 2
    information[2, 2] += 1.0
    information[3, 3] += 1.0
    covariance = np.linalg.inv(information)
    return math.sqrt(covariance[0, 0] + covariance[1, 1])


def reports_off_deg(axes: AxesDraw, found: AxisGeometry, within_deg: float) -> float:
    """Return by how much a found geometry's reports are off the mount's, RMS, so far about its place."""
    tube, frame = Tube(axes), AxisFrame(found, axes.drawn.site.latitude_deg)
    rng, fast_deg = random.Random(axes.drawn.number), axes.clock_s / 240.0
    off = []
    while len(off) < LOOKED_AT:
        angles = [one + rng.uniform(-within_deg, within_deg) for one in axes.drawn.stands]
        second = angles[1] - axes.zeros_deg[1]
        if abs(second) > STEEPEST_DEG - abs(axes.ahead_deg[1]):
            continue
        (looks, dec), (told, told_dec) = tube.sky(*angles), tube.told(*angles)
        # A mount's hour angle is its clock's time less its right ascension, and that is the sky's or not.
        told += fast_deg if axes.geometry.reports == "sky" else 0.0
        looks += fast_deg if found.reports == "sky" else 0.0
        there, there_dec = frame.reported(*frame.angles(looks, dec)[:2])
        across = math.cos(math.radians(second if axes.geometry.reports == "axes" else told_dec))
        off.append(math.hypot(math.remainder(there - told, 360.0) * across, there_dec - told_dec))
    return math.sqrt(sum(one * one for one in off) / len(off))


def poles_apart_deg(one: AxisGeometry, other: AxisGeometry) -> float:
    """Return the angle between two first axes, whichever of their ends they are given by."""
    angles = [(own.pole_azimuth_deg, own.pole_altitude_deg) for own in (one, other)]
    apart = math.degrees(erfa.seps(*(math.radians(angle) for pair in angles for angle in pair)))
    return min(apart, 180.0 - apart)


def find(number: int) -> Found:
    """Find the axes of a draw that reports the sky, and follow with what was found."""
    axes = draw_to_find(number)
    run = Finding(axes).run()
    finder: Any = run.engine
    try:
        if finder.trouble is not None:
            raise finder.trouble
        found = find_axes(finder.legs, axes.drawn.site.latitude_deg)
    except SattrackError as error:
        return Found(number, math.nan, math.nan, math.nan, math.nan, math.nan, str(error))
    followed = draw(number)
    followed = followed._replace(geometry=msgspec.structs.replace(followed.geometry, reports="sky"))
    signs = [1 if gain > 0.0 else -1 for gain in found.gains]
    profile = msgspec.structs.replace(
        profile_of(followed),
        geometry=found.geometry,
        ra_rate_sign=signs[0],
        dec_rate_sign=signs[1],
    )
    follows = number % FOLLOWED_EVERY == 0
    return Found(
        number,
        poles_apart_deg(found.geometry, axes.geometry),
        found.geometry.axes_deg - axes.geometry.axes_deg,
        abs(found.geometry.cone_deg) - abs(axes.geometry.cone_deg),
        AxesRun(followed, profile=profile).run().settled_rms_arcsec() if follows else math.nan,
        AxesRun(followed).run().settled_rms_arcsec() if follows else math.nan,
        "",
    )


def tell_followed(followed: list[Followed]) -> None:
    """Print how mounts were followed with."""
    ratios = sorted(one.ratio for one in followed if math.isfinite(one.ratio))
    near = sum(ratio <= BOUND for ratio in ratios)
    print(f"followed with: {len(ratios)} of {len(followed)} mounts; error over the equatorial one's:")
    print(f"  median {statistics.median(ratios):.2f}, most {ratios[-1]:.2f}, within {BOUND}: {near}")
    for name, own in (
        ("no datagram lost or late", lambda hard: not hard.loss and not hard.jitter_s),
        ("some lost or late", lambda hard: hard.loss or hard.jitter_s),
    ):
        some = [one for one in followed if own(one.hardware)]
        print(f"  {name}: {sum(one.ratio <= BOUND for one in some)} of {len(some)} within {BOUND}")


def tell_found(found: list[Found]) -> None:
    """Print how well axes were found."""
    known = [one for one in found if not one.why]
    print(f"found: {len(known)} of {len(found)} mounts")
    for name, offs in (
        ("pole", [one.pole_deg for one in known]),
        ("angle between the axes", [abs(one.axes_deg) for one in known]),
        ("cone", [abs(one.cone_deg) for one in known]),
    ):
        print(f"{name} off by: median {3600 * statistics.median(offs):.2f}″, most {3600 * max(offs):.2f}″")
    ratios = [max(one.own_arcsec, LEAST_ARCSEC) / max(one.true_arcsec, LEAST_ARCSEC) for one in known]
    finite = [ratio for ratio in ratios if math.isfinite(ratio)]
    near = sum(one <= BOUND for one in finite)
    print(f"error with them over that with the true ones: {near} of {len(finite)} within {BOUND}")


def tell_found_by_fields(found: list[FoundByFields]) -> None:
    """Print how well axes and meanings were found by fields."""
    known = [one for one in found if not one.why]
    alike = sum(drawn == meant for drawn, meant in (one.meaning for one in known))
    print(f"found by fields: {len(known)} of {len(found)} mounts, {alike} with the meaning that was drawn")
    over = [one.pole_deg / one.allowed_deg for one in known]
    rms = math.sqrt(statistics.fmean(one * one for one in over))
    print(f"pole off by {rms:.2f} times what fields allow, RMS; {max(over):.1f} times at most")
    for name, part in (
        ("pole", lambda one: one.pole_deg),
        ("reports within 10°", lambda one: one.near_deg),
        ("reports within 60°", lambda one: one.far_deg),
    ):
        for drawn in ("sky", "horizon", "axes"):
            offs = [3600.0 * part(one) for one in known if one.meaning[0] == drawn]
            print(f"{name} off by, {drawn}: median {statistics.median(offs):.1f}″, most {max(offs):.1f}″")
    ratios = [(one.own_arcsec, one.true_arcsec) for one in known if math.isfinite(one.true_arcsec)]
    for one, other in ratios:
        print(f"followed with: error {one:.2f}″, {other:.2f}″ with the true ones")


def main() -> int:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--draws", type=int, default=200)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--only", choices=("follow", "find", "fields"))
    parser.add_argument("--links", type=int, default=1)
    parser.add_argument("--verbose", action="store_true")
    options = parser.parse_args()
    numbers = range(options.first, options.first + options.draws)
    parts: dict[str, tuple[Any, Any]] = {
        "follow": (functools.partial(follow, links=options.links), tell_followed),
        "find": (find, tell_found),
        "fields": (find_by_fields, tell_found_by_fields),
    }
    names = {None: tuple(parts), "find": ("find", "fields")}.get(options.only, (options.only,))
    with multiprocessing.Pool(options.jobs) as pool:
        for name in names:
            work, tell = parts[name]
            done: list[Any] = []
            for one in pool.imap(work, numbers):
                done.append(one)
                if options.verbose:
                    print(one, flush=True)
            tell(done)
    return 0


if __name__ == "__main__":
    sys.exit(main())
