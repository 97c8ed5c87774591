"""Passes judged by what the mount can do."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from sattrack.planning.feasibility import ability_at, why_not_feasible

if TYPE_CHECKING:
    from sattrack.commands.passes_rows import Row
    from sattrack.mount import MountProfile
    from sattrack.safety.limits import SafetyLimits
    from tle.catalogue_passes import CataloguePasses


def judged_rows(
    rows: list[Row], passes: CataloguePasses, profile: MountProfile, limits: SafetyLimits
) -> list[Row]:
    """Return the rows, each with the verdict on the part of the pass that lies within the search's span."""
    task = passes.task
    ability = ability_at(task.site, profile, limits)
    begin_s, span_s = task.span
    end_s = begin_s + span_s
    judged = []
    for row in rows:
        seen = row.seen
        first = begin_s if seen.rise_utc is None else float(seen.rise_utc.unix_s)
        last = end_s if seen.set_utc is None else float(seen.set_utc.unix_s)
        why = why_not_feasible(row.elements, task.site, (first, last), ability, passes.task.earth)
        judged.append(replace(row, judged=True, why_not=why))
    return judged
