"""Candidates as the planner weighs them: whole, and where they may be shortened, cut in several ways."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from sattrack.safety.geometry import Place
from sattrack.safety.route import axes_of, slew_s
from sattrack.schedule.planner import Problem
from sattrack.schedule.transitions import SlewTransitions, Stand, errands_after, errands_before
from tle.instants import Utc
from tle.propagator import Propagator

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from numpy.typing import NDArray

    from sattrack.mount.model import MountProfile
    from sattrack.schedule.candidates import Candidate, Situation
    from sattrack.schedule.schema import Terms
    from tle.site import Site

    Array = NDArray[np.float64]

STEP_S = 10.0
FEWEST, MOST = 13, 400
MOST_NODES = 4000
MOST_CUTS, FEWEST_CUTS = 9, 2
"""Instants at which a pass that may be shortened is entered, and left: so many each."""
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
class Way:
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


def way_of(candidate: Candidate, site: Site, profile: MountProfile) -> Way:
    """Return the way of a candidate's pass. Raises TimeRangeError."""
    duration_s = candidate.end_utc_s - candidate.start_utc_s
    count = min(max(math.ceil(duration_s / STEP_S) + 1, FEWEST), MOST)
    utc_s = np.linspace(candidate.start_utc_s, candidate.end_utc_s, count)
    seen: Any = Propagator(candidate.elements, site).at(Utc(utc_s))
    hour_angle = np.degrees(np.unwrap(np.radians(np.asarray(seen.ha_deg))))
    dec = np.asarray(seen.dec_deg)
    first = axes_of(float(hour_angle[0]), float(dec[0]), profile, site.latitude_deg)
    beyond = abs(first.dec_deg) > 90.0
    axis_dec = math.copysign(180.0, site.latitude_deg) - dec if beyond else dec
    azimuth = np.degrees(np.unwrap(np.radians(np.asarray(seen.az_deg))))
    return Way(
        utc_s,
        hour_angle - hour_angle[0] + first.ha_deg,
        axis_dec,
        azimuth,
        np.asarray(seen.alt_deg, dtype=np.float64),
        beyond,
    )


@dataclass(frozen=True, slots=True)
class NodeSet:
    """Nodes with what each needs around it, and the problem that they make."""

    nodes: tuple[Node, ...]
    stands: tuple[Stand, ...]
    problem: Problem
    transitions: SlewTransitions


def cuts_for(flexible: int, all_told: int) -> int:
    """Return at how many instants each of the candidates that may be shortened is entered, and left."""
    if not flexible:
        return MOST_CUTS
    return min(max(int(math.sqrt(max(MOST_NODES - all_told, 0) / flexible)), FEWEST_CUTS), MOST_CUTS)


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
    """Tell whether a candidate may be shortened."""
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
    whichever way the time between two is shared. `needed_s` gives the seconds from one node to another.
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


def stand_of(node: Node, way: Way, asked: Terms, situation: Situation) -> Stand:
    """Return what a node needs around it."""
    site, profile = situation.site, situation.profile
    start, end = way.at(node.start_utc_s), way.at(node.end_utc_s)
    return Stand(
        errands_before(asked.before, start, node.start_utc_s, site, profile),
        asked.settle_s,
        errands_after(asked.after, end, node.end_utc_s, site, profile),
    )


def node_set(
    nodes: Sequence[Node],
    stands: Sequence[Stand],
    candidates: Sequence[Candidate],
    situation: Situation,
    extra_s: Mapping[tuple[int, int], float],
) -> NodeSet:
    """Return nodes as a problem; `candidates` by number, `extra_s` what slews between two take longer."""
    profile = situation.profile
    longer = _by_node(nodes, extra_s) if extra_s else {}
    transitions = SlewTransitions.of(stands, profile, longer)
    values = [
        candidates[n.candidate].priority * candidates[n.candidate].useful_within(n.start_utc_s, n.end_utc_s)
        for n in nodes
    ]
    first = [
        situation.span[0] + first_s(stand, profile) <= node.start_utc_s
        for node, stand in zip(nodes, stands, strict=True)
    ]
    problem = Problem(
        start_s=np.array([node.start_utc_s for node in nodes]),
        end_s=np.array([node.end_utc_s for node in nodes]),
        value=np.array(values),
        first=np.array(first, dtype=bool),
        group=np.array([candidates[node.candidate].entry for node in nodes], dtype=np.intp),
        transitions=transitions,
    )
    return NodeSet(tuple(nodes), tuple(stands), problem, transitions)


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


def first_s(stand: Stand, profile: MountProfile) -> float:
    """Return how long the first pass of a plan needs before its start, from the park position if known."""
    return first_slew_s(stand, profile) + stand.before.seconds + stand.settle_s


def first_slew_s(stand: Stand, profile: MountProfile) -> float:
    """Return the seconds of the first slew, 0 where nobody knows where the mount stands before it."""
    park = profile.park
    if park is None:
        return 0.0
    return slew_s(Place(park.hour_angle_deg, park.dec_deg), stand.before.first, profile)
