"""`sattrack stop`: whatever moves a mount, and in whatever state it is, the mount comes to rest."""

from __future__ import annotations

import json
import os
import signal
import socket
import threading
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec
import pytest
from programs import SITE, Mount, ended, free_port, sattrack, simulated_mount

from sattrack.cli import stop as stop_module
from sattrack.cli.main import run
from sattrack.core.errors import SattrackError
from sattrack.runtime.console import MountStop
from sattrack.runtime.mounts import GoesOn, Owner, owner_of, owners
from sattrack.schedule.night_stop import ListedRun, locked, stop_of

if TYPE_CHECKING:
    import subprocess
    from collections.abc import Callable

HEARD_AFTER_TURNS = 6


@pytest.fixture(autouse=True)
def alone(radio_dish: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Find no sessions but those of the test: others may run on this machine."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    monkeypatch.setattr(stop_module, "owners", list)


def moving(mount: Mount) -> subprocess.Popen[str]:
    return sattrack(
        *("mount", "move", "--ra-rate", "-1", "--seconds", "60", "--mount", mount.url, *SITE, "--json")
    )


def owner(mount: Mount) -> Owner:
    found = owner_of(mount.url.removeprefix("xerxes://").partition("?")[0])
    assert found is not None
    return found


def document(capsys: pytest.CaptureFixture[str]) -> dict[str, Any]:
    read: dict[str, Any] = json.loads(capsys.readouterr().out)
    return read


def test_a_session_stops_its_mount_and_ends_and_an_abort_goes_through_it_too(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    with simulated_mount() as mount, ended(moving(mount)) as session:
        mount.wait_until_moving(True)
        first = owner(mount)
        assert first.pid == session.pid
        assert "mount move --ra-rate -1" in first.command
        assert not first.simulated

        assert run(["mount", "slew", "5h", "10", "--mount", mount.url, *SITE]) == 1
        assert f"process {session.pid}, since" in capsys.readouterr().err
        assert run(["mount", "status", "--mount", mount.url, "--json"]) == 0
        out, err = capsys.readouterr()
        assert err.startswith("sattrack: as its owner receives it: `sattrack mount move --ra-rate -1")
        told = json.loads(out)
        assert told["status"]["ack_move_ra"]
        assert told["link"]["received"] >= 15
        assert told["link"]["lost"] == 0
        # On a busy machine the simulated mount sends less often than 20 times a second.
        assert 0.0 < told["link"]["rate_hz"] < 24.0
        assert session.poll() is None

        monkeypatch.setattr(stop_module, "owners", lambda: [first])
        assert run(["stop", "--json"]) == 0
        mount.wait_until_moving(False)
        out, _ = session.communicate(timeout=30.0)
        assert session.returncode == 130
        assert json.loads(out)["mount_stopped"] is True
        (stopped,) = document(capsys)["stopped"]
        assert (stopped["by"], stopped["at_rest"], stopped["pid"]) == ("session", True, session.pid)

        with ended(moving(mount)) as another:
            mount.wait_until_moving(True)
            assert run(["mount", "abort", "--mount", mount.url]) == 0
            mount.wait_until_moving(False)
            assert another.wait(30.0) == 130
        out, err = capsys.readouterr()
        assert out.startswith("abort: complete, acknowledged\n")
        assert "stopped and seen at rest" in err


def test_where_the_session_hangs_its_guardian_stops_the_mount_and_ends_it(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with simulated_mount() as mount, ended(moving(mount)) as session:
        mount.wait_until_moving(True)
        session.send_signal(signal.SIGSTOP)
        assert run(["stop", "--mount", mount.url]) == 0
        mount.wait_until_moving(False)
        assert session.wait(30.0) == -signal.SIGKILL
    out = capsys.readouterr().out
    assert "stopped and seen at rest" in out
    assert "its guardian saw to it" in out


def test_a_mount_whose_session_and_guardian_were_killed_is_stopped_directly(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with simulated_mount() as mount, ended(moving(mount)) as session:
        mount.wait_until_moving(True)
        children = Path(f"/proc/{session.pid}/task/{session.pid}/children").read_text().split()
        session.send_signal(signal.SIGSTOP)
        for pid in children:
            os.kill(int(pid), signal.SIGKILL)
        session.kill()
        session.wait(30.0)
        told = len(mount.truths)
        assert run(["stop", "--mount", mount.url, "--json"]) == 0
        mount.wait_until_moving(False)
        # Nothing but the stop ended the motion.
        assert len(mount.truths) > told
        (stopped,) = document(capsys)["stopped"]
        assert (stopped["by"], stopped["at_rest"], stopped["pid"]) == ("direct", True, None)

        assert run(["stop", "--mount", mount.url]) == 0
        assert capsys.readouterr().out.endswith(": stopped and seen at rest\n")


@pytest.mark.parametrize("settings", ['[mount]\nprofile = "mount.toml"\n', "zone = 3\n"])
def test_an_abort_needs_neither_profile_nor_settings(
    settings: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "sattrack.toml").write_text(settings)
    assert run(["mount", "abort", "--mount", "sim"]) == 0
    out, err = capsys.readouterr()
    assert out.startswith("abort: complete")
    assert "going on without the" in err


def test_a_stop_needs_no_folder_of_settings(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "sattrack.toml").unlink()
    monkeypatch.setenv("XDG_CONFIG_HOME", f"/{'x' * 300}")
    port = free_port()
    assert run(["stop", "--mount", f"xerxes://127.0.0.1:{port}?listen={free_port()}"]) == 4
    err = capsys.readouterr().err
    assert "going on without the settings" in err
    assert err.endswith(f"sattrack: 127.0.0.1:{port}: nothing listens for UDP there\n")


def test_nothing_to_stop_and_nobody_there(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["stop"]) == 2
    assert capsys.readouterr().err == (
        "sattrack: nothing to stop: no session of yours moves a mount on this machine; "
        "--mount URL stops a real mount directly\n"
    )
    assert run(["stop", "--mount", "telescope://127.0.0.1:1/0"]) == 2
    port = free_port()
    assert run(["stop", "--mount", f"xerxes://127.0.0.1:{port}?listen={free_port()}", "--json"]) == 4
    out, err = capsys.readouterr()
    assert json.loads(out)["stopped"][0]["at_rest"] is None
    assert err.endswith(f"sattrack: 127.0.0.1:{port}: nothing listens for UDP there\n")


def session_of(mount: str, command: str, listen_port: int = 15002, simulated: bool = False) -> Owner:
    words, since = f"sattrack {command}", "2026-03-01T00:00:00Z"
    return Owner(1, os.getuid(), words, since, mount, listen_port, simulated=simulated)


DOME = session_of("192.0.2.7:15001", "track 25544 --mount xerxes://192.0.2.7:15001?listen=15002")
YARD = session_of("192.0.2.8:15001", "run night.toml")
DEMO = session_of("127.0.0.1:40001", "demo --headless", simulated=True)
PRACTICE = session_of("127.0.0.1:40002", "track 25544", simulated=True)


@pytest.fixture
def stopped(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Collect the mounts whose sessions are asked to stop; nobody is there to be asked which."""
    mounts: list[str] = []

    def stop(owner: Owner, _: Callable[[], None]) -> MountStop:
        mounts.append(owner.mount)
        return MountStop(owner.mount, "session", True, owner.pid, owner.command, "stopped and seen at rest")

    monkeypatch.setattr(stop_module, "stop_session", stop)
    return mounts


def test_without_a_simulated_mount_sim_stops_nothing(
    stopped: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(stop_module, "owners", lambda: [DOME])
    assert run(["stop", "--mount", "sim"]) == 2
    assert "nothing to stop" in capsys.readouterr().err
    assert stopped == []


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        ('url = "antenna://127.0.0.1:7621"', "Ctrl-C in the terminal of `sattrack track` stops an antenna"),
        ('url = "xerxes://a..b:15001?listen=15001"', "no such host 'a..b'"),
        ('profile = "mount.toml"', "mount.toml: cannot read the mount profile"),
    ],
    ids=["an antenna's controller", "a host that is not found", "a profile that is not there"],
)
def test_no_mount_and_profile_of_the_settings_keep_a_session_from_being_stopped(
    settings: str,
    says: str,
    stopped: list[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    (tmp_path / "sattrack.toml").write_text(f"[mount]\n{settings}\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(stop_module, "owners", lambda: [DOME])
    assert run(["stop"]) == 0
    assert stopped == [DOME.mount]
    assert says in capsys.readouterr().err


def test_a_guardian_that_goes_on_is_told_in_a_sentence_of_its_own(
    stopped: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    goes_on = GoesOn(7, "2026-11-23T12:00:00Z", "it turns at 1 °/s")
    gone = "ended without a word, its guardian stops the mount"
    for owner, says in (
        (msgspec.structs.replace(DOME, goes_on=goes_on), f"`{DOME.command}` has ended, the mount"),
        (msgspec.structs.replace(DOME, state=gone), f"`{DOME.command}`, process {DOME.pid}, since "),
    ):
        monkeypatch.setattr(stop_module, "owners", lambda one=owner: [one])
        assert run(["stop"]) == 0
        assert stopped.pop() == DOME.mount
        err = capsys.readouterr().err
        assert f"stopping {DOME.mount}: {says}" in err
    assert f"; it {gone}\n" in err


@pytest.mark.parametrize(
    ("sessions", "options", "expected"),
    [
        ([DOME], [], [DOME]),
        ([DEMO], [], [DEMO]),
        ([DEMO, DOME, PRACTICE], [], [DOME]),
        ([DEMO, DOME, PRACTICE], ["--all"], [DEMO, DOME, PRACTICE]),
        ([DOME, YARD], ["--all"], [DOME, YARD]),
        # By the name that the list shows, and the simulated one by that of all simulated ones.
        ([DOME, YARD, DEMO], ["--mount", YARD.mount], [YARD]),
        ([DOME, YARD, DEMO], ["--mount", "sim"], [DEMO]),
    ],
)
def test_the_only_mount_the_only_real_one_and_all_of_them_are_stopped_at_once(
    sessions: list[Owner],
    options: list[str],
    expected: list[Owner],
    stopped: list[str],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(stop_module, "owners", lambda: list(sessions))
    by_name = {session.mount: session for session in sessions}
    monkeypatch.setattr(stop_module, "owner_of", by_name.get)
    assert run(["stop", *options]) == 0
    assert sorted(stopped) == sorted(each.mount for each in expected)
    out, err = capsys.readouterr()
    for each in sessions:
        assert (f"stopping {each.mount}: asking `{each.command}`" in err) == (each in expected)
        told = each not in expected and "--mount" not in options
        assert (f"still runs: {each.mount}" in err) == told
    assert out.count("stopped and seen at rest") == len(expected)


@pytest.mark.parametrize("sessions", [[DOME, YARD], [DEMO, PRACTICE]])
def test_of_several_none_is_stopped_where_nobody_can_say_which(
    sessions: list[Owner],
    stopped: list[str],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(stop_module, "owners", lambda: list(sessions))
    assert run(["stop"]) == 2
    err = capsys.readouterr().err
    assert not stopped
    for each in sessions:
        assert f"{each.mount}  `{each.command}`, process 1" in err
    assert (
        "`sattrack stop --all` stops all of them, `sattrack stop --mount NAME` one, by its name above" in err
    )


@pytest.mark.parametrize(
    ("typed", "expected"),
    [
        ("\n", [DOME, YARD, DEMO]),
        ("a\n", [DOME, YARD, DEMO]),
        (" \n", [DOME, YARD, DEMO]),
        ("2\n", [YARD]),
        ("9\n3\n", [DEMO]),
        ("help\nq\n", []),
        ("", [DOME, YARD, DEMO]),
        (None, [DOME, YARD, DEMO]),
    ],
    ids=["enter", "a", "space", "second", "wrong, third", "none", "input ended", "no answer"],
)
def test_on_a_terminal_the_operator_says_which_and_no_answer_stops_all(
    typed: str | None,
    expected: list[Owner],
    stopped: list[str],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(stop_module, "owners", lambda: [DEMO, DOME, YARD])
    monkeypatch.setattr(stop_module, "_somebody_there", lambda: True)
    ends = socket.socketpair()
    with ends[0] as terminal, ends[1] as keys, terminal.makefile("r") as stdin:
        monkeypatch.setattr("sys.stdin", stdin)
        if typed is None:
            monkeypatch.setattr(stop_module, "ANSWER_WITHIN_S", 0.0)
        else:
            keys.sendall(typed.encode())
            keys.shutdown(socket.SHUT_WR)
        assert run(["stop"]) == (0 if expected else 1)
    assert sorted(stopped) == sorted(each.mount for each in expected)
    assert "ENTER stops all of them, 1-3 that one, q none" in capsys.readouterr().err


def test_a_session_that_hangs_keeps_no_other_from_being_stopped(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    other_stopped = threading.Event()

    def stop(owner: Owner, _: Callable[[], None]) -> MountStop:
        if owner is DOME:
            assert other_stopped.wait(60.0)
            raise SattrackError("it does not answer")
        other_stopped.set()
        return MountStop(owner.mount, "session", True, owner.pid, owner.command, "stopped")

    monkeypatch.setattr(stop_module, "stop_session", stop)
    monkeypatch.setattr(stop_module, "owners", lambda: [DOME, YARD])
    assert run(["stop", "--all", "--json"]) == 1
    told = document(capsys)
    assert [each["mount"] for each in told["stopped"]] == [YARD.mount]
    assert told["errors"] == ["it does not answer"]


@pytest.mark.parametrize(
    ("by", "at_rest", "code"),
    [
        ("session", True, 0),
        ("guardian", True, 0),
        ("direct", False, 1),
        ("direct", None, 4),
        ("gone", None, 0),
    ],
)
def test_only_a_mount_seen_at_rest_counts_as_stopped(by: str, at_rest: bool | None, code: int) -> None:
    error = MountStop("192.0.2.7:15001", by, at_rest, None, None, "so").error()
    assert (0 if error is None else error.exit_code) == code


def test_a_console_beside_an_owner_looks_on_and_its_stop_goes_through_the_owner() -> None:
    with simulated_mount() as mount, ended(moving(mount)) as session:
        mount.wait_until_moving(True)
        arguments = ("watch", "--stream", "--control", "--mount", mount.url, *SITE)
        with ended(sattrack("mount", *arguments)) as console:
            assert console.stdin is not None
            assert console.stdout is not None
            for line in console.stdout:
                view = json.loads(line)
                if view["status"] is not None and view["link"]["received"] > 10:
                    break
            assert view["status"]["ack_move_ra"]
            assert view["warnings"][0].startswith("looking on; SPACE has the mount's owner stop it")
            console.stdin.write('{"type":"jog","dec_rate_deg_s":1.0}\n')
            console.stdin.flush()
            for line in console.stdout:
                view = json.loads(line)
                if view["refusal"] is not None:
                    break
            assert view["refusal"] == "this mount has another owner"
            assert session.poll() is None
            console.stdin.write('{"type":"abort"}\n')
            console.stdin.flush()
            mount.wait_until_moving(False)
            out, _ = session.communicate(timeout=30.0)
            assert session.returncode == 130
            assert json.loads(out)["mount_stopped"] is True
            console.stdin.close()
            console.stdout.read()
            assert console.wait(30.0) == 0


def test_a_simulated_mount_that_ends_while_it_is_stopped_is_gone(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    with simulated_mount() as mount:
        shown: list[int] = []

        def show(_: object) -> None:
            shown.append(1)
            if len(shown) == HEARD_AFTER_TURNS:
                mount.end()

        session = session_of(f"127.0.0.1:{mount.port}", "serve rotctld", free_port(), True)
        monkeypatch.setattr(stop_module.StopProgress, "show", show)
        monkeypatch.setattr(stop_module, "stop_session", lambda *_: None)
        monkeypatch.setattr(stop_module, "owners", lambda: [session])
        assert run(["stop", "--all", "--json"]) == 0
    told = document(capsys)
    assert told["errors"] == []
    assert [each["by"] for each in told["stopped"]] == ["gone"]


def test_a_simulated_mount_that_died_needs_no_stop_and_no_console(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with ended(sattrack("demo", "--headless", "--seconds", "60")) as session:
        assert session.stderr is not None
        assert "link up" in next(line for line in session.stderr if "link up" in line)
        children = Path(f"/proc/{session.pid}/task/{session.pid}/children").read_text().split()
        of = {pid: Path(f"/proc/{pid}/cmdline").read_text() for pid in children}
        (simulator,) = (pid for pid, line in of.items() if "simulator.process" in line)
        (guardian,) = (int(pid) for pid, line in of.items() if "runtime.guardian" in line)
        (mine,) = (one for one in owners() if one.pid == session.pid)
        os.kill(int(simulator), signal.SIGKILL)
        assert run(["stop", "--mount", f"xerxes://{mine.mount}?listen={free_port()}"]) == 0
        out, err = capsys.readouterr()
        assert "the simulated mount has ended with its session" in out
        assert "NOT KNOWN AT REST" not in out + err
        session.communicate(timeout=30.0)
        assert session.returncode in {4, 130}
    with pytest.raises(ProcessLookupError):
        os.kill(guardian, 0)


def test_a_stop_of_a_simulated_mount_stops_the_schedule_that_moves_it(tmp_path: Path) -> None:
    """Its sessions' commands are long: what is kept of them need not tell the mount."""
    session = session_of("127.0.0.1:40001", "track 25544 --headless --stream --control", simulated=True)
    with locked(tmp_path):
        night = ListedRun(str(tmp_path), "night.toml", None)
        mounts = stop_module.Mounts((session,), None, (night,))
        assert stop_module._chosen(mounts, as_json=True).nights == (night,)


@pytest.mark.parametrize("mount", [None, DOME.mount])
def test_a_schedule_that_waits_is_stopped_by_the_name_that_the_list_shows(
    mount: str | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Between its passes no session owns its mount."""
    night = ListedRun(str(tmp_path), str(tmp_path / "night.toml"), mount)
    monkeypatch.setattr(stop_module, "listed_nights", lambda: [night])
    monkeypatch.setattr(stop_module, "owner_of", lambda _: None)
    with locked(tmp_path):
        (line,) = stop_module.Mounts((), None, (night,)).lines()
    assert run(["stop", "--mount", line.partition("  ")[0]]) == 0
    assert stop_of(tmp_path) is not None
    assert "night.toml" in capsys.readouterr().out


def test_an_embedded_mounts_session_says_that_it_is_simulated() -> None:
    with ended(sattrack("demo", "--headless", "--json")) as demo:
        assert demo.stderr is not None
        next(line for line in demo.stderr if "waiting" in line or "slewing" in line)
        assert [each.simulated for each in owners() if each.pid == demo.pid] == [True]
