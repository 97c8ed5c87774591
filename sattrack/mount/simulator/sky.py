"""From axes to directions and back: the mount's sidereal clock, syncs, refraction, the side of the pole.

Degrees throughout; directions are right ascension and declination in the frame that the mount reports. Hour
angle and declination axis stand at 0 on the meridian and the equator. Declination axis angles beyond 90°
either way are beyond the pole: the same direction as the supplement, with the hour angle half a turn on.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from sattrack.core.angles import wrap180
from sattrack.mount.model import mean_sidereal_deg

if TYPE_CHECKING:
    from sattrack.mount.simulator.profile import SimulatorProfile


def wrapped(angle_deg: float) -> float:
    """Return an angle's equal from -180 up to and including 180: what an encoder shows at power-up."""
    angle_deg = math.remainder(angle_deg, 360.0)
    return 180.0 if angle_deg == -180.0 else angle_deg


def is_beyond_pole(dec_axis_deg: float) -> bool:
    """Tell whether the declination axis stands past a pole."""
    return not (-90.0 <= dec_axis_deg <= 90.0 or abs(math.remainder(dec_axis_deg, 360.0)) <= 90.0)


def direction(hour_angle_deg: float, dec_axis_deg: float) -> tuple[float, float]:
    """Return hour angle and declination (-90 to 90) of the direction in which two axes point."""
    if -90.0 <= dec_axis_deg <= 90.0:
        return hour_angle_deg, dec_axis_deg
    dec_deg = wrapped(dec_axis_deg)
    if abs(dec_deg) <= 90.0:
        return hour_angle_deg, dec_deg
    return hour_angle_deg + 180.0, math.copysign(180.0, dec_deg) - dec_deg


def axes_beyond_pole(hour_angle_deg: float, dec_deg: float, latitude_deg: float) -> tuple[float, float]:
    """Return the axes that point to a direction from beyond the elevated pole, hour angle by half a turn."""
    pole = 180.0 if latitude_deg >= 0.0 else -180.0
    return wrapped(hour_angle_deg + 180.0), pole - dec_deg


def horizontal(hour_angle_deg: float, dec_deg: float, latitude_deg: float) -> tuple[float, float]:
    """Return altitude and azimuth (from north through east)."""
    h, d, p = math.radians(hour_angle_deg), math.radians(dec_deg), math.radians(latitude_deg)
    sin_d, cos_d, sin_p, cos_p = math.sin(d), math.cos(d), math.sin(p), math.cos(p)
    south = cos_d * math.cos(h)
    east = -cos_d * math.sin(h)
    north = cos_p * sin_d - sin_p * south
    up = sin_p * sin_d + cos_p * south
    return (
        math.degrees(math.atan2(up, math.hypot(east, north))),
        math.degrees(math.atan2(east, north)) % 360.0,
    )


def equatorial(altitude_deg: float, azimuth_deg: float, latitude_deg: float) -> tuple[float, float]:
    """Return hour angle and declination of a direction given by altitude and azimuth."""
    a, z, p = (math.radians(x) for x in (altitude_deg, azimuth_deg, latitude_deg))
    west = -math.cos(a) * math.sin(z)
    south = math.sin(p) * math.cos(a) * math.cos(z) - math.cos(p) * math.sin(a)
    pole = math.cos(p) * math.cos(a) * math.cos(z) + math.sin(p) * math.sin(a)
    return math.degrees(math.atan2(west, -south)), math.degrees(math.atan2(pole, math.hypot(west, south)))


LOWEST_DEG = -1.0
"""Refraction is not counted below: its formula ends there."""


def airless(hour_angle_deg: float, dec_deg: float, latitude_deg: float) -> tuple[float, float]:
    """Return the direction that light came from before the air bent it to where the axes point."""
    altitude_deg, azimuth_deg = horizontal(hour_angle_deg, dec_deg, latitude_deg)
    return equatorial(altitude_deg - refraction_deg(altitude_deg), azimuth_deg, latitude_deg)


def refracted(hour_angle_deg: float, dec_deg: float, latitude_deg: float) -> tuple[float, float]:
    """Return where the axes must point for a direction given without air: the inverse of `airless`."""
    altitude_deg, azimuth_deg = horizontal(hour_angle_deg, dec_deg, latitude_deg)
    apparent_deg = altitude_deg
    for _ in range(12):
        apparent_deg = altitude_deg + refraction_deg(apparent_deg)
    return equatorial(apparent_deg, azimuth_deg, latitude_deg)


def refraction_deg(apparent_altitude_deg: float) -> float:
    """Return the refraction at an apparent altitude, degrees, at 1010 hPa and 10 °C (Bennett 1982)."""
    if apparent_altitude_deg < LOWEST_DEG:
        return 0.0
    h = apparent_altitude_deg
    return max(0.0, 1.0 / math.tan(math.radians(h + 7.31 / (h + 4.4))) / 60.0)


@dataclass(slots=True)
class SimulatedSky:
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

        The hour angle axis lies within half a turn of the meridian, even where the cables allow more.
        """
        hour_angle_deg = self.sidereal_deg - (ra_deg - self._shift_ra_deg)
        hour_angle_deg, dec_deg = direction(hour_angle_deg, dec_deg - self._shift_dec_deg)
        if self.hardware.does_refraction:
            hour_angle_deg, dec_deg = refracted(hour_angle_deg, dec_deg, self.latitude_deg)
        hour_angle_deg = wrap180(hour_angle_deg)
        flip = self.hardware.flip
        if (flip == "hour_angle" and hour_angle_deg > 0.0) or (flip == "ascom" and hour_angle_deg < 0.0):
            return axes_beyond_pole(hour_angle_deg, dec_deg, self.latitude_deg)
        return hour_angle_deg, dec_deg

    def _unshifted(self, hour_angle_axis_deg: float, dec_axis_deg: float) -> tuple[float, float]:
        hour_angle_deg, dec_deg = direction(hour_angle_axis_deg, dec_axis_deg)
        if self.hardware.does_refraction:
            return airless(hour_angle_deg, dec_deg, self.latitude_deg)
        return hour_angle_deg, dec_deg
