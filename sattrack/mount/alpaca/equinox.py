"""Between the equinox of date, in which mounts are steered, and J2000, in which some drivers speak.

A turn of the axes alone: precession, nutation and frame bias (IAU 2006/2000A, ERFA), without aberration. The
satellite's direction is topocentric already, and what a driver adds on its own is the same within a field.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import erfa

ANEW_AFTER_S = 600.0
"""The equinox moves by 3 milliarcseconds in that time."""
MJD_ZERO = 2400000.5
MJD_OF_UNIX_EPOCH = 40587.0
TT_LESS_UTC_S = 69.184


@dataclass(slots=True)
class Equinox:
    """Turns directions, degrees, at instants of UTC (POSIX seconds)."""

    _matrix: Any = None
    _made_utc_s: float = 0.0

    def of_date(self, ra_deg: float, dec_deg: float, utc_s: float) -> tuple[float, float]:
        """Return a J2000 direction in the equinox of date."""
        return self._turned(self._rotation(utc_s), ra_deg, dec_deg)

    def j2000(self, ra_deg: float, dec_deg: float, utc_s: float) -> tuple[float, float]:
        """Return a direction of date in J2000."""
        return self._turned(self._rotation(utc_s).T, ra_deg, dec_deg)

    def _rotation(self, utc_s: float) -> Any:
        if self._matrix is None or abs(utc_s - self._made_utc_s) > ANEW_AFTER_S:
            tt = (utc_s + TT_LESS_UTC_S) / 86400.0 + MJD_OF_UNIX_EPOCH
            self._matrix, self._made_utc_s = erfa.pnm06a(MJD_ZERO, tt), utc_s
        return self._matrix

    @staticmethod
    def _turned(matrix: Any, ra_deg: float, dec_deg: float) -> tuple[float, float]:
        ra, dec = math.radians(ra_deg), math.radians(dec_deg)
        unit = (math.cos(dec) * math.cos(ra), math.cos(dec) * math.sin(ra), math.sin(dec))
        x, y, z = (float(v) for v in matrix @ unit)
        return math.degrees(math.atan2(y, x)) % 360.0, math.degrees(math.atan2(z, math.hypot(x, y)))
