"""What the gate lets through at its bounds: requests by hand, ramps, ages, and what counts as in force."""

from __future__ import annotations

import pytest
from msgspec.structs import replace

from sattrack.mount.model import (
    SIDEREAL_RATE_DEG_S,
    MountProfile,
    MoveAxes,
)
from sattrack.safety import Safety, SafetyLimits

S = SIDEREAL_RATE_DEG_S
LATITUDE_DEG, T0 = 52.0, 1_790_000_000.0
DARK = SafetyLimits(floor_altitude_deg=-90.0, optical=False)
PROFILE = MountProfile(hour_angle_limit_deg=40.0, dec_axis_limits_deg=(-50.0, 130.0))
SIDEREAL_DEG = 100.0


def gate(holds: bool = False, profile: MountProfile = PROFILE, fault_s: float = 1.0) -> Safety:
    return Safety(profile, replace(DARK, longest_fault_s=fault_s), LATITUDE_DEG, holds=holds)


def sent(
    safety: Safety, wish: MoveAxes, utc_s: float | None, dec_deg: float = 0.0, age_s: float = 0.0
) -> tuple[float, float]:
    """Clear a wish on the meridian; return the rates of the axes that come out."""
    motion = safety.clear(wish, SIDEREAL_DEG, SIDEREAL_DEG, dec_deg, age_s, utc_s).motion
    assert isinstance(motion, MoveAxes)
    return S - motion.ra_rate_deg_s, motion.dec_rate_deg_s


def test_what_was_sent_counts_until_the_mount_has_obeyed_what_came_after_it() -> None:
    """Latency is 0.2004 s. At 4 °/s an axis comes 0.8 + 1 = 1.8° on its way, and brakes."""
    for later_s, lets in ((0.15, False), (0.19, False), (0.26, True), (5.0, True)):
        safety = gate()
        assert sent(safety, MoveAxes(S, -4.0), T0, -20.0) == pytest.approx((0.0, -4.0))
        safety.clear(MoveAxes(S, 0.0), SIDEREAL_DEG, SIDEREAL_DEG, -30.0, 0.0, T0 + 0.05)
        wish = MoveAxes(S, -0.01)
        cleared = safety.clear(wish, SIDEREAL_DEG, SIDEREAL_DEG, -49.0, 0.0, T0 + 0.05 + later_s)
        assert (cleared.motion == wish) == lets
