"""A run in virtual time: the same engine and the same simulated mount, joined without sockets or waiting.

The mount's timer, the delays and troubles of its link and its faults are those of its hardware's settings.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from heapq import heappop, heappush
from typing import TYPE_CHECKING, Any

from sattrack.mount.simulator.installation import Installation
from sattrack.mount.xerxes.session import REPEAT_AFTER_PERIODS
from sattrack.runtime.outcome import RunStatistics

if TYPE_CHECKING:
    from collections.abc import Callable

    from sattrack.control.engine import Engine
    from sattrack.mount.simulator.mount import SimulatedMount
    from sattrack.recording.recorder import Sink
    from sattrack.views.messages import Message
    from sattrack.views.run import TrackView

RECORD_VIEW_EVERY_TICKS = 10
MOUNT_PHASE_S = 0.0217
"""How far the mount's loop runs behind ours; two free-running loops have no reason to agree."""


@dataclass(slots=True)
class VirtualRun:
    """An engine and a simulated mount, joined by its wires, run from `begin_utc_s` to the mount's rest.

    `messages` are the operator's, each with its instant. `progress` hears views now and then.
    """

    engine: Engine
    mount: SimulatedMount
    begin_utc_s: float
    sink: Sink
    messages: tuple[tuple[float, Message], ...] = ()
    progress: Callable[[TrackView], None] | None = None
    statistics: RunStatistics = field(default_factory=RunStatistics)
    _queue: list[tuple[float, int, Callable[[float, Any], None], Any]] = field(default_factory=list)
    _order: int = 0
    _installation: Installation = field(init=False)

    def __post_init__(self) -> None:
        """Lay the wires; raises BadInputError where the hardware's faults cannot be read."""
        profile = self.engine.spec.profile
        self._installation = Installation(self.mount, None, profile.command_delay_s, profile.status_delay_s)

    def run(self) -> float:
        """Run to the end; return the UTC instant of the end, POSIX seconds."""
        period_s = self.engine.spec.profile.period_s
        self._at(self.begin_utc_s, self._client_turn, 0)
        first = self._installation.next_turn_s(self.begin_utc_s - period_s + MOUNT_PHASE_S)
        self._at(first, self._mount_turn, None)
        for instant, message in self.messages:
            self._at(instant, self._operate, message)
        now_utc_s = self.begin_utc_s
        while not self.engine.finished:
            now_utc_s, _, happen, what = heappop(self._queue)
            happen(now_utc_s, what)
        return now_utc_s

    def _at(self, utc_s: float, happen: Callable[[float, Any], None], what: Any) -> None:
        self._order += 1
        heappush(self._queue, (utc_s, self._order, happen, what))

    def _client_turn(self, now_utc_s: float, turn: int) -> None:
        profile = self.engine.spec.profile
        datagram = self.engine.tick(now_utc_s)
        self.statistics.note_sent(now_utc_s)
        self.sink.command(now_utc_s, datagram)
        self._send(now_utc_s, datagram)
        if profile.repeat_rates != "never":
            self._at(now_utc_s + REPEAT_AFTER_PERIODS * profile.period_s, self._repeat, None)
        next_utc_s = now_utc_s + profile.period_s + self.engine.send_shift_s(now_utc_s)
        self._at(next_utc_s, self._client_turn, turn + 1)
        if turn % RECORD_VIEW_EVERY_TICKS == 0 and (self.sink.wanted or self.progress is not None):
            view = self.engine.view(now_utc_s)
            self.sink.view(now_utc_s, view)
            if self.progress is not None:
                self.progress(view)

    def _repeat(self, now_utc_s: float, _: None) -> None:
        datagram = self.engine.repeat()
        if datagram is not None:
            self.sink.repeat(now_utc_s, datagram)
            self._send(now_utc_s, datagram)

    def _send(self, now_utc_s: float, datagram: bytes) -> None:
        for delay_s, arriving in self._installation.commands.carry(datagram):
            self._at(now_utc_s + delay_s, self._command_arrives, arriving)

    def _mount_turn(self, now_utc_s: float, _: None) -> None:
        status, truth = self._installation.turn(now_utc_s)
        if status is not None:
            for delay_s, arriving in self._installation.statuses.carry(status):
                self._at(now_utc_s + delay_s, self._status_arrives, (arriving, truth))
        self._at(self._installation.next_turn_s(now_utc_s), self._mount_turn, None)

    def _command_arrives(self, _: float, datagram: bytes) -> None:
        self._installation.receive(datagram)

    def _status_arrives(self, now_utc_s: float, what: Any) -> None:
        status, truth = what
        self.sink.status(now_utc_s, status)
        self.engine.receive(status, now_utc_s)
        self.statistics.note_truth(self.engine, truth.counter, truth.utc_s, truth.ra_deg, truth.dec_deg)

    def _operate(self, now_utc_s: float, message: Message) -> None:
        self.sink.operator(now_utc_s, message)
        self.engine.operate(message, now_utc_s)
