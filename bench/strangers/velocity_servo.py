"""A simulated Xerxes telescope mount with velocity servos, written from the protocol paper alone."""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import heapq
import json
import math
import os
import select
import signal
import socket
import struct
import sys
import time
from collections import deque
from dataclasses import dataclass
from random import Random
from typing import NamedTuple

COMMAND = struct.Struct("<QqddddqqiiBBBBBBBBBB")
HEADER = 0x5555AAAA
TICS10_PER_DEG = 2**26 / 36.0  # ten times the encoder tics in a degree
SIDEREAL_DEG_S = 360.98564736629 / 86400.0
J2000_POSIX_S = 946728000.0
GUIDE_TICS10 = 3500
QUARTER_DEG, HALF_DEG, TURN_DEG, DAY_H = 90.0, 180.0, 360.0, 24.0
TRUE_BYTE = 0xFF
PERIOD_S = 0.05
TICK_S = 0.015625
STALL_EVERY_S = 8.0
FINE_STEP_HZ = 12.0  # above this bandwidth the servo runs at 1 ms, else at 2 ms
SITE_ELEVATION_M = 20.0  # the paper names no site: anything will do
COAST_DEG_S2 = 0.5  # paper silent on how an unpowered axis stops: bearing drag of at least this much
PLANNED_SHARE = 0.7  # share of the acceleration that a slew plans to brake with
INTEGRAL_PERIODS = 3.0  # time constant of the integral part, in periods of the velocity loop
LATE_S = 2.0
ARRIVED_DEG, ARRIVED_DEG_S = 0.0005, 0.001  # paper silent on when a slew has ended: this near and this slow
SETTLED_DEG_S, SETTLED_TURNS = 0.002, 3  # the same for braking
NEAR_DEG, NEAR_DEG_S, NEAR_TURNS = 0.01, 0.05, 100  # or this near for so many turns (stick and slip)

# What an axis is doing; the first two have the position loop closed.
SKY, SLEW, MOVE, BRAKE, OFF = range(5)
# Commands as bits, the highest priority first (the paper is silent on the order but for the abort).
ABORT, PARK, SYNC, SLEWING, MOVE_RA, MOVE_DEC, PULSE = (1 << bit for bit in range(7))
MOVES = MOVE_RA | MOVE_DEC


@dataclass(frozen=True)
class Parameters:
    """What kind of mount it is; the units are in the names or in the contract."""

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
    """Where the axes really are; hour angle and declination run on without wrapping."""

    utc_s: float
    hour_angle_deg: float
    dec_deg: float
    hour_angle_rate_deg_s: float
    dec_rate_deg_s: float
    ra_deg: float
    reported_dec_deg: float


class Command(NamedTuple):
    """One command datagram, field by field, as the paper's table has them."""

    header: int
    counter: int
    target_dec_deg: float
    target_ra_h: float
    rate_dec_deg_s: float
    rate_ra_deg_s: float
    fine_dec: int
    fine_ra: int
    pulse_ra_ms: int
    pulse_dec_ms: int
    tracking_rate: int
    abort: int
    home: int
    move_ra: int
    move_dec: int
    park: int
    pulse: int
    slew: int
    sync: int
    spare: int

    def active(self) -> int:
        """The commands that are up, as bits."""
        flags = (self.abort, self.park, self.sync, self.slew, self.move_ra, self.move_dec, self.pulse)
        return sum(1 << bit for bit, flag in enumerate(flags) if flag)


class Step(NamedTuple):
    """The exact motion of the velocity loop over one inner step: (x, w) goes to (a x + b w, c x + d w)."""

    length_s: float
    a: float
    b: float
    c: float
    d: float
    lag: float  # share of the way that the reference's lag goes in one step
    seized: float  # what is left of the drive's difference after one step of a stuck axis


