"""No disk is worth a run: whatever it does, tracking goes on, and the user is told."""

from __future__ import annotations

import io
import json
import os
import random
import resource
import signal
import subprocess
import sys
import threading
import time
from typing import TYPE_CHECKING, Any

import msgspec
import pytest

from sattrack.cli.main import run
from sattrack.recording.format import COMMAND, Recording
from sattrack.recording.recorder import BackgroundRecorder, Recorder
from sattrack.recording.replay import replay
from sattrack.runtime.facts import engine_of

if TYPE_CHECKING:
    from pathlib import Path

SPEC = msgspec.Raw(b"{}")
WRITER = """
import os, sys, time
from pathlib import Path
import msgspec
from sattrack.recording.recorder import BackgroundRecorder, Recorder, create
recorder = BackgroundRecorder(Recorder(create(Path(sys.argv[1])), msgspec.Raw(b"{}")))
number = 0
while True:
    at = time.time()
    recorder.status(at, number.to_bytes(4, "little") * 40)
    recorder.command(at, number.to_bytes(2, "little") * 41)
    number += 1
    os.write(1, f"{at!r}\\n".encode())
    time.sleep(0.05)
"""


class FullDisk(io.BytesIO):
    """Takes so many bytes, and then says what the system says."""

    def __init__(self, room: int, number: int) -> None:
        super().__init__()
        self.room, self.number = room, number

    def write(self, data: Any) -> int:
        if self.tell() + len(data) > self.room:
            raise OSError(self.number, os.strerror(self.number))
        return super().write(data)


@pytest.mark.parametrize("number", [28, 5, 30])
@pytest.mark.parametrize("room", [0, 30, 10_000, 20_000])
def test_a_disk_that_refuses_is_told_once_and_what_was_written_stays_readable(
    tmp_path: Path, number: int, room: int
) -> None:
    disk = FullDisk(room, number)
    recorder = Recorder(disk, SPEC)
    for i in range(4000):
        recorder.command(i * 0.05, random.Random(i).randbytes(82))
    assert recorder.trouble == f"the recording cannot be written: {os.strerror(number)}; it ends here"
    if room > 9000:
        path = tmp_path / "part.mcap"
        path.write_bytes(disk.getvalue())
        part = Recording(path)
        assert part.cut_off
        assert len(part) > 20
    recorder.close()


def test_a_disk_that_never_answers_does_not_hold_the_end() -> None:
    release = threading.Event()

    class Hanging(io.BytesIO):
        hangs = False

        def write(self, data: Any) -> int:
            if self.hangs:
                release.wait(60.0)
            return super().write(data)

    disk = Hanging()
    recorder = BackgroundRecorder(Recorder(disk, SPEC), patience_s=0.05)
    disk.hangs = True
    recorder.command(5.0, bytes(82))
    recorder.close()
    assert recorder.trouble == "the disk does not answer; the recording ends where it stands"
    release.set()


def test_a_full_disk_ends_the_recording_and_not_the_run(tmp_path: Path) -> None:
    path = tmp_path / "full.mcap"
    command = [sys.executable, "-m", "sattrack", "track", "25544", "--virtual", "--mount", "sim", "--json"]
    done = subprocess.run(
        [*command, "--min-alt", "75", "--clock", "2026-10-02T13:04:55Z", "--record", str(path)],
        capture_output=True,
        text=True,
        check=False,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (60_000, 60_000)),
    )
    summary = json.loads(done.stdout)["summary"]
    assert summary["ended_by"] == "set"
    assert summary["on_target_s"] > 20.0
    assert "the recording cannot be written: File too large" in summary["recording_trouble"]
    assert done.returncode == 1
    assert "the recording cannot be written" in done.stderr
    assert len(Recording(path)) > 100


def test_a_folder_that_cannot_be_written_is_told_before_anything_moves(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    where = "/proc/sattrack.mcap"
    assert run(["track", "25544", "--virtual", "--mount", "sim", "--record", where]) == 2
    assert f"--record {where}: cannot be written" in capsys.readouterr().err


def kill_one(path: Path, after_s: float) -> tuple[float, float]:
    """Kill a writer at some instant; return the instants of the last line told and the last recorded."""
    writer = subprocess.Popen([sys.executable, "-c", WRITER, str(path)], stdout=subprocess.PIPE)
    assert writer.stdout is not None
    first = writer.stdout.readline()
    time.sleep(after_s)
    writer.send_signal(signal.SIGKILL)
    writer.wait()
    lines = [first, *writer.stdout.read().splitlines()]
    writer.stdout.close()
    commands = [entry.utc_s for entry in Recording(path).entries() if entry.topic == COMMAND]
    return float(lines[-1]), commands[-1] if commands else float(first)


@pytest.mark.parametrize("kills", [4, pytest.param(500, marks=pytest.mark.soak)])
def test_killed_at_any_instant_the_file_opens_and_lacks_a_second_at_most(tmp_path: Path, kills: int) -> None:
    rng, most_s = random.Random(11), 3.0 if kills > 4 else 1.5
    for number in range(kills):
        told_s, recorded_s = kill_one(tmp_path / f"{number}.mcap", rng.uniform(0.0, most_s))
        assert told_s - recorded_s <= 1.0


def test_what_a_cut_leaves_replays_to_the_same_bytes(short: Path, tmp_path: Path) -> None:
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(short.read_bytes()[:40_000])
    result = replay(Recording(cut), engine_of)
    assert result.cut_off
    assert result.ticks > 100
    assert result.differing == 0


def test_a_clock_that_is_set_back_keeps_nothing_from_the_disk() -> None:
    disk = io.BytesIO()
    recorder = Recorder(disk, SPEC)
    recorder.command(1000.0, bytes(82))
    length = len(disk.getvalue())
    for i in range(20):
        recorder.command(400.0 + 0.05 * i, random.Random(i).randbytes(82))
    assert len(disk.getvalue()) > length + 82
