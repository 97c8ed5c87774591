"""The way to a place in closed form: bounded rate, acceleration and jerk, as a function of time.

A trapezoid of rates, averaged over the time in which the bounded jerk builds up the full acceleration: the
average keeps the trapezoid's bounds on rate and acceleration; its jerk is that acceleration over that time.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True)
class _Leg:
    """A stretch of constant acceleration; `moment` is the integral of position up to its beginning."""

    begin_s: float
    position: float
    rate: float
    acceleration: float
    moment: float


@dataclass(slots=True)
class Trajectory:
    """From `-distance` at `rate` to rest at 0, degrees and seconds; `jerk` 0 for one that is not bounded.

    Where it cannot stop in time it passes its goal and comes back.
    """

    distance: float
    rate: float
    most_rate: float
    acceleration: float
    jerk: float = 0.0
    duration_s: float = field(init=False)
    _build_up_s: float = field(init=False)
    _legs: list[_Leg] = field(init=False)

    def __post_init__(self) -> None:
        """Lay out the legs of the trapezoid."""
        self._build_up_s = self.acceleration / self.jerk if self.jerk else 0.0
        begin, parts = self._begin()
        if parts[1][0] < self._build_up_s:
            # Without a cruise that long, acceleration goes from one extreme to the other at once.
            self._build_up_s *= 2.0
            begin, parts = self._begin()
        self._legs = [_Leg(-math.inf, begin, self.rate, 0.0, 0.0)]
        time_s = 0.0
        for seconds, acceleration in parts:
            if seconds > 0.0:
                position, rate, moment = self._moved(self._legs[-1], time_s)
                self._legs.append(_Leg(time_s, position, rate, acceleration, moment))
                time_s += seconds
        _, _, moment = self._moved(self._legs[-1], time_s)
        self._legs.append(_Leg(time_s, 0.0, 0.0, 0.0, moment))
        self.duration_s = time_s + self._build_up_s

    def at(self, time_s: float) -> tuple[float, float, float]:
        """Return position, rate and acceleration so long after the start."""
        if time_s >= self.duration_s:
            return 0.0, 0.0, 0.0
        leg = self._leg(time_s)
        position, rate, moment = self._moved(leg, time_s)
        span_s = self._build_up_s
        if not span_s:
            return position, rate, leg.acceleration
        before = self._moved(self._leg(time_s - span_s), time_s - span_s)
        return (moment - before[2]) / span_s, (position - before[0]) / span_s, (rate - before[1]) / span_s

    def _begin(self) -> tuple[float, tuple[tuple[float, float], ...]]:
        """Return where the trapezoid begins, and its parts."""
        # The average lags by half its span at the beginning, and not at the end, where all stands.
        begin = -self.distance + self.rate * self._build_up_s / 2.0
        return begin, self._accelerations(-begin)

    def _accelerations(self, distance: float) -> tuple[tuple[float, float], ...]:
        """Return seconds and acceleration of speeding up (or down), cruising and braking."""
        rate, most = self.rate, self.acceleration
        sense = math.copysign(1.0, distance - rate * abs(rate) / (2.0 * most))
        peak = math.sqrt(max(0.0, sense * distance * most + rate * rate / 2.0))
        peak = sense * min(peak, self.most_rate)
        to_peak_s = abs(peak - rate) / most
        braking_s = abs(peak) / most
        left = distance - 0.5 * (rate + peak) * to_peak_s - 0.5 * peak * braking_s
        cruise_s = max(0.0, left / peak) if peak else 0.0
        return (
            (to_peak_s, math.copysign(most, peak - rate)),
            (cruise_s, 0.0),
            (braking_s, -math.copysign(most, peak)),
        )

    def _leg(self, time_s: float) -> _Leg:
        found = self._legs[0]
        for leg in self._legs:
            if leg.begin_s > time_s:
                break
            found = leg
        return found

    @staticmethod
    def _moved(leg: _Leg, time_s: float) -> tuple[float, float, float]:
        """Return position, rate and the integral of position at a time on a leg."""
        t = time_s - leg.begin_s if leg.begin_s > -math.inf else time_s
        a, v, x = leg.acceleration, leg.rate, leg.position
        return (
            x + (v + 0.5 * a * t) * t,
            v + a * t,
            leg.moment + (x + (0.5 * v + a * t / 6.0) * t) * t,
        )
