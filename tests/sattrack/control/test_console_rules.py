"""A console's rules one by one: what it refuses, what it ends unasked, and what it says of it."""

from __future__ import annotations

import math
from types import SimpleNamespace as Made
from typing import Any

import msgspec
import pytest
from console_builders import PERIOD_S, PROFILE, SITE, T0, Bench
from msgspec.structs import replace

from sattrack.control.aim import MountInstant
from sattrack.control.console import Console
from sattrack.control.manual_operation import ConsoleSession, ManualOperation, OperationPhase, view_of
from sattrack.control.procedures import MoveFor, Once, Outcome, RequestRefused, procedure_for
from sattrack.mount.geometry import AxisGeometry
from sattrack.mount.model import (
    SIDEREAL_RATE_DEG_S,
    AxesPosition,
    Hold,
    MoveAxes,
    SitePlace,
    Slew,
    Status,
    mean_sidereal_deg,
)
from sattrack.mount.requests import Abort, FineRate, MoveAxis, Park, PulseGuide, Sync, TicketState
from sattrack.mount.simulator.mount import StartPosition
from sattrack.mount.simulator.profile import SimulatorProfile
from sattrack.mount.xerxes.datagrams import decode_command, encode_status
from sattrack.mount.xerxes.link import LinkState
from sattrack.safety import SafetyLimits
from sattrack.views.messages import Jog, Leave

NOT_HEARD = RequestRefused("the mount has not been heard yet")
SILENT = RequestRefused("the mount is silent: nothing is moved blindly")
AZIMUTH_MOUNT = msgspec.structs.replace(
    PROFILE,
    geometry=AxisGeometry(0.0, 90.0),
    stands_at=SitePlace(SITE.latitude_deg, SITE.longitude_deg),
    additive=False,
)


def heard(console: Console | ManualOperation, number: int = 1, **changes: Any) -> None:
    """Have a console, or an operation with it, take a status of a mount that stands in the south."""
    at_s = T0 + number * PERIOD_S
    sidereal_h = mean_sidereal_deg(at_s, SITE.longitude_deg) % 360.0 / 15.0
    status = Status(counter=number, sidereal_h=sidereal_h, ra_h=sidereal_h, dec_deg=20.0, altitude_deg=58.0)
    console.receive(encode_status(replace(status, **changes)), at_s)


def console() -> Console:
    return Console(PROFILE, SafetyLimits(), SITE, "bench")


def running(seconds: float = 0.5, **bench: Any) -> Bench:
    made = Bench(**bench)
    made.run(seconds)
    return made


def step_that(state: TicketState | None) -> Any:
    """Return a procedure that asks for nothing and ends so."""
    outcome = None if state is None else Outcome(state, True)
    return Made(doing="made up", begin=lambda *_: None, step=lambda *_: outcome)


