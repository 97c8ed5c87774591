"""Ways of slews: whether the straight one is clear, and a detour of intermediate slews where it is not.

The mount slews by itself, each axis in its own time, so that nobody knows its way between two places but that
it stays within the box that both span in axis angles: that whole box must be clear. Where the profile says
that the axes go together, the way is the straight line between them. A detour is looked for on a coarse grid
and then judged like any other slew, leg by leg.
"""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass
from functools import partial
from itertools import chain
from typing import TYPE_CHECKING

import numpy as np
from msgspec.structs import replace

from sattrack.core.angles import wrap180
from sattrack.mount.model import SIDEREAL_RATE_DEG_S, beyond_after_slew
from sattrack.safety.geometry import Box, Place

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from sattrack.mount.model import MountProfile
    from sattrack.safety.geometry import Array, Bools

    Judge = Callable[[Box, float], str | None]
    """Names what a box of axis angles is not clear of within so many seconds, or None."""
    Closed = Callable[[Array], Bools]
    Known = dict[tuple[Place, Place, float], tuple[Place, ...] | None]

CELL_DEG = 4.0
NODE_DEG = 12.0
EXEMPT_DEG = 8.0
"""So near to its ends a leg is not judged by the coarse grid, only by the judge."""
HANDSHAKE_S = 2.0
RAMP = 1.5
"""A slew brakes more gently than it can, by so much."""
ABORT_LATER_S = 0.05
ABORT_LONGER = 0.1
"""By how much later, and on how much longer a way, an abort may brake than the slew does by its own plan."""
MOST_APPROACHES = 3
"""Where an abort would lead past a slew's end, the last of its way are so many shorter ones at most."""
MOST_TRIED = 40
STEPS_DEG = (-24.0, -12.0, -6.0, -3.0, 0.0, 3.0, 6.0, 12.0, 24.0)
MOST_PIECES = 600
"""So many pieces of such ways are judged at most: whoever waits for the way is in the real-time loop."""
LINE_S = 0.5
"""What each piece of a way by single axes counts besides its length, so that it turns seldom."""
RINGS_DEG = (
    0.6,
    1.0,
    1.5,
    2.0,
    3.0,
    4.0,
    6.0,
    8.0,
    10.0,
    12.0,
    15.0,
    18.0,
    22.0,
    26.0,
    30.0,
    40.0,
    50.0,
    65.0,
    80.0,
    100.0,
)
RING_PLACES = 24
NEAREST_DEG = 0.3
"""How near to the nearest place there is the one to wait at is looked for."""
WAIT_MARGIN_DEG = 0.25
PIECES = 24
"""Boxes into which a straight way of two axes together is cut."""


@dataclass(frozen=True, slots=True)
class Route:
    """The places to slew to, the last being the goal; or why there is no way, `blocked_by` naming the row."""

    legs: tuple[Place, ...]
    blocked_by: str | None = None


def slew_s(one: Place, other: Place, profile: MountProfile) -> float:
    """Return how long a slew takes at most, from the wish to the mount at rest, seconds."""
    return _ramped_s(one, other, profile, (profile.ra.slew_rate_deg_s, profile.dec.slew_rate_deg_s))


def leg_s(one: Place, other: Place, profile: MountProfile) -> float:
    """Return the same of one more slew on a way, by the rate that it reaches: those to an edge are short."""
    ra, dec = (
        min(axis.slew_rate_deg_s, math.sqrt(abs(to - at) * axis.max_acceleration_deg_s2))
        for at, to, axis in zip(one, other, (profile.ra, profile.dec), strict=True)
    )
    return _ramped_s(one, other, profile, (ra, dec))


def _ramped_s(one: Place, other: Place, profile: MountProfile, reached_deg_s: tuple[float, float]) -> float:
    """Return how long a slew takes at most whose axes come to some rates."""
    times = [
        abs(at - to) / axis.slew_rate_deg_s + 2.0 * RAMP * reached / axis.max_acceleration_deg_s2
        for at, to, axis, reached in zip(one, other, (profile.ra, profile.dec), reached_deg_s, strict=True)
    ]
    return HANDSHAKE_S + max(times)


