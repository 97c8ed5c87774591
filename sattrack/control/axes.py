"""Both axes of a mount as they are known: filters, gates, and which command it was that acted when.

The mount reads its mailbox once a loop, at the instant of its status. A command acts from the first such
instant after it arrived, until the first one after its successor arrived. The loop's timer is imprecise from
one turn to the next and even over many, so turns are predicted by the mean of the last ones.

A datagram may be lost, repeated or late, and no status tells which one the mount has read. Where a sample
contradicts the history, the commands before and after the expected one are tried, and the one that explains
both axes' movement is believed to have acted; what none of them explains is a disturbance, or a sample that
is not to be believed.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

import msgspec
import numpy as np

from sattrack.control.axis_filter import (
    SETTLED_S,
    SHARES,
    SURPRISE_SIGMAS,
    TURN_S,
    AxisFilter,
    Commanded,
    LoopTurn,
    Step,
    answers_of,
    rest_of,
)
from sattrack.control.latency import LARGEST_PERIOD_ERROR, MOST_OFF_S, ROUGH_S, AcknowledgedDelay
from sattrack.core.angles import wrap180

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sattrack.control.axis_filter import Array, Noise
    from sattrack.mount.model import MountProfile, StatusSample

REMEMBERED = 200
"""Turns, ten seconds, over which the mean is taken."""
ASTRAY_S = 0.2
"""A turn this far from where it was predicted is of a loop that stood still, or of a clock that was set."""
SHORTEST_BASE = 20
LEAST_STEP_S, STEP_SIGMAS, STEP_TURNS = 0.005, 4.0, 5
"""So many turns in a row, so much later or all so much earlier than predicted, are of a loop that went on at
other instants, as one that leaves a turn out. A lone one of them was late, and says nothing of the next."""
SCATTER_SHARE = 0.02
MOST_SHIFT_S, SHIFT_SHARE = 0.0002, 0.02
"""How fast the sending falls into step with the mount's loop: too slow for the period to show it."""
EDGE_PERIODS = 2.0
"""How many periods the rates of one edge act, until it is learnt."""


