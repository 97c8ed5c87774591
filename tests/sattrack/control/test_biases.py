"""All offsets together: what each moves, against ERFA and the propagator; rates against differences."""

from __future__ import annotations

import math

import erfa
import numpy as np
import pytest

from sattrack.control.biases import (
    Biases,
    begin_search,
    change_offset,
    clear_biases,
    end_reached,
    follow_estimate,
)
from sattrack.control.camera_image import Camera
from sattrack.control.estimate import EstimatedBiases
from sattrack.control.offset import spiral
from sattrack.mount.geometry import AxisGeometry
from sattrack.mount.model import AxisLimits, MountProfile, SitePlace
from sattrack.runtime import demo_pass
from sattrack.views.messages import OffsetBy, Search
from tle.bias import NO_BIAS, Bias
from tle.instants import Utc
from tle.propagator import Propagator

CULMINATION_S = float(Utc.parse("2026-10-02T13:05:24Z").unix_s)
ARCSEC = 1.0 / 3600.0
SETTLED_S = 3.0


@pytest.fixture
def propagator() -> Propagator:
    return Propagator(demo_pass.elements(), demo_pass.SITE.place())


@pytest.fixture
def biases(propagator: Propagator) -> Biases:
    return Biases(NO_BIAS, propagator, MountProfile(), Camera(30.0))


def unit(direction: object) -> np.ndarray:
    return np.asarray(erfa.s2c(math.radians(direction.ra_deg), math.radians(direction.dec_deg)))


def offset(biases: Biases, what: str, value: float, at_s: float = CULMINATION_S) -> None:
    assert change_offset(biases, OffsetBy(what, "add", value), at_s) is None


@pytest.mark.parametrize(
    ("what", "position_angle_deg"),
    [
        ("ra_cos_dec_deg", 90.0),
        ("dec_deg", 0.0),
        ("dec_axis_deg", 0.0),
        ("camera_y_deg", 30.0),
        ("camera_x_deg", 120.0),
    ],
)
@pytest.mark.parametrize("value", [0.2, -0.05])
def test_an_offset_on_the_sky_moves_the_target_so_far_in_its_direction(
    biases: Biases, propagator: Propagator, what: str, position_angle_deg: float, value: float
) -> None:
    offset(biases, what, value)
    for late_s in (SETTLED_S, 60.0):
        plain = unit(propagator.at(Utc(CULMINATION_S + late_s)))
        moved = unit(biases.at(CULMINATION_S + late_s))
        assert math.degrees(erfa.sepp(plain, moved)) == pytest.approx(abs(value), rel=1e-9)
        angle = erfa.pap(plain, moved) - math.radians(position_angle_deg + (180.0 if value < 0.0 else 0.0))
        assert math.cos(angle) == pytest.approx(1.0)


@pytest.fixture
def turning(propagator: Propagator) -> Biases:
    """Offsets on an alt-azimuth mount, whose camera turns on the sky."""
    site = demo_pass.SITE.place()
    stands = SitePlace(site.latitude_deg, site.longitude_deg)
    return Biases(NO_BIAS, propagator, MountProfile(geometry=AxisGeometry(0.0, 90.0), stands_at=stands))


@pytest.mark.parametrize("late_s", [SETTLED_S, 60.0])
@pytest.mark.parametrize(("what", "up"), [("camera_x_deg", False), ("camera_y_deg", True)])
def test_an_image_of_an_alt_azimuth_mount_has_the_zenith_above(
    turning: Biases, propagator: Propagator, what: str, up: bool, late_s: float
) -> None:
    """And x is 90° further, as by the zenith east is from north: there azimuth falls."""
    utc_s = CULMINATION_S - 60.0
    offset(turning, what, 0.1, utc_s)
    plain, moved = propagator.at(Utc(utc_s + late_s)), turning.at(utc_s + late_s)
    level = math.cos(math.radians(float(plain.alt_deg)))
    left_deg = math.remainder(float(plain.az_deg) - float(moved.az_deg), 360.0) * level
    up_deg = float(moved.alt_deg) - float(plain.alt_deg)
    assert (left_deg, up_deg) == pytest.approx((0.0, 0.1) if up else (0.1, 0.0), abs=1e-3)


