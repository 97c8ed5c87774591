"""What slews take that the safety gate leads round what is in their way: longer than straight ones."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from sattrack.mount.model import SlewTo, mean_sidereal_deg
from sattrack.safety.bounds import HOLD_MARGIN_DEG, Bounds
from sattrack.safety.regions import is_clear
from sattrack.safety.route import axes_of, direction_of, slew_s
from sattrack.safety.slews import SlewGate

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sattrack.safety.geometry import Box, Place
    from sattrack.safety.regions import Cone
    from sattrack.schedule.candidates import Situation


class _KnownBounds(Bounds):
    """The gate's bounds, which remember of single places what never moves: a night asks for the same ones."""

    def __init__(self, *of: Any) -> None:
        super().__init__(*of)
        self._known: dict[Box, tuple[str | None, float, float, float]] = {}
        self._sure: list[tuple[float, float, float, float]] = []

    def look(self, utc_s: float | None, clock_gap_deg: float) -> bool:
        """See Bounds."""
        found = super().look(utc_s, clock_gap_deg)
        self._sure = [_surely_outside(cone) for cone in self._cones]
        return found

    def violated(
        self, box: Box, margins: Mapping[str, float], seconds: float, margin_deg: float = HOLD_MARGIN_DEG
    ) -> str | None:
        """See Bounds."""
        single = box[0] == box[1] and box[2] == box[3]
        if not single or margins or seconds or margin_deg != HOLD_MARGIN_DEG:
            return super().violated(box, margins, seconds, margin_deg)
        known = self._known.get(box)
        if known is None:
            shut = (region.name for region in self._fixed if not is_clear(region, box, margin_deg))
            known = self._known[box] = (next(shut, None), *box.circle[:3])
        name, x, y, z = known
        if name is not None:
            return name
        for cone, (a, b, c, cosine) in zip(self._cones, self._sure, strict=True):
            if a * x + b * y + c * z > cosine and not is_clear(cone, box, margin_deg):
                return cone.name
        return None


SURE_DEG = 1.0


def _surely_outside(cone: Cone) -> tuple[float, float, float, float]:
    """Return a cone's axis as a unit vector, and the cosine of an angle from it that is surely outside."""
    ha, dec = math.radians(cone.body.hour_angle_deg), math.radians(cone.body.dec_deg)
    wide = math.cos(math.radians(min(180.0, cone.cone_deg + HOLD_MARGIN_DEG + SURE_DEG)))
    return math.cos(dec) * math.cos(ha), math.cos(dec) * math.sin(ha), math.sin(dec), wide


class LedSlews:
    """Slews at a site with a mount as its gate would lead them."""

    def __init__(self, situation: Situation) -> None:
        """Build the gate of a situation's mount, limits and site."""
        site, profile = situation.site, situation.profile
        self._site, self._profile = site, profile
        self._bounds = _KnownBounds(profile, situation.limits, site.latitude_deg, site.longitude_deg)
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
