"""What a run learns of mounts written from the paper alone, and what it says of a profile that is wrong."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import family
import msgspec
import pytest

from sattrack.calibration.profile import LEAST_LAG_S, learnt_text, with_learnt
from sattrack.cli.running import check_new_profile
from sattrack.control.axes import Axes
from sattrack.control.engine import learnt_view
from sattrack.control.engine_view import LOOSE_FACTOR, view_of
from sattrack.core.errors import BadInputError
from sattrack.mount.model import AxisLimits, CalibrationRecord, MountProfile
from sattrack.mount.profiles import load_profile_file
from sattrack.runtime.flight import RunStatistics, summarise
from sattrack.views.formatting import summary_lines
from sattrack.views.run import LearntView

if TYPE_CHECKING:
    from pathlib import Path

BANDWIDTH_HZ, DAMPING, GAIN = 3.0, 0.8, 1.02
DELAY_S = 0.02
HARDWARE = replace(
    family.draw(0, ("velocity_servo",)).hardware,
    bandwidth_hz=BANDWIDTH_HZ,
    damping=DAMPING,
    feedforward=0.5,
    acceleration_deg_s2=8.0,
    gains=(GAIN, GAIN),
    move_axis="held",
    additive=True,
    signs=(1, 1),
    timer="even",
    stiction=0.0,
    ripple=0.0,
    command_delay_s=DELAY_S,
    status_delay_s=DELAY_S,
    jitter_s=0.0,
    loss=0.0,
    told_command_s=DELAY_S,
    told_status_s=DELAY_S,
    told_acceleration_deg_s2=8.0,
)
TOLD = family.profile_of(HARDWARE, "default")


def fly(
    number: int = 0,
    joined: bool = False,
    profile: MountProfile = TOLD,
    lasts_s: float = math.inf,
    **hardware: Any,
) -> family.Run:
    drawn = family.draw(number, ("velocity_servo",))
    drawn = replace(
        drawn,
        joined=joined,
        start_s=drawn.begin_s if joined else drawn.begin_s + family.RISES_AFTER_S,
        hardware=replace(HARDWARE, **hardware),
    )

    def watch(run: family.Run, now_s: float) -> None:
        if now_s > run.drawn.start_s + lasts_s:
            run.ended_by = "long enough"

    return family.Run(drawn, profile=profile).run(watch)


def learnt_of(run: family.Run) -> LearntView:
    learnt = learnt_view(run.engine)
    assert learnt is not None
    return learnt


def told(run: family.Run) -> str:
    return run.engine.why_not_acquired() or ""


@pytest.fixture(scope="module")
def first() -> family.Run:
    return fly()


def lag_s(feedforward: float) -> float:
    """The mean lag of a velocity loop of second order whose place is held by a slow loop around it."""
    turns = 2.0 * math.pi * BANDWIDTH_HZ
    return 2.0 * DAMPING / turns + (1.0 - feedforward) / turns


def test_the_lags_and_gains_learnt_are_the_servos_own(first: family.Run) -> None:
    learnt = learnt_of(first)
    for found, sigma in (
        (learnt.ra_lag_s, learnt.ra_lag_sigma_s),
        (learnt.dec_lag_s, learnt.dec_lag_sigma_s),
    ):
        assert abs(found - lag_s(0.5)) < sigma < 0.012
    for gain, of_gain in (
        (learnt.ra_gain, learnt.ra_gain_sigma),
        (learnt.dec_gain, learnt.dec_gain_sigma),
    ):
        assert gain is not None
        assert of_gain is not None
        assert abs(gain - GAIN) < of_gain < 0.01
    assert abs(learnt.command_delay_s - DELAY_S) <= learnt.command_delay_sigma_s < 0.016
    assert learnt.restarts == 0


def test_full_feedforward_is_told_from_half_of_it(first: family.Run) -> None:
    learnt = learnt_of(fly(feedforward=1.0))
    assert abs(learnt.dec_lag_s - lag_s(1.0)) < learnt.dec_lag_sigma_s
    assert abs(learnt.dec_lag_s - learnt_of(first).dec_lag_s) > 2.0 * learnt.dec_lag_sigma_s


def test_nothing_is_learnt_before_following() -> None:
    drawn = replace(family.draw(0, ("velocity_servo",)), joined=False, hardware=HARDWARE)
    run = family.Run(drawn, profile=TOLD)
    assert learnt_view(run.engine) is None
    views = []

    def watch(run: family.Run, now_s: float) -> None:
        views.append(view_of(run.engine, now_s))
        if views[-1].learnt is not None:
            run.ended_by = "learnt"

    run.run(watch)
    assert views[-1].learnt is not None
    for view in views:
        if view.phase in {"waiting", "slewing"}:
            assert view.learnt is None


def test_a_learnt_profile_is_written_loaded_and_followed_with_no_worse(
    first: family.Run, tmp_path: Path
) -> None:
    learnt, target = learnt_of(fly(number=12)), tmp_path / "mine.toml"
    profile, changed = with_learnt(TOLD, learnt, "mine")
    target.write_text(learnt_text(profile, changed, TOLD.name, "a pass"))
    text = target.read_text()
    assert text.startswith("# Learnt while following a pass, from one pass: not calibrated.")
    assert len(changed) == 4
    assert all(f"# {words}\n" in text for words in changed)
    loaded = load_profile_file(target).mount
    assert loaded == profile
    assert loaded.ra.lag_s == pytest.approx(lag_s(0.5), abs=0.01)
    assert loaded.dec_rate_gain == pytest.approx(GAIN, abs=0.003)
    assert loaded.calibration is None
    one, other = first.outcome(), fly(profile=loaded).outcome()
    assert one.late_s is not None
    assert other.late_s is not None
    assert other.late_s <= one.late_s
    assert other.rms_arcsec <= one.rms_arcsec + 0.001


def test_filters_begin_with_the_lag_that_the_profile_tells(first: family.Run) -> None:
    sample = first.engine.session.sample
    assert sample is not None
    history = first.engine.tracker.follower._history
    slow = msgspec.structs.replace(TOLD, ra=AxisLimits(lag_s=0.2))
    axes = Axes.begin(slow, history, sample, 0.0)
    assert axes.ra.lag.mean_s == pytest.approx(0.2, abs=0.01)
    assert axes.dec.lag.mean_s == pytest.approx(0.03, abs=0.001)


LEARNT = LearntView(0.11, 0.009, 1.02, 0.001, 0.12, 0.009, 0.98, 0.001, 0.015, 0.1, 0)


def test_only_what_was_learnt_well_enough_is_written() -> None:
    def fields(**changes: Any) -> tuple[float, ...]:
        profile, _ = with_learnt(TOLD, msgspec.structs.replace(LEARNT, **changes), "new")
        return (profile.ra.lag_s, profile.ra_rate_gain, profile.dec.lag_s, profile.dec_rate_gain)

    assert fields() == (0.11, 1.02, 0.12, 0.98)
    assert fields(ra_lag_sigma_s=0.02) == (0.0, 1.02, 0.12, 0.98)
    assert fields(dec_gain_sigma=0.004) == (0.11, 1.02, 0.12, 1.0)
    assert fields(ra_gain=None, ra_gain_sigma=None) == (0.11, 1.0, 0.12, 0.98)
    assert fields(restarts=1) == (0.0, 1.02, 0.0, 0.98)
    assert fields(ra_lag_s=-0.01) == (LEAST_LAG_S, 1.02, 0.12, 0.98)


def test_another_delay_is_written_where_it_is_known_to_be_another() -> None:
    def delays(delay_s: float, sigma_s: float) -> tuple[float, float, list[str]]:
        known = msgspec.structs.replace(LEARNT, command_delay_s=delay_s, command_delay_sigma_s=sigma_s)
        profile, words = with_learnt(TOLD, known, "new")
        return profile.command_delay_s, profile.status_delay_s, [each for each in words if "delay" in each]

    told_s = TOLD.status_delay_s
    assert delays(0.015, 0.001) == (0.015, told_s, ["command delay 15.0 ± 1.0 ms"])
    assert delays(DELAY_S, 0.0) == (DELAY_S, told_s, [])
    assert delays(0.015, 0.012) == (DELAY_S, told_s, [])
    # Commands do not act before they are sent: it is the way back that takes less long.
    assert delays(-0.004, 0.001) == (
        0.0,
        pytest.approx(told_s - 0.004),
        ["command delay 0.0 ± 1.0 ms", f"status delay {1e3 * (told_s - 0.004):.1f} ± 1.0 ms"],
    )
    assert delays(-1.0, 0.001)[1] == 0.0


def test_what_only_the_simulated_mount_needs_is_kept(tmp_path: Path) -> None:
    target = tmp_path / "sim.toml"
    target.write_text('name = "sim"\n[simulator]\nseed = 3\n')
    profile, changed = with_learnt(load_profile_file(target), LEARNT, "new")
    again = tmp_path / "new.toml"
    again.write_text(learnt_text(profile, changed, "sim", "a pass"))
    assert load_profile_file(again).simulator == {"seed": 3}


def test_a_file_that_is_there_or_a_faster_clock_is_refused(tmp_path: Path) -> None:
    there = tmp_path / "there.toml"
    there.write_text("")
    with pytest.raises(BadInputError, match="the file exists"):
        check_new_profile(there)
    with pytest.raises(BadInputError, match="10 times real speed"):
        check_new_profile(tmp_path / "new.toml", 10.0)
    check_new_profile(tmp_path / "new.toml")
    check_new_profile(None, 10.0)


def test_the_summary_tells_what_was_learnt(first: family.Run) -> None:
    summary = summarise(first.engine, RunStatistics(), first.errors[-1].utc_s)
    assert summary.learnt == learnt_of(first)
    assert summary.why_not_acquired is None
    line = next(line for line in summary_lines(summary) if "learnt about the mount" in line)
    told = re.search(r"lag RA (\d+)±(\d+) ms", line)
    assert told is not None, line
    assert abs(1e-3 * int(told[1]) - lag_s(0.5)) < 1e-3 * (int(told[2]) + 1)
    assert "gain RA 1.02" in line


def test_a_loop_that_is_run_loose_says_why_and_what_it_costs(first: family.Run) -> None:
    def loose(run: family.Run) -> list[str]:
        return [
            words for words in view_of(run.engine, run.errors[-1].utc_s).warnings if "taken out in" in words
        ]

    assert loose(first) == []
    soft = fly(lasts_s=25.0, command_delay_s=0.35)
    law = soft.engine.spec.plan.law.feeder
    assert learnt_of(soft).settling_s > LOOSE_FACTOR * law.settling_s
    assert any("the servo answers 4" in words and "gusts and nudges" in words for words in loose(soft))


@pytest.mark.parametrize("joined", [False, True])
@pytest.mark.parametrize(("axis", "name"), [("ra", "right ascension"), ("dec", "declination")])
def test_a_turned_sign_is_stopped_and_named(axis: str, name: str, joined: bool) -> None:
    profile = msgspec.structs.replace(TOLD, **{f"{axis}_rate_sign": -1})
    run = fly(number=8, joined=joined, profile=profile)
    assert run.ended_by == "limit:obedience"
    assert run.errors[-1].utc_s - run.drawn.start_s < 6.0
    assert f"other sign in {name}: turn {axis}_rate_sign in the profile" in (run.message or "")
    assert told(run) == run.message


@pytest.mark.parametrize("joined", [False, True])
@pytest.mark.parametrize("number", [0, 4, 8])
def test_a_mount_that_takes_edges_is_named_where_the_profile_says_held(number: int, joined: bool) -> None:
    run = fly(number=number, joined=joined, move_axis="edge")
    assert run.ended_by in {"error", "limit:obedience"}
    assert run.errors[-1].utc_s - run.drawn.start_s < 6.0
    assert "move_axis is edge, and the profile says held" in (run.message or "")


@pytest.mark.parametrize("number", [0, 8])
def test_a_mount_that_takes_held_flags_is_named_where_the_profile_says_edge(number: int) -> None:
    run = fly(number=number, profile=msgspec.structs.replace(TOLD, move_axis="edge"))
    assert run.ended_by == "error"
    assert run.errors[-1].utc_s - run.drawn.start_s < 7.0
    assert "move_axis is held, and the profile says edge" in (run.message or "")


@pytest.mark.parametrize(("is_so", "words"), [(True, "add to"), (False, "replace")])
def test_rates_that_add_to_tracking_are_told_from_those_that_replace_it(
    first: family.Run, is_so: bool, words: str
) -> None:
    def flown(additive: bool) -> family.Run:
        profile = msgspec.structs.replace(TOLD, additive=additive)
        return fly(number=4, profile=profile, lasts_s=30.0, additive=is_so)

    run = flown(not is_so)
    warnings = view_of(run.engine, run.errors[-1].utc_s).warnings
    assert any(f"{words} sidereal tracking: set additive = {str(is_so).lower()}" in one for one in warnings)
    right = first if is_so else flown(is_so)
    assert not any("additive" in one for one in view_of(right.engine, right.errors[-1].utc_s).warnings)


def test_a_calibrated_mounts_record_takes_the_sigmas_of_what_was_learnt() -> None:
    record = CalibrationRecord(
        "2026-10-02T13:00:00Z",
        "program",
        "normal",
        ra_gain_sigma=1e-5,
        dec_gain_sigma=1e-5,
        round_trip_s=0.04,
        round_trip_sigma_s=0.001,
        command_delay_interval_s=(0.0, 0.04),
        status_delay_interval_s=(0.0, 0.04),
        clock_offset_interval_s=(0.0, 0.04),
        clock_drift_ppm=0.0,
        clock_drift_sigma_ppm=0.1,
        status_period_s=0.05,
        status_period_jitter_s=0.0,
    )
    unsure = msgspec.structs.replace(LEARNT, dec_gain_sigma=0.1)
    profile, _ = with_learnt(msgspec.structs.replace(TOLD, calibration=record), unsure, "new")
    assert profile.calibration is not None
    assert profile.calibration.ra_gain_sigma == 0.001
    assert profile.calibration.dec_gain_sigma == 1e-5
    assert profile.calibration.ra_lag_sigma_s == 0.009
