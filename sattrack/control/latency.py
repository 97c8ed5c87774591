"""When a status was sampled: the mount's own clock related to ours by its fastest arrivals.

Every status carries the mount's sidereal time. Arrival minus that time is the clocks' offset plus a delay
that is never negative, so the offset is the lower envelope of what is seen, and its slope is the drift.

A mount's clock that goes in steps coarser than the instants that it is to date.

A loop that turns evenly shows it: the dates then scatter about a line through the turns, and the arrivals
follow the line and not the dates. Where the loop itself turns unevenly, as by a coarse timer, the arrivals
follow the dates, which are right.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from sattrack.core.angles import wrap180
from sattrack.mount.model import SIDEREAL_RATE_DEG_S, mean_sidereal_deg

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from sattrack.control.axis_filter import Array

FORGETTING = 0.995
"""What a turn counts over the next one, in the line: some ten seconds matter."""
SHARE = 0.01
"""What a turn counts in the statistics."""
LEAST_TURNS = 120
BEGINS_ABOVE, ENDS_BELOW = 0.6, 0.3
"""How much of a date's distance from the line the arrivals must share, 0 to 1, to believe in the line."""
SURE_WITHIN = 0.15
"""How well that must be known, one sigma: delays that vary say nothing of steps that are finer."""
FINE_S = 0.00015
"""Scatter, one sigma, below which no clock is called coarse."""
LONGEST_DELAY_S = 0.02
"""Delays beyond the mean one that say nothing more."""
ASTRAY_S = 0.1
ASTRAY_TURNS = 5
"""So many turns in a row off the line are of a loop that left some out; fewer were late."""


@dataclass(slots=True)
class TurnLine:
    """A line through the instants of the loop's turns, the last of them counting most."""

    period_s: float
    _counter: int = 0
    _origin_s: float = 0.0
    _counts: float = 0.0
    _turns: float = 0.0
    _squares: float = 0.0
    _late: float = 0.0
    _products: float = 0.0
    noted: int = 0

    def begin(self, counter: int, utc_s: float) -> None:
        """Begin anew with one turn."""
        self._counter, self._origin_s, self.noted = counter, utc_s, 1
        self._counts, self._turns, self._squares, self._late, self._products = 1.0, 0.0, 0.0, 0.0, 0.0

    def advance(self, counter: int) -> None:
        """Go on to a later turn."""
        turns = counter - self._counter
        self._counter = counter
        self._origin_s += turns * self.period_s
        self._squares += turns * (turns * self._counts - 2.0 * self._turns)
        self._turns -= turns * self._counts
        self._products -= turns * self._late

    def shift(self, by_s: float) -> None:
        """Move the line: the loop goes on so much later."""
        self._origin_s += by_s

    def note(self, utc_s: float) -> None:
        """Take the instant of the turn that was gone on to."""
        late_s = utc_s - self._origin_s
        self._counts = FORGETTING * self._counts + 1.0
        self._turns *= FORGETTING
        self._squares *= FORGETTING
        self._late = FORGETTING * self._late + late_s
        self._products *= FORGETTING
        self.noted += 1

    @property
    def utc_s(self) -> float:
        """Instant of the turn that was gone on to, by the line."""
        spread = self._counts * self._squares - self._turns * self._turns
        if spread <= 0.0:
            return self._origin_s + self._late / self._counts
        return self._origin_s + (self._squares * self._late - self._turns * self._products) / spread


