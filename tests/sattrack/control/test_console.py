"""A console and its operations against the simulated mount, in virtual time."""

from __future__ import annotations

import math
import struct
from typing import TYPE_CHECKING

import msgspec
import pytest
from console_builders import PERIOD_S, PROFILE, SITE, T0, Bench
from msgspec.structs import replace

from sattrack.control.console import Console
from sattrack.control.manual_operation import NOT_ALONE, ConsoleSession, Look, ManualOperation, view_of
from sattrack.control.procedures import MoveFor, RequestRefused, procedure_for
from sattrack.mount.model import MountProfile, Slew, Status
from sattrack.mount.requests import (
    Abort,
    FindHome,
    FineRate,
    MoveAxis,
    Park,
    PulseGuide,
    Request,
    Sync,
    TicketState,
)
from sattrack.mount.simulator.mount import StartPosition
from sattrack.mount.simulator.profile import SimulatorProfile
from sattrack.mount.xerxes.datagrams import STATUS_FIELDS, Command, encode_command, encode_status
from sattrack.safety import SafetyLimits
from sattrack.settings import NO_SITE
from sattrack.views.messages import Jog, Leave, Reset, decode_order, encode_message
from sattrack.views.run import ConsoleView

if TYPE_CHECKING:
    from collections.abc import Callable

PIPE_BUF = 4096
"""What POSIX lets a pipe take as a whole on Linux: pipe(7)."""


def sky(bench: Bench, hour_angle_deg: float) -> float:
    """The right ascension that is at an hour angle now."""
    if bench.console.sample is None:
        bench.turn()
    assert bench.console.sample is not None
    return (bench.console.sample.sidereal_h * 15.0 - hour_angle_deg) % 360.0


def plain(request: Request) -> object:
    return procedure_for(request, PROFILE)


def ended(operation: ManualOperation) -> tuple[str | None, TicketState, bool]:
    assert operation.outcome is not None
    return operation.ended_by, operation.outcome.state, operation.outcome.acknowledged


