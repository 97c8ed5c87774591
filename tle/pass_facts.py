"""What else there is to know about passes: light, Sun and Moon, how fast the axes of a mount must turn."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tle.arcs import Windows, places, slopes
from tle.brightness import magnitude
from tle.catalogue_search import CatalogueSearch
from tle.crossing_columns import select
from tle.crossings import altaz_deg
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
_PASSES_A_CHUNK = 4000
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
) -> list[PassFacts | None]:
    """Return the facts of passes by index, of all without one; None where SGP4 ends before the pass does.

    `magnitudes` are intrinsic ones by catalogue number; see `brightness`.
    """
    chosen = np.arange(len(passes)) if index is None else np.asarray(index, dtype=np.intp)
    search = CatalogueSearch(passes.task)
    bodies = sun_and_moon(search.ground, search.earth, (search.start_s, search.span_s))
    facts: list[PassFacts | None] = [None] * len(chosen)
    deep = search.are_deep(passes.found.obj[chosen])
    for is_deep in (False, True):
        group = np.flatnonzero(deep == is_deep)
        for first in range(0, len(group), _PASSES_A_CHUNK):
            part = group[first : first + _PASSES_A_CHUNK]
            ways = _Ways(search, select(passes.found, chosen[part]), is_deep, bodies)
            for k, one in zip(part[ways.known].tolist(), ways.facts(magnitudes or {}), strict=True):
                facts[k] = one
    return facts


class _Ways:
    """The ways of some passes over the sky as arcs, and looks along each; `known` are those that have one."""

    def __init__(
        self, search: CatalogueSearch, found: Crossings, deep: bool, bodies: tuple[SkyBody, SkyBody]
    ) -> None:
        self._search = search
        self._sun, self._moon = bodies
        first = np.nan_to_num(found.rise_s, nan=0.0)
        last = np.where(np.isnan(found.set_s), search.span_s, found.set_s)
        self._arcs, without = search.arcs(Windows(found.obj, first, last), deep)
        self.known = np.flatnonzero(~np.isin(found.obj, without))
        self._obj, self._top_s = found.obj[self.known], found.culminate_s[self.known]
        self._first, self._last = first[self.known], last[self.known]
        window = np.searchsorted(self.known, self._arcs.window)
        self._stride_s = search.span_s + 10.0
        self._keys = window * self._stride_s + self._arcs.mid_s - self._arcs.half_s
        self._arc_window = window
        step = np.where(self._last - self._first > _LONG_S, _LONG_STEP_S, _STEP_S)
        count = np.maximum(np.ceil((self._last - self._first) / step), 4.0).astype(np.intp) + 1
        self._starts = np.cumsum(count) - count
        self._owner = np.repeat(np.arange(len(count)), count)
        part = (np.arange(len(self._owner)) - self._starts[self._owner]) / (count[self._owner] - 1)
        self._times = self._first[self._owner] + part * (self._last - self._first)[self._owner]

    def facts(self, magnitudes: Mapping[int, float]) -> list[PassFacts]:
        """Return the facts of each pass that is known."""
        if len(self._first) == 0:
            return []
        smallest = [self._smallest(value) for value in (self._from_sun, self._from_moon, self._ha, self._dec)]
        sun_alt, _ = altaz_deg(self._sun.east_north_up(self._search.start_s + self._top_s))
        # From the whole disc above the limb to none of it, on either side of the centre.
        whole = self._intervals(lambda owner, t: self._over_limb(owner, t, -1.0))
        some = self._intervals(lambda owner, t: self._over_limb(owner, t, 1.0))
        bright = self._brightest(magnitudes)
        start_s = self._search.start_s
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

    def _at(self, owner: Index, t: Array) -> tuple[Array, Array]:
        """Return place and velocity, km and km/s, of passes by index at seconds since the span's start."""
        arc = np.searchsorted(self._keys, owner * self._stride_s + t, side="right") - 1
        # Rounding of the keys may lead to the neighbour's arc at the very ends.
        arc += self._arc_window[np.maximum(arc, 0)] < owner
        arc -= self._arc_window[np.minimum(arc, len(self._keys) - 1)] > owner
        columns = self._arcs.columns(arc)
        x = (t - self._arcs.mid_s[arc]) / self._arcs.half_s[arc]
        return places(columns, x), slopes(columns, x) / self._arcs.half_s[arc]

    def _from_sun(self, owner: Index, t: Array) -> Array:
        return _angle(self._at(owner, t)[0], self._sun.east_north_up(self._search.start_s + t))

    def _from_moon(self, owner: Index, t: Array) -> Array:
        return _angle(self._at(owner, t)[0], self._moon.east_north_up(self._search.start_s + t))

    def _ha(self, owner: Index, t: Array) -> Array:
        """Return minus the size of the rate of hour angle, rad/s."""
        (x, dx), (y, dy), _ = self._equatorial(owner, t)
        rate: Array = np.abs(x * dy - y * dx) / (x * x + y * y + 1e-40)
        return -rate

    def _dec(self, owner: Index, t: Array) -> Array:
        """Return minus the size of the rate of declination, rad/s."""
        (x, dx), (y, dy), (z, dz) = self._equatorial(owner, t)
        xy2 = x * x + y * y + 1e-40
        rate: Array = np.abs(dz * xy2 - z * (x * dx + y * dy)) / (np.sqrt(xy2) * (xy2 + z * z))
        return -rate

    def _equatorial(self, owner: Index, t: Array) -> list[tuple[Array, Array]]:
        """Return components, with rates, to the meridian on the equator, to the west, and to the pole."""
        q, v = self._at(owner, t)
        cos, sin = self._search.ground.up_axis
        return [
            (cos * q[2] - sin * q[1], cos * v[2] - sin * v[1]),
            (-q[0], -v[0]),
            (sin * q[2] + cos * q[1], sin * v[2] + cos * v[1]),
        ]

    def _over_limb(self, owner: Index, t: Array, side: float) -> Array:
        """Return the angle of the Sun's lower (-1) or upper (+1) edge above the Earth's limb, rad."""
        sun = self._sun.east_north_up(self._search.start_s + t)
        q, _ = self._at(owner, t)
        distance = np.sqrt(np.sum((sun - q) ** 2, axis=0))
        geocentric = [self._search.ground.stretched(place) for place in (q, sun)]
        edge: Array = sun_over_limb_rad(*geocentric) + side * np.arcsin(SUN_RADIUS_KM / distance)
        return edge

    def _smallest(self, value: Callable[[Index, Array], Array]) -> Array:
        """Return the least value over each pass: of the looks, and of the valley round the lowest of them."""
        looks = value(self._owner, self._times)
        order = np.lexsort((looks, self._owner))
        best = order[self._starts]
        ends = np.append(self._starts[1:], len(self._owner)) - 1
        low = self._times[np.maximum(best - 1, self._starts)]
        high = self._times[np.minimum(best + 1, ends)]
        own = np.arange(len(best))
        _, found = least(lambda t: value(own, t), low, high)
        smallest: Array = np.minimum(found, looks[best])
        return smallest

    def _intervals(self, value: Callable[[Index, Array], Array]) -> list[list[tuple[float, float]]]:
        """Return for each pass the intervals in which a value is positive, seconds since the span's start."""
        positive = value(self._owner, self._times) > 0.0
        change = np.flatnonzero((positive[1:] != positive[:-1]) & (self._owner[1:] == self._owner[:-1]))
        own = self._owner[change]
        borders = roots(lambda t: value(own, t), self._times[change], self._times[change + 1], _CLOSE_S)
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
        numbers = [self._search.elements[o].catalog_number for o in self._obj.tolist()]
        if not any(number in magnitudes for number in numbers):
            return [None] * len(numbers)
        intrinsic = np.array([magnitudes.get(number, math.nan) for number in numbers])[self._owner]
        q, _ = self._at(self._owner, self._times)
        sun = self._sun.east_north_up(self._search.start_s + self._times)
        bright = magnitude(intrinsic, np.sqrt(np.sum(q * q, axis=0)), _angle(-q, sun - q))
        seen = self._over_limb(self._owner, self._times, 1.0) > 0.0
        best = np.minimum.reduceat(np.where(seen & ~np.isnan(bright), bright, math.inf), self._starts)
        return [float(value) if math.isfinite(value) else None for value in best]


def _angle(one: Array, other: Array) -> Array:
    """Return the angle between vectors (3, m), rad, also where it is small."""
    cross = np.cross(one, other, axis=0)
    angle: Array = np.arctan2(np.sqrt(np.sum(cross * cross, axis=0)), np.sum(one * other, axis=0))
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
