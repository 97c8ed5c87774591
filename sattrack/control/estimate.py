"""Observations that arrive from outside, made into an estimate of the orbit: checked, gated, filtered. Pure.

An observation is held against the orbit that the elements have, corrected by what is known so far, at the
observation's own instant: how late it comes does not matter. `tle.orbit_filter` filters; read as biases
along and across the track, its estimate drifts and bends over a pass as errors of elements do. What
contradicts the estimate is rejected. A rival begins with what was rejected; where it explains what comes
better than the estimate does, it takes its place: no wrong start, manoeuvre or lock-out lasts.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace
from itertools import combinations
from operator import itemgetter
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from sattrack.control.camera_image import AS_SET, Deviation
from sattrack.mount.model import SkyTerms
from sattrack.views.messages import FRAMES, MOST_SIGMA_ARCSEC, ObservationMessage
from tle.bias import Bias
from tle.elements import Elements
from tle.errors import PropagationError
from tle.instants import Utc
from tle.observed import apparent_unit
from tle.orbit_filter import CAMERA_TERMS, MOUNT_TERMS, FilterBank, KnownTerms, OrbitFilter
from tle.orbit_fit import ALONG, STATES, CorrectableOrbit, Expected, Image, Sighting, cross_product

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from sattrack.control.target import Course
    from tle.propagator import Propagator

FUTURE_S = 0.1
"""How far ahead of now an observation may be dated: clocks differ by that much."""
GATE = 18.4
"""Squared Mahalanobis distance that one good observation in ten thousand exceeds (two dimensions)."""
MOST_ALONG_S = 90.0
MOST_CORRECTION_KM = 100.0
"""Beyond these no elements are off that are worth following."""
MODEL_ARCSEC = 1.0
"""How well clocks and catalogues of stars are known: no sigma counts as less."""
LEAST_SEEING_ARCSEC, USUAL_SEEING_ARCSEC, MOST_SEEING_ARCSEC = 0.3, 1.0, 20.0
"""What moves a camera's image from frame to frame beside what its sigma says: air, wind, the mount. At least,
before it is known, and at most."""
SEEING_FRAMES, FEWEST_SEEING_FRAMES, SEEING_CHOICE, SEEING_SPAN_S = 40, 8, 5, 5.0
"""It is measured by so many frames, each with two of the four before it, within such a span."""
QUARTER = 0.318
"""A quarter of frames lies so many sigmas or less from the line with the two that fit best."""
SEEING_GATE = 12.0
"""Beyond that square in sigmas a frame is a wild one."""
BELIEVED = 1.5
"""A claimed sigma is believed where frames lie off by no more than so many times as much."""
ANEW_AFTER = 8
CONFIRMED_BY = 3
FAR_DEG = 0.1
"""So many offsets have to agree before one that lies this far from what is fed begins an estimate."""
RIVAL_SHARE = 3
"""A rival takes over with so many times as many observations as the estimate took since it began."""
RIVAL_WIDER, RIVAL_NOISIER = 3.0, 1.5
"""A rival expects so many times the errors of elements of that age, and those of what is observed."""
REFUTED_BY, REFUTED_SHARE = 20, 5
"""So many rejected observations, and so many times as many as it took, refute an estimate."""
UNSURE_SHARE = 5
"""Where it rejects as many, and more than one for so many that it takes, what it says of mount and cameras is
not kept: something that it does not know of, as a camera's clock, may stand in other terms."""
MOST_UNHEARD = 50
"""Older ones begin no rival any more."""
BETTER_FRAME = 9.0
"""How much nearer, as a squared distance, the first observation may lie in another frame than its own."""
LINE_S = 2.0
"""Over so many seconds a reading is taken as a parabola."""
MOST_STEP_S = 20.0
MOST_STEPS = 12
NEAR_S, NEAR_RAD = 0.01, math.radians(5.0 / 3600.0)
DIFFERENCE_S = 0.1
FAILURES = (PropagationError, np.linalg.LinAlgError)
"""What a correction can lead to that no satellite can fly."""
SURE_SIGMAS, LEAST_SCALE = 4.0, 0.05
TELL_OF: dict[str, tuple[float, Callable[[float], str]]] = {
    "rotation_deg": (5.0, lambda deg: f"its image is turned by {deg:+.1f}° more than set"),
    "scale": (0.03, lambda share: f"its pixels are {1.0 + share:.3f} times as large as set"),
    "clock_s": (
        0.05,
        lambda s: (
            f"by its offsets its dates are {abs(s):.2f} s {'ahead' if s > 0.0 else 'behind'}: "
            "the estimate allows for it"
        ),
    ),
}
"""How much of a camera's terms is worth a warning, and the warning."""
LOST_AFTER_S = 3.0
"""So long after the last observation the target counts as lost."""
KEPT_WIDER = 1.5
LEAST_SIGMAS = {"_deg": 20.0 / 3600.0, "delay_s": 0.002, "clock_s": 0.02, "scale": 0.001}
"""What was learnt at a pass is taken for that many times less well known at the next, and never better
than the second: mounts are set up anew, cameras are turned."""


