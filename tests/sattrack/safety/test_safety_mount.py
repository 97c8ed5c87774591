"""Every limit against a mount that is driven at it: the true axes never pass it, with and without faults."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import erfa
import msgspec
import pytest
from driven_limits import (
    DARK,
    LATENCY_S,
    ROWS,
    SUN_DEC,
    SUN_HA,
    SUN_WEST_HA,
    altitude,
    flown,
    from_sun,
    nearest,
)
from safety_stand import LONGITUDE_DEG, NEVER, T0, Stand, axis_speed_deg_s, steadily

from sattrack.mount.model import SIDEREAL_RATE_DEG_S, AxisLimits, Hold, MountProfile, MoveAxes, Slew
from sattrack.mount.simulator.mount import StartPosition
from sattrack.safety import SafetyLimits, bounds
from sattrack.safety.rate_limit import standstill_s

if TYPE_CHECKING:
    from sattrack.mount.model import Motion


@pytest.mark.parametrize("name", ROWS)
@pytest.mark.parametrize(
    "begin_s", [2.5, 3.2, 4.0, *(pytest.param(begin_s, marks=pytest.mark.soak) for begin_s in (1.0, 6.0))]
)
@pytest.mark.parametrize("way", ["deaf", "silent", "cut"])
def test_the_longest_fault_at_any_time_passes_no_limit(name: str, begin_s: float, way: str) -> None:
    span = (begin_s, begin_s + 1.0)
    deaf, silent = NEVER if way == "silent" else span, NEVER if way == "deaf" else span
    stand = flown(name, deaf=deaf, silent=silent, seconds=begin_s + 6.0)
    assert nearest(name, stand) >= 0.0


@pytest.mark.parametrize("name", ROWS)
def test_without_its_row_each_limit_is_passed(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = bounds.fixed_regions
    monkeypatch.setattr(
        bounds, "fixed_regions", lambda *a: [region for region in whole(*a) if region.name != name]
    )
    if name == "sun":
        monkeypatch.setattr(bounds.Bounds, "look", lambda *_: True)
    assert nearest(name, flown(name)) < 0.0


def test_without_the_longest_fault_a_limit_is_passed_when_commands_are_lost() -> None:
    stand = ROWS["hour_angle"][0]
    careless = msgspec.structs.replace(stand.limits, longest_fault_s=0.0)
    lost = replace(stand, limits=careless, truths=[], sent=[], deaf=(5.4, 6.9)).run(12.0)
    assert nearest("hour_angle", lost) < 0.0


@pytest.mark.parametrize("rate", [0.5, 3.0, 6.0])
@pytest.mark.parametrize("lost_s", [0.0, 1.0])
def test_a_stop_stands_within_its_promise(rate: float, lost_s: float) -> None:
    """By hand the limit stops the mount: abort, axes at rest; lost datagrams come on top."""
    stand = Stand(steadily(rate, 0.0), DARK, StartPosition(40.0 - 8.0 * rate, 40.0), holds=False)
    stand.profile = MountProfile(hour_angle_limit_deg=40.0)
    stand = replace(stand, real=MountProfile())
    probe = replace(stand, truths=[], sent=[]).run(12.0)
    assert probe.safety.tripped == "hour_angle"
    assert probe.met_s is not None
    cut = (probe.met_s, probe.met_s + lost_s)
    stopped = replace(stand, truths=[], sent=[], deaf=cut).run(12.0)
    assert stopped.standstill_s <= standstill_s(rate, LATENCY_S, 10.0) + lost_s
    assert max(truth.hour_angle_axis_deg for _, truth in stopped.truths) <= 40.0


def across_the_sun() -> tuple[Stand, Slew]:
    """A slew from one side of the Sun to the other at its declination: its straight way leads through it."""
    ha = (SUN_HA + 180.0) % 360.0 - 180.0
    start = StartPosition(ha - 40.0, SUN_DEC + 2.0)
    sidereal = math.degrees(erfa.gmst82(2440587.5, T0 / 86400.0)) + LONGITUDE_DEG
    target = Slew((sidereal - (ha + 30.0)) % 360.0, SUN_DEC + 2.0)
    return Stand(lambda _: target, SafetyLimits(), start), target


def test_a_slew_across_the_sun_goes_round_it_and_arrives() -> None:
    stand, target = across_the_sun()
    stand.run(60.0)
    assert stand.safety.tripped is None
    assert min(from_sun(truth, t) for t, truth in stand.truths) >= 15.0
    last = stand.truths[-1][1]
    assert abs(math.remainder(last.ra_deg - target.ra_deg, 360.0)) < 0.01
    assert abs(last.dec_deg - target.dec_deg) < 0.01


def test_the_same_slew_without_optics_goes_straight_through() -> None:
    stand, _ = across_the_sun()
    straight = replace(stand, limits=DARK, truths=[], sent=[]).run(30.0)
    assert min(from_sun(truth, t) for t, truth in straight.truths) < 5.0


def test_by_hand_a_slew_across_the_sun_never_begins() -> None:
    stand, _ = across_the_sun()
    refused = replace(stand, holds=False, truths=[], sent=[]).run(10.0)
    assert refused.safety.tripped == "sun"
    assert min(from_sun(truth, t) for t, truth in refused.truths) > 30.0


def test_a_target_inside_the_cone_is_waited_for_beside_it() -> None:
    ha = (SUN_HA + 180.0) % 360.0 - 180.0
    sidereal = math.degrees(erfa.gmst82(2440587.5, T0 / 86400.0)) + LONGITUDE_DEG
    target = Slew((sidereal - ha - 5.0) % 360.0, SUN_DEC)
    stand = Stand(lambda _: target, SafetyLimits(), StartPosition(ha - 60.0, SUN_DEC + 10.0)).run(60.0)
    assert stand.safety.tripped is None
    assert stand.safety.on_last_leg
    assert min(from_sun(truth, t) for t, truth in stand.truths) >= 15.0
    assert from_sun(stand.truths[-1][1], 60.0) < 20.0


def test_axes_held_beside_the_sun_give_way_as_it_comes() -> None:
    """West of the telescope's way the Sun moves on; east of it, it comes nearer by 15° an hour."""
    ha = (SUN_HA + 180.0) % 360.0 - 180.0
    # A wish to stay where the axes are, 15.2° west of the Sun: it arrives there in half a minute.
    stand = Stand(steadily(0.0, 0.0), SafetyLimits(), StartPosition(ha + 15.2, SUN_DEC)).run(100.0)
    assert stand.safety.tripped is None
    assert min(from_sun(truth, t) for t, truth in stand.truths) >= 15.0
    assert stand.truths[-1][1].hour_angle_axis_deg > ha + 15.4


