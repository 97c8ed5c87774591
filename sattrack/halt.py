"""Bring a mount to rest and see it there, without I/O: for whoever takes over from a session that is gone.

Nothing is known of what went before but the number of the last datagram: a fresh session says abort, with no
other flag up, until the mount acknowledges it and both drives rest.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from sattrack.mount import Stop
from sattrack.safety import Safety, SafetyLimits
from sattrack.xerxes.link import LinkState
from sattrack.xerxes.session import Session

if TYPE_CHECKING:
    from sattrack.mount import MountProfile

UNHEARD_S = 12.0
"""How long stops are sent to a mount that is not heard: longer than a switch takes to come up again."""
UNCONFIRMED_S = 60.0
"""How long stops are sent to a mount that answers but does not come to rest."""
LINGER_S = 0.25
"""Flag-free datagrams after the rest was seen, so that no late one is the last that the mount gets."""


class Halt:
    """One stop, from the first datagram on; call `tick` once a period until `finished`.

    `counter` is the number of the last datagram that the mount was sent. After `finished`, more ticks keep
    the mount at rest: should it move again, it is stopped again.
    """

    def __init__(self, profile: MountProfile, begun_utc_s: float, counter: int = 0) -> None:
        self.session = Session(profile)
        self.session.health.sent = counter
        self.finished = False
        self.at_rest: bool | None = None
        """Whether the mount was seen at rest; None where it was never heard."""
        self.rest_utc_s: float | None = None
        """Since when it has been seen at rest."""
        self._begun_utc_s = begun_utc_s
        self.session.apply(Safety(profile, SafetyLimits(), 0.0).clear(Stop(), 0.0, 0.0, 0.0))

    def receive(self, data: bytes, arrival_utc_s: float) -> None:
        """Take one datagram from the mount."""
        self.session.receive(data, arrival_utc_s)

    def tick(self, now_utc_s: float) -> bytes:
        """Return the datagram to send now."""
        if not self.session.stopped:
            self.rest_utc_s = None
        elif self.rest_utc_s is None:
            self.rest_utc_s = now_utc_s
        rested = self.rest_utc_s is not None and now_utc_s - self.rest_utc_s >= LINGER_S
        heard = self.session.link_state(now_utc_s) in {LinkState.UP, LinkState.STALE}
        given_up = now_utc_s - self._begun_utc_s > (UNCONFIRMED_S if heard else UNHEARD_S)
        if not self.finished and (rested or given_up):
            self.finished = True
            self.at_rest = None if self.session.sample is None else rested
        return self.session.compose()
