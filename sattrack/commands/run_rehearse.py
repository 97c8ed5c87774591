"""Passes of a plan rehearsed in full."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sattrack.runtime.facts import RunFacts
from sattrack.runtime.prepare import Prepared, with_detours
from sattrack.runtime.rehearse import READY_S, rehearse
from sattrack.schedule.plan import Rehearsed
from sattrack.settings import SiteSettings
from sattrack.tracker import TrackPlan
from tle.refraction import Refraction

if TYPE_CHECKING:
    from collections.abc import Callable

    from sattrack.commands.common import CommandContext
    from sattrack.profiles import ProfileFile
    from sattrack.schedule.candidates import Candidate
    from sattrack.schedule.file import Schedule


def rehearser(
    context: CommandContext, profile: ProfileFile, schedule: Schedule
) -> Callable[[Candidate, float, float], Rehearsed]:
    """Return what rehearses a candidate from one instant to another, POSIX seconds of UTC."""
    site, clock = context.site(), context.clock()
    air, limits = Refraction.standard(site.height_m), context.settings.safety.limits()

    def run(one: Candidate, start_utc_s: float, end_utc_s: float) -> Rehearsed:
        plan = TrackPlan(start_utc_s=start_utc_s, end_utc_s=end_utc_s)
        terms = schedule.entries[one.entry].terms
        facts = RunFacts(
            elements=one.elements,
            site=SiteSettings(site.latitude_deg, site.longitude_deg, site.height_m),
            refraction="auto",
            pressure_hpa=air.pressure_hpa,
            temperature_c=air.temperature_c,
            plan=plan,
            culminate_utc_s=one.culminate_utc_s,
            max_alt_deg=one.max_alt_deg,
            profile=profile.mount,
            limits=limits,
            bias_along_s=terms.bias_along_s,
            bias_cross_deg=terms.bias_cross_deg,
            mount_name="sim",
            started_utc_s=start_utc_s - plan.approach_s - READY_S,
        )
        report = rehearse(Prepared(with_detours(facts), clock, None, False, profile.simulator)).report
        return Rehearsed(report.go, report.verdict, report.on_target_s, report.lost_s)

    return run
