"""Which rate acts when: commands sent, and the mount's own instants of reading its mailbox.

The mount reads its mailbox once a loop, at the instant of its status. A command therefore acts from the first
such instant after it arrived, until the first one after its successor arrived.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import msgspec

from sattrack.control.response import Step

if TYPE_CHECKING:
    from sattrack.control.mount_loop import MountLoop

KEPT = 400
SOONER_S, SOONEST_S = 0.0005, 0.03
"""By how much a delay is taken to be less, with each sample that says so, and in all."""


class SentRates(msgspec.Struct, frozen=True, gc=False):
    """Rates of the reported right ascension and declination, sent at an instant."""

    sent_utc_s: float
    ra_rate_deg_s: float
    dec_rate_deg_s: float


AT_REST = SentRates(float("-inf"), 0.0, 0.0)


@dataclass(slots=True)
class CommandHistory:
    """What was sent lately; `delay_s` is from sending to the mailbox, `loop` tells when it is read."""

    delay_s: float
    loop: MountLoop
    _sent: deque[SentRates] = field(default_factory=lambda: deque(maxlen=KEPT))
    _told_s: float = field(init=False)

    def __post_init__(self) -> None:
        """Begin with what is told."""
        self._told_s = self.delay_s

    def add(self, sent: SentRates) -> None:
        """Note what was sent; instants rise."""
        self._sent.append(sent)

    def clear(self) -> None:
        """Forget everything: the mount is on its own again."""
        self._sent.clear()

    def arrives_early(self) -> None:
        """Take notice that commands are read earlier than expected: they take less time than told."""
        self.delay_s = max(0.0, self._told_s - SOONEST_S, self.delay_s - SOONER_S)

    def acting(self, tick_utc_s: float) -> SentRates:
        """Return what acts from a loop instant of the mount until the next one."""
        newest_that_counts = tick_utc_s - self.delay_s
        for sent in reversed(self._sent):
            if sent.sent_utc_s <= newest_that_counts:
                return sent
        return AT_REST

    def other(self, step: int, tick_utc_s: float) -> SentRates | None:
        """Return the command sent so many after the one that is expected to act from a loop instant.

        -1 is the one before it; None where there is none.
        """
        expected = self.acting(tick_utc_s)
        place = len(self._sent) - 1
        while place >= 0 and self._sent[place] is not expected:
            place -= 1
        if not 0 <= place + step < len(self._sent) or place < 0:
            return None
        return self._sent[place + step]

    def steps(self, from_utc_s: float, to_utc_s: float) -> list[Step]:
        """Return what acts between two instants, a step for each of the mount's turns.

        `from_utc_s` must be a loop instant of the mount; further ones are as the loop is foretold, so that
        a gap of lost statuses is predicted through.
        """
        found = []
        half_s = 0.5 * self.loop.mean_period_s
        at = from_utc_s
        while at < to_utc_s - 1e-6:
            acting = self.acting(at)
            found.append(Step(at, acting.ra_rate_deg_s, acting.dec_rate_deg_s))
            until = min(self.loop.first_from(at + half_s), to_utc_s)
            # A rest shorter than half a period is the loop's jitter, not another turn of it.
            at = to_utc_s if to_utc_s - until < half_s else until
        return found
