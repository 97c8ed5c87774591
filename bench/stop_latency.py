"""How long a client's stop takes to the mount's datagram: `python bench/stop_latency.py`.

A simulated mount in a process of its own; between it and sattrack this program, which hands datagrams on and
has the kernel's stamp of the first one with the flag to stop. From just before the client's bytes are sent to
that stamp: for `serve`, N stops of a motion by each protocol; for `track --serve`, N runs by each, of which
every stop ends one. Clients send the protocols' own bytes on connections that are open already.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import socket
import subprocess
import tempfile
import threading
import time
from contextlib import ExitStack
from pathlib import Path

from programs import ended, free_port, satellite, sattrack, simulated_mount
from server_load import WHERE, Relay

from sattrack.core.figures import quantile

PROTOCOLS = ("alpaca", "indi", "lx200", "rotctld")
PATIENCE_S = 60.0
AHEAD_S = 90.0
WAIT_S = 0.5
AT_REST_DEG_S = 0.006
HTTP = (
    "{method} /api/v1/telescope/0/{member} HTTP/1.1\r\nHost: localhost\r\n"
    "Content-Type: application/x-www-form-urlencoded\r\nContent-Length: {length}\r\n\r\n{form}"
)
STOPS = {
    "alpaca": HTTP.format(method="PUT", member="abortslew", length=10, form="ClientID=1").encode(),
    "indi": b'<newSwitchVector device="sattrack" name="TELESCOPE_ABORT_MOTION">'
    b'<oneSwitch name="ABORT">On</oneSwitch></newSwitchVector>\n',
    "lx200": b":Q#",
    "rotctld": b"S\n",
    "antenna": b"STOP 66\n",
}
GREETINGS = {
    "alpaca": b"",
    "indi": b'<getProperties version="1.7"/>\n',
    "lx200": b":GR#",
    "rotctld": b"p\n",
    "antenna": b"PS C3\n",
}


class Client:
    """A program that is connected, and can stop the mount."""

    def __init__(self, protocol: str, port: int) -> None:
        self._stop = STOPS[protocol]
        self.line = socket.create_connection(("127.0.0.1", port), timeout=PATIENCE_S)
        self.line.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        if GREETINGS[protocol]:
            self.line.sendall(GREETINGS[protocol])
            self.line.recv(65536)

    def stop(self, relay: Relay) -> float:
        """Stop the mount; return how long it took to the datagram, ms."""
        relay.stops.clear()
        sent_ns = time.clock_gettime_ns(time.CLOCK_REALTIME)
        self.line.sendall(self._stop)
        until_s = time.monotonic() + PATIENCE_S
        while not relay.stops:
            if time.monotonic() > until_s:
                raise SystemExit(f"no stop came of {self._stop!r}")
            time.sleep(0.01)
        return (relay.stops[0] - sent_ns) / 1e6


def put(line: socket.socket, method: str, member: str, form: str = "ClientID=1") -> dict[str, object]:
    """Ask the Alpaca telescope."""
    length = len(form) if method == "PUT" else 0
    body = form if method == "PUT" else ""
    line.sendall(HTTP.format(method=method, member=member, length=length, form=body).encode())
    answer = b""
    while not answer.endswith(b"}"):
        answer += line.recv(65536)
    told: dict[str, object] = json.loads(answer[answer.index(b"\r\n\r\n") :])
    return told


def until(line: socket.socket, holds: tuple[str, object], *asked: str) -> None:
    """Ask until an answer holds a value."""
    until_s = time.monotonic() + PATIENCE_S
    while put(line, *asked).get(holds[0]) != holds[1]:
        if time.monotonic() > until_s:
            raise SystemExit(f"{asked} never told {holds}")
        time.sleep(0.05)


class Stand:
    """A simulated mount and a relay before it, which hands datagrams on in a thread of its own."""

    def __init__(self, closing: ExitStack, where: str) -> None:
        self.relay = Relay(closing.enter_context(simulated_mount(site=where)).port)
        self.url = f"xerxes://127.0.0.1:{self.relay.front.getsockname()[1]}?listen={free_port()}"
        self._over = threading.Event()
        handing = threading.Thread(target=self._hand_on)
        handing.start()
        closing.callback(handing.join)
        closing.callback(self._over.set)

    def _hand_on(self) -> None:
        while not self._over.is_set():
            self.relay.run_for(0.2)


def settings(folder: Path) -> str:
    path = folder / "radio.toml"
    path.write_text("[safety]\noptical = false\n")
    return str(path)


def of_serve(stops: int) -> dict[str, list[float]]:
    """Return the latencies of `serve alpaca indi lx200 rotctld`, by protocol."""
    found: dict[str, list[float]] = {protocol: [] for protocol in PROTOCOLS}
    with ExitStack() as closing:
        folder = Path(closing.enter_context(tempfile.TemporaryDirectory()))
        stand = Stand(closing, WHERE)
        ports = {protocol: free_port() for protocol in PROTOCOLS}
        others = [f"{protocol}:{port}" for protocol, port in ports.items() if protocol != "alpaca"]
        quiet = {"stdin": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        words = ("--mount", stand.url, "--port", str(ports["alpaca"]), "--json", "--no-discovery")
        where = ("--site", WHERE, "--config", settings(folder))
        server = closing.enter_context(ended(sattrack("serve", "alpaca", *others, *words, *where, **quiet)))
        closing.callback(server.wait)
        closing.callback(server.send_signal, signal.SIGINT)
        assert server.stdout is not None
        server.stdout.readline()
        alpaca = Client("alpaca", ports["alpaca"])
        line = alpaca.line
        # The others answer nothing before the mount is heard.
        until(line, ("ErrorNumber", 0), "PUT", "connect")
        clients = {one: Client(one, port) for one, port in ports.items() if one != "alpaca"}
        clients["alpaca"] = alpaca
        for _ in range(stops):
            for protocol in PROTOCOLS:
                until(line, ("ErrorNumber", 0), "PUT", "moveaxis", "ClientID=1&Axis=1&Rate=0.3")
                time.sleep(WAIT_S)
                found[protocol].append(clients[protocol].stop(stand.relay))
                if protocol == "alpaca":
                    line.recv(65536)
                until(line, ("Value", False), "GET", "slewing")
    return found


def of_antenna(stops: int) -> dict[str, list[float]]:
    """Return the latencies of `serve antenna`."""
    found: list[float] = []
    with ExitStack() as closing:
        folder = Path(closing.enter_context(tempfile.TemporaryDirectory()))
        stand, port = Stand(closing, WHERE), free_port()
        quiet = {"stdin": subprocess.DEVNULL, "stdout": subprocess.DEVNULL}
        words = ("--mount", stand.url, "--port", str(port), "--site", WHERE, "--config", settings(folder))
        server = closing.enter_context(ended(sattrack("serve", "antenna", *words, **quiet)))
        closing.callback(server.communicate)
        closing.callback(server.send_signal, signal.SIGINT)
        assert server.stderr is not None
        if not any("the mount is heard" in line for line in server.stderr):
            raise SystemExit("the mount was not heard")
        client = Client("antenna", port)
        for _ in range(stops):
            first, second = said(client.line, "PS")[3:5]
            said(client.line, f"TD {first} {second} 0 0.3")
            time.sleep(WAIT_S)
            found.append(client.stop(stand.relay))
            client.line.recv(65536)
            while any(abs(float(rate)) > AT_REST_DEG_S for rate in said(client.line, "PS")[7:9]):
                time.sleep(0.05)
    return {"antenna": found}


def said(line: socket.socket, message: str) -> list[str]:
    """Say something on the antenna interface; return the fields of the response, without its check."""
    text = f"{message} "
    line.sendall(f"{text}{sum(text.encode()) % 256:02X}\n".encode())
    answer = b""
    while not answer.endswith(b"\n"):
        answer += line.recv(65536)
    return answer.decode().split()[:-1]


def of_track(runs: int) -> dict[str, list[float]]:
    """Return the latencies of `track --serve`, by protocol."""
    return {protocol: [of_run(protocol) for _ in range(runs)] for protocol in PROTOCOLS}


def of_run(protocol: str) -> float:
    """Return the latency of the stop that ends a run, ms."""
    with ExitStack() as closing:
        folder = Path(closing.enter_context(tempfile.TemporaryDirectory()))
        elements, where = satellite(folder, AHEAD_S)
        stand = Stand(closing, where)
        ports = {one: free_port() for one in PROTOCOLS}
        served = [word for one, port in ports.items() for word in ("--serve", f"{one}:{port}")]
        quiet = {"stdin": subprocess.DEVNULL, "stdout": subprocess.DEVNULL}
        words = ("track", "25544", "--mount", stand.url, "--site", where, "--elements", str(elements))
        run = sattrack(*words, "--headless", "--config", settings(folder), *served, **quiet)
        closing.enter_context(ended(run))
        closing.callback(run.communicate)
        assert run.stderr is not None
        for _ in PROTOCOLS:
            if not any("clients see the run" in line for line in run.stderr):
                raise SystemExit("the run was not served")
        with socket.create_connection(("127.0.0.1", ports["alpaca"]), timeout=PATIENCE_S) as line:
            until(line, ("ErrorNumber", 0), "PUT", "connect")
            until(line, ("Value", False), "GET", "slewing")
            return Client(protocol, ports[protocol]).stop(stand.relay)


def report(title: str, found: dict[str, list[float]]) -> None:
    """Print percentiles."""
    print(f"{title:<34}median     p90    most")
    for protocol, latencies_ms in found.items():
        ordered = sorted(latencies_ms)
        figures = [quantile(ordered, part) for part in (0.5, 0.9)]
        count = f"of {len(ordered)}"
        print(f"  {protocol:<30}{figures[0]:6.1f}  {figures[1]:6.1f}  {ordered[-1]:6.1f} ms, {count}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--stops", type=int, default=25)
    parser.add_argument("--runs", type=int, default=5)
    options = parser.parse_args()
    if options.stops:
        report("serve, client to datagram", of_serve(options.stops) | of_antenna(options.stops))
    if options.runs:
        report("track --serve, client to datagram", of_track(options.runs))
    print(f"with a load of {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors")


if __name__ == "__main__":
    main()
