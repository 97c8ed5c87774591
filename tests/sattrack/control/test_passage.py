"""Coordinates through the pole, by hand: what lies past 90° is half a turn on, and its supplement."""

from __future__ import annotations

import msgspec
import pytest

from sattrack.control.target import Detour, Passage, SatelliteTarget, TargetState
from sattrack.mount.model import MoveAxes, StatusSample


def detour(pole_dec_deg: float = 90.0) -> Detour:
    return Detour(
        begin_utc_s=100.0,
        end_utc_s=110.0,
        ra_deg=40.0,
        first_deg_s=-1.0,
        cruise_deg_s=2.0,
        last_deg_s=-1.0,
        acceleration_deg_s2=3.0,
        through_pole=True,
        pole_dec_deg=pole_dec_deg,
    )


def sample(utc_s: float, ra_deg: float, dec_deg: float, beyond_pole: bool) -> StatusSample:
    return StatusSample(1, utc_s, 0.0, ra_deg, dec_deg, True, False, 0.0, 0.0, beyond_pole)


def test_the_right_ascension_runs_by_its_trapezoid() -> None:
    way = detour()
    # Ramps of a second at both ends: from -1 to 2 turns 0.5°, and back again.
    assert way.ra_at(100.0) == pytest.approx(40.0)
    assert way.ra_at(101.0) == pytest.approx(40.5)
    assert way.ra_at(105.0) == pytest.approx(48.5)
    assert way.ra_at(109.0) == pytest.approx(56.5)
    assert way.ra_at(110.0) == pytest.approx(57.0)
    assert way.ra_at(100.5) == pytest.approx(40.0 - 0.5 + 0.5 * 3.0 * 0.25)
    assert way.ra_at(109.5) == pytest.approx(56.5 + 1.0 - 0.5 * 3.0 * 0.25)
    slower = msgspec.structs.replace(way, acceleration_deg_s2=1.5, last_deg_s=0.5)
    # Two seconds from -1 to 2, seven at 2, and one from 2 to 0.5.
    assert slower.ra_at(101.0) == pytest.approx(40.0 - 1.0 + 0.75)
    assert slower.ra_at(102.0) == pytest.approx(41.0)
    assert slower.ra_at(109.0) == pytest.approx(55.0)
    assert slower.ra_at(109.5) == pytest.approx(56.0 - 0.75 * 0.25)
    assert slower.ra_at(110.0) == pytest.approx(56.25)


def test_the_declination_is_the_nearest_that_the_axis_can_have() -> None:
    way = detour()
    ra, dec = way.axes_at(105.0, 48.5, 89.0)
    assert (ra, dec) == (pytest.approx(48.5), pytest.approx(89.0))
    # The target is straight across the pole.
    assert way.axes_at(105.0, 228.5, 89.0)[1] == pytest.approx(91.0)
    # A quarter of a turn aside nothing is nearer than the pole itself.
    assert way.axes_at(105.0, 138.5, 89.0)[1] == pytest.approx(90.0)


def test_a_side_that_changes_before_the_first_detour_is_the_first_side() -> None:
    way = Passage((detour(),))
    for utc_s, beyond in ((90.0, False), (95.0, True), (100.5, True)):
        seen = sample(utc_s, 40.0, 80.0, beyond)
        assert way.unfolded(seen) is seen
    assert way.unfolded(sample(103.0, 40.0, 80.0, False)).dec_deg == 100.0


@pytest.mark.parametrize("pole_dec_deg", [90.0, -90.0])
def test_past_the_pole_samples_go_on(pole_dec_deg: float) -> None:
    passage = Passage((detour(pole_dec_deg),))
    before = sample(99.0, 40.0, pole_dec_deg * 0.99, beyond_pole=False)
    assert passage.unfolded(before) is before
    after = passage.unfolded(sample(111.0, 230.0, pole_dec_deg * 0.99, beyond_pole=True))
    assert after.ra_deg == pytest.approx(50.0)
    assert after.dec_deg == pytest.approx(pole_dec_deg * 1.01)


def test_a_detour_after_one_through_the_pole_is_made_on_the_other_side() -> None:
    beside = msgspec.structs.replace(detour(), begin_utc_s=200.0, end_utc_s=210.0, through_pole=False)
    passage = Passage((detour(), beside))
    ra, dec = beside.axes_at(205.0, 30.0, 60.0)
    assert passage.place(205.0, 30.0, 60.0) == (pytest.approx(ra + 180.0), pytest.approx(180.0 - dec))
    # It ends there too.
    assert passage.place(300.0, 30.0, 60.0) == (pytest.approx(210.0), pytest.approx(120.0))


def test_below_the_equator_they_still_do() -> None:
    passage = Passage((detour(),))
    passage.unfolded(sample(99.0, 40.0, 89.0, beyond_pole=False))
    assert passage.unfolded(sample(300.0, 10.0, -20.0, beyond_pole=True)).dec_deg == pytest.approx(200.0)
    assert passage.place(300.0, 10.0, -20.0) == (pytest.approx(190.0), pytest.approx(200.0))


def test_rates_of_the_direction_turn_round_past_the_pole() -> None:
    target = SatelliteTarget(lambda _: TargetState(10.0, 20.0, 0.0, 0.0), (detour(),))  # type: ignore[arg-type, return-value]
    rates = MoveAxes(1.0, 0.5)
    passage = target.passage
    assert passage is not None
    target.span(99.0, 0.05, (10.0, 89.0))
    assert passage.turned(rates) == rates
    target.span(99.0, 0.05, (10.0, 91.0))
    assert passage.turned(rates) == MoveAxes(1.0, -0.5)
    assert passage.turned(MoveAxes(1.0, -0.5)) == rates


def test_following_that_begins_after_a_detour_does_not_go_through_the_pole() -> None:
    passage = Passage((detour(),))
    assert passage.from_instant(105.0) is None
    assert passage.from_instant(120.0) is None
    ahead = passage.from_instant(50.0)
    assert ahead is not None
    assert ahead.place(60.0, 10.0, 20.0) == (10.0, 20.0)
