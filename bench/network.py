"""What the passes of a network cost: a station-day, its growth, workers, overhead, the client's memory.

`python bench/network.py CATALOGUE` takes a TLE file, gzipped or not. Prints the processor seconds of a
station-day for 1, 2 and 4 times the objects, stations and days; the time with two local workers against one,
by turns; the whole command's work in one process against the plain loop over the same searches, by turns; the
client's memory with few and with many stations. `--objects N` (10,000), `--stations N` (20), `--rounds N` (3)
change what is measured. Elapsed times count what else the computer does.
"""

from __future__ import annotations

import argparse
import gzip
import random
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from functools import partial
from multiprocessing import get_context
from pathlib import Path

from sattrack.network.engine import in_this_process, make_data_set
from sattrack.network.stations import Station
from tle.elements import Elements
from tle.facts import fact_columns
from tle.instants import Utc
from tle.passes import find_catalogue_passes
from tle.sources import newest, parse_elements, write_elements

HOURS = 24.0
PROGRAM = """
import sys
from sattrack.cli.main import run
if __name__ == "__main__":
    run(sys.argv[1:])
    print([line.split()[1] for line in open("/proc/self/status") if line.startswith("VmHWM")][0])
"""


def stations(count: int) -> list[Station]:
    draw = random.Random(7)
    return [
        Station(f"s{k:03d}", round(draw.uniform(-60, 60), 4), round(draw.uniform(-180, 180), 4))
        for k in range(count)
    ]


def written(folder: Path, count: int) -> Path:
    file = folder / f"stations{count}.csv"
    rows = [f"{one.name},{one.latitude_deg},{one.longitude_deg}" for one in stations(count)]
    file.write_text("\n".join(["name,latitude_deg,longitude_deg", *rows]) + "\n")
    return file


def processor_s(work) -> float:  # type: ignore[no-untyped-def]
    begun = time.process_time()
    work()
    return time.process_time() - begun


def in_process(elements: list[Elements], count: int, start: Utc, hours: float) -> None:
    with tempfile.TemporaryDirectory() as out:
        make_data_set(Path(out) / "d", stations(count), elements, (start, hours), in_this_process)


def plain_loop(elements: list[Elements], count: int, start: Utc) -> None:
    for one in stations(count):
        fact_columns(find_catalogue_passes(elements, one.site, start, HOURS))


def children_s() -> float:
    spent = resource.getrusage(resource.RUSAGE_CHILDREN)
    return spent.ru_utime + spent.ru_stime


def command(folder: Path, count: int, start: Utc, workers: int) -> tuple[float, float, float]:
    """Return elapsed and processor seconds of the command, and the client's largest memory (MiB)."""
    with tempfile.TemporaryDirectory() as out:
        words = [sys.executable, "-m", "sattrack", "network", "passes", "--out", f"{out}/d"]
        words += ["--stations", str(written(folder, count)), "--elements", str(folder / "elements.tle")]
        words += ["--from", str(start), "--hours", str(HOURS), "--workers", str(workers)]
        begun, spent_s = time.perf_counter(), children_s()
        # The command in a process of its own, which says how much memory it took itself.
        program = [sys.executable, "-c", PROGRAM, *words[3:]]
        done = subprocess.run(program, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        peak_mib = int(done.stdout.split()[-1]) / 1024.0
        return time.perf_counter() - begun, children_s() - spent_s, peak_mib


def spin() -> None:
    until_s = time.process_time() + 2.0
    while time.process_time() < until_s:
        pass


def spinning_s(count: int) -> float:
    """Return how long so many processes of two processor seconds each take together: what is free here."""
    begun = time.perf_counter()
    started = [get_context("spawn").Process(target=spin) for _ in range(count)]
    for one in started:
        one.start()
    for one in started:
        one.join()
    return time.perf_counter() - begun


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("catalogue", type=Path)
    parser.add_argument("--objects", type=int, default=10_000)
    parser.add_argument("--stations", type=int, default=20)
    parser.add_argument("--rounds", type=int, default=3)
    asked = parser.parse_args()
    data = asked.catalogue.read_bytes()
    text = (gzip.decompress(data) if data[:2] == b"\x1f\x8b" else data).decode()
    every = newest(e for e in parse_elements(text) if isinstance(e, Elements))
    random.Random(1).shuffle(every)
    elements = every[: asked.objects]
    epochs = sorted(float(one.epoch.unix_s) for one in elements)
    start = Utc(86400.0 * (epochs[len(epochs) // 2] // 86400.0))
    quarter = elements[: len(elements) // 4]
    print(f"processor seconds of {len(quarter)} objects, 1 station, 1 day, and of more:", flush=True)
    for what, sizes in (
        ("objects", [(elements[: k * len(quarter)], 1, HOURS) for k in (1, 2, 4)]),
        ("stations", [(quarter, k, HOURS) for k in (1, 2, 4)]),
        ("days", [(quarter, 1, k * HOURS) for k in (1, 2, 4)]),
    ):
        spent = [processor_s(partial(in_process, some, count, start, hours)) for some, count, hours in sizes]
        ratios = ", ".join(
            f"{k} times {one:.2f} s ({one / spent[0]:.2f})" for k, one in zip((1, 2, 4), spent, strict=True)
        )
        print(f"  {what}: {ratios}", flush=True)
    pairs = [
        (
            processor_s(lambda: in_process(elements, 2, start, HOURS)),
            processor_s(lambda: plain_loop(elements, 2, start)),
        )
        for _ in range(asked.rounds)
    ]
    over = sorted(ours / plain - 1.0 for ours, plain in pairs)
    print(
        f"station-day of {len(elements)} objects: "
        f"{statistics.median(o for o, _ in pairs) / 2:.2f} processor seconds"
    )
    print(
        f"over the plain loop, one process, 2 stations: {100 * statistics.median(over):+.1f} % "
        f"({100 * over[0]:+.1f} to {100 * over[-1]:+.1f})",
        flush=True,
    )
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "elements.tle").write_text(write_elements(elements, "tle"))
        ratios, gains, memory = [], [], {}
        for _ in range(asked.rounds):
            alone_s = spinning_s(1)
            gains.append(2.0 * alone_s / spinning_s(2))
            one, one_s, _ = command(folder, asked.stations, start, 1)
            two, two_s, memory[asked.stations] = command(folder, asked.stations, start, 2)
            ratios.append(one / two)
            print(
                f"  {asked.stations} stations: 1 worker {one:.1f} s ({one_s:.1f} s of processors), "
                f"2 workers {two:.1f} s ({two_s:.1f} s); two processes that only count get "
                f"{gains[-1]:.2f} times as much done as one",
                flush=True,
            )
        few = max(1, asked.stations // 5)
        memory[few] = command(folder, few, start, 2)[2]
    print(
        f"2 workers against 1: {statistics.median(ratios):.2f} times as fast "
        f"({min(ratios):.2f} to {max(ratios):.2f})"
    )
    print(
        "client's memory, 2 workers: "
        + ", ".join(f"{n} stations {m:.0f} MiB" for n, m in sorted(memory.items()))
    )
    here = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"in one process: {here:.0f} MiB")


if __name__ == "__main__":
    main()
