"""The HTTP process of `sattrack serve alpaca`: HTTP and discovery. It never touches the mount.

Reads are answered from the mount's newest state, which the feeding process pushes; orders go there and are
answered from there. So no number of requests disturbs the mount's datagrams. Each connection is admitted, and
ended when it is silent or leaves a request unfinished for too long, before the HTTP protocol sees it. Long
custom actions are computed in a thread, one at a time.
"""

from __future__ import annotations

import asyncio
import contextlib
import functools
import gc
import logging
import os
import socket
import sys
import time
from collections import OrderedDict
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, cast

import msgspec
from aiohttp import ClientPayloadError, HttpVersion11, http_exceptions, web

from sattrack.core.clock import SimulatedClock, SystemClock
from sattrack.runtime.callers import Bucket, HostNames
from sattrack.servers.alpaca.connections import (
    REQUEST_WITHIN_S,
    TEND_EVERY_S,
    ClientConnection,
    FeederLine,
    OpenConnections,
)
from sattrack.servers.alpaca.planetarium import BURST_S, Planetariums
from sattrack.servers.alpaca.protocol import (
    BiasOrder,
    Fault,
    FollowOrder,
    Number,
    Passes,
    TrackSatellite,
)
from sattrack.servers.alpaca.serve import READY, decode_task, run_summary
from sattrack.servers.alpaca.telescope import Device, Pending, Reply, ServedTelescope, Server

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable

    from sattrack.core.clock import Clock
    from sattrack.runtime.callers import CallerLimits
    from sattrack.runtime.facts import RunFacts
    from sattrack.servers.alpaca.protocol import CustomAction, Order
    from sattrack.servers.alpaca.serve import AlpacaTask, Satellites

PREPARE_AFTER_S = 0.5
BUSY = "passes are being computed for somebody else: ask again in a moment"
MOST_BODY_BYTES = 16384
MOST_LINE_BYTES = 8190
BACKLOG = 256
CONTINUE = "100-continue"
DISCOVERY_REQUEST = b"alpacadiscovery1"
LONGEST_DISCOVERY = 1024
ANSWERS_PER_S = 100.0
ANSWERS_PER_S_EACH = 10.0
MOST_HOSTS = 256
LOG_EVERY_S = 10.0
BROKEN_OFF = (
    web.RequestPayloadError,
    ClientPayloadError,
    http_exceptions.HttpProcessingError,
    ConnectionError,
)
BEHIND_THE_FEEDER = 5
"""How much nicer than the feeding process this one is."""
LONGEST_TASK = 1 << 28
"""Bytes: a whole catalogue's elements come with the task."""


class Actions:
    """Carries out custom actions, one computation at a time."""

    def __init__(self, satellites: Satellites, telescope: ServedTelescope, clock: Clock) -> None:
        self._satellites, self._telescope, self._clock = satellites, telescope, clock
        self._computing = False
        self._importing = asyncio.Lock()
        """Two threads that import modules at once may see them half imported."""

    async def prepare(self) -> None:
        """Import what computes passes before a client waits for it, but after the first answers."""
        await asyncio.sleep(PREPARE_AFTER_S)
        async with self._importing:
            await asyncio.to_thread(self._satellites.prepare)
        # Imported modules need no garbage collection.
        gc.collect()
        gc.freeze()

    async def do(self, asked: CustomAction, order: Callable[[Order], Awaitable[None]]) -> str:
        """Return an action's answer, JSON text; `order` sends an order. Raises Fault."""
        if isinstance(asked, BiasOrder):
            return await self._bias(asked, order)
        now_utc_s = self._clock.utc_s(time.monotonic())
        if isinstance(asked, Passes):
            return _text(await self._computed(self._satellites.passes, asked, now_utc_s))
        facts = await self._computed(self._satellites.facts, asked, now_utc_s)
        return await self._follow(facts, order)

    async def follow(self, text: str, order: Callable[[Order], Awaitable[None]]) -> str:
        """Follow the satellite of a text of elements; return its pass as `do` does. Raises Fault."""
        now_utc_s = self._clock.utc_s(time.monotonic())
        facts = await self._computed(self._satellites.facts_of, text, now_utc_s)
        return await self._follow(facts, order)

    async def _follow(self, facts: RunFacts, order: Callable[[Order], Awaitable[None]]) -> str:
        from sattrack.runtime.facts import encode_facts

        await order(FollowOrder(msgspec.Raw(encode_facts(facts))))
        return _text(run_summary(facts))

    async def _computed(self, compute: Callable[..., Any], *arguments: Any) -> Any:
        if self._computing:
            raise Fault(Number.INVALID_OPERATION, BUSY)
        self._computing = True
        try:
            async with self._importing:
                return await asyncio.to_thread(compute, *arguments)
        finally:
            self._computing = False

    async def _bias(self, asked: BiasOrder, order: Callable[[Order], Awaitable[None]]) -> str:
        if asked.along_s is not None or asked.cross_deg is not None:
            await order(asked)
        state = self._telescope.state
        followed = None if state is None else state.following
        if followed is None:
            raise Fault(Number.INVALID_OPERATION, "no satellite is followed: TrackSatellite first")
        return _text(followed)


