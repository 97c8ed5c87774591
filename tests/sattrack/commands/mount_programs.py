"""A simulated mount that answers one client at a fixed port, and the mount verbs run as a user runs them."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
import threading
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator

SITE = ("--site", "52.0,4.5,0")


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


def program(*arguments: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "sattrack", *arguments],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


@contextmanager
def closed(process: subprocess.Popen[str]) -> Iterator[subprocess.Popen[str]]:
    """Make sure that a process is gone and its pipes are closed."""
    try:
        yield process
    finally:
        process.kill()
        process.wait()
        for pipe in (process.stdin, process.stdout, process.stderr):
            assert pipe is not None
            pipe.close()


class Mount:
    """`sattrack sim --json`: what it tells of its axes is read as it comes."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        assert process.stdout is not None
        self._process = process
        port = json.loads(process.stdout.readline())["listening"]
        self.url = f"xerxes://127.0.0.1:{port}?listen={free_port()}"
        self.truths: list[dict[str, float]] = []
        self._changed = threading.Condition()
        self._reader = threading.Thread(target=self._read)
        self._reader.start()

    def _read(self) -> None:
        for line in self._process.stdout or ():
            with self._changed:
                self.truths.append(json.loads(line))
                self._changed.notify_all()

    def wait_until_moving(self, moving: bool) -> None:
        """Wait until an axis moves otherwise than with the sky, or until none does."""
        with self._changed:
            assert self._changed.wait_for(
                lambda: bool(self.truths) and moves(self.truths[-1]) is moving, 30.0
            )

    def end(self) -> None:
        self._process.terminate()
        self._reader.join()


def moves(truth: dict[str, float]) -> bool:
    """Whether an axis moves otherwise than with the sky."""
    sidereal_deg_s = 360.0 / 86164.0905
    ra = min(abs(truth["ra_rate_deg_s"]), abs(truth["ra_rate_deg_s"] - sidereal_deg_s))
    return max(ra, abs(truth["dec_rate_deg_s"])) > 1e-4


@contextmanager
def simulated_mount(*options: str) -> Iterator[Mount]:
    with closed(program("sim", "--port", "0", "--json", *SITE, *options)) as process:
        mount = Mount(process)
        try:
            yield mount
        finally:
            mount.end()
