"""One direct-drive axis: a reference within the limits of motion, and the plant that follows it.

Everything is a function of the seconds that pass; degrees throughout.

* The way to a place is in closed form: a trapezoid of rates, averaged over the time in which the bounded jerk
  builds up the full acceleration. The average keeps the trapezoid's bounds on rate and acceleration; its jerk
  is that acceleration over that time.
* Each step of the reference is in closed form: one of a second and a thousand of a millisecond lead to the
  same place.
* The plant is a servo and what it turns: inertia, friction that sticks, torque ripple, a limit of current.
  Forces are given as the drive current that balances them, so that the status shows that current. Friction is
  Karnopp's (1985): an axis at rest stays there until more than the stiction acts on it; in motion, Coulomb
  friction opposes it. The drive makes the ripple; without power there is none. Structure on top of the axis
  swings against its acceleration, unseen by the encoder, and rings down.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sattrack.mount.model import AxisLimits
    from sattrack.mount.simulator.profile import ServoSettings, SimulatorProfile


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
            self._step_path(self._way, seconds)
            return
        rate, asked = abs(self.rate_deg_s), abs(self._asked_deg_s)
        fastest = rate if rate > asked else asked
        reach = fastest * (seconds + fastest / self.max_acceleration_deg_s2)
        low, high = self.travel_deg
        if self.position_deg - low > reach and high - self.position_deg > reach:
            self.limited = False
            self._step_ramp(seconds, self._asked_deg_s)
            return
        self._step_near_limit(seconds, fastest)

    def _step_near_limit(self, seconds: float, fastest: float) -> None:
        """Let time pass within reach of the limit: in small steps from where braking may begin."""
        braking = fastest * fastest / self.max_acceleration_deg_s2
        low, high = self.travel_deg
        while seconds > 0.0:
            room = min(self.position_deg - low, high - self.position_deg) - braking
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

    def _step_path(self, way: Trajectory, seconds: float) -> None:
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
        """Let time pass for the reference and for the servo that follows it.

        A simulated pass spends much of its time here: what stays the same from step to step is computed once.
        """
        servo = self.servo
        omega = 2.0 * math.pi * servo.bandwidth_hz
        steps = max(1, math.ceil(seconds / min(STEP_S, STEP_OF_BANDWIDTH / omega)))
        dt = seconds / steps
        stiffness, drag, inertia = omega * omega, 2.0 * servo.damping * omega, servo.inertia_a_per_deg_s2
        ahead_a = servo.friction_feedforward * servo.friction_a
        against_a = max(servo.friction_a, servo.stiction_a) + servo.ripple_a
        limit_a = self.max_acceleration_deg_s2 * TORQUE_MARGIN * inertia + against_a
        if servo.current_limit_a is not None:
            limit_a = min(limit_a, servo.current_limit_a)
        gain = 2.0 * math.pi * servo.integral_hz * omega**2 * inertia
        # More than from all friction one way to all the other way is never of use.
        most_a = 2.0 * against_a
        for _ in range(steps):
            # Both are compared at one instant, the step's beginning, and then moved alike: otherwise a steady
            # rate would leave a steady offset.
            behind = reference.position_deg - self.position_deg
            slow = reference.rate_deg_s - self.rate_deg_s
            before = reference.rate_deg_s
            reference.step(dt)
            # The mean over the step: what it has to be for the reference to be where it will be.
            wanted = (reference.rate_deg_s - before) / dt + stiffness * behind + drag * slow
            current_a = wanted * inertia
            if before:
                current_a += math.copysign(ahead_a, before)
            current_a += self._integral_a
            if -limit_a < current_a < limit_a:
                if gain and abs(behind) > INTEGRAL_REST_DEG:
                    self._integral_a = max(-most_a, min(most_a, self._integral_a + gain * behind * dt))
            else:
                current_a = math.copysign(limit_a, current_a)
            self.current_a = current_a
            self.push(current_a, dt)

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


SAME = 1e-10
SETTLED_DEG = 1e-4


@dataclass(slots=True)
class Axis:
    """One axis with its drive; at the ends of `travel_deg` it stops in any case."""

    limits: AxisLimits
    hardware: SimulatorProfile
    travel_deg: tuple[float, float] = ANYWHERE
    reference: Reference = field(init=False)
    plant: Plant = field(init=False)
    powered: bool = True
    _faultless: bool = field(init=False)
    _settled_deg: float = field(init=False)

    def __post_init__(self) -> None:
        """Build the drive, at rest at 0."""
        limits, hardware = self.limits, self.hardware
        self.reference = Reference(
            limits.max_acceleration_deg_s2, limits.slew_rate_deg_s, hardware.slew_jerk_deg_s3, self.travel_deg
        )
        swing = None
        if hardware.settling_arcsec:
            swing = Swing(hardware.settling_arcsec / 3600.0, hardware.settling_hz, hardware.settling_s)
        self.plant = Plant(hardware.servo, limits.max_acceleration_deg_s2, swing)
        self._faultless = self.plant.faultless
        # Friction leaves an error that the servo's stiffness alone cannot take away.
        self._settled_deg = SETTLED_DEG + 2.0 * self.plant.friction_error_deg

    @property
    def position_deg(self) -> float:
        """Where the axis, and with it the encoder, is."""
        return self.plant.position_deg

    @property
    def velocity_deg_s(self) -> float:
        """How fast it turns."""
        return self.plant.rate_deg_s

    @property
    def current_a(self) -> float:
        """The drive's current, amperes."""
        return self.plant.current_a

    @property
    def going(self) -> bool:
        """Whether a place that was asked for has not been reached, or the servo has not settled there."""
        behind_deg = self.reference.position_deg - self.plant.position_deg
        return self.reference.going or abs(behind_deg) > self._settled_deg

    @property
    def swing_deg(self) -> float:
        """How far what is mounted on the axis swings ahead of it."""
        return 0.0 if self.plant.swing is None else self.plant.swing.deflection_deg

    def place(self, position_deg: float, rate_deg_s: float) -> None:
        """Put the axis somewhere, already moving at a rate, with power: the state at power-up."""
        self.reference.place(position_deg, rate_deg_s)
        self.plant.place(position_deg, rate_deg_s)
        self.powered = True

    def run(self, rate_deg_s: float) -> None:
        """Ask for a rate, held until something else is asked."""
        self.reference.run(rate_deg_s)

    def go(self, goal_deg: float, goal_rate_deg_s: float) -> None:
        """Ask to join a point that is at `goal_deg` now and moves at `goal_rate_deg_s`."""
        self.reference.go(goal_deg, goal_rate_deg_s)

    def coast(self) -> None:
        """Cut the power: friction alone acts from then on."""
        self.powered = False

    def advance(self, seconds: float) -> None:
        """Let time pass."""
        reference, plant = self.reference, self.plant
        if not self.powered:
            plant.coast(seconds)
            reference.place(plant.position_deg, plant.rate_deg_s)
        elif (
            self._faultless
            and abs(reference.position_deg - plant.position_deg) < SAME
            and abs(reference.rate_deg_s - plant.rate_deg_s) < SAME
        ):
            reference.step(seconds)
            plant.follow_exactly(reference)
        else:
            plant.follow(reference, seconds)
