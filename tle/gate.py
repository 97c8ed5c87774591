"""When objects near the Earth may be above a horizon at all, from their mean orbits, so cheaply that SGP4 is
asked round possible passes only.

**The gate cannot close on a pass.** It follows `near_earth.mean_orbit`, which is SGP4 with its drag, its
secular and its long-period terms, and leaves out only the four terms of twice the argument of latitude; their
amplitudes add up to `short_period_bound_km`, 10 to 40 km. With z = q·û - sin a |q| (positive where the
altitude exceeds a) a shift of the satellite by d changes z by (1 + |sin a|) d at most, so that a satellite
above has z > -(1 + |sin a|) d in the mean orbit. Between two instants z stays under a parabola whose bend
follows from the orbit's lowest point (see `crossings`); a stretch is dropped where that parabola stays under
the margin. Before that, stretches are dropped in which the orbit's plane is so far from the site that no
point of it on or under the apogee is above: over a stretch the angle between plane and site changes by no
more than the Earth and the node turn.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from tle.arcs import Windows
from tle.crossings import highest_between
from tle.near_earth import RADIUS_KM, in_plane, mean_orbit, short_period_bound_km

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tle.ground import Ground
    from tle.near_earth import NearEarth

    Array = NDArray[np.float64]
    Index = NDArray[np.intp]

_MU_KM3_S2 = 398600.8
_EARTH_RAD_S = 7.2921159e-5
_STRETCHES_A_TURN = 8
_HALVINGS = 2
# Beyond this the drag of the elements is no orbit's: such objects are left to a search without a gate.
_MOST_DRAG = 0.02
# Single precision, a rough Kepler's equation, the Earth's turn taken as even; J2's part of gravity (0.3 %).
_SLACK_KM, _GRAVITY_SLACK = 2.0, 1.01


class Bounds(NamedTuple):
    """What an orbit cannot exceed within a span: distances from the Earth's centre, km; shapes (n,).

    `speed` and `bend` are of the motion seen from the turning Earth, km/s and km/s²; `margin_km` is how far
    the mean orbit can be from SGP4's. `regular` is False where there are no such bounds.
    """

    regular: NDArray[np.bool_]
    lowest_km: Array
    highest_km: Array
    speed: Array
    bend: Array
    margin_km: Array

    def take(self, index: Index) -> Bounds:
        """Return the bounds of the objects of these indices."""
        taken: list[Any] = [values[index] for values in self]
        return Bounds(*taken)


def drag_share(c: NearEarth, unix_s: float) -> Array:
    """Return how large SGP4's terms of drag are at an instant, in shares of the square root of the orbit."""
    return _drag_share(c, np.abs(unix_s - c.epoch_s) / 60.0)


def _drag_share(c: NearEarth, t: Array) -> Array:
    share: Array = t * (np.abs(c.cc1) + t * (np.abs(c.d2) + t * (np.abs(c.d3) + t * np.abs(c.d4))))
    return share


def orbit_bounds(c: NearEarth, start_s: float, span_s: float) -> Bounds:
    """Return bounds that hold from POSIX seconds start_s for span_s seconds."""
    t = np.maximum(np.abs(start_s - c.epoch_s), np.abs(start_s + span_s - c.epoch_s)) / 60.0
    drag = _drag_share(c, t)
    e = c.ecco + np.abs(c.bstar) * (np.abs(c.cc4) * t + 2.0 * np.abs(c.cc5)) + 1e-6
    regular = (drag < _MOST_DRAG) & (e < 0.99)
    e = np.minimum(e, 0.99)
    low, high = c.ao * (1.0 - drag) ** 2, c.ao * (1.0 + drag) ** 2
    low = np.where(regular, low, c.ao)
    sway = short_period_bound_km(c, low, e)
    e = e + np.abs(c.aycof) / (low * (1.0 - e * e))
    lowest = low * (1.0 - e) * RADIUS_KM - sway
    highest = high * (1.0 + e) * RADIUS_KM + sway
    regular &= lowest > RADIUS_KM
    safe = np.maximum(lowest, 0.9 * RADIUS_KM)
    speed = np.sqrt(2.0 * _MU_KM3_S2 / safe) * _GRAVITY_SLACK + _EARTH_RAD_S * safe
    bend = _MU_KM3_S2 / safe**2 * _GRAVITY_SLACK + 2.0 * _EARTH_RAD_S * speed + _EARTH_RAD_S**2 * highest
    return Bounds(regular, safe, highest, speed, bend, sway + _SLACK_KM)


