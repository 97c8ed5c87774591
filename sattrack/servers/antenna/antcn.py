"""The Field System's side of the antenna interface: transactions on the line, and one pass. No I/O.

"Ideal Field System Antenna Interface", sections 3.0 to 5.0, seen from antcn. One transaction goes at a time;
the line is resynchronised after a time-out. A pass is followed by a PS and a TD about once a second each. The
antenna waits where the target will rise, and gets a STOP when it has set.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from decimal import Decimal, InvalidOperation
from enum import Enum, StrEnum
from typing import NamedTuple

from sattrack.core.figures import RunningError
from sattrack.mount.link_loss import longest_stop_s
from sattrack.safety import SafetyLimits
from sattrack.servers.antenna.protocol import (
    NAK_MEANINGS,
    NS,
    OMITTED,
    SYNC,
    TIME_OUT_S,
    Checksum,
    Framer,
    Nak,
    ReceivedLine,
    acknowledge,
    day_start_ns,
    encode,
    idle_time_s,
    to_ns,
)
from sattrack.servers.antenna.trajectory import AxisState

POSITION_FIELDS = 14
AxesPath = Callable[[float], tuple[float, float]]
"""Where both axes must be at an instant of UTC (POSIX seconds), degrees, on any turn."""
INTERVAL_S = 1.0
LEAD_S = 0.05
"""How long before its epoch a designation is sent: a controller plans a little ahead."""
POSITION_SHARE = 0.45
"""When in an interval the position is requested."""
SILENT_FOR_S = 5.0
CLOCK_TOLERANCE_S = SafetyLimits().clock_tolerance_s
STOP_EVERY_S = 0.25
"""How often a stop goes out that is not acknowledged, and how often the position is asked for after one."""
AT_REST_DEG_S = 0.006
"""A stopped mount may stand, or track the sky."""


class AntcnPhase(StrEnum):
    """The phase of a run."""

    CONNECTING = "connecting"
    WAITING = "waiting"
    ACQUIRING = "acquiring"
    TRACKING = "tracking"
    STOPPING = "stopping"


@dataclass(slots=True)
class AntcnRun:
    """Designates a path between two instants of UTC (POSIX seconds) over one line."""

    line: Antcn
    path: AxesPath
    start_utc_s: float
    end_utc_s: float
    on_target_arcsec: float
    started_utc_s: float
    interval_s: float = INTERVAL_S
    phase: AntcnPhase = AntcnPhase.CONNECTING
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
    """Seconds on the target, by reported positions."""
    designated: int = 0
    answered: int = 0
    refused: int = 0
    clock_gap_s: float = 0.0
    """The least error of the controller's clock: by epochs outside of their transactions."""
    _heard_utc_s: float | None = None
    _placed_utc_s: float | None = None
    """When a position came last that differed from the one before."""
    _last_epoch_s: float | None = None
    _next_td_ns: int | None = None
    _next_ps_utc_s: float = 0.0
    _stop_since_utc_s: float = 0.0
    _next_stop_utc_s: float = -math.inf
    _stop_answer: str | None = None
    """The last response to a STOP."""

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
        """Return the bytes to send now; call when `due_utc_s` says, and after every `receive`."""
        out, _ = self.line.tick(now_utc_s)
        self._watch(now_utc_s)
        if out or self.finished or self.line.stage is not LineState.IDLE:
            return out
        message = self._next_message(now_utc_s)
        return b"" if message is None else self.line.send(message, now_utc_s)

    def due_utc_s(self, now_utc_s: float) -> float:
        """Return when `tick` must be called at the latest."""
        if self.line.stage is not LineState.IDLE:
            return min(self.line.due_utc_s(), now_utc_s + 0.1)
        td_s = math.inf if self._next_td_ns is None else self._next_td_ns / NS - LEAD_S
        return max(now_utc_s, min(td_s, self._next_ps_utc_s, now_utc_s + 0.1))

    def end(self, why: str, now_utc_s: float, message: str | None = None) -> None:
        """Stop the antenna, and be finished when it is seen at rest."""
        if self.ended_by is None:
            self.ended_by, self.message = why, message
            self.phase, self._stop_since_utc_s = AntcnPhase.STOPPING, now_utc_s
            self._next_ps_utc_s = now_utc_s

    def _watch(self, now_utc_s: float) -> None:
        silent_s = now_utc_s - (self.started_utc_s if self._heard_utc_s is None else self._heard_utc_s)
        if self.ended_by is None:
            if silent_s > SILENT_FOR_S:
                message = "the antenna's controller does not answer; stops are being sent"
                self.end("link", now_utc_s, message)
            elif now_utc_s - (self._placed_utc_s or now_utc_s) > SILENT_FOR_S:
                untold = self.position is None or self.position.actual is None
                said = (
                    "does not tell where the antenna is"
                    if untold
                    else "reported the same position again and again"
                )
                self.end("link", now_utc_s, f"the controller {said}; stops are being sent")
            elif self.clock_gap_s > CLOCK_TOLERANCE_S:
                message = (
                    f"the controller's clock is off ours by {self.clock_gap_s:.0f} s; stops are being sent"
                )
                self.end("error", now_utc_s, message)
            elif now_utc_s >= self.end_utc_s:
                self.end("set", now_utc_s)
        elif not self.finished:
            waited_s = now_utc_s - self._stop_since_utc_s
            answered = self._heard_utc_s is None or self._stop_answer is not None
            nothing_sent = self.designated == 0 and answered
            if nothing_sent or waited_s > longest_stop_s(heard=silent_s < SILENT_FOR_S):
                self.mount_stopped = None if self.designated == 0 else bool(self.mount_stopped)
                self.finished = True

    def _next_message(self, now_utc_s: float) -> str | None:
        if self.phase is AntcnPhase.STOPPING:
            # A refusal, as of a line that was garbled on its way, is no acknowledgement.
            if self._stop_answer != acknowledge("STOP") and now_utc_s >= self._next_stop_utc_s:
                self._next_stop_utc_s = now_utc_s + STOP_EVERY_S
                return "STOP"
            return self._request_position(now_utc_s, STOP_EVERY_S)
        if self._next_td_ns is None:
            self._next_td_ns = math.ceil((now_utc_s + LEAD_S) / self.interval_s) * round(self.interval_s * NS)
            self._next_ps_utc_s = self._next_td_ns / NS + POSITION_SHARE * self.interval_s
        if now_utc_s >= self._next_td_ns / NS - LEAD_S:
            return self._designate(now_utc_s)
        return self._request_position(now_utc_s, max(1.0, self.interval_s))

    def _designate(self, now_utc_s: float) -> str:
        interval_ns = round(self.interval_s * NS)
        begin_ns = self._next_td_ns or 0
        # After a time-out, past intervals are left out.
        behind = math.floor((now_utc_s - begin_ns / NS) / self.interval_s)
        begin_ns += max(0, behind) * interval_ns
        self._next_td_ns = begin_ns + interval_ns
        self.designated += 1
        if self.phase is AntcnPhase.CONNECTING:
            self.phase = AntcnPhase.WAITING
        return chord(self._clamped, begin_ns, self.interval_s)

    def _clamped(self, utc_s: float) -> tuple[float, float]:
        return self.path(max(self.start_utc_s, min(self.end_utc_s, utc_s)))

    def _request_position(self, now_utc_s: float, every_s: float) -> str | None:
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
            told = self.position.actual is not None
            if told and (before is None or _place(before) != _place(self.position)):
                self._placed_utc_s = answer.complete_utc_s
            self._judge(answer, self.position, before)
        elif answer.sent == "STOP":
            self._stop_answer = response
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
            self.error_arcsec = self._last_epoch_s = None
            if self.phase is AntcnPhase.TRACKING:
                self.phase = AntcnPhase.ACQUIRING
            return
        if self.phase is AntcnPhase.STOPPING:
            reported = max(abs(actual.first_rate_deg_s), abs(actual.second_rate_deg_s)) <= AT_REST_DEG_S
            self.mount_stopped = position.servo == "IDLE" and reported and _rests(before, position)
            self.finished = self.mount_stopped
            return
        if epoch_s < self.start_utc_s:
            return
        if self.followable_utc_s is None:
            self.followable_utc_s = epoch_s
        first, second = self.path(epoch_s)
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
        self.phase = AntcnPhase.TRACKING if near else AntcnPhase.ACQUIRING


