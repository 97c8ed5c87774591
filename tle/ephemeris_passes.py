"""The passes of what tables and bodies give, searched wherever there are places."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

import numpy as np

from tle.crossings import Windows, joined
from tle.errors import PropagationError
from tle.horizon import Horizon
from tle.passes import (
    HOUR_S,
    LONGEST_PIECE_S,
    CataloguePasses,
    CatalogueSearch,
    SearchTask,
    check_hours,
    ephemeris_arcs,
    ephemeris_crossings,
    spans_within,
)
from tle.propagator import Propagator

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from tle.crossings import Arcs, Crossings
    from tle.elements import Elements
    from tle.ephemeris import Ephemeris
    from tle.instants import Utc
    from tle.site import Site

    Index = NDArray[np.intp]

    Array = NDArray[np.float64]


class EphemerisSearch(CatalogueSearch):
    """A search that asks each object's own states, instead of SGP4 for many at a time."""

    def shapes(self, obj: Index) -> tuple[Array, Array]:
        """Return how long pieces may be at first, and an eccentricity that lets polynomials be long."""
        return np.full(len(obj), LONGEST_PIECE_S), np.ones(len(obj))

    def ends(self, found: Crossings) -> tuple[Array, Array]:
        """Return the first and last second of passes, within the stretch of places of the highest point."""
        first_s, last_s = np.empty(len(found.obj)), np.empty(len(found.obj))
        for one in np.unique(found.obj).tolist():
            rows = np.flatnonzero(found.obj == one)
            starts, stops = spans_within(self.propagator(one), self.start_s, self.span_s)
            which = np.searchsorted(starts, found.culminate_s[rows], "right") - 1
            first_s[rows], last_s[rows] = starts[np.maximum(which, 0)], stops[np.maximum(which, 0)]
        cut_first, cut_last = np.isnan(found.rise_s), np.isnan(found.set_s)
        return np.where(cut_first, first_s, found.rise_s), np.where(cut_last, last_s, found.set_s)

    def are_deep(self, obj: Index) -> NDArray[np.bool_]:
        """Let all have polynomials that are long enough for deep space."""
        return np.ones(len(obj), dtype=bool)

    def arcs(self, windows: Windows, deep: bool) -> tuple[Arcs, Index]:
        """Return the ways of objects in windows; none is left out. Raises EphemerisError."""
        names, obj = np.unique(windows.obj, return_inverse=True)
        propagators = [self.propagator(o) for o in names.tolist()]
        local = Windows(obj, windows.first_s, windows.last_s)
        return ephemeris_arcs(propagators, local, self.start_s), np.empty(0, dtype=np.intp)

    def propagator(self, obj: int) -> Propagator:
        """Return what places an object, by index. Raises PropagationError, EphemerisError."""
        return Propagator(self.elements[obj], self.task.site, earth=self.earth, place="geometric")

    def find(self, obj: int) -> Crossings:
        """Return when an object, by index, is above the horizon. Raises PropagationError, EphemerisError."""
        found = ephemeris_crossings(self.propagator(obj), self.start_s, self.span_s, self.horizon)
        return found.renamed(np.array([obj], dtype=np.intp))


def find_ephemeris_passes(
    objects: Sequence[Elements | Ephemeris],
    site: Site,
    start: Utc,
    hours: float,
    horizon: Horizon | float = 10.0,
) -> CataloguePasses:
    """Return the passes of a few objects over a site, geometric and airless, as `find_catalogue_passes` does.

    What has no place in the span is listed in `failed`. Raises TimeRangeError, SiteError, EphemerisError.
    """
    check_hours(hours)
    level = horizon if isinstance(horizon, Horizon) else Horizon(horizon)
    # A catalogue's passes ask their objects for names, numbers and epochs alone, which all ephemerides have.
    elements = cast("Sequence[Elements]", objects)
    task = SearchTask(elements, site, (float(start.unix_s), hours * HOUR_S), level, None)
    search = EphemerisSearch(task)
    pieces: list[Crossings] = []
    failed: list[tuple[Elements, PropagationError]] = []
    for index, one in enumerate(elements):
        try:
            pieces.append(search.find(index))
        except PropagationError as error:
            failed.append((one, error))
    return CataloguePasses(search, joined(pieces), failed)
