"""Observations made into an estimate, against a satellite that really runs ahead of its elements."""

from __future__ import annotations

import math
import random
from dataclasses import replace
from types import SimpleNamespace as Made
from typing import Any
from unittest.mock import patch

import bias as bench
import numpy as np
import pytest

from sattrack.control.camera_image import Deviation
from sattrack.control.estimate import (
    EstimatedBiases,
    Estimator,
    _credible,
    _off_line,
    _Seeing,
    begun_anew,
    known_terms,
)
from sattrack.control.target import Course
from sattrack.mount.model import SkyTerms
from sattrack.runtime import demo_pass
from sattrack.views.messages import ObservationMessage
from tle.bias import NO_BIAS, Bias
from tle.errors import SubOrbitalError
from tle.instants import Utc
from tle.observed import bias_from_observation
from tle.orbit_filter import CAMERA_TERMS, MOUNT_TERMS, FilterBank
from tle.orbit_fit import ALONG, STATES, Sighting
from tle.propagator import Propagator
from tle.refraction import Refraction

CULMINATION_S = float(Utc.parse("2026-10-02T13:05:24Z").unix_s)
RISE_S = CULMINATION_S - 209.0
FRAMES = {"icrs": "icrf", "j2000": "j2000", "of_date": "of_date"}


@pytest.fixture
def course() -> Course:
    air = Refraction.standard(0.0)
    return Course(Propagator(demo_pass.elements(), demo_pass.SITE.place(), refraction=air))


@pytest.fixture
def estimator() -> Estimator:
    return Estimator(25544, RISE_S)


def seen(
    seconds: float, ahead_s: float = 3.0, sigma_arcsec: float = 20.0, seed: int = 1
) -> ObservationMessage:
    true = bench.true_satellite(demo_pass.elements(), demo_pass.SITE.place(), ahead_s)
    rng = random.Random(f"{seed} {seconds}")
    return bench.solution(true, CULMINATION_S + seconds, rng, sigma_arcsec)


def changed(one: ObservationMessage, **fields: object) -> ObservationMessage:
    values = {name: getattr(one, name) for name in one.__struct_fields__}
    return ObservationMessage(**{**values, **fields})


def read(estimator: Estimator, course: Course, seconds: float = 0.0) -> EstimatedBiases:
    found = estimator.reading(CULMINATION_S + seconds, course)
    assert found is not None
    return found


def take(estimator: Estimator, course: Course, one: ObservationMessage, first: Bias = NO_BIAS) -> bool:
    return estimator.take(one, float(Utc.parse(one.utc).unix_s) + 1.0, course, first)


@pytest.mark.parametrize("ahead_s", [0.0, 3.0, -60.0, 60.0])
@pytest.mark.parametrize("frame", ["icrs", "j2000", "of_date"])
@pytest.mark.parametrize("seconds", [-150.0, 0.0, 120.0])
def test_one_observation_says_what_the_full_inversion_says(
    course: Course, estimator: Estimator, ahead_s: float, frame: str, seconds: float
) -> None:
    """`tle.bias.bias_from_observation` is the slow way, and knows no distances."""
    utc = Utc(CULMINATION_S + seconds)
    true = Propagator(
        replace(demo_pass.elements(), epoch=Utc(float(demo_pass.elements().epoch.unix_s) - ahead_s)),
        demo_pass.SITE.place(),
        Bias(cross_deg=0.01),
        refraction=course.propagator.refraction,
    )
    place = true.at(utc) if frame == "of_date" else true.with_place("astrometric").at(utc)
    one = ObservationMessage(
        utc.isoformat("microseconds"), float(place.ra_deg), float(place.dec_deg), frame, 0.1
    )
    assert take(estimator, course, one)
    known = read(estimator, course, seconds)
    expected = bias_from_observation(
        course.propagator,
        one.ra_deg,
        one.dec_deg,
        utc,
        FRAMES[frame],
        math.hypot(0.1, 1.0),  # type: ignore[arg-type]
    )
    # What is expected beforehand pulls by the square of the sigmas' ratio.
    assert known.along_s == pytest.approx(expected.along_s, abs=2e-3)
    range_km = course.going(float(utc.unix_s) + known.along_s).range_km
    cross_deg = math.degrees(math.atan(known.cross_km / range_km))
    assert cross_deg == pytest.approx(expected.cross_deg, abs=1e-4)
    assert known.along_sigma_s == pytest.approx(expected.along_sigma_s, rel=0.03)
    cross_sigma_deg = math.degrees(known.cross_sigma_km / range_km)
    assert cross_sigma_deg == pytest.approx(expected.cross_sigma_deg, rel=0.03)


def test_the_first_observation_of_elements_a_minute_off_is_believed(
    course: Course, estimator: Estimator
) -> None:
    for ahead_s in (60.0, -60.0):
        fresh = Estimator(25544, RISE_S)
        assert take(fresh, course, seen(-100.0, ahead_s))
        assert read(fresh, course, -100.0).along_s == pytest.approx(ahead_s, abs=0.2)
    assert estimator.filter is None


def test_what_comes_late_says_the_same(course: Course, estimator: Estimator) -> None:
    prompt = Estimator(25544, RISE_S)
    ones = [seen(float(s)) for s in range(-100, -90)]
    for one in ones:
        assert prompt.take(one, float(Utc.parse(one.utc).unix_s), course, NO_BIAS)
        assert estimator.take(one, CULMINATION_S + 200.0, course, NO_BIAS)
    assert read(estimator, course) == read(prompt, course)


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"catalog_number": 38707}, "it is of satellite 38707; 25544 is followed"),
        ({"utc": "2026-10-02T13:00:00Z"}, "it is of 2026-10-02T13:00:00Z, before the pass"),
        ({"utc": "2025-10-02T13:05:24Z"}, "it is of 2025-10-02T13:05:24Z, before the pass"),
    ],
)
def test_what_cannot_be_of_this_pass_is_refused(
    course: Course, estimator: Estimator, fields: dict[str, object], words: str
) -> None:
    assert not estimator.take(changed(seen(0.0), **fields), CULMINATION_S + 1.0, course, NO_BIAS)
    assert estimator.words == words
    assert (estimator.refused, estimator.rejected, estimator.accepted) == (1, 0, 0)


