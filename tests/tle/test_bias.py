"""The sign convention of the biases in words, and their inverse."""

from __future__ import annotations

import dataclasses
import math
from datetime import UTC, datetime

import erfa
import numpy as np
import pytest
from geometry import itrs_km, site_below, site_that_sees_it_at_the_pole, skyfield_timescale
from sgp4.api import Satrec
from skyfield.api import EarthSatellite, wgs84
from tle_facts import ISS, LEIDEN, MOLNIYA, PARANAL, STARLINK_ALPHA5, TDRS3, separation_arcsec

from tle.bias import Bias
from tle.bodies import find_body
from tle.earth import EarthOrientation
from tle.elements import Elements
from tle.errors import BiasError, ObservationError, PlaceError
from tle.instants import Utc
from tle.observed import bias_from_observation
from tle.propagator import Propagator
from tle.refraction import Refraction
from tle.site import Site

PLAIN = EarthOrientation.fixed(0.0)
ELEMENTS = Elements.from_tle(*ISS)
START = Utc.parse("2026-10-02T13:01:06Z")
# The ISS turned onto a polar orbit, by hand: no such satellite, but a motion straight north at the equator.
POLAR = (
    "1 25544U 98067A   26275.01380287  .00003738  00000+0  76743-4 0  9992",
    "2 25544  90.0000 131.4121 0006946 211.9293 148.1275 15.48707684588319",
)
# Space-Track, 2025-09-01: a navigation satellite, 12 hours a turn.
GPS = (
    "1 41328U 16007A   25243.18799981 -.00000013  00000-0  00000-0 0  9995",
    "2 41328  55.3410 100.9670 0088327 242.5730 116.6042  2.00566215 70028",
)
# Of the same kind: retrograde, and geostationary.
RETROGRADE = (ISS[0], "2 25544 144.0000 131.4121 0006946 211.9293 148.1275 15.48707684588319")
GEOSTATIONARY = (
    "1 19548U 88091B   26150.42208977  .00000000  00000+0  00000+0 0  9983",
    "2 19548   0.0100 341.1225 0000100 356.7275  12.9243  1.00273790125215",
)


def moving_north_over_the_equator(lines, start):
    """Return an instant at which the satellite crosses the equator northward."""
    times = [start.plus(s) for s in range(0, 6000, 2)]
    heights = [itrs_km(lines, t)[2] for t in times]
    return next(t for t, a, b in zip(times, heights, heights[1:], strict=False) if a < 0.0 <= b)


def test_overhead_moving_north_positive_cross_track_shifts_west():
    at = moving_north_over_the_equator(POLAR, ELEMENTS.epoch)
    propagator = Propagator(Elements.from_tle(*POLAR), site_below(POLAR, at), earth=PLAIN, place="geometric")
    assert propagator.at(at).alt_deg > 89.9
    later = propagator.at(at.plus(10.0))
    assert abs(later.az_deg) < 5.0 or later.az_deg > 355.0
    shifted = propagator.at(at, Bias(cross_deg=0.5))
    assert shifted.alt_deg == pytest.approx(89.5, abs=0.1)
    # West, but for the Earth's own turn, which lets the track lean by 4° against the ground.
    assert shifted.az_deg == pytest.approx(270.0, abs=6.0)
    assert propagator.at(at, Bias(cross_deg=-0.5)).az_deg == pytest.approx(90.0, abs=6.0)


def test_overhead_moving_north_positive_along_track_is_north():
    at = moving_north_over_the_equator(POLAR, ELEMENTS.epoch)
    propagator = Propagator(Elements.from_tle(*POLAR), site_below(POLAR, at), earth=PLAIN, place="geometric")
    ahead, behind = propagator.at(at, Bias(along_s=2.0)), propagator.at(at, Bias(along_s=-2.0))
    assert min(ahead.az_deg, 360.0 - ahead.az_deg) < 1.0
    assert behind.az_deg == pytest.approx(180.0, abs=1.0)


