"""What an axis is asked to do, as a smooth reference within the limits of rate and acceleration.

Every step is in closed form, so that one of a second and a thousand of a millisecond lead to the same place.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from sattrack.mount.simulator.trajectory import Trajectory

LIMIT_STEP_S = 0.002
ANYWHERE = (-math.inf, math.inf)


@dataclass(slots=True)
class Reference:
    """Position, rate and acceleration that the servo is to follow, degrees and seconds.

    It never passes `travel_deg`, the lowest and the highest angle, wherever it is sent.
    """

    max_acceleration_deg_s2: float
    slew_rate_deg_s: float
    jerk_deg_s3: float = 0.0
    travel_deg: tuple[float, float] = ANYWHERE
    position_deg: float = 0.0
    rate_deg_s: float = 0.0
    acceleration_deg_s2: float = 0.0
    limited: bool = False
    """Whether the limit kept it from what was asked in the last step."""
    _asked_deg_s: float = 0.0
    _way: Trajectory | None = None
    _way_s: float = 0.0
    _goal_deg: float = 0.0

    @property
    def going(self) -> bool:
        """Whether a place that was asked for has not been reached."""
        return self._way is not None

    @property
    def _room_deg(self) -> float:
        """How far it is to the nearer end of its travel."""
        low, high = self.travel_deg
        return min(self.position_deg - low, high - self.position_deg)

    def place(self, position_deg: float, rate_deg_s: float) -> None:
        """Begin anew somewhere, at a rate."""
        self.position_deg, self.rate_deg_s, self.acceleration_deg_s2 = position_deg, rate_deg_s, 0.0
        self._asked_deg_s, self._way, self.limited = rate_deg_s, None, False

    def run(self, rate_deg_s: float) -> None:
        """Ask for a rate, held until something else is asked."""
        self._way = None
        self._asked_deg_s = rate_deg_s

    def go(self, goal_deg: float, goal_rate_deg_s: float) -> None:
        """Ask to join a point that is at `goal_deg` now and moves at `goal_rate_deg_s`."""
        self._asked_deg_s, self._goal_deg, self._way_s = goal_rate_deg_s, goal_deg, 0.0
        self._way = Trajectory(
            goal_deg - self.position_deg,
            self.rate_deg_s - goal_rate_deg_s,
            self.slew_rate_deg_s,
            self.max_acceleration_deg_s2,
            self.jerk_deg_s3,
        )

    def step(self, seconds: float) -> None:
        """Let time pass."""
        if self._way is not None:
            self._step_way(self._way, seconds)
            return
        fastest = max(abs(self.rate_deg_s), abs(self._asked_deg_s))
        reach = fastest * (seconds + fastest / self.max_acceleration_deg_s2)
        if self._room_deg > reach:
            self.limited = False
            self._step_ramp(seconds, self._asked_deg_s)
            return
        self._step_near_limit(seconds, fastest)

    def _step_near_limit(self, seconds: float, fastest: float) -> None:
        """Let time pass within reach of the limit: in small steps from where braking may begin."""
        braking = fastest * fastest / self.max_acceleration_deg_s2
        while seconds > 0.0:
            room = self._room_deg - braking
            if room > fastest * LIMIT_STEP_S:
                step_s, allowed = min(seconds, room / fastest), self._asked_deg_s
            else:
                step_s, allowed = min(seconds, LIMIT_STEP_S), self._allowed(LIMIT_STEP_S)
            self.limited = allowed != self._asked_deg_s
            if not allowed and not self.rate_deg_s:
                self.acceleration_deg_s2 = 0.0
                return
            self._step_ramp(step_s, allowed)
            seconds -= step_s

    def _step_way(self, way: Trajectory, seconds: float) -> None:
        self._way_s += seconds
        self._goal_deg += self._asked_deg_s * seconds
        ahead, rate, self.acceleration_deg_s2 = way.at(self._way_s)
        self.position_deg = self._goal_deg + ahead
        self.rate_deg_s = self._asked_deg_s + rate
        if self._way_s >= way.duration_s:
            self._way = None

    def _step_ramp(self, seconds: float, asked_deg_s: float) -> None:
        change = asked_deg_s - self.rate_deg_s
        if not change:
            self.acceleration_deg_s2 = 0.0
            self.position_deg += self.rate_deg_s * seconds
            return
        acceleration = math.copysign(self.max_acceleration_deg_s2, change)
        ramp_s = min(seconds, change / acceleration)
        self.position_deg += (self.rate_deg_s + 0.5 * acceleration * ramp_s) * ramp_s
        if ramp_s < seconds:
            self.position_deg += asked_deg_s * (seconds - ramp_s)
            self.rate_deg_s, self.acceleration_deg_s2 = asked_deg_s, 0.0
        else:
            self.rate_deg_s += acceleration * ramp_s
            self.acceleration_deg_s2 = acceleration

    def _allowed(self, seconds: float) -> float:
        """Return what of the rate asked for leaves room to brake before the limit."""
        most = self.max_acceleration_deg_s2
        asked = self._asked_deg_s
        toward = asked if asked else self.rate_deg_s
        low, high = self.travel_deg
        room = self.position_deg - low if math.copysign(1.0, toward) < 0.0 else high - self.position_deg
        # Slower than at full braking, by what a step may add.
        fastest = math.sqrt(2.0 * most * max(0.0, room)) - 2.0 * most * seconds
        return math.copysign(min(abs(asked), max(0.0, fastest)), asked)
