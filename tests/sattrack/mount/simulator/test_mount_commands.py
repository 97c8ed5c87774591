"""What the simulated mount does at each flag: the paper's sentences, and what is fixed where it is silent.

Source: Van Deventer, "Xerxes Mount Control Protocol". Rates and distances are held against products of rate
and time; the paper's numbers (2^26 tics, 3500 and 7789 tics per second x 10) are written out here.
"""

from __future__ import annotations

import itertools
from typing import Any

import pytest
from simulator_bench import GUIDE_DEG_S, SIDEREAL_DEG_S, START, T0, Bench, moving, turned

from sattrack.mount.model import AxesPosition, AxisLimits, MountProfile
from sattrack.mount.simulator.mount import StartPosition
from sattrack.mount.xerxes.datagrams import Command, decode_status, encode_command, status_readings

EDGE = MountProfile(move_axis="edge")
HOME = MountProfile(home=AxesPosition(10.0, 5.0))
EXACT = pytest.approx


def rates(bench: Bench, ra: float, dec: float) -> bool:
    """Whether the axes turn so, hour angle and declination, degrees per second."""
    return bench.axis_rates == EXACT((ra, dec), abs=1e-6)


class TestPriority:
    ORDER = ("abort", "park", "slew", "sync", "move_ra", "pulse_guide")

    def fields(self, bench: Bench, *names: str) -> dict[str, Any]:
        fields: dict[str, Any] = dict.fromkeys(names, True)
        return fields | {"move_ra_rate_deg_s": 0.5, "pulse_ra_ms": 2000} | bench.target(5.0, 5.0)

    @pytest.mark.parametrize(("higher", "lower"), list(itertools.combinations(ORDER, 2)))
    def test_the_higher_one_is_serviced_and_acknowledged_alone(self, higher: str, lower: str) -> None:
        """ "All active commands are examined and the highest priority command is serviced"."""
        bench = Bench()
        status = bench.obeys(**self.fields(bench, higher, lower)).status
        acks = {
            "abort": status.ack_abort,
            "slew": status.ack_slew,
            "sync": status.ack_sync,
            "move_ra": status.ack_move_ra,
            "pulse_guide": status.ack_pulse_guide,
        }
        assert [name for name, up in acks.items() if up] == ([] if higher == "park" else [higher])

    def test_the_lower_one_that_stays_up_is_serviced_when_the_higher_fell(self) -> None:
        bench = Bench()
        bench.run(0.5, abort=True, **moving(0.5, None))
        assert bench.axis_rates[0] == EXACT(0.0, abs=1e-9)
        bench.run(1.0, **moving(0.5, None))
        assert bench.status.ack_move_ra
        assert rates(bench, SIDEREAL_DEG_S + 0.5, 0.0)

    def test_one_that_an_abort_ended_does_not_begin_again_by_itself(self) -> None:
        bench = Bench()
        bench.run(1.0, **moving(0.5, None))
        bench.run(0.5, abort=True, **moving(0.5, None))
        bench.run(1.0, **moving(0.5, None))
        assert rates(bench, 0.0, 0.0)
        bench.run(0.1)
        bench.run(1.0, **moving(0.5, None))
        assert rates(bench, SIDEREAL_DEG_S + 0.5, 0.0)

    def test_each_acknowledgement_goes_with_its_own_flag(self) -> None:
        bench = Bench()
        bench.obeys(**moving(0.5, 0.5))
        status = bench.obeys(abort=True, **moving(0.5, None)).status
        assert (status.ack_abort, status.ack_move_ra, status.ack_move_dec) == (True, True, False)
        status = bench.obeys(**moving(0.5, None)).status
        assert (status.ack_abort, status.ack_move_ra) == (False, True)


