"""The gateway's process: the session's datagrams on one side, an Alpaca telescope on the other.

Its argument is a `GatewayConfig` as JSON. One descriptor is a channel to whoever started it: the first
message is `GatewayReady`, or `GatewayRefusal` with the reason; later ones are `GatewayNews` of the telescope.
The end of that channel is the end of the session. Then the gateway stays for as long as a guardian sends, or
the telescope moves.

It has real-time priority, since it dates what it reads. Its warden, a process of its own, stops the telescope
where the gateway is gone or hangs.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
import os
import signal
import socket
import subprocess
import sys
import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol, Self

import aiohttp
import msgspec

from sattrack.core.channel import Channel, start_process
from sattrack.core.clock import Clock, SystemClock
from sattrack.core.errors import SattrackError
from sattrack.core.process import signals_here
from sattrack.core.realtime import go_before_others
from sattrack.mount.alpaca.bridge import Bridge
from sattrack.mount.alpaca.client import (
    ANSWER_WITHIN_S,
    MOST_BYTES,
    NOT_CONNECTED,
    AlpacaRefusalError,
    NoAnswerError,
    broken,
    path_of,
    value_in,
    with_ids,
)
from sattrack.mount.alpaca.device import (
    GERMAN,
    PIER_EAST,
    PIER_WEST,
    DeviceFacts,
    Reading,
    SkyPlace,
    spans_of,
)
from sattrack.mount.alpaca.link import BYE, GatewayConfig, GatewayNews, GatewayReady, GatewayRefusal

if TYPE_CHECKING:
    from sattrack.mount.alpaca.bridge import Lane, Order
    from sattrack.mount.alpaca.link import AlpacaAddress

MOST_WARDENS = 3
END_WITHIN_S = 2.0
MOVING, RESTING, FAREWELL = b"m", b"r", b"b"
IGNORED = signals_here("SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT", "SIGPIPE")
CONNECTED_WITHIN_S = 10.0
LOOK_AGAIN_S = 0.2
BEHIND_AT_MOST_S = 0.5
LEAVE_AFTER_S = 2.5
"""How long after the end of the session, and in silence, the gateway stays: a guardian speaks sooner."""
LEAVE_AT_LAST_S = 90.0
"""How long it stays at most: longer than a guardian tries to stop a mount."""
TRY_AGAIN_S = 0.2
FAREWELL_AT_LAST_S = 3.0
"""How long it stays after a session that has given the stop up itself; the warden goes on then."""
QUEUED_AT_MOST = 32
SLOW_MEMBERS = (
    "slewing",
    "siderealtime",
    "slewing",
    "tracking",
    "slewing",
    "sideofpier",
    "slewing",
    "atpark",
    "slewing",
    "ispulseguiding",
)
"""Asked in turn, one a turn, where one request does not tell the whole state."""
STATE_NEEDS = ("rightascension", "declination", "slewing")
"""What a DeviceState must tell to be used: drivers may leave values out, and some leave out all."""


@dataclass(slots=True)
class AlpacaClient:
    """One telescope, asked for several things at once; to be used as an asynchronous context.

    aiohttp and not alpyca: requests for both axes go out together on connections that stay open, so that the
    middle of a request is when the telescope was asked. alpyca waits for each and opens a connection for
    every request, whose handshake is then half of what is measured.
    """

    address: AlpacaAddress
    _session: aiohttp.ClientSession = field(init=False)
    _transaction: int = 0
    _has_state: bool = False
    """Whether one request tells the whole state."""
    _flips: bool = False
    """Whether the side of its pier goes with each place: late by a turn, a place is on the wrong side."""
    _turns: int = 0

    async def __aenter__(self) -> Self:
        """Open."""
        timeout = aiohttp.ClientTimeout(total=ANSWER_WITHIN_S)
        connector = aiohttp.TCPConnector(limit=8, keepalive_timeout=60.0)
        self._session = aiohttp.ClientSession(timeout=timeout, connector=connector)
        return self

    async def __aexit__(self, *_: object) -> None:
        """Close."""
        await self._session.close()

    async def get(self, member: str, **fields: str) -> Any:
        """Return a member's value. Raises Refusal, Unheard."""
        return await self._ask("GET", member, fields)

    async def put(self, member: str, *fields: tuple[str, str]) -> None:
        """Set a member, or call it. Raises Refusal, Unheard."""
        await self._ask("PUT", member, dict(fields))

    async def _ask(self, method: str, member: str, fields: dict[str, str]) -> Any:
        self._transaction += 1
        given = with_ids(fields, self._transaction)
        path = path_of("telescope", int(self.address.device), member)
        where: dict[str, Any] = {"params": given} if method == "GET" else {"data": given}
        try:
            async with self._session.request(
                method, f"http://{self.address.server}{path}", **where
            ) as response:
                body = await _body(response)
        except TimeoutError as error:
            raise NoAnswerError(f"it did not answer within {ANSWER_WITHIN_S:g} s") from error
        except aiohttp.ClientConnectorError as error:
            raise NoAnswerError(broken(error.os_error)) from error
        except (aiohttp.ClientError, OSError) as error:
            raise NoAnswerError(broken(error)) from error
        return value_in(member, response.status, body)

    async def connect(self) -> None:
        """Connect the server to its telescope, where it is not connected. Raises Refusal, Unheard."""
        if await self.get("connected") is True:
            return
        await self.put("connected", ("Connected", "true"))
        until_s = time.monotonic() + CONNECTED_WITHIN_S
        while await self.get("connected") is not True:
            if time.monotonic() > until_s:
                raise NoAnswerError(
                    f"its driver did not connect to the telescope within {CONNECTED_WITHIN_S:g} s"
                )
            await asyncio.sleep(LOOK_AGAIN_S)

    async def facts(self) -> DeviceFacts:
        """Return what the telescope can do. Raises Refusal where it cannot say, Unheard."""
        version = int(await self._number("interfaceversion") or 3)
        alignment = await self._perhaps("alignmentmode", None)
        rates = []
        for axis in ("0", "1"):
            can = await self._perhaps("canmoveaxis", False, Axis=axis)
            rates.append(spans_of(await self._perhaps("axisrates", [], Axis=axis)) if can else ())
        latitude, longitude = [await self._number(m) for m in ("sitelatitude", "sitelongitude")]
        system = await self._number("equatorialsystem")
        can_pulse_guide = bool(await self._perhaps("canpulseguide", False))
        state = _by_name(await self._perhaps("devicestate", None)) if version >= 4 else {}
        self._has_state = all(state.get(name) is not None for name in STATE_NEEDS)
        side = await self._perhaps("sideofpier", None) if alignment is None else None
        self._flips = alignment == GERMAN or side in (PIER_EAST, PIER_WEST)
        return DeviceFacts(
            name=str(await self._perhaps("name", "telescope"))[:80],
            interface_version=version,
            equatorial_system=1 if system is None else int(system),
            alignment_mode=alignment if type(alignment) is int else None,
            does_refraction=bool(await self._perhaps("doesrefraction", False)),
            latitude_deg=latitude,
            longitude_deg=longitude,
            height_m=await self._number("siteelevation") or 0.0,
            can_set_tracking=bool(await self._perhaps("cansettracking", False)),
            can_slew=bool(await self._perhaps("canslewasync", False)),
            can_sync=bool(await self._perhaps("cansync", False)),
            can_pulse_guide=can_pulse_guide,
            guide_rates_deg_s=await self._guide_rates() if can_pulse_guide else None,
            has_device_state=self._has_state,
            primary_rates=rates[0],
            secondary_rates=rates[1],
        )

    async def read(self) -> Reading:
        """Return where the telescope is, and how it stands, as far as that is asked at once.

        Raises AlpacaRefusalError, NoAnswerError.
        """
        begun_s = time.monotonic()
        if self._has_state:
            at_s, state, took_s = await self._timed("devicestate")
            values = _by_name(state)
            ra, dec = (at_s, values.get("rightascension")), (at_s, values.get("declination"))
            return Reading(begun_s, values, ra, dec, took_s)
        members = {SLOW_MEMBERS[self._turns % len(SLOW_MEMBERS)], *(("sideofpier",) if self._flips else ())}
        self._turns += 1
        ((ra_s, ra_h, ra_took_s), (dec_s, dec_deg, dec_took_s)), values = await asyncio.gather(
            asyncio.gather(self._timed("rightascension"), self._timed("declination")),
            asyncio.gather(*(self._named(member) for member in members)),
        )
        took_s = max(ra_took_s, dec_took_s)
        return Reading(begun_s, dict(values), (ra_s, ra_h), (dec_s, dec_deg), took_s)

    async def _timed(self, member: str) -> tuple[float, Any, float]:
        """Return the middle of a request, by the monotonic clock, what was answered, and how long it took."""
        begun_s = time.monotonic()
        value = await self.get(member)
        ended_s = time.monotonic()
        return 0.5 * (begun_s + ended_s), value, ended_s - begun_s

    async def _named(self, member: str) -> tuple[str, Any]:
        """Return a member's name and its value, None where the driver refuses it."""
        try:
            return member, await self.get(member)
        except AlpacaRefusalError:
            return member, None

    async def _guide_rates(self) -> tuple[float, float] | None:
        """Return the guide rates in right ascension and declination, degrees a second; None for none."""
        answers = [
            await self._perhaps(f"guiderate{axis}", None) for axis in ("rightascension", "declination")
        ]
        numbers = [float(one) for one in answers if isinstance(one, int | float)]
        return (numbers[0], numbers[1]) if len(numbers) == len(answers) else None

    async def _number(self, member: str) -> float | None:
        """Return a member's value; None where the driver has none to give, or none that is a number."""
        value = await self._perhaps(member, None)
        numeric = isinstance(value, int | float) and math.isfinite(value)
        return float(value) if numeric else None

    async def _perhaps(self, member: str, otherwise: Any, **fields: str) -> Any:
        """Return a member's value, or something else where the driver has none to give."""
        try:
            return await self.get(member, **fields)
        except AlpacaRefusalError:
            return otherwise
        except NoAnswerError as error:
            if error.status is None or error.status >= 500:
                raise
            return otherwise


