"""The satellite's motion by SGP4: position, the velocity that belongs to it, and about what acceleration.

SGP4's own velocities are not the derivatives of its positions: they miss them by 0.02 to 0.10 m/s. The
velocities given here are derivatives, by differences.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.polynomial import chebyshev

from tle.elements import MU_KM3_S2, RADIUS_KM, propagation_error
from tle.instants import DAY_S, UNIX_EPOCH_JD, Utc
from tle.quantities import functions_for

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from sgp4.api import Satrec

    from tle.elements import Elements
    from tle.quantities import Quantity

_TERMS = 10
_FEWEST_A_PART = 40
# The last two terms say how well the polynomial fits, in km.
_FIT_KM = 1e-6
# Lower than this SGP4 is about to call the satellite decayed, which each instant must find out for itself.
_LOWEST_KM = 6500.0
_NODES = chebyshev.chebpts1(_TERMS)
_TO_CHEBYSHEV = np.linalg.inv(chebyshev.chebvander(_NODES, _TERMS - 1))
_POLYNOMIALS = [chebyshev.cheb2poly(row) for row in np.eye(_TERMS)]
_TO_POWERS = np.array([np.pad(p, (0, _TERMS - len(p))) for p in _POLYNOMIALS]).T
# x, y, z of position (km), velocity (km/s) and acceleration (km/s2, good to a thousandth: enough for the
# change of velocity within a light time), then SGP4's error number.
State = tuple["Quantity", ...]

# The formula below errs by _STEP_S**2/12 of the third derivative, 2e-7 km/s in low orbit; a shorter step
# would let the rounding of SGP4's mean anomaly through instead.
_STEP_S = 0.5
_J2_RADIUS2_KM2 = 1.082616e-3 * RADIUS_KM**2
_PARTS_PER_TURN = 24
_FEWEST_SHARED = 100


def shared_states(
    record: Satrec, jd: NDArray[np.float64], second: NDArray[np.float64], part_s: float
) -> NDArray[np.float64] | None:
    """Return position, velocity, acceleration (km, km/s, km/s2), shape (9, n), from polynomials over parts.

    Instants are whole Julian dates `jd` and seconds since; `part_s` is how long one polynomial may serve.
    None where the instants are too few, or SGP4 not smooth or not sure enough, for that.
    """
    since = (jd - jd[0]) * DAY_S + second
    first, last = float(since.min()), float(since.max())
    if not math.isfinite(last - first):
        return None
    count = math.floor((last - first) / part_s) + 1
    if count * _FEWEST_A_PART > len(since):
        return None
    half_s = 0.5 * (last - first) / count or 1.0
    middles: NDArray[np.float64] = first + half_s * (2.0 * np.arange(count, dtype=np.float64) + 1.0)
    powers = _fit(record, float(jd[0]), middles, half_s)
    if powers is None:
        return None
    order = None if (np.diff(since) >= 0.0).all() else np.argsort(since)
    ordered = since if order is None else since[order]
    bounds = np.searchsorted(ordered, middles[:-1] + half_s)
    states = np.empty((9, len(since)))
    for part, start, stop in zip(range(count), [0, *bounds], [*bounds, len(since)], strict=True):
        x = (ordered[start:stop] - middles[part]) / half_s
        raised = np.empty((_TERMS, stop - start))
        raised[0] = 1.0
        for term in range(1, _TERMS):
            np.multiply(raised[term - 1], x, out=raised[term])
        states[:, start:stop] = powers[part] @ raised
    if order is None:
        return states
    back = np.empty_like(states)
    back[:, order] = states
    return back


def _fit(record: Satrec, jd: float, middles: NDArray[Any], half_s: float) -> NDArray[np.float64] | None:
    """Return coefficients of the powers of x, shape (parts, 9, terms), for x from -1 to 1 over each part."""
    nodes = (middles[:, None] + half_s * _NODES).ravel()
    code, r, _ = record.sgp4_array(np.full(nodes.shape, jd), nodes / DAY_S)
    if code.any() or np.linalg.norm(r, axis=1).min() < _LOWEST_KM:
        return None
    terms = np.einsum("kn,pnc->pkc", _TO_CHEBYSHEV, r.reshape(len(middles), _TERMS, 3))
    if np.abs(terms[:, -2:]).max() > _FIT_KM:
        return None
    place = np.einsum("kn,pnc->pck", _TO_POWERS, terms)
    degree = np.arange(1.0, _TERMS)
    velocity, acceleration = np.zeros_like(place), np.zeros_like(place)
    velocity[..., :-1] = place[..., 1:] * degree / half_s
    acceleration[..., :-1] = velocity[..., 1:] * degree / half_s
    return np.concatenate([place, velocity, acceleration], axis=1)


def gravity_km_s2(x: Quantity, y: Quantity, z: Quantity) -> tuple[Quantity, Quantity, Quantity]:
    """Return the Earth's pull at a geocentric place in km, of its mass and flattening (WGS 72's μ and J2)."""
    r2 = x * x + y * y + z * z
    pull = -MU_KM3_S2 / (r2 * functions_for(r2).sqrt(r2))
    flat = 1.5 * _J2_RADIUS2_KM2 / r2
    tilt = 5.0 * z * z / r2
    equatorial, polar = pull * (1.0 + flat * (1.0 - tilt)), pull * (1.0 + flat * (3.0 - tilt))
    return equatorial * x, equatorial * y, polar * z


class Motion:
    """SGP4 for one set of elements, TEME, for floats and arrays. Not to be shared between threads."""

    def __init__(self, elements: Elements) -> None:
        """Start SGP4. Raises PropagationError where it refuses the elements."""
        self.elements = elements
        self._record = elements.satrec()
        self._sgp4 = self._record.sgp4
        e = elements.eccentricity
        self._part_s = elements.period_s * (1.0 - e) ** 1.5 / math.sqrt(1.0 + e) / _PARTS_PER_TURN

    def at(self, unix_s: float, later_s: float) -> State:
        """Return the state at POSIX seconds of UTC plus `later_s`, last item 0. Raises PropagationError."""
        days = unix_s // DAY_S
        jd = days + UNIX_EPOCH_JD
        second = unix_s - days * DAY_S + later_s
        code, r, v = self._sgp4(jd, second / DAY_S)
        next_code, r1, v1 = self._sgp4(jd, (second + _STEP_S) / DAY_S)
        if code or next_code:
            raise propagation_error(code or next_code, self.elements, Utc(unix_s))
        x, y, z = r
        vx, vy, vz = v
        x1, y1, z1 = r1
        vx1, vy1, vz1 = v1
        dx, dy, dz = vx1 - vx, vy1 - vy, vz1 - vz
        return (
            x,
            y,
            z,
            # The chord is the velocity half a step later; SGP4's own velocities lead back well enough.
            (x1 - x) / _STEP_S - 0.5 * dx,
            (y1 - y) / _STEP_S - 0.5 * dy,
            (z1 - z) / _STEP_S - 0.5 * dz,
            dx / _STEP_S,
            dy / _STEP_S,
            dz / _STEP_S,
            0,
        )

    def at_many(self, unix_s: NDArray[np.float64], later_s: Quantity) -> State:
        """Return the states at an array of instants; where SGP4 fails, NaN, and its error number last.

        Where many instants share a small part of the orbit, SGP4 is asked at a few of them only.
        """
        days = np.floor(unix_s / DAY_S)
        second = unix_s - days * DAY_S + later_s
        jd = days + UNIX_EPOCH_JD
        if len(second) >= _FEWEST_SHARED:
            state = shared_states(self._record, jd, second, self._part_s)
            if state is not None:
                return (*state, np.zeros(len(second), dtype=np.uint8))
        code, r, v = self._record.sgp4_array(jd, second / DAY_S)
        late, r1, v1 = self._record.sgp4_array(jd, (second + _STEP_S) / DAY_S)
        code = np.where(code == 0, late, code)
        r, v, r1, v1 = (np.ascontiguousarray(a.T) for a in (r, v, r1, v1))
        velocity = (r1 - r) / _STEP_S - 0.5 * (v1 - v)
        r[:, code != 0] = np.nan
        return (*r, *velocity, *((v1 - v) / _STEP_S), code)