@dataclass(slots=True)
class MountLoop:
    """Predicts turns; `period_s` is the nominal period, which holds until enough turns were seen."""

    period_s: float
    _turns: deque[tuple[int, float]] = field(default_factory=lambda: deque(maxlen=REMEMBERED))
    _aside: list[tuple[int, float]] = field(default_factory=list)
    """The last turns, as far as they were not where they were predicted."""
    _scatter: float = 0.0
    """Mean square of how far turns are from where they were predicted."""
    _origin: tuple[int, float] = (0, 0.0)
    """A turn by which the sums count: never one long past, or they would lose their last digits."""
    _numbers: float = 0.0
    _instants_s: float = 0.0
    _squares: float = 0.0
    _products_s: float = 0.0
    mean_period_s: float = field(init=False)
    """Mean period of the turns remembered: the slope of a line through them, by least squares."""
    _base_s: float = 0.0
    """When the turn of count 0 would have been."""

    def __post_init__(self) -> None:
        """Begin with the nominal period."""
        self.mean_period_s = self.period_s

    def note(self, counter: int, utc_s: float) -> None:
        """Take the instant of one turn, UTC as POSIX seconds; counters rise."""
        if not self._turns:
            self._begin(counter, utc_s)
            return
        last_counter, _ = (self._aside or self._turns)[-1]
        off_s = utc_s - self.turn_utc_s(counter)
        if counter <= last_counter or abs(off_s) > ASTRAY_S:
            self.mean_period_s = self.period_s
            self._begin(counter, utc_s)
        elif len(self._turns) < SHORTEST_BASE or abs(off_s) <= max(
            LEAST_STEP_S, STEP_SIGMAS * math.sqrt(self._scatter)
        ):
            self._aside.clear()
            self._take(counter, utc_s, off_s)
        else:
            if self._aside and (self._aside[-1][1] > self.turn_utc_s(last_counter)) != (off_s > 0.0):
                self._aside.clear()
            self._aside.append((counter, utc_s))
            if len(self._aside) == STEP_TURNS:
                # The first was late itself where the loop was held up.
                self._begin(*self._aside[1], self._aside[2:])

    def _begin(self, counter: int, utc_s: float, more: Sequence[tuple[int, float]] = ()) -> None:
        self._turns.clear()
        self._aside = []
        self._turns.append((counter, utc_s))
        self._scatter = 0.0
        self._sum_up()
        self._base_s = self.turn_utc_s(0)
        for later, at_s in more:
            self._take(later, at_s, at_s - self.turn_utc_s(later))

    def _take(self, counter: int, utc_s: float, off_s: float) -> None:
        """Take a turn, so much later than predicted, into the mean."""
        self._scatter += max(SCATTER_SHARE, 1.0 / len(self._turns)) * (off_s * off_s - self._scatter)
        if len(self._turns) == REMEMBERED:
            self._weigh(self._turns.popleft(), -1)
        self._turns.append((counter, utc_s))
        if self._turns[0][0] - self._origin[0] > REMEMBERED:
            self._sum_up()
        else:
            self._weigh((counter, utc_s), 1)
        if counter - self._turns[0][0] >= SHORTEST_BASE:
            # The first turn and the last alone say little: those of a coarse timer are off by half its grain.
            count = len(self._turns)
            mean_s = (count * self._products_s - self._numbers * self._instants_s) / (
                count * self._squares - self._numbers * self._numbers
            )
            if abs(mean_s / self.period_s - 1.0) < LARGEST_PERIOD_ERROR:
                self.mean_period_s = mean_s
        self._base_s = self.turn_utc_s(0)

    def _sum_up(self) -> None:
        """Sum the turns remembered up anew, by the first of them."""
        self._origin = self._turns[0]
        self._numbers = self._instants_s = self._squares = self._products_s = 0.0
        for turn in self._turns:
            self._weigh(turn, 1)

    def _weigh(self, turn: tuple[int, float], sign: int) -> None:
        """Add a turn to the sums, or take one out."""
        number, instant_s = turn[0] - self._origin[0], turn[1] - self._origin[1]
        self._numbers += sign * number
        self._instants_s += sign * instant_s
        self._squares += sign * number * number
        self._products_s += sign * number * instant_s

    def turn_utc_s(self, counter: int) -> float:
        """Return when the turn of a count is expected. Needs one turn noted."""
        count = len(self._turns)
        first, first_s = self._origin
        number = counter - first - self._numbers / count
        return first_s + self._instants_s / count + number * self.mean_period_s

    @property
    def scatter_s(self) -> float:
        """How far turns are from where they were predicted, RMS."""
        return math.sqrt(self._scatter)

    def shift_s(self, arrival_utc_s: float, early_s: float | None = None) -> float:
        """Return the delay at which datagrams should arrive, after this instant, seconds.

        Halfway between two turns, neither timer nor network make it uncertain which of them reads a datagram;
        or `early_s` before a turn.
        """
        if not self._turns:
            return 0.0
        half_s = 0.5 * self.mean_period_s
        ahead_s = self.first_from(arrival_utc_s) - arrival_utc_s
        if early_s is None:
            return ahead_s - half_s
        return (ahead_s - early_s + half_s) % self.mean_period_s - half_s

    def send_shift_s(
        self,
        arrival_utc_s: float,
        most_s: float = MOST_SHIFT_S,
        share: float = SHIFT_SHARE,
        early_s: float | None = None,
    ) -> float:
        """Return the delay of the next datagram beyond one period, seconds: a bounded share of the shift."""
        return max(-most_s, min(most_s, share * self.shift_s(arrival_utc_s, early_s)))

    def first_from(self, utc_s: float) -> float:
        """Return the first turn expected at or after an instant. Needs one turn noted."""
        turns = math.ceil((utc_s - self._base_s) / self.mean_period_s - 1e-9)
        return self._base_s + turns * self.mean_period_s


KEPT = 400


class SentRates(msgspec.Struct, frozen=True, gc=False):
    """Rates of the reported right ascension and declination, sent at an instant."""

    sent_utc_s: float
    ra_rate_deg_s: float
    dec_rate_deg_s: float


AT_REST = SentRates(float("-inf"), 0.0, 0.0)


