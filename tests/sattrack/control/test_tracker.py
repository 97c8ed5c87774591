"""Errors on the sky against spherical trigonometry, and what the tracker asks of a mount."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any, Literal

import erfa
import numpy as np
import pytest
from msgspec.structs import replace

from sattrack.control.camera_image import Cameras
from sattrack.control.estimate import EstimatedBiases
from sattrack.control.steering import OffsetOnAxes
from sattrack.control.target import Detour, SatelliteTarget, sky_error
from sattrack.control.tracker import Phase, Tracker, TrackPlan
from sattrack.mount.geometry import AxisGeometry
from sattrack.mount.model import (
    SIDEREAL_RATE_DEG_S,
    AxisLimits,
    Hold,
    MountProfile,
    MoveAxes,
    PeriodicErrors,
    SitePlace,
    Slew,
    StatusSample,
    Stop,
    Wave,
    mean_sidereal_deg,
)
from sattrack.pointing.terms import PointingModel
from sattrack.runtime import demo_pass
from sattrack.views.messages import (
    Go,
    Jog,
    Message,
    ObservationMessage,
    OffsetBy,
    Pause,
    PlaceFix,
    Search,
    SeenOffset,
    Slip,
    SolvedField,
    StopNow,
)
from sattrack.views.run import ErrorView
from tle.bias import NO_BIAS, Bias
from tle.fixes import Fix, path_of
from tle.instants import Utc
from tle.propagator import Propagator

MOVING_NORTH = {"ra_rate_deg_s": 0.0, "dec_rate_deg_s": 0.5}


def target(ra_deg: float, dec_deg: float, **rates: float) -> SimpleNamespace:
    return SimpleNamespace(ra_deg=ra_deg, dec_deg=dec_deg, **{**MOVING_NORTH, **rates})


@pytest.mark.parametrize(
    ("mount", "goal"),
    [
        ((10.0, 20.0), (10.0, 20.0)),
        ((10.0, 20.0), (10.001, 20.002)),
        ((359.9999, 0.0), (0.0001, 0.0)),
        ((0.0, 89.999), (180.0, 89.999)),
        ((120.0, -45.0), (300.0, 45.0)),
        ((10.0, 60.0), (50.0, -20.0)),
    ],
)
def test_the_total_is_the_great_circle(mount: tuple[float, float], goal: tuple[float, float]) -> None:
    error = sky_error(0.0, *mount, target(*goal))  # type: ignore[arg-type]
    expected = erfa.seps(*(math.radians(x) for x in (*mount, *goal)))
    assert error.total_arcsec == pytest.approx(math.degrees(expected) * 3600.0, abs=1e-6)


def test_signs_for_a_northward_motion_overhead() -> None:
    """A mount to the north leads; one to the west (smaller RA) is to the left, seen from below."""
    north = sky_error(0.0, 100.0, 52.001, target(100.0, 52.0))  # type: ignore[arg-type]
    assert north.along_arcsec == pytest.approx(3.6)
    assert north.across_arcsec == pytest.approx(0.0)
    west = sky_error(0.0, 99.999, 52.0, target(100.0, 52.0))  # type: ignore[arg-type]
    assert west.across_arcsec == pytest.approx(3.6 * math.cos(math.radians(52.0)), rel=1e-6)
    assert west.along_arcsec == pytest.approx(0.0)


def test_signs_for_an_eastward_motion_overhead() -> None:
    moving = {"ra_rate_deg_s": 0.5, "dec_rate_deg_s": 0.0}
    error = sky_error(0.0, 100.001, 0.002, target(100.0, 0.0, **moving))  # type: ignore[arg-type]
    assert error.along_arcsec == pytest.approx(3.6, rel=1e-6)
    assert error.across_arcsec == pytest.approx(7.2, rel=1e-6)


def test_a_motion_is_judged_on_the_sky_where_right_ascension_is_short() -> None:
    """At 60° of declination: 0.2°/s east and 0.3°/s north; the mount is 1.8″ east and 7.2″ north of it."""
    moving = {"ra_rate_deg_s": 0.4, "dec_rate_deg_s": 0.3}
    error = sky_error(0.0, 100.001, 60.002, target(100.0, 60.0, **moving))  # type: ignore[arg-type]
    speed = math.hypot(0.2, 0.3)
    assert error.along_arcsec == pytest.approx((1.8 * 0.2 + 7.2 * 0.3) / speed, rel=1e-4)
    assert error.across_arcsec == pytest.approx((7.2 * 0.2 - 1.8 * 0.3) / speed, rel=1e-4)


def test_a_target_that_stands_has_neither_along_nor_across() -> None:
    stands = {"ra_rate_deg_s": 0.0, "dec_rate_deg_s": 0.0}
    error = sky_error(0.0, 100.0, 52.001, target(100.0, 52.0, **stands))  # type: ignore[arg-type]
    assert (error.along_arcsec, error.across_arcsec) == (0.0, 0.0)
    assert error.total_arcsec == pytest.approx(3.6)


CULMINATION_S = float(Utc.parse("2026-10-02T13:05:24Z").unix_s)
PLAN = TrackPlan(CULMINATION_S - 100.0, CULMINATION_S + 100.0)


def tracker(profile: MountProfile | None = None, plan: TrackPlan = PLAN, followed: Any = None) -> Tracker:
    propagator = Propagator(followed or demo_pass.elements(), demo_pass.SITE.place())
    return Tracker(propagator, plan, profile or MountProfile(), NO_BIAS)


def sample(one: Tracker, utc_s: float, off_deg: float = 0.0) -> StatusSample:
    """A mount that stands where the satellite is, but for so much in declination."""
    there = one.direction_at(utc_s)
    sidereal_deg = mean_sidereal_deg(utc_s, demo_pass.SITE.place().longitude_deg) % 360.0
    ra, dec = float(there.ra_deg), float(there.dec_deg) + off_deg
    return StatusSample(0, utc_s, sidereal_deg / 15.0, ra, dec, False, False, SIDEREAL_RATE_DEG_S, 0.0)


def error(utc_s: float, arcsec: float) -> ErrorView:
    return ErrorView(utc_s, arcsec, 0.0, arcsec, 0.0, 0.0)


class TestPhases:
    def test_ten_samples_on_target_are_tracking_and_two_arcminutes_off_are_not(self) -> None:
        one = tracker()
        one.phase = Phase.ACQUIRING
        for number in range(9):
            one._judge(error(100.0 + number, 2.0))
        one._judge(error(109.0, 2.1))
        for number in range(10):
            assert (one.phase, one.acquired_utc_s) == (Phase.ACQUIRING, None)
            one._judge(error(110.0 + number, 1.9))
        assert (one.phase, one.acquired_utc_s) == (Phase.TRACKING, 119.0)
        one._judge(error(130.0, 119.0))
        assert one.phase is Phase.TRACKING
        one._judge(error(131.0, 121.0))
        assert one.phase is Phase.ACQUIRING
        for number in range(10):
            one._judge(error(140.0 + number, 1.0))
        # Acquired it was at first.
        assert (one.phase, one.acquired_utc_s, one._on_target_utc_s) == (Phase.TRACKING, 119.0, 149.0)

    @pytest.mark.parametrize("resting", [True, False])
    def test_a_lost_target_is_searched_for_once_the_mount_is_on_it(self, resting: bool) -> None:
        """Not while the run is paused or a limit holds the mount: then no camera can see the target."""
        one, begun_s = tracker(), CULMINATION_S
        one.steering.cameras = Cameras(field_deg=0.1, search_when_lost=True)
        read = EstimatedBiases(0.0, 0.0, 0.0, 0.0, along_sigma_s=1.0, cross_sigma_km=2.0)
        one.steering.estimator.reading = lambda *_, **__: read  # type: ignore[method-assign]
        one.steering.estimator.last_utc_s = begun_s
        one.phase = Phase.TRACKING if resting else Phase.ACQUIRING
        one._on_target_utc_s = begun_s - 10.0
        if resting:
            one.operate(Pause(), begun_s + 1.0)
        one.take(sample(one, begun_s + 20.0))
        one.step(begun_s + 20.0, False)
        assert one.steering.biases.pattern_at(begun_s + 21.0) is None
        one.rest, one.phase, one._on_target_utc_s = None, Phase.TRACKING, begun_s + 25.0
        one.step(begun_s + 27.0, False)
        assert one.steering.biases.pattern_at(begun_s + 28.0) is None
        one.step(begun_s + 28.1, False)
        assert one.steering.biases.pattern_at(begun_s + 29.0) is not None

    def test_it_holds_until_it_is_heard_and_its_approach_begins(self) -> None:
        one = tracker()
        assert one.step(CULMINATION_S, False) == Hold()
        one = tracker()
        begins_s = PLAN.start_utc_s - 60.0
        one.take(sample(one, begins_s - 1.0, 30.0))
        assert one.step(begins_s - 0.1, False) == Hold()
        assert one.phase is Phase.WAITING
        motion = one.step(begins_s, False)
        assert isinstance(motion, Slew)
        assert one.phase is Phase.SLEWING
        # It waits where the satellite comes through at the start.
        there = one.direction_at(PLAN.start_utc_s)
        assert motion == Slew(pytest.approx(float(there.ra_deg)), pytest.approx(float(there.dec_deg)))
        assert one.followable_utc_s == PLAN.start_utc_s

    def test_one_that_is_near_is_followed_by_rates_at_once(self) -> None:
        one = tracker()
        one.take(sample(one, CULMINATION_S, 1.0))
        assert isinstance(one.step(CULMINATION_S, False), MoveAxes)
        assert one.phase is Phase.ACQUIRING

    @pytest.mark.parametrize(("held", "after_s"), [({}, 0.5), ({"held": False}, 0.5), ({"held": True}, 5.0)])
    def test_one_that_is_left_behind_is_slewed_to_and_later_where_a_limit_holds_the_mount(
        self, held: dict[str, bool], after_s: float
    ) -> None:
        """By 30°, for half a second or for five: a slew is sooner there than rates of 0.5°/s."""
        slow = AxisLimits(max_rate_deg_s=0.5, slew_rate_deg_s=10.0)
        one = tracker(MountProfile(ra=slow, dec=slow))
        one.phase = Phase.ACQUIRING
        slews = []
        for turn in range(120):
            now_s = CULMINATION_S + 0.05 * turn
            one.take(replace(sample(one, now_s, 30.0), counter=turn))
            one.step(now_s, False, **held)
            slews.append(one.phase is Phase.SLEWING)
            if slews[-1]:
                break
        assert 0.05 * slews.index(True) == pytest.approx(after_s, abs=0.051)

    @pytest.mark.parametrize("believed", [False, True])
    def test_samples_that_are_not_believed_put_no_mount_on_its_target(self, believed: bool) -> None:
        one = tracker()
        one.phase = Phase.ACQUIRING
        one.follower.take = lambda *_: believed  # type: ignore[method-assign]
        for turn in range(12):
            one.take(replace(sample(one, CULMINATION_S + 0.05 * turn), counter=turn))
        assert (one.phase is Phase.TRACKING) is believed

    def test_corrections_are_bounded_once_it_is_on_the_target(self) -> None:
        """At most a tenth of an axis' rate comes of wrong samples then; until then all of it is needed."""
        one, shares = tracker(), []
        one.take(sample(one, CULMINATION_S))

        def follow(now_utc_s: float, target: Any, share: float) -> None:
            shares.append(share)

        one.follower.follow = follow  # type: ignore[method-assign, assignment]
        for one.phase in (Phase.ACQUIRING, Phase.TRACKING):
            one.step(CULMINATION_S, False)
        assert shares == [1.0, 0.1]

    def test_cameras_clocks_are_told_where_the_mount_pointed(self) -> None:
        one, told = tracker(), []
        one.steering.clocks.note = lambda *place: told.append(place)  # type: ignore[method-assign]
        seen = sample(one, CULMINATION_S)
        one.take(seen)
        assert told == [(pytest.approx(CULMINATION_S, abs=0.1), seen.ra_deg, seen.dec_deg)]

    def test_on_a_new_way_samples_on_target_are_counted_anew(self) -> None:
        one, begins_s = tracker(), PLAN.start_utc_s - 60.0
        one.take(sample(one, begins_s - 1.0, 30.0))
        one._near = 9
        one.step(begins_s, False)
        one.phase = Phase.ACQUIRING
        for number in range(10):
            assert one.phase is Phase.ACQUIRING
            one._judge(error(PLAN.start_utc_s + number, 1.0))
        assert one.phase is Phase.TRACKING

    def test_the_end_of_the_plan_and_the_operator_stop_it_and_the_first_reason_stays(self) -> None:
        one = tracker()
        assert one.step(PLAN.end_utc_s - 0.01, False) == Hold()
        assert one.step(PLAN.end_utc_s, False) == Stop()
        one.operate(StopNow(), PLAN.end_utc_s)
        assert (one.ended_by, one.phase, one.rates) == ("set", Phase.STOPPING, MoveAxes(0.0, 0.0))
        other = tracker()
        other.operate(StopNow(), CULMINATION_S)
        assert other.step(CULMINATION_S, False) == Stop()
        assert other.ended_by == "operator"
        other.operate(Pause(), CULMINATION_S)
        assert (other.phase, other.rest) == (Phase.STOPPING, None)

    def test_a_pass_that_is_over_before_the_mount_is_there_is_set(self) -> None:
        one = tracker(plan=TrackPlan(CULMINATION_S - 100.0, CULMINATION_S + 1.0))
        one.take(sample(one, CULMINATION_S, 60.0))
        one.step(CULMINATION_S, False)
        assert (one.ended_by, one.followable_utc_s) == ("set", None)

    def test_a_pause_rests_until_it_goes_on(self) -> None:
        one = tracker()
        one.operate(Go(), CULMINATION_S)
        assert one.steering.refusal == "the run is not paused"
        one.operate(Jog(0.1, None), CULMINATION_S)
        assert one.steering.refusal == "the run is not paused: pause it first"
        one.take(sample(one, CULMINATION_S))
        one.operate(Pause(), CULMINATION_S)
        assert (one.phase, one.steering.refusal) == (Phase.PAUSED, None)
        assert one.rates == MoveAxes(0.0, 0.0)
        assert one.step(CULMINATION_S, False) == Stop()
        assert one.rates == MoveAxes(0.0, 0.0)
        one.operate(Search("spiral", 0.2, 0.1), CULMINATION_S)
        assert one.steering.refusal == "the run is paused: go on before a search"
        for late_s in (0.3, 0.6):
            assert one.step(CULMINATION_S + late_s, False) == Stop()
        assert one.rest is not None
        assert not one.rest.at_rest
        for late_s in (0.7, 1.0):
            one.step(CULMINATION_S + late_s, False, stopped=True)
        assert one.rest.at_rest
        one.operate(Go(), CULMINATION_S + 1.0)
        one.operate(Pause(), CULMINATION_S + 1.0)
        one.step(CULMINATION_S + 1.0, False)
        assert one.phase is Phase.PAUSED
        one.operate(Go(), CULMINATION_S + 1.1)
        one.step(CULMINATION_S + 1.1, False)
        assert (one.phase, one.rest) == (Phase.WAITING, None)

    @pytest.mark.parametrize("acquired", [False, True])
    def test_a_mount_that_was_paused_on_its_way_is_acquired_on_the_way_it_then_takes(
        self, acquired: bool
    ) -> None:
        one = tracker()
        one.followable_utc_s = CULMINATION_S
        one.acquired_utc_s = CULMINATION_S + 2.0 if acquired else None
        one.operate(Pause(), CULMINATION_S + 3.0)
        assert one.followable_utc_s == (CULMINATION_S if acquired else None)

    def test_offsets_count_once_the_mount_is_on_the_target(self) -> None:
        one = tracker()
        seen = SeenOffset(Utc(CULMINATION_S).isoformat("milliseconds"), 1.0, 2.0, 1.0)
        one.operate(seen, CULMINATION_S)
        assert one.steering.estimator.words == "the mount is not on the target"
        one.phase, one._on_target_utc_s = Phase.TRACKING, CULMINATION_S + 0.5
        one.operate(seen, CULMINATION_S + 1.0)
        assert one.steering.estimator.words == f"it is of {seen.utc}, before the mount was on the target"
        one._on_target_utc_s = CULMINATION_S - 0.5
        assert one._not_seen(seen) is None

    def test_fields_tell_of_a_cameras_clock_while_the_target_is_tracked(self) -> None:
        one, heard = tracker(), []
        field = SolvedField(Utc(CULMINATION_S).isoformat("milliseconds"), 10.0, 20.0, 1.0)
        one.steering.clocks.hear = heard.append  # type: ignore[method-assign, assignment]
        for phase in (Phase.SLEWING, Phase.ACQUIRING, Phase.TRACKING):
            one.phase = phase
            one.operate(field, CULMINATION_S)
        assert heard == [field]

    def test_elements_do_not_slip_and_take_no_fixes(self) -> None:
        one = tracker()
        assert (one.t0_utc_s, one.trouble, one.slipped_s) == (None, None, 0.0)
        one.operate(Slip(5.0), CULMINATION_S)
        assert one.steering.refusal == "only a table from T0 slips"
        utc = Utc(CULMINATION_S).isoformat("milliseconds")
        one.operate(PlaceFix(utc, 48.0, 11.0, 1000.0), CULMINATION_S)
        assert one.steering.refusal == "fixes are of what is followed by them only"
        assert (one.plan, one.slipped_s) == (PLAN, 0.0)

    @pytest.mark.parametrize("phase", list(Phase))
    def test_datagrams_fall_into_step_slowly_while_something_is_followed(self, phase: Phase) -> None:
        one = tracker()
        one.phase = phase
        stands_in: Any = SimpleNamespace(send_shift_s=lambda *told: told)
        one.follower = stands_in
        following, on_target = phase in {Phase.ACQUIRING, Phase.TRACKING}, phase is Phase.TRACKING
        assert one.send_shift_s(5.0) == (5.0, following, on_target)


