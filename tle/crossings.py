"""The path of a satellite over the sky as polynomials (arcs), and when these cross the horizon.

Over a fifth of a turn eight points of SGP4 determine a polynomial that follows it to a metre, so that all
root finding happens without SGP4. The searches run over all arcs of all objects at once, which is why they
are written out: skyfield's `find_discrete` and scipy's root finders take one function at a time.

**No time above the horizon longer than SURE_S is missed.** Between two looks, a distance δ in time apart, the
satellite is below the horizon throughout if a bound says so: with z = q·û - sin a |q| (positive where the
altitude exceeds a) and -z" ≤ c, z stays under the parabola through both looks with second derivative -c.
c = (1 + |sin a|) max|q"| + sin a max|q'|²/min|q| for a > 0, since |q|" ≤ |q'|²/|q| + |q"|; the maxima of the
derivatives over a whole arc follow from its coefficients. For a skyline instead, the direction moves by no
more than max|q'| δ/2 / min|q| from the nearer look. Where no bound says so, the stretch is halved and looked
at again until it is shorter than SURE_S: what lasts longer has been seen. Below that the highest points
of the altitude, which are looked at too, find all but the pathological.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from tle.elements import Elements
    from tle.horizon import Horizon

    Array = NDArray[np.float64]
    Index = NDArray[np.intp]
    # Window, first and last second of each piece, shapes (k,).
    Pieces = tuple[Index, Array, Array]
    Flags = NDArray[np.bool_]

ROUND_TERMS, ECCENTRIC_TERMS = 8, 14
ARC_COLUMNS = 2 + 3 * ROUND_TERMS
# What a fit may miss: 0.1 m, passed in 13 µs in a low orbit; farther off 0.02″ as seen from the site.
FIT_KM, FIT_RAD = 1e-4, 1e-7
MOST_HALVINGS = 8
SHORTEST_S = 1.0
# Pieces a turn of orbits that are about round, and of others.
_ROUND, _ECCENTRIC, ROUND_BELOW = 5, 6, 0.05


class Basis(NamedTuple):
    """For polynomials of so many terms: nodes, values to Chebyshev coefficients, those to powers, and the
    largest first and second derivative of each Chebyshev polynomial on -1 to 1 (V. A. Markov).
    """

    nodes: Array
    to_chebyshev: Array
    to_powers: Array
    slope: Array
    bend: Array


@lru_cache
def basis_of(terms: int) -> Basis:
    """Return what polynomials of so many terms are made with."""
    angle = math.pi / terms * (np.arange(terms - 1, -1, -1.0) + 0.5)
    degree = np.arange(float(terms))
    # Chebyshev polynomials are orthogonal over their nodes.
    to_chebyshev = 2.0 / terms * np.cos(np.outer(degree, angle))
    to_chebyshev[0] *= 0.5
    to_powers = np.zeros((terms, terms))
    to_powers[0, 0] = to_powers[1, 1] = 1.0
    for k in range(2, terms):
        to_powers[1:, k] = 2.0 * to_powers[:-1, k - 1]
        to_powers[:, k] -= to_powers[:, k - 2]
    return Basis(
        nodes=np.cos(angle),
        to_chebyshev=to_chebyshev,
        to_powers=to_powers,
        slope=degree**2,
        bend=degree**2 * (degree**2 - 1.0) / 3.0,
    )


class Sampler(Protocol):
    """Tells where objects are: east, north, up of the site in km, shape (3, n, k), NaN where unknown."""

    def __call__(self, obj: Index, since_s: Array, /) -> Array:
        """Return the places of objects by index (k,) at (n, k) seconds since the span's start."""


@dataclass(frozen=True, slots=True)
class Windows:
    """Stretches of time in which objects may be above the horizon: object, first and last second; (w,)."""

    obj: Index
    first_s: Array
    last_s: Array


@dataclass(frozen=True, slots=True)
class Arcs:
    """Polynomials in x from -1 to 1 for east, north, up in km; sorted by window and time; shapes (k,).

    `powers` (terms, 3, k) multiply 1, x, x²…; `speed` and `bend` bound the first and second derivative by
    time (km/s, km/s²) anywhere on the arc.
    """

    obj: Index
    window: Index
    mid_s: Array
    half_s: Array
    powers: Array
    speed: Array
    bend: Array

    def columns(self, arc: Index) -> Array:
        """Return the coefficients of arcs by index, shape (terms, 3, m), for `places`."""
        return np.take(self.powers, arc, axis=2)

    def at(self, arc: Index, x: Array) -> Array:
        """Return places, shape (3, m), on arcs by index at x."""
        return places(self.columns(arc), x)

    def seconds(self, arc: Index, x: Array) -> Array:
        """Return seconds since the span's start."""
        return self.mid_s[arc] + x * self.half_s[arc]