@pytest.mark.parametrize(
    ("x_deg", "y_deg", "camera", "azimuth_deg", "up_deg"),
    [
        (0.1, 0.0, Camera(), 0.1, 0.0),
        (0.0, 0.1, Camera(), 0.0, 0.1),
        (0.1, 0.0, Camera(flip=True), -0.1, 0.0),
        # Up is 90° from the zenith, as east is from north: there azimuth falls.
        (0.0, 0.1, Camera(90.0), -0.1, 0.0),
    ],
)
def test_what_a_camera_of_an_alt_azimuth_mount_sees_to_the_right_has_more_azimuth(
    turning: Biases,
    propagator: Propagator,
    x_deg: float,
    y_deg: float,
    camera: Camera,
    azimuth_deg: float,
    up_deg: float,
) -> None:
    """Facing the satellite, azimuth grows to the right: by erfa's horizon at the mount's latitude."""
    latitude = math.radians(demo_pass.SITE.place().latitude_deg)
    for utc_s in (CULMINATION_S - 60.0, CULMINATION_S + 60.0):
        fed = propagator.at(Utc(utc_s))
        sidereal = math.radians(float(fed.ra_deg) + float(fed.ha_deg))
        image = turning.image_at(utc_s, 0.0, 0.0, camera, "")
        seen = image.fed + math.radians(x_deg) * image.right + math.radians(y_deg) * image.up
        (az, alt), (az_fed, alt_fed) = (
            erfa.hd2ae(sidereal - ra, dec, latitude) for ra, dec in (erfa.c2s(seen), erfa.c2s(image.fed))
        )
        moved = math.remainder(az - az_fed, 2.0 * math.pi) * math.cos(alt_fed), alt - alt_fed
        assert tuple(map(math.degrees, moved)) == pytest.approx((azimuth_deg, up_deg), abs=1e-3)


@pytest.mark.parametrize("late_s", [0.7, 2.0, 30.0])
def test_an_offset_in_an_image_that_turns_on_the_sky_turns_with_it(turning: Biases, late_s: float) -> None:
    """Its rates are the derivatives of where it leads: without the turning they are off by minutes of arc."""
    begins_s = CULMINATION_S - 20.0
    offset(turning, "camera_x_deg", 1.0, begins_s)
    offset(turning, "camera_y_deg", -2.0, begins_s)
    t, step_s = begins_s + late_s, 2e-3
    later_s, sooner_s = t + step_s, t - step_s
    here, later, sooner = (turning.at(at_s) for at_s in (t, later_s, sooner_s))
    for name in ("ra", "dec"):
        slope = (getattr(later, f"{name}_deg") - getattr(sooner, f"{name}_deg")) / (later_s - sooner_s)
        assert getattr(here, f"{name}_rate_deg_s") == pytest.approx(slope, abs=0.5 * ARCSEC), name


def test_an_offset_of_the_right_ascension_axis_adds_to_the_right_ascension(
    biases: Biases, propagator: Propagator
) -> None:
    offset(biases, "ra_axis_deg", 0.3)
    t = CULMINATION_S + SETTLED_S
    plain, moved = propagator.at(Utc(t)), biases.at(t)
    assert moved.ra_deg - plain.ra_deg == pytest.approx(0.3)
    assert moved.dec_deg == pytest.approx(plain.dec_deg)


def test_along_and_across_are_the_propagators_own(biases: Biases, propagator: Propagator) -> None:
    offset(biases, "along_s", 0.5)
    offset(biases, "cross_deg", -0.1)
    t = CULMINATION_S + SETTLED_S
    expected = propagator.at(Utc(t), Bias(0.5, -0.1))
    assert np.linalg.norm(unit(biases.at(t)) - unit(expected)) < 1e-12


