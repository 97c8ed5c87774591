"""How the axes stand, the turns of the hour angle counted, by what the mount reports."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from sattrack.mount.model import SIDEREAL_RATE_DEG_S
from sattrack.safety.geometry import Place

if TYPE_CHECKING:
    from sattrack.mount.model import MoveAxes, Stance


class MountState:
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

    def follow_on(self, former: MountState) -> None:
        """Take over how far the cables are wound."""
        self.hour_angle_deg, self.beyond_pole = former.hour_angle_deg, former.beyond_pole
        self._anchor_deg = former.hour_angle_deg

    def take(self, place: Place, beyond_pole: bool) -> None:
        """Take a place for where the axes stand."""
        self.hour_angle_deg, self.beyond_pole = place.ha_deg, beyond_pole

    def place(self, hour_angle_deg: float, dec_deg: float, beyond_pole: bool) -> Place:
        """Return the axes' angles that go with a reported direction, the hour angle within half a turn.

        Beyond the pole the hour angle axis stands half a turn from the reported hour angle.
        """
        before = self.hour_angle_deg or 0.0
        axis_deg = hour_angle_deg + (180.0 if beyond_pole else 0.0)
        dec_axis_deg = math.copysign(180.0, self._latitude_deg) - dec_deg if beyond_pole else dec_deg
        return Place(before + (axis_deg - before + 180.0) % 360.0 - 180.0, dec_axis_deg)

    def of(self, stance: Stance) -> Place:
        """Return the axes' angles as a mount stands."""
        return self.place(stance.sidereal_deg - stance.ra_deg, stance.dec_deg, stance.beyond_pole)


def standing_at(stance: Stance, place: Place) -> Stance:
    """Return how a mount would stand with its axes at another place."""
    ha, dec = place.ha_deg, math.remainder(place.dec_deg, 360.0)
    beyond_pole = abs(dec) > 90.0
    if beyond_pole:
        ha, dec = ha - 180.0, math.copysign(180.0, dec) - dec
    return stance._replace(ra_deg=stance.sidereal_deg - ha, dec_deg=dec, beyond_pole=beyond_pole)


def axis_rates(move: MoveAxes, beyond_pole: bool) -> tuple[float, float]:
    """Return the rates of the axes, hour angle and declination, that go with reported ones."""
    sense = -1.0 if beyond_pole else 1.0
    return SIDEREAL_RATE_DEG_S - move.ra_rate_deg_s, sense * move.dec_rate_deg_s