def places(columns: Array, x: Array) -> Array:
    """Return the values at x, shape (3, m), of polynomials (terms, 3, m), or of shapes that go together."""
    place: Array = columns[-1] * x
    for column in columns[-2:0:-1]:
        place += column
        place *= x
    place += columns[0]
    return place


def with_slopes(columns: Array) -> Array:
    """Return polynomials (terms, 6, ...) for `places`: those given (terms, 3, ...), and their derivatives."""
    both = np.zeros((len(columns), 6, *columns.shape[2:]))
    both[:, :3] = columns
    degree = np.arange(1.0, len(columns)).reshape(-1, *(1,) * (columns.ndim - 1))
    np.multiply(columns[1:], degree, out=both[:-1, 3:])
    return both


def fit_arcs(windows: Windows, pieces: Pieces, sample: Sampler, terms: int) -> tuple[Arcs, Index]:
    """Return arcs that cover the windows, and the objects for which there is no such polynomial.

    `pieces` cut the windows up; where polynomials of so many terms do not follow closely enough, they are
    halved. Objects left over (NaN, or a way that is not smooth) appear in no arc.
    """
    window, first, last = pieces
    fitted = _fit(windows.obj[window], first, last, sample, terms)
    off = _missed(fitted)
    without = np.empty(0, dtype=np.intp)
    if not (off <= 1.0).all():
        (window, first, last), fitted, without = _halved(windows, pieces, (fitted, off), sample)
    half = 0.5 * (last - first)
    size = np.sqrt(np.sum(fitted * fitted, axis=1))
    basis = basis_of(terms)
    arcs = Arcs(
        obj=windows.obj[window],
        window=window,
        mid_s=0.5 * (first + last),
        half_s=half,
        powers=_mixed(basis.to_powers, fitted),
        speed=np.sum(size * basis.slope[:, None], axis=0) / half,
        bend=np.sum(size * basis.bend[:, None], axis=0) / half**2,
    )
    return arcs, without


def _halved(
    windows: Windows, pieces: Pieces, begun: tuple[Array, Array], sample: Sampler
) -> tuple[Pieces, Array, Index]:
    """Return pieces in order of window and time, their coefficients, and the objects that have none.

    `begun` are the coefficients of the pieces, and what they miss; where that is too much they are halved.
    """
    window, first, last = pieces
    fitted, off = begun
    terms = len(fitted)
    done: list[tuple[Index, Array, Array, Array]] = []
    failed: list[Index] = []
    for halving in range(MOST_HALVINGS + 1):
        if halving:
            fitted = _fit(windows.obj[window], first, last, sample, terms)
            off = _missed(fitted)
        good = off <= 1.0
        done.append((window[good], first[good], last[good], fitted[:, :, good]))
        bad = ~good
        hopeless = bad & (~np.isfinite(off) | (last - first < SHORTEST_S) | (halving == MOST_HALVINGS))
        failed.append(windows.obj[window[hopeless]])
        again = bad & ~np.isin(windows.obj[window], failed[-1])
        if not again.any():
            break
        middle = 0.5 * (first[again] + last[again])
        window = np.concatenate([window[again], window[again]])
        first, last = np.concatenate([first[again], middle]), np.concatenate([middle, last[again]])
    without = np.unique(np.concatenate(failed))
    window = np.concatenate([part[0] for part in done])
    first = np.concatenate([part[1] for part in done])
    last = np.concatenate([part[2] for part in done])
    keep = np.flatnonzero(~np.isin(windows.obj[window], without))
    keep = keep[np.lexsort((first[keep], window[keep]))]
    fitted = np.take(np.concatenate([part[3] for part in done], axis=2), keep, axis=2)
    return (window[keep], first[keep], last[keep]), fitted, without


