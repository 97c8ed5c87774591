from __future__ import annotations

import erfa
import numpy as np
import pytest
from skyfield.earthlib import refract
from tle_facts import ISS, LEIDEN, separation_arcsec

from tle.elements import Elements
from tle.errors import RefractionError
from tle.instants import Utc
from tle.propagator import Propagator
from tle.refraction import Refraction
from tle.site import Site

AIR = Refraction(1010.0, 10.0)
ALTITUDES_DEG = np.linspace(-90.0, 90.0, 18001)


@pytest.mark.parametrize(
    ("altitude_deg", "arcsec"), [(10.0, 320.0), (20.0, 162.0), (30.0, 103.0), (45.0, 60.0), (60.0, 35.0)]
)
def test_usual_values(altitude_deg, arcsec):
    assert AIR.bend_deg(altitude_deg)[0] * 3600.0 == pytest.approx(arcsec, abs=1.0)


def test_high_up_it_is_erfas():
    a, b = erfa.refco(1010.0, 10.0, 0.0, 0.574)
    for altitude_deg in (25.0, 40.0, 60.0, 80.0):
        # Bennett's gives 3 % more than theory here. ERFA's formula starts from the refracted zenith distance.
        zenith = np.radians(90.0 - altitude_deg - AIR.bend_deg(altitude_deg)[0])
        theirs_arcsec = np.degrees(a * np.tan(zenith) + b * np.tan(zenith) ** 3) * 3600.0
        assert AIR.bend_deg(altitude_deg)[0] * 3600.0 == pytest.approx(theirs_arcsec, rel=0.05)


def test_above_the_horizon_it_is_skyfields():
    for altitude_deg in (0.0, 1.0, 3.0, 5.0, 10.0, 30.0, 60.0):
        theirs_deg = refract(altitude_deg, 10.0, 1010.0) - altitude_deg
        assert AIR.bend_deg(altitude_deg)[0] * 60.0 == pytest.approx(theirs_deg * 60.0, abs=0.03)


@pytest.mark.parametrize("air", [AIR, Refraction(1200.0, -100.0), Refraction(300.0, 60.0)])
def test_it_is_smooth_keeps_the_order_and_ends_at_both_sides(air):
    bend, slope = air.bend_deg(ALTITUDES_DEG)
    assert (np.diff(ALTITUDES_DEG + bend) > 0.0).all()
    assert bend.min() > -1e-6
    assert bend.max() < 2.0
    assert bend[-1] * 3600.0 == pytest.approx(0.0, abs=0.01)
    assert bend[0] * 3600.0 == pytest.approx(0.0, abs=0.01)
    middle = 0.5 * (slope[1:] + slope[:-1])
    assert np.diff(bend) / np.diff(ALTITUDES_DEG) == pytest.approx(middle, abs=2e-4)


def test_numbers_and_arrays_agree():
    bend, slope = AIR.bend_deg(ALTITUDES_DEG)
    for i in range(0, len(ALTITUDES_DEG), 611):
        assert AIR.bend_deg(float(ALTITUDES_DEG[i])) == pytest.approx((bend[i], slope[i]), rel=1e-12)


def test_it_follows_the_air():
    assert Refraction(505.0, 10.0).bend_deg(20.0)[0] == pytest.approx(AIR.bend_deg(20.0)[0] / 2.0, rel=0.002)
    assert Refraction(1010.0, -10.0).bend_deg(20.0)[0] / AIR.bend_deg(20.0)[0] == pytest.approx(
        283.0 / 263.0, rel=0.001
    )
    assert Refraction(0.0, 0.0).bend_deg(5.0)[0] == 0.0
    sea, high = Refraction.standard(0.0), Refraction.standard(5000.0)
    assert (sea.pressure_hpa, sea.temperature_c) == (1013.25, 15.0)
    # ICAO standard atmosphere, 5000 m: 540.2 hPa, -17.5 °C.
    assert (high.pressure_hpa, high.temperature_c) == pytest.approx((540.2, -17.5), abs=0.1)
    Refraction.standard(90000.0)


@pytest.mark.parametrize("numbers", [(-1.0, 10.0), (1300.0, 10.0), (float("nan"), 0.0), (1000.0, 100.0)])
def test_air_that_is_none_is_refused(numbers):
    with pytest.raises(RefractionError, match="outside"):
        Refraction(*numbers)


def test_directions_are_raised_towards_the_zenith():
    times = Utc.range(Utc.parse("2026-10-02T12:50:00Z"), Utc.parse("2026-10-02T13:20:00Z"), 7.0)
    elements, site = Elements.from_tle(*ISS), Site(*LEIDEN)
    plain, raised = (Propagator(elements, site, refraction=air).at(times) for air in (None, AIR))
    assert plain.alt_deg.min() < -20.0
    bend, _ = AIR.bend_deg(plain.alt_deg)
    assert raised.alt_deg - plain.alt_deg == pytest.approx(bend, abs=1e-9)
    assert (raised.az_deg - plain.az_deg) * np.cos(np.radians(plain.alt_deg)) == pytest.approx(0.0, abs=1e-8)
    moved = separation_arcsec(plain.ra_deg, plain.dec_deg, raised.ra_deg, raised.dec_deg)
    assert moved == pytest.approx(bend * 3600.0, abs=1e-4)
    assert (raised.range_km == plain.range_km).all()
