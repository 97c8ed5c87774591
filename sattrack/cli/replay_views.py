"""The views of a recorded run as JSON lines, as fast as they are made: what the replay's screen reads."""

from __future__ import annotations

import select
import sys
from typing import TYPE_CHECKING

from sattrack.cli.json_lines import JsonLines
from sattrack.recording.format import COMMAND

if TYPE_CHECKING:
    from sattrack.control.engine import Engine
    from sattrack.recording.reading import Entry, Recording

VIEW_EVERY_S = 0.1
MOST_VIEWS = 20_000
"""Of a recording of hours, so many, evenly: they are all held at once."""
HEED_EVERY = 20


class LeftError(Exception):
    """Whoever looked on has left."""


class ViewsAtOnce(JsonLines):
    """Writes a view for each tenth of a second of a run being made again, and waits for its reader.

    Raises LeftError where standard input says stop, or ends.
    """

    def __init__(self, recording: Recording) -> None:
        super().__init__()
        instants = [entry.utc_s for entry in recording.entries() if entry.topic == COMMAND]
        span_s = max(instants, default=0.0) - min(instants, default=0.0)
        # A little less: the ticks' own jitter must not leave every second one out.
        self._every_s = max(VIEW_EVERY_S, span_s / MOST_VIEWS) - 0.01
        self._count = 0
        self._last_utc_s: float | None = None
        self.engine: Engine | None = None
        self.utc_s = 0.0

    def __call__(self, engine: Engine, entry: Entry) -> None:
        """Take one entry of the recording, handed to the engine already."""
        if entry.topic != COMMAND or engine.failed:
            return
        if self._last_utc_s is not None and 0.0 <= entry.utc_s - self._last_utc_s < self._every_s:
            return
        self._last_utc_s = self.utc_s = entry.utc_s
        self.engine = engine
        self.write_whole(engine.view(entry.utc_s))
        self._count += 1
        if self._count % HEED_EVERY == 0:
            self._heed()

    def _heed(self) -> None:
        heard, _, _ = select.select([sys.stdin], [], [], 0.0)
        if heard:
            line = sys.stdin.buffer.readline()
            if not line or b'"stop"' in line:
                raise LeftError
