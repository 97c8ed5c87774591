"""A mount as a rotator, with the mount that it leads, as one, without I/O."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sattrack.servers.antenna.led_mount import LedMount
from sattrack.servers.rotctld.rotator import Rotator

if TYPE_CHECKING:
    from sattrack.mount.model import MountProfile
    from sattrack.safety import SafetyLimits
    from sattrack.servers.antenna.sky import Sky


class RotatorStation(LedMount):
    """One mount behind one rotator, until it is told to end and the mount is seen at rest."""

    def __init__(
        self, sky: Sky, profile: MountProfile, limits: SafetyLimits, one_at_a_time: bool = False
    ) -> None:
        self.rotator = Rotator(sky, self, profile.park, one_at_a_time)
        super().__init__(self.rotator, sky, "azel", profile, limits)
