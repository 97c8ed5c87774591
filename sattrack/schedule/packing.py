"""The best night where only so many of some passes may be chosen: each satellite once, so many an hour.

Branch and bound over the exact planner. Where the best of all takes too many of a set, its members cost a
price, by which the planner's best is a bound on all plans that keep the limits (Lagrange); the prices are
moved so that the bound falls (subgradient). Then a pass of a set that is still too large is forbidden, or the
others of its set are, and both cases are weighed. Bound and plan meet where the plan is the best there is.
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass, replace
from itertools import count
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from sattrack.schedule.planner import best_plan

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from sattrack.schedule.planner import Problem

    Index = NDArray[np.intp]
    Array = NDArray[np.float64]

PRICINGS = 25
"""Rounds in which prices are moved, for each case."""
MOST_WORK = 60_000
"""Cases are weighed until so many nodes have been planned with; then the plan's bound is told."""
MOST_REPAIRS = 20
EQUAL = 1e-9
LEAST_FALL, STALE = 1e-6, 4
"""Bounds that fall by less, so many times in a row, have prices moved by half as much."""


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
    return _Search(problem, limits, packings, of, work).run(list(known))


@dataclass(frozen=True, slots=True)
class _Case:
    """Nodes that are forbidden, with the prices of packings that came of the case before."""

    forbidden: frozenset[int]
    prices: dict[int, float]


class _Search:
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
        """Tell whether no plan within a bound is worth more than the best one found."""
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
