"""A mount's sidereal clock in the mean, its own coordinates, and how rates lead to a direction, by hand."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from sattrack.control.aim import Aim, Lead, MountInstant, MountSidereal
from sattrack.control.approach import slew_time_s
from sattrack.core.angles import wrap180
from sattrack.mount.geometry import AxisGeometry
from sattrack.mount.model import (
    SIDEREAL_RATE_DEG_S,
    MountProfile,
    MoveAxes,
    PointingTerms,
    SitePlace,
    Slew,
    StatusSample,
    mean_sidereal_deg,
)
from tle.site import Site

NOW = 1_790_000_000.0
LONGITUDE = 11.0


def gap(clock: MountSidereal, utc_s: float = NOW) -> float:
    return wrap180(clock.at(utc_s) - mean_sidereal_deg(utc_s, LONGITUDE))


def note(clock: MountSidereal, gap_deg: float, utc_s: float = NOW) -> None:
    clock.note((mean_sidereal_deg(utc_s, LONGITUDE) + gap_deg) % 360.0, utc_s)


def test_a_clock_is_ahead_by_the_mean_of_its_readings() -> None:
    clock = MountSidereal(LONGITUDE)
    assert gap(clock) == 0.0
    for number, gap_deg in enumerate((2.001, 2.003, 2.005, 1.999)):
        note(clock, gap_deg, NOW + number)
    assert gap(clock, NOW + 100.0) == pytest.approx(2.002, abs=1e-7)


def test_a_clock_that_was_set_is_taken_as_it_is() -> None:
    clock = MountSidereal(LONGITUDE)
    for gap_deg in (2.0, 2.009, 359.0):
        note(clock, gap_deg)
    assert gap(clock) == pytest.approx(-1.0, abs=1e-7)
    note(clock, 359.006)
    assert gap(clock) == pytest.approx(-0.997, abs=1e-7)


@pytest.mark.parametrize(("set_by_deg", "mean_deg"), [(0.009, 1.0045), (0.011, 1.011), (-0.011, 0.989)])
def test_a_hundredth_of_a_degree_is_more_than_a_clock_scatters(set_by_deg: float, mean_deg: float) -> None:
    clock = MountSidereal(LONGITUDE)
    note(clock, 1.0)
    note(clock, 1.0 + set_by_deg)
    assert gap(clock) == pytest.approx(mean_deg, abs=1e-7)


def test_a_mean_runs_through_half_a_turn_and_begins_with_the_first_reading() -> None:
    clock = MountSidereal(LONGITUDE)
    note(clock, 0.005)
    assert gap(clock) == pytest.approx(0.005, abs=1e-7)
    for gap_deg in (179.998, 180.002):
        note(clock, gap_deg)
    assert abs(gap(clock)) == pytest.approx(180.0, abs=1e-6)


def test_the_last_four_hundred_readings_count_most() -> None:
    clock = MountSidereal(LONGITUDE)
    for _ in range(1000):
        note(clock, 1.0)
    note(clock, 1.004)
    assert gap(clock) == pytest.approx(1.0 + 0.004 / 400.0, abs=5e-9)


AT = MountInstant(NOW, 200.0, refracts=True)


def aim(**terms: float) -> Aim:
    """Return the aim of a mount at 50° north with a pointing model of these terms, arcseconds."""
    known = {name: (value, 1.0) for name, value in terms.items()}
    model = PointingTerms("2026-10-01T00:00:00Z", 50.0, known, 2.0, 20, signs="tpoint")
    return Aim(MountProfile(pointing=model), Site(50.0, LONGITUDE))


class TestAim:
    @pytest.mark.parametrize("sense", [1.0, -1.0])
    def test_a_mount_that_stands_past_the_pole_reports_the_other_side_of_the_sky(self, sense: float) -> None:
        """A zero of declination of 0.25°, and a direction 0.1° short of the pole: its axis is past it."""
        beside = aim(ID=sense * -900.0)
        assert beside.own_deg(170.0, sense * 89.9, AT) == pytest.approx((30.0, sense * 90.15))
        # Hour angle 30° + 180°, of a sidereal time of 200°.
        assert beside.reported_deg(170.0, sense * 89.9, AT) == pytest.approx((350.0, sense * 89.85))
        assert beside.reported_deg(170.0, sense * 89.7, AT) == pytest.approx((170.0, sense * 89.95))

    def test_a_mount_is_fed_what_is_seen_through_the_air_unless_it_adds_that_itself(self) -> None:
        """Towards the equator at 40° of altitude: 1.19 times 57.2″ by ERFA; Bennett has 2″ more."""
        straight = aim(ID=0.0)
        raised_deg = 1.19 * 57.2 / 3600.0
        told = MountInstant(NOW, 200.0)
        assert straight.own_deg(200.0, 0.0, told) == pytest.approx((0.0, raised_deg), abs=2.5 / 3600.0)
        assert straight.reported_deg(200.0, 0.0, told) == pytest.approx((200.0, raised_deg), abs=2.5 / 3600.0)
        assert straight.own_deg(200.0, 0.0, AT) == pytest.approx((0.0, 0.0), abs=1e-9)
        straight.adds_air = False
        assert straight.own_deg(200.0, 0.0, told) == (0.0, 0.0)

    @pytest.mark.parametrize("refracts", [False, True])
    @pytest.mark.parametrize("beyond_pole", [False, True])
    @pytest.mark.parametrize(
        ("ra_deg", "dec_deg"), [(170.0, 30.0), (359.999, 60.0), (10.0, 80.0), (250.0, -20.0)]
    )
    def test_what_is_reported_is_where_the_telescope_looks_and_back(
        self, ra_deg: float, dec_deg: float, refracts: bool, beyond_pole: bool
    ) -> None:
        beside = aim(IH=700.0, ID=-900.0, CH=600.0, ME=400.0)
        at = MountInstant(NOW, 200.0, refracts, beyond_pole)
        told = beside.reported_deg(ra_deg, dec_deg, at)
        assert told != pytest.approx((ra_deg, dec_deg), abs=0.05)
        assert told != pytest.approx(
            beside.reported_deg(ra_deg, dec_deg, at._replace(beyond_pole=not beyond_pole))
        )
        sample = StatusSample(0, NOW, 200.0 / 15.0, *told, False, refracts, 0.0, 0.0, beyond_pole)
        assert beside.looks_at_deg(sample) == pytest.approx((ra_deg, dec_deg), abs=1e-4)

    @pytest.mark.parametrize("reports", ["axes", "sky"])
    def test_a_mount_that_tells_its_axes_alone_is_led_by_our_clock_and_through_the_air(
        self, reports: Any
    ) -> None:
        """Others by their own clock, an hour behind here. Sidereal time and azimuths are ERFA's."""
        import erfa

        # The first axis points to the zenith, and its angles are azimuths from south.
        geometry = AxisGeometry(0.0, 90.0, reports=reports)
        profile = MountProfile(geometry=geometry, stands_at=SitePlace(50.0, LONGITUDE))
        led, by_axes = Aim(profile, Site(50.0, LONGITUDE)), reports == "axes"
        day = 2440587.5 + NOW / 86400.0
        ours_deg = float(np.degrees(erfa.gst06a(day, 0.0, day + 69.184 / 86400.0, 0.0))) + LONGITUDE
        theirs = MountInstant(NOW, ours_deg - 15.0, refracts=True)
        hour_angle = math.radians(40.0 if by_axes else 25.0)
        azimuth, altitude = erfa.hd2ae(hour_angle, math.radians(30.0), math.radians(50.0))
        angles = math.degrees(azimuth) - 180.0, math.degrees(altitude)
        ra_deg = ours_deg - 40.0
        assert led.own_deg(ra_deg, 30.0, theirs) == pytest.approx(angles, abs=0.02)
        assert led.sky_deg(*angles, theirs) == pytest.approx((ra_deg % 360.0, 30.0), abs=0.02)
        # A mount that tells directions is fed them as they are.
        airless, fed = (led.own_deg(ours_deg, 0.0, theirs._replace(refracts=one)) for one in (True, False))
        assert (fed[1] - airless[1]) * 3600.0 == pytest.approx(1.19 * 57.2 if by_axes else 0.0, abs=2.5)


