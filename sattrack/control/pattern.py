"""A search pattern at work: from when to when, and what it adds along and across the track.

Search patterns as pure functions of time: a spiral about a place, and a sweep along the track.

Both begin at rest in the centre: a pattern's speed grows over its first seconds.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

from sattrack.control.offset import REST, State

if TYPE_CHECKING:
    from sattrack.control.course import Course

START_S = 2.0
"""Time over which a pattern comes up to its speed."""
_ROUNDS = 8


class SpiralPoint(NamedTuple):
    """Where a spiral is, degrees on the sky along and across the track, and its rates, degrees a second."""

    along_deg: float
    cross_deg: float
    along_deg_s: float
    cross_deg_s: float


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


def eased_rate(elapsed_s: float) -> float:
    """Return the share of its full speed that a pattern has."""
    u = min(1.0, max(0.0, elapsed_s / START_S))
    return u * u * (3.0 - 2.0 * u)


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
    turning = speed_deg_s * eased_rate(elapsed_s) / math.sqrt(1.0 + theta * theta)
    c, s = math.cos(theta), math.sin(theta)
    return SpiralPoint(b * theta * c, b * theta * s, turning * (c - theta * s), turning * (s + theta * c))


def spiral_lasts_s(reach_deg: float, spacing_deg: float, speed_deg_s: float) -> float:
    """Return how long a spiral takes to come as far out as `reach_deg`, seconds."""
    b = spacing_deg / (2.0 * math.pi)
    theta = reach_deg / b
    arc_deg = 0.5 * b * (theta * math.sqrt(1.0 + theta * theta) + math.asinh(theta))
    return arc_deg / speed_deg_s + 0.5 * START_S


def spiral_acceleration_deg_s2(spacing_deg: float, speed_deg_s: float) -> float:
    """Return the most acceleration that a spiral asks for: it turns most sharply in its centre."""
    turning = speed_deg_s**2 * 4.0 * math.pi / spacing_deg
    return math.hypot(turning, 1.5 * speed_deg_s / START_S)


def sweep_s(elapsed_s: float, reach_s: float, period_s: float) -> float:
    """Return the along-track seconds of a sweep: ahead by `reach_s`, back through the centre, and so on."""
    return reach_s * math.sin(2.0 * math.pi * eased_s(elapsed_s) / period_s)


def sweep_rate(elapsed_s: float, reach_s: float, period_s: float) -> float:
    """Return the rate of a sweep, seconds a second."""
    turning = 2.0 * math.pi / period_s
    return reach_s * turning * eased_rate(elapsed_s) * math.cos(turning * eased_s(elapsed_s))


_DIFFERENCE_S = 1e-3


@dataclass(frozen=True, slots=True)
class Pattern:
    """A spiral (degrees, degrees a second) or a sweep (seconds, seconds), between two instants; UTC.

    `how` is "spiral", with its spacing and speed, or "sweep", with its reach and period.
    """

    how: str
    first: float
    second: float
    begins_utc_s: float
    ends_utc_s: float

    def runs(self, utc_s: float) -> bool:
        """Tell whether it acts at an instant."""
        return self.begins_utc_s <= utc_s < self.ends_utc_s

    def ended(self, utc_s: float) -> Pattern:
        """Return the same, ending at an instant."""
        return replace(self, ends_utc_s=utc_s)

    def states(self, utc_s: float, along: State, course: Course) -> tuple[State, State]:
        """Return what it adds, with rates: seconds along and degrees across, to what is in force along.

        Accelerations are left at 0. A spiral keeps its shape on the sky while the satellite's pace changes.
        """
        elapsed_s = utc_s - self.begins_utc_s
        if self.how == "sweep":
            value = sweep_s(elapsed_s, self.first, self.second)
            return State(value, sweep_rate(elapsed_s, self.first, self.second), 0.0), REST
        point = spiral(elapsed_s, self.first, self.second)
        going = course.going(utc_s + along.value)
        pace = going.pace_deg_s
        ahead_s = point.along_deg / pace
        rate = (point.along_deg_s - ahead_s * going.pace_rate * (1.0 + along.rate)) / pace
        return State(ahead_s, rate, 0.0), State(point.cross_deg, point.cross_deg_s, 0.0)

    def full_states(self, utc_s: float, along: State, course: Course) -> tuple[State, State]:
        """Return what it adds, with rates and accelerations."""
        here = self.states(utc_s, along, course)
        later = self.states(utc_s + _DIFFERENCE_S, along, course)
        sooner = self.states(utc_s - _DIFFERENCE_S, along, course)
        ahead, left = (
            State(h.value, h.rate, (n.rate - s.rate) / (2.0 * _DIFFERENCE_S))
            for h, n, s in zip(here, later, sooner, strict=True)
        )
        return ahead, left
