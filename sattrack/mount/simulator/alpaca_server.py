"""Simulated devices behind HTTP, as ASCOM Alpaca has it: `/api/v1/telescope/0/MEMBER`, and `camera`.

`/simulator/truth?since=UTC` gives where the telescope truly pointed lately, as rows of UTC (POSIX seconds),
right ascension and declination of date; `/simulator/state` gives what was asked of it. Both take no time.
`PUT /simulator/settings` with `parked` or `connected` changes it from outside.

As a process of its own it serves the camera of another simulated mount: it gets its configuration as one JSON
argument, hears where the axes are as JSON lines, and writes the port that it listens on as its first line.
It ends with its standard input.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
import os
import random
import signal
import socket
import sys
import time
from collections import Counter, deque
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec
from aiohttp import web

from sattrack.core.channel import LineReader
from sattrack.core.clock import SystemClock
from sattrack.core.errors import SattrackError
from sattrack.mount.model import mean_sidereal_deg
from sattrack.mount.simulator.alpaca_camera import RunningExposure, SimulatedAlpacaCamera
from sattrack.mount.simulator.alpaca_telescope import (
    INVALID_VALUE,
    NOT_CONNECTED,
    RefusedError,
    SimulatedPlace,
    SimulatedTelescope,
    TelescopeSettings,
)
from sattrack.mount.simulator.camera import SkyCamera, TruePath, make_sky
from sattrack.mount.simulator.hidden import Hidden, SimulatedCamera
from sattrack.mount.simulator.mount import SimulatedSite, Truth
from sattrack.mount.simulator.process import ClockSetting, make_clock
from tle.elements import Elements
from tle.site import Site
from tle.sources import parse_elements

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Callable, Coroutine, Mapping

    from sattrack.core.clock import Clock
    from sattrack.mount.simulator.camera import RenderedFrame

LOOK_EVERY_S = 0.02
REMEMBERED = 60000
"""Places that are kept, 20 minutes."""
LATEST_PATH_S = 0.3
"""For so long a picture waits for where the axes went; a mount that stands still tells nothing."""
NOT_IMPLEMENTED = 0x400
EQUATORIAL_SYSTEM = {"jnow": 1, "j2000": 2}
ALIGNMENT_MODE = {"altaz": 0, "polar": 1, "german": 2}
TRUE = {"true": True, "false": False}
FREE = frozenset(
    {"connected", "connect", "disconnect", "connecting", "name", "interfaceversion", "description"}
    | {"driverinfo", "driverversion", "supportedactions"}
)
"""Members that answer without a connection."""
DISCOVERY_PORT = 32227
DISCOVERY = b"alpacadiscovery1"


class AlpacaTelescope:
    """Telescope 0: what its members do, and how long requests take on their way."""

    kind = "telescope"
    name = "Simulated Alpaca telescope"
    unique_id = "2c1d6cc1-8f3b-4ca1-9d5e-4a0f5a3d9e11"

    def __init__(self, settings: TelescopeSettings) -> None:
        self.settings = settings
        self.telescope = SimulatedTelescope(settings, time.time())
        self._random = random.Random(settings.seed)

    @property
    def connected(self) -> bool:
        """Whether a client has connected it."""
        return self.telescope.connected

    async def way(self) -> None:
        """Wait for as long as a request, or its answer, is on its way."""
        settings = self.settings
        seconds = settings.latency_s / 2.0 + self._random.uniform(-settings.jitter_s, settings.jitter_s)
        if settings.held_up_share and self._random.random() < settings.held_up_share:
            seconds += settings.held_up_s
        if seconds > 0.0:
            await asyncio.sleep(seconds)

    def ask(self, member: str, fields: Mapping[str, str], now: float) -> Any:
        """Return the value of a member. Raises RefusedError."""
        telescope, settings = self.telescope, self.settings
        can = {"canmoveaxis": int(fields["Axis"]) in (0, 1)} if member == "canmoveaxis" else {}
        answers: dict[str, Callable[[], Any]] = {
            "name": lambda: self.name,
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
            "sideofpier": lambda: int(telescope.beyond_pole(now)),
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
            "SideOfPier": int(telescope.beyond_pole(now)),
            "IsPulseGuiding": telescope.guiding(now),
            "SiderealTime": telescope.sidereal_h(now),
        }
        return [{"Name": name, "Value": value} for name, value in state.items()]

    def change(self, member: str, fields: Mapping[str, str], now: float) -> None:
        """Do what a member asks. Raises RefusedError, and KeyError or ValueError for bad fields."""
        telescope = self.telescope
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


class AlpacaServer:
    """A telescope, a camera or both, each number 0, and the requests that come for them."""

    def __init__(
        self,
        clock: Clock,
        telescope: AlpacaTelescope | None = None,
        camera: SimulatedAlpacaCamera | None = None,
        config: CameraConfig | None = None,
    ) -> None:
        self._clock, self._config = clock, config
        self._telescope, self._camera = telescope, camera
        self._devices: dict[str, AlpacaTelescope | SimulatedAlpacaCamera] = {
            device.kind: device for device in (telescope, camera) if device is not None
        }
        self.path = TruePath()
        self.requests: Counter[str] = Counter()
        self._transactions = 0
        self._trail: deque[SimulatedPlace] = deque(maxlen=REMEMBERED)
        self._tasks: set[asyncio.Task[None]] = set()

    def app(self) -> web.Application:
        """Return the web application."""
        app = web.Application()
        app.router.add_route("*", "/api/v1/{kind}/0/{member}", self._answer)
        app.router.add_get("/management/apiversions", self._versions)
        app.router.add_get("/management/v1/configureddevices", self._configured)
        if self._telescope is not None:
            app.router.add_get("/simulator/truth", self._truth)
            app.router.add_get("/simulator/state", self._state)
            app.router.add_put("/simulator/settings", self._set)
        app.cleanup_ctx.append(self._living)
        return app

    async def _living(self, _: web.Application) -> AsyncIterator[None]:
        """Look at the telescope and take pictures while requests are answered; an error there ends it all."""
        if self._telescope is not None:
            self.start(self._look())
        if self._camera is not None and self._config is not None and self._config.frames is not None:
            self.start(self._take_frames(self._camera.camera, self._config, Path(self._config.frames)))
        yield
        for task in self._tasks:
            task.cancel()

    async def _look(self) -> None:
        assert self._telescope is not None
        while True:
            telescope, now = self._telescope.telescope, self.now()
            self._trail.append(telescope.truth(now))
            self.path.add(now, *telescope.axes(now))
            await asyncio.sleep(LOOK_EVERY_S)

    def now(self) -> float:
        """Return the instant that it is."""
        return self._clock.utc_s(time.monotonic())

    async def _answer(self, request: web.Request) -> web.Response:
        given = await request.post() if request.method == "PUT" else request.query
        fields = {str(name): str(value) for name, value in given.items()}
        kind, member = request.match_info["kind"], request.match_info["member"]
        device = self._devices.get(kind)
        if device is None:
            return web.Response(status=404, text=f"there is no {kind} here")
        if isinstance(device, AlpacaTelescope):
            await device.way()
        self._transactions += 1
        self.requests[f"{request.method} {member}"] += 1
        client = int(fields.get("ClientTransactionID", "0"))
        body: dict[str, Any] = {
            "ClientTransactionID": client,
            "ServerTransactionID": self._transactions,
            "ErrorNumber": 0,
            "ErrorMessage": "",
        }
        try:
            if member in ("imagearray", "imagearrayvariant"):
                if "application/imagebytes" in request.headers.get("Accept", "") and self._camera is not None:
                    data = self._camera.image_bytes(client, self._transactions)
                    return web.Response(body=data, content_type="application/imagebytes")
                body |= {"Type": 2, "Rank": 2}
            value = self._do(device, request.method, member, fields)
            if request.method == "GET":
                body["Value"] = value
        except RefusedError as refused:
            body["ErrorNumber"], body["ErrorMessage"] = refused.number, refused.words
        except (KeyError, ValueError) as error:
            return web.Response(status=400, text=f"bad request: {error}")
        if isinstance(device, AlpacaTelescope):
            await device.way()
        return web.Response(body=msgspec.json.encode(body), content_type="application/json")

    def _do(
        self,
        device: AlpacaTelescope | SimulatedAlpacaCamera,
        method: str,
        member: str,
        fields: Mapping[str, str],
    ) -> Any:
        if not device.connected and member not in FREE:
            raise RefusedError(NOT_CONNECTED, f"The {device.kind} is not connected")
        if method != "PUT":
            return device.ask(member, fields, self.now())
        device.change(member, fields, self.now())
        if self._camera is device and member == "startexposure":
            self.start(self._expose(self._camera))
        return None

    def start(self, work: Coroutine[Any, Any, None]) -> None:
        """Do work beside the requests."""
        task = asyncio.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _expose(self, device: SimulatedAlpacaCamera) -> None:
        """Take the picture of the exposure that goes on, when it has ended."""
        begun = device.exposure
        while (exposure := device.exposure) is not None and begun is not None:
            if exposure.start_utc_s != begun.start_utc_s:
                return
            if (left_s := exposure.start_utc_s + exposure.seconds - self.now()) > 0.0:
                # It may be stopped or aborted meanwhile.
                await asyncio.sleep(min(LOOK_EVERY_S, left_s / self._clock.speed))
                continue
            device.deliver(exposure, *await self._picture(device.camera, exposure))

    async def _take_frames(self, camera: SkyCamera, config: CameraConfig, folder: Path) -> None:
        """Take a picture at each multiple of `every_s`, forever, and write it as FITS."""
        size = config.settings
        names = (one.stem[6:] for one in folder.glob("frame_??????.fits"))
        number = max((int(name) for name in names if name.isdigit()), default=0)
        while True:
            start_s = math.ceil(self.now() / config.every_s) * config.every_s
            end_s = start_s + config.exposure_s
            await asyncio.sleep((end_s - self.now()) / self._clock.speed)
            exposure = RunningExposure(start_s, config.exposure_s, 0, 1, 0, 0, size.width, size.height)
            frame, _ = await self._picture(camera, exposure)
            if frame is None:
                continue
            number += 1
            try:
                await asyncio.to_thread(camera.write, frame, folder / f"frame_{number:06d}.fits")
            except (OSError, SattrackError) as error:
                sys.stderr.write(f"sattrack: no more pictures are written to {folder}: {error}\n")
                return

    async def _picture(
        self, camera: SkyCamera, exposure: RunningExposure
    ) -> tuple[RenderedFrame | None, str | None]:
        """Return the picture of an exposure that has ended, or why there is none."""
        end_s = exposure.start_utc_s + exposure.seconds
        until_s = time.monotonic() + LATEST_PATH_S
        while self.path.until_s < end_s and time.monotonic() < until_s:
            await asyncio.sleep(LOOK_EVERY_S / 4.0)
        path = self.path.part(exposure.start_utc_s, end_s)
        try:
            frame = await asyncio.to_thread(
                camera.frame, exposure.start_utc_s, exposure.seconds, path, exposure.gain
            )
        except ValueError as error:
            return None, str(error)
        return frame, None

    async def _versions(self, _: web.Request) -> web.Response:
        return self._managed([1])

    async def _configured(self, _: web.Request) -> web.Response:
        return self._managed(
            [
                {
                    "DeviceName": device.name,
                    "DeviceType": kind.capitalize(),
                    "DeviceNumber": 0,
                    "UniqueID": device.unique_id,
                }
                for kind, device in self._devices.items()
            ]
        )

    def _managed(self, value: Any) -> web.Response:
        body = {"Value": value, "ClientTransactionID": 0, "ServerTransactionID": 0}
        return web.json_response({**body, "ErrorNumber": 0, "ErrorMessage": ""})

    async def _truth(self, request: web.Request) -> web.Response:
        since = float(request.query.get("since", "-inf"))
        return web.json_response([place for place in self._trail if place.utc_s > since])

    async def _state(self, _: web.Request) -> web.Response:
        assert self._telescope is not None
        telescope = self._telescope.telescope
        settings = {
            "tracking": telescope.tracks(),
            "parked": telescope.parked,
            "connected": telescope.connected,
        }
        moving = telescope.slewing(self.now())
        return web.json_response({**settings, "moving": moving, "requests": self.requests})

    async def _set(self, request: web.Request) -> web.Response:
        assert self._telescope is not None
        telescope = self._telescope.telescope
        fields = await request.post()
        if "parked" in fields:
            telescope.park(TRUE[str(fields["parked"]).lower()])
        if "connected" in fields:
            telescope.connected = TRUE[str(fields["connected"]).lower()]
        return web.json_response({})


async def serve(server: AlpacaServer, port: int, ready: Callable[[int], None]) -> None:
    """Serve on a port of loopback, 0 for any free one, until cancelled; `ready` hears which it is.

    Raises OSError where the port is in use.
    """
    runner = web.AppRunner(server.app(), access_log=None)
    await runner.setup()
    try:
        site = web.TCPSite(runner, "127.0.0.1", port)
        await site.start()
        ready(int(runner.addresses[0][1]))
        await asyncio.Event().wait()
    finally:
        await runner.cleanup()


class CameraConfig(msgspec.Struct, frozen=True):
    """Everything that makes the camera of a simulated mount that runs elsewhere.

    `elements` are the true orbits, as OMM in JSON; `begin_utc_s` is the mount's start, and `clock_offset_s`
    how far its clock was ahead of UTC then. With `frames`, a folder, the camera takes pictures by itself.
    """

    site: SimulatedSite
    elements: str
    settings: SimulatedCamera
    hidden: Hidden
    begin_utc_s: float
    clock_offset_s: float = 0.0
    seed: int = 0
    clock: ClockSetting | None = None
    port: int = 0
    frames: str | None = None
    exposure_s: float = 0.1
    every_s: float = 0.5


class CameraStarted(msgspec.Struct, frozen=True):
    """The first line of the camera's process: its port, or why it does not serve."""

    port: int = 0
    error: str = ""