class TestSatelliteTarget:
    def test_the_end_of_an_interval_is_where_the_next_begins(self) -> None:
        """Half a millisecond off it its rate makes up for that; farther off it is predicted anew."""
        asked: list[float] = []
        one = tracker()

        def direction_at(utc_s: float) -> Any:
            asked.append(utc_s)
            return one.direction_at(utc_s)

        target = SatelliteTarget(direction_at, ())
        for late_s, anew in (
            (0.0, False),
            (4e-4, False),
            (-4e-4, False),
            (6e-4, True),
            (-6e-4, True),
            (0.02, True),
        ):
            target.forget()
            target.span(CULMINATION_S, 0.05, (0.0, 0.0))
            asked.clear()
            utc_s = CULMINATION_S + 0.05 + late_s
            state, there = target.state(utc_s), one.direction_at(utc_s)
            assert (asked == [utc_s]) is anew
            assert state.ra_deg == pytest.approx(float(there.ra_deg), abs=3e-7)
            assert state.dec_deg == pytest.approx(float(there.dec_deg), abs=3e-7)


class TestAltAzimuth:
    """An alt-azimuth mount is fed azimuth from the south and altitude, as a right ascension of its axes."""

    def tracker(self, reports: Literal["sky", "horizon", "axes"]) -> Tracker:
        site = demo_pass.SITE.place()
        place = SitePlace(site.latitude_deg, site.longitude_deg)
        return tracker(MountProfile(geometry=AxisGeometry(0.0, 90.0, reports=reports), stands_at=place))

    @pytest.mark.parametrize("reports", ["sky", "axes"])
    @pytest.mark.parametrize("after_s", [-80.0, 0.0, 45.0])
    def test_what_it_is_fed(self, reports: Any, after_s: float) -> None:
        one, utc_s = self.tracker(reports), CULMINATION_S + after_s
        fed, there = one.fed_at(utc_s), one.direction_at(utc_s)
        sidereal_deg = one._sidereal.at(utc_s)
        azimuth = sidereal_deg - float(fed.ra_deg)
        # Mean sidereal time is off the true one by a second; the horizon is that of geodetic latitude.
        assert math.remainder(azimuth - (float(there.az_deg) - 180.0), 360.0) == pytest.approx(0.0, abs=0.03)
        assert fed.dec_deg == pytest.approx(float(there.alt_deg), abs=0.01)
        assert SIDEREAL_RATE_DEG_S - float(fed.ra_rate_deg_s) == pytest.approx(
            float(there.az_rate_deg_s), rel=2e-3
        )
        assert fed.dec_rate_deg_s == pytest.approx(float(there.alt_rate_deg_s), abs=1e-3)

    @pytest.mark.parametrize("reports", ["sky", "axes"])
    def test_right_ascensions_that_it_is_fed_are_within_a_turn(self, reports: Any) -> None:
        """Slews go there, and a datagram takes no more than 24 h."""
        one = self.tracker(reports)
        fed = [float(one.fed_at(CULMINATION_S + 1700.0 * k).ra_deg) for k in range(50)]
        assert all(0.0 <= ra_deg < 360.0 for ra_deg in fed)
        assert (min(fed) < 60.0, max(fed) > 300.0) == (True, True)

    def test_it_is_fed_by_its_own_clock(self) -> None:
        """Four seconds ahead: a right ascension of its axes is as much more for the same azimuth."""
        one, ahead_h = self.tracker("axes"), 4.0 / 3600.0
        before = float(one.fed_at(CULMINATION_S).ra_deg)
        seen = sample(one, CULMINATION_S)
        one.take(replace(seen, sidereal_h=seen.sidereal_h + ahead_h))
        after = float(one.fed_at(CULMINATION_S).ra_deg)
        assert math.remainder(after - before, 360.0) == pytest.approx(15.0 * ahead_h, abs=1e-4)

    def test_how_far_it_turns_until_the_end(self) -> None:
        one = self.tracker("sky")
        times = np.linspace(PLAN.start_utc_s, PLAN.end_utc_s, 41)
        azimuths = np.unwrap([math.radians(float(one.direction_at(t).az_deg)) for t in times])
        turned = np.degrees(azimuths - azimuths[0])
        onward = one.onward_deg()
        assert onward == pytest.approx((min(0.0, turned.min()), max(0.0, turned.max())), abs=0.05)
        assert tracker().onward_deg() is None
        assert tracker().periodic_arcsec(CULMINATION_S) is None

    def test_how_far_it_turns_is_looked_at_anew_twenty_seconds_later(self) -> None:
        one = self.tracker("sky")
        first = one.onward_deg()
        for later_s, anew in ((19.0, False), (21.0, True), (2.0, False), (0.0, True)):
            one.plan = replace(PLAN, start_utc_s=PLAN.start_utc_s + later_s)
            assert (one.onward_deg() != first) is anew
            first = one.onward_deg()

    def test_where_it_looks(self) -> None:
        one = self.tracker("sky")
        there = one.direction_at(CULMINATION_S)
        sidereal_deg = mean_sidereal_deg(CULMINATION_S, demo_pass.SITE.place().longitude_deg) % 360.0
        ra = (sidereal_deg - float(there.az_deg) + 180.0) % 360.0
        seen = StatusSample(
            0, CULMINATION_S, sidereal_deg / 15.0, ra, float(there.alt_deg), False, False, 0.0, 0.0
        )
        looks = one._looks_at_deg(seen)
        assert looks == pytest.approx((float(there.ra_deg), float(there.dec_deg)), abs=0.03)
        assert tracker()._looks_at_deg(seen) == (ra, float(there.alt_deg))


