"""Elements to two-line and three-line sets, each value rounded to what its columns hold."""

from __future__ import annotations

import re
from datetime import date
from typing import TYPE_CHECKING

from tle.elements import Elements, epoch_jd, format_alpha5
from tle.errors import UnwritableError
from tle.formats.tle import is_element_line
from tle.formats.tle_regular import checksum
from tle.instants import UNIX_EPOCH_JD

if TYPE_CHECKING:
    from collections.abc import Iterable

_DAY_ZERO = date(1970, 1, 1).toordinal()
_TICKS_A_DAY = 100_000_000
_DESIGNATOR = re.compile(r"(\d\d)(\d\d)-(\d{3}[A-Z]{1,3})", re.ASCII)


def write(elements: Iterable[Elements], names: bool = True) -> str:
    """Return element sets as TLE text, with a name line before each that has a name, unless told not to.

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
    line1 = (
        f"1 {number}{elements.classification} {_designator(elements):8} {_epoch(elements)} {_dot(elements)} "
        f"{_exponential(elements, elements.mean_motion_ddot_rev_day3, 'second derivative of mean motion')} "
        f"{_exponential(elements, elements.bstar_per_earth_radius, 'drag term B*')} "
        f"{elements.ephemeris_type} {elements.element_set_number:4d}"
    )
    line2 = (
        f"2 {number} {elements.inclination_deg:8.4f} {_turn(elements.raan_deg)} {_eccentricity(elements)} "
        f"{_turn(elements.arg_perigee_deg)} {_turn(elements.mean_anomaly_deg)} "
        f"{_mean_motion(elements)}{elements.revolution_number % 100_000:5d}"
    )
    return line1 + str(checksum(line1)), line2 + str(checksum(line2))


def _unwritable(elements: Elements, what: str, value: object, why: str) -> UnwritableError:
    error = UnwritableError(f"{elements.label}: {what} {value} does not fit a TLE: {why}")
    error.name, error.catalog_number = elements.name, elements.catalog_number
    return error


def _name_line(name: str) -> str:
    """Return the name, with "0 " before it where it would not be read as a name otherwise."""
    return f"0 {name}" if name.startswith(("#", "0 ")) or is_element_line(name) else name


def _designator(elements: Elements) -> str:
    match = _DESIGNATOR.fullmatch(elements.designator)
    if match is None:
        if len(elements.designator) <= 8 and elements.designator.isascii():
            return elements.designator
        raise _unwritable(elements, "designator", elements.designator, "it has eight columns")
    century, year, piece = match.groups()
    if century != ("19" if year >= "57" else "20"):
        raise _unwritable(elements, "designator", elements.designator, "its years are 1957 to 2056")
    return f"{year}{piece}"


def _epoch(elements: Elements) -> str:
    jd, fraction = epoch_jd(elements.epoch)
    days, ticks = divmod(round(fraction * _TICKS_A_DAY), _TICKS_A_DAY)
    day = date.fromordinal(_DAY_ZERO + int(jd - UNIX_EPOCH_JD) + days)
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


def _mean_motion(elements: Elements) -> str:
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


def _exponential(elements: Elements, value: float, what: str) -> str:
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
