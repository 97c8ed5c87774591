"""Which limit rates may pass before a stop can hold the axes."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from sattrack.safety.geometry import Box
from sattrack.safety.reach import AxisMotion, Delays, latency_s, reach_deg

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from sattrack.mount import MountProfile
    from sattrack.safety.bounds import Bounds
    from sattrack.safety.geometry import Place
    from sattrack.safety.limits import SafetyLimits

NOTHING_NEAR: Mapping[str, float] = {}


class Spot(NamedTuple):
    """A place where the axes may have been so many seconds ago."""

    place: Place
    age_s: float


class Ahead:
    """Looks ahead for one mount among its bounds."""

    def __init__(self, profile: MountProfile, limits: SafetyLimits, bounds: Bounds) -> None:
        self._profile, self._limits, self._bounds = profile, limits, bounds
        self.latency_s = latency_s(profile)
        """How long it takes until the mount acts on what is decided now."""
        self.horizon_s = self.latency_s + limits.longest_fault_s
        """How long it may take until it acts on what is decided next."""

    def limit(
        self,
        motions: tuple[AxisMotion, AxisMotion],
        rates: tuple[float, float],
        age_s: float,
        near: Mapping[str, float],
    ) -> str | None:
        """Return the limit that these rates may pass before a stop can hold the axes, or None.

        `near` are the limits whose margin the axes have used up, and what is left: rates must not lead nearer
        to them, nor past them by what is under way.
        """
        margins = {name: 0.0 if clear >= 0.0 else -math.inf for name, clear in near.items()}
        name = self._bounds.violated(self.reach(motions, rates, age_s), margins, self.horizon_s)
        if name is None and near:
            place = (motions[0].position_deg, motions[1].position_deg)
            name = self._bounds.comes_nearer(near, place, rates, self.horizon_s)
        return name

    def limit_of(
        self,
        spots: Sequence[Spot],
        now: tuple[tuple[float, float], tuple[float, float]],
        rates: tuple[float, float],
        nears: Sequence[Mapping[str, float]] | None,
    ) -> str | None:
        """Return the limit that these rates may pass from any of the spots, or None.

        `now` are the least and the greatest rates in force; `nears` as `limit`'s, one for each spot.
        """
        for k, spot in enumerate(spots):
            near = NOTHING_NEAR if nears is None else nears[k]
            name = self.limit(motions_of(spot.place, now), rates, spot.age_s, near)
            if name is not None:
                return name
        return None

    def reach(self, motions: tuple[AxisMotion, AxisMotion], rates: tuple[float, float], age_s: float) -> Box:
        """Return where the axes may come under these rates before a stop can hold them."""
        delays = Delays(age_s, self.latency_s, self._limits.longest_fault_s)
        ha = reach_deg(motions[0], rates[0], delays, self._profile.ra.max_acceleration_deg_s2)
        dec = reach_deg(motions[1], rates[1], delays, self._profile.dec.max_acceleration_deg_s2)
        return Box(*ha, *dec)


def motions_of(
    place: Place, now: tuple[tuple[float, float], tuple[float, float]]
) -> tuple[AxisMotion, AxisMotion]:
    """Return both axes at a place, with the least and the greatest rates that may be in force."""
    low, high = now
    return AxisMotion(place[0], low[0], high[0]), AxisMotion(place[1], low[1], high[1])
