"""The end of a service: the mount told to stop, and seen at rest, or given up."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sattrack.manual.errand import LINGER_S, STOP_UNCONFIRMED_S, STOP_UNHEARD_S
from sattrack.xerxes.link import LinkState

if TYPE_CHECKING:
    from sattrack.xerxes.session import Session


class Resting:
    """Waits from an instant on for a mount to rest, if something was moving it; call `look` each period."""

    def __init__(self, since_utc_s: float, moving: bool) -> None:
        self._since_utc_s, self._moving = since_utc_s, moving
        self._rest_utc_s: float | None = None
        self.mount_stopped: bool | None = None
        """Whether the stop was seen through; None where none was needed, or nobody was heard."""

    def seen_by_engine(self, mount_stopped: bool | None) -> None:
        """Take what the engine saw of the stop that ended it."""
        self._moving, self.mount_stopped = False, mount_stopped

    def look(self, session: Session, now_utc_s: float) -> bool:
        """Tell whether there is nothing left to wait for."""
        waited_s = now_utc_s - self._since_utc_s
        if not self._moving:
            return waited_s >= LINGER_S
        if not session.stopped:
            self._rest_utc_s = None
        elif self._rest_utc_s is None:
            self._rest_utc_s = now_utc_s
        rested = self._rest_utc_s is not None and now_utc_s - self._rest_utc_s >= LINGER_S
        never_heard = session.sample is None and waited_s >= LINGER_S
        heard = session.link_state(now_utc_s) in {LinkState.UP, LinkState.STALE}
        if rested or never_heard or waited_s > (STOP_UNCONFIRMED_S if heard else STOP_UNHEARD_S):
            self.mount_stopped = None if session.sample is None else rested
            return True
        return False