def make_camera(config: CameraConfig, telescope: SimulatedTelescope | None = None) -> SimulatedAlpacaCamera:
    """Return the camera, of a telescope here or else of a mount elsewhere.

    Raises BadInputError where no stars are installed.
    """
    where, begin_s = config.site, config.begin_utc_s
    # numpy takes no negative seeds, as a mount does.
    seed = abs(config.seed)
    site = Site(where.latitude_deg, where.longitude_deg, where.height_m)
    satellites = [one for one in parse_elements(config.elements) if isinstance(one, Elements)]
    sky = make_sky(site, satellites, config.hidden, seed)
    camera = SkyCamera(sky, config.settings, config.hidden, begin_s, seed)
    if telescope is not None and telescope.settings.alignment == "altaz":
        camera = SkyCamera(sky, config.settings, config.hidden, begin_s, seed, alignment="altaz")
    if telescope is None:
        sidereal_deg = mean_sidereal_deg(begin_s + config.clock_offset_s, where.longitude_deg)
        camera.hour_angle_zero_deg = sky.hour_angle_zero_deg(sidereal_deg, begin_s)
    elif telescope.settings.alignment != "altaz":
        camera.hour_angle_zero_deg = sky.hour_angle_zero_deg(telescope.sidereal_h(begin_s) * 15.0, begin_s)
    return SimulatedAlpacaCamera(camera)