@dataclass(slots=True)
class CommandHistory:
    """What was sent lately; `delay_s` is from sending to the mailbox, `loop` tells when it is read."""

    delay_s: float
    loop: MountLoop
    sigma_s: float = ROUGH_S
    """How surely the delay is known at first."""
    _sent: deque[SentRates] = field(default_factory=lambda: deque(maxlen=KEPT))
    acknowledged: AcknowledgedDelay = field(init=False)
    """What acknowledgements say of the delay."""
    _profile_delay_s: float = field(init=False)

    def __post_init__(self) -> None:
        """Begin with the profile's values."""
        self._profile_delay_s = self.delay_s
        self.acknowledged = AcknowledgedDelay(self.delay_s, self.sigma_s)

    def add(self, sent: SentRates) -> None:
        """Note what was sent; instants rise."""
        self._sent.append(sent)

    def clear(self) -> None:
        """Forget everything: the mount is on its own again."""
        self._sent.clear()

    def change_delay(self, by_s: float) -> bool:
        """Change the delay, as far as the profile lets it; return whether it is another one."""
        before_s = self.delay_s
        least_s, most_s = self._profile_delay_s - MOST_OFF_S, self._profile_delay_s + MOST_OFF_S
        self.delay_s = max(least_s, min(most_s, before_s + by_s))
        return self.delay_s != before_s

    def acting(self, tick_utc_s: float, longer_s: float = 0.0) -> SentRates:
        """Return what acts from a loop instant of the mount until the next one.

        `longer_s` is added to the delay.
        """
        newest_that_counts = tick_utc_s - self.delay_s - longer_s
        for sent in reversed(self._sent):
            if sent.sent_utc_s <= newest_that_counts:
                return sent
        return AT_REST

    def other(self, step: int, tick_utc_s: float) -> SentRates | None:
        """Return the command sent so many after the one that is expected to act from a loop instant.

        -1 is the one before it; None where there is none.
        """
        expected = self.acting(tick_utc_s)
        place = len(self._sent) - 1
        while place >= 0 and self._sent[place] is not expected:
            place -= 1
        if not 0 <= place + step < len(self._sent) or place < 0:
            return None
        return self._sent[place + step]

    def steps(self, from_utc_s: float, to_utc_s: float) -> list[Step]:
        """Return what acts between two instants, a step for each of the mount's turns.

        `from_utc_s` must be a loop instant of the mount; further ones are as the loop is predicted, so that
        a gap of lost statuses is predicted through.
        """
        found = []
        half_s = 0.5 * self.loop.mean_period_s
        at = from_utc_s
        while at < to_utc_s - 1e-6:
            acting = self.acting(at)
            found.append(Step(at, acting.ra_rate_deg_s, acting.dec_rate_deg_s))
            until = min(self.loop.first_from(at + half_s), to_utc_s)
            # A rest shorter than half a period is the loop's jitter, not another turn of it.
            at = to_utc_s if to_utc_s - until < half_s else until
        return found


TRIED_S = np.array((-0.024, -0.02, -0.012, -0.006, 0.006, 0.012, 0.02, 0.024))
"""By how much longer the commands may take than assumed."""
PROOF, FAR_PROOF = 6.0, 12.0
"""Logarithm of the likelihood ratio from which on another delay is believed, and how much more the furthest
of them needs: half a turn too much looks much like half a turn too little, read a turn late."""
LEAST_EVIDENCE = -30.0
"""Evidence against a delay counts no further: it may be right later."""
MOST_SQUARED_SIGMAS = 4.0
"""What one sample may say for or against a delay: a datagram may have been lost."""
MISREAD_SAYS = 4.0
"""What a sample says for a delay by which the command that explains it acted, and not the expected one."""
WORTH_S = 0.001
"""By how much an expected delay must differ from the one in use to take its place."""
EVIDENCE_LASTS = 0.999
"""What the evidence of a sample counts over the next one's."""


class Pulse(NamedTuple):
    """Rates of both axes, degrees per second, between two instants, by one of the delays that are tried."""

    trial: int
    from_utc_s: float
    to_utc_s: float
    ra_rate_deg_s: float
    dec_rate_deg_s: float


