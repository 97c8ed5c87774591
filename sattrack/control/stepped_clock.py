"""A mount's clock that goes in steps coarser than the instants that it is to date.

A loop that turns evenly shows it: the dates then scatter about a line through the turns, and the arrivals
follow the line and not the dates. Where the loop itself turns unevenly, as by a coarse timer, the arrivals
follow the dates, which are right.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

FORGETTING = 0.995
"""What a turn counts over the next one, in the line: some ten seconds matter."""
SHARE = 0.01
"""What a turn counts in the statistics."""
LEAST_TURNS = 120
BEGINS_ABOVE, ENDS_BELOW = 0.6, 0.3
"""How much of a date's distance from the line the arrivals must share, 0 to 1, to believe in the line."""
SURE_WITHIN = 0.15
"""How well that must be known, one sigma: delays that vary say nothing of steps that are finer."""
FINE_S = 0.00015
"""Scatter, one sigma, that no clock is to be called coarse for."""
LONGEST_DELAY_S = 0.02
"""Delays beyond the mean one that say nothing more."""
ASTRAY_S = 0.1


@dataclass(slots=True)
class TurnLine:
    """A line through the instants of the loop's turns, the last of them counting most."""

    period_s: float
    _counter: int = 0
    _origin_s: float = 0.0
    _counts: float = 0.0
    _turns: float = 0.0
    _squares: float = 0.0
    _late: float = 0.0
    _products: float = 0.0
    noted: int = 0

    def begin(self, counter: int, utc_s: float) -> None:
        """Begin anew with one turn."""
        self._counter, self._origin_s, self.noted = counter, utc_s, 1
        self._counts, self._turns, self._squares, self._late, self._products = 1.0, 0.0, 0.0, 0.0, 0.0

    def advance(self, counter: int) -> None:
        """Go on to a later turn."""
        turns = counter - self._counter
        self._counter = counter
        self._origin_s += turns * self.period_s
        self._squares += turns * (turns * self._counts - 2.0 * self._turns)
        self._turns -= turns * self._counts
        self._products -= turns * self._late

    def note(self, utc_s: float) -> None:
        """Take the instant of the turn that was gone on to."""
        late_s = utc_s - self._origin_s
        self._counts = FORGETTING * self._counts + 1.0
        self._turns *= FORGETTING
        self._squares *= FORGETTING
        self._late = FORGETTING * self._late + late_s
        self._products *= FORGETTING
        self.noted += 1

    @property
    def utc_s(self) -> float:
        """Instant of the turn that was gone on to, by the line."""
        spread = self._counts * self._squares - self._turns * self._turns
        if spread <= 0.0:
            return self._origin_s + self._late / self._counts
        return self._origin_s + (self._squares * self._late - self._turns * self._products) / spread


@dataclass(slots=True)
class SteppedClock:
    """Tells whether the mount's clock goes in coarse steps, and dates by its mean then."""

    period_s: float
    coarse: bool = False
    _line: TurnLine = field(init=False)
    _counter: int | None = None
    _off: float = 0.0
    _delay: float = 0.0
    _off_variance: float = 0.0
    _delay_variance: float = 0.0
    _shared: float = 0.0

    def __post_init__(self) -> None:
        """Begin without any turn."""
        self._line = TurnLine(self.period_s)

    @property
    def step_s(self) -> float:
        """The clock's step, seconds: its dates lie evenly within one."""
        return math.sqrt(12.0 * self._off_variance)

    def date(self, counter: int, dated_utc_s: float, arrival_utc_s: float) -> float:
        """Return the instant of a turn that the clock dates; what it dates where it is fine enough.

        Call once a status, in order.
        """
        line = self._line
        if self._counter is None or counter <= self._counter:
            self._begin(counter, dated_utc_s)
            return dated_utc_s
        self._counter = counter
        line.advance(counter)
        off_s = dated_utc_s - line.utc_s
        if abs(off_s) > ASTRAY_S:
            # The loop stood still, or one of the clocks was set.
            self._begin(counter, dated_utc_s)
            return dated_utc_s
        self._weigh(off_s, arrival_utc_s - dated_utc_s)
        line.note(dated_utc_s)
        if not self.coarse:
            return dated_utc_s
        # The clock shows the beginning of a step, and a turn comes half a step later in the mean.
        return line.utc_s + 0.5 * self.step_s

    def _begin(self, counter: int, dated_utc_s: float) -> None:
        self._line.begin(counter, dated_utc_s)
        self._counter, self.coarse = counter, False
        self._off = self._delay = self._off_variance = self._delay_variance = self._shared = 0.0

    def _weigh(self, off_s: float, delay_s: float) -> None:
        """Hold a date's distance from the line against how long its status seems to have taken."""
        share = max(SHARE, 1.0 / self._line.noted)
        off = off_s - self._off
        delay = delay_s - self._delay
        if self._line.noted > 1:
            delay = max(-LONGEST_DELAY_S, min(LONGEST_DELAY_S, delay))
        self._off += share * off
        self._delay += share * delay
        keep = 1.0 - share
        self._off_variance = keep * (self._off_variance + share * off * off)
        self._delay_variance = keep * (self._delay_variance + share * delay * delay)
        self._shared = keep * (self._shared - share * off * delay)
        sure = 0.5 * SHARE * self._delay_variance < SURE_WITHIN**2 * self._off_variance
        if self._line.noted < LEAST_TURNS or not sure:
            return
        bound = ENDS_BELOW if self.coarse else BEGINS_ABOVE
        self.coarse = self._off_variance > FINE_S**2 and self._shared > bound * self._off_variance