FLIES = Fix(CULMINATION_S, 52.3, 4.6, 9000.0, 150.0, 120.0, 3.0)


class TestSlips:
    def launched(self) -> Tracker:
        rocket = path_of("A", FLIES)
        rocket.t0 = Utc(CULMINATION_S - 20.0)
        detour = Detour(0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, False)
        plan = TrackPlan(CULMINATION_S - 10.0, CULMINATION_S + 40.0, detours=(detour,))
        return tracker(plan=plan, followed=rocket)

    def test_a_launch_that_slips_has_its_path_and_its_plan_later(self) -> None:
        one = self.launched()
        assert one.t0_utc_s == CULMINATION_S - 20.0
        before = one.direction_at(CULMINATION_S)
        one.operate(Go(), CULMINATION_S - 90.0)
        assert one.steering.refusal == "the run is not paused"
        for seconds in (5.0, 7.0):
            one.operate(Slip(seconds), CULMINATION_S - 30.0)
        assert (one.slipped_s, one.t0_utc_s, one.steering.refusal) == (12.0, CULMINATION_S - 8.0, None)
        assert one.plan == TrackPlan(CULMINATION_S + 2.0, CULMINATION_S + 52.0)
        # Detours were those of the path at its old time.
        assert one._satellite.passage is None
        later = one.direction_at(CULMINATION_S + 12.0)
        for name in ("ha_deg", "dec_deg", "range_km"):
            assert getattr(later, name) == pytest.approx(float(getattr(before, name)), abs=1e-5)
        # Directions of the same launch by another propagator slip, too.
        other = self.launched().steering.biases.course.propagator
        one.use(other.with_place("apparent"))
        later = one.direction_at(CULMINATION_S + 12.0)
        assert later.ha_deg == pytest.approx(float(before.ha_deg), abs=1e-5)

    @pytest.mark.parametrize(
        ("before", "after"),
        [
            (Phase.WAITING, Phase.WAITING),
            (Phase.SLEWING, Phase.WAITING),
            (Phase.ACQUIRING, Phase.ACQUIRING),
            (Phase.TRACKING, Phase.ACQUIRING),
        ],
    )
    def test_what_is_under_way_is_done_anew(self, before: Phase, after: Phase) -> None:
        one = self.launched()
        one.phase, one._near = before, 10
        one.operate(Slip(5.0), CULMINATION_S)
        assert one.phase is after
        assert (one._near == 0) is (before is Phase.TRACKING)

    def test_a_mount_that_waits_can_follow_as_much_later(self) -> None:
        """Else it would count as acquired that long after it could be followed."""
        one, now_s = self.launched(), CULMINATION_S - 12.0
        one.take(sample(one, now_s, -30.0))
        one.step(now_s, False)
        before_s = one.followable_utc_s or 0.0
        one.operate(Slip(5.0), now_s)
        one.take(sample(one, now_s + 5.0, -30.0))
        one.step(now_s + 5.0, False)
        assert one.followable_utc_s == pytest.approx(before_s + 5.0, abs=0.2)

    def test_no_slip_prolongs_the_plan_beyond_what_was_asked_for(self) -> None:
        one = self.launched()
        one.plan = replace(one.plan, latest_utc_s=one.plan.end_utc_s + 3.0)
        ends_s = one.plan.end_utc_s
        one.operate(Slip(12.0), CULMINATION_S)
        assert one.plan.end_utc_s == ends_s + 3.0

    def test_a_run_that_stops_does_not_slip(self) -> None:
        one = self.launched()
        one.operate(StopNow(), CULMINATION_S)
        one.operate(Slip(5.0), CULMINATION_S)
        assert (one.slipped_s, one.plan.start_utc_s) == (0.0, CULMINATION_S - 10.0)
        undated = tracker(followed=path_of("A", FLIES))
        undated.operate(Slip(5.0), CULMINATION_S)
        assert undated.steering.refusal == "only a table from T0 slips"


