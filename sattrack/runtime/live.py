"""The loop that feeds a mount in real time: one thread, one `select`, absolute deadlines.

A datagram is computed a little before it is due, for the instant at which it is due, and sent then:
what the computing takes, and how much that varies, is then no part of the period.
"""

from __future__ import annotations

import select
import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol

import msgspec

from sattrack.core.errors import SattrackError
from sattrack.core.realtime import Grant, undisturbed
from sattrack.mount.xerxes.session import REPEAT_AFTER_PERIODS
from sattrack.runtime.guard import Guard, Unguarded
from sattrack.runtime.outcome import Ledger
from sattrack.views.messages import Message, StopNow
from tle.errors import TleError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from sattrack.control.engine import Engine
    from sattrack.core.clock import Clock
    from sattrack.mount.xerxes.client import UdpLink
    from sattrack.recording.recorder import Sink
    from sattrack.runtime.embedded import EmbeddedMount
    from sattrack.runtime.observers import Observers
    from sattrack.runtime.screen import Screen
    from sattrack.runtime.signals import StopRequest
    from sattrack.views.run import TrackView

VIEW_EVERY_TICKS = 2
RECORD_VIEW_EVERY_TICKS = 10
LATE_ENOUGH_TO_SKIP_S = 0.5
LEAD_S = 0.002
"""How long before it is due a datagram is computed: several times as long as that takes."""


class Inbox(Protocol):
    """Where the operator's messages come from."""

    @property
    def malformed(self) -> int:
        """How many lines were none."""

    def messages(self) -> Sequence[Message]:
        """Return what has come, without waiting."""


