"""Slews: their turn of the cables, their legs, how rates lead them, and when they have strayed."""

from __future__ import annotations

import math
import random
from itertools import pairwise, product
from typing import Any

import numpy as np
import pytest
from driven_limits import sun_place
from msgspec.structs import replace
from safety_stand import LATITUDE_DEG, LONGITUDE_DEG, T0

from sattrack.core.angles import separation_deg
from sattrack.mount.geometry import AxisGeometry
from sattrack.mount.model import (
    SIDEREAL_RATE_DEG_S,
    AxisLimits,
    MountProfile,
    PierZone,
    Seen,
    SitePlace,
    Slew,
)
from sattrack.safety import SafetyLimits
from sattrack.safety.bounds import Bounds
from sattrack.safety.geometry import Box, Place, Toward, meets_polygon, nearest_deg
from sattrack.safety.route import slew_s
from sattrack.safety.slews import SlewGate

DARK = SafetyLimits(floor_altitude_deg=-90.0, optical=False)
FREE = MountProfile(hour_angle_limit_deg=360.0)
LED = replace(FREE, geometry=AxisGeometry(0.0, 52.0), stands_at=SitePlace(LATITUDE_DEG, LONGITUDE_DEG))


def bounds(profile: MountProfile, limits: SafetyLimits) -> Bounds:
    found = Bounds(profile, limits, LATITUDE_DEG, LONGITUDE_DEG)
    assert found.look(T0, 0.0)
    return found


def slew_gate(profile: MountProfile = FREE, detours: bool = False, limits: SafetyLimits = DARK) -> SlewGate:
    found = bounds(profile, limits)
    return SlewGate(profile, found, LATITUDE_DEG, detours)


def begun(gate: SlewGate, start: Place, target: Slew, braking: Box | None = None) -> SlewGate:
    """Clear a slew from a place, the mount's clock at nought."""
    braking = Box.between(start, start) if braking is None else braking
    assert gate.clear(target, 0.0, (-start[0], start[1]), start, braking, False) == target
    return gate


@pytest.mark.parametrize("geometry", [False, True])
@pytest.mark.parametrize("side", ["east", "west", "south", "north"])
def test_a_mount_strays_by_the_third_status_in_a_row_outside_of_what_its_slew_was_judged_by(
    geometry: bool, side: str
) -> None:
    """A degree about the box of both ends; six where rates lead."""
    profile = LED if geometry else FREE
    start, target = Place(-20.0, 30.0), Slew(-10.0, 50.0)
    loose = 6.0 if geometry else 1.0
    for out_deg, strays in ((-0.01, False), (0.01, True)):
        place = {
            "east": Place(-20.0 - loose - out_deg, 40.0),
            "west": Place(10.0 + loose + out_deg, 40.0),
            "south": Place(0.0, 30.0 - loose - out_deg),
            "north": Place(0.0, 50.0 + loose + out_deg),
        }[side]
        gate, slewing = begun(slew_gate(profile), start, target), Seen(None, 0.0, 0.0, 0.0, slewing=True)
        assert [gate.strays(place, slewing) for _ in range(3)] == [False, False, strays]
        gate = begun(slew_gate(profile), start, target)
        places = (place, place, start, place, place)
        assert [gate.strays(one, slewing) for one in places] == [False] * 5
        assert not gate.strays(place, replace(slewing, slewing=False))
        assert [gate.strays(place, slewing) for _ in range(2)] == [False] * 2
        gate.forget()
        assert [gate.strays(place, slewing) for _ in range(3)] == [False] * 3


def test_axes_that_still_brake_have_not_strayed_where_nothing_is_near() -> None:
    start, target, slewing = Place(-20.0, 30.0), Slew(-10.0, 50.0), Seen(None, 0.0, 0.0, 0.0, slewing=True)
    braking, place = Box(-25.0, -20.0, 22.0, 30.0), Place(-24.0, 23.0)
    gate = begun(slew_gate(), start, target, braking)
    assert [gate.strays(place, slewing) for _ in range(3)] == [False] * 3
    gate = begun(slew_gate(replace(FREE, dec_axis_limits_deg=(23.0, 90.0))), start, target, braking)
    assert [gate.strays(place, slewing) for _ in range(3)] == [False, False, True]


