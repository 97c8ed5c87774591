"""The stop of a mount, without I/O: what ends it is decided here, for whatever moves a mount.

A session that is told `Stop` says abort until the mount acknowledges it, and raises it anew where the mount
moves on. `StopProcedure` tells when that is over. `DirectStop` has a session of its own, for whoever takes
over from one that is gone or not to be relied on.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from sattrack.mount.link_loss import STOP_LINGER_S, longest_stop_s
from sattrack.mount.model import Stop
from sattrack.mount.xerxes.session import Session
from sattrack.mount.xerxes.states import LinkState
from sattrack.safety import Safety, SafetyLimits

if TYPE_CHECKING:
    from sattrack.mount.model import MountProfile


class StopProcedure:
    """One stop by a session: over when the mount is seen at rest, or when its time has passed.

    `needed` False: nothing was set going; only the last datagrams are waited for. `blind`: the mount may move
    although it was never heard; without, what was never heard was never set going.
    """

    def __init__(self, begun_utc_s: float, needed: bool = True, blind: bool = False) -> None:
        self.begun_utc_s = begun_utc_s
        self.finished = False
        self.at_rest: bool | None = None
        """Whether the mount was seen at rest by the end of the stop, or later; None before the end, where no
        stop was needed, and where the mount was never heard."""
        self.needed = needed
        self._blind = blind
        self._rest_utc_s: float | None = None

    def renew(self, now_utc_s: float) -> None:
        """Give the stop its whole time again."""
        self.begun_utc_s, self.finished = now_utc_s, False

    def look(self, session: Session, now_utc_s: float) -> bool:
        """Tell whether it is over; call once a period."""
        link, waited_s = session.link_state(now_utc_s), now_utc_s - self.begun_utc_s
        # One old status is not enough: the mount must still be heard while it is said to rest.
        if not session.stopped or link is not LinkState.UP:
            self._rest_utc_s = None
        elif self._rest_utc_s is None:
            self._rest_utc_s = now_utc_s
        rested = self._rest_utc_s is not None and now_utc_s - self._rest_utc_s >= STOP_LINGER_S
        heard = session.sample is not None
        if self.finished:
            if rested and self.needed:
                self.at_rest = True
            return True
        if not self.needed or not (heard or self._blind):
            self.finished = waited_s >= STOP_LINGER_S
        else:
            self.finished = rested or waited_s > longest_stop_s(link in {LinkState.UP, LinkState.STALE})
        if self.finished and self.needed and heard:
            self.at_rest = rested
        return self.finished


class DirectStop(StopProcedure):
    """One stop by a session of its own; call `tick` once a period until `finished`.

    `counter` is the number of the last datagram that the mount was sent. After the end, more ticks keep the
    mount at rest: should it move again, it is stopped again.
    """

    def __init__(self, profile: MountProfile, begun_utc_s: float, counter: int = 0) -> None:
        super().__init__(begun_utc_s, blind=True)
        self.session = Session(profile)
        self.session.health.sent = counter
        self.session.apply(Safety(profile, SafetyLimits(), 0.0).clear(Stop(), 0.0, 0.0, 0.0))

    @property
    def mount_stopped(self) -> bool | None:
        """Whether the mount was seen at rest, as loops ask for it."""
        return self.at_rest

    def receive(self, data: bytes, arrival_utc_s: float) -> None:
        """Take one datagram from the mount."""
        self.session.receive(data, arrival_utc_s)

    def tick(self, now_utc_s: float) -> bytes:
        """Return the datagram to send now."""
        self.look(self.session, now_utc_s)
        return self.session.compose()

    def last_heard(self, now_utc_s: float) -> str:
        """Return what the mount told last, in words."""
        sample, age_s = self.session.sample, self.session.health.age_s(now_utc_s)
        if sample is None or age_s is None:
            return "the mount has not been heard since"
        when = "now" if age_s < 1.0 else f"{age_s:.0f} s ago"
        if self.session.at_rest:
            return f"last heard {when}, at rest"
        ra, dec = sample.ra_drive_deg_s, sample.dec_drive_deg_s
        return f"last heard {when}, moving at {ra:.3f} and {dec:.3f} °/s (hour angle, declination)"
