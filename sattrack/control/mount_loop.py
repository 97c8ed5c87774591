"""When the mount's loop runs: its instants foretold from those that its statuses told.

The mount reads its mailbox once a loop. Its timer is imprecise from one turn to the next and even over many,
so turns are foretold by the mean of the last ones, and not by the last alone.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field

REMEMBERED = 200
"""Turns, ten seconds, over which the mean is taken."""
ASTRAY_S = 0.2
"""A turn this far from where it was foretold is of a loop that stood still, or of a clock that was set."""
SHORTEST_BASE = 20
LARGEST_PERIOD_ERROR = 0.5


@dataclass(slots=True)
class MountLoop:
    """Foretells turns; `period_s` is the nominal period, which holds until enough turns were seen."""

    period_s: float
    _turns: deque[tuple[int, float]] = field(default_factory=lambda: deque(maxlen=REMEMBERED))
    _origin_s: float = 0.0
    _numbers: float = 0.0
    _instants_s: float = 0.0
    mean_period_s: float = field(init=False)
    """Mean period of the turns remembered."""
    _base_s: float = 0.0
    """When the turn of count 0 would have been."""

    def __post_init__(self) -> None:
        """Begin with the nominal period."""
        self.mean_period_s = self.period_s

    def note(self, counter: int, utc_s: float) -> None:
        """Take the instant of one turn, UTC as POSIX seconds; counters rise."""
        if self._turns:
            last_counter, _ = self._turns[-1]
            if counter <= last_counter or abs(utc_s - self.turn_utc_s(counter)) > ASTRAY_S:
                self._turns.clear()
        if not self._turns:
            self._origin_s, self._numbers, self._instants_s = utc_s, 0.0, 0.0
            self.mean_period_s = self.period_s
        elif len(self._turns) == REMEMBERED:
            gone_counter, gone_utc_s = self._turns[0]
            self._numbers -= gone_counter
            self._instants_s -= gone_utc_s - self._origin_s
        self._turns.append((counter, utc_s))
        self._numbers += counter
        self._instants_s += utc_s - self._origin_s
        first_counter, first_utc_s = self._turns[0]
        if counter - first_counter >= SHORTEST_BASE:
            mean_s = (utc_s - first_utc_s) / (counter - first_counter)
            if abs(mean_s / self.period_s - 1.0) < LARGEST_PERIOD_ERROR:
                self.mean_period_s = mean_s
        self._base_s = self.turn_utc_s(0)

    def turn_utc_s(self, counter: int) -> float:
        """Return when the turn of a count is expected. Needs one turn noted."""
        count = len(self._turns)
        mean_s = self._origin_s + self._instants_s / count
        return mean_s + (counter - self._numbers / count) * self.mean_period_s

    def shift_s(self, arrival_utc_s: float) -> float:
        """Return by how much later than at this instant datagrams had better arrive, seconds.

        Halfway between two turns, neither timer nor network make it uncertain which of them reads a datagram.
        """
        if not self._turns:
            return 0.0
        ahead_s = self.first_from(arrival_utc_s) - arrival_utc_s
        return ahead_s - 0.5 * self.mean_period_s

    def first_from(self, utc_s: float) -> float:
        """Return the first turn expected at or after an instant. Needs one turn noted."""
        turns = math.ceil((utc_s - self._base_s) / self.mean_period_s - 1e-9)
        return self._base_s + turns * self.mean_period_s
