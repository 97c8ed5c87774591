"""Ways of slews in closed form: how long they take, what they sweep, and where to wait."""

from __future__ import annotations

import math
import random
from functools import partial
from itertools import pairwise, product
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from msgspec.structs import replace

from sattrack.core.angles import separation_deg
from sattrack.mount.geometry import AxisGeometry
from sattrack.mount.model import SIDEREAL_RATE_DEG_S, AxisLimits, MountProfile, SitePlace
from sattrack.safety.geometry import Box, Place, nearest_deg
from sattrack.safety.route import (
    Route,
    _closed,
    _Grid,
    blocked,
    clear_places,
    direction_of,
    find_route,
    leg_s,
    overshoot_deg,
    path_boxes,
    reachable,
    slew_s,
)

if TYPE_CHECKING:
    from collections.abc import Callable

PROFILE = MountProfile(
    ra=AxisLimits(slew_rate_deg_s=5.0, max_acceleration_deg_s2=10.0),
    dec=AxisLimits(slew_rate_deg_s=4.0, max_acceleration_deg_s2=2.0),
)
HERE = Place(-10.0, 20.0)


def free(box: Box, seconds: float) -> str | None:
    del box, seconds
    return None


@pytest.mark.parametrize(
    ("there", "seconds"),
    [
        # 2 s of handshake; the way; ramps one and a half times as long as they need be, at either end.
        (Place(40.0, 20.0), 2.0 + 50.0 / 5.0 + 2.0 * 1.5 * 5.0 / 10.0),
        (Place(-60.0, 20.0), 2.0 + 50.0 / 5.0 + 2.0 * 1.5 * 5.0 / 10.0),
        (Place(-10.0, -10.0), 2.0 + 30.0 / 4.0 + 2.0 * 1.5 * 4.0 / 2.0),
        (Place(40.0, 50.0), 2.0 + 30.0 / 4.0 + 2.0 * 1.5 * 4.0 / 2.0),
    ],
)
def test_a_slew_takes_as_long_as_its_slower_axis(there: Place, seconds: float) -> None:
    assert slew_s(HERE, there, PROFILE) == pytest.approx(seconds)


def test_one_more_slew_takes_as_long_as_the_rate_that_it_reaches_and_no_longer_than_any() -> None:
    assert leg_s(HERE, Place(40.0, 20.0), PROFILE) == slew_s(HERE, Place(40.0, 20.0), PROFILE)
    # 0.1° at 10 °/s² come to 1 °/s, 0.5° at 2 °/s² too; ramps are one and a half times as long as need be.
    assert leg_s(HERE, Place(-9.9, 20.0), PROFILE) == pytest.approx(2.0 + 0.1 / 5.0 + 3.0 / 10.0)
    assert leg_s(HERE, Place(-10.0, 20.5), PROFILE) == pytest.approx(2.0 + 0.5 / 4.0 + 3.0 / 2.0)
    assert leg_s(HERE, HERE, PROFILE) == 2.0


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_an_aborted_slew_goes_on_at_the_rate_that_its_way_lets_it_reach(sense: float) -> None:
    """Over 0.5° an axis of 10 °/s² gets to 3.16 °/s and one of 2 °/s² to 1.41 °/s.

    Braking that builds up anew takes 0.05 s longer, and is a tenth gentler. Rates lead gently as it is.
    """
    led = replace(PROFILE, geometry=AxisGeometry(0.0, 90.0), stands_at=SitePlace(52.0, 4.5))
    for gap, ha, dec in ((0.5, math.sqrt(10.0), math.sqrt(2.0)), (50.0, 5.0, 4.0)):
        there = Place(HERE[0] + sense * gap, HERE[1] - sense * gap)
        for delay_s in (0.0, 0.3):
            late = sense * ha * delay_s, -sense * dec * delay_s
            known, free_of = (replace(one, abort_delay_s=delay_s) for one in (PROFILE, led))
            later = 0.05 * ha + 0.1 * ha**2 / 20.0, 0.05 * dec + 0.1 * dec**2 / 4.0
            assert overshoot_deg(HERE, there, known) == pytest.approx(
                (late[0] + sense * later[0], late[1] - sense * later[1])
            )
            assert overshoot_deg(HERE, there, free_of) == pytest.approx(late)
            assert overshoot_deg(HERE, there, known, with_late_brake=False) == pytest.approx(late)
    assert overshoot_deg(HERE, HERE, PROFILE) == (0.0, 0.0)