class EstimatedBiases(NamedTuple):
    """The estimate as biases at an instant: seconds along, km across, one sigma.

    Rates are what they gain a second, curves what the rates gain.
    """

    along_s: float
    cross_km: float
    along_rate: float
    cross_rate_km_s: float
    along_sigma_s: float
    cross_sigma_km: float
    along_curve: float = 0.0
    cross_curve_km_s2: float = 0.0


def known_terms(sky: SkyTerms | None) -> KnownTerms | None:
    """Return what a profile says of its mount and cameras as a pass begins; None where it says nothing."""
    if sky is None:
        return None
    cameras = {name: _expected(CAMERA_TERMS, terms) for name, terms in sky.cameras.items()}
    return KnownTerms(_expected(MOUNT_TERMS, sky.mount), cameras)


def begun_anew(sky: SkyTerms | None, utc: str, model_arcsec: float) -> SkyTerms:
    """Return what to begin passes with once a pointing model is fed: the mount points as well as that model.

    What earlier passes showed of its pointing is in the model now; delay and cameras stay.
    """
    mount = {name: (0.0, model_arcsec / 3600.0) for name in MOUNT_TERMS if name.endswith("_deg")}
    if sky is None:
        return SkyTerms(utc, mount | {"delay_s": (0.0, LEAST_SIGMAS["delay_s"])})
    return SkyTerms(utc, mount | {"delay_s": sky.mount["delay_s"]}, sky.cameras)


