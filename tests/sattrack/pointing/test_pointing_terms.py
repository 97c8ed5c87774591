"""The terms of a pointing model against a stranger's mount of rotated vectors, and TPOINT's own formulas."""

from __future__ import annotations

import math
import random

import erfa
import numpy as np
import pytest
from strangers.tilted_mount import NAMES, TiltedMount, apart_arcsec, local

from sattrack.core.errors import BadInputError
from sattrack.mount.geometry import Pole
from sattrack.mount.model import PointingTerms
from sattrack.pointing.terms import PointingModel, first_order_deg, swung
from sattrack.runtime import demo_pass
from tle.instants import Utc
from tle.propagator import Propagator
from tle.refraction import Refraction
from tle.site import Site

ISS = demo_pass.elements()
SITES = (52.0, -35.0, 3.0)


def modelled(mount: TiltedMount, beyond_pole: bool = False) -> PointingModel:
    """Return the terms that a stranger's errors are called here: what must be added to what it reports."""
    terms = {name: -getattr(mount, error) for name, error in NAMES.items()} | {"TF": mount.sag}
    return PointingModel(terms, mount.latitude_deg, beyond_pole=beyond_pole)


POLES = (Pole(25.0, 35.0), Pole(-110.0, 10.0), Pole(300.0, 80.0), Pole(40.0, -30.0))


@pytest.mark.parametrize(
    "pole", [POLES[0], POLES[3], *(pytest.param(pole, marks=pytest.mark.soak) for pole in POLES[1:3])]
)
def test_a_mount_with_a_pole_of_its_own_looks_where_it_must(pole: Pole) -> None:
    """It reports the direction to which its axes would point without errors, by a faultless stranger."""
    azimuth, altitude, latitude = pole.pole_azimuth_deg, pole.pole_altitude_deg, 52.0
    errors = (4000.0, -6000.0, 600.0, 200.0, 900.0, -500.0, 30.0)
    mount = TiltedMount(altitude, *errors, pole_azimuth_deg=azimuth)
    faultless = TiltedMount(altitude, pole_azimuth_deg=azimuth)
    model = PointingModel(modelled(mount).terms, latitude, pole)
    seen = 0
    for h in range(-170, 180, 50):
        for d in range(-60, 90, 25):
            first, second = faultless.stands(local(h, d, latitude), (10.0, 0.0))
            second = math.remainder(second, 360.0)
            if abs(second) > 80.0:
                continue
            seen += 1
            reported = model.reported(h, d)
            stands = faultless.stands(local(*reported, latitude), (first, second))
            assert apart_arcsec(mount.looks(*stands), local(h, d, latitude)) < 0.005
            assert apart_arcsec(local(*model.looks(*reported), latitude), local(h, d, latitude)) < 1e-5
    assert seen > 20


def test_an_equatorial_mounts_model_is_one_about_the_celestial_pole() -> None:
    terms = modelled(TiltedMount(-35.0, 4000.0, -6000.0, 600.0, 200.0, 900.0, -500.0, 30.0)).terms
    plain, own = PointingModel(terms, -35.0), PointingModel(terms, -35.0, Pole(0.0, -35.0))
    for place in ((-50.0, 20.0), (70.0, -60.0)):
        assert own.reported(*place) == pytest.approx(plain.reported(*place), abs=1e-9)
        assert own.looks(*place) == pytest.approx(plain.looks(*place), abs=1e-9)


def test_a_pole_is_elsewhere_by_the_frames_turn() -> None:
    assert Pole(20.0, 35.0).moved_deg(Pole(20.0, 35.2)) == pytest.approx(0.2)
    assert Pole(359.9, 0.0).moved_deg(Pole(0.2, 0.0)) == pytest.approx(0.3)
    assert Pole(0.0, 90.0).moved_deg(Pole(90.0, 90.0)) == pytest.approx(90.0)


@pytest.mark.parametrize("beyond", [False, True])
@pytest.mark.parametrize("latitude", SITES)
def test_axes_of_a_mount_two_degrees_off_look_where_they_must(latitude: float, beyond: bool) -> None:
    mount = TiltedMount(latitude, 4000.0, -6000.0, 600.0, 200.0, 900.0, -500.0, 30.0)
    model, rng = modelled(mount, beyond), random.Random(1)
    for _ in range(60):
        h, d = rng.uniform(-80.0, 80.0), math.copysign(1.0, latitude) * rng.uniform(-45.0, 80.0)
        axes = model.axes_of(h, d)
        assert (abs(axes[1]) > 90.0) == beyond
        # Flexure is taken at the direction itself, not at the unbent one: its square is left.
        assert apart_arcsec(mount.looks(*axes), local(h, d, latitude)) < 0.005
        assert model.direction_of(*axes) == pytest.approx((h, d), abs=1e-8)


