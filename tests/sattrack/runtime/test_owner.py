"""One owner of a mount at a time: the name, who has it, and what becomes of it when its holder dies."""

from __future__ import annotations

import contextlib
import os
import re
import select
import signal
import socket
import subprocess
import sys
import threading
from typing import TYPE_CHECKING

import msgspec
import pytest

from sattrack.mount.model import MountProfile
from sattrack.mount.xerxes.client import Address, Arrival
from sattrack.mount.xerxes.datagrams import Command, encode_command
from sattrack.runtime import mounts as mounts_module
from sattrack.runtime.connection import owned
from sattrack.runtime.guardian import MOST_CLIENTS, SIZE, note_status, statuses_since
from sattrack.runtime.mounts import (
    Owner,
    Taken,
    ask_stop,
    claim,
    listen,
    look_on,
    mount_address,
    owner_of,
    owners,
)

if TYPE_CHECKING:
    from collections.abc import Iterator

pytestmark = pytest.mark.usefixtures("own_state")
MOVING = encode_command(Command(7, move_ra=True, move_ra_rate_deg_s=1.0))
HOLDER = """
import sys, time
from sattrack.runtime.mounts import claim
from sattrack.mount.xerxes.client import Address
held = claim(Address("127.0.0.1", int(sys.argv[1]), 0))
print("held", flush=True)
time.sleep(60)
"""


LONG = "indi://192.168.100.100:7624/" + "A%20long%20name%20" * 6


@pytest.fixture
def address() -> Iterator[Address]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as mount:
        mount.bind(("127.0.0.1", 0))
        yield Address("127.0.0.1", mount.getsockname()[1], 0)


def test_who_comes_second_is_told_who_was_first_and_what_to_do(address: Address) -> None:
    with owned(address, MountProfile()) as (link, guard):
        with pytest.raises(Taken) as refused, owned(address, MountProfile()):
            pass
        first = owner_of(address.name)
        assert first is not None
        assert first in owners()
        guard.release(None)
    words = str(refused.value)
    assert refused.value.exit_code == 1
    assert "\n" not in words
    assert words.startswith(f"{address} has an owner: `sattrack")
    assert re.search(rf"process {os.getpid()}, since \w+ \d+ \w+ 20\d\d \d\d:\d\d", words)
    assert words.endswith("`sattrack stop` ends it")
    assert first.user == os.getuid()
    assert first.mount == f"127.0.0.1:{address.port}"
    assert link.fileno() == -1


def test_a_mount_with_a_long_address_is_owned_and_found_like_any_other() -> None:
    one, other = (mount_address(LONG + end) for end in ("x", "y"))
    assert one is not None
    assert other is not None
    held = claim(one)
    try:
        with pytest.raises(Taken):
            claim(one)
        claim(other).close()
    finally:
        held.close()


def test_the_owner_of_a_mount_with_a_long_address_tells_it_whole() -> None:
    ours, theirs = socket.socketpair()
    with ours, theirs:
        for said, whole in ((f"{LONG}x", f"{LONG}x"), (f"{LONG}y", None)):
            asked = mounts_module._name(f"{LONG}x").removeprefix(f"\0{mounts_module.PREFIX}")
            owner = Owner(os.getpid(), os.getuid(), "sattrack track", "", said, 0)
            question = mounts_module._Question(asked, ours.dup(), msgspec.json.encode(owner))
            assert question.owner().mount == (whole or asked)


def test_another_mount_has_another_owner(address: Address) -> None:
    held = claim(address)
    try:
        claim(Address("127.0.0.2", address.port, 0)).close()
        claim(Address(address.host, address.port % 65535 + 1, 0)).close()
    finally:
        held.close()


def test_a_name_is_free_again_however_its_holder_ended(
    address: Address, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mounts_module, "ANSWER_WITHIN_S", 0.2)
    claim(address).close()
    with subprocess.Popen(
        [sys.executable, "-c", HOLDER, str(address.port)], stdout=subprocess.PIPE, text=True
    ) as holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == "held\n"
        with pytest.raises(Taken):
            claim(address)
        holder.kill()
    assert owner_of(address.name) is None
    claim(address).close()


def test_an_owner_that_does_not_answer_is_named_by_its_process(
    address: Address, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mounts_module, "ANSWER_WITHIN_S", 0.3)
    held = claim(address)
    try:
        own = os.getpid()
        with pytest.raises(Taken, match=rf"process {own}, since .*; it does not answer; .*kill {own}"):
            claim(address)
        silent = owner_of(address.name)
        assert silent is not None
        with pytest.raises(Exception, match=f"end it with `kill {os.getpid()}`"):
            ask_stop(silent, lambda: None, within_s=0.3)
    finally:
        held.close()


