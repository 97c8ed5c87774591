"""How to get onto a moving target: by rates or by a slew, where to wait for it, and when to begin."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

    from sattrack.control.law import FeederLaw
    from sattrack.mount.model import AxisLimits, MountProfile

MARGIN_S = 1.5
"""Time that a plan made long beforehand keeps for a slew's handshake, its settling and the joining."""
HANDSHAKE_S = 0.6
"""Time kept for the handshake of a slew, and for what the estimate of its length leaves out."""
LET_GO_S = 0.3
"""What it takes to end MoveAxis and see the mount stand, before it can slew."""
SETTLES_S = 1.0
"""What a slew by an unknown mount takes beyond its estimate, until it is said to be over."""
RATES_WITHIN_DEG = 20.0
"""How far off rates are taken at all: they go straight on, where slews are led round what is in the way."""
ROUNDS = 8

Axes = tuple[float, float]
"""Hour angle within half a turn of the meridian, and declination, degrees: how the axes stand."""
Target = tuple[float, float, float]
"""Right ascension, declination, and the hour angle that the mount would take there, degrees."""


@dataclass(frozen=True, slots=True)
class Intercept:
    """The target comes through this direction at this instant; reached from now on by rates, or by a slew."""

    utc_s: float
    ra_deg: float
    dec_deg: float
    by_rates: bool = False


def slew_time_s(distance_deg: float, axis: AxisLimits) -> float:
    """Return how long an axis takes from rest to rest over a distance, within its rate and acceleration."""
    distance = abs(distance_deg)
    # The mount brakes with half of its acceleration, so the ramps take 1.5 times as long as the formula's.
    ramp_s = 1.5 * axis.slew_rate_deg_s / axis.max_acceleration_deg_s2
    if distance < axis.slew_rate_deg_s * ramp_s:
        return 2.0 * math.sqrt(1.5 * distance / axis.max_acceleration_deg_s2)
    return distance / axis.slew_rate_deg_s + ramp_s


def chase_time_s(distance_deg: float, axis: AxisLimits, law: FeederLaw) -> float:
    """Return how long rates take to close a distance, by the feeder's law, until next to nothing is left."""
    distance, top, acceleration = abs(distance_deg), axis.max_rate_deg_s, axis.max_acceleration_deg_s2
    if not distance:
        return 0.0
    starting, braking = law.ramp_share * acceleration, law.braking_share * acceleration
    peak = min(top, math.sqrt(2.0 * distance * starting * braking / (starting + braking)))
    ramps_deg = 0.5 * peak * peak * (1.0 / starting + 1.0 / braking)
    return peak / starting + peak / braking + max(0.0, distance - ramps_deg) / top + 5.0 * law.settling_s


def plan_intercept(
    now_utc_s: float,
    not_before_utc_s: float,
    mount: Axes,
    target_at: Callable[[float], Target],
    profile: MountProfile,
    law: FeederLaw | None = None,
    moving: bool = False,
) -> Intercept:
    """Return the earliest point of the target's path that the mount can be on it.

    `target_at` gives the target at an instant. The time of the way depends on where it ends, and that on the
    time, so the two are brought together by iteration. The hour angle turns within half a turn either way of
    the meridian, so the way from one side of the lower meridian to the other is the long one. `moving` where
    the mount is in MoveAxis, which has to end before a slew. Rates by the feeder's law, where one is given,
    are chosen for a target that is there already, and that a slew would not reach much sooner.
    """
    before_s = HANDSHAKE_S + (LET_GO_S if moving else 0.0)
    slew = _meet(now_utc_s, not_before_utc_s, mount, target_at, (profile, slew_time_s, before_s))
    if slew.utc_s <= not_before_utc_s or law is None:
        return slew
    chase = partial(chase_time_s, law=law)
    rates = _meet(now_utc_s, not_before_utc_s, mount, target_at, (profile, chase, 0.0))
    _, dec, hour_angle = target_at(now_utc_s)
    far = max(abs(hour_angle - mount[0]), abs(dec - mount[1])) > RATES_WITHIN_DEG
    if far or rates.utc_s > slew.utc_s + SETTLES_S:
        return slew
    return Intercept(rates.utc_s, rates.ra_deg, rates.dec_deg, by_rates=True)


def _meet(
    now_utc_s: float,
    not_before_utc_s: float,
    mount: Axes,
    target_at: Callable[[float], Target],
    way: tuple[MountProfile, Callable[[float, AxisLimits], float], float],
) -> Intercept:
    profile, time_s, before_s = way
    join = not_before_utc_s
    for _ in range(ROUNDS):
        _, dec, hour_angle = target_at(join)
        travel = max(time_s(hour_angle - mount[0], profile.ra), time_s(dec - mount[1], profile.dec))
        join = max(not_before_utc_s, now_utc_s + travel + before_s)
    ra, dec, _ = target_at(join)
    return Intercept(join, ra, dec)
