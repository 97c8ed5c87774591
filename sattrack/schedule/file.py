"""The schedule file: read, with all that it includes and imports, to entries of which a plan is made.

Fixed times come from a table (CSV) of satellite, start and end, or from a list as stations write it. A line
of a list is start, end and satellite, parted by blanks:

    2026-10-02T19:40:10  2026-10-02T19:46:00  ISS (ZARYA)
    2026.275.19:40:10    2026.275.19:46:00    25544          # day of year, as VLBI schedules have it

A time without a zone of its own is of the file's `timezone`. Times that a zone's clock skips or shows twice,
when summer time begins or ends, are refused with what may have been meant; those of daily windows are not.
"""

from __future__ import annotations

import csv
import re
from dataclasses import dataclass, replace
from datetime import UTC, datetime, time, timedelta, tzinfo
from typing import TYPE_CHECKING, NamedTuple
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError

import msgspec

from sattrack.core.errors import Origin, meant
from sattrack.core.toml_text import KeyPositions, read_typed, why_unreadable
from sattrack.mount.profiles import no_settings
from sattrack.schedule.schema import (
    FIXED_PRIORITY,
    NO_CONDITIONS,
    ONLY_AT_THE_TOP,
    Conditions,
    PassOptions,
    ScheduleText,
    Terms,
    parse_conditions,
    parse_rule,
    terms_of,
)
from tle.errors import TimeFormatError
from tle.instants import Utc
from tle.sources import is_fetched

if TYPE_CHECKING:
    from collections.abc import Callable
    from datetime import tzinfo
    from pathlib import Path

    from sattrack.schedule.schema import FixedEntry, ImportEntry, Notify, PassEntry, Recordings, Wake, Weather

    Windows = Callable[[tuple[float, float]], list[tuple[float, float]]]


MOST_FILES = 100


@dataclass(frozen=True, slots=True)
class ScheduleEntry:
    """Requested passes: a rule's, some satellites', or one by fixed times.

    `satellites` are keys as `tle.sources.find` takes them, or bodies, stars and directions, or the objects of
    files, `ephemeris`; empty for all of `source` (None: of all elements).
    `windows` gives those that touch a span of POSIX seconds, None for no window; `fixed` is such a span.
    """

    label: str
    origin: Origin
    terms: Terms
    satellites: tuple[str, ...] = ()
    source: str | None = None
    ephemeris: tuple[str, ...] = ()
    conditions: Conditions = NO_CONDITIONS
    windows: Windows | None = None
    fixed: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True)
class Schedule:
    """All that a schedule's files say; the plan's span as POSIX seconds of UTC, None where none is given."""

    file: str
    zone_name: str
    from_utc_s: float | None
    to_utc_s: float | None
    elements: tuple[str, ...]
    magnitudes: str | None
    entries: tuple[ScheduleEntry, ...]
    weather: Weather | None
    park_at_end: bool
    wake: Wake | None
    notify: tuple[Notify, ...]
    recordings: Recordings
    files: tuple[str, ...]
    """Every file that was read for it."""


def load_schedule(path: Path) -> Schedule:
    """Return the schedule of a file. Raises BadInputError with file, line and column."""
    reader = _ScheduleReader()
    top, positions, zone = reader.read(path, Origin(str(path)), (), PassOptions())
    span = [
        None if text is None else _moment(text, zone, positions.value(key))
        for key, text in (("from", top.from_), ("to", top.to))
    ]
    if span[0] is not None and span[1] is not None and span[1] <= span[0]:
        raise positions.key("to").wrong("to is not after from: the plan ends before it begins")
    if not reader.entries:
        raise Origin(str(path)).wrong(
            "asks for no pass: write [[passes]], [[fixed]], fixed_list or [[imports]]"
        )
    _check_overlaps(reader.entries)
    weather = top.weather
    if weather is not None and weather.file is not None:
        weather = msgspec.structs.replace(weather, file=str(path.parent / weather.file))
    return Schedule(
        file=str(path),
        zone_name=top.timezone or "UTC",
        from_utc_s=span[0],
        to_utc_s=span[1],
        elements=tuple(_source(one, path) for one in top.elements),
        magnitudes=None if top.magnitudes is None else str(path.parent / top.magnitudes),
        entries=tuple(reader.entries),
        weather=weather,
        park_at_end=top.park_at_end is not False,
        wake=top.wake,
        notify=top.notify,
        recordings=top.recordings,
        files=tuple(reader.files),
    )


