"""What the mount makes of its axes: its own sidereal clock, syncs, refraction, the side of the pole.

Directions are right ascension and declination in the frame that the mount reports, degrees; axes stand at 0
on the meridian and the equator, and beyond ±90° of declination they are past a pole.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from sattrack.mount.model import mean_sidereal_deg
from sattrack.mount.simulator.pointing import (
    airless,
    axes_beyond_pole,
    direction,
    refracted,
)

if TYPE_CHECKING:
    from sattrack.mount.simulator.settings import SimulatorProfile


@dataclass(slots=True)
class Sky:
    """The mount's view of the sky at one instant; `set_clock` moves it on.

    The clock starts `offset_s` ahead of UTC and drifts by the hardware's `clock_drift_ppm` from then on.
    """

    latitude_deg: float
    longitude_deg: float
    hardware: SimulatorProfile
    offset_s: float
    sidereal_deg: float = 0.0
    """Local sidereal time by the mount's clock."""
    _begun_s: float | None = None
    _shift_ra_deg: float = 0.0
    _shift_dec_deg: float = 0.0

    def set_clock(self, now_utc_s: float) -> None:
        """Let the mount's clock show what it does at an instant of UTC."""
        if self._begun_s is None:
            self._begun_s = now_utc_s
        drift_s = (now_utc_s - self._begun_s) * self.hardware.clock_drift_ppm * 1e-6
        self.sidereal_deg = mean_sidereal_deg(now_utc_s + self.offset_s + drift_s, self.longitude_deg)

    def forget_sync(self) -> None:
        """Report the encoders' coordinates again."""
        self._shift_ra_deg = self._shift_dec_deg = 0.0

    def reported(self, hour_angle_axis_deg: float, dec_axis_deg: float) -> tuple[float, float]:
        """Return the right ascension (0 to 360) and declination that two axes are reported as."""
        hour_angle_deg, dec_deg = self._unshifted(hour_angle_axis_deg, dec_axis_deg)
        ra_deg = self.sidereal_deg - hour_angle_deg
        if self._shift_ra_deg or self._shift_dec_deg:
            turn_deg, dec_deg = direction(0.0, dec_deg + self._shift_dec_deg)
            ra_deg += self._shift_ra_deg + turn_deg
        return ra_deg % 360.0, dec_deg

    def sync(self, ra_deg: float, dec_deg: float, hour_angle_axis_deg: float, dec_axis_deg: float) -> None:
        """Report the axes as they stand as a direction from now on."""
        hour_angle_deg, unshifted_dec_deg = self._unshifted(hour_angle_axis_deg, dec_axis_deg)
        self._shift_ra_deg = math.remainder(ra_deg - (self.sidereal_deg - hour_angle_deg), 360.0)
        self._shift_dec_deg = dec_deg - unshifted_dec_deg

    def axes(self, ra_deg: float, dec_deg: float) -> tuple[float, float]:
        """Return the axes that a slew to a reported direction ends at.

        The hour angle axis lies within half a turn of the meridian, whatever the cables would allow.
        """
        hour_angle_deg = self.sidereal_deg - (ra_deg - self._shift_ra_deg)
        hour_angle_deg, dec_deg = direction(hour_angle_deg, dec_deg - self._shift_dec_deg)
        if self.hardware.does_refraction:
            hour_angle_deg, dec_deg = refracted(hour_angle_deg, dec_deg, self.latitude_deg)
        hour_angle_deg = (hour_angle_deg + 180.0) % 360.0 - 180.0
        if self.hardware.flip == "hour_angle" and hour_angle_deg > 0.0:
            return axes_beyond_pole(hour_angle_deg, dec_deg, self.latitude_deg)
        return hour_angle_deg, dec_deg

    def _unshifted(self, hour_angle_axis_deg: float, dec_axis_deg: float) -> tuple[float, float]:
        hour_angle_deg, dec_deg = direction(hour_angle_axis_deg, dec_axis_deg)
        if self.hardware.does_refraction:
            return airless(hour_angle_deg, dec_deg, self.latitude_deg)
        return hour_angle_deg, dec_deg
