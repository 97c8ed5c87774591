"""Other users of the machine may take any name of ours: what they say there is believed in nothing."""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import select
import subprocess
import sys
from types import SimpleNamespace
from typing import TYPE_CHECKING

import msgspec
import pytest

from sattrack.core.errors import SattrackError
from sattrack.mount.model import MountProfile
from sattrack.mount.xerxes.client import Address
from sattrack.mount.xerxes.datagrams import Command, decode_command, encode_command
from sattrack.runtime import mounts as mounts_module
from sattrack.runtime.connection import owned
from sattrack.runtime.console import stop_session
from sattrack.runtime.mounts import ask_give_up, owner_of
from sattrack.runtime.view_server import RunViews
from sattrack.schedule import night_stop
from sattrack.tui.attached import welcomed
from sattrack.views.run import Welcome

if TYPE_CHECKING:
    import socket
    from collections.abc import Callable, Iterator
    from pathlib import Path

pytestmark = pytest.mark.usefixtures("own_state")
NOBODY = 65534
MOVING = encode_command(Command(7, move_ra=True, move_ra_rate_deg_s=1.0))
STRANGER = """
import json, os, socket, sys
name, answers = sys.argv[1], json.loads(sys.argv[2])
listener = socket.socket(socket.AF_UNIX)
listener.bind("\\0" + name)
os.setuid(65534)
listener.listen(16)
print("listens", flush=True)
kept = []
while True:
    connection, _ = listener.accept()
    kept.append(connection)
    answer = answers.get(json.loads(connection.recv(4096)).get("ask", "hello"))
    if answer is not None:
        connection.sendall(json.dumps(answer).encode() + b"\\n")
"""
LIE = {
    "pid": 1,
    "user": 0,
    "command": "sattrack track ISS \x1b[2J",
    "since_utc": "2026-10-02T13:00:00Z",
    "mount": "192.0.2.7:4000",
    "listen_port": 0,
}
AT_REST = {"by": "session", "at_rest": True}

NEEDS_ROOT = pytest.mark.skipif(os.geteuid() != 0, reason="only root may become another user")


@pytest.fixture
def stranger() -> Iterator[Callable[[str, object], int]]:
    """Give a function that has another user take a name and answer there; it returns the process."""
    with contextlib.ExitStack() as processes:

        def take(name: str, answers: object) -> int:
            words = [sys.executable, "-c", STRANGER, name, json.dumps(answers)]
            process = processes.enter_context(subprocess.Popen(words, stdout=subprocess.PIPE))
            processes.callback(process.kill)
            assert process.stdout is not None
            assert process.stdout.readline() == b"listens\n"
            return process.pid

        yield take


def name_of(mount_socket: socket.socket) -> str:
    return f"127.0.0.1:{mount_socket.getsockname()[1]}"


@NEEDS_ROOT
def test_who_has_taken_a_mounts_name_is_known_by_the_kernels_word(mount_socket, stranger) -> None:
    pid = stranger(f"sattrack-mount/{name_of(mount_socket)}", {"who": LIE})
    owner = owner_of(name_of(mount_socket))
    assert owner is not None
    assert (owner.pid, owner.user, owner.mount, owner.trusted) == (pid, NOBODY, name_of(mount_socket), False)
    assert str(owner).startswith(f"`sattrack track ISS ?[2J`, process {pid} of user nobody, since ")


@NEEDS_ROOT
def test_a_mount_is_not_at_rest_by_a_strangers_word_and_is_sent_an_abort(mount_socket, stranger) -> None:
    stranger(f"sattrack-mount/{name_of(mount_socket)}", {"who": LIE, "stop": AT_REST})
    owner = owner_of(name_of(mount_socket))
    assert owner is not None
    assert stop_session(owner, lambda: None) is None
    assert decode_command(mount_socket.recv(200)).abort


