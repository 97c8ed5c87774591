"""Candidates as the planner weighs them, and what lies between two: actions, slews, settling.

A candidate that may be shortened is cut in several ways. Slews are straight, or go round what is in their way
as the safety gate routes them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import erfa
import numpy as np

from sattrack.core.angles import altitude_deg, azimuth_deg, wrap180
from sattrack.mount.model import Slew, horizon_latitude_deg, mean_sidereal_deg
from sattrack.safety.bounds import Bounds
from sattrack.safety.geometry import Place
from sattrack.safety.route import HANDSHAKE_S, RAMP, axes_of, direction_of, leg_s, slew_s
from sattrack.safety.slews import SlewGate
from sattrack.schedule.planner import Problem
from sattrack.schedule.schema import CommandAction, SlewAction, StarCoordinates, find_star
from tle.instants import DAY_S, Utc
from tle.propagator import Propagator

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from numpy.typing import NDArray

    from sattrack.mount.model import AxisLimits, MountProfile
    from sattrack.schedule.candidates import Candidate, PlanSituation
    from sattrack.schedule.schema import Action, Terms
    from tle.site import Site

    Array = NDArray[np.float64]
    Index = NDArray[np.intp]


_UNIX_EPOCH_JD = 2440587.5
_TT_MINUS_UTC_S = 69.184
_MAS_RAD = math.radians(1.0 / 3.6e6)
ROUNDING_S = 1e-6


class ActionCost(NamedTuple):
    """What a list of actions takes: where its first slew goes, its seconds, where the mount stands then.

    The way to the first place is not counted, that from each to the next is.
    """

    first: Place
    seconds: float
    last: Place


class Overhead(NamedTuple):
    """What a pass needs around it: before its start, and from its end on; all but the slew between two."""

    before: ActionCost
    settle_s: float
    after: ActionCost


def place_of(action: SlewAction, utc_s: float, site: Site, profile: MountProfile) -> Place:
    """Return how the axes stand at an action's direction at an instant, by the profile's rule."""
    if action.alt_deg is not None and action.az_deg is not None:
        return place_above(action.alt_deg, action.az_deg, site, profile)
    star = find_star(action.star) if action.star is not None else None
    if star is None:
        star = StarCoordinates(float(action.ra_deg or 0.0), float(action.dec_deg or 0.0), 0.0, 0.0)
    return _place(*hour_angle_and_dec_deg(star, utc_s, site.longitude_deg), site, profile)


def place_above(alt_deg: float, az_deg: float, site: Site, profile: MountProfile) -> Place:
    """Return how the axes stand at an altitude and azimuth, degrees, by the profile's rule."""
    # From the horizon to the equator it is the same turn as back.
    turned = (az_deg, alt_deg, site.latitude_deg)
    return _place(azimuth_deg(*turned), altitude_deg(*turned), site, profile)


def _place(hour_angle: float, dec: float, site: Site, profile: MountProfile) -> Place:
    if profile.frame is not None:
        hour_angle, dec, _, _ = profile.frame.angles(hour_angle, dec)
    return axes_of(hour_angle, dec, profile, horizon_latitude_deg(profile, site.latitude_deg))


def slew_of(action: SlewAction, utc_s: float, site: Site, profile: MountProfile) -> Slew:
    """Return the slew to an action's direction at an instant; right ascension by mean sidereal time."""
    hour_angle_deg, dec_deg = direction_of(place_of(action, utc_s, site, profile))
    return Slew((mean_sidereal_deg(utc_s, site.longitude_deg) - hour_angle_deg) % 360.0, dec_deg)


