"""Follows a target with both axes of a mount by rates: samples in, rates out. Pure.

A satellite and a trajectory are followed alike: each is a `Target`, which says where the axes must be over
the interval in which a command acts. The caller decides when to follow, and how the mount gets near.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, Protocol

from sattrack.control.axes import Axes
from sattrack.control.feeder import AxisPath, Learning, ramped_deg_s, rate_deg_s
from sattrack.control.history import EDGE_PERIODS, CommandHistory, MountLoop, SentRates
from sattrack.control.latency import KnownClock, MountClock
from sattrack.control.law import ControlLaw
from sattrack.mount.model import MoveAxes

if TYPE_CHECKING:
    from sattrack.mount.model import Motion, MountProfile, StatusSample

IDLE_SHIFT_S, IDLE_SHIFT_SHARE = 0.002, 0.2
"""How fast the sending falls into step with the mount's loop before anything is followed."""
UNDATED_AT_MOST = 15
"""Samples in a row dated no later than the one before that are left out: a clock is learnt anew meanwhile."""
MOST_EDGE_PERIODS = 12.0
"""The longest that the rates of one edge act: until the next, which the handshake lets through."""
Pair = tuple[float, float]
"""A value of the right ascension axis, and one of the declination axis."""


class TargetSpan(NamedTuple):
    """A target over the interval in which a command acts: right ascension and declination of the axes.

    Degrees and seconds. `bound_deg` is where the axes are bound for, on the turns that the target is on.
    """

    begin_deg: Pair
    move_deg: Pair
    acceleration_deg_s2: Pair
    bound_deg: Pair


class Target(Protocol):
    """What is followed."""

    def span(self, begin_utc_s: float, interval_s: float, bound_deg: Pair) -> TargetSpan:
        """Return the target from an instant on; `bound_deg` is where commands so far lead the axes."""