class TestEdge:
    def test_rates_are_read_as_the_flag_rises_and_stay_after_its_fall(self) -> None:
        bench = Bench(EDGE)
        bench.obeys(**moving(0.5, -0.25))
        assert (bench.status.ack_move_ra, bench.status.ack_move_dec) == (True, True)
        bench.run(1.0, **moving(2.0, 2.0))
        assert rates(bench, SIDEREAL_DEG_S + 0.5, -0.25)
        bench.run(1.0)
        assert (bench.status.ack_move_ra, bench.status.ack_move_dec) == (False, False)
        assert bench.status.slewing
        assert rates(bench, SIDEREAL_DEG_S + 0.5, -0.25)

    def test_each_axis_has_its_own_edge(self) -> None:
        bench = Bench(EDGE)
        bench.run(0.5, **moving(0.5, None))
        bench.run(0.5, **moving(1.0, 0.75))
        assert rates(bench, SIDEREAL_DEG_S + 0.5, 0.75)

    def test_rate_0_gives_its_axis_back_to_the_sky(self) -> None:
        bench = Bench(EDGE)
        bench.obeys(**moving(0.5, 0.25))
        bench.run(0.5)
        bench.obeys(**moving(0.0, None))
        bench.run(0.5)
        assert rates(bench, SIDEREAL_DEG_S, 0.25)
        assert bench.status.slewing
        bench.obeys(**moving(None, 0.0))
        bench.run(0.5)
        assert rates(bench, SIDEREAL_DEG_S, 0.0)
        assert not bench.status.slewing

    def test_an_abort_ends_it(self) -> None:
        bench = Bench(EDGE)
        bench.obeys(**moving(0.5, 0.25))
        bench.run(0.5)
        bench.obeys(abort=True)
        bench.run(1.0)
        assert rates(bench, 0.0, 0.0)
        assert not bench.status.slewing

    def test_a_slew_is_ignored_while_rates_are_in_force(self) -> None:
        """ "Ignore if still slewing"."""
        bench = Bench(EDGE)
        bench.obeys(**moving(0.5, 0.25))
        bench.run(0.5)
        bench.run(2.0, slew=True, **bench.target(20.0, 10.0))
        assert rates(bench, SIDEREAL_DEG_S + 0.5, 0.25)


class TestMoveAxis:
    @pytest.mark.parametrize("how", ["held", "edge"])
    @pytest.mark.parametrize("additive", [True, False])
    def test_the_axis_moves_by_the_gain_times_the_rate(self, how: Any, additive: bool) -> None:
        profile = MountProfile(
            move_axis=how, additive=additive, ra_rate_gain=1.01, dec_rate_gain=0.98, dec_rate_sign=-1
        )
        bench = Bench(profile)
        bench.run(2.0, **moving(1.5, 1.0))
        assert rates(bench, 1.5 * 1.01 + (SIDEREAL_DEG_S if additive else 0.0), -0.98)

    @pytest.mark.parametrize(("dec_sign", "expected"), [(1, 1), (-1, -1), (None, -1)])
    def test_signs_beyond_the_pole_are_those_of_that_side(self, dec_sign: Any, expected: int) -> None:
        profile = MountProfile(
            ra_rate_sign=1, dec_rate_sign=-1, ra_rate_sign_beyond_pole=-1, dec_rate_sign_beyond_pole=dec_sign
        )
        bench = Bench(profile, StartPosition(-30.0, 110.0))
        assert bench.status.side_of_pier
        assert bench.status.dec_deg == EXACT(70.0, abs=1e-5)
        bench.run(2.0, **moving(0.5, 0.25))
        assert rates(bench, SIDEREAL_DEG_S - 0.5, expected * 0.25)

    def test_it_may_drive_the_declination_axis_across_the_pole(self) -> None:
        bench = Bench(start=StartPosition(-30.0, 85.0))
        bench.run(1.0)
        ra_deg = bench.truth.ra_deg
        seen = bench.run(12.0, **moving(None, 1.0))
        sides = [now.status.side_of_pier for now in seen]
        assert sides == sorted(sides)
        assert (sides[0], sides[-1]) == (False, True)
        assert bench.truth.dec_axis_deg == EXACT(97.0, abs=0.2)
        assert bench.status.dec_deg == EXACT(180.0 - bench.truth.dec_axis_deg, abs=1e-5)
        assert abs(turned(bench.truth.ra_deg - ra_deg)) == EXACT(180.0, abs=1e-3)
        assert max(now.status.dec_deg for now in seen) <= 90.0

    def test_it_stops_at_the_hard_limit_and_says_so_in_truth(self) -> None:
        limits = AxisLimits(max_acceleration_deg_s2=5.0)
        bench = Bench(MountProfile(ra=limits, hour_angle_limit_deg=60.0), hard_margin_deg=5.0)
        seen = bench.run(40.0, **moving(4.0, None))
        assert max(now.truth.hour_angle_axis_deg for now in seen) <= 65.0
        assert bench.truth.hour_angle_axis_deg == EXACT(65.0, abs=0.2)
        assert bench.truth.at_limit
        assert bench.axis_rates[0] == EXACT(0.0, abs=1e-2)
        bench.run(1.0)
        bench.run(3.0, **moving(-2.0, None))
        assert rates(bench, SIDEREAL_DEG_S - 2.0, 0.0)
        assert not bench.truth.at_limit

    def test_a_slew_never_goes_past_the_commandable_limit(self) -> None:
        bench = Bench(MountProfile(hour_angle_limit_deg=60.0))
        before = bench.truth.ra_deg
        bench.run(5.0, slew=True, **bench.target(-100.0, 0.0))
        assert turned(bench.truth.ra_deg - before) == EXACT(0.0, abs=1e-6)
        bench.run(0.1)
        bench.run(12.0, slew=True, **bench.target(-85.0, 0.0))
        assert bench.truth.hour_angle_axis_deg == EXACT(55.0, abs=0.1)

    def test_the_declination_axis_has_travel_of_its_own(self) -> None:
        profile = MountProfile(hour_angle_limit_deg=60.0, dec_axis_limits_deg=(-80.0, 40.0))
        bench = Bench(profile, hard_margin_deg=5.0)
        away_deg = -75.0 - bench.truth.dec_axis_deg
        bench.run(40.0, slew=True, **bench.target(0.0, away_deg))
        assert bench.truth.dec_axis_deg == EXACT(-75.0, abs=0.01)
        bench.run(1.0)
        bench.run(5.0, slew=True, **bench.target(0.0, 45.0 + 75.0))
        assert bench.truth.dec_axis_deg == EXACT(-75.0, abs=0.01)
        bench.run(1.0)
        for rate, end_deg in ((4.0, 45.0), (-4.0, -85.0)):
            bench.run(40.0, **moving(None, rate))
            assert bench.truth.dec_axis_deg == EXACT(end_deg, abs=0.2)
            assert bench.truth.at_limit