@pytest.mark.parametrize("detours", [True, False])
def test_another_slew_waits_for_the_end_of_the_one_under_way_and_is_judged_from_there(detours: bool) -> None:
    """A mount goes to the first one's end whatever is asked: from there, a zone of the pier is in the way."""
    wall = PierZone("wall", ((-15.0, 20.0), (-5.0, 20.0), (-5.0, 45.0), (-15.0, 45.0)))
    start, first, second = Place(-20.0, 10.0), Slew(20.0, 40.0), Slew(0.0, 10.0)
    # By hand it is asked for, and the session begins it at rest.
    meanwhile = first if detours else second

    def asks(
        gate: SlewGate, target: Slew, dec_deg: float, braked_deg: float, slewing: bool = False
    ) -> Slew | str:
        braking = Box(-20.0, -20.0, dec_deg, braked_deg)
        return gate.clear(target, 0.0, (20.0, dec_deg), Place(-20.0, dec_deg), braking, slewing)

    walled = replace(FREE, pier_zones=(wall,))
    assert asks(slew_gate(walled, detours), second, 12.0, 16.0) == second
    for profile, from_there in ((FREE, second), (walled, None if detours else "pier")):
        # A mount that rests for two seconds has not taken the first one. By hand it takes the second instead,
        # or goes there by the first one's end: both ways must be clear.
        gate = begun(slew_gate(profile, detours), start, first)
        if detours:
            assert [asks(gate, second, 10.0, 10.02) for _ in range(39)] == [first] * 39
            assert not gate.on_last_leg
        else:
            assert [asks(gate, second, 10.0, 10.02) for _ in range(39)] == [from_there] * 39
            by_first = Seen(None, 0.0, 20.0, 40.0, slewing=True)
            assert [gate.strays(Place(-20.0, 40.0), by_first) for _ in range(3)] == [False] * 3
        assert (asks(gate, second, 10.0, 10.02), gate.on_last_leg) == (second, True)
        gate = begun(slew_gate(profile, detours), start, first)
        slews = [asks(gate, second, 10.0, 10.02, slewing=True) for _ in range(60)]
        assert (slews, gate.on_last_leg) == ([meanwhile] * 60, False)
        gate = begun(slew_gate(profile, detours), start, first)
        if detours:
            assert [asks(gate, second, 10.0, 10.02) for _ in range(39)] == [first] * 39
            assert [asks(gate, second, 11.0, 12.0), asks(gate, second, 12.0, 12.02)] == [first] * 2
        gate = begun(slew_gate(profile, detours), start, first)
        assert (asks(gate, second, 12.0, 16.0), gate.on_last_leg) == (meanwhile, False)
        slewing = Seen(None, 0.0, 20.0, 40.0, slewing=True)
        assert [gate.strays(Place(-20.0, 40.0), slewing) for _ in range(3)] == [False] * 3
        # Whoever takes it back has the first one alone.
        assert (asks(gate, first, 30.0, 38.0), gate.on_last_leg) == (first, True)
        assert (asks(gate, second, 39.0, 40.0), gate.on_last_leg) == (meanwhile, False)
        found = asks(gate, second, 40.0, 40.02)
        assert found == from_there if from_there else found not in {first, second, "pier"}
        gate.forget()
        assert gate.on_last_leg
    # Rates may lead elsewhere at once.
    assert asks(begun(slew_gate(LED), start, first), second, 12.0, 16.0) == second


@pytest.mark.parametrize(
    ("off_deg", "is_there"), [(0.0, True), (0.09, True), (0.11, False), (math.nan, False)]
)
def test_a_mount_is_where_its_slew_ends_by_a_tenth_of_a_degree(off_deg: float, is_there: bool) -> None:
    gate = begun(slew_gate(), Place(-20.0, 30.0), Slew(-10.0, 60.0))
    assert gate.is_there((-10.0, 60.0 + off_deg)) == is_there
    assert gate.is_there((-10.0 + 2.0 * off_deg, 60.0)) == is_there
    assert gate.on_last_leg


