"""A mount that speaks the Xerxes protocol, with a position servo on each axis; from the paper alone."""

from __future__ import annotations

import argparse
import contextlib
import heapq
import json
import math
import os
import random
import select
import signal
import socket
import struct
import sys
import time
from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

SIDEREAL_DEG_S = 360.98564736629 / 86400.0
TICS10_PER_DEG = 2.0**26 / 360.0 * 10.0
SIDEREAL_TICS10 = 7789
GUIDE_TICS10 = 3500
J2000_UTC_S = 946728000.0
TURN_S = 0.05
TICK_S = 0.015625
STEP_S = 0.00125
MOST_STEPS = 50
LEASH_DEG = 2.0  # the reference is never further than this from the axis
CATCH_UP_SHARE = 0.5  # share of the acceleration that a large position error is caught up with
SLEW_SHARE = 0.9  # share of the acceleration in a slew's profile; the rest is left for the servo
SLEW_RATE_SHARE = 0.98  # share of the highest rate in a slew's profile
COAST_DEG_S2 = 0.5  # drag of an axis whose drive is off, on top of the friction (paper silent)
SETTLED_DEG = 0.003
SETTLED_DEG_S = 0.005
SETTLE_TIMEOUT_S = 5.0  # a drive that does not come to its window by then is taken as settled
LATE_S = 2.0
STALL_CHANCE = TURN_S / 8.0
SITE_ELEVATION_M = 100.0

COMMAND = struct.Struct("<Qqddddqqii10B")
STATUS = struct.Struct("<8s3d8sd8s6d8s2d2i24s")
HEADER = 0x5555AAAA
ABORT, MOVE_RA, MOVE_DEC, PARK, PULSE, SLEW, SYNC = 1, 3, 4, 5, 6, 7, 8  # places after byte 72
FLAGS = 10
ACK_BYTES = ((MOVE_DEC, 146), (MOVE_RA, 147), (ABORT, 155), (SYNC, 156), (PULSE, 157), (SLEW, 158))
TRACKING_MODE, MOVE_MODE, SLEW_MODE, OFF_MODE = range(4)
CHOICES = {
    "move_axis": ("held", "edge"),
    "timer": ("even", "windows"),
    "rate_fields": ("true", "constant", "late", "lying", "nan"),
    "rates_as": ("int64", "double"),
    "counter_as": ("int64", "double"),
    "slewing_field": ("true", "false", "quiet", "always"),
}


@dataclass(frozen=True)
class Parameters:
    """What the mount is like and where it stands when switched on."""

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

    def __post_init__(self) -> None:
        """Refuse a word that names no mode."""
        for name, allowed in CHOICES.items():
            if getattr(self, name) not in allowed:
                raise ValueError(f"{name} must be one of {allowed}")


class Truth(NamedTuple):
    """Where the axes are, without noise."""

    utc_s: float
    hour_angle_deg: float
    dec_deg: float
    hour_angle_rate_deg_s: float
    dec_rate_deg_s: float
    ra_deg: float
    reported_dec_deg: float


def _near(angle_deg: float, to_deg: float) -> float:
    """The angle, by whole turns brought within half a turn of to_deg."""
    return to_deg + math.remainder(angle_deg - to_deg, 360.0)


def _wrap(value: float, turn: float) -> float:
    """The value within 0 <= value < turn."""
    wrapped = value % turn
    return wrapped if wrapped < turn else 0.0


