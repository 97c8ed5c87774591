"""An operator's stop of a schedule's run: kept, heeded by all that could go on, taken back by a person."""

from __future__ import annotations

import contextlib
import json
import os
import pty
import select
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec
import pytest
from programs import ended, satellite, sattrack, simulated_mount
from schedule_night import Plan, told

from sattrack.cli import stop as stop_module
from sattrack.cli.main import run
from sattrack.core.local_time import instant
from sattrack.runtime.mounts import owners
from sattrack.schedule import night_stop
from sattrack.schedule.night_stop import (
    NightRequests,
    keep_stop,
    list_night,
    listed_nights,
    stop_of,
    take_back_stop,
    unlist_night,
)
from tle.instants import Utc

if TYPE_CHECKING:
    from collections.abc import Callable

FAR_OFF = """
park_at_end = false
from = 2026-10-02T13:00:00Z
to = 2026-10-02T23:00:00Z
[[fixed]]
satellite = "25544"
if_sun_up = "run"
if_infeasible = "run"
start = 2026-10-02T14:40:00Z
end = 2026-10-02T14:42:00Z
"""
OPTIONS = ("--mount", "sim", "--site", "52.1541,4.4908,0", "--clock", "2026-10-02T13:00:00Z", "--json")


@pytest.fixture(autouse=True)
def alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Find no sessions and no runs but those of the test."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.setattr(stop_module, "owners", list)
    monkeypatch.setattr(night_stop, "this_user", lambda: 12_345)


def small(folder: Path, **more: Any) -> Plan:
    plan = Plan(
        folder, **{"nights": 1, "satellites": 14, "most": 2, "longest_s": 12.0, "least_s": 10.0, **more}
    )
    plan.write()
    return plan


def test_the_first_stop_is_kept_until_it_is_taken_back(tmp_path: Path) -> None:
    assert stop_of(tmp_path) is None
    assert take_back_stop(tmp_path) is None
    first = keep_stop(tmp_path, "the first")
    assert keep_stop(tmp_path, "the second") == first
    assert stop_of(tmp_path) == first
    assert take_back_stop(tmp_path) == first
    assert stop_of(tmp_path) is None


@pytest.mark.parametrize("data", [b"", b'{"since_utc":"2026', b"\xff\x00", b"[1]"])
def test_a_stop_that_was_cut_off_or_damaged_is_a_stop(tmp_path: Path, data: bytes) -> None:
    (tmp_path / "stop.json").write_bytes(data)
    requests = NightRequests(tmp_path)
    assert requests.asked
    assert not requests.restarts
    assert "stopped by an operator" in requests.words


def test_a_stop_whose_disk_is_full_is_a_stop(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: Any) -> int:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "write", full)
    keep_stop(tmp_path, "x")
    assert NightRequests(tmp_path).asked


def test_a_run_on_the_list_is_found_until_it_is_over_and_a_record_that_is_none_hides_no_other(
    tmp_path: Path,
) -> None:
    folders = [tmp_path / name for name in ("a.run", "b.run", "gone.run")]
    for folder in folders:
        folder.mkdir()
        assert list_night(folder, folder.with_suffix(".toml"), "192.0.2.7:15001") is None
    folders[2].rmdir()
    (tmp_path / "state" / "sattrack" / "nights" / "0.json").write_bytes(b"\x00")
    assert sorted(night.folder for night in listed_nights()) == [str(folder) for folder in folders[:2]]
    unlist_night(folders[0])
    (left,) = listed_nights()
    assert left.resume == f"sattrack run {tmp_path}/b.toml --resume"
    assert left.mount == "192.0.2.7:15001"


def test_after_a_stop_nothing_is_followed_until_a_person_resumes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plan = small(tmp_path, most=1)
    (tmp_path / "run").mkdir()
    keep_stop(tmp_path / "run", "`sattrack stop`, process 7, user 8")
    for _ in range(2):
        assert run(plan.arguments("run")) == 130
        err = capsys.readouterr().err
        assert "stopped by an operator (`sattrack stop`, process 7, user 8) at " in err
        assert f"sattrack run {tmp_path}/nights.toml --resume --folder {tmp_path}/run` resumes" in err
    assert run([*plan.arguments("run"), "--resume"]) == 0
    (night,) = told(plan.journal()).nights
    assert {result.state for result in night.results} == {"done"}


