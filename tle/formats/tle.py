"""Two-line and three-line element sets: text to `Elements`, every column checked, and back to text.

Columns as in Space-Track's "Basic Description of the Two Line Element (TLE) Format", with Alpha-5 numbers.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from datetime import date
from functools import cache
from typing import TYPE_CHECKING

from tle.elements import Elements, epoch_jd, format_alpha5, parse_alpha5
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
    UnwritableError,
    printable,
)
from tle.formats.omm import AGAIN, DAY_ZERO, EPHEMERIS_TYPES, MAX_REV_DAY, wrong_theory
from tle.instants import DAY_S, UNIX_EPOCH_JD, Utc

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

_WORTH = bytes(c - 48 if 48 <= c <= 57 else c == 45 for c in range(256))
_POWERS = {f"{sign}{power}": 10.0 ** int(f"{sign}{power}") for power in range(10) for sign in "+-"}
_TWICE = {str(digit): 2 * digit % 10 for digit in range(10)}
_LINE_1 = re.compile(
    r"1 ([A-HJ-NP-Z\d ][\d ]{3}\d)([A-Z]) (\d{5}[A-Z](?:[A-Z] | {2}|[A-Z]{2})| {8}) "
    r"(\d\d)([ \d]{2}\d)(\.\d{8}) ([ +-]\.\d{8}) ([ +-]\d{5})([+-]\d) ([ +-]\d{5})([+-]\d) "
    r"([0-3]) ([ \d]{3}\d)(\d)",
    re.ASCII,
)
_LINE_2 = re.compile(
    r"2 (.{5}) ([ \d]{2}\d\.\d{4}) ([ \d]{2}\d\.\d{4}) (\d{7}) ([ \d]{2}\d\.\d{4}) ([ \d]{2}\d\.\d{4}) "
    r"([ \d]\d\.\d{8})([ \d]{4}\d)(\d)",
    re.ASCII,
)
_LENGTH = 69
_ELEMENT_LINE = re.compile(r"[12] [ 0-9A-Z][ 0-9]{3}[0-9]|[12] .{30,}", re.ASCII)
_ANY_ELEMENT_LINE = re.compile(r"^[ \t]*[12][ \t](?:[ 0-9A-Z][ 0-9]{3}[0-9]|.{30,})", re.ASCII | re.MULTILINE)
_SPACES = {1: (2, 9, 18, 33, 44, 53, 62, 64), 2: (2, 8, 17, 26, 34, 43, 52)}
# Of a list of gpredict's, and of the file of one satellite in its folder `satdata`.
_SECTION = re.compile(r"\[(?:\d{1,9}|Satellite)\]", re.ASCII)
_MARK = re.compile(rf"^{_SECTION.pattern}[ \t\r]*$", re.MULTILINE | re.ASCII)
_TICKS_A_DAY = 100_000_000
_DESIGNATOR = re.compile(r"(\d\d)(\d\d)-(\d{3}[A-Z]{1,3})", re.ASCII)


def checksum(line: str) -> int:
    """Return the sum, modulo 10, of a line's columns 1 to 68: a minus counts one, letters nothing."""
    return sum(line[:68].encode("ascii", "replace").translate(_WORTH)) % 10