@dataclass(slots=True)
class SteppedClock:
    """Tells whether the mount's clock goes in coarse steps, and dates by its mean then."""

    period_s: float
    coarse: bool = False
    _line: TurnLine = field(init=False)
    _counter: int | None = None
    _astray: list[float] = field(default_factory=list)
    _off: float = 0.0
    _delay: float = 0.0
    _off_variance: float = 0.0
    _delay_variance: float = 0.0
    _shared: float = 0.0

    def __post_init__(self) -> None:
        """Begin without any turn."""
        self._line = TurnLine(self.period_s)

    @property
    def step_s(self) -> float:
        """The clock's step, seconds: its dates lie evenly within one."""
        return math.sqrt(12.0 * self._off_variance)

    def date(self, counter: int, dated_utc_s: float, arrival_utc_s: float) -> float:
        """Return the instant of a turn that the clock dates; what it dates where it is fine enough.

        Call once a status, in order.
        """
        line = self._line
        if self._counter is None or counter <= self._counter:
            self._begin(counter, dated_utc_s)
            return dated_utc_s
        self._counter = counter
        line.advance(counter)
        off_s = dated_utc_s - line.utc_s
        if abs(off_s) > ASTRAY_S:
            # The loop stood still, or one of the clocks was set.
            self._begin(counter, dated_utc_s)
            return dated_utc_s
        if self.coarse and abs(off_s - self._off) > self.step_s:
            self._astray.append(off_s - self._off)
            if len(self._astray) == ASTRAY_TURNS:
                line.shift(sum(self._astray) / ASTRAY_TURNS)
                self._astray.clear()
            return dated_utc_s
        self._astray.clear()
        self._weigh(off_s, arrival_utc_s - dated_utc_s)
        line.note(dated_utc_s)
        if not self.coarse:
            return dated_utc_s
        # The clock shows the beginning of a step, and a turn comes half a step later in the mean.
        return line.utc_s + 0.5 * self.step_s

    def _begin(self, counter: int, dated_utc_s: float) -> None:
        self._line.begin(counter, dated_utc_s)
        self._astray.clear()
        self._counter, self.coarse = counter, False
        self._off = self._delay = self._off_variance = self._delay_variance = self._shared = 0.0

    def _weigh(self, off_s: float, delay_s: float) -> None:
        """Hold a date's distance from the line against how long its status seems to have taken."""
        share = max(SHARE, 1.0 / self._line.noted)
        off = off_s - self._off
        delay = delay_s - self._delay
        if self._line.noted > 1:
            delay = max(-LONGEST_DELAY_S, min(LONGEST_DELAY_S, delay))
        self._off += share * off
        self._delay += share * delay
        keep = 1.0 - share
        self._off_variance = keep * (self._off_variance + share * off * off)
        self._delay_variance = keep * (self._delay_variance + share * delay * delay)
        self._shared = keep * (self._shared - share * off * delay)
        sure = 0.5 * SHARE * self._delay_variance < SURE_WITHIN**2 * self._off_variance
        if self._line.noted < LEAST_TURNS or not sure:
            return
        bound = ENDS_BELOW if self.coarse else BEGINS_ABOVE
        self.coarse = self._off_variance > FINE_S**2 and self._shared > bound * self._off_variance


SIDEREAL_SECONDS_PER_SECOND = 1.00273790935
BUCKET_S = 1.0
BUCKETS = 60
USUAL_DRIFT = 35e-6
"""Drift of a quartz clock, one sigma."""
LEAST_LATENESS_S = 20e-6
"""Arrivals are never more even than this."""
REMEMBERED_DELAYS = 200
LARGEST_DRIFT = 200e-6
"""Quartz clocks are better than this; a larger slope is delays, not drift."""
STEP_S = 0.1
STEP_PROOF = 10
"""Samples in a row that all come later than the envelope by STEP_S are a clock that was set, not delays."""
PLAUSIBLE_RATE_ERROR = 0.01
TRUST_SAMPLES = 40
LARGEST_PERIOD_ERROR = 0.5
HELD_UP_PERIODS = 0.6
"""Lateness from which on a status was held up: a coarse timer's turns differ by less."""
KNOWN_WITHIN_S = 0.015
"""How far the fastest arrivals may be from the profile's delay: jitter is no more than that."""
OURS_AHEAD_S, OURS_BEHIND_S = 0.005, 1.0
"""How far ahead of its arrival our own clock may date a status, and behind: farther, one of two was set."""


@dataclass(frozen=True, slots=True)
class Envelope:
    """Our clock minus the mount's: `offset_s` at `at_s` of the mount's seconds, changing by `drift`."""

    at_s: float
    offset_s: float
    drift: float = 0.0

    def offset_at(self, mount_s: float) -> float:
        """Return the offset at a time of the mount's clock."""
        return self.offset_s + self.drift * (mount_s - self.at_s)


Point = tuple[float, float]
"""A time and an offset, seconds."""


def lower_hull(points: Iterable[Point], onto: Sequence[Point] = ()) -> list[Point]:
    """Return the lower convex hull of points in order of time; `onto` is that of those before them."""
    hull = list(onto)
    for t, y in points:
        while len(hull) >= 2:
            t1, y1 = hull[-2]
            t2, y2 = hull[-1]
            if (t2 - t1) * (y - y1) - (y2 - y1) * (t - t1) > 0.0:
                break
            hull.pop()
        hull.append((t, y))
    return hull


