"""All candidates of a schedule: those of its entries, the most valuable; and the mount's verdict on them."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from sattrack.planning.feasibility import ability_at, verdict_on
from sattrack.planning.limits import margins_deg
from sattrack.planning.path import Pointing, body_place_deg
from sattrack.schedule.candidates import CROWDED, INFEASIBLE
from sattrack.schedule.search import EntrySearch

if TYPE_CHECKING:
    from collections.abc import Callable

    from sattrack.schedule.candidates import Candidate, Found, Loaded, Progress, Situation
    from sattrack.schedule.file import Schedule
    from sattrack.schedule.nodes import Way

MOST_CANDIDATES = 2000
"""So many passes, the most valuable, are weighed against one another."""
MOST_JUDGED = 400
"""Of more, those alone are judged by the mount's limits that a plan would take, after a coarse look."""
PAST_DEG, PAST_SHARE = 1.0, 0.2
"""A pass that is so far past a limit for such a share of it is infeasible, however coarsely it is looked at:
a verdict asks for nine tenths."""


def gather(
    schedule: Schedule,
    situation: Situation,
    load: Callable[[str | None], Loaded],
    progress: Progress | None = None,
) -> tuple[list[Candidate], list[Found]]:
    """Return all candidates in order of time, not judged yet, and of each entry what it came to.

    `load` gives the elements of a source, of all that is set for None. Raises BadInputError that names the
    entry for satellites that are not known, TleError.
    """
    candidates: list[Candidate] = []
    found: list[Found] = []
    for number, entry in enumerate(schedule.entries):
        search = EntrySearch(number, entry, situation, progress)
        candidates += search.run(load(entry.source), schedule.magnitudes is not None)
        found.append(search.found)
    candidates.sort(key=lambda one: (one.start_utc_s, one.end_utc_s, one.elements.catalog_number, one.entry))
    candidates = _most_valuable(candidates)
    return [replace(one, number=number) for number, one in enumerate(candidates)], found


def _most_valuable(candidates: list[Candidate]) -> list[Candidate]:
    """Return the candidates, those beyond the number that is weighed lost."""
    fit = [k for k, one in enumerate(candidates) if one.lost is None]
    fit.sort(key=lambda k: (-candidates[k].value, k))
    crowded = set(fit[MOST_CANDIDATES:])
    words = f"not among the {MOST_CANDIDATES} most valuable passes that are weighed"
    return [replace(one, lost=(CROWDED, words)) if k in crowded else one for k, one in enumerate(candidates)]


class Judge:
    """The mount's verdict on candidates, the one of `passes --feasible`; each is asked for once."""

    def __init__(self, schedule: Schedule, situation: Situation) -> None:
        self._schedule, self._site = schedule, situation.site
        self._ability = ability_at(situation.site, situation.profile, situation.limits)
        self._known: set[int] = set()

    def knows(self, one: Candidate) -> bool:
        """Tell whether a candidate was judged, or needs no verdict because it is lost anyway."""
        return one.lost is not None or one.number in self._known

    def judged(self, one: Candidate) -> Candidate:
        """Return a candidate with the verdict on it. Raises TimeRangeError."""
        if self.knows(one):
            return one
        self._known.add(one.number)
        span = (one.start_utc_s, one.end_utc_s)
        why, lost = verdict_on(one.elements, self._site, span, self._ability, None)
        if why is None:
            return one.without(lost)
        one = replace(one, foretold=lost)
        if self._schedule.entries[one.entry].terms.if_infeasible == "run":
            return replace(one, notes=(*one.notes, f"infeasible, run all the same: {why}"))
        return replace(one, lost=(INFEASIBLE, why))

    def coarsely(self, one: Candidate, way: Way) -> Candidate:
        """Return a candidate, lost where its way is past a limit of place beyond doubt."""
        if self.knows(one) or self._schedule.entries[one.entry].terms.if_infeasible == "run":
            return one
        at, site, ability = way.utc_s, self._site, self._ability
        bodies = [
            place
            for name in ("sun", "moon")
            for place in body_place_deg(name, site.latitude_deg, site.longitude_deg, at)
        ]
        pointing = Pointing(at, way.hour_angle_axis_deg, way.dec_axis_deg, *bodies)
        margins = margins_deg(pointing, ability.profile, ability.limits, site.latitude_deg)
        name, margin = min(margins.items(), key=lambda item: -float(np.mean(item[1] < -PAST_DEG)))
        share = float(np.mean(margin < -PAST_DEG))
        if share <= PAST_SHARE:
            return one
        words = f"{name}: past the limit for {100.0 * share:.0f} % of it, by a coarse look"
        return replace(one, lost=(INFEASIBLE, words))

    def all_if_few(self, candidates: list[Candidate], progress: Progress | None) -> list[Candidate]:
        """Return the candidates with the verdict on each, or as they are where that would take too long."""
        if sum(one.lost is None for one in candidates) > MOST_JUDGED:
            return candidates
        judged = []
        for done, one in enumerate(candidates):
            if progress is not None:
                progress("judged", done, len(candidates))
            judged.append(self.judged(one))
        if progress is not None and candidates:
            progress("judged", len(candidates), len(candidates))
        return judged
