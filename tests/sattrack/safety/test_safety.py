"""Every interlock at its bound, in closed form, and that nothing gets round it."""

from __future__ import annotations

import ast
import math
from functools import cache
from pathlib import Path

import erfa
import msgspec
import numpy as np
import pytest

import sattrack
from sattrack.core.angles import altitude_deg
from sattrack.mount.model import (
    SIDEREAL_RATE_DEG_S,
    AxisLimits,
    Hold,
    Motion,
    MountProfile,
    MoveAxes,
    Seen,
    Slew,
    Stop,
)
from sattrack.safety import INTERLOCKS, Safety, SafetyLimits

LATITUDE_DEG = 52.0
PROFILE = MountProfile(ra=AxisLimits(max_rate_deg_s=6.0), dec=AxisLimits(max_rate_deg_s=4.0))
STEP_DEG = 0.05 * SIDEREAL_RATE_DEG_S
LATENCY_S = 0.2004
"""Two periods, 0.1 s of jitter and the profile's delays."""


def safety(floor_deg: float = 0.0, holds: bool = False, profile: MountProfile = PROFILE) -> Safety:
    limits = SafetyLimits(floor_altitude_deg=floor_deg, optical=False)
    return Safety(profile, limits, LATITUDE_DEG, holds=holds)


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


def test_a_stream_of_rates_steps_no_faster_than_twice_a_ramp() -> None:
    gate = safety(holds=True)
    gate.clear(MoveAxes(0.0, 0.0), 0.0, 0.0, 40.0, 0.0, 100.0)
    one = gate.clear(MoveAxes(0.0, 4.0), 0.0, 0.0, 40.0, 0.0, 100.05).motion
    # Acceleration 10 °/s², 50 ms, twice.
    assert isinstance(one, MoveAxes)
    assert one.dec_rate_deg_s == pytest.approx(1.0)
    assert gate.clear(MoveAxes(0.0, 0.0), 0.0, 0.0, 40.0, 0.0, 100.1).motion == MoveAxes(0.0, 0.0)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize(
    "make", [lambda x: MoveAxes(x, 0.0), lambda x: MoveAxes(0.0, x), lambda x: Slew(x, 1.0)]
)
def test_numbers_that_are_none_stop_the_mount(make: object, bad: float) -> None:
    gate = safety()
    assert gate.clear(make(bad), 0.0, 0.0, 40.0).motion == Stop()  # type: ignore[operator]
    assert gate.tripped == "command"


@pytest.mark.parametrize(("inside", "passes"), [(0.02, True), (-0.02, False)])
@pytest.mark.parametrize(("rate", "fault_s", "age_s"), [(-1.0, 1.0, 0.0), (-3.0, 1.0, 0.3), (-2.0, 0.0, 0.0)])
def test_by_hand_a_rate_stops_where_its_braking_way_with_the_longest_fault_would_reach_the_floor(
    rate: float, fault_s: float, age_s: float, inside: float, passes: bool
) -> None:
    """On the meridian the altitude is 38° + dec: the way is rate x (delays + fault) + rate² / 2a, a of 8."""
    del age_s
    limits = SafetyLimits(floor_altitude_deg=5.0, optical=False, longest_fault_s=fault_s)
    gate = Safety(PROFILE, limits, LATITUDE_DEG)
    way = abs(rate) * (LATENCY_S + fault_s) + rate * rate / (2.0 * 8.0)
    dec = -33.0 + 0.1 + way + inside
    move = MoveAxes(SIDEREAL_RATE_DEG_S, rate)
    assert (gate.clear(move, 0.0, 0.0, dec).motion == move) is passes
    assert gate.tripped == (None if passes else "altitude")


def test_once_tripped_it_stays_stopped() -> None:
    gate = safety(floor_deg=5.0)
    assert gate.clear(MoveAxes(0.1, -1.0), 0.0, 0.0, -32.8).motion == Stop()
    again: list[Motion] = [MoveAxes(0.0, 0.0), Slew(0.0, 40.0), Hold()]
    assert [gate.clear(m, 0.0, 0.0, 40.0).motion for m in again] == [Stop()] * 3


def test_below_the_floor_the_way_up_is_free_and_the_way_down_is_not() -> None:
    up, down = MoveAxes(SIDEREAL_RATE_DEG_S, 0.5), MoveAxes(SIDEREAL_RATE_DEG_S, -0.5)
    assert safety(floor_deg=5.0).clear(up, 0.0, 0.0, -40.0).motion == up
    assert safety(floor_deg=5.0).clear(down, 0.0, 0.0, -40.0).motion == Stop()


