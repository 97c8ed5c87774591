"""What slews take that the safety gate leads round what is in their way: longer than straight ones."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from sattrack.mount import SlewTo, mean_sidereal_deg
from sattrack.safety.bounds import Bounds
from sattrack.safety.route import axes_of, direction_of, slew_s
from sattrack.safety.slews import SlewGate

if TYPE_CHECKING:
    from sattrack.safety.geometry import Place
    from sattrack.schedule.candidates import Situation


class LedSlews:
    """Slews at a site with a mount as its gate would lead them."""

    def __init__(self, situation: Situation) -> None:
        """Build the gate of a situation's mount, limits and site."""
        site, profile = situation.site, situation.profile
        self._site, self._profile = site, profile
        self._bounds = Bounds(profile, situation.limits, site.latitude_deg, site.longitude_deg)
        self._gate = SlewGate(profile, self._bounds, site.latitude_deg, detours=True)

    def extra_s(self, leave: Place, want: Place, utc_s: float) -> float:
        """Return the seconds more than straight from one place of the axes to another at an instant.

        Infinity where the gate knows no clear way.
        """
        self._bounds.look(utc_s, 0.0)
        sidereal_deg = mean_sidereal_deg(utc_s, self._site.longitude_deg)
        hour_angle, dec = direction_of(want)
        legs = self._gate.route(
            SlewTo((sidereal_deg - hour_angle) % 360.0, dec), sidereal_deg, leave, waits=True
        )
        if isinstance(legs, str):
            return math.inf
        if len(legs) == 1:
            return 0.0
        total, at = 0.0, leave
        for leg in legs:
            there = axes_of(sidereal_deg - leg.ra_deg, leg.dec_deg, self._profile, self._site.latitude_deg)
            total += slew_s(at, there, self._profile)
            at = there
        return max(0.0, total - slew_s(leave, want, self._profile))
