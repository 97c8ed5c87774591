"""Why a pass that could be taken is not in the plan: which of those that are it conflicts with, and how."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sattrack.schedule.nodes import Node, NodeSet

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
