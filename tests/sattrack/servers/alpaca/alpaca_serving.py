"""`sattrack serve alpaca` as a program."""

from __future__ import annotations

import json
import socket
import tempfile
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from serving import serving_program

if TYPE_CHECKING:
    from collections.abc import Iterator

    from serving import Served

PROFILE = """
name = "bench mount"
park = { hour_angle_deg = 50.0, dec_deg = 10.0 }
home = { hour_angle_deg = 48.0, dec_deg = 12.0 }
"""


def http_process(served: Served) -> int:
    """Return the number of the process that clients talk to."""
    pid = served.process.pid
    children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    for child in children:
        if b"servers.alpaca.process" in Path(f"/proc/{child}/cmdline").read_bytes():
            return int(child)
    raise AssertionError(f"none of {children} serves HTTP")


@contextmanager
def serving(*options: str, discovery: bool = False) -> Iterator[Served]:
    """Serve a simulated mount with a place to park and one that is home."""
    with tempfile.TemporaryDirectory() as folder:
        profile = Path(folder) / "mount.toml"
        profile.write_text(PROFILE)
        quiet = [] if discovery else ["--no-discovery"]
        with serving_program("alpaca", "--profile", str(profile), *quiet, *options) as served:
            yield served


def request(method: str, target: str, body: bytes = b"", headers: str = "") -> bytes:
    """Return a request in the wire's own bytes."""
    head = f"{method} {target} HTTP/1.1\r\nHost: localhost\r\n{headers}"
    if body:
        head += f"Content-Type: application/x-www-form-urlencoded\r\nContent-Length: {len(body)}\r\n"
    return head.encode() + b"\r\n" + body


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
