"""Slews and how they are judged, by hand: how long they take, when they are over, tried again, given up."""

from __future__ import annotations

import math
from typing import Any

import pytest

from sattrack.control.approach import (
    Approach,
    ApproachStep,
    Intercept,
    MountPlace,
    chase_time_s,
    plan_intercept,
    slew_time_s,
)
from sattrack.control.following import ControlLaw
from sattrack.control.target import TargetState
from sattrack.mount.model import AxisLimits, Hold, MountProfile, MoveAxes, Slew

LAW = ControlLaw().feeder
AXIS = AxisLimits(max_rate_deg_s=4.0, slew_rate_deg_s=10.0, max_acceleration_deg_s2=8.0)
PROFILE = MountProfile(ra=AXIS, dec=AXIS, command_delay_s=0.02)
HERE = MountPlace(120.0, 100.0, 20.0)
"""At an hour angle of 20°."""


class TestTimes:
    @pytest.mark.parametrize(
        ("distance", "seconds"),
        [
            # Up with a, down with a/2: ramps of v/a and 2v/a take 1.5 v²/a of way and half of 3 v/a more.
            (100.0, 100.0 / 10.0 + 1.5 * 10.0 / 8.0),
            (18.75, 18.75 / 10.0 + 1.5 * 10.0 / 8.0),
            # d = t²/2 · a · (a/2)/(a + a/2): t = sqrt(6 d/a).
            (8.0, math.sqrt(6.0 * 8.0 / 8.0)),
        ],
    )
    def test_a_slew(self, distance: float, seconds: float) -> None:
        assert slew_time_s(distance, AXIS) == pytest.approx(seconds)
        assert slew_time_s(-distance, AXIS) == pytest.approx(seconds)

    @pytest.mark.parametrize("distance", [0.5, 3.0, 40.0])
    def test_rates_take_the_ramps_the_run_and_five_settlings(self, distance: float) -> None:
        """A trapezoid whose ramps are the law's shares of the acceleration, integrated here."""
        up, down = LAW.ramp_share * 8.0, LAW.braking_share * 8.0
        step, gone, rate, seconds = 1e-4, 0.0, 0.0, 0.0
        while gone < distance:
            left = distance - gone
            rate = min(rate + up * step, 4.0, math.sqrt(2.0 * down * left))
            gone += max(rate, 1e-3) * step
            seconds += step
        expected = seconds + 5.0 * LAW.settling_s
        assert chase_time_s(distance, AXIS, LAW) == pytest.approx(expected, rel=0.01)
        assert chase_time_s(-distance, AXIS, LAW) == chase_time_s(distance, AXIS, LAW)

    def test_no_way_takes_no_time(self) -> None:
        assert chase_time_s(0.0, AXIS, LAW) == 0.0


def fixed(ra: float, dec: float, hour_angle: float) -> Any:
    return lambda _: (ra, dec, hour_angle)