class TestRequests:
    def test_while_one_is_carried_out_only_stops_slews_and_parking_are_heard(self) -> None:
        bench = running()
        sidereal_deg = bench.console.session.sample.sidereal_h * 15.0  # type: ignore[union-attr]
        assert bench.console.request(Slew((sidereal_deg - 30.0) % 360.0, 60.0), bench.now_s) is None
        words = "an operation is in progress: SPACE stops it"
        for request in (PulseGuide(100, 0), FineRate(0.001), Sync(10.0, 10.0)):
            assert bench.console.request(request, bench.now_s) == RequestRefused(words)
            assert bench.console.refusal == words
        assert bench.console.request(Slew(sidereal_deg, 50.0), bench.now_s) is None
        assert bench.console.refusal is None
        assert bench.console.request(Park(), bench.now_s) is None
        assert bench.console.request(Abort(), bench.now_s) is None
        assert [one.number for one in bench.console.asked] == [1, 2, 3, 4]
        assert bench.console.stopping

    def test_what_a_procedure_is_refused_is_told_and_what_ran_goes_on(self) -> None:
        bench = running()
        bench.console.begin(step_that(None), bench.now_s)
        before = bench.console.procedure
        no = RequestRefused("no")
        assert bench.console.begin(Made(begin=lambda *_: no), bench.now_s) == no  # type: ignore[arg-type]
        assert (bench.console.refusal, bench.console.procedure) == ("no", before)
        assert bench.console.moving

    def test_what_is_begun_ends_a_jog_at_once(self) -> None:
        bench = running()
        bench.console.jog(None, 0.5, bench.now_s)
        bench.run(0.2)
        assert isinstance(bench.console.session.wanted, MoveAxes)
        bench.console.begin(step_that(None), bench.now_s)
        assert bench.console.session.wanted == Hold()
        assert not bench.console.jogs
        bench.run(1.0)
        assert not bench.moves_itself

    def test_what_is_refused_ends_a_jog_all_the_same(self) -> None:
        """Of two axes the one that is touched later would go on by itself when the other's time is over."""
        bench = running()
        bench.console.jog(None, 0.5, bench.now_s)
        bench.run(0.2)
        bench.console.jog(0.5, None, bench.now_s)
        bench.turn()
        sent = len(bench.commands)
        no = RequestRefused("no")
        assert bench.console.begin(Made(begin=lambda *_: no), bench.now_s) == no  # type: ignore[arg-type]
        assert view_of(bench.console, bench.now_s).doing == "idle"
        bench.run(1.0)
        assert not any(command.move_ra or command.move_dec for command in bench.commands[sent:])
        assert not bench.moves_itself

    def test_what_leaving_would_leave_moving_is_known_from_the_word_to_the_seen_end(self) -> None:
        bench = running()
        assert not bench.console.moving
        bench.console.jog(None, 0.5, bench.now_s)
        # Nothing was sent yet.
        assert bench.console.moving
        bench.run(0.3)
        assert bench.console.moving
        bench.deaf = True
        bench.until(lambda: bench.console.session.wanted == Hold())
        bench.run(0.3)
        assert bench.moves_itself
        assert bench.console.moving
        bench.deaf = False
        bench.run(1.0)
        assert not bench.moves_itself
        assert not bench.console.moving

    def test_no_more_than_five_are_remembered(self) -> None:
        bench = running()
        for _ in range(7):
            bench.console.abort(bench.now_s)
        assert [one.number for one in bench.console.asked] == [3, 4, 5, 6, 7]

    def test_unheard_mounts_are_pointed_nowhere(self) -> None:
        one = console()
        slew = Slew(10.0, 50.0)
        assert one.aim(slew, None, T0) == NOT_HEARD
        # Whether anything is in the way is for later to say.
        assert one.path_to(slew, T0) == (slew,)
        assert one.synced(Sync(10.0, 50.0), T0) == Sync(10.0, 50.0)
        assert (one.looks_at_deg, one.clock_offset_s, one.stands) == (None, None, False)
        refusal = one.submit(MoveAxis(1.0), T0)
        assert isinstance(refusal, RequestRefused)
        assert not refusal.by_safety

    def test_silent_mounts_are_only_stopped(self) -> None:
        bench = running()
        bench.cut = True
        bench.run(2.0)
        assert bench.console.link_state is LinkState.LOST
        for request in (Slew(10.0, 50.0), PulseGuide(100, 0), Park()):
            assert bench.console.request(request, bench.now_s) == SILENT
        assert bench.console.path_to(Slew(10.0, 50.0), bench.now_s) == SILENT
        assert bench.console.request(Abort(), bench.now_s) is None

    @pytest.mark.parametrize(
        ("slewing", "ours", "refused"), [(True, False, True), (True, True, False), (False, False, False)]
    )
    def test_a_mount_that_slews_by_somebody_elses_word_is_not_moved(
        self, slewing: bool, ours: bool, refused: bool
    ) -> None:
        one = console()
        heard(one)
        one.tick(T0 + 0.06)
        if ours:
            assert one.begin(MoveFor(MoveAxis(0.5), 5.0), T0 + 0.07) is None
            one.tick(T0 + 0.1)
            assert one.move_begun
            heard(one, 2)
            # Nothing slews yet: it is to begin.
            assert one.move_begun
            one.session.apply(one.safety.clear(Hold(), 0.0, 0.0, 0.0))
        heard(one, 3, slewing=slewing)
        assert one.move_begun is ours
        asked = one.submit(MoveAxis(0.5), T0 + 0.2)
        assert (asked == RequestRefused("the mount is slewing: stop that first")) is refused
        if ours:
            one.session.apply(one.safety.clear(Hold(), 0.0, 0.0, 0.0))
            heard(one, 4)
            assert not one.move_begun

    @pytest.mark.parametrize("move_axis", ["held", "edge"])
    def test_a_move_has_begun_once_it_is_sent_and_until_something_else_is_asked_for(
        self, move_axis: Any
    ) -> None:
        bench = running(profile=replace(PROFILE, move_axis=move_axis))
        assert bench.console.begin(MoveFor(MoveAxis(None, 0.5), 9.0), bench.now_s) is None
        assert not bench.console.move_begun
        bench.until(lambda: bench.console.move_begun)
        for _ in range(20):
            bench.turn()
            assert bench.console.move_begun
        bench.console.submit(MoveAxis(None, 0.4), bench.now_s)
        assert not bench.console.move_begun

    def test_nothing_is_synced_while_it_moves(self) -> None:
        words = "the mount moves: sync once it stands, or what it reports would be wrong for good"
        one = console()
        heard(one, 1)
        one.tick(T0 + 0.06)
        assert not isinstance(one.submit(Sync(10.0, 50.0), T0 + 0.07), RequestRefused)
        heard(one, 2, slewing=True)
        assert one.submit(Sync(10.0, 50.0), T0 + 0.11) == RequestRefused(words)
        bench = running()
        bench.console.jog(None, 0.5, bench.now_s)
        assert bench.console.submit(Sync(10.0, 50.0), bench.now_s) == RequestRefused(words)


class TestJogs:
    def test_after_a_defect_nothing_is_jogged(self) -> None:
        bench = running()
        bench.console.fail("broken")
        assert bench.console.jog(0.5, None, bench.now_s) == RequestRefused("broken")
        bench.run(0.5)
        assert "abort" in bench.flags()
        assert (bench.console.trouble, bench.console.refusal) == ("error", "broken")

    def test_nothing_is_jogged_beside_an_operation(self) -> None:
        bench = running()
        bench.console.begin(step_that(None), bench.now_s)
        words = "an operation is in progress: SPACE stops it, then jog"
        assert bench.console.jog(0.5, None, bench.now_s) == RequestRefused(words)
        assert bench.console.refusal == words

    def test_a_jog_below_the_horizon_is_safetys_refusal(self) -> None:
        bench = running(start=StartPosition(-30.0, -35.0))
        refusal = bench.console.jog(None, -1.0, bench.now_s)
        assert refusal is not None
        assert refusal.by_safety

    def test_without_a_site_nothing_is_jogged(self) -> None:
        bench = running(site=None)
        refusal = bench.console.jog(None, 0.5, bench.now_s)
        assert refusal is not None
        assert not refusal.by_safety

    def test_the_next_touch_clears_what_was_told(self) -> None:
        bench = running()
        bench.console.refusal, bench.console.trouble = "no", "link"
        assert bench.console.jog(None, 0.2, bench.now_s) is None
        assert (bench.console.refusal, bench.console.trouble) == (None, None)
        assert bench.console.session.wanted == MoveAxes(0.0, 0.2)
        assert view_of(bench.console, bench.now_s).doing == "jogging"


