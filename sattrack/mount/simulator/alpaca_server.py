"""The simulated telescope behind HTTP, as ASCOM Alpaca has it: `/api/v1/telescope/NUMBER/MEMBER`.

`/simulator/truth?since=UTC` gives where it truly pointed lately, as rows of UTC (POSIX seconds), right
ascension and declination of date; `/simulator/state` gives what was asked of it. Both take no time. `PUT
/simulator/settings` with `parked` or `connected` changes it from outside.
"""

from __future__ import annotations

import asyncio
import random
import time
from collections import Counter, deque
from typing import TYPE_CHECKING, Any

from aiohttp import web

from sattrack.mount.simulator.alpaca_telescope import (
    INVALID_VALUE,
    NOT_CONNECTED,
    RefusedError,
    SimulatedPlace,
    SimulatedTelescope,
    TelescopeSettings,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

LOOK_EVERY_S = 0.02
REMEMBERED = 60000
"""Places that are kept, 20 minutes."""
NOT_IMPLEMENTED = 0x400
EQUATORIAL_SYSTEM = {"jnow": 1, "j2000": 2}
ALIGNMENT_MODE = {"altaz": 0, "polar": 1, "german": 2}
TRUE = {"true": True, "false": False}
FREE = frozenset({"connected", "name", "interfaceversion"})
"""Members that answer without a connection."""


class AlpacaServer:
    """One telescope, number 0, and the requests that come for it."""

    def __init__(self, settings: TelescopeSettings) -> None:
        self.settings = settings
        self.telescope = SimulatedTelescope(settings, time.time())
        self.requests: Counter[str] = Counter()
        self._random = random.Random(settings.seed)
        self._transactions = 0
        self._trail: deque[SimulatedPlace] = deque(maxlen=REMEMBERED)
        self._offset_s = time.time() - time.monotonic()

    def app(self) -> web.Application:
        """Return the web application."""
        app = web.Application()
        app.router.add_route("*", "/api/v1/telescope/0/{member}", self._answer)
        app.router.add_get("/management/v1/configureddevices", self._devices)
        app.router.add_get("/simulator/truth", self._truth)
        app.router.add_get("/simulator/state", self._state)
        app.router.add_put("/simulator/settings", self._set)
        app.cleanup_ctx.append(self._living)
        return app

    async def _living(self, _: web.Application) -> Any:
        looking = asyncio.create_task(self._look())
        yield
        looking.cancel()

    async def _look(self) -> None:
        while True:
            self._trail.append(self.telescope.truth(self._now()))
            await asyncio.sleep(LOOK_EVERY_S)

    def _now(self) -> float:
        return time.monotonic() + self._offset_s

    async def _way(self) -> None:
        settings = self.settings
        seconds = settings.latency_s / 2.0 + self._random.uniform(-settings.jitter_s, settings.jitter_s)
        if settings.held_up_share and self._random.random() < settings.held_up_share:
            seconds += settings.held_up_s
        if seconds > 0.0:
            await asyncio.sleep(seconds)

    async def _answer(self, request: web.Request) -> web.Response:
        given = await request.post() if request.method == "PUT" else request.query
        fields = {str(name): str(value) for name, value in given.items()}
        member = request.match_info["member"]
        await self._way()
        self._transactions += 1
        self.requests[f"{request.method} {member}"] += 1
        body: dict[str, Any] = {
            "ClientTransactionID": int(fields.get("ClientTransactionID", "0")),
            "ServerTransactionID": self._transactions,
            "ErrorNumber": 0,
            "ErrorMessage": "",
        }
        try:
            value = self._do(request.method, member, fields)
            if request.method == "GET":
                body["Value"] = value
        except RefusedError as refused:
            body["ErrorNumber"], body["ErrorMessage"] = refused.number, refused.words
        except (KeyError, ValueError) as error:
            return web.Response(status=400, text=f"bad request: {error}")
        await self._way()
        return web.json_response(body)

    def _do(self, method: str, member: str, fields: Mapping[str, str]) -> Any:
        if not self.telescope.connected and member not in FREE:
            raise RefusedError(NOT_CONNECTED, "The telescope is not connected")
        if method == "PUT":
            return self._changed(member, fields)
        return self._asked(member, fields)

    def _asked(self, member: str, fields: Mapping[str, str]) -> Any:
        telescope, settings, now = self.telescope, self.settings, self._now()
        can = {"canmoveaxis": int(fields["Axis"]) in (0, 1)} if member == "canmoveaxis" else {}
        answers: dict[str, Callable[[], Any]] = {
            "name": lambda: "Simulated Alpaca telescope",
            "interfaceversion": lambda: 4 if settings.device_state else 3,
            "connected": lambda: telescope.connected,
            "canmoveaxis": lambda: can["canmoveaxis"],
            "axisrates": lambda: [{"Minimum": low, "Maximum": high} for low, high in settings.rates_deg_s],
            "equatorialsystem": lambda: EQUATORIAL_SYSTEM[settings.system],
            "doesrefraction": lambda: False,
            "sitelatitude": lambda: settings.latitude_deg,
            "sitelongitude": lambda: settings.longitude_deg,
            "siteelevation": lambda: settings.height_m,
            "cansettracking": lambda: True,
            "canslewasync": lambda: settings.can_slew,
            "cansync": lambda: settings.can_sync,
            "canpark": lambda: True,
            "canfindhome": lambda: False,
            "canpulseguide": lambda: settings.guide_rate_deg_s > 0.0,
            "rightascension": lambda: telescope.reported(now).ra_deg / 15.0,
            "declination": lambda: telescope.reported(now).dec_deg,
            "siderealtime": lambda: telescope.sidereal_h(now),
            "slewing": lambda: telescope.slewing(now),
            "tracking": telescope.tracks,
            "atpark": lambda: telescope.parked,
            "athome": lambda: False,
            "sideofpier": lambda: 0,
        }
        if settings.guide_rate_deg_s:
            answers["ispulseguiding"] = lambda: telescope.guiding(now)
            for axis in ("rightascension", "declination"):
                answers[f"guiderate{axis}"] = lambda: settings.guide_rate_deg_s
        if settings.tells_alignment:
            answers["alignmentmode"] = lambda: ALIGNMENT_MODE[settings.alignment]
        if member == "devicestate" and settings.device_state:
            return self._device_state(now)
        if member not in answers:
            raise RefusedError(NOT_IMPLEMENTED, f"{member} is not implemented")
        return answers[member]()

    def _device_state(self, now: float) -> list[dict[str, Any]]:
        place, telescope = self.telescope.reported(now), self.telescope
        state = {
            "RightAscension": place.ra_deg / 15.0,
            "Declination": place.dec_deg,
            "Slewing": telescope.slewing(now),
            "Tracking": telescope.tracks(),
            "AtPark": telescope.parked,
            "AtHome": False,
            "SideOfPier": 0,
            "IsPulseGuiding": telescope.guiding(now),
            "SiderealTime": telescope.sidereal_h(now),
        }
        return [{"Name": name, "Value": value} for name, value in state.items()]

    def _changed(self, member: str, fields: Mapping[str, str]) -> None:
        telescope, now = self.telescope, self._now()
        if member == "connected":
            if self.settings.refuses_connection and TRUE[fields["Connected"].lower()]:
                raise RefusedError(NOT_CONNECTED, "The serial port is in use")
            telescope.connected = TRUE[fields["Connected"].lower()]
        elif member == "moveaxis":
            telescope.move_axis(int(fields["Axis"]), float(fields["Rate"]), now)
        elif member == "tracking":
            telescope.track(TRUE[fields["Tracking"].lower()], now)
        elif member in self._directed():
            hours, degrees = float(fields["RightAscension"]), float(fields["Declination"])
            if not (0.0 <= hours < 24.0 and -90.0 <= degrees <= 90.0):
                raise RefusedError(INVALID_VALUE, f"{hours}, {degrees} is no direction")
            act = telescope.slew if member == "slewtocoordinatesasync" else telescope.sync
            act(hours * 15.0, degrees, now)
        elif member == "pulseguide" and self.settings.guide_rate_deg_s:
            telescope.pulse(int(fields["Direction"]), int(fields["Duration"]), now)
        elif member == "abortslew":
            telescope.abort(now)
        elif member in {"park", "unpark"}:
            telescope.park(member == "park")
        else:
            raise RefusedError(NOT_IMPLEMENTED, f"{member} is not implemented")

    def _directed(self) -> set[str]:
        """Return which members that take a direction there are."""
        can = {"slewtocoordinatesasync": self.settings.can_slew, "synctocoordinates": self.settings.can_sync}
        return {member for member, there in can.items() if there}

    async def _devices(self, _: web.Request) -> web.Response:
        device = {
            "DeviceName": "Simulated Alpaca telescope",
            "DeviceType": "Telescope",
            "DeviceNumber": 0,
            "UniqueID": "2c1d6cc1-8f3b-4ca1-9d5e-4a0f5a3d9e11",
        }
        body = {"Value": [device], "ClientTransactionID": 0, "ServerTransactionID": 0}
        return web.json_response({**body, "ErrorNumber": 0, "ErrorMessage": ""})

    async def _truth(self, request: web.Request) -> web.Response:
        since = float(request.query.get("since", "-inf"))
        return web.json_response([place for place in self._trail if place.utc_s > since])

    async def _state(self, _: web.Request) -> web.Response:
        telescope = self.telescope
        settings = {
            "tracking": telescope.tracks(),
            "parked": telescope.parked,
            "connected": telescope.connected,
        }
        moving = telescope.slewing(self._now())
        return web.json_response({**settings, "moving": moving, "requests": self.requests})

    async def _set(self, request: web.Request) -> web.Response:
        fields = await request.post()
        if "parked" in fields:
            self.telescope.park(TRUE[str(fields["parked"]).lower()])
        if "connected" in fields:
            self.telescope.connected = TRUE[str(fields["connected"]).lower()]
        return web.json_response({})


async def serve(settings: TelescopeSettings, port: int, ready: Callable[[int], None]) -> None:
    """Serve on a port of loopback, 0 for any free one, until cancelled; `ready` hears which it is.

    Raises OSError where the port is in use.
    """
    runner = web.AppRunner(AlpacaServer(settings).app(), access_log=None)
    await runner.setup()
    try:
        site = web.TCPSite(runner, "127.0.0.1", port)
        await site.start()
        ready(int(runner.addresses[0][1]))
        await asyncio.Event().wait()
    finally:
        await runner.cleanup()
