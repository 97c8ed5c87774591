"""What happens when the link, or one of its ends, is lost: a table that documentation, tests and plans share.

Times are promises: the longest until both axes stand, by the mount's own profile. They are made of what it
takes until somebody says stop, or the mount's own watchdog does, and of the braking from the rate at hand.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from sattrack.mount.model import STATUS_LOST_S

if TYPE_CHECKING:
    from sattrack.mount.model import MountProfile

NEVER_S = math.inf
STOPS_SENT_S = 12.0
"""How long a session stops a mount that is not heard: longer than a switch takes to come up again."""
STOPS_MOVING_S = 60.0
"""How long it stops one that answers but does not come to rest."""
STOP_LINGER_S = 0.25
"""Flag-free datagrams after the rest was seen, so that no late one is the last that the mount gets."""
OVERTAKEN_SHARE = 1.5
MOST_OVERTAKEN_S = 10.0
"""Where datagrams overtake one another, a mount is let go of so much later than the stop's begin as the worst
of them was overtaken by, and half as much: one with a motion may still be under way."""
STOPS_SLOW_S = 1.0
STOPS_SLOWEST_S = 5.0
STOPS_SLOW_FOR_S = 60.0
"""A guardian goes on once in STOPS_SLOW_S for so long, then once in STOPS_SLOWEST_S; at full rate while it
hears the mount."""
AWAY_S = 6.0
"""A longer time between two looks at a stop, or a negative one: the machine slept or its clock was set."""
HANG_S = 1.0
"""How long our process may stand still before its guardian stops the mount."""
OBEYED_S = 0.5
"""From the decision to stop to the begin of the braking: two datagrams, a stop that is raised anew, the
mount's loop, and what jerk limits and servos add."""
NOTICED_S = 0.3
"""How long a guardian may take to notice that its feeder is gone, or stands still."""
TURN_S = 0.15
"""How much later than its time a watchdog may act: turns of the mount's loop."""


@dataclass(frozen=True, slots=True)
class Loss:
    """One row. A time is None where nothing of ours ends the motion: the mount holds its last rate forever.

    `during_s` counts from the fault's begin while it lasts, `by_watchdog` where the watchdog's own time comes
    on top; `after_s` from the fault's end, for a run that is to stop. Braking comes on top of both.
    """

    key: str
    fault: str
    watchdog: bool | None
    """Whether the mount has one, a profile's `watchdog_s`; None where that makes no difference."""
    ours: str
    mounts: str
    during_s: float | None
    by_watchdog: bool
    after_s: float | None
    way_out: str


_UNREPORTED = (
    f"following by prediction after 0.3 s; after {STATUS_LOST_S:g} s stops are sent for {STOPS_SENT_S:g} s, "
    "then the run ends (exit code 4, stop not confirmed); the guardian keeps sending stops, "
    f"every {STOPS_SLOW_S:g} s for {STOPS_SLOW_FOR_S:g} s, then every {STOPS_SLOWEST_S:g} s, "
    "20 times a second when it hears the mount"
)
_SEES = "sees that the mount does not follow, and stops when an interlock trips; stops are lost as well"
_OBEYS = "obeys: brakes to rest"
_HOLDS = "**keeps its last rate forever**"
_BRAKES = "brakes to rest once `watchdog_s` have passed without a command"
_ABORTS = "the guardian sends the stop from the same port until positions show both axes at rest"
_DEAD = "nothing is left that could send"
_BY_HAND = "the mount's own console or power; once the link is back the guardian stops it"
_RESTARTS = (
    "if it is silent for 2 s or more, stops are sent as above; if it is back sooner, `track` continues, and "
    "other commands stop the mount"
)