def regular_set(line1: str, line2: str, name: str) -> Elements | None:
    """Return the elements of two lines that keep every rule to the column; None for any others.

    The numbers are the same, to the last bit, as those of the reader that checks column by column.
    """
    # Both match ASCII only. The sums are taken over all 69 columns, so the digit of the sum counts twice.
    first, second = _LINE_1.fullmatch(line1), _LINE_2.fullmatch(line2)
    if first is None or second is None:
        return None
    field, letter, launch, year, day, fraction, dot, ddot, ddot_power, bstar, bstar_power, *last = (
        first.groups()
    )
    field2, inclination, raan, eccentricity, perigee, anomaly, motion, turns, sum2 = second.groups()
    kind, number, sum1 = last
    if field != field2 or _sum(line1) != _TWICE[sum1] or _sum(line2) != _TWICE[sum2]:
        return None
    start, length = _year(year)
    try:
        catalog_number = int(field) if field[0] < "A" else parse_alpha5(field)
        days = int(day)
        inclination_deg, raan_deg = float(inclination), float(raan)
        perigee_deg, anomaly_deg = float(perigee), float(anomaly)
        rev_day = float(motion)
        set_number, revolutions = int(number), int(turns)
    except ValueError:
        # A blank between digits.
        return None
    if (
        catalog_number is None
        or not 1 <= days <= length
        or inclination_deg > 180.0
        or raan_deg > 360.0
        or perigee_deg > 360.0
        or anomaly_deg > 360.0
        or not 0.0 < rev_day <= MAX_REV_DAY
    ):
        return None
    century = "19" if launch >= "57" else "20"
    return Elements(
        name,
        catalog_number,
        letter,
        f"{century}{launch[:2]}-{launch[2:].rstrip()}" if launch[0] != " " else "",
        Utc((start + days - 1) * DAY_S + float(fraction) * DAY_S),
        inclination_deg,
        raan_deg,
        float("." + eccentricity),
        perigee_deg,
        anomaly_deg,
        rev_day,
        float(dot),
        float(f"{ddot[0]}.{ddot[1:]}") * _POWERS[ddot_power],
        float(f"{bstar[0]}.{bstar[1:]}") * _POWERS[bstar_power],
        int(kind),
        set_number,
        revolutions,
    )


def _sum(line: str) -> int:
    return sum(line.encode().translate(_WORTH)) % 10


@cache
def _year(two_digits: str) -> tuple[int, int]:
    """Return the day number since 1970 of a year's first day, and how many days the year has."""
    year = int(two_digits) + (1900 if two_digits >= "57" else 2000)
    first = date(year, 1, 1).toordinal()
    return first - DAY_ZERO, date(year + 1, 1, 1).toordinal() - first


@dataclass(frozen=True, slots=True)
class ElementLine:
    """One line of a source: its text without line end and trailing blanks, its source and 1-based number."""

    text: str
    source: str = ""
    number: int | None = None

    def columns(self, first: int, last: int) -> str:
        """Return the text of 1-based columns, both included."""
        return self.text[first - 1 : last]

    def error(
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


def _is_meant_so(text: str) -> bool:
    """Tell whether a line looks like one of a set once blanks stand for tabs, and none before it."""
    return is_element_line(text) or (
        (text[0] in " \t" or "\t" in text) and is_element_line(text.lstrip().replace("\t", " "))
    )


def read_tle(text: str, source: str = "") -> Iterator[Elements | ElementsError]:
    """Yield, in the order of the text, the elements of each set or the reason it is refused.

    Name lines are optional and may begin with "0 "; blank lines, `#` comments and CRLF are accepted.
    """
    numbered = enumerate(text.split("\n"), start=1)
    lines = [(n, line) for n, raw in numbered if (line := raw.rstrip()) and line[0] != "#"]
    at = 0
    while at < len(lines):
        name: tuple[int, str] | None = None
        if not _is_meant_so(lines[at][1]):
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
            None if name is None else ElementLine(name[1], source, name[0]),
            [ElementLine(line, source, number) for number, line in group],
        )


def parse_set(line1: str, line2: str, name: str = "") -> Elements:
    """Return the elements of two lines. Raises a subclass of ElementsError."""
    first, second = ElementLine(line1.rstrip()), ElementLine(line2.rstrip())
    return parse_lines(first, second, clean_name(name))


def _group(lines: list[tuple[int, str]], at: int) -> list[tuple[int, str]]:
    """Return the one or two element lines from a place on that make one set."""
    group: list[tuple[int, str]] = []
    while at < len(lines) and len(group) < 2 and _is_meant_so(lines[at][1]):
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


