"""`sattrack serve rotctld`: its loop and its TCP port, for many callers, none of which may delay the mount.

Requests are answered in slices so short that a flood of them delays the mount's next datagram by a
millisecond or two at most; the rest waits. A caller with too many requests is not read from for a while: its
own system then keeps it from sending.
"""

from __future__ import annotations

import math
import socket
import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from sattrack.runtime.callers import MOST_WAITING_BYTES, Bucket, Opening, Seat, TcpChannel
from sattrack.runtime.loop import StationLoop
from sattrack.servers.antenna.protocol import to_ns
from sattrack.servers.rotctld.answers import Client

if TYPE_CHECKING:
    from collections.abc import Callable

    from sattrack.runtime.callers import CallerLimits
    from sattrack.servers.rotctld.rotator import Rotator, RotatorStation

PROGRAM = "rotctld"
MOST_LOGGED = 5
"""Lines of the log in one tick; more are counted."""
LOG_FAILURES_EVERY_S = 10.0
SLICE_S = 0.001
"""Requests are answered for this time at once."""
REQUESTS_AT_ONCE = 8
MOST_ACCEPTED = 32
BURST_S = 0.2
"""A caller that was silent may send the requests of so much time at once."""


@dataclass(slots=True)
class RotctldLoop(StationLoop):
    """Serves one mount to rotctld's clients until `stop` is set and the mount is seen at rest."""

    driver: RotatorStation
    server: RotctldServer

    def tell(self, words: str) -> None:
        """See StationLoop."""
        self.log(words)

    def serve(self, ready: list[Any]) -> None:
        """Serve the clients that have sent bytes, or wait for answers."""
        self.server.serve(ready, self._now_ns)

    def obey(self, now_utc_s: float) -> None:
        """Disconnect clients that are silent for too long."""
        self.server.tend(to_ns(now_utc_s))

    def report(self) -> None:
        """Log what has changed: clients, the commanding one, refusals, interlocks, the link."""
        for line in self.server.report():
            self.tell(line)
        self.report_mount("position", "R")

    def _now_ns(self) -> int:
        return to_ns(self.connection.now_utc_s())


