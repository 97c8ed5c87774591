"""A console in somebody's hands: one operation from begin to end, a look, an operator's time; and its view.

Pure: datagrams, orders and instants in, datagrams and views out.
"""

from __future__ import annotations

import math
from enum import Enum
from typing import TYPE_CHECKING

import msgspec

from sattrack.control.driver import NO_ANSWER_AFTER_S, StopProcedure, site_warnings
from sattrack.control.procedures import DONE, Once, Outcome, RequestRefused, refused, request_text
from sattrack.mount.model import DTICS_S_PER_DEG_S, Hold, MoveAxes, Slew, Stop
from sattrack.mount.requests import Abort, FindHome, Park, Sync, TicketState
from sattrack.mount.xerxes.datagrams import DatagramError, decode_status
from sattrack.mount.xerxes.link import LinkState
from sattrack.views.messages import ConsoleMessage, Jog, Leave, Reset
from sattrack.views.run import AskedView, ConsoleView

if TYPE_CHECKING:
    from sattrack.control.console import Console, RequestEntry
    from sattrack.control.procedures import Procedure
    from sattrack.mount.model import LinkView, Status
    from sattrack.safety import Safety


LISTEN_S = 0.5
LISTEN_STATUSES = 4
LOOK_S = 1.0
"""How long a look lasts from the first status on: enough to tell how evenly they come."""
ACKS = ("abort", "sync", "pulse_guide", "slew", "move_ra", "move_dec")
COMMANDED_BY_OTHERS = (
    "the mount acknowledges commands ({}) that were not sent from here: another program drives it, or did "
    "and was killed; end it, or stop the mount with `sattrack mount abort`, then ask again"
)


class OperationPhase(Enum):
    """How far an operation has come."""

    LISTENING = "listening"
    CALLING = "waiting for the mount"
    RUNNING = "running"
    ENDING = "ending"
    STOPPING = "stopping"
    OVER = "over"


class AtConsole:
    """What is done at a console: safety, and for how long the mount may go on unheard, are the console's."""

    console: Console

    @property
    def safety(self) -> Safety:
        """What judges its motions."""
        return self.console.safety

    @property
    def turns_known_s(self) -> float:
        """For how long the mount may go on unheard, as its console knows."""
        return self.console.turns_known_s


