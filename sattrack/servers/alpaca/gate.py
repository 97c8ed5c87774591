"""Who may connect to the HTTP server, how many at once, and for how long without a whole request.

A gate stands between a connection and the protocol that serves it: who may not come in never gets as far.
"""

from __future__ import annotations

import asyncio
import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, cast

from sattrack.servers.callers import Seat

if TYPE_CHECKING:
    from collections.abc import Callable

    from sattrack.servers.callers import CallerLimits

REQUEST_WITHIN_S = 10.0
"""A request that has begun must be there as a whole within this time."""


@dataclass(slots=True)
class Doorkeeper:
    """All connections that are open, by their transports; instants are the event loop's."""

    limits: CallerLimits
    gates: dict[asyncio.BaseTransport, Gate] = field(default_factory=dict)
    refused: int = 0
    """Connections that were hung up on as they came."""
    cut: int = 0
    """Connections that were silent, or halting, too long."""

    def admits(self, address: str, now_s: float) -> bool:
        """Tell whether an address may come in; whoever must make room for it is hung up on."""
        # Whose answer is under way asks for something now.
        seats = {
            line: gate.seat._replace(asked_s=now_s) if gate.at_work else gate.seat
            for line, gate in self.gates.items()
        }
        objection, idle = self.limits.admit(address, seats, now_s)
        for line in idle:
            self.cut += 1
            self.gates.pop(line).hang_up()
        return objection is None

    def tend(self, now_s: float) -> None:
        """Hang up on those who have been silent, or have left a request unfinished, for too long."""
        for gate in list(self.gates.values()):
            if gate.overdue(now_s, self.limits.idle_s):
                self.cut += 1
                gate.hang_up()


class Gate(asyncio.Protocol):
    """One connection's gate; `make_inner` makes what serves it, once it is let in."""

    def __init__(self, keeper: Doorkeeper, make_inner: Callable[[], asyncio.Protocol]) -> None:
        self._keeper, self._make_inner = keeper, make_inner
        self._inner: asyncio.Protocol | None = None
        self._transport: asyncio.Transport | None = None
        self._loop = asyncio.get_running_loop()
        self._since_s = self._loop.time()
        """Since when nothing has happened, or a request is unfinished."""
        self._unfinished = False
        self.seat = Seat("", -math.inf, self._since_s)
        self.at_work = 0
        """How many whole requests have not been answered yet."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """See asyncio.Protocol."""
        peer = transport.get_extra_info("peername")
        if peer is None or not self._keeper.admits(str(peer[0]), self._since_s):
            self._keeper.refused += 1
            cast("asyncio.Transport", transport).abort()
            return
        self.seat = Seat(str(peer[0]), -math.inf, self._since_s)
        self._transport = cast("asyncio.Transport", transport)
        self._keeper.gates[transport] = self
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
            self._keeper.gates.pop(self._transport, None)
        if self._inner is not None:
            self._inner.connection_lost(exc)

    def begins(self) -> None:
        """Note that a whole request is here: however long its answer takes, nothing is overdue."""
        self._unfinished = False
        self.at_work += 1
        self.seat = self.seat._replace(asked_s=self._loop.time())

    def ends(self) -> None:
        """Note that its answer is on its way."""
        self.at_work -= 1
        self._since_s = self._loop.time()
        self.seat = self.seat._replace(asked_s=self._since_s)

    def overdue(self, now_s: float, idle_s: float) -> bool:
        """Tell whether this connection is to be ended."""
        longest_s = min(REQUEST_WITHIN_S, idle_s) if self._unfinished else idle_s
        return not self.at_work and now_s - self._since_s > longest_s

    def hang_up(self) -> None:
        """End the connection."""
        if self._transport is not None:
            self._transport.abort()