def overshoot_deg(
    one: Place, other: Place, profile: MountProfile, with_late_brake: bool = True
) -> tuple[float, float]:
    """Return how far past its end each axis may come where a slew is aborted, signed, degrees.

    Until an abort acts, `abort_delay_s`, an axis may go on at the rate that it has, also while it brakes.
    `with_late_brake` counts in, of a mount that slews by itself, that braking then builds up anew, and may be
    gentler than the slew's own, which was about to begin. Rates lead gently: an abort stops axes sooner.
    """
    with_late_brake = with_late_brake and profile.geometry is None
    later_s, longer = (ABORT_LATER_S, ABORT_LONGER) if with_late_brake else (0.0, 0.0)
    found = []
    for begin, end, axis in zip(one, other, (profile.ra, profile.dec), strict=True):
        gap_deg = end - begin
        fastest = min(axis.slew_rate_deg_s, math.sqrt(2.0 * axis.max_acceleration_deg_s2 * abs(gap_deg)))
        longer_deg = longer * fastest**2 / (2.0 * axis.max_acceleration_deg_s2)
        found.append(math.copysign(fastest * (profile.abort_delay_s + later_s) + longer_deg, gap_deg))
    return found[0], found[1]


def path_boxes(
    one: Place, other: Place, profile: MountProfile, with_late_brake: bool = True, pieces: int = PIECES
) -> Iterator[Box]:
    """Yield boxes that hold all of a slew's way: where the axes go together, one for each of some pieces."""
    # The mount joins the sky, which moves on while it slews.
    drift_deg = SIDEREAL_RATE_DEG_S * slew_s(one, other, profile)
    ha, dec = overshoot_deg(one, other, profile, with_late_brake)
    ahead = (max(0.0, -ha), max(0.0, ha) + drift_deg, max(0.0, -dec), max(0.0, dec))
    if profile.slew_path == "any" or pieces == 1:
        yield Box.between(one, other).grown(*ahead)
        return
    for k in range(pieces):
        ends = [
            (one[0] + (other[0] - one[0]) * part, one[1] + (other[1] - one[1]) * part)
            for part in (k / pieces, (k + 1) / pieces)
        ]
        yield Box.between(ends[0], ends[1]).grown(*ahead)


def blocked(
    one: Place,
    other: Place,
    profile: MountProfile,
    judge: Judge,
    after_s: float = 0.0,
    with_late_brake: bool = True,
) -> str | None:
    """Return the name of the row that a slew's way is not clear of, or None; it begins in `after_s`."""
    until_s = after_s + slew_s(one, other, profile)
    for pieces in (1, PIECES):
        # All of the box about both ends is clear more often than not.
        names = (judge(box, until_s) for box in path_boxes(one, other, profile, with_late_brake, pieces))
        name = next(filter(None, names), None)
        if name is None or profile.slew_path == "any":
            break
    return name


def find_route(
    start: Place,
    goal: Place,
    profile: MountProfile,
    judge: Judge,
    leaving: Judge,
    latitude_deg: float,
    closed: Closed | None = None,
) -> Route:
    """Return the quickest way found from a place to another; `leaving` judges the first leg of it.

    `closed` tells of many places at once what `judge` does of each of them now.
    """
    closed = closed or partial(_closed, judge)
    known: Known = {}
    legs = _cleared(start, (goal,), profile, judge, leaving, latitude_deg, known)
    if legs is not None:
        return Route(legs)
    at_goal = judge(Box.between(goal, goal), slew_s(start, goal, profile))
    if at_goal is not None:
        return Route((), at_goal)
    nodes = reachable(profile, latitude_deg)
    nodes = [place for place, shut in zip(nodes, closed(np.array(nodes)), strict=True) if not shut]
    grid = _Grid(nodes, start, goal, profile, closed)
    by_one_axis = _by_single_axes(start, goal, profile, judge, leaving, latitude_deg)
    for way in chain(grid.ways(), by_one_axis):
        legs = _cleared(start, way, profile, judge, leaving, latitude_deg, known)
        if legs is not None:
            return Route(legs)
    return Route((), blocked(start, goal, profile, leaving))