def _ephemerides(files: str | tuple[str, ...], path: Path) -> tuple[str, ...]:
    """Return the paths of files beside the one that names them, one or several."""
    return tuple(str(path.parent / one) for one in ((files,) if isinstance(files, str) else files))


def _source(source: str, path: Path) -> str:
    """Return an element source; a path is one beside the file that names it."""
    if source == "-" or is_fetched(source) or re.match(r"[A-Za-z][A-Za-z0-9+.-]+:", source):
        return source
    return str(path.parent / source)


class _ScheduleReader:
    """Reads a file and what it includes and imports, and gathers the entries."""

    def __init__(self) -> None:
        self.entries: list[ScheduleEntry] = []
        self.files: list[str] = []

    def read(
        self,
        path: Path,
        asked_at: Origin,
        chain: tuple[Path, ...],
        defaults: PassOptions,
        zone_name: str = "UTC",
    ) -> tuple[ScheduleText, KeyPositions, tzinfo]:
        """Read one file; `chain` are the files through which it was included."""
        text = self.text_of(path, asked_at, "the schedule")
        if len(self.files) > MOST_FILES:
            raise asked_at.wrong(f"more than {MOST_FILES} files are included; join some")
        table, at = _read_table(text, path)
        if chain:
            for key in ONLY_AT_THE_TOP:
                if at.has(key):
                    raise at.key(key).wrong(
                        f"{key} stands in the schedule itself, not in a file that it includes"
                    )
        else:
            defaults = table.defaults
        zone = _zone(table.timezone or zone_name, at.value("timezone"))
        here = (*chain, path.resolve())
        for number, name in enumerate(table.include):
            where = at.value("include", number)
            other = path.parent / name
            if other.resolve() in here:
                files = [*here[here.index(other.resolve()) :], other]
                raise where.wrong(
                    f"includes itself: {' → '.join(one.name for one in files)}; take one include away"
                )
            self.read(other, where, here, defaults, table.timezone or zone_name)
        for number, entry in enumerate(table.passes):
            self.entries.append(_pass_entry(entry, ("passes", number), at, path, zone, defaults))
        for number, fixed in enumerate(table.fixed):
            self.entries.append(_fixed_entry(fixed, ("fixed", number), at, path, zone, defaults))
        if table.fixed_list is not None:
            lines = read_list(table.fixed_list, zone, at.value("fixed_list"))
            self.entries += [_line_entry(line, PassOptions(), defaults) for line in lines]
        for number, one in enumerate(table.imports):
            self._import(one, number, at, path, table.timezone or zone_name, defaults)
        return table, at, zone

    def _import(
        self,
        table: ImportEntry,
        number: int,
        at: KeyPositions,
        path: Path,
        zone_name: str,
        defaults: PassOptions,
    ) -> None:
        where = at.value("imports", number, "file")
        other = path.parent / table.file
        zone = _zone(table.timezone or zone_name, at.value("imports", number, "timezone"))
        text = self.text_of(other, where, "the times")
        as_table = table.format == "csv" or (table.format is None and other.suffix.lower() == ".csv")
        lines = (read_table if as_table else read_list)(text, zone, Origin(str(other), 1, 1))
        if not lines:
            raise where.wrong(f"{other} holds no times")
        self.entries += [_line_entry(line, table, defaults) for line in lines]

    def text_of(self, path: Path, asked_at: Origin, what: str) -> str:
        """Return a file's text. Raises BadInputError with the place that names the file."""
        try:
            text = path.read_text(encoding="utf-8-sig")
        except FileNotFoundError:
            name = "there is no such file" if str(path) == asked_at.file else f"there is no file {path}"
            raise asked_at.wrong(
                f"{name}{_beside(path, asked_at.file) or '; check the name and the folder'}"
            ) from None
        except (OSError, ValueError) as error:
            raise asked_at.wrong(f"cannot read {what} in {path}: {why_unreadable(error)}") from None
        self.files.append(str(path))
        return text