@pytest.mark.parametrize("move_axis", ["held", "edge"])
@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_a_led_slew_begins_by_half_of_a_ramp_and_ends_by_what_can_brake(move_axis: Any, sense: float) -> None:
    """A last time constant of 1 s, or 5 s by edges; a fifth, or a 25th, of the acceleration brakes."""
    slower = 5.0 if move_axis == "edge" else 1.0
    profile = replace(
        LED,
        move_axis=move_axis,
        ra=AxisLimits(max_rate_deg_s=3.0, slew_rate_deg_s=9.0, max_acceleration_deg_s2=4.0),
        dec=AxisLimits(max_rate_deg_s=9.0, slew_rate_deg_s=2.5, max_acceleration_deg_s2=2.0),
    )
    for gap in (0.2, 2.0, 30.0):
        start = Place(0.0, 40.0)
        gate = begun(slew_gate(profile), start, Slew(-sense * gap, 40.0 + sense * gap))
        steps = []
        for _ in range(200):
            led = gate.rates_from(start, 0.0)
            steps.append((-led.ra_rate_deg_s, led.dec_rate_deg_s))
        ramps = (0.5 * 4.0 * profile.period_s, 0.5 * 2.0 * profile.period_s)
        ends = [
            min(gap / slower, math.sqrt(0.4 / slower * acceleration * gap), fastest)
            for acceleration, fastest in ((4.0, 3.0), (2.0, 2.5))
        ]
        for axis in (0, 1):
            rates = [sense * step[axis] for step in steps]
            assert rates == pytest.approx([min(ends[axis], ramps[axis] * (k + 1)) for k in range(200)])
        # Whatever comes in between, it begins from rest again.
        gate.forget()
        assert gate.target is None
        led = begun(gate, start, Slew(-sense * gap, 40.0 + sense * gap)).rates_from(start, 0.0)
        assert (-led.ra_rate_deg_s, led.dec_rate_deg_s) == steps[0]


@pytest.mark.parametrize(
    ("onward_deg", "from_deg", "turn_deg"),
    [
        # The cables turn 240° either way, of which 2° are left over: 150° west is 210° east as well.
        (None, -20.0, 150.0),
        ((0.0, 0.0), -20.0, 150.0),
        ((0.0, 0.0), -60.0, -210.0),
        ((0.0, 87.9), -20.0, 150.0),
        ((0.0, 88.1), -20.0, -210.0),
        ((-27.9, 0.0), -60.0, -210.0),
        ((-28.1, 0.0), -60.0, 150.0),
        ((-28.1, 88.1), -60.0, 150.0),
        ((0.0, 0.0), 200.0, 237.9),
        ((0.0, 0.0), -200.0, -237.9),
        ((0.0, 0.0), 200.0, -121.9),
    ],
)
def test_the_turn_is_the_nearest_on_which_what_follows_keeps_two_degrees_from_the_cables_end(
    onward_deg: tuple[float, float] | None, from_deg: float, turn_deg: float
) -> None:
    gate = slew_gate(replace(LED, hour_angle_limit_deg=240.0))
    gate.onward_deg = onward_deg
    start = Place(from_deg, 60.0)
    begun(gate, start, Slew(-turn_deg % 360.0, 60.0))
    towards = -gate.rates_from(start, 0.0).ra_rate_deg_s
    assert math.copysign(1.0, towards) == math.copysign(1.0, turn_deg - from_deg)


def test_a_slew_of_a_mount_that_obeys_aborts_late_is_judged_with_the_longest_fault() -> None:
    """At 10 °/s it passes its end by 10 * (0.3 + 1) degrees, where the profile has a delay at all.

    By half a degree each it does as an abort brakes later and more gently than the slew itself.
    """
    for delay_s, past_deg in ((0.0, 1.0), (0.3, 14.0)):
        for more_deg, blocked_by in ((-0.2, "declination"), (0.2, None)):
            end_deg = 80.0 + past_deg + 0.1 + more_deg
            profile = replace(FREE, abort_delay_s=delay_s, dec_axis_limits_deg=(-90.0, end_deg))
            gate = slew_gate(profile)
            assert gate.objection(Slew(0.0, 80.0), 0.0, Place(0.0, 0.0)) == blocked_by
            assert gate.path_objection(Place(0.0, 0.0), (0.0, 80.0)) == blocked_by


