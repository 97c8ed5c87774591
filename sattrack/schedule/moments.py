"""Times as a schedule's file has them: UTC, or the time of a zone that the file names.

A time without a zone of its own is of the file's `timezone`. Those that a zone's clock passes over, or shows
twice, when summer time begins or ends, are refused with what may have been meant.
"""

from __future__ import annotations

import re
from datetime import UTC, date, datetime, time, timedelta, tzinfo
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError

from sattrack.core.origin import meant
from tle.errors import TimeFormatError
from tle.instants import Utc

_DAY_OF_YEAR = re.compile(
    r"(\d{4})[.-](\d{3})[.\-T ](\d\d):(\d\d)(?::(\d\d)(?:\.(\d{1,6}))?)?(Z|UTC)?", re.ASCII
)
_CALENDAR = re.compile(r"(\d{4})-(\d\d)-(\d\d)(?:[T ](\d\d):(\d\d)(?::(\d\d)(?:[.,](\d{1,6}))?)?)?", re.ASCII)
_TIME_OF_DAY = re.compile(r"(\d\d):(\d\d)(?::(\d\d))?(Z)?", re.ASCII)
_SHORT_ZONES = ("EST", "MST", "HST", "CET", "MET", "EET", "WET", "EST5EDT", "CST6CDT", "MST7MDT", "PST8PDT")
_FORMS = (
    "2026-10-02T19:40:10Z, 2026-10-02 19:40:10 (in the file's timezone) or 2026.275.19:40:10 (day of year)"
)


def find_zone(name: str) -> tzinfo:
    """Return a time zone by its name in the IANA database, or UTC. Raises ValueError.

    Short names that are more than one place's, and "local", are refused.
    """
    if name in ("UTC", "Z", "Etc/UTC"):
        return UTC
    if name in _SHORT_ZONES or name.casefold() in ("local", "localtime", ""):
        raise ValueError(
            f"{name!r} does not name one place's time: write UTC, or a zone such as 'Europe/Amsterdam'"
        )
    try:
        return ZoneInfo(name)
    except (ZoneInfoNotFoundError, ValueError, OSError):
        from zoneinfo import available_timezones

        known = meant(name, sorted(available_timezones()))
        raise ValueError(
            f"there is no time zone {name!r}{known or '; write UTC, or Europe/Amsterdam'}"
        ) from None


def parse_moment(text: str, zone: tzinfo) -> Utc:
    """Return the instant that a text names; without a zone of its own it is of `zone`. Raises ValueError."""
    wanted = text.strip()
    match = _DAY_OF_YEAR.fullmatch(wanted)
    if match is not None:
        return _of_day_number(match, wanted, zone)
    match = _CALENDAR.fullmatch(wanted)
    if match is None:
        try:
            return Utc.parse(wanted)
        except TimeFormatError:
            raise ValueError(f"{text!r} is no time: write {_FORMS}") from None
    if match.group(6) == "60":
        raise ValueError(f"{text!r}: write a leap second as UTC, with a Z")
    year, month, day, hour, minute, second = (int(part or 0) for part in match.groups()[:6])
    micros = int((match.group(7) or "").ljust(6, "0"))
    try:
        naive = datetime(year, month, day, hour, minute, second, micros)  # noqa: DTZ001 - the zone follows
    except ValueError as error:
        raise ValueError(f"{text!r} is no time: {error}") from None
    return in_zone(naive, zone)


def _of_day_number(match: re.Match[str], text: str, zone: tzinfo) -> Utc:
    year, number, hour, minute, second = (int(part or 0) for part in match.groups()[:5])
    micros = int((match.group(6) or "").ljust(6, "0"))
    try:
        naive = datetime(year, 1, 1, hour, minute, second, micros)  # noqa: DTZ001 - the zone follows
    except ValueError as error:
        raise ValueError(f"{text!r} is no time: {error}") from None
    naive += timedelta(days=number - 1)
    if number < 1 or naive.year != year:
        raise ValueError(f"{text!r} is no time: {year} has no day {number}")
    return in_zone(naive, UTC if match.group(7) else zone)


def is_time_of_day(text: str) -> bool:
    """Tell whether a text is a time of day, as 22:30, and no date."""
    return _TIME_OF_DAY.fullmatch(text.strip()) is not None


def parse_time_of_day(text: str, zone: tzinfo) -> tuple[time, tzinfo]:
    """Return a time of day, as 22:30 or 22:30Z, and the zone that it is of. Raises ValueError."""
    match = _TIME_OF_DAY.fullmatch(text.strip())
    if match is None:
        raise ValueError(f"{text!r} is no time of day: write it as 22:30, or 22:30Z for UTC")
    hour, minute, second = (int(part or 0) for part in match.groups()[:3])
    try:
        return time(hour, minute, second), UTC if match.group(4) else zone
    except ValueError as error:
        raise ValueError(f"{text!r} is no time of day: {error}") from None


def daily_windows(
    begin: tuple[time, tzinfo], end: tuple[time, tzinfo], span: tuple[float, float]
) -> list[tuple[float, float]]:
    """Return the windows between two times of day that touch a span, POSIX seconds of UTC, not clipped.

    A window whose end is not after its beginning goes on past midnight. Raises ValueError where a time of
    day is passed over, or comes twice, on one of the days.
    """
    first = Utc(span[0]).datetime().astimezone(begin[1]).date() - timedelta(days=1)
    last = Utc(span[1]).datetime().astimezone(begin[1]).date()
    found = []
    for number in range((last - first).days + 1):
        day = first + timedelta(days=number)
        following = day + timedelta(days=1) if end[0] <= begin[0] else day
        # Days that the window cannot touch are none of the plan's: their clocks do not count.
        if not _touches(day, span):
            continue
        low = float(in_zone(datetime.combine(day, begin[0]), begin[1]).unix_s)
        high = float(in_zone(datetime.combine(following, end[0]), end[1]).unix_s)
        if low < span[1] and high > span[0]:
            found.append((low, high))
    return found


def _touches(day: date, span: tuple[float, float]) -> bool:
    """Tell whether a window that begins on a day, in any zone, may meet a span."""
    middle = datetime.combine(day, time(12), UTC).timestamp()
    return span[0] - 3.5 * 86400.0 < middle < span[1] + 2.5 * 86400.0


def in_zone(naive: datetime, zone: tzinfo) -> Utc:
    """Return the instant at which a zone's clock shows a time.

    Raises ValueError where it never does, because clocks are put forward over it, or does so twice.
    """
    before, after = (naive.replace(tzinfo=zone, fold=fold) for fold in (0, 1))
    if before.utcoffset() == after.utcoffset():
        return Utc.from_datetime(before)
    shown = f"{naive.isoformat(sep=' ')} in {zone}"
    early, late = sorted(Utc.from_datetime(one).datetime() for one in (before, after))
    meant_by = " or ".join(
        f"{Utc.from_datetime(one).isoformat('seconds')} ({one.astimezone(zone):%H:%M %Z})"
        for one in (early, late)
    )
    if before.astimezone(UTC).astimezone(zone).replace(tzinfo=None) == naive:
        raise ValueError(f"{shown} comes twice, as clocks are put back: write {meant_by}")
    raise ValueError(f"{shown} never comes, as clocks are put forward over it: write {meant_by}")