class ManualOperation(AtConsole):
    """One procedure; call `tick` once a period until `finished`.

    `timeout_s` bounds the procedure; a mount that is still under way then is stopped.
    """

    def __init__(
        self, console: Console, procedure: Procedure, started_utc_s: float, timeout_s: float | None = None
    ) -> None:
        self.console, self.profile = console, console.profile
        self.phase = OperationPhase.LISTENING
        self.ended_by: str | None = None
        """"done", "refused", "operator", "timeout", "link", "limit:NAME" or "error", once it is decided."""
        self.outcome: Outcome | None = None
        self.begun = False
        """Whether anything was asked of the mount."""
        self._procedure = procedure
        self._timeout_s = timeout_s
        self._started_utc_s = started_utc_s
        self._since_utc_s = started_utc_s
        self._heard = 0
        self._others: set[str] = set()
        self.mount_stopped: bool | None = None
        """Whether the stop that ended it was seen through; None where there was none, or nobody to see it."""

    @property
    def finished(self) -> bool:
        """Whether there is nothing left to do."""
        return self.phase is OperationPhase.OVER

    @property
    def doing(self) -> str:
        """What goes on, in words."""
        if self.phase is OperationPhase.RUNNING:
            return self._procedure.doing
        return "stopping the mount" if self.phase is OperationPhase.STOPPING else self.phase.value

    def receive(self, data: bytes, arrival_utc_s: float) -> None:
        """Take one datagram from the mount."""
        received = self.console.session.health.received
        self.console.receive(data, arrival_utc_s)
        if self.console.session.health.received == received:
            return
        self._heard += 1
        if self.phase in {OperationPhase.LISTENING, OperationPhase.CALLING}:
            self._others.update(acknowledged(data))

    def interrupt(self, now_utc_s: float) -> None:
        """Stop the mount if anything was asked of it, and end."""
        if self.ended_by is None:
            self._end(
                "operator", Outcome(TicketState.FAILED, False, "interrupted"), now_utc_s, stop=self.begun
            )

    def fail(self, words: str, now_utc_s: float) -> None:
        """Stop the mount if anything was asked of it: something here is not to be relied on."""
        self.console.fail(words)
        self._end("error", Outcome(TicketState.FAILED, False, words), now_utc_s, stop=self.begun)

    def tick(self, now_utc_s: float) -> bytes | None:
        """Return the datagram to send now, None while it only listens; call once a period."""
        if self.phase is OperationPhase.LISTENING and not self._listened(now_utc_s):
            return None
        if self.phase is OperationPhase.OVER:
            return None
        if self.phase is OperationPhase.CALLING:
            self._call(now_utc_s)
        if self.finished:
            return None
        datagram = self.console.tick(now_utc_s)
        if self.phase is OperationPhase.RUNNING:
            self._watch(now_utc_s)
        elif self.phase is OperationPhase.ENDING:
            self._watch_end()
        elif self.phase is OperationPhase.STOPPING:
            self._watch_stop()
        return datagram

    def _listened(self, now_utc_s: float) -> bool:
        """Tell whether it is time to send; a stop never waits."""
        if self._stops:
            self._begin(now_utc_s)
            return True
        if self._leave_to_others(now_utc_s):
            return False
        if self._heard < LISTEN_STATUSES and now_utc_s - self._started_utc_s < LISTEN_S:
            return False
        self.phase = OperationPhase.CALLING
        return True

    def _leave_to_others(self, now_utc_s: float) -> bool:
        """End where the mount acknowledges commands, of which none was ours so far; tell whether it does."""
        if not self._others:
            return False
        refusal = RequestRefused(COMMANDED_BY_OTHERS.format(", ".join(sorted(self._others))))
        self._end("refused", refused(refusal), now_utc_s, stop=False)
        return True

    @property
    def _stops(self) -> bool:
        return isinstance(self._procedure, Once) and isinstance(self._procedure.request, Abort)

    def _call(self, now_utc_s: float) -> None:
        if self._leave_to_others(now_utc_s):
            return
        if self._heard >= LISTEN_STATUSES:
            self._begin(now_utc_s)
        elif now_utc_s - self._started_utc_s > NO_ANSWER_AFTER_S:
            words = f"no status from {self.console.mount_name} within {NO_ANSWER_AFTER_S:g} s"
            self._end("link", Outcome(TicketState.FAILED, False, words), now_utc_s, stop=False)

    def _begin(self, now_utc_s: float) -> None:
        self._since_utc_s, self.phase = now_utc_s, OperationPhase.RUNNING
        refusal = self.console.begin(self._procedure, now_utc_s)
        if refusal is None:
            self.begun = True
        else:
            self._end("refused", refused(refusal), now_utc_s, stop=False)

    def _watch(self, now_utc_s: float) -> None:
        console = self.console
        if console.trouble is not None:
            self._end(console.trouble, console.outcome, now_utc_s, stop=True)
        elif console.outcome is not None:
            undone = console.outcome.state not in DONE and not self._stops
            stop = console.lead is not None or (undone and not console.at_rest)
            self._end("done", console.outcome, now_utc_s, stop=stop)
        elif self._link_gone(now_utc_s):
            words = f"no status from {console.mount_name}: it is unknown whether it obeyed"
            self._end("link", Outcome(TicketState.FAILED, False, words), now_utc_s, stop=True)
        elif self._timeout_s is not None and now_utc_s - self._since_utc_s > self._timeout_s:
            words = f"not done within {self._timeout_s:g} s"
            self._end("timeout", Outcome(TicketState.TIMED_OUT, False, words), now_utc_s, stop=True)

    def _link_gone(self, now_utc_s: float) -> bool:
        state = self.console.session.link_state(now_utc_s)
        never = state is LinkState.SILENT and now_utc_s - self._started_utc_s > NO_ANSWER_AFTER_S
        return never or state is LinkState.LOST

    def _end(self, why: str, outcome: Outcome | None, now_utc_s: float, stop: bool) -> None:
        self.ended_by, self.outcome, self._since_utc_s = why, outcome, now_utc_s
        self.console.stop = StopProcedure(now_utc_s, needed=stop)
        if stop:
            self.phase = OperationPhase.STOPPING
            if not self.console.stopping:
                self.console.abort(now_utc_s)
        else:
            self.phase = OperationPhase.ENDING if self.begun else OperationPhase.OVER

    def _watch_end(self) -> None:
        if self.console.finished and not self.console.session.busy:
            self.phase = OperationPhase.OVER
            if self._stops:
                self.mount_stopped = self.outcome is not None and self.outcome.state is TicketState.COMPLETE

    def _watch_stop(self) -> None:
        if self.console.finished:
            self.mount_stopped = self.console.mount_stopped
            self.phase = OperationPhase.OVER


