"""How near a mount's axes are to each limit of the site and the mount, as arrays; for whole passes at once.

The names are those of the interlocks in `sattrack.safety`, which judges single moments with the way that the
axes need to stop; here the limits themselves count.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from sattrack.safety.bounds import UP_DEG

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from sattrack.mount.model import MountProfile, PierZone
    from sattrack.planning.path import Pointing
    from sattrack.safety.limits import SafetyLimits

    Array = NDArray[np.float64]
    Corners = tuple[tuple[float, float], ...]


def altitude_deg(pointing: Pointing, latitude_deg: float) -> Array:
    """Return the altitude of where the axes point, without regard to air; degrees."""
    return _altitude_deg(pointing.hour_angle_axis_deg, pointing.dec_axis_deg, latitude_deg)


def _altitude_deg(hour_angle_deg: Array, dec_deg: Array, latitude_deg: float) -> Array:
    h, d = np.radians(hour_angle_deg), np.radians(dec_deg)
    p = np.radians(latitude_deg)
    sine = np.sin(p) * np.sin(d) + np.cos(p) * np.cos(d) * np.cos(h)
    return np.asarray(np.degrees(np.arcsin(np.clip(sine, -1.0, 1.0))))


def azimuth_deg(pointing: Pointing, latitude_deg: float) -> Array:
    """Return the azimuth of where the axes point, from north through east, 0 to below 360 degrees."""
    h, d = np.radians(pointing.hour_angle_axis_deg), np.radians(pointing.dec_axis_deg)
    p = np.radians(latitude_deg)
    east = -np.cos(d) * np.sin(h)
    north = np.cos(p) * np.sin(d) - np.sin(p) * np.cos(d) * np.cos(h)
    return np.asarray(np.degrees(np.arctan2(east, north)) % 360.0)


def separation_deg(pointing: Pointing, hour_angle_deg: Array, dec_deg: Array) -> Array:
    """Return the distance on the sky between where the axes point and other directions, degrees."""
    h, d = np.radians(pointing.hour_angle_axis_deg), np.radians(pointing.dec_axis_deg)
    k, s = np.radians(hour_angle_deg), np.radians(dec_deg)
    cosine = np.sin(d) * np.sin(s) + np.cos(d) * np.cos(s) * np.cos(h - k)
    return np.asarray(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))


def skyline_deg(azimuths_deg: Array, limits: SafetyLimits) -> Array:
    """Return the least altitude at azimuths: the floor, and the horizon where that is higher."""
    floor = np.full(np.shape(azimuths_deg), limits.floor_altitude_deg)
    if not limits.horizon:
        return floor
    azimuths = np.array([point[0] for point in limits.horizon])
    altitudes = np.array([point[1] for point in limits.horizon])
    around = np.concatenate([azimuths[-1:] - 360.0, azimuths, azimuths[:1] + 360.0])
    heights = np.concatenate([altitudes[-1:], altitudes, altitudes[:1]])
    return np.asarray(np.maximum(floor, np.interp(azimuths_deg, around, heights)))


def margins_deg(
    pointing: Pointing, profile: MountProfile, limits: SafetyLimits, latitude_deg: float
) -> dict[str, Array]:
    """Return by limit how far inside it the axes stand, degrees; negative outside."""
    altitude = altitude_deg(pointing, latitude_deg)
    low, high = profile.dec_axis_limits_deg
    found = {
        "altitude": altitude - limits.floor_altitude_deg,
        "hour_angle": profile.hour_angle_limit_deg - np.abs(pointing.hour_angle_axis_deg),
        "declination": np.minimum(pointing.dec_axis_deg - low, high - pointing.dec_axis_deg),
    }
    if limits.horizon:
        azimuth = azimuth_deg(pointing, latitude_deg)
        found["horizon"] = altitude - skyline_deg(azimuth, limits)
    if profile.pier_zones:
        found["pier"] = _clear_of_pier_deg(pointing, profile.pier_zones)
    # Below the horizon a body does no harm.
    cones = (
        ("sun", limits.sun_deg, pointing.sun_hour_angle_deg, pointing.sun_dec_deg),
        ("moon", limits.moon_cone_deg, pointing.moon_hour_angle_deg, pointing.moon_dec_deg),
    )
    for name, cone_deg, hour_angle, dec in cones:
        if cone_deg > 0.0:
            apart = separation_deg(pointing, hour_angle, dec) - cone_deg
            height = _altitude_deg(hour_angle, dec, latitude_deg)
            found[name] = np.where(height > UP_DEG, apart, np.inf)
    return found


def _clear_of_pier_deg(pointing: Pointing, zones: tuple[PierZone, ...]) -> Array:
    """Return the distance to the nearest zone's edge, in degrees of axis angles; negative within one."""
    hour_angle, dec = pointing.hour_angle_axis_deg, pointing.dec_axis_deg
    least = np.full(np.shape(hour_angle), np.inf)
    for zone in zones:
        for corners in _axis_polygons(zone):
            # A polygon is met wherever whole turns of the axes lead to.
            middle = np.mean(np.array(corners), axis=0)
            x = hour_angle - 360.0 * np.round((hour_angle - middle[0]) / 360.0)
            y = dec - 360.0 * np.round((dec - middle[1]) / 360.0)
            least = np.minimum(least, _outside_deg(x, y, corners))
    return least


def _axis_polygons(zone: PierZone) -> list[Corners]:
    """Return a zone's polygons in angles of the axes, one for each side of the pier that it holds on."""
    found: list[Corners] = []
    if zone.side != "beyond_pole":
        found.append(zone.corners)
    if zone.side != "normal":
        found.append(tuple((ha + 180.0, 180.0 - dec) for ha, dec in zone.corners))
    return found


def _outside_deg(x: Array, y: Array, corners: Corners) -> Array:
    """Return the distance of points from a polygon's edge, negative inside."""
    inside = np.zeros(np.shape(x), dtype=bool)
    nearest = np.full(np.shape(x), np.inf)
    for (x1, y1), (x2, y2) in zip(corners, (*corners[1:], corners[0]), strict=True):
        dx, dy = x2 - x1, y2 - y1
        along = np.clip(((x - x1) * dx + (y - y1) * dy) / max(dx * dx + dy * dy, 1e-30), 0.0, 1.0)
        nearest = np.minimum(nearest, np.hypot(x - x1 - along * dx, y - y1 - along * dy))
        if dy:
            inside ^= ((y1 > y) != (y2 > y)) & (x < x1 + (y - y1) / dy * dx)
    return np.where(inside, -nearest, nearest)