class LineState(Enum):
    """The state of the line: what it waits for."""

    SYNCHRONISING = "silence after the synchronisation character"
    IDLE = "nothing"
    WAITING = "a response"


class Answer(NamedTuple):
    """A transaction that is over: the command, its response (None where none came in time), and instants."""

    sent: str
    response: str | None
    sent_utc_s: float
    first_character_utc_s: float | None
    complete_utc_s: float


@dataclass(slots=True)
class Antcn:
    """The line to one controller. `character_s` is the character time-out; all instants are UTC."""

    character_s: float
    check: Checksum = Checksum.SUM
    time_out_s: float = TIME_OUT_S
    per_character: bool = False
    """Whether each character of a response after its first must come within the character time-out."""
    stage: LineState = LineState.SYNCHRONISING
    time_outs: int = 0
    garbled: int = 0
    """Responses that came with a wrong check."""
    _framer: Framer = field(init=False)
    _quiet_since_s: float = math.inf
    _sent: str = ""
    _sent_utc_s: float = 0.0
    _first_utc_s: float | None = None
    _last_utc_s: float = 0.0

    def __post_init__(self) -> None:
        """Make the line's framing."""
        self._framer = Framer(self.check)

    def synchronise(self, now_utc_s: float) -> bytes:
        """Return the synchronisation character; the line is idle once it has been silent for a while."""
        self.stage = LineState.SYNCHRONISING
        self._framer.reset()
        self._quiet_since_s = now_utc_s
        return SYNC

    def send(self, message: str, now_utc_s: float) -> bytes:
        """Return a command to send. Raises RuntimeError where the line waits for something else."""
        if self.stage is not LineState.IDLE:
            raise RuntimeError(f"the line waits for {self.stage.value}")
        self.stage = LineState.WAITING
        self._sent, self._sent_utc_s, self._first_utc_s = message, now_utc_s, None
        return encode(message, self.check)

    def receive(self, data: bytes, now_utc_s: float) -> Answer | None:
        """Take bytes that came; return the transaction that they complete."""
        if self.stage is not LineState.WAITING:
            self._quiet_since_s = now_utc_s
            return None
        if self._first_utc_s is None and data:
            self._first_utc_s = now_utc_s
        self._last_utc_s = now_utc_s
        for event in self._framer.receive(data):
            if not isinstance(event, ReceivedLine) or event.fault is not None:
                self.garbled += 1
                continue
            self.stage = LineState.IDLE
            return Answer(self._sent, event.message, self._sent_utc_s, self._first_utc_s, now_utc_s)
        return None

    def tick(self, now_utc_s: float) -> tuple[bytes, Answer | None]:
        """Return the bytes to send now, and a transaction that has timed out."""
        if self.stage is LineState.SYNCHRONISING and now_utc_s - self._quiet_since_s >= idle_time_s(
            self.character_s
        ):
            self.stage = LineState.IDLE
        if self.stage is LineState.WAITING and now_utc_s >= self._expires_utc_s():
            self.time_outs += 1
            answer = Answer(self._sent, None, self._sent_utc_s, self._first_utc_s, now_utc_s)
            return self.synchronise(now_utc_s), answer
        return b"", None

    def due_utc_s(self) -> float:
        """Return when `tick` must be called next, if no bytes come before."""
        if self.stage is LineState.SYNCHRONISING:
            return self._quiet_since_s + idle_time_s(self.character_s)
        return self._expires_utc_s() if self.stage is LineState.WAITING else math.inf

    def _expires_utc_s(self) -> float:
        expires_utc_s = self._sent_utc_s + self.time_out_s
        if self.per_character and self._first_utc_s is not None:
            return min(expires_utc_s, self._last_utc_s + self.character_s)
        return expires_utc_s


