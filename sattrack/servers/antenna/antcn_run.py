"""One pass by trajectory designations, from the first synchronisation to the antenna seen at rest. No I/O.

"Ideal Field System Antenna Interface", section 5.0: a PS and a TD about once a second each. The antenna waits
where the target will come up, and is told to stop when it has set.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING

from sattrack.core.figures import RunningError
from sattrack.mount.link_loss import longest_stop_s
from sattrack.safety import SafetyLimits
from sattrack.servers.antenna.antcn import (
    Answer,
    Antcn,
    PositionReport,
    Stage,
    chord,
    epoch_utc_s,
    read_position,
)
from sattrack.servers.antenna.trajectory import NS
from sattrack.servers.antenna.transactions import NAK_MEANINGS, Nak

if TYPE_CHECKING:
    from sattrack.servers.antenna.antcn import Way
    from sattrack.servers.antenna.trajectory import AxisState

INTERVAL_S = 1.0
LEAD_S = 0.05
"""How long before its epoch a designation is sent: a controller plans a little ahead."""
POSITION_SHARE = 0.45
"""When in an interval the position is asked for."""
SILENT_FOR_S = 5.0
CLOCK_TOLERANCE_S = SafetyLimits().clock_tolerance_s
AT_REST_DEG_S = 0.006
"""A stopped mount may stand, or track the sky."""


class Phase(StrEnum):
    """What the run does, in words."""

    CONNECTING = "connecting"
    WAITING = "waiting"
    ACQUIRING = "acquiring"
    TRACKING = "tracking"
    STOPPING = "stopping"


@dataclass(slots=True)
class AntcnRun:
    """Designates a way between two instants of UTC (POSIX seconds) over one line."""

    line: Antcn
    way: Way
    start_utc_s: float
    end_utc_s: float
    on_target_arcsec: float
    started_utc_s: float
    interval_s: float = INTERVAL_S
    phase: Phase = Phase.CONNECTING
    ended_by: str | None = None
    message: str | None = None
    finished: bool = False
    mount_stopped: bool | None = None
    reported: RunningError = field(default_factory=RunningError)
    error_arcsec: float | None = None
    position: PositionReport | None = None
    acquired_utc_s: float | None = None
    followable_utc_s: float | None = None
    on_target_s: float = 0.0
    """Seconds on the target, as positions told."""
    designated: int = 0
    answered: int = 0
    refused: int = 0
    clock_gap_s: float = 0.0
    """By how much, at least, the controller's clock is off ours: by epochs outside of their transactions."""
    _heard_utc_s: float | None = None
    _placed_utc_s: float | None = None
    """When a position came last that was not the one before over again."""
    _last_epoch_s: float | None = None
    _next_td_ns: int | None = None
    _next_ps_utc_s: float = 0.0
    _stop_asked_utc_s: float = 0.0
    _stop_heard: bool = False

    def begin(self, now_utc_s: float) -> bytes:
        """Return the first bytes to send."""
        return self.line.synchronise(now_utc_s)

    def receive(self, data: bytes, now_utc_s: float) -> None:
        """Take bytes from the controller."""
        answer = self.line.receive(data, now_utc_s)
        if answer is not None and answer.response is not None:
            self._heard_utc_s = now_utc_s
            self.answered += 1
            self._take(answer, answer.response)

    def tick(self, now_utc_s: float) -> bytes:
        """Return what to send now; call when `due_utc_s` says, and after every `receive`."""
        out, _ = self.line.tick(now_utc_s)
        self._watch(now_utc_s)
        if out or self.finished or self.line.stage is not Stage.IDLE:
            return out
        message = self._next_message(now_utc_s)
        return b"" if message is None else self.line.send(message, now_utc_s)

    def due_utc_s(self, now_utc_s: float) -> float:
        """Return when `tick` is to be called at the latest."""
        if self.line.stage is not Stage.IDLE:
            return min(self.line.due_utc_s(), now_utc_s + 0.1)
        td_s = math.inf if self._next_td_ns is None else self._next_td_ns / NS - LEAD_S
        return max(now_utc_s, min(td_s, self._next_ps_utc_s, now_utc_s + 0.1))

    def end(self, why: str, now_utc_s: float, message: str | None = None) -> None:
        """Stop the antenna, and be finished when it is seen at rest."""
        if self.ended_by is None:
            self.ended_by, self.message = why, message
            self.phase, self._stop_asked_utc_s = Phase.STOPPING, now_utc_s
            self._next_ps_utc_s = now_utc_s

    def _watch(self, now_utc_s: float) -> None:
        silent_s = now_utc_s - (self.started_utc_s if self._heard_utc_s is None else self._heard_utc_s)
        if self.ended_by is None:
            if silent_s > SILENT_FOR_S:
                words = "the antenna's controller does not answer; stops are being sent"
                self.end("link", now_utc_s, words)
            elif now_utc_s - (self._placed_utc_s or now_utc_s) > SILENT_FOR_S:
                words = "the controller told the same position again and again; stops are being sent"
                self.end("link", now_utc_s, words)
            elif self.clock_gap_s > CLOCK_TOLERANCE_S:
                words = (
                    f"the controller's clock is off ours by {self.clock_gap_s:.0f} s; stops are being sent"
                )
                self.end("error", now_utc_s, words)
            elif now_utc_s >= self.end_utc_s:
                self.end("set", now_utc_s)
        elif not self.finished:
            waited_s = now_utc_s - self._stop_asked_utc_s
            nothing_asked = self.designated == 0 and (self._heard_utc_s is None or self._stop_heard)
            if nothing_asked or waited_s > longest_stop_s(heard=silent_s < SILENT_FOR_S):
                self.mount_stopped = None if self.designated == 0 else bool(self.mount_stopped)
                self.finished = True

    def _next_message(self, now_utc_s: float) -> str | None:
        if self.phase is Phase.STOPPING:
            if not self._stop_heard:
                return "STOP"
            return self._ask_position(now_utc_s, 0.25)
        if self._next_td_ns is None:
            self._next_td_ns = math.ceil((now_utc_s + LEAD_S) / self.interval_s) * round(self.interval_s * NS)
            self._next_ps_utc_s = self._next_td_ns / NS + POSITION_SHARE * self.interval_s
        if now_utc_s >= self._next_td_ns / NS - LEAD_S:
            return self._designate(now_utc_s)
        return self._ask_position(now_utc_s, max(1.0, self.interval_s))

    def _designate(self, now_utc_s: float) -> str:
        interval_ns = round(self.interval_s * NS)
        begin_ns = self._next_td_ns or 0
        # After a time-out, what lies behind is not designated any more.
        behind = math.floor((now_utc_s - begin_ns / NS) / self.interval_s)
        begin_ns += max(0, behind) * interval_ns
        self._next_td_ns = begin_ns + interval_ns
        self.designated += 1
        if self.phase is Phase.CONNECTING:
            self.phase = Phase.WAITING
        return chord(self._clamped, begin_ns, self.interval_s)

    def _clamped(self, utc_s: float) -> tuple[float, float]:
        return self.way(max(self.start_utc_s, min(self.end_utc_s, utc_s)))

    def _ask_position(self, now_utc_s: float, every_s: float) -> str | None:
        if now_utc_s < self._next_ps_utc_s:
            return None
        self._next_ps_utc_s = max(self._next_ps_utc_s + every_s, now_utc_s)
        return "PS"

    def _take(self, answer: Answer, response: str) -> None:
        if answer.sent == "PS":
            try:
                before, self.position = self.position, read_position(response)
            except ValueError:
                self.line.garbled += 1
                return
            if before is None or _place(before) != _place(self.position):
                self._placed_utc_s = answer.complete_utc_s
            self._judge(answer, self.position, before)
        elif answer.sent == "STOP":
            self._stop_heard = True
        elif " NAK " in response:
            self._take_refusal(response, answer.complete_utc_s)

    def _take_refusal(self, response: str, now_utc_s: float) -> None:
        self.refused += 1
        try:
            why = Nak(int(response.rsplit(" ", 1)[1]))
        except ValueError:
            self.end("error", now_utc_s, f"the controller refused a trajectory: {response}")
            return
        if why is not Nak.TRANSMISSION:
            self.end("error", now_utc_s, f"the controller refused a trajectory: {NAK_MEANINGS[why]}")

    def _judge(self, answer: Answer, position: PositionReport, before: PositionReport | None) -> None:
        first_utc_s = answer.first_character_utc_s or answer.complete_utc_s
        epoch_s = epoch_utc_s(position.epoch_s, first_utc_s)
        self.clock_gap_s = max(0.0, epoch_s - first_utc_s, answer.sent_utc_s - epoch_s)
        actual = position.actual
        if actual is None:
            return
        if self.phase is Phase.STOPPING:
            told = max(abs(actual.first_rate_deg_s), abs(actual.second_rate_deg_s)) <= AT_REST_DEG_S
            self.mount_stopped = position.servo == "IDLE" and told and _rests(before, position)
            self.finished = self.mount_stopped
            return
        if epoch_s < self.start_utc_s:
            return
        if self.followable_utc_s is None:
            self.followable_utc_s = epoch_s
        first, second = self.way(epoch_s)
        across = math.remainder(actual.first_deg - first, 360.0) * math.cos(math.radians(second))
        self.error_arcsec = math.hypot(across, actual.second_deg - second) * 3600.0
        near = self.error_arcsec <= self.on_target_arcsec
        if self.acquired_utc_s is None and near:
            self.acquired_utc_s = epoch_s
        if near and self._last_epoch_s is not None:
            self.on_target_s += max(0.0, epoch_s - self._last_epoch_s)
        self._last_epoch_s = epoch_s
        if self.acquired_utc_s is not None:
            self.reported.add(self.error_arcsec)
        self.phase = Phase.TRACKING if near else Phase.ACQUIRING


def _place(position: PositionReport) -> tuple[AxisState | None, float]:
    return position.actual, position.epoch_s


def _rests(before: PositionReport | None, position: PositionReport) -> bool:
    """Tell whether two positions, one after the other, are those of an antenna at rest."""
    if before is None or before.actual is None or position.actual is None:
        return False
    seconds = (position.epoch_s - before.epoch_s) % 86400.0
    first_deg = math.remainder(position.actual.first_deg - before.actual.first_deg, 360.0)
    second_deg = position.actual.second_deg - before.actual.second_deg
    return seconds > 0.0 and max(abs(first_deg), abs(second_deg)) <= AT_REST_DEG_S * seconds