def hour_angle_and_dec_deg(star: StarCoordinates, utc_s: float, longitude_deg: float) -> tuple[float, float]:
    """Return a star's apparent place of date, geocentric: hour angle (-180 to 180), declination.

    To some arcseconds: UT1 is taken as UTC, and parallax left out.
    """
    day = _UNIX_EPOCH_JD + utc_s / DAY_S
    ra, dec = math.radians(star.ra_deg), math.radians(star.dec_deg)
    pm_ra = star.pm_ra_mas * _MAS_RAD / math.cos(dec)
    ri, di, _ = erfa.atci13(
        ra, dec, pm_ra, star.pm_dec_mas * _MAS_RAD, 0.0, 0.0, day, _TT_MINUS_UTC_S / DAY_S
    )
    turned = math.degrees(erfa.era00(day, 0.0) - float(ri)) + longitude_deg
    return wrap180(turned), math.degrees(float(di))


def cost_before(
    actions: Sequence[Action], start: Place, utc_s: float, site: Site, profile: MountProfile
) -> ActionCost:
    """Return what is done before a pass that starts at a place of the axes, the slew to it included."""
    places, seconds = _places(actions, utc_s, site, profile)
    return ActionCost((*places, start)[0], seconds + _slews_s([*places, start], profile), start)


def cost_after(
    actions: Sequence[Action], end: Place, utc_s: float, site: Site, profile: MountProfile
) -> ActionCost:
    """Return what is done after a pass that ends at a place of the axes, the slew from it included."""
    places, seconds = _places(actions, utc_s, site, profile)
    return ActionCost(end, seconds + _slews_s([end, *places], profile), (end, *places)[-1])


def _places(
    actions: Sequence[Action], utc_s: float, site: Site, profile: MountProfile
) -> tuple[list[Place], float]:
    """Return the places of slews, and the seconds of all that is waited for."""
    places, seconds = [], 0.0
    for action in actions:
        if isinstance(action, SlewAction):
            places.append(place_of(action, utc_s, site, profile))
            seconds += action.wait_s
        elif isinstance(action, CommandAction) and action.wait:
            seconds += action.timeout_s
    return places, seconds


def _slews_s(places: list[Place], profile: MountProfile) -> float:
    return sum(slew_s(one, other, profile) for one, other in pairwise(places))


@dataclass(frozen=True, slots=True)
class SlewTransitions:
    """The seconds between passes, for all pairs: columns of where each leaves the mount, and wants it."""

    leave: Array
    """Hour angle and declination axis after each pass and what follows it, shape (n, 2), degrees."""
    want: Array
    after_s: Array
    before_s: Array
    rates_deg_s: tuple[float, float]
    ramps_s: tuple[float, float]
    leave_deg: tuple[tuple[float, float], tuple[float, float]]
    """The least and the most of either axis in `leave`."""
    most_after_s: float
    extra_s: Mapping[int, tuple[Index, Array]] = field(default_factory=dict)
    """By the later pass, from which earlier ones a slew takes longer than straight, and by how much."""

    @classmethod
    def of(
        cls,
        overheads: Sequence[Overhead],
        profile: MountProfile,
        extra_s: Mapping[int, tuple[Index, Array]] | None = None,
    ) -> SlewTransitions:
        """Return those of some passes by a mount's axes."""
        axes = (profile.ra, profile.dec)
        leave = np.array([overhead.after.last for overhead in overheads], dtype=np.float64).reshape(-1, 2)
        ranges = [
            (float(np.min(column, initial=math.inf)), float(np.max(column, initial=-math.inf)))
            for column in leave.T
        ]
        return cls(
            leave,
            np.array([overhead.before.first for overhead in overheads], dtype=np.float64).reshape(-1, 2),
            np.array([overhead.after.seconds for overhead in overheads], dtype=np.float64),
            np.array(
                [overhead.before.seconds + overhead.settle_s for overhead in overheads], dtype=np.float64
            ),
            (axes[0].slew_rate_deg_s, axes[1].slew_rate_deg_s),
            (_ramp_s(axes[0]), _ramp_s(axes[1])),
            (ranges[0], ranges[1]),
            max((overhead.after.seconds for overhead in overheads), default=0.0),
            extra_s or {},
        )

    def seconds(self, before: Index, after: int) -> Array:
        """Return the seconds from the ends of some passes to the start of another."""
        total: Array = self.after_s[before] + self.slews_s(before, after) + self.before_s[after]
        return total

    def longest_s(self, after: Index) -> Array:
        """Return bounds on the seconds from the end of any pass to the start of each of some."""
        slews = np.zeros(len(after))
        for axis, ((low, high), rate, ramp) in enumerate(
            zip(self.leave_deg, self.rates_deg_s, self.ramps_s, strict=True)
        ):
            want = self.want[after, axis]
            slews = np.maximum(slews, np.maximum(high - want, want - low) / rate + ramp)
        longer = np.zeros(len(self.before_s))
        for k, (_, seconds) in self.extra_s.items():
            longer[k] = np.max(seconds, initial=0.0)
        bounds: Array = self.most_after_s + HANDSHAKE_S + slews + longer[after] + self.before_s[after]
        return bounds + ROUNDING_S

    def slews_s(self, before: Index, after: int) -> Array:
        """Return of those what the slew between takes.

        As `sattrack.safety.route.slew_s` computes it, and what a way round takes longer where that is known.
        """
        gap = np.abs(self.leave[before] - self.want[after])
        slews: Array = HANDSHAKE_S + np.maximum(
            gap[:, 0] / self.rates_deg_s[0] + self.ramps_s[0],
            gap[:, 1] / self.rates_deg_s[1] + self.ramps_s[1],
        )
        if after in self.extra_s:
            longer = np.zeros(len(self.after_s))
            others, seconds = self.extra_s[after]
            longer[others] = seconds
            slews += longer[before]
        return slews


