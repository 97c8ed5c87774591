"""`sattrack run FILE --dry-run` as a user runs it, over a made-up sky and the ISS."""

from __future__ import annotations

import json
from dataclasses import replace
from datetime import datetime, timedelta
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np
import pytest
from planning_nights import random_sky

from sattrack.cli import run_plan
from sattrack.cli.main import run
from sattrack.cli.run_plan import plot_plan
from sattrack.mount.model import MountProfile
from sattrack.runtime import demo_pass
from sattrack.safety.limits import SafetyLimits
from sattrack.safety.route import axes_of, slew_s
from sattrack.schedule import candidates
from sattrack.schedule.candidates import Candidate, Loaded, PlanSituation
from sattrack.schedule.file import load_schedule
from sattrack.schedule.making import make_plan
from sattrack.schedule.night import FollowedPass, Run, RunState
from sattrack.schedule.night_folder import NightFiles
from sattrack.schedule.summary import view_of
from sattrack.views.schedule import Rehearsed, SchedulePlan
from tle.instants import Utc
from tle.propagator import Propagator
from tle.site import Site
from tle.sources import write_elements

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tle.elements import Elements

LEIDEN = ("--site", "52.1541,4.4908,0")
GEOSTATIONARY = (
    "TDRS 3",
    "1 19548U 88091B   26150.42208977 -.00000296  00000+0  00000+0 0  9992",
    "2 19548  12.6156 341.1225 0039238 356.7275  12.9243  1.00281048125214",
)
SPAN = "from = 2026-10-02T18:00:00Z\nto = 2026-10-02T23:00:00Z\n"
CLOCK = ("--clock", "2026-10-02T12:00:00Z")


def made_up_sky(count: int) -> list[Elements]:
    """Return the ISS, and satellites in low orbits, drawn at random."""
    drawn = enumerate(random_sky(count), start=1)
    return [demo_pass.elements(), *(replace(one, name=f"SAT {number:02d}") for number, one in drawn)]


@pytest.fixture(scope="module")
def sky(tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("sky") / "sky.tle"
    path.write_text(write_elements(made_up_sky(24), "tle"))
    return str(path)


def written(folder: Path, text: str) -> str:
    path = folder / "night.toml"
    path.write_text(text, encoding="utf-8")
    return str(path)


def planned(
    capsys: pytest.CaptureFixture[str], folder: Path, text: str, sky: str, *options: str
) -> dict[str, Any]:
    file = written(folder, text)
    code = run(["run", file, "--dry-run", "--json", "--elements", sky, *LEIDEN, *CLOCK, *options])
    out, err = capsys.readouterr()
    assert code == 0, err
    document: dict[str, Any] = json.loads(out)
    return document


def refused(capsys: pytest.CaptureFixture[str], folder: Path, text: str, sky: str, *options: str) -> str:
    file = written(folder, text)
    code = run(["run", file, "--dry-run", "--elements", sky, *LEIDEN, *CLOCK, *options])
    out, err = capsys.readouterr()
    assert (code, out) == (2, "")
    assert err.count("\n") == 1
    return err.removeprefix("sattrack: ").replace(f"{folder}/", "").strip()


def utc_s(text: str) -> float:
    return float(Utc.parse(text).unix_s)


def listed_passes(capsys: pytest.CaptureFixture[str], sky: str, *options: str) -> list[dict[str, Any]]:
    """Return what `sattrack passes --judged` lists for the same night."""
    start = ("--from", "2026-10-02T18:00:00Z", "--hours", "5")
    assert run(["passes", "--elements", sky, *LEIDEN, *start, "--judged", "--json", *options]) == 0
    found: list[dict[str, Any]] = json.loads(capsys.readouterr().out)
    return found


def test_a_run_without_a_mount_or_with_options_that_do_not_go_with_one_says_so_and_leaves_nothing_behind(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], sky: str
) -> None:
    file = written(tmp_path, SPAN + '[[passes]]\nrule = "all"\n')
    real = ("--mount", "xerxes://127.0.0.1:15001?listen=15002")
    for options, words in (
        ((), "no mount: give --mount"),
        ((*real, "--virtual"), "--virtual needs --mount sim"),
        ((*real, *CLOCK), "--clock is for simulated mounts only"),
        (("--mount", "sim", "--seed", "1"), "--seed needs --virtual"),
        (("--mount", "antenna://127.0.0.1:1"), "an antenna's controller runs no schedules"),
        (("--mount", "sim", "--virtual", "--to", "2026-10-01T00:00:00Z"), "give --from and --to in order"),
        (("--mount", "sim", "--png", "x.png"), "--plot needs --dry-run"),
    ):
        assert run(["run", file, "--elements", sky, *LEIDEN, *options]) == 2
        out, err = capsys.readouterr()
        assert out == ""
        assert words in err
    assert [one.name for one in tmp_path.iterdir()] == ["night.toml"]


