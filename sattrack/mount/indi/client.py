"""An INDI telescope over TCP: for the gateway, and for its warden, which waits for each answer.

Drivers tell where the telescope is when they have asked it and it has moved, so places are dated by their
arrival; one that stays where it is, is asked for.
"""

from __future__ import annotations

import asyncio
import contextlib
import functools
import select
import socket
import struct
import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Self

from sattrack.mount.alpaca.client import ANSWER_WITHIN_S, AlpacaRefusalError, NoAnswerError, broken
from sattrack.mount.alpaca.device import MEMBERS, Reading
from sattrack.mount.indi.telescope import (
    CONNECTION,
    PLACE,
    POLLING,
    IndiTelescope,
    Property,
    Setting,
)

if TYPE_CHECKING:
    from sattrack.mount.alpaca.device import DeviceFacts
    from sattrack.mount.alpaca.link import AlpacaAddress

FOUND_WITHIN_S = 10.0
SETTLED_WITHIN_S = 1.0
"""How long definitions may come after the first ones that matter."""
QUIET_PERIODS = 1.5
"""After so many periods without a place, the driver is asked for it."""
REFUSED_WITHIN_S = 0.3
"""A setting that the driver has not answered by then is taken for accepted."""
READ_BYTES = 65536
NOTHING_LATER = struct.pack("ii", 1, 0)
"""SO_LINGER for a connection that is given up: what it holds is not sent, as rates must not follow a stop."""
ALERT, REFUSED = "Alert", 0x500


@dataclass(slots=True)
class IndiClient:
    """One telescope, as `AlpacaClient`; to be used as an asynchronous context."""

    address: AlpacaAddress
    telescope: IndiTelescope = field(init=False)
    _writer: asyncio.StreamWriter | None = None
    _listening: asyncio.Task[None] | None = None
    _news: asyncio.Condition = field(default_factory=asyncio.Condition)
    _placed_s: float = 0.0
    """When the last place came, and the last one that was read."""
    _read_s: float = 0.0
    _heard_s: float = 0.0
    """When anything came last."""
    _lost: str | None = None

    def __post_init__(self) -> None:
        """Know nothing yet."""
        self.telescope = IndiTelescope(str(self.address.device))

    async def __aenter__(self) -> Self:
        """Open."""
        return self

    async def __aexit__(self, *_: object) -> None:
        """Close."""
        if self._listening is not None:
            self._listening.cancel()
        if self._writer is not None:
            self._writer.close()

    async def connect(self) -> None:
        """Connect to the server, and its driver to the telescope. Raises NoAnswerError."""
        if self._listening is None or self._listening.done():
            await self._open()
        begun_s = time.monotonic()
        try:
            await self._connect_driver()
        except NoAnswerError as error:
            self._hang_up(begun_s, str(error))
            raise

    async def _connect_driver(self) -> None:
        telescope = self.telescope
        if not await self._until(lambda: telescope.connected is not None, FOUND_WITHIN_S):
            there = f"; the server has {', '.join(sorted(telescope.others))}" if telescope.others else ""
            raise NoAnswerError(f"no device {telescope.device!r} there{there}")
        if telescope.connected is False:
            await self._send(Setting("Switch", CONNECTION, {"CONNECT": "On"}))
        if not await self._until(lambda: telescope.ready, FOUND_WITHIN_S):
            raise NoAnswerError(
                f"{telescope.device} is no telescope, or does not connect: {telescope.message}"
            )
        await self._until(lambda: False, SETTLED_WITHIN_S)
        if POLLING in telescope.properties:
            await self._ask_to_look()

    async def _ask_to_look(self) -> None:
        period = {"PERIOD_MS": f"{1000.0 / self.address.hz:.0f}"}
        try:
            await self._send(Setting("Number", POLLING, period))
        except AlpacaRefusalError as refusal:
            # A place that it repeats between its looks would show a rest that is none; but it can be stopped.
            if not self.address.stops_only:
                words = (
                    f"{refusal.words}: it does not look {self.address.hz:g} times a second; give a lower ?hz="
                )
                raise AlpacaRefusalError(REFUSED, words) from refusal

    async def facts(self) -> DeviceFacts:
        """Return what the telescope can do."""
        return self.telescope.facts()

    async def put(self, member: str, *fields: tuple[str, str]) -> None:
        """Carry out an order. Raises AlpacaRefusalError, NoAnswerError."""
        await self._send(*self.telescope.settings(member, dict(fields)))

    async def read(self) -> Reading:
        """Return the next place, dated by its arrival, and how the telescope stands.

        Connects again first where that is lost: who moves it must be able to stop it. Raises
        AlpacaRefusalError, NoAnswerError.
        """
        if self._lost is not None or not self.telescope.connected:
            await self.connect()
        begun_s = time.monotonic()
        came = await self._until(self._has_new_place, QUIET_PERIODS / self.address.hz)
        if not came and self._writer is not None:
            self._writer.write(self.telescope.question(PLACE))
            came = await self._until(self._has_new_place, ANSWER_WITHIN_S)
        if not came:
            self._hang_up(begun_s, f"nothing came within {ANSWER_WITHIN_S:g} s")
            raise NoAnswerError(self._lost or f"no place came within {ANSWER_WITHIN_S:g} s")
        self._read_s = self._placed_s
        values = {member: self.telescope.value(member) for member in MEMBERS.values() if member != "athome"}
        ra_h, dec_deg = self.telescope.value("rightascension"), self.telescope.value("declination")
        return Reading(self._placed_s, values, (self._placed_s, ra_h), (self._placed_s, dec_deg), 0.0)

    def _has_new_place(self) -> bool:
        return self._placed_s > self._read_s

    def _hang_up(self, since_s: float, words: str) -> None:
        """Give up a connection on which nothing has come since then: TCP itself waits for minutes."""
        if self._heard_s > since_s or self._lost is not None:
            return
        assert self._writer is not None
        assert self._listening is not None
        self._lost = words
        self._listening.cancel()
        self._listening = None
        self._writer.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, NOTHING_LATER)
        self._writer.transport.abort()

    async def _open(self) -> None:
        where = self.address.host, self.address.port
        if self._writer is not None:
            self._writer.close()
        try:
            async with asyncio.timeout(ANSWER_WITHIN_S):
                reader, self._writer = await asyncio.open_connection(*where)
        except TimeoutError as error:
            raise NoAnswerError(f"it did not answer within {ANSWER_WITHIN_S:g} s") from error
        except OSError as error:
            raise NoAnswerError(broken(error)) from error
        self._lost, self.telescope = None, self.telescope.anew()
        self._writer.write(self.telescope.greeting())
        self._listening = asyncio.ensure_future(self._listen(reader))

    async def _listen(self, reader: asyncio.StreamReader) -> None:
        try:
            while data := await reader.read(READ_BYTES):
                now_s, before = time.monotonic(), self.telescope.places
                self._heard_s = now_s
                self.telescope.feed(data)
                if self.telescope.places != before:
                    self._placed_s = now_s
                await self._notify()
            self._lost = "the INDI server has closed the connection"
        except (NoAnswerError, OSError) as error:
            self._lost = str(error)
        await self._notify()

    async def _notify(self) -> None:
        async with self._news:
            self._news.notify_all()

    async def _until(self, holds: Any, within_s: float) -> bool:
        """Wait until something holds; return whether it does."""
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(within_s), self._news:
                await self._news.wait_for(lambda: holds() or self._lost is not None)
        return bool(holds())

    async def _send(self, *settings: Setting) -> None:
        """Set properties, all before anything else is sent: rates of both axes go together."""
        if self._writer is None or self._lost is not None:
            raise NoAnswerError(self._lost or "not connected")
        known = [(one.name, self.telescope.properties[one.name]) for one in settings]
        updates = [one.updates for _, one in known]
        for setting in settings:
            self._writer.write(self.telescope.message_of(setting))
        for (name, one), before in zip(known, updates, strict=True):
            answered = functools.partial(_answered, one, before)
            if await self._until(answered, REFUSED_WITHIN_S) and one.state == ALERT:
                raise AlpacaRefusalError(REFUSED, f"{name}: {self.telescope.message or 'Alert'}")


