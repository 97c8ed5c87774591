"""Follows a target with both axes of a mount by rates: samples in, rates out. Pure.

A satellite and a trajectory are followed alike: each is a `Target`, which says where the axes must be over
the interval in which a command acts. The caller decides when to follow, and how the mount gets near.

A commanded rate is held until the next one acts, so what counts is the mean over that interval, a difference
of positions, not the instantaneous rate at sending. A servo answers late: the command is the motion that the
target makes a mean lag later, and the error is counted for when everything commanded so far has come out.
What a run learns of a mount while it follows is the lag and the gain of each axis, and how surely.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import msgspec
import numpy as np

from sattrack.control.axes import EDGE_PERIODS, SAME_S, Axes, CommandHistory, MountLoop, SentRates
from sattrack.control.axis_filter import TURN_S, Noise
from sattrack.control.latency import CALIBRATED_S, ROUGH_S, KnownClock, MountClock
from sattrack.core.angles import wrap180
from sattrack.mount.model import MoveAxes

if TYPE_CHECKING:
    from sattrack.control.axis_filter import Array, AxisFilter
    from sattrack.control.target import Pair, Target
    from sattrack.mount.model import Motion, MountProfile, StatusSample

IDLE_SHIFT_S, IDLE_SHIFT_SHARE = 0.002, 0.2
"""How fast the sending falls into step with the mount's loop before anything is followed, and always where a
handshake says when rates change."""
UNDATED_AT_MOST = 15
"""Samples in a row dated no later than the one before are left out: a clock is learnt anew meanwhile."""
ANSWERED_PERIODS, UNANSWERED_PERIODS = 12.0, 40.0
"""The longest that the rates of one edge act: until the next, which the handshake lets through. It goes on
for longer where the mount does not acknowledge them."""
ANSWERED_AHEAD_S = 0.006
"""A status that answers a handshake's datagram should arrive this long before the next is sent."""
READ_AHEAD_S = 0.0005
"""A handshake's datagram should arrive this long before the turn that reads it."""
UNSURE_S = 0.004
"""A delay of the commands that is known no better, one sigma, is looked for by when datagrams are sent."""
MOST_SOUGHT = 64
"""For so many acknowledgements at most: if they say nothing, more of them will not either."""


