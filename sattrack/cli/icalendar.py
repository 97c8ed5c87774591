"""Events as iCalendar text (RFC 5545)."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Iterable

    from tle.instants import Utc

_LONGEST_OCTETS = 75


class Event(NamedTuple):
    """One event; `categories` none for no such line."""

    uid: str
    stamp: Utc
    start: Utc
    end: Utc
    summary: str
    description: str
    categories: str = ""


def calendar_text(product: str, events: Iterable[Event]) -> str:
    """Return a calendar of events, in lines of at most 75 octets that end with CR and LF."""
    lines = ["BEGIN:VCALENDAR", "VERSION:2.0", f"PRODID:-//sattrack//{product}//EN"]
    for event in events:
        lines += [
            "BEGIN:VEVENT",
            f"UID:{event.uid}",
            f"DTSTAMP:{stamp(event.stamp)}",
            f"DTSTART:{stamp(event.start)}",
            f"DTEND:{stamp(event.end)}",
            f"SUMMARY:{_escaped(event.summary)}",
            f"DESCRIPTION:{_escaped(event.description)}",
            *([f"CATEGORIES:{_escaped(event.categories)}"] if event.categories else []),
            "END:VEVENT",
        ]
    lines.append("END:VCALENDAR")
    return "".join(f"{_folded(line)}\r\n" for line in lines)


def stamp(at: Utc) -> str:
    """Return an instant as a UTC date-time of RFC 5545, 3.3.5."""
    return at.isoformat("seconds").replace("-", "").replace(":", "")


def _escaped(text: str) -> str:
    """Return a text value (RFC 5545, 3.3.11): marks that mean something, and line ends, escaped."""
    for mark in ("\\", ";", ","):
        text = text.replace(mark, "\\" + mark)
    return "\\n".join(text.splitlines())


def _folded(line: str) -> str:
    """Return a line cut into pieces of at most 75 octets, never within a character (RFC 5545, 3.1)."""
    pieces, piece = [], ""
    for character in line:
        if len((piece + character).encode()) > _LONGEST_OCTETS:
            pieces.append(piece)
            piece = " "
        piece += character
    return "\r\n".join([*pieces, piece])
