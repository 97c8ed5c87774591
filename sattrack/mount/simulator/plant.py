"""A direct drive's servo and what it turns: inertia, friction that sticks, torque ripple, a limit of current.

Forces are told as the drive current that balances them, so that the drive's current is what the status shows.
Friction is Karnopp's (1985): an axis at rest stays there until more than the stiction acts on it; in motion,
Coulomb friction opposes it. The ripple is of the drive's making and gone without power. Structure on top of
the axis swings against its acceleration, unseen by the encoder, and rings down.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sattrack.mount.simulator.reference import Reference
    from sattrack.mount.simulator.settings import ServoSettings

STEP_S = 0.001
STEP_OF_BANDWIDTH = 0.2
TORQUE_MARGIN = 1.5
"""The servo may accelerate this much harder than the reference ever does, friction overcome."""
INTEGRAL_REST_DEG = 5e-7
"""Errors so small, a tenth of an encoder tic, are left: integrating them would make a sticking axis hunt."""
AT_REST_DEG_S = 1e-6


@dataclass(slots=True)
class Swing:
    """How structure on the axis lags behind it: a damped oscillator that the axis' acceleration drives."""

    deg_per_deg_s2: float
    frequency_hz: float
    decay_s: float
    deflection_deg: float = 0.0
    _rate_deg_s: float = 0.0

    def step(self, acceleration_deg_s2: float, seconds: float) -> None:
        """Let time pass at an acceleration of the axis; steps are short against the period."""
        omega = 2.0 * math.pi * self.frequency_hz
        still_deg = -self.deg_per_deg_s2 * acceleration_deg_s2
        force = omega * omega * (still_deg - self.deflection_deg) - 2.0 / self.decay_s * self._rate_deg_s
        self._rate_deg_s += force * seconds
        self.deflection_deg += self._rate_deg_s * seconds