class Follower:
    """Follows one target after another with one mount: its clock, its loop, its axes, what it was sent."""

    def __init__(self, profile: MountProfile, longitude_deg: float, law: ControlLaw | None = None) -> None:
        self._profile = profile
        self._law = ControlLaw() if law is None else law
        known = None
        if profile.clock_offset_s is not None:
            known = KnownClock(longitude_deg, profile.clock_offset_s)
        self.clock = MountClock(
            profile.status_delay_s, known, profile.period_s, known_is_ours=profile.dated_by_requests
        )
        self._loop = MountLoop(profile.period_s)
        sigma_s = ROUGH_S if profile.calibration is None else CALIBRATED_S
        self._history = CommandHistory(profile.command_delay_s, self._loop, sigma_s)
        self.axes: Axes | None = None
        """The axes as of the last sample; None before the first."""
        self._raised_utc_s: float | None = None
        """When the MoveAxis flags were raised, with the rates that are in force; None while they are down."""
        self.learning = Learning()
        """What is learnt of the mount while it follows."""
        self.lost_utc_s: float | None = None
        """When the mount was last seen where nothing that is known leads."""
        self._undated = 0
        self._last_edge_utc_s: float | None = None
        self._answered = False
        """Whether the edge that was sent last was acknowledged."""
        self._acting_s = profile.period_s * (EDGE_PERIODS if profile.move_axis == "edge" else 1.0)
        """For how long a command that is sent is expected to act."""
        self._sought_from: int | None = None
        """How many acknowledgements were noted when the delay began to be looked for; None before."""

    @property
    def command_delay_s(self) -> float:
        """From sending to the mailbox, as assumed, seconds."""
        return self._history.delay_s

    @property
    def command_delay_sigma_s(self) -> float:
        """How surely acknowledgements tell that, seconds."""
        return self._history.acknowledged.delay_s[1]

    @property
    def acting_s(self) -> float:
        """For how long a command acts, seconds."""
        return max(self._loop.mean_period_s, self._acting_s)

    @property
    def unanswered(self) -> bool:
        """Whether commands act for longer than by any handshake that is answered."""
        return self._acting_s > ANSWERED_PERIODS * self._profile.period_s

    @property
    def settling_s(self) -> float | None:
        """The time constant in force, of the slower axis; None before following began."""
        return self.learning.settling_s(self.acting_s, self._law.feeder)

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
        self._answered = self._answered or sample.move_acknowledged
        undated = axes is not None and utc_s - axes.sample_utc_s <= SAME_S
        self._undated = self._undated + 1 if undated else 0
        if 0 < self._undated <= UNDATED_AT_MOST:
            return False
        if axes is None or not axes.follows(utc_s):
            self._begin(sample, utc_s, following)
            return True
        if sample.move_acknowledged and following and self._raised_utc_s is not None:
            axes.acknowledge(self._raised_utc_s, utc_s)
        believed = axes.take(sample, utc_s, following)
        if believed and following:
            self.learning.take(axes, sample, utc_s)
        else:
            self.learning.pause()
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

    def arrive(self, led: bool) -> None:
        """Note that the target is reached: what was learnt of the axes on the way is less sure.

        `led` where all of the way was by rates, at the drives' limit.
        """
        self.learning.forget_rates()
        axes = self.axes
        if axes is None:
            return
        for axis, rate_deg_s in zip((axes.ra, axes.dec), axes.rates_deg_s, strict=True):
            axis.doubt_gain(rate_deg_s)
            if led:
                axis.doubt_response()

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
            most_deg_s2 = axes.drives[number].acceleration_deg_s2
            begin, move, bend = (
                span.begin_deg[number],
                span.move_deg[number],
                span.acceleration_deg_s2[number],
            )
            way = AxisCourse(begin, move, interval, bend, ahead_s)
            limit = share * limits.max_rate_deg_s
            rate = rate_deg_s(way, span.bound_deg[number], axis, most_deg_s2, limit, law)
            rates.append(ramped_deg_s(rate, before[number], most_deg_s2, interval, law))
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
            self._raised_utc_s = None
            return
        if self._profile.move_axis == "edge":
            self._note_cycle(now_utc_s)
        if self._profile.move_axis == "edge" or self._raised_utc_s is None:
            self._raised_utc_s = now_utc_s
        self._history.add(SentRates(now_utc_s, motion.ra_rate_deg_s, motion.dec_rate_deg_s))

    def _note_cycle(self, now_utc_s: float) -> None:
        """Learn how long the handshake of an edge takes: for so long the rates that it brought will act."""
        last_utc_s, self._last_edge_utc_s = self._last_edge_utc_s, now_utc_s
        most = ANSWERED_PERIODS if self._answered else UNANSWERED_PERIODS
        self._answered = False
        if last_utc_s is not None:
            periods = (now_utc_s - last_utc_s) / self._profile.period_s
            self._acting_s = max(2.0, min(most, periods)) * self._profile.period_s

    def send_shift_s(self, now_utc_s: float, following: bool = True, on_target: bool = True) -> float:
        """Return the delay of the next datagram beyond one period from now, seconds.

        `following` while rates are streamed, `on_target` once the target was acquired by them.
        """
        arrival_utc_s = now_utc_s + self._history.delay_s
        early_s = None
        if self._profile.move_axis == "edge":
            early_s = 0.0 if self._seeks_delay(on_target) else self._early_s()
        if not following or early_s is not None:
            return self._loop.send_shift_s(arrival_utc_s, IDLE_SHIFT_S, IDLE_SHIFT_SHARE, early_s)
        return self._loop.send_shift_s(arrival_utc_s)

    def _seeks_delay(self, on_target: bool) -> bool:
        """Tell whether datagrams are to arrive just with a turn, to find the delay, and note since when.

        Whether it is that turn which acknowledges halves what is not known. Not on the way to the target: the
        handshake takes a turn more now and then meanwhile.
        """
        if not (on_target and self.command_delay_sigma_s > UNSURE_S):
            return False
        noted = self._history.acknowledged.noted
        self._sought_from = noted if self._sought_from is None else self._sought_from
        return noted < self._sought_from + MOST_SOUGHT

    def _early_s(self) -> float:
        """Return how long before a turn of the mount datagrams of a handshake should arrive, seconds.

        The delays leave a part of the period to spare. It is shared between the wait at the mount and that
        here, where the answer must not miss the next datagram: else the handshake takes a turn more. Only the
        sum of the delays counts for this, not how it is split.
        """
        period_s = self._loop.mean_period_s
        here_s = ANSWERED_AHEAD_S + self.clock.lateness_s
        spare_s = -(self._history.delay_s + self._profile.status_delay_s) % period_s
        if spare_s < READ_AHEAD_S + self._loop.scatter_s + here_s:
            # So little is missed now and then, and the turns at which rates change would not be known ahead.
            spare_s += period_s
        # What a delay that is not known well may take more comes out of the wait here.
        surely_s = spare_s - self.command_delay_sigma_s
        return (spare_s - max(0.5 * surely_s, here_s)) % period_s


