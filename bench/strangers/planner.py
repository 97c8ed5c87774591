"""A mount that speaks the Xerxes protocol: a trajectory planner over CANopen/EtherCAT drives.

A 50 ms loop plans and the drives interpolate. What is planned in one turn is for the END of the next 50 ms
(so one turn lies between a command and its motion). Drives run linearly from set-point to set-point: the
velocity is a staircase. Angles are in degrees, rates in degrees per second, times in seconds since switch-on.
"""

from __future__ import annotations

import argparse
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
from dataclasses import dataclass, replace
from typing import NamedTuple

TURN_S = 0.05
TICK_S = 0.015625
SIDEREAL_DEG_S = 360.98564736629 / 86400.0
TICS10_PER_DEG = 2.0**26 / 36.0  # encoder tics x 10 in a degree
GUIDE_TICS10 = 3500.0
JERK_PER_ACCELERATION = 8.0
CLAMP_PER_ACCELERATION = 3.0
INTEGRAL_CORNER = 0.1  # of the bandwidth
FAST_LOOP_HZ = 8.0  # loops above it are stepped by 1 ms, those below by 2 ms
COAST_DEG_S2, COAST_PER_S = 0.5, 1.5  # paper silent: drag of an axis without drive
SETTLED_DEG_S, SETTLED_DEG = 0.005, 0.002
SETTLE_MOST_S = 2.0
SLEW_REST_DEG = 1e-7
LATE_S = 2.0
STALL_EVERY_S = 8.0
SITE_ELEVATION_M = 50.0
HEADER = 0x5555AAAA
COMMAND = struct.Struct("<Qq4d2q2i10B")
PRIORITY = ("abort", "park", "move_ra", "move_dec", "slew", "sync", "pulse")  # paper silent below abort
FLAG_AT = {"abort": 11, "move_ra": 13, "move_dec": 14, "park": 15, "pulse": 16, "slew": 17, "sync": 18}
IDLE, ACKNOWLEDGED, REFUSED = 0, 1, 2
HALF_TURN_DEG, FULL_TURN_DEG, POLE_DEG = 180.0, 360.0, 90.0
DEG_PER_HOUR, DAY_HOURS = 15.0, 24.0
SMALL = 1e-9


@dataclass(frozen=True)
class Parameters:
    """What kind of mount it is; see the contract for each field."""

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


def wrap_180(angle_deg: float) -> float:
    """Return the angle in -180..180 degrees."""
    return (angle_deg + HALF_TURN_DEG) % FULL_TURN_DEG - HALF_TURN_DEG


def clamp(value: float, most: float) -> float:
    """Return the value limited to -most..most."""
    return max(-most, min(most, value))


def gmst_deg(utc_s: float) -> float:
    """Return the Greenwich mean sidereal time of a POSIX time, in degrees, 0..360."""
    days = (utc_s - 946728000.0) / 86400.0
    return (280.46061837 + 360.98564736629 * days + 0.000387933 * (days / 36525.0) ** 2) % FULL_TURN_DEG


def fold(dec_deg: float) -> tuple[float, bool]:
    """Return the declination that an axis angle shows, and whether it is beyond the pole."""
    angle = wrap_180(dec_deg)
    if abs(angle) <= POLE_DEG:
        return angle, False
    return math.copysign(HALF_TURN_DEG, angle) - angle, True


