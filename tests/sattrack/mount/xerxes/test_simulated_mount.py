"""The mount's end of the Xerxes protocol and the two axes behind it, commanded datagram by datagram.

Source: Van Deventer, "Xerxes Mount Control Protocol": Details (rising edge, acknowledgement, priority), both
tables and Theory of Operation (the mailbox). The motion is held against closed forms of constant
acceleration, the coordinates against ERFA.
"""

from __future__ import annotations

import itertools
import math
from typing import Any, Literal, NamedTuple

import erfa
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from xerxes_builders import (
    PERIOD_S,
    SIDEREAL_DEG_S,
    SIDEREAL_DTICS_S,
    T0,
    TIC_DEG,
    dtics,
    overwritten,
    spoilt,
    trapezoid_s,
    turned,
)

from sattrack.mount.model import AxisLimits, MountProfile, Status
from sattrack.mount.simulator.mount import SimulatedMount, SimulatedSite, StartPosition, Truth
from sattrack.mount.xerxes.datagrams import Command, decode_status, encode_command, status_readings

SITE = SimulatedSite(48.0, 11.0, 520.0)
START = StartPosition(-30.0, 20.0)
SLOW = MountProfile(ra=AxisLimits(4.0, 1.0, 4.0), dec=AxisLimits(3.0, 0.75, 3.0))
"""Acceleration so small that a ramp lasts many periods."""
SETTLING_S = 0.5
"""What a servo may need beyond the motion's closed form."""


class Seen(NamedTuple):
    """One turn of the mount's loop, from outside and from inside."""

    status: Status
    truth: Truth
    data: bytes


class Bench:
    """A mount on the bench: `put` fills its mailbox, `turn` runs its loop."""

    def __init__(
        self,
        profile: MountProfile | None = None,
        site: SimulatedSite = SITE,
        start: StartPosition = START,
        now: float = T0,
    ) -> None:
        self.profile = profile or MountProfile()
        self.mount = SimulatedMount(self.profile, site, start)
        self.now = now
        self.sent = 0
        self.seen = self.turn()

    def put(self, **fields: Any) -> None:
        self.sent += 1
        assert self.mount.receive(encode_command(Command(counter=self.sent, **fields)))

    def turn(self, period_s: float = PERIOD_S) -> Seen:
        self.now += period_s
        data, truth = self.mount.tick(self.now)
        self.seen = Seen(decode_status(data), truth, data)
        return self.seen

    def obeys(self, **fields: Any) -> Seen:
        self.put(**fields)
        return self.turn()

    def run(self, seconds: float, **fields: Any) -> list[Seen]:
        """Send the same every period, as the paper's client does."""
        return [self.obeys(**fields) for _ in range(round(seconds / PERIOD_S))]

    def coast(self, seconds: float) -> list[Seen]:
        """Send nothing at all."""
        return [self.turn() for _ in range(round(seconds / PERIOD_S))]

    def target(self, east_deg: float, north_deg: float) -> dict[str, Any]:
        """Fields of a target, right ascension and declination from where the mount is."""
        ra_deg, dec_deg = self.seen.truth.ra_deg + east_deg, self.seen.truth.dec_deg + north_deg
        return {"target_ra_h": ra_deg % 360.0 / 15.0, "target_dec_deg": dec_deg}

    def on_the_sky(self) -> bool:
        return abs(self.seen.truth.ra_rate_deg_s) < 1e-4 and abs(self.seen.truth.dec_rate_deg_s) < 1e-4

    def at_rest(self) -> bool:
        """Axes still: the reported right ascension drifts with the sky."""
        truth = self.seen.truth
        return abs(truth.ra_rate_deg_s - SIDEREAL_DEG_S) < 1e-4 and abs(truth.dec_rate_deg_s) < 1e-4

    def off_target_deg(self, target: dict[str, Any]) -> float:
        ra: float = turned(self.seen.truth.ra_deg - target["target_ra_h"] * 15.0)
        dec: float = self.seen.truth.dec_deg - target["target_dec_deg"]
        return max(abs(ra), abs(dec))


@pytest.fixture
def bench() -> Bench:
    """A mount that has tracked the sky for a second."""
    bench = Bench()
    bench.run(1.0)
    return bench


def moving(ra: float, dec: float) -> dict[str, Any]:
    return {"move_ra": True, "move_dec": True, "move_ra_rate_deg_s": ra, "move_dec_rate_deg_s": dec}