class TestEachVerbAgainstTheSimulatedMount:
    def test_a_slew_ends_when_the_mount_stands_on_its_target(self) -> None:
        bench = Bench()
        operation = bench.carry_out(plain(Slew(sky(bench, 10.0), 50.0)))
        assert ended(operation) == ("done", TicketState.COMPLETE, True)
        assert bench.truth is not None
        assert bench.truth.dec_deg == pytest.approx(50.0, abs=1e-3)
        assert bench.truth.hour_angle_axis_deg == pytest.approx(10.0, abs=0.1)
        assert not bench.moves_itself
        assert bench.flags() == ["slew"]

    def test_a_sync_shifts_what_is_reported_and_moves_nothing(self) -> None:
        bench = Bench()
        ra_deg = sky(bench, -29.0)
        operation = bench.carry_out(plain(Sync(ra_deg, 20.5)))
        assert ended(operation) == ("done", TicketState.COMPLETE, True)
        assert bench.console.sample is not None
        assert bench.console.sample.ra_deg == pytest.approx(ra_deg, abs=1e-3)
        assert bench.truth is not None
        assert bench.truth.dec_axis_deg == pytest.approx(20.0, abs=1e-6)

    def test_an_abort_is_the_first_datagram_and_the_axes_come_to_rest(self) -> None:
        bench = Bench()
        operation = bench.carry_out(plain(Abort()))
        assert ended(operation) == ("done", TicketState.COMPLETE, True)
        assert operation.mount_stopped is True
        assert bench.commands[0].abort
        assert bench.truth is not None
        assert bench.truth.ra_rate_deg_s == pytest.approx(360.0 / 86164.0905, rel=1e-9)

    def test_a_move_moves_by_rate_times_seconds_the_way_it_says_and_ends_tracking(self) -> None:
        bench = Bench()
        bench.run(0.2)
        assert bench.truth is not None
        before = bench.truth
        operation = bench.carry_out(MoveFor(MoveAxis(0.5, -0.25), 2.0))
        assert ended(operation) == ("done", TicketState.COMPLETE, True)
        east = math.remainder(bench.truth.ra_deg - before.ra_deg, 360.0)
        assert east == pytest.approx(1.0, abs=0.06)
        assert bench.truth.dec_deg - before.dec_deg == pytest.approx(-0.5, abs=0.03)
        assert abs(bench.truth.ra_rate_deg_s) < 1e-6

    def test_a_move_of_one_axis_leaves_the_other_alone(self) -> None:
        bench = Bench()
        bench.carry_out(MoveFor(MoveAxis(None, 0.25), 1.0))
        assert not any(command.move_ra for command in bench.commands)

    @pytest.mark.parametrize("move_axis", ["held", "edge"])
    def test_a_move_ends_on_either_kind_of_mount(self, move_axis: str) -> None:
        bench = Bench(profile=msgspec.structs.replace(PROFILE, move_axis=move_axis))
        operation = bench.carry_out(MoveFor(MoveAxis(-1.0, 0.5), 1.0))
        assert ended(operation) == ("done", TicketState.COMPLETE, True)
        bench.run(2.0)
        assert not bench.moves_itself

    @pytest.mark.parametrize("seconds", [1.0, 2.0])
    @pytest.mark.parametrize("parked", [True, False], ids=["parked", "drive fault"])
    def test_a_move_of_drives_that_are_off_is_not_done(self, parked: bool, seconds: float) -> None:
        bench = Bench()
        if parked:
            bench.mount.receive(encode_command(Command(park=True)))
        bench.run(1.0)
        if not parked:
            bench.mount.fail_drives(("ra", "dec"), bench.now_s)
        before = bench.truth
        operation = bench.carry_out(MoveFor(MoveAxis(0.5, -0.25), seconds))
        assert ended(operation) == ("done", TicketState.FAILED, not parked)
        assert operation.outcome is not None
        assert "its drives are off" in (operation.outcome.reason or "")
        assert before is not None
        assert bench.truth is not None
        assert bench.truth.dec_axis_deg == before.dec_axis_deg
        assert set(bench.flags()) == {"move_ra", "move_dec"}

    def test_a_move_that_cannot_be_told_from_standstill_is_not_held_against_the_drives(self) -> None:
        bench = Bench()
        bench.mount.receive(encode_command(Command(abort=True)))
        bench.run(1.0)
        still = MoveAxis(360.0 / 86164.0905, 0.0)
        assert ended(bench.carry_out(MoveFor(still, 2.0))) == ("done", TicketState.COMPLETE, True)

    def test_a_pulse_is_seen_to_its_end(self) -> None:
        bench = Bench()
        operation = bench.carry_out(plain(PulseGuide(500, -300)))
        assert ended(operation) == ("done", TicketState.COMPLETE, True)
        sent = [(c.pulse_ra_ms, c.pulse_dec_ms) for c in bench.commands if c.pulse_guide]
        assert set(sent) == {(500, -300)}
        assert bench.truth is not None
        # 3500 tenths of tics a second, 2^26 tics a turn: the paper.
        assert bench.truth.dec_axis_deg == pytest.approx(20.0 - 0.3 * 350.0 * 360.0 / 2**26, abs=1e-6)

    def test_fine_rates_stand_in_every_datagram_to_the_last(self) -> None:
        bench = Bench()
        operation = bench.carry_out(plain(FineRate(0.001, 0.0)))
        assert operation.ended_by == "done"
        # 0.001 degrees a second in tenths of tics.
        assert bench.commands[-1].ra_fine_rate_dtics_s == round(0.001 * 2**26 / 360.0 * 10.0)

    def test_home_is_unconfirmed_where_the_mount_does_not_say_so(self) -> None:
        bench = Bench()
        operation = bench.carry_out(plain(FindHome()))
        assert ended(operation) == ("done", TicketState.UNCONFIRMED, False)
        assert operation.outcome is not None
        assert operation.outcome.reason == (
            "the protocol has no acknowledgement for it; the mount stands at the profile's home"
        )
        assert bench.truth is not None
        assert (bench.truth.hour_angle_axis_deg, bench.truth.dec_axis_deg) == pytest.approx(
            (0.0, 0.0), abs=1e-6
        )

    def test_to_a_home_close_to_a_limit_a_slew_leads_nearer_first(self) -> None:
        """An abort of the whole way could lead past the limit, 0.5° beyond it."""
        profile = replace(PROFILE, dec_axis_limits_deg=(-0.5, 90.0))
        bench = Bench(profile=profile)
        operation = bench.carry_out(procedure_for(FindHome(), profile))
        assert ended(operation) == ("done", TicketState.UNCONFIRMED, False)
        assert bench.truth is not None
        assert (bench.truth.hour_angle_axis_deg, bench.truth.dec_axis_deg) == pytest.approx(
            (0.0, 0.0), abs=1e-6
        )
        (near_deg,) = {command.target_dec_deg for command in bench.commands if command.slew}
        assert 0.1 < near_deg < 2.0

    def test_home_is_complete_where_the_mount_says_so(self) -> None:
        bench = Bench(hardware=SimulatorProfile(reports_home_and_park=True))
        assert ended(bench.carry_out(plain(FindHome()))) == ("done", TicketState.COMPLETE, False)

    def test_a_mount_without_a_home_is_told_not_to_have_moved(self) -> None:
        bench = Bench(profile=MountProfile())
        operation = bench.carry_out(procedure_for(FindHome(in_daylight=True), MountProfile()))
        assert operation.outcome is not None
        assert operation.outcome.reason == (
            "the protocol has no acknowledgement for it; the mount was not seen to move"
        )

    @pytest.mark.parametrize(
        ("tells", "state"), [(False, TicketState.UNCONFIRMED), (True, TicketState.COMPLETE)]
    )
    def test_park_slews_stops_and_only_then_cuts_the_power(self, tells: bool, state: TicketState) -> None:
        bench = Bench(hardware=SimulatorProfile(reports_home_and_park=tells))
        operation = bench.carry_out(plain(Park()))
        assert ended(operation) == ("done", state, False)
        assert bench.flags() == ["slew", "abort", "park"]
        assert bench.truth is not None
        assert bench.truth.hour_angle_axis_deg == pytest.approx(20.0, abs=0.1)
        assert bench.truth.dec_axis_deg == pytest.approx(40.0, abs=0.1)

    def test_no_park_flag_ever_meets_a_moving_mount(self) -> None:
        bench = Bench()
        operation = ManualOperation(bench.console, plain(Park()), bench.now_s)
        speeds: list[float] = []
        while not operation.finished:
            bench.turn(operation)
            if bench.commands and bench.commands[-1].park:
                assert bench.console.sample is not None
                speeds.append(abs(bench.console.sample.ra_drive_deg_s))
                speeds.append(abs(bench.console.sample.dec_drive_deg_s))
        assert speeds
        assert max(speeds) < 0.0021, "half the sidereal rate"