@pytest.mark.parametrize("there", [Place(40.0, 50.0), Place(-60.0, -10.0)])
@pytest.mark.parametrize("abort_delay_s", [0.0, 0.3])
def test_a_slew_sweeps_all_between_its_ends_what_the_sky_moves_and_what_an_abort_lets_pass(
    there: Place, abort_delay_s: float
) -> None:
    profile = replace(PROFILE, abort_delay_s=abort_delay_s)
    drift = SIDEREAL_RATE_DEG_S * slew_s(HERE, there, PROFILE)
    past = 5.0 * abort_delay_s + 0.375, 4.0 * abort_delay_s + 0.6
    up, down = (1.0, 0.0) if there[0] > HERE[0] else (0.0, 1.0)
    ends = (
        min(HERE[0], there[0]) - past[0] * down,
        max(HERE[0], there[0]) + past[0] * up + drift,
        min(HERE[1], there[1]) - past[1] * down,
        max(HERE[1], there[1]) + past[1] * up,
    )
    (whole,) = path_boxes(HERE, there, profile)
    assert tuple(whole) == pytest.approx(ends)
    parts = list(path_boxes(HERE, there, replace(profile, slew_path="together")))
    assert len(parts) == 24
    for k, part in enumerate(parts):
        for at in (k / 24.0, (k + 1) / 24.0):
            ha, dec = (a + at * (b - a) for a, b in zip(HERE, there, strict=True))
            assert part.ha_low_deg - 1e-9 <= ha <= part.ha_high_deg + 1e-9
            assert part.dec_low_deg - 1e-9 <= dec <= part.dec_high_deg + 1e-9
        assert part.ha_high_deg - part.ha_low_deg == pytest.approx(50.0 / 24.0 + drift + past[0])
        assert part.dec_high_deg - part.dec_low_deg == pytest.approx(30.0 / 24.0 + past[1])


def test_a_way_is_judged_until_its_end() -> None:
    there, asked = Place(40.0, 20.0), []

    def judge(box: Box, seconds: float) -> str | None:
        asked.append((box, seconds))
        return "sun" if seconds > 20.0 else None

    assert blocked(HERE, there, PROFILE, judge) is None
    assert blocked(HERE, there, PROFILE, judge, 6.4) is None
    assert blocked(HERE, there, PROFILE, judge, 6.6) == "sun"
    assert [seconds for _, seconds in asked] == pytest.approx([13.5, 19.9, 20.1])
    assert {box for box, _ in asked} == set(path_boxes(HERE, there, PROFILE))


def test_a_free_way_is_straight_and_a_goal_that_is_not_free_has_none() -> None:
    goal = Place(40.0, 20.0)
    assert find_route(HERE, goal, PROFILE, free, free, 52.0) == Route((goal,))

    def goal_closes(box: Box, seconds: float) -> str | None:
        return "moon" if seconds >= 13.4 and box.ha_high_deg >= 40.0 else None

    assert find_route(HERE, goal, PROFILE, goal_closes, goal_closes, 52.0) == Route((), "moon")


def walled(box: Box) -> bool:
    """A wall on the meridian from the south up to 35° of declination."""
    return box.ha_low_deg <= 0.0 <= box.ha_high_deg and box.dec_low_deg <= 35.0


