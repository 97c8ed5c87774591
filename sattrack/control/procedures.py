"""What is asked of a mount by hand: procedures of one request or more. Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

from sattrack.mount.model import SIDEREAL_RATE_DEG_S, MoveAxes, Slew
from sattrack.mount.requests import (
    NO_PARK,
    Abort,
    EndMove,
    FindHome,
    FineRate,
    MoveAxis,
    Park,
    PulseGuide,
    Request,
    Sync,
    Ticket,
    TicketState,
    TrackingRate,
)
from sattrack.views.formatting import degrees, hours

if TYPE_CHECKING:
    from sattrack.control.aim import Lead
    from sattrack.mount.model import AxesPosition, MountProfile, Status, StatusSample

DONE = frozenset({TicketState.COMPLETE, TicketState.UNCONFIRMED})


_PLAIN: dict[type, str] = {Abort: "abort", Park: "park", FindHome: "home", EndMove: "end the move"}


def request_text(request: Request) -> str:
    """Return a request in words, with its numbers."""
    match request:
        case Slew() | Sync():
            verb = "slew" if isinstance(request, Slew) else "sync"
            return f"{verb} to RA {hours(request.ra_deg / 15.0)} Dec {degrees(request.dec_deg)}"
        case MoveAxis():
            rates = (("RA", request.ra_rate_deg_s), ("Dec", request.dec_rate_deg_s))
            return "move " + " ".join(f"{axis} {rate:+g} °/s" for axis, rate in rates if rate is not None)
        case PulseGuide():
            return f"pulse RA {request.ra_ms:+d} ms Dec {request.dec_ms:+d} ms"
        case FineRate():
            return f"fine rate RA {request.ra_deg_s:+g} °/s Dec {request.dec_deg_s:+g} °/s"
        case TrackingRate():
            return f"tracking rate {request.rate}"
    return _PLAIN[type(request)]


NEAR_DEG = 0.1
"""So near to its home position a mount is taken to stand there, where it does not say so itself."""
HOME_STARTS_WITHIN_S = 3.0
SLEW_SETTLING_S = 2.0
MOVE_BEGINS_WITHIN_S = 10.0
SEEN_DEG_S, SEEN_AFTER_S = 0.02, 1.0
"""From this rate and length on, an axis that made the move cannot look as if it stood."""
STOOD = "the mount did not move: its drives are off, or held by a brake; see to them at the mount"
NEVER_THERE = "the mount did not come to that direction: it is near the keyhole, or an axis is too slow"
RESTS_WITHIN_S = 5.0
"""How long a stopped mount may take until its drives tell standstill."""


@dataclass(frozen=True, slots=True)
class RequestRefused:
    """Why something was not asked of the mount; `by_safety` where a limit or an interlock forbids it."""

    words: str
    by_safety: bool = False


@dataclass(frozen=True, slots=True)
class Outcome:
    """How a procedure ended; `state` is one of the ends of a ticket."""

    state: TicketState
    acknowledged: bool
    reason: str | None = None
    refusal: RequestRefused | None = None


class ProcedureHost(Protocol):
    """What a procedure needs of the console."""

    @property
    def status(self) -> Status | None:
        """The mount's last status."""

    @property
    def sample(self) -> StatusSample | None:
        """The same, as the tracker sees it."""

    @property
    def at_rest(self) -> bool:
        """Whether they say that it stands or follows the sky."""

    @property
    def stands(self) -> bool:
        """Whether the mount's positions say standstill, sidereal tracking not counted as such."""

    @property
    def move_begun(self) -> bool:
        """Whether a datagram that begins MoveAxis has gone out since the last request."""

    def submit(self, request: Request, now_utc_s: float) -> Ticket | RequestRefused:
        """Ask for one thing, if safety lets it."""

    def path_to(self, request: Slew, now_utc_s: float) -> tuple[Slew, ...] | RequestRefused:
        """Return the slews that lead to a direction past any obstacle."""

    def aim(
        self, request: Slew, place: AxesPosition | None, now_utc_s: float
    ) -> Slew | Lead | RequestRefused:
        """Return the slew by which the telescope looks in a direction, or how rates lead it there.

        With a `place` the request is how the mount gets its axes there.
        """

    def synced(self, request: Sync, now_utc_s: float) -> Sync:
        """Return what to have the mount report for a telescope that looks in a direction."""

    def keep_here(self, now_utc_s: float) -> RequestRefused | None:
        """Keep the telescope of a mount with a geometry where it looks on the sky."""


class Procedure(Protocol):
    """One thing that was asked for by hand."""

    @property
    def doing(self) -> str:
        """What is under way, in words."""

    def begin(self, desk: ProcedureHost, now_utc_s: float) -> RequestRefused | None:
        """Begin, or say why not."""

    def step(self, desk: ProcedureHost, now_utc_s: float) -> Outcome | None:
        """Go on, once a period; return the outcome at the end."""


