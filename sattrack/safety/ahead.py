"""Which limit rates may pass before a stop can hold the axes."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

from sattrack.safety.geometry import Box
from sattrack.safety.reach import AxisReach, Delays, latency_s

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from sattrack.mount.model import MountProfile
    from sattrack.safety.bounds import Bounds
    from sattrack.safety.geometry import Place
    from sattrack.safety.limits import SafetyLimits

NOTHING_NEAR: Mapping[str, float] = {}
RateRanges: TypeAlias = "tuple[tuple[float, float], tuple[float, float]]"
"""The least rates of both axes, hour angle first, and the greatest."""


class Spot(NamedTuple):
    """A place where the axes may have been so many seconds ago."""

    place: Place
    age_s: float


class Ahead:
    """Looks ahead for one mount among its bounds."""

    def __init__(self, profile: MountProfile, limits: SafetyLimits, bounds: Bounds) -> None:
        self._limits, self._bounds = limits, bounds
        self._braking_deg_s2 = profile.braking_deg_s2
        self.latency_s = latency_s(profile)
        """How long it takes until the mount acts on what is decided now."""
        self.horizon_s = self.latency_s + limits.longest_fault_s
        """How long it may take until it acts on what is decided next."""

    def outlook(
        self, spots: Sequence[Spot], now: RateRanges, nears: Sequence[Mapping[str, float]] | None = None
    ) -> Outlook:
        """Return what judges rates from any of the spots.

        `now` are the least and the greatest rates of both axes in force. `nears` are, for each spot, the
        limits whose margin the axes have used up, and what is left: rates must not lead nearer to them, nor
        past them by what is under way.
        """
        views = []
        for k, spot in enumerate(spots):
            ha, dec = self._reaches(spot, now)
            views.append(_View(spot.place, ha, dec, nears[k] if nears else NOTHING_NEAR))
        return Outlook(self._bounds, self.horizon_s, views)

    def reach(self, spot: Spot, now: RateRanges, rates: tuple[float, float]) -> Box:
        """Return where the axes may come under these rates before a stop can hold them."""
        ha, dec = self._reaches(spot, now)
        return Box(*ha.deg(rates[0]), *dec.deg(rates[1]))

    def _reaches(self, spot: Spot, now: RateRanges) -> tuple[AxisReach, AxisReach]:
        delays = Delays(spot.age_s, self.latency_s, self._limits.longest_fault_s)
        (ha_low, dec_low), (ha_high, dec_high) = now
        ha_deg, dec_deg = spot.place
        ha_braking, dec_braking = self._braking_deg_s2
        return (
            AxisReach(ha_deg, (ha_low, ha_high), delays, ha_braking),
            AxisReach(dec_deg, (dec_low, dec_high), delays, dec_braking),
        )


class _View:
    """A place, how far each axis may come from it, and what is near there."""

    __slots__ = ("dec", "ha", "margins", "near", "place")

    def __init__(self, place: Place, ha: AxisReach, dec: AxisReach, near: Mapping[str, float]) -> None:
        self.place, self.ha, self.dec, self.near = place, ha, dec, near
        self.margins = NOTHING_NEAR
        if near:
            self.margins = {name: 0.0 if clear >= 0.0 else -math.inf for name, clear in near.items()}


class Outlook:
    """What lies ahead of axes that go on as they do until a command acts: judges one wish after another."""

    def __init__(self, bounds: Bounds, horizon_s: float, views: Sequence[_View]) -> None:
        self._bounds, self._horizon_s, self._views = bounds, horizon_s, views

    def limit(self, rates: tuple[float, float]) -> str | None:
        """Return the limit that these rates may pass before a stop can hold the axes, or None."""
        for view in self._views:
            box = Box(*view.ha.deg(rates[0]), *view.dec.deg(rates[1]))
            name = self._bounds.violated(box, view.margins, self._horizon_s)
            if name is None and view.near:
                name = self._bounds.comes_nearer(view.near, view.place, rates, self._horizon_s)
            if name is not None:
                return name
        return None
