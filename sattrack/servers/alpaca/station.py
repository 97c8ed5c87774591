"""The mount's side of an Alpaca telescope, without I/O: orders and datagrams in, datagrams and answers out.

A console drives the mount, as by hand; while a satellite is followed, an engine does, as in `track`. Both
pass `safety`, and hand over what they know of the cables' winding. Each order begins a procedure of the
console. MoveAxis is ASCOM's: rates of the axes themselves, in force until other rates are given. A slew
during a slew stops the first one before it begins.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from sattrack.control.console import Console
from sattrack.control.driver import StopProcedure
from sattrack.control.manual_operation import (
    DONE,
    MoveFor,
    Once,
    Outcome,
    RequestRefused,
    outcome_of,
    procedure_for,
    refused,
)
from sattrack.control.tracker import FOLLOWING
from sattrack.core.angles import altitude_deg
from sattrack.mount.model import SIDEREAL_RATE_DEG_S, Hold, Slew
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
from sattrack.mount.xerxes.link import LinkState
from sattrack.servers.alpaca.protocol import (
    MOVING_BY_RATES,
    BiasOrder,
    Fault,
    FineOrder,
    FollowOrder,
    MoveOrder,
    Number,
    TrackOrder,
)
from sattrack.servers.alpaca.state import (
    Answers,
    MountState,
    followed,
    offset,
    state_of,
)
from sattrack.views.messages import StopNow

if TYPE_CHECKING:
    from collections.abc import Callable

    import msgspec

    from sattrack.control.engine import Engine
    from sattrack.control.manual_operation import Procedure, ProcedureHost
    from sattrack.mount.model import MountProfile, Status
    from sattrack.mount.xerxes.session import Session
    from sattrack.safety import Safety, SafetyLimits
    from sattrack.servers.alpaca.protocol import NumberedOrder, Order, TelescopeState
    from tle.site import Site

MOVING_KINDS = frozenset({"slew", "park", "home"})
HELD_KINDS = frozenset({"sync", "fine", "tracking"})
"""Answered at their end, after a few datagrams."""
PRIMARY = 0
SECONDARY = 1
MOVE_S = 0.1
LEAST_DEG_S = 1e-6
"""Practically none; 0 would be no edge to a mount that takes rates by edges."""
SURE_AFTER_S = 0.15
SEEN_WITHIN_S = 3.0
"""How long a mount's positions must show the commanded state, and within what time."""


