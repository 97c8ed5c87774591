"""docs/architecture.md: its picture is what the code says, and every file and name in it is there."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")


def test_the_picture_is_drawn_from_the_code(tmp_path: Path) -> None:
    def check(root: Path) -> int:
        command = [sys.executable, "-m", "tools.architecture", "--check", "--root", str(root)]
        return subprocess.run(command, cwd=ROOT, capture_output=True, check=False).returncode

    assert check(ROOT) == 0
    drawn = (ROOT / "docs" / "architecture.svg").read_text(encoding="utf-8")
    (tmp_path / "docs").mkdir()
    (tmp_path / "docs" / "architecture.svg").write_text(drawn.replace("sattrack/safety", "sattrack/x"))
    assert check(tmp_path) == 1


def test_every_file_that_the_page_names_is_there() -> None:
    named = re.findall(r"`((?:\w+/)+(?:\w+\.py)?)`", PAGE)
    assert len(named) > 20
    made = [name for name in named if "NAME" not in name]
    gone = [name for name in made if not any((top / name).exists() for top in (ROOT, ROOT / "sattrack"))]
    assert gone == []


def test_every_class_and_method_of_the_control_step_is_there() -> None:
    steps = PAGE.partition("## One control step")[2].partition("## Extension points")[0]
    defined = "\n".join(path.read_text(encoding="utf-8") for path in (ROOT / "sattrack").rglob("*.py"))
    for name in re.findall(r"`([A-Z]\w+)(?:\.(\w+))?`", steps):
        assert re.search(rf"^class {name[0]}\b", defined, re.MULTILINE), name
        assert not name[1] or re.search(rf"^    def {name[1]}\b", defined, re.MULTILINE), name
