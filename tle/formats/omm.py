"""What an orbit mean-elements message (OMM) says in any notation: one table of its keywords.

Keywords, units and what is required follow CCSDS 502.0-B-3 (tables 4-1 to 4-3) for elements of SGP4.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from datetime import date
from typing import TYPE_CHECKING, Any

from tle.elements import Elements, parse_alpha5
from tle.errors import ElementsError, FieldError, FieldRangeError, MissingFieldError, printable
from tle.instants import DAY_S, Utc

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

# A circular orbit of the Earth's own radius takes 84.5 minutes: nothing goes round faster.
MAX_REV_DAY = 17.05
MAX_CATALOG_NUMBER = 999_999_999
FIRST_EPOCH = Utc.parse("1957-10-04T00:00:00Z")
END_OF_EPOCHS = Utc.parse("2057-01-01T00:00:00Z")
# 0 is what all public sets say, 1 to 3 are older models of the same family; 4 and on are other theories.
EPHEMERIS_TYPES = range(4)
AGAIN = "copy the set again from its source"
DAY_ZERO = date(1970, 1, 1).toordinal()
_BELOW_ONE = math.nextafter(1.0, 0.0)
_LONGEST_NUMBER = 64
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,3})?", re.ASCII)
_EPOCH = re.compile(r"(\d{4})-(?:(\d\d)-(\d\d)|(\d{3}))T(\d\d):(\d\d):(\d\d)(?:\.(\d{0,18}))?Z?", re.ASCII)


@dataclass(frozen=True, slots=True)
class OmmField:
    """One keyword of an OMM, the attribute of `Elements` that it fills, and which values are possible.

    `default` is taken where the keyword is absent or empty; None where it is required. `unit` is how the
    standard writes it. Numbers lie from `least` to `most`.
    """

    keyword: str
    attribute: str
    meaning: str
    kind: str = "number"
    unit: str = ""
    least: float = -math.inf
    most: float = math.inf
    default: str | float | None = None


FIELDS = (
    OmmField("OBJECT_NAME", "name", "name", "text", default=""),
    OmmField("OBJECT_ID", "designator", "international designator", "designator", default=""),
    OmmField("EPOCH", "epoch", "epoch, UTC", "epoch"),
    OmmField(
        "MEAN_MOTION", "mean_motion_rev_day", "mean motion", unit="rev/day", least=1e-9, most=MAX_REV_DAY
    ),
    OmmField("ECCENTRICITY", "eccentricity", "eccentricity", least=0.0, most=_BELOW_ONE),
    OmmField("INCLINATION", "inclination_deg", "inclination", unit="deg", least=0.0, most=180.0),
    OmmField(
        "RA_OF_ASC_NODE", "raan_deg", "right ascension of the node", unit="deg", least=-360.0, most=360.0
    ),
    OmmField(
        "ARG_OF_PERICENTER", "arg_perigee_deg", "argument of perigee", unit="deg", least=-360.0, most=360.0
    ),
    OmmField("MEAN_ANOMALY", "mean_anomaly_deg", "mean anomaly", unit="deg", least=-360.0, most=360.0),
    OmmField("EPHEMERIS_TYPE", "ephemeris_type", "ephemeris type", "whole", most=9, default=0),
    OmmField("CLASSIFICATION_TYPE", "classification", "classification", "letter", default="U"),
    OmmField("NORAD_CAT_ID", "catalog_number", "catalogue number", "catalogue", most=MAX_CATALOG_NUMBER),
    OmmField("ELEMENT_SET_NO", "element_set_number", "element set number", "whole", most=99_999, default=0),
    OmmField("REV_AT_EPOCH", "revolution_number", "revolution number", "whole", most=9_999_999, default=0),
    OmmField("BSTAR", "bstar_per_earth_radius", "drag term B*", unit="1/ER"),
    # SGP4 does not use these two: the standard asks for them with the older SGP only.
    OmmField(
        "MEAN_MOTION_DOT",
        "mean_motion_dot_rev_day2",
        "half the first derivative of mean motion",
        unit="rev/day**2",
        default=0.0,
    ),
    OmmField(
        "MEAN_MOTION_DDOT",
        "mean_motion_ddot_rev_day3",
        "a sixth of the second derivative of mean motion",
        unit="rev/day**3",
        default=0.0,
    ),
)
UNITS = {field.keyword: field.unit for field in FIELDS if field.unit}
# What SGP4's elements refer to; anything else under these keywords would be read wrongly.
METADATA = {
    "CENTER_NAME": ("EARTH",),
    "REF_FRAME": ("TEME", "TEMEOFDATE"),
    "TIME_SYSTEM": ("UTC",),
    "MEAN_ELEMENT_THEORY": ("SGP4", "SGP/SGP4"),
}
KEYWORDS = frozenset(field.keyword for field in FIELDS) | METADATA.keys()


@dataclass(frozen=True, slots=True)
class TextPlace:
    """Where a set stands: its source and 1-based line."""

    source: str = ""
    line: int | None = None

    def error(self, kind: type[ElementsError], reason: str) -> ElementsError:
        """Return an exception about this place."""
        return kind(reason, source=self.source, line=self.line)


def elements_of(values: Mapping[str, object], place: TextPlace) -> Elements:
    """Return the elements that keywords and their values say; values are text or, from JSON, numbers.

    Raises a subclass of ElementsError that names keyword and value, with name and number of the set.
    """
    try:
        for keyword, allowed in METADATA.items():
            if keyword in values:
                _check_metadata(keyword, values[keyword], allowed, place)
        read = {f.attribute: _READERS[f.kind](f, _given(f, values, place), place) for f in FIELDS}
        if read["ephemeris_type"] not in EPHEMERIS_TYPES:
            raise place.error(FieldRangeError, wrong_theory(read["ephemeris_type"]))
        return Elements(**read)
    except ElementsError as error:
        raise named(error, values) from None


def set_or_refusal(
    values: Mapping[str, object], place: TextPlace, wrong: ElementsError | None = None
) -> Elements | ElementsError:
    """Return the elements that keywords and values say, or the reason they are refused: `wrong`, if given."""
    if wrong is not None:
        return named(wrong, values)
    try:
        return elements_of(values, place)
    except ElementsError as error:
        return error


def named(error: ElementsError, values: Mapping[str, object]) -> ElementsError:
    """Return an error that knows name and catalogue number of its set, as far as those can be read."""
    name, number = values.get("OBJECT_NAME"), values.get("NORAD_CAT_ID")
    error.name = _clean(name) if isinstance(name, str) else ""
    error.catalog_number = _number_of(number)
    return error


def wrong_theory(ephemeris_type: int) -> str:
    """Return what to say of elements that belong to another theory."""
    return (
        f"ephemeris type {ephemeris_type} stands for elements of another theory than SGP4"
        f"{' (SGP4-XP)' if ephemeris_type == 4 else ''}: get the set for SGP4"
    )


def quoted(value: object) -> str:
    """Return a value from a source as a message shows it: one short line."""
    text = value if isinstance(value, str) else str(value)
    return repr(printable(text if len(text) <= 40 else text[:37] + "..."))


def keyword_texts(elements: Elements) -> dict[str, str]:
    """Return an element set as OMM keywords and texts, in the table's order; floats as short as is exact."""
    return {keyword: str(value) for keyword, value in keyword_values(elements).items()}


