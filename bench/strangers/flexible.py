"""A mount that speaks the Xerxes protocol: flexible, wind-blown, direct drives run by a microcontroller.

An axis is a motor and a telescope joined by a lightly damped spring; one axis has its encoder on the
telescope, the other on the motor. A cascaded loop of 1 kHz turns it: position, PI velocity, disturbance
observer, notch. Encoders are read at the start of a 50 ms turn; commands that have come by then are obeyed at
the start of the next. Angles are in degrees, rates in degrees per second, times in seconds since switch-on;
torques are divided by the inertia of the axis, so they are accelerations.
"""

from __future__ import annotations

import argparse
import cmath
import math
import random
import socket
import struct
import time
from collections import deque
from dataclasses import dataclass, fields, replace
from typing import Any, NamedTuple

TURN_S = 0.05
TICK_S = 0.015625  # of the clock behind a Windows Forms timer
STEP_S = 0.001
PIECE = 5  # steps run with the same gust, coupling and rate that is asked
SIDEREAL_DEG_S = 360.98564736629 / 86400.0
TIC_DEG = 360.0 / 2.0**26
TICS10_PER_DEG = 10.0 / TIC_DEG
GUIDE_TICS10 = 3500.0
ARCSEC = 1.0 / 3600.0
SITE_ELEVATION_M = 50.0
FULL_DEG, HALF_DEG, POLE_DEG, DEG_PER_HOUR = 360.0, 180.0, 90.0, 15.0
WRAP_DEG = 270.0  # a slew goes no further from home

# the axis
RESONANCE_HZ, MASS_RATIO, RESONANCE_DAMPING = (6.0, 25.0), (0.5, 3.0), (0.01, 0.04)
NOTCH_ERROR = (0.01, 0.04)  # how wrong the notch is about the resonance
NOTCH_DEPTH, NOTCH_WIDTHS = 0.05, (0.3, 0.5, 0.8)
RATE_FILTER_S = 0.001
PI_CORNER, OBSERVER_CORNER = 0.1, 0.12  # of the bandwidth and the damping
LEAST_GAIN_MARGIN, LEAST_PHASE_MARGIN_DEG = 2.0, 40.0
LOWERED, LEAST_HZ = 0.94, 0.05  # the bandwidth is lowered by this factor, as far as this
SHAPER, SHAPER_DAMPING = 3.0, 0.9  # corner of the prefilter, of the bandwidth
UNWIND = 0.5
COUPLING = 0.01
SERVO_NOISE = 0.25  # of the noise of one encoder reading: the drive averages
GUST_TIME_S, BEND_TIME_S = (2.0, 5.0), 0.3
SHAKEN_ARCSEC, BENT_ARCSEC = 0.15, 0.25  # by gusts: what the servo has to hold, and what no encoder sees
GUST_MOST_DEG_S2 = 0.4
STICTION_DEG, FRICTION_DEG, BRISTLE_DEG, STRIBECK_DEG_S = 10.0 * ARCSEC, 8.0 * ARCSEC, 2.0 * ARCSEC, 0.02
COAST_DEG_S2, COAST_PER_S = 0.6, 1.5  # paper silent: drag of an axis without drive

# slews
SLEW_ACCELERATION, SLEW_PER_S = 0.8, 2.5
ARRIVED_DEG, ARRIVED_TURNS, ARRIVE_MOST_S = 0.7 * ARCSEC, 8, 20.0
GAP_DEG = 0.3 * ARCSEC
REST_DEG_S = 0.002
LATE_S = 2.0
STALL_EVERY_S = 8.0

HEADER = 0x5555AAAA
COMMAND = struct.Struct("<Qq4d2q2i10B")
STATUS = struct.Struct("<8s3dqdq6dq2d2i24B")
TARGET_DEC, TARGET_RA, FINE_DEC, FINE_RA, GUIDE_RA, GUIDE_DEC = 2, 3, 6, 7, 8, 9
RATE_AT = {"move_ra": 5, "move_dec": 4}
FLAG_AT = {"abort": 11, "move_ra": 13, "move_dec": 14, "park": 15, "pulse": 16, "slew": 17, "sync": 18}
PRIORITY = (("abort",), ("park",), ("sync",), ("slew",), ("move_ra", "move_dec"), ("pulse",))  # paper silent
ACK_AT = {"move_dec": 146, "move_ra": 147, "abort": 155, "sync": 156, "pulse": 157, "slew": 158}
FIRST_FLAG = 136  # the first byte of the status that is a flag
PARK_AT, CONNECTED_AT, GUIDING_AT, PIER_AT, SLEWING_AT, TRACKING_AT = 137, 138, 141, 142, 143, 144
TRUE = 0xFF
UNSEEN, ACKNOWLEDGED, REFUSED = 0, 1, 2


@dataclass(frozen=True)
class Parameters:
    """What kind of mount it is."""

    latitude_deg: float = 52.0
    longitude_deg: float = 4.5
    start_utc_s: float = 1.79e9
    hour_angle_deg: float = 0.0
    dec_deg: float = 0.0
    tracking: bool = True
    bandwidth_hz: float = 5.0
    damping: float = 0.8
    feedforward: float = 1.0
    acceleration_deg_s2: float = 8.0
    max_rate_deg_s: float = 6.0
    ra_gain: float = 1.0
    dec_gain: float = 1.0
    ra_sign: int = 1
    dec_sign: int = 1
    move_axis: str = "held"
    additive: bool = True
    timer: str = "even"
    timer_jitter_s: float = 0.0
    stall_s: float = 0.0
    stiction: float = 0.0
    friction: float = 0.0
    ripple: float = 0.0
    ripple_per_turn: int = 60
    encoder_noise_deg: float = 1e-6
    clock_error_s: float = 0.0
    clock_drift_ppm: float = 0.0
    rate_fields: str = "true"
    rates_as: str = "int64"
    counter_as: str = "int64"
    slewing_field: str = "true"
    abort_delay_s: float = 0.0
    move_ack: bool = True
    seed: int = 0


