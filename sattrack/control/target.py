"""A satellite as the target that is followed: its place at any instant, and the error of a pointing. Pure."""

from __future__ import annotations

import math
from collections import deque
from typing import TYPE_CHECKING

import msgspec

from sattrack.control.detour import Passage
from sattrack.control.following import TargetSpan
from sattrack.core.angles import wrap180
from sattrack.views.run import ErrorView

if TYPE_CHECKING:
    from collections.abc import Callable

    from sattrack.control.detour import Detour
    from sattrack.control.following import Pair
    from tle.direction import Direction

SAME_INSTANT_S = 0.0005
FORETOLD_KEPT = 12


class TargetState(msgspec.Struct, frozen=True, gc=False):
    """Where the satellite is fed, degrees, and how fast that changes, degrees a second."""

    ra_deg: float
    dec_deg: float
    ra_rate_deg_s: float
    dec_rate_deg_s: float

    @classmethod
    def at(cls, known: Direction, late_s: float = 0.0) -> TargetState:
        """Return a known direction's target, so much later that its rates make up for that."""
        ra_rate, dec_rate = float(known.ra_rate_deg_s), float(known.dec_rate_deg_s)
        ra, dec = float(known.ra_deg), float(known.dec_deg)
        return cls(ra + ra_rate * late_s, dec + dec_rate * late_s, ra_rate, dec_rate)


def sky_error(utc_s: float, ra_deg: float, dec_deg: float, target: Direction | TargetState) -> ErrorView:
    """Return the error on the sky of a pointing against a target's direction at the same instant."""
    target_dec = float(target.dec_deg)
    cos_dec, cos_target = math.cos(math.radians(dec_deg)), math.cos(math.radians(target_dec))
    ra_gap = wrap180(ra_deg - float(target.ra_deg))
    dec_gap = dec_deg - target_dec
    half_ra, half_dec = math.radians(ra_gap) / 2.0, math.radians(dec_gap) / 2.0
    # Haversine: exact for any separation and without loss for the smallest.
    chord = math.sin(half_dec) ** 2 + cos_dec * cos_target * math.sin(half_ra) ** 2
    total = 2.0 * math.degrees(math.asin(min(1.0, math.sqrt(chord)))) * 3600.0
    east, north = ra_gap * cos_dec * 3600.0, dec_gap * 3600.0
    rate_east = float(target.ra_rate_deg_s) * cos_target
    rate_north = float(target.dec_rate_deg_s)
    speed = math.hypot(rate_east, rate_north)
    along = (east * rate_east + north * rate_north) / speed if speed else 0.0
    # Along û × m̂, with û towards the satellite: for a northward motion overhead that is west.
    across = (north * rate_east - east * rate_north) / speed if speed else 0.0
    return ErrorView(utc_s, total, east, north, along, across)


class SatelliteTarget:
    """A satellite by its direction at an instant, led round the celestial pole by detours."""

    def __init__(self, direction_at: Callable[[float], Direction], detours: tuple[Detour, ...]) -> None:
        self._direction_at = direction_at
        self.passage = Passage(detours) if detours else None
        """The detours that are ahead."""
        self._foretold: deque[tuple[float, Direction]] = deque(maxlen=FORETOLD_KEPT)
        """The target at the ends of the intervals that the last commands are for."""

    def forget(self) -> None:
        """Forget what was foretold: offsets or elements have changed."""
        self._foretold.clear()

    def state(self, utc_s: float) -> TargetState:
        """Return the target at an instant: that of an interval's end, where it is the same.

        Commands end, and samples are taken, at the loop's turns, foretold a little differently each time.
        Over SAME_INSTANT_S the target's rate makes up for that to a thousandth of an arcsecond.
        """
        for at_utc_s, known in reversed(self._foretold):
            if abs(utc_s - at_utc_s) <= SAME_INSTANT_S:
                return TargetState.at(known, utc_s - at_utc_s)
        return TargetState.at(self._direction_at(utc_s))

    def span(self, begin_utc_s: float, interval_s: float, bound_deg: Pair) -> TargetSpan:
        """Return where the axes must be over an interval."""
        end_utc_s = begin_utc_s + interval_s
        begin, end = self.state(begin_utc_s), self._direction_at(end_utc_s)
        self._foretold.append((end_utc_s, end))
        if self.passage is None:
            first, last = (begin.ra_deg, begin.dec_deg), (float(end.ra_deg), float(end.dec_deg))
            bend = (
                (float(end.ra_rate_deg_s) - begin.ra_rate_deg_s) / interval_s,
                (float(end.dec_rate_deg_s) - begin.dec_rate_deg_s) / interval_s,
            )
        else:
            self.passage.across = abs(bound_deg[1]) > 90.0
            first = self.passage.place(begin_utc_s, begin.ra_deg, begin.dec_deg)
            last = self.passage.place(end_utc_s, float(end.ra_deg), float(end.dec_deg))
            bend = (0.0, 0.0)
        move = (wrap180(last[0] - first[0]), last[1] - first[1])
        return TargetSpan(first, move, bend, (first[0] + wrap180(bound_deg[0] - first[0]), bound_deg[1]))
