"""The operating system's part: signals, the error of the machine's clock, this process and its peers.

A signal that would end the program becomes a request to stop the mount first. The clock's error is the
kernel's own account of it, adjtimex(2), Linux only; nothing is set.
"""

from __future__ import annotations

import os
import signal
import socket
import struct
import sys
import time
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from sattrack.core.process import signals_here

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

STOPPING_SIGNALS = signals_here("SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT")
IGNORED_SIGNALS = signals_here("SIGTSTP", "SIGTTIN", "SIGTTOU")
"""A suspended run could not stop the mount."""
OUTLIVED_SIGNALS = (*STOPPING_SIGNALS, *signals_here("SIGTSTP", "SIGPIPE"))
"""Ignored by a process that must outlive its run."""


@dataclass(slots=True)
class StopRequest:
    """Set from a signal handler or another thread: the run must stop the mount and end."""

    asked: bool = False

    def ask(self) -> None:
        """Ask for the stop."""
        self.asked = True


@contextmanager
def stopping(stop: StopRequest) -> Iterator[None]:
    """Turn signals that end programs into a request to stop, however often they come; ignore suspension.

    Whoever starts a program by nohup wants it to outlive its terminal.
    """
    outlived = {one for one in signals_here("SIGHUP") if signal.getsignal(one) == signal.SIG_IGN}
    with handling(dict.fromkeys(set(STOPPING_SIGNALS) - outlived, stop.ask)):
        yield


@contextmanager
def handling(handlers: Mapping[signal.Signals, Callable[[], None]]) -> Iterator[None]:
    """Have each signal call its handler, until the end; ignore suspension."""
    before = {number: signal.getsignal(number) for number in (*handlers, *IGNORED_SIGNALS)}
    for number, handler in handlers.items():
        signal.signal(number, lambda *_, handler=handler: handler())
    for number in IGNORED_SIGNALS:
        signal.signal(number, signal.SIG_IGN)
    try:
        yield
    finally:
        for number, previous in before.items():
            signal.signal(number, previous)


def outlive() -> None:
    """Ignore signals that are meant for the run: this process ends by itself after it."""
    for number in OUTLIVED_SIGNALS:
        signal.signal(number, signal.SIG_IGN)


_CREDENTIALS = struct.Struct("3i")
_UNSYNCHRONISED = 0x0040
_TIMEX = struct.Struct("@I4li3l2l3li5li11i0l")
"""`struct timex` of adjtimex(2)."""
MAX_ERROR, EST_ERROR, STATUS, TIME, TICK = 3, 4, 5, 9, 11
"""Places of its fields."""


@dataclass(frozen=True, slots=True)
class KernelClock:
    """The kernel's account of its clock.

    `synchronised` where something disciplines it; `estimated_error_s` and `largest_error_s` are what that
    last reported, the largest growing by 0.5 ms a second until the next report.
    """

    synchronised: bool
    estimated_error_s: float
    largest_error_s: float


def read_timex() -> tuple[int, ...] | None:
    """Return the fields of `struct timex`; None where the kernel does not give them."""
    if not sys.platform.startswith("linux"):
        return None
    import ctypes

    timex = ctypes.create_string_buffer(_TIMEX.size)
    return None if ctypes.CDLL(None).adjtimex(timex) < 0 else _TIMEX.unpack(timex.raw)


def read_kernel_clock() -> KernelClock | None:
    """Return what the kernel knows of its clock; None where it cannot be asked."""
    timex = read_timex()
    if timex is None:
        return None
    return KernelClock(
        synchronised=not timex[STATUS] & _UNSYNCHRONISED,
        estimated_error_s=timex[EST_ERROR] * 1e-6,
        largest_error_s=timex[MAX_ERROR] * 1e-6,
    )


def this_command() -> str:
    """Return this process' command line for people."""
    return " ".join(["sattrack", *sys.argv[1:]])[:200]


def this_user() -> int:
    """Return the number of the user who runs this; -1 on Windows, where users have none."""
    return -1 if sys.platform == "win32" else os.getuid()


def user_of(pid: int) -> int | None:
    """Return the user whose process it is; None where there is none. Linux."""
    try:
        return Path(f"/proc/{pid}").stat().st_uid
    except OSError:
        return None


def user_name(user: int) -> str:
    """Return a user's name, or the number where it has none. Linux and macOS."""
    import pwd

    try:
        return pwd.getpwuid(user).pw_name
    except KeyError:
        return str(user)


def is_trusted(user: int) -> bool:
    """Return whether a user is this one or root: what any other says may be meant to harm."""
    return user in (0, this_user())


def utc_now() -> str:
    """Return this instant for people, to the second."""
    return time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())


def peer_of(connection: socket.socket) -> tuple[int, int]:
    """Return the process and the user at the other end of a Unix socket, by the kernel. Linux."""
    pid, user, _ = _CREDENTIALS.unpack(
        connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size)
    )
    return pid, user