class TestWhatIsRefusedBeforeAnythingIsSent:
    @pytest.mark.parametrize(
        ("request_", "words"),
        [
            (Slew(math.nan, 10.0), "right ascension is nan° (nan h); it runs from 0 to below 360° (24 h)"),
            (Slew(360.0, 10.0), "right ascension is 360° (24 h); it runs from 0 to below 360° (24 h)"),
            (Slew(-1.5, 10.0), "right ascension is -1.5° (-0.1 h); it runs from 0 to below 360° (24 h)"),
            (Sync(10.0, 91.0), "declination is 91°; it runs from -90° to 90°"),
            (
                PulseGuide(2**31, 0),
                "pulse in right ascension is 2147483648 ms; it must be a whole number of 32 bits",
            ),
            (PulseGuide(0, 0), "a pulse of 0 ms on both axes guides nothing"),
            (FineRate(math.inf, 0.0), "fine rate in right ascension is inf °/s; at most 0.1 °/s"),
        ],
    )
    def test_numbers_that_cannot_be(self, request_: Request, words: str) -> None:
        bench = Bench()
        operation = bench.carry_out(plain(request_))
        assert operation.ended_by == "refused"
        assert operation.outcome is not None
        assert operation.outcome.reason == words
        assert bench.flags() == []
        assert not operation.begun

    @pytest.mark.parametrize("rate", [math.inf, -math.inf, math.nan, 6.01, -7.0])
    def test_rates_that_no_axis_has(self, rate: float) -> None:
        bench = Bench()
        operation = bench.carry_out(MoveFor(MoveAxis(rate, None), 1.0))
        assert operation.ended_by == "refused"
        assert operation.outcome is not None
        assert operation.outcome.reason == (
            f"rate in right ascension is {rate:g} °/s; the mount profile's limit is 6 °/s"
        )
        assert bench.flags() == []

    def test_a_direction_below_the_horizon_is_safetys_refusal(self) -> None:
        bench = Bench()
        operation = bench.carry_out(plain(Slew(sky(bench, 180.0), 0.0)))
        assert operation.outcome is not None
        assert operation.outcome.refusal == RequestRefused(
            "that direction is at -38.0° altitude; the limit is 0°", by_safety=True
        )
        assert bench.flags() == []

    def test_parking_without_a_park_position(self) -> None:
        profile = MountProfile()
        bench = Bench(profile=profile)
        operation = bench.carry_out(procedure_for(Park(), profile))
        assert operation.outcome is not None
        assert operation.outcome.reason == (
            "the mount profile has no park position, and parking cuts the drives' power: add `park` to it"
        )
        assert bench.flags() == []

    @pytest.mark.parametrize("what", [None, FineRate(0.0001), PulseGuide(100, 0)])
    def test_without_a_site_nothing_that_altitude_decides_about(self, what: Request | None) -> None:
        bench = Bench(site=None, limits=SafetyLimits(optical=False))
        operation = bench.carry_out(plain(what or Slew(sky(bench, 10.0), 50.0)))
        assert operation.outcome is not None
        assert operation.outcome.reason == (NO_SITE)

    def test_fine_rates_are_taken_back_without_a_site_too(self) -> None:
        bench = Bench(site=None, limits=SafetyLimits(optical=False))
        bench.run(0.5)
        assert not isinstance(bench.console.request(FineRate(), bench.now_s), RequestRefused)

    def test_a_sync_while_the_mount_slews(self) -> None:
        bench = Bench()
        bench.run(0.5)
        bench.console.request(Slew(sky(bench, 30.0), 60.0), bench.now_s)
        bench.until(lambda: bench.console.status is not None and bench.console.status.slewing)
        bench.console.procedure = None
        refusal = bench.console.request(Sync(sky(bench, 0.0), 50.0), bench.now_s)
        assert refusal == RequestRefused(
            "the mount moves: sync once it stands, or what it reports would be wrong for good"
        )

    def test_a_mount_that_obeys_somebody_else_is_left_alone(self) -> None:
        bench = Bench()
        others = Command(1, move_ra=True, move_ra_rate_deg_s=1.0)
        bench.mount.receive(encode_command(others))
        operation = ManualOperation(bench.console, plain(Slew(10.0, 50.0)), bench.now_s)
        while not operation.finished:
            bench.turn(operation)
        assert bench.commands == []
        assert operation.ended_by == "refused"
        assert operation.outcome is not None
        assert operation.outcome.reason is not None
        assert operation.outcome.reason == (
            "the mount acknowledges commands (move ra) that were not sent from here: another program drives "
            "it, or did and was killed; end it, or stop the mount with `sattrack mount abort`, then ask again"
        )

    def test_a_mount_that_tells_its_status_only_when_called_is_left_to_the_other_too(self) -> None:
        bench = Bench(cut=True)
        operation = ManualOperation(bench.console, plain(Slew(10.0, 50.0)), bench.now_s)
        while not bench.commands:
            bench.turn(operation)
        bench.cut = False
        while not operation.finished:
            bench.mount.receive(encode_command(Command(1, move_ra=True, move_ra_rate_deg_s=1.0)))
            bench.turn(operation)
        assert operation.ended_by == "refused"
        assert bench.flags() == []

    def test_an_abort_is_sent_to_it_all_the_same(self) -> None:
        bench = Bench()
        bench.mount.receive(encode_command(Command(1, move_ra=True, move_ra_rate_deg_s=1.0)))
        bench.mount.tick(bench.now_s)
        operation = bench.carry_out(plain(Abort()))
        assert ended(operation) == ("done", TicketState.COMPLETE, True)
        assert not bench.moves_itself


