"""The planner against all subsets, against greed, and against two plain loops."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import numpy as np
import pytest
from planning_nights import Tabled, brute_force, can_be_done, greedy, plain_loops, random_night, value_of

from sattrack.core.errors import SattrackError
from sattrack.schedule.planner import Packing, Problem, best_packed, best_plan

if TYPE_CHECKING:
    from numpy.typing import NDArray


def test_small_nights_are_planned_as_well_as_by_trying_everything() -> None:
    rng = np.random.default_rng(1)
    for _ in range(150):
        night = random_night(rng, int(rng.integers(1, 11)), 1.0, longest_slew_s=900.0)
        total, chosen = best_plan(night)
        assert total == pytest.approx(brute_force(night))
        assert can_be_done(night, chosen, {})
        assert value_of(night, chosen) == pytest.approx(total)


def test_limited_groups_are_planned_as_well_as_by_trying_everything() -> None:
    rng = np.random.default_rng(2)
    binding = 0
    for _ in range(80):
        night = random_night(rng, 10, 3.0, groups=3)
        limits = {0: int(rng.integers(1, 3)), 1: int(rng.integers(1, 3)), 2: 1}
        total, chosen = best_plan(night, limits)
        assert total == pytest.approx(brute_force(night, limits))
        assert can_be_done(night, chosen, limits)
        binding += total < best_plan(night)[0]
    assert binding > 20


@pytest.mark.parametrize("nights", [300, pytest.param(1000, marks=pytest.mark.soak)])
def test_no_night_of_many_is_planned_worse_than_by_greed(nights: int) -> None:
    rng = np.random.default_rng(3)
    better = 0
    for _ in range(nights):
        night = random_night(rng, 60, 3.0)
        total, chosen = best_plan(night)
        assert can_be_done(night, chosen, {})
        by_greed = greedy(night)
        assert total >= by_greed - 1e-6
        better += total > by_greed + 1e-6
    assert better > 0.5 * nights


def test_slews_that_are_quicker_by_a_third_place_are_taken_as_they_are() -> None:
    # From the first straight to the last takes longer than by the one between.
    table = np.array([[0.0, 10.0, 500.0], [0.0, 0.0, 10.0], [0.0, 0.0, 0.0]])
    night = Problem(
        start_s=np.array([0.0, 120.0, 240.0]),
        end_s=np.array([100.0, 220.0, 340.0]),
        value=np.array([100.0, 1.0, 100.0]),
        first=np.ones(3, dtype=bool),
        group=np.full(3, -1),
        transitions=Tabled(table),
    )
    assert best_plan(night) == (201.0, [0, 1, 2])


def test_a_pass_that_begins_as_another_ends_fits_where_no_time_is_needed() -> None:
    night = Problem(
        start_s=np.array([0.0, 10.0]),
        end_s=np.array([10.0, 20.0]),
        value=np.ones(2),
        first=np.ones(2, dtype=bool),
        group=np.full(2, -1),
        transitions=Tabled(np.zeros((2, 2))),
    )
    assert best_plan(night) == (2.0, [0, 1])


def test_nothing_is_planned_of_nothing_and_of_what_cannot_begin() -> None:
    nothing = np.zeros(0)
    night = Problem(nothing, nothing, nothing, nothing.astype(bool), nothing.astype(np.intp), Tabled(nothing))
    assert best_plan(night) == (0.0, [])
    one = Problem(
        np.zeros(1), np.ones(1), np.ones(1), np.zeros(1, dtype=bool), np.full(1, -1), Tabled(np.zeros((1, 1)))
    )
    assert best_plan(one) == (0.0, [])


def test_the_same_night_has_the_same_plan() -> None:
    night = random_night(np.random.default_rng(4), 200, 10.0)
    assert best_plan(night) == best_plan(night)


def test_too_many_limits_that_bind_at_once_are_told() -> None:
    night = random_night(np.random.default_rng(5), 400, 40.0, groups=4)
    with pytest.raises(SattrackError, match="give fewer rules a max"):
        best_plan(night, dict.fromkeys(range(4), 9))


def test_the_value_and_the_speed_are_those_of_more_than_plain_loops() -> None:
    night = random_night(np.random.default_rng(6), 700, 40.0)
    ratios = []
    for _ in range(3):
        began = time.process_time()
        total, _ = best_plan(night)
        ours_s = time.process_time() - began
        began = time.process_time()
        plain = plain_loops(night)
        ratios.append(ours_s / (time.process_time() - began))
        assert total == pytest.approx(plain)
    assert min(ratios) < 0.7


def packed_brute_force(night: Problem, packings: list[Packing], of: NDArray[np.intp]) -> float:
    """Return the value of the best of all subsets that keep the packings."""
    best = 0.0
    by_time = np.argsort(night.start_s).tolist()
    for mask in range(1 << len(by_time)):
        chosen = [k for bit, k in enumerate(by_time) if mask >> bit & 1]
        value = value_of(night, chosen)
        kept = all(sum(int(of[k]) in one.members for k in chosen) <= one.most for one in packings)
        if value > best and kept and can_be_done(night, chosen, {}):
            best = value
    return best


def random_packings(rng: np.random.Generator, night: Problem, of: NDArray[np.intp]) -> list[Packing]:
    """Return satellites that are taken once, and hours that take two, of passes dealt to satellites."""
    passes = sorted(set(of.tolist()))
    satellite = {key: int(rng.integers(0, 4)) for key in passes}
    once = [frozenset(key for key in passes if satellite[key] == n) for n in range(4)]
    start = {key: float(night.start_s[of.tolist().index(key)]) for key in passes}
    hours = [
        frozenset(key for key in passes if begin <= start[key] < begin + 3600.0) for begin in start.values()
    ]
    return [
        *(Packing(members, 1, "once", "once") for members in once if members),
        *(Packing(members, 2, "hour full", "two an hour") for members in hours),
    ]


@pytest.mark.parametrize("nights", [40, pytest.param(120, marks=pytest.mark.soak)])
def test_sets_of_which_few_are_taken_are_planned_as_well_as_by_trying_everything(nights: int) -> None:
    rng = np.random.default_rng(11)
    binding = 0
    for _ in range(nights):
        night = random_night(rng, 11, 4.0)
        # Some passes may be taken in one of two ways, as those that may be shortened.
        of = np.minimum(np.arange(11), 8) if rng.uniform() < 0.3 else np.arange(11)
        packings = random_packings(rng, night, of)
        value, chosen, bound = best_packed(night, {}, packings, of)
        assert value == pytest.approx(packed_brute_force(night, packings, of))
        assert bound == pytest.approx(value), "it is proven"
        assert can_be_done(night, chosen, {})
        assert value_of(night, chosen) == pytest.approx(value)
        assert all(sum(int(of[k]) in one.members for k in chosen) <= one.most for one in packings)
        binding += value < best_plan(night)[0] - 1e-6
    assert binding > 0.5 * nights


def test_a_bound_is_told_where_not_all_cases_could_be_weighed() -> None:
    rng = np.random.default_rng(12)
    night, of = random_night(rng, 150, 12.0), np.arange(150)
    packings = [Packing(frozenset(range(n, 150, 30)), 1, "once", "once") for n in range(30)]
    proven = best_packed(night, {}, packings, of)
    assert proven.bound == pytest.approx(proven.value)
    quick = best_packed(night, {}, packings, of, work=0)
    assert 0.8 * proven.value < quick.value <= proven.value + 1e-6
    assert quick.bound >= proven.value - 1e-6
    assert quick.bound > quick.value
