"""A mount as an antenna: the controller, and the mount that it leads, as one, without I/O.

Datagrams from the mount and bytes from antcn go in with their instants; datagrams and answers come out.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from sattrack.servers.antenna.controller import Controller
from sattrack.servers.antenna.led_mount import DEC_LIMIT_DEG, PathDriver, axis_range
from sattrack.servers.antenna.trajectory import to_ns

if TYPE_CHECKING:
    from sattrack.mount.model import MountProfile
    from sattrack.safety import SafetyLimits
    from sattrack.servers.antenna.equipment import Antenna

__all__ = ["DEC_LIMIT_DEG", "Station", "axis_range"]


class Station(PathDriver):
    """One mount behind one controller, until it is told to end and the mount is seen at rest."""

    def __init__(self, antenna: Antenna, profile: MountProfile, limits: SafetyLimits) -> None:
        self.antenna = antenna
        self.controller = Controller(antenna, self)
        super().__init__(self.controller, antenna.sky, antenna.axes, profile, limits)

    def receive_command(self, data: bytes, now_utc_s: float) -> tuple[bytes, bool]:
        """Take bytes from antcn; return what to send, and whether to drop what still waits to be sent."""
        answer = self.controller.receive(data, to_ns(now_utc_s + self.clock_ahead_s))
        if self.controller.time_step_ns:
            self._set_clock(self.controller.time_step_ns / 1e9)
            self.controller.time_step_ns = 0
        return answer

    def _set_clock(self, step_s: float) -> None:
        """Begin anew with what depends on the clock; how far the cables are wound is kept."""
        self.clock_ahead_s += step_s
        self._follower = self._make_follower()
        if self.safety.tripped is None:
            before, self.safety = self.safety, self._make_safety(self.profile)
            self.safety.follow_on(before)
