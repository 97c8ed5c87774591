"""What else there is to know about passes: light, Sun and Moon, how fast the axes of a mount must turn."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from tle.crossings import (
    DEG_PER_RAD,
    ROUND_BELOW,
    Windows,
    altaz_deg,
    basis_of,
    least,
    places,
    roots,
    select,
)
from tle.errors import SourceError
from tle.formats.rows import read_table
from tle.instants import Utc
from tle.site import EARTH_RADIUS_KM, FLATTENING
from tle.sun import SUN_RADIUS_KM, SunAndMoon
from tle.workers import mapping

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from tle.crossings import Crossings
    from tle.instants import Quantity
    from tle.passes import CataloguePasses, CatalogueSearch

    Array = NDArray[np.float64]
    Index = NDArray[np.intp]

_STEP_S, _LONG_STEP_S, _LONG_S = 10.0, 60.0, 3600.0
_CLOSE_S = 1e-2
# Fewer would cost more in calls than a processor's cache gives back.
_LOOKS_A_CHUNK = 80000
# Fewer passes are looked at sooner than threads start to pay.
_FEWEST_TO_SHARE = 2000
_SHORTEST_HALF_S = 1e-6
# Parts of the step between looks at which least values are closed in on.
_SHRINKS = (1.0 / 8.0, 1.0 / 64.0)
# What lies so far from the parabola, by what it spans, is none.
_DOUBTFUL = 0.03
# Sun and Moon turn by 2.5° in half of a piece near the Earth, by 40° in one of deep space.
_SKY_TERMS, _DEEP_SKY_TERMS = 6, 14
# Rows of polynomials, to the meridian on the equator, to the west, to the pole: the satellite from the site
# (km, km/s), Sun and Moon from the site, in units of how far they are in the middle of the arc.
PLACE, VELOCITY, SUN, MOON = slice(0, 3), slice(3, 6), slice(6, 9), slice(9, 12)
# In these units along the three axes, 1/km, the ellipsoid of WGS 84 is a ball of radius 1.
_PER_KM = (1.0 / EARTH_RADIUS_KM, 1.0 / EARTH_RADIUS_KM, 1.0 / (1.0 - FLATTENING) / EARTH_RADIUS_KM)
# Between every fourth look, at most 240 s, what `_over_limb` gives bends by less than this.
_FOURTH, _NEAR_LIMB = 4, 0.2
Interval = tuple[Utc, Utc]
_Looked = tuple["list[Array]", "Intervals", "Intervals"]
"""Numbers of some passes in the order of NUMBERS, and when they are sunlit and in penumbra."""
NUMBERS = (
    "sun_alt_deg",
    "min_sun_separation_deg",
    "min_moon_separation_deg",
    "peak_ha_rate_deg_s",
    "peak_dec_rate_deg_s",
    "magnitude",
)
"""The facts that are one number each, as `PassFacts` and `FactColumns` name them."""
_STANDARD_KM = 1000.0
_LARGEST_NUMBER = 999_999_999


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

    def ends(self, count: int) -> tuple[Array, Array]:
        """Return the first and last second of those of each of so many passes, (count,); NaN without any."""
        starts = self.starts(count)
        some = starts[1:] > starts[:-1]
        first, last = np.full(count, np.nan), np.full(count, np.nan)
        first[some], last[some] = self.first_s[starts[:-1][some]], self.last_s[starts[1:][some] - 1]
        return first, last


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
        sun_alt, sun, moon, ha_rate, dec_rate, bright = (getattr(self, name)[index] for name in NUMBERS)
        sunlit, penumbra = (spans.take(index, len(self)) for spans in (self.sunlit, self.penumbra))
        return FactColumns(self.known[index], sun_alt, sun, moon, ha_rate, dec_rate, bright, sunlit, penumbra)

    def items(self, start_s: float) -> list[PassFacts | None]:
        """Return the facts of each pass, by the search's start in POSIX seconds."""
        lit, part = (_as_utc(spans, len(self), start_s) for spans in (self.sunlit, self.penumbra))
        numbers = zip(*(getattr(self, name).tolist() for name in NUMBERS), strict=True)
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
    separations: bool = True,
    workers: int = 1,
) -> FactColumns:
    """Return the facts of passes by index, of all without one; separations from Sun and Moon only if wanted.

    `magnitudes` are intrinsic ones by catalogue number; see `magnitude`. `progress` is called now and then
    with how many passes are done and how many there are. `workers` share very many passes, see
    `workers.mapping`. The result is the same.
    """
    chosen = np.arange(len(passes)) if index is None else np.asarray(index, dtype=np.intp)
    search = passes.search
    sky = SunAndMoon(search.ground, search.earth, passes.task.span)
    numbers = np.full((len(NUMBERS), len(chosen)), np.nan)
    known = np.zeros(len(chosen), dtype=bool)
    sunlit: list[Intervals] = []
    penumbra: list[Intervals] = []

    def look(chunk: tuple[Index, bool, int]) -> tuple[Index, Index, _Looked | None]:
        part, is_deep, looks = chunk
        arcs = _PassArcs(search, select(passes.found, chosen[part]), is_deep, looks, sky)
        names = part[arcs.known]
        return (
            part,
            names,
            (arcs.numbers(magnitudes or {}, separations), *arcs.light()) if len(names) else None,
        )

    done = 0
    with mapping(workers if len(chosen) >= _FEWEST_TO_SHARE else 1) as mapped:
        for part, names, looked in mapped(look, list(_chunks(search, select(passes.found, chosen)))):
            if looked is not None:
                known[names] = True
                numbers[:, names] = looked[0]
                sunlit.append(looked[1].renamed(names))
                penumbra.append(looked[2].renamed(names))
            done += len(part)
            if progress is not None:
                progress(done, len(chosen))
    sun_alt, sun, moon, ha_rate, dec_rate, bright = numbers
    return FactColumns(
        known, sun_alt, sun, moon, ha_rate, dec_rate, bright, _joined(sunlit), _joined(penumbra)
    )


