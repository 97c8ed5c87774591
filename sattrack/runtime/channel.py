"""Lines between processes, one message of JSON each, over a pipe or a socket. Nobody here waits for a reader.

How long a line may be is bounded, and so is what waits to be sent: a reader that does not keep up is one that
has gone.
"""

from __future__ import annotations

import os
import select
import subprocess
import time
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from collections.abc import Sequence

    import msgspec

READ_BYTES = 65536
MOST_WAITING_BYTES = 1 << 20
T = TypeVar("T")


class LineReader:
    """Whole lines from a descriptor, without ever waiting for one."""

    def __init__(self, descriptor: int, longest: int = READ_BYTES) -> None:
        os.set_blocking(descriptor, False)
        self._descriptor, self._longest = descriptor, longest
        self._rest = b""
        self.ended = False
        """Whether the other end is gone, or was given up."""
        self.overlong = False
        """Whether a line was longer than is allowed: it is dropped, and half of it may follow."""

    def fileno(self) -> int:
        """Give the descriptor to wait on."""
        return self._descriptor

    def lines(self) -> Sequence[bytes]:
        """Return the lines that are complete now: of one read, so that a flood takes bounded time."""
        try:
            data = os.read(self._descriptor, READ_BYTES)
        except BlockingIOError:
            return ()
        except OSError:
            data = b""
        if not data:
            self.ended = True
        *lines, rest = (self._rest + data).split(b"\n")
        allowed = [line for line in lines if len(line) <= self._longest]
        self._rest = rest if len(rest) <= self._longest else b""
        self.overlong |= len(allowed) < len(lines) or len(self._rest) < len(rest)
        return allowed

    def messages(self, decoder: msgspec.json.Decoder[T]) -> list[T]:
        """Return the messages that have come. Raises msgspec.MsgspecError for a line that is none."""
        return [decoder.decode(line) for line in self.lines()]

    def first(self, within_s: float) -> Sequence[bytes]:
        """Wait for the first lines; return none where the other end is gone, or none came in time."""
        until_s = time.monotonic() + within_s
        while not (lines := self.lines()) and not self.ended:
            if not select.select([self], [], [], max(0.0, until_s - time.monotonic()))[0]:
                break
        return lines


class Channel(LineReader):
    """Lines both ways: over a socket's descriptor, or with `writing`, over the descriptors of two pipes."""

    def __init__(
        self,
        descriptor: int,
        writing: int | None = None,
        *,
        longest: int = READ_BYTES,
        most_waiting: int = MOST_WAITING_BYTES,
    ) -> None:
        super().__init__(descriptor, longest)
        self._writing = descriptor if writing is None else writing
        os.set_blocking(self._writing, False)
        self._most_waiting = most_waiting
        self.waiting = bytearray()
        """What the other end has not taken yet."""

    def send(self, lines: bytes) -> None:
        """Send whole lines, as far as they can be sent now; the rest waits for `flush`."""
        self.waiting += lines
        self.flush()
        if len(self.waiting) > self._most_waiting:
            self.ended = True

    def flush(self) -> None:
        """Send what waits, as far as it can be sent now."""
        if not self.waiting or self.ended:
            return
        try:
            sent = os.write(self._writing, self.waiting)
        except BlockingIOError:
            return
        except OSError:
            self.ended = True
            return
        del self.waiting[:sent]

    def close(self) -> None:
        """Close the descriptors, where they are the channel's own."""
        for descriptor in {self._descriptor, self._writing}:
            os.close(descriptor)


def see_off(process: subprocess.Popen[bytes], within_s: float) -> None:
    """Wait for the end of a process; kill it where it does not end in time."""
    try:
        process.wait(within_s)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
