"""What interpolation misses at rows that are held out: every second one, of real ephemeris files.

    python bench/held_out.py FILE [FILE ...]

Rows at either end, where polynomials lean to one side, are left out.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from tle.formats.ephemerides import read_ephemerides


def main() -> None:
    for path in sys.argv[1:]:
        worst, rows = {}, 0
        for one in read_ephemerides(path):
            for segment in one.segments:
                edge = segment.interpolation.rows // 2
                held = np.arange(1, len(segment.since_s) - 1, 2)[edge:-edge]
                if not len(held):
                    continue
                velocity = segment.velocity_km_s
                some = replace(
                    segment,
                    since_s=segment.since_s[::2],
                    place_km=segment.place_km[::2],
                    velocity_km_s=None if velocity is None else velocity[::2],
                )
                places = some.native_many(segment.since_s[held])[:3].T
                missed = np.linalg.norm(places - segment.place_km[held], axis=1) * 1e6
                worst[one.name] = max(worst.get(one.name, 0.0), float(missed.max()))
                rows += len(held)
        if worst:
            name = max(worst, key=lambda key: worst[key])
            size = f"{rows} rows of {len(worst)} objects"
            print(f"{Path(path).name}: {size}, at most {worst[name]:.1f} mm ({name})")


if __name__ == "__main__":
    main()