def distance_gone(start: Seen, end: Seen) -> tuple[float, float]:
    """Degrees of right ascension and declination between two turns."""
    return turned(end.truth.ra_deg - start.truth.ra_deg), end.truth.dec_deg - start.truth.dec_deg


class TestStatus:
    def test_header_length_and_flags(self, bench: Bench) -> None:
        data = bench.seen.data
        assert len(data) == 160
        assert data[:8] == b"XERXESxx"
        assert data[136:147] == bytes.fromhex("00 00 FF 00 00 00 00 00 FF 00 00")
        assert data[147] == 0
        assert data[155:159] == bytes(4)

    def test_types_are_those_of_appendix_a(self, bench: Bench) -> None:
        readings = status_readings(bench.seen.data)
        assert readings.ra_rate_dtics_s == "int64"
        assert readings.dec_rate_dtics_s in ("int64", None)
        assert readings.counter == "int64"

    def test_the_counter_rises_by_one_a_turn(self) -> None:
        bench = Bench()
        counters = [seen.status.counter for seen in bench.coast(5.0)]
        assert counters == list(range(counters[0], counters[0] + 100))
        assert bench.seen.truth.counter == counters[-1]

    def test_site_and_guide_rates(self) -> None:
        status = Bench(site=SimulatedSite(-33.5, -70.75, 2400.0)).seen.status
        assert (status.site_latitude_deg, status.site_longitude_deg, status.site_height_m) == (
            -33.5,
            -70.75,
            2400.0,
        )
        assert (status.ra_guide_rate_dtics_s, status.dec_guide_rate_dtics_s) == (3500, 3500)

    @pytest.mark.parametrize("hour_angle_deg", [-60.0, 0.0, 45.0])
    @pytest.mark.parametrize("dec_deg", [-20.0, 0.0, 75.0])
    def test_it_wakes_where_it_stands(self, hour_angle_deg: float, dec_deg: float) -> None:
        status = Bench(start=StartPosition(hour_angle_deg, dec_deg)).seen.status
        assert turned((status.sidereal_h - status.ra_h) * 15) == pytest.approx(hour_angle_deg, abs=1e-3)
        assert status.dec_deg == pytest.approx(dec_deg, abs=1.01 * TIC_DEG)

    @pytest.mark.parametrize("latitude_deg", [-33.5, 0.0, 48.0, 80.0])
    @pytest.mark.parametrize(
        ("hour_angle_deg", "dec_deg"), [(-75.0, 10.0), (-5.0, -20.0), (30.0, 60.0), (170.0, 85.0)]
    )
    def test_altitude_and_azimuth(self, latitude_deg: float, hour_angle_deg: float, dec_deg: float) -> None:
        bench = Bench(
            site=SimulatedSite(latitude_deg, 11.0, 0.0), start=StartPosition(hour_angle_deg, dec_deg)
        )
        for seen in bench.run(1.0, **moving(1.0, 0.5)):
            status = seen.status
            hour_angle = math.radians((status.sidereal_h - status.ra_h) * 15)
            azimuth, altitude = erfa.hd2ae(
                hour_angle, math.radians(status.dec_deg), math.radians(latitude_deg)
            )
            assert status.altitude_deg == pytest.approx(math.degrees(altitude), abs=3 * TIC_DEG)
            assert 0.0 <= status.azimuth_deg < 360.0
            off = turned(status.azimuth_deg - math.degrees(azimuth)) * math.cos(altitude)
            assert off == pytest.approx(0.0, abs=3 * TIC_DEG)

    def test_status_agrees_with_the_axes_to_an_encoder_tic(self, bench: Bench) -> None:
        for seen in bench.run(3.0, **moving(2.0, -1.5)):
            assert turned(seen.status.ra_h * 15 - seen.truth.ra_deg) == pytest.approx(0.0, abs=1.01 * TIC_DEG)
            assert seen.status.dec_deg == pytest.approx(seen.truth.dec_deg, abs=1.01 * TIC_DEG)
            assert seen.truth.utc_s == pytest.approx(bench.now, abs=10.0)

    def test_the_position_comes_in_encoder_tics(self, bench: Bench) -> None:
        tics = [seen.status.dec_deg / TIC_DEG for seen in bench.run(2.0, **moving(0.1, 0.37))]
        assert [abs(tic - round(tic)) < 1e-3 for tic in tics] == [True] * len(tics)
        assert len({round(tic) for tic in tics}) == len(tics)


