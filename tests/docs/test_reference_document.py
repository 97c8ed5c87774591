"""docs/commands.md and docs/settings.md are what the code says, and every exit code is told."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from sattrack.core.errors import SattrackError
from sattrack.views.run import Summary

ROOT = Path(__file__).resolve().parents[2]
COMMANDS = ROOT / "docs" / "commands.md"


def generator(*options: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "tools.reference", *options]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)


def test_the_pages_are_what_the_code_says() -> None:
    done = generator("--check")
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize(
    ("name", "before", "after"),
    [("commands.md", "| `--virtual` |", "| `--vertical` |"), ("settings.md", "| 60 | s |", "| 61 | s |")],
)
def test_a_difference_is_named(tmp_path: Path, name: str, before: str, after: str) -> None:
    shutil.copytree(ROOT / "docs", tmp_path / "docs")
    page = tmp_path / "docs" / name
    good = page.read_text(encoding="utf-8")
    assert before in good
    page.write_text(good.replace(before, after), encoding="utf-8")
    done = generator("--check", "--root", str(tmp_path))
    assert done.returncode == 1
    assert f"docs/{name} is not what the code says" in done.stderr


def test_every_exit_code_is_told() -> None:
    def all_of(kind: type[SattrackError]) -> set[int]:
        return {kind.exit_code}.union(*(all_of(one) for one in kind.__subclasses__()))

    text = COMMANDS.read_text(encoding="utf-8")
    assert all(f"\n| {code} | " in text for code in {0} | all_of(SattrackError))


def test_every_field_of_a_summary_of_a_pass_and_of_a_direction_is_told() -> None:
    text = (ROOT / "docs" / "json.md").read_text(encoding="utf-8")
    told = set(re.findall(r"`(\w+)`", text))
    assert set(Summary.__struct_fields__) <= told
    place = ["--config", "examples/sattrack.toml", "--json"]
    span = ["--from", "2026-10-02T13:04:00Z", "--to", "2026-10-02T13:04:01Z", "--step", "1"]
    for arguments in (["ephemeris", "ISS", *span], ["passes", "ISS", "--clock", "2026-10-02T13:00:00Z"]):
        command = [sys.executable, "-m", "sattrack", *arguments, *place]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, check=True)
        assert set(json.loads(done.stdout)[0]) <= told
