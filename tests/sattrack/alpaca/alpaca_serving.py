"""`sattrack serve alpaca` as a program."""

from __future__ import annotations

import json
import queue
import select
import signal
import socket
import subprocess
import sys
import tempfile
import threading
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from sattrack import practice

if TYPE_CHECKING:
    from collections.abc import Iterator

PATIENCE_S = 60.0
SITE = practice.SITE.place()
WHERE = f"{SITE.latitude_deg},{SITE.longitude_deg},0"
PROFILE = """
name = "bench mount"
park = { hour_angle_deg = 50.0, dec_deg = 10.0 }
home = { hour_angle_deg = 48.0, dec_deg = 12.0 }
"""


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

    def http_process(self) -> int:
        """Return the number of the process that clients talk to."""
        children = Path(f"/proc/{self.process.pid}/task/{self.process.pid}/children").read_text().split()
        for child in children:
            if b"alpaca_process" in Path(f"/proc/{child}/cmdline").read_bytes():
                return int(child)
        raise AssertionError(f"none of {children} serves HTTP")

    def _read(self) -> None:
        assert self.process.stderr is not None
        for line in self.process.stderr:
            self.log.append(line)
            self._lines.put(line)


@contextmanager
def serving(*options: str, discovery: bool = False) -> Iterator[Served]:
    """Serve a simulated mount until the end, once it is heard.

    The antenna is that of a radio dish, so that tests pass wherever the Sun stands when they run.
    """
    with tempfile.TemporaryDirectory() as folder:
        settings, profile = Path(folder) / "radio.toml", Path(folder) / "mount.toml"
        settings.write_text("[safety]\noptical = false\n")
        profile.write_text(PROFILE)
        command = [sys.executable, "-m", "sattrack", "serve", "alpaca", "--mount", "sim", "--site", WHERE]
        command += ["--json", "--port", "0", "--config", str(settings), "--profile", str(profile)]
        command += [] if discovery else ["--no-discovery"]
        process = subprocess.Popen(
            [*command, *options],
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


def request(method: str, target: str, body: bytes = b"", headers: str = "") -> bytes:
    """Return a request in the wire's own bytes."""
    head = f"{method} {target} HTTP/1.1\r\nHost: x\r\n{headers}"
    if body:
        head += f"Content-Type: application/x-www-form-urlencoded\r\nContent-Length: {len(body)}\r\n"
    return head.encode() + b"\r\n" + body


def call(port: int, host: str = "127.0.0.1") -> socket.socket:
    """Return a connection."""
    line = socket.create_connection((host, port), timeout=PATIENCE_S)
    line.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return line


def read_answer(line: socket.socket) -> tuple[int, bytes]:
    """Return the status and the body of the next answer, and leave what comes after it."""
    head = b""
    while b"\r\n\r\n" not in head:
        seen = line.recv(65536, socket.MSG_PEEK)
        assert seen, f"hung up on after {head!r}"
        end = (head + seen).find(b"\r\n\r\n")
        head += line.recv(len(seen) if end < 0 else end + 4 - len(head))
    status = int(head.split()[1])
    length = next(
        int(one.split(b":")[1]) for one in head.split(b"\r\n") if one.lower().startswith(b"content-length")
    )
    body = b""
    while len(body) < length:
        body += line.recv(length - len(body))
    return status, body


def say(line: socket.socket, method: str, member: str, words: str = "") -> dict[str, object]:
    """Ask the telescope; return what its answer says."""
    target = f"/api/v1/telescope/0/{member}"
    if method == "GET":
        line.sendall(request("GET", f"{target}?{words}"))
    else:
        line.sendall(request("PUT", target, words.encode() or b"ClientID=1"))
    status, body = read_answer(line)
    assert status == 200, body
    told: dict[str, object] = json.loads(body)
    return told