def _closed(judge: Judge, places: Array) -> Bools:
    """Tell of each of many places, rows of two angles, whether a judge names anything there."""
    return np.array([judge(Box(ha, ha, dec, dec), 0.0) is not None for ha, dec in places.tolist()])


def _cleared(
    start: Place,
    way: tuple[Place, ...],
    profile: MountProfile,
    judge: Judge,
    leaving: Judge,
    latitude_deg: float,
    known: Known,
) -> tuple[Place, ...] | None:
    """Return the legs of a way that is clear, or None; `known` keeps those to each place on it."""
    cleared: list[Place] = []
    before, after_s = start, 0.0
    for leg in way:
        first = leaving if before is start else judge
        key = before, leg, after_s
        if key not in known:
            known[key] = _approached(before, leg, profile, first, judge, latitude_deg, after_s)
        legs = known[key]
        if legs is None:
            return None
        for place in legs:
            after_s += slew_s(before, place, profile)
            before = place
        cleared.extend(legs)
    return tuple(cleared)


def _approached(
    one: Place,
    other: Place,
    profile: MountProfile,
    first: Judge,
    judge: Judge,
    latitude_deg: float,
    after_s: float,
) -> tuple[Place, ...] | None:
    """Return the straight way as one slew, or else as some that end short by what an abort may add; or None.

    The shorter a slew, the less that is.
    """
    if blocked(one, other, profile, first, after_s, with_late_brake=False) is not None:
        return None
    if blocked(one, other, profile, first, after_s) is None:
        return (other,)
    legs: tuple[Place, ...] = ()
    for _ in range(MOST_APPROACHES):
        gaps = [to - at for at, to in zip(one, other, strict=True)]
        past_deg = overshoot_deg(one, other, profile)
        short = [past if abs(past) < abs(gap) else gap for past, gap in zip(past_deg, gaps, strict=True)]
        near = Place(other.ha_deg - short[0], other.dec_deg - short[1])
        if not _slews_end(near, profile, latitude_deg):
            return None
        if blocked(one, near, profile, first if not legs else judge, after_s) is not None:
            return None
        after_s += slew_s(one, near, profile)
        one, legs = near, (*legs, near)
        if blocked(one, other, profile, judge, after_s) is None:
            return *legs, other
    return None


def _by_single_axes(
    start: Place, goal: Place, profile: MountProfile, judge: Judge, leaving: Judge, latitude_deg: float
) -> Iterator[tuple[Place, ...]]:
    """Yield the quickest way on which one axis turns at a time, along lines STEPS_DEG off both ends, if any.

    Such a way is narrow enough to pass close by a pillar.
    """
    profile = replace(profile, slew_path="any")  # The way of one axis fills its box.
    lines = [sorted({end[axis] + step for end in (start, goal) for step in STEPS_DEG}) for axis in (0, 1)]
    indices = (lines[0].index(start[0]), lines[1].index(start[1]))
    rates_deg_s = (profile.ra.slew_rate_deg_s, profile.dec.slew_rate_deg_s)
    came_from: dict[tuple[int, int], tuple[int, int]] = {}
    reached: set[tuple[int, int]] = set()
    open_ = [(0.0, indices, indices)]
    for _ in range(MOST_PIECES):
        if not open_:
            return
        seconds, here, before = heapq.heappop(open_)
        if here in reached:
            continue
        place, last = (Place(lines[0][i], lines[1][j]) for i, j in (here, before))
        ahead = leaving if before == indices else judge
        can_end = place == goal or _slews_end(place, profile, latitude_deg)
        if here != before and not (can_end and blocked(last, place, profile, ahead, seconds, False) is None):
            continue
        reached.add(here)
        came_from[here] = before
        if place == goal:
            yield _corners(came_from, here, lines)
            return
        for axis, by in ((0, -1), (0, 1), (1, -1), (1, 1)):
            i, j = here[0] + by * (axis == 0), here[1] + by * (axis == 1)
            if (i, j) in reached or not (0 <= i < len(lines[0]) and 0 <= j < len(lines[1])):
                continue
            off_deg = abs((lines[0][i], lines[1][j])[axis] - place[axis])
            heapq.heappush(open_, (seconds + LINE_S + off_deg / rates_deg_s[axis], (i, j), here))