class TestFineRates:
    def test_they_add_to_tracking_in_tenths_of_tics(self) -> None:
        """ "DecFineRate and RAFineRate are in encoder tics/sec x 10"; sidereal is 7789."""
        bench = Bench()
        bench.run(0.5, ra_fine_rate_dtics_s=-7789, dec_fine_rate_dtics_s=1000)
        assert bench.status.ra_rate_dtics_s == EXACT(0, abs=1)
        assert bench.status.dec_rate_dtics_s == 1000
        assert not bench.status.slewing
        bench.run(0.5)
        assert bench.status.ra_rate_dtics_s == EXACT(7789, abs=1)

    @pytest.mark.parametrize("additive", [True, False])
    def test_and_with_tracking_to_moveaxis(self, additive: bool) -> None:
        bench = Bench(MountProfile(additive=additive))
        bench.run(1.0, ra_fine_rate_dtics_s=1000, **moving(1.0, None))
        fine = 100.0 * 360.0 / 2**26
        assert rates(bench, 1.0 + (SIDEREAL_DEG_S + fine if additive else 0.0), 0.0)

    @pytest.mark.parametrize("rate", [2**62, -(2**62)])
    def test_no_fine_rate_passes_the_axis_limit(self, rate: int) -> None:
        bench = Bench(MountProfile(ra=AxisLimits(slew_rate_deg_s=3.0)))
        for now in bench.run(5.0, ra_fine_rate_dtics_s=rate):
            assert abs(now.truth.ra_rate_deg_s) <= 3.0 + 1e-9


