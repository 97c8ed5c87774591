"""The schedule file: read, with all that it includes and imports, to entries of which a plan is made."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

import msgspec

from sattrack.core.origin import Origin, meant
from sattrack.core.toml_text import Positions, read_typed
from sattrack.schedule.moments import (
    daily_windows,
    find_zone,
    is_time_of_day,
    parse_moment,
    parse_time_of_day,
)
from sattrack.schedule.rules import NO_CONDITIONS, Conditions, parse_conditions, parse_rule
from sattrack.schedule.schema import FIXED_PRIORITY, ONLY_AT_THE_TOP, ScheduleText, Terms, Wishes, terms_of
from sattrack.schedule.tables import FixedLine, read_list, read_table
from tle.instants import Utc
from tle.sources import is_fetched

if TYPE_CHECKING:
    from collections.abc import Callable
    from datetime import tzinfo
    from pathlib import Path

    from sattrack.schedule.actions import Notify, Recordings, Wake, Weather
    from sattrack.schedule.schema import FixedEntry, ImportEntry, PassEntry

    Windows = Callable[[tuple[float, float]], list[tuple[float, float]]]

MOST_FILES = 100


@dataclass(frozen=True, slots=True)
class Entry:
    """Passes that somebody asked for: a rule's, some satellites', or one by fixed times.

    `satellites` are keys as `tle.sources.find` takes them, empty for all of `source` (None: of all elements).
    `windows` gives those that touch a span of POSIX seconds, None for no window; `fixed` is such a span.
    """

    label: str
    origin: Origin
    terms: Terms
    satellites: tuple[str, ...] = ()
    source: str | None = None
    conditions: Conditions = NO_CONDITIONS
    windows: Windows | None = None
    fixed: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True)
class Schedule:
    """All that a schedule's files say; the plan's span as POSIX seconds of UTC, None where not said."""

    file: str
    zone_name: str
    from_utc_s: float | None
    to_utc_s: float | None
    elements: tuple[str, ...]
    magnitudes: str | None
    entries: tuple[Entry, ...]
    weather: Weather | None
    park_at_end: bool
    wake: Wake | None
    notify: tuple[Notify, ...]
    recordings: Recordings
    files: tuple[str, ...]
    """Every file that was read for it."""


def load_schedule(path: Path) -> Schedule:
    """Return what a schedule file says. Raises BadInputError with file, line and column."""
    reader = _Reader()
    top, positions, zone = reader.read(path, Origin(str(path)), (), Wishes())
    span = [
        None if text is None else float(_moment(text, zone, positions.value(key)).unix_s)
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


def _source(source: str, path: Path) -> str:
    """Return an element source; a path is one beside the file that names it."""
    if source == "-" or is_fetched(source) or re.match(r"[A-Za-z][A-Za-z0-9+.-]+:", source):
        return source
    return str(path.parent / source)


class _Reader:
    """Reads a file and what it includes and imports, and gathers the entries."""

    def __init__(self) -> None:
        self.entries: list[Entry] = []
        self.files: list[str] = []

    def read(
        self, path: Path, asked_at: Origin, chain: tuple[Path, ...], defaults: Wishes, zone_name: str = "UTC"
    ) -> tuple[ScheduleText, Positions, tzinfo]:
        """Read one file; `chain` are the files through which it was included."""
        text = self.text_of(path, asked_at, "the schedule")
        if len(self.files) > MOST_FILES:
            raise asked_at.wrong(f"more than {MOST_FILES} files are included; join some")
        said, at = read_typed(text, str(path), ScheduleText)
        if chain:
            for key in ONLY_AT_THE_TOP:
                if at.has(key):
                    raise at.key(key).wrong(
                        f"{key} stands in the schedule itself, not in a file that it includes"
                    )
        else:
            defaults = said.defaults
        zone = _zone(said.timezone or zone_name, at.value("timezone"))
        here = (*chain, path.resolve())
        for number, name in enumerate(said.include):
            where = at.value("include", number)
            other = path.parent / name
            if other.resolve() in here:
                files = [*here[here.index(other.resolve()) :], other]
                raise where.wrong(
                    f"includes itself: {' → '.join(one.name for one in files)}; take one include away"
                )
            self.read(other, where, here, defaults, said.timezone or zone_name)
        for number, entry in enumerate(said.passes):
            self.entries.append(_pass_entry(entry, ("passes", number), at, path, zone, defaults))
        for number, fixed in enumerate(said.fixed):
            self.entries.append(_fixed_entry(fixed, ("fixed", number), at, zone, defaults))
        if said.fixed_list is not None:
            lines = read_list(said.fixed_list, zone, at.value("fixed_list"))
            self.entries += [_line_entry(line, Wishes(), defaults) for line in lines]
        for number, table in enumerate(said.imports):
            self._import(table, number, at, path, said.timezone or zone_name, defaults)
        return said, at, zone

    def _import(
        self, table: ImportEntry, number: int, at: Positions, path: Path, zone_name: str, defaults: Wishes
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
        """Return a file's text. Raises BadInputError that tells who asked for it."""
        try:
            text = path.read_text(encoding="utf-8-sig")
        except FileNotFoundError:
            raise asked_at.wrong(f"there is no file {path}{_beside(path, asked_at.file)}") from None
        except (OSError, ValueError) as error:
            why = "it is no UTF-8 text" if isinstance(error, ValueError) else error.strerror
            raise asked_at.wrong(f"cannot read {what} in {path}: {why}") from None
        self.files.append(str(path))
        return text


