"""The guardian with real processes: feeders are killed and halted, and the true axes tell what follows."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from guardian import FAST_DEG_S, Feeder, gone, is_guardian, many, some_moves
from programs import PATIENCE_S, SITE, simulated_mount

from sattrack.core.errors import SattrackError
from sattrack.mount.model import MountProfile
from sattrack.mount.xerxes.client import Address
from sattrack.mount.xerxes.datagrams import Command, decode_command, encode_command
from sattrack.mount.xerxes.standstill import HANGS_S
from sattrack.runtime import connection
from sattrack.runtime.connection import HANG_AFTER_S, LOOK_EVERY_BEATS, Guarded, owned
from sattrack.runtime.guardian import GONE_AFTER_S, OBEY_WITHIN_S, POLL_S, FeederWatch, Release, Word
from sattrack.runtime.mounts import Taken, ask_give_up, claim, owner_of

if TYPE_CHECKING:
    import socket

pytestmark = pytest.mark.usefixtures("radio_dish")
WITHIN_S = 10.0
"""Long for a busy machine; what nobody stops moves forever."""
HARMLESS = encode_command(Command(6))
MOVING = encode_command(Command(7, move_ra=True, move_ra_rate_deg_s=1.0))
EDGE = Path(__file__).parents[3] / "examples" / "profiles" / "edge.toml"


@pytest.fixture(autouse=True)
def state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Have guardians write what they did into a folder of the test's own."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    return tmp_path


def assert_stopped(outcomes: list, count: int, within_s: float) -> None:
    assert len(outcomes) == count
    for outcome in outcomes:
        assert outcome.speed_deg_s > 0.3
        assert outcome.moved_on_s < within_s
        assert outcome.stays
        assert outcome.clean


def test_a_feeder_killed_at_a_random_instant_of_a_pass_leaves_the_mount_stopped() -> None:
    assert_stopped(many(1, signal.SIGKILL, seed=1), 1, WITHIN_S)


@pytest.mark.parametrize("profile", [(), ("--profile", str(EDGE))], ids=["held", "edge"])
def test_a_killed_verb_leaves_the_mount_stopped(profile: tuple[str, ...]) -> None:
    assert_stopped(some_moves(2, signal.SIGKILL, 1, *profile), 2, WITHIN_S)


@pytest.mark.soak
@pytest.mark.parametrize("profile", [(), ("--profile", str(EDGE))], ids=["held", "edge"])
def test_feeders_killed_a_hundred_times(profile: tuple[str, ...]) -> None:
    assert_stopped(many(50, signal.SIGKILL, 7, *profile), 50, WITHIN_S)
    assert_stopped(some_moves(50, signal.SIGKILL, 7, *profile), 50, WITHIN_S)


def test_a_feeder_that_stands_still_loses_the_mount_and_knows_it_when_it_wakes() -> None:
    with simulated_mount() as simulated:
        feeder = move(simulated.url)
        try:
            simulated.wait_until_faster(FAST_DEG_S)
            guardian = feeder.guardian()
            halted_utc_s = time.time()
            feeder.process.send_signal(signal.SIGSTOP)
            simulated.wait_until(halted_utc_s + HANG_AFTER_S)
            simulated.wait_until_moving(False)
            moved_on_s = simulated.moved_on_s(halted_utc_s)
            assert moved_on_s < HANG_AFTER_S + WITHIN_S
            # A place that repeats may be that of a hung encoder: of a mount taken over, rest is seen later.
            simulated.wait_until(time.time() + HANGS_S + 1.0)
            feeder.process.send_signal(signal.SIGCONT)
            assert feeder.process.wait(PATIENCE_S) == 1
            assert gone(guardian)
            simulated.wait_until(time.time() + 0.5)
            assert simulated.moved_on_s(halted_utc_s) == moved_on_s
        finally:
            said = feeder.end()
    assert "stood still, so its guardian took the mount from it" in said
    assert "was stopped and seen at rest" in said


@pytest.mark.usefixtures("hang_ups")
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGHUP, signal.SIGINT])
def test_what_ends_a_whole_process_group_does_not_end_its_guardian(
    number: signal.Signals, state: Path
) -> None:
    with simulated_mount() as simulated:
        feeder = move(simulated.url)
        try:
            simulated.wait_until_faster(FAST_DEG_S)
            guardian = feeder.guardian()
            assert os.getsid(guardian) == guardian
            struck_utc_s = time.time()
            os.killpg(feeder.process.pid, number)
            simulated.wait_until_moving(False)
            assert simulated.moved_on_s(struck_utc_s) < WITHIN_S
            feeder.process.wait(PATIENCE_S)
            assert gone(guardian)
        finally:
            said = feeder.end()
    killed = "ended without a word; its guardian stopped the mount"
    assert (killed if number == signal.SIGKILL else "interrupted") in said
    log = state / "sattrack" / "guardian.log"
    assert log.exists() is (number == signal.SIGKILL)
    assert number != signal.SIGKILL or killed in log.read_text()


def move(url: str) -> Feeder:
    return Feeder(
        *("mount", "move", "--ra-rate", "-1", "--dec-rate", "0.2", "--seconds", "20"),
        *("--mount", url, *SITE),
    )


def address_of(bound: socket.socket) -> Address:
    return Address("127.0.0.1", bound.getsockname()[1], 0)


def test_a_normal_end_leaves_no_guardian_and_sends_nothing(mount_socket: socket.socket) -> None:
    with owned(address_of(mount_socket), MountProfile()) as (_, guard):
        assert is_guardian(guard.pid)
        assert guard.beat(MOVING)
        guard.release(True)
    assert not is_guardian(guard.pid)
    mount_socket.setblocking(False)
    with pytest.raises(BlockingIOError):
        mount_socket.recv(200)


def test_a_mount_that_is_not_known_at_rest_is_stopped_on_until_somebody_gives_up(
    mount_socket: socket.socket,
) -> None:
    address = address_of(mount_socket)
    with owned(address, MountProfile()) as (_, guard):
        assert guard.beat(MOVING)
        guard.release(False)
        pid = guard.pid
    assert is_guardian(pid)
    arrivals = []
    for _ in range(3):
        commands = decode_command(mount_socket.recv(200))
        assert commands.abort
        assert True not in (commands.move_ra, commands.slew, commands.park)
        arrivals.append(commands.counter)
    assert arrivals == [8, 9, 10]
    owner = owner_of(address.name)
    assert owner is not None
    with pytest.raises(Taken, match=f"not known at rest: .*its guardian, process {pid}, still sends"):
        claim(address)
    given_up = ask_give_up(owner)
    assert given_up is not None
    assert given_up.heard == "the mount has not been heard since"
    assert gone(pid)
    assert ask_give_up(owner) is None


@pytest.mark.parametrize("simulated", [True, False])
def test_a_dead_port_on_this_machine_may_be_a_tunnel_unless_the_mount_is_simulated(
    mount_socket: socket.socket, simulated: bool
) -> None:
    address = address_of(mount_socket)
    with owned(address, MountProfile(), name="sim" if simulated else None) as (_, guard):
        assert guard.beat(MOVING)
        guard.release(False)
        pid = guard.pid
    mount_socket.recv(200)
    mount_socket.close()
    if simulated:
        assert gone(pid)
        return
    assert not gone(pid, 2.5 * GONE_AFTER_S)
    owner = owner_of(address.name)
    assert owner is not None
    assert ask_give_up(owner) is not None
    assert gone(pid)


def test_what_is_no_status_does_not_hurry_a_guardian_that_waits(mount_socket: socket.socket) -> None:
    address = address_of(mount_socket)
    with owned(address, MountProfile()) as (link, guard):
        guard.beat(MOVING)
        port = link.listen_port
        guard.release(False)
        pid = guard.pid
    try:
        mount_socket.recv(200)
        mount_socket.settimeout(0.05)
        sent = heard = 0
        ends_s = time.monotonic() + 3.0
        while time.monotonic() < ends_s:
            mount_socket.sendto(b"XERXES00" + bytes(8), ("127.0.0.1", port))
            sent += 1
            with contextlib.suppress(TimeoutError):
                heard += len(mount_socket.recv(200)) > 0
        assert sent > 20
        assert heard < sent / 3
    finally:
        owner = owner_of(address.name)
        assert owner is not None
        ask_give_up(owner)
        assert gone(pid)


HANGING = """
import signal, sys
from sattrack.mount.model import MountProfile
from sattrack.runtime.connection import owned
from sattrack.mount.xerxes.client import Address
with owned(Address("127.0.0.1", int(sys.argv[1]), 0), MountProfile(), speed=10.0) as (_, guard):
    guard.beat(bytes.fromhex(sys.argv[2]))
    print(guard.pid, flush=True)
    signal.pause()
