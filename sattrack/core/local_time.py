"""Times as people read them: in the local time zone, with the day, and how long it is until then.

Instants are POSIX seconds of UTC. Programs get UTC; this is for tables, messages and screens. The zone is the
process's own, as the system's tools have it; processes that this one starts inherit it.
"""

from __future__ import annotations

import math
import os
import re
import time
import zoneinfo
from datetime import UTC, datetime
from importlib.util import find_spec
from pathlib import Path

_SYSTEM_ZONES = "/usr/share/zoneinfo"
_STAMP = re.compile(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d(?:\.\d{1,6})?Z")


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
    """Return the zone's offset from UTC at an instant, seconds, positive east."""
    offset = _at(utc_s).utcoffset()
    return 0.0 if offset is None else offset.total_seconds()


def changes_within(start_utc_s: float, end_utc_s: float) -> bool:
    """Tell whether the zone's offset changes between two instants; at both ends it may be the same."""
    days = math.ceil((end_utc_s - start_utc_s) / 86400.0)
    at = [min(start_utc_s + 86400.0 * day, end_utc_s) for day in range(days + 1)]
    return len(set(map(offset_s, at))) > 1


def zone_name(utc_s: float) -> str:
    """Return the zone's abbreviation at an instant: CET, UTC."""
    return _at(utc_s).tzname() or f"{_at(utc_s):%z}"


def clock(utc_s: float, decimals: int = 0) -> str:
    """Return the time of day, 21:04:09, rounded to the second or to decimals of it."""
    rounded = round(utc_s, decimals)
    text = f"{_at(rounded):%H:%M:%S}"
    return f"{text}.{round(rounded % 1.0 * 10**decimals):0{decimals}d}" if decimals else text


def day(utc_s: float, decimals: int = 0) -> str:
    """Return the day, Sun 22 Nov 2026, of an instant rounded as `clock` rounds it."""
    at = _at(round(utc_s, decimals))
    return f"{at:%a} {at.day} {at:%b %Y}"


def date(utc_s: float, decimals: int = 0) -> str:
    """Return the date, 2026-11-22, of an instant rounded as `clock` rounds it."""
    return f"{_at(round(utc_s, decimals)):%Y-%m-%d}"


def stamped(utc_s: float, program: str, text: str) -> str:
    """Return a line of a program's log, 21:04:09 CET rotctld: connected."""
    return f"{clock(utc_s)} {zone_name(utc_s)} {program}: {text}"


def instant(utc_s: float, decimals: int = 0) -> str:
    """Return day, time and zone, Sun 22 Nov 2026 21:04:09 CET."""
    return f"{day(utc_s, decimals)} {clock(utc_s, decimals)} {zone_name(utc_s)}"


def moment(utc_s: float, beside_s: float, decimals: int = 0) -> str:
    """Return the time of day, after weekday and date where the day is another than that of `beside_s`."""
    at = _at(round(utc_s, decimals))
    other = "" if day(utc_s, decimals) == day(beside_s) else f"{at:%a} {at.day} "
    return other + clock(utc_s, decimals)


def span(start_utc_s: float, end_utc_s: float) -> str:
    """Return from when to when, the second day only where it is another one, and the zone."""
    start, end = day(start_utc_s), day(end_utc_s)
    other = "" if start == end else f"{end} "
    return f"{start} {clock(start_utc_s)} to {other}{clock(end_utc_s)} {zone_name(end_utc_s)}"


def duration(seconds: float) -> str:
    """Return a length of time without its sign: 40 s, 3 min, 6 h 27 min, 3.5 days."""
    size = abs(seconds)
    if size < 59.5:
        return f"{size:.0f} s"
    if size < 3600.0 - 30.0:
        return f"{size / 60.0:.0f} min"
    if size >= 48 * 3600.0 - 30.0:
        return f"{size / 86400.0:.1f} days"
    hours, minutes = divmod(round(size / 60.0), 60)
    return f"{hours} h {minutes} min" if minutes else f"{hours} h"


def until(seconds: float) -> str:
    """Return how long it is until then: in 6 h 27 min, in 40 s, now, 3 min ago."""
    if abs(seconds) < 1.0:
        return "now"
    return f"in {duration(seconds)}" if seconds > 0.0 else f"{duration(seconds)} ago"


def localised(text: str, beside_s: float | None = None) -> str:
    """Return a text with its UTC stamps (2026-11-22T20:04:09Z) as people read them.

    Each becomes `instant`, or `moment` where `beside_s` tells which day the reader has in mind.
    """

    def shown(stamp: re.Match[str]) -> str:
        utc_s = datetime.fromisoformat(stamp[0]).timestamp()
        return instant(utc_s) if beside_s is None else moment(utc_s, beside_s)

    return _STAMP.sub(shown, text)
