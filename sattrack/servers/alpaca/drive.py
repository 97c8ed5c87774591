"""How orders of ASCOM's clients are carried out: each order begins a procedure of the console.

MoveAxis as ASCOM means it: rates of the axes themselves, in force until other rates are given. A slew during
a slew stops the first one before it begins.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from sattrack.control.manual_operation import (
    MoveFor,
    Once,
    Outcome,
    RequestRefused,
    outcome_of,
    procedure_for,
    refused,
)
from sattrack.core.angles import altitude_deg
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
from sattrack.servers.alpaca.messages import (
    Fault,
    FineOrder,
    HomeOrder,
    Number,
    ParkOrder,
    PulseOrder,
    SlewOrder,
    SyncOrder,
    TrackOrder,
)

if TYPE_CHECKING:
    from sattrack.control.manual_operation import Procedure, ProcedureHost
    from sattrack.mount.model import MountProfile, Status
    from sattrack.safety import SafetyLimits
    from sattrack.servers.alpaca.messages import Order

PRIMARY = 0
SECONDARY = 1
MOVE_S = 0.1
LEAST_DEG_S = 1e-6
"""As good as none; 0 would be no edge to a mount that takes rates by edges."""
SURE_AFTER_S = 0.15
SEEN_WITHIN_S = 3.0
"""How long a mount's positions must show what was asked for, and within what time they must."""


def as_request(axis: int, rate_deg_s: float) -> MoveAxis:
    """Return the request that turns an axis at a rate of its own, westward or northward.

    The primary axis' rate stands in place of sidereal tracking; a Xerxes mount adds its own MoveAxis rate to
    that. Rate 0 is no standstill: it gives the axis back to what it did before, which is the sky.
    """
    if axis == SECONDARY:
        return MoveAxis(dec_rate_deg_s=rate_deg_s)
    return MoveAxis(ra_rate_deg_s=SIDEREAL_RATE_DEG_S - rate_deg_s if rate_deg_s else 0.0)


class Drive:
    """A MoveAxis of one axis or both, a procedure of the console, until both axes are ended."""

    doing = "moving by MoveAxis"

    def __init__(self, axis: int, rate_deg_s: float) -> None:
        self._rates = {axis: rate_deg_s}
        self._ticket: Ticket | None = None
        self._ending: Ticket | None = None

    @property
    def moves(self) -> bool:
        """Whether an axis moves by the last command."""
        return any(self._rates.values())

    def begin(self, desk: ProcedureHost, now_utc_s: float) -> RequestRefused | None:
        """See Procedure."""
        (axis, rate_deg_s) = next(iter(self._rates.items()))
        return self._ask(desk, as_request(axis, rate_deg_s), now_utc_s)

    def change(
        self, desk: ProcedureHost, axis: int, rate_deg_s: float, now_utc_s: float
    ) -> RequestRefused | None:
        """Turn an axis at another rate; what the other one does stays."""
        after = {**self._rates, axis: rate_deg_s}
        if not any(after.values()):
            self._rates = after
            return self._end(desk, now_utc_s)
        refusal = self._ask(desk, as_request(axis, rate_deg_s), now_utc_s)
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
        asked = desk.submit(request, now_utc_s)
        if isinstance(asked, RequestRefused):
            return asked
        self._ticket = asked
        return None

    def _end(self, desk: ProcedureHost, now_utc_s: float) -> RequestRefused | None:
        if self._ending is not None:
            return None
        asked = desk.submit(EndMove(), now_utc_s)
        if isinstance(asked, RequestRefused):
            return asked
        self._ending = asked
        return None


class AfterStop:
    """A stop, seen through, and then another procedure: the mount ignores a slew while it slews.

    Nor is a way sought while the mount moves: that may take longer than the next datagram can wait.
    """

    def __init__(self, then: Procedure) -> None:
        self._then = then
        self._stop: Ticket | None = None
        self._begun = False

    @property
    def doing(self) -> str:
        """The operation under way, as text."""
        return self._then.doing if self._begun else "stopping before it slews elsewhere"

    def begin(self, desk: ProcedureHost, now_utc_s: float) -> RequestRefused | None:
        """See Procedure."""
        asked = desk.submit(Abort(), now_utc_s)
        if isinstance(asked, RequestRefused):
            return asked
        self._stop = asked
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


class SetTracking:
    """Have a mount at rest follow the sky, by a MoveAxis and its end; or stand, by a stop.

    The protocol has no other way, and acknowledges neither: the mount's positions tell what came of it.
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
        words = "the mount did not take up tracking" if self._on else "the mount goes on tracking by itself"
        return Outcome(TicketState.FAILED, True, words)


@dataclass(slots=True)
class Operation:
    """A procedure that an order began; `waiting` is the order that is answered at its end."""

    kind: str
    procedure: Procedure
    waiting: int | None = None


def procedure_of(  # noqa: PLR0911 - one for each kind of order
    order: Order, profile: MountProfile, fine: FineRate
) -> tuple[str, Procedure]:
    """Return how an order is carried out, and of which kind that is; `fine` are the rates in force.

    Raises TypeError for orders that are no procedure.
    """
    match order:
        case SlewOrder():
            return "slew", procedure_for(Slew(order.ra_deg, order.dec_deg), profile)
        case SyncOrder():
            return "sync", procedure_for(Sync(order.ra_deg, order.dec_deg), profile)
        case ParkOrder():
            return "park", procedure_for(Park(), profile)
        case HomeOrder():
            return "home", procedure_for(FindHome(), profile)
        case PulseOrder():
            return "pulse", procedure_for(PulseGuide(order.ra_ms, order.dec_ms), profile)
        case FineOrder():
            ra_deg_s = fine.ra_deg_s if order.ra_deg_s is None else order.ra_deg_s
            dec_deg_s = fine.dec_deg_s if order.dec_deg_s is None else order.dec_deg_s
            return "fine", procedure_for(FineRate(ra_deg_s, dec_deg_s), profile)
        case TrackOrder():
            return "tracking", SetTracking(order.on)
    raise TypeError(type(order))


def refuse(refusal: RequestRefused | None) -> None:
    """Raise Fault for a refusal of the console's."""
    if refusal is not None:
        raise Fault(Number.INVALID_OPERATION, refusal.words)


def check_floor(order: SlewOrder, status: Status | None, limits: SafetyLimits, latitude_deg: float) -> None:
    """Raise Fault for a direction below the floor; checked before anything that moves is stopped."""
    if status is None:
        return
    altitude = altitude_deg(status.sidereal_h * 15.0 - order.ra_deg, order.dec_deg, latitude_deg)
    if altitude < limits.floor_altitude_deg:
        words = f"that direction is at {altitude:.1f}° altitude; the limit is {limits.floor_altitude_deg:g}°"
        raise Fault(Number.INVALID_OPERATION, words)
