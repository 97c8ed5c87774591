"""Other ways to steer, written for the comparison: three controllers as they are in use, and an oracle."""

from __future__ import annotations

import math
import statistics
from bisect import bisect_left, bisect_right
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from feeder_harness import PERIOD_S, World, wire

from sattrack.control.axis_filter import AxisFilter, Noise
from sattrack.control.following import correction_deg_s, settling_s
from sattrack.core.angles import wrap180
from sattrack.mount.model import MountProfile
from sattrack.mount.xerxes.datagrams import Command, decode_status, encode_command
from sattrack.mount.xerxes.flags import AxisRates, EdgeMove
from tle.instants import Utc

if TYPE_CHECKING:
    from tle.propagator import Propagator

PROFILE = MountProfile()
GAIN_KNOWN = Noise(first_gain=0.0, gain_walk_sqrt_s=0.0)


class Unshifted:
    """Sends at its own phase."""

    def shift_s(self, now_utc_s: float) -> float:
        return 0.0

    def repeat(self) -> bytes | None:
        return None


@dataclass
class Proportional(Unshifted):
    """Feed-forward of the rate of now, and the reported error of now times a gain: delays ignored."""

    propagator: Propagator
    period_s: float
    gain: float
    integral_gain: float = 0.0
    _sent: int = 0
    _reported: tuple[float, float] | None = None
    _sum: list[float] = field(default_factory=lambda: [0.0, 0.0])

    def status(self, data: bytes, arrival_utc_s: float) -> None:
        status = decode_status(data)
        self._reported = (status.ra_h * 15.0, status.dec_deg)

    def command(self, now_utc_s: float) -> bytes:
        self._sent += 1
        target = self.propagator.at(Utc(now_utc_s))
        rates = [float(target.ra_rate_deg_s), float(target.dec_rate_deg_s)]
        if self._reported is not None:
            errors = (
                wrap180(float(target.ra_deg) - self._reported[0]),
                float(target.dec_deg) - self._reported[1],
            )
            for i, error in enumerate(errors):
                self._sum[i] += error * self.period_s
                rates[i] += self.gain * error + self.integral_gain * self._sum[i]
        return wire(PROFILE, self._sent, *rates)


@dataclass
class Compensated(Unshifted):
    """Feed-forward of the mean rate, PI on the error at the sample's instant: the true delays are given."""

    propagator: Propagator
    command_s: float
    status_s: float
    gain: float
    integral_gain: float
    period_s: float = PERIOD_S
    _sent: int = 0
    _error: tuple[float, float] | None = None
    _sum: list[float] = field(default_factory=lambda: [0.0, 0.0])

    def status(self, data: bytes, arrival_utc_s: float) -> None:
        status = decode_status(data)
        target = self.propagator.at(Utc(arrival_utc_s - self.status_s))
        self._error = (
            wrap180(float(target.ra_deg) - status.ra_h * 15.0),
            float(target.dec_deg) - status.dec_deg,
        )

    def command(self, now_utc_s: float) -> bytes:
        self._sent += 1
        acts_s = now_utc_s + self.command_s + 0.5 * PERIOD_S
        begin, end = self.propagator.at(Utc(acts_s)), self.propagator.at(Utc(acts_s + PERIOD_S))
        rates = [
            wrap180(float(end.ra_deg) - float(begin.ra_deg)) / PERIOD_S,
            (float(end.dec_deg) - float(begin.dec_deg)) / PERIOD_S,
        ]
        for i, error in enumerate(self._error or (0.0, 0.0)):
            self._sum[i] += error * self.period_s
            rates[i] += self.gain * error + self.integral_gain * self._sum[i]
        return wire(PROFILE, self._sent, *rates)


