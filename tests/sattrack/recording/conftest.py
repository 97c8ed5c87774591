"""One short run, recorded once for all: the last seconds of a pass, every kind of message in it."""

from __future__ import annotations

from pathlib import Path

import pytest

from sattrack.cli import run

DATA = Path(__file__).parent / "data"
EXAMPLES = Path(__file__).resolve().parents[3] / "examples"
SHORT = [
    *("track", "25544", "--virtual", "--mount", "sim", "--json", "--min-alt", "78"),
    *("--site", "52.1541,4.4908,0", "--elements", str(EXAMPLES / "iss_leiden.tle")),
    *("--clock", "2026-10-02T13:05:15Z"),
]


@pytest.fixture(scope="session")
def short(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A whole recording of 18 s."""
    path = tmp_path_factory.mktemp("short") / "short.mcap"
    assert run([*SHORT, "--record", str(path)]) == 0
    return path
