"""What a controller knows of its antenna: what it has, what is heard of it, and its focuser.

"Ideal Field System Antenna Interface", section 6.0. Positions in mm; instants in nanoseconds of UTC.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, NamedTuple, Protocol

from sattrack.servers.antenna.line import Check

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sattrack.servers.antenna.sky import AxisKind, Sky
    from sattrack.servers.antenna.trajectory import AxisRange, AxisState


class AxisPlace(NamedTuple):
    """One axis: where it is to go (None while it sweeps, or nothing was asked), and where it is, if known."""

    commanded_mm: float | None
    actual_mm: float | None


class FocusReport(NamedTuple):
    """All axes of a focuser, the instant at which they were there, and whether any of them moves."""

    axes: tuple[AxisPlace, ...]
    epoch_ns: int
    moving: bool


class Focuser(Protocol):
    """A focuser of one to three axes. No method waits for a motion."""

    @property
    def count(self) -> int:
        """How many axes there are."""

    @property
    def reach_mm(self) -> Sequence[tuple[float, float]]:
        """The least and the greatest place of each axis."""

    def heard(self, utc_ns: int) -> bool:
        """Return whether all of them can take commands at an instant."""

    def move(self, places_mm: Sequence[float | None], utc_ns: int) -> None:
        """Send axes to places within their reach; None leaves an axis as it is."""

    def sweep(self, axis: int, rate_mm_s: float, utc_ns: int) -> None:
        """Send one axis, counted from 0, from limit to limit and back at a uniform rate, up first."""

    def stop(self, utc_ns: int) -> None:
        """Stop all axes."""

    def report(self, utc_ns: int) -> FocusReport:
        """Return where the axes are, as it is known at an instant."""


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