def test_a_geostationary_satellite_overhead_is_shifted_north():
    # It moves east among the stars, so that left of it, seen from below and facing its motion, is north.
    at = Utc.parse("2026-06-01")
    site = site_below(GEOSTATIONARY, at)
    propagator = Propagator(Elements.from_tle(*GEOSTATIONARY), site, earth=PLAIN, place="geometric")
    shifted = propagator.at(at, Bias(cross_deg=0.5))
    assert shifted.az_deg == pytest.approx(0.0, abs=0.5) or shifted.az_deg > 359.5
    assert propagator.at(at, Bias(along_s=30.0)).az_deg == pytest.approx(90.0, abs=0.5)


def test_a_retrograde_satellite_moves_west_and_is_shifted_south():
    at = max((ELEMENTS.epoch.plus(s) for s in range(0, 6000, 5)), key=lambda t: itrs_km(RETROGRADE, t)[2])
    site = site_below(RETROGRADE, at)
    propagator = Propagator(Elements.from_tle(*RETROGRADE), site, earth=PLAIN, place="geometric")
    assert propagator.at(at, Bias(along_s=1.0)).az_deg == pytest.approx(270.0, abs=1.0)
    assert propagator.at(at, Bias(cross_deg=0.5)).az_deg == pytest.approx(180.0, abs=2.0)


def test_a_time_bias_moves_the_satellite_and_not_the_earth():
    site, along_s = Site(*LEIDEN), 7.0
    propagator = Propagator(ELEMENTS, site, Bias(along_s), earth=PLAIN, place="geometric")
    for later_s in (0.0, 250.0, 500.0):
        t = START.plus(later_s)
        (jd, late), (_, now) = t.plus(along_s).split(), t.split()
        _, r, _ = Satrec.twoline2rv(*ISS).sgp4(jd, late)
        theta = erfa.gmst82(jd, now)
        c, s = math.cos(theta), math.sin(theta)
        x, y, z = site.itrs_km
        towards = np.array(r) - [x * c - y * s, x * s + y * c, z]
        equinoxes = erfa.gst06a(jd, now, jd, now + 69.184 / 86400.0) - theta
        ra_deg = math.degrees(math.atan2(towards[1], towards[0]) + equinoxes)
        dec_deg = math.degrees(math.asin(towards[2] / np.linalg.norm(towards)))
        seen = propagator.at(t)
        assert separation_arcsec(seen.ra_deg, seen.dec_deg, ra_deg, dec_deg) < 0.002


@pytest.mark.parametrize("cross_deg", [-20.0, -1.0, -1e-4, 1e-4, 0.3, 60.0])
def test_a_cross_track_bias_is_that_angle_on_the_sky_square_to_the_motion(cross_deg):
    times = Utc(START.unix_s + np.linspace(0.0, 516.0, 100))
    propagator = Propagator(ELEMENTS, Site(*LEIDEN), place="geometric")
    plain, shifted = propagator.at(times), propagator.at(times, Bias(cross_deg=cross_deg))
    angle = separation_arcsec(plain.ra_deg, plain.dec_deg, shifted.ra_deg, shifted.dec_deg)
    assert angle == pytest.approx(abs(cross_deg) * 3600.0, abs=1e-5)
    motion = propagator.at(times, Bias(0.01)).unit - propagator.at(times, Bias(-0.01)).unit
    motion /= np.linalg.norm(motion, axis=1, keepdims=True)
    left = np.cross(plain.unit, motion)
    assert (shifted.unit * left).sum(axis=1) == pytest.approx(math.sin(math.radians(cross_deg)), abs=1e-7)
    assert np.abs((shifted.unit * motion).sum(axis=1)).max() < 1e-7
    assert (plain.range_km == shifted.range_km).all()


