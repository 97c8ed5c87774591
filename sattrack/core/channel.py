"""Lines between processes, one message of JSON each, over a pipe or a socket. No writer waits for a reader.

How long a line may be is bounded, and so is what waits there: a reader that does not keep up is one that
has gone.
"""

from __future__ import annotations

import os
import select
import subprocess
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from sattrack.core.process import self_command

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    import msgspec

READ_BYTES = 65536
CLOSED = -1
MOST_WAITING_BYTES = 1 << 20
T = TypeVar("T")


class LineReader:
    """Whole lines from a descriptor, without ever waiting for one."""

    def __init__(self, descriptor: int, longest: int = READ_BYTES, begun: bytes = b"") -> None:
        """Take `begun`: what somebody else has read of it already."""
        os.set_blocking(descriptor, False)
        self._descriptor, self.longest = descriptor, longest
        self._rest = begun
        self.ended = False
        """Whether the other end is gone, or was given up."""
        self.overlong = False
        """Whether a line was longer than is allowed: it is dropped, and half of it may follow."""

    def fileno(self) -> int:
        """Return the descriptor to wait on."""
        return self._descriptor

    def lines(self) -> Sequence[bytes]:
        """Return the lines that are complete now: of one read, so that a flood takes bounded time."""
        if self.ended:
            return ()
        try:
            data = os.read(self._descriptor, READ_BYTES)
        except BlockingIOError:
            return ()
        except OSError:
            data = b""
        if not data:
            self.ended = True
        *lines, rest = (self._rest + data).split(b"\n")
        allowed = [line for line in lines if len(line) <= self.longest]
        self._rest = rest if len(rest) <= self.longest else b""
        self.overlong |= len(allowed) < len(lines) or len(self._rest) < len(rest)
        return allowed

    def close(self) -> None:
        """Do nothing: the descriptor is not the reader's own."""

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
        begun: bytes = b"",
    ) -> None:
        super().__init__(descriptor, longest, begun)
        self._writing = descriptor if writing is None else writing
        os.set_blocking(self._writing, False)
        self._most_waiting = most_waiting
        self.waiting = bytearray()
        """What the other end has not taken yet."""

    def send(self, lines: bytes) -> None:
        """Send whole lines, as far as they can be sent now; the rest waits for `flush`."""
        if self.ended:
            return
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
        """Close the descriptors, where they are the channel's own; more than once does nothing."""
        for descriptor in {self._descriptor, self._writing} - {CLOSED}:
            os.close(descriptor)
        self._descriptor = self._writing = CLOSED
        self.ended = True


def start_process(module: str, *arguments: str, inherits: Iterable[int]) -> subprocess.Popen[bytes]:
    """Start a module of ours as a process that inherits descriptors, and has neither input nor output.

    It has a session of its own: a Ctrl-C is for the process that starts it. Raises OSError.
    """
    return subprocess.Popen(
        [*self_command(module), *arguments],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        pass_fds=tuple(inherits),
        start_new_session=True,
    )


@dataclass(slots=True)
class PipedProcess:
    """A module of ours as a process whose standard input and output are a channel."""

    process: subprocess.Popen[bytes]
    channel: Channel

    @classmethod
    def start(cls, module: str, argument: str) -> PipedProcess:
        """Start it in a session of its own: it ends with its standard input, not by a Ctrl-C."""
        process = subprocess.Popen(
            [*self_command(module), argument],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=True,
        )
        assert process.stdin is not None
        assert process.stdout is not None
        return cls(process, Channel(process.stdout.fileno(), process.stdin.fileno()))

    def close(self, within_s: float) -> None:
        """End its standard input, and it by that; kill it where it does not end in time."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.close()
        see_off(self.process, within_s)
        self.process.stdout.close()


def see_off(process: subprocess.Popen[bytes], within_s: float) -> None:
    """Wait for the end of a process; kill it where it does not end in time."""
    try:
        process.wait(within_s)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def taken_names(prefix: str) -> set[str]:
    """Return what follows a prefix in the names of Unix sockets in Linux's abstract namespace."""
    try:
        table = Path("/proc/net/unix").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return set()
    names = (line.rpartition(" ")[2] for line in table.splitlines())
    return {name.removeprefix(f"@{prefix}") for name in names if name.startswith(f"@{prefix}")}