def _expected(
    names: tuple[str, ...], terms: dict[str, tuple[float, float]]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    pairs = np.array([terms.get(name, (0.0, 0.0)) for name in names])
    least = [next(value for end, value in LEAST_SIGMAS.items() if name.endswith(end)) for name in names]
    # What has no sigma was no question: the middle of a fine camera is what the target is centred on.
    wider = np.hypot(KEPT_WIDER * pairs[:, 1], least)
    return pairs[:, 0], np.where(pairs[:, 1] > 0.0, wider, 0.0)


def _named(
    names: tuple[str, ...], terms: tuple[NDArray[np.float64], NDArray[np.float64]]
) -> dict[str, tuple[float, float]]:
    return {
        name: (float(f"{value:.6g}"), float(f"{sigma:.3g}"))
        for name, value, sigma in zip(names, *terms, strict=True)
    }


class _Unheard(NamedTuple):
    """What a rival has to be held against: whether the estimate took it, and how many a rival needs."""

    taken: bool
    sighting: Sighting
    orbit: CorrectableOrbit
    least: int = ANEW_AFTER


class _Seeing:
    """How much the satellite's image jumps from frame to frame, by how far three frames lie off a line.

    What orbit and mount do wrong changes slowly, and has no part in it. Nor have wild frames, up to a third
    of all: of those before a frame the two that fit best count, and of all frames the nearest quarter.
    """

    def __init__(self) -> None:
        self._last: list[Sighting] = []
        self._squares: deque[tuple[float, float]] = deque(maxlen=SEEING_FRAMES)
        """Of each frame, with the two before it that fit best, and with the last two."""

    def see(self, sighting: Sighting, expected: Bias) -> None:
        """Take one frame in; about what is expected, the satellite moves by little."""
        utc_s = sighting.utc.unix_s
        if any(one.utc.unix_s == utc_s for one in self._last):
            return
        before = [one for one in self._last if abs(float(utc_s - one.utc.unix_s)) <= SEEING_SPAN_S]
        self._last = [*self._last[1 - SEEING_CHOICE :], sighting]
        if len(before) < 2:
            return
        places = [
            (float(one.utc.unix_s - utc_s), one.unit - one.propagator.at(one.utc, expected).unit)
            for one in (*before, sighting)
        ]
        pairs = combinations(places[:-1], 2)
        squares = [_off_line(*sorted((*pair, places[-1]), key=itemgetter(0))) for pair in pairs]
        self._squares.append((min(squares), squares[-1]))

    def sigma_arcsec(self, said_arcsec: float, least_arcsec: float, usual_arcsec: float) -> float:
        """Return one sigma of a frame that claims one: that and the least or the usual, or what was seen."""
        if len(self._squares) < FEWEST_SEEING_FRAMES:
            return math.hypot(said_arcsec, usual_arcsec)
        best, plain = np.array(self._squares).T
        square = float(np.quantile(best, 0.25)) / QUARTER**2
        alike = plain[plain < SEEING_GATE * square]
        if len(alike) >= FEWEST_SEEING_FRAMES // 2:
            square = 0.5 * float(np.mean(alike))
        seen = math.degrees(math.sqrt(square)) * 3600.0
        said = math.hypot(said_arcsec, least_arcsec)
        return min(seen, MOST_SEEING_ARCSEC) if seen > BELIEVED * said else said


_Place = tuple[float, "NDArray[np.float64]"]


def _off_line(first: _Place, middle: _Place, last: _Place) -> float:
    """Return the square of one sigma of three places, each of its time, by how far they lie off a line."""
    share = (last[0] - middle[0]) / (last[0] - first[0])
    off = middle[1] - share * first[1] - (1.0 - share) * last[1]
    return float(off @ off) / (1.0 + share**2 + (1.0 - share) ** 2)


class Estimator:
    """The estimate of one run's orbit, from the observations handed to it.

    `accepted` were taken, `rejected` contradicted elements or estimate, `refused` could not be of this pass.
    """

    def __init__(self, catalog_number: int, start_utc_s: float, known: KnownTerms | None = None) -> None:
        self._catalog_number = catalog_number
        self._known = known
        self._start_utc_s = start_utc_s
        self._orbit: CorrectableOrbit | None = None
        self.filter: FilterBank | None = None
        self._rival: FilterBank | None = None
        self._since_rival = 0
        """How many the estimate took since the rival began."""
        self._unheard: deque[_Unheard] = deque(maxlen=MOST_UNHEARD)
        """What no rival was held against yet, because none could have won by it."""
        self.accepted = 0
        self.rejected = 0
        self.refused = 0
        self.begun_anew = 0
        self.words: str | None = None
        """Why the last observation was not taken; None where it was."""
        self.last_utc_s: float | None = None
        """Instant of the newest observation that was taken."""
        self.deviations: dict[str, Deviation] = {}
        """How the image of each camera was found to lie otherwise than set; its terms are about that."""
        self._seeing: dict[tuple[str | None, bool], _Seeing] = {}
        """Of each camera, of directions among the stars and of places in its image."""
        self._undo: tuple[FilterBank | None, float | None] | None = None
        """What the last observation that was taken has changed; None where that is not known any more."""

    def sigma_arcsec(self, utc_s: float, course: Course) -> float | None:
        """Return how well it is known where the mount must point, one sigma in the worst direction."""
        if self.filter is None:
            return None
        try:
            _, spread = self.filter.pointing(course.airless, Utc(utc_s), True)
        except FAILURES:
            return None
        return math.degrees(math.sqrt(max(0.0, float(np.linalg.eigvalsh(spread)[-1])))) * 3600.0

    @property
    def sky_terms(self) -> SkyTerms | None:
        """What cameras have shown of the mount, and of themselves where they lie as set, for its profile."""
        known = self.filter
        if known is None or not known.cameras or self.last_utc_s is None or self._is_unsure:
            return None
        as_set = [name for name in known.cameras if name not in self.deviations]
        cameras = {name: _named(CAMERA_TERMS, known.terms(name)) for name in as_set}
        when = Utc(self.last_utc_s).isoformat("seconds")
        return SkyTerms(when, _named(MOUNT_TERMS, known.terms()), cameras)

    @property
    def _is_unsure(self) -> bool:
        return self.rejected >= REFUTED_BY and self.rejected * UNSURE_SHARE > self.accepted

    @property
    def camera_words(self) -> tuple[str, ...]:
        """How the cameras, or the mount, are not as they were set, as far as that is sure."""
        known, words = self.filter, []
        if known is None:
            return ()
        if known.knows_terms and not known.uses_known_terms:
            words.append("what earlier passes found of mount and cameras does not hold: it is left aside")
        if self._is_unsure and known.cameras:
            words.append("many of the camera's offsets contradict the others: no profile learns from them")
        for name in known.cameras:
            values, sigmas = self.found_of(name)
            mirrored = self.deviations.get(name, AS_SET).mirrored
            told = ["its image is mirrored otherwise than set: turn `flipped` round"] if mirrored else []
            for term, (least, text) in TELL_OF.items():
                if abs(values[term]) > max(least, SURE_SIGMAS * sigmas[term]):
                    told.append(text(values[term]))
            words.extend(f"camera {name or 'without a name'}: {one}" for one in told)
        return tuple(words)

    def believed_of(self, camera: str) -> Deviation:
        """Return how a camera's image is believed to lie otherwise than set."""
        more, known = self.deviations.get(camera, AS_SET), self.filter
        if known is None or camera not in known.cameras:
            return more
        turned_deg, scale, *_ = known.terms(camera)[0].tolist()
        return more.and_then(Deviation(turned_deg, max(LEAST_SCALE, 1.0 + scale)))

    def found_of(self, camera: str) -> tuple[dict[str, float], dict[str, float]]:
        """Return the terms of a camera that was seen, beyond what was set, and one sigma of each."""
        assert self.filter is not None
        values, sigmas = (
            dict(zip(CAMERA_TERMS, part.tolist(), strict=True)) for part in self.filter.terms(camera)
        )
        believed = self.believed_of(camera)
        values |= {"rotation_deg": believed.turned_deg, "scale": believed.scale - 1.0}
        if believed.clock_s:
            # Where the images show it, that is it: what is left is no more than the mount's delay.
            values["clock_s"] = believed.clock_s
        return values, sigmas

    def warm_up(self, course: Course, end_utc_s: float) -> None:
        """Have everything computed once that the first observation of a pass would have to wait for."""
        elements = _corrected_elements(course)
        if elements is None:
            return
        self._orbit_of(elements)
        for utc_s in (self._start_utc_s, end_utc_s):
            seen = course.airless.at(Utc(utc_s))
            text = Utc(utc_s).isoformat()
            sample = ObservationMessage(
                text, float(seen.ra_deg), float(seen.dec_deg), "icrs", MOST_SIGMA_ARCSEC
            )
            other = Estimator(self._catalog_number, self._start_utc_s)
            if other.take(sample, utc_s, course, Bias(0.0, 0.0)):
                other.reading(utc_s, course)

    def forget(self) -> None:
        """Begin anew with the next observation."""
        self.filter = self._undo = None
        self._end_rival()

    def reading(self, utc_s: float, course: Course, fed: bool = False) -> EstimatedBiases | None:
        """Return what the estimate says of the biases at an instant; None without one, or where it says none.

        With `fed` they lead to where the mount must be fed to, its own errors made up for where a camera on
        it has shown them.
        """
        try:
            return None if self.filter is None else _reading(self.filter, utc_s, course, fed)
        except FAILURES:
            return None

    @property
    def refuted(self) -> bool:
        """Whether so much contradicts the estimate that the elements are the better guess.

        A satellite's own observations agree with one another: a rival that begins with them wins long before.
        """
        known = self.filter
        return known is not None and known.rejected >= max(REFUTED_BY, REFUTED_SHARE * known.accepted)

    def undo(self) -> bool:
        """Give back what the last observation that was taken has changed; tell whether that was possible."""
        if self._undo is None:
            return False
        (self.filter, self.last_utc_s), self._undo = self._undo, None
        self._end_rival()
        self.accepted -= 1
        self.rejected += 1
        self.words = "it was rejected by hand"
        return True

    def take(
        self,
        seen: ObservationMessage,
        now_utc_s: float,
        course: Course,
        first: Bias,
        image: Image | None = None,
        *,
        sure: bool = False,
        patient: bool = False,
        led: bool = True,
    ) -> bool:
        """Take one observation in; tell whether it changed the estimate.

        `first` is what is fed without an estimate: the first observation is expected around that, or around
        what the elements say by themselves; around these alone where nothing that holds has `led` there. With
        `image` it was seen in a camera's image, relative to where the mount pointed. One that an operator is
        `sure` of begins an estimate where it contradicts the present one. A rival takes most of the time: who
        is `patient` leaves it to `catch_up`.
        """
        utc_s = float(Utc.parse(seen.utc).unix_s)
        self.words = None
        elements = _corrected_elements(course)
        why = self._refusal(seen, utc_s, now_utc_s)
        if elements is None or why is not None:
            self.refuse(why or "observations correct element sets only")
            return False
        before, last_s = self.filter, self.last_utc_s
        try:
            sighting = _sighting(seen, utc_s, course, seen.frame)
            sighting = self._weighed(sighting, seen, image, first)
            if before is None or before.orbit.given is not elements:
                before = None
                self._begin(seen, sighting, course, elements, first, led)
            else:
                before = self._go_on(before, seen, sighting, course)
            if sure:
                self._believe(sighting, elements)
            if not patient:
                self.catch_up(MOST_UNHEARD)
        except FAILURES as error:
            self.words = str(error)
        if self.words is not None:
            self.rejected += 1
            return False
        self._undo = before, last_s
        self.accepted += 1
        self.last_utc_s = max(utc_s, self.last_utc_s or utc_s)
        return True

    def _weighed(
        self, sighting: Sighting, seen: ObservationMessage, image: Image | None, expected: Bias
    ) -> Sighting:
        """Return a sighting with the sigma that its frame has beside those before it."""
        seeing = self._seeing.setdefault((seen.camera, image is not None), _Seeing())
        seeing.see(sighting, expected)
        least, usual = (MODEL_ARCSEC,) * 2 if image is None else (LEAST_SEEING_ARCSEC, USUAL_SEEING_ARCSEC)
        sigma_arcsec = seeing.sigma_arcsec(seen.sigma_arcsec, least, usual)
        return replace(sighting, image=image, sigma_rad=math.radians(sigma_arcsec / 3600.0))

    def catch_up(self, most: int = 1) -> bool:
        """Hold so many observations against the rival where it may win by them; tell whether it did."""
        estimate = self.filter
        for _ in range(most):
            if not (self._unheard and self._may_win()):
                break
            try:
                self._hear_rival(self._unheard.popleft())
            except FAILURES:
                self._rival = None
        return self.filter is not estimate

    def distance(self, seen: ObservationMessage, course: Course) -> float:
        """Return the squared Mahalanobis distance of an observation; infinite without an estimate."""
        if self.filter is None:
            return math.inf
        return self.filter.distance(_sighting(seen, float(Utc.parse(seen.utc).unix_s), course, seen.frame))

    def refuse(self, words: str) -> None:
        """Count an observation that cannot be used, and keep why."""
        self.words = words
        self.refused += 1

    def _refusal(self, seen: ObservationMessage, utc_s: float, now_utc_s: float) -> str | None:
        if seen.catalog_number is not None and seen.catalog_number != self._catalog_number:
            return f"it is of satellite {seen.catalog_number}; {self._catalog_number} is followed"
        if utc_s > now_utc_s + FUTURE_S:
            return f"it is dated {utc_s - now_utc_s:.1f} s in the future: check the clocks"
        if utc_s < self._start_utc_s:
            return f"it is of {seen.utc}, before the pass"
        return None

    def _begin(
        self,
        seen: ObservationMessage,
        sighting: Sighting,
        course: Course,
        elements: Elements,
        first: Bias,
        led: bool,
    ) -> None:
        """Begin with an observation where elements can be so far off, or where the operator found it."""
        self.filter = None
        orbit = self._orbit_of(elements)
        by_camera = sighting.image is not None
        found = [_led(sighting, orbit, first)] if led and (first.along_s or first.cross_deg) else []
        starts = [
            FilterBank(orbit, mean_km, known=self._known, seen_by_camera=by_camera)
            for mean_km in (None, *found)
        ]
        best = min(starts, key=lambda one: one.distance(sighting))
        distance = best.distance(sighting)
        in_other = distance
        if not by_camera:
            other = self._otherwise(seen, sighting, course)
            in_other = min(one.distance(other) for one in starts)
        if distance > GATE or in_other + BETTER_FRAME < distance:
            self.words = f"the elements are not so far off{self._hint(starts, seen, sighting, course)}"
            self._keep_for_rival(_Unheard(False, sighting, orbit))
        elif sighting.image is not None and _apart_deg(sighting, first) > FAR_DEG:
            self.words = f"it lies far from what is fed: {CONFIRMED_BY} that agree are needed"
            self._keep_for_rival(_Unheard(False, sighting, orbit, CONFIRMED_BY))
        elif not (best.observe(sighting, GATE) and _credible(best)):
            self.words = "it lies nowhere near the satellite's track: another satellite's?"
        else:
            self.filter = best
            self._end_rival()

    def _believe(self, sighting: Sighting, elements: Elements) -> None:
        """Begin an estimate with an observation, if it contradicts the one there is."""
        if self.words is None:
            return
        fresh = _fresh(sighting, self._orbit_of(elements), True, self._known)
        if fresh is not None:
            self.filter, self.words = fresh, None
            self._end_rival()

    def _go_on(
        self, known: FilterBank, seen: ObservationMessage, sighting: Sighting, course: Course
    ) -> FilterBank:
        """Take an observation to the others, if it agrees with them; return the estimate before."""
        before = known.copy()
        taken = known.observe(sighting, GATE)
        if taken and not _credible(known):
            self.filter, taken = before, False
        if not taken:
            self.words = f"it contradicts the estimate{self._hint([before], seen, sighting, course)}"
        self._keep_for_rival(_Unheard(taken, sighting, known.orbit))
        return before

    def _keep_for_rival(self, one: _Unheard) -> None:
        """Keep an observation as long as a rival that may win has to be held against it."""
        kept = self._unheard
        kept.append(one)
        if self._rival is None:
            while kept and (kept[0].taken or sum(each.taken for each in kept) >= ANEW_AFTER):
                kept.popleft()

    def _may_win(self) -> bool:
        """Tell whether a rival that takes all it is held against would have enough of them."""
        if self._rival is not None:
            return True
        taken = 0
        for count, one in enumerate(reversed(self._unheard), 1):
            if not one.taken and count >= max(self._unheard[-1].least, RIVAL_SHARE * taken):
                return True
            taken += one.taken
        return False

    def _end_rival(self) -> None:
        self._rival = None
        self._unheard.clear()

    def _hear_rival(self, one: _Unheard) -> None:
        """Hold an observation against the rival; let it begin with one that was rejected, win or end."""
        rival = self._rival
        if rival is not None:
            self._since_rival += one.taken
            if rival.observe(one.sighting, GATE) or one.taken:
                self._judge_rival(rival, one.least)
                return
        if not one.taken and (rival is None or rival.rejected >= rival.accepted):
            self._rival = _fresh(one.sighting, one.orbit, one.least == ANEW_AFTER, self._known)
            self._since_rival = 0

    def _judge_rival(self, rival: FilterBank, least: int) -> None:
        """Let a rival win that has taken enough, and end one that the estimate has outlived."""
        if rival.accepted >= max(least, RIVAL_SHARE * self._since_rival) and _credible(rival):
            self.begun_anew += least == ANEW_AFTER
            self.filter, self.words = rival, None
            self._end_rival()
        elif self._since_rival >= ANEW_AFTER:
            self._rival = None

    def _orbit_of(self, elements: Elements) -> CorrectableOrbit:
        if self._orbit is None or self._orbit.given is not elements:
            self._end_rival()
            self._orbit = CorrectableOrbit(elements, Utc(self._start_utc_s))
        return self._orbit

    def _otherwise(self, seen: ObservationMessage, sighting: Sighting, course: Course) -> Sighting:
        """Return the same observation as if it were of another frame; what was seen by the mount has one."""
        if sighting.image is not None:
            return sighting
        other = _other_frame(seen.frame)
        return _sighting(seen, float(sighting.utc.unix_s), course, other)

    def _hint(
        self, known: list[FilterBank], seen: ObservationMessage, sighting: Sighting, course: Course
    ) -> str:
        """Say what would explain an observation that does not fit."""
        if sighting.image is not None:
            return ": another object's, or noise?"
        distance = min(one.distance(self._otherwise(seen, sighting, course)) for one in known)
        if distance < GATE:
            return f": in the frame {_other_frame(seen.frame)} it would fit"
        return ": another satellite's, or in another frame?"


def _corrected_elements(course: Course) -> Elements | None:
    """Return the elements that observations correct; None where a run follows what has none."""
    source = course.propagator.elements
    return source if isinstance(source, Elements) else None


def _reading(known: FilterBank, utc_s: float, course: Course, fed: bool) -> EstimatedBiases | None:
    along_s = float(known.correction_km[ALONG]) / known.orbit.speed_km_s
    # What the mount is fed goes through the air: its errors turn what the air has bent.
    by = course.propagator if fed else course.airless
    there, spread = known.pointing(by, Utc(utc_s), fed)
    now = _biases(there, utc_s, course, by, (along_s, 0.0))
    if now is None:
        return None
    along, cross, pace = now
    steps = [np.zeros(2)]
    for at_s in (utc_s + 0.5 * LINE_S, utc_s + LINE_S):
        later = known.direction(by, Utc(at_s), fed)
        # Expected on the line through those before it, each takes one step of Newton's.
        along_s, cross_km = (along, cross) + 2.0 * steps[-1]
        then = _biases(later, at_s, course, by, (along_s, cross_km))
        if then is None:
            return None
        steps.append(np.array(then[:2]) - (along, cross))
    # A parabola through the three.
    _, halfway, whole = steps
    rates = (4.0 * halfway - whole) / LINE_S
    curves = 4.0 * (whole - 2.0 * halfway) / LINE_S**2
    range_km = course.going(utc_s + along).range_km
    cross_deg = math.degrees(math.atan(cross / range_km))
    ahead = by.at(Utc(utc_s), Bias(along + DIFFERENCE_S, cross_deg)).unit - there
    ahead = ahead - (ahead @ there) * there
    ahead = ahead / math.sqrt(float(ahead @ ahead))
    left = cross_product(there, ahead)
    return EstimatedBiases(
        along,
        cross,
        float(rates[0]),
        float(rates[1]),
        math.sqrt(float(ahead @ spread @ ahead)) / pace,
        math.sqrt(float(left @ spread @ left)) * range_km,
        float(curves[0]),
        float(curves[1]),
    )


def _apart_deg(sighting: Sighting, bias: Bias) -> float:
    """Return how far a sighting lies from where a bias leads."""
    fed = sighting.propagator.at(sighting.utc, bias).unit
    return 2.0 * math.degrees(math.asin(min(1.0, 0.5 * float(np.linalg.norm(sighting.unit - fed)))))


def _fresh(
    sighting: Sighting, orbit: CorrectableOrbit, rival: bool, known: KnownTerms | None
) -> FilterBank | None:
    """Return filters that begin with an observation, where elements can be so far off."""
    wider, noisier = (RIVAL_WIDER, RIVAL_NOISIER) if rival else (1.0, 1.0)
    fresh = FilterBank(orbit, None, wider, noisier, known, sighting.image is not None)
    return fresh if fresh.observe(sighting, GATE) and _credible(fresh) else None


def _credible(known: FilterBank) -> bool:
    """Tell whether elements that are worth following can be off by what a filter says."""
    along_s = abs(float(known.correction_km[ALONG])) / known.orbit.speed_km_s
    others = float(np.abs(known.correction_km[ALONG + 1 :]).max())
    return along_s <= MOST_ALONG_S and others <= MOST_CORRECTION_KM


def _led(sighting: Sighting, orbit: CorrectableOrbit, bias: Bias) -> NDArray[np.float64]:
    """Return the correction, along and of the plane, that leads where a bias does at a sighting's instant."""
    free = np.array([(MOST_ALONG_S * orbit.speed_km_s) ** 2, 0.0, 0.0, 0.0, 1e4, 1e4])
    led = OrbitFilter(orbit, Expected(np.zeros(STATES), np.diag(free)))
    unit = sighting.propagator.at(sighting.utc, bias).unit
    led.observe(Sighting(sighting.utc, unit, 1e-6, sighting.propagator), math.inf)
    return led.correction_km


def _sighting(seen: ObservationMessage, utc_s: float, course: Course, frame: str) -> Sighting:
    t = Utc(utc_s)
    propagator = course.propagator if frame == "of_date" else course.airless
    unit = apparent_unit(seen.ra_deg, seen.dec_deg, t, FRAMES[frame], propagator.site, propagator.earth)
    sigma_rad = math.radians(math.hypot(seen.sigma_arcsec, MODEL_ARCSEC) / 3600.0)
    return Sighting(t, unit, sigma_rad, propagator)


def _other_frame(frame: str) -> str:
    return "icrs" if frame == "of_date" else "of_date"


def _biases(
    unit: NDArray[np.float64],
    utc_s: float,
    course: Course,
    propagator: Propagator,
    expected: tuple[float, float],
) -> tuple[float, float, float] | None:
    """Return the biases, s and km, that lead to a direction, and the pace along there, rad a second.

    By Newton's method from what is expected of them. None where no bias along the track leads near it.
    """
    t = Utc(utc_s)
    along_s, cross_km = expected
    for _ in range(MOST_STEPS):
        range_km = course.going(utc_s + along_s).range_km
        cross_deg = math.degrees(math.atan(cross_km / range_km))
        here, later, sooner = (
            propagator.at(t, Bias(along_s + step_s, cross_deg)).unit
            for step_s in (0.0, DIFFERENCE_S, -DIFFERENCE_S)
        )
        by_along = (later - sooner) / (2.0 * DIFFERENCE_S)
        by_along = by_along - (by_along @ here) * here
        pace = math.sqrt(float(by_along @ by_along))
        if not pace > 0.0:
            return None
        ahead = by_along / pace
        step_s = math.atan2(float(unit @ ahead), float(unit @ here)) / pace
        along_s += max(-MOST_STEP_S, min(MOST_STEP_S, step_s))
        if abs(step_s) < NEAR_S:
            range_km = course.going(utc_s + along_s).range_km
            height = max(-1.0, min(1.0, float(unit @ cross_product(here, ahead))))
            cross_km = range_km * math.tan(math.radians(cross_deg) + math.asin(height))
            # The air lifts what is higher by less: there a step across is no full one.
            if abs(height) < NEAR_RAD or propagator is course.airless:
                return along_s, cross_km, pace
    return None
