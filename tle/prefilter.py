"""When objects may be above a horizon at all, from their mean orbits, so that SGP4 is needed only there.

**The prefilter drops no pass.** With z = q·û - sin a |q| (positive where the altitude exceeds a) a shift of
the satellite by d changes z by (1 + |sin a|) d at most, so that a satellite above a has z > -(1 + |sin a|) d
in a mean orbit that is within d of SGP4's. Between two instants z stays under a parabola whose bend follows
from the orbit's lowest point (see `crossings`); a stretch is dropped where that parabola stays under the
margin.

*Near the Earth* the mean orbit is `near_earth.mean_orbit`: SGP4 with its drag, its secular and its
long-period terms. It leaves out only the four terms of twice the argument of latitude; their amplitudes add
up to `short_period_bound_km`, 10 to 40 km. Before that, stretches are dropped in which the satellite is so
far round the Earth from the site that no point on or under the apogee is above: first by the angle between
the orbit's plane and the site, which over a stretch changes by no more than the Earth and the node turn,
then by the angle between the site and the mean satellite, from which the true one is at most three
eccentricities away (the equation of the centre stays under 3e for any e), and which goes on by no more than
the mean motion.

*In deep space* (`DeepSpace`) the mean orbit is the one that SGP4 has in the middle of the span, continued by
Kepler and the drift that J2 makes, over stretches even in eccentric anomaly. `deep_margin_km` bounds what it
leaves out: J2's terms of twice the argument of latitude, drag since the middle, and Moon and Sun. Of these
SDP4 knows each element's amplitude: multiples of s3 = c/n (Spacetrack Report 3, section 6), for both bodies
together 0.0008 a day of period; the multiples of all elements add up to fewer than 60 where the mean
anomaly's share is not raised by a low perigee. So `_BODIES` = 0.05 of the apogee for a day of period; in a
catalogue of 4000 objects it is 0.012 at most. Objects for which all that would say little are not filtered:
periods over `_LONGEST_DAYS`, spans over `_MOST_SPAN_S`, high drag, and inclinations near 180°, where SDP4
divides by the sine of the inclination and its places leap.

No package has such a filter: skyfield and sgp4 evaluate SGP4 at every step of every object.
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from tle.crossings import (
    ROUND_BELOW,
    Crossings,
    Windows,
    anomaly_pieces,
    even_pieces,
    find_crossings,
    fit_arcs,
    highest_between,
    longest_piece_s,
    terms_for,
)
from tle.earth import EVEN_TURN_RAD_S
from tle.elements import MU_KM3_S2, RADIUS_KM
from tle.errors import PropagationError
from tle.instants import DAY_S, UNIX_EPOCH_JD
from tle.near_earth import (
    XKE,
    in_plane,
    mean_longitude,
    mean_orbit,
    mean_start,
    short_period_bound_km,
    start_near_earth,
    teme_km,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from tle.crossings import Pieces
    from tle.earth import Ground
    from tle.elements import Elements
    from tle.horizon import Horizon
    from tle.near_earth import NearEarth

    Array = NDArray[np.float64]
    Index = NDArray[np.intp]
    # Object, cosine and sine of its eccentric anomaly, minutes from the span's middle, seconds of the span.
    Edges = tuple[Index, Array, Array, Array, Array]

STRETCHES_A_TURN = 8
# Below this eccentricity the mean longitude alone tells well enough where an object is.
_MEAN_LONGITUDE_BELOW = 0.02
HALVINGS = 2
# The equation of the centre in eccentricities, at most.
_CENTRE = 3.0
# Beyond this the drag of the elements is no orbit's: such objects are searched without the prefilter.
_MOST_DRAG = 0.02
# Single precision, a rough Kepler's equation, the Earth's turn taken as even; J2's part of gravity (0.3 %).
_SLACK_KM, _GRAVITY_SLACK = 2.0, 1.01
_DEEP_STRETCHES = 16
# Stretches of a piece that polynomials follow, in orbits that are about round and in others.
_ROUND_PIECE, _ECCENTRIC_PIECE = 3, 2
_BODIES, _LONGEST_DAYS, _MOST_SPAN_S, _MOST_DRAG_RAD = 0.05, 1.5, 4.0 * DAY_S, 0.1
_MOST_INCLINATION_RAD = math.radians(150.0)
_DEEP_GRAVITY_SLACK = 1.05


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


class OrbitBounds(NamedTuple):
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

    def take(self, index: Index) -> OrbitBounds:
        """Return the bounds of the objects of these indices."""
        taken: list[Any] = [values[index] for values in self]
        return OrbitBounds(*taken)


def drag_share(c: NearEarth, unix_s: float) -> Array:
    """Return how large SGP4's terms of drag are at an instant, in shares of the square root of the orbit."""
    return _drag_share(c, np.abs(unix_s - c.epoch_s) / 60.0)