class Look(AtConsole):
    """One look at a mount, without a word to it: `tick` gives datagrams only where it is to `knock`.

    A simulated mount tells its status to whoever sends to it; then datagrams without a flag are sent, once
    LISTEN_S have passed in silence.
    """

    def __init__(
        self, console: Console, started_utc_s: float, timeout_s: float, knock: bool, look_s: float = LOOK_S
    ) -> None:
        self.console, self.profile = console, console.profile
        self.finished = False
        self.mount_stopped: bool | None = None
        """None: nothing is ever asked of the mount."""
        self.doing = "listening"
        self._started_utc_s, self._timeout_s, self._look_s = started_utc_s, timeout_s, look_s
        self._knock = knock
        self._heard_utc_s: float | None = None

    def receive(self, data: bytes, arrival_utc_s: float) -> None:
        """Take one datagram from the mount."""
        self.console.receive(data, arrival_utc_s)
        if self._heard_utc_s is None and self.console.sample is not None:
            self._heard_utc_s = arrival_utc_s

    def tick(self, now_utc_s: float) -> bytes | None:
        """Return the datagram to send now, if any; call once a period."""
        if self._heard_utc_s is not None:
            self.finished = self.finished or now_utc_s - self._heard_utc_s >= self._look_s
            return None
        waited_s = now_utc_s - self._started_utc_s
        self.finished = self.finished or waited_s >= self._timeout_s
        return self.console.tick(now_utc_s) if self._knock and waited_s >= LISTEN_S else None

    def interrupt(self, now_utc_s: float) -> None:
        """End the look; nothing was asked of the mount."""
        del now_utc_s
        self.finished = True

    def fail(self, words: str, now_utc_s: float) -> None:
        """End the look."""
        del words
        self.interrupt(now_utc_s)


def acknowledged(data: bytes) -> set[str]:
    """Return the names of the commands that a status acknowledges; none where it is no status."""
    try:
        status: Status = decode_status(data)
    except DatagramError:
        return set()
    return {name.replace("_", " ") for name in ACKS if getattr(status, f"ack_{name}")}


OWNED = "looking on; SPACE has the mount's owner stop it and end: {}"
NOT_ALONE = "another program drives this mount: nothing is sent from here, unless you stop the mount"


