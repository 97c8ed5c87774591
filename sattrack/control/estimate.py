"""Observations that arrive from outside, made into an estimate of the biases: checked, gated, filtered. Pure.

An observation is held against where the satellite was predicted at the observation's own instant, without any
bias: how late it comes does not matter. What contradicts the estimate is rejected; where many in a row agree
among themselves instead, and are no less likely by the elements alone, the estimate begins anew with them.

A Kalman filter of a satellite's biases, along its track and across it, fed by single observations.

State: along-track bias in seconds, as `tle.bias` has it, and how far the satellite is off across its track
in km: what is constant over a pass is a distance, not the angle under which it is seen. A measurement is what
one observation says of both, at its own instant; filterpy does the algebra. The biases are nearly constant:
the process noise is so small that over a pass the sigma falls as that of a mean does.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from filterpy.kalman import KalmanFilter

from sattrack.views.messages import MOST_SIGMA_ARCSEC, Observation
from tle.bias import Bias
from tle.instants import Utc
from tle.residuals import apparent_unit

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from sattrack.control.course import Course
    from tle.propagator import Propagator
    from tle.residuals import Frame


@dataclass(frozen=True, slots=True)
class BiasNoise:
    """What is expected of elements before and between observations, one sigma."""

    along_s: float = 0.0
    cross_km: float = 0.0
    """What is expected to begin with."""
    first_along_s: float = 30.0
    """Elements are seconds late or early, after a manoeuvre a minute."""
    first_cross_km: float = 1.0
    along_walk_sqrt_s: float = 5e-6
    cross_walk_km_sqrt_s: float = 3e-5
    gate: float = 18.4
    """Squared Mahalanobis distance that one good observation in ten thousand exceeds (two dimensions)."""


class BiasFilter:
    """Estimate of both biases; it changes with accepted observations alone, so it outlasts their end."""

    def __init__(self, noise: BiasNoise | None = None) -> None:
        self._noise = noise or BiasNoise()
        kalman = KalmanFilter(dim_x=2, dim_z=2)
        kalman.P = np.diag([self._noise.first_along_s**2, self._noise.first_cross_km**2])
        kalman.x = np.array([[self._noise.along_s], [self._noise.cross_km]])
        kalman.H = np.eye(2)
        self._kalman = kalman
        self._last_utc_s: float | None = None
        self.accepted = 0
        self.rejected = 0

    @property
    def along_s(self) -> float:
        """Along-track bias, seconds."""
        return float(self._kalman.x[0, 0])

    @property
    def cross_km(self) -> float:
        """Distance across the track, km."""
        return float(self._kalman.x[1, 0])

    @property
    def along_sigma_s(self) -> float:
        """Uncertainty of the along-track bias, one sigma."""
        return math.sqrt(float(self._kalman.P[0, 0]))

    @property
    def cross_sigma_km(self) -> float:
        """Uncertainty of the cross-track bias, one sigma."""
        return math.sqrt(float(self._kalman.P[1, 1]))

    def distance(self, along_s: float, cross_km: float, along_sigma_s: float, cross_sigma_km: float) -> float:
        """Return how far what an observation says lies from the estimate: squared Mahalanobis distance."""
        gap = np.array([along_s - self.along_s, cross_km - self.cross_km])
        spread = self._kalman.P + np.diag([along_sigma_s**2, cross_sigma_km**2])
        return float(gap @ np.linalg.solve(spread, gap))

    def observe(
        self, utc_s: float, along_s: float, cross_km: float, along_sigma_s: float, cross_sigma_km: float
    ) -> bool:
        """Take what one observation at an instant says of both biases; tell whether the gate let it through.

        One that comes late counts like any other: the biases hardly move.
        """
        seconds = 0.0 if self._last_utc_s is None else max(0.0, utc_s - self._last_utc_s)
        noise = self._noise
        walk = np.diag([noise.along_walk_sqrt_s**2, noise.cross_walk_km_sqrt_s**2]) * seconds
        if not self.distance(along_s, cross_km, along_sigma_s, cross_sigma_km) <= noise.gate:
            self.rejected += 1
            return False
        self._kalman.predict(Q=walk)
        self._last_utc_s = utc_s if self._last_utc_s is None else max(utc_s, self._last_utc_s)
        self._kalman.update(
            np.array([[along_s], [cross_km]]), R=np.diag([along_sigma_s**2, cross_sigma_km**2])
        )
        self.accepted += 1
        return True


FUTURE_S = 0.1
"""How far ahead of now an observation may be dated: clocks differ by that much."""
MOST_ALONG_S = 90.0
MOST_STEP_S = 20.0
MOST_STEPS = 12
NEAR_S = 0.01
DIFFERENCE_S = 0.1
MODEL_ARCSEC = 2.0
"""How well two constants describe a satellite over a pass, and clocks an instant: no sigma counts as less."""
ANEW_AFTER = 8
LIKELY_CROSS_KM = 0.3
"""How far elements are off across the track, one sigma: that hardly grows with their age."""
BETTER_FRAME = 9.0
"""How much nearer, as a squared distance, the first observation may lie in another frame than its own."""
FRAMES: dict[str, Frame] = {"icrs": "icrf", "j2000": "j2000", "of_date": "of_date"}


class BiasReading(NamedTuple):
    """What one observation says of the biases, with one sigma each."""

    along_s: float
    cross_km: float
    along_sigma_s: float
    cross_sigma_km: float


class Estimator:
    """The estimate of one run's biases, from the observations handed to it.

    `accepted` were taken, `rejected` contradicted elements or estimate, `refused` could not be of this pass.
    """

    def __init__(self, catalog_number: int, start_utc_s: float) -> None:
        self._catalog_number = catalog_number
        self._start_utc_s = start_utc_s
        self._noise = BiasNoise()
        self.filter: BiasFilter | None = None
        self._rival: BiasFilter | None = None
        self.accepted = 0
        self.rejected = 0
        self.refused = 0
        self.begun_anew = 0
        self.words: str | None = None
        """Why the last observation was not taken; None where it was."""
        self.last_utc_s: float | None = None
        """Instant of the newest observation that was taken."""

    def warm_up(self, course: Course, end_utc_s: float) -> None:
        """Have everything computed once that the first observation of a pass would have to wait for."""
        for utc_s in (self._start_utc_s, end_utc_s):
            seen = course.airless.at(Utc(utc_s))
            known = BiasFilter()
            text = Utc(utc_s).isoformat()
            sample = Observation(text, float(seen.ra_deg), float(seen.dec_deg), "icrs", MOST_SIGMA_ARCSEC)
            said = _said(sample, utc_s, course, "icrs", (0.0, 0.0))
            if said is not None:
                known.observe(utc_s, *said)

    def forget(self) -> None:
        """Begin anew with the next observation."""
        self.filter = self._rival = None

    def take(self, seen: Observation, now_utc_s: float, course: Course, first: Bias) -> bool:
        """Take one observation in; tell whether it changed the estimate.

        `first` is what is fed without an estimate: the first observation is expected around that, or around
        what the elements say by themselves.
        """
        utc_s = float(Utc.parse(seen.utc).unix_s)
        self.words = self._refusal(seen, utc_s, now_utc_s)
        if self.words is not None:
            self.refused += 1
            return False
        if self.filter is None:
            range_km = course.going(utc_s + first.along_s).range_km
            cross_km = range_km * math.tan(math.radians(first.cross_deg))
            self._noise = BiasNoise(along_s=first.along_s, cross_km=cross_km)
        said = _said(seen, utc_s, course, seen.frame, self._expected())
        if said is None or not abs(said.along_s) <= MOST_ALONG_S:
            self.words = "it lies nowhere near the satellite's track: another satellite's?"
        elif self.filter is None:
            self._begin(seen, utc_s, said, course)
        elif not self.filter.observe(utc_s, *said):
            self.words = f"it contradicts the estimate{self._hint(seen, utc_s, course)}"
            self._challenge(seen, utc_s, said, course)
        else:
            self._rival = None
        if self.words is not None:
            self.rejected += 1
            return False
        self.accepted += 1
        self.last_utc_s = max(utc_s, self.last_utc_s or utc_s)
        return True

    def _refusal(self, seen: Observation, utc_s: float, now_utc_s: float) -> str | None:
        if seen.catalog_number is not None and seen.catalog_number != self._catalog_number:
            return f"it is of satellite {seen.catalog_number}; {self._catalog_number} is followed"
        if utc_s > now_utc_s + FUTURE_S:
            return f"it is dated {utc_s - now_utc_s:.1f} s in the future: check the clocks"
        if utc_s < self._start_utc_s:
            return f"it is of {seen.utc}, before the pass"
        return None

    def _expected(self) -> tuple[float, float]:
        known = self.filter
        if known is None:
            return self._noise.along_s, self._noise.cross_km
        return known.along_s, known.cross_km

    def _begin(self, seen: Observation, utc_s: float, said: BiasReading, course: Course) -> None:
        fresh = self._plausible(seen, utc_s, said, course)
        if fresh is None:
            self.words = f"the elements are not so far off{self._hint(seen, utc_s, course)}"
        self.filter = fresh

    def _plausible(
        self, seen: Observation, utc_s: float, said: BiasReading, course: Course
    ) -> BiasFilter | None:
        """Return a filter that begins with an observation, where elements can be so far off."""
        distance, start = self._likeliest(said)
        other = _other_frame(seen.frame)
        alternative = _said(seen, utc_s, course, other, (said.along_s, self._noise.cross_km))
        if not distance <= self._noise.gate:
            return None
        if alternative is not None and self._likeliest(alternative)[0] + BETTER_FRAME < distance:
            return None
        # What was likely has done its work: the estimate itself is to rest on observations alone.
        fresh = BiasFilter(start)
        return fresh if fresh.observe(utc_s, *said) else None

    def _likeliest(self, said: BiasReading) -> tuple[float, BiasNoise]:
        """Return how far an observation lies from the elements or from what the operator found, and which."""
        about = (
            (replace(start, first_cross_km=LIKELY_CROSS_KM), start) for start in (BiasNoise(), self._noise)
        )
        distances = ((BiasFilter(likely).distance(*said), start) for likely, start in about)
        return min(distances, key=lambda one: one[0])

    def _challenge(self, seen: Observation, utc_s: float, said: BiasReading, course: Course) -> None:
        """Hold what was rejected against what was rejected just before, and begin anew where that agrees."""
        rival = self._rival
        if rival is None or not rival.observe(utc_s, *said):
            rival = self._rival = self._plausible(seen, utc_s, said, course)
        if rival is not None and rival.accepted >= ANEW_AFTER:
            self.filter, self._rival, self.words = rival, None, None
            self.begun_anew += 1

    def _hint(self, seen: Observation, utc_s: float, course: Course) -> str:
        """Say what would explain an observation that does not fit."""
        other = _other_frame(seen.frame)
        said = _said(seen, utc_s, course, other, self._expected())
        if said is None:
            return ": another satellite's?"
        distance = self._likeliest(said)[0] if self.filter is None else self.filter.distance(*said)
        if distance < self._noise.gate:
            return f": in the frame {other} it would fit"
        return ": another satellite's, or in another frame?"


def _other_frame(frame: str) -> str:
    return "icrs" if frame == "of_date" else "of_date"


def _said(
    seen: Observation,
    utc_s: float,
    course: Course,
    frame: str,
    expected: tuple[float, float],
) -> BiasReading | None:
    """Return what an observation says of the biases, by Newton's method from what is expected of them.

    None where no bias along the track leads near it.
    """
    t = Utc(utc_s)
    propagator = course.propagator if frame == "of_date" else course.airless
    observed = apparent_unit(seen.ra_deg, seen.dec_deg, t, FRAMES[frame], propagator.site, propagator.earth)
    along_s, cross_km = expected
    for _ in range(MOST_STEPS):
        range_km = course.going(utc_s + along_s).range_km
        cross_deg = math.degrees(math.atan(cross_km / range_km))
        here, later, sooner = (
            _unit(propagator, t, along_s + step_s, cross_deg) for step_s in (0.0, DIFFERENCE_S, -DIFFERENCE_S)
        )
        by_along = (later - sooner) / (2.0 * DIFFERENCE_S)
        by_along = by_along - (by_along @ here) * here
        pace = math.sqrt(float(by_along @ by_along))
        if not pace > 0.0:
            return None
        ahead, left = by_along / pace, np.cross(here, by_along / pace)
        height = max(-1.0, min(1.0, float(observed @ left)))
        step_s = math.atan2(float(observed @ ahead), float(observed @ here)) / pace
        along_s += max(-MOST_STEP_S, min(MOST_STEP_S, step_s))
        if abs(step_s) < NEAR_S:
            range_km = course.going(utc_s + along_s).range_km
            cross_km = range_km * math.tan(math.radians(cross_deg) + math.asin(height))
            sigma = math.radians(math.hypot(seen.sigma_arcsec, MODEL_ARCSEC) / 3600.0)
            return BiasReading(along_s, cross_km, sigma / pace, sigma * range_km)
    return None


def _unit(propagator: Propagator, t: Utc, along_s: float, cross_deg: float) -> NDArray[np.float64]:
    seen = propagator.at(t, Bias(along_s, cross_deg))
    ra, dec = math.radians(float(seen.ra_deg)), math.radians(float(seen.dec_deg))
    return np.array([math.cos(dec) * math.cos(ra), math.cos(dec) * math.sin(ra), math.sin(dec)])
