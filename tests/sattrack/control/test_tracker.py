"""Errors on the sky against spherical trigonometry, and what the tracker asks of a mount."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any, Literal

import erfa
import numpy as np
import pytest

from sattrack.control.target import sky_error
from sattrack.control.tracker import Phase, Tracker, TrackPlan
from sattrack.mount.geometry import AxisGeometry
from sattrack.mount.model import (
    SIDEREAL_RATE_DEG_S,
    Hold,
    MountProfile,
    MoveAxes,
    SitePlace,
    Slew,
    StatusSample,
    Stop,
    mean_sidereal_deg,
)
from sattrack.runtime import demo_pass
from sattrack.views.messages import Go, Jog, Pause, PlaceFix, Search, SeenOffset, Slip, StopNow
from sattrack.views.run import ErrorView
from tle.bias import NO_BIAS
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


CULMINATION_S = float(Utc.parse("2026-10-02T13:05:24Z").unix_s)
PLAN = TrackPlan(CULMINATION_S - 100.0, CULMINATION_S + 100.0)


def tracker(profile: MountProfile | None = None, plan: TrackPlan = PLAN) -> Tracker:
    propagator = Propagator(demo_pass.elements(), demo_pass.SITE.place())
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
        assert one.step(CULMINATION_S, False) == Stop()
        one.operate(Search("spiral", 0.2, 0.1), CULMINATION_S)
        assert one.steering.refusal == "the run is paused: go on before a search"
        for late_s in (0.0, 0.3):
            one.step(CULMINATION_S + late_s, False, stopped=True)
        assert one.rest is not None
        assert one.rest.at_rest
        one.operate(Go(), CULMINATION_S + 1.0)
        one.operate(Pause(), CULMINATION_S + 1.0)
        one.step(CULMINATION_S + 1.0, False)
        assert one.phase is Phase.PAUSED
        one.operate(Go(), CULMINATION_S + 1.1)
        one.step(CULMINATION_S + 1.1, False)
        assert (one.phase, one.rest) == (Phase.WAITING, None)

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

    def test_elements_do_not_slip_and_take_no_fixes(self) -> None:
        one = tracker()
        assert (one.t0_utc_s, one.trouble, one.slipped_s) == (None, None, 0.0)
        one.operate(Slip(5.0), CULMINATION_S)
        assert one.steering.refusal == "only a table from T0 slips"
        utc = Utc(CULMINATION_S).isoformat("milliseconds")
        one.operate(PlaceFix(utc, 48.0, 11.0, 1000.0), CULMINATION_S)
        assert one.steering.refusal == "fixes are of what is followed by them only"
        assert (one.plan, one.slipped_s) == (PLAN, 0.0)


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

    def test_how_far_it_turns_until_the_end(self) -> None:
        one = self.tracker("sky")
        times = np.linspace(PLAN.start_utc_s, PLAN.end_utc_s, 41)
        azimuths = np.unwrap([math.radians(float(one.direction_at(t).az_deg)) for t in times])
        turned = np.degrees(azimuths - azimuths[0])
        onward = one.onward_deg()
        assert onward == pytest.approx((min(0.0, turned.min()), max(0.0, turned.max())), abs=0.05)
        assert tracker().onward_deg() is None
        assert tracker().periodic_arcsec(CULMINATION_S) is None

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