class ConsoleSession(AtConsole):
    """One operator's time with one mount; call `tick` once a period until `finished`.

    Where it hears the mount obey somebody else, and nothing was asked of it from here, it keeps silent until
    it must stop the mount.
    With `owner`, whoever owns the mount in words, the operator looks on: nothing is sent, and a stop is only
    noted in `stop_wanted`.
    """

    def __init__(self, console: Console, started_utc_s: float, owner: str | None = None) -> None:
        self.console, self.profile = console, console.profile
        self.finished = False
        self.stop_wanted = False
        """Whether one who looks on wants the owner to stop the mount."""
        self._owner = owner
        self._started_utc_s = started_utc_s
        self._asked = False
        """Whether the operator has asked for anything."""
        self._heard = 0
        self._others: set[str] = set()

    @property
    def leaving(self) -> bool:
        """Whether the operator has left."""
        return self.console.stop is not None

    @property
    def mount_stopped(self) -> bool | None:
        """Whether the stop at the end was seen through; None where none was needed."""
        return self.console.mount_stopped

    def receive(self, data: bytes, arrival_utc_s: float) -> None:
        """Take one datagram from the mount."""
        received = self.console.session.health.received
        self.console.receive(data, arrival_utc_s)
        if not self._asked and self.console.session.health.received > received:
            self._heard += 1
            self._others |= acknowledged(data)

    def obey(self, order: ConsoleMessage, now_utc_s: float) -> None:
        """Do what the operator says; why not, where it is refused, stands in the view."""
        console = self.console
        if isinstance(order, Leave):
            self.interrupt(now_utc_s)
            return
        if self.leaving:
            return
        if self._owner is not None:
            self.stop_wanted = self.stop_wanted or isinstance(order, Abort)
            if not isinstance(order, Abort):
                console.refusal = "this mount has another owner"
            return
        if self._others and not self._asked and not isinstance(order, Abort):
            # A key that is touched by accident must not mix with what somebody else does.
            console.refusal = "another program drives this mount"
            return
        self._asked = True
        match order:
            case Abort():
                console.abort(now_utc_s)
            case Jog():
                console.jog(order.ra_rate_deg_s, order.dec_rate_deg_s, now_utc_s)
            case Slew() | Sync() | Park():
                console.request(order, now_utc_s)
            case FindHome():
                # Nobody has looked whether the way is free of the Sun.
                console.request(FindHome(), now_utc_s)
            case Reset():
                console.reset()

    def interrupt(self, now_utc_s: float) -> None:
        """Leave: stop what was begun from here, and end."""
        if self.leaving:
            return
        moving = self._owner is None and (self.console.moving or self.console.stopping)
        self.console.stop = StopProcedure(now_utc_s, needed=moving)
        if moving:
            self.console.abort(now_utc_s)

    def fail(self, words: str, now_utc_s: float) -> None:
        """Stop the mount and leave: something here is not to be relied on."""
        stop = self.console.stop
        begun_utc_s = now_utc_s if stop is None else stop.begun_utc_s
        self.console.stop = StopProcedure(begun_utc_s, needed=self._asked)
        self.console.fail(words)

    def tick(self, now_utc_s: float) -> bytes | None:
        """Return the datagram to send now, None while there is nothing to send; call once a period."""
        if self._owner is not None:
            self.finished = self.leaving
            return None
        if not self._asked:
            listened = self._heard >= LISTEN_STATUSES or now_utc_s - self._started_utc_s >= LISTEN_S
            if self._others or not listened:
                self.finished = self.leaving
                return None
        datagram = self.console.tick(now_utc_s)
        self.finished = self.console.finished
        return datagram

    def view(self, now_utc_s: float) -> ConsoleView:
        """Return what the operator is to see."""
        view = view_of(self.console, now_utc_s)
        if self._owner is not None:
            return msgspec.structs.replace(view, warnings=(OWNED.format(self._owner), *view.warnings))
        if self._others and not self._asked:
            return msgspec.structs.replace(view, warnings=(NOT_ALONE, *view.warnings))
        return view


CLOCK_OFF_S = 2.0
STOPS_WITHIN_S = 1.0
"""A stop that has not been seen through by then is worth a word."""
LONGEST_WORDS = 160
"""A view has to fit into what a pipe takes as a whole."""
_MOTIONS = {Hold: "none", Slew: "slew", MoveAxes: "move", Stop: "stop"}


