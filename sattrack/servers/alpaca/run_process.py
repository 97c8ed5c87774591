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
import sys

from sattrack.core.channel import Channel
from sattrack.core.errors import SattrackError
from sattrack.core.realtime import VARIABLE
from sattrack.runtime.view_server import RunViews

LONGEST_TASK = 1 << 28
TASK_WITHIN_S = 10.0
BEHIND_THE_RUN = 5
"""How much nicer than the run this process is."""


def main() -> int:
    """Run the process; returns its exit code."""
    # The loop that feeds the mount goes before this one.
    os.environ[VARIABLE] = "0"
    with contextlib.suppress(OSError):
        os.nice(BEHIND_THE_RUN)
    starter = Channel(int(sys.argv[1]), longest=LONGEST_TASK)
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
