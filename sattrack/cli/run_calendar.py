"""A plan as a calendar, one event for each pass."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sattrack.cli.icalendar import Event, calendar_text, stamp
from tle.errors import printable
from tle.instants import Utc

if TYPE_CHECKING:
    from sattrack.schedule.plan import Plan, PlannedPass


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
