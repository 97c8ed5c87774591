"""The plan of the greatest value: which passes to take, where getting from one to the next takes time.

Weighted interval scheduling with transitions: passes are intervals with values, and one may follow another
where the time between them suffices. Dynamic programming over passes in order of their ends: the best chain
that ends with a pass is its value and the best of the chains that may come before it. O(n²) for any
transitions: they need not obey the triangle inequality. Groups of which only so many may be chosen add
a dimension each, and only where the best plan without them takes too many.

Rules that take each satellite once, or so many passes an hour, are packings: sets of which only so many may
be chosen. They are kept by branch and bound over that planner. Where the best plan takes too many of a set,
its members cost a price, by which the planner's best is a bound on all plans that keep the limits (Lagrange);
the prices are moved so that the bound falls (subgradient). Then a pass of a set that is still too large is
forbidden, or the others of its set are, and both cases are weighed. Where bound and plan meet, the plan is
the best.
"""

from __future__ import annotations

import heapq
import math
from bisect import bisect_left
from dataclasses import dataclass, replace
from itertools import count
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np

from sattrack.core.errors import SattrackError
from sattrack.schedule.night import mean_noon_s
from tle.instants import DAY_S

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from numpy.typing import NDArray

    from sattrack.schedule.candidates import Candidate, PlanSituation
    from sattrack.schedule.file import Schedule, ScheduleEntry

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


PRICINGS = 25
"""Rounds in which prices are moved, for each case."""
MOST_WORK = 60_000
"""Cases are weighed until this many nodes were planned with; then the plan is reported with its bound."""
MOST_REPAIRS = 20
EQUAL = 1e-9
LEAST_FALL, STALE = 1e-6, 4
"""Bounds that fall by less, this many times in a row, halve the moves of prices."""


class Packing(NamedTuple):
    """No more than `most` of the passes of a set may be chosen, a pass in two parts being two.

    `kind` and `words` say why.
    """

    members: frozenset[int]
    most: int
    kind: str
    words: str


class Packed(NamedTuple):
    """The best value found, its nodes in order of time, and a bound that no plan passes."""

    value: float
    chosen: list[int]
    bound: float


def best_packed(
    problem: Problem,
    limits: Mapping[int, int],
    packings: Sequence[Packing],
    of: Index,
    known: Sequence[int] = (),
    work: int = MOST_WORK,
) -> Packed:
    """Return the best plan that keeps `limits` of groups and packings; `of` is each node's pass.

    `known` is a plan that keeps them, where there is one already. Cases are weighed until `work` nodes have
    been planned with. Raises SattrackError as `best_plan`.
    """
    return _PackingSearch(problem, limits, packings, of, work).run(list(known))


@dataclass(frozen=True, slots=True)
class _Case:
    """Nodes that are forbidden, with the prices of packings that came of the case before."""

    forbidden: frozenset[int]
    prices: dict[int, float]