@pytest.mark.parametrize("latitude_deg", [52.0])
def test_a_detour_is_judged_leg_by_leg_each_from_when_it_begins(latitude_deg: float) -> None:
    start, goal, asked = Place(-30.0, 0.0), Place(30.0, 0.0), []

    def judge(box: Box, seconds: float) -> str | None:
        asked.append((box, seconds))
        return "horizon" if walled(box) else None

    def leaving(box: Box, _: float) -> str | None:
        return "horizon" if walled(box) else None

    route = find_route(start, goal, PROFILE, judge, leaving, latitude_deg)
    assert route.blocked_by is None
    assert route.legs[-1] == goal
    ways = list(pairwise((start, *route.legs)))
    assert not any(walled(box) for one, other in ways for box in path_boxes(one, other, PROFILE))
    begins_s = np.cumsum([slew_s(one, other, PROFILE) for one, other in ways])
    for (one, other), until_s in list(zip(ways, begins_s, strict=True))[1:]:
        boxes = set(path_boxes(one, other, PROFILE))
        assert [s for box, s in asked if box in boxes][-1] == pytest.approx(until_s)
    # No place of the grid gets there sooner by one leg: 36° is the lowest that clears the wall.
    best = (
        min(
            slew_s(start, via, PROFILE) + slew_s(via, goal, PROFILE)
            for via in reachable(PROFILE, latitude_deg)
            if not any(
                walled(box) for a, b in ((start, via), (via, goal)) for box in path_boxes(a, b, PROFILE)
            )
        )
        if len(ways) == 2
        else math.inf
    )
    assert begins_s[-1] <= best + 1e-9


def test_past_a_pillar_close_by_one_axis_turns_at_a_time() -> None:
    """Pillars stand on either side of a gap that is too narrow for both axes at once."""
    start, goal = Place(0.0, 0.0), Place(12.0, 12.0)

    def judge(box: Box, seconds: float) -> str | None:
        del seconds
        apart = box.ha_high_deg - box.ha_low_deg, box.dec_high_deg - box.dec_low_deg
        return "pier" if min(apart) > 0.5 else None

    route = find_route(start, goal, PROFILE, judge, judge, 52.0)
    assert route.blocked_by is None
    steps = [(b[0] - a[0], b[1] - a[1]) for a, b in pairwise((start, *route.legs))]
    assert all((ha == 0.0) != (dec == 0.0) for ha, dec in steps)
    assert all((one[0] == 0.0) != (other[0] == 0.0) for one, other in pairwise(steps)), (
        "it turns at each place"
    )
    assert np.abs(steps).sum(axis=0).tolist() == [12.0, 12.0], "there is no shorter way"


def turns(start: Place, route: Route) -> tuple[Place, ...]:
    """Return where a way by single axes turns: not where it only draws nearer by a shorter slew."""

    def heading(one: Place, other: Place) -> tuple[float, float]:
        return float(np.sign(other[0] - one[0])), float(np.sign(other[1] - one[1]))

    ways = [heading(one, other) for one, other in pairwise((start, *route.legs))]
    return tuple(place for k, place in enumerate(route.legs) if k + 1 == len(ways) or ways[k] != ways[k + 1])


@pytest.mark.parametrize(
    ("room_deg", "short_deg"),
    [
        (0.02, None),
        (0.03, (0.6, 0.1375, 0.0508, 0.0)),
        (0.1, (0.6, 0.1375, 0.0)),
        (0.3, (0.6, 0.0)),
        (0.65, (0.0,)),
    ],
)
@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_to_the_brink_lead_slews_that_get_shorter_until_no_abort_leads_over_it(
    sense: float, room_deg: float, short_deg: tuple[float, ...] | None
) -> None:
    """4 °/s and 2 °/s² lead 0.6° past an end; 0.6° of way 0.14°, those 0.05°, and those 0.03°."""
    start, goal = Place(10.0, -sense * 20.0), Place(10.0, sense * 20.0)

    def judge(box: Box, _: float) -> str | None:
        highest = box.dec_high_deg if sense > 0.0 else -box.dec_low_deg
        return "declination" if highest > 20.0 + room_deg else None

    found = find_route(start, goal, PROFILE, judge, judge, 52.0)
    if short_deg is None:
        assert found == Route((), "declination")
    else:
        assert found.blocked_by is None
        assert [20.0 - sense * leg.dec_deg for leg in found.legs] == pytest.approx(short_deg, abs=1e-4)
        assert {leg.ha_deg for leg in found.legs} == {10.0}