class TestClock:
    @pytest.mark.parametrize("longitude_deg", [-111.75, 0.0, 11.0, 170.0])
    def test_sidereal_time_is_local_and_east_positive(self, longitude_deg: float) -> None:
        bench = Bench(site=SimulatedSite(48.0, longitude_deg, 0.0))
        day, fraction = divmod(bench.now / 86400.0, 1.0)
        greenwich = erfa.gmst82(2440587.5 + day, fraction)
        expected = math.degrees(greenwich) + longitude_deg
        assert turned(bench.seen.status.sidereal_h * 15 - expected) == pytest.approx(0.0, abs=20 / 3600)

    def test_it_runs_at_the_sidereal_rate_and_stays_within_a_day(self) -> None:
        hours = [Bench(now=T0 + 600.0 * turn).seen.status.sidereal_h for turn in range(300)]
        assert all(0.0 <= hour < 24.0 for hour in hours)
        assert (min(hours) < 0.2, max(hours) > 23.8) == (True, True)
        for before, after in itertools.pairwise(hours):
            assert (after - before) % 24.0 * 15 == pytest.approx(600.0 * SIDEREAL_DEG_S, abs=1e-6)

    def test_a_running_clock_keeps_the_rate(self, bench: Bench) -> None:
        start = bench.seen
        end = bench.run(100.0)[-1]
        elapsed = end.truth.utc_s - start.truth.utc_s
        gone_deg = (end.status.sidereal_h - start.status.sidereal_h) % 24.0 * 15
        assert gone_deg == pytest.approx(elapsed * SIDEREAL_DEG_S, abs=1e-8)

    def test_right_ascension_stays_within_a_day(self) -> None:
        bench = Bench(MountProfile(hour_angle_limit_deg=600.0))
        seen = bench.run(80.0, **moving(6.0, 0.0))
        assert all(0.0 <= s.status.ra_h <= 24.0 for s in seen)
        assert {int(s.status.ra_h) for s in seen} == set(range(24))


class TestTracking:
    def test_it_holds_the_sky_by_itself(self, bench: Bench) -> None:
        start = bench.seen
        for seen in bench.coast(60.0):
            ra, dec = distance_gone(start, seen)
            assert ra == pytest.approx(0.0, abs=2e-5)
            assert dec == pytest.approx(0.0, abs=1e-6)
            assert seen.status.ra_rate_dtics_s == pytest.approx(SIDEREAL_DTICS_S, abs=2)
            assert seen.status.dec_rate_dtics_s == 0
            assert (seen.status.slewing, seen.status.tracking) == (False, True)

    def test_an_imprecise_timer_changes_nothing(self, bench: Bench) -> None:
        """The paper: "approximately, as the Windows forms timer is imprecise"."""
        start = bench.seen
        for turn in range(400):
            bench.turn((0.03, 0.08, 0.05, 0.002, 0.3)[turn % 5])
            assert bench.on_the_sky()
        assert distance_gone(start, bench.seen) == pytest.approx((0.0, 0.0), abs=2e-5)

    def test_two_turns_at_one_instant(self, bench: Bench) -> None:
        first = bench.seen
        second = bench.turn(0.0)
        assert second.status.counter == first.status.counter + 1
        assert distance_gone(first, second) == pytest.approx((0.0, 0.0), abs=1e-9)

    def test_the_same_inputs_give_the_same_bytes(self) -> None:
        benches = (Bench(), Bench())
        for fields in ({}, moving(1.0, -1.0), {}, {"slew": True, "target_ra_h": 10.0}, {"abort": True}):
            first, second = (bench.run(1.0, **fields) for bench in benches)
            assert [seen.data for seen in first] == [seen.data for seen in second]


