"""The interlocks as one table: what is watched, its bound and margin, what happens, how to go on."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class Reaction(StrEnum):
    """What an interlock does when its bound is reached.

    A stream of rates that would pass a limit is held: cut down to what keeps inside and comes nearest, and
    given free again when it leads away. What is moved by hand, and whatever is past a limit, is stopped.
    """

    CLAMP = "clamp"
    HOLD = "hold at the limit"
    STOP = "decelerate and stop"
    REFUSE = "refuse"


@dataclass(frozen=True, slots=True)
class Interlock:
    """One row: what is watched, its bound and margin, what happens, and which way out there is."""

    name: str
    watches: str
    bound: str
    margin: str
    reaction: Reaction
    way_out: str


AHEAD = "where the axes would rest if no command arrived for `longest_fault_s`"
AND_SLEWS = "; every place that a slew may pass"
NEAR = "0.1°"
BACK = "by itself when the target comes back; by hand: move the other way, start again"

INTERLOCKS = (
    Interlock(
        "rate", "commanded axis rates", "profile's max_rate_deg_s", "none", Reaction.CLAMP, "by itself"
    ),
    Interlock(
        "acceleration",
        "steps of a stream of rates",
        "profile's max_acceleration_deg_s2",
        "twice what the axis can do in a period: the mean over a ramp is half of its step",
        Reaction.CLAMP,
        "by itself",
    ),
    Interlock("command", "commanded numbers", "finite", "none", Reaction.STOP, "start again"),
    Interlock("altitude", "altitude " + AHEAD + AND_SLEWS, "floor_altitude_deg", NEAR, Reaction.HOLD, BACK),
    Interlock(
        "horizon", "altitude above the skyline " + AHEAD + AND_SLEWS, "horizon", NEAR, Reaction.HOLD, BACK
    ),
    Interlock(
        "hour_angle",
        "hour angle axis, turns counted from the first status, " + AHEAD + AND_SLEWS,
        "profile's hour_angle_limit_deg either way",
        NEAR,
        Reaction.HOLD,
        BACK,
    ),
    Interlock(
        "declination",
        "declination axis, beyond the pole too, " + AHEAD + AND_SLEWS,
        "profile's dec_axis_limits_deg",
        NEAR,
        Reaction.HOLD,
        BACK,
    ),
    Interlock(
        "pier",
        "both axes " + AHEAD + AND_SLEWS,
        "profile's pier_zones",
        "0.5°",
        Reaction.HOLD,
        "by itself when the target comes back; in a zone: by the mount's own console",
    ),
    Interlock(
        "sun",
        "distance from the Sun's centre " + AHEAD + AND_SLEWS,
        "sun_cone_deg while the Sun is above -3°",
        NEAR + " and the gap between the mount's clock and ours",
        Reaction.HOLD,
        BACK,
    ),
    Interlock(
        "moon",
        "distance from the Moon's centre " + AHEAD + AND_SLEWS,
        "moon_cone_deg while the Moon is above -3°",
        NEAR + " and the gap between the mount's clock and ours",
        Reaction.HOLD,
        BACK,
    ),
    Interlock(
        "status_age",
        "age of the last status while the mount is to move",
        "2.5 s",
        "none: what the mount may do meanwhile is counted from its last status",
        Reaction.STOP,
        "see to the link, start again",
    ),
    Interlock(
        "obedience",
        "rates that the mount reports against those commanded; the way of a slew against its box",
        "not the opposite way, at rest or faster than twice as fast and 1 °/s for a second; mean of 3 s "
        "within half of the largest rate and 0.1 °/s of what was commanded; 1° around the box",
        "what was commanded in the last `longest_fault_s` counts",
        Reaction.STOP,
        "check the profile's signs and the drives",
    ),
    Interlock(
        "clock",
        "the mount's sidereal clock against ours, and ours against itself",
        "clock_tolerance_s; ours never back",
        "none",
        Reaction.STOP,
        "set the mount's clock or this computer's, start again",
    ),
    Interlock(
        "current",
        "drive currents that the mount reports",
        "profile's max_current_a, of either axis; not watched where it is left out",
        "half a second",
        Reaction.STOP,
        "look what holds the axis, start again",
    ),
)
ROWS = {row.name: row for row in INTERLOCKS}
