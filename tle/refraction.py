"""Refraction by the air, for pressure and temperature, at every altitude from nadir to zenith.

Bennett's formula (Journal of Navigation 35, 255, 1982; Meeus, Astronomical Algorithms, 16.3), which takes
the refracted altitude, solved for the true one: good to about 0.1′ above the horizon in ordinary air. Far
below the horizon there is no such thing as the refraction: it fades out smoothly there, so that altitudes
keep their order and rates stay continuous.

Written out because ERFA's `refco` is for 20° and up, and skyfield's `refract` has neither a derivative nor a
continuation below the horizon.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from tle.errors import RefractionError
from tle.instants import FLOATS, functions_for

if TYPE_CHECKING:
    from tle.earth import Triple
    from tle.instants import Functions, Quantity

_RAD = math.pi / 180.0
_AT_ZENITH_ARCMIN = 0.0013515  # makes the formula zero at the zenith
_FADE_FROM_DEG = -1.0
_FADE_DEG = 2.0
_NEWTON_STEPS = 6
_TINY = 1e-12


@dataclass(frozen=True, slots=True)
class Refraction:
    """The air at the site: pressure there in hPa (not reduced to sea level), temperature in °C.

    Raises RefractionError outside 0 to 1200 hPa and -100 to 60 °C.
    """

    pressure_hpa: float = 1010.0
    temperature_c: float = 10.0

    def __post_init__(self) -> None:
        """Check both numbers."""
        if not 0.0 <= self.pressure_hpa <= 1200.0:
            raise RefractionError(f"a pressure of {self.pressure_hpa} hPa is outside 0 to 1200 hPa")
        if not -100.0 <= self.temperature_c <= 60.0:
            raise RefractionError(f"a temperature of {self.temperature_c} °C is outside -100 to 60 °C")

    @classmethod
    def standard(cls, height_m: float) -> Refraction:
        """Return the air of the ICAO standard atmosphere at a height in metres."""
        warmth = max(1.0 - 2.25577e-5 * min(height_m, 11000.0), 0.0)
        return cls(1013.25 * warmth**5.25588, 15.0 - 0.0065 * min(height_m, 11000.0))

    def bend_deg(self, altitude_deg: Quantity) -> tuple[Quantity, Quantity]:
        """Return how much a true altitude is raised, in degrees, and that's derivative by the altitude.

        Defined from -90° to 90°; zero at the zenith, continuous with its derivative everywhere.
        """
        fn = functions_for(altitude_deg)
        if fn is FLOATS and altitude_deg >= _FADE_FROM_DEG:
            # What follows would come to the same, for twice the time.
            return self._bennett(altitude_deg, fn)
        clear = fn.where(altitude_deg > _FADE_FROM_DEG, altitude_deg, _FADE_FROM_DEG)
        below = clear - altitude_deg
        bend, slope = self._bennett(clear, fn)
        edge, edge_slope = self._bennett(_FADE_FROM_DEG, FLOATS)
        growth = edge / _FADE_DEG - edge_slope
        fading = fn.exp(-below / _FADE_DEG)
        faded = (bend + growth * below) * fading
        return faded, fn.where(below > 0.0, faded / _FADE_DEG - growth * fading, slope)

    def _bennett(self, altitude_deg: Quantity, fn: Functions) -> tuple[Quantity, Quantity]:
        """Return the bend and its derivative for true altitudes from -1°, by Newton's method."""
        scale_deg = self.pressure_hpa / 1010.0 * 283.0 / (273.0 + self.temperature_c) / 60.0
        raised = altitude_deg + 0.0
        scalar, sin, cos = fn is FLOATS, fn.sin, fn.cos
        for _ in range(_NEWTON_STEPS):
            above = raised + 4.4
            angle = (raised + 7.31 / above) * _RAD
            sine = sin(angle)
            bend = scale_deg * (cos(angle) / sine + _AT_ZENITH_ARCMIN)
            slope = -scale_deg / (sine * sine) * (1.0 - 7.31 / (above * above)) * _RAD
            before, raised = raised, raised - (raised - bend - altitude_deg) / (1.0 - slope)
            if scalar and raised == before:
                break
        return raised - altitude_deg, slope / (1.0 - slope)

    def refract(self, u: Triple, u_rate: Triple, up: Triple, up_rate: Triple) -> tuple[Triple, Triple]:
        """Return a unit vector raised towards the zenith, and its rate; all in one frame, rates a second."""
        fn = functions_for(u[0])
        # Written out: calls and loops take twice the time.
        (ax, ay, az), (adx, ady, adz) = u, u_rate
        (kx, ky, kz), (kdx, kdy, kdz) = up, up_rate
        sine = ax * kx + ay * ky + az * kz
        cosine = fn.sqrt(fn.where(sine * sine < 1.0, 1.0 - sine * sine, 0.0)) + _TINY
        rising = (adx * kx + ady * ky + adz * kz) + (ax * kdx + ay * kdy + az * kdz)
        altitude_rate = rising / cosine
        bend, slope = self.bend_deg(fn.atan2(sine, cosine) / _RAD)
        bend = bend * _RAD
        bend_rate = slope * altitude_rate
        sin_bend, cos_bend = fn.sin(bend), fn.cos(bend)
        lost, turning = cosine * altitude_rate, sine * altitude_rate
        # Towards the zenith, at right angles to the direction.
        tx, ty, tz = (kx - sine * ax) / cosine, (ky - sine * ay) / cosine, (kz - sine * az) / cosine
        tdx = (kdx - lost * ax - sine * adx + tx * turning) / cosine
        tdy = (kdy - lost * ay - sine * ady + ty * turning) / cosine
        tdz = (kdz - lost * az - sine * adz + tz * turning) / cosine
        raised = (
            ax * cos_bend + tx * sin_bend,
            ay * cos_bend + ty * sin_bend,
            az * cos_bend + tz * sin_bend,
        )
        raised_rate = (
            (adx + tx * bend_rate) * cos_bend + (tdx - ax * bend_rate) * sin_bend,
            (ady + ty * bend_rate) * cos_bend + (tdy - ay * bend_rate) * sin_bend,
            (adz + tz * bend_rate) * cos_bend + (tdz - az * bend_rate) * sin_bend,
        )
        return raised, raised_rate
