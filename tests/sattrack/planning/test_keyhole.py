"""Ways past the pole against closed forms: great circles, time-optimal axes, numerical integration."""

from __future__ import annotations

import math

import numpy as np
import pytest
from planning_builders import great_circle

from sattrack.mount.model import SIDEREAL_RATE_DEG_S, AxisLimits, MountProfile
from sattrack.planning.path import cruise_deg_s, find_keyholes, reach_deg

TOLERANCE_DEG = 2.0 / 3600.0
FREE = MountProfile(through_pole=True, dec_axis_limits_deg=(-270.0, 270.0))
STIFF = MountProfile(ra=AxisLimits(max_rate_deg_s=6.0, max_acceleration_deg_s2=1e5))


def arrays(*values: float) -> list[np.ndarray[tuple[int, ...], np.dtype[np.float64]]]:
    return [np.array([value]) for value in values]


@pytest.mark.parametrize(("seconds", "turn_deg"), [(1.0, 2.5), (1.2, 3.6), (2.0, 8.4), (10.0, 56.4)])
def test_from_rest_to_rest_an_axis_reaches_what_a_double_integrator_can(
    seconds: float, turn_deg: float
) -> None:
    # a = 10, r = 6: a T² / 4 up to T = 2 r / a = 1.2 s, then r T - r² / a.
    least, most = reach_deg(*arrays(0.0, 0.0, seconds), 6.0, 10.0)
    assert most[0] == pytest.approx(turn_deg)
    assert least[0] == pytest.approx(-turn_deg)


def test_a_time_too_short_to_change_rate_reaches_nowhere() -> None:
    least, most = reach_deg(*arrays(-5.0, 5.0, 0.9), 6.0, 10.0)
    assert math.isnan(least[0])
    assert math.isnan(most[0])


@pytest.mark.parametrize(
    ("first", "last", "seconds", "turn_deg"), [(4.0, 5.0, 6.0, -20.0), (-1.0, 3.0, 4.0, 9.0)]
)
def test_a_trapezoid_turns_as_far_as_it_was_asked(
    first: float, last: float, seconds: float, turn_deg: float
) -> None:
    cruise = float(cruise_deg_s(*arrays(first, last, seconds, turn_deg), 8.0)[0])
    time_s = np.linspace(0.0, seconds, 200_001)
    on = first + np.sign(cruise - first) * np.minimum(8.0 * time_s, abs(cruise - first))
    off = last + np.sign(cruise - last) * np.minimum(8.0 * (seconds - time_s), abs(cruise - last))
    rate = np.where(time_s < abs(cruise - first) / 8.0, on, off)
    assert np.trapezoid(rate, time_s) == pytest.approx(turn_deg, abs=1e-3)


@pytest.mark.parametrize(("speed", "distance"), [(0.5, 0.2), (0.7, 1.0), (1.0, 2.0)])
def test_clipping_loses_what_the_great_circle_says(speed: float, distance: float) -> None:
    # Past the pole the hour angle is the arc tangent of tan(w t) / sin(p); it is left where it reaches 6 °/s.
    def hour_angle(t: float) -> float:
        angle, off = math.radians(speed * t), math.radians(distance)
        return math.degrees(math.atan2(math.sin(angle), math.cos(angle) * math.sin(off)))

    def rate(t: float) -> float:
        return (hour_angle(t + 1e-4) - hour_angle(t - 1e-4)) / 2e-4

    leave = root(lambda t: rate(t) - 6.0, -60.0, 0.0)
    join = root(lambda t: 6.0 * (t - leave) - (hour_angle(t) - hour_angle(leave)), 0.5, 60.0)
    (found,) = find_keyholes(great_circle(speed, distance), STIFF, TOLERANCE_DEG)
    # The path's samples show where to leave to a step of 0.05 s.
    assert found.clipped_s == pytest.approx(join - leave, abs=0.1)
    assert found.polar_distance_deg == pytest.approx(distance, abs=1e-3)


def root(value, low: float, high: float) -> float:  # type: ignore[no-untyped-def]
    rising = value(high) > value(low)
    for _ in range(80):
        middle = 0.5 * (low + high)
        if (value(middle) > 0.0) == rising:
            high = middle
        else:
            low = middle
    return low


@pytest.mark.parametrize(("speed", "distance"), [(0.5, 0.2), (0.7, 1.0), (1.0, 2.0)])
def test_through_the_pole_less_than_half_is_lost(speed: float, distance: float) -> None:
    (found,) = find_keyholes(great_circle(speed, distance), FREE, TOLERANCE_DEG)
    assert found.through_s is not None
    assert found.through_s < 0.5 * found.clipped_s
    assert found.detour is not None
    assert found.detour.through_pole