def _read_table(text: str, path: Path) -> tuple[ScheduleText, KeyPositions]:
    """Return what a file says. Raises BadInputError with the place."""
    with no_settings(path, "not a schedule: docs/schedules.md says what stands in one"):
        return read_typed(text, str(path), ScheduleText, what="a schedule")


def _beside(path: Path, asked_by: str) -> str:
    """Return a hint at another file of the same kind, in the same folder, that may have been meant."""
    try:
        others = [one for one in path.parent.iterdir() if one.is_file() and str(one) != asked_by]
    except OSError:
        return ""
    return meant(path.stem, sorted(one.stem for one in others if one.suffix == path.suffix), path.suffix)


def _zone(name: str, where: Origin) -> tzinfo:
    try:
        return find_zone(name)
    except ValueError as error:
        raise where.wrong(f"timezone: {error}") from None


def _moment(text: str, zone: tzinfo, where: Origin) -> float:
    """Return the instant that a text names, POSIX seconds. Raises BadInputError."""
    try:
        return float(parse_moment(text, zone).unix_s)
    except ValueError as error:
        raise where.wrong(str(error)) from None


def _pass_entry(
    entry: PassEntry, key: tuple[str, int], at: KeyPositions, path: Path, zone: tzinfo, defaults: PassOptions
) -> ScheduleEntry:
    source, conditions = None, NO_CONDITIONS
    satellites: tuple[str, ...] = ()
    if entry.rule is not None:
        rule = parse_rule(entry.rule, at.inside(*key, "rule"))
        source = None if rule.source is None else _source(rule.source, path)
        conditions, label = rule.conditions, entry.rule
    else:
        satellites = entry.satellites or (str(entry.satellite),)
        source = None if entry.elements is None else _source(entry.elements, path)
        label = ", ".join(satellites)
        if entry.where is not None:
            conditions = parse_conditions(entry.where, at.inside(*key, "where"))
    terms = terms_of(entry, defaults)
    if conditions.above_deg is not None:
        if entry.min_altitude_deg is not None:
            raise at.key(*key, "min_altitude_deg").wrong("the rule says 'above' already; keep one of the two")
        terms = msgspec.structs.replace(terms, min_altitude_deg=conditions.above_deg)
    if conditions.sun_below_deg is not None:
        # It takes the place of our default, not of what the file sets.
        set_deg = terms_of(entry, defaults, sun_up_deg=conditions.sun_below_deg).sun_up_deg
        terms = msgspec.structs.replace(terms, sun_up_deg=min(set_deg, conditions.sun_below_deg))
    return ScheduleEntry(
        label=entry.name or label,
        origin=at.key(*key),
        terms=terms,
        satellites=satellites,
        source=source,
        ephemeris=_ephemerides(entry.ephemeris, path),
        conditions=conditions,
        windows=_windows(entry, key, at, zone),
    )


def _windows(entry: PassEntry, key: tuple[str, int], at: KeyPositions, zone: tzinfo) -> Windows | None:
    """Return what gives the windows of a span: one from instant to instant, or one each day."""
    if entry.from_ is None or entry.to is None:
        return None
    places = at.value(*key, "from"), at.value(*key, "to")
    daily = [is_time_of_day(text) for text in (entry.from_, entry.to)]
    if daily[0] != daily[1]:
        raise places[1].wrong("from and to are two times of day, or two dates with times")
    if not daily[0]:
        low, high = (
            _moment(text, zone, where) for text, where in zip((entry.from_, entry.to), places, strict=True)
        )
        if high <= low:
            raise places[1].wrong("the window ends before it starts; swap from and to")
        return lambda span: [(low, high)] if low < span[1] and high > span[0] else []
    begin, end = (
        _time_of_day(text, zone, where) for text, where in zip((entry.from_, entry.to), places, strict=True)
    )
    return lambda span: daily_windows(begin, end, span)


def _time_of_day(text: str, zone: tzinfo, where: Origin) -> tuple[time, tzinfo]:
    """Return the time of day that a text names, and its zone. Raises BadInputError."""
    try:
        return parse_time_of_day(text, zone)
    except ValueError as error:
        raise where.wrong(str(error)) from None