def _set_or_refusal(name: ElementLine | None, group: list[ElementLine]) -> Elements | ElementsError:
    try:
        if not group:
            assert name is not None
            raise name.error(
                FormatError,
                "neither a satellite's name before two element lines, nor an element line: remove it",
            )
        if len(group) == 1:
            _check_blanks(group[0], group[0].text.lstrip()[0])
            _check_length(group[0], group[0].text[0])
            wanted = "2" if group[0].text[0] == "1" else "1"
            raise group[0].error(MissingLineError, f"line {wanted} of this set is missing: {AGAIN}")
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


def parse_lines(first: ElementLine, second: ElementLine, name: str) -> Elements:
    """Return the elements of two lines, every column checked. Raises a subclass of ElementsError."""
    if first.text[:1] == "2" and second.text[:1] == "1":
        raise first.error(SwappedLinesError, "line 2 stands before line 1: put line 1 first", (1, 1))
    wrong_sum: ChecksumError | None = None
    for line, number in ((first, 1), (second, 2)):
        try:
            _check_frame(line, number)
        except ChecksumError as error:
            wrong_sum = wrong_sum or error
    if wrong_sum is None:
        return _elements(first, second, name)
    try:
        _elements(first, second, name)
    except ElementsError as error:
        # A letter among digits says more than the sum that it spoils.
        if type(error) is FieldError and error.line == wrong_sum.line:
            raise
    raise wrong_sum


