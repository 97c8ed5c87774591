"""Observations from outside while a run goes on: JSON lines on standard input, or on a UDP port of loopback.

Lines are kept as they come, at most so many, and read a few a tick: no burst disturbs the loop. A line that
is no observation is counted, and otherwise as if it had not come.
"""

from __future__ import annotations

import socket
import sys
from collections import deque
from typing import TYPE_CHECKING, Protocol

import msgspec

from sattrack.core.channel import LineReader
from sattrack.core.errors import BadInputError, SattrackError
from sattrack.views.messages import decode_observation

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from sattrack.views.messages import Observation, SeenOffset

A_TICK = 2
"""Observations used a tick: an estimate takes under a millisecond."""
MOST_MALFORMED_A_TICK = 100
QUEUED_MOST = 2000
DATAGRAMS_A_TICK = 64
DATAGRAM_BYTES = 8192
RECEIVE_BUFFER_BYTES = 65536
LOOPBACK = "127.0.0.1"
WRITE = "write udp:PORT or stdin"


class Source(Protocol):
    """Where lines come from."""

    def lines(self) -> Iterable[bytes]:
        """Return what has come, without waiting."""

    def close(self) -> None:
        """Let go of what is held."""


class Observers:
    """Lines from some sources in one queue, and the observations in them."""

    def __init__(self, sources: Iterable[Source] = ()) -> None:
        self._sources = tuple(sources)
        self._queue: deque[bytes] = deque()
        self.malformed = 0
        self.dropped = 0
        """Lines that came when the queue was full."""
        self.complaint: str | None = None
        """What was wrong with the last line that was no observation."""

    def put(self, line: bytes) -> None:
        """Take one line; empty ones are nothing."""
        if not line.strip():
            return
        if len(self._queue) >= QUEUED_MOST:
            self.dropped += 1
            return
        self._queue.append(line)

    def observations(self, most: int = A_TICK) -> Sequence[Observation | SeenOffset]:
        """Return the oldest observations that have come and were not returned yet, without waiting."""
        for source in self._sources:
            for line in source.lines():
                self.put(line)
        found: list[Observation | SeenOffset] = []
        malformed = 0
        while self._queue and len(found) < most and malformed < MOST_MALFORMED_A_TICK:
            try:
                found.append(decode_observation(self._queue.popleft()))
            except (msgspec.MsgspecError, RecursionError) as error:
                malformed += 1
                self.complaint = str(error)
        self.malformed += malformed
        return found

    def close(self) -> None:
        """Let go of the sources."""
        for source in self._sources:
            source.close()


class UdpLines:
    """Lines in datagrams to a port of loopback, one or more in each."""

    def __init__(self, port: int) -> None:
        """Bind the port; raises SattrackError where it is not available."""
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        # Room for a tick of one camera's lines: of a flood, the system drops the rest.
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER_BYTES)
        try:
            self._socket.bind((LOOPBACK, port))
        except OSError as error:
            self._socket.close()
            raise SattrackError(
                f"--observations udp:{port}: UDP port {port} of {LOOPBACK} is not available: {error.strerror}"
            ) from error

    def lines(self) -> Sequence[bytes]:
        """Return the lines of the datagrams that have come."""
        lines: list[bytes] = []
        for _ in range(DATAGRAMS_A_TICK):
            try:
                lines.extend(self._socket.recv(DATAGRAM_BYTES).split(b"\n"))
            except OSError:
                break
        return lines

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


def check_source(text: str | None) -> int | None:
    """Return the port of `udp:PORT`, None for `stdin` and for nothing; raises BadInputError."""
    if text is None or text == "stdin":
        return None
    kind, _, number = text.partition(":")
    if kind != "udp":
        raise BadInputError(f"--observations {text}: {WRITE}")
    if not (number.isascii() and number.isdecimal() and 1 <= int(number) <= 65535):
        raise BadInputError(f"--observations {text}: a port is 1 to 65535; {WRITE}")
    return int(number)


def open_observers(text: str | None) -> Observers:
    """Return the observers for `--observations`, "stdin", "udp:PORT" or None.

    Raises BadInputError for anything else, SattrackError where the port is not available.
    """
    port = check_source(text)
    if port is not None:
        return Observers([UdpLines(port)])
    return Observers([LineReader(sys.stdin.fileno())] if text == "stdin" else [])


def read_all(stream: Iterable[bytes]) -> Observers:
    """Return observers that hold every line of a stream that ends."""
    observers = Observers()
    for line in stream:
        observers.put(line)
    return observers