@pytest.mark.parametrize("beside_deg", [0.08, 0.12, 0.15, 0.2, 0.3])
@pytest.mark.parametrize("north", [15.0, 40.0])
def test_a_slew_away_begins_however_little_more_than_its_margin_a_mount_stands_from_the_sun(
    beside_deg: float, north: float
) -> None:
    """East of the Sun, which comes no nearer: what a slew takes counts from where the mount stands."""
    sidereal = math.degrees(erfa.gmst82(2440587.5, T0 / 86400.0)) + LONGITUDE_DEG
    sun_dec, apart = math.radians(SUN_DEC), math.radians(15.0 + SIDEREAL_RATE_DEG_S + beside_deg)
    # Where the hour circle comes nearest to the Sun: along it, every way leads away.
    turn = math.asin(math.sin(apart) / math.cos(sun_dec))
    ha, dec = SUN_WEST_HA - math.degrees(turn), math.degrees(math.atan(math.tan(sun_dec) / math.cos(turn)))
    target = Slew((sidereal - ha + 1.0) % 360.0, dec + north)
    stand = Stand(lambda _: target, SafetyLimits(), StartPosition(ha, dec)).run(20.0)
    assert stand.safety.tripped is None
    assert stand.sent[0] == target
    assert min(from_sun(truth, t) for t, truth in stand.truths) >= 15.0
    assert stand.truths[-1][1].dec_deg == pytest.approx(target.dec_deg, abs=0.01)


@pytest.mark.parametrize("beside_deg", [0.05, 0.11, 0.13, 0.3])
def test_a_slew_away_from_the_end_of_the_travel_begins_beside_it(beside_deg: float) -> None:
    profile = MountProfile(hour_angle_limit_deg=40.0)
    sidereal = math.degrees(erfa.gmst82(2440587.5, T0 / 86400.0)) + LONGITUDE_DEG
    target = Slew((sidereal + 20.0) % 360.0, 50.0)
    start = StartPosition(40.0 - beside_deg, 20.0)
    stand = Stand(lambda _: target, DARK, start, profile).run(30.0)
    assert stand.safety.tripped is None
    assert max(truth.hour_angle_axis_deg for _, truth in stand.truths) <= 40.0
    assert stand.truths[-1][1].dec_deg == pytest.approx(50.0, abs=0.01)


@pytest.mark.parametrize("rate", [(0.0, 5.0), (0.0, -5.0), (3.0, -5.0)])
def test_a_slew_that_is_asked_for_in_motion_is_not_taken_for_astray_while_the_axes_brake(
    rate: tuple[float, float],
) -> None:
    """A braking axis goes on the old way for a while, out of the box between its ends."""
    sidereal = math.degrees(erfa.gmst82(2440587.5, T0 / 86400.0)) + LONGITUDE_DEG
    profile = MountProfile(dec=AxisLimits(max_acceleration_deg_s2=6.0))
    target = Slew((sidereal + 20.0) % 360.0, 40.0)
    follow = steadily(*rate)
    stand = Stand(
        lambda t: follow(t) if t < 3.0 else Hold() if t < 3.05 else target,
        DARK,
        StartPosition(-30.0, 40.0),
        profile,
    ).run(25.0)
    assert stand.safety.tripped is None
    assert stand.truths[-1][1].dec_deg == pytest.approx(40.0, abs=0.01)