class Axis:
    """One axis: a velocity loop of second order around the acceleration, and a position loop around that."""

    def __init__(self, parameters: Parameters, position_deg: float, rate_deg_s: float) -> None:
        """Start at a place and a rate, settled."""
        p = parameters
        self.wn = math.tau * p.bandwidth_hz
        self.damp = 2.0 * p.damping * self.wn
        self.feedforward = p.feedforward
        self.limit = p.acceleration_deg_s2
        self.max_rate = p.max_rate_deg_s
        self.friction, self.stiction = p.friction, p.stiction
        self.ripple, self.ripple_per_deg = p.ripple, math.radians(p.ripple_per_turn)
        self.rough = bool(p.friction or p.stiction or p.ripple)
        self.damping = p.damping
        self.step: Step | None = None
        self.mode = SKY
        self.move_rate = 0.0  # deg/s, of a MoveAxis, as commanded
        self.waited = 0
        self.position, self.velocity, self.target = position_deg, rate_deg_s, position_deg
        self.enable()
        self.integral = math.copysign(p.friction, rate_deg_s) if rate_deg_s else 0.0
        self.guide_rate, self.guide_until_s = 0.0, 0.0

    def enable(self) -> None:
        """Put the loop in a state that goes on from the present motion without a jerk."""
        self.drive = self.integral = self.model_drive = 0.0
        self.model_velocity = self.lagged = self.velocity
        self.target = self.position

    def enter(self, mode: int) -> None:
        """Change what the axis is doing; powers the drive where it was off."""
        if self.mode == OFF and mode != OFF:
            self.enable()
        self.mode, self.waited = mode, 0

    def coefficients(self, length_s: float) -> Step:
        """The step matrix for this length, kept while the length stays the same."""
        if self.step is None or self.step.length_s != length_s:
            decay, wn, damping = 0.5 * self.damp, self.wn, self.damping
            w = wn * math.sqrt(abs(1.0 - damping * damping))
            if w * length_s < 1e-6:
                cosine, sine = 1.0, length_s
            elif damping < 1.0:
                cosine, sine = math.cos(w * length_s), math.sin(w * length_s) / w
            else:
                cosine, sine = math.cosh(w * length_s), math.sinh(w * length_s) / w
            e = math.exp(-decay * length_s)
            self.step = Step(
                length_s,
                e * (cosine + decay * sine),
                e * sine,
                -e * wn * wn * sine,
                e * (cosine - decay * sine),
                1.0 - math.exp(-wn * length_s),
                math.exp(-self.damp * length_s),
            )
        return self.step

    def coast(self, span_s: float) -> None:
        """Roll on without power for so long."""
        drag = max(self.friction, COAST_DEG_S2)
        speed = abs(self.velocity)
        span_s = min(span_s, speed / drag)
        self.position += math.copysign(speed * span_s - 0.5 * drag * span_s * span_s, self.velocity)
        self.velocity = math.copysign(max(speed - drag * span_s, 0.0), self.velocity)

    def run(self, count: int, length_s: float, base: float, command: float) -> None:
        """Run count steps; base is the rate of the sky, command that of a MoveAxis or a brake (deg/s)."""
        h, a, b, c, d, lag, seized = self.coefficients(length_s)
        closed = self.mode in (SKY, SLEW)
        wn, damp, limit, top = self.wn, self.damp, self.limit, self.max_rate
        wn2, half_h, sag = wn * wn, 0.5 * h, damp / (wn * wn)
        gain = 0.2 * wn
        brake = 2.0 * PLANNED_SHARE * limit
        knee = 0.5 * brake / (gain * gain)
        half_knee = 0.5 * knee
        direct, rest = self.feedforward, 0.5 - 0.5 * self.feedforward
        share = h * wn * wn / damp / (INTEGRAL_PERIODS * math.tau / wn)
        rough, friction, held = self.rough, self.friction, self.friction + self.stiction
        ripple, per_deg, sin, sqrt = self.ripple, self.ripple_per_deg, math.sin, math.sqrt
        p, v, u, integral = self.position, self.velocity, self.drive, self.integral
        target, lagged = self.target, self.lagged
        model_v, model_u = self.model_velocity, self.model_drive
        extra, dry = 0.0, friction > 0.0 or held > 0.0
        upper, lower = limit, -limit
        for _ in range(count):
            if closed:
                error = target - p
                target += base * h
                if error > knee:
                    reference = base + sqrt(brake * (error - half_knee))
                elif error < -knee:
                    reference = base - sqrt(brake * (-error - half_knee))
                else:
                    reference = base + gain * error
                if reference > top:
                    reference = top
                elif reference < -top:
                    reference = -top
                lagged = reference
            else:
                before = lagged
                lagged += lag * (command - lagged)
                reference = direct * command + rest * (before + lagged)
            sense = 0.0
            if rough:
                extra = ripple * sin(p * per_deg) if ripple else 0.0
                if dry:
                    push = u + integral + extra
                    sense = v if v else push
                    if v == 0.0 and -held <= push <= held:
                        # Stuck: the drive builds up against the friction until the axis breaks loose.
                        u = reference * wn2 / damp + (u - reference * wn2 / damp) * seized
                        integral += share * model_v
                        integral = max(-limit, min(limit, integral))
                        u = max(-limit - integral, min(limit - integral, u))
                        x = model_v - reference
                        model_v = a * x + b * model_u + reference
                        model_u = max(-limit, min(limit, c * x + d * model_u))
                        continue
                    extra += -friction if sense > 0.0 else friction
                extra += integral
                upper, lower = limit - integral, -limit - integral
            aim = reference + sag * extra
            x = v - aim
            w = u + extra
            w2 = c * x + d * w
            u2 = w2 - extra
            if lower <= u2 <= upper:
                x2 = a * x + b * w
                v2 = aim + x2
                p += aim * h - (w2 - w + damp * (x2 - x)) / wn2
                clamped = False
            else:
                u2 = upper if u2 > upper else lower
                v2 = v + half_h * (u + u2) + h * extra
                p += half_h * (v + v2)
                clamped = True
            if rough:
                if dry and v2 * sense < 0.0:
                    v2 = 0.0
                if clamped:
                    # No windup: the model that the integral part compares with goes along with the axis.
                    model_v, model_u = v2, u2
                else:
                    x = model_v - reference
                    w = model_u
                    model_u = c * x + d * w
                    if -limit <= model_u <= limit:
                        model_v = reference + a * x + b * w
                    else:
                        model_u = limit if model_u > limit else -limit
                        model_v += half_h * (w + model_u)
                    integral += share * (model_v - v2)
                    if integral > limit:
                        integral = limit
                    elif integral < -limit:
                        integral = -limit
            v, u = v2, u2
        self.position, self.velocity, self.drive, self.integral = p, v, u, integral
        self.target, self.lagged = (target if closed else p), lagged
        self.model_velocity, self.model_drive = (model_v, model_u) if rough else (v, u)

    def settle(self, base: float) -> None:
        """End a slew that has arrived, or a brake that has come down to the rate of the sky (deg/s)."""
        slip = abs(self.velocity - base)
        if self.mode == SLEW:
            error = abs(self.target - self.position)
            self.waited = self.waited + 1 if error < NEAR_DEG else 0
            done = error < ARRIVED_DEG and slip < ARRIVED_DEG_S
        elif self.mode == BRAKE:
            self.waited = self.waited + 1 if slip < NEAR_DEG_S else 0
            done = slip < SETTLED_DEG_S and self.waited >= SETTLED_TURNS
        else:
            return
        if done or self.waited >= NEAR_TURNS:
            if self.mode == BRAKE:
                self.target = self.position
            self.mode = SKY


