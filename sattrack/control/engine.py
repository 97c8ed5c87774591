"""Session, tracker and safety as one thing without I/O: datagrams, messages and instants in, datagrams out.

Live, a 20 Hz loop feeds it; in a test, a simulated mount in virtual time; in a replay, a recording.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING

from sattrack.control.camera_image import NO_CAMERAS, Cameras
from sattrack.control.driver import FOUND_MOVING, NO_ANSWER_AFTER_S, Driver, StopProcedure, limit_text
from sattrack.control.edges import DISOBEYS, EdgeWatch
from sattrack.control.stages import Attempt, AxisAttempt, RunStage, Situation, Stages, why_not
from sattrack.control.target import sky_error
from sattrack.control.tracker import FOLLOWING, Phase, Tracker, TrackPlan
from sattrack.core.errors import UNHEARD
from sattrack.core.figures import RunningError, WindowedError
from sattrack.mount.model import Hold, Slew, StatusSample, Stop
from sattrack.mount.xerxes.flags import SlewState
from sattrack.mount.xerxes.link import LinkState
from sattrack.safety import ROWS, Safety, SafetyLimits
from sattrack.safety.watch import KEEPS_FIRST, SEE_TO_DRIVE
from sattrack.views.messages import Jog
from sattrack.views.run import LearntView, StageView

if TYPE_CHECKING:
    from sattrack.control.following import Learnt
    from sattrack.mount.model import Cleared, MountProfile
    from sattrack.views.messages import Message
    from sattrack.views.run import ErrorView, RememberedView
    from tle.bias import Bias
    from tle.propagator import Propagator

STAGES_KEPT = 16
"""Views come more often than the stages of a run change so many times."""

HOLDING = "holding"
"""The phase in which a limit keeps the mount off its target."""


@dataclass(frozen=True, slots=True)
class RunSpec:
    """What is followed, when, with what: everything that a replay needs besides the inputs."""

    propagator: Propagator
    """Gives the direction to feed to a mount that applies no refraction itself."""
    if_mount_refracts: Propagator
    """Gives the direction to feed to a mount that does."""
    culminate_utc_s: float
    max_alt_deg: float
    plan: TrackPlan
    profile: MountProfile
    limits: SafetyLimits
    bias: Bias
    mount_name: str
    started_utc_s: float
    simulated: bool = False
    recording: str | None = None
    cameras: Cameras = NO_CAMERAS
    remembered: RememberedView | None = None
    """The bias of an earlier pass with which this one begins."""
    first_axis_deg: float | None = None
    """Where a session before left the first axis, turns counted; None for within half a turn of its zero."""
    followed_deg: float | None = None
    """Where the first axis is, turns counted, if it has followed the sky since; None: not known."""


class Engine(Driver):
    """One run with one mount, from the first datagram to the mount seen at rest."""

    by_axes = True

    def __init__(self, spec: RunSpec) -> None:
        super().__init__(spec.profile, safety_of(spec))
        self.spec = spec
        self.tracker = Tracker(
            spec.propagator,
            spec.plan,
            spec.profile,
            spec.bias,
            spec.cameras,
            spec.remembered,
        )
        self.malformed = 0
        """Lines that came where observations or messages were expected, and were neither."""
        self.dropped = 0
        """Observations that came faster than they could be used."""
        self.reported = RunningError()
        self.on_target_s = 0.0
        self.held_s: dict[str, float] = {}
        """Seconds for which each limit held the mount off the target."""
        self.paused_s = 0.0
        """Seconds for which the operator had the run paused."""
        self.rejoining_s = 0.0
        """Seconds that it took to be on the target again after pauses and limits."""
        self.lost_peak_arcsec = 0.0
        """Largest error while a limit held the mount, and on the way back."""
        self.message: str | None = None
        self.failed = False
        self._first_tick_utc_s = math.inf
        self._recent = WindowedError()
        self._missed = WindowedError(), WindowedError()
        """Errors of both axes while the mount followed and had not been on target."""
        self._missed_s = self._clamped_s = 0.0
        """Seconds for which it did, and for which its rate limit was reached meanwhile."""
        self._edges = EdgeWatch(spec.profile.move_axis == "edge")
        self.stages: deque[StageView] = deque(maxlen=STAGES_KEPT)
        """What the run did, a stage after the other: the last ones."""
        self._sorted = Stages(spec.plan, spec.profile)
        self._doing = Phase.WAITING
        """The phase before the run began to stop."""
        self._counted: set[int] = set()
        self._before: StatusSample | None = None

    def receive(self, data: bytes, arrival_utc_s: float) -> StatusSample | None:
        """Take one datagram from the mount; return its sample, None where it was refused."""
        first = self.session.sample is None
        sample = super().receive(data, arrival_utc_s)
        if sample is not None:
            self._take(sample, first)
        return sample

    def _take(self, sample: StatusSample, first: bool) -> None:
        if first and sample.does_refraction:
            self.tracker.use(self.spec.if_mount_refracts)
        if self.failed:
            return
        before, was = self.tracker.error, self._before
        error = self.tracker.take(sample)
        seconds = 0.0 if before is None else error.utc_s - before.utc_s
        self._before = sample
        self._watch_profile()
        self._edges.see(error.utc_s, sample.ra_deg, sample.dec_deg)
        self._judge_edges()
        if was is not None and 0.0 < seconds < self.safety.longest_step_s:
            self._count(error, sample.counter, seconds)

    def _watch_profile(self) -> None:
        """Give up where statuses are not of the kind that the profile tells: it is another mount's."""
        if self.tracker.ended_by is not None:
            return
        for name, expected in self.spec.profile.readings.items():
            shown = getattr(self.session.readings, name)
            if shown is not None and shown != expected:
                self._give_up(
                    "error",
                    f"the profile {self.spec.profile.name!r} is another mount's: it says that {name} is "
                    f"{expected}, and {self.spec.mount_name} sends {shown}; give this mount's profile",
                )
                return

    def _watch_edges(self, error: ErrorView, seconds: float) -> None:
        """Give up where the mount takes rates by its flags in another way than the profile says."""
        if self.tracker.ended_by is not None:
            return
        if self.safety.keeps_first:
            self._give_up("error", f"{self.spec.mount_name} was sent a stop: {KEEPS_FIRST}")
        learning, target = self.tracker.follower.learning, self.tracker.target
        self._edges.miss(error.utc_s, seconds, learning, self.session.unanswered_s, target)
        self._judge_edges()

    def _judge_edges(self) -> None:
        if self._edges.why is not None and self.tracker.ended_by is None:
            self._give_up("error", f"{self.spec.mount_name} {self._edges.why}")

    def _count(self, error: ErrorView, counter: int, seconds: float) -> None:
        """Take an error into the figures: everything from the first acquisition on, lost or not.

        A pause, what a limit takes, and the way back after either are counted apart.
        """
        now = self.situation(error)
        doing, limit = self._sorted.take(now, error.utc_s, self.tracker.target)
        stage = StageView(error.utc_s, doing.name.lower(), limit or None)
        last = self.stages[-1] if self.stages else None
        if last is None or (last.doing, last.held_by) != (stage.doing, stage.held_by):
            self.stages.append(stage)
        if doing is RunStage.HELD:
            self.held_s[limit] = self.held_s.get(limit, 0.0) + seconds
        elif doing is RunStage.PAUSED:
            self.paused_s += seconds
        elif doing is RunStage.REJOINING:
            self.rejoining_s += seconds
        elif doing is RunStage.ACQUIRING:
            self._count_missed(error, seconds)
        if doing in (RunStage.HELD, RunStage.REJOINING) and now.acquired:
            self.lost_peak_arcsec = max(self.lost_peak_arcsec, error.total_arcsec)
        if doing is not RunStage.FOLLOWING:
            self._recent.clear()
            return
        if self.spec.simulated:
            self._counted.add(counter)
        self.reported.add(error.total_arcsec)
        self._recent.add(error.utc_s, error.total_arcsec)
        if error.total_arcsec <= self.spec.plan.on_target_arcsec:
            self.on_target_s += seconds

    def situation(self, error: ErrorView) -> Situation:
        """Return what is known of the run at the status of an error."""
        tracker = self.tracker
        return Situation(
            following=tracker.phase in FOLLOWING,
            tracking=tracker.phase is Phase.TRACKING,
            paused=tracker.rest is not None,
            acquired=tracker.acquired_utc_s is not None,
            ended=tracker.ended_by is not None,
            holding=self.safety.holding,
            error_arcsec=error.total_arcsec,
        )

    def _count_missed(self, error: ErrorView, seconds: float) -> None:
        self._missed_s += seconds
        self._clamped_s += seconds if self.safety.clamping else 0.0
        self._watch_edges(error, seconds)
        for window, arcsec in zip(self._missed, (error.ra_arcsec, error.dec_arcsec), strict=True):
            window.add(error.utc_s, arcsec)

    def why_not_acquired(self) -> str | None:
        """Return why the mount was never on target, and what to do; None where it was, or nothing tells."""
        tracker, profile = self.tracker, self.spec.profile
        if tracker.acquired_utc_s is not None:
            return None
        if self.message is not None and tracker.ended_by not in {"set", "operator"}:
            return self.message
        ra, dec = (
            AxisAttempt(name, field, fit.ratio, fit.fastest_deg_s, fit.fastest_asked_deg_s, window.rms_arcsec)
            for name, field, fit, window in zip(
                profile.axis_names("right ascension"),
                ("ra", "dec"),
                tracker.follower.learning.fits,
                self._missed,
                strict=True,
            )
        )
        return why_not(
            Attempt(
                profile,
                ra,
                dec,
                heard=self.session.sample is not None,
                stopped=tracker.ended_by == "operator",
                slewing=self._doing is Phase.SLEWING,
                followed_s=self._missed_s,
                clamped_s=self._clamped_s,
                held_s=self.held_s,
                learnt=learnt_view(self),
                later_s=tracker.follower.learning.timing.later_s(max(profile.ra.lag_s, profile.dec.lag_s)),
                calibrated=profile.calibration is not None or self.spec.simulated,
            )
        )

    def operate(self, message: Message, now_utc_s: float) -> None:
        """Obey the operator."""
        if isinstance(message, Jog) and self.link_state is not LinkState.UP:
            words = "the mount is not heard: nothing is moved blindly"
            self.tracker.steering.tell(words, now_utc_s)
        else:
            self.tracker.operate(message, now_utc_s)

    def tick(self, now_utc_s: float) -> bytes:
        """Return the datagram to send now; call once a period."""
        if not self.failed:
            self._watch_link(now_utc_s)
        arrived = self.session.slew_state is SlewState.DONE or self.safety.led_there
        arrived = arrived and self.safety.on_last_leg
        rest = self.tracker.rest
        stopped = rest is not None and self.session.stopped
        motion = self.tracker.step(now_utc_s, arrived, stopped, self.safety.holding is not None)
        motion = self._edges.motion(motion, self.tracker.phase is Phase.ACQUIRING and rest is None)
        if self.frame is not None and isinstance(motion, Slew):
            self.safety.choose_turn(self.tracker.onward_deg())
        if self.tracker.phase is not Phase.STOPPING:
            self._doing = self.tracker.phase
        if self.found_moving and isinstance(motion, Hold) and self.tracker.phase is Phase.WAITING:
            self.tracker.steering.tell(FOUND_MOVING, now_utc_s)
            motion = Stop()
        if self.session.sample is not None:
            cleared = self.clear(motion, now_utc_s)
            if rest is not None and rest.jogging and cleared.motion != motion:
                cleared = self._end_jogs(cleared, now_utc_s)
            self._edges.sent(cleared.motion)
            self.session.apply(cleared)
            if self.limit_reached is not None and self.tracker.ended_by is None:
                self._give_up(f"limit:{self.safety.tripped}", self._why_tripped(self.limit_reached))
        elif self.tracker.phase is Phase.STOPPING:
            self.session.apply(self.clear(motion, now_utc_s))
        if self.tracker.ended_by == "error" and self.message is None:
            why = self.tracker.trouble or "did not obey"
            self.message = f"{self.spec.mount_name} {why}; it was sent a stop"
        if self.stop is None and self.tracker.phase is Phase.STOPPING:
            self.stop = StopProcedure(now_utc_s)
        datagram = self.compose(now_utc_s)
        if self.sent_motion is not None:
            self.tracker.note_sent(self.sent_motion, now_utc_s, self.safety.led)
        return datagram

    def prepare(self, now_utc_s: float) -> None:
        """Compute beforehand what would hold up the next `tick`; call once the datagram of this one is sent.

        `now_utc_s` is that of this tick. Without this call the next tick takes longer, by some milliseconds
        where observations correct the target.
        """
        if not self.failed:
            self.tracker.prepare(now_utc_s)

    def _end_jogs(self, cleared: Cleared, now_utc_s: float) -> Cleared:
        """Stop what is jogged at a limit: unlike a stream, what is moved by hand is not led along it."""
        name = self.safety.holding
        if name is None:
            return cleared
        words = f"the jog was ended at the {name} limit ({ROWS[name].bound}): let the key go, and jog away"
        self.tracker.end_jogs(words, now_utc_s)
        return self.safety.clear(Stop(), 0.0, 0.0, 0.0)

    def repeat(self) -> bytes | None:
        """Return what to send once more, REPEAT_AFTER_PERIODS after the last datagram; None for nothing."""
        return None if self.failed or self.tracker.ended_by is not None else self.session.repeat()

    def expect_observations(self) -> None:
        """Compute beforehand what the first observation needs: it would hold up a turn of the loop."""
        self.tracker.steering.estimator.warm_up(self.tracker.steering.biases.course, self.spec.plan.end_utc_s)

    def send_shift_s(self, now_utc_s: float) -> float:
        """Return the delay of the next `tick` beyond one period, seconds of UTC.

        It brings the datagrams into step with the mount's loop, so that it is certain which turn reads one.
        """
        return 0.0 if self.failed else self.tracker.send_shift_s(now_utc_s)

    def fail(self, words: str) -> None:
        """Stop the mount and nothing else from now on: what computes directions is not to be relied on."""
        self.failed = True
        self._give_up("error", words)

    def _why_tripped(self, words: str) -> str:
        """Return why a limit stopped the mount, with what else it may be where it was never on target."""
        cause, never = self.safety.cause, self.tracker.acquired_utc_s is None
        known = cause is not None and not cause.endswith(SEE_TO_DRIVE)
        if self.safety.tripped != "obedience" or known or not never:
            return words
        return limit_text("obedience", f"{cause or DISOBEYS}; {self._edges.perhaps}")

    def _watch_link(self, now_utc_s: float) -> None:
        self.link_state = state = self.session.link_state(now_utc_s)
        # A slow start of anything before the loop is not a silence of the mount's.
        self._first_tick_utc_s = min(now_utc_s, self._first_tick_utc_s)
        if self.tracker.ended_by is not None:
            return
        if state is LinkState.LOST:
            words = f"{self.spec.mount_name} {self.session.health.did}; stop commands were sent"
            self._give_up("link", words)
        elif state is LinkState.SILENT and now_utc_s - self._first_tick_utc_s > NO_ANSWER_AFTER_S:
            words = f"no status from {self.spec.mount_name} within {NO_ANSWER_AFTER_S:g} s"
            self._give_up("link", f"{words}; {UNHEARD}")

    def _give_up(self, why: str, words: str) -> None:
        self.message = words
        self.tracker.end(why)

    @property
    def pointing_deg(self) -> tuple[float, float] | None:
        """Right ascension and declination to which the mount points, by its last status; None before it."""
        sample = self.sample
        if sample is None or self.frame is None:
            return None if sample is None else (sample.ra_deg, sample.dec_deg)
        sidereal_deg = sample.sidereal_h * 15.0
        hour_angle_deg, dec_deg = self.frame.direction(sidereal_deg - sample.ra_deg, sample.dec_deg)
        return (sidereal_deg - hour_angle_deg) % 360.0, dec_deg

    def true_error(self, counter: int, utc_s: float, ra_deg: float, dec_deg: float) -> ErrorView | None:
        """Return the error of a simulated mount's true axes; None outside the time that figures count."""
        if self.failed or counter not in self._counted:
            return None
        self._counted.remove(counter)
        return sky_error(utc_s, ra_deg, dec_deg, self.tracker.fed_at(utc_s))

    @property
    def phase(self) -> str:
        """What goes on: the tracker's phase, or "holding" where a limit keeps the mount from following."""
        following = self.tracker.phase in FOLLOWING
        return HOLDING if following and self.safety.holding is not None else self.tracker.phase.value

    @property
    def rms_10s_arcsec(self) -> float | None:
        """RMS of the last errors that figures count."""
        return self._recent.rms_arcsec

    @property
    def led_out(self) -> bool:
        """Whether safety slews a paused mount, of which nothing is asked, out of a cone."""
        slews = isinstance(self.session.wanted, Slew) or self.safety.led is not None
        return self.tracker.rest is not None and slews


