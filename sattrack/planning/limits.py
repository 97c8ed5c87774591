"""How near a mount's axes are to each limit of the site and the mount, as arrays."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from sattrack.mount import MountProfile
    from sattrack.planning.path import Pointing
    from sattrack.safety import SafetyLimits

    Array = NDArray[np.float64]


def altitude_deg(pointing: Pointing, latitude_deg: float) -> Array:
    """Return the altitude of where the axes point, without regard to air; degrees."""
    h, d = np.radians(pointing.hour_angle_axis_deg), np.radians(pointing.dec_axis_deg)
    p = np.radians(latitude_deg)
    sine = np.sin(p) * np.sin(d) + np.cos(p) * np.cos(d) * np.cos(h)
    return np.asarray(np.degrees(np.arcsin(np.clip(sine, -1.0, 1.0))))


def sun_separation_deg(pointing: Pointing) -> Array:
    """Return the distance on the sky between where the axes point and the Sun's centre, degrees."""
    h, d = np.radians(pointing.hour_angle_axis_deg), np.radians(pointing.dec_axis_deg)
    k, s = np.radians(pointing.sun_hour_angle_deg), np.radians(pointing.sun_dec_deg)
    cosine = np.sin(d) * np.sin(s) + np.cos(d) * np.cos(s) * np.cos(h - k)
    return np.asarray(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))


def margins_deg(
    pointing: Pointing, profile: MountProfile, limits: SafetyLimits, latitude_deg: float
) -> dict[str, Array]:
    """Return by limit how far inside it the axes stand, degrees; negative outside.

    The names are those of the interlocks in `safety`.
    """
    return {
        "altitude": altitude_deg(pointing, latitude_deg) - limits.floor_altitude_deg,
        "hour_angle": profile.hour_angle_limit_deg - np.abs(pointing.hour_angle_axis_deg),
    }
