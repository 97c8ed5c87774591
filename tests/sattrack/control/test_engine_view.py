"""What a run shows and warns of, of runs made up here: each warning where it is due, and not otherwise."""

from __future__ import annotations

import math
from types import SimpleNamespace as Made
from typing import Any

import pytest

from sattrack.control import engine_view
from sattrack.control.engine import Engine, learnt_view
from sattrack.control.engine_view import (
    estimate_view,
    loop_view,
    observation_warnings,
    offset_views,
    search_view,
)
from sattrack.control.offset import ChangeLimits, Offset, Pattern, State, sweep_s
from sattrack.control.tracker import Phase
from sattrack.mount.geometry import AxisGeometry
from sattrack.mount.model import (
    SIDEREAL_RATE_DEG_S,
    MountProfile,
    SitePlace,
    Status,
    StatusSample,
    mean_sidereal_deg,
)
from sattrack.mount.xerxes.link import LinkHealth, LinkState

NOW = 1_790_000_000.0
DRIFTS = SIDEREAL_RATE_DEG_S
CALM_CLOCK = Made(known_holds=True, trusted=True, coarse_step_s=None)
QUICK = Made(lag_s=0.05, lag_sigma_s=0.002, line=None)
LAW = Made(settling_s=0.2, intervals=5.0, lag_sigmas=2.0, lags=1.25)


def made_run(**changes: Any) -> Any:
    """Return a run that tracks in peace, but for what is told otherwise, by path."""
    follower = Made(
        clock=Made(**vars(CALM_CLOCK)),
        learning=Made(learnt=lambda: None, fits=[Made(line=lambda _: None)], times_begun_anew=2),
        settling_s=None,
        acting_s=0.05,
        unanswered=False,
        lost_utc_s=None,
        command_delay_s=0.03,
        command_delay_sigma_s=0.004,
    )
    estimator = Made(
        words=None,
        rejected=0,
        refused=0,
        accepted=0,
        camera_words=[],
        begun_anew=0,
        sky_terms=None,
        filter=None,
        last_utc_s=None,
        sigma_arcsec=lambda utc_s, course: 7.5,
        reading=lambda utc_s, course: None,
    )
    steering = Made(
        refusal=None,
        estimator=estimator,
        clocks=Made(views=tuple),
        cameras=Made(named={}),
        last_seen=None,
        guided=True,
        camera_views=tuple,
        biases=Made(course=Made(going=lambda utc_s: Made(range_km=1000.0))),
    )
    tracker = Made(
        phase=Phase.TRACKING,
        steering=steering,
        table_left=False,
        follower=follower,
        rest=None,
        error=None,
    )
    profile = MountProfile()
    spec = Made(
        profile=profile,
        propagator=Made(site=Made(longitude_deg=11.0, latitude_deg=48.0)),
        plan=Made(law=Made(feeder=LAW)),
    )
    run: Any = Made(
        tracker=tracker,
        spec=spec,
        sample=None,
        frame=None,
        session=Made(
            stopped=False,
            intruder=None,
            ignored_fields=(),
            sample=None,
            status=None,
            health=LinkHealth(lost=3),
        ),
        safety=Made(clamping=False, holding=None),
        link_state=LinkState.UP,
        finished=False,
        malformed=0,
        dropped=0,
        message=None,
        led_out=False,
        phase="tracking",
    )
    for path, value in changes.items():
        *holders, name = path.split("__")
        here = run
        for one in holders:
            here = getattr(here, one)
        setattr(here, name, value)
    return run


def warned(**changes: Any) -> tuple[str, ...]:
    return engine_view._warnings(made_run(**changes))


def line(rest_deg_s: float, sigma_deg_s: float = 0.0001) -> Any:
    return [Made(line=lambda most: Made(rest_deg_s=rest_deg_s, rest_sigma_deg_s=sigma_deg_s))]


def servo(lag_s: float, sigma_s: float) -> Any:
    return lambda: (QUICK, Made(lag_s=lag_s, lag_sigma_s=sigma_s))


HEARD = Made(arrival_utc_s=NOW)
ABSOLUTE = MountProfile(additive=False)


