"""Sun and Moon, from the Earth's centre and over a site, and whether the Sun shines on a satellite."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import erfa
import numpy as np

from tle.earth import turned
from tle.instants import DAY_S, TT_MINUS_TAI_S, UNIX_EPOCH_JD, UNIX_EPOCH_MJD, Utc, tai_minus_utc_s
from tle.site import EARTH_RADIUS_KM, FLATTENING

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tle.earth import EarthOrientation, Ground

    Array = NDArray[np.float64]

AU_KM = 149597870.7
LIGHT_KM_S = 299792.458
SUN_RADIUS_KM = 695700.0
# Between two looks the Moon's way bends by 0.07″, and the Sun's by 0.02″.
_MOON_STEP_S, _SUN_STEP_S = 600.0, 3600.0


def terrestrial_time(at: Utc) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return Julian dates of TT, which TDB follows within 2 ms, in two parts of shape (n,)."""
    seconds = np.atleast_1d(np.asarray(at.unix_s, dtype=np.float64))
    days = np.floor(seconds / DAY_S)
    offset_s = tai_minus_utc_s(days + UNIX_EPOCH_MJD) + TT_MINUS_TAI_S
    return days + UNIX_EPOCH_JD, (seconds - days * DAY_S + offset_s) / DAY_S


def sun_km(at: Utc) -> NDArray[np.float64]:
    """Return the geometric Sun from the Earth's centre, GCRS, km, shape (3,) or (n, 3) (ERFA's epv00)."""
    heliocentric, _ = erfa.epv00(*terrestrial_time(at))
    place: NDArray[np.float64] = -heliocentric["p"] * AU_KM
    return place if at.is_array else place[0]


def earth_velocity_km_s(at: Utc) -> NDArray[np.float64]:
    """Return the Earth's barycentric velocity, GCRS axes, km/s, shape (3,) or (n, 3) (ERFA's epv00)."""
    _, barycentric = erfa.epv00(*terrestrial_time(at))
    velocity: NDArray[np.float64] = barycentric["v"] * (AU_KM / DAY_S)
    return velocity if at.is_array else velocity[0]


def is_sunlit(satellite_km: NDArray[np.float64], sun: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Tell whether the Sun's centre is above the Earth's limb for a satellite; both km, any shape (..., 3).

    Geocentric, true equator of date. The Earth is the ellipsoid of WGS 84 without air; half of the Sun's disc
    is still seen at the border.
    """
    squash = np.array([1.0, 1.0, 1.0 / (1.0 - FLATTENING)]) / EARTH_RADIUS_KM
    place = satellite_km * squash
    towards = (sun - satellite_km) * squash
    towards = towards / np.linalg.norm(towards, axis=-1, keepdims=True)
    along = np.sum(place * towards, axis=-1)
    nearest2 = np.sum(place * place, axis=-1) - along * along
    lit: NDArray[np.bool_] = (along > 0.0) | (nearest2 > 1.0)
    return lit


def moon_km(at: Utc) -> NDArray[np.float64]:
    """Return the geometric Moon from the Earth's centre, GCRS, km, shape (3,) or (n, 3) (ERFA's moon98).

    Meeus's series: good to about 10″ and 20 km.
    """
    place: NDArray[np.float64] = erfa.moon98(*terrestrial_time(at))["p"] * AU_KM
    return place if at.is_array else place[0]


class SunAndMoon:
    """Where both stand over a site, geometric, by interpolation."""

    def __init__(self, ground: Ground, earth: EarthOrientation, span: tuple[float, float]) -> None:
        """Look them up over a span, first second (POSIX) and length. Raises TimeRangeError."""
        start_s, span_s = span
        self._ground = ground
        self._tables: list[tuple[Array, tuple[Array, Array, Array]]] = []
        for place_km, step_s in ((sun_km, _SUN_STEP_S), (moon_km, _MOON_STEP_S)):
            times = start_s + np.linspace(0.0, span_s, math.ceil(span_s / step_s) + 2)
            at = Utc(times)
            of_date = np.einsum("nij,nj->in", earth.celestial_matrix(at), place_km(at))
            equinoxes = np.broadcast_to(earth.rotation(times)[2], times.shape)
            self._tables.append((times, turned((of_date[0], of_date[1], of_date[2]), -equinoxes)))

    def east_north_up(self, unix_s: Array) -> Array:
        """Return places at POSIX seconds within the span, km, shape (3, 2, ...): the Sun's, the Moon's."""
        x, y, z = (
            np.stack([np.interp(unix_s, times, teme[axis]) for times, teme in self._tables])
            for axis in range(3)
        )
        return self._ground.east_north_up(unix_s, (x, y, z))
