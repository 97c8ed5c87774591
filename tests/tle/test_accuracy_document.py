"""The figures of docs/accuracy.md are those that the command prints."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def test_the_error_budget_is_what_the_command_prints():
    done = subprocess.run(
        [sys.executable, str(ROOT / "bench" / "ephemeris.py"), "--budget"],
        capture_output=True,
        text=True,
        check=True,
    )
    rows = [line for line in done.stdout.splitlines() if line.endswith(("″ |", "″/s |"))]
    assert len(rows) == 13
    page = (ROOT / "docs" / "accuracy.md").read_text(encoding="utf-8")
    # What is left of rounding may differ in its last figures from one processor to the next.
    for row in rows[:-2]:
        assert row in page
    for row in rows[-2:]:
        assert row.split("|")[1] in page