def test_the_way_through_the_pole_keeps_the_limits_and_meets_the_target_at_both_ends() -> None:
    path = great_circle(0.7, 1.0)
    (found,) = find_keyholes(path, FREE, TOLERANCE_DEG)
    detour = found.detour
    assert detour is not None
    time_s = np.linspace(detour.begin_utc_s, detour.end_utc_s, 4001)
    target_ha = np.interp(time_s, path.utc_s, path.pointing.hour_angle_axis_deg)
    target_dec = np.interp(time_s, path.utc_s, path.pointing.dec_axis_deg)
    ra_of_target = np.interp(time_s, path.utc_s, path.ra_deg)
    axes = np.array(
        [detour.axes_at(t, ra, dec) for t, ra, dec in zip(time_s, ra_of_target, target_dec, strict=True)]
    )
    # The sidereal turn is taken out of the right ascension, so that the hour angle axis is left.
    hour_angle = -(axes[:, 0] - SIDEREAL_RATE_DEG_S * (time_s - time_s[0]))
    rates = np.gradient(hour_angle, time_s)
    assert np.max(np.abs(rates)) <= 6.0
    assert np.max(np.abs(np.diff(rates) / np.diff(time_s))) <= 10.0
    dec_rates = np.gradient(axes[:, 1], time_s)
    assert np.max(np.abs(dec_rates)) <= 6.0
    assert np.max(np.abs(np.diff(dec_rates) / np.diff(time_s))) <= 10.0
    assert hour_angle[0] == pytest.approx(target_ha[0], abs=1e-3)
    assert axes[0, 1] == pytest.approx(target_dec[0], abs=1e-6)
    # At its end the axes point to the target from the other side.
    off_turn = math.remainder(hour_angle[-1] - target_ha[-1] - 180.0, 360.0)
    assert off_turn == pytest.approx(0.0, abs=0.1)
    assert axes[-1, 1] == pytest.approx(180.0 - target_dec[-1], abs=1e-3)


def test_no_way_of_many_tried_at_random_loses_less() -> None:
    path = great_circle(0.7, 1.0)
    (found,) = find_keyholes(path, FREE, TOLERANCE_DEG)
    assert found.through_s is not None
    dice = np.random.default_rng(3)
    begin, end = found.begin_utc_s, found.end_utc_s
    leave = begin - dice.uniform(0.0, 15.0, 200_000)
    join = end + dice.uniform(0.0, 15.0, 200_000)
    hour_angle = path.pointing.hour_angle_axis_deg
    turn = np.interp(join, path.utc_s, hour_angle) - 180.0 - np.interp(leave, path.utc_s, hour_angle)
    first = np.interp(leave, path.utc_s, path.hour_angle_rate_deg_s)
    last = np.interp(join, path.utc_s, path.hour_angle_rate_deg_s)
    # Backwards at the limit, with ramps of the full acceleration at both ends: nothing turns back further.
    seconds = join - leave
    back = -6.0 * seconds + (first + 6.0) ** 2 / 20.0 + (last + 6.0) ** 2 / 20.0
    possible = (back <= turn) & ((first + last + 12.0) / 10.0 <= seconds)
    assert possible.any()
    assert np.min(seconds[possible]) > found.through_s - 0.25


def test_on_one_side_of_the_pole_nothing_is_better_than_clipping() -> None:
    for speed, distance in ((0.3, 0.5), (0.7, 1.5), (1.0, 0.1)):
        (found,) = find_keyholes(great_circle(speed, distance), MountProfile(), TOLERANCE_DEG)
        assert found.through_s is None
        assert found.detour is None
        assert found.round_s == found.clipped_s


def test_a_pass_far_from_the_pole_or_slow_has_no_keyhole() -> None:
    assert find_keyholes(great_circle(0.7, 20.0), FREE, TOLERANCE_DEG) == []
    assert find_keyholes(great_circle(0.02, 1.0), FREE, TOLERANCE_DEG) == []


def test_a_declination_axis_that_cannot_go_on_keeps_to_its_side() -> None:
    narrow = MountProfile(through_pole=True, dec_axis_limits_deg=(-95.0, 95.0))
    (found,) = find_keyholes(great_circle(0.7, 1.0), narrow, TOLERANCE_DEG)
    assert found.through_s is None