def view_of(console: Console, now_utc_s: float) -> ConsoleView:
    """Return what anyone who looks at a console may see, as of an instant."""
    sample, wanted = console.session.sample, console.session.wanted
    rates = wanted if isinstance(wanted, MoveAxes) else MoveAxes(0.0, 0.0)
    status = console.session.status
    guide = None if status is None else status.ra_guide_rate_dtics_s
    hour_angle = None if sample is None else math.remainder(sample.sidereal_h * 15.0 - sample.ra_deg, 360.0)
    return ConsoleView(
        utc_s=now_utc_s,
        mount=console.mount_name,
        profile=console.profile.name,
        move_axis=console.profile.move_axis,
        doing=_doing(console),
        motion=_MOTIONS[type(wanted)],
        at_rest=console.at_rest,
        status=status,
        readings=msgspec.structs.replace(console.session.readings, tracking=console.tracking_reading),
        hour_angle_deg=hour_angle,
        looks_at_deg=console.looks_at_deg,
        clock_offset_s=console.clock_offset_s,
        ra_rate_deg_s=rates.ra_rate_deg_s,
        dec_rate_deg_s=rates.dec_rate_deg_s,
        max_ra_rate_deg_s=console.profile.ra.max_rate_deg_s,
        max_dec_rate_deg_s=console.profile.dec.max_rate_deg_s,
        guide_rate_deg_s=None if guide is None else guide / DTICS_S_PER_DEG_S,
        floor_altitude_deg=console.limits.floor_altitude_deg,
        can_park=console.profile.park is not None,
        link=_link_view(console, now_utc_s),
        stranger_hosts=console.stranger_hosts,
        asked=tuple(_asked_view(asked) for asked in console.asked),
        refusal=_cut(console.refusal),
        tripped=console.safety.tripped,
        warnings=tuple(words[:LONGEST_WORDS] for words in _warnings(console, now_utc_s)),
    )


def _doing(console: Console) -> str:
    if console.stopping:
        return "stopping"
    if console.procedure is not None:
        return console.procedure.doing
    if console.lead is not None:
        return "keeping the telescope on the sky"
    return "jogging" if console.jogs else "idle"


def _link_view(console: Console, now_utc_s: float) -> LinkView:
    health = console.session.health
    return health.view(console.session.link_state(now_utc_s), health.age_s(now_utc_s))


def _warnings(console: Console, now_utc_s: float) -> list[str]:
    warnings = []
    if console.link_state is LinkState.LOST:
        warnings.append(f"{console.mount_name} is silent: check its power and the cable")
    if console.session.intruder is not None:
        warnings.append(console.session.intruder)
    warnings.extend(console.session.ignored_fields)
    if console.limit_reached is not None:
        warnings.append(console.limit_reached)
    since_utc_s = console.stopping_since_utc_s
    overdue = since_utc_s is not None and now_utc_s - since_utc_s > STOPS_WITHIN_S
    if overdue and not console.session.stopped:
        warnings.append("the stop is not confirmed yet: it is being sent again and again")
    if console.way_trouble is not None:
        warnings.append(console.way_trouble)
    warnings += site_warnings(console.session.status, console.site) + _reading_warnings(console)
    offset_s = console.clock_offset_s
    if offset_s is not None and abs(offset_s) > CLOCK_OFF_S:
        words = f"the mount's clock is {abs(offset_s):.1f} s {'ahead' if offset_s > 0.0 else 'behind'}"
        warnings.append(f"{words}: its hour angles, and so its limits, are off by it")
    if console.stranger_hosts:
        hosts = ", ".join(console.stranger_hosts)
        warnings.append(f"datagrams from {hosts} were dropped: they are not from the mount")
    return warnings


def _reading_warnings(console: Console) -> list[str]:
    seen = console.session.readings
    return [
        f"the profile has {name} as {said}, the mount sends {getattr(seen, name)}"
        for name, said in console.profile.readings.items()
        if getattr(seen, name) not in (None, said)
    ]


def _asked_view(asked: RequestEntry) -> AskedView:
    ticket = asked.ticket
    return AskedView(
        number=asked.number,
        what=request_text(ticket.request),
        state=ticket.state.value,
        acknowledged=ticket.was_acknowledged,
        settled=ticket.settled,
        reason=_cut(ticket.reason),
        utc_s=asked.utc_s,
    )


def _cut(words: str | None) -> str | None:
    return None if words is None else words[:LONGEST_WORDS]
