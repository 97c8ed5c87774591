"""A satellite's path over one pass in a mount's two axes, with rates and accelerations, and its limits.

The limits' names are those of the interlocks in `sattrack.safety`, which judges single moments with the
distance that the axes need to stop; here the limits themselves count, for whole passes at once.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from sattrack.safety.bounds import UP_DEG
from sattrack.safety.regions import moon_over, sun_over
from tle.instants import Utc

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from sattrack.mount.model import MountProfile, PierZone
    from sattrack.safety.limits import SafetyLimits
    from sattrack.safety.regions import Wanderer
    from tle.bias import Bias
    from tle.propagator import Propagator

    Array = NDArray[np.float64]
    Bools = NDArray[np.bool_]
    Corners = tuple[tuple[float, float], ...]


@dataclass(frozen=True, slots=True)
class Pointing:
    """How a mount's axes stand at instants (POSIX seconds of UTC), with what limits ask for; shape (n,).

    `hour_angle_axis_deg` is counted through turns, as cables count it; the declination axis passes 90° where
    the mount points from beyond the pole. Sun and Moon are those of `sattrack.safety.regions`.
    """

    utc_s: Array
    hour_angle_axis_deg: Array
    dec_axis_deg: Array
    sun_hour_angle_deg: Array
    sun_dec_deg: Array
    moon_hour_angle_deg: Array
    moon_dec_deg: Array

    def at(self, samples: slice | NDArray[Any]) -> Pointing:
        """Return some of the samples, by indices or a mask."""
        return Pointing(*(getattr(self, name)[samples] for name in Pointing.__slots__))


@dataclass(frozen=True, slots=True)
class AxisPath:
    """A target in the axes of a mount at rising instants; degrees and seconds, shape (n,) throughout.

    The axes' rates are those against the mount's base: sidereal tracking included. `sky_rate_deg_s` is the
    speed on the sky in that frame.
    """

    pointing: Pointing
    hour_angle_rate_deg_s: Array
    dec_rate_deg_s: Array
    hour_angle_acceleration_deg_s2: Array
    dec_acceleration_deg_s2: Array
    alt_deg: Array
    az_deg: Array
    ra_deg: Array
    """Right ascension of date of the direction, continuous."""

    @property
    def utc_s(self) -> Array:
        """Instants, POSIX seconds of UTC."""
        return self.pointing.utc_s

    @property
    def sky_rate_deg_s(self) -> Array:
        """Speed on the sky."""
        cos_dec = np.cos(np.radians(self.pointing.dec_axis_deg))
        speed: Array = np.hypot(self.hour_angle_rate_deg_s * cos_dec, self.dec_rate_deg_s)
        return speed

    def at(self, samples: slice | NDArray[np.intp]) -> AxisPath:
        """Return some of the samples."""
        pointing = self.pointing.at(samples)
        return AxisPath(pointing, *(getattr(self, name)[samples] for name in AxisPath.__slots__[1:]))

    def part(self, first: int, after: int) -> AxisPath:
        """Return the samples from one on, up to another that is left out."""
        return self.at(slice(first, after))

    def thinned(self, every: int) -> AxisPath:
        """Return one sample of so many, and the last one."""
        return self.at(np.unique(np.append(np.arange(0, len(self.utc_s), every), len(self.utc_s) - 1)))

    def wound_anew(self) -> AxisPath:
        """Return the same with the cables as a slew to the first sample leaves them: within half a turn."""
        return self.wound(-360.0 * float(np.floor((self.pointing.hour_angle_axis_deg[0] + 180.0) / 360.0)))

    def wound(self, by_deg: float) -> AxisPath:
        """Return the same with the hour angle axis turned on by whole turns, in degrees."""
        p = self.pointing
        return replace(self, pointing=replace(p, hour_angle_axis_deg=p.hour_angle_axis_deg + by_deg))

    def until(self, utc_s: float) -> AxisPath:
        """Return the samples up to an instant."""
        return self.part(0, int(np.searchsorted(self.utc_s, utc_s, side="right")))

    def seen_from(self, beyond_pole: bool, latitude_deg: float) -> AxisPath:
        """Return the same target from a side of the pier, begun within half a turn of the meridian."""
        p = self.pointing
        folded = bool(np.any(np.abs(p.dec_axis_deg[:1]) > 90.0))
        pole_deg = 180.0 if latitude_deg >= 0.0 else -180.0
        if folded == beyond_pole:
            turn, dec, sense = 0.0, p.dec_axis_deg, 1.0
        else:
            turn, dec, sense = 180.0, pole_deg - p.dec_axis_deg, -1.0
        turned = replace(p, hour_angle_axis_deg=p.hour_angle_axis_deg + turn, dec_axis_deg=dec)
        return replace(
            self,
            pointing=turned,
            dec_rate_deg_s=self.dec_rate_deg_s * sense,
            dec_acceleration_deg_s2=self.dec_acceleration_deg_s2 * sense,
        ).wound_anew()


def axis_path(propagator: Propagator, bias: Bias, utc_s: Array) -> AxisPath:
    """Return the way of a satellite at rising instants, three or more, seen from the normal side of the pier.

    Accelerations are differences of the rates. Instants at which SGP4 fails are NaN. Raises TimeRangeError.
    """
    seen: Any = propagator.at(Utc(utc_s), bias)
    hour_angle = np.asarray(seen.ha_deg)
    axis = np.full_like(hour_angle, np.nan)
    good = np.isfinite(hour_angle)
    axis[good] = np.degrees(np.unwrap(np.radians(hour_angle[good])))
    site = propagator.site
    bodies = [body_place_deg(name, site.latitude_deg, site.longitude_deg, utc_s) for name in _OVER]
    ha_rate, dec_rate = np.asarray(seen.ha_rate_deg_s), np.asarray(seen.dec_rate_deg_s)
    return AxisPath(
        Pointing(utc_s, axis, np.asarray(seen.dec_deg), *bodies[0], *bodies[1]),
        ha_rate,
        dec_rate,
        np.gradient(ha_rate, utc_s),
        np.gradient(dec_rate, utc_s),
        np.asarray(seen.alt_deg),
        np.asarray(seen.az_deg),
        np.degrees(np.unwrap(np.radians(seen.ra_deg), axis=0)),
    )


LOOK_S = 120.0
_OVER = {"sun": sun_over, "moon": moon_over}


def body_place_deg(name: str, latitude_deg: float, longitude_deg: float, utc_s: Array) -> tuple[Array, Array]:
    """Return hour angle and declination of the "sun" or the "moon" at rising instants, degrees.

    Interpolated between looks two minutes apart, in which the sky turns by half a degree: good to 8″.
    """
    first, last = int(utc_s[0] // LOOK_S), int(utc_s[-1] // LOOK_S) + 1
    seen = np.array([_look(name, latitude_deg, longitude_deg, look) for look in range(first, last + 1)])
    looks = LOOK_S * np.arange(first, last + 1)
    x, y, z = (np.interp(utc_s, looks, seen[:, k]) for k in range(3))
    return np.degrees(np.arctan2(y, x)), np.degrees(np.arctan2(z, np.hypot(x, y)))


@lru_cache(maxsize=16384)
def _look(name: str, latitude_deg: float, longitude_deg: float, look: int) -> tuple[float, float, float]:
    """Return a body's unit vector at a whole number of LOOK_S; many passes of a night share it."""
    body = _over(name, latitude_deg, longitude_deg).at(look * LOOK_S)
    return body.x, body.y, body.z


