"""One short run, recorded once for all: the last seconds of a pass, every kind of message in it."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from mcap.reader import make_reader

from sattrack.cli.main import run
from sattrack.recording.trace import trace

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sattrack.recording.format import Recording
    from sattrack.recording.trace import Trace

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


@pytest.fixture(scope="module")
def traced_once() -> Iterator[None]:
    """Make each recording's run again once for the module, however many commands report it."""
    made: dict[Path, Trace] = {}

    def once(recording: Recording, *more: Any) -> Trace:
        if recording.path not in made:
            made[recording.path] = trace(recording, *more)
        return made[recording.path]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sattrack.cli.recording.trace", once)
        yield


@pytest.fixture(scope="session")
def held_in_short(short: Path) -> Counter[str]:
    """How many messages of each topic that recording has, counted by the reader of MCAP's own library."""
    with short.open("rb") as stream:
        counted = Counter(channel.topic for _, channel, _ in make_reader(stream).iter_messages())
    # 20 s at 20 a second, the end included in which rest is seen; more or less a slew that ends sooner.
    assert counted["command"] == counted["status"] == pytest.approx(400, abs=25)
    assert counted["view"] == pytest.approx(counted["command"] / 10, abs=1)
    return counted