def possible_windows(
    c: NearEarth, bounds: Bounds, ground: Ground, start_s: float, span_s: float, lowest_deg: float
) -> Windows:
    """Return the windows, cut to the span, outside which no object is above `lowest_deg` of altitude."""
    sine = math.sin(math.radians(lowest_deg))
    obj, first, last = _stretches(c, bounds, ground, (start_s, span_s), lowest_deg)
    # Single precision for what follows; it counts from the middle of the span, where it is best.
    rough = _Rough(c, ground, start_s, span_s, sine)
    # Neighbours share an end, which is worked out once: an end is new where the stretch before is not kept.
    new = np.ones(len(obj), dtype=bool)
    new[1:] = (obj[1:] != obj[:-1]) | (first[1:] != last[:-1])
    z_last = rough.height_km(obj, last)
    z_first = np.empty_like(z_last)
    z_first[1:] = z_last[:-1]
    z_first[new] = rough.height_km(obj[new], first[new])
    margin = (1.0 + abs(sine)) * bounds.margin_km
    # Below the horizon a satellite is no nearer than its height over the site, nor than the looks allow.
    nearest = np.maximum(bounds.lowest_km - ground.distance_km, 50.0)
    bend = bounds.bend * (1.0 + abs(sine)) + max(sine, 0.0) * bounds.speed**2 / nearest
    for halving in range(_HALVINGS + 1):
        keep = highest_between(z_first, z_last, bend[obj], last - first) > -margin[obj]
        obj, first, last = obj[keep], first[keep], last[keep]
        z_first, z_last = z_first[keep], z_last[keep]
        if halving == _HALVINGS:
            break
        middle = 0.5 * (first + last)
        z = rough.height_km(obj, middle)
        obj = np.repeat(obj, 2)
        first, last = _interleaved(first, middle), _interleaved(middle, last)
        z_first, z_last = _interleaved(z_first, z), _interleaved(z, z_last)
    new = np.ones(len(obj), dtype=bool)
    new[1:] = (obj[1:] != obj[:-1]) | (first[1:] != last[:-1])
    starts = np.flatnonzero(new)
    ends = np.concatenate([starts[1:], [len(obj)]])[: len(starts)] - 1
    return Windows(obj[starts], first[starts], last[ends])


def _stretches(
    c: NearEarth, bounds: Bounds, ground: Ground, span: tuple[float, float], lowest_deg: float
) -> tuple[Index, Array, Array]:
    """Return object, first and last second of even stretches in which the orbit's plane is near the site."""
    start_s, span_s = span
    count = np.ceil(span_s / c.period_s * _STRETCHES_A_TURN).astype(np.intp)
    obj = np.repeat(np.arange(len(count)), count)
    number = np.arange(len(obj)) - np.repeat(np.cumsum(count) - count, count)
    length = span_s / count
    middle = (number + 0.5) * length[obj]
    t = ((start_s - c.epoch_s)[obj] + middle) / 60.0
    node = c.nodeo[obj] + t * (c.nodedot[obj] + c.nodecf[obj] * t)
    x, y, z = ground.direction
    turn = ground.turn_rad(start_s, middle) - node
    # The sine of the site's angle from the plane: its direction times the plane's normal.
    off_plane = c.cosio[obj] * z - c.sinio[obj] * (x * np.sin(turn) + y * np.cos(turn))
    # The site's vertical is not quite its direction from the Earth's centre.
    least = math.radians(lowest_deg) - ground.tilt_rad
    reach = np.arccos(np.minimum(ground.distance_km * math.cos(least) / bounds.highest_km, 1.0)) - least
    reach = np.where(ground.distance_km < bounds.highest_km, reach, math.pi / 2.0)
    reach = reach + bounds.margin_km / bounds.lowest_km
    t_most = np.abs(c.nodecf) * np.maximum(np.abs(start_s - c.epoch_s), np.abs(start_s + span_s - c.epoch_s))
    sway = 0.5 * length * (_EARTH_RAD_S * 1.001 + (np.abs(c.nodedot) + t_most / 30.0) / 60.0)
    bound = np.where(reach < math.pi / 2.0, np.sin(np.clip(reach, 0.0, math.pi / 2.0)), 2.0) + sway
    keep = np.abs(off_plane) <= bound[obj]
    obj, number = obj[keep], number[keep]
    step = length[obj]
    return obj, number * step, np.where(number + 1 == count[obj], span_s, (number + 1) * step)


class _Rough:
    """Heights over the horizon of mean orbits, in single precision."""

    def __init__(self, c: NearEarth, ground: Ground, start_s: float, span_s: float, sine: float) -> None:
        self._middle_s = 0.5 * span_s
        self._c = c.advanced(start_s + self._middle_s)
        self._age_min: Array = ((start_s + self._middle_s - c.epoch_s) / 60.0).astype(np.float32)
        self._turn = ground.turn_rad(start_s, np.array([self._middle_s]))[0] % (2.0 * math.pi)
        self._ground, self._sine = ground, sine

    def height_km(self, obj: Index, since_s: Array) -> Array:
        """Return z, km, of objects by index, each at its own second of the span."""
        c, ground = self._c.spread(obj), self._ground
        since: Array = ((since_s - self._middle_s) / 60.0).astype(np.float32)
        orbit = mean_orbit(c, self._age_min[obj] + since, since)
        cosu, sinu, radius, _, _ = in_plane(orbit, exact=False)
        node = orbit.node - np.float32(_EARTH_RAD_S * 60.0) * since - np.float32(self._turn)
        radius = radius * np.float32(RADIUS_KM)
        cosu, sinu = cosu * radius, sinu * radius
        cn, sn = np.cos(node), np.sin(node)
        across = sinu * c.cosio
        x, y, z = cosu * cn - across * sn, cosu * sn + across * cn, sinu * c.sinio
        (sx, sy, sz), (ux, uy, uz) = ground.place, ground.up
        qx, qy, qz = x - sx, y - sy, z - sz
        distance = np.sqrt(qx * qx + qy * qy + qz * qz)
        height: Array = qx * ux + qy * uy + qz * uz - self._sine * distance
        return height.astype(np.float64)


def _interleaved(one: Array, other: Array) -> Array:
    return np.stack([one, other], axis=1).ravel()
