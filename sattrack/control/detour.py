"""A way round the celestial pole, or through it, where the hour angle turns faster than the mount can.

Between two instants the hour angle axis leaves the target and runs by a trapezoid of rates; the declination
axis keeps the telescope as near to the target as that lets it. At both ends the axes have the target's place
and rate.
"""

from __future__ import annotations

import math

import msgspec


class Detour(msgspec.Struct, frozen=True):
    """One such way, as rates of the right ascension that is fed. Degrees, seconds, POSIX seconds of UTC.

    From `ra_deg` at `begin_utc_s` the right ascension changes at `first_deg_s`, goes over to `cruise_deg_s`
    with `acceleration_deg_s2`, and in time to `last_deg_s`, which it has at `end_utc_s`. `through_pole` where
    the mount ends on the other side of the pier, its declination axis past 90°, with a right ascension that
    is half a turn from the target's.
    """

    begin_utc_s: float
    end_utc_s: float
    ra_deg: float
    first_deg_s: float
    cruise_deg_s: float
    last_deg_s: float
    acceleration_deg_s2: float
    through_pole: bool
    pole_dec_deg: float = 90.0
    """Which pole it is, 90 or -90."""

    def ra_at(self, utc_s: float) -> float:
        """Return the right ascension of the axis at an instant of the detour, unwrapped."""
        time_s = utc_s - self.begin_utc_s
        duration_s = self.end_utc_s - self.begin_utc_s
        ramp_on_s = abs(self.cruise_deg_s - self.first_deg_s) / self.acceleration_deg_s2
        ramp_off_s = abs(self.last_deg_s - self.cruise_deg_s) / self.acceleration_deg_s2
        on_s = min(time_s, ramp_on_s)
        ra = self.ra_deg + self.cruise_deg_s * time_s
        ra += (self.first_deg_s - self.cruise_deg_s) * (
            on_s - (0.5 * on_s * on_s / ramp_on_s if on_s else 0.0)
        )
        off_s = time_s - (duration_s - ramp_off_s)
        if off_s > 0.0 and ramp_off_s > 0.0:
            ra += (self.last_deg_s - self.cruise_deg_s) * 0.5 * off_s * off_s / ramp_off_s
        return ra

    def axes_at(self, utc_s: float, target_ra_deg: float, target_dec_deg: float) -> tuple[float, float]:
        """Return where the axes are to be: right ascension as `ra_at`, declination past 90° beyond the pole.

        Of all declinations that the axis can have with that right ascension it is the nearest to the target.
        """
        ra = self.ra_at(utc_s)
        return ra, self._nearest_dec(ra, target_ra_deg, target_dec_deg)

    def _nearest_dec(self, ra_deg: float, target_ra_deg: float, target_dec_deg: float) -> float:
        dec, apart = math.radians(target_dec_deg), math.radians(target_ra_deg - ra_deg)
        nearest = math.degrees(math.atan2(math.sin(dec), math.cos(dec) * math.cos(apart)))
        return nearest if self.through_pole else max(-90.0, min(90.0, nearest))
