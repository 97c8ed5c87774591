"""Connections that are silent, halting or not allowed, and discovery, without a mount behind them."""

from __future__ import annotations

import asyncio
import contextlib
import ipaddress
import socket
from types import SimpleNamespace
from typing import TYPE_CHECKING, cast
from unittest.mock import Mock

import pytest
from aiohttp import web

from sattrack.core.clock import SystemClock
from sattrack.mount.model import AxisLimits, MountProfile, Slew
from sattrack.runtime.callers import CallerLimits, HostNames
from sattrack.servers.alpaca.connections import FeederLine
from sattrack.servers.alpaca.process import (
    ANSWERS_PER_S,
    ANSWERS_PER_S_EACH,
    REQUEST_WITHIN_S,
    ClientConnection,
    Discovery,
    Front,
    OpenConnections,
)
from sattrack.servers.alpaca.protocol import Fault

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable

    from sattrack.servers.alpaca.telescope import ServedTelescope

PATIENCE_S = 60.0
IDLE_S = 300.0
LIMITS = CallerLimits(idle_s=IDLE_S)
WHOLE = b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n"


class Callers:
    """Those who call at a server, with their lines."""

    def __init__(self, port: int) -> None:
        self._port = port
        self._writers: list[asyncio.StreamWriter] = []

    async def call(self) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
        reader, writer = await asyncio.open_connection("127.0.0.1", self._port)
        self._writers.append(writer)
        return reader, writer

    async def leave(self) -> None:
        for writer in self._writers:
            writer.close()
            with contextlib.suppress(OSError):
                await writer.wait_closed()


def with_door(
    limits: CallerLimits, play: Callable[[Callers, OpenConnections, asyncio.Event], Awaitable[None]]
) -> None:
    """Play a scene before a server; requests are answered when the event is set."""

    async def scene() -> None:
        connections, answers = OpenConnections(limits), asyncio.Event()
        answers.set()

        async def handle(request: web.BaseRequest) -> web.StreamResponse:
            assert request.transport is not None
            connection = connections.by_transport[request.transport]
            connection.begins()
            await answers.wait()
            connection.ends()
            return web.Response(text="here")

        http = web.Server(handle, access_log=None, keepalive_timeout=IDLE_S * 10.0)
        server = await asyncio.get_running_loop().create_server(
            lambda: ClientConnection(connections, http), "127.0.0.1", 0
        )
        callers = Callers(int(server.sockets[0].getsockname()[1]))
        try:
            async with asyncio.timeout(PATIENCE_S):
                await play(callers, connections, answers)
        finally:
            await callers.leave()
            server.close()
            await http.shutdown(1.0)

    asyncio.run(scene())


async def hung_up(reader: asyncio.StreamReader) -> bool:
    """Wait for the end of a connection, whatever comes before it."""
    try:
        while await reader.read(65536):
            pass
    except ConnectionError:
        pass
    return True


async def overdue(connections: OpenConnections, after_s: float) -> None:
    """Wait until a connection would be overdue so long from now, and then make it so."""
    loop = asyncio.get_running_loop()
    while not any(
        connection.overdue(loop.time() + after_s, IDLE_S) for connection in connections.by_transport.values()
    ):
        await asyncio.sleep(0)
    connections.tend(loop.time() + after_s)


def test_who_is_silent_is_hung_up_on() -> None:
    async def play(callers: Callers, connections: OpenConnections, _: asyncio.Event) -> None:
        reader, _writer = await callers.call()
        await overdue(connections, IDLE_S + 1.0)
        assert await hung_up(reader)
        assert connections.cut == 1

    with_door(LIMITS, play)


def test_who_has_been_answered_may_be_silent_for_as_long_as_anybody() -> None:
    async def play(callers: Callers, connections: OpenConnections, _: asyncio.Event) -> None:
        reader, writer = await callers.call()
        writer.write(WHOLE)
        assert (await reader.readline()).startswith(b"HTTP/1.1 200")
        connections.tend(asyncio.get_running_loop().time() + IDLE_S - 1.0)
        assert connections.cut == 0
        await overdue(connections, IDLE_S + 1.0)
        assert await hung_up(reader)

    with_door(LIMITS, play)


