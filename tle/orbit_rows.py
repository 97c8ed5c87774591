"""Whether the rows of a table are an orbit about the Earth, and which of them are not.

From row to row an object falls as the Earth's mass and flattening have it. A row that disagrees with those on
both sides, which agree with each other, has a wrong digit, sign or unit; a step after which all go on
otherwise is what engines did.
"""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from tle.earth import EVEN_TURN_RAD_S, EarthOrientation
from tle.elements import MU_KM3_S2, gravity_km_s2
from tle.ephemeris import without_poor_velocities
from tle.errors import EphemerisError
from tle.instants import ARRAYS, leaps_s, utc_of_tai

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tle.ephemeris import Interpolation, Segment

    Array = NDArray[np.float64]
    Index = NDArray[np.intp]
    _Three = tuple[Array, Array, Array]

# How far accelerations may be from gravity, as a share of it, from a radius on in proportion to that: there
# elements' propagators miss more. What that, or more rows, may move an object by between rows (km); and the
# radii between which gravity is Earth's.
_GRAVITY_SHARE, _SHARE_KM, _MOVES_KM = 0.02, 50_000.0, 0.05
_HIGHEST_KM, _LOWEST_KM = 150_000.0, 1000.0
_MOON_KM3_S2, _MOON_KM, _MOON_RADIUS_KM = 4902.8, (356_000.0, 407_000.0), 1737.0
# Farther out the Moon and the Sun may pull more than the Earth. Acceleration of so many times what all three
# can do, and of what an engine adds (km/s) within an arc of at most so many seconds each way, is none of
# theirs; up to where the Sun's pull still grows as the distance does.
_FAR_TIMES, _FAR_PUSH_KM_S, _FAR_ARC_S, _FARTHEST_KM = 10.0, 0.1, 10_000.0, 3e7
_SUN_TIDE_S2 = 2.0 * 1.327e11 / 1.496e8**3
_PROBES, _WIDEST = 60, 5
_ARC_RAD, _MORE_ROWS = 0.05, 2
# Velocities of elements' propagators are some metres a second from the derivatives of their places.
_OTHER_KM_S = 0.02
# A row is off where it is by more than this, and by so many times what a quarter of all rows are less.
_OFF_KM, _OFF_TIMES = 0.005, 15.0
# Of what a wrong row does to its neighbours, so much may be left when it is put right.
_LEFT = 0.3
# No engine pushes like this (km/s²), and nothing that is tracked goes so fast (km/s).
_PUSH_KM_S2, _FASTEST_KM_S = 0.02, 100.0
_AT_ONCE = 50_000


class _Wrong(NamedTuple):
    row: int
    off_km: float
    jump: bool = False
    """All rows from this one on are elsewhere, at the same velocities."""

    @property
    def words(self) -> str:
        """Say it for a reader."""
        if self.jump:
            return (
                f"is {_km(self.off_km)} from where the rows before it lead, and those after it go on from "
                "there: a time is wrong from here on, as by a leap second, or these are two orbits"
            )
        return (
            f"is not on the orbit of the rows about it, but off by some {_km(self.off_km)}: a digit, a sign "
            "or a unit is wrong"
        )


def falling(
    segments: list[Segment], name: str, source: str, by_places: Interpolation | None = None
) -> list[Segment]:
    """Return the rows of an object, divided where engines changed the orbit between two of them.

    `by_places` is how rows are interpolated whose velocities are poor, see `without_poor_velocities`; None
    where the velocities are used in any case.
    Raises EphemerisError, which names the line, where a row is wrong, and where rows are no orbit, or too far
    apart to interpolate.
    """
    return [part for one in segments for part in _parts(one, name, source, by_places)]


