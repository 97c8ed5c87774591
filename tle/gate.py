"""When objects near the Earth may be above a horizon at all, from their mean orbits, so cheaply that SGP4 is
asked round possible passes only.

**The gate cannot close on a pass.** It follows `near_earth.mean_orbit`, which is SGP4 with its drag, its
secular and its long-period terms, and leaves out only the four terms of twice the argument of latitude; their
amplitudes add up to `short_period_bound_km`, 10 to 40 km. With z = q·û - sin a |q| (positive where the
altitude exceeds a) a shift of the satellite by d changes z by (1 + |sin a|) d at most, so that a satellite
above has z > -(1 + |sin a|) d in the mean orbit. Between two instants z stays under a parabola whose bend
follows from the orbit's lowest point (see `crossings`); a stretch is dropped where that parabola stays under
the margin. Before that, stretches are dropped in which the satellite stands so far round the Earth from the
site that no point on or under the apogee is above: first by the angle between the orbit's plane and the site,
which over a stretch changes by no more than the Earth and the node turn, then by the angle between the site
and the mean satellite, from which the true one is at most three eccentricities away (the equation of the
centre stays under 3e for any e), and which goes on by no more than the mean motion.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from tle.arcs import Windows, even_pieces, fit_arcs, longest_piece_s, terms_for
from tle.crossings import Crossings, find_crossings, highest_between
from tle.earth import EVEN_TURN_RAD_S
from tle.elements import MU_KM3_S2, RADIUS_KM
from tle.near_earth import in_plane, mean_longitude, mean_orbit, short_period_bound_km, teme_km

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tle.earth import Ground
    from tle.horizon import Horizon
    from tle.near_earth import NearEarth

    Array = NDArray[np.float64]
    Index = NDArray[np.intp]

STRETCHES_A_TURN = 8
# Below this eccentricity the mean longitude alone tells well enough where an object is.
ROUND_BELOW = 0.02
HALVINGS = 2
# The equation of the centre in eccentricities, at most.
_CENTRE = 3.0
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
    eccentricity: Array
    drag: Array
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
    speed = np.sqrt(2.0 * MU_KM3_S2 / safe) * _GRAVITY_SLACK + EVEN_TURN_RAD_S * safe
    bend = MU_KM3_S2 / safe**2 * _GRAVITY_SLACK + 2.0 * EVEN_TURN_RAD_S * speed + EVEN_TURN_RAD_S**2 * highest
    return Bounds(regular, safe, highest, e, drag, speed, bend, sway + _SLACK_KM)


class Gate(NamedTuple):
    """What decides about the stretches of each object; shapes (n,).

    An object has so many `stretches` of `step_s`. It can be above only where the sine of the site's angle
    from its plane is at most `plane_sine`, the cosine of its angle round the Earth from the site, in the
    middle of the stretch, is at least `round_cosine`, and a parabola of `bend` rises over `-margin_km`. At
    the instant itself the mean satellite is within `reach_rad` of the site, whose direction seen from the
    orbit's plane turns by at most `sway_rad_s`.
    """

    stretches: Index
    step_s: Array
    plane_sine: Array
    round_cosine: Array
    margin_km: Array
    bend: Array
    reach_rad: Array
    sway_rad_s: Array


def gate_of(
    c: NearEarth,
    bounds: Bounds,
    ground: Ground,
    span: tuple[float, float],
    lowest_deg: float,
    a_turn: Array | float = STRETCHES_A_TURN,
) -> Gate:
    """Return the gate of each object, with stretches so many a turn, over a span (first second, length)."""
    start_s, span_s = span
    count = np.maximum(np.ceil(span_s / c.period_s * a_turn), 1.0)
    step_s = span_s / count
    # The site's vertical is not quite its direction from the Earth's centre.
    least = math.radians(lowest_deg) - ground.tilt_rad
    reach = np.arccos(np.minimum(ground.distance_km * math.cos(least) / bounds.highest_km, 1.0)) - least
    reach = np.where(ground.distance_km < bounds.highest_km, reach, math.pi)
    reach = reach + bounds.margin_km / bounds.lowest_km
    t_most = np.abs(c.nodecf) * np.maximum(np.abs(start_s - c.epoch_s), np.abs(start_s + span_s - c.epoch_s))
    sway_rad_s = EVEN_TURN_RAD_S * 1.001 + (np.abs(c.nodedot) + t_most / 30.0) / 60.0
    sway = 0.5 * step_s * sway_rad_s
    plane = np.where(reach < math.pi / 2.0, np.sin(np.clip(reach, 0.0, math.pi / 2.0)), 2.0) + sway
    # SGP4's own quickening by drag is three times its share at most.
    motion = (np.abs(c.mdot) + np.abs(c.argpdot)) * (1.0 + 4.0 * bounds.drag) / 60.0
    t = np.maximum(np.abs(start_s - c.epoch_s), np.abs(start_s + span_s - c.epoch_s)) / 60.0
    quickening = np.abs(c.t2cof) + t * 3.0 * np.abs(c.t3cof)
    quickening += t * t * (6.0 * np.abs(c.t4cof) + t * 10.0 * np.abs(c.t5cof))
    uneven = c.no * quickening * (step_s / 60.0) ** 2
    reach = reach + _CENTRE * bounds.eccentricity + np.abs(c.xlcof) / c.ao + uneven + 1e-4
    aside = reach + sway + 0.5 * step_s * motion
    sine = math.sin(math.radians(lowest_deg))
    # Below the horizon a satellite is no nearer than its height over the site, nor than the looks allow.
    nearest = np.maximum(bounds.lowest_km - ground.distance_km, 50.0)
    return Gate(
        stretches=count.astype(np.intp),
        step_s=step_s,
        plane_sine=plane,
        round_cosine=np.where(aside < math.pi, np.cos(np.minimum(aside, math.pi)), -2.0),
        margin_km=(1.0 + abs(sine)) * bounds.margin_km,
        bend=bounds.bend * (1.0 + abs(sine)) + max(sine, 0.0) * bounds.speed**2 / nearest,
        reach_rad=reach,
        sway_rad_s=sway_rad_s,
    )


def possible_windows(
    c: NearEarth, bounds: Bounds, ground: Ground, start_s: float, span_s: float, lowest_deg: float
) -> Windows:
    """Return the windows, cut to the span, outside which no object is above `lowest_deg` of altitude."""
    is_round = bounds.eccentricity < ROUND_BELOW
    span = (start_s, span_s)
    parts = []
    for index, find in ((np.flatnonzero(is_round), _round_windows), (np.flatnonzero(~is_round), _windows)):
        if len(index):
            all_ = len(index) == len(is_round)
            some, some_bounds = (c, bounds) if all_ else (c.take(index), bounds.take(index))
            found = find(some, some_bounds, ground, span, lowest_deg)
            parts.append(found if all_ else replace(found, obj=index[found.obj]))
    if len(parts) == 1:
        return parts[0]
    return Windows(
        np.concatenate([np.empty(0, dtype=np.intp), *(w.obj for w in parts)]),
        np.concatenate([np.empty(0), *(w.first_s for w in parts)]),
        np.concatenate([np.empty(0), *(w.last_s for w in parts)]),
    )


def _round_windows(
    c: NearEarth, bounds: Bounds, ground: Ground, span: tuple[float, float], lowest_deg: float
) -> Windows:
    """Return the windows of orbits about round, turn by turn, by the mean satellite's angle from the site.

    The site is taken as at rest in the orbit's plane, first at the turn's middle, then at that of the time
    found; by as far as it may move meanwhile, the angle allowed is wider.
    """
    start_s, span_s = span
    gate = gate_of(c, bounds, ground, span, lowest_deg, 1.0)
    obj = np.repeat(np.arange(len(gate.stretches)), gate.stretches)
    number = np.arange(len(obj)) - np.repeat(np.cumsum(gate.stretches) - gate.stretches, gate.stretches)
    step = gate.step_s[obj]
    low = number * step
    near = _Near(c, gate, ground, start_s)
    offset, half, turn_s = near.when(obj, low + 0.5 * step, 0.5 * step)
    keep = np.flatnonzero(half >= 0.0)
    obj, low, step, half, turn_s = obj[keep], low[keep], step[keep], half[keep], turn_s[keep]
    about = low + 0.5 * step + offset[keep]
    # The nearest time may lie over either end of the turn, and belong to the next one too.
    whose, places = [np.arange(len(obj))], [about]
    for side in (-1.0, 1.0):
        other = about + side * turn_s
        over = np.flatnonzero((other + half > low) & (other - half < low + step) & (half < 0.5 * step))
        whose.append(over)
        places.append(other[over])
    own, about = np.concatenate(whose), np.concatenate(places)
    obj, low, half = obj[own], low[own], half[own]
    high = np.minimum(np.minimum(low + step[own], about + half), span_s)
    low = np.maximum(low, about - half)
    again, less, _ = near.when(obj, about, half)
    first = np.maximum(low, about + again - less)
    last = np.minimum(high, about + again + less)
    keep = np.flatnonzero((less >= 0.0) & (first < last))
    keep = keep[np.lexsort((first[keep], obj[keep]))]
    return _merged(obj[keep], first[keep], last[keep])


def _merged(obj: Index, first: Array, last: Array) -> Windows:
    """Return stretches, in order of object and time, with those that touch put together."""
    new = np.ones(len(obj), dtype=bool)
    # Neighbours that are computed apart may miss each other by rounding.
    new[1:] = (obj[1:] != obj[:-1]) | (first[1:] > last[:-1] + 1e-6)
    starts = np.flatnonzero(new)
    ends = np.append(starts[1:], len(obj))[: len(starts)] - 1
    return Windows(obj[starts], first[starts], last[ends])


class _Near:
    """When mean satellites may be near the site."""

    def __init__(self, c: NearEarth, gate: Gate, ground: Ground, start_s: float) -> None:
        self._c, self._gate, self._ground, self._start_s = c, gate, ground, start_s
        self._age_min = (start_s - c.epoch_s) / 60.0
        self._longitude = mean_longitude(c)

    def when(self, obj: Index, since_s: Array, about_s: Array) -> tuple[Array, Array, Array]:
        """Return seconds to the middle, and half the length, of times near the site; and of a turn.

        Instants are seconds of the span, the answer holds for `about_s` on both sides. A negative length
        means never.
        """
        c, gate = self._c, self._gate
        x, y, z = self._ground.direction
        t = self._age_min[obj] + since_s / 60.0
        node = c.nodeo[obj] + t * (c.nodedot[obj] + c.nodecf[obj] * t)
        turn = self._ground.turn_rad(self._start_s, since_s) - node
        cos, sin = np.cos(turn), np.sin(turn)
        along = x * cos - y * sin
        ahead = c.cosio[obj] * (x * sin + y * cos) + c.sinio[obj] * z
        powers = self._longitude
        mean = powers[-1][obj]
        rate: Array = np.zeros_like(mean)
        for power in powers[-2::-1]:
            rate = rate * t + mean
            mean = mean * t + power[obj]
        rate = rate / 60.0
        reach = gate.reach_rad[obj] + gate.sway_rad_s[obj] * about_s
        cosine = np.cos(np.minimum(reach, math.pi))
        nearest = np.sqrt(along * along + ahead * ahead)
        half = np.arccos(np.minimum(np.abs(cosine / nearest), 1.0)) / rate
        half = np.where(nearest <= cosine, -1.0, half)
        offset = np.arctan2(ahead, along) - mean
        offset -= 2.0 * math.pi * np.floor(offset / (2.0 * math.pi) + 0.5)
        always = reach >= math.pi / 2.0
        return (
            np.where(always, 0.0, offset / rate),
            np.where(always, about_s, half),
            2.0 * math.pi / rate,
        )


def _windows(
    c: NearEarth, bounds: Bounds, ground: Ground, span: tuple[float, float], lowest_deg: float
) -> Windows:
    """Return the windows of any orbits."""
    start_s, span_s = span
    sine = math.sin(math.radians(lowest_deg))
    gate = gate_of(c, bounds, ground, (start_s, span_s), lowest_deg)
    obj, first, last = _stretches(c, gate, ground, (start_s, span_s))
    # Single precision for what follows; it counts from the middle of the span, where it is best.
    rough = _Rough(c, ground, start_s, span_s, sine)
    # Neighbours share an end, which is worked out once: an end is new where the stretch before is not kept.
    new = np.ones(len(obj), dtype=bool)
    new[1:] = (obj[1:] != obj[:-1]) | (first[1:] != last[:-1])
    z_last = rough.height_km(obj, last)
    z_first = np.empty_like(z_last)
    z_first[1:] = z_last[:-1]
    z_first[new] = rough.height_km(obj[new], first[new])
    for halving in range(HALVINGS + 1):
        keep = highest_between(z_first, z_last, gate.bend[obj], last - first) > -gate.margin_km[obj]
        obj, first, last = obj[keep], first[keep], last[keep]
        z_first, z_last = z_first[keep], z_last[keep]
        if halving == HALVINGS:
            break
        middle = 0.5 * (first + last)
        z = rough.height_km(obj, middle)
        obj = np.repeat(obj, 2)
        first, last = _interleaved(first, middle), _interleaved(middle, last)
        z_first, z_last = _interleaved(z_first, z), _interleaved(z, z_last)
    return _merged(obj, first, last)


def _stretches(
    c: NearEarth, gate: Gate, ground: Ground, span: tuple[float, float]
) -> tuple[Index, Array, Array]:
    """Return object, first and last second of even stretches in which the object may be near the site."""
    start_s, span_s = span
    obj = np.repeat(np.arange(len(gate.stretches)), gate.stretches)
    number = np.arange(len(obj)) - np.repeat(np.cumsum(gate.stretches) - gate.stretches, gate.stretches)
    middle = (number + 0.5) * gate.step_s[obj]
    t = ((start_s - c.epoch_s) / 60.0)[obj] + middle / 60.0
    turn = ground.turn_rad(start_s, middle) - c.nodeo[obj] - t * (c.nodedot[obj] + c.nodecf[obj] * t)
    x, y, z = ground.direction
    # The site's direction along the node, and across it in the equator.
    cos, sin = np.cos(turn), np.sin(turn)
    across = x * sin + y * cos
    # The sine of the site's angle from the plane: its direction times the plane's normal.
    keep = np.flatnonzero(np.abs(c.cosio[obj] * z - c.sinio[obj] * across) <= gate.plane_sine[obj])
    obj, number, t, across = obj[keep], number[keep], t[keep], across[keep]
    along = x * cos[keep] - y * sin[keep]
    powers = mean_longitude(c)
    longitude = powers[-1][obj]
    for power in powers[-2::-1]:
        longitude = longitude * t + power[obj]
    ahead = c.cosio[obj] * across + c.sinio[obj] * z
    keep = along * np.cos(longitude) + ahead * np.sin(longitude) >= gate.round_cosine[obj]
    obj, number = obj[keep], number[keep]
    step = gate.step_s[obj]
    return obj, number * step, np.where(number + 1 == gate.stretches[obj], span_s, (number + 1) * step)


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
        node = orbit.node - np.float32(EVEN_TURN_RAD_S * 60.0) * since - np.float32(self._turn)
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


def near_crossings(
    c: NearEarth, ground: Ground, span: tuple[float, float], horizon: Horizon
) -> tuple[Crossings, Index]:
    """Return the crossings of near-Earth objects, by index, and those that need a search of their own.

    Those are the ones that decay, or drag beyond all bounds. `span` is its first second (POSIX) and length.
    """
    start_s, span_s = span
    bounds = orbit_bounds(c, start_s, span_s)
    regular = np.flatnonzero(bounds.regular)
    left = np.flatnonzero(~bounds.regular)
    if len(left):
        c, bounds = c.take(regular), bounds.take(regular)
    windows = possible_windows(c, bounds, ground, start_s, span_s, horizon.lowest_deg)
    longest_s = longest_piece_s(c.period_s, c.ecco)[windows.obj]
    arcs, without = fit_arcs(
        windows,
        even_pieces(windows, longest_s),
        lambda obj, since_s: near_places(c, ground, start_s, obj, since_s),
        terms_for(float(c.ecco.max(initial=0.0))),
    )
    found = find_crossings(arcs, horizon)
    return found.renamed(regular), np.concatenate([left, regular[without]])


def near_places(c: NearEarth, ground: Ground, start_s: float, obj: Index, since_s: Array) -> Array:
    """Return places east, north, up, km, shape (3, k, n), of objects by index (k,) at (k, n) seconds."""
    unix_s = start_s + since_s
    return ground.east_north_up(unix_s, teme_km(c.spread(obj).column(), unix_s))
