"""Limits and interlocks as one table, between everything that moves the mount and the wire.

`Safety.clear` is the only maker of `Cleared`, and a session takes motions in no other form.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, NamedTuple

from sattrack.mount import SIDEREAL_RATE_DEG_S, Hold, Motion, MountProfile, MoveAxes, SlewTo, Stop
from sattrack.requests import Abort, FindHome, MoveAxis, Park, Request, Slew, Sync, objection
from sattrack.safety.geometry import altitude_deg

if TYPE_CHECKING:
    from sattrack.safety.limits import SafetyLimits


class Reaction(StrEnum):
    """What an interlock does when its bound is reached."""

    CLAMP = "clamp"
    STOP = "stop"


@dataclass(frozen=True, slots=True)
class Interlock:
    """One row: what is watched, its bound, what happens, and which way out there is."""

    name: str
    watches: str
    bound: str
    reaction: Reaction
    way_out: str


INTERLOCKS = (
    Interlock("rate", "commanded axis rates", "profile's max_rate_deg_s", Reaction.CLAMP, "by itself"),
    Interlock("command", "commanded numbers", "finite", Reaction.STOP, "start again"),
    Interlock(
        "altitude",
        "altitude where MoveAxis would come to rest if stopped now, and that of a slew's end",
        "floor_altitude_deg",
        Reaction.STOP,
        "slew up by the mount's own console, start again",
    ),
    Interlock(
        "hour_angle",
        "hour angle where MoveAxis would come to rest if stopped now, turns counted from the first status",
        "profile's hour_angle_limit_deg either way",
        Reaction.STOP,
        "slew back by the mount's own console, start again",
    ),
    Interlock(
        "obedience",
        "rates that the mount reports against those commanded, while either is above 0.5 °/s",
        "not the opposite way, nor at rest, nor faster than twice as fast and 1 °/s, for a second",
        Reaction.STOP,
        "check the profile's signs and the drives",
    ),
)
ROWS = {row.name: row for row in INTERLOCKS}


LATENCY_S = 0.2
"""How long a stop may take to act, beside the braking itself."""
PARKED_WITHIN_DEG = 0.5
DISOBEDIENT_DEG_S = 0.5
DISOBEDIENT_FOR_S = 1.0
RUNAWAY_DEG_S = 1.0
"""A mount that moves faster than twice what it was told, and this, for so long, does not obey either."""


@dataclass(frozen=True, slots=True)
class Cleared:
    """A motion that safety has let through."""

    motion: Motion


@dataclass(frozen=True, slots=True)
class ClearedRequest:
    """A request that safety has let through."""

    request: Request


class Stance(NamedTuple):
    """How the mount stands when a request comes: its clock and direction, degrees, and whether it moves."""

    sidereal_deg: float
    ra_deg: float
    dec_deg: float
    slewing: bool
    drives_at_rest: bool
    """Whether both drives report standstill, sidereal tracking not counted as rest."""


def park_objection(profile: MountProfile, stance: Stance) -> str | None:
    """Return why the drives' power may not be cut as the mount stands, or None where it may."""
    park = profile.park
    if park is None:
        return "the mount profile has no park position, and parking cuts the drives' power"
    hour_angle = math.remainder(stance.sidereal_deg - stance.ra_deg - park.hour_angle_deg, 360.0)
    # At the pole the hour angle says nothing of where the tube points, but the axis has its place.
    off = max(abs(hour_angle), abs(stance.dec_deg - park.dec_deg))
    if off > PARKED_WITHIN_DEG:
        return f"the mount stands {off:.2f}° away from its park position: slew there and stop first"
    if stance.slewing or not stance.drives_at_rest:
        return "the mount moves: parking cuts the drives' power, so stop it first"
    return None