def _fixed_entry(
    entry: FixedEntry, key: tuple[str, int], at: KeyPositions, path: Path, zone: tzinfo, defaults: PassOptions
) -> ScheduleEntry:
    start, end = (
        _moment(text, zone, at.value(*key, name))
        for name, text in (("start", entry.start), ("end", entry.end))
    )
    if end <= start:
        raise at.value(*key, "end").wrong(f"{entry.satellite}: ends before it starts; swap start and end")
    line = FixedLine(entry.satellite, start, end, at.key(*key), None, entry.name or "")
    return replace(
        _line_entry(line, entry, defaults),
        ephemeris=_ephemerides(entry.ephemeris, path),
        source=None if entry.elements is None else _source(entry.elements, path),
    )


def _line_entry(line: FixedLine, wishes: PassOptions, defaults: PassOptions) -> ScheduleEntry:
    """Return the entry of a pass by fixed times; these count much more than others by default."""
    terms = terms_of(wishes, msgspec.structs.replace(defaults, priority=None), priority=FIXED_PRIORITY)
    if line.priority is not None:
        terms = msgspec.structs.replace(terms, priority=line.priority)
    return ScheduleEntry(
        label=line.name or "fixed times",
        origin=line.origin,
        terms=terms,
        satellites=(line.satellite,),
        fixed=(line.start_utc_s, line.end_utc_s),
    )


def _check_overlaps(entries: list[ScheduleEntry]) -> None:
    """Raise BadInputError for two fixed passes at one time of equal priority."""
    fixed = sorted((entry.fixed, k) for k, entry in enumerate(entries) if entry.fixed is not None)
    latest: dict[float, tuple[float, int]] = {}
    for span, k in fixed:
        priority = entries[k].terms.priority
        end, other = latest.get(priority, (span[0], k))
        if end > span[0]:
            raise entries[k].origin.wrong(
                f"{entries[k].satellites[0]} begins {Utc(span[0]).isoformat('seconds')}, before "
                f"{entries[other].satellites[0]} of {entries[other].origin} ends, "
                f"{Utc(end).isoformat('seconds')}: move one, or give them different priorities"
            )
        latest[priority] = (span[1], k)


COLUMNS = ("satellite", "start", "end")
OPTIONAL = ("priority", "name")
_COMMENTS = re.compile(r"(?:^|\s)[#*\"].*$")
_WORDS = re.compile(r"\S+")


class FixedLine(NamedTuple):
    """One pass by fixed times: POSIX seconds of UTC, its priority where the table has one."""

    satellite: str
    start_utc_s: float
    end_utc_s: float
    origin: Origin
    priority: float | None = None
    name: str = ""


def read_list(text: str, zone: tzinfo, origin: Origin) -> list[FixedLine]:
    """Return the lines of a list; `#`, `*` and `"` begin comments. Raises BadInputError.

    `origin` is where the text's first character stands.
    """
    found = []
    for number, whole in enumerate(text.splitlines()):
        line = _COMMENTS.sub("", whole)
        words = list(_WORDS.finditer(line))
        if not words:
            continue
        column = origin.column if number == 0 else 1
        here = origin._replace(line=(origin.line or 1) + number, column=max(column, 1))
        # A date and a time of day parted by a blank are one time.
        pieces: list[tuple[int, str]] = []
        while words and len(pieces) < 2:
            first = words.pop(0)
            text_of = first.group()
            if (
                re.fullmatch(r"\d{4}-\d\d-\d\d", text_of)
                and words
                and re.match(r"\d\d:\d\d", words[0].group())
            ):
                text_of += f" {words.pop(0).group()}"
            pieces.append((first.start(), text_of))
        satellite = line[words[0].start() :].strip() if words else ""
        if not satellite:
            raise here.wrong(
                f"{line.strip()!r} is no line of a list: write start, end and satellite, as "
                "2026-10-02T19:40:10 2026-10-02T19:46:00 ISS"
            )
        times = [_moment(value, zone, here.moved(at)) for at, value in pieces]
        found.append(_fixed(satellite, (times[0], times[1]), here.moved(pieces[0][0])))
    return found