def outcome_of(ticket: Ticket) -> Outcome | None:
    """Return how a ticket ended; None while it has not."""
    return Outcome(ticket.state, ticket.was_acknowledged, ticket.reason) if ticket.settled else None


def refused(refusal: RequestRefused, acknowledged: bool = False) -> Outcome:
    """Return the outcome of a procedure that could not go on."""
    return Outcome(TicketState.FAILED, acknowledged, refusal.words, refusal)


@dataclass(slots=True)
class Once:
    """One request, until its ticket settles."""

    request: Request
    doing: str
    _ticket: Ticket | None = None

    def begin(self, desk: ProcedureHost, now_utc_s: float) -> RequestRefused | None:
        """See Procedure."""
        if isinstance(self.request, Sync):
            self.request = desk.synced(self.request, now_utc_s)
        asked = desk.submit(self.request, now_utc_s)
        if isinstance(asked, RequestRefused):
            return asked
        self._ticket = asked
        return None

    def step(self, desk: ProcedureHost, now_utc_s: float) -> Outcome | None:
        """See Procedure."""
        del desk, now_utc_s
        return None if self._ticket is None else outcome_of(self._ticket)


@dataclass(slots=True)
class SlewThere:
    """A slew, or several one after the other where something lies on the straight way.

    `place` is where its axes come to stand, where it is a place of them and no direction of the sky.
    """

    request: Slew
    doing: str = "slewing"
    place: AxesPosition | None = None
    _left: list[Slew] = field(default_factory=list)
    _ticket: Ticket | None = None
    _lead: Lead | None = None

    def begin(self, desk: ProcedureHost, now_utc_s: float) -> RequestRefused | None:
        """See Procedure."""
        aimed = desk.aim(self.request, self.place, now_utc_s)
        if isinstance(aimed, RequestRefused):
            return aimed
        if not isinstance(aimed, Slew):
            self._lead = aimed
            return None
        self.request = aimed
        way = desk.path_to(self.request, now_utc_s)
        if isinstance(way, RequestRefused):
            return way
        self._left = list(way)
        return self._next(desk, now_utc_s)

    def step(self, desk: ProcedureHost, now_utc_s: float) -> Outcome | None:
        """See Procedure."""
        if self._lead is not None:
            if self._lead.arrived:
                return Outcome(TicketState.COMPLETE, False)
            late = self._lead.overdue(now_utc_s)
            return Outcome(TicketState.TIMED_OUT, False, NEVER_THERE) if late else None
        assert self._ticket is not None
        outcome = outcome_of(self._ticket)
        if outcome is None or not self._left or outcome.state is not TicketState.COMPLETE:
            return outcome
        refusal = self._next(desk, now_utc_s)
        return None if refusal is None else refused(refusal)

    def _next(self, desk: ProcedureHost, now_utc_s: float) -> RequestRefused | None:
        """Ask for the next leg; the way is sought anew where something has come into it meanwhile."""
        asked = desk.submit(self._left[0], now_utc_s)
        if isinstance(asked, RequestRefused) and self._ticket is not None:
            way = desk.path_to(self.request, now_utc_s)
            if isinstance(way, RequestRefused):
                return way
            self._left = list(way)
            asked = desk.submit(self._left[0], now_utc_s)
        if isinstance(asked, RequestRefused):
            return asked
        self._left.pop(0)
        self._ticket = asked
        self.doing = "slewing round what is in the way" if self._left else "slewing"
        return None


