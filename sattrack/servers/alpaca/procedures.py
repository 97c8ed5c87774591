"""What an order to an Alpaca telescope has the console do: procedures, without I/O.

MoveAxis is ASCOM's: rates of the axes themselves, in force until other rates are given. A slew during a slew
stops the first one before it begins.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from sattrack.control.procedures import (
    DONE,
    MoveFor,
    Once,
    Outcome,
    RequestRefused,
    outcome_of,
    procedure_for,
    refused,
)
from sattrack.mount.model import SIDEREAL_RATE_DEG_S, Slew
from sattrack.mount.requests import (
    Abort,
    EndMove,
    FindHome,
    FineRate,
    MoveAxis,
    Park,
    PulseGuide,
    Sync,
    Ticket,
    TicketState,
)
from sattrack.servers.alpaca.protocol import GUIDING, MOVING_BY_RATES, Fault, FineOrder, Number, TrackOrder

if TYPE_CHECKING:
    from sattrack.control.procedures import Procedure, ProcedureHost
    from sattrack.mount.model import MountProfile
    from sattrack.servers.alpaca.protocol import Order

SECONDARY = 1
MOVE_S = 0.1
LEAST_DEG_S = 1e-6
"""Practically none; 0 would be no edge to a mount that takes rates by edges."""
SURE_AFTER_S = 0.15
SEEN_WITHIN_S = 3.0
"""How long a mount's positions must show the commanded state, and within what time."""


def procedure_of(order: Order, profile: MountProfile, fine: FineRate) -> Procedure:
    """Return the procedure that carries out an order; `fine` are the rates in force.

    Raises TypeError for orders that are no procedure.
    """
    match order:
        case Slew() | Sync() | Park() | FindHome():
            return procedure_for(order, profile)
        case PulseGuide():
            return GuidePulses(order)
        case TrackOrder() if profile.geometry is not None:
            return KeepOnSky() if order.on else Once(Abort(), "ending tracking")
        case FineOrder():
            ra_deg_s = fine.ra_deg_s if order.ra_deg_s is None else order.ra_deg_s
            dec_deg_s = fine.dec_deg_s if order.dec_deg_s is None else order.dec_deg_s
            return procedure_for(FineRate(ra_deg_s, dec_deg_s), profile)
        case TrackOrder():
            return SetTracking(order.on)
    raise TypeError(type(order))


def as_request(axis: int, rate_deg_s: float, stands: bool) -> MoveAxis:
    """Return the request that turns an axis at a rate of its own, westward or northward.

    The primary axis' rate stands in place of sidereal tracking; a Xerxes mount adds its own MoveAxis rate to
    that. Rate 0 gives the axis back to what it did before: it follows the sky, or `stands`.
    """
    if axis == SECONDARY:
        return MoveAxis(dec_rate_deg_s=rate_deg_s)
    if stands:
        return MoveAxis(ra_rate_deg_s=SIDEREAL_RATE_DEG_S - rate_deg_s)
    return MoveAxis(ra_rate_deg_s=SIDEREAL_RATE_DEG_S - rate_deg_s if rate_deg_s else 0.0)


class Drive:
    """A MoveAxis of one axis or both, a procedure of the console, until both axes are ended.

    `stands` tells that an axis at rate 0 stands; `stops` that the mount did not track before, so that it
    stands afterwards too. The protocol's own end of MoveAxis would set it tracking.
    """

    doing = MOVING_BY_RATES

    def __init__(self, axis: int, rate_deg_s: float, *, stands: bool = False, stops: bool = False) -> None:
        self._rates, self._stands, self._stops = {axis: rate_deg_s}, stands or stops, stops
        self._ticket: Ticket | None = None
        self._ending: Ticket | None = None

    @property
    def turning(self) -> tuple[int, ...]:
        """The axes that move by the last commands."""
        return tuple(axis for axis, rate_deg_s in self._rates.items() if rate_deg_s)

    @property
    def moves(self) -> bool:
        """Whether an axis moves by the last command."""
        return bool(self.turning)

    def begin(self, desk: ProcedureHost, now_utc_s: float) -> RequestRefused | None:
        """See Procedure."""
        (axis, rate_deg_s) = next(iter(self._rates.items()))
        request = as_request(axis, rate_deg_s, self._stands)
        if self._stops and axis == SECONDARY:
            request = MoveAxis(SIDEREAL_RATE_DEG_S, rate_deg_s)
        return self._ask(desk, request, now_utc_s)

    def change(
        self, desk: ProcedureHost, axis: int, rate_deg_s: float, now_utc_s: float
    ) -> RequestRefused | None:
        """Turn an axis at another rate; the other axis goes on as it did."""
        after = {**self._rates, axis: rate_deg_s}
        if not any(after.values()):
            self._rates = after
            return self._end(desk, now_utc_s)
        refusal = self._ask(desk, as_request(axis, rate_deg_s, self._stands), now_utc_s)
        if refusal is None:
            self._rates, self._ending = after, None
        return refusal

    def step(self, desk: ProcedureHost, now_utc_s: float) -> Outcome | None:
        """See Procedure."""
        del desk, now_utc_s
        if self._ending is not None:
            return outcome_of(self._ending)
        ticket = self._ticket
        if ticket is None or not ticket.settled or ticket.state is TicketState.COMPLETE:
            return None
        return outcome_of(ticket)

    def _ask(self, desk: ProcedureHost, request: MoveAxis, now_utc_s: float) -> RequestRefused | None:
        submitted = desk.submit(request, now_utc_s)
        if isinstance(submitted, RequestRefused):
            return submitted
        self._ticket = submitted
        return None

    def _end(self, desk: ProcedureHost, now_utc_s: float) -> RequestRefused | None:
        if self._ending is not None:
            return None
        submitted = desk.submit(Abort() if self._stops else EndMove(), now_utc_s)
        if isinstance(submitted, RequestRefused):
            return submitted
        self._ending = submitted
        return None