def _beside(path: Path, asked_by: str) -> str:
    """Return which other file of the folder may have been meant than the one that asks."""
    try:
        return meant(
            path.name,
            sorted(one.name for one in path.parent.iterdir() if one.is_file() and str(one) != asked_by),
        )
    except OSError:
        return ""


def _zone(name: str, where: Origin) -> tzinfo:
    try:
        return find_zone(name)
    except ValueError as error:
        raise where.wrong(f"timezone: {error}") from None


def _moment(text: str, zone: tzinfo, where: Origin) -> Utc:
    try:
        return parse_moment(text, zone)
    except ValueError as error:
        raise where.wrong(str(error)) from None


def _pass_entry(
    entry: PassEntry, key: tuple[str, int], at: Positions, path: Path, zone: tzinfo, defaults: Wishes
) -> Entry:
    source, conditions = None, NO_CONDITIONS
    satellites: tuple[str, ...] = ()
    if entry.rule is not None:
        rule = parse_rule(entry.rule, at.inside(*key, "rule"))
        source = None if rule.source is None else _source(rule.source, path)
        conditions, label = rule.conditions, entry.rule
    else:
        satellites = entry.satellites or (str(entry.satellite),)
        label = ", ".join(satellites)
        if entry.where is not None:
            conditions = parse_conditions(entry.where, at.inside(*key, "where"))
    terms = terms_of(entry, defaults)
    if conditions.above_deg is not None:
        if entry.min_altitude_deg is not None:
            raise at.key(*key, "min_altitude_deg").wrong("the rule says 'above' already; keep one of the two")
        terms = msgspec.structs.replace(terms, min_altitude_deg=conditions.above_deg)
    if conditions.sun_below_deg is not None:
        terms = msgspec.structs.replace(terms, sun_up_deg=min(terms.sun_up_deg, conditions.sun_below_deg))
    return Entry(
        label=entry.name or label,
        origin=at.key(*key),
        terms=terms,
        satellites=satellites,
        source=source,
        conditions=conditions,
        windows=_windows(entry, key, at, zone),
    )


def _windows(entry: PassEntry, key: tuple[str, int], at: Positions, zone: tzinfo) -> Windows | None:
    """Return what gives the windows of a span: one from instant to instant, or one each day."""
    if entry.from_ is None or entry.to is None:
        return None
    places = at.value(*key, "from"), at.value(*key, "to")
    daily = [is_time_of_day(text) for text in (entry.from_, entry.to)]
    if daily[0] != daily[1]:
        raise places[1].wrong("from and to are two times of day, or two dates with times")
    if not daily[0]:
        low, high = (
            float(_moment(text, zone, where).unix_s)
            for text, where in zip((entry.from_, entry.to), places, strict=True)
        )
        if high <= low:
            raise places[1].wrong("the window ends before it starts; swap from and to")
        return lambda span: [(low, high)] if low < span[1] and high > span[0] else []
    try:
        begin, end = parse_time_of_day(entry.from_, zone), parse_time_of_day(entry.to, zone)
    except ValueError as error:
        raise places[0].wrong(str(error)) from None

    def each_day(span: tuple[float, float]) -> list[tuple[float, float]]:
        try:
            return daily_windows(begin, end, span)
        except ValueError as error:
            raise places[0].wrong(str(error)) from None

    return each_day


def _fixed_entry(
    entry: FixedEntry, key: tuple[str, int], at: Positions, zone: tzinfo, defaults: Wishes
) -> Entry:
    start, end = (
        float(_moment(text, zone, at.value(*key, name)).unix_s)
        for name, text in (("start", entry.start), ("end", entry.end))
    )
    if end <= start:
        raise at.value(*key, "end").wrong(f"{entry.satellite}: ends before it starts; swap start and end")
    line = FixedLine(entry.satellite, start, end, at.key(*key), None, entry.name or "")
    return _line_entry(line, entry, defaults)


def _line_entry(line: FixedLine, wishes: Wishes, defaults: Wishes) -> Entry:
    """Return the entry of a pass by fixed times; these count much more than others unless told otherwise."""
    terms = terms_of(wishes, msgspec.structs.replace(defaults, priority=None), priority=FIXED_PRIORITY)
    if line.priority is not None:
        terms = msgspec.structs.replace(terms, priority=line.priority)
    return Entry(
        label=line.name or "fixed times",
        origin=line.origin,
        terms=terms,
        satellites=(line.satellite,),
        fixed=(line.start_utc_s, line.end_utc_s),
    )


def _check_overlaps(entries: list[Entry]) -> None:
    """Raise BadInputError for two fixed passes at one time of which nobody said that one counts more."""
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