def _text(value: Any) -> str:
    return msgspec.json.encode(value).decode()


@dataclass(slots=True)
class Front:
    """Serves HTTP requests; `server` answers them."""

    server: Server
    channel: FeederLine
    actions: Actions
    clock: Clock
    connections: OpenConnections
    requests_per_s: float
    names: HostNames = field(default_factory=HostNames)
    _paces: dict[asyncio.BaseTransport, Bucket] = field(default_factory=dict)

    async def handle(self, request: web.BaseRequest) -> web.StreamResponse:
        """Answer one request."""
        transport = request.transport
        connection = None if transport is None else self.connections.by_transport.get(transport)
        if transport is None or connection is None:
            return web.Response(status=503)
        connection.begins()
        try:
            if request.method != "GET" and "Origin" in request.headers:
                return _hung_up(403, "a web page is not obeyed: only programs send no Origin")
            # The target's own, where that is a whole URL; the address that was called, where nothing says.
            host = request.host
            if not self.names.hold(host, transport.get_extra_info("sockname")):
                return _hung_up(403, f"this server is not called {host[:60]!r}: --name adds a name")
            await self._keep_pace(transport)
            return await self._answer(request)
        except Exception as error:  # noqa: BLE001 - one request that breaks something is no end of the others
            self.channel.log(f"a defect of sattrack: {error!r} in {request.method} {request.path[:60]!r}")
            return _hung_up(500, "a defect of sattrack: see its log")
        finally:
            connection.ends()

    async def _keep_pace(self, transport: asyncio.BaseTransport) -> None:
        """Count one request; wait where the connection asks too fast."""
        rate, now_s = self.requests_per_s, asyncio.get_running_loop().time()
        bucket = self._paces.setdefault(transport, Bucket(rate, BURST_S * rate, now_s))
        bucket.fill(now_s)
        bucket.left -= 1.0
        if bucket.left < 0.0:
            await asyncio.sleep(-bucket.left / rate)

    async def _answer(self, request: web.BaseRequest) -> web.StreamResponse:
        body = await _body(request)
        if isinstance(body, web.Response):
            return body
        url, now_utc_s = request.rel_url, self.clock.utc_s(time.monotonic())
        query = url.raw_query_string.encode("utf-8", "replace")
        asked = self.server.answer(request.method, url.raw_path, query, body, now_utc_s)
        if isinstance(asked, Reply):
            return _response(asked)
        return _response(await self._finish(asked))

    async def _finish(self, pending: Pending) -> Reply:
        try:
            if isinstance(pending.order, BiasOrder | Passes | TrackSatellite):
                value = await self.actions.do(pending.order, self.channel.order)
                return self.server.finish(pending, value)
            await self.channel.order(pending.order, pending.waits)
        except Fault as fault:
            return self.server.finish(pending, fault=fault)
        return self.server.finish(pending)

    async def tend(self) -> None:
        """Look after connections, forever; log how many were refused."""
        logged, logged_s = (0, 0), -LOG_EVERY_S
        loop = asyncio.get_running_loop()
        while True:
            await asyncio.sleep(TEND_EVERY_S)
            self.connections.tend(loop.time())
            connected = self.connections.by_transport
            self._paces = {line: pace for line, pace in self._paces.items() if line in connected}
            counts = (self.connections.refused, self.connections.cut)
            if counts != logged and loop.time() - logged_s >= LOG_EVERY_S:
                new = (counts[0] - logged[0], counts[1] - logged[1])
                self.channel.log(
                    f"{new[0]} connections were refused, {new[1]} were silent or halting too long"
                )
                logged, logged_s = counts, loop.time()


