"""From the first screen to the shell, with a terminal multiplexer between: arm, track, nudge, stop."""

from __future__ import annotations

import os
import select
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from programs import satellite, simulated_mount

if TYPE_CHECKING:
    from collections.abc import Iterator

pytestmark = pytest.mark.needs("tmux")
PATIENCE_S = 60.0
LOOK_EVERY_S = 0.1
RUN = ("track", "ISS", "--mount", "sim", "--clock", "2026-10-02T13:01:50Z")


class Pane:
    """One program in a session of tmux of its own."""

    def __init__(self, socket: str) -> None:
        self._socket = socket

    def tmux(self, *arguments: str) -> str:
        command = ["tmux", "-L", self._socket, "-f", "/dev/null", *arguments]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout

    def press(self, *keys: str) -> None:
        self.tmux("send-keys", *keys)

    def wait_for(self, *texts: str) -> str:
        """Look at the screen until each text stands on it."""
        until_s = time.monotonic() + PATIENCE_S
        while True:
            shown = self.tmux("capture-pane", "-p")
            if all(text in shown for text in texts):
                return shown
            assert time.monotonic() < until_s, f"{texts} did not come:\n{shown}"
            select.select([], [], [], LOOK_EVERY_S)


@contextmanager
def in_tmux(*arguments: str) -> Iterator[Pane]:
    socket = f"sattrack-test-{os.getpid()}"
    pane = Pane(socket)
    program = " ".join([sys.executable, "-m", "sattrack", *arguments])
    pane.tmux("new-session", "-d", "-x", "80", "-y", "24", f"{program}; echo left with $?; cat")
    try:
        yield pane
    finally:
        subprocess.run(["tmux", "-L", socket, "kill-server"], check=False, capture_output=True)


def test_a_pass_is_armed_another_tracked_nudged_and_stopped() -> None:
    with in_tmux(*RUN) as pane:
        pane.wait_for("SPACE STOP")
        pane.press("2")
        pane.wait_for("passes to come", "this one", "14:38:49")
        pane.press("Down")
        pane.wait_for("▶ 14:38:49")
        pane.press("Enter")
        pane.wait_for("armed 1")
        pane.press("1")
        pane.wait_for("TRACKING", "all is well")
        pane.press("Right")
        pane.wait_for("asked +0.100 s")
        pane.press("S-Left")
        pane.wait_for("asked −0.9")
        pane.press("5")
        pane.wait_for("armed ISS (ZARYA)", "ISS (ZARYA): tracking")
        pane.press("Space")
        pane.wait_for("STOPPED", "by the operator; the mount is at rest")
        pane.press("q")
        pane.wait_for("ended by operator", "left with 0")


def test_a_pass_is_paused_jogged_gone_on_with_and_the_mount_parked(tmp_path: Path) -> None:
    """A mount of its own, whose axes tell where they are; the Sun counts for nothing, by day or night."""
    profile = Path(__file__).parents[3] / "examples" / "profiles" / "realistic.toml"
    settings = tmp_path / "sattrack.toml"
    settings.write_text("[safety]\noptical = false\n")
    elements, site = satellite(tmp_path, 120.0)
    with simulated_mount("--profile", str(profile), site=site) as mount:
        where = ("--site", site, "--config", str(settings), "--profile", str(profile))
        run = ("track", "25544", "--elements", str(elements), "--mount", f"'{mount.url}'", *where)
        with in_tmux(*run) as pane:
            pane.wait_for("TRACKING", "all is well")
            pane.press("p")
            pane.wait_for("PAUSED", "the mount is at rest; the pass lasts")
            stood = mount.truths[-1]
            pane.press("3", "]")
            pane.wait_for("jog ↑N", "[0.1]")
            stands = mount.truths[-1]["hour_angle_axis_deg"]
            assert stands == pytest.approx(stood["hour_angle_axis_deg"], abs=0.001)
            pane.press("Down")
            # A jog may be over before anybody looks: what tells it is where the axis is then.
            until_s = time.monotonic() + PATIENCE_S
            while abs(mount.truths[-1]["dec_axis_deg"] - stood["dec_axis_deg"]) < 0.03:
                assert time.monotonic() < until_s, "the axis did not move"
                select.select([], [], [], LOOK_EVERY_S)
            pane.wait_for("the mount is at rest")
            jogged_deg = abs(mount.truths[-1]["dec_axis_deg"] - stood["dec_axis_deg"])
            assert jogged_deg == pytest.approx(0.05, abs=0.025)
            pane.press("1", "Enter")
            pane.wait_for("TRACKING", "all is well")
            pane.press("P")
            pane.wait_for("park?", "The run ends", "y does it")
            pane.press("y")
            pane.wait_for("PARKED", "the drives have no power")
            pane.press("q")
            pane.wait_for("STOPPED", "by the operator; the mount is at rest")
            pane.press("q")
            pane.wait_for("ended by operator", "paused for", "left with 0")
        parked = mount.last_truth()
    assert parked["dec_axis_deg"] == pytest.approx(30.0, abs=0.3)
    assert parked["hour_angle_axis_deg"] == pytest.approx(0.0, abs=0.3)
