"""Place and velocity at an instant, by elements, by a table of rows, or of a body of the Solar System.

A table is interpolated in its own frame, as its format prescribes, and turned after that. Places are
geocentric, geometric, kilometres.
"""

from __future__ import annotations

import itertools
import math
from copy import copy
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Literal, NamedTuple, Protocol

import erfa
import numpy as np
from numpy.polynomial import chebyshev

from tle.earth import EarthOrientation, to_tirs, turned
from tle.elements import MU_KM3_S2, Elements, expected_along_s
from tle.errors import EphemerisError, EphemerisSpanError
from tle.instants import ARRAYS, FLOATS, Utc, leaps_s, utc_of_tai

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tle.earth import Triple
    from tle.elements import State
    from tle.instants import Functions, Quantity

    Array = NDArray[np.float64]
    Index = NDArray[np.intp]

FrameKind = Literal["ITRF", "GCRF", "EME2000", "TOD", "TEME", "GROUND", "SIGHT"]
CARRIED: tuple[FrameKind, ...] = ("GROUND", "SIGHT")
"""The ITRF of what is no orbit: a time bias moves it against the Earth. In `SIGHT` only directions count."""
Span = tuple[Utc, Utc]

BEFORE, AFTER, GAP = 101, 102, 103
"""Errors of a state, beside SGP4's: no rows yet, no rows any more, none between."""

# A piece of the table is written as a polynomial of so many terms: what a stencil leaves out is less.
_TERMS = 11
_NODES = chebyshev.chebpts1(_TERMS)
_TO_POWERS = np.array(
    [np.pad(chebyshev.cheb2poly(row), (0, _TERMS))[:_TERMS] for row in np.eye(_TERMS)]
).T @ np.linalg.inv(chebyshev.chebvander(_NODES, _TERMS - 1))
_DEGREES = np.arange(float(_TERMS))
_PIECES_AT_ONCE = 20_000
_JUDGES = 20
# Of rows on one side alone so many magnify their errors tenfold; fourteen do so a hundredfold and more.
_END_ROWS = 10


class Covariance(NamedTuple):
    """Of position (km) and velocity (km/s), shape (6, 6), in axes as the source names them, at an instant."""

    at: Utc
    frame: str
    matrix: Array

    @property
    def sigma_km(self) -> float:
        """Give the root of the variances of position, summed."""
        return math.sqrt(float(np.trace(self.matrix[:3, :3])))


class States(Protocol):
    """Where an object is: geocentric states in TEME of date, as `tle.elements.Motion` gives them."""

    def at(self, unix_s: float, later_s: float) -> State:
        """Return the state at POSIX seconds of UTC plus `later_s`. Raises PropagationError."""

    def at_many(self, unix_s: Array, later_s: Quantity) -> State:
        """Return states at an array of instants: NaN, and an error number last, where there is none."""


class Ephemeris(Protocol):
    """What tells where an object is. `tle.elements.Elements` is one, by SGP4."""

    @property
    def name(self) -> str:
        """Give the object's name."""

    @property
    def catalog_number(self) -> int:
        """Give the object's catalogue number, 0 where there is none."""

    @property
    def label(self) -> str:
        """Give what to call the object."""

    @property
    def epoch(self) -> Utc:
        """Give the instant from which the ephemeris ages."""

    @property
    def frame(self) -> str:
        """Give the frame of the places as they are written."""

    @property
    def provenance(self) -> str:
        """Give where this comes from, for a reader."""

    @property
    def spans(self) -> tuple[Span, ...]:
        """Give the stretches of time for which there are places, in order; none where there is no bound."""

    @property
    def ranged(self) -> bool:
        """Tell whether the distance is known well; where it is not, a range is only far away."""

    def states(self, earth: EarthOrientation, bent: bool = False) -> States:
        """Return what gives its states, the Earth being turned so.

        `bent` puts what is far away where the Sun's gravity makes it appear.
        """

    def covariance(self, at: Utc) -> Covariance | None:
        """Return the covariance that is known for the instant nearest to `at`, None where there is none."""


