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
        if stat.S_ISFIFO(os.fstat(self._out).st_mode):
            os.set_blocking(self._out, False)

    def write(self, item: object) -> None:
        """Write one object. Raises BrokenPipeError where the reader is gone."""
        with contextlib.suppress(BlockingIOError):
            os.write(self._out, self._encoder.encode(item) + b"\n")

    def end(self) -> None:
        """Let what is written by other means from now on be written whole, however long that takes."""
        os.set_blocking(self._out, True)