@pytest.mark.parametrize(
    ("mount", "park", "wanted", "ends", "why"),
    [
        ("xerxes://127.0.0.1:15001?listen=15002", True, "", "parked", None),
        ("alpaca://no.such.host.invalid:11111/0", True, "", "left", "by their own programs"),
        ("alpaca://no.such.host.invalid:11111/0", True, "park_at_end = false\n", "left", None),
        ("sim", False, "", "left", "the profile has no park position"),
    ],
)
def test_a_plan_says_whether_the_mount_is_parked_at_its_end_and_why_it_is_not(
    mount: str,
    park: bool,
    wanted: str,
    ends: str,
    why: str | None,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    file = written(tmp_path, f"{wanted}{SPAN}[[passes]]\nsatellite = '25544'\n")
    (tmp_path / "iss.tle").write_text(f"{demo_pass.LINE_1}\n{demo_pass.LINE_2}\n")
    place = "park = { hour_angle_deg = 0.0, dec_deg = 30.0 }\n" if park else ""
    (tmp_path / "mount.toml").write_text(f'name = "m"\n{place}')
    options = ("--elements", str(tmp_path / "iss.tle"), "--profile", str(tmp_path / "mount.toml"))
    assert run(["run", file, "--dry-run", *options, "--mount", mount, *LEIDEN, *CLOCK]) == 0
    out, err = capsys.readouterr()
    assert f"; the mount is {ends} at the end\n" in out
    left = [line for line in err.splitlines() if "the mount will be left where the last pass ends" in line]
    assert len(left) == (why is not None)
    assert all(why is not None and why in line for line in left)


@pytest.mark.parametrize(
    ("park", "words"),
    [
        ("hour_angle_deg = 80, dec_deg = -10", "its park position is past the altitude limit"),
        ("hour_angle_deg = 175, dec_deg = 80", "park is at hour angle 175, beyond hour_angle_limit_deg, 170"),
        ("hour_angle_deg = 80, dec_deg = 10", None),
    ],
)
def test_a_park_position_that_no_night_could_go_to_is_told_before_the_night(
    park: str, words: str | None, tmp_path: Path, capsys: pytest.CaptureFixture[str], sky: str
) -> None:
    profile = tmp_path / "mount.toml"
    profile.write_text(f'name = "m"\npark = {{ {park} }}\n')
    span = SPAN.replace("23:00", "18:10") + '[[fixed]]\nsatellite = "ISS"\n'
    file = written(tmp_path, span + "start = 2026-10-02T18:00:00Z\nend = 2026-10-02T18:01:00Z\n")
    given = ["--elements", sky, *LEIDEN, *CLOCK, "--mount", "sim", "--profile", str(profile)]
    for how in ("--check", "--dry-run"):
        assert run(["run", file, how, *given]) == (0 if words is None else 2)
        assert words is None or words in capsys.readouterr().err
    if words is not None and "altitude" in words:
        written(tmp_path, f"park_at_end = false\n{Path(file).read_text()}")
        assert run(["run", file, "--check", *given]) == 0


def test_a_run_of_a_satellite_that_nobody_knows_ends_before_it_begins(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], sky: str
) -> None:
    file = written(tmp_path, SPAN + '[[passes]]\nsatellite = "SAT 0"\n')
    assert run(["run", file, "--elements", sky, *LEIDEN, "--mount", "sim", "--virtual"]) == 2
    assert "night.toml:3:1: " in capsys.readouterr().err
    assert [one.name for one in tmp_path.iterdir()] == ["night.toml"]


def test_a_plan_is_of_the_passes_and_verdicts_that_passes_lists(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], sky: str
) -> None:
    rule = '[defaults]\nif_sun_up = "run"\n[[passes]]\nrule = "all, above 20°"\n'
    # A schedule keeps within half a turn of the hour angle, which its sessions cannot count.
    (tmp_path / "mount.toml").write_text('name = "m"\nhour_angle_limit_deg = 170.0\n')
    mount = ("--profile", str(tmp_path / "mount.toml"))
    plan = planned(capsys, tmp_path, SPAN + rule, sky, *mount)
    listed = listed_passes(capsys, sky, "--min-alt", "20", *mount)
    by_top = {(one["catalog_number"], round(utc_s(one["culminate_utc"]))): one for one in listed}
    seen = [*plan["passes"], *plan["lost"]]
    assert len(seen) > 20
    for one in seen:
        theirs = by_top.pop((one["catalog_number"], round(utc_s(one["culminate_utc"]))))
        if theirs["rise_utc"] is not None and theirs["set_utc"] is not None:
            assert utc_s(one["start_utc"]) == pytest.approx(utc_s(theirs["rise_utc"]), abs=0.01)
            assert utc_s(one["end_utc"]) == pytest.approx(utc_s(theirs["set_utc"]), abs=0.01)
            verdict = one["why"] if one.get("reason") == "infeasible" else None
            assert verdict == theirs["why_not"]
    short = [one for one in by_top.values() if utc_s(one["set_utc"]) - utc_s(one["rise_utc"]) >= 60.0]
    assert short == []
    assert {one["reason"] for one in plan["lost"]} >= {"conflict", "infeasible"}


def test_to_judge_only_what_a_plan_would_take_gives_the_same_plan(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], sky: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = SPAN + '[defaults]\nif_sun_up = "run"\nshorten = true\n[[passes]]\nrule = "all, above 15°"\n'
    all_judged = planned(capsys, tmp_path, text, sky)
    monkeypatch.setattr(candidates, "MOST_JUDGED", 10)
    few_judged = planned(capsys, tmp_path, text, sky)
    assert any(one["reason"] == "infeasible" for one in all_judged["lost"])
    assert few_judged["passes"] == all_judged["passes"]
    infeasible = {
        (one["name"], one["start_utc"]) for one in all_judged["lost"] if one["reason"] == "infeasible"
    }
    found = {(one["name"], one["start_utc"]) for one in few_judged["lost"] if one["reason"] == "infeasible"}
    assert found <= infeasible
    assert any("not judged by the mount's limits" in note for note in few_judged["notes"])


def test_slews_settling_and_actions_fit_between_the_passes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], sky: str
) -> None:
    around = (
        '[defaults]\nshorten = true\nsettle_s = 7\nbefore = [{ do = "slew", star = "Vega", wait_s = 11 }]\n'
        'after = [{ do = "command", run = ["./x"], timeout_s = 13 }]\n'
    )
    plan = planned(capsys, tmp_path, SPAN + around + '[[passes]]\nrule = "all, above 20°"\n', sky)
    passes = plan["passes"]
    assert any(one["shortened"] for one in passes)
    for before, one in pairwise(passes):
        free_s = utc_s(one["start_utc"]) - utc_s(before["end_utc"])
        assert one["idle_s"] >= -1e-3
        taken_s = before["after_s"] + one["idle_s"] + one["slew_s"] + one["before_s"] + one["settle_s"]
        assert free_s == pytest.approx(taken_s, abs=0.01)
        assert before["after_s"] == 13.0
        assert one["before_s"] > 11.0
        assert utc_s(one["leave_utc"]) >= utc_s(before["end_utc"]) + 13.0 - 0.01
    for one in passes:
        assert utc_s(one["start_utc"]) <= utc_s(one["culminate_utc"]) <= utc_s(one["end_utc"])
        assert one["value"] == pytest.approx(one["priority"] * one["useful_s"], abs=0.01)
    assert plan["value"] == pytest.approx(sum(one["value"] for one in passes), abs=0.01)


def test_to_shorten_passes_is_worth_no_less(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], sky: str
) -> None:
    rule = '[[passes]]\nrule = "all, above 15°, dark"\n'
    whole = planned(capsys, tmp_path, SPAN + rule, sky)
    cut = planned(capsys, tmp_path, SPAN + rule + "shorten = true\n", sky)
    assert cut["value"] > whole["value"]
    assert not any(one["shortened"] for one in whole["passes"])


