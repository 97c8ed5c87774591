"""Clocks: what instant it is, and when an instant will come, in UTC as POSIX seconds; instants in JSON.

Loops pace themselves by the machine's monotonic clock, which never steps; a clock relates that to UTC.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any, Protocol

from sattrack.core.errors import BadInputError
from tle.errors import TleError
from tle.instants import Utc

FASTEST_LIVE_SPEED = 20.0
SLEW_S_PER_S = 5e-4
SHORTEST_SLEEP_S = 0.1
"""Two clocks cannot be read at one instant: less may be the time in between."""


def slept() -> float:
    """Return for how long the machine has slept since its start, seconds; 0 where nothing tells."""
    clock = getattr(time, "CLOCK_BOOTTIME", None)
    return 0.0 if clock is None else time.clock_gettime(clock) - time.monotonic()


class Clock(Protocol):
    """What anything that runs in time needs of a clock."""

    @property
    def speed(self) -> float:
        """UTC seconds that pass in a second of the monotonic clock."""

    def utc_s(self, monotonic_s: float) -> float:
        """Return the UTC instant, POSIX seconds, at a reading of the monotonic clock."""


@dataclass(slots=True)
class SystemClock:
    """The machine's own UTC, without its steps.

    Where the machine's time is set while a run goes on, this clock does not jump but drifts there by
    SLEW_S_PER_S: a jump of a millisecond would be five arcseconds on a fast satellite. Time in which the
    machine slept passes at once: the monotonic clock stood, and the sky did not.
    """

    speed: float = 1.0
    _offset_s: float | None = None
    _read_s: float = 0.0
    _slept_s: float = 0.0

    def utc_s(self, monotonic_s: float) -> float:
        """See Clock."""
        now_s = time.monotonic()
        offset_s = time.time() - now_s
        slept_s = slept()
        if self._offset_s is None:
            self._offset_s, self._read_s, self._slept_s = offset_s, now_s, slept_s
        if slept_s - self._slept_s > SHORTEST_SLEEP_S:
            self._offset_s += slept_s - self._slept_s
            self._slept_s = slept_s
        most_s = SLEW_S_PER_S * max(0.0, now_s - self._read_s)
        self._offset_s += max(-most_s, min(most_s, offset_s - self._offset_s))
        self._read_s = now_s
        return monotonic_s + self._offset_s


@dataclass(frozen=True, slots=True)
class SimulatedClock:
    """A clock set to `start_utc_s` at the monotonic reading `anchor_s`, running at `speed`.

    Processes on one machine share the monotonic clock, so the same three numbers make the same clock in each.
    """

    start_utc_s: float
    anchor_s: float
    speed: float = 1.0

    def utc_s(self, monotonic_s: float) -> float:
        """See Clock."""
        return self.start_utc_s + (monotonic_s - self.anchor_s) * self.speed


def parse_clock(text: str) -> tuple[Utc, float]:
    """Read `UTC[xSPEED]` into an instant and a speed; raises BadInputError."""
    instant, mark, factor = text.partition("x")
    try:
        start = Utc.parse(instant)
    except TleError as error:
        raise BadInputError(f"--clock {text}: {error}") from error
    try:
        speed = float(factor) if mark else 1.0
    except ValueError as error:
        raise BadInputError(f"--clock {text}: the speed {factor!r} is no number; write e.g. x10") from error
    if not 0.1 <= speed <= FASTEST_LIVE_SPEED:
        raise BadInputError(
            f"--clock {text}: the speed must lie between x0.1 and x{FASTEST_LIVE_SPEED:g}; "
            "for more, --virtual runs as fast as it goes"
        )
    return start, speed


def make_clock(option: str | None) -> tuple[Clock, Utc]:
    """Return the clock that `--clock` asks for, started now, and its instant. Raises BadInputError."""
    if option is None:
        return SystemClock(), Utc(time.time())
    start, speed = parse_clock(option)
    return SimulatedClock(float(start.unix_s), time.monotonic(), speed), start


def encode_utc(value: Any) -> Any:
    """Return an instant as its number; raises NotImplementedError for anything else."""
    if isinstance(value, Utc):
        return float(value.unix_s)
    raise NotImplementedError(type(value))


def decode_utc(kind: type, value: Any) -> Any:
    """Return the instant of a number; raises NotImplementedError for anything else."""
    if kind is Utc:
        return Utc(float(value))
    raise NotImplementedError(kind)
