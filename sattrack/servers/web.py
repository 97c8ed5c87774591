"""The screen of a run in a browser: the page, its connections and who may open it.

Each visitor's screen is a process.
"""

from __future__ import annotations

import asyncio
import ipaddress
import json
import logging
import re
import secrets
import shlex
import signal
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

import textual_serve
from aiohttp import web
from textual_serve.app_service import AppService
from textual_serve.server import Server

from sattrack.core.errors import SattrackError
from sattrack.runtime.callers import CallerLimits
from sattrack.servers.alpaca.connections import ClientConnection, OpenConnections
from sattrack.views.picture import ON_PAGE

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from aiohttp.typedefs import Handler
    from textual_serve.download_manager import DownloadManager

FIB_TRIE = Path("/proc/net/fib_trie")
IF_INET6 = Path("/proc/net/if_inet6")
LOOPBACK = frozenset({"127.0.0.1", "::1", "localhost"})
WILDCARDS = frozenset({"0.0.0.0", "::", ""})
"""All of the machine's addresses."""
TOKEN_BYTES = 18
LIMITS = CallerLimits()
"""How many connections there may be, and from one address, and how long each may be silent."""
MOST_VISITORS = 8
"""Each has a process of its own."""
FONT_SIZES = range(8, 41)
USUAL_FONT_SIZE = 16
LOOK_AGAIN_S = 3
HEARTBEAT_S = 15.0
ANSWER_WITHIN_S = 1.0
"""How long requests that are being answered may take yet when the page ends."""
LEAVE_WITHIN_S = 2.0
"""How long a visitor's screen may take to end after each request, before a harder one follows."""
READ_WITHIN_S = 10.0
"""How long a visitor's screen may leave its input unread."""
HEADERS = {
    "Content-Security-Policy": "default-src 'self'; script-src 'self' 'unsafe-inline'; style-src 'self' "
    "'unsafe-inline'; img-src 'self' data:; connect-src 'self' ws: wss:; frame-ancestors 'none'",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
}
STATIC = Path(textual_serve.__file__).parent / "static"
PAGE = Path(__file__).parent / "templates" / "index.html"
LIST = Path(__file__).parent / "templates" / "list.html"
NO_RUN = "No run is active. This page checks again by itself."


def machine_addresses() -> tuple[str, ...]:
    """Return this machine's addresses but for loopback and link-local ones, as Linux lists them."""
    return addresses_in(_text(FIB_TRIE), _text(IF_INET6))


def addresses_in(fib_trie: str, if_inet6: str) -> tuple[str, ...]:
    """Return the addresses in the kernel's two tables, IPv4 first, each once."""
    found = re.findall(r"\|-- (\S+)\s+/32 host LOCAL", fib_trie)
    found += [":".join(re.findall("....", line.split()[0])) for line in if_inet6.splitlines() if line.strip()]
    addresses = (ipaddress.ip_address(text) for text in dict.fromkeys(found))
    return tuple(str(each) for each in addresses if not (each.is_loopback or each.is_link_local))


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="ascii")
    except OSError:
        return ""


@dataclass(frozen=True, slots=True)
class Visit:
    """The address of the page, its token, and the program that draws each visitor's screen."""

    host: str
    port: int
    token: str | None
    command: tuple[str, ...]

    @property
    def cookie(self) -> str:
        """The name under which a browser keeps the token; one for each port."""
        return f"sattrack_{self.port}"

    def urls(self, port: int, machine: tuple[str, ...]) -> tuple[str, ...]:
        """Return the addresses to open: where the host is a wildcard, one for each of the machine's."""
        hosts: tuple[str, ...] = (self.host,)
        if self.host in WILDCARDS:
            hosts = tuple(each for each in machine if ":" not in each or self.host != "0.0.0.0")
            hosts = hosts or ("127.0.0.1",)
        query = "" if self.token is None else f"?token={self.token}"
        return tuple(f"http://{f'[{host}]' if ':' in host else host}:{port}/{query}" for host in hosts)

    def refusal(
        self, host_header: str, origin: str | None, query: Mapping[str, str], cookies: Mapping[str, str]
    ) -> str | None:
        """Return why a request is refused, or None.

        Another page in a visitor's browser could otherwise reach this one, by its scripts (shown by the
        origin) or by a name that leads here (shown by the host).
        """
        if self.host in LOOPBACK and _name(host_header) not in LOOPBACK:
            return f"this page is at {self.host} only"
        if origin is not None and _authority(origin) != host_header:
            return "this page is not for others' scripts"
        if self.token is None:
            return None
        brought = (query.get("token"), cookies.get(self.cookie))
        if any(each is not None and _same(each, self.token) for each in brought):
            return None
        return "bring the token: open the address that `sattrack serve web` has shown"


