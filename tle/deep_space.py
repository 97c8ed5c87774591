"""Objects in deep space, by the `sgp4` package: when they may be above a horizon at all, and where they are.

**Where the gate is used it cannot close on a pass.** It follows the mean orbit that SGP4 has in the middle of
the span, by Kepler and the drift that J2 makes, over stretches even in eccentric anomaly. What it leaves out
is bounded by `margin_km`: J2's terms of twice the argument of latitude (`short_period_bound_km`), drag since
the middle, and Moon and Sun. Of these SDP4 knows each element's amplitude: multiples of s3 = c/n (Spacetrack
Report 3, section 6), for both bodies together 0.0008 a day of period; the multiples of all elements add up to
fewer than 60 where the mean anomaly's share is not raised by a low perigee. So `_BODIES` = 0.05 of the apogee
for a day of period; in a catalogue of 4000 objects it is 0.012 at most. Below it, between two looks, a
satellite stays under a parabola that bends as much as gravity and the turning frame make it where the stretch
is nearest to the Earth (see `crossings`), so that stretches under the margin hold no pass. Objects for which
all that would say little are left alone: periods over `_LONGEST_DAYS`, spans over `_MOST_SPAN_S`, high drag,
and inclinations near 180°, where SDP4 divides by the sine of the inclination and its places leap.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from tle.arcs import ROUND_BELOW, Windows, anomaly_pieces
from tle.crossings import highest_between
from tle.earth import EVEN_TURN_RAD_S
from tle.elements import MU_KM3_S2, RADIUS_KM
from tle.errors import PropagationError
from tle.instants import DAY_S, UNIX_EPOCH_JD
from tle.near_earth import XKE, mean_start, short_period_bound_km, start_near_earth

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from tle.arcs import Pieces
    from tle.earth import Ground
    from tle.elements import Elements
    from tle.near_earth import NearEarth

    Array = NDArray[np.float64]
    Index = NDArray[np.intp]
    # Object, cosine and sine of its eccentric anomaly, minutes from the span's middle, seconds of the span.
    Edges = tuple[Index, Array, Array, Array, Array]

_STRETCHES = 16
# Stretches of a piece that polynomials follow, in orbits that are about round and in others.
_ROUND_PIECE, _ECCENTRIC_PIECE = 3, 2
_BODIES, _LONGEST_DAYS, _MOST_SPAN_S, _MOST_DRAG_RAD = 0.05, 1.5, 4.0 * DAY_S, 0.1
_MOST_INCLINATION_RAD = math.radians(150.0)
_GRAVITY_SLACK = 1.05


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


def gated(orbits: MeanOrbits, span_s: float) -> NDArray[np.bool_]:
    """Tell for which orbits the gate holds."""
    with np.errstate(invalid="ignore"):
        days = 2.0 * math.pi / orbits.motion / 1440.0
        short = (days <= _LONGEST_DAYS) & (orbits.eccentricity < 0.95) & (orbits.drag_rad < _MOST_DRAG_RAD)
        short &= orbits.inclination <= _MOST_INCLINATION_RAD
    return short & (span_s <= _MOST_SPAN_S)


def deep_windows(
    orbits: MeanOrbits, ground: Ground, span: tuple[float, float], lowest_deg: float
) -> tuple[Windows, Pieces]:
    """Return windows, cut to the span, outside which no object is above `lowest_deg`, and their pieces.

    `orbits` hold in the middle of the span (first second, length), and are ones that can be `gated`.
    """
    start_s, span_s = span
    c = mean_start(orbits.eccentricity, orbits.inclination, orbits.motion)
    rate = c.mdot
    # Edges are numbered from the perigee before the span's middle; all of the span lies between the outer.
    e = orbits.eccentricity
    half_min = 0.5 * span_s / 60.0
    first_mean, last_mean = orbits.anomaly - half_min * rate, orbits.anomaly + half_min * rate
    low = np.floor(first_mean / (2.0 * math.pi)).astype(np.intp) * _STRETCHES
    high = np.ceil(last_mean / (2.0 * math.pi)).astype(np.intp) * _STRETCHES
    count = high - low + 1
    obj = np.repeat(np.arange(len(count)), count)
    number = low[obj] + np.arange(len(obj)) - np.repeat(np.cumsum(count) - count, count)
    anomaly = number * (2.0 * math.pi / _STRETCHES)
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
    margin = _margin_km(orbits, c, axis_km, span_s)[own]
    nearest = np.maximum(np.minimum(radius_km[of], radius_km[of + 1]) - margin, 0.9 * RADIUS_KM)
    farthest = np.maximum(radius_km[of], radius_km[of + 1]) + margin
    speed = np.sqrt(2.0 * MU_KM3_S2 / nearest) * _GRAVITY_SLACK + EVEN_TURN_RAD_S * farthest
    bend = (
        MU_KM3_S2 / nearest**2 * _GRAVITY_SLACK
        + 2.0 * EVEN_TURN_RAD_S * speed
        + EVEN_TURN_RAD_S**2 * farthest
    )
    to_site = np.maximum(nearest - ground.distance_km, 50.0)
    bend = bend * (1.0 + abs(sine)) + max(sine, 0.0) * speed**2 / to_site
    length = edge_s[of + 1] - edge_s[of]
    keep = highest_between(z[of], z[of + 1], bend, length) > -(1.0 + abs(sine)) * margin
    of, own = of[keep], own[keep]
    return _joined(of, own, e[own] < ROUND_BELOW, np.clip(edge_s, 0.0, span_s))


def mean_places(
    orbits: MeanOrbits, ground: Ground, span: tuple[float, float], since_s: float
) -> tuple[Array, Array]:
    """Return where the gate takes each object to be at one second of a span, and its margin for that, km.

    Places are east, north, up of the site, shape (3, n).
    """
    c = mean_start(orbits.eccentricity, orbits.inclination, orbits.motion)
    since_min = np.full(len(c.ecco), (since_s - 0.5 * span[1]) / 60.0)
    e, mean = orbits.eccentricity, orbits.anomaly + c.mdot * since_min
    anomaly = mean + e * np.sin(mean)
    for _ in range(30):
        step = (anomaly - e * np.sin(anomaly) - mean) / (1.0 - e * np.cos(anomaly))
        anomaly -= np.clip(step, -0.9, 0.9)
    edges = (np.arange(len(e)), np.cos(anomaly), np.sin(anomaly), since_min, np.full(len(e), since_s))
    place = _from_site(orbits, c, ground, span[0], edges)
    axis_km = RADIUS_KM * (XKE / orbits.motion) ** (2.0 / 3.0)
    return np.array(ground.axes) @ place, _margin_km(orbits, c, axis_km, span[1])


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


def _margin_km(orbits: MeanOrbits, c: NearEarth, axis_km: Array, span_s: float) -> Array:
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
        is_gated = gated(orbits, self._span_s)
        open_, closed = np.flatnonzero(~is_gated), np.flatnonzero(is_gated)
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
        """Return places east, north, up, km, shape (3, k, n), of objects by index (k,) at (k, n) seconds."""
        unix_s = self._start_s + since_s
        days = np.floor(unix_s / DAY_S)
        jd, fraction = days + UNIX_EPOCH_JD, (unix_s - days * DAY_S) / DAY_S
        # Resonant orbits are integrated from the epoch on: one object after the other, in order of time.
        order = np.lexsort((since_s[:, 0], obj))
        jd, fraction = jd[order], fraction[order]
        places = np.full((*since_s.shape, 3), np.nan)
        edges = np.flatnonzero(np.diff(obj[order], prepend=-1, append=-1)).tolist()
        for low, high in pairwise(edges):
            record = self._records[int(obj[order[low]])]
            if record is None:
                continue
            code, r, _ = record.sgp4_array(jd[low:high].ravel(), fraction[low:high].ravel())
            if code.any():
                r[code != 0] = math.nan
            places[order[low:high]] = r.reshape(high - low, -1, 3)
        x, y, z = np.ascontiguousarray(places.transpose(2, 0, 1))
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