class TestFixes:
    def followed(self) -> Tracker:
        return tracker(
            plan=TrackPlan(CULMINATION_S - 5.0, CULMINATION_S + 60.0), followed=path_of("A", FLIES)
        )

    def fix(self, one: Tracker, at_s: float, now_s: float, north_deg: float = 0.0) -> None:
        utc = Utc(CULMINATION_S + at_s).isoformat("milliseconds")
        one.operate(PlaceFix(utc, 52.3 + north_deg, 4.6, 9000.0, 150.0, 120.0, 3.0), CULMINATION_S + now_s)

    def test_a_table_that_is_of_no_fixes_takes_none(self) -> None:
        table = path_of("A", FLIES)
        table.provenance = "a launch's table"
        one = tracker(plan=TrackPlan(CULMINATION_S - 5.0, CULMINATION_S + 60.0), followed=table)
        self.fix(one, 3.0, 4.0)
        assert one.steering.refusal == "fixes are of what is followed by them only"

    @pytest.mark.parametrize(("latest_s", "ends_s"), [(30.0, 30.0), (90.0, 63.0)])
    def test_no_fix_prolongs_the_plan_beyond_what_was_asked_for(self, latest_s: float, ends_s: float) -> None:
        plan = TrackPlan(CULMINATION_S - 5.0, CULMINATION_S + 20.0, latest_utc_s=CULMINATION_S + latest_s)
        one = tracker(plan=plan, followed=path_of("A", FLIES))
        self.fix(one, 3.0, 4.0)
        assert one.plan.end_utc_s == CULMINATION_S + ends_s

    def test_a_fix_prolongs_the_plan_and_bends_the_path(self) -> None:
        one, apart = self.followed(), 0.001
        at_once = one.direction_at(CULMINATION_S + 4.0).alt_deg
        # By a second later the plane would be 120 m farther north: it is told to be 111 m farther still.
        self.fix(one, 3.0, 4.0, north_deg=3.0 * 120.0 / 111200.0 + apart)
        assert (one.plan.start_utc_s, one.plan.end_utc_s) == (CULMINATION_S + 4.0, CULMINATION_S + 63.0)
        assert one.direction_at(CULMINATION_S + 4.0).alt_deg == pytest.approx(float(at_once), abs=1e-6)
        moved = Propagator(
            path_of("B", FLIES._replace(utc_s=CULMINATION_S + 3.0, lat_deg=52.3 + 360.0 / 111200.0 + apart)),
            demo_pass.SITE.place(),
        )
        then_s = CULMINATION_S + 10.0
        assert one.direction_at(then_s).alt_deg == pytest.approx(
            float(moved.at(Utc(then_s)).alt_deg), abs=1e-6
        )

    @pytest.mark.parametrize(
        ("at_s", "now_s", "news"),
        [
            (3.0, 4.0, True),
            (0.0, 4.0, False),
            (3.0, 12.9, True),
            (3.0, 13.1, False),
            (13.9, 4.0, True),
            (14.1, 4.0, False),
        ],
    )
    def test_a_fix_is_newer_than_the_last_and_within_ten_seconds_of_now(
        self, at_s: float, now_s: float, news: bool
    ) -> None:
        one = self.followed()
        plan = one.plan
        self.fix(one, at_s, now_s)
        utc = Utc(CULMINATION_S + at_s).isoformat("milliseconds")
        assert one.steering.refusal == (None if news else f"the fix of {utc} is not news")
        assert (one.plan != plan) is news

    def test_a_plan_still_to_come_begins_when_it_did(self) -> None:
        one = tracker(
            plan=TrackPlan(CULMINATION_S + 30.0, CULMINATION_S + 60.0), followed=path_of("A", FLIES)
        )
        self.fix(one, 3.0, 4.0)
        assert one.plan.start_utc_s == CULMINATION_S + 30.0


