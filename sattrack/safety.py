"""Limits and interlocks as one table, between everything that moves the mount and the wire.

`Safety.clear` is the only maker of `Cleared`, and a session takes motions in no other form.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

import msgspec

from sattrack.mount import SIDEREAL_RATE_DEG_S, Hold, Motion, MountProfile, MoveAxes, SlewTo, Stop


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
        "not the opposite way, nor at rest, for a second",
        Reaction.STOP,
        "check the profile's signs and the drives",
    ),
)
ROWS = {row.name: row for row in INTERLOCKS}


LATENCY_S = 0.2
"""How long a stop may take to act, beside the braking itself."""
DISOBEDIENT_DEG_S = 0.5
DISOBEDIENT_FOR_S = 1.0


class SafetyLimits(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The bounds that are the site's own."""

    floor_altitude_deg: float = 0.0


@dataclass(frozen=True, slots=True)
class Cleared:
    """A motion that safety has let through."""

    motion: Motion


def altitude_deg(hour_angle_deg: float, dec_deg: float, latitude_deg: float) -> float:
    """Return the altitude of a direction given by hour angle and declination, degrees."""
    h, d, p = (math.radians(x) for x in (hour_angle_deg, dec_deg, latitude_deg))
    sine = math.sin(p) * math.sin(d) + math.cos(p) * math.cos(d) * math.cos(h)
    return math.degrees(math.asin(max(-1.0, min(1.0, sine))))


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
        disobeyed = any(abs(c) > DISOBEDIENT_DEG_S and m * c < 0.05 * c * c for c, m in pairs)
        self._disobeyed_s = self._disobeyed_s + seconds if disobeyed else 0.0
        if self._disobeyed_s > DISOBEDIENT_FOR_S:
            self._trip("obedience")

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

    def _clear_move(self, move: MoveAxes, hour_angle_deg: float, dec_deg: float, age_s: float) -> Cleared:
        if not self._finite(move.ra_rate_deg_s, move.dec_rate_deg_s):
            return self._trip("command")
        # The right ascension axis turns with the hour angle, so its bound is on sidereal minus this rate.
        ra_limit = self._profile.ra.max_rate_deg_s
        dec_limit = self._profile.dec.max_rate_deg_s
        ra = max(SIDEREAL_RATE_DEG_S - ra_limit, min(SIDEREAL_RATE_DEG_S + ra_limit, move.ra_rate_deg_s))
        dec = max(-dec_limit, min(dec_limit, move.dec_rate_deg_s))
        on = self._way_to_rest_deg(SIDEREAL_RATE_DEG_S - ra, self._profile.ra.max_acceleration_deg_s2, age_s)
        up = self._way_to_rest_deg(dec, self._profile.dec.max_acceleration_deg_s2, age_s)
        if self._below_floor(hour_angle_deg + on, dec_deg + up):
            return self._trip("altitude")
        turned = self._hour_angle_deg or 0.0
        if abs(turned + on) > self._profile.hour_angle_limit_deg and turned * on > 0.0:
            return self._trip("hour_angle")
        if ra == move.ra_rate_deg_s and dec == move.dec_rate_deg_s:
            return Cleared(move)
        self.clamping = True
        return Cleared(MoveAxes(ra, dec))

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