class Curve:
    """A jerk-limited way of `distance_deg` from rest to rest, in at most seven pieces."""

    def __init__(self, distance_deg: float, rate: float, acceleration: float, jerk: float) -> None:
        way = abs(distance_deg)
        self.sign = -1.0 if distance_deg < 0.0 else 1.0
        corner = acceleration / jerk
        if way >= 2.0 * acceleration * corner * corner:
            top = 0.5 * acceleration * (math.sqrt(corner * corner + 4.0 * way / acceleration) - corner)
        else:
            top = jerk * (way / (2.0 * jerk)) ** (2.0 / 3.0)
        top = max(min(top, rate), 1e-12)
        ramp = corner if top >= acceleration * corner else math.sqrt(top / jerk)
        hold = max(0.0, top / acceleration - ramp) if ramp == corner else 0.0
        cruise = max(0.0, way / top - 2.0 * ramp - hold)
        self.pieces = ((ramp, jerk), (hold, 0.0), (ramp, -jerk), (cruise, 0.0),
                       (ramp, -jerk), (hold, 0.0), (ramp, jerk))  # fmt: skip
        self.total_s = 4.0 * ramp + 2.0 * hold + cruise

    def at(self, time_s: float) -> tuple[float, float, float]:
        """Return position, rate and acceleration after so many seconds."""
        position = rate = acceleration = 0.0
        left = max(0.0, time_s)
        for length, jerk in self.pieces:
            step = min(left, length)
            position += step * (rate + step * (0.5 * acceleration + step * jerk / 6.0))
            rate += step * (acceleration + 0.5 * step * jerk)
            acceleration += step * jerk
            left -= step
            if left <= 0.0:
                break
        return self.sign * position, self.sign * rate, self.sign * acceleration


