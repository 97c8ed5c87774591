"""A mount's sidereal clock in the mean, and how rates lead to a direction, by hand."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from sattrack.control.aim import Lead, MountSidereal
from sattrack.control.approach import slew_time_s
from sattrack.core.angles import wrap180
from sattrack.mount.model import (
    SIDEREAL_RATE_DEG_S,
    MountProfile,
    MoveAxes,
    Slew,
    StatusSample,
    mean_sidereal_deg,
)

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
    assert gap(clock) == pytest.approx(1.0 + 0.004 / 400.0, abs=1e-7)


def place(utc_s: float) -> tuple[float, float]:
    """An axis that turns by 0.2°/s through half a turn, another by -0.1°/s."""
    return wrap180(179.0 + 0.2 * (utc_s - NOW)), 30.0 - 0.1 * (utc_s - NOW)


class Led:
    def __init__(self) -> None:
        self.clock = MountSidereal(LONGITUDE)
        note(self.clock, 3.0)
        self.followed: list[float] = []
        follower: Any = SimpleNamespace(follow=self.follow)
        self.lead = Lead(place, self.clock, follower, NOW)

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

    def test_four_minutes_are_long_enough(self) -> None:
        led = Led()
        assert led.lead.overdue(NOW + 239.0) is False
        assert led.lead.overdue(NOW + 241.0) is True
        led.lead.wanted(safety(False, False), NOW)
        for _ in range(5):
            led.lead.see(led.sample(NOW), NOW)
        assert led.lead.overdue(NOW + 241.0) is False
