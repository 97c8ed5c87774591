"""Which rate acts when: commands sent, and the mount's own instants of reading its mailbox.

The mount reads its mailbox once a loop, at the instant of its status. A command therefore acts from the first
such instant after it arrived, until the first one after its successor arrived.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import msgspec

if TYPE_CHECKING:
    from sattrack.control.mount_loop import MountLoop

KEPT = 400


class SentRates(msgspec.Struct, frozen=True, gc=False):
    """Rates of the reported right ascension and declination, sent at an instant."""

    sent_utc_s: float
    ra_rate_deg_s: float
    dec_rate_deg_s: float


class Motion(msgspec.Struct, frozen=True, gc=False):
    """How far both axes were moved, degrees, and their rates at the end, degrees per second."""

    moved: tuple[float, float]
    rates_deg_s: tuple[float, float]


def _ramp(
    rate_deg_s: float | None, wanted_deg_s: float, seconds: float, acceleration_deg_s2: float
) -> tuple[float, float]:
    """Return how far an axis moves, and its rate then, that is asked for a rate; None: it has it already."""
    moved_deg = wanted_deg_s * seconds
    change = 0.0 if rate_deg_s is None else wanted_deg_s - rate_deg_s
    takes_s = abs(change) / acceleration_deg_s2
    if takes_s <= seconds:
        return moved_deg - 0.5 * change * takes_s, wanted_deg_s
    # It does not come to the rate in the time there is.
    short = change * (1.0 - seconds / takes_s)
    return moved_deg - 0.5 * (change + short) * seconds, wanted_deg_s - short


AT_REST = SentRates(float("-inf"), 0.0, 0.0)


@dataclass(slots=True)
class CommandHistory:
    """What was sent lately; `delay_s` is from sending to the mailbox, `loop` tells when it is read."""

    delay_s: float
    loop: MountLoop
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

    def is_one_turn(self, from_utc_s: float, to_utc_s: float) -> bool:
        """Tell whether two loop instants follow one another, so that one command acted between them."""
        return to_utc_s - from_utc_s < 1.5 * self.loop.mean_period_s

    def displacement_by(self, step: int, from_utc_s: float, to_utc_s: float) -> tuple[float, float] | None:
        """Return `displacement` over one turn if another command had acted, None where there is none.

        `step` counts from the one that is expected to have acted: -1 is the one sent before it.
        """
        expected = self.acting(from_utc_s)
        place = len(self._sent) - 1
        while place >= 0 and self._sent[place] is not expected:
            place -= 1
        if not 0 <= place + step < len(self._sent) or place < 0:
            return None
        other = self._sent[place + step]
        seconds = to_utc_s - from_utc_s
        return other.ra_rate_deg_s * seconds, other.dec_rate_deg_s * seconds

    def displacement(self, from_utc_s: float, to_utc_s: float) -> tuple[float, float]:
        """Return how far the commands move right ascension and declination between two instants, degrees.

        `from_utc_s` must be a loop instant of the mount; further ones are as the loop is foretold, so that
        a gap of lost statuses is predicted through. See `motion`.
        """
        return self.motion(from_utc_s, to_utc_s, None, (math.inf, math.inf)).moved

    def motion(
        self,
        from_utc_s: float,
        to_utc_s: float,
        rates_deg_s: tuple[float, float] | None,
        accelerations_deg_s2: tuple[float, float],
    ) -> Motion:
        """Return the same with axes that have rates at first, and take their time to change them."""
        ra_rate, dec_rate = rates_deg_s or (None, None)
        ra_most, dec_most = accelerations_deg_s2
        ra_moved = dec_moved = 0.0
        half_s = 0.5 * self.loop.mean_period_s
        at = from_utc_s
        while at < to_utc_s - 1e-6:
            until = min(self.loop.first_from(at + half_s), to_utc_s)
            # A rest shorter than half a period is the loop's jitter, not another turn of it.
            if to_utc_s - until < half_s:
                until = to_utc_s
            acting = self.acting(at)
            moved, ra_rate = _ramp(ra_rate, acting.ra_rate_deg_s, until - at, ra_most)
            ra_moved += moved
            moved, dec_rate = _ramp(dec_rate, acting.dec_rate_deg_s, until - at, dec_most)
            dec_moved += moved
            at = until
        return Motion((ra_moved, dec_moved), (ra_rate or 0.0, dec_rate or 0.0))
