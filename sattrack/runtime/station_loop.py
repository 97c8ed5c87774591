"""The loop of a door behind which a mount is led: datagrams at their deadlines, callers whenever they call.

What a caller asks is answered as soon as its bytes are read, unless a datagram is being computed just then,
which takes about a millisecond twenty times a second.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol

from sattrack.runtime.loop import DriverLike, RealtimeLoop

if TYPE_CHECKING:
    from collections.abc import Callable

    from sattrack.mount.xerxes.session import Session
    from sattrack.safety import Safety


class Doorway(Protocol):
    """Where callers come in."""

    def readers(self) -> list[Any]:
        """Return what to wait for."""

    def writers(self) -> list[Any]:
        """Return what to wait for to take more."""

    def flush(self) -> None:
        """Send what waits, as far as it can be sent now."""


class Station(DriverLike, Protocol):
    """One mount behind a door, until it is told to end and the mount is seen at rest."""

    @property
    def safety(self) -> Safety:
        """What clears its motions."""

    @property
    def session(self) -> Session:
        """The conversation with it."""

    @property
    def link_up(self) -> bool:
        """Whether the mount is heard."""

    @property
    def on_trajectory(self) -> bool:
        """Whether it is where it is to be."""

    @property
    def tripped(self) -> str | None:
        """Name of the interlock that stopped the mount."""

    def repeat(self) -> bytes | None:
        """Return what to send once more before the next datagram, None for nothing."""

    def send_shift_s(self, now_utc_s: float) -> float:
        """Return the delay of the next `tick` beyond one period, seconds of UTC."""

    def end(self, now_utc_s: float) -> None:
        """Bring the mount to rest, and be finished when it is seen there."""


@dataclass(slots=True)
class StationLoop(RealtimeLoop):
    """Serves one mount at one door until `stop` is asked for and the mount is seen at rest."""

    driver: Station
    door: Doorway
    log: Callable[[str], None]
    """Takes lines without their instant."""
    _told_trip: str | None = field(default=None, init=False)
    _told_hold: str | None = field(default=None, init=False)
    _told_link: bool = field(default=False, init=False)

    def readers(self) -> list[Any]:
        """See RealtimeLoop."""
        return self.door.readers()

    def writers(self) -> list[Any]:
        """See RealtimeLoop."""
        return self.door.writers()

    def flush(self) -> None:
        """See RealtimeLoop."""
        self.door.flush()

    def interrupt(self, now_utc_s: float) -> None:
        """See RealtimeLoop."""
        self.driver.end(now_utc_s)

    def fail(self, error: Exception, now_utc_s: float) -> None:
        """See RealtimeLoop."""
        del error
        self.driver.end(now_utc_s)

    def repeat(self) -> None:
        """Send the last datagram once more where the link loses some."""
        self.send_copy(self.driver.repeat)

    def shift_s(self, now_utc_s: float) -> float:
        """See RealtimeLoop."""
        return self.driver.send_shift_s(now_utc_s)

    def tell(self, words: str) -> None:
        """Have the program's own words logged."""
        raise NotImplementedError

    def report_mount(self, way: str, ready_again: str) -> None:
        """Say what has changed of the mount: interlocks, limits, the link.

        `way` is what the caller's positions are called, `ready_again` what makes a stopped mount ready.
        """
        station = self.driver
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
