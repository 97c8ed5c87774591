"""The passes of a whole catalogue over one site, searched in chunks by this process or by several."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, overload

import numpy as np

from tle.arcs import Windows, even_pieces, fit_arcs, longest_piece_s, terms_for
from tle.crossings import Crossings, crossings_of, find_crossings, joined, select
from tle.earth import EarthOrientation, Ground
from tle.errors import PropagationError
from tle.gate import drag_share, near_crossings, near_places
from tle.horizon import Horizon
from tle.instants import DAY_S, Utc
from tle.near_earth import DEEP_SPACE_MIN, brouwer_mean_motion, start_near_earth
from tle.passes import HOUR_S, Pass, check_hours, find_passes, passes_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from concurrent.futures import Future

    from numpy.typing import NDArray

    from tle.arcs import Arcs
    from tle.deep_space import DeepSpace
    from tle.elements import Elements
    from tle.near_earth import NearEarth
    from tle.site import Site

    Array = NDArray[np.float64]
    Index = NDArray[np.intp]
    # How many objects a chunk had, what was found, and which of them need a search of their own.
    Found = tuple[int, Crossings, list[int]]

# A chunk's arrays of this many stretches stay within a processor's cache, and memory within bounds.
_STRETCHES_A_CHUNK = 48000
_DEEP_A_CHUNK = 150
_STRETCHES_A_SECOND = 8.0 / 6000.0
# A process takes longer to start than this many objects take to be searched.
_FEWEST_TO_SHARE = 4000
_AHEAD = 2
_DECAYED = 6


@dataclass(frozen=True, slots=True)
class SearchTask:
    """What to search: `span` is its first second (POSIX) and its length in seconds."""

    elements: Sequence[Elements]
    site: Site
    span: tuple[float, float]
    horizon: Horizon
    earth: EarthOrientation | None


@dataclass(frozen=True, slots=True)
class Chunk:
    """Objects to be searched together, by index; `near` is None where they are in deep space."""

    index: Index
    near: NearEarth | None


class CatalogueSearch:
    """A search for the passes of many objects, a chunk at a time. Raises TimeRangeError, SiteError."""

    def __init__(self, task: SearchTask) -> None:
        """Look up what all chunks share."""
        self.task = task
        self.elements = task.elements
        self.start_s, self.span_s = task.span
        self.horizon = task.horizon
        self.earth = task.earth or EarthOrientation.installed()
        self.ground = Ground(task.site, self.earth, self.start_s, self.span_s)

    def chunks(self) -> list[Chunk]:
        """Return all objects in chunks of like eccentricity, as Kepler's equation likes; deep space first."""
        if not self.elements:
            return []
        period_s = 120.0 * math.pi / brouwer_mean_motion(self.elements)
        order = np.argsort([e.eccentricity for e in self.elements], kind="stable")
        is_deep = period_s[order] >= DEEP_SPACE_MIN * 60.0
        near, deep = order[~is_deep], order[is_deep]
        near_size = max(1, int(_STRETCHES_A_CHUNK / max(1.0, self.span_s * _STRETCHES_A_SECOND)))
        deep_size = max(1, int(_DEEP_A_CHUNK / max(1.0, self.span_s / DAY_S)))
        c = start_near_earth([self.elements[i] for i in near.tolist()])
        parts = [np.arange(k, min(k + near_size, len(near))) for k in range(0, len(near), near_size)]
        return [
            *(Chunk(deep[k : k + deep_size], None) for k in range(0, len(deep), deep_size)),
            *(Chunk(near[part], c.take(part)) for part in parts),
        ]

    def run(self, chunk: Chunk) -> Found:
        """Search one chunk."""
        return self._deep(chunk.index) if chunk.near is None else self._near(chunk.index, chunk.near)

    def are_deep(self, obj: Index) -> NDArray[np.bool_]:
        """Tell which objects, by index, take 225 minutes or longer to go round."""
        if len(obj) == 0:
            return np.empty(0, dtype=bool)
        period_s = 120.0 * math.pi / brouwer_mean_motion([self.elements[i] for i in obj.tolist()])
        deep: NDArray[np.bool_] = period_s >= DEEP_SPACE_MIN * 60.0
        return deep

    def ends(self, found: Crossings) -> tuple[Array, Array]:
        """Return the first and last second of passes, within the span."""
        return np.nan_to_num(found.rise_s, nan=0.0), np.where(np.isnan(found.set_s), self.span_s, found.set_s)

    def shapes(self, obj: Index) -> tuple[Array, Array]:
        """Return how long pieces of the ways of objects by index may be, seconds, and the eccentricities."""
        elements = [self.elements[i] for i in obj.tolist()]
        e = np.array([one.eccentricity for one in elements])
        return longest_piece_s(np.array([one.period_s for one in elements]), e), e

    def arcs(self, windows: Windows, deep: bool) -> tuple[Arcs, Index]:
        """Return the ways of objects, all deep or all near, in windows, and objects that have none."""
        names, obj = np.unique(windows.obj, return_inverse=True)
        elements = [self.elements[i] for i in names.tolist()]
        longest_s, e = self.shapes(names)
        local = Windows(obj, windows.first_s, windows.last_s)
        pieces = even_pieces(local, longest_s[obj])
        terms = terms_for(float(e.max(initial=0.0)))
        if deep:
            records = self._deep_space(names)
            arcs, without = fit_arcs(local, pieces, records.places, terms)
        else:
            c = start_near_earth(elements)
            arcs, without = fit_arcs(
                local, pieces, lambda o, s: near_places(c, self.ground, self.start_s, o, s), terms
            )
        return arcs, names[without]

    def one_by_one(self, left: list[int], pieces: list[Crossings]) -> list[tuple[Elements, PropagationError]]:
        """Search objects that decay or drag beyond all bounds; add what is found, return the refused."""
        if not left:
            return []
        # Few searches come to this, and none of a satellite that keeps its orbit.
        from tle.propagator import Propagator

        task, failed = self.task, []
        for index in left:
            elements = self.elements[index]
            try:
                self._check_drag(elements)
                propagator = Propagator(elements, task.site, earth=self.earth)
                passes = find_passes(
                    propagator,
                    Utc(self.start_s),
                    self.span_s / HOUR_S,
                    self.horizon.min_alt_deg,
                    self.horizon.mask,
                )
            except PropagationError as error:
                failed.append((elements, error))
                continue
            pieces.append(crossings_of(passes, index, self.start_s))
        return failed

    def _check_drag(self, elements: Elements) -> None:
        """Raise PropagationError where SGP4's series for drag has outgrown the orbit before the span begins.

        SGP4 itself reports nothing then, and places the object anywhere up to millions of kilometres away.
        """
        if (
            elements.period_s < DEEP_SPACE_MIN * 60.0
            and drag_share(start_near_earth([elements]), self.start_s) > 1
        ):
            age_days = elements.age_s(Utc(self.start_s)) / DAY_S
            raise PropagationError(
                f"{elements.label} ({elements.catalog_number}) cannot be placed {age_days:+.1f} days from "
                "the epoch of its elements: its drag would have ended the orbit before: use newer elements",
                _DECAYED,
            )

    def _near(self, chunk: Index, c: NearEarth) -> Found:
        found, left = near_crossings(c, self.ground, self.task.span, self.horizon)
        return len(chunk), found.renamed(chunk), chunk[left].tolist()

    def _deep_space(self, obj: Index) -> DeepSpace:
        # A search for one satellite near the Earth starts sooner without what only deep space needs.
        from tle.deep_space import DeepSpace

        return DeepSpace([self.elements[i] for i in obj.tolist()], self.ground, self.task.span)

    def _deep(self, chunk: Index) -> Found:
        records = self._deep_space(chunk)
        windows, pieces = records.windows(self.horizon.lowest_deg)
        terms = terms_for(self.elements[int(chunk[-1])].eccentricity)
        arcs, without = fit_arcs(windows, pieces, records.places, terms)
        found = find_crossings(arcs, self.horizon)
        return len(chunk), found.renamed(chunk), chunk[without].tolist()