@pytest.mark.parametrize("late_s", [-40.0, 20.0])
def test_what_is_asked_for_is_the_sum_and_an_estimate_across_turns_by_its_distance(
    biases: Biases, late_s: float
) -> None:
    """At the range where the satellite is fed, all that is asked for along the track counted."""
    asked_s = CULMINATION_S + late_s
    assert biases.totals(asked_s) == (0.0, 0.0)
    offset(biases, "along_s", 8.0, asked_s)
    offset(biases, "cross_deg", -0.02, asked_s)
    assert biases.totals(asked_s + SETTLED_S) == (8.0, -0.02)
    biases.begin_estimated(3.0, 25.0)
    for utc_s in (asked_s + SETTLED_S, asked_s + 60.0):
        along_s, cross_deg = biases.totals(utc_s)
        assert along_s == pytest.approx(11.0)
        range_km = biases.course.going(utc_s + 11.0).range_km
        assert math.tan(math.radians(cross_deg + 0.02)) * range_km == pytest.approx(25.0)
    assert begin_search(biases, Search("spiral", 0.2, 0.1), asked_s + 60.0) is None
    apart = biases.applied(asked_s + 70.0)[1].value - biases.totals(asked_s + 70.0)[1]
    assert abs(apart) > 0.05


def all_at_once(biases: Biases) -> None:
    begins_s = CULMINATION_S - 20.0
    biases_of = {
        "along_s": 0.4,
        "cross_deg": -0.02,
        "ra_cos_dec_deg": 0.05,
        "dec_deg": 0.1,
        "ra_axis_deg": -0.07,
        "dec_axis_deg": 0.03,
        "camera_x_deg": 0.2,
        "camera_y_deg": -0.1,
    }
    for what, value in biases_of.items():
        offset(biases, what, value, begins_s)
    assert change_offset(biases, OffsetBy("along_s", "rate", 0.01), begins_s + 0.5) is None
    follow_estimate(biases, EstimatedBiases(0.3, 0.2, 2e-3, 1e-4, 0.01, 0.01), False, begins_s + 1.0)


@pytest.mark.parametrize("late_s", [0.2, 0.8, 1.7, 5.0, 20.0, 21.3])
@pytest.mark.parametrize(
    "search", [None, Search("spiral", 0.2, 0.1), Search("sweep", reach_s=0.5, period_s=10.0)]
)
def test_rates_are_derivatives_of_the_positions(biases: Biases, late_s: float, search: Search | None) -> None:
    all_at_once(biases)
    if search is not None:
        assert begin_search(biases, search, CULMINATION_S - 19.9) is None
    t, step_s = CULMINATION_S - 20.0 + late_s, 2e-3
    after_s, before_s = t + step_s, t - step_s
    here, later, sooner = (biases.at(at_s) for at_s in (t, after_s, before_s))
    for name in ("ra", "dec", "alt", "az"):
        slope = (getattr(later, f"{name}_deg") - getattr(sooner, f"{name}_deg")) / (after_s - before_s)
        assert getattr(here, f"{name}_rate_deg_s") == pytest.approx(slope, abs=0.05 * ARCSEC), name


@pytest.mark.parametrize(
    ("by_s", "by_km", "within_s"), [(0.001, 0.0, 0.2), (0.0, -0.009, 0.2), (0.02, 0.0, 0.5), (0.0, 0.05, 0.5)]
)
def test_an_estimate_that_lies_close_is_followed_sooner(
    biases: Biases, by_s: float, by_km: float, within_s: float
) -> None:
    """Near culmination 5″ are a millisecond along and 10 m across."""
    begins_s = CULMINATION_S + 20.0
    follow_estimate(biases, EstimatedBiases(0.3, 0.2, 0.0, 0.0, 0.01, 0.01), True, begins_s - 19.0)
    follow_estimate(biases, EstimatedBiases(0.3 + by_s, 0.2 + by_km, 0.0, 0.0, 0.01, 0.01), False, begins_s)
    begun, there = (biases.applied(begins_s + k * within_s)[0].value for k in (0.5, 1.0))
    assert biases.estimated_along.ended_utc_s() - begins_s == pytest.approx(within_s, abs=1e-3)
    assert biases.estimated_cross_km.ended_utc_s() - begins_s == pytest.approx(within_s, abs=1e-3)
    assert there == pytest.approx(0.3 + by_s)
    assert begun == pytest.approx(0.3 + 0.5 * by_s)


