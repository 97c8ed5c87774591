"""Times as people read them: in the local time zone, with the day, and how long it is until then.

Instants are POSIX seconds of UTC. Programs get UTC; this is for tables, messages and screens. The zone is the
process's own, as the system's tools have it; processes that this one starts inherit it.
"""

from __future__ import annotations

import os
import time
import zoneinfo
from datetime import UTC, datetime
from importlib.util import find_spec
from pathlib import Path

_SYSTEM_ZONES = "/usr/share/zoneinfo"


def is_zone(name: str) -> bool:
    """Tell whether a time zone has this IANA name."""
    try:
        zoneinfo.ZoneInfo(name)
    except (zoneinfo.ZoneInfoNotFoundError, ValueError, OSError):
        return False
    return True


def use_zone(name: str | None) -> None:
    """Make a zone, by its IANA name, that of this process; None leaves the system's."""
    if name is None:
        return
    if not (Path(_SYSTEM_ZONES) / name).is_file() and (package := find_spec("tzdata")) is not None:
        # A system without time zones has those of Python's package.
        folder = (package.submodule_search_locations or [""])[0]
        os.environ["TZDIR"] = str(Path(folder) / "zoneinfo")
    os.environ["TZ"] = name
    if hasattr(time, "tzset"):
        time.tzset()


def _at(utc_s: float) -> datetime:
    return datetime.fromtimestamp(utc_s, UTC).astimezone()


def offset_s(utc_s: float) -> float:
    """Return by how much the zone is ahead of UTC at an instant, seconds."""
    offset = _at(utc_s).utcoffset()
    return 0.0 if offset is None else offset.total_seconds()


def zone_name(utc_s: float) -> str:
    """Return the zone's abbreviation at an instant: CET, UTC."""
    return _at(utc_s).tzname() or f"{_at(utc_s):%z}"


def clock(utc_s: float) -> str:
    """Return the time of day, 21:04:09, rounded to the second."""
    return f"{_at(round(utc_s)):%H:%M:%S}"


def day(utc_s: float) -> str:
    """Return the day, Sun 22 Nov 2026."""
    at = _at(round(utc_s))
    return f"{at:%a} {at.day} {at:%b %Y}"


def date(utc_s: float) -> str:
    """Return the date, 2026-11-22."""
    return f"{_at(round(utc_s)):%Y-%m-%d}"


def instant(utc_s: float) -> str:
    """Return day, time and zone, Sun 22 Nov 2026 21:04:09 CET."""
    return f"{day(utc_s)} {clock(utc_s)} {zone_name(utc_s)}"


def span(start_utc_s: float, end_utc_s: float) -> str:
    """Return from when to when, the second day only where it is another one, and the zone."""
    start, end = day(start_utc_s), day(end_utc_s)
    other = "" if start == end else f"{end} "
    return f"{start} {clock(start_utc_s)} to {other}{clock(end_utc_s)} {zone_name(end_utc_s)}"


def until(seconds: float) -> str:
    """Return how long it is until then: in 6 h 27 min, in 40 s, now, 3 min ago."""
    size = abs(seconds)
    if size < 1.0:
        return "now"
    if size < 60.0:
        text = f"{size:.0f} s"
    elif size < 3600.0 - 30.0:
        text = f"{size / 60.0:.0f} min"
    elif size < 48 * 3600.0 - 30.0:
        hours, minutes = divmod(round(size / 60.0), 60)
        text = f"{hours} h {minutes} min" if minutes else f"{hours} h"
    else:
        text = f"{size / 86400.0:.1f} days"
    return f"in {text}" if seconds > 0.0 else f"{text} ago"