class TestPulseGuide:
    @pytest.mark.parametrize(("ra_ms", "dec_ms"), [(1000, 0), (-1000, 500), (0, -730), (123, 2017)])
    def test_the_axes_go_3500_tenths_of_tics_for_so_long(self, ra_ms: int, dec_ms: int) -> None:
        """ "Sign indicates direction, neg is east": right ascension grows to the east."""
        bench = Bench()
        ra_deg, dec_deg = bench.truth.ra_deg, bench.truth.dec_deg
        seen = bench.run(4.0, pulse_guide=True, pulse_ra_ms=ra_ms, pulse_dec_ms=dec_ms)
        assert turned(bench.truth.ra_deg - ra_deg) == EXACT(-GUIDE_DEG_S * ra_ms / 1000.0, abs=1e-8)
        assert bench.truth.dec_deg - dec_deg == EXACT(GUIDE_DEG_S * dec_ms / 1000.0, abs=1e-8)
        guided_s = sum(now.status.pulse_guiding for now in seen) * 0.05
        assert guided_s == EXACT(max(abs(ra_ms), abs(dec_ms)) / 1000.0, abs=0.051)
        assert all(now.status.ack_pulse_guide for now in seen)
        assert not bench.obeys().status.ack_pulse_guide

    def test_a_new_edge_starts_the_timers_anew(self) -> None:
        bench = Bench()
        dec_deg = bench.truth.dec_deg
        bench.run(0.5, pulse_guide=True, pulse_dec_ms=2000)
        bench.run(0.1)
        bench.run(5.0, pulse_guide=True, pulse_dec_ms=1000)
        assert bench.truth.dec_deg - dec_deg == EXACT(GUIDE_DEG_S * 1.6, abs=1e-8)

    @pytest.mark.parametrize("ends", [{"abort": True}, {"slew": True, "target_ra_h": 10.0}])
    def test_an_abort_or_a_slew_ends_it(self, ends: dict[str, Any]) -> None:
        bench = Bench()
        bench.run(0.5, pulse_guide=True, pulse_dec_ms=20000)
        assert bench.status.pulse_guiding
        bench.obeys(**ends)
        assert not bench.status.pulse_guiding

    def test_north_is_north_beyond_the_pole_too(self) -> None:
        bench = Bench(start=StartPosition(0.0, 120.0))
        dec_deg = bench.truth.dec_deg
        bench.run(2.0, pulse_guide=True, pulse_dec_ms=1000)
        assert bench.truth.dec_deg - dec_deg == EXACT(GUIDE_DEG_S, abs=1e-8)


class TestSync:
    def test_reported_coordinates_shift_and_nothing_else_does(self) -> None:
        bench = Bench()
        before = bench.seen
        seen = bench.run(2.0, sync=True, target_ra_h=5.0, target_dec_deg=33.0)
        assert seen[0].status.ack_sync
        status = bench.status
        assert (status.ra_h, status.dec_deg) == EXACT((5.0, 33.0), abs=1e-6)
        assert (status.target_ra_h, status.target_dec_deg) == (5.0, 33.0)
        assert status.altitude_deg - before.status.altitude_deg == EXACT(0.0, abs=0.02)
        assert bench.truth.dec_axis_deg == before.truth.dec_axis_deg
        moved = bench.truth.hour_angle_axis_deg - before.truth.hour_angle_axis_deg
        assert moved == EXACT(2.0 * SIDEREAL_DEG_S, abs=1e-7)
        assert not bench.obeys().status.ack_sync

    def test_a_slew_goes_to_where_the_target_is_reported(self) -> None:
        bench = Bench()
        bench.obeys(sync=True, **bench.target(0.5, -0.25))
        target = bench.target(6.0, 4.0)
        bench.obeys(slew=True, **target)
        bench.run(4.0)
        assert not bench.status.slewing
        assert (bench.status.ra_h, bench.status.dec_deg) == EXACT(
            (target["target_ra_h"], target["target_dec_deg"]), abs=1e-5
        )

    def test_it_is_ignored_while_slewing(self) -> None:
        bench = Bench()
        bench.obeys(slew=True, **bench.target(40.0, 30.0))
        declinations = [now.status.dec_deg for now in bench.run(1.0, sync=True, target_dec_deg=-80.0)]
        assert declinations == sorted(declinations)

    def test_a_restart_forgets_it(self) -> None:
        bench = Bench()
        before = bench.truth
        bench.obeys(sync=True, **bench.target(3.0, 3.0))
        bench.mount.restart(bench.now)
        bench.run(1.0)
        assert turned(bench.truth.ra_deg - before.ra_deg) == EXACT(0.0, abs=1e-5)
        assert bench.truth.dec_deg == EXACT(before.dec_deg, abs=1e-9)