class TestIntercept:
    def test_a_slew_is_met_after_its_handshake_and_the_end_of_moveaxis(self) -> None:
        target = fixed(80.0, 20.0, 40.0)
        still = plan_intercept(100.0, 0.0, (20.0, 20.0), target, PROFILE)
        assert still == Intercept(pytest.approx(100.0 + slew_time_s(20.0, AXIS) + 0.6), 80.0, 20.0)
        moving = plan_intercept(100.0, 0.0, (20.0, 20.0), target, PROFILE, None, True)
        assert moving.utc_s == pytest.approx(still.utc_s + 0.3)

    def test_the_slower_axis_decides(self) -> None:
        for place in ((40.0, 21.0), (21.0, 40.0)):
            met = plan_intercept(0.0, 0.0, (20.0, 20.0), fixed(0.0, place[1], place[0]), PROFILE)
            assert met.utc_s == pytest.approx(slew_time_s(20.0, AXIS) + 0.6)

    @pytest.mark.parametrize(
        ("place", "by_rates"),
        [((22.0, 20.0), True), ((20.0, 22.0), True), ((41.0, 20.0), False), ((20.0, -1.0), False)],
    )
    def test_rates_are_for_what_is_near(self, place: tuple[float, float], by_rates: bool) -> None:
        quick = MountProfile(ra=AxisLimits(8.0, 8.0, 8.0), dec=AxisLimits(8.0, 8.0, 8.0))
        met = plan_intercept(0.0, -1.0, (20.0, 20.0), fixed(0.0, place[1], place[0]), quick, LAW)
        assert met.by_rates is by_rates

    def test_rates_are_not_for_what_a_slew_reaches_much_sooner(self) -> None:
        slow = AxisLimits(max_rate_deg_s=0.5, slew_rate_deg_s=10.0, max_acceleration_deg_s2=8.0)
        profile = MountProfile(ra=slow, dec=slow)
        met = plan_intercept(0.0, -1.0, (20.0, 20.0), fixed(0.0, 20.0, 30.0), profile, LAW)
        assert met.by_rates is False
        near = plan_intercept(0.0, -1.0, (20.0, 20.0), fixed(0.0, 20.0, 20.3), profile, LAW)
        assert near == Intercept(pytest.approx(chase_time_s(0.3, slow, LAW)), 0.0, 20.0, by_rates=True)

    @pytest.mark.parametrize(("longer_s", "by_rates"), [(0.95, True), (1.05, False)])
    def test_rates_may_take_a_second_longer_than_a_slew_takes_to_settle(
        self, longer_s: float, by_rates: bool
    ) -> None:
        slow = AxisLimits(max_rate_deg_s=2.0, slew_rate_deg_s=10.0, max_acceleration_deg_s2=8.0)
        # Bisected here: the way for which they take so much longer, the slew's handshake counted.
        near_deg, far_deg = 0.01, 19.0
        while far_deg - near_deg > 1e-9:
            way_deg = 0.5 * (near_deg + far_deg)
            apart_s = chase_time_s(way_deg, slow, LAW) - slew_time_s(way_deg, slow) - 0.6
            near_deg, far_deg = (way_deg, far_deg) if apart_s < longer_s else (near_deg, way_deg)
        profile = MountProfile(ra=slow, dec=slow)
        met = plan_intercept(0.0, -1.0, (20.0, 20.0), fixed(0.0, 20.0 + near_deg, 20.0), profile, LAW)
        assert met.by_rates is by_rates

    def test_what_is_still_to_come_is_slewed_to(self) -> None:
        met = plan_intercept(0.0, 50.0, (20.0, 20.0), fixed(0.0, 20.0, 20.1), PROFILE, LAW)
        assert met == Intercept(50.0, 0.0, 20.0, by_rates=False)


class Way:
    """An approach to a target that stands, or moves in right ascension and declination, as fed."""

    def __init__(self, ra: float = 70.0, dec: float = 20.0, rate: float = 0.0, dec_rate: float = 0.0) -> None:
        self.ra, self.dec, self.rate, self.dec_rate = ra, dec, rate, dec_rate
        self.way = Approach(PROFILE, self.target, LAW)

    def target(self, utc_s: float) -> TargetState:
        ra, dec = self.ra + self.rate * utc_s, self.dec + self.dec_rate * utc_s
        return TargetState(ra, dec, self.rate, self.dec_rate)

    def slews(self, now_s: float = 0.0, not_before_s: float = -1.0) -> Slew:
        """Have a slew planned and sent."""
        assert self.way.plan(now_s, not_before_s, HERE) is ApproachStep.SLEW
        goal = Slew(self.way.intercept.ra_deg, self.way.intercept.dec_deg)
        self.way.sent(goal)
        return goal


def stands_at(goal: Slew, off_deg: float = 0.0) -> MountPlace:
    return MountPlace(120.0, goal.ra_deg, goal.dec_deg + off_deg)