class Axis:
    """One axis: its planner (called once a turn), its drive (stepped by 1 or 2 ms) and its friction."""

    def __init__(self, p: Parameters, angle_deg: float, rate_deg_s: float) -> None:
        self.p = p
        self.time_s = 0.0
        self.x, self.v, self.drive = angle_deg, rate_deg_s, 0.0
        omega = 2.0 * math.pi * p.bandwidth_hz
        self.stiffness, self.damper = omega * omega, 2.0 * p.damping * omega
        self.corner = INTEGRAL_CORNER * omega
        self.integral = (1.0 - p.feedforward) * self.damper * rate_deg_s
        if rate_deg_s:
            self.integral += math.copysign(p.friction, rate_deg_s)
        self.step_s = 0.001 if p.bandwidth_hz > FAST_LOOP_HZ else 0.002
        self.enabled = True
        self.segments: deque[tuple[float, float, float]] = deque([(0.0, angle_deg, rate_deg_s)])
        self.knot_s, self.set_point, self.slope = 0.0, angle_deg, rate_deg_s
        self.rate, self.acceleration, self.wanted = rate_deg_s, 0.0, rate_deg_s
        self.move: float | None = None  # MoveAxis rate in force, deg/s on the axis
        self.holding = False  # a MoveAxis flag keeps it going
        self.frozen: float | None = None  # rate at which it goes on until a delayed abort brakes
        self.curve: Curve | None = None
        self.curve_s, self.goal, self.goal_s, self.goal_rate = 0.0, 0.0, 0.0, 0.0
        self.settling = self.braking = False
        self.ready_s: float | None = None
        self.pulse_s, self.pulse_rate = 0.0, 0.0

    # the drive

    def advance(self, end_s: float) -> None:
        """Move the axis on to a time, through the segments that the drive has been given."""
        queue = self.segments
        while self.time_s < end_s - SMALL:
            while len(queue) > 1 and queue[1][0] <= self.time_s + SMALL:
                queue.popleft()
            stop_s = min(end_s, queue[1][0]) if len(queue) > 1 else end_s
            steps = max(1, math.ceil((stop_s - self.time_s) / self.step_s - SMALL))
            if self.enabled:
                self._servo(steps, (stop_s - self.time_s) / steps)
            else:
                self._coast(steps, (stop_s - self.time_s) / steps)
            self.time_s = stop_s

    def _servo(self, steps: int, dt: float) -> None:
        """Step the position loop; past its last set-point a drive goes on at the same rate (paper silent)."""
        begin, origin, slope = self.segments[0]
        p = self.p
        reference = origin + slope * (self.time_s - begin)
        x, v, integral, drive = self.x, self.v, self.integral, self.drive
        stiffness, damper, forward = self.stiffness, self.damper, p.feedforward * slope
        gain, most = stiffness * self.corner * dt, CLAMP_PER_ACCELERATION * p.acceleration_deg_s2
        ripple, waves = p.ripple, math.radians(p.ripple_per_turn)
        friction, static = p.friction, p.friction + p.stiction
        sin, move = math.sin, slope * dt
        for _ in range(steps):
            error = reference - x
            drive = stiffness * error + damper * (forward - v) + integral
            if drive > most:
                drive = most
            elif drive < -most:
                drive = -most
            else:
                integral += gain * error
            force = drive + ripple * sin(waves * x) if ripple else drive
            if static == 0.0:
                v += force * dt
            elif v == 0.0:
                if force > static:
                    v = (force - friction) * dt
                elif force < -static:
                    v = (force + friction) * dt
            else:
                new = v + (force - friction if v > 0.0 else force + friction) * dt
                v = 0.0 if new * v < 0.0 else new
            x += v * dt
            reference += move
        self.x, self.v, self.integral, self.drive = x, v, integral, drive

    def _coast(self, steps: int, dt: float) -> None:
        """Step an axis whose drive is off."""
        drag = COAST_DEG_S2 + self.p.friction
        for _ in range(steps):
            slower = abs(self.v) * (1.0 - COAST_PER_S * dt) - drag * dt
            self.v = math.copysign(slower, self.v) if slower > 0.0 else 0.0
            self.x += self.v * dt
        self.drive = 0.0

    # the planner

    def lead(self, now_s: float) -> tuple[float, float]:
        """Return when the set-point planned now begins to be approached, and the angle where that will be."""
        start_s = max(self.knot_s, now_s + TURN_S)
        return start_s, self.set_point + self.slope * (start_s - self.knot_s)

    def plan(self, now_s: float, base: float, additive: bool) -> None:
        """Write the set-point for the end of the next turn; `base` is the tracking rate in deg/s."""
        if not self.enabled:
            self.wanted = 0.0
            return
        start_s, origin = self.lead(now_s)
        end_s = now_s + 2.0 * TURN_S
        span_s, turn_s = end_s - start_s, end_s - self.knot_s
        self._choose(base, additive, span_s, turn_s)
        if self.curve is not None:
            begin = self.curve.at(self.curve_s + turn_s - span_s)[0]
            self.curve_s += turn_s
            end, rate, self.acceleration = self.curve.at(self.curve_s)
            self.rate = self.goal_rate + rate
            self.slope = self.goal_rate + (end - begin) / span_s
            self.set_point = origin + self.slope * span_s
            if self.curve_s >= self.curve.total_s:
                self.rate, self.acceleration = self.goal_rate, 0.0
                self._arrive(end_s)
        else:
            before = self.rate
            self._ramp(span_s)
            self.slope = 0.5 * (before + self.rate)
            self.set_point = origin + self.slope * span_s
        self.knot_s = end_s
        self.segments.append((start_s, origin, self.slope))
        if self.settling:
            self._settle(now_s)

    def _choose(self, base: float, additive: bool, span_s: float, turn_s: float) -> None:
        """Set the wanted rate, deg/s, and let the pulse guide timer run."""
        guide = 0.0
        if self.pulse_s > 0.0:
            guide = self.pulse_rate * min(1.0, self.pulse_s / span_s)
            self.pulse_s = max(0.0, self.pulse_s - turn_s)
        if self.frozen is not None:
            wanted = self.frozen
        elif self.curve is not None:
            wanted = self.goal_rate
        elif self.move is not None:
            wanted = self.move + base if additive else self.move
        else:
            wanted = base + guide
        self.wanted = clamp(wanted, self.p.max_rate_deg_s)

    def _ramp(self, span_s: float) -> None:
        """Bring the planned rate nearer to the wanted one, with limited acceleration and jerk."""
        most = self.p.acceleration_deg_s2
        jerk = JERK_PER_ACCELERATION * most
        change = jerk * span_s
        error = self.wanted - self.rate
        size = abs(error)
        best = min(size / span_s, most, math.sqrt(0.25 * change * change + 2.0 * jerk * size) - 0.5 * change)
        best = math.copysign(best, error)
        self.acceleration += clamp(best - self.acceleration, change + SMALL)
        self.rate += self.acceleration * span_s
        if abs(self.wanted - self.rate) < SMALL and abs(self.acceleration) <= change + SMALL:
            self.rate, self.acceleration = self.wanted, 0.0

    def slew(self, now_s: float, way_deg: float, rate: float) -> None:
        """Start a slew by `way_deg` in a frame that moves at `rate`."""
        self.goal_s, origin = self.lead(now_s)
        self.goal, self.goal_rate = origin + way_deg, rate
        self.settling = self.braking = False
        self._new_curve(way_deg)

    def _new_curve(self, way_deg: float) -> None:
        most = self.p.acceleration_deg_s2
        self.curve_s = 0.0
        room = max(0.01, self.p.max_rate_deg_s - self.goal_rate)
        self.curve = Curve(way_deg, room, most, JERK_PER_ACCELERATION * most)

    def _arrive(self, end_s: float) -> None:
        """End a slew, or go what late turns have left of it."""
        rest = self.goal + self.goal_rate * (end_s - self.goal_s) - self.set_point
        if abs(rest) > SLEW_REST_DEG:
            self._new_curve(rest)
        else:
            self.curve = None
            self.settle(braking=False)

    def stop(self) -> None:
        """Give up whatever it does, and go back to tracking."""
        busy = self.active()
        self.move = self.frozen = self.curve = None
        self.holding = False
        if busy:
            self.settle(braking=True)

    def settle(self, braking: bool) -> None:
        """Count as slewing until the axis does as planned."""
        self.settling, self.braking, self.ready_s = True, braking, None

    def _settle(self, now_s: float) -> None:
        if self.ready_s is None:
            if self.acceleration == 0.0 and abs(self.rate - self.wanted) < SETTLED_DEG_S:
                self.ready_s = self.knot_s
            return
        _, origin, slope = self.segments[0]
        off = abs(self.x - origin - slope * (now_s - self.segments[0][0]))
        calm = abs(self.v - self.wanted) < SETTLED_DEG_S and off < SETTLED_DEG
        late_s = now_s - self.ready_s
        if late_s > SETTLE_MOST_S or (late_s >= -SMALL and calm):
            self.settling = self.braking = False

    def active(self) -> bool:
        """Return whether it counts as slewing."""
        return self.commanded() or self.settling

    def commanded(self) -> bool:
        """Return whether a slew or a MoveAxis is in force."""
        return self.move is not None or self.curve is not None or self.frozen is not None

    def park(self) -> None:
        """Switch the drive off."""
        self.stop()
        self.enabled = self.settling = self.braking = False
        self.pulse_s = 0.0

    def wake(self) -> None:
        """Switch the drive on again, from where the axis is."""
        if not self.enabled:
            self.enabled, self.integral = True, 0.0
            self.segments = deque([(self.time_s, self.x, self.v)])
            self.knot_s, self.set_point, self.slope = self.time_s, self.x, self.v
            self.rate, self.acceleration = self.v, 0.0