def _elements(first: ElementLine, second: ElementLine, name: str) -> Elements:
    """Return the elements of two lines whose frames are sound. Raises as `parse_lines`."""
    number = _catalog_number(first)
    if number != _catalog_number(second):
        raise second.error(
            MismatchedLinesError,
            f"line 2 is of object {second.columns(3, 7).strip()}, "
            f"line 1 of object {first.columns(3, 7).strip()}: take both lines from the same set",
            (3, 7),
        )
    return Elements(
        name=name,
        catalog_number=number,
        classification=_classification(first),
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


def _check_frame(line: ElementLine, number: int) -> None:
    """Check what both lines have alike: number, length, blanks between the columns, checksum."""
    _check_blanks(line, number)
    if line.text[:2] != f"{number} ":
        raise line.error(
            MissingLineError, f"line {number} of the set must begin with '{number} ': {AGAIN}", (1, 2)
        )
    _check_length(line, number)
    for column in _SPACES[number]:
        if line.columns(column, column) != " ":
            raise line.error(
                FieldError,
                f"line {number}, column {column} must be blank, not {line.columns(column, column)!r}: "
                f"the columns have shifted, {AGAIN}",
                (column, column),
            )
    _check_sum(line, number)


def _check_blanks(line: ElementLine, number: int | str) -> None:
    """Refuse tabs, which shift columns, and blanks before the line."""
    tab = line.text.find("\t") + 1
    if tab:
        raise line.error(
            FieldError, f"line {number}, column {tab} is a tab: lines have blanks only: {AGAIN}", (tab, tab)
        )
    before = len(line.text) - len(line.text.lstrip(" "))
    if before:
        raise line.error(
            FieldError,
            f"line {number} begins with {before} blanks: remove them",
            (1, before),
        )


def _check_length(line: ElementLine, number: int | str) -> None:
    length = len(line.text)
    if is_element_line(line.text[_LENGTH:].lstrip()):
        raise line.error(
            LineLengthError,
            f"two lines of a set stand on one: begin a new line after column {_LENGTH}",
            (_LENGTH + 1, length),
        )
    if length < _LENGTH:
        raise line.error(
            LineLengthError,
            f"line {number} is cut off: {length} of {_LENGTH} columns: {AGAIN}",
            (length + 1, _LENGTH),
        )
    if length > _LENGTH:
        raise line.error(
            LineLengthError,
            f"line {number} continues after its {_LENGTH} columns: {length} columns: remove what follows",
            (_LENGTH + 1, length),
        )


def _check_sum(line: ElementLine, number: int) -> None:
    """Check the sum, modulo 10, of columns 1 to 68: a minus counts one, all else but digits nothing."""
    given = line.columns(69, 69)
    if given not in "0123456789":
        raise line.error(
            FieldError, f"line {number}, checksum must be a digit, not {given!r}: {AGAIN}", (69, 69)
        )
    total = checksum(line.text)
    if int(given) != total:
        raise line.error(
            ChecksumError,
            f"line {number}, checksum is {given} but its columns add up to {total}: "
            f"a digit is wrong, {AGAIN}",
            (69, 69),
        )


def _catalog_number(line: ElementLine) -> int:
    number = parse_alpha5(line.columns(3, 7))
    if number is None:
        raise line.error(
            FieldError,
            f"catalogue number {line.columns(3, 7)!r} is no number, "
            f"nor an Alpha-5 one (A0000 to Z9999, no I or O): {AGAIN}",
            (3, 7),
        )
    return number


def _classification(line: ElementLine) -> str:
    letter = line.columns(8, 8)
    # A digit here is the last of a number of six, which no TLE has.
    if not re.fullmatch(r"[A-Za-z ]", letter, re.ASCII):
        raise line.error(
            FieldError,
            f"classification {letter!r} is no letter, such as U: the columns have shifted, {AGAIN}",
            (8, 8),
        )
    return letter.strip().upper() or "U"


def _designator(line: ElementLine) -> str:
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


def _epoch(line: ElementLine) -> Utc:
    year_text = line.columns(19, 20)
    day_text = line.columns(21, 32)
    if not re.fullmatch(r"\d\d| \d", year_text, re.ASCII):
        raise line.error(FieldError, f"epoch year {year_text!r} is not two digits: {AGAIN}", (19, 20))
    match = re.fullmatch(r"( *\d+)(\.\d*) *", day_text, re.ASCII)
    if match is None:
        raise line.error(
            FieldError, f"epoch day {day_text!r} is no day of the year with a fraction: {AGAIN}", (21, 32)
        )
    year, day = _full_year(int(year_text)), int(match.group(1))
    first = date(year, 1, 1).toordinal()
    if not 1 <= day <= date(year + 1, 1, 1).toordinal() - first:
        raise line.error(FieldRangeError, f"epoch day {day} is no day of the year {year}: {AGAIN}", (21, 32))
    fraction = float(f"0{match.group(2)}")
    return Utc((first - date(1970, 1, 1).toordinal() + day - 1) * DAY_S + fraction * DAY_S)


def _decimal(line: ElementLine, first: int, last: int, field: str) -> float:
    text = line.columns(first, last)
    if not re.fullmatch(r" *[+-]?\d*\.\d+ *", text, re.ASCII):
        raise line.error(FieldError, f"{field} {text.strip()!r} is no decimal number: {AGAIN}", (first, last))
    return float(text)


def _digits(line: ElementLine, first: int, last: int, field: str) -> str:
    text = line.columns(first, last)
    if not re.fullmatch(r" *\d+", text, re.ASCII):
        raise line.error(FieldError, f"{field} {text.strip()!r} is not all digits: {AGAIN}", (first, last))
    return text.replace(" ", "0")


def _angle(line: ElementLine, first: int, last: int, field: str, most_deg: float) -> float:
    value_deg = _decimal(line, first, last, field)
    if not 0.0 <= value_deg <= most_deg:
        raise line.error(
            FieldRangeError, f"{field} {value_deg} is outside 0 to {most_deg:.0f}°: {AGAIN}", (first, last)
        )
    return value_deg


def _mean_motion(line: ElementLine) -> float:
    value = _decimal(line, 53, 63, "mean motion")
    if not 0.0 < value <= MAX_REV_DAY:
        raise line.error(
            FieldRangeError,
            f"mean motion {value} revolutions a day is no orbit of the Earth (above 0, to {MAX_REV_DAY}): "
            f"{AGAIN}",
            (53, 63),
        )
    return value


def _exponential(line: ElementLine, first: int, last: int, field: str) -> float:
    """Return a number with an implied point before its five digits and a power of ten of one digit."""
    text = line.columns(first, last)
    match = re.fullmatch(r"([ +-])(\d{5})([ +-]\d)|([ +-])( {5}|0{5})( {2}|[+-]\d)", text, re.ASCII)
    if match is None:
        raise line.error(
            FieldError,
            f"{field} {text.strip()!r} is not five digits and a signed power of ten: {AGAIN}",
            (first, last),
        )
    sign, digits, power = match.group(1) or match.group(4), match.group(2) or "0", match.group(3) or "0"
    # The power of ten multiplies, as in SGP4's own reader: "0.12345e-4" may differ in the last bit.
    return float(f"{sign.strip()}.{digits}") * 10.0 ** int(power)


def _ephemeris_type(line: ElementLine) -> int:
    value = _whole(line, 63, 63, "ephemeris type")
    if value not in EPHEMERIS_TYPES:
        raise line.error(FieldRangeError, wrong_theory(value), (63, 63))
    return value


def _whole(line: ElementLine, first: int, last: int, field: str) -> int:
    text = line.columns(first, last)
    if not re.fullmatch(r" *\d* *", text, re.ASCII):
        raise line.error(FieldError, f"{field} {text.strip()!r} is no whole number: {AGAIN}", (first, last))
    return int(text.strip() or "0")


def looks_like_gpredict(text: str) -> bool:
    """Tell whether a text has section lines, [25544] or [Satellite], and element lines behind TLE1=."""
    return "TLE1=" in text and _MARK.search(text) is not None


def read_gpredict(text: str, source: str = "") -> Iterator[Elements | ElementsError]:
    """Yield, in the order of the text, the elements of each section or the reason it is refused."""
    section: ElementLine | None = None
    values: dict[str, ElementLine] = {}
    for number, raw in enumerate(text.split("\n"), start=1):
        line = raw.strip()
        if _SECTION.fullmatch(line):
            if section is not None:
                yield _section_or_refusal(section, values)
            section, values = ElementLine(line, source, number), {}
            continue
        key, _, value = line.partition("=")
        if key in ("NAME", "TLE1", "TLE2"):
            values[key] = ElementLine(value.strip(), source, number)
    if section is not None:
        yield _section_or_refusal(section, values)


def _section_or_refusal(section: ElementLine, values: dict[str, ElementLine]) -> Elements | ElementsError:
    name = clean_name(values["NAME"].text) if "NAME" in values else ""
    try:
        for key in ("TLE1", "TLE2"):
            if key not in values:
                raise section.error(
                    MissingLineError, f"the section has no {key}: update the list in gpredict"
                )
        return parse_lines(values["TLE1"], values["TLE2"], name)
    except ElementsError as error:
        lines = [values[key].columns(3, 7) for key in ("TLE1", "TLE2") if key in values]
        numbers = map(parse_alpha5, (section.text[1:-1], *lines))
        error.name, error.catalog_number = name, next(filter(None, numbers), None)
        return error


def write_tle(elements: Iterable[Elements], names: bool = True) -> str:
    """Return element sets as TLE text, with a name line before each that has a name, if `names`.

    Raises UnwritableError where a TLE cannot hold a value.
    """
    lines: list[str] = []
    for one in elements:
        if names and one.name:
            lines.append(_name_line(one.name))
        lines.extend(format_set(one))
    return "".join(f"{line}\n" for line in lines)


def format_set(elements: Elements) -> tuple[str, str]:
    """Return the two lines of an element set; revolutions count on from 0 after 99999, as in every TLE.

    Raises UnwritableError, naming object and value, for a catalogue number above 339999 (where Alpha-5
    ends), and for any other value that the columns cannot hold.
    """
    number = format_alpha5(elements.catalog_number)
    if number is None:
        why = "Alpha-5 ends at 339999: write an OMM instead"
        raise _unwritable(elements, "catalogue number", elements.catalog_number, why)
    if elements.element_set_number > 9999:
        raise _unwritable(elements, "element set number", elements.element_set_number, "it has four columns")
    ddot, bstar = elements.mean_motion_ddot_rev_day3, elements.bstar_per_earth_radius
    line1 = (
        f"1 {number}{elements.classification} {_designator_columns(elements):8} {_epoch_columns(elements)} "
        f"{_dot(elements)} {_power_columns(elements, ddot, 'second derivative of mean motion')} "
        f"{_power_columns(elements, bstar, 'drag term B*')} "
        f"{elements.ephemeris_type} {elements.element_set_number:4d}"
    )
    line2 = (
        f"2 {number} {elements.inclination_deg:8.4f} {_turn(elements.raan_deg)} {_eccentricity(elements)} "
        f"{_turn(elements.arg_perigee_deg)} {_turn(elements.mean_anomaly_deg)} "
        f"{_motion_columns(elements)}{elements.revolution_number % 100_000:5d}"
    )
    return line1 + str(checksum(line1)), line2 + str(checksum(line2))


def _unwritable(elements: Elements, what: str, value: object, why: str) -> UnwritableError:
    error = UnwritableError(f"{elements.label}: {what} {value} does not fit a TLE: {why}")
    error.name, error.catalog_number = elements.name, elements.catalog_number
    return error


def _name_line(name: str) -> str:
    """Return the name, with "0 " before it where it would not be read as a name otherwise."""
    return f"0 {name}" if name.startswith(("#", "0 ")) or is_element_line(name) else name


def _designator_columns(elements: Elements) -> str:
    match = _DESIGNATOR.fullmatch(elements.designator)
    if match is None:
        if len(elements.designator) <= 8 and elements.designator.isascii():
            return elements.designator
        raise _unwritable(elements, "designator", elements.designator, "it has eight columns")
    century, year, piece = match.groups()
    if century != ("19" if year >= "57" else "20"):
        raise _unwritable(elements, "designator", elements.designator, "its years are 1957 to 2056")
    return f"{year}{piece}"


def _epoch_columns(elements: Elements) -> str:
    jd, fraction = epoch_jd(elements.epoch)
    days, ticks = divmod(round(fraction * _TICKS_A_DAY), _TICKS_A_DAY)
    day = date.fromordinal(DAY_ZERO + int(jd - UNIX_EPOCH_JD) + days)
    if not 1957 <= day.year <= 2056:
        raise _unwritable(elements, "epoch", elements.epoch.isoformat(), "its years are 1957 to 2056")
    return f"{day.year % 100:02d}{day.timetuple().tm_yday:03d}.{ticks:08d}"


def _turn(angle_deg: float) -> str:
    text = f"{angle_deg % 360.0 if angle_deg < 0.0 else angle_deg:8.4f}"
    return "  0.0000" if text == "360.0000" and angle_deg != 360.0 else text


def _eccentricity(elements: Elements) -> str:
    text = f"{elements.eccentricity:.7f}"
    if not text.startswith("0."):
        raise _unwritable(elements, "eccentricity", elements.eccentricity, "it rounds to 1")
    return text[2:]


def _motion_columns(elements: Elements) -> str:
    text = f"{elements.mean_motion_rev_day:11.8f}"
    if not float(text):
        raise _unwritable(elements, "mean motion", elements.mean_motion_rev_day, "it rounds to 0")
    return text


def _dot(elements: Elements) -> str:
    value = elements.mean_motion_dot_rev_day2
    text = f"{abs(value):.8f}"
    if not text.startswith("0."):
        raise _unwritable(elements, "first derivative of mean motion", value, "its columns hold less than 1")
    return ("-" if value < 0.0 else " ") + text[1:]


def _power_columns(elements: Elements, value: float, what: str) -> str:
    """Return five digits after an implied point and a power of ten of one digit."""
    digits, power = f"{abs(value):.4e}".split("e")
    digits, exponent = digits.replace(".", ""), int(power) + 1
    if exponent < -9:
        digits, exponent = f"{round(abs(value) * 1e14):05d}", -9
    if int(digits) == 0:
        return " 00000+0"
    if exponent > 9:
        raise _unwritable(elements, what, value, "its power of ten has one digit")
    return f"{'-' if value < 0.0 else ' '}{digits}{exponent:+d}"
