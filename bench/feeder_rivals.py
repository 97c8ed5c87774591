"""Other ways to steer, written for the comparison: three controllers as they are in use, and an oracle."""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from feeder_harness import PERIOD_S, World, wire

from sattrack.control.feeder import correction_deg_s
from sattrack.control.kalman import AxisFilter, Noise, wrap180
from sattrack.mount import MountProfile
from sattrack.xerxes.datagrams import decode_status
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
    """Knows every delay and loop instant, the gain and the disturbance; its encoders are as noisy as ours."""

    period_s = PERIOD_S

    def __init__(self, world: World) -> None:
        self._world = world
        self._turn = 0
        self._read = self._readings()
        self._sent: dict[int, tuple[float, float]] = {}
        self._filters: tuple[AxisFilter, AxisFilter] | None = None
        self._index = 0
        """Index of the loop instant of the last sample."""

    def _readings(self) -> list[int]:
        """Return which datagram the mount reads at each of its loop instants; -1 before the first."""
        world = self._world
        arrivals = []
        for turn in range(len(world.ticks_s) + 100):
            sent_s = world.begin_s + world.phase_s + turn * PERIOD_S
            arrivals += [(sent_s + delay_s, turn) for delay_s in world.delays("command", turn)]
        arrivals.sort()
        read, latest, place = [], -1, 0
        for tick_s in world.ticks_s:
            while place < len(arrivals) and arrivals[place][0] <= tick_s:
                latest = arrivals[place][1]
                place += 1
            read.append(latest)
        return read

    def status(self, data: bytes, arrival_utc_s: float) -> None:
        status = decode_status(data)
        index = status.counter - 1
        ra_deg = status.ra_h * 15.0
        if self._filters is None:
            self._filters = (AxisFilter(ra_deg, GAIN_KNOWN), AxisFilter(status.dec_deg, GAIN_KNOWN))
        elif index <= self._index:
            return
        else:
            moved = self._moved(self._index, index)
            seconds = self._world.ticks_s[index] - self._world.ticks_s[self._index]
            for one, distance, reported in zip(self._filters, moved, (ra_deg, status.dec_deg), strict=True):
                one.advance(seconds, distance)
                one.measure(reported, distance / seconds)
        self._index = index

    def command(self, now_utc_s: float) -> bytes:
        world, turn = self._world, self._turn
        self._turn += 1
        if self._filters is None or turn not in self._read:
            # Never read, as far as rounding lets one say so: the target's own rate does no harm.
            now = world.propagator.at(Utc(now_utc_s))
            self._sent[turn] = (float(now.ra_rate_deg_s), float(now.dec_rate_deg_s))
            return wire(PROFILE, turn + 1, *self._sent[turn])
        first = self._read.index(turn, bisect_left(world.ticks_s, now_utc_s))
        end = first
        while end < len(self._read) - 1 and self._read[end] == turn:
            end += 1
        acts_s, until_s = world.ticks_s[first], max(world.ticks_s[end], world.ticks_s[first] + 0.01)
        here, there = (world.propagator.at(Utc(t)) for t in (acts_s, until_s))
        moved = self._moved(self._index, first)
        rates = []
        spans = (wrap180(float(there.ra_deg - here.ra_deg)), float(there.dec_deg - here.dec_deg))
        goals = (float(here.ra_deg), float(here.dec_deg))
        ahead_s = acts_s - world.ticks_s[self._index]
        for i, one in enumerate(self._filters):
            reached = one.position_deg + moved[i] + one.disturbance_deg_s * ahead_s
            error = wrap180(reached - goals[i])
            back = correction_deg_s(error, PROFILE.ra.max_acceleration_deg_s2, PROFILE.ra.max_rate_deg_s)
            rates.append(spans[i] / (until_s - acts_s) - one.disturbance_deg_s + back)
        self._sent[turn] = (rates[0], rates[1])
        self._sent.pop(turn - 100, None)
        gain = world.scenario.gain
        return wire(PROFILE, turn + 1, (rates[0] + world.disturbance_deg_s(acts_s)) / gain, rates[1] / gain)

    def _moved(self, first: int, last: int) -> tuple[float, float]:
        """Return how far the commands that are read move the axes between two loop instants."""
        ra = dec = 0.0
        for index in range(first, last):
            begin_s, end_s = self._world.ticks_s[index], self._world.ticks_s[index + 1]
            turn = self._read[index]
            if turn >= self._turn:
                # Overtaken by one that is still to be sent, and that will be right.
                here, there = (self._world.propagator.at(Utc(t)) for t in (begin_s, end_s))
                ra += wrap180(float(there.ra_deg - here.ra_deg))
                dec += float(there.dec_deg - here.dec_deg)
                continue
            rates = self._sent.get(turn, (0.0, 0.0))
            ra += rates[0] * (end_s - begin_s)
            dec += rates[1] * (end_s - begin_s)
        return ra, dec