class TestWhatItEndsUnasked:
    def test_a_motion_that_nobody_stands_for_ends(self) -> None:
        bench = running()
        assert not isinstance(bench.console.submit(MoveAxis(None, 0.5), bench.now_s), RequestRefused)
        bench.turn()
        assert bench.console.session.wanted == Hold()
        bench.run(1.0)
        assert not bench.moves_itself

    def test_the_end_of_a_move_that_is_not_seen_within_a_second_is_a_stop(self) -> None:
        bench = running(profile=replace(PROFILE, move_axis="edge"))
        bench.console.jog(None, 0.5, bench.now_s)
        bench.run(0.3)
        bench.deaf = True
        bench.until(lambda: bench.console.session.wanted == Hold())
        ended_s = bench.now_s
        bench.until(lambda: bench.console.trouble is not None)
        assert bench.now_s - ended_s == pytest.approx(1.0, abs=0.11)
        assert (bench.console.trouble, bench.console.refusal) == (
            "move", "the end of the move was not acknowledged: the mount is being stopped"
        )  # fmt: skip
        assert bench.commands[-1].abort
        held = bench.console.jog(None, 0.5, bench.now_s)
        assert held == RequestRefused("stopped: let the key go, and jog once the mount is at rest")
        bench.deaf = False
        bench.run(2.0)
        assert not bench.moves_itself
        # It is the one stop: at rest the mount is let go.
        bench.run(5.0)
        assert bench.console.session.wanted == Hold()

    def test_a_mount_that_falls_silent_in_a_motion_is_stopped_and_later_let_go(self) -> None:
        bench = running()
        assert bench.console.begin(MoveFor(MoveAxis(None, 0.5), 20.0), bench.now_s) is None
        bench.run(1.0)
        bench.cut = True
        bench.until(lambda: bench.console.trouble is not None)
        assert bench.console.trouble == "link"
        assert (bench.console.refusal or "").endswith("; stop commands are being sent")
        assert bench.console.outcome is not None
        assert bench.console.outcome.refusal is not None
        assert not bench.console.outcome.refusal.by_safety
        since_s = bench.console.stopping_since_utc_s
        bench.run(2.0)
        assert bench.console.stopping_since_utc_s == since_s is not None
        bench.cut = False
        bench.until(lambda: not bench.console.stopping)
        assert bench.console.refusal == "bench was silent for a while; it was stopped"
        bench.turn()
        assert bench.console.stopping_since_utc_s is None
        assert view_of(bench.console, bench.now_s).motion == "none"

    def test_a_mount_that_stands_may_fall_silent(self) -> None:
        bench = running()
        bench.cut = True
        bench.run(3.0)
        assert (bench.console.trouble, bench.console.stopping) == (None, False)

    def test_a_stop_that_is_under_way_is_not_named_anew(self) -> None:
        bench = running()
        bench.console.abort(bench.now_s)
        bench.cut = True
        bench.run(3.0)
        assert bench.console.trouble is None

    def test_it_lets_go_some_seconds_after_rest_and_not_while_a_procedure_goes_on(self) -> None:
        bench = running()
        bench.console.abort(bench.now_s)
        bench.until(lambda: bench.console.session.stopped)
        rests_s = bench.now_s
        bench.until(lambda: not bench.console.stopping)
        first_s = bench.now_s - rests_s
        assert 0.4 < first_s < 10.0
        assert bench.console.refusal is None
        bench.console.abort(bench.now_s)
        bench.until(lambda: bench.console.session.stopped)
        bench.console.procedure = step_that(None)
        bench.run(2.0 * first_s)
        assert bench.console.stopping

    def test_fine_rates_are_ended_half_a_minute_before_the_limit_that_they_lead_to(self) -> None:
        bench = running(start=StartPosition(0.0, -34.9), limits=SafetyLimits(optical=False))
        assert bench.console.request(FineRate(0.0, -0.09), bench.now_s) is None
        bench.until(lambda: bench.console.trouble is not None)
        assert bench.console.trouble == "limit:altitude"
        assert "altitude limit" in (bench.console.refusal or "")
        status = bench.console.status
        assert status is not None
        assert status.altitude_deg == pytest.approx(30.0 * 0.09, abs=0.15)
        bench.run(1.0)
        assert bench.commands[-1].dec_fine_rate_dtics_s == 0
        assert "abort" in bench.flags()
        assert not bench.moves_itself

    def test_a_move_into_a_limit_is_named_by_it(self) -> None:
        bench = running(start=StartPosition(0.0, -30.0), limits=SafetyLimits(optical=False))
        assert bench.console.begin(MoveFor(MoveAxis(None, -2.0), 60.0), bench.now_s) is None
        bench.until(lambda: bench.console.trouble is not None)
        assert bench.console.outcome is not None
        assert bench.console.outcome.refusal is not None
        assert bench.console.outcome.refusal.by_safety
        assert (bench.console.lead, bench.console.procedure) == (None, None)
        assert bench.console.reset() == RequestRefused("the mount is not at rest yet")
        bench.run(3.0)
        assert bench.console.reset() is None
        assert (bench.console.trouble, bench.console.refusal) == (None, None)
        assert bench.console.safety.tripped is None

    def test_how_far_the_cables_are_wound_outlasts_a_reset(self) -> None:
        """Turned on from 170° to 190°, of which no single status tells: it says -170°."""
        one = console()
        for number in range(1, 102):
            sidereal_h = mean_sidereal_deg(T0 + number * PERIOD_S, SITE.longitude_deg) / 15.0
            heard(one, number, ra_h=(sidereal_h - (170.0 + 0.2 * (number - 1)) / 15.0) % 24.0, dec_deg=60.0)
        turns_on = MoveAxes(SIDEREAL_RATE_DEG_S - 0.5, 0.0)
        before_s = one.safety.turns_known_s(turns_on)
        assert one.reset() is None
        heard(one, 102, ra_h=(sidereal_h - 190.0 / 15.0) % 24.0, dec_deg=60.0)
        assert one.safety.turns_known_s(turns_on) == pytest.approx(before_s, rel=0.01)

    def test_a_slew_that_has_arrived_is_not_wanted_any_more(self) -> None:
        bench = running()
        sidereal_deg = bench.console.session.sample.sidereal_h * 15.0  # type: ignore[union-attr]
        bench.console.request(Slew((sidereal_deg - 2.0) % 360.0, 22.0), bench.now_s)
        bench.until(lambda: bench.console.outcome is not None)
        assert bench.console.session.wanted == Hold()
        assert not bench.console.moving