def test_a_detour_is_taken_leg_by_leg_and_judged_anew_at_each() -> None:
    """A zone of the pier stands between start and goal, from the equator up to 60° of declination."""
    wall = PierZone("wall", ((-5.0, -20.0), (5.0, -20.0), (5.0, 60.0), (-5.0, 60.0)))
    profile = replace(FREE, pier_zones=(wall,), dec_axis_limits_deg=(-15.0, 89.0))
    start, target = Place(-40.0, 10.0), Slew(-40.0, 10.0)
    here = Box.between(start, start)
    assert slew_gate(profile).clear(target, 0.0, (40.0, 10.0), start, here, False) == "pier"
    gate = slew_gate(profile, detours=True)
    place, legs = start, []
    for _ in range(6):
        leg = gate.clear(target, 0.0, (-place[0], place[1]), place, Box.between(place, place), False)
        assert isinstance(leg, Slew)
        legs.append(leg)
        assert gate.on_last_leg == (leg == target)
        # Until it is there, the same is asked for.
        assert gate.clear(target, 0.0, (-place[0] + 1.0, place[1] + 5.0), place, here, False) == leg
        end = Place(math.remainder(-leg.ra_deg, 360.0), leg.dec_deg)
        assert not meets_polygon(Box.between(place, end), wall.corners)
        place = end
        if leg == target:
            break
    assert legs[-1] == target
    assert len(legs) >= 2


def test_a_detour_that_is_closed_on_the_way_ends_with_the_name_of_what_closes_it() -> None:
    wall = PierZone("wall", ((-5.0, -20.0), (5.0, -20.0), (5.0, 60.0), (-5.0, 60.0)))
    gate = slew_gate(replace(FREE, pier_zones=(wall,), dec_axis_limits_deg=(-15.0, 89.0)), detours=True)
    start, target = Place(-40.0, 10.0), Slew(-40.0, 10.0)
    leg = gate.clear(target, 0.0, (40.0, 10.0), start, Box.between(start, start), False)
    assert isinstance(leg, Slew)
    assert leg != target
    # What is reported is the end of the leg, but the axes are believed to be in the zone.
    inside = Place(0.0, 30.0)
    assert (
        gate.clear(target, 0.0, (leg.ra_deg, leg.dec_deg), inside, Box.between(inside, inside), False)
        == "pier"
    )


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_target_in_the_suns_cone_is_waited_for_on_its_own_side_of_the_sun(side: float) -> None:
    """Ten degrees from the Sun, as seen from the other side of it: the way there leads round the cone."""
    ha, dec = sun_place(T0)
    gate = slew_gate(detours=True, limits=replace(DARK, sun_cone_deg=15.0))
    start = Place(ha - side * 40.0, dec)
    target = Slew(-(ha + side * 10.0), dec)
    legs = gate.route(target, 0.0, start, waits=True)
    assert not isinstance(legs, str)
    ends = [start, *(Place(ha + math.remainder(-leg.ra_deg - ha, 360.0), leg.dec_deg) for leg in legs)]
    assert len(legs) >= 2
    assert separation_deg(*ends[-1], ha + side * 10.0, dec) < 7.0
    for one, other in pairwise(ends):
        assert nearest_deg(Box.between(one, other), ha, dec) >= 15.0
    assert gate.route(target, 0.0, start) == "sun"


LOW_WALL = PierZone("wall", ((-5.0, -20.0), (5.0, -20.0), (5.0, 20.0), (-5.0, 20.0)))


@pytest.mark.parametrize(("more_deg", "at_target"), [(-0.02, False), (0.02, True)])
@pytest.mark.parametrize("waits", [True, False])
def test_at_the_end_of_a_detour_the_mount_can_wait_for_seventy_seconds(
    more_deg: float, at_target: bool, waits: bool
) -> None:
    """It goes on with the sky there, besides the time that the slew takes."""
    profile = replace(
        FREE, pier_zones=(LOW_WALL,), dec_axis_limits_deg=(-15.0, 89.0), hour_angle_limit_deg=60.0
    )
    start = Place(-40.0, 10.0)
    # Both axes take no longer for this way than the hour angle does.
    drift_deg = SIDEREAL_RATE_DEG_S * (slew_s(start, Place(59.5, 10.0), profile) + 70.0)
    goal = Place(60.0 - 0.1 - drift_deg - more_deg, 10.0)
    target = Slew(-goal.ha_deg, goal.dec_deg)
    legs = slew_gate(profile, True).route(target, 0.0, start, waits)
    assert len(legs) >= 2
    assert not isinstance(legs, str)
    assert (legs[-1] == target) == (at_target or not waits)
    assert separation_deg(-legs[-1].ra_deg, legs[-1].dec_deg, *goal) < 1.5


