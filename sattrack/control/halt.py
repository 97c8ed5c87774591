"""Bring a mount to rest and see it there, without I/O: for whoever takes over from a session that is gone.

Nothing is known of what went before but the number of the last datagram: a fresh session says abort, with no
other flag up, until the mount acknowledges it and its positions rest.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from sattrack.mount.link_loss import STOP_LINGER_S, STOPS_MOVING_S, STOPS_SENT_S
from sattrack.mount.model import Stop
from sattrack.mount.xerxes.session import Session
from sattrack.mount.xerxes.states import LinkState
from sattrack.safety import Safety, SafetyLimits

if TYPE_CHECKING:
    from sattrack.mount.model import MountProfile


class StopWatch:
    """Tells when a session's stop is over: the mount is seen at rest, or its time has passed."""

    def __init__(self, begun_utc_s: float) -> None:
        self.rested = False
        """Whether the mount has been seen at rest for STOP_LINGER_S, and is still."""
        self._begun_utc_s = begun_utc_s
        self._rest_utc_s: float | None = None

    def renew(self, now_utc_s: float) -> None:
        """Give the stop its whole time again."""
        self._begun_utc_s = now_utc_s

    def over(self, session: Session, now_utc_s: float) -> bool:
        """Tell whether it is over; call once a period."""
        # One old status is not enough: the mount must still be heard while it is said to rest.
        if not session.stopped or session.link_state(now_utc_s) is not LinkState.UP:
            self._rest_utc_s = None
        elif self._rest_utc_s is None:
            self._rest_utc_s = now_utc_s
        self.rested = self._rest_utc_s is not None and now_utc_s - self._rest_utc_s >= STOP_LINGER_S
        heard = session.link_state(now_utc_s) in {LinkState.UP, LinkState.STALE}
        return self.rested or now_utc_s - self._begun_utc_s > (STOPS_MOVING_S if heard else STOPS_SENT_S)

    def waited_s(self, now_utc_s: float) -> float:
        """Return how long the stop has taken so far."""
        return now_utc_s - self._begun_utc_s


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
        """Whether the mount was seen at rest by the end of the stop, or later; None where never heard."""
        self._watch = StopWatch(begun_utc_s)
        self.session.apply(Safety(profile, SafetyLimits(), 0.0).clear(Stop(), 0.0, 0.0, 0.0))

    def receive(self, data: bytes, arrival_utc_s: float) -> None:
        """Take one datagram from the mount."""
        self.session.receive(data, arrival_utc_s)

    def tick(self, now_utc_s: float) -> bytes:
        """Return the datagram to send now."""
        over = self._watch.over(self.session, now_utc_s)
        if over and not self.finished:
            self.finished = True
            self.at_rest = None if self.session.sample is None else self._watch.rested
        elif self.finished and self._watch.rested:
            self.at_rest = True
        return self.session.compose()

    def renew(self, now_utc_s: float) -> None:
        """Begin anew with a stop that was finished without rest."""
        self._watch.renew(now_utc_s)
        self.finished = False

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