def test_what_lost_says_to_which_pass_and_how(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], sky: str
) -> None:
    text = SPAN + '[[passes]]\nrule = "all, above 10°, dark"\n'
    plan = planned(capsys, tmp_path, text, sky)
    conflicts = [one for one in plan["lost"] if one["reason"] == "conflict"]
    meeting = [one for one in conflicts if one["why"].startswith("at the same time as ")]
    assert meeting
    for one in conflicts:
        others = [plan["passes"][number - 1] for number in one["with_numbers"]]
        assert others
        for other in others:
            assert other["name"] in one["why"]
            meets = one["start_utc"] < other["end_utc"] and other["start_utc"] < one["end_utc"]
            assert meets is (one in meeting)


def test_no_more_passes_of_a_rule_are_planned_than_it_says(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], sky: str
) -> None:
    rule = '[[passes]]\nrule = "all, above 20°, dark{}"\n'
    free = planned(capsys, tmp_path, SPAN + rule.format(""), sky)
    few = planned(capsys, tmp_path, SPAN + rule.format(", max 3"), sky)
    assert len(free["passes"]) > 3
    assert len(few["passes"]) == 3
    worth = sorted((one["value"] for one in (*few["passes"], *few["lost"])), reverse=True)
    assert few["value"] <= sum(worth[:3]) + 0.01
    assert "rule full" in {one["reason"] for one in few["lost"]}


def test_satellites_by_name_have_each_of_their_passes_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], sky: str
) -> None:
    iss = '[[passes]]\nsatellite = "ISS"\n'
    day = "from = 2026-10-02T10:00:00Z\nto = 2026-10-03T10:00:00Z\n"
    plan = planned(capsys, tmp_path, day + iss, sky)
    assert {one["reason"] for one in plan["lost"]} == {"Sun up"}
    assert plan["lost"][0]["why"].startswith("the Sun is at ")
    low = planned(capsys, tmp_path, day + iss + 'where = "culminates above 60°"\nif_sun_up = "run"\n', sky)
    assert {one["reason"] for one in low["lost"]} == {"too low"}
    assert [round(one["max_alt_deg"]) for one in low["passes"]] == [81, 64]
    old = planned(capsys, tmp_path, day + iss + 'if_sun_up = "run"\nelements_oldest_days = 0.1\n', sky)
    assert {one["reason"] for one in old["lost"]} == {"elements too old"}
    kept = planned(
        capsys,
        tmp_path,
        day + iss + 'if_sun_up = "run"\nelements_oldest_days = 0.1\nif_elements_old = "run"\n',
        sky,
    )
    assert all("days old at the pass" in one["notes"][0] for one in kept["passes"])
    side = planned(capsys, tmp_path, day + iss + 'if_sun_up = "run"\npier_side = "beyond_pole"\n', sky)
    assert "pier side" in {one["reason"] for one in side["lost"]}
    assert side["passes"] == []
    lit = planned(capsys, tmp_path, SPAN + iss + 'where = "sunlit"\n', sky)
    assert all(one["reason"] in ("not sunlit", "Sun up", "too short") for one in lit["lost"])


def test_what_is_infeasible_is_run_all_the_same_where_the_file_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], sky: str
) -> None:
    fixed = '[[fixed]]\nsatellite = "ISS"\nstart = 2026-10-02T11:26:00Z\nend = 2026-10-02T11:30:00Z\n'
    day = "from = 2026-10-02T10:00:00Z\nto = 2026-10-02T20:00:00Z\n"
    plan = planned(capsys, tmp_path, day + fixed + 'if_sun_up = "run"\n', sky)
    assert plan["lost"][0]["reason"] == "infeasible"
    assert plan["lost"][0]["why"].startswith("sun: ")
    taken = planned(capsys, tmp_path, day + fixed + 'if_sun_up = "run"\nif_infeasible = "run"\n', sky)
    assert taken["passes"][0]["notes"][0].startswith("infeasible, run all the same: sun: ")
    assert taken["passes"][0]["value"] == pytest.approx(100.0 * 240.0)


def test_fixed_times_below_the_horizon_are_lost_or_cut(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], sky: str
) -> None:
    fixed = '[[fixed]]\nsatellite = "ISS"\nif_sun_up = "run"\nstart = 2026-10-02T{}Z\nend = 2026-10-02T{}Z\n'
    day = "from = 2026-10-02T10:00:00Z\nto = 2026-10-02T20:00:00Z\n"
    partly = day + fixed.format("13:00:00", "13:05:00")
    (lost,) = planned(capsys, tmp_path, partly, sky)["lost"]
    assert (lost["reason"], lost["why"]) == ("too low", "below 10° or the skyline for 119 s of it")
    (cut,) = planned(capsys, tmp_path, partly + "shorten = true\n", sky)["passes"]
    assert cut["end_utc"] == "2026-10-02T13:05:00.000Z"
    assert cut["useful_s"] == pytest.approx(181.0, abs=1.0)
    (never,) = planned(capsys, tmp_path, day + fixed.format("12:00:00", "12:05:00"), sky)["lost"]
    assert (never["reason"], never["why"]) == ("too low", "below 10° or the skyline throughout")
    (outside,) = planned(capsys, tmp_path, day + fixed.format("09:59:00", "10:05:00"), sky)["lost"]
    assert (outside["reason"], outside["why"]) == ("cut", "not whole within the plan's time")


def test_fixed_times_that_a_plan_begins_or_ends_within_are_cut_where_they_may_be(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], sky: str
) -> None:
    fixed = '[[fixed]]\nsatellite = "ISS"\nif_sun_up = "run"\n'
    fixed += "start = 2026-10-02T13:02:30Z\nend = 2026-10-02T13:08:00Z\n"
    for start, end in (("13:04:00", "20:00:00"), ("10:00:00", "13:06:00")):
        text = f"from = 2026-10-02T{start}Z\nto = 2026-10-02T{end}Z\n{fixed}"
        (lost,) = planned(capsys, tmp_path, text, sky)["lost"]
        assert (lost["reason"], lost["why"]) == ("cut", "not whole within the plan's time")
        (cut,) = planned(capsys, tmp_path, text + "shorten = true\n", sky)["passes"]
        first, last = (utc_s(f"2026-10-02T{at}Z") for at in (max(start, "13:02:30"), min(end, "13:08:00")))
        # The mount has to get there first where the plan begins in the pass.
        assert first <= utc_s(cut["start_utc"]) < first + 60.0
        assert utc_s(cut["end_utc"]) == last