def keyword_values(elements: Elements) -> dict[str, str | float | int]:
    """Return an element set as OMM keywords and values, in the table's order."""
    values = {field.keyword: getattr(elements, field.attribute) for field in FIELDS}
    values["EPOCH"] = elements.epoch.isoformat().removesuffix("Z")
    return values


def _check_metadata(keyword: str, value: object, allowed: tuple[str, ...], place: TextPlace) -> None:
    text = str(value).strip().upper()
    if text and text not in allowed:
        raise place.error(
            FieldError, f"{keyword} is {quoted(value)}: only {' or '.join(allowed)} can be followed with SGP4"
        )


def _given(field: OmmField, values: Mapping[str, object], place: TextPlace) -> object:
    value = values.get(field.keyword)
    if isinstance(value, str):
        value = value.strip()
    if value is None or value == "":
        value = field.default
    if value is None:
        raise place.error(MissingFieldError, f"{field.keyword} ({field.meaning}) is missing: {AGAIN}")
    return value


def _number(field: OmmField, value: object, place: TextPlace) -> float:
    if isinstance(value, str):
        if len(value) > _LONGEST_NUMBER or not _NUMBER.fullmatch(value):
            raise _no_number(field, value, place)
        number = float(value)
    elif isinstance(value, int | float) and not isinstance(value, bool):
        try:
            number = float(value)
        except OverflowError:
            raise _no_number(field, "a number of more than 308 digits", place) from None
    else:
        raise _no_number(field, value, place)
    if not (field.least <= number <= field.most and math.isfinite(number)):
        raise _out_of_range(field, value, place)
    return number