def cut(bench: Bench) -> Callable[[ManualOperation], None]:
    def happen(_: ManualOperation) -> None:
        bench.cut = True

    return happen


class TestWhatGoesWrongEndsWithAMountAtRest:
    @pytest.mark.parametrize("after_s", [0.0, 0.1, 0.3, 0.5, 1.0, 2.0, 4.0, 5.5])
    def test_an_interrupt_at_every_stage_of_a_slew(self, after_s: float) -> None:
        bench = Bench()
        ra_deg = sky(bench, 30.0)
        operation = bench.carry_out(
            plain(Slew(ra_deg, 60.0)), at=((after_s, lambda e: e.interrupt(bench.now_s)),)
        )
        assert ended(operation) == ("operator", TicketState.FAILED, False)
        assert operation.mount_stopped is (True if operation.begun else None)
        assert operation.begun is (after_s > 0.2)
        assert not bench.moves_itself

    @pytest.mark.parametrize("after_s", [0.4, 3.0, 6.5, 6.75, 7.0])
    def test_an_interrupt_at_every_stage_of_parking(self, after_s: float) -> None:
        bench = Bench()
        operation = bench.carry_out(plain(Park()), at=((after_s, lambda e: e.interrupt(bench.now_s)),))
        assert operation.ended_by == "operator"
        assert not bench.moves_itself

    def test_a_second_interrupt_does_not_skip_the_stop(self) -> None:
        bench = Bench()

        def interrupt(operation: ManualOperation) -> None:
            operation.interrupt(bench.now_s)

        operation = bench.carry_out(
            MoveFor(MoveAxis(3.0, 0.0), 60.0), at=tuple((1.0 + i * PERIOD_S, interrupt) for i in range(20))
        )
        assert (operation.ended_by, operation.mount_stopped) == ("operator", True)
        assert not bench.moves_itself

    def test_a_time_out_stops_the_slew(self) -> None:
        bench = Bench()
        operation = bench.carry_out(plain(Slew(sky(bench, 30.0), 60.0)), timeout_s=1.0)
        assert (operation.ended_by, operation.mount_stopped) == ("timeout", True)
        assert not bench.moves_itself

    def test_a_link_that_falls_silent_brings_a_stop_that_the_mount_obeys(self) -> None:
        bench = Bench()
        operation = bench.carry_out(MoveFor(MoveAxis(1.0, 0.0), 60.0), at=((1.0, cut(bench)),))
        assert (operation.ended_by, operation.mount_stopped) == ("link", False)
        assert bench.commands[-1].abort or "abort" in bench.flags()
        assert not bench.moves_itself

    def test_a_mount_that_is_never_heard_is_asked_nothing(self) -> None:
        bench = Bench(cut=True)
        operation = bench.carry_out(plain(PulseGuide(500, 0)))
        assert ended(operation) == ("link", TicketState.FAILED, False)
        assert operation.outcome is not None
        assert operation.outcome.reason == "no status from bench within 3 s"
        assert bench.flags() == []
        assert bench.now_s - T0 < 4.0

    def test_an_abort_goes_out_to_a_mount_that_is_never_heard(self) -> None:
        bench = Bench(cut=True)
        operation = bench.carry_out(plain(Abort()))
        assert (operation.ended_by, operation.mount_stopped) == ("link", None)
        assert bench.commands[0].abort
        assert not bench.moves_itself

    @pytest.mark.parametrize("after_s", [0.5, 1.5, 3.0])
    def test_a_mount_that_restarts_in_mid_slew(self, after_s: float) -> None:
        bench = Bench()
        ra_deg = sky(bench, 30.0)
        operation = bench.carry_out(
            plain(Slew(ra_deg, 60.0)), at=((after_s, lambda _: bench.mount.restart(bench.now_s)),)
        )
        assert operation.outcome is not None
        assert operation.outcome.reason == "the mount restarted meanwhile"
        assert view_of(bench.console, bench.now_s).link.restarts == 1
        bench.run(1.0)
        assert not bench.moves_itself

    def test_a_mount_that_restarts_in_a_move_or_a_jog_is_not_set_going_again(self) -> None:
        bench = Bench()
        operation = bench.carry_out(
            MoveFor(MoveAxis(1.0, 0.0), 60.0), at=((2.0, lambda _: bench.mount.restart(bench.now_s)),)
        )
        assert (operation.ended_by, operation.mount_stopped) == ("restart", True)
        assert bench.now_s - T0 < 5.0
        assert not bench.moves_itself

    def test_a_move_into_the_horizon_is_stopped_above_it(self) -> None:
        bench = Bench()
        operation = bench.carry_out(MoveFor(MoveAxis(None, -5.0), 60.0))
        assert (operation.ended_by, operation.mount_stopped) == ("limit:altitude", True)
        assert bench.console.status is not None
        assert bench.console.status.altitude_deg > 0.0
        assert not bench.moves_itself

    def test_a_defect_stops_the_mount(self) -> None:
        bench = Bench()
        operation = bench.carry_out(
            MoveFor(MoveAxis(1.0, 0.0), 60.0), at=((1.0, lambda e: e.fail("broken", bench.now_s)),)
        )
        assert (operation.ended_by, operation.mount_stopped) == ("error", True)
        assert not bench.moves_itself

    def test_a_mount_that_does_not_stop_is_told_for_a_minute_and_reported(self) -> None:
        bench = Bench()

        def seize(_: ManualOperation) -> None:
            bench.deaf = True

        operation = bench.carry_out(
            MoveFor(MoveAxis(1.0, 0.0), 60.0),
            timeout_s=2.0,
            at=((1.0, seize),),
        )
        assert operation.mount_stopped is False