class TestPark:
    def test_it_cuts_the_power_wherever_the_mount_is(self) -> None:
        """ "Park does not currently slew the mount, it disables the drives wherever the mount is"."""
        bench = Bench()
        before = bench.truth
        bench.run(2.0, park=True)
        assert (bench.status.ra_current_10ma, bench.status.dec_current_10ma) == (0, 0)
        assert rates(bench, 0.0, 0.0)
        assert abs(bench.truth.hour_angle_axis_deg - before.hour_angle_axis_deg) < 0.01
        assert not bench.status.at_park

    def test_a_moving_axis_coasts_until_friction_stops_it(self) -> None:
        bench = Bench()
        bench.run(2.0, **moving(None, 2.0))
        before = bench.truth
        bench.run(3.0, park=True)
        # 0.5 A of friction on 0.15 A per deg/s².
        assert bench.truth.dec_deg - before.dec_deg == EXACT(2.0 * 0.05 + 2.0**2 / (2 * 0.5 / 0.15), abs=0.11)
        assert bench.truth.dec_rate_deg_s == 0.0

    @pytest.mark.parametrize(
        "order", [{"slew": True}, moving(1.0, 1.0), {"find_home": True}, {"abort": True}]
    )
    def test_no_command_moves_it_and_a_restart_does(self, order: dict[str, Any]) -> None:
        bench = Bench(HOME)
        bench.run(1.0, park=True)
        before = bench.truth
        bench.run(1.0)
        bench.run(3.0, **order, **bench.target(10.0, 10.0))
        assert bench.truth.hour_angle_axis_deg == before.hour_angle_axis_deg
        assert bench.truth.dec_axis_deg == before.dec_axis_deg
        bench.mount.restart(bench.now)
        bench.run(2.0)
        assert rates(bench, SIDEREAL_DEG_S, 0.0)
        assert bench.status.counter == 40

    def test_a_mount_that_tells_says_at_park(self) -> None:
        bench = Bench(reports_home_and_park=True)
        assert not bench.run(0.5)[-1].status.at_park
        assert bench.run(1.0, park=True)[-1].status.at_park


class TestHome:
    def test_it_goes_there_and_rests(self) -> None:
        bench = Bench(HOME, reports_home_and_park=True)
        assert bench.obeys(find_home=True).status.slewing
        assert not bench.status.at_home
        bench.run(8.0)
        assert (bench.truth.hour_angle_axis_deg, bench.truth.dec_axis_deg) == EXACT((10.0, 5.0), abs=1e-6)
        assert rates(bench, 0.0, 0.0)
        assert (bench.status.slewing, bench.status.at_home) == (False, True)

    def test_without_a_home_it_is_not_used(self) -> None:
        bench = Bench()
        bench.run(2.0, find_home=True)
        assert rates(bench, SIDEREAL_DEG_S, 0.0)

    def test_the_papers_mount_packs_zeros(self) -> None:
        bench = Bench(HOME)
        bench.obeys(find_home=True)
        assert not any(now.status.at_home for now in bench.run(8.0))


class TestBeyondThePole:
    @pytest.mark.parametrize(
        ("flip", "east_deg", "beyond"),
        [
            ("hour_angle", 10.0, False),
            ("hour_angle", -60.0, True),
            ("ascom", 10.0, True),
            ("ascom", -60.0, False),
        ],
    )
    def test_a_mount_that_flips_does_so_past_the_meridian(
        self, flip: str, east_deg: float, beyond: bool
    ) -> None:
        bench = Bench(flip=flip)
        target = bench.target(east_deg, 30.0)
        bench.obeys(slew=True, **target)
        bench.run(40.0)
        assert not bench.status.slewing
        assert bench.status.side_of_pier is beyond
        assert abs(bench.truth.dec_axis_deg) == EXACT(130.0 if beyond else 50.0, abs=1e-6)
        assert (bench.status.ra_h, bench.status.dec_deg) == EXACT(
            (target["target_ra_h"], target["target_dec_deg"]), abs=1e-5
        )

    def test_by_default_none_does(self) -> None:
        bench = Bench()
        bench.obeys(slew=True, **bench.target(-100.0, 30.0))
        bench.run(20.0)
        assert not bench.status.side_of_pier

    def test_both_sides_report_the_same_direction(self) -> None:
        one, other = Bench(start=StartPosition(40.0, 35.0)), Bench(start=StartPosition(-140.0, 145.0))
        for name in ("ra_h", "dec_deg", "altitude_deg", "azimuth_deg"):
            assert getattr(one.status, name) == EXACT(getattr(other.status, name), abs=1e-5)


