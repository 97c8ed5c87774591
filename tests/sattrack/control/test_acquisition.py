"""How soon the mount is on a satellite, against bounds that know nothing of how it gets there."""

from __future__ import annotations

import acquisition as bench
import numpy as np
import pytest

from sattrack.control.approach import chase_time_s, plan_intercept
from sattrack.control.following import FeederLaw, correction_deg_s
from sattrack.mount.model import AxisLimits, MountProfile

AXIS = AxisLimits(max_rate_deg_s=6.0, max_acceleration_deg_s2=10.0, slew_rate_deg_s=6.0)


def reachable(begin: bench.Moving, end: bench.Moving, axis: AxisLimits, seconds: float) -> bool:
    """Tell by a linear programme over 200 steps of constant acceleration whether there is a way in time."""
    from scipy.optimize import linprog

    steps = 200
    step_s = seconds / steps
    rates = np.tril(np.ones((steps, steps))) * step_s
    ways = np.array([(seconds - (i + 0.5) * step_s) * step_s for i in range(steps)])
    solved = linprog(
        np.zeros(steps),
        A_ub=np.vstack([rates, -rates]),
        b_ub=np.concatenate(
            [
                np.full(steps, axis.slew_rate_deg_s - begin.rate_deg_s),
                np.full(steps, axis.slew_rate_deg_s + begin.rate_deg_s),
            ]
        ),
        A_eq=np.vstack([rates[-1], ways]),
        b_eq=[
            end.rate_deg_s - begin.rate_deg_s,
            end.position_deg - begin.position_deg - begin.rate_deg_s * seconds,
        ],
        bounds=[(-axis.max_acceleration_deg_s2, axis.max_acceleration_deg_s2)] * steps,
    )
    return bool(solved.status == 0)


@pytest.mark.parametrize(
    ("way_deg", "first_deg_s", "last_deg_s"),
    [(40.0, 0.0, 1.0), (0.3, 0.0, -1.0), (-8.0, 2.0, 0.5), (0.05, -3.0, 3.0), (2.0, 1.0, 1.0)],
)
def test_the_benchs_least_time_is_the_least(way_deg: float, first_deg_s: float, last_deg_s: float) -> None:
    begin, end = bench.Moving(0.0, first_deg_s), bench.Moving(way_deg, last_deg_s)
    least_s = bench.least_s(begin, end, AXIS)
    assert reachable(begin, end, AXIS, least_s * 1.02 + 0.002)
    assert not reachable(begin, end, AXIS, least_s * 0.98 - 0.002)


@pytest.mark.parametrize("distance_deg", [0.01, 0.5, 3.0, 9.0, -9.0])
def test_the_time_of_a_chase_is_what_the_law_takes(distance_deg: float) -> None:
    law = FeederLaw()
    left, rate, seconds, step_s = abs(distance_deg), 0.0, 0.0, 1e-3
    while left > 2.0 / 3600.0:
        wanted = correction_deg_s(
            -left, AXIS.max_acceleration_deg_s2, AXIS.max_rate_deg_s, law.settling_s, law
        )
        most = law.ramp_share * AXIS.max_acceleration_deg_s2 * step_s
        rate += max(-most, min(most, wanted - rate))
        left -= rate * step_s
        seconds += step_s
    # It counts until next to nothing is left, and is never too hopeful.
    assert seconds - 0.05 <= chase_time_s(distance_deg, AXIS, law) <= seconds + 0.35


def test_rates_are_taken_for_what_is_near_and_slews_for_what_is_far_or_on_the_other_side() -> None:
    def target(hour_angle_deg: float) -> bench.Callable[[float], tuple[float, float, float]]:
        return lambda _: (-hour_angle_deg, 40.0, hour_angle_deg)

    mount, profile, law = (0.0, 40.0), MountProfile(), FeederLaw()
    assert plan_intercept(0.0, 0.0, mount, target(2.0), profile, law).by_rates
    assert not plan_intercept(0.0, 0.0, mount, target(60.0), profile, law).by_rates
    assert not plan_intercept(0.0, 0.0, mount, target(2.0), profile).by_rates
    # What is still to come is waited for.
    assert not plan_intercept(0.0, 60.0, mount, target(2.0), profile, law).by_rates


@pytest.mark.parametrize("later", [0, pytest.param(1, marks=pytest.mark.soak)])
@pytest.mark.parametrize("kind", range(len(bench.KINDS)), ids=lambda kind: bench.KINDS[kind])
def test_the_mount_is_on_target_within_two_seconds_of_the_earliest_instant(kind: int, later: int) -> None:
    draw = kind + later * len(bench.KINDS)
    for done in bench.outcomes(range(draw, draw + 1), seed=11):
        assert done.kind == bench.KINDS[kind]
        assert -0.1 <= done.lost_s <= bench.WITHIN_S
