"""Fixed times from elsewhere: a table (CSV) of satellite, start and end, and lists as stations write them.

A line of a list is start, end and satellite, parted by blanks:

    2026-10-02T19:40:10  2026-10-02T19:46:00  ISS (ZARYA)
    2026.275.19:40:10    2026.275.19:46:00    25544          # day of year, as VLBI schedules have it
"""

from __future__ import annotations

import csv
import re
from typing import TYPE_CHECKING, NamedTuple

from sattrack.core.origin import meant
from sattrack.schedule.moments import parse_moment

if TYPE_CHECKING:
    from datetime import tzinfo

    from sattrack.core.origin import Origin

COLUMNS = ("satellite", "start", "end")
OPTIONAL = ("priority", "name")
_COMMENTS = re.compile(r"(?:^|\s)[#*\"].*$")
_WORDS = re.compile(r"\S+")


class FixedLine(NamedTuple):
    """One pass by fixed times: POSIX seconds of UTC, its priority where the table tells one."""

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
    """Return the rows of a table with a line of titles: satellite, start, end, and maybe priority and name.

    Commas, semicolons or tabs part the fields. Raises BadInputError with line and column.
    """
    lines = text.splitlines()
    first = next((number for number, line in enumerate(lines) if line.strip()), None)
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


def _moment(text: str, zone: tzinfo, origin: Origin) -> float:
    try:
        return float(parse_moment(text, zone).unix_s)
    except ValueError as error:
        raise origin.wrong(str(error)) from None


def _fixed(satellite: str, times: tuple[float, float], origin: Origin) -> FixedLine:
    start, end = times
    if not end > start:
        raise origin.wrong(f"{satellite}: ends before it starts; swap the two times")
    return FixedLine(satellite, start, end, origin)
