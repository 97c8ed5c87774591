"""A mount that is there without a run: followed with, then moved by hand from the same screen, and left."""

from __future__ import annotations

from typing import TYPE_CHECKING

from programs import satellite, simulated_mount
from test_in_tmux import in_tmux
from test_in_tmux import pytestmark as pytestmark  # noqa: PLC0414 - not without tmux

if TYPE_CHECKING:
    from pathlib import Path


def test_after_a_run_the_mount_is_moved_by_hand_and_left_at_rest(tmp_path: Path) -> None:
    elements, where = satellite(tmp_path, culminates_after_s=150.0)
    settings = tmp_path / "sattrack.toml"
    # By day, the Sun may stand where the satellite comes by.
    settings.write_text("[safety]\noptical = false\n")
    run = ("track", "25544", "--elements", str(elements), "--site", where, "--config", str(settings))
    with simulated_mount(site=where) as mount, in_tmux(*run, "--mount", f"'{mount.url}'") as pane:
        pane.wait_for("SPACE STOP", "rate")
        pane.press("Space")
        pane.wait_for("STOPPED", "the mount is at rest")
        pane.press("3")
        pane.wait_for("j operates the mount by hand")
        pane.press("j")
        pane.wait_for("AT REST", "nothing asked yet")
        before_deg, told = mount.truths[-1]["dec_deg"], len(mount.truths)
        pane.press("3", "Down", "Down", "Down")
        # Where nobody comes to look at once, the jog is over by then.
        mount.wait_until_faster(0.05, since=told)
        pane.press("Space")
        mount.wait_until_moving(False)
        pane.wait_for("AT REST")
        moved_deg = mount.truths[-1]["dec_deg"] - before_deg
        assert -1.0 < moved_deg < -0.001, "southward at 0.1 °/s, until the stop came"
        pane.press("q")
        pane.wait_for("STOPPED", "j operates the mount by hand")
        pane.press("q")
        pane.wait_for("ended by operator", "left with 0")
        assert mount.truths[-1]["dec_rate_deg_s"] == 0.0
        assert abs(mount.truths[-1]["dec_deg"] - before_deg - moved_deg) < 1e-3
