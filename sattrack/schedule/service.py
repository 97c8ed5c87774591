"""Messages to a service manager by systemd's protocol: datagrams to the socket in NOTIFY_SOCKET."""

from __future__ import annotations

import contextlib
import os
import socket
import threading
import time
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

PINGS_PER_PERIOD = 3.0


class Service:
    """Tells the service manager how this process stands; does nothing where none asks.

    The watchdog is fed by a thread, only as long as the main thread has promised to come back.
    """

    def __init__(self, environment: Mapping[str, str] | None = None) -> None:
        given = os.environ if environment is None else environment
        name = given.get("NOTIFY_SOCKET", "")
        # A leading @ stands for Linux's abstract namespace.
        self._address = "\0" + name[1:] if name.startswith("@") else name
        self._until_s = time.monotonic()
        self._ended = threading.Event()
        self._thread: threading.Thread | None = None
        self._period_s = _watchdog_s(given)
        self._status = ""

    def tell(self, *assignments: str) -> None:
        """Send assignments such as READY=1. A manager that does not listen is no reason to end."""
        if not self._address:
            return
        with contextlib.suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender:
            sender.setblocking(False)
            sender.sendto("\n".join(assignments).encode(), self._address)

    def status(self, words: str) -> None:
        """Send one line of status, where it has changed."""
        if words != self._status:
            self._status = words
            self.tell(f"STATUS={words.splitlines()[0] if words else ''}")

    def promise(self, seconds: float) -> None:
        """Promise that the main thread calls again within so long."""
        self._until_s = time.monotonic() + seconds
        if self._thread is None and self._address and self._period_s is not None:
            self._thread = threading.Thread(target=self._feed, name="watchdog", daemon=True)
            self._thread.start()

    def close(self) -> None:
        """End the thread."""
        self._ended.set()
        if self._thread is not None:
            self._thread.join()

    def _feed(self) -> None:
        assert self._period_s is not None
        while not self._ended.is_set():
            if time.monotonic() < self._until_s:
                self.tell("WATCHDOG=1")
            self._ended.wait(self._period_s / PINGS_PER_PERIOD)


def _watchdog_s(given: Mapping[str, str]) -> float | None:
    """Return how often the manager wants to hear of this process; None where it does not."""
    if given.get("WATCHDOG_PID", str(os.getpid())) != str(os.getpid()):
        return None
    try:
        return float(int(given["WATCHDOG_USEC"])) / 1e6
    except (KeyError, ValueError):
        return None
