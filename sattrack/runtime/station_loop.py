"""The loop of a door behind which a mount is led: datagrams at their deadlines, callers whenever they call.

One thread, one `select`: what a caller asks is answered as soon as its bytes are read, unless a datagram is
being computed just then, which takes about a millisecond twenty times a second.
"""

from __future__ import annotations

import select
import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol

from sattrack.core.errors import SattrackError
from sattrack.core.realtime import undisturbed
from sattrack.mount.xerxes.session import REPEAT_AFTER_PERIODS

if TYPE_CHECKING:
    from collections.abc import Callable

    from sattrack.mount.model import MountProfile
    from sattrack.mount.xerxes.session import Session
    from sattrack.runtime.console import Connection
    from sattrack.runtime.signals import StopRequest
    from sattrack.safety import Safety

LATE_ENOUGH_TO_SKIP_S = 0.5
LEAD_S = 0.0015
"""How long before it is due a datagram is computed."""


class Doorway(Protocol):
    """Where callers come in."""

    def readers(self) -> list[Any]:
        """Return what to wait for."""

    def writers(self) -> list[Any]:
        """Return what to wait for to take more."""

    def flush(self) -> None:
        """Send what waits, as far as it can be sent now."""


class Station(Protocol):
    """One mount behind a door, until it is told to end and the mount is seen at rest."""

    @property
    def profile(self) -> MountProfile:
        """What is known of the mount."""

    @property
    def safety(self) -> Safety:
        """What clears its motions."""

    @property
    def session(self) -> Session:
        """The conversation with it."""

    @property
    def finished(self) -> bool:
        """Whether there is nothing left to do."""

    @property
    def mount_stopped(self) -> bool | None:
        """Whether the mount was told to stop and seen at rest; None where that was not needed."""

    @property
    def link_up(self) -> bool:
        """Whether the mount is heard."""

    @property
    def on_trajectory(self) -> bool:
        """Whether it is where it is to be."""

    @property
    def tripped(self) -> str | None:
        """Name of the interlock that stopped the mount."""

    def receive_status(self, data: bytes, arrival_utc_s: float) -> None:
        """Take one datagram from the mount."""

    def tick(self, now_utc_s: float) -> bytes:
        """Return the datagram to send to the mount now; called once a period."""

    def repeat(self) -> bytes | None:
        """Return what to send once more before the next datagram, None for nothing."""

    def send_shift_s(self, now_utc_s: float) -> float:
        """Return by how much later than a period from now the next `tick` had better come, seconds."""

    def end(self, now_utc_s: float) -> None:
        """Bring the mount to rest, and be finished when it is seen there."""