class TestWarnings:
    def test_a_run_in_peace_has_none(self) -> None:
        assert warned() == ()

    @pytest.mark.parametrize(
        ("changes", "words"),
        [
            ({"link_state": LinkState.STALE}, "no fresh status from the mount: following by prediction"),
            ({"safety__clamping": True}, "the mount's rate limit is reached"),
            ({"tracker__phase": Phase.STOPPING}, "the stop is not confirmed yet"),
            ({"tracker__steering__refusal": "nudge refused"}, "nudge refused"),
            ({"tracker__table_left": True}, "the profile's periodic errors are not this mount's any more"),
            ({"session__intruder": "another program"}, "another program"),
            ({"session__ignored_fields": ("Slewing stays true",)}, "Slewing stays true"),
            ({"message": "over"}, "over"),
            ({"malformed": 2}, "2 lines were neither messages nor observations"),
            ({"malformed": 1}, "1 line was neither messages nor observations"),
            ({"dropped": 3}, "3 observations came too fast to be used"),
            ({"dropped": 1}, "1 observation came too fast to be used"),
            ({"led_out": True}, "the telescope is led out of the Sun's or the Moon's way"),
            (
                {"safety__holding": "sun", "phase": "holding"},
                "held at the sun limit (",
            ),
            (
                {"tracker__follower__clock__known_holds": False},
                "the mount's clock is not where the profile says: samples are dated by arrival",
            ),
            (
                {"tracker__follower__clock__trusted": False},
                "the mount's clock does not run as ours: samples are dated by arrival",
            ),
            (
                {"tracker__follower__clock__coarse_step_s": 0.0156},
                "the mount's clock goes in steps of 15.6 ms: samples are dated by its mean",
            ),
            (
                {"session__sample": HEARD, "tracker__follower__lost_utc_s": NOW - 9.9},
                "the mount was not where its commands lead: lost, and taken up where it is",
            ),
            (
                {"tracker__follower__learning__fits": line(DRIFTS + 0.0005)},
                "the mount's rates in right ascension replace sidereal tracking: set additive = false in",
            ),
            (
                {"spec__profile": ABSOLUTE, "tracker__follower__learning__fits": line(-DRIFTS - 0.0005)},
                "the mount's rates in right ascension add to sidereal tracking: set additive = true in",
            ),
            (
                {
                    "tracker__follower__learning__learnt": servo(0.4, 0.002),
                    "tracker__follower__settling_s": 0.51,
                },
                "the servo answers 400 ms late: an error is taken out in 0.51 s instead of 0.25 s",
            ),
            (
                {
                    "tracker__follower__learning__learnt": servo(0.04, 0.04),
                    "tracker__follower__settling_s": 0.51,
                },
                "the servo's lag is known to 40 ms only: an error is taken out in 0.51 s instead of",
            ),
            (
                {"tracker__follower__unanswered": True, "tracker__follower__acting_s": 1.7},
                "the mount acknowledges no rates: each acts for 1.7 s, and errors are taken out no faster",
            ),
        ],
    )
    def test_each_where_it_is_due(self, changes: dict[str, Any], words: str) -> None:
        (only,) = warned(**changes)
        assert only.startswith(words)

    @pytest.mark.parametrize(
        "changes",
        [
            {"link_state": LinkState.LOST},
            {"safety__clamping": True, "tracker__phase": Phase.SLEWING},
            {"tracker__phase": Phase.STOPPING, "finished": True},
            {"tracker__phase": Phase.STOPPING, "session__stopped": True},
            {"safety__holding": "sun"},
            {"session__sample": HEARD, "tracker__follower__lost_utc_s": NOW - 10.1},
            {"tracker__follower__learning__fits": line(DRIFTS + 0.0006)},
            {"tracker__follower__learning__fits": line(-DRIFTS)},
            {"tracker__follower__learning__fits": line(DRIFTS, 0.0012)},
            {"tracker__follower__settling_s": 0.51},
            {
                "tracker__follower__learning__learnt": servo(0.4, 0.002),
                "tracker__follower__settling_s": 0.49,
            },
            {
                "tracker__phase": Phase.ACQUIRING,
                "tracker__follower__learning__learnt": servo(0.4, 0.002),
                "tracker__follower__settling_s": 0.51,
            },
        ],
    )
    def test_none_where_it_is_not(self, changes: dict[str, Any]) -> None:
        assert warned(**changes) == ()

    def test_a_pause_at_a_limit_goes_no_farther(self) -> None:
        (paused,) = warned(safety__holding="sun", tracker__rest=Made())
        assert paused.endswith("): the paused mount goes no farther")
        (held,) = warned(safety__holding="sun", phase="holding")
        assert held.endswith("): it goes on when the satellite comes back")

    @pytest.mark.parametrize(
        ("measured", "both", "beyond", "due"),
        [
            ("normal", False, False, False),
            ("normal", False, True, True),
            ("beyond_pole", False, True, False),
            ("beyond_pole", False, False, True),
            ("normal", True, True, False),
        ],
    )
    def test_a_side_of_the_pier_that_was_not_measured(
        self, measured: str, both: bool, beyond: bool, due: bool
    ) -> None:
        calibration = Made(both_sides=both, side_of_pier=measured)
        record = Made(calibration=calibration, additive=True, behind_gateway=False)
        told = warned(spec__profile=record, session__status=Status(side_of_pier=beyond))
        words = "this side of the pier is not in the mount's profile: its rates may go the other way"
        assert told == ((words,) if due else ())

    @pytest.mark.parametrize(
        ("changes", "due"),
        [
            ({"dated_by_requests": True}, True),
            ({"dated_by_requests": True, "pier_rule": "ascom"}, False),
            ({"dated_by_requests": True, "through_pole": True}, False),
            ({}, False),
        ],
    )
    def test_a_telescope_beyond_the_pole_that_by_its_profile_is_never_there(
        self, changes: dict[str, Any], due: bool
    ) -> None:
        profile = MountProfile(**changes)
        told = warned(spec__profile=profile, session__status=Status(side_of_pier=True))
        assert [words for words in told if 'set "ascom"' in words] == list(told)
        assert len(told) == due
        assert warned(spec__profile=profile, session__status=Status()) == ()

    def test_of_observations_each_outcome_and_why(self) -> None:
        clock = Made(camera="", corrected_s=0.2, clock_s=0.2, sigma_s=0.01)
        run = made_run(tracker__steering__clocks=Made(views=lambda: (clock, Made(corrected_s=0.0))))
        estimator = run.tracker.steering.estimator
        estimator.words, estimator.rejected, estimator.refused, estimator.accepted = "too far", 1, 2, 3
        estimator.camera_words, estimator.begun_anew = ["mirrored"], 4
        assert observation_warnings(run.tracker, 0, 0) == [
            "the last observation was not taken: too far (1 rejected, 2 refused, 3 taken)",
            "mirrored",
            "camera without a name: its clock is 0.200 ± 0.010 s ahead by the stars, its dates are corrected",
            "the estimate restarted 4 times: the rejected observations agreed with one another",
        ]
        estimator.begun_anew = 1
        told = observation_warnings(run.tracker, 0, 0)
        assert told[-1].startswith("the estimate restarted once: ")


