"""What else there is to know about passes: light, Sun and Moon, how fast the axes of a mount must turn."""

from __future__ import annotations

import math
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from tle.arcs import Windows, places, slopes
from tle.brightness import magnitude
from tle.catalogue_search import CatalogueSearch
from tle.crossing_columns import select
from tle.crossings import altaz_deg
from tle.earth import EarthOrientation
from tle.ground import Ground
from tle.instants import Utc
from tle.roots import least, roots
from tle.sky_bodies import sun_and_moon
from tle.sun import SUN_RADIUS_KM, sun_over_limb_rad

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from numpy.typing import NDArray

    from tle.catalogue_passes import CataloguePasses
    from tle.crossings import Crossings
    from tle.sky_bodies import SkyBody

    Array = NDArray[np.float64]
    Index = NDArray[np.intp]

_DEG = 180.0 / math.pi
_STEP_S, _LONG_STEP_S, _LONG_S = 10.0, 60.0, 3600.0
_CLOSE_S = 1e-2
# The arrays of so many looks stay within a processor's cache.
_PASSES_A_CHUNK = 500
Interval = tuple[Utc, Utc]
_NUMBERS = (
    "sun_alt_deg",
    "min_sun_separation_deg",
    "min_moon_separation_deg",
    "peak_ha_rate_deg_s",
    "peak_dec_rate_deg_s",
    "magnitude",
)


@dataclass(frozen=True, slots=True)
class PassFacts:
    """Facts of one pass, over as much of it as lies within the span.

    `sunlit` are the intervals in which the satellite sees the whole of the Sun's disc, `penumbra` those in
    which it sees a part. `sun_alt_deg` is the Sun's geometric altitude at culmination; separations are the
    least ones, on the sky of the site. `peak_ha_rate_deg_s` and `peak_dec_rate_deg_s` are the largest
    magnitudes of the rates of hour angle and declination. `magnitude` is the brightest while any of the Sun
    is seen, None where no intrinsic magnitude is known or the pass is dark throughout.
    """

    sunlit: tuple[Interval, ...]
    penumbra: tuple[Interval, ...]
    sun_alt_deg: float
    min_sun_separation_deg: float
    min_moon_separation_deg: float
    peak_ha_rate_deg_s: float
    peak_dec_rate_deg_s: float
    magnitude: float | None


@dataclass(frozen=True, slots=True)
class Intervals:
    """Stretches of time in some passes: whose each is, by index, in order; first and last second; (k,)."""

    owner: Index
    first_s: Array
    last_s: Array

    def renamed(self, names: Index) -> Intervals:
        """Return the same with other indices."""
        return Intervals(names[self.owner], self.first_s, self.last_s)

    def take(self, index: Index, count: int) -> Intervals:
        """Return those of passes by index, of so many, in that order."""
        place = np.full(count, -1, dtype=np.intp)
        place[index] = np.arange(len(index))
        owner = place[self.owner]
        kept = np.flatnonzero(owner >= 0)
        kept = kept[np.argsort(owner[kept], kind="stable")]
        return Intervals(owner[kept], self.first_s[kept], self.last_s[kept])

    def starts(self, count: int) -> Index:
        """Return where those of each of so many passes begin, and where all end, shape (count + 1,)."""
        return np.searchsorted(self.owner, np.arange(count + 1))


