"""A made-up catalogue of known kinds of orbit, a list of stations, and a data set's files as bytes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tle.elements import Elements
from tle.instants import Utc
from tle.sources import write_elements

if TYPE_CHECKING:
    from pathlib import Path

EPOCH = Utc.parse("2026-10-02T00:00:00Z")
START = "2026-10-02T15:00:00Z"
STATIONS = """\
[[stations]]
name = "north"
latitude_deg = 52.1541
longitude_deg = 4.4908

[[stations]]
name = "south"
latitude_deg = -31.2733
longitude_deg = 149.0617
height_m = 1165
min_altitude_deg = 15
"""


def made_up(low: int, seed: int = 1) -> list[Elements]:
    """Return so many satellites in low orbits, and with them a Molniya, one at 24 h, one about to decay."""
    rng = np.random.default_rng(seed)

    def one(number: int, name: str, shape: tuple[float, float, float, float], drag: float = 1e-5) -> Elements:
        inclination, eccentricity, perigee, motion = shape
        node, anomaly = rng.uniform(0.0, 360.0, 2).round(4).tolist()
        return Elements(
            name,
            number,
            "U",
            f"2020-{number % 900 + 1:03d}A",
            EPOCH,
            inclination,
            node,
            eccentricity,
            perigee,
            anomaly,
            motion,
            0.0,
            0.0,
            drag,
        )

    found = [
        one(
            90001 + k,
            f"LOW {k}",
            (round(float(rng.uniform(40.0, 99.0)), 4), 0.001, 90.0, round(float(rng.uniform(13.0, 15.6)), 8)),
        )
        for k in range(low)
    ]
    return [
        *found,
        one(95001, "MOLNIYA", (63.4, 0.72, 270.0, 2.006)),
        one(95002, "ALWAYS UP", (0.05, 0.0002, 0.0, 1.0027)),
        one(95003, "DECAYING", (51.6, 0.0005, 80.0, 16.44), 0.00035),
    ]


def written(folder: Path, low: int = 40) -> tuple[Path, Path]:
    """Write elements and stations into a folder; return both files."""
    elements, stations = folder / "made_up.tle", folder / "stations.toml"
    elements.write_text(write_elements(made_up(low), "tle"))
    stations.write_text(STATIONS)
    return elements, stations


def contents(folder: Path) -> dict[str, bytes]:
    """Return all files below a folder by their place in it."""
    return {
        str(file.relative_to(folder)): file.read_bytes()
        for file in sorted(folder.rglob("*"))
        if file.is_file()
    }