def _by_name(state: Any) -> dict[str, Any]:
    """Return the values of a DeviceState by the members' names in lower case."""
    parts = [one for one in state if isinstance(one, dict)] if isinstance(state, list) else []
    return {str(one.get("Name", "")).lower(): one.get("Value") for one in parts}


async def _body(response: aiohttp.ClientResponse) -> bytes:
    """Return the body of an answer, which may come in pieces; of a long one MOST_BYTES and little more."""
    body = b""
    while len(body) < MOST_BYTES and (piece := await response.content.readany()):
        body += piece
    return body


class TelescopeClient(Protocol):
    """One telescope at the other end, in Alpaca's terms; an asynchronous context."""

    async def __aenter__(self) -> Self:
        """Open."""

    async def __aexit__(self, *_: object) -> None:
        """Close."""

    async def connect(self) -> None:
        """Connect to the telescope. Raises AlpacaRefusalError, NoAnswerError."""

    async def facts(self) -> DeviceFacts:
        """Return what it can do. Raises AlpacaRefusalError, NoAnswerError."""

    async def put(self, member: str, *fields: tuple[str, str]) -> None:
        """Carry out an order. Raises AlpacaRefusalError, NoAnswerError."""

    async def read(self) -> Reading:
        """Return where it is. Raises AlpacaRefusalError, NoAnswerError."""


