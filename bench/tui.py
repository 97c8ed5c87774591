"""What the terminal's screen takes of one core while the demonstration is followed, and the feeder beside it.

python bench/tui.py [SECONDS [COLUMNSxROWS ...]]

Each run is `sattrack demo` on a pseudo-terminal of that size, from the first moment of tracking on. The
screen is a process of its own: its share is the processor's time that it used, by the time on the clock. The
feeder's is that of the process beside it. Linux (/proc).
"""

from __future__ import annotations

import fcntl
import os
import pty
import select
import struct
import sys
import termios
import time
from pathlib import Path

SIZES = ("80x24", "120x40", "200x60")
PATIENCE_S = 60.0
TICKS = os.sysconf("SC_CLK_TCK")


def main() -> None:
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 20.0
    for size in sys.argv[2:] or SIZES:
        columns, rows = (int(part) for part in size.split("x"))
        screen, feeder, sent = measured(columns, rows, seconds)
        kilobytes = sent / seconds / 1000.0
        print(f"{size}: screen {screen:.1%} of a core, feeder {feeder:.1%}, {kilobytes:.0f} kB/s drawn")


def measured(columns: int, rows: int, seconds: float) -> tuple[float, float, float]:
    """Return the shares of a core of screen and feeder, and the bytes that were drawn."""
    child, terminal = pty.fork()
    if child == 0:
        os.environ["TERM"] = "xterm-256color"
        os.environ["COLORTERM"] = "truecolor"
        os.execv(sys.executable, [sys.executable, "-m", "sattrack", "demo"])
    fcntl.ioctl(terminal, termios.TIOCSWINSZ, struct.pack("HHHH", rows, columns, 0, 0))
    try:
        read_until(terminal, b"all is well")
        begun_s, own, others = time.monotonic(), used_s(child), used_by_children_s(child)
        sent = 0
        while time.monotonic() - begun_s < seconds:
            sent += len(read(terminal, 0.2))
        took_s = time.monotonic() - begun_s
        return (used_s(child) - own) / took_s, (used_by_children_s(child) - others) / took_s, sent
    finally:
        os.write(terminal, b"\x03")
        while read(terminal, 10.0):
            pass
        os.close(terminal)
        os.waitpid(child, 0)


def read_until(terminal: int, text: bytes) -> None:
    drawn = b""
    begun_s = time.monotonic()
    while text not in drawn:
        if time.monotonic() - begun_s > PATIENCE_S:
            raise SystemExit(f"{text!r} did not come: {drawn[-500:]!r}")
        drawn += read(terminal, 1.0)


def read(terminal: int, patience_s: float) -> bytes:
    ready, _, _ = select.select([terminal], [], [], patience_s)
    if not ready:
        return b""
    try:
        return os.read(terminal, 65536)
    except OSError:
        # Linux says so when the other end of a pseudo-terminal has closed.
        return b""


def used_s(process: int) -> float:
    """Return the processor's time that a process has used, all its threads."""
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / TICKS


def used_by_children_s(process: int) -> float:
    """Return that of the first of its children, which feeds the mount."""
    children = [
        int(stat.parent.name)
        for stat in Path("/proc").glob("[0-9]*/stat")
        if int(stat.read_text().rpartition(")")[2].split()[1]) == process
    ]
    return used_s(min(children))


if __name__ == "__main__":
    main()