class Truth(NamedTuple):
    """Where the axes really are, as of the last turn."""

    utc_s: float
    hour_angle_deg: float
    dec_deg: float
    hour_angle_rate_deg_s: float
    dec_rate_deg_s: float
    ra_deg: float
    reported_dec_deg: float


class Point(NamedTuple):
    """The axis and its filters at one frequency."""

    hz: float
    z: complex
    seen: complex  # from the motor's torque to the encoder
    telescope: complex  # from the motor's torque to the telescope
    gust_seen: complex  # from torque on the telescope to the encoder
    gust_telescope: complex
    rate: complex  # of the filter that makes a rate of the encoder's angle
    notch: complex


class Gains(NamedTuple):
    """Gains of the cascade for one bandwidth."""

    position: float
    rate: float
    integral: float
    observer: float


def wrap_180(angle_deg: float) -> float:
    """Return the angle in -180..180 degrees."""
    return (angle_deg + HALF_DEG) % FULL_DEG - HALF_DEG


def clamp(value: float, most: float) -> float:
    """Return the value limited to -most..most."""
    return max(-most, min(most, value))


def gmst_deg(utc_s: float) -> float:
    """Return the Greenwich mean sidereal time of a POSIX time, in degrees, 0..360."""
    days = (utc_s - 946728000.0) / 86400.0
    return (280.46061837 + 360.98564736629 * days + 0.000387933 * (days / 36525.0) ** 2) % FULL_DEG


def fold(dec_deg: float) -> tuple[float, bool]:
    """Return the declination that an axis angle shows, and whether it is beyond the pole."""
    angle = wrap_180(dec_deg)
    if abs(angle) <= POLE_DEG:
        return angle, False
    return math.copysign(HALF_DEG, angle) - angle, True


def oscillator(omega: float, damping: float) -> tuple[float, float, float, float, float, float]:
    """Return the exact step of x'' + 2 damping omega x' + omega^2 x = q: matrix by rows, then input of q."""
    damped = omega * math.sqrt(1.0 - damping * damping)
    decay = math.exp(-damping * omega * STEP_S)
    c, s = math.cos(damped * STEP_S), math.sin(damped * STEP_S)
    skew = damping * omega / damped * s
    gain = decay * s / damped
    top = decay * (c + skew)
    return top, gain, -omega * omega * gain, decay * (c - skew), (1.0 - top) / (omega * omega), gain


def notch(omega: float, width: float) -> tuple[float, float, float, float, float]:
    """Return b0, b1, b2, a1, a2 of a notch at omega."""
    k = omega / math.tan(0.5 * omega * STEP_S)
    square, plain = k * k + omega * omega, 2.0 * (omega * omega - k * k)
    shallow, wide = 2.0 * NOTCH_DEPTH * width * k * omega, 2.0 * width * k * omega
    a0 = square + wide
    return (square + shallow) / a0, plain / a0, (square - shallow) / a0, plain / a0, (square - wide) / a0


