"""What rotctld computes for its clients without the mount: the answers of nine commands.

Numbers are read as C's `sscanf` reads them (ISO/IEC 9899:2011, 7.21.6.2, as glibc has it): the beginning that
is a number is taken, with an exponent that lacks its digits as one of 0; what follows is not looked at.
Rounding and the treatment of strange values are those of Hamlib 4.5.4. The Maidenhead locator: IARU Region 1
VHF Managers Handbook, with a fifth pair from A to X.
"""

from __future__ import annotations

import math
import re
import struct
from typing import TYPE_CHECKING

from sattrack.servers.rotctld.reader import given, need, words_of

if TYPE_CHECKING:
    from collections.abc import Callable

    from sattrack.servers.rotctld.reader import Request

_SPACES = " \t\n\v\f\r"
_INTEGER = re.compile(r"[+-]?[0-9]+")
_HEX = re.compile(r"([+-]?)0[xX]([0-9a-fA-F]*)(?:\.([0-9a-fA-F]*))?(?:[pP]([+-]?[0-9]*))?")
_DECIMAL = re.compile(r"([+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+))(?:[eE]([+-]?[0-9]*))?")
_NAMED = re.compile(r"([+-]?)(inf(?:i[a-z]*)?|nan)", re.IGNORECASE)
MOST_DIGITS = 300
PAIRS = (18, 10, 24, 10, 24, 10)
"""How many characters may stand in each pair of a locator: letters where they are not ten."""
GUARD_DEG = 1e-6
KM_A_DEGREE = 111.2
ONE_PLACE = 0.999999999999999
ANTIPODES = -0.999999
NEAR_POLE_DEG = 89.999999999
LEAST_INTEGER = -(2**31)


def scan_integer(text: str) -> int | None:
    """Return the whole number that a text begins with, as `%d` reads it; None where there is none."""
    found = _INTEGER.match(text.lstrip(_SPACES))
    return None if found is None or len(found.group()) > MOST_DIGITS else int(found.group())


def scan_double(text: str) -> float | None:
    """Return the number that a text begins with, as `%lf` reads it; None where there is none.

    Hexadecimal numbers, infinities and not-a-numbers are numbers too.
    """
    text = text.lstrip(_SPACES)
    named = _NAMED.match(text)
    if named is not None:
        sign, word = named.groups()
        if word.lower() not in {"inf", "infinity", "nan"} and not word.lower().startswith("infinity"):
            return None
        return float(sign + word[:3])
    if re.match(r"[+-]?0[xX]", text):
        return _hexadecimal(text)
    found = _DECIMAL.match(text)
    if found is None:
        return None
    mantissa, exponent = found.groups()
    return float(mantissa if _lacks_digits(exponent) else f"{mantissa}e{exponent}")


def _hexadecimal(text: str) -> float | None:
    found = _HEX.match(text)
    if found is None:
        return None
    sign, whole, fraction, exponent = found.groups()
    if not (whole or fraction):
        return None
    power = "0" if _lacks_digits(exponent) else exponent
    try:
        return float.fromhex(f"{sign}0x{whole or '0'}.{fraction or '0'}p{power}")
    except OverflowError:
        return float(f"{sign}inf")


def _lacks_digits(exponent: str | None) -> bool:
    return not (exponent or "").strip("+-")


def scan_single(text: str) -> float | None:
    """Return the number that a text begins with, as `%f` reads it: rounded to single precision."""
    value = scan_double(text)
    if value is None:
        return None
    try:
        (single,) = struct.unpack("f", struct.pack("f", value))
    except OverflowError:
        single = float("inf") if value > 0 else float("-inf")
    return float(single)


class LocatorError(Exception):
    """A value that is out of range, or no locator."""


def _whole(value: float) -> int:
    """Return the whole part as a C `int`; what has none is the least of them, as on x86."""
    if not math.isfinite(value) or abs(value) >= 2**31:
        return LEAST_INTEGER
    return int(value)


def to_locator(longitude_deg: float, latitude_deg: float, pairs: int) -> str:
    """Return the locator of a place, of 1 to 6 pairs; angles beyond a turn wrap. Raises LocatorError."""
    if not 1 <= pairs <= len(PAIRS):
        raise LocatorError(f"{pairs} pairs")
    halves = []
    for angle_deg in (longitude_deg / 2.0, latitude_deg):
        if not math.isfinite(angle_deg):
            raise LocatorError("no place")
        left, square, characters = math.fmod(angle_deg + 270.0 + GUARD_DEG, 180.0), 180.0, []
        for size in PAIRS[:pairs]:
            square /= size
            value = int(left / square)
            left -= square * value
            characters.append(chr(value + ord("0" if size == 10 else "A")))
        halves.append(characters)
    return "".join(first + second for first, second in zip(*halves, strict=True))


