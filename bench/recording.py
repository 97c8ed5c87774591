"""What a recording costs: the loop's time, bytes, the time of a replay; and what outlives a kill.

python bench/recording.py [--seconds N] [--replays N] [--kills N] [--record FILE]

The built-in pass is made in virtual time and replayed; then two loops at 20 Hz run in real time, each as the
feeder does (`undisturbed`), one with a recorder behind its queue and one without, and how late they wake is
compared. A replay is timed by the clock and by the processor's own time, which a busy machine disturbs less.
With --kills, so many runs in virtual time are killed outright at random instants, a second or so after their
beginning; what each left is opened, held against how far it had told it was, and replayed.
"""

from __future__ import annotations

import argparse
import mmap
import os
import platform
import random
import signal
import struct
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import msgspec

from sattrack.core.realtime import undisturbed
from sattrack.recording.format import COMMAND, VIEW, Recording
from sattrack.recording.recorder import BackgroundRecorder, NoRecording, Recorder, Sink, create
from sattrack.recording.replay import replay
from sattrack.runtime import demo_pass, flight
from sattrack.runtime.facts import Prepared, RunRequest, engine_of, prepare
from sattrack.views.run import TrackView

PERIOD_S = 0.05
LONGEST_RUN_S = 1.2
"""How long a run goes on at most before it is killed: some four minutes of a pass."""


def quantile(values: list[float], share: float) -> float:
    return sorted(values)[min(len(values) - 1, int(share * len(values)))]


def make(path: Path) -> None:
    """Record the built-in pass in virtual time."""
    options = ["--virtual", "--mount", "sim", "--json", "--record", str(path)]
    subprocess.run(
        [sys.executable, "-m", "sattrack", "track", str(demo_pass.elements().catalog_number), *options],
        check=True,
        capture_output=True,
    )


def replays(path: Path, times: int) -> None:
    factors, processor = [], []
    for _ in range(times):
        began_s, used_s = time.perf_counter(), time.process_time()
        result = replay(Recording(path), engine_of)
        factors.append(result.seconds / (time.perf_counter() - began_s))
        processor.append(result.seconds / (time.process_time() - used_s))
        assert result.agrees, result.reasons
    whole = Recording(path)
    megabytes = path.stat().st_size / 1e6
    told = f"{len(whole)} messages, compared by {result.choice.mode}: {result.differing} differ"
    print(f"replayed {result.seconds:.0f} s, {told}")
    best = f"{max(processor):.0f} by the processor's time, {max(factors):.0f} by the clock"
    print(f"faster than real time by {best}, the best of {times}")
    print(f"{megabytes:.2f} MB, {megabytes * 600.0 / result.seconds:.2f} MB for ten minutes")


def loop(sink: Sink, view: TrackView, seconds: float) -> tuple[list[float], list[float]]:
    """Return how late each turn of a loop woke, and how long its recording took, seconds."""
    late, took = [], []
    status, command = os.urandom(160), os.urandom(82)
    with undisturbed():
        due_s = time.monotonic() + PERIOD_S
        for turn in range(round(seconds / PERIOD_S)):
            time.sleep(max(0.0, due_s - time.monotonic()))
            woke_s = time.monotonic()
            late.append(woke_s - due_s)
            at = time.time()
            sink.status(at, status)
            sink.command(at, command)
            if turn % 10 == 0:
                sink.view(at, view)
            took.append(time.monotonic() - woke_s)
            due_s += PERIOD_S
    return late, took


def cost(path: Path, folder: Path, seconds: float) -> None:
    data = next(entry.data for entry in Recording(path).entries() if entry.topic == VIEW)
    view = msgspec.json.decode(data, type=TrackView)
    recorder = BackgroundRecorder(Recorder(create(folder / "loop.mcap"), Recording(path).header.spec))
    for name, sink in (("without", NoRecording()), ("with", recorder)):
        late, took = loop(sink, view, seconds)
        shares = ", ".join(
            f"{label} {quantile(late, share) * 1000.0:.3f}"
            for label, share in (("p50", 0.5), ("p99", 0.99), ("p99.9", 0.999), ("max", 1.0))
        )
        told = f"told in {quantile(took, 0.999) * 1e6:.0f} µs (p99.9)"
        print(f"{name} a recorder, {len(late)} turns woke late by, ms: {shares}; {told}")
    recorder.close()
    assert recorder.trouble is None


class Telling(Recorder):
    """A recorder that tells, in memory that outlives its process, how far the run was."""

    told: mmap.mmap

    def command(self, utc_s: float, data: bytes) -> None:
        super().command(utc_s, data)
        self.told[:8] = struct.pack("<d", utc_s)


def kill_one(prepared: Prepared, told: mmap.mmap, after_s: float) -> None:
    """Begin a run in a process of its own, and kill it after some time."""
    told[:8] = bytes(8)
    child = os.fork()
    if child == 0:
        try:
            flight.fly_virtual(prepared)
        finally:
            os._exit(0)
    while struct.unpack("<d", told[:8])[0] == 0.0:
        time.sleep(0.001)
    time.sleep(after_s)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)


def kills(folder: Path, times: int) -> None:
    """Kill runs at random instants; print what was lost, and whether the rest replays to the same bytes."""
    rng, told = random.Random(10), mmap.mmap(-1, 8)
    Telling.told = told
    flight.Recorder = Telling  # type: ignore[misc]
    lost_s, commands, differ = [], 0, 0
    for number in range(times):
        path = folder / f"{number}.mcap"
        request = RunRequest("25544", "sim", None, None, None, 10.0, virtual=True, record=path)
        kill_one(prepare(request), told, rng.uniform(0.0, LONGEST_RUN_S))
        recording = Recording(path)
        kept = [entry for entry in recording.entries() if entry.topic == COMMAND]
        assert recording.whole, "nothing of it is damaged"
        reached_utc_s = struct.unpack("<d", told[:8])[0]
        first_utc_s = prepare(request).facts.started_utc_s
        lost_s.append(reached_utc_s - (kept[-1].utc_s if kept else first_utc_s))
        result = replay(recording, engine_of)
        commands += result.ticks
        differ += result.differing
        path.unlink()
        if sys.stderr.isatty():
            print(f"\r\x1b[K{number + 1} of {times} killed", end="", file=sys.stderr)
    opened = f"killed outright {times} times: every file opens"
    print(f"{opened}, {max(lost_s):.2f} s of the run lost at most, {sum(lost_s) / times:.2f} s on average")
    print(f"what is left replays to the same bytes: {commands} commands, {differ} differ")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seconds", type=float, default=60.0, help="of each loop in real time")
    parser.add_argument("--replays", type=int, default=5)
    parser.add_argument("--kills", type=int, default=0, help="runs to kill")
    parser.add_argument("--record", type=Path, help="a recording of yours instead")
    asked = parser.parse_args()
    machine = f"{platform.machine()}, Python {platform.python_version()}, {os.cpu_count()} processors"
    print(f"{machine}, load {os.getloadavg()[0]:.1f}")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        path = asked.record or folder / "pass.mcap"
        if asked.record is None:
            make(path)
        replays(path, asked.replays)
        if asked.seconds > 0.0:
            cost(path, folder, asked.seconds)
        if asked.kills > 0:
            kills(folder, asked.kills)


if __name__ == "__main__":
    main()