def _drag_share(c: NearEarth, t: Array) -> Array:
    share: Array = t * (np.abs(c.cc1) + t * (np.abs(c.d2) + t * (np.abs(c.d3) + t * np.abs(c.d4))))
    return share


def orbit_bounds(c: NearEarth, start_s: float, span_s: float) -> OrbitBounds:
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
    return OrbitBounds(regular, safe, highest, e, drag, speed, bend, sway + _SLACK_KM)


class Prefilter(NamedTuple):
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


def prefilter_of(
    c: NearEarth,
    bounds: OrbitBounds,
    ground: Ground,
    span: tuple[float, float],
    lowest_deg: float,
    a_turn: Array | float = STRETCHES_A_TURN,
) -> Prefilter:
    """Return the prefilter of each object over a span (first second, length): so many stretches a turn."""
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
    return Prefilter(
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
    c: NearEarth, bounds: OrbitBounds, ground: Ground, start_s: float, span_s: float, lowest_deg: float
) -> Windows:
    """Return the windows, cut to the span, outside which no object is above `lowest_deg` of altitude."""
    is_round = bounds.eccentricity < _MEAN_LONGITUDE_BELOW
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
    c: NearEarth, bounds: OrbitBounds, ground: Ground, span: tuple[float, float], lowest_deg: float
) -> Windows:
    """Return the windows of orbits about round, turn by turn, by the mean satellite's angle from the site.

    The site is taken as at rest in the orbit's plane, first at the turn's middle, then at that of the time
    found; by as far as it may move meanwhile, the angle allowed is wider.
    """
    start_s, span_s = span
    prefilter = prefilter_of(c, bounds, ground, span, lowest_deg, 1.0)
    obj = np.repeat(np.arange(len(prefilter.stretches)), prefilter.stretches)
    number = np.arange(len(obj)) - np.repeat(
        np.cumsum(prefilter.stretches) - prefilter.stretches, prefilter.stretches
    )
    step = prefilter.step_s[obj]
    low = number * step
    near = _Near(c, prefilter, ground, start_s)
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

    def __init__(self, c: NearEarth, prefilter: Prefilter, ground: Ground, start_s: float) -> None:
        self._c, self._prefilter, self._ground, self._start_s = c, prefilter, ground, start_s
        self._age_min = (start_s - c.epoch_s) / 60.0
        self._longitude = mean_longitude(c)

    def when(self, obj: Index, since_s: Array, about_s: Array) -> tuple[Array, Array, Array]:
        """Return seconds to the middle, and half the length, of times near the site; and of a turn.

        Instants are seconds of the span, the answer holds for `about_s` on both sides. A negative length
        means never.
        """
        c, prefilter = self._c, self._prefilter
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
        reach = prefilter.reach_rad[obj] + prefilter.sway_rad_s[obj] * about_s
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
    c: NearEarth, bounds: OrbitBounds, ground: Ground, span: tuple[float, float], lowest_deg: float
) -> Windows:
    """Return the windows of any orbits."""
    start_s, span_s = span
    sine = math.sin(math.radians(lowest_deg))
    prefilter = prefilter_of(c, bounds, ground, (start_s, span_s), lowest_deg)
    obj, first, last = _stretches(c, prefilter, ground, (start_s, span_s))
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
        keep = highest_between(z_first, z_last, prefilter.bend[obj], last - first) > -prefilter.margin_km[obj]
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
    c: NearEarth, prefilter: Prefilter, ground: Ground, span: tuple[float, float]
) -> tuple[Index, Array, Array]:
    """Return object, first and last second of even stretches in which the object may be near the site."""
    start_s, span_s = span
    obj = np.repeat(np.arange(len(prefilter.stretches)), prefilter.stretches)
    number = np.arange(len(obj)) - np.repeat(
        np.cumsum(prefilter.stretches) - prefilter.stretches, prefilter.stretches
    )
    middle = (number + 0.5) * prefilter.step_s[obj]
    t = ((start_s - c.epoch_s) / 60.0)[obj] + middle / 60.0
    turn = ground.turn_rad(start_s, middle) - c.nodeo[obj] - t * (c.nodedot[obj] + c.nodecf[obj] * t)
    x, y, z = ground.direction
    # The site's direction along the node, and across it in the equator.
    cos, sin = np.cos(turn), np.sin(turn)
    across = x * sin + y * cos
    # The sine of the site's angle from the plane: its direction times the plane's normal.
    keep = np.flatnonzero(np.abs(c.cosio[obj] * z - c.sinio[obj] * across) <= prefilter.plane_sine[obj])
    obj, number, t, across = obj[keep], number[keep], t[keep], across[keep]
    along = x * cos[keep] - y * sin[keep]
    powers = mean_longitude(c)
    longitude = powers[-1][obj]
    for power in powers[-2::-1]:
        longitude = longitude * t + power[obj]
    ahead = c.cosio[obj] * across + c.sinio[obj] * z
    keep = along * np.cos(longitude) + ahead * np.sin(longitude) >= prefilter.round_cosine[obj]
    obj, number = obj[keep], number[keep]
    step = prefilter.step_s[obj]
    return obj, number * step, np.where(number + 1 == prefilter.stretches[obj], span_s, (number + 1) * step)


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