def _answered(known: Property, before: int) -> bool:
    return known.updates > before


class IndiDevice:
    """One telescope, asked one thing at a time, as `AlpacaDevice`."""

    def __init__(self, host: str, port: int, device: str, within_s: float) -> None:
        self._where, self._within_s = (host, port), within_s
        self._telescope = IndiTelescope(device)
        self._line: socket.socket | None = None

    def get(self, member: str) -> Any:
        """Return a member's value; where it is a place, the next one. Raises as `AlpacaDevice`."""
        self._connect()
        if member == "rightascension":
            places = self._telescope.places
            self._send(self._telescope.question(PLACE))
            self._until(lambda: self._telescope.places > places, hangs_up=True)
        return self._telescope.value(member)

    def put(self, member: str, **fields: str) -> None:
        """Carry out an order. Raises as `AlpacaDevice`."""
        self._connect()
        for setting in self._telescope.settings(member, fields):
            self._send(self._telescope.message_of(setting))

    def _send(self, message: bytes) -> None:
        assert self._line is not None
        try:
            self._line.sendall(message)
        except OSError as error:
            self._close()
            raise NoAnswerError(broken(error)) from error

    def _connect(self) -> None:
        if self._line is not None:
            return
        try:
            self._line = socket.create_connection(self._where, self._within_s)
        except OSError as error:
            raise NoAnswerError(broken(error)) from error
        self._telescope = IndiTelescope(self._telescope.device)
        self._send(self._telescope.greeting())
        self._until(lambda: self._telescope.ready)
        # Definitions come one after another.
        with contextlib.suppress(NoAnswerError):
            self._until(lambda: False)

    def _until(self, holds: Any, hangs_up: bool = False) -> None:
        """Read until something holds. Raises NoAnswerError where that takes too long.

        One that `hangs_up` gives up a connection on which nothing comes meanwhile: TCP waits for minutes.
        """
        assert self._line is not None
        until_s = time.monotonic() + self._within_s
        while not holds():
            left_s = until_s - time.monotonic()
            if left_s <= 0.0 or not select.select([self._line], [], [], left_s)[0]:
                if hangs_up:
                    self._line.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, NOTHING_LATER)
                    self._close()
                raise NoAnswerError(f"nothing came within {self._within_s:g} s")
            try:
                data = self._line.recv(READ_BYTES)
            except OSError as error:
                self._close()
                raise NoAnswerError(broken(error)) from error
            if not data:
                self._close()
                raise NoAnswerError("the INDI server has closed the connection")
            self._telescope.feed(data)
            hangs_up = False

    def _close(self) -> None:
        if self._line is not None:
            self._line.close()
            self._line = None