def test_a_satellite_that_is_always_up_is_followed_once_in_each_nights_window(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "geo.tle"
    path.write_text("\n".join(GEOSTATIONARY) + "\n")
    text = (
        "from = 2026-06-01T12:00:00Z\nto = 2026-06-04T12:00:00Z\n[[passes]]\nsatellite = 'TDRS 3'\n"
        "from = 22:30:00\nto = 00:30:00\nlongest_s = 600\nmin_altitude_deg = 3\n"
    )
    passes = planned(capsys, tmp_path, text, str(path))["passes"]
    assert [one["start_utc"][:10] for one in passes] in (
        [f"2026-06-0{day}" for day in (1, 2, 3)],
        [f"2026-06-0{day}" for day in (2, 3, 4)],
    )
    for one in passes:
        assert utc_s(one["end_utc"]) - utc_s(one["start_utc"]) == pytest.approx(600.0, abs=0.01)
        assert one["start_utc"][11:16] >= "22:30" or one["end_utc"][11:16] <= "00:30"


def test_a_pass_whose_top_lies_outside_its_window_has_the_altitude_that_it_has_within(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], sky: str
) -> None:
    # The ISS is highest, at 81.3°, at 13:05:24.
    text = (
        "from = 2026-10-02T10:00:00Z\nto = 2026-10-02T20:00:00Z\n[[passes]]\nsatellite = 'ISS'\n"
        "where = 'culminates above 80°'\nif_sun_up = 'run'\nfrom = 13:06:40\nto = 13:30:00\nshorten = true\n"
    )
    (one,) = planned(capsys, tmp_path, text, sky)["passes"]
    assert one["culminate_utc"] == one["start_utc"] == "2026-10-02T13:06:40.000Z"
    there = Propagator(demo_pass.elements(), Site(52.1541, 4.4908, 0.0)).at(Utc(utc_s(one["start_utc"])))
    assert one["max_alt_deg"] == pytest.approx(float(there.alt_deg), abs=0.05)
    assert one["max_alt_deg"] < 45.0


def test_the_same_pass_by_two_entries_is_taken_once(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], sky: str
) -> None:
    rule = '[[passes]]\nrule = "all, above 20°, dark"\n'
    text = f"{SPAN}{rule}{rule}priority = 2\n"
    plan = planned(capsys, tmp_path, text, sky)
    assert {one["priority"] for one in plan["passes"]} == {2.0}
    same = [one for one in plan["lost"] if one["reason"] == "same pass"]
    assert len(same) == len(plan["passes"])


def test_a_rule_that_matches_nothing_is_told_and_ends_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], sky: str
) -> None:
    text = SPAN + '[[passes]]\nrule = "all, named NOAA*"\n[[passes]]\nrule = "all, culminates above 89.9°"\n'
    plan = planned(capsys, tmp_path, text, sky)
    assert plan["passes"] == []
    notes = [note.replace(f"{tmp_path}/", "") for note in plan["notes"]]
    assert notes[0].startswith("night.toml:3:1: all, named NOAA*: matches no object: ")
    assert notes[0].endswith("sky.tle holds 25, none whose name matches 'NOAA*'")
    assert notes[1].startswith("night.toml:5:1: all, culminates above 89.9°: no pass meets it: ")
    # A run tells the same when it plans a night.
    words = ["run", str(tmp_path / "night.toml"), "--virtual", "--mount", "sim", "--elements", sky]
    assert run([*words, *LEIDEN]) == 0
    told = capsys.readouterr().err.replace("sattrack: ", "").replace(f"{tmp_path}/", "").splitlines()
    assert set(notes) <= set(told)


def test_only_the_most_valuable_of_very_many_are_weighed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], sky: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(candidates, "MOST_CANDIDATES", 5)
    plan = planned(capsys, tmp_path, SPAN + '[[passes]]\nrule = "all, dark"\n', sky)
    crowded = [one for one in plan["lost"] if one["reason"] == "too many"]
    weighed = [one for one in (*plan["passes"], *plan["lost"]) if one not in crowded]
    assert len(weighed) == 5
    assert min(one["value"] for one in weighed) >= max(one["value"] for one in crowded)


@pytest.mark.parametrize(
    ("text", "options", "says"),
    [
        (
            SPAN + '[[passes]]\nsatellite = "SATT 01"\n',
            (),
            "night.toml:3:1: no satellite 'SATT 01' in the elements, which hold ISS (ZARYA) (25544), ",
        ),
        (SPAN + '[[passes]]\nsatellite = "SAT"\n', (), "night.toml:3:1: 'SAT' could be any of 24: "),
        (
            SPAN + '[[passes]]\nrule = "all, magnitude < 4"\n',
            (),
            "night.toml:3:1: the rule asks for magnitudes",
        ),
        (
            SPAN + '[[passes]]\nrule = "all of no.tle"\n',
            (),
            "night.toml:3:1: no.tle: cannot read elements: ",
        ),
        (
            SPAN + 'elements = ["no.tle"]\n[[passes]]\nsatellite = "ISS"\n',
            (),
            "night.toml:3: elements: no.tle: cannot read elements: ",
        ),
        (
            SPAN + '[[passes]]\nrule = "all"\n',
            ("--to", "2026-10-01"),
            "the plan goes from 2026-10-02T18:00:00Z",
        ),
        (
            SPAN + '[[passes]]\nrule = "all"\n',
            ("--to", "2027-10-01"),
            "the plan goes from 2026-10-02T18:00:00Z",
        ),
        (
            SPAN + '[[passes]]\nrule = "all, above -3"\n',
            (),
            "night.toml:3:1: follows above -3°, and the mount is",
        ),
        (
            SPAN + '[[passes]]\nrule = "all"\n',
            ("--ics", "no/such/x.ics"),
            "--ics no/such/x.ics: there is no folder",
        ),
        (
            SPAN + '[[passes]]\nrule = "all"\n',
            ("--profile", "no.toml"),
            "no.toml: cannot read the mount profile",
        ),
    ],
)
def test_what_cannot_be_planned_is_told_in_a_line(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    sky: str,
    text: str,
    options: tuple[str, ...],
    says: str,
) -> None:
    assert refused(capsys, tmp_path, text, sky, *options).startswith(says)


def test_the_last_word_of_an_unknown_satellite_is_what_was_meant(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], sky: str
) -> None:
    said = refused(capsys, tmp_path, SPAN + '[[passes]]\nsatellite = "SATT 01"\n', sky)
    assert said.endswith("; did you mean 'SAT 01'?")