def _chunks(search: CatalogueSearch, found: Crossings) -> Iterator[tuple[Index, bool, int]]:
    """Yield passes by index that go together, whether they are in deep space, and how often to look.

    What goes together, and how often a piece of a pass is looked at, follows from each pass alone.
    """
    if len(found.obj) == 0:
        return
    names, obj = np.unique(found.obj, return_inverse=True)
    longest, e = search.shapes(names)
    longest_s = longest[obj]
    deep = search.are_deep(names)[obj]
    first_s, last_s = search.ends(found)
    length_s = last_s - first_s
    pieces = np.maximum(np.ceil(length_s / longest_s), 1.0)
    looks = np.ceil(length_s / pieces / np.where(length_s > _LONG_S, _LONG_STEP_S, _STEP_S))
    # Four sizes an octave, so that arrays are even.
    quarter = np.exp2(np.floor(np.log2(np.maximum(looks, 4.0))) - 2.0)
    looks = (np.ceil(np.maximum(looks, 4.0) / quarter) * quarter).astype(np.intp) + 1
    kind = 4 * np.isnan(found.arc[:, 0]) + 2 * deep + (e >= ROUND_BELOW)[obj]
    kind = kind * (looks.max() + 1) + looks
    order = np.argsort(kind, kind="stable")
    for group in np.split(order, np.flatnonzero(np.diff(kind[order])) + 1):
        count = int(looks[group[0]])
        size = max(1, int(_LOOKS_A_CHUNK / count / float(pieces[group].max())))
        for first in range(0, len(group), size):
            yield group[first : first + size], bool(deep[group[0]]), count


def sun_altitudes_deg(passes: CataloguePasses) -> Array:
    """Return the Sun's geometric altitude at the culmination of each pass, shape (n,): the quickest fact."""
    search = passes.search
    sky = SunAndMoon(search.ground, search.earth, passes.task.span)
    return altaz_deg(sky.east_north_up(search.start_s + passes.found.culminate_s)[:, 0])[0]


