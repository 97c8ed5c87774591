"""docs/safety.md against the tables that it is written from, and its settings."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from sattrack.safety import INTERLOCKS, SafetyLimits

if TYPE_CHECKING:
    from tool_runs import Tool

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "safety.md"


def test_the_page_says_what_the_tables_do(tool: Tool, tmp_path: Path) -> None:
    assert tool("safety", "--check").returncode == 0
    text = PAGE.read_text(encoding="utf-8")
    table = text.partition("BEGIN interlocks")[2].partition("END interlocks")[0]
    assert all(table.count(f"| `{row.name}` |") == 1 for row in INTERLOCKS)
    folder = tmp_path / "docs"
    folder.mkdir()
    (folder / PAGE.name).write_text(text.replace("| 2.4 s / 3.0 s |", "| 9 s |", 1), encoding="utf-8")
    spoilt = tool("safety", "--check", "--root", str(tmp_path))
    assert spoilt.returncode == 1
    assert "run python -m tools.safety" in spoilt.stderr


def test_the_contract_is_the_one_of_the_page_on_lost_links() -> None:
    def contract(name: str) -> str:
        text = (ROOT / "docs" / name).read_text(encoding="utf-8")
        return text.partition("BEGIN contract")[2].partition("-->")[2].partition("<!-- END contract")[0]

    assert contract("safety.md") == contract("link-loss.md")
    assert "forever" in contract("safety.md")


def test_the_cone_of_settings_is_the_one_in_force() -> None:
    """Its default depends on the optics, so that the table is not written from the field alone."""
    text = (ROOT / "docs" / "settings.md").read_text(encoding="utf-8")
    row = next(line for line in text.splitlines() if line.startswith("| `safety.sun_cone_deg` |"))
    assert row.endswith(f"; {SafetyLimits().sun_deg:g} with optics |")
