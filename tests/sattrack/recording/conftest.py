"""One short run, recorded once for all: the last seconds of a pass, every kind of message in it."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import pytest
from mcap.reader import make_reader

from sattrack.cli.main import run

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


@pytest.fixture(scope="session")
def held_in_short(short: Path) -> Counter[str]:
    """How many messages of each topic that recording has, counted by the reader of MCAP's own library."""
    with short.open("rb") as stream:
        counted = Counter(channel.topic for _, channel, _ in make_reader(stream).iter_messages())
    # 20 s at 20 a second, the end included in which rest is seen; more or less a slew that ends sooner.
    assert counted["command"] == counted["status"] == pytest.approx(400, abs=25)
    assert counted["view"] == pytest.approx(counted["command"] / 10, abs=1)
    return counted