class Oracle(Unshifted):
    """Knows every delay and turn of the mount's loop, the gain, the disturbance, and what the mount has read.

    It does not know which datagrams are still to be lost, doubled or held back; its encoders are as noisy as
    ours, and on a lossy link it sends copies as we do. An edge is renewed by our own handshake.
    """

    period_s = PERIOD_S

    def __init__(self, world: World) -> None:
        self._world = world
        self._turn = 0
        self._shift_s = self._shift_into_step()
        turns = len(world.ticks_s) + 100
        self._arrive_s = [self._sent_s(turn) + world.travels_s("command", turn) for turn in range(turns)]
        self._sent: dict[int, tuple[float, float]] = {-1: (0.0, 0.0)}
        self._filters: tuple[AxisFilter, AxisFilter] | None = None
        self._index = 0
        """Index of the loop instant of the last sample."""
        self._known = -1
        """Index of the last loop instant of which is known what the mount had read."""
        self._edges = EdgeMove() if world.scenario.move_axis == "edge" else None
        self._acts = (0.0, 0.0)
        self._last = b""

    def shift_s(self, now_utc_s: float) -> float:
        return self._shift_s if self._turn == 1 else 0.0

    def repeat(self) -> bytes | None:
        return self._last if self._world.scenario.link.loss else None

    def status(self, data: bytes, arrival_utc_s: float) -> None:
        status = decode_status(data)
        if self._edges is not None:
            self._edges.see(status)
        index = status.counter - 1
        ra_deg = status.ra_h * 15.0
        if self._filters is None:
            self._filters = (AxisFilter(ra_deg, GAIN_KNOWN), AxisFilter(status.dec_deg, GAIN_KNOWN))
        elif index <= self._index:
            return
        else:
            before, self._known = self._index, index
            moved = self._moved(before, index)
            seconds = self._world.ticks_s[index] - self._world.ticks_s[before]
            for one, distance, reported in zip(self._filters, moved, (ra_deg, status.dec_deg), strict=True):
                one.advance(seconds, distance)
                one.measure(reported, distance / seconds)
        self._index = index

    def command(self, now_utc_s: float) -> bytes:
        turn = self._turn
        self._turn += 1
        first = self._reads(turn)
        until = self._reads(turn + 1) if self._edges is None else self._next_edge(turn)
        rates = self._rates(now_utc_s, first, max(until, first + 1))
        if self._edges is None:
            self._sent[turn] = rates
            self._last = self._wire(turn, rates, first)
            return self._last
        sent = self._edges.compose(AxisRates(*rates))
        if sent.begins:
            self._acts = rates
        self._sent[turn] = self._acts
        up = sent.rates.ra is not None
        return self._wire(turn, self._acts, first) if up else encode_command(Command(turn + 1))

    def _wire(self, turn: int, rates: tuple[float, float], first: int) -> bytes:
        gain, extra = self._world.scenario.gain, self._world.disturbance_deg_s(self._world.ticks_s[first])
        return wire(PROFILE, turn + 1, (rates[0] + extra) / gain, rates[1] / gain)

    def _sent_s(self, turn: int) -> float:
        shift_s = self._shift_s if turn else 0.0
        return self._world.begin_s + self._world.phase_s + turn * PERIOD_S + shift_s

    def _shift_into_step(self) -> float:
        """Return how much later to send, for datagrams to arrive halfway between two turns in the mean."""
        world = self._world
        arrive_s = world.begin_s + world.phase_s + world.scenario.link.command_s
        angles = [2.0 * math.pi * (tick_s - arrive_s) / PERIOD_S for tick_s in world.ticks_s]
        mean = math.atan2(statistics.fmean(map(math.sin, angles)), statistics.fmean(map(math.cos, angles)))
        return (mean / (2.0 * math.pi) % 1.0 - 0.5) * PERIOD_S

    def _reads(self, turn: int) -> int:
        """Return the index of the loop instant that reads a datagram first, if it arrives."""
        return min(bisect_left(self._world.ticks_s, self._arrive_s[turn]), len(self._world.ticks_s) - 2)

    def _next_edge(self, turn: int) -> int:
        """Return the index of the loop instant that reads the edge after the one sent at a turn.

        The flag falls when its acknowledgement has come, and rises again when that has fallen.
        """
        for _ in ("up", "down"):
            index = self._reads(turn)
            told_s = self._world.ticks_s[index] + self._world.travels_s("status", index)
            turn += 1
            while self._sent_s(turn) < told_s:
                turn += 1
        return self._reads(turn)

    def _acting(self, index: int) -> int:
        """Return the datagram that acts from a loop instant on: as was read, or will be without losses."""
        if index <= self._known:
            return self._world.read[index]
        return min(bisect_right(self._arrive_s, self._world.ticks_s[index]) - 1, self._turn - 1)

    def _rates(self, now_utc_s: float, first: int, end: int) -> tuple[float, float]:
        world = self._world
        if self._filters is None:
            now = world.propagator.at(Utc(now_utc_s))
            return float(now.ra_rate_deg_s), float(now.dec_rate_deg_s)
        acts_s, until_s = world.ticks_s[first], world.ticks_s[min(end, len(world.ticks_s) - 1)]
        here, there = (world.propagator.at(Utc(t)) for t in (acts_s, until_s))
        moved = self._moved(self._index, first)
        rates = []
        spans = (wrap180(float(there.ra_deg - here.ra_deg)), float(there.dec_deg - here.dec_deg))
        goals = (float(here.ra_deg), float(here.dec_deg))
        ahead_s = acts_s - world.ticks_s[self._index]
        for i, one in enumerate(self._filters):
            reached = one.position_deg + moved[i] + one.disturbance_deg_s * ahead_s
            error = wrap180(reached - goals[i])
            limits = PROFILE.ra
            takes_s = settling_s(until_s - acts_s, 0.0, 0.0)
            back = correction_deg_s(error, limits.max_acceleration_deg_s2, limits.max_rate_deg_s, takes_s)
            rates.append(spans[i] / (until_s - acts_s) - one.disturbance_deg_s + back)
        return rates[0], rates[1]

    def _moved(self, first: int, last: int) -> tuple[float, float]:
        """Return how far the commands that are read move the axes between two loop instants."""
        ra = dec = 0.0
        for index in range(first, last):
            seconds = self._world.ticks_s[index + 1] - self._world.ticks_s[index]
            rates = self._sent[self._acting(index)]
            ra += rates[0] * seconds
            dec += rates[1] * seconds
        return ra, dec