class DelayTrials:
    """Tells whether the commands take longer or less long than assumed, by a bank of filters.

    By another delay some commands act a turn earlier or later. For each of TRIED_S this follows how far the
    states of filters that assume it would be from those in use; the covariance is the same, and the ratio of
    likelihoods decides (generalised likelihood ratio test: Willsky and Jones 1976).
    """

    def __init__(self) -> None:
        count = len(TRIED_S)
        self.evidence: Array = -FAR_PROOF * (TRIED_S / TRIED_S[-1]) ** 2
        """Logarithm of the likelihood of each delay over that of the one in use."""
        self.apart = np.zeros((2, count, 2 + SHARES))
        """How far the states of both axes would be from those in use."""
        self._pulses: list[Pulse] = []

    def predict(self, acted: list[Step], coming: list[Step], to_utc_s: float, axes: Axes) -> None:
        """Go on to a sample; `acted` by the delay in use, since the last sample, and `coming` after this."""
        from_utc_s = acted[0].utc_s
        oldest_s = from_utc_s - SETTLED_S
        self._pulses = [pulse for pulse in self._pulses if pulse.to_utc_s > oldest_s]
        self._pulses += self._differences(acted, to_utc_s, axes.history)
        pulses = self._pulses + self._differences(coming, to_utc_s + TURN_S, axes.history)
        moved = np.zeros((2, len(TRIED_S), SHARES))
        if pulses:
            trials, begins_s, ends_s, *rates = np.array(pulses).T
            answers = answers_of(np.array((to_utc_s, from_utc_s))[:, None, None] - (begins_s, ends_s))
            answer = answers[0, 0] - answers[0, 1] - answers[1, 0] + answers[1, 1]
            its_own = trials == np.arange(len(TRIED_S))[:, None]
            moved[:] = [(its_own * rate) @ answer for rate in rates]
        for apart, axis, axis_moved in zip(self.apart, (axes.ra, axes.dec), moved, strict=True):
            apart[:, 0] += apart[:, 1:] @ axis.moves + axis_moved @ axis.shares

    def _differences(self, steps: list[Step], to_utc_s: float, history: CommandHistory) -> list[Pulse]:
        """Return by what rates steps until an instant would differ by the delays that are tried."""
        found = []
        for step, ends_s in zip(steps, [*(step.utc_s for step in steps[1:]), to_utc_s], strict=True):
            for k, longer_s in enumerate(TRIED_S.tolist()):
                acts = history.acting(step.utc_s, longer_s)
                ra, dec = acts.ra_rate_deg_s - step.ra_rate_deg_s, acts.dec_rate_deg_s - step.dec_rate_deg_s
                if ra != 0.0 or dec != 0.0:
                    found.append(Pulse(k, step.utc_s, ends_s, ra, dec))
        return found

    def correct(self, axes: Axes) -> None:
        """Take the sample in that the axes' filters have just taken in."""
        for apart, axis in zip(self.apart, (axes.ra, axes.dec), strict=True):
            if axis.has_just_begun:
                apart[:] = 0.0
                continue
            left_deg = axis.innovation_deg - apart[:, 0]
            sigmas = np.array((axis.innovation_deg, *left_deg)) / axis.innovation_sigma_deg
            squared = np.minimum(sigmas * sigmas, MOST_SQUARED_SIGMAS)
            if not axes.strained:
                self.evidence += 0.5 * (squared[0] - squared[1:])
            apart[:] -= apart[:, :1] * axis.kalman_gain
        self.evidence = np.maximum(EVIDENCE_LASTS * self.evidence, LEAST_EVIDENCE)

    def misread(self, step: Step, history: CommandHistory) -> None:
        """Note that a step has acted that was not the expected one."""
        differ = {pulse.trial for pulse in self._differences([step], math.inf, history)}
        for k in set(range(len(TRIED_S))) - differ:
            self.evidence[k] += MISREAD_SAYS

    def proven(self, history: CommandHistory) -> int | None:
        """Return which of TRIED_S is believed, by motion and acknowledgements; None for the one in use."""
        likely = history.acknowledged.likely(history.delay_s + np.array((0.0, *TRIED_S)))
        evidence = self.evidence + likely[1:] - likely[0]
        best = int(evidence.argmax())
        return best if evidence[best] > PROOF else None