def test_a_held_stream_is_slowed_along_the_floor_and_goes_on_when_it_leads_away() -> None:
    gate = safety(floor_deg=5.0, holds=True)
    held = gate.clear(MoveAxes(SIDEREAL_RATE_DEG_S, -0.4), 0.0, 0.0, -32.7, 0.0, 100.0).motion
    assert isinstance(held, MoveAxes)
    assert -0.4 < held.dec_rate_deg_s <= 0.0
    assert gate.holding == "altitude"
    assert gate.tripped is None
    away = MoveAxes(SIDEREAL_RATE_DEG_S, 0.4)
    assert gate.clear(away, 0.0, 0.0, -32.7, 0.0, 100.05).motion == away
    assert gate.holding is None


def test_a_slew_to_below_the_floor_never_starts() -> None:
    gate = safety()
    assert gate.clear(Slew(180.0, -10.0), 0.0, 0.0, 40.0).motion == Stop()
    assert gate.tripped == "altitude"


@pytest.mark.parametrize("motion", [Hold(), Stop(), Slew(10.0, 40.0)])
def test_harmless_motions_pass(motion: Motion) -> None:
    assert safety().clear(motion, 0.0, 0.0, 40.0).motion == motion


def test_whatever_can_trip_is_in_the_table() -> None:
    assert {row.name for row in INTERLOCKS} == {
        "rate", "acceleration", "command", "altitude", "horizon", "hour_angle", "declination", "pier", "sun",
        "moon", "status_age", "obedience", "clock", "current", "restart",
    }  # fmt: skip
    assert all(row.watches and row.bound and row.way_out and row.margin for row in INTERLOCKS)


def at_hour_angles(*seen: float) -> Safety:
    """Statuses of an axis that turned from one hour angle to the next, as fast as a slew."""
    gate = safety(floor_deg=-90.0)
    way = [seen[0]]
    for goal in seen:
        steps = math.ceil(abs(goal - way[-1]) / 0.4)
        way += list(np.linspace(way[-1], goal, steps + 1))
    for hour_angle in way:
        gate.watch(Seen(None, float(hour_angle), 0.0, 40.0), Hold())
    return gate


@pytest.mark.parametrize(
    ("seen", "westward", "cleared"),
    [
        ([350.0], False, True),
        ([300.0, 200.0], False, True),
        ([170.0, 190.0, 199.95], True, False),
        ([170.0, 190.0, 199.95], False, True),
        ([190.0], True, True),
        ([190.0, 162.0], False, True),
        ([190.0, 160.5], False, False),
        ([-170.0, -199.95], False, False),
    ],
)
def test_turns_of_the_hour_angle_are_counted_from_the_first_status(
    seen: list[float], westward: bool, cleared: bool
) -> None:
    """The limit is 200° either way; 190° seen first is 170° east, and 160.5° after it 199.5° east."""
    gate = at_hour_angles(*seen)
    move = MoveAxes(-1.0 if westward else 1.0, 0.0)
    assert (gate.clear(move, seen[-1], 0.0, 40.0).motion == move) is cleared
    assert gate.tripped == (None if cleared else "hour_angle")


def drive(gate: Safety, told: MoveAxes, rates: list[tuple[float, float]]) -> Safety:
    """Let statuses tell mean rates of right ascension and declination, 50 ms each."""
    ra, dec = 10.0, 20.0
    for k, (ra_rate, dec_rate) in enumerate(rates):
        gate.watch(Seen(None, k * STEP_DEG, ra % 360.0, dec), told)
        ra, dec = ra + 0.05 * ra_rate, dec + 0.05 * dec_rate
    return gate


def test_a_mount_that_does_not_move_is_not_obeying() -> None:
    """For a second, besides the second for which commands may be lost."""
    assert drive(safety(), MoveAxes(1.0, 0.0), [(0.0, 0.0)] * 35).tripped is None
    assert drive(safety(), MoveAxes(1.0, 0.0), [(0.0, 0.0)] * 45).tripped == "obedience"


def test_a_mount_that_creeps_where_it_should_move_is_not_obeying() -> None:
    assert drive(safety(), MoveAxes(0.4, 0.0), [(0.02, 0.0)] * 50).tripped is None
    assert drive(safety(), MoveAxes(0.4, 0.0), [(0.02, 0.0)] * 90).tripped == "obedience"


def test_a_mount_that_takes_its_time_to_turn_round_is_obeying() -> None:
    turning = [(0.0, max(-6.0, min(6.0, -6.0 + 0.4 * k))) for k in range(60)]
    assert drive(safety(), MoveAxes(0.0, 6.0), [*turning[:30], *[(0.0, 6.0)] * 60]).tripped is None


