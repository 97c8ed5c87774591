"""The feeder's end of its view server: show views, hear messages, wait for neither.

Each message between the two is one packet over a pair of sockets.
"""

from __future__ import annotations

import contextlib
import errno
import os
import socket
import subprocess
from typing import TYPE_CHECKING

import msgspec

from sattrack.core.channel import start_process
from sattrack.runtime.facts import encode_facts
from sattrack.runtime.gallery import (
    FACTS,
    SESSION,
    SUMMARY,
    SUPPORTED,
    VIEW,
    ViewServerTask,
    VisitorEvent,
    name_for,
)
from sattrack.runtime.owner import this_command, this_user, utc_now
from sattrack.views.run import SummaryLine

if TYPE_CHECKING:
    from sattrack.runtime.facts import RunFacts
    from sattrack.views.run import SessionView, Summary, TrackView

BACKLOG = 128
HEARD_AT_ONCE = 20
END_WITHIN_S = 3.0
SUMMARY_WITHIN_S = 0.5
PACKET_BYTES = 65536


class ViewServerLink:
    """A view server at work. Where it dies, the run goes on, and nobody can look on any more."""

    def __init__(self, facts: RunFacts) -> None:
        """Start the process. Raises OSError where it cannot start, or the name is taken."""
        self._socket, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs, socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as door:
            try:
                door.bind(name_for(os.getpid()))
                door.listen(BACKLOG)
                door.setblocking(False)
                self._process = start_process(
                    "sattrack.runtime.gallery",
                    str(theirs.fileno()),
                    inherits=(theirs.fileno(), door.fileno()),
                )
            except OSError:
                self._socket.close()
                raise
            task = ViewServerTask(
                door=door.fileno(),
                user=this_user(),
                pid=os.getpid(),
                command=this_command(),
                since_utc=utc_now(),
                mount=facts.mount_name,
                name=facts.target.label,
            )
        self._socket.setblocking(False)
        self._gone = False
        self._send(msgspec.json.encode(task))
        self._send(FACTS + encode_facts(facts))
        self._decoder = msgspec.json.Decoder(VisitorEvent)

    @property
    def pid(self) -> int:
        """The view server's process number."""
        return self._process.pid

    def begin(self, facts: RunFacts) -> None:
        """Show another run from now on."""
        self._send(FACTS + encode_facts(facts))

    def show(self, view: TrackView) -> None:
        """Show a view; where the view server does not keep up, it is lost."""
        self._send(VIEW + msgspec.json.encode(view))

    def tell(self, session: SessionView) -> bool:
        """Show who has control; return whether that was sent."""
        return self._send(SESSION + msgspec.json.encode(session))

    def tell_end(self, summary: Summary) -> None:
        """Send the summary, when the run's loop is over."""
        with contextlib.suppress(OSError):
            self._socket.settimeout(SUMMARY_WITHIN_S)
            self._socket.send(SUMMARY + msgspec.json.encode(SummaryLine(summary)))
        self._socket.setblocking(False)

    def heard(self) -> list[VisitorEvent]:
        """Return what was said and who came and went, a bounded part of it, without waiting."""
        found: list[VisitorEvent] = []
        while len(found) < HEARD_AT_ONCE and not self._gone:
            try:
                packet = self._socket.recv(PACKET_BYTES)
            except BlockingIOError:
                break
            except OSError:
                packet = b""
            if not packet:
                self._gone = True
                break
            found.append(self._decoder.decode(packet))
        return found

    def close(self) -> None:
        """Let go; the view server ends once everybody has heard the last."""
        self._socket.close()
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(END_WITHIN_S)

    def _send(self, packet: bytes) -> bool:
        if self._gone:
            return False
        try:
            self._socket.send(packet)
        except BlockingIOError:
            return False
        except OSError as error:
            self._gone = error.errno != errno.EMSGSIZE
            return False
        return True


def open_view_server(facts: RunFacts) -> ViewServerLink | None:
    """Start a view server; None where there are no such names, or it cannot be started."""
    if not SUPPORTED:
        return None
    try:
        return ViewServerLink(facts)
    except OSError:
        return None
