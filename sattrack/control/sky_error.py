"""Where a target is fed, and how far a pointing is from it on the sky. Pure."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import msgspec

from sattrack.core.angles import wrap180
from sattrack.views.run import ErrorView

if TYPE_CHECKING:
    from tle.direction import Direction


class Target(msgspec.Struct, frozen=True, gc=False):
    """Where the satellite is fed, degrees, and how fast that changes, degrees a second."""

    ra_deg: float
    dec_deg: float
    ra_rate_deg_s: float
    dec_rate_deg_s: float

    @classmethod
    def at(cls, known: Direction, late_s: float = 0.0) -> Target:
        """Return a known direction's target, so much later that its rates make up for that."""
        ra_rate, dec_rate = float(known.ra_rate_deg_s), float(known.dec_rate_deg_s)
        ra, dec = float(known.ra_deg), float(known.dec_deg)
        return cls(ra + ra_rate * late_s, dec + dec_rate * late_s, ra_rate, dec_rate)


def sky_error(utc_s: float, ra_deg: float, dec_deg: float, target: Direction | Target) -> ErrorView:
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
