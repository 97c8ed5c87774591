"""Signals that would end a program, turned into a request to stop the mount first."""

from __future__ import annotations

import signal
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

STOPPING_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)
IGNORED_SIGNALS = (signal.SIGTSTP, signal.SIGTTIN, signal.SIGTTOU)
"""A run that is suspended would leave the mount moving with nobody to stop it."""
OUTLIVED_SIGNALS = (*STOPPING_SIGNALS, signal.SIGTSTP, signal.SIGPIPE)
"""What a process that is to outlive its run must not be ended or suspended by."""


@dataclass(slots=True)
class StopRequest:
    """Set from a signal handler or another thread: the run is to stop the mount and end."""

    asked: bool = False

    def ask(self) -> None:
        """Ask for the stop."""
        self.asked = True


@contextmanager
def stopping(stop: StopRequest) -> Iterator[None]:
    """Have the signals that end programs ask for a stop, however often they come; suspending is ignored."""
    with handling(dict.fromkeys(STOPPING_SIGNALS, stop.ask)):
        yield


@contextmanager
def handling(handlers: Mapping[signal.Signals, Callable[[], None]]) -> Iterator[None]:
    """Have each signal call its handler, until the end; suspending is ignored."""
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
    """Ignore what is meant for the run, as this process ends by itself after it."""
    for number in OUTLIVED_SIGNALS:
        signal.signal(number, signal.SIG_IGN)