def even_pieces(windows: Windows, longest_s: Array) -> Pieces:
    """Return equal pieces of windows that are not longer than asked for, (w,) seconds."""
    span = windows.last_s - windows.first_s
    count = np.maximum(np.ceil(span / longest_s), 1.0).astype(np.intp)
    window = np.repeat(np.arange(len(count)), count)
    number = np.arange(len(window)) - np.repeat(np.cumsum(count) - count, count)
    part = (span / count)[window]
    first = windows.first_s[window] + number * part
    ends = number + 1 == count[window]
    return (
        window,
        first,
        np.where(ends, windows.last_s[window], windows.first_s[window] + (number + 1) * part),
    )


def anomaly_pieces(elements: Elements, start_s: float, span_s: float, window: int = 0) -> Pieces:
    """Return pieces of one window, the whole span, about even in eccentric anomaly: short near perigee."""
    turn_s, e = elements.period_s, elements.eccentricity
    mean = math.radians(elements.mean_anomaly_deg) / (2.0 * math.pi)
    mean += (start_s - elements.epoch.unix_s) / turn_s
    count = _ROUND if e < ROUND_BELOW else _ECCENTRIC
    anomaly = 2.0 * math.pi / count * np.arange(1, count + 1)
    steps = (anomaly - e * np.sin(anomaly)) * (turn_s / (2.0 * math.pi))
    turns = np.arange(math.floor(mean), math.floor(mean) + math.ceil(span_s / turn_s) + 1) - mean
    edges = (turns[:, None] * turn_s + steps).ravel()
    edges = edges[(edges > SHORTEST_S) & (edges < span_s - SHORTEST_S)]
    first, last = np.concatenate([[0.0], edges]), np.concatenate([edges, [span_s]])
    return np.full(len(first), window), first, last


def _fit(obj: Index, first: Array, last: Array, sample: Sampler, terms: int) -> Array:
    """Return Chebyshev coefficients, shape (terms, 3, k)."""
    basis = basis_of(terms)
    half = 0.5 * (last - first)
    times = 0.5 * (first + last) + half * basis.nodes[:, None]
    return _mixed(basis.to_chebyshev, sample(obj, times).swapaxes(0, 1))


def _mixed(matrix: Array, columns: Array) -> Array:
    """Return a matrix times columns along their first axis.

    Not by a matrix product: for ones so small BLAS starts threads that only get in each other's way.
    """
    mixed: Array = matrix[:, 0, None, None] * columns[0]
    for number in range(1, matrix.shape[1]):
        mixed += matrix[:, number, None, None] * columns[number]
    return mixed


def _missed(fitted: Array) -> Array:
    """Return about what polynomials miss, 1 being as much as they may; NaN for places unknown.

    Coefficients of smooth ways fall off faster and faster, so that the next pair is below the last one times
    its ratio to the one before.
    """
    size = np.abs(fitted).max(axis=1, initial=0.0)
    last = size[-1] + size[-2]
    before = size[-3] + size[-4]
    next_ = last * np.minimum(last / np.maximum(before, 1e-300), 1.0)
    missed: Array = next_ / (FIT_KM + FIT_RAD * size[0])
    return missed


def longest_piece_s(period_s: Array, eccentricity: Array) -> Array:
    """Return how long pieces of near-Earth orbits may be; perigee is passed faster than a round orbit is."""
    longest: Array = period_s / _ROUND * (1.0 - eccentricity) ** 1.5
    return longest


def terms_for(eccentricity: float) -> int:
    """Return of how many terms polynomials should be for orbits of an eccentricity."""
    return ROUND_TERMS if eccentricity < ROUND_BELOW else ECCENTRIC_TERMS


_MOST_ROUNDS = 60
_GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)
SURE_S = 0.5
_LOOKS = 9
_GRID = np.linspace(-1.0, 1.0, _LOOKS)
# Ridders' method squares the error: the step after one of this size is about a millisecond.
CLOSE_S, _WALL_CLOSE_S = 2e-2, 1e-5
DEG_PER_RAD = 180.0 / math.pi


