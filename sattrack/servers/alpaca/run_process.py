"""The process that serves a run of `sattrack track` to other programs: what they see, and how they stop it.

It looks on at the run as `sattrack attach` does: views come from the run's view server, statuses from the
guardian of its mount, and all it sends is a stop. So clients can neither hold up the loop that feeds the
mount nor move the mount. Its arguments are a descriptor, at which its task comes, and the run's process; it
ends with either. Nothing more is imported before the run has shown its first view: a processor that the run
needs to begin is left to it.
"""

from __future__ import annotations

import contextlib
import os
import select
import socket
import sys
import threading
import time
from typing import Any, ClassVar

import msgspec

from sattrack.core.channel import Channel
from sattrack.core.errors import SattrackError
from sattrack.core.realtime import VARIABLE
from sattrack.runtime.view_server import name_for
from sattrack.views.run import SummaryLine, TrackView

LONGEST_LINE = 1 << 28
TASK_WITHIN_S = 10.0
STOP = b'{"type":"stop"}\n'
STOP_WITHIN_S = 0.5
"""How long a stop may take to show, before it is sent by the mount's guardian as well."""
BEHIND_THE_RUN = 5
"""How much nicer than the run this process is."""
RunMessage = TrackView | SummaryLine


class RunViews:
    """The run's view server, as one who looks on: views come, and stops go."""

    LOOK_EVERY_S: ClassVar[float] = 0.25

    def __init__(self, pid: int, name: str) -> None:
        self._pid, self._name = pid, name
        self._next_s = 0.0
        self._channel: Channel | None = None
        self._decoders = msgspec.json.Decoder(TrackView), msgspec.json.Decoder(SummaryLine)
        self._stopping = threading.Event()
        """Set where the run is seen to be ending."""

    @property
    def ended(self) -> bool:
        """Whether the run is over, and no other follows it."""
        return self._channel is not None and self._channel.ended

    def readers(self) -> list[Any]:
        """Return what to wait for."""
        return [] if self._channel is None or self.ended else [self._channel]

    def look(self) -> None:
        """Connect, where that is not done."""
        now_s = time.monotonic()
        if self._channel is not None or now_s < self._next_s:
            return
        self._next_s = now_s + self.LOOK_EVERY_S
        connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            connection.connect(name_for(self._pid))
        except OSError:
            connection.close()
            return
        self._channel = Channel(connection.detach(), longest=LONGEST_LINE)
        self._channel.send(msgspec.json.encode({"type": "hello", "name": self._name}) + b"\n")

    def news(self) -> list[RunMessage]:
        """Return the newest view that has come, and summaries."""
        found: list[RunMessage] = []
        for line in [] if self._channel is None else self._channel.lines():
            for decoder in self._decoders:
                with contextlib.suppress(msgspec.MsgspecError):
                    found.append(decoder.decode(line))
                    break
        for message in found:
            if isinstance(message, TrackView) and message.ended_by is not None:
                self._stopping.set()
        return found

    def stop(self) -> None:
        """Ask the run for a stop; where that does not show, ask the mount's guardian."""
        if self._channel is not None:
            self._channel.send(STOP)
        threading.Thread(target=self._see_stop_through, name="stop", daemon=True).start()

    def _see_stop_through(self) -> None:
        if self._stopping.wait(STOP_WITHIN_S):
            return
        from sattrack.runtime.mounts import ask_stop, owners

        with contextlib.suppress(SattrackError, OSError):
            for owner in owners():
                if owner.pid == self._pid:
                    ask_stop(owner, lambda: None)

    def wait(self, starter: Channel) -> list[RunMessage]:
        """Wait for the first views; return none where the run is over before, or its process is gone."""
        while not (self.ended or starter.ended):
            self.look()
            if found := self.news():
                return found
            waited = [one for one in (*self.readers(), starter) if one is not None]
            if starter in select.select(waited, [], [], self.LOOK_EVERY_S)[0]:
                starter.lines()
        return []


def main() -> int:
    """Run the process; returns its exit code."""
    # The loop that feeds the mount goes before this one.
    os.environ[VARIABLE] = "0"
    with contextlib.suppress(OSError):
        os.nice(BEHIND_THE_RUN)
    starter = Channel(int(sys.argv[1]), longest=LONGEST_LINE)
    lines = starter.first(TASK_WITHIN_S)
    views = RunViews(int(sys.argv[2]), sys.argv[3])
    if not lines or not (first := views.wait(starter)):
        return 1
    from sattrack.servers.alpaca.run_station import serve

    try:
        serve(lines[0], starter, views, first, log)
    except SattrackError as error:
        log(f"sattrack: --serve: {error}; the run goes on without")
        return 1
    return 0


def log(text: str) -> None:
    """Write a line to standard error, where somebody reads that."""
    with contextlib.suppress(OSError):
        os.write(2, f"{text}\n".encode())


if __name__ == "__main__":
    sys.exit(main())
