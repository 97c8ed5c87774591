"""Margins, cones and ways out of them at single places, and how far rates may lead: closed forms."""

from __future__ import annotations

import math
from typing import Any

import erfa
import numpy as np
import pytest
from driven_limits import sun_place
from msgspec.structs import replace
from safety_stand import LATITUDE_DEG, LONGITUDE_DEG, T0

from sattrack.core.angles import altitude_deg, separation_deg
from sattrack.mount.geometry import AxisGeometry
from sattrack.mount.model import (
    SIDEREAL_RATE_DEG_S,
    AxisLimits,
    MountProfile,
    PierZone,
    PointingTerms,
    SitePlace,
)
from sattrack.safety import ROWS, SafetyLimits
from sattrack.safety.bounds import Bounds, ClearRoom
from sattrack.safety.geometry import Box
from sattrack.safety.rate_limit import (
    AxisReach,
    Delays,
    closing_s,
    latency_s,
    nearest_rates,
    standstill_s,
    unheeded_s,
)
from sattrack.safety.regions import PierCollision, Travel, is_clear
from sattrack.safety.table import closing_promise_s, promise_s

DARK = SafetyLimits(floor_altitude_deg=-90.0, optical=False)
ZONE = PierZone("pier", ((-20.0, 60.0), (20.0, 60.0), (20.0, 88.0), (-20.0, 88.0)))
TRAVEL = MountProfile(hour_angle_limit_deg=40.0, dec_axis_limits_deg=(-30.0, 100.0), pier_zones=(ZONE,))
SAME = 1e-6


def bounds(
    profile: MountProfile = TRAVEL, limits: SafetyLimits = DARK, utc_s: float = T0, gap: float = 0.0
) -> Bounds:
    found = Bounds(profile, limits, LATITUDE_DEG, LONGITUDE_DEG)
    assert found.look(utc_s, gap)
    return found


@pytest.mark.parametrize(
    ("place", "margin_deg", "near"),
    [
        ((39.85, 0.0), 0.1, {}),
        ((39.95, 0.0), 0.1, {"hour_angle": 0.05}),
        ((-39.85, 0.0), 0.3, {"hour_angle": 0.15}),
        ((41.0, 0.0), 0.1, {"hour_angle": -1.0}),
        ((0.0, -29.95), 0.1, {"declination": 0.05}),
        ((39.98, 99.97), 0.1, {"hour_angle": 0.02, "declination": 0.03}),
        # Half of a zone's half a degree is half of what is left of its margin; from inside there is no way.
        ((0.0, 59.75), 0.1, {"pier": 0.045}),
        ((0.0, 70.0), 0.1, {}),
        ((20.25, 70.0), 0.1, {"pier": 0.045}),
        ((0.0, 59.4), 0.1, {}),
    ],
)
def test_a_place_is_near_to_what_it_does_not_keep_its_margin_from(
    place: tuple[float, float], margin_deg: float, near: dict[str, float]
) -> None:
    assert bounds().near(place, 0.0, margin_deg) == pytest.approx(near, abs=0.002)


@pytest.mark.parametrize(
    ("place", "seconds", "left"),
    [
        ((39.85, 0.0), 0.0, {}),
        ((39.95, 0.0), 0.0, {"hour_angle": 0.05 - SAME}),
        ((41.0, 0.0), 0.0, {"hour_angle": -1.0 - SAME}),
        # The sky goes on by 0.2507° in a minute.
        ((39.6, 0.0), 60.0, {}),
        ((39.7, 0.0), 60.0, {"hour_angle": 0.3 - SAME - 60.0 * SIDEREAL_RATE_DEG_S}),
        ((39.95, 0.0), 60.0, {"hour_angle": 0.0}),
        ((41.0, 0.0), 60.0, {"hour_angle": -1.0 - SAME - 60.0 * SIDEREAL_RATE_DEG_S}),
        ((0.0, 70.0), 0.0, {}),
    ],
)
def test_a_way_may_leave_what_it_begins_near_but_come_no_nearer(
    place: tuple[float, float], seconds: float, left: dict[str, float]
) -> None:
    assert bounds().leaving(place, seconds) == pytest.approx(left, abs=1e-9)