def test_the_table_tells_of_all(tmp_path: Path, capsys: pytest.CaptureFixture[str], sky: str) -> None:
    text = SPAN + '[[passes]]\nname = "best"\nrule = "all, above 20°, dark"\nbias_along_s = 0.5\n'
    plan = planned(capsys, tmp_path, text, sky)
    assert run(["run", written(tmp_path, text), "--dry-run", "--elements", sky, *LEIDEN, *CLOCK]) == 0
    out, err = capsys.readouterr()
    for one in plan["passes"]:
        line = next(line for line in out.splitlines() if line.startswith(f"{one['number']:3d}  "))
        # To the nearest second, as the list of passes has it.
        start = datetime.fromisoformat(one["start_utc"]) + timedelta(seconds=0.5)
        assert f"{start:%H:%M:%S}" in line
        assert one["name"] in line
    assert out.count("bias: 0.5 s along, 0° across") == len(plan["passes"])
    assert "Not taken" in out
    assert "night.toml:3:1: best: " in out
    assert "\x1b" not in err


def read_calendar(data: bytes) -> list[dict[str, str]]:
    """Return the events of a calendar by RFC 5545, read without a look at what wrote it."""
    assert data.endswith(b"\r\n")
    assert b"\n" not in data.replace(b"\r\n", b"")
    assert max(len(line) for line in data.split(b"\r\n")) <= 75
    lines = data.decode().replace("\r\n ", "").split("\r\n")
    events: list[dict[str, str]] = []
    for line in lines:
        name, _, value = line.partition(":")
        if line == "BEGIN:VEVENT":
            events.append({})
        elif events and name not in ("END", ""):
            marks = {"n": "\n", "N": "\n"}
            text, at = "", 0
            while at < len(value):
                if value[at] == "\\":
                    at += 1
                    text += marks.get(value[at], value[at])
                else:
                    assert value[at] not in ";,"
                    text += value[at]
                at += 1
            events[-1][name] = text
    return events


def test_the_calendar_holds_the_plan(tmp_path: Path, capsys: pytest.CaptureFixture[str], sky: str) -> None:
    text = SPAN + (
        '[[passes]]\nname = "one, two; three \\\\ € and so on, and so on, and so on, and so on"\n'
        'rule = "all, above 20°, dark"\nbefore = [{ do = "slew", star = "Vega" }]\n'
    )
    plan = planned(capsys, tmp_path, text, sky, "--ics", str(tmp_path / "x.ics"))
    events = read_calendar((tmp_path / "x.ics").read_bytes())
    assert len(events) == len(plan["passes"]) > 3
    assert len({event["UID"] for event in events}) == len(events)
    assert all(event["UID"].endswith("+52.1541+4.4908-plan@sattrack") for event in events)
    for event, one in zip(events, plan["passes"], strict=True):
        seconds = str(Utc(round(utc_s(one["start_utc"]))).isoformat("seconds"))
        assert event["DTSTART"] == seconds.replace("-", "").replace(":", "")
        assert event["DTSTAMP"].startswith("20261002T1200")
        assert event["SUMMARY"] == f"{one['name']} {one['max_alt_deg']:.0f}°"
        told = event["DESCRIPTION"].split("\n")
        assert told[-2:] == [
            "Asked by one, two; three \\ € and so on, and so on, and so on, and so on",
            "Before: slew to Vega",
        ]


def made(folder: Path, text: str, rehearse: Any = None) -> SchedulePlan:
    """Return a plan over the made-up sky, without the command line."""
    schedule = load_schedule(Path(written(folder, text)))
    span = (utc_s("2026-10-02T18:00:00Z"), utc_s("2026-10-02T23:00:00Z"))
    situation = PlanSituation(span, span[0], Site(52.1541, 4.4908, 0.0), MountProfile(), SafetyLimits())
    sky = Loaded(made_up_sky(24), False, "sky")
    return make_plan(schedule, situation, lambda _: sky, rehearse)[0]


def test_a_pass_that_is_no_go_when_rehearsed_makes_room_for_others(tmp_path: Path) -> None:
    text = SPAN + '[[passes]]\nrule = "all, above 20°, dark"\n'
    first = made(tmp_path, text)
    refused = {one.name for one in first.passes[:2]}

    def rehearse(one: Candidate, start_utc_s: float, end_utc_s: float) -> Rehearsed:
        go = one.elements.name not in refused
        lost_s = 0.0 if go else end_utc_s - start_utc_s
        return Rehearsed(go, "go" if go else "no-go: the keyhole", end_utc_s - start_utc_s - lost_s, lost_s)

    second = made(tmp_path, text, rehearse)
    assert not refused & {one.name for one in second.passes}
    assert all(one.rehearsed is not None and one.rehearsed.go for one in second.passes)
    assert second.value < first.value
    by_rehearsal = [one for one in second.lost if one.why == "by rehearsal: no-go: the keyhole"]
    assert {one.name for one in by_rehearsal} == refused
    run_anyway = made(tmp_path, text + 'if_infeasible = "run"\n', rehearse)
    assert {one.name for one in run_anyway.passes} >= refused


def test_what_is_chosen_is_rehearsed_in_full_where_asked(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], sky: str
) -> None:
    text = (
        "from = 2026-10-02T12:00:00Z\nto = 2026-10-02T14:00:00Z\n[[fixed]]\nsatellite = '25544'\n"
        "if_sun_up = 'run'\n"
        "start = 2026-10-02T13:03:00Z\nend = 2026-10-02T13:03:40Z\n"
    )
    (one,) = planned(capsys, tmp_path, text, sky, "--rehearse")["passes"]
    assert one["rehearsed"]["go"] is True
    assert one["rehearsed"]["on_target_s"] == pytest.approx(40.0, abs=2.0)


def test_the_timeline_is_a_picture_with_the_plan_on_it(tmp_path: Path) -> None:
    image = pytest.importorskip("matplotlib.image")
    plan = made(tmp_path, SPAN + '[[passes]]\nrule = "all, above 20°, dark"\n')
    plot_plan(tmp_path / "x.png", plan, Site(52.1541, 4.4908, 0.0))
    picture = image.imread(tmp_path / "x.png")
    assert picture.shape[1] > 1000
    followed = np.abs(picture[..., :3] - np.array([0x1B, 0x7F, 0x5C]) / 255.0).max(axis=-1) < 0.02
    mount = followed[: int(0.8 * len(picture))]
    columns = mount.any(axis=0)
    stretches = int(np.sum(np.diff(columns.astype(int)) == 1))
    assert stretches == len(plan.passes)