def test_what_is_dated_in_the_future_is_refused(course: Course, estimator: Estimator) -> None:
    assert not estimator.take(seen(10.0), CULMINATION_S, course, NO_BIAS)
    assert estimator.words == "it is dated 10.0 s in the future: check the clocks"
    # Clocks differ by a tenth of a second.
    assert not estimator.take(seen(0.11), CULMINATION_S, course, NO_BIAS)
    assert estimator.take(seen(0.09), CULMINATION_S, course, NO_BIAS)


@pytest.mark.parametrize("declared", ["of_date", "j2000", "icrs"])
def test_a_frame_that_is_not_the_declared_one_is_rejected_and_guessed(
    course: Course, estimator: Estimator, declared: str
) -> None:
    """Precession since J2000 is 0.36° in 2026. Elements that are right; the estimate has been begun."""
    for second in range(5):
        assert take(estimator, course, seen(second - 5.0, 0.0))
    before = read(estimator, course)
    true = bench.true_satellite(demo_pass.elements(), demo_pass.SITE.place(), 0.0)
    place = (true if declared != "of_date" else true.with_place("astrometric")).at(Utc(CULMINATION_S))
    wrong = changed(seen(0.0), ra_deg=float(place.ra_deg), dec_deg=float(place.dec_deg), frame=declared)
    assert not take(estimator, course, wrong)
    right = "icrs" if declared == "of_date" else "of_date"
    assert estimator.words == f"it contradicts the estimate: in the frame {right} it would fit"
    assert read(estimator, course) == before


def test_the_first_observation_in_a_wrong_frame_is_rejected_wherever_it_shows_across_the_track(
    course: Course,
) -> None:
    """What precession moves along the track, late elements would too: that part no single one can tell."""
    true = bench.true_satellite(demo_pass.elements(), demo_pass.SITE.place(), 0.0)
    across_deg, rejected = [], []
    for seconds in range(-200, 200, 10):
        utc = Utc(CULMINATION_S + seconds)
        place = true.with_place("astrometric").at(utc)
        one = ObservationMessage(
            utc.isoformat("microseconds"), float(place.ra_deg), float(place.dec_deg), "of_date", 20.0
        )
        told = bias_from_observation(course.propagator, one.ra_deg, one.dec_deg, utc)
        across_deg.append(abs(told.cross_deg))
        fresh = Estimator(25544, RISE_S)
        rejected.append(not take(fresh, course, one))
    assert all(gone for gone, off in zip(rejected, across_deg, strict=True) if off > 0.2)
    assert sum(rejected) > 0.6 * len(rejected)


@pytest.mark.parametrize(
    ("squared", "in_other_frame", "begins"),
    [
        (18.3, 18.3, True),
        # One good observation in ten thousand.
        (18.5, 18.5, False),
        (18.3, 9.4, True),
        # It would be likelier by nine in another frame than its own.
        (18.3, 9.2, False),
        (8.9, 0.0, True),
        (9.1, 0.0, False),
        (18.5, 9.6, False),
        (25.0, 0.0, False),
    ],
)
def test_a_first_observation_begins_where_elements_can_be_so_far_off_and_no_other_frame_says_more(
    course: Course,
    estimator: Estimator,
    monkeypatch: pytest.MonkeyPatch,
    squared: float,
    in_other_frame: float,
    begins: bool,
) -> None:
    """Which of two frames a sighting is of is told by its propagator: places of date are bent by the air."""
    monkeypatch.setattr(
        FilterBank,
        "distance",
        lambda _, sighting: squared if sighting.propagator is course.airless else in_other_frame,
    )
    monkeypatch.setattr(FilterBank, "observe", lambda *_: True)
    assert take(estimator, course, seen(0.0)) is begins
    assert (estimator.filter is not None) is begins
    words = "the elements are not so far off: "
    words += "in the frame of_date it would fit" if in_other_frame < 18.4 else "another satellite's, or in an"
    assert (estimator.words or "").startswith("" if begins else words)


def test_wrong_frames_all_through_a_pass_never_settle(course: Course, estimator: Estimator) -> None:
    """Even where the first of them is believed: as the satellite turns, they contradict each other."""
    true = bench.true_satellite(demo_pass.elements(), demo_pass.SITE.place(), 0.0).with_place("astrometric")
    for second in range(-200, 200, 4):
        place = true.at(Utc(CULMINATION_S + second))
        one = changed(seen(second), ra_deg=float(place.ra_deg), dec_deg=float(place.dec_deg), frame="of_date")
        take(estimator, course, one)
    assert estimator.rejected > 0.8 * 100


def test_another_satellites_observations_are_rejected_and_change_nothing(
    course: Course, estimator: Estimator
) -> None:
    for second in range(5):
        assert take(estimator, course, seen(second - 60.0))
    before = read(estimator, course)[:4]
    other = replace(demo_pass.elements(), raan_deg=demo_pass.elements().raan_deg + 4.0)
    rng = random.Random(1)
    for second in range(100):
        stray = bench.solution(Propagator(other, demo_pass.SITE.place()), CULMINATION_S + second, rng, 20.0)
        assert not take(estimator, course, stray)
    assert read(estimator, course)[:4] == before
    assert (estimator.accepted, estimator.rejected, estimator.begun_anew) == (5, 100, 0)
    assert take(estimator, course, seen(101.0)), "the right one is taken all the same"


def test_a_wrong_start_is_left_once_many_in_a_row_agree(course: Course, estimator: Estimator) -> None:
    """The first was of something 20 s ahead on the same orbit; the others would otherwise never count."""
    assert take(estimator, course, seen(-120.0, ahead_s=20.0))
    taken = [take(estimator, course, seen(-100.0 + second)) for second in range(20)]
    assert taken.index(True) == 7
    assert all(taken[8:])
    assert estimator.begun_anew == 1
    known = read(estimator, course, -80.0)
    assert known.along_s == pytest.approx(3.0, abs=4.0 * known.along_sigma_s)


