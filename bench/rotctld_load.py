"""What rotctld's clients do to the mount's datagrams: `python bench/rotctld_load.py [--seconds S]`.

A simulated mount in a process of its own; between it and `sattrack serve rotctld` this program, which hands
datagrams on and has the kernel's own stamps of when each of the door's came. Periods are told as how far they
are from 50 ms: with no client, with one that asks 1,000 times a second, with 200 that ask once a second each,
and with both. Asking is done by a process of its own, with no more processors than the rest.
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import select
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path

from sattrack import practice
from sattrack.figures import quantile

PERIOD_NS = 50_000_000
SO_TIMESTAMPNS = 35
SETTLE_S = 4.0
SITE = practice.SITE.place()
WHERE = f"{SITE.latitude_deg},{SITE.longitude_deg},{SITE.height_m}"


class Relay:
    """Hands datagrams on between the door and the mount, and keeps the stamps of the door's."""

    def __init__(self, mount_port: int) -> None:
        self.front = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.front.bind(("127.0.0.1", 0))
        self.front.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
        self.back = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.back.connect(("127.0.0.1", mount_port))
        self.door: tuple[str, int] | None = None
        self.stamps: list[int] = []
        self.last_counter = -1

    def run_for(self, seconds: float) -> list[float]:
        """Hand on for a while; return by how much periods were off, ms."""
        self.stamps.clear()
        until_s = time.monotonic() + seconds
        while (left_s := until_s - time.monotonic()) > 0.0:
            for ready in select.select([self.front, self.back], [], [], left_s)[0]:
                if ready is self.front:
                    self._from_door()
                elif self.door is not None:
                    self.front.sendto(self.back.recv(4096), self.door)
        stamps = self.stamps
        return sorted(abs(b - a - PERIOD_NS) / 1e6 for a, b in itertools.pairwise(stamps))

    def _from_door(self) -> None:
        data, notes, _, self.door = self.front.recvmsg(4096, 256)
        self.back.send(data)
        (counter,) = struct.unpack_from("<q", data, 8)
        if counter != self.last_counter:
            self.last_counter = counter
            (seconds, nanoseconds) = struct.unpack("qq", notes[0][2])
            self.stamps.append(seconds * 10**9 + nanoseconds)


def ask(port: int, clients: int, rate: float, seconds: float) -> None:
    """Ask where the mount is, `rate` times a second in all; print how often an answer came."""
    lines = [socket.create_connection(("127.0.0.1", port)) for _ in range(clients)]
    for line in lines:
        line.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    began_s, answers, asked = time.monotonic(), 0, 0
    while (gone_s := time.monotonic() - began_s) < seconds:
        while asked < gone_s * rate:
            lines[asked % clients].sendall(b"p\n")
            asked += 1
        wait_s = max(0.0, asked / rate - gone_s)
        for ready in select.select(lines, [], [], min(wait_s, 0.05))[0]:
            answers += ready.recv(65536).count(b"\n") // 2
    print(answers / (time.monotonic() - began_s))


def told(off_ms: list[float]) -> str:
    figures = [quantile(off_ms, part) for part in (0.5, 0.99)]
    return f"{figures[0]:.2f} ms median, {figures[1]:.2f} ms p99, {off_ms[-1]:.2f} ms most, of {len(off_ms)}"


def measure(seconds: float) -> None:
    with ExitStack() as closing:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
            free.bind(("127.0.0.1", 0))
            mount_port = free.getsockname()[1]
        relay = Relay(mount_port)
        folder = closing.enter_context(tempfile.TemporaryDirectory())
        settings = Path(folder) / "radio.toml"
        settings.write_text("[safety]\noptical = false\n")
        program = [sys.executable, "-m", "sattrack"]
        simulated = subprocess.Popen(
            [*program, "sim", "--port", str(mount_port), "--site", WHERE], stderr=subprocess.DEVNULL
        )
        closing.callback(simulated.terminate)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
            free.bind(("127.0.0.1", 0))
            listen = free.getsockname()[1]
        url = f"xerxes://127.0.0.1:{relay.front.getsockname()[1]}?listen={listen}"
        options = ["--mount", url, "--port", "0", "--json", "--site", WHERE, "--config", str(settings)]
        door = subprocess.Popen(
            [*program, "serve", "rotctld", *options, "--requests", "2000"],
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
        )
        closing.callback(door.wait)
        closing.callback(door.send_signal, signal.SIGINT)
        assert door.stdout is not None
        port = json.loads(door.stdout.readline())["listening"]
        relay.run_for(SETTLE_S)
        with socket.create_connection(("127.0.0.1", port)) as line:
            line.sendall(b"P 200 45\n")
            relay.run_for(SETTLE_S)
        print(f"periods are off by, no client:       {told(relay.run_for(seconds))}")
        for words, loads in (
            ("one, 1,000 a second:", [(1, 1000.0)]),
            ("200, one a second each:", [(200, 200.0)]),
            ("both:", [(1, 1000.0), (200, 200.0)]),
        ):
            asking = [
                subprocess.Popen(
                    [
                        sys.executable,
                        __file__,
                        "--ask",
                        str(port),
                        str(clients),
                        str(rate),
                        str(seconds + 3.0),
                    ],
                    stdout=subprocess.PIPE,
                )
                for clients, rate in loads
            ]
            relay.run_for(2.0)
            figures = told(relay.run_for(seconds))
            relay.run_for(1.5)
            rates = []
            for process in asking:
                out, _ = process.communicate()
                rates.append(f"{float(out):.0f}")
            print(f"{words:<24} {figures}; answers a second: {' and '.join(rates)}")
        print(f"with a load of {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=30.0, help="how long each is measured")
    parser.add_argument("--ask", nargs=4, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.ask is None:
        measure(given.seconds)
        return
    port, clients, rate, seconds = given.ask
    ask(int(port), int(clients), float(rate), float(seconds))


if __name__ == "__main__":
    sys.exit(main())