CONTRACT = (
    Loss(
        "statuses",
        "statuses are lost, commands arrive",
        None,
        _UNREPORTED,
        _OBEYS,
        STATUS_LOST_S + OBEYED_S,
        False,
        OBEYED_S,
        "check the link, start again; after less than 2 s the pass continues",
    ),
    Loss(
        "commands",
        "commands are lost, statuses arrive",
        False,
        _SEES,
        _HOLDS,
        None,
        False,
        OBEYED_S,
        _BY_HAND,
    ),
    Loss(
        "commands-watchdog",
        "commands are lost, statuses arrive",
        True,
        "sees the mount at rest, and stops the run if that lasts",
        _BRAKES,
        TURN_S,
        True,
        OBEYED_S,
        "check the link, start again",
    ),
    Loss(
        "both",
        "both are lost: a cut cable, a switch",
        False,
        _UNREPORTED,
        _HOLDS,
        None,
        False,
        OBEYED_S,
        _BY_HAND,
    ),
    Loss(
        "both-watchdog",
        "both are lost: a cut cable, a switch",
        True,
        _UNREPORTED,
        _BRAKES,
        TURN_S,
        True,
        OBEYED_S,
        "check the link, start again",
    ),
    Loss(
        "feeder",
        "our process dies: killed, crashed, out of memory",
        None,
        _ABORTS,
        _OBEYS,
        NOTICED_S + OBEYED_S,
        False,
        None,
        "start again; `sattrack stop` reports the state",
    ),
    Loss(
        "hang",
        "our process hangs: halted, a disk that does not answer",
        None,
        f"after {HANG_S:g} s {_ABORTS}; the process finds, when it wakes, that it may not send, and ends",
        _OBEYS,
        HANG_S + NOTICED_S + OBEYED_S,
        False,
        None,
        "start again; if it never wakes, `sattrack stop` ends it",
    ),
    Loss(
        "machine",
        "our machine dies, or process and guardian at once",
        False,
        _DEAD,
        _HOLDS,
        None,
        False,
        OBEYED_S,
        "the mount's own console or power; `sattrack stop` from the restarted machine, or another",
    ),
    Loss(
        "machine-watchdog",
        "our machine dies, or process and guardian at once",
        True,
        _DEAD,
        _BRAKES,
        TURN_S,
        True,
        OBEYED_S,
        "start again",
    ),
    Loss(
        "mount-stops",
        "the mount's program ends, its drives brake with it",
        None,
        _RESTARTS,
        "the drives brake",
        TURN_S,
        False,
        OBEYED_S,
        "start its program; **the mount then tracks the sky** until it gets a command",
    ),
    Loss(
        "mount-holds",
        "the mount's program ends or freezes, its drives run on",
        None,
        _RESTARTS,
        "the drives **keep their last rate** until the program is back; a watchdog is down with it",
        None,
        False,
        OBEYED_S,
        "the drives' power; its program, restarted, gets the stop that is being sent",
    ),
)
ROWS = {row.key: row for row in CONTRACT}


def lets_go_after_s(overtaken_s: float) -> float:
    """Return for how long a stop lasts at least on a link that has had datagrams overtaken by so much."""
    return min(OVERTAKEN_SHARE * overtaken_s, MOST_OVERTAKEN_S)


def longest_stop_s(heard: bool) -> float:
    """Return how long a stop may take, seconds, before it is given up; `heard`: the mount answers."""
    return STOPS_MOVING_S if heard else STOPS_SENT_S


def braking_s(profile: MountProfile, rate_deg_s: float | None = None) -> float:
    """Return how long the slower axis takes to brake from a rate, deg/s; None: from its largest."""
    axes = zip((profile.ra, profile.dec), profile.braking_deg_s2, strict=True)
    return max(
        axis.lag_s + (axis.max_rate_deg_s if rate_deg_s is None else abs(rate_deg_s)) / braking_deg_s2
        for axis, braking_deg_s2 in axes
    )


def standstill_s(row: Loss, profile: MountProfile, rate_deg_s: float | None = None) -> float:
    """Return the longest time from a fault's begin to both axes at rest while it lasts; inf where never.

    `rate_deg_s` is the rate at hand, the profile's largest where it is None. For a row with a watchdog the
    profile must have one: raises ValueError.
    """
    if row.during_s is None:
        return NEVER_S
    own_s = profile.abort_delay_s
    if row.by_watchdog:
        if profile.watchdog_s is None:
            raise ValueError(f"{row.key}: the profile has no watchdog_s")
        own_s = profile.watchdog_s
    return row.during_s + own_s + braking_s(profile, rate_deg_s)


def standstill_after_s(row: Loss, profile: MountProfile, rate_deg_s: float | None = None) -> float:
    """Return the longest time from a fault's end to both axes at rest, for a run that is to stop."""
    if row.after_s is None:
        return NEVER_S
    return row.after_s + profile.abort_delay_s + braking_s(profile, rate_deg_s)