class TestApproach:
    def test_a_target_that_is_near_is_followed_at_once(self) -> None:
        way = Way(ra=99.0)
        assert way.way.plan(0.0, -1.0, HERE) is ApproachStep.FOLLOW
        assert way.way.intercept.by_rates is True
        # On the other side of the pole, or held by a limit, rates are no way.
        assert way.way.plan(0.0, -1.0, HERE, held=True) is ApproachStep.SLEW
        beyond = MountPlace(120.0, 100.0, 20.0, beyond_pole=True)
        assert way.way.plan(0.0, -1.0, beyond) is ApproachStep.SLEW
        assert way.way.intercept.by_rates is False

    def test_a_slew_that_is_over_at_its_goal_is_followed_on(self) -> None:
        way = Way()
        goal = way.slews()
        assert way.way.go_on(1.0, False, HERE) is ApproachStep.SLEW
        assert way.way.go_on(5.0, True, stands_at(goal)) is ApproachStep.FOLLOW
        assert way.way.trouble is None

    def test_a_target_that_has_gone_far_is_slewed_to_again(self) -> None:
        for far, step in ((19.0, ApproachStep.FOLLOW), (21.0, ApproachStep.PLAN)):
            for name in ("ra", "dec"):
                way = Way()
                goal = way.slews()
                setattr(way, name, getattr(way, name) + far)
                assert way.way.go_on(9.0, True, stands_at(goal)) is step

    def test_a_slew_that_was_not_sent_is_not_over(self) -> None:
        way = Way()
        assert way.way.plan(0.0, -1.0, HERE) is ApproachStep.SLEW
        way.way.sent(Hold())
        assert way.way.go_on(5.0, True, HERE) is ApproachStep.SLEW

    @pytest.mark.parametrize(("ra_off_deg", "there"), [(0.19, True), (-0.19, True), (0.21, False)])
    def test_right_ascensions_are_nearer_to_one_another_at_high_declinations(
        self, ra_off_deg: float, there: bool
    ) -> None:
        """A tenth of a degree on the sky, at 60° of declination."""
        way = Way(dec=60.0)
        goal = way.slews()
        stands = MountPlace(120.0, goal.ra_deg + ra_off_deg, 60.0)
        assert way.way.go_on(9.0, True, stands) is (ApproachStep.FOLLOW if there else ApproachStep.PLAN)

    def test_three_slews_that_end_elsewhere_are_given_up(self) -> None:
        way = Way()
        steps = []
        for _ in range(3):
            goal = way.slews()
            steps.append(way.way.go_on(5.0, True, stands_at(goal, 2.0)))
        assert steps == [ApproachStep.PLAN, ApproachStep.PLAN, ApproachStep.GIVE_UP]
        assert way.way.trouble == "got 3 slew commands, and stands 2.0° from its goal"

    def test_one_that_ends_well_begins_the_count_anew(self) -> None:
        way = Way()
        ends = ((2.0, "PLAN"), (2.0, "PLAN"), (0.0, "FOLLOW"), (2.0, "PLAN"), (2.0, "PLAN"), (2.0, "GIVE_UP"))
        for off_deg, step in ends:
            goal = way.slews()
            assert way.way.go_on(5.0, True, stands_at(goal, off_deg)) is ApproachStep[step]

    @pytest.mark.parametrize(("ra", "dec", "way_deg"), [(70.0, 20.0, 30.0), (70.0, -40.0, 60.0)])
    def test_one_that_does_not_end_is_tried_again_after_three_times_its_length_and_half_a_minute(
        self, ra: float, dec: float, way_deg: float
    ) -> None:
        """That of the axis that has farther to go."""
        way = Way(ra, dec)
        way.slews(10.0)
        takes_s = slew_time_s(way_deg, AXIS) + 0.6
        last_s = 10.0 + 3.0 * takes_s + 30.0
        assert way.way.go_on(last_s - 0.01, False, HERE) is ApproachStep.SLEW
        assert way.way.go_on(last_s + 0.01, False, HERE) is ApproachStep.PLAN

    def test_where_safety_has_no_way_rates_follow_and_no_slew_for_two_seconds(self) -> None:
        way = Way()
        way.slews()
        way.way.sent(MoveAxes(0.0, 0.0))
        assert way.way.go_on(1.0, False, HERE) is ApproachStep.FOLLOW
        for now_s in (1.1, 1.7, 2.3, 2.9):
            assert way.way.slew_ahead(now_s, 100.0, 30.0, HERE, False) is False
        assert way.way.slew_ahead(3.1, 100.0, 30.0, HERE, False) is False
        assert way.way.slew_ahead(3.7, 100.0, 30.0, HERE, False) is True

    @pytest.mark.parametrize(("held", "for_s"), [(False, 0.5), (True, 5.0)])
    def test_a_mount_that_is_far_off_for_a_while_slews_ahead(self, held: bool, for_s: float) -> None:
        way = Way()
        way.slews()
        assert way.way.slew_ahead(10.0, 100.0, 5.1, HERE, held) is False
        assert way.way.slew_ahead(10.0 + for_s - 0.01, 100.0, 5.1, HERE, held) is False
        assert way.way.slew_ahead(10.0 + for_s, 100.0, 5.1, HERE, held) is True
        # Then it counts anew, as it does once it is near.
        assert way.way.slew_ahead(10.1 + for_s, 100.0, 5.1, HERE, held) is False
        assert way.way.slew_ahead(12.0 + for_s, 100.0, 4.9, HERE, held) is False
        assert way.way.slew_ahead(20.0 + for_s, 100.0, 5.1, HERE, held) is False

    def test_it_does_not_where_it_would_come_too_late_or_rates_are_as_good(self) -> None:
        way = Way()
        way.slews()
        # 4.875 s of slew, 0.6 s of handshake and 0.3 s to end MoveAxis: there at 16.275 s.
        for end_s, error_deg, there in ((16.2, 30.0, False), (16.3, 30.0, True)):
            way.way.slew_ahead(10.0, end_s, error_deg, HERE, False)
            assert way.way.slew_ahead(10.5, end_s, error_deg, HERE, False) is there, end_s
            way.way.slew_ahead(11.0, end_s, 0.0, HERE, False)
        near = Way(ra=94.0)
        near.way.slew_ahead(10.0, 100.0, 6.0, HERE, False)
        assert near.way.slew_ahead(10.5, 100.0, 6.0, HERE, False) is False

    @pytest.mark.parametrize(
        ("rate", "dec_rate", "fastest"), [(0.8, 0.0, 0.8), (0.8, -1.6, 1.6), (-0.8, 0.4, 0.8)]
    )
    def test_a_target_still_to_come_is_met_with_its_rate(
        self, rate: float, dec_rate: float, fastest: float
    ) -> None:
        """Half of the ramp to 0.8°/s at 8°/s², the command's delay, and a period and a half before."""
        way = Way(70.0 - 60.0 * rate, 20.0 - 60.0 * dec_rate, rate, dec_rate)
        goal = way.slews(0.0, 60.0)
        assert way.way.intercept.utc_s == 60.0
        lead_s = 0.5 * fastest / 8.0 + 0.02 + 1.5 * 0.05
        assert way.way.go_on(60.0 - lead_s - 0.001, True, stands_at(goal)) is ApproachStep.SLEW
        assert way.way.go_on(60.0 - lead_s + 0.001, True, stands_at(goal)) is ApproachStep.FOLLOW

    def test_a_mount_that_rings_at_its_goal_counts_as_there_after_a_quarter_of_a_second(self) -> None:
        way = Way()
        goal = way.slews()
        assert way.way.go_on(1.0, False, HERE) is ApproachStep.SLEW
        for number in range(5):
            rings = stands_at(goal, 0.009 * (-1) ** number)
            assert way.way.go_on(4.0 + 0.05 * number, False, rings) is ApproachStep.SLEW
        assert way.way.go_on(4.26, False, stands_at(goal)) is ApproachStep.FOLLOW

    def test_one_that_swings_or_has_not_left_its_goal_yet_does_not(self) -> None:
        way = Way()
        goal = way.slews()
        way.way.go_on(1.0, False, HERE)
        for number in range(40):
            swings = stands_at(goal, 0.011 * (-1) ** number)
            assert way.way.go_on(4.0 + 0.05 * number, False, swings) is ApproachStep.SLEW
        stays = Way(ra=70.0)
        goal = stays.slews()
        for number in range(40):
            assert stays.way.go_on(4.0 + 0.05 * number, False, stands_at(goal)) is ApproachStep.SLEW

    @pytest.mark.parametrize(
        ("dec", "rate", "dec_rate", "vain_s"),
        [
            (0.0, 0.0, 0.0, 20.0),
            (0.0, 0.5, 0.0, 20.0),
            (0.0, 4.0, 0.0, 3.75),
            (0.0, 50.0, 0.0, 0.5),
            (0.0, 0.0, -4.0, 3.75),
            # At 60° both the way and the rate are half of it on the sky.
            (60.0, 4.0, 0.0, 3.75),
        ],
    )
    def test_after_a_slew_cut_short_the_next_waits_for_the_target_to_go_on(
        self, dec: float, rate: float, dec_rate: float, vain_s: float
    ) -> None:
        """Half of the 30° that are missing, at the target's rate on the sky, within 0.5 and 20 s."""
        way = Way(ra=70.0, dec=dec)
        way.way.plan(0.0, -1.0, HERE)
        met_s = way.way.intercept.utc_s
        way.rate, way.ra = rate, 70.0 - rate * met_s
        way.dec_rate, way.dec = dec_rate, dec - dec_rate * met_s
        short = Slew(100.0, dec)
        way.way.sent(short)
        assert way.way.go_on(5.0, True, stands_at(short)) is ApproachStep.FOLLOW
        error_deg = 30.0
        assert way.way.slew_ahead(5.0 + vain_s - 0.01, 1e6, error_deg, HERE, False) is False
        way.way.slew_ahead(5.0 + vain_s + 0.01, 1e6, error_deg, HERE, False)
        assert way.way._far_since_utc_s == pytest.approx(5.0 + vain_s + 0.01)

    def test_a_mount_with_time_to_spare_rings_out_where_it_waits(self) -> None:
        """A target that is still to come is not followed before the mount says that its slew is over."""
        way = Way(rate=0.8)
        goal = way.slews(0.0, 30.0)
        way.way.go_on(1.0, False, HERE)
        for now_s in (20.0, 20.3, 29.9, 30.3):
            assert way.way.go_on(now_s, False, stands_at(goal)) is ApproachStep.SLEW
        assert way.way.go_on(30.35, True, stands_at(goal)) is ApproachStep.FOLLOW

    def test_a_new_slew_is_judged_by_itself(self) -> None:
        """Not by the one before it, which safety may have refused, or which has come to the same place."""
        refused = Way()
        refused.slews()
        refused.way.sent(MoveAxes(0.0, 0.0))
        assert refused.way.go_on(1.0, False, HERE) is ApproachStep.FOLLOW
        assert refused.way.plan(9.0, -1.0, HERE) is ApproachStep.SLEW
        assert refused.way.go_on(9.0, False, HERE) is ApproachStep.SLEW
        there = Way()
        goal = there.slews()
        there.way.go_on(1.0, False, HERE)
        steps = [there.way.go_on(4.0 + 0.3 * number, False, stands_at(goal)) for number in range(2)]
        assert steps == [ApproachStep.SLEW, ApproachStep.FOLLOW]
        # It stands there yet, and may be about to leave for the other side of the pier.
        there.slews(9.0)
        for number in range(4):
            assert there.way.go_on(9.0 + 0.3 * number, False, stands_at(goal)) is ApproachStep.SLEW

    def test_how_long_it_is_far_off_counts_anew_from_a_new_way_on(self) -> None:
        way = Way()
        way.slews()
        assert way.way.slew_ahead(10.0, 100.0, 5.1, HERE, False) is False
        way.slews(10.2)
        assert way.way.slew_ahead(10.5, 100.0, 5.1, HERE, False) is False
        assert way.way.slew_ahead(11.0, 100.0, 5.1, HERE, False) is True

    @pytest.mark.parametrize("ra", [349.0, 359.0, 1.0])
    def test_what_is_near_is_so_across_the_first_point_of_aries(self, ra: float) -> None:
        """Sidereal time 10°, and the mount 20° west of the meridian."""
        assert Way(ra).way.plan(0.0, -1.0, MountPlace(10.0, 350.0, 20.0)) is ApproachStep.FOLLOW

    def test_slews_are_across_it_as_long_as_elsewhere(self) -> None:
        way, stand = Way(ra=5.0), MountPlace(10.0, 350.0, 20.0)
        assert way.way.plan(10.0, -1.0, stand, held=True) is ApproachStep.SLEW
        way.way.sent(Slew(5.0, 20.0))
        takes_s = slew_time_s(15.0, AXIS) + 0.6
        assert way.way.intercept.utc_s == pytest.approx(10.0 + takes_s)
        assert way.way.go_on(10.0 + 3.0 * takes_s + 30.01, False, stand) is ApproachStep.PLAN

    def test_a_target_that_has_gone_on_across_it_is_run_after(self) -> None:
        way = Way(ra=359.5)
        goal = way.slews()
        way.ra = 1.0
        assert way.way.go_on(9.0, True, stands_at(goal)) is ApproachStep.FOLLOW