def test_a_box_keeps_its_margin_from_every_limit_but_those_that_are_lowered() -> None:
    found = bounds()
    for ha, dec, margins, margin_deg, name in (
        (39.85, 0.0, {}, 0.1, None),
        (39.95, 0.0, {}, 0.1, "hour_angle"),
        (39.95, 0.0, {}, 0.01, None),
        (39.95, 0.0, {"hour_angle": 0.04}, 0.1, None),
        (39.95, 0.0, {"hour_angle": 0.06}, 0.1, "hour_angle"),
        (39.95, 0.0, {"declination": 0.0}, 0.1, "hour_angle"),
        (45.0, 0.0, {"hour_angle": -math.inf}, 0.1, None),
        (0.0, 99.95, {}, 0.1, "declination"),
        (0.0, 59.6, {}, 0.1, "pier"),
        (0.0, 59.4, {}, 0.1, None),
        (0.0, 59.6, {"pier": 0.05}, 0.1, None),
    ):
        assert found.violated(Box(ha, ha, dec, dec), margins, 0.0, margin_deg) == name
    found = bounds(MountProfile(), DAY)
    sun = found.cones[0].body
    for clear_deg, seconds, margins, name in (
        (0.105, 0.0, {}, None),
        (0.095, 0.0, {}, "sun"),
        (0.105, 5.0, {}, "sun"),
        (0.125, 5.0, {}, None),
        (0.095, 5.0, {"sun": 0.09}, None),
    ):
        dec = sun.dec_deg + WIDE_DEG + clear_deg
        box = Box(sun.hour_angle_deg, sun.hour_angle_deg, dec, dec)
        assert found.violated(box, margins, seconds) == name
        near = {"sun": clear_deg} if name or margins else {}
        assert found.near((box.ha_low_deg, dec), seconds) == pytest.approx(near, abs=1e-6)


def test_rates_come_nearer_at_any_part_of_their_way() -> None:
    near = {"hour_angle": 0.05}
    found = bounds()
    for rates, name in (
        ((0.01, 0.0), "hour_angle"),
        ((-0.01, 0.0), None),
        ((0.0, -5.0), None),
        ((-79.0, 0.0), None),
        ((-81.0, 0.0), "hour_angle"),
    ):
        for seconds in (1.0, 4.0):
            slower = rates[0] / seconds, rates[1] / seconds
            assert found.comes_nearer(near, (39.95, 0.0), slower, seconds) == name
    assert found.comes_nearer({"declination": 1.0}, (39.95, 0.0), (0.01, 0.0), 1.0) is None
    # Out past the end and back again within the whole of it: the half of it is looked at, too.
    floor = Bounds(MountProfile(), SafetyLimits(floor_altitude_deg=20.0, optical=False), LATITUDE_DEG, None)
    assert floor.look(None, 0.0)
    begin = (-81.0, 20.0)
    near = {"altitude": altitude_deg(*begin, LATITUDE_DEG) - 20.0}
    # By three quarters of a turn down and round through the nadir to where it is higher than before.
    assert floor.comes_nearer(near, begin, (350.0, 0.0), 1.0) == "altitude"
    # By two turns and two degrees: the half and the whole of it end higher, a quarter lower.
    assert floor.comes_nearer(near, begin, (722.0, 0.0), 1.0) == "altitude"
    assert floor.comes_nearer(near, begin, (2.0, 0.0), 1.0) is None


DAY = SafetyLimits(floor_altitude_deg=-90.0)
SUN_HA, SUN_DEC = sun_place(T0)
WIDE_DEG = 15.0 + SIDEREAL_RATE_DEG_S
"""The cone, and what the Sun comes until it is looked at again."""


