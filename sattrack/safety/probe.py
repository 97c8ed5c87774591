"""Small motions of a mount of which nobody knows how its axes lie.

Whatever its axes are, a tube goes no farther on the sky than the rates of both together carry it. So a circle
about the place where it began is looked at beforehand, and a mount that leaves it is stopped.

What a mount reports may mean anything. With a camera, the circle is about the field that was solved before
the first motion, and each field says where the tube is. In between, reports tell how far one motion has led:
no farther than both reported angles change, be they those of axes or of a direction. Once fields have shown,
for both axes, that reported directions are as far apart as the true ones, that distance counts.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from sattrack.core.angles import altitude_deg, separation_deg
from sattrack.mount.model import Cleared, Hold, Motion, MoveAxes, Seen, Stop
from sattrack.safety.bounds import UP_DEG
from sattrack.safety.gate import Safety
from sattrack.safety.watch import OLDEST_STATUS_S

if TYPE_CHECKING:
    from sattrack.mount.model import MountProfile
    from sattrack.safety.limits import SafetyLimits

Direction = tuple[float, float]
"""Hour angle and declination, degrees."""
AXES = 2
SHOWS_DEG = 0.2
"""How far a field must be from the one before for both to say what reports make of the way."""
FALLS_SHORT = 1.3
"""True over reported distance, or the inverse, of directions that are as far apart as reported."""


class ProbeSafety(Safety):
    """Clears rates while the mount reports to be within a circle about its beginning that is clear.

    `reach_deg` is how far the motions lead, `stop_deg` how much farther a mount may come until it stands.
    With `motion_deg`, how far one motion leads, nothing moves before `see_field` tells where the tube looks.
    """

    def __init__(
        self,
        profile: MountProfile,
        limits: SafetyLimits,
        site: tuple[float, float],
        reach_deg: float,
        stop_deg: float,
        motion_deg: float | None = None,
    ) -> None:
        super().__init__(profile, limits, *site)
        self._site, self._reach_deg = site, reach_deg
        self._radius_deg = reach_deg + stop_deg
        self._start: Direction | None = None
        self._motion_deg = motion_deg
        self._fields: list[tuple[Direction, Direction]] = []
        """Where the tube looked while it stood, and what it reported there."""
        self._falls_short: list[float] = []
        """True over reported distance, one for each motion that a field has shown."""

    def see_field(self, looks: Direction, told: Direction) -> None:
        """Take where the tube looks while it stands, and what it reports; the first begins the circle."""
        if self._fields:
            before = self._fields[-1]
            went = separation_deg(*before[0], *looks)
            if went > SHOWS_DEG:
                self._falls_short.append(went / max(separation_deg(*before[1], *told), 1e-6))
        self._fields.append((looks, told))
        if separation_deg(*self._fields[0][0], *looks) > self._reach_deg and self.tripped is None:
            self.tripped = "obedience"

    def watch(self, seen: Seen, commanded: Motion) -> None:
        """Take a status: its clock and its currents count. How it obeys is not known yet."""
        tripped = self._watch.see(seen, Hold())
        if tripped is not None and self.tripped is None and isinstance(commanded, MoveAxes):
            self.tripped = tripped

    def clear(
        self,
        motion: Motion,
        sidereal_deg: float,
        ra_deg: float,
        dec_deg: float,
        age_s: float = 0.0,
        utc_s: float | None = None,
    ) -> Cleared:
        """See Safety. The first motion begins the circle."""
        if self.tripped is None and isinstance(motion, MoveAxes):
            here = (sidereal_deg - ra_deg, dec_deg)
            self.tripped = self._why_not(here, age_s, utc_s)
        if self.tripped is not None or not isinstance(motion, MoveAxes | Hold):
            return Cleared(Stop())
        return Cleared(motion)

    def _left_motion(self, here: Direction) -> bool:
        """Tell whether the tube may have come farther from its last field than a motion leads."""
        if self._motion_deg is None:
            return False
        told = self._fields[-1][1]
        as_angles = math.hypot(math.remainder(here[0] - told[0], 360.0), here[1] - told[1])
        shown = self._falls_short
        if len(shown) < AXES or max(shown) > FALLS_SHORT or min(shown) * FALLS_SHORT < 1.0:
            return as_angles > self._motion_deg
        return max(1.0, *shown) * separation_deg(*told, *here) > self._motion_deg

    def _why_not(self, here: Direction, age_s: float, utc_s: float | None) -> str | None:
        blind = self._motion_deg is not None and not self._fields
        if blind or not all(math.isfinite(one) for one in (*here, age_s)):
            return "command"
        if self._watch.clock_is_off:
            return "clock"
        if age_s > OLDEST_STATUS_S:
            return "status_age"
        start = self._start = here if self._start is None else self._start
        if separation_deg(*start, *here) > self._reach_deg or self._left_motion(here):
            return "obedience"
        return self.objection(self._fields[0][0] if self._fields else start, utc_s)

    def objection(self, start: Direction, utc_s: float | None) -> str | None:
        """Return the name of a limit that the circle about a direction is not clear of, or None."""
        limits, latitude_deg = self._limits, self._site[0]
        floor = max([limits.floor_altitude_deg, *(altitude for _, altitude in limits.horizon)])
        if altitude_deg(*start, latitude_deg) - self._radius_deg < floor:
            return "altitude" if floor == limits.floor_altitude_deg else "horizon"
        if not self._bounds.look(utc_s, self._watch.clock_gap_deg):
            return "sun"
        for cone in self._bounds.cones:
            body = cone.body
            up = altitude_deg(body.hour_angle_deg, body.dec_deg, latitude_deg) > UP_DEG
            near = separation_deg(*start, body.hour_angle_deg, body.dec_deg) - self._radius_deg
            if up and near < cone.cone_deg:
                return cone.name
        return None
