"""Every interlock at its bound, and that nothing gets round it."""

from __future__ import annotations

import math

import erfa
import pytest

from sattrack.mount import SIDEREAL_RATE_DEG_S, AxisLimits, Hold, Motion, MountProfile, MoveAxes, SlewTo, Stop
from sattrack.safety import INTERLOCKS, Safety, SafetyLimits, altitude_deg

LATITUDE_DEG = 52.0


def safety(floor_deg: float = 0.0) -> Safety:
    profile = MountProfile(ra=AxisLimits(max_rate_deg_s=6.0), dec=AxisLimits(max_rate_deg_s=4.0))
    return Safety(profile, SafetyLimits(floor_altitude_deg=floor_deg), LATITUDE_DEG)


@pytest.mark.parametrize("hour_angle", [-170.0, -60.0, 0.0, 45.0, 179.0])
@pytest.mark.parametrize("dec", [-35.0, 0.0, 40.0, 89.9])
def test_altitude_is_that_of_erfa(hour_angle: float, dec: float) -> None:
    _, expected = erfa.hd2ae(math.radians(hour_angle), math.radians(dec), math.radians(LATITUDE_DEG))
    assert altitude_deg(hour_angle, dec, LATITUDE_DEG) == pytest.approx(math.degrees(expected), abs=1e-9)


def test_rates_within_the_limits_pass_unchanged() -> None:
    gate = safety()
    assert gate.clear(MoveAxes(-2.0, 3.9), 0.0, 0.0, 40.0).motion == MoveAxes(-2.0, 3.9)
    assert not gate.clamping


@pytest.mark.parametrize(
    ("asked", "cleared"),
    [
        (MoveAxes(-18.0, 0.0), MoveAxes(SIDEREAL_RATE_DEG_S - 6.0, 0.0)),
        (MoveAxes(18.0, -18.0), MoveAxes(SIDEREAL_RATE_DEG_S + 6.0, -4.0)),
    ],
)
def test_rates_beyond_are_cut_on_the_axis(asked: MoveAxes, cleared: MoveAxes) -> None:
    gate = safety()
    assert gate.clear(asked, 0.0, 0.0, 40.0).motion == cleared
    assert gate.clamping
    assert gate.tripped is None


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize(
    "make", [lambda x: MoveAxes(x, 0.0), lambda x: MoveAxes(0.0, x), lambda x: SlewTo(x, 1.0)]
)
def test_numbers_that_are_none_stop_the_mount(make: object, bad: float) -> None:
    gate = safety()
    assert gate.clear(make(bad), 0.0, 0.0, 40.0).motion == Stop()  # type: ignore[operator]
    assert gate.tripped == "command"


def test_below_the_floor_it_stops_and_stays_stopped() -> None:
    gate = safety(floor_deg=5.0)
    # On the meridian the altitude is 90° - latitude + declination: 38° + dec.
    assert gate.clear(MoveAxes(0.1, 0.1), 0.0, 0.0, -32.9).motion == MoveAxes(0.1, 0.1)
    assert gate.clear(MoveAxes(0.1, 0.1), 0.0, 0.0, -33.1).motion == Stop()
    assert gate.tripped == "altitude"
    again: list[Motion] = [MoveAxes(0.0, 0.0), SlewTo(0.0, 40.0), Hold()]
    assert [gate.clear(m, 0.0, 0.0, 40.0).motion for m in again] == [Stop()] * 3


def test_a_slew_to_below_the_floor_never_starts() -> None:
    gate = safety()
    assert gate.clear(SlewTo(180.0, -10.0), 0.0, 0.0, 40.0).motion == Stop()
    assert gate.tripped == "altitude"


@pytest.mark.parametrize("motion", [Hold(), Stop(), SlewTo(10.0, 40.0)])
def test_harmless_motions_pass(motion: Motion) -> None:
    assert safety().clear(motion, 0.0, 0.0, 40.0).motion == motion


def test_whatever_can_trip_is_in_the_table() -> None:
    assert {row.name for row in INTERLOCKS} == {"rate", "command", "altitude", "hour_angle", "obedience"}
    assert all(row.watches and row.bound and row.way_out for row in INTERLOCKS)


def at_hour_angles(*seen: float) -> Safety:
    gate = safety(floor_deg=-90.0)
    for hour_angle in seen:
        gate.watch(hour_angle, MoveAxes(0.0, 0.0), Hold(), 0.05)
    return gate


@pytest.mark.parametrize(
    ("seen", "westward", "cleared"),
    [
        ([350.0], False, True),
        ([300.0, 200.0], False, True),
        ([170.0, 190.0, 199.9], True, False),
        ([170.0, 190.0, 199.9], False, True),
        ([190.0], True, True),
        ([190.0, 161.0], False, True),
        ([190.0, 160.0], False, False),
        ([-170.0, -199.9], False, False),
    ],
)
def test_turns_of_the_hour_angle_are_counted_from_the_first_status(
    seen: list[float], westward: bool, cleared: bool
) -> None:
    """The limit is 200° either way; 190° seen first is 170° east, and 160° after it 200° east."""
    gate = at_hour_angles(*seen)
    move = MoveAxes(-1.0 if westward else 1.0, 0.0)
    assert (gate.clear(move, seen[-1], 0.0, 40.0).motion == move) is cleared
    assert gate.tripped == (None if cleared else "hour_angle")


def test_a_mount_that_does_not_move_is_not_obeying() -> None:
    gate = safety()
    for _ in range(25):
        gate.watch(10.0, MoveAxes(0.0, 0.0), MoveAxes(1.0, 0.0), 0.05)
    assert gate.tripped == "obedience"


def test_a_mount_that_takes_its_time_to_turn_round_is_obeying() -> None:
    gate = safety()
    for moved in (-6.0, -4.0, -2.0, -0.5, 0.5, 3.0) * 5:
        gate.watch(10.0, MoveAxes(0.0, moved), MoveAxes(0.0, 6.0), 0.05)
    assert gate.tripped is None