def test_a_timeline_of_more_days_than_can_be_read_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("matplotlib")
    monkeypatch.setattr(run_plan, "DAYS_DRAWN", 1)
    plan = made(tmp_path, SPAN + '[[passes]]\nrule = "all, above 89°"\n')
    for days, told in ((1, ""), (2, "sattrack: the timeline shows only the first 1 day of the plan\n")):
        longer = msgspec.structs.replace(
            plan, to_utc=Utc.parse(plan.from_utc).plus(86400.0 * days).isoformat()
        )
        plot_plan(tmp_path / "x.png", longer, Site(52.1541, 4.4908, 0.0))
        assert capsys.readouterr().err == told


def high_sky(seed: int, count: int, low_deg: float = 30.0) -> list[Elements]:
    """Return satellites that are up for hours, below 40° as the plan begins, drawn at random."""
    rng = np.random.default_rng(seed)
    site, begin = Site(52.1541, 4.4908, 0.0), Utc.parse("2026-10-02T18:00:00Z")
    found: list[Elements] = []
    for one in random_sky(400, seed):
        high = replace(one, mean_motion_rev_day=2.0056, inclination_deg=float(rng.uniform(50.0, 70.0)))
        if low_deg < float(Propagator(high, site).at(begin).alt_deg) < 40.0:
            found.append(high)
    return found[:count]


def stays_up(one: Elements, minutes: float) -> bool:
    begin = utc_s("2026-10-02T18:00:00Z")
    at = Utc(np.array([begin, begin + 60.0 * minutes]))
    return bool(np.min(Propagator(one, Site(52.1541, 4.4908, 0.0)).at(at).alt_deg) > 30.0)


def planned_of(
    folder: Path,
    text: str,
    sky: list[Elements],
    minutes: float,
    begin_utc: str = "2026-10-02T18:00:00Z",
    followed: tuple[FollowedPass, ...] = (),
) -> SchedulePlan:
    schedule = load_schedule(Path(written(folder, text)))
    begin = utc_s(begin_utc)
    span = (begin, begin + 60.0 * minutes)
    situation = PlanSituation(
        span, begin, Site(52.1541, 4.4908, 0.0), MountProfile(), SafetyLimits(), followed=followed
    )
    return make_plan(schedule, situation, lambda _: Loaded(sky, False, "sky"))[0]


JOINED = (
    '[defaults]\nshorten = true\nsettle_s = 20\nif_sun_up = "run"\nif_infeasible = "run"\n'
    'elements_oldest_days = 3000\n[[passes]]\nrule = "all, above 30°"\n'
)


def test_a_pass_that_is_past_its_culmination_as_the_plan_begins_is_joined_as_soon_as_it_can_be(
    tmp_path: Path,
) -> None:
    joined = 0
    for one in high_sky(5, 12):
        plan = planned_of(tmp_path, JOINED, [one], 22.0)
        assert not plan.lost
        for taken in plan.passes:
            up_s = utc_s(taken.end_utc) - utc_s(plan.from_utc)
            if utc_s(taken.start_utc) - utc_s(plan.from_utc) < 60.0:
                assert taken.value == pytest.approx(up_s - 20.0, abs=0.01)
                assert taken.shortened
                assert taken.idle_s == pytest.approx(0.0, abs=0.01)
                joined += utc_s(taken.culminate_utc) == pytest.approx(utc_s(taken.start_utc), abs=0.01)
    assert joined > 1


def test_what_the_plan_cannot_reach_in_time_is_no_conflict(tmp_path: Path) -> None:
    sky = high_sky(5, 12)
    plan = planned_of(tmp_path, JOINED.replace("shorten = true", "least_s = 1310\nshorten = true"), sky, 22.0)
    assert plan.lost
    reasons = {one.reason for one in plan.lost}
    assert "beginning" in reasons or len(plan.passes) == 0
    for one in plan.lost:
        if one.reason == "beginning":
            assert "are left when the mount can be there from the beginning" in one.why


def best_sharing(plan: SchedulePlan, sky: list[Elements], step_s: float) -> float:
    """Return the largest worth of following two satellites or one, by trying all instants of change."""
    site, profile = Site(52.1541, 4.4908, 0.0), MountProfile()
    begin, end = utc_s(plan.from_utc), utc_s(plan.to_utc)
    at = np.arange(begin, end + 0.5 * step_s, step_s)
    seen = [Propagator(one, site).at(Utc(at)) for one in sky]
    up = [np.asarray(one.alt_deg) >= 30.0 for one in seen]
    tops = [int(np.argmax(one.alt_deg)) for one in seen]
    places = [
        [
            axes_of(float(h), float(d), profile, site.latitude_deg)
            for h, d in zip(one.ha_deg, one.dec_deg, strict=True)
        ]
        for one in seen
    ]
    worth = 0.0
    for a in range(len(sky)):
        rise, last = _stretch(up[a])
        first = max(rise, int(np.ceil(20.0 / step_s)))
        worth = max(worth, (last - first) * step_s)
        for b in range(len(sky)):
            if a == b:
                continue
            low, high = _stretch(up[b])
            for leave in range(first + int(60.0 / step_s), last + 1):
                if tops[a] not in (0, len(at) - 1) and tops[a] > leave:
                    continue
                for enter in range(max(low, leave), high - int(60.0 / step_s) + 1):
                    needs = slew_s(places[a][leave], places[b][enter], profile) + 20.0
                    if (enter - leave) * step_s >= needs:
                        if tops[b] in (0, len(at) - 1) or enter <= tops[b]:
                            worth = max(worth, (leave - first + high - enter) * step_s)
                        break
    return worth


def _stretch(up: NDArray[np.bool_]) -> tuple[int, int]:
    index = np.flatnonzero(up)
    return (int(index[0]), int(index[-1])) if len(index) else (0, 0)


def test_passes_that_are_joined_late_are_shared_out_as_well_as_by_trying_everything(tmp_path: Path) -> None:
    several = 0
    for seed in range(8):
        sky = [one for one in high_sky(seed + 20, 30, 10.0) if not stays_up(one, 120.0)][:6]
        plan = planned_of(tmp_path, JOINED, sky, 120.0)
        assert plan.value >= best_sharing(plan, sky, 20.0) - 40.0
        several += len(plan.passes) > 1
        for before, after in pairwise(plan.passes):
            assert after.idle_s >= -0.01
            assert utc_s(after.leave_utc) >= utc_s(before.end_utc) - 0.01
    assert several > 2


BY_THE_POLE = (
    "BY THE POLE\n"
    "1 70140U          26275.01380287  .00000000  00000+0  00000+0 0  9991\n"
    "2 70140  83.0647 307.9046 0006946 211.9293 350.1330 14.07958838588316\n"
)