class TestJogs:
    def bench(self) -> Bench:
        bench = Bench()
        bench.run(0.5)
        return bench

    def moving_s(self, bench: Bench) -> float:
        """How long MoveAxis has been asked for."""
        return sum(command.move_ra or command.move_dec for command in bench.commands) * PERIOD_S

    def test_one_touch_lasts_half_a_second(self) -> None:
        bench = self.bench()
        assert bench.console.jog(None, 0.5, bench.now_s) is None
        bench.run(3.0)
        assert self.moving_s(bench) == pytest.approx(0.5, abs=2 * PERIOD_S)
        assert not bench.moves_itself

    def test_a_held_key_goes_on_and_ends_after_its_last_repeat(self) -> None:
        bench = self.bench()
        for _ in range(40):
            bench.console.jog(None, 0.5, bench.now_s)
            bench.turn()
        last_s = bench.now_s
        bench.until(lambda: not bench.commands[-1].move_dec)
        assert bench.now_s - last_s <= 0.3 + 2 * PERIOD_S
        bench.run(1.0)
        assert not bench.moves_itself

    def test_a_flood_of_old_touches_lasts_no_longer_than_one(self) -> None:
        bench = self.bench()
        for _ in range(1000):
            bench.console.jog(None, 0.5, bench.now_s)
        bench.run(3.0)
        assert self.moving_s(bench) <= 0.5 + 2 * PERIOD_S

    def test_arrows_go_where_they_say(self) -> None:
        for ra, dec in ((0.5, None), (-0.5, None), (None, 0.5), (None, -0.5)):
            bench = self.bench()
            assert bench.truth is not None
            before = bench.truth
            bench.console.jog(ra, dec, bench.now_s)
            bench.run(2.0)
            east = math.remainder(bench.truth.ra_deg - before.ra_deg, 360.0)
            north = bench.truth.dec_deg - before.dec_deg
            assert (round(east / 0.25), round(north / 0.25)) == (round((ra or 0) * 2), round((dec or 0) * 2))

    def test_two_axes_end_each_by_itself(self) -> None:
        bench = self.bench()
        bench.console.jog(0.5, None, bench.now_s)
        bench.run(0.3)
        bench.console.jog(None, 0.5, bench.now_s)
        bench.run(0.3)
        assert (bench.commands[-1].move_ra_rate_deg_s, bench.commands[-1].move_dec_rate_deg_s) == (0.0, 0.5)

    def test_a_stop_outlasts_a_key_that_is_still_held(self) -> None:
        bench = self.bench()
        for _ in range(10):
            bench.console.jog(2.0, None, bench.now_s)
            bench.turn()
        bench.console.abort(bench.now_s)
        for _ in range(100):
            bench.console.jog(2.0, None, bench.now_s)
            bench.turn()
        assert not bench.moves_itself
        assert bench.console.refusal == "stopped: let the key go, and jog once the mount is at rest"
        bench.run(0.5)
        assert bench.console.jog(2.0, None, bench.now_s) is None

    def test_nothing_is_jogged_in_a_slew_or_blindly(self) -> None:
        bench = self.bench()
        bench.console.request(Slew(sky(bench, 30.0), 60.0), bench.now_s)
        bench.turn()
        assert bench.console.jog(0.5, None, bench.now_s) == RequestRefused(
            "an operation is in progress: SPACE stops it, then jog"
        )
        bench = self.bench()
        bench.cut = True
        bench.run(0.5)
        assert bench.console.jog(0.5, None, bench.now_s) == RequestRefused(
            "the mount is not heard: nothing is moved blindly"
        )

    def test_a_jog_whose_mount_falls_silent_ends_by_itself(self) -> None:
        bench = self.bench()
        bench.console.jog(3.0, None, bench.now_s)
        bench.cut = True
        bench.run(4.0)
        assert not bench.moves_itself

    def test_a_jog_into_the_horizon_is_stopped_and_reset_lets_it_out_by_a_slew(self) -> None:
        bench = Bench(start=StartPosition(-30.0, -25.0))
        bench.run(0.5)
        for _ in range(100):
            bench.console.jog(None, -3.0, bench.now_s)
            bench.turn()
        view = view_of(bench.console, bench.now_s)
        assert view.tripped == "altitude"
        assert view.status is not None
        assert view.status.altitude_deg is not None
        assert view.status.altitude_deg > 0.0
        bench.run(2.0)
        refusal = bench.console.request(Slew(sky(bench, 0.0), 40.0), bench.now_s)
        assert refusal is not None
        assert refusal.by_safety
        assert bench.console.reset() is None
        assert bench.console.request(Slew(sky(bench, 0.0), 40.0), bench.now_s) is None
        bench.until(lambda: bench.console.outcome is not None)
        assert bench.console.outcome is not None
        assert bench.console.outcome.state is TicketState.COMPLETE

    def test_reset_waits_for_rest(self) -> None:
        bench = Bench(start=StartPosition(-30.0, -15.0))
        bench.run(0.5)
        for _ in range(60):
            bench.console.jog(None, -6.0, bench.now_s)
            if bench.console.safety.tripped is not None:
                break
            bench.turn()
        assert bench.console.reset() == RequestRefused("the mount is not at rest yet")