def _parts(one: Segment, name: str, source: str, by_places: Interpolation | None) -> list[Segment]:
    if len(one.since_s) < 2:
        return [one]
    wrong, burns = None, list[int]()
    if len(one.since_s) > 2:
        if one.velocity_km_s is None:
            wrong = _by_places(one)
        else:
            wrong, burns = _by_velocities(one)
    if wrong is not None:
        when = utc_of_tai(one.zero_s, float(one.since_s[wrong.row])).isoformat("milliseconds")
        raise EphemerisError(
            f"the row of {name} at {when} {wrong.words}; get the file anew",
            source=source,
            line=one.line_of(wrong.row),
        )
    _check_speed(one, name, source)
    edges = sorted({0, len(one.since_s) - 1, *burns, *(k + 1 for k in burns)})
    parts = []
    for first, last in itertools.pairwise(edges):
        part = one.part(first, last + 1, "a manoeuvre" if first else one.why)
        if first not in burns:
            if by_places is not None and part.velocity_km_s is not None:
                part = without_poor_velocities(part, by_places)
            _check_gravity(part, name, source)
        if part.use_s[0] <= part.use_s[1]:
            parts.append(part)
    return parts


def _inertial(one: Segment, rows: slice | Index) -> tuple[Array, Array]:
    """Return places and velocities of rows, shape (n, 3), against the stars, the poles being left alone."""
    place = one.place_km[rows]
    velocity = np.zeros_like(place) if one.velocity_km_s is None else one.velocity_km_s[rows]
    if one.frame.kind != "ITRF":
        return place, velocity
    angle = EVEN_TURN_RAD_S * one.since_s[rows]
    c, s = np.cos(angle), np.sin(angle)
    (x, y, z), (vx, vy, vz) = place.T, velocity.T
    vx, vy = vx - EVEN_TURN_RAD_S * y, vy + EVEN_TURN_RAD_S * x
    place = np.stack([x * c - y * s, x * s + y * c, z], axis=1)
    return place, np.stack([vx * c - vy * s, vx * s + vy * c, vz], axis=1)


def _square(vectors: Array) -> Array:
    """Return the squares of lengths, shape (n,), of vectors (n, 3)."""
    squares: Array = np.einsum("nc,nc->n", vectors, vectors)
    return squares


def _length(vectors: Array) -> Array:
    """Return the lengths, shape (n,), of vectors (n, 3)."""
    lengths: Array = np.sqrt(_square(vectors))
    return lengths


def _pull(place: Array) -> Array:
    """Return gravity at places (n, 3); of those inside the Earth that of one place near its middle."""
    inside = _square(place) < _LOWEST_KM**2
    return np.array(gravity_km_s2(*np.where(inside[:, None], _LOWEST_KM, place).T)).T


def _moon_pull(height_km: Array) -> Array:
    """Return the most by which the Moon pulls more at a height than at the Earth, km/s²."""
    return 2.0 * _MOON_KM3_S2 * height_km / (_MOON_KM[0] - np.minimum(height_km, _HIGHEST_KM)) ** 3


def _far_pull(least_km: Array, most_km: Array) -> Array:
    """Return acceleration that Earth, Moon and Sun together cannot give between two heights, km/s²."""
    to_moon = np.maximum(np.maximum(_MOON_KM[0] - most_km, least_km - _MOON_KM[1]), _MOON_RADIUS_KM)
    by_moon = np.minimum(_FAR_TIMES / to_moon**2, 1.0 / _MOON_RADIUS_KM**2)
    others: Array = MU_KM3_S2 / least_km**2 + _MOON_KM3_S2 / _MOON_KM[0] ** 2 + _SUN_TIDE_S2 * most_km
    return _FAR_TIMES * others + _MOON_KM3_S2 * by_moon


def _turns_2(*places: Array) -> Array:
    """Return twice the square of the rate at which the nearest of the places is gone round (rad/s)², (n,)."""
    nearest = np.min([_square(place) for place in places], axis=0)
    rates: Array = 2.0 * MU_KM3_S2 / np.maximum(nearest, _LOWEST_KM**2) ** 1.5
    return rates


def _by_step(one: Segment) -> Array:
    """Return by how much gravity misses each row by the one before it and both velocities, km, (n - 1, 3)."""
    count = len(one.since_s)
    missed = np.empty((count - 1, 3))
    for first in range(0, count - 1, _AT_ONCE):
        rows = slice(first, min(first + _AT_ONCE, count - 1) + 1)
        missed[rows.start : rows.stop - 1] = _fallen(one.since_s[rows], *_inertial(one, rows))
    return missed