@pytest.mark.parametrize("begun", [b"G", b"GET / HT", WHOLE[:-2], b"PUT / HTTP/1.1\r\nContent-Length: 9\r\n"])
def test_who_leaves_a_request_unfinished_is_hung_up_on_much_sooner(begun: bytes) -> None:
    async def play(callers: Callers, connections: OpenConnections, _: asyncio.Event) -> None:
        reader, writer = await callers.call()
        writer.write(begun)
        await overdue(connections, REQUEST_WITHIN_S + 1.0)
        assert await hung_up(reader)
        assert connections.cut == 1

    with_door(LIMITS, play)


def test_a_request_that_dribbles_in_gains_no_time_by_it() -> None:
    async def play(callers: Callers, connections: OpenConnections, _: asyncio.Event) -> None:
        loop = asyncio.get_running_loop()
        _reader, writer = await callers.call()
        writer.write(b"GET / HTTP/1.1\r\nX: ")
        while not any(
            connection.overdue(loop.time() + 11.0, IDLE_S) for connection in connections.by_transport.values()
        ):
            await asyncio.sleep(0)
        (connection,), begun_s = connections.by_transport.values(), loop.time()
        while loop.time() < begun_s + 0.05:
            writer.write(b"a")
            await asyncio.sleep(0)
        assert connection.overdue(begun_s + REQUEST_WITHIN_S + 0.001, IDLE_S)

    with_door(LIMITS, play)


def test_who_waits_for_an_answer_is_not_hung_up_on_however_long_it_takes() -> None:
    async def play(callers: Callers, connections: OpenConnections, answers: asyncio.Event) -> None:
        answers.clear()
        reader, writer = await callers.call()
        writer.write(WHOLE)
        silent, _writer = await callers.call()
        while (
            len(connections.by_transport) < 2
            or sum(connection.at_work for connection in connections.by_transport.values()) < 1
        ):
            await asyncio.sleep(0)
        connections.tend(asyncio.get_running_loop().time() + 100.0 * IDLE_S)
        assert await hung_up(silent)
        assert connections.cut == 1
        answers.set()
        assert (await reader.readline()).startswith(b"HTTP/1.1 200")

    with_door(LIMITS, play)


def test_more_connections_than_allowed_and_strangers_are_not_let_in() -> None:
    async def play(callers: Callers, connections: OpenConnections, _: asyncio.Event) -> None:
        lines = []
        for _ in range(2):
            lines.append(await callers.call())
            lines[-1][1].write(WHOLE)
            assert (await lines[-1][0].readline()).startswith(b"HTTP/1.1 200")
        assert await hung_up((await callers.call())[0])
        assert connections.refused == 1

    with_door(CallerLimits(callers=2), play)

    async def silent(callers: Callers, connections: OpenConnections, _: asyncio.Event) -> None:
        lines = [await callers.call() for _ in range(3)]
        assert await hung_up(lines[0][0])
        assert connections.refused == 0
        lines[2][1].write(WHOLE)
        assert (await lines[2][0].readline()).startswith(b"HTTP/1.1 200")

    with_door(CallerLimits(callers=2), silent)

    async def strangers(callers: Callers, connections: OpenConnections, _: asyncio.Event) -> None:
        reader, writer = await callers.call()
        writer.write(WHOLE)
        assert await hung_up(reader)
        assert (connections.refused, len(connections.by_transport)) == (1, 0)

    with_door(CallerLimits(allowed=(ipaddress.ip_network("192.0.2.0/24"),)), strangers)


class Broken:
    """Stands for a server with a defect, and for the line on which it is told."""

    def __init__(self) -> None:
        self.logged: list[str] = []
        self.asked = 0

    def answer(self, *_: object) -> None:
        self.asked += 1
        raise LookupError("what was that")

    def log(self, text: str) -> None:
        self.logged.append(text)