def shared(search: CatalogueSearch, chunks: list[Chunk], workers: int) -> Iterator[Found]:
    """Yield what is found in each chunk, in any order, the work shared among so many processes."""
    if workers <= 1 or len(search.elements) * max(1.0, search.span_s / DAY_S) < _FEWEST_TO_SHARE:
        for chunk in chunks:
            yield search.run(chunk)
    else:
        yield from _by_processes(search, chunks, workers)


def _by_processes(search: CatalogueSearch, chunks: list[Chunk], workers: int) -> Iterator[Found]:
    """Yield what is found in each chunk by processes of their own."""
    from concurrent.futures import ProcessPoolExecutor
    from multiprocessing import get_context

    flying: deque[Future[Found]] = deque()
    # What others search comes with the chunk; SGP4 for deep space, which needs the elements, stays here.
    todo = deque(chunk for chunk in chunks if chunk.near is not None)
    own = deque(chunk for chunk in chunks if chunk.near is None)
    with ProcessPoolExecutor(
        workers - 1,
        mp_context=get_context("spawn"),
        initializer=_begin,
        initargs=(replace(search.task, elements=()),),
    ) as pool:
        while own or todo or flying:
            while todo and len(flying) < _AHEAD * (workers - 1):
                flying.append(pool.submit(_search_chunk, todo.popleft()))
            # This process works along, so that nothing waits while the others start.
            if own or todo:
                yield search.run((own or todo).popleft())
            while flying and (flying[0].done() or not (own or todo)):
                yield flying.popleft().result()


class _Process:
    """The search of this process when it works for another."""

    search: CatalogueSearch


def _begin(task: SearchTask) -> None:
    _Process.search = CatalogueSearch(task)


def _search_chunk(chunk: Chunk) -> Found:
    return _Process.search.run(chunk)


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

    def search(self) -> CatalogueSearch:
        """Return what knows the ways of the objects."""
        return CatalogueSearch(self.task)

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
