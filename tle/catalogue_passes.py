"""The passes of a whole catalogue over one site."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, overload

import numpy as np

from tle.catalogue_search import CatalogueSearch, SearchTask, shared
from tle.crossing_columns import joined, select
from tle.horizon import Horizon
from tle.instants import Utc
from tle.passes import HOUR_S, Pass, check_hours, passes_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from numpy.typing import NDArray

    from tle.crossings import Crossings
    from tle.earth import EarthOrientation
    from tle.elements import Elements
    from tle.errors import PropagationError
    from tle.site import Site

    Index = NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class SatellitePass:
    """A pass and the elements of the satellite that makes it."""

    elements: Elements
    seen: Pass


class CataloguePasses(Sequence[SatellitePass]):
    """The passes found, in order of object and time; each is made when it is asked for.

    `found` holds them as columns: `found.obj` are indices into `elements`, times are seconds since `start`,
    NaN where cut by the span's ends. `failed` are the objects that SGP4 could not place at all, with its
    reason.
    """

    def __init__(
        self,
        task: SearchTask,
        found: Crossings,
        failed: list[tuple[Elements, PropagationError]],
    ) -> None:
        """Keep what `find_catalogue_passes` was asked and what it found."""
        self.task = task
        self.elements = task.elements
        self.start = Utc(task.span[0])
        self.found = found
        self.failed = failed

    def __len__(self) -> int:
        """Return how many passes there are."""
        return len(self.found.obj)

    @overload
    def __getitem__(self, index: int) -> SatellitePass: ...
    @overload
    def __getitem__(self, index: slice) -> list[SatellitePass]: ...
    def __getitem__(self, index: int | slice) -> SatellitePass | list[SatellitePass]:
        """Return one pass, or a list of them."""
        if isinstance(index, slice):
            return self.take(np.arange(len(self))[index])
        if not -len(self) <= index < len(self):
            raise IndexError(index)
        return self.take(np.array([index % len(self)]))[0]

    def __iter__(self) -> Iterator[SatellitePass]:
        """Go through all passes."""
        return iter(self.take(np.arange(len(self))))

    def take(self, index: Index) -> list[SatellitePass]:
        """Return the passes of these indices, in their order."""
        chosen = select(self.found, index)
        passes = passes_of(chosen, float(self.start.unix_s))
        return [SatellitePass(self.elements[o], p) for o, p in zip(chosen.obj.tolist(), passes, strict=True)]


def find_catalogue_passes(
    elements: Sequence[Elements],
    site: Site,
    start: Utc,
    hours: float,
    horizon: Horizon | float = 10.0,
    *,
    earth: EarthOrientation | None = None,
    workers: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> CataloguePasses:
    """Return the passes of many satellites over a site, geometric and airless, as `find_passes` does for one.

    `horizon` is a least altitude in degrees, or a `Horizon` with a mask.
    No pass longer than half a second is missed; see `gate` and `crossings` for the proof. `progress` is
    called now and then with how many objects are done and how many there are. `workers` above 1 share large
    catalogues among as many processes; a script that asks for them must guard its own work by
    `if __name__ == "__main__"`. Raises TimeRangeError, SiteError; what SGP4 refuses is listed in `failed`.
    """
    check_hours(hours)
    level = horizon if isinstance(horizon, Horizon) else Horizon(horizon)
    task = SearchTask(elements, site, (float(start.unix_s), hours * HOUR_S), level, earth)
    search = CatalogueSearch(task)
    pieces: list[Crossings] = []
    left: list[int] = []
    done = 0
    for count, found, rest in shared(search, search.chunks(), workers):
        pieces.append(found)
        left += rest
        done += count
        if progress is not None:
            progress(done, len(elements))
    failed = search.one_by_one(sorted(left), pieces)
    return CataloguePasses(task, joined(pieces), failed)