def test_a_model_is_that_of_the_side_of_the_pole_on_which_the_mount_stands() -> None:
    place = demo_pass.SITE.place()
    model = PointingModel({"IH": 60.0, "CH": 90.0}, place.latitude_deg)
    propagator = Propagator(demo_pass.elements(), place, pointing=model)
    one = Tracker(propagator, PLAN, MountProfile(), NO_BIAS)
    plain = one.direction_at(CULMINATION_S)
    seen = sample(one, CULMINATION_S)
    one.take(seen)
    assert one.direction_at(CULMINATION_S).ra_deg == plain.ra_deg
    one.take(replace(seen, beyond_pole=True))
    beyond = one.direction_at(CULMINATION_S)
    # Of the two, the collimation error is that which turns round: twice 90 arcseconds.
    apart = (float(beyond.ra_deg) - float(plain.ra_deg)) * math.cos(math.radians(float(plain.dec_deg)))
    assert abs(apart) * 3600.0 == pytest.approx(180.0, rel=0.01)


def test_what_was_predicted_before_the_sky_is_taken_otherwise_does_not_count() -> None:
    """Neither by a model's other side, nor by another propagator.

    The axes lag, so that commands look ahead, and the samples come where such looks ended.
    """
    slow = AxisLimits(lag_s=0.3)
    place = demo_pass.SITE.place()
    model = PointingModel({"CH": 90.0}, place.latitude_deg)
    modelled = Propagator(demo_pass.elements(), place, pointing=model)
    for other in (None, Propagator(demo_pass.elements(), place)):
        one = Tracker(modelled, PLAN, MountProfile(ra=slow, dec=slow), NO_BIAS)
        one.phase = Phase.TRACKING
        for turn in range(20):
            now_s = CULMINATION_S + 0.05 * turn
            one.take(replace(sample(one, now_s), counter=turn))
            motion = one.step(now_s, False)
            one.note_sent(motion, now_s)
        if other is not None:
            one.use(other)
        seen = one.take(replace(sample(one, now_s + 0.05), counter=20, beyond_pole=other is None))
        there = one.direction_at(seen.utc_s)
        assert one.target.ra_deg == pytest.approx(float(there.ra_deg), abs=1e-5)