class TestClocks:
    def test_the_mounts_clock_is_held_against_its_own_longitude_where_it_tells_one(self) -> None:
        one = console()
        heard(one, 1)
        assert one.clock_offset_s == pytest.approx(0.0, abs=1e-3)
        off_h = 10.0 / 15.0
        sidereal_h = mean_sidereal_deg(T0 + 0.1, SITE.longitude_deg) / 15.0
        heard(one, 2, sidereal_h=(sidereal_h + off_h) % 24.0, site_longitude_deg=SITE.longitude_deg + 10.0)
        # By the fastest datagrams.
        assert one.clock_offset_s == pytest.approx(0.0, abs=1e-3)
        heard(one, 3, site_longitude_deg=SITE.longitude_deg - 1.0)
        assert one.clock_offset_s == pytest.approx(1.0 / SIDEREAL_RATE_DEG_S, abs=0.01)

    def test_only_the_last_hundred_statuses_count(self) -> None:
        one = console()
        heard(one, 1, site_longitude_deg=SITE.longitude_deg - 1.0)
        for number in range(2, 101):
            heard(one, number)
        assert (one.clock_offset_s or 0.0) > 200.0
        heard(one, 101)
        assert one.clock_offset_s == pytest.approx(0.0, abs=1e-3)


class TestAMountWithAGeometry:
    """Its first axis is vertical: the sky's motion takes both axes."""

    def bench(self) -> Bench:
        return running(1.0, profile=AZIMUTH_MOUNT, start=StartPosition(10.0, 50.0))

    def looks(self, bench: Bench) -> tuple[float, float]:
        looks = bench.console.looks_at_deg
        assert looks is not None
        return looks

    def stays(self, bench: Bench) -> bool:
        """Tell whether the telescope stays on its direction for some seconds; the sky turns by 15″ each."""
        (ra, dec), _ = self.looks(bench), bench.run(3.0)
        then = self.looks(bench)
        return abs(math.remainder(then[0] - ra, 360.0)) < 1e-3 and abs(then[1] - dec) < 1e-3

    def test_what_was_never_heard_is_kept_nowhere(self) -> None:
        assert Console(AZIMUTH_MOUNT, SafetyLimits(), SITE, "bench").keep_here(T0) == NOT_HEARD
        one = Console(AZIMUTH_MOUNT, SafetyLimits(), None, "bench")
        refusal = one.keep_here(T0)
        assert refusal is not None
        assert refusal != NOT_HEARD

    def test_it_is_kept_on_the_sky_and_after_a_motion_by_hand_where_it_then_looks(self) -> None:
        bench = self.bench()
        assert not self.stays(bench)
        assert bench.console.keep_here(bench.now_s) is None
        assert view_of(bench.console, bench.now_s).doing == "keeping the telescope on the sky"
        bench.run(1.0)
        assert self.stays(bench)
        before_deg = bench.truth.dec_axis_deg  # type: ignore[union-attr]
        assert bench.console.begin(MoveFor(MoveAxis(None, 0.5), 1.0), bench.now_s) is None
        assert bench.console.lead is None
        # The axis that is left out stands.
        assert bench.console.session.wanted == MoveAxes(SIDEREAL_RATE_DEG_S, 0.5)
        bench.until(lambda: bench.console.outcome is not None)
        bench.run(2.0)
        assert bench.console.lead is not None
        assert bench.truth.dec_axis_deg - before_deg == pytest.approx(0.5, abs=0.1)  # type: ignore[union-attr]
        assert self.stays(bench)

    def test_an_axis_that_is_left_out_goes_on_as_it_went(self) -> None:
        bench = self.bench()
        bench.console.submit(MoveAxis(0.1, None), bench.now_s)
        assert bench.console.session.wanted == MoveAxes(0.1, 0.0)
        bench.console.submit(MoveAxis(None, 0.3), bench.now_s)
        assert bench.console.session.wanted == MoveAxes(0.1, 0.3)
        bench.console.submit(MoveAxis(0.2, None), bench.now_s)
        assert bench.console.session.wanted == MoveAxes(0.2, 0.3)

    def test_a_jog_adds_to_what_keeps_it_there_and_it_is_kept_on_after_it(self) -> None:
        bench = self.bench()
        bench.console.jog(0.2, None, bench.now_s)
        assert bench.console.session.wanted == MoveAxes(SIDEREAL_RATE_DEG_S + 0.2, 0.0)
        bench.run(3.0)
        assert (bench.console.lead, bench.console.session.wanted) == (None, Hold())
        bench.console.keep_here(bench.now_s)
        bench.run(1.0)
        lead = bench.console.lead
        assert lead is not None
        kept = lead.state_at(bench.now_s)
        bench.console.jog(0.5, -0.2, bench.now_s)
        bench.run(0.2)
        wanted = bench.console.session.wanted
        assert isinstance(wanted, MoveAxes)
        assert wanted.ra_rate_deg_s == pytest.approx(kept.ra_rate_deg_s + 0.5, abs=1e-4)
        assert wanted.dec_rate_deg_s == pytest.approx(kept.dec_rate_deg_s - 0.2, abs=1e-4)
        # One axis ends before the other.
        bench.console.jog(0.5, None, bench.now_s)
        bench.console.jogs.end_over(bench.now_s)
        bench.run(3.0)
        assert bench.console.lead not in {None, lead}
        assert self.stays(bench)

    def test_after_what_fails_it_is_kept_nowhere(self) -> None:
        for state, kept in ((TicketState.COMPLETE, True), (TicketState.TIMED_OUT, False)):
            bench = self.bench()
            bench.console.keep_here(bench.now_s)
            bench.console.begin(step_that(state), bench.now_s)
            bench.turn()
            assert bench.console.outcome == Outcome(state, True)
            assert (bench.console.lead is not None) is kept

    def test_what_safety_has_stopped_is_led_nowhere(self) -> None:
        bench = self.bench()
        bench.console.keep_here(bench.now_s)
        lead = bench.console.lead
        bench.console.safety.tripped = "altitude"
        assert bench.console.keep_here(bench.now_s) == RequestRefused("safety has stopped the mount")
        refusal = bench.console.aim(Slew(*self.looks(bench)), None, bench.now_s)
        assert isinstance(refusal, RequestRefused)
        assert refusal.by_safety
        assert refusal.words.startswith("safety has stopped the mount (")
        assert bench.console.lead is lead

    @pytest.mark.parametrize(("goal_deg", "sense"), [(-172.5, 1.0), (-171.5, -1.0)])
    def test_it_is_led_the_short_way_past_half_a_turn_to_2_degrees_of_the_cables_end(
        self, goal_deg: float, sense: float
    ) -> None:
        """From 170° on to 187.5° of 190°, and all the way back where it would be 188.5°."""
        profile = replace(AZIMUTH_MOUNT, hour_angle_limit_deg=190.0)
        one = Console(profile, SafetyLimits(optical=False), SITE, "bench")
        assert one.sky_aim is not None
        for number in range(1, 4):
            at_s = T0 + number * PERIOD_S
            sidereal_deg = mean_sidereal_deg(at_s, SITE.longitude_deg)
            at = MountInstant(at_s, sidereal_deg)
            ra_deg, dec_deg = one.sky_aim.sky_deg(170.0, 45.0, at)
            heard(one, number, ra_h=ra_deg / 15.0, dec_deg=dec_deg)
            one.tick(at_s + 0.01)
        place = AxesPosition(goal_deg, 45.0)
        led = one.aim(Slew(0.0, 45.0), place, T0 + 0.16)
        assert not isinstance(led, RequestRefused)
        one.tick(T0 + 0.16)
        wanted = one.session.wanted
        assert isinstance(wanted, MoveAxes)
        assert math.copysign(1.0, SIDEREAL_RATE_DEG_S - wanted.ra_rate_deg_s) == sense

    def test_what_falls_silent_while_it_is_kept_there_is_stopped_and_led_no_more(self) -> None:
        bench = self.bench()
        bench.console.keep_here(bench.now_s)
        bench.run(1.0)
        bench.cut = True
        bench.until(lambda: bench.console.trouble == "link")
        sent = len(bench.commands)
        bench.run(2.0)
        assert (bench.console.lead, bench.console.stopping) == (None, True)
        assert not any(command.move_ra or command.move_dec for command in bench.commands[sent + 1 :])
        assert any(command.abort for command in bench.commands[sent:])

    def test_what_was_under_way_ends_where_it_is_led(self) -> None:
        bench = self.bench()
        ticket = bench.console.submit(MoveAxis(0.1, 0.2), bench.now_s)
        assert not isinstance(ticket, RequestRefused)
        bench.console.keep_here(bench.now_s)
        assert ticket.state is TicketState.SUPERSEDED
        assert bench.console.session.wanted == Hold()

    def test_a_sitting_that_keeps_it_on_the_sky_ends_in_a_stop(self) -> None:
        bench = self.bench()
        sitting = ConsoleSession(bench.console, bench.now_s)
        for _ in range(10):
            bench.turn(sitting)
        sitting.obey(Slew(*self.looks(bench)), bench.now_s)
        for _ in range(60):
            bench.turn(sitting)
        sitting.obey(Leave(), bench.now_s)
        while not sitting.finished:
            bench.turn(sitting)
        assert sitting.mount_stopped is True


