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
        "altitude of the axes, and of a slew's end",
        "floor_altitude_deg",
        Reaction.STOP,
        "slew up by the mount's own console, start again",
    ),
)


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
        self.clamping = False
        """Whether the last command's rates were cut to the limits."""

    def clear(self, motion: Motion, sidereal_deg: float, ra_deg: float, dec_deg: float) -> Cleared:
        """Return what may be sent of `motion`.

        `sidereal_deg` is the mount's local sidereal time; `ra_deg`, `dec_deg` where its axes are.
        """
        self.clamping = False
        if self.tripped is not None:
            return Cleared(Stop())
        match motion:
            case MoveAxes():
                return self._clear_move(motion, sidereal_deg - ra_deg, dec_deg)
            case SlewTo():
                if not self._finite(motion.ra_deg, motion.dec_deg):
                    return self._trip("command")
                if self._below_floor(sidereal_deg - motion.ra_deg, motion.dec_deg):
                    return self._trip("altitude")
                return Cleared(motion)
            case Hold() | Stop():
                return Cleared(motion)

    def _clear_move(self, move: MoveAxes, hour_angle_deg: float, dec_deg: float) -> Cleared:
        if not self._finite(move.ra_rate_deg_s, move.dec_rate_deg_s):
            return self._trip("command")
        if self._below_floor(hour_angle_deg, dec_deg):
            return self._trip("altitude")
        # The right ascension axis turns with the hour angle, so its bound is on sidereal minus this rate.
        ra_limit = self._profile.ra.max_rate_deg_s
        dec_limit = self._profile.dec.max_rate_deg_s
        ra = max(SIDEREAL_RATE_DEG_S - ra_limit, min(SIDEREAL_RATE_DEG_S + ra_limit, move.ra_rate_deg_s))
        dec = max(-dec_limit, min(dec_limit, move.dec_rate_deg_s))
        if ra == move.ra_rate_deg_s and dec == move.dec_rate_deg_s:
            return Cleared(move)
        self.clamping = True
        return Cleared(MoveAxes(ra, dec))

    def _below_floor(self, hour_angle_deg: float, dec_deg: float) -> bool:
        return altitude_deg(hour_angle_deg, dec_deg, self._latitude_deg) < self._limits.floor_altitude_deg

    @staticmethod
    def _finite(*numbers: float) -> bool:
        return all(math.isfinite(x) for x in numbers)

    def _trip(self, name: str) -> Cleared:
        self.tripped = name
        return Cleared(Stop())