@dataclass(slots=True)
class Discovery:
    """Answers Alpaca discovery ("ASCOM Alpaca API Reference") for one HTTP port. IPv4.

    The rate of answers is limited, so that neither a storm of requests nor a forged sender makes this program
    flood a host. Instants are seconds of any clock that does not go back.
    """

    http_port: int
    _all: Bucket = field(default_factory=lambda: Bucket(ANSWERS_PER_S, ANSWERS_PER_S, 0.0))
    _each: OrderedDict[str, Bucket] = field(default_factory=OrderedDict)

    def answer(self, data: bytes, host: str, now_s: float) -> bytes | None:
        """Return what to send back, None for nothing."""
        if not data.startswith(DISCOVERY_REQUEST) or len(data) > LONGEST_DISCOVERY:
            return None
        each = self._each.get(host)
        if each is None:
            each = self._each[host] = Bucket(ANSWERS_PER_S_EACH, ANSWERS_PER_S_EACH, now_s)
            if len(self._each) > MOST_HOSTS:
                self._each.popitem(last=False)
        self._each.move_to_end(host)
        if not (each.take(now_s) and self._all.take(now_s)):
            return None
        return msgspec.json.encode({"AlpacaPort": self.http_port})


class DiscoveryProtocol(asyncio.DatagramProtocol):
    """Answers discovery to clients that may connect."""

    def __init__(self, discovery: Discovery, limits: CallerLimits) -> None:
        self._discovery, self._limits = discovery, limits
        self._transport: asyncio.DatagramTransport | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """See asyncio.DatagramProtocol."""
        self._transport = cast("asyncio.DatagramTransport", transport)

    def datagram_received(self, data: bytes, addr: tuple[str | Any, int]) -> None:
        """See asyncio.DatagramProtocol."""
        if self._transport is None or not self._limits.allow(addr[0]):
            return
        answer = self._discovery.answer(data, addr[0], time.monotonic())
        if answer is not None:
            self._transport.sendto(answer, addr)

    def error_received(self, exc: Exception) -> None:
        """See asyncio.DatagramProtocol: the client is gone already."""


async def _body(request: web.BaseRequest) -> bytes | web.Response:
    """Return a request's body, or the answer to one that is too large or too slow."""
    if (request.content_length or 0) > MOST_BODY_BYTES:
        return _hung_up(413, f"a body has {MOST_BODY_BYTES} bytes at most")
    expects = request.version >= HttpVersion11 and request.headers.get("Expect", "").lower() == CONTINUE
    if expects and request.transport is not None:
        # .NET Framework's clients, and curl with a long form, wait for this before they send the form.
        request.transport.write(b"HTTP/1.1 100 Continue\r\n\r\n")
    data = b""
    try:
        async with asyncio.timeout(REQUEST_WITHIN_S):
            while piece := await request.content.readany():
                data += piece
                if len(data) > MOST_BODY_BYTES:
                    return _hung_up(413, f"a body has {MOST_BODY_BYTES} bytes at most")
    except BROKEN_OFF:
        return _hung_up(400, "the request broke off, or its body is not what its headers say")
    except TimeoutError:
        return _hung_up(408, f"a request must be whole within {REQUEST_WITHIN_S:g} s")
    return data


