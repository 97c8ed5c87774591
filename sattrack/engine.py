"""Session, tracker and safety as one thing without I/O: datagrams, messages and instants in, datagrams out.

Live, a 20 Hz loop feeds it; in a test, a simulated mount in virtual time; in a replay, a recording.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import msgspec

from sattrack.bias_view import (
    bias_fields,
    estimate_view,
    observation_warnings,
    offset_views,
    search_view,
)
from sattrack.control.kalman import wrap180
from sattrack.control.sky_error import SkyError, sky_error
from sattrack.figures import RunningError, WindowedError
from sattrack.messages import Jog
from sattrack.mount import (
    SIDEREAL_RATE_DEG_S,
    Hold,
    Motion,
    MoveAxes,
    SlewTo,
    StatusSample,
    Stop,
    mean_sidereal_deg,
)
from sattrack.safety import ROWS, Safety, SafetyLimits
from sattrack.tracker import FOLLOWING, Phase, Tracker, TrackPlan
from sattrack.view import ErrorView, LinkView, PauseView, TrackView
from sattrack.xerxes.launches import seen_of
from sattrack.xerxes.link import STALE_AFTER_S, LinkState
from sattrack.xerxes.session import Session
from sattrack.xerxes.slewing import SlewState

if TYPE_CHECKING:
    from sattrack.messages import Message
    from sattrack.mount import MountProfile
    from sattrack.safety import Cleared
    from sattrack.view import RememberedView
    from tle.bias import Bias
    from tle.propagator import Propagator

NO_ANSWER_AFTER_S = 3.0
STOP_UNHEARD_S = 12.0
"""How long stops are sent to a mount that is not heard: longer than a switch takes to come up again."""
STOP_UNCONFIRMED_S = 60.0
"""How long stops are sent to a mount that answers but does not come to rest."""
LINGER_S = 0.25
"""Flag-free datagrams after the rest was seen, so that no late one is the last that the mount gets."""
LONGEST_STEP_S = 0.5
LOST_TOLD_S = 10.0
"""For how long it is told that the mount was lost."""
SITE_TOLERANCE_DEG = 0.1
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
    camera_rotation_deg: float = 0.0
    """Position angle of the camera's y axis, from north through east."""
    remembered: RememberedView | None = None
    """The bias of an earlier pass with which this one begins."""