class TestSlew:
    def test_the_acknowledgement_follows_the_flag_and_slewing_the_motion(self, bench: Bench) -> None:
        target = bench.target(5.0, 4.0)
        for seen in bench.run(0.2, slew=True, **target):
            assert (seen.status.ack_slew, seen.status.slewing) == (True, True)
            assert seen.status.target_ra_h == target["target_ra_h"]
            assert seen.status.target_dec_deg == target["target_dec_deg"]
        for seen in bench.run(0.2):
            assert (seen.status.ack_slew, seen.status.slewing) == (False, True)
        for seen in bench.run(5.0):
            assert not seen.status.ack_slew
        assert not bench.seen.status.slewing

    @pytest.mark.parametrize(
        ("east_deg", "north_deg"), [(5.0, 4.0), (-40.0, 0.0), (0.0, -30.0), (50.0, 35.0), (0.01, 0.02)]
    )
    @pytest.mark.parametrize("profile", [MountProfile(), SLOW], ids=["quick", "slow"])
    def test_it_arrives_in_time_and_follows_the_sky(
        self, east_deg: float, north_deg: float, profile: MountProfile
    ) -> None:
        bench = Bench(profile)
        bench.run(1.0)
        target = bench.target(east_deg, north_deg)
        axes = ((abs(east_deg), profile.ra), (abs(north_deg), profile.dec))
        shortest_s = max(trapezoid_s(d, a.slew_rate_deg_s, a.max_acceleration_deg_s2) for d, a in axes)
        longest_s = max(trapezoid_s(d, a.slew_rate_deg_s, a.max_acceleration_deg_s2 / 2) for d, a in axes)
        launched = bench.now
        bench.obeys(slew=True, **target)
        while bench.obeys().status.slewing:
            assert bench.now - launched < longest_s * 1.02 + SETTLING_S
        assert bench.now - launched > shortest_s * 0.97 - PERIOD_S
        assert bench.off_target_deg(target) < 2e-3
        bench.run(SETTLING_S)
        for _ in range(100):
            bench.obeys()
            assert bench.off_target_deg(target) < 1e-4
            assert bench.on_the_sky()

    def test_it_ends_within_encoder_tics(self, bench: Bench) -> None:
        target = bench.target(5.0, -4.0)
        bench.obeys(slew=True, **target)
        bench.run(10.0)
        assert bench.off_target_deg(target) < 3 * TIC_DEG

    @pytest.mark.parametrize("profile", [MountProfile(), SLOW], ids=["quick", "slow"])
    def test_it_keeps_within_rate_and_acceleration(self, profile: MountProfile) -> None:
        bench = Bench(profile)
        bench.run(1.0)
        before = bench.seen
        fastest = [0.0, 0.0]
        bench.put(slew=True, **bench.target(45.0, 35.0))
        while bench.turn().status.slewing:
            now = bench.seen
            rates = (now.truth.ra_rate_deg_s - SIDEREAL_DEG_S, now.truth.dec_rate_deg_s)
            rates_before = (before.truth.ra_rate_deg_s - SIDEREAL_DEG_S, before.truth.dec_rate_deg_s)
            for i, limits in enumerate((profile.ra, profile.dec)):
                fastest[i] = max(fastest[i], abs(rates[i]))
                assert abs(rates[i] - rates_before[i]) / PERIOD_S <= limits.max_acceleration_deg_s2 * 1.05
            before = now
        assert fastest[0] == pytest.approx(profile.ra.slew_rate_deg_s, rel=0.03)
        assert fastest[1] == pytest.approx(profile.dec.slew_rate_deg_s, rel=0.03)

    @pytest.mark.parametrize("edge", [True, False])
    def test_only_the_rising_edge_launches(self, bench: Bench, edge: bool) -> None:
        first = bench.target(1.0, 1.0)
        bench.run(4.0, slew=True, **first)
        assert not bench.seen.status.slewing
        assert bench.seen.status.ack_slew
        second = bench.target(3.0, -2.0)
        if edge:
            bench.obeys()
        bench.run(4.0, slew=True, **second)
        assert bench.off_target_deg(second if edge else first) < 1e-4

    def test_a_target_changed_under_the_flag_is_not_followed(self, bench: Bench) -> None:
        first = bench.target(4.0, 3.0)
        bench.obeys(slew=True, **first)
        bench.run(5.0, slew=True, **bench.target(-4.0, -3.0))
        assert bench.off_target_deg(first) < 1e-4

    def test_a_second_edge_is_ignored_while_slewing(self, bench: Bench) -> None:
        first = bench.target(20.0, 10.0)
        bench.obeys(slew=True, **first)
        bench.run(0.5)
        bench.run(0.2, slew=True, **bench.target(-20.0, -10.0))
        bench.run(6.0)
        assert not bench.seen.status.slewing
        assert bench.off_target_deg(first) < 1e-4

    def test_a_late_copy_is_a_second_edge(self, bench: Bench) -> None:
        """The mount ignores the counter."""
        target = bench.target(2.0, 2.0)
        copy = encode_command(Command(counter=1, slew=True, **target))
        bench.mount.receive(copy)
        bench.turn()
        bench.run(4.0)
        bench.run(1.0, **moving(2.0, 0.0))
        bench.run(1.0)
        assert bench.off_target_deg(target) > 0.5
        bench.mount.receive(copy)
        assert bench.turn().status.slewing
        bench.run(4.0)
        assert bench.off_target_deg(target) < 1e-4

    def test_it_is_ignored_during_moveaxis(self, bench: Bench) -> None:
        bench.run(1.0, **moving(1.0, 0.5))
        bench.run(1.0, slew=True, **bench.target(-20.0, -10.0), **moving(1.0, 0.5))
        assert bench.seen.truth.ra_rate_deg_s == pytest.approx(-1.0, abs=1e-3)
        assert bench.seen.truth.dec_rate_deg_s == pytest.approx(0.5, abs=1e-3)

    def test_it_takes_the_short_way_through_0_h(self) -> None:
        bench = Bench()
        start = StartPosition(bench.seen.status.sidereal_h * 15 - 359.0, 20.0)
        bench = Bench(start=start)
        assert bench.seen.status.ra_h * 15 == pytest.approx(359.0, abs=0.01)
        bench.obeys(slew=True, target_ra_h=2.0 / 15, target_dec_deg=20.0)
        bench.run(trapezoid_s(3.0, 10.0, 10.0) + SETTLING_S)
        assert not bench.seen.status.slewing
        assert bench.seen.status.ra_h * 15 == pytest.approx(2.0, abs=1e-3)

    @pytest.mark.parametrize(
        ("ra_h", "dec_deg"),
        [
            (math.nan, 20.0),
            (math.inf, 20.0),
            (25.0, 20.0),
            (-1.0, 20.0),
            (10.0, 91.0),
            (10.0, -91.0),
            (10.0, math.nan),
        ],
    )
    def test_an_impossible_target_moves_nothing(self, bench: Bench, ra_h: float, dec_deg: float) -> None:
        """The paper: "verify RA is 0 to 24 and dec is -90 to 90"."""
        start = bench.seen
        command = Command(slew=True, target_ra_h=ra_h, target_dec_deg=dec_deg)
        bench.mount.receive(encode_command(command))
        bench.coast(2.0)
        assert distance_gone(start, bench.seen) == pytest.approx((0.0, 0.0), abs=1e-4)
        assert not bench.seen.status.slewing