def test_arrays_give_what_single_directions_give() -> None:
    model = PointingModel({"ME": 300.0, "CH": 500.0, "TF": 20.0, "FO": 9.0, "HDSH2": 5.0, "PHD2": 3.0}, 40.0)
    h, d = np.array([-50.0, 10.0, 70.0]), np.array([-20.0, 30.0, 89.99])
    many = model.axes_of(h, d)
    for row in range(3):
        assert model.axes_of(float(h[row]), float(d[row])) == pytest.approx((many[0][row], many[1][row]))


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("IH", (1.0, 0.0)),
        ("ID", (0.0, 1.0)),
        ("CH", (1.0 / math.cos(0.5), 0.0)),
        ("NP", (math.tan(0.5), 0.0)),
        ("MA", (-math.cos(0.7) * math.tan(0.5), math.sin(0.7))),
        ("ME", (math.sin(0.7) * math.tan(0.5), math.cos(0.7))),
        (
            "TF",
            (
                math.cos(0.9) * math.sin(0.7) / math.cos(0.5),
                math.cos(0.9) * math.cos(0.7) * math.sin(0.5) - math.sin(0.9) * math.cos(0.5),
            ),
        ),
        ("DAF", (-(math.cos(0.9) * math.cos(0.7) + math.sin(0.9) * math.tan(0.5)), 0.0)),
        ("FO", (0.0, math.cos(0.7))),
        ("HCES", (math.sin(0.7), 0.0)),
        ("HCEC", (math.cos(0.7), 0.0)),
        ("DCES", (0.0, math.sin(0.5))),
        ("DCEC", (0.0, math.cos(0.5))),
        ("HDSH2", (0.0, math.sin(1.4))),
        ("HXCHSD", (math.cos(0.7) * math.sin(0.5) / math.cos(0.5), 0.0)),
        ("PDD2", (0.0, 0.25)),
    ],
)
def test_a_small_term_is_what_tpoint_calls_it(name: str, expected: tuple[float, float]) -> None:
    h, d, latitude = (math.degrees(x) for x in (0.7, 0.5, 0.9))
    assert first_order_deg({name: 1.0}, h, d, latitude) == pytest.approx(expected)
    axes = PointingModel({name: 1.0}, latitude).axes_of(h, d)
    added = (h - axes[0]) * 3600.0, (d - axes[1]) * 3600.0
    assert added == pytest.approx(expected, abs=2e-5)


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("IA", (-1.0, 0.0)),
        ("IE", (0.0, 1.0)),
        ("CA", (-1.0 / math.cos(0.5), 0.0)),
        ("NPAE", (-math.tan(0.5), 0.0)),
        ("AN", (-math.sin(0.7) * math.tan(0.5), -math.cos(0.7))),
        ("AW", (-math.cos(0.7) * math.tan(0.5), math.sin(0.7))),
        ("TF", (0.0, -math.cos(0.5))),
        ("ACES", (-math.sin(0.7), 0.0)),
        ("ACEC", (math.cos(0.7), 0.0)),
        ("ECES", (0.0, math.sin(0.5))),
        ("ECEC", (0.0, math.cos(0.5))),
    ],
)
def test_an_azimuth_mounts_small_term_is_what_tpoint_calls_it(
    name: str, expected: tuple[float, float]
) -> None:
    azimuth, altitude = math.degrees(0.7), math.degrees(0.5)
    axes = PointingModel({name: 1.0}, 33.0, "altaz").axes_of(-azimuth, altitude)
    added = (azimuth + axes[0]) * 3600.0, (altitude - axes[1]) * 3600.0
    assert added == pytest.approx(expected, abs=2e-5)


@pytest.mark.parametrize(
    ("terms", "direction", "reported"),
    [
        # The mount's pole 1° below the true one: a star in the south seems 1° nearer to the horizon's side.
        ({"ME": 3600.0}, (0.0, 10.0), (0.0, 9.0)),
        # The mount's pole 1° to the right of north, in the east: a star in the west is farther from it.
        ({"MA": 3600.0}, (90.0, 0.0), (90.0, -1.0)),
        # The axis shows 1° less than where the telescope is.
        ({"IH": 3600.0, "ID": 3600.0}, (30.0, 20.0), (29.0, 19.0)),
        # The telescope looks 1° west of square, so that the axis is east of the star.
        ({"CH": 3600.0}, (30.0, 0.0), (29.0, 0.0)),
        # The tube droops by 1° when level, in the meridian: the axis stands higher than the star.
        ({"TF": 3600.0}, (0.0, -40.0), (0.0, -39.0)),
    ],
)
def test_a_terms_sign_is_what_wallace_says_of_the_mount(
    terms: dict[str, float], direction: tuple[float, float], reported: tuple[float, float]
) -> None:
    """By the words of the comments in tptPterms.c, at 50° north."""
    assert PointingModel(terms, 50.0).axes_of(*direction) == pytest.approx(reported, abs=0.01)