class Body:
    """The two masses of an axis, and the loop that is designed for them."""

    def __init__(self, p: Parameters, chance: random.Random, on_telescope: bool) -> None:
        self.hz = chance.uniform(*RESONANCE_HZ)
        self.omega = 2.0 * math.pi * self.hz
        self.damping = chance.uniform(*RESONANCE_DAMPING)
        self.motor = 1.0 / (1.0 + chance.uniform(*MASS_RATIO))  # share of the inertia
        self.tube = 1.0 - self.motor
        self.on_telescope = on_telescope
        self.twist_seen = -self.motor if on_telescope else self.tube  # encoder: centre + this * twist
        self.twist = oscillator(self.omega, self.damping)
        wrong = chance.choice((-1.0, 1.0)) * chance.uniform(*NOTCH_ERROR)
        self.gust_time_s = chance.uniform(*GUST_TIME_S)
        self.bandwidth_hz = 0.0
        points: list[Point] = []
        for width in NOTCH_WIDTHS:
            filtered = notch(self.omega * (1.0 + wrong), width)
            seen = self._points(filtered)
            hz = self._reach(seen, p)
            if hz > self.bandwidth_hz:
                self.bandwidth_hz, self.notch, points = hz, filtered, seen
            if hz >= p.bandwidth_hz:
                break
        self.gains = self.gains_at(self.bandwidth_hz, p.damping)
        self.stiffness = self.gains.rate * self.gains.position
        self.gust_deg_s2, self.ripple_per_deg = self._compliance(points)

    @staticmethod
    def gains_at(hz: float, damping: float) -> Gains:
        """Return the gains for a bandwidth of the velocity loop and a damping of the position loop."""
        rate = 2.0 * math.pi * hz
        return Gains(
            rate / (4.0 * damping * damping),
            rate,
            PI_CORNER * damping * rate * rate,
            OBSERVER_CORNER * damping * rate,
        )

    def margins(self, points: list[Point], gains: Gains) -> tuple[float, float, float]:
        """Return gain margin, phase margin in degrees, and the turns of 1 + L round nought (1 if stable)."""
        gain, phase, turned = math.inf, math.pi, 0.0
        last = 0j
        for point in points:
            loop = self._controller(point, gains) * point.seen
            if last:
                if (loop.imag > 0.0) != (last.imag > 0.0):
                    real = last.real + (loop.real - last.real) * last.imag / (last.imag - loop.imag)
                    if real < 0.0:
                        gain = min(gain, max(-real, -1.0 / real))
                before, after = abs(last), abs(loop)
                if (before > 1.0) != (after > 1.0):
                    crossing = last + (loop - last) * (1.0 - before) / (after - before)
                    phase = min(phase, abs(cmath.phase(-crossing)))
                turned += cmath.phase((1.0 + loop) / (1.0 + last))
                if gain < LEAST_GAIN_MARGIN or phase < math.radians(LEAST_PHASE_MARGIN_DEG):
                    break
            last = loop
        return gain, math.degrees(phase), turned / (2.0 * math.pi)

    def _reach(self, points: list[Point], p: Parameters) -> float:
        """Return the bandwidth, lowered from what is asked until the margins are there."""
        hz = p.bandwidth_hz
        while hz > LEAST_HZ:
            gain, phase, turns = self.margins(points, self.gains_at(hz, p.damping))
            if gain >= LEAST_GAIN_MARGIN and phase >= LEAST_PHASE_MARGIN_DEG and abs(turns - 1.0) < 0.2:
                break
            hz *= LOWERED
        return hz

    def _points(self, filtered: tuple[float, float, float, float, float]) -> list[Point]:
        """Return the axis and its filters over the frequencies, densely about the resonance."""
        grid = [0.02 * 24950.0 ** (i / 259.0) for i in range(260)]
        grid += [self.hz * (0.8 + 0.4 * i / 120.0) for i in range(121)]
        a11, a12, a21, a22, b1, b2 = self.twist
        b0, b1n, b2n, a1n, a2n = filtered
        share = STEP_S / (RATE_FILTER_S + STEP_S)
        points = []
        for hz in sorted(grid):
            z = cmath.exp(2j * math.pi * hz * STEP_S)
            back = 1.0 / z
            centre = 0.5 * STEP_S * STEP_S * (z + 1.0) / (z - 1.0) ** 2
            twist = ((z - a22) * b1 + a12 * b2) / ((z - a11) * (z - a22) - a12 * a21)
            by_motor, by_gust = twist / self.motor, -twist / self.tube
            points.append(
                Point(
                    hz,
                    z,
                    centre + self.twist_seen * by_motor,
                    centre - self.motor * by_motor,
                    centre + self.twist_seen * by_gust,
                    centre - self.motor * by_gust,
                    (1.0 - back) / STEP_S * share / (1.0 - (1.0 - share) * back),
                    (b0 + (b1n + b2n * back) * back) / (1.0 + (a1n + a2n * back) * back),
                )
            )
        return points

    @staticmethod
    def _controller(point: Point, gains: Gains) -> complex:
        """Return the controller's answer, from the encoder to less torque."""
        leak = STEP_S * gains.observer / (point.z - 1.0 + STEP_S * gains.observer)
        cascade = (gains.rate + gains.integral * STEP_S / (point.z - 1.0)) * (gains.position + point.rate)
        observed = gains.observer * point.rate * (1.0 - leak)
        return point.notch * (cascade + observed) / (1.0 - point.notch * leak)

    def _compliance(self, points: list[Point]) -> tuple[float, float]:
        """Return the RMS torque of gusts, and the cogging torque that moves the telescope by 1 degree."""
        variance, worst = 0.0, 0.0
        power, last_hz = 0.0, 0.0
        for point in points:
            controller = self._controller(point, self.gains)
            closed = 1.0 / (1.0 + controller * point.seen)
            moved = abs(point.gust_telescope - point.telescope * controller * point.gust_seen * closed)
            before, before_hz = power, last_hz
            corner = 2.0 * math.pi * point.hz * self.gust_time_s
            power, last_hz = moved**2 * 4.0 * self.gust_time_s / (1.0 + corner * corner), point.hz
            variance += 0.5 * (power + before) * (last_hz - before_hz)
            if point.hz < 2.0 * self.hz:
                worst = max(worst, abs(point.telescope * closed))
        gust = SHAKEN_ARCSEC * ARCSEC / math.sqrt(variance)
        return min(gust, GUST_MOST_DEG_S2), 1.0 / worst


