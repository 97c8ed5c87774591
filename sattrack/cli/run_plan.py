"""The plan of a schedule on the command line: its situation, elements, rehearsals and calendar."""

from __future__ import annotations

import os
import sys
from typing import TYPE_CHECKING

import click
import msgspec

from sattrack.cli.common import tell
from sattrack.cli.icalendar import Event, calendar_text, stamp
from sattrack.core.errors import BadInputError
from sattrack.mount.requests import Park
from sattrack.runtime.prepare import check_site
from sattrack.schedule.candidates import Loaded, Situation
from tle.brightness import read_magnitudes
from tle.errors import printable
from tle.instants import Utc
from tle.sources import is_fetched, newest

if TYPE_CHECKING:
    from collections.abc import Callable

    from sattrack.cli.common import CommandContext
    from sattrack.mount.profiles import ProfileFile
    from sattrack.runtime.mounts import MountAddress
    from sattrack.schedule.candidates import Candidate
    from sattrack.schedule.file import Schedule
    from sattrack.schedule.plan import Plan, PlannedPass, Rehearsed

    Span = tuple[float, float]


MOST_HOUR_ANGLE_DEG = 170.0


def said_utc_s(text: str | None, otherwise: float | None) -> float | None:
    """Return the instant of an option as POSIX seconds, or what holds without it. Raises TleError."""
    return otherwise if text is None else float(Utc.parse(text).unix_s)


def within_half_a_turn(profile: ProfileFile) -> ProfileFile:
    """Return a profile whose hour angle axis keeps within half a turn, so that nobody needs to count turns.

    Each pass is a session of its own, no status tells how the cables are wound, and a mount at rest may go on
    with the sky.
    """
    return msgspec.structs.replace(
        profile, hour_angle_limit_deg=min(profile.hour_angle_limit_deg, MOST_HOUR_ANGLE_DEG)
    )


def situation_of(
    context: CommandContext, schedule: Schedule, profile: ProfileFile, span: Span, now_utc_s: float
) -> Situation:
    """Return where and when a plan is made. Raises BadInputError, naming what does not go together."""
    site = context.site()
    check_site(profile.mount, site)
    limits = context.settings.safety.limits()
    low = [one for one in schedule.entries if one.terms.min_altitude_deg < limits.floor_altitude_deg]
    if low:
        raise low[0].origin.wrong(
            f"follows above {low[0].terms.min_altitude_deg:g}°, and the mount is kept above "
            f"{limits.floor_altitude_deg:g}° (safety.floor_altitude_deg)"
        )
    return Situation(
        span=span,
        now_utc_s=now_utc_s,
        site=site,
        profile=profile.mount,
        limits=limits,
        magnitudes={} if schedule.magnitudes is None else read_magnitudes(schedule.magnitudes),
        workers=os.cpu_count() or 1,
    )


def why_left(schedule: Schedule, profile: ProfileFile, address: MountAddress | None) -> str | None:
    """Return why a mount is not parked though its schedule would have it, in words; None otherwise."""
    if not schedule.park_at_end:
        return None
    why_not = "the profile has no park position"
    if profile.mount.park is not None:
        carried = None if address is None else address.not_carried(Park())
        if carried is None:
            return None
        why_not = carried
    return f"{why_not}: the mount will be left where the last pass ends"


def loader(context: CommandContext, schedule: Schedule) -> Callable[[str | None], Loaded]:
    """Return what gives the elements of a source, each read once."""
    known: dict[str | None, Loaded] = {}

    def load(source: str | None) -> Loaded:
        if source not in known:
            sources = (*context.sources(), *schedule.elements) if source is None else (source,)
            if not sources:
                raise BadInputError(
                    f"{schedule.file}: no elements: set elements in it or in sattrack.toml, or give some"
                )
            sets = context.load(sources)
            if sets.rejected and not sets.accepted:
                raise sets.rejected[0]
            if sets.rejected:
                count, first = len(sets.rejected) + len(sets.accepted), str(sets.rejected[0]).splitlines()[0]
                tell(f"{len(sets.rejected)} of {count} element sets refused, the first: {first}")
            renewable = all(is_fetched(one) for one in sources)
            known[source] = Loaded(newest(sets.accepted), renewable, ", ".join(sources))
        return known[source]

    return load


def progress() -> Callable[[str, int, int], None] | None:
    """Return what shows on the terminal how far long work is, and wipes that at its end; else None."""
    if not sys.stderr.isatty():
        return None

    def show(what: str, done: int, total: int) -> None:
        words = f"{what} {done} of {total}" if done < total else ""
        click.echo(f"\r\x1b[K{words}", nl=False, err=True)

    return show


def rehearser(
    context: CommandContext, profile: ProfileFile, schedule: Schedule
) -> Callable[[Candidate, float, float], Rehearsed]:
    """Return what rehearses a candidate from one instant to another, POSIX seconds of UTC."""
    from sattrack.control.tracker import TrackPlan
    from sattrack.runtime.prepare import Prepared, planned_facts
    from sattrack.runtime.rehearse import READY_S, rehearse
    from sattrack.schedule.plan import Rehearsed

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


def as_calendar(plan: Plan, made: Utc) -> str:
    """Return the passes of a plan as events, made at an instant."""
    return calendar_text("schedule", [_event(one, made) for one in plan.passes])


def _event(one: PlannedPass, made: Utc) -> Event:
    label = printable(one.name or str(one.catalog_number))
    told = [
        f"Highest at {one.culminate_utc[:19]}Z: {one.max_alt_deg:.0f}°.",
        f"From azimuth {one.start_az_deg:.0f}° to {one.end_az_deg:.0f}°.",
        f"{one.useful_s:.0f} useful seconds, priority {one.priority:g}.",
        f"The mount sets out by {one.leave_utc[:19]}Z.",
        *(["Shortened."] if one.shortened else []),
        f"Asked by {printable(one.asked_by)}",
    ]
    if one.before:
        told.append(f"Before: {'; '.join(one.before)}")
    if one.after:
        told.append(f"After: {'; '.join(one.after)}")
    return Event(
        uid=f"{one.catalog_number}-{stamp(Utc.parse(one.culminate_utc))}-plan@sattrack",
        stamp=made,
        start=Utc.parse(one.start_utc),
        end=Utc.parse(one.end_utc),
        summary=f"{label} {one.max_alt_deg:.0f}°",
        description="\n".join(told),
        categories="satellite pass",
    )