def roots(
    value: Callable[[Array], Array],
    low: Array,
    high: Array,
    close: Array | float,
    at_ends: tuple[Array, Array] | None = None,
) -> Array:
    """Return a root in each bracket (m,), by Ridders' method, until none moves by `close` any more.

    The values at the ends of a bracket, `at_ends` where they are known, have different signs, zero counting
    as negative. Near the end the method squares the error from step to step.
    """
    if len(low) == 0:
        return low
    at_low, at_high = (value(low), value(high)) if at_ends is None else at_ends
    found = low
    for _ in range(_MOST_ROUNDS):
        middle = 0.5 * (low + high)
        at_middle = value(middle)
        spread = np.sqrt(np.maximum(at_middle * at_middle - at_low * at_high, 1e-300))
        new = middle + (middle - low) * np.sign(at_low - at_high) * at_middle / spread
        moved = np.abs(new - found)
        found = new
        if (moved < close).all():
            break
        at_new = value(new)
        # The bracket goes on from the new point to the closest one on the other side of the root.
        over = at_new > 0.0
        by_middle, by_low = (at_middle > 0.0) != over, (at_low > 0.0) != over
        high = np.where(by_middle, middle, np.where(by_low, low, high))
        at_high = np.where(by_middle, at_middle, np.where(by_low, at_low, at_high))
        low, at_low = new, at_new
    return found


def least(value: Callable[[Array], Array], low: Array, high: Array, rounds: int = 15) -> tuple[Array, Array]:
    """Return where values are least within brackets (m,) of one valley each, and the values there.

    By the golden section: each round leaves 0.62 of a bracket.
    """
    left, right = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
    at_left, at_right = value(left), value(right)
    for _ in range(rounds):
        first = at_left < at_right
        low, high = np.where(first, low, left), np.where(first, right, high)
        new = np.where(first, high - _GOLDEN * (high - low), low + _GOLDEN * (high - low))
        at_new = value(new)
        left, right = np.where(first, new, right), np.where(first, left, new)
        at_left, at_right = np.where(first, at_new, at_right), np.where(first, at_left, at_new)
    return np.where(at_left < at_right, left, right), np.minimum(at_left, at_right)


@dataclass(frozen=True, slots=True)
class Crossings:
    """Times above the horizon in seconds since the span's start, NaN where cut by its ends; shapes (p,).

    `arc` (p, 26) is the arc of eight terms on which all of such a time lies: its middle and half length,
    seconds, and its coefficients as `Arcs` has them; NaN where there is no such one. `peak_run` (m,) tells
    for each highest point of the altitude in `peak_s` to which of them it belongs.
    """

    obj: Index
    rise_s: Array
    set_s: Array
    culminate_s: Array
    rise_az_deg: Array
    set_az_deg: Array
    culminate_az_deg: Array
    max_alt_deg: Array
    arc: Array
    peak_run: Index
    peak_s: Array

    def on_arc(self, first_s: Array, last_s: Array) -> Array:
        """Return the polynomials of times that have an arc, from -1 at first_s to 1 at last_s, (8, 3, p)."""
        middle_s, half_s = self.arc[:, 0], self.arc[:, 1]
        powers = np.ascontiguousarray(self.arc[:, 2:].T).reshape(ROUND_TERMS, 3, -1)
        shift = (0.5 * (first_s + last_s) - middle_s) / half_s
        for first in range(ROUND_TERMS - 1):
            for k in range(ROUND_TERMS - 2, first - 1, -1):
                powers[k] += shift * powers[k + 1]
        powers *= (0.5 * (last_s - first_s) / half_s) ** np.arange(ROUND_TERMS)[:, None, None]
        return powers

    def renamed(self, names: Index) -> Crossings:
        """Return the same with each object's index replaced by the one that `names` gives it."""
        return replace(self, obj=names[self.obj])


class _Looks(NamedTuple):
    """Places looked at, on arcs by index, in order of window and time; shapes (m,); `peak` marks tops."""

    arc: Index
    x: Array
    height: Array
    above: Flags
    peak: Flags


def find_crossings(arcs: Arcs, horizon: Horizon) -> Crossings:
    """Return the times above the horizon on arcs, in order of object and time."""
    if len(arcs.obj) == 0:
        none, no = np.empty(0), np.empty(0, dtype=np.intp)
        return Crossings(no, none, none, none, none, none, none, none, np.empty((0, ARC_COLUMNS)), no, none)
    looks = _look(arcs, horizon)
    return _runs(arcs, horizon, looks)


def altaz_deg(q: Array) -> tuple[Array, Array]:
    """Return altitude and azimuth of places east, north, up, shape (3, m)."""
    alt = np.arctan2(q[2], np.hypot(q[0], q[1])) * DEG_PER_RAD
    return alt, np.arctan2(q[0], q[1]) * DEG_PER_RAD % 360.0 % 360.0


