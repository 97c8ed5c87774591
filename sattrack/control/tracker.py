"""`Tracker.step`: joins target, filters and phases into the motion that is wanted now. Pure.

Its only inputs are its plan, the samples and messages handed to it, and the instant; it reads no clock, file,
socket or random number, so the same inputs give the same outputs to the last bit.
"""

from __future__ import annotations

import math
from enum import StrEnum
from typing import TYPE_CHECKING

import msgspec

from sattrack.control.aim import MountSidereal
from sattrack.control.approach import Approach, ApproachStep, MountPlace
from sattrack.control.camera_image import NO_CAMERAS, Cameras
from sattrack.control.following import ControlLaw, Follower
from sattrack.control.rest import Rest
from sattrack.control.steering import Steering
from sattrack.control.target import Detour, SatelliteTarget, TargetState, sky_error
from sattrack.mount.model import (
    SIDEREAL_RATE_DEG_S,
    Hold,
    Motion,
    MountProfile,
    MoveAxes,
    Slew,
    StatusSample,
    Stop,
)
from sattrack.pointing.periodic import AxisStand, PeriodicTable, TableJudge, past_pole
from sattrack.views.messages import (
    Go,
    Jog,
    Message,
    ObservationMessage,
    Pause,
    PlaceFix,
    Search,
    SeenOffset,
    Slip,
    SolvedField,
    StopNow,
)
from tle.ephemeris import TableEphemeris
from tle.errors import EphemerisError
from tle.fixes import FIXES, PREDICTED_S, Fix, path_of
from tle.instants import Utc

if TYPE_CHECKING:
    from sattrack.views.run import ErrorView, RememberedView
    from tle.bias import Bias
    from tle.direction import Direction
    from tle.propagator import Propagator

ACQUIRED_AFTER_SAMPLES = 10
ONWARD_STEPS, ONWARD_S = 40, 20.0
"""Into how many steps the rest of a pass is cut to see how far the axes turn, and for how long that holds."""
LATE_FIX_S = 10.0
"""How old a report of a place may be."""
LOST_ARCSEC = 120.0


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
    latest_utc_s: float | None = None
    """When to stop following, however much more of the target becomes known; None for no such instant."""