@dataclass(slots=True)
class Watched:
    """A warden at work; where it dies, another takes its place, MOST_WARDENS in all."""

    address: AlpacaAddress
    _process: subprocess.Popen[bytes] | None = None
    _channel: socket.socket | None = None
    _started: int = 0
    _said: bytes = field(default=RESTING)

    def __post_init__(self) -> None:
        """Start it."""
        self._start()

    @property
    def alive(self) -> bool:
        """Whether somebody watches."""
        return self._channel is not None

    def beat(self, in_force: bool) -> None:
        """Send a heartbeat: whether something from here may have the telescope moving."""
        word = MOVING if in_force else RESTING
        if word == RESTING and self._said == RESTING and self._channel is not None:
            return
        self._said = word
        self._say(word)

    def let_go(self) -> None:
        """End the watch: the telescope is at rest, or never moved."""
        self._say(FAREWELL)
        if self._channel is not None:
            self._channel.close()
        if self._process is not None:
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(END_WITHIN_S)

    def _say(self, word: bytes) -> None:
        if self._channel is None:
            return
        try:
            self._channel.send(word)
        except BlockingIOError:
            return
        except OSError:
            self._channel.close()
            self._channel = None
            self._start()

    def _start(self) -> None:
        if self._process is not None:
            self._process.poll()
        if self._started >= MOST_WARDENS:
            return
        self._started += 1
        ours, theirs = socket.socketpair()
        with theirs:
            self._process = start_process(
                "sattrack.mount.alpaca.warden",
                *(str(theirs.fileno()), str(os.getpid())),
                *(self.address.scheme, self.address.host, str(self.address.port), str(self.address.device)),
                inherits=(theirs.fileno(),),
            )
        ours.setblocking(False)
        self._channel = ours


