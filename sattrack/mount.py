"""What the tracker needs of a mount: its profile, what it reports, and what it can be told.

Directions are right ascension and declination in the frame that the mount reports (JNow, its own sidereal
clock), rates are derivatives of those: a right ascension rate of 0 leaves the mount on its sidereal tracking.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import msgspec

SIDEREAL_RATE_DEG_S = 360.0 / 86164.0905
"""Rate of the hour angle of a fixed direction, degrees per second of UTC."""


class AxisLimits(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What one axis can do."""

    max_rate_deg_s: float = 6.0
    max_acceleration_deg_s2: float = 10.0
    slew_rate_deg_s: float = 10.0


class MountProfile(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What is known of one mount. Signs, delays and semantics are measured, never assumed for good.

    `ra_rate_sign` is +1 where a positive MoveAxisRateRA increases the hour angle; `additive` where MoveAxis
    rates add to sidereal tracking; `move_axis` is "held" where the latest rates act while the flag is up.
    Delays are seconds from our send call to the mount's mailbox and from its sample to our socket.
    """

    name: str = "xerxes-default"
    ra: AxisLimits = AxisLimits()
    dec: AxisLimits = AxisLimits()
    ra_rate_sign: Literal[-1, 1] = 1
    dec_rate_sign: Literal[-1, 1] = 1
    additive: bool = True
    move_axis: Literal["held"] = "held"
    hour_angle_limit_deg: float = 200.0
    """How far the hour angle axis may turn either way of the meridian, the cables counted."""
    period_s: float = 0.05
    command_delay_s: float = 0.0003
    status_delay_s: float = 0.0001
    encoder_tics: int = 2**26


@dataclass(frozen=True, slots=True)
class StatusSample:
    """One accepted status of the mount.

    `arrival_utc_s` is ours, `sidereal_h` the mount's own date of the sample (local sidereal hours); the drive
    rates are those of the axes themselves, sidereal tracking included, as the mount tells them.
    """

    counter: int
    arrival_utc_s: float
    sidereal_h: float
    ra_deg: float
    dec_deg: float
    slewing: bool
    does_refraction: bool
    ra_drive_deg_s: float
    dec_drive_deg_s: float


@dataclass(frozen=True, slots=True)
class Hold:
    """Ask for nothing: the mount goes on with what it does by itself, at rest after a stop."""


@dataclass(frozen=True, slots=True)
class SlewTo:
    """Go to a direction and track the sky there."""

    ra_deg: float
    dec_deg: float


@dataclass(frozen=True, slots=True)
class MoveAxes:
    """Move at these rates of the reported right ascension (not times cos Dec) and declination."""

    ra_rate_deg_s: float
    dec_rate_deg_s: float


@dataclass(frozen=True, slots=True)
class Stop:
    """Bring both axes to rest, whatever they do."""


Motion = Hold | SlewTo | MoveAxes | Stop
