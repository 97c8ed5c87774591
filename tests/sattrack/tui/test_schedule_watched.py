"""A schedule that runs, looked at from another terminal: from pass to pass, and stopped between two."""

from __future__ import annotations

import json
import subprocess
import sys
from typing import TYPE_CHECKING, Any

import pytest
from test_in_tmux import in_tmux
from test_in_tmux import pytestmark as in_tmux_only

from sattrack.runtime import demo_pass
from sattrack.runtime.view_server import SUPPORTED, feeders, started_by
from tle.sources import write_elements

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = [in_tmux_only, pytest.mark.skipif(not SUPPORTED, reason="abstract names are Linux's")]
SCHEDULE = """\
park_at_end = false
[defaults]
if_sun_up = "run"
settle_s = 0
[[fixed]]
satellite = "25544"
start = 2026-10-02T13:02:06Z
end = 2026-10-02T13:02:11Z
[[fixed]]
satellite = "25544"
start = 2026-10-02T13:07:10Z
end = 2026-10-02T13:07:15Z
"""


def test_a_schedule_is_watched_from_pass_to_pass_and_stopped_between_them(tmp_path: Path) -> None:
    (tmp_path / "night.toml").write_text(SCHEDULE)
    (tmp_path / "iss.json").write_text(write_elements([demo_pass.elements()], "json"))
    options = ("--mount", "sim", "--elements", "iss.json", "--site", "52.1541,4.4908,0", "--json")
    runner = subprocess.Popen(
        [sys.executable, "-m", "sattrack", "run", "night.toml", *options, "--clock", "2026-10-02T13:01:58Z"],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    try:
        assert runner.stdout is not None
        said: list[dict[str, Any]] = []
        for line in runner.stdout:
            said.append(json.loads(line))
            if "alt" in said[-1]["doing"]:
                break
        (run,) = [pid for pid in feeders() if started_by(pid) == runner.pid]
        with in_tmux("attach", "--run", str(run)) as pane:
            pane.wait_for("LOOKING ON")
            pane.press("4")
            pane.wait_for("FOLLOWING", "0 of 2 done", "next in 5:", "▶ 13:02:06")
            # On a busy machine, a second of a pass as short as this may be missed.
            pane.wait_for("ENDED", "WAITING  for 2, ISS (ZARYA)", "next in 4:", "▶ 13:07:10", "″")
            pane.press("Space")
            pane.wait_for("STOPPED  by an operator; sattrack run ")
            pane.press("q")
            pane.wait_for("ended by set", "left with 0")
        said += [json.loads(line) for line in runner.stdout]
        assert runner.wait(60) == 130
    finally:
        runner.kill()
        runner.communicate()
    first, second = said[-1]["passes"]
    assert first["on_target_s"] > 2.0
    assert (said[-1]["state"], second["state"]) == ("stopped", "waiting")