class TelescopeStation:
    """One mount, until `end` is called and the mount is seen at rest.

    `make_engine` makes the engine that follows a satellite from the facts of a run and the instant; it raises
    ValueError where they cannot be read.
    """

    def __init__(
        self,
        profile: MountProfile,
        limits: SafetyLimits,
        site: Site,
        mount_name: str,
        make_engine: Callable[[msgspec.Raw, float], Engine],
    ) -> None:
        self.profile = profile
        self._limits, self._site, self._mount_name = limits, site, mount_name
        self._make_engine = make_engine
        self.console = self._new_console()
        self.engine: Engine | None = None
        self.answers = Answers()
        self.log_lines: list[str] = []
        """Whoever logs them removes them."""
        self.link = LinkState.SILENT
        self._heard: tuple[bytes, float] | None = None
        """The mount's last datagram: a new session begins with it."""
        self._operation: Operation | None = None
        self._mount_state = MountState(profile)
        self._failure: str | None = None
        self._trouble: str | None = None
        self._reset_at_rest = False
        self.had_orders = False
        """Whether any order was begun."""
        self._ending: StopProcedure | None = None
        self.finished = False
        self.mount_stopped: bool | None = None

    @property
    def session(self) -> Session:
        """The session with the mount that is in force."""
        return self.console.session if self.engine is None else self.engine.session

    @property
    def safety(self) -> Safety:
        """The gate of the motions."""
        return self.console.safety if self.engine is None else self.engine.safety

    @property
    def tripped(self) -> str | None:
        """Name of the interlock that stopped the mount."""
        return self.safety.tripped

    @property
    def link_up(self) -> bool:
        """Whether the mount is heard."""
        return self.link in {LinkState.UP, LinkState.STALE}

    @property
    def on_trajectory(self) -> bool:
        """Whether a satellite is followed, and no limit keeps the mount off it."""
        return self.engine is not None and self.engine.safety.holding is None

    def receive(self, data: bytes, arrival_utc_s: float) -> None:
        """Take one datagram from the mount."""
        self._heard = (data, arrival_utc_s)
        if self.engine is not None:
            receive_or_stop(self.engine, data, arrival_utc_s)
        else:
            self.console.receive(data, arrival_utc_s)
        self._mount_state.see(self.session)

    def tick(self, now_utc_s: float) -> bytes:
        """Return the datagram to send now; call once a period."""
        if self.engine is not None:
            datagram = tick_or_stop(self.engine, now_utc_s)
            if self.engine.finished:
                self._leave_satellite()
        else:
            datagram = self.console.tick(now_utc_s)
            self._look_at_procedure()
            self._look_for_trouble()
            self._make_ready()
        self.link = self.session.link_state(now_utc_s)
        self.answers.tick(self._drive is None and self.console.at_rest)
        self._watch_end(now_utc_s)
        return datagram

    def repeat(self) -> bytes | None:
        """Return what to send once more before the next datagram, None for nothing."""
        return None if self.engine is None else self.engine.repeat()

    def send_shift_s(self, now_utc_s: float) -> float:
        """Return the delay of the next `tick` beyond one period from now, seconds."""
        return 0.0 if self.engine is None else self.engine.send_shift_s(now_utc_s)

    def end(self, now_utc_s: float) -> None:
        """Bring the mount to rest, and be finished when it is seen there."""
        if self._ending is not None:
            return
        console = self.console
        offset_rates = console.session.fine_rate != FineRate()
        moving = self.engine is not None or console.moving or console.stopping or offset_rates
        self._ending = StopProcedure(now_utc_s, needed=moving)
        if self.engine is not None:
            self.engine.operate(StopNow(), now_utc_s)
        elif moving:
            self.console.abort(now_utc_s)

    def obey(self, numbered: NumberedOrder, now_utc_s: float) -> None:
        """Begin an order; its answer comes in `answers`, at once or after some `tick`."""
        try:
            if self._ending is not None:
                raise Fault(Number.INVALID_OPERATION, "the server is ending")
            held = self._begin(numbered, now_utc_s)
        except Fault as fault:
            self.answers.refused(numbered.number, fault)
            return
        if not held:
            self.answers.done(numbered.number)

    def state(self, now_utc_s: float) -> TelescopeState:
        """Return what clients may see, as of an instant."""
        kind = None if self._operation is None else self._operation.kind
        moves = self._drive is not None and self._drive.moves
        slewing = kind in MOVING_KINDS or moves or self._is_slewing or self.answers.await_rest
        following = None
        if self.engine is not None:
            slewing = self.engine.phase not in FOLLOWING or self.engine.tracker.acquired_utc_s is None
            following = followed(self.engine, now_utc_s)
        return state_of(
            self.session,
            self._mount_state,
            utc_s=now_utc_s,
            heard=self.link_up,
            slewing=slewing,
            pulsing=kind == "pulse",
            doing=self._doing,
            failure=self._failure,
            tripped=self.tripped,
            following=following,
        )

    @property
    def _drive(self) -> Drive | None:
        procedure = self.console.procedure
        return procedure if isinstance(procedure, Drive) else None

    @property
    def _is_fine(self) -> bool:
        """Whether an order of fine rates is under way."""
        return self._operation is not None and self._operation.kind == "fine"

    @property
    def _is_slewing(self) -> bool:
        """Whether the mount slews, or a stop is not yet over: nothing else can begin before."""
        ended = self.session.stopped and self.console.procedure is None
        status, stopping = self.session.status, self.console.stopping and not ended
        return stopping or (self._drive is None and status is not None and status.slewing)

    @property
    def _doing(self) -> str:
        if self.engine is not None:
            return f"following {self.engine.spec.propagator.elements.label} (TrackSatellite)"
        if self.console.stopping:
            return "stopping"
        return "idle" if self.console.procedure is None else self.console.procedure.doing

    def _begin(self, numbered: NumberedOrder, now_utc_s: float) -> bool:
        """Begin an order; return whether its answer comes later. Raises Fault."""
        order = numbered.order
        if isinstance(order, Abort):
            self._abort(now_utc_s)
            return False
        if isinstance(order, BiasOrder):
            offset(self.engine, order, now_utc_s)
            return False
        self._check(order)
        self.had_orders = True
        if isinstance(order, MoveOrder):
            return self._move(numbered.number, order, now_utc_s)
        if isinstance(order, FollowOrder):
            self._follow(order, now_utc_s)
            return False
        kind = str(order.__struct_config__.tag)
        procedure = procedure_of(order, self.profile, self.console.session.fine_rate)
        if isinstance(order, Slew | Park) and (self._is_slewing or self._drive is not None):
            if isinstance(order, Slew):
                check_floor(order, self.session.status, self._limits, self._site.latitude_deg)
            procedure = AfterStop(procedure)
        operation = self._begin_operation(kind, procedure, now_utc_s)
        if kind in HELD_KINDS or numbered.waits:
            operation.waiting = numbered.number
            return True
        return False

    def _check(self, order: Order) -> None:
        """Raise Fault where an order conflicts with the operation under way."""
        if self.engine is not None:
            raise Fault(Number.INVALID_OPERATION, f"the mount is {self._doing}: AbortSlew ends that")
        if self._mount_state.at_park(self.session):
            raise Fault(Number.PARKED, "the mount is parked, and only its own console takes it out of park")
        replaces = isinstance(order, Slew | Park)
        on_with_it = isinstance(order, MoveOrder) and (self._drive is not None or not order.rate_deg_s)
        # A rate that is in force is only looked at for a while: the protocol acknowledges none.
        busy = self.console.procedure is not None and not self._is_fine
        if busy and not (replaces or on_with_it):
            raise Fault(Number.INVALID_OPERATION, f"the mount is {self._doing}: AbortSlew ends that")

    def _begin_operation(self, kind: str, procedure: Procedure, now_utc_s: float) -> Operation:
        """Begin a procedure in place of the operation under way, and return the new one. Raises Fault."""
        former = self._operation
        refuse(self.console.begin(procedure, now_utc_s))
        self._supersede(former)
        self._operation = operation = Operation(kind, procedure)
        if kind != "fine":
            self._failure = None
        self._mount_state.moved(kind)
        return operation

    def _supersede(self, former: Operation | None) -> None:
        kind, waiting = ("", None) if former is None else (former.kind, former.waiting)
        self.answers.supersede(kind, waiting)
        self._operation = None

    def _move(self, number: int, order: MoveOrder, now_utc_s: float) -> bool:
        """Turn an axis, or give it back; the end of a move is answered when it is seen."""
        drive = self._drive
        if drive is None:
            if order.rate_deg_s:
                self._begin_operation("move", Drive(order.axis, order.rate_deg_s), now_utc_s)
            return False
        refuse(drive.change(self.console, order.axis, order.rate_deg_s, now_utc_s))
        if drive.moves:
            return False
        self.answers.at_rest(number)
        return True

    def _abort(self, now_utc_s: float) -> None:
        self._failure = None
        if self.engine is not None:
            self.engine.operate(StopNow(), now_utc_s)
            return
        if self._mount_state.at_park(self.session):
            raise Fault(Number.PARKED, "the mount is parked: its drives have no power")
        former = self._operation
        self._reset_at_rest = self.tripped is not None
        self.console.abort(now_utc_s)
        self.had_orders = True
        self._supersede(former)
        self._mount_state.moved("abort")

    def _follow(self, order: FollowOrder, now_utc_s: float) -> None:
        session = self.console.session
        idle = isinstance(session.wanted, Hold) and session.move_over and not session.busy
        status = session.status
        if not idle or status is None or status.slewing:
            raise Fault(Number.INVALID_OPERATION, f"the mount is {self._doing}: wait until that is over")
        if self.tripped is not None:
            raise Fault(Number.INVALID_OPERATION, "safety has stopped the mount: AbortSlew makes it ready")
        try:
            engine = self._make_engine(order.facts, now_utc_s)
        except ValueError as error:
            raise Fault(Number.INVALID_VALUE, str(error)) from error
        engine.safety.follow_on(self.console.safety)
        if self._heard is not None:
            receive_or_stop(engine, *self._heard)
        self.engine, self._failure = engine, None
        self._mount_state.moved("move")
        self.log_lines.append(f"follows {engine.spec.propagator.elements.label}")

    def _leave_satellite(self) -> None:
        engine = self.engine
        assert engine is not None
        why = engine.tracker.ended_by
        if why not in {"set", "operator"}:
            self._failure = engine.message or "the satellite was lost"
        if engine.mount_stopped is False:
            self._failure = "THE MOUNT DID NOT CONFIRM THE STOP: stop it by hand"
        self.log_lines.append(f"follows {engine.spec.propagator.elements.label} no more: {why}")
        self.console = self._new_console()
        self.console.safety.follow_on(engine.safety)
        if self._heard is not None:
            self.console.receive(*self._heard)
        self.engine = None
        if self._ending is not None:
            # The engine has seen its stop through.
            self.mount_stopped = engine.mount_stopped
            self._ending.needed = False

    def _look_at_procedure(self) -> None:
        """Settle the operation that has ended."""
        operation = self._operation
        if operation is None:
            return
        if self.console.procedure is operation.procedure:
            self._look_at_rates(operation)
            return
        self._operation = None
        outcome = self.console.outcome
        if outcome is None:
            self._supersede(operation)
            return
        self._settle(operation, outcome)

    def _look_at_rates(self, operation: Operation) -> None:
        """Answer an order of fine rates as soon as they are sent."""
        procedure = operation.procedure
        if operation.waiting is None or not (self._is_fine and isinstance(procedure, Once)):
            return
        if self.console.session.fine_rate == procedure.request:
            self.answers.done(operation.waiting)
            operation.waiting = None

    def _settle(self, done: Operation, outcome: Outcome) -> None:
        ended_well = outcome.state in DONE
        reason = outcome.reason or f"{done.kind}: {outcome.state.value}"
        if ended_well and done.kind == "park":
            self._mount_state.parked(self.session)
        if ended_well and done.kind == "home":
            ended_well = self._mount_state.came_home(self.session)
        if not ended_well and done.kind in MOVING_KINDS | {"move"}:
            self._failure = reason
            if self.console.trouble is None:
                self.log_lines.append(f"{done.kind} failed: {reason}")
        if done.waiting is not None:
            number = Number.DRIVER if outcome.refusal is None else Number.INVALID_OPERATION
            self.answers.soon(done.waiting, None if ended_well else Fault(number, reason))

    def _look_for_trouble(self) -> None:
        """Report a stop that safety or a failure began."""
        trouble = self.console.trouble
        if trouble is not None and trouble != self._trouble:
            self._failure = self.console.refusal or trouble
            self.log_lines.append(f"the mount is being stopped: {self._failure}")
        self._trouble = trouble

    def _make_ready(self) -> None:
        """After an AbortSlew, let a mount move again that safety has stopped, once it is at rest."""
        if self._reset_at_rest and self.console.procedure is None and self.console.at_rest:
            self._reset_at_rest = self.console.reset() is not None

    def _watch_end(self, now_utc_s: float) -> None:
        if self._ending is None or self.finished or self.engine is not None:
            return
        self.finished = self._ending.look(self.console.session, now_utc_s)
        if self._ending.needed:
            self.mount_stopped = self._ending.at_rest

    def _new_console(self) -> Console:
        return Console(self.profile, self._limits, self._site, self._mount_name)


