"""Directions turned on the sky, against ERFA; plate solutions made apparent, against its stars."""

from __future__ import annotations

import math

import erfa
import numpy as np
import pytest

from tle.direction import SkyTurn, turned_on_sky
from tle.earth import EarthOrientation
from tle.elements import Elements
from tle.errors import ObservationError, PlaceError
from tle.instants import Utc
from tle.observed import apparent_unit
from tle.propagator import Propagator
from tle.site import Site

LEIDEN = Site(52.1541, 4.4908, 0.0)
ISS = Elements.from_tle(
    "1 25544U 98067A   26275.01380287  .00003738  00000+0  76743-4 0  9992",
    "2 25544  51.6312 131.4121 0006946 211.9293 148.1275 15.48707684588318",
)
CULMINATION_S = Utc.parse("2026-10-02T13:05:24Z").unix_s


def vector(ra_deg: float, dec_deg: float) -> tuple[float, float, float]:
    x, y, z = erfa.s2c(math.radians(ra_deg), math.radians(dec_deg))
    return float(x), float(y), float(z)


def angles(q: tuple[float, float, float]) -> tuple[float, float]:
    ra, dec = erfa.c2s(np.array(q))
    return math.degrees(ra) % 360.0, math.degrees(dec)


@pytest.mark.parametrize(
    ("east", "north", "dec_deg"),
    [(0.5, 0.0, 0.0), (0.0, -0.3, 40.0), (2.0, 3.0, -70.0), (1e-7, -2e-7, 40.0), (-4.0, 1.0, 86.0)],
)
def test_a_turn_goes_so_far_in_the_direction_it_names(east: float, north: float, dec_deg: float) -> None:
    before, after = (
        vector(200.0, dec_deg),
        turned_on_sky(vector(200.0, dec_deg), (0, 0, 0), SkyTurn(east, north))[0],
    )
    apart, angle = erfa.sepp(before, after), erfa.pap(np.array(before), np.array(after))
    assert math.degrees(apart) == pytest.approx(math.hypot(east, north), rel=1e-9)
    assert math.cos(angle - math.atan2(east, north)) == pytest.approx(1.0)


def test_a_turn_about_the_pole_adds_to_the_right_ascension_alone() -> None:
    turned, _ = turned_on_sky(vector(359.5, 60.0), (0.0, 0.0, 0.0), SkyTurn(pole_deg=1.5))
    assert angles(turned) == pytest.approx((1.0, 60.0))


def test_a_direction_goes_over_the_pole_and_comes_down_on_the_other_side() -> None:
    turned, _ = turned_on_sky(vector(10.0, 89.0), (0.0, 0.0, 0.0), SkyTurn(north_deg=2.0))
    assert angles(turned) == pytest.approx((190.0, 89.0))


@pytest.mark.parametrize("seconds", [-200.0, -3.0, 100.0])
def test_the_rates_of_a_turned_direction_are_derivatives_of_its_positions(seconds: float) -> None:
    propagator = Propagator(ISS, LEIDEN)
    middle_s = CULMINATION_S + seconds

    def seen(utc_s: float) -> object:
        s = utc_s - middle_s
        turn = SkyTurn(1.0 + 0.1 * s, -2.0 + 0.3 * s, 0.5 - 0.2 * s, 0.1, 0.3, -0.2)
        return propagator.at(Utc(utc_s)).turned(turn)

    step_s = 0.01
    for name in ("ra", "dec", "alt", "az", "ha"):
        later, sooner = (getattr(seen(middle_s + s), f"{name}_deg") for s in (step_s, -step_s))
        rate = getattr(seen(middle_s), f"{name}_rate_deg_s")
        assert rate == pytest.approx((later - sooner) / (2.0 * step_s), abs=2e-5)


@pytest.mark.parametrize("seconds", [-200.0, 0.0, 150.0])
def test_the_apparent_direction_of_an_astrometric_place_is_the_apparent_place(seconds: float) -> None:
    propagator, t = Propagator(ISS, LEIDEN), Utc(CULMINATION_S + seconds)
    measured = propagator.with_place("astrometric").at(t)
    seen = apparent_unit(measured.ra_deg, measured.dec_deg, t, "icrf", LEIDEN, propagator.earth)
    assert np.linalg.norm(seen - propagator.at(t).unit) * 206265.0 < 1e-6