def _ramp_s(axis: AxisLimits) -> float:
    return 2.0 * RAMP * axis.slew_rate_deg_s / axis.max_acceleration_deg_s2


class RoutedSlews:
    """Slews at a site with a mount as its gate would lead them."""

    def __init__(self, situation: PlanSituation) -> None:
        """Build the gate of a situation's mount, limits and site."""
        site, profile = situation.site, situation.profile
        self._site, self._profile = site, profile
        self._bounds = Bounds(profile, situation.limits, site.latitude_deg, site.longitude_deg)
        self._latitude_deg = self._bounds.horizon_latitude_deg
        self._gate = SlewGate(profile, self._bounds, self._latitude_deg, detours=True)

    def extra_s(self, leave: Place, want: Place, utc_s: float) -> float:
        """Return the seconds more than straight from one place of the axes to another at an instant.

        Infinity where the gate knows no clear way.
        """
        self._bounds.look(utc_s, 0.0)
        sidereal_deg = mean_sidereal_deg(utc_s, self._site.longitude_deg)
        hour_angle, dec = direction_of(want)
        legs = self._gate.route(
            Slew((sidereal_deg - hour_angle) % 360.0, dec), sidereal_deg, leave, waits=True
        )
        if isinstance(legs, str):
            return math.inf
        if len(legs) == 1:
            return 0.0
        first, *others = (
            axes_of(sidereal_deg - leg.ra_deg, leg.dec_deg, self._profile, self._latitude_deg) for leg in legs
        )
        total = slew_s(leave, first, self._profile)
        total += sum(leg_s(one, other, self._profile) for one, other in pairwise((first, *others)))
        return max(0.0, total - slew_s(leave, want, self._profile))


STEP_S = 10.0
FEWEST, MOST = 13, 400
MOST_NODES = 4000
MOST_CUTS, FEWEST_CUTS = 9, 2
"""The number of instants at which a pass that may be shortened is entered, and left."""
MOST_ROUNDS = 50
"""Rounds in which the instant is found at which a mount reaches a target that moves meanwhile."""
MOST_FINER, FEWEST_FINER, MOST_FINER_SIDE = 2000, 5, 17
"""So many nodes more, for those that are shortened in a first plan; of one, so many instants each way."""


class Node(NamedTuple):
    """A candidate by its number, taken from one instant to another; POSIX seconds of UTC."""

    candidate: int
    start_utc_s: float
    end_utc_s: float


