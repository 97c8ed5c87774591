"""How well observations tell where a satellite is: the estimator against orbits that are integrated.

python bench/bias.py [--seeds N] [--days D] [--satellite NAME] [--few N [--sigma ARCSEC]]

The satellites are integrated step by step with forces that SGP4 does not have (`bench/integrated.py`); their
elements are fitted to two days of tracking as a catalogue does, and are then up to D days old. Of every pass
over Leiden comes one plate solution a second with noise of 3″ an axis. *taken*: the share that was taken.
*NIS*: the mean squared distance of a solution from what was expected of it, 2 where sigmas are right.
*along*, *across*: the share of readings within two of their own sigmas, after 10, 30, 60, 120 and all
solutions. *end*, *30 s*: the error on the sky, RMS, with the last solution, and 30 s after one.

Last a satellite that has manoeuvred since its elements were made, 13 days ago: a minute late, kilometres from
its orbit, 33 solutions in 192 s.
"""

from __future__ import annotations

import argparse
import math
import random
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from integrated import Air, IntegratedMotion, catalogued, follow, true_propagator

from sattrack.control.estimate import GATE, Estimator
from sattrack.control.target import Course
from sattrack.runtime import demo_pass
from sattrack.runtime.facts import choose_pass
from sattrack.views.messages import ObservationMessage
from tle.bias import NO_BIAS, Bias
from tle.instants import DAY_S, Utc
from tle.observed import bias_from_observation
from tle.orbit_fit import CorrectableOrbit
from tle.propagator import Propagator

if TYPE_CHECKING:
    from collections.abc import Iterator

    from tle.elements import Elements
    from tle.site import Site

SIGMA_ARCSEC = 3.0
LOOKED_AT = (10, 30, 60, 120)
AHEAD_S = 30.0
TRACKED_DAYS = 2.2
SATELLITES = {
    "420 km": (demo_pass.elements(), Air(0.006)),
    "550 km": (replace(demo_pass.elements(), mean_motion_rev_day=15.06, inclination_deg=53.05), Air(0.02)),
    "1340 km": (replace(demo_pass.elements(), mean_motion_rev_day=12.81, inclination_deg=66.04), Air(0.004)),
}
MANOEUVRES_KM = ((-1.0, 0.0, 0.0), (-2.0, 0.0, 2.0), (-4.0, 1.0, 1.0), (2.0, 2.0, 0.0), (4.0, 0.0, 2.0))
"""Of the semi-major axis and the eccentricity vector."""
LATE_KM = -460.0


@dataclass(frozen=True)
class Scene:
    """A satellite's true orbit, and the elements that a catalogue has of it."""

    elements: Elements
    motion: IntegratedMotion
    site: Site

    @classmethod
    def of(cls, name: str, days: float) -> Scene:
        """Integrate one of the satellites until so many days after the epoch of its elements."""
        elements, air = SATELLITES[name]
        epoch_s = float(elements.epoch.unix_s)
        motion = IntegratedMotion(elements, epoch_s - TRACKED_DAYS * DAY_S, epoch_s + days * DAY_S, air)
        return cls(catalogued(elements, motion, epoch_s), motion, demo_pass.SITE.place())

    def passes(self, from_days: float, to_days: float) -> Iterator[tuple[float, float]]:
        """Yield rise and set at 10° of the passes so many days after the epoch, UTC as POSIX seconds."""
        epoch_s = float(self.elements.epoch.unix_s)
        at_s, end_s = epoch_s + from_days * DAY_S, epoch_s + to_days * DAY_S
        while at_s < end_s:
            found = choose_pass(self.elements, self.site, Utc(at_s), 10.0)
            assert found.rise_utc is not None
            assert found.set_utc is not None
            rise_s, set_s = math.ceil(float(found.rise_utc.unix_s)), math.floor(float(found.set_utc.unix_s))
            if set_s < end_s and set_s - rise_s > 150.0:
                yield rise_s, set_s
            at_s = set_s + 60.0