def _height(q: Array, horizon: Horizon) -> Array:
    """Return what is positive above the horizon: km for a level one, degrees above a skyline."""
    if horizon.mask is None:
        sine = math.sin(math.radians(horizon.min_alt_deg))
        height: Array = q[2] - sine * np.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2])
        return height
    alt, az = altaz_deg(q)
    skyline: Array = alt - horizon.altitude_deg(az)
    return skyline


def _side(height: Array) -> Array:
    """Return 1 above the horizon, -1 elsewhere."""
    return np.where(height > 0.0, 1.0, -1.0)


def _climb(q: Array, v: Array) -> Array:
    """Return what has the sign of the altitude's rate."""
    climb: Array = v[2] * (q[0] * q[0] + q[1] * q[1]) - q[2] * (q[0] * v[0] + q[1] * v[1])
    return climb


def _climbs(columns: Array, x: Array) -> Array:
    moving = places(columns, x)
    return _climb(moving[:3], moving[3:])


def _look(arcs: Arcs, horizon: Horizon) -> _Looks:
    """Look at each arc at even steps, at the tops of the altitude, and wherever a bound leaves a doubt."""
    count = len(arcs.obj)
    arc = np.repeat(np.arange(count), _LOOKS)
    x = np.tile(_GRID, count)
    both = with_slopes(arcs.powers)
    moving = places(both[..., None], _GRID).reshape(6, -1)
    q, v = moving[:3], moving[3:]
    height = _height(q, horizon)
    climb = _climb(q, v)
    climbing = climb > 0.0
    inner = np.ones(len(arc) - 1, dtype=bool)
    inner[_LOOKS - 1 :: _LOOKS] = False
    left = np.flatnonzero(inner)
    doubt = _doubtful(arcs, arc[left], (x[left], x[left + 1]), (q[:, left], q[:, left + 1]), horizon)
    some = (height[left] > 0.0) | (height[left + 1] > 0.0) | doubt
    # Tops may be the only look above the horizon, and valleys the only one below it.
    turns = left[some & (climbing[left] != climbing[left + 1])]
    turn_arc = arc[turns]
    turn_columns = np.take(both, turn_arc, axis=2)
    turn_x = roots(
        lambda x: _climbs(turn_columns, x),
        x[turns],
        x[turns + 1],
        CLOSE_S / arcs.half_s[turn_arc],
        (climb[turns], climb[turns + 1]),
    )
    turn_q = places(turn_columns[:, :3], turn_x)
    left = left[doubt]
    more_arc, more_x, more_height = _halve(
        arcs, arc[left], (x[left], x[left + 1]), (q[:, left], q[:, left + 1]), horizon
    )
    all_arc = np.concatenate([arc, turn_arc, more_arc])
    all_x = np.concatenate([x, turn_x, more_x])
    height = np.concatenate([height, _height(turn_q, horizon), more_height])
    peak = np.zeros(len(all_arc), dtype=bool)
    peak[len(arc) : len(arc) + len(turn_arc)] = climbing[turns]
    order = np.lexsort((all_x, all_arc))
    height = height[order]
    return _Looks(all_arc[order], all_x[order], height, height > 0.0, peak[order])


def _halve(
    arcs: Arcs, arc: Index, x: tuple[Array, Array], q: tuple[Array, Array], horizon: Horizon
) -> tuple[Index, Array, Array]:
    """Return looks within doubtful stretches, halved until none is doubtful and longer than SURE_S."""
    found: list[tuple[Index, Array, Array]] = []
    low, high = x
    at_low, at_high = q
    while len(arc):
        middle = 0.5 * (low + high)
        at_middle = arcs.at(arc, middle)
        found.append((arc, middle, _height(at_middle, horizon)))
        arc = np.concatenate([arc, arc])
        low, high = np.concatenate([low, middle]), np.concatenate([middle, high])
        at_low = np.concatenate([at_low, at_middle], axis=1)
        at_high = np.concatenate([at_middle, at_high], axis=1)
        keep = _doubtful(arcs, arc, (low, high), (at_low, at_high), horizon)
        arc, low, high, at_low, at_high = arc[keep], low[keep], high[keep], at_low[:, keep], at_high[:, keep]
    if not found:
        return np.empty(0, dtype=np.intp), np.empty(0), np.empty(0)
    arcs_, places, heights = zip(*found, strict=True)
    return np.concatenate(arcs_), np.concatenate(places), np.concatenate(heights)