def place(utc_s: float) -> tuple[float, float]:
    """An axis that turns by 0.2°/s through half a turn, another by -0.1°/s."""
    return wrap180(179.0 + 0.2 * (utc_s - NOW)), 30.0 - 0.1 * (utc_s - NOW)


class Led:
    def __init__(self) -> None:
        self.clock = MountSidereal(LONGITUDE)
        note(self.clock, 3.0)
        self.followed: list[float] = []
        follower: Any = SimpleNamespace(follow=self.follow)
        self.lead = Lead(place, self.clock, follower, NOW, 240.0)

    def follow(self, now_utc_s: float, target: object) -> MoveAxes:
        self.followed.append(now_utc_s)
        return MoveAxes(1.0, 2.0)

    def sample(self, utc_s: float, off_arcsec: float = 0.0) -> StatusSample:
        """The mount on its direction, but for so much in declination."""
        at = self.lead.state_at(utc_s)
        dec_deg = at.dec_deg + off_arcsec / 3600.0
        sidereal_h = self.clock.at(utc_s) % 360.0 / 15.0
        return StatusSample(0, utc_s, sidereal_h, at.ra_deg, dec_deg, False, False, 0.0, 0.0)


def safety(there: bool, last: bool) -> Any:
    return SimpleNamespace(led_there=there, on_last_leg=last)


