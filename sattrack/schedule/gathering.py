"""All candidates of a schedule: those of its entries, the most valuable, each with the mount's verdict."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from sattrack.planning.feasibility import ability_at, why_not_feasible
from sattrack.schedule.candidates import CROWDED, INFEASIBLE
from sattrack.schedule.search import EntrySearch

if TYPE_CHECKING:
    from collections.abc import Callable

    from sattrack.schedule.candidates import Candidate, Found, Loaded, Progress, Situation
    from sattrack.schedule.file import Schedule

MOST_CANDIDATES = 2000
"""So many passes, the most valuable, are weighed against one another."""


def gather(
    schedule: Schedule,
    situation: Situation,
    load: Callable[[str | None], Loaded],
    progress: Progress | None = None,
) -> tuple[list[Candidate], list[Found]]:
    """Return all candidates in order of time, and of each entry what it came to.

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
    numbered = [replace(one, number=number) for number, one in enumerate(candidates)]
    return _judged(numbered, schedule, situation, progress), found


def _most_valuable(candidates: list[Candidate]) -> list[Candidate]:
    """Return the candidates, those beyond the number that is weighed lost."""
    fit = [k for k, one in enumerate(candidates) if one.lost is None]
    fit.sort(key=lambda k: (-candidates[k].value, k))
    crowded = set(fit[MOST_CANDIDATES:])
    words = f"not among the {MOST_CANDIDATES} most valuable passes that are weighed"
    return [replace(one, lost=(CROWDED, words)) if k in crowded else one for k, one in enumerate(candidates)]


def _judged(
    candidates: list[Candidate], schedule: Schedule, situation: Situation, progress: Progress | None
) -> list[Candidate]:
    """Return the candidates with the mount's verdict, the one of `passes --feasible`."""
    ability = ability_at(situation.site, situation.profile, situation.limits)
    judged = []
    for done, one in enumerate(candidates):
        if progress is not None:
            progress("judged", done, len(candidates))
        if one.lost is None:
            span = (one.start_utc_s, one.end_utc_s)
            why = why_not_feasible(one.elements, situation.site, span, ability, None)
            if why is not None and schedule.entries[one.entry].terms.if_infeasible == "run":
                one = replace(one, notes=(*one.notes, f"infeasible, run all the same: {why}"))  # noqa: PLW2901
            elif why is not None:
                one = replace(one, lost=(INFEASIBLE, why))  # noqa: PLW2901
        judged.append(one)
    if progress is not None and candidates:
        progress("judged", len(candidates), len(candidates))
    return judged