@pytest.mark.parametrize(
    ("terms", "direction", "reported"),
    [
        # The first axis leans 1° to the north: a star in the north is 1° nearer to it, and seems higher.
        ({"AN": 3600.0}, (0.0, 30.0), (0.0, 31.0)),
        ({"AW": 3600.0}, (270.0, 30.0), (270.0, 31.0)),
        ({"TF": 3600.0}, (120.0, 0.0), (120.0, 1.0)),
    ],
)
def test_an_azimuth_terms_sign_is_what_wallace_says_of_the_mount(
    terms: dict[str, float], direction: tuple[float, float], reported: tuple[float, float]
) -> None:
    west, altitude = PointingModel(terms, 50.0, "altaz").axes_of(-direction[0], direction[1])
    assert (-west % 360.0, altitude) == pytest.approx(reported, abs=0.01)


def test_an_unknown_term_is_refused_by_its_name() -> None:
    with pytest.raises(BadInputError, match="'XYZ'"):
        PointingModel({"XYZ": 1.0}, 52.0)


@pytest.mark.parametrize("value", [math.nan, math.inf, -1e9])
def test_a_value_that_is_no_angle_is_refused_by_its_name(value: float) -> None:
    terms = PointingTerms(
        "2026-10-01T00:00:00Z", 52.0, {"IH": (1.0, 1.0), "CH": (value, 1.0)}, 1.0, 9, signs="tpoint"
    )
    with pytest.raises(BadInputError, match="CH of the pointing model"):
        PointingModel.of(terms)


EQUATORIAL = PointingModel({"ME": 4000.0, "MA": -6000.0, "CH": 600.0, "NP": 120.0, "TF": -30.0}, 52.0)
AZIMUTH = PointingModel(
    {"AN": 900.0, "AW": -700.0, "IA": 1200.0, "IE": -800.0, "CA": 300.0, "NPAE": 60.0, "TF": -30.0},
    52.0,
    "altaz",
)


TILTED = PointingModel(EQUATORIAL.terms, 52.0, Pole(40.0, 25.0))


@pytest.mark.parametrize("model", [EQUATORIAL, AZIMUTH, TILTED])
def test_a_satellites_rates_are_the_derivatives_of_what_the_mount_is_fed(model: PointingModel) -> None:
    site = Site(52.0, 4.5, 0.0)
    fed = Propagator(ISS, site, refraction=Refraction(), pointing=model)
    plain = Propagator(ISS, site, refraction=Refraction())
    begin = float(ISS.epoch.unix_s)
    seen = 0
    for step in range(0, 86400, 120):
        t = begin + step
        if float(plain.at(Utc(t)).alt_deg) < 5.0:
            continue
        seen += 1
        here, sooner, later = (fed.at(Utc(t + s)) for s in (0.0, -0.05, 0.05))
        turn = (float(later.ra_deg) - float(sooner.ra_deg) + 180.0) % 360.0 - 180.0
        assert float(here.ra_rate_deg_s) == pytest.approx(turn / 0.1, abs=3e-6)
        assert float(here.dec_rate_deg_s) == pytest.approx(
            (float(later.dec_deg) - float(sooner.dec_deg)) / 0.1, abs=3e-6
        )
        sky = plain.at(Utc(t))
        axes = model.reported(float(sky.ha_deg), float(sky.dec_deg))
        assert model.looks(*axes)[1] == pytest.approx(float(sky.dec_deg), abs=1e-8)
        off = (float(here.ha_deg) - axes[0] + 180.0) % 360.0 - 180.0
        assert off == pytest.approx(0.0, abs=0.1 / 3600.0)
        assert float(here.dec_deg) == pytest.approx(axes[1], abs=0.1 / 3600.0)
    assert seen > 5


def test_azimuth_and_altitude_are_those_of_erfa() -> None:
    for h, d in ((-40.0, 20.0), (70.0, 60.0), (150.0, 80.0)):
        west, altitude = swung(h, d, 52.0)
        azimuth, known = erfa.hd2ae(math.radians(h), math.radians(d), math.radians(52.0))
        assert math.remainder(-west - math.degrees(azimuth), 360.0) == pytest.approx(0.0, abs=1e-9)
        assert altitude == pytest.approx(math.degrees(known), abs=1e-9)
