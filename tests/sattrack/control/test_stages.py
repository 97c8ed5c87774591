"""What a run does at a status, by hand; and from which figures on a reason is one."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest
from test_why_not_acquired import DEC, LEARNT, PROFILE, QUIET, RA

from sattrack.control.stages import RunStage, Situation, Stages, why_not
from sattrack.control.target import Detour, TargetState
from sattrack.control.tracker import TrackPlan
from sattrack.mount.model import SIDEREAL_RATE_DEG_S, AxisLimits, MountProfile

FOLLOWS = Situation(True, True, False, True, False, None, 1.0)
SLOW = TargetState(100.0, 20.0, 0.1, 0.1)
AXIS = AxisLimits(max_rate_deg_s=2.0, max_acceleration_deg_s2=4.0)
AXES = MountProfile(ra=AXIS, dec=AXIS)


def stages(*detours: Detour) -> Stages:
    return Stages(TrackPlan(0.0, 1000.0, detours=detours), AXES)


def test_recordings_know_the_stages_by_their_names_and_numbers() -> None:
    names = ["other", "acquiring", "held", "paused", "rejoining", "following"]
    assert [(stage.name.lower(), int(stage)) for stage in RunStage] == [(n, k) for k, n in enumerate(names)]


class TestStages:
    @pytest.mark.parametrize(
        ("changes", "stage"),
        [
            ({}, RunStage.FOLLOWING),
            ({"acquired": False}, RunStage.ACQUIRING),
            ({"acquired": False, "error_arcsec": 500.0}, RunStage.ACQUIRING),
            ({"following": False}, RunStage.OTHER),
            ({"paused": True}, RunStage.PAUSED),
            ({"error_arcsec": 500.0}, RunStage.FOLLOWING),
        ],
    )
    def test_what_it_does(self, changes: dict[str, Any], stage: RunStage) -> None:
        assert stages().take(FOLLOWS._replace(**changes), 10.0, SLOW) == (stage, "")

    def test_a_limit_of_place_holds_a_run_that_follows(self) -> None:
        assert stages().take(FOLLOWS._replace(holding="sun"), 10.0, SLOW) == (RunStage.HELD, "sun")
        slews = FOLLOWS._replace(holding="sun", following=False)
        assert stages().take(slews, 10.0, SLOW) == (RunStage.OTHER, "")

    @pytest.mark.parametrize("break_", [{"paused": True}, {"holding": "sun"}])
    def test_after_a_pause_or_a_limit_it_rejoins_until_it_is_on_target(self, break_: dict[str, Any]) -> None:
        run = stages()
        run.take(FOLLOWS._replace(**break_), 10.0, SLOW)
        off = FOLLOWS._replace(error_arcsec=2.1)
        slewing = FOLLOWS._replace(following=False, tracking=False)
        on = FOLLOWS._replace(error_arcsec=1.9)
        steps = [run.take(one, 11.0 + n, SLOW)[0] for n, one in enumerate((slewing, off, off, on, off))]
        assert steps == [RunStage.REJOINING] * 3 + [RunStage.FOLLOWING] * 2
        ended = stages()
        ended.take(FOLLOWS._replace(**break_), 10.0, SLOW)
        assert ended.take(slewing._replace(ended=True), 11.0, SLOW) == (RunStage.OTHER, "")
        new = stages()
        new.take(FOLLOWS._replace(acquired=False, **break_), 10.0, SLOW)
        assert new.take(FOLLOWS._replace(acquired=False), 11.0, SLOW) == (RunStage.ACQUIRING, "")

    @pytest.mark.parametrize(
        ("ra_rate", "dec_rate", "held"),
        [
            (-1.9, 0.0, False),
            # The axis turns by the sky's rate less the target's.
            (-2.0, 0.0, True),
            (2.0, 0.0, False),
            (2.1, 0.0, True),
            (0.0, 2.0, False),
            (0.0, -2.1, True),
        ],
    )
    def test_a_target_faster_than_an_axis_holds_a_run_that_is_off(
        self, ra_rate: float, dec_rate: float, held: bool
    ) -> None:
        fast = TargetState(100.0, 20.0, ra_rate, dec_rate)
        off = FOLLOWS._replace(error_arcsec=30.0)
        told = (RunStage.HELD, "rate") if held else (RunStage.FOLLOWING, "")
        assert stages().take(off, 10.0, fast) == told
        assert stages().take(FOLLOWS, 10.0, fast) == (RunStage.FOLLOWING, "")
        assert stages().take(off._replace(acquired=False), 10.0, fast) == (RunStage.ACQUIRING, "")
        if held:
            for dec_deg, name in (
                (88.0, "keyhole"),
                (-88.0, "keyhole"),
                (75.1, "keyhole"),
                (-74.9, "rate"),
                (74.9, "rate"),
            ):
                near = msgspec.structs.replace(fast, dec_deg=dec_deg)
                run = stages()
                assert run.take(off, 10.0, near) == (RunStage.HELD, name)
                assert run.take(off, 10.05, SLOW) == (RunStage.HELD, "rate")
                assert run.take(off, 10.5, SLOW) == (RunStage.REJOINING, "")

    @pytest.mark.parametrize(
        ("after_s", "change_deg_s", "held"),
        [(0.05, 0.19, False), (0.05, 0.21, True), (0.1, 0.39, False), (0.1, -0.41, True), (0.0, 1.0, False)],
    )
    @pytest.mark.parametrize("axis", ["ra_rate_deg_s", "dec_rate_deg_s"])
    def test_so_does_one_whose_rate_changes_faster(
        self, axis: str, after_s: float, change_deg_s: float, held: bool
    ) -> None:
        run, off = stages(), FOLLOWS._replace(error_arcsec=30.0)
        run.take(off, 10.0, SLOW)
        later = msgspec.structs.replace(SLOW, **{axis: 0.1 + change_deg_s})
        assert run.take(off, 10.0 + after_s, later)[0] is (RunStage.HELD if held else RunStage.FOLLOWING)

    def test_a_detour_is_the_keyholes(self) -> None:
        detour = Detour(100.0, 200.0, 50.0, 0.1, 0.2, 0.3, 1.0, False)
        off = FOLLOWS._replace(error_arcsec=30.0)
        for utc_s, told in (
            (99.0, ""),
            (100.0, "keyhole"),
            (150.0, "keyhole"),
            (200.0, "keyhole"),
            (201.0, ""),
        ):
            assert stages(detour).take(off, utc_s, SLOW)[1] == told


def reason(**changes: Any) -> str:
    return why_not(QUIET._replace(**changes)) or ""


def learnt(**changes: Any) -> Any:
    return msgspec.structs.replace(LEARNT, **changes)


def lagging(ra_s: float = 0.0, dec_s: float = 0.0) -> MountProfile:
    """Return a profile that tells of such lags."""
    return msgspec.structs.replace(PROFILE, ra=AxisLimits(lag_s=ra_s), dec=AxisLimits(lag_s=dec_s))


@pytest.mark.parametrize(
    ("below", "above", "words"),
    [
        # 30 % of the time, held or followed.
        ({"held_s": {"sun": 25.0}}, {"held_s": {"sun": 26.0}}, "the sun limit held it"),
        ({"clamped_s": 17.9}, {"clamped_s": 18.1}, "faster than the axes may turn"),
        (
            {"followed_s": 3.0, "clamped_s": 0.85},
            {"followed_s": 3.0, "clamped_s": 1.0},
            "(max_rate_deg_s, 6 and 6 °/s) for 1 of 3 s",
        ),
        (
            {"followed_s": 2.1, "stopped": True},
            {"followed_s": 1.9, "stopped": True},
            "the operator ended the run",
        ),
        ({"followed_s": 2.1}, {"followed_s": 1.9}, "it followed for 1.9 s only"),
        ({"followed_s": 1.9, "held_s": {"sun": 0.1}}, {"followed_s": 1.9}, "it followed for 1.9 s only"),
        ({"ra": RA._replace(ratio=0.11)}, {"ra": RA._replace(ratio=0.09)}, "right ascension did not move"),
        ({"dec": DEC._replace(ratio=-0.11)}, {"dec": DEC._replace(ratio=-0.09)}, "declination did not move"),
        (
            {"dec": DEC._replace(ratio=-0.49)},
            {"dec": DEC._replace(ratio=-0.51)},
            "declination turned",
        ),
        ({"ra": RA._replace(ratio=1.049)}, {"ra": RA._replace(ratio=1.051)}, "right ascension moved +5 %"),
        ({"ra": RA._replace(ratio=0.951)}, {"ra": RA._replace(ratio=0.949)}, "right ascension moved -5 %"),
        (
            {"dec": DEC._replace(ratio=0.9, fastest_deg_s=0.81, fastest_asked_deg_s=1.0)},
            {"dec": DEC._replace(ratio=0.9, fastest_deg_s=0.79, fastest_asked_deg_s=1.0)},
            "declination came to 0.79 °/s where 1.00 °/s",
        ),
        (
            {"ra": RA._replace(ratio=0.9, fastest_deg_s=1.61, fastest_asked_deg_s=2.0)},
            {"ra": RA._replace(ratio=0.9, fastest_deg_s=1.59, fastest_asked_deg_s=2.0)},
            "right ascension came to 1.59 °/s where 2.00 °/s was commanded: set ra.max_rate_deg_s",
        ),
        (
            {"dec": DEC._replace(ratio=0.96, fastest_deg_s=0.5)},
            {"dec": DEC._replace(ratio=0.94, fastest_deg_s=0.5)},
            "declination came to 0.50",
        ),
        (
            {"dec": DEC._replace(ratio=0.94, fastest_deg_s=0.019)},
            {"dec": DEC._replace(ratio=0.94, fastest_deg_s=0.021)},
            "declination came to 0.02",
        ),
        # The profile's command delay is 20 ms, its axes have no lag.
        (
            {"learnt": learnt(command_delay_s=-0.004)},
            {"learnt": learnt(command_delay_s=-0.006)},
            "26 ms",
        ),
        (
            {"learnt": learnt(ra_lag_s=0.149)},
            {"learnt": learnt(ra_lag_s=0.151)},
            "right ascension answers 151 ms",
        ),
        (
            {"learnt": learnt(ra_lag_s=0.139, command_delay_s=0.03)},
            {"learnt": learnt(ra_lag_s=0.141, command_delay_s=0.03)},
            "right ascension answers 151 ms later",
        ),
        (
            {"learnt": learnt(dec_lag_s=0.3, dec_lag_sigma_s=0.031)},
            {"learnt": learnt(dec_lag_s=0.3, dec_lag_sigma_s=0.029)},
            "declination answers 300 ms later",
        ),
        (
            {"profile": lagging(ra_s=0.1), "learnt": learnt(ra_lag_s=0.249)},
            {"profile": lagging(ra_s=0.1), "learnt": learnt(ra_lag_s=0.251)},
            "right ascension answers 151 ms later",
        ),
        (
            {"profile": lagging(dec_s=0.1), "learnt": learnt(dec_lag_s=0.249)},
            {"profile": lagging(dec_s=0.1), "learnt": learnt(dec_lag_s=0.251)},
            "declination answers 151 ms later",
        ),
        ({"learnt": learnt(restarts=2)}, {"learnt": learnt(restarts=3)}, "the filters restarted 3 times"),
    ],
)
def test_from_which_figure_on_a_reason_is_one(
    below: dict[str, Any], above: dict[str, Any], words: str
) -> None:
    assert words not in reason(**below)
    assert words in reason(**above)


def test_a_reason_names_the_figure_that_is_largest() -> None:
    told = reason(held_s={"sun": 20.0, "horizon": 40.0})
    assert told.startswith("the horizon limit held it for 40 s (")
    assert told.endswith("`sattrack rehearse` shows that beforehand")
    both = reason(learnt=learnt(ra_lag_s=0.2, dec_lag_s=0.3))
    assert both.startswith(
        "declination answers 300 ms later than the profile says: run `sattrack mount calib"
    )
    assert reason(ra=RA._replace(typical_arcsec=None), learnt=learnt(restarts=3)).endswith(
        "it was off by 4″ in declination, typically: see to drives, balance and link, then run "
        "`sattrack mount calibrate`"
    )
    none = reason(
        ra=RA._replace(typical_arcsec=None),
        dec=DEC._replace(typical_arcsec=None),
        learnt=learnt(restarts=3),
    )
    assert "it was off by too much, typically" in none
    assert reason(followed_s=0.0, clamped_s=0.0).startswith("it followed for 0.0 s only: start earlier")


def test_the_sidereal_rate_is_an_axis_at_rest_on_the_sky() -> None:
    """A target that the sky carries along asks nothing of the second axis and the sky's rate of the first."""
    slow = MountProfile(ra=AxisLimits(max_rate_deg_s=0.9 * SIDEREAL_RATE_DEG_S), dec=AXIS)
    run = Stages(TrackPlan(0.0, 1000.0), slow)
    off = FOLLOWS._replace(error_arcsec=30.0)
    assert run.take(off, 10.0, TargetState(0.0, 0.0, 0.0, 0.0))[1] == "rate"
