"""The mount's side of an Alpaca telescope, without I/O: orders and datagrams in, datagrams and answers out.

One mount behind a console, as by hand, or, while a satellite is followed, behind an engine, as `track` has
it. Both pass `safety`; what the one knows of the cables' winding the other takes over.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from sattrack.control.console import Console
from sattrack.control.driver import StopProcedure
from sattrack.control.manual_operation import DONE, Once
from sattrack.control.tracker import FOLLOWING
from sattrack.mount.model import Hold
from sattrack.mount.requests import FineRate
from sattrack.mount.xerxes.link import LinkState
from sattrack.servers.alpaca.drive import AfterStop, Drive, Operation, check_floor, procedure_of, refuse
from sattrack.servers.alpaca.messages import (
    AbortOrder,
    BiasOrder,
    Fault,
    FollowOrder,
    MoveOrder,
    Number,
    ParkOrder,
    SlewOrder,
)
from sattrack.servers.alpaca.standing import (
    Answers,
    MountState,
    followed,
    offset,
    receive_or_stop,
    state_of,
    tick_or_stop,
)
from sattrack.views.messages import StopNow

if TYPE_CHECKING:
    from collections.abc import Callable

    import msgspec

    from sattrack.control.engine import Engine
    from sattrack.control.manual_operation import Outcome, Procedure
    from sattrack.mount.model import MountProfile
    from sattrack.mount.xerxes.session import Session
    from sattrack.safety import Safety, SafetyLimits
    from sattrack.servers.alpaca.messages import NumberedOrder, Order, TelescopeState
    from tle.site import Site

MOVING_KINDS = frozenset({"slew", "park", "home"})
HELD_KINDS = frozenset({"sync", "fine", "tracking"})
"""What is answered when it has come to its end, as it takes a few datagrams at most."""


class TelescopeStation:
    """One mount, until its end is asked for and the mount is seen at rest.

    `make_engine` makes what follows a satellite, from the facts of a run and the instant; it raises
    ValueError where they are none.
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
        self.words: list[str] = []
        """Lines for the log; likewise."""
        self.link = LinkState.SILENT
        self._heard: tuple[bytes, float] | None = None
        """The mount's last datagram: what a new conversation begins with."""
        self._under_way: Operation | None = None
        self._standing = MountState(profile)
        self._failure: str | None = None
        self._trouble: str | None = None
        self._reset_at_rest = False
        self.was_asked = False
        """Whether anything was asked of the mount."""
        self._ending: StopProcedure | None = None
        self.finished = False
        self.mount_stopped: bool | None = None

    # What the loop asks.

    @property
    def session(self) -> Session:
        """The conversation with the mount that is in force."""
        return self.console.session if self.engine is None else self.engine.session

    @property
    def safety(self) -> Safety:
        """What clears motions."""
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
        self._standing.see(self.session)

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

    # What clients ask.

    def obey(self, asked: NumberedOrder, now_utc_s: float) -> None:
        """Begin what is asked; the answer stands in `answers`, at once or after some `tick`."""
        try:
            if self._ending is not None:
                raise Fault(Number.INVALID_OPERATION, "the server is ending")
            held = self._begin(asked, now_utc_s)
        except Fault as fault:
            self.answers.refused(asked.number, fault)
            return
        if not held:
            self.answers.done(asked.number)

    def state(self, now_utc_s: float) -> TelescopeState:
        """Return what clients may see, as of an instant."""
        kind = None if self._under_way is None else self._under_way.kind
        moves = self._drive is not None and self._drive.moves
        slewing = kind in MOVING_KINDS or moves or self._is_slewing or self.answers.await_rest
        following = None
        if self.engine is not None:
            slewing = self.engine.phase not in FOLLOWING or self.engine.tracker.acquired_utc_s is None
            following = followed(self.engine, now_utc_s)
        return state_of(
            self.session,
            self._standing,
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
        """Whether fine rates are what is under way."""
        return self._under_way is not None and self._under_way.kind == "fine"

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

    def _begin(self, asked: NumberedOrder, now_utc_s: float) -> bool:
        """Begin an order; tell whether its answer is held back. Raises Fault."""
        order = asked.order
        if isinstance(order, AbortOrder):
            self._abort(now_utc_s)
            return False
        if isinstance(order, BiasOrder):
            offset(self.engine, order, now_utc_s)
            return False
        self._check(order)
        self.was_asked = True
        if isinstance(order, MoveOrder):
            return self._move(asked.number, order, now_utc_s)
        if isinstance(order, FollowOrder):
            self._follow(order, now_utc_s)
            return False
        kind, procedure = procedure_of(order, self.profile, self.console.session.fine_rate)
        if isinstance(order, SlewOrder | ParkOrder) and (self._is_slewing or self._drive is not None):
            if isinstance(order, SlewOrder):
                check_floor(order, self.session.status, self._limits, self._site.latitude_deg)
            procedure = AfterStop(procedure)
        self._undertake(kind, procedure, now_utc_s)
        assert self._under_way is not None
        if kind in HELD_KINDS or (isinstance(order, SlewOrder) and order.wait):
            self._under_way.waiting = asked.number
            return True
        return False

    def _check(self, order: Order) -> None:
        """Raise Fault where an order does not go with what is under way."""
        if self.engine is not None:
            raise Fault(Number.INVALID_OPERATION, f"the mount is {self._doing}: AbortSlew ends that")
        if self._standing.at_park(self.session):
            raise Fault(Number.PARKED, "the mount is parked, and only its own console takes it out of park")
        replaces = isinstance(order, SlewOrder | ParkOrder)
        on_with_it = isinstance(order, MoveOrder) and (self._drive is not None or not order.rate_deg_s)
        # A rate that is in force is only looked at for a while: the protocol acknowledges none.
        busy = self.console.procedure is not None and not self._is_fine
        if busy and not (replaces or on_with_it):
            raise Fault(Number.INVALID_OPERATION, f"the mount is {self._doing}: AbortSlew ends that")

    def _undertake(self, kind: str, procedure: Procedure, now_utc_s: float) -> None:
        """Begin a procedure in place of what is under way. Raises Fault."""
        former = self._under_way
        refuse(self.console.begin(procedure, now_utc_s))
        self._supersede(former)
        self._under_way = Operation(kind, procedure)
        if kind != "fine":
            self._failure = None
        self._standing.moved(kind)

    def _supersede(self, former: Operation | None) -> None:
        kind, waiting = ("", None) if former is None else (former.kind, former.waiting)
        self.answers.supersede(kind, waiting)
        self._under_way = None

    def _move(self, number: int, order: MoveOrder, now_utc_s: float) -> bool:
        """Turn an axis, or give it back; the end of a move is answered when it is seen."""
        drive = self._drive
        if drive is None:
            if order.rate_deg_s:
                self._undertake("move", Drive(order.axis, order.rate_deg_s), now_utc_s)
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
        if self._standing.at_park(self.session):
            raise Fault(Number.PARKED, "the mount is parked: its drives have no power")
        former = self._under_way
        self._reset_at_rest = self.tripped is not None
        self.console.abort(now_utc_s)
        self.was_asked = True
        self._supersede(former)
        self._standing.moved("abort")

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
        self._standing.moved("move")
        self.words.append(f"follows {engine.spec.propagator.elements.label}")

    def _leave_satellite(self) -> None:
        engine = self.engine
        assert engine is not None
        why = engine.tracker.ended_by
        if why not in {"set", "operator"}:
            self._failure = engine.message or "the satellite was lost"
        if engine.mount_stopped is False:
            self._failure = "THE MOUNT DID NOT CONFIRM THE STOP: stop it by hand"
        self.words.append(f"follows {engine.spec.propagator.elements.label} no more: {why}")
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
        """See whether what is under way has ended, and how."""
        under_way = self._under_way
        if under_way is None:
            return
        if self.console.procedure is under_way.procedure:
            self._look_at_rates(under_way)
            return
        self._under_way = None
        outcome = self.console.outcome
        if outcome is None:
            self._supersede(under_way)
            return
        self._settle(under_way, outcome)

    def _look_at_rates(self, under_way: Operation) -> None:
        """Answer for fine rates as soon as datagrams have them."""
        procedure = under_way.procedure
        if under_way.waiting is None or not (self._is_fine and isinstance(procedure, Once)):
            return
        if self.console.session.fine_rate == procedure.request:
            self.answers.done(under_way.waiting)
            under_way.waiting = None

    def _settle(self, done: Operation, outcome: Outcome) -> None:
        ended_well = outcome.state in DONE
        words = outcome.reason or f"{done.kind}: {outcome.state.value}"
        if ended_well and done.kind == "park":
            self._standing.parked(self.session)
        if ended_well and done.kind == "home":
            ended_well = self._standing.came_home(self.session)
        if not ended_well and done.kind in MOVING_KINDS | {"move"}:
            self._failure = words
            if self.console.trouble is None:
                self.words.append(f"{done.kind} failed: {words}")
        if done.waiting is not None:
            number = Number.DRIVER if outcome.refusal is None else Number.INVALID_OPERATION
            self.answers.soon(done.waiting, None if ended_well else Fault(number, words))

    def _look_for_trouble(self) -> None:
        """See whether the mount was brought to a stop that nobody asked for."""
        trouble = self.console.trouble
        if trouble is not None and trouble != self._trouble:
            self._failure = self.console.refusal or trouble
            self.words.append(f"the mount is being stopped: {self._failure}")
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
