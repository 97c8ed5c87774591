"""When a satellite, or each of a catalogue, is above the horizon of a site; geometric and airless.

The horizon is a least altitude, with a skyline where that is higher. A catalogue is searched in chunks, by
this process or by several; what tables and bodies give, wherever there are places.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple, cast, overload

import numpy as np

from tle.bias import NO_BIAS
from tle.crossings import (
    ARC_COLUMNS,
    ECCENTRIC_TERMS,
    Crossings,
    Windows,
    anomaly_pieces,
    even_pieces,
    find_crossings,
    fit_arcs,
    joined,
    longest_piece_s,
    select,
    terms_for,
)
from tle.earth import EarthOrientation, Ground
from tle.elements import DECAYED, Elements
from tle.errors import EphemerisError, PropagationError, TimeRangeError
from tle.horizon import Horizon, HorizonMask
from tle.instants import DAY_S, Utc, as_utc
from tle.near_earth import DEEP_SPACE_MIN, start_near_earth
from tle.prefilter import drag_share, near_crossings, near_places
from tle.propagator import Propagator
from tle.workers import mapping

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from numpy.typing import NDArray

    from tle.crossings import Arcs
    from tle.ephemeris import Ephemeris
    from tle.instants import Instant
    from tle.near_earth import NearEarth
    from tle.prefilter import DeepSpace
    from tle.site import Site

    Array = NDArray[np.float64]
    Index = NDArray[np.intp]
    # How many objects a chunk had, what was found, and which of them need a search of their own.
    Found = tuple[int, Crossings, list[int]]

HOUR_S = 3600.0
MOST_HOURS = 24.0 * 366.0
LONGEST_PIECE_S = 900.0
_SHORTEST_WINDOW_S, _FAR_KM = 1.0, 1e6
_FAILURE_STEP_S = 60.0
_FAILURE_CLOSE_S = 0.01
# A chunk's arrays of this many stretches stay within a processor's cache, and memory within bounds.
_STRETCHES_A_CHUNK = 48000
_DEEP_A_CHUNK = 150
_STRETCHES_A_SECOND = 8.0 / 6000.0


class Pass(NamedTuple):
    """One time above the altitude asked for; degrees, azimuth from north through east.

    `rise_utc` and `set_utc`, and their azimuths, are None where the satellite was up already, or stays up,
    past the ends of the span; `culminate_utc` is the highest instant within it. `culminations_utc` are all
    instants at which the altitude turns from rising to falling: several in one pass of an eccentric orbit,
    none where a pass cut off only rises or falls.
    """

    rise_utc: Utc | None
    culminate_utc: Utc
    set_utc: Utc | None
    rise_az_deg: float | None
    culminate_az_deg: float
    set_az_deg: float | None
    max_alt_deg: float
    culminations_utc: tuple[Utc, ...] = ()

    def __repr__(self) -> str:
        """Show rise, culmination and set with their azimuths."""
        rise = (
            "up before"
            if self.rise_utc is None
            else f"rises {_when(self.rise_utc)} at {self.rise_az_deg:.0f}°"
        )
        end = "up after" if self.set_utc is None else f"sets {_when(self.set_utc)} at {self.set_az_deg:.0f}°"
        top = f"culminates {_when(self.culminate_utc)} at {self.max_alt_deg:.1f}° altitude"
        return f"<Pass {rise}, {top}, {end}>"


def find_passes(
    propagator: Propagator,
    start: Instant,
    hours: float,
    min_alt_deg: float = 10.0,
    mask: HorizonMask | None = None,
) -> list[Pass]:
    """Return the times above an altitude, in order, within so many hours from start; [] where there are none.

    With a mask the satellite must be above that too. The propagator's satellite, site, bias and Earth
    orientation count; its place and refraction do not. Where SGP4 fails within the span, the span ends there.
    No pass longer than half a second is missed; see `crossings` for the proof.
    Raises TimeRangeError, SiteError for an altitude that is none, PropagationError where SGP4 fails at once.
    """
    start = as_utc(start)
    check_hours(hours)
    horizon = Horizon(min_alt_deg, mask)
    start_s, span_s = float(start.unix_s), hours * HOUR_S
    elements = propagator.elements
    if not isinstance(elements, Elements):
        seen = propagator.with_place("geometric")
        return passes_of(ephemeris_crossings(seen, start_s, span_s, horizon), start_s)
    propagator.at(start)
    if propagator.bias == NO_BIAS:
        near = _near(propagator, elements, (start_s, span_s), horizon)
        if near is not None:
            return passes_of(near, start_s)
    seen = propagator.with_place("geometric")

    def sample(_: NDArray[np.intp], since_s: NDArray[np.float64]) -> NDArray[np.float64]:
        return _horizontal_places_km(seen, start_s, since_s)

    terms = terms_for(elements.eccentricity)
    for _ in range(2):
        windows = Windows(np.zeros(1, dtype=np.intp), np.zeros(1), np.full(1, span_s))
        arcs, without = fit_arcs(windows, anomaly_pieces(elements, start_s, span_s), sample, terms)
        if not len(without):
            break
        span_s = _good_span(seen, start_s, span_s)
    return passes_of(find_crossings(arcs, horizon), start_s)


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
        search: CatalogueSearch,
        found: Crossings,
        failed: list[tuple[Elements, PropagationError]],
    ) -> None:
        """Keep a search, which knows the ways of the objects, and what it found."""
        self.search = search
        self.task = task = search.task
        self.elements = task.elements
        self.start = Utc(task.span[0])
        self.found = found
        self.failed = failed

    def __repr__(self) -> str:
        """Show how many passes of how many objects there are, and from when on."""
        hours = self.task.span[1] / HOUR_S
        return (
            f"<CataloguePasses, {len(self)} of {len(self.elements)} objects in {hours:g} h from {self.start}>"
        )

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
    start: Instant,
    hours: float,
    horizon: Horizon | float = 10.0,
    *,
    earth: EarthOrientation | None = None,
    workers: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> CataloguePasses:
    """Return the passes of many satellites over a site, geometric and airless, as `find_passes` does for one.

    `horizon` is a least altitude in degrees, or a `Horizon` with a mask.
    No pass longer than half a second is missed; see `prefilter` and `crossings` for the proof. `progress` is
    called now and then with how many objects are done and how many there are. `workers` share large
    catalogues, see `workers.mapping`. Raises TimeRangeError, SiteError;
    what SGP4 refuses is listed in `failed`.
    """
    start = as_utc(start)
    check_hours(hours)
    level = horizon if isinstance(horizon, Horizon) else Horizon(horizon)
    task = SearchTask(elements, site, (float(start.unix_s), hours * HOUR_S), level, earth)
    search = CatalogueSearch(task)
    pieces: list[Crossings] = []
    left: list[int] = []
    done = 0
    chunks = search.chunks()
    with mapping(min(workers, len(chunks))) as mapped:
        for count, found, rest in mapped(search.run, chunks):
            pieces.append(found)
            left += rest
            done += count
            if progress is not None:
                progress(done, len(elements))
    failed = search.one_by_one(sorted(left), pieces)
    return CataloguePasses(search, joined(pieces), failed)


def _when(t: Utc) -> str:
    return t.isoformat("seconds")


def spans_within(propagator: Propagator, start_s: float, span_s: float) -> tuple[Array, Array]:
    """Return first and last seconds, after start_s (POSIX), for which there are places in a span; (k,).

    Raises EphemerisSpanError where there is none.
    """
    spans = propagator.elements.spans
    if not spans:
        return np.zeros(1), np.full(1, span_s)
    ends = np.array([[float(first.unix_s), float(last.unix_s)] for first, last in spans]) - start_s
    ends = np.clip(ends, 0.0, span_s)
    ends = ends[ends[:, 1] - ends[:, 0] > _SHORTEST_WINDOW_S]
    if len(ends) == 0:
        propagator.at(Utc(start_s))
    return ends[:, 0], ends[:, 1]


def ephemeris_crossings(propagator: Propagator, start_s: float, span_s: float, horizon: Horizon) -> Crossings:
    """Return when one object, of the geometric place, is above a horizon. Raises EphemerisError."""
    first_s, last_s = spans_within(propagator, start_s, span_s)
    windows = Windows(np.zeros(len(first_s), dtype=np.intp), first_s, last_s)
    return find_crossings(ephemeris_arcs([propagator], windows, start_s), horizon)


def _horizontal_places_km(propagator: Propagator, start_s: float, since_s: Array) -> Array:
    """Return places east, north and up of the site at seconds of any shape, shape (3, ...).

    What has no range is taken for far away: only its direction counts.
    """
    there = propagator.at(Utc(start_s + since_s.ravel()))
    alt, az = np.radians(there.alt_deg), np.radians(there.az_deg)
    range_km = there.range_km if propagator.elements.ranged else _FAR_KM
    level = range_km * np.cos(alt)
    places = np.stack([level * np.sin(az), level * np.cos(az), range_km * np.sin(alt)])
    return places.reshape(3, *since_s.shape)


def ephemeris_arcs(propagators: Sequence[Propagator], windows: Windows, start_s: float) -> Arcs:
    """Return the ways of objects, each of the geometric place, in windows. Raises EphemerisError."""

    def sample(obj: Index, since_s: Array) -> Array:
        places = np.empty((3, *since_s.shape))
        for one in np.unique(obj).tolist():
            rows = obj == one
            places[:, :, rows] = _horizontal_places_km(propagators[one], start_s, since_s[:, rows])
        return places

    pieces = even_pieces(windows, np.full(len(windows.obj), LONGEST_PIECE_S))
    arcs, without = fit_arcs(windows, pieces, sample, ECCENTRIC_TERMS)
    if len(without):
        source = propagators[int(without[0])].elements
        raise EphemerisError(
            f"{source.label}: its places are not smooth enough to search for passes", source=source.provenance
        )
    return arcs


def _near(
    propagator: Propagator, elements: Elements, span: tuple[float, float], horizon: Horizon
) -> Crossings | None:
    """Return the crossings of a near-Earth object that keeps its orbit, None for any other."""
    # What Brouwer's mean motion differs by from the elements' own is far below a tenth.
    if elements.period_s > 1.1 * 60.0 * DEEP_SPACE_MIN:
        return None
    c = start_near_earth([elements])
    if float(c.period_s[0]) >= 60.0 * DEEP_SPACE_MIN:
        return None
    ground = Ground(propagator.site, propagator.earth, *span)
    found, left = near_crossings(c, ground, span, horizon)
    return None if len(left) else found


def check_hours(hours: float) -> None:
    """Raise TimeRangeError for a span that cannot be searched."""
    if not 0.0 < hours <= MOST_HOURS:
        raise TimeRangeError(
            f"{hours} hours is no span to search: give from above 0 to {MOST_HOURS:.0f} hours"
        )


def crossings_of(passes: Sequence[Pass], obj: int, start_s: float) -> Crossings:
    """Return passes of one object as columns."""

    def column(name: str) -> Array:
        values = [getattr(p, name) for p in passes]
        return np.array(
            [math.nan if v is None else getattr(v, "unix_s", v) for v in values], dtype=np.float64
        )

    tops = [(k, t.unix_s - start_s) for k, p in enumerate(passes) for t in p.culminations_utc]
    return Crossings(
        obj=np.full(len(passes), obj, dtype=np.intp),
        rise_s=column("rise_utc") - start_s,
        set_s=column("set_utc") - start_s,
        culminate_s=column("culminate_utc") - start_s,
        rise_az_deg=column("rise_az_deg"),
        set_az_deg=column("set_az_deg"),
        culminate_az_deg=column("culminate_az_deg"),
        max_alt_deg=column("max_alt_deg"),
        arc=np.full((len(passes), ARC_COLUMNS), np.nan),
        peak_run=np.array([k for k, _ in tops], dtype=np.intp),
        peak_s=np.array([s for _, s in tops], dtype=np.float64),
    )


def passes_of(found: Crossings, start_s: float) -> list[Pass]:
    """Return crossings, in seconds since start_s, as passes."""
    tops: list[list[Utc]] = [[] for _ in range(len(found.obj))]
    for run, peak_s in zip(found.peak_run.tolist(), found.peak_s.tolist(), strict=True):
        tops[run].append(Utc(start_s + peak_s))
    rows = zip(
        found.rise_s.tolist(),
        found.culminate_s.tolist(),
        found.set_s.tolist(),
        found.rise_az_deg.tolist(),
        found.culminate_az_deg.tolist(),
        found.set_az_deg.tolist(),
        found.max_alt_deg.tolist(),
        tops,
        strict=True,
    )
    isnan = math.isnan
    return [
        Pass(
            None if isnan(rise) else Utc(start_s + rise),
            Utc(start_s + top),
            None if isnan(end) else Utc(start_s + end),
            None if isnan(rise) else rise_az,
            top_az,
            None if isnan(end) else set_az,
            alt,
            tuple(all_tops),
        )
        for rise, top, end, rise_az, top_az, set_az, alt, all_tops in rows
    ]


def _good_span(seen: Propagator, start_s: float, span_s: float) -> float:
    """Return how many seconds of the span SGP4 can tell of."""
    grid = np.append(np.arange(0.0, span_s, _FAILURE_STEP_S), span_s)
    failed = np.flatnonzero(seen.at(Utc(start_s + grid)).error)
    if len(failed) == 0:
        return span_s
    good, bad = float(grid[failed[0] - 1]), float(grid[failed[0]])
    while bad - good > _FAILURE_CLOSE_S:
        middle = 0.5 * (good + bad)
        if int(seen.at(Utc(np.array([start_s + middle]))).error[0]):
            bad = middle
        else:
            good = middle
    return max(good - 1.0, 0.5 * good)


@dataclass(frozen=True, slots=True)
class SearchTask:
    """What to search: `span` is its first second (POSIX) and its length in seconds."""

    elements: Sequence[Elements]
    site: Site
    span: tuple[float, float]
    horizon: Horizon
    earth: EarthOrientation | None


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

    @cached_property
    def starts(self) -> NearEarth:
        """Give what SGP4 starts from for each object; of deep space the orbit alone counts."""
        return start_near_earth(self.elements)

    def chunks(self) -> list[tuple[Index, bool]]:
        """Return all objects, by index, in chunks, each with whether it is in deep space, those first.

        Those of a chunk are of like eccentricity, as Kepler's equation likes.
        """
        if not self.elements:
            return []
        order = np.argsort(self.starts.ecco, kind="stable")
        is_deep = self.are_deep(order)
        near, deep = order[~is_deep], order[is_deep]
        near_size = max(1, int(_STRETCHES_A_CHUNK / max(1.0, self.span_s * _STRETCHES_A_SECOND)))
        deep_size = max(1, int(_DEEP_A_CHUNK / max(1.0, self.span_s / DAY_S)))
        return [
            *((deep[k : k + deep_size], True) for k in range(0, len(deep), deep_size)),
            *((near[k : k + near_size], False) for k in range(0, len(near), near_size)),
        ]

    def run(self, chunk: tuple[Index, bool]) -> Found:
        """Search one chunk."""
        index, deep = chunk
        return self._deep(index) if deep else self._near(index)

    def are_deep(self, obj: Index) -> NDArray[np.bool_]:
        """Tell which objects, by index, take 225 minutes or longer to go round."""
        deep: NDArray[np.bool_] = self.starts.period_s[obj] >= DEEP_SPACE_MIN * 60.0
        return deep

    def ends(self, found: Crossings) -> tuple[Array, Array]:
        """Return the first and last second of passes, within the span."""
        return np.nan_to_num(found.rise_s, nan=0.0), np.where(np.isnan(found.set_s), self.span_s, found.set_s)

    def shapes(self, obj: Index) -> tuple[Array, Array]:
        """Return how long pieces of the ways of objects by index may be, seconds, and the eccentricities."""
        e = self.starts.ecco[obj]
        return longest_piece_s(self.starts.period_s[obj], e), e

    def arcs(self, windows: Windows, deep: bool) -> tuple[Arcs, Index]:
        """Return the ways of objects, all deep or all near, in windows, and objects that have none."""
        names, obj = np.unique(windows.obj, return_inverse=True)
        longest_s, e = self.shapes(names)
        local = Windows(obj, windows.first_s, windows.last_s)
        pieces = even_pieces(local, longest_s[obj])
        terms = terms_for(float(e.max(initial=0.0)))
        if deep:
            records = self._deep_space(names)
            arcs, without = fit_arcs(local, pieces, records.places, terms)
        else:
            c = self.starts.take(names)
            arcs, without = fit_arcs(
                local, pieces, lambda o, s: near_places(c, self.ground, self.start_s, o, s), terms
            )
        return arcs, names[without]

    def one_by_one(self, left: list[int], pieces: list[Crossings]) -> list[tuple[Elements, PropagationError]]:
        """Search objects that decay or drag beyond all bounds; add what is found, return the refused."""
        if not left:
            return []
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
                DECAYED,
            )

    def _near(self, chunk: Index) -> Found:
        found, left = near_crossings(self.starts.take(chunk), self.ground, self.task.span, self.horizon)
        return len(chunk), found.renamed(chunk), chunk[left].tolist()

    def _deep_space(self, obj: Index) -> DeepSpace:
        # A search for one satellite near the Earth starts sooner without what only deep space needs.
        from tle.prefilter import DeepSpace

        return DeepSpace([self.elements[i] for i in obj.tolist()], self.ground, self.task.span)

    def _deep(self, chunk: Index) -> Found:
        records = self._deep_space(chunk)
        windows, pieces = records.windows(self.horizon.lowest_deg)
        terms = terms_for(self.elements[int(chunk[-1])].eccentricity)
        arcs, without = fit_arcs(windows, pieces, records.places, terms)
        found = find_crossings(arcs, self.horizon)
        return len(chunk), found.renamed(chunk), chunk[without].tolist()


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
