"""The Sun as seen from the Earth's centre, and whether it shines on a satellite."""

from __future__ import annotations

from typing import TYPE_CHECKING

import erfa
import numpy as np

from tle.iers import UNIX_EPOCH_MJD, tai_minus_utc_s
from tle.instants import DAY_S
from tle.site import EARTH_RADIUS_KM, FLATTENING

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tle.instants import Utc

AU_KM = 149597870.7
SUN_RADIUS_KM = 695700.0
_MJD_JD = 2400000.5


def terrestrial_time(at: Utc) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return Julian dates of TT, which TDB follows within 2 ms; UTC's step is that of the first instant."""
    seconds = np.atleast_1d(np.asarray(at.unix_s, dtype=np.float64))
    days = np.floor(seconds / DAY_S)
    offset_s = tai_minus_utc_s(int(days[0]) + UNIX_EPOCH_MJD) + 32.184 if len(days) else 0.0
    return days + UNIX_EPOCH_MJD + _MJD_JD, (seconds - days * DAY_S + offset_s) / DAY_S


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