def test_biases_grow_at_their_rates():
    growing = Bias(1.0, 0.2, 0.01, -0.001, START)
    propagator = Propagator(ELEMENTS, Site(*LEIDEN), growing)
    for later_s in (-20.0, 0.0, 100.0):
        t = START.plus(later_s)
        fixed = Bias(1.0 + 0.01 * later_s, 0.2 - 0.001 * later_s)
        # The light left a little earlier, when the bias was a little smaller: nanoseconds of bias.
        assert propagator.at(t).unit == pytest.approx(propagator.at(t, fixed).unit, abs=1e-6)
    times = Utc(START.unix_s + np.arange(5.0))
    assert growing.along_at_s(times.unix_s) == pytest.approx([1.0, 1.01, 1.02, 1.03, 1.04])
    assert (Bias(1.0, 0.2).along_at_s(times.unix_s), Bias(1.0, 0.2).cross_at_deg(times.unix_s)) == (1.0, 0.2)


def test_a_bias_grows_from_a_datetime_as_from_an_instant():
    epoch = datetime(2026, 10, 2, 13, 1, 6, tzinfo=UTC)
    assert Bias(1.0, 0.2, 0.01, -0.001, epoch).cross_at_deg(START.unix_s + 100.0) == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("numbers", "words"),
    [
        ({"along_s": float("nan")}, "not a finite number"),
        ({"cross_deg": float("inf")}, "not a finite number"),
        ({"cross_deg": 90.5}, "beyond 90°"),
        ({"along_rate": 1e-3}, "give its epoch"),
        ({"cross_rate_deg_s": 1e-3}, "give its epoch"),
    ],
)
def test_biases_that_mean_nothing_are_refused(numbers, words):
    with pytest.raises(BiasError, match=words):
        Bias(**numbers)


CASES = {
    "LEO": (ISS, Site(*LEIDEN), START, 516.0),
    "RA through 0h": (ISS, Site(*PARANAL), Utc.parse("2026-10-02T01:10:27Z"), 253.0),
    "HEO": (MOLNIYA, Site(*LEIDEN), Utc.parse("2025-09-02"), 40000.0),
    "GSO": (TDRS3, Site(*PARANAL), Utc.parse("2026-06-01"), 21600.0),
    "retrograde": (RETROGRADE, Site(*LEIDEN), START, 516.0),
    "geostationary": (GEOSTATIONARY, Site(*PARANAL), Utc.parse("2026-06-01"), 21600.0),
}


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize(
    ("place", "frame"), [("apparent", "of_date"), ("geometric", "of_date"), ("astrometric", "icrf")]
)
def test_the_inverse_finds_the_biases_again(case, place, frame):
    lines, site, start, span_s = CASES[case]
    propagator = Propagator(Elements.from_tle(*lines), site, place=place)
    random = np.random.default_rng(7)
    for _ in range(8):
        t = start.plus(float(random.uniform(0.0, span_s)))
        along_s, cross_deg = float(random.uniform(-15.0, 15.0)), float(random.uniform(-2.0, 2.0))
        seen = propagator.at(t, Bias(along_s, cross_deg))
        found = bias_from_observation(propagator, seen.ra_deg, seen.dec_deg, t, frame)
        assert found.along_s == pytest.approx(along_s, abs=1e-6)
        assert found.cross_deg == pytest.approx(cross_deg, abs=1e-8)
        again = propagator.at(t, found.bias)
        assert separation_arcsec(again.ra_deg, again.dec_deg, seen.ra_deg, seen.dec_deg) < 1e-4


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("diurnal", [True, False])
def test_the_inverse_finds_the_biases_again_from_geometric_directions(case, diurnal):
    lines, site, start, span_s = CASES[case]
    elements, bias = Elements.from_tle(*lines), Bias(3.5, -0.4)
    t = start.plus(0.4 * span_s)
    unit = Propagator(elements, site, diurnal_aberration=False).at(t, bias).unit
    to_date = erfa.pnm06a(2440587.5, (t.unix_s + 69.184) / 86400.0)
    ra, dec = erfa.c2s(to_date.T @ unit)
    propagator = Propagator(elements, site, refraction=Refraction(), diurnal_aberration=diurnal)
    found = bias_from_observation(propagator, math.degrees(ra), math.degrees(dec), t, "gcrs")
    # A thousandth of an arcsecond, where satellites go 15 arcseconds a second and more.
    assert found.cross_deg == pytest.approx(bias.cross_deg, abs=1e-6)
    assert found.along_s == pytest.approx(bias.along_s, abs=1e-3)