GATE_DEG = 0.1
OUTLIERS_BELIEVED = 5
"""Samples in a row that jump the same way are no glitch: the mount's coordinates have changed."""
GAP_S = 5.0
"""A gap in the samples after which the filters begin anew."""
SAME_S = 1e-3
"""Samples that are dated no further apart are of one turn of the mount's loop, or one is misdated."""
STUCK_DEG, STUCK_TICS = 2.0 / 3600.0, 3.0
"""A reported place that stays the same to the last bit while commands move the axis so far is no reading."""
EXPLAINED_SHARE = 0.25
"""Another command is believed to have acted where it leaves less than this share of the surprise, squared."""
OTHERS = (-1, 1, -2)
"""Commands tried instead of the expected one, by their distance in the order of sending."""

ANSWERED_S = 0.3
"""Time in which a change of rate has mostly come out."""
SHAKEN_DEG_S, SHAKEN_FOR_S = 0.08, 6.0
"""Changes of rate that shake an axis, summed while they are answered, and for how long it may drift then."""
UNSTRAINED_SHARE = 0.5
"""Share of the profile's acceleration up to which a change of rate comes out as the servo's answer. Beyond it
the drive limits the motion, which says nothing of the servo."""


AT_LIMIT_SAMPLES = 3
"""Samples in a row in which a drive accelerates towards a rate that it should have had: it can do no more."""
MISSED_S = 0.03
"""What an axis is off its rate then at least, over the acceleration told: less is its servo's answer."""
WEAKEST_SHARE = 0.25
"""Share of the acceleration told that any drive has: a motion with less is that of a command gone astray."""


class Turn(NamedTuple):
    """An axis between two samples: how fast it was seen to go, and how fast it should have by commands."""

    seconds: float
    seen_deg_s: float
    predicted_deg_s: float


class Drive:
    """How fast the drive of one axis changes its rate: the profile's acceleration, or less where that shows.

    A drive that is weaker than its profile says falls behind its commands while they change, in place too. A
    servo that catches that up runs faster than commanded. A law that counts on the profile's acceleration
    cannot brake that, and the axis would swing about its target for good.
    """

    def __init__(self, told_deg_s2: float) -> None:
        self._told_deg_s2 = told_deg_s2
        self.acceleration_deg_s2 = told_deg_s2
        self._place_deg: float | None = None
        self._before: Turn | None = None
        self._at_limit = 0
        """Samples in a row at which the drive was at its limit."""
        self._most_deg_s2 = 0.0
        """The acceleration that it reached in those."""

    @property
    def surely_deg_s2(self) -> float:
        """The acceleration up to which a change of rate comes out as the servo's answer."""
        return min(UNSTRAINED_SHARE * self._told_deg_s2, self.acceleration_deg_s2)

    def forget(self) -> None:
        """Note that the axis moved by a plan of its own."""
        self._place_deg = self._before = None
        self._at_limit = 0

    def see(self, place_deg: float, predicted_deg: float, seconds: float) -> None:
        """Take a reported place, and how far the commands should have moved the axis since the last one."""
        last_deg, self._place_deg = self._place_deg, place_deg
        if last_deg is None:
            return
        turn = Turn(seconds, wrap180(place_deg - last_deg) / seconds, predicted_deg / seconds)
        before, self._before = self._before, turn
        if before is None:
            return
        change_deg_s2 = 2.0 * (turn.seen_deg_s - before.seen_deg_s) / (turn.seconds + before.seconds)
        reached = abs(change_deg_s2)
        towards = math.copysign(1.0, change_deg_s2)
        missed = min(
            towards * (rate - turn.seen_deg_s) for rate in (before.predicted_deg_s, turn.predicted_deg_s)
        )
        if missed > MISSED_S * self._told_deg_s2 and reached > WEAKEST_SHARE * self._told_deg_s2:
            self._at_limit += 1
            self._most_deg_s2 = max(self._most_deg_s2, reached)
            if self._at_limit >= AT_LIMIT_SAMPLES:
                self.acceleration_deg_s2 = min(self._told_deg_s2, self._most_deg_s2)
            return
        self._at_limit, self._most_deg_s2 = 0, 0.0
        # It can do what it has just done.
        self.acceleration_deg_s2 = min(self._told_deg_s2, max(self.acceleration_deg_s2, reached))


