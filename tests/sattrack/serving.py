"""A server of `sattrack serve` as a program: its port, and its log as it comes."""

from __future__ import annotations

import json
import os
import queue
import select
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

from programs import free_port

from sattrack.cli.main import run
from sattrack.mount.model import MountProfile
from sattrack.mount.xerxes.client import Address
from sattrack.runtime import demo_pass
from sattrack.runtime.connection import owned

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

PATIENCE_S = 60.0
SITE = demo_pass.SITE.place()
WHERE = f"{SITE.latitude_deg},{SITE.longitude_deg},0"


class Served:
    """The program at work: its port, and the log so far."""

    def __init__(self, process: subprocess.Popen[bytes]) -> None:
        assert process.stdout is not None
        self.process = process
        self.log: list[bytes] = []
        self._lines: queue.SimpleQueue[bytes] = queue.SimpleQueue()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()
        readable, _, _ = select.select([process.stdout], [], [], PATIENCE_S)
        assert readable, "it did not start"
        line = process.stdout.readline()
        assert line, self.log
        self.port = int(json.loads(line)["listening"])

    def wait_for(self, words: bytes) -> None:
        """Wait until a line that was not looked at yet has these words."""
        while words not in self._lines.get(timeout=PATIENCE_S):
            pass

    def end(self) -> None:
        """Interrupt it, and have the rest of its log."""
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGINT)
            self.process.wait(timeout=PATIENCE_S)
        self._reader.join(PATIENCE_S)

    def _read(self) -> None:
        assert self.process.stderr is not None
        for line in self.process.stderr:
            self.log.append(line)
            self._lines.put(line)


@contextmanager
def serving_program(server: str, *options: str) -> Iterator[Served]:
    """Serve a simulated mount until the end, once it is heard.

    The antenna is that of a radio dish, so that tests pass wherever the Sun stands when they run.
    """
    with tempfile.TemporaryDirectory() as folder:
        settings = Path(folder) / "radio.toml"
        settings.write_text("[safety]\noptical = false\n")
        command = [sys.executable, "-m", "sattrack", "serve", server, "--mount", "sim", "--site", WHERE]
        process = subprocess.Popen(
            [*command, "--json", "--port", "0", "--config", str(settings), *options],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
        )
        served = Served(process)
        try:
            served.wait_for(b"the mount is heard")
            yield served
        finally:
            served.end()
            process.communicate()


def call(port: int, host: str = "127.0.0.1") -> socket.socket:
    """Return a client's line."""
    line = socket.create_connection((host, port), timeout=PATIENCE_S)
    line.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return line


@contextmanager
def serial_line() -> Iterator[tuple[str, str]]:
    """Give the two ends of a serial line: two pseudo-terminals, back to back."""
    (one, its_end), (other, other_end) = os.openpty(), os.openpty()
    ended = threading.Event()

    def carry() -> None:
        while not ended.is_set():
            for number in select.select([one, other], [], [], 0.05)[0]:
                with suppress(OSError):
                    os.write(other if number == one else one, os.read(number, 1024))

    carrying = threading.Thread(target=carry)
    carrying.start()
    try:
        yield os.ttyname(its_end), os.ttyname(other_end)
    finally:
        ended.set()
        carrying.join()
        for number in (one, its_end, other, other_end):
            os.close(number)


def serve_owned_mount(server: str) -> int:
    """Try to serve a mount that somebody owns, which is an error; return the mount's port."""
    port = free_port()
    with owned(Address("127.0.0.1", port, 0), MountProfile()) as (_, guard):
        url = f"xerxes://127.0.0.1:{port}?listen=15001"
        assert run(["serve", server, "--mount", url, "--port", "0", "--site", WHERE]) == 1
        guard.release(None)
    return port


def resident_kb(process_id: int) -> int:
    """Return how much memory a process has."""
    words = Path(f"/proc/{process_id}/status").read_text().split()
    return int(words[words.index("VmRSS:") + 1])


def until(what: Callable[[], bool]) -> None:
    """Ask until something is so."""
    deadline_s = time.monotonic() + PATIENCE_S
    while not what():
        assert time.monotonic() < deadline_s
        # Asking a thousand times a second finds nothing out that asking fifty times does not.
        select.select([], [], [], 0.02)
