"""Where something flies that tells its place and velocity now and then: a path that each fix bends on."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import erfa
import numpy as np

from tle.ephemeris import Frame, Interpolation, Segment, TableEphemeris
from tle.formats.track_table import curve
from tle.instants import Utc, leaps_s
from tle.site import EARTH_RADIUS_KM, FLATTENING

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

FIXES = "fixes"
"""How the provenance of such a path begins."""
PREDICTED_S = 60.0
"""How long after a fix it is followed."""
_MARGIN_S = 120.0
"""How much further there are places, for those who look ahead."""
BLENDED_S = 2.0
"""How long it takes from the path that was predicted before to the one by a new fix."""
_STEP_S = 5.0
_KEPT_S = 20.0


class Fix(NamedTuple):
    """A place (WGS 84) and a velocity against the ground at an instant, POSIX seconds of UTC."""

    utc_s: float
    lat_deg: float
    lon_deg: float
    height_m: float
    east_m_s: float
    north_m_s: float
    up_m_s: float


def path_of(name: str, fix: Fix, before: TableEphemeris | None = None, now_s: float = 0.0) -> TableEphemeris:
    """Return the path by a fix, for PREDICTED_S and a margin, from now on bent onto it from the path before.

    It goes on at the same velocity north, east and up. Neither place nor rate jumps.
    """
    ahead = _ahead(fix)
    segments = [ahead]
    if before is not None:
        segments = _bent(before, ahead, now_s)
    return TableEphemeris(name, segments, f"{FIXES} of place and velocity", epoch=Utc(fix.utc_s))


def _ahead(fix: Fix) -> Segment:
    since = np.arange(-4.0 * _STEP_S, PREDICTED_S + _MARGIN_S, _STEP_S)
    lat = math.radians(fix.lat_deg)
    squared = FLATTENING * (2.0 - FLATTENING)
    bend = 1.0 - squared * math.sin(lat) ** 2
    across_m = 1000.0 * EARTH_RADIUS_KM / math.sqrt(bend)
    along_m = across_m * (1.0 - squared) / bend
    north = lat + fix.north_m_s * since / (along_m + fix.height_m)
    east = math.radians(fix.lon_deg) + fix.east_m_s * since / ((across_m + fix.height_m) * math.cos(lat))
    places = erfa.gd2gc(1, east, north, fix.height_m + fix.up_m_s * since) / 1000.0
    zero_s = fix.utc_s + float(leaps_s(fix.utc_s))
    return curve(zero_s, since, places, Frame("GROUND", "WGS 84"), 1)


def _bent(before: TableEphemeris, ahead: Segment, now_s: float) -> list[Segment]:
    """Return the path before until now, a piece that leads over, and the path ahead."""
    tai_s = now_s + float(leaps_s(now_s))
    past = [
        replace(one, use_s=(one.use_s[0], min(one.use_s[1], tai_s - one.zero_s)))
        for one in before.segments
        if one.zero_s + one.use_s[1] > tai_s - _KEPT_S and one.zero_s + one.use_s[0] < tai_s
    ]
    if not past:
        return [ahead]
    last = past[-1]
    ends = [last.native(tai_s - last.zero_s), ahead.native(tai_s + BLENDED_S - ahead.zero_s)]
    since = np.array([0.0, BLENDED_S])
    place, velocity = (np.array([end[k : k + 3] for end in ends]) for k in (0, 3))
    over = Segment(
        tai_s, since, place, velocity, ahead.frame, Interpolation(2, True), (0.0, BLENDED_S), why="fixes"
    )
    from_s = tai_s + BLENDED_S - ahead.zero_s
    return [*past, over, replace(ahead, use_s=(from_s, ahead.use_s[1]))]
