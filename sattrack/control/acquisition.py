"""How to get onto a moving target: where to wait for it, and when to begin."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

    from sattrack.mount import AxisLimits, MountProfile

MARGIN_S = 1.5
"""Time kept for the handshake, settling, and what the estimate leaves out."""
ROUNDS = 8

Axes = tuple[float, float]
"""Hour angle within half a turn of the meridian, and declination, degrees: how the axes stand."""
Target = tuple[float, float, float]
"""Right ascension, declination, and the hour angle that the mount would take there, degrees."""


@dataclass(frozen=True, slots=True)
class Intercept:
    """Wait at this direction; the target comes through at this instant."""

    utc_s: float
    ra_deg: float
    dec_deg: float


def slew_time_s(distance_deg: float, axis: AxisLimits) -> float:
    """Return how long an axis takes from rest to rest over a distance, within its rate and acceleration."""
    distance = abs(distance_deg)
    # The mount brakes with half of its acceleration, so the ramps take 1.5 times as long as the formula's.
    ramp_s = 1.5 * axis.slew_rate_deg_s / axis.max_acceleration_deg_s2
    if distance < axis.slew_rate_deg_s * ramp_s:
        return 2.0 * math.sqrt(1.5 * distance / axis.max_acceleration_deg_s2)
    return distance / axis.slew_rate_deg_s + ramp_s


def plan_intercept(
    now_utc_s: float,
    not_before_utc_s: float,
    mount: Axes,
    target_at: Callable[[float], Target],
    profile: MountProfile,
) -> Intercept:
    """Return the earliest point of the target's path that the mount can wait at.

    `target_at` gives the target at an instant. The time of the slew depends on where it ends, and that on the
    time, so the two are brought together by iteration. The hour angle turns within half a turn either way of
    the meridian, so the way from one side of the lower meridian to the other is the long one.
    """
    join = not_before_utc_s
    for _ in range(ROUNDS):
        _, dec, hour_angle = target_at(join)
        travel = max(slew_time_s(hour_angle - mount[0], profile.ra), slew_time_s(dec - mount[1], profile.dec))
        join = max(not_before_utc_s, now_utc_s + travel + MARGIN_S)
    ra, dec, _ = target_at(join)
    return Intercept(join, ra, dec)