@dataclass(frozen=True, slots=True)
class FactColumns:
    """The facts of many passes as `PassFacts` has them, in columns (n,): NaN where there is no value.

    Times are seconds since the search's start; where `known` is false SGP4 ends before the pass does.
    """

    known: NDArray[np.bool_]
    sun_alt_deg: Array
    min_sun_separation_deg: Array
    min_moon_separation_deg: Array
    peak_ha_rate_deg_s: Array
    peak_dec_rate_deg_s: Array
    magnitude: Array
    sunlit: Intervals
    penumbra: Intervals

    def __len__(self) -> int:
        """Return how many passes there are."""
        return len(self.known)

    def take(self, index: Index) -> FactColumns:
        """Return those of some passes, in their order."""
        sun_alt, sun, moon, ha_rate, dec_rate, bright = (getattr(self, name)[index] for name in _NUMBERS)
        sunlit, penumbra = (spans.take(index, len(self)) for spans in (self.sunlit, self.penumbra))
        return FactColumns(
            self.known[index], sun_alt, sun, moon, ha_rate, dec_rate, bright, sunlit, penumbra
        )

    def items(self, start_s: float) -> list[PassFacts | None]:
        """Return the facts of each pass, by the search's start in POSIX seconds."""
        lit, part = (_as_utc(spans, len(self), start_s) for spans in (self.sunlit, self.penumbra))
        numbers = zip(*(getattr(self, name).tolist() for name in _NUMBERS), strict=True)
        return [
            PassFacts(
                lit[k], part[k], sun_alt, sun, moon, ha_rate, dec_rate, None if math.isnan(bright) else bright
            )
            if known
            else None
            for k, (known, (sun_alt, sun, moon, ha_rate, dec_rate, bright)) in enumerate(
                zip(self.known.tolist(), numbers, strict=True)
            )
        ]