class TestASitting:
    def sit(self, bench: Bench, seconds: float, *orders: object) -> ConsoleSession:
        console_session = ConsoleSession(bench.console, bench.now_s)
        for _ in range(20):
            bench.turn(console_session)
        for order in orders:
            console_session.obey(order, bench.now_s)
        for _ in range(round(seconds / PERIOD_S)):
            if console_session.finished:
                break
            bench.turn(console_session)
        return console_session

    def test_leaving_an_idle_mount_leaves_it_tracking(self) -> None:
        bench = Bench()
        console_session = self.sit(bench, 2.0, Leave())
        assert console_session.finished
        assert console_session.mount_stopped is None
        assert bench.flags() == []

    @pytest.mark.parametrize("order", [Jog(2.0, None), Slew(0.0, 0.0), Park(), FindHome()])
    def test_leaving_stops_whatever_was_begun(self, order: object) -> None:
        bench = Bench()
        bench.turn()
        if isinstance(order, Slew):
            order = Slew(sky(bench, 30.0), 60.0)
        console_session = self.sit(bench, 0.4, order)
        console_session.obey(Leave(), bench.now_s)
        while not console_session.finished:
            bench.turn(console_session)
        assert console_session.mount_stopped is True
        assert not bench.moves_itself

    @pytest.mark.parametrize("late_s", [0.0, 0.5, 0.9])
    def test_leaving_sees_a_rest_that_comes_while_the_machine_is_busy(self, late_s: float) -> None:
        bench = Bench()
        console_session = self.sit(bench, 0.4, Jog(2.0, None))
        console_session.obey(Leave(), bench.now_s)
        until_s = bench.now_s + 10.0
        while not bench.console.session.stopped:
            assert bench.now_s < until_s
            bench.turn(console_session)
        bench.now_s += late_s
        while not console_session.finished:
            assert bench.now_s < until_s
            bench.turn(console_session)
        assert console_session.mount_stopped is True

    def test_nothing_is_obeyed_after_leaving(self) -> None:
        bench = Bench()
        console_session = self.sit(bench, 0.0, Leave(), Jog(1.0, None), Park())
        while not console_session.finished:
            bench.turn(console_session)
        assert bench.flags() == []

    def test_abort_stops_from_every_state(self) -> None:
        for order in (Jog(2.0, None), Park(), FindHome(), Reset()):
            bench = Bench()
            console_session = self.sit(bench, 1.0, order)
            console_session.obey(Abort(), bench.now_s)
            bench.turn(console_session)
            bench.turn(console_session)
            assert any(command.abort for command in bench.commands[-2:]), "within two datagrams"
            for _ in range(100):
                bench.turn(console_session)
            assert bench.console.at_rest

    def test_it_looks_on_in_silence_where_somebody_else_drives_and_stops_when_asked(self) -> None:
        bench = Bench()
        bench.mount.receive(encode_command(Command(1, move_ra=True, move_ra_rate_deg_s=0.5)))
        console_session = self.sit(bench, 1.0)
        for order in (Jog(1.0, None), FindHome(), Reset()):
            console_session.obey(order, bench.now_s)
            bench.turn(console_session)
        assert bench.commands == []
        assert console_session.view(bench.now_s).warnings[0] == NOT_ALONE
        assert console_session.view(bench.now_s).refusal == "another program drives this mount"
        console_session.obey(Abort(), bench.now_s)
        for _ in range(60):
            bench.turn(console_session)
        assert bench.commands[0].abort
        assert not bench.moves_itself

    def test_it_falls_silent_when_somebody_else_begins_to_drive(self) -> None:
        bench = Bench()
        console_session = self.sit(bench, 1.0)
        sent = len(bench.commands)
        assert sent > 0
        for _ in range(10):
            bench.mount.receive(encode_command(Command(1, move_ra=True, move_ra_rate_deg_s=0.5)))
            bench.turn(console_session)
        assert len(bench.commands) <= sent + 1
        assert console_session.view(bench.now_s).warnings[0] == NOT_ALONE

    def test_a_slew_under_way_is_seen_in_the_view_and_settles(self) -> None:
        bench = Bench()
        bench.turn()
        console_session = self.sit(bench, 1.0, Slew(sky(bench, 30.0), 60.0))
        assert console_session.view(bench.now_s).doing == "slewing"
        assert console_session.view(bench.now_s).asked[-1].state == "acknowledged"
        for _ in range(200):
            bench.turn(console_session)
        view = console_session.view(bench.now_s)
        assert (view.doing, view.motion, view.asked[-1].state) == ("idle", "none", "complete")

    def test_a_sync_order_is_a_sync(self) -> None:
        bench = Bench()
        bench.turn()
        self.sit(bench, 3.0, Sync(sky(bench, -29.5), 20.1))
        assert bench.flags() == ["sync"]


