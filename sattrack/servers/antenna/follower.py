"""Makes a mount of rates follow a way of hour angle and declination: the closed loop of the antenna.

Composed of the tracker's own parts: dated samples, filters, the history of commands, the mean rate over the
interval in which a command acts. What it adds is the turn of the hour angle axis, which the reported right
ascension does not tell: it is counted from the first sample on, taken to be within half a turn.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from sattrack.control.axes import Axes
from sattrack.control.feeder import Way, ramped_deg_s, rate_deg_s
from sattrack.control.history import EDGE_PERIODS, CommandHistory, MountLoop, SentRates
from sattrack.control.latency import KnownClock, MountClock
from sattrack.mount.model import Motion, MountProfile, MoveAxes, StatusSample

if TYPE_CHECKING:
    from collections.abc import Callable

    from sattrack.servers.antenna.trajectory import SiteSky

OLDEST_S = 0.3
"""A sample older than this says nothing of where the axes are now."""


class Stand(NamedTuple):
    """How the axes stand: hour angle with its turn, and declination, degrees; their rates."""

    ha_deg: float
    dec_deg: float
    ha_rate_deg_s: float
    dec_rate_deg_s: float


Wanted = tuple[float, float]
"""Hour angle with its turn, and declination, degrees."""


class Follower:
    """Follows one way after another with one mount."""

    def __init__(self, profile: MountProfile, sky: SiteSky) -> None:
        self._profile = profile
        self._sky = sky
        known = None
        if profile.clock_offset_s is not None:
            known = KnownClock(sky.site.longitude_deg, profile.clock_offset_s)
        self._clock = MountClock(profile.status_delay_s, known)
        self._loop = MountLoop(profile.period_s)
        self._history = CommandHistory(profile.command_delay_s, self._loop)
        self._axes: Axes | None = None
        self._ha_deg = 0.0
        self._commanding = False
        self._acting_s = profile.period_s * (EDGE_PERIODS if profile.move_axis == "edge" else 1.0)

    def follow_on(self, former: Follower) -> None:
        """Take over the turn of the hour angle axis from a former one."""
        self._ha_deg = former._ha_deg

    @property
    def sample_utc_s(self) -> float | None:
        """When the last sample was taken, by our clock; None before the first."""
        return None if self._axes is None else self._axes.sample_utc_s

    def take(self, sample: StatusSample) -> float:
        """Take in one sample; return its instant."""
        utc_s = self._clock.date(sample.sidereal_h, sample.arrival_utc_s)
        self._loop.note(sample.counter, utc_s)
        axes = self._axes
        if axes is None or not axes.follows(utc_s):
            axes = Axes.begin(self._profile, self._history, sample, utc_s, former=axes)
        else:
            axes.take(sample, utc_s, self._commanding)
            if axes.lost:
                axes = Axes.begin(self._profile, self._history, sample, utc_s, former=axes)
        self._axes = axes
        self._ha_deg = self._turned(self._sky.sidereal_deg(utc_s) - axes.ra.position_deg)
        return utc_s

    def stand(self, utc_s: float) -> Stand | None:
        """Return how the axes stand at an instant near the last sample; None where nobody knows.

        What it tells was measured a period of the mount's loop and its delay ago at most, while the link is
        up, and is carried on by what was commanded since.
        """
        axes = self._axes
        if axes is None or abs(utc_s - axes.sample_utc_s) > OLDEST_S:
            return None
        ra, dec, ra_rate, dec_rate = self._predicted(axes, utc_s)
        turn = self._sky.sidereal_rate_deg_s(utc_s)
        ha = self._turned(self._sky.sidereal_deg(utc_s) - ra)
        return Stand(ha, dec, turn - ra_rate, dec_rate)

    def follow(self, now_utc_s: float, way: Callable[[float], Wanted]) -> MoveAxes | None:
        """Return the rates to command now to follow a way, None before the first sample."""
        axes, profile = self._axes, self._profile
        if axes is None:
            return None
        arrives = now_utc_s + profile.command_delay_s
        acts = self._loop.first_from(max(arrives, axes.sample_utc_s + 0.5 * self._loop.mean_period_s))
        interval = max(self._loop.first_from(arrives + self._acting_s) - acts, self._loop.mean_period_s)
        ahead_s = 0.5 * (axes.ra.lag.mean_s + axes.dec.lag.mean_s)
        begins = acts + ahead_s
        begin, middle, end = (way(begins + share * interval) for share in (0.0, 0.5, 1.0))
        (ra, dec), before = axes.bound_for(acts)
        late_s = axes.ra.lag.mean_s - ahead_s
        sky = self._sky.sidereal_rate_deg_s(acts)
        bound_ha = self._turned(self._sky.sidereal_deg(acts + axes.ra.lag.mean_s) - ra)
        bend = [4.0 * (a - 2.0 * b + c) / interval**2 for a, b, c in zip(begin, middle, end, strict=True)]
        # Right ascension runs against the hour angle, which knows the turn.
        ra_way = Way(-begin[0], sky * interval - (end[0] - begin[0]), interval, -bend[0], ahead_s)
        dec_way = Way(begin[1], end[1] - begin[1], interval, bend[1], ahead_s)
        ra_rate = rate_deg_s(ra_way, sky * late_s - bound_ha, axes.ra, profile.ra, profile.ra.max_rate_deg_s)
        dec_rate = rate_deg_s(dec_way, dec, axes.dec, profile.dec, profile.dec.max_rate_deg_s)
        return MoveAxes(
            ramped_deg_s(ra_rate, before[0], profile.ra, interval),
            ramped_deg_s(dec_rate, before[1], profile.dec, interval),
        )

    def note_sent(self, motion: Motion, now_utc_s: float) -> None:
        """Note what was really sent, after safety had its say."""
        self._commanding = isinstance(motion, MoveAxes)
        if isinstance(motion, MoveAxes):
            self._history.add(SentRates(now_utc_s, motion.ra_rate_deg_s, motion.dec_rate_deg_s))
        else:
            self._history.clear()

    def send_shift_s(self, now_utc_s: float) -> float:
        """Return the delay of the next datagram beyond one period, seconds of UTC."""
        return self._loop.send_shift_s(now_utc_s + self._profile.command_delay_s)

    def _predicted(self, axes: Axes, utc_s: float) -> tuple[float, float, float, float]:
        """Return right ascension, declination and their rates at an instant near the last sample."""
        ahead_s = utc_s - axes.sample_utc_s
        moved_ra, moved_dec = axes.moved_by(utc_s) if ahead_s > 0.0 and self._commanding else (0.0, 0.0)
        rates = axes.rates_deg_s
        if ahead_s <= 0.0 or not self._commanding:
            moved_ra, moved_dec = rates[0] * ahead_s, rates[1] * ahead_s
        ra_gain, dec_gain = 1.0 + axes.ra.gain_error, 1.0 + axes.dec.gain_error
        return (
            axes.ra.position_deg + moved_ra + axes.ra.disturbance_deg_s * ahead_s,
            axes.dec.position_deg + moved_dec + axes.dec.disturbance_deg_s * ahead_s,
            rates[0] * ra_gain + axes.ra.disturbance_deg_s,
            rates[1] * dec_gain + axes.dec.disturbance_deg_s,
        )

    def _turned(self, ha_deg: float) -> float:
        """Return an hour angle on the turn that the axis is on."""
        return self._ha_deg + math.remainder(ha_deg - self._ha_deg, 360.0)
