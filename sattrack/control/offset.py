"""One offset over time: its total, its rate, and changes spread so that the mount can follow them.

Every change is a quintic in time from the value, rate and acceleration of its beginning to the wanted line,
so value, rate and acceleration are continuous, and the end is reached exactly and not merely approached.

Search patterns are pure functions of time: a spiral about a place, and a sweep along the track. Both begin
at rest in the centre: a pattern's speed grows over its first seconds.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from sattrack.control.target import Course

SHORTEST_S = 1.5
LONGEST_S = 60.0
GROWTH = 1.1
SAMPLES = 24
KEPT = 128
"""Changes that are remembered, six seconds of one a tick: earlier instants are asked for by nobody."""


class State(NamedTuple):
    """Value, rate a second and acceleration a second squared, in the offset's own unit."""

    value: float
    rate: float
    acceleration: float


REST = State(0.0, 0.0, 0.0)


def added(*states: State) -> State:
    """Return what several offsets make together."""
    values, rates, accelerations = zip(*states, strict=True)
    return State(sum(values), sum(rates), sum(accelerations))


class ChangeLimits(NamedTuple):
    """What a change may ask of the mount, in the offset's own unit: rate and acceleration."""

    rate: float
    acceleration: float


@dataclass(frozen=True, slots=True)
class _Change:
    begins_utc_s: float
    seconds: float
    coefficients: tuple[float, float, float, float, float, float]
    total: float
    """Value at the end of the change."""
    rate: float
    """Rate at the end."""
    curve: float = 0.0
    """Acceleration from then on."""

    def state(self, utc_s: float) -> State:
        if utc_s >= self.begins_utc_s + self.seconds:
            return State(self.total_at(utc_s), self.rate_at(utc_s), self.curve)
        c0, c1, c2, c3, c4, c5 = self.coefficients
        u = max(0.0, (utc_s - self.begins_utc_s) / self.seconds)
        value = c0 + u * (c1 + u * (c2 + u * (c3 + u * (c4 + u * c5))))
        rate = c1 + u * (2.0 * c2 + u * (3.0 * c3 + u * (4.0 * c4 + u * 5.0 * c5)))
        acceleration = 2.0 * c2 + u * (6.0 * c3 + u * (12.0 * c4 + u * 20.0 * c5))
        return State(value, rate / self.seconds, acceleration / self.seconds**2)

    def total_at(self, utc_s: float) -> float:
        since_s = utc_s - self.begins_utc_s - self.seconds
        return self.total + since_s * (self.rate + 0.5 * self.curve * since_s)

    def rate_at(self, utc_s: float) -> float:
        return self.rate + self.curve * (utc_s - self.begins_utc_s - self.seconds)