EVERYWHERE = ((0.0, 360.0),)
WAVES = PeriodicErrors(
    "2026-10-02T00:00:00Z",
    3,
    (Wave(7, 60.0, -80.0, 0.1),),
    (Wave(2, 30.0, 0.0, 0.1),),
    EVERYWHERE,
    EVERYWHERE,
)


def beside_deg(first_deg: float, second_deg: float) -> tuple[float, float]:
    """How far axes stand past the angles that they report, by the table."""
    a, b = math.radians(7.0 * first_deg), math.radians(2.0 * second_deg)
    return (60.0 * math.sin(a) - 80.0 * math.cos(a)) / 3600.0, 30.0 * math.sin(b) / 3600.0


@pytest.mark.parametrize("beyond_pole", [False, True])
class TestPeriodicErrors:
    """By hand; past the pole the first axis is half a turn on, and the second at the supplement."""

    def facing(self, beyond_pole: bool) -> Tracker:
        one = tracker(MountProfile(periodic=WAVES))
        one._stand = SimpleNamespace(beyond_pole=beyond_pole)  # type: ignore[assignment]
        return one

    def angles(self, hour_angle_deg: float, dec_deg: float, beyond_pole: bool) -> tuple[float, float]:
        return (hour_angle_deg + 180.0, 180.0 - dec_deg) if beyond_pole else (hour_angle_deg, dec_deg)

    def test_axes_that_report_what_is_fed_stand_on_the_satellite(self, beyond_pole: bool) -> None:
        one = self.facing(beyond_pole)
        fed, there = one.fed_at(CULMINATION_S), one.direction_at(CULMINATION_S)
        sidereal_deg = one._sidereal.at(CULMINATION_S)
        reported = self.angles(sidereal_deg - float(fed.ra_deg), float(fed.dec_deg), beyond_pole)
        past = beside_deg(*reported)
        wanted = self.angles(sidereal_deg - float(there.ra_deg), float(there.dec_deg), beyond_pole)
        for k in (0, 1):
            off_deg = math.remainder(reported[k] + past[k] - wanted[k], 360.0)
            assert off_deg == pytest.approx(0.0, abs=1e-6)
        shown = one.periodic_arcsec(CULMINATION_S)
        level, sense = abs(math.cos(math.radians(reported[1]))), -1.0 if beyond_pole else 1.0
        assert shown == pytest.approx((3600.0 * past[0] * level, 3600.0 * sense * past[1]), rel=0.01)

    def test_they_stand_on_it_by_the_mounts_own_clock(self, beyond_pole: bool) -> None:
        """Four minutes ahead: the axes stand a degree on then, and so is their place in the table."""
        one, ahead_deg = self.facing(beyond_pole), 1.0
        seen = replace(sample(one, CULMINATION_S), beyond_pole=beyond_pole)
        one.take(replace(seen, sidereal_h=seen.sidereal_h + ahead_deg / 15.0))
        sidereal_deg = seen.sidereal_h * 15.0 + ahead_deg
        fed, there = one.fed_at(CULMINATION_S), one.direction_at(CULMINATION_S)
        reported = self.angles(sidereal_deg - float(fed.ra_deg), float(fed.dec_deg), beyond_pole)
        past = beside_deg(*reported)
        wanted = self.angles(sidereal_deg - float(there.ra_deg), float(there.dec_deg), beyond_pole)
        for k in (0, 1):
            off_deg = math.remainder(reported[k] + past[k] - wanted[k], 360.0)
            # A degree beside it in the table makes several arcseconds.
            assert off_deg * 3600.0 == pytest.approx(0.0, abs=0.1)

    def test_it_looks_where_its_axes_stand(self, beyond_pole: bool) -> None:
        one = self.facing(beyond_pole)
        seen = StatusSample(0, CULMINATION_S, 10.0, 120.0, 40.0, False, False, 0.0, 0.0)
        ra_deg, dec_deg = one._looks_at_deg(seen)
        past = beside_deg(*self.angles(30.0, 40.0, beyond_pole))
        assert ra_deg == pytest.approx(120.0 - past[0], abs=1e-9)
        assert dec_deg == pytest.approx(40.0 + (-past[1] if beyond_pole else past[1]), abs=1e-9)

    def test_a_table_that_does_harm_is_left(self, beyond_pole: bool) -> None:
        one = self.facing(beyond_pole)
        heard: list[Any] = []
        judge = SimpleNamespace(take=lambda *told: heard.append(told), harms=False)
        one._judge_of_table = judge  # type: ignore[assignment]
        offset = OffsetOnAxes(CULMINATION_S, 3.0, 4.0)

        def used(*_: Any) -> None:
            one.steering.last_offset = offset

        one.steering.obey = used  # type: ignore[method-assign]
        one.phase, one._on_target_utc_s = Phase.TRACKING, CULMINATION_S - 1.0
        seen = SeenOffset(Utc(CULMINATION_S).isoformat("milliseconds"), 1.0, 2.0, 1.0)
        one.operate(Search("spiral", 0.2, 0.1), CULMINATION_S)
        assert heard == []
        one.operate(seen, CULMINATION_S)
        ((utc_s, moved, there, level),) = heard
        fed = one.fed_at(CULMINATION_S)
        hour_angle_deg = one._sidereal.at(CULMINATION_S) - float(fed.ra_deg)
        angles = self.angles(hour_angle_deg, float(fed.dec_deg), beyond_pole)
        assert (utc_s, moved) == (CULMINATION_S, (3.0, -4.0 if beyond_pole else 4.0))
        assert there[:2] == pytest.approx(angles)
        assert level == pytest.approx(abs(math.cos(math.radians(float(fed.dec_deg)))))
        assert one.table_left is False
        judge.harms = True
        one.operate(seen, CULMINATION_S)
        assert (one.table_left, one.periodic_arcsec(CULMINATION_S)) == (True, None)
        assert one.fed_at(CULMINATION_S).ra_deg == one.direction_at(CULMINATION_S).ra_deg
        one.operate(seen, CULMINATION_S)
        assert len(heard) == 2


