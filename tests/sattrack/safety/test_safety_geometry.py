"""Bounds over boxes of axis angles against the worst of what they hold, by ERFA and by vectors."""

from __future__ import annotations

import math
import random
from itertools import pairwise
from typing import Any

import erfa
import numpy as np
import pytest

from sattrack.core.angles import azimuth_deg, separation_deg
from sattrack.mount.model import MountProfile, PierZone, Stance
from sattrack.safety import SafetyLimits
from sattrack.safety.bodies import moon_over, sun_over
from sattrack.safety.geometry import (
    AxesState,
    Box,
    Place,
    lowest_altitude_deg,
    meets_polygon,
    nearest_deg,
    stance_at,
)
from sattrack.safety.regions import Clearance, Cone, Floor, PierCollision, Skyline, Travel, is_clear
from sattrack.safety.route import axes_of, direction_of, find_route


def vector(ha_deg: float, dec_deg: float) -> np.ndarray:
    h, d = math.radians(ha_deg), math.radians(dec_deg)
    return np.array([math.cos(d) * math.cos(h), math.cos(d) * math.sin(h), math.sin(d)])


def angle_deg(one: np.ndarray, other: np.ndarray) -> float:
    return math.degrees(math.atan2(float(np.linalg.norm(np.cross(one, other))), float(one @ other)))


def farthest_deg(direction: np.ndarray, places: list[tuple[float, float]]) -> float:
    """The largest angle between a direction and one of many places."""
    h, d = np.radians(places).T
    cosines = np.array([np.cos(d) * np.cos(h), np.cos(d) * np.sin(h), np.sin(d)]).T @ direction
    return math.degrees(math.acos(max(-1.0, min(1.0, float(cosines.min())))))


def boxes(count: int) -> list[tuple[Box, list[tuple[float, float]]]]:
    """Random boxes of axis angles, past the poles and round the turn too, with places in each."""
    rng = random.Random(8)
    made = []
    for _ in range(count):
        ha, dec = rng.uniform(-300.0, 300.0), rng.uniform(-200.0, 200.0)
        box = Box(ha, ha + rng.choice([0.0, 1.0, 20.0, 200.0]), dec, dec + rng.choice([0.0, 0.5, 15.0, 90.0]))
        has = np.linspace(box.ha_low_deg, box.ha_high_deg, 25)
        decs = np.linspace(box.dec_low_deg, box.dec_high_deg, 25)
        made.append((box, [(float(h), float(d)) for h in has for d in decs]))
    return made


def test_boxes_are_grown_joined_and_halved_by_their_sides() -> None:
    box = Box.between((30.0, -20.0), (-10.0, 60.0))
    assert box == (-10.0, 30.0, -20.0, 60.0)
    assert (box.middle, box.widest_deg) == ((10.0, 10.0, 20.0, 20.0), 80.0)
    assert box.grown(1.0, 2.0, 3.0, 4.0) == (-11.0, 32.0, -23.0, 64.0)
    assert box.with_box(Box(-5.0, 35.0, -25.0, 50.0)) == (-10.0, 35.0, -25.0, 60.0)
    assert box.with_box(Box(-15.0, 25.0, -15.0, 65.0)) == (-15.0, 30.0, -20.0, 65.0)
    assert box.halves() == ((-10.0, 30.0, -20.0, 20.0), (-10.0, 30.0, 20.0, 60.0))
    wide = Box(-10.0, 70.0, -20.0, 10.0)
    assert wide.widest_deg == 80.0
    assert wide.halves() == ((-10.0, 30.0, -20.0, 10.0), (30.0, 70.0, -20.0, 10.0))


def test_no_place_in_a_box_is_farther_from_its_middle_than_its_radius() -> None:
    for box, places in boxes(150):
        *middle, radius_deg = box.circle
        assert farthest_deg(np.array(middle), places) <= radius_deg + 1e-5
        if box.ha_low_deg == box.ha_high_deg:
            assert radius_deg == pytest.approx(0.5 * (box.dec_high_deg - box.dec_low_deg))
        if box.dec_low_deg == box.dec_high_deg:
            end = vector(box.ha_high_deg, box.dec_low_deg)
            assert radius_deg == pytest.approx(angle_deg(np.array(middle), end))