class _PackingSearch:
    def __init__(
        self,
        problem: Problem,
        limits: Mapping[int, int],
        packings: Sequence[Packing],
        of: Index,
        work: int,
    ) -> None:
        self._problem, self._limits = problem, limits
        self._most = [packing.most for packing in packings]
        self._of: list[int] = of.tolist()
        by_pass: dict[int, list[int]] = {}
        for node, key in enumerate(self._of):
            by_pass.setdefault(key, []).append(node)
        self._nodes = [
            frozenset(node for key in one.members for node in by_pass.get(key, ())) for one in packings
        ]
        self._left = work // max(1, len(problem))
        self._value, self._chosen = 0.0, list[int]()

    def run(self, known: list[int]) -> Packed:
        order = count()
        self._take(known)
        total, chosen = self._solve(frozenset(), {})
        if not self._too_many(chosen):
            return Packed(total, chosen, total)
        self._repair(frozenset(), chosen)
        heap = [(-total, next(order), _Case(frozenset(), {}))]
        while heap and not self._is_enough(-heap[0][0]):
            if self._left <= 0:
                return Packed(self._value, self._chosen, -heap[0][0])
            above, _, case = heapq.heappop(heap)
            bound, prices, chosen = self._priced(case, -above)
            if self._is_enough(bound):
                continue
            for child in self._children(case, prices, chosen):
                heapq.heappush(heap, (-bound, next(order), child))
        return Packed(self._value, self._chosen, self._value)

    def _is_enough(self, bound: float) -> bool:
        """Return whether no plan within a bound is worth more than the best one found."""
        return bound <= self._value + EQUAL * max(1.0, self._value)

    def _solve(self, forbidden: frozenset[int], prices: Mapping[int, float]) -> tuple[float, list[int]]:
        """Return the best plan without some nodes, members of packings at their prices."""
        self._left -= 1
        value = self._problem.value.copy()
        for number, price in prices.items():
            value[list(self._nodes[number])] -= price
        value[list(forbidden)] = -np.inf
        total, chosen = best_plan(replace(self._problem, value=value), self._limits)
        return (total, chosen) if total > 0.0 else (0.0, [])

    def _inside(self, number: int, chosen: Sequence[int]) -> list[int]:
        """Return the chosen nodes of a packing, the most valuable first."""
        found = [node for node in chosen if node in self._nodes[number]]
        return sorted(found, key=lambda node: (-float(self._problem.value[node]), node))

    def _too_many(self, chosen: Sequence[int]) -> list[int]:
        """Return the packings of which more are chosen than may be."""
        return [n for n, most in enumerate(self._most) if len(self._nodes[n].intersection(chosen)) > most]

    def _take(self, chosen: list[int]) -> None:
        value = float(sum(self._problem.value[node] for node in chosen))
        if value > self._value:
            self._value, self._chosen = value, chosen

    def _repair(self, forbidden: frozenset[int], chosen: list[int]) -> None:
        """Take the plan that comes of forbidding the least valuable of what is too many, again and again."""
        over = self._too_many(chosen)
        while self._left > -MOST_REPAIRS:
            for number in over:
                forbidden |= self._without(number, self._inside(number, chosen))
            chosen = self._solve(forbidden, {})[1]
            over = self._too_many(chosen)
            if not over:
                self._take(chosen)
                return

    def _without(self, number: int, inside: list[int]) -> frozenset[int]:
        """Return the nodes to forbid so that of those chosen of a packing the most valuable stay."""
        most = self._most[number]
        kept = {self._of[node] for node in inside[:most]}
        others = frozenset(node for node in self._nodes[number] if self._of[node] not in kept)
        return others | frozenset(inside[most:])

    def _priced(self, case: _Case, above: float) -> tuple[float, dict[int, float], list[int]]:
        """Return the lowest bound on a case that prices give, those prices, and a plan that breaks limits."""
        total, chosen = self._solve(case.forbidden, {})
        if not self._too_many(chosen):
            self._take(chosen)
            return total, {}, chosen
        best, best_prices, prices, broken = min(above, total), case.prices, dict(case.prices), chosen
        step, stale = 1.0, 0
        for _ in range(PRICINGS):
            if self._left <= 0 or self._is_enough(best):
                break
            total, chosen = self._solve(case.forbidden, prices)
            bound = total + sum(price * self._most[n] for n, price in prices.items())
            over = self._too_many(chosen)
            if over:
                broken = chosen
            else:
                self._take(chosen)
            stale = 0 if bound < best - LEAST_FALL * best else stale + 1
            if bound < best:
                best, best_prices = bound, dict(prices)
            if stale >= STALE:
                step, stale = 0.5 * step, 0
            slopes = {
                n: len(self._nodes[n].intersection(chosen)) - self._most[n] for n in sorted({*over, *prices})
            }
            norm = sum(slope * slope for slope in slopes.values())
            if not norm:
                break
            length = step * max(bound - self._value, 1e-3 * bound) / norm
            moved = {n: max(0.0, prices.get(n, 0.0) + length * slope) for n, slope in slopes.items()}
            prices = {n: price for n, price in moved.items() if price > 0.0}
        self._repair(case.forbidden, broken)
        return best, best_prices, broken

    def _children(self, case: _Case, prices: dict[int, float], chosen: list[int]) -> list[_Case]:
        """Return the cases into which one falls; every plan that keeps the limits is in one of them."""
        over = self._too_many(chosen)
        if not over:
            return []
        worth = self._problem.value
        number = max(over, key=lambda n: float(sum(worth[k] for k in self._inside(n, chosen))))
        inside, nodes = self._inside(number, chosen), self._nodes[number]
        passes = list(dict.fromkeys(self._of[node] for node in inside))
        if len(passes) <= self._most[number]:
            return self._halves(case, prices, inside)
        of_first = frozenset(node for node in nodes if self._of[node] == passes[0])
        forbidden: tuple[frozenset[int], ...]
        if self._most[number] == 1:
            forbidden = (nodes - of_first, of_first)
        else:
            some = passes[: self._most[number] + 1]
            forbidden = tuple(frozenset(k for k in nodes if self._of[k] == one) for one in some)
        return [_Case(case.forbidden | more, prices) for more in forbidden]

    def _halves(self, case: _Case, prices: dict[int, float], inside: list[int]) -> list[_Case]:
        """Return the two cases of a pass that was chosen in two parts: it ends before the later, or not."""
        again = next(node for node in inside if [self._of[k] for k in inside].count(self._of[node]) > 1)
        parts = [node for node in inside if self._of[node] == self._of[again]]
        last_s = max(float(self._problem.start_s[node]) for node in parts)
        nodes = [node for node, key in enumerate(self._of) if key == self._of[again]]
        late = frozenset(node for node in nodes if self._problem.start_s[node] >= last_s)
        early = frozenset(node for node in nodes if self._problem.end_s[node] <= last_s)
        return [_Case(case.forbidden | more, prices) for more in (late, early)]


