"""The best night: which passes to take, exactly, where getting from one to the next takes time.

Weighted interval scheduling with transitions: passes are intervals with values, and one may follow another
where the time between them suffices. Dynamic programming over passes in order of their ends: the best chain
that ends with a pass is its value and the best of the chains that may come before it. O(n²), whatever the
transitions are: they need not obey the triangle inequality. Groups of which only so many may be chosen add
a dimension each, and only where the best plan without them takes too many.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from sattrack.core.errors import SattrackError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    Array = NDArray[np.float64]
    Index = NDArray[np.intp]

MOST_STATES = 4096
"""Combinations of counts that are kept for each pass where groups are limited."""
MOST_STEPS = 5.0e9


class Transitions(Protocol):
    """How long it takes from the end of one pass to the start of another."""

    def seconds(self, before: Index, after: int) -> Array:
        """Return it for some passes before another, none below 0; shape as `before`."""

    def longest_s(self, after: Index) -> Array:
        """Return a bound on it for all passes before each of some; infinity where there is none."""


@dataclass(frozen=True, slots=True)
class Problem:
    """Passes to choose from: start, end (seconds), value above 0, group (-1 for none); shape (n,).

    `first` tells which may be the first of a plan. Ends are after starts.
    """

    start_s: Array
    end_s: Array
    value: Array
    first: NDArray[np.bool_]
    group: Index
    transitions: Transitions

    def __len__(self) -> int:
        """Return how many there are."""
        return len(self.start_s)


def best_plan(problem: Problem, limits: Mapping[int, int] | None = None) -> tuple[float, list[int]]:
    """Return the largest total value, and the passes that have it, in order of time.

    `limits` are the most passes of each group. Of plans of equal value it is always the same one. Raises
    SattrackError where too many limited groups bind at once.
    """
    if not len(problem):
        return 0.0, []
    limits = limits or {}
    binding: dict[int, int] = {}
    while True:
        total, chosen = _best(problem, binding) if binding else _best_of_all(problem)
        counts = {group: sum(1 for k in chosen if problem.group[k] == group) for group in limits}
        over = {group: limits[group] for group, count in counts.items() if count > limits[group]}
        # The best of all that breaks no limit is the best of those that may break none.
        if not over:
            return total, chosen
        binding |= over


def _in_order(problem: Problem) -> tuple[Index, Array, Array, list[int], list[int]]:
    """Return passes by their ends, ends and starts, and how many come before each: at all, and surely."""
    order = np.lexsort((problem.start_s, problem.end_s))
    ends, starts = problem.end_s[order], problem.start_s[order]
    reach = np.searchsorted(ends, starts, side="right").tolist()
    longest_s = problem.transitions.longest_s(order)
    return order, ends, starts, reach, np.searchsorted(ends, starts - longest_s, side="right").tolist()


def _best_of_all(problem: Problem) -> tuple[float, list[int]]:
    """Return the same as `_best` without limits, which have one state then: numbers instead of arrays."""
    order, ends, starts, reach, far = _in_order(problem)
    values, first = problem.value[order].tolist(), problem.first[order].tolist()
    best = np.full(len(order), -np.inf)
    before = np.full(len(order), -1, dtype=np.intp)
    top, top_at = -np.inf, -1
    # Of the passes up to each, the best chain, and where it ends: those long enough before need no more.
    tops: list[tuple[float, int]] = []
    for at, k in enumerate(order.tolist()):
        total, place = values[at] if first[at] else -np.inf, -1
        begin, end = far[at], reach[at]
        found, found_at = tops[begin - 1] if begin else (-np.inf, -1)
        if begin < end:
            enough = ends[begin:end] + problem.transitions.seconds(order[begin:end], k) <= starts[at]
            chains = np.where(enough, best[begin:end], -np.inf)
            row = int(chains.argmax())
            if chains[row] > found:
                found, found_at = float(chains[row]), begin + row
        if values[at] + found > total:
            total, place = values[at] + found, found_at
        best[at], before[at] = total, place
        if not at or total > top:
            top, top_at = total, at
        tops.append((top, top_at))
    return _chain(best[:, None], before[:, None], order, _Counts(problem.group, {}, []))


def _best(problem: Problem, limits: Mapping[int, int]) -> tuple[float, list[int]]:
    order, ends, starts, reach, reach_far = _in_order(problem)
    # The states are counts "at most so many of each group"; the last one allows all.
    shape = tuple(limits[group] + 1 for group in limits)
    states = int(np.prod(shape, dtype=np.int64)) if shape else 1
    n = len(order)
    if states > MOST_STATES or 0.5 * states * n * n > MOST_STEPS:
        raise SattrackError(
            f"{len(limits)} rules take more passes than their max allows, which makes {states} cases of "
            f"{n} passes to weigh: give fewer rules a max, or smaller ones"
        )
    less = [_one_less(shape, position) for position in range(len(shape))]
    position_of = {group: position for position, group in enumerate(limits)}
    best = np.full((n, states), -np.inf)
    before = np.full((n, states), -1, dtype=np.intp)
    every = np.arange(states)
    # Of the passes up to each, the best chain, and where it ends: those long enough before need no more.
    top, top_at = np.full((n, states), -np.inf), np.full((n, states), -1, dtype=np.intp)
    for at, k in enumerate(order.tolist()):
        position = position_of.get(int(problem.group[k]))
        state = every if position is None else less[position]
        allowed = state >= 0
        value = float(problem.value[k])
        if problem.first[k]:
            best[at, allowed] = value
        if count := reach[at]:
            far = reach_far[at]
            near = order[far:count]
            enough = ends[far:count] + problem.transitions.seconds(near, k) <= starts[at]
            rows = far + np.flatnonzero(enough)
            values, places = _best_before(best, rows, (top, top_at), far - 1)
            if position is not None:
                values, places = values[np.maximum(state, 0)], places[np.maximum(state, 0)]
            total = value + values
            better = allowed & (total > best[at])
            best[at, better] = total[better]
            before[at, better] = places[better]
        ahead = best[at] > top[at - 1] if at else np.ones(states, dtype=bool)
        top[at] = np.where(ahead, best[at], top[at - 1])
        top_at[at] = np.where(ahead, at, top_at[at - 1])
    return _chain(best, before, order, _Counts(problem.group, position_of, less))


def _best_before(best: Array, rows: Index, top: tuple[Array, Index], far: int) -> tuple[Array, Index]:
    """Return by state the best chain that ends with one of some rows, or up to the row `far`, and where."""
    states = best.shape[1]
    values, places = np.full(states, -np.inf), np.full(states, -1, dtype=np.intp)
    if far >= 0:
        values, places = top[0][far].copy(), top[1][far].copy()
    if len(rows):
        chosen = np.argmax(best[rows], axis=0)
        found = best[rows[chosen], np.arange(states)]
        ahead = found > values
        values[ahead], places[ahead] = found[ahead], rows[chosen][ahead]
    return values, places


@dataclass(frozen=True, slots=True)
class _Counts:
    """How states go down as passes of limited groups are taken."""

    group: Index
    position_of: Mapping[int, int]
    less: Sequence[Index]

    def after(self, state: int, k: int) -> int:
        position = self.position_of.get(int(self.group[k]))
        return state if position is None else int(self.less[position][state])


def _chain(best: Array, before: Index, order: Index, counts: _Counts) -> tuple[float, list[int]]:
    """Return the best value and its passes, followed back from the last."""
    if not len(order) or not np.isfinite(best[:, -1]).any():
        return 0.0, []
    state = best.shape[1] - 1
    at = int(np.argmax(best[:, state]))
    total = float(best[at, state])
    chosen = []
    while at >= 0:
        k = int(order[at])
        chosen.append(k)
        at, state = int(before[at, state]), counts.after(state, k)
    return total, chosen[::-1]


def _one_less(shape: tuple[int, ...], position: int) -> Index:
    """Return for each state the one with one less of a group, -1 where there is none left."""
    index = np.indices(shape).reshape(len(shape), -1).copy()
    index[position] -= 1
    flat = np.ravel_multi_index(tuple(np.maximum(index, 0)), shape)
    return np.where(index[position] >= 0, flat, -1).astype(np.intp)