def test_no_place_in_a_box_is_lower_than_its_lowest_altitude() -> None:
    for latitude in (-33.0, 0.0, 52.0, 90.0):
        zenith = vector(0.0, latitude)
        for box, places in boxes(100):
            lowest = 90.0 - farthest_deg(zenith, places)
            told = lowest_altitude_deg(box, latitude)
            assert told <= lowest + 1e-5
            if box.widest_deg <= 20.0:
                assert told >= lowest - 0.3


def test_the_place_in_a_box_that_is_nearest_to_a_direction_is_as_far_as_told() -> None:
    rng = random.Random(9)
    for box, places in boxes(300):
        ha, dec = rng.uniform(-400.0, 400.0), rng.uniform(-90.0, 90.0)
        if rng.random() < 0.3:
            # Beside the box, and inside of it.
            ha, dec = box.ha_low_deg + rng.uniform(-3.0, 3.0), box.dec_low_deg + rng.uniform(-3.0, 3.0)
        nearest = 180.0 - farthest_deg(-vector(ha, dec), places)
        told = nearest_deg(box, ha, dec)
        assert told <= nearest + 1e-5
        step = max(box.ha_high_deg - box.ha_low_deg, box.dec_high_deg - box.dec_low_deg) / 24.0
        assert told >= nearest - 0.75 * step - 1e-5


def test_a_direction_is_at_itself_and_half_a_turn_from_its_opposite_however_cosines_are_rounded() -> None:
    for dec in np.arange(-90.0, 90.1, 0.25).tolist():
        here = Box(30.0, 30.0, dec, dec)
        assert nearest_deg(here, 30.0, dec) == pytest.approx(0.0, abs=2e-6)
        assert nearest_deg(here, 210.0, -dec) == pytest.approx(180.0, abs=3e-6)


def test_the_direction_opposite_to_a_place_is_half_a_turn_from_it() -> None:
    for ha, dec in ((0.0, 0.0), (0.0, 90.0), (120.0, -30.0)):
        assert nearest_deg(Box(ha, ha, dec, dec), ha + 180.0, -dec) == pytest.approx(180.0, abs=1e-5)


def test_a_skyline_is_far_above_the_nadir_however_its_cosine_is_rounded() -> None:
    for latitude_deg in range(-90, 91):
        nadir = Box(180.0, 180.0, -latitude_deg, -latitude_deg)
        skyline = Skyline(((0.0, 60.0), (120.0, 5.0)), latitude_deg)
        assert skyline.clearance(nadir).least_deg <= -95.0 + 1e-5


def test_azimuths_are_those_of_erfa() -> None:
    for ha, dec in ((-170.0, 10.0), (30.0, -20.0), (0.0, 80.0), (100.0, 89.0)):
        azimuth, _ = erfa.hd2ae(math.radians(ha), math.radians(dec), math.radians(52.0))
        assert azimuth_deg(ha, dec, 52.0) == pytest.approx(math.degrees(azimuth) % 360.0, abs=1e-9)


def test_separations_are_those_of_vectors() -> None:
    for _, places in boxes(20):
        assert separation_deg(*places[0], *places[-1]) == pytest.approx(
            angle_deg(vector(*places[0]), vector(*places[-1])), abs=1e-9
        )


