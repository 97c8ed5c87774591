"""What a feeder and its gallery tell one another: one packet each, over a pair of sockets."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Literal

import msgspec

PREFIX = "sattrack-run/"
"""Of the name, in Linux's abstract namespace, at which a run's gallery is found; its process follows."""
FACTS, VIEW, SESSION, SUMMARY = b"F", b"V", b"C", b"E"
"""What a packet for the gallery begins with; the rest is one JSON object."""
SUPPORTED = sys.platform.startswith("linux")


class GalleryTask(msgspec.Struct, frozen=True):
    """What a gallery is told at first: its descriptors, and whose run it shows."""

    door: int
    user: int
    pid: int
    command: str
    since_utc: str
    mount: str
    name: str


class Heard(msgspec.Struct, frozen=True, array_like=True):
    """What somebody did who looks on: came (`text` is a name), went, or said a line."""

    number: int
    what: Literal["came", "gone", "said"]
    text: str = ""


def name_for(pid: int) -> str:
    """Return the socket's name of a feeder's gallery."""
    return f"\0{PREFIX}{pid}"


def feeders() -> list[int]:
    """Return the processes on this machine whose runs can be looked at, as the kernel lists their names."""
    try:
        table = Path("/proc/net/unix").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return []
    words = (line.rpartition(" ")[2] for line in table.splitlines())
    ends = {word.removeprefix(f"@{PREFIX}") for word in words if word.startswith(f"@{PREFIX}")}
    return sorted(int(end) for end in ends if end.isdecimal())


def started_by(pid: int) -> int | None:
    """Return the process that started another one, and is there yet; None where that is not to be known."""
    try:
        # The program's name, in brackets, may hold anything.
        words = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8", errors="replace").rpartition(")")[2]
    except OSError:
        return None
    return int(words.split()[1])