def test_what_the_keyhole_takes_is_told_beforehand_and_afterwards_and_is_worth_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sky = tmp_path / "sky.tle"
    sky.write_text(BY_THE_POLE)
    span = "from = 2026-10-02T20:00:00Z\nto = 2026-10-02T20:15:00Z\n"
    text = span + "[[passes]]\nsatellite = 'BY THE POLE'\nmin_altitude_deg = 50\npriority = 2\n"
    (one,) = planned(capsys, tmp_path, text, str(sky))["passes"]
    (lost,) = one["lost_to"]
    assert (lost["limit"], lost["limit_rate_deg_s"]) == ("keyhole", 6.0)
    assert lost["peak_rate_deg_s"] == pytest.approx(13.8, abs=0.2)
    whole_s = utc_s(one["end_utc"]) - utc_s(one["start_utc"])
    assert one["useful_s"] == pytest.approx(whole_s - lost["seconds"], abs=0.01)
    assert one["value"] == pytest.approx(2.0 * one["useful_s"], abs=0.01)
    folder = tmp_path / "folder"
    options = ("--elements", str(sky), *LEIDEN, "--folder", str(folder), "--json")
    file = written(tmp_path, text)
    assert run(["run", file, "--virtual", "--mount", "sim", *options]) == 0
    capsys.readouterr()
    assert run(["run", file, "--status", "--folder", str(folder), "--json"]) == 0
    (flown,) = json.loads(capsys.readouterr().out)["passes"]
    assert flown["state"] == "done"
    assert flown["lost_to"] == one["lost_to"]
    assert flown["on_target_s"] == pytest.approx(one["useful_s"], abs=4.0)
    assert flown["held_s"]["keyhole"] + flown["rejoining_s"] == pytest.approx(lost["seconds"], abs=4.0)
    assert flown["rms_arcsec"] < 0.5
    assert flown["lost_peak_arcsec"] > 3600.0
    (summary,) = (folder / "summaries").glob("*.txt")
    assert "s to the keyhole limit" in summary.read_text()


def test_a_pass_is_not_taken_in_two_parts_about_a_better_one(tmp_path: Path) -> None:
    high = next(one for one in high_sky(5, 12) if stays_up(one, 60.0))
    fixed = (
        "[[fixed]]\nsatellite = '70999'\npriority = 1000\nif_sun_up = 'run'\nif_infeasible = 'run'\n"
        "start = 2026-10-02T18:15:00Z\nend = 2026-10-02T18:20:00Z\n"
    )
    better = replace(high_sky(6, 1)[0], name="BETTER", catalog_number=70999)
    text = JOINED.replace("all, above 30°", "all, above 30°, named SAT*") + fixed
    plan = planned_of(tmp_path, text, [high, better], 40.0)
    assert sorted(one.name for one in plan.passes) == ["BETTER", high.name]


def culminations(plan: dict[str, Any]) -> list[tuple[int, float]]:
    return [(one["catalog_number"], utc_s(one["culminate_utc"])) for one in plan["passes"]]


def test_each_satellite_once_and_so_many_an_hour_are_kept_and_said_why(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], sky: str
) -> None:
    rule = "all, above 15°, dark"
    free = planned(capsys, tmp_path, SPAN + f'[[passes]]\nrule = "{rule}"\n', sky)
    text = SPAN + f'[[passes]]\nrule = "{rule}, once a night, at most 2 an hour"\n'
    plan = planned(capsys, tmp_path, text, sky)
    numbers = [number for number, _ in culminations(plan)]
    assert len(numbers) == len(set(numbers))
    tops = [top for _, top in culminations(plan)]
    assert all(later - first >= 3600.0 for first, later in zip(tops, tops[2:], strict=False))
    assert plan["value_bound"] == plan["value"]
    assert free["value"] > plan["value"]
    reasons = {one["reason"]: one for one in plan["lost"]}
    assert {"once", "hour full"} <= set(reasons)
    once = reasons["once"]
    assert once["why"].startswith("the rule takes each satellite once a night: ")
    (place,) = once["with_numbers"]
    assert plan["passes"][place - 1]["catalog_number"] == once["catalog_number"]
    assert len(reasons["hour full"]["with_numbers"]) == 2


def test_a_plan_made_anew_counts_what_was_followed_where_rules_take_only_so_many(tmp_path: Path) -> None:
    rule = "all, above 15°, once a night, at most 2 an hour"
    text = f"[defaults]\nif_sun_up = 'run'\nif_infeasible = 'run'\n[[passes]]\nrule = \"{rule}\"\n"
    sky = made_up_sky(24)
    first = planned_of(tmp_path, text, sky, 300.0)
    followed = tuple(
        FollowedPass(one.catalog_number, utc_s(one.culminate_utc), one.asked_by)
        for one in first.passes
        if one.end_utc < "2026-10-02T20:00:00"
    )
    assert len(followed) >= 3
    later = planned_of(tmp_path, text, sky, 180.0, "2026-10-02T20:00:00Z", followed)
    tops = [utc_s(one.culminate_utc) for one in later.passes]
    assert len(tops) > 3
    assert not {one.catalog_number for one in later.passes} & {one.catalog_number for one in followed}
    every = [*(one.culminate_utc_s for one in followed), *tops]
    assert all(third - one >= 3600.0 for one, third in zip(every, every[2:], strict=False))
    whys = {(one.reason, one.why) for one in later.lost}
    assert ("taken", "followed already in this night") in whys
    # Nothing else changes: without what was followed, the plan is worth at least as much.
    assert planned_of(tmp_path, text, sky, 180.0, "2026-10-02T20:00:00Z").value >= later.value


def test_an_hour_that_was_followed_in_full_takes_no_more(tmp_path: Path) -> None:
    text = "[defaults]\nif_sun_up = 'run'\n[[passes]]\nname = 'few'\nrule = 'all, at most 1 an hour'\n"
    begin = "2026-10-02T20:00:00Z"
    free = planned_of(tmp_path, text, made_up_sky(24), 60.0, begin)
    before = (FollowedPass(99999, utc_s(begin) - 60.0, "few"),)
    full = planned_of(tmp_path, text, made_up_sky(24), 60.0, begin, before)
    assert free.passes
    assert all(utc_s(one.culminate_utc) >= utc_s(begin) + 3540.0 for one in full.passes)
    words = "the rule takes 1 an hour, and they were followed already"
    assert ("hour full", words) in {(one.reason, one.why) for one in full.lost}
    others = (before[0]._replace(asked_by="another"),)
    assert planned_of(tmp_path, text, made_up_sky(24), 60.0, begin, others).value == free.value
    # More than the rule takes were followed, as it took more until now: the other hours lose nothing by that.
    more = (before[0]._replace(culminate_utc_s=utc_s(begin) - 120.0), *before)
    one, both = (planned_of(tmp_path, text, made_up_sky(24), 180.0, begin, seen) for seen in (before, more))
    assert both.passes
    assert both.passes == one.passes


