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


@pytest.mark.parametrize(("dec_deg", "nearest_deg"), [(45.0, 63.43494882), (-45.0, -63.43494882), (0.0, 0.0)])
def test_beside_the_pole_the_axis_goes_as_far_as_the_pole_and_not_past_it(
    dec_deg: float, nearest_deg: float
) -> None:
    """60° aside tan(45°) doubles. A target on the other side is nearest at the pole that is on its side."""
    beside = msgspec.structs.replace(detour(), through_pole=False)
    assert beside.axes_at(105.0, 108.5, dec_deg) == pytest.approx((48.5, nearest_deg))
    for past_deg in (80.0, -80.0):
        pole_deg = 90.0 if past_deg > 0.0 else -90.0
        assert beside.axes_at(105.0, 228.5, past_deg) == pytest.approx((48.5, pole_deg))


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
    seen = StatusSample(
        7, 111.0, 3.0, 230.0, pole_dec_deg * 0.99, True, False, 0.25, -0.5, True, move_acknowledged=True
    )
    after = passage.unfolded(seen)
    assert after.ra_deg == pytest.approx(50.0)
    assert after.dec_deg == pytest.approx(pole_dec_deg * 1.01)
    # All else is as the mount has said it.
    assert msgspec.structs.replace(after, ra_deg=seen.ra_deg, dec_deg=seen.dec_deg) == seen


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


def test_a_right_ascension_past_the_pole_stays_within_a_turn() -> None:
    assert Passage((detour(),)).place(300.0, 230.0, 60.0) == pytest.approx((50.0, 120.0))


def test_a_detour_is_round_the_north_pole_unless_it_says_otherwise() -> None:
    way = Detour(100.0, 110.0, 40.0, -1.0, 2.0, -1.0, 3.0, through_pole=True)
    assert Passage((way,)).place(300.0, 10.0, 60.0) == pytest.approx((190.0, 120.0))
    south = Passage((detour(-90.0),))
    assert south.place(300.0, 10.0, -60.0) == pytest.approx((190.0, -120.0))


def test_a_span_is_where_the_target_goes_and_on_the_turns_that_the_target_is_on() -> None:
    """Through 0 h by 0.3° in half a second, 0.4°/s faster at its end; the axes are two turns on."""
    course = {0.0: TargetState(359.9, 20.0, 0.4, -0.1), 0.5: TargetState(0.2, 19.9, 0.8, -0.3)}
    span = SatelliteTarget(course.__getitem__, ()).span(0.0, 0.5, (720.5, 19.0))
    assert span.begin_deg == (359.9, 20.0)
    assert span.move_deg == pytest.approx((0.3, -0.1))
    assert span.acceleration_deg_s2 == pytest.approx((0.8, -0.4))
    assert span.bound_deg == pytest.approx((360.5, 19.0))


def test_offsets_that_change_take_the_place_of_what_was_predicted() -> None:
    ra_deg = [10.0]
    target = SatelliteTarget(lambda _: TargetState(ra_deg[0], 20.0, 0.0, 0.0), ())
    target.span(99.0, 0.05, (10.0, 20.0))
    ra_deg[0] = 10.5
    assert target.state(99.05).ra_deg == 10.0
    target.forget()
    assert target.state(99.05).ra_deg == 10.5


def test_past_either_pole_the_mount_is_on_the_other_side() -> None:
    target = SatelliteTarget(lambda _: TargetState(10.0, -20.0, 0.0, 0.0), (detour(-90.0),))
    assert target.passage is not None
    for dec_deg, across in ((-91.0, True), (-89.0, False), (91.0, True)):
        span = target.span(99.0, 0.05, (10.0, dec_deg))
        assert target.passage.across is across
        # A target that stands asks for no motion, however the mount stands.
        assert (span.move_deg, span.acceleration_deg_s2) == ((0.0, 0.0), (0.0, 0.0))


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
