"""Two-line and three-line element sets: text to `Elements`, every column checked.

Columns as in Space-Track's "Basic Description of the Two Line Element (TLE) Format", with Alpha-5 numbers.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from datetime import date
from typing import TYPE_CHECKING

from tle.elements import Elements, parse_alpha5
from tle.errors import (
    ChecksumError,
    ElementsError,
    FieldError,
    FieldRangeError,
    FormatError,
    LineLengthError,
    MismatchedLinesError,
    MissingLineError,
    SwappedLinesError,
    printable,
)
from tle.formats.omm import EPHEMERIS_TYPES, MAX_REV_DAY, wrong_theory
from tle.formats.tle_regular import checksum, regular_set
from tle.instants import DAY_S, Utc

if TYPE_CHECKING:
    from collections.abc import Iterator

_LENGTH = 69
_ELEMENT_LINE = re.compile(r"[12] [ 0-9A-Z][ 0-9]{3}[0-9]|[12] .{30,}", re.ASCII)
_ANY_ELEMENT_LINE = re.compile(rf"^(?:{_ELEMENT_LINE.pattern})", re.ASCII | re.MULTILINE)
_COPY = "copy the set again from its source"
_SPACES = {1: (2, 9, 18, 33, 44, 53, 62, 64), 2: (2, 8, 17, 26, 34, 43, 52)}


@dataclass(frozen=True, slots=True)
class Line:
    """One line of a source: its text without line end and trailing blanks, its source and 1-based number."""

    text: str
    source: str = ""
    number: int | None = None

    def columns(self, first: int, last: int) -> str:
        """Return the text of 1-based columns, both included."""
        return self.text[first - 1 : last]

    def says(
        self, kind: type[ElementsError], reason: str, columns: tuple[int, int] | None = None
    ) -> ElementsError:
        """Return an exception about this line."""
        return kind(reason, source=self.source, line=self.number, text=self.text, columns=columns)


def looks_like_tle(text: str) -> bool:
    """Tell whether any line of a text looks like one of a two-line set."""
    return _ANY_ELEMENT_LINE.search(text) is not None


def is_element_line(text: str) -> bool:
    """Tell whether one line looks like one of a two-line set, sound or not."""
    return text[:2] in ("1 ", "2 ") and _ELEMENT_LINE.match(text) is not None


def read(text: str, source: str = "") -> Iterator[Elements | ElementsError]:
    """Yield, in the order of the text, the elements of each set or the reason it is refused.

    Name lines are optional and may begin with "0 "; blank lines, `#` comments and CRLF are accepted.
    """
    numbered = enumerate(text.split("\n"), start=1)
    lines = [(n, line) for n, raw in numbered if (line := raw.rstrip()) and line[0] != "#"]
    at = 0
    while at < len(lines):
        name: tuple[int, str] | None = None
        if not is_element_line(lines[at][1]):
            name = lines[at]
            at += 1
        if at + 1 < len(lines):
            title = "" if name is None else clean_name(name[1])
            regular = regular_set(lines[at][1], lines[at + 1][1], title)
            if regular is not None:
                yield regular
                at += 2
                continue
        group = _group(lines, at)
        at += len(group)
        yield _set_or_refusal(
            None if name is None else Line(name[1], source, name[0]),
            [Line(line, source, number) for number, line in group],
        )


def parse_set(line1: str, line2: str, name: str = "") -> Elements:
    """Return the elements of two lines. Raises a subclass of ElementsError."""
    first, second = Line(line1.rstrip()), Line(line2.rstrip())
    return parse_lines(first, second, clean_name(name))


def _group(lines: list[tuple[int, str]], at: int) -> list[tuple[int, str]]:
    """Return the one or two element lines from a place on that make one set."""
    group: list[tuple[int, str]] = []
    while at < len(lines) and len(group) < 2 and is_element_line(lines[at][1]):
        group.append(lines[at])
        at += 1
        if len(group) == 1 and at < len(lines) and _starts_another_set(group[0][1], lines[at][1]):
            break
    return group


def _starts_another_set(first: str, following: str) -> bool:
    """Tell whether a line begins a new set, the one before it being alone."""
    if following[0] != first[0]:
        return False
    return first[0] == "1" or following[2:7] != first[2:7]


def _set_or_refusal(name: Line | None, group: list[Line]) -> Elements | ElementsError:
    try:
        if not group:
            assert name is not None
            raise name.says(
                FormatError,
                "neither a satellite's name before two element lines, nor an element line: remove it",
            )
        if len(group) == 1:
            wanted = "2" if group[0].text[0] == "1" else "1"
            raise group[0].says(MissingLineError, f"line {wanted} of this set is missing: {_COPY}")
        return parse_lines(group[0], group[1], clean_name(name.text) if name else "")
    except ElementsError as error:
        error.name = clean_name(name.text) if name else ""
        error.catalog_number = parse_alpha5(group[0].columns(3, 7)) if group else None
        return error


def clean_name(text: str) -> str:
    """Return the name in a name line: without "0 " before it, blanks around it and control characters."""
    name = text.strip()
    if name[:2] == "0 ":
        name = name[2:].lstrip()
    return name if name.isprintable() else printable(name)


def parse_lines(first: Line, second: Line, name: str) -> Elements:
    """Return the elements of two lines, every column checked. Raises a subclass of ElementsError."""
    if first.text[:1] == "2" and second.text[:1] == "1":
        raise first.says(SwappedLinesError, "line 2 stands before line 1: put line 1 first", (1, 1))
    for line, number in ((first, 1), (second, 2)):
        _check_frame(line, number)
    number = _catalog_number(first)
    if number != _catalog_number(second):
        raise second.says(
            MismatchedLinesError,
            f"line 2 is of object {second.columns(3, 7).strip()}, "
            f"line 1 of object {first.columns(3, 7).strip()}: take both lines from the same set",
            (3, 7),
        )
    return Elements(
        name=name,
        catalog_number=number,
        classification=first.columns(8, 8).strip() or "U",
        designator=_designator(first),
        epoch=_epoch(first),
        inclination_deg=_angle(second, 9, 16, "inclination", 180.0),
        raan_deg=_angle(second, 18, 25, "right ascension of the node", 360.0),
        eccentricity=float(f".{_digits(second, 27, 33, 'eccentricity')}"),
        arg_perigee_deg=_angle(second, 35, 42, "argument of perigee", 360.0),
        mean_anomaly_deg=_angle(second, 44, 51, "mean anomaly", 360.0),
        mean_motion_rev_day=_mean_motion(second),
        mean_motion_dot_rev_day2=_decimal(first, 34, 43, "first derivative of mean motion"),
        mean_motion_ddot_rev_day3=_exponential(first, 45, 52, "second derivative of mean motion"),
        bstar_per_earth_radius=_exponential(first, 54, 61, "drag term B*"),
        ephemeris_type=_ephemeris_type(first),
        element_set_number=_whole(first, 65, 68, "element set number"),
        revolution_number=_whole(second, 64, 68, "revolution number"),
    )


def _check_frame(line: Line, number: int) -> None:
    """Check what both lines have alike: number, length, blanks between the columns, checksum."""
    length = len(line.text)
    if line.text[:2] != f"{number} ":
        raise line.says(
            MissingLineError, f"line {number} of the set must begin with '{number} ': {_COPY}", (1, 2)
        )
    if length < _LENGTH:
        raise line.says(
            LineLengthError,
            f"line {number} is cut off: {length} of {_LENGTH} columns: {_COPY}",
            (length + 1, _LENGTH),
        )
    if length > _LENGTH:
        raise line.says(
            LineLengthError,
            f"line {number} goes on after its {_LENGTH} columns: {length} columns: remove what follows",
            (_LENGTH + 1, length),
        )
    for column in _SPACES[number]:
        if line.columns(column, column) != " ":
            raise line.says(
                FieldError,
                f"line {number}, column {column} must be blank, not {line.columns(column, column)!r}: "
                f"the columns have shifted, {_COPY}",
                (column, column),
            )
    _check_sum(line, number)


def _check_sum(line: Line, number: int) -> None:
    """Check the sum, modulo 10, of columns 1 to 68: a minus counts one, all else but digits nothing."""
    given = line.columns(69, 69)
    if given not in "0123456789":
        raise line.says(
            FieldError, f"line {number}, checksum must be a digit, not {given!r}: {_COPY}", (69, 69)
        )
    total = checksum(line.text)
    if int(given) != total:
        raise line.says(
            ChecksumError,
            f"line {number}, checksum is {given} but its columns add up to {total}: "
            f"a digit is wrong, {_COPY}",
            (69, 69),
        )


def _catalog_number(line: Line) -> int:
    number = parse_alpha5(line.columns(3, 7))
    if number is None:
        raise line.says(
            FieldError,
            f"catalogue number {line.columns(3, 7)!r} is no number, "
            f"nor an Alpha-5 one (A0000 to Z9999, no I or O): {_COPY}",
            (3, 7),
        )
    return number


def _designator(line: Line) -> str:
    """Return "1998-067A" for launch year, number and piece; "" where the columns are blank."""
    field = line.columns(10, 17)
    if not field.strip():
        return ""
    match = re.fullmatch(r"(\d\d)(\d{3})([A-Z]{1,3}) *", field, re.ASCII)
    if match is None:
        # Sets of uncatalogued objects carry notes of their own here: kept as they are.
        return field.strip()
    year, launch, piece = match.groups()
    return f"{_full_year(int(year))}-{launch}{piece}"


def _full_year(two_digits: int) -> int:
    return two_digits + (1900 if two_digits >= 57 else 2000)


def _epoch(line: Line) -> Utc:
    year_text = line.columns(19, 20)
    day_text = line.columns(21, 32)
    if not re.fullmatch(r"\d\d| \d", year_text, re.ASCII):
        raise line.says(FieldError, f"epoch year {year_text!r} is not two digits: {_COPY}", (19, 20))
    match = re.fullmatch(r"( *\d+)(\.\d*) *", day_text, re.ASCII)
    if match is None:
        raise line.says(
            FieldError, f"epoch day {day_text!r} is no day of the year with a fraction: {_COPY}", (21, 32)
        )
    year, day = _full_year(int(year_text)), int(match.group(1))
    first = date(year, 1, 1).toordinal()
    if not 1 <= day <= date(year + 1, 1, 1).toordinal() - first:
        raise line.says(FieldRangeError, f"epoch day {day} is no day of the year {year}: {_COPY}", (21, 32))
    fraction = float(f"0{match.group(2)}")
    return Utc((first - date(1970, 1, 1).toordinal() + day - 1) * DAY_S + fraction * DAY_S)


def _decimal(line: Line, first: int, last: int, field: str) -> float:
    text = line.columns(first, last)
    if not re.fullmatch(r" *[+-]?\d*\.\d+ *", text, re.ASCII):
        raise line.says(FieldError, f"{field} {text.strip()!r} is no decimal number: {_COPY}", (first, last))
    return float(text)


def _digits(line: Line, first: int, last: int, field: str) -> str:
    text = line.columns(first, last)
    if not re.fullmatch(r" *\d+", text, re.ASCII):
        raise line.says(FieldError, f"{field} {text.strip()!r} is not all digits: {_COPY}", (first, last))
    return text.replace(" ", "0")


def _angle(line: Line, first: int, last: int, field: str, most_deg: float) -> float:
    value_deg = _decimal(line, first, last, field)
    if not 0.0 <= value_deg <= most_deg:
        raise line.says(
            FieldRangeError, f"{field} {value_deg} is outside 0 to {most_deg:.0f}°: {_COPY}", (first, last)
        )
    return value_deg


def _mean_motion(line: Line) -> float:
    value = _decimal(line, 53, 63, "mean motion")
    if not 0.0 < value <= MAX_REV_DAY:
        raise line.says(
            FieldRangeError,
            f"mean motion {value} revolutions a day is no orbit of the Earth (above 0, to {MAX_REV_DAY}): "
            f"{_COPY}",
            (53, 63),
        )
    return value


def _exponential(line: Line, first: int, last: int, field: str) -> float:
    """Return a number with an implied point before its five digits and a power of ten of one digit."""
    text = line.columns(first, last)
    match = re.fullmatch(r"([ +-])(\d{5})([ +-]\d)|([ +-])( {5}|0{5})( {2}|[+-]\d)", text, re.ASCII)
    if match is None:
        raise line.says(
            FieldError,
            f"{field} {text.strip()!r} is not five digits and a signed power of ten: {_COPY}",
            (first, last),
        )
    sign, digits, power = match.group(1) or match.group(4), match.group(2) or "0", match.group(3) or "0"
    # The power of ten multiplies, as in SGP4's own reader: "0.12345e-4" may differ in the last bit.
    return float(f"{sign.strip()}.{digits}") * 10.0 ** int(power)


def _ephemeris_type(line: Line) -> int:
    value = _whole(line, 63, 63, "ephemeris type")
    if value not in EPHEMERIS_TYPES:
        raise line.says(FieldRangeError, wrong_theory(value), (63, 63))
    return value


def _whole(line: Line, first: int, last: int, field: str) -> int:
    text = line.columns(first, last)
    if not re.fullmatch(r" *\d* *", text, re.ASCII):
        raise line.says(FieldError, f"{field} {text.strip()!r} is no whole number: {_COPY}", (first, last))
    return int(text.strip() or "0")
