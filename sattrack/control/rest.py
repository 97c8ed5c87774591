"""What the mount is to do while a pass is paused: come to rest, stand, and be jogged by hand. Pure.

Jogs by an operator's keys: kept going only by being asked for again; silence ends them. Pure.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from sattrack.mount.link_loss import STOP_LINGER_S
from sattrack.mount.model import SIDEREAL_RATE_DEG_S, Hold, Motion, MoveAxes, Stop
from sattrack.mount.requests import MoveAxis, objection

if TYPE_CHECKING:
    from sattrack.mount.model import MountProfile, StatusSample
    from sattrack.views.messages import Jog

FIRST_JOG_S = 0.5
"""How long an axis moves at the first touch."""
NEXT_JOG_S = 0.3
"""How long it moves on after each touch that follows while it moves."""
FRESH_TOUCH_S = 0.4
"""After a stop, touches that follow one another more closely than this are still those of a held key."""


@dataclass(slots=True)
class _Jog:
    rate_deg_s: float
    until_utc_s: float


class Jogs:
    """Which axes are jogged, how fast and until when; true while any is. UTC as POSIX seconds."""

    def __init__(self) -> None:
        self._axes: dict[str, _Jog] = {}
        self._touched_utc_s = -math.inf
        self.blocked = False
        """Whether touches are those of a key that was held while a stop came."""

    def __bool__(self) -> bool:
        """Tell whether any axis is jogged."""
        return bool(self._axes)

    @property
    def rates_deg_s(self) -> tuple[float, float]:
        """The rates of right ascension and declination; 0 for an axis that is not jogged."""
        ra, dec = self._axes.get("ra"), self._axes.get("dec")
        return 0.0 if ra is None else ra.rate_deg_s, 0.0 if dec is None else dec.rate_deg_s

    def is_fresh(self, now_utc_s: float) -> bool:
        """Note a touch; tell whether it is one by itself, and not one of a key that has been held."""
        fresh = now_utc_s - self._touched_utc_s > FRESH_TOUCH_S
        self._touched_utc_s = now_utc_s
        return fresh

    def move(self, ra_rate_deg_s: float | None, dec_rate_deg_s: float | None, now_utc_s: float) -> None:
        """Move for FIRST_JOG_S, or for NEXT_JOG_S more where an axis is being jogged at that rate already."""
        self.blocked = False
        for axis, rate in (("ra", ra_rate_deg_s), ("dec", dec_rate_deg_s)):
            if rate is None:
                continue
            before = self._axes.get(axis)
            if before is not None and before.rate_deg_s == rate:
                before.until_utc_s = max(before.until_utc_s, now_utc_s + NEXT_JOG_S)
            else:
                self._axes[axis] = _Jog(rate, now_utc_s + FIRST_JOG_S)

    def end_over(self, now_utc_s: float) -> bool:
        """End the jogs whose time is over; tell whether there were any."""
        over = [axis for axis, jog in self._axes.items() if now_utc_s >= jog.until_utc_s]
        for axis in over:
            del self._axes[axis]
        return bool(over)

    def clear(self) -> None:
        """End all of them."""
        self._axes.clear()

    def block(self) -> None:
        """End all of them for a stop: a key that goes on being held does nothing."""
        self._axes.clear()
        self.blocked = True


SETTLING_S = 0.5
"""After a jog the axes are commanded to rest for so long and while they brake, before the stop: what
comes next, another jog or going on, is then judged with the motion that is still there."""
STOPPING = "the mount is coming to rest: jog once it stands"
GOING_ON = "the run is about to go on"
STANDING = MoveAxes(SIDEREAL_RATE_DEG_S, 0.0)
"""The rates of the reported direction while the axes stand."""
WITH_THE_SKY = MoveAxes(0.0, 0.0)


class Rest:
    """One pause, from the word to bring the mount to rest.

    A jog adds to what the axes do at rest. Those of most mounts stand; one that takes to the sky by itself
    is commanded to do just that, period by period, so that safety judges where it leads.
    """

    def __init__(self, begun_utc_s: float, profile: MountProfile) -> None:
        self.begun_utc_s = begun_utc_s
        self.going_on = False
        """Whether the run goes on as soon as the mount is at rest."""
        self._profile = profile
        self._brakes_s = max(
            axis.max_rate_deg_s / axis.max_acceleration_deg_s2 for axis in (profile.ra, profile.dec)
        )
        self._settled_utc_s = -math.inf
        """Until when the axes are commanded to rest after a jog."""
        self.at_rest = False
        """Whether the mount was seen at rest since it was last asked to stop."""
        self._stands = False
        """Whether the mount has come to rest from what it did before, so that an axis may be jogged."""
        self._rest_since_utc_s: float | None = None
        self._jogs = Jogs()
        self._ended_for = ""
        self._turns = True
        self._at_rest_rates = STANDING

    @property
    def jogging(self) -> bool:
        """Whether an axis is being moved by hand."""
        return bool(self._jogs)

    @property
    def streams(self) -> bool:
        """Whether a mount at rest is sent rates, period by period."""
        return self.at_rest and self._at_rest_rates is WITH_THE_SKY

    def see(self, sample: StatusSample) -> None:
        """Take one status: how the hour angle's drive turns.

        Axes that stood and follow the sky, as after a slew out of the Sun's way, are brought to rest again.
        """
        self._turns = abs(sample.ra_drive_deg_s) > 0.5 * SIDEREAL_RATE_DEG_S
        if self._turns and self.at_rest and self._at_rest_rates is STANDING and not sample.slewing:
            self._begin_anew()

    def step(self, now_utc_s: float, stopped: bool) -> Motion:
        """Return the motion wanted from now on; `stopped` where the stop asked for was seen through."""
        if self._jogs.end_over(now_utc_s) and not self._jogs:
            self._begin_anew()
            self._settled_utc_s = now_utc_s + self._brakes_s + SETTLING_S
        if self._jogs or now_utc_s < self._settled_utc_s:
            ra, dec = self._jogs.rates_deg_s
            rest = self._at_rest_rates
            return MoveAxes(rest.ra_rate_deg_s + ra, rest.dec_rate_deg_s + dec)
        if not self.at_rest:
            self._watch_stop(now_utc_s, stopped)
        if not self.at_rest:
            return Stop()
        return WITH_THE_SKY if self._at_rest_rates is WITH_THE_SKY else Hold()

    def jog(self, order: Jog, now_utc_s: float) -> str | None:
        """Move an axis by one touch; return why not, in words."""
        fresh = self._jogs.is_fresh(now_utc_s)
        if self._jogs.blocked and not (fresh and self._stands):
            return self._ended_for
        if not self._stands:
            return STOPPING
        if self.going_on:
            return GOING_ON
        why = objection(MoveAxis(order.ra_rate_deg_s, order.dec_rate_deg_s), self._profile)
        if why is None:
            self._jogs.move(order.ra_rate_deg_s, order.dec_rate_deg_s, now_utc_s)
            self.at_rest = False
        return why

    def end_jogs(self, why: str) -> None:
        """End what is jogged, and why, in words: the mount comes to rest, and a held key does nothing."""
        self._ended_for = why
        self._jogs.block()
        self._stop()

    def go_on(self) -> None:
        """Have the run go on as soon as the mount is at rest: what is jogged ends."""
        self.going_on = True
        if not self.at_rest:
            self._jogs.clear()
            self._stop()

    def _stop(self) -> None:
        self._settled_utc_s, self._stands = -math.inf, False
        self._begin_anew()

    def _begin_anew(self) -> None:
        self.at_rest, self._rest_since_utc_s = False, None

    def _watch_stop(self, now_utc_s: float, stopped: bool) -> None:
        if not stopped:
            self._rest_since_utc_s = None
        elif self._rest_since_utc_s is None:
            self._rest_since_utc_s = now_utc_s
        elif now_utc_s - self._rest_since_utc_s >= STOP_LINGER_S:
            self._at_rest_rates = WITH_THE_SKY if self._turns else STANDING
            self.at_rest = self._stands = True
