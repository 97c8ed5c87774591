"""A rotator beside the other protocols' telescope: one mount, moved by one of them at a time. No I/O.

Clients of rotctld always see the mount. Their positions move it while nothing else does, by a path driver of
their own, and until somebody stops it: a rotator stays where it was sent.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from sattrack.servers.antenna.equipment import Feedback
from sattrack.servers.antenna.led_mount import PathDriver, park_direction
from sattrack.servers.rotctld.rotator import Rotator

if TYPE_CHECKING:
    from collections.abc import Callable

    from sattrack.mount.model import MountProfile
    from sattrack.safety import Safety, SafetyLimits
    from sattrack.servers.antenna.trajectory import AxisState, SiteSky


class SharedRotator(Feedback):
    """`why_busy` tells why clients may not command the mount now; None where they may.

    Whoever owns it sets `link_up` and `tripped` to what is so of the mount.
    """

    def __init__(
        self,
        sky: SiteSky,
        profile: MountProfile,
        limits: SafetyLimits,
        why_busy: Callable[[], str | None],
    ) -> None:
        self.rotator = Rotator(sky, self, park_direction(profile), why_busy=why_busy)
        self.driver: PathDriver | None = None
        """What moves the mount to clients' positions; None while they do not."""
        self._made = sky, profile, limits
        self._listener = self._new()

    @property
    def wants_mount(self) -> bool:
        """Whether a client has sent a position, and nothing moves the mount to it yet."""
        return self.driver is None and self.rotator.path is not None

    def receive(self, data: bytes, arrival_utc_s: float) -> None:
        """Take one datagram from the mount."""
        self._listener.receive(data, arrival_utc_s)
        if self.driver is not None:
            self.driver.receive(data, arrival_utc_s)

    def actual(self, utc_ns: int) -> AxisState | None:
        """See Feedback."""
        here = None if self.driver is None else self.driver.actual(utc_ns)
        return here or self._listener.actual(utc_ns)

    def begin(self, former: Safety, heard: tuple[bytes, float] | None) -> None:
        """Keep the mount at clients' positions from now on; `heard` is its last datagram, dated."""
        self.driver = self._new()
        self.driver.safety.follow_on(former)
        if heard is not None:
            self.driver.receive(*heard)

    def leave(self) -> PathDriver | None:
        """Return the driver of a mount that was stopped and is at rest, which is let go; None for none."""
        driver = self.driver
        if driver is None or self.rotator.path is not None or self.rotator.reset_asked:
            return None
        if not driver.rests:
            return None
        self.driver = None
        return driver

    def _new(self) -> PathDriver:
        sky, profile, limits = self._made
        return PathDriver(self.rotator, sky, "azel", profile, limits)