class Axis:
    """An axis: two masses, a drive, and the plan that the drive follows."""

    def __init__(
        self, p: Parameters, name: str, angle_deg: float, rate_deg_s: float, on_telescope: bool
    ) -> None:
        chance = self.random = random.Random(f"{p.seed} {name}")
        body = self.body = Body(p, chance, on_telescope)
        self.p = p
        self.shape = oscillator(2.0 * math.pi * SHAPER * body.bandwidth_hz, SHAPER_DAMPING)
        self.breaks = p.stiction * STICTION_DEG * body.stiffness
        self.slides = p.friction * FRICTION_DEG * body.stiffness
        self.breaks = max(self.breaks, self.slides)
        self.cogging = p.ripple * ARCSEC * body.ripple_per_deg
        self.cogging_phase = chance.uniform(0.0, 2.0 * math.pi)
        self.most_torque = (
            1.5 * p.acceleration_deg_s2
            + 2.0
            + 5.0 * body.gust_deg_s2
            + 1.5 * self.breaks
            + 2.0 * self.cogging
        )
        self.noise_deg = SERVO_NOISE * p.encoder_noise_deg
        decays = [math.exp(-i * STEP_S / body.gust_time_s) for i in range(PIECE + 1)]
        bends = [math.exp(-i * STEP_S / BEND_TIME_S) for i in range(PIECE + 1)]
        self.gusts = [(d, math.sqrt(1.0 - d * d), b) for d, b in zip(decays, bends, strict=True)]
        self.gust = self.bend = 0.0  # wind, and wind as the tube bends after it; both of about unit RMS
        self.bends_deg = BENT_ARCSEC * ARCSEC * math.sqrt(1.0 + BEND_TIME_S / body.gust_time_s)
        # the masses: centre of mass, and twist of the motor against the telescope; the bearing's bristles
        self.centre, self.centre_rate = angle_deg, rate_deg_s
        self.twist = self.twist_rate = self.bristle = 0.0
        self.drive = self.torque = self.telescope_torque = self.acceleration = 0.0
        # the drive
        self.powered = True
        self.encoder, self.encoder_rate = angle_deg - rate_deg_s * STEP_S, rate_deg_s
        self.integral, self.model_rate, self.notch_1, self.notch_2 = 0.0, rate_deg_s, 0.0, 0.0
        # the plan
        self.plan, self.plan_rate = angle_deg, rate_deg_s
        self.ask = rate_deg_s  # what is asked when there is no slew
        self.shaped, self.slope = rate_deg_s, 0.0
        self.slewing = False
        self.aim = self.aim_rate = 0.0
        self.guide_rate, self.guide_steps = 0.0, 0
        self.moving, self.move_rate, self.stopping = False, 0.0, False

    # what is told

    def slew(self, aim_deg: float, aim_rate_deg_s: float) -> None:
        """Begin a slew to an aim that moves."""
        self.aim, self.aim_rate, self.slewing = aim_deg, aim_rate_deg_s, True

    def end_slew(self) -> None:
        """Go on at the rate that is asked."""
        if self.slewing:
            self.slewing, self.shaped, self.slope = False, self.plan_rate, 0.0

    def halt(self) -> None:
        """Forget all motion that was asked; the axis slows down."""
        self.end_slew()
        self.moving, self.stopping = False, True
        self.guide_steps = 0

    def power(self, on: bool) -> None:
        """Turn the drive on or off; it starts from where the axis is."""
        if on and not self.powered:
            self.plan, self.plan_rate, self.shaped, self.slope = self.encoder, 0.0, 0.0, 0.0
            self.integral, self.model_rate, self.notch_1, self.notch_2 = 0.0, self.encoder_rate, 0.0, 0.0
        if not on:
            self.halt()
            self.stopping = False
            self.plan_rate = self.torque = self.drive = 0.0
        self.powered = on

    # what is seen

    def at_rate(self) -> bool:
        """Return whether the plan has come to the rate that is asked."""
        return not self.slewing and abs(self.plan_rate - self.ask) < REST_DEG_S

    def at_rest(self) -> bool:
        """Return whether the axis stands still."""
        return abs(self.plan_rate) < REST_DEG_S and abs(self.encoder_rate) < 5.0 * REST_DEG_S

    def gap(self) -> float:
        """Return how far the plan still is from the aim of the slew."""
        return self.aim + self._lag() - self.plan

    def read(self, since_s: float) -> tuple[float, float]:
        """Return angle and rate at the encoder, a part of a step after the last step."""
        return self._at(self.body.twist_seen, since_s)

    def truth(self, since_s: float) -> tuple[float, float]:
        """Return angle and rate of the telescope, a part of a step after the last step."""
        angle, rate = self._at(-self.body.motor, since_s)
        bend_rate = (self.gust - self.bend) * self.bends_deg / BEND_TIME_S
        return angle + self.bend * self.bends_deg + bend_rate * since_s, rate + bend_rate

    def _at(self, side: float, since_s: float) -> tuple[float, float]:
        """Return angle and rate at the centre of mass plus a share of the twist."""
        body = self.body
        push = self.torque + self.telescope_torque
        twisting = (
            self.torque / body.motor
            - self.telescope_torque / body.tube
            - body.omega * (body.omega * self.twist + 2.0 * body.damping * self.twist_rate)
        )
        angle = self.centre + side * self.twist
        rate = self.centre_rate + side * self.twist_rate
        growth = push + side * twisting
        return angle + (rate + 0.5 * growth * since_s) * since_s, rate + growth * since_s

    def _lag(self) -> float:
        """Return by how much the axis stays behind the aim for want of feedforward."""
        return (1.0 - self.p.feedforward) * self.aim_rate / self.body.gains.position

    # motion

    def run(self, steps: int, other_acceleration: float) -> None:
        """Run the axis for up to PIECE steps."""
        p, body = self.p, self.body
        position_gain, rate_gain, integral_gain, observer_gain = body.gains
        integral_gain *= STEP_S
        a11, a12, a21, a22, b1, b2 = body.twist
        c11, c12, c21, c22 = self.shape[:4]
        n0, n1, n2, m1, m2 = body.notch
        motor, tube, seen = body.motor, body.tube, body.twist_seen
        share = STEP_S / (RATE_FILTER_S + STEP_S)
        feed, powered, slewing, noise = p.feedforward, self.powered, self.slewing, self.noise_deg
        most, most_step = self.most_torque, p.acceleration_deg_s2 * STEP_S
        gauss = self.random.gauss
        decay, fresh, bend_decay = self.gusts[steps]
        self.gust = self.gust * decay + gauss(0.0, fresh)
        self.bend = self.gust + (self.bend - self.gust) * bend_decay
        push = body.gust_deg_s2 * self.gust - COUPLING * other_acceleration
        ask = self.ask
        if self.guide_steps > 0:
            self.guide_steps -= steps
            ask += self.guide_rate
        ask = clamp(ask, p.max_rate_deg_s)
        brake, rate_most = SLEW_ACCELERATION * p.acceleration_deg_s2, p.max_rate_deg_s
        steep = min(SLEW_PER_S, position_gain)
        near, lag = brake / (steep * steep), self._lag()
        if powered:
            breaks, slides, drag = self.breaks, self.slides, 0.0
        else:
            slides = max(COAST_DEG_S2 + 6.0 * body.gust_deg_s2 + 1.5 * self.cogging, self.slides)
            breaks, drag = max(slides, self.breaks), COAST_PER_S
        brush = breaks / BRISTLE_DEG
        brush_rate = 0.6 * math.sqrt(brush * motor)
        cogging, cogs, cogging_phase = self.cogging, math.radians(p.ripple_per_turn), self.cogging_phase
        centre, centre_rate, twist, twist_rate = self.centre, self.centre_rate, self.twist, self.twist_rate
        encoder, encoder_rate, bristle, torque = self.encoder, self.encoder_rate, self.bristle, self.torque
        integral, model_rate, notch_1, notch_2 = self.integral, self.model_rate, self.notch_1, self.notch_2
        plan, plan_rate, shaped, slope, aim = self.plan, self.plan_rate, self.shaped, self.slope, self.aim
        began = centre_rate - motor * twist_rate
        drive = 0.0
        for _ in range(steps):
            # the encoder
            angle = centre + seen * twist + gauss(0.0, noise)
            encoder_rate += share * ((angle - encoder) / STEP_S - encoder_rate)
            encoder = angle
            torque = 0.0
            if powered:
                # the plan
                if slewing:
                    gap = aim + lag - plan
                    size = abs(gap)
                    wish = steep * size if size < near else math.sqrt(2.0 * brake * (size - 0.5 * near))
                    wish = self.aim_rate + math.copysign(min(wish, rate_most), gap)
                    wish = max(-rate_most, min(rate_most, wish))
                    aim += self.aim_rate * STEP_S
                else:
                    off = shaped - ask
                    shaped = wish = ask + c11 * off + c12 * slope
                    slope = c21 * off + c22 * slope
                change = wish - plan_rate
                change = most_step if change > most_step else -most_step if change < -most_step else change
                # the loop
                error = feed * plan_rate + position_gain * (plan - angle) - encoder_rate
                disturbed = observer_gain * (encoder_rate - model_rate)
                wanted = rate_gain * error + integral + feed * change / STEP_S - disturbed
                drive = n0 * wanted + notch_1
                notch_1 = n1 * wanted - m1 * drive + notch_2
                notch_2 = n2 * wanted - m2 * drive
                torque = most if drive > most else -most if drive < -most else drive
                integral += integral_gain * error + UNWIND * (torque - drive)
                model_rate += STEP_S * (torque + disturbed)
                plan += (plan_rate + 0.5 * change) * STEP_S
                plan_rate += change
                drive = torque
            # bearing and cogging act on the motor
            if cogging:
                torque += cogging * math.sin(cogs * (centre + tube * twist) + cogging_phase)
            if breaks:
                motor_rate = centre_rate + tube * twist_rate
                speed = abs(motor_rate)
                level = slides + (breaks - slides) / (1.0 + (speed / STRIBECK_DEG_S) ** 2)
                old = bristle
                bristle = (old + motor_rate * STEP_S) / (1.0 + speed * STEP_S * brush / max(level, 1e-9))
                torque -= brush * bristle + brush_rate * (bristle - old) / STEP_S + drag * motor_rate
            # the masses
            total = torque + push
            centre += (centre_rate + 0.5 * total * STEP_S) * STEP_S
            centre_rate += total * STEP_S
            twisting = torque / motor - push / tube
            twist, twist_rate = (
                a11 * twist + a12 * twist_rate + b1 * twisting,
                a21 * twist + a22 * twist_rate + b2 * twisting,
            )
        self.centre, self.centre_rate, self.twist, self.twist_rate = centre, centre_rate, twist, twist_rate
        self.encoder, self.encoder_rate, self.bristle, self.torque = encoder, encoder_rate, bristle, torque
        self.integral, self.model_rate, self.notch_1, self.notch_2 = integral, model_rate, notch_1, notch_2
        self.plan, self.plan_rate, self.shaped, self.slope, self.aim = plan, plan_rate, shaped, slope, aim
        self.drive, self.telescope_torque = drive, push
        self.acceleration = (centre_rate - motor * twist_rate - began) / (steps * STEP_S)