OBSERVED = Propagator(demo_pass.elements(), demo_pass.SITE.place(), Bias(3.0, 0.0), place="astrometric").at(
    Utc(CULMINATION_S)
)


class TestPreparedSteps:
    """Of axes that lag: how they are fed now depends on where the target will be."""

    def rates(self, message: Message | None, *, prepared: bool = False, anew: bool = False) -> list[float]:
        """Follow for two seconds; return the rates that are sent in the two periods after a message came."""
        slow = AxisLimits(lag_s=0.3)
        one, sent = tracker(MountProfile(ra=slow, dec=slow)), []
        one.phase = Phase.TRACKING
        for turn in range(42):
            now_s = CULMINATION_S + 0.05 * turn
            if turn == 40:
                if prepared:
                    one.prepare(now_s - 0.05)
                if message is not None:
                    one.operate(message, now_s - 0.04)
            if turn >= 40 and anew:
                one.use(one.steering.biases.course.propagator)
            one.take(replace(sample(one, now_s), counter=turn))
            motion = one.step(now_s, False)
            assert isinstance(motion, MoveAxes)
            one.note_sent(motion, now_s)
            sent.append(motion)
        return [rate for one in sent[40:] for rate in (one.ra_rate_deg_s, one.dec_rate_deg_s)]

    @pytest.mark.parametrize(
        "message",
        [
            OffsetBy("along_s", "add", 1.0),
            ObservationMessage(
                Utc(CULMINATION_S).isoformat("microseconds"),
                float(OBSERVED.ra_deg),
                float(OBSERVED.dec_deg),
                "icrs",
                20.0,
            ),
        ],
        ids=["offset", "observation"],
    )
    def test_what_came_after_it_was_prepared_counts_in_the_next(self, message: Message) -> None:
        """As if nothing had been computed before it came."""
        known = pytest.approx(self.rates(message, anew=True), abs=2e-6)
        assert self.rates(message, prepared=True) == known
        assert self.rates(message) == known
        assert self.rates(None) != known


