"""Motions that must not outlive whoever asked for them, in virtual time with the simulated mount."""

from __future__ import annotations

import msgspec
import pytest
from console_builders import PROFILE, Bench

from sattrack.mount import SIDEREAL_RATE_DEG_S, Hold, MountProfile, MoveAxes
from sattrack.requests import EndMove, FindHome, FineRate, MoveAxis, PulseGuide, Request
from sattrack.safety import ClearedRequest, Safety, SafetyLimits, Seen

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


def test_a_mount_that_runs_away_is_stopped() -> None:
    safety = Safety(PROFILE, DARK, 52.0)
    for turn in range(60):
        sidereal_deg = turn * 0.05 * SIDEREAL_RATE_DEG_S
        safety.watch(Seen(None, sidereal_deg, 360.0 - 5.0 * 0.05 * turn, 40.0), MoveAxes(0.1, 0.0))
    assert safety.tripped == "obedience"