class GuidePulses:
    """Guide pulses of either axis, one after the other: the mount's own end with a new one."""

    doing = GUIDING

    def __init__(self, pulse: PulseGuide) -> None:
        self._left = [pulse]
        """The one under way, and the ones that wait for its end."""
        self._ticket: Ticket | None = None

    def hold(self, pulse: PulseGuide) -> None:
        """Take a pulse for later; raises Fault where its axis has one already."""
        if any(bool(one.ra_ms) == bool(pulse.ra_ms) for one in self._left):
            raise Fault(Number.INVALID_OPERATION, "PulseGuide: the mount guides already")
        self._left.append(pulse)

    def begin(self, desk: ProcedureHost, now_utc_s: float) -> RequestRefused | None:
        """See Procedure."""
        submitted = desk.submit(self._left[0], now_utc_s)
        if isinstance(submitted, RequestRefused):
            return submitted
        self._ticket = submitted
        return None

    def step(self, desk: ProcedureHost, now_utc_s: float) -> Outcome | None:
        """See Procedure."""
        assert self._ticket is not None
        outcome = outcome_of(self._ticket)
        if outcome is None or outcome.state not in DONE or len(self._left) == 1:
            return outcome
        del self._left[0]
        refusal = self.begin(desk, now_utc_s)
        return None if refusal is None else refused(refusal)


class AfterStop:
    """A stop to its end, then another procedure: the mount ignores a slew while it slews.

    No path is searched while the mount moves: that may take longer than the next datagram can wait.
    """

    def __init__(self, then: Procedure) -> None:
        self._then = then
        self._stop: Ticket | None = None
        self._begun = False

    @property
    def doing(self) -> str:
        """The operation under way, as text."""
        return self._then.doing if self._begun else f"stopping before {self._then.doing}"

    def begin(self, desk: ProcedureHost, now_utc_s: float) -> RequestRefused | None:
        """See Procedure."""
        submitted = desk.submit(Abort(), now_utc_s)
        if isinstance(submitted, RequestRefused):
            return submitted
        self._stop = submitted
        return None

    def step(self, desk: ProcedureHost, now_utc_s: float) -> Outcome | None:
        """See Procedure."""
        if self._begun:
            return self._then.step(desk, now_utc_s)
        assert self._stop is not None
        if not self._stop.settled:
            return None
        if self._stop.state is not TicketState.COMPLETE:
            return outcome_of(self._stop)
        self._begun = True
        refusal = self._then.begin(desk, now_utc_s)
        return None if refusal is None else refused(refusal)


class KeepOnSky:
    """Keep the telescope of a mount with a geometry where it looks."""

    doing = "taking up tracking"

    def begin(self, desk: ProcedureHost, now_utc_s: float) -> RequestRefused | None:
        """See Procedure."""
        return desk.keep_here(now_utc_s)

    def step(self, desk: ProcedureHost, now_utc_s: float) -> Outcome | None:
        """See Procedure."""
        del desk, now_utc_s
        return Outcome(TicketState.COMPLETE, False)


class SetTracking:
    """Make a mount at rest follow the sky, by a MoveAxis and its end; or stand, by a stop.

    The protocol has no other command for it and acknowledges neither: the mount's positions show the result.
    """

    def __init__(self, on: bool) -> None:
        self.doing = "taking up tracking" if on else "ending tracking"
        self._on = on
        self._first: Procedure = MoveFor(MoveAxis(LEAST_DEG_S), MOVE_S) if on else Once(Abort(), "stopping")
        self._begun_utc_s: float | None = None
        self._so_since_utc_s: float | None = None

    def begin(self, desk: ProcedureHost, now_utc_s: float) -> RequestRefused | None:
        """See Procedure."""
        return self._first.begin(desk, now_utc_s)

    def step(self, desk: ProcedureHost, now_utc_s: float) -> Outcome | None:
        """See Procedure."""
        if self._begun_utc_s is None:
            outcome = self._first.step(desk, now_utc_s)
            if outcome is None or outcome.state not in {TicketState.COMPLETE, TicketState.UNCONFIRMED}:
                return outcome
            self._begun_utc_s = now_utc_s
        if not desk.at_rest or desk.stands is self._on:
            self._so_since_utc_s = None
        elif self._so_since_utc_s is None:
            self._so_since_utc_s = now_utc_s
        if self._so_since_utc_s is not None and now_utc_s - self._so_since_utc_s >= SURE_AFTER_S:
            return Outcome(TicketState.COMPLETE, True)
        if now_utc_s - self._begun_utc_s < SEEN_WITHIN_S:
            return None
        reason = "the mount did not take up tracking" if self._on else "the mount goes on tracking by itself"
        return Outcome(TicketState.FAILED, True, reason)


def refuse(refusal: RequestRefused | None) -> None:
    """Raise Fault for a refusal of the console."""
    if refusal is not None:
        raise Fault(Number.INVALID_OPERATION, refusal.words)
