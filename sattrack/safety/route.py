"""Slews and their ways: each judged by its whole way once, led round what is in it, and watched on it.

The mount slews by itself, each axis in its own time, so that nobody knows its way between two places but
that it stays within the box that both span in axis angles: that whole box must be clear. Where the profile
says that the axes go together, the way is the straight line between them. A detour is looked for on a
coarse grid and then judged like any other slew, leg by leg.
"""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass
from functools import partial
from itertools import chain
from typing import TYPE_CHECKING

import numpy as np

from sattrack.core.angles import separation_deg, wrap180
from sattrack.mount.model import SIDEREAL_RATE_DEG_S, MountProfile, Slew
from sattrack.safety.geometry import Box, Place

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from numpy.typing import NDArray

    from sattrack.mount.model import Seen
    from sattrack.safety.bounds import Bounds

    Array = NDArray[np.float64]
    Bools = NDArray[np.bool_]
    Judge = Callable[[Box, float], str | None]
    """Names what a box of axis angles is not clear of within so many seconds, or None."""

THERE_DEG = 0.1
WAITS_S = 70.0
"""How long the mount may wait at the target until it follows, tracking the sky."""
STRAYED_DEG = 1.0
STRAYED_STATUSES = 3


class SlewGate:
    """The slew that is asked for, in legs; without `detours` it is one leg or none."""

    def __init__(self, profile: MountProfile, bounds: Bounds, latitude_deg: float, detours: bool) -> None:
        self._profile, self._bounds, self._latitude_deg = profile, bounds, latitude_deg
        self._detours = detours
        self._target: Slew | None = None
        self._legs: list[Slew] = []
        self._box: Box | None = None
        self._astray = 0

    @property
    def on_last_leg(self) -> bool:
        """Whether what is under way goes to the target itself."""
        return len(self._legs) <= 1

    @property
    def under_way(self) -> bool:
        """Whether a slew has been cleared since something else was asked for."""
        return self._target is not None

    def forget(self) -> None:
        """Something else is asked for."""
        self._target, self._legs, self._box, self._astray = None, [], None, 0

    def clear(
        self, target: Slew, sidereal_deg: float, reported: tuple[float, float], place: Place, braking: Box
    ) -> Slew | str:
        """Return the slew to ask for now, or the name of the row that it is not clear of.

        `braking` is where axes that move may come until they stand.
        """
        if target != self._target:
            found = self._legs_to(target, sidereal_deg, place)
            if isinstance(found, str):
                return found
            self._target, self._legs = target, list(found)
            self._enter(place, sidereal_deg, braking)
        elif not self.on_last_leg and self.is_there(reported):
            self._legs.pop(0)
            name = self.objection(self._legs[0], sidereal_deg, place)
            if name is not None:
                found = self._legs_to(target, sidereal_deg, place)
                if isinstance(found, str):
                    return found
                self._legs = list(found)
            self._enter(place, sidereal_deg, braking)
        return self._legs[0]

    def _legs_to(self, target: Slew, sidereal_deg: float, place: Place) -> tuple[Slew, ...] | str:
        if self._detours:
            return self.route(target, sidereal_deg, place, waits=True)
        name = self.objection(target, sidereal_deg, place)
        return (target,) if name is None else name

    def route(
        self, target: Slew, sidereal_deg: float, place: Place, waits: bool = False
    ) -> tuple[Slew, ...] | str:
        """Return the legs to a target from a place, or the name of the row that is in the way.

        Where the target itself is past a limit and `waits`, the way is to the nearest place that is not.
        """
        if self.objection(target, sidereal_deg, place) is None:
            return (target,)
        found = self._route_from(place, target, sidereal_deg, waits)
        if isinstance(found, str) and self._bounds.near(place):
            exit_place = self._way_out(place)
            if exit_place is not None:
                leg = _slew_to(exit_place, sidereal_deg)
                onward = self._route_from(exit_place, target, sidereal_deg, waits)
                if not isinstance(onward, str):
                    found = (leg, *onward)
                elif waits and self._bounds.dazzled(place):
                    # Whatever becomes of the target, the telescope does not stay in the Sun.
                    found = (leg,)
        return found

    def way_out(self, sidereal_deg: float, place: Place) -> Slew | None:
        """Return a slew out of the Sun's or the Moon's cone, None where there is none or no need of one."""
        exit_place = self._way_out(place) if self._bounds.dazzled(place) else None
        return None if exit_place is None else _slew_to(exit_place, sidereal_deg)

    def _way_out(self, place: Place) -> Place | None:
        """Return the nearest clear place to which axes get that are past a limit, or too near to one."""
        from sattrack.safety.route import blocked, clear_places

        for beside in clear_places(place, self._latitude_deg, self._profile, self._judge):
            if blocked(place, beside, self._profile, self._judge_leaving(place)) is None:
                return beside
        return None

    def _judge(self, box: Box, seconds: float) -> str | None:
        return self._bounds.violated(box, {}, seconds)

    def _judge_leaving(self, place: Place) -> Judge:
        def judge(box: Box, seconds: float) -> str | None:
            return self._bounds.violated(box, self._bounds.leaving(place, seconds), seconds)

        return judge

    def _route_from(
        self, place: Place, target: Slew, sidereal_deg: float, waits: bool
    ) -> tuple[Slew, ...] | str:
        from sattrack.safety.route import axes_of, slew_s

        goal = axes_of(sidereal_deg - target.ra_deg, target.dec_deg, self._profile, self._latitude_deg)
        judge, leaving = self._judge, self._judge_leaving(place)
        # The mount tracks the sky there until it follows.
        drift_deg = SIDEREAL_RATE_DEG_S * (slew_s(place, goal, self._profile) + WAITS_S)
        in_goal = judge(Box.between(goal, goal).grown(0.0, drift_deg if waits else 0.0, 0.0, 0.0), 0.0)
        goals = self._beside(place, goal, judge, leaving) if in_goal is not None and waits else [goal]
        if in_goal is not None and not goals:
            return in_goal
        found = self._first_route(place, goals, judge, leaving)
        if found.blocked_by is not None:
            return found.blocked_by
        slews = [_slew_to(leg, sidereal_deg) for leg in found.legs]
        return tuple(slews) if in_goal is not None else (*slews[:-1], target)

    def _beside(self, place: Place, goal: Place, judge: Judge, leaving: Judge) -> list[Place]:
        """Return where to wait instead: the nearest place, and the nearest that is reached straight on."""
        from sattrack.safety.route import blocked, clear_places

        found: list[Place] = []
        for beside in clear_places(goal, self._latitude_deg, self._profile, judge):
            if not found:
                found.append(beside)
            if blocked(place, beside, self._profile, leaving) is None:
                return [*found, beside]
        return found

    def _first_route(self, place: Place, goals: list[Place], judge: Judge, leaving: Judge) -> Route:
        from sattrack.safety.route import Route, find_route

        found = Route((), None)
        for goal in goals:
            found = find_route(place, goal, self._profile, judge, leaving, self._latitude_deg)
            if found.blocked_by is None:
                break
        return found

    def objection(self, target: Slew, sidereal_deg: float, place: Place) -> str | None:
        """Return the name of the row that the straight way to a target is not clear of, or None."""
        from sattrack.safety.route import axes_of

        goal = axes_of(sidereal_deg - target.ra_deg, target.dec_deg, self._profile, self._latitude_deg)
        return self.way_objection(place, goal)

    def way_objection(self, place: Place, goal: tuple[float, float]) -> str | None:
        """Return the name of the row that the way between two places is not clear of, or None."""
        from sattrack.safety.route import blocked

        end = Place(*goal)
        at_end = self._judge(Box.between(end, end), 0.0)
        if at_end is not None:
            return at_end
        return blocked(place, end, self._profile, self._judge_leaving(place))

    def strays(self, place: Place, seen: Seen) -> bool:
        """Tell whether the mount has left what its slew was judged by."""
        box = self._box
        if box is None or not seen.slewing:
            self._astray = 0
            return False
        m = STRAYED_DEG
        grown = box.grown(m, m, m, m)
        inside = (
            grown.ha_low_deg <= place[0] <= grown.ha_high_deg
            and grown.dec_low_deg <= place[1] <= grown.dec_high_deg
        )
        self._astray = 0 if inside else self._astray + 1
        return self._astray >= STRAYED_STATUSES

    def _enter(self, place: Place, sidereal_deg: float, braking: Box) -> None:
        from sattrack.safety.route import axes_of, slew_s

        leg = self._legs[0]
        goal = axes_of(sidereal_deg - leg.ra_deg, leg.dec_deg, self._profile, self._latitude_deg)
        self._box, self._astray = Box.between(place, goal), 0
        # Axes that still brake go on the old way for a while; that is no disobedience where nothing is near.
        wider = _hull(self._box, braking)
        seconds = slew_s(place, goal, self._profile)
        drifted = wider.grown(0.0, SIDEREAL_RATE_DEG_S * seconds, 0.0, 0.0)
        if self._judge_leaving(place)(drifted, seconds) is None:
            self._box = wider

    def is_there(self, reported: tuple[float, float]) -> bool:
        """Tell whether the mount reports to be where the leg under way ends."""
        leg = self._legs[0]
        off = separation_deg(reported[0], reported[1], leg.ra_deg, leg.dec_deg)
        return math.isfinite(off) and off < THERE_DEG