@pytest.mark.parametrize(("room_deg", "at_target"), [(0.12, False), (0.22, True)])
@pytest.mark.parametrize(
    ("start", "edge", "inside"),
    [
        (Place(40.0, 10.0), Place(-60.0, 10.0), (1.0, 0.0)),
        (Place(-40.0, 10.0), Place(40.0, -15.0), (0.0, 1.0)),
        (Place(-40.0, 10.0), Place(40.0, 35.0), (0.0, -1.0)),
    ],
)
def test_at_an_end_from_which_the_sky_leads_away_the_mount_can_wait_where_no_abort_leads_past_it(
    start: Place, edge: Place, inside: tuple[float, float], room_deg: float, at_target: bool
) -> None:
    """From 0.1° before the limit, and the 0.1° by which the last of shorter slews may pass its end."""
    profile = MountProfile(
        hour_angle_limit_deg=60.0, dec_axis_limits_deg=(-15.0, 35.0), pier_zones=(LOW_WALL,)
    )
    goal = Place(edge[0] + room_deg * inside[0], edge[1] + room_deg * inside[1])
    target = Slew(-goal.ha_deg, goal.dec_deg)
    legs = slew_gate(profile, True).route(target, 0.0, start, waits=True)
    assert len(legs) >= 2
    assert not isinstance(legs, str)
    assert (legs[-1] == target) == at_target
    assert separation_deg(-legs[-1].ra_deg, legs[-1].dec_deg, *goal) < 0.7


@pytest.mark.parametrize("waits", [True, False])
@pytest.mark.parametrize("walled", [True, False])
def test_out_of_the_sun_a_slew_leads_by_the_nearest_way_and_on_where_there_is_one(
    walled: bool, waits: bool
) -> None:
    """From five degrees beside it, on the side away from the target; a wall may stand in every way there."""
    ha, dec = sun_place(T0)
    corners = ((ha - 45.0, -90.0), (ha - 40.0, -90.0), (ha - 40.0, 90.0), (ha - 45.0, 90.0))
    zones = (PierZone("wall", corners),) if walled else ()
    profile = MountProfile(hour_angle_limit_deg=100.0, dec_axis_limits_deg=(-89.0, 89.0), pier_zones=zones)
    gate = slew_gate(profile, detours=True, limits=replace(DARK, sun_cone_deg=15.0))
    start, target = Place(ha + 5.0, dec), Slew(-(ha - 60.0), dec)
    legs = gate.route(target, 0.0, start, waits)
    if walled and not waits:
        assert legs == "pier"
        return
    assert not isinstance(legs, str)
    ends = [start, *(Place(ha + math.remainder(-leg.ra_deg - ha, 360.0), leg.dec_deg) for leg in legs)]
    assert 15.1 < separation_deg(*ends[1], ha, dec) < 16.0
    assert min(nearest_deg(Box.between(*pair), ha, dec) for pair in pairwise(ends)) > 4.9
    assert len(ends) == 2 if walled else legs[-1] == target


def test_a_run_waits_beside_a_goal_rather_than_go_there_by_many_slews() -> None:
    """A way past a wall to the edge of two limits; by hand it is gone all the same."""
    profile = MountProfile(
        hour_angle_limit_deg=60.0, dec_axis_limits_deg=(-15.0, 35.0), pier_zones=(LOW_WALL,)
    )
    goal = Place(-59.78, 34.8)
    target = Slew(-goal.ha_deg, goal.dec_deg)
    waits, by_hand = (
        slew_gate(profile, True).route(target, 0.0, Place(40.0, 10.0), waits) for waits in (True, False)
    )
    assert len(by_hand) > 7
    assert by_hand[-1] == target
    assert not isinstance(waits, str)
    assert len(waits) <= 7
    assert separation_deg(-waits[-1].ra_deg, waits[-1].dec_deg, *goal) < 0.7


