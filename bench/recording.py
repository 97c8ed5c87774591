"""What a recording costs: the loop's time, bytes, and the time of a replay.

python bench/recording.py [--seconds N] [--replays N] [--record FILE]

The built-in pass is made in virtual time and replayed; then two loops at 20 Hz run in real time, each as the
feeder does (`undisturbed`), one with a recorder behind its queue and one without, and how late they wake is
compared. A replay is timed by the clock and by the processor's own time, which a busy machine disturbs less.
"""

from __future__ import annotations

import argparse
import os
import platform
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import msgspec

from sattrack import practice
from sattrack.recording.format import VIEW
from sattrack.recording.reading import Recording
from sattrack.recording.recorder import BackgroundRecorder, NoRecording, Recorder, Sink, create
from sattrack.recording.replay import replay
from sattrack.runtime.again import engine_of
from sattrack.runtime.realtime import undisturbed
from sattrack.view import TrackView

PERIOD_S = 0.05


def quantile(values: list[float], share: float) -> float:
    return sorted(values)[min(len(values) - 1, int(share * len(values)))]


def make(path: Path) -> None:
    """Record the built-in pass in virtual time."""
    options = ["--virtual", "--mount", "sim", "--json", "--record", str(path)]
    subprocess.run(
        [sys.executable, "-m", "sattrack", "track", str(practice.elements().catalog_number), *options],
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


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seconds", type=float, default=60.0, help="of each loop in real time")
    parser.add_argument("--replays", type=int, default=5)
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
        cost(path, folder, asked.seconds)


if __name__ == "__main__":
    main()
