"""Passes as a calendar (iCalendar, RFC 5545), one event each."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tle.errors import printable

if TYPE_CHECKING:
    from sattrack.commands.passes_rows import Row
    from tle.catalogue_passes import CataloguePasses
    from tle.instants import Utc

_LONGEST_OCTETS = 75


def as_calendar(rows: list[Row], passes: CataloguePasses) -> str:
    """Return the events; a pass that the span cuts begins or ends with it."""
    end = passes.start.plus(passes.task.span[1])
    lines = ["BEGIN:VCALENDAR", "VERSION:2.0", "PRODID:-//sattrack//passes//EN"]
    for row in rows:
        seen = row.seen
        top = seen.culminate_utc
        title = f"{printable(row.elements.label)} {seen.max_alt_deg:.0f}°"
        told = [f"Highest at {top.isoformat('seconds')}, azimuth {seen.culminate_az_deg:.0f}°."]
        if row.facts is not None:
            told.append(f"Sun at {row.facts.sun_alt_deg:.0f}°.")
            told.append("Sunlit." if row.facts.sunlit else "Not sunlit.")
        lines += [
            "BEGIN:VEVENT",
            f"UID:{row.elements.catalog_number}-{_stamp(top)}@sattrack",
            f"DTSTAMP:{_stamp(passes.start)}",
            f"DTSTART:{_stamp(seen.rise_utc or passes.start)}",
            f"DTEND:{_stamp(seen.set_utc or end)}",
            f"SUMMARY:{_escaped(title)}",
            f"DESCRIPTION:{_escaped(' '.join(told))}",
            "END:VEVENT",
        ]
    lines.append("END:VCALENDAR")
    return "".join(f"{_folded(line)}\r\n" for line in lines)


def _stamp(at: Utc) -> str:
    return at.isoformat("seconds").replace("-", "").replace(":", "")


def _escaped(text: str) -> str:
    for mark in ("\\", ";", ","):
        text = text.replace(mark, "\\" + mark)
    return text


def _folded(line: str) -> str:
    """Return a line cut into pieces of at most 75 octets, never within a character (RFC 5545, 3.1)."""
    pieces, piece = [], ""
    for character in line:
        if len((piece + character).encode()) > _LONGEST_OCTETS:
            pieces.append(piece)
            piece = " "
        piece += character
    return "\r\n".join([*pieces, piece])