@dataclass(slots=True)
class OrderQueue:
    """One lane of orders, one after the other; on an axis' lane only the newest that waits counts."""

    lane: Lane
    client: TelescopeClient
    bridge: Bridge
    waiting: list[Order] = field(default_factory=list)
    _come: asyncio.Event = field(default_factory=asyncio.Event)

    def put(self, order: Order) -> None:
        """Take an order."""
        if self.lane != "rest":
            self.waiting.clear()
        elif order.member == "abortslew":
            # Nothing that was asked before a stop is worth asking after it.
            self.waiting = [one for one in self.waiting if one.member == "tracking"]
        if len(self.waiting) < QUEUED_AT_MOST:
            self.waiting.append(order)
        self._come.set()

    async def run(self) -> None:
        """Work forever."""
        while True:
            await self._come.wait()
            self._come.clear()
            while self.waiting:
                order = self.waiting.pop(0)
                refusal = None
                try:
                    await self.client.put(order.member, *order.fields)
                except (AlpacaRefusalError, NoAnswerError) as error:
                    refusal = str(error)
                self.bridge.answered(order, refusal, time.monotonic())


class _Mailbox(asyncio.DatagramProtocol):
    """Hands the session's datagrams to the bridge."""

    def __init__(self, gateway: Gateway) -> None:
        self._gateway = gateway

    def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
        """Take one."""
        # Whoever else sends here is neither the session nor its guardian, which has the session's socket.
        if addr == ("127.0.0.1", self._gateway.config.peer_port):
            self._gateway.heard(data)


@dataclass(slots=True)
class Gateway:
    """One session and one telescope, from the first turn to the end of both."""

    config: GatewayConfig
    client: TelescopeClient
    facts: DeviceFacts
    channel: Channel
    watched: Watched
    clock: Clock = field(default_factory=SystemClock)
    bridge: Bridge = field(init=False)
    _workers: dict[str, OrderQueue] = field(init=False)
    _transport: asyncio.DatagramTransport | None = None
    _heard_s: float = field(default_factory=time.monotonic)
    _left_s: float | None = None
    """When the session ended."""
    _bade_farewell: bool = False
    _reported: str | None = None
    _silence: str | None = None
    """Why the telescope does not answer; None while it does."""
    _try_again_s: float = 0.0

    def __post_init__(self) -> None:
        """Build the bridge."""
        longitude_deg = self.config.address.longitude_deg
        if longitude_deg is None:
            longitude_deg = self.facts.longitude_deg or 0.0
        self.bridge = Bridge(self.facts, longitude_deg, self.config.address.latitude_deg)
        lanes: tuple[Lane, ...] = ("ra", "dec", "rest")
        self._workers = {lane: OrderQueue(lane, self.client, self.bridge) for lane in lanes}

    def heard(self, data: bytes) -> None:
        """Take a datagram of the session, or of its guardian."""
        self._heard_s = time.monotonic()
        self.bridge.hear(data, self._heard_s)

    async def run(self) -> None:
        """Stand between until nobody needs it."""
        loop = asyncio.get_running_loop()
        with contextlib.suppress(NoAnswerError, AlpacaRefusalError):
            # One that does not report its place can be stopped all the same.
            await self._read_place()
        self._transport, _ = await loop.create_datagram_endpoint(
            lambda: _Mailbox(self), local_addr=("127.0.0.1", 0)
        )
        port = int(self._transport.get_extra_info("sockname")[1])
        self._say(GatewayReady(port, self.facts))
        loop.add_reader(self.channel.fileno(), self._hear_channel)
        working = [asyncio.create_task(worker.run()) for worker in self._workers.values()]
        reading: asyncio.Task[None] | None = None
        period_s = 1.0 / self.config.address.hz
        due_s = time.monotonic()
        while not self._over():
            await asyncio.sleep(due_s - time.monotonic())
            now_s = time.monotonic()
            for order in self.bridge.turn(now_s):
                self._workers[order.lane].put(order)
            self.watched.beat(self.bridge.in_force)
            if (reading is None or reading.done()) and now_s >= self._try_again_s:
                reading = asyncio.create_task(self._read())
            self._tell_news()
            due_s = max(due_s + period_s, now_s - BEHIND_AT_MOST_S)
        for task in (*working, *([] if reading is None else [reading])):
            task.cancel()
        self._transport.close()
        if not self.bridge.in_force:
            # Else it is the warden's.
            self.watched.let_go()

    def _over(self) -> bool:
        if self._left_s is None:
            return False
        now_s = time.monotonic()
        if now_s - self._left_s > (FAREWELL_AT_LAST_S if self._bade_farewell else LEAVE_AT_LAST_S):
            return True
        quiet = now_s - max(self._heard_s, self._left_s) > LEAVE_AFTER_S
        return (self._bade_farewell or quiet) and not self.bridge.in_force

    def _hear_channel(self) -> None:
        self._bade_farewell |= BYE.strip() in self.channel.lines()
        if self.channel.ended or self._bade_farewell:
            self._left_s = time.monotonic()
            asyncio.get_running_loop().remove_reader(self.channel.fileno())

    def _tell_news(self) -> None:
        self.channel.flush()
        words = self._silence or self.bridge.words or self.bridge.doubt
        if words != self._reported:
            self._reported = words
            self._say(GatewayNews(words))

    def _say(self, what: GatewayReady | GatewayNews) -> None:
        self.channel.send(msgspec.json.encode(what) + b"\n")

    async def _read(self) -> None:
        """Read the place once, and send the status that comes of it."""
        try:
            place = await self._read_place()
        except (NoAnswerError, AlpacaRefusalError) as error:
            self._silence = f"the telescope does not report where it is: {error}"
            self._try_again_s = time.monotonic() + TRY_AGAIN_S
            if isinstance(error, AlpacaRefusalError) and error.number == NOT_CONNECTED:
                await self._connect_again()
            return
        self._silence = None
        status = self.bridge.see(place)
        if status is not None and self._transport is not None:
            self._transport.sendto(status, ("127.0.0.1", self.config.peer_port))

    async def _connect_again(self) -> None:
        """Connect to a telescope that was disconnected: who moves it must be able to stop it."""
        with contextlib.suppress(NoAnswerError, AlpacaRefusalError):
            await self.client.connect()

    async def _read_place(self) -> SkyPlace:
        reading = await self.client.read()
        self.bridge.stand(self.bridge.standing.with_values(reading.asked_s, reading.values))
        self.bridge.see_clock(reading.values.get("siderealtime"), self.clock.utc_s(reading.asked_s))
        return self._place(reading.ra, reading.dec, reading.took_s)

    def _place(self, ra: tuple[float, Any], dec: tuple[float, Any], took_s: float) -> SkyPlace:
        (ra_s, ra_h), (dec_s, dec_deg) = ra, dec
        numbers = isinstance(ra_h, float | int) and isinstance(dec_deg, float | int)
        if not (numbers and 0.0 <= ra_h <= 24.0 and -90.0 <= dec_deg <= 90.0):
            raise NoAnswerError(f"{ra_h!r} h, {dec_deg!r}° is no direction")
        ra_utc_s, dec_utc_s = self.clock.utc_s(ra_s), self.clock.utc_s(dec_s)
        return SkyPlace(ra_utc_s, ra_h * 15.0 % 360.0, dec_utc_s, float(dec_deg), took_s)


