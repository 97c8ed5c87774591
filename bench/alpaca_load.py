"""What Alpaca's clients do to the mount's datagrams: python bench/alpaca_load.py [--seconds S] [--rounds N].

A simulated mount in a process of its own; between it and `sattrack serve alpaca` this program, which hands
datagrams on and has the kernel's own stamps of when each of the server's came. Loads take turns, so that all
are measured on the same machine at the same time: none; one connection with 1,000 requests a second, of which
20 are orders (MoveAxis, to and fro); 200 connections with one request a second each; both. Told is how far
periods are from 50 ms, and the ratio to those without load. Asking is done by a process of its own, with no
more processors than the rest.
"""

from __future__ import annotations

import argparse
import json
import os
import select
import socket
import sys
import time
from contextlib import ExitStack

from server_load import CROWD, MANY, SETTLE_S, begin_asking, end_asking, open_server

from sattrack.core.figures import quantile

LOADS = {
    "none": [],
    "one connection, 1,000 a second": [MANY],
    "200 connections, one a second each": [CROWD],
    "both": [MANY, CROWD],
}
ORDER_EVERY = 50
LATE_MS = 1.0
RATE_DEG_S = 0.05
DEVICE = "/api/v1/telescope/0/"
READ = f"GET {DEVICE}rightascension?ClientID=1 HTTP/1.1\r\nHost: localhost\r\n\r\n".encode()


def put(member: str, body: str) -> bytes:
    head = f"PUT {DEVICE}{member} HTTP/1.1\r\nHost: localhost\r\nContent-Length: {len(body)}\r\n"
    return f"{head}Content-Type: application/x-www-form-urlencoded\r\n\r\n{body}".encode()


def ask(port: int, clients: int, rate: float, seconds: float) -> None:
    """Ask `rate` times a second in all; print how often an answer came, and how many were errors."""
    lines = [socket.create_connection(("127.0.0.1", port)) for _ in range(clients)]
    for line in lines:
        line.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    began_s, answers, fine, asked = time.monotonic(), 0, 0, 0
    while (gone_s := time.monotonic() - began_s) < seconds:
        while asked < gone_s * rate:
            order = clients == 1 and asked % ORDER_EVERY == 0
            way = RATE_DEG_S * (1 if asked // ORDER_EVERY % 2 else -1)
            lines[asked % clients].sendall(put("moveaxis", f"Axis=1&Rate={way}") if order else READ)
            asked += 1
        for ready in select.select(lines, [], [], min(max(0.0, asked / rate - gone_s), 0.05))[0]:
            data = ready.recv(65536)
            answers += data.count(b"HTTP/1.1 ")
            fine += data.count(b'"ErrorNumber":0')
    if clients == 1:
        lines[0].sendall(put("moveaxis", "Axis=1&Rate=0"))
    passed_s = time.monotonic() - began_s
    print(json.dumps([answers / passed_s, (answers - fine) / passed_s]))


def measure(seconds: float, rounds: int) -> None:
    off_ms: dict[str, list[float]] = {name: [] for name in LOADS}
    told: dict[str, list[str]] = {}
    with ExitStack() as closing:
        relay, port = open_server(closing, "alpaca", "--no-discovery")
        relay.run_for(SETTLE_S)
        with socket.create_connection(("127.0.0.1", port)) as line:
            line.sendall(put("connect", "ClientID=1"))
            relay.run_for(SETTLE_S)
        for _ in range(rounds):
            for name, load in LOADS.items():
                asking = begin_asking(__file__, port, load, seconds + 3.0)
                relay.run_for(2.0)
                off_ms[name] += relay.run_for(seconds)
                relay.run_for(2.0)
                told[name] = [
                    f"{rate:.0f} answers a second, {errors:.0f} of them errors"
                    for rate, errors in end_asking(asking)
                ]
    figures = {
        name: (
            quantile(sorted(off), 0.5),
            quantile(sorted(off), 0.99),
            quantile(sorted(off), 0.999),
            max(off),
        )
        for name, off in off_ms.items()
    }
    print("periods off 50 ms by           median     p99   p99.9    most  (ms), as ratios p99.9 and most")
    for name, row in figures.items():
        ratios = [f"{mine / alone:6.2f}" for mine, alone in zip(row[2:], figures["none"][2:], strict=True)]
        print(f"{name:<36}" + "".join(f"{figure:8.2f}" for figure in row) + "  " + "".join(ratios))
        late = sum(off > LATE_MS for off in off_ms[name])
        many = f"of {len(off_ms[name])} periods, {late} off by more than {LATE_MS:g} ms"
        print(f"    {many}; " + "; ".join(told[name] or ["nobody asks"]))
    print(f"with a load of {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--seconds", type=float, default=10.0, help="how long each load is measured in a round"
    )
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--ask", nargs=4, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.ask is None:
        measure(given.seconds, given.rounds)
        return
    port, clients, rate, seconds = given.ask
    ask(int(port), int(clients), float(rate), float(seconds))


if __name__ == "__main__":
    sys.exit(main())