def in_corridors(start: Place, *ways: tuple[Place, ...]) -> Callable[[Box, float], str | None]:
    """Return what lets through where a way from a start leads, a degree wide, and nowhere else."""
    parts = [
        Box.between(one, other).grown(0.5, 0.5, 0.5, 0.5)
        for legs in ways
        for one, other in pairwise((start, *legs))
    ]
    return lambda box, _: None if any(part.with_box(box) == part for part in parts) else "horizon"


@pytest.mark.parametrize("west", [1.0, -1.0])
@pytest.mark.parametrize("north", [1.0, -1.0])
@pytest.mark.parametrize("far", [24.0, -24.0, 36.0])
def test_a_way_through_a_corridor_turns_where_the_corridor_does(
    west: float, north: float, far: float
) -> None:
    """Along the equator at first, then by 24° of declination, then back; a degree wide."""
    start, goal = Place(0.0, 0.0), Place(12.0 * west, 24.0 * north)
    corners = (Place(far * west, 0.0), Place(far * west, 24.0 * north), goal)
    judge = in_corridors(start, corners)
    assert turns(start, find_route(start, goal, PROFILE, judge, judge, 52.0)) == corners
    back = (*reversed(corners[:-1]), start)
    assert turns(goal, find_route(goal, start, PROFILE, judge, judge, 52.0)) == back


@pytest.mark.parametrize("west", [1.0, -1.0])
def test_of_two_corridors_the_quicker_is_taken(west: float) -> None:
    """By 24° along the equator and back for 12°, or by 6° the other way and back for 18°."""
    start, goal = Place(0.0, 0.0), Place(12.0 * west, 24.0)
    ways = [(Place(ha * west, 0.0), Place(ha * west, 24.0), goal) for ha in (24.0, -6.0)]
    judge = in_corridors(start, *ways)
    assert turns(start, find_route(start, goal, PROFILE, judge, judge, 52.0)) == ways[1]


@pytest.mark.parametrize(("ra_deg_s", "taken"), [(5.0, "shorter"), (1.0, "longer")])
def test_the_longer_corridor_is_the_quicker_where_it_leads_by_the_faster_axis(
    ra_deg_s: float, taken: str
) -> None:
    start, goal = Place(0.0, 0.0), Place(12.0, 12.0)
    ways = {
        "longer": (Place(0.0, 24.0), Place(12.0, 24.0), goal),
        "shorter": (Place(18.0, 0.0), Place(18.0, 12.0), goal),
    }
    judge = in_corridors(start, *ways.values())
    profile = MountProfile(
        ra=AxisLimits(slew_rate_deg_s=ra_deg_s), dec=AxisLimits(max_rate_deg_s=5.0, slew_rate_deg_s=5.0)
    )
    assert turns(start, find_route(start, goal, profile, judge, judge, 52.0)) == ways[taken]


def test_where_every_way_is_closed_the_straight_ones_row_is_named() -> None:
    start, goal = Place(0.0, 0.0), Place(12.0, 12.0)

    def judge(box: Box, seconds: float) -> str | None:
        del seconds
        return "altitude" if box.widest_deg > 0.5 else None

    assert find_route(start, goal, PROFILE, judge, lambda *_: "sun", 52.0) == Route((), "sun")


