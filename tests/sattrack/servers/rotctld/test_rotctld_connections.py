"""The server by itself: callers that come and go, ask too much, do not read, or are not wanted."""

from __future__ import annotations

import contextlib
import ipaddress
import math
import select
from typing import TYPE_CHECKING

import pytest
from hamlib_exchanges import EXCHANGES
from rotctld_setup import NOON_NS, make_rotator
from serving import call

from sattrack.runtime.callers import CallerLimits, Opening, Seat, listen
from sattrack.servers.rotctld.serve import RotctldServer

if TYPE_CHECKING:
    import socket


class Here:
    """A server without a mount behind it, served by hand."""

    def __init__(self, limits: CallerLimits) -> None:
        self.rotator = make_rotator()
        self.server = RotctldServer(listen("127.0.0.1", 0), limits, self.rotator, "here")
        self.now_ns = NOON_NS

    def serve(self) -> list[int]:
        ready, _, _ = select.select(self.server.readers(), [], [], 0.05)
        return self.server.serve(ready, lambda: self.now_ns)


def test_a_client_with_too_many_requests_waits_and_the_others_do_not() -> None:
    here = Here(CallerLimits(requests_per_s=5.0))
    with call(here.server.port) as greedy, call(here.server.port) as modest:
        while len(here.server.callers) < 2:
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
        caller = here.server.callers[1]
        assert len(caller.client._reader._bytes) < 1024
    here.server.close()


def test_a_client_that_does_not_read_is_not_read_from_and_holds_nobody_up() -> None:
    here = Here(CallerLimits(requests_per_s=1e9))
    with call(here.server.port) as deaf, call(here.server.port) as other:
        while len(here.server.callers) < 2:
            here.serve()
        deaf.setblocking(False)
        for _ in range(3000):
            with contextlib.suppress(BlockingIOError):
                deaf.send(b"??" * 500)
            here.serve()
            if 1 not in here.server.callers or here.server.callers[1].waiting:
                break
        else:
            pytest.fail("everything was taken off it")
        other.sendall(b"_\n")
        for _ in range(10):
            here.serve()
        assert other.recv(100) == b"here\n"
    here.server.close()


def test_a_silent_client_is_hung_up_on() -> None:
    here = Here(CallerLimits(idle_s=1e-6))
    with call(here.server.port) as line:
        while not here.server.callers:
            here.serve()
        assert here.server.tend(here.now_ns) == [1]
        assert line.recv(10) == b""
    assert not here.server.callers
    here.server.close()


def test_a_pause_ends_without_another_word() -> None:
    here = Here(CallerLimits())
    with call(here.server.port) as line:
        line.sendall(b"\\pause 1\n_\n")
        for _ in range(5):
            here.serve()
            here.server.tend(here.now_ns)
        here.now_ns += 2 * 10**9
        here.server.tend(here.now_ns)
        here.serve()
        assert line.recv(100) == b"RPRT 0\nhere\n"
    here.server.close()


def asked(here: Here) -> list[int]:
    """Return the numbers of those that have asked for something."""
    return [number for number, caller in here.server.callers.items() if caller.seat.asked_s > 0.0]


def test_hundreds_of_half_lines_keep_nobody_out() -> None:
    here = Here(CallerLimits())
    with contextlib.ExitStack() as lines:
        busy = lines.enter_context(call(here.server.port))
        busy.sendall(b"_\n")
        while not asked(here):
            here.serve()
        assert busy.recv(100) == b"here\n"
        for _ in range(400):
            lines.enter_context(call(here.server.port)).sendall(b"P 1")
            here.serve()
        late = lines.enter_context(call(here.server.port))
        late.sendall(b"S\n")
        while asked(here) != [1, 402]:
            here.serve()
        assert late.recv(100) == b"RPRT 0\n"
        busy.sendall(b"_\n")
        while not select.select([busy], [], [], 0.0)[0]:
            here.serve()
        assert busy.recv(100) == b"here\n"
    here.server.close()


def seats(*whose: tuple[str, float]) -> dict[int, Seat]:
    return {number: Seat(address, asked_s, 0.0) for number, (address, asked_s) in enumerate(whose)}


