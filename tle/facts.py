"""What else there is to know about passes: light, Sun and Moon, how fast the axes of a mount must turn."""

from __future__ import annotations

import math
from copy import copy
from dataclasses import dataclass
from functools import cached_property
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


def pass_facts(
    passes: CataloguePasses,
    index: Sequence[int] | Index | None = None,
    magnitudes: Mapping[int, float] | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> list[PassFacts | None]:
    """Return the facts of passes by index, of all without one; None where SGP4 ends before the pass does.

    `magnitudes` are intrinsic ones by catalogue number; see `brightness`. `progress` is told, now and then,
    how many passes are done and how many there are.
    """
    chosen = np.arange(len(passes)) if index is None else np.asarray(index, dtype=np.intp)
    search = CatalogueSearch(passes.task)
    bodies = sun_and_moon(search.ground, search.earth, (search.start_s, search.span_s))
    facts: list[PassFacts | None] = [None] * len(chosen)
    deep = search.are_deep(passes.found.obj[chosen])
    done = 0
    for is_deep in (False, True):
        group = np.flatnonzero(deep == is_deep)
        for first in range(0, len(group), _PASSES_A_CHUNK):
            part = group[first : first + _PASSES_A_CHUNK]
            ways = _Ways(search, select(passes.found, chosen[part]), is_deep, bodies)
            for k, one in zip(part[ways.known].tolist(), ways.facts(magnitudes or {}), strict=True):
                facts[k] = one
            done += len(part)
            if progress is not None:
                progress(done, len(chosen))
    return facts


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

    def facts(self, magnitudes: Mapping[int, float]) -> list[PassFacts]:
        """Return the facts of each pass that is known."""
        if len(self._first) == 0:
            return []
        wanted = (_Seen.from_sun, _Seen.from_moon, _Seen.minus_ha_rate, _Seen.minus_dec_rate)
        smallest = self._smallest(wanted)
        sun_alt, _ = altaz_deg(self.sun.east_north_up(self.search.start_s + self._top_s))
        # From the whole disc above the limb to none of it, on either side of the centre.
        whole = self._intervals(lambda seen: seen.over_limb(-1.0))
        some = self._intervals(lambda seen: seen.over_limb(1.0))
        bright = self._brightest(magnitudes)
        start_s = self.search.start_s
        return [
            PassFacts(
                sunlit=_as_utc(whole[k], start_s),
                penumbra=_as_utc(_apart(some[k], whole[k]), start_s),
                sun_alt_deg=float(sun_alt[k]),
                min_sun_separation_deg=float(smallest[0][k]) * _DEG,
                min_moon_separation_deg=float(smallest[1][k]) * _DEG,
                peak_ha_rate_deg_s=-float(smallest[2][k]) * _DEG,
                peak_dec_rate_deg_s=-float(smallest[3][k]) * _DEG,
                magnitude=bright[k],
            )
            for k in range(len(self._first))
        ]

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

    def _intervals(self, value: Callable[[_Seen], Array]) -> list[list[tuple[float, float]]]:
        """Return for each pass the intervals in which a value is positive, seconds since the span's start."""
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
        found: list[list[float]] = [
            [first] if lit else []
            for first, lit in zip(self._first.tolist(), positive[self._starts].tolist(), strict=True)
        ]
        for k, border in zip(own.tolist(), borders.tolist(), strict=True):
            found[k].append(border)
        for edges, last in zip(found, self._last.tolist(), strict=True):
            if len(edges) % 2:
                edges.append(last)
        return [list(zip(edges[::2], edges[1::2], strict=True)) for edges in found]

    def _brightest(self, magnitudes: Mapping[int, float]) -> list[float | None]:
        """Return the least magnitude at the looks while any of the Sun is seen."""
        numbers = [self.search.elements[o].catalog_number for o in self._obj.tolist()]
        if not any(number in magnitudes for number in numbers):
            return [None] * len(numbers)
        intrinsic = np.array([magnitudes.get(number, math.nan) for number in numbers])[self._owner]
        q, sun = self._looks.q, self._looks.sun
        bright = magnitude(intrinsic, np.sqrt(np.sum(q * q, axis=0)), _angle(-q, sun - q))
        seen = self._looks.over_limb(1.0) > 0.0
        best = np.minimum.reduceat(np.where(seen & ~np.isnan(bright), bright, math.inf), self._starts)
        return [float(value) if math.isfinite(value) else None for value in best]


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


def _apart(outer: list[tuple[float, float]], inner: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return what of the outer intervals is not of the inner ones, both in order of time."""
    left: list[tuple[float, float]] = []
    for first, last in outer:
        at = first
        for low, high in inner:
            if first <= low and high <= last:
                if low > at:
                    left.append((at, low))
                at = high
        if last > at:
            left.append((at, last))
    return left


def _as_utc(intervals: list[tuple[float, float]], start_s: float) -> tuple[Interval, ...]:
    return tuple((Utc(start_s + low), Utc(start_s + high)) for low, high in intervals)