def lower_envelope(
    points: list[Point],
    largest_drift: float = LARGEST_DRIFT,
    stiffness_s: float = 0.0,
    hull_before_last: Sequence[Point] | None = None,
) -> Envelope:
    """Return the most likely line under all points (time, offset), which are later than it by chance.

    Chance is exponential, and the slope is normal about zero: `stiffness_s` is the mean lateness over the
    slope's variance. At 0 that is the line that lies nearest to the points on average: it runs along the
    edge of the lower convex hull over their mean time. Needs one point or more, in order of time. The slope
    is bounded by what clocks do. Whoever knows the hull of all but the last point may hand it in.
    """
    at_s, offset_s = points[0]
    if len(points) == 1:
        return Envelope(at_s, offset_s)
    hull = lower_hull(points if hull_before_last is None else points[-1:], hull_before_last or ())
    middle_s = sum([p[0] for p in points]) / len(points)
    edges = [(y - y0) / (t - t0) for (t0, y0), (t, y) in pairwise(hull)]
    drift = -math.inf
    # A line of a slope between those of its edges rests on a corner of the hull.
    for (corner_s, _), upper in zip(hull, [*edges, math.inf], strict=True):
        pull_s = len(points) * (middle_s - corner_s)
        drift = max(drift, pull_s / stiffness_s if stiffness_s > 0.0 else math.copysign(math.inf, pull_s))
        if drift <= upper:
            break
        drift = upper
    drift = max(-largest_drift, min(largest_drift, drift))
    return Envelope(at_s, min([y - drift * (t - at_s) for t, y in points]), drift)


@dataclass(frozen=True, slots=True)
class KnownClock:
    """A mount's clock whose error is known: `offset_s` ahead of mean sidereal time by UTC at a longitude."""

    longitude_deg: float
    offset_s: float

    def date(self, sidereal_h: float, near_utc_s: float) -> float:
        """Return the UTC instant, POSIX seconds, nearest to `near_utc_s` at which that clock shows this."""
        expected_deg = mean_sidereal_deg(near_utc_s, self.longitude_deg)
        ahead_deg = wrap180(sidereal_h * 15.0 - expected_deg)
        return near_utc_s + ahead_deg / SIDEREAL_RATE_DEG_S - self.offset_s


MOST_OFF_S, STEP_OFF_S = 0.045, 0.001
"""How far a profile's delay may be off, and how finely that is looked for."""
ROUGH_S, CALIBRATED_S = 0.016, 0.003
"""How far it usually is off, one sigma: one that was not measured, and one that was."""
BLUR_S = 0.003
"""How sharply an acknowledgement bounds a delay: samples are dated no better."""
UNREAD, LOST = math.exp(-4.0), math.exp(-3.0)
"""How often a datagram is acknowledged that by the delay was yet to come; and not, though it was there."""


class AcknowledgedDelay:
    """How long commands take, by which status was the first to acknowledge the flags that they raised.

    The mount cannot have read them before they arrived; and had they been there before the status that came
    last, that would have acknowledged them already, but for a datagram that was lost. It is the delay against
    the instants by which samples are dated: what those are wrong by is in it, and it may be negative.
    """

    def __init__(self, told_s: float, sigma_s: float) -> None:
        """Begin with a profile's delay, and how surely that is known."""
        offs_s = np.arange(-MOST_OFF_S, MOST_OFF_S + 0.5 * STEP_OFF_S, STEP_OFF_S)
        self._delays_s: Array = told_s + offs_s
        self._likely: Array = -0.5 * (offs_s / sigma_s) ** 2
        self.noted = 0
        """How many were noted."""

    def note(self, raised_utc_s: float, before_utc_s: float, by_utc_s: float) -> None:
        """Note that flags raised at an instant were acknowledged by a status, and not by the one before."""
        self.noted += 1
        arrived_s = raised_utc_s + self._delays_s
        there, there_before = (
            np.clip((at_s - arrived_s) / BLUR_S + 0.5, 0.0, 1.0) for at_s in (by_utc_s, before_utc_s)
        )
        self._likely = self._likely + np.log(np.maximum(there, UNREAD) * (1.0 - (1.0 - LOST) * there_before))

    def likely(self, delays_s: Array) -> Array:
        """Return the logarithm of the likelihood of delays."""
        found: Array = np.interp(delays_s, self._delays_s, self._likely)
        return found

    @property
    def delay_s(self) -> tuple[float, float]:
        """The expected delay and its sigma, seconds."""
        weights = np.exp(self._likely - self._likely.max())
        weights /= weights.sum()
        mean_s = float(weights @ self._delays_s)
        return mean_s, math.sqrt(float(weights @ (self._delays_s - mean_s) ** 2) + STEP_OFF_S**2)