@dataclass(slots=True)
class LiveLoop:
    """Feeds one engine from one socket until the mount is seen at rest.

    `deadline_s` (monotonic) ends the run like an operator's stop.
    """

    engine: Engine
    link: UdpLink
    clock: Clock
    sink: Sink
    screen: Screen
    stop: StopRequest
    simulated: EmbeddedMount | None = None
    inbox: Inbox | None = None
    deadline_s: float = float("inf")
    guard: Guard = field(default_factory=Unguarded)
    observers: Observers | None = None
    ledger: Ledger = field(default_factory=Ledger)
    grant: Grant | None = None
    """What the system granted for the run; None before it."""
    _shift_s: float = 0.0
    _error: Exception | None = None

    def run(self) -> float:
        """Run to the end; return the UTC instant of the end, POSIX seconds."""
        with undisturbed() as self.grant:
            period_s = self.engine.spec.profile.period_s / self.clock.speed
            due_s = time.monotonic()
            ticks = 0
            while not self.engine.finished and not self.guard.deposed:
                self._guarded(self._wait_until, due_s - LEAD_S)
                self._guarded(self._heed_guard)
                self._guarded(self._obey)
                self._guarded(self._tick, ticks, due_s)
                self._guarded(self._repeat, due_s + REPEAT_AFTER_PERIODS * period_s)
                self._guarded(self._listen)
                ticks += 1
                self._guarded(self._find_shift)
                due_s += period_s + self._shift_s
                if time.monotonic() - due_s > LATE_ENOUGH_TO_SKIP_S:
                    due_s = time.monotonic()
        self._guarded(self._heed_guard)
        if self.engine.finished and not self.guard.deposed:
            self.guard.release(self.engine.mount_stopped)
        self._guarded(self._show_end)
        self.ledger.strangers, self.ledger.unsent = self.link.strangers, self.link.unsent
        if self._error is not None and not isinstance(self._error, SattrackError | TleError):
            raise self._error
        self._gather_truth()
        return self.clock.utc_s(time.monotonic())

    def _guarded(self, part: Callable[..., None], *arguments: Any) -> None:
        """Do one part of a turn; whatever breaks in it turns the run into a stop of the mount."""
        try:
            part(*arguments)
        except Exception as error:  # noqa: BLE001 - no error is worth a mount that is left moving
            if self._error is None:
                self._error = error
                self.engine.fail(str(error))
                self.sink.failure(self.clock.utc_s(time.monotonic()), str(error))

    def _wait_until(self, due_s: float) -> None:
        """Wait for an instant, taking datagrams as they come."""
        while True:
            left_s = due_s - time.monotonic()
            readable, _, _ = select.select([self.link], [], [], max(0.0, left_s))
            if readable:
                self._take_datagrams()
            if due_s - time.monotonic() <= 0.0:
                return

    def _take_datagrams(self) -> None:
        for arrival in self.link.receive():
            arrived_utc_s = self.clock.utc_s(arrival.monotonic_s)
            self.sink.status(arrived_utc_s, arrival.data)
            self.engine.receive(arrival.data, arrived_utc_s)

    def _heed_guard(self) -> None:
        """Stop where somebody asks for it from outside, or where the guardian is lost, or has the mount."""
        if self.guard.stop_asked:
            self.stop.ask()
        if self.guard.trouble is not None:
            raise SattrackError(self.guard.trouble)

    def _obey(self) -> None:
        messages: list[Message] = list(self.inbox.messages()) if self.inbox is not None else []
        if (self.stop.asked or time.monotonic() >= self.deadline_s) and self.engine.tracker.ended_by is None:
            messages.append(StopNow())
        now_utc_s = self.clock.utc_s(time.monotonic())
        for message in messages:
            self.sink.operator(now_utc_s, message)
            self.engine.operate(message, now_utc_s)

    def _listen(self) -> None:
        """Take in a few observations, when the next datagram is longest away."""
        if self.observers is None:
            return
        for seen in self.observers.observations():
            now_utc_s = self.clock.utc_s(time.monotonic())
            self.sink.operator(now_utc_s, seen)
            self.engine.operate(seen, now_utc_s)
        malformed = 0 if self.inbox is None else self.inbox.malformed
        self.engine.malformed = self.observers.malformed + malformed
        self.engine.dropped = self.observers.dropped

    def _tick(self, ticks: int, due_s: float) -> None:
        now_utc_s = self.clock.utc_s(max(due_s, time.monotonic()))
        self.engine.session.health.strangers = self.link.strangers
        datagram = self.engine.tick(now_utc_s)
        left_s = due_s - time.monotonic()
        if left_s > 0.0:
            time.sleep(left_s)
        if not self.guard.beat(datagram):
            return
        self.link.send(datagram)
        self.ledger.note_sent(time.monotonic() * self.clock.speed)
        self.sink.command(now_utc_s, datagram)
        if ticks % VIEW_EVERY_TICKS == 0 and not self.engine.failed:
            view = self._with_trouble(self.engine.view(now_utc_s))
            self.screen.show(view)
            if ticks % RECORD_VIEW_EVERY_TICKS == 0:
                self.sink.view(now_utc_s, view)
        self._gather_truth()

    def _with_trouble(self, view: TrackView) -> TrackView:
        """Add what is wrong with the recording, or on the way to the mount, to what is shown."""
        troubles = tuple(words for words in (self.sink.trouble, self.link.trouble) if words is not None)
        return msgspec.structs.replace(view, warnings=(*view.warnings, *troubles)) if troubles else view

    def _repeat(self, due_s: float) -> None:
        """Send the last datagram once more where that is wanted; it is no part of the period."""
        self._wait_until(due_s)
        if self.stop.asked or self.guard.deposed:
            return
        datagram = self.engine.repeat()
        if datagram is not None:
            self.sink.repeat(self.clock.utc_s(time.monotonic()), datagram)
            self.link.send(datagram)

    def _find_shift(self) -> None:
        now_utc_s = self.clock.utc_s(time.monotonic())
        self._shift_s = self.engine.send_shift_s(now_utc_s) / self.clock.speed

    def _show_end(self) -> None:
        if not self.engine.failed:
            self.screen.show(self.engine.view(self.clock.utc_s(time.monotonic())))

    def _gather_truth(self) -> None:
        if self.simulated is None:
            return
        for truth in self.simulated.truths():
            self.ledger.note_truth(self.engine, truth.counter, truth.utc_s, truth.ra_deg, truth.dec_deg)