class Axis:
    """One axis: a reference position in deg, and the servo that follows it."""

    def __init__(self, parameters: Parameters, position_deg: float, base_deg_s: float, additive: bool):
        """Stand at position_deg, and move at base_deg_s with the integral part already settled."""
        self.p = parameters
        self.position_deg = self.reference_deg = position_deg
        self.rate_deg_s = self.reference_deg_s = self.base_deg_s = base_deg_s
        self.additive = additive
        self.mode = TRACKING_MODE
        self.command_deg_s = 0.0
        self.target_deg = position_deg
        self.drive_deg_s2 = 0.0
        self.settling_s = 0.0  # time left in which the axis may come to rest in the sky; 0: it has
        self.omega = 2.0 * math.pi * parameters.bandwidth_hz
        self.gain = 2.0 * parameters.damping * self.omega
        self.integral_deg = (1.0 - parameters.feedforward) * base_deg_s * self.gain / self.omega**2
        if base_deg_s:
            self.integral_deg += math.copysign(parameters.friction, base_deg_s) / self.omega**2

    def move(self, command_deg_s: float) -> None:
        """Follow a MoveAxis rate from now on."""
        self.mode = MOVE_MODE
        self.command_deg_s = command_deg_s

    def move_rate(self) -> float:
        """Whole reference rate of the MoveAxis in force, deg/s; no faster than the mount may."""
        most = self.p.max_rate_deg_s
        return max(-most, min(most, self.command_deg_s + (self.base_deg_s if self.additive else 0.0)))

    def slew(self, target_deg: float) -> None:
        """Go to an angle that moves with the sky."""
        self.mode = SLEW_MODE
        self.target_deg = target_deg

    def brake(self) -> None:
        """Ramp the reference rate down to tracking; the position error made so far is still caught up."""
        if self.mode in (MOVE_MODE, SLEW_MODE):
            self.mode = TRACKING_MODE
            self.settling_s = SETTLE_TIMEOUT_S

    def switch_off(self) -> None:
        """Depower the drive."""
        self.mode = OFF_MODE
        self.settling_s = self.drive_deg_s2 = 0.0

    def switch_on(self) -> None:
        """Power the drive and take the present place and rate as the reference."""
        if self.mode == OFF_MODE:
            self.mode = TRACKING_MODE
            self.reference_deg, self.reference_deg_s = self.position_deg, self.rate_deg_s
            self.integral_deg = 0.0

    def in_motion(self) -> bool:
        """Whether it slews, follows a MoveAxis, brakes, settles or coasts."""
        if self.mode == OFF_MODE:
            return self.rate_deg_s != 0.0
        return self.mode != TRACKING_MODE or self.settling_s > 0.0

    def advance(self, span_s: float) -> None:
        """Move on by span_s."""
        if span_s <= 0.0:
            return
        if self.mode == OFF_MODE:
            self._coast(span_s)
            return
        self._servo(span_s)
        if self.mode == TRACKING_MODE and self.settling_s > 0.0:
            left_deg_s = self.reference_deg_s - self.base_deg_s
            if abs(left_deg_s) < SETTLED_DEG_S:
                self.settling_s -= span_s
                error_deg_s = self.rate_deg_s - self.base_deg_s
                error_deg = self.reference_deg - self.position_deg
                if abs(error_deg) < SETTLED_DEG and abs(error_deg_s) < SETTLED_DEG_S:
                    self.settling_s = 0.0

    def _coast(self, span_s: float) -> None:
        """Slow down by drag and friction alone."""
        drag = COAST_DEG_S2 + self.p.friction
        moving_s = min(span_s, abs(self.rate_deg_s) / drag)
        after = self.rate_deg_s - math.copysign(drag * moving_s, self.rate_deg_s)
        self.position_deg += 0.5 * (self.rate_deg_s + after) * moving_s
        self.rate_deg_s = after if moving_s == span_s else 0.0

    def _servo(self, span_s: float) -> None:
        """Run the position loop over span_s, by the trapezoidal rule (stable for any step and bandwidth).

        drive = omega^2 (error + integral) + 2 damping omega (feedforward * reference rate - rate), written as
        gain * (demanded rate - rate). Where the error is beyond what the drive can take away linearly, the
        demanded rate is kept to one from which the axis can still stop at the reference (else it would ring).
        """
        par = self.p
        steps = max(1, min(MOST_STEPS, math.ceil(span_s / STEP_S - 1e-3)))
        h = span_s / steps
        half = 0.5 * h
        most, top_rate, forward = par.acceleration_deg_s2, par.max_rate_deg_s, par.feedforward
        gain = self.gain
        stiff = self.omega**2 / gain
        rate_gain = gain / (1.0 + gain * half)
        full_gain = gain / (1.0 + gain * half + (self.omega * half) ** 2)
        corner = h * 0.1 * self.omega
        double_share = 2.0 * CATCH_UP_SHARE * most
        linear = CATCH_UP_SHARE * most / stiff**2
        half_linear = 0.5 * linear
        friction, breakaway = par.friction, par.friction + par.stiction
        ripple, ripple_k = par.ripple, par.ripple_per_turn * math.pi / 180.0
        slew_most, slew_h = SLEW_SHARE * most, SLEW_SHARE * most * h
        ramp = most * h
        base, target, mode = self.base_deg_s, self.target_deg, self.mode
        slew_rate = max(0.0, SLEW_RATE_SHARE * top_rate - abs(base))
        pos, rate, integral = self.position_deg, self.rate_deg_s, self.integral_deg
        ref, ref_rate = self.reference_deg, self.reference_deg_s
        if mode == MOVE_MODE:
            ref_rate = self.move_rate()
        drive = 0.0
        sqrt, sin = math.sqrt, math.sin
        for _ in range(steps):
            mean = ref_rate
            if mode == TRACKING_MODE:
                change = base - ref_rate
                if change:
                    change = ramp if change > ramp else -ramp if change < -ramp else change
                    mean += 0.5 * change
                    ref_rate += change
            elif mode == SLEW_MODE:
                away = target - ref
                target += h * base
                size = away if away > 0.0 else -away
                speed = ref_rate - base
                if size <= 2.0 * slew_h * h and -2.0 * slew_h <= speed <= 2.0 * slew_h:
                    mode = TRACKING_MODE
                    ref += away
                    ref_rate = mean = base
                else:
                    wish = sqrt(0.25 * slew_h * slew_h + 2.0 * slew_most * size) - 0.5 * slew_h
                    wish = slew_rate if wish > slew_rate else wish
                    change = (wish if away > 0.0 else -wish) - speed
                    ref_rate += slew_h if change > slew_h else -slew_h if change < -slew_h else change
                    mean = ref_rate
            error = ref - pos
            if error > LEASH_DEG:
                error = LEASH_DEG
                ref = pos + LEASH_DEG
            elif error < -LEASH_DEG:
                error = -LEASH_DEG
                ref = pos - LEASH_DEG
            ahead = error + half * (mean - rate)
            wish = forward * mean + stiff * (ahead + integral)
            use = full_gain
            held = 0  # the side on which a limit holds the drive: the integral part does not grow that way
            if ahead > linear:
                excess = mean - base if mode == TRACKING_MODE and mean > base else 0.0  # it brakes, too
                limit = mean - excess + sqrt(excess * excess + double_share * (ahead - half_linear))
                if wish > limit:
                    wish, use, held = limit, rate_gain, 1
            elif ahead < -linear:
                excess = mean - base if mode == TRACKING_MODE and mean < base else 0.0
                limit = mean - excess - sqrt(excess * excess + double_share * (-ahead - half_linear))
                if wish < limit:
                    wish, use, held = limit, rate_gain, -1
            if wish > top_rate:
                wish, use, held = top_rate, rate_gain, 1
            elif wish < -top_rate:
                wish, use, held = -top_rate, rate_gain, -1
            drive = use * (wish - rate)
            if drive > most:
                drive, held = most, 1
            elif drive < -most:
                drive, held = -most, -1
            if held == 0 or held * ahead < 0.0:
                integral += corner * ahead
            net = drive
            if ripple:
                net -= ripple * sin(ripple_k * pos)
            if breakaway:
                if rate > 0.0:
                    net -= friction
                elif rate < 0.0:
                    net += friction
                elif -breakaway <= net <= breakaway:
                    net = 0.0
                else:
                    net -= friction if net > 0.0 else -friction
            after = rate + h * net
            if breakaway and after * rate < 0.0:
                after = 0.0
            pos += half * (rate + after)
            rate = after
            ref += h * mean
        self.position_deg, self.rate_deg_s, self.integral_deg = pos, rate, integral
        self.reference_deg, self.reference_deg_s = ref, ref_rate
        self.target_deg, self.drive_deg_s2 = target, drive
        if mode != self.mode:
            self.brake()


