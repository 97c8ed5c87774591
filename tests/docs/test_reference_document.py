"""docs/commands.md and docs/settings.md are what the code says, and every exit code is told."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from sattrack.cli.main import run
from sattrack.core.errors import SattrackError
from sattrack.views.run import Summary

if TYPE_CHECKING:
    from tool_runs import Tool

ROOT = Path(__file__).resolve().parents[2]
COMMANDS = ROOT / "docs" / "commands.md"


def test_the_pages_are_what_the_code_says(tool: Tool) -> None:
    done = tool("reference", "--check")
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize(
    ("name", "before", "after"),
    [("commands.md", "| `--virtual` |", "| `--vertical` |"), ("settings.md", "| 60 | s |", "| 61 | s |")],
)
def test_a_difference_is_named(tool: Tool, tmp_path: Path, name: str, before: str, after: str) -> None:
    shutil.copytree(ROOT / "docs", tmp_path / "docs")
    page = tmp_path / "docs" / name
    good = page.read_text(encoding="utf-8")
    assert before in good
    page.write_text(good.replace(before, after), encoding="utf-8")
    done = tool("reference", "--check", "--root", str(tmp_path))
    assert done.returncode == 1
    assert f"docs/{name} is not what the code says" in done.stderr


def test_every_exit_code_is_told() -> None:
    def all_of(kind: type[SattrackError]) -> set[int]:
        return {kind.exit_code}.union(*(all_of(one) for one in kind.__subclasses__()))

    text = COMMANDS.read_text(encoding="utf-8")
    assert all(f"\n| {code} | " in text for code in {0} | all_of(SattrackError))


def test_every_field_of_a_summary_of_a_pass_and_of_a_direction_is_told(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(ROOT)
    text = (ROOT / "docs" / "json.md").read_text(encoding="utf-8")
    told = set(re.findall(r"`(\w+)`", text))
    assert set(Summary.__struct_fields__) <= told
    place = ["--config", "examples/sattrack.toml", "--json"]
    span = ["--from", "2026-10-02T13:04:00Z", "--to", "2026-10-02T13:04:01Z", "--step", "1"]
    for arguments in (["ephemeris", "ISS", *span], ["passes", "ISS", "--clock", "2026-10-02T13:00:00Z"]):
        assert run([*arguments, *place]) == 0
        assert set(json.loads(capsys.readouterr().out)[0]) <= told
