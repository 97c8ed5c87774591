"""Land and sea: the coast lines of Natural Earth's 1:50 million map, to 0.05° (`python -m tools.land`).

Islands of less than some ten kilometres are not in it.
"""

from __future__ import annotations

import gzip
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

EARTH_KM = 6371.0


@cache
def coast_lines() -> list[Array]:
    """Return the closed lines around all land: degrees east and north, shapes (n, 2).

    Those that cross 180° go on past it, or past -180°.
    """
    text = gzip.decompress((files("sattrack") / "data" / "land.txt.gz").read_bytes()).decode()
    return [np.array([pair.split(",") for pair in line.split()], dtype=float) for line in text.splitlines()]


def offshore_km(latitude_deg: float, longitude_deg: float) -> float:
    """Return the distance to the nearest point of a coast line, 0 on land."""
    crossings = np.zeros(3, dtype=int)
    longitudes = longitude_deg + np.array([[-360.0], [0.0], [360.0]])
    for line in coast_lines():
        east, north = line.T
        above = north > latitude_deg
        crosses = np.flatnonzero(above[1:] != above[:-1])
        share = (latitude_deg - north[crosses]) / (north[crosses + 1] - north[crosses])
        at = east[crosses] + share * (east[crosses + 1] - east[crosses])
        crossings += np.sum(at > longitudes, axis=1)
    if (crossings % 2).any():
        return 0.0
    east, north = np.radians(np.concatenate(coast_lines())).T
    latitude, longitude = np.radians([latitude_deg, longitude_deg])
    # The haversine of the angle between.
    half = np.sin((north - latitude) / 2.0) ** 2
    half += np.cos(latitude) * np.cos(north) * np.sin((east - longitude) / 2.0) ** 2
    return 2.0 * EARTH_KM * float(np.arcsin(np.sqrt(half.min())))
