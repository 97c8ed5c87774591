"""`Tracker.step`: joins target, filters and phases into the motion that is wanted now. Pure.

Its only inputs are its plan, the samples and messages handed to it, and the instant; it reads no clock, file,
socket or random number, so the same inputs give the same outputs to the last bit.
"""

from __future__ import annotations

from collections import deque
from enum import StrEnum
from typing import TYPE_CHECKING

import msgspec

from sattrack.control.approach import Approach, Stand, Step
from sattrack.control.axes import Axes
from sattrack.control.biases import UPRIGHT, Camera
from sattrack.control.detour import Detour, Passage, Place
from sattrack.control.feeder import Learning, Way, ramped_deg_s, rate_deg_s
from sattrack.control.history import EDGE_PERIODS, CommandHistory, MountLoop, SentRates
from sattrack.control.latency import KnownClock, MountClock
from sattrack.control.law import ControlLaw
from sattrack.control.rest import Rest
from sattrack.control.sky_error import Target, sky_error
from sattrack.control.steering import Steering
from sattrack.core.angles import wrap180
from sattrack.mount.model import Hold, Motion, MountProfile, MoveAxes, Slew, StatusSample, Stop
from sattrack.views.messages import Go, Jog, Message, Observation, Pause, Search, SeenOffset, StopNow
from tle.instants import Utc

if TYPE_CHECKING:
    from sattrack.views.run import ErrorView, RememberedView
    from tle.bias import Bias
    from tle.direction import Direction
    from tle.propagator import Propagator

ACQUIRED_AFTER_SAMPLES = 10
LOST_ARCSEC = 120.0
IDLE_SHIFT_S, IDLE_SHIFT_SHARE = 0.002, 0.2
"""How fast the sending falls into step with the mount's loop before anything is followed."""
UNDATED_AT_MOST = 15
"""Samples in a row dated no later than the one before that are left out: a clock is learnt anew meanwhile."""
SAME_INSTANT_S = 0.0005
FORETOLD_KEPT = 12
Rates = tuple[float, float]
MOST_EDGE_PERIODS = 12.0
"""The longest that the rates of one edge act: until the next, which the handshake lets through."""


class Phase(StrEnum):
    """What the tracker is doing, in words for people."""

    WAITING = "waiting"
    SLEWING = "slewing"
    ACQUIRING = "acquiring"
    TRACKING = "tracking"
    PAUSED = "paused"
    STOPPING = "stopping"


FOLLOWING = frozenset({Phase.ACQUIRING, Phase.TRACKING})


class TrackPlan(msgspec.Struct, frozen=True):
    """When to follow, and how near is near: UTC as POSIX seconds, arcseconds on the sky.

    `detours` are ways past the celestial pole where the hour angle turns too fast, in order of time.
    """

    start_utc_s: float
    end_utc_s: float
    approach_s: float = 60.0
    """How long before the start the slew to the waiting point may begin."""
    on_target_arcsec: float = 2.0
    detours: tuple[Detour, ...] = ()
    law: ControlLaw = ControlLaw()
    """With which constants the error is taken out."""