def receive_or_stop(engine: Engine, data: bytes, arrival_utc_s: float) -> None:
    """Give a datagram to an engine; one that fails stops the mount."""
    try:
        engine.receive(data, arrival_utc_s)
    except Exception as error:  # noqa: BLE001 - no error is worth a mount that is left moving
        engine.fail(str(error))


def tick_or_stop(engine: Engine, now_utc_s: float) -> bytes:
    """Return an engine's datagram to send now; one that fails stops the mount."""
    try:
        return engine.tick(now_utc_s)
    except Exception as error:  # noqa: BLE001 - no error is worth a mount that is left moving
        engine.fail(str(error))
        return engine.tick(now_utc_s)


@dataclass(slots=True)
class Operation:
    """A procedure that an order began; `waiting` is the number of the order that is answered at its end."""

    kind: str
    procedure: Procedure
    waiting: int | None = None


def procedure_of(order: Order, profile: MountProfile, fine: FineRate) -> Procedure:
    """Return the procedure that carries out an order; `fine` are the rates in force.

    Raises TypeError for orders that are no procedure.
    """
    match order:
        case Slew() | Sync() | Park() | FindHome() | PulseGuide():
            return procedure_for(order, profile)
        case FineOrder():
            ra_deg_s = fine.ra_deg_s if order.ra_deg_s is None else order.ra_deg_s
            dec_deg_s = fine.dec_deg_s if order.dec_deg_s is None else order.dec_deg_s
            return procedure_for(FineRate(ra_deg_s, dec_deg_s), profile)
        case TrackOrder():
            return SetTracking(order.on)
    raise TypeError(type(order))


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

    doing = MOVING_BY_RATES

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
        """Turn an axis at another rate; the other axis goes on as it did."""
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
        submitted = desk.submit(request, now_utc_s)
        if isinstance(submitted, RequestRefused):
            return submitted
        self._ticket = submitted
        return None

    def _end(self, desk: ProcedureHost, now_utc_s: float) -> RequestRefused | None:
        if self._ending is not None:
            return None
        submitted = desk.submit(EndMove(), now_utc_s)
        if isinstance(submitted, RequestRefused):
            return submitted
        self._ending = submitted
        return None


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
        return self._then.doing if self._begun else "stopping before it slews elsewhere"

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


def check_floor(order: Slew, status: Status | None, limits: SafetyLimits, latitude_deg: float) -> None:
    """Raise Fault for a direction below the floor; checked before anything that moves is stopped."""
    if status is None:
        return
    altitude = altitude_deg(status.sidereal_h * 15.0 - order.ra_deg, order.dec_deg, latitude_deg)
    if altitude < limits.floor_altitude_deg:
        message = (
            f"that direction is at {altitude:.1f}° altitude; the limit is {limits.floor_altitude_deg:g}°"
        )
        raise Fault(Number.INVALID_OPERATION, message)
