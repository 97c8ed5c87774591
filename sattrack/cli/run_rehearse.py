"""Passes of a plan rehearsed in full."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sattrack.control.tracker import TrackPlan
from sattrack.runtime.prepare import Prepared
from sattrack.runtime.rehearse import READY_S, rehearse
from sattrack.schedule.plan import Rehearsed
from sattrack.schedule.planned import planned_facts

if TYPE_CHECKING:
    from collections.abc import Callable

    from sattrack.cli.common import CommandContext
    from sattrack.mount.profiles import ProfileFile
    from sattrack.schedule.candidates import Candidate
    from sattrack.schedule.file import Schedule


def rehearser(
    context: CommandContext, profile: ProfileFile, schedule: Schedule
) -> Callable[[Candidate, float, float], Rehearsed]:
    """Return what rehearses a candidate from one instant to another, POSIX seconds of UTC."""
    site, clock = context.site(), context.clock()
    limits = context.settings.safety.limits()

    def run(one: Candidate, start_utc_s: float, end_utc_s: float) -> Rehearsed:
        plan = TrackPlan(start_utc_s=start_utc_s, end_utc_s=end_utc_s)
        terms = schedule.entries[one.entry].terms
        started_utc_s = start_utc_s - plan.approach_s - READY_S
        facts = planned_facts(one, terms, plan, started_utc_s, site, profile.mount, limits)
        report = rehearse(Prepared(facts, clock, None, False, profile.simulator)).report
        return Rehearsed(report.go, report.verdict, report.on_target_s, report.lost_s)

    return run