"""


def test_giving_up_ends_a_feeder_that_hangs_as_well(mount_socket: socket.socket) -> None:
    address = address_of(mount_socket)
    command = [sys.executable, "-c", HANGING, str(address.port), MOVING.hex()]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as feeder:
        assert feeder.stdout is not None
        pid = int(feeder.stdout.readline())
        goes_on = None
        while goes_on is None:
            mount_socket.recv(200)
            owner = owner_of(address.name)
            assert owner is not None
            goes_on = owner.goes_on
        assert ask_give_up(owner) is not None
        try:
            assert feeder.wait(PATIENCE_S) == -signal.SIGKILL
        finally:
            feeder.kill()
        assert gone(pid)


def test_a_feeder_that_never_asked_for_motion_leaves_nothing_to_stop(mount_socket: socket.socket) -> None:
    with owned(address_of(mount_socket), MountProfile()) as (_, guard):
        assert guard.beat(HARMLESS)
    assert not is_guardian(guard.pid)
    mount_socket.setblocking(False)
    with pytest.raises(BlockingIOError):
        mount_socket.recv(200)


def test_the_guardian_goes_on_from_the_same_port_with_the_next_number_and_one_flag(
    mount_socket: socket.socket,
) -> None:
    with owned(address_of(mount_socket), MountProfile()) as (link, guard):
        port = link.listen_port
        assert guard.beat(encode_command(Command(4711, move_ra=True, move_ra_rate_deg_s=1.0)))
        link.close()
        # The end of the channel without a release is what a killed feeder leaves.
        guard._life.close()
        data, sender = mount_socket.recvfrom(200)
        command = decode_command(data)
        os.kill(guard.pid, signal.SIGKILL)
    assert sender == ("127.0.0.1", port)
    assert command.counter == 4712
    assert command.abort
    others = (command.move_ra, command.move_dec, command.slew, command.park, command.pulse_guide)
    assert not any(others)


def beats(guard: Guarded, pid: int) -> None:
    """Let the loop turn until it has seen that a guardian is gone."""
    os.kill(pid, signal.SIGKILL)
    os.waitid(os.P_PID, pid, os.WEXITED | os.WNOWAIT)
    for _ in range(LOOK_EVERY_BEATS):
        assert guard.beat(MOVING)


def test_a_guardian_that_dies_is_replaced_once_and_then_the_run_is_to_end(
    mount_socket: socket.socket,
) -> None:
    with owned(address_of(mount_socket), MountProfile()) as (_, guard):
        first = guard.pid
        beats(guard, first)
        assert guard.trouble is None
        second = guard.pid
        assert second != first
        beats(guard, second)
        assert guard.trouble == "the guardian died twice: the mount is not moved without one"
        assert guard.beat(MOVING)
        guard.release(True)
    assert not is_guardian(second)


def test_a_guardian_that_cannot_be_replaced_ends_the_run_and_the_loop_goes_on(
    mount_socket: socket.socket, monkeypatch: pytest.MonkeyPatch
) -> None:
    with owned(address_of(mount_socket), MountProfile()) as (_, guard):
        monkeypatch.setattr(connection, "self_command", lambda _: ["/nonexistent"])
        beats(guard, guard.pid)
        trouble = "the guardian died and cannot be started again (No such file or directory)"
        assert guard.trouble == trouble
        assert guard.beat(MOVING)
        guard.release(True)


def test_a_guardian_that_ends_before_it_reads_its_task_is_named(
    mount_socket: socket.socket, monkeypatch: pytest.MonkeyPatch
) -> None:
    # It waits for the task to be there, and leaves it unread.
    waits = "import select, sys; select.select([int(sys.argv[1])], [], [])"
    monkeypatch.setattr(connection, "self_command", lambda _: [sys.executable, "-S", "-c", waits])
    with (
        pytest.raises(SattrackError, match="the guardian did not start: nothing is moved without"),
        owned(address_of(mount_socket), MountProfile()),
    ):
        pass


def test_the_page_tells_with_which_beat_the_flag_of_an_abort_fell(mount_socket: socket.socket) -> None:
    abort = encode_command(Command(8, abort=True))
    with owned(address_of(mount_socket), MountProfile()) as (_, guard):
        fell = []
        for datagram in (
            HARMLESS,
            MOVING,
            abort,
            abort,
            HARMLESS,
            HARMLESS,
            abort,
            HARMLESS,
            MOVING,
            HARMLESS,
        ):
            assert guard.beat(datagram)
            fell.append(guard._words[Word.ABORT_FELL])
        guard.release(True)
    assert fell == [0, 0, 0, 0, 5, 5, 0, 8, 0, 0]


def watched() -> tuple[FeederWatch, memoryview]:
    words = memoryview(bytearray(8 * len(Word))).cast("Q")
    return FeederWatch(words, hang_after_s=1.0), words


def looks(watch: FeederWatch, count: int, elapsed_s: float = POLL_S) -> list[str]:
    return [why for _ in range(count) if (why := watch.look(elapsed_s)) is not None]


class TestWatch:
    def test_a_loop_that_turns_is_left_alone(self) -> None:
        watch, words = watched()
        words[Word.ARMED] = 1
        for beat in range(100):
            words[Word.BEATS] = beat
            assert watch.look(POLL_S) is None

    def test_silence_counts_from_the_last_beat(self) -> None:
        watch, words = watched()
        words[Word.ARMED], words[Word.BEATS] = 1, 5
        assert looks(watch, 11) == []
        assert looks(watch, 1) == ["stood still for 1.1 s"]

    def test_before_the_first_motion_and_after_the_release_silence_means_nothing(self) -> None:
        watch, words = watched()
        words[Word.BEATS] = 5
        assert looks(watch, 100) == []
        words[Word.ARMED], words[Word.RELEASED] = 1, Release.AT_REST
        assert looks(watch, 100) == []

    def test_a_machine_that_stood_still_as_a_whole_is_nobodys_fault(self) -> None:
        watch, words = watched()
        words[Word.ARMED], words[Word.BEATS] = 1, 5
        assert looks(watch, 3, elapsed_s=30.0) == []

    def test_a_loop_that_turns_but_ignores_a_stop_loses_the_mount(self) -> None:
        watch, words = watched()
        words[Word.ARMED] = words[Word.STOP_ASKED] = 1
        whys = []
        for beat in range(30):
            words[Word.BEATS] = beat
            whys.append(watch.look(POLL_S))
        late = round(OBEY_WITHIN_S / POLL_S)
        assert whys[: late - 1] == [None] * (late - 1)
        assert whys[-1] == "did not obey a stop"
        words[Word.OBEYING] = 1
        words[Word.BEATS] = 100
        assert watch.look(POLL_S) is None