@lru_cache(maxsize=16)
def _over(name: str, latitude_deg: float, longitude_deg: float) -> Wanderer:
    return _OVER[name](latitude_deg, longitude_deg)


def stretches(mask: Bools) -> list[tuple[int, int]]:
    """Return the first and the last index of each run of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return [(int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _altitude_deg(hour_angle_deg: Array, dec_deg: Array, latitude_deg: float) -> Array:
    h, d = np.radians(hour_angle_deg), np.radians(dec_deg)
    p = np.radians(latitude_deg)
    sine = np.sin(p) * np.sin(d) + np.cos(p) * np.cos(d) * np.cos(h)
    return np.asarray(np.degrees(np.arcsin(np.clip(sine, -1.0, 1.0))))


def _azimuth_deg(pointing: Pointing, latitude_deg: float) -> Array:
    """Return the azimuth of where the axes point, from north through east, 0 to below 360 degrees."""
    h, d = np.radians(pointing.hour_angle_axis_deg), np.radians(pointing.dec_axis_deg)
    p = np.radians(latitude_deg)
    east = -np.cos(d) * np.sin(h)
    north = np.cos(p) * np.sin(d) - np.sin(p) * np.cos(d) * np.cos(h)
    return np.asarray(np.degrees(np.arctan2(east, north)) % 360.0)


def _separation_deg(pointing: Pointing, hour_angle_deg: Array, dec_deg: Array) -> Array:
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
    altitude = _altitude_deg(pointing.hour_angle_axis_deg, pointing.dec_axis_deg, latitude_deg)
    low, high = profile.dec_axis_limits_deg
    found = {
        "altitude": altitude - limits.floor_altitude_deg,
        "hour_angle": profile.hour_angle_limit_deg - np.abs(pointing.hour_angle_axis_deg),
        "declination": np.minimum(pointing.dec_axis_deg - low, high - pointing.dec_axis_deg),
    }
    if limits.horizon:
        azimuth = _azimuth_deg(pointing, latitude_deg)
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
            apart = _separation_deg(pointing, hour_angle, dec) - cone_deg
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
