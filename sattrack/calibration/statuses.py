"""Statuses in the order in which the mount sent them, dated by the mount's own clock.

When the mount's loop will turn next, from when it has turned lately.

A Windows timer of 50 ms fires at interrupts that come every 15.6 ms: its turns are uneven, but they come
again in the same rhythm. So turns are predicted from those a whole rhythm before, of any length.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from sattrack.control.latency import SIDEREAL_SECONDS_PER_SECOND
from sattrack.mount.model import SIDEREAL_RATE_DEG_S, Readings, Status
from sattrack.mount.xerxes.datagrams import DOUBTFUL, DatagramError, decode_status, status_readings
from sattrack.mount.xerxes.link import RESTART_PROOF
from sattrack.mount.xerxes.standstill import Positions

if TYPE_CHECKING:
    from collections.abc import Sequence

LONGEST_RHYTHM = 8
FEWEST_PAIRS = 5
LEAST_TURN_S = 0.01
CLEARLY = 0.7
"""A longer rhythm is taken where it leaves so much less scatter."""


class TurnForecast:
    """Foretells turns, in seconds of the mount's clock, from two statuses or more in order."""

    def __init__(self, heard: Sequence[HeardStatus]) -> None:
        self._at = {h.counter: h.mount_s for h in heard}
        self._last = heard[-1].counter
        turns = self._last - heard[0].counter
        self._rhythm, self.scatter_s = 1, float("inf")
        self.mean_s = (heard[-1].mount_s - heard[0].mount_s) / turns
        for rhythm in range(1, LONGEST_RHYTHM + 1):
            steps = [self._at[c] - self._at[c - rhythm] for c in self._at if c - rhythm in self._at]
            if len(steps) >= FEWEST_PAIRS and np.std(steps) < CLEARLY * self.scatter_s:
                self._rhythm, self.scatter_s = rhythm, float(np.std(steps))
                self.mean_s = float(np.mean(steps)) / rhythm
        self.mean_s = max(LEAST_TURN_S, self.mean_s)

    def next_after(self, mount_s: float) -> float:
        """Return the first turn foretold at or after a second of the mount's clock."""
        counter = self._last
        while True:
            counter += 1
            at = self._foretold(counter)
            if at >= mount_s:
                return at

    def _foretold(self, counter: int) -> float:
        before = counter - self._rhythm * -(-(counter - self._last) // self._rhythm)
        while before not in self._at and before > self._last - 4 * LONGEST_RHYTHM:
            before -= self._rhythm
        if before not in self._at:
            before = self._last
        return self._at[before] + (counter - before) * self.mean_s


RESTART_COUNTS = 50
"""A counter that falls by less than this is a late datagram's."""
STILL_WITHIN_DEG_S = 5e-4
STILL_STATUSES = 6
STILL_SPAN_S = 0.25


@dataclass(frozen=True, slots=True)
class HeardStatus:
    """One status as it was heard.

    `arrival_utc_s` is ours; `mount_s` are seconds of the mount's clock since the first status. The hour angle
    is the mount's sidereal time less its right ascension, degrees, counted on through whole turns.
    """

    counter: int
    arrival_utc_s: float
    mount_s: float
    hour_angle_deg: float
    dec_deg: float
    status: Status


@dataclass(slots=True)
class StatusLog:
    """Takes datagrams; keeps what is new and in order."""

    heard: list[HeardStatus] = field(default_factory=list)
    rejected: int = 0
    late: int = 0
    restarted: bool = False
    """Whether the counter began anew: the mount's program was started again."""
    readings: dict[str, str] = field(default_factory=dict)
    """Types seen of the doubtful fields; a field that held zeros only is not in it."""
    contradictory: set[str] = field(default_factory=set)
    """Doubtful fields that were seen with both types."""

    positions: Positions = field(default_factory=Positions)
    """What tells whether a stop has come to rest."""
    _anew: list[int] = field(default_factory=list)

    @property
    def last(self) -> HeardStatus | None:
        """The newest status."""
        return self.heard[-1] if self.heard else None

    def take(self, data: bytes, arrival_utc_s: float) -> HeardStatus | None:
        """Keep a status and return it; None for what is no status, or comes late, or twice."""
        try:
            status = decode_status(data)
            readings = status_readings(data)
        except DatagramError:
            self.rejected += 1
            return None
        before = self.last
        if before is not None and status.counter <= before.counter and not self._began_anew(status, before):
            self.late += 1
            return None
        self._note_readings(readings)
        hour_angle = (status.sidereal_h - status.ra_h) * 15.0
        reference = 0.0 if before is None else before.hour_angle_deg
        heard = HeardStatus(
            status.counter,
            arrival_utc_s,
            self._mount_seconds(status.sidereal_h, before),
            reference + (hour_angle - reference + 180.0) % 360.0 - 180.0,
            status.dec_deg,
            status,
        )
        self.heard.append(heard)
        self.positions.take(
            arrival_utc_s, status.sidereal_h, status.ra_h * 15.0, status.dec_deg, status.side_of_pier
        )
        return heard

    def still(self) -> bool:
        """Tell whether both axes stand, or follow the sky, by the newest statuses."""
        newest = self.heard[-STILL_STATUSES:]
        if len(newest) < STILL_STATUSES:
            return False
        first, last = newest[0], newest[-1]
        span_s = last.mount_s - first.mount_s
        if span_s < STILL_SPAN_S * 0.8:
            return False
        turned = last.hour_angle_deg - first.hour_angle_deg
        off_deg = min(abs(turned), abs(turned - SIDEREAL_RATE_DEG_S * span_s))
        return max(off_deg, abs(last.dec_deg - first.dec_deg)) < STILL_WITHIN_DEG_S * span_s

    def _began_anew(self, status: Status, before: HeardStatus) -> bool:
        """Tell whether low counters that rise again and again are those of a program started anew."""
        if before.counter - status.counter <= RESTART_COUNTS:
            return False
        rising = bool(self._anew) and status.counter > self._anew[-1]
        self._anew = [*self._anew, status.counter] if rising else [status.counter]
        self.restarted = self.restarted or len(self._anew) >= RESTART_PROOF
        return len(self._anew) >= RESTART_PROOF

    @staticmethod
    def _mount_seconds(sidereal_h: float, before: HeardStatus | None) -> float:
        if before is None:
            return 0.0
        hours = (sidereal_h - before.status.sidereal_h + 12.0) % 24.0 - 12.0
        return before.mount_s + hours * 3600.0 / SIDEREAL_SECONDS_PER_SECOND

    def _note_readings(self, readings: Readings) -> None:
        for name in DOUBTFUL:
            seen = getattr(readings, name)
            if seen is None:
                continue
            if self.readings.setdefault(name, seen) != seen:
                self.contradictory.add(name)