def _slew_to(place: Place, sidereal_deg: float) -> Slew:
    from sattrack.safety.route import direction_of

    hour_angle_deg, dec_deg = direction_of(place)
    return Slew((sidereal_deg - hour_angle_deg) % 360.0, dec_deg)


def _hull(one: Box, other: Box) -> Box:
    return Box(
        min(one.ha_low_deg, other.ha_low_deg),
        max(one.ha_high_deg, other.ha_high_deg),
        min(one.dec_low_deg, other.dec_low_deg),
        max(one.dec_high_deg, other.dec_high_deg),
    )


CELL_DEG = 4.0
NODE_DEG = 12.0
EXEMPT_DEG = 8.0
"""So near to its ends a leg is not judged by the coarse grid, only by the judge."""
HANDSHAKE_S = 2.0
RAMP = 1.5
"""A slew brakes more gently than it can, by so much."""
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
    times = [
        abs(gap) / limits.slew_rate_deg_s
        + 2.0 * RAMP * limits.slew_rate_deg_s / limits.max_acceleration_deg_s2
        for gap, limits in ((one[0] - other[0], profile.ra), (one[1] - other[1], profile.dec))
    ]
    return HANDSHAKE_S + max(times)


def way_boxes(one: Place, other: Place, profile: MountProfile) -> Iterator[Box]:
    """Yield boxes that hold all of a slew's way."""
    # The mount joins the sky, which moves on while it slews.
    drift_deg = SIDEREAL_RATE_DEG_S * slew_s(one, other, profile)
    if profile.slew_path == "any":
        yield Box.between(one, other).grown(0.0, drift_deg, 0.0, 0.0)
        return
    for k in range(PIECES):
        ends = [
            (one[0] + (other[0] - one[0]) * part, one[1] + (other[1] - one[1]) * part)
            for part in (k / PIECES, (k + 1) / PIECES)
        ]
        yield Box.between(ends[0], ends[1]).grown(0.0, drift_deg, 0.0, 0.0)