SQUARE = ((0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0))
HOOK = ((0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (8.0, 10.0), (8.0, 2.0), (0.0, 2.0))


@pytest.mark.parametrize(
    ("box", "zone", "meets"),
    [
        (Box(2.0, 3.0, 2.0, 3.0), SQUARE, True),
        (Box(-5.0, 20.0, -5.0, 20.0), SQUARE, True),
        (Box(-5.0, 20.0, 4.0, 5.0), SQUARE, True),
        (Box(11.0, 20.0, 4.0, 5.0), SQUARE, False),
        (Box(1.0, 7.0, 3.0, 9.0), HOOK, False),
        (Box(1.0, 9.0, 3.0, 9.0), HOOK, True),
        (Box(1.0, 1.0, 1.0, 1.0), HOOK, True),
        (Box(-1.0, 2.0, 9.0, 12.0), ((0.0, 0.0), (10.0, 0.0), (10.0, 10.0)), False),
    ],
)
def test_a_box_meets_a_polygon_that_shares_a_point_with_it(
    box: Box, zone: tuple[tuple[float, float], ...], meets: bool
) -> None:
    assert meets_polygon(box, zone) is meets


def apart(one: np.ndarray, other: np.ndarray) -> bool:
    """Tell whether two convex polygons are apart: then a line along an edge of either is between them."""
    for polygon in (one, other):
        for edge in np.roll(polygon, -1, axis=0) - polygon:
            normal = np.array([-edge[1], edge[0]])
            first, second = one @ normal, other @ normal
            if first.max() < second.min() or second.max() < first.min():
                return True
    return False


def test_boxes_meet_triangles_that_no_line_keeps_from_them() -> None:
    rng, seen = random.Random(12), set()
    for _ in range(400):
        left, low = rng.uniform(-10.0, 10.0), rng.uniform(-10.0, 10.0)
        box = Box(left, left + rng.choice((0.1, 4.0)), low, low + rng.choice((0.1, 4.0)))
        corners = tuple((rng.uniform(-10.0, 10.0), rng.uniform(-10.0, 10.0)) for _ in range(3))
        square = np.array(
            [(x, y) for x, y in ((box[0], box[2]), (box[1], box[2]), (box[1], box[3]), (box[0], box[3]))]
        )
        meets = not apart(square, np.array(corners))
        assert meets_polygon(box, corners) is meets
        seen.add(meets)
    assert seen == {True, False}


def almanac_sun(days: float) -> np.ndarray:
    """The Astronomical Almanac's low-precision Sun, good to 0.01°: unit vector, equator of date."""
    mean, anomaly = 280.460 + 0.9856474 * days, math.radians(357.528 + 0.9856003 * days)
    longitude = math.radians(mean + 1.915 * math.sin(anomaly) + 0.020 * math.sin(2.0 * anomaly))
    return turned_to_equator(longitude, 0.0, days)


def almanac_moon(days: float) -> np.ndarray:
    """The Almanac's low-precision Moon, good to 0.3°: Earth radii, equator of date."""
    t = days / 36525.0

    def sine(amplitude: float, phase: float, rate: float) -> float:
        return amplitude * math.sin(math.radians(phase + rate * t))

    longitude = 218.32 + 481267.881 * t + sine(6.29, 135.0, 477198.87) - sine(1.27, 259.3, -413335.36)
    longitude += sine(0.66, 235.7, 890534.22) + sine(0.21, 269.9, 954397.74)
    longitude += -sine(0.19, 357.5, 35999.05) - sine(0.11, 186.5, 966404.03)
    latitude = sine(5.13, 93.3, 483202.02) + sine(0.28, 228.2, 960400.89)
    latitude += -sine(0.28, 318.3, 6003.15) - sine(0.17, 217.6, -407332.21)
    parallax = 0.9508 + sine(0.0518, 225.0, 477198.87) + sine(0.0095, 349.3, -413335.36)
    parallax += sine(0.0078, 325.7, 890534.22) + sine(0.0028, 359.9, 954397.74)
    distance = 1.0 / math.sin(math.radians(parallax))
    return distance * turned_to_equator(math.radians(longitude), math.radians(latitude), days)


def turned_to_equator(longitude: float, latitude: float, days: float) -> np.ndarray:
    obliquity = math.radians(23.439 - 0.0000004 * days)
    x = math.cos(latitude) * math.cos(longitude)
    y = math.cos(latitude) * math.sin(longitude)
    z = math.sin(latitude)
    cosine, sine = math.cos(obliquity), math.sin(obliquity)
    return np.array([x, cosine * y - sine * z, sine * y + cosine * z])


@pytest.mark.parametrize("unix_s", [1772337600.0, 1782043200.0, 1798999200.0, 1948690800.0])
@pytest.mark.parametrize("site", [(52.15, 4.49), (-33.9, 18.4), (0.0, -120.0)])
def test_sun_and_moon_stand_where_the_almanac_has_them(unix_s: float, site: tuple[float, float]) -> None:
    days = unix_s / 86400.0 - 10957.5
    sidereal = erfa.gmst06(2451545.0, days, 2451545.0, days + 69.2 / 86400.0) + math.radians(site[1])
    place = np.array(
        [
            math.cos(math.radians(site[0])) * math.cos(sidereal),
            math.cos(math.radians(site[0])) * math.sin(sidereal),
            math.sin(math.radians(site[0])),
        ]
    )
    for wanderer, seen, within in (
        (sun_over(*site), almanac_sun(days), 0.025),
        (moon_over(*site), almanac_moon(days) - place, 0.5),
    ):
        body = wanderer.at(unix_s)
        ra = math.radians(math.degrees(sidereal) - body.hour_angle_deg)
        d = math.radians(body.dec_deg)
        told = np.array([math.cos(d) * math.cos(ra), math.cos(d) * math.sin(ra), math.sin(d)])
        assert angle_deg(told, seen) < within
        np.testing.assert_allclose([body.x, body.y, body.z], vector(body.hour_angle_deg, body.dec_deg))


@pytest.mark.parametrize("above_deg", [-0.5, -0.05, 0.0, 0.05, 0.09, 0.5, 1.5])
def test_a_skyline_is_no_wall_where_it_is_low(above_deg: float) -> None:
    """On the meridian to the south the altitude is 90° less what the declination is below the latitude."""
    skyline = Skyline(((0.0, 60.0), (120.0, 5.0), (240.0, 5.0)), 52.0)
    dec = 52.0 - (90.0 - 60.0 - above_deg)
    assert is_clear(skyline, Box(0.0, 0.0, dec, dec), 1.0)
    assert is_clear(skyline, Box(-0.5, 0.5, dec, dec + 0.5), 1.0)
    assert skyline.clearance(Box(0.0, 0.0, dec, dec)).some_deg == pytest.approx(55.0 + above_deg)


def test_a_skyline_is_a_wall_where_it_is_high() -> None:
    skyline = Skyline(((0.0, 60.0), (120.0, 5.0), (240.0, 5.0)), 52.0)
    for above_deg, clear in ((0.95, False), (1.05, True)):
        # To the north, above the pole.
        dec = 52.0 + 90.0 - 60.0 - above_deg
        assert is_clear(skyline, Box(0.0, 0.0, dec, dec), 1.0) is clear


STEEP = ((0.0, 0.0), (118.0, 0.0), (120.0, 80.0), (123.0, 80.0), (123.0, 10.0), (240.0, 25.0))


def test_a_tube_that_leans_is_clear_of_a_steep_skyline_to_every_side() -> None:
    """No direction so far from that of the axes lies below the points, and a wall that is farther is none."""
    rng, leans_deg = np.random.default_rng(4), 0.7
    skyline = Skyline(STEEP, 52.0, leans_deg)
    near = clear = 0
    for azimuth, altitude in zip(rng.uniform(100.0, 140.0, 600), rng.uniform(5.0, 85.0, 600), strict=True):
        around = np.radians(np.linspace(0.0, 360.0, 361))
        up, side = np.cos(around) * math.radians(leans_deg), np.sin(around) * math.radians(leans_deg)
        z, a = math.radians(azimuth), math.radians(altitude)
        ahead = np.array([math.cos(a) * math.cos(z), math.cos(a) * math.sin(z), math.sin(a)])
        above = np.array([-math.sin(a) * math.cos(z), -math.sin(a) * math.sin(z), math.cos(a)])
        beside = np.array([-math.sin(z), math.cos(z), 0.0])
        seen = ahead[:, None] + above[:, None] * up + beside[:, None] * side
        azimuths = np.degrees(np.arctan2(seen[1], seen[0])) % 360.0
        altitudes = np.degrees(np.arctan2(seen[2], np.hypot(seen[0], seen[1])))
        left_deg = float(np.min(altitudes - np.interp(azimuths, *np.array(STEEP).T, period=360.0)))
        hour_angle, dec = np.degrees(erfa.ae2hd(z, a, math.radians(52.0))).tolist()
        own = skyline.clearance(Box(hour_angle, hour_angle, dec, dec)).some_deg
        assert own <= left_deg + 1e-3
        near += own < 0.0 <= left_deg
        clear += own >= 0.0
    assert clear > 250
    assert near < 60


@pytest.mark.parametrize("margin_deg", [-2.0, 0.0, 0.01, 0.05, 0.1, 1.5, 3.0])
def test_regions_are_judged_by_a_margin_as_their_clearance_tells(margin_deg: float) -> None:
    """Closed forms of what is asked most often, against the clearance that they stand for."""
    zone = PierZone("l", ((-30.0, 10.0), (40.0, 20.0), (0.0, 50.0), (-10.0, 25.0)))
    sun = sun_over(52.0, 4.5).at(1_790_000_000.0)
    regions = (
        PierCollision(zone, 0.5),
        Travel("hour_angle", -60.0, 60.0),
        Travel("declination", -40.0, 80.0),
        Floor(10.0, 52.0),
        Cone("sun", sun, 15.0),
    )
    rng, found = random.Random(4), set()
    for _ in range(1500):
        ha, dec = rng.uniform(-45.0, 65.0) + rng.choice((0.0, 0.0, 360.0)), rng.uniform(-45.0, 100.0)
        box = Box(ha, ha + rng.choice((0.0, rng.uniform(0.0, 4.0))), dec, dec + rng.uniform(0.0, 4.0))
        for region in regions:
            clear = region.clearance(box).least_deg >= margin_deg
            assert is_clear(region, box, margin_deg) is clear, (region.name, box)
            found.add((region.name, clear))
    assert len(found) >= 2 * len(regions) - 2


def test_a_box_that_takes_too_many_halvings_to_be_judged_counts_as_not_clear() -> None:
    class Rough(Skyline):
        def clearance(self, box: Box) -> Clearance:
            return Clearance(1.0 if box.widest_deg < 1.0 else 0.0, 1.0)

    rough = Rough(NORTH_WALL, 52.0)
    assert is_clear(rough, Box(0.0, 8.0, 0.0, 8.0), 0.5)
    assert not is_clear(rough, Box(0.0, 100.0, 0.0, 100.0), 0.5)


def in_the_way(ha_deg: Any, dec_deg: Any) -> Any:
    """A wall two degrees thick that slants, and ends at 44° of declination."""
    return (dec_deg < 44.0) & (abs(ha_deg + 38.0 - 0.8 * (dec_deg - 38.0)) < 2.0)


def meets_the_wall(box: Box, seconds: float) -> str | None:
    del seconds
    has = np.linspace(box.ha_low_deg, box.ha_high_deg, 60)[:, None]
    decs = np.linspace(box.dec_low_deg, box.dec_high_deg, 60)[None, :]
    return "horizon" if np.any(in_the_way(has, decs)) else None


def test_a_way_is_found_past_the_end_of_a_wall_from_close_beside_it() -> None:
    start, goal = Place(-35.5, 38.0), Place(-42.5, 37.0)
    route = find_route(start, goal, MountProfile(), meets_the_wall, meets_the_wall, 52.0)
    assert route.blocked_by is None
    assert route.legs[-1] == goal
    rng = random.Random(3)
    for one, other in pairwise((start, *route.legs)):
        for _ in range(2000):
            # Each axis in its own time: the mount may be anywhere in the box of both places.
            ha_deg = rng.uniform(min(one[0], other[0]), max(one[0], other[0]))
            dec_deg = rng.uniform(min(one[1], other[1]), max(one[1], other[1]))
            assert not in_the_way(ha_deg, dec_deg)


@pytest.mark.parametrize("latitude_deg", [52.0, -33.0])
@pytest.mark.parametrize("pier_rule", ["never", "hour_angle", "ascom"])
def test_axes_past_the_pole_point_where_they_point(pier_rule: str, latitude_deg: float) -> None:
    profile = MountProfile(pier_rule=pier_rule)
    rng = random.Random(5)
    for _ in range(200):
        place = Place(rng.uniform(-200.0, 200.0), rng.uniform(-269.0, 269.0))
        hour_angle, dec = direction_of(place)
        assert abs(dec) <= 90.0
        assert angle_deg(vector(hour_angle, dec), vector(*place)) < 1e-6
        axes = axes_of(hour_angle, dec, profile, latitude_deg)
        assert angle_deg(vector(*axes), vector(*place)) < 1e-6
        west = (hour_angle + 180.0) % 360.0 > 180.0
        # By a rule the tube hangs in the west past the pole that is up, or in the east.
        past = math.copysign(1.0, latitude_deg) * axes.dec_deg > 90.0
        assert past == {"never": False, "hour_angle": west, "ascom": not west}[pier_rule]


@pytest.mark.parametrize("latitude_deg", [52.0, -33.0])
def test_how_a_mount_stands_tells_its_axes_past_the_pole_too(latitude_deg: float) -> None:
    rng = random.Random(6)
    pole = math.copysign(1.0, latitude_deg)
    for _ in range(200):
        place = Place(rng.uniform(-170.0, 170.0), pole * rng.uniform(-80.0, 170.0))
        stance = stance_at(Stance(123.0, 0.0, 0.0, False, True), place)
        assert stance.beyond_pole == (abs(place.dec_deg) > 90.0)
        seen = vector(stance.sidereal_deg - stance.ra_deg, stance.dec_deg)
        assert angle_deg(seen, vector(*place)) < 1e-6
        found = AxesState(latitude_deg).of(stance)
        assert (found.ha_deg % 360.0, found.dec_deg) == pytest.approx((place.ha_deg % 360.0, place.dec_deg))


def test_a_box_about_the_zenith_meets_a_wall_on_the_other_side_of_it() -> None:
    """On the meridian, at 60.5° of declination, it is 81.5° high in the north: the wall, 82°."""
    wall, box = Skyline(NORTH_WALL, 52.0), Box(-0.5, 0.5, 42.0, 60.5)
    assert wall.clearance(box).least_deg <= -0.5
    assert not is_clear(wall, box, 0.1)


SOUTH_WALL = ((0.0, 5.0), (90.0, 5.0), (170.0, 5.0), (180.0, 30.0), (190.0, 5.0), (270.0, 5.0))
NORTH_WALL = ((0.0, 82.0), (20.0, 5.0), (90.0, 5.0), (180.0, 5.0), (270.0, 5.0), (340.0, 5.0))


@pytest.mark.parametrize(
    ("points", "begin_dec"),
    [
        pytest.param(SOUTH_WALL, (-30.0, 10.0), id="south"),
        pytest.param(NORTH_WALL, (40.0, 60.0), id="zenith"),
    ],
)
def test_a_box_is_clear_of_a_skyline_only_where_all_of_it_is(
    points: tuple[tuple[float, float], ...], begin_dec: tuple[float, float]
) -> None:
    wall = Skyline(points, 52.0)
    rng = random.Random(9)
    seen = set()
    for _ in range(60):
        ha, dec = rng.uniform(-60.0, 60.0), rng.uniform(*begin_dec)
        box = Box(ha, ha + rng.choice([1.0, 10.0, 40.0]), dec, dec + rng.choice([1.0, 5.0, 20.0]))
        has = np.linspace(box.ha_low_deg, box.ha_high_deg, 15)
        decs = np.linspace(box.dec_low_deg, box.dec_high_deg, 15)
        least = min(
            wall.clearance(Box(float(h), float(h), float(d), float(d))).some_deg for h in has for d in decs
        )
        # Of places 2° above all of it, only that is told.
        assert least > 2.0 or wall.clearance(box).least_deg <= least + 1e-9
        found = is_clear(wall, box, 0.5)
        seen.add(found)
        assert not (found and least < 0.5)
        # A place that is clear by far is not held back.
        assert found or least < 3.0
    assert seen == {True, False}


@pytest.mark.parametrize(
    ("points", "words"),
    [
        (((0.0, 5.0), (90.0, 5.0), (180.0, 90.0), (270.0, 5.0)), "horizon is 180 90 at one point"),
        (((0.0, 5.0), (90.0, 5.0), (180.0, -91.0), (270.0, 5.0)), "horizon is 180 -91 at one point"),
        (
            ((0.0, 5.0), (90.0, 5.0), (180.0, 5.0), (270.0, 5.0), (361.0, 5.0)),
            "horizon is 361 5 at one point",
        ),
        (((0.0, 5.0), (180.0, 5.0), (90.0, 5.0), (270.0, 5.0)), "90° comes after 180°"),
        (((0.0, 5.0), (90.0, 5.0), (190.0, 5.0), (270.0, 5.0)), "not known between azimuths 90° and 190°"),
        (((0.0, 5.0), (90.0, 5.0), (180.0, 5.0), (260.0, 5.0)), "not known between azimuths 260° and 0°"),
    ],
)
def test_a_skyline_that_is_none_is_refused(points: tuple[tuple[float, float], ...], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        SafetyLimits(horizon=points)
    assert SafetyLimits(horizon=((0.0, 5.0), (90.0, -1.0), (180.0, 89.0), (270.0, 5.0), (360.0, 5.0))).horizon


@pytest.mark.parametrize(
    ("key", "values", "refused"),
    [
        ("floor_altitude_deg", (-90.0, 0.5, 89.9), (-90.1, 90.0, math.nan)),
        ("longest_fault_s", (0.0, 0.5, 10.0), (-0.1, 10.1, math.nan)),
        ("clock_tolerance_s", (0.1, 90.0), (0.0, -1.0, math.inf, math.nan)),
        ("sun_cone_deg", (0.0, 0.5, 89.9), (-0.1, 90.0, math.inf, math.nan)),
        ("moon_cone_deg", (0.0, 0.5, 89.9), (-0.1, 90.0, math.inf, math.nan)),
    ],
)
def test_a_limit_holds_in_its_range_and_none_but_that(
    key: str, values: tuple[float, ...], refused: tuple[float, ...]
) -> None:
    for value in values:
        assert getattr(SafetyLimits(optical=False, **{key: value}), key) == value  # type: ignore[arg-type]
    for value in refused:
        with pytest.raises(ValueError, match=f"^{key} is {value:g}"):
            SafetyLimits(optical=False, **{key: value})  # type: ignore[arg-type]


def test_limits_that_nobody_gives_are_those_of_a_telescope_with_optics() -> None:
    assert SafetyLimits() == SafetyLimits(0.0, True, None, 0.0, 1.0, 60.0, ())
    assert [SafetyLimits(optical=optical).sun_deg for optical in (True, False)] == [15.0, 0.0]
    assert [SafetyLimits(optical=optical, sun_cone_deg=20.0).sun_deg for optical in (True, False)] == [
        20.0
    ] * 2
    with pytest.raises(ValueError, match="sun_cone_deg is 0, but there is a telescope with optics"):
        SafetyLimits(sun_cone_deg=0.0)
    # With the body at the zenith, a sky of 30° is left, by the lowest of a skyline or a floor above it.
    hills = ((0.0, 60.0), (90.0, 70.0), (180.0, 62.0), (270.0, 61.0))
    for known in ({"floor_altitude_deg": 60.0}, {"horizon": hills}):
        assert SafetyLimits(sun_cone_deg=29.9, moon_cone_deg=29.9, **known)  # type: ignore[arg-type]
        for cone in ("sun_cone_deg", "moon_cone_deg"):
            with pytest.raises(ValueError, match=f"{cone} is 30, and the sky left reaches 30°"):
                SafetyLimits(**{cone: 30.0}, **known)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="sun_cone_deg is 26, and the sky left reaches 25°"):
        SafetyLimits(floor_altitude_deg=65.0, sun_cone_deg=26.0, horizon=hills)