class TestOperations:
    def test_a_stop_never_waits(self) -> None:
        for owned in (False, True):
            operation = ManualOperation(console(), Once(Abort(), "stopping"), T0)
            if owned:
                heard(operation, ack_move_ra=True)
            first = operation.tick(T0 + 0.06)
            assert first is not None
            assert decode_command(first).abort

    def test_what_is_no_status_is_not_heard(self) -> None:
        for part in (
            ManualOperation(console(), MoveFor(MoveAxis(1.0), 1.0), T0),
            ConsoleSession(console(), T0),
        ):
            for number in range(8):
                part.receive(b"noise", T0 + 0.02 * number)
            assert part.tick(T0 + 0.21) is None
            assert not part.finished

    def test_what_keeps_the_telescope_on_the_sky_ends_with_its_operation(self) -> None:
        made: Any = Made(
            profile=PROFILE,
            trouble=None,
            outcome=Outcome(TicketState.COMPLETE, acknowledged=True),
            lead=Made(),
            at_rest=True,
            stopping=True,
            tick=lambda _: b"",
        )
        operation = ManualOperation(made, Once(Sync(1.0, 2.0), "syncing"), T0)
        operation.phase = OperationPhase.RUNNING
        operation.tick(T0 + 1.0)
        assert (operation.ended_by, operation.phase) == ("done", OperationPhase.STOPPING)

    def test_an_operation_is_not_over_before_its_last_datagrams(self) -> None:
        made: Any = Made(profile=PROFILE, session=Made(busy=True), finished=True, tick=lambda _: b"")
        operation = ManualOperation(made, Once(Sync(1.0, 2.0), "syncing"), T0)
        operation.phase = OperationPhase.ENDING
        operation.tick(T0 + 1.0)
        assert not operation.finished
        made.session.busy = False
        operation.tick(T0 + 1.05)
        assert operation.finished

    def test_words_for_what_goes_on(self) -> None:
        bench = Bench()
        operation = ManualOperation(bench.console, MoveFor(MoveAxis(1.0), 1.0), bench.now_s)
        seen = [operation.doing]
        while not operation.finished:
            bench.turn(operation)
            if operation.doing != seen[-1]:
                seen.append(operation.doing)
            if operation.doing == "moving" and bench.moves_itself:
                operation.interrupt(bench.now_s)
        assert seen == ["listening", "moving", "stopping the mount", "over"]

    @pytest.mark.parametrize(
        ("statuses", "after_s", "sends"),
        [(0, 0.49, False), (3, 0.49, False), (0, 0.51, True), (3, 0.51, True), (4, 0.21, True)],
    )
    def test_it_says_nothing_until_four_statuses_came_or_half_a_second_has_passed(
        self, statuses: int, after_s: float, sends: bool
    ) -> None:
        """Who else commands the mount is heard by then; a mount that waits to be spoken to is knocked at."""
        operation = ManualOperation(console(), MoveFor(MoveAxis(1.0), 1.0), T0)
        for number in range(1, statuses + 1):
            heard(operation, number)
        assert (operation.tick(T0 + after_s) is not None) is sends
        assert operation.doing == (
            "listening" if not sends else "moving" if statuses == 4 else "waiting for the mount"
        )
        assert operation.begun is (statuses == 4)

    @pytest.mark.parametrize(
        ("procedure", "at_rest", "state", "stops"),
        [
            (Once(Sync(1.0, 2.0), "syncing"), False, TicketState.FAILED, True),
            (Once(Sync(1.0, 2.0), "syncing"), True, TicketState.FAILED, False),
            (Once(Sync(1.0, 2.0), "syncing"), False, TicketState.COMPLETE, False),
            (Once(Abort(), "stopping"), False, TicketState.FAILED, False),
        ],
    )
    def test_what_failed_with_the_mount_moving_is_followed_by_a_stop(
        self, procedure: Once, at_rest: bool, state: TicketState, stops: bool
    ) -> None:
        """A stop that failed is not asked for anew: it is a stop's own end."""
        made: Any = Made(
            profile=PROFILE,
            trouble=None,
            outcome=Outcome(state, acknowledged=False),
            lead=None,
            at_rest=at_rest,
            stopping=True,
            finished=False,
            session=Made(busy=True),
            tick=lambda _: b"",
        )
        operation = ManualOperation(made, procedure, T0)
        operation.phase = OperationPhase.RUNNING
        operation.tick(T0 + 1.0)
        assert operation.ended_by == "done"
        assert operation.console.stop is not None
        assert operation.console.stop.needed is stops

    def test_an_interrupt_does_not_prolong_a_stop_nor_name_it_anew(self) -> None:
        bench = Bench()
        begun: list[float] = []

        def interrupt(operation: ManualOperation) -> None:
            assert bench.console.stop is not None
            assert operation.phase is OperationPhase.STOPPING
            begun.append(bench.console.stop.begun_utc_s)
            operation.interrupt(bench.now_s)
            begun.append(bench.console.stop.begun_utc_s)

        operation = bench.carry_out(MoveFor(MoveAxis(None, 2.0), 60.0), 1.0, at=((1.4, interrupt),))
        assert (operation.ended_by, operation.mount_stopped) == ("timeout", True)
        assert begun[0] == begun[1]

    def test_what_asked_for_nothing_stops_nothing(self) -> None:
        bench = Bench()
        operation = ManualOperation(bench.console, MoveFor(MoveAxis(1.0), 1.0), bench.now_s)
        bench.turn(operation)
        operation.fail("broken", bench.now_s)
        assert (operation.finished, operation.ended_by, operation.mount_stopped) == (True, "error", None)
        assert operation.tick(bench.now_s) is None
        assert bench.console.stop is not None
        assert not bench.console.stop.needed

    def test_only_the_end_of_a_stop_tells_whether_the_mount_stands(self) -> None:
        bench = Bench()
        for request, stopped in ((Abort(), True), (PulseGuide(100, 0), None)):
            operation = bench.carry_out(procedure_for(request, PROFILE))
            assert (operation.ended_by, operation.mount_stopped) == ("done", stopped)
            bench.console.stop = None

    def test_a_time_out_lets_what_ends_in_time_end(self) -> None:
        for timeout_s, ended_by in ((20.0, "done"), (1.0, "timeout")):
            bench = Bench()
            operation = bench.carry_out(MoveFor(MoveAxis(None, 0.5), 3.0), timeout_s)
            assert operation.ended_by == ended_by
            assert bench.now_s - T0 > timeout_s if ended_by == "timeout" else bench.now_s - T0 > 3.0
        # That the mount has acknowledged the whole is not said of what it did not end.
        assert operation.outcome == Outcome(TicketState.TIMED_OUT, False, "not done within 1 s")

    def test_a_mount_that_falls_silent_after_a_request_may_have_obeyed(self) -> None:
        bench = Bench()
        operation = bench.carry_out(
            procedure_for(PulseGuide(20_000, 0), PROFILE),
            at=((1.0, lambda _: setattr(bench, "cut", True)),),
        )
        assert operation.ended_by == "link"
        assert operation.outcome is not None
        assert (operation.outcome.state, operation.outcome.acknowledged) == (TicketState.FAILED, False)