@dataclass(slots=True)
class StationLoop:
    """Serves one mount at one door until `stop` is asked for and the mount is seen at rest.

    What is peculiar to a door: `serve` what is ready at it, `heed` whoever else has something to say once a
    period, and `report` what has changed.
    """

    station: Station
    connection: Connection
    door: Doorway
    stop: StopRequest
    log: Callable[[str], None]
    """Takes lines without their instant."""
    _error: Exception | None = field(default=None, init=False)
    _told_trip: str | None = field(default=None, init=False)
    _told_hold: str | None = field(default=None, init=False)
    _told_link: bool = field(default=False, init=False)

    def serve(self, ready: list[Any]) -> None:
        """Do what is to be done with what is ready at the door."""
        raise NotImplementedError

    def heed(self) -> None:
        """Heed whoever else has something to say."""
        raise NotImplementedError

    def heard(self) -> None:
        """Take notice that the mount has said something."""

    def report(self, ticks: int) -> None:
        """Say what has changed, and show it."""
        raise NotImplementedError

    def tell(self, words: str) -> None:
        """Have the program's own words logged."""
        raise NotImplementedError

    def run(self) -> None:
        """Run to the end. Whatever breaks stops the mount first and is raised then."""
        guard = self.connection.guard
        with undisturbed():
            period_s = self.station.profile.period_s / self.connection.clock.speed
            due_s, ticks = time.monotonic(), 0
            while not self.station.finished and not guard.deposed:
                self._guarded(self._wait_until, due_s - LEAD_S)
                self._guarded(self._heed)
                self._guarded(self._tick, due_s)
                self._guarded(self._repeat, due_s + REPEAT_AFTER_PERIODS * period_s)
                ticks += 1
                self._guarded(self.report, ticks)
                shift_s = self.station.send_shift_s(self.connection.now_utc_s())
                due_s += period_s + shift_s / self.connection.clock.speed
                if time.monotonic() - due_s > LATE_ENOUGH_TO_SKIP_S:
                    due_s = time.monotonic()
        if guard.deposed:
            raise SattrackError(guard.trouble)
        guard.release(self.station.mount_stopped)
        if self._error is not None:
            raise self._error

    def _guarded(self, part: Callable[..., None], *arguments: Any) -> None:
        try:
            part(*arguments)
        except Exception as error:  # noqa: BLE001 - no error is worth a mount that is left moving
            if self._error is None:
                self._error = error
            self.station.end(self.connection.now_utc_s())

    def _wait_until(self, due_s: float) -> None:
        """Wait for an instant, taking datagrams and serving callers as they come."""
        while True:
            left_s = max(0.0, due_s - time.monotonic())
            link, door = self.connection.link, self.door
            ready, takes_more, _ = select.select([link, *door.readers()], door.writers(), [], left_s)
            self.serve(ready)
            if takes_more:
                door.flush()
            if link in ready:
                for arrival in link.receive():
                    arrived_utc_s = self.connection.clock.utc_s(arrival.monotonic_s)
                    self.station.receive_status(arrival.data, arrived_utc_s)
                self.heard()
            if time.monotonic() >= due_s:
                return

    def _heed(self) -> None:
        if self.connection.guard.stop_asked:
            self.stop.ask()
        if self.connection.guard.trouble is not None:
            raise SattrackError(self.connection.guard.trouble)
        if self.stop.asked:
            self.station.end(self.connection.now_utc_s())
        if self.connection.simulated is not None:
            # Nobody asks for the truth here, but the pipe must not fill up.
            self.connection.simulated.truths()
        self.heed()

    def _tick(self, due_s: float) -> None:
        connection = self.connection
        datagram = self.station.tick(connection.clock.utc_s(max(due_s, time.monotonic())))
        while (left_s := due_s - time.monotonic()) > 0.0:
            # Whoever asks while a datagram waits to be due is not kept waiting.
            ready, _, _ = select.select(self.door.readers(), [], [], left_s)
            self.serve(ready)
        if connection.guard.beat(datagram):
            connection.link.send(datagram)

    def _repeat(self, due_s: float) -> None:
        """Send the last datagram once more where the link loses some."""
        self._wait_until(due_s)
        datagram = self.station.repeat()
        if datagram is not None and not (self.stop.asked or self.connection.guard.deposed):
            self.connection.link.send(datagram)

    def report_mount(self, way: str, ready_again: str) -> None:
        """Say what has changed of the mount: interlocks, limits, the link.

        `way` is what the caller's positions are called, `ready_again` what makes a stopped mount ready.
        """
        station = self.station
        if station.tripped != self._told_trip:
            self._told_trip = station.tripped
            if station.tripped is not None:
                self.tell(f"safety stopped the mount: {station.tripped}; {ready_again} makes it ready again")
        held_by = station.safety.holding
        if held_by is not None and held_by != self._told_hold:
            self._told_hold = held_by
            self.tell(f"a limit keeps the antenna off its {way}: {held_by}")
        elif station.on_trajectory:
            self._told_hold = None
        if station.link_up != self._told_link:
            self._told_link = station.link_up
            did = f"the mount {station.session.health.did}"
            self.tell("the mount is heard" if station.link_up else did)
