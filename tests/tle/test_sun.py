from __future__ import annotations

import math

import erfa
import numpy as np
import pytest
from tle_facts import ISS, LEIDEN

from tle.earth import EarthOrientation
from tle.elements import Elements
from tle.instants import Utc
from tle.propagator import Propagator
from tle.site import Site
from tle.sun import earth_velocity_km_s, is_sunlit, sun_km, terrestrial_time


def test_the_sun_stands_on_the_equator_at_the_equinox():
    # Equinox of March 2026: the 20th, 14:46 UTC (Astronomical Almanac): the Sun moves 2.5″ in a minute.
    at = Utc.parse("2026-03-20T14:46:00Z")
    of_date = EarthOrientation.installed().celestial_matrix(at) @ sun_km(at)
    longitude = math.atan2(of_date[1] / math.cos(math.radians(23.438)), of_date[0])
    # Geometric place: 20″ ahead of the apparent one, by which equinoxes are defined.
    assert math.degrees(longitude) * 3600.0 == pytest.approx(20.0, abs=3.0)
    assert np.linalg.norm(of_date) / 149597870.7 == pytest.approx(0.996, abs=0.001)


def test_the_earth_moves_at_thirty_kilometres_a_second():
    times = Utc.of([Utc.parse("2026-01-03").unix_s, Utc.parse("2026-07-06").unix_s])
    fast, slow = np.linalg.norm(earth_velocity_km_s(times), axis=1)
    # At perihelion and aphelion about the Sun, which moves by 0.02 km/s itself, as the Moon makes the Earth.
    assert (fast, slow) == pytest.approx((30.29, 29.29), abs=0.035)
    assert earth_velocity_km_s(times[1]) == pytest.approx(earth_velocity_km_s(times)[1])


def test_light_and_shadow():
    sun = np.array([1.5e8, 0.0, 0.0])
    lit = [
        [7000.0, 0.0, 0.0],
        [0.0, 7000.0, 0.0],
        [-7000.0, 6500.0, 0.0],
        [-42164.0, 0.0, 6500.0],
        [-1e5, 7000.0, 0],
    ]
    dark = [[-7000.0, 0.0, 0.0], [-42164.0, 0.0, 6200.0], [-7000.0, 6300.0, 0.0]]
    assert is_sunlit(np.array(lit), sun).all()
    assert not is_sunlit(np.array(dark), sun).any()
    # The pole is nearer to the centre than the equator: 21 km decide.
    edge = np.array([[-7000.0, 6365.0, 0.0], [-7000.0, 0.0, 6365.0]])
    assert is_sunlit(edge, sun).tolist() == [False, True]


def test_the_shadow_of_an_orbit_is_as_long_as_geometry_says():
    elements = Elements.from_tle(*ISS)
    times = Utc(elements.epoch.unix_s + np.arange(0.0, elements.period_s, 2.0))
    seen = Propagator(elements, Site(*LEIDEN)).at(times)
    days, second = times.split()
    r, v = (np.array(a) for a in elements.satrec().sgp4_array(days, second)[1:])
    normal = np.cross(r, v).mean(axis=0)
    normal /= np.linalg.norm(normal)
    towards = -erfa.epv00(days[0] + 69.184 / 86400.0, second[0])[0]["p"]
    beta = math.asin(normal @ towards / np.linalg.norm(towards))
    radius = np.linalg.norm(r, axis=1).mean()
    # Half of the dark arc, for a round Earth and parallel light.
    half = math.acos(math.sqrt(radius**2 - 6371.0**2) / radius / math.cos(beta))
    assert (~seen.sunlit).mean() == pytest.approx(half / math.pi, abs=0.01)


def test_terrestrial_time_counts_the_leap_second_between_two_instants():
    days, fraction = terrestrial_time(Utc.of([1483228799.0, 1483228801.0]))  # 2017-01-01, a second around 0h
    assert ((days[1] - days[0]) + (fraction[1] - fraction[0])) * 86400.0 == pytest.approx(3.0, abs=1e-6)
