"""When the mount's loop will turn next, from when it has turned lately.

A Windows timer of 50 ms fires at interrupts that come every 15.6 ms: its turns are uneven, but they come
again in the same rhythm. So turns are foretold from those a whole rhythm before, whatever its length is.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sattrack.calibration.statuses import Heard

LONGEST_RHYTHM = 8
FEWEST_PAIRS = 5
LEAST_TURN_S = 0.01
CLEARLY = 0.7
"""A longer rhythm is taken where it leaves so much less scatter."""


class TurnForecast:
    """Foretells turns, in seconds of the mount's clock, from two statuses or more in order."""

    def __init__(self, heard: Sequence[Heard]) -> None:
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