def telescope_server(settings: TelescopeSettings, config: CameraConfig | None) -> AlpacaServer:
    """Return a telescope's server, with a camera on it where one is configured.

    Raises BadInputError where no stars are installed.
    """
    telescope = AlpacaTelescope(settings)
    camera = None if config is None else make_camera(config, telescope.telescope)
    return AlpacaServer(SystemClock(), telescope, camera, config)


class _DiscoveryAnswers(asyncio.DatagramProtocol):
    """Answers Alpaca discovery with the port of HTTP."""

    def __init__(self, port: int) -> None:
        self._answer = msgspec.json.encode({"AlpacaPort": port})
        self._transport: Any = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """See asyncio.DatagramProtocol."""
        self._transport = transport

    def datagram_received(self, data: bytes, addr: tuple[str | Any, int]) -> None:
        """See asyncio.DatagramProtocol."""
        if data.startswith(DISCOVERY):
            self._transport.sendto(self._answer, addr)


async def _answer_discovery(port: int) -> None:
    """Answer discovery on loopback; where another program has its port, that one answers."""
    for address in ("127.0.0.1", "127.255.255.255"):
        one = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        one.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            one.bind((address, DISCOVERY_PORT))
        except OSError:
            one.close()
            return
        one.setblocking(False)
        await asyncio.get_running_loop().create_datagram_endpoint(lambda: _DiscoveryAnswers(port), sock=one)


