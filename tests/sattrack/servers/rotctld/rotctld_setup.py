"""A rotator that stands still, for tests of what is answered; and Hamlib's own, where it is installed."""

from __future__ import annotations

import contextlib
import socket
import subprocess
import time
from contextlib import contextmanager
from typing import TYPE_CHECKING

from programs import free_port
from serving import PATIENCE_S, SITE

from sattrack.mount.model import AxesPosition
from sattrack.servers.antenna.equipment import Feedback
from sattrack.servers.antenna.protocol import NS
from sattrack.servers.antenna.trajectory import AxisState, SiteSky
from sattrack.servers.rotctld.rotator import Rotator
from tle.instants import Utc

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sattrack.servers.rotctld.answers import Client

NOON_NS = int(Utc.parse("2026-10-02T12:00:00Z").unix_s) * NS


class StandsStill(Feedback):
    link_up = True

    def actual(self, utc_ns: int) -> AxisState:
        return AxisState(0.0, 0.0, 0.0, 0.0)


def make_rotator(feedback: Feedback | None = None, one_at_a_time: bool = False) -> Rotator:
    park = AxesPosition(hour_angle_deg=0.0, dec_deg=60.0)
    return Rotator(SiteSky(SITE), feedback or StandsStill(), park, one_at_a_time)


def ask(client: Client, sent: bytes, at_s: float = 0.0) -> bytes:
    client.receive(sent)
    return client.answer(NOON_NS + round(at_s * NS), 10_000)[0]


def all_that_comes(port: int, sent: bytes) -> bytes:
    """Send on a connection of its own, say no more, and return all that comes back."""
    with socket.create_connection(("127.0.0.1", port), timeout=PATIENCE_S) as line:
        line.sendall(sent)
        line.shutdown(socket.SHUT_WR)
        came = b""
        while data := line.recv(65536):
            came += data
        return came


def hamlib_says(port: int, sent: bytes, expected: bytes) -> bytes:
    """Return what Hamlib's own answers, asked again where that is not what is expected.

    It closes each connection twice, and now and then hits another one that has begun meanwhile.
    """
    came = b""
    for _ in range(4):
        with contextlib.suppress(OSError):
            came = all_that_comes(port, sent) or came
        if came == expected:
            break
    return came


def say(line: socket.socket, words: bytes) -> bytes:
    """Say a line and return what came back first."""
    line.sendall(words + b"\n")
    return line.recv(65536)


@contextmanager
def hamlibs_own() -> Iterator[int]:
    """Run `rotctld -m 1` on a free port."""
    port = free_port()
    quiet = subprocess.DEVNULL
    process = subprocess.Popen(
        ["rotctld", "-m", "1", "-T", "127.0.0.1", "-t", str(port)], stdout=quiet, stderr=quiet
    )
    try:
        deadline_s = time.monotonic() + PATIENCE_S
        while True:
            try:
                socket.create_connection(("127.0.0.1", port), timeout=1.0).close()
                break
            except OSError:
                assert time.monotonic() < deadline_s, "rotctld did not start"
        yield port
    finally:
        process.terminate()
        process.wait()
