"""The interlocks as one table: what is watched, its bound and margin, what happens, how to go on."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING

from sattrack.safety.rate_limit import Delays, closing_s, latency_s, standstill_s, unheeded_s
from sattrack.safety.watch import (
    CLOCK_PROOF,
    DISOBEDIENT_FOR_S,
    LOOK_EVERY,
    OLDEST_STATUS_S,
    OVERLOADED_FOR_S,
    WINDOW_S,
)

if TYPE_CHECKING:
    from sattrack.mount.model import MountProfile

STATUS_PERIOD_S = 0.05
"""The paper's: how often a mount tells how it stands."""


class Reaction(StrEnum):
    """What an interlock does when its bound is reached.

    A stream of rates that would pass a limit is held: cut down to what keeps inside and comes nearest, and
    given free again when it leads away. What is moved by hand, and anything past a limit, is stopped; but
    out of the cone about the Sun or the Moon a stream is led, and a mount that nothing is asked of is slewed.
    """

    CLAMP = "clamp"
    HOLD = "hold at the limit"
    STOP = "decelerate and stop"


@dataclass(frozen=True, slots=True)
class Interlock:
    """One row: what is watched, its bound and margin, what happens, and which way out there is."""

    name: str
    watches: str
    bound: str
    margin: str
    reaction: Reaction
    way_out: str
    noticed_s: float | None = 0.0
    """How long what is watched may be past its bound until the stop is sent; None where none is."""
    faults_pass: bool = False
    """Whether the longest fault comes on top, in which commands may be lost that are then not disobeyed."""


def promise_s(row: Interlock, profile: MountProfile, longest_fault_s: float, rate_deg_s: float) -> float:
    """Return within what time of its cause a row that stops the mount has both axes at rest, seconds.

    From a rate of both axes, deg/s; what the link loses meanwhile comes on top. 0 for what is cut in the same
    datagram. For a limit that a stream is held at, it is that of what is moved by hand.
    """
    if row.noticed_s is None:
        return 0.0
    slower = min(profile.braking_deg_s2)
    noticed_s = row.noticed_s + (longest_fault_s if row.faults_pass else 0.0)
    obeyed_s = profile.period_s + profile.abort_delay_s
    return noticed_s + obeyed_s + standstill_s(rate_deg_s, latency_s(profile), slower)


def closing_promise_s(profile: MountProfile, longest_fault_s: float, rate_deg_s: float) -> float:
    """Return within what time a stream held at a limit comes nearer no faster than CREEP_DEG_S."""
    delays = Delays(0.0, latency_s(profile), unheeded_s(profile, longest_fault_s))
    return closing_s(rate_deg_s, delays, min(profile.braking_deg_s2))


AHEAD = "where the axes would rest if no command arrived for `longest_fault_s`"
AND_SLEWS = "; every place that a slew may pass"
NEAR = "0.1°"
BACK = "held: by itself when the target comes back; stopped: move away from it by hand, start again"

INTERLOCKS = (
    Interlock(
        "rate",
        "commanded axis rates",
        "profile's max_rate_deg_s",
        "none",
        Reaction.CLAMP,
        "by itself",
        noticed_s=None,
    ),
    Interlock(
        "acceleration",
        "steps of a stream of rates",
        "profile's max_acceleration_deg_s2",
        "twice what the axis can do in a period: the mean over a ramp is half of its step",
        Reaction.CLAMP,
        "by itself",
        noticed_s=None,
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
        "held: by itself when the target comes back; in a zone: by the mount's own console",
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
        "age of the last status during a motion",
        f"{OLDEST_STATUS_S:g} s",
        "none: possible motion since the last status counts",
        Reaction.STOP,
        "check the link, start again",
        noticed_s=OLDEST_STATUS_S,
    ),
    Interlock(
        "obedience",
        "rates that the mount reports against those commanded; the path of a slew against its box",
        "not reversed, at rest or faster than twice the command and 1 °/s for a second; mean of 3 s "
        "within half of the largest rate and 0.1 °/s of what was commanded; 1° around the box",
        "what was commanded in the last `longest_fault_s` counts",
        Reaction.STOP,
        "check the profile's signs and the drives",
        noticed_s=max(DISOBEDIENT_FOR_S, WINDOW_S + LOOK_EVERY * STATUS_PERIOD_S),
        faults_pass=True,
    ),
    Interlock(
        "clock",
        "the mount's sidereal clock against ours, and ours against itself",
        "clock_tolerance_s; ours never back",
        "three statuses in a row, if the clock was right before",
        Reaction.STOP,
        "set the mount's clock or this computer's, start again",
        noticed_s=CLOCK_PROOF * STATUS_PERIOD_S,
    ),
    Interlock(
        "current",
        "drive currents that the mount reports",
        "profile's max_current_a, of either axis; not watched if left out",
        "half a second",
        Reaction.STOP,
        "find what blocks the axis, start again",
        noticed_s=OVERLOADED_FOR_S + STATUS_PERIOD_S,
    ),
    Interlock(
        "restart",
        "the count of the mount's statuses, where a server leads it along a path",
        "the mount's program does not begin anew",
        "none: it has forgotten its syncs",
        Reaction.STOP,
        "sync the mount again if it was synced, start again",
        noticed_s=OLDEST_STATUS_S,
    ),
)
ROWS = {row.name: row for row in INTERLOCKS}
