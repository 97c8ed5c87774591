"""What a controller is told of its antenna: what it has, and what is heard of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, NamedTuple

from sattrack.servers.antenna.line import Check

if TYPE_CHECKING:
    from sattrack.servers.antenna.focuser import Focuser
    from sattrack.servers.antenna.sky import AxisKind, Sky
    from sattrack.servers.antenna.trajectory import AxisRange, AxisState


class Sensors(NamedTuple):
    """What the antenna's sensors say; None where there is none."""

    first_tilt_deg: float | None = None
    second_tilt_deg: float | None = None
    first_drive_a: float | None = None
    second_drive_a: float | None = None


class Feedback:
    """What the controller hears of its antenna; this one hears nothing."""

    link_up = False
    on_trajectory = False
    """Whether the antenna is where its trajectory is."""
    outside_limits = False
    """Whether the trajectory leads where the limits do not let the antenna go."""
    tripped: str | None = None
    """Name of the interlock that has stopped the antenna."""
    does_refraction = False
    sensors: Sensors | None = None

    def actual(self, utc_ns: int) -> AxisState | None:
        """Return where the axes are at an instant; None where that is not known."""
        del utc_ns
        return None


@dataclass(frozen=True, slots=True)
class Antenna:
    """What the antenna has. Positions are those of its axes, degrees."""

    sky: Sky
    axes: AxisKind
    range: AxisRange
    stow: tuple[float, float] | None = None
    service: tuple[float, float] | None = None
    focuser: Focuser | None = None
    refraction: Literal["auto", "on", "off"] = "auto"
    """Whether satellites' directions are raised by the air; auto: where the mount does not do it."""
    check: Check = Check.SUM
