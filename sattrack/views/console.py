"""What a manual console shows, as immutable states: every field of the mount's status, and what was asked."""

from __future__ import annotations

import msgspec

from sattrack.views.run import LinkView


class StatusView(msgspec.Struct, frozen=True):
    """The last status of the mount, every field by the name and in the unit of the protocol's table.

    A number that the mount sends as infinite, or as none, is null.
    """

    altitude_deg: float | None
    azimuth_deg: float | None
    dec_deg: float
    dec_rate_dtics_s: float
    ra_h: float
    ra_rate_dtics_s: float
    sidereal_h: float
    site_height_m: float | None
    site_latitude_deg: float | None
    site_longitude_deg: float | None
    target_dec_deg: float | None
    target_ra_h: float | None
    counter: int
    dec_guide_rate_dtics_s: float | None
    ra_guide_rate_dtics_s: float | None
    dec_current_10ma: int
    ra_current_10ma: int
    at_home: bool
    at_park: bool
    connected: bool
    does_refraction: bool
    equatorial_system: int
    pulse_guiding: bool
    side_of_pier: bool
    slewing: bool
    tracking: bool
    tracking_rate: int
    ack_move_dec: bool
    ack_move_ra: bool
    utc_1: int
    utc_2: int
    utc_3: int
    ra_drive_status_1: int
    ra_drive_status_2: int
    dec_drive_status_1: int
    dec_drive_status_2: int
    ack_abort: bool
    ack_sync: bool
    ack_pulse_guide: bool
    ack_slew: bool
    spare: int


class ReadingsView(msgspec.Struct, frozen=True):
    """How this mount reads what the protocol's paper gives two readings; null where it has not shown yet."""

    dec_rate_dtics_s: str | None = None
    ra_rate_dtics_s: str | None = None
    counter: str | None = None
    dec_guide_rate_dtics_s: str | None = None
    ra_guide_rate_dtics_s: str | None = None
    tracking: str | None = None
    """"always true", or "the opposite of slewing"."""


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
    status: StatusView | None
    readings: ReadingsView
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