async def _serve_camera(config: CameraConfig, camera: SimulatedAlpacaCamera) -> None:
    server = AlpacaServer(make_clock(config.clock), camera=camera, config=config)
    decoder = msgspec.json.Decoder(Truth)
    reader = LineReader(sys.stdin.fileno())
    ended = asyncio.Event()

    def hear() -> None:
        for truth in reader.messages(decoder):
            server.path.note(truth)
        if reader.ended:
            ended.set()

    loop = asyncio.get_running_loop()
    loop.add_reader(sys.stdin.fileno(), hear)

    def ready(port: int) -> None:
        server.start(_answer_discovery(port))
        os.write(sys.stdout.fileno(), msgspec.json.encode(CameraStarted(port)) + b"\n")

    work = [asyncio.create_task(serve(server, config.port, ready)), asyncio.create_task(ended.wait())]
    done, going = await asyncio.wait(work, return_when=asyncio.FIRST_COMPLETED)
    for task in going:
        task.cancel()
    for task in done:
        task.result()


def main() -> int:
    """Run the camera's process; returns its exit code."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    config = msgspec.json.decode(sys.argv[1], type=CameraConfig)
    try:
        asyncio.run(_serve_camera(config, make_camera(config)))
    except OSError as error:
        text = f"{error.filename or f'TCP port {config.port}'}: {error.strerror}"
    except SattrackError as error:
        text = str(error)
    else:
        return 0
    with contextlib.suppress(BrokenPipeError):
        os.write(sys.stdout.fileno(), msgspec.json.encode(CameraStarted(0, text)) + b"\n")
    return 1


if __name__ == "__main__":
    sys.exit(main())
