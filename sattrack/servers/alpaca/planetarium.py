"""Planetarium programs' connections, beside Alpaca's: LX200 over TCP or a serial line, and Stellarium's own.

A client's commands are carried out one after another, but a stop does not wait for those before it: it drops
those that could move the mount and have not begun. Motions that a client's keys have begun end with it.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from sattrack.mount.requests import Abort
from sattrack.runtime.callers import READ_BYTES, Bucket
from sattrack.servers.alpaca.lx200 import Asked, CommandReader, Lx200Client
from sattrack.servers.alpaca.protocol import Fault

if TYPE_CHECKING:
    from collections.abc import Callable

    from sattrack.core.clock import Clock
    from sattrack.servers.alpaca.connections import ClientConnection, FeederLine, OpenConnections
    from sattrack.servers.alpaca.telescope import ServedTelescope

STOP = "Q"
MOVERS = ("M", "C", "h", "A", "T")
"""How commands begin that can move the mount."""
BURST_S = 0.2
"""A connection that was silent may send the commands of so much time at once."""
QUOTED = 20


@dataclass(slots=True)
class Planetariums:
    """Serves the telescope to planetarium programs; clients' numbers are negative: Alpaca's own are not."""

    telescope: ServedTelescope
    channel: FeederLine
    connections: OpenConnections
    clock: Clock
    requests_per_s: float
    _count: int = 0
    _stops: set[asyncio.Task[None]] = field(default_factory=set)

    def protocol(
        self, serve: Callable[[asyncio.StreamReader, asyncio.StreamWriter], object]
    ) -> asyncio.Protocol:
        """Return the protocol of a connection that `lx200` or `stellarium` serves."""
        return asyncio.StreamReaderProtocol(asyncio.StreamReader(), serve)  # type: ignore[arg-type]

    async def serial_line(self, number: int) -> None:
        """Serve the LX200 client on a serial line, given as a descriptor, until the line is gone."""
        loop, reader = asyncio.get_running_loop(), asyncio.StreamReader()
        await loop.connect_read_pipe(
            lambda: asyncio.StreamReaderProtocol(reader), os.fdopen(os.dup(number), "rb", 0)
        )
        transport, flow = await loop.connect_write_pipe(
            lambda: asyncio.StreamReaderProtocol(asyncio.StreamReader()), os.fdopen(number, "wb", 0)
        )
        await self.lx200(reader, asyncio.StreamWriter(transport, flow, None, loop), is_serial=True)
        self.channel.log("the serial line is gone")

    async def lx200(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, is_serial: bool = False
    ) -> None:
        """Serve one LX200 client until it is gone."""
        connection = self.connections.by_transport.get(writer.transport)
        commands = CommandReader(noisy=is_serial)
        client = Lx200Client(self.telescope, self._number(), gives_reasons=is_serial)
        waiting: asyncio.Queue[str] = asyncio.Queue()
        worker = asyncio.create_task(self._obey(client, waiting, writer, connection))
        try:
            while not worker.done() and (data := await reader.read(READ_BYTES)):
                found = commands.read(data)
                if found is None:
                    self.channel.log(f"an LX200 client was hung up on: it sent {data[:QUOTED]!r}")
                    break
                for command in found:
                    if command == STOP:
                        self._stop(client, waiting)
                    else:
                        waiting.put_nowait(command)
        except ConnectionError:
            pass
        finally:
            worker.cancel()
            self._aside(self._carry_out(client.left()))
            self._leave(client.client)
            writer.close()

    async def stellarium(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Serve one Stellarium until it is gone, or the mount is no longer heard."""
        from sattrack.servers.alpaca.stellarium import GotoReader

        connection = self.connections.by_transport.get(writer.transport)
        gotos, number = GotoReader(), self._number()
        places = asyncio.create_task(self._tell_places(writer, connection))
        try:
            while not places.done() and (data := await reader.read(READ_BYTES)):
                found = gotos.read(data)
                if found is None:
                    self.channel.log(f"a Stellarium was hung up on: it sent {data[:QUOTED]!r}")
                    break
                for ra_deg, dec_deg in found[-1:]:
                    await self._goto(number, ra_deg, dec_deg)
        except ConnectionError:
            pass
        finally:
            places.cancel()
            self._leave(number)
            writer.close()

    def _number(self) -> int:
        self._count -= 1
        return self._count

    def _now_s(self) -> float:
        return self.clock.utc_s(time.monotonic())

    def _leave(self, number: int) -> None:
        with contextlib.suppress(Fault):
            self.telescope.order("disconnect", number, self._now_s())

    async def _obey(
        self,
        client: Lx200Client,
        waiting: asyncio.Queue[str],
        writer: asyncio.StreamWriter,
        connection: ClientConnection | None,
    ) -> None:
        """Carry out a client's commands as they come, at the pace that clients are allowed."""
        loop, rate = asyncio.get_running_loop(), self.requests_per_s
        bucket = Bucket(rate, BURST_S * rate, loop.time())
        while True:
            command = await waiting.get()
            bucket.fill(loop.time())
            bucket.left -= 1.0
            if bucket.left < 0.0:
                await asyncio.sleep(-bucket.left / rate)
            if connection is not None:
                connection.begins()
            try:
                writer.write(await self._answer(client, command))
            finally:
                if connection is not None:
                    connection.ends()
            await writer.drain()

    async def _answer(self, client: Lx200Client, command: str) -> bytes:
        try:
            answer = client.answer(command, self._now_s())
        except Fault as fault:
            self.channel.log(f"LX200 {command[:QUOTED]!r} was refused: {fault.message}")
            return b""
        return await self._carry_out(answer) if isinstance(answer, Asked) else answer

    async def _carry_out(self, asked: Asked) -> bytes:
        try:
            for order in asked.orders:
                await self.channel.order(order)
        except Fault as fault:
            self.channel.log(f"LX200: {fault.message}")
            return asked.refused(fault.message)
        return asked.done

    def _stop(self, client: Lx200Client, waiting: asyncio.Queue[str]) -> None:
        """Stop at once; what was to move the mount and has not begun is dropped."""
        kept = []
        while not waiting.empty():
            kept.append(waiting.get_nowait())
        for command in kept:
            if not command.startswith(MOVERS):
                waiting.put_nowait(command)
        try:
            answer = client.answer(STOP, self._now_s())
        except Fault:
            answer = Asked((Abort(),))
        if isinstance(answer, Asked):
            self._aside(self._carry_out(answer))

    def _aside(self, work: object) -> None:
        task = asyncio.ensure_future(work)  # type: ignore[call-overload]
        self._stops.add(task)
        task.add_done_callback(self._stops.discard)

    async def _tell_places(self, writer: asyncio.StreamWriter, connection: ClientConnection | None) -> None:
        from sattrack.servers.alpaca.stellarium import EVERY_S, of_j2000, position
        from tle.earth import EarthOrientation

        earth, site = EarthOrientation.installed(), self.telescope.device.site
        try:
            while True:
                state = self.telescope.heard(self._now_s())
                place = of_j2000(15.0 * state.ra_h, state.dec_deg, state.measured_utc_s, site, earth)
                writer.write(position(state.measured_utc_s, *place, is_well=state.tripped is None))
                await writer.drain()
                if connection is not None:
                    connection.lives()
                await asyncio.sleep(EVERY_S)
        except Fault:
            # The protocol's own way to say that the telescope is not there.
            writer.close()

    async def _goto(self, number: int, ra_deg: float, dec_deg: float) -> None:
        from sattrack.servers.alpaca.stellarium import of_date
        from tle.earth import EarthOrientation

        now_s = self._now_s()
        earth, site = EarthOrientation.installed(), self.telescope.device.site
        ra_of_date_deg, dec_of_date_deg = of_date(ra_deg, dec_deg, now_s, site, earth)
        try:
            if not self.telescope.connected(number):
                self.telescope.order("connect", number, now_s)
            order = self.telescope.order(
                "slewtocoordinatesasync",
                number,
                now_s,
                RightAscension=ra_of_date_deg / 15.0,
                Declination=dec_of_date_deg,
            )
            if order is not None:
                await self.channel.order(order)
        except Fault as fault:
            self.channel.log(f"Stellarium's goto was refused: {fault.message}")
