"""What is remembered to be clear changes no verdict: a memory is held against none."""

from __future__ import annotations

import math
import random

import pytest

from sattrack.mount.model import MountProfile, PierZone
from sattrack.safety import SafetyLimits
from sattrack.safety.bounds import HOLD_MARGIN_DEG, TRY_EVERY, Bounds, ClearRoom, Memory
from sattrack.safety.geometry import Box
from sattrack.safety.regions import Floor, Region, Travel

NOON_UTC_S = 1_782_043_200.0  # 2026-06-21T12:00:00Z
LATITUDE_DEG, LONGITUDE_DEG = 52.0, 4.5
SKYLINE = ((0.0, 12.0), (90.0, 25.0), (180.0, 8.0), (270.0, 30.0))
ZONE = PierZone("pier", ((-20.0, 60.0), (20.0, 60.0), (20.0, 88.0), (-20.0, 88.0)))
LIMITS = SafetyLimits(floor_altitude_deg=10.0, horizon=SKYLINE)
PROFILE = MountProfile(pier_zones=(ZONE,))


@pytest.mark.parametrize("seed", range(4))
def test_a_stream_is_judged_as_if_nothing_were_remembered(seed: int) -> None:
    draw = random.Random(seed)
    remembering = Bounds(PROFILE, LIMITS, LATITUDE_DEG, LONGITUDE_DEG)
    ha, dec, found = draw.uniform(-60.0, 60.0), draw.uniform(0.0, 60.0), set()
    ha_rate, dec_rate = draw.uniform(-1.0, 1.0), draw.uniform(-1.0, 1.0)
    for tick in range(250):
        utc_s = NOON_UTC_S + tick * 0.05
        fresh = Bounds(PROFILE, LIMITS, LATITUDE_DEG, LONGITUDE_DEG)
        assert fresh.look(utc_s // 1.0, 0.0)
        assert remembering.look(utc_s // 1.0, 0.0)
        ha, dec = ha + ha_rate, dec + dec_rate
        if draw.random() < 0.02 or not -85.0 < dec < 90.0:
            ha_rate, dec_rate = draw.uniform(-1.0, 1.0), draw.uniform(-1.0, 1.0) - math.copysign(0.5, dec)
        box = Box(ha, ha + draw.uniform(0.0, 3.0), dec, dec + draw.uniform(0.0, 3.0))
        margin = draw.choice((HOLD_MARGIN_DEG, HOLD_MARGIN_DEG, 0.01, 1.5))
        margins = draw.choice(({}, {}, {}, {"altitude": -1.0}))
        judged = remembering.violated(box, margins, 0.5, margin)
        assert judged == fresh.violated(box, margins, 0.5, margin)
        found.add(judged)
    assert None in found
    assert len(found) > 1


def test_a_cone_that_has_moved_is_looked_at_anew() -> None:
    """The Sun goes 15° an hour: where it stands an hour later was clear, and is not."""
    bounds = Bounds(MountProfile(), SafetyLimits(), LATITUDE_DEG, LONGITUDE_DEG)
    ahead = Box(31.0, 31.0, 23.4, 23.4)
    judged = []
    for minute in range(0, 121, 10):
        assert bounds.look(NOON_UTC_S + 60.0 * minute, 0.0)
        judged.append(bounds.violated(ahead, {}, 0.0))
    assert judged[0] is None
    assert "sun" in judged


def test_room_holds_what_lies_within_it_by_no_larger_margin() -> None:
    room = ClearRoom()
    wide: list[Region] = [Travel("hour_angle", -100.0, 100.0), Floor(0.0, LATITUDE_DEG)]
    here = Box(0.0, 1.0, 30.0, 31.0)
    assert not room.holds(here, 0.1)
    room.widen(wide, here, 0.1)
    assert room.holds(here, 0.1)
    assert room.holds(Box(-3.9, 4.9, 26.1, 34.9), 0.05)
    for outside in (
        Box(-4.1, 1.0, 30.0, 31.0),
        Box(0.0, 5.1, 30.0, 31.0),
        Box(0.0, 1.0, 25.9, 31.0),
        Box(0.0, 1.0, 30.0, 35.1),
    ):
        assert not room.holds(outside, 0.1)
    assert not room.holds(here, 0.2)
    room.forget()
    assert not room.holds(here, 0.1)


def test_where_there_is_no_room_it_is_not_looked_for_every_time() -> None:
    asked = []

    class Wall(Travel):
        def clearance(self, box: Box):  # type: ignore[no-untyped-def]
            asked.append(box)
            return super().clearance(box)

    room = ClearRoom()
    for _ in range(1 + TRY_EVERY):
        room.widen([Wall("hour_angle", -1.0, 1.0)], Box(0.0, 0.5, 0.0, 0.0), 0.1)
    assert len(asked) == 1
    room.widen([Wall("hour_angle", -10.0, 10.0)], Box(0.0, 0.5, 0.0, 0.0), 0.1)
    assert len(asked) == 2
    assert room.holds(Box(0.0, 0.5, 0.0, 0.0), 0.1)


@pytest.mark.parametrize(
    ("wall_deg", "floor_deg", "times"), [(40.0, 0.0, 1), (13.0, 0.0, 3), (13.0, 36.5, 20)]
)
def test_a_region_is_asked_seldom_on_a_way_where_there_is_room(
    wall_deg: float, floor_deg: float, times: int
) -> None:
    """From all of them by four degrees, or else from it alone by one: so wide is the way that was cleared."""
    asked: list[Box] = []

    class Ground(Floor):
        def is_clear(self, box: Box, margin_deg: float) -> bool:
            asked.append(box)
            return super().is_clear(box, margin_deg)

    memory = Memory([Travel("hour_angle", -wall_deg, wall_deg), Ground(floor_deg, LATITUDE_DEG)])
    for k in range(20):
        here = Box(9.9 + 0.15 * k, 9.9 + 0.15 * k, 0.0, 0.0)
        assert memory.violated(here, {}, 0.01) is None
    assert len(asked) == times