def test_an_object_with_a_note_for_a_designator_has_no_year_of_launch(tmp_path: Path) -> None:
    sky = [
        replace(one, designator=name) for one, name in zip(made_up_sky(1), ("TBA", "1998-067A"), strict=True)
    ]
    for condition in ("launched since 1990", "designator 19*"):
        text = f"[defaults]\nif_sun_up = 'run'\n[[passes]]\nrule = 'all, {condition}'\n"
        plan = planned_of(tmp_path, text, sky, 300.0)
        assert {one.name for one in (*plan.passes, *plan.lost)} <= {sky[1].name}
    nobody = planned_of(tmp_path, text, sky[:1], 300.0)
    assert "1 have no designator" in " ".join(note for asked in nobody.asked for note in asked.notes)


def test_launch_and_designator_choose_the_satellites_of_a_rule(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made = made_up_sky(24)
    launched = [replace(one, designator=f"{1990 + k}-{k:03d}A") for k, one in enumerate(made, start=1)]
    launched[-1] = replace(launched[-1], designator="")
    sky = tmp_path / "sky.tle"
    sky.write_text(write_elements(launched, "tle"))

    def names(condition: str) -> set[str]:
        text = SPAN + f'[[passes]]\nrule = "all, above 10°, {condition}"\nif_sun_up = "run"\n'
        plan = planned(capsys, tmp_path, text, str(sky))
        return {one["name"] for one in (*plan["passes"], *plan["lost"])}

    year = {one.name: one.designator[:4] for one in launched}
    every = names("longer than 1 s")
    assert len(every) > 10
    for condition, wanted in (
        ("launched 2001", {name for name in every if year[name] == "2001"}),
        ("launched since 2005", {name for name in every if year[name] >= "2005"}),
        ("launched since 1995, launched before 2003", {n for n in every if "1995" <= year[n] < "2003"}),
        ("designator 200?-*", {name for name in every if year[name][:3] == "200"}),
        ("launched since 2030", set()),
    ):
        assert names(condition) == wanted, condition


def test_a_run_that_was_left_off_is_continued_after_its_end_and_no_other(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], sky: str
) -> None:
    file = written(tmp_path, 'to = 2026-10-02T23:00:00Z\n[[passes]]\nrule = "all"\n')
    check = ["run", file, "--check", "--mount", "sim", "--elements", sky, *LEIDEN]
    begin, end = utc_s("2026-10-02T18:00:00Z"), utc_s("2026-10-02T23:00:00Z")
    for state, from_utc_s, code in (
        (RunState.WAITING, begin, 0),
        (RunState.PARKING, begin, 0),
        (RunState.ENDED, begin, 2),
        (RunState.RESTING, end, 2),
    ):
        left_off = Run(state=state, night=1, night_from_utc_s=from_utc_s, night_to_utc_s=end)
        NightFiles(tmp_path / "night.run", file).tell(view_of(left_off, None, begin, file))
        assert run([*check, "--clock", "2026-10-03T06:00:00Z"]) == code
        err = capsys.readouterr().err
        assert ("the run would end at 2026-10-02T23:00:00Z, which is over" in err) == (code == 2)
    assert run([*check, "--folder", str(tmp_path / "other"), "--clock", "2026-10-03T06:00:00Z"]) == 2


def test_a_pass_that_is_cut_short_in_a_keyhole_loses_only_what_of_it_lies_within(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # The star is wanted so soon that the satellite is left in the keyhole, which takes 12 s of the whole.
    sky = tmp_path / "sky.tle"
    sky.write_text(BY_THE_POLE)
    text = (
        "from = 2026-10-02T20:00:00Z\nto = 2026-10-02T20:15:00Z\n"
        "[[passes]]\nsatellite = 'BY THE POLE'\nmin_altitude_deg = 50\nshorten = true\n"
        "[[fixed]]\nsatellite = 'Arcturus'\nstart = 2026-10-02T20:07:20Z\nend = 2026-10-02T20:14:00Z\n"
        "min_altitude_deg = 0\n"
    )
    cut, star = planned(capsys, tmp_path, text, str(sky))["passes"]
    assert (cut["shortened"], star["name"]) == (True, "Arcturus")
    (lost,) = cut["lost_to"]
    followed_s = utc_s(cut["end_utc"]) - utc_s(cut["start_utc"])
    assert lost["limit"] == "keyhole"
    assert 0.0 < lost["seconds"] == pytest.approx(followed_s - cut["useful_s"], abs=0.01)


@pytest.mark.parametrize("most_judged", [400, 0])
def test_a_star_that_passes_the_lower_meridian_is_lost_only_where_no_turn_of_the_cables_holds_it(
    most_judged: int, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    # In 16 hours Vega goes from -24° to 217°. The axis turns 170° either way: 20° are on no turn.
    # The sky turns by 15.04° an hour.
    monkeypatch.setattr(candidates, "MOST_JUDGED", most_judged)
    file = written(
        tmp_path,
        "[[fixed]]\nsatellite = 'Vega'\nstart = 2026-10-02T16:00:00Z\nend = 2026-10-03T08:00:00Z\n"
        "if_sun_up = 'run'\n"
        "[[fixed]]\nsatellite = 'Vega'\nstart = 2026-10-03T08:00:30Z\nend = 2026-10-03T08:05:00Z\n"
        "if_sun_up = 'run'\n",
    )
    options = ("--site", "70,4.4908,0", *CLOCK, "--elements", str(tmp_path / "sky.tle"))
    (tmp_path / "sky.tle").write_text(BY_THE_POLE)
    assert run(["run", file, "--dry-run", "--json", *options]) == 0
    star, again = json.loads(capsys.readouterr().out)["passes"]
    (lost,) = star["lost_to"]
    assert lost["limit"] == "hour_angle"
    assert lost["seconds"] == pytest.approx(20.0 / 15.041 * 3600.0, abs=120.0)
    # The mount is on that turn then, from which it has to turn no further.
    assert again["slew_s"] < 6.0
