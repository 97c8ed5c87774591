"""Planetarium programs' connections, beside Alpaca's: INDI, LX200 on TCP or a serial line, Stellarium's own.

A client's commands are carried out one after another, but a stop does not wait for those before it: it drops
those that could move the mount and have not begun. A client that is too far ahead is disconnected; until then
only its stops are obeyed. Motions that a client's keys have begun end with it.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import sys
import time
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any, Generic, TypeVar
from xml.etree.ElementTree import Element, tostring

from sattrack.mount.requests import Abort
from sattrack.runtime.callers import MOST_WAITING_BYTES, READ_BYTES, Bucket
from sattrack.servers.alpaca.indi import (
    ABORT,
    MOVERS,
    ClientView,
    MessageReader,
    ServedIndiDevice,
    TrackElements,
    set_by,
)
from sattrack.servers.alpaca.lx200 import Asked, CommandReader, Lx200Client
from sattrack.servers.alpaca.protocol import Fault

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable, Coroutine

    from sattrack.core.clock import Clock
    from sattrack.servers.alpaca.connections import ClientConnection, FeederLine, OpenConnections
    from sattrack.servers.alpaca.telescope import ServedTelescope

LX200, INDI = "LX200", "INDI"
STOP = "Q"
LX200_MOVERS = ("M", "C", "h", "A", "T")
"""How commands begin that can move the mount."""
BURST_S = 0.2
"""A connection that was silent may send the commands of so much time at once."""
QUOTED = 20
FINISH_WITHIN_S = 10.0
"""What a client has sent before it left is carried out within this time, or not at all."""
EVERY_S = 0.2
"""So often clients hear where the telescope points, without asking."""
REOPEN_EVERY_S = 2.0
"""So often a serial line that is gone is looked for."""
MOST_STOPS = 8
"""Stops of one client that may be unanswered at once; one more is then sent for all that came meanwhile."""
Item = TypeVar("Item")


@dataclass(slots=True)
class Planetariums:
    """Serves the telescope to planetarium programs; clients' numbers are negative: Alpaca's own are not."""

    telescope: ServedTelescope
    channel: FeederLine
    connections: OpenConnections
    clock: Clock
    requests_per_s: float
    follow: Callable[[str], Awaitable[object]]
    """Follows the satellite of two-line elements; raises Fault."""
    _count: int = 0
    _indi: ServedIndiDevice | None = None
    _tasks: set[asyncio.Task[object]] = field(default_factory=set)

    def protocol(
        self, serve: Callable[[asyncio.StreamReader, asyncio.StreamWriter], Coroutine[Any, Any, None]]
    ) -> asyncio.Protocol:
        """Return the protocol of a connection that `lx200`, `indi` or `stellarium` serves."""

        def begin(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            # asyncio's own task for it would end in a traceback when the program does.
            self._beside(serve(reader, writer))

        return asyncio.StreamReaderProtocol(asyncio.StreamReader(), begin)

    async def serial_line(self, number: int | None, reopened: Callable[[], int | None]) -> None:
        """Serve the LX200 client on a serial line for ever; `number` is its descriptor.

        One that is gone, as an adapter that was unplugged, is served again once `reopened` returns another.
        """
        while True:
            if number is not None:
                await self._serial_client(number)
                self.channel.log("the serial line is gone")
            await asyncio.sleep(REOPEN_EVERY_S)
            number = reopened()
            if number is not None:
                self.channel.log("the serial line is there again")

    async def _serial_client(self, number: int) -> None:
        loop, reader = asyncio.get_running_loop(), asyncio.StreamReader()
        await loop.connect_read_pipe(
            lambda: asyncio.StreamReaderProtocol(reader), os.fdopen(os.dup(number), "rb", 0)
        )
        transport, flow = await loop.connect_write_pipe(
            lambda: asyncio.StreamReaderProtocol(asyncio.StreamReader()), os.fdopen(number, "wb", 0)
        )
        await self.lx200(reader, asyncio.StreamWriter(transport, flow, None, loop), is_serial=True)

    async def lx200(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, is_serial: bool = False
    ) -> None:
        """Serve one LX200 client until it is gone."""
        connection = self.connections.by_transport.get(writer.transport)
        commands = CommandReader(noisy=is_serial)
        client = Lx200Client(self.telescope, self._number(), gives_reasons=is_serial)
        waiting, stops = _Waiting[str](), _Stops(self._beside)
        worker = self._beside(self._obey(partial(self._answer, client), waiting, writer, connection))
        try:
            while not worker.done() and (data := await reader.read(READ_BYTES)):
                found = commands.read(data)
                if found is None:
                    _drop(waiting, lambda _: True)
                    self.channel.log(f"an LX200 client was disconnected: it sent {data[:QUOTED]!r}")
                    break
                for command in found:
                    if command == STOP:
                        _note_whole(connection)
                        _drop(waiting, lambda one: one.startswith(LX200_MOVERS))
                        stops.stop(partial(self._stop, client))
                    elif waiting.overruns(command):
                        self._beside(self._hold_off("an LX200 client", waiting, worker, connection))
            await _finish(waiting, worker)
        except ConnectionError:
            pass
        finally:
            worker.cancel()
            self._beside(self._carry_out(LX200, client.left()))
            self._leave(client.client)
            writer.close()

    async def stellarium(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Serve one Stellarium until it is gone, or the mount is no longer heard."""
        from sattrack.servers.alpaca.stellarium import GotoReader

        connection = self.connections.by_transport.get(writer.transport)
        gotos, number = GotoReader(), self._number()
        places = self._beside(self._tell_places(writer, connection))
        try:
            while not places.done() and (data := await reader.read(READ_BYTES)):
                found = gotos.read(data)
                if found is None:
                    self.channel.log(f"a Stellarium was disconnected: it sent {data[:QUOTED]!r}")
                    break
                for ra_deg, dec_deg in found[-1:]:
                    _note_whole(connection)
                    await self._goto(number, ra_deg, dec_deg)
        except ConnectionError:
            pass
        finally:
            places.cancel()
            self._leave(number)
            writer.close()

    async def indi(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Serve one INDI client until it is gone."""
        connection = self.connections.by_transport.get(writer.transport)
        device = self._indi = self._indi or ServedIndiDevice(self.telescope, self._number())
        caller, messages, view = self._number(), MessageReader(), ClientView(device)
        waiting, stops = _Waiting[Element](), _Stops(self._beside)
        aside = [
            self._beside(
                self._obey(partial(self._answer_indi, device, view, caller), waiting, writer, connection)
            ),
            self._beside(self._tell_changes(view, writer, connection)),
        ]
        try:
            while not any(one.done() for one in aside) and (data := await reader.read(READ_BYTES)):
                found = messages.read(data)
                if found is None:
                    _drop(waiting, lambda _: True)
                    self.channel.log(f"an INDI client was disconnected: it sent {data[:QUOTED]!r}")
                    break
                for message in found:
                    if set_by(message) == ABORT:
                        _note_whole(connection)
                        _drop(waiting, lambda one: set_by(one) in MOVERS)
                        stops.stop(partial(self._take, device, message, caller))
                    elif waiting.overruns(message):
                        self._beside(self._hold_off("an INDI client", waiting, aside[0], connection))
            await _finish(waiting, aside[0])
        except ConnectionError:
            pass
        finally:
            for one in aside:
                one.cancel()
            self._beside(self._carry_out(INDI, device.left(caller)))
            writer.close()

    async def _answer_indi(
        self, device: ServedIndiDevice, view: ClientView, caller: int, message: Element
    ) -> bytes:
        if message.tag == "getProperties":
            return view.definitions(message, self._now_s())
        await self._take(device, message, caller)
        return b""

    async def _take(self, device: ServedIndiDevice, message: Element, caller: int) -> None:
        name = set_by(message)
        if name is None:
            return
        try:
            asked = device.take(message, caller, self._now_s())
            if isinstance(asked, TrackElements):
                await self.follow(asked.text)
            elif asked is not None:
                await self._carry_out(INDI, asked)
        except Fault as fault:
            device.refuse(name, fault.message)
        finally:
            device.carried_out(name)
            device.settings[name] += 1

    async def _tell_changes(
        self, view: ClientView, writer: asyncio.StreamWriter, connection: ClientConnection | None
    ) -> None:
        while True:
            writer.write(view.changes(self._now_s()))
            await writer.drain()
            if connection is not None:
                connection.lives()
            await asyncio.sleep(EVERY_S)

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
        answer: Callable[[Item], Awaitable[bytes]],
        waiting: _Waiting[Item],
        writer: asyncio.StreamWriter,
        connection: ClientConnection | None,
    ) -> None:
        """Carry out a client's commands as they come, at the pace that clients are allowed."""
        pace = _Pace(self.requests_per_s)
        while True:
            command = await waiting.get()
            if connection is not None:
                connection.begins()
            try:
                writer.write(await answer(command))
            finally:
                waiting.task_done()
                if connection is not None:
                    connection.ends()
            await writer.drain()
            # Before the next is taken: one that waits here would not be dropped by a stop.
            await pace.keep()

    async def _answer(self, client: Lx200Client, command: str) -> bytes:
        try:
            answer = client.answer(command, self._now_s())
        except Fault as fault:
            if command.startswith(LX200_MOVERS):
                # Programs ask where a mount is several times a second, also one that is not heard.
                self.channel.log(f"LX200 {command[:QUOTED]!r} was refused: {fault.message}")
            return b""
        return await self._carry_out(LX200, answer) if isinstance(answer, Asked) else answer

    async def _carry_out(self, protocol: str, asked: Asked) -> bytes:
        """Carry out what a client asks for; return its answer. The log has the reason of a refusal."""
        objection = asked.objection
        try:
            for order in asked.orders:
                await self.channel.order(order)
        except Fault as fault:
            objection = fault.message
        if objection is None:
            return asked.done
        self.channel.log(f"{protocol}: {objection}")
        return asked.refused(objection)

    async def _stop(self, client: Lx200Client) -> None:
        try:
            answer = client.answer(STOP, self._now_s())
        except Fault:
            answer = Asked((Abort(),))
        if isinstance(answer, Asked):
            await self._carry_out(LX200, answer)

    async def _hold_off(
        self,
        who: str,
        waiting: _Waiting[Item],
        worker: asyncio.Task[object],
        connection: ClientConnection | None,
    ) -> None:
        """Carry out what waits of a client that is too far ahead, then disconnect it.

        Its stops are obeyed meanwhile. A serial line stays, and its next commands are obeyed again.
        """
        self.channel.log(f"{who} sent too much ahead of its answers: only its stops are obeyed")
        await _finish(waiting, worker)
        if connection is None:
            waiting.overrun = False
        else:
            connection.hang_up()

    def _beside(self, work: Coroutine[Any, Any, object]) -> asyncio.Task[object]:
        """Do something beside what a connection waits for; what breaks there is logged."""
        task = asyncio.ensure_future(work)
        self._tasks.add(task)
        task.add_done_callback(self._over)
        return task

    def _over(self, task: asyncio.Task[object]) -> None:
        self._tasks.discard(task)
        error = None if task.cancelled() else task.exception()
        if error is not None and not isinstance(error, ConnectionError):
            self.channel.log(f"a defect of sattrack: {error!r}")

    async def _tell_places(self, writer: asyncio.StreamWriter, connection: ClientConnection | None) -> None:
        from sattrack.servers.alpaca.stellarium import of_j2000, position
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


class _Pace:
    """The pace that clients are allowed."""

    def __init__(self, rate: float) -> None:
        self._rate, self._loop = rate, asyncio.get_running_loop()
        self._bucket = Bucket(rate, BURST_S * rate, self._loop.time())

    async def keep(self) -> None:
        """Count one request; wait where they come too fast."""
        self._bucket.fill(self._loop.time())
        self._bucket.left -= 1.0
        if self._bucket.left < 0.0:
            await asyncio.sleep(-self._bucket.left / self._rate)


class _Waiting(asyncio.Queue[Item], Generic[Item]):
    """What a client has sent and has not begun: so many bytes of memory at most."""

    overrun = False
    """Whether there was more, which is dropped."""

    def _init(self, maxsize: int) -> None:
        super()._init(maxsize)
        self._bytes = 0

    def _put(self, item: Item) -> None:
        super()._put(item)
        self._bytes += _size_bytes(item)

    def _get(self) -> Item:
        item: Item = super()._get()
        self._bytes -= _size_bytes(item)
        return item

    def overruns(self, item: Item) -> bool:
        """Have a command wait, where there is room; return whether it is the first for which there is none.

        One alone always may wait, however long the reader of the protocol lets it be.
        """
        if self.overrun:
            return False
        self.overrun = not self.empty() and self._bytes + _size_bytes(item) > MOST_WAITING_BYTES
        if not self.overrun:
            self.put_nowait(item)
        return self.overrun


def _size_bytes(item: object) -> int:
    """Return about how much memory a command takes."""
    if isinstance(item, Element):
        return len(tostring(item)) + sum(sys.getsizeof(one) for one in item.iter())
    return sys.getsizeof(item)


@dataclass(slots=True)
class _Stops:
    """A client's stops. Each goes out at once; a flood of them does not."""

    beside: Callable[[Coroutine[Any, Any, object]], object]
    _unanswered: int = 0
    _owed: Callable[[], Coroutine[Any, Any, object]] | None = None

    def stop(self, carry_out: Callable[[], Coroutine[Any, Any, object]]) -> None:
        """Carry out a stop beside all else: now, or once an earlier one of many is answered."""
        if self._unanswered >= MOST_STOPS:
            self._owed = carry_out
            return
        self._unanswered += 1
        self.beside(self._carry_out(carry_out))

    async def _carry_out(self, carry_out: Callable[[], Coroutine[Any, Any, object]]) -> None:
        try:
            await carry_out()
        finally:
            self._unanswered -= 1
            owed, self._owed = self._owed, None
            if owed is not None:
                self.stop(owed)


def _note_whole(connection: ClientConnection | None) -> None:
    """Note that a request was whole: what has come of it is no reason to hang up later."""
    if connection is not None:
        connection.begins()
        connection.ends()


def _drop(waiting: _Waiting[Item], dropped: Callable[[Item], bool]) -> None:
    """Take some items out of a queue."""
    for _ in range(waiting.qsize()):
        item = waiting.get_nowait()
        if not dropped(item):
            waiting.put_nowait(item)
        waiting.task_done()


async def _finish(waiting: asyncio.Queue[Any], worker: asyncio.Task[object]) -> None:
    """Let what a client has sent be carried out, although it is gone: programs send a command and leave."""
    carried_out = asyncio.ensure_future(waiting.join())
    await asyncio.wait((carried_out, worker), timeout=FINISH_WITHIN_S, return_when=asyncio.FIRST_COMPLETED)
    carried_out.cancel()