ONCE, TAKEN, HOUR_FULL = "once", "taken", "hour full"
HOUR_S = 3600.0


def leave_out_taken(schedule: Schedule, candidates: list[Candidate], situation: PlanSituation) -> None:
    """Lose candidates for which the passes that the run has followed leave no place in their rule."""
    if not situation.followed:
        return
    noon_s = mean_noon_s(situation.site.longitude_deg)
    followed_s = [_followed_s(entry, situation) for entry in schedule.entries]
    for number, one in enumerate(candidates):
        c, top_s = schedule.entries[one.entry].conditions, one.culminate_utc_s
        nights = {
            _night(each.culminate_utc_s, noon_s)
            for each in situation.followed
            if each.catalog_number == one.object_number
        }
        lost = None
        if c.once_a_run and nights:
            lost = (TAKEN, "followed already in this run")
        elif c.once_a_night and _night(top_s, noon_s) in nights:
            lost = (TAKEN, "followed already in this night")
        elif c.most_an_hour is not None and _is_crowded([*followed_s[one.entry], top_s], c.most_an_hour):
            lost = (HOUR_FULL, f"the rule takes {c.most_an_hour} an hour, and they were followed already")
        if lost is not None and one.lost is None:
            candidates[number] = replace(one, lost=lost)


def _is_crowded(tops_s: Sequence[float], most: int) -> bool:
    """Return whether more passes than that, the last one among them, culminate within some hour."""
    last = tops_s[-1]
    return any(
        begin <= last < begin + HOUR_S and sum(begin <= top < begin + HOUR_S for top in tops_s) > most
        for begin in tops_s
    )


def _night(utc_s: float, noon_s: float) -> int:
    return math.floor((utc_s - noon_s) / DAY_S)


def _followed_s(entry: ScheduleEntry, situation: PlanSituation) -> list[float]:
    """Return when the passes culminated that were followed for an entry, POSIX seconds, in order."""
    return [one.culminate_utc_s for one in situation.followed if one.asked_by == entry.label]


def packings_of(
    schedule: Schedule, candidates: Sequence[Candidate], situation: PlanSituation
) -> list[Packing]:
    """Return the sets of candidates, by number, of which a schedule's rules take only so many."""
    noon_s = mean_noon_s(situation.site.longitude_deg)
    found: list[Packing] = []
    for number, entry in enumerate(schedule.entries):
        c = entry.conditions
        asked = [one for one in candidates if one.entry == number and one.lost is None]
        if c.once_a_run or c.once_a_night:
            found += _once(asked, c.once_a_run, noon_s)
        if c.most_an_hour is not None:
            found += _an_hour(asked, c.most_an_hour, _followed_s(entry, situation))
    return found


def _once(asked: Sequence[Candidate], a_run: bool, noon_s: float) -> Iterator[Packing]:
    """Give the passes of each satellite; nights change at the site's mean noon."""
    sets: dict[tuple[int, int], set[int]] = {}
    for one in asked:
        night = 0 if a_run else _night(one.culminate_utc_s, noon_s)
        sets.setdefault((one.object_number, night), set()).add(one.number)
    words = f"the rule takes each satellite once a {'run' if a_run else 'night'}"
    for members in sets.values():
        if len(members) > 1:
            yield Packing(frozenset(members), 1, ONCE, words)


def _an_hour(asked: Sequence[Candidate], most: int, followed_s: Sequence[float]) -> Iterator[Packing]:
    """Give the passes that culminate within an hour, for each hour that begins with one of them.

    `followed_s` are culminations of what was followed already, in order: it takes places of its hours.
    """
    words = f"the rule takes {most} an hour"
    ordered = sorted(asked, key=lambda one: one.culminate_utc_s)
    tops_s = [one.culminate_utc_s for one in ordered]
    before = frozenset[int]()
    for first_s in sorted({*tops_s, *followed_s}):
        inside, hour = (
            slice(bisect_left(times, first_s), bisect_left(times, first_s + HOUR_S))
            for times in (followed_s, tops_s)
        )
        left = max(0, most - len(followed_s[inside]))
        members = frozenset(one.number for one in ordered[hour])
        # An hour whose passes are all of the one before asks for nothing new.
        if len(members) > left and not (left == most and members <= before):
            yield Packing(members, left, HOUR_FULL, words)
            before = members