@dataclass(slots=True)
class Arrivals:
    """Arrivals against the count of the loop's turns: tells what was held up and comes in a burst."""

    period_s: float
    _lately: deque[tuple[int, float]] = field(default_factory=lambda: deque(maxlen=TRUST_SAMPLES))

    def note(self, counter: int, arrival_utc_s: float) -> None:
        """Take a status; counters rise, or begin anew."""
        if self._lately:
            last, last_s = self._lately[-1]
            if counter <= last:
                self._lately.clear()
            elif arrival_utc_s - last_s < (counter - last) * (1.0 - HELD_UP_PERIODS) * self.period_s:
                # The last one was held up, and says nothing of when statuses should come.
                self._lately.pop()
        self._lately.append((counter, arrival_utc_s))

    @property
    def held_up_s(self) -> float:
        """How much later than the loop's turns let expect the last status came, seconds; 0 for jitter."""
        if not self._lately:
            return 0.0
        first, first_s = self._lately[0]
        if self._lately[-1][0] - first < TRUST_SAMPLES - 1:
            return 0.0
        points = [
            ((n - first) * self.period_s, s - first_s - (n - first) * self.period_s) for n, s in self._lately
        ]
        line = lower_envelope(points, LARGEST_PERIOD_ERROR)
        late_s = points[-1][1] - line.offset_at(points[-1][0])
        return late_s if late_s > HELD_UP_PERIODS * self.period_s else 0.0


