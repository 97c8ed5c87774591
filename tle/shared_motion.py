"""Many instants close together: SGP4 at a few of them, a polynomial for all.

An orbit is smooth: over a twenty-fourth of a turn a polynomial of ninth degree follows SGP4's positions to
less than SGP4's own rounding, and its derivatives are those of the positions.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.polynomial import chebyshev

from tle.instants import DAY_S

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from sgp4.api import Satrec

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
