"""A run as one thing, by hand: what counts in its figures, what makes it give up, and what it then sends."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace as Made
from typing import Any
from unittest.mock import patch

import msgspec
import pytest

from sattrack.control.driver import limit_text
from sattrack.control.engine import Engine, RunSpec
from sattrack.control.engine_view import view_of
from sattrack.control.estimate import Estimator
from sattrack.control.rest import Rest
from sattrack.control.target import sky_error
from sattrack.control.tracker import Phase, TrackPlan
from sattrack.mount.geometry import AxisGeometry
from sattrack.mount.model import (
    SIDEREAL_RATE_DEG_S,
    AxisLimits,
    MountProfile,
    MoveAxes,
    SitePlace,
    Slew,
    Status,
    Stop,
    mean_sidereal_deg,
)
from sattrack.mount.xerxes.datagrams import decode_command, encode_status
from sattrack.mount.xerxes.flags import SlewState
from sattrack.mount.xerxes.link import LinkState
from sattrack.runtime import demo_pass
from sattrack.safety import SafetyLimits
from sattrack.safety.watch import KEEPS_FIRST, SEE_TO_DRIVE
from sattrack.views.messages import Jog, Pause
from sattrack.views.run import ErrorView
from tle.bias import NO_BIAS
from tle.bodies import Body, StarPlace
from tle.instants import Utc
from tle.propagator import Propagator
from tle.refraction import Refraction

CULMINATION_S = float(Utc.parse("2026-10-02T13:05:24Z").unix_s)
PLAN = TrackPlan(CULMINATION_S - 100.0, CULMINATION_S + 100.0)
SITE = demo_pass.SITE.place()


def engine(**profile: Any) -> Engine:
    airless = Propagator(demo_pass.elements(), SITE)
    bent = Propagator(demo_pass.elements(), SITE, refraction=Refraction.standard(0.0))
    limits = SafetyLimits(optical=False)
    made = MountProfile(**profile)
    spec = RunSpec(
        bent,
        airless,
        CULMINATION_S,
        70.0,
        PLAN,
        made,
        limits,
        NO_BIAS,
        "bench",
        CULMINATION_S,
        simulated=True,
    )
    return Engine(spec)


def hear(run: Engine, number: int = 0, **changes: Any) -> None:
    """Have a run take a status of a mount that stands on the satellite."""
    hear_at(run, CULMINATION_S + 0.05 * number, number, **changes)


def hear_at(run: Engine, utc_s: float, number: int, **changes: Any) -> None:
    """The same at an instant."""
    there = run.tracker.direction_at(utc_s)
    status = Status(
        counter=number + 1,
        sidereal_h=mean_sidereal_deg(utc_s, SITE.longitude_deg) % 360.0 / 15.0,
        ra_h=float(there.ra_deg) / 15.0,
        dec_deg=float(there.dec_deg),
        altitude_deg=float(there.alt_deg),
        site_latitude_deg=SITE.latitude_deg,
        site_longitude_deg=SITE.longitude_deg,
    )
    run.receive(encode_status(msgspec.structs.replace(status, **changes)), utc_s + 1e-4)


def off(arcsec: float, number: int = 0) -> ErrorView:
    return ErrorView(CULMINATION_S + 0.05 * number, arcsec, 0.6 * arcsec, 0.8 * arcsec, 0.0, 0.0)


class TestFigures:
    def following(self) -> Engine:
        run = engine()
        run.tracker.phase, run.tracker.acquired_utc_s = Phase.TRACKING, CULMINATION_S - 10.0
        return run

    def test_errors_count_while_it_follows_and_those_within_two_arcseconds_are_on_target(self) -> None:
        run = self.following()
        for number, arcsec in enumerate((3.0, 1.0, 2.0)):
            run._count(off(arcsec, number), number, 0.05)
        assert run.on_target_s == pytest.approx(0.1)
        assert run.reported.rms_arcsec == pytest.approx(math.sqrt((9.0 + 1.0 + 4.0) / 3.0))
        assert run.rms_10s_arcsec == pytest.approx(math.sqrt((9.0 + 1.0 + 4.0) / 3.0))
        assert (run.held_s, run.paused_s, run.rejoining_s, run.lost_peak_arcsec) == ({}, 0.0, 0.0, 0.0)
        assert [(one.doing, one.held_by) for one in run.stages] == [("following", None)]

    def test_a_limit_a_pause_and_the_way_back_are_counted_apart(self) -> None:
        run = self.following()
        run._count(off(1.0), 1, 0.05)
        run.safety = Made(holding="sun")  # type: ignore[assignment]
        for number in (1, 2):
            run._count(off(500.0, number), number, 0.05)
        assert run.phase == "holding"
        run.safety = Made(holding=None)  # type: ignore[assignment]
        run._count(off(900.0, 3), 3, 0.05)
        run._count(off(1.5, 4), 4, 0.05)
        run.tracker.rest = Rest(CULMINATION_S, run.profile)
        run._count(off(4000.0, 5), 5, 0.05)
        assert run.held_s == {"sun": pytest.approx(0.1)}
        assert (run.paused_s, run.rejoining_s) == (pytest.approx(0.05), pytest.approx(0.05))
        # What is far off in a pause is no loss.
        assert run.lost_peak_arcsec == 900.0
        assert run.reported.rms_arcsec == pytest.approx(math.sqrt((1.0 + 2.25) / 2.0))
        assert run.rms_10s_arcsec is None
        assert [(one.doing, one.held_by) for one in run.stages] == [
            ("following", None),
            ("held", "sun"),
            ("rejoining", None),
            ("following", None),
            ("paused", None),
        ]

    def test_a_limit_before_the_mount_was_ever_on_target_loses_nothing(self) -> None:
        run = engine()
        run.tracker.phase = Phase.ACQUIRING
        run.safety = Made(holding="sun", clamping=False, keeps_first=False)  # type: ignore[assignment]
        run._count(off(500.0, 1), 1, 0.05)
        assert (run.held_s, run.lost_peak_arcsec) == ({"sun": 0.05}, 0.0)

    def test_true_errors_are_those_of_the_statuses_that_counted_once(self) -> None:
        run = self.following()
        run._count(off(1.0), 7, 0.05)
        there = run.tracker.fed_at(CULMINATION_S)
        beside = float(there.dec_deg) + 1.0 / 3600.0
        true = run.true_error(7, CULMINATION_S, float(there.ra_deg), beside)
        assert true is not None
        assert true.total_arcsec == pytest.approx(1.0, abs=1e-4)
        assert run.true_error(7, CULMINATION_S, float(there.ra_deg), beside) is None
        run._count(off(1.0, 1), 8, 0.05)
        run.failed = True
        assert run.true_error(8, CULMINATION_S, float(there.ra_deg), beside) is None

    def test_statuses_far_apart_count_for_nothing(self) -> None:
        run = self.following()
        for number in (0, 1, 101, 102):
            hear(run, number)
        assert run.on_target_s == pytest.approx(0.1, abs=0.01)


class TestGivingUp:
    def test_statuses_of_another_kind_than_the_profile_says_are_another_mounts(self) -> None:
        run = engine(name="mine", readings={"ra_rate_dtics_s": "double"})
        hear(run, ra_rate_dtics_s=7789)
        assert (run.tracker.ended_by, run.tracker.phase) == ("error", Phase.STOPPING)
        assert run.message == (
            "the profile 'mine' is another mount's: it says that ra_rate_dtics_s is double, and bench sends "
            "int64; give this mount's profile"
        )
        assert run.why_not_acquired() == run.message
        assert engine_that_is_right().tracker.ended_by is None

    @pytest.mark.parametrize(
        ("ratios", "seconds", "move_axis", "named"),
        [
            ((0.5, 0.5), 5.1, "edge", True),
            ((0.5, None), 5.1, "edge", True),
            # The flag is up for a third of the time.
            ((0.33, 0.33), 5.1, "edge", True),
            ((0.5, 0.5), 4.9, "edge", False),
            ((0.5, 0.5), 5.1, "held", False),
            ((0.5, 0.9), 5.1, "edge", False),
            ((0.1, 0.5), 5.1, "edge", False),
            ((None, None), 5.1, "edge", False),
        ],
    )
    @pytest.mark.parametrize(("answered", "longer_s"), [(True, 0.0), (False, 10.0)])
    def test_a_mount_that_moves_only_while_the_flag_is_up_takes_no_edges(
        self, ratios: Any, seconds: float, move_axis: Any, named: bool, answered: bool, longer_s: float
    ) -> None:
        """Where it acknowledges no edge, the first ones last, and it is watched for longer."""
        run = engine(move_axis=move_axis)
        if answered:
            run.session._answers.take(True)
        run.tracker.phase = Phase.ACQUIRING
        run.tracker.follower.learning = Made(  # type: ignore[assignment]
            fits=[Made(ratio=one) for one in ratios], times_begun_anew=0, forget_rates=lambda: None
        )
        run._count(off(50.0), 1, seconds + longer_s)
        assert (run.tracker.ended_by == "error") is named
        words = "bench moves only while the MoveAxis flag is up: move_axis is held"
        assert (run.message or "").startswith(words) is named

    @pytest.mark.parametrize(
        ("move_axis", "cause", "acquired", "words"),
        [
            ("edge", None, False, "perhaps move_axis is held, not edge"),
            ("edge", f"declination does not move as commanded: {SEE_TO_DRIVE}", False, "perhaps"),
            ("held", None, False, "perhaps move_axis is edge, not held"),
            ("edge", "turn dec_rate_sign in the profile", False, None),
            ("edge", None, True, None),
        ],
    )
    def test_a_mount_that_never_obeyed_may_be_of_the_other_kind(
        self, move_axis: Any, cause: str | None, acquired: bool, words: str | None
    ) -> None:
        run = engine(move_axis=move_axis)
        run.tracker.acquired_utc_s = CULMINATION_S if acquired else None
        run.safety = Made(tripped="obedience", cause=cause)  # type: ignore[assignment]
        plain = limit_text("obedience", cause)
        why = run._why_tripped(plain)
        assert why == plain if words is None else words in why
        assert why.startswith("safety stopped the mount at its obedience limit")
        assert cause is None or why.startswith(plain)
        run.safety = Made(tripped="sun", cause=cause)  # type: ignore[assignment]
        assert run._why_tripped("the Sun") == "the Sun"

    def test_a_mount_that_keeps_the_first_rates_is_not_followed_with(self) -> None:
        run = engine()
        run.tracker.phase = Phase.ACQUIRING
        run.safety = Made(holding=None, clamping=False, keeps_first=True)  # type: ignore[assignment]
        run._count(off(50.0), 1, 0.05)
        assert (run.tracker.ended_by, run.message) == ("error", f"bench was sent a stop: {KEEPS_FIRST}")

    def test_what_it_never_heard_it_waits_for_so_long_and_then_stops(self) -> None:
        run = engine()
        run.tick(CULMINATION_S)
        assert (run.why_not_acquired() or "").startswith("the mount was never heard")
        run.tick(CULMINATION_S + 3.0)
        assert run.tracker.ended_by is None
        run.tick(CULMINATION_S + 3.1)
        assert (run.tracker.ended_by, run.link_state) == ("link", LinkState.SILENT)
        assert (run.message or "").startswith("no status from bench within 3 s; ")
        assert decode_command(run.tick(CULMINATION_S + 3.2)).abort

    def test_what_comes_is_given_back_as_a_sample_unless_it_is_refused(self) -> None:
        run = engine()
        assert run.receive(encode_status(Status(counter=3, dec_deg=20.0)), CULMINATION_S).dec_deg == 20.0
        assert run.receive(b"", CULMINATION_S + 0.05) is None

    def test_a_mount_that_falls_silent_is_sent_stops(self) -> None:
        run = engine()
        for number in range(3):
            hear(run, number)
            run.tick(CULMINATION_S + 0.05 * number + 0.03)
        run.tick(CULMINATION_S + 9.0)
        assert (run.tracker.ended_by, run.link_state) == ("link", LinkState.LOST)
        assert (run.message or "").endswith("; stop commands were sent")
        assert decode_command(run.tick(CULMINATION_S + 9.05)).abort

    def test_after_a_defect_nothing_but_a_stop_is_sent(self) -> None:
        run = engine()
        hear(run)
        run.tick(CULMINATION_S + 0.03)
        run.fail("broken")
        assert (run.message, run.tracker.ended_by, run.tracker.phase) == ("broken", "error", Phase.STOPPING)
        before = run.tracker.error
        hear(run, 1)
        assert run.tracker.error is before
        assert decode_command(run.tick(CULMINATION_S + 0.08)).abort
        run.prepare(CULMINATION_S + 0.08)
        assert (run.repeat(), run.send_shift_s(CULMINATION_S)) == (None, 0.0)

    @pytest.mark.parametrize(("failed", "ended_by"), [(True, None), (False, "set"), (False, None)])
    def test_nothing_is_repeated_once_it_failed_or_has_ended(
        self, failed: bool, ended_by: str | None, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        run = engine()
        monkeypatch.setattr(type(run.session), "repeat", lambda _: b"again")
        run.failed, run.tracker.ended_by = failed, ended_by
        assert run.repeat() == (None if failed or ended_by else b"again")

    def test_a_pass_that_ends_on_the_way_to_it_says_so(self) -> None:
        run = engine()
        for number, late_s in enumerate((-60.0, -59.95, -59.9, 0.1, 0.15)):
            utc_s = PLAN.end_utc_s + late_s
            there = run.tracker.direction_at(utc_s)
            hear_at(run, utc_s, number, ra_h=(float(there.ra_deg) + 60.0) % 360.0 / 15.0, dec_deg=20.0)
            run.tick(utc_s + 0.03)
        assert (run.tracker.phase, run.tracker.ended_by) == (Phase.STOPPING, "set")
        assert (run.why_not_acquired() or "").startswith("the mount was still slewing")

    @pytest.mark.parametrize("clamping", [False, True])
    def test_a_target_is_called_too_fast_only_where_the_rate_limit_was_reached(self, clamping: bool) -> None:
        run = engine()
        hear(run)
        run.tracker.phase = Phase.ACQUIRING
        run.safety = Made(holding=None, clamping=clamping, keeps_first=False)  # type: ignore[assignment]
        for number in range(60):
            run._count(off(50.0, number), number, 0.05)
        words = "the target was faster than the axes may turn"
        assert (words in (run.why_not_acquired() or "")) is clamping

    def test_a_mount_that_moves_as_no_servo_is_told_by_how_much_each_axis_was_off(self) -> None:
        run = engine()
        hear(run)
        run.tracker.phase = Phase.ACQUIRING
        for number in range(60):
            run._count(off(50.0, number), number, 0.05)
        learning = run.tracker.follower.learning
        learning.axes, learning.restarts = run.tracker.follower.axes, 3
        words = "off by 30″ in right ascension and 40″ in declination"
        assert words in (run.why_not_acquired() or "")

    @pytest.mark.parametrize("simulated", [False, True])
    def test_only_a_simulated_mount_need_not_be_calibrated(self, simulated: bool) -> None:
        run = Engine(replace(engine().spec, simulated=simulated))
        hear(run)
        why = run.why_not_acquired() or ""
        assert why.startswith("it followed for 0.0 s only")
        assert ("the mount is not calibrated" in why) is not simulated

    def test_how_late_axes_answer_is_held_against_the_slower_one_of_the_profile(self) -> None:
        run = engine(ra=AxisLimits(lag_s=0.1), dec=AxisLimits(lag_s=0.3))
        asked: list[float] = []
        hear(run)
        run.tracker.follower.learning.timing.later_s = asked.append  # type: ignore[method-assign, assignment]
        run.why_not_acquired()
        assert asked == [0.3]

    @pytest.mark.parametrize(("name", "told"), [("obedience", "it turns the wrong way"), ("sun", None)])
    def test_a_limit_that_stopped_the_mount_is_named_and_why_it_disobeyed(
        self, name: str, told: str | None, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        run = engine()
        hear(run)
        run.tick(CULMINATION_S + 0.03)
        monkeypatch.setattr(type(run.safety), "cause", "it turns the wrong way")
        run.safety.tripped = name
        sent = decode_command(run.tick(CULMINATION_S + 0.08))
        assert (run.tracker.ended_by, run.message) == (f"limit:{name}", limit_text(name, told))
        assert sent.abort

    def test_a_limit_at_the_end_is_not_what_ended_the_run(self) -> None:
        run = engine()
        hear(run)
        run.tracker.end("operator")
        run.safety.tripped = "sun"
        run.tick(CULMINATION_S + 0.03)
        assert (run.tracker.ended_by, run.message) == ("operator", None)

    @pytest.mark.parametrize("trouble", ["got 3 slew commands, and stands 2.0° from its goal", None])
    def test_a_way_that_was_given_up_says_what_the_mount_did(
        self, trouble: str | None, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        run = engine()
        hear(run)
        monkeypatch.setattr(type(run.tracker), "trouble", trouble)
        run.tracker.end("error")
        run.tick(CULMINATION_S + 0.03)
        assert run.message == f"bench {trouble or 'did not obey'}; it was sent a stop"

    def test_why_it_was_never_on_target_is_the_message_unless_it_was_ended(self) -> None:
        run = engine()
        hear(run)
        run.tracker.ended_by, run.message = "limit:sun", "the Sun"
        assert run.why_not_acquired() == "the Sun"
        run.tracker.ended_by = "operator"
        assert "the operator ended the run" in (run.why_not_acquired() or "")
        run.tracker.acquired_utc_s = CULMINATION_S
        assert run.why_not_acquired() is None


def engine_that_is_right() -> Engine:
    run = engine(readings={"ra_rate_dtics_s": "int64"})
    hear(run, ra_rate_dtics_s=7789)
    return run


def test_a_mount_that_refracts_itself_is_fed_what_has_no_air_in_it() -> None:
    plain, refracting = engine(), engine()
    hear(plain)
    hear(refracting, does_refraction=True)
    late_s = CULMINATION_S + 90.0
    lifted = float(plain.tracker.direction_at(late_s).alt_deg) - float(
        refracting.tracker.direction_at(late_s).alt_deg
    )
    altitude = float(refracting.tracker.direction_at(late_s).alt_deg)
    # Air lifts by an arcminute at 45°.
    assert lifted * 3600.0 == pytest.approx(58.0 / math.tan(math.radians(altitude)), rel=0.05)
    hear(refracting, 1, does_refraction=False)
    assert refracting.tracker.steering.biases.course.propagator is refracting.spec.if_mount_refracts


def test_a_pass_is_held_at_a_limit_and_not_ended_there() -> None:
    """On the meridian at an altitude of half a degree, going down at 2°/s."""
    run = engine()
    hear(run)
    dec_deg = SITE.latitude_deg - 90.0 + 0.5
    sidereal_deg = mean_sidereal_deg(CULMINATION_S, SITE.longitude_deg) % 360.0
    down = MoveAxes(SIDEREAL_RATE_DEG_S, -2.0)
    cleared = run.safety.clear(down, sidereal_deg, sidereal_deg, dec_deg, 0.0, CULMINATION_S)
    assert isinstance(cleared.motion, MoveAxes)
    assert cleared.motion.dec_rate_deg_s > -0.5
    assert (run.safety.holding, run.safety.tripped) == ("altitude", None)


def test_a_paused_mount_to_which_the_sun_has_come_is_slewed_out_of_its_way() -> None:
    sun = Propagator(Body("Sun"), SITE).at(Utc(CULMINATION_S))
    run = engine()
    guarded = Engine(replace(run.spec, limits=SafetyLimits()))
    for number in range(3):
        hear(guarded, number, ra_h=float(sun.ra_deg) / 15.0, dec_deg=float(sun.dec_deg) + 3.0)
        guarded.operate(Pause(), CULMINATION_S + 0.05 * number)
        guarded.tick(CULMINATION_S + 0.05 * number + 0.03)
    rest = guarded.tracker.rest
    assert rest is not None
    rest.at_rest = True
    guarded.tick(CULMINATION_S + 0.2)
    wanted = guarded.session.wanted
    assert isinstance(wanted, Slew)
    away = sky_error(CULMINATION_S, wanted.ra_deg, wanted.dec_deg, sun)
    assert away.total_arcsec > SafetyLimits().sun_deg * 3600.0
    assert guarded.led_out


def test_what_the_first_observation_would_wait_for_is_computed_beforehand() -> None:
    """At both ends of the pass."""
    with patch.object(Estimator, "reading", autospec=True, side_effect=Estimator.reading) as reading:
        engine().expect_observations()
    looked = [call.args[1] for call in reading.call_args_list]
    assert looked == [PLAN.start_utc_s, PLAN.end_utc_s]


@pytest.mark.parametrize(("limit_deg", "sense"), [(275.0, -1.0), (270.0, 1.0)])
def test_a_slew_leads_to_the_turn_on_which_the_whole_pass_fits(limit_deg: float, sense: float) -> None:
    """A pass goes from an azimuth of -101° to one of -270°; none may end within 2° of the cables' end."""
    geometry = AxisGeometry(180.0, 90.0, reports="axes")
    run = engine(
        geometry=geometry,
        stands_at=SitePlace(SITE.latitude_deg, SITE.longitude_deg),
        hour_angle_limit_deg=limit_deg,
    )
    for number in range(5):
        utc_s = PLAN.start_utc_s + 0.05 * number
        sidereal_deg = mean_sidereal_deg(utc_s, SITE.longitude_deg)
        hear_at(run, utc_s, number, ra_h=(sidereal_deg + 50.0) % 360.0 / 15.0, dec_deg=45.0)
        run.tick(utc_s + 0.03)
    wanted = run.session.wanted
    assert isinstance(wanted, MoveAxes)
    assert math.copysign(1.0, SIDEREAL_RATE_DEG_S - wanted.ra_rate_deg_s) == sense
    # It is on its way by a slew, though by rates that stand for one.
    assert run.tracker.phase is Phase.SLEWING