@dataclass(slots=True)
class Offset:
    """An offset: `total_at` is what is asked for, `state` what is applied; instants of changes never fall.

    `start` is what it is before its first change.
    """

    start: float = 0.0
    _changes: list[_Change] = field(default_factory=list)
    _begins: list[float] = field(default_factory=list)

    @property
    def rate(self) -> float:
        """Rate asked for, a second."""
        return self._changes[-1].rate if self._changes else 0.0

    def total_at(self, utc_s: float) -> float:
        """Return the total asked for as of an instant: the line that the offset is on or on its way to."""
        return self._changes[-1].total_at(utc_s) if self._changes else self.start

    def state(self, utc_s: float) -> State:
        """Return what is applied at an instant."""
        index = bisect_right(self._begins, utc_s) - 1
        if index >= 0:
            return self._changes[index].state(utc_s)
        return State(self.start, 0.0, 0.0)

    @property
    def idle(self) -> bool:
        """Whether it never was anything but nothing."""
        return self.start == 0.0 and not self._changes

    @property
    def known_since_utc_s(self) -> float:
        """From when on it is known what was applied: older changes are forgotten where there were many."""
        return self._begins[0] if len(self._begins) >= KEPT else float("-inf")

    def ended_utc_s(self) -> float:
        """Return the instant at which the last change is over; negative infinity where there was none."""
        last = self._changes[-1] if self._changes else None
        return float("-inf") if last is None else last.begins_utc_s + last.seconds

    def add(self, amount: float, begins_utc_s: float, bounds: ChangeLimits) -> None:
        """Add to the total; a rate goes on."""
        self._change(self.total_at(begins_utc_s) + amount, self.rate, begins_utc_s, bounds)

    def set(self, total: float, begins_utc_s: float, bounds: ChangeLimits) -> None:
        """Go to a total as soon as the bounds allow, and rest there."""
        self._change(total, 0.0, begins_utc_s, bounds)

    def run(self, rate: float, begins_utc_s: float, bounds: ChangeLimits) -> None:
        """Change by `rate` a second from an instant on."""
        # The line's foot is chosen so that the change is a plain ramp of the rate.
        now = self.state(begins_utc_s)
        foot = now.value + 0.5 * (now.rate - rate) * SHORTEST_S
        self._change(foot, rate, begins_utc_s, bounds)

    def gradual(self, total: float, seconds: float, begins_utc_s: float, bounds: ChangeLimits) -> None:
        """Reach a total in so many seconds, or as soon after as the bounds allow."""
        self._change(total, 0.0, begins_utc_s, bounds, max(seconds, SHORTEST_S))

    def stop(self, begins_utc_s: float, bounds: ChangeLimits) -> None:
        """Come to rest about where the offset is: the total is what is reached."""
        now = self.state(begins_utc_s)
        self._change(now.value + 0.5 * now.rate * SHORTEST_S, 0.0, begins_utc_s, bounds)

    def reset(self, begins_utc_s: float, bounds: ChangeLimits) -> None:
        """Take the offset away."""
        self._change(0.0, 0.0, begins_utc_s, bounds)

    def take_over(
        self,
        moving: State,
        total: float,
        begins_utc_s: float,
        bounds: ChangeLimits,
        rate: float = 0.0,
        curve: float = 0.0,
        seconds: float = SHORTEST_S,
    ) -> None:
        """Go from where the offset is, together with what something else does until then, to a total.

        With a rate the total is that of the beginning, and goes on; `curve` is what the rate gains. It takes
        so many seconds, or as long as the bounds ask.
        """
        self._change(total, rate, begins_utc_s, bounds, seconds, moving, curve)

    def keep(self, moving: State, begins_utc_s: float, bounds: ChangeLimits) -> None:
        """Come to rest about where the offset is together with what something else does until then."""
        now = added(self.state(begins_utc_s), moving)
        self._change(now.value + 0.5 * now.rate * SHORTEST_S, 0.0, begins_utc_s, bounds, moving=moving)

    def give_up(self, begins_utc_s: float) -> State:
        """Be nothing from an instant on, at once, and return what the offset is then, for another to take."""
        now = self.state(begins_utc_s)
        self._append(_Change(begins_utc_s, 1.0, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0), 0.0, 0.0))
        return now

    def _change(
        self,
        foot: float,
        rate: float,
        begins_utc_s: float,
        bounds: ChangeLimits,
        seconds: float = SHORTEST_S,
        moving: State = REST,
        curve: float = 0.0,
    ) -> None:
        """Go over to the parabola with `foot` and `rate` at the beginning, within the bounds."""
        now = added(self.state(begins_utc_s), moving)
        if now.rate == now.acceleration == rate == curve == 0.0:
            # From rest to rest the quintic's peaks are known: 15/8 and 10/sqrt(3) of way and time.
            way = abs(foot - now.value)
            least = max(1.875 * way / bounds.rate, math.sqrt(5.7735 * way / bounds.acceleration))
            seconds = max(seconds, min(LONGEST_S, least))
        change = _joined(now, foot, rate, begins_utc_s, seconds, curve)
        while seconds < LONGEST_S and not _within(change, now, bounds):
            seconds *= GROWTH
            change = _joined(now, foot, rate, begins_utc_s, seconds, curve)
        self._append(change)

    def _append(self, change: _Change) -> None:
        self._changes = [*self._changes, change]
        if len(self._changes) > KEPT:
            forgotten, *self._changes = self._changes
            self.start = forgotten.state(self._changes[0].begins_utc_s).value
        self._begins = [one.begins_utc_s for one in self._changes]


def _joined(
    now: State, foot: float, rate: float, begins_utc_s: float, seconds: float, curve: float
) -> _Change:
    total = foot + seconds * (rate + 0.5 * curve * seconds)
    way = total - now.value
    rate += curve * seconds
    v0, v1 = now.rate * seconds, rate * seconds
    a0, a1 = now.acceleration * seconds**2, curve * seconds**2
    coefficients = (
        now.value,
        v0,
        0.5 * a0,
        10.0 * way - 6.0 * v0 - 4.0 * v1 - 1.5 * a0 + 0.5 * a1,
        -15.0 * way + 8.0 * v0 + 7.0 * v1 + 1.5 * a0 - a1,
        6.0 * way - 3.0 * (v0 + v1) - 0.5 * a0 + 0.5 * a1,
    )
    return _Change(begins_utc_s, seconds, coefficients, total, rate, curve)


def _within(change: _Change, now: State, bounds: ChangeLimits) -> bool:
    """Tell whether a change keeps to the bounds, or at least to what it begins and ends with."""
    most_rate = max(bounds.rate, abs(now.rate), abs(change.rate))
    most_acceleration = max(bounds.acceleration, abs(now.acceleration), abs(change.curve))
    steps = (change.begins_utc_s + change.seconds * i / SAMPLES for i in range(SAMPLES + 1))
    states = [change.state(t) for t in steps]
    return all(abs(s.rate) <= most_rate and abs(s.acceleration) <= most_acceleration for s in states)


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