def safety_of(spec: RunSpec) -> Safety:
    """Return what clears a run's motions: held at limits, slews led round, out of the Sun by itself."""
    site = spec.propagator.site
    place = site.latitude_deg, site.longitude_deg
    safety = Safety(spec.profile, spec.limits, *place, holds=True, escapes=True)
    if spec.first_axis_deg is not None:
        safety.begin_at(spec.first_axis_deg)
    if spec.followed_deg is not None:
        safety.expect_at(spec.followed_deg)
    return safety


def learnt_view(engine: Engine) -> LearntView | None:
    """Return what the run has learnt of its mount; None before it was followed with."""
    follower, profile = engine.tracker.follower, engine.spec.profile
    known, settling_s = follower.learning.learnt(), follower.settling_s
    if known is None or settling_s is None:
        return None
    ra, dec = known
    ra_gain, ra_gain_sigma = _gain(ra, profile.ra_rate_gain)
    dec_gain, dec_gain_sigma = _gain(dec, profile.dec_rate_gain)
    return LearntView(
        ra_lag_s=ra.lag_s,
        ra_lag_sigma_s=ra.lag_sigma_s,
        ra_gain=ra_gain,
        ra_gain_sigma=ra_gain_sigma,
        dec_lag_s=dec.lag_s,
        dec_lag_sigma_s=dec.lag_sigma_s,
        dec_gain=dec_gain,
        dec_gain_sigma=dec_gain_sigma,
        command_delay_s=follower.command_delay_s,
        settling_s=settling_s,
        restarts=follower.learning.times_begun_anew,
        sky=engine.tracker.steering.estimator.sky_terms,
        command_delay_sigma_s=follower.command_delay_sigma_s,
    )


MOST_GAIN_SIGMA = 0.02
"""Gains are known as well as that before a run: what is found less surely, as of a star, is not known."""


def _gain(learnt: Learnt, profile_gain: float) -> tuple[float, float] | tuple[None, None]:
    line = learnt.line
    if line is None or line.gain_sigma > MOST_GAIN_SIGMA:
        return None, None
    return profile_gain * line.gain, profile_gain * line.gain_sigma