def test_the_suns_cone_is_as_wide_as_the_clocks_and_the_mounts_errors_make_it() -> None:
    (cone,) = bounds(limits=DAY).cones
    assert separation_deg(cone.body.hour_angle_deg, cone.body.dec_deg, SUN_HA, SUN_DEC) < 0.03
    assert (cone.name, cone.cone_deg) == ("sun", pytest.approx(WIDE_DEG))
    assert bounds(limits=DAY, gap=0.2).cones[0].cone_deg == pytest.approx(WIDE_DEG + 0.2)
    crooked = AxisGeometry(0.0, 52.0, axes_deg=90.3, cone_deg=-0.2)
    loose = replace(MountProfile(), geometry=crooked, stands_at=SitePlace(LATITUDE_DEG, LONGITUDE_DEG))
    assert bounds(loose, DAY).cones[0].cone_deg == pytest.approx(WIDE_DEG + 0.5)
    # What the terms of a pointing model are together, one degree and a half.
    terms = PointingTerms("", LATITUDE_DEG, {"IH": (3600.0, 1.0), "ID": (-1800.0, 1.0)}, 20.0, 30)
    pointed = replace(MountProfile(), pointing=terms)
    assert bounds(pointed, DAY).cones[0].cone_deg == pytest.approx(WIDE_DEG + 1.5)


def test_the_sun_is_looked_at_once_a_second_and_counts_from_before_three_degrees_below_the_horizon() -> None:
    found = bounds(limits=DAY)
    first = found.cones[0].body
    assert found.look(T0 + 0.9, 0.0)
    assert found.cones[0].body == first
    assert found.look(T0 + 1.1, 0.0)
    assert found.cones[0].body.hour_angle_deg - first.hour_angle_deg == pytest.approx(
        1.1 * SIDEREAL_RATE_DEG_S, abs=1e-5
    )
    assert found.look(T0 - 5.0, 0.0)
    assert found.cones[0].body.hour_angle_deg < first.hour_angle_deg
    down_s = next(t for t in range(0, 43200, 10) if altitude_deg(*sun_place(T0 + t), LATITUDE_DEG) < -3.2)
    for later_s, is_up in ((-40.0, True), (40.0, False)):
        found = bounds(limits=DAY, utc_s=T0 + down_s + later_s)
        assert (found.sun_is_up, len(found.cones)) == (is_up, int(is_up))


@pytest.mark.parametrize(
    ("limits", "names", "sun_is_up"),
    [
        (DAY, ["sun"], True),
        (DARK, [], False),
        (replace(DARK, sun_cone_deg=20.0), ["sun"], False),
        (replace(DARK, sun_cone_deg=0.5), ["sun"], False),
        (replace(DARK, moon_cone_deg=5.0), [], False),
    ],
)
def test_cones_are_those_that_are_asked_for_of_what_is_up(
    limits: SafetyLimits, names: list[str], sun_is_up: bool
) -> None:
    found = bounds(limits=limits)
    assert ([cone.name for cone in found.cones], found.sun_is_up) == (names, sun_is_up)


def test_without_time_or_place_nobody_knows_where_the_sun_is() -> None:
    for utc_s, longitude_deg, knows in ((T0, 4.5, True), (None, 4.5, False), (T0, None, False)):
        found = Bounds(MountProfile(), DAY, LATITUDE_DEG, longitude_deg)
        assert found.look(utc_s, 0.0) == knows
        assert found.sun_is_up
        assert bool(found.cones) == knows
    # What was known of a moment ago is not gone by.
    found = bounds(limits=DAY)
    assert not found.look(None, 0.0)
    assert (found.cones, found.utc_s) == ((), None)


def test_a_mount_of_other_axes_sees_the_sun_by_their_angles() -> None:
    azimuthal = replace(
        MountProfile(), geometry=AxisGeometry(0.0, 90.0), stands_at=SitePlace(LATITUDE_DEG, LONGITUDE_DEG)
    )
    body = bounds(azimuthal, DAY).cones[0].body
    _, altitude = erfa.hd2ae(math.radians(SUN_HA), math.radians(SUN_DEC), math.radians(LATITUDE_DEG))
    assert body.dec_deg == pytest.approx(math.degrees(altitude), abs=0.03)
    h, d = math.radians(body.hour_angle_deg), math.radians(body.dec_deg)
    assert (body.x, body.y, body.z) == pytest.approx(erfa.s2c(h, d))