def fold(angle_deg: float) -> tuple[float, bool]:
    """A continuous declination angle as (declination in degrees, beyond the pole)."""
    angle_deg = (angle_deg + HALF_DEG) % TURN_DEG - HALF_DEG
    if angle_deg > QUARTER_DEG:
        return HALF_DEG - angle_deg, True
    if angle_deg < -QUARTER_DEG:
        return -HALF_DEG - angle_deg, True
    return angle_deg, False


class Mount:
    """The mount: a mailbox, a loop of 50 ms, two axes and a clock of its own."""

    def __init__(self, parameters: Parameters) -> None:
        """Switch on."""
        p = self._p = parameters
        self._random = Random(p.seed)
        self._tracking = p.tracking
        self._fine_ra = self._fine_dec = 0.0
        self._time = self.next_turn_s = p.start_utc_s
        self._grid_s = 0.0  # of the timer, since the start
        self._turns = 0
        self._ra = Axis(p, p.hour_angle_deg, SIDEREAL_DEG_S if p.tracking else 0.0)
        self._dec = Axis(p, p.dec_deg, 0.0)
        self._mail: Command | None = None
        self._served = self._acked = 0
        self._abort_at_s: float | None = None
        self._parked = False
        self._offset_ra_deg = self._offset_dec_deg = 0.0
        self._target = (0.0, 0.0)
        self._past: deque[tuple[float, float, float]] = deque()
        rate = {"int64": "q", "double": "d"}["double" if p.rate_fields == "nan" else p.rates_as]
        counter = {"int64": "q", "double": "d"}[p.counter_as]
        self._status = struct.Struct(f"<8s3d{rate}d{rate}6d{counter}2d2i24B")
        self._rate_type = float if rate == "d" else round
        self._step_s = 0.001 if p.bandwidth_hz > FINE_STEP_HZ else 0.002

    def receive(self, datagram: bytes) -> None:
        """Put a datagram that has just arrived into the mailbox; what is no valid command is ignored."""
        if len(datagram) != COMMAND.size:
            return
        command = Command._make(COMMAND.unpack(datagram))
        if command.header != HEADER:
            return
        # Paper silent on rates that are no numbers: such a datagram is not a valid command.
        if command.move_ra and not math.isfinite(command.rate_ra_deg_s):
            return
        if command.move_dec and not math.isfinite(command.rate_dec_deg_s):
            return
        self._mail = command

    def turn(self) -> bytes:
        """Move the axes on to next_turn_s, look at the mailbox, act, return the status of that instant."""
        now = self.next_turn_s
        self._advance(now)
        self._obey(now)
        self._turns += 1
        status = self._pack(now)
        self._schedule(now)
        return status

    def truth(self) -> Truth:
        """Where everything is as of the last turn."""
        ra_deg, dec_deg, _ = self._pointing(0.0, 0.0)
        return Truth(
            self._time,
            self._ra.position,
            self._dec.position,
            self._ra.velocity,
            self._dec.velocity,
            ra_deg,
            dec_deg,
        )

    def _lst_deg(self) -> float:
        """Local mean sidereal time of the mount's own clock; the drives do not run by that clock."""
        p, now = self._p, self._time
        clock = now + p.clock_error_s + p.clock_drift_ppm * 1e-6 * (now - p.start_utc_s)
        days = (clock - J2000_POSIX_S) / 86400.0
        return (280.46061837 + 360.98564736629 * days + p.longitude_deg) % TURN_DEG

    def _pointing(self, noise_ra_deg: float, noise_dec_deg: float) -> tuple[float, float, bool]:
        """Reported right ascension and declination in degrees, and whether beyond the pole."""
        dec_deg, beyond = fold(self._dec.position + self._offset_dec_deg + noise_dec_deg)
        ra_deg = self._lst_deg() - self._ra.position - self._offset_ra_deg + noise_ra_deg
        ra_deg = (ra_deg + HALF_DEG * beyond) % TURN_DEG
        return (ra_deg if ra_deg < TURN_DEG else 0.0), dec_deg, beyond

    def _bases(self) -> tuple[float, float]:
        """The rates of plain tracking in hour angle and declination, fine rates included, deg/s."""
        # Paper silent: fine rates come on top of sidereal, at once, without a flag, only while tracking.
        if not self._tracking:
            return 0.0, 0.0
        top = self._p.max_rate_deg_s
        return SIDEREAL_DEG_S + max(-top, min(top, self._fine_ra)), max(-top, min(top, self._fine_dec))

    def _goals(self, base_ra: float, base_dec: float) -> tuple[float, float]:
        """The rates that the commands in force ask for, deg/s."""
        p, top = self._p, self._p.max_rate_deg_s
        if self._ra.mode == MOVE:
            own = base_ra if p.additive else 0.0
            base_ra = max(-top, min(top, own + self._ra.move_rate * p.ra_gain * p.ra_sign))
        if self._dec.mode == MOVE:
            base_dec = max(-top, min(top, base_dec + self._dec.move_rate * p.dec_gain * p.dec_sign))
        return base_ra, base_dec

    def _advance(self, now: float) -> None:
        """Move both axes on to this time."""
        span = now - self._time
        if span <= 0.0:
            return
        ra, dec = self._ra, self._dec
        plain_ra, plain_dec = self._bases()
        # A pulse that ends within this turn counts by its share of it: the place is right to the millisecond.
        base_ra = plain_ra + ra.guide_rate * max(0.0, min(1.0, (ra.guide_until_s - self._time) / span))
        base_dec = plain_dec + dec.guide_rate * max(0.0, min(1.0, (dec.guide_until_s - self._time) / span))
        goal_ra, goal_dec = self._goals(base_ra, base_dec)
        if self._parked:
            ra.coast(span)
            dec.coast(span)
        else:
            count = max(1, math.ceil(span / self._step_s - 1e-3))
            ra.run(count, span / count, base_ra, goal_ra)
            dec.run(count, span / count, base_dec, goal_dec)
            ra.settle(base_ra)
            dec.settle(base_dec)
        self._time = now

    def _slewing(self) -> bool:
        """Whether a slew, a MoveAxis or (unless quiet about it) the braking after one is under way."""
        modes = (SLEW, MOVE) if self._p.slewing_field == "quiet" else (SLEW, MOVE, BRAKE)
        return self._ra.mode in modes or self._dec.mode in modes

    def _obey(self, now: float) -> None:
        """Look at the mailbox and act on it."""
        mail = self._mail
        if self._abort_at_s is not None and now >= self._abort_at_s:
            self._stop()
        if mail is None:
            return
        active = mail.active()
        self._served &= active
        self._acked &= active
        self._fine_ra, self._fine_dec = mail.fine_ra / TICS10_PER_DEG, mail.fine_dec / TICS10_PER_DEG
        if self._abort_at_s is None:
            self._follow(mail, active)
        # The highest of the active commands is served; a lower one waits until that is withdrawn.
        highest = active & -active
        if highest & MOVES:
            highest = active & MOVES
        fresh = highest & ~self._served
        if not fresh or (self._abort_at_s is not None and fresh != ABORT):
            return
        self._served |= fresh
        if self._launch(fresh, mail, now):
            self._acked |= fresh
        if fresh in (ABORT, PARK):
            self._served |= active  # Paper silent: a command that an abort or a park ended needs a new edge.

    def _moves(self, mail: Command) -> tuple[tuple[Axis, int, float], ...]:
        """Each axis with its MoveAxis bit and rate in deg/s."""
        return (self._ra, MOVE_RA, mail.rate_ra_deg_s), (self._dec, MOVE_DEC, mail.rate_dec_deg_s)

    def _follow(self, mail: Command, active: int) -> None:
        """Keep up with the flags and rates of a MoveAxis that is held."""
        if self._p.move_axis != "held":
            return
        for axis, bit, rate in self._moves(mail):
            if axis.mode == MOVE:
                if active & bit:
                    axis.move_rate = rate
                else:
                    axis.enter(BRAKE)

    def _launch(self, fresh: int, mail: Command, now: float) -> bool:
        """Carry out commands that have just risen; true where they are accepted."""
        # Paper silent on acknowledging what is refused (slew while slewing, target out of range): it is not.
        if fresh == ABORT:
            if self._abort_at_s is None:
                self._abort_at_s = now + self._p.abort_delay_s
                if self._p.abort_delay_s <= 0.0:
                    self._stop()
        elif fresh == PARK:
            self._parked = True
            self._abort_at_s = None
            for axis in (self._ra, self._dec):
                axis.enter(OFF)
                axis.guide_until_s = now
        elif fresh in (SYNC, SLEWING):
            in_range = 0.0 <= mail.target_ra_h <= DAY_H and abs(mail.target_dec_deg) <= QUARTER_DEG
            if not in_range or (fresh == SLEWING and self._slewing()):
                return False
            self._target = (mail.target_dec_deg, mail.target_ra_h)
            if fresh == SYNC:
                self._sync(mail)
            else:
                self._slew(mail)
        elif fresh & MOVES:
            self._move(fresh, mail)
        else:
            # Paper silent: a pulse also runs on top of a MoveAxis; it does not wake a parked mount.
            for axis, pulse_ms in ((self._ra, mail.pulse_ra_ms), (self._dec, mail.pulse_dec_ms)):
                if pulse_ms and not self._parked:
                    axis.guide_rate = math.copysign(GUIDE_TICS10 / TICS10_PER_DEG, pulse_ms)
                    axis.guide_until_s = now + abs(pulse_ms) / 1000.0
        return True

    def _power(self) -> None:
        """Switch the drives on again (paper silent on unparking: a slew or a MoveAxis does it)."""
        if self._parked:
            self._parked = False
            self._ra.enter(BRAKE)
            self._dec.enter(BRAKE)

    def _stop(self) -> None:
        """Abort: whatever slews or moves brakes to plain tracking, pulses end."""
        self._abort_at_s = None
        for axis in (self._ra, self._dec):
            axis.guide_until_s = 0.0
            if axis.mode in (SLEW, MOVE):
                axis.enter(BRAKE)

    def _sync(self, mail: Command) -> None:
        """Make the reported place the target, on the present side of the pole."""
        _, _, beyond = self._pointing(0.0, 0.0)
        angle = HALF_DEG - mail.target_dec_deg if beyond else mail.target_dec_deg
        self._offset_dec_deg = angle - self._dec.position
        ra_deg = 15.0 * mail.target_ra_h - HALF_DEG * beyond
        self._offset_ra_deg = self._lst_deg() - self._ra.position - ra_deg

    def _slew(self, mail: Command) -> None:
        """Start a slew, the shorter way in both axes, to this side of the pole, and track from then on."""
        ra, dec = self._ra, self._dec
        self._power()
        self._tracking = True
        way_ra = self._lst_deg() - self._offset_ra_deg - 15.0 * mail.target_ra_h - ra.position
        way_dec = mail.target_dec_deg - self._offset_dec_deg - dec.position
        for axis, way in ((ra, way_ra), (dec, way_dec)):
            axis.enter(SLEW)
            axis.target = axis.position + (way + HALF_DEG) % TURN_DEG - HALF_DEG

    def _move(self, fresh: int, mail: Command) -> None:
        """Start a MoveAxis; it ends a slew (paper silent), whose other axis brakes."""
        self._power()
        for axis, bit, rate in self._moves(mail):
            if fresh & bit:
                axis.move_rate = rate
                # An edge with rate zero ends a MoveAxis that stays in force: back to plain tracking.
                plain = rate == 0.0 and self._p.move_axis == "edge" and (self._p.additive or bit == MOVE_DEC)
                axis.enter(BRAKE if plain else MOVE)
            elif axis.mode == SLEW:
                axis.enter(BRAKE)

    def _rates(self, now: float) -> tuple[float, float]:
        """The two rate fields, declination first, in tics/s times 10, by the mount's way of filling them."""
        kind = self._p.rate_fields
        dec, ra = self._dec.velocity, self._ra.velocity
        if kind == "constant":
            return 0.0, 7789.0
        if kind == "nan":
            return math.nan, math.nan
        if kind == "lying":
            bases = self._bases()
            ra, dec = bases if self._abort_at_s is not None else self._goals(*bases)
            if self._parked:
                ra, dec = 0.0, 0.0
        elif kind == "late":
            past = self._past
            past.append((now, dec, ra))
            while len(past) > 1 and past[1][0] <= now - LATE_S:
                past.popleft()
            _, dec, ra = past[0]
        return dec * TICS10_PER_DEG, ra * TICS10_PER_DEG

    def _current(self, axis: Axis) -> int:
        """The current of a drive in units of 10 mA: half an ampere, and more with the acceleration."""
        return 0 if self._parked else round(50.0 + 12.0 * (axis.drive + axis.integral))

    def _pack(self, now: float) -> bytes:
        """The status datagram of this instant."""
        p, noise = self._p, self._p.encoder_noise_deg
        uniform = self._random.uniform
        ra_deg, dec_deg, beyond = self._pointing(uniform(-noise, noise), uniform(-noise, noise))
        lst_deg = self._lst_deg()
        ha, dec, lat = (math.radians(angle) for angle in (lst_deg - ra_deg, dec_deg, p.latitude_deg))
        north = math.sin(dec) * math.cos(lat) - math.cos(dec) * math.cos(ha) * math.sin(lat)
        east = -math.cos(dec) * math.sin(ha)
        height = math.sin(dec) * math.sin(lat) + math.cos(dec) * math.cos(ha) * math.cos(lat)
        altitude_deg = math.degrees(math.atan2(height, math.hypot(north, east)))
        azimuth_deg = math.degrees(math.atan2(east, north)) % TURN_DEG
        slewing = {"false": False, "always": True}.get(p.slewing_field, self._slewing())
        guiding = max(self._ra.guide_until_s, self._dec.guide_until_s) > now
        acked, move = self._acked, self._acked if p.move_ack else 0
        # The appendix hard-codes AtPark to 0, the table gives it a meaning: the table wins.
        flags = (
            0,
            self._parked,
            1,
            0,
            0,
            guiding,
            beyond,
            slewing,
            not slewing,
            0,
            move & MOVE_DEC,
            move & MOVE_RA,
            0,
            0,
            0,
            0,
            0,
            0,
            0,
            acked & ABORT,
            acked & SYNC,
            acked & PULSE,
            acked & SLEWING,
            0,
        )
        rate_dec, rate_ra = map(self._rate_type, self._rates(now))
        counter = float(self._turns) if p.counter_as == "double" else self._turns
        return self._status.pack(
            b"XERXESxx",
            altitude_deg,
            azimuth_deg,
            dec_deg,
            rate_dec,
            ra_deg / 15.0,
            rate_ra,
            lst_deg / 15.0,
            SITE_ELEVATION_M,
            p.latitude_deg,
            p.longitude_deg,
            *self._target,
            counter,
            float(GUIDE_TICS10),
            float(GUIDE_TICS10),
            self._current(self._dec),
            self._current(self._ra),
            *(TRUE_BYTE if flag else 0 for flag in flags),
        )

    def _schedule(self, now: float) -> None:
        """Set the time of the next turn; turns that a late one has overtaken are left out."""
        p, chance = self._p, self._random
        while True:
            if p.timer == "windows":
                # Judged: armed anew from tick to tick, 3 and 4 ticks in turn, 54.6875 ms on average.
                self._grid_s += (3 + self._turns % 2) * TICK_S
            else:
                self._grid_s += PERIOD_S
            if p.start_utc_s + self._grid_s > now:
                break
        late = chance.uniform(0.0, p.timer_jitter_s) if p.timer_jitter_s > 0.0 else 0.0
        if p.stall_s > 0.0 and chance.random() < PERIOD_S / STALL_EVERY_S:
            late += chance.uniform(0.0, p.stall_s)
        self.next_turn_s = p.start_utc_s + self._grid_s + late