class Tracker:
    """Follows one satellite over one window with one mount."""

    def __init__(
        self,
        propagator: Propagator,
        plan: TrackPlan,
        profile: MountProfile,
        bias: Bias,
        camera: Camera = UPRIGHT,
        remembered: RememberedView | None = None,
    ) -> None:
        self.plan = plan
        self._profile = profile
        self.steering = Steering(propagator, profile, bias, camera, plan.start_utc_s, remembered)
        known = None
        if profile.clock_offset_s is not None:
            known = KnownClock(propagator.site.longitude_deg, profile.clock_offset_s)
        self._clock = MountClock(profile.status_delay_s, known, profile.period_s)
        self._loop = MountLoop(profile.period_s)
        self._history = CommandHistory(profile.command_delay_s, self._loop)
        self._axes: Axes | None = None
        self.learning = Learning()
        """What the run learns of the mount while it follows."""
        self._passage = Passage(plan.detours) if plan.detours else None
        self._way = Approach(profile, self.direction_at, plan.law.feeder)
        self._stand = Stand(0.0, 0.0, 0.0)
        self._near = 0
        self._undated = 0
        self._foretold: deque[tuple[float, Direction]] = deque(maxlen=FORETOLD_KEPT)
        """The target at the ends of the intervals that the last commands are for."""
        self._moved_by_rates = False
        """Whether the mount is in MoveAxis as a pause ends."""
        self._last_edge_utc_s: float | None = None
        edge = profile.move_axis == "edge"
        self._acting_s = profile.period_s * (EDGE_PERIODS if edge else 1.0)
        """For how long a command that is sent is expected to act."""
        self.phase = Phase.WAITING
        self.ended_by: str | None = None
        self.acquired_utc_s: float | None = None
        self._on_target_utc_s: float | None = None
        """Since when the mount is on the target, where it is."""
        self.followable_utc_s: float | None = None
        """First instant at which the mount, being there, could have followed."""
        self.lost_utc_s: float | None = None
        """When the mount was last seen where nothing that is known leads."""
        self.rest: Rest | None = None
        """How the mount rests while the run is paused; None while it is not."""
        self.error: ErrorView | None = None
        self.target = Target(0.0, 0.0, 0.0, 0.0)
        """Where the satellite was fed at the instant of the error."""
        self.rates = MoveAxes(0.0, 0.0)

    def use(self, propagator: Propagator) -> None:
        """Take directions from another propagator of the same satellite from now on."""
        self.steering.biases.use(propagator)
        self._foretold.clear()

    @property
    def clock_holds(self) -> bool:
        """Whether the mount's clock is where the profile says, if it says so."""
        return self._clock.known_holds

    @property
    def clock_runs(self) -> bool:
        """Whether the mount's clock runs as ours does."""
        return self._clock.trusted

    @property
    def clock_step_s(self) -> float | None:
        """By what steps the mount's clock goes, where those are too coarse to date samples by; else None."""
        return self._clock.steps.step_s if self._clock.steps.coarse else None

    @property
    def trouble(self) -> str | None:
        """Why the way to the target was given up: what the mount did, in words."""
        return self._way.trouble

    def direction_at(self, utc_s: float) -> Direction:
        """Return where the satellite is fed at an instant, all offsets of that instant applied."""
        return self.steering.biases.at(utc_s)

    def take(self, sample: StatusSample) -> ErrorView:
        """Take in one sample; return its error on the sky, dated by the mount's own clock."""
        utc_s = self._clock.date(sample.sidereal_h, sample.arrival_utc_s, sample.counter)
        self._loop.note(sample.counter, utc_s)
        axes = self._axes
        believed = True
        seen = sample if self._passage is None else self._passage.unfolded(sample)
        undated = axes is not None and utc_s <= axes.sample_utc_s
        self._undated = self._undated + 1 if undated else 0
        if 0 < self._undated <= UNDATED_AT_MOST:
            believed = False
        elif axes is None or not axes.follows(utc_s):
            self._begin_axes(seen, utc_s)
        else:
            believed = axes.take(seen, utc_s, self.phase in FOLLOWING)
            self._learn(axes, seen, utc_s, believed)
            if axes.early:
                self._history.arrives_early()
            if axes.lost:
                self.lost_utc_s = utc_s
                self._begin_axes(seen, utc_s)
        if self.rest is not None:
            self.rest.see(sample)
        self._stand = Stand(sample.sidereal_h * 15.0, sample.ra_deg, sample.dec_deg, sample.beyond_pole)
        self.target = self._foreseen(utc_s)
        self.error = sky_error(utc_s, sample.ra_deg, sample.dec_deg, self.target)
        if believed:
            self._judge(self.error)
        return self.error

    def _begin_axes(self, seen: StatusSample, utc_s: float) -> None:
        if self._axes is not None and self._axes is self.learning.axes and self.phase in FOLLOWING:
            self.learning.anew()
        self._axes = Axes.begin(
            self._profile, self._history, seen, utc_s, self.plan.law.filter, former=self._axes
        )

    def _learn(self, axes: Axes, seen: StatusSample, utc_s: float, believed: bool) -> None:
        if believed and self.phase in FOLLOWING:
            self.learning.take(axes, seen, utc_s)
        else:
            self.learning.pause()

    @property
    def command_delay_s(self) -> float:
        """From sending to the mailbox, as it is reckoned with, seconds."""
        return self._history.delay_s

    @property
    def acting_s(self) -> float:
        """For how long a command acts, seconds."""
        return max(self._loop.mean_period_s, self._acting_s)

    def operate(self, message: Message, now_utc_s: float) -> None:
        """Obey the operator, and listen to whoever observes."""
        match message:
            case StopNow():
                self.end("operator")
            case Pause():
                self._pause(now_utc_s)
            case Go():
                self._go_on(now_utc_s)
            case Jog():
                self._jog(message, now_utc_s)
            case SeenOffset() if (why := self._not_seen(message)) is not None:
                self.steering.estimator.refuse(why)
            case Search() if self.rest is not None:
                self.steering.tell("the run is paused: go on before a search", now_utc_s)
            case _:
                self.steering.obey(message, now_utc_s)
        if not isinstance(message, Observation | SeenOffset):
            self._foretold.clear()

    def _not_seen(self, seen: SeenOffset) -> str | None:
        """Return why an offset says nothing of where the target is: the mount was not on it."""
        utc_s, on_s = float(Utc.parse(seen.utc).unix_s), self._on_target_utc_s
        if self.phase is not Phase.TRACKING:
            return "the mount is not on the target"
        if on_s is None or utc_s < on_s:
            return f"it is of {seen.utc}, before the mount was on the target"
        return None

    def step(self, now_utc_s: float, slew_done: bool, stopped: bool = False, held: bool = False) -> Motion:
        """Return the motion wanted from now on; call once a period, after the samples that came.

        `slew_done` tells whether the slew last asked for has arrived, `stopped` whether the stop of a pause
        was seen through, `held` whether a limit keeps the mount off the target.
        """
        if now_utc_s >= self.plan.end_utc_s:
            self.end("set")
        if self.phase is Phase.STOPPING:
            return Stop()
        if self.steering.watch(now_utc_s):
            self._foretold.clear()
        if self.rest is not None:
            return self._rests(self.rest, now_utc_s, stopped)
        if self._axes is None:
            return Hold()
        if self.phase is Phase.WAITING and now_utc_s >= self.plan.start_utc_s - self.plan.approach_s:
            moving, self._moved_by_rates = self._moved_by_rates, False
            self._approach(now_utc_s, moving)
        if self.phase is Phase.SLEWING:
            return self._slew(now_utc_s, slew_done, self._axes)
        left_behind = self.phase is Phase.ACQUIRING and self._is_left_behind(now_utc_s, held)
        if left_behind:
            self._approach(now_utc_s, moving=True, held=held)
        if self.phase in FOLLOWING and not left_behind:
            return self._follow(now_utc_s, self._axes)
        return Hold()

    def end(self, why: str) -> None:
        """Stop from now on; `why` is what `ended_by` says, unless it says something already."""
        if self.ended_by is None:
            self.ended_by = why
        self.phase = Phase.STOPPING
        self.rest = None
        self.rates = MoveAxes(0.0, 0.0)

    def _rests(self, rest: Rest, now_utc_s: float, stopped: bool) -> Motion:
        motion = rest.step(now_utc_s, stopped)
        self.rates = motion if isinstance(motion, MoveAxes) else MoveAxes(0.0, 0.0)
        if rest.going_on and rest.at_rest:
            self._leave(rest)
        return motion

    def _pause(self, now_utc_s: float) -> None:
        """Bring the mount to rest from any phase of the pass; a search ends where it is."""
        if self.phase is Phase.STOPPING:
            return
        self.steering.refusal = None
        if self.rest is not None:
            self.rest.going_on = False
            return
        self.steering.keep_search(now_utc_s)
        self.rest, self.phase = Rest(now_utc_s, self._profile), Phase.PAUSED
        self.rates = MoveAxes(0.0, 0.0)
        if self.acquired_utc_s is None:
            self.followable_utc_s = None

    def _go_on(self, now_utc_s: float) -> None:
        """Take the pass up again as soon as the mount is at rest: a slew is not judged by axes that brake."""
        self.steering.refusal = None
        if self.rest is None:
            self.steering.tell("the run is not paused", now_utc_s)
        else:
            self.rest.go_on()

    def _leave(self, rest: Rest) -> None:
        """End a pause: the way onto the target is planned next, from where the mount stands."""
        self._moved_by_rates, self.rest = rest.streams, None
        self.phase = Phase.WAITING
        if self._passage is not None:
            # It may have been left on the other side of the pole, of which a new way knows nothing.
            self._axes = None

    def _jog(self, order: Jog, now_utc_s: float) -> None:
        why = "the run is not paused: pause it first"
        refusal = why if self.rest is None else self.rest.jog(order, now_utc_s)
        self.steering.tell(refusal, now_utc_s)

    def end_jogs(self, words: str, now_utc_s: float) -> None:
        """End what is jogged, and tell why."""
        if self.rest is not None:
            self.rest.end_jogs(words)
            self.steering.tell(words, now_utc_s)

    def _approach(self, now_utc_s: float, moving: bool = False, held: bool = False) -> None:
        """Choose the way to the target: a slew, or rates alone."""
        step = self._way.plan(now_utc_s, self.plan.start_utc_s, self._stand, moving, held)
        if self._way.intercept.utc_s >= self.plan.end_utc_s:
            self.end("set")
            return
        if self.followable_utc_s is None:
            self.followable_utc_s = self._way.intercept.utc_s
        self._near = 0
        self.phase = Phase.SLEWING
        if step is Step.FOLLOW:
            self._begin_following(now_utc_s)

    def _begin_following(self, now_utc_s: float) -> None:
        self.phase = Phase.ACQUIRING
        if self._passage is not None:
            self._passage = self._passage.from_instant(now_utc_s)

    def _slew(self, now_utc_s: float, slew_done: bool, axes: Axes) -> Motion:
        step = self._way.go_on(now_utc_s, slew_done, self._stand)
        if step is Step.FOLLOW:
            self._begin_following(now_utc_s)
            return self._follow(now_utc_s, axes)
        if step is Step.GIVE_UP:
            self.end("error")
            return Stop()
        if step is Step.PLAN:
            # Between two slews nothing is wanted for a moment: the second is one of its own.
            self.phase = Phase.WAITING
            return Hold()
        return Slew(self._way.intercept.ra_deg, self._way.intercept.dec_deg)

    def _is_left_behind(self, now_utc_s: float, held: bool) -> bool:
        """Tell whether the target is so far off that a slew leads there sooner."""
        # Detours leave it on purpose.
        if self._passage is not None or self.error is None:
            return False
        off_deg = self.error.total_arcsec / 3600.0
        return self._way.slew_ahead(now_utc_s, self.plan.end_utc_s, off_deg, self._stand, held)

    def _follow(self, now_utc_s: float, axes: Axes) -> MoveAxes:
        # The mount obeys at its first loop after this command has arrived, until the first after the next.
        arrives = now_utc_s + self._history.delay_s
        law = self.plan.law.feeder
        share = law.tracking_share if self.phase is Phase.TRACKING else 1.0
        acts = self._loop.first_from(max(arrives, axes.sample_utc_s + 0.5 * self._loop.mean_period_s))
        interval = max(self._loop.first_from(arrives + self._acting_s) - acts, self._loop.mean_period_s)
        ahead_s = self._ahead_s(axes)
        begin, end = self._ends(acts + ahead_s, interval)
        bound_for, before = axes.bound_for(acts)
        bend = self._bend_deg_s2(begin, end, interval)
        ra_way = Way(begin.ra_deg, wrap180(float(end.ra_deg) - begin.ra_deg), interval, bend[0], ahead_s)
        dec_way = Way(begin.dec_deg, float(end.dec_deg) - begin.dec_deg, interval, bend[1], ahead_s)
        profile = self._profile
        ra_limit, dec_limit = share * profile.ra.max_rate_deg_s, share * profile.dec.max_rate_deg_s
        near_ra = ra_way.begin_deg + wrap180(bound_for[0] - ra_way.begin_deg)
        ra = rate_deg_s(ra_way, near_ra, axes.ra, profile.ra, ra_limit, law)
        dec = rate_deg_s(dec_way, bound_for[1], axes.dec, profile.dec, dec_limit, law)
        self.rates = MoveAxes(
            ramped_deg_s(ra, before[0], profile.ra, interval, law),
            ramped_deg_s(dec, before[1], profile.dec, interval, law),
        )
        if self._passage is not None:
            self.rates = self._passage.reported(self.rates, bound_for[1])
        return self.rates

    def _ahead_s(self, axes: Axes) -> float:
        """Return for how much later than they act commands are made: the axes' lag, in whole turns."""
        period_s = self._loop.mean_period_s
        return period_s * round(0.5 * (axes.ra.lag.mean_s + axes.dec.lag.mean_s) / period_s)

    def _bend_deg_s2(self, begin: Target | Place, end: Direction | Place, interval_s: float) -> Rates:
        """Return how fast the target's rates change."""
        if isinstance(begin, Place) or isinstance(end, Place):
            return 0.0, 0.0
        return (
            (float(end.ra_rate_deg_s) - begin.ra_rate_deg_s) / interval_s,
            (float(end.dec_rate_deg_s) - begin.dec_rate_deg_s) / interval_s,
        )

    def _ends(self, acts_utc_s: float, interval_s: float) -> tuple[Target | Place, Direction | Place]:
        """Return where the axes must be at both ends of the interval in which a command acts."""
        begin = self._foreseen(acts_utc_s)
        ends_utc_s = acts_utc_s + interval_s
        end = self.direction_at(ends_utc_s)
        self._foretold.append((ends_utc_s, end))
        if self._passage is None:
            return begin, end
        return (
            self._passage.place(acts_utc_s, begin.ra_deg, begin.dec_deg),
            self._passage.place(ends_utc_s, float(end.ra_deg), float(end.dec_deg)),
        )

    def _foreseen(self, utc_s: float) -> Target:
        """Return the target's place at an instant: that of an interval's end, where it is the same.

        Commands end, and samples are taken, at the loop's turns, foretold a little differently each time.
        Over SAME_INSTANT_S the target's rate makes up for that to a thousandth of an arcsecond.
        """
        for at_utc_s, known in reversed(self._foretold):
            if abs(utc_s - at_utc_s) <= SAME_INSTANT_S:
                return Target.at(known, utc_s - at_utc_s)
        return Target.at(self.direction_at(utc_s))

    def send_shift_s(self, now_utc_s: float) -> float:
        """Return the delay of the next datagram beyond one period from now, seconds."""
        arrival_utc_s = now_utc_s + self._history.delay_s
        if self.phase not in FOLLOWING:
            return self._loop.send_shift_s(arrival_utc_s, IDLE_SHIFT_S, IDLE_SHIFT_SHARE)
        return self._loop.send_shift_s(arrival_utc_s)

    def note_sent(self, motion: Motion, now_utc_s: float) -> None:
        """Note what was really sent, after safety had its say: the filters are driven by that."""
        self._way.sent(motion)
        if isinstance(motion, MoveAxes):
            if self._profile.move_axis == "edge":
                self._note_cycle(now_utc_s)
            axes = motion if self._passage is None else self._passage.turned(motion)
            self._history.add(SentRates(now_utc_s, axes.ra_rate_deg_s, axes.dec_rate_deg_s))
        else:
            self._history.clear()

    def _note_cycle(self, now_utc_s: float) -> None:
        """Learn how long the handshake of an edge takes: for so long the rates that it brought will act."""
        last_utc_s, self._last_edge_utc_s = self._last_edge_utc_s, now_utc_s
        if last_utc_s is not None:
            periods = (now_utc_s - last_utc_s) / self._profile.period_s
            self._acting_s = max(2.0, min(MOST_EDGE_PERIODS, periods)) * self._profile.period_s

    def _judge(self, error: ErrorView) -> None:
        if self.phase is Phase.ACQUIRING:
            self._near = self._near + 1 if error.total_arcsec <= self.plan.on_target_arcsec else 0
            if self._near >= ACQUIRED_AFTER_SAMPLES:
                self.phase, self._on_target_utc_s = Phase.TRACKING, error.utc_s
                if self.acquired_utc_s is None:
                    self.acquired_utc_s = error.utc_s
                    self.learning.forget_rates()
        elif self.phase is Phase.TRACKING and error.total_arcsec > LOST_ARCSEC:
            self.phase = Phase.ACQUIRING
            self._near = 0
