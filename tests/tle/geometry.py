"""Sites placed under satellites by SGP4 and ERFA alone, for the tests."""

from __future__ import annotations

import math

import erfa
import numpy as np
from sgp4.api import Satrec

from tle.site import Site


def itrs_km(lines, utc):
    """Return the satellite in the Earth-fixed frame, without polar motion and with UT1 = UTC."""
    jd, fraction = utc.split()
    error, r, _ = Satrec.twoline2rv(*lines).sgp4(jd, fraction)
    assert error == 0
    theta = erfa.gmst82(jd, fraction)
    c, s = math.cos(theta), math.sin(theta)
    return np.array([r[0] * c + r[1] * s, -r[0] * s + r[1] * c, r[2]])


def site_below(lines, utc):
    """Return the site that has the satellite in its zenith."""
    longitude, latitude, _ = erfa.gc2gd(1, itrs_km(lines, utc) * 1000.0)
    return Site(math.degrees(latitude), math.degrees(longitude))


def site_that_sees_it_at_the_pole(lines, utc, aside_deg=0.0):
    """Return the site south of the satellite from which it stands in the direction of the celestial pole."""
    x, y, _ = itrs_km(lines, utc)
    low, high = 0.0, math.pi / 2.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        place = erfa.gd2gc(1, 0.0, middle, 0.0) / 1000.0
        low, high = (middle, high) if place[0] > math.hypot(x, y) else (low, middle)
    return Site(math.degrees(low), math.degrees(math.atan2(y, x)) + aside_deg)
