"""Sites placed under satellites by SGP4 and ERFA alone, and skyfield's time scale, for the tests."""

from __future__ import annotations

import math

import erfa
import numpy as np
from sgp4.api import Satrec
from skyfield.api import load
from skyfield.timelib import Timescale

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


def skyfield_timescale(dut1_s, xp_arcsec, yp_arcsec):
    """Return a time scale of skyfield's with this UT1-UTC and pole at all times since 2017."""
    builtin = load.timescale(builtin=True)
    delta_t = 37.0 + 32.184 - dut1_s
    ends = np.array([2400000.0, 2500000.0])
    timescale = Timescale((ends, np.array([delta_t, delta_t])), builtin.leap_dates, builtin.leap_offsets)
    timescale.polar_motion_table = (ends, np.full(2, xp_arcsec), np.full(2, yp_arcsec))
    return timescale