@pytest.mark.parametrize("pier_rule", ["never", "hour_angle"])
def test_no_direction_is_far_from_a_place_that_can_be_reached(pier_rule: str) -> None:
    """Twelve degrees apart, half of that either way at the most: 8.5° on the sky."""
    axes = reachable(MountProfile(pier_rule=pier_rule), 52.0)
    assert all(abs(one.ha_deg) <= 180.0 and -90.0 <= one.dec_deg <= 270.0 for one in axes)
    assert pier_rule != "never" or all(one.dec_deg <= 90.0 for one in axes)
    places = [direction_of(one) for one in axes]
    rng = random.Random(2)
    for _ in range(100):
        ha, dec = rng.uniform(-180.0, 180.0), rng.uniform(-84.0, 90.0)
        assert min(separation_deg(ha, dec, *place) for place in places) <= math.hypot(6.0, 6.0)


@pytest.mark.parametrize("goal", [Place(10.0, 0.0), Place(10.0, 60.0), Place(-40.0, -35.0)])
@pytest.mark.parametrize("radius_deg", [0.0, 0.9, 5.0, 33.0])
def test_places_to_wait_at_come_in_rings_the_nearest_first_each_as_near_as_there_is_room(
    goal: Place, radius_deg: float
) -> None:
    """Beside a circle, a place keeps a quarter of a degree; it is looked for to 0.3°, from 0.6° on."""

    def judge(box: Box, seconds: float) -> str | None:
        sides_deg = box.dec_high_deg - box.dec_low_deg, box.ha_high_deg - box.ha_low_deg
        assert (seconds, *sides_deg) == pytest.approx((0.0, 0.5, 0.75))
        return "sun" if nearest_deg(box, *goal) < radius_deg else None

    found = []
    for place in clear_places(goal, 52.0, MountProfile(), judge):
        found.append(separation_deg(*place, *goal))
        if len(found) == 24:
            break
    assert min(found) >= radius_deg
    if radius_deg <= 5.0:
        assert found[0] <= max(0.6, radius_deg + 1.1)
        assert max(found) <= max(0.6, radius_deg * 1.05 + 1.1)
    else:
        assert found[0] <= radius_deg * 1.2


def round_hole(box: Box, seconds: float) -> str | None:
    assert box.widest_deg == seconds == 0.0
    return "pier" if math.hypot(box.ha_low_deg, box.dec_low_deg) < 20.0 else None


