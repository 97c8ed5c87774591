"""One direct-drive axis: a motion generator within rate and acceleration limits, and the servo behind it.

The generator turns what is asked (a rate, or a place to go) into a reference that never exceeds the limits.
The servo follows that reference with a finite bandwidth and a finite torque, so the axis has inertia.
Everything is a function of the seconds that pass; degrees throughout.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

STEP_S = 0.005
ARRIVED_DEG = 1e-5
ARRIVED_DEG_S = 1e-3
TORQUE_MARGIN = 1.5
"""The servo may accelerate this much harder than the generator asks for."""


@dataclass(slots=True)
class AxisDrive:
    """What one axis is built to do."""

    max_acceleration_deg_s2: float
    slew_rate_deg_s: float
    bandwidth_hz: float = 5.0
    damping: float = 1.0
    current_a_per_deg_s2: float = 0.15
    """Drive current for acceleration: stands for inertia over torque constant."""
    friction_a: float = 0.5


@dataclass(slots=True)
class Axis:
    """State of one axis: where it is, and what it was told."""

    drive: AxisDrive
    position_deg: float = 0.0
    velocity_deg_s: float = 0.0
    _reference_deg: float = 0.0
    _reference_deg_s: float = 0.0
    _rate_deg_s: float = 0.0
    _goal_deg: float | None = None
    acceleration_deg_s2: float = 0.0
    powered: bool = True

    def place(self, position_deg: float, rate_deg_s: float) -> None:
        """Put the axis somewhere, already moving at a rate: the state at power-up."""
        self.position_deg = self._reference_deg = position_deg
        self.velocity_deg_s = self._reference_deg_s = self._rate_deg_s = rate_deg_s

    def run(self, rate_deg_s: float) -> None:
        """Ask for a rate, held until something else is asked."""
        self._goal_deg = None
        self._rate_deg_s = rate_deg_s

    def go(self, goal_deg: float, goal_rate_deg_s: float) -> None:
        """Ask to join a point that is at `goal_deg` now and moves at `goal_rate_deg_s`."""
        self._goal_deg = goal_deg
        self._rate_deg_s = goal_rate_deg_s

    def coast(self) -> None:
        """Cut the power: friction alone acts from then on."""
        self._goal_deg = None
        self._rate_deg_s = 0.0
        self.powered = False

    @property
    def going(self) -> bool:
        """Whether a place that was asked for has not been reached."""
        return self._goal_deg is not None

    @property
    def current_a(self) -> float:
        """Drive current, amperes: what the acceleration takes, and friction."""
        friction = math.copysign(self.drive.friction_a, self.velocity_deg_s) if self.velocity_deg_s else 0.0
        return self.acceleration_deg_s2 * self.drive.current_a_per_deg_s2 + friction

    def advance(self, seconds: float) -> None:
        """Let time pass."""
        steps = max(1, round(seconds / STEP_S))
        dt = seconds / steps
        omega = 2.0 * math.pi * self.drive.bandwidth_hz
        stiffness = omega * omega
        drag = 2.0 * self.drive.damping * omega
        most = self.drive.max_acceleration_deg_s2 * TORQUE_MARGIN
        x, v = self.position_deg, self.velocity_deg_s
        acceleration = 0.0
        for _ in range(steps):
            # Reference and axis are compared at one instant, the step's beginning, and then moved alike:
            # otherwise a steady rate would leave a steady offset.
            behind, slow = self._reference_deg - x, self._reference_deg_s - v
            acceleration = self._advance_reference(dt) + stiffness * behind + drag * slow
            acceleration = max(-most, min(most, acceleration))
            x += (v + 0.5 * acceleration * dt) * dt
            v += acceleration * dt
        self.position_deg, self.velocity_deg_s = x, v
        self.acceleration_deg_s2 = acceleration

    def _advance_reference(self, dt: float) -> float:
        """Move the reference by one step; return its acceleration."""
        before = self._reference_deg_s
        change = self._wanted_rate(dt) - before
        if self._goal_deg is not None:
            self._goal_deg += self._rate_deg_s * dt
        if change:
            largest = self.drive.max_acceleration_deg_s2 * dt
            change = max(-largest, min(largest, change))
            self._reference_deg_s = before + change
        self._reference_deg += (before + 0.5 * change) * dt
        self._settle()
        return change / dt

    def _wanted_rate(self, dt: float) -> float:
        if self._goal_deg is None:
            return self._rate_deg_s
        ahead = self._goal_deg - self._reference_deg
        # Half of the limit leaves the generator room to brake exactly onto the goal in discrete steps.
        braking = math.sqrt(self.drive.max_acceleration_deg_s2 * abs(ahead))
        closing = min(braking, abs(ahead) / (4.0 * dt), self.drive.slew_rate_deg_s)
        return self._rate_deg_s + math.copysign(closing, ahead)

    def _settle(self) -> None:
        goal = self._goal_deg
        if goal is None or abs(goal - self._reference_deg) > ARRIVED_DEG:
            return
        if abs(self._reference_deg_s - self._rate_deg_s) < ARRIVED_DEG_S:
            self._reference_deg = goal
            self._reference_deg_s = self._rate_deg_s
            self._goal_deg = None
