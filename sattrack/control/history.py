"""Which rate acts when: commands sent, and the mount's own instants of reading its mailbox.

The mount reads its mailbox once a loop, at the instant of its status. A command therefore acts from the first
such instant after it arrived, until the first one after its successor arrived.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

KEPT = 400


@dataclass(frozen=True, slots=True)
class SentRates:
    """Rates of the reported right ascension and declination, sent at an instant."""

    sent_utc_s: float
    ra_rate_deg_s: float
    dec_rate_deg_s: float


AT_REST = SentRates(float("-inf"), 0.0, 0.0)


@dataclass(slots=True)
class CommandHistory:
    """What was sent lately; `delay_s` is from sending to the mailbox, `period_s` the mount's loop."""

    delay_s: float
    period_s: float
    _sent: deque[SentRates] = field(default_factory=lambda: deque(maxlen=KEPT))

    def add(self, sent: SentRates) -> None:
        """Note what was sent; instants rise."""
        self._sent.append(sent)

    def clear(self) -> None:
        """Forget everything: the mount is on its own again."""
        self._sent.clear()

    def acting(self, tick_utc_s: float) -> SentRates:
        """Return what acts from a loop instant of the mount until the next one."""
        newest_that_counts = tick_utc_s - self.delay_s
        for sent in reversed(self._sent):
            if sent.sent_utc_s <= newest_that_counts:
                return sent
        return AT_REST

    def displacement(self, from_utc_s: float, to_utc_s: float) -> tuple[float, float]:
        """Return how far the commands move right ascension and declination between two instants, degrees.

        `from_utc_s` must be a loop instant of the mount; further ones are taken a period apart, so that a
        gap of lost statuses is predicted through.
        """
        ra = dec = 0.0
        at = from_utc_s
        while at < to_utc_s - 1e-6:
            until = min(at + self.period_s, to_utc_s)
            # A rest shorter than half a period is the loop's jitter, not another turn of it.
            if to_utc_s - until < 0.5 * self.period_s:
                until = to_utc_s
            acting = self.acting(at)
            ra += acting.ra_rate_deg_s * (until - at)
            dec += acting.dec_rate_deg_s * (until - at)
            at = until
        return ra, dec
