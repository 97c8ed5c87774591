"""What rotctld's clients do to the mount's datagrams: `python bench/rotctld_load.py [--seconds S]`.

A simulated mount in a process of its own; between it and `sattrack serve rotctld` this program, which hands
datagrams on and has the kernel's own stamps of when each of the server's came. Periods are shown as how far
they are from 50 ms: with no client, with one that asks 1,000 times a second, with 200 that ask once a second
each, and with both. Asking is done by a process of its own, with no more processors than the rest.
"""

from __future__ import annotations

import argparse
import os
import select
import socket
import sys
import time
from contextlib import ExitStack

from server_load import CROWD, MANY, SETTLE_S, begin_asking, end_asking, open_server

from sattrack.core.figures import quantile

LOADS = {"one, 1,000 a second:": [MANY], "200, one a second each:": [CROWD], "both:": [MANY, CROWD]}


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
        relay, port = open_server(closing, "rotctld", "--requests", "2000")
        relay.run_for(SETTLE_S)
        with socket.create_connection(("127.0.0.1", port)) as line:
            line.sendall(b"P 200 45\n")
            relay.run_for(SETTLE_S)
        print(f"periods are off by, no client:       {told(relay.run_for(seconds))}")
        for words, loads in LOADS.items():
            asking = begin_asking(__file__, port, loads, seconds + 3.0)
            relay.run_for(2.0)
            figures = told(relay.run_for(seconds))
            relay.run_for(1.5)
            rates = [f"{rate:.0f}" for rate in end_asking(asking)]
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