class Tracker:
    """Follows one satellite over one window with one mount."""

    def __init__(
        self,
        propagator: Propagator,
        plan: TrackPlan,
        profile: MountProfile,
        bias: Bias,
        cameras: Cameras = NO_CAMERAS,
        remembered: RememberedView | None = None,
    ) -> None:
        self.plan = plan
        self._profile = profile
        self.steering = Steering(propagator, profile, bias, cameras, plan.start_utc_s, remembered)
        self.follower = Follower(profile, propagator.site.longitude_deg, plan.law)
        """Knows the mount's clock and axes, and learns of the mount while it follows."""
        self._frame = profile.frame
        self._north = propagator.site.latitude_deg >= 0.0
        self._sidereal = MountSidereal(propagator.site.longitude_deg)
        self._table = None if profile.periodic is None else PeriodicTable(profile.periodic)
        self._judge_of_table = None if profile.periodic is None else TableJudge(profile.periodic)
        self.table_left = False
        """Whether the profile's periodic errors were left aside: they are not this mount's any more."""
        self._onward: tuple[float, tuple[float, float]] | None = None
        self._satellite = SatelliteTarget(self.fed_at, plan.detours)
        self._way = Approach(profile, self.fed_at, plan.law.feeder)
        self._stand = MountPlace(0.0, 0.0, 0.0)
        self._near = 0
        self._news: bool | None = None
        """Whether the offsets have changed; None where that was not looked at yet."""
        self._next_utc_s = -math.inf
        """When the next `step` is expected, where it was prepared."""
        self.slipped_s = 0.0
        """How much later T0 is than the plan began with."""
        self._moved_by_rates = False
        """Whether the mount is in MoveAxis as a pause ends."""
        self.phase = Phase.WAITING
        self.ended_by: str | None = None
        self.acquired_utc_s: float | None = None
        self._was_led = False
        """Whether rates led the mount towards the target, in place of a slew of its own."""
        self._on_target_utc_s: float | None = None
        """Since when the mount is on the target, where it is."""
        self.followable_utc_s: float | None = None
        """First instant at which the mount, being there, could have followed."""
        self.rest: Rest | None = None
        """How the mount rests while the run is paused; None while it is not."""
        self.error: ErrorView | None = None
        self.target = TargetState(0.0, 0.0, 0.0, 0.0)
        """Where the satellite was fed at the instant of the error."""
        self.rates = MoveAxes(0.0, 0.0)

    def use(self, propagator: Propagator) -> None:
        """Take directions from another propagator of the same satellite from now on."""
        if self.slipped_s and isinstance(propagator.elements, TableEphemeris):
            propagator = propagator.with_elements(propagator.elements.later(self.slipped_s))
        self.steering.biases.use(propagator)
        self._satellite.forget()

    @property
    def t0_utc_s(self) -> float | None:
        """When the launch that is followed begins; None for anything else."""
        known = self.steering.biases.course.propagator.elements
        t0 = known.t0 if isinstance(known, TableEphemeris) else None
        return None if t0 is None else float(t0.unix_s)

    def _fix(self, message: PlaceFix, now_utc_s: float) -> None:
        """Go on by a new report of what is followed, from where it was fed."""
        propagator = self.steering.biases.course.propagator
        known = propagator.elements
        utc_s = float(Utc.parse(message.utc).unix_s)
        if not isinstance(known, TableEphemeris) or not known.provenance.startswith(FIXES):
            self.steering.tell("fixes are of what is followed by them only", now_utc_s)
            return
        if not float(known.epoch.unix_s) < utc_s <= now_utc_s + LATE_FIX_S or utc_s < now_utc_s - LATE_FIX_S:
            self.steering.tell(f"the fix of {message.utc} is not news", now_utc_s)
            return
        east, north, up = message.east_m_s, message.north_m_s, message.up_m_s
        fix = Fix(utc_s, message.lat_deg, message.lon_deg, message.height_m, east, north, up)
        try:
            path = path_of(known.name, fix, known, now_utc_s)
            self.steering.biases.use(propagator.with_elements(path))
        except EphemerisError as error:
            self.steering.tell(str(error), now_utc_s)
            return
        # Of the past, only what is needed is kept.
        start_s = max(self.plan.start_utc_s, now_utc_s)
        end_s = self._in_time(utc_s + PREDICTED_S)
        self.plan = msgspec.structs.replace(self.plan, start_utc_s=start_s, end_utc_s=end_s, detours=())

    def _in_time(self, end_utc_s: float) -> float:
        """Return an end of the plan, or the latest one that was asked for."""
        latest_s = self.plan.latest_utc_s
        return end_utc_s if latest_s is None else min(end_utc_s, latest_s)

    def _slip(self, seconds: float, now_utc_s: float) -> None:
        """Have T0 later by some seconds, and all that was planned."""
        propagator = self.steering.biases.course.propagator
        known = propagator.elements
        if not isinstance(known, TableEphemeris) or known.t0 is None:
            self.steering.tell("only a table from T0 slips", now_utc_s)
            return
        if self.phase is Phase.STOPPING:
            return
        self.steering.tell(None, now_utc_s)
        self.slipped_s += seconds
        # Detours are those of the path at its old time.
        self.plan = msgspec.structs.replace(
            self.plan,
            start_utc_s=self.plan.start_utc_s + seconds,
            end_utc_s=self._in_time(self.plan.end_utc_s + seconds),
            detours=(),
        )
        self._satellite = SatelliteTarget(self.fed_at, ())
        self.steering.biases.use(propagator.with_elements(known.later(seconds)))
        if self.phase is Phase.SLEWING:
            self.phase = Phase.WAITING
        elif self.phase is Phase.TRACKING:
            self.phase, self._near = Phase.ACQUIRING, 0
        if self.phase is Phase.WAITING and self.acquired_utc_s is None:
            # The way that is planned next tells when the target can be followed.
            self.followable_utc_s = None

    @property
    def trouble(self) -> str | None:
        """Why the way to the target was given up: what the mount did, in words."""
        return self._way.trouble

    def direction_at(self, utc_s: float) -> Direction:
        """Return where the satellite is fed at an instant, all offsets of that instant applied."""
        return self.steering.biases.at(utc_s)

    def fed_at(self, utc_s: float) -> Direction | TargetState:
        """Return what the mount is fed at an instant: that direction, or the angles of its axes for it.

        Where the mount reports the sky, its own clock is taken on both ways, and what it is off drops out.
        """
        known, frame = self.direction_at(utc_s), self._frame
        if frame is None and self._table is None:
            return known
        sidereal_deg = self._sidereal.at(utc_s)
        if frame is None or frame.geometry.reports == "sky":
            hour_angle_deg = sidereal_deg - float(known.ra_deg)
            hour_angle_rate = SIDEREAL_RATE_DEG_S - float(known.ra_rate_deg_s)
        else:
            hour_angle_deg, hour_angle_rate = float(known.ha_deg), float(known.ha_rate_deg_s)
        stand = AxisStand(hour_angle_deg, float(known.dec_deg), hour_angle_rate, float(known.dec_rate_deg_s))
        if frame is not None:
            stand = AxisStand(*frame.angles(*stand))
        if self._table is not None:
            stand = self._on_axes(self._table.reported(self._on_axes(stand)))
        ra_deg = (sidereal_deg - stand.first_deg) % 360.0
        ra_rate_deg_s = SIDEREAL_RATE_DEG_S - stand.first_rate_deg_s
        return TargetState(ra_deg, stand.second_deg, ra_rate_deg_s, stand.second_rate_deg_s)

    def _on_axes(self, stand: AxisStand) -> AxisStand:
        """Return an equatorial mount's direction as the angles of its axes, or those as a direction."""
        if self._frame is not None or not self._stand.beyond_pole:
            return stand
        return past_pole(stand, self._north)

    def periodic_arcsec(self, utc_s: float) -> tuple[float, float] | None:
        """Return by how much the axes stand past what is fed, on the sky; None without a table.

        Towards growing hour angles and declinations, or along the two axes of a mount with a geometry.
        """
        if self._table is None:
            return None
        there = self._reported_stand(utc_s)
        first, second = self._table.error_deg(there)
        folded = self._frame is None and self._stand.beyond_pole
        along = first * abs(math.cos(math.radians(there.second_deg)))
        return 3600.0 * along, 3600.0 * (-second if folded else second)

    def _reported_stand(self, utc_s: float) -> AxisStand:
        """Return the angles of the axes, and their rates, that the mount is fed at an instant."""
        fed = self.fed_at(utc_s)
        hour_angle_deg = self._sidereal.at(utc_s) - float(fed.ra_deg)
        hour_angle_rate = SIDEREAL_RATE_DEG_S - float(fed.ra_rate_deg_s)
        return self._on_axes(
            AxisStand(hour_angle_deg, float(fed.dec_deg), hour_angle_rate, float(fed.dec_rate_deg_s))
        )

    def onward_deg(self) -> tuple[float, float] | None:
        """Return how far back and on the first axis turns from where it waits until the end of the plan.

        None for an equatorial mount, and where the target cannot be computed.
        """
        if self._frame is None:
            return None
        begin_s, end_s = max(self.plan.start_utc_s, self._way.intercept.utc_s), self.plan.end_utc_s
        if self._onward is None or abs(begin_s - self._onward[0]) > ONWARD_S:
            turned, low, high, before = 0.0, 0.0, 0.0, None
            for k in range(ONWARD_STEPS + 1):
                utc_s = begin_s + (end_s - begin_s) * k / ONWARD_STEPS
                now_deg = self._sidereal.at(utc_s) - self.fed_at(utc_s).ra_deg
                turned += 0.0 if before is None else math.remainder(float(now_deg) - before, 360.0)
                low, high, before = min(low, turned), max(high, turned), float(now_deg)
            self._onward = begin_s, (low, high)
        return self._onward[1]

    def take(self, sample: StatusSample) -> ErrorView:
        """Take in one sample; return its error on the sky, dated by the mount's own clock."""
        utc_s = self.follower.date(sample)
        self._face(sample.beyond_pole)
        if self._frame is not None or self._table is not None:
            self._sidereal.note(sample.sidereal_h * 15.0, utc_s)
        passage = self._satellite.passage
        seen = sample if passage is None else passage.unfolded(sample)
        self.steering.clocks.note(utc_s, *self._looks_at_deg(sample))
        believed = self.follower.take(seen, utc_s, self.phase in FOLLOWING)
        if self.rest is not None:
            self.rest.see(sample)
        self._stand = MountPlace(sample.sidereal_h * 15.0, sample.ra_deg, sample.dec_deg, sample.beyond_pole)
        self.target = self._satellite.state(utc_s)
        self.error = sky_error(utc_s, sample.ra_deg, sample.dec_deg, self.target)
        if believed:
            self._judge(self.error)
        return self.error

    def _looks_at_deg(self, sample: StatusSample) -> tuple[float, float]:
        """Return right ascension and declination to which the mount points, by its axes where they count."""
        if self._frame is None and self._table is None:
            return sample.ra_deg, sample.dec_deg
        sidereal_deg = sample.sidereal_h * 15.0
        stand = AxisStand(sidereal_deg - sample.ra_deg, sample.dec_deg)
        if self._table is not None:
            there = self._on_axes(stand)
            first, second = self._table.error_deg(there)
            stand = self._on_axes(AxisStand(there.first_deg + first, there.second_deg + second))
        hour_angle, dec = stand[:2] if self._frame is None else self._frame.direction(*stand[:2])
        return (sidereal_deg - hour_angle) % 360.0, dec

    def _face(self, beyond_pole: bool) -> None:
        """Feed by the pointing model of the side of the pole on which the mount stands."""
        propagator = self.steering.biases.course.propagator
        if propagator.pointing is None:
            return
        side = propagator.pointing.on_side(beyond_pole)
        if side is not propagator.pointing:
            self.steering.biases.use(propagator.pointed(side))
            self._satellite.forget()

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
            case Slip():
                self._slip(message.seconds, now_utc_s)
            case PlaceFix():
                self._fix(message, now_utc_s)
            case SolvedField():
                if self.phase is Phase.TRACKING:
                    self.steering.clocks.hear(message)
            case SeenOffset() if (why := self._not_seen(message)) is not None:
                self.steering.estimator.refuse(why)
            case Search() if self.rest is not None:
                self.steering.tell("the run is paused: go on before a search", now_utc_s)
            case _:
                self.steering.obey(message, now_utc_s)
        self._judge_table(message)
        self._look_again(message)

    def _look_again(self, message: Message) -> None:
        """Have a message count in the next step, also where that was prepared before it came."""
        if not isinstance(message, ObservationMessage | SeenOffset | SolvedField):
            self._satellite.forget()
        elif self._news is not None:
            self._news |= self._watch_steering(self._next_utc_s)

    def _judge_table(self, message: Message) -> None:
        """Leave the periodic errors aside where an offset that was used shows that they do harm."""
        judge, seen = self._judge_of_table, self.steering.last_offset
        if not isinstance(message, SeenOffset) or judge is None or seen is None or self._table is None:
            return
        there = self._reported_stand(seen.utc_s)
        sense = -1.0 if self._frame is None and self._stand.beyond_pole else 1.0
        level = abs(math.cos(math.radians(there.second_deg)))
        judge.take(seen.utc_s, (seen.first_arcsec, sense * seen.second_arcsec), there, level)
        if judge.harms:
            self._table, self.table_left = None, True
            self._satellite.forget()

    def _not_seen(self, seen: SeenOffset) -> str | None:
        """Return why an offset says nothing of where the target is: the mount was not on it."""
        utc_s, on_s = float(Utc.parse(seen.utc).unix_s), self._on_target_utc_s
        if self.phase is not Phase.TRACKING:
            return "the mount is not on the target"
        if on_s is None or utc_s < on_s:
            return f"it is of {seen.utc}, before the mount was on the target"
        return None

    def _watch_steering(self, now_utc_s: float) -> bool:
        """Look at estimate and searches; tell whether what is fed has changed."""
        on_target_utc_s = self._on_target_utc_s if self.phase is Phase.TRACKING else None
        return self.steering.watch(now_utc_s, on_target_utc_s)

    def prepare(self, now_utc_s: float) -> None:
        """Look at estimate and searches for the next `step`, a period later, which then need not."""
        if self.phase is not Phase.STOPPING:
            self._next_utc_s = now_utc_s + self._profile.period_s
            self._news = self._watch_steering(self._next_utc_s)

    def step(self, now_utc_s: float, slew_done: bool, stopped: bool = False, held: bool = False) -> Motion:
        """Return the motion wanted from now on; call once a period, after the samples that came.

        `slew_done` tells whether the slew last asked for has arrived, `stopped` whether the stop of a pause
        was seen through, `held` whether a limit keeps the mount off the target.
        """
        if now_utc_s >= self.plan.end_utc_s:
            self.end("set")
        if self.phase is Phase.STOPPING:
            return Stop()
        if self._news is None:
            self._news = self._watch_steering(now_utc_s)
        if self._news:
            self._satellite.forget()
        self._news = None
        if self.rest is not None:
            return self._rests(self.rest, now_utc_s, stopped)
        if self.follower.axes is None:
            return Hold()
        if self.phase is Phase.WAITING and now_utc_s >= self.plan.start_utc_s - self.plan.approach_s:
            moving, self._moved_by_rates = self._moved_by_rates, False
            self._approach(now_utc_s, moving)
        if self.phase is Phase.SLEWING:
            return self._slew(now_utc_s, slew_done)
        left_behind = self.phase is Phase.ACQUIRING and self._is_left_behind(now_utc_s, held)
        if left_behind:
            self._approach(now_utc_s, moving=True, held=held)
        if self.phase in FOLLOWING and not left_behind:
            return self._follow(now_utc_s)
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
        if self._satellite.passage is not None:
            # It may have been left on the other side of the pole, of which a new way knows nothing.
            self.follower.forget_axes()

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
        if step is ApproachStep.FOLLOW:
            self._begin_following(now_utc_s)

    def _begin_following(self, now_utc_s: float) -> None:
        self.phase = Phase.ACQUIRING
        if self._satellite.passage is not None:
            self._satellite.passage = self._satellite.passage.from_instant(now_utc_s)

    def _slew(self, now_utc_s: float, slew_done: bool) -> Motion:
        step = self._way.go_on(now_utc_s, slew_done, self._stand)
        if step is ApproachStep.FOLLOW:
            self._begin_following(now_utc_s)
            return self._follow(now_utc_s)
        if step is ApproachStep.GIVE_UP:
            self.end("error")
            return Stop()
        if step is ApproachStep.PLAN:
            # Between two slews nothing is wanted for a moment: the second is one of its own.
            self.phase = Phase.WAITING
            return Hold()
        return Slew(self._way.intercept.ra_deg, self._way.intercept.dec_deg)

    def _is_left_behind(self, now_utc_s: float, held: bool) -> bool:
        """Tell whether the target is so far off that a slew leads there sooner."""
        # Detours leave it on purpose.
        if self._satellite.passage is not None or self.error is None:
            return False
        off_deg = self.error.total_arcsec / 3600.0
        return self._way.slew_ahead(now_utc_s, self.plan.end_utc_s, off_deg, self._stand, held)

    def _follow(self, now_utc_s: float) -> Motion:
        share = self.plan.law.feeder.tracking_share if self.phase is Phase.TRACKING else 1.0
        rates = self.follower.follow(now_utc_s, self._satellite, share)
        if rates is None:
            return Hold()
        passage = self._satellite.passage
        self.rates = rates if passage is None else passage.turned(rates)
        return self.rates

    def send_shift_s(self, now_utc_s: float) -> float:
        """Return the delay of the next datagram beyond one period from now, seconds."""
        return self.follower.send_shift_s(now_utc_s, self.phase in FOLLOWING, self.phase is Phase.TRACKING)

    def note_sent(self, motion: Motion, now_utc_s: float, led: Slew | None = None) -> None:
        """Note what was really sent, after safety had its say; `led` is the slew that rates stand for."""
        self._way.sent(led or motion)
        self._was_led = self._was_led or led is not None
        passage = self._satellite.passage
        if passage is not None and isinstance(motion, MoveAxes):
            motion = passage.turned(motion)
        self.follower.note_sent(motion, now_utc_s)

    def _judge(self, error: ErrorView) -> None:
        if self.phase is Phase.ACQUIRING:
            self._near = self._near + 1 if error.total_arcsec <= self.plan.on_target_arcsec else 0
            if self._near >= ACQUIRED_AFTER_SAMPLES:
                self.phase, self._on_target_utc_s = Phase.TRACKING, error.utc_s
                if self.acquired_utc_s is None:
                    self.acquired_utc_s = error.utc_s
                    self.follower.arrive(self._was_led)
        elif self.phase is Phase.TRACKING and error.total_arcsec > LOST_ARCSEC:
            self.phase = Phase.ACQUIRING
            self._near = 0