@dataclass(frozen=True, slots=True)
class CandidatePath:
    """How the mount's axes turn over a candidate's pass, begun on the side that its profile's rule gives."""

    utc_s: Array
    hour_angle_axis_deg: Array
    dec_axis_deg: Array
    az_deg: Array
    alt_deg: Array
    beyond_pole: bool

    def at(self, utc_s: float) -> Place:
        """Return how the axes stand at an instant."""
        return Place(
            float(np.interp(utc_s, self.utc_s, self.hour_angle_axis_deg)),
            float(np.interp(utc_s, self.utc_s, self.dec_axis_deg)),
        )

    def az_at(self, utc_s: float) -> float:
        """Return the azimuth at an instant, 0 to below 360 degrees."""
        return float(np.interp(utc_s, self.utc_s, self.az_deg)) % 360.0

    def alt_at(self, utc_s: float) -> float:
        """Return the altitude at an instant, degrees."""
        return float(np.interp(utc_s, self.utc_s, self.alt_deg))


def path_of(candidate: Candidate, site: Site, profile: MountProfile) -> CandidatePath:
    """Return the way of a candidate's pass. Raises TimeRangeError."""
    duration_s = candidate.end_utc_s - candidate.start_utc_s
    count = min(max(math.ceil(duration_s / STEP_S) + 1, FEWEST), MOST)
    utc_s = np.linspace(candidate.start_utc_s, candidate.end_utc_s, count)
    seen: Any = Propagator(candidate.elements, site).at(Utc(utc_s))
    hour_angle, dec = np.asarray(seen.ha_deg), np.asarray(seen.dec_deg)
    if profile.frame is not None:
        hour_angle, dec, _, _ = profile.frame.angles(hour_angle, dec, fn=np)
    hour_angle = np.degrees(np.unwrap(np.radians(hour_angle)))
    latitude_deg = horizon_latitude_deg(profile, site.latitude_deg)
    first = axes_of(float(hour_angle[0]), float(dec[0]), profile, latitude_deg)
    beyond = abs(first.dec_deg) > 90.0
    axis_dec = math.copysign(180.0, latitude_deg) - dec if beyond else dec
    azimuth = np.degrees(np.unwrap(np.radians(np.asarray(seen.az_deg))))
    # Where its cables end the mount slews back to the other turn.
    axis, most_deg = hour_angle - hour_angle[0] + first.ha_deg, profile.hour_angle_limit_deg
    back = axis - np.copysign(360.0, axis)
    return CandidatePath(
        utc_s,
        np.where((np.abs(axis) > most_deg) & (np.abs(back) <= most_deg), back, axis),
        axis_dec,
        azimuth,
        np.asarray(seen.alt_deg, dtype=np.float64),
        beyond,
    )


@dataclass(frozen=True, slots=True)
class NodeSet:
    """Nodes with what each needs around it, and the problem that they make."""

    nodes: tuple[Node, ...]
    overheads: tuple[Overhead, ...]
    problem: Problem
    transitions: SlewTransitions


def cuts_for(flexible: int, count: int) -> int:
    """Return at how many instants each of the candidates that may be shortened is entered, and left."""
    if not flexible:
        return MOST_CUTS
    return min(max(int(math.sqrt(max(MOST_NODES - count, 0) / flexible)), FEWEST_CUTS), MOST_CUTS)


def whole_and_cut(candidates: Sequence[Candidate], cuts: int, least_s: Sequence[float]) -> list[Node]:
    """Return the nodes of candidates; `least_s` is by number how long one must stay."""
    nodes = []
    for one in candidates:
        if not is_flexible(one):
            nodes.append(Node(one.number, one.start_utc_s, one.end_utc_s))
            continue
        starts = np.linspace(one.start_utc_s, one.latest_start_utc_s, cuts)
        ends = np.linspace(one.earliest_end_utc_s, one.end_utc_s, cuts)
        nodes += _grid(one, starts.tolist(), ends.tolist(), least_s[one.number])
    return nodes