class TestMoveAxis:
    @pytest.mark.parametrize("ra_sign", [-1, 1])
    @pytest.mark.parametrize("dec_sign", [-1, 1])
    @pytest.mark.parametrize("additive", [True, False])
    def test_signs_and_additivity_follow_the_profile(
        self, ra_sign: Literal[-1, 1], dec_sign: Literal[-1, 1], additive: bool
    ) -> None:
        bench = Bench(MountProfile(ra_rate_sign=ra_sign, dec_rate_sign=dec_sign, additive=additive))
        bench.run(2.0, **moving(0.8, 0.6))
        drive = ra_sign * 0.8 + (SIDEREAL_DEG_S if additive else 0.0)
        assert bench.seen.truth.ra_rate_deg_s == pytest.approx(SIDEREAL_DEG_S - drive, abs=1e-5)
        assert bench.seen.truth.dec_rate_deg_s == pytest.approx(dec_sign * 0.6, abs=1e-5)
        assert bench.seen.status.ra_rate_dtics_s == pytest.approx(dtics(drive), abs=20)
        assert bench.seen.status.dec_rate_dtics_s == pytest.approx(dtics(dec_sign * 0.6), abs=20)

    @pytest.mark.parametrize("ra", [True, False])
    @pytest.mark.parametrize("dec", [True, False])
    def test_each_axis_has_its_own_flag(self, bench: Bench, ra: bool, dec: bool) -> None:
        for seen in bench.run(2.0, **{**moving(0.8, 0.6), "move_ra": ra, "move_dec": dec}):
            assert (seen.status.ack_move_ra, seen.status.ack_move_dec) == (ra, dec)
            assert seen.status.slewing is (ra or dec)
        assert bench.seen.truth.ra_rate_deg_s == pytest.approx(-0.8 if ra else 0.0, abs=1e-5)
        assert bench.seen.truth.dec_rate_deg_s == pytest.approx(0.6 if dec else 0.0, abs=1e-5)

    def test_one_axis_alone_leaves_the_other_on_the_sky_where_rates_are_absolute(self) -> None:
        bench = Bench(MountProfile(additive=False))
        bench.run(2.0, **{**moving(0.8, 0.6), "move_ra": False})
        assert bench.seen.truth.ra_rate_deg_s == pytest.approx(0.0, abs=1e-5)
        assert bench.seen.truth.dec_rate_deg_s == pytest.approx(0.6, abs=1e-5)

    def test_the_latest_rates_act_while_the_flag_is_up(self, bench: Bench) -> None:
        for ra, dec in ((1.0, 0.5), (-2.0, 0.25), (0.0, 0.0), (0.3, -3.0)):
            bench.run(2.0, **moving(ra, dec))
            assert bench.seen.truth.ra_rate_deg_s == pytest.approx(-ra, abs=1e-5)
            assert bench.seen.truth.dec_rate_deg_s == pytest.approx(dec, abs=1e-5)
            assert bench.seen.status.slewing

    def test_the_last_rate_is_held_for_ever_when_the_link_is_lost(self, bench: Bench) -> None:
        bench.run(2.0, **moving(0.1, 0.05))
        start = bench.seen
        bench.coast(120.0)
        assert distance_gone(start, bench.seen) == pytest.approx((-12.0, 6.0), abs=1e-4)

    def test_a_long_turn_covers_the_same_way(self, bench: Bench) -> None:
        bench.run(2.0, **moving(1.0, -0.5))
        start = bench.seen
        assert distance_gone(start, bench.turn(7.0)) == pytest.approx((-7.0, -3.5), abs=1e-4)

    def test_falling_flags_give_the_sky_back(self, bench: Bench) -> None:
        bench.run(2.0, **moving(2.0, -1.0))
        seen = bench.obeys()
        assert (seen.status.ack_move_ra, seen.status.ack_move_dec) == (False, False)
        bench.run(2.0 / 10 + SETTLING_S)
        assert bench.on_the_sky()
        assert not bench.seen.status.slewing
        start = bench.seen
        bench.run(5.0)
        assert distance_gone(start, bench.seen) == pytest.approx((0.0, 0.0), abs=1e-5)

    @pytest.mark.parametrize("rate", [-4.0, -1.0, 2.0, 4.0])
    def test_a_ramp_is_one_of_constant_acceleration(self, rate: float) -> None:
        bench = Bench(SLOW)
        bench.run(1.0)
        wanted = moving(rate, rate / 2)
        start = bench.obeys(**wanted)
        began = bench.now
        ramp_s = abs(rate) / SLOW.ra.max_acceleration_deg_s2
        dec_ramp_s = abs(rate / 2) / SLOW.dec.max_acceleration_deg_s2
        seen = [(now.truth.utc_s - began, now) for now in bench.run(ramp_s + 2.0, **wanted)]
        for elapsed, now in seen:
            ra_rate, dec_rate = now.truth.ra_rate_deg_s, now.truth.dec_rate_deg_s
            expected = -rate * min(elapsed / ramp_s, 1.0)
            assert ra_rate == pytest.approx(expected, abs=SLOW.ra.max_acceleration_deg_s2 * PERIOD_S)
            expected = rate / 2 * min(elapsed / dec_ramp_s, 1.0)
            assert dec_rate == pytest.approx(expected, abs=SLOW.dec.max_acceleration_deg_s2 * PERIOD_S)
        elapsed, end = seen[-1]
        ra, dec = distance_gone(start, end)
        assert ra == pytest.approx(-rate * (elapsed - ramp_s / 2), abs=abs(rate) * PERIOD_S)
        assert dec == pytest.approx(rate / 2 * (elapsed - dec_ramp_s / 2), abs=abs(rate) * PERIOD_S)

    def test_a_steady_rate_has_no_lag_in_rate(self, bench: Bench) -> None:
        bench.run(3.0, **moving(1.35, -0.7))
        start = bench.seen
        seen = bench.run(20.0, **moving(1.35, -0.7))
        for now in seen:
            assert now.truth.ra_rate_deg_s == pytest.approx(-1.35, abs=1e-8)
            assert now.truth.dec_rate_deg_s == pytest.approx(-0.7, abs=1e-8)
        elapsed = seen[-1].truth.utc_s - start.truth.utc_s
        assert distance_gone(start, seen[-1]) == pytest.approx((-1.35 * elapsed, -0.7 * elapsed), abs=1e-6)

    @pytest.mark.parametrize("rate", [50.0, -50.0, 1e300])
    def test_no_rate_takes_an_axis_beyond_its_limits(self, rate: float) -> None:
        bench = Bench(SLOW)
        seen = bench.run(8.0, **moving(rate, rate))
        ra = [abs(s.truth.ra_rate_deg_s - SIDEREAL_DEG_S) for s in seen]
        dec = [abs(s.truth.dec_rate_deg_s) for s in seen]
        assert max(ra) == pytest.approx(4.0, rel=0.03)
        assert max(dec) == pytest.approx(3.0, rel=0.03)

    @pytest.mark.parametrize("rate", [math.nan, math.inf, -math.inf])
    def test_a_rate_that_is_no_number_moves_nothing(self, bench: Bench, rate: float) -> None:
        start = bench.seen
        bench.mount.receive(encode_command(Command(**moving(rate, rate))))
        bench.coast(2.0)
        bench.run(2.0)
        assert distance_gone(start, bench.seen) == pytest.approx((0.0, 0.0), abs=1e-4)
        assert bench.on_the_sky()