def needs_token(host: str) -> bool:
    """Return whether users of other machines can connect."""
    return host not in LOOPBACK


def new_token() -> str:
    """Return a random token."""
    return secrets.token_urlsafe(TOKEN_BYTES)


def _name(host_header: str) -> str:
    try:
        return urlsplit(f"//{host_header}").hostname or ""
    except ValueError:
        return ""


def _authority(origin: str) -> str | None:
    try:
        return urlsplit(origin).netloc or None
    except ValueError:
        return None


def _same(one: str, other: str) -> bool:
    return secrets.compare_digest(one.encode(), other.encode())


class VisitorScreen(AppService):
    """The process that draws one visitor's screen. It is gone once `stop` has returned."""

    def __init__(self, command: str, websocket: web.WebSocketResponse, downloads: DownloadManager) -> None:
        async def close() -> None:
            await websocket.close()

        async def write_bytes(data: bytes) -> None:
            # A visitor who has gone: the process' output is still read, so that it does not block.
            with suppress(ConnectionError):
                await websocket.send_bytes(data)

        async def write_str(text: str) -> None:
            with suppress(ConnectionError):
                await websocket.send_str(text)

        super().__init__(
            command, write_bytes=write_bytes, write_str=write_str, close=close, download_manager=downloads
        )

    async def send_bytes(self, data: bytes) -> bool:
        """Pass input on. Raises TimeoutError where the process does not read it."""
        async with asyncio.timeout(READ_WITHIN_S):
            return await super().send_bytes(data)

    async def send_meta(self, data: dict[str, str | int | bool | None]) -> bool:
        """Send a size, a focus or the end. Raises TimeoutError where the process does not read it."""
        async with asyncio.timeout(READ_WITHIN_S):
            return await super().send_meta(data)

    async def run(self) -> None:
        """Pass the process' output on; its end closes the visitor's connection."""
        try:
            await super().run()
        finally:
            await self.remote_close()

    async def on_meta(self, data: bytes) -> None:
        """Pass a camera's picture on to the page; the rest is as usual."""
        told = json.loads(data)
        if told["type"] == ON_PAGE:
            await self.remote_write_str(json.dumps([ON_PAGE, told]))
        else:
            await super().on_meta(data)

    async def stop(self) -> None:
        """End the process: ask it, then terminate it, then kill it."""
        process = self._process
        if process is None:
            return
        with suppress(TimeoutError):
            async with asyncio.timeout(LEAVE_WITHIN_S):
                await self.send_meta({"type": "quit"})
                await process.wait()
        for end in (process.terminate, process.kill):
            if process.returncode is None:
                with suppress(ProcessLookupError):
                    end()
                with suppress(TimeoutError):
                    async with asyncio.timeout(LEAVE_WITHIN_S):
                        await process.wait()


