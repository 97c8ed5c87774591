"""Pieces of a satellite's way over the sky as polynomials: what a search for passes asks again and again.

Over a fifth of a turn eight points of SGP4 determine a polynomial that follows it to a metre, so that all
root finding happens without SGP4.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tle.elements import Elements

    Array = NDArray[np.float64]
    Index = NDArray[np.intp]
    # Window, first and last second of each piece, shapes (k,).
    Pieces = tuple[Index, Array, Array]

ROUND_TERMS, ECCENTRIC_TERMS = 8, 14
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
    """Tells where objects are: east, north, up of the site in km, shape (3, k, n), NaN where unknown."""

    def __call__(self, obj: Index, since_s: Array, /) -> Array:
        """Return the places of objects by index (k,) at (k, n) seconds since the span's start."""


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
    times = (0.5 * (first + last))[:, None] + half[:, None] * basis.nodes
    return _mixed(basis.to_chebyshev, np.ascontiguousarray(sample(obj, times).transpose(2, 0, 1)))


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