def drawn_request(seed: int) -> tuple[SlewGate, SafetyLimits, MountProfile, Place, Place]:
    """Return two places of an alt-azimuth mount between a skyline of 361 points, four zones and the Sun."""
    dice = random.Random(f"limits {seed}")
    waves = [(dice.uniform(0.0, 6.0), k, dice.uniform(0.0, 360.0)) for k in range(1, 12)]
    heights = [
        20.0
        + sum(size * math.sin(math.radians(k * z + at)) for size, k, at in waves)
        + dice.uniform(-1.0, 1.0)
        for z in range(361)
    ]
    heights[dice.randrange(360)] += 25.0
    horizon = tuple((float(z), min(60.0, max(0.0, height))) for z, height in enumerate(heights))
    zones = []
    for k in range(4):
        ha, dec, size = dice.uniform(-150.0, 150.0), dice.uniform(20.0, 70.0), dice.uniform(5.0, 40.0)
        turns = sorted(dice.uniform(0.0, 2.0 * math.pi) for _ in range(dice.randrange(3, 7)))
        corners = [(ha + size * math.cos(t), min(89.0, dec + 0.5 * size * math.sin(t))) for t in turns]
        zones.append(PierZone(f"zone {k}", tuple(corners), side="normal"))
    profile = MountProfile(
        geometry=AxisGeometry(0.0, 90.0),
        stands_at=SitePlace(LATITUDE_DEG, LONGITUDE_DEG),
        pier_zones=tuple(zones),
        dec_axis_limits_deg=(-5.0, 95.0),
        slew_path=dice.choice(["any", "together"]),
    )
    limits = SafetyLimits(horizon=horizon)
    found = bounds(profile, limits)
    gate = SlewGate(profile, found, found.horizon_latitude_deg, True)

    def free() -> Place:
        while True:
            place = Place(dice.uniform(-170.0, 170.0), dice.uniform(0.0, 88.0))
            if found.violated(Box.between(place, place), {}, 0.0) is None:
                return place

    start = free()
    goal = dice.choice([free(), Place(dice.uniform(-170.0, 170.0), dice.uniform(0.0, 88.0))])
    return gate, limits, profile, start, goal


def is_forbidden(places: Any, limits: SafetyLimits, profile: MountProfile) -> Any:
    """Tell of axis angles whether a limit forbids them, by vectors and the angles that corners subtend."""
    ha, dec = np.radians(places[:, 0]), np.radians(places[:, 1])
    east, north, up = -np.cos(dec) * np.sin(ha), -np.cos(dec) * np.cos(ha), np.sin(dec)
    azimuths, heights = zip(*limits.horizon, strict=True)
    azimuth = np.degrees(np.arctan2(east, north)) % 360.0
    forbidden = np.degrees(np.arcsin(up)) < np.interp(azimuth, azimuths, heights)
    h, d, p = (math.radians(x) for x in (*sun_place(T0), LATITUDE_DEG))
    sun = (
        -math.cos(d) * math.sin(h),
        math.cos(p) * math.sin(d) - math.sin(p) * math.cos(d) * math.cos(h),
        math.sin(p) * math.sin(d) + math.cos(p) * math.cos(d) * math.cos(h),
    )
    forbidden |= east * sun[0] + north * sun[1] + up * sun[2] > math.cos(math.radians(15.0))
    low, high = profile.dec_axis_limits_deg
    forbidden |= (places[:, 1] < low) | (places[:, 1] > high)
    forbidden |= np.abs(places[:, 0]) > profile.hour_angle_limit_deg
    here = places[:, 0] + 1j * places[:, 1]
    for zone, turn in product(profile.pier_zones, (-360.0, 0.0, 360.0)):
        corners = [complex(*corner) - turn - here for corner in zone.corners]
        turned = sum(np.angle(b / a) for a, b in zip(corners, [*corners[1:], corners[0]], strict=True))
        forbidden |= np.abs(turned) > math.pi
    return forbidden