@pytest.mark.parametrize(("west", "north"), [(0.3, 0.0), (-10.0, 2.0), (6.0, -3.0), (-14.9, 0.0)])
@pytest.mark.parametrize("what", ["idle", "slew", "follow"])
def test_a_mount_that_points_into_the_sun_gets_out_and_never_nearer(
    what: str, west: float, north: float
) -> None:
    """Whether it is left waiting, sent across the Sun, or streamed rates that stay inside of the cone."""
    sidereal = math.degrees(erfa.gmst82(2440587.5, T0 / 86400.0)) + LONGITUDE_DEG
    side = -1.0 if west > 0.0 else 1.0
    wish: dict[str, Motion] = {
        "idle": Hold(),
        "slew": Slew((sidereal - SUN_WEST_HA - side * 60.0) % 360.0, SUN_DEC + 20.0),
        "follow": MoveAxes(-0.01, 0.0),
    }
    start = StartPosition(SUN_WEST_HA + west, SUN_DEC + north)
    stand = Stand(lambda _: wish[what], SafetyLimits(), start, escapes=True).run(40.0)
    apart = [from_sun(truth, t) for t, truth in stand.truths]
    assert stand.safety.tripped is None
    assert min(apart) >= apart[0] - 0.05
    assert apart[-1] >= 15.0
    outside_s = next(t for (t, _), far in zip(stand.truths, apart, strict=True) if far >= 15.0)
    assert outside_s < 25.0


def test_axes_at_a_limit_give_way_to_the_sun_along_it() -> None:
    """Held at the end of the hour angle's travel, they go up or down where the Sun comes from the east."""
    profile = MountProfile(hour_angle_limit_deg=abs(SUN_WEST_HA + 15.4))
    start = StartPosition(SUN_WEST_HA + 15.3, SUN_DEC + 1.0)
    stand = Stand(steadily(1.0, 0.0), SafetyLimits(), start, profile).run(90.0)
    assert stand.safety.tripped is None
    assert min(from_sun(truth, t) for t, truth in stand.truths) >= 15.0
    assert max(truth.hour_angle_axis_deg for _, truth in stand.truths) <= profile.hour_angle_limit_deg


def test_by_hand_an_idle_mount_is_not_moved_out_of_the_sun() -> None:
    start = StartPosition(SUN_WEST_HA + 5.0, SUN_DEC)
    stand = Stand(lambda _: Hold(), SafetyLimits(), start, holds=False).run(10.0)
    assert max(axis_speed_deg_s(truth) for _, truth in stand.truths) < 1e-3 + SIDEREAL_RATE_DEG_S


@pytest.mark.parametrize(("ha", "dec"), [(90.0, -10.0), (-95.0, -5.0), (0.0, -35.0)])
def test_a_mount_that_starts_below_the_floor_slews_out_of_there_and_on(ha: float, dec: float) -> None:
    sidereal = math.degrees(erfa.gmst82(2440587.5, T0 / 86400.0)) + LONGITUDE_DEG
    target = Slew((sidereal - 20.0) % 360.0, 60.0)
    limits = SafetyLimits(floor_altitude_deg=10.0, optical=False)
    stand = Stand(lambda _: target, limits, StartPosition(ha, dec)).run(60.0)
    heights = [altitude(truth, t) for t, truth in stand.truths]
    assert heights[0] < 10.0
    assert stand.safety.tripped is None
    assert min(heights) > heights[0] - 0.1
    assert abs(stand.truths[-1][1].dec_axis_deg - 60.0) < 0.01


@pytest.mark.parametrize("holds", [True, False])
@pytest.mark.parametrize("wish", [MoveAxes(-1.0, 0.0), Slew(10.0, 60.0), Hold()], ids=repr)
def test_nothing_moves_while_the_clocks_are_half_a_day_apart(wish: Motion, holds: bool) -> None:
    """By one of the two the Sun is down: then it may be anywhere."""
    stand = Stand(lambda _: wish, SafetyLimits(), StartPosition(-60.0, 40.0), holds=holds, escapes=holds)
    stand.mount.step_clock(43200.0)
    stand.run(5.0)
    assert abs(stand.truths[-1][1].hour_angle_axis_deg + 60.0) < 0.05
    assert abs(stand.truths[-1][1].dec_axis_deg - 40.0) < 0.001
    assert isinstance(wish, Hold) or stand.safety.tripped == "clock"


def test_the_sky_goes_on_below_a_horizon_that_the_mount_is_held_at() -> None:
    """A target that sinks behind a hill and rises again is met again: the wish leads down, then up."""
    stand = replace(
        ROWS["altitude"][0],
        truths=[],
        sent=[],
        wish=lambda t: MoveAxes(SIDEREAL_RATE_DEG_S, -5.0 if t < 12.0 else 2.0),
    ).run(20.0)
    low = min(altitude(truth, 0.0) for _, truth in stand.truths)
    assert 10.0 <= low < 11.0
    assert altitude(stand.truths[-1][1], 0.0) > 20.0
    assert stand.safety.tripped is None
