"""Random nights to plan, and plain ways of planning them, written without a look at the planner."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations, pairwise
from typing import TYPE_CHECKING

import numpy as np

from sattrack.runtime import demo_pass
from sattrack.schedule.planner import Problem

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tle.elements import Elements


@dataclass(frozen=True)
class Tabled:
    """Transitions from a table."""

    table: NDArray[np.float64]

    def seconds(self, before: NDArray[np.intp], after: int) -> NDArray[np.float64]:
        return self.table[before, after]

    def longest_s(self, after: NDArray[np.intp]) -> NDArray[np.float64]:
        longest: NDArray[np.float64] = self.table[:, after].max(axis=0)
        return longest


def random_night(
    rng: np.random.Generator, count: int, hours: float, groups: int = 0, longest_slew_s: float = 120.0
) -> Problem:
    """Return passes of one to ten minutes; slews of any pair are drawn, so that no triangle need close."""
    start = rng.uniform(0.0, 3600.0 * hours, count)
    end = start + rng.uniform(60.0, 600.0, count)
    return Problem(
        start_s=start,
        end_s=end,
        value=(end - start) * rng.choice([0.5, 1.0, 2.0, 5.0], count),
        first=rng.uniform(size=count) < 0.9,
        group=rng.integers(-1, groups, count) if groups else np.full(count, -1),
        transitions=Tabled(rng.uniform(0.0, longest_slew_s, (count, count))),
    )


def can_be_done(night: Problem, chosen: list[int], limits: dict[int, int]) -> bool:
    """Tell whether passes, in order of time, can be taken one after the other."""
    if not chosen:
        return True
    table = night.transitions.table  # type: ignore[attr-defined]
    fits = all(night.end_s[a] + table[a, b] <= night.start_s[b] for a, b in pairwise(chosen))
    counts = [sum(int(night.group[k]) == group for k in chosen) <= most for group, most in limits.items()]
    return bool(night.first[chosen[0]]) and fits and all(counts)


def value_of(night: Problem, chosen: list[int]) -> float:
    return float(sum(night.value[k] for k in chosen))


def brute_force(night: Problem, limits: dict[int, int] | None = None) -> float:
    """Return the value of the best of all subsets."""
    by_time = np.argsort(night.start_s).tolist()
    best = 0.0
    for size in range(1, len(by_time) + 1):
        for chosen in combinations(by_time, size):
            value = value_of(night, list(chosen))
            if value > best and can_be_done(night, list(chosen), limits or {}):
                best = value
    return best


def greedy(night: Problem) -> float:
    """Return what comes of taking the most valuable pass that still fits, again and again."""
    taken: list[int] = []
    for k in np.argsort(-night.value).tolist():
        tried = sorted([*taken, k], key=lambda j: night.start_s[j])
        if can_be_done(night, tried, {}):
            taken = tried
    return value_of(night, taken)


def plain_loops(night: Problem) -> float:
    """Return the best value by two nested loops over passes in order of their ends."""
    order = np.argsort(night.end_s).tolist()
    table = night.transitions.table.tolist()  # type: ignore[attr-defined]
    start, end = night.start_s.tolist(), night.end_s.tolist()
    best: dict[int, float] = {}
    for at, k in enumerate(order):
        before = [best[j] for j in order[:at] if end[j] + table[j][k] <= start[k]]
        if night.first[k]:
            before.append(0.0)
        best[k] = float(night.value[k]) + max(before, default=-np.inf)
    return max([0.0, *best.values()])


def random_sky(count: int, seed: int = 4) -> list[Elements]:
    """Return satellites in low orbits, drawn at random."""
    rng, one = np.random.default_rng(seed), demo_pass.elements()
    return [
        replace(
            one,
            name=f"SAT {k + 1:03d}",
            catalog_number=70001 + k,
            designator="",
            raan_deg=float(rng.uniform(0.0, 360.0)),
            mean_anomaly_deg=float(rng.uniform(0.0, 360.0)),
            inclination_deg=float(rng.uniform(50.0, 98.0)),
            mean_motion_rev_day=float(rng.uniform(13.5, 15.4)),
            mean_motion_dot_rev_day2=0.0,
            bstar_per_earth_radius=0.0,
        )
        for k in range(count)
    ]