@pytest.mark.parametrize("pole_azimuth_deg", [0.0, 30.0, 90.0, 200.0, -30.0])
def test_a_skyline_stays_where_it_is_whatever_azimuth_the_axis_counts_from(pole_azimuth_deg: float) -> None:
    """With walls in three places; the first angle is 0 opposite to the pole's azimuth."""
    points = (
        (0.0, 5.0),
        (90.0, 5.0),
        (120.0, 5.0),
        (120.0, 20.0),
        (200.0, 30.0),
        (200.0, 10.0),
        (280.0, 40.0),
        (360.0, 40.0),
    )
    azimuthal = replace(
        MountProfile(),
        geometry=AxisGeometry(pole_azimuth_deg, 90.0),
        stands_at=SitePlace(LATITUDE_DEG, LONGITUDE_DEG),
    )
    found = bounds(azimuthal, replace(DARK, horizon=points))
    for azimuth in np.arange(0.5, 360.0, 7.0):
        first = math.remainder(azimuth - 180.0 - pole_azimuth_deg, 360.0)
        skyline = float(np.interp(azimuth, *np.array(points).T))
        for above_deg, name in ((0.09, "horizon"), (0.11, None)):
            place = (first, skyline + above_deg)
            assert found.violated(Box.between(place, place), {}, 0.0) == name


@pytest.mark.parametrize(
    ("clear_deg", "rate_deg_s"),
    [(0.107, None), (0.1045, 0.05), (0.0, 0.05), (-0.5, 0.55), (-0.94, 0.99), (-3.0, 1.0)],
)
@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_axes_beside_the_sun_or_in_its_cone_are_led_straight_away_the_deeper_the_faster(
    clear_deg: float, rate_deg_s: float | None, sense: float
) -> None:
    """For 1.2 s the Sun goes 0.005° on; to its north and south, away is along the declination."""
    found = bounds(MountProfile(), DAY)
    sun = found.cones[0].body
    place = (sun.hour_angle_deg, sun.dec_deg + sense * (WIDE_DEG + clear_deg))
    ways = found.away(place, 1.2)
    assert found.dazzled(place) == pytest.approx(max(0.0, -clear_deg))
    if rate_deg_s is None:
        assert ways == []
        return
    assert ways[0] == pytest.approx((0.0, sense * rate_deg_s), abs=1e-4)
    assert all(max(map(abs, way)) == pytest.approx(rate_deg_s) for way in ways)
    cos_dec = math.cos(math.radians(place[1]))
    turns = [math.degrees(math.atan2(ha * cos_dec, sense * dec)) for ha, dec in ways]
    # The way itself, each axis alone where it gains anything, and twelve beside it, on the sky.
    beside = [
        sense_ * -sense * turn for turn in (15.0, 30.0, 45.0, 60.0, 70.0, 80.0) for sense_ in (1.0, -1.0)
    ]
    assert turns[-12:] == pytest.approx(beside, abs=0.05)


def test_axes_beside_the_sun_in_hour_angle_are_led_away_by_both() -> None:
    found = bounds(MountProfile(), DAY)
    sun = found.cones[0].body
    place = (sun.hour_angle_deg + 14.0, sun.dec_deg + 3.0)
    for ha, dec in found.away(place, 1.2)[:3]:
        there = (place[0] + 0.01 * ha, place[1] + 0.01 * dec)
        assert separation_deg(*there, sun.hour_angle_deg, sun.dec_deg) > separation_deg(
            *place, sun.hour_angle_deg, sun.dec_deg
        )
    both, up, across = found.away(place, 1.2)[:3]
    assert min(both) > 0.0
    assert (up[0], across[1]) == (0.0, 0.0)


