"""How well rows of real ephemeris files are interpolated: three figures of each file, the worst object's.

    python bench/held_out.py FILE [FILE ...]

*held out*: what is missed at every second row by the others, so at twice the file's step. *scatter*: by
how much the rows themselves are off any smooth curve, by their 16th differences; at a row, nothing can
be missed by less. *at its step*: half way between the rows as they stand, how far the format's
polynomial is from one through two rows more, and so about what it leaves out. Rows at either end, where
polynomials lean to one side, are left out.
"""

from __future__ import annotations

import math
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tle.formats.ephemerides import read_ephemerides

if TYPE_CHECKING:
    from tle.ephemeris import Segment

ORDER = 16
"""Of the differences: what is smooth is gone from them."""


def held_out_mm(segment: Segment) -> np.ndarray:
    """Return what is missed at every second row."""
    edge = segment.interpolation.rows // 2
    held = np.arange(1, len(segment.since_s) - 1, 2)[edge:-edge]
    velocity = segment.velocity_km_s
    some = replace(
        segment,
        since_s=segment.since_s[::2],
        place_km=segment.place_km[::2],
        velocity_km_s=None if velocity is None else velocity[::2],
    )
    places = some.native_many(segment.since_s[held])[:3].T
    return np.linalg.norm(places - segment.place_km[held], axis=1) * 1e6


def scatter_mm(segment: Segment) -> float:
    """Return the standard deviation of rows, all three axes, that their differences show."""
    differences = np.diff(segment.place_km, n=ORDER, axis=0) * 1e6
    grown = math.comb(2 * ORDER, ORDER)
    return float(np.sqrt(np.sum(differences**2, axis=1).mean() / grown))


def left_out_mm(segment: Segment) -> np.ndarray:
    """Return how far two rows more would move the places half way between the rows."""
    edge = segment.interpolation.rows + 2
    since = 0.5 * (segment.since_s[1:] + segment.since_s[:-1])[edge:-edge]
    more = replace(segment.interpolation, rows=segment.interpolation.rows + 2)
    places = [one.native_many(since)[:3] for one in (segment, replace(segment, interpolation=more))]
    return np.linalg.norm(places[1] - places[0], axis=0) * 1e6


def main() -> None:
    for path in sys.argv[1:]:
        segments = [
            segment
            for one in read_ephemerides(path)
            for segment in one.segments
            if len(segment.since_s) > 4 * (segment.interpolation.rows + 2)
        ]
        if not segments:
            print(f"{Path(path).name}: too few rows")
            continue
        held = [held_out_mm(one) for one in segments]
        scatter = max(scatter_mm(one) for one in segments)
        left = [left_out_mm(one) for one in segments]
        step_s = float(np.median(np.diff(segments[0].since_s)))
        print(
            f"{Path(path).name}: {len(segments)} objects, {sum(map(len, held))} rows held out, "
            f"at {2 * step_s:g} s at most {max(one.max() for one in held):.1f} mm; "
            f"scatter {scatter:.1f} mm; at its step of {step_s:g} s at most "
            f"{max(one.max() for one in left):.2f} mm"
        )


if __name__ == "__main__":
    main()
