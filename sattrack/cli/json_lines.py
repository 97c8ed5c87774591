"""JSON lines on standard output that never make the writer wait."""

from __future__ import annotations

import contextlib
import os
import stat
import sys

import msgspec


class JsonLines:
    """Writes objects as JSON lines.

    A reader that does not keep up loses lines: into a pipe, a line is written whole or not at all (POSIX
    promises that up to PIPE_BUF bytes), so a loop that feeds a mount is never held up.
    """

    def __init__(self) -> None:
        self._encoder = msgspec.json.Encoder()
        self._out = sys.stdout.fileno()
        self._is_pipe = stat.S_ISFIFO(os.fstat(self._out).st_mode)
        if self._is_pipe:
            os.set_blocking(self._out, False)

    def write(self, item: object) -> None:
        """Write one object. Raises BrokenPipeError where the reader is gone."""
        with contextlib.suppress(BlockingIOError):
            os.write(self._out, self._encoder.encode(item) + b"\n")

    def write_whole(self, item: object) -> None:
        """Write one object however long that takes: for where nothing waits for the writer."""
        os.set_blocking(self._out, True)
        with os.fdopen(self._out, "wb", closefd=False) as out:
            out.write(self._encoder.encode(item) + b"\n")
        if self._is_pipe:
            os.set_blocking(self._out, False)

    def end(self) -> None:
        """Let what is written by other means from now on be written whole, however long that takes."""
        os.set_blocking(self._out, True)