@dataclass(slots=True)
class MountClock:
    """Dates samples in UTC, POSIX seconds, from the mount's sidereal time and our arrival instants.

    `status_delay_s` is the shortest delay of a status, from the profile. Where the mount's clock makes no
    sense (it stands still, or runs at another rate), samples are dated by arrival.
    """

    status_delay_s: float
    known: KnownClock | None = None
    period_s: float = 0.05
    """Nominal period of the mount's loop."""
    known_is_ours: bool = False
    """Whether the known clock is our own: then late arrivals say nothing against its dates."""
    trusted: bool = True
    known_holds: bool = True
    """Whether the known clock's dates agree with the arrivals."""
    steps: SteppedClock = field(init=False)
    arrivals: Arrivals = field(init=False)
    _first_h: float | None = None
    _last_h: float = 0.0
    _turns: int = 0
    _first_arrival_s: float = 0.0
    _buckets: deque[Point] = field(default_factory=lambda: deque(maxlen=BUCKETS))
    _hull_before_last: list[Point] = field(default_factory=list)
    _lately: deque[tuple[float, float]] = field(default_factory=lambda: deque(maxlen=TRUST_SAMPLES))
    _envelope: Envelope | None = None
    _astray: int = 0
    _astray_s: float = 0.0
    """How much later than the envelope the first of those was."""
    _known_delays: deque[float] = field(default_factory=lambda: deque(maxlen=TRUST_SAMPLES))
    _lateness_s: float = 0.0
    """By how much a status is later than the fastest, in the mean."""
    _weighed: int = 0

    def __post_init__(self) -> None:
        """Believe the clock to be fine until it shows steps."""
        self.steps = SteppedClock(self.period_s)
        self.arrivals = Arrivals(self.period_s)

    def date(self, sidereal_h: float, arrival_utc_s: float, counter: int | None = None) -> float:
        """Return the UTC instant of a sample; call once a sample, in the order of arrival.

        `counter` is the status' own: without it, a clock that goes in coarse steps is not made up for.
        """
        if counter is not None:
            self.arrivals.note(counter, arrival_utc_s)
        dated_utc_s = self._dated(sidereal_h, arrival_utc_s)
        by_clock = self.trusted or (self.known is not None and self.known_holds)
        if counter is None or not by_clock:
            return dated_utc_s
        return self.steps.date(counter, dated_utc_s, arrival_utc_s)

    def _dated(self, sidereal_h: float, arrival_utc_s: float) -> float:
        mount_s = self._mount_seconds(sidereal_h, arrival_utc_s)
        since_first_s = arrival_utc_s - self._first_arrival_s
        self._judge(mount_s, since_first_s)
        self._watch_for_step(mount_s, since_first_s - mount_s)
        self._take(mount_s, since_first_s - mount_s)
        if self.known is not None:
            dated_utc_s = self.known.date(sidereal_h, arrival_utc_s)
            self._judge_known(arrival_utc_s - dated_utc_s)
            if self.known_holds:
                return dated_utc_s
        if not self.trusted:
            return arrival_utc_s - self.status_delay_s - self.arrivals.held_up_s
        assert self._envelope is not None
        dated_s = mount_s + self._envelope.offset_at(mount_s)
        return self._first_arrival_s + dated_s - self.status_delay_s

    @property
    def coarse_step_s(self) -> float | None:
        """By what steps the clock goes, where those are too coarse to date samples by; else None."""
        return self.steps.step_s if self.steps.coarse else None

    @property
    def lateness_s(self) -> float:
        """By how much a status is later than the fastest, in the mean; 0 where the clock is known."""
        return self._lateness_s

    @property
    def drift(self) -> float:
        """Our clock's rate against the mount's, less one."""
        return 0.0 if self._envelope is None else self._envelope.drift

    def _judge_known(self, delay_s: float) -> None:
        """Believe the known clock as long as its fastest arrivals are as late as the profile has them.

        Else it was set since it was measured. Believing it again takes more than ceasing to.
        """
        self._known_delays.append(delay_s)
        fastest_s = min(self._known_delays)
        if self.known_is_ours:
            self.known_holds = -OURS_AHEAD_S < fastest_s < OURS_BEHIND_S
            return
        off_s = abs(fastest_s - self.status_delay_s)
        bound_s = KNOWN_WITHIN_S if self.known_holds else 0.5 * KNOWN_WITHIN_S
        self.known_holds = off_s < bound_s

    def _mount_seconds(self, sidereal_h: float, arrival_utc_s: float) -> float:
        if self._first_h is None:
            self._first_h = self._last_h = sidereal_h
            self._first_arrival_s = arrival_utc_s
        change = sidereal_h - self._last_h
        if change < -12.0:
            self._turns += 1
        elif change > 12.0:
            self._turns -= 1
        self._last_h = sidereal_h
        assert self._first_h is not None
        hours = self._turns * 24.0 + sidereal_h - self._first_h
        return hours * 3600.0 / SIDEREAL_SECONDS_PER_SECOND

    def _judge(self, mount_s: float, since_first_s: float) -> None:
        """Believe the mount's clock as long as it has lately run as fast as ours.

        A status that was held back counts as of when it should have come.
        """
        self.trusted = self._runs_evenly(mount_s, since_first_s)
        if not self.trusted:
            since_first_s -= self.arrivals.held_up_s
            self.trusted = self._runs_evenly(mount_s, since_first_s)
        self._lately.append((mount_s, since_first_s))

    def _runs_evenly(self, mount_s: float, since_first_s: float) -> bool:
        if not self._lately:
            return True
        ran_s = mount_s - self._lately[0][0]
        passed_s = since_first_s - self._lately[0][1]
        return abs(ran_s - passed_s) < PLAUSIBLE_RATE_ERROR * passed_s + 2.0 * STEP_S

    def _watch_for_step(self, mount_s: float, offset_s: float) -> None:
        """Begin anew where one of the two clocks has been set: what was learnt before is of another clock."""
        if self._envelope is None:
            return
        residual_s = offset_s - self._envelope.offset_at(mount_s)
        stepped_back = residual_s < -STEP_S
        if residual_s <= STEP_S:
            self._astray = 0
        elif self._astray == 0 or residual_s < self._astray_s - STEP_S:
            # What was held back comes less and less late.
            self._astray, self._astray_s = 1, residual_s
        else:
            self._astray += 1
        if stepped_back or self._astray >= STEP_PROOF:
            self._buckets.clear()
            self._envelope = None
            self._astray = 0

    def _take(self, mount_s: float, offset_s: float) -> None:
        newest = self._buckets[-1] if self._buckets else None
        if self._envelope is not None:
            self._weighed += 1
            late_s = min(STEP_S, max(0.0, offset_s - self._envelope.offset_at(mount_s)))
            self._lateness_s += (late_s - self._lateness_s) / min(self._weighed, REMEMBERED_DELAYS)
        if newest is not None and mount_s // BUCKET_S == newest[0] // BUCKET_S:
            if offset_s >= newest[1]:
                return
            self._buckets[-1] = (mount_s, offset_s)
        else:
            self._buckets.append((mount_s, offset_s))
            self._hull_before_last = lower_hull(list(self._buckets)[:-1])
        # The earliest of so many is later than the fastest by as much less.
        lateness_s = max(LEAST_LATENESS_S, self._lateness_s * self.period_s / BUCKET_S)
        stiffness_s = lateness_s / USUAL_DRIFT**2
        self._envelope = lower_envelope(
            list(self._buckets), stiffness_s=stiffness_s, hull_before_last=self._hull_before_last
        )