class RunServer(Server):
    """Serves the screens. `runs` returns the runs: each one's process and its description."""

    def __init__(self, visit: Visit, runs: Callable[[], Mapping[int, str]]) -> None:
        super().__init__(shlex.join(visit.command), visit.host, visit.port, title="sattrack")
        self._visit, self._runs = visit, runs
        self.connections = OpenConnections(LIMITS)
        self._visitors = 0
        self._screens: set[VisitorScreen] = set()

    def application(self) -> web.Application:
        """Make the application."""

        @web.middleware
        async def let_in(request: web.Request, handler: Handler) -> web.StreamResponse:
            return await self._let_in(request, handler)

        app = web.Application(middlewares=[let_in])
        app.on_shutdown.append(self._see_off)
        app.add_routes(
            [
                web.get("/", self._index),
                web.get("/run/{run:[0-9]+}", self._index),
                web.get("/ws", self.handle_websocket),
                web.get("/ws/{run:[0-9]+}", self.handle_websocket),
                web.static("/static", STATIC),
            ]
        )
        return app

    async def _see_off(self, _: web.Application) -> None:
        """End every visitor's screen with the page."""
        await asyncio.gather(*(screen.stop() for screen in tuple(self._screens)))

    async def _let_in(self, request: web.Request, go_on: Handler) -> web.StreamResponse:
        transport = request.transport
        connection = None if transport is None else self.connections.by_transport.get(transport)
        if connection is None:
            return web.Response(status=503)
        connection.begins()
        try:
            return await self._answer(request, go_on)
        finally:
            connection.ends()

    async def _answer(self, request: web.Request, go_on: Handler) -> web.StreamResponse:
        origin = request.headers.get("Origin")
        why = self._visit.refusal(request.host, origin, request.query, request.cookies)
        if why is not None:
            return web.Response(status=403, text=f"{why}\n", headers=HEADERS)
        response = await go_on(request)
        if not response.prepared:
            response.headers.update(HEADERS)
        return response

    async def _index(self, request: web.Request) -> web.StreamResponse:
        token = self._visit.token
        if token is not None and "token" in request.query:
            # The token must stand neither in the address nor in the browser's history.
            moved = web.Response(status=303, headers={"Location": request.path})
            moved.set_cookie(self._visit.cookie, token, httponly=True, samesite="Lax")
            return moved
        runs, run = await self._run_of(request)
        if run is None:
            text, refresh = listed(runs), {"Refresh": f"{LOOK_AGAIN_S}; url=/"}
            return web.Response(text=text, content_type="text/html", headers=refresh)
        asked = request.query.get("fontsize", "")
        size = asked if asked in map(str, FONT_SIZES) else str(USUAL_FONT_SIZE)
        page = PAGE.read_text(encoding="utf-8").replace("{{ run }}", str(run))
        page = page.replace("{{ font_size }}", size)
        return web.Response(text=page, content_type="text/html")

    async def _run_of(self, request: web.Request) -> tuple[Mapping[int, str], int | None]:
        """Return the runs, and the requested one: the only one where none is named."""
        runs = await asyncio.to_thread(self._runs)
        named = request.match_info.get("run")
        if named is None:
            return runs, next(iter(runs)) if len(runs) == 1 else None
        return runs, next((pid for pid in runs if str(pid) == named), None)

    async def handle_websocket(self, request: web.Request) -> web.WebSocketResponse:
        """Give a visitor a screen of their own, until either side ends."""
        _, run = await self._run_of(request)
        if run is None:
            raise web.HTTPNotFound(text=f"{NO_RUN}\n")
        if self._visitors >= MOST_VISITORS:
            raise web.HTTPServiceUnavailable(text=f"{MOST_VISITORS} visitors are here already\n")
        websocket = web.WebSocketResponse(heartbeat=HEARTBEAT_S)
        self._visitors += 1
        screen = VisitorScreen(
            f"exec {self.command} --run {run} --as {shlex.quote(f'browser at {request.remote}')}",
            websocket,
            self.download_manager,
        )
        self._screens.add(screen)
        try:
            await websocket.prepare(request)
            await screen.start(_cells(request, "width", 80), _cells(request, "height", 24))
            await self._process_messages(websocket, screen)
        except (OSError, ValueError, KeyError, IndexError, TypeError, AssertionError):
            # An invalid message, or one that the screen did not read, ends this visitor's screen alone.
            pass
        finally:
            self._visitors -= 1
            try:
                await screen.stop()
            finally:
                self._screens.discard(screen)
        return websocket


def listed(runs: Mapping[int, str]) -> str:
    """Return the page that links to each run, or says that there is none."""
    links = "".join(f'<p><a href="/run/{pid}">{escape(words)}</a></p>\n' for pid, words in runs.items())
    counted = {0: NO_RUN, 1: "That run is not active. Another one is:"}
    words = counted.get(len(runs), f"{len(runs)} runs are active:")
    return LIST.read_text(encoding="utf-8").replace("{{ words }}", words).replace("{{ links }}", links)


def _cells(request: web.Request, name: str, usual: int) -> int:
    text = request.query.get(name, "")
    return min(500, max(1, int(text))) if text.isascii() and text.isdecimal() else usual


def serve(
    visit: Visit, runs: Callable[[], Mapping[int, str]], tell: Callable[[tuple[str, ...]], None]
) -> None:
    """Serve until a signal ends it; `tell` takes the addresses to open.

    Raises SattrackError where the port is taken.
    """
    # It calls a visitor who left before the screen was drawn an application that failed to start.
    logging.getLogger("textual-serve").setLevel(logging.CRITICAL)
    asyncio.run(_serve(visit, runs, tell))


async def _serve(
    visit: Visit, runs: Callable[[], Mapping[int, str]], tell: Callable[[tuple[str, ...]], None]
) -> None:
    run_server = RunServer(visit, runs)
    runner = web.AppRunner(run_server.application(), access_log=None, shutdown_timeout=ANSWER_WITHIN_S)
    await runner.setup()
    assert runner.server is not None
    connections = run_server.connections
    make_connection = partial(ClientConnection, connections, runner.server)
    ended = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        loop.add_signal_handler(number, ended.set)
    tending = loop.create_task(connections.keep_tending())
    try:
        try:
            server = await loop.create_server(make_connection, visit.host, visit.port)
        except OSError as error:
            raise SattrackError(
                f"cannot listen on {visit.host} port {visit.port}: {error.strerror}"
            ) from None
        try:
            tell(visit.urls(server.sockets[0].getsockname()[1], machine_addresses()))
            await ended.wait()
        finally:
            server.close()
    finally:
        tending.cancel()
        await runner.cleanup()
