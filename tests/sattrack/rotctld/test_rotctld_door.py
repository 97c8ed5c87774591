"""The door by itself: callers that come and go, ask too much, do not read, or are not wanted."""

from __future__ import annotations

import contextlib
import ipaddress
import select
from typing import TYPE_CHECKING

import pytest
from door_serving import call
from rotctld_setup import NOON_NS, make_rotator

from sattrack.runtime.antenna_door import listen
from sattrack.runtime.callers import CallerLimits
from sattrack.runtime.rotctld_door import RotctldDoor
from sattrack.runtime.rotctld_serve import client_maker

if TYPE_CHECKING:
    import socket


class Here:
    """A door without a mount behind it, served by hand."""

    def __init__(self, limits: CallerLimits) -> None:
        self.rotator = make_rotator()
        self.door = RotctldDoor(listen("127.0.0.1", 0), limits, client_maker(self.rotator, "here"))
        self.now_ns = NOON_NS

    def serve(self) -> list[int]:
        ready, _, _ = select.select(self.door.readers(), [], [], 0.05)
        return self.door.serve(ready, lambda: self.now_ns)


def test_a_client_with_too_many_requests_waits_and_the_others_do_not() -> None:
    here = Here(CallerLimits(requests_per_s=5.0))
    with call(here.door.port) as greedy, call(here.door.port) as modest:
        while len(here.door.callers) < 2:
            here.serve()
        greedy.sendall(b"p\n" * 3000)
        modest.sendall(b"_\n")
        for _ in range(20):
            here.serve()
        modest.settimeout(0.0)
        assert modest.recv(100) == b"here\n"
        greedy.settimeout(0.0)
        answered = greedy.recv(65536).count(b"\n") // 2
        assert 1 <= answered < 30
        # What it has sent waits where it is, but for one read.
        caller = here.door.callers[1]
        assert len(caller.client._reader._bytes) < 1024
    here.door.close()


def test_a_client_that_does_not_read_is_not_read_from_and_holds_nobody_up() -> None:
    here = Here(CallerLimits(requests_per_s=1e9))
    with call(here.door.port) as deaf, call(here.door.port) as other:
        while len(here.door.callers) < 2:
            here.serve()
        deaf.setblocking(False)
        for _ in range(3000):
            with contextlib.suppress(BlockingIOError):
                deaf.send(b"??" * 500)
            here.serve()
            if 1 not in here.door.callers or here.door.callers[1].waiting:
                break
        else:
            pytest.fail("everything was taken off it")
        other.sendall(b"_\n")
        for _ in range(10):
            here.serve()
        assert other.recv(100) == b"here\n"
    here.door.close()


def test_a_silent_client_is_hung_up_on() -> None:
    here = Here(CallerLimits(idle_s=1e-6))
    with call(here.door.port) as line:
        while not here.door.callers:
            here.serve()
        assert here.door.tend(here.now_ns) == [1]
        assert line.recv(10) == b""
    assert not here.door.callers
    here.door.close()


def test_a_pause_ends_without_another_word() -> None:
    here = Here(CallerLimits())
    with call(here.door.port) as line:
        line.sendall(b"\\pause 1\n_\n")
        for _ in range(5):
            here.serve()
            here.door.tend(here.now_ns)
        here.now_ns += 2 * 10**9
        here.door.tend(here.now_ns)
        here.serve()
        assert line.recv(100) == b"RPRT 0\nhere\n"
    here.door.close()


def test_a_thousand_callers_that_come_and_go_leave_nothing_behind() -> None:
    here = Here(CallerLimits())
    for _ in range(1000):
        with call(here.door.port) as line:
            line.sendall(b"p\nP 10 20\nq\n")
            while not here.serve():
                pass
    assert not here.door.callers
    assert len(here.door.words) <= 20
    here.door.close()


def test_callers_beyond_what_is_allowed_are_hung_up_on() -> None:
    here = Here(CallerLimits(callers=2))
    lines = [call(here.door.port) for _ in range(3)]
    while here.door.refused < 1:
        here.serve()
    assert lines[2].recv(10) == b""
    assert (
        "127.0.0.1 was hung up on: there are 2 clients already, as many as --clients allows"
        in here.door.words
    )
    for line in lines:
        line.close()
    while here.door.callers:
        here.serve()
    here.door.close()


@pytest.mark.parametrize(("network", "wanted"), [("192.0.2.0/24", False), ("127.0.0.1/32", True)])
def test_addresses_that_are_not_named_are_hung_up_on(network: str, wanted: bool) -> None:
    here = Here(CallerLimits(allowed=(ipaddress.ip_network(network),)))
    with call(here.door.port) as line:
        while not (here.door.refused or here.door.callers):
            here.serve()
        assert bool(here.door.callers) is wanted
        assert wanted or hung_up_on(line)
    here.door.close()


def hung_up_on(line: socket.socket) -> bool:
    with contextlib.suppress(ConnectionResetError):
        return line.recv(10) == b""
    return True