@pytest.mark.parametrize(
    ("order", "wins_at"),
    [
        # Eight in a row, whatever went before.
        ("gggggggg" + 8 * "r", 15),
        # Three times as many as the estimate has taken since.
        ("gggg" + "rrgrrgrrg" + 6 * "r", 15),
        ("gggg" + "rrgrg" + 10 * "r", 13),
        # A single stray one is no rival for longer than the next that it does not explain.
        ("gggg" + "x" + 9 * "r", 12),
    ],
)
def test_a_rival_wins_by_eight_and_by_three_to_one(
    course: Course, estimator: Estimator, order: str, wins_at: int
) -> None:
    """Of two satellites on one track, as far as the estimate goes."""
    won = None
    for number, one in enumerate(order):
        take(estimator, course, seen(number - 100.0, {"g": 3.0, "r": -20.0, "x": 40.0}[one], 3.0))
        if estimator.begun_anew and won is None:
            won = number
    assert won == wins_at
    assert read(estimator, course, -100.0 + len(order)).along_s == pytest.approx(-20.0, abs=0.5)


def test_a_patient_caller_gets_the_same_estimate_some_calls_later(
    course: Course, estimator: Estimator
) -> None:
    patient = Estimator(25544, RISE_S)
    ones = [seen(-100.0, 3.0), *(seen(float(s), -40.0, 3.0) for s in range(-99, -85))]
    for one in ones:
        take(estimator, course, one)
        assert not patient.catch_up() or one is ones[-1]
        patient.take(one, CULMINATION_S, course, NO_BIAS, patient=True)
    calls = next(n for n in range(1, 50) if patient.catch_up())
    assert calls <= len(ones)
    assert (estimator.begun_anew, patient.begun_anew) == (1, 1)
    assert read(patient, course, -85.0).along_s == pytest.approx(
        read(estimator, course, -85.0).along_s, abs=0.01
    )


def test_the_last_observation_is_given_back_once(course: Course, estimator: Estimator) -> None:
    assert take(estimator, course, seen(-100.0))
    before, last_s = read(estimator, course), estimator.last_utc_s
    assert take(estimator, course, seen(-90.0))
    assert read(estimator, course) != before
    assert estimator.undo() is True
    assert (estimator.accepted, estimator.rejected, estimator.last_utc_s) == (1, 1, last_s)
    assert estimator.words == "it was rejected by hand"
    assert read(estimator, course) == before
    # What the one before has changed is not known any more.
    assert estimator.undo() is False
    assert (estimator.accepted, estimator.rejected) == (1, 1)
    assert read(estimator, course) == before


def test_one_that_the_operator_is_sure_of_ends_what_was_held_against_the_estimate(
    course: Course, estimator: Estimator
) -> None:
    """A rival of something 40 s ahead had seven for it: that one more of them agrees is no eighth."""
    for second in range(3):
        assert take(estimator, course, seen(second - 100.0))
    for second in range(7):
        assert not take(estimator, course, seen(second - 90.0, ahead_s=40.0))
    sure = seen(-70.0, ahead_s=-20.0)
    assert estimator.take(sure, float(Utc.parse(sure.utc).unix_s) + 1.0, course, NO_BIAS, sure=True)
    assert not take(estimator, course, seen(-69.0, ahead_s=40.0))
    assert read(estimator, course, -69.0).along_s == pytest.approx(-20.0, abs=0.5)