def test_the_status_tells_that_a_run_is_stopped_since_when_and_how_to_go_on(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plan = small(tmp_path, most=1)
    assert run(plan.arguments("run")) == 0
    stop = keep_stop(tmp_path / "run", "`sattrack stop`")
    capsys.readouterr()
    status = ["run", str(tmp_path / "nights.toml"), "--status", "--folder", str(tmp_path / "run")]
    assert run(status) == 0
    at = instant(float(Utc.parse(stop.since_utc).unix_s))
    assert f"STOPPED BY AN OPERATOR at {at} (`sattrack stop`)" in capsys.readouterr().out
    assert run([*status, "--json"]) == 0
    view = json.loads(capsys.readouterr().out)
    assert (view["stopped_utc"], view["stopped_by"]) == (stop.since_utc, "`sattrack stop`")
    assert "--resume" in view["resume"]
    assert run([*status, "--json", "--resume"]) == 0
    assert json.loads(capsys.readouterr().out)["stopped_utc"] is None


def waiting_runner(folder: Path) -> subprocess.Popen[str]:
    """Start a run whose pass is hours away; return it when it waits."""
    (folder / "night.toml").write_text(FAR_OFF)
    elements = Path(__file__).parents[3] / "examples" / "iss_leiden.tle"
    command = [sys.executable, "-m", "sattrack", "run", "night.toml", "--elements", str(elements), *OPTIONS]
    process = subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout is not None
    for line in process.stdout:
        view = json.loads(line)
        if view["state"] == "waiting":
            assert view["next_in_s"] > 3600.0
            return process
    raise AssertionError(process.communicate()[1])


def test_a_stop_ends_a_runner_between_passes_and_the_journal_tells_of_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    runner = waiting_runner(tmp_path)
    try:
        assert run(["stop", "--json"]) == 0
        (night,) = json.loads(capsys.readouterr().out)["nights"]
        assert (night["kept"], night["pid"]) == (True, None)
        _, err = runner.communicate(timeout=60.0)
    finally:
        runner.kill()
    assert runner.returncode == 130
    assert "--resume` resumes" in err
    *_, last = told_events(tmp_path / "night.run")
    assert last["event"] == "stop asked"
    assert "stopped by an operator (`sattrack" in last["words"]


def told_events(folder: Path) -> list[dict[str, Any]]:
    from schedule_night import rows

    return [msgspec.json.decode(row[2]) for row in rows(folder / "journal.sqlite3")]


def test_a_runner_that_hangs_is_named_and_heeds_the_stop_when_it_wakes_up(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(night_stop, "ENDS_WITHIN_S", 0.3)
    runner = waiting_runner(tmp_path)
    try:
        runner.send_signal(signal.SIGSTOP)
        assert run(["stop"]) == 0
        assert f"process {runner.pid} has not ended" in capsys.readouterr().out
        runner.send_signal(signal.SIGCONT)
        runner.communicate(timeout=60.0)
    finally:
        runner.kill()
    assert runner.returncode == 130


def test_a_run_whose_runner_was_killed_is_stopped_all_the_same(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    runner = waiting_runner(tmp_path)
    runner.kill()
    runner.communicate()
    assert run(["stop"]) == 0
    assert "it follows nothing until `sattrack run " in capsys.readouterr().out
    elements = Path(__file__).parents[3] / "examples" / "iss_leiden.tle"
    assert run(["run", "night.toml", "--elements", str(elements), *OPTIONS]) == 130


def test_a_stop_that_cannot_be_kept_says_so_and_fails_and_interrupts_the_runner(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    runner = waiting_runner(tmp_path)
    refuse: Callable[..., Any] = _refused
    monkeypatch.setattr(night_stop, "keep_stop", refuse)
    try:
        assert run(["stop"]) == 1
        assert "A RESTART MAY GO ON: the stop cannot be kept" in capsys.readouterr().err
        runner.communicate(timeout=60.0)
    finally:
        runner.kill()
    assert runner.returncode == 130


def _refused(*_: Any) -> None:
    raise OSError(13, "Permission denied")


def test_a_stop_of_a_mount_is_for_the_runs_with_that_mount_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, mount in (("a", "127.0.0.1:9"), ("b", "127.0.0.1:10")):
        (tmp_path / f"{name}.run").mkdir()
        assert list_night(tmp_path / f"{name}.run", tmp_path / f"{name}.toml", mount) is None
    run(["stop", "--mount", "xerxes://127.0.0.1:9?listen=11", "--json"])
    (night,) = json.loads(capsys.readouterr().out)["nights"]
    assert night["folder"] == str(tmp_path / "a.run")
    assert stop_of(tmp_path / "a.run") is not None
    assert stop_of(tmp_path / "b.run") is None


def test_a_runner_that_the_system_ends_in_a_pass_goes_on_with_it(tmp_path: Path) -> None:
    plan = small(tmp_path, most=1, longest_s=45.0)
    command = [sys.executable, "-m", "sattrack", *plan.arguments("run"), "--json"]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.PIPE)
    assert process.stdout is not None
    for line in process.stdout:
        if json.loads(line)["state"] == "following":
            break
    process.send_signal(signal.SIGTERM)
    _, err = process.communicate()
    assert process.returncode == 143
    assert b"terminated: its session was asked to stop the mount, see sessions.log" in err
    assert plan.run() == 0
    (night,) = told(plan.journal()).nights
    assert night.results[0].parts > 1
    assert night.results[0].cause != "stopped"


def test_a_runner_that_the_system_ends_between_passes_tells_of_no_session(tmp_path: Path) -> None:
    runner = waiting_runner(tmp_path)
    try:
        runner.send_signal(signal.SIGTERM)
        _, err = runner.communicate(timeout=60.0)
    finally:
        runner.kill()
    assert runner.returncode == 143
    words = "terminated while waiting: no pass was followed just then; a restart continues here"
    assert err.endswith(f"sattrack: {words}\n")


@pytest.mark.usefixtures("hang_ups")
@pytest.mark.skipif(shutil.which("setsid") is None, reason="gives a program a terminal of its own")
def test_a_runner_whose_terminal_is_closed_ends_as_one_that_may_be_restarted(tmp_path: Path) -> None:
    plan = small(tmp_path, most=1, longest_s=45.0)
    ours, theirs = pty.openpty()
    command = ["setsid", "--ctty", sys.executable, "-m", "sattrack", *plan.arguments("run"), "--json"]
    with open(tmp_path / "out", "wb") as out:  # noqa: PTH123 - a descriptor to hand on
        process = subprocess.Popen(command, stdin=theirs, stdout=out, stderr=theirs)
    os.close(theirs)
    _wait_until_following(tmp_path / "run", process)
    os.close(ours)
    assert process.wait(120.0) == 143
    assert plan.run() == 0
    (night,) = told(plan.journal()).nights
    assert night.results[0].parts > 1


def _wait_until_following(folder: Path, process: subprocess.Popen[bytes]) -> None:
    """Wait until a run's status says that it follows a pass."""
    while process.poll() is None:
        with contextlib.suppress(OSError):
            if b'"state":"following"' in (folder / "status.json").read_bytes():
                return
        select.select([], [], [], 0.05)


@pytest.mark.soak
@pytest.mark.parametrize("wait_s", [0.0, 12.0])
def test_a_session_that_hangs_is_followed_on_by_another_and_not_after_a_stop(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, wait_s: float
) -> None:
    _, site = satellite(tmp_path, 200.0)
    begin, end = (Utc(time.time() + ahead).isoformat("seconds") for ahead in (10.0, 170.0))
    terms = 'if_sun_up = "run"\nif_infeasible = "run"\nsettle_s = 1\nleast_s = 10\n'
    fixed = f'[[fixed]]\nsatellite = "25544"\n{terms}start = {begin}\nend = {end}\n'
    (tmp_path / "night.toml").write_text(f"park_at_end = false\n{fixed}")
    monkeypatch.chdir(tmp_path)
    with simulated_mount(site=site) as mount:
        options = ["--mount", mount.url, "--elements", "iss.tle", "--site", site]
        command = ("run", "night.toml", *options)
        with ended(sattrack(*command, cwd=tmp_path)) as runner:
            _wait_for(tmp_path, "tracking  alt")
            (hung,) = [one for one in owners() if str(mount.port) in one.mount]
            os.kill(hung.pid, signal.SIGSTOP)
            if wait_s:
                _wait_for(tmp_path, "NO NEWS for ")
                _wait_for(tmp_path, "part 2")
                _wait_for(tmp_path, "tracking  alt")
                assert not Path(f"/proc/{hung.pid}").exists()
            assert run(["stop", "--mount", mount.url]) == 0
            assert "stopped and seen at rest" in capsys.readouterr().out
            stopped_utc_s = time.time()
            runner.communicate(timeout=60.0)
            assert runner.returncode == 130
        assert run([*command]) == 130
        mount.wait_until(stopped_utc_s + 12.0)
        assert mount.moved_on_s(stopped_utc_s) == 0.0


def _wait_for(folder: Path, words: str) -> None:
    until_s = time.monotonic() + 120.0
    while time.monotonic() < until_s:
        with contextlib.suppress(OSError):
            if words in (folder / "night.run" / "status.json").read_text():
                return
        select.select([], [], [], 0.1)
    raise AssertionError(words)
