"""Operator's biases, spread over time: a nudge moves the target without a step in its rate.

Along-track seconds and cross-track degrees each follow a critically damped response, in closed form, so the
bias at any instant is known exactly and replays to the last bit.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import dataclass, field

RESPONSE_S = 0.3
"""Time constant: a nudge is within 1 % of its end after 2 s."""
SETTLED_SPANS = 40.0


@dataclass(frozen=True, slots=True)
class _Segment:
    start_utc_s: float
    goal: float
    gap: float
    slope: float

    def value(self, utc_s: float) -> float:
        spans = (utc_s - self.start_utc_s) / RESPONSE_S
        if spans <= 0.0:
            return self.goal + self.gap
        if spans > SETTLED_SPANS:
            return self.goal
        return self.goal + (self.gap + (self.slope * RESPONSE_S + self.gap) * spans) * math.exp(-spans)

    def rate(self, utc_s: float) -> float:
        spans = (utc_s - self.start_utc_s) / RESPONSE_S
        if spans < 0.0 or spans > SETTLED_SPANS:
            return 0.0
        lead = self.slope * RESPONSE_S + self.gap
        return (lead - self.gap - lead * spans) / RESPONSE_S * math.exp(-spans)


@dataclass(slots=True)
class Blend:
    """One bias over time: `goal` is what was asked for, `value` what is applied at an instant."""

    start: float = 0.0
    _segments: list[_Segment] = field(default_factory=list)
    _starts: list[float] = field(default_factory=list)

    @property
    def goal(self) -> float:
        """What was last asked for."""
        return self._segments[-1].goal if self._segments else self.start

    def ask(self, goal: float, now_utc_s: float) -> None:
        """Ask for another value from an instant on; instants rise."""
        value = self.value(now_utc_s)
        slope = self._segments[-1].rate(now_utc_s) if self._segments else 0.0
        self._segments.append(_Segment(now_utc_s, goal, value - goal, slope))
        self._starts.append(now_utc_s)

    def value(self, utc_s: float) -> float:
        """Return what is applied at an instant."""
        index = bisect_right(self._starts, utc_s) - 1
        return self._segments[index].value(utc_s) if index >= 0 else self.start
