"""A run that goes on elsewhere, looked at from here: a thread reads what its gallery tells, words go back."""

from __future__ import annotations

import contextlib
import socket
import threading
import time
from collections import deque
from typing import TYPE_CHECKING, BinaryIO

import msgspec

from sattrack.errors import SattrackError
from sattrack.messages import StopNow
from sattrack.runtime.gallery_words import name_for
from sattrack.runtime.owner import ask_stop, owners
from sattrack.session_messages import encode_said
from sattrack.session_view import Farewell, SessionView, Welcome
from sattrack.tui.feed import News
from sattrack.view import PassView, SummaryLine, TrackView
from tle.errors import TleError

if TYPE_CHECKING:
    from collections.abc import Callable

    from sattrack.messages import Message
    from sattrack.runtime.facts import RunFacts
    from sattrack.session_messages import SessionMessage
    from sattrack.view import Summary

WELCOME_WITHIN_S = 5.0
TRY_AGAIN_S = 0.02
STOP_WITHIN_S = 1.0
"""How long a stop may take to show, before it is said another way."""
LONGEST_UNREAD = 20_000

_Told = TrackView | SessionView | Welcome | Farewell
_TOLD: msgspec.json.Decoder[_Told] = msgspec.json.Decoder(_Told)
_SUMMARY: msgspec.json.Decoder[SummaryLine] = msgspec.json.Decoder(SummaryLine)


class AttachedRun:
    """One run seen through its gallery; its end, or that of the connection, does nothing to the mount."""

    def __init__(self, pid: int, name: str, scene: Callable[[RunFacts], PassView] | None = None) -> None:
        """Connect. Raises SattrackError where the run is not to be looked at; `scene` draws its sky."""
        self._pid, self._scene = pid, scene
        self._door, self._lines, self.welcome = welcomed(pid, name)
        self._views: deque[TrackView] = deque(maxlen=LONGEST_UNREAD)
        self._sky: PassView | None = None
        self._session: SessionView | None = None
        self._ended = False
        self._rewound = False
        self._stopping = False
        self._changed = threading.Condition()
        self.summary: Summary | None = None
        self.viewed = False
        """Whether a view has come at all."""
        self._reader = threading.Thread(target=self._read, name="run's views", daemon=True)
        self._reader.start()

    def wait_first_view(self) -> bool:
        """Wait until a view has come; False where the run ended without one."""
        with self._changed:
            self._changed.wait_for(lambda: self.viewed or self._ended)
        return self.viewed

    def news(self) -> News:
        """Return what has come since the last call."""
        with self._changed:
            views, rewound = tuple(self._views), self._rewound
            self._views.clear()
            self._rewound = False
            return News(views, self._ended, self.summary, self._sky, rewound, self._session, self.welcome.you)

    def send(self, message: Message | SessionMessage) -> bool:
        """Hand a message over. A stop that is not obeyed soon goes by the mount's guardian as well."""
        if isinstance(message, StopNow):
            threading.Thread(target=self._see_stop_through, name="stop", daemon=True).start()
        try:
            self._door.send(encode_said(message), socket.MSG_DONTWAIT)
        except OSError:
            return False
        return True

    def close_input(self) -> None:
        """Look away."""
        with contextlib.suppress(OSError):
            self._door.shutdown(socket.SHUT_RDWR)

    def wait(self, seconds: float) -> int | None:
        """Tell that there is nothing to wait for: the run is not ours."""
        del seconds
        return 0

    def end_by_force(self, grace_s: float) -> int:
        """End nothing: the run is not ours."""
        del grace_s
        return 0

    def close(self) -> None:
        """Look away, and let go of everything."""
        self.close_input()
        self._reader.join(1.0)
        self._door.close()

    def _see_stop_through(self) -> None:
        with self._changed:
            if self._changed.wait_for(lambda: self._ended or self._stopping, STOP_WITHIN_S):
                return
        with contextlib.suppress(SattrackError, OSError):
            for owner in owners():
                if owner.pid == self._pid:
                    ask_stop(owner, lambda: None)

    def _read(self) -> None:
        with contextlib.suppress(OSError, ValueError):
            for line in self._lines:
                self._take(line)
        with self._changed:
            self._ended = True
            self._changed.notify_all()

    def _take(self, line: bytes) -> None:
        try:
            told = _TOLD.decode(line)
        except msgspec.MsgspecError:
            self._take_other(line)
            return
        with self._changed:
            match told:
                case TrackView():
                    self._views.append(told)
                    self._stopping = told.ended_by is not None
                    self.viewed = True
                case SessionView():
                    self._session = told
                case _:
                    pass
            self._changed.notify_all()

    def _take_other(self, line: bytes) -> None:
        """Take what the run came to, or the facts from which its sky is drawn; anything else is later's."""
        from sattrack.runtime.facts import decode_facts

        with contextlib.suppress(msgspec.MsgspecError):
            summary = _SUMMARY.decode(line).summary
            with self._changed:
                self.summary = summary
            return
        with contextlib.suppress(msgspec.MsgspecError, SattrackError, TleError):
            facts = decode_facts(line)
            with self._changed:
                if self.summary is not None:
                    # Another run begins: what was seen of the one before is over.
                    self.summary, self._rewound = None, True
                    self._views.clear()
            sky = None if self._scene is None else self._scene(facts)
            with self._changed:
                self._sky = sky


def welcomed(pid: int, name: str) -> tuple[socket.socket, BinaryIO, Welcome]:
    """Connect to a run's gallery; return the connection, its lines and the welcome. Raises SattrackError."""
    door = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    door.settimeout(WELCOME_WITHIN_S)
    try:
        _knock(door, name_for(pid))
        door.sendall(msgspec.json.encode({"type": "hello", "name": name}) + b"\n")
        lines = door.makefile("rb")
        first = _TOLD.decode(lines.readline())
    except (OSError, msgspec.MsgspecError):
        door.close()
        raise SattrackError(f"process {pid} has no run to look at, or does not answer") from None
    if not isinstance(first, Welcome):
        door.close()
        raise SattrackError(first.why if isinstance(first, Farewell) else f"process {pid} said no welcome")
    door.settimeout(None)
    return door, lines, first


def _knock(door: socket.socket, name: str) -> None:
    """Connect, however many stand there; raises OSError."""
    until_s = time.monotonic() + WELCOME_WITHIN_S
    while True:
        try:
            door.connect(name)
        except BlockingIOError:
            if time.monotonic() > until_s:
                raise
            time.sleep(TRY_AGAIN_S)
        else:
            return