@dataclass(frozen=True, slots=True)
class Frame:
    """The axes of a table; of the equator and equinox of date, or of a fixed instant where one is given."""

    kind: FrameKind
    written: str
    at: Utc | None = None

    def to_teme(
        self, earth: EarthOrientation, unix_s: Quantity, state: tuple[Quantity, ...], fn: Functions
    ) -> tuple[Quantity, ...]:
        """Return place, velocity and acceleration (nine quantities) in TEME of date.

        The slow turn of the equinox, below 1e-5″ a second, is left out of the velocity.
        """
        r, v, a = (state[k : k + 3] for k in (0, 3, 6))
        if self.kind == "TEME":
            return (*r, *v, *a)
        turn = earth.rotation(unix_s)
        if self.kind == "ITRF" or self.kind in CARRIED:
            return _from_itrf(turn, r, v, a, fn)
        equinoxes = -turn[2]
        if self.kind == "TOD" and self.at is None:
            return tuple(
                k for vector in (r, v, a) for k in turned((vector[0], vector[1], vector[2]), equinoxes)
            )
        matrix = earth.celestial_matrix(Utc(unix_s))
        if self.kind == "EME2000":
            matrix = matrix @ _j2000_to_gcrf()
        elif self.kind == "TOD":
            assert self.at is not None
            matrix = matrix @ earth.celestial_matrix(self.at).T
        return tuple(k for vector in (r, v, a) for k in turned(_times(matrix, vector), equinoxes))


def _times(matrix: Array, vector: tuple[Quantity, ...]) -> Triple:
    x, y, z = vector
    rows = [matrix[..., k, 0] * x + matrix[..., k, 1] * y + matrix[..., k, 2] * z for k in range(3)]
    return rows[0], rows[1], rows[2]


@lru_cache(maxsize=1)
def _j2000_to_gcrf() -> Array:
    """Return the matrix from the mean equator and equinox of J2000.0 to the GCRS (IERS frame bias)."""
    bias, _, _ = erfa.bp06(2451545.0, 0.0)
    matrix: Array = bias.T
    return matrix


def _from_itrf(
    turn: tuple[Quantity, ...],
    r: tuple[Quantity, ...],
    v: tuple[Quantity, ...],
    a: tuple[Quantity, ...],
    fn: Functions,
) -> tuple[Quantity, ...]:
    """Return a state of the ITRS in TEME: polar motion as in `tle.earth.to_tirs`, then the Earth's turn."""
    theta, spin, _, _, xp, yp = turn
    (x, y, z), (vx, vy, vz), (ax, ay, az) = (to_tirs((k[0], k[1], k[2]), xp, yp) for k in (r, v, a))
    ax, ay = ax - 2.0 * spin * vy - spin * spin * x, ay + 2.0 * spin * vx - spin * spin * y
    vx, vy = vx - spin * y, vy + spin * x
    c, s = fn.cos(theta), fn.sin(theta)
    return (
        *(x * c - y * s, x * s + y * c, z),
        *(vx * c - vy * s, vx * s + vy * c, vz),
        *(ax * c - ay * s, ax * s + ay * c, az),
    )


@dataclass(frozen=True, slots=True)
class Interpolation:
    """How rows become a curve: by so many of them about an instant, with their velocities or without."""

    rows: int
    with_velocities: bool

    @property
    def words(self) -> str:
        """Say it for a reader."""
        if self.with_velocities:
            return f"Hermite, degree {2 * self.rows - 1}"
        return f"Lagrange, degree {self.rows - 1}"


