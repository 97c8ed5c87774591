"""Recorded passes as tests: a plugin that comes with the package.

Every `*.mcap` in a folder named `passes` is a test: its inputs run through the installed code, and what comes
out is compared as `sattrack replay` does. In a test of one's own, the fixture `sattrack_pass` does the same.
`--sattrack-update` keeps today's outputs as what is expected from now on, in `NAME.expected.mcap` beside the
recording, which itself is never changed.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from sattrack.recording.format import Recording
    from sattrack.recording.replay import Output, Replay, Tolerances

FOLDER = "passes"
EXPECTED = ".expected.mcap"
UPDATE = "--sattrack-update"


class PassDiffersError(AssertionError):
    """Today's code does not make a recorded run again."""


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the option that keeps today's outputs."""
    group = parser.getgroup("sattrack", "recorded passes of sattrack")
    group.addoption(
        UPDATE,
        action="store_true",
        help="keep what today's code makes of recorded passes as what is expected from now on",
    )


def pytest_collect_file(file_path: Path, parent: pytest.Collector) -> pytest.Collector | None:
    """Take every recording in a folder named `passes` as a test."""
    if file_path.suffix != ".mcap" or file_path.name.endswith(EXPECTED) or file_path.parent.name != FOLDER:
        return None
    collector: pytest.Collector = PassFile.from_parent(parent, path=file_path)
    return collector


class PassFile(pytest.File):
    """A recording among the tests."""

    def collect(self) -> Iterator[pytest.Item]:
        """Give its one test."""
        yield PassItem.from_parent(self, name="replay")


class PassItem(pytest.Item):
    """The replay of one recording."""

    def runtest(self) -> None:
        """Run it."""
        check_pass(self.path, self.config)

    def repr_failure(self, excinfo: pytest.ExceptionInfo[BaseException], style: Any = None) -> Any:
        """Say what differs, without a traceback of what only compares."""
        from sattrack.core.errors import SattrackError

        if isinstance(excinfo.value, PassDiffersError | SattrackError):
            return str(excinfo.value)
        return super().repr_failure(excinfo, style)

    def reportinfo(self) -> tuple[Path, int | None, str]:
        """Say where the test is."""
        return self.path, None, f"replay of {self.path.name}"


@pytest.fixture
def sattrack_pass(request: pytest.FixtureRequest) -> Callable[..., Replay]:
    """A function that replays a recording, fails the test where outputs differ, and returns the result.

    Tolerances for what another version's code makes of it may follow the path. A relative path is looked for
    beside the test, then in `passes` there, then in `passes` at the root.
    """
    here = request.path.parent
    folders = (here, here / FOLDER, request.config.rootpath / FOLDER)

    def replay_pass(path: str | Path, tolerances: Tolerances | None = None) -> Replay:
        places = [folder / path for folder in folders]
        found = next((place for place in places if place.exists()), places[0])
        return check_pass(found, request.config, tolerances)

    return replay_pass


def check_pass(path: Path, config: pytest.Config, tolerances: Tolerances | None = None) -> Replay:
    """Replay a recording; raise PassDiffersError where it does not come out as expected.

    `tolerances` are for another version's code, whose run is compared by figures.

    With the option to update, keep what came out instead.
    """
    from sattrack.recording.format import Recording
    from sattrack.recording.replay import replay, replay_lines
    from sattrack.runtime.facts import engine_of, open_recording

    recording, _ = open_recording(path)
    kept = path.with_name(path.stem + EXPECTED)
    outputs: list[Output] = []
    if config.getoption(UPDATE, default=False):
        result = replay(recording, engine_of, keep=outputs)
        _keep(kept, recording, result, outputs)
        return result
    expected = Recording(kept) if kept.exists() else None
    result = replay(recording, engine_of, tolerances=tolerances, expected=expected, keep=outputs)
    if not result.agrees:
        lines = [f"{path}:", *replay_lines(result), _plot(path, config, outputs, result)]
        if expected is not None:
            lines.insert(1, f"expected is what {kept.name} has")
        raise PassDiffersError("\n".join(lines))
    return result


def _keep(path: Path, recording: Recording, result: Replay, outputs: list[Output]) -> None:
    """Write today's outputs as what is expected."""
    import msgspec

    from sattrack.recording.format import SUMMARY
    from sattrack.recording.recorder import Recorder

    figures = result.replayed
    summary = {
        "reported_rms_arcsec": figures.rms_arcsec,
        "reported_peak_arcsec": figures.peak_arcsec,
        "samples": figures.samples,
        "on_target_s": figures.on_target_s,
        "ended_by": figures.ended_by,
    }
    with path.open("wb") as stream:
        recorder = Recorder(stream, recording.header.spec)
        for output in outputs:
            recorder.write(output.topic, output.utc_s, output.replayed)
        recorder.write(SUMMARY, outputs[-1].utc_s if outputs else 0.0, msgspec.json.encode(summary))
        recorder.close()
    if recorder.trouble is not None:
        raise PassDiffersError(f"{path}: {recorder.trouble}")


def _plot(path: Path, config: pytest.Config, outputs: list[Output], result: Replay) -> str:
    """Save a picture of what differs; return a line that says where."""
    from sattrack.core.errors import BadInputError
    from sattrack.recording.rendering import save_divergence

    cache = config.cache
    folder = Path.cwd() if cache is None else Path(cache.mkdir("sattrack"))
    picture = folder / f"{path.stem}.png"
    try:
        save_divergence(picture, path.name, outputs, result)
    except BadInputError as error:
        return f"no plot: {error}"
    return f"plot: {picture}"