def test_room_that_is_known_is_kept_with_the_new_where_all_between_is_clear() -> None:
    room, free = ClearRoom(1.0), [Travel("hour_angle", -100.0, 100.0)]
    one, other, far = (Box(ha, ha, 0.0, 0.0) for ha in (0.0, 3.0, 99.5))
    for margin_deg, kept in ((0.1, True), (0.05, True), (0.2, False)):
        room.forget()
        room.widen(free, one, 0.1)
        room.widen(free, other, margin_deg)
        assert room.holds(other, margin_deg)
        assert room.holds(one, margin_deg) == kept
    room.widen(free, far, 0.1)
    assert not room.holds(far, 0.1), "there is no room at the end"


@pytest.mark.parametrize(("side", "struck"), [("normal", (1, 0)), ("beyond_pole", (0, 1)), ("both", (1, 1))])
def test_a_zone_holds_on_its_side_of_the_pier_by_half_a_degree_and_after_any_turn(
    side: Any, struck: tuple[int, int]
) -> None:
    """Beyond the pole the axes stand at the hour angle and half a turn, past the pole by what is left."""
    zone = PierCollision(replace(ZONE, side=side), 0.5)
    for k, beyond in enumerate((False, True)):
        for ha, dec in (
            (0.0, 70.0),
            (19.0, 61.0),
            (-19.0, 87.0),
            (0.0, 59.51),
            (20.49, 70.0),
            (0.0, 59.49),
            (-20.51, 70.0),
        ):
            axes = (ha + 180.0, 180.0 - dec) if beyond else (ha, dec)
            within = -20.5 < ha < 20.5 and 59.5 < dec < 88.5
            for turns in (-2, -1, 0, 1):
                for dec_turns in (-1, 0):
                    box = Box.between(*2 * ((axes[0] + 360.0 * turns, axes[1] + 360.0 * dec_turns),))
                    assert is_clear(zone, box, 0.1) == (not (within and struck[k]))
                    inside = -20.0 < ha < 20.0 and 60.0 < dec < 88.0
                    assert (zone.clearance(box).least_deg < 0.0) == bool(inside and struck[k])


def test_a_zone_that_is_wider_than_half_a_turn_holds_everywhere_in_it() -> None:
    zone = PierCollision(
        PierZone("ring", ((-170.0, 60.0), (170.0, 60.0), (170.0, 88.0), (-170.0, 88.0))), 0.5
    )
    for ha in range(-530, 531, 20):
        place = (float(ha), 70.0)
        assert is_clear(zone, Box.between(place, place), 0.1) == (abs(math.remainder(ha, 360.0)) > 170.5)


# How far an axis may come: it goes on at 2 °/s up or 1 °/s down for 0.3 s and until it obeys, 0.2 s; what is
# asked for holds for 1 s more, and 8 of 10 °/s² brake.


@pytest.mark.parametrize(
    ("asked", "down", "up"),
    [
        (0.0, 0.3 + 0.2 + 1.0 / 16.0, 0.6 + 0.4 + 4.0 / 16.0),
        (1.0, 0.3 + 0.2 + 1.0 / 16.0, 0.6 + 0.4 + 1.0 + 1.0 / 16.0 + 1.0 / 16.0),
        (3.0, 0.3 + 0.2 + 1.0 / 16.0, 0.6 + 0.6 + 3.0 + 9.0 / 16.0),
        (-0.5, 0.3 + 0.2 + 0.5 + 0.25 / 16.0 + 0.25 / 16.0, 0.6 + 0.4 + 4.0 / 16.0),
        (-3.0, 0.3 + 0.6 + 3.0 + 9.0 / 16.0, 0.6 + 0.4 + 4.0 / 16.0),
    ],
)
def test_an_axis_may_come_as_far_as_delays_fault_and_braking_let_it(
    asked: float, down: float, up: float
) -> None:
    reach = AxisReach(10.0, (-1.0, 2.0), Delays(0.3, 0.2, 1.0), 10.0)
    assert reach.deg(asked) == pytest.approx((10.0 - down, 10.0 + up))
    # What goes one way only comes the other way by nothing but what is asked.
    one_way = AxisReach(10.0, (1.0, 2.0), Delays(0.3, 0.2, 1.0), 10.0)
    assert one_way.deg(1.0)[0] == 10.0
    assert AxisReach(10.0, (-2.0, -1.0), Delays(0.3, 0.2, 1.0), 10.0).deg(-1.0)[1] == 10.0


