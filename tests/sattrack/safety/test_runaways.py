"""Motions that must not outlive whoever asked for them, in virtual time with the simulated mount."""

from __future__ import annotations

import math

import erfa
import msgspec
import pytest
from console_builders import PROFILE, T0, Bench
from driven_limits import SUN_DEC, SUN_WEST_HA

from sattrack.control.procedures import procedure_for
from sattrack.mount.model import Hold, MountProfile, MoveAxes, Seen, Slew
from sattrack.mount.requests import ClearedRequest, EndMove, FindHome, FineRate, MoveAxis, PulseGuide, Request
from sattrack.mount.simulator.mount import StartPosition
from sattrack.safety import Safety, SafetyLimits

DARK = SafetyLimits(optical=False)
EDGE = msgspec.structs.replace(PROFILE, move_axis="edge")


def moving_deg_s(bench: Bench) -> float:
    assert bench.truth is not None
    return abs(bench.truth.dec_rate_deg_s)


@pytest.mark.parametrize("profile", [PROFILE, EDGE], ids=["held", "edge"])
@pytest.mark.parametrize("turns", [0, 1, 5])
@pytest.mark.parametrize("request_", [FindHome(), FineRate(0.0, 0.0), PulseGuide(100, 0)], ids=repr)
def test_a_jog_is_not_carried_on_by_another_request(
    profile: MountProfile, turns: int, request_: Request
) -> None:
    bench = Bench(profile)
    bench.run(1.0)
    bench.console.jog(None, 1.0, bench.now_s)
    for _ in range(turns):
        bench.turn()
    bench.console.request(request_, bench.now_s)
    bench.run(60.0)
    assert moving_deg_s(bench) < 1e-6


@pytest.mark.parametrize("heard_turns", range(6))
def test_an_edge_jog_is_ended_though_nothing_is_heard_any_more(heard_turns: int) -> None:
    bench = Bench(EDGE)
    bench.run(1.0)
    bench.console.jog(None, 2.0, bench.now_s)
    for _ in range(heard_turns):
        bench.turn()
    bench.cut = True
    bench.run(20.0)
    assert moving_deg_s(bench) < 1e-6


def test_a_move_asked_for_while_another_ends_does_not_keep_its_other_axis_going() -> None:
    bench = Bench(EDGE)
    bench.run(1.0)
    session = bench.console.session
    session.submit(ClearedRequest(MoveAxis(0.3, 0.5)))
    bench.run(0.15)
    session.submit(ClearedRequest(EndMove()))
    session.submit(ClearedRequest(MoveAxis(0.1, None)))
    bench.run(5.0)
    assert moving_deg_s(bench) < 1e-6


def test_the_cables_turns_are_remembered_after_a_stop() -> None:
    former = Safety(PROFILE, DARK, 52.0)
    for hour_angle in range(0, 200, 20):
        former.watch(Seen(None, float(hour_angle), 0.0, 40.0), Hold())
    later = Safety(PROFILE, DARK, 52.0)
    later.follow_on(former)
    later.watch(Seen(None, 198.0, 0.0, 40.0), Hold())
    # Near the pole no altitude stops it first.
    cleared = later.clear(MoveAxes(-6.0, 0.0), 198.0, 0.0, 89.0)
    assert later.tripped == "hour_angle"
    assert not isinstance(cleared.motion, MoveAxes)


def carried_out(start: StartPosition, request: Request, limits: SafetyLimits, clock_s: float = 0.0) -> Bench:
    """A mount that begins somewhere, a request by hand, and what came of it."""
    bench = Bench(start=start, limits=limits)
    bench.mount.step_clock(clock_s)
    bench.run(1.0)
    bench.carry_out(procedure_for(request, bench.profile))
    return bench


def test_by_hand_a_slew_leads_out_of_the_sun_and_up_from_below_the_floor() -> None:
    sidereal = math.degrees(erfa.gmst82(2440587.5, T0 / 86400.0)) + 4.5
    away = Slew((sidereal - SUN_WEST_HA + 50.0) % 360.0, 20.0)
    dazzled = StartPosition(SUN_WEST_HA + 4.0, SUN_DEC + 2.0)
    low = StartPosition(90.0, -10.0)
    for start, limits in ((dazzled, SafetyLimits()), (low, SafetyLimits(floor_altitude_deg=10.0))):
        bench = carried_out(start, away, limits)
        assert bench.console.refusal is None
        assert bench.truth is not None
        assert abs(bench.truth.dec_axis_deg - 20.0) < 0.01


@pytest.mark.parametrize("request_", [Slew(100.0, 50.0), FindHome(), PulseGuide(500, 0)], ids=repr)
def test_by_hand_nothing_moves_while_the_clocks_are_half_a_day_apart(request_: Request) -> None:
    bench = carried_out(StartPosition(-60.0, 40.0), request_, SafetyLimits(), 43200.0)
    assert bench.flags() == []
    assert "more than clock_tolerance_s, 60: set the mount's clock or this computer's" in str(
        bench.console.refusal
    )