@dataclass(slots=True)
class MoveFor:
    """MoveAxis for so many seconds, counted from the first datagram that asks for it, then its end."""

    request: MoveAxis
    seconds: float
    doing: str = "moving"
    _ticket: Ticket | None = None
    _asked_utc_s: float = 0.0
    _begun_utc_s: float | None = None
    _stood: bool = False
    """Whether the mount has been seen to stand from the last moment of the move on."""
    _ending: Ticket | None = None

    def begin(self, desk: ProcedureHost, now_utc_s: float) -> RequestRefused | None:
        """See Procedure."""
        asked = desk.submit(self.request, now_utc_s)
        if isinstance(asked, RequestRefused):
            return asked
        self._ticket, self._asked_utc_s = asked, now_utc_s
        return None

    def step(self, desk: ProcedureHost, now_utc_s: float) -> Outcome | None:
        """See Procedure."""
        assert self._ticket is not None
        if self._ending is not None:
            self._stood = self._stood and desk.stands
            return self._outcome(outcome_of(self._ending))
        if self._begun_utc_s is None and desk.move_begun:
            self._begun_utc_s = now_utc_s
        if self._ticket.settled and self._ticket.state is not TicketState.COMPLETE:
            return outcome_of(self._ticket)
        begun, overdue = self._begun_utc_s, now_utc_s - self._asked_utc_s > MOVE_BEGINS_WITHIN_S
        if (begun is not None and now_utc_s - begun >= self.seconds) or (begun is None and overdue):
            asked = desk.submit(EndMove(), now_utc_s)
            if isinstance(asked, RequestRefused):
                return refused(asked, self._ticket.was_acknowledged)
            self._ending, self.doing = asked, "ending the move"
            self._stood = begun is not None and desk.stands
        return None

    def _outcome(self, end: Outcome | None) -> Outcome | None:
        assert self._ticket is not None
        if end is None:
            return None
        acknowledged = self._ticket.was_acknowledged
        if end.state is TicketState.COMPLETE and self._stood and self._would_be_seen:
            return Outcome(TicketState.FAILED, acknowledged, STOOD)
        if end.state is TicketState.COMPLETE and not acknowledged:
            words = "the move was over before the mount acknowledged it"
            return Outcome(TicketState.UNCONFIRMED, False, words)
        return Outcome(end.state, acknowledged, end.reason)

    @property
    def _would_be_seen(self) -> bool:
        """Whether an axis that makes this move cannot look as if it stood."""
        axes = self.request.after(MoveAxes(SIDEREAL_RATE_DEG_S, 0.0))
        fastest_deg_s = max(abs(SIDEREAL_RATE_DEG_S - axes.ra_rate_deg_s), abs(axes.dec_rate_deg_s))
        return fastest_deg_s >= SEEN_DEG_S and self.seconds >= SEEN_AFTER_S


@dataclass(slots=True)
class GoHome:
    """Find home, and the way there watched: the protocol acknowledges neither.

    Where the way home is not clear, by an abort that brakes late or as something is in it, slews lead nearer.
    """

    home: AxesPosition | None
    within_s: float
    """How long the way there may take."""
    request: FindHome = field(default_factory=FindHome)
    doing: str = "going home"
    _ticket: Ticket | None = None
    _begun_utc_s: float = 0.0
    _seen_moving: bool = False
    _nearer: SlewThere | None = None

    def begin(self, desk: ProcedureHost, now_utc_s: float) -> RequestRefused | None:
        """See Procedure."""
        refusal = self._ask(desk, now_utc_s)
        if refusal is None or not refusal.by_safety:
            return refusal
        self._nearer = self._slew_nearer(desk, now_utc_s)
        if self._nearer is None or self._nearer.begin(desk, now_utc_s) is not None:
            return refusal
        return None

    def _ask(self, desk: ProcedureHost, now_utc_s: float) -> RequestRefused | None:
        asked = desk.submit(self.request, now_utc_s)
        if isinstance(asked, RequestRefused):
            return asked
        self._ticket, self._begun_utc_s = asked, now_utc_s
        return None

    def _slew_nearer(self, desk: ProcedureHost, now_utc_s: float) -> SlewThere | None:
        """Return the slew to the last place before home on a way that is clear, if there is one."""
        home, sample, status = self.home, desk.sample, desk.status
        if home is None or sample is None or status is None or status.slewing:
            return None
        there = Slew((sample.sidereal_h * 15.0 - home.hour_angle_deg) % 360.0, home.dec_deg)
        way = desk.path_to(there, now_utc_s)
        return None if isinstance(way, RequestRefused) or len(way) < 2 else SlewThere(way[-2])

    def step(self, desk: ProcedureHost, now_utc_s: float) -> Outcome | None:
        """See Procedure."""
        if self._ticket is None:
            return self._step_nearer(desk, now_utc_s)
        status = desk.status
        slewing = status is not None and status.slewing
        moving = slewing or (status is not None and not desk.at_rest)
        waited_s = now_utc_s - self._begun_utc_s
        self._seen_moving = self._seen_moving or slewing
        if self._ticket.state in {TicketState.TIMED_OUT, TicketState.FAILED, TicketState.SUPERSEDED}:
            return outcome_of(self._ticket)
        if moving and waited_s > self.within_s:
            return Outcome(TicketState.TIMED_OUT, False, "the mount did not finish its way home")
        if moving or not self._ticket.settled or (not self._seen_moving and waited_s < HOME_STARTS_WITHIN_S):
            return None
        if status is not None and status.at_home:
            return Outcome(TicketState.COMPLETE, False)
        return Outcome(TicketState.UNCONFIRMED, False, self._where(desk.sample))

    def _step_nearer(self, desk: ProcedureHost, now_utc_s: float) -> Outcome | None:
        assert self._nearer is not None
        there = self._nearer.step(desk, now_utc_s)
        if there is None or there.state is not TicketState.COMPLETE:
            return there
        refusal = self._ask(desk, now_utc_s)
        return None if refusal is None else refused(refusal)

    def _where(self, sample: StatusSample | None) -> str:
        if self.home is None or sample is None:
            seen = "moved, and stands" if self._seen_moving else "was not seen to move"
            return f"the protocol has no acknowledgement for it; the mount {seen}"
        off = off_axes_deg(sample, self.home)
        if off <= NEAR_DEG:
            return "the protocol has no acknowledgement for it; the mount stands at the profile's home"
        return (
            f"the protocol has no acknowledgement for it; the mount stands {off:.1f}° from the profile's home"
        )


