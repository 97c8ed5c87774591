"""The quick way through two lines that keep every column's rule, as nearly all in a catalogue do.

Whatever is unusual is left to the reader that looks at one column after the other and can say what is wrong.
"""

from __future__ import annotations

import re
from datetime import date
from functools import cache

from tle.elements import Elements, parse_alpha5
from tle.formats.omm import MAX_REV_DAY
from tle.instants import DAY_S, Utc

_DAY_ZERO = date(1970, 1, 1).toordinal()
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
    return first - _DAY_ZERO, date(year + 1, 1, 1).toordinal() - first
