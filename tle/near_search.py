"""The search for near-Earth objects: gate, SGP4 round possible passes, polynomials, roots."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tle.arcs import even_pieces, fit_arcs, longest_piece_s, terms_for
from tle.crossings import Crossings, find_crossings
from tle.gate import orbit_bounds, possible_windows
from tle.near_earth import teme_km

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tle.ground import Ground
    from tle.horizon import Horizon
    from tle.near_earth import NearEarth

    Array = NDArray[np.float64]
    Index = NDArray[np.intp]


def near_crossings(
    c: NearEarth, ground: Ground, span: tuple[float, float], horizon: Horizon
) -> tuple[Crossings, Index]:
    """Return the crossings of near-Earth objects, by index, and those that need a search of their own.

    Those are the ones that decay, or drag beyond all bounds. `span` is its first second (POSIX) and length.
    """
    start_s, span_s = span
    bounds = orbit_bounds(c, start_s, span_s)
    regular = np.flatnonzero(bounds.regular)
    left = np.flatnonzero(~bounds.regular)
    if len(left):
        c, bounds = c.take(regular), bounds.take(regular)
    windows = possible_windows(c, bounds, ground, start_s, span_s, horizon.lowest_deg)
    longest_s = longest_piece_s(c.period_s, c.ecco)[windows.obj]
    arcs, without = fit_arcs(
        windows,
        even_pieces(windows, longest_s),
        lambda obj, since_s: near_places(c, ground, start_s, obj, since_s),
        terms_for(float(c.ecco.max(initial=0.0))),
    )
    found = find_crossings(arcs, horizon)
    return found.renamed(regular), np.concatenate([left, regular[without]])


def near_places(c: NearEarth, ground: Ground, start_s: float, obj: Index, since_s: Array) -> Array:
    """Return places east, north, up, km, shape (3, k, n), of objects by index (k,) at (k, n) seconds."""
    unix_s = start_s + since_s
    return ground.east_north_up(unix_s, teme_km(c.spread(obj).column(), unix_s))