@pytest.mark.parametrize(("amperes", "tripped"), [(3.9, None), (4.1, "current")])
def test_a_drive_that_draws_too_much_for_half_a_second_is_stopped(
    amperes: float, tripped: str | None
) -> None:
    ra = AxisLimits(max_current_a=4.0)
    gate = safety(profile=msgspec.structs.replace(PROFILE, ra=ra))
    for k in range(15):
        gate.watch(Seen(None, k * STEP_DEG, 10.0, 20.0, ra_current_a=-amperes), MoveAxes(0.0, 0.0))
    assert gate.tripped == tripped


@pytest.mark.parametrize(("off_s", "tripped"), [(50.0, None), (70.0, "clock"), (-70.0, "clock")])
def test_a_mount_whose_sidereal_clock_is_far_off_is_stopped(off_s: float, tripped: str | None) -> None:
    gate = Safety(PROFILE, SafetyLimits(), LATITUDE_DEG, 4.5)
    utc_s = 1_790_000_000.0
    sidereal = math.degrees(erfa.gmst82(2440587.5, (utc_s + off_s) / 86400.0)) + 4.5
    gate.watch(Seen(utc_s, sidereal % 360.0, 10.0, 20.0), MoveAxes(0.0, 0.0))
    assert gate.tripped == tripped


def test_a_clock_of_ours_that_runs_back_and_a_status_too_old_stop_the_mount() -> None:
    gate = safety()
    gate.clear(MoveAxes(0.0, 0.0), 0.0, 0.0, 40.0, 0.0, 100.0)
    gate.clear(MoveAxes(0.0, 0.0), 0.0, 0.0, 40.0, 0.0, 98.0)
    assert gate.tripped == "clock"
    late = safety()
    late.clear(MoveAxes(0.0, 0.0), 0.0, 0.0, 40.0, 2.6)
    assert late.tripped == "status_age"


def test_without_a_site_nothing_moves_that_has_optics() -> None:
    gate = Safety(PROFILE, SafetyLimits(), LATITUDE_DEG)
    assert gate.clear(MoveAxes(0.0, 0.0), 0.0, 0.0, 40.0, 0.0, 1_790_000_000.0).motion == Stop()
    assert gate.tripped == "sun"


ROOT = Path(sattrack.__file__).parent


LOOKED_FOR = {"Cleared", "ClearedRequest", "encode_command", "sendto", "Safety", "ProbeSafety", "compose"}


@cache
def calls() -> list[tuple[str, str, ast.Call]]:
    """Every call in the package of what is looked for: the module, the name that is called, and the call."""
    found = []
    for path in ROOT.rglob("*.py"):
        module, text = path.relative_to(ROOT).as_posix(), path.read_text(encoding="utf-8")
        if not any(name in text for name in LOOKED_FOR):
            continue
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.Call):
                name = (
                    node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
                )
                if name in LOOKED_FOR:
                    found.append((module, name, node))
    return found


def test_only_safety_makes_what_a_session_takes_and_nothing_else_composes_motion() -> None:
    """Commands are packed by the session, which takes what safety made, by the calibration's own guard, and
    elsewhere only as a stop, or as nothing at all."""
    every = calls()
    assert {module for module, name, _ in every if name in ("Cleared", "ClearedRequest")} == {
        "safety/gate.py",
        "safety/probe.py",
    }
    composers = set()
    for module, name, call in every:
        if name != "encode_command":
            continue
        command = call.args[0]
        literal = isinstance(command, ast.Call) and getattr(command.func, "id", "") == "Command"
        if literal and len(command.args) <= 1 and {word.arg for word in command.keywords} <= {"abort"}:
            continue
        composers.add(module)
    assert composers == {"mount/xerxes/session.py", "calibration/guard.py"}
    senders = {module for module, name, _ in every if name == "sendto"}
    mounts = {"mount/simulator/process.py", "mount/alpaca/gateway_process.py"}
    # Some ask for Alpaca servers or answer who asks, one reports the state of a run to systemd.
    alpaca = {"mount/alpaca/client.py", "servers/alpaca/process.py", "mount/simulator/alpaca_server.py"}
    others = {*alpaca, "schedule/night_processes.py"}
    assert senders == {"mount/xerxes/client.py", *others, *mounts}


def test_whoever_lets_a_session_speak_has_a_gate_of_its_own() -> None:
    every = calls()
    gates = {module for module, name, _ in every if name in ("Safety", "ProbeSafety")}
    speakers = {module for module, name, _ in every if name == "compose"} - {"mount/xerxes/session.py"}
    assert len(speakers) >= 4
    assert speakers == gates
