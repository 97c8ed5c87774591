"""A one-shot command's flag and its acknowledgement, as a table.

"Xerxes Mount Control Protocol", Details: the flag rises once, is held until its acknowledgement is seen,
falls, and the mount takes the acknowledgement away. A flag may not rise again before that: the mount acts on
rising edges, and an acknowledgement that still stands, or is still to come, would be taken for the next.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

QUIET_STATUSES = 10
"""Statuses without an acknowledgement after which none is on its way any more: half a second."""


class Handshake(Enum):
    """Where a one-shot command stands."""

    IDLE = "idle"
    RAISED = "raised, not acknowledged"
    WITHDRAWN = "fallen before its acknowledgement was seen"
    RELEASING = "acknowledged and fallen"


TRANSITIONS = {
    (Handshake.IDLE, "request"): Handshake.RAISED,
    (Handshake.RAISED, "ack up"): Handshake.RELEASING,
    (Handshake.RAISED, "withdraw"): Handshake.WITHDRAWN,
    (Handshake.WITHDRAWN, "ack up"): Handshake.RELEASING,
    (Handshake.WITHDRAWN, "quiet"): Handshake.IDLE,
    (Handshake.RELEASING, "ack down"): Handshake.IDLE,
}


@dataclass(slots=True)
class OneShot:
    """One such flag. `acknowledged` turns true as its acknowledgement is seen while it is up."""

    state: Handshake = Handshake.IDLE
    statuses: int = 0
    """Statuses seen in this state."""

    @property
    def up(self) -> bool:
        """Whether the flag is to be up in the next datagram."""
        return self.state is Handshake.RAISED

    def happen(self, event: str) -> bool:
        """Make the transition that the table has for an event; tell whether there is one."""
        follows = TRANSITIONS.get((self.state, event))
        if follows is None:
            return False
        self.state, self.statuses = follows, 0
        return True

    def see(self, ack: bool) -> bool:
        """Take one status's acknowledgement; tell whether it is the one that the raised flag waits for."""
        self.statuses += 1
        if self.state is Handshake.IDLE:
            return False
        raised = self.up
        acknowledged = self.happen("ack up" if ack else "ack down") and raised
        if self.state is Handshake.WITHDRAWN and self.statuses >= QUIET_STATUSES:
            self.happen("quiet")
        return acknowledged
