"""The Sun and the Moon over a site during a span, looked up once and interpolated."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from tle.direction import turned
from tle.instants import Utc
from tle.moon import moon_km
from tle.sun import sun_km

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from tle.earth import EarthOrientation
    from tle.ground import Ground

    Array = NDArray[np.float64]

# Between two looks the Moon's way bends by 0.07″, and the Sun's by 0.02″.
_MOON_STEP_S, _SUN_STEP_S = 600.0, 3600.0


class SkyBody:
    """Where a body stands: east, north, up of the site in km, geometric, shape (3, m), by interpolation."""

    def __init__(
        self,
        place_km: Callable[[Utc], Array],
        ground: Ground,
        earth: EarthOrientation,
        span: tuple[float, float],
        step_s: float,
    ) -> None:
        """Look the body up over a span, first second (POSIX) and length. Raises TimeRangeError."""
        start_s, span_s = span
        self._times = start_s + np.linspace(0.0, span_s, math.ceil(span_s / step_s) + 2)
        at = Utc(self._times)
        of_date = np.einsum("nij,nj->in", earth.celestial_matrix(at), place_km(at))
        equinoxes = np.broadcast_to(earth.rotation(self._times)[2], self._times.shape)
        self._teme = turned((of_date[0], of_date[1], of_date[2]), -equinoxes)
        self._ground = ground

    def east_north_up(self, unix_s: Array) -> Array:
        """Return the place at POSIX seconds within the span."""
        x, y, z = (np.interp(unix_s, self._times, column) for column in self._teme)
        return self._ground.east_north_up(unix_s, (x, y, z))


def sun_and_moon(
    ground: Ground, earth: EarthOrientation, span: tuple[float, float]
) -> tuple[SkyBody, SkyBody]:
    """Return both over a span."""
    return (
        SkyBody(sun_km, ground, earth, span, _SUN_STEP_S),
        SkyBody(moon_km, ground, earth, span, _MOON_STEP_S),
    )
