"""Who follows what: passes assigned to stations for the largest total value, with a proven bound on it.

What ties stations together, a satellite's fresh pass and two looking at once, changes values only: any plans
of the stations go together. So those ties get prices (Lagrange), by which each station's best plan is found
exactly; prices that fit make the bound small. HiGHS closes the gap that is left: at once, or of many passes
one part after another. Each pass is a variable, 0 or 1; of sets of a station's passes of which no two fit
one is taken; two more variables of a pass, from 0 to 1, say whether it is the fresh one and whether another
station looks as well.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import count
from typing import TYPE_CHECKING, Any

import numpy as np

from sattrack.core.errors import SattrackError, how_to_install

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    Array = NDArray[np.float64]
    Index = NDArray[np.intp]

NO_HIGHS = f"network assign needs HiGHS: {how_to_install('cluster')}"
_TAKEN = 0.5
_MUST = 1e9
_SHARE = 0.7
"""Share of the time after which prices are left and HiGHS begins."""
_MOST, _MOST_AT_ONCE, _MOST_S = 12_000, 1_000, 5.0
"""Of more passes than the first HiGHS takes parts of the second size, each for that many seconds."""
_SWEEPS = 3
_SLOWEST, _PATIENCE, _EVERY, _NOTICED = 0.004, 4, 10, 1e-4


class StationPasses:
    """The passes of one station by index, in order of their ends, and which of them clash (n, n).

    Of two that do not clash the one that ends first comes first.
    """

    def __init__(self, members: Index, clash: NDArray[np.bool_]) -> None:
        self.members, self.clash = members, clash

    @cached_property
    def _before(self) -> list[tuple[int, list[int]]]:
        """What may come before each pass: all up to an index, and some more."""
        before = []
        for one in range(len(self.members)):
            clashing = np.flatnonzero(self.clash[:one, one])
            first = int(clashing[0]) if len(clashing) else one
            before.append((first, (first + np.flatnonzero(~self.clash[first:one, one])).tolist()))
        return before

    def best(self, worth: Array, kept: Index) -> tuple[float, Index]:
        """Return the largest sum of worths (by index) of a plan with those that are kept, and the plan."""
        own = worth[self.members]
        must = np.isin(self.members, kept)
        values = own.tolist()
        if must.any():
            shut = self.clash[must].any(axis=0) & ~must
            values = np.where(must, own + _MUST, np.where(shut, -math.inf, own)).tolist()
        top: list[float] = [0.0]
        ends: list[int] = [-1]
        total: list[float] = []
        links: list[int] = []
        for one, (first, others) in enumerate(self._before):
            most, link = top[first], ends[first]
            for other in others:
                if total[other] > most:
                    most, link = total[other], other
            total.append(most + values[one])
            links.append(link)
            better = total[one] > top[one]
            top.append(total[one] if better else top[one])
            ends.append(one if better else ends[one])
        chosen: list[int] = []
        at = ends[-1]
        while at >= 0:
            # Where slews obey no triangle's inequality, what clashes with a later one is left out.
            if not self.clash[at, chosen].any():
                chosen.append(at)
            at = links[at]
        return top[-1] - _MUST * int(must.sum()), self.members[chosen[::-1]]


@dataclass(frozen=True, slots=True)
class Assignment:
    """A problem: values of n passes, and what ties them together, all by index.

    Each station takes passes of which no two clash. Of those with one number in `fresh` (n,; -1: none) the
    most valuable that is taken counts in full, each other, and those with -1, for the share `repeat`. A
    pass of which one in `together` is taken as well counts `parallax` times its value more. Those in `kept`
    are taken, those without a value never.
    """

    start_s: Array
    value: Array
    stations: Sequence[StationPasses]
    fresh: Index
    together: dict[int, Index] = field(default_factory=dict)
    kept: Index = field(default_factory=lambda: np.empty(0, dtype=np.intp))
    repeat: float = 0.25
    parallax: float = 0.5

    def worth(self, taken: Index) -> float:
        """Return the total value of some passes."""
        return float(np.sum(self.worths(taken)))

    def worths(self, taken: Index) -> Array:
        """Return what each of some passes adds to the total, shape (k,)."""
        is_taken = np.zeros(len(self.value), dtype=bool)
        is_taken[taken] = True
        shares = np.full(len(taken), self.repeat)
        best: dict[int, int] = {}
        for place, one in enumerate(taken.tolist()):
            group = int(self.fresh[one])
            if group >= 0 and (group not in best or self.value[one] > self.value[taken[best[group]]]):
                best[group] = place
        shares[list(best.values())] = 1.0
        for place, one in enumerate(taken.tolist()):
            if one in self.together and is_taken[self.together[one]].any():
                shares[place] += self.parallax
        found: Array = shares * self.value[taken]
        return found


def exclusive_sets(clash: NDArray[np.bool_]) -> list[Index]:
    """Return sets of passes of which no two go together, so that each pair that clashes is in one of them.

    `clash` (n, n), symmetric, has the passes of one station in order of their starts.
    """
    found = []
    for last in range(len(clash)):
        left = np.flatnonzero(clash[:last, last])[::-1]
        while len(left):
            chosen: list[int] = []
            may = np.ones(len(left), dtype=bool)
            for place, one in enumerate(left.tolist()):
                if may[place]:
                    chosen.append(one)
                    may &= clash[one, left]
            found.append(np.array([*chosen, last], dtype=np.intp))
            left = left[~np.isin(left, chosen)]
    return found


def greedy(problem: Assignment) -> Index:
    """Return what comes of taking the most valuable pass that still fits, again and again."""
    taken: list[int] = []
    for station in problem.stations:
        free = np.ones(len(station.members), dtype=bool)
        is_kept = np.isin(station.members, problem.kept)
        order = np.lexsort((station.members, -problem.value[station.members], ~is_kept))
        for one in order.tolist():
            if free[one] and (is_kept[one] or problem.value[station.members[one]] > 0.0):
                taken.append(int(station.members[one]))
                free &= ~station.clash[one]
    return np.array(sorted(taken), dtype=np.intp)


class _Ties:
    """What ties passes of several stations together, in pairs by index.

    `one`, `other`: each pass and each that is at once with it. `near_of`, `near`: the same, and each tied
    pass with itself. `fresh_of`, `fresh_near`: those of the latter that have one number in `fresh`.
    """

    def __init__(self, problem: Assignment) -> None:
        rows, none = problem.together, np.empty(0, dtype=np.intp)
        self.one = np.concatenate([none, *(np.repeat(one, len(others)) for one, others in rows.items())])
        self.other = np.concatenate([none, *rows.values()])
        tied = np.unique(self.one)
        self.near_of = np.concatenate([self.one, tied])
        self.near = np.concatenate([self.other, tied])
        number = problem.fresh[self.near_of]
        same = (number >= 0) & (number == problem.fresh[self.near])
        self.fresh_of, self.fresh_near = self.near_of[same], self.near[same]
        self.is_tied = np.zeros(len(problem.value), dtype=bool)
        self.is_tied[tied] = True


class _Prices:
    """Prices of the ties between stations, and the bound and the plans that they lead to.

    The prices are an array of three parts: of each fresh stretch (and one of no meaning, for passes without),
    of each pass that another is at once with it, and of each pass the last row of `_tie_rows`.
    """

    def __init__(self, problem: Assignment, ties: _Ties) -> None:
        self._problem, self._ties = problem, ties
        self._groups = int(problem.fresh.max(initial=-1)) + 1
        self._is_grouped = problem.fresh >= 0

    def look(self, prices: Array) -> tuple[float, Index, Array]:
        """Return the bound, the passes taken, and the slopes of the bound by all prices."""
        problem, ties, size = self._problem, self._ties, len(self._problem.value)
        fresh, together, tight = np.split(prices, [self._groups + 1, self._groups + 1 + size])
        as_fresh = (1.0 - problem.repeat) * problem.value - fresh[problem.fresh]
        as_fresh -= _sums(ties.fresh_near, tight[ties.fresh_of], size)
        as_one = problem.parallax * problem.value - together - tight
        is_fresh, is_one = self._is_grouped & (as_fresh > 0.0), ties.is_tied & (as_one > 0.0)
        worth = (
            problem.repeat * problem.value + np.where(is_fresh, as_fresh, 0.0) + np.where(is_one, as_one, 0.0)
        )
        worth += _sums(ties.other, together[ties.one], size) + _sums(ties.near, tight[ties.near_of], size)
        worth[problem.value <= 0.0] = -math.inf
        plans = [station.best(worth, problem.kept) for station in problem.stations]
        taken = np.concatenate([chosen for _, chosen in plans])
        x = np.zeros(size)
        x[taken] = 1.0
        fresh_x, one_x = x * is_fresh, x * is_one
        left = 1.0 - _sums(problem.fresh[self._is_grouped], fresh_x[self._is_grouped], self._groups + 1)
        left[-1] = 0.0
        partners = _sums(ties.one, x[ties.other], size) - one_x
        room = _sums(ties.near_of, x[ties.near], size) - one_x
        room -= _sums(ties.fresh_of, fresh_x[ties.fresh_near], size)
        bound = sum(best for best, _ in plans) + float(np.sum(fresh[:-1]))
        return bound, taken, np.concatenate([left, partners * ties.is_tied, room * ties.is_tied])

    def descend(self, plain: Index, until_s: float, gap: float) -> tuple[Index, float, float]:
        """Return the best choice met with its value, and the least bound, within a time."""
        problem, best = self._problem, plain
        value, bound = problem.worth(plain), math.inf
        pace, stale = 1.0, 0
        prices = np.zeros(self._groups + 1 + 2 * len(problem.value))
        for number in count():
            if pace < _SLOWEST or time.monotonic() > until_s:
                break
            total, taken, slope = self.look(prices)
            stale = 0 if total < bound * (1.0 - _NOTICED) else stale + 1
            bound = min(bound, total)
            if number % _EVERY == 0:
                for _ in range(_SWEEPS):
                    taken = _improved(problem, self._ties, taken, problem.stations)
                if (found := problem.worth(taken)) > value:
                    best, value = taken, found
            if bound - value <= gap * bound:
                break
            if stale >= _PATIENCE:
                pace, stale = 0.7 * pace, 0
            # A price of zero does not fall further.
            slope = np.where((prices <= 0.0) & (slope > 0.0), 0.0, slope)
            square = float(np.sum(slope * slope))
            if square == 0.0:
                break
            prices = np.maximum(prices - pace * (total - value) / square * slope, 0.0)
        return best, value, bound


def _sums(which: Index, values: Array, size: int) -> Array:
    """Return the sums of values by index, shape (size,)."""
    return np.bincount(which, values, minlength=size).astype(np.float64, copy=False)


def _improved(problem: Assignment, ties: _Ties, taken: Index, stations: Sequence[StationPasses]) -> Index:
    """Return a choice in which some stations in turn have the best plan beside those of the others."""
    size, is_taken = len(problem.value), np.zeros(len(problem.value), dtype=bool)
    is_taken[taken] = True
    for station in stations:
        is_taken[station.members] = False
        best = np.zeros(int(problem.fresh.max(initial=-1)) + 2)
        others = np.flatnonzero(is_taken & (problem.fresh >= 0))
        np.maximum.at(best, problem.fresh[others], problem.value[others])
        extra = np.where(problem.fresh >= 0, np.maximum(problem.value - best[problem.fresh], 0.0), 0.0)
        worth = problem.repeat * problem.value + (1.0 - problem.repeat) * extra
        partners = _sums(ties.one, is_taken[ties.other], size)
        worth += problem.parallax * problem.value * (partners > 0)
        lonely = is_taken[ties.one] & (partners[ties.one] == 0)
        worth += _sums(ties.other, problem.parallax * problem.value[ties.one] * lonely, size)
        worth[problem.value <= 0.0] = -math.inf
        is_taken[station.best(worth, problem.kept)[1]] = True
    return np.flatnonzero(is_taken)


@dataclass(frozen=True, slots=True)
class Assigned:
    """The passes taken, what they are worth, and what no choice can exceed."""

    taken: Index
    value: float
    bound: float

    @property
    def gap(self) -> float:
        """How far the bound is above the value, as a share of the bound."""
        return max(0.0, self.bound - self.value) / self.bound if self.bound > 0.0 else 0.0


def assign(
    problem: Assignment, seconds: float = 60.0, gap: float = 1e-4, known: Index | None = None
) -> Assigned:
    """Return the best choice found within a time, never worth less than the greedy one, nor a known one.

    It ends sooner where the bound is within a share `gap`. Raises SattrackError without HiGHS, or where the
    passes that are kept exclude each other.
    """
    try:
        import highspy
    except ImportError:
        raise SattrackError(NO_HIGHS) from None
    until_s = time.monotonic() + seconds
    size = len(problem.value)
    if size == 0:
        return Assigned(np.empty(0, dtype=np.intp), 0.0, 0.0)
    for station in problem.stations:
        kept = np.isin(station.members, problem.kept)
        if station.clash[np.ix_(kept, kept)].any():
            raise SattrackError("what has begun cannot all be kept: passes of one station overlap")
    start = greedy(problem)
    if known is not None and problem.worth(known) > problem.worth(start):
        start = known
    prices = _Prices(problem, _Ties(problem))
    found, value, bound = prices.descend(start, until_s - (1.0 - _SHARE) * seconds, gap)
    order = np.argsort(problem.start_s, kind="stable")
    most = size if size <= _MOST else _MOST_AT_ONCE
    before = -math.inf
    # Anew, as long as it leads to something better.
    while value > before * (1.0 + _NOTICED):
        before = value
        for low in range(0, size, most if most == size else most // 2):
            left_s = until_s - time.monotonic()
            allowed_s = left_s if most == size else _MOST_S
            if bound - value <= gap * bound or left_s < allowed_s or left_s <= 0.0:
                break
            part, which = _part(problem, order[low : low + most], found)
            known = np.flatnonzero(np.isin(which, found))
            taken, above = _solved(part, known, allowed_s, gap * most / size, highspy)
            if (better := problem.worth(which[taken])) > value:
                found, value = which[taken], better
            if most == size:
                return Assigned(found, value, max(value, min(bound, above)))
    return Assigned(found, value, max(value, bound))


def repaired(problem: Assignment, taken: Index, stations: Sequence[StationPasses]) -> Index:
    """Return a choice in which some stations have the best plan beside what the others take already."""
    return _improved(problem, _Ties(problem), taken, stations)


def _part(problem: Assignment, free: Index, taken: Index) -> tuple[Assignment, Index]:
    """Return the problem of passes that are free to be taken beside some that are, and their indices."""
    which = np.union1d(free, taken)
    place = np.full(len(problem.value), -1, dtype=np.intp)
    place[which] = np.arange(len(which))
    stations = []
    for station in problem.stations:
        own = np.flatnonzero(place[station.members] >= 0)
        stations.append(StationPasses(place[station.members[own]], station.clash[np.ix_(own, own)]))
    together = {}
    for k, one in enumerate(which.tolist()):
        others = place[problem.together[one]] if one in problem.together else place[:0]
        if (others >= 0).any():
            together[k] = others[others >= 0]
    kept = np.union1d(np.intersect1d(problem.kept, which), np.setdiff1d(taken, free))
    return (
        replace(
            problem,
            start_s=problem.start_s[which],
            value=problem.value[which],
            stations=stations,
            fresh=problem.fresh[which],
            together=together,
            kept=place[kept],
        ),
        which,
    )


def _solved(
    problem: Assignment, known: Index, seconds: float, gap: float, highspy: Any
) -> tuple[Index, float]:
    """Return the best choice that HiGHS finds, beginning with a known one, and its bound."""
    model, start = _model(problem, known, highspy)
    solver = highspy.Highs()
    for name, value in (
        ("output_flag", False),
        ("time_limit", seconds),
        ("mip_rel_gap", gap),
        ("mip_abs_gap", 1e-9),
        ("random_seed", 0),
    ):
        solver.setOptionValue(name, value)
    solver.passModel(model)
    solution = highspy.HighsSolution()
    solution.col_value = start.tolist()
    solver.setSolution(solution)
    solver.run()
    columns = np.array(solver.getSolution().col_value)
    taken = np.flatnonzero(columns[: len(problem.value)] > _TAKEN) if len(columns) else known
    bound = float(solver.getInfo().mip_dual_bound)
    return taken, bound if math.isfinite(bound) else math.inf


def _model(problem: Assignment, known: Index, highspy: Any) -> tuple[Any, Array]:
    """Return the problem as HiGHS takes it, and a known choice as its columns.

    Columns: taken (n), fresh (n), together (n).
    """
    size, value = len(problem.value), problem.value
    sets, ties = _exclusive_rows(problem), _tie_rows(problem)
    rows = [(columns, [1.0] * len(columns)) for columns in sets] + ties
    upper, lower = np.ones(3 * size), np.zeros(3 * size)
    lower[problem.kept] = 1.0
    # What is worth nothing is not taken: so a station that is closed takes nothing either.
    upper[:size][(value <= 0.0) & (lower[:size] == 0.0)] = 0.0
    upper[size : 2 * size] = problem.fresh >= 0
    upper[2 * size :] = [one in problem.together for one in range(size)]
    lp = highspy.HighsLp()
    lp.num_col_, lp.num_row_ = 3 * size, len(rows)
    lp.sense_ = highspy.ObjSense.kMaximize
    lp.col_cost_ = np.concatenate(
        [problem.repeat * value, (1.0 - problem.repeat) * value, problem.parallax * value]
    )
    lp.col_lower_, lp.col_upper_ = lower, upper
    lp.row_lower_ = np.full(len(rows), -math.inf)
    lp.row_upper_ = np.repeat([1.0, 0.0], [len(sets), len(ties)])
    lp.a_matrix_.format_ = highspy.MatrixFormat.kRowwise
    lp.a_matrix_.start_ = np.cumsum([0, *(len(columns) for columns, _ in rows)]).astype(np.int32)
    lp.a_matrix_.index_ = np.array([c for columns, _ in rows for c in columns], dtype=np.int32)
    lp.a_matrix_.value_ = np.array([f for _, factors in rows for f in factors], dtype=np.float64)
    kinds = highspy.HighsVarType
    lp.integrality_ = [kinds.kInteger] * size + [kinds.kContinuous] * (2 * size)
    start = np.zeros(3 * size)
    start[known] = 1.0
    best: dict[int, int] = {}
    for one in known.tolist():
        group = int(problem.fresh[one])
        if group >= 0 and (group not in best or value[one] > value[best[group]]):
            best[group] = one
        if one in problem.together and start[problem.together[one]].any():
            start[2 * size + one] = 1.0
    start[[size + one for one in best.values()]] = 1.0
    return lp, start


def _exclusive_rows(problem: Assignment) -> list[list[int]]:
    """Return sets of columns of which one may be taken: passes that clash, fresh ones of one stretch."""
    found: list[list[int]] = []
    for station in problem.stations:
        order = np.argsort(problem.start_s[station.members], kind="stable")
        members = station.members[order]
        found += [members[one].tolist() for one in exclusive_sets(station.clash[np.ix_(order, order)])]
    groups: dict[int, list[int]] = {}
    for one in np.flatnonzero(problem.fresh >= 0).tolist():
        groups.setdefault(int(problem.fresh[one]), []).append(len(problem.value) + one)
    return found + [columns for columns in groups.values() if len(columns) > 1]


def _tie_rows(problem: Assignment) -> list[tuple[list[int], list[float]]]:
    """Return columns and factors whose sum is at most zero: what ties passes together.

    A pass is fresh, or together, only if it is taken; together only if another is. The last row follows for
    whole choices, not for shares of them: of a pass and those at once with it more are taken than one is
    fresh, if they are together. Without it half a pass could be both.
    """
    size, found = len(problem.value), []
    for one in range(size):
        if problem.fresh[one] >= 0:
            found.append(([size + one, one], [1.0, -1.0]))
        if one in problem.together:
            near = [one, *problem.together[one].tolist()]
            fresh = [size + k for k in near if 0 <= problem.fresh[k] == problem.fresh[one]]
            found.append(([2 * size + one, one], [1.0, -1.0]))
            found.append(([2 * size + one, *near[1:]], [1.0] + [-1.0] * (len(near) - 1)))
            found.append(([2 * size + one, *fresh, *near], [1.0] * (1 + len(fresh)) + [-1.0] * len(near)))
    return found