@pytest.fixture
def waits(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Return for how long answers are waited for, each time."""
    waits = list[float]()

    def watched(readers, writers, others, seconds):
        waits.append(seconds)
        return select.select(readers, writers, others, min(seconds, 0.5))

    monkeypatch.setattr(mounts_module, "select", SimpleNamespace(select=watched))
    monkeypatch.setattr(mounts_module, "ANSWER_WITHIN_S", 0.5)
    return waits


@NEEDS_ROOT
def test_names_of_strangers_are_not_waited_for(
    mount_socket, stranger, waits: list[float], monkeypatch: pytest.MonkeyPatch
) -> None:
    names = [f"{name_of(mount_socket)}/{k}" for k in range(3)]
    for name in names:
        stranger(f"sattrack-mount/{name}", {})
    monkeypatch.setattr(mounts_module, "this_user", lambda: 1000)
    monkeypatch.setattr(mounts_module, "taken_names", lambda prefix: names)
    assert mounts_module.owners() == []
    assert sum(waits) == 0.0


@NEEDS_ROOT
def test_for_root_silent_names_are_waited_for_together(
    mount_socket, stranger, waits: list[float], monkeypatch: pytest.MonkeyPatch
) -> None:
    address = Address("127.0.0.1", mount_socket.getsockname()[1], 0)
    names = [f"{name_of(mount_socket)}/{k}" for k in range(3)]
    for name in names:
        stranger(f"sattrack-mount/{name}", {})
    monkeypatch.setattr(mounts_module, "taken_names", lambda prefix: [*names, address.name])
    with owned(address, MountProfile()) as (_, guard):
        waits.clear()
        found = {owner.mount: owner.state for owner in mounts_module.owners()}
        guard.release(None)
    assert found == {address.name: "running", **dict.fromkeys(names, "does not answer")}
    assert len([seconds for seconds in waits if seconds > 0.25]) <= 2


@NEEDS_ROOT
def test_a_guardian_gives_up_for_its_own_user_alone(mount_socket) -> None:
    address = Address("127.0.0.1", mount_socket.getsockname()[1], 0)
    with owned(address, MountProfile()) as (_, guard):
        assert guard.beat(MOVING)
        guard.release(False)
    asking = (
        "import os, socket, sys\n"
        "os.setuid(65534)\n"
        "guardian = socket.socket(socket.AF_UNIX)\n"
        "guardian.connect('\\0sattrack-mount/' + sys.argv[1])\n"
        'guardian.sendall(b\'{"ask":"give-up"}\\n\')\n'
        "print(guardian.recv(4096).decode())"
    )
    answer = subprocess.check_output([sys.executable, "-c", asking, address.name], timeout=60)
    assert json.loads(answer) == {"was": None}
    owner = owner_of(address.name)
    assert owner is not None
    assert owner.goes_on is not None
    assert ask_give_up(owner) is not None


@NEEDS_ROOT
def test_what_has_taken_a_runs_name_is_no_run(stranger) -> None:
    welcome = Welcome(1, os.getpid(), "sattrack track", "2026-10-02T13:00:00Z", "sim", "ISS")
    stranger(f"sattrack-run/{os.getpid()}", {"hello": json.loads(msgspec.json.encode(welcome))})
    with pytest.raises(SattrackError, match=f"process {os.getpid()} has no run to watch"):
        welcomed(os.getpid(), "")
    views = RunViews(os.getpid(), "")
    views.look()
    assert views.readers() == []


def test_a_pipe_on_a_users_list_of_runs_is_not_waited_for(tmp_path: Path) -> None:
    listed = tmp_path / "sattrack" / "nights"
    listed.mkdir(parents=True)
    os.mkfifo(listed / "a.json")
    assert night_stop.listed_nights() == []


@pytest.mark.parametrize("number", ["-1", "1", "0"])
def test_a_number_that_may_be_anybodys_process_is_no_runner(tmp_path: Path, number: str) -> None:
    with lock_of(tmp_path, number):
        assert night_stop.holder(tmp_path) is None


@NEEDS_ROOT
def test_a_runner_is_a_process_of_the_user_who_holds_the_lock(tmp_path: Path) -> None:
    with lock_of(tmp_path, str(os.getpid())) as lock:
        assert night_stop.holder(tmp_path) == os.getpid()
        os.fchown(lock, NOBODY, -1)
        assert night_stop.holder(tmp_path) is None


def test_a_list_that_is_a_link_elsewhere_is_none(tmp_path: Path) -> None:
    listed = tmp_path / "sattrack" / "nights"
    listed.mkdir(parents=True)
    night = night_stop.ListedRun(str(tmp_path), "night.toml", None)
    (tmp_path / "real.json").write_bytes(msgspec.json.encode(night))
    (listed / "a.json").symlink_to(tmp_path / "real.json")
    assert night_stop.listed_nights() == []
    (listed / "b.json").write_bytes(msgspec.json.encode(night))
    assert night_stop.listed_nights() == [night]


def test_nobody_else_can_hold_a_runs_lock(tmp_path: Path) -> None:
    with night_stop.locked(tmp_path):
        assert (tmp_path / night_stop.LOCK_NAME).stat().st_mode & 0o077 == 0


@contextlib.contextmanager
def lock_of(folder: Path, number: str) -> Iterator[int]:
    """Hold a folder's lock as its runner does, with a process number of our choice."""
    lock = os.open(folder / night_stop.LOCK_NAME, os.O_RDWR | os.O_CREAT, 0o600)
    try:
        os.write(lock, f"{number}\n".ljust(night_stop.PID_CELLS).encode())
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield lock
    finally:
        os.close(lock)