class TestWays:
    def test_three_slews_that_end_elsewhere_end_the_run_in_an_error(self) -> None:
        one, now_s = tracker(), CULMINATION_S
        astray = sample(one, now_s, 60.0)
        for number in range(3):
            one.take(replace(astray, counter=number + 1, arrival_utc_s=now_s))
            motion = one.step(now_s, False)
            assert isinstance(motion, Slew)
            assert one.phase is Phase.SLEWING
            one.note_sent(motion, now_s)
            last = one.step(now_s + 1.0, True)
            if number < 2:
                assert (last, one.phase) == (Hold(), Phase.WAITING)
            now_s += 2.0
        assert (last, one.phase, one.ended_by) == (Stop(), Phase.STOPPING, "error")
        assert (one.trouble or "").startswith("got 3 slew commands, and stands ")

    def test_past_the_pole_rates_are_noted_in_the_sense_of_the_axes(self) -> None:
        detour = Detour(CULMINATION_S, CULMINATION_S + 10.0, 0.0, 0.0, 1.0, 0.0, 1.0, True)
        one = tracker(plan=TrackPlan(PLAN.start_utc_s, PLAN.end_utc_s, detours=(detour,)))
        passage = one._satellite.passage
        assert passage is not None
        noted: list[Any] = []
        one.follower.note_sent = lambda motion, now_utc_s: noted.append(motion)  # type: ignore[method-assign]
        for across in (False, True):
            passage.across = across
            one.note_sent(MoveAxes(1.0, 0.5), CULMINATION_S)
            one.note_sent(Hold(), CULMINATION_S)
        assert noted == [MoveAxes(1.0, 0.5), Hold(), MoveAxes(1.0, -0.5), Hold()]

    def crossing(self, begin_s: float = 0.0) -> Tracker:
        """A tracker whose plan leads through the pole from so long after the culmination on."""
        detour = Detour(
            CULMINATION_S + begin_s, CULMINATION_S + begin_s + 10.0, 0.0, 0.0, 1.0, 0.0, 1.0, True
        )
        return tracker(plan=TrackPlan(PLAN.start_utc_s, PLAN.end_utc_s, detours=(detour,)))

    def test_past_the_pole_a_mount_is_where_its_declination_axis_has_turned_on_to(self) -> None:
        one = self.crossing()
        for turn, beyond_pole in ((0, False), (100, True)):
            at_s = CULMINATION_S - 1.0 + 0.05 * turn
            seen = replace(sample(one, at_s), counter=turn, dec_deg=80.0, beyond_pole=beyond_pole)
            one.take(seen)
        assert one.follower.axes is not None
        assert one.follower.axes.dec.position_deg == pytest.approx(100.0)

    @pytest.mark.parametrize("across", [False, True])
    def test_past_the_pole_rates_are_sent_in_the_sense_of_the_direction(self, across: bool) -> None:
        one = self.crossing()
        one.take(sample(one, CULMINATION_S))
        one.phase = Phase.TRACKING
        passage = one._satellite.passage
        assert passage is not None
        passage.across = across
        one.follower.follow = lambda *_: MoveAxes(1.0, 0.5)  # type: ignore[method-assign]
        wanted = MoveAxes(1.0, -0.5 if across else 0.5)
        assert (one.step(CULMINATION_S, False), one.rates) == (wanted, wanted)

    @pytest.mark.parametrize(("begin_s", "through"), [(-5.0, False), (5.0, True)])
    def test_who_joins_after_a_detour_has_begun_does_not_make_it(self, begin_s: float, through: bool) -> None:
        one = self.crossing(begin_s)
        one.take(sample(one, CULMINATION_S, 1.0))
        one.step(CULMINATION_S, False)
        assert one.phase is Phase.ACQUIRING
        assert (one._satellite.passage is not None) is through

    def test_a_detour_is_no_reason_for_a_slew(self) -> None:
        one = self.crossing(30.0)
        one.phase = Phase.ACQUIRING
        for turn in range(120):
            one.take(replace(sample(one, CULMINATION_S + 0.05 * turn, 30.0), counter=turn))
            one.step(CULMINATION_S + 0.05 * turn, False)
            assert one.phase is Phase.ACQUIRING

    @pytest.mark.parametrize("detour", [False, True])
    def test_after_a_pause_on_a_way_through_the_pole_the_axes_are_looked_at_anew(self, detour: bool) -> None:
        one = self.crossing(30.0) if detour else tracker()
        one.take(sample(one, CULMINATION_S))
        one.operate(Pause(), CULMINATION_S)
        for late_s in (0.0, 0.3):
            one.step(CULMINATION_S + late_s, False, stopped=True)
        one.operate(Go(), CULMINATION_S + 0.4)
        one.step(CULMINATION_S + 0.4, False, stopped=True)
        assert one.phase is Phase.WAITING
        assert (one.follower.axes is None) is detour

    @pytest.mark.parametrize("turns", [False, True])
    def test_a_paused_mount_that_takes_to_the_sky_is_led_with_it_and_let_go_before_a_slew(
        self, turns: bool
    ) -> None:
        """It is commanded to do just that; what ends MoveAxis takes 0.3 s before the mount can slew."""
        one, asked = tracker(), []
        drive_deg_s = SIDEREAL_RATE_DEG_S if turns else 0.0
        one.operate(Pause(), CULMINATION_S)
        one.take(replace(sample(one, CULMINATION_S), ra_drive_deg_s=drive_deg_s))
        for late_s in (0.0, 0.3):
            motion = one.step(CULMINATION_S + late_s, False, stopped=True)
        assert motion == (MoveAxes(0.0, 0.0) if turns else Hold())
        plan = one._way.plan

        def planned(*args: Any) -> Any:
            asked.append(args[3])
            return plan(*args)

        one._way.plan = planned  # type: ignore[method-assign, assignment]
        one.operate(Go(), CULMINATION_S + 0.4)
        for late_s in (0.4, 0.45):
            one.step(CULMINATION_S + late_s, False, stopped=True)
        assert asked == [turns]

    def test_the_first_instant_at_which_it_could_have_followed_stays(self) -> None:
        one = tracker()
        one.take(sample(one, CULMINATION_S, 60.0))
        one.step(CULMINATION_S, False)
        first_s = one.followable_utc_s
        assert first_s is not None
        one.phase = Phase.WAITING
        one.step(CULMINATION_S + 5.0, False)
        assert one.phase is Phase.SLEWING
        assert one.followable_utc_s == first_s

    @pytest.mark.parametrize(("led", "judged"), [(None, False), (Slew(10.0, 20.0), True)])
    def test_rates_that_stand_for_a_slew_are_judged_as_one(self, led: Slew | None, judged: bool) -> None:
        one = tracker()
        one.take(sample(one, CULMINATION_S, 60.0))
        assert isinstance(one.step(CULMINATION_S, False), Slew)
        one.note_sent(MoveAxes(1.0, 0.0), CULMINATION_S, led)
        one.step(CULMINATION_S + 0.05, False)
        # Rates in place of a slew are safety's refusal.
        assert (one.phase is Phase.SLEWING) is judged

    def test_a_run_that_is_stopped_in_a_pause_rests_no_more(self) -> None:
        one = tracker()
        one.operate(Pause(), CULMINATION_S)
        one.operate(StopNow(), CULMINATION_S)
        assert one.rest is None
        one.operate(Jog(0.1, None), CULMINATION_S)
        assert one.steering.refusal == "the run is not paused: pause it first"

    def test_what_is_jogged_ends_and_why_is_told(self) -> None:
        one = tracker()
        one.end_jogs("a limit", CULMINATION_S)
        assert one.steering.refusal is None
        one.operate(Pause(), CULMINATION_S)
        one.end_jogs("a limit", CULMINATION_S)
        assert one.steering.refusal == "a limit"

    def test_a_pause_ends_a_search_where_it_is(self) -> None:
        one = tracker()
        one.operate(Search("spiral", 0.2, 0.1), CULMINATION_S - 60.0)
        assert one.steering.biases.pattern_at(CULMINATION_S - 30.0) is not None
        one.operate(Pause(), CULMINATION_S - 40.0)
        assert one.steering.biases.pattern_at(CULMINATION_S - 30.0) is None
        along, cross = one.steering.biases.totals(CULMINATION_S)
        assert math.hypot(along, cross) > 0.05