class PositionReport(NamedTuple):
    """A response to PS; states are None where their fields are left out."""

    commanded: AxisState | None
    actual: AxisState | None
    epoch_s: float
    remote: bool
    servo: str


def read_position(response: str) -> PositionReport:
    """Parse a response to PS. Raises ValueError where it is none."""
    fields = response.split()
    if len(fields) != POSITION_FIELDS or fields[0] != "PS":
        raise ValueError(f"{response!r} is no position status")
    try:
        commanded = _state(fields[1:3], fields[5:7], fields[9])
        actual = _state(fields[3:5], fields[7:9], fields[10])
        epoch_s = _finite(Decimal(fields[11]))
    except (InvalidOperation, OverflowError) as error:
        raise ValueError(f"{response!r} is no position status") from error
    return PositionReport(commanded, actual, epoch_s, fields[12] == "REMOTE", fields[13])


def _state(position: list[str], rates: list[str], wrap: str) -> AxisState | None:
    if OMITTED in position:
        return None
    first, second, first_rate, second_rate = (_finite(text) for text in (*position, *rates))
    return AxisState(first + 360.0 * int(wrap), second, first_rate, second_rate)


def _finite(number: str | Decimal) -> float:
    """Return a number; raises ValueError where it is none: C prints what it does not know as nan."""
    value = float(number)
    if not math.isfinite(value):
        raise ValueError(f"{number} is no number")
    return value


def epoch_utc_s(second_of_day: float, near_utc_s: float) -> float:
    """Return the instant of seconds of the UTC day that is nearest to another."""
    start_s = day_start_ns(to_ns(near_utc_s)) / NS
    return min((start_s + second_of_day + d * 86400.0 for d in (-1, 0, 1)), key=lambda s: abs(s - near_utc_s))


def chord(path: AxesPath, begin_ns: int, interval_s: float) -> str:
    """Return the designation of the straight path between a target's places at both ends of an interval.

    Its epoch is the interval's begin. A parabola strays from its chord by at most an eighth of its bend, from
    its tangent by half; the chords of successive intervals join.
    """
    here, there = path(begin_ns / NS), path(begin_ns / NS + interval_s)
    first_rate = math.remainder(there[0] - here[0], 360.0) / interval_s
    second_rate = (there[1] - here[1]) / interval_s
    second_of_day = Decimal(begin_ns - day_start_ns(begin_ns)) / NS
    return f"TD {here[0]:.9f} {here[1]:.9f} {first_rate:.12f} {second_rate:.12f} {second_of_day:.6f} S"


def _place(position: PositionReport) -> tuple[AxisState | None, float]:
    return position.actual, position.epoch_s


def _rests(before: PositionReport | None, position: PositionReport) -> bool:
    """Return whether two successive positions are those of an antenna at rest."""
    if before is None or before.actual is None or position.actual is None:
        return False
    seconds = (position.epoch_s - before.epoch_s) % 86400.0
    first_deg = math.remainder(position.actual.first_deg - before.actual.first_deg, 360.0)
    second_deg = position.actual.second_deg - before.actual.second_deg
    return seconds > 0.0 and max(abs(first_deg), abs(second_deg)) <= AT_REST_DEG_S * seconds
