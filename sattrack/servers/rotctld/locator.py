"""Longitudes, latitudes, locators and great circles: what rotctld reckons for its clients.

Rounding, and what becomes of strange values, are those of Hamlib 4.5.4. The Maidenhead locator: IARU Region 1
VHF Managers Handbook, with a fifth pair from A to X.
"""

from __future__ import annotations

import math

PAIRS = (18, 10, 24, 10, 24, 10)
"""How many characters may stand in each pair of a locator: letters where they are not ten."""
GUARD_DEG = 1e-6
KM_A_DEGREE = 111.2
ONE_PLACE = 0.999999999999999
ANTIPODES = -0.999999
NEAR_POLE_DEG = 89.999999999
LEAST_INTEGER = -(2**31)


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