class TestSittings:
    def sit(self, bench: Bench, seconds: float = 1.0, owner: str | None = None) -> ConsoleSession:
        sitting = ConsoleSession(bench.console, bench.now_s, owner)
        self.go_on(bench, sitting, seconds)
        return sitting

    def go_on(self, bench: Bench, sitting: ConsoleSession, seconds: float) -> None:
        for _ in range(round(seconds / PERIOD_S)):
            bench.turn(sitting)

    @pytest.mark.parametrize(("cut", "listens_s"), [(False, 0.2), (True, 0.5)])
    def test_it_listens_to_four_statuses_or_half_a_second_before_it_says_anything(
        self, cut: bool, listens_s: float
    ) -> None:
        bench = Bench(cut=cut)
        self.sit(bench, listens_s - PERIOD_S)
        assert bench.commands == []
        bench = Bench(cut=cut)
        self.sit(bench, listens_s + PERIOD_S)
        assert len(bench.commands) >= 1

    def test_beside_an_owner_it_looks_on_and_notes_that_a_stop_is_wanted(self) -> None:
        bench = Bench()
        sitting = self.sit(bench, owner="a run")
        sitting.obey(Jog(0.5, None), bench.now_s)
        assert bench.console.refusal == "this mount has another owner"
        assert not sitting.stop_wanted
        bench.console.refusal = None
        sitting.obey(Abort(), bench.now_s)
        assert (sitting.stop_wanted, bench.console.refusal) == (True, None)
        sitting.obey(Jog(0.5, None), bench.now_s)
        assert sitting.stop_wanted
        self.go_on(bench, sitting, 1.0)
        assert not sitting.finished
        warnings = sitting.view(bench.now_s).warnings
        assert warnings[0] == "looking on; SPACE has the mount's owner stop it and end: a run"
        bench.console.jog(0.5, None, bench.now_s)
        sitting.obey(Leave(), bench.now_s)
        bench.turn(sitting)
        assert (sitting.finished, sitting.mount_stopped, bench.commands) == (True, None, [])

    @pytest.mark.parametrize("asked", [True, False])
    def test_a_defect_stops_what_was_asked_for(self, asked: bool) -> None:
        bench = Bench()
        sitting = self.sit(bench)
        if asked:
            sitting.obey(Jog(0.5, None), bench.now_s)
            self.go_on(bench, sitting, 0.2)
        sitting.fail("broken", bench.now_s)
        while not sitting.finished:
            bench.turn(sitting)
        assert sitting.mount_stopped is (True if asked else None)
        assert not bench.moves_itself

    def test_a_defect_in_leaving_does_not_prolong_it(self) -> None:
        bench = Bench()
        sitting = self.sit(bench)
        sitting.obey(Jog(0.5, None), bench.now_s)
        self.go_on(bench, sitting, 0.2)
        sitting.obey(Leave(), bench.now_s)
        begun_s = bench.now_s
        assert sitting.leaving
        bench.turn(sitting)
        sitting.interrupt(bench.now_s)
        sitting.fail("broken", bench.now_s)
        assert bench.console.stop is not None
        assert bench.console.stop.begun_utc_s == begun_s

    def test_leaving_sees_a_stop_through_that_is_under_way(self) -> None:
        bench = Bench()
        sitting = self.sit(bench)
        sitting.obey(Jog(2.0, None), bench.now_s)
        self.go_on(bench, sitting, 0.3)
        sitting.obey(Abort(), bench.now_s)
        bench.console.procedure = None
        sitting.obey(Leave(), bench.now_s)
        while not sitting.finished:
            bench.turn(sitting)
        assert sitting.mount_stopped is True


