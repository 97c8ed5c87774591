"""Our own processes: how they call one another, end with one another, and run without garbage collection."""

from __future__ import annotations

import gc
import os
import signal
import sys
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator

STARTER = "SATTRACK_STARTER"
"""Names the process with which a program of ours ends, however that ends."""
_PR_SET_PDEATHSIG = 1


def self_command(module: str = "sattrack") -> list[str]:
    """Return the beginning of a command that runs a module of ours as a program.

    What lies in the current folder is not imported: a user's `json.py` would else stand in for Python's, in
    the guardian as well. Except where our package lies there, a checkout that need not be installed.
    """
    try:
        safe = () if Path(__file__).parents[2] == Path.cwd() else ("-P",)
    except FileNotFoundError:
        # The current folder was deleted.
        safe = ("-P",)
    return [sys.executable, *safe, "-m", module]


def ending_with_us() -> dict[str, str]:
    """Return the environment of a program of ours that must not outlive the thread that starts it (Linux)."""
    return {**os.environ, STARTER: str(os.getpid())}


def end_with_starter() -> None:
    """Have the kernel kill this process when its starter ends, where its starter has asked for that."""
    starter = os.environ.pop(STARTER, None)
    if starter is None or not sys.platform.startswith("linux"):
        return
    import ctypes

    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
    if starter != str(os.getppid()):
        sys.exit(128 + signal.SIGKILL)


def signals_here(*names: str) -> tuple[signal.Signals, ...]:
    """Return the signals of these names that this system has; Windows has few."""
    return tuple(getattr(signal, name) for name in names if hasattr(signal, name))


@contextmanager
def gc_paused() -> Iterator[None]:
    """Keep the collector of cycles away: a run makes none, but many objects that it would look through."""
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()
