"""Requests by hand: each judged as the mount stands, and refused in words."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sattrack.core.angles import altitude_deg
from sattrack.mount.model import SIDEREAL_RATE_DEG_S, MoveAxes, Slew
from sattrack.mount.requests import FindHome, FineRate, MoveAxis, Park, PulseGuide, Sync, park_objection
from sattrack.safety.geometry import Box, axis_rates
from sattrack.safety.rate_limit import Spot
from sattrack.safety.table import ROWS

if TYPE_CHECKING:
    from sattrack.mount.model import MountProfile, Stance
    from sattrack.mount.requests import Request
    from sattrack.safety.bounds import Bounds
    from sattrack.safety.geometry import AxesState
    from sattrack.safety.limits import SafetyLimits
    from sattrack.safety.rate_limit import Ahead
    from sattrack.safety.slews import SlewGate
    from sattrack.safety.watch import Watch

GUIDE_RATE_DEG_S = SIDEREAL_RATE_DEG_S
"""More than any pulse's: the paper's is about half of it."""
SLOWEST_DRIFT_S = 30.0
"""A drift that reaches a limit within this is ended."""
CLOSE_DEG = 0.5
"""Nearer to a limit than this, a slew is refused for what an abort may add to it, if for anything."""
NO_SUN = (
    "the Sun's direction is unknown without a site: give --site LAT,LON,HEIGHT, or say optical = false "
    "under [safety] where there are no optics"
)


class RequestChecks:
    """Judges requests by the parts that a mount's gate is made of."""

    def __init__(
        self,
        profile: MountProfile,
        limits: SafetyLimits,
        latitude_deg: float,
        parts: tuple[Bounds, SlewGate, Watch, AxesState, Ahead],
    ) -> None:
        self._profile, self._limits, self._latitude_deg = profile, limits, latitude_deg
        self._bounds, self._slews, self._watch, self._standing, self._ahead = parts

    def objection(  # noqa: PLR0911
        self, request: Request, stance: Stance, utc_s: float | None
    ) -> str | None:
        """Return why a request is not let through as the mount stands, or None where it is."""
        if isinstance(request, Slew | MoveAxis | FindHome | FineRate | PulseGuide):
            if self._watch.clock_is_off:
                return self._clock_text()
            if not self._bounds.look(utc_s, self._watch.clock_gap_deg):
                return NO_SUN
        match request:
            case Sync():
                return self._floor_text(request, stance)
            case Slew():
                name = self._slews.objection(request, stance.sidereal_deg, self._standing.of(stance))
                return None if name is None else self._slew_text(name, request, stance)
            case MoveAxis():
                move = MoveAxes(request.ra_rate_deg_s or 0.0, request.dec_rate_deg_s or 0.0)
                name = self._move_objection(move, stance)
                if name is not None:
                    return f"the mount stands at its {ROWS[name].name} limit ({ROWS[name].watches})"
            case Park():
                return park_objection(self._profile, stance)
            case FindHome() if stance.slewing:
                return "the mount is slewing: end that first"
            case FindHome():
                return self._home_objection(request, stance)
            case FineRate() | PulseGuide():
                return self._guide_objection(request, stance)
        return None

    def _clock_text(self) -> str:
        off_s = self._watch.clock_gap_deg / SIDEREAL_RATE_DEG_S
        return (
            f"the mount's sidereal clock is {off_s:.0f} s off this computer's, more than clock_tolerance_s, "
            f"{self._limits.clock_tolerance_s:g}: {ROWS['clock'].way_out}"
        )

    def _floor_text(self, request: Slew | Sync, stance: Stance) -> str | None:
        altitude = altitude_deg(stance.sidereal_deg - request.ra_deg, request.dec_deg, self._latitude_deg)
        floor = self._limits.floor_altitude_deg
        if altitude < floor:
            return f"that direction is at {altitude:.1f}° altitude; the limit is {floor:g}°"
        return None

    def _slew_text(self, name: str, request: Slew, stance: Stance) -> str:
        from sattrack.safety.route import axes_of

        row = ROWS[name]
        low = self._floor_text(request, stance)
        if low is not None:
            return low
        hour_angle_deg = stance.sidereal_deg - request.ra_deg
        goal = axes_of(hour_angle_deg, request.dec_deg, self._profile, self._latitude_deg)
        left_deg = self._bounds.near(goal, margin_deg=CLOSE_DEG).get(name, CLOSE_DEG)
        if self._profile.geometry is None and 0.0 < left_deg < CLOSE_DEG:
            return (
                f"that direction is {left_deg:.2f}° from the {row.name} limit ({row.bound}): too close for a "
                "slew that may be stopped before its end"
            )
        return f"no way to there keeps clear of the {row.name} limit ({row.bound})"

    def _move_objection(self, move: MoveAxes, stance: Stance) -> str | None:
        place = self._standing.of(stance)
        rates = axis_rates(move, stance.beyond_pole)
        return self._ahead.outlook([Spot(place, 0.0)], (rates, rates), [self._bounds.near(place)]).limit(
            rates
        )

    def _home_objection(self, request: FindHome, stance: Stance) -> str | None:
        home = self._profile.home
        if home is None:
            if self._bounds.sun_is_up and not request.in_daylight:
                return (
                    "the mount profile has no home position, so the path there is unknown, and the Sun is "
                    "up: put home into the profile, or say --in-daylight"
                )
            return None
        from sattrack.safety.route import axes_of

        goal = axes_of(home.hour_angle_deg, home.dec_deg, self._profile, self._latitude_deg)
        name = self._slews.path_objection(self._standing.of(stance), goal)
        return None if name is None else f"the way home is not clear of the {ROWS[name].name} limit"

    def _guide_objection(self, request: FineRate | PulseGuide, stance: Stance) -> str | None:
        if isinstance(request, FineRate):
            name = self.drift_objection(request, stance, self._bounds.utc_s)
        else:
            seconds = max(abs(request.ra_ms), abs(request.dec_ms)) / 1000.0
            share = [ms / 1000.0 / seconds for ms in (request.ra_ms, request.dec_ms)]
            name = self._drift_limit(
                stance,
                SIDEREAL_RATE_DEG_S + GUIDE_RATE_DEG_S * share[0],
                GUIDE_RATE_DEG_S * share[1],
                seconds,
            )
        return (
            None if name is None else f"that would lead past the {ROWS[name].name} limit ({ROWS[name].bound})"
        )

    def _drift_limit(self, stance: Stance, ha_deg_s: float, dec_deg_s: float, seconds: float) -> str | None:
        place = self._standing.of(stance)
        sense = -1.0 if stance.beyond_pole else 1.0
        end = (place[0] + ha_deg_s * seconds, place[1] + sense * dec_deg_s * seconds)
        return self._bounds.violated(Box.between(place, end), self._bounds.leaving(place), seconds)

    def path_to(self, request: Slew, stance: Stance, utc_s: float | None) -> tuple[Slew, ...] | str:
        """Return the slews that lead to a direction past what is in the way, or why there is no way."""
        if self._watch.clock_is_off:
            return self._clock_text()
        if not self._bounds.look(utc_s, self._watch.clock_gap_deg):
            return NO_SUN
        place = self._standing.of(stance)
        found = self._slews.route(request, stance.sidereal_deg, place)
        if isinstance(found, str):
            return self._slew_text(found, request, stance)
        return tuple(Slew(leg.ra_deg % 360.0, leg.dec_deg) for leg in found)

    def drift_objection(self, fine: FineRate, stance: Stance, utc_s: float | None) -> str | None:
        """Return the name of a limit that the mount drifts to under fine rates, tracking the sky; or None."""
        if not self._bounds.look(utc_s, self._watch.clock_gap_deg):
            return "sun"
        ha_deg_s, dec_deg_s = SIDEREAL_RATE_DEG_S + fine.ra_deg_s, fine.dec_deg_s
        return self._drift_limit(stance, ha_deg_s, dec_deg_s, SLOWEST_DRIFT_S)
