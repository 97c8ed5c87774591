"""Passes as a calendar (iCalendar, RFC 5545), one event each."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sattrack.cli.icalendar import Event, calendar_text, stamp
from tle.errors import printable

if TYPE_CHECKING:
    from sattrack.cli.passes_rows import PassTable


def as_calendar(table: PassTable) -> str:
    """Return the events; a pass that the span cuts begins or ends with it."""
    passes = table.passes
    end = passes.start.plus(passes.task.span[1])
    events = []
    for row in table.rows():
        seen = row.seen
        top = seen.culminate_utc
        told = [f"Highest at {top.isoformat('seconds')}, azimuth {seen.culminate_az_deg:.0f}°."]
        if row.facts is not None:
            told.append(f"Sun at {row.facts.sun_alt_deg:.0f}°.")
            told.append("Sunlit." if row.facts.sunlit else "Not sunlit.")
        events.append(
            Event(
                uid=f"{row.elements.catalog_number}-{stamp(top)}@sattrack",
                stamp=passes.start,
                start=seen.rise_utc or passes.start,
                end=seen.set_utc or end,
                summary=f"{printable(row.elements.label)} {seen.max_alt_deg:.0f}°",
                description=" ".join(told),
            )
        )
    return calendar_text("passes", events)