def read_table(text: str, zone: tzinfo, origin: Origin) -> list[FixedLine]:
    """Return the rows of a table with a line of titles: satellite, start, end, optionally priority and name.

    Commas, semicolons or tabs part the fields. Raises BadInputError with line and column.
    """
    lines = text.splitlines()
    first = next(
        (k for k, line in enumerate(lines) if line.strip() and not line.lstrip().startswith("#")), None
    )
    if first is None:
        raise origin.wrong("the table is empty: its first line names the columns satellite,start,end")
    mark = max(",;\t", key=lines[first].count)
    reader = csv.reader(lines[first:], delimiter=mark, skipinitialspace=True, strict=True)
    found: list[FixedLine] = []
    titles: dict[str, int] = {}
    try:
        for row in reader:
            here = origin._replace(line=first + reader.line_num, column=1)
            if not any(field.strip() for field in row) or row[0].lstrip().startswith("#"):
                continue
            if not titles:
                titles = _titles(row, here, lines[here.line - 1])
                continue
            found.append(_row(row, titles, zone, here, lines[here.line - 1]))
    except csv.Error as error:
        raise origin._replace(line=first + reader.line_num, column=0).wrong(f"no table: {error}") from None
    return found


def _titles(row: list[str], here: Origin, line: str) -> dict[str, int]:
    known = (*COLUMNS, *OPTIONAL)
    titles: dict[str, int] = {}
    for number, field in enumerate(row):
        title = field.strip().lower()
        where = here.moved(max(line.find(field), 0))
        if title not in known:
            hint = meant(title, known) or f"; there are {', '.join(known)}"
            raise where.wrong(f"unknown column {field.strip()!r}{hint}")
        if title in titles:
            raise where.wrong(f"the column {title!r} is there twice")
        titles[title] = number
    absent = [name for name in COLUMNS if name not in titles]
    if absent:
        raise here.wrong(f"the first line names no column {' and '.join(absent)}: write satellite,start,end")
    return titles


def _row(row: list[str], titles: dict[str, int], zone: tzinfo, here: Origin, line: str) -> FixedLine:
    def field(name: str) -> tuple[str, Origin]:
        number = titles.get(name, len(row))
        value = row[number].strip() if number < len(row) else ""
        return value, here.moved(max(line.find(value), 0))

    for name in COLUMNS:
        if not field(name)[0]:
            raise here.wrong(f"{name} is empty in this row of {len(row)} fields")
    (start, at), (end, end_at) = field("start"), field("end")
    times = (_moment(start, zone, at), _moment(end, zone, end_at))
    priority, place = field("priority")
    try:
        weight = float(priority) if priority else None
    except ValueError:
        raise place.wrong(f"priority is {priority!r}; give a number above 0") from None
    if weight is not None and not 0.0 < weight <= 1e6:
        raise place.wrong(f"priority is {priority}; give a number above 0, 1e+06 at most")
    return _fixed(field("satellite")[0], times, here)._replace(priority=weight, name=field("name")[0])


def _fixed(satellite: str, times: tuple[float, float], origin: Origin) -> FixedLine:
    start, end = times
    if not end > start:
        raise origin.wrong(f"{satellite}: ends before it starts; swap the two times")
    return FixedLine(satellite, start, end, origin)


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
    """Return whether a text is a time of day, as 22:30, and no date."""
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

    A window ends when a clock shows its end next: past midnight where that is not after its beginning. Of a
    time that a clock shows twice the first counts; one that it skips is as long after midnight as on other
    days (RFC 5545, 3.3.5).
    """
    first = Utc(span[0]).datetime().astimezone(begin[1]).date() - timedelta(days=1)
    last = Utc(span[1]).datetime().astimezone(begin[1]).date()
    found = []
    for number in range((last - first).days + 1):
        day = first + timedelta(days=number)
        opens = datetime.combine(day, *begin)
        low, high = opens.timestamp(), _next_time(end, opens).timestamp()
        # One that begins in a skipped hour and ends with it is none.
        if low < min(span[1], high) and high > span[0]:
            found.append((low, high))
    return found


def _next_time(wanted: tuple[time, tzinfo], after: datetime) -> datetime:
    """Return the first instant after another at which a zone's clock shows a time of day."""
    days = (after.date() + timedelta(days=k) for k in (-1, 0, 1, 2))
    return next(one for one in (datetime.combine(day, *wanted) for day in days) if one > after)


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