def address(text: str) -> tuple[str, int]:
    """HOST:PORT as a pair."""
    host, _, port = text.rpartition(":")
    return host or "127.0.0.1", int(port)


def emit(record: dict[str, float]) -> None:
    """Write one JSON line to standard output."""
    sys.stdout.write(json.dumps(record) + "\n")
    sys.stdout.flush()


def serve(link: socket.socket, mount: Mount, options: argparse.Namespace, chance: Random) -> None:
    """Run the mount by the machine's clock until standard input ends."""
    peer: tuple[str, int] | None = options.peer
    queue: list[tuple[float, int, bool, bytes]] = []
    serial = 0
    while True:
        now = time.time()
        while (queue and queue[0][0] <= now) or mount.next_turn_s <= now:
            if queue and queue[0][0] <= mount.next_turn_s:
                _, _, inward, data = heapq.heappop(queue)
                if inward:
                    mount.receive(data)
                elif peer is not None:
                    with contextlib.suppress(OSError):  # a peer that is not there is no reason to stop
                        link.sendto(data, peer)
                continue
            due = mount.next_turn_s
            serial += 1
            departure = due + options.delay_out + chance.uniform(0.0, options.jitter)
            heapq.heappush(queue, (departure, serial, False, mount.turn()))
            if options.truth:
                emit(mount.truth()._asdict())
        soonest = min(mount.next_turn_s, queue[0][0]) if queue else mount.next_turn_s
        ready, _, _ = select.select([link, sys.stdin], [], [], max(0.0, soonest - time.time()))
        if sys.stdin in ready and not os.read(sys.stdin.fileno(), 4096):
            return
        if link in ready:
            data, sender = link.recvfrom(2048)
            peer = peer or sender
            serial += 1
            arrival = time.time() + options.delay_in + chance.uniform(0.0, options.jitter)
            heapq.heappush(queue, (arrival, serial, True, data))


def main(argv: list[str] | None = None) -> int:
    """Run the mount as a UDP program on the loopback."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--listen", type=int, default=0)
    parser.add_argument("--peer", type=address)
    parser.add_argument("--parameters", type=json.loads, default={})
    parser.add_argument("--delay-in", type=float, default=0.0)
    parser.add_argument("--delay-out", type=float, default=0.0)
    parser.add_argument("--jitter", type=float, default=0.0)
    parser.add_argument("--truth", action="store_true")
    options = parser.parse_args(argv)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    fields = {"start_utc_s": time.time(), **options.parameters}
    parameters = dataclasses.replace(Parameters(), **fields)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
        link.bind(("127.0.0.1", options.listen))
        emit({"port": link.getsockname()[1]})
        serve(link, Mount(parameters), options, Random(parameters.seed + 1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
