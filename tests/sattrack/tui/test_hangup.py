"""A terminal that vanishes without a signal ends the run: nobody is at the stop key any more."""

from __future__ import annotations

import os
import pty
import select
import subprocess
import sys
from typing import TYPE_CHECKING

import pytest

from sattrack.tui.launch import HUNG_UP

if TYPE_CHECKING:
    from pathlib import Path

FEEDER = """
import pathlib, sys
print("not a view", flush=True)
sys.stdin.read()
pathlib.Path(sys.argv[1]).write_text("stopped")
"""
SCREEN = """
import sys, threading
from {module} import {launch}
def stuck(*_):
    threading.Event().wait()
from sattrack.tui.feeds import FeederProcess
FeederProcess.wait_first_view = lambda self: True
print("watched", flush=True)
{launch}([sys.executable, "-c", {feeder!r}, sys.argv[1]], {also})
"""


@pytest.mark.parametrize(
    ("module", "launch", "also"),
    [
        ("sattrack.tui.launch", "fly_with_tui", "show=stuck, patience_s=20.0"),
        ("sattrack.tui.launch", "watch_with_tui", "show=stuck, patience_s=20.0"),
        ("sattrack.tui.launch", "replay_with_tui", "None, 1.0, show=stuck"),
    ],
    ids=["track", "console", "replay"],
)
def test_a_screen_that_waits_for_ever_ends_with_its_terminal_and_the_mount_is_stopped(
    module: str, launch: str, also: str, tmp_path: Path
) -> None:
    controller, terminal = pty.openpty()
    told = tmp_path / "told"
    script = SCREEN.format(module=module, launch=launch, feeder=FEEDER, also=also)
    process = subprocess.Popen(
        [sys.executable, "-c", script, str(told)],
        stdin=terminal,
        stdout=terminal,
        stderr=terminal,
        start_new_session=True,
    )
    os.close(terminal)
    try:
        drawn = b""
        while b"watched\r\n" not in drawn:
            drawn += os.read(controller, 1000)
        os.close(controller)
        assert process.wait(60.0) == HUNG_UP
    finally:
        process.kill()
        process.wait()
    assert told.read_text() == "stopped"


STARTER = """
import subprocess
from sattrack.core.process import ending_with_us, self_command
command = [*self_command(), "sim", "--port", "0"]
started = subprocess.Popen(command, env=ending_with_us(), start_new_session=True)
print("started", flush=True)
started.wait()
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="Linux's kernel does it")
def test_a_program_ends_with_the_screen_that_started_it_also_when_that_is_killed() -> None:
    with subprocess.Popen([sys.executable, "-c", STARTER], stdout=subprocess.PIPE) as screen:
        assert screen.stdout is not None
        assert screen.stdout.readline() == b"started\n"
        screen.kill()
        # The simulated mount would go on forever; it holds the pipe's other end as long as it lives.
        assert select.select([screen.stdout], [], [], 60.0)[0]
        screen.stdout.read()
