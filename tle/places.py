"""Directions measured among stars, turned into those in which a mount must point."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, get_args

import erfa
import numpy as np

from tle.earth import to_tirs
from tle.errors import ObservationError, PlaceError
from tle.residuals import Frame
from tle.sun import earth_velocity_km_s

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tle.earth import EarthOrientation
    from tle.instants import Utc
    from tle.site import Site

LIGHT_KM_S = 299792.458


def apparent_unit(
    ra_deg: float, dec_deg: float, t: Utc, frame: Frame, site: Site, earth: EarthOrientation
) -> NDArray[np.float64]:
    """Return the apparent direction, without air, of one that was measured at an instant; shape (3,).

    True equator and equinox of date, with annual and diurnal aberration: what the propagator's apparent place
    is compared with. Frames: "icrf" (astrometric, as a plate solution among catalogued stars gives it),
    "j2000" (the same by the mean equator and equinox of J2000), "of_date" (apparent already). Of a satellite
    the inverse of the astrometric place; bias, precession and nutation are ERFA's pnm06a, velocities add up
    without the terms of 0.001″ that relativity has. Raises ObservationError where it is no direction,
    PlaceError for an unknown frame, TimeRangeError.
    """
    if frame not in get_args(Frame):
        raise PlaceError(f"{frame!r} is no frame: give one of {', '.join(get_args(Frame))}")
    if not -90.0 <= dec_deg <= 90.0 or not math.isfinite(ra_deg):
        raise ObservationError(
            f"RA {ra_deg}°, Dec {dec_deg}° is no direction: Dec must be within -90° to 90°"
        )
    ra, dec = math.radians(ra_deg), math.radians(dec_deg)
    measured = np.array([math.cos(dec) * math.cos(ra), math.cos(dec) * math.sin(ra), math.sin(dec)])
    if frame == "of_date":
        return measured
    if frame == "j2000":
        frame_bias, _, _ = erfa.bp06(2451545.0, 0.0)
        measured = frame_bias.T @ measured
    velocity = earth_velocity_km_s(t)
    # The light's own velocity against the barycentre, added to the observer's, has length c again.
    ahead = float(measured @ velocity)
    length = math.sqrt(ahead * ahead + LIGHT_KM_S**2 - float(velocity @ velocity)) - ahead
    of_date = earth.celestial_matrix(t) @ (measured * length + velocity)
    seen: NDArray[np.float64] = of_date + _diurnal_km_s(t, site, earth)
    return seen / math.sqrt(float(seen @ seen))


def _diurnal_km_s(t: Utc, site: Site, earth: EarthOrientation) -> NDArray[np.float64]:
    """Return the site's velocity by the Earth's turn, true equator and equinox of date, km/s."""
    theta, spin, equinoxes, _, xp, yp = earth.rotation(t.unix_s)
    x, y, _ = to_tirs(site.itrs_km, xp, yp)
    c, s = math.cos(theta + equinoxes), math.sin(theta + equinoxes)
    return np.array([-spin * (x * s + y * c), spin * (x * c - y * s), 0.0])