def is_flexible(one: Candidate) -> bool:
    """Return whether a candidate may be shortened."""
    return one.latest_start_utc_s > one.start_utc_s or one.earliest_end_utc_s < one.end_utc_s


def finer(
    taken: Sequence[Node], candidates: Sequence[Candidate], cuts: int, least_s: Sequence[float]
) -> list[Node]:
    """Return nodes about those taken that are shortened, between their neighbours of the coarser cut."""
    whole = {(one.number, one.start_utc_s, one.end_utc_s) for one in candidates}
    shortened = [node for node in taken if node not in whole]
    if not shortened:
        return []
    side = min(max(int(math.sqrt(MOST_FINER / len(shortened))), FEWEST_FINER), MOST_FINER_SIDE)
    offsets = np.linspace(-1.0, 1.0, side) / (cuts - 1)
    found: dict[Node, None] = {}
    for node in shortened:
        one = candidates[node.candidate]
        start_s, end_s = one.latest_start_utc_s - one.start_utc_s, one.end_utc_s - one.earliest_end_utc_s
        starts = np.clip(node.start_utc_s + start_s * offsets, one.start_utc_s, one.latest_start_utc_s)
        ends = np.clip(node.end_utc_s + end_s * offsets, one.earliest_end_utc_s, one.end_utc_s)
        found |= dict.fromkeys(_grid(one, starts.tolist(), ends.tolist(), least_s[one.number]))
    return list(found)


def joined(
    taken: Sequence[Node],
    candidates: Sequence[Candidate],
    least_s: Sequence[float],
    needed_s: Callable[[Node, Node], float],
) -> list[Node]:
    """Return nodes of those taken that leave no time unused between two that follow one another.

    The later one is entered as soon as the mount can be there, or the earlier one left as late as it may,
    however the time between two is shared. `needed_s` gives the seconds from one node to another.
    """
    starts = [{node.start_utc_s} for node in taken]
    ends = [{node.end_utc_s} for node in taken]
    for k, (before, after) in enumerate(pairwise(taken)):
        one, other = candidates[before.candidate], candidates[after.candidate]
        for end in {before.end_utc_s, one.earliest_end_utc_s, one.end_utc_s}:
            ends[k].add(end)
            left = before._replace(end_utc_s=end)
            starts[k + 1].add(_earliest(other, after, partial(needed_s, left), end))
        for start in {after.start_utc_s, other.latest_start_utc_s, other.start_utc_s}:
            starts[k + 1].add(start)
            ends[k].add(_latest(one, before, after._replace(start_utc_s=start), needed_s))
    found: dict[Node, None] = {}
    for node, begins, stops in zip(taken, starts, ends, strict=True):
        one = candidates[node.candidate]
        found |= dict.fromkeys(_grid(one, sorted(begins), sorted(stops), least_s[one.number]))
    return list(found)


def entered_at(one: Candidate, needed_s: Callable[[Node], float], from_utc_s: float) -> float:
    """Return when the mount can be there at the earliest, at the candidate's start or later.

    `needed_s` gives the seconds that a node needs before its start, from an instant on.
    """
    return _earliest(one, Node(one.number, one.start_utc_s, one.end_utc_s), needed_s, from_utc_s, math.inf)


def _earliest(
    one: Candidate,
    node: Node,
    needed_s: Callable[[Node], float],
    free_utc_s: float,
    latest_utc_s: float | None = None,
) -> float:
    """Return the first instant at which a node can be entered by a mount that is free from an instant on."""
    latest = one.latest_start_utc_s if latest_utc_s is None else latest_utc_s
    start = one.start_utc_s
    for _ in range(MOST_ROUNDS):
        ready = free_utc_s + needed_s(node._replace(start_utc_s=min(start, one.end_utc_s)))
        if ready <= start or start > latest:
            break
        start = ready
    return min(start, latest)


