"""Mounts that others wrote from the paper are parked, those too that follow the sky after an abort."""

from __future__ import annotations

import importlib
from typing import Any

import pytest
from msgspec.structs import replace
from strangers import planner

from sattrack.control.console import Console
from sattrack.control.manual_operation import ManualOperation
from sattrack.control.procedures import DONE, ParkThere
from sattrack.mount.model import AxesPosition, AxisLimits, MountProfile
from sattrack.safety import SafetyLimits
from tle.site import Site

BEGIN = 1.79e9
SITE = Site(52.0, 4.5)
HELD = MountProfile(move_axis="held", park=AxesPosition(-20.0, 40.0))


@pytest.mark.parametrize("tracking", [True, False])
@pytest.mark.parametrize("kind", ["planner", "velocity_servo", "position_servo"])
def test_it_stands_without_power_at_its_park_position(kind: str, tracking: bool) -> None:
    module: Any = importlib.import_module(f"strangers.{kind}")
    place = {"latitude_deg": SITE.latitude_deg, "longitude_deg": SITE.longitude_deg}
    start = {"start_utc_s": BEGIN, "hour_angle_deg": 5.0, "dec_deg": 30.0, "tracking": tracking}
    mount = module.Mount(module.Parameters(**place, **start))
    is_parked(mount, HELD, 120.0)


def test_a_slow_one_that_is_far_away_goes_all_the_way() -> None:
    """A large mount, at 0.4 degrees a second: 150 degrees take six minutes and a quarter."""
    slow = AxisLimits(max_rate_deg_s=0.4, slew_rate_deg_s=0.4, max_acceleration_deg_s2=1.0)
    profile = replace(HELD, ra=slow, dec=slow)
    place = {"latitude_deg": SITE.latitude_deg, "longitude_deg": SITE.longitude_deg}
    drives = {"max_rate_deg_s": 0.4, "acceleration_deg_s2": 1.0}
    start = {"start_utc_s": BEGIN, "hour_angle_deg": 130.0, "dec_deg": 60.0}
    took_s = is_parked(planner.Mount(planner.Parameters(**place, **drives, **start)), profile, None)
    assert took_s > 375.0


def is_parked(mount: Any, profile: MountProfile, within_s: float | None) -> float:
    """Park a stranger; return how long that took, seconds."""
    console = Console(profile, SafetyLimits(optical=False), SITE, "stranger")
    operation = ManualOperation(console, ParkThere(profile), BEGIN, within_s)
    now_s, coming = BEGIN, mount.next_turn_s
    while not operation.finished:
        now_s += profile.period_s
        while coming <= now_s:
            status = bytes(mount.turn())
            operation.receive(status, coming)
            coming = mount.next_turn_s
        datagram = operation.tick(now_s)
        if datagram is not None:
            mount.receive(datagram)
    assert operation.outcome is not None
    assert operation.outcome.state in DONE, operation.outcome
    for _ in range(40):
        mount.turn()
    _, hour_angle_deg, dec_deg, *rates = mount.truth()[:5]
    assert (hour_angle_deg, dec_deg) == (pytest.approx(-20.0, abs=0.1), pytest.approx(40.0, abs=0.1))
    assert max(map(abs, rates)) < 1e-6
    return now_s - BEGIN