def sampled(one: Any, other: Any, profile: MountProfile, wider_deg: float = 0.0) -> Any:
    """Return axis angles all over where a slew may lead, a bit more about it."""
    parts, w = np.linspace(0.0, 1.0, 81), wider_deg
    if profile.slew_path == "together":
        on_line = np.array(one) + parts[:, None] * (np.array(other) - np.array(one))
        return np.concatenate([on_line + np.array(by) for by in product((-w, 0.0, w), repeat=2)])
    ends = [(min(a, b) - w, max(a, b) + w) for a, b in zip(one, other, strict=True)]
    ha, dec = np.meshgrid(*(low + parts * (high - low) for low, high in ends))
    return np.column_stack([ha.ravel(), dec.ravel()])


@pytest.mark.parametrize("seeds", [range(12), range(12, 24), range(24, 36)])
def test_ways_lead_round_the_limits_as_dense_samples_of_them_tell(seeds: range) -> None:
    """What is led along is clear wherever it is sampled; what is clear with 3° to spare is gone straight."""
    seen = set()
    for seed in seeds:
        gate, limits, profile, start, goal = drawn_request(seed)
        legs = gate.route(Slew(-goal[0], goal[1]), 0.0, start)
        straight = not is_forbidden(sampled(start, goal, profile, 3.0), limits, profile).any()
        assert not straight or (not isinstance(legs, str) and len(legs) == 1)
        seen.add(legs if isinstance(legs, str) else "straight" if len(legs) == 1 else "round")
        place: tuple[float, float] = start
        for leg in () if isinstance(legs, str) else legs:
            end = (math.remainder(-leg.ra_deg, 360.0), leg.dec_deg)
            assert not is_forbidden(sampled(place, end, profile), limits, profile).any(), (seed, place, end)
            place = end
    assert {"straight", "round"} < seen


def test_many_places_are_judged_at_once_as_each_by_itself_and_by_vectors() -> None:
    """A place in a limit is closed, and one with 0.8° of room on every side is not."""
    rng, opens, closes = np.random.default_rng(5), 0, 0
    for seed in range(6):
        _, limits, profile, _, _ = drawn_request(seed)
        found = bounds(profile, limits)
        places = np.column_stack([rng.uniform(-220.0, 220.0, 700), rng.uniform(-10.0, 100.0, 700)])
        places[::3] = np.round(places[::3])
        closed = found.closed(places)
        one_by_one = [found.violated(Box.between(place, place), {}, 0.0) for place in places.tolist()]
        assert closed.tolist() == [name is not None for name in one_by_one]
        room = list(product(np.linspace(-0.8, 0.8, 11), repeat=2))
        near = np.any([is_forbidden(places + np.array(by), limits, profile) for by in room], axis=0)
        assert closed[is_forbidden(places, limits, profile)].all()
        assert not closed[~near].any()
        opens, closes = opens + int((~near).sum()), closes + int(closed.sum())
    assert min(opens, closes) > 500


def test_that_there_is_no_way_is_found_with_little_work(monkeypatch: pytest.MonkeyPatch) -> None:
    """Four zones stand round the goal. Each look at a box counts, for the floor, the skyline or the Sun."""
    looks, real = [0], Toward.nearest_deg

    def counted(self: Toward, box: Box) -> float:
        looks[0] += 1
        return real(self, box)

    monkeypatch.setattr(Toward, "nearest_deg", counted)
    for seed in range(12):
        _, limits, profile, start, _ = drawn_request(seed)
        ha = start[0] + (90.0 if start[0] < 0.0 else -90.0)
        zones = [
            PierZone("wall", tuple((ha + a, 65.0 + d) for a, d in corners))
            for corners in (
                ((-20.0, -16.0), (20.0, -16.0), (20.0, -10.0), (-20.0, -10.0)),
                ((-20.0, 10.0), (20.0, 10.0), (20.0, 16.0), (-20.0, 16.0)),
                ((-20.0, -16.0), (-12.0, -16.0), (-12.0, 16.0), (-20.0, 16.0)),
                ((12.0, -16.0), (20.0, -16.0), (20.0, 16.0), (12.0, 16.0)),
            )
        ]
        profile = replace(profile, pier_zones=tuple(zones))
        gate = SlewGate(profile, bounds(profile, limits), 90.0, True)
        looks[0] = 0
        assert isinstance(gate.route(Slew(-ha, 65.0), 0.0, start), str)
        assert looks[0] <= 2000