def rates(biases: Biases, times: np.ndarray) -> np.ndarray:
    seen = [biases.at(float(t)) for t in times]
    return np.array([(d.ra_rate_deg_s, d.dec_rate_deg_s) for d in seen])


@pytest.mark.parametrize("how", ["stop", "cancel"])
@pytest.mark.parametrize(
    "search",
    [Search("spiral", 0.2, 0.1), Search("sweep", reach_s=1.0, period_s=20.0)],
    ids=["spiral", "sweep"],
)
def test_a_search_ends_where_it_is_or_in_its_centre_without_a_step(
    biases: Biases, propagator: Propagator, search: Search, how: str
) -> None:
    assert begin_search(biases, search, CULMINATION_S) is None
    stopped_s = CULMINATION_S + 13.0
    there = unit(biases.at(stopped_s))
    away = math.degrees(erfa.sepp(there, unit(propagator.at(Utc(stopped_s)))))
    assert away > 0.1
    assert begin_search(biases, Search(how), stopped_s) is None
    times = np.arange(stopped_s - 1.0, stopped_s + 9.0, 1e-2)
    jumps = np.abs(np.diff(rates(biases, times), axis=0)) / 1e-2
    assert jumps.max() < 0.5 * MountProfile().ra.max_acceleration_deg_s2
    along, cross = biases.applied(times[-1])
    assert along.rate == cross.rate == 0.0
    if how == "cancel":
        assert (along.value, cross.value) == (0.0, 0.0)
    else:
        kept = Bias(along.value, cross.value)
        gap = erfa.sepp(unit(propagator.at(Utc(stopped_s), kept)), there)
        assert math.degrees(gap) < 0.25
    assert begin_search(biases, Search(how), stopped_s + 9.0) == "no search is running"


@pytest.mark.parametrize("begins_s", [CULMINATION_S - 150.0, CULMINATION_S - 20.0])
def test_a_spiral_keeps_its_shape_on_the_sky_while_the_pace_changes(
    biases: Biases, propagator: Propagator, begins_s: float
) -> None:
    assert begin_search(biases, Search("spiral", 0.2, 0.1), begins_s) is None
    for elapsed_s in (5.0, 20.0, 60.0):
        point = spiral(elapsed_s, 0.2, 0.1)
        t = begins_s + elapsed_s
        apart = erfa.sepp(unit(propagator.at(Utc(t))), unit(biases.at(t)))
        assert math.degrees(apart) == pytest.approx(math.hypot(point[0], point[1]), rel=0.03)


def test_a_spiral_that_finds_nothing_goes_back(biases: Biases) -> None:
    assert begin_search(biases, Search("spiral", 1.0, 0.5), CULMINATION_S - 100.0) is None
    told = [end_reached(biases, CULMINATION_S - 100.0 + s) for s in range(200)]
    words = [w for w in told if w is not None]
    assert len(words) == 1
    assert "found nothing within 5.0°" in words[0]
    assert biases.applied(CULMINATION_S + 120.0)[0].value == 0.0


def test_a_rate_is_stopped_where_an_offset_ends(biases: Biases) -> None:
    assert change_offset(biases, OffsetBy("dec_deg", "rate", 0.2), CULMINATION_S) is None
    told = [end_reached(biases, CULMINATION_S + s) for s in range(60)]
    assert [w for w in told if w] == ["dec_deg went as far as it may, 5, and was stopped"]
    assert biases.offsets["dec_deg"].state(CULMINATION_S + 90.0).value == pytest.approx(5.1, abs=0.3)