def with_front(broken: Broken, play: Callable[[Callers], Awaitable[None]]) -> None:
    """Play a scene before the part that reads requests."""

    async def scene() -> None:
        connections = OpenConnections(LIMITS)
        front = Front(broken, broken, None, SystemClock(), connections, 1000.0)  # type: ignore[arg-type]
        http = web.Server(front.handle, access_log=None)
        server = await asyncio.get_running_loop().create_server(
            lambda: ClientConnection(connections, http), "127.0.0.1", 0
        )
        callers = Callers(int(server.sockets[0].getsockname()[1]))
        async with asyncio.timeout(PATIENCE_S):
            await play(callers)
            await callers.leave()
            while connections.by_transport:
                await asyncio.sleep(0)
        server.close()
        await http.shutdown(1.0)

    asyncio.run(scene())


@pytest.mark.parametrize(
    ("host", "known"),
    [
        ("localhost", True),
        ("LOCALHOST.:11111", True),
        ("127.0.0.1:11111", True),
        ("[::1]:11111", True),
        ("a.localhost", True),
        ("192.0.2.7:11111", True),
        ("dome", True),
        ("dome.example.org:80", True),
        ("dome.local", True),
        ("telescope.example.net", True),
        ("192.0.2.8:11111", False),
        ("evil.example", False),
        ("localhost.evil.example", False),
        ("127.0.0.1.evil.example:11111", False),
        ("", False),
        ("[", False),
    ],
)
def test_a_server_answers_to_its_own_names_and_addresses(host: str, known: bool) -> None:
    names = HostNames.of("dome.example.org", ["Telescope.Example.Net"])
    assert names.hold(host, ("192.0.2.7", 11111)) is known


@pytest.mark.parametrize(
    ("sent", "status"),
    [
        (b"GET / HTTP/1.1\r\nHost: evil.example\r\n\r\n", b"403"),
        (b"PUT /x HTTP/1.1\r\nHost: localhost\r\nContent-Length: 999999999\r\n\r\n", b"413"),
    ],
)
def test_what_is_not_for_us_or_too_large_is_refused_at_once(sent: bytes, status: bytes) -> None:
    broken = Broken()

    async def play(callers: Callers) -> None:
        reader, writer = await callers.call()
        writer.write(sent)
        assert (await reader.readline()).split()[1] == status

    with_front(broken, play)
    assert not broken.asked


def test_a_defect_is_told_and_answered_and_ends_nothing_else() -> None:
    broken = Broken()

    async def play(callers: Callers) -> None:
        for _ in range(2):
            reader, writer = await callers.call()
            writer.write(WHOLE)
            assert (await reader.readline()).startswith(b"HTTP/1.1 500")

    with_front(broken, play)
    assert broken.logged == ["a defect of sattrack: LookupError('what was that') in GET '/'"] * 2


PUT = b"PUT / HTTP/1.1\r\nHost: localhost\r\n"


@pytest.mark.parametrize(
    "begun",
    [
        PUT + b"Content-Length: 100\r\n\r\nAxis=0",
        PUT + b"Transfer-Encoding: chunked\r\n\r\n5\r\nAx",
        PUT + b"Transfer-Encoding: chunked\r\n\r\n5\r\nAxis=\r\nnonsense\r\n",
        PUT + b"Content-Encoding: gzip\r\nContent-Length: 4\r\n\r\nAxis",
    ],
)
def test_a_body_that_breaks_off_or_is_broken_is_no_defect_and_is_not_obeyed(begun: bytes) -> None:
    broken = Broken()

    async def play(callers: Callers) -> None:
        reader, writer = await callers.call()
        writer.write(begun)
        writer.write_eof()
        await hung_up(reader)

    with_front(broken, play)
    assert broken.logged == []
    assert broken.asked == 0