class Mount:
    """The mount computer: a 50 ms loop, a mailbox, two axes."""

    def __init__(self, parameters: Parameters) -> None:
        """Switch it on at start_utc_s; the first turn is due at once."""
        self.p = parameters
        self.rng = random.Random(parameters.seed)
        self._tracking = parameters.tracking
        base = SIDEREAL_DEG_S if parameters.tracking else 0.0
        self.ra = Axis(parameters, parameters.hour_angle_deg, base, parameters.additive)
        self.dec = Axis(parameters, parameters.dec_deg, 0.0, True)
        self._moves = ((MOVE_RA, self.ra), (MOVE_DEC, self.dec))
        self._now = parameters.start_utc_s
        self._turns = 0
        self.next_turn_s = self._now + self._lateness()
        self._box: tuple[int | float, ...] | None = None
        self._seen = [False] * FLAGS  # commands whose rising edge has been dealt with
        self._acks = [False] * FLAGS
        self._abort_due_s: float | None = None
        self._quiet = False
        self._parked = False
        self._ra_offset_deg = self._dec_offset_deg = 0.0
        self._target_ra_h = self._target_dec_deg = 0.0
        self._pulse_end_s = [0.0, 0.0]
        self._pulse_deg_s = [0.0, 0.0]
        self._counter = 0
        self._past: deque[tuple[float, float, float]] = deque()

    def receive(self, datagram: bytes) -> None:
        """Put a datagram that has just arrived into the mailbox; anything but a valid command is ignored."""
        if len(datagram) != COMMAND.size:
            return
        fields = COMMAND.unpack(datagram)
        if fields[0] == HEADER and all(math.isfinite(value) for value in fields[2:6]):
            self._box = fields  # by arrival: the rolling counter is for diagnosis only

    def turn(self) -> bytes:
        """Move the axes on to next_turn_s, act on the mailbox, return the status of that instant."""
        span_s = self.next_turn_s - self._now
        self.ra.advance(span_s)
        self.dec.advance(span_s)
        self._now = self.next_turn_s
        self._obey()
        self._set_base()
        status = self._status()
        self._schedule()
        return status

    def truth(self) -> Truth:
        """Where the axes are, as of the last turn."""
        ra_deg, dec_deg, _ = self._sky(self.ra.position_deg, self.dec.position_deg)
        return Truth(
            self._now,
            self.ra.position_deg,
            self.dec.position_deg,
            self.ra.rate_deg_s,
            self.dec.rate_deg_s,
            ra_deg,
            dec_deg,
        )

    def _lateness(self) -> float:
        """By how much a turn comes late, s."""
        late_s = 0.0
        if self.p.timer_jitter_s > 0.0:
            late_s += self.rng.uniform(0.0, self.p.timer_jitter_s)
        if self.p.stall_s > 0.0 and self.rng.random() < STALL_CHANCE:
            late_s += self.rng.uniform(0.0, self.p.stall_s)
        return late_s

    def _schedule(self) -> None:
        """Set next_turn_s. A timer's missed turns are dropped; its due times stay where they were."""
        due_s = self._now
        while due_s < self._now + 1e-3:
            self._turns += 1
            after_s = self._turns * TURN_S
            if self.p.timer == "windows":  # due each 50 ms, served at the next tick: 62.5, 4 x 46.875 ms
                after_s = math.ceil(after_s / TICK_S - 1e-6) * TICK_S
            due_s = self.p.start_utc_s + after_s
        self.next_turn_s = due_s + self._lateness()

    def _lst_deg(self) -> float:
        """Sidereal time of the mount's own clock, 0..360 deg."""
        drift_s = 1e-6 * self.p.clock_drift_ppm * (self._now - self.p.start_utc_s)
        utc_s = self._now + self.p.clock_error_s + drift_s
        days = (utc_s - J2000_UTC_S) / 86400.0
        gmst = 280.46061837 + 360.98564736629 * days + 0.000387933 * (days / 36525.0) ** 2
        return _wrap(gmst + self.p.longitude_deg, 360.0)

    def _sky(self, hour_angle_deg: float, axis_dec_deg: float) -> tuple[float, float, bool]:
        """Reported RA and Dec in deg, and whether the tube is beyond the pole, for these axis angles."""
        ra_deg = self._lst_deg() - hour_angle_deg - self._ra_offset_deg
        dec_deg = math.remainder(axis_dec_deg + self._dec_offset_deg, 360.0)
        beyond = abs(dec_deg) > 90.0
        if beyond:
            dec_deg = math.copysign(180.0, dec_deg) - dec_deg
            ra_deg += 180.0
        return _wrap(ra_deg, 360.0), dec_deg, beyond

    def _set_base(self) -> None:
        """Set each axis' rate of plain tracking: sidereal, fine rates (RA: positive westward) and pulses."""
        fine = (0.0, 0.0)
        if self._box is not None and self._tracking:
            most = self.p.max_rate_deg_s
            fine = tuple(max(-most, min(most, self._box[at] / TICS10_PER_DEG)) for at in (7, 6))
        for axis, which, rate in ((self.ra, 0, SIDEREAL_DEG_S * self._tracking), (self.dec, 1, 0.0)):
            pulse = self._pulse_deg_s[which] if self._now < self._pulse_end_s[which] else 0.0
            axis.base_deg_s = rate + fine[which] + pulse

    def _obey(self) -> None:
        """Look at the mailbox; serve the highest of the active commands.

        Paper silent on the order below abort: park, MoveAxis, slew, sync, pulse. A lower one waits while a
        higher one is up, and is served afterwards if it is still up. No datagram for long changes nothing.
        """
        if self._box is None:
            return
        up = self._box[10:]
        for command in range(FLAGS):
            if not up[command]:
                self._seen[command] = self._acks[command] = False
        if self._abort(bool(up[ABORT])):
            return
        if up[PARK]:
            if self._edge(PARK):
                self._park()
        elif not self._move_axis(up):
            if up[SLEW]:
                self._slew()
            elif up[SYNC]:
                self._sync()
            elif up[PULSE]:
                self._pulse()

    def _edge(self, command: int) -> bool:
        """Whether this active command has not been dealt with yet; from now on it has."""
        new = not self._seen[command]
        self._seen[command] = True
        return new

    def _abort(self, up: bool) -> bool:
        """Serve an abort; true while one is up or yet to be carried out, so that nothing else is served.

        A MoveAxis flag that is up with the abort needs a new edge afterwards. An abort ends pulses too.
        """
        if up:
            if self._edge(ABORT):
                self._acks[ABORT] = True
                self._abort_due_s = self._now + self.p.abort_delay_s
                self._pulse_end_s = [0.0, 0.0]
            for command, _ in self._moves:
                self._seen[command] = self._seen[command] or bool(self._box and self._box[10 + command])
        if self._abort_due_s is not None:
            if self._now < self._abort_due_s - 1e-6:
                return True
            self._abort_due_s = None
            self.ra.brake()
            self.dec.brake()
            self._quiet = True
        return up

    def _park(self) -> None:
        """Drives off where the axes are. No unpark in the paper: the next MoveAxis or slew powers them."""
        self._parked = True
        self._pulse_end_s = [0.0, 0.0]
        self.ra.switch_off()
        self.dec.switch_off()

    def _unpark(self) -> None:
        """Drives on."""
        self._parked = self._quiet = False
        self.ra.switch_on()
        self.dec.switch_on()

    def _move_axis(self, up: tuple[int | float, ...]) -> bool:
        """Serve the MoveAxis flags; true if either is up. A MoveAxis ends a slew on both axes."""
        par, box = self.p, self._box or ()
        rates = (par.ra_sign * par.ra_gain * box[5], par.dec_sign * par.dec_gain * box[4])
        for (command, axis), rate in zip(self._moves, rates, strict=True):
            if up[command]:
                if self._edge(command):
                    self._acks[command] = par.move_ack
                    self._unpark()
                    for other in (self.ra, self.dec):
                        if other.mode == SLEW_MODE:
                            other.brake()
                    axis.move(rate)
                elif par.move_axis == "held" and axis.mode == MOVE_MODE:
                    axis.move(rate)
            elif par.move_axis == "held" and axis.mode == MOVE_MODE:
                axis.brake()
                self._quiet = MOVE_MODE not in (self.ra.mode, self.dec.mode)
        return bool(up[MOVE_RA] or up[MOVE_DEC])

    def _target(self) -> bool:
        """Take the target of the datagram over, if it is one on the sky."""
        box = self._box or ()
        if not (0.0 <= box[3] <= 24.0 and -90.0 <= box[2] <= 90.0):
            return False
        self._target_dec_deg, self._target_ra_h = float(box[2]), float(box[3])
        return True

    def _slew(self) -> None:
        """Start a slew. While slewing, or with a target not on the sky, it is ignored and not acknowledged.

        It always ends on the near side of the pole, tracking.
        """
        if not self._edge(SLEW) or self.ra.in_motion() or self.dec.in_motion() or not self._target():
            return
        self._acks[SLEW] = True
        self._unpark()
        self._tracking = True
        hour_angle_deg = self._lst_deg() - self._ra_offset_deg - 15.0 * self._target_ra_h
        self.ra.slew(_near(hour_angle_deg, self.ra.position_deg))
        self.dec.slew(_near(self._target_dec_deg - self._dec_offset_deg, self.dec.position_deg))

    def _sync(self) -> None:
        """Shift the reported RA and Dec to the target, on the present side of the pole; ignored in a slew."""
        if not self._edge(SYNC) or SLEW_MODE in (self.ra.mode, self.dec.mode) or not self._target():
            return
        self._acks[SYNC] = True
        beyond = self._sky(self.ra.position_deg, self.dec.position_deg)[2]
        dec_deg = 180.0 - self._target_dec_deg if beyond else self._target_dec_deg
        ra_deg = 15.0 * self._target_ra_h + (180.0 if beyond else 0.0)
        self._dec_offset_deg = math.remainder(dec_deg - self.dec.position_deg, 360.0)
        self._ra_offset_deg = math.remainder(self._lst_deg() - self.ra.position_deg - ra_deg, 360.0)

    def _pulse(self) -> None:
        """Start pulses: positive goes west (hour angle grows) and north. Ignored in a slew or parked."""
        if not self._edge(PULSE) or self._parked or SLEW_MODE in (self.ra.mode, self.dec.mode):
            return
        self._acks[PULSE] = True
        box = self._box or ()
        for which in (0, 1):
            duration_ms = box[8 + which]
            if duration_ms:
                self._pulse_deg_s[which] = math.copysign(GUIDE_TICS10 / TICS10_PER_DEG, duration_ms)
                self._pulse_end_s[which] = self._now + 1e-3 * abs(duration_ms) - 1e-6

    def _rates(self) -> tuple[float, float]:
        """What the fields RightAscensionRate and DeclinationRate say, tics/s x 10."""
        mode = self.p.rate_fields
        if mode == "constant":
            return SIDEREAL_TICS10, 0.0
        if mode == "nan":
            return math.nan, math.nan
        if mode == "lying":
            goals = [
                axis.move_rate()
                if axis.mode == MOVE_MODE and self._abort_due_s is None
                else 0.0
                if axis.mode == OFF_MODE
                else axis.base_deg_s
                for axis in (self.ra, self.dec)
            ]
            ra = SIDEREAL_TICS10 if goals[0] == SIDEREAL_DEG_S else goals[0] * TICS10_PER_DEG
            return ra, goals[1] * TICS10_PER_DEG
        true = (self.ra.rate_deg_s * TICS10_PER_DEG, self.dec.rate_deg_s * TICS10_PER_DEG)
        if mode == "true":
            return true
        past = self._past
        past.append((self._now, *true))
        while len(past) > 1 and past[1][0] <= self._now - LATE_S + 1e-6:
            past.popleft()
        return past[0][1], past[0][2]

    def _slewing(self) -> bool:
        """What the field Slewing says."""
        moving = self.ra.in_motion() or self.dec.in_motion()
        if not moving or {MOVE_MODE, SLEW_MODE} & {self.ra.mode, self.dec.mode}:
            self._quiet = False
        mode = self.p.slewing_field
        return mode == "always" or (mode != "false" and moving and not (mode == "quiet" and self._quiet))

    def _status(self) -> bytes:
        """Pack the status of this instant."""
        noise = self.p.encoder_noise_deg
        ra_deg, dec_deg, beyond = self._sky(
            self.ra.position_deg + self.rng.uniform(-noise, noise),
            self.dec.position_deg + self.rng.uniform(-noise, noise),
        )
        lst_deg = self._lst_deg()
        angle, dec, lat = (math.radians(value) for value in (lst_deg - ra_deg, dec_deg, self.p.latitude_deg))
        up = math.sin(lat) * math.sin(dec) + math.cos(lat) * math.cos(dec) * math.cos(angle)
        north = math.cos(lat) * math.sin(dec) - math.sin(lat) * math.cos(dec) * math.cos(angle)
        east = -math.cos(dec) * math.sin(angle)
        self._counter += 1
        doubles = self.p.rates_as == "double" or self.p.rate_fields == "nan"
        ra_field, dec_field = (
            struct.pack("<d", rate) if doubles else struct.pack("<q", round(rate)) for rate in self._rates()
        )
        count = struct.pack("<d" if self.p.counter_as == "double" else "<q", self._counter)
        tail = bytearray(24)  # bytes 136 to 159
        slewing = self._slewing()
        guiding = self._now < max(self._pulse_end_s)
        for at, flag in (
            (137, self._parked),
            (138, True),
            (141, guiding),
            (142, beyond),
            (143, slewing),
            (144, not slewing),
            *((at, self._acks[command]) for command, at in ACK_BYTES),
        ):
            tail[at - 136] = 0xFF if flag else 0
        most = self.p.acceleration_deg_s2
        amps = [
            0 if axis.mode == OFF_MODE else round(50.0 + 150.0 * abs(axis.drive_deg_s2) / most)
            for axis in (self.dec, self.ra)
        ]
        return STATUS.pack(
            b"XERXESxx",
            math.degrees(math.atan2(up, math.hypot(north, east))),
            _wrap(math.degrees(math.atan2(east, north)), 360.0),
            dec_deg,
            dec_field,
            ra_deg / 15.0,
            ra_field,
            lst_deg / 15.0,
            SITE_ELEVATION_M,
            self.p.latitude_deg,
            self.p.longitude_deg,
            self._target_dec_deg,
            self._target_ra_h,
            count,
            GUIDE_TICS10,
            GUIDE_TICS10,
            amps[0],
            amps[1],
            bytes(tail),
        )