class Mount:
    """The mount: mailbox, commands, two axes, clock and status."""

    next_turn_s: float

    def __init__(self, parameters: Parameters) -> None:
        p = self.p = parameters
        self.random = random.Random(f"{p.seed} timer")
        ra_on_telescope = random.Random(f"{p.seed} encoders").random() < 0.5
        self.following = p.tracking
        self.ra = Axis(p, "ra", p.hour_angle_deg, SIDEREAL_DEG_S if p.tracking else 0.0, ra_on_telescope)
        self.dec = Axis(p, "dec", p.dec_deg, 0.0, not ra_on_telescope)
        self.axes = {"move_ra": self.ra, "move_dec": self.dec}
        self.turns_to = {"move_ra": p.ra_sign * p.ra_gain, "move_dec": p.dec_sign * p.dec_gain}
        self.clock_rate = SIDEREAL_DEG_S * (1.0 + 1e-6 * p.clock_drift_ppm)
        self.lst_at_start = gmst_deg(p.start_utc_s) + p.longitude_deg + SIDEREAL_DEG_S * p.clock_error_s
        self.ra_offset = self.dec_offset = 0.0  # what a sync has added to the axes' angles
        self.mail: tuple[Any, ...] = (0,) * 20  # as it has come
        self.noted = self.mail  # as it was at the start of the last turn
        self.state = dict.fromkeys(FLAG_AT, UNSEEN)
        self.abort_s: float | None = None
        self.braking = self.parked = False
        self.arrived, self.slew_until_s = 0, math.inf
        self.steps = self.counter = self.timer_turns = 0
        self.now_s = self.due_s = 0.0
        ra_deg, dec_deg, _ = self._sky(p.hour_angle_deg, p.dec_deg)
        self.target = (ra_deg / DEG_PER_HOUR, dec_deg)
        self.past: deque[tuple[float, int, int, bool]] = deque()
        self.turn_s = min(TURN_S, self.random.uniform(0.0, p.timer_jitter_s))
        self.next_turn_s = p.start_utc_s + self.turn_s

    def receive(self, datagram: bytes) -> None:
        """Put a datagram that has just arrived into the mailbox; what is not a command is ignored."""
        if len(datagram) == COMMAND.size:
            mail = COMMAND.unpack(datagram)
            if mail[0] == HEADER:
                self.mail = mail

    def turn(self) -> bytes:
        """Run on to next_turn_s, read encoders, obey what had come by the turn before, return the status."""
        now_s = self.now_s = self.turn_s
        self._run(now_s)
        since_s = now_s - self.steps * STEP_S
        ra, ra_rate = self.ra.read(since_s)
        dec, dec_rate = self.dec.read(since_s)
        self._obey(now_s)
        self._arrive(now_s)
        self._ask()
        self.noted = self.mail
        self.counter += 1
        status = self._status(self._digital(ra), self._digital(dec), ra_rate, dec_rate)
        self._schedule()
        return status

    def truth(self) -> Truth:
        """Return where the telescope is, as of the last turn."""
        since_s = self.now_s - self.steps * STEP_S
        ra, ra_rate = self.ra.truth(since_s)
        dec, dec_rate = self.dec.truth(since_s)
        ra_deg, dec_deg, _ = self._sky(ra, dec)
        return Truth(self.p.start_utc_s + self.now_s, ra, dec, ra_rate, dec_rate, ra_deg, dec_deg)

    # time

    def _run(self, now_s: float) -> None:
        """Run the axes up to the last whole step before now."""
        last = int(now_s / STEP_S + 1e-6)
        while self.steps < last:
            steps = min(PIECE, last - self.steps)
            for axis in (self.ra, self.dec):
                if axis.guide_steps > 0:
                    steps = min(steps, axis.guide_steps)
            self.ra.run(steps, self.dec.acceleration)
            self.dec.run(steps, self.ra.acceleration)
            self.steps += steps

    def _schedule(self) -> None:
        """Set the time of the next turn; turns that a late one has overrun are left out."""
        p, chance = self.p, self.random
        late_s = chance.uniform(0.0, p.timer_jitter_s)
        if p.stall_s > 0.0 and chance.random() * STALL_EVERY_S < TURN_S:
            late_s += chance.uniform(0.0, p.stall_s)
        turn_s = self.now_s
        while turn_s < self.now_s + 2.0 * STEP_S:
            self.timer_turns += 1
            self.due_s += TURN_S if p.timer == "even" else TICK_S * (4 if self.timer_turns % 2 else 3)
            turn_s = self.due_s + late_s
        self.turn_s = turn_s
        self.next_turn_s = p.start_utc_s + turn_s

    # commands

    def _obey(self, now_s: float) -> None:
        """Launch the highest of the commands that are up and have not been seen yet."""
        mail, state = self.noted, self.state
        for name, index in FLAG_AT.items():
            if not mail[index]:
                state[name] = UNSEEN
                if name in self.axes and self.p.move_axis == "held":
                    self._release(self.axes[name])
        if self.abort_s is not None and now_s >= self.abort_s - 1e-6:
            self._brake()
        if self.braking and self.ra.at_rest() and self.dec.at_rest():
            self.braking = False
        # paper silent: while an abort is up, awaited or braking, only a park is obeyed; the others wait
        stopping = bool(mail[FLAG_AT["abort"]]) or self.abort_s is not None or self.braking
        for names in PRIORITY:
            new = [name for name in names if mail[FLAG_AT[name]] and state[name] == UNSEEN]
            if not new or (stopping and names[0] not in ("abort", "park")):
                continue
            for name in new:
                state[name] = ACKNOWLEDGED if self._launch(name, now_s) else REFUSED
            break
        if self.p.move_axis == "held":
            for name, axis in self.axes.items():
                if axis.moving:
                    axis.move_rate = self._move_rate(name)

    def _launch(self, name: str, now_s: float) -> bool:
        """Launch a command; return whether it was taken."""
        if name == "abort":
            self.abort_s = now_s + self.p.abort_delay_s
            if self.p.abort_delay_s <= 0.0:
                self._brake()
        elif name == "park":
            self.parked = True
            self.abort_s, self.braking = None, False
            for axis in self.axes.values():
                axis.power(False)
        elif self.ra.slewing or self.dec.slewing:
            return False  # all else is ignored during a slew
        elif name == "pulse":
            return self._pulse()
        elif name == "sync":
            return self._sync()
        elif name == "slew":
            return self._slew(now_s)
        else:
            self._wake()
            axis, rate = self.axes[name], self._move_rate(name)
            if self.p.move_axis == "edge" and rate == 0.0:
                self._release(axis)
            else:
                axis.moving, axis.move_rate = True, rate
        return True

    def _move_rate(self, name: str) -> float:
        """Return the rate of the axis that the datagram's MoveAxis rate means."""
        rate = self.turns_to[name] * self.noted[RATE_AT[name]]
        return clamp(rate, self.p.max_rate_deg_s) if math.isfinite(rate) else 0.0

    @staticmethod
    def _release(axis: Axis) -> None:
        """End a MoveAxis."""
        if axis.moving:
            axis.moving, axis.stopping = False, True

    def _brake(self) -> None:
        """Slow down and stop both axes; drives stay active, tracking ends until the next slew or MoveAxis."""
        self.abort_s = None
        self.braking = not self.parked
        self.following = False
        for axis in self.axes.values():
            axis.halt()

    def _wake(self) -> None:
        """Power the drives, and track again; paper silent on how a park or an abort ends."""
        self.parked = False
        self.following = self.p.tracking
        for axis in self.axes.values():
            axis.power(True)

    def _sky_target(self) -> bool:
        """Take the target of the datagram if it is one."""
        dec_deg, ra_h = self.noted[TARGET_DEC], self.noted[TARGET_RA]
        if not (0.0 <= ra_h <= 24.0 and -POLE_DEG <= dec_deg <= POLE_DEG):
            return False
        self.target = (ra_h, dec_deg)
        return True

    def _slew(self, now_s: float) -> bool:
        """Begin a slew; ignored while a MoveAxis goes on."""
        if self.ra.moving or self.dec.moving or not self._sky_target():
            return False
        self._wake()
        ra_h, dec_deg = self.target
        hour_angle = self._lst(now_s) - DEG_PER_HOUR * ra_h
        self.ra.slew(self._aim(self.ra.encoder, hour_angle - self.ra_offset), self.clock_rate)
        self.dec.slew(self._aim(self.dec.encoder, dec_deg - self.dec_offset), 0.0)
        self.arrived, self.slew_until_s = 0, math.inf
        return True

    @staticmethod
    def _aim(start_deg: float, aim_deg: float) -> float:
        """Return the turn of the aim that is nearest to the start without wrapping the cables."""
        aim = start_deg + wrap_180(aim_deg - start_deg)
        return aim - math.copysign(FULL_DEG, aim) if abs(aim) > WRAP_DEG else aim

    def _sync(self) -> bool:
        """Change the reported place to the target."""
        if not self._sky_target():
            return False
        ra_h, dec_deg = self.target
        dec_axis = self.dec.encoder + self.dec_offset
        _, beyond = fold(dec_axis)
        shown = math.copysign(HALF_DEG, wrap_180(dec_axis)) - dec_deg if beyond else dec_deg
        self.dec_offset += wrap_180(shown - dec_axis)
        hour_angle = self._lst(self.now_s) - DEG_PER_HOUR * ra_h + (HALF_DEG if beyond else 0.0)
        self.ra_offset += wrap_180(hour_angle - self.ra.encoder - self.ra_offset)
        return True

    def _pulse(self) -> bool:
        """Start the timers of a pulse guide: east (negative) against the sidereal drive, north positive."""
        if self.parked:
            return False
        for axis, index in ((self.ra, GUIDE_RA), (self.dec, GUIDE_DEC)):
            duration = self.noted[index]
            if duration:
                axis.guide_rate = math.copysign(GUIDE_TICS10 / TICS10_PER_DEG, duration)
                axis.guide_steps = round(abs(duration) * 0.001 / STEP_S)
        return True

    def _arrive(self, now_s: float) -> None:
        """End a slew when both encoders have stayed at the aim for a while."""
        axes = (self.ra, self.dec)
        if not self.ra.slewing:
            return
        if all(abs(axis.gap()) < GAP_DEG for axis in axes):
            self.slew_until_s = min(self.slew_until_s, now_s + ARRIVE_MOST_S)
            there = all(abs(axis.encoder - axis.aim) < ARRIVED_DEG for axis in axes)
            self.arrived = self.arrived + 1 if there else 0
            if self.arrived >= ARRIVED_TURNS or now_s >= self.slew_until_s:
                for axis in axes:
                    axis.end_slew()

    def _ask(self) -> None:
        """Ask of each axis the sum of its rates; fine rates are added to tracking."""
        for name, sidereal, index in (("move_ra", SIDEREAL_DEG_S, FINE_RA), ("move_dec", 0.0, FINE_DEC)):
            axis = self.axes[name]
            rate = sidereal + self.noted[index] / TICS10_PER_DEG if self.following else 0.0
            if axis.moving:
                rate = axis.move_rate + (rate if self.p.additive else 0.0)
            axis.ask = clamp(rate, self.p.max_rate_deg_s)
            if axis.stopping and axis.at_rate():
                axis.stopping = False

    # status

    def _lst(self, now_s: float) -> float:
        """Return the sidereal time of the mount's clock in degrees."""
        return self.lst_at_start + self.clock_rate * now_s

    def _digital(self, angle_deg: float) -> float:
        """Return one reading of an encoder: with noise, in whole tics."""
        return round((angle_deg + self.random.gauss(0.0, self.p.encoder_noise_deg)) / TIC_DEG) * TIC_DEG

    def _sky(self, ra_axis_deg: float, dec_axis_deg: float) -> tuple[float, float, bool]:
        """Return right ascension and declination of the axes' angles, and whether beyond the pole."""
        dec_deg, beyond = fold(dec_axis_deg + self.dec_offset)
        hour_angle = ra_axis_deg + self.ra_offset + (HALF_DEG if beyond else 0.0)
        return (self._lst(self.now_s) - hour_angle) % FULL_DEG, dec_deg, beyond

    def _horizon(self, hour_angle_deg: float, dec_deg: float) -> tuple[float, float]:
        """Return altitude and azimuth (from north through east)."""
        h, d, f = math.radians(hour_angle_deg), math.radians(dec_deg), math.radians(self.p.latitude_deg)
        up = math.sin(f) * math.sin(d) + math.cos(f) * math.cos(d) * math.cos(h)
        north = math.cos(f) * math.sin(d) - math.sin(f) * math.cos(d) * math.cos(h)
        east = -math.cos(d) * math.sin(h)
        return math.degrees(math.asin(clamp(up, 1.0))), math.degrees(math.atan2(east, north)) % FULL_DEG

    def _shown(self, ra_rate: float, dec_rate: float, slewing: bool) -> tuple[int, int, bool]:
        """Return the rates in tics per second times 10 and the slewing flag, as this mount shows them."""
        p = self.p
        rates = (round(ra_rate * TICS10_PER_DEG), round(dec_rate * TICS10_PER_DEG))
        past = self.past
        past.append((self.now_s, *rates, slewing))
        while len(past) > 1 and past[1][0] <= self.now_s - LATE_S:
            past.popleft()
        if p.rate_fields == "constant":
            rates = (round(SIDEREAL_DEG_S * TICS10_PER_DEG), 0)
        elif p.rate_fields == "late":
            rates = past[0][1:3]
        elif p.rate_fields == "lying":
            rates = (
                round(-1.7 * rates[0] + self.random.gauss(0.0, 2000.0)),
                round(0.4 * rates[1] + self.random.gauss(0.0, 2000.0)),
            )
        shown = {"constant": False, "late": past[0][3], "lying": not slewing}.get(p.slewing_field, slewing)
        return *rates, shown

    def _status(self, ra_axis: float, dec_axis: float, ra_rate: float, dec_rate: float) -> bytes:
        """Return the status datagram of the encoders as they were read."""
        p, axes = self.p, (self.ra, self.dec)
        ra_deg, dec_deg, beyond = self._sky(ra_axis, dec_axis)
        lst = self._lst(self.now_s) % FULL_DEG
        altitude, azimuth = self._horizon(lst - ra_deg, dec_deg)
        slewing = self.braking or any(axis.slewing or axis.moving or axis.stopping for axis in axes)
        ra_shown, dec_shown, slewing = self._shown(ra_rate, dec_rate, slewing)
        flags = bytearray(STATUS.size - FIRST_FLAG)
        flags[CONNECTED_AT - FIRST_FLAG] = TRUE
        for index, state in (
            (PARK_AT, self.parked),
            (GUIDING_AT, any(axis.guide_steps > 0 for axis in axes)),
            (PIER_AT, beyond),
            (SLEWING_AT, slewing),
            (TRACKING_AT, not slewing),  # the paper packs one as the opposite of the other
        ):
            flags[index - FIRST_FLAG] = TRUE if state else 0
        for name, index in ACK_AT.items():
            if self.state[name] == ACKNOWLEDGED and (p.move_ack or name not in self.axes):
                flags[index - FIRST_FLAG] = TRUE
        ra_current, dec_current = (
            round(math.copysign(50.0, axis.drive) + 150.0 * axis.drive / axis.most_torque)
            if axis.powered
            else 0
            for axis in axes
        )
        return STATUS.pack(
            b"XERXESxx",
            altitude,
            azimuth,
            dec_deg,
            dec_shown,
            ra_deg / DEG_PER_HOUR,
            ra_shown,
            lst / DEG_PER_HOUR,
            SITE_ELEVATION_M,
            p.latitude_deg,
            p.longitude_deg,
            self.target[1],
            self.target[0],
            self.counter,
            GUIDE_TICS10,
            GUIDE_TICS10,
            dec_current,
            ra_current,
            *flags,
        )


