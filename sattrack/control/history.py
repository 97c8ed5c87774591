"""Which rate acts when: commands sent, and the mount's own instants of reading its mailbox.

The mount reads its mailbox once a loop, at the instant of its status. A command therefore acts from the first
such instant after it arrived, until the first one after its successor arrived.

When the mount's loop runs: its coming turns predicted from those that its statuses show.

The mount reads its mailbox once a loop. Its timer is imprecise from one turn to the next and even over many,
so turns are predicted by the mean of the last ones, and not by the last alone.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field

import msgspec

from sattrack.control.response import Step

REMEMBERED = 200
"""Turns, ten seconds, over which the mean is taken."""
ASTRAY_S = 0.2
"""A turn this far from where it was foretold is of a loop that stood still, or of a clock that was set."""
SHORTEST_BASE = 20
LARGEST_PERIOD_ERROR = 0.5
MOST_SHIFT_S, SHIFT_SHARE = 0.0002, 0.02
"""How fast the sending falls into step with the mount's loop: too slow for the period to show it."""
EDGE_PERIODS = 2.0
"""How many periods the rates of one edge act, until it is learnt."""


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
        """Return the delay at which datagrams should arrive, after this instant, seconds.

        Halfway between two turns, neither timer nor network make it uncertain which of them reads a datagram.
        """
        if not self._turns:
            return 0.0
        ahead_s = self.first_from(arrival_utc_s) - arrival_utc_s
        return ahead_s - 0.5 * self.mean_period_s

    def send_shift_s(
        self, arrival_utc_s: float, most_s: float = MOST_SHIFT_S, share: float = SHIFT_SHARE
    ) -> float:
        """Return the delay of the next datagram beyond one period, seconds: a bounded share of the shift."""
        return max(-most_s, min(most_s, share * self.shift_s(arrival_utc_s)))

    def first_from(self, utc_s: float) -> float:
        """Return the first turn expected at or after an instant. Needs one turn noted."""
        turns = math.ceil((utc_s - self._base_s) / self.mean_period_s - 1e-9)
        return self._base_s + turns * self.mean_period_s


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
        """Begin with the profile's values."""
        self._told_s = self.delay_s

    def add(self, sent: SentRates) -> None:
        """Note what was sent; instants rise."""
        self._sent.append(sent)

    def clear(self) -> None:
        """Forget everything: the mount is on its own again."""
        self._sent.clear()

    def arrives_early(self) -> None:
        """Note that commands are read earlier than expected: they take less time than the profile says."""
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