def _fallen(since_s: Array, place: Array, velocity: Array) -> Array:
    """Return what gravity misses between rows: the trapezoidal rule with its correction at the ends."""
    h = np.diff(since_s)[:, None]
    pull = _pull(place)
    missed: Array = np.diff(place, axis=0) - 0.5 * h * (velocity[1:] + velocity[:-1])
    missed += h * h / 12.0 * np.diff(pull, axis=0)
    return missed


def _sped(since_s: Array, place: Array, velocity: Array) -> Array:
    """Return what gravity misses of the velocity between rows, km/s, by the same rule as `_fallen`."""
    h = np.diff(since_s)[:, None]
    pull = _pull(place)
    away_2 = np.maximum(_square(place), _LOWEST_KM**2)[:, None]
    rising = np.sum(place * velocity, axis=1)[:, None] / away_2
    change = MU_KM3_S2 / away_2**1.5 * (3.0 * rising * place - velocity)
    sped: Array = np.diff(velocity, axis=0) - 0.5 * h * (pull[1:] + pull[:-1])
    sped += h * h / 12.0 * np.diff(change, axis=0)
    return sped


def _fallen_own_km(one: Segment, first: Index, last: Index) -> Array:
    """Return by how much `_fallen` itself is wrong between rows at the most, km."""
    place = one.place_km[first]
    # Twice what it is on a circle's: near a perigee high derivatives grow.
    rate = np.sqrt(2.0 * _turns_2(place, one.place_km[last]))
    own: Array = (one.since_s[last] - one.since_s[first]) ** 5 * rate**5 * _length(place) / 720.0
    return own


def _by_neighbours(one: Segment) -> Array:
    """Return by how much gravity misses each row by those on both sides (Numerov), km, shape (n, 3).

    It is 0 at the ends and where steps are uneven by a tenth.
    """
    count = len(one.since_s)
    missed = np.zeros((count, 3))
    for first in range(1, count - 1, _AT_ONCE):
        last = min(first + _AT_ONCE, count - 1)
        place, _ = _inertial(one, slice(first - 1, last + 1))
        step = np.diff(one.since_s[first - 1 : last + 1])
        h1, h2 = step[:-1, None], step[1:, None]
        pull = _pull(place)
        off = _missed_pull(h1, h2, (place[:-2], place[1:-1], place[2:]), (pull[:-2], pull[1:-1], pull[2:]))
        even = np.abs(h2 - h1) < 0.1 * np.minimum(h1, h2)
        missed[first:last] = np.where(even, h1 * h2 * off, 0.0)
    return missed


def _missed_pull(before_s: Array, after_s: Array, places: _Three, pulls: _Three) -> Array:
    """Return what gravity misses of the acceleration that three rows have, km/s² (n, 3): Numerov's rule.

    The steps before and after the middle row, shape (n, 1), may be uneven.
    """
    h1, h2 = before_s, after_s
    both = h1 + h2
    first = (h1 * h1 + h1 * h2 - h2 * h2) / (6.0 * h1 * both)
    last = (h2 * h2 + h1 * h2 - h1 * h1) / (6.0 * h2 * both)
    missed = 2.0 * ((places[2] - places[1]) / h2 - (places[1] - places[0]) / h1) / both
    missed -= first * pulls[0] + (1.0 - first - last) * pulls[1] + last * pulls[2]
    return missed