class TestViews:
    def test_the_link_shows_delay_and_clock(self) -> None:
        """A status that arrived 30 ms after its instant, of a clock that is 2 s ahead."""
        ahead_h = (mean_sidereal_deg(NOW, 11.0) + 2.0 * SIDEREAL_RATE_DEG_S) % 360.0 / 15.0
        sample = StatusSample(1, NOW + 0.03, ahead_h, 0.0, 0.0, False, False, 0.0, 0.0)
        view = engine_view._link_view(
            made_run(session__sample=sample, tracker__error=Made(utc_s=NOW)), NOW + 0.1
        )
        assert (view.state, view.lost) == ("up", 3)
        assert view.age_s == pytest.approx(0.07)
        assert view.delay_ms == pytest.approx(30.0, abs=1e-3)
        assert view.clock_offset_s == pytest.approx(2.0, abs=1e-5)
        for changes in ({}, {"session__sample": sample}, {"tracker__error": Made(utc_s=NOW)}):
            unknown = engine_view._link_view(made_run(**changes), NOW + 0.1)
            assert (unknown.delay_ms, unknown.clock_offset_s) == (None, None)
            assert (unknown.age_s is None) is ("session__sample" not in changes)

    def test_past_the_pole_the_declination_falls_as_its_axis_turns_on(self) -> None:
        sample = StatusSample(1, NOW, 0.0, 0.0, 0.0, False, False, 0.0, 0.25)
        assert engine_view._reported_dec_rate_deg_s(sample) == 0.25
        beyond = StatusSample(1, NOW, 0.0, 0.0, 0.0, False, False, 0.0, 0.25, beyond_pole=True)
        assert engine_view._reported_dec_rate_deg_s(beyond) == -0.25

    def test_two_axes_are_told_by_their_angles(self) -> None:
        profile = MountProfile(geometry=AxisGeometry(0.0, 90.0), stands_at=SitePlace(48.0, 11.0))
        sample = StatusSample(1, NOW, 23.0, 10.0, 62.0, False, False, 0.3, -0.2)
        view = engine_view._axes_view(made_run(sample=sample, frame=profile.frame))
        assert view is not None
        assert (view.first_deg, view.second_deg) == (pytest.approx(-25.0), 62.0)
        assert (view.first_rate_deg_s, view.second_rate_deg_s) == (0.3, -0.2)
        frame = profile.frame
        assert frame is not None
        before, after = (frame.field_angle_deg(-25.0 + 0.3 * s, 62.0 - 0.2 * s) for s in (-0.01, 0.01))
        assert view.field_angle_deg == pytest.approx(0.5 * (before + after), abs=1e-5)
        assert view.field_rate_deg_s == pytest.approx((after - before) / 0.02, rel=1e-4)
        assert engine_view._axes_view(made_run(sample=sample)) is None
        assert engine_view._axes_view(made_run(frame=profile.frame)) is None

    def test_the_mount_points_where_its_axes_do(self) -> None:
        """An alt-azimuth mount at 48° that looks south at an altitude of 62° looks at 20° of declination."""
        profile = MountProfile(geometry=AxisGeometry(0.0, 90.0), stands_at=SitePlace(48.0, 11.0))
        sample = StatusSample(1, NOW, 8.0, 120.0, 62.0, False, False, 0.0, 0.0)
        points: Any = Engine.pointing_deg
        assert points.fget(made_run(sample=sample, frame=profile.frame)) == pytest.approx((120.0, 20.0))
        west = StatusSample(1, NOW, 8.0, 30.0, 0.0, False, False, 0.0, 0.0)
        # On the horizon due west is the equator, 6 h from the meridian.
        assert points.fget(made_run(sample=west, frame=profile.frame)) == pytest.approx((30.0, 0.0), abs=1e-9)
        assert points.fget(made_run(sample=sample)) == (120.0, 62.0)
        assert points.fget(made_run()) is None

    def test_a_pause_is_at_rest_unless_it_is_led_out(self) -> None:
        rest = Made(begun_utc_s=NOW, at_rest=True, jogging=False, going_on=True)
        view: Any = engine_view._pause_view(made_run(tracker__rest=rest))
        assert (view.since_utc_s, view.at_rest, view.jogging, view.going_on) == (NOW, True, False, True)
        led: Any = engine_view._pause_view(made_run(tracker__rest=rest, led_out=True))
        assert led.at_rest is False
        assert engine_view._pause_view(made_run()) is None

    def test_what_was_learnt_is_told_as_a_profile_has_it(self) -> None:
        gained = Made(lag_s=0.3, lag_sigma_s=0.01, line=Made(gain=1.1, gain_sigma=0.02))
        run = made_run(
            tracker__follower__learning__learnt=lambda: (gained, QUICK),
            tracker__follower__settling_s=0.4,
            spec__profile=MountProfile(ra_rate_gain=0.5, dec_rate_gain=2.0),
        )
        view: Any = learnt_view(run)
        assert (view.ra_lag_s, view.ra_lag_sigma_s, view.dec_lag_s, view.dec_lag_sigma_s) == (
            0.3,
            0.01,
            0.05,
            0.002,
        )
        assert (view.ra_gain, view.ra_gain_sigma) == (pytest.approx(0.55), pytest.approx(0.01))
        assert (view.dec_gain, view.dec_gain_sigma) == (None, None)
        gained.line.gain_sigma = 0.021
        unsure: Any = learnt_view(run)
        assert (unsure.ra_gain, unsure.ra_gain_sigma) == (None, None)
        assert (view.command_delay_s, view.command_delay_sigma_s) == (0.03, 0.004)
        assert (view.settling_s, view.restarts) == (0.4, 2)
        run.tracker.follower.settling_s = None
        assert learnt_view(run) is None
        assert learnt_view(made_run(tracker__follower__settling_s=0.4)) is None

    def test_offsets_that_are_something_are_shown(self) -> None:
        wide = ChangeLimits(9.0, 9.0)
        gone, rated, coming = Offset(1.0), Offset(), Offset()
        gone.reset(NOW, wide)
        rated.run(0.1, NOW, wide)
        coming.add(0.5, NOW, wide)
        offsets = {"along_s": gone, "cross_deg": Offset(), "dec_deg": rated, "ra_axis_deg": coming}
        run = made_run(tracker__steering__biases=Made(offsets=offsets))
        shown = offset_views(run.tracker, NOW)
        assert [(one.what, one.total, one.applied, one.rate) for one in shown] == [
            ("along_s", 0.0, 1.0, 0.0),
            ("dec_deg", pytest.approx(-0.075), 0.0, 0.1),
            ("ra_axis_deg", 0.5, 0.0, 0.0),
        ]
        assert [one.what for one in offset_views(run.tracker, NOW + 60.0)] == ["dec_deg", "ra_axis_deg"]

    def test_a_search_is_shown_from_when_it_was_asked_for(self) -> None:
        sweep = Pattern("sweep", 2.0, 20.0, NOW + 1.0, math.inf)
        over = Pattern("sweep", 2.0, 20.0, NOW - 9.0, NOW - 1.0)
        biases = Made(
            patterns=[over, sweep],
            pattern_at=lambda utc_s: sweep if sweep.runs(utc_s) else None,
            along_without_search=lambda utc_s: State(0.0, 0.0, 0.0),
            course=None,
        )
        run = made_run(tracker__steering__biases=biases)
        soon: Any = search_view(run.tracker, NOW)
        assert (soon.how, soon.elapsed_s, soon.along_s, soon.cross_deg) == ("sweep", 0.0, 0.0, 0.0)
        later: Any = search_view(run.tracker, NOW + 8.0)
        assert (later.elapsed_s, later.along_s) == (7.0, pytest.approx(sweep_s(7.0, 2.0, 20.0)))
        # One that was ended before it began is none.
        for ended in (over, sweep.ended(NOW + 0.5)):
            biases.patterns = [ended]
            assert search_view(run.tracker, NOW) is None

    def test_an_estimate_is_told_with_its_sigmas_and_the_outcome(self) -> None:
        run = made_run()
        assert estimate_view(run.tracker, NOW, 0) is None
        counted: Any = estimate_view(run.tracker, NOW, 2)
        assert (counted.along_s, counted.accepted, counted.rejected, counted.refused) == (None, 0, 0, 2)
        estimator = run.tracker.steering.estimator
        estimator.accepted, estimator.rejected, estimator.refused, estimator.last_utc_s = 3, 1, 4, NOW - 2.0
        known = Made(along_s=0.5, along_sigma_s=0.03, cross_km=2.0, cross_sigma_km=0.1, along_rate=0.01)
        estimator.reading, estimator.begun_anew = lambda utc_s, course: known, 5
        view: Any = estimate_view(run.tracker, NOW, 1)
        assert (view.along_s, view.along_sigma_s) == (0.5, 0.03)
        assert view.cross_deg == pytest.approx(math.degrees(math.atan(0.002)))
        assert view.cross_sigma_deg == pytest.approx(math.degrees(1e-4))
        assert (view.accepted, view.rejected, view.refused, view.last_utc_s) == (3, 1, 5, NOW - 2.0)
        assert (view.drift_s_min, view.begun_anew) == (pytest.approx(0.6), 5)
        clocks = (Made(sigma_s=0.04, corrected_s=0.1), Made(sigma_s=9.0, corrected_s=0.0))
        run.tracker.steering.clocks = Made(views=lambda: clocks)
        unsure: Any = estimate_view(run.tracker, NOW, 0)
        # 30 ms of the estimate and 40 ms of the dates that were corrected.
        assert unsure.along_sigma_s == pytest.approx(0.05)

    def test_what_closes_the_loop(self) -> None:
        run = made_run()
        steering = run.tracker.steering
        assert loop_view(run.tracker, NOW) is None
        steering.cameras.named = {"guide": None}
        idle: Any = loop_view(run.tracker, NOW)
        assert (idle.state, idle.predicted_s, idle.sigma_arcsec, idle.guided) == (
            "elements",
            None,
            None,
            True,
        )
        steering.estimator.filter, steering.estimator.last_utc_s = object(), NOW
        for after_s, state in ((-1.0, "camera"), (3.0, "camera"), (3.1, "lost")):
            view: Any = loop_view(run.tracker, NOW + after_s)
            assert (view.state, view.predicted_s) == (state, pytest.approx(max(0.0, after_s), abs=1e-6))
            assert view.sigma_arcsec == 7.5
        steering.cameras.named = {}
        assert loop_view(run.tracker, NOW) is None
        for name in ("accepted", "rejected", "refused"):
            setattr(steering.estimator, name, 1)
            assert loop_view(run.tracker, NOW) is not None
            setattr(steering.estimator, name, 0)
        steering.last_seen = "held"
        assert loop_view(run.tracker, NOW) is not None