def near_places(c: NearEarth, ground: Ground, start_s: float, obj: Index, since_s: Array) -> Array:
    """Return places east, north, up, km, shape (3, n, k), of objects by index (k,) at (n, k) seconds."""
    unix_s = start_s + since_s
    return ground.east_north_up(unix_s, teme_km(c.spread(obj), unix_s))


class MeanOrbits(NamedTuple):
    """SGP4's mean orbits at one instant: rad, rad/min; shapes (n,), NaN where SGP4 fails.

    `drag_rad` bounds how far drag moves an object along its orbit within the span, against none.
    """

    motion: Array
    eccentricity: Array
    inclination: Array
    node: Array
    perigee: Array
    anomaly: Array
    drag_rad: Array

    def take(self, index: Index) -> MeanOrbits:
        """Return the orbits of these indices."""
        return MeanOrbits(*(column[index] for column in self))


def drag_rad(c: NearEarth, middle_s: float, span_s: float) -> Array:
    """Return how far drag moves objects along their orbits, rad, within half a span of its middle.

    In deep space SGP4 has the square of time alone, and the eccentricity's linear change.
    """
    half = 0.5 * span_s / 60.0
    age = np.abs(middle_s - c.epoch_s) / 60.0
    along = c.no * np.abs(c.t2cof) * (2.0 * age + half) * half
    drag: Array = along + 2.0 * half * np.abs(c.bstar * c.cc4) + 2.0 * half * np.abs(c.cc1)
    return drag


def can_filter(orbits: MeanOrbits, span_s: float) -> NDArray[np.bool_]:
    """Tell for which orbits the margin is known, so that they can be filtered."""
    with np.errstate(invalid="ignore"):
        days = 2.0 * math.pi / orbits.motion / 1440.0
        short = (days <= _LONGEST_DAYS) & (orbits.eccentricity < 0.95) & (orbits.drag_rad < _MOST_DRAG_RAD)
        short &= orbits.inclination <= _MOST_INCLINATION_RAD
    return short & (span_s <= _MOST_SPAN_S)