def _by_velocities(one: Segment) -> tuple[_Wrong | None, list[int]]:
    """Return the first wrong row, and the steps, by their first rows, in which engines changed the orbit."""
    size = _length(_by_step(one))
    most = _most(size)
    far = size > most
    some = np.flatnonzero(far)
    far[some] = size[some] > most + _fallen_own_km(one, some, some + 1)
    burns: list[int] = []
    for first, stop in _runs(far):
        peak = float(size[first:stop].max())
        if first == 0 or stop == len(size):
            # Nothing beyond tells what engines did from a wrong row at the end.
            if peak > _MOVES_KM or stop - first > 1:
                return _Wrong(stop - 1 if first == 0 else first + 1, peak), []
            continue
        ends = np.array([first, stop])
        place, velocity = _inertial(one, ends)
        left = float(np.linalg.norm(_fallen(one.since_s[ends], place, velocity)))
        left -= float(_fallen_own_km(one, ends[:1], ends[1:])[0])
        step = float(np.diff(one.since_s[ends])[0])
        if (stop - first > 1 and left < _LEFT * peak) or peak > _PUSH_KM_S2 * step**2:
            return _Wrong(first + 1, peak), []
        near = float(_length(place).max()) < _HIGHEST_KM
        # Engines move nothing that they do not make faster or slower.
        pushed = step * float(np.linalg.norm(_sped(one.since_s[ends], place, velocity)))
        if near and left > _MOVES_KM + pushed:
            return _Wrong(first + 1, left, jump=True), []
        cubic_km = step**4 * float(_turns_2(place)[0]) ** 2 * float(np.linalg.norm(place[0])) / 384.0
        if peak > _MOVES_KM + cubic_km and near and one.interpolation.with_velocities:
            burns += range(first, stop)
    return None, burns


def _by_places(one: Segment) -> _Wrong | None:
    """Return the first row that is wrong by the places of those about it.

    A row that is wrong by e is missed by -2 e, and both its neighbours by e.
    """
    count = len(one.since_s)
    missed = _by_neighbours(one)
    size = _length(missed[1:-1])
    most = _most(size)
    # What is elsewhere from a row on is missed by so much before it, and the other way after it.
    both = _length(missed[1:-2] + missed[2:-1])
    jumps = np.flatnonzero((size[:-1] > most + _MOVES_KM) & (both < _LEFT * size[:-1]))
    middle = np.unique(np.flatnonzero(size > most)[:, None] + np.arange(3))
    if len(middle) == 0:
        return None
    missed = np.pad(missed, ((2, 2), (0, 0)))
    judged = np.pad(np.ones(count - 2), 3)
    taken = np.stack([w * judged[middle + k] for k, w in ((1, 1.0), (2, -2.0), (3, 1.0))])
    about = np.stack([missed[middle + k] for k in (1, 2, 3)])
    off = np.einsum("kn,knc->nc", taken, about) / np.maximum(np.sum(taken**2, axis=0), 1.0)[:, None]
    rest = np.linalg.norm(about - taken[:, :, None] * off, axis=2).max(axis=0)
    for k in (0, 4):
        rest = np.maximum(rest, _length(missed[middle + k]))
    off_km = _length(off)
    wrong = np.flatnonzero((off_km > most) & (rest < _LEFT * off_km))
    if len(wrong):
        return _Wrong(int(middle[wrong[0]]), float(off_km[wrong[0]]))
    if len(jumps):
        return _Wrong(int(jumps[0]) + 2, float(size[jumps[0]]), jump=True)
    pushed = np.flatnonzero(size > _PUSH_KM_S2 * np.diff(one.since_s)[1:] ** 2)
    return _Wrong(int(pushed[0]) + 1, float(size[pushed[0]])) if len(pushed) else None


def _most(size: Array) -> float:
    """Return by how much rows may be off that are right."""
    return _OFF_KM + _OFF_TIMES * float(np.quantile(size, 0.25))


def _km(length_km: float) -> str:
    """Return a length in three digits at the least."""
    return f"{length_km:.3g} km" if length_km < 1000.0 else f"{length_km:.0f} km"


