"""Troubles for a schedule that is run in virtual time, drawn from a seed: the same seed, the same troubles.

Each draw has a name of its own, so that it does not depend on what was drawn before it: a run that was
interrupted meets the same troubles as one that was not.
"""

from __future__ import annotations

from dataclasses import dataclass
from random import Random
from typing import NamedTuple

FAULTS: tuple[tuple[float, str], ...] = (
    (0.66, ""),
    (0.06, "loss=15%"),
    (0.05, "cut@{at}s+4s"),
    (0.05, "cut@{at}s+90s"),
    (0.04, "crash@{at}s+5s"),
    (0.03, "drive@{at}s"),
    (0.03, "freeze@{at}s+2s"),
    (0.03, "silent@0s"),
)
"""What befalls the mount in a pass, by share, as `sattrack sim --faults` has it; else a session ends."""
FAULTS_WITHIN_S = 180.0
UNSAFE_NIGHTS = 0.3
UNSAFE_LEAST_S, UNSAFE_MOST_S = 600.0, 5400.0
OLD_ELEMENTS, ACTION_FAILS, ACTION_HANGS, PARK_FAILS, WAKE_FAILS = 0.03, 0.1, 0.1, 0.15, 0.02
JUMP_NIGHTS = 0.4
JUMPS: tuple[tuple[bool, float], ...] = ((False, -3600.0), (False, 900.0), (True, 1800.0))
"""Jumps of the clock: the computer slept, or not, and by how many seconds."""


class Jump(NamedTuple):
    """A jump of the machine's clock, at an instant of it."""

    utc_s: float
    seconds: float
    slept: bool


class Unsafe(NamedTuple):
    """Unsafe weather, from one instant to another."""

    begin_utc_s: float
    end_utc_s: float


@dataclass(frozen=True, slots=True)
class Troubles:
    """All that goes wrong in a run; with `seed` None, nothing does."""

    seed: int | None = None

    def _random(self, *name: object) -> Random:
        return Random(" ".join(str(part) for part in (self.seed, *name)))

    def faults(self, key: str, part: int) -> str | None:
        """Return what befalls the mount in a go at a pass; None where the session itself ends."""
        if self.seed is None:
            return ""
        random = self._random("fault", key, part)
        drawn, at = random.random(), round(random.uniform(5.0, FAULTS_WITHIN_S), 1)
        for share, faults in FAULTS:
            if drawn < share:
                return faults.format(at=at)
            drawn -= share
        return None

    def ends_after_s(self, key: str, part: int) -> float:
        """Return after how many seconds the session ends by itself."""
        return self._random("end", key, part).uniform(5.0, FAULTS_WITHIN_S)

    def unsafe(self, night: int, begin_utc_s: float, end_utc_s: float) -> Unsafe | None:
        """Return when the weather is unsafe in a night's hours; None where it is not."""
        if self.seed is None:
            return None
        random = self._random("weather", night)
        if random.random() >= UNSAFE_NIGHTS:
            return None
        begin = random.uniform(begin_utc_s - UNSAFE_LEAST_S, end_utc_s)
        return Unsafe(begin, begin + random.uniform(UNSAFE_LEAST_S, UNSAFE_MOST_S))

    def jumps(self, night: int, begin_utc_s: float, end_utc_s: float) -> Jump | None:
        """Return how the clock jumps in a night's hours; None where it does not."""
        if self.seed is None:
            return None
        random = self._random("clock", night)
        if random.random() >= JUMP_NIGHTS:
            return None
        slept, seconds = random.choice(JUMPS)
        return Jump(random.uniform(begin_utc_s, end_utc_s), seconds, slept)

    def happens(self, share: float, *name: object) -> bool:
        """Tell whether something with a share of so much happens."""
        return self.seed is not None and self._random(*name).random() < share
