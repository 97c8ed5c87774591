"""One procedure with one mount, from listening to its end, without I/O: what a verb on the command line does.

1. Listen, and send nothing: who hears the mount obey somebody else does not join in.
2. Send datagrams without a flag until the mount is heard, obeying nobody; then begin.
3. However it ends, datagrams go on until no flag is on its way; after trouble, until the mount is at rest.
"""

from __future__ import annotations

from enum import Enum
from typing import TYPE_CHECKING

from sattrack.control.driver import StopProcedure
from sattrack.control.manual.procedures import Once, Outcome, Procedure, RequestRefused, refused
from sattrack.mount.requests import Abort, TicketState
from sattrack.mount.xerxes.datagrams import DatagramError, decode_status
from sattrack.mount.xerxes.states import LinkState

if TYPE_CHECKING:
    from sattrack.control.manual.console import Console
    from sattrack.mount.model import Status

LISTEN_S = 0.5
LISTEN_STATUSES = 4
LOOK_S = 1.0
"""How long a look lasts from the first status on: enough to tell how evenly they come."""
NO_ANSWER_AFTER_S = 3.0
ACKS = ("abort", "sync", "pulse_guide", "slew", "move_ra", "move_dec")
NOT_ALONE = (
    "the mount acknowledges commands ({}) that were not sent from here: another program drives it, or did "
    "and was killed; end it, or stop the mount with `sattrack mount abort`, then ask again"
)
DONE = frozenset({TicketState.COMPLETE, TicketState.UNCONFIRMED})


class OperationPhase(Enum):
    """How far an operation has come."""

    LISTENING = "listening"
    CALLING = "waiting for the mount"
    RUNNING = "running"
    ENDING = "ending"
    STOPPING = "stopping"
    OVER = "over"


class ManualOperation:
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
        refusal = RequestRefused(NOT_ALONE.format(", ".join(sorted(self._others))))
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
            self._end("done", console.outcome, now_utc_s, stop=undone and not console.at_rest)
        elif self._link_gone(now_utc_s):
            words = f"no status from {console.mount_name}: nobody knows whether it obeyed"
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


class Look:
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
            self.finished = now_utc_s - self._heard_utc_s >= self._look_s
            return None
        waited_s = now_utc_s - self._started_utc_s
        self.finished = waited_s >= self._timeout_s
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
