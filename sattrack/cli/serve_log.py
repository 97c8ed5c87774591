"""What a service says while it runs: lines on standard error, each with its instant."""

from __future__ import annotations

import queue
import threading
import time
from typing import TYPE_CHECKING

import click

from sattrack.servers.antenna.log_lines import stamp

if TYPE_CHECKING:
    from sattrack.core.clock import Clock

LAST_LINES_WITHIN_S = 1.0


class Log:
    """Lines on standard error in the Field System's style, each with its instant.

    They are written by a thread of their own: a terminal that is held holds nothing else up.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._lines: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._write, name="log", daemon=True)
        self._thread.start()

    def tell(self, words: str) -> None:
        """Tell one line, without waiting."""
        self._lines.put(stamp(self._clock.utc_s(time.monotonic())) + words)

    def close(self) -> None:
        """Have the last lines written, if that does not take long."""
        self._lines.put(None)
        self._thread.join(LAST_LINES_WITHIN_S)

    def _write(self) -> None:
        while (line := self._lines.get()) is not None:
            click.echo(line, err=True)
