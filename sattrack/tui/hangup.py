"""The end of a terminal that nobody tells of: a pseudo-terminal or a pipe whose other end is gone.

A screen that waits for keys from it would wait for ever, and the run with it, with nobody at the stop key.
"""

from __future__ import annotations

import os
import select
import signal
import stat
import sys
import threading
from typing import Protocol

HUNG_UP = 128 + signal.SIGHUP
STDIN, STDOUT = 0, 1


class Endable(Protocol):
    """What is to end with a terminal."""

    def close_input(self) -> None:
        """Say that nobody is there any more."""

    def wait(self, seconds: float) -> int | None:
        """Wait for the end; None where it is not over within `seconds`."""

    def end_by_force(self, grace_s: float) -> int:
        """End it by force."""


def end_with_the_terminal(feeder: Endable, patience_s: float, grace_s: float) -> None:
    """Watch standard input from now on, where that is a terminal; its end ends the feeder, and this process.

    The feeder is told to stop the mount, has `patience_s` for that, and is ended by force after it: its
    guardian sees to the mount then. Nothing is written any more: there is nobody to read.
    """
    try:
        descriptor = sys.stdin.fileno()
    except (OSError, ValueError):
        return
    # Of a terminal that is gone already, nothing but this tells that it was one.
    if not stat.S_ISCHR(os.fstat(descriptor).st_mode):
        return
    _end_with((descriptor,), feeder, patience_s, grace_s)


def end_with_the_server(run: Endable) -> None:
    """Watch the pipes to the program that shows this screen; its end, or theirs, ends this process."""
    _end_with((STDIN, STDOUT), run, 0.0, 0.0)


def _end_with(descriptors: tuple[int, ...], feeder: Endable, patience_s: float, grace_s: float) -> None:
    poller = select.poll()
    for descriptor in descriptors:
        # Without any event asked for, only the end is told.
        poller.register(descriptor, 0)

    def watch() -> None:
        poller.poll()
        feeder.close_input()
        if feeder.wait(patience_s) is None:
            feeder.end_by_force(grace_s)
        os._exit(HUNG_UP)

    threading.Thread(target=watch, name="terminal's end", daemon=True).start()
