"""Passes, found or planned, as a calendar (iCalendar, RFC 5545), one event each."""

from __future__ import annotations

from typing import TYPE_CHECKING

from icalendar import Calendar, Event

from tle.errors import printable
from tle.instants import Utc

if TYPE_CHECKING:
    from collections.abc import Iterable

    from sattrack.cli.passes_rows import PassTable, Row
    from sattrack.views.schedule import PlannedPass, SchedulePlan


def passes_calendar(table: PassTable) -> bytes:
    """Return the events of passes found; one that the span cuts begins or ends with it."""
    start = table.passes.start
    end = start.plus(table.passes.task.span[1])
    return calendar_bytes("passes", (_found(row, start, end) for row in table.rows()))


def plan_calendar(plan: SchedulePlan, made: Utc) -> bytes:
    """Return the passes of a plan as events, made at an instant."""
    return calendar_bytes("schedule", (_planned(one, made) for one in plan.passes))


def calendar_bytes(product: str, events: Iterable[Event]) -> bytes:
    """Return a calendar of events as UTF-8, in lines of at most 75 octets that end with CR and LF."""
    calendar = Calendar()
    calendar.add("version", "2.0")
    calendar.add("prodid", f"-//sattrack//{product}//EN")
    for event in events:
        calendar.add_component(event)
    text: bytes = calendar.to_ical()
    return text


def event_of(uid: str, made: Utc, span: tuple[Utc, Utc], summary: str, description: str) -> Event:
    """Return one event; instants to the second."""
    event = Event()
    event.add("uid", uid)
    for name, at in (("dtstamp", made), ("dtstart", span[0]), ("dtend", span[1])):
        event.add(name, Utc(round(at.unix_s)).datetime())
    event.add("summary", summary)
    event.add("description", description)
    return event


def _found(row: Row, start: Utc, end: Utc) -> Event:
    seen = row.seen
    top = seen.culminate_utc
    text = [f"Highest at {top.isoformat('seconds')}, azimuth {seen.culminate_az_deg:.0f}°."]
    if row.facts is not None:
        text.append(f"Sun at {row.facts.sun_alt_deg:.0f}°.")
        text.append("Sunlit." if row.facts.sunlit else "Not sunlit.")
    return event_of(
        f"{row.elements.catalog_number}-{_stamp(top)}@sattrack",
        start,
        (seen.rise_utc or start, seen.set_utc or end),
        f"{printable(row.elements.label)} {seen.max_alt_deg:.0f}°",
        " ".join(text),
    )


def _planned(one: PlannedPass, made: Utc) -> Event:
    text = [
        f"Highest at {one.culminate_utc[:19]}Z: {one.max_alt_deg:.0f}°.",
        f"From azimuth {one.start_az_deg:.0f}° to {one.end_az_deg:.0f}°.",
        f"{one.useful_s:.0f} useful seconds, priority {one.priority:g}.",
        f"The mount sets out by {one.leave_utc[:19]}Z.",
        *(["Shortened."] if one.shortened else []),
        f"Asked by {printable(one.asked_by)}",
        *([f"Before: {'; '.join(one.before)}"] if one.before else []),
        *([f"After: {'; '.join(one.after)}"] if one.after else []),
    ]
    event = event_of(
        f"{one.catalog_number}-{_stamp(Utc.parse(one.culminate_utc))}-plan@sattrack",
        made,
        (Utc.parse(one.start_utc), Utc.parse(one.end_utc)),
        f"{printable(one.name or str(one.catalog_number))} {one.max_alt_deg:.0f}°",
        "\n".join(text),
    )
    event.add("categories", ["satellite pass"])
    return event


def _stamp(at: Utc) -> str:
    return at.isoformat("seconds").replace("-", "").replace(":", "")