def blocked(
    one: Place, other: Place, profile: MountProfile, judge: Judge, after_s: float = 0.0
) -> str | None:
    """Return the name of the row that a slew's way is not clear of, or None; it begins in `after_s`."""
    until_s = after_s + slew_s(one, other, profile)
    for box in way_boxes(one, other, profile):
        name = judge(box, until_s)
        if name is not None:
            return name
    return None


def find_route(
    start: Place, goal: Place, profile: MountProfile, judge: Judge, leaving: Judge, latitude_deg: float
) -> Route:
    """Return the quickest way found from a place to another; `leaving` judges the first leg of it."""
    straight = blocked(start, goal, profile, leaving)
    if straight is None:
        return Route((goal,))
    at_goal = judge(Box.between(goal, goal), slew_s(start, goal, profile))
    if at_goal is not None:
        return Route((), at_goal)
    nodes = [
        place for place in reachable(profile, latitude_deg) if judge(Box.between(place, place), 0.0) is None
    ]
    grid = _Grid(nodes, start, goal, profile, judge)
    by_one_axis = _by_single_axes(start, goal, profile, judge, leaving, latitude_deg)
    for legs in chain(grid.ways(), by_one_axis):
        before, after_s = start, 0.0
        for leg in legs:
            if blocked(before, leg, profile, leaving if before is start else judge, after_s) is not None:
                break
            after_s += slew_s(before, leg, profile)
            before = leg
        else:
            return Route(legs)
    return Route((), straight)


