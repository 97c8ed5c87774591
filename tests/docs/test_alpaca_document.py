"""docs/alpaca.md against the table that it is written from, the actions, and the program's own limits."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

from sattrack.servers.alpaca.connections import MOST_WAITING, REQUEST_WITHIN_S
from sattrack.servers.alpaca.process import MOST_BODY_BYTES, MOST_LINE_BYTES
from sattrack.servers.alpaca.protocol import ACTIONS, MEMBERS, Number, read_action

if TYPE_CHECKING:
    from tool_runs import Tool

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "alpaca.md"


def test_the_page_has_every_member_and_is_what_the_table_says(tool: Tool, tmp_path: Path) -> None:
    assert tool("alpaca", "--check").returncode == 0
    text = PAGE.read_text(encoding="utf-8")
    assert all(text.count(f"\n| `{member.name}` | ") == 1 for member in MEMBERS)
    folder = tmp_path / "docs"
    folder.mkdir()
    (folder / PAGE.name).write_text(text.replace("| `Park` |", "| `Pork` |", 1), encoding="utf-8")
    spoilt = tool("alpaca", "--check", "--root", str(tmp_path))
    assert spoilt.returncode == 1
    assert "run python -m tools.alpaca" in spoilt.stderr


def test_the_page_has_every_action_with_parameters_that_are_understood() -> None:
    rows = re.findall(r"^\| `(\w+)` \| `(\{.*?\})` \|", PAGE.read_text(encoding="utf-8"), re.MULTILINE)
    assert [name for name, _ in rows] == list(ACTIONS)
    for name, parameters in rows:
        read_action(name, parameters)


def test_the_page_has_every_error_number_and_the_limits_in_force() -> None:
    text = " ".join(PAGE.read_text(encoding="utf-8").split())
    for number in Number:
        if number is not Number.OK:
            assert f"| 0x{number:X} |" in text
    assert f"more than {MOST_BODY_BYTES} bytes" in text
    assert f"headers end at {MOST_LINE_BYTES} bytes" in text
    assert f"Of orders, {MOST_WAITING} may wait" in text
    assert f"whole within {REQUEST_WITHIN_S:g} s" in text