def test_a_stop_reaches_the_loop_and_its_end_reaches_whoever_asked(address: Address) -> None:
    with owned(address, MountProfile()) as (_, guard):
        assert guard.beat(MOVING)
        assert not guard.stop_asked
        heard: list[str] = []

        def waiting() -> None:
            # What the loop does, in between.
            guard.beat(MOVING)
            if guard.stop_asked and not heard:
                first = owner_of(address.name)
                assert first is not None
                heard.append(first.state)
                guard.release(True)

        first = owner_of(address.name)
        assert first is not None
        stopped = ask_stop(first, waiting)
    assert heard == ["stopping"]
    assert stopped is not None
    assert (stopped.by, stopped.at_rest) == ("session", True)
    assert ask_stop(first, lambda: None) is None


def test_who_looks_on_is_told_what_the_owner_hears_as_it_arrived(address: Address) -> None:
    with owned(address, MountProfile()) as (link, guard):
        onlooker = look_on(address)
        assert onlooker is not None
        heard: list[Arrival] = []
        sent: list[Arrival] = []
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as mount:
            while not heard:
                # Until the guardian has heard that somebody looks on.
                mount.sendto(b"x" * 160, ("127.0.0.1", link.listen_port))
                assert select.select([link], [], [], 60.0)[0]
                sent += link.receive()
                select.select([onlooker], [], [], 0.1)
                heard += onlooker.receive()
            while sent[0] != heard[0]:
                sent.pop(0)
            for number in range(40):
                mount.sendto(bytes([number]) * 160, ("127.0.0.1", link.listen_port))
                assert select.select([link], [], [], 60.0)[0]
                sent += link.receive()
                while number % 4 == 3 and len(heard) < len(sent):
                    assert select.select([onlooker], [], [], 60.0)[0]
                    heard += onlooker.receive()
        assert heard == sent
        onlooker.send(b"stop")
        assert onlooker.unsent == 1
        guard.release(None)
    assert select.select([onlooker], [], [], 60.0)[0]
    assert onlooker.receive() == []
    assert onlooker.ended
    # A door that is closed must not keep whoever looks on busy.
    assert not select.select([onlooker], [], [], 0.0)[0]
    onlooker.close()
    assert look_on(address) is None


def test_whoever_listens_hears_an_owned_mount_too(address: Address) -> None:
    with owned(address, MountProfile()) as (link, guard):
        done = threading.Event()

        def talk() -> None:
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as mount:
                while not done.wait(0.02):
                    mount.sendto(b"no status", ("127.0.0.1", link.listen_port))
                    link.receive()

        talker = threading.Thread(target=talk)
        talker.start()
        try:
            # The same port, which only one process can have.
            health = listen(Address(address.host, address.port, link.listen_port), MountProfile(), 1.0)
        finally:
            done.set()
            talker.join()
            guard.release(None)
    assert health.rejected > 3
    assert health.received == 0


def test_who_cannot_keep_up_sees_the_newest() -> None:
    page = memoryview(bytearray(SIZE)).cast("Q")
    for number in range(100):
        note_status(page, float(number), bytes([number]) * 160)
    count, statuses = statuses_since(page, 50)
    assert count == 100
    assert [status.monotonic_s for status in statuses] == [93.0, 94.0, 95.0, 96.0, 97.0, 98.0, 99.0]
    assert statuses[-1].data == bytes([99]) * 160
    assert statuses_since(page, 100) == (100, [])


def test_nonsense_at_the_door_changes_nothing(address: Address) -> None:
    name = f"\0sattrack-mount/127.0.0.1:{address.port}"
    with owned(address, MountProfile()) as (_, guard):
        assert guard.beat(MOVING)
        crowd = []
        deep = b'{"ask":"who","x":' + b"[" * 3000 + b"\n"
        nonsense = (
            b"\n",
            b"stop\n",
            b'{"ask":"fly"}\n',
            b'{"ask":"\xff"}\n',
            deep,
            b"x" * 9000,
            b'{"ask":',
            b"",
        )
        for words in nonsense * MOST_CLIENTS:
            door = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
            crowd.append(door)
            door.connect(name)
            with contextlib.suppress(OSError):
                door.sendall(words)
        first = owner_of(address.name)
        assert first is not None
        assert first.state == "running"
        for door in crowd:
            door.close()
        assert not guard.stop_asked
        assert not guard.deposed
        guard.release(None)


def test_the_guardian_keeps_the_name_until_the_mount_is_stopped(address: Address) -> None:
    with owned(address, MountProfile()) as (_, guard):
        assert guard.beat(MOVING)
        pid = guard.pid
        guard._life.close()
        while (first := owner_of(address.name)) is not None and first.state == "running":
            pass
        assert first is not None
        assert first.state == "ended without a word, its guardian stops the mount"
        os.kill(pid, signal.SIGKILL)