@dataclass(slots=True)
class Plant:
    """State of one axis and its servo; position in degrees."""

    servo: ServoSettings
    max_acceleration_deg_s2: float
    swing: Swing | None = None
    position_deg: float = 0.0
    rate_deg_s: float = 0.0
    acceleration_deg_s2: float = 0.0
    current_a: float = 0.0
    _integral_a: float = 0.0

    @property
    def faultless(self) -> bool:
        """Whether nothing keeps the axis from following its reference exactly."""
        servo = self.servo
        needed_a = self.max_acceleration_deg_s2 * servo.inertia_a_per_deg_s2 + servo.friction_a
        return (
            servo.friction_feedforward == 1.0
            and servo.stiction_a <= servo.friction_a
            and not servo.ripple_a
            and not servo.integral_hz
            and self.swing is None
            and (servo.current_limit_a is None or servo.current_limit_a >= needed_a)
        )

    @property
    def friction_error_deg(self) -> float:
        """How far the axis is behind where stiffness alone balances friction and ripple."""
        servo = self.servo
        against_a = max(servo.friction_a, servo.stiction_a) + servo.ripple_a
        return against_a / servo.inertia_a_per_deg_s2 / (2.0 * math.pi * servo.bandwidth_hz) ** 2

    def place(self, position_deg: float, rate_deg_s: float) -> None:
        """Begin anew somewhere, at a rate."""
        self.position_deg, self.rate_deg_s, self.acceleration_deg_s2 = position_deg, rate_deg_s, 0.0
        self.current_a = self._integral_a = 0.0

    def follow_exactly(self, reference: Reference) -> None:
        """Be where the reference is."""
        servo = self.servo
        self.position_deg, self.rate_deg_s = reference.position_deg, reference.rate_deg_s
        self.acceleration_deg_s2 = reference.acceleration_deg_s2
        friction_a = math.copysign(servo.friction_a, self.rate_deg_s) if self.rate_deg_s else 0.0
        self.current_a = self.acceleration_deg_s2 * servo.inertia_a_per_deg_s2 + friction_a

    def follow(self, reference: Reference, seconds: float) -> None:
        """Let time pass for the reference and for the servo that follows it."""
        omega = 2.0 * math.pi * self.servo.bandwidth_hz
        steps = max(1, math.ceil(seconds / min(STEP_S, STEP_OF_BANDWIDTH / omega)))
        dt = seconds / steps
        stiffness, drag = omega * omega, 2.0 * self.servo.damping * omega
        for _ in range(steps):
            # Both are compared at one instant, the step's beginning, and then moved alike: otherwise a steady
            # rate would leave a steady offset.
            behind = reference.position_deg - self.position_deg
            slow = reference.rate_deg_s - self.rate_deg_s
            before = reference.rate_deg_s
            reference.step(dt)
            # The mean over the step: what it has to be for the reference to be where it will be.
            wanted = (reference.rate_deg_s - before) / dt + stiffness * behind + drag * slow
            self._drive(wanted, behind, before, dt)
            self.push(self.current_a, dt)

    def coast(self, seconds: float) -> None:
        """Let time pass without power: friction alone, until it stands."""
        self.current_a = self._integral_a = 0.0
        braking = self.servo.friction_a / self.servo.inertia_a_per_deg_s2
        if not self.rate_deg_s or not braking:
            self.position_deg += self.rate_deg_s * seconds
            self.acceleration_deg_s2 = 0.0
            return
        acceleration = -math.copysign(braking, self.rate_deg_s)
        moving_s = min(seconds, abs(self.rate_deg_s) / braking)
        self.position_deg += (self.rate_deg_s + 0.5 * acceleration * moving_s) * moving_s
        stands = moving_s < seconds
        self.rate_deg_s = 0.0 if stands else self.rate_deg_s + acceleration * moving_s
        self.acceleration_deg_s2 = 0.0 if stands else acceleration

    def _drive(self, wanted_deg_s2: float, behind_deg: float, reference_rate_deg_s: float, dt: float) -> None:
        """Set the current that the servo sends for an acceleration."""
        servo = self.servo
        against_a = max(servo.friction_a, servo.stiction_a) + servo.ripple_a
        wanted_a = wanted_deg_s2 * servo.inertia_a_per_deg_s2
        if servo.friction_feedforward and reference_rate_deg_s:
            wanted_a += math.copysign(servo.friction_feedforward * servo.friction_a, reference_rate_deg_s)
        limit_a = self.max_acceleration_deg_s2 * TORQUE_MARGIN * servo.inertia_a_per_deg_s2 + against_a
        if servo.current_limit_a is not None:
            limit_a = min(limit_a, servo.current_limit_a)
        self.current_a = max(-limit_a, min(limit_a, wanted_a + self._integral_a))
        if servo.integral_hz and abs(behind_deg) > INTEGRAL_REST_DEG and abs(self.current_a) < limit_a:
            stiffness = (2.0 * math.pi * servo.bandwidth_hz) ** 2
            gain = 2.0 * math.pi * servo.integral_hz * stiffness * servo.inertia_a_per_deg_s2
            self._integral_a += gain * behind_deg * dt
            # More than from all friction one way to all the other way is never of use.
            most_a = 2.0 * against_a
            self._integral_a = max(-most_a, min(most_a, self._integral_a))

    def push(self, current_a: float, seconds: float) -> None:
        """Let a short time pass by Newton's law under a drive's current, its ripple and friction."""
        servo = self.servo
        force_a = current_a
        if servo.ripple_a:
            angle = math.radians(self.position_deg) * servo.ripple_per_turn
            force_a += servo.ripple_a * math.sin(angle)
        rate = self.rate_deg_s
        stiction_a = servo.stiction_a or servo.friction_a
        if abs(rate) < AT_REST_DEG_S and abs(force_a) <= stiction_a:
            self.rate_deg_s = self.acceleration_deg_s2 = 0.0
            acceleration = 0.0
        else:
            friction_a = math.copysign(servo.friction_a, rate if rate else force_a)
            acceleration = (force_a - friction_a) / servo.inertia_a_per_deg_s2
            rate_after = rate + acceleration * seconds
            if rate * rate_after < 0.0 and abs(force_a) <= stiction_a:
                # It came to rest within the step, and friction holds it there.
                stop_s = -rate / acceleration
                self.position_deg += 0.5 * rate * stop_s
                self.rate_deg_s = 0.0
            else:
                self.position_deg += (rate + 0.5 * acceleration * seconds) * seconds
                self.rate_deg_s = rate_after
            self.acceleration_deg_s2 = acceleration
        if self.swing is not None:
            self.swing.step(acceleration, seconds)
