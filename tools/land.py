"""Writes the coast lines that `sattrack network` knows: `python -m tools.land LAND.json`.

LAND.json is land-50m.json as the npm package world-atlas 2.0.2 carries it: TopoJSON of Natural Earth's
land at 1:50 million (naturalearthdata.com, public domain).
"""

from __future__ import annotations

import gzip
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

TOLERANCE_DEG = 0.05
TARGET = Path(__file__).parent.parent / "sattrack" / "data" / "land.txt.gz"

Line = np.ndarray[Any, np.dtype[np.float64]]


def rings(topology: dict[str, Any]) -> list[Line]:
    """Return the closed lines around all land, longitudes and latitudes in degrees, shapes (n, 2)."""
    scale, shift = (np.array(topology["transform"][key]) for key in ("scale", "translate"))
    arcs = [np.cumsum(np.array(arc, dtype=np.float64), axis=0) * scale + shift for arc in topology["arcs"]]
    found = []
    for shape in topology["objects"]["land"]["geometries"]:
        for polygon in shape["arcs"] if shape["type"] == "MultiPolygon" else [shape["arcs"]]:
            for ring in polygon:
                parts = [arcs[k] if k >= 0 else arcs[~k][::-1] for k in ring]
                found.append(unrolled(np.concatenate([parts[0], *(part[1:] for part in parts[1:])])))
    return [line for line in found if np.ptp(line[:, 1]) > 0.0]


def unrolled(line: Line) -> Line:
    """Return a closed line without steps at 180°, so past it; one around the south pole closes there."""
    east, north = np.unwrap(line[:, 0], period=360.0), line[:, 1]
    east -= 360.0 * np.rint(0.5 * (east.min() + east.max()) / 360.0)
    if abs(east[-1] - east[0]) > 180.0:
        east, north = np.r_[east, east[-1], east[0], east[0]], np.r_[north, -90.0, -90.0, north[0]]
    return np.stack([east, north], axis=1)


def simpler(line: Line) -> Line:
    """Return a closed line without points nearer than the tolerance to the others (Douglas, Peucker 1973)."""
    far = int(np.argmax(np.hypot(*(line - line[0]).T)))
    keep = np.zeros(len(line), dtype=bool)
    keep[[0, far, -1]] = True
    left = [(0, far), (far, len(line) - 1)]
    while left:
        low, high = left.pop()
        if high - low < 2:
            continue
        along, offsets = line[high] - line[low], line[low + 1 : high] - line[low]
        length = np.hypot(*along)
        across = np.abs(along[0] * offsets[:, 1] - along[1] * offsets[:, 0]) / length if length else None
        across = np.hypot(*offsets.T) if across is None else across
        at = int(np.argmax(across))
        if across[at] > TOLERANCE_DEG:
            middle = low + 1 + at
            keep[middle] = True
            left += [(low, middle), (middle, high)]
    return line[keep] if keep.sum() > 3 else line


def main() -> None:
    """Write a line of text for each closed line."""
    lines = [simpler(ring) for ring in rings(json.loads(Path(sys.argv[1]).read_text(encoding="utf-8")))]
    text = "".join(" ".join(f"{x:.2f},{y:.2f}" for x, y in line) + "\n" for line in lines)
    TARGET.write_bytes(gzip.compress(text.encode(), mtime=0))
    sys.stdout.write(
        f"{TARGET.name}: {len(lines)} lines, {sum(map(len, lines))} points, {TARGET.stat().st_size} bytes\n"
    )


if __name__ == "__main__":
    main()
