"""A mount operated by hand, without I/O: requests, jogs and instants in, datagrams and views out.

Everything that moves passes `safety`, when it is asked for and again every period. A jog is kept going only
by being asked for again: silence ends it.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING

from sattrack.control.aim import Aim, Lead, MountInstant, MountSidereal
from sattrack.control.driver import Driver, limit_text
from sattrack.control.following import Follower
from sattrack.control.procedures import (
    DONE,
    Outcome,
    Procedure,
    RequestRefused,
    procedure_for,
    refused,
)
from sattrack.control.rest import Jogs
from sattrack.mount.link_loss import STOP_LINGER_S
from sattrack.mount.model import (
    SIDEREAL_RATE_DEG_S,
    Hold,
    MoveAxes,
    Slew,
    Stop,
    beyond_after_slew,
    mean_sidereal_deg,
)
from sattrack.mount.requests import (
    Abort,
    FindHome,
    FineRate,
    MoveAxis,
    Park,
    PulseGuide,
    Request,
    Sync,
    Ticket,
    objection,
)
from sattrack.mount.xerxes.link import LinkState
from sattrack.safety import ROWS, Safety
from sattrack.settings import NO_SITE

if TYPE_CHECKING:
    from sattrack.mount.model import AxesPosition, Motion, MountProfile, Status, StatusSample
    from sattrack.safety import SafetyLimits
    from tle.site import Site

LET_GO_AFTER_S = 2.0 * STOP_LINGER_S
"""After so long at rest a stopped mount is left alone; whoever waits for the rest has seen it by then."""
REMEMBERED = 5
OFFSETS = 100
END_WITHIN_TICKS = 20
"""Datagrams, a second, within which the end of a MoveAxis must be seen; else the mount is stopped."""
NEED_SITE = (Slew, Sync, MoveAxis, FineRate, PulseGuide, FindHome, Park)
"""What is judged by its altitude."""


@dataclass(slots=True)
class RequestEntry:
    """One thing that was asked of the mount, its ticket, and when."""

    number: int
    ticket: Ticket
    utc_s: float


class Console(Driver):
    """One mount under manual operation.

    `site` None: nothing that altitude decides about can be asked for. `stranger_hosts` and the count in
    `session.health.strangers` are set by the owner of the socket. A mount with a geometry is led by rates,
    to a direction and with the sky after it.
    """

    by_axes = True

    def __init__(
        self, profile: MountProfile, limits: SafetyLimits, site: Site | None, mount_name: str
    ) -> None:
        self.limits, self.site = limits, site
        super().__init__(profile, self._new_safety(profile))
        own = profile.frame is not None or profile.pointing is not None
        self.sky_aim = Aim(profile, site) if own and site is not None else None
        """Where the telescope looks; None where the mount's own coordinates are all that is known."""
        self.lead: Lead | None = None
        """What rates lead a mount with a geometry to, or keep it at; None while nothing does."""
        self._left: Lead | None = None
        """What it was kept at before a motion by hand."""
        longitude_deg = 0.0 if site is None else site.longitude_deg
        self._sidereal = MountSidereal(longitude_deg)
        self._follower = None if self.frame is None else Follower(profile, longitude_deg)
        self.mount_name = mount_name
        self.outcome: Outcome | None = None
        """How the last procedure ended; None while one is under way."""
        self.trouble: str | None = None
        """What brought the mount to a stop unasked: "link", "restart" or "limit:NAME"; a new request
        clears it."""
        self.stranger_hosts: tuple[str, ...] = ()
        self.way_trouble: str | None = None
        """What the way to the mount says is the matter, in words; None where nothing is."""
        self.failed: str | None = None
        self.procedure: Procedure | None = None
        self.jogs = Jogs()
        self._meant: Motion = Hold()
        """What was asked for last; the rates that are wanted grow to it."""
        self.asked: deque[RequestEntry] = deque(maxlen=REMEMBERED)
        self._count = 0
        self._now_utc_s = 0.0
        self.refusal: str | None = None
        self._move_begun = False
        self._ending_ticks = 0
        """Datagrams that ask for the end of a MoveAxis, without its being seen."""
        self._rest_since_utc_s: float | None = None
        self.stopping_since_utc_s: float | None = None
        """Since when a stop has been asked for; None where none is."""
        self._offsets: deque[float] = deque(maxlen=OFFSETS)
        self.tracking_reading: str | None = None

    @property
    def status(self) -> Status | None:
        """The mount's last status."""
        return self.session.status

    @property
    def stands(self) -> bool:
        """Whether the mount's positions say standstill, sidereal tracking not counted as such."""
        return self.session.stands

    @property
    def move_begun(self) -> bool:
        """Whether a datagram that begins MoveAxis has gone out since the last request."""
        return self._move_begun

    @property
    def stopping(self) -> bool:
        """Whether a stop is asked for and not yet seen through."""
        return isinstance(self.session.wanted, Stop)

    @property
    def moving(self) -> bool:
        """Whether anything of ours is under way that leaving would leave moving."""
        wanted = self.session.wanted
        ours = isinstance(wanted, MoveAxes | Slew) or not self.session.move_over
        return self.procedure is not None or self.session.busy or ours

    @property
    def at_rest(self) -> bool:
        """Whether the mount stands, as far as it is known; sidereal tracking counts as standing."""
        return self.session.at_rest

    def receive(self, data: bytes, arrival_utc_s: float) -> StatusSample | None:
        """Take one datagram from the mount; return its sample, None where it was refused."""
        sample = super().receive(data, arrival_utc_s)
        if sample is not None:
            self._take(sample)
        return sample

    def _take(self, sample: StatusSample) -> None:
        """Take in a sample."""
        if self._follower is not None:
            utc_s = self._follower.date(sample)
            self._follower.take(sample, utc_s, isinstance(self.in_force, MoveAxes))
            self._sidereal.note(sample.sidereal_h * 15.0, utc_s)
            if self.lead is not None:
                self.lead.see(sample, utc_s)
        if self.restarted and isinstance(self.session.wanted, MoveAxes):
            self._stop("restart", "the mount restarted meanwhile: it is not moved again until you ask")
        longitude_deg = self._longitude_deg()
        if longitude_deg is not None:
            ours_deg = mean_sidereal_deg(sample.arrival_utc_s, longitude_deg)
            self._offsets.append(
                math.remainder(sample.sidereal_h * 15.0 - ours_deg, 360.0) / SIDEREAL_RATE_DEG_S
            )
        if not sample.slewing and not isinstance(self.session.wanted, MoveAxes):
            self._move_begun = False
        status = self.session.status
        if status is not None and status.slewing:
            self.tracking_reading = "always true" if status.tracking else "the opposite of slewing"

    def request(self, request: Request, now_utc_s: float) -> RequestRefused | None:
        """Have a request carried out; return why not, where it is refused."""
        if self.procedure is not None and not isinstance(request, Abort | Slew | Park):
            return self._refuse(RequestRefused("an operation is in progress: SPACE stops it"))
        return self.begin(procedure_for(request, self.profile), now_utc_s)

    def begin(self, procedure: Procedure, now_utc_s: float) -> RequestRefused | None:
        """Carry out a procedure, in place of any that is under way; return why not, where it is refused."""
        before = self.lead or self._left
        if self.jogs:
            # A jog lives by its key alone: nothing else may carry its motion on.
            self.jogs.clear()
            self._apply(Hold(), now_utc_s)
        refusal = procedure.begin(self, now_utc_s)
        if refusal is not None:
            return self._refuse(refusal)
        moves = isinstance(self.session.wanted, MoveAxes) and self.lead is None
        self._left = before if moves else None
        self.procedure, self.outcome, self.trouble, self.refusal = procedure, None, None, None
        self.jogs.clear()
        return None

    def submit(self, request: Request, now_utc_s: float) -> Ticket | RequestRefused:
        """Ask for one thing, if safety and the mount's state let it."""
        refusal = self._objection(request)
        if refusal is not None:
            return refusal
        if isinstance(request, MoveAxis) and self.frame is not None:
            request = self._both_axes(request)
        status = self.session.status
        cleared = self.safety.clear_request(request, self.session.stance, now_utc_s)
        if isinstance(cleared, str):
            return RequestRefused(cleared, by_safety=status is not None)
        if isinstance(request, Abort):
            self.jogs.blocked = True
        self._move_begun = False
        meant = self._move_meant
        self.lead = None
        ticket = self.session.submit(cleared)
        self._meant = self.session.wanted
        if isinstance(request, MoveAxis) and meant is not None:
            self._meant = request.after(meant)
        self._count += 1
        self.asked.append(RequestEntry(self._count, ticket, now_utc_s))
        return ticket

    def jog(
        self, ra_rate_deg_s: float | None, dec_rate_deg_s: float | None, now_utc_s: float
    ) -> RequestRefused | None:
        """Move for a short time, or for longer where an axis is being jogged at that rate already.

        Rates are those of the reported right ascension (positive east) and declination (positive north).
        """
        fresh = self.jogs.is_fresh(now_utc_s)
        refusal = self._jog_objection(MoveAxis(ra_rate_deg_s, dec_rate_deg_s), fresh, now_utc_s)
        if refusal is not None:
            return self._refuse(refusal)
        self.refusal, self.trouble = None, None
        if self.lead is not None:
            self.lead, self._left = None, self.lead
        self.jogs.move(ra_rate_deg_s, dec_rate_deg_s, now_utc_s)
        self._apply(self._jogged(now_utc_s), now_utc_s)
        return None

    def abort(self, now_utc_s: float) -> None:
        """Stop everything; said again, it is sent again."""
        self.jogs.clear()
        self.begin(procedure_for(Abort(), self.profile), now_utc_s)

    def reset(self) -> RequestRefused | None:
        """Let the mount move again after a safety limit has stopped it; refused until it is at rest."""
        if self.safety.tripped is not None and not self.at_rest:
            return self._refuse(RequestRefused("the mount is not at rest yet"))
        fresh = self._new_safety(self.profile)
        fresh.follow_on(self.safety)
        self.safety, self.trouble, self.refusal = fresh, None, None
        return None

    def fail(self, words: str) -> None:
        """Stop the mount and nothing else from now on: something here is not to be relied on."""
        self.failed = words
        self._stop("error", words)

    def tick(self, now_utc_s: float) -> bytes:
        """Return the datagram to send now; call once a period."""
        self._now_utc_s = now_utc_s
        self._watch_link(now_utc_s)
        if self.failed is None:
            self._end_jogs(now_utc_s)
            self._step(now_utc_s)
            self._end_orphans(now_utc_s)
            self._clear_again(now_utc_s)
            self._watch_drift(now_utc_s)
            self._let_go(now_utc_s)
        if not self.stopping:
            self.stopping_since_utc_s = None
        elif self.stopping_since_utc_s is None:
            self.stopping_since_utc_s = now_utc_s
        datagram = self.compose(now_utc_s)
        if self._follower is not None and self.sent_motion is not None:
            self._follower.note_sent(self.sent_motion, now_utc_s)
        self._move_begun = self._move_begun or self.session.begun_move is not None
        return datagram

    def _longitude_deg(self) -> float | None:
        """Return the longitude that the mount's clock is for: what it tells itself, else the site's."""
        status = self.session.status
        if status is not None and status.site_longitude_deg:
            return status.site_longitude_deg
        return None if self.site is None else self.site.longitude_deg

    def _refuse(self, refusal: RequestRefused) -> RequestRefused:
        self.refusal = refusal.words
        return refusal

    def _new_safety(self, profile: MountProfile) -> Safety:
        if self.site is None:
            return Safety(profile, self.limits, 0.0)
        safety = Safety(profile, self.limits, self.site.latitude_deg, self.site.longitude_deg)
        safety.choose_turn((0.0, 0.0))
        return safety

    # Where the telescope looks.

    def _instant(self, now_utc_s: float) -> MountInstant:
        """Return how the mount stands, by its last sample."""
        sample = self.session.sample
        assert sample is not None
        return MountInstant.of(sample, now_utc_s)

    @property
    def looks_at_deg(self) -> tuple[float, float] | None:
        """Right ascension and declination of date in which the telescope looks.

        None where the mount's own coordinates are all that is known of it.
        """
        sample = self.sample
        return None if self.sky_aim is None or sample is None else self.sky_aim.looks_at_deg(sample)

    def aim(
        self, request: Slew, place: AxesPosition | None, now_utc_s: float
    ) -> Slew | Lead | RequestRefused:
        """Return the slew by which the telescope looks in a direction, or how rates lead it there."""
        words = objection(request, self.profile)
        refusal = self._objection(request) if words is None else RequestRefused(words)
        if refusal is not None:
            return refusal
        if self.session.sample is None:
            return RequestRefused("the mount has not been heard yet")
        if self.frame is not None:
            return self._led(request, place, now_utc_s)
        if self.sky_aim is None or place is not None:
            return request
        at = self._instant(now_utc_s)
        hour_angle_deg = math.remainder(at.sidereal_deg - request.ra_deg, 360.0)
        at = at._replace(beyond_pole=beyond_after_slew(self.profile.pier_rule, hour_angle_deg))
        return Slew(*self.sky_aim.reported_deg(request.ra_deg, request.dec_deg, at))

    def synced(self, request: Sync, now_utc_s: float) -> Sync:
        """Return what to have the mount report for a telescope that looks in a direction."""
        if self.sky_aim is None or self.frame is not None or self.session.sample is None:
            return request
        return Sync(*self.sky_aim.reported_deg(request.ra_deg, request.dec_deg, self._instant(now_utc_s)))

    def _led(self, request: Slew, place: AxesPosition | None, now_utc_s: float) -> Lead | RequestRefused:
        """Begin to lead a mount with a geometry to a direction, or to a place of its axes."""
        sample = self.sample
        assert sample is not None
        lead = self._lead_to(request.ra_deg, request.dec_deg, place, now_utc_s)
        goal = lead.goal(sample, self.profile, now_utc_s)
        way = self.path_to(goal, now_utc_s)
        if self.safety.tripped is not None:
            row = ROWS[self.safety.tripped]
            way = RequestRefused(f"safety has stopped the mount ({row.watches}): {row.way_out}", True)
        if isinstance(way, RequestRefused):
            return way
        lead.legs = list(way)
        self._lead_on(lead)
        return lead

    def _lead_on(self, lead: Lead) -> None:
        """Lead the mount so from now on."""
        if not self.session.move_over or self.session.busy:
            # A ticket of what was under way is not left behind.
            self.session.apply(self.safety.clear(Hold(), 0.0, 0.0, 0.0))
        self.lead, self._left = lead, None

    def _lead_to(self, ra_deg: float, dec_deg: float, place: AxesPosition | None, now_utc_s: float) -> Lead:
        assert self.sky_aim is not None
        assert self._follower is not None
        aim, clock, refracts = self.sky_aim, self._sidereal, self._instant(now_utc_s).refracts

        def place_at(utc_s: float) -> tuple[float, float]:
            if place is not None:
                return place.hour_angle_deg, place.dec_deg
            return aim.own_deg(ra_deg, dec_deg, MountInstant(utc_s, clock.at(utc_s), refracts))

        return Lead(place_at, clock, self._follower, now_utc_s, self.profile.goes_within_s(by_rates=True))

    def keep_here(self, now_utc_s: float) -> RequestRefused | None:
        """Keep the telescope of a mount with a geometry where it looks on the sky."""
        looks = self.looks_at_deg
        refusal = self._objection(Slew(0.0, 0.0))
        if refusal is not None or looks is None:
            return refusal or RequestRefused("the mount has not been heard yet")
        if self.safety.tripped is not None:
            return RequestRefused("safety has stopped the mount")
        self._lead_on(self._lead_to(*looks, None, now_utc_s))
        return None

    def _both_axes(self, request: MoveAxis) -> MoveAxis:
        """Return rates of both axes: one that is left out goes on, or stands."""
        both = request.after(self._move_meant or MoveAxes(SIDEREAL_RATE_DEG_S, 0.0))
        return MoveAxis(both.ra_rate_deg_s, both.dec_rate_deg_s)

    @property
    def _move_meant(self) -> MoveAxes | None:
        """The rates to which those of a motion by hand grow; None where there is none."""
        meant = self._meant
        by_hand = isinstance(self.session.wanted, MoveAxes) and self.lead is None
        return meant if by_hand and isinstance(meant, MoveAxes) else None

    def path_to(self, request: Slew, now_utc_s: float) -> tuple[Slew, ...] | RequestRefused:
        """Return the slews that lead to a direction past any obstacle."""
        refusal = self._objection(request)
        if refusal is not None:
            return refusal
        words = objection(request, self.profile)
        stance = self.session.stance
        if words is not None or stance is None:
            return (request,)
        ways = self.safety.path_to(request, stance, now_utc_s)
        return RequestRefused(ways, by_safety=True) if isinstance(ways, str) else ways

    def _objection(self, request: Request) -> RequestRefused | None:
        status = self.session.status
        if self.site is None and isinstance(request, NEED_SITE) and request != FineRate():
            return RequestRefused(NO_SITE)
        if self.link_state is LinkState.LOST and not isinstance(request, Abort):
            return RequestRefused("the mount is silent: nothing is moved blindly")
        moving = isinstance(self.session.wanted, MoveAxes | Slew) or (status is not None and status.slewing)
        if isinstance(request, Sync) and moving:
            return RequestRefused(
                "the mount moves: sync once it stands, or what it reports would be wrong for good"
            )
        if isinstance(request, MoveAxis) and status is not None and status.slewing and not self._ours():
            return RequestRefused("the mount is slewing: stop that first")
        return None

    def _ours(self) -> bool:
        """Tell whether it is a MoveAxis of ours that makes the mount say that it slews."""
        return isinstance(self.session.wanted, MoveAxes) or self._move_begun

    def _jog_objection(self, move: MoveAxis, fresh: bool, now_utc_s: float) -> RequestRefused | None:
        if self.failed is not None:
            return RequestRefused(self.failed)
        if self.jogs.blocked and (self.stopping or not fresh):
            return RequestRefused("stopped: let the key go, and jog once the mount is at rest")
        if isinstance(self.session.wanted, Slew) or self.procedure is not None:
            return RequestRefused("an operation is in progress: SPACE stops it, then jog")
        if self.link_state is not LinkState.UP:
            return RequestRefused("the mount is not heard: nothing is moved blindly")
        refusal = self._objection(move)
        if refusal is not None:
            return refusal
        cleared = self.safety.clear_request(move, self.session.stance, now_utc_s)
        return RequestRefused(cleared, by_safety=True) if isinstance(cleared, str) else None

    def _jogged(self, now_utc_s: float) -> Motion:
        if not self.jogs:
            return Hold()
        ra_rate, dec_rate = self.jogs.rates_deg_s
        if self.frame is None:
            return MoveAxes(ra_rate, dec_rate)
        still = MoveAxes(SIDEREAL_RATE_DEG_S, 0.0)
        looks = None if self._left is None else self.looks_at_deg
        if looks is not None:
            state = self._lead_to(*looks, None, now_utc_s).state_at(now_utc_s)
            still = MoveAxes(state.ra_rate_deg_s, state.dec_rate_deg_s)
        return MoveAxes(still.ra_rate_deg_s + ra_rate, still.dec_rate_deg_s + dec_rate)

    def _end_jogs(self, now_utc_s: float) -> None:
        if not self.jogs.end_over(now_utc_s):
            return
        if not self.jogs and self._left is not None:
            self._keep_on(now_utc_s)
        else:
            self._apply(self._jogged(now_utc_s), now_utc_s)

    def _keep_on(self, now_utc_s: float) -> None:
        """After a motion by hand, keep the telescope where it looks now, as it was kept before."""
        self._left = None
        if self.safety.tripped is None:
            self.keep_here(now_utc_s)

    def _step(self, now_utc_s: float) -> None:
        if self.procedure is None:
            return
        outcome = self.procedure.step(self, now_utc_s)
        if outcome is not None:
            self._settle(outcome)

    def _settle(self, outcome: Outcome) -> None:
        self.procedure, self.outcome = None, outcome
        if outcome.state not in DONE:
            self.lead = self._left = None
        elif self._left is not None and self.session.move_over:
            self._keep_on(self._now_utc_s)
        if isinstance(self.session.wanted, Slew):
            # It tracks there by itself; what it does later by other hands is not for us to undo.
            self._apply(Hold(), 0.0)

    def _end_orphans(self, now_utc_s: float) -> None:
        """End a motion that neither a key nor a procedure stands for."""
        orphan = isinstance(self.session.wanted, MoveAxes) and not self.jogs and self.procedure is None
        orphan = orphan and self.lead is None
        if orphan:
            self._apply(Hold(), now_utc_s)
        ending = isinstance(self.session.wanted, Hold) and not self.session.move_over
        self._ending_ticks = self._ending_ticks + 1 if ending else 0
        if self._ending_ticks > END_WITHIN_TICKS:
            self._ending_ticks = 0
            self._stop("move", "the end of the move was not acknowledged: the mount is being stopped")

    def _clear_again(self, now_utc_s: float) -> None:
        wanted: Motion | None = self._move_meant or self.session.wanted
        if self.lead is not None:
            wanted = self.lead.wanted(self.safety, now_utc_s)
        if isinstance(wanted, MoveAxes | Slew):
            self._apply(wanted, now_utc_s)

    def _watch_drift(self, now_utc_s: float) -> None:
        """End fine rates of ours that lead to a limit."""
        fine, stance = self.session.fine_rate, self.session.stance
        if stance is None or fine == FineRate() or isinstance(self.session.wanted, Stop):
            return
        name = self.safety.drift_objection(fine, stance, now_utc_s)
        if name is None:
            return
        self._stop(f"limit:{name}", limit_text(name))
        cleared = self.safety.clear_request(Abort(), stance, now_utc_s)
        if not isinstance(cleared, str):
            self.session.submit(cleared)

    def _apply(self, motion: Motion, now_utc_s: float) -> None:
        """Make a motion the wanted one as far as safety clears it."""
        self._meant = motion
        cleared = self.clear(motion, now_utc_s)
        if cleared.motion != self.session.wanted:
            self.session.apply(cleared)
        words = self.limit_reached
        if words is not None and isinstance(motion, MoveAxes | Slew):
            self._stop(f"limit:{self.safety.tripped}", words)

    def _stop(self, why: str, words: str) -> None:
        """Bring the mount to rest unasked."""
        self.lead = self._left = None
        self.trouble = why
        self.refusal = words
        self.jogs.block()
        self.session.apply(self.safety.clear(Stop(), 0.0, 0.0, 0.0))
        if self.procedure is not None:
            self.procedure, self.outcome = (
                None,
                refused(RequestRefused(words, by_safety=why.startswith("limit:"))),
            )

    def _watch_link(self, now_utc_s: float) -> None:
        before, self.link_state = self.link_state, self.session.link_state(now_utc_s)
        lost = self.link_state is LinkState.LOST and before is not LinkState.LOST
        if lost and self.moving and not self.stopping:
            self._stop("link", f"{self.mount_name} {self.session.health.did}; stop commands are being sent")

    def _let_go(self, now_utc_s: float) -> None:
        """After a stop that was seen through, leave the mount to whoever moves it next.

        Not after the last: who ends with it must see the rest, and may look late, or hear the mount late.
        """
        last = self.stop is not None and self.stop.needed
        if last or not (self.stopping and self.session.stopped):
            self._rest_since_utc_s = None
        elif self._rest_since_utc_s is None:
            self._rest_since_utc_s = now_utc_s
        elif now_utc_s - self._rest_since_utc_s >= LET_GO_AFTER_S and self.procedure is None:
            self._rest_since_utc_s = None
            if self.trouble == "link":
                self.refusal = f"{self.mount_name} was silent for a while; it was stopped"
            self.session.apply(self.safety.clear(Hold(), 0.0, 0.0, 0.0))

    @property
    def clock_offset_s(self) -> float | None:
        """The mount's sidereal clock ahead of local mean sidereal time by UTC, by its fastest datagrams."""
        return max(self._offsets) if self._offsets else None
