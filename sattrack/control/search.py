"""Search patterns as pure functions of time: a spiral about a place, and a sweep along the track.

Both begin at rest in the centre: a pattern's speed grows over its first seconds.
"""

from __future__ import annotations

import math
from typing import NamedTuple

START_S = 2.0
"""Time over which a pattern comes up to its speed."""
_ROUNDS = 8


class SpiralPoint(NamedTuple):
    """Where a spiral is: degrees on the sky along and across the track."""

    along_deg: float
    cross_deg: float


def eased_s(elapsed_s: float) -> float:
    """Return the time that a pattern has run at full speed, when its speed grows smoothly over START_S.

    Twice differentiable: the speed follows 3u² - 2u³.
    """
    if elapsed_s <= 0.0:
        return 0.0
    if elapsed_s >= START_S:
        return elapsed_s - 0.5 * START_S
    u = elapsed_s / START_S
    return START_S * u**3 * (1.0 - 0.5 * u)


def spiral(elapsed_s: float, spacing_deg: float, speed_deg_s: float) -> SpiralPoint:
    """Return the point of an Archimedean spiral whose arms lie `spacing_deg` apart, run at one speed.

    The arc is that of r = b·θ with b the spacing over a turn: b/2·(θ·sqrt(1 + θ²) + asinh θ), solved for θ.
    """
    b = spacing_deg / (2.0 * math.pi)
    arc = eased_s(elapsed_s) * speed_deg_s / b
    theta = min(arc, math.sqrt(2.0 * arc))
    for _ in range(_ROUNDS):
        root = math.sqrt(1.0 + theta * theta)
        theta -= (0.5 * (theta * root + math.asinh(theta)) - arc) / root
    return SpiralPoint(b * theta * math.cos(theta), b * theta * math.sin(theta))


def spiral_acceleration_deg_s2(spacing_deg: float, speed_deg_s: float) -> float:
    """Return the most acceleration that a spiral asks for: it turns most sharply in its centre."""
    turning = speed_deg_s**2 * 4.0 * math.pi / spacing_deg
    return math.hypot(turning, 1.5 * speed_deg_s / START_S)


def sweep_s(elapsed_s: float, reach_s: float, period_s: float) -> float:
    """Return the along-track seconds of a sweep: ahead by `reach_s`, back through the centre, and so on."""
    return reach_s * math.sin(2.0 * math.pi * eased_s(elapsed_s) / period_s)