def test_two_consoles_on_one_mount_are_told_of_each_other() -> None:
    bench = Bench()
    other = Console(PROFILE, SafetyLimits(), SITE, "other")
    bench.run(1.0)
    for turn in range(200):
        if turn % 4 == 0:
            bench.console.jog(0.2, None, bench.now_s)
        if turn % 5 == 0:
            bench.mount.receive(other.tick(bench.now_s))
        bench.turn()
        status, _ = bench.mount.tick(bench.now_s)
        other.receive(status, bench.now_s)
    words = "another program is sending commands to this mount: end it, or motions will mix"
    assert words in view_of(bench.console, bench.now_s).warnings
    assert view_of(other, bench.now_s).link.foreign_acks >= 2


def test_a_look_sends_nothing_and_tells_what_it_heard() -> None:
    bench = Bench(hardware=SimulatorProfile(clock_offset_s=3.0))
    look = Look(bench.console, bench.now_s, 3.0, knock=False)
    while not look.finished:
        bench.turn(look)
    view = view_of(bench.console, bench.now_s)
    assert bench.commands == []
    assert view.link.received >= 20
    assert view.clock_offset_s == pytest.approx(3.0, abs=0.01)
    assert (
        "the mount's clock is 3.0 s ahead: its hour angles, and so its limits, are off by it" in view.warnings
    )


def test_what_operates_a_console_passes_on_for_how_long_its_mount_may_go_unheard() -> None:
    console = Bench().console
    console.turns_known_s = 12.5
    operation = ManualOperation(console, plain(Slew(10.0, 50.0)), T0)  # type: ignore[arg-type]
    for part in (operation, Look(console, T0, 1.0, knock=False), ConsoleSession(console, T0, None)):
        assert part.turns_known_s == 12.5


def test_a_look_that_was_interrupted_stays_at_its_end() -> None:
    bench = Bench()
    look = Look(bench.console, bench.now_s, 100.0, knock=False, look_s=100.0)
    bench.turn(look)
    look.interrupt(bench.now_s)
    bench.turn(look)
    assert look.finished
    silent = Look(Bench(cut=True).console, bench.now_s, 100.0, knock=False)
    silent.interrupt(bench.now_s)
    silent.tick(bench.now_s)
    assert silent.finished


def test_a_look_gives_up_and_knocks_only_where_it_may() -> None:
    for knock in (False, True):
        bench = Bench(cut=True)
        look = Look(bench.console, bench.now_s, 1.0, knock)
        while not look.finished:
            bench.turn(look)
        assert (len(bench.commands) > 0) is knock
        assert bench.flags() == []