def from_locator(locator: str) -> tuple[float, float]:
    """Return longitude and latitude of a locator's middle, degrees; an odd last character is not looked at.

    Raises LocatorError.
    """
    pairs = min(len(locator) // 2, len(PAIRS))
    if pairs < 1:
        raise LocatorError(locator)
    angles = []
    for first in (0, 1):
        angle_deg, divisions = -90.0, 1
        for pair in range(pairs):
            character, size = locator[2 * pair + first], PAIRS[pair]
            base = "0" if size == 10 else "A" if "A" <= character <= "Z" else "a"
            value = ord(character) - ord(base)
            if not 0 <= value < size:
                raise LocatorError(locator)
            divisions *= size
            angle_deg += value * 180.0 / divisions
        angles.append(angle_deg + 90.0 / divisions)
    return angles[0] * 2.0, angles[1]


def from_sexagesimal(degrees: int, minutes: float, seconds: float, negative: bool) -> float:
    """Return degrees of degrees, minutes and seconds, whose own signs do not count."""
    total = abs(degrees) + abs(minutes) / 60.0 + abs(seconds) / 3600.0
    return -total if negative else total


def to_sexagesimal(angle_deg: float) -> tuple[int, int, float, bool]:
    """Return degrees, minutes, seconds, and whether it is south or west, of an angle wrapped to ±180."""
    if math.isinf(angle_deg):
        angle_deg = math.nan
    half = 180.0 if angle_deg >= 0.0 else -180.0
    wrapped = math.fmod(angle_deg + half, 360.0) - half
    negative = wrapped < 0.0 and wrapped != -180.0
    left = abs(wrapped)
    degrees = _whole(left)
    left = 60.0 * (left - degrees)
    minutes = _whole(left)
    return degrees, minutes, 60.0 * (left - minutes), negative


def great_circle(lon1: float, lat1: float, lon2: float, lat2: float) -> tuple[float, float]:
    """Return distance (km, of 111.2 km a degree) and bearing (whole degrees) from one place to another.

    Places that are one, or opposite each other, have bearing 0. Raises LocatorError beyond 180° or 90°.
    """
    if any(abs(lat) > 90.0 for lat in (lat1, lat2)) or any(abs(lon) > 180.0 for lon in (lon1, lon2)):
        raise LocatorError("no place on the Earth")
    phi1, phi2 = (
        math.radians(math.copysign(NEAR_POLE_DEG, lat) if abs(lat) == 90.0 else lat) for lat in (lat1, lat2)
    )
    apart = math.radians(lon2) - math.radians(lon1)
    cosine = math.sin(phi1) * math.sin(phi2) + math.cos(phi1) * math.cos(phi2) * math.cos(apart)
    if math.isnan(cosine):
        return math.nan, math.nan
    if cosine > ONE_PLACE:
        return 0.0, 0.0
    if cosine < ANTIPODES:
        return 180.0 * KM_A_DEGREE, 0.0
    east = math.sin(apart) * math.cos(phi2)
    north = math.cos(phi1) * math.sin(phi2) - math.sin(phi1) * math.cos(phi2) * math.cos(apart)
    bearing_deg = math.fmod(360.0 + math.degrees(math.atan2(east, north)), 360.0)
    return KM_A_DEGREE * math.degrees(math.acos(cosine)), float(math.floor(bearing_deg + 0.5))


def long_way_bearing(bearing_deg: float) -> float:
    """Return the opposite bearing. Raises LocatorError outside 0 to 360."""
    if not 0.0 <= bearing_deg <= 360.0:
        raise LocatorError("no bearing")
    return bearing_deg + 180.0 if bearing_deg < 180.0 else bearing_deg - 180.0


def long_way_km(distance_km: float) -> float:
    """Return the distance the other way round the Earth."""
    return 360.0 * KM_A_DEGREE - distance_km


def _to_locator(request: Request) -> str:
    first, second, third = words_of(request)
    longitude, latitude = need(scan_double(first)), need(scan_double(second))
    return given(request, to_locator(longitude, latitude, int(need(scan_integer(third)) / 2)))


def _from_locator(request: Request) -> str:
    longitude, latitude = from_locator(request.words[0])
    return given(request, f"{longitude:f}", f"{latitude:f}")


def _from_seconds(request: Request) -> str:
    first, second, third, fourth = words_of(request)
    degrees, minutes = need(scan_integer(first)), need(scan_integer(second))
    seconds, west = need(scan_double(third)), need(scan_integer(fourth)) == 1
    return given(request, f"{from_sexagesimal(degrees, minutes, seconds, west):f}")


def _to_seconds(request: Request) -> str:
    degrees, minutes, seconds, west = to_sexagesimal(need(scan_double(request.words[0])))
    return given(request, str(degrees), str(minutes), f"{seconds:f}", str(int(west)))


def _from_minutes(request: Request) -> str:
    """Hamlib takes the flag for seconds, and so is it here."""
    first, second, third = words_of(request)
    degrees, minutes = need(scan_integer(first)), need(scan_double(second))
    total = abs(degrees) + abs(minutes) / 60.0 + need(scan_integer(third)) / 3600.0
    return given(request, f"{total:f}")


def _to_minutes(request: Request) -> str:
    degrees, minutes, seconds, west = to_sexagesimal(need(scan_double(request.words[0])))
    return given(request, str(degrees), f"{minutes + seconds / 60.0:f}", str(int(west)))


def _great_circle(request: Request) -> str:
    lon1, lat1, lon2, lat2 = (need(scan_double(word)) for word in words_of(request))
    distance_km, bearing_deg = great_circle(lon1, lat1, lon2, lat2)
    return given(request, f"{distance_km:f}", f"{bearing_deg:f}")


def _long_bearing(request: Request) -> str:
    return given(request, f"{long_way_bearing(need(scan_double(request.words[0]))):f}")


def _long_distance(request: Request) -> str:
    return given(request, f"{long_way_km(need(scan_double(request.words[0]))):f}")


CALCULATIONS: dict[str, Callable[[Request], str]] = {
    "lonlat2loc": _to_locator,
    "loc2lonlat": _from_locator,
    "dms2dec": _from_seconds,
    "dec2dms": _to_seconds,
    "dmmm2dec": _from_minutes,
    "dec2dmmm": _to_minutes,
    "qrb": _great_circle,
    "a_sp2a_lp": _long_bearing,
    "d_sp2d_lp": _long_distance,
}
"""Each by its command's name; they raise FailedError and LocatorError."""