class Engine:
    """One run with one mount, from the first datagram to the mount seen at rest."""

    def __init__(self, spec: RunSpec) -> None:
        self.spec = spec
        self.session = Session(spec.profile, refuses_frozen=True)
        self.tracker = Tracker(
            spec.propagator, spec.plan, spec.profile, spec.bias, spec.camera_rotation_deg, spec.remembered
        )
        self.malformed = 0
        """Lines that came where observations or messages were expected, and were neither."""
        self.dropped = 0
        """Observations that came faster than they could be used."""
        self.safety = safety_of(spec)
        self.reported = RunningError()
        self.on_target_s = 0.0
        self.held_s: dict[str, float] = {}
        """Seconds for which each limit held the mount off the target."""
        self.paused_s = 0.0
        """Seconds for which the operator had the run paused."""
        self.rejoining_s = 0.0
        """Seconds that it took to be on the target again after pauses."""
        self.message: str | None = None
        self.finished = False
        self.failed = False
        self._recent = WindowedError()
        self._stop_asked_s: float | None = None
        self._rest_seen_s: float | None = None
        self._commanded: Motion = Hold()
        self._in_force: Motion = Hold()
        """What the mount was last told: a mount that takes rates by edges is not told each of them."""
        self._link_state = LinkState.SILENT
        self._counted: set[int] = set()
        self._before: StatusSample | None = None
        self._frozen_before = 0
        """Frozen statuses by the time of the last fresh one."""

    @property
    def mount_stopped(self) -> bool | None:
        """Whether the mount was told to stop and seen at rest; None where it was never heard."""
        return None if self.session.sample is None else self.session.stopped

    def receive(self, data: bytes, arrival_utc_s: float) -> None:
        """Take one datagram from the mount."""
        first = self.session.sample is None
        sample = self.session.receive(data, arrival_utc_s)
        if sample is None:
            return
        if first and sample.does_refraction:
            self.tracker.use(self.spec.if_mount_refracts)
        if self.failed:
            return
        before, was = self.tracker.error, self._before
        error = self.tracker.take(sample)
        seconds = 0.0 if before is None else error.utc_s - before.utc_s
        self._before = sample
        self._watch_profile()
        if self.session.status is not None:
            self.safety.watch(seen_of(self.session.status, arrival_utc_s), self._in_force)
        if was is not None and 0.0 < seconds < LONGEST_STEP_S:
            self._count(error, sample.counter, seconds)

    def _watch_profile(self) -> None:
        """Give up where statuses are not of the kind that the profile tells: it is another mount's."""
        if self.tracker.ended_by is not None:
            return
        for name, told in self.spec.profile.readings.items():
            shown = getattr(self.session.readings, name, None)
            if shown is not None and shown != told:
                self._give_up(
                    "error",
                    f"the profile {self.spec.profile.name!r} is another mount's: it says that {name} is "
                    f"{told}, and {self.spec.mount_name} sends {shown}; give this mount's profile",
                )
                return

    def _count(self, error: SkyError, counter: int, seconds: float) -> None:
        """Take an error into the figures: everything from the first acquisition on, lost or not.

        A pause, and the way back after it, are the operator's, and counted apart.
        """
        following = self.tracker.phase in FOLLOWING
        if following and self.safety.holding is not None:
            self.held_s[self.safety.holding] = self.held_s.get(self.safety.holding, 0.0) + seconds
            following = False
        elif self.tracker.rest is not None:
            self.paused_s += seconds
        elif self.tracker.rejoining:
            self.rejoining_s += seconds
        if not following or self.tracker.rejoining or self.tracker.acquired_utc_s is None:
            self._recent.clear()
            return
        if self.spec.simulated:
            self._counted.add(counter)
        self.reported.add(error.total_arcsec)
        self._recent.add(error.utc_s, error.total_arcsec)
        if error.total_arcsec <= self.spec.plan.on_target_arcsec:
            self.on_target_s += seconds

    def operate(self, message: Message, now_utc_s: float) -> None:
        """Obey the operator."""
        if isinstance(message, Jog) and self._link_state is not LinkState.UP:
            words = "the mount is not heard: nothing is moved blindly"
            self.tracker.steering.tell(words, now_utc_s)
        else:
            self.tracker.operate(message, now_utc_s)

    def tick(self, now_utc_s: float) -> bytes:
        """Return the datagram to send now; call once a period."""
        if not self.failed:
            self._watch_link(now_utc_s)
        arrived = self.session.slew_state is SlewState.DONE and self.safety.on_last_leg
        rest = self.tracker.rest
        motion = self.tracker.step(now_utc_s, arrived, rest is not None and self.session.stopped)
        sample = self.session.sample
        if sample is not None:
            age_s = max(0.0, now_utc_s - sample.arrival_utc_s)
            lst_deg = sample.sidereal_h * 15.0
            cleared = self.safety.clear(motion, lst_deg, sample.ra_deg, sample.dec_deg, age_s, now_utc_s)
            if rest is not None and rest.jogging and cleared.motion != motion:
                cleared = self._end_jogs(cleared, now_utc_s)
            self._commanded = cleared.motion
            self.session.apply(cleared)
            if self.safety.tripped is not None and self.tracker.ended_by is None:
                self._give_up(f"limit:{self.safety.tripped}", self._limit_words())
        elif self.tracker.phase is Phase.STOPPING:
            self.session.apply(self.safety.clear(motion, 0.0, 0.0, 0.0))
        if self.tracker.ended_by == "error" and self.message is None:
            why = self.tracker.trouble or "did not do as it was told"
            self.message = f"{self.spec.mount_name} {why}; it was told to stop"
        self._watch_stop(now_utc_s)
        datagram = self.session.compose()
        # An edge mount takes new rates only now and then: what counts is what went out.
        if not isinstance(self._commanded, MoveAxes):
            self._in_force = self._commanded
            self.tracker.note_sent(self._commanded, now_utc_s)
        elif self.session.begun_move is not None:
            self._in_force = self.session.begun_move
            self.tracker.note_sent(self.session.begun_move, now_utc_s)
        return datagram

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
        """Return by how much later than a period from now the next `tick` had better come, seconds; UTC.

        So the datagrams fall into step with the mount's loop, and it is not in doubt which turn reads one.
        """
        return 0.0 if self.failed else self.tracker.send_shift_s(now_utc_s)

    def fail(self, words: str) -> None:
        """Stop the mount and nothing else from now on: what computes directions is not to be relied on."""
        self.failed = True
        self._give_up("error", words)

    def _watch_link(self, now_utc_s: float) -> None:
        self._link_state = state = self.session.link_state(now_utc_s)
        if state is LinkState.UP:
            self._frozen_before = self.session.health.frozen
        if self.tracker.ended_by is not None:
            return
        if state is LinkState.LOST:
            frozen = self.session.health.frozen > self._frozen_before
            did = "said the same again and again while it moved" if frozen else "fell silent"
            self._give_up("link", f"{self.spec.mount_name} {did}; stop commands were sent")
        elif state is LinkState.SILENT and now_utc_s - self.spec.started_utc_s > NO_ANSWER_AFTER_S:
            words = f"no status from {self.spec.mount_name} within {NO_ANSWER_AFTER_S:g} s"
            self._give_up("link", f"{words}; is it on, and set to send here?")

    def _watch_stop(self, now_utc_s: float) -> None:
        if self.tracker.phase is not Phase.STOPPING or self.finished:
            return
        if self._stop_asked_s is None:
            self._stop_asked_s = now_utc_s
        waited_s = now_utc_s - self._stop_asked_s
        if not self.session.stopped:
            self._rest_seen_s = None
        elif self._rest_seen_s is None:
            self._rest_seen_s = now_utc_s
        rested = self._rest_seen_s is not None and now_utc_s - self._rest_seen_s >= LINGER_S
        never_heard = self.session.sample is None and waited_s > 4 * self.spec.profile.period_s
        heard = self.session.link_state(now_utc_s) is not LinkState.LOST
        given_up = waited_s > (STOP_UNCONFIRMED_S if heard else STOP_UNHEARD_S)
        self.finished = rested or never_heard or given_up

    def _give_up(self, why: str, words: str) -> None:
        self.message = words
        self.tracker.end(why)

    def _limit_words(self) -> str:
        row = ROWS[self.safety.tripped or ""]
        return f"safety stopped the mount at its {row.name} limit ({row.watches}); to go on: {row.way_out}"

    def true_error(self, counter: int, utc_s: float, ra_deg: float, dec_deg: float) -> SkyError | None:
        """Return the error of a simulated mount's true axes; None outside the time that figures count."""
        if self.failed or counter not in self._counted:
            return None
        self._counted.remove(counter)
        return sky_error(utc_s, ra_deg, dec_deg, self.tracker.direction_at(utc_s))

    @property
    def phase(self) -> str:
        """What goes on: the tracker's phase, or "holding" where a limit keeps the mount from following."""
        following = self.tracker.phase in FOLLOWING
        return HOLDING if following and self.safety.holding is not None else self.tracker.phase.value

    def view(self, now_utc_s: float) -> TrackView:
        """Return what anyone who looks may see, as of an instant."""
        spec, tracker, sample = self.spec, self.tracker, self.session.sample
        error = tracker.error
        fresh = error is not None and 0.0 <= now_utc_s - error.utc_s < STALE_AFTER_S
        # Target and mount are shown for one instant: a tick apart they would seem to disagree.
        target = tracker.direction_at(error.utc_s if error is not None and fresh else now_utc_s)
        health = self.session.health
        age_s = None if sample is None else max(0.0, now_utc_s - sample.arrival_utc_s)
        delay_ms = clock_offset_s = None
        if sample is not None and error is not None:
            delay_ms = 1000.0 * (sample.arrival_utc_s - error.utc_s)
            clock_offset_s = self._clock_offset_s(sample, error)
        return TrackView(
            utc_s=now_utc_s,
            phase=self.phase,
            name=spec.propagator.elements.label,
            catalog_number=spec.propagator.elements.catalog_number,
            mount=spec.mount_name,
            start_utc_s=spec.plan.start_utc_s,
            culminate_utc_s=spec.culminate_utc_s,
            end_utc_s=spec.plan.end_utc_s,
            max_alt_deg=spec.max_alt_deg,
            elements_age_s=now_utc_s - float(spec.propagator.elements.epoch.unix_s),
            target_ra_deg=float(target.ra_deg),
            target_dec_deg=float(target.dec_deg),
            target_alt_deg=float(target.alt_deg),
            target_az_deg=float(target.az_deg),
            range_km=float(target.range_km),
            mount_ra_deg=None if sample is None else sample.ra_deg,
            mount_dec_deg=None if sample is None else sample.dec_deg,
            error=None if error is None else ErrorView(*msgspec.structs.astuple(error)),
            rms_10s_arcsec=self._recent.rms_arcsec,
            rms_pass_arcsec=self.reported.rms_arcsec,
            ra_rate_deg_s=tracker.rates.ra_rate_deg_s,
            dec_rate_deg_s=tracker.rates.dec_rate_deg_s,
            max_ra_rate_deg_s=spec.profile.ra.max_rate_deg_s,
            max_dec_rate_deg_s=spec.profile.dec.max_rate_deg_s,
            **bias_fields(tracker, now_utc_s),
            offsets=offset_views(tracker, now_utc_s),
            search=search_view(tracker, now_utc_s),
            estimate=estimate_view(tracker, now_utc_s, self.malformed + self.dropped),
            remembered=tracker.steering.remembered,
            link=LinkView(
                state=self._link_state.value,
                age_s=age_s,
                sent=health.sent,
                received=health.received,
                lost=health.lost,
                late=health.late,
                duplicate=health.duplicate,
                rejected=health.rejected,
                rate_hz=health.rate_hz,
                jitter_ms=None if health.jitter_s is None else health.jitter_s * 1000.0,
                restarts=health.restarts,
                strangers=health.strangers,
                doubled_launches=health.doubled_launches,
                foreign_acks=health.foreign_acks,
                delay_ms=delay_ms,
                clock_offset_s=clock_offset_s,
            ),
            recording=spec.recording,
            ended_by=tracker.ended_by,
            warnings=self._warnings(),
            ra_rate_reached_deg_s=None if sample is None else SIDEREAL_RATE_DEG_S - sample.ra_drive_deg_s,
            dec_rate_reached_deg_s=None if sample is None else _reported_dec_rate_deg_s(sample),
            pause=self._pause_view(),
        )

    def _pause_view(self) -> PauseView | None:
        rest = self.tracker.rest
        if rest is None:
            return None
        return PauseView(rest.begun_utc_s, rest.at_rest and not self._led_out, rest.jogging)

    @property
    def _led_out(self) -> bool:
        """Whether safety slews a paused mount, of which nothing is asked, out of a cone."""
        return self.tracker.rest is not None and isinstance(self._commanded, SlewTo)

    def _clock_offset_s(self, sample: StatusSample, error: SkyError) -> float:
        """Return how far the mount's sidereal clock is ahead of mean sidereal time by our UTC, seconds."""
        mean_deg = mean_sidereal_deg(error.utc_s, self.spec.propagator.site.longitude_deg)
        return wrap180(sample.sidereal_h * 15.0 - mean_deg) / SIDEREAL_RATE_DEG_S

    def _side_warnings(self) -> list[str]:
        """Say that the mount is on a side of the pier for which its signs were never measured."""
        status, record = self.session.status, self.spec.profile.calibration
        if status is None or record is None:
            return []
        beyond = status.side_of_pier
        measured = record.both_sides or (record.side_of_pier == "beyond_pole") == beyond
        words = "this side of the pier is not in the mount's profile: its rates may go the other way"
        return [] if measured else [words]

    def _site_warnings(self) -> list[str]:
        """Say where the mount believes it stands, if that is somewhere else."""
        status, site = self.session.status, self.spec.propagator.site
        if status is None or (status.site_latitude_deg == 0.0 and status.site_longitude_deg == 0.0):
            return []
        apart = (
            abs(status.site_latitude_deg - site.latitude_deg),
            abs(wrap180(status.site_longitude_deg - site.longitude_deg)),
        )
        if max(apart) < SITE_TOLERANCE_DEG:
            return []
        where = f"{status.site_latitude_deg:.2f}, {status.site_longitude_deg:.2f}"
        return [f"the mount believes it stands at {where}: check the site on both sides"]

    def _held_warnings(self) -> list[str]:
        """Say at which limit safety holds the mount, or that it moves one that rests."""
        paused, name = self.tracker.rest is not None, self.safety.holding
        if self._led_out:
            return ["the telescope is led out of the Sun's or the Moon's way"]
        if name is None or not (paused or self.phase == HOLDING):
            return []
        then = "it goes on when the target comes back"
        if paused:
            then = "the mount at rest follows the sky, and is kept from going on"
        return [f"held at the {ROWS[name].name} limit ({ROWS[name].bound}): {then}"]

    def _warnings(self) -> tuple[str, ...]:
        warnings = []
        if self._link_state is LinkState.STALE:
            warnings.append("no fresh status from the mount: following by prediction")
        warnings.extend(self._held_warnings())
        if self.safety.clamping and self.tracker.phase in FOLLOWING:
            warnings.append("the mount's rate limit is reached")
        if self.tracker.phase is Phase.STOPPING and not self.finished and not self.session.stopped:
            warnings.append("the stop is not confirmed yet: it is being sent again and again")
        if self.tracker.steering.refusal is not None:
            warnings.append(self.tracker.steering.refusal)
        warnings.extend(observation_warnings(self.tracker, self.malformed, self.dropped))
        if self.session.intruder is not None:
            warnings.append(self.session.intruder)
        if not self.tracker.clock_holds:
            warnings.append("the mount's clock is not where the profile says: samples are dated by arrival")
        elif not self.tracker.clock_runs:
            warnings.append("the mount's clock does not run as ours: samples are dated by arrival")
        step_s, lost_utc_s = self.tracker.clock_step_s, self.tracker.lost_utc_s
        if step_s is not None:
            warnings.append(
                f"the mount's clock goes in steps of {1000.0 * step_s:.1f} ms: samples are dated by its mean"
            )
        if lost_utc_s is not None and self._heard_utc_s - lost_utc_s < LOST_TOLD_S:
            warnings.append("the mount was not where its commands lead: lost, and taken up where it is")
        warnings.extend(self._side_warnings())
        warnings.extend(self._site_warnings())
        if self.message:
            warnings.append(self.message)
        return tuple(warnings)

    @property
    def _heard_utc_s(self) -> float:
        return 0.0 if self.session.sample is None else self.session.sample.arrival_utc_s


def safety_of(spec: RunSpec) -> Safety:
    """Return what clears a run's motions: held at limits, slews led round, out of the Sun by itself."""
    site = spec.propagator.site
    return Safety(spec.profile, spec.limits, site.latitude_deg, site.longitude_deg, holds=True, escapes=True)


def _reported_dec_rate_deg_s(sample: StatusSample) -> float:
    """Return the declination drive's rate as one of the reported declination, which turns past the pole."""
    return -sample.dec_drive_deg_s if sample.beyond_pole else sample.dec_drive_deg_s