def serve(mount: Mount, port: int, remote: tuple[str, int], for_s: float) -> None:
    """Run the mount in real time over UDP."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
        link.bind(("", port))
        until_s = mount.p.start_utc_s + for_s
        while mount.next_turn_s < until_s:
            while (wait_s := mount.next_turn_s - time.time()) > 0.0:
                link.settimeout(wait_s)
                try:
                    mount.receive(link.recv(2048))
                except OSError:  # nothing has come, or the other side is not there yet
                    continue
            link.sendto(mount.turn(), remote)


def main() -> None:
    """Read the command line and serve; each parameter is an option."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--port", type=int, default=15001, help="where commands come in")
    parser.add_argument("--remote-host", default="127.0.0.1", help="where the status goes")
    parser.add_argument("--remote-port", type=int, default=15002)
    parser.add_argument("--for-s", type=float, default=math.inf, help="how long to run")
    for field in fields(Parameters):
        kind = type(field.default)
        convert = (lambda text: text.lower() in ("1", "true", "yes")) if kind is bool else kind
        parser.add_argument("--" + field.name.replace("_", "-"), type=convert, default=None)
    options = vars(parser.parse_args())
    given = {f.name: options[f.name] for f in fields(Parameters) if options[f.name] is not None}
    parameters = replace(Parameters(), **{"start_utc_s": time.time(), **given})
    serve(
        Mount(parameters), options["port"], (options["remote_host"], options["remote_port"]), options["for_s"]
    )


if __name__ == "__main__":
    main()
