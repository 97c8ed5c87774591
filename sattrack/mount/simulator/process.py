"""The simulated mount behind a UDP socket: its own 50 ms loop, a mailbox, a status at each turn.

As in "Xerxes Mount Control Protocol", Theory of Operation: listening and the loop are not synchronised; the
loop takes the datagram that came last and ignores those before it.

As a process of its own it gets its configuration as one JSON argument and writes JSON lines: first the port
that it listens on, then at each turn of the loop where the axes really were. The process ends when its
standard input does, so it never outlives the process that started it.
"""

from __future__ import annotations

import contextlib
import math
import os
import select
import signal
import socket
import sys
import time
from heapq import heappop, heappush
from typing import TYPE_CHECKING, Any

import msgspec

from sattrack.core.clock import Clock, SimulatedClock, SystemClock
from sattrack.core.errors import SattrackError
from sattrack.mount.model import MountProfile
from sattrack.mount.simulator.installation import Faults, Installation
from sattrack.mount.simulator.mount import SimulatedMount, SimulatedSite, StartPosition, Truth
from sattrack.mount.simulator.profile import SimulatorProfile

if TYPE_CHECKING:
    from collections.abc import Callable

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
                f"UDP port {port} on {host} is not available: {error.strerror}; choose another with --port"
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


class ClockSetting(msgspec.Struct, frozen=True):
    """A simulated clock's three numbers."""

    start_utc_s: float
    anchor_s: float
    speed: float


class SimulatorConfig(msgspec.Struct, frozen=True):
    """Everything that makes one simulated mount; port 0 takes any free one.

    `faults` replace those of the hardware's settings.
    """

    site: SimulatedSite
    profile: MountProfile = MountProfile()
    start: StartPosition = StartPosition()
    port: int = 0
    peer_port: int | None = None
    clock: ClockSetting | None = None
    hardware: SimulatorProfile = SimulatorProfile()
    faults: Faults | None = None


class Ready(msgspec.Struct, frozen=True):
    """The first line of output."""

    port: int


def make_clock(setting: ClockSetting | None) -> Clock:
    """Return the clock that the numbers describe, the machine's own where there are none."""
    if setting is None:
        return SystemClock()
    return SimulatedClock(setting.start_utc_s, setting.anchor_s, setting.speed)


def make_server(config: SimulatorConfig) -> SimulatorServer:
    """Return the mount on its port.

    Raises SattrackError where the port is in use, BadInputError where the settings say what cannot be.
    """
    mount = SimulatedMount(config.profile, config.site, config.start, config.hardware)
    peer = None if config.peer_port is None else ("127.0.0.1", config.peer_port)
    installation = Installation(mount, config.faults)
    return SimulatorServer(installation, make_clock(config.clock), "127.0.0.1", config.port, peer)


def serve(server: SimulatorServer) -> None:
    """Run until standard input ends, telling the truth on standard output."""
    encoder = msgspec.json.Encoder()
    out = sys.stdout.fileno()
    os.set_blocking(out, False)
    os.set_blocking(sys.stdin.fileno(), False)

    def write(item: object) -> None:
        # A reader that does not keep up loses lines; the mount's loop never waits for it.
        try:
            os.write(out, encoder.encode(item) + b"\n")
        except BlockingIOError:
            return

    def going() -> bool:
        try:
            return os.read(sys.stdin.fileno(), 64) != b""
        except BlockingIOError:
            return True

    write(Ready(server.port))
    server.run(going, write, [sys.stdin.fileno()])


def main() -> int:
    """Run the process; returns its exit code."""
    # Interrupting the tracker must not take the mount away before the tracker has stopped it.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        server = make_server(msgspec.json.decode(sys.argv[1], type=SimulatorConfig))
    except SattrackError as error:
        sys.stderr.write(f"{error}\n")
        return error.exit_code
    try:
        serve(server)
    except BrokenPipeError:
        return 0
    finally:
        server.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
