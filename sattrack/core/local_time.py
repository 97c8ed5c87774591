"""Times as people read them: in their time zone, with the day, and how long it is until then.

Programs get UTC; this is for tables, messages and screens.
"""

from __future__ import annotations

import zoneinfo
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from datetime import tzinfo


def is_zone(name: str) -> bool:
    """Tell whether a time zone has this IANA name."""
    try:
        zoneinfo.ZoneInfo(name)
    except (zoneinfo.ZoneInfoNotFoundError, ValueError, OSError):
        return False
    return True


@dataclass(frozen=True, slots=True)
class LocalTime:
    """Writes instants, POSIX seconds of UTC, in a time zone; without one, in the system's."""

    zone: tzinfo | None = None

    @classmethod
    def named(cls, name: str | None) -> LocalTime:
        """Return that of an IANA name, which must be one (`is_zone`); None for the system's."""
        return cls(None if name is None else zoneinfo.ZoneInfo(name))

    def at(self, utc_s: float) -> datetime:
        """Return the instant with the offset that is in force then."""
        return datetime.fromtimestamp(utc_s, UTC).astimezone(self.zone)

    def clock(self, utc_s: float) -> str:
        """Return the time of day, 21:04:09, rounded to the second."""
        return f"{self.at(round(utc_s)):%H:%M:%S}"

    def minute(self, utc_s: float) -> str:
        """Return the time of day to the minute, 21:04."""
        return f"{self.at(round(utc_s / 60.0) * 60.0):%H:%M}"

    def day(self, utc_s: float) -> str:
        """Return the day, Sun 22 Nov 2026."""
        at = self.at(utc_s)
        return f"{at:%a} {at.day} {at:%b %Y}"

    def instant(self, utc_s: float) -> str:
        """Return day, time and zone, Sun 22 Nov 2026 21:04:09 CET."""
        return f"{self.day(round(utc_s))} {self.clock(utc_s)} {self.zone_name(utc_s)}"

    def zone_name(self, utc_s: float) -> str:
        """Return the zone's abbreviation at an instant: CET, UTC, or an offset where it has none."""
        return self.at(utc_s).tzname() or f"{self.at(utc_s):%z}"


def until(seconds: float) -> str:
    """Return how long it is until then: in 6 h 27 min, in 40 s, now, 3 min ago."""
    size = abs(seconds)
    if size < 1.0:
        return "now"
    if size < 99.5:
        text = f"{size:.0f} s"
    elif size < 3600.0 - 30.0:
        text = f"{size / 60.0:.0f} min"
    elif size < 48 * 3600.0 - 30.0:
        hours, minutes = divmod(round(size / 60.0), 60)
        text = f"{hours} h {minutes} min" if minutes else f"{hours} h"
    else:
        text = f"{size / 86400.0:.1f} days"
    return f"in {text}" if seconds > 0.0 else f"{text} ago"