def _doubtful(
    arcs: Arcs, arc: Index, x: tuple[Array, Array], q: tuple[Array, Array], horizon: Horizon
) -> Flags:
    """Tell stretches longer than SURE_S on one side of the horizon at both ends that may cross it between."""
    span_s = (x[1] - x[0]) * arcs.half_s[arc]
    speed, bend = arcs.speed[arc], arcs.bend[arc]
    ranges = [np.sqrt(one[0] ** 2 + one[1] ** 2 + one[2] ** 2) for one in q]
    nearest = np.maximum(np.minimum(*ranges) - 0.5 * speed * span_s, 1e-3)
    long = span_s > SURE_S
    if horizon.mask is None:
        sine = math.sin(math.radians(horizon.min_alt_deg))
        z = [one[2] - sine * r for one, r in zip(q, ranges, strict=True)]
        c = bend * (1.0 + abs(sine)) + max(sine, 0.0) * speed**2 / nearest
        doubt: Flags = long & (np.maximum(*z) <= 0.0) & (highest_between(z[0], z[1], c, span_s) > 0.0)
        return doubt
    heights = [_height(one, horizon) for one in q]
    same = (heights[0] > 0.0) == (heights[1] > 0.0)
    aside = 0.5 * speed * span_s / nearest * DEG_PER_RAD
    unsure = np.zeros(len(arc), dtype=bool)
    for one in q:
        alt, az = altaz_deg(one)
        # A turn by less than the zenith distance changes the azimuth by asin(sin turn / cos alt) at most.
        lever = np.cos(np.radians(alt))
        sine_turn = np.sin(np.radians(np.minimum(aside, 90.0)))
        sweep = np.where(
            sine_turn < lever,
            np.arcsin(np.minimum(sine_turn / np.maximum(lever, 1e-12), 1.0)) * DEG_PER_RAD,
            180.0,
        )
        sweep = np.where(aside < 90.0, sweep, 180.0)
        low, high = horizon.extremes_deg(az, sweep)
        unsure |= (alt + aside > low) & (alt - aside <= high)
    unsure &= long & same
    return unsure


def highest_between(z0: Array, z1: Array, c: Array, span_s: Array) -> Array:
    """Return what z, with z" ≥ -c, cannot exceed between z0 and z1 over a span of seconds."""
    bow = 0.5 * c * span_s**2
    rise = z1 - z0
    inside = np.abs(rise) < bow
    safe = np.where(inside, np.maximum(bow, 1e-300), 1.0)
    top: Array = np.where(inside, 0.5 * (z0 + z1) + 0.25 * bow + 0.25 * rise**2 / safe, np.maximum(z0, z1))
    return top


