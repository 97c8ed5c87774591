"""The simulated mount behind a UDP socket: its own 50 ms loop, a mailbox, a status at each turn.

As in "Xerxes Mount Control Protocol", Theory of Operation: listening and the loop are not synchronised; the
loop takes whatever came last and ignores anything before it.
"""

from __future__ import annotations

import contextlib
import select
import socket
import time
from typing import TYPE_CHECKING

from sattrack.errors import SattrackError

if TYPE_CHECKING:
    from collections.abc import Callable

    from sattrack.clock import Clock
    from sattrack.xerxes.simulator.faults import Faults
    from sattrack.xerxes.simulator.mount import SimulatedMount, Truth

RECEIVE_BYTES = 2048
BURST = 256

Peer = tuple[str, int]


class SimulatorServer:
    """One mount on one port. Statuses go to `peer`, else to whoever sent the last valid command."""

    def __init__(
        self, mount: SimulatedMount, clock: Clock, host: str, port: int, peer: Peer | None, faults: Faults
    ) -> None:
        self._mount = mount
        self._clock = clock
        self._peer = peer
        self._peer_is_fixed = peer is not None
        self._faults = faults
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
        period_s = self._mount.profile.period_s / self._clock.speed
        start_s = time.monotonic()
        due_s = start_s
        while going():
            due_s += period_s
            self._wait_until(due_s, watch)
            self._drain()
            now_s = time.monotonic()
            status, truth = self._mount.tick(self._clock.utc_s(now_s))
            if self._peer is not None and not self._faults.silent((now_s - start_s) * self._clock.speed):
                self._send(status, self._peer)
            tell(truth)
            if now_s - due_s > 1.0:
                due_s = now_s

    def close(self) -> None:
        """Give the port back."""
        self._socket.close()

    def _wait_until(self, due_s: float, watch: list[int]) -> None:
        left_s = due_s - time.monotonic()
        if left_s <= 0.0:
            return
        if watch:
            readable, _, _ = select.select(watch, [], [], left_s)
            if not readable:
                return
        left_s = due_s - time.monotonic()
        if left_s > 0.0:
            time.sleep(left_s)

    def _drain(self) -> None:
        for _ in range(BURST):
            try:
                data, sender = self._socket.recvfrom(RECEIVE_BYTES)
            except BlockingIOError:
                return
            except OSError:
                continue
            if self._mount.receive(data) and not self._peer_is_fixed:
                self._peer = sender

    def _send(self, status: bytes, peer: Peer) -> None:
        # A client that is not there (yet) is none of the mount's business: it sends blindly.
        with contextlib.suppress(OSError):
            self._socket.sendto(status, peer)