def _arguments(argv: list[str]) -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--listen", type=int, default=0, metavar="PORT")
    parser.add_argument("--peer", metavar="HOST:PORT")
    parser.add_argument("--parameters", type=json.loads, default={}, metavar="JSON")
    parser.add_argument("--delay-in", type=float, default=0.0, metavar="S")
    parser.add_argument("--delay-out", type=float, default=0.0, metavar="S")
    parser.add_argument("--jitter", type=float, default=0.0, metavar="S")
    parser.add_argument("--truth", action="store_true")
    return parser.parse_args(argv)


def _say(value: object) -> None:
    """Write one JSON line to standard output."""
    sys.stdout.write(json.dumps(value) + "\n")
    sys.stdout.flush()


def _loop(mount: Mount, link: socket.socket, options: argparse.Namespace, ended: list[bool]) -> None:
    """Run turns at their time and carry datagrams, until standard input ends or a signal asks for it."""
    peer: tuple[str, int] | None = None
    if options.peer:
        host, _, port = options.peer.rpartition(":")
        peer = (host, int(port))
    waiting: list[tuple[float, int, bool, bytes]] = []
    number = 0

    def delay(seconds: float, inward: bool, datagram: bytes) -> None:
        nonlocal number
        number += 1
        late = mount.rng.uniform(0.0, options.jitter) if options.jitter > 0.0 else 0.0
        heapq.heappush(waiting, (time.time() + seconds + late, number, inward, datagram))

    while not ended:
        due = min(mount.next_turn_s, waiting[0][0] if waiting else math.inf)
        ready = select.select([link, sys.stdin], [], [], max(0.0, min(0.1, due - time.time())))[0]
        if sys.stdin in ready and not os.read(sys.stdin.fileno(), 4096):
            return
        if link in ready:
            try:
                datagram, sender = link.recvfrom(2048)
                peer = peer or sender
                delay(options.delay_in, True, datagram)
            except OSError:  # the peer is not there (yet)
                pass
        now = time.time()
        while min(mount.next_turn_s, waiting[0][0] if waiting else math.inf) <= now:
            if waiting and waiting[0][0] <= mount.next_turn_s:
                _, _, inward, datagram = heapq.heappop(waiting)
                if inward:
                    mount.receive(datagram)
                elif peer:
                    with contextlib.suppress(OSError):
                        link.sendto(datagram, peer)
            else:
                delay(options.delay_out, False, mount.turn())
                if options.truth:
                    _say(mount.truth()._asdict())


def main(argv: list[str]) -> int:
    """Run the mount as a UDP program on 127.0.0.1."""
    options = _arguments(argv)
    mount = Mount(Parameters(**({"start_utc_s": time.time()} | options.parameters)))
    ended: list[bool] = []
    signal.signal(signal.SIGTERM, lambda *_: ended.append(True))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
        link.bind(("127.0.0.1", options.listen))
        link.setblocking(False)
        _say({"port": link.getsockname()[1]})
        _loop(mount, link, options, ended)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
