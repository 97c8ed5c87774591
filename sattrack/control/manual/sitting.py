"""A console with an operator before it, without I/O: obeys orders until the operator leaves.

Where it hears the mount obey somebody else, and nothing was asked of it from here, it keeps silent until it
is told to stop the mount.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import msgspec

from sattrack.control.driver import StopProcedure
from sattrack.control.manual.errand import LISTEN_S, LISTEN_STATUSES, acknowledged
from sattrack.control.manual.report import view_of
from sattrack.mount.model import Slew
from sattrack.mount.requests import Abort, FindHome, Park, Sync
from sattrack.views.messages import ConsoleMessage, Jog, Leave, Reset

if TYPE_CHECKING:
    from sattrack.control.manual.console import Console
    from sattrack.views.run import ConsoleView

OWNED = "looking on; SPACE has the mount's owner stop it and end: {}"
NOT_ALONE = "another program drives this mount: nothing is sent from here, unless you stop the mount"


class ConsoleSession:
    """One operator's time with one mount; call `tick` once a period until `finished`.

    With `owner`, whoever owns the mount in words, the operator looks on: nothing is sent, and a stop is only
    noted in `stop_wanted`.
    """

    def __init__(self, console: Console, started_utc_s: float, owner: str | None = None) -> None:
        self.console, self.profile = console, console.profile
        self.finished = False
        self.stop_wanted = False
        """Whether one who looks on wants the owner to stop the mount."""
        self._owner = owner
        self._started_utc_s = started_utc_s
        self._asked = False
        """Whether the operator has asked for anything."""
        self._heard = 0
        self._others: set[str] = set()

    @property
    def leaving(self) -> bool:
        """Whether the operator has left."""
        return self.console.stop is not None

    @property
    def mount_stopped(self) -> bool | None:
        """Whether the stop at the end was seen through; None where none was needed."""
        return self.console.mount_stopped

    def receive(self, data: bytes, arrival_utc_s: float) -> None:
        """Take one datagram from the mount."""
        received = self.console.session.health.received
        self.console.receive(data, arrival_utc_s)
        if not self._asked and self.console.session.health.received > received:
            self._heard += 1
            self._others |= acknowledged(data)

    def obey(self, order: ConsoleMessage, now_utc_s: float) -> None:
        """Do what the operator says; why not, where it is refused, stands in the view."""
        console = self.console
        if isinstance(order, Leave):
            self.interrupt(now_utc_s)
            return
        if self.leaving:
            return
        if self._owner is not None:
            self.stop_wanted = self.stop_wanted or isinstance(order, Abort)
            if not isinstance(order, Abort):
                console.refusal = "this mount has another owner"
            return
        if self._others and not self._asked and not isinstance(order, Abort):
            # A key that is touched by accident must not mix with what somebody else does.
            console.refusal = "another program drives this mount"
            return
        self._asked = True
        match order:
            case Abort():
                console.abort(now_utc_s)
            case Jog():
                console.jog(order.ra_rate_deg_s, order.dec_rate_deg_s, now_utc_s)
            case Slew() | Sync() | Park():
                console.request(order, now_utc_s)
            case FindHome():
                # Nobody has looked whether the way is free of the Sun.
                console.request(FindHome(), now_utc_s)
            case Reset():
                console.reset()

    def interrupt(self, now_utc_s: float) -> None:
        """Leave: stop what was begun from here, and end."""
        if self.leaving:
            return
        moving = self._owner is None and (self.console.moving or self.console.stopping)
        self.console.stop = StopProcedure(now_utc_s, needed=moving)
        if moving:
            self.console.abort(now_utc_s)

    def fail(self, words: str, now_utc_s: float) -> None:
        """Stop the mount and leave: something here is not to be relied on."""
        stop = self.console.stop
        begun_utc_s = now_utc_s if stop is None else stop.begun_utc_s
        self.console.stop = StopProcedure(begun_utc_s, needed=self._asked)
        self.console.fail(words)

    def tick(self, now_utc_s: float) -> bytes | None:
        """Return the datagram to send now, None while nothing is to be sent; call once a period."""
        if self._owner is not None:
            self.finished = self.leaving
            return None
        if not self._asked:
            listened = self._heard >= LISTEN_STATUSES or now_utc_s - self._started_utc_s >= LISTEN_S
            if self._others or not listened:
                self.finished = self.leaving
                return None
        datagram = self.console.tick(now_utc_s)
        self.finished = self.console.finished
        return datagram

    def view(self, now_utc_s: float) -> ConsoleView:
        """Return what the operator is to see."""
        view = view_of(self.console, now_utc_s)
        if self._owner is not None:
            return msgspec.structs.replace(view, warnings=(OWNED.format(self._owner), *view.warnings))
        if self._others and not self._asked:
            return msgspec.structs.replace(view, warnings=(NOT_ALONE, *view.warnings))
        return view