def _slews_end(place: Place, profile: MountProfile, latitude_deg: float) -> bool:
    """Tell whether a slew to where the axes point then leaves them so."""
    axes = axes_of(*direction_of(place), profile, latitude_deg)
    return max(abs(axes[0] - place[0]), abs(axes[1] - place[1])) < 1e-6


def _corners(
    came_from: dict[tuple[int, int], tuple[int, int]], here: tuple[int, int], lines: list[list[float]]
) -> tuple[Place, ...]:
    """Return the places at which a way turns, and its end."""
    points = [here]
    while came_from[here] != here:
        here = came_from[here]
        points.append(here)
    points.reverse()
    turns = [
        middle
        for one, middle, other in zip(points, points[1:], points[2:], strict=False)
        if (one[0] == middle[0]) != (middle[0] == other[0])
    ]
    return tuple(Place(lines[0][i], lines[1][j]) for i, j in (*turns, points[-1]))


def axes_of(hour_angle_deg: float, dec_deg: float, profile: MountProfile, latitude_deg: float) -> Place:
    """Return how the axes stand after a slew to a direction, by the profile's rule."""
    hour_angle_deg = wrap180(hour_angle_deg)
    if beyond_after_slew(profile.pier_rule, hour_angle_deg):
        dec_axis_deg = math.copysign(180.0, latitude_deg) - dec_deg
        return Place(hour_angle_deg - math.copysign(180.0, hour_angle_deg), dec_axis_deg)
    return Place(hour_angle_deg, dec_deg)


def direction_of(place: Place) -> tuple[float, float]:
    """Return hour angle and declination (-90 to 90) of the direction to which two axes point."""
    dec = math.remainder(place.dec_deg, 360.0)
    if abs(dec) <= 90.0:
        return place.ha_deg, dec
    return place.ha_deg + 180.0, math.copysign(180.0, dec) - dec


def reachable(profile: MountProfile, latitude_deg: float) -> list[Place]:
    """Return places all over the sky at which a slew can end, NODE_DEG apart."""
    hours = np.arange(-180.0 + NODE_DEG / 2.0, 180.0, NODE_DEG)
    decs = [*np.arange(-84.0, 85.0, NODE_DEG), 89.0, -89.0]
    return [axes_of(float(h), float(d), profile, latitude_deg) for h in hours for d in decs]


def can_wait(place: Place, judge: Judge) -> bool:
    """Tell whether the mount can wait at a place: it goes on with the sky there."""
    margins_deg = WAIT_MARGIN_DEG, 2.0 * WAIT_MARGIN_DEG, WAIT_MARGIN_DEG, WAIT_MARGIN_DEG
    return judge(Box.between(place, place).grown(*margins_deg), 0.0) is None


def clear_places(goal: Place, latitude_deg: float, profile: MountProfile, judge: Judge) -> Iterator[Place]:
    """Yield places where the mount can wait, in rings about a goal, the nearest first."""
    hour_angle, dec = direction_of(goal)
    widen = 1.0 / max(0.05, math.cos(math.radians(dec)))

    def place(ring_deg: float, turn: float) -> Place | None:
        """Return a place so far from the goal if the mount can wait there."""
        there_dec = dec + ring_deg * math.sin(turn)
        if abs(there_dec) > 90.0:
            return None
        there = axes_of(hour_angle + ring_deg * widen * math.cos(turn), there_dec, profile, latitude_deg)
        return there if can_wait(there, judge) else None

    for inner_deg, ring_deg in zip((0.0, *RINGS_DEG), RINGS_DEG, strict=False):
        for k in range(RING_PLACES):
            turn = 2.0 * math.pi * k / RING_PLACES
            found = place(ring_deg, turn)
            if found is not None:
                yield _nearer(found, partial(place, turn=turn), inner_deg, ring_deg)


