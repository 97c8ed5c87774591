"""Where the Sun is, and what a true sidereal clock would show, at a site."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from sattrack.mount.model import SIDEREAL_RATE_DEG_S, mean_sidereal_deg
from tle.earth import EarthOrientation
from tle.instants import Utc
from tle.sun import sun_km

if TYPE_CHECKING:
    from tle.site import Site


def sun_hour_angle_and_dec(utc_s: float, site: Site) -> tuple[float, float]:
    """Return the Sun's hour angle and declination of date at an instant, degrees, to a few arcseconds.

    Raises TimeRangeError where the Earth's orientation is not known.
    """
    earth, at = EarthOrientation.installed(), Utc(utc_s)
    x, y, z = (float(c) for c in earth.celestial_matrix(at) @ sun_km(at))
    right_ascension = math.degrees(math.atan2(y, x))
    sidereal = float(earth.local_apparent_sidereal_deg(at, site))
    hour_angle = (sidereal - right_ascension + 180.0) % 360.0 - 180.0
    return hour_angle, math.degrees(math.atan2(z, math.hypot(x, y)))


def true_clocks(utc_s: float, site: Site) -> dict[str, float]:
    """Return by how many seconds each kind of true sidereal clock is ahead of mean time with UT1 = UTC.

    A mount's clock may show mean or apparent sidereal time, and may know UT1 or take UTC for it. Raises
    TimeRangeError.
    """
    earth, at = EarthOrientation.installed(), Utc(utc_s)
    plain = mean_sidereal_deg(utc_s, site.longitude_deg)
    apparent = float(earth.local_apparent_sidereal_deg(at, site))
    equinoxes_deg = float(np.degrees(earth.rotation(utc_s)[2]))

    def ahead_s(sidereal_deg: float) -> float:
        return ((sidereal_deg - plain + 180.0) % 360.0 - 180.0) / SIDEREAL_RATE_DEG_S

    return {
        "mean, UT1 taken as UTC": 0.0,
        "mean, by UT1": ahead_s(apparent - equinoxes_deg),
        "apparent, by UT1": ahead_s(apparent),
    }