class Independent:
    """Astrometric directions by sgp4's wrapper in skyfield, with UT1 = UTC and the pole at rest."""

    def __init__(self, lines, place):
        self.timescale = skyfield_timescale(0.0, 0.0, 0.0)
        self.satellite, self.place = (
            EarthSatellite(*lines, ts=self.timescale),
            wgs84.latlon(*place[:2], place[2]),
        )

    def _at(self, unix_s):
        days, second = np.divmod(unix_s, 86400.0)
        return self.timescale.tt_jd(days + 2440587.5, (second + 69.184) / 86400.0)

    def alt_deg(self, unix_s):
        return (self.satellite - self.place).at(self._at(unix_s)).altaz()[0].degrees

    def radec_deg(self, unix_s, along_s):
        """Return the place in the ICRF where stars show a satellite that runs `along_s` ahead."""
        jd, fraction = Utc(unix_s).split()
        earth_km_s = erfa.epv00(jd, fraction)[1]["v"] * (149597870.7 / 86400.0)
        seen_from, light_s = self.place.at(self._at(unix_s)).position.km, 0.0
        for _ in range(3):
            q = self.satellite.at(self._at(unix_s + along_s - light_s)).position.km - seen_from
            q = q - earth_km_s * light_s
            light_s = float(np.linalg.norm(q)) / 299792.458
        ra, dec = math.atan2(q[1], q[0]), math.atan2(q[2], math.hypot(q[0], q[1]))
        return math.degrees(ra) % 360.0, math.degrees(dec)


@pytest.mark.parametrize(
    ("lines", "age_days"),
    [
        *((ISS, age_days) for age_days in (0.0, 13.0, 60.0)),
        *((STARLINK_ALPHA5, 30.0), (MOLNIYA, 13.0), (MOLNIYA, 60.0)),
        *((GPS, 0.0), (GPS, 3650.0), (TDRS3, 21.0), (TDRS3, 3650.0)),
    ],
)
def test_observations_are_taken_however_old_the_elements(lines, age_days):
    elements, place = Elements.from_tle(*lines), PARANAL if lines is TDRS3 else LEIDEN
    peer = Independent(lines, place)
    propagator = Propagator(elements, Site(*place), earth=PLAIN, place="astrometric")
    random = np.random.default_rng(3)
    unix_s = elements.epoch.unix_s + 86400.0 * (age_days + random.uniform(0.0, 1.0, 1000))
    up_s = unix_s[peer.alt_deg(unix_s) > 10.0][:5]
    assert len(up_s) == 5
    for t in map(Utc, up_s.tolist()):
        along_s = float(random.uniform(-30.0, 30.0))
        found = bias_from_observation(propagator, *peer.radec_deg(t.unix_s, along_s), t, "icrf")
        true, ours = propagator.at(t, Bias(along_s)), propagator.at(t, found.bias)
        assert separation_arcsec(true.ra_deg, true.dec_deg, ours.ra_deg, ours.dec_deg) < 0.05