@dataclass(frozen=True, eq=False)
class Segment:
    """Rows that may be interpolated: no gap and no manoeuvre between them.

    Times are TAI: `zero_s`, whole seconds counted like POSIX seconds, and `since_s` (n,) after it, growing.
    `place_km` (n, 3), `velocity_km_s` (n, 3) or None, in `frame`. `use_s` are the first and the last second
    for which the rows are meant. `line` is where they begin, `why` what divides them from those before.
    """

    zero_s: float
    since_s: Array
    place_km: Array
    velocity_km_s: Array | None
    frame: Frame
    interpolation: Interpolation
    use_s: tuple[float, float]
    line: int = 1
    why: str = "a gap"
    covariances: tuple[tuple[float, str, Array], ...] = ()
    """Of instants (seconds after zero_s): axes and matrix."""
    lines: Index | None = None
    """The line of each row, None where that is not known."""
    _pieces: dict[int, Array] = field(default_factory=dict, init=False, repr=False)

    @cached_property
    def span(self) -> Span:
        """Give the first and the last instant of use."""
        return utc_of_tai(self.zero_s, self.use_s[0]), utc_of_tai(self.zero_s, self.use_s[1])

    @cached_property
    def unsure_km(self) -> float:
        """Give by how much places may be missed where there are fewer rows than are wanted, else 0.

        It is what one row less would move half way between rows: more than the rows miss.
        """
        count = len(self.since_s)
        if count >= self.interpolation.rows or count < 2:
            return 0.0
        half = 0.5 * (self.since_s[1:] + self.since_s[:-1])
        less = replace(self, interpolation=replace(self.interpolation, rows=count - 1))
        moved = self.native_many(half)[:3] - less.native_many(half)[:3]
        return float(np.linalg.norm(moved, axis=0).max())

    def line_of(self, row: int) -> int:
        """Return the line of a row, or that of the first one where no more is known."""
        return self.line if self.lines is None else int(self.lines[row])

    def part(self, first: int, stop: int, why: str) -> Segment:
        """Return the rows from one to one before another, for use as far as they go."""
        low, high = float(self.since_s[first]), float(self.since_s[stop - 1])
        return replace(
            self,
            since_s=self.since_s[first:stop],
            place_km=self.place_km[first:stop],
            velocity_km_s=None if self.velocity_km_s is None else self.velocity_km_s[first:stop],
            use_s=(max(self.use_s[0], low), min(self.use_s[1], high)),
            line=self.line_of(first),
            lines=None if self.lines is None else self.lines[first:stop],
            why=why,
        )

    def native(self, since: float) -> Array:
        """Return place, velocity and acceleration, shape (9,), in the segment's frame at one instant."""
        index = min(max(int(np.searchsorted(self.since_s, since, "right")) - 1, 0), len(self.since_s) - 2)
        piece = self._pieces.get(index)
        if piece is None:
            piece = self._pieces[index] = self.pieces(np.array([index]))[0]
        low, high = self.since_s[index], self.since_s[index + 1]
        x = (2.0 * since - low - high) / (high - low)
        state: Array = piece @ x**_DEGREES
        return state

    def native_many(self, since: Array) -> Array:
        """Return places, velocities and accelerations, shape (9, n), at instants in any order."""
        index = np.clip(np.searchsorted(self.since_s, since, "right") - 1, 0, len(self.since_s) - 2)
        low, high = self.since_s[index], self.since_s[index + 1]
        x = (2.0 * since - low - high) / (high - low)
        states = np.empty((9, len(since)))
        order = np.argsort(index, kind="stable")
        found, first = np.unique(index[order], return_index=True)
        edges = [*first[::_PIECES_AT_ONCE].tolist(), len(order)]
        for k, (start, stop) in enumerate(itertools.pairwise(edges)):
            some = found[k * _PIECES_AT_ONCE : (k + 1) * _PIECES_AT_ONCE]
            rows = order[start:stop]
            pieces = self.pieces(some)[np.searchsorted(some, index[rows])]
            powers = x[rows][:, None] ** _DEGREES
            states[:, rows] = np.einsum("nct,nt->cn", pieces, powers)
        return states

    def pieces(self, index: Index) -> Array:
        """Return polynomials between rows by index, shape (m, 9, terms), in x from -1 to 1 between them.

        Newton's divided differences over the rows about the piece, from its middle outwards, of places less
        the piece's first. Near the ends, where all rows are on one side, many of them magnify their errors.
        """
        rows, count = len(self.since_s), min(self.interpolation.rows, len(self.since_s))
        if self.interpolation.with_velocities or count <= _END_ROWS:
            return self._pieces_by(index, count)
        low, high = count // 2 - 1, rows - count + count // 2 - 1
        inner = (index >= low) & (index <= high)
        found = np.empty((len(index), 9, _TERMS))
        for part, used in ((inner, count), (~inner, _END_ROWS)):
            if part.any():
                found[part] = self._pieces_by(index[part], used)
        return found

    def _pieces_by(self, index: Index, count: int) -> Array:
        """Return polynomials between rows, see `pieces`, by so many rows."""
        rows = len(self.since_s)
        first = np.clip(index - (count // 2 - 1), 0, rows - count)
        inner = index - first
        # From the middle of the piece outwards: Newton's form is steadiest so.
        away = np.abs(np.arange(count)[None, :] - inner[:, None] - 0.5)
        near = first[:, None] + np.argsort(away, axis=1, kind="stable")
        half = 0.5 * (self.since_s[index + 1] - self.since_s[index])
        middle = self.since_s[index] + half
        x = (self.since_s[near] - middle[:, None]) / half[:, None]
        base = self.place_km[index]
        values = self.place_km[near] - base[:, None, :]
        slopes = None
        if self.velocity_km_s is not None and self.interpolation.with_velocities:
            slopes = self.velocity_km_s[near] * half[:, None, None]
        nodes, terms = _divided(x, values, slopes)
        at_nodes = _newton(nodes, terms)
        powers = np.einsum("kj,mjc->mck", _TO_POWERS, at_nodes)
        powers[:, :, 0] += base
        pieces = np.zeros((len(index), 9, _TERMS))
        pieces[:, :3] = powers
        pieces[:, 3:6, :-1] = pieces[:, :3, 1:] * _DEGREES[1:] / half[:, None, None]
        pieces[:, 6:, :-1] = pieces[:, 3:6, 1:] * _DEGREES[1:] / half[:, None, None]
        return pieces


def missed_km(segment: Segment, held: Index) -> Array:
    """Return by how much rows, by index, are missed when interpolated from all others, shape (m,)."""
    others = np.delete(np.arange(len(segment.since_s)), held)
    rows = segment.interpolation.rows
    about = np.searchsorted(others, held)[:, None] + np.arange(-rows, rows)
    others = others[np.unique(np.clip(about, 0, len(others) - 1))]
    velocity = segment.velocity_km_s
    without = replace(
        segment,
        since_s=segment.since_s[others],
        place_km=segment.place_km[others],
        velocity_km_s=None if velocity is None else velocity[others],
    )
    places = without.native_many(segment.since_s[held])[:3].T
    missed: Array = np.linalg.norm(places - segment.place_km[held], axis=1)
    return missed


def without_poor_velocities(segment: Segment, by_places: Interpolation) -> Segment:
    """Return the segment, by places alone where rows left out are found better so.

    Velocities that are not the derivative of the places spoil what is between the rows. Rows left out are far
    from one another, and from the ends; where there are too few, the velocities are kept.
    """
    rows, count = by_places.rows, len(segment.since_s)
    every = max(rows + 1, count // _JUDGES)
    alone = replace(segment, interpolation=by_places)
    squares = [0.0, 0.0]
    for first in range(rows, min(rows + every, count - rows), every // 3):
        held = np.arange(first, count - rows, every)
        for k, one in enumerate((segment, alone)):
            squares[k] += float(np.sum(missed_km(one, held) ** 2))
    return alone if squares[1] < squares[0] else segment


def _divided(x: Array, values: Array, slopes: Array | None) -> tuple[Array, Array]:
    """Return nodes (m, n) and divided differences (m, n, 3); each node twice where there are slopes."""
    if slopes is None:
        nodes, table = x, values.copy()
        start = 1
    else:
        nodes = np.repeat(x, 2, axis=1)
        table = np.repeat(values, 2, axis=1)
        first = table.copy()
        first[:, 1::2] = slopes
        first[:, 2::2] = (values[:, 1:] - values[:, :-1]) / (x[:, 1:] - x[:, :-1])[:, :, None]
        table, start = first, 2
    for order in range(start, nodes.shape[1]):
        wide = nodes[:, order:] - nodes[:, :-order]
        table[:, order:] = (table[:, order:] - table[:, order - 1 : -1]) / wide[:, :, None]
    return nodes, table


def _newton(nodes: Array, terms: Array) -> Array:
    """Return Newton's polynomial at the Chebyshev nodes of -1 to 1, shape (m, nodes, 3)."""
    at = np.broadcast_to(terms[:, -1, None, :], (len(terms), _TERMS, 3)).copy()
    for k in range(terms.shape[1] - 2, -1, -1):
        at *= (_NODES[None, :] - nodes[:, k, None])[:, :, None]
        at += terms[:, k, None, :]
    return at


class TableEphemeris:
    """An object's rows from one file, in segments that follow one another; see `Segment`.

    Raises EphemerisError where segments overlap, and where no two rows can be interpolated. Whether rows are
    an orbit is judged by `tle.orbit_rows.falling`.
    """

    def __init__(
        self,
        name: str,
        segments: list[Segment],
        provenance: str,
        *,
        epoch: Utc,
        catalog_number: int = 0,
        names: tuple[str, ...] = (),
        source: str = "",
        sigma_km: float | None = None,
    ) -> None:
        self.name = name
        self.catalog_number = catalog_number
        self.names = (name, *names)
        """All that the object is called in its file."""
        self.epoch = epoch
        self.source = source
        self.provenance = provenance
        self.sigma_km = sigma_km
        """The standard deviation of places that the file states as a whole, None where it states none."""
        self.refused: dict[str, EphemerisError] = {}
        """Other objects of the same file that cannot be placed, by name, and why."""
        self.t0: Utc | None = None
        """From when the table counts its times; None where they are absolute."""
        usable = [one for one in segments if len(one.since_s) > 1]
        if not usable:
            raise EphemerisError(
                f"{name} has not two rows without a gap between them: nothing to interpolate",
                source=source,
                line=segments[0].line if segments else None,
            )
        usable.sort(key=lambda one: float(one.span[0].unix_s))
        for before, after in itertools.pairwise(usable):
            if float(after.span[0].unix_s) < float(before.span[1].unix_s) - 1e-6:
                raise EphemerisError(
                    f"rows of {name} from {after.span[0].isoformat('milliseconds')} on overlap those from "
                    f"line {before.line}, which are in use until {before.span[1].isoformat('milliseconds')}: "
                    "give a file whose segments follow one another",
                    source=source,
                    line=after.line,
                )
        self.segments = tuple(usable)

    @property
    def label(self) -> str:
        """Give the name."""
        return self.name

    @property
    def frame(self) -> str:
        """Give the frame as the file writes it."""
        return self.segments[0].frame.written

    @property
    def spans(self) -> tuple[Span, ...]:
        """Give when there are places: one span where segments meet."""
        spans: list[Span] = []
        for one in self.segments:
            if spans and float(one.span[0].unix_s) - float(spans[-1][1].unix_s) < 1e-6:
                spans[-1] = (spans[-1][0], one.span[1])
            else:
                spans.append(one.span)
        return tuple(spans)

    @property
    def ranged(self) -> bool:
        """Tell whether the distance is known."""
        return self.segments[0].frame.kind != "SIGHT"

    def later(self, seconds: float) -> TableEphemeris:
        """Return the same path, begun so much later."""
        moved = copy(self)
        moved.segments = tuple(replace(one, zero_s=one.zero_s + seconds) for one in self.segments)
        moved.t0 = None if self.t0 is None else self.t0.plus(seconds)
        return moved

    def covariance(self, at: Utc) -> Covariance | None:
        """Return the covariance of the nearest instant for which the file gives one."""
        known = [(one.zero_s, *row) for one in self.segments for row in one.covariances]
        if known:
            tai_s = float(at.unix_s) + float(leaps_s(at.unix_s))
            zero_s, since_s, frame, matrix = min(known, key=lambda row: abs(row[0] + row[1] - tai_s))
            return Covariance(utc_of_tai(zero_s, since_s), frame, matrix)
        if self.sigma_km is None:
            return None
        starts = [float(one.span[0].unix_s) for one in self.segments]
        here = self.segments[max(0, int(np.searchsorted(starts, float(at.unix_s), "right")) - 1)]
        matrix = np.full((6, 6), np.nan)
        matrix[:3, :3] = np.eye(3) * (self.sigma_km**2 + here.unsure_km**2) / 3.0
        return Covariance(at, self.frame, matrix)

    def states(self, earth: EarthOrientation, bent: bool = False) -> TableStates:
        """Return what gives the states."""
        return TableStates(self, earth)


class TableStates:
    """States of a table's object, the Earth being turned as `earth` has it."""

    def __init__(self, ephemeris: TableEphemeris, earth: EarthOrientation) -> None:
        self._ephemeris = ephemeris
        self._earth = earth
        self._starts = np.array([float(one.span[0].unix_s) for one in ephemeris.segments])
        self._ends = np.array([float(one.span[1].unix_s) for one in ephemeris.segments])

    def at(self, unix_s: float, later_s: float) -> State:
        """Return the state at POSIX seconds of UTC plus `later_s`. Raises EphemerisSpanError."""
        moved = unix_s + later_s
        index = int(np.searchsorted(self._starts, moved + 1e-6, "right")) - 1
        if index < 0 or not moved <= self._ends[index] + 1e-6:
            raise self._outside(index, moved)
        one = self._ephemeris.segments[index]
        native = one.native((unix_s - one.zero_s) + leaps_s(unix_s) + later_s).tolist()
        turned_s = unix_s if one.frame.kind in CARRIED else moved
        return (*one.frame.to_teme(self._earth, turned_s, tuple(native), FLOATS), 0)

    def at_many(self, unix_s: Array, later_s: Quantity) -> State:
        """Return states at an array of instants: NaN, and an error number last, where there are no rows."""
        moved = unix_s + later_s
        index = np.searchsorted(self._starts, moved + 1e-6, "right") - 1
        error = np.where(moved <= self._ends[index] + 1e-6, 0, GAP).astype(np.uint8)
        error[(error != 0) & (index == len(self._starts) - 1)] = AFTER
        error[index < 0] = BEFORE
        states = np.full((9, len(unix_s)), np.nan)
        for k in np.unique(index[error == 0]).tolist():
            one = self._ephemeris.segments[k]
            rows = np.flatnonzero((index == k) & (error == 0))
            at = unix_s[rows]
            later = later_s[rows] if isinstance(later_s, np.ndarray) else later_s
            native = one.native_many((at - one.zero_s) + leaps_s(at) + later)
            turned_s = at if one.frame.kind in CARRIED else at + later
            states[:, rows] = one.frame.to_teme(self._earth, turned_s, tuple(native), ARRAYS)
        return (*states, error)

    def _outside(self, index: int, moved: float) -> EphemerisSpanError:
        """Return the refusal of an instant that no segment covers."""
        segments, label = self._ephemeris.segments, self._ephemeris.label
        source = self._ephemeris.source or "its table"
        start, end = segments[0].span[0], segments[-1].span[1]
        when = Utc(moved).isoformat("milliseconds")
        if 0 <= index < len(segments) - 1:
            gap = (segments[index].span[1], segments[index + 1].span[0])
            return EphemerisSpanError(
                f"{label}: no place at {when}: {segments[index + 1].why} in {source} "
                f"from {gap[0].isoformat('milliseconds')} to {gap[1].isoformat('milliseconds')}",
                GAP,
            )
        return EphemerisSpanError(
            f"{label}: no place at {when}: {source} is from "
            f"{start.isoformat('milliseconds')} to {end.isoformat('milliseconds')}: ask within that",
            BEFORE if index < 0 else AFTER,
        )


UNSTATED_M = 100.0
"""What a file that states no error is taken to miss: what laser predictions and operators do in some days."""


def expected_error_m(source: Elements | Ephemeris, at: Utc) -> float | None:
    """Return the typical error of a source's places at an instant, metres.

    Of elements what `expected_along_s` is on the orbit, else what the source states; None where it does not.
    """
    if isinstance(source, Elements):
        speed_km_s = math.sqrt(MU_KM3_S2 / source.semi_major_axis_km)
        return 1000.0 * speed_km_s * expected_along_s(source, at)
    known = source.covariance(at)
    return None if known is None else 1000.0 * known.sigma_km


class SourceRank(NamedTuple):
    """How a source compares with others of the same object for a time; the least is the best."""

    over: bool
    """Its places end before."""
    in_part: bool
    """It has no places for some of the time."""
    error_m: float
    """By how much it misses its object, `UNSTATED_M` where it does not say."""


def source_rank(source: Elements | Ephemeris, first: Utc, at: Utc, last: Utc) -> SourceRank:
    """Return the rank of a source from one instant to another, whose error counts at a third."""
    spans, error_m = source.spans, expected_error_m(source, at)
    return SourceRank(
        bool(spans) and spans[-1][1] < first,
        bool(spans) and not any(low <= first and last <= high for low, high in spans),
        UNSTATED_M if error_m is None else error_m,
    )