class _PassArcs:
    """The ways of some passes over the sky as arcs, each looked at evenly; `known` are passes that have one.

    Satellite, Sun and Moon are polynomials in x from -1 to 1 on each arc.
    """

    def __init__(
        self,
        search: CatalogueSearch,
        found: Crossings,
        deep: bool,
        looks: int,
        sky: SunAndMoon,
    ) -> None:
        self._search, self._sky = search, sky
        first, last = search.ends(found)
        self.known = self._pass = np.arange(len(found.obj))
        if np.isnan(found.arc[0, 0]):
            arcs, without = search.arcs(Windows(found.obj, first, last), deep)
            self.known = np.flatnonzero(~np.isin(found.obj, without))
            self._pass = np.searchsorted(self.known, arcs.window)
            self._mid_s, half_s, powers = arcs.mid_s, arcs.half_s, arcs.powers
        else:
            self._mid_s, half_s = 0.5 * (first + last), 0.5 * (last - first)
            powers = found.on_arc(first, last)
        self._obj, self._top_s = found.obj[self.known], found.culminate_s[self.known]
        self._starts = np.searchsorted(self._pass, np.arange(len(self.known)))
        self._half_s = np.maximum(half_s, _SHORTEST_HALF_S)
        self._x = np.linspace(-1.0, 1.0, looks)
        self._rows = self._polynomials(powers, _DEEP_SKY_TERMS if deep else _SKY_TERMS)
        powers = self._x[:, None] ** np.arange(len(self._rows))
        self._looks = np.einsum("jt,trk->rjk", powers, self._rows)

    def _polynomials(self, powers: Array, sky_terms: int) -> Array:
        """Return polynomials of all rows, shape (terms, rows, arcs)."""
        terms, _, count = powers.shape
        terms = max(terms, sky_terms)
        rows = np.zeros((terms, 12, count))
        ground, basis = self._search.ground, basis_of(sky_terms)
        rows[: len(powers), PLACE] = ground.equatorial(powers.swapaxes(0, 1)).swapaxes(0, 1)
        rows[:-1, VELOCITY] = rows[1:, PLACE] * (np.arange(1.0, terms)[:, None, None] / self._half_s)
        unix_s = self._search.start_s + self._mid_s + self._half_s * basis.nodes[:, None]
        sky = ground.equatorial(self._sky.east_north_up(unix_s))
        away = np.sqrt(np.sum(sky[:, :, sky_terms // 2] ** 2, axis=0))
        rows[:sky_terms, SUN.start :] = np.einsum(
            "st,dbtk->sbdk", basis.to_powers @ basis.to_chebyshev, sky / away[:, None]
        ).reshape(sky_terms, 6, count)
        self._sun_km = away[0]
        # What stretching makes of the Sun's distance hardly changes along an arc.
        towards = rows[0, SUN] * self._sun_km - rows[0, PLACE]
        stretched = towards * np.array(_PER_KM)[:, None]
        self._radius = SUN_RADIUS_KM * np.sqrt(np.sum(stretched**2, axis=0) / np.sum(towards**2, axis=0))
        return rows

    def numbers(self, magnitudes: Mapping[int, float], separations: bool) -> list[Array]:
        """Return the facts of each pass that is known, in the order of `NUMBERS`."""
        tops = self._sky.east_north_up(self._search.start_s + self._top_s)
        sun = moon = np.full(len(self.known), np.nan)
        if separations:
            sun, moon = (self._least((PLACE, body), _minus_cosine, _angle) for body in (SUN, MOON))
        ha_time = self._least((PLACE, VELOCITY), _ha_time)
        dec_rate = self._least((PLACE, VELOCITY), lambda q, v: -_dec_rate(q, v))
        return [
            altaz_deg(tops[:, 0])[0],
            sun * DEG_PER_RAD,
            moon * DEG_PER_RAD,
            DEG_PER_RAD / ha_time,
            -dec_rate * DEG_PER_RAD,
            self._brightest(magnitudes),
        ]

    def light(self) -> tuple[Intervals, Intervals]:
        """Return when the whole of the Sun is seen, and when a part of it."""
        # From the whole disc above the limb to none of it, on either side of the centre.
        whole, some = (self._intervals(side) for side in (-1.0, 1.0))
        return whole, _apart(some, whole, self._search.span_s + 10.0)

    def _least(
        self,
        which: tuple[slice, slice],
        value: Callable[[Array, Array], Array],
        exact: Callable[[Array, Array], Array] | None = None,
    ) -> Array:
        """Return the least of a value of two rows over each pass, or what is exactly there.

        By the parabola through the lowest look and its neighbours, then through closer and closer ones; where
        it is no parabola, by the golden section.
        """
        looks = value(*(self._looks[rows] for rows in which))
        best = np.argmin(looks, axis=0)
        arcs = np.arange(looks.shape[1])
        step = self._x[1] - self._x[0]
        at, lowest = self._x[best], looks[best, arcs]
        low, high = np.maximum(at - step, -1.0), np.minimum(at + step, 1.0)
        middle = np.clip(best, 1, len(self._x) - 2)
        three = looks[middle + np.array([[-1], [0], [1]]), arcs]
        x = _vertex(self._x[middle], step, three, low, high)
        expected = _parabola(three, (x - self._x[middle]) / step)
        both = np.concatenate([self._rows[:, rows] for rows in which], axis=1)

        def better(one: Array, found: Array) -> tuple[Array, Array]:
            is_better = (found < lowest) & (one >= low) & (one <= high)
            return np.where(is_better, one, at), np.where(is_better, found, lowest)

        doubtful = np.zeros(len(arcs), dtype=bool)
        for shrink in (*_SHRINKS, 0.0):
            near = x + step * shrink * np.array([[-1.0], [0.0], [1.0]] if shrink else [[0.0]])
            there = places(both[:, :, None], near)
            values = value(there[:3], there[3:])
            for one, found in zip(near, values, strict=True):
                at, lowest = better(one, found)
            if shrink == _SHRINKS[0]:
                doubtful = np.abs(values[1] - expected) > _DOUBTFUL * np.ptp(three, axis=0)
            if shrink:
                x = _vertex(x, step * shrink, values, low, high)
        odd = np.flatnonzero(doubtful)
        if len(odd):
            rows = both[:, :, odd]
            x[odd], found[odd] = least(
                lambda t: value(places(rows[:, :3], t), places(rows[:, 3:], t)), low[odd], high[odd]
            )
            at, lowest = better(x, found)
        if exact is not None:
            there = places(both, at)
            lowest = exact(there[:3], there[3:])
        return np.minimum.reduceat(lowest, self._starts)

    def _intervals(self, side: float) -> Intervals:
        """Return the intervals with the Sun's lower (-1) or upper (+1) edge above the limb, by pass."""
        count = len(self._x)
        some = [*range(0, count - 1, _FOURTH), count - 1]
        rough = self._over_limb(self._looks[PLACE, some], self._looks[SUN, some], side)
        above = np.repeat(rough[:1] > 0.0, count, axis=0)
        near = np.flatnonzero(np.abs(rough).min(axis=0) < _NEAR_LIMB)
        place, sun = (np.take(self._looks[rows], near, axis=2) for rows in (PLACE, SUN))
        above[:, near] = self._over_limb(place, sun, side, near) > 0.0
        positive = above.T.ravel()
        owner = np.repeat(self._pass, count)
        change = np.flatnonzero((positive[1:] != positive[:-1]) & (owner[1:] == owner[:-1]))
        arc, look = np.divmod(change, count)
        rows = np.concatenate([self._rows[:, r][:, :, arc] for r in (PLACE, SUN)], axis=1)

        def over_limb(x: Array) -> Array:
            there = places(rows, x)
            return self._over_limb(there[:3], there[3:], side, arc)

        x = roots(
            over_limb,
            self._x[look],
            self._x[np.minimum(look + 1, count - 1)],
            _CLOSE_S / self._half_s[arc],
        )
        # Between arcs there is no time at all.
        borders = self._mid_s[arc] + self._half_s[arc] * np.where(look == count - 1, 1.0, x)
        ends = np.append(self._starts[1:], len(self._pass)) - 1
        begun = np.flatnonzero(positive[self._starts * count])
        going_on = np.flatnonzero(positive[ends * count + count - 1])
        begin_s = (self._mid_s - self._half_s)[self._starts[begun]]
        end_s = (self._mid_s + self._half_s)[ends[going_on]]
        owner = np.concatenate([begun, self._pass[arc], going_on])
        edges = np.concatenate([begin_s, borders, end_s])
        kind = np.repeat([0, 1, 2], [len(begun), len(arc), len(going_on)])
        order = np.lexsort((kind, owner))
        return Intervals(owner[order][::2], edges[order][::2], edges[order][1::2])

    def _brightest(self, magnitudes: Mapping[int, float]) -> Array:
        """Return the least magnitude at the looks while any of the Sun is seen, NaN where there is none."""
        numbers = [self._search.elements[o].catalog_number for o in self._obj.tolist()]
        if not any(number in magnitudes for number in numbers):
            return np.full(len(numbers), np.nan)
        intrinsic = np.array([magnitudes.get(number, math.nan) for number in numbers])[self._pass]
        q, sun = self._looks[PLACE], self._looks[SUN] * self._sun_km
        bright = magnitude(intrinsic, np.sqrt(np.sum(q * q, axis=0)), _angle(-q, sun - q))
        seen = self._over_limb(q, self._looks[SUN], 1.0) > 0.0
        best = np.where(seen & ~np.isnan(bright), bright, math.inf).min(axis=0)
        best = np.minimum.reduceat(best, self._starts)
        return np.where(np.isfinite(best), best, np.nan)

    def _over_limb(self, place: Array, sun: Array, side: float, arc: Index | slice = slice(None)) -> Array:
        """Return something that has the sign of the angle of the Sun's edge above the Earth's limb.

        `place` and `sun` are those of the rows, each on its arc; `side` is -1 for the Sun's lower edge,
        +1 for the upper one. With α the angle of the Sun from the Earth's centre, β the Earth's radius and ρ
        the Sun's, all as seen from the satellite at a distance of d Earth radii: d (cos(β - side ρ) - cos α).
        """
        sun_km, site = self._sun_km[arc], self._search.ground.equatorial_km
        a, b, c = (k * (q + s) for k, q, s in zip(_PER_KM, place, site, strict=True))
        x, y, z = (k * (u * sun_km - q) for k, u, q in zip(_PER_KM, sun, place, strict=True))
        # The Sun as a target is within itself: lit.
        to_sun = np.sqrt(x * x + y * y + z * z)
        distance = np.maximum(to_sun, self._radius[arc])
        sine = self._radius[arc] / distance
        level = np.sqrt(np.maximum(a * a + b * b + c * c - 1.0, 0.0))
        over: Array = level * np.sqrt(1.0 - sine * sine) + side * sine + (a * x + b * y + c * z) / distance
        return np.where(to_sun < self._radius[arc], 1.0, over)


def _vertex(x: Array, step: float, values: Array, low: Array, high: Array) -> Array:
    """Return where the parabola through values at x - step, x and x + step is least between bounds."""
    left, middle, right = values
    bend = left - 2.0 * middle + right
    # Where it does not open upwards, the lower side.
    off = 0.5 * step * (left - right) / np.where(bend > 0.0, bend, 1e-3 * np.abs(left - right) + 1e-300)
    vertex: Array = np.clip(x + off, low, high)
    return vertex


def _parabola(values: Array, x: Array) -> Array:
    """Return the parabola through values at -1, 0 and 1."""
    left, middle, right = values
    value: Array = middle + x * (0.5 * (right - left) + x * (0.5 * (left + right) - middle))
    return value


def _minus_cosine(place: Array, body: Array) -> Array:
    """Return minus the cosine of the angle of a place from another."""
    (a, b, c), (x, y, z) = place, body
    cosine: Array = (a * x + b * y + c * z) / np.sqrt((a * a + b * b + c * c) * (x * x + y * y + z * z))
    return -cosine


def _ha_time(place: Array, velocity: Array) -> Array:
    """Return the inverse of the size of the rate of hour angle, s/rad: near the pole a parabola in time."""
    (x, y, _), (dx, dy, _) = place, velocity
    time: Array = (x * x + y * y + 1e-40) / (np.abs(x * dy - y * dx) + 1e-300)
    return time


def _dec_rate(place: Array, velocity: Array) -> Array:
    """Return the size of the rate of declination, rad/s."""
    (x, y, z), (dx, dy, dz) = place, velocity
    xy2 = x * x + y * y + 1e-40
    rate: Array = np.abs(dz * xy2 - z * (x * dx + y * dy)) / (np.sqrt(xy2) * (xy2 + z * z))
    return rate


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


def magnitude(intrinsic: Quantity, range_km: Quantity, phase_rad: Quantity) -> Quantity:
    """Return the apparent magnitude without air of a sphere that scatters light evenly (Lambert's law).

    `intrinsic` is the magnitude at 1000 km with half of the disc lit, the convention of observers' lists;
    `phase_rad` is the angle at the satellite between Sun and observer. A satellite with flat panels may
    differ by magnitudes, and flash. Formula: phase function of a diffuse sphere, (sin φ + (π - φ) cos φ),
    which is 1 at a right angle.
    """
    lit = np.sin(phase_rad) + (math.pi - phase_rad) * np.cos(phase_rad)
    return intrinsic + 5.0 * np.log10(range_km / _STANDARD_KM) - 2.5 * np.log10(np.maximum(lit, 1e-12))


def read_magnitudes(path: str | Path) -> dict[int, float]:
    """Return intrinsic magnitudes by catalogue number, from lines of those two numbers.

    More on a line, and lines that begin with `#`, are passed over. Raises SourceError, naming file and line.
    """
    known: dict[int, float] = {}
    for number, line, words in read_table(path, "magnitudes"):
        try:
            catalog_number, value = int(words[0]), float(words[1])
            if not math.isfinite(value) or not 0 < catalog_number <= _LARGEST_NUMBER:
                raise ValueError
        except (ValueError, IndexError):
            raise SourceError(
                f"{path}:{number}: {line!r} is no magnitude: "
                "write catalogue number and intrinsic magnitude, as 25544 -1.8"
            ) from None
        known[catalog_number] = value
    return known
