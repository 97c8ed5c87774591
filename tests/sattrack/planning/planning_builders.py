"""Paths made by formulas, for tests of what is planned on them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sattrack.planning.path import AxisPath, AxisSamples

Array = NDArray[np.float64]


def path_of(utc_s: Array, hour_angle_deg: Array, dec_deg: Array) -> AxisPath:
    """Return a path with rates by differences; Sun and Moon stand at the far side of the equator."""
    far, level = np.full_like(utc_s, 180.0), np.zeros_like(utc_s)
    ha_rate, dec_rate = np.gradient(hour_angle_deg, utc_s), np.gradient(dec_deg, utc_s)
    return AxisPath(
        AxisSamples(utc_s, hour_angle_deg, dec_deg, far, level, far, level),
        ha_rate,
        dec_rate,
        np.gradient(ha_rate, utc_s),
        np.gradient(dec_rate, utc_s),
        np.full_like(utc_s, 45.0),
        level,
        -hour_angle_deg,
    )


def great_circle(speed_deg_s: float, polar_distance_deg: float, half_s: float = 150.0) -> AxisPath:
    """Return a target on a great circle past the north pole, nearest to it at 0 s; steps of 0.05 s."""
    time_s = np.arange(-half_s, half_s, 0.05)
    angle, off = np.radians(speed_deg_s * time_s), np.radians(polar_distance_deg)
    x, y, z = np.cos(angle) * np.sin(off), np.sin(angle), np.cos(angle) * np.cos(off)
    return path_of(time_s, np.degrees(np.unwrap(np.arctan2(y, x))), np.degrees(np.arcsin(z)))
