"""The real program on a pseudo-terminal, from its first screen to the shell."""

from __future__ import annotations

import fcntl
import os
import pty
import select
import struct
import subprocess
import sys
import termios
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import pytest

from sattrack.cli.main import run

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

PATIENCE_S = 60.0
COLUMNS, ROWS = 80, 24


@dataclass
class Terminal:
    """A program on a terminal of its own: what it has drawn so far, and its keyboard."""

    process: subprocess.Popen[bytes]
    descriptor: int
    drawn: bytes = field(default=b"")

    def wait_for(self, *texts: bytes) -> None:
        """Read until each text has been drawn since the last call."""
        while not all(text in self.drawn for text in texts):
            ready, _, _ = select.select([self.descriptor], [], [], PATIENCE_S)
            assert ready, f"nothing more came; {texts} missing in {self.drawn[-2000:]!r}"
            chunk = self._read()
            assert chunk, f"the program ended; {texts} missing in {self.drawn[-2000:]!r}"
            self.drawn += chunk
        self.drawn = b""

    def type(self, keys: bytes) -> None:
        os.write(self.descriptor, keys)

    def finish(self) -> tuple[int, str]:
        """Read to the end; return the exit code and what was drawn."""
        while chunk := self._read():
            self.drawn += chunk
        return self.process.wait(PATIENCE_S), self.drawn.decode(errors="replace")

    def _read(self) -> bytes:
        try:
            return os.read(self.descriptor, 65536)
        except OSError:
            # Linux says so when the other end of a pseudo-terminal has closed.
            return b""


@pytest.fixture
def demo():
    with on_terminal("demo") as terminal:
        yield terminal


@contextmanager
def on_terminal(*arguments: str) -> Iterator[Terminal]:
    """Run the program with these arguments on a terminal of its own."""
    controller, terminal = pty.openpty()
    fcntl.ioctl(terminal, termios.TIOCSWINSZ, struct.pack("HHHH", ROWS, COLUMNS, 0, 0))
    process = subprocess.Popen(
        [sys.executable, "-m", "sattrack", *arguments],
        stdin=terminal,
        stdout=terminal,
        stderr=terminal,
        env={**os.environ, "TERM": "xterm-256color"},
        start_new_session=True,
    )
    os.close(terminal)
    yield Terminal(process, controller)
    if process.poll() is None:
        process.kill()
        process.wait()
    os.close(controller)


def test_the_demonstration_is_watched_nudged_stopped_and_left(demo: Terminal) -> None:
    demo.wait_for(b"SLEWING", b"SPACE STOP", b"rise", b"Sun", b"expect")
    demo.type(b"\x1b[C")
    demo.wait_for(b"+0.100")
    demo.type(b" ")
    demo.wait_for(b"by the operator; the mount is at rest")
    demo.type(b"q")
    code, drawn = demo.finish()

    assert code == 0
    assert "ended by operator" in drawn
    assert "bias +0.100 s along" in drawn


def test_a_signal_to_end_leaves_cleanly_and_stops_the_mount(demo: Terminal) -> None:
    demo.wait_for(b"SPACE STOP")
    demo.process.terminate()
    code, drawn = demo.finish()

    assert code == 0
    assert "ended by operator" in drawn


def test_a_recording_is_watched_wound_to_its_end_and_left(tmp_path: Path) -> None:
    short = tmp_path / "short.mcap"
    high = ("--min-alt", "80.5", "--clock", "2026-10-02T13:04:50Z")
    assert run(["track", "ISS", "--mount", "sim", "--virtual", *high, "--record", str(short)]) == 0
    with on_terminal("replay", str(short), "--tui", "--speed", "100", "--theme", "red", "--ascii") as replay:
        replay.wait_for(b"short.mcap", b"begun", b"END", b"the pass is over")
        # A step back stands still: at this speed, a busy machine might not draw the beginning at all.
        replay.type(b",")
        replay.wait_for(b"PAUSED")
        replay.type(b"\x1b[H")
        replay.wait_for(b"WAITING")
        replay.type(b"q")
        code, drawn = replay.finish()

    assert code == 0
    assert "ended by set" in drawn
    assert "make sure that the mount is at rest" not in drawn