class TestAbort:
    @pytest.mark.parametrize("profile", [MountProfile(), SLOW], ids=["quick", "slow"])
    @pytest.mark.parametrize("doing", ["slew", "move"])
    def test_it_slows_down_and_stops(self, profile: MountProfile, doing: str) -> None:
        bench = Bench(profile)
        if doing == "slew":
            bench.obeys(slew=True, **bench.target(45.0, 40.0))
            bench.run(3.0)
        else:
            bench.run(3.0, **moving(2.0, 2.0))
        start = bench.seen
        fastest = max(abs(start.truth.ra_rate_deg_s), abs(start.truth.dec_rate_deg_s))
        slowest = min(profile.ra.max_acceleration_deg_s2, profile.dec.max_acceleration_deg_s2)
        braking_s = fastest / slowest
        assert fastest > 1.0
        bench.run(0.1, abort=True)
        assert bench.seen.status.ack_abort
        ra, dec = distance_gone(start, bench.seen)
        assert max(abs(ra), abs(dec)) > 0.05
        bench.run(braking_s + SETTLING_S, abort=True)
        assert bench.at_rest()
        assert not bench.seen.status.slewing
        assert bench.seen.status.ra_rate_dtics_s == pytest.approx(0, abs=20)
        ra, dec = distance_gone(start, bench.seen)
        for gone, rate, limits in (
            (ra, start.truth.ra_rate_deg_s, profile.ra),
            (dec, start.truth.dec_rate_deg_s, profile.dec),
        ):
            braking_deg = rate**2 / limits.max_acceleration_deg_s2 / 2
            assert abs(gone) < braking_deg * 1.05 + abs(rate) * 4 * PERIOD_S + 0.03

    def test_the_acknowledgement_follows_the_flag_and_rest_outlasts_it(self, bench: Bench) -> None:
        bench.obeys(slew=True, **bench.target(45.0, 40.0))
        bench.run(1.0)
        for seen in bench.run(0.3, abort=True):
            assert seen.status.ack_abort
        for seen in bench.run(10.0):
            assert not seen.status.ack_abort
        assert bench.at_rest()

    def test_at_rest_the_sky_drifts_by(self, bench: Bench) -> None:
        bench.obeys(abort=True)
        bench.run(1.0)
        start = bench.seen
        bench.run(100.0)
        assert distance_gone(start, bench.seen) == pytest.approx((100 * SIDEREAL_DEG_S, 0.0), abs=1e-5)
        assert bench.seen.status.ra_rate_dtics_s == 0

    def test_it_outranks_all_others(self, bench: Bench) -> None:
        everything = {"slew": True, **bench.target(20.0, 10.0), **moving(2.0, 2.0)}
        seen = bench.run(2.0, abort=True, **everything)
        assert bench.at_rest()
        assert all(s.status.ack_abort for s in seen)
        assert not any(s.status.slewing for s in seen[10:])

    def test_it_outranks_what_comes_while_it_is_up(self, bench: Bench) -> None:
        bench.run(1.0, **moving(2.0, 2.0))
        bench.run(1.0, abort=True)
        bench.run(1.0, abort=True, **moving(2.0, 2.0))
        assert bench.at_rest()
        bench.run(1.0, abort=True, slew=True, **bench.target(20.0, 10.0))
        assert bench.at_rest()

    def test_a_second_edge_stops_a_second_motion(self, bench: Bench) -> None:
        for _ in range(3):
            bench.run(1.0, **moving(2.0, 2.0))
            assert not bench.at_rest()
            bench.obeys(abort=True)
            bench.run(1.0)
            assert bench.at_rest()

    def test_motion_resumes_after_it(self, bench: Bench) -> None:
        bench.obeys(abort=True)
        bench.run(1.0)
        target = bench.target(3.0, 2.0)
        bench.obeys(slew=True, **target)
        bench.run(3.0)
        assert bench.off_target_deg(target) < 1e-4
        assert bench.on_the_sky()
        bench.obeys(abort=True)
        bench.run(1.0)
        bench.run(1.0, **moving(0.5, 0.5))
        assert bench.seen.truth.ra_rate_deg_s == pytest.approx(-0.5, abs=1e-4)
        bench.run(1.0)
        assert bench.on_the_sky()