def test_the_coarse_grid_knows_of_each_box_whether_it_holds_a_closed_cell() -> None:
    """Cells of four degrees from four below the least angles on, closed where their middle is.

    Cells that are less than eight degrees from an end on both axes are left to the judge.
    """
    start, goal = Place(-13.0, -18.0), Place(17.0, 9.0)
    low = (-64.0, -64.0)
    grid = _Grid(
        [Place(-60.0, 60.0), Place(100.0, -60.0)], start, goal, PROFILE, partial(_closed, round_hole)
    )

    def closed(i: int, j: int) -> bool:
        middle = low[0] + 4.0 * i + 2.0, low[1] + 4.0 * j + 2.0
        near = any(max(abs(a - b) for a, b in zip(middle, end, strict=True)) < 8.0 for end in ends)
        return math.hypot(*middle) < 20.0 and not near

    rng, seen, ends = random.Random(3), set(), (start, goal)
    for _ in range(600):
        one = Place(rng.uniform(-60.0, 100.0), rng.uniform(-60.0, 60.0))
        other = Place(one[0] + rng.uniform(-9.0, 9.0), one[1] + rng.uniform(-9.0, 9.0))
        if rng.random() < 0.5:
            other = Place(rng.uniform(-60.0, 100.0), rng.uniform(-60.0, 60.0))
        box = Box.between(one, Place(*(max(-60.0, min(60.0, x)) for x in other)))
        columns = range(int((box[0] - low[0]) // 4.0), int((box[1] - low[0]) // 4.0) + 1)
        rows = range(int((box[2] - low[1]) // 4.0), int((box[3] - low[1]) // 4.0) + 1)
        is_open = not any(closed(i, j) for i in columns for j in rows)
        places = np.array([[box[0], box[3]], [box[1], box[2]]])
        assert bool(grid._open(*places)) == is_open
        seen.add(is_open)
    assert seen == {True, False}


def test_ways_by_one_place_come_first_and_then_by_two_the_quickest_first() -> None:
    start, goal = Place(-100.0, -60.0), Place(100.0, 60.0)
    nodes = [Place(*place) for place in ((-60.0, 60.0), (70.0, -40.0), (-90.0, 10.0), (85.0, 30.0))]

    def seconds(*places: Place) -> float:
        legs = pairwise((start, *places, goal))
        return sum(2.0 + max(abs(a[0] - b[0]) / 5.0, abs(a[1] - b[1]) / 4.0) for a, b in legs)

    ways = list(_Grid(nodes, start, goal, PROFILE, partial(_closed, free)).ways())
    assert ways == [
        *((one, goal) for one in sorted(nodes, key=seconds)),
        *((*two, goal) for two in sorted(product(nodes, nodes), key=lambda two: seconds(*two))),
    ]
    # Past the hole lead those only of which every leg does: not by the last two alone.
    ways = list(_Grid(nodes, start, goal, PROFILE, partial(_closed, round_hole)).ways())
    assert [way for way in ways if len(way) == 2] == [(nodes[1], goal), (nodes[0], goal)]
    assert (nodes[2], nodes[0], goal) in ways
    assert (nodes[1], nodes[3], goal) in ways
    assert (nodes[2], nodes[3], goal) not in ways
    # So many of either are worth a look.
    every = list(_Grid(reachable(PROFILE, 52.0), start, goal, PROFILE, partial(_closed, free)).ways())
    assert [len(way) for way in every] == [2] * 40 + [3] * 40
    assert list(_Grid([], start, goal, PROFILE, partial(_closed, free)).ways()) == []


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize(
    "beside_deg", [sense * deg for sense in (1.0, -1.0) for deg in (3.0, 6.0, 12.0, 24.0)]
)
def test_past_a_pillar_a_way_leads_close_by_on_either_side(axis: int, beside_deg: float) -> None:
    """Half a degree of room is enough, 3°, 6°, 12° and 24° beside the straight way."""
    ends = [(0.0, 0.0), (0.0, beside_deg), (50.0, beside_deg), (50.0, 0.0)]
    corners = [Place(*(end if axis == 0 else end[::-1])) for end in ends]
    corridor = [Box.between(*pair).grown(0.5, 0.5, 0.5, 0.5) for pair in pairwise(corners)]

    def judge(box: Box, seconds: float) -> str | None:
        del seconds
        return None if any(part.with_box(box) == part for part in corridor) else "pier"

    found = find_route(corners[0], corners[-1], PROFILE, judge, judge, 52.0)
    assert turns(corners[0], found) == tuple(corners[1:])


@pytest.mark.parametrize("pier_rule", ["never", "hour_angle"])
@pytest.mark.parametrize("by_deg", [-24.0, 24.0])
def test_a_way_turns_only_where_a_slew_can_end(by_deg: float, pier_rule: Any) -> None:
    """By the hour angle's rule a mount stands beyond the pole in the west, and not in this corridor."""
    corners = [Place(-10.0 + ha, dec) for ha, dec in ((0.0, 0.0), (by_deg, 0.0), (by_deg, 24.0), (0.0, 24.0))]
    corridor = [Box.between(*pair).grown(0.5, 0.5, 0.5, 0.5) for pair in pairwise(corners)]

    def judge(box: Box, seconds: float) -> str | None:
        del seconds
        return None if any(part.with_box(box) == part for part in corridor) else "pier"

    route = find_route(corners[0], corners[-1], replace(PROFILE, pier_rule=pier_rule), judge, judge, 52.0)
    ends = pier_rule == "never" or by_deg < 0.0
    assert turns(corners[0], route) == (tuple(corners[1:]) if ends else ())
    assert route.blocked_by == (None if ends else "pier")