def _runs(arcs: Arcs, horizon: Horizon, looks: _Looks) -> Crossings:
    """Join looks above the horizon to runs, and find the borders between above and below."""
    window = arcs.window[looks.arc]
    new = np.ones(len(window), dtype=bool)
    new[1:] = window[1:] != window[:-1]
    before = np.concatenate([[False], looks.above[:-1]]) & ~new
    after_new = np.concatenate([new[1:], [True]])
    after = np.concatenate([looks.above[1:], [False]]) & ~after_new
    first = np.flatnonzero(looks.above & ~before)
    last = np.flatnonzero(looks.above & ~after)
    seconds = arcs.seconds(looks.arc, looks.x)
    count = len(first)
    border_s, border_q = _borders(
        arcs,
        horizon,
        looks,
        (np.concatenate([first - 1, last]), np.concatenate([first, last + 1])),
        np.concatenate([new[first], after_new[last]]),
    )
    rise_s, set_s = border_s[:count], border_s[count:]
    run = np.cumsum(looks.above & ~before) - 1
    peak = np.flatnonzero(looks.above & looks.peak)
    # The highest point of a run is a top of the altitude or one of its ends.
    ends = np.concatenate([first, last])
    cut = np.flatnonzero(np.isnan(border_s))
    border_q[:, cut] = arcs.at(looks.arc[ends[cut]], looks.x[ends[cut]])
    end_s = border_s.copy()
    end_s[cut] = seconds[ends[cut]]
    peak_q = arcs.at(looks.arc[peak], looks.x[peak])
    owner = np.concatenate([run[peak], np.arange(count), np.arange(count)])
    when = np.concatenate([seconds[peak], end_s])
    alt, az = altaz_deg(np.concatenate([peak_q, border_q], axis=1))
    order = np.lexsort((alt, owner))
    best = order[np.searchsorted(owner[order], np.arange(count), side="right") - 1]
    rise_az, set_az = az[len(peak) : len(peak) + count], az[len(peak) + count :]
    arc = np.full((count, ARC_COLUMNS), np.nan)
    if len(arcs.powers) == ROUND_TERMS:
        on_one = np.flatnonzero(looks.arc[first] == looks.arc[last])
        own = looks.arc[first[on_one]]
        arc[on_one, 0], arc[on_one, 1] = arcs.mid_s[own], arcs.half_s[own]
        arc[on_one, 2:] = arcs.columns(own).reshape(ARC_COLUMNS - 2, -1).T
    return Crossings(
        obj=arcs.obj[looks.arc[first]],
        rise_s=rise_s,
        set_s=set_s,
        culminate_s=when[best],
        rise_az_deg=np.where(np.isnan(rise_s), np.nan, rise_az),
        set_az_deg=np.where(np.isnan(set_s), np.nan, set_az),
        culminate_az_deg=az[best],
        max_alt_deg=alt[best],
        arc=arc,
        peak_run=run[peak],
        peak_s=seconds[peak],
    )


def _borders(
    arcs: Arcs, horizon: Horizon, looks: _Looks, pairs: tuple[Index, Index], open_end: Flags
) -> tuple[Array, Array]:
    """Return seconds and places (3, p) of the horizon between looks; NaN where the window ends first."""
    low, high = pairs
    found = np.full(len(low), np.nan)
    place = np.full((3, len(low)), np.nan)
    closed = np.flatnonzero(~open_end)
    low, high = low[closed], high[closed]
    # Looks on two arcs stand at the instant that both share.
    same = looks.arc[low] == looks.arc[high]
    x = looks.x[low].copy()
    low_same, high_same = low[same], high[same]
    # A skyline may have walls, over which only signs lead to the border.
    shape: Callable[[Array], Array] = np.positive if horizon.mask is None else _side
    columns = arcs.columns(looks.arc[low_same])
    close_s = CLOSE_S if horizon.mask is None else _WALL_CLOSE_S
    x[same] = roots(
        lambda at: shape(_height(places(columns, at), horizon)),
        looks.x[low_same],
        looks.x[high_same],
        close_s / arcs.half_s[looks.arc[low_same]],
        (shape(looks.height[low_same]), shape(looks.height[high_same])),
    )
    found[closed] = arcs.seconds(looks.arc[low], x)
    place[:, closed] = arcs.at(looks.arc[low], x)
    return found, place


def joined(pieces: Sequence[Crossings]) -> Crossings:
    """Return crossings put together, in order of object and time."""
    pieces = [p for p in pieces if len(p.obj)] or list(pieces[:1])
    if not pieces:
        none, no = np.empty(0), np.empty(0, dtype=np.intp)
        return Crossings(no, none, none, none, none, none, none, none, np.empty((0, ARC_COLUMNS)), no, none)
    columns = {f.name: np.concatenate([getattr(p, f.name) for p in pieces]) for f in fields(Crossings)}
    starts = np.cumsum([0, *(len(p.obj) for p in pieces[:-1])])
    columns["peak_run"] = np.concatenate([p.peak_run + s for p, s in zip(pieces, starts, strict=True)])
    whole = Crossings(**columns)
    return select(whole, np.lexsort((whole.culminate_s, whole.obj)))


def select(found: Crossings, index: Index) -> Crossings:
    """Return the crossings of these indices, in their order."""
    position = np.full(len(found.obj), -1, dtype=np.intp)
    position[index] = np.arange(len(index))
    owner = position[found.peak_run]
    kept = np.flatnonzero(owner >= 0)
    kept = kept[np.argsort(owner[kept], kind="stable")]
    columns = {f.name: getattr(found, f.name)[index] for f in fields(found)[:-2]}
    return Crossings(**columns, peak_run=owner[kept], peak_s=found.peak_s[kept])