class TestMailbox:
    def test_only_the_latest_counts(self, bench: Bench) -> None:
        bench.put(slew=True, **bench.target(20.0, 10.0))
        bench.put()
        seen = bench.turn()
        assert (seen.status.slewing, seen.status.ack_slew) == (False, False)
        bench.put()
        bench.put(slew=True, **bench.target(20.0, 10.0))
        seen = bench.turn()
        assert (seen.status.slewing, seen.status.ack_slew) == (True, True)

    def test_an_edge_hidden_between_two_turns_is_none(self, bench: Bench) -> None:
        first = bench.target(1.0, 1.0)
        bench.run(3.0, slew=True, **first)
        bench.put()
        bench.put(slew=True, **bench.target(5.0, 5.0))
        bench.turn()
        bench.coast(3.0)
        assert bench.off_target_deg(first) < 1e-4


VALID_SLEW = encode_command(Command(counter=9, slew=True, target_ra_h=12.0, target_dec_deg=40.0))
VALID_MOVE = encode_command(Command(counter=9, **moving(1.0, 1.0)))


class TestNoise:
    @given(noise=st.lists(st.one_of(spoilt(VALID_SLEW), spoilt(VALID_MOVE)), min_size=1, max_size=8))
    @settings(max_examples=100, deadline=None)
    def test_what_is_no_command_is_counted_and_moves_nothing(self, noise: list[bytes]) -> None:
        bench = Bench()
        bench.run(0.5)
        start = bench.seen
        for data in noise:
            assert bench.mount.receive(data) is False
            assert bench.turn().status.slewing is False
        bench.coast(0.5)
        assert bench.mount.refused == len(noise)
        assert distance_gone(start, bench.seen) == pytest.approx((0.0, 0.0), abs=1e-5)

    def test_noise_leaves_the_mailbox_as_it_was(self, bench: Bench) -> None:
        bench.put(slew=True, **bench.target(20.0, 10.0))
        assert bench.mount.receive(VALID_MOVE[:-1]) is False
        assert bench.turn().status.ack_slew

    @given(
        datagrams=st.lists(
            st.one_of(overwritten(VALID_SLEW), overwritten(VALID_MOVE)), min_size=1, max_size=8
        )
    )
    @settings(max_examples=50, deadline=None)
    def test_any_body_leaves_a_sound_mount(self, datagrams: list[bytes]) -> None:
        """Whatever it was told, the axes stay within their limits and an abort brings them to rest."""
        bench = Bench()
        taken = 0
        for data in datagrams:
            taken += bench.mount.receive(data)
            for seen in bench.coast(0.2):
                assert len(seen.data) == 160
                assert 0.0 <= seen.status.ra_h <= 24.0
                assert -90.0 <= seen.status.dec_deg <= 90.0
                assert math.isfinite(
                    seen.status.altitude_deg + seen.status.azimuth_deg + seen.status.sidereal_h
                )
                assert abs(seen.truth.ra_rate_deg_s - SIDEREAL_DEG_S) < 10.3
                assert abs(seen.truth.dec_rate_deg_s) < 10.3
        assert taken + bench.mount.refused == len(datagrams)
        bench.run(0.1)
        # One that was parked meanwhile has friction alone to brake it.
        bench.run(4.0, abort=True)
        assert bench.at_rest()
