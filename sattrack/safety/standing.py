"""How the axes stand, the turns of the hour angle counted, by what the mount reports."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from sattrack.mount import SIDEREAL_RATE_DEG_S
from sattrack.safety.geometry import Place

if TYPE_CHECKING:
    from sattrack.mount import MoveAxes


class Stance(NamedTuple):
    """How the mount stands when a request comes: its clock and direction, degrees, and whether it moves."""

    sidereal_deg: float
    ra_deg: float
    dec_deg: float
    slewing: bool
    drives_at_rest: bool
    """Whether both drives report standstill, sidereal tracking not counted as rest."""
    beyond_pole: bool = False


class Standing:
    """Follows one mount's axes; the turns are taken to begin within half a turn of the meridian."""

    def __init__(self, latitude_deg: float) -> None:
        self._latitude_deg = latitude_deg
        self.hour_angle_deg: float | None = None
        """The hour angle axis' angle, turns counted; None before the first status."""
        self.beyond_pole = False
        self._anchor_deg: float | None = None
        """Where the axis stood before the first status, where that is known."""

    def begin_anew(self) -> None:
        """Forget how the first status had the axis stand."""
        self.hour_angle_deg = self._anchor_deg

    def follow_on(self, former: Standing) -> None:
        """Take over how far the cables are wound."""
        self.hour_angle_deg, self.beyond_pole = former.hour_angle_deg, former.beyond_pole
        self._anchor_deg = former.hour_angle_deg

    def note(self, hour_angle_deg: float, beyond_pole: bool) -> None:
        """Take what a status reports."""
        self.beyond_pole = beyond_pole
        self.hour_angle_deg = self.nearest_turn(hour_angle_deg)

    def reported(self, hour_angle_deg: float, dec_deg: float, beyond_pole: bool) -> Place:
        """Return the axes' angles that a status reports, whether that is believed or not."""
        dec_axis = math.copysign(180.0, self._latitude_deg) - dec_deg if beyond_pole else dec_deg
        return Place(self._turned(hour_angle_deg, beyond_pole), dec_axis)

    def nearest_turn(self, hour_angle_deg: float) -> float:
        """Return the hour angle axis' angle that goes with a reported hour angle.

        Beyond the pole the axis stands half a turn from it.
        """
        return self._turned(hour_angle_deg, self.beyond_pole)

    def _turned(self, hour_angle_deg: float, beyond_pole: bool) -> float:
        before = self.hour_angle_deg or 0.0
        axis_deg = hour_angle_deg + (180.0 if beyond_pole else 0.0)
        return before + (axis_deg - before + 180.0) % 360.0 - 180.0

    def place(self, dec_deg: float, ha_deg: float | None = None) -> Place:
        """Return the axes' angles for a reported declination, at the hour angle noted last or a given one."""
        axis = math.copysign(180.0, self._latitude_deg) - dec_deg if self.beyond_pole else dec_deg
        return Place((self.hour_angle_deg or 0.0) if ha_deg is None else ha_deg, axis)

    def of(self, stance: Stance) -> Place:
        """Return the axes' angles as a mount stands."""
        self.beyond_pole = stance.beyond_pole
        return self.place(stance.dec_deg, self.nearest_turn(stance.sidereal_deg - stance.ra_deg))


def axis_rates(move: MoveAxes, beyond_pole: bool) -> tuple[float, float]:
    """Return the rates of the axes, hour angle and declination, that go with reported ones."""
    sense = -1.0 if beyond_pole else 1.0
    return SIDEREAL_RATE_DEG_S - move.ra_rate_deg_s, sense * move.dec_rate_deg_s