class Follower:
    """Follows one target after another with one mount: its clock, its loop, its axes, what it was sent."""

    def __init__(self, profile: MountProfile, longitude_deg: float, law: ControlLaw | None = None) -> None:
        self._profile = profile
        self._law = ControlLaw() if law is None else law
        known = None
        if profile.clock_offset_s is not None:
            known = KnownClock(longitude_deg, profile.clock_offset_s)
        self.clock = MountClock(profile.status_delay_s, known, profile.period_s)
        self._loop = MountLoop(profile.period_s)
        self._history = CommandHistory(profile.command_delay_s, self._loop)
        self.axes: Axes | None = None
        """The axes as of the last sample; None before the first."""
        self.learning = Learning()
        """What is learnt of the mount while it follows."""
        self.lost_utc_s: float | None = None
        """When the mount was last seen where nothing that is known leads."""
        self._undated = 0
        self._last_edge_utc_s: float | None = None
        self._acting_s = profile.period_s * (EDGE_PERIODS if profile.move_axis == "edge" else 1.0)
        """For how long a command that is sent is expected to act."""

    @property
    def command_delay_s(self) -> float:
        """From sending to the mailbox, as it is reckoned with, seconds."""
        return self._history.delay_s

    @property
    def acting_s(self) -> float:
        """For how long a command acts, seconds."""
        return max(self._loop.mean_period_s, self._acting_s)

    def date(self, sample: StatusSample) -> float:
        """Return the instant of a sample, UTC as POSIX seconds; call once for each, in order of arrival."""
        utc_s = self.clock.date(sample.sidereal_h, sample.arrival_utc_s, sample.counter)
        self._loop.note(sample.counter, utc_s)
        return utc_s

    def take(self, sample: StatusSample, utc_s: float, following: bool) -> bool:
        """Bring the axes to a sample of an instant; return whether it was believed.

        `following` where the mount moves by the rates that were sent, and not by a plan of its own.
        """
        axes = self.axes
        undated = axes is not None and utc_s <= axes.sample_utc_s
        self._undated = self._undated + 1 if undated else 0
        if 0 < self._undated <= UNDATED_AT_MOST:
            return False
        if axes is None or not axes.follows(utc_s):
            self._begin(sample, utc_s, following)
            return True
        believed = axes.take(sample, utc_s, following)
        if believed and following:
            self.learning.take(axes, sample, utc_s)
        else:
            self.learning.pause()
        if axes.early:
            self._history.arrives_early()
        if axes.lost:
            self.lost_utc_s = utc_s
            self._begin(sample, utc_s, following)
        return believed

    def _begin(self, sample: StatusSample, utc_s: float, following: bool) -> None:
        if self.axes is not None and self.axes is self.learning.axes and following:
            self.learning.anew()
        self.axes = Axes.begin(
            self._profile, self._history, sample, utc_s, self._law.filter, former=self.axes
        )

    def forget_axes(self) -> None:
        """Begin anew with the next sample."""
        self.axes = None

    def follow(self, now_utc_s: float, target: Target, share: float = 1.0) -> MoveAxes | None:
        """Return the rates to command now; None before the first sample.

        `share` of the axes' rates is the most that a correction may ask for.
        """
        axes, profile, law = self.axes, self._profile, self._law.feeder
        if axes is None:
            return None
        # The mount obeys at its first loop after this command has arrived, until the first after the next.
        arrives = now_utc_s + self._history.delay_s
        acts = self._loop.first_from(max(arrives, axes.sample_utc_s + 0.5 * self._loop.mean_period_s))
        interval = max(self._loop.first_from(arrives + self._acting_s) - acts, self._loop.mean_period_s)
        ahead_s = self._ahead_s(axes)
        bound_for, before = axes.bound_for(acts)
        span = target.span(acts + ahead_s, interval, bound_for)
        rates = []
        for number, (axis, limits) in enumerate(((axes.ra, profile.ra), (axes.dec, profile.dec))):
            begin, move, bend = (
                span.begin_deg[number],
                span.move_deg[number],
                span.acceleration_deg_s2[number],
            )
            way = AxisPath(begin, move, interval, bend, ahead_s)
            limit = share * limits.max_rate_deg_s
            rate = rate_deg_s(way, span.bound_deg[number], axis, limits, limit, law)
            rates.append(ramped_deg_s(rate, before[number], limits, interval, law))
        return MoveAxes(rates[0], rates[1])

    def _ahead_s(self, axes: Axes) -> float:
        """Return for how much later than they act commands are made: the axes' lag, in whole turns."""
        period_s = self._loop.mean_period_s
        return period_s * round(0.5 * (axes.ra.lag.mean_s + axes.dec.lag.mean_s) / period_s)

    def axes_at(self, utc_s: float, following: bool) -> tuple[Pair, Pair] | None:
        """Return places and rates of the axes at an instant near the last sample, by the commands since.

        Right ascension and declination, degrees and degrees a second. None before the first sample.
        """
        axes = self.axes
        if axes is None:
            return None
        later_s = utc_s - axes.sample_utc_s
        rates = axes.rates_deg_s
        moved = (
            axes.moved_by(utc_s) if following and later_s > 0.0 else (rates[0] * later_s, rates[1] * later_s)
        )
        ra, dec = axes.ra, axes.dec
        places = (
            ra.position_deg + moved[0] + ra.disturbance_deg_s * later_s,
            dec.position_deg + moved[1] + dec.disturbance_deg_s * later_s,
        )
        return places, (
            rates[0] * (1.0 + ra.gain_error) + ra.disturbance_deg_s,
            rates[1] * (1.0 + dec.gain_error) + dec.disturbance_deg_s,
        )

    def note_sent(self, motion: Motion, now_utc_s: float) -> None:
        """Note what was really sent, after safety had its say: the filters are driven by that."""
        if not isinstance(motion, MoveAxes):
            self._history.clear()
            return
        if self._profile.move_axis == "edge":
            self._note_cycle(now_utc_s)
        self._history.add(SentRates(now_utc_s, motion.ra_rate_deg_s, motion.dec_rate_deg_s))

    def _note_cycle(self, now_utc_s: float) -> None:
        """Learn how long the handshake of an edge takes: for so long the rates that it brought will act."""
        last_utc_s, self._last_edge_utc_s = self._last_edge_utc_s, now_utc_s
        if last_utc_s is not None:
            periods = (now_utc_s - last_utc_s) / self._profile.period_s
            self._acting_s = max(2.0, min(MOST_EDGE_PERIODS, periods)) * self._profile.period_s

    def send_shift_s(self, now_utc_s: float, following: bool = True) -> float:
        """Return the delay of the next datagram beyond one period from now, seconds."""
        arrival_utc_s = now_utc_s + self._history.delay_s
        if not following:
            return self._loop.send_shift_s(arrival_utc_s, IDLE_SHIFT_S, IDLE_SHIFT_SHARE)
        return self._loop.send_shift_s(arrival_utc_s)
