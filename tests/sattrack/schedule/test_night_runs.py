"""Schedules run night after night in virtual time, as users run them: troubles, sudden ends, what is told."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import late_start
import pytest
import schedule_night
from schedule_night import Margins, Plan, rows, told, watched

from sattrack.cli.main import run
from sattrack.cli.run_night import why_not_parked
from sattrack.schedule.night import Mount, Parked, Run, RunSettings, RunState
from sattrack.schedule.night_stop import locked
from sattrack.schedule.virtual_executor import VirtualExecutor

AROUND = (
    'before = [{ do = "slew", star = "Vega", wait_s = 3 },\n'
    '          { do = "command", run = ["./dome"], timeout_s = 20, if_it_fails = "skip" },\n'
    '          { do = "search", how = "sweep", reach_s = 1, period_s = 8, seconds = 10 }]\n'
    'after = [{ do = "command", run = ["./dome"], timeout_s = 20 }]\n'
)
BENCH = str(Path(schedule_night.__file__))
LATE = f"""
import sys
from functools import partial
sys.path[:0] = {[str(Path(one.__file__).parent) for one in (schedule_night, late_start)]!r}
from late_start import APPROACH_S
from sattrack.control.tracker import TrackPlan
from sattrack.schedule import virtual_executor
virtual_executor.TrackPlan = partial(TrackPlan, approach_s=APPROACH_S)
import schedule_night
schedule_night.main()
"""
"""The bench with passes that are flown from shortly before each on, as in this process."""


def small(folder: Path, **more: Any) -> Plan:
    plan = Plan(
        folder, **{"nights": 1, "satellites": 14, "most": 2, "longest_s": 12.0, "least_s": 10.0, **more}
    )
    plan.write()
    return plan


def test_two_nights_of_troubles_have_every_pass_accounted_for_the_mount_parked_and_no_limit_broken(
    tmp_path: Path,
) -> None:
    plan = small(tmp_path, nights=2, most=3, seed=8, extra=AROUND)
    margins = Margins()
    with watched(margins):
        assert plan.run() == 0
    found = told(plan.journal())
    assert len(found.nights) == 2
    results = [result for night in found.nights for result in night.results]
    assert len(results) == sum(len(night.passes) for night in found.nights) == 6
    assert {result.state for result in results} > {"done"}
    assert all(result.state == "done" or result.cause for result in results)
    assert [night.mount for night in found.nights] == [Mount.PARKED, Mount.PARKED]
    assert margins.looks > 5000
    assert min(margins.altitude, margins.hour_angle, margins.sun) > 0.0
    log = (tmp_path / "run.log").read_text()
    assert "Traceback" not in log
    # Run once more it has nothing to do, and does nothing.
    before = rows(plan.journal())
    assert plan.run() == 0
    assert [row[3] for row in rows(plan.journal())[len(before) :]] == ["ended"]


def test_the_same_seed_gives_the_same_journal_and_another_one_another(tmp_path: Path) -> None:
    plan = small(tmp_path, seed=8, extra=AROUND)
    assert plan.run("one") == plan.run("other") == 0
    assert rows(plan.journal("one")) == rows(plan.journal("other"))
    plan.seed = 9
    assert plan.run("third") == 0
    assert rows(plan.journal("one")) != rows(plan.journal("third"))


def test_an_end_with_the_mount_not_parked_is_told_and_is_no_success(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(self: VirtualExecutor, *_: object) -> Parked:
        return Parked(utc_s=self.now_utc_s, mount=Mount.AT_REST, words="the mount is silent")

    monkeypatch.setattr(VirtualExecutor, "_park", fails)
    plan = small(tmp_path, most=1)
    # Run once more it has nothing to do, and the mount is where it was.
    for _ in range(2):
        assert run(plan.arguments("run")) == 1
        out, err = capsys.readouterr()
        assert "THE MOUNT IS NOT PARKED" in out
        assert err.splitlines()[-1] == (
            "sattrack: THE MOUNT IS NOT PARKED: the mount is silent; look at it, then `sattrack mount park`, "
            "or park it by hand"
        )


@pytest.mark.parametrize(
    ("park", "mount", "parked_utc_s", "why"),
    [
        (True, Mount.PARKED, 1.0, None),
        (True, Mount.AT_PARK, 1.0, None),
        (False, Mount.AT_REST, 0.0, None),
        (True, Mount.UNKNOWN, 0.0, None),
        (True, Mount.UNKNOWN, 1.0, "it was not sent there, or did not get there"),
        (True, Mount.AT_REST, 0.0, "it was not sent there, or did not get there"),
    ],
)
def test_a_mount_that_was_never_moved_or_is_not_to_be_parked_is_not_missed(
    park: bool, mount: Mount, parked_utc_s: float, why: str | None
) -> None:
    settings = RunSettings(0.0, None, 0.0, park=park)
    assert why_not_parked(Run(settings=settings, mount=mount, parked_utc_s=parked_utc_s)) == why


def figures(words: str, pattern: str) -> list[int]:
    match = re.search(pattern, words)
    assert match, words
    return [int(number) for number in match.groups()]


KILLED = r"killed (\d+) times in (\d+) passes.* of the others (\d+) differ; (\d+) were followed twice"


def test_a_runner_killed_at_random_instants_loses_only_what_it_was_dead_for() -> None:
    options = ["--nights", "1", "--satellites", "14", "--most", "2", "--longest", "30", "--kills", "5"]
    done = subprocess.run([sys.executable, "-c", LATE, *options], capture_output=True, text=True, check=True)
    kills, passes, differ, twice = figures(done.stdout, KILLED)
    assert kills >= 4
    assert passes == 2
    assert (differ, twice) == (0, 0)


@pytest.mark.soak
def test_ten_nights_with_300_kills_come_to_the_same_but_for_passes_in_progress() -> None:
    options = ["--nights", "10", "--satellites", "60", "--most", "3", "--longest", "60", "--kills", "300"]
    done = subprocess.run([sys.executable, BENCH, *options], capture_output=True, text=True, check=True)
    kills, passes, differ, twice = figures(done.stdout, KILLED)
    assert kills >= 290
    assert passes == 30
    assert (differ, twice) == (0, 0)


@pytest.mark.soak
def test_fourteen_nights_of_300_satellites_run_300_times_faster_than_real_time() -> None:
    done = subprocess.run(
        [sys.executable, BENCH, "--most", "4", "--longest", "150", "--again"],
        capture_output=True,
        text=True,
        check=True,
    )
    (left,) = figures(done.stdout, r"(\d+) not accounted for")
    parked, nights = figures(done.stdout, r"parked at the end of (\d+) of (\d+) nights")
    (ratio,) = figures(done.stdout, r"(\d+) by the processor's time")
    assert (left, parked, nights) == (0, 14, 14)
    assert ratio >= 300
    assert "-" not in done.stdout.split("at the nearest")[1].split("turns")[0]
    assert "the same journal" in done.stdout


def test_the_status_and_the_lines_of_json_tell_each_pass_and_the_summaries_hold_the_figures(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plan = small(tmp_path)
    assert run([*plan.arguments("run"), "--json"]) == 0
    out, _ = capsys.readouterr()
    views = [json.loads(line) for line in out.splitlines()]
    states = [view["state"] for view in views]
    assert states[0] == "planning"
    assert states[-1] == "ended"
    assert {"waiting", "following", "parking", "summing up"} <= set(states)
    following = next(view for view in views if view["state"] == "following")
    assert following["passes"][following["current"] - 1]["state"] == "in progress"
    last = views[-1]
    assert [one["state"] for one in last["passes"]] == ["done", "done"]
    where = ("--folder", str(tmp_path / "run"))
    assert run(["run", str(tmp_path / "nights.toml"), "--status", "--json", *where]) == 0
    status = json.loads(capsys.readouterr().out)
    assert status["running"] is False
    assert status["passes"] == last["passes"]
    assert run(["run", str(tmp_path / "nights.toml"), "--status", *where]) == 0
    text = capsys.readouterr().out
    assert "does not run" in text
    assert all(one["name"] in text for one in last["passes"])
    summary = (tmp_path / "run" / last["summary"]).read_text()
    page = (tmp_path / "run" / last["summary"]).with_suffix(".html").read_text()
    for words in (summary, page):
        assert "2 of 2 passes done" in words
        assert "the mount is parked" in words
        assert all(f"{one['on_target_s']:.0f} of " in words for one in last["passes"])


def test_a_second_runner_of_the_same_folder_is_refused_and_told_whose_it_is(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plan = small(tmp_path)
    with locked(tmp_path / "run"):
        assert run(plan.arguments("run")) == 1
    err = capsys.readouterr().err
    assert f"process {os.getpid()} runs this schedule" in err
    assert "Traceback" not in err


def test_a_status_of_what_was_never_run_is_an_error_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plan = small(tmp_path)
    assert run(["run", str(plan.folder / "nights.toml"), "--status"]) == 1
    assert "was never run here" in capsys.readouterr().err


def test_an_interrupt_in_a_pass_stops_the_mount_ends_with_130_and_the_rest_is_run_later(
    tmp_path: Path,
) -> None:
    plan = small(tmp_path, longest_s=45.0)
    command = [sys.executable, "-m", "sattrack", *plan.arguments("run"), "--json"]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.PIPE)
    assert process.stdout is not None
    for line in process.stdout:
        if json.loads(line)["state"] == "following":
            break
    process.send_signal(signal.SIGINT)
    _, err = process.communicate()
    assert process.returncode == 130
    assert b"run it again to continue" in err
    assert plan.run() == 0
    (night,) = told(plan.journal()).nights
    assert [result.state for result in night.results][1:] == ["done"]
    assert (night.results[0].cause, night.results[0].parts, night.mount) == ("stopped", 1, Mount.PARKED)


def test_a_schedule_that_is_changed_by_day_into_something_wrong_costs_nights_and_not_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = small(tmp_path, nights=3, most=1)
    from sattrack.schedule import virtual_executor

    schedule, perform = tmp_path / "nights.toml", virtual_executor.VirtualExecutor.perform
    good = schedule.read_text()

    def edited(self: Any, order: Any, at: Any) -> Any:
        text = "[[passes]]\nrule = 7\n" if at.night == 2 else good
        if schedule.read_text() != text:
            schedule.write_text(text)
        return perform(self, order, at)

    monkeypatch.setattr(virtual_executor.VirtualExecutor, "perform", edited)
    assert plan.run() == 0
    nights = told(plan.journal()).nights
    assert [len(night.passes) for night in nights] == [1, 0, 1]
    assert "no plan: " in nights[1].notes[0]
    assert "nights.toml:2:8" in nights[1].notes[0]


def test_nights_for_which_the_computer_was_off_cost_no_evening_and_no_trouble(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = small(tmp_path, nights=3, most=1)
    from sattrack.schedule import virtual_executor

    wait = virtual_executor.VirtualExecutor._wait
    slept: list[float] = []

    def sleeping(self: Any, until_utc_s: float, at: Any) -> Any:
        # A clock is not watched while its computer is off: the second night is over as the wait ends.
        if at.night == 2 and at.state is RunState.RESTING and not slept:
            slept.append(until_utc_s + 1.2 * 86_400.0)
            self.now_utc_s = slept[0]
        return wait(self, until_utc_s, at)

    monkeypatch.setattr(virtual_executor.VirtualExecutor, "_wait", sleeping)
    assert plan.run() == 0
    nights = told(plan.journal()).nights
    assert [len(night.passes) for night in nights] == [1, 0, 1]
    assert nights[1].notes == ()
    assert nights[2].night_from_utc_s <= slept[0] < nights[2].night_to_utc_s
