"""docs/link-loss.md against the contract that it is written from."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from sattrack.mount.link_loss import CONTRACT

if TYPE_CHECKING:
    from tool_runs import Tool

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "link-loss.md"


def test_the_page_says_what_the_contract_does(tool: Tool, tmp_path: Path) -> None:
    assert tool("link_loss", "--check").returncode == 0
    text = PAGE.read_text(encoding="utf-8")
    assert text.count("**never**") == sum(row.during_s is None for row in CONTRACT)
    folder = tmp_path / "docs"
    folder.mkdir()
    (folder / PAGE.name).write_text(text.replace("**never**", "2 s", 1), encoding="utf-8")
    spoilt = tool("link_loss", "--check", "--root", str(tmp_path))
    assert spoilt.returncode == 1
    assert "run python -m tools.link_loss" in spoilt.stderr


def test_every_row_has_a_way_out_and_all_that_ends_by_itself_says_when() -> None:
    assert len({row.key for row in CONTRACT}) == len(CONTRACT)
    for row in CONTRACT:
        assert row.way_out
        assert not (row.by_watchdog and row.watchdog is not True)
        # What a watchdog ends, only a watchdog ends.
        assert (row.during_s is None) <= ("forever" in row.mounts or "until" in row.mounts)