class TestViews:
    def words(self, bench: Bench) -> str:
        return " | ".join(view_of(bench.console, bench.now_s).warnings)

    def test_before_the_mount_is_heard(self) -> None:
        view = view_of(console(), T0)
        assert (view.status, view.hour_angle_deg, view.guide_rate_deg_s) == (None, None, None)
        assert (view.doing, view.motion, view.warnings, view.can_park) == ("idle", "none", (), True)

    def test_numbers_of_a_mount_at_rest(self) -> None:
        bench = running(2.0, start=StartPosition(-170.0, 60.0))
        view = view_of(bench.console, bench.now_s)
        assert view.hour_angle_deg == pytest.approx(-170.0, abs=0.01)
        # 3500 tenths of tics a second, 2^26 tics a turn: the paper.
        assert view.status is not None
        assert view.guide_rate_deg_s == pytest.approx(
            (view.status.ra_guide_rate_dtics_s or 0.0) * 360.0 / 2**26 / 10.0
        )
        assert (view.ra_rate_deg_s, view.dec_rate_deg_s, view.link.state) == (0.0, 0.0, "up")
        assert (view.utc_s, view.mount, view.at_rest) == (bench.now_s, "bench", True)
        assert self.words(bench) == ""

    def test_a_jog_shows_its_rates(self) -> None:
        bench = running()
        bench.console.jog(0.25, -0.2, bench.now_s)
        view = view_of(bench.console, bench.now_s)
        assert (view.doing, view.motion) == ("jogging", "move")
        assert (view.ra_rate_deg_s, view.dec_rate_deg_s) == (0.25, -0.2)

    def test_rates_by_hand_grow_to_what_was_asked_last_of_either_axis(self) -> None:
        """10 °/s² make 0.25 °/s a period; the other axis keeps what it was to grow to."""
        bench = running()
        bench.console.begin(MoveFor(MoveAxis(None, 2.0), 20.0), bench.now_s)
        bench.run(0.2)
        growing = bench.console.session.wanted
        assert isinstance(growing, MoveAxes)
        assert 0.5 < growing.dec_rate_deg_s < 1.5
        bench.console.submit(MoveAxis(-1.0, None), bench.now_s)
        bench.run(0.6)
        assert bench.console.session.wanted == MoveAxes(-1.0, 2.0)
        bench.console.submit(MoveAxis(None, 0.1), bench.now_s)
        bench.run(0.05)
        assert bench.console.session.wanted == MoveAxes(-1.0, 0.1)

    def test_what_was_asked_shows_how_far_it_has_come(self) -> None:
        bench = running(limits=SafetyLimits(floor_altitude_deg=12.0))
        sidereal_deg = bench.console.session.sample.sidereal_h * 15.0  # type: ignore[union-attr]
        bench.console.request(Slew((sidereal_deg - 2.0) % 360.0, 22.0), bench.now_s)
        seen = []

        def shown() -> bool:
            (asked,) = view_of(bench.console, bench.now_s).asked
            if (asked.acknowledged, asked.settled) not in seen:
                seen.append((asked.acknowledged, asked.settled))
            return asked.settled

        bench.until(shown)
        assert seen == [(False, False), (True, False), (True, True)]
        assert view_of(bench.console, bench.now_s).floor_altitude_deg == 12.0

    def test_silence_is_a_warning_once_it_lasts(self) -> None:
        bench = running()
        assert "silent" not in self.words(bench)
        bench.cut = True
        bench.run(2.0)
        assert "bench is silent: check its power and the cable" in self.words(bench)

    def test_a_stop_that_is_not_confirmed_within_a_second_is_a_warning(self) -> None:
        overdue = "the stop is not confirmed yet: it is being sent again and again"
        bench = running()
        bench.console.jog(0.5, None, bench.now_s)
        bench.run(0.2)
        bench.deaf = True
        bench.console.abort(bench.now_s)
        assert view_of(bench.console, bench.now_s).doing == "stopping"
        bench.run(0.9)
        assert overdue not in self.words(bench)
        bench.run(0.3)
        assert overdue in self.words(bench)
        bench.deaf = False
        bench.until(lambda: bench.console.session.stopped)
        assert overdue not in self.words(bench)

    def test_what_tripped_the_way_and_strangers_are_warnings(self) -> None:
        bench = running()
        bench.console.safety.tripped = "altitude"
        bench.console.way_trouble = "the way is gone"
        bench.console.stranger_hosts = ("10.0.0.1", "10.0.0.2")
        words = self.words(bench)
        assert "safety stopped the mount at its altitude limit" in words
        assert "the way is gone" in words
        assert "datagrams from 10.0.0.1, 10.0.0.2 were dropped: they are not from the mount" in words

    @pytest.mark.parametrize(
        ("off_s", "words"),
        [(1.9, ""), (-1.9, ""), (2.5, "the mount's clock is 2.5 s ahead"), (-2.5, "is 2.5 s behind: its")],
    )
    def test_a_clock_that_is_off_is_a_warning(self, off_s: float, words: str) -> None:
        bench = running(hardware=SimulatorProfile(clock_offset_s=off_s))
        assert words in self.words(bench)
        assert ("clock" in self.words(bench)) is bool(words)

    def test_words_are_cut_where_a_pipe_would_cut_them(self) -> None:
        bench = running()
        bench.console.refusal = bench.console.way_trouble = "x" * 200
        view = view_of(bench.console, bench.now_s)
        assert (len(view.refusal or ""), len(view.warnings[-1])) == (160, 160)
