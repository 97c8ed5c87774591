"""When what a table or a body gives is above a horizon: searched wherever there are places."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tle.arcs import ECCENTRIC_TERMS, Windows, even_pieces, fit_arcs
from tle.errors import EphemerisError
from tle.instants import Utc

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tle.arcs import Arcs, Index
    from tle.ephemeris import Ephemeris
    from tle.propagator import Propagator

    Array = NDArray[np.float64]

LONGEST_PIECE_S = 900.0
_SHORTEST_WINDOW_S = 1.0
# What has no range is taken for so far away: only its direction counts.
_FAR_KM = 1e6


def spans_within(ephemeris: Ephemeris, start_s: float, span_s: float) -> tuple[Array, Array]:
    """Return first and last seconds, after start_s (POSIX), for which there are places in a span; (k,)."""
    if not ephemeris.spans:
        return np.zeros(1), np.full(1, span_s)
    ends = np.array([[float(first.unix_s), float(last.unix_s)] for first, last in ephemeris.spans]) - start_s
    ends = np.clip(ends, 0.0, span_s)
    ends = ends[ends[:, 1] - ends[:, 0] > _SHORTEST_WINDOW_S]
    return ends[:, 0], ends[:, 1]


def ephemeris_arcs(propagator: Propagator, windows: Windows, start_s: float) -> Arcs:
    """Return one object's way over the site in windows, geometric. Raises EphemerisError."""
    seen = propagator.with_place("geometric")

    def sample(_: Index, since_s: Array) -> Array:
        there = seen.at(Utc(start_s + since_s.ravel()))
        alt, az = np.radians(there.alt_deg), np.radians(there.az_deg)
        range_km = np.where(np.isfinite(there.range_km), there.range_km, _FAR_KM)
        level = range_km * np.cos(alt)
        places = np.stack([level * np.sin(az), level * np.cos(az), range_km * np.sin(alt)])
        return places.reshape(3, *since_s.shape)

    pieces = even_pieces(windows, np.full(len(windows.obj), LONGEST_PIECE_S))
    arcs, without = fit_arcs(windows, pieces, sample, ECCENTRIC_TERMS)
    if len(without):
        raise EphemerisError(
            f"{propagator.elements.label}: its places are not smooth enough to search for passes",
            source=propagator.elements.provenance,
        )
    return arcs