class Mount:
    """The mount: mailbox, commands, two axes, clock and status."""

    next_turn_s: float

    def __init__(self, parameters: Parameters) -> None:
        p = self.p = parameters
        self.random = random.Random(p.seed)
        self.following = p.tracking
        self.ra = Axis(p, p.hour_angle_deg, SIDEREAL_DEG_S if p.tracking else 0.0)
        self.dec = Axis(p, p.dec_deg, 0.0)
        self.axes = {"move_ra": self.ra, "move_dec": self.dec}
        self.lst_at_start = gmst_deg(p.start_utc_s) + p.longitude_deg + SIDEREAL_DEG_S * p.clock_error_s
        self.ra_offset = self.dec_offset = 0.0
        self.mail: tuple = (0.0,) * 20
        self.state = dict.fromkeys(PRIORITY, IDLE)
        self.abort_s: float | None = None
        self.parked = False
        self.now_s = 0.0
        self.counter = self.windows_turns = 0
        self.history: deque[tuple[float, float, float]] = deque()
        rates, count = ("q" if kind == "int64" else "d" for kind in (p.rates_as, p.counter_as))
        self.whole_rates = p.rates_as == "int64" and p.rate_fields != "nan"
        rates = rates if self.whole_rates else "d"
        self.layout = struct.Struct(f"<8s3d{rates}d{rates}6d{count}2d2i24s")
        ra_deg, dec_deg, _ = self._sky(p.hour_angle_deg, p.dec_deg)
        self.target = (ra_deg / DEG_PER_HOUR, dec_deg)
        self.due_s = 0.0  # when the timer means the next turn to be
        self.turn_s = min(TURN_S, self.random.uniform(0.0, p.timer_jitter_s))
        self.next_turn_s = p.start_utc_s + self.turn_s

    def receive(self, datagram: bytes) -> None:
        """Put a datagram that has just arrived into the mailbox; what is not a valid command is ignored."""
        if len(datagram) == COMMAND.size:
            fields = COMMAND.unpack(datagram)
            if fields[0] == HEADER:
                self.mail = fields

    def turn(self) -> bytes:
        """Move the axes on to next_turn_s, look at the mailbox, act, return the status, set next_turn_s."""
        now_s = self.now_s = self.turn_s
        self.ra.advance(now_s)
        self.dec.advance(now_s)
        self._obey(now_s)
        most = self.p.max_rate_deg_s  # paper silent: fine rates add to sidereal while they are sent
        fine_dec, fine_ra = (clamp(self.mail[i] / TICS10_PER_DEG, most) for i in (6, 7))
        self.ra.plan(now_s, SIDEREAL_DEG_S + fine_ra if self.following else 0.0, self.p.additive)
        self.dec.plan(now_s, fine_dec if self.following else 0.0, True)
        self.counter += 1
        status = self._status()
        self._schedule()
        return status

    def truth(self) -> Truth:
        """Return where the axes are, as of the last turn."""
        ra_deg, dec_deg, _ = self._sky(self.ra.x, self.dec.x)
        utc_s = self.p.start_utc_s + self.now_s
        return Truth(utc_s, self.ra.x, self.dec.x, self.ra.v, self.dec.v, ra_deg, dec_deg)

    # the timer

    def _schedule(self) -> None:
        """Set the time of the next turn; those that a late one has overrun are dropped, as in Forms."""
        p, chance = self.p, self.random
        late_s = chance.uniform(0.0, p.timer_jitter_s) if p.timer_jitter_s else 0.0
        if p.stall_s and chance.random() < TURN_S / STALL_EVERY_S:
            late_s += chance.uniform(0.0, p.stall_s)
        while True:
            self.windows_turns += 1  # 50 ms is 3.2 ticks: taken as 4 and 3 in turn
            self.due_s += TURN_S if p.timer == "even" else TICK_S * (3 + self.windows_turns % 2)
            if self.due_s + late_s > self.now_s + 0.002:
                break
        self.turn_s = self.due_s + late_s
        self.next_turn_s = p.start_utc_s + self.turn_s

    # commands

    def _obey(self, now_s: float) -> None:
        """Examine the newest datagram: the highest active command is launched at its rising edge."""
        mail, state = self.mail, self.state
        if mail[FLAG_AT["abort"]] and state["abort"] == IDLE and self.abort_s is None:
            state["abort"] = ACKNOWLEDGED  # before the fall of a MoveAxis flag that comes with it
            self._do_abort()
        for name in PRIORITY:
            if not mail[FLAG_AT[name]]:
                if state[name] != IDLE and name in self.axes:
                    self._release(self.axes[name])
                state[name] = IDLE
        if self.abort_s is not None:
            if now_s < self.abort_s - SMALL:
                return  # paper silent: until a delayed abort has begun to brake, new commands wait
            self._brake()
        for name in PRIORITY:
            if mail[FLAG_AT[name]]:
                if state[name] == IDLE:
                    state[name] = ACKNOWLEDGED if getattr(self, "_do_" + name)() else REFUSED
                if name not in self.axes:
                    break  # paper silent: a held MoveAxis does not keep others waiting
        for name, axis in self.axes.items():
            if axis.holding:
                axis.move = self._move_rate(name, axis.move)

    def _move_rate(self, name: str, otherwise: float | None) -> float | None:
        """Return the MoveAxis rate of the newest datagram as it comes out on the axis, deg/s."""
        p = self.p
        at, gain = (5, p.ra_gain * p.ra_sign) if name == "move_ra" else (4, p.dec_gain * p.dec_sign)
        rate = self.mail[at] * gain
        return rate if math.isfinite(rate) else otherwise

    def _release(self, axis: Axis) -> None:
        """A MoveAxis flag has fallen."""
        if axis.holding or axis.move == 0.0:
            axis.stop()

    def _brake(self) -> None:
        """Obey an abort: both axes ramp to tracking."""
        self.abort_s = None
        for axis in self.axes.values():
            axis.stop()

    def _do_abort(self) -> None:
        for name in PRIORITY[1:]:  # paper silent: an abort uses up the edges of all else that is active
            if self.mail[FLAG_AT[name]] and self.state[name] == IDLE:
                self.state[name] = REFUSED
        for axis in self.axes.values():
            axis.pulse_s = 0.0
            if self.p.abort_delay_s > 0.0 and axis.commanded():
                axis.frozen, axis.holding, axis.curve, axis.move = axis.rate, False, None, None
        if self.p.abort_delay_s > 0.0:
            self.abort_s = self.now_s + self.p.abort_delay_s
        else:
            self._brake()

    def _do_park(self) -> bool:
        for axis in self.axes.values():
            axis.park()
        self.parked = True
        self.following = False
        return True

    def _wake(self) -> None:
        """Paper silent on the end of a park: a slew or a MoveAxis switches the drives on, as they were."""
        if self.parked:
            self.parked = False
            self.following = self.p.tracking
            for axis in self.axes.values():
                axis.wake()

    def _do_move_ra(self) -> bool:
        return self._do_move("move_ra")

    def _do_move_dec(self) -> bool:
        return self._do_move("move_dec")

    def _do_move(self, name: str) -> bool:
        """Start a MoveAxis; paper silent: it breaks off a slew of both axes."""
        rate = self._move_rate(name, None)
        if rate is None:
            return False
        self._wake()
        for axis in self.axes.values():
            if axis.curve is not None:
                axis.stop()
        axis = self.axes[name]
        axis.move, axis.holding = rate, self.p.move_axis == "held"
        axis.settling = axis.braking = False
        return True

    def _read_target(self) -> tuple[float, float] | None:
        """Return the target as right ascension and declination in degrees, or None if it is not one."""
        dec_deg, ra_h = self.mail[2], self.mail[3]
        if not (abs(dec_deg) <= POLE_DEG and 0.0 <= ra_h <= DAY_HOURS):
            return None
        self.target = (ra_h, dec_deg)
        return ra_h * DEG_PER_HOUR, dec_deg

    def _do_slew(self) -> bool:
        """Start a slew; paper silent: one that is ignored is not acknowledged either."""
        target = None if self.ra.active() or self.dec.active() else self._read_target()
        if target is None:
            return False
        self._wake()
        self.following = True
        start_s, angle = self.ra.lead(self.now_s)
        hour_angle = self._lst(start_s) - self.ra_offset - target[0]
        self.ra.slew(self.now_s, wrap_180(hour_angle - angle), SIDEREAL_DEG_S)
        self.dec.slew(self.now_s, wrap_180(target[1] - self.dec_offset - self.dec.lead(self.now_s)[1]), 0.0)
        self.ra.pulse_s = self.dec.pulse_s = 0.0
        return True

    def _do_sync(self) -> bool:
        """Shift what is reported so that it is the target now; the axes stay as they are."""
        target = self._read_target()
        if target is None:
            return False
        shown = self.dec.x + self.dec_offset
        beyond = fold(shown)[1]
        turn = HALF_TURN_DEG if beyond else 0.0
        self.dec_offset += wrap_180((HALF_TURN_DEG - target[1] if beyond else target[1]) - shown)
        self.ra_offset = wrap_180(self._lst(self.now_s) - self.ra.x + turn - target[0])
        return True

    def _do_pulse(self) -> bool:
        """Start the guide timers; paper silent: not while slewing, and a zero leaves that axis alone."""
        if self.parked or self.ra.active() or self.dec.active():
            return False
        for axis, milliseconds in ((self.ra, self.mail[8]), (self.dec, self.mail[9])):
            if milliseconds:
                axis.pulse_s = abs(milliseconds) / 1000.0
                axis.pulse_rate = math.copysign(GUIDE_TICS10 / TICS10_PER_DEG, milliseconds)
        return True

    # the status

    def _lst(self, now_s: float) -> float:
        """Return the local sidereal time of the mount's clock, degrees."""
        return self.lst_at_start + SIDEREAL_DEG_S * now_s * (1.0 + 1e-6 * self.p.clock_drift_ppm)

    def _sky(self, hour_angle_deg: float, dec_deg: float) -> tuple[float, float, bool]:
        """Return right ascension (0..360) and declination in degrees, and whether it is beyond the pole."""
        dec_deg, beyond = fold(dec_deg + self.dec_offset)
        turn = HALF_TURN_DEG if beyond else 0.0
        ra_deg = (self._lst(self.now_s) - hour_angle_deg - self.ra_offset + turn) % FULL_TURN_DEG
        return (ra_deg if ra_deg < FULL_TURN_DEG else 0.0), dec_deg, beyond

    def _rates(self) -> tuple[float, float]:
        """Return the two rate fields, declination first, in encoder tics per second x 10."""
        mode = self.p.rate_fields
        true = (self.now_s, self.dec.v * TICS10_PER_DEG, self.ra.v * TICS10_PER_DEG)
        if mode == "constant":
            return 0.0, 7789.0
        if mode == "nan":
            return math.nan, math.nan
        if mode == "lying":
            return self.dec_goal() * TICS10_PER_DEG, self.ra_goal() * TICS10_PER_DEG
        if mode == "late":
            self.history.append(true)
            while len(self.history) > 1 and self.history[1][0] <= self.now_s - LATE_S + SMALL:
                self.history.popleft()
            return self.history[0][1:]
        return true[1:]

    def ra_goal(self) -> float:
        """Return the rate in hour angle once the last command is fulfilled, deg/s."""
        return self.ra.wanted if self.abort_s is None else SIDEREAL_DEG_S

    def dec_goal(self) -> float:
        """Return the rate in declination once the last command is fulfilled, deg/s."""
        return self.dec.wanted if self.abort_s is None else 0.0

    def _slewing(self) -> bool:
        """Return what the Slewing byte says."""
        mode = self.p.slewing_field
        if mode in ("always", "false"):
            return mode == "always"
        axes = self.axes.values()
        if mode == "quiet":
            return any(axis.active() and (axis.commanded() or not axis.braking) for axis in axes)
        return self.abort_s is not None or self.ra.active() or self.dec.active()

    def _status(self) -> bytes:
        """Return the 160 bytes of this turn."""
        p, noise = self.p, self.p.encoder_noise_deg
        ra_axis, dec_axis = self.ra.x, self.dec.x
        if noise:
            ra_axis += self.random.uniform(-noise, noise)
            dec_axis += self.random.uniform(-noise, noise)
        ra_deg, dec_deg, beyond = self._sky(ra_axis, dec_axis)
        lst = self._lst(self.now_s) % FULL_TURN_DEG
        altitude, azimuth = horizontal(lst - ra_deg, dec_deg, p.latitude_deg)
        dec_rate, ra_rate = self._rates()
        if self.whole_rates:
            dec_rate, ra_rate = round(dec_rate), round(ra_rate)
        slewing, acks = self._slewing(), {name: mode == ACKNOWLEDGED for name, mode in self.state.items()}
        flags = bytearray(24)
        for at, value in (
            (137, self.parked), (138, True), (142, beyond),
            (141, max(self.ra.pulse_s, self.dec.pulse_s) > 0.0), (143, slewing), (144, not slewing),
            (146, p.move_ack and acks["move_dec"]), (147, p.move_ack and acks["move_ra"]),
            (155, acks["abort"]), (156, acks["sync"]), (157, acks["pulse"]), (158, acks["slew"]),
        ):  # fmt: skip
            flags[at - 136] = 0xFF if value else 0
        amps = [0 if self.parked else round(50.0 + 10.0 * abs(axis.drive)) for axis in (self.dec, self.ra)]
        return self.layout.pack(
            b"XERXESxx", altitude, azimuth, dec_deg, dec_rate, ra_deg / DEG_PER_HOUR, ra_rate,
            lst / DEG_PER_HOUR, SITE_ELEVATION_M, p.latitude_deg, p.longitude_deg, self.target[1],
            self.target[0], self.counter, GUIDE_TICS10, GUIDE_TICS10, *amps, bytes(flags),
        )  # fmt: skip


