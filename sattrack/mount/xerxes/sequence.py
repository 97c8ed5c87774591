"""Which statuses are news: the rolling counter judged against loss, duplication, reordering and restarts."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sattrack.mount.xerxes.link import LinkHealth

RESTART_PROOF = 3
"""Datagrams in a row of another, rising count that prove a restart of the mount."""
RESTART_STEP = 4
"""How far apart those may be: losses go on while a mount starts."""
TRUSTED_JUMP = 400
TRUSTED_JUMP_PER_S = 40.0
"""How far a counter may run ahead: 20 s of statuses, and twice the nominal rate for the time of silence."""
REMEMBERED = 400
LATE_WITHIN_S = 0.5
"""How late a missed status may still come; one that comes later belongs to a mount that counts anew."""


@dataclass(slots=True)
class StatusSequence:
    """Judges counters as they come, and counts in `health` what is not news."""

    health: LinkHealth
    _last: int | None = None
    _last_arrival_s: float = 0.0
    _missing: dict[int, float] = field(default_factory=dict)
    """Counts that were missed, and when that was noticed."""
    _candidate: int | None = None
    _run: int = 0

    def is_news(self, counter: int, arrival_utc_s: float) -> bool:
        """Tell whether a status of this count is newer than all before; afterwards it is the newest."""
        last = self._last
        if last is not None:
            ahead = counter - last
            silence_s = max(0.0, arrival_utc_s - self._last_arrival_s)
            if 0 < ahead <= TRUSTED_JUMP + TRUSTED_JUMP_PER_S * silence_s:
                self._note_missing(last + 1, counter, arrival_utc_s)
            elif not self._is_restart(counter, last, arrival_utc_s):
                self._count_refused(counter, ahead)
                return False
        self.health.hear(arrival_utc_s, 1 if last is None else counter - last)
        self._last, self._last_arrival_s = counter, arrival_utc_s
        self._candidate, self._run = None, 0
        return True

    def _note_missing(self, first: int, end: int, noticed_utc_s: float) -> None:
        if first == end:
            return
        self.health.lost += end - first
        self._missing.update(dict.fromkeys(range(max(first, end - REMEMBERED), end), noticed_utc_s))
        if len(self._missing) > 2 * REMEMBERED:
            self._missing = {number: at for number, at in self._missing.items() if number > end - REMEMBERED}

    def _count_refused(self, counter: int, ahead: int) -> None:
        if ahead == 0:
            self.health.duplicate += 1
        elif ahead > 0:
            self.health.rejected += 1
        else:
            self.health.late += 1
            if counter in self._missing:
                del self._missing[counter]
                self.health.lost -= 1

    def _is_restart(self, counter: int, last: int, arrival_utc_s: float) -> bool:
        latecomer = arrival_utc_s - self._missing.get(counter, -math.inf) < LATE_WITHIN_S
        if counter == last or latecomer:
            self._candidate, self._run = None, 0
            return False
        follows = self._candidate is not None and 0 < counter - self._candidate <= RESTART_STEP
        self._candidate, self._run = counter, self._run + 1 if follows else 1
        if self._run < RESTART_PROOF:
            return False
        self.health.restarts += 1
        self._missing.clear()
        return True