def _latest(one: Candidate, node: Node, after: Node, needed_s: Callable[[Node, Node], float]) -> float:
    """Return the last instant at which a node can be left so that the mount is at another in time."""
    end = one.end_utc_s
    for _ in range(MOST_ROUNDS):
        last = after.start_utc_s - needed_s(node._replace(end_utc_s=end), after)
        if last >= end or end < one.earliest_end_utc_s:
            break
        end = last
    return max(end, one.earliest_end_utc_s)


def _grid(one: Candidate, starts: list[float], ends: list[float], least_s: float) -> list[Node]:
    found: dict[Node, None] = {}
    for start in starts:
        for end in ends:
            whole = start == one.start_utc_s and end == one.end_utc_s
            enough = end - start >= least_s and one.useful_within(start, end) > 0.0
            if whole or enough:
                found[Node(one.number, start, end)] = None
    return list(found)


def overhead_of(node: Node, path: CandidatePath, asked: Terms, situation: PlanSituation) -> Overhead:
    """Return what a node needs around it."""
    site, profile = situation.site, situation.profile
    start, end = path.at(node.start_utc_s), path.at(node.end_utc_s)
    return Overhead(
        cost_before(asked.before, start, node.start_utc_s, site, profile),
        asked.settle_s,
        cost_after(asked.after, end, node.end_utc_s, site, profile),
    )


def node_set(
    nodes: Sequence[Node],
    overheads: Sequence[Overhead],
    candidates: Sequence[Candidate],
    situation: PlanSituation,
    extra_s: Mapping[tuple[int, int], float],
) -> NodeSet:
    """Return nodes as a problem; `candidates` by number, `extra_s` what slews between two take longer."""
    profile = situation.profile
    longer = _by_node(nodes, extra_s) if extra_s else {}
    transitions = SlewTransitions.of(overheads, profile, longer)
    values = [
        candidates[n.candidate].priority * candidates[n.candidate].useful_within(n.start_utc_s, n.end_utc_s)
        for n in nodes
    ]
    first = [
        situation.span[0] + first_s(overhead, situation) <= node.start_utc_s
        for node, overhead in zip(nodes, overheads, strict=True)
    ]
    problem = Problem(
        start_s=np.array([node.start_utc_s for node in nodes]),
        end_s=np.array([node.end_utc_s for node in nodes]),
        value=np.array(values),
        first=np.array(first, dtype=bool),
        group=np.array([candidates[node.candidate].entry for node in nodes], dtype=np.intp),
        transitions=transitions,
    )
    return NodeSet(tuple(nodes), tuple(overheads), problem, transitions)


def _by_node(
    nodes: Sequence[Node], extra_s: Mapping[tuple[int, int], float]
) -> dict[int, tuple[NDArray[np.intp], Array]]:
    """Return by the later node which earlier ones take longer to come from, and by how much."""
    of: dict[int, list[int]] = {}
    for k, node in enumerate(nodes):
        of.setdefault(node.candidate, []).append(k)
    earlier: dict[int, list[tuple[int, float]]] = {}
    for (before, after), seconds in extra_s.items():
        earlier.setdefault(after, []).extend((k, seconds) for k in of.get(before, []))
    return {
        k: (np.array([at for at, _ in found], dtype=np.intp), np.array([more for _, more in found]))
        for after, found in earlier.items()
        for k in of.get(after, [])
        if found
    }


def first_s(overhead: Overhead, situation: PlanSituation) -> float:
    """Return how long the first pass of a plan needs before its start, from the park position if known."""
    return first_slew_s(overhead, situation) + overhead.before.seconds + overhead.settle_s


def first_slew_s(overhead: Overhead, situation: PlanSituation) -> float:
    """Return the seconds of the first slew, 0 where the mount's position before it is unknown.

    The mount slewed to where it is parked, and stands there on the side that its rule gives.
    """
    profile = situation.profile
    if profile.park is None:
        return 0.0
    direction = direction_of(Place(profile.park.hour_angle_deg, profile.park.dec_deg))
    parked = axes_of(*direction, profile, horizon_latitude_deg(profile, situation.site.latitude_deg))
    return slew_s(parked, overhead.before.first, profile)