@pytest.mark.parametrize(
    "along_s",
    [
        *(-2500.0, -305.0, 2010.0),
        *(pytest.param(along_s, marks=pytest.mark.soak) for along_s in (-1524.0, -913.0, 260.0, 600.0)),
    ],
)
def test_a_satellite_minutes_off_its_old_elements_is_found_along_its_orbit(along_s):
    # Sets of the space station and of Tiangong are so far apart after 17 to 125 days with manoeuvres.
    peer, propagator = Independent(ISS, LEIDEN), Propagator(ELEMENTS, Site(*LEIDEN), earth=PLAIN)
    propagator = propagator.with_place("astrometric")
    unix_s = ELEMENTS.epoch.unix_s + np.arange(0.0, 86400.0, 60.0)
    up = unix_s[peer.alt_deg(unix_s + along_s) > 25.0]
    found = []
    for t in map(Utc, up[:: max(1, len(up) // 6)].tolist()):
        # At an instant at which the satellite is up, the Earth being turned by a little since.
        ra_deg, dec_deg = peer.radec_deg(t.unix_s, along_s)
        there = propagator.with_place("apparent").at(t, Bias(along_s))
        if there.alt_deg < 10.0:
            continue
        found.append(bias_from_observation(propagator, ra_deg, dec_deg, t, "icrf"))
    assert len(found) > 2
    assert [one.along_s for one in found] == pytest.approx([along_s] * len(found), abs=0.05)
    assert max(abs(one.cross_deg) for one in found) < 0.01


def test_the_inverse_at_the_celestial_pole_and_through_culmination():
    highest = max((ELEMENTS.epoch.plus(s) for s in range(0, 6000, 20)), key=lambda t: itrs_km(ISS, t)[2])
    for site in (site_that_sees_it_at_the_pole(ISS, highest), site_below(ISS, highest)):
        propagator = Propagator(ELEMENTS, site, earth=PLAIN)
        for later_s in (-3.0, -0.1, 0.0, 0.1, 3.0):
            t = highest.plus(later_s)
            seen = propagator.at(t, Bias(1.5, -0.25))
            found = bias_from_observation(propagator, seen.ra_deg, seen.dec_deg, t)
            assert (found.along_s, found.cross_deg) == pytest.approx((1.5, -0.25), abs=1e-6)


def test_the_mean_equator_of_j2000_is_that_of_the_icrf_but_for_the_frame_bias():
    propagator = Propagator(ELEMENTS, Site(*LEIDEN), place="astrometric")
    seen = propagator.at(START, Bias(2.0, 0.1))
    turned = erfa.bp06(2451545.0, 0.0)[0] @ seen.unit
    ra_deg, dec_deg = (
        math.degrees(math.atan2(turned[1], turned[0])) % 360.0,
        math.degrees(math.asin(turned[2])),
    )
    assert 0.001 < separation_arcsec(ra_deg, dec_deg, seen.ra_deg, seen.dec_deg) < 0.05
    found = bias_from_observation(propagator, ra_deg, dec_deg, START, "j2000")
    assert (found.along_s, found.cross_deg) == pytest.approx((2.0, 0.1), abs=1e-7)


def test_uncertainties_are_those_that_the_errors_of_direction_and_time_make():
    """To first order: the squares of what each error changes, one by one, added up."""
    propagator, t = Propagator(ELEMENTS, Site(*LEIDEN)), START.plus(200.0)
    seen = propagator.at(t, Bias(1.0, 0.2))
    east_deg = 1.0 / 3600.0 / math.cos(math.radians(seen.dec_deg))
    variances = np.zeros(2)
    for d_ra, d_dec, d_t, sigma in (
        (east_deg, 0.0, 0.0, 5.0),
        (0.0, 1.0 / 3600.0, 0.0, 5.0),
        (0.0, 0.0, 0.001, 10.0),
    ):
        one, other = (
            bias_from_observation(
                propagator, seen.ra_deg + s * d_ra, seen.dec_deg + s * d_dec, t.plus(s * d_t)
            )
            for s in (0.5, -0.5)
        )
        variances += (sigma * np.array([one.along_s - other.along_s, one.cross_deg - other.cross_deg])) ** 2
    found = bias_from_observation(propagator, seen.ra_deg, seen.dec_deg, t, "of_date", 5.0, 0.01)
    assert (found.along_sigma_s, found.cross_sigma_deg) == pytest.approx(np.sqrt(variances), rel=1e-3)
    exact = bias_from_observation(propagator, seen.ra_deg, seen.dec_deg, t, "of_date", 0.0)
    assert (exact.along_sigma_s, exact.cross_sigma_deg) == (0.0, 0.0)


def test_uncertainties_are_one_arcsecond_of_direction_where_nothing_else_is_said():
    propagator = Propagator(ELEMENTS, Site(*LEIDEN))
    seen = propagator.at(START.plus(200.0))
    found = bias_from_observation(propagator, seen.ra_deg, seen.dec_deg, START.plus(200.0))
    ahead = propagator.at(START.plus(200.0), Bias(0.5))
    arcsec_per_s = 2.0 * separation_arcsec(seen.ra_deg, seen.dec_deg, ahead.ra_deg, ahead.dec_deg)
    assert found.along_sigma_s == pytest.approx(1.0 / arcsec_per_s, rel=0.01)
    assert found.cross_sigma_deg == pytest.approx(1.0 / 3600.0, rel=0.001)


def test_the_separation_is_that_of_the_plain_elements():
    propagator = Propagator(ELEMENTS, Site(*LEIDEN), Bias(99.0))
    plain, seen = propagator.at(START, Bias()), propagator.at(START, Bias(1.0, 0.1))
    found = bias_from_observation(propagator, seen.ra_deg, seen.dec_deg, START)
    wanted = separation_arcsec(plain.ra_deg, plain.dec_deg, seen.ra_deg, seen.dec_deg)
    assert found.separation_arcsec == pytest.approx(wanted, rel=1e-9)


def test_observations_that_cannot_be():
    propagator = Propagator(ELEMENTS, Site(*LEIDEN))
    with pytest.raises(ObservationError, match="is no direction"):
        bias_from_observation(propagator, 10.0, 91.0, START)
    with pytest.raises(ObservationError, match="is no direction"):
        bias_from_observation(propagator, 10.0, -91.0, START)
    with pytest.raises(ObservationError, match="is no direction"):
        bias_from_observation(propagator, float("nan"), 0.0, START)
    with pytest.raises(ObservationError, match="standard deviation"):
        bias_from_observation(propagator, 10.0, 0.0, START, sigma_arcsec=-1.0)
    with pytest.raises(PlaceError, match="'b1950' is no frame"):
        bias_from_observation(propagator, 10.0, 0.0, START, "b1950")
    high = dataclasses.replace(ELEMENTS, mean_motion_rev_day=1.0)
    with pytest.raises(ObservationError, match="no bias along the track leads"):
        bias_from_observation(Propagator(high, Site(*LEIDEN)), 100.0, -89.9, START)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_an_observation_square_to_the_track_is_refused_as_one(side):
    propagator = Propagator(ELEMENTS, Site(*LEIDEN), place="geometric")
    behind, here, ahead = (propagator.at(START, Bias(along_s)).unit for along_s in (-0.01, 0.0, 0.01))
    x, y, z = side * np.cross(here, ahead - behind)
    ra_deg, dec_deg = math.degrees(math.atan2(y, x)), math.degrees(math.atan2(z, math.hypot(x, y)))
    with pytest.raises(ObservationError, match="no bias along the track leads"):
        bias_from_observation(propagator, ra_deg, dec_deg, START)


def test_what_goes_round_no_orbit_has_biases_while_it_moves_and_is_near():
    star, moon = (Propagator(find_body(name), Site(*LEIDEN)) for name in ("279.0,38.0", "moon"))
    with pytest.raises(ObservationError, match="stands still on the sky"):
        bias_from_observation(star, 279.0, 38.0, START)
    seen = moon.at(START, Bias(20.0, 0.001))
    found = bias_from_observation(moon, seen.ra_deg, seen.dec_deg, START)
    assert (found.along_s, found.cross_deg) == pytest.approx((20.0, 0.001), abs=1e-3)
    with pytest.raises(ObservationError, match="no bias along the track leads"):
        bias_from_observation(moon, seen.ra_deg + 10.0, seen.dec_deg, START)
