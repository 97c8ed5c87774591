"""When a datagram goes out a second time within its period, so that a loss does not leave old rates in force.

The mount keeps the latest datagram only and looks at it once a turn of its loop ("Xerxes Mount Control
Protocol", Theory of Operation), so a copy of the one that is there changes nothing. That holds for rates on a
*held* mount alone: with a one-shot flag up, or rates that are read on an edge, a copy that comes late is a
second rising edge.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sattrack.mount.model import MountProfile
    from sattrack.mount.xerxes.datagrams import Command

REPEAT_AFTER_PERIODS = 0.25
"""When the copy goes, in periods after the datagram, which itself comes half a period before the mount looks:
late enough to escape what took the first, and early enough to be there whatever the mount's timer does."""
STREAMING_TICKS = 5
"""Datagrams in a row that say nothing but rates, before one of them is repeated: what came before is over."""
MARK_EVERY_S = 1.0
MARKS = 30
"""Statuses missing within so many seconds tell that the link loses datagrams."""


@dataclass(slots=True)
class Repeats:
    """Keeps the last datagram, and tells whether it may and should be sent once more."""

    profile: MountProfile
    _datagram: bytes | None = None
    _streaming: int = 0
    _marks: deque[tuple[float, int]] = field(default_factory=lambda: deque(maxlen=MARKS))
    """Instants, and how many statuses had been lost by then."""

    def sent(self, command: Command, datagram: bytes) -> None:
        """Take a datagram that goes out, and what it says."""
        rates = command.move_ra or command.move_dec
        once = command.abort or command.slew or command.sync or command.park or command.find_home
        self._streaming = self._streaming + 1 if rates and not (once or command.pulse_guide) else 0
        self._datagram = datagram

    def see(self, arrival_utc_s: float, lost: int) -> None:
        """Take notice of a status, and of how many have been lost so far."""
        if not self._marks or arrival_utc_s - self._marks[-1][0] >= MARK_EVERY_S:
            self._marks.append((arrival_utc_s, lost))

    def copy(self, lost: int) -> bytes | None:
        """Return the last datagram where it is to be sent once more, else None."""
        policy = self.profile.repeat_rates
        if policy == "never" or self.profile.move_axis != "held" or self._streaming < STREAMING_TICKS:
            return None
        lossy = bool(self._marks) and lost > self._marks[0][1]
        return self._datagram if lossy or policy == "always" else None
