"""What a manual console shows, as immutable states: every field of the mount's status, and what was asked."""

from __future__ import annotations

import msgspec

from sattrack.mount.model import Readings, Status
from sattrack.views.run import LinkView


class AskedView(msgspec.Struct, frozen=True):
    """One thing that was asked of the mount, and how far it has come."""

    number: int
    what: str
    state: str
    acknowledged: bool
    settled: bool
    reason: str | None
    utc_s: float
    """When it was asked."""


class ConsoleView(msgspec.Struct, frozen=True, tag="console"):
    """A mount under manual operation at one instant; UTC as POSIX seconds, directions in degrees of date."""

    utc_s: float
    mount: str
    profile: str
    move_axis: str
    """How the profile has MoveAxis rates read: "held" or "edge"."""
    doing: str
    """What is under way, in words; "idle" where nothing of ours is."""
    motion: str
    """The motion that is wanted: "none", "slew", "move" or "stop"."""
    at_rest: bool
    """Whether the mount stands, sidereal tracking counted as standing."""
    status: Status | None
    """The last one, every field by the name and in the unit of the protocol's table."""
    readings: Readings
    hour_angle_deg: float | None
    clock_offset_s: float | None
    """The mount's sidereal clock ahead of local mean sidereal time by our UTC; null without a site."""
    ra_rate_deg_s: float
    dec_rate_deg_s: float
    """What MoveAxis is asked for: rates of the reported direction, right ascension not times cos Dec."""
    max_ra_rate_deg_s: float
    max_dec_rate_deg_s: float
    guide_rate_deg_s: float | None
    floor_altitude_deg: float
    can_park: bool
    link: LinkView
    stranger_hosts: tuple[str, ...]
    asked: tuple[AskedView, ...]
    """The last ones, the newest last."""
    refusal: str | None
    """Why the last thing that the operator wanted was not done."""
    tripped: str | None
    """The safety limit that stopped the mount."""
    warnings: tuple[str, ...]
