from __future__ import annotations

import math

import numpy as np
import pytest
from geometry import site_below, site_that_sees_it_at_the_pole
from hypothesis import given, settings
from hypothesis import strategies as st
from tle_facts import DECAYING, ISS, LEIDEN, MOLNIYA, PARANAL, STARLINK_ALPHA5, TDRS3, separation_arcsec, unit

from tle.bias import Bias
from tle.earth import EarthOrientation
from tle.elements import Elements
from tle.errors import DecayedError, PlaceError, TimeRangeError
from tle.instants import Utc
from tle.propagator import Propagator
from tle.refraction import Refraction
from tle.site import Site
from tle.sun import LIGHT_KM_S

ELEMENTS = Elements.from_tle(*ISS, name="ISS (ZARYA)")
START = Utc.parse("2026-10-02T13:01:06Z")
PASS = Utc(START.unix_s + np.arange(0.0, 516.0, 4.0))
PLAIN = EarthOrientation.fixed(0.0)
QUANTITIES = (
    *("ra_deg", "dec_deg", "ra_rate_deg_s", "dec_rate_deg_s", "ha_deg", "ha_rate_deg_s", "alt_deg", "az_deg"),
    *("alt_rate_deg_s", "az_rate_deg_s", "range_km", "range_rate_km_s"),
)
VARIANTS = {
    "apparent": {},
    "geometric": {"place": "geometric"},
    "astrometric": {"place": "astrometric"},
    "biased": {"bias": Bias(3.0, -0.4, 1e-3, 1e-4, START)},
    "refracted": {"refraction": Refraction(900.0, -5.0)},
    "all at once": {"bias": Bias(-7.0, 1.5, -2e-3, 3e-4, START), "refraction": Refraction()},
}


@pytest.mark.parametrize("variant", VARIANTS)
def test_one_instant_is_as_one_of_many(variant):
    propagator = Propagator(ELEMENTS, Site(*LEIDEN), **VARIANTS[variant])
    many = propagator.at(PASS)
    for i in range(0, len(PASS), 16):
        one = propagator.at(PASS[i])
        for name in QUANTITIES:
            assert isinstance(getattr(one, name), float)
            # 1e-7 is 0.0004 arcsec, or a tenth of a millimetre a second.
            assert getattr(many, name)[i] == pytest.approx(getattr(one, name), rel=1e-7, abs=1e-7), name
        # Across the track counts SGP4's velocity, which many instants have by interpolation.
        assert many.unit[i] == pytest.approx(one.unit, abs=2e-9)
        assert many.unit_rate[i] == pytest.approx(one.unit_rate, abs=1e-9)
        assert bool(many.sunlit[i]) is one.sunlit
        assert one.error == many.error[i] == 0


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("lines", [ISS, MOLNIYA, TDRS3], ids=["LEO", "HEO", "GSO"])
def test_rates_are_derivatives_of_the_positions(variant, lines):
    elements = Elements.from_tle(*lines)
    kept = dict(VARIANTS[variant])
    if "bias" in kept:
        kept["bias"] = Bias(3.0, -0.4, 1e-3, 1e-4, elements.epoch)
    propagator = Propagator(elements, Site(*LEIDEN), **kept)
    times = (START if lines is ISS else elements.epoch).unix_s + np.linspace(0.0, 516.0, 40)
    seen = propagator.at(Utc(times))
    shifted = {s: propagator.at(Utc(times + s)) for s in (-0.25, -0.125, 0.125, 0.25)}

    def derivative(change):
        """Of fourth order; `change` returns the difference of a quantity between two shifts."""
        return (8.0 * change(0.125, -0.125) - change(0.25, -0.25)) / 1.5

    rate = derivative(lambda a, b: shifted[a].unit - shifted[b].unit)
    assert np.degrees(np.linalg.norm(seen.unit_rate - rate, axis=1)).max() * 3600.0 < 0.005
    across_dec, across_alt = np.cos(np.radians(seen.dec_deg)), np.cos(np.radians(seen.alt_deg))
    for name, across in (
        ("ra", across_dec),
        ("dec", 1.0),
        ("ha", across_dec),
        ("alt", 1.0),
        ("az", across_alt),
    ):

        def turn(a, b, name=name):
            angles = getattr(shifted[a], f"{name}_deg") - getattr(shifted[b], f"{name}_deg")
            return np.remainder(angles + 180.0, 360.0) - 180.0

        off = (derivative(turn) - getattr(seen, f"{name}_rate_deg_s")) * across
        assert np.abs(off).max() * 3600.0 < 0.005, name
    rate = derivative(lambda a, b: shifted[a].range_km - shifted[b].range_km)
    assert np.abs(rate - seen.range_rate_km_s).max() < 1e-6