@dataclass
class Tally:
    """What became of the solutions of some passes."""

    passes: int = 0
    solutions: int = 0
    taken: int = 0
    begun_anew: int = 0
    nis: list[float] = field(default_factory=list)
    along: list[float] = field(default_factory=list)
    """Errors of the reading in its own sigmas."""
    across: list[float] = field(default_factory=list)
    end_arcsec: list[float] = field(default_factory=list)
    ahead_arcsec: list[float] = field(default_factory=list)
    end_along_s: list[float] = field(default_factory=list)

    def row(self, name: str) -> str:
        """Return the figures in a line."""
        along, across = (100.0 * np.mean(np.abs(off) <= 2.0) for off in (self.along, self.across))
        end, ahead = (
            math.sqrt(float(np.mean(np.square(off)))) for off in (self.end_arcsec, self.ahead_arcsec)
        )
        return (
            f"{name:<16} {self.passes:6d} {self.solutions:9d} {100.0 * self.taken / self.solutions:7.2f} "
            f"{np.mean(self.nis):6.2f} {along:6.1f} {across:7.1f} {end:6.2f} {ahead:6.2f}"
        )


HEAD = "                 passes solutions   taken    NIS  along  across    end   30 s"


def follow_pass(
    tally: Tally,
    believed: Propagator,
    motion: IntegratedMotion,
    instants: list[float],
    rng: random.Random,
    set_s: float,
    sigma_arcsec: float = SIGMA_ARCSEC,
) -> Estimator:
    """Let an estimator have a solution at each instant; note how it fares."""
    true = true_propagator(motion, believed.site)
    astrometric = follow(true.with_place("astrometric"), motion)
    course = Course(believed)
    estimator = Estimator(believed.elements.catalog_number, instants[0] - 1.0)
    tally.passes += 1
    for n, utc_s in enumerate(instants, start=1):
        place = astrometric.at(Utc(utc_s))
        seen = noisy(float(place.ra_deg), float(place.dec_deg), utc_s, rng, sigma_arcsec)
        if estimator.filter is not None:
            tally.nis.append(estimator.distance(seen, course))
        tally.taken += estimator.take(seen, utc_s + 0.5, course, NO_BIAS)
        tally.solutions += 1
        if n in LOOKED_AT or utc_s == instants[-1]:
            _look(tally, estimator, course, true, utc_s, min(utc_s + AHEAD_S, set_s))
    _look_at_end(tally, estimator, course, true, instants[-1])
    tally.begun_anew += estimator.begun_anew
    return estimator


def _look(
    tally: Tally, estimator: Estimator, course: Course, true: Propagator, utc_s: float, ahead_s: float
) -> None:
    read = estimator.reading(utc_s, course)
    if read is None:
        return
    seen = true.at(Utc(utc_s))
    is_so = bias_from_observation(course.airless, float(seen.ra_deg), float(seen.dec_deg), Utc(utc_s))
    cross_km = course.going(utc_s + is_so.along_s).range_km * math.tan(math.radians(is_so.cross_deg))
    tally.along.append((read.along_s - is_so.along_s) / read.along_sigma_s)
    tally.across.append((read.cross_km - cross_km) / read.cross_sigma_km)
    tally.ahead_arcsec.append(_off_arcsec(estimator, course, true, ahead_s))


def _look_at_end(tally: Tally, estimator: Estimator, course: Course, true: Propagator, utc_s: float) -> None:
    tally.end_arcsec.append(_off_arcsec(estimator, course, true, utc_s))
    read, seen = estimator.reading(utc_s, course), true.at(Utc(utc_s))
    is_so = bias_from_observation(course.airless, float(seen.ra_deg), float(seen.dec_deg), Utc(utc_s))
    tally.end_along_s.append(math.nan if read is None else read.along_s - is_so.along_s)


def _off_arcsec(estimator: Estimator, course: Course, true: Propagator, utc_s: float) -> float:
    read = estimator.reading(utc_s, course)
    if read is None:
        return math.nan
    range_km = course.going(utc_s + read.along_s).range_km
    bias = Bias(read.along_s, math.degrees(math.atan(read.cross_km / range_km)))
    apart = float(np.linalg.norm(course.airless.at(Utc(utc_s), bias).unit - true.at(Utc(utc_s)).unit))
    return math.degrees(2.0 * math.asin(0.5 * apart)) * 3600.0


def manoeuvred(tally: Tally, moved_km: tuple[float, float, float], seed: int) -> None:
    """Follow a satellite that is a minute late by 13-day-old elements, and has left their orbit."""
    elements, air = SATELLITES["550 km"]
    site = demo_pass.SITE.place()
    found = choose_pass(elements, site, Utc(float(elements.epoch.unix_s) + 13.0 * DAY_S), 25.0)
    assert found.rise_utc is not None
    rise_s = math.ceil(float(found.rise_utc.unix_s))
    orbit = CorrectableOrbit(elements, Utc(rise_s))
    off = np.array([LATE_KM, *moved_km, 0.3, -0.3])
    motion = IntegratedMotion(orbit.corrected(off), rise_s - 300.0, rise_s + 900.0, air)
    instants = [round(rise_s + 30.0 + 6.0 * i, 3) for i in range(33)]
    follow_pass(tally, Propagator(elements, site), motion, instants, random.Random(seed), instants[-1])


