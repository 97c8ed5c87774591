"""From a schedule to its plan: candidates, the best choice of them, and why the others lost."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from sattrack.safety.route import slew_s
from sattrack.schedule.candidates import INFEASIBLE, PIER, Judge, gather
from sattrack.schedule.planner import MOST_WORK, Packing, best_packed, leave_out_taken, packings_of
from sattrack.schedule.transitions import (
    FEWEST_CUTS,
    ROUNDING_S,
    RoutedSlews,
    cuts_for,
    entered_at,
    finer,
    first_s,
    first_slew_s,
    is_flexible,
    joined,
    node_set,
    overhead_of,
    path_of,
    whole_and_cut,
)
from sattrack.views.schedule import EntryOutcome, LostPass, LostTo, PlannedPass, Rehearsed, SchedulePlan
from tle.bodies import Body
from tle.ephemeris import expected_error_m
from tle.instants import Utc

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from sattrack.planning.kinematics import PredictedLoss
    from sattrack.schedule.candidates import Candidate, Found, Loaded, PlanSituation, Progress
    from sattrack.schedule.file import Schedule
    from sattrack.schedule.transitions import CandidatePath, Node, NodeSet, Overhead

    Rehearse = Callable[[Candidate, float, float], Rehearsed]


CONFLICT, SAME, RULE_FULL = "conflict", "same pass", "rule full"
BEGINNING, WORTH_LESS = "beginning", "worth less"


class Reason(NamedTuple):
    """Kind, words, and the places in the plan (from 0) of the passes that it conflicts with."""

    kind: str
    words: str
    others: tuple[int, ...] = ()


def why_lost(
    cuts: Sequence[int],
    chosen: Sequence[int],
    nodes: NodeSet,
    names: Sequence[str],
    full: Reason | None,
    same: int | None,
) -> Reason:
    """Return why none of the nodes of one pass, `cuts`, is among the chosen ones.

    Nodes are indices into `nodes`, the chosen in order of time; `names` are those of the chosen. `full` says
    which rule takes no more. `same` is the place in the plan of the same satellite's pass at that time.
    """
    if same is not None:
        return Reason(SAME, f"the same pass as {same + 1}, which another entry asks for", (same,))
    # Nothing is reached sooner by way of another pass than from the plan's beginning.
    able = [at for at in cuts if bool(nodes.problem.first[at])]
    if not able:
        return Reason(BEGINNING, "no time to get there from the plan's beginning")
    at = max(able, key=lambda k: nodes.nodes[k].end_utc_s - nodes.nodes[k].start_utc_s)
    if any(not _meeting(cut, chosen, nodes) and not _tight(cut, chosen, nodes) for cut in able):
        return full or Reason(WORTH_LESS, "the plan without it is worth as much")
    me, meeting = nodes.nodes[at], _meeting(at, chosen, nodes)
    if meeting:
        words = ", ".join(
            f"{k + 1} ({names[k]}, {_overlap_s(me, nodes.nodes[chosen[k]]):.0f} s)" for k in meeting
        )
        return Reason(CONFLICT, f"at the same time as {words}", tuple(meeting))
    tight = _tight(at, chosen, nodes)
    words = "; ".join(
        f"{_needed(need)} {'from' if earlier else 'to'} {k + 1} ({names[k]}), {free:.0f} s there are"
        for k, need, free, earlier in tight
    )
    return Reason(CONFLICT, f"no time between: {words}", tuple(k for k, *_ in tight))


def _meeting(at: int, chosen: Sequence[int], nodes: NodeSet) -> list[int]:
    """Return the places of those in the plan that are followed at the same time."""
    me = nodes.nodes[at]
    return [
        k
        for k, other in enumerate(chosen)
        if nodes.nodes[other].start_utc_s < me.end_utc_s and nodes.nodes[other].end_utc_s > me.start_utc_s
    ]


def _needed(seconds: float) -> str:
    return f"{seconds:.0f} s" if math.isfinite(seconds) else "no clear way"


def _overlap_s(one: Node, other: Node) -> float:
    return min(one.end_utc_s, other.end_utc_s) - max(one.start_utc_s, other.start_utc_s)


def _tight(at: int, chosen: Sequence[int], nodes: NodeSet) -> list[tuple[int, float, float, bool]]:
    """Return the neighbours in the plan from or to which there is no time: place, needed, free, before."""
    me = nodes.nodes[at]
    found = []
    earlier = [k for k, other in enumerate(chosen) if nodes.nodes[other].end_utc_s <= me.start_utc_s]
    later = [k for k, other in enumerate(chosen) if nodes.nodes[other].start_utc_s >= me.end_utc_s]
    if earlier:
        k = earlier[-1]
        need = float(nodes.transitions.seconds(np.array([chosen[k]]), at)[0])
        free = me.start_utc_s - nodes.nodes[chosen[k]].end_utc_s
        if need > free:
            found.append((k, need, free, True))
    if later:
        k = later[0]
        need = float(nodes.transitions.seconds(np.array([at]), chosen[k])[0])
        free = nodes.nodes[chosen[k]].start_utc_s - me.end_utc_s
        if need > free:
            found.append((k, need, free, False))
    return found


MOST_JOININGS = 3
WORTH_ANOTHER = 1e-4
"""Times that what lies between passes is shared out anew, and the share of the value that is worth it."""
BOUND_GAP_SHOWN = 1e-6
"""Share by which the best plan may exceed the one found, before a note reports it."""
SIDES = {False: "normal", True: "beyond_pole"}


def make_plan(
    schedule: Schedule,
    situation: PlanSituation,
    load: Callable[[str | None], Loaded],
    rehearse: Rehearse | None = None,
    progress: Progress | None = None,
) -> tuple[SchedulePlan, list[Chosen]]:
    """Return the plan of a schedule, and its passes with all that is needed to run them.

    With `rehearse` every chosen pass is rehearsed; one that is no go, and need not be run all the same, is
    lost, and the plan made anew. Raises BadInputError, SattrackError, TleError.
    """
    found, per_entry = gather(schedule, situation, load, progress)
    judge = Judge(schedule, situation)
    maker = _Maker(schedule, situation, judge.all_if_few(found, progress), judge)
    maker.choose()
    while rehearse is not None and maker.rehearse(rehearse, progress):
        maker.choose()
    return maker.plan(per_entry), maker.choice()


class Chosen(NamedTuple):
    """A pass of a plan: the candidate, from when to when (POSIX seconds of UTC), when to set out for it."""

    candidate: Candidate
    start_utc_s: float
    end_utc_s: float
    leave_utc_s: float
    lost_to: tuple[LostTo, ...] = ()


class _Maker:
    """Candidates, and the present choice of them."""

    def __init__(
        self, schedule: Schedule, situation: PlanSituation, candidates: list[Candidate], judge: Judge
    ) -> None:
        self._schedule, self._situation = schedule, situation
        self._candidates, self._judge = candidates, judge
        leave_out_taken(schedule, candidates, situation)
        self._terms = [entry.terms for entry in schedule.entries]
        self._paths: dict[int, CandidatePath] = {}
        self._rehearsed: dict[Node, Rehearsed] = {}
        self._limits = {
            number: entry.conditions.most
            for number, entry in enumerate(schedule.entries)
            if entry.conditions.most is not None
        }
        self._overheads: dict[Node, Overhead] = {}
        for one in candidates:
            if one.lost is None:
                path = self._paths[one.number] = path_of(one, situation.site, situation.profile)
                candidates[one.number] = judge.coarsely(
                    one, path.utc_s, path.hour_angle_axis_deg, path.dec_axis_deg
                )
                self._check_side(one)
                self._enter(candidates[one.number])
        self._led = RoutedSlews(situation)
        self._extra_s: dict[tuple[int, int], float] = {}
        self._looked_at: set[tuple[int, int, float, float]] = set()
        self._set = self._nodes([])
        self._chosen: list[int] = []
        self._value = self._bound = 0.0
        self._packings = packings_of(schedule, candidates, situation)

    def _check_side(self, one: Candidate) -> None:
        """Lose a candidate that is wanted on the side of the pier on which the mount does not take it."""
        wanted = self._terms[one.entry].pier_side
        side = SIDES[self._paths[one.number].beyond_pole]
        if wanted not in ("any", side):
            words = f"the mount takes it on the side {side}, not {wanted}"
            self._candidates[one.number] = replace(one, lost=(PIER, words))

    def _enter(self, one: Candidate) -> None:
        """Have a candidate begin when the mount can be there from the plan's beginning, or lose it."""
        if one.lost is not None or not one.may_join:
            return
        begin, terms = self._situation.span[0], self._terms[one.entry]
        start = entered_at(one, lambda node: first_s(self._overhead(node), self._situation), begin)
        if start <= one.start_utc_s:
            return
        left_s, least_s = one.end_utc_s - start, min(terms.least_s, terms.longest_s or terms.least_s)
        if left_s < least_s or one.useful_within(start, one.end_utc_s) <= 0.0:
            words = f"{max(0.0, left_s):.0f} s of it are left when the mount can be there from the beginning"
            self._candidates[one.number] = replace(one, lost=(BEGINNING, words))
            return
        past = start > one.culminate_utc_s
        latest = one.end_utc_s - least_s if past and terms.shorten else max(start, one.latest_start_utc_s)
        self._candidates[one.number] = replace(
            one,
            start_utc_s=start,
            latest_start_utc_s=latest,
            culminate_utc_s=max(start, one.culminate_utc_s),
            max_alt_deg=self._paths[one.number].alt_at(start) if past else one.max_alt_deg,
            late_s=start - one.start_utc_s,
        )

    def _overhead(self, node: Node) -> Overhead:
        if node not in self._overheads:
            one = self._candidates[node.candidate]
            path, terms = self._paths[one.number], self._terms[one.entry]
            self._overheads[node] = overhead_of(node, path, terms, self._situation)
        return self._overheads[node]

    def _nodes(self, nodes: Sequence[Node]) -> NodeSet:
        overheads = [self._overhead(node) for node in nodes]
        return node_set(nodes, overheads, self._candidates, self._situation, self._extra_s)

    def _least_s(self) -> list[float]:
        return [self._terms[one.entry].least_s for one in self._candidates]

    def choose(self) -> None:
        """Make the best choice whose slews, led round what is in their way, take no longer than there is."""
        # Most of what the mount cannot follow shows before passes are cut in fine steps.
        self._choose(FEWEST_CUTS)
        while self._judge_chosen():
            self._choose(FEWEST_CUTS)
        self._choose()
        while self._judge_chosen() or self._lead():
            self._choose()
        self._set = self._nodes(self._set.nodes)

    def _judge_chosen(self) -> bool:
        """Judge what was chosen by the mount's limits; return whether some of it is worth less by that.

        What was not judged is worth no more than it seems: the best choice is the best of all, once all of it
        was judged.
        """
        any_lost = False
        for k in self._chosen:
            number = self._set.nodes[k].candidate
            before = self._candidates[number]
            one = self._candidates[number] = self._judge.judged(before)
            any_lost |= one.lost is not None or one.useful != before.useful
        return any_lost

    def _lead(self) -> bool:
        """Find the paths of the slews between chosen passes; return whether one takes too long.

        What a way round takes holds for the same two passes however they are shortened.
        """
        late = False
        for before, after in pairwise(self._chosen):
            one, other = self._set.nodes[before], self._set.nodes[after]
            key = (one.candidate, other.candidate, one.end_utc_s, other.start_utc_s)
            if key in self._looked_at:
                continue
            self._looked_at.add(key)
            leave, want = self._overheads[one].after, self._overheads[other].before
            more_s = self._led.extra_s(leave.last, want.first, one.end_utc_s + leave.seconds)
            known_s = self._extra_s.get(key[:2], 0.0)
            if more_s > known_s:
                self._extra_s[key[:2]] = more_s
                needed_s = float(self._set.transitions.seconds(np.array([before]), after)[0])
                late |= one.end_utc_s + needed_s + more_s - known_s > other.start_utc_s
        return late

    def _choose(self, most_cuts: int | None = None) -> None:
        """Make the best choice, then once more with those that are shortened cut in finer steps.

        With `most_cuts` passes that may be shortened are entered and left at no more instants than that.
        """
        least_s = self._least_s()
        able = [one for one in self._candidates if one.lost is None]
        cuts = most_cuts or cuts_for(sum(is_flexible(one) for one in able), len(able))
        coarse = whole_and_cut(able, cuts, least_s)
        self._best(coarse, work=0 if most_cuts else MOST_WORK)
        if most_cuts is not None:
            return
        more = finer(self._taken_nodes(), self._candidates, cuts, least_s)
        if more:
            self._best([*coarse, *more])
        self._join(least_s)

    def _join(self, least_s: list[float]) -> None:
        """Share out the time between the chosen passes, and choose once more."""
        every, taken = self._set.nodes, self._taken_nodes()
        numbers = {node.candidate for node in taken}
        if not any(is_flexible(self._candidates[number]) for number in numbers):
            return
        few = [node for node in every if node.candidate in numbers]
        for _ in range(MOST_JOININGS):
            before = self._value
            few += joined(self._taken_nodes(), self._candidates, least_s, self._needed_s)
            self._best(few, self._taken_nodes())
            if self._value - before < WORTH_ANOTHER * before:
                break
        self._best([*every, *self._taken_nodes()], self._taken_nodes())

    def _taken_nodes(self) -> list[Node]:
        return [self._set.nodes[k] for k in self._chosen]

    def _best(self, nodes: Sequence[Node], known: Sequence[Node] = (), work: int = MOST_WORK) -> None:
        """Make the best choice of some nodes; `known` is one that can be made."""
        nodes = list(dict.fromkeys(nodes))
        self._set = self._nodes(nodes)
        of = np.array([node.candidate for node in nodes], dtype=np.intp)
        able = frozenset(of.tolist())
        packings = [one for one in self._packings if len(one.members & able) > one.most]
        packings += [
            Packing(frozenset({one.number}), 1, SAME, "taken once")
            for one in self._candidates
            if one.number in able and _may_split(one)
        ]
        place = {node: k for k, node in enumerate(nodes)}
        start = [place[node] for node in known]
        best = best_packed(self._set.problem, self._limits, packings, of, start, work)
        self._value, self._chosen, self._bound = best

    def _needed_s(self, before: Node, after: Node) -> float:
        """Return the seconds from the end of one node to the start of another."""
        leave, want = self._overhead(before).after, self._overhead(after)
        slew = slew_s(leave.last, want.before.first, self._situation.profile)
        extra = self._extra_s.get((before.candidate, after.candidate), 0.0)
        return leave.seconds + slew + extra + want.before.seconds + want.settle_s + ROUNDING_S

    def rehearse(self, rehearse: Rehearse, progress: Progress | None) -> bool:
        """Rehearse what was chosen; return whether some of it is lost by that."""
        any_lost = False
        for done, k in enumerate(self._chosen):
            if progress is not None:
                progress("rehearsed", done, len(self._chosen))
            node = self._set.nodes[k]
            one = self._candidates[node.candidate]
            if node not in self._rehearsed:
                self._rehearsed[node] = rehearse(one, node.start_utc_s, node.end_utc_s)
            report = self._rehearsed[node]
            if not report.go and self._terms[one.entry].if_infeasible == "skip":
                lost = (INFEASIBLE, f"by rehearsal: {report.verdict}")
                self._candidates[one.number] = replace(one, lost=lost)
                any_lost = True
        if progress is not None and self._chosen:
            progress("rehearsed", len(self._chosen), len(self._chosen))
        return any_lost

    def choice(self) -> list[Chosen]:
        """Return the passes that were chosen, in order of time."""
        found = []
        for place in range(len(self._chosen)):
            node = self._set.nodes[self._chosen[place]]
            leave = node.start_utc_s - self._needs(place)[1]
            one = self._taken(node)
            found.append(Chosen(one, node.start_utc_s, node.end_utc_s, leave, _all_lost_to(one, node)))
        return found

    def _taken(self, node: Node) -> Candidate:
        """Return the candidate of a node with the highest instant that the node has."""
        one = self._candidates[node.candidate]
        top = min(max(one.culminate_utc_s, node.start_utc_s), node.end_utc_s)
        if top == one.culminate_utc_s:
            return one
        return replace(one, culminate_utc_s=top, max_alt_deg=self._paths[one.number].alt_at(top))

    def _needs(self, place: int) -> tuple[float, float, float]:
        """Return of a chosen pass its slew, with that all it needs before its start, and from when it may."""
        k = self._chosen[place]
        overhead = self._set.overheads[k]
        if place:
            before = self._chosen[place - 1]
            slew = float(self._set.transitions.slews_s(np.array([before]), k)[0])
            ready = self._set.nodes[before].end_utc_s + self._set.overheads[before].after.seconds
        else:
            slew, ready = first_slew_s(overhead, self._situation), self._situation.span[0]
        return slew, slew + overhead.before.seconds + overhead.settle_s, ready

    def plan(self, per_entry: Sequence[Found]) -> SchedulePlan:
        """Return the plan with its notes."""
        planned = [self._planned(place) for place in range(len(self._chosen))]
        lost = self._lost()
        schedule, span = self._schedule, self._situation.span
        taken = [self._candidates[self._set.nodes[k].candidate].entry for k in self._chosen]
        value = round(sum(one.value for one in planned), 3)
        # Each pass' value is rounded, the bound's parts are not: a plan proven best must not seem to miss it.
        missed = max(0.0, self._bound - self._value)
        return SchedulePlan(
            schedule=schedule.file,
            timezone=schedule.zone_name,
            from_utc=_iso(span[0]),
            to_utc=_iso(span[1]),
            profile=self._situation.profile.name,
            value=value,
            value_bound=round(value + missed, 3),
            useful_s=round(sum(one.useful_s for one in planned), 3),
            slew_s=round(sum(one.slew_s for one in planned), 3),
            idle_s=round(sum(one.idle_s for one in planned), 3),
            passes=tuple(planned),
            lost=tuple(report for _, report in lost),
            asked=tuple(
                EntryOutcome(
                    asked_by=entry.label,
                    asked_at=str(entry.origin),
                    passes=found.passes,
                    planned=taken.count(number),
                    lost=sum(asked == number for asked, _ in lost),
                    left_out=dict(sorted(found.dropped.items())),
                    notes=tuple(found.notes),
                )
                for number, (entry, found) in enumerate(zip(schedule.entries, per_entry, strict=True))
            ),
            weather=None if schedule.weather is None else schedule.weather.words,
            park_at_end=schedule.park_at_end,
            notes=self._notes(per_entry),
        )

    def _notes(self, per_entry: Sequence[Found]) -> tuple[str, ...]:
        notes = [
            f"{entry.origin}: {entry.label}: {words}"
            for entry, found in zip(self._schedule.entries, per_entry, strict=True)
            for words in found.notes
        ]
        for entry, found in zip(self._schedule.entries, per_entry, strict=True):
            if found.passes and sum(found.dropped.values()) == found.passes:
                dropped = ", ".join(f"{n} {why}" for why, n in sorted(found.dropped.items()))
                notes.append(f"{entry.origin}: {entry.label}: no pass meets it: {dropped}")
        unjudged = sum(not self._judge.knows(one) for one in self._candidates)
        if unjudged:
            notes.append(
                f"{unjudged} passes that lost to others were not judged by the mount's limits: some of them "
                "may be infeasible as well"
            )
        if self._bound > self._value * (1.0 + BOUND_GAP_SHOWN):
            notes.append(
                "more rules bind at once than could be weighed in all cases: the plan is worth "
                f"{self._value:.0f}, the best there is {self._bound:.0f} at most"
            )
        if self._situation.profile.park is None:
            notes.append("the profile has no park position: the first slew is not counted")
        return tuple(notes)

    def _planned(self, place: int) -> PlannedPass:
        k = self._chosen[place]
        node, overhead = self._set.nodes[k], self._set.overheads[k]
        one = self._taken(node)
        entry, path = self._schedule.entries[one.entry], self._paths[one.number]
        slew, needs, ready = self._needs(place)
        useful = one.useful_within(node.start_utc_s, node.end_utc_s)
        return PlannedPass(
            number=place + 1,
            name=one.elements.name,
            catalog_number=one.elements.catalog_number or None,
            elements_epoch=None
            if isinstance(one.elements, Body)
            else one.elements.epoch.isoformat("seconds"),
            source=one.elements.provenance,
            expected_error_m=expected_error_m(one.elements, Utc(one.culminate_utc_s)),
            start_utc=_iso(node.start_utc_s),
            culminate_utc=_iso(one.culminate_utc_s),
            end_utc=_iso(node.end_utc_s),
            shortened=one.late_s > 0.0
            or (node.start_utc_s, node.end_utc_s) != (one.start_utc_s, one.end_utc_s),
            max_alt_deg=round(one.max_alt_deg, 3),
            start_az_deg=round(path.az_at(node.start_utc_s), 3),
            end_az_deg=round(path.az_at(node.end_utc_s), 3),
            sun_alt_deg=None if one.sun_alt_deg is None else round(one.sun_alt_deg, 3),
            magnitude=None if one.magnitude is None else round(one.magnitude, 2),
            priority=one.priority,
            useful_s=round(useful, 3),
            value=round(one.priority * useful, 3),
            pier_side=SIDES[path.beyond_pole],
            idle_s=round(node.start_utc_s - ready - needs, 3),
            slew_s=round(slew, 3),
            before_s=round(overhead.before.seconds, 3),
            settle_s=overhead.settle_s,
            after_s=round(overhead.after.seconds, 3),
            leave_utc=_iso(node.start_utc_s - needs),
            asked_by=entry.label,
            asked_at=str(entry.origin),
            before=tuple(action.words for action in entry.terms.before),
            after=tuple(action.words for action in entry.terms.after),
            bias_along_s=entry.terms.bias_along_s,
            bias_cross_deg=entry.terms.bias_cross_deg,
            if_elements_old=entry.terms.if_elements_old,
            if_weather_unsafe=entry.terms.if_weather_unsafe,
            if_sun_up=entry.terms.if_sun_up,
            lost_to=_all_lost_to(one, node),
            rehearsed=self._rehearsed.get(node),
            notes=one.notes,
        )

    def _lost(self) -> list[tuple[int, LostPass]]:
        """Return those that are not in the plan, with the entry of each."""
        taken = {self._set.nodes[k].candidate for k in self._chosen}
        names = [self._candidates[self._set.nodes[k].candidate].elements.label for k in self._chosen]
        nodes_of: dict[int, list[int]] = {}
        for at, node in enumerate(self._set.nodes):
            nodes_of.setdefault(node.candidate, []).append(at)
        lost = []
        for one in self._candidates:
            if one.number in taken:
                continue
            others: tuple[int, ...] = ()
            if one.lost is not None:
                kind, words = one.lost
            else:
                kind, words, others = why_lost(
                    nodes_of[one.number],
                    self._chosen,
                    self._set,
                    names,
                    self._full(one),
                    self._same_as(one),
                )
            lost.append((one.entry, self._lost_pass(one, kind, words, others)))
        return lost

    def _full(self, one: Candidate) -> Reason | None:
        """Return which rule has all that it may take, so that a candidate cannot be added; None for none."""
        taken = [self._candidates[self._set.nodes[k].candidate] for k in self._chosen]
        for packing in self._packings:
            if one.number not in packing.members:
                continue
            others = [place for place, other in enumerate(taken) if other.number in packing.members]
            if len(others) >= packing.most:
                places = ", ".join(str(place + 1) for place in others)
                return Reason(packing.kind, f"{packing.words}: {places}", tuple(others))
        most = self._limits.get(one.entry)
        if most is not None and sum(other.entry == one.entry for other in taken) >= most:
            return Reason(RULE_FULL, f"the rule has its {most} passes, worth more together")
        return None

    def _same_as(self, one: Candidate) -> int | None:
        """Return the place in the plan of the same satellite at the same time, None where there is none."""
        for place, k in enumerate(self._chosen):
            other = self._candidates[self._set.nodes[k].candidate]
            same = other.object_number == one.object_number
            if same and other.start_utc_s < one.end_utc_s and other.end_utc_s > one.start_utc_s:
                return place
        return None

    def _lost_pass(self, one: Candidate, kind: str, words: str, others: tuple[int, ...]) -> LostPass:
        entry = self._schedule.entries[one.entry]
        return LostPass(
            name=one.elements.name,
            catalog_number=one.elements.catalog_number or None,
            start_utc=_iso(one.start_utc_s),
            culminate_utc=_iso(one.culminate_utc_s),
            end_utc=_iso(one.end_utc_s),
            max_alt_deg=round(one.max_alt_deg, 3),
            priority=one.priority,
            useful_s=round(one.useful_s, 3),
            value=round(one.value, 3),
            asked_by=entry.label,
            asked_at=str(entry.origin),
            reason=kind,
            why=words,
            with_numbers=tuple(place + 1 for place in others),
        )


def _may_split(one: Candidate) -> bool:
    """Return whether two parts of a candidate could be taken that have no instant in common."""
    return one.latest_start_utc_s >= one.earliest_end_utc_s and is_flexible(one)


def _all_lost_to(one: Candidate, node: Node) -> tuple[LostTo, ...]:
    """Return what limits take of a candidate between the instants from which to which it is taken."""
    within = (
        replace(
            loss,
            begin_utc_s=max(loss.begin_utc_s, node.start_utc_s),
            end_utc_s=min(loss.end_utc_s, node.end_utc_s),
        )
        for loss in one.foretold
    )
    return tuple(_lost_to(loss) for loss in within if loss.seconds > 0.0)


def _lost_to(loss: PredictedLoss) -> LostTo:
    return LostTo(
        limit=loss.limit,
        from_utc=_iso(loss.begin_utc_s),
        seconds=round(loss.seconds, 3),
        why=loss.words,
        peak_rate_deg_s=None if loss.asked_deg_s is None else round(loss.asked_deg_s, 4),
        limit_rate_deg_s=loss.can_deg_s,
    )


def _iso(utc_s: float) -> str:
    return Utc(utc_s).isoformat("milliseconds")