def _against_difference(propagator, times, direction_of):
    """Return the largest error of the rate of a unit vector, arcsec/s, and the vectors."""
    # Fourth order: a sixth-of-third-derivative error alone would take the whole bound at 1.4 °/s.
    near, far = 0.125, 0.25
    values = {s: direction_of(propagator.at(Utc(times + s)))[0] for s in (-far, -near, near, far)}
    derivative = (8.0 * (values[near] - values[-near]) - (values[far] - values[-far])) / (12.0 * near)
    here, rate = direction_of(propagator.at(Utc(times)))
    return np.degrees(np.linalg.norm(rate - derivative, axis=0)).max() * 3600.0, here


def _equatorial(seen):
    return _vector(seen.ra_deg, seen.dec_deg, seen.ra_rate_deg_s, seen.dec_rate_deg_s)


def _horizontal(seen):
    return _vector(seen.az_deg, seen.alt_deg, seen.az_rate_deg_s, seen.alt_rate_deg_s)


def _vector(longitude_deg, latitude_deg, longitude_rate_deg_s, latitude_rate_deg_s):
    """Return the unit vector of two angles, and its derivative made of theirs."""
    a, b = np.radians(longitude_deg), np.radians(latitude_deg)
    a_rate, b_rate = np.radians(longitude_rate_deg_s), np.radians(latitude_rate_deg_s)
    along = np.array([-np.sin(a), np.cos(a), np.zeros_like(a)]) * np.cos(b) * a_rate
    up = np.array([-np.sin(b) * np.cos(a), -np.sin(b) * np.sin(a), np.cos(b)]) * b_rate
    return unit(longitude_deg, latitude_deg), along + up


@pytest.mark.parametrize("lines", [ISS, STARLINK_ALPHA5], ids=["ISS", "inclined by 70 degrees"])
@pytest.mark.parametrize("aside_deg", [0.0, 0.002])
@pytest.mark.parametrize("bias", [Bias(), Bias(0.1, 0.01)], ids=["plain", "biased"])
def test_rates_at_the_celestial_pole(lines, aside_deg, bias):
    elements = Elements.from_tle(*lines)
    at = elements.epoch.plus(86400.0)
    highest = max((at.plus(s) for s in range(0, 6000, 20)), key=lambda t: _latitude_deg(lines, t))
    site = site_that_sees_it_at_the_pole(lines, highest, aside_deg)
    propagator = Propagator(elements, site, bias, earth=PLAIN)
    times = highest.unix_s + np.linspace(-5.0, 5.0, 2001)
    error_arcsec_s, directions = _against_difference(propagator, times, _equatorial)
    assert np.degrees(np.arccos(directions[2].max())) < 0.1
    assert error_arcsec_s < 0.05


def _latitude_deg(lines, t):
    return site_below(lines, t).latitude_deg


@pytest.mark.parametrize("bias", [Bias(), Bias(0.1, 0.01)], ids=["plain", "biased"])
def test_rates_at_the_zenith(bias):
    at = ELEMENTS.epoch.plus(86400.0)
    propagator = Propagator(ELEMENTS, site_below(ISS, at), bias, earth=PLAIN)
    times = at.unix_s + np.linspace(-5.0, 5.0, 2001)
    error_arcsec_s, directions = _against_difference(propagator, times, _horizontal)
    assert np.degrees(np.arccos(directions[2].max())) < 0.1
    assert error_arcsec_s < 0.05


