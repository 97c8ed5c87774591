"""How a slew goes, as far as statuses tell: asked, launched, seen to move, seen to stand.

"Xerxes Mount Control Protocol", Details: a status that says "not slewing" may be older than the slew, so only
those count that came after its acknowledgement; and the mount has arrived when its positions rest. A mount
may acknowledge a slew some time before it begins: one that was not seen to move has arrived where it is near
the target, or when it has stood for LATEST_BEGIN_STATUSES.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sattrack.mount.model import SlewTo
    from sattrack.mount.xerxes.datagrams import Status
    from sattrack.mount.xerxes.handshake import OneShot

NEVER_SEEN_AFTER = 5
"""Statuses after a slew's acknowledgement without motion that mean it was too short to be seen."""
NEAR_DEG = 0.5
LATEST_BEGIN_STATUSES = 200
ACK_WITHIN_STATUSES = 20
"""Statuses after which a slew that is not acknowledged is asked for anew."""


class SlewState(Enum):
    """Where the slew last asked for stands."""

    NONE = "none"
    WAITING = "waiting for standstill"
    ASKED = "asked"
    UNDER_WAY = "under way"
    DONE = "done"


@dataclass(slots=True)
class Slewing:
    """One slew, from the wish to the mount seen standing at its end."""

    target: SlewTo
    state: SlewState = SlewState.WAITING
    _seen_moving: bool = False
    _statuses_since_ack: int = 0

    def ask(self, flag: OneShot) -> bool:
        """Raise the flag, where it may rise; tell whether it rose."""
        if self.state is not SlewState.WAITING or not flag.happen("request"):
            return False
        self.state = SlewState.ASKED
        return True

    def see(self, status: Status, flag: OneShot, launched: bool) -> None:
        """Take one status; `launched` tells whether it brought the acknowledgement."""
        if self.state is SlewState.ASKED:
            if launched:
                self.state = SlewState.UNDER_WAY
            elif flag.statuses > ACK_WITHIN_STATUSES:
                # The mount missed the edge, or was slewing when it came: fall, and rise again.
                flag.happen("withdraw")
                self.state = SlewState.WAITING
        if self.state is SlewState.UNDER_WAY:
            self._statuses_since_ack += 1
            self._seen_moving = self._seen_moving or status.slewing

    def rests(self, off_deg: float) -> None:
        """Take it that it rests so far from the target, by positions newer than the acknowledgement."""
        least = NEVER_SEEN_AFTER if off_deg < NEAR_DEG else LATEST_BEGIN_STATUSES
        seen_out = self._seen_moving or self._statuses_since_ack > least
        if self.state is SlewState.UNDER_WAY and seen_out:
            self.state = SlewState.DONE
