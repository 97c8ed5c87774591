"""The custom actions at work: what takes long is computed in a thread, one at a time."""

from __future__ import annotations

import asyncio
import gc
import time
from typing import TYPE_CHECKING, Any

import msgspec

from sattrack.servers.alpaca.actions import Bias, Passes
from sattrack.servers.alpaca.faults import Fault, Number
from sattrack.servers.alpaca.messages import BiasOrder, FollowOrder
from sattrack.servers.alpaca.satellites import run_told

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable

    from sattrack.core.clock import Clock
    from sattrack.servers.alpaca.actions import CustomAction
    from sattrack.servers.alpaca.messages import Order
    from sattrack.servers.alpaca.satellites import Satellites
    from sattrack.servers.alpaca.telescope import Telescope

PREPARE_AFTER_S = 0.5
BUSY = "passes are being computed for somebody else: ask again in a moment"


class Actions:
    """Does what actions ask, one computation at a time."""

    def __init__(self, satellites: Satellites, telescope: Telescope, clock: Clock) -> None:
        self._satellites, self._telescope, self._clock = satellites, telescope, clock
        self._computing = False
        self._importing = asyncio.Lock()
        """Two threads that import what imports each other may find a part of it."""

    async def prepare(self) -> None:
        """Have what computes passes ready before anybody waits for it; the first answers go before."""
        await asyncio.sleep(PREPARE_AFTER_S)
        async with self._importing:
            await asyncio.to_thread(self._satellites.prepare)
        # Of what was imported nothing is to be looked through whenever garbage is collected.
        gc.collect()
        gc.freeze()

    async def do(self, asked: CustomAction, order: Callable[[Order], Awaitable[None]]) -> str:
        """Return an action's answer, JSON text; `order` has orders carried out. Raises Fault."""
        if isinstance(asked, Bias):
            return await self._bias(asked, order)
        now_utc_s = self._clock.utc_s(time.monotonic())
        if isinstance(asked, Passes):
            return _text(await self._computed(self._satellites.passes, asked, now_utc_s))
        facts = await self._computed(self._satellites.facts, asked, now_utc_s)
        from sattrack.runtime.facts import encode_facts

        await order(FollowOrder(msgspec.Raw(encode_facts(facts))))
        return _text(run_told(facts))

    async def _computed(self, compute: Callable[..., Any], *arguments: Any) -> Any:
        if self._computing:
            raise Fault(Number.INVALID_OPERATION, BUSY)
        self._computing = True
        try:
            async with self._importing:
                return await asyncio.to_thread(compute, *arguments)
        finally:
            self._computing = False

    async def _bias(self, asked: Bias, order: Callable[[Order], Awaitable[None]]) -> str:
        if asked.along_s is not None or asked.cross_deg is not None:
            await order(BiasOrder(asked.along_s, asked.cross_deg, asked.add))
        state = self._telescope.state
        followed = None if state is None else state.following
        if followed is None:
            raise Fault(Number.INVALID_OPERATION, "no satellite is followed: TrackSatellite first")
        return _text(followed)


def _text(value: Any) -> str:
    return msgspec.json.encode(value).decode()