def test_what_would_lead_farther_off_than_any_elements_are_is_given_back(
    course: Course, estimator: Estimator, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert take(estimator, course, seen(-20.0))
    before = read(estimator, course)[:4]
    monkeypatch.setattr("sattrack.control.estimate._credible", lambda _: False)
    assert not take(estimator, course, seen(-10.0))
    assert (estimator.words or "").startswith("it contradicts the estimate")
    assert read(estimator, course)[:4] == before
    assert [one.taken for one in estimator._unheard] == [False]


def test_one_that_comes_late_does_not_make_the_target_seem_lost(course: Course, estimator: Estimator) -> None:
    """The newest that was taken counts: frames come out of order."""
    for seconds, newest in ((-100.0, -100.0), (-80.0, -80.0), (-90.0, -80.0), (-79.0, -79.0)):
        assert take(estimator, course, seen(seconds))
        assert estimator.last_utc_s == CULMINATION_S + newest


def test_it_is_known_where_the_mount_must_point_as_well_as_satellite_and_mount_together_are(
    course: Course, estimator: Estimator
) -> None:
    """Solutions tell nothing of the mount: of it docs/biases.md says what is expected before a pass.

    Its base is turned by 0.1° about each axis, the telescope by 0.03° either way, and a delay is 20 ms off,
    which acts along the track: the worst direction.
    """
    assert take(estimator, course, seen(0.0, 0.0))
    before, here, after = (course.airless.at(Utc(CULMINATION_S + s)) for s in (-0.5, 0.0, 0.5))
    pace_deg_s = math.hypot(
        math.remainder(float(after.az_deg) - float(before.az_deg), 360.0)
        * math.cos(math.radians(float(here.alt_deg))),
        float(after.alt_deg) - float(before.alt_deg),
    )
    sigma = math.hypot(360.0, 108.0, 0.02 * pace_deg_s * 3600.0, 20.0)
    assert estimator.sigma_arcsec(CULMINATION_S, course) == pytest.approx(sigma, rel=2e-3)


def test_an_orbit_that_nothing_flies_tells_nothing_and_ends_no_run(
    course: Course, estimator: Estimator
) -> None:
    def grounded(*_: object) -> Any:
        raise SubOrbitalError("below the ground", 6)

    filters: Any = Made(
        correction_km=np.zeros(6), orbit=Made(speed_km_s=7.5), pointing=grounded, direction=grounded
    )
    estimator.filter = filters
    assert estimator.reading(CULMINATION_S, course) is None
    assert estimator.sigma_arcsec(CULMINATION_S, course) is None


@pytest.mark.parametrize(("off_km", "begins"), [(1.4, True), (1.9, True), (2.2, False), (3.0, False)])
def test_a_rival_expects_three_times_the_errors_of_elements(
    course: Course, estimator: Estimator, off_km: float, begins: bool
) -> None:
    """The plane is tilted by so much: at the northernmost point of the orbit all of it is across the track.

    Half a day after the epoch an inclination is known to 0.158 km: three times that, and the square root of
    18.4, are 2.03 km. What lies farther off is another satellite's, however many agree.
    """
    elements = demo_pass.elements()
    tilted = replace(elements, inclination_deg=elements.inclination_deg + math.degrees(off_km / 6790.0))
    true, rng = Propagator(tilted, demo_pass.SITE.place()), random.Random(1)
    taken = [
        take(estimator, course, bench.solution(true, CULMINATION_S + second, rng, 3.0))
        for second in range(-8, 1)
    ]
    assert taken == [False] * (7) + [begins] * 2
    assert estimator.begun_anew == begins


class TestWhatAgreesBesideTheEstimate:
    """Seven that agree with one another, and not with the elements: an eighth would begin an estimate."""

    def tilted(self, seconds: float) -> ObservationMessage:
        elements = demo_pass.elements()
        tilted = replace(elements, inclination_deg=elements.inclination_deg + math.degrees(1.4 / 6790.0))
        true = Propagator(tilted, demo_pass.SITE.place())
        rng = random.Random(f"{seconds}")
        one: ObservationMessage = bench.solution(true, CULMINATION_S + seconds, rng, 3.0)
        return one

    def seven(self, estimator: Estimator, course: Course) -> None:
        for second in range(-8, -1):
            assert not take(estimator, course, self.tilted(second))

    def test_is_forgotten_with_the_estimate(self, course: Course, estimator: Estimator) -> None:
        self.seven(estimator, course)
        estimator.forget()
        taken = [take(estimator, course, self.tilted(second)) for second in range(8)]
        assert taken == [False] * (7) + [True]

    def test_counts_no_more_once_one_is_taken_that_the_elements_expect(
        self, course: Course, estimator: Estimator
    ) -> None:
        self.seven(estimator, course)
        assert take(estimator, course, seen(-1.0, 0.0, 3.0))
        assert not take(estimator, course, self.tilted(0.0))
        assert estimator.begun_anew == 0

    def test_counts_no_more_once_the_operator_has_rejected_one(
        self, course: Course, estimator: Estimator
    ) -> None:
        for seconds in (-20.0, -19.0):
            assert take(estimator, course, seen(seconds, 0.0, 3.0))
        self.seven(estimator, course)
        assert estimator.undo() is True
        assert not take(estimator, course, self.tilted(0.0))
        assert estimator.begun_anew == 0


def test_an_estimate_that_was_forgotten_is_not_brought_back_by_a_rejection(
    course: Course, estimator: Estimator
) -> None:
    for seconds in (-20.0, -19.0):
        assert take(estimator, course, seen(seconds))
    estimator.forget()
    assert estimator.undo() is False
    assert estimator.filter is None
    assert (estimator.accepted, estimator.rejected) == (2, 0)


def test_no_rival_is_computed_while_none_can_win(course: Course, estimator: Estimator) -> None:
    for s in range(30):
        take(estimator, course, seen(s - 100.0, 3.0 if s % 3 < 2 else -20.0, 3.0))
    assert (estimator.accepted, estimator.rejected, estimator.begun_anew) == (20, 10, 0)
    assert estimator._rival is None


def test_what_the_operator_found_far_off_is_where_observations_are_expected(
    course: Course, estimator: Estimator
) -> None:
    off = Bias(-4.0, 1.5)
    true = Propagator(demo_pass.elements(), demo_pass.SITE.place(), off)
    one = bench.solution(true, CULMINATION_S, random.Random(2), 20.0)
    assert not take(estimator, course, one)
    assert take(Estimator(25544, RISE_S), course, one, Bias(-3.8, 1.45))
    assert take(Estimator(25544, RISE_S), course, seen(0.0), Bias(-3.8, 1.45)), "nudges can be wrong"
    across = bench.solution(
        Propagator(demo_pass.elements(), demo_pass.SITE.place(), Bias(0.0, 1.5)),
        CULMINATION_S,
        random.Random(2),
        20.0,
    )
    assert take(Estimator(25544, RISE_S), course, across, Bias(0.0, 1.45)), "found across alone"


@pytest.mark.parametrize("moved_km", bench.MANOEUVRES_KM)
def test_a_satellite_that_left_its_orbit_is_taken_from_the_first_solutions_on(
    moved_km: tuple[float, float, float],
) -> None:
    """13-day-old elements, a minute off, kilometres beside the orbit: drift and bend within three minutes."""
    tally = bench.Tally()
    bench.manoeuvred(tally, moved_km, 1)
    assert tally.solutions == 33
    assert tally.taken >= 31
    assert tally.begun_anew == 0
    assert abs(tally.end_along_s[0]) < 0.02


def test_sigmas_are_those_along_and_across_however_far_across_the_satellite_is(
    course: Course, estimator: Estimator
) -> None:
    """Far across the track the two must not be mixed up: an observation fixes both alike on the sky."""
    off = Bias(-4.0, 1.5)
    true = Propagator(demo_pass.elements(), demo_pass.SITE.place(), off)
    assert take(estimator, course, bench.solution(true, CULMINATION_S, random.Random(2), 20.0), off)
    known, going = read(estimator, course), course.going(CULMINATION_S - 4.0)
    on_sky = known.along_sigma_s * going.pace_deg_s, math.degrees(known.cross_sigma_km / going.range_km)
    expected = bias_from_observation(
        course.airless, *place(true, CULMINATION_S), Utc(CULMINATION_S), sigma_arcsec=20.0
    )
    assert known.along_sigma_s == pytest.approx(expected.along_sigma_s, rel=0.05)
    assert on_sky[1] == pytest.approx(20.0 / 3600.0, rel=0.05)


class TestReadings:
    """Of an orbit that is known to drift and bend, along and across the track, as is made up here."""

    ALONG, CROSS = (2.0, 0.02, -0.0006), (-15.0, 0.3, 0.004)
    """At the culmination, in each second, and in each squared: seconds and km."""
    SIGMAS_ARCSEC = 30.0, 4.0

    def unit(self, course: Course, utc_s: float, later_s: float = 0.0) -> Any:
        after_s = utc_s - CULMINATION_S
        along_s, cross_km = (a + after_s * (b + after_s * c) for a, b, c in (self.ALONG, self.CROSS))
        cross_deg = math.degrees(math.atan(cross_km / course.going(utc_s + along_s).range_km))
        return course.airless.at(Utc(utc_s), Bias(along_s + later_s, cross_deg)).unit

    def known(self, course: Course) -> tuple[Estimator, float]:
        """Return the estimator, and the pace along, radians a second."""
        there = self.unit(course, CULMINATION_S)
        by_along = self.unit(course, CULMINATION_S, 1e-3) - self.unit(course, CULMINATION_S, -1e-3)
        pace = float(np.linalg.norm(by_along)) / 2e-3
        ahead = by_along / np.linalg.norm(by_along)
        left = np.cross(there, ahead)
        sigmas = np.radians(np.array(self.SIGMAS_ARCSEC) / 3600.0)
        spread = sigmas[0] ** 2 * np.outer(ahead, ahead) + sigmas[1] ** 2 * np.outer(left, left)
        estimator = Estimator(25544, RISE_S)
        filters: Any = Made(
            correction_km=np.zeros(6),
            orbit=Made(speed_km_s=7.5),
            pointing=lambda _propagator, utc, _fed: (self.unit(course, float(utc.unix_s)), spread),
            direction=lambda _propagator, utc, _fed: self.unit(course, float(utc.unix_s)),
        )
        estimator.filter = filters
        return estimator, pace

    def test_they_tell_of_drift_and_bend_and_how_well_each_is_known(self, course: Course) -> None:
        estimator, pace = self.known(course)
        found = read(estimator, course)
        assert found[:4] == pytest.approx(
            (self.ALONG[0], self.CROSS[0], self.ALONG[1], self.CROSS[1]), rel=1e-3
        )
        assert found.along_curve == pytest.approx(2.0 * self.ALONG[2], rel=0.02)
        assert found.cross_curve_km_s2 == pytest.approx(2.0 * self.CROSS[2], rel=0.02)
        range_km = course.going(CULMINATION_S + self.ALONG[0]).range_km
        sigmas = np.radians(np.array(self.SIGMAS_ARCSEC) / 3600.0)
        assert found.along_sigma_s == pytest.approx(sigmas[0] / pace, rel=1e-3)
        assert found.cross_sigma_km == pytest.approx(sigmas[1] * range_km, rel=1e-3)

    def test_what_drifts_evenly_is_found_at_once_two_seconds_later(self, course: Course) -> None:
        """A reading must be over within a period: each direction costs."""
        estimator, _ = self.known(course)
        asked: list[float] = []
        airless, true = course.airless, Course(course.propagator)

        def at(t: Utc, bias: Bias = NO_BIAS) -> Any:
            asked.append(float(t.unix_s) - CULMINATION_S)
            return airless.at(t, bias)

        filters: Any = estimator.filter
        filters.direction = lambda _propagator, utc, _fed: self.unit(true, float(utc.unix_s))
        counted: Any = Made(at=at)
        course._airless = counted
        read(estimator, course)
        assert asked.count(2.0) == 3

    def test_a_pass_is_warmed_up_for_at_both_ends_and_nothing_is_known_by_that(
        self, course: Course, estimator: Estimator
    ) -> None:
        with patch.object(Estimator, "reading", autospec=True, side_effect=Estimator.reading) as reading:
            estimator.warm_up(course, CULMINATION_S + 200.0)
        looked = [call.args[1] for call in reading.call_args_list]
        assert looked == [RISE_S, CULMINATION_S + 200.0]
        assert (estimator.filter, estimator.accepted, estimator.last_utc_s) == (None, 0, None)


def place(true: Propagator, utc_s: float) -> tuple[float, float]:
    there = true.at(Utc(utc_s))
    return float(there.ra_deg), float(there.dec_deg)


def test_what_the_elements_could_not_be_off_by_begins_an_estimate_once_many_agree() -> None:
    tally = bench.Tally()
    bench.manoeuvred(tally, (-8.0, 0.0, 2.0), 1)
    assert tally.begun_anew == 1
    assert tally.taken == 33 - (7)
    assert abs(tally.end_along_s[0]) < 0.02


def test_a_first_one_that_is_too_far_off_begins_with_the_eighth_that_agrees(
    course: Course, estimator: Estimator
) -> None:
    """The node is 0.1° from the elements': twelve kilometres across at the equator."""
    elements = demo_pass.elements()
    true = Propagator(replace(elements, raan_deg=elements.raan_deg + 0.1), demo_pass.SITE.place())
    rng = random.Random(1)
    taken = [
        take(estimator, course, bench.solution(true, CULMINATION_S + second, rng, 20.0))
        for second in range(-60, -40)
    ]
    assert taken.index(True) == 7
    assert all(taken[8:])
    assert estimator.begun_anew == 1


def test_estimates_of_an_orbit_that_sgp4_does_not_know_are_as_good_as_they_say() -> None:
    """The whole is printed by `python bench/bias.py`."""
    scene, tally = bench.Scene.of("1340 km", 0.5), bench.Tally()
    believed = Propagator(scene.elements, scene.site)
    for rise_s, set_s in scene.passes(0.02, 0.49):
        instants = [float(second) for second in range(int(rise_s), int(set_s), 4)]
        bench.follow_pass(tally, believed, scene.motion, instants, random.Random(int(rise_s)), set_s)
    assert tally.passes == 3
    assert tally.taken > 0.97 * tally.solutions
    # An arcsecond of clocks and catalogues counts beside their own; two degrees have a mean of 2.
    expected = 2.0 / (1.0 + (1.0 / bench.SIGMA_ARCSEC) ** 2)
    assert sum(tally.nis) / len(tally.nis) == pytest.approx(expected, abs=0.25)
    normalised = [*tally.along, *tally.across]
    assert sum(abs(off) <= 2.0 for off in normalised) > 0.88 * len(normalised)
    assert max(tally.end_arcsec) < 2.0


@pytest.mark.parametrize("seed", [3, 4, 6])
def test_sigmas_that_are_half_of_what_they_should_be_lock_nothing_out(
    course: Course, estimator: Estimator, seed: int
) -> None:
    """One solution in ten contradicts the others by what it says of itself."""
    for second in range(0, 120, 2):
        one = seen(second - 60.0, sigma_arcsec=6.0, seed=seed)
        take(estimator, course, changed(one, sigma_arcsec=3.0))
    assert estimator.begun_anew <= 1
    assert estimator.accepted > 40
    known = read(estimator, course, 60.0)
    assert known.along_s == pytest.approx(3.0, abs=0.02)


def test_a_wild_observation_leaves_the_estimate_alone(course: Course, estimator: Estimator) -> None:
    for second in range(20):
        assert take(estimator, course, seen(second - 60.0, sigma_arcsec=3.0))
    before = read(estimator, course)[:4]
    for off_deg in (0.02, -0.5, 5.0, 90.0):
        good = seen(-30.0, sigma_arcsec=3.0)
        assert not take(estimator, course, changed(good, ra_deg=(good.ra_deg + off_deg) % 360.0))
    assert read(estimator, course)[:4] == before
    assert take(estimator, course, seen(-20.0, sigma_arcsec=3.0))


@pytest.mark.parametrize("since_s", [-200.0, -100.0, 0.0])
def test_a_mount_turns_what_the_air_has_bent(course: Course, since_s: float) -> None:
    """The base is turned by 8′, the satellite 12° high and more, and where its elements have it."""
    polar, pole = math.radians(480.0 / 3600.0), np.array([0.6, -0.8, 0.0])

    def turned(unit: Any) -> Any:
        c, s = math.cos(polar), math.sin(polar)
        return unit * c + np.cross(pole, unit) * s + pole * (pole @ unit) * (1.0 - c)

    def pointed(propagator: Propagator, t: Utc, mount: bool) -> Any:
        unit = propagator.at(t).unit
        return turned(unit) if mount else unit

    one = Estimator(25544, RISE_S)
    one.filter = Made(  # type: ignore[assignment]
        correction_km=np.zeros(STATES),
        orbit=Made(speed_km_s=7.5),
        direction=pointed,
        pointing=lambda *words: (pointed(*words), 1e-12 * np.eye(3)),
    )
    utc_s = CULMINATION_S + since_s
    read = one.reading(utc_s, course, fed=True)
    assert read is not None
    range_km = course.going(utc_s + read.along_s).range_km
    bias = Bias(read.along_s, math.degrees(math.atan(read.cross_km / range_km)))
    seen_fed = course.propagator.at(Utc(utc_s), bias)
    off = seen_fed.unit - turned(course.propagator.at(Utc(utc_s)).unit)
    assert since_s > -200.0 or float(seen_fed.alt_deg) < 12.0
    assert float(np.linalg.norm(off)) < math.radians(0.02 / 3600.0)


class TestWhatCamerasShow:
    """Of filters whose terms are made up here."""

    def known(self, sigmas: float = 10.0, **found: float) -> Estimator:
        """Return an estimator that has found so much of a camera, known so many times better than that."""
        values = np.array([found.get(name, 0.0) for name in CAMERA_TERMS])
        of_camera = values, np.where(values == 0.0, 1e-3, np.abs(values) / sigmas)
        of_mount = np.linspace(0.1, 0.2, len(MOUNT_TERMS)), np.linspace(0.01, 0.02, len(MOUNT_TERMS))
        one = Estimator(25544, RISE_S)
        filters: Any = Made(
            cameras=["fine"],
            terms=lambda name=None: of_mount if name is None else of_camera,
            knows_terms=True,
            uses_known_terms=True,
        )
        one.filter, one.last_utc_s = filters, CULMINATION_S
        return one

    @pytest.mark.parametrize(
        ("found", "words"),
        [
            ({}, None),
            ({"rotation_deg": 5.1}, "its image is turned by +5.1° more than set"),
            ({"rotation_deg": -5.1}, "its image is turned by -5.1° more than set"),
            ({"rotation_deg": 4.9}, None),
            ({"scale": 0.04}, "its pixels are 1.040 times as large as set"),
            ({"scale": 0.02}, None),
            ({"clock_s": 0.06}, "by its offsets its dates are 0.06 s ahead: the estimate allows for it"),
            ({"clock_s": -0.06}, "by its offsets its dates are 0.06 s behind: the estimate allows for it"),
            ({"clock_s": 0.04}, None),
        ],
    )
    def test_what_is_not_as_set_is_told_once_it_is_sure(
        self, found: dict[str, float], words: str | None
    ) -> None:
        told = self.known(**found).camera_words
        assert told == (() if words is None else (f"camera fine: {words}",))
        assert self.known(3.9, **found).camera_words == ()
        assert len(self.known(4.1, **found).camera_words) == len(told)

    def test_what_earlier_passes_found_and_a_mirrored_image_are_told(self) -> None:
        one = self.known()
        filters: Any = one.filter
        filters.uses_known_terms = False
        assert one.camera_words == (
            "what earlier passes found of mount and cameras does not hold: it is left aside",
        )
        filters.knows_terms = False
        one.deviations = {"fine": Deviation(mirrored=True), "coarse": Deviation(30.0)}
        assert one.camera_words == (
            "camera fine: its image is mirrored otherwise than set: turn `flipped` round",
        )
        assert Estimator(25544, RISE_S).camera_words == ()

    def test_what_images_show_and_what_filters_find_beside_it_is_told_as_one(self) -> None:
        one = self.known(rotation_deg=2.0, scale=0.1, clock_s=0.06)
        one.deviations["fine"] = Deviation(90.0, 2.0, clock_s=0.3)
        assert one.camera_words == (
            "camera fine: its image is turned by +92.0° more than set",
            "camera fine: its pixels are 2.200 times as large as set",
            "camera fine: by its offsets its dates are 0.30 s ahead: the estimate allows for it",
        )
        one.deviations["fine"] = Deviation(-2.0, 1.0 / 1.1)
        assert one.camera_words == (
            "camera fine: by its offsets its dates are 0.06 s ahead: the estimate allows for it",
        )

    @pytest.mark.parametrize(
        ("accepted", "rejected", "unsure"),
        [(100, 20, False), (100, 21, True), (200, 101, True), (90, 19, False), (9, 19, False)],
    )
    def test_no_profile_learns_of_a_camera_whose_offsets_contradict_one_another(
        self, accepted: int, rejected: int, unsure: bool
    ) -> None:
        one = self.known()
        one.accepted, one.rejected = accepted, rejected
        assert (one.sky_terms is None) == unsure
        words = ("many of the camera's offsets contradict the others: no profile learns from them",)
        assert one.camera_words == (words if unsure else ())

    def test_a_profile_is_told_of_mount_and_of_cameras_that_lie_as_set(self) -> None:
        one = self.known(rotation_deg=2.0)
        terms = one.sky_terms
        assert terms is not None
        assert Utc.parse(terms.utc).unix_s == CULMINATION_S
        assert terms.mount[MOUNT_TERMS[0]] == (0.1, 0.01)
        assert terms.cameras["fine"]["rotation_deg"] == (2.0, 0.2)
        filters: Any = one.filter
        one.deviations["fine"] = Deviation(180.0)
        turned = one.sky_terms
        assert turned is not None
        assert (turned.mount, turned.cameras) == (terms.mount, {})
        filters.cameras = []
        assert one.sky_terms is None
        filters.cameras, one.last_utc_s = ["fine"], None
        assert one.sky_terms is None
        assert Estimator(25544, RISE_S).sky_terms is None

    @pytest.mark.parametrize(
        ("rejected", "accepted", "refuted"),
        [(19, 0, False), (20, 0, True), (20, 4, True), (24, 5, False), (25, 5, True)],
    )
    def test_twenty_and_five_times_as_many_contradictions_refute_an_estimate(
        self, rejected: int, accepted: int, refuted: bool
    ) -> None:
        one = self.known()
        filters: Any = one.filter
        filters.rejected, filters.accepted = rejected, accepted
        assert one.refuted is refuted
        assert Estimator(25544, RISE_S).refuted is False

    def test_how_well_the_direction_is_known_is_the_worst_of_all_directions(self) -> None:
        one, where = self.known(), Made(airless=None)
        filters: Any = one.filter
        spread = np.diag([1.0, 9.0, 4.0]) * math.radians(1.0 / 3600.0) ** 2
        filters.pointing = lambda *_: (None, spread)
        assert one.sigma_arcsec(CULMINATION_S, where) == pytest.approx(3.0)  # type: ignore[arg-type]
        assert Estimator(25544, RISE_S).sigma_arcsec(CULMINATION_S, where) is None  # type: ignore[arg-type]


ARCSEC = math.radians(1.0 / 3600.0)


class TestSeeing:
    """How far frames lie off a line with those before them tells what their sigmas leave out."""

    def frames(self, times_s: Any, off_arcsec: Any) -> list[Any]:
        """Return frames at such times, that lie so far from where the satellite is expected."""
        nowhere: Any = Made(at=lambda *_: Made(unit=np.zeros(3)))
        return [
            Made(utc=Made(unix_s=float(t)), unit=np.array(off) * ARCSEC, propagator=nowhere)
            for t, off in zip(times_s, off_arcsec, strict=True)
        ]

    def seeing(self, times_s: Any, off_arcsec: Any) -> _Seeing:
        known = _Seeing()
        for frame in self.frames(times_s, off_arcsec):
            known.see(frame, NO_BIAS)
        return known

    def noise(self, count: int, sigma: float, seed: int = 3) -> Any:
        """Return places whose two directions on the sky are normal."""
        dice = np.random.default_rng(seed)
        return np.column_stack([np.zeros(count), dice.normal(0.0, sigma, (count, 2))])

    @pytest.mark.parametrize("uneven", [False, True])
    @pytest.mark.parametrize("sigma", [2.0, 8.0])
    def test_it_is_the_scatter_of_a_frame_however_unevenly_they_come(
        self, sigma: float, uneven: bool
    ) -> None:
        found = []
        for seed in range(12):
            dice = np.random.default_rng(seed)
            times_s = np.cumsum(dice.uniform(0.1, 0.9, 60) if uneven else np.full(60, 0.5))
            seen = self.seeing(times_s, self.noise(60, sigma, seed))
            found.append(seen.sigma_arcsec(0.1, 0.1, 1.0))
        assert np.mean(found) == pytest.approx(sigma, rel=0.1)

    def test_what_drifts_evenly_is_no_scatter(self) -> None:
        """As what orbit and mount do wrong."""
        times_s, noise = 0.5 * np.arange(60), self.noise(60, 3.0)
        drift = np.outer(times_s, (0.0, 40.0, -25.0)) + np.array((0.0, 900.0, 100.0))
        still, moves = self.seeing(times_s, noise), self.seeing(times_s, noise + drift)
        told = still.sigma_arcsec(0.1, 0.1, 1.0)
        assert moves.sigma_arcsec(0.1, 0.1, 1.0) == pytest.approx(told, rel=1e-6)
        # Nor is what the satellite moves by itself, however it bends.
        turns = _Seeing()
        for frame in self.frames(times_s, noise):
            bends = np.array([math.cos(0.1 * frame.utc.unix_s), math.sin(0.1 * frame.utc.unix_s), 0.0])
            frame.unit = frame.unit + bends
            frame.propagator = Made(at=lambda *_, bends=bends: Made(unit=bends))
            turns.see(frame, NO_BIAS)
        assert turns.sigma_arcsec(0.1, 0.1, 1.0) == pytest.approx(told, rel=1e-6)

    def test_the_scatter_of_three_frames_is_shared_out_among_them(self) -> None:
        """At a quarter of the way between the others one counts whole, they a quarter and three quarters."""
        three = [(t, np.array([0.0, off, 0.0])) for t, off in ((0.0, 0.0), (1.0, 2.0), (4.0, 0.0))]
        assert _off_line(*three) == pytest.approx(2.0**2 / (1.0 + 0.25**2 + 0.75**2))

    def test_up_to_a_third_of_the_frames_may_be_wild(self) -> None:
        found = []
        for seed in range(12):
            dice, off = np.random.default_rng(seed), self.noise(120, 3.0, seed)
            off[dice.choice(120, 40, replace=False), 1:] += dice.uniform(-600.0, 600.0, (40, 2))
            found.append(self.seeing(0.5 * np.arange(120), off).sigma_arcsec(0.1, 0.1, 1.0))
        assert np.mean(found) == pytest.approx(3.0, rel=0.15)

    def test_it_is_known_from_the_tenth_frame_on(self) -> None:
        """Until then a claimed sigma counts with what is usual besides."""
        for count, known in ((9, False), (10, True)):
            # One and the same frame that comes twice is one.
            times_s = np.repeat(0.5 * np.arange(count), 2)
            seen = self.seeing(times_s, np.repeat(self.noise(count, 8.0), 2, axis=0))
            told = seen.sigma_arcsec(1.5, 0.3, 2.0)
            assert (told == pytest.approx(2.5)) is not known
            assert (told > 3.0) is known

    @pytest.mark.parametrize(("every_s", "known"), [(2.4, True), (2.6, False)])
    def test_frames_count_that_follow_two_others_within_five_seconds(
        self, every_s: float, known: bool
    ) -> None:
        seen = self.seeing(every_s * np.arange(60), self.noise(60, 8.0))
        assert (seen.sigma_arcsec(1.5, 0.3, 2.0) > 3.0) is known

    def test_frames_that_come_out_of_order_are_between_those_about_them(self) -> None:
        times_s, off = 0.5 * np.arange(60), self.noise(60, 3.0)
        off[:, 1] += 40.0 * times_s
        order = [number + (1, -1)[number % 2] for number in range(60)]
        seen = self.seeing(times_s[order], off[order])
        assert seen.sigma_arcsec(0.1, 0.1, 1.0) == pytest.approx(3.0, rel=0.25)

    def test_a_claimed_sigma_is_believed_up_to_one_and_a_half_times_as_much_scatter(self) -> None:
        """With the least that there is beside it: of sides 3 and 4, 5 is the hypotenuse."""
        seen = self.seeing(0.5 * np.arange(60), self.noise(60, 6.0))
        scatter = seen.sigma_arcsec(0.1, 0.1, 1.0)
        for share, believed in ((1.49, True), (1.51, False)):
            said = scatter / share
            told = seen.sigma_arcsec(0.6 * said, 0.8 * said, 99.0)
            assert told == pytest.approx(said if believed else scatter)

    def test_no_frame_is_taken_for_worse_than_twenty_arcseconds(self) -> None:
        seen = self.seeing(0.5 * np.arange(60), self.noise(60, 60.0))
        assert seen.sigma_arcsec(1.0, 0.3, 1.0) == 20.0

    def test_a_cameras_frames_and_solved_ones_have_what_they_are_said_to_have_besides(self) -> None:
        """A camera's an arcsecond until their scatter is known, then 0.3″; solved ones always one."""
        of_camera: Any = Made(camera="guide", sigma_arcsec=0.4)
        solved: Any = Made(camera=None, sigma_arcsec=0.4)
        one, image = Estimator(25544, RISE_S), Made()
        nowhere: Any = Made(at=lambda *_: Made(unit=np.zeros(3)))
        for number in range(12):
            sighting = Sighting(Utc(RISE_S + number), np.zeros(3), 1.0, nowhere)
            for message, where, least in ((of_camera, image, 0.3), (solved, None, 1.0)):
                told = one._weighed(sighting, message, where, NO_BIAS)  # type: ignore[arg-type]
                besides = least if number >= 9 else 1.0
                assert told.sigma_rad / ARCSEC == pytest.approx(math.hypot(0.4, besides))
                assert told.image is where


@pytest.mark.parametrize(
    ("along_km", "across_km", "credible"),
    [
        (0.0, 0.0, True),
        (670.0, 99.0, True),
        (-680.0, 0.0, False),
        (0.0, -101.0, False),
        (680.0, 101.0, False),
    ],
)
def test_elements_that_would_be_off_by_more_than_any_are_not_followed(
    along_km: float, across_km: float, credible: bool
) -> None:
    """At 7.5 km/s, 90 s are 675 km."""
    correction_km = np.zeros(STATES)
    for other in range(ALONG + 1, STATES):
        correction_km[ALONG], correction_km[ALONG + 1 :] = along_km, 0.0
        correction_km[other] = across_km
        known: Any = Made(correction_km=correction_km, orbit=Made(speed_km_s=7.5))
        assert _credible(known) is credible


def test_of_what_a_profile_does_not_say_nothing_is_expected() -> None:
    assert known_terms(None) is None
    known = known_terms(SkyTerms("", {"delay_s": (0.1, 0.01)}, {"wide": {"scale": (0.02, 0.01)}}))
    assert known is not None
    said = [name == "delay_s" for name in MOUNT_TERMS]
    assert known.mount[0].tolist() == [0.1 if one else 0.0 for one in said]
    assert (known.mount[1] > 0.0).tolist() == said
    said = [name == "scale" for name in CAMERA_TERMS]
    assert known.cameras["wide"][0].tolist() == [0.02 if one else 0.0 for one in said]
    assert (known.cameras["wide"][1] > 0.0).tolist() == said


def test_what_was_learnt_is_half_as_uncertain_again_and_never_better_than_a_mount_is_set_up() -> None:
    """20″, 2 ms, 20 ms of a clock and a thousandth at least; of sides 1.5 and 2, 2.5 is the hypotenuse."""
    arcsec = 1.0 / 3600.0
    mount = {"cone_deg": (0.1, 10.0 * arcsec), "delay_s": (0.1, 0.001), "index_deg": (0.1, 1.0)}
    wide = {"rotation_deg": (1.0, 1e-9), "scale": (0.1, 1e-9), "clock_s": (0.1, 0.01)}
    known = known_terms(SkyTerms("", mount, {"wide": wide}))
    assert known is not None
    sigmas = dict(zip(MOUNT_TERMS, known.mount[1].tolist(), strict=True))
    assert sigmas["cone_deg"] == pytest.approx(25.0 * arcsec)
    assert sigmas["delay_s"] == pytest.approx(0.0025)
    assert sigmas["index_deg"] == pytest.approx(1.5, rel=1e-4)
    sigmas = dict(zip(CAMERA_TERMS, known.cameras["wide"][1].tolist(), strict=True))
    assert sigmas["rotation_deg"] == pytest.approx(20.0 * arcsec)
    assert sigmas["scale"] == pytest.approx(0.001)
    assert sigmas["clock_s"] == pytest.approx(0.025)


def test_a_pointing_model_makes_a_mount_as_good_as_it_is_and_leaves_delay_and_cameras() -> None:
    utc, mount = "2026-10-02T13:05:24Z", {name: (0.0, 0.01) for name in MOUNT_TERMS if name.endswith("_deg")}
    assert begun_anew(None, utc, 36.0) == SkyTerms(utc, mount | {"delay_s": (0.0, 0.002)})
    known = SkyTerms(
        "before", {"delay_s": (0.1, 0.01), "cone_deg": (0.5, 0.1)}, {"wide": {"scale": (0.1, 0.01)}}
    )
    assert begun_anew(known, utc, 36.0) == SkyTerms(utc, mount | {"delay_s": (0.1, 0.01)}, known.cameras)