def deep_windows(
    orbits: MeanOrbits, ground: Ground, span: tuple[float, float], lowest_deg: float
) -> tuple[Windows, Pieces]:
    """Return windows, cut to the span, outside which no object is above `lowest_deg`, and their pieces.

    `orbits` hold in the middle of the span (first second, length), and are ones that `can_filter` allows.
    """
    start_s, span_s = span
    c = mean_start(orbits.eccentricity, orbits.inclination, orbits.motion)
    rate = c.mdot
    # Edges are numbered from the perigee before the span's middle; all of the span lies between the outer.
    e = orbits.eccentricity
    half_min = 0.5 * span_s / 60.0
    first_mean, last_mean = orbits.anomaly - half_min * rate, orbits.anomaly + half_min * rate
    low = np.floor(first_mean / (2.0 * math.pi)).astype(np.intp) * _DEEP_STRETCHES
    high = np.ceil(last_mean / (2.0 * math.pi)).astype(np.intp) * _DEEP_STRETCHES
    count = high - low + 1
    obj = np.repeat(np.arange(len(count)), count)
    number = low[obj] + np.arange(len(obj)) - np.repeat(np.cumsum(count) - count, count)
    anomaly = number * (2.0 * math.pi / _DEEP_STRETCHES)
    cos, sin = np.cos(anomaly), np.sin(anomaly)
    since_min = (anomaly - e[obj] * sin - orbits.anomaly[obj]) / rate[obj]
    edge_s = 0.5 * span_s + since_min * 60.0
    q = _from_site(orbits, c, ground, start_s, (obj, cos, sin, since_min, edge_s))
    sine = math.sin(math.radians(lowest_deg))
    ux, uy, uz = ground.up
    z = q[0] * ux + q[1] * uy + q[2] * uz - sine * np.sqrt(np.sum(q * q, axis=0))
    axis_km = RADIUS_KM * (XKE / orbits.motion) ** (2.0 / 3.0)
    radius_km = axis_km[obj] * (1.0 - e[obj] * cos)
    # From here on a stretch is what lies between an edge and the next.
    of = np.flatnonzero(obj[1:] == obj[:-1])
    inside = (edge_s[of + 1] > 0.0) & (edge_s[of] < span_s)
    of = of[inside]
    own = obj[of]
    margin = deep_margin_km(orbits, c, axis_km, span_s)[own]
    nearest = np.maximum(np.minimum(radius_km[of], radius_km[of + 1]) - margin, 0.9 * RADIUS_KM)
    farthest = np.maximum(radius_km[of], radius_km[of + 1]) + margin
    speed = np.sqrt(2.0 * MU_KM3_S2 / nearest) * _DEEP_GRAVITY_SLACK + EVEN_TURN_RAD_S * farthest
    bend = (
        MU_KM3_S2 / nearest**2 * _DEEP_GRAVITY_SLACK
        + 2.0 * EVEN_TURN_RAD_S * speed
        + EVEN_TURN_RAD_S**2 * farthest
    )
    to_site = np.maximum(nearest - ground.distance_km, 50.0)
    bend = bend * (1.0 + abs(sine)) + max(sine, 0.0) * speed**2 / to_site
    length = edge_s[of + 1] - edge_s[of]
    keep = highest_between(z[of], z[of + 1], bend, length) > -(1.0 + abs(sine)) * margin
    of, own = of[keep], own[keep]
    return _joined(of, own, e[own] < ROUND_BELOW, np.clip(edge_s, 0.0, span_s))


def _from_site(orbits: MeanOrbits, c: NearEarth, ground: Ground, start_s: float, edges: Edges) -> Array:
    """Return places relative to the site, in the axes of the ITRS, km, shape (3, m), at edges."""
    obj, cos, sin, since_min, edge_s = edges
    e, axis_km = orbits.eccentricity, RADIUS_KM * (XKE / orbits.motion) ** (2.0 / 3.0)
    perigee = orbits.perigee[obj] + c.argpdot[obj] * since_min
    node = orbits.node[obj] + c.nodedot[obj] * since_min - ground.turn_rad(start_s, edge_s)
    x = axis_km[obj] * (cos - e[obj])
    y = (axis_km * np.sqrt(1.0 - e * e))[obj] * sin
    cw, sw, cn, sn = np.cos(perigee), np.sin(perigee), np.cos(node), np.sin(node)
    u, v = x * cw - y * sw, x * sw + y * cw
    across = v * c.cosio[obj]
    sx, sy, sz = ground.place
    return np.stack([u * cn - across * sn - sx, u * sn + across * cn - sy, v * c.sinio[obj] - sz])


def deep_margin_km(orbits: MeanOrbits, c: NearEarth, axis_km: Array, span_s: float) -> Array:
    """Return how far SGP4's place can be from that of the mean orbit, km."""
    e = orbits.eccentricity
    days = 2.0 * math.pi / orbits.motion / 1440.0
    bodies = _BODIES * days * max(1.0, span_s / DAY_S) * axis_km * (1.0 + e)
    drag = orbits.drag_rad * axis_km * np.sqrt((1.0 + e) / (1.0 - e))
    margin: Array = bodies + drag + short_period_bound_km(c, axis_km / RADIUS_KM, e) + 2.0
    return margin