def horizontal(hour_angle_deg: float, dec_deg: float, latitude_deg: float) -> tuple[float, float]:
    """Return altitude and azimuth (from north through east, 0..360) in degrees."""
    angle, dec, latitude = (math.radians(a) for a in (hour_angle_deg, dec_deg, latitude_deg))
    up = math.sin(latitude) * math.sin(dec) + math.cos(latitude) * math.cos(dec) * math.cos(angle)
    north = math.cos(latitude) * math.sin(dec) - math.sin(latitude) * math.cos(dec) * math.cos(angle)
    east = -math.cos(dec) * math.sin(angle)
    altitude = math.degrees(math.atan2(up, math.hypot(north, east)))
    return altitude, math.degrees(math.atan2(east, north)) % FULL_TURN_DEG


class Program:
    """A mount behind a UDP socket on the loopback, with delays either way."""

    def __init__(self, options: argparse.Namespace) -> None:
        given = json.loads(options.parameters)
        self.mount = Mount(replace(Parameters(start_utc_s=time.time()), **given))
        self.options, self.number = options, 0
        self.chance = random.Random(self.mount.p.seed + 1)
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", options.listen))
        self.socket.setblocking(False)
        self.peer: tuple[str, int] | None = None
        if options.peer:
            host, _, port = options.peer.rpartition(":")
            self.peer = (host, int(port))
        self.heap: list[tuple[float, int, bool, bytes]] = []
        tell({"port": self.socket.getsockname()[1]})

    def hold(self, inward: bool, data: bytes) -> None:
        """Keep a datagram for its delay."""
        delay_s = self.options.delay_in if inward else self.options.delay_out
        due_s = time.time() + delay_s + self.chance.uniform(0.0, self.options.jitter)
        self.number += 1
        heapq.heappush(self.heap, (due_s, self.number, inward, data))

    def work(self) -> None:
        """Hand over what is due, and take the turn if it is time; in the order of time."""
        while True:
            now_s, turn_s = time.time(), self.mount.next_turn_s
            due_s = self.heap[0][0] if self.heap else math.inf
            if min(due_s, turn_s) > now_s:
                return
            if due_s <= turn_s:
                _, _, inward, data = heapq.heappop(self.heap)
                if inward:
                    self.mount.receive(data)
                else:
                    self.send(data)
                continue
            self.hold(False, self.mount.turn())
            if self.options.truth:
                tell(self.mount.truth()._asdict())

    def send(self, data: bytes) -> None:
        """Send a status, if it is known to whom."""
        if self.peer is not None:
            try:
                self.socket.sendto(data, self.peer)
            except OSError:
                return  # nobody listens there: a datagram is lost

    def read(self) -> None:
        """Take all datagrams that have arrived."""
        while True:
            try:
                data, sender = self.socket.recvfrom(2048)
            except BlockingIOError:
                return
            except OSError:
                continue  # an echo of a datagram that nobody took
            self.peer = self.peer or sender
            self.hold(True, data)

    def run(self) -> None:
        """Serve until standard input ends."""
        while True:
            self.work()
            until_s = min(self.mount.next_turn_s, self.heap[0][0] if self.heap else math.inf)
            ready = select.select([self.socket, 0], [], [], max(0.0, until_s - time.time()))[0]
            if self.socket in ready:
                self.read()
            if 0 in ready and not os.read(0, 4096):
                return


def tell(record: dict[str, float]) -> None:
    """Write one JSON line to standard output."""
    sys.stdout.write(json.dumps(record) + "\n")
    sys.stdout.flush()


def main(argv: list[str]) -> int:
    """Run the mount as a UDP program until standard input ends or at SIGTERM."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--listen", type=int, default=0, metavar="PORT")
    parser.add_argument("--peer", default="", metavar="HOST:PORT")
    parser.add_argument("--parameters", default="{}", metavar="JSON")
    for name in ("--delay-in", "--delay-out", "--jitter"):
        parser.add_argument(name, type=float, default=0.0, metavar="S")
    parser.add_argument("--truth", action="store_true")
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    Program(parser.parse_args(argv)).run()
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
