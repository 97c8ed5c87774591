"""The Field System's side of the line: one transaction at a time, resynchronised after a time-out. No I/O.

"Ideal Field System Antenna Interface", sections 3.0 and 4.0, seen from antcn; and the trajectories it sends.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from decimal import Decimal, InvalidOperation
from enum import Enum
from typing import TYPE_CHECKING, NamedTuple

from sattrack.servers.antenna.line import SYNC, TIME_OUT_S, Check, Framer, Line, encode, idle_time_s
from sattrack.servers.antenna.trajectory import NS, AxisState, day_start_ns, to_ns
from sattrack.servers.antenna.transactions import OMITTED

if TYPE_CHECKING:
    from collections.abc import Callable

    Way = Callable[[float], tuple[float, float]]
    """Where both axes must be at an instant of UTC (POSIX seconds), degrees, on any turn."""

POSITION_FIELDS = 14


class Stage(Enum):
    """What the line waits for."""

    SYNCHRONISING = "silence after the synchronisation character"
    IDLE = "nothing"
    WAITING = "a response"


class Answer(NamedTuple):
    """A transaction that is over: the command, its response (None where none came in time), and when."""

    sent: str
    response: str | None
    sent_utc_s: float
    first_character_utc_s: float | None
    complete_utc_s: float


@dataclass(slots=True)
class Antcn:
    """The line to one controller. `character_s` is the character time-out; all instants are UTC."""

    character_s: float
    check: Check = Check.SUM
    time_out_s: float = TIME_OUT_S
    per_character: bool = False
    """Whether each character of a response after its first has to come within the character time-out."""
    stage: Stage = Stage.SYNCHRONISING
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
        self.stage = Stage.SYNCHRONISING
        self._framer.reset()
        self._quiet_since_s = now_utc_s
        return SYNC

    def send(self, message: str, now_utc_s: float) -> bytes:
        """Return a command to send. Raises RuntimeError where the line waits for something else."""
        if self.stage is not Stage.IDLE:
            raise RuntimeError(f"the line waits for {self.stage.value}")
        self.stage = Stage.WAITING
        self._sent, self._sent_utc_s, self._first_utc_s = message, now_utc_s, None
        return encode(message, self.check)

    def receive(self, data: bytes, now_utc_s: float) -> Answer | None:
        """Take bytes that came; return the transaction that they complete."""
        if self.stage is not Stage.WAITING:
            self._quiet_since_s = now_utc_s
            return None
        if self._first_utc_s is None and data:
            self._first_utc_s = now_utc_s
        self._last_utc_s = now_utc_s
        for event in self._framer.receive(data):
            if not isinstance(event, Line) or event.fault is not None:
                self.garbled += 1
                continue
            self.stage = Stage.IDLE
            return Answer(self._sent, event.message, self._sent_utc_s, self._first_utc_s, now_utc_s)
        return None

    def tick(self, now_utc_s: float) -> tuple[bytes, Answer | None]:
        """Let time pass: return what to send, and a transaction that has timed out."""
        if self.stage is Stage.SYNCHRONISING and now_utc_s - self._quiet_since_s >= idle_time_s(
            self.character_s
        ):
            self.stage = Stage.IDLE
        if self.stage is Stage.WAITING and now_utc_s >= self._expires_utc_s():
            self.time_outs += 1
            answer = Answer(self._sent, None, self._sent_utc_s, self._first_utc_s, now_utc_s)
            return self.synchronise(now_utc_s), answer
        return b"", None

    def due_utc_s(self) -> float:
        """Return when `tick` must be called next, where nothing comes before."""
        if self.stage is Stage.SYNCHRONISING:
            return self._quiet_since_s + idle_time_s(self.character_s)
        return self._expires_utc_s() if self.stage is Stage.WAITING else math.inf

    def _expires_utc_s(self) -> float:
        expires_utc_s = self._sent_utc_s + self.time_out_s
        if self.per_character and self._first_utc_s is not None:
            return min(expires_utc_s, self._last_utc_s + self.character_s)
        return expires_utc_s


class PositionReport(NamedTuple):
    """What a response to PS says; states are None where their fields are left out."""

    commanded: AxisState | None
    actual: AxisState | None
    epoch_s: float
    remote: bool
    servo: str


def read_position(response: str) -> PositionReport:
    """Return what a response to PS says. Raises ValueError where it is none."""
    fields = response.split()
    if len(fields) != POSITION_FIELDS or fields[0] != "PS":
        raise ValueError(f"{response!r} is no position status")
    commanded = _state(fields[1:3], fields[5:7], fields[9])
    actual = _state(fields[3:5], fields[7:9], fields[10])
    try:
        epoch_s = float(Decimal(fields[11]))
    except InvalidOperation as error:
        raise ValueError(f"{fields[11]!r} is no epoch") from error
    return PositionReport(commanded, actual, epoch_s, fields[12] == "REMOTE", fields[13])


def _state(position: list[str], rates: list[str], wrap: str) -> AxisState | None:
    if OMITTED in position:
        return None
    first, second = (float(text) for text in position)
    first_rate, second_rate = (float(text) for text in rates)
    return AxisState(first + 360.0 * int(wrap), second, first_rate, second_rate)


def epoch_utc_s(second_of_day: float, near_utc_s: float) -> float:
    """Return the instant nearest to another that seconds of the UTC day mean."""
    start_s = day_start_ns(to_ns(near_utc_s)) / NS
    return min((start_s + second_of_day + d * 86400.0 for d in (-1, 0, 1)), key=lambda s: abs(s - near_utc_s))


def chord(way: Way, begin_ns: int, interval_s: float) -> str:
    """Return the designation of the straight way between a target's places at both ends of an interval.

    Its epoch is the interval's begin. A parabola strays from its chord by at most an eighth of its bend, from
    its tangent by half; the chords of successive intervals join.
    """
    here, there = way(begin_ns / NS), way(begin_ns / NS + interval_s)
    first_rate = math.remainder(there[0] - here[0], 360.0) / interval_s
    second_rate = (there[1] - here[1]) / interval_s
    second_of_day = Decimal(begin_ns - day_start_ns(begin_ns)) / NS
    return f"TD {here[0]:.9f} {here[1]:.9f} {first_rate:.12f} {second_rate:.12f} {second_of_day:.6f} S"
