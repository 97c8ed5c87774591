"""A satellite's way over one pass in a mount's two axes, with rates and accelerations, as arrays."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from tle.instants import Utc
from tle.sun import sun_km

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tle.bias import Bias
    from tle.earth import EarthOrientation
    from tle.propagator import Propagator

    Array = NDArray[np.float64]
    Bools = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Pointing:
    """How a mount's axes stand at instants (POSIX seconds of UTC), with what limits ask for; shape (n,).

    `hour_angle_axis_deg` is counted through turns, as cables count it; the declination axis passes 90° where
    the mount points from beyond the pole. The Sun's place is that of its centre, geocentric, of date.
    """

    utc_s: Array
    hour_angle_axis_deg: Array
    dec_axis_deg: Array
    sun_hour_angle_deg: Array
    sun_dec_deg: Array


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
    sidereal_deg = hour_angle + seen.ra_deg
    sun_ra_deg, sun_dec_deg = sun_place_deg(propagator.earth, utc_s)
    ha_rate, dec_rate = np.asarray(seen.ha_rate_deg_s), np.asarray(seen.dec_rate_deg_s)
    return AxisPath(
        Pointing(utc_s, axis, np.asarray(seen.dec_deg), sidereal_deg - sun_ra_deg, sun_dec_deg),
        ha_rate,
        dec_rate,
        np.gradient(ha_rate, utc_s),
        np.gradient(dec_rate, utc_s),
        np.asarray(seen.alt_deg),
        np.asarray(seen.az_deg),
        np.degrees(np.unwrap(np.radians(seen.ra_deg), axis=0)),
    )


SUN_STEP_S = 600.0


def sun_place_deg(earth: EarthOrientation, utc_s: Array) -> tuple[Array, Array]:
    """Return right ascension (continuous) and declination of the Sun, of date, degrees.

    Interpolated between looks ten minutes apart, over which its way bends by a hundredth of an arcsecond.
    """
    looks = np.arange(utc_s[0] - 1.0, utc_s[-1] + SUN_STEP_S + 1.0, SUN_STEP_S)
    at = Utc(looks)
    x, y, z = np.einsum("nij,nj->in", earth.celestial_matrix(at), sun_km(at))
    ra = np.degrees(np.unwrap(np.arctan2(y, x)))
    dec = np.degrees(np.arctan2(z, np.hypot(x, y)))
    return np.interp(utc_s, looks, ra), np.interp(utc_s, looks, dec)
