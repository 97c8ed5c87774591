"""Who is connected to a telescope's servers, and the line from there to the process that feeds the mount."""

from __future__ import annotations

import asyncio
import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, cast

from sattrack.mount.requests import Abort
from sattrack.runtime.callers import Seat
from sattrack.servers.alpaca.protocol import (
    Answered,
    Fault,
    LogMessage,
    Number,
    NumberedOrder,
    decode_report,
    encode,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from sattrack.runtime.callers import CallerLimits
    from sattrack.servers.alpaca.protocol import Order
    from sattrack.servers.alpaca.telescope import ServedTelescope

REQUEST_WITHIN_S = 10.0
"""A request that has begun must be there as a whole within this time."""
TEND_EVERY_S = 1.0
MOST_WAITING = 64
"""Orders that may wait for their end; a stop is never too many."""
ANSWER_WITHIN_S = 8.0
SLEW_WITHIN_S, ENDS_AFTER = 600.0, 1.1


@dataclass(slots=True)
class OpenConnections:
    """All open connections, by their transports; instants are the event loop's."""

    limits: CallerLimits
    by_transport: dict[asyncio.BaseTransport, ClientConnection] = field(default_factory=dict)
    refused: int = 0
    """Connections that were closed as they came."""
    cut: int = 0
    """Connections that were silent, or left a request unfinished, for too long."""

    def admits(self, address: str, now_s: float) -> bool:
        """Return whether an address may connect; connections that must make room for it are closed."""
        # A request whose answer is under way counts as new.
        seats = {
            line: one.seat._replace(asked_s=now_s) if one.at_work else one.seat
            for line, one in self.by_transport.items()
        }
        objection, idle = self.limits.admit(address, seats, now_s)
        for line in idle:
            self.cut += 1
            self.by_transport.pop(line).hang_up()
        return objection is None

    def tend(self, now_s: float) -> None:
        """Close those that have been silent, or have left a request unfinished, for too long."""
        for connection in list(self.by_transport.values()):
            if connection.overdue(now_s, self.limits.idle_s):
                self.cut += 1
                connection.hang_up()

    async def keep_tending(self) -> None:
        """Tend them for ever."""
        while True:
            await asyncio.sleep(TEND_EVERY_S)
            self.tend(asyncio.get_running_loop().time())


class ClientConnection(asyncio.Protocol):
    """One connection; `make_inner` makes the protocol that serves it, once it is admitted."""

    def __init__(self, connections: OpenConnections, make_inner: Callable[[], asyncio.Protocol]) -> None:
        self._connections, self._make_inner = connections, make_inner
        self._inner: asyncio.Protocol | None = None
        self._transport: asyncio.Transport | None = None
        self._loop = asyncio.get_running_loop()
        self._since_s = self._loop.time()
        """Since when nothing has come, or a request is unfinished."""
        self._unfinished = False
        self.seat = Seat("", -math.inf, self._since_s)
        self.at_work = 0
        """Number of whole requests that wait for an answer."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """See asyncio.Protocol."""
        peer = transport.get_extra_info("peername")
        if peer is None or not self._connections.admits(str(peer[0]), self._since_s):
            self._connections.refused += 1
            cast("asyncio.Transport", transport).abort()
            return
        self.seat = Seat(str(peer[0]), -math.inf, self._since_s)
        self._transport = cast("asyncio.Transport", transport)
        self._connections.by_transport[transport] = self
        self._inner = self._make_inner()
        self._inner.connection_made(transport)

    def data_received(self, data: bytes) -> None:
        """See asyncio.Protocol."""
        if self._inner is None:
            return
        if not self.at_work and not self._unfinished:
            self._unfinished, self._since_s = True, self._loop.time()
        self._inner.data_received(data)

    def eof_received(self) -> bool | None:
        """See asyncio.Protocol."""
        return None if self._inner is None else self._inner.eof_received()

    def pause_writing(self) -> None:
        """See asyncio.Protocol."""
        if self._inner is not None:
            self._inner.pause_writing()

    def resume_writing(self) -> None:
        """See asyncio.Protocol."""
        if self._inner is not None:
            self._inner.resume_writing()

    def connection_lost(self, exc: Exception | None) -> None:
        """See asyncio.Protocol."""
        if self._transport is not None:
            self._connections.by_transport.pop(self._transport, None)
        if self._inner is not None:
            self._inner.connection_lost(exc)

    def begins(self) -> None:
        """Note a whole request: until its answer nothing is overdue."""
        self._unfinished = False
        self.at_work += 1
        self.seat = self.seat._replace(asked_s=self._loop.time())

    def ends(self) -> None:
        """Note that its answer is on its way."""
        self.at_work -= 1
        self._since_s = self._loop.time()
        self.seat = self.seat._replace(asked_s=self._since_s)

    def lives(self) -> None:
        """Note that it takes what it is sent: it is not silent for too long, even if it asks for nothing."""
        self._since_s = self._loop.time()

    def overdue(self, now_s: float, idle_s: float) -> bool:
        """Return whether this connection must be ended."""
        longest_s = min(REQUEST_WITHIN_S, idle_s) if self._unfinished else idle_s
        return not self.at_work and now_s - self._since_s > longest_s

    def hang_up(self) -> None:
        """End the connection."""
        if self._transport is not None:
            self._transport.abort()


@dataclass(slots=True)
class FeederLine:
    """The line to the feeding process: orders go out, states and answers come in."""

    reader: asyncio.StreamReader
    writer: asyncio.StreamWriter
    telescope: ServedTelescope
    _count: int = 0
    _waiting: dict[int, asyncio.Future[Answered]] = field(default_factory=dict)

    async def listen(self) -> None:
        """Take states and answers until the feeding process is gone."""
        while line := await self.reader.readline():
            report = decode_report(line)
            if not isinstance(report, Answered):
                self.telescope.state = report
                continue
            waiting = self._waiting.get(report.number)
            if waiting is not None and not waiting.done():
                waiting.set_result(report)

    async def order(self, order: Order, waits: bool = False) -> None:
        """Send an order and wait for its answer; `waits`: until a slew ends. Raises Fault."""
        if len(self._waiting) >= MOST_WAITING and not isinstance(order, Abort):
            message = f"{len(self._waiting)} commands wait already: too many at once"
            raise Fault(Number.INVALID_OPERATION, message)
        self._count += 1
        number = self._count
        waiting = self._waiting[number] = asyncio.get_running_loop().create_future()
        try:
            self.writer.write(encode(NumberedOrder(number, order, waits)))
            async with asyncio.timeout(self._ends_within_s if waits else ANSWER_WITHIN_S):
                answer = await waiting
        except TimeoutError:
            raise Fault(Number.DRIVER, "the mount gave no answer in time") from None
        finally:
            del self._waiting[number]
        if answer.fault:
            raise Fault(Number(answer.fault), answer.message)

    @property
    def _ends_within_s(self) -> float:
        """How long a slew may take: as long as the feeding process gives it, which then says how it ended."""
        profile = self.telescope.device.profile
        goes_within_s = profile.goes_within_s(by_rates=profile.geometry is not None)
        return max(SLEW_WITHIN_S, ENDS_AFTER * goes_within_s)

    def log(self, text: str) -> None:
        """Log a line."""
        self.writer.write(encode(LogMessage(text)))
