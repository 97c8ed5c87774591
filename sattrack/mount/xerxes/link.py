"""The health of the link: which statuses are news, how evenly they come, what they acknowledge."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from enum import StrEnum
from operator import attrgetter
from typing import TYPE_CHECKING

from sattrack.mount.model import STATUS_LOST_S, LinkView
from sattrack.mount.xerxes.flags import follow

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sattrack.mount.model import Status
    from sattrack.mount.xerxes.datagrams import Command

STALE_AFTER_S, STALE_INTERVALS = 0.3, 2.0
"""A status is old after this, and after so many of the usual intervals of a telescope that answers slowly."""
REMEMBERED_INTERVALS = 100
USUAL_OF = 5
"""The middle one of so many intervals is the usual one."""
COUNTS = (
    "sent",
    "received",
    "lost",
    "late",
    "duplicate",
    "rejected",
    "restarts",
    "strangers",
    "doubled_launches",
    "foreign_acks",
)
"""What is counted and shown."""
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
NAMES = ("abort", "slew", "sync", "pulse_guide", "move_ra", "move_dec")
DOUBLED_WITHIN = 40
"""Datagrams after ours within which an acknowledgement that rises again is taken for a doubled launch."""
ESTABLISHED = 10
"""Datagrams with a flag up after which its acknowledgement should stand: no late one explains a fall then."""
INTRUDER_PROOF = 3
INTRUDER_WITHIN = 200
"""So many acknowledgements that are not ours within so many datagrams are another sender, not an accident."""
_flags = attrgetter(*NAMES)
_acks = attrgetter(*(f"ack_{name}" for name in NAMES))


class LinkState(StrEnum):
    """What the age of the last accepted status says."""

    SILENT = "silent"
    UP = "up"
    STALE = "stale"
    LOST = "lost"


HEARD = "status accepted"
QUIET = f"none for {STALE_AFTER_S:g} s"
LONG_QUIET = f"none for {STATUS_LOST_S:g} s"
LINK: Mapping[tuple[LinkState | None, str], LinkState] = {
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
    trouble: str | None = None
    """What a gateway says of its telescope, as far as somebody asked."""
    overtaken_s: float = 0.0
    """By how much a status has come later than one that the mount sent after it, at most."""
    state: LinkState = LinkState.SILENT
    froze: bool = False
    """Whether frozen statuses are all that came since the last accepted one."""
    stale_after_s: float = STALE_AFTER_S
    """Age of the last status from which on it is old."""
    _last_arrival_s: float | None = None
    _intervals: deque[float] = field(default_factory=lambda: deque(maxlen=REMEMBERED_INTERVALS))

    def hear(self, arrival_utc_s: float, periods: int) -> None:
        """Note an accepted status that comes `periods` of the mount's loop after the one before."""
        last = self._last_arrival_s
        if last is not None and arrival_utc_s > last:
            self._intervals.append((arrival_utc_s - last) / max(1, periods))
            if len(self._intervals) >= USUAL_OF:
                usual_s = sorted(self._intervals[-k] for k in range(1, USUAL_OF + 1))[USUAL_OF // 2]
                self.stale_after_s = min(STATUS_LOST_S, max(STALE_AFTER_S, STALE_INTERVALS * usual_s))
        self._last_arrival_s = arrival_utc_s
        self.froze = False
        self.state = follow(LINK, self.state, HEARD)

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
        for event, after_s in ((QUIET, self.stale_after_s), (LONG_QUIET, STATUS_LOST_S)):
            if age_s is not None and age_s > after_s:
                self.state = follow(LINK, self.state, event)
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

    def view(
        self,
        state: LinkState,
        age_s: float | None,
        delay_ms: float | None = None,
        clock_offset_s: float | None = None,
    ) -> LinkView:
        """Return what the link shows; `age_s` is that of the last status, None before one."""
        return LinkView(
            state=state.value,
            age_s=None if age_s is None else max(0.0, age_s),
            rate_hz=self.rate_hz,
            jitter_ms=None if self.jitter_s is None else self.jitter_s * 1000.0,
            delay_ms=delay_ms,
            clock_offset_s=clock_offset_s,
            **{name: getattr(self, name) for name in COUNTS},
        )


@dataclass(slots=True)
class StatusSequence:
    """Judges rolling counters against loss, duplication, reordering and restarts; counts what is not news."""

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
                self._count_refused(counter, ahead, arrival_utc_s)
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

    def _count_refused(self, counter: int, ahead: int, arrival_utc_s: float) -> None:
        if ahead == 0:
            self.health.duplicate += 1
        elif ahead > 0:
            self.health.rejected += 1
        else:
            self.health.late += 1
            missed_utc_s = self._missing.pop(counter, None)
            if missed_utc_s is not None:
                self.health.lost -= 1
                self.health.overtaken_s = max(self.health.overtaken_s, arrival_utc_s - missed_utc_s)

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


@dataclass(slots=True)
class _Watched:
    """One flag of ours, and its acknowledgement as last seen."""

    up: bool = False
    """Whether the flag was up in the last datagram."""
    rose: int = -(10**9)
    """Number of the datagram with which it last rose."""
    fell: int = -(10**9)
    """Number of the last datagram that had it up."""
    answered: bool = True
    """Whether its last rise has been acknowledged."""
    ack: bool = False


@dataclass(slots=True)
class AckWatch:
    """Counts in `health` the acknowledgements that answer to nothing of ours.

    The mount ignores the commands' counter, so a late or repeated datagram with a flag up makes a second
    rising edge, and a second sender makes flags toggle in the mailbox. Both show in acknowledgements only.
    """

    health: LinkHealth
    _watched: dict[str, _Watched] = field(default_factory=lambda: {name: _Watched() for name in NAMES})
    _number: int = 0
    _foreign: deque[int] = field(default_factory=lambda: deque(maxlen=INTRUDER_PROOF))
    _last_flags: tuple[bool, ...] = (False,) * len(NAMES)
    _last_acks: tuple[bool, ...] = (False,) * len(NAMES)

    def sent(self, command: Command) -> None:
        """Take what the next datagram says."""
        self._number += 1
        flags = _flags(command)
        if True not in flags and True not in self._last_flags:
            return
        self._last_flags = flags
        for flag, watched in zip(flags, self._watched.values(), strict=True):
            if flag and not watched.up:
                watched.rose = self._number
                watched.answered = False
            if flag:
                watched.fell = self._number
            watched.up = flag

    def see(self, status: Status) -> None:
        """Take what a status acknowledges."""
        acks = _acks(status)
        if acks == self._last_acks:
            return
        self._last_acks = acks
        for ack, watched in zip(acks, self._watched.values(), strict=True):
            if ack and not watched.ack:
                self._rises(watched)
            elif watched.ack and not ack and watched.up and self._number - watched.rose > ESTABLISHED:
                self._note_foreign()
            watched.ack = ack

    def forget(self) -> None:
        """Begin anew with a mount that has restarted."""
        for watched in self._watched.values():
            watched.ack = False
        self._last_acks = (False,) * len(NAMES)

    @property
    def intruder(self) -> str | None:
        """A warning of another sender; None while there is no sign of one."""
        if len(self._foreign) < INTRUDER_PROOF or self._number - self._foreign[0] > INTRUDER_WITHIN:
            return None
        return "another program is sending commands to this mount: end it, or motions will mix"

    def _rises(self, watched: _Watched) -> None:
        if not watched.answered or watched.up:
            watched.answered = True
        elif self._number - watched.fell <= DOUBLED_WITHIN:
            self.health.doubled_launches += 1
        else:
            self._note_foreign()

    def _note_foreign(self) -> None:
        self.health.foreign_acks += 1
        self._foreign.append(self._number)
