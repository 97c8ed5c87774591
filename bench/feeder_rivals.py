"""Other ways to steer, written for the comparison: three controllers as they are in use, and an oracle."""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from feeder_harness import PERIOD_S, World, wire

from sattrack.control.kalman import AxisFilter, wrap180
from sattrack.mount import SIDEREAL_RATE_DEG_S, MountProfile
from sattrack.xerxes.datagrams import decode_status
from tle.instants import Utc

if TYPE_CHECKING:
    from tle.propagator import Propagator

PROFILE = MountProfile()


class Unshifted:
    """Sends at its own phase."""

    def shift_s(self, now_utc_s: float) -> float:  # noqa: ARG002
        return 0.0


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

    def status(self, data: bytes, arrival_utc_s: float) -> None:  # noqa: ARG002
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
    """Feed-forward of the mean rate, PI on the error at the sample's own instant: the true delays are given."""

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
    """Knows every delay, every loop instant, the gain and the disturbance; its encoders are as noisy as ours."""

    period_s = PERIOD_S
    SETTLING_S = 0.2

    def __init__(self, world: World) -> None:
        self._world = world
        self._turn = 0
        self._acting: list[tuple[float, float, float]] = []
        """Loop instants, and the rates that act from each on."""
        self._filters: tuple[AxisFilter, AxisFilter] | None = None
        self._at_s = 0.0
        self._statuses = 0

    def status(self, data: bytes, arrival_utc_s: float) -> None:  # noqa: ARG002
        status = decode_status(data)
        sample_s = self._world.ticks_s[status.counter - 1]
        if sample_s <= self._at_s:
            return
        ra_deg = status.ra_h * 15.0
        if self._filters is None:
            self._filters = (AxisFilter(ra_deg), AxisFilter(status.dec_deg))
        else:
            moved = self._moved(self._at_s, sample_s)
            seconds = sample_s - self._at_s
            for one, distance, reported in zip(self._filters, moved, (ra_deg, status.dec_deg), strict=True):
                one.advance(seconds, distance)
                one.measure(reported, distance / seconds)
        self._at_s = sample_s

    def command(self, now_utc_s: float) -> bytes:
        world, turn = self._world, self._turn
        self._turn += 1
        acts_s = self._acts(now_utc_s, turn)
        if self._filters is None or acts_s is None:
            return wire(PROFILE, turn + 1, 0.0, 0.0)
        until_s = acts_s
        follower = turn
        while until_s <= acts_s and follower < turn + 40:
            follower += 1
            later = self._acts(now_utc_s + (follower - turn) * PERIOD_S, follower)
            until_s = acts_s if later is None else later
        until_s = until_s if until_s > acts_s else acts_s + PERIOD_S
        begin, end = (world.propagator.at(Utc(t)) for t in (acts_s, until_s))
        moved = self._moved(self._at_s, acts_s)
        rates = []
        spans = (wrap180(float(end.ra_deg - begin.ra_deg)), float(end.dec_deg - begin.dec_deg))
        goals = (float(begin.ra_deg), float(begin.dec_deg))
        for i, one in enumerate(self._filters):
            there = one.position_deg + moved[i] + one.disturbance_deg_s * (acts_s - self._at_s)
            error = wrap180(there - goals[i])
            rates.append(spans[i] / (until_s - acts_s) - one.disturbance_deg_s - error / self.SETTLING_S)
        gain = world.scenario.gain
        ra = SIDEREAL_RATE_DEG_S - (SIDEREAL_RATE_DEG_S - rates[0])
        ra = ra / gain + world.disturbance_deg_s(now_utc_s)
        dec = rates[1] / gain
        self._acting = [entry for entry in self._acting if entry[0] < acts_s or entry[0] > acts_s]
        self._acting.append((acts_s, rates[0], rates[1]))
        self._acting.sort()
        del self._acting[:-80]
        return wire(PROFILE, turn + 1, ra, dec)

    def _acts(self, sent_s: float, turn: int) -> float | None:
        """Return the loop instant at which the mount reads a datagram, None where it is lost or overtaken."""
        arrivals = self._world.delays("command", turn)
        if not arrivals:
            return None
        ticks = self._world.ticks_s
        index = bisect_left(ticks, sent_s + arrivals[0])
        return ticks[index] if index < len(ticks) else None

    def _moved(self, from_s: float, to_s: float) -> tuple[float, float]:
        ra = dec = 0.0
        for i, (begin, ra_rate, dec_rate) in enumerate(self._acting):
            end = self._acting[i + 1][0] if i + 1 < len(self._acting) else to_s
            seconds = min(end, to_s) - max(begin, from_s)
            if seconds > 0.0:
                ra += ra_rate * seconds
                dec += dec_rate * seconds
        return ra, dec