def _nearer(found: Place, place: Callable[[float], Place | None], clear_of: float, at: float) -> Place:
    """Return the place that is found between two distances, or one found nearer to the first."""
    while at - clear_of > NEAREST_DEG:
        middle = 0.5 * (clear_of + at)
        nearer = place(middle)
        if nearer is None:
            clear_of = middle
        else:
            found, at = nearer, middle
    return found


class _Grid:
    """Axis angles in cells of CELL_DEG, each clear or not by its middle; boxes looked up by their sums."""

    def __init__(
        self, nodes: list[Place], start: Place, goal: Place, profile: MountProfile, closed: Closed
    ) -> None:
        self._nodes, self._start, self._goal, self._profile = nodes, start, goal, profile
        every = [*nodes, start, goal]
        self._low = (min(p[0] for p in every) - CELL_DEG, min(p[1] for p in every) - CELL_DEG)
        high = (max(p[0] for p in every) + CELL_DEG, max(p[1] for p in every) + CELL_DEG)
        shape = tuple(math.ceil((h - low) / CELL_DEG) for h, low in zip(high, self._low, strict=True))
        hour_angles, decs = (
            low + (np.arange(count) + 0.5) * CELL_DEG for low, count in zip(self._low, shape, strict=True)
        )
        exempt = np.zeros(shape, dtype=bool)
        for end in (start, goal):
            near = np.abs(hour_angles - end[0]) < EXEMPT_DEG, np.abs(decs - end[1]) < EXEMPT_DEG
            exempt |= near[0][:, None] & near[1][None, :]
        cells = np.zeros(shape)
        i, j = np.nonzero(~exempt)
        cells[i, j] = closed(np.column_stack((hour_angles[i], decs[j])))
        self._sums = np.zeros((shape[0] + 1, shape[1] + 1))
        self._sums[1:, 1:] = cells.cumsum(axis=0).cumsum(axis=1)

    def ways(self) -> Iterator[tuple[Place, ...]]:
        """Yield promising ways, the quickest first: by one place, then by two."""
        if not self._nodes:
            return
        nodes = np.array(self._nodes)
        start, goal = np.array(self._start), np.array(self._goal)
        out, home = self._open(start, nodes), self._open(nodes, goal)
        out_s, home_s = self._seconds(start, nodes), self._seconds(nodes, goal)
        single = np.flatnonzero(out & home)
        for k in single[np.argsort((out_s + home_s)[single], kind="stable")][:MOST_TRIED].tolist():
            yield self._nodes[k], self._goal
        first, second = np.flatnonzero(out), np.flatnonzero(home)
        if not (len(first) and len(second)):
            return
        between = self._open(nodes[first][:, None, :], nodes[second][None, :, :])
        total = self._seconds(nodes[first][:, None, :], nodes[second][None, :, :])
        total = np.where(between, total + out_s[first][:, None] + home_s[second][None, :], np.inf)
        for flat in np.argsort(total, axis=None, kind="stable")[:MOST_TRIED].tolist():
            i, j = divmod(flat, len(second))
            if math.isfinite(total[i, j]):
                yield self._nodes[int(first[i])], self._nodes[int(second[j])], self._goal

    def _open(self, one: Array, other: Array) -> Bools:
        """Tell of which pairs of places the boxes between hold no closed cell."""
        low = np.floor((np.minimum(one, other) - self._low) / CELL_DEG).astype(np.intp)
        high = np.floor((np.maximum(one, other) - self._low) / CELL_DEG).astype(np.intp) + 1
        s = self._sums
        count = (
            s[high[..., 0], high[..., 1]]
            - s[low[..., 0], high[..., 1]]
            - s[high[..., 0], low[..., 1]]
            + s[low[..., 0], low[..., 1]]
        )
        clear: Bools = count == 0.0
        return clear

    def _seconds(self, one: Array, other: Array) -> Array:
        gap = np.abs(one - other)
        rates = np.array([self._profile.ra.slew_rate_deg_s, self._profile.dec.slew_rate_deg_s])
        seconds: Array = np.max(gap / rates, axis=-1) + HANDSHAKE_S
        return seconds
