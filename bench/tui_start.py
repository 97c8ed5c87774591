"""How long `sattrack --help` takes, and the first screen of `sattrack track ISS`, beside the least possible.

python bench/tui_start.py [PAIRS]

The least are Python with click imported, and Textual's hello-world. Both screens run on a pseudo-terminal of
120 x 40, one after the other, again and again: from the start of the process to the last character of the
first screen, each time, and the differences of the pairs. The run has a simulated mount in a process of its
own, which is started as well.
"""

from __future__ import annotations

import fcntl
import os
import pty
import select
import statistics
import struct
import subprocess
import sys
import termios
import time

HELLO = """
from textual.app import App
from textual.widgets import Static
class Hello(App):
    def compose(self):
        yield Static("hello, world")
Hello().run()
"""
HELLO_COMMAND = [sys.executable, "-c", HELLO]
RUN_COMMAND = [sys.executable, "-m", "sattrack", "track", "ISS", "--mount", "sim"]
CLICK_COMMAND = [sys.executable, "-c", "import click"]
HELP_COMMAND = [sys.executable, "-c", "from sattrack.cli.main import main; main(['--help'])"]
COLUMNS, ROWS = 120, 40
PATIENCE_S = 60.0


def main() -> None:
    pairs = int(sys.argv[1]) if len(sys.argv) > 1 else 10
    bare, helped = zip(*((run_s(CLICK_COMMAND), run_s(HELP_COMMAND)) for _ in range(pairs)), strict=True)
    ratio = statistics.median(b / a for a, b in zip(bare, helped, strict=True))
    print(f"--help: {statistics.median(helped):.3f} s, {ratio:.2f} times Python with click (medians)")
    hello, run, data = [], [], []
    for number in range(pairs):
        order = (HELLO_COMMAND, RUN_COMMAND) if number % 2 else (RUN_COMMAND, HELLO_COMMAND)
        took_s = {tuple(command): seen_s(command) for command in order}
        hello.append(took_s[tuple(HELLO_COMMAND)][0])
        run.append(took_s[tuple(RUN_COMMAND)][0])
        data.append(took_s[tuple(RUN_COMMAND)][1])
    more = sorted(b - a for a, b in zip(hello, run, strict=True))
    print(f"{pairs} pairs, {os.cpu_count()} CPUs, load {os.getloadavg()[0]:.1f}")
    print(
        f"hello-world: {statistics.median(hello):.2f} s; track ISS: {statistics.median(run):.2f} s (medians)"
    )
    ratio = statistics.median(b / a for a, b in zip(hello, data, strict=True))
    print(f"first data: {statistics.median(data):.2f} s, {ratio:.1f} times hello-world (medians)")
    print(f"longer by {more[0]:.2f} to {more[-1]:.2f} s, median {statistics.median(more):.2f} s")


def run_s(command: list[str]) -> float:
    """Return how long a program takes from its start to its end."""
    begun_s = time.monotonic()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return time.monotonic() - begun_s


def seen_s(command: list[str]) -> list[float]:
    """Return how long it takes from the start of a program to its first whole screen, and to data in it."""
    marks = [b"hello, world"] if command is HELLO_COMMAND else [b" help", b"ISS (ZARYA)"]
    child, terminal = pty.fork()
    if child == 0:
        os.environ["TERM"] = "xterm-256color"
        fcntl.ioctl(0, termios.TIOCSWINSZ, struct.pack("HHHH", ROWS, COLUMNS, 0, 0))
        os.execv(command[0], command)
    begun_s, drawn = time.monotonic(), b""
    seen = []
    try:
        for mark in marks:
            while mark not in drawn:
                more = read(terminal, PATIENCE_S)
                if not more:
                    raise SystemExit(f"no screen came: {drawn[-500:]!r}")
                drawn += more
            seen.append(time.monotonic() - begun_s)
        return seen
    finally:
        os.write(terminal, b"\x03" if command is RUN_COMMAND else b"\x11")
        while read(terminal, 15.0):
            pass
        os.close(terminal)
        os.waitpid(child, 0)


def read(terminal: int, patience_s: float) -> bytes:
    if not select.select([terminal], [], [], patience_s)[0]:
        return b""
    try:
        return os.read(terminal, 65536)
    except OSError:
        # Linux says so when the other end of a pseudo-terminal has closed.
        return b""


if __name__ == "__main__":
    main()
