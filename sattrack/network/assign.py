"""Who follows what: passes assigned to stations for the largest total value, with a proven bound on it.

What ties stations together, a satellite's fresh pass and two looking at once, changes values only: any plans
of the stations go together. So those ties get prices (Lagrange), by which each station's best plan is found
exactly; prices that fit make the bound small. HiGHS closes the gap that is left:
each pass is a variable, 0 or 1; of sets of a station's passes of which no two fit one is taken; two more
variables of a pass, from 0 to 1, say whether it is the fresh one and whether another station looks as well.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field
from itertools import count
from typing import TYPE_CHECKING, Any

import numpy as np

from sattrack.core.errors import SattrackError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    Array = NDArray[np.float64]
    Index = NDArray[np.intp]

NO_HIGHS = "network assign needs HiGHS: pip install 'sattrack[cluster]'"
_TAKEN = 0.5
_MUST = 1e9
_SHARE = 0.3
"""Share of the time after which prices are left and HiGHS begins."""
_MOST_FOR_HIGHS = 12_000
"""Of more passes HiGHS does not even relax the problem within a minute: prices have all the time."""
_SLOWEST, _PATIENCE, _EVERY = 0.004, 4, 5


class StationPasses:
    """The passes of one station by index, in order of their ends, and which of them clash (n, n).

    Of two that do not clash the one that ends first comes first.
    """

    def __init__(self, members: Index, clash: NDArray[np.bool_]) -> None:
        self.members, self.clash = members, clash
        before: list[tuple[int, list[int]]] = []
        for one in range(len(members)):
            clashing = np.flatnonzero(clash[:one, one])
            first = int(clashing[0]) if len(clashing) else one
            before.append((first, (first + np.flatnonzero(~clash[first:one, one])).tolist()))
        self._before = before

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


class _Prices:
    """Prices of the ties between stations, and the bound and the plans that they lead to."""

    def __init__(self, problem: Assignment) -> None:
        self._problem = problem
        self._of = [np.repeat(one, len(others)) for one, others in problem.together.items()]
        self._one = np.concatenate([np.empty(0, dtype=np.intp), *self._of])
        self._other = np.concatenate([np.empty(0, dtype=np.intp), *problem.together.values()])
        self._tied = np.zeros(len(problem.value), dtype=bool)
        self._tied[self._one] = True
        self._groups = int(problem.fresh.max(initial=-1)) + 1
        self._grouped = problem.fresh >= 0
        self.fresh, self.together = np.zeros(self._groups + 1), np.zeros(len(problem.value))

    def look(self) -> tuple[float, Index, NDArray[Any], NDArray[Any]]:
        """Return the bound, the passes taken, and the slopes of the bound by both kinds of prices."""
        problem, size = self._problem, len(self._problem.value)
        as_fresh = (1.0 - problem.repeat) * problem.value - self.fresh[problem.fresh]
        as_one = problem.parallax * problem.value - self.together
        is_fresh, is_one = self._grouped & (as_fresh > 0.0), self._tied & (as_one > 0.0)
        worth = (
            problem.repeat * problem.value + np.where(is_fresh, as_fresh, 0.0) + np.where(is_one, as_one, 0.0)
        )
        worth += np.bincount(self._other, self.together[self._one], minlength=size)
        worth[problem.value <= 0.0] = -math.inf
        total, taken = 0.0, []
        for station in problem.stations:
            best, chosen = station.best(worth, problem.kept)
            total += best
            taken.append(chosen)
        x = np.zeros(size)
        chosen_all = np.concatenate(taken)
        x[chosen_all] = 1.0
        by_fresh = np.bincount(
            problem.fresh[self._grouped], (x * is_fresh)[self._grouped], minlength=self._groups + 1
        )
        slope = 1.0 - by_fresh
        slope[-1] = 0.0
        partners = np.bincount(self._one, x[self._other], minlength=size) - x * is_one
        return total + float(np.sum(self.fresh[:-1])), chosen_all, slope, np.where(self._tied, partners, 0.0)

    def descend(self, plain: Index, until_s: float, gap: float) -> tuple[Index, float, float]:
        """Return the best choice met with its value, and the least bound, within a time."""
        problem, best = self._problem, plain
        value, bound, least = problem.worth(plain), math.inf, math.inf
        pace, stale = 1.0, 0
        for number in count():
            if pace < _SLOWEST or time.monotonic() > until_s:
                break
            total, taken, slope, ties = self.look()
            stale = 0 if total < least - 1e-4 * abs(least) else stale + 1
            least, bound = min(least, total), min(bound, total)
            if number % _EVERY == 0:
                improved = _improved(problem, taken)
                if (found := problem.worth(improved)) > value:
                    best, value = improved, found
            if bound - value <= gap * bound:
                break
            if stale >= _PATIENCE:
                pace, stale = 0.7 * pace, 0
            # A price of zero does not fall further.
            slope[(self.fresh <= 0.0) & (slope > 0.0)] = 0.0
            ties[(self.together <= 0.0) & (ties > 0.0)] = 0.0
            square = float(slope @ slope + ties @ ties)
            if square == 0.0:
                break
            step = pace * (total - value) / square
            self.fresh = np.maximum(self.fresh - step * slope, 0.0)
            self.together = np.maximum(self.together - step * ties, 0.0)
        return best, value, bound


def _improved(problem: Assignment, taken: Index) -> Index:
    """Return a choice in which each station in turn has the best plan beside those of the others."""
    is_taken = np.zeros(len(problem.value), dtype=bool)
    is_taken[taken] = True
    rows = [(one, others) for one, others in problem.together.items()]
    one_of = np.concatenate([np.empty(0, dtype=np.intp), *(np.repeat(one, len(o)) for one, o in rows)])
    other_of = np.concatenate([np.empty(0, dtype=np.intp), *(others for _, others in rows)])
    size = len(problem.value)
    for station in problem.stations:
        is_taken[station.members] = False
        best = np.zeros(int(problem.fresh.max(initial=-1)) + 2)
        others = np.flatnonzero(is_taken & (problem.fresh >= 0))
        np.maximum.at(best, problem.fresh[others], problem.value[others])
        extra = np.where(problem.fresh >= 0, np.maximum(problem.value - best[problem.fresh], 0.0), 0.0)
        worth = problem.repeat * problem.value + (1.0 - problem.repeat) * extra
        partners = np.bincount(one_of, is_taken[other_of], minlength=size)
        worth += problem.parallax * problem.value * (partners > 0)
        lonely = is_taken[one_of] & (partners[one_of] == 0)
        gains = problem.parallax * problem.value[one_of] * lonely
        worth += np.bincount(other_of, gains, minlength=size)
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


def assign(problem: Assignment, seconds: float = 60.0, gap: float = 1e-4) -> Assigned:
    """Return the best choice found within a time, never worth less than the greedy one.

    It ends sooner where the bound is within a share `gap`. Raises SattrackError without HiGHS, or where the
    passes that are kept exclude each other.
    """
    try:
        import highspy
    except ImportError:
        raise SattrackError(NO_HIGHS) from None
    begun_s = time.monotonic()
    plain = greedy(problem)
    size = len(problem.value)
    if size == 0:
        return Assigned(plain, 0.0, 0.0)
    is_large = size > _MOST_FOR_HIGHS
    until_s = begun_s + (seconds if is_large else _SHARE * seconds)
    found, value, bound = _Prices(problem).descend(plain, until_s, gap)
    if is_large or bound - value <= gap * bound:
        return Assigned(found, value, max(value, bound))
    model, start = _model(problem, found, highspy)
    solver = highspy.Highs()
    for name, value in (
        ("output_flag", False),
        ("time_limit", max(1.0, begun_s + seconds - time.monotonic())),
        ("mip_rel_gap", gap),
        ("mip_abs_gap", 1e-9),
        ("random_seed", 0),
    ):
        solver.setOptionValue(name, value)
    solver.passModel(model)
    known = highspy.HighsSolution()
    known.col_value = start.tolist()
    solver.setSolution(known)
    solver.run()
    status, info = solver.getModelStatus(), solver.getInfo()
    if status == highspy.HighsModelStatus.kInfeasible:
        raise SattrackError("what has begun cannot all be kept: passes of one station overlap")
    columns = np.array(solver.getSolution().col_value)
    taken = np.flatnonzero(columns[:size] > _TAKEN) if len(columns) else found
    if problem.worth(taken) > value:
        found, value = taken, problem.worth(taken)
    if math.isfinite(info.mip_dual_bound):
        bound = min(bound, float(info.mip_dual_bound))
    return Assigned(found, value, max(value, bound))


def _model(problem: Assignment, plain: Index, highspy: object) -> tuple[object, Array]:
    """Return the problem as HiGHS takes it, and the greedy choice as its columns.

    Columns: taken (n), fresh (n), together (n).
    """
    size, value = len(problem.value), problem.value
    rows: list[tuple[list[int], list[float]]] = []
    for station in problem.stations:
        order = np.argsort(problem.start_s[station.members], kind="stable")
        members = station.members[order]
        sets = exclusive_sets(station.clash[np.ix_(order, order)])
        rows += [(members[one].tolist(), [1.0] * len(one)) for one in sets]
    first_linked = len(rows)
    groups: dict[int, list[int]] = {}
    upper = np.concatenate([np.ones(size), np.zeros(2 * size)])
    for one in range(size):
        if problem.fresh[one] >= 0:
            groups.setdefault(int(problem.fresh[one]), []).append(size + one)
            upper[size + one] = 1.0
            rows.append(([size + one, one], [1.0, -1.0]))
        if one in problem.together:
            upper[2 * size + one] = 1.0
            others = problem.together[one].tolist()
            rows.append(([2 * size + one, one], [1.0, -1.0]))
            rows.append(([2 * size + one, *others], [1.0, *[-1.0] * len(others)]))
    last_linked = len(rows)
    rows += [(columns, [1.0] * len(columns)) for columns in groups.values() if len(columns) > 1]
    most = np.ones(len(rows))
    most[first_linked:last_linked] = 0.0
    lower = np.zeros(3 * size)
    lower[problem.kept] = 1.0
    # What is worth nothing is not taken: so a station that is closed takes nothing either.
    upper[:size][(value <= 0.0) & (lower[:size] == 0.0)] = 0.0
    lp = highspy.HighsLp()  # type: ignore[attr-defined]
    lp.num_col_, lp.num_row_ = 3 * size, len(rows)
    lp.sense_ = highspy.ObjSense.kMaximize  # type: ignore[attr-defined]
    lp.col_cost_ = np.concatenate(
        [problem.repeat * value, (1.0 - problem.repeat) * value, problem.parallax * value]
    )
    lp.col_lower_, lp.col_upper_ = lower, upper
    lp.row_lower_, lp.row_upper_ = np.full(len(rows), -math.inf), most
    lp.a_matrix_.format_ = highspy.MatrixFormat.kRowwise  # type: ignore[attr-defined]
    lp.a_matrix_.start_ = np.cumsum([0, *(len(columns) for columns, _ in rows)]).astype(np.int32)
    lp.a_matrix_.index_ = np.array([c for columns, _ in rows for c in columns], dtype=np.int32)
    lp.a_matrix_.value_ = np.array([f for _, factors in rows for f in factors], dtype=np.float64)
    kinds = highspy.HighsVarType  # type: ignore[attr-defined]
    lp.integrality_ = [kinds.kInteger] * size + [kinds.kContinuous] * (2 * size)
    start = np.zeros(3 * size)
    start[plain] = 1.0
    best: dict[int, int] = {}
    for one in plain.tolist():
        group = int(problem.fresh[one])
        if group >= 0 and (group not in best or value[one] > value[best[group]]):
            best[group] = one
        if one in problem.together and start[problem.together[one]].any():
            start[2 * size + one] = 1.0
    start[[size + one for one in best.values()]] = 1.0
    return lp, start