def client_of(address: AlpacaAddress) -> TelescopeClient:
    """Return who talks to the telescope at an address."""
    if address.scheme == "indi":
        from sattrack.mount.indi.client import IndiClient

        return IndiClient(address)
    return AlpacaClient(address)


async def run(config: GatewayConfig, channel: Channel) -> None:
    """Find the telescope and stand between. Raises SattrackError where it cannot be driven."""
    async with client_of(config.address) as client:
        try:
            await client.connect()
            facts = await client.facts()
        except NoAnswerError as error:
            raise SattrackError(f"{config.address}: {error}; {config.address.silence_advice}") from error
        except AlpacaRefusalError as error:
            raise SattrackError(f"{config.address}: {error}") from error
        facts = msgspec.structs.replace(facts, axes_known=config.address.axes_known)
        objection = facts.objection(config.address.stops_only)
        if objection is not None:
            raise SattrackError(f"{config.address}: {objection}")
        watched = Watched(config.address)
        await Gateway(config, client, facts, channel, watched).run()


def main() -> int:
    """Run the process; returns its exit code."""
    for number in IGNORED:
        signal.signal(number, signal.SIG_IGN)
    config = msgspec.json.decode(sys.argv[1], type=GatewayConfig)
    channel = Channel(config.channel)
    try:
        asyncio.run(run(config, channel))
    except SattrackError as error:
        link = isinstance(error.__cause__, NoAnswerError)
        channel.send(msgspec.json.encode(GatewayRefusal(str(error), link)) + b"\n")
        return 1
    return 0


if __name__ == "__main__":
    go_before_others()
    sys.exit(main())
