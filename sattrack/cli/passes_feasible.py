"""Passes judged by what the mount can do."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from sattrack.planning.kinematics import ability_at, verdict_on

if TYPE_CHECKING:
    from sattrack.cli.passes_rows import PassTable
    from sattrack.mount.model import MountProfile
    from sattrack.safety.limits import SafetyLimits


def judged_table(table: PassTable, profile: MountProfile, limits: SafetyLimits) -> PassTable:
    """Return the rows, each with the verdict on the part of the pass that lies within the search's span."""
    task, found = table.passes.task, table.passes.found
    ability = ability_at(task.site, profile, limits)
    begin_s, span_s = task.span
    obj = found.obj[table.index].tolist()
    first = begin_s + np.nan_to_num(found.rise_s[table.index], nan=0.0)
    last = begin_s + np.nan_to_num(found.set_s[table.index], nan=span_s)
    why_not = tuple(
        verdict_on(task.elements[o], task.site, ends, ability, task.earth).why_not
        for o, ends in zip(obj, zip(first.tolist(), last.tolist(), strict=True), strict=True)
    )
    return replace(table, judged=True, why_not=why_not)
