"""How well rows of real ephemeris files are interpolated: figures of each file, the worst object's.

    python bench/held_out.py FILE [FILE ...]

*held out*: what is missed at every second row by the others, so at twice the file's step. *one out*: what
is missed at a row when its neighbours are there. Both count the row's own error too, and *one out* nearly
doubles it. *scatter*: by how much the rows themselves are off any smooth curve, by their 16th differences;
at a row, nothing can be missed by less. *at its step*: half way between the rows as they stand, how far the
format's polynomial is from one through two rows more, and so about what it leaves out. Rows at either end,
where polynomials lean to one side, are left out.

A program that turns the Earth by a Julian date in one double turns it by up to 20 us too far or not far
enough, 15 mm at LAGEOS. Where a file becomes smoother when that is undone, its figures are printed for both.
"""

from __future__ import annotations

import math
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from tle.ephemeris import Segment, missed_km
from tle.formats.ephemerides import read_ephemerides
from tle.instants import DAY_S, leaps_s

ORDER = 16
"""Of the differences: what is smooth is gone from them."""
TURN_RAD_S = 7.292115e-5


def held_out_mm(segment: Segment) -> np.ndarray:
    """Return what is missed at every second row."""
    edge = segment.interpolation.rows // 2
    return missed_km(segment, np.arange(1, len(segment.since_s) - 1, 2))[edge:-edge] * 1e6


def one_out_mm(segment: Segment) -> np.ndarray:
    """Return what is missed at each row when none of its neighbours is left out."""
    rows = segment.interpolation.rows
    last = len(segment.since_s) - rows
    left_out = [np.arange(rows + k, last, rows + 1) for k in range(rows + 1)]
    return np.concatenate([missed_km(segment, held) * 1e6 for held in left_out])


def scatter_mm(segment: Segment) -> float:
    """Return the standard deviation of rows, all axes, that their differences show; NaN of uneven steps."""
    if np.ptp(np.diff(segment.since_s)) > 1e-3:
        return math.nan
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


def turned_back(segment: Segment) -> Segment:
    """Return rows turned about the pole by what a Julian date of UTC loses in one double."""
    tai_s = segment.zero_s + segment.since_s
    days = (tai_s - leaps_s(tai_s)) / DAY_S
    whole, part = np.divmod(days, 1.0)
    lost_s = ((2440587.5 + whole + part) - (2440587.5 + whole) - part) * DAY_S
    c, s = np.cos(TURN_RAD_S * lost_s), np.sin(TURN_RAD_S * lost_s)
    x, y, z = segment.place_km.T
    return replace(segment, place_km=np.stack([x * c - y * s, x * s + y * c, z], axis=1))


def figures(segments: list[Segment]) -> str:
    """Return a line's worth of figures, millimetres."""
    held = [held_out_mm(one) for one in segments]
    single = [one_out_mm(one) for one in segments]
    step_s = float(np.median(np.diff(segments[0].since_s)))
    return (
        f"{sum(map(len, held))} rows held out, at {2 * step_s:g} s at most "
        f"{max(one.max() for one in held):.1f} mm; one out at most {max(one.max() for one in single):.1f} "
        f"mm, {max(np.sqrt((one**2).mean()) for one in single):.1f} mm rms; "
        f"scatter {max(map(scatter_mm, segments)):.1f} mm; at its step of {step_s:g} s at most "
        f"{max(left_out_mm(one).max() for one in segments):.2f} mm"
    )


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
        name = f"{Path(path).name}, {segments[0].interpolation.words}"
        print(f"{name}: {len(segments)} objects, {figures(segments)}")
        back = [turned_back(one) for one in segments]
        if max(map(scatter_mm, back)) < 0.5 * max(map(scatter_mm, segments)):
            print(f"{name}, the rounding of its Julian dates undone: {figures(back)}")


if __name__ == "__main__":
    main()
