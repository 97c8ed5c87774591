"""Which requests took so much longer than others that their middle says little of when they were answered.

What held one up was on the way there or on the way back alone, so that the middle is off by half of it.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

REMEMBERED = 100
FEWEST = 10
LEAST_EXCESS_S = 0.003
EXCESSES = 2.0
MOST_IN_A_ROW = 3
"""A way that has become longer for good is believed after so many."""


@dataclass(slots=True)
class Lateness:
    """Follows how long requests take, seconds."""

    _took: deque[float] = field(default_factory=lambda: deque(maxlen=REMEMBERED))
    _in_a_row: int = 0

    def is_late(self, took_s: float) -> bool:
        """Take one; tell whether it took longer than the median by more than its lead over the fastest."""
        late = len(self._took) >= FEWEST and took_s > self._limit_s()
        self._took.append(took_s)
        self._in_a_row = self._in_a_row + 1 if late else 0
        return 0 < self._in_a_row <= MOST_IN_A_ROW

    def _limit_s(self) -> float:
        ordered = sorted(self._took)
        median = ordered[len(ordered) // 2]
        return median + max(LEAST_EXCESS_S, EXCESSES * (median - ordered[0]))