class TestPauses:
    def test_jogs_are_refused_while_the_mount_is_not_heard(self) -> None:
        run = engine()
        run.operate(Jog(0.1, None), CULMINATION_S)
        assert run.tracker.steering.refusal == "the mount is not heard: nothing is moved blindly"
        run.link_state = LinkState.UP
        run.operate(Jog(0.1, None), CULMINATION_S)
        assert run.tracker.steering.refusal == "the run is not paused: pause it first"

    @pytest.mark.parametrize("holding", [None, "altitude"])
    def test_the_tracker_hears_whether_a_limit_holds_the_mount(
        self, holding: str | None, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """It slews round what is in the way then."""
        run, heard = engine(), []
        hear(run)
        run.safety.holding = holding

        def step(now_utc_s: float, arrived: bool, stopped: bool, held: bool) -> Stop:
            heard.append(held)
            return Stop()

        monkeypatch.setattr(run.tracker, "step", step)
        run.tick(CULMINATION_S + 0.05)
        assert heard == [holding is not None]

    @pytest.mark.parametrize(
        ("slew_state", "led_there", "on_last_leg", "arrived"),
        [
            (SlewState.DONE, False, True, True),
            (SlewState.UNDER_WAY, True, True, True),
            (SlewState.UNDER_WAY, False, True, False),
            (SlewState.DONE, False, False, False),
            (SlewState.UNDER_WAY, True, False, False),
        ],
    )
    def test_the_tracker_hears_that_a_slew_or_rates_for_it_have_come_to_the_end_of_the_last_leg(
        self,
        slew_state: SlewState,
        led_there: bool,
        on_last_leg: bool,
        arrived: bool,
        monkeypatch: pytest.MonkeyPatch,
    ) -> None:
        run, heard = engine(), []
        hear(run)
        run.safety.led_there = led_there
        monkeypatch.setattr(type(run.safety), "on_last_leg", on_last_leg)
        monkeypatch.setattr(type(run.session), "slew_state", slew_state)
        monkeypatch.setattr(
            run.tracker, "step", lambda _now, there, _stopped, _held: heard.append(there) or Stop()
        )
        run.tick(CULMINATION_S + 0.05)
        assert heard == [arrived]

    @pytest.mark.parametrize("stopped", [False, True])
    @pytest.mark.parametrize("paused", [False, True])
    def test_the_tracker_hears_that_the_mount_has_stopped_while_it_is_paused(
        self, paused: bool, stopped: bool, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        run, heard = engine(), []
        hear(run)
        if paused:
            run.operate(Pause(), CULMINATION_S)
        monkeypatch.setattr(type(run.session), "stopped", stopped)
        monkeypatch.setattr(
            run.tracker, "step", lambda _now, _arrived, rests, _held: heard.append(rests) or Stop()
        )
        run.tick(CULMINATION_S + 0.05)
        assert heard == [paused and stopped]

    def test_a_jog_ends_at_a_limit_and_says_at_which(self) -> None:
        run = engine()
        hear(run)
        run.operate(Pause(), CULMINATION_S)
        rest = run.tracker.rest
        assert rest is not None
        for late_s in (0.0, 0.3):
            rest.step(CULMINATION_S + late_s, True)
        assert rest.jog(Jog(0.5, None), CULMINATION_S + 0.3) is None
        assert rest.jogging is True
        cleared: Any = Made(motion=Stop())
        assert run._end_jogs(cleared, CULMINATION_S + 0.3) is cleared
        assert rest.jogging is True
        run.safety.holding = "altitude"
        assert run._end_jogs(cleared, CULMINATION_S + 0.3).motion == Stop()
        assert rest.jogging is False
        words = "the jog was ended at the altitude limit ("
        assert (run.tracker.steering.refusal or "").startswith(words)
        assert (run.tracker.steering.refusal or "").endswith("): let the key go, and jog away")

    def test_what_is_jogged_into_a_limit_stops_there(self) -> None:
        """On the meridian, half a degree above the horizon."""
        run = engine()

        def low(number: int) -> None:
            sidereal_h = mean_sidereal_deg(CULMINATION_S + 0.05 * number, SITE.longitude_deg) % 360.0 / 15.0
            hear(run, number, ra_h=sidereal_h, dec_deg=SITE.latitude_deg - 89.5, altitude_deg=0.5)
            run.tick(CULMINATION_S + 0.05 * number + 0.03)

        low(0)
        run.operate(Pause(), CULMINATION_S)
        rest = run.tracker.rest
        assert rest is not None
        for late_s in (0.0, 0.3):
            rest.step(CULMINATION_S + late_s, True)
        run.operate(Jog(None, -2.0), CULMINATION_S + 0.04)
        assert rest.jogging
        low(1)
        assert not rest.jogging
        assert run.session.wanted == Stop()
        assert (run.tracker.steering.refusal or "").startswith("the jog was ended at the altitude limit (")

    @pytest.mark.parametrize(
        ("paused", "slews", "led", "out"),
        [
            (True, True, False, True),
            (True, False, True, True),
            (True, False, False, False),
            (False, True, True, False),
        ],
    )
    def test_a_paused_mount_that_slews_is_led_out(
        self, paused: bool, slews: bool, led: bool, out: bool
    ) -> None:
        shown: Any = Engine.led_out
        run = Made(
            session=Made(wanted=Slew(1.0, 2.0) if slews else Stop()),
            safety=Made(led=Slew(3.0, 4.0) if led else None),
            tracker=Made(rest=Made() if paused else None),
        )
        assert shown.fget(run) is out


class TestTheView:
    def heard(self) -> Engine:
        run = engine()
        hear(run)
        hear(run, 1, ra_rate_dtics_s=932068, dec_rate_dtics_s=-186414)
        return run

    def test_target_and_mount_are_of_the_last_status_while_that_is_fresh(self) -> None:
        run, seen_s = self.heard(), CULMINATION_S + 0.05
        for late_s, at_s in ((0.02, seen_s), (0.25, seen_s), (0.4, seen_s + 0.4)):
            view = view_of(run, seen_s + late_s)
            there = run.tracker.direction_at(at_s)
            assert view.utc_s == seen_s + late_s
            assert view.target_ra_deg == pytest.approx(float(there.ra_deg), abs=1e-3)
            assert view.target_az_deg == pytest.approx(float(there.az_deg), abs=1e-3)
            assert (view.target_alt_deg, view.range_km) == pytest.approx(
                (float(there.alt_deg), float(there.range_km)), abs=0.1
            )
        # Half an arcminute a tick: of another instant, they would stand apart.
        fresh = view_of(run, seen_s + 0.02)
        assert fresh.mount_ra_deg == pytest.approx(fresh.target_ra_deg, abs=1e-3)
        assert fresh.mount_dec_deg == pytest.approx(fresh.target_dec_deg, abs=1e-3)

    def test_it_says_what_is_followed_and_how_fast_the_mount_turns(self) -> None:
        run = self.heard()
        run.tracker.slipped_s = 5.0
        view = view_of(run, CULMINATION_S + 0.07)
        elements = demo_pass.elements()
        assert view.elements_age_s == pytest.approx(CULMINATION_S + 0.07 - float(elements.epoch.unix_s))
        assert (view.name, view.catalog_number) == (elements.label, elements.catalog_number)
        assert view.culminate_utc_s == CULMINATION_S + 5.0
        assert (view.start_utc_s, view.end_utc_s, view.max_alt_deg) == (
            PLAN.start_utc_s,
            PLAN.end_utc_s,
            70.0,
        )
        # 2^26 tics a turn; right ascension falls as the hour angle grows.
        assert view.ra_rate_reached_deg_s == pytest.approx(360.0 / 86164.0905 - 0.5, abs=1e-5)
        assert view.dec_rate_reached_deg_s == pytest.approx(-0.1, abs=1e-5)
        assert (view.ended_by, view.pause, view.learnt, view.axes) == (None, None, None, None)
        run.operate(Pause(), CULMINATION_S)
        assert view_of(run, CULMINATION_S + 0.07).pause is not None

    def test_before_the_mount_is_heard_it_is_nowhere(self) -> None:
        view = view_of(engine(), CULMINATION_S)
        assert (view.mount_ra_deg, view.ra_rate_reached_deg_s, view.dec_rate_reached_deg_s) == (None,) * 3
        assert (view.ra_rate_deg_s, view.dec_rate_deg_s) == (0.0, 0.0)
        assert (view.error, view.rms_10s_arcsec, view.rms_pass_arcsec, view.link.age_s) == (None,) * 4

    def test_the_moon_has_no_elements_that_age(self) -> None:
        moon = Propagator(Body("Moon"), SITE)
        run = engine()
        spec = replace(run.spec, propagator=moon, if_mount_refracts=moon)
        view = view_of(Engine(spec), CULMINATION_S)
        assert (view.elements_age_s, view.catalog_number, view.name) == (None, None, "Moon")

    def test_nobody_knows_how_far_a_star_is(self) -> None:
        star = Propagator(Body("Vega", StarPlace(279.23, 38.78)), SITE)
        run = engine()
        spec = replace(run.spec, propagator=star, if_mount_refracts=star)
        assert view_of(Engine(spec), CULMINATION_S).range_km is None
        assert view_of(run, CULMINATION_S).range_km is not None
