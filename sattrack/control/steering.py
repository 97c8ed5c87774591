"""What the operator and observers say, turned into offsets of the direction that is fed. Pure.

Observations that arrive from outside, made into an estimate of the biases: checked, gated, filtered. Pure.

An observation is held against where the satellite was predicted at the observation's own instant, without
any bias: how late it comes does not matter. What contradicts the estimate is rejected; where many in a row
agree among themselves instead, and are no less likely by the elements alone, the estimate begins anew with
them.

A Kalman filter of a satellite's biases, along its track and across it, fed by single observations.

State: along-track bias in seconds, as `tle.bias` has it, and how far the satellite is off across its track
in km: what is constant over a pass is a distance, not the angle under which it is seen. A measurement is
what one observation says of both, at its own instant; filterpy does the algebra. The biases are nearly
constant: the process noise is so small that over a pass the sigma falls as that of a mean does.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import msgspec
import numpy as np
from filterpy.kalman import KalmanFilter

from sattrack.control.biases import (
    Biases,
    begin_search,
    change_offset,
    clear_biases,
    end_reached,
    end_search,
    follow_estimate,
    forget_estimate,
    nudge_biases,
)
from sattrack.views.messages import (
    MOST_SIGMA_ARCSEC,
    ClearBias,
    DropRemembered,
    Nudge,
    Observation,
    OffsetBy,
    Search,
)
from tle.bias import Bias, apparent_unit
from tle.instants import Utc

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from sattrack.control.biases import Course
    from sattrack.mount.model import MountProfile
    from sattrack.views.messages import Message
    from sattrack.views.run import RememberedView
    from tle.bias import Frame
    from tle.propagator import Propagator

REACTION_PERIODS = 3.0
REFUSAL_SHOWN_S = 5.0


class Steering:
    """The offsets and the estimate of one run, and what was last not done of what was asked."""

    def __init__(
        self,
        propagator: Propagator,
        profile: MountProfile,
        bias: Bias,
        camera_rotation_deg: float,
        start_utc_s: float,
        remembered: RememberedView | None = None,
    ) -> None:
        self._delay_s = REACTION_PERIODS * profile.period_s + profile.command_delay_s
        self.biases = Biases(bias, propagator, profile, camera_rotation_deg)
        self.estimator = Estimator(propagator.elements.catalog_number, start_utc_s)
        self.refusal: str | None = None
        """Why the operator's last word was not obeyed, in words."""
        self._refused_utc_s = float("-inf")
        self._begun_s = float("-inf")
        self._estimated = False
        """Whether the estimate is news that is not followed yet."""
        self._following_estimate = False
        self._remembered = remembered
        if remembered is not None and remembered.cross_km is not None:
            self.biases.begin_estimated(remembered.along_s, remembered.cross_km)

    @property
    def remembered(self) -> RememberedView | None:
        """The bias of an earlier pass, and what became of it."""
        known = self._remembered
        if known is None or known.state != "in force" or not self._following_estimate:
            return known
        return msgspec.structs.replace(known, state="replaced")

    def obey(self, message: Message, now_utc_s: float) -> None:
        """Do what a message says of offsets; others are none of its business."""
        begins_s, answer = self._begins_s(now_utc_s), None
        match message:
            case Observation():
                self._observe(message, now_utc_s, begins_s)
                return
            case Nudge():
                answer = nudge_biases(self.biases, message.along_s, message.cross_deg, begins_s)
            case OffsetBy():
                answer = change_offset(self.biases, message, begins_s)
            case Search():
                answer = begin_search(self.biases, message, begins_s)
            case DropRemembered():
                answer = self._drop_remembered(begins_s)
            case ClearBias():
                self._end_remembered("cleared")
                self.estimator.forget()
                self._estimated = self._following_estimate = False
                clear_biases(self.biases, begins_s)
        self.tell(answer, now_utc_s)

    def keep_search(self, now_utc_s: float) -> None:
        """End a search that runs, keeping where it is."""
        begins_s = self._begins_s(now_utc_s)
        if self.biases.pattern_at(begins_s) is not None:
            end_search(self.biases, True, begins_s)

    def watch(self, now_utc_s: float) -> bool:
        """Follow the estimate where there is a new one, end what has gone as far as it may; tell of either.

        To be called once a period.
        """
        known, ended = self.estimator.filter, None
        news = known is not None and self._estimated
        if known is not None and news:
            first = not self._following_estimate
            begins_s = self._begins_s(now_utc_s)
            follow_estimate(self.biases, known.along_s, known.cross_km, first, begins_s)
            self._estimated, self._following_estimate = False, True
        if self.biases.moving:
            ended = end_reached(self.biases, self._begins_s(now_utc_s))
        if ended is not None:
            self.tell(ended, now_utc_s)
        return news or ended is not None

    def _drop_remembered(self, begins_s: float) -> str | None:
        known = self.remembered
        if known is None or known.state != "in force":
            return "no remembered bias is in force" + ("" if known is None else f": it was {known.state}")
        self._end_remembered("dropped")
        if known.cross_deg is not None:
            return nudge_biases(self.biases, -known.along_s, -known.cross_deg, begins_s)
        forget_estimate(self.biases, begins_s)
        return None

    def _end_remembered(self, state: str) -> None:
        known = self.remembered
        if known is not None and known.state == "in force":
            self._remembered = msgspec.structs.replace(known, state=state)

    def _begins_s(self, now_utc_s: float) -> float:
        """Return when a change that is asked for now begins: when a command that knows of it can act."""
        self._begun_s = max(self._begun_s, now_utc_s + self._delay_s)
        return self._begun_s

    def _observe(self, seen: Observation, now_utc_s: float, begins_s: float) -> None:
        """Take an observation in; the estimate is followed from the next period on."""
        along_s, cross_deg = self.biases.totals(begins_s)
        if self.estimator.take(seen, now_utc_s, self.biases.course, Bias(along_s, cross_deg)):
            self._estimated = True

    def tell(self, words: str | None, now_utc_s: float) -> None:
        """Keep why something was not done, until something else has been done some seconds later."""
        if words is not None or now_utc_s - self._refused_utc_s > REFUSAL_SHOWN_S:
            self.refusal, self._refused_utc_s = words, now_utc_s


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
            said = _reading(sample, utc_s, course, "icrs", (0.0, 0.0))
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
        said = _reading(seen, utc_s, course, seen.frame, self._expected())
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
        alternative = _reading(seen, utc_s, course, other, (said.along_s, self._noise.cross_km))
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
        said = _reading(seen, utc_s, course, other, self._expected())
        if said is None:
            return ": another satellite's?"
        distance = self._likeliest(said)[0] if self.filter is None else self.filter.distance(*said)
        if distance < self._noise.gate:
            return f": in the frame {other} it would fit"
        return ": another satellite's, or in another frame?"


def _other_frame(frame: str) -> str:
    return "icrs" if frame == "of_date" else "of_date"


def _reading(
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
