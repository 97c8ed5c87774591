"""Objects in deep space, by the `sgp4` package: when they may be above a horizon, and where they are."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from tle.arcs import Windows, anomaly_pieces
from tle.deep_gate import MeanOrbits, deep_windows, drag_rad, gated
from tle.errors import PropagationError
from tle.instants import DAY_S, UNIX_EPOCH_JD
from tle.near_earth import start_near_earth

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from tle.arcs import Pieces
    from tle.elements import Elements
    from tle.ground import Ground

    Array = NDArray[np.float64]
    Index = NDArray[np.intp]


class DeepSpace:
    """Some objects with periods of 225 minutes and more over a site, during a span of (POSIX) seconds."""

    def __init__(self, elements: Sequence[Elements], ground: Ground, span: tuple[float, float]) -> None:
        """Start SGP4 for each."""
        self._elements, self._ground = elements, ground
        self._start_s, self._span_s = span
        self._records = [_record(one) for one in elements]

    def windows(self, lowest_deg: float) -> tuple[Windows, Pieces]:
        """Return the windows outside which nothing is above an altitude in degrees, and pieces of them."""
        orbits = self.mean_orbits()
        is_gated = gated(orbits, self._span_s)
        open_, closed = np.flatnonzero(~is_gated), np.flatnonzero(is_gated)
        span = (self._start_s, self._span_s)
        some, (window, first, last) = deep_windows(orbits.take(closed), self._ground, span, lowest_deg)
        each = [
            anomaly_pieces(self._elements[i], *span, len(some.obj) + k) for k, i in enumerate(open_.tolist())
        ]
        windows = Windows(
            np.concatenate([closed[some.obj], open_]),
            np.concatenate([some.first_s, np.zeros(len(open_))]),
            np.concatenate([some.last_s, np.full(len(open_), self._span_s)]),
        )
        return windows, (
            np.concatenate([window, *(piece[0] for piece in each)]),
            np.concatenate([first, *(piece[1] for piece in each)]),
            np.concatenate([last, *(piece[2] for piece in each)]),
        )

    def places(self, obj: Index, since_s: Array) -> Array:
        """Return places east, north, up, km, shape (3, k, n), of objects by index (k,) at (k, n) seconds."""
        unix_s = self._start_s + since_s
        days = np.floor(unix_s / DAY_S)
        jd, fraction = days + UNIX_EPOCH_JD, (unix_s - days * DAY_S) / DAY_S
        # Resonant orbits are integrated from the epoch on: one object after the other, in order of time.
        order = np.lexsort((since_s[:, 0], obj))
        jd, fraction = jd[order], fraction[order]
        places = np.full((*since_s.shape, 3), np.nan)
        edges = np.flatnonzero(np.diff(obj[order], prepend=-1, append=-1)).tolist()
        for low, high in pairwise(edges):
            record = self._records[int(obj[order[low]])]
            if record is None:
                continue
            code, r, _ = record.sgp4_array(jd[low:high].ravel(), fraction[low:high].ravel())
            if code.any():
                r[code != 0] = math.nan
            places[order[low:high]] = r.reshape(high - low, -1, 3)
        x, y, z = np.ascontiguousarray(places.transpose(2, 0, 1))
        return self._ground.east_north_up(unix_s, (x, y, z))

    def mean_orbits(self) -> MeanOrbits:
        """Return the mean orbits in the middle of the span."""
        middle_s = self._start_s + 0.5 * self._span_s
        days = math.floor(middle_s / DAY_S)
        jd, fraction = days + UNIX_EPOCH_JD, middle_s / DAY_S - days
        rows = np.full((len(self._records), 6), math.nan)
        for k, record in enumerate(self._records):
            if record is not None and record.sgp4(jd, fraction)[0] == 0:
                # SGP4 leaves the mean elements of the last instant in its record.
                rows[k] = (record.nm, record.em, record.im, record.Om, record.om, record.mm)
        drag = drag_rad(start_near_earth(self._elements), middle_s, self._span_s)
        motion, eccentricity, inclination, node, perigee, anomaly = rows.T
        return MeanOrbits(motion, eccentricity, inclination, node, perigee, anomaly, drag)


def _record(elements: Elements):  # type: ignore[no-untyped-def]
    """Return SGP4's record, None where it takes the elements for none."""
    try:
        return elements.satrec()
    except PropagationError:
        return None