@pytest.mark.parametrize(
    ("order", "words"),
    [
        (OffsetBy("along_s", "add", 61.0), "along_s refused: 61 s; it goes to 60 s either way"),
        (OffsetBy("along_s", "set", math.nan), "along_s refused: nan s; it goes to 60 s either way"),
        (
            OffsetBy("camera_x_deg", "gradual", 6.0, 10.0),
            "camera_x_deg refused: 6°; it goes to 5° either way",
        ),
        (OffsetBy("dec_deg", "rate", 0.6), "dec_deg refused: a rate of 0.6°/s; it goes to 0.5°/s"),
        (OffsetBy("dec_deg", "gradual", 1.0, 1e9), "dec_deg refused: 1e+09 seconds; give 0 to 3600"),
        (Search("spiral", 0.0, 0.1), "spiral refused: spacing_deg 0; give 0.001 to 2"),
        (
            Search("spiral", 0.01, 1.5),
            "spiral refused: the mount cannot do 1.5°/s with arms 0.01° apart: slower, or wider",
        ),
        (
            Search("sweep", reach_s=50.0, period_s=2.0),
            "sweep refused: the mount cannot sweep 50 s in 2 s: less far, or slower",
        ),
        (Search("sweep", reach_s=math.inf, period_s=9.0), "sweep refused: reach_s inf; give 0.01 to 60"),
        # What is given as nothing is refused, and not taken for something usual.
        (Search("spiral", 0.2, 0.0), "spiral refused: speed_deg_s 0; give 0.0001 to 2"),
        (Search("sweep", reach_s=0.0, period_s=9.0), "sweep refused: reach_s 0; give 0.01 to 60"),
        (Search("sweep", reach_s=0.1, period_s=0.0), "sweep refused: period_s 0; give 2 to 600"),
    ],
)
def test_what_goes_too_far_is_refused_in_words_and_changes_nothing(
    biases: Biases, order: OffsetBy | Search, words: str
) -> None:
    before = unit(biases.at(CULMINATION_S + 20.0))
    obey = change_offset if isinstance(order, OffsetBy) else begin_search
    assert obey(biases, order, CULMINATION_S) == words  # type: ignore[arg-type]
    assert (unit(biases.at(CULMINATION_S + 20.0)) == before).all()


def test_clearing_takes_everything_away_without_a_step(biases: Biases, propagator: Propagator) -> None:
    all_at_once(biases)
    assert begin_search(biases, Search("spiral", 0.2, 0.1), CULMINATION_S - 15.0) is None
    begins_s = CULMINATION_S + 1.0
    clear_biases(biases, begins_s)
    times = np.arange(begins_s - 0.5, begins_s + 12.0, 1e-2)
    jumps = np.abs(np.diff(rates(biases, times), axis=0)) / 1e-2
    assert jumps.max() < 2.0 * MountProfile().ra.max_acceleration_deg_s2
    end = float(times[-1])
    assert np.linalg.norm(unit(biases.at(end)) - unit(propagator.at(Utc(end)))) < 1e-12


def test_a_slow_mount_is_asked_for_less(propagator: Propagator) -> None:
    slow = AxisLimits(max_rate_deg_s=2.0, max_acceleration_deg_s2=0.5)
    biases = Biases(NO_BIAS, propagator, MountProfile(ra=slow, dec=slow))
    offset(biases, "along_s", 2.0)
    times = np.arange(CULMINATION_S - 1.0, CULMINATION_S + 30.0, 1e-2)
    plain = Biases(NO_BIAS, propagator, MountProfile())
    extra = np.diff(rates(biases, times), axis=0) - np.diff(rates(plain, times), axis=0)
    assert np.abs(extra).max() / 1e-2 < 0.5
    assert biases.applied(float(times[-1]))[0].value == 2.0
