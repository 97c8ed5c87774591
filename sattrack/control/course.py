"""How a satellite goes across the sky: how far a second of bias moves it, how far it is, what axes feel.

Pace and range are taken from the propagator at whole seconds and interpolated between, so asking often is
cheap and the same instant always gives the same answer.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from sattrack.core.angles import wrap180
from tle.bias import Bias
from tle.instants import Utc

if TYPE_CHECKING:
    from tle.propagator import Propagator

STEP_S = 0.25
KEPT = 64
LEAST_PACE_DEG_S = 1e-3
"""Below it a satellite comes straight on, and a bias along its track is as good as none."""


class Going(NamedTuple):
    """Pace, degrees on the sky for each second of along-track bias, and range in km; each with its rate."""

    pace_deg_s: float
    pace_rate: float
    range_km: float
    range_rate_km_s: float


class AxisPace(NamedTuple):
    """What moves the axes: degrees for each second of bias along the track, and degrees a second by itself.

    Right ascension is that of the axis, not times cos Dec.
    """

    ra_by_along: float
    dec_by_along: float
    ra_rate_deg_s: float
    dec_rate_deg_s: float
    cos_dec: float


class Course:
    """The course of one satellite, as one propagator has it without any bias."""

    def __init__(self, propagator: Propagator) -> None:
        self.propagator = propagator
        """Gives the directions that are fed."""
        self._airless: Propagator | None = None
        self._known: dict[int, tuple[float, float]] = {}

    @property
    def airless(self) -> Propagator:
        """The same without refraction: the air that raises a satellite raises the stars about it."""
        if self._airless is None:
            bent = self.propagator.refraction is not None
            self._airless = self.propagator.with_place("apparent") if bent else self.propagator
        return self._airless

    def going(self, utc_s: float) -> Going:
        """Return pace and range at an instant, by cubics through whole seconds with continuous rates."""
        second = math.floor(utc_s)
        u = utc_s - second
        paces, ranges = zip(*(self._at(second + k) for k in (-1, 0, 1, 2)), strict=True)
        return Going(*_cubic(paces, u), *_cubic(ranges, u))

    def axis_pace(self, utc_s: float, along_s: float) -> AxisPace:
        """Return what a change of bias and the target's motion ask of the axes at an instant and a bias."""
        t = Utc(utc_s)
        here = self.propagator.at(t, Bias(along_s))
        later = self.propagator.at(t, Bias(along_s + STEP_S))
        dec_deg = float(here.dec_deg)
        return AxisPace(
            wrap180(float(later.ra_deg - here.ra_deg)) / STEP_S,
            (float(later.dec_deg) - dec_deg) / STEP_S,
            float(here.ra_rate_deg_s),
            float(here.dec_rate_deg_s),
            max(0.01, math.cos(math.radians(dec_deg))),
        )

    def _at(self, second: int) -> tuple[float, float]:
        found = self._known.get(second)
        if found is None:
            t = Utc(float(second))
            sooner, later = (self.propagator.at(t, Bias(s * STEP_S)) for s in (-1.0, 1.0))
            east_deg = wrap180(float(later.ra_deg - sooner.ra_deg))
            north_deg = float(later.dec_deg - sooner.dec_deg)
            middle = math.radians(0.5 * float(later.dec_deg + sooner.dec_deg))
            pace = math.hypot(east_deg * math.cos(middle), north_deg) / (2.0 * STEP_S)
            found = max(pace, LEAST_PACE_DEG_S), 0.5 * float(sooner.range_km + later.range_km)
            if len(self._known) >= KEPT:
                del self._known[next(iter(self._known))]
            self._known[second] = found
        return found


def _cubic(values: tuple[float, ...], u: float) -> tuple[float, float]:
    """Return value and derivative between the middle two of four values, by Catmull and Rom's spline."""
    a, b, c, d = values
    slope, bend, twist = 0.5 * (c - a), a - 2.5 * b + 2.0 * c - 0.5 * d, 1.5 * (b - c) + 0.5 * (d - a)
    return b + u * (slope + u * (bend + u * twist)), slope + u * (2.0 * bend + 3.0 * u * twist)