def test_straight_up_is_defined():
    at = ELEMENTS.epoch.plus(86400.0)
    for air in (None, Refraction()):
        seen = Propagator(ELEMENTS, site_below(ISS, at), earth=PLAIN, place="geometric", refraction=air).at(
            at
        )
        assert seen.alt_deg == pytest.approx(90.0, abs=1e-4)
        assert math.isfinite(seen.az_deg + seen.az_rate_deg_s + seen.alt_rate_deg_s)


def test_what_light_time_does():
    site = Site(*LEIDEN)
    geometric = Propagator(ELEMENTS, site, place="geometric")
    seen = Propagator(ELEMENTS, site, diurnal_aberration=False).at(PASS)
    plain = geometric.at(PASS)
    # By definition: the satellite a light time ago, from where the observer is now.
    delays = plain.range_km / LIGHT_KM_S
    for _ in range(3):
        ago = [geometric.at(PASS[i], Bias(-float(delays[i]))) for i in range(len(PASS))]
        delays = np.array([one.range_km for one in ago]) / LIGHT_KM_S
    wanted = np.array([one.unit for one in ago])
    assert np.degrees(np.linalg.norm(seen.unit - wanted, axis=1)).max() * 3600.0 < 1e-4
    assert seen.range_km == pytest.approx([one.range_km for one in ago], abs=1e-6)
    moved = separation_arcsec(seen.ra_deg, seen.dec_deg, plain.ra_deg, plain.dec_deg)[plain.alt_deg > 10.0]
    assert 2.0 < moved.min() < moved.max() < 5.5


def test_what_diurnal_aberration_does():
    site = Site(*LEIDEN)
    on = Propagator(ELEMENTS, site).at(PASS)
    off = Propagator(ELEMENTS, site, diurnal_aberration=False).at(PASS)
    # The observer moves east at 0.285 km/s at this latitude: towards east by v/c times the sine of the angle.
    speed = 2.0 * math.pi / 86164.0905 * math.hypot(*site.itrs_km[:2])
    east = unit((on.ra_deg + on.ha_deg) + 90.0, np.zeros(len(PASS))).T
    along = (off.unit * east).sum(axis=1, keepdims=True)
    wanted = off.unit + speed / LIGHT_KM_S * (east - along * off.unit)
    assert np.degrees(np.linalg.norm(on.unit - wanted, axis=1)).max() * 3600.0 < 1e-4
    assert separation_arcsec(on.ra_deg, on.dec_deg, off.ra_deg, off.dec_deg).max() < 0.2
    assert (on.range_km == off.range_km).all()


def test_hour_angle_is_sidereal_time_less_right_ascension():
    propagator = Propagator(ELEMENTS, Site(*PARANAL))
    times = Utc(START.unix_s + np.linspace(0.0, 86400.0, 500))
    seen = propagator.at(times)
    sidereal = propagator.earth.local_apparent_sidereal_deg(times, propagator.site)
    off = np.remainder(sidereal - seen.ra_deg - seen.ha_deg + 180.0, 360.0) - 180.0
    assert np.abs(off).max() < 1e-9
    assert ((seen.ha_deg > -180.0) & (seen.ha_deg <= 180.0)).all()
    assert ((seen.ra_deg >= 0.0) & (seen.ra_deg < 360.0)).all()
    assert ((seen.az_deg >= 0.0) & (seen.az_deg < 360.0)).all()


