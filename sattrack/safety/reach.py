"""How far an axis may come before a stop can hold it: closed forms, degrees and seconds; pure.

The mount keeps the last rate that it got. So from a rate that goes out now, an axis may go on as it does
until that rate arrives, then at that rate for as long as nothing else arrives, and then it brakes.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from sattrack.mount import MountProfile

PERIODS_UNTIL_OBEYED = 2.0
"""Ours until the next datagram goes out, and the mount's until its loop reads it."""
EDGE_PERIODS = 6.0
"""How long the handshake of a mount that takes rates by edges may hold back a new rate."""
JITTER_S = 0.1
CREEP_DEG_S = 0.1
"""Slower than this towards its limit, a stream that is held counts as closed up to it."""
BRAKING_SHARE = 0.8
"""Of the acceleration that the profile has, so much is counted on to brake."""


class AxisMotion(NamedTuple):
    """Where an axis was seen, and the least and the greatest rate at which it may be going since."""

    position_deg: float
    low_deg_s: float
    high_deg_s: float


class Delays(NamedTuple):
    """How old what was seen is, how long until a command acts, and how long no other may arrive; seconds."""

    age_s: float
    latency_s: float
    fault_s: float


def reach_deg(
    axis: AxisMotion, rate_deg_s: float, delays: Delays, acceleration_deg_s2: float
) -> tuple[float, float]:
    """Return the least and the greatest angle at which the axis may be until it has stopped."""
    braking = BRAKING_SHARE * acceleration_deg_s2
    up = _ahead_deg(axis.high_deg_s, rate_deg_s, delays, braking)
    down = _ahead_deg(-axis.low_deg_s, -rate_deg_s, delays, braking)
    return axis.position_deg - down, axis.position_deg + up


def _ahead_deg(going: float, asked: float, delays: Delays, braking: float) -> float:
    # Four times for every command: without calls.
    going = going if going > 0.0 else 0.0
    asked = asked if asked > 0.0 else 0.0
    age_s, latency_s, fault_s = delays
    stopping = asked * asked / (2.0 * braking)
    if going <= asked:
        return going * age_s + asked * latency_s + asked * fault_s + stopping
    slowing = (going - asked) ** 2 / (2.0 * braking)
    return going * age_s + going * latency_s + asked * fault_s + stopping + slowing


def latency_s(profile: MountProfile) -> float:
    """Return how long it takes until a mount acts on what is decided now, no datagram lost, seconds."""
    edge_s = EDGE_PERIODS * profile.period_s if profile.move_axis == "edge" else 0.0
    delay_s = profile.command_delay_s + profile.status_delay_s
    return PERIODS_UNTIL_OBEYED * profile.period_s + JITTER_S + delay_s + edge_s


def standstill_s(rate_deg_s: float, latency_s: float, acceleration_deg_s2: float) -> float:
    """Return within what time an axis stands after a stop is asked for, a lost datagram not counted."""
    return latency_s + abs(rate_deg_s) / (BRAKING_SHARE * acceleration_deg_s2)


def closing_s(rate_deg_s: float, delays: Delays, acceleration_deg_s2: float) -> float:
    """Return within what time a stream that is held at a limit has closed up to it from a rate.

    What may still be gone grows with the rate, by latency and longest fault: so the rate falls by an e-th
    in that time, to CREEP_DEG_S.
    """
    decay_s = delays.latency_s + delays.fault_s
    falls_s = decay_s * math.log(max(1.0, abs(rate_deg_s) / CREEP_DEG_S))
    return falls_s + standstill_s(rate_deg_s, delays.latency_s, acceleration_deg_s2)
