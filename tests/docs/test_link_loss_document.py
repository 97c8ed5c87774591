"""docs/link-loss.md against the contract that it is written from."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from sattrack.mount.link_loss import CONTRACT

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "link-loss.md"


def check(root: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "tools.link_loss", "--check", "--root", str(root)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )


def test_the_page_says_what_the_contract_does(tmp_path: Path) -> None:
    assert check(ROOT).returncode == 0
    text = PAGE.read_text(encoding="utf-8")
    assert text.count("**never**") == sum(row.during_s is None for row in CONTRACT)
    folder = tmp_path / "docs"
    folder.mkdir()
    (folder / PAGE.name).write_text(text.replace("**never**", "2 s", 1), encoding="utf-8")
    spoilt = check(tmp_path)
    assert spoilt.returncode == 1
    assert "run python -m tools.link_loss" in spoilt.stderr


def test_every_row_has_a_way_out_and_all_that_ends_by_itself_says_when() -> None:
    assert len({row.key for row in CONTRACT}) == len(CONTRACT)
    for row in CONTRACT:
        assert row.way_out
        assert not (row.by_watchdog and row.watchdog is not True)
        # What a watchdog ends, only a watchdog ends.
        assert (row.during_s is None) <= ("forever" in row.mounts or "until" in row.mounts)