@pytest.mark.parametrize(
    ("address", "there", "makes_room"),
    [
        ("192.0.2.1", [("192.0.2.1", 10.0)] * 6, []),
        ("192.0.2.1", [("192.0.2.1", 10.0), ("192.0.2.1", 5.0)] + [("192.0.2.1", 10.0)] * 5, [1]),
        ("192.0.2.1", [("192.0.2.1", -math.inf), ("192.0.2.1", 5.0)] + [("192.0.2.1", 10.0)] * 5, [0]),
        ("192.0.2.2", [("192.0.2.3", 0.0)] + [("192.0.2.1", 99.0)] * 7, [1]),
    ],
)
def test_the_idlest_of_the_largest_crowd_makes_room(
    address: str, there: list[tuple[str, float]], makes_room: list[int]
) -> None:
    assert CallerLimits(callers=8).admit(address, seats(*there), 100.0) == (None, makes_room)


FOREIGN = [
    b"POST / HTTP/1.1\r\nHost: localhost:4533\r\nContent-Type: text/plain\r\n\r\nP 90 45\n",
    b"GET /chat HTTP/1.1\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n\r\n",
    b"OPTIONS * HTTP/1.0\n\n",
    b"\r\nPOST http://[::1]:4533/ HTTP/1.1\r\n\r\nK\n",
    b"K / HTTP/1.1\r\nHost: evil.example\r\n\r\nK\n",
    b"P /?a HTTP/2\r\nP 90 45\n",
    b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n",
    b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03P 90 45\nK\n",
    b"GET /" + b"x" * 20000,
    b"K /" + b"x" * 20000,
]


@pytest.mark.parametrize("foreign", FOREIGN, ids=lambda data: str(data[:24]))
@pytest.mark.parametrize("size", [1, 7, 100_000])
@pytest.mark.parametrize("by_lines", [False, True])
def test_nothing_is_obeyed_of_what_speaks_http_or_tls(foreign: bytes, size: int, by_lines: bool) -> None:
    opening = Opening(by_lines)
    for at in range(0, len(foreign), size):
        told = opening.take(foreign[at : at + size])
        if told is None:
            return
        assert b"\n" not in told.lstrip(b"\r\n") if by_lines else told == b""
    pytest.fail("it was let in")


@pytest.mark.parametrize(("sent", "_answer"), EXCHANGES)
def test_what_rotctlds_clients_send_comes_through_as_it_is(sent: bytes, _answer: bytes) -> None:
    opening = Opening()
    came = b"".join(opening.take(bytes([byte])) or b"" for byte in sent)
    assert came + opening.rest() == sent
    lines = Opening(by_lines=True)
    assert b"".join(lines.take(bytes([byte])) or b"" for byte in sent) == sent


def test_a_web_page_moves_nothing() -> None:
    here = Here(CallerLimits())
    with call(here.server.port) as line:
        for piece in (b"PO", b"ST / HT", b"TP/1.1\r\n\r\n", b"P 90 45\n"):
            with contextlib.suppress(ConnectionError):
                line.sendall(piece)
            here.serve()
        while here.server.callers:
            here.serve()
        assert hung_up_on(line)
    assert here.rotator.path is None
    assert any("speaks HTTP or TLS" in words for words in here.rotator.log_lines)
    here.server.close()


def test_a_thousand_callers_that_come_and_go_leave_nothing_behind() -> None:
    here = Here(CallerLimits())
    for _ in range(1000):
        with call(here.server.port) as line:
            line.sendall(b"p\nP 10 20\nq\n")
            while not here.serve():
                pass
    assert not here.server.callers
    assert len(here.rotator.log_lines) <= 20
    here.server.close()


def test_callers_beyond_what_is_allowed_are_hung_up_on_while_the_others_are_busy() -> None:
    here = Here(CallerLimits(callers=2))
    with contextlib.ExitStack() as lines:
        for _ in range(2):
            lines.enter_context(call(here.server.port)).sendall(b"_\n")
        while len(asked(here)) < 2:
            here.serve()
        third = lines.enter_context(call(here.server.port))
        while here.server.refused < 1:
            here.serve()
        assert hung_up_on(third)
    words = "127.0.0.1 was disconnected: there are 2 busy clients already, as many as --clients allows"
    assert words in here.rotator.log_lines
    while here.server.callers:
        here.serve()
    here.server.close()


@pytest.mark.parametrize(("network", "wanted"), [("192.0.2.0/24", False), ("127.0.0.1/32", True)])
def test_addresses_that_are_not_named_are_hung_up_on(network: str, wanted: bool) -> None:
    here = Here(CallerLimits(allowed=(ipaddress.ip_network(network),)))
    with call(here.server.port) as line:
        while not (here.server.refused or here.server.callers):
            here.serve()
        assert bool(here.server.callers) is wanted
        assert wanted or hung_up_on(line)
    here.server.close()


def hung_up_on(line: socket.socket) -> bool:
    with contextlib.suppress(ConnectionResetError):
        return line.recv(10) == b""
    return True