def test_a_client_that_waits_for_leave_to_send_its_form_is_given_it() -> None:
    broken = Broken()

    async def play(callers: Callers) -> None:
        reader, writer = await callers.call()
        writer.write(PUT + b"Expect: 100-Continue\r\nContent-Length: 6\r\n\r\n")
        assert await reader.readuntil(b"\r\n\r\n") == b"HTTP/1.1 100 Continue\r\n\r\n"
        assert not broken.asked
        writer.write(b"Axis=0")
        assert (await reader.readline()).startswith(b"HTTP/1.1 500")
        # A form that is too large need not be sent, and HTTP/1.0 has no such answer.
        for refused in (
            PUT + b"Expect: 100-continue\r\nContent-Length: 99999\r\n\r\n",
            b"PUT / HTTP/1.0\r\nExpect: 100-continue\r\nContent-Length: 0\r\n\r\n",
        ):
            reader, writer = await callers.call()
            writer.write(refused)
            assert (await reader.readline()).split()[1] in (b"413", b"500")

    with_front(broken, play)
    assert broken.asked == 2


def test_discovery_answers_the_question_and_nothing_else() -> None:
    discovery = Discovery(11111)
    assert discovery.answer(b"alpacadiscovery1", "192.0.2.1", 0.0) == b'{"AlpacaPort":11111}'
    # What comes after the version is reserved.
    assert discovery.answer(b"alpacadiscovery1" + b"\0" * 48, "192.0.2.1", 0.0) is not None
    for other in (
        b"",
        b"alpacadiscovery",
        b"alpacadiscovery2",
        b"AlpacaDiscovery1",
        b"alpacadiscovery1" * 100,
    ):
        assert discovery.answer(other, "192.0.2.1", 0.0) is None


def test_a_storm_is_answered_no_faster_than_it_is_bounded_and_others_still_are() -> None:
    discovery = Discovery(1)
    answered = sum(
        discovery.answer(b"alpacadiscovery1", "192.0.2.1", step / 10000.0) is not None
        for step in range(50000)
    )
    assert answered == pytest.approx(ANSWERS_PER_S_EACH * 6.0, abs=2)
    assert discovery.answer(b"alpacadiscovery1", "192.0.2.2", 5.0) is not None


def test_a_storm_from_forged_senders_is_bounded_as_a_whole_and_leaves_nothing_behind() -> None:
    discovery = Discovery(1)
    answered = sum(
        discovery.answer(
            b"alpacadiscovery1", f"10.{step >> 16}.{step >> 8 & 255}.{step & 255}", step / 10000.0
        )
        is not None
        for step in range(50000)
    )
    assert answered == pytest.approx(ANSWERS_PER_S * 6.0, abs=2)
    assert len(discovery._each) <= 256


def test_discovery_listens_where_the_server_does() -> None:
    from sattrack.servers.alpaca.serve import discovery_sockets

    for host, addresses in (("127.0.0.1", {"127.0.0.1", "127.255.255.255"}), ("0.0.0.0", {"0.0.0.0"})):
        sockets, trouble = discovery_sockets(host)
        assert trouble is None
        assert {one.getsockname()[0] for one in sockets} == addresses
        for one in sockets:
            one.close()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        try:
            taken.bind(("127.0.0.1", 32227))
        except OSError:
            pytest.skip("somebody answers discovery here")
        sockets, trouble = discovery_sockets("127.0.0.1")
        assert not sockets
        assert trouble is not None
        assert "UDP port 32227 on 127.0.0.1 is not available" in trouble


@pytest.mark.parametrize(
    ("slew_rate_deg_s", "least_s", "most_s"), [(10.0, 600.0, 600.0), (0.1, 4000.0, 8000.0)]
)
def test_a_slew_that_is_waited_for_has_the_time_that_a_slow_mount_takes(
    slew_rate_deg_s: float, least_s: float, most_s: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By 400° of an axis, from one end of its travel to the other."""
    given_s = []

    def timeout(seconds: float) -> asyncio.Timeout:
        given_s.append(seconds)
        return asyncio.Timeout(0.0)

    monkeypatch.setattr(asyncio, "timeout", timeout)
    axis = AxisLimits(slew_rate_deg_s=slew_rate_deg_s)
    telescope = SimpleNamespace(device=SimpleNamespace(profile=MountProfile(ra=axis)))

    async def wait() -> None:
        line = FeederLine(Mock(), Mock(), cast("ServedTelescope", telescope))
        with pytest.raises(Fault, match="no answer in time"):
            await line.order(Slew(10.0, 20.0), waits=True)

    asyncio.run(wait())
    assert least_s <= given_s[0] <= most_s
