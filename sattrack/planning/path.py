"""A satellite's way over one pass in a mount's two axes, with rates and accelerations, as arrays."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from sattrack.safety.bodies import moon_over, sun_over
from tle.instants import Utc

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from sattrack.safety.bodies import Wanderer
    from tle.bias import Bias
    from tle.propagator import Propagator

    Array = NDArray[np.float64]
    Bools = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Pointing:
    """How a mount's axes stand at instants (POSIX seconds of UTC), with what limits ask for; shape (n,).

    `hour_angle_axis_deg` is counted through turns, as cables count it; the declination axis passes 90° where
    the mount points from beyond the pole. Sun and Moon are those of `sattrack.safety.bodies`.
    """

    utc_s: Array
    hour_angle_axis_deg: Array
    dec_axis_deg: Array
    sun_hour_angle_deg: Array
    sun_dec_deg: Array
    moon_hour_angle_deg: Array
    moon_dec_deg: Array


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

    def part(self, first: int, after: int) -> AxisPath:
        """Return the samples from one on, up to another that is left out."""
        cut = slice(first, after)
        return AxisPath(
            Pointing(*(getattr(self.pointing, name)[cut] for name in Pointing.__slots__)),
            *(getattr(self, name)[cut] for name in AxisPath.__slots__[1:]),
        )

    def thinned(self, every: int) -> AxisPath:
        """Return each so-manieth sample, the last one kept."""
        kept = np.unique(np.append(np.arange(0, len(self.utc_s), every), len(self.utc_s) - 1))
        return AxisPath(
            Pointing(*(getattr(self.pointing, name)[kept] for name in Pointing.__slots__)),
            *(getattr(self, name)[kept] for name in AxisPath.__slots__[1:]),
        )

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
