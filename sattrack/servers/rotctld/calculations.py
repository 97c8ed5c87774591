"""What rotctld reckons for its clients without the mount: the answers of nine commands."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sattrack.servers.rotctld.locator import (
    from_locator,
    from_sexagesimal,
    great_circle,
    long_way_bearing,
    long_way_km,
    to_locator,
    to_sexagesimal,
)
from sattrack.servers.rotctld.numbers import scan_double, scan_integer
from sattrack.servers.rotctld.wording import given, need, words_of

if TYPE_CHECKING:
    from collections.abc import Callable

    from sattrack.servers.rotctld.reader import Request


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
