"""The health of the link, and its states as a table: silent, up, stale, lost."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from enum import StrEnum

from sattrack.mount.link_loss import STATUS_LOST_S

STALE_AFTER_S = 0.3
LOST_AFTER_S = STATUS_LOST_S
REMEMBERED_INTERVALS = 100


class LinkState(StrEnum):
    """What the age of the last accepted status says."""

    SILENT = "silent"
    UP = "up"
    STALE = "stale"
    LOST = "lost"


HEARD = "status accepted"
QUIET = f"none for {STALE_AFTER_S:g} s"
LONG_QUIET = f"none for {LOST_AFTER_S:g} s"
LINK_TRANSITIONS = {
    (LinkState.SILENT, HEARD): LinkState.UP,
    (LinkState.UP, QUIET): LinkState.STALE,
    (LinkState.STALE, HEARD): LinkState.UP,
    (LinkState.STALE, LONG_QUIET): LinkState.LOST,
    (LinkState.LOST, HEARD): LinkState.UP,
}


@dataclass(slots=True)
class LinkHealth:
    """Datagrams counted on our side, and how evenly the mount's come.

    `strangers` came from other hosts; `doubled_launches` are commands that the mount acknowledged a second
    time, as a late or duplicated datagram makes it; `foreign_acks` acknowledge what we never sent. `repeated`
    are copies sent beside those in `sent`; `frozen` statuses of a mount in motion said what the last one did.
    """

    sent: int = 0
    received: int = 0
    lost: int = 0
    late: int = 0
    duplicate: int = 0
    rejected: int = 0
    restarts: int = 0
    strangers: int = 0
    doubled_launches: int = 0
    foreign_acks: int = 0
    repeated: int = 0
    frozen: int = 0
    state: LinkState = LinkState.SILENT
    froze: bool = False
    """Whether frozen statuses are all that came since the last accepted one."""
    _last_arrival_s: float | None = None
    _intervals: deque[float] = field(default_factory=lambda: deque(maxlen=REMEMBERED_INTERVALS))

    def hear(self, arrival_utc_s: float, periods: int) -> None:
        """Note an accepted status that comes `periods` of the mount's loop after the one before."""
        last = self._last_arrival_s
        if last is not None and arrival_utc_s > last:
            self._intervals.append((arrival_utc_s - last) / max(1, periods))
        self._last_arrival_s = arrival_utc_s
        self.froze = False
        self.state = LINK_TRANSITIONS.get((self.state, HEARD), self.state)

    def freeze(self) -> None:
        """Note a status of a mount in motion that repeats the last one: it counts as not heard."""
        self.frozen += 1
        self.froze = True

    @property
    def did(self) -> str:
        """What a mount did whose link is lost, in words."""
        return "said the same again and again while it moved" if self.froze else "fell silent"

    def look(self, now_utc_s: float) -> LinkState:
        """Return the state of the link at an instant."""
        age_s = self.age_s(now_utc_s)
        for event, after_s in ((QUIET, STALE_AFTER_S), (LONG_QUIET, LOST_AFTER_S)):
            if age_s is not None and age_s > after_s:
                self.state = LINK_TRANSITIONS.get((self.state, event), self.state)
        return self.state

    def age_s(self, now_utc_s: float) -> float | None:
        """Return how long ago the last accepted status came; None before the first."""
        return None if self._last_arrival_s is None else now_utc_s - self._last_arrival_s

    @property
    def rate_hz(self) -> float | None:
        """Statuses a second that the mount sends, those lost on the way counted; None before the second."""
        total_s = sum(self._intervals)
        return len(self._intervals) / total_s if total_s > 0.0 else None

    @property
    def jitter_s(self) -> float | None:
        """Standard deviation of the intervals between arrivals, seconds; None before the third status."""
        count = len(self._intervals)
        if count < 2:
            return None
        mean_s = sum(self._intervals) / count
        return math.sqrt(sum((x - mean_s) ** 2 for x in self._intervals) / (count - 1))