def _by_single_axes(
    start: Place, goal: Place, profile: MountProfile, judge: Judge, leaving: Judge, latitude_deg: float
) -> Iterator[tuple[Place, ...]]:
    """Yield the quickest way on which one axis turns at a time, along lines STEPS_DEG off both ends, if any.

    Such a way is narrow enough to pass close by a pillar.
    """
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
        if here != before and not (can_end and blocked(last, place, profile, ahead, seconds) is None):
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
    if profile.pier_rule == "hour_angle" and hour_angle_deg > 0.0:
        return Place(hour_angle_deg - 180.0, math.copysign(180.0, latitude_deg) - dec_deg)
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


def clear_places(goal: Place, latitude_deg: float, profile: MountProfile, judge: Judge) -> Iterator[Place]:
    """Yield places where the mount can wait, in rings about a goal, as near as may be, the nearest first."""
    hour_angle, dec = direction_of(goal)
    widen = 1.0 / max(0.05, math.cos(math.radians(dec)))

    def place(ring_deg: float, turn: float) -> Place | None:
        """Return a place so far from the goal if the mount can wait there."""
        there_dec = dec + ring_deg * math.sin(turn)
        if abs(there_dec) > 90.0:
            return None
        there = axes_of(hour_angle + ring_deg * widen * math.cos(turn), there_dec, profile, latitude_deg)
        # While it waits it goes on with the sky.
        box = Box.between(there, there).grown(
            WAIT_MARGIN_DEG, 2.0 * WAIT_MARGIN_DEG, WAIT_MARGIN_DEG, WAIT_MARGIN_DEG
        )
        return there if judge(box, 0.0) is None else None

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
        self, nodes: list[Place], start: Place, goal: Place, profile: MountProfile, judge: Judge
    ) -> None:
        self._nodes, self._start, self._goal, self._profile = nodes, start, goal, profile
        every = [*nodes, start, goal]
        self._low = (min(p[0] for p in every) - CELL_DEG, min(p[1] for p in every) - CELL_DEG)
        high = (max(p[0] for p in every) + CELL_DEG, max(p[1] for p in every) + CELL_DEG)
        shape = tuple(math.ceil((h - low) / CELL_DEG) for h, low in zip(high, self._low, strict=True))
        closed = np.zeros(shape)
        hour_angles, decs = (
            low + (np.arange(count) + 0.5) * CELL_DEG for low, count in zip(self._low, shape, strict=True)
        )
        exempt = np.zeros(shape, dtype=bool)
        for end in (start, goal):
            near = np.abs(hour_angles - end[0]) < EXEMPT_DEG, np.abs(decs - end[1]) < EXEMPT_DEG
            exempt |= near[0][:, None] & near[1][None, :]
        judged = np.argwhere(~exempt).tolist()
        at_ha, at_dec = hour_angles.tolist(), decs.tolist()
        for i, j in judged:
            ha, dec = at_ha[i], at_dec[j]
            closed[i, j] = judge(Box(ha, ha, dec, dec), 0.0) is not None
        self._sums = np.zeros((shape[0] + 1, shape[1] + 1))
        self._sums[1:, 1:] = closed.cumsum(axis=0).cumsum(axis=1)

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
