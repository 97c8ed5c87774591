"""The loop of a run: an engine fed in real time, recorded and shown while it goes on."""

from __future__ import annotations

import queue
import threading
import time
from collections import deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

import msgspec

from sattrack.core.errors import SattrackError
from sattrack.runtime.loop import RealtimeLoop
from sattrack.runtime.outcome import RunStatistics
from sattrack.views.messages import Message, StopNow
from tle.errors import TleError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from sattrack.control.engine import Engine
    from sattrack.recording.recorder import Sink
    from sattrack.runtime.observers import Observers
    from sattrack.views.run import TrackView

LAST_VIEW_WITHIN_S = 1.0


class Screen:
    """Hands the newest view to `draw` as often as that is ready for one; what it misses is gone.

    A terminal that does not drain blocks the thread that writes to it and nothing else. What `draw` raises is
    raised by the next call of `show`. `show` takes no lock that the thread may hold.
    """

    def __init__(self, draw: Callable[[TrackView], None]) -> None:
        self._draw = draw
        self._newest: deque[TrackView] = deque(maxlen=1)
        self._news: queue.SimpleQueue[bool] = queue.SimpleQueue()
        """True where there is a view, False where there will be no more."""
        self._error: Exception | None = None
        self._thread = threading.Thread(target=self._work, name="screen", daemon=True)
        self._thread.start()

    def show(self, view: TrackView) -> None:
        """Take a view, without waiting."""
        if self._error is not None:
            raise self._error
        self._newest.append(view)
        if self._news.empty():
            self._news.put(True)

    def close(self) -> None:
        """Have the last view drawn, if that does not take long."""
        self._news.put(False)
        self._thread.join(LAST_VIEW_WITHIN_S)

    def _work(self) -> None:
        more = True
        while more:
            more = self._news.get()
            try:
                while self._newest:
                    self._draw(self._newest.popleft())
            except Exception as error:  # noqa: BLE001 - it is for the loop to decide what that means
                self._error = error
                return


VIEW_EVERY_TICKS = 2
RECORD_VIEW_EVERY_TICKS = 10


class Inbox(Protocol):
    """Where the operator's messages come from."""

    @property
    def malformed(self) -> int:
        """How many lines were none."""

    def messages(self) -> Sequence[Message]:
        """Return what has come, without waiting."""


@dataclass(slots=True)
class LiveLoop(RealtimeLoop):
    """Feeds one engine until the mount is seen at rest.

    `deadline_s` (monotonic) ends the run like an operator's stop.
    """

    reported = (SattrackError, TleError)

    driver: Engine
    sink: Sink
    screen: Screen
    inbox: Inbox | None = None
    deadline_s: float = float("inf")
    observers: Observers | None = None
    statistics: RunStatistics = field(default_factory=RunStatistics)

    def run(self) -> float:
        """Run to the end; return the UTC instant of the end, POSIX seconds."""
        self.feed()
        guard, link = self.connection.guard, self.connection.link
        self.guarded(self.heed_guard)
        if self.driver.finished and not guard.deposed:
            guard.release(self.rest)
        self.guarded(self._show_end)
        self.statistics.strangers, self.statistics.unsent = link.strangers, link.unsent
        self.raise_error()
        self.gather()
        return self.connection.now_utc_s()

    def take(self, data: bytes, arrival_utc_s: float) -> None:
        """Record a datagram from the mount, and have the engine take it."""
        self.sink.status(arrival_utc_s, data)
        self.driver.receive(data, arrival_utc_s)

    def interrupt(self, now_utc_s: float) -> None:
        """Have the engine stop the mount, until it does."""
        if self.driver.tracker.ended_by is None:
            self._operate(StopNow(), now_utc_s)

    def fail(self, error: Exception, now_utc_s: float) -> None:
        """Have the engine stop the mount for an error, and record that."""
        self.driver.fail(str(error))
        self.sink.failure(now_utc_s, str(error))

    def obey(self, now_utc_s: float) -> None:
        """Have the engine obey the operator's messages."""
        for message in self.inbox.messages() if self.inbox is not None else ():
            self._operate(message, now_utc_s)
        if time.monotonic() >= self.deadline_s:
            self.interrupt(now_utc_s)
        self.driver.session.health.strangers = self.connection.link.strangers

    def sent(self, now_utc_s: float, datagram: bytes) -> None:
        """Record what was sent, and show how the run stands."""
        self.statistics.note_sent(time.monotonic() * self.connection.clock.speed)
        self.sink.command(now_utc_s, datagram)
        if self.ticks % VIEW_EVERY_TICKS == 0 and not self.driver.failed:
            view = self._with_trouble(self.driver.view(now_utc_s))
            self.screen.show(view)
            if self.ticks % RECORD_VIEW_EVERY_TICKS == 0:
                self.sink.view(now_utc_s, view)

    def repeat(self) -> None:
        """Send the last datagram once more where that is wanted, and record it."""
        datagram = self.send_copy(self.driver.repeat)
        if datagram is not None:
            self.sink.repeat(self.connection.now_utc_s(), datagram)

    def report(self) -> None:
        """Take in a few observations."""
        if self.observers is None:
            return
        for seen in self.observers.observations():
            self._operate(seen, self.connection.now_utc_s())
        malformed = 0 if self.inbox is None else self.inbox.malformed
        self.driver.malformed = self.observers.malformed + malformed
        self.driver.dropped = self.observers.dropped

    def shift_s(self, now_utc_s: float) -> float:
        """See RealtimeLoop."""
        return self.driver.send_shift_s(now_utc_s)

    def _operate(self, message: Message, now_utc_s: float) -> None:
        self.sink.operator(now_utc_s, message)
        self.driver.operate(message, now_utc_s)

    def _with_trouble(self, view: TrackView) -> TrackView:
        """Add what is wrong with the recording, or on the way to the mount, to what is shown."""
        troubles = (self.sink.trouble, self.connection.link.trouble)
        told = tuple(words for words in troubles if words is not None)
        return msgspec.structs.replace(view, warnings=(*view.warnings, *told)) if told else view

    def _show_end(self) -> None:
        if not self.driver.failed:
            self.screen.show(self.driver.view(self.connection.now_utc_s()))

    def gather(self) -> None:
        """Note where the axes of a simulated mount really were."""
        if self.connection.simulated is None:
            return
        for truth in self.connection.simulated.truths():
            self.statistics.note_truth(self.driver, truth.counter, truth.utc_s, truth.ra_deg, truth.dec_deg)