class TestEncoders:
    def test_170_and_minus_190_are_the_same(self) -> None:
        """ "The control logic in the program handles 170 and -190 the same of course"."""
        one, other = Bench(start=StartPosition(170.0, 20.0)), Bench(start=StartPosition(-190.0, 20.0))
        assert one.status == other.status
        target = one.target(20.0, 5.0)
        for bench in (one, other):
            bench.obeys(slew=True, **target)
            bench.run(8.0)
        assert one.status == other.status
        assert one.truth.hour_angle_axis_deg - other.truth.hour_angle_axis_deg == EXACT(360.0)

    def test_wraps_count_within_a_power_cycle_and_not_across(self) -> None:
        """ "Wrap data is not preserved between power cycles": cables may be a turn further than known."""
        bench = Bench(start=StartPosition(178.0, 20.0))
        bench.run(8.0, **moving(1.0, None))
        assert bench.truth.hour_angle_axis_deg == EXACT(186.0, abs=0.2)
        bench.mount.restart(bench.now)
        bench.run(3.0)
        assert bench.truth.hour_angle_axis_deg == EXACT(186.0, abs=0.2)
        # It believes to be at -174, so that it lets itself be driven on to 210 of its own.
        seen = bench.run(40.0, **moving(4.0, None))
        assert not any(now.truth.at_limit for now in seen)
        assert seen[-1].truth.hour_angle_axis_deg > 300.0

    def test_the_encoders_zero_is_not_seen_from_outside(self) -> None:
        one, other = Bench(), Bench(ra_encoder_zero_deg=71.3, dec_encoder_zero_deg=-15.2)
        assert one.status.ra_h == EXACT(other.status.ra_h, abs=1e-6)
        assert one.status.dec_deg == EXACT(other.status.dec_deg, abs=1e-5)


class TestWatchdog:
    PROFILE = MountProfile(watchdog_s=2.0)

    @pytest.mark.parametrize("order", [moving(1.0, 1.0), {"slew": True, "target_ra_h": 1.0}])
    def test_silence_brings_the_axes_to_rest(self, order: dict[str, Any]) -> None:
        bench = Bench(self.PROFILE)
        bench.obeys(**order)
        assert bench.coast(1.9)[-1].status.slewing
        bench.coast(1.5)
        assert rates(bench, 0.0, 0.0)
        assert not bench.status.slewing

    def test_commands_keep_it_away_and_bring_motion_back(self) -> None:
        bench = Bench(self.PROFILE)
        bench.run(5.0, **moving(1.0, None))
        assert rates(bench, SIDEREAL_DEG_S + 1.0, 0.0)
        bench.coast(4.0)
        assert rates(bench, 0.0, 0.0)
        bench.run(1.0, **moving(1.0, None))
        assert rates(bench, SIDEREAL_DEG_S + 1.0, 0.0)

    def test_a_mount_that_nobody_ever_commanded_keeps_tracking(self) -> None:
        bench = Bench(self.PROFILE)
        bench.coast(10.0)
        assert rates(bench, SIDEREAL_DEG_S, 0.0)


class TestDriveFault:
    def test_its_axis_coasts_without_current_and_obeys_nothing(self) -> None:
        bench = Bench()
        bench.run(2.0, **moving(1.0, 1.0))
        bench.mount.fail_drives(("dec",), bench.now)
        bench.run(2.0, **moving(1.0, 1.0))
        assert rates(bench, SIDEREAL_DEG_S + 1.0, 0.0)
        assert bench.status.dec_current_10ma == 0
        at_deg = bench.truth.dec_axis_deg
        bench.run(0.1)
        bench.run(1.0, slew=True, **bench.target(10.0, 10.0))
        bench.run(3.0, abort=True)
        assert bench.truth.dec_axis_deg == at_deg


class TestPackedTypes:
    def test_doubtful_fields_are_packed_as_the_profile_says(self) -> None:
        profile = MountProfile(readings={"counter": "double", "ra_rate_dtics_s": "double"})
        bench = Bench(profile)
        bench.obeys(**moving(0.5, 0.5))
        data, _ = bench.mount.tick(bench.now + 1.0)
        readings = status_readings(data)
        assert (readings.counter, readings.ra_rate_dtics_s) == ("double", "double")
        assert readings.dec_rate_dtics_s == "int64"
        assert data[104:112] == bytes.fromhex("00 00 00 00 00 00 08 40")
        assert decode_status(data).counter == 3

    def test_a_start_is_where_it_was_asked_for(self) -> None:
        truth = Bench().truth
        assert truth.dec_deg == START.dec_deg
        assert truth.hour_angle_axis_deg == START.hour_angle_deg
        assert truth.utc_s == EXACT(T0, abs=1.0)

    def test_the_last_datagram_of_two_clients_wins_the_mailbox(self) -> None:
        bench = Bench()
        for _ in range(40):
            for rate in (1.0, -2.0):
                bench.mount.receive(encode_command(Command(**moving(rate, None))))
            bench.turn()
        assert rates(bench, SIDEREAL_DEG_S - 2.0, 0.0)
