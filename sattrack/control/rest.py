"""What the mount is to do while a pass is paused: come to rest, stand, and be jogged by hand. Pure."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from sattrack.control.jogs import Jogs
from sattrack.mount.link_loss import STOP_LINGER_S
from sattrack.mount.model import SIDEREAL_RATE_DEG_S, Hold, Motion, MoveAxes, Stop
from sattrack.mount.requests import MoveAxis, objection

if TYPE_CHECKING:
    from sattrack.mount.model import MountProfile, StatusSample
    from sattrack.views.messages import Jog

SETTLING_S = 0.5
"""After a jog the axes are told to rest for so long and for the time that they brake, before the stop: what
comes next, another jog or going on, is then judged with the motion that is still there."""
STOPPING = "the mount is coming to rest: jog once it stands"
GOING_ON = "the run is about to go on"
STANDING = MoveAxes(SIDEREAL_RATE_DEG_S, 0.0)
"""The rates of the reported direction while the axes stand."""
WITH_THE_SKY = MoveAxes(0.0, 0.0)


class Rest:
    """One pause, from the word to bring the mount to rest.

    A jog adds to what the axes do at rest. Those of most mounts stand; one that takes to the sky by itself
    is told to do just that, period by period, so that safety judges where it leads.
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
        """Until when the axes are told to rest after a jog."""
        self.at_rest = False
        """Whether the mount was seen at rest since it was last told to stop."""
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
        """Whether a mount at rest is told rates, period by period."""
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
