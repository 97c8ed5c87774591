"""A server with a simulated mount behind it, this program between the two, and clients that ask much."""

from __future__ import annotations

import itertools
import json
import select
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from programs import ended, free_port, sattrack

from sattrack.runtime import demo_pass

if TYPE_CHECKING:
    from contextlib import ExitStack

PERIOD_NS = 50_000_000
SO_TIMESTAMPNS = 35
ABORT = 73
"""Where a command has its flag to stop, by the protocol's table."""
SETTLE_S = 4.0
PLACE = demo_pass.SITE.place()
WHERE = f"{PLACE.latitude_deg},{PLACE.longitude_deg},{PLACE.height_m}"
MANY = (1, 1000.0)
"""One client that asks 1,000 times a second."""
CROWD = (200, 200.0)
"""200 that ask once a second each."""


class Relay:
    """Hands datagrams on between the server and the mount, and keeps the stamps of the server's."""

    def __init__(self, mount_port: int) -> None:
        self.front = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.front.bind(("127.0.0.1", 0))
        self.front.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
        self.back = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.back.connect(("127.0.0.1", mount_port))
        self.server: tuple[str, int] | None = None
        self.stamps: list[int] = []
        self.stops: list[int] = []
        """When datagrams came with which a stop begins, nanoseconds of the system's clock."""
        self.last_counter = -1
        self._stopping = False

    def run_for(self, seconds: float) -> list[float]:
        """Hand on for a while; return by how much periods were off, ms."""
        self.stamps.clear()
        until_s = time.monotonic() + seconds
        while (left_s := until_s - time.monotonic()) > 0.0:
            for ready in select.select([self.front, self.back], [], [], left_s)[0]:
                if ready is self.front:
                    self._from_server()
                elif self.server is not None:
                    self.front.sendto(self.back.recv(4096), self.server)
        stamps = self.stamps
        return sorted(abs(b - a - PERIOD_NS) / 1e6 for a, b in itertools.pairwise(stamps))

    def _from_server(self) -> None:
        data, notes, _, self.server = self.front.recvmsg(4096, 256)
        self.back.send(data)
        (seconds, nanoseconds) = struct.unpack("qq", notes[0][2])
        stamp, stopping = seconds * 10**9 + nanoseconds, data[ABORT] != 0
        if stopping and not self._stopping:
            self.stops.append(stamp)
        self._stopping = stopping
        (counter,) = struct.unpack_from("<q", data, 8)
        if counter != self.last_counter:
            self.last_counter = counter
            self.stamps.append(stamp)


def open_server(closing: ExitStack, *server: str) -> tuple[Relay, int]:
    """Run `sattrack serve SERVER` until the end; return what hands datagrams on, and the server's port."""
    mount_port, listen = free_port(), free_port()
    relay = Relay(mount_port)
    folder = closing.enter_context(tempfile.TemporaryDirectory())
    settings = Path(folder) / "radio.toml"
    settings.write_text("[safety]\noptical = false\n")
    quiet = {"stdin": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    mount = sattrack("sim", "--port", str(mount_port), "--site", WHERE, **quiet, stdout=subprocess.DEVNULL)
    closing.enter_context(ended(mount))
    url = f"xerxes://127.0.0.1:{relay.front.getsockname()[1]}?listen={listen}"
    options = ["--mount", url, "--port", "0", "--json", "--site", WHERE, "--config", str(settings)]
    server = closing.enter_context(ended(sattrack("serve", *server, *options, **quiet)))
    closing.callback(server.wait)
    # It ends only while its datagrams are handed on, as it waits until the mount is seen at rest.
    closing.callback(relay.run_for, SETTLE_S)
    closing.callback(server.send_signal, signal.SIGINT)
    assert server.stdout is not None
    return relay, int(json.loads(server.stdout.readline())["listening"])


def begin_asking(
    program: str, port: int, loads: list[tuple[int, float]], seconds: float
) -> list[subprocess.Popen[bytes]]:
    """Have a program ask so much, each load from a process of its own."""
    return [
        subprocess.Popen(
            [sys.executable, program, "--ask", str(port), str(clients), str(rate), str(seconds)],
            stdout=subprocess.PIPE,
        )
        for clients, rate in loads
    ]


def end_asking(asking: list[subprocess.Popen[bytes]]) -> list[Any]:
    """Wait for those who ask; return what each has told, as JSON."""
    return [json.loads(process.communicate()[0]) for process in asking]