@dataclass(slots=True)
class Axes:
    """Filters of right ascension and declination, as of the last sample."""

    profile: MountProfile
    history: CommandHistory
    ra: AxisFilter
    dec: AxisFilter
    sample_utc_s: float
    outliers: int = 0
    rates_deg_s: tuple[float, float] = (0.0, 0.0)
    """How fast the axes move at the last sample, by the commands, or as seen where there are none."""
    _commanded: Commanded = field(init=False)
    _strain_deg_s: list[float] = field(default_factory=lambda: [0.0, 0.0])
    """By how much the axes lag behind their commanded rates because the drives are at their limit."""
    _jolts_deg_s: list[float] = field(default_factory=lambda: [0.0, 0.0])
    """Changes of the commanded rates that are still being answered."""
    _shaken_utc_s: list[float] = field(default_factory=lambda: [-math.inf, -math.inf])
    """When each axis' rate was last changed by much."""
    _seen_deg: tuple[float, float] | None = None
    """What the last sample reported."""
    predicted_deg: tuple[float, float] = (0.0, 0.0)
    """How far the commands were to move the axes between the last two samples."""
    turned_over_s: float = 0.0
    """The time between those two; 0 where no commands explain the motion."""
    trials: DelayTrials = field(init=False)
    """Other delays of the commands."""
    drives: tuple[Drive, Drive] = field(init=False)
    """How fast both axes change their rates."""
    misread: int = 0
    """Samples that were explained by another command than the expected one."""

    def __post_init__(self) -> None:
        """Begin with axes that have moved by the command in force for long."""
        acting = self.history.acting(self.sample_utc_s)
        self._commanded = Commanded(self.sample_utc_s, acting.ra_rate_deg_s, acting.dec_rate_deg_s)
        self.trials = DelayTrials()
        profile = self.profile
        self.drives = Drive(profile.ra.max_acceleration_deg_s2), Drive(profile.dec.max_acceleration_deg_s2)

    @classmethod
    def begin(
        cls,
        profile: MountProfile,
        history: CommandHistory,
        sample: StatusSample,
        utc_s: float,
        noise: Noise | None = None,
        former: Axes | None = None,
    ) -> Axes:
        """Return filters that know one sample, and what `former` ones were sure of."""
        if former is None:
            ra = AxisFilter(sample.ra_deg, noise, profile.ra.lag_s or None)
            dec = AxisFilter(sample.dec_deg, noise, profile.dec.lag_s or None)
        else:
            ra, dec = former.ra, former.dec
            ra.begin_anew(sample.ra_deg)
            dec.begin_anew(sample.dec_deg)
        begun = cls(profile, history, ra, dec, utc_s)
        if former is not None:
            begun.drives = former.drives
            for drive in begun.drives:
                drive.forget()
        return begun

    @property
    def lost(self) -> bool:
        """Whether the last samples contradict everything that the filters expect."""
        return self.outliers >= OUTLIERS_BELIEVED

    def follows(self, utc_s: float) -> bool:
        """Tell whether a sample of an instant can be joined to those before."""
        return SAME_S < utc_s - self.sample_utc_s < GAP_S

    def take(self, sample: StatusSample, utc_s: float, commanded: bool) -> bool:
        """Bring the filters to a sample; tell whether it was believed.

        `commanded` where the mount moves by our rates; else it moves by a plan of its own, which no history
        of commands tells.
        """
        seconds = utc_s - self.sample_utc_s
        if not commanded:
            self._follow_plan(sample, utc_s)
            return True
        moved = self._advance(sample, utc_s, seconds)
        self.sample_utc_s, self.turned_over_s, self.predicted_deg = utc_s, seconds, moved
        for drive, place, to in zip(self.drives, (sample.ra_deg, sample.dec_deg), moved, strict=True):
            drive.see(place, to, seconds)
        if self._is_stuck(sample, *moved):
            return False
        # No axis gets further from the prediction than by running full speed the other way.
        ra_gate = GATE_DEG + 2.0 * self.profile.ra.max_rate_deg_s * seconds
        dec_gate = GATE_DEG + 2.0 * self.profile.dec.max_rate_deg_s * seconds
        ra_jump = abs(wrap180(sample.ra_deg - self.ra.position_deg))
        if ra_jump > ra_gate or abs(sample.dec_deg - self.dec.position_deg) > dec_gate:
            self.outliers += 1
            return False
        self.outliers = 0
        self.ra.measure(sample.ra_deg, moved[0] / seconds)
        self.dec.measure(sample.dec_deg, moved[1] / seconds)
        self._weigh_delays()
        return True

    def acknowledge(self, raised_utc_s: float, utc_s: float) -> None:
        """Note that flags raised at an instant were first acknowledged by a status: the next sample.

        The delay in use becomes the one that is expected then.
        """
        history = self.history
        history.acknowledged.note(raised_utc_s, self.sample_utc_s, utc_s)
        off_s = history.acknowledged.delay_s[0] - history.delay_s
        if abs(off_s) > WORTH_S and history.change_delay(off_s):
            self.trials = DelayTrials()

    def _weigh_delays(self) -> None:
        """Change the delay of the commands where the samples prove another."""
        self.trials.correct(self)
        proven = self.trials.proven(self.history)
        if proven is None:
            return
        history = self.history
        if history.change_delay(float(TRIED_S[proven])):
            for axis, apart in zip((self.ra, self.dec), self.trials.apart, strict=True):
                axis.change(apart[proven])
        self.trials = DelayTrials()

    def _advance(self, sample: StatusSample, utc_s: float, seconds: float) -> tuple[float, float]:
        """Predict by the commands that acted; return how far they moved the axes."""
        before = self._commanded.last
        acted, effect = self._explained(sample, utc_s, self.history.steps(self.sample_utc_s, utc_s))
        coming = self._coming(utc_s)
        for step in acted:
            self._commanded.add(step)
        now = acted[-1]
        self.rates_deg_s = now[1:]
        jolts = (now.ra_rate_deg_s - before.ra_rate_deg_s, now.dec_rate_deg_s - before.dec_rate_deg_s)
        moved = []
        fades = math.exp(-seconds / ANSWERED_S)
        for number, (axis, jolt, drive) in enumerate(
            zip((self.ra, self.dec), jolts, self.drives, strict=True)
        ):
            strain = self._strain(number, jolt, drive.surely_deg_s2 * seconds)
            recent = self._jolts_deg_s[number] * fades + abs(jolt)
            self._jolts_deg_s[number] = recent
            if recent > SHAKEN_DEG_S:
                self._shaken_utc_s[number] = utc_s
            shaken = utc_s - self._shaken_utc_s[number] < SHAKEN_FOR_S
            axis.advance(seconds, 0.0, effect[number], axis.rough_deg(recent) + strain * seconds, shaken)
            moved.append(axis.moved_deg(effect[number]))
        self.trials.predict(acted, coming, utc_s, self)
        return moved[0], moved[1]

    @property
    def strained(self) -> bool:
        """Whether a drive is at its limit: its motion says little of when commands act."""
        return any(self._strain_deg_s)

    def _strain(self, number: int, jolt_deg_s: float, gives_deg_s: float) -> float:
        """Return how far an axis may lag behind its rate after a change of it."""
        strain = self._strain_deg_s[number] + jolt_deg_s
        left = math.copysign(max(0.0, abs(strain) - gives_deg_s), strain)
        self._strain_deg_s[number] = left
        return abs(left)

    def _follow_plan(self, sample: StatusSample, utc_s: float) -> None:
        """Take the place as it is seen, of a mount that moves by a plan of its own."""
        seconds = utc_s - self.sample_utc_s
        self.rates_deg_s = (
            wrap180(sample.ra_deg - self.ra.position_deg) / seconds,
            (sample.dec_deg - self.dec.position_deg) / seconds,
        )
        self.ra.stand_at(sample.ra_deg)
        self.dec.stand_at(sample.dec_deg)
        self.sample_utc_s, self.outliers, self.turned_over_s = utc_s, 0, 0.0
        self._commanded = Commanded(utc_s)
        self.trials = DelayTrials()
        for drive in self.drives:
            drive.forget()
        self._strain_deg_s, self._jolts_deg_s = [0.0, 0.0], [0.0, 0.0]

    def _is_stuck(self, sample: StatusSample, ra_moved_deg: float, dec_moved_deg: float) -> bool:
        """Tell whether an axis is reported where it stood to the last bit, though commands moved it."""
        seen, self._seen_deg = self._seen_deg, (sample.ra_deg, sample.dec_deg)
        if seen is None:
            return False
        least_deg = max(STUCK_DEG, STUCK_TICS * 360.0 / self.profile.encoder_tics)
        return (seen[0] == sample.ra_deg and abs(ra_moved_deg) > least_deg) or (
            seen[1] == sample.dec_deg and abs(dec_moved_deg) > least_deg
        )

    def _coming(self, utc_s: float) -> list[Step]:
        """Return what is expected to act from an instant on, and may act a turn before."""
        return self.history.steps(utc_s, utc_s + TURN_S)

    def moved_by(self, utc_s: float) -> tuple[float, float]:
        """Return how far the commands will have moved the axes from the last sample to an instant."""
        steps = self.history.steps(self.sample_utc_s, utc_s + TURN_S)
        effect = self._commanded.effects(self.sample_utc_s, utc_s, steps)
        return self.ra.moved_deg(effect[0]), self.dec.moved_deg(effect[1])

    def bound_for(self, utc_s: float) -> tuple[tuple[float, float], tuple[float, float]]:
        """Return where the commands that act until an instant will have led the axes, and their last rates.

        That is where they would come to rest if the rates were nought from then on, plus what a disturbance
        moves them until their mean lag is over: where they are that lag after the instant.
        """
        steps = self.history.steps(self.sample_utc_s, utc_s)
        last = steps[-1] if steps else self._commanded.last
        effect = self._commanded.effects(self.sample_utc_s, utc_s + SETTLED_S, steps)
        effect -= rest_of(last, SETTLED_S)
        ahead_s = utc_s - self.sample_utc_s
        ra, dec = (
            axis.predicted_deg(ahead_s + axis.lag.mean_s, effect[number])
            for number, axis in enumerate((self.ra, self.dec))
        )
        return (ra, dec), (last.ra_rate_deg_s, last.dec_rate_deg_s)

    def _explained(
        self, sample: StatusSample, utc_s: float, expected: list[Step]
    ) -> tuple[list[Step], Array]:
        """Return what acted since the last sample, and its effects: what explains the sample best."""
        coming = self._coming(utc_s)
        effect = self._commanded.effects(self.sample_utc_s, utc_s, [*expected, *coming])
        # Over a gap of lost samples, more than one command acted, and there is no telling.
        if len(expected) > 1:
            return expected, effect
        seconds, before, now = utc_s - self.sample_utc_s, self._commanded.last, expected[0]
        left = (
            wrap180(sample.ra_deg - self.ra.predicted_deg(seconds, effect[0])),
            sample.dec_deg - self.dec.predicted_deg(seconds, effect[1]),
        )
        sigmas = (
            self.ra.expected_sigma_deg(now.ra_rate_deg_s - before.ra_rate_deg_s),
            self.dec.expected_sigma_deg(now.dec_rate_deg_s - before.dec_rate_deg_s),
        )
        surprise = (left[0] / sigmas[0]) ** 2 + (left[1] / sigmas[1]) ** 2
        if surprise < SURPRISE_SIGMAS**2:
            return expected, effect
        turn = LoopTurn(left, (self.ra.answers_s(seconds), self.dec.answers_s(seconds)), sigmas, now)
        best, least = now, surprise * EXPLAINED_SHARE
        for step in OTHERS:
            other = self.history.other(step, self.sample_utc_s)
            unexplained = math.inf if other is None else turn.surprise(other)
            if other is not None and unexplained < least:
                best, least = Step(self.sample_utc_s, other.ra_rate_deg_s, other.dec_rate_deg_s), unexplained
        if best is now:
            return expected, effect
        self.misread += 1
        self.trials.misread(best, self.history)
        return [best], self._commanded.effects(self.sample_utc_s, utc_s, [best, *coming])
