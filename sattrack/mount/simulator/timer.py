"""When the mount's loop runs: a timer of 50 ms by one of three laws, as a pure object.

"Xerxes Mount Control Protocol", Theory of Operation: the loop is "approximately" 50 ms, "as the Windows forms
timer is imprecise". Such a timer fires at the first of the system's clock interrupts, 64 a second, at or
after it is due, and a little later where its thread is busy. Where the paper is silent:

* `exact`: due and firing at whole multiples of the period.
* `windows`: due at whole multiples of the period, firing at the next interrupt: 46.9 or 62.5 ms, mean 50 ms.
* `windows_rearmed`: due a period after it fired, firing at the next interrupt: 62.5 ms each time.

Firings that were missed, because the loop was held up, are dropped: the messages of such a timer are merged.
"""

from __future__ import annotations

import math
import random
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sattrack.mount.simulator.settings import TimerLaw

GRAIN_S = 1.0 / 64.0
LATE_S = 0.001
"""The most that a Windows timer is late beyond the interrupt."""
LEAST_GAP_S = 0.001


@dataclass(slots=True)
class Timer:
    """Instants at which the loop runs; the first call of `next` begins it and gives the first of them.

    `drift_ppm` is how much longer the computer's seconds last than true ones, in millionths.
    """

    law: TimerLaw = "exact"
    period_s: float = 0.05
    drift_ppm: float = 0.0
    seed: int = 0
    _random: random.Random = field(init=False)
    _begin_s: float | None = None
    _turn: int = 0
    _phase_s: float = field(init=False)
    _fired_s: float = -math.inf

    def __post_init__(self) -> None:
        """Draw the phase of the interrupts."""
        self._random = random.Random(f"timer {self.seed}")
        self._phase_s = self._random.uniform(0.0, GRAIN_S)

    def next(self, now_s: float) -> float:
        """Return the first instant after `now_s` at which the loop runs, in the scale of `now_s`, seconds."""
        if self._begin_s is None:
            self._begin_s = now_s
            return self._fire(0.0) if self.law != "exact" else now_s
        fired_s = self._following()
        while fired_s <= now_s:
            fired_s = self._following()
        return fired_s

    def _following(self) -> float:
        assert self._begin_s is not None
        self._turn += 1
        if self.law == "exact":
            # A multiple from the beginning, not a sum: a sum of roundings would drift.
            return self._begin_s + self._turn * self.period_s * (1.0 + self.drift_ppm * 1e-6)
        if self.law == "windows":
            return self._fire(self._turn * self.period_s)
        return self._fire(self._fired_s + self.period_s)

    def _fire(self, due_s: float) -> float:
        """Return when a firing due so many of the computer's own seconds after the beginning happens."""
        assert self._begin_s is not None
        grains = math.ceil((due_s - self._phase_s) / GRAIN_S - 1e-9)
        interrupt_s = self._phase_s + grains * GRAIN_S
        fired_s = interrupt_s + self._random.uniform(0.0, LATE_S)
        # A rearmed timer counts from the interrupt at which it fired.
        self._fired_s = interrupt_s
        return self._begin_s + fired_s * (1.0 + self.drift_ppm * 1e-6)