def _whole(field: OmmField, value: object, place: TextPlace) -> int:
    # A float is exact below 2**53, far above every whole number allowed here.
    number = _number(field, value, place)
    if number < 0.0 or not number.is_integer():
        raise place.error(FieldError, f"{field.keyword} {quoted(value)} is no whole number: {AGAIN}")
    return int(number)


def _catalogue(field: OmmField, value: object, place: TextPlace) -> int:
    if isinstance(value, str):
        number = parse_alpha5(value)
        if number is None:
            raise place.error(
                FieldError,
                f"{field.keyword} {quoted(value)} is no number, nor an Alpha-5 one "
                f"(A0000 to Z9999, no I or O): {AGAIN}",
            )
        value = number
    return _whole(field, value, place)


def _letter(field: OmmField, value: object, place: TextPlace) -> str:
    if isinstance(value, str) and re.fullmatch(r"[A-Z]", value, re.ASCII):
        return value
    raise place.error(FieldError, f"{field.keyword} {quoted(value)} is no capital letter, such as U: {AGAIN}")


def _text(field: OmmField, value: object, place: TextPlace) -> str:
    if isinstance(value, str):
        return _clean(value)
    raise place.error(FieldError, f"{field.keyword} {quoted(value)} is no text: {AGAIN}")


def _designator(field: OmmField, value: object, place: TextPlace) -> str:
    text = _text(field, value, place)
    return "" if text.upper() in ("UNKNOWN", "NONE", "N/A") else text


def _epoch(field: OmmField, value: object, place: TextPlace) -> Utc:
    match = _EPOCH.fullmatch(value) if isinstance(value, str) else None
    if match is None:
        raise place.error(
            FieldError,
            f"{field.keyword} {quoted(value)} is no time such as 2026-10-02T00:19:52.567968: {AGAIN}",
        )
    year, month, day, day_of_year, hour, minute, second, fraction = match.groups()
    try:
        if day_of_year is None:
            days = date(int(year), int(month), int(day)).toordinal()
        else:
            days = date(int(year), 1, 1).toordinal() + int(day_of_year) - 1
            if date.fromordinal(days).year != int(year):
                raise ValueError
    except ValueError:
        raise place.error(FieldRangeError, f"{field.keyword} {quoted(value)} is no day: {AGAIN}") from None
    leap = (hour, minute, second) == ("23", "59", "60")
    if int(hour) > 23 or int(minute) > 59 or (int(second) > 59 and not leap):
        raise place.error(FieldRangeError, f"{field.keyword} {quoted(value)} is no time of day: {AGAIN}")
    second_of_day = int(hour) * 3600 + int(minute) * 60 + int(second) + float(f"0.{fraction or 0}")
    epoch = Utc((days - DAY_ZERO) * DAY_S + second_of_day)
    if not FIRST_EPOCH <= epoch < END_OF_EPOCHS:
        raise place.error(
            FieldRangeError, f"{field.keyword} {quoted(value)} is outside 1957 to 2056: {AGAIN}"
        )
    return epoch


def _no_number(field: OmmField, value: object, place: TextPlace) -> ElementsError:
    return place.error(FieldError, f"{field.keyword} {quoted(value)} is no number: {AGAIN}")


def _out_of_range(field: OmmField, value: object, place: TextPlace) -> ElementsError:
    if math.isinf(field.most):
        return _no_number(field, value, place)
    least, most = (0.0 if math.isinf(field.least) else field.least), field.most
    span = f"{round(least, 6):.10g} to {most:.10g} {field.unit}".rstrip()
    if most == _BELOW_ONE:
        span = "0 to below 1"
    return place.error(FieldRangeError, f"{field.keyword} {quoted(value)} is outside {span}: {AGAIN}")


def _number_of(value: object) -> int | None:
    if isinstance(value, str):
        return parse_alpha5(value.strip())
    if isinstance(value, int) and not isinstance(value, bool) and 0 <= value <= MAX_CATALOG_NUMBER:
        return value
    return None


def _clean(text: str) -> str:
    text = text.strip()
    return text if text.isprintable() else printable(text)


_READERS: dict[str, Callable[[OmmField, object, TextPlace], Any]] = {
    "number": _number,
    "whole": _whole,
    "catalogue": _catalogue,
    "letter": _letter,
    "text": _text,
    "designator": _designator,
    "epoch": _epoch,
}