def pass_facts(
    passes: CataloguePasses,
    index: Sequence[int] | Index | None = None,
    magnitudes: Mapping[int, float] | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> list[PassFacts | None]:
    """Return the facts of passes by index, of all without one; None where SGP4 ends before the pass does.

    As `fact_columns`, which is quicker for very many.
    """
    return fact_columns(passes, index, magnitudes, progress).items(passes.task.span[0])


def fact_columns(
    passes: CataloguePasses,
    index: Sequence[int] | Index | None = None,
    magnitudes: Mapping[int, float] | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> FactColumns:
    """Return the facts of passes by index, of all without one.

    `magnitudes` are intrinsic ones by catalogue number; see `brightness`. `progress` is told, now and then,
    how many passes are done and how many there are.
    """
    chosen = np.arange(len(passes)) if index is None else np.asarray(index, dtype=np.intp)
    search = CatalogueSearch(passes.task)
    bodies = sun_and_moon(search.ground, search.earth, (search.start_s, search.span_s))
    numbers = np.full((len(_NUMBERS), len(chosen)), np.nan)
    known = np.zeros(len(chosen), dtype=bool)
    sunlit: list[Intervals] = []
    penumbra: list[Intervals] = []
    deep = search.are_deep(passes.found.obj[chosen])
    done = 0
    for is_deep in (False, True):
        group = np.flatnonzero(deep == is_deep)
        for first in range(0, len(group), _PASSES_A_CHUNK):
            part = group[first : first + _PASSES_A_CHUNK]
            ways = _Ways(search, select(passes.found, chosen[part]), is_deep, bodies)
            if len(ways.known):
                names = part[ways.known]
                known[names] = True
                numbers[:, names] = ways.numbers(magnitudes or {})
                whole, part_of_it = ways.light()
                sunlit.append(whole.renamed(names))
                penumbra.append(part_of_it.renamed(names))
            done += len(part)
            if progress is not None:
                progress(done, len(chosen))
    sun_alt, sun, moon, ha_rate, dec_rate, bright = numbers
    return FactColumns(
        known, sun_alt, sun, moon, ha_rate, dec_rate, bright, _joined(sunlit), _joined(penumbra)
    )


def sun_altitudes_deg(passes: CataloguePasses) -> Array:
    """Return the Sun's geometric altitude at the culmination of each pass, shape (n,): the quickest fact."""
    task = passes.task
    earth = task.earth or EarthOrientation.installed()
    ground = Ground(task.site, earth, *task.span)
    sun, _ = sun_and_moon(ground, earth, task.span)
    altitude, _ = altaz_deg(sun.east_north_up(task.span[0] + passes.found.culminate_s))
    return altitude


class _Ways:
    """The ways of some passes over the sky as arcs, and looks along each; `known` are those that have one."""

    def __init__(
        self, search: CatalogueSearch, found: Crossings, deep: bool, bodies: tuple[SkyBody, SkyBody]
    ) -> None:
        self.search = search
        self.sun, self.moon = bodies
        first = np.nan_to_num(found.rise_s, nan=0.0)
        last = np.where(np.isnan(found.set_s), search.span_s, found.set_s)
        self._arcs, without = search.arcs(Windows(found.obj, first, last), deep)
        self.known = np.flatnonzero(~np.isin(found.obj, without))
        self._obj, self._top_s = found.obj[self.known], found.culminate_s[self.known]
        self._first, self._last = first[self.known], last[self.known]
        window = np.searchsorted(self.known, self._arcs.window)
        self._stride_s = search.span_s + 10.0
        self._keys = window * self._stride_s + self._arcs.mid_s - self._arcs.half_s
        self._first_arc = np.searchsorted(window, np.arange(len(self.known)))
        self._last_arc = np.searchsorted(window, np.arange(len(self.known)), side="right") - 1
        step = np.where(self._last - self._first > _LONG_S, _LONG_STEP_S, _STEP_S)
        count = np.maximum(np.ceil((self._last - self._first) / step), 4.0).astype(np.intp) + 1
        self._starts = np.cumsum(count) - count
        self._owner = np.repeat(np.arange(len(count)), count)
        part = (np.arange(len(self._owner)) - self._starts[self._owner]) / (count[self._owner] - 1)
        self._times = self._first[self._owner] + part * (self._last - self._first)[self._owner]
        self._looks = _Seen(self, self._owner, self._times)

    def numbers(self, magnitudes: Mapping[int, float]) -> list[Array]:
        """Return the facts of each pass that is known, in the order of `_NUMBERS`."""
        wanted = (_Seen.from_sun, _Seen.from_moon, _Seen.minus_ha_rate, _Seen.minus_dec_rate)
        sun, moon, ha_rate, dec_rate = self._smallest(wanted)
        sun_alt_deg, _ = altaz_deg(self.sun.east_north_up(self.search.start_s + self._top_s))
        bright = self._brightest(magnitudes)
        return [sun_alt_deg, sun * _DEG, moon * _DEG, -ha_rate * _DEG, -dec_rate * _DEG, bright]

    def light(self) -> tuple[Intervals, Intervals]:
        """Return when the whole of the Sun is seen, and when a part of it."""
        # From the whole disc above the limb to none of it, on either side of the centre.
        whole = self._intervals(lambda seen: seen.over_limb(-1.0))
        some = self._intervals(lambda seen: seen.over_limb(1.0))
        return whole, _apart(some, whole, self._stride_s)

    def at(self, owner: Index, t: Array) -> tuple[Array, Array]:
        """Return place and velocity, km and km/s, of passes by index at seconds since the span's start."""
        arc = np.searchsorted(self._keys, owner * self._stride_s + t, side="right") - 1
        # Rounding of the keys may lead to the neighbour's arc at the very ends.
        arc = np.clip(arc, self._first_arc[owner], self._last_arc[owner])
        columns = self._arcs.columns(arc)
        x = (t - self._arcs.mid_s[arc]) / self._arcs.half_s[arc]
        return places(columns, x), slopes(columns, x) / self._arcs.half_s[arc]

    def _smallest(self, values: Sequence[Callable[[_Seen], Array]]) -> list[Array]:
        """Return the least of each value over each pass: of the looks, and of the valley round the lowest."""
        count = len(self._starts)
        ends = np.append(self._starts[1:], len(self._owner)) - 1
        lows, highs, lowest = [], [], []
        for value in values:
            looks = value(self._looks)
            lowest.append(np.minimum.reduceat(looks, self._starts))
            equal = np.flatnonzero(looks == lowest[-1][self._owner])
            best = equal[np.searchsorted(self._owner[equal], np.arange(count))]
            lows.append(self._times[np.maximum(best - 1, self._starts)])
            highs.append(self._times[np.minimum(best + 1, ends)])
        own = np.tile(np.arange(count), len(values))

        def all_values(t: Array) -> Array:
            seen = _Seen(self, own, t)
            parts = (seen.part(slice(k * count, (k + 1) * count)) for k in range(len(values)))
            return np.concatenate([value(part) for value, part in zip(values, parts, strict=True)])

        _, found = least(all_values, np.concatenate(lows), np.concatenate(highs))
        return list(np.minimum(found, np.concatenate(lowest)).reshape(len(values), count))

    def _intervals(self, value: Callable[[_Seen], Array]) -> Intervals:
        """Return the intervals in which a value is positive, by pass."""
        looks = value(self._looks)
        positive = looks > 0.0
        change = np.flatnonzero((positive[1:] != positive[:-1]) & (self._owner[1:] == self._owner[:-1]))
        own = self._owner[change]
        borders = roots(
            lambda t: value(_Seen(self, own, t)),
            self._times[change],
            self._times[change + 1],
            _CLOSE_S,
            (looks[change], looks[change + 1]),
        )
        ends = np.append(self._starts[1:], len(self._owner)) - 1
        begun, going_on = np.flatnonzero(positive[self._starts]), np.flatnonzero(positive[ends])
        owner = np.concatenate([begun, own, going_on])
        edges = np.concatenate([self._first[begun], borders, self._last[going_on]])
        kind = np.repeat([0, 1, 2], [len(begun), len(own), len(going_on)])
        order = np.lexsort((kind, owner))
        return Intervals(owner[order][::2], edges[order][::2], edges[order][1::2])

    def _brightest(self, magnitudes: Mapping[int, float]) -> Array:
        """Return the least magnitude at the looks while any of the Sun is seen, NaN where there is none."""
        numbers = [self.search.elements[o].catalog_number for o in self._obj.tolist()]
        if not any(number in magnitudes for number in numbers):
            return np.full(len(numbers), np.nan)
        intrinsic = np.array([magnitudes.get(number, math.nan) for number in numbers])[self._owner]
        q, sun = self._looks.q, self._looks.sun
        bright = magnitude(intrinsic, np.sqrt(np.sum(q * q, axis=0)), _angle(-q, sun - q))
        seen = self._looks.over_limb(1.0) > 0.0
        best = np.minimum.reduceat(np.where(seen & ~np.isnan(bright), bright, math.inf), self._starts)
        return np.where(np.isfinite(best), best, np.nan)


class _Seen:
    """What there is to see at instants of passes, by index and seconds since the span's start; shapes (m,).

    `q` and `v` are place and velocity, km and km/s.
    """

    def __init__(self, ways: _Ways, owner: Index, t: Array) -> None:
        self._ways, self._unix_s = ways, ways.search.start_s + t
        self.q, self.v = ways.at(owner, t)

    def part(self, which: slice) -> _Seen:
        """Return some of the instants."""
        some = copy(self)
        some.q, some.v, some._unix_s = self.q[:, which], self.v[:, which], self._unix_s[which]
        return some

    @cached_property
    def sun(self) -> Array:
        """The Sun's place, km."""
        return self._ways.sun.east_north_up(self._unix_s)

    def from_sun(self) -> Array:
        """Return the angle from the Sun, rad."""
        return _angle(self.q, self.sun)

    def from_moon(self) -> Array:
        """Return the angle from the Moon, rad."""
        return _angle(self.q, self._ways.moon.east_north_up(self._unix_s))

    def minus_ha_rate(self) -> Array:
        """Return minus the size of the rate of hour angle, rad/s."""
        (x, dx), (y, dy), _ = self._equatorial
        rate: Array = np.abs(x * dy - y * dx) / (x * x + y * y + 1e-40)
        return -rate

    def minus_dec_rate(self) -> Array:
        """Return minus the size of the rate of declination, rad/s."""
        (x, dx), (y, dy), (z, dz) = self._equatorial
        xy2 = x * x + y * y + 1e-40
        rate: Array = np.abs(dz * xy2 - z * (x * dx + y * dy)) / (np.sqrt(xy2) * (xy2 + z * z))
        return -rate

    @cached_property
    def _equatorial(self) -> list[tuple[Array, Array]]:
        """Components, with rates, to the meridian on the equator, to the west, and to the pole."""
        q, v = self.q, self.v
        cos, sin = self._ways.search.ground.up_axis
        return [
            (cos * q[2] - sin * q[1], cos * v[2] - sin * v[1]),
            (-q[0], -v[0]),
            (sin * q[2] + cos * q[1], sin * v[2] + cos * v[1]),
        ]

    def over_limb(self, side: float) -> Array:
        """Return the angle of the Sun's lower (-1) or upper (+1) edge above the Earth's limb, rad."""
        centre, radius = self._limb
        return centre + side * radius

    @cached_property
    def _limb(self) -> tuple[Array, Array]:
        """The angles of the Sun's centre above the Earth's limb, and of its radius, rad."""
        q, sun = self.q, self.sun
        distance = np.sqrt(np.sum((sun - q) ** 2, axis=0))
        geocentric = [self._ways.search.ground.stretched(place) for place in (q, sun)]
        return sun_over_limb_rad(*geocentric), np.arcsin(SUN_RADIUS_KM / distance)


def _angle(one: Array, other: Array) -> Array:
    """Return the angle between vectors (3, m), rad, also where it is small."""
    (a, b, c), (x, y, z) = one, other
    i, j, k = b * z - c * y, c * x - a * z, a * y - b * x
    angle: Array = np.arctan2(np.sqrt(i * i + j * j + k * k), a * x + b * y + c * z)
    return angle


def _apart(outer: Intervals, inner: Intervals, stride_s: float) -> Intervals:
    """Return what of the outer intervals is not of the inner ones that lie within them."""
    keys = outer.owner * stride_s + outer.first_s
    around = np.searchsorted(keys, inner.owner * stride_s + inner.first_s, side="right") - 1
    within = np.flatnonzero(
        (around >= 0)
        & (outer.owner[around] == inner.owner)
        & (outer.first_s[around] <= inner.first_s)
        & (inner.last_s <= outer.last_s[around])
    )
    number = np.concatenate([np.arange(len(outer.owner)), around[within]])
    first = np.concatenate([outer.first_s, inner.last_s[within]])
    last = np.concatenate([outer.last_s, inner.first_s[within]])
    # One more piece than there are holes: from each beginning to the next end.
    number, first, last = (
        np.sort(number),
        first[np.lexsort((first, number))],
        last[np.lexsort((last, number))],
    )
    left = np.flatnonzero(last > first)
    return Intervals(outer.owner[number[left]], first[left], last[left])


def _joined(pieces: list[Intervals]) -> Intervals:
    """Return intervals put together, in order of their owners."""
    if not pieces:
        return Intervals(np.empty(0, dtype=np.intp), np.empty(0), np.empty(0))
    owner = np.concatenate([piece.owner for piece in pieces])
    order = np.argsort(owner, kind="stable")
    first, last = (np.concatenate([getattr(p, name) for p in pieces]) for name in ("first_s", "last_s"))
    return Intervals(owner[order], first[order], last[order])


def _as_utc(spans: Intervals, count: int, start_s: float) -> list[tuple[Interval, ...]]:
    first, last = (spans.first_s + start_s).tolist(), (spans.last_s + start_s).tolist()
    pairs = [(Utc(low), Utc(high)) for low, high in zip(first, last, strict=True)]
    starts = spans.starts(count).tolist()
    return [tuple(pairs[low:high]) for low, high in pairwise(starts)]