def test_delays_are_summed_as_the_documentation_has_them() -> None:
    """Two periods and 0.1 s of jitter, the profile's delays, the slower axis; six periods for edges."""
    axes = {"ra": AxisLimits(lag_s=0.02), "dec": AxisLimits(lag_s=0.03)}
    profile = MountProfile(
        period_s=0.1, command_delay_s=0.004, status_delay_s=0.0005, abort_delay_s=0.7, **axes
    )
    assert latency_s(profile) == pytest.approx(0.2 + 0.1 + 0.0045 + 0.03)
    assert latency_s(replace(profile, move_axis="edge")) == pytest.approx(0.3345 + 0.6)
    assert unheeded_s(profile, 1.0) == pytest.approx(1.7)
    assert standstill_s(-4.0, 0.2, 10.0) == pytest.approx(0.2 + 4.0 / 8.0)
    # To 0.1 °/s, an e-th less in latency and fault: from 2 °/s, three times.
    rate = 0.1 * math.e**3
    assert closing_s(-rate, Delays(9.0, 0.2, 1.0), 10.0) == pytest.approx(3.0 * 1.2 + 0.2 + rate / 8.0)
    assert closing_s(0.05, Delays(9.0, 0.2, 1.0), 10.0) == pytest.approx(0.2 + 0.05 / 8.0)


@pytest.mark.parametrize(
    ("row", "noticed_s"),
    [
        ("command", 0.0),
        ("altitude", 0.0),
        # Three statuses; half a second and one; two seconds; three and eight statuses, and the longest fault.
        ("clock", 0.15),
        ("current", 0.55),
        ("status_age", 2.0),
        ("obedience", 3.4 + 1.5),
    ],
)
def test_a_row_promises_rest_after_it_is_noticed_obeyed_and_braked(row: str, noticed_s: float) -> None:
    """From 4 °/s, with 80 % of the slower axis' 5 °/s²; the abort is obeyed a period and its delay later."""
    slow = AxisLimits(max_acceleration_deg_s2=5.0)
    profile = MountProfile(dec=slow, abort_delay_s=0.3)
    rests_s = noticed_s + 0.05 + 0.3 + 0.2004 + 4.0 / (0.8 * 5.0)
    assert promise_s(ROWS[row], profile, 1.5, 4.0) == pytest.approx(rests_s)
    assert (
        promise_s(ROWS["rate"], profile, 1.5, 4.0)
        == promise_s(ROWS["acceleration"], profile, 1.5, 4.0)
        == 0.0
    )
    closes_s = math.log(4.0 / 0.1) * (0.2004 + 1.5 + 0.3) + 0.2004 + 1.0
    assert closing_promise_s(profile, 1.5, 4.0) == pytest.approx(closes_s)


@pytest.mark.parametrize("signs", [(1.0, 1.0), (-1.0, 1.0), (1.0, -1.0)])
@pytest.mark.parametrize(
    ("most", "goes"),
    [
        ((0.5, 4.0), (0.5, 4.0)),
        ((0.2, 9.0), (0.2, 8.0)),
        ((9.0, 0.4), (2.0, 0.4)),
        ((9.0, 9.0), (2.0, 8.0)),
        # The way of the wish comes as near as both axes by themselves, but for 2 %.
        ((0.5, 1.0), (0.25, 1.0)),
    ],
)
def test_each_axis_comes_as_near_to_its_wish_as_its_own_ramp_lets_it(
    most: tuple[float, float], goes: tuple[float, float], signs: tuple[float, float]
) -> None:
    """At 60° of declination; each ramp goes ten times as far the other way."""
    room = tuple(
        (-10.0 * x, x) if sign > 0.0 else (-x, 10.0 * x) for x, sign in zip(most, signs, strict=True)
    )
    wish = (2.0 * signs[0], 8.0 * signs[1])
    found = nearest_rates(wish, room, 0.5, lambda _: True)  # type: ignore[arg-type]
    assert found == pytest.approx((signs[0] * goes[0], signs[1] * goes[1]))
