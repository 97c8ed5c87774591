"""Reading a catalogue against sgp4's own loop over it: how many times as long, validation included.

Run it as `python bench/catalogue.py FILE`, a TLE or 3LE file (it may be compressed with gzip); without one it
makes a catalogue of 20000 sets itself. Prints the ratio of the times, taken by turns, and then the same
catalogue as OMM in each notation; every set is counted.
"""

from __future__ import annotations

import dataclasses
import gc
import gzip
import statistics
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

from sgp4.api import Satrec

from tle.elements import Elements
from tle.errors import ElementsError
from tle.sources import WRITTEN, parse_elements, write_elements

if TYPE_CHECKING:
    from collections.abc import Callable

# CelesTrak, elements of the ISS of 2026-10-02.
LINES = (
    "1 25544U 98067A   26275.01380287  .00003738  00000+0  76743-4 0  9992",
    "2 25544  51.6312 131.4121 0006946 211.9293 148.1275 15.48707684588318",
)
ROUNDS = 9


def made_up() -> str:
    """Return a catalogue of objects along one orbit, numbered on into Alpha-5."""
    one = Elements.from_tle(*LINES)
    sets = [
        dataclasses.replace(
            one, name=f"OBJECT {n}", catalog_number=90_000 + n, mean_anomaly_deg=n % 3600 / 10.0
        )
        for n in range(20_000)
    ]
    return write_elements(sets, "tle")


def seconds_of(work: Callable[[], object]) -> float:
    gc.collect()
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def sgp4_loop(text: str) -> list[Satrec]:
    """Read the sets as sgp4's documentation does; it checks neither checksums nor ranges."""
    lines = [line for line in text.splitlines() if line[:2] in ("1 ", "2 ")]
    return [Satrec.twoline2rv(lines[n], lines[n + 1]) for n in range(0, len(lines) - 1, 2)]


def counted(found: list[Elements | ElementsError]) -> str:
    refused = sum(isinstance(item, ElementsError) for item in found)
    return f"{len(found) - refused} accepted, {refused} refused"


def main() -> None:
    if len(sys.argv) > 1:
        data = Path(sys.argv[1]).read_bytes()
        text = (gzip.decompress(data) if data[:2] == b"\x1f\x8b" else data).decode()
    else:
        text = made_up()
    sets = parse_elements(text)
    there = len(sgp4_loop(text))
    print(f"{there} sets: {counted(sets)}")
    ours_s, theirs_s = [], []
    for _ in range(ROUNDS):
        theirs_s.append(seconds_of(lambda: sgp4_loop(text)))
        ours_s.append(seconds_of(lambda: parse_elements(text)))
    ratios = sorted(a / b for a, b in zip(ours_s, theirs_s, strict=True))
    print(
        f"TLE, every column checked: {statistics.median(ratios):.2f} times as long as sgp4's twoline2rv "
        f"({ratios[0]:.2f} to {ratios[-1]:.2f}); {1e6 * min(ours_s) / there:.1f} µs a set, "
        f"sgp4 {1e6 * min(theirs_s) / there:.1f}"
    )
    good = [item for item in sets if isinstance(item, Elements)]
    for form in WRITTEN:
        written = write_elements(good, form)
        taken_s = min(seconds_of(lambda written=written: parse_elements(written)) for _ in range(2))  # type: ignore[misc]
        print(f"{form:>4}: {1e6 * taken_s / len(good):.1f} µs a set, {counted(parse_elements(written))}")


if __name__ == "__main__":
    main()