@dataclass(slots=True)
class RotctldServer:
    """A listening socket with its callers, who share one rotator and its lines for the log."""

    listener: socket.socket
    limits: CallerLimits
    rotator: Rotator
    info: str
    """The rotator's name, for clients."""
    callers: dict[int, Caller] = field(default_factory=dict)
    """By their number."""
    refused: int = 0
    """Callers that were disconnected as they came."""
    failures: int = 0
    """Failed requests of callers that are gone."""
    _logged_failures: int = 0
    _failures_logged_s: float = 0.0
    _next_number: int = 1
    _always: tuple[socket.socket, socket.socket] = field(default_factory=socket.socketpair)
    """A socket that is always readable: waited on while requests are left over."""

    def __post_init__(self) -> None:
        """Make the socket readable."""
        self._always[1].send(b"!")

    @property
    def port(self) -> int:
        """The TCP port."""
        return int(self.listener.getsockname()[1])

    def readers(self) -> list[Any]:
        """See StationLoop."""
        now_s = time.monotonic()
        readers: list[Any] = [self.listener]
        left_over = False
        for caller in self.callers.values():
            if caller.budget.fill(now_s) < 1.0 or caller.waiting or caller.client.paused:
                continue
            if caller.more:
                left_over = True
            else:
                readers.append(caller)
        return [*readers, self._always[0]] if left_over else readers

    def writers(self) -> list[Any]:
        """See StationLoop."""
        return [caller for caller in self.callers.values() if caller.waiting]

    def flush(self) -> None:
        """See StationLoop."""
        for caller in self.callers.values():
            if caller.waiting:
                self._flush(caller)

    def serve(self, ready: list[Any], now_ns: Callable[[], int]) -> list[int]:
        """Serve what is ready; return the numbers of callers that have gone.

        `now_ns` is read as soon as bytes are here: their positions are of that instant.
        """
        until_s = time.monotonic() + SLICE_S
        speaking = {id(part) for part in ready}
        callers = [caller for caller in self.callers.values() if id(caller) in speaking]
        gone = [caller.client.number for caller in callers if not self._read(caller)]
        for number in gone:
            self._answer_last(self.callers[number], now_ns())
            self._hang_up(number)
        gone += self._answer_all(now_ns(), until_s)
        if self.listener in ready:
            gone += self._accept()
        self._note_gone(gone)
        return gone

    def tend(self, now_ns: int) -> list[int]:
        """Hang up on callers that have been silent too long; return their numbers. Call once a period."""
        now_s = time.monotonic()
        idle = [n for n, caller in self.callers.items() if now_s - caller.heard_s > self.limits.idle_s]
        for number in idle:
            self.rotator.log_lines.append(
                f"client {number} was silent for {self.limits.idle_s:g} s and is disconnected"
            )
            self._hang_up(number)
        for caller in self.callers.values():
            # Pauses that clients asked for come to an end.
            caller.more |= caller.client.paused and caller.client.pause_until_s <= now_ns / 1e9
        self._note_gone(idle)
        return idle

    def report(self) -> list[str]:
        """Return the lines to log: clients, the commanding one, refusals."""
        lines = self.rotator.log_lines
        shown = [lines.popleft() for _ in range(min(MOST_LOGGED, len(lines)))]
        if lines:
            shown.append(f"and {len(lines)} lines more, or still more")
            lines.clear()
        count = self.failures + sum(caller.client.refused for caller in self.callers.values())
        now_s = time.monotonic()
        if count != self._logged_failures and now_s - self._failures_logged_s >= LOG_FAILURES_EVERY_S:
            shown.append(f"{count - self._logged_failures} requests were answered with a failure")
            self._logged_failures, self._failures_logged_s = count, now_s
        return shown

    def _note_gone(self, numbers: list[int]) -> None:
        for number in numbers:
            self.rotator.hang_up(number)
            self.rotator.log_lines.append(f"client {number} is gone")

    def close(self) -> None:
        """Close everything."""
        for number in list(self.callers):
            self._hang_up(number)
        for part in (self.listener, *self._always):
            part.close()

    def _read(self, caller: Caller) -> bool:
        """Take a caller's bytes; False where it is gone."""
        data = caller.channel.read()
        if data is None:
            return False
        if data:
            caller.heard_s = time.monotonic()
            accepted = caller.opening.take(data)
            if accepted is None:
                self.rotator.log_lines.append(
                    f"client {caller.client.number} speaks HTTP or TLS and is disconnected"
                )
                return False
            caller.client.receive(accepted)
            caller.more = True
        return True

    def _answer_all(self, now_ns: int, until_s: float) -> list[int]:
        """Answer callers in turn until nothing is left to answer, or no time."""
        gone = []
        answering = [caller for caller in self.callers.values() if caller.more and not caller.waiting]
        while answering:
            for caller in list(answering):
                number = caller.client.number
                goes_on = self._answer(caller, now_ns) and caller.more and not caller.waiting
                leaves = caller.client.left or len(caller.waiting) > MOST_WAITING_BYTES
                if leaves:
                    gone.append(number)
                    self._hang_up(number)
                if leaves or not goes_on:
                    answering.remove(caller)
                if time.monotonic() >= until_s:
                    # The caller answered last comes last the next time.
                    self._put_last(number)
                    return gone
        return gone

    def _answer(self, caller: Caller, now_ns: int) -> bool:
        """Answer some of a caller's requests; False where it may ask no more now."""
        most = min(REQUESTS_AT_ONCE, int(caller.budget.fill(time.monotonic())))
        if most < 1:
            return False
        answers, count = caller.client.answer(now_ns, most)
        caller.budget.left -= count
        if count:
            caller.seat = caller.seat._replace(asked_s=time.monotonic())
        caller.more = count == most
        caller.waiting += answers
        self._flush(caller)
        return True

    def _answer_last(self, caller: Caller, now_ns: int) -> None:
        """Answer a caller that has shut its side before the end of its first line."""
        rest = caller.opening.rest()
        if rest:
            caller.client.receive(rest)
            self._answer(caller, now_ns)

    def _flush(self, caller: Caller) -> None:
        if caller.waiting:
            caller.waiting = caller.waiting[caller.channel.write(caller.waiting) :]

    def _put_last(self, number: int) -> None:
        caller = self.callers.pop(number, None)
        if caller is not None:
            self.callers[number] = caller

    def _accept(self) -> list[int]:
        """Let callers in; return the numbers of those that had to make room."""
        gone: list[int] = []
        for _ in range(MOST_ACCEPTED):
            try:
                connection, address = self.listener.accept()
            except OSError:
                break
            now_s = time.monotonic()
            seats = {number: caller.seat for number, caller in self.callers.items()}
            objection, idle = self.limits.admit(address[0], seats, now_s)
            if objection is not None:
                self.refused += 1
                self.rotator.log_lines.append(f"{address[0]} was disconnected: {objection}")
                connection.close()
                continue
            for number in idle:
                self.rotator.log_lines.append(f"client {number} is disconnected: it makes room for another")
                self._hang_up(number)
            gone += idle
            number = self._next_number
            self._next_number += 1
            rate = self.limits.requests_per_s
            budget = Bucket(rate, max(1.0, BURST_S * rate), now_s)
            client = Client(number, self.rotator, self.info)
            seat = Seat(address[0], -math.inf, now_s)
            self.callers[number] = Caller(TcpChannel(connection), client, now_s, budget, seat)
            self.rotator.log_lines.append(f"client {number} is there, from {address[0]}:{address[1]}")
        return gone

    def _hang_up(self, number: int) -> None:
        caller = self.callers.pop(number)
        self.failures += caller.client.refused
        caller.channel.close()


@dataclass(slots=True, eq=False)
class Caller:
    """One caller: its channel, its client, and the bytes that wait to be sent to it."""

    channel: TcpChannel
    client: Client
    heard_s: float
    budget: Bucket
    seat: Seat
    opening: Opening = field(default_factory=Opening)
    waiting: bytes = b""
    more: bool = False
    """Whether there may be unanswered requests."""

    def fileno(self) -> int:
        """Return the descriptor to wait on."""
        return self.channel.fileno()