def _joined(of: Index, own: Index, is_round: NDArray[np.bool_], edge_s: Array) -> tuple[Windows, Pieces]:
    """Return stretches, by first edge, joined to windows and to pieces of these."""
    new = np.ones(len(of), dtype=bool)
    new[1:] = (own[1:] != own[:-1]) | (of[1:] != of[:-1] + 1)
    starts = np.flatnonzero(new)
    window = np.cumsum(new) - 1
    place = np.arange(len(of)) - starts[window] if len(of) else np.empty(0, dtype=np.intp)
    cut = place % np.where(is_round, _ROUND_PIECE, _ECCENTRIC_PIECE) == 0
    pieces = np.flatnonzero(cut)
    window_ends = np.append(starts[1:], len(of))[: len(starts)] - 1
    piece_ends = np.append(pieces[1:], len(of))[: len(pieces)] - 1
    windows = Windows(own[starts], edge_s[of[starts]], edge_s[of[window_ends] + 1])
    return windows, (window[pieces], edge_s[of[pieces]], edge_s[of[piece_ends] + 1])


class DeepSpace:
    """Some objects with periods of 225 minutes and more over a site, during a span of (POSIX) seconds."""

    def __init__(self, elements: Sequence[Elements], ground: Ground, span: tuple[float, float]) -> None:
        """Start SGP4 for each."""
        self._elements, self._ground = elements, ground
        self._start_s, self._span_s = span
        self._records = [_record(one) for one in elements]

    def windows(self, lowest_deg: float) -> tuple[Windows, Pieces]:
        """Return the windows outside which nothing is above an altitude in degrees, and pieces of them."""
        orbits = self.mean_orbits()
        is_filtered = can_filter(orbits, self._span_s)
        open_, closed = np.flatnonzero(~is_filtered), np.flatnonzero(is_filtered)
        span = (self._start_s, self._span_s)
        some, (window, first, last) = deep_windows(orbits.take(closed), self._ground, span, lowest_deg)
        each = [
            anomaly_pieces(self._elements[i], *span, len(some.obj) + k) for k, i in enumerate(open_.tolist())
        ]
        windows = Windows(
            np.concatenate([closed[some.obj], open_]),
            np.concatenate([some.first_s, np.zeros(len(open_))]),
            np.concatenate([some.last_s, np.full(len(open_), self._span_s)]),
        )
        return windows, (
            np.concatenate([window, *(piece[0] for piece in each)]),
            np.concatenate([first, *(piece[1] for piece in each)]),
            np.concatenate([last, *(piece[2] for piece in each)]),
        )

    def places(self, obj: Index, since_s: Array) -> Array:
        """Return places east, north, up, km, shape (3, n, k), of objects by index (k,) at (n, k) seconds."""
        unix_s = self._start_s + since_s
        days = np.floor(unix_s / DAY_S)
        jd, fraction = (days + UNIX_EPOCH_JD).T, ((unix_s - days * DAY_S) / DAY_S).T
        # Resonant orbits are integrated from the epoch on: one object after the other, in order of time.
        order = np.lexsort((since_s[0], obj))
        jd, fraction = jd[order], fraction[order]
        places = np.full((*jd.shape, 3), np.nan)
        edges = np.flatnonzero(np.diff(obj[order], prepend=-1, append=-1)).tolist()
        for low, high in pairwise(edges):
            record = self._records[int(obj[order[low]])]
            if record is None:
                continue
            code, r, _ = record.sgp4_array(jd[low:high].ravel(), fraction[low:high].ravel())
            if code.any():
                r[code != 0] = math.nan
            places[order[low:high]] = r.reshape(high - low, -1, 3)
        x, y, z = np.ascontiguousarray(places.transpose(2, 1, 0))
        return self._ground.east_north_up(unix_s, (x, y, z))

    def mean_orbits(self) -> MeanOrbits:
        """Return the mean orbits in the middle of the span."""
        middle_s = self._start_s + 0.5 * self._span_s
        days = math.floor(middle_s / DAY_S)
        jd, fraction = days + UNIX_EPOCH_JD, middle_s / DAY_S - days
        rows = np.full((len(self._records), 6), math.nan)
        for k, record in enumerate(self._records):
            if record is not None and record.sgp4(jd, fraction)[0] == 0:
                # SGP4 leaves the mean elements of the last instant in its record.
                rows[k] = (record.nm, record.em, record.im, record.Om, record.om, record.mm)
        drag = drag_rad(start_near_earth(self._elements), middle_s, self._span_s)
        motion, eccentricity, inclination, node, perigee, anomaly = rows.T
        return MeanOrbits(motion, eccentricity, inclination, node, perigee, anomaly, drag)


def _record(elements: Elements):  # type: ignore[no-untyped-def]
    """Return SGP4's record, None where it takes the elements for none."""
    try:
        return elements.satrec()
    except PropagationError:
        return None