@dataclass(slots=True)
class ParkThere:
    """Slew to the profile's park position, stop there, be seen at rest; cut the drives' power if asked to."""

    profile: MountProfile
    power_off: bool = True
    doing: str = "slewing to the park position"
    _way: SlewThere | None = None
    _tickets: list[Ticket] = field(default_factory=list)
    _stopped_utc_s: float | None = None

    def begin(self, desk: ProcedureHost, now_utc_s: float) -> RequestRefused | None:
        """See Procedure."""
        park, sample = self.profile.park, desk.sample
        if park is None:
            return RequestRefused(NO_PARK)
        if sample is None:
            return RequestRefused("the mount has not been heard yet")
        self._way = SlewThere(self._slew(park, sample), place=park)
        return self._way.begin(desk, now_utc_s)

    def step(self, desk: ProcedureHost, now_utc_s: float) -> Outcome | None:
        """See Procedure."""
        if not self._tickets:
            assert self._way is not None
            arrived = self._way.step(desk, now_utc_s)
            if arrived is None or arrived.state is not TicketState.COMPLETE:
                return arrived
            self.doing = "stopping at the park position"
            refusal = self._ask(desk, Abort(), now_utc_s)
            return None if refusal is None else refused(refusal)
        ticket = self._tickets[-1]
        if not ticket.settled:
            return None
        if isinstance(ticket.request, Park) or ticket.state is not TicketState.COMPLETE:
            return outcome_of(ticket)
        if not self._rests(desk, now_utc_s):
            return None
        return self._park(desk, now_utc_s) if self.power_off else outcome_of(ticket)

    def _park(self, desk: ProcedureHost, now_utc_s: float) -> Outcome | None:
        self.doing = "parking"
        refusal = self._ask(desk, Park(), now_utc_s)
        return None if refusal is None else refused(refusal)

    def _rests(self, desk: ProcedureHost, now_utc_s: float) -> bool:
        """Tell whether the drives stand still, or have had the time for it: safety judges then."""
        if self._stopped_utc_s is None:
            self._stopped_utc_s = now_utc_s
        return desk.stands or now_utc_s - self._stopped_utc_s > RESTS_WITHIN_S

    def _slew(self, park: AxesPosition, sample: StatusSample) -> Slew:
        """Return the slew whose end, sidereal tracking counted, is there when it is reached."""
        slowest_deg_s = min(self.profile.ra.slew_rate_deg_s, self.profile.dec.slew_rate_deg_s)
        takes_s = off_axes_deg(sample, park) / slowest_deg_s + SLEW_SETTLING_S
        then_deg = sample.sidereal_h * 15.0 + takes_s * 15.0 / 3600.0
        return Slew((then_deg - park.hour_angle_deg) % 360.0, park.dec_deg)

    def _ask(self, desk: ProcedureHost, request: Request, now_utc_s: float) -> RequestRefused | None:
        asked = desk.submit(request, now_utc_s)
        if isinstance(asked, RequestRefused):
            return asked
        self._tickets.append(asked)
        return None


def off_axes_deg(sample: StatusSample, place: AxesPosition) -> float:
    """Return the larger of the two axes' distances from a place, degrees."""
    hour_angle_deg = sample.sidereal_h * 15.0 - sample.ra_deg
    return max(
        abs(math.remainder(hour_angle_deg - place.hour_angle_deg, 360.0)), abs(sample.dec_deg - place.dec_deg)
    )


def procedure_for(request: Request, profile: MountProfile) -> Procedure:
    """Return how a request is carried out. Raises ValueError for a MoveAxis, which needs its length."""
    match request:
        case Park():
            return ParkThere(profile)
        case FindHome():
            return GoHome(profile.home, profile.goes_within_s(), request)
        case Slew():
            return SlewThere(request)
        case MoveAxis():
            raise ValueError("a MoveAxis needs its length: MoveFor, or a jog")
    return Once(request, _DOING.get(type(request).__name__, "asking"))


_DOING = {
    "Sync": "syncing",
    "Abort": "stopping",
    "PulseGuide": "guiding",
    "FineRate": "setting the fine rates",
    "TrackingRate": "setting the tracking rate",
    "EndMove": "ending the move",
}
