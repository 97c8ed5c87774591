"""The mount's side of an Alpaca telescope, without I/O: orders and datagrams in, datagrams and answers out.

A console drives the mount, as by hand; while a satellite is followed, an engine does, as in `track`. Both
pass `safety`, and hand over what they know of the cables' winding. Each order begins a procedure of the
console. Where clients of rotctld are served too, a path driver keeps the mount at their positions.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from sattrack.control.console import Console
from sattrack.control.driver import FOUND_MOVING, StopProcedure
from sattrack.control.procedures import DONE, Once, Outcome
from sattrack.control.tracker import FOLLOWING
from sattrack.core.angles import altitude_deg
from sattrack.mount.model import Hold, Slew
from sattrack.mount.requests import (
    Abort,
    FineRate,
    Park,
    PulseGuide,
)
from sattrack.mount.xerxes.link import LinkState
from sattrack.servers.alpaca.procedures import AfterStop, Drive, GuidePulses, procedure_of, refuse
from sattrack.servers.alpaca.protocol import (
    BiasOrder,
    Fault,
    FollowOrder,
    MoveOrder,
    Number,
    TrackOrder,
)
from sattrack.servers.alpaca.shared_rotator import SharedRotator
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
    from sattrack.control.procedures import Procedure
    from sattrack.mount.model import MountProfile, Status
    from sattrack.mount.xerxes.session import Session
    from sattrack.safety import Safety, SafetyLimits
    from sattrack.servers.alpaca.protocol import NumberedOrder, Order, TelescopeState
    from sattrack.servers.antenna.led_mount import PathDriver
    from sattrack.servers.antenna.trajectory import SiteSky
    from sattrack.servers.rotctld.rotator import Rotator
    from tle.site import Site

MOVING_KINDS = frozenset({"slew", "park", "home"})
HELD_KINDS = frozenset({"sync", "fine", "tracking"})
"""Answered at their end, after a few datagrams."""


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
        self.shared: SharedRotator | None = None
        """The rotator that clients of rotctld see, where they are served too."""
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

    def share(self, sky: SiteSky) -> Rotator:
        """Return a rotator for clients of rotctld, of the same mount."""
        self.shared = SharedRotator(sky, self.profile, self._limits, self._why_not_idle)
        return self.shared.rotator

    @property
    def _driver(self) -> Console | Engine | PathDriver:
        """What feeds the mount now."""
        return self._path or self.engine or self.console

    @property
    def session(self) -> Session:
        """The session with the mount that is in force."""
        return self._driver.session

    @property
    def safety(self) -> Safety:
        """The gate of the motions."""
        return self._driver.safety

    @property
    def tripped(self) -> str | None:
        """Name of the interlock that stopped the mount."""
        return self.safety.tripped

    @property
    def link_up(self) -> bool:
        """Whether the mount is heard."""
        return self.link in {LinkState.UP, LinkState.STALE}

    @property
    def turns_known_s(self) -> float:
        """For how long the mount may go on unheard, its axes' turns still known."""
        return self._driver.turns_known_s

    @property
    def on_trajectory(self) -> bool:
        """Whether a satellite is followed, and no limit keeps the mount off it."""
        return self.engine is not None and self.engine.safety.holding is None

    def receive(self, data: bytes, arrival_utc_s: float) -> None:
        """Take one datagram from the mount."""
        self._heard = (data, arrival_utc_s)
        if self.shared is not None:
            self.shared.receive(data, arrival_utc_s)
        if self.engine is not None:
            receive_or_stop(self.engine, data, arrival_utc_s)
        elif self._path is None:
            self.console.receive(data, arrival_utc_s)
        self._mount_state.see(self.session)

    def tick(self, now_utc_s: float) -> bytes:
        """Return the datagram to send now; call once a period."""
        self._heed_rotator(now_utc_s)
        if self.engine is not None:
            datagram = tick_or_stop(self.engine, now_utc_s)
            if self.engine.finished:
                self._leave_satellite()
        elif self._path is not None:
            datagram = self._path.tick(now_utc_s)
            self._leave_path()
        else:
            if self.console.found_moving and not self.console.stopping:
                self.log_lines.append(FOUND_MOVING)
                self.console.abort(now_utc_s)
            datagram = self.console.tick(now_utc_s)
            self._look_at_procedure()
            self._look_for_trouble()
            self._make_ready()
        self.link = self.session.link_state(now_utc_s)
        if self.shared is not None:
            self.shared.link_up, self.shared.tripped = self.link_up, self.tripped
        self.answers.tick(self._drive is None and self.console.at_rest)
        self._watch_end(now_utc_s)
        return datagram

    def repeat(self) -> bytes | None:
        """Return what to send once more before the next datagram, None for nothing."""
        driver = self._driver
        return None if isinstance(driver, Console) else driver.repeat()

    def send_shift_s(self, now_utc_s: float) -> float:
        """Return the delay of the next `tick` beyond one period from now, seconds."""
        driver = self._driver
        return 0.0 if isinstance(driver, Console) else driver.send_shift_s(now_utc_s)

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
        elif self._path is not None:
            self._path.end(now_utc_s)
        elif moving:
            # The console looks at it with each datagram, and does not let go of the mount.
            self.console.stop = self._ending
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
        elif self._path is not None:
            slewing = not self._path.on_trajectory
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
            looks_at_deg=self._looks_at_deg,
            kept=self._kept,
            turning=() if self._drive is None else self._drive.turning,
        )

    @property
    def _kept(self) -> bool | None:
        """Whether the mount is kept on the sky, or led to it; None where it tracks by itself.

        At a position of rotctld's it stands.
        """
        if self._path is not None:
            return False
        if self.profile.geometry is None:
            return None
        return self.engine is not None or self.console.lead is not None

    @property
    def _looks_at_deg(self) -> tuple[float, float] | None:
        aim, sample = self.console.sky_aim, self._driver.sample
        return None if aim is None or sample is None else aim.looks_at_deg(sample)

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
        if self.profile.geometry is not None:
            # Rates that lead it, and keep it on the sky, are a slew to the mount itself.
            return stopping or (self.console.lead is not None and not self.console.lead.arrived)
        return stopping or (self._drive is None and status is not None and status.slewing)

    @property
    def _doing(self) -> str:
        if self.engine is not None:
            return f"following {self.engine.spec.propagator.elements.label} (TrackSatellite)"
        if self._path is not None:
            return "kept at positions of rotctld's clients"
        if self.console.stopping:
            return "stopping"
        return "idle" if self.console.procedure is None else self.console.procedure.doing

    def _begin(self, numbered: NumberedOrder, now_utc_s: float) -> bool:
        """Begin an order; return whether its answer comes later. Raises Fault."""
        order = numbered.order
        if isinstance(order, Abort):
            self._stops_others()
            self._abort(now_utc_s)
            return False
        if isinstance(order, BiasOrder):
            offset(self.engine, order, now_utc_s)
            return False
        if isinstance(order, PulseGuide) and isinstance(self.console.procedure, GuidePulses):
            self.console.procedure.hold(order)
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
        if self._replaces(order) and (self._is_slewing or self._drive is not None):
            if isinstance(order, Slew):
                check_floor(order, self.session.status, self._limits, self._site.latitude_deg)
            procedure = AfterStop(procedure)
        operation = self._begin_operation(kind, procedure, now_utc_s)
        is_held = kind in HELD_KINDS or numbered.waits
        if is_held:
            operation.waiting = numbered.number
        return is_held

    def _check(self, order: Order) -> None:
        """Raise Fault where an order conflicts with the operation under way."""
        if self.engine is not None or self._path is not None:
            raise Fault(Number.INVALID_OPERATION, f"the mount is {self._doing}: AbortSlew ends that")
        if self._mount_state.at_park(self.session):
            raise Fault(Number.PARKED, "the mount is parked, and only its own console takes it out of park")
        replaces = self._replaces(order)
        on_with_it = isinstance(order, MoveOrder) and (self._drive is not None or not order.rate_deg_s)
        # A rate that is in force is only looked at for a while: the protocol acknowledges none.
        busy = self.console.procedure is not None and not self._is_fine
        if busy and not (replaces or on_with_it):
            raise Fault(Number.INVALID_OPERATION, f"the mount is {self._doing}: AbortSlew ends that")

    def _replaces(self, order: Order) -> bool:
        """Tell whether an order takes the place of the operation under way, once the mount rests.

        Tracking is taken up after a MoveAxis that ends, too.
        """
        ends = self._drive is not None and not self._drive.moves
        return isinstance(order, Slew | Park) or (ends and isinstance(order, TrackOrder) and order.on)

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
                stands = self.profile.geometry is not None
                stops = not stands and not self._mount_state.tracking(self.session)
                drive = Drive(order.axis, order.rate_deg_s, stands=stands, stops=stops)
                self._begin_operation("move", drive, now_utc_s)
            return False
        refuse(drive.change(self.console, order.axis, order.rate_deg_s, now_utc_s))
        if drive.moves:
            return False
        self.answers.at_rest(number)
        return True

    def _abort(self, now_utc_s: float, resets: bool = True) -> None:
        """Stop everything; `resets` a mount that safety has stopped, too, once it is at rest."""
        self._failure = None
        if self.engine is not None:
            self._reset_at_rest |= resets and self.tripped is not None
            self.engine.operate(StopNow(), now_utc_s)
            return
        if self.shared is not None and self._path is not None:
            rotator = self.shared.rotator
            rotator.stop() if self.tripped is None else rotator.reset()
            return
        if self._mount_state.at_park(self.session):
            raise Fault(Number.PARKED, "the mount is parked: its drives have no power")
        former = self._operation
        self._reset_at_rest |= resets and self.tripped is not None
        self.console.abort(now_utc_s)
        self.had_orders = True
        self._supersede(former)
        self._mount_state.moved("abort")

    def _stops_others(self) -> None:
        """Have a stop hold for clients of rotctld that go on sending positions."""
        if self.shared is not None:
            self.shared.rotator.stops_others()

    def _why_not_idle(self) -> str | None:
        """Return why nothing of its own can move the mount now, as text; None where it can."""
        if self._ending is not None:
            return "the server is ending"
        if self._path is not None:
            return None
        session, lead = self.console.session, self.console.lead
        if lead is not None:
            # The rates that keep a mount with a geometry on the sky are nobody's motion.
            idle = lead.arrived
        else:
            idle = isinstance(session.wanted, Hold) and session.move_over and not session.busy
            idle = idle and session.status is not None and not session.status.slewing
        # What a procedure asked of the mount may be over before its end is seen; fine rates are watched only.
        under_way = self.console.procedure is not None and not self._is_fine
        if self.engine is not None or under_way or not idle:
            return f"the mount is {self._doing}: wait until that is over"
        if self._mount_state.at_park(session):
            return "the mount is parked"
        return None if self.tripped is None else "safety has stopped the mount: AbortSlew makes it ready"

    def _heed_rotator(self, now_utc_s: float) -> None:
        """Do what clients of rotctld have asked for since the last datagram."""
        if self.shared is None:
            return
        rotator, moved = self.shared.rotator, self._path is not None
        stops, rotator.stop_asked = rotator.stop_asked, False
        if stops and not moved:
            resets, rotator.reset_asked = rotator.reset_asked, False
            if not self._mount_state.at_park(self.session):
                self._abort(now_utc_s, resets)
        elif self.shared.wants_mount:
            if (why := self._why_not_idle()) is not None:
                # Something else has begun since it was asked.
                rotator.stop()
                rotator.stop_asked = False
                self.log_lines.append(f"a position of rotctld's is dropped: {why}")
                return
            self.had_orders, self._failure = True, None
            self.shared.begin(self.console.safety, self._heard)
            self._mount_state.moved("follow")

    def _leave_path(self) -> None:
        """Go on by the console, once the mount of rotctld's clients was stopped and is at rest."""
        assert self.shared is not None
        assert self._path is not None
        if self._ending is not None:
            self.finished, self.mount_stopped = self._path.finished, self._path.mount_stopped
        elif (driver := self.shared.leave()) is not None:
            self._go_on_by_console(driver.safety)
            self._mount_state.moved("abort")

    @property
    def _path(self) -> PathDriver | None:
        """What keeps the mount at the positions of rotctld's clients; None while nothing does."""
        return None if self.shared is None else self.shared.driver

    def _follow(self, order: FollowOrder, now_utc_s: float) -> None:
        if (why := self._why_not_idle()) is not None:
            raise Fault(Number.INVALID_OPERATION, why)
        try:
            engine = self._make_engine(order.facts, now_utc_s)
        except ValueError as error:
            raise Fault(Number.INVALID_VALUE, str(error)) from error
        engine.safety.follow_on(self.console.safety)
        if self._heard is not None:
            receive_or_stop(engine, *self._heard)
        self.engine, self._failure = engine, None
        self._mount_state.moved("follow")
        self.log_lines.append(f"follows {engine.spec.propagator.elements.label}")

    def _leave_satellite(self) -> None:
        engine = self.engine
        assert engine is not None
        why = engine.tracker.ended_by
        if why not in {"set", "operator"}:
            self._stops_others()
            self._failure = engine.message or "the satellite was lost"
        if engine.mount_stopped is False:
            self._failure = "THE MOUNT DID NOT CONFIRM THE STOP: stop it by hand"
        self.log_lines.append(f"follows {engine.spec.propagator.elements.label} no more: {why}")
        self.engine = None
        self._go_on_by_console(engine.safety)
        if self._ending is not None:
            # The engine has seen its stop through.
            self.mount_stopped = engine.mount_stopped
            self._ending.needed = False

    def _go_on_by_console(self, former: Safety) -> None:
        self.console = self._new_console()
        self.console.safety.follow_on(former)
        self.console.safety.tripped = former.tripped
        if self._heard is not None:
            self.console.receive(*self._heard)

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
            self._stops_others()
        self._trouble = trouble

    def _make_ready(self) -> None:
        """After an AbortSlew, let a mount move again that safety has stopped, once it is at rest."""
        if self._reset_at_rest and self.console.procedure is None and self.console.at_rest:
            self._reset_at_rest = self.console.reset() is not None

    def _watch_end(self, now_utc_s: float) -> None:
        if self._ending is None or self.finished or self.engine is not None or self._path is not None:
            return
        if self.console.stop is not self._ending:
            self._ending.look(self.console.session, now_utc_s)
        self.finished = self._ending.finished
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