def true_satellite(elements: Elements, site: Site, ahead_s: float) -> Propagator:
    """Return a satellite that runs ahead of its elements by so many seconds, their epoch being earlier."""
    return Propagator(replace(elements, epoch=Utc(float(elements.epoch.unix_s) - ahead_s)), site)


def solution(true: Propagator, utc_s: float, rng: random.Random, sigma_arcsec: float) -> ObservationMessage:
    """Return a plate solution of the true satellite at an instant, its noise drawn."""
    seen = true.with_place("astrometric").at(Utc(utc_s))
    return noisy(float(seen.ra_deg), float(seen.dec_deg), utc_s, rng, sigma_arcsec)


def noisy(
    ra_deg: float, dec_deg: float, utc_s: float, rng: random.Random, sigma_arcsec: float
) -> ObservationMessage:
    """Return an astrometric place with noise, as a message."""
    noise_deg = sigma_arcsec / 3600.0
    north_deg = rng.gauss(0.0, noise_deg)
    east_deg = rng.gauss(0.0, noise_deg) / math.cos(math.radians(dec_deg))
    return ObservationMessage(
        Utc(utc_s).isoformat("microseconds"),
        (ra_deg + east_deg) % 360.0,
        dec_deg + north_deg,
        "icrs",
        sigma_arcsec,
    )


def few(name: str, options: argparse.Namespace) -> str:
    """Return how far the satellite is from its prediction after a few solutions about culmination, a line."""
    scene, tally = Scene.of(name, options.days), Tally()
    believed = Propagator(scene.elements, scene.site)
    for rise_s, set_s in scene.passes(0.02, options.days - 0.01):
        middle_s = round(0.5 * (rise_s + set_s))
        instants = [float(middle_s + second) for second in range(options.few)]
        for seed in range(options.seeds):
            rng = random.Random(f"few {name} {rise_s} {seed}")
            follow_pass(tally, believed, scene.motion, instants, rng, set_s, options.sigma)
    off = np.array(tally.end_arcsec)
    return (
        f"{name}, up to {options.days:g} d, after {options.few} solutions of {options.sigma:g}″: "
        f"{np.median(off):.1f}″ (50 %), {np.quantile(off, 0.95):.1f}″ (95 %), {off.max():.1f}″ at most "
        f"of {tally.passes} passes"
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--days", type=float, default=5.0)
    parser.add_argument("--satellite", choices=[*SATELLITES])
    parser.add_argument("--few", type=int, metavar="N", help="only so many solutions, about culmination")
    parser.add_argument("--sigma", type=float, default=20.0, metavar="ARCSEC", help="of each of those")
    options = parser.parse_args()
    if options.few is not None:
        print(few(options.satellite or "420 km", options))
        return
    print(f"a solution a second, {SIGMA_ARCSEC:g}″ an axis, gate {GATE:g}, {options.seeds} seeds")
    print(HEAD, flush=True)
    for name in SATELLITES if options.satellite is None else [options.satellite]:
        scene = Scene.of(name, options.days)
        believed = Propagator(scene.elements, scene.site)
        for day in range(math.ceil(options.days)):
            tally = Tally()
            for rise_s, set_s in scene.passes(day + 0.02, min(day + 1.0, options.days - 0.01)):
                instants = [float(second) for second in range(int(rise_s), int(set_s))]
                for seed in range(options.seeds):
                    rng = random.Random(f"{name} {rise_s} {seed}")
                    follow_pass(tally, believed, scene.motion, instants, rng, set_s)
            print(tally.row(f"{name}, {day}-{day + 1} d"), flush=True)
    print("manoeuvred, km                       taken of   begun anew   along at the end, s (worst)")
    for moved_km in MANOEUVRES_KM:
        tally = Tally()
        for seed in range(10 * options.seeds):
            manoeuvred(tally, moved_km, seed)
        worst = max(map(abs, tally.end_along_s))
        print(f"{moved_km!s:<32} {tally.taken:9d} {tally.solutions:5d} {tally.begun_anew:9d} {worst:15.4f}")


if __name__ == "__main__":
    main()