class FeederLaw(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How an error is taken out. Raises ValueError for what no loop can be run with."""

    settling_s: float = 0.1
    """Least time constant with which a small error is taken out."""
    intervals: float = 1.25
    """That time constant over the interval in which a command acts, at least."""
    lags: float = 0.5
    """That time constant over the servo's mean lag, at least."""
    lag_sigmas: float = 4.0
    """That time constant over the uncertainty of the lag, at least."""
    ramp_share: float = 0.5
    """Share of the axis' acceleration with which the commanded rate may change."""
    braking_share: float = 0.35
    """Share of the axis' acceleration that a large error's approach may plan with."""
    tracking_share: float = 0.1
    """Share of the axis' rate that a correction may ask for beyond the target's, once on the target: no more
    comes of wrong samples."""

    def __post_init__(self) -> None:
        """Check the numbers."""
        if not 0.0 < self.settling_s < math.inf:
            raise ValueError(f"settling_s is {self.settling_s:g}; it must be above 0")
        if not 0.0 < self.braking_share <= 1.0:
            raise ValueError(f"braking_share is {self.braking_share:g}; it must be above 0, and 1 at most")
        if not 0.0 < self.tracking_share <= 1.0:
            raise ValueError(f"tracking_share is {self.tracking_share:g}; it must be above 0, and 1 at most")


class ControlLaw(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The feeder's constants, and what the axes' filters expect."""

    feeder: FeederLaw = FeederLaw()
    filter: Noise = Noise()


REST_DEG_S = 3.0 / 3600.0
"""How fast an axis may move beside its commands, one sigma."""
FREE_REST_DEG_S = 60.0 / 3600.0
"""That where nothing is presumed of it."""
LEAST_NOISE_DEG_S = 0.5 / 3600.0
LEAST_RATE_DEG_S = 0.01
"""Slower commands, in the mean, tell nothing of a gain."""
ALIKE_SAMPLES = 40.0
"""Residuals of so many samples in a row count as one: a servo's error lasts."""
LEAST_SAMPLES = 100


class RateLine(NamedTuple):
    """What comes of a commanded rate, divided by it, and what is left, degrees a second; one sigma each."""

    gain: float
    gain_sigma: float
    rest_deg_s: float
    rest_sigma_deg_s: float


class RateFit:
    """A line through the rates seen against those commanded, of one axis.

    While the rate hardly changes, the filter shares a wrong gain out between its gain and its rate
    disturbance. Here both are found from all of a pass.
    """

    def __init__(self) -> None:
        self.samples = 0
        self.fastest_deg_s = self.fastest_asked_deg_s = 0.0
        """The fastest rates that were seen and commanded, in either direction."""
        self._sums = [0.0, 0.0, 0.0, 0.0, 0.0]

    def take(self, commanded_deg_s: float, seen_deg_s: float) -> None:
        """Take the mean rates between two samples; the commanded one as the servo answers it."""
        self.samples += 1
        c, m = commanded_deg_s, seen_deg_s
        self.fastest_asked_deg_s = max(self.fastest_asked_deg_s, abs(c))
        self.fastest_deg_s = max(self.fastest_deg_s, abs(m))
        for place, value in enumerate((c, m, c * c, c * m, m * m)):
            self._sums[place] += value

    @property
    def ratio(self) -> float | None:
        """What came of the commanded rates, over them; None where nearly none were commanded."""
        _, _, cc, cm, _ = self._sums
        small = cc <= self.samples * LEAST_RATE_DEG_S**2
        return None if self.samples < LEAST_SAMPLES or small else cm / cc

    def line(self, rest_deg_s: float = REST_DEG_S) -> RateLine | None:
        """Return the line; None before there are samples enough.

        `rest_deg_s` is how fast the axis may move beside its commands, one sigma.
        """
        n, (c, m, cc, cm, mm) = self.samples, self._sums
        if n < LEAST_SAMPLES or cc == 0.0:
            return None
        variance = LEAST_NOISE_DEG_S**2
        gain = rest = determinant = known = 0.0
        for _ in range(3):
            known = n + variance * ALIKE_SAMPLES / rest_deg_s**2
            determinant = cc * known - c * c
            gain = (cm * known - c * m) / determinant
            rest = (cc * m - c * cm) / determinant
            left = mm - 2.0 * (gain * cm + rest * m) + gain * (gain * cc + 2.0 * rest * c) + n * rest * rest
            variance = max(left / n, LEAST_NOISE_DEG_S**2)
        scale = ALIKE_SAMPLES * variance / determinant
        return RateLine(gain, math.sqrt(scale * known), rest, math.sqrt(scale * cc))


SHIFTS_S = np.arange(-1.5, 1.5 + 1e-9, 0.025)
REMEMBERED, LEAST_TURNS = 400, 60
EXPLAINS, FAILS = 0.25, 4.0
"""Share of the seen rates' variance that a shift may leave, and how much more the profile's must."""
GAIN_OFF = 0.2
"""By what share the axes may be faster or slower than commanded; beyond it, it is no delay."""


class Timing:
    """When commands act, by no model of the servo: by which shift their rates are those that are seen.

    Filters that assume a delay far from the real one explain the motion by lags, disturbances and restarts.
    """

    def __init__(self) -> None:
        self._turns: Array = np.empty((REMEMBERED, 5))
        """The newest turns, in a ring: instants, commanded and seen rates."""
        self._taken = 0

    def take(
        self, utc_s: float, commanded_deg_s: tuple[float, float], seen_deg_s: tuple[float, float]
    ) -> None:
        """Take the rates of both axes until an instant: by the profile's delay, and as seen."""
        self._turns[self._taken % REMEMBERED] = (utc_s, *commanded_deg_s, *seen_deg_s)
        self._taken += 1

    def later_s(self, lag_s: float) -> float | None:
        """Return by how much later than after `lag_s` the axes answer, seconds; negative for sooner.

        None where the motion does not tell, or where the lag explains it as well.
        """
        if self._taken < LEAST_TURNS:
            return None
        turns = np.roll(self._turns, -(self._taken % REMEMBERED), axis=0)[-min(self._taken, REMEMBERED) :]
        left = np.array([_unexplained(turns, shift_s) for shift_s in SHIFTS_S.tolist()])
        best = int(left.argmin())
        told = _unexplained(turns, lag_s)
        if not left[best] < EXPLAINS < told or told < FAILS * left[best]:
            return None
        return float(SHIFTS_S[best]) - lag_s


def _unexplained(turns: Array, shift_s: float) -> float:
    """Return the share of the seen rates' variance that the commanded ones, so much later, do not explain."""
    utc_s = turns[:, 0]
    from_s = utc_s - shift_s
    known = (from_s >= utc_s[0]) & (from_s <= utc_s[-1])
    if np.count_nonzero(known) < LEAST_TURNS // 2:
        return math.inf
    left = whole = 0.0
    for commanded, seen in ((turns[:, 1], turns[:, 3]), (turns[:, 2], turns[:, 4])):
        x = np.interp(from_s[known], utc_s, commanded)
        y = seen[known] - seen[known].mean()
        x -= x.mean()
        xx, xy, yy = float(x @ x), float(x @ y), float(y @ y)
        gain = min(1.0 + GAIN_OFF, max(1.0 - GAIN_OFF, xy / xx)) if xx > 0.0 else 0.0
        left += yy - 2.0 * gain * xy + gain * gain * xx
        whole += yy
    return left / whole if whole > 0.0 else math.inf


class Learnt(NamedTuple):
    """What is known of one axis; its lag is beyond the command delay and the mount's turn, seconds."""

    lag_s: float
    lag_sigma_s: float
    line: RateLine | None
    """The gain over the profile's; None before it is known."""


class Learning:
    """Follows the axes' filters through a run."""

    def __init__(self) -> None:
        self.axes: Axes | None = None
        """The filters as of the last sample that was followed with; None before."""
        self.restarts = 0
        """How often filters began anew although they were followed with."""
        self.fits = RateFit(), RateFit()
        """Of right ascension and declination, since the mount was first on target, or before it was."""
        self.timing = Timing()
        self._before: tuple[float, float, float] | None = None

    def anew(self) -> None:
        """Note that the filters contradict what is seen and must begin anew."""
        self.restarts += 1

    @property
    def times_begun_anew(self) -> int:
        """How often the filters began anew, of themselves or replaced."""
        return self.restarts + self._begun_anew

    @property
    def _begun_anew(self) -> int:
        return 0 if self.axes is None else self.axes.ra.begun_anew + self.axes.dec.begun_anew

    def forget_rates(self) -> None:
        """Fit the rates from now on: what the way onto the target made of them is not the servo's."""
        self.fits, self._before = (RateFit(), RateFit()), None

    def take(self, axes: Axes, sample: StatusSample, utc_s: float) -> None:
        """Take a sample that was followed with and believed."""
        self.axes = axes
        before, self._before = self._before, (utc_s, sample.ra_deg, sample.dec_deg)
        if before is None or not axes.turned_over_s:
            return
        seconds = utc_s - before[0]
        if abs(seconds - axes.turned_over_s) > 1e-6:
            return
        seen = wrap180(sample.ra_deg - before[1]), sample.dec_deg - before[2]
        parts = zip(self.fits, (axes.ra, axes.dec), axes.predicted_deg, seen, strict=True)
        for fit, axis, moved, came in parts:
            fit.take(moved / (1.0 + axis.gain_error) / seconds, came / seconds)
        self.timing.take(utc_s, axes.rates_deg_s, (seen[0] / seconds, seen[1] / seconds))

    def pause(self) -> None:
        """Note that the mount does not move by commands."""
        self._before = None

    def learnt(self) -> tuple[Learnt, Learnt] | None:
        """Return what is known of right ascension and declination; None before following began."""
        if self.axes is None:
            return None
        ra, dec = (
            Learnt(axis.lag.mean_s, axis.lag_sigma_s, fit.line())
            for axis, fit in zip((self.axes.ra, self.axes.dec), self.fits, strict=True)
        )
        return ra, dec

    def settling_s(self, interval_s: float, law: FeederLaw) -> float | None:
        """Return the time constant in force, of the slower axis; None before following began."""
        if self.axes is None:
            return None
        axes = (self.axes.ra, self.axes.dec)
        return max(settling_s(interval_s, axis.lag.mean_s, axis.lag_sigma_s, law) for axis in axes)


LAW = FeederLaw()
MADE_UP_SHARE, MADE_UP_DEG_S = 0.25, 0.1
"""The most that is made up for of a wrong gain and a rate that nobody asked for. An axis that seems farther
off does not hear its rates: what is added to them all the while comes out when it hears again."""


class AxisCourse(NamedTuple):
    """One axis' target over the interval in which a command acts, seen `ahead_s` after the interval.

    Degrees, seconds; `move_deg` is how far it goes in the interval.
    """

    begin_deg: float
    move_deg: float
    interval_s: float
    acceleration_deg_s2: float
    ahead_s: float


def correction_deg_s(
    error_deg: float,
    acceleration_deg_s2: float,
    limit_deg_s: float,
    settling_s: float,
    law: FeederLaw = LAW,
) -> float:
    """Return the rate that takes an error out, against its sign.

    Small errors decay with a time constant; large ones are closed along the curve from which a share of the
    axis' acceleration can still brake, and never faster than `limit_deg_s`.
    """
    size = abs(error_deg)
    braking = math.sqrt(2.0 * law.braking_share * acceleration_deg_s2 * size)
    closing = min(size / settling_s, braking, limit_deg_s)
    return -math.copysign(closing, error_deg)


def settling_s(interval_s: float, lag_s: float, lag_sigma_s: float, law: FeederLaw = LAW) -> float:
    """Return the time constant with which a small error may be taken out.

    A correction acts for a whole interval, and its effect is known only as well as the lag: a faster one
    would be overdone.
    """
    unsure_s = law.intervals * interval_s + law.lag_sigmas * lag_sigma_s
    return max(law.settling_s, law.lags * lag_s, unsure_s)


def rate_deg_s(
    way: AxisCourse,
    bound_for_deg: float,
    axis: AxisFilter,
    most_deg_s2: float,
    limit_deg_s: float,
    law: FeederLaw = LAW,
) -> float:
    """Return the rate to command over the acting interval.

    `bound_for_deg` is where what was commanded so far leads the axis, a mean lag after the interval begins.
    `most_deg_s2` is the axis' acceleration.
    """
    late_s = axis.lag.mean_s - way.ahead_s
    rate, bend = way.move_deg / way.interval_s, way.acceleration_deg_s2
    wanted_deg = way.begin_deg + rate * late_s + 0.5 * bend * late_s * (late_s - way.interval_s)
    # A servo that answers over a while cuts the corners of a bent way, and so does a rate that acts for
    # several turns of the mount's loop: the mean error of those turns is made up for.
    chord_s2 = max(0.0, way.interval_s * way.interval_s - TURN_S * TURN_S) / 12.0
    wanted_deg -= (0.5 * axis.lag.variance_s2 + chord_s2) * bend
    takes_s = settling_s(way.interval_s, axis.lag.mean_s, axis.lag_sigma_s, law)
    error_deg = bound_for_deg - wanted_deg
    correction = correction_deg_s(error_deg, most_deg_s2, limit_deg_s, takes_s, law)
    plain = rate + bend * late_s + correction
    asked = (plain - axis.disturbance_deg_s) / (1.0 + axis.gain_error)
    most = MADE_UP_SHARE * abs(plain) + MADE_UP_DEG_S
    return float(max(plain - most, min(plain + most, asked)))


def ramped_deg_s(
    wanted_deg_s: float, before_deg_s: float, most_deg_s2: float, interval_s: float, law: FeederLaw = LAW
) -> float:
    """Return a rate that is no further from the one before than a share of the acceleration allows."""
    most = law.ramp_share * most_deg_s2 * interval_s
    return max(before_deg_s - most, min(before_deg_s + most, wanted_deg_s))
