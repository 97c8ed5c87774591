"""Recordings as tests at a user's: collected from `passes`, told where they differ, kept anew on demand."""

from __future__ import annotations

import shutil
from typing import TYPE_CHECKING

import pytest

from sattrack.recording.format import COMMAND, Recording
from sattrack.recording.recorder import Recorder

if TYPE_CHECKING:
    from collections import Counter
    from pathlib import Path

pytest_plugins = ["pytester"]
PLUGIN = ("-p", "sattrack.pytest_plugin")


@pytest.fixture(autouse=True)
def no_other_plugins(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each would be imported anew in every run within a test."""
    monkeypatch.setenv("PYTEST_DISABLE_PLUGIN_AUTOLOAD", "1")


def passes(pytester: pytest.Pytester, source: Path) -> Path:
    folder = pytester.mkdir("passes")
    shutil.copy(source, folder / "night.mcap")
    return folder / "night.mcap"


def differing(path: Path, source: Path) -> None:
    """Write a copy of a recording in which the mount is told other rates from some tick on."""
    recording = Recording(source)
    with path.open("wb") as stream:
        recorder = Recorder(stream, recording.header.spec)
        for number, entry in enumerate(recording.entries()):
            data = bytearray(entry.data)
            if entry.topic == COMMAND and number > len(recording) // 2:
                data[38] ^= 0x10
            recorder.write(entry.topic, entry.utc_s, bytes(data))
        recorder.close()


def test_a_recording_in_the_folder_is_a_test_that_passes(pytester: pytest.Pytester, short: Path) -> None:
    passes(pytester, short)
    result = pytester.runpytest(*PLUGIN, "-v")
    result.assert_outcomes(passed=1)
    result.stdout.fnmatch_lines(["*passes/night.mcap::replay PASSED*"])


def test_a_recording_elsewhere_is_none(pytester: pytest.Pytester, short: Path) -> None:
    shutil.copy(short, pytester.mkdir("nights") / "night.mcap")
    pytester.runpytest(*PLUGIN).assert_outcomes()


def test_a_failure_prints_the_divergence_and_saves_a_plot(
    pytester: pytest.Pytester, short: Path, held_in_short: Counter[str]
) -> None:
    differing(passes(pytester, short), short)
    result = pytester.runpytest(*PLUGIN)
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(
        [
            f"NOT THE SAME: {held_in_short['command']} commands*",
            "first at 2026-10-02T13:05:2*, after status *move_dec_rate_deg_s expected *, got *",
        ]
    )
    plot = pytester.path / ".pytest_cache" / "d" / "sattrack" / "night.png"
    assert f"plot: {plot}" in result.stdout.str()
    assert plot.read_bytes().startswith(b"\x89PNG")
    assert "Traceback" not in result.stdout.str()


def test_update_keeps_todays_outputs_and_leaves_the_recording_alone(
    pytester: pytest.Pytester, short: Path, held_in_short: Counter[str]
) -> None:
    night = passes(pytester, short)
    differing(night, short)
    before = night.read_bytes()
    pytester.runpytest(*PLUGIN, "--sattrack-update").assert_outcomes(passed=1)
    assert night.read_bytes() == before
    kept = night.with_name("night.expected.mcap")
    assert len([e for e in Recording(kept).entries() if e.topic == COMMAND]) == held_in_short["command"]
    pytester.runpytest(*PLUGIN).assert_outcomes(passed=1)
    differing(kept, kept)
    result = pytester.runpytest(*PLUGIN)
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(["expected is what night.expected.mcap has"])


def test_the_fixture_finds_a_pass_and_gives_its_figures(pytester: pytest.Pytester, short: Path) -> None:
    passes(pytester, short)
    pytester.makepyfile(
        """
        import pytest

        def test_figures(sattrack_pass):
            assert sattrack_pass("night.mcap").replayed.rms_arcsec < 0.05

        def test_absent(sattrack_pass):
            sattrack_pass("absent.mcap")
        """
    )
    result = pytester.runpytest(*PLUGIN, "test_the_fixture_finds_a_pass_and_gives_its_figures.py")
    result.assert_outcomes(passed=1, failed=1)
    result.stdout.fnmatch_lines(["*absent.mcap: cannot be read: No such file or directory*"])


def test_what_is_no_recording_fails_in_a_line(pytester: pytest.Pytester) -> None:
    folder = pytester.mkdir("passes")
    (folder / "broken.mcap").write_bytes(b"nothing of the kind")
    result = pytester.runpytest(*PLUGIN)
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(["*broken.mcap: not an MCAP file*"])
