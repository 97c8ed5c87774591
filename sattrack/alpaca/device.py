"""What is said of a telescope before anything is asked of its mount, and what its profile lets it do."""

from __future__ import annotations

import uuid
from dataclasses import dataclass
from typing import TYPE_CHECKING

from sattrack.mount import SIDEREAL_RATE_DEG_S

if TYPE_CHECKING:
    from sattrack.mount import MountProfile
    from tle.site import Site

MAKER = "sattrack"
GERMAN, POLAR = 2, 1


@dataclass(frozen=True, slots=True)
class Device:
    """One telescope: its mount's profile, where it stands, and how it is told from others."""

    profile: MountProfile
    site: Site
    mount: str
    """What `--mount` says."""
    version: str
    host: str
    """Which computer serves it."""

    @property
    def name(self) -> str:
        """What it is called."""
        return f"{MAKER}: {self.profile.name}"

    @property
    def description(self) -> str:
        """What it is."""
        return f"mount {self.profile.name} at {self.mount}, driven by {MAKER}"

    @property
    def info(self) -> str:
        """What drives it."""
        return f"{MAKER} {self.version}, Xerxes mount control protocol"

    @property
    def unique_id(self) -> str:
        """What tells it from every other telescope, and stays the same."""
        return str(uuid.uuid5(uuid.NAMESPACE_URL, f"{MAKER}:{self.host}:{self.mount}"))

    @property
    def alignment(self) -> int:
        """The AlignmentMode: only a mount that changes sides is told as a German one."""
        return GERMAN if self.profile.pier_rule == "hour_angle" else POLAR

    def max_rate_deg_s(self, axis: int) -> float:
        """Return how fast an axis may be told to turn; 0 for one that there is not.

        The hour angle axis' rate replaces the sidereal one, and the mount adds to that what it is told.
        """
        if axis == 0:
            return max(0.0, self.profile.ra.max_rate_deg_s - SIDEREAL_RATE_DEG_S)
        return self.profile.dec.max_rate_deg_s if axis == 1 else 0.0

    def destination_side(self, hour_angle_deg: float) -> int:
        """Return on which side of the pier a slew to an hour angle (±180) ends: 1 is beyond the pole."""
        return int(self.profile.pier_rule == "hour_angle" and hour_angle_deg > 0.0)