class TestTheView:
    def test_it_has_every_field_of_the_protocols_status_by_its_name(self) -> None:
        names = [field.name for field in STATUS_FIELDS if field.name != "header"]
        assert sorted(Status.__struct_fields__) == sorted(names)

    def test_a_number_that_is_none_is_null_and_the_view_reads_back(self) -> None:
        console = Console(PROFILE, SafetyLimits(), SITE, "m")
        status = replace(
            Status(), counter=1, altitude_deg=math.nan, target_ra_h=math.inf, site_height_m=-math.inf
        )
        console.receive(encode_status(status), T0)
        view = view_of(console, T0)
        assert view.status is not None
        assert view.status.altitude_deg is None
        assert msgspec.json.decode(msgspec.json.encode(view), type=ConsoleView) == view

    @pytest.mark.parametrize("kind", ["int64", "double"])
    def test_both_readings_of_every_doubtful_field_are_told_apart(self, kind: str) -> None:
        console = Console(PROFILE, SafetyLimits(), SITE, "m")
        data = bytearray(encode_status(replace(Status(), counter=1, slewing=True, tracking=kind == "double")))
        for offset, value in ((32, 12), (48, 7789), (104, 5), (112, 3500), (120, 3500)):
            data[offset : offset + 8] = struct.pack("<q" if kind == "int64" else "<d", value)
        console.receive(bytes(data), T0)
        readings = view_of(console, T0).readings
        assert readings.ra_rate_dtics_s == readings.dec_rate_dtics_s == readings.counter == kind
        assert readings.ra_guide_rate_dtics_s == readings.dec_guide_rate_dtics_s == kind
        assert readings.tracking == ("the opposite of slewing" if kind == "int64" else "always true")

    @pytest.mark.parametrize("tracking", [False, True])
    def test_tracking_tells_something_only_while_the_mount_slews(self, tracking: bool) -> None:
        console = Console(PROFILE, SafetyLimits(), SITE, "m")
        assert view_of(console, T0).readings.tracking is None
        console.receive(encode_status(replace(Status(), counter=1, tracking=tracking)), T0)
        assert view_of(console, T0).readings.tracking is None

    def test_a_profile_that_says_otherwise_is_told(self) -> None:
        profile = msgspec.structs.replace(PROFILE, readings={"ra_rate_dtics_s": "double"})
        console = Console(profile, SafetyLimits(), SITE, "m")
        console.receive(encode_status(replace(Status(), counter=1, ra_rate_dtics_s=7789)), T0)
        words = "the profile has ra_rate_dtics_s as double, the mount sends int64"
        assert words in view_of(console, T0).warnings

    def test_a_mount_that_believes_itself_elsewhere_is_told(self) -> None:
        console = Console(PROFILE, SafetyLimits(), SITE, "m")
        status = replace(Status(), counter=1, site_latitude_deg=-30.0, site_longitude_deg=-70.0)
        console.receive(encode_status(status), T0)
        words = "the mount believes it stands at -30.00, -70.00: check the site on both sides"
        assert words in view_of(console, T0).warnings

    def test_the_fullest_view_fits_into_what_a_pipe_takes_as_a_whole(self) -> None:
        bench = Bench()
        bench.console.stranger_hosts = tuple(f"192.168.100.{n}" for n in range(100, 104))
        bench.run(0.5)
        for _ in range(8):
            bench.console.request(Park(), bench.now_s)
            bench.console.abort(bench.now_s)
            bench.run(1.0)
        bench.console.refusal = "x" * 500
        view = view_of(bench.console, bench.now_s)
        full = msgspec.structs.replace(view, warnings=("w" * 160,) * 4)
        assert len(msgspec.json.encode(full)) < PIPE_BUF


@pytest.mark.parametrize(
    ("line", "order"),
    [
        (b'{"type":"abort"}', Abort()),
        (b'{"type":"jog","dec_rate_deg_s":0.1}', Jog(None, 0.1)),
        (b'{"type":"slew","ra_deg":82.5,"dec_deg":-12.5}', Slew(82.5, -12.5)),
        (b'{"type":"sync","ra_deg":0,"dec_deg":90}', Sync(0, 90)),
        (b'{"type":"leave"}', Leave()),
    ],
)
def test_orders_are_lines_of_json(line: bytes, order: object) -> None:
    assert decode_order(line) == order
    assert decode_order(encode_message(order)) == order


@pytest.mark.parametrize(
    "line",
    [
        b"",
        b"{}",
        b'{"type":"fly"}',
        b'{"type":"slew","ra_deg":1}',
        b'{"type":"abort","x":1}',
        b"[" * 10,
        b"\xff",
    ],
)
def test_what_is_no_order_is_refused(line: bytes) -> None:
    with pytest.raises(msgspec.MsgspecError):
        decode_order(line)


def test_an_infinite_jog_does_not_parse_to_a_motion() -> None:
    bench = Bench()
    bench.run(0.5)
    refusal = bench.console.jog(math.inf, None, bench.now_s)
    assert refusal is not None
    assert "rate in right ascension is inf °/s" in refusal.words
    bench.run(0.5)
    assert bench.flags() == []
