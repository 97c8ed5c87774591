"""The loop that feeds a console's datagrams to a socket: what breaks in it still stops the mount."""

from __future__ import annotations

import math
import os
import socket
from dataclasses import dataclass, field

import pytest

from sattrack.control.console import Console
from sattrack.core.clock import SystemClock
from sattrack.core.errors import SattrackError
from sattrack.mount.model import MountProfile
from sattrack.mount.requests import Abort
from sattrack.mount.xerxes.client import Address, UdpLink
from sattrack.mount.xerxes.datagrams import Command, decode_command, encode_command
from sattrack.runtime import loop
from sattrack.runtime.connection import Connection
from sattrack.runtime.console import ConsoleLoop, OrderInbox
from sattrack.runtime.system import StopRequest
from sattrack.safety import SafetyLimits
from sattrack.views.messages import Leave

QUICK = MountProfile(period_s=0.002)


@dataclass
class BrokenPart:
    """Says nothing of use: its `tick` fails so many times from the third on, then ends."""

    fails: int
    console: Console = field(default_factory=lambda: Console(QUICK, SafetyLimits(), None, "m"))
    ticks: int = 0
    failed: list[str] = field(default_factory=list)
    interrupted: int = 0
    mount_stopped: bool | None = None
    turns_known_s: float = math.inf
    safety: None = None

    @property
    def profile(self) -> MountProfile:
        return QUICK

    @property
    def finished(self) -> bool:
        return self.ticks > 6

    def receive(self, data: bytes, arrival_utc_s: float) -> None:
        raise AssertionError("nobody sends")

    def tick(self, now_utc_s: float) -> bytes | None:
        self.ticks += 1
        if 3 <= self.ticks < 3 + self.fails:
            raise RuntimeError("broken")
        return encode_command(Command(self.ticks))

    def interrupt(self, now_utc_s: float) -> None:
        self.interrupted += 1

    def fail(self, words: str, now_utc_s: float) -> None:
        self.failed.append(words)


@pytest.fixture
def mount_socket():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listener:
        listener.bind(("127.0.0.1", 0))
        listener.setblocking(False)
        yield listener


@pytest.fixture
def connection(mount_socket: socket.socket):
    link = UdpLink(Address("127.0.0.1", mount_socket.getsockname()[1], 0))
    yield Connection(link, SystemClock())
    link.close()


def heard(mount_socket: socket.socket) -> list[Command]:
    commands = []
    while True:
        try:
            commands.append(decode_command(mount_socket.recv(200)))
        except BlockingIOError:
            return commands


def test_one_failure_is_told_to_the_part_which_goes_on(
    mount_socket: socket.socket, connection: Connection
) -> None:
    part = BrokenPart(fails=1)
    with pytest.raises(RuntimeError, match="broken"):
        ConsoleLoop(connection, StopRequest(), part, lambda _: None).run()
    assert part.failed == ["broken"]
    assert [command.counter for command in heard(mount_socket)] == [1, 2, 4, 5, 6, 7]


def test_what_goes_on_failing_ends_with_stops_said_without_it(
    mount_socket: socket.socket, connection: Connection, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(loop, "LAST_STOPS", 5)
    with pytest.raises(RuntimeError, match="broken"):
        ConsoleLoop(connection, StopRequest(), BrokenPart(fails=9), lambda _: None).run()
    assert [command.abort for command in heard(mount_socket)[2:]] == [False, True, True, True, True]


def test_what_shows_may_fail_for_good_and_the_mount_is_fed_to_the_end(
    mount_socket: socket.socket, connection: Connection
) -> None:
    def show(_: float) -> None:
        raise BrokenPipeError("nobody reads")

    part = BrokenPart(fails=0)
    with pytest.raises(BrokenPipeError):
        ConsoleLoop(connection, StopRequest(), part, show).run()
    assert len(heard(mount_socket)) == 7
    assert len(part.failed) == 1


class TakenAway:
    """A guard of a loop that has stood still: the mount is taken away just before the third datagram."""

    stop_asked = False

    def __init__(self) -> None:
        self.beats = 0
        self.released = False

    @property
    def deposed(self) -> bool:
        return self.beats >= 3

    @property
    def trouble(self) -> str | None:
        return "taken away" if self.deposed else None

    first_axis_deg: float | None = None
    followed_deg: float | None = None

    def beat(self, *_: object) -> bool:
        self.beats += 1
        return not self.deposed

    def release(self, at_rest: bool | None) -> None:
        del at_rest
        self.released = True


def test_a_loop_whose_mount_was_taken_away_sends_nothing_more_and_says_so(
    mount_socket: socket.socket, connection: Connection
) -> None:
    guard = TakenAway()
    connection.guard = guard
    with pytest.raises(SattrackError, match="taken away"):
        ConsoleLoop(connection, StopRequest(), BrokenPart(fails=0), lambda _: None).run()
    assert [command.counter for command in heard(mount_socket)] == [1, 2]
    assert not guard.released


def test_a_stop_that_is_asked_for_again_and_again_interrupts_once(connection: Connection) -> None:
    part, stop = BrokenPart(fails=0), StopRequest()
    stop.ask()
    ConsoleLoop(connection, stop, part, lambda _: stop.ask()).run()
    assert part.interrupted == 1


def test_the_end_of_the_channel_is_a_leave_and_rubbish_does_nothing() -> None:
    reading, writing = os.pipe()
    inbox = OrderInbox(reading)
    os.write(writing, b'{"type":"abort"}\nrubbish\n{"type":"jog","ra_rate_deg_s":"fast"}\n{"ty')
    assert inbox.orders() == [Abort()]
    assert inbox.ignored == 2
    os.write(writing, b'pe":"abort"}\n')
    assert inbox.orders() == [Abort()]
    assert inbox.orders() == []
    os.close(writing)
    assert inbox.orders() == [Leave()]
    assert inbox.orders() == ()
    os.close(reading)