def test_a_star_is_where_erfa_sees_it_from_the_ground() -> None:
    """ERFA's atco13 without air; so far from the Sun it deflects light by milliarcseconds."""
    t, earth = Utc(CULMINATION_S), EarthOrientation.fixed(0.0)
    ra, dec = math.radians(20.0), math.radians(35.0)
    _, _, _hour_angle, seen_dec, seen_ra, origins = erfa.atco13(
        ra,
        dec,
        0.0,
        0.0,
        0.0,
        0.0,
        2440587.5,
        CULMINATION_S / 86400.0,
        0.0,
        math.radians(LEIDEN.longitude_deg),
        math.radians(LEIDEN.latitude_deg),
        0.0,
        0.0,
        0.0,
        0.0,
        0.0,
        0.5,
        0.5,
    )
    expected = vector(math.degrees(seen_ra - origins), math.degrees(seen_dec))
    found = apparent_unit(20.0, 35.0, t, "icrf", LEIDEN, earth)
    assert np.linalg.norm(found - expected) * 206265.0 < 0.02


def test_j2000_differs_from_icrf_by_the_frame_bias() -> None:
    t, earth = Utc(CULMINATION_S), EarthOrientation.fixed(0.0)
    one, other = (apparent_unit(120.0, 20.0, t, frame, LEIDEN, earth) for frame in ("icrf", "j2000"))
    assert 0.005 < np.linalg.norm(one - other) * 206265.0 < 0.025


def test_a_geometric_direction_of_a_satellite_is_seen_where_erfa_aberrates_its_light() -> None:
    """By the barycentre: the Earth goes on while the light is under way, and the site sees it aberrated."""
    t, tt = Utc(CULMINATION_S), CULMINATION_S / 86400.0 + 69.184 / 86400.0
    _, earth_pv = erfa.epv00(2440587.5, tt)
    earth_km_s = earth_pv["v"] * 149_597_870.7 / 86400.0
    to_itrs = erfa.c2t06a(2440587.5, tt, 2440587.5, CULMINATION_S / 86400.0, 0.0, 0.0)
    place = np.array(LEIDEN.itrs_km)
    site, site_km_s = (to_itrs.T @ one for one in (place, np.cross([0.0, 0.0, 7.292115e-5], place)))
    satellite, velocity = 3.0 * site + np.array([9000.0, -4000.0, 2000.0]), np.array([-2.0, 3.0, 1.0])
    delay = 0.0
    for _ in range(4):
        geometric = satellite - delay * velocity - site
        delay = float(np.linalg.norm(geometric)) / 299792.458
    ra_deg, dec_deg = np.degrees(erfa.c2s(geometric))
    found = apparent_unit(ra_deg % 360.0, dec_deg, t, "gcrs", LEIDEN, EarthOrientation.fixed(0.0))
    natural = geometric - delay * earth_km_s
    seen_from = (earth_km_s + site_km_s) / 299792.458
    slower = math.sqrt(1.0 - float(seen_from @ seen_from))
    proper = erfa.ab(natural / np.linalg.norm(natural), seen_from, 1.0, slower)
    expected = erfa.pnm06a(2440587.5, tt) @ proper
    assert np.linalg.norm(found - expected) * 206265.0 < 0.003
    # The light's own direction by the barycentre is the astrometric place.
    ra_deg, dec_deg = np.degrees(erfa.c2s(natural))
    found = apparent_unit(ra_deg % 360.0, dec_deg, t, "icrf", LEIDEN, EarthOrientation.fixed(0.0))
    assert np.linalg.norm(found - expected) * 206265.0 < 0.003


def test_an_apparent_direction_is_apparent_already() -> None:
    found = apparent_unit(120.0, 20.0, Utc(CULMINATION_S), "of_date", LEIDEN, EarthOrientation.fixed(0.0))
    assert found == pytest.approx(np.array(vector(120.0, 20.0)), abs=1e-15)


def test_what_is_no_direction_and_no_frame_is_refused() -> None:
    earth = EarthOrientation.fixed(0.0)
    for ra_deg, dec_deg in ((10.0, 91.0), (math.nan, 0.0), (math.inf, 0.0), (0.0, math.nan)):
        with pytest.raises(ObservationError, match="no direction"):
            apparent_unit(ra_deg, dec_deg, Utc(CULMINATION_S), "icrf", LEIDEN, earth)
    with pytest.raises(PlaceError, match="'b1950' is no frame"):
        apparent_unit(1.0, 2.0, Utc(CULMINATION_S), "b1950", LEIDEN, earth)  # type: ignore[arg-type]
