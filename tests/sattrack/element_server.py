"""A server of element sets on loopback that behaves as CelesTrak and Space-Track do."""

from __future__ import annotations

import asyncio
import gzip
import threading
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING
from urllib.parse import unquote

from aiohttp import web

if TYPE_CHECKING:
    from collections.abc import Iterator

LINES = (
    "1 25544U 98067A   26275.01380287  .00003738  00000+0  76743-4 0  9992",
    "2 25544  51.6312 131.4121 0006946 211.9293 148.1275 15.48707684588318",
)
# CelesTrak, elements of the ISS of 2026-10-02 and of the object 100534 a day before.
CSV = """\
OBJECT_NAME,OBJECT_ID,EPOCH,MEAN_MOTION,ECCENTRICITY,INCLINATION,RA_OF_ASC_NODE,ARG_OF_PERICENTER,\
MEAN_ANOMALY,EPHEMERIS_TYPE,CLASSIFICATION_TYPE,NORAD_CAT_ID,ELEMENT_SET_NO,REV_AT_EPOCH,BSTAR,\
MEAN_MOTION_DOT,MEAN_MOTION_DDOT
ISS (ZARYA),1998-067A,2026-10-02T00:19:52.567968,15.48707684,.00069463,51.6312,131.4121,211.9293,148.1275,0,\
U,25544,999,58831,.7674284E-4,.3738E-4,0
STARLINK-38244,2026-200A,2026-10-01T22:11:24.452448,15.7759124,.00032284,70.0006,102.5417,274.4885,85.5946,0,\
U,100534,999,469,.66694375E-3,.112611E-2,0
"""
HTML = "<!DOCTYPE html><html><head><style>p{}</style></head><body><h1>Down for maintenance</h1></body></html>"


NOT_THERE = ("HUBBEL", "ZARIA", "XYZZY")


@dataclass
class ElementServer:
    """What the server was asked, and how it misbehaves: `manner` is a name that `_answer` knows."""

    manner: str = "well"
    asked: list[str] = field(default_factory=list)
    agents: list[str] = field(default_factory=list)
    logins: list[tuple[str, str]] = field(default_factory=list)
    served: set[str] = field(default_factory=set)
    url: str = ""
    body: bytes = b""

    async def celestrak(self, request: web.Request) -> web.StreamResponse:
        self.asked.append(request.query_string)
        self.agents.append(request.headers["User-Agent"])
        # Left alone, CelesTrak serves a query once until its data are new, 2 hours later.
        if self.manner == "well" and request.query_string in self.served:
            return web.Response(
                status=403,
                text="GP data has not updated since your last successful\n"
                f"download of {request.query_string.split('&')[0]} at 2026-10-02 08:11:36 UTC.\n"
                "Data is updated once every 2 hours.\n",
            )
        self.served.add(request.query_string)
        if request.query.get("GROUP") == "nowhere":
            return web.Response(text=f'Invalid query: "{request.query_string}" (GROUP "nowhere" not found)')
        if request.query.get("CATNR") == "99999" or request.query.get("NAME") in NOT_THERE:
            return web.Response(text="No GP data found")
        return await self._answer(request)

    async def _answer(self, request: web.Request) -> web.StreamResponse:
        data = CSV.encode()
        if self.manner == "any":
            return web.Response(body=self.body)
        if self.manner == "gzip":
            return web.Response(body=gzip.compress(data), headers={"Content-Encoding": "gzip"})
        if self.manner == "gz file":
            return web.Response(body=gzip.compress(data), content_type="application/octet-stream")
        if self.manner == "cut gzip":
            return web.Response(body=gzip.compress(data)[:-20], headers={"Content-Encoding": "gzip"})
        if self.manner == "bad gzip":
            return web.Response(body=b"\x1f\x8b" + bytes(200))
        if self.manner == "html":
            return web.Response(text=HTML, content_type="text/html")
        if self.manner == "tle":
            return web.Response(text="ISS (ZARYA)\r\n" + "\r\n".join(LINES) + "\r\n")
        if self.manner == "half a line":
            return web.Response(body=data[:-60])
        if self.manner == "silent":
            await asyncio.Event().wait()
        if self.manner == "cut":
            response = web.StreamResponse(headers={"Content-Length": str(len(data))})
            await response.prepare(request)
            await response.write(data[:300])
            assert request.transport is not None
            request.transport.close()
            return response
        if self.manner == "moved":
            return web.Response(status=301, headers={"Location": "https://example.org/elsewhere"})
        if self.manner == "broken":
            return web.Response(status=500, text=HTML, content_type="text/html")
        return web.Response(body=data, content_type="text/csv")

    async def login(self, request: web.Request) -> web.Response:
        form = await request.post()
        self.logins.append((str(form["identity"]), str(form["password"])))
        if form["password"] != "right":
            return web.Response(text='{"Login":"Failed"}')
        response = web.Response(text='""')
        response.set_cookie("chocolatechip", "abc")
        return response

    async def space_track(self, request: web.Request) -> web.Response:
        self.asked.append(unquote(request.raw_path))
        if request.cookies.get("chocolatechip") != "abc":
            return web.Response(status=401, text='{"error":"You must be logged in to complete this action"}')
        if self.manner == "limit":
            return web.Response(status=500, text='{"error":"You\'ve violated your query rate limit."}')
        if self.manner == "none":
            return web.Response(text="[]")
        rows = [line.split(",") for line in CSV.splitlines()]
        return web.json_response([dict(zip(rows[0], row, strict=True)) for row in rows[1:]])


@contextmanager
def element_server(manner: str = "well") -> Iterator[ElementServer]:
    """Serve on a free port of loopback until the block ends."""
    server = ElementServer(manner)
    started: threading.Event = threading.Event()
    loop = asyncio.new_event_loop()
    stop = asyncio.Event()

    async def serve() -> None:
        app = web.Application()
        app.router.add_get("/NORAD/elements/gp.php", server.celestrak)
        app.router.add_get("/NORAD/elements/supplemental/sup-gp.php", server.celestrak)
        app.router.add_post("/ajaxauth/login", server.login)
        app.router.add_get("/basicspacedata/query/{rest:.*}", server.space_track)
        runner = web.AppRunner(app, shutdown_timeout=0.1, handler_cancellation=True, access_log=None)
        await runner.setup()
        site = web.TCPSite(runner, "127.0.0.1", 0)
        await site.start()
        server.url = f"http://127.0.0.1:{runner.addresses[0][1]}"
        started.set()
        await stop.wait()
        await runner.cleanup()

    def run() -> None:
        with asyncio.Runner(loop_factory=lambda: loop) as runner:
            runner.run(serve())

    thread = threading.Thread(target=run)
    thread.start()
    started.wait()
    try:
        yield server
    finally:
        loop.call_soon_threadsafe(stop.set)
        thread.join()