def test_a_decayed_satellite_in_the_middle_of_an_array():
    elements = Elements.from_tle(*DECAYING)
    propagator = Propagator(elements, Site(*LEIDEN), earth=PLAIN)
    order = np.array([430.0, 0.0, 100.0, 440.0, 415.0])
    for count in (1, 400):
        times = Utc(np.repeat(elements.epoch.unix_s + 60.0 * order, count))
        seen = propagator.at(times)
        lost = np.repeat([True, False, False, True, False], count)
        assert (seen.error[lost] == 6).all()
        assert (seen.error[~lost] == 0).all()
        for name in QUANTITIES:
            assert np.isnan(getattr(seen, name)[lost]).all(), name
            assert np.isfinite(getattr(seen, name)[~lost]).all(), name
        alone = propagator.at(times[count])
        assert seen.ra_deg[count] == pytest.approx(alone.ra_deg, abs=1e-9)
        assert seen.ra_rate_deg_s[count] == pytest.approx(alone.ra_rate_deg_s, abs=1e-8)
    with pytest.raises(DecayedError, match=r"29141.*has decayed"):
        propagator.at(elements.epoch.plus(430 * 60.0))


def test_sites_at_the_poles():
    for latitude in (90.0, -90.0):
        seen = Propagator(ELEMENTS, Site(latitude, 30.0)).at(PASS)
        for name in QUANTITIES:
            assert np.isfinite(getattr(seen, name)).all(), name
        # The celestial pole is the zenith there, but for polar motion of half an arcsecond and its parallax.
        sign = math.copysign(1.0, latitude)
        assert seen.alt_deg == pytest.approx(sign * seen.dec_deg, abs=2e-4)


@pytest.mark.parametrize("unix_s", [float("nan"), float("inf"), -1e12, 1e12])
def test_times_of_no_sense_are_refused(unix_s):
    propagator = Propagator(ELEMENTS, Site(*LEIDEN))
    for value in (unix_s, np.array([START.unix_s, unix_s])):
        with pytest.raises(TimeRangeError, match="outside the time"):
            propagator.at(Utc(value))


def test_no_instants_give_no_directions():
    seen = Propagator(ELEMENTS, Site(*LEIDEN), Bias(1.0, 1.0)).at(Utc.of([]))
    for name in QUANTITIES:
        assert getattr(seen, name).shape == (0,)
    assert seen.unit.shape == (0, 3)
    assert seen.sunlit.shape == (0,)


def test_unknown_places_are_refused():
    with pytest.raises(PlaceError, match="'mean' is no kind of place"):
        Propagator(ELEMENTS, Site(*LEIDEN), place="mean")
    with pytest.raises(PlaceError, match="knows no air"):
        Propagator(ELEMENTS, Site(*LEIDEN), place="astrometric", refraction=Refraction())


def test_another_place_keeps_everything_but_refraction():
    bias = Bias(2.0, 0.1)
    first = Propagator(ELEMENTS, Site(*LEIDEN), bias, PLAIN, Refraction(), diurnal_aberration=False)
    second = first.with_place("geometric")
    assert (second.elements, second.site, second.bias, second.earth) == (ELEMENTS, first.site, bias, PLAIN)
    assert (second.refraction, second.diurnal_aberration) == (None, False)


@settings(max_examples=50)
@given(
    st.floats(-90.0, 90.0),
    st.floats(-180.0, 360.0),
    st.floats(-400.0, 9000.0),
    st.floats(-3e5, 3e5),
    st.floats(-60.0, 60.0),
    st.floats(-5.0, 5.0),
)
def test_every_direction_is_well_formed(latitude, longitude, height, later_s, along_s, cross_deg):
    propagator = Propagator(ELEMENTS, Site(latitude, longitude, height), Bias(along_s, cross_deg))
    seen = propagator.at(START.plus(later_s))
    assert 0.0 <= seen.ra_deg < 360.0
    assert -90.0 <= seen.dec_deg <= 90.0
    assert -180.0 < seen.ha_deg <= 180.0
    assert seen.unit @ seen.unit == pytest.approx(1.0)
    assert seen.unit @ seen.unit_rate == pytest.approx(0.0, abs=1e-12)
    assert separation_arcsec(seen.ra_deg, seen.dec_deg, *_angles(seen.unit)) < 1e-6
    assert 300.0 < seen.range_km < 14000.0


def _angles(u):
    return math.degrees(math.atan2(u[1], u[0])), math.degrees(math.asin(u[2]))
