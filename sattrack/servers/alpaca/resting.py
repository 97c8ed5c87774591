"""The end of a service: the mount told to stop, and seen at rest, or given up."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sattrack.control.halt import StopWatch
from sattrack.mount.link_loss import STOP_LINGER_S

if TYPE_CHECKING:
    from sattrack.mount.xerxes.session import Session


class Resting:
    """Waits from an instant on for a mount to rest, if something was moving it; call `look` each period."""

    def __init__(self, since_utc_s: float, moving: bool) -> None:
        self._stop, self._moving = StopWatch(since_utc_s), moving
        self.mount_stopped: bool | None = None
        """Whether the stop was seen through; None where none was needed, or nobody was heard."""

    def seen_by_engine(self, mount_stopped: bool | None) -> None:
        """Take what the engine saw of the stop that ended it."""
        self._moving, self.mount_stopped = False, mount_stopped

    def look(self, session: Session, now_utc_s: float) -> bool:
        """Tell whether there is nothing left to wait for."""
        lingered = self._stop.waited_s(now_utc_s) >= STOP_LINGER_S
        if not self._moving:
            return lingered
        never_heard = session.sample is None and lingered
        if self._stop.over(session, now_utc_s) or never_heard:
            self.mount_stopped = None if session.sample is None else self._stop.rested
            return True
        return False