class TestLead:
    @pytest.mark.parametrize("after_s", [0.0, 4.9, 5.0, 20.0])
    def test_a_direction_is_a_place_of_the_axes_and_their_rates(self, after_s: float) -> None:
        led = Led()
        state = led.lead.state_at(NOW + after_s)
        first = 179.0 + 0.2 * after_s
        assert wrap180(led.clock.at(NOW + after_s) - state.ra_deg - first) == pytest.approx(0.0, abs=1e-6)
        assert state.dec_deg == pytest.approx(30.0 - 0.1 * after_s)
        assert state.ra_rate_deg_s == pytest.approx(SIDEREAL_RATE_DEG_S - 0.2, abs=1e-6)
        assert state.dec_rate_deg_s == pytest.approx(-0.1, abs=1e-6)
        assert 0.0 <= state.ra_deg < 360.0

    @pytest.mark.parametrize("stands", [(100.0, 28.0), (170.0, -20.0), (-170.0, 30.0)])
    def test_it_ends_where_the_direction_is_by_then(self, stands: tuple[float, float]) -> None:
        led, profile = Led(), MountProfile()
        sidereal_deg = led.clock.at(NOW) % 360.0
        sample = StatusSample(
            0, NOW, sidereal_deg / 15.0, (sidereal_deg - stands[0]) % 360.0, stands[1], False, False, 0.0, 0.0
        )
        goal = led.lead.goal(sample, profile, NOW)
        # Bisected here: the instant at which the slew to where the direction then is comes to its end.
        early, late_s = 0.0, 400.0
        while late_s - early > 1e-9:
            middle = 0.5 * (early + late_s)
            first, second = place(NOW + middle)
            takes_s = max(
                slew_time_s(wrap180(first - stands[0]), profile.ra),
                slew_time_s(second - stands[1], profile.dec),
            )
            early, late_s = (middle, late_s) if takes_s > middle else (early, middle)
        first, second = place(NOW + early)
        assert goal.dec_deg == pytest.approx(second, abs=0.02)
        ra_deg = led.clock.at(NOW + early) - first
        assert wrap180(goal.ra_deg - ra_deg) == pytest.approx(0.0, abs=0.02)
        assert 0.0 <= goal.ra_deg < 360.0

    def test_legs_are_led_one_after_the_other_and_then_it_follows(self) -> None:
        led = Led()
        led.lead.legs = [Slew(1.0, 2.0), Slew(3.0, 4.0)]
        assert led.lead.wanted(safety(False, True), NOW) == Slew(1.0, 2.0)
        assert led.lead.wanted(safety(True, False), NOW) == Slew(1.0, 2.0)
        assert led.lead.wanted(safety(True, True), NOW) == Slew(3.0, 4.0)
        assert led.followed == []
        assert led.lead.wanted(safety(True, True), NOW + 7.0) == MoveAxes(1.0, 2.0)
        assert led.followed == [NOW + 7.0]

    @pytest.mark.parametrize(
        ("waited_s", "off_arcsec", "near"),
        [
            (1.0, 1.9, True),
            (1.9, 2.1, False),
            (2.1, 9.9, True),
            (2.1, 10.1, False),
            (9.9, 10.1, False),
            (10.1, 179.0, True),
            (10.1, 181.0, False),
        ],
    )
    def test_it_has_arrived_after_five_samples_near_enough(
        self, waited_s: float, off_arcsec: float, near: bool
    ) -> None:
        led = Led()
        for _ in range(10):
            led.lead.see(led.sample(NOW), NOW)
        assert led.lead.arrived is False
        led.lead.wanted(safety(False, False), NOW)
        utc_s = NOW + waited_s
        for _ in range(4):
            led.lead.see(led.sample(utc_s, off_arcsec), utc_s)
            assert led.lead.arrived is False
        led.lead.see(led.sample(utc_s, off_arcsec), utc_s)
        assert led.lead.arrived is near
        led.lead.see(led.sample(utc_s, 400.0), utc_s)
        assert led.lead.arrived is False
        # What was near before counts no more.
        for _ in range(4):
            led.lead.see(led.sample(utc_s), utc_s)
            assert led.lead.arrived is False
        led.lead.see(led.sample(utc_s), utc_s)
        assert led.lead.arrived is True

    def test_it_is_given_up_after_its_time(self) -> None:
        led = Led()
        assert led.lead.overdue(NOW + 239.0) is False
        assert led.lead.overdue(NOW + 241.0) is True
        led.lead.wanted(safety(False, False), NOW)
        for _ in range(5):
            led.lead.see(led.sample(NOW), NOW)
        assert led.lead.overdue(NOW + 241.0) is False