class Safety:
    """Clears motions; once an interlock has stopped the mount, only stops are cleared."""

    def __init__(self, profile: MountProfile, limits: SafetyLimits, latitude_deg: float) -> None:
        self._profile = profile
        self._limits = limits
        self._latitude_deg = latitude_deg
        self.tripped: str | None = None
        """Name of the interlock that stopped the mount."""
        self._hour_angle_deg: float | None = None
        self._disobeyed_s = 0.0
        self.clamping = False
        """Whether the last command's rates were cut to the limits."""

    def watch(self, hour_angle_deg: float, moved: MoveAxes, commanded: Motion, seconds: float) -> None:
        """Take what a status tells: where the hour angle axis is, and how the mount moved since the last one.

        `moved` are mean rates over `seconds`, `commanded` what was in force; call once a status.
        """
        # Unknown until told, the turns are taken to begin within half a turn of the meridian.
        before = self._hour_angle_deg or 0.0
        self._hour_angle_deg = before + (hour_angle_deg - before + 180.0) % 360.0 - 180.0
        if not isinstance(commanded, MoveAxes):
            self._disobeyed_s = 0.0
            return
        pairs = (
            (commanded.ra_rate_deg_s, moved.ra_rate_deg_s),
            (commanded.dec_rate_deg_s, moved.dec_rate_deg_s),
        )
        disobeyed = any(
            (abs(c) > DISOBEDIENT_DEG_S and m * c < 0.05 * c * c) or abs(m) > 2.0 * abs(c) + RUNAWAY_DEG_S
            for c, m in pairs
        )
        self._disobeyed_s = self._disobeyed_s + seconds if disobeyed else 0.0
        if self._disobeyed_s > DISOBEDIENT_FOR_S:
            self._trip("obedience")

    def follow_on(self, former: Safety) -> None:
        """Take over how far the cables are wound from a former one, whose stop is over."""
        self._hour_angle_deg = former._hour_angle_deg

    def clear(
        self, motion: Motion, sidereal_deg: float, ra_deg: float, dec_deg: float, age_s: float = 0.0
    ) -> Cleared:
        """Return what may be sent of `motion`.

        `sidereal_deg` is the mount's local sidereal time, `ra_deg`, `dec_deg` where it was `age_s` ago.
        """
        self.clamping = False
        if self.tripped is not None:
            return Cleared(Stop())
        match motion:
            case MoveAxes():
                return self._clear_move(motion, sidereal_deg - ra_deg, dec_deg, age_s)
            case SlewTo():
                if not self._finite(motion.ra_deg, motion.dec_deg):
                    return self._trip("command")
                if self._below_floor(sidereal_deg - motion.ra_deg, motion.dec_deg):
                    return self._trip("altitude")
                return Cleared(motion)
            case Hold() | Stop():
                return Cleared(motion)

    def clear_request(self, request: Request, stance: Stance | None) -> ClearedRequest | str:
        """Return a request as it may be submitted, or in words why it may not be.

        `stance` is None where the mount has not been heard: then only an abort passes. The rates of a
        MoveAxis go on being judged by `clear`, once a period.
        """
        if isinstance(request, Abort):
            return ClearedRequest(request)
        refused = objection(request, self._profile)
        if refused is None and stance is None:
            refused = "the mount has not been heard yet"
        if refused is None and self.tripped is not None:
            refused = (
                f"safety has stopped the mount ({ROWS[self.tripped].watches}): {ROWS[self.tripped].way_out}"
            )
        if refused is None and stance is not None:
            refused = self._request_objection(request, stance)
        return ClearedRequest(request) if refused is None else refused

    def _request_objection(self, request: Request, stance: Stance) -> str | None:
        match request:
            case Slew() | Sync():
                altitude = altitude_deg(
                    stance.sidereal_deg - request.ra_deg, request.dec_deg, self._latitude_deg
                )
                if altitude < self._limits.floor_altitude_deg:
                    floor = self._limits.floor_altitude_deg
                    return f"that direction is at {altitude:.1f}° altitude; the limit is {floor:g}°"
            case MoveAxis():
                move = MoveAxes(request.ra_rate_deg_s or 0.0, request.dec_rate_deg_s or 0.0)
                name = self._limit_ahead(move, stance.sidereal_deg - stance.ra_deg, stance.dec_deg, 0.0)
                if name is not None:
                    return f"the mount stands at its {ROWS[name].name} limit ({ROWS[name].watches})"
            case Park():
                return park_objection(self._profile, stance)
            case FindHome() if stance.slewing:
                return "the mount is slewing: end that first"
        return None

    def _clear_move(self, move: MoveAxes, hour_angle_deg: float, dec_deg: float, age_s: float) -> Cleared:
        if not self._finite(move.ra_rate_deg_s, move.dec_rate_deg_s):
            return self._trip("command")
        # The right ascension axis turns with the hour angle, so its bound is on sidereal minus this rate.
        ra_limit = self._profile.ra.max_rate_deg_s
        dec_limit = self._profile.dec.max_rate_deg_s
        ra = max(SIDEREAL_RATE_DEG_S - ra_limit, min(SIDEREAL_RATE_DEG_S + ra_limit, move.ra_rate_deg_s))
        dec = max(-dec_limit, min(dec_limit, move.dec_rate_deg_s))
        ahead = self._limit_ahead(MoveAxes(ra, dec), hour_angle_deg, dec_deg, age_s)
        if ahead is not None:
            return self._trip(ahead)
        if ra == move.ra_rate_deg_s and dec == move.dec_rate_deg_s:
            return Cleared(move)
        self.clamping = True
        return Cleared(MoveAxes(ra, dec))

    def _limit_ahead(self, move: MoveAxes, hour_angle_deg: float, dec_deg: float, age_s: float) -> str | None:
        """Return the name of the limit beyond which these rates would come to rest if stopped now."""
        on = self._way_to_rest_deg(
            SIDEREAL_RATE_DEG_S - move.ra_rate_deg_s, self._profile.ra.max_acceleration_deg_s2, age_s
        )
        up = self._way_to_rest_deg(move.dec_rate_deg_s, self._profile.dec.max_acceleration_deg_s2, age_s)
        if self._below_floor(hour_angle_deg + on, dec_deg + up):
            return "altitude"
        turned = self._hour_angle_deg or 0.0
        if abs(turned + on) > self._profile.hour_angle_limit_deg and turned * on > 0.0:
            return "hour_angle"
        return None

    @staticmethod
    def _way_to_rest_deg(rate_deg_s: float, acceleration_deg_s2: float, age_s: float) -> float:
        """Return how far an axis goes on from where it was seen if it is told to stop now."""
        return rate_deg_s * (age_s + LATENCY_S) + rate_deg_s * abs(rate_deg_s) / (2.0 * acceleration_deg_s2)

    def _below_floor(self, hour_angle_deg: float, dec_deg: float) -> bool:
        return altitude_deg(hour_angle_deg, dec_deg, self._latitude_deg) < self._limits.floor_altitude_deg

    @staticmethod
    def _finite(*numbers: float) -> bool:
        return all(math.isfinite(x) for x in numbers)

    def _trip(self, name: str) -> Cleared:
        self.tripped = name
        return Cleared(Stop())