def _hung_up(status: int, message: str) -> web.Response:
    response = web.Response(status=status, text=message + "\n")
    response.force_close()
    return response


def _response(reply: Reply) -> web.Response:
    return web.Response(
        status=reply.status,
        body=reply.body,
        headers={"Allow": reply.allow} if reply.allow else None,
        content_type=reply.kind,
        charset="utf-8",
    )


async def serve(task: AlpacaTask, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    """Serve until the feeding process is gone."""
    known = task.satellites
    device = Device(known.profile, known.site.place(), known.mount, task.version, task.host, task.abilities)
    setting = task.clock
    clock: Clock = SystemClock()
    if setting is not None:
        clock = SimulatedClock(setting.start_utc_s, setting.anchor_s, setting.speed)
    telescope = ServedTelescope(device)
    site = known.site
    server = Server(telescope, f"{site.latitude_deg:.4f}, {site.longitude_deg:.4f}, {site.height_m:g} m")
    limits = task.limits()
    channel, connections = FeederLine(reader, writer, telescope), OpenConnections(limits)
    actions = Actions(known, telescope, clock)
    front = Front(
        server, channel, actions, clock, connections, task.requests_per_s, HostNames.of(task.host, task.names)
    )
    loop = asyncio.get_running_loop()
    listeners: list[tuple[int, Callable[[], asyncio.Protocol]]] = []
    if task.listener is not None:
        http = web.Server(
            front.handle,
            access_log=None,
            max_line_size=MOST_LINE_BYTES,
            max_field_size=MOST_LINE_BYTES,
            keepalive_timeout=task.idle_s,
        )
        listeners.append((task.listener, http))
    follow = functools.partial(actions.follow, order=channel.order)
    others = Planetariums(telescope, channel, connections, clock, task.requests_per_s, follow)
    for number, serve_one in (
        (task.lx200, others.lx200),
        (task.indi, others.indi),
        (task.stellarium, others.stellarium),
    ):
        if number is not None:
            listeners.append((number, functools.partial(others.protocol, serve_one)))
    servers = [
        await loop.create_server(
            functools.partial(ClientConnection, connections, inner),
            sock=socket.socket(fileno=number),
            backlog=BACKLOG,
        )
        for number, inner in listeners
    ]
    for number in task.discovery:
        answers = Discovery(task.port)
        await loop.create_datagram_endpoint(
            lambda answers=answers: DiscoveryProtocol(answers, limits),  # type: ignore[misc]
            sock=socket.socket(fileno=number),
        )
    aside = [loop.create_task(front.tend()), loop.create_task(actions.prepare())]
    if task.serial is not None:
        aside.append(loop.create_task(others.serial_line(task.serial.number, task.serial.reopened)))
    # Garbage is then looked for among what connections made, before it is megabytes.
    gc.freeze()
    channel.log(READY)
    try:
        await channel.listen()
    finally:
        for task_aside in aside:
            task_aside.cancel()
        for server_of in servers:
            server_of.close()


async def _main(number: int) -> None:
    line = socket.socket(fileno=number)
    reader, writer = await asyncio.open_connection(sock=line, limit=LONGEST_TASK)
    task = decode_task(await reader.readline())
    with contextlib.suppress(ConnectionError):
        await serve(task, reader, writer)


def main() -> None:
    """Serve on the descriptors of the task that comes on the one given."""
    logging.getLogger("aiohttp").addHandler(logging.NullHandler())
    logging.getLogger("aiohttp").propagate = False
    with contextlib.suppress(OSError):
        os.nice(BEHIND_THE_FEEDER)
    asyncio.run(_main(int(sys.argv[1])))


if __name__ == "__main__":
    main()