def _runs(told: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return the first and one past the last of each run of what is true."""
    edges = np.flatnonzero(np.diff(np.pad(told.astype(np.int8), 1)))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def _check_speed(one: Segment, name: str, source: str) -> None:
    """Refuse rows that go as nothing does; those of a file in metres are far from the Earth's pull."""
    place, velocity = _inertial(one, slice(None))
    speed = _length(np.diff(place, axis=0)) / np.diff(one.since_s)
    if one.velocity_km_s is not None:
        pace = _length(velocity)
        speed = np.maximum(speed, np.maximum(pace[:-1], pace[1:]))
    fast = np.flatnonzero(speed > _FASTEST_KM_S)
    if len(fast):
        row = int(fast[0])
        raise EphemerisError(
            f"the rows of {name} go at {float(speed[row]):.4g} km/s from here on: check their units",
            source=source,
            line=one.line_of(row),
        )


def _check_gravity(one: Segment, name: str, source: str) -> None:
    """Refuse rows near the Earth that do not fall as gravity has it, or are too far apart to interpolate.

    Gravity is asked over arcs: velocities of elements' propagators are not the derivatives of their places to
    some metres a second, which an interpolated acceleration shows, and no place.
    """
    steps = np.diff(one.since_s)
    turns = steps**2 * _turns_2(one.place_km[:-1])
    even = np.linspace(0, len(steps) - 1, _PROBES).astype(np.intp)
    pieces = np.unique(np.concatenate([even, *(np.argsort(k)[-_WIDEST:] for k in (steps, turns))]))
    found = _off_arcs(one, pieces) if len(one.since_s) > 2 else None
    few = len(one.since_s) < one.interpolation.rows + _MORE_ROWS
    found = found or (_off_between(one, pieces) if few else _off_by_more_rows(one, pieces))
    if found is not None:
        row, words = found
        when = utc_of_tai(one.zero_s, float(one.since_s[row])).isoformat("seconds")
        step = float(one.since_s[row + 1] - one.since_s[row])
        raise EphemerisError(
            f"the rows of {name} about {when}, {step:g} s apart, {words}",
            source=source,
            line=one.line_of(row),
        )


def _no_orbit(one: Segment, share: float) -> str:
    if not np.isfinite(share):
        return f"are inside the Earth in {one.frame.written}: check their units"
    return (
        f"are no orbit about the Earth in {one.frame.written}: their acceleration differs by "
        f"{100.0 * share:.1f} % from gravity: check frame, units and velocities, or get rows closer together"
    )


def _off_arcs(one: Segment, pieces: Index) -> tuple[int, str] | None:
    """Return the first row that does not fall, or has another velocity, than the places about it say.

    By Numerov's rule for uneven steps, over arcs of a twentieth of a radian or a step each way.
    """
    middle = np.clip(pieces, 1, len(one.since_s) - 2)
    arc_s = _ARC_RAD / np.sqrt(_turns_2(one.place_km[middle]) / 2.0)
    high_up = _length(one.place_km[middle]) >= _HIGHEST_KM
    arc_s = np.where(high_up, np.minimum(arc_s, _FAR_ARC_S), arc_s)
    low = np.searchsorted(one.since_s, one.since_s[middle] - arc_s)
    high = np.searchsorted(one.since_s, one.since_s[middle] + arc_s)
    low, high = np.minimum(low, middle - 1), np.clip(high, middle + 1, len(one.since_s) - 1)
    (a, _), (b, vb), (c, _) = (_inertial(one, rows) for rows in (low, middle, high))
    h1, h2 = (np.diff(one.since_s[np.stack(rows)], axis=0)[0] for rows in ((low, middle), (middle, high)))
    both = h1 + h2
    pulls = _pull(a), _pull(b), _pull(c)
    missed = _length(_missed_pull(h1[:, None], h2[:, None], (a, b, c), pulls))
    before, after = (b - a) / h1[:, None], (c - b) / h2[:, None]
    height = _length(b)
    share = np.maximum(missed - _moon_pull(height), 0.0) / _length(pulls[1])
    share[height < _LOWEST_KM] = np.inf
    rate = np.sqrt(_turns_2(a, b, c) / 2.0)
    own = (rate * np.maximum(h1, h2)) ** 4
    near = height < _HIGHEST_KM
    most_share = _GRAVITY_SHARE * np.maximum(height / _SHARE_KM, 1.0)
    bad = np.flatnonzero(near & (share > most_share + own / 24.0))
    if len(bad):
        return int(pieces[bad[0]]), _no_orbit(one, float(share[bad[0]]))
    heights = np.linalg.norm(np.stack([a, b, c]), axis=2)
    least, most = heights.min(axis=0), heights.max(axis=0)
    most_pull = _far_pull(np.maximum(least, _HIGHEST_KM), most) + 2.0 * _FAR_PUSH_KM_S / both
    far = (least >= _HIGHEST_KM) & (most < _FARTHEST_KM)
    bad = np.flatnonzero(far & (missed > most_pull))
    if len(bad):
        k = int(bad[0])
        return int(pieces[k]), (
            f"are no orbit in {one.frame.written}: {_km(float(height[k]))} from the Earth's centre their "
            f"acceleration is {float(missed[k]):.2g} km/s², where gravity gives less than "
            f"{float(most_pull[k]):.2g}: check units, decimal points and frame"
        )
    if one.velocity_km_s is None or not one.interpolation.with_velocities:
        return None
    speed = (before * h2[:, None] + after * h1[:, None]) / both[:, None]
    speed -= (h1 * h2 / (6.0 * both))[:, None] * (pulls[2] - pulls[0])
    other = _length(speed - vb)
    bad = np.flatnonzero(near & (other > _OTHER_KM_S + rate * height * own / 4.0))
    if len(bad) == 0:
        return None
    words = f"have velocities that are {1000.0 * float(other[bad[0]]):.0f} m/s from those of their places"
    return int(pieces[bad[0]]), f"{words}: check frame and units"


def _off_by_more_rows(one: Segment, pieces: Index) -> tuple[int, str] | None:
    """Return the first step, not near the ends, in which more rows would move what is interpolated."""
    edge = (one.interpolation.rows + _MORE_ROWS) // 2
    pieces = pieces[(pieces >= edge) & (pieces < len(one.since_s) - edge)]
    since = 0.5 * (one.since_s[pieces] + one.since_s[pieces + 1])
    by_more = replace(one.interpolation, rows=one.interpolation.rows + _MORE_ROWS)
    places = (part.native_many(since)[:3] for part in (one, replace(one, interpolation=by_more)))
    moved_km = np.linalg.norm(next(places) - next(places), axis=0)
    bad = np.flatnonzero(moved_km > _MOVES_KM)
    if len(bad) == 0:
        return None
    return int(pieces[bad[0]]), (
        f"are too far apart to interpolate ({one.interpolation.words}): {_MORE_ROWS} rows more move "
        f"what is between them by {_km(float(moved_km[bad[0]]))}: get rows closer together"
    )


def _off_between(one: Segment, pieces: Index) -> tuple[int, str] | None:
    """Return the first of few rows that, interpolated, do not fall as gravity has it."""
    since = 0.5 * (one.since_s[pieces] + one.since_s[pieces + 1])
    tai_s = one.zero_s + since
    unix_s = tai_s - leaps_s(tai_s)
    state = one.frame.to_teme(EarthOrientation.fixed(0.0), unix_s, tuple(one.native_many(since)), ARRAYS)
    place, pull = np.array(state[:3]).T, np.array(state[6:9]).T
    ends = _length(one.place_km[pieces])
    height = np.minimum(_length(place), ends)
    gravity = _pull(place)
    missed = np.maximum(_length(pull - gravity) - _moon_pull(height), 0.0)
    share = missed / _length(gravity)
    # A polynomial that meets the rows at both ends, off by so much in between.
    moved_km = missed * (one.since_s[pieces + 1] - one.since_s[pieces]) ** 2 / 10.0
    # Of three rows and more the arcs tell whether they fall.
    other = (share > _GRAVITY_SHARE) & (len(one.since_s) < 3)
    bad = np.flatnonzero((other | (moved_km > _MOVES_KM) | (height < _LOWEST_KM)) & (height < _HIGHEST_KM))
    if len(bad) and len(one.since_s) < 3 and ends[0] > _LOWEST_KM:
        return 0, "are just two, and no orbit goes by a polynomial of two rows: get a file with more"
    share[height < _LOWEST_KM] = np.inf
    return (int(pieces[bad[0]]), _no_orbit(one, float(share[bad[0]]))) if len(bad) else None
