"""The simulated mount behind a UDP socket: its own 50 ms loop, a mailbox, a status at each turn.

As in "Xerxes Mount Control Protocol", Theory of Operation: listening and the loop are not synchronised; the
loop takes whatever came last and ignores anything before it.
"""

from __future__ import annotations

import contextlib
import math
import select
import socket
import time
from heapq import heappop, heappush
from typing import TYPE_CHECKING, Any

from sattrack.core.errors import SattrackError

if TYPE_CHECKING:
    from collections.abc import Callable

    from sattrack.core.clock import Clock
    from sattrack.mount.simulator.installation import Installation
    from sattrack.mount.simulator.mount import Truth

RECEIVE_BYTES = 2048
BURST = 1024
"""Datagrams taken at one go, so that a flood cannot hold the loop."""
MOST_UNDER_WAY = 4096
"""Datagrams that delays may keep; more than any client sends, and little memory."""

Peer = tuple[str, int]


class UnderWay:
    """Datagrams that delays keep for a while, at most MOST_UNDER_WAY of them."""

    def __init__(self) -> None:
        self._queue: list[tuple[float, int, bytes, Any]] = []
        self._count = 0

    @property
    def next_s(self) -> float:
        """When the first of them is due; never, where there is none."""
        return self._queue[0][0] if self._queue else math.inf

    def put(self, due_s: float, data: bytes, peer: Peer) -> None:
        """Keep one; a flood is dropped."""
        if len(self._queue) < MOST_UNDER_WAY:
            self._count += 1
            heappush(self._queue, (due_s, self._count, data, peer))

    def take(self, now_s: float) -> list[tuple[bytes, Peer]]:
        """Return those that are due, in the order of their instants."""
        due = []
        while self._queue and self._queue[0][0] <= now_s:
            _, _, data, peer = heappop(self._queue)
            due.append((data, peer))
        return due


class SimulatorServer:
    """One mount on one port. Statuses go to `peer`, else to whoever sent the last valid command."""

    def __init__(
        self, installation: Installation, clock: Clock, host: str, port: int, peer: Peer | None
    ) -> None:
        self._installation = installation
        self._clock = clock
        self._peer = peer
        self._peer_is_fixed = peer is not None
        self._arriving = UnderWay()
        self._leaving = UnderWay()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        try:
            self._socket.bind((host, port))
        except OSError as error:
            self._socket.close()
            raise SattrackError(
                f"UDP port {port} on {host} cannot be had: {error.strerror}; choose another with --port"
            ) from error

    @property
    def port(self) -> int:
        """The port that commands come to."""
        port: int = self._socket.getsockname()[1]
        return port

    def run(self, going: Callable[[], bool], tell: Callable[[Truth], None], watch: list[int]) -> None:
        """Run the mount's loop while `going()`; `tell` hears where the axes really were at each turn.

        `watch` holds descriptors that, once readable, are a reason to ask `going` at once.
        """
        start_s = time.monotonic()
        speed = self._clock.speed
        turn_s = self._installation.next_turn_s(0.0)
        while going():
            self._wait_until(start_s + turn_s / speed, watch)
            now_s = time.monotonic()
            if (now_s - start_s) * speed < turn_s:
                continue
            self._drain()
            status, truth = self._installation.turn(self._clock.utc_s(now_s))
            if status is not None and self._peer is not None:
                self._post(status, self._peer, now_s)
            if truth is not None:
                tell(truth)
            turn_s = self._installation.next_turn_s(max(turn_s, (now_s - start_s) * speed))

    def close(self) -> None:
        """Give the port back."""
        self._socket.close()

    def _wait_until(self, turn_s: float, watch: list[int]) -> None:
        """Wait for the loop's next turn, or for a reason to look up; let delayed datagrams pass meanwhile."""
        # Where commands are delayed, it matters when each arrives, not only which is the last at the turn.
        readable = [self._socket.fileno(), *watch] if self._installation.commands.delays else watch
        while (left_s := min(turn_s, self._leaving.next_s) - time.monotonic()) > 0.0:
            if not readable:
                time.sleep(left_s)
                break
            ready, _, _ = select.select(readable, [], [], left_s)
            if self._socket.fileno() in ready:
                self._drain()
            elif ready:
                # What is watched may stay readable: only the turn itself ends that wait.
                readable = [number for number in readable if number not in watch]
        self._send_due(time.monotonic())

    def _drain(self) -> None:
        wire, speed = self._installation.commands, self._clock.speed
        for _ in range(BURST):
            try:
                data, sender = self._socket.recvfrom(RECEIVE_BYTES)
            except BlockingIOError:
                break
            except OSError:
                continue
            now_s = time.monotonic()
            for delay_s, arriving in wire.carry(data):
                if delay_s > 0.0:
                    self._arriving.put(now_s + delay_s / speed, arriving, sender)
                else:
                    self._take(arriving, sender)
        for data, sender in self._arriving.take(time.monotonic()):
            self._take(data, sender)

    def _take(self, data: bytes, sender: Peer) -> None:
        if self._installation.receive(data) and not self._peer_is_fixed:
            self._peer = sender

    def _post(self, status: bytes, peer: Peer, now_s: float) -> None:
        for delay_s, leaving in self._installation.statuses.carry(status):
            if delay_s > 0.0:
                self._leaving.put(now_s + delay_s / self._clock.speed, leaving, peer)
            else:
                self._send(leaving, peer)

    def _send_due(self, now_s: float) -> None:
        for data, peer in self._leaving.take(now_s):
            self._send(data, peer)

    def _send(self, status: bytes, peer: Peer) -> None:
        # A client that is not there (yet) is none of the mount's business: it sends blindly.
        with contextlib.suppress(OSError):
            self._socket.sendto(status, peer)
