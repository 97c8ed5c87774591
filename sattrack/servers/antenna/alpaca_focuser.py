"""The antenna's focuser over ASCOM Alpaca: a process for each axis, and the controller's channel to it.

HTTP may take seconds, and the loop that feeds the mount never waits, hence the process. Of the ASCOM Focuser
interface it uses positions in steps from 0 to MaxStep, moves of MaxIncrement steps at most that return at
once, IsMoving, Halt.
"""

from __future__ import annotations

import contextlib
import math
import select
import sys
import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING
from urllib.parse import parse_qs, urlsplit

import msgspec

from sattrack.core.channel import Channel, PipedProcess
from sattrack.core.errors import BadInputError, SattrackError
from sattrack.mount.alpaca.client import NOT_IMPLEMENTED, AlpacaDevice, AlpacaRefusalError, NoAnswerError
from sattrack.servers.antenna.equipment import FocusAxisState, Focuser, FocusOrder, RemoteAxis, swept_mm

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

TURN_S = 0.1
ANSWER_WITHIN_S = 5.0
RECONNECT_AFTER_S = 2.0
MICRONS_A_MM = 1000.0
FORM = "alpaca://HOST:PORT/DEVICE, with ?step=MICROMETRES or &zero=STEP"
START_WITHIN_S = 20.0
END_WITHIN_S = 12.0
"""A focuser that does not answer delays its process by two requests."""
_STATES: msgspec.json.Decoder[FocusAxisState] = msgspec.json.Decoder(FocusAxisState)


class FocuserError(Exception):
    """A focuser that cannot be used; the text is for a user."""


class FocuserConfig(msgspec.Struct, frozen=True):
    """Which focuser: `step_um` where it does not know the size of its steps, `zero_step` is 0 mm."""

    address: str
    device: int
    step_um: float | None = None
    zero_step: int = 0


@dataclass(slots=True)
class AlpacaAxis:
    """One focuser as an axis in mm. Its methods raise AlpacaRefusalError and NoAnswerError."""

    focuser: AlpacaDevice
    config: FocuserConfig
    serial: int = 0
    _step_mm: float = 0.0
    _max_step: int = 0
    _max_increment: int = 0
    _wanted_step: int | None = None
    _sweep: tuple[float, float, float] | None = None
    """Where, at what rate and when a sweep began."""
    _sent_step: int | None = None

    def connect(self) -> None:
        """Connect, and read its range. Raises FocuserError where it cannot be used."""
        self.focuser.put("connected", Connected="True")
        if not self.focuser.get("absolute"):
            raise FocuserError("it moves by differences and knows no positions")
        step_um = self.config.step_um or self._step_um()
        self._step_mm = step_um / MICRONS_A_MM
        self._max_step = int(self._number("maxstep"))
        self._max_increment = max(1, int(self._number("maxincrement")))

    def _step_um(self) -> float:
        try:
            step_um = self._number("stepsize")
        except AlpacaRefusalError as refusal:
            if refusal.number != NOT_IMPLEMENTED:
                raise
            step_um = 0.0
        if not 0.0 < step_um < math.inf:
            raise FocuserError("it does not report the size of its steps: add ?step= with their micrometres")
        return step_um

    @property
    def limits_mm(self) -> tuple[float, float]:
        """Its least and greatest place."""
        return self._to_mm(0), self._to_mm(self._max_step)

    def begin(self, order: FocusOrder, now_s: float) -> None:
        """Begin an order."""
        self.serial = order.serial
        self._wanted_step = self._sweep = self._sent_step = None
        if order.to_mm is not None:
            self._wanted_step = self._to_step(order.to_mm)
        elif order.sweep_mm_s is not None:
            self._sweep = (self._to_mm(self._position()), order.sweep_mm_s, now_s)
        else:
            self._halt()

    def turn(self, now_s: float) -> tuple[float, bool]:
        """Go on with the order; return its place, mm, and whether it moves."""
        position, moving = self._position(), self.focuser.get("ismoving") is True
        wanted = self._wanted_step
        if self._sweep is not None:
            from_mm, rate_mm_s, since_s = self._sweep
            # Where it must be at the next turn.
            ahead_s = now_s - since_s + TURN_S
            wanted = self._to_step(swept_mm(from_mm, rate_mm_s, ahead_s, *self.limits_mm))
        if wanted is not None and not moving and self._sent_step != wanted:
            moving = self._approach(position, wanted)
        return self._to_mm(position), moving or self._sweep is not None

    def halt(self) -> None:
        """Stop it, if an order moves it."""
        if self._sweep is not None or self._wanted_step is not None:
            self._halt()

    def _approach(self, position: int, wanted: int) -> bool:
        steps = max(-self._max_increment, min(self._max_increment, wanted - position))
        if steps == 0:
            self._sent_step = wanted
            return False
        self._go(position + steps)
        self._sent_step = position + steps
        return True

    def _halt(self) -> None:
        try:
            self.focuser.put("halt")
        except AlpacaRefusalError as refusal:
            if refusal.number != NOT_IMPLEMENTED:
                raise
            # A focuser that cannot halt is sent to its own position.
            self._go(self._position())

    def _go(self, step: int) -> None:
        self.focuser.put("move", Position=str(step))

    def _position(self) -> int:
        return int(self._number("position"))

    def _number(self, member: str) -> float:
        value = self.focuser.get(member)
        if not isinstance(value, float | int):
            raise NoAnswerError(f"its {member} is {value!r}, and no number")
        return value

    def _to_mm(self, step: int) -> float:
        return (step - self.config.zero_step) * self._step_mm

    def _to_step(self, mm: float) -> int:
        step = round(mm / self._step_mm) + self.config.zero_step
        return max(0, min(self._max_step, step))


@dataclass(slots=True)
class FocuserDriver:
    """Drives one focuser."""

    focuser: AlpacaDevice
    config: FocuserConfig
    report: Callable[[FocusAxisState], None]
    axis: AlpacaAxis | None = None
    serial: int = 0
    _pending: list[FocusOrder] = field(default_factory=list)
    _next_try_s: float = 0.0

    def turn(self, orders: list[FocusOrder], now_s: float) -> None:
        """Begin new orders and report the state; after an error, connect again later."""
        self._pending += orders
        if self.axis is None and now_s < self._next_try_s:
            return
        try:
            self._drive(now_s)
        except (FocuserError, AlpacaRefusalError, NoAnswerError) as error:
            self._fail(str(error).splitlines()[0][:200], now_s)

    def _drive(self, now_s: float) -> None:
        if self.axis is None:
            axis = AlpacaAxis(self.focuser, self.config, self.serial)
            axis.connect()
            self.axis = axis
        while self._pending:
            # An order that the focuser refuses is not tried again.
            order = self._pending.pop(0)
            self.serial = order.serial
            self.axis.begin(order, now_s)
        began_s = time.monotonic()
        mm, moving = self.axis.turn(now_s)
        measured_s = 0.5 * (began_s + time.monotonic())
        self.report(FocusAxisState(measured_s, mm, moving, self.axis.serial, *self.axis.limits_mm))

    def _fail(self, trouble: str, now_s: float) -> None:
        self.axis = None
        if self._pending:
            # An order is not carried out late, when the focuser comes back.
            self.serial = self._pending[-1].serial
            self._pending.clear()
        self._next_try_s = now_s + RECONNECT_AFTER_S
        self.report(FocusAxisState(time.monotonic(), None, moving=False, serial=self.serial, trouble=trouble))


def focuser_at(config: FocuserConfig) -> AlpacaDevice:
    """Return the device of a focuser's address."""
    return AlpacaDevice(config.address, "focuser", config.device, ANSWER_WITHIN_S)


def main(config: FocuserConfig) -> int:
    """Drive a focuser until standard input ends, and stop it then."""

    channel = Channel(sys.stdin.fileno(), sys.stdout.fileno())

    def report(state: FocusAxisState) -> None:
        channel.send(msgspec.json.encode(state) + b"\n")

    worker = FocuserDriver(focuser_at(config), config, report)
    decoder = msgspec.json.Decoder(FocusOrder)
    due_s = time.monotonic()
    while not channel.ended:
        select.select([channel], [], [], max(0.0, due_s - time.monotonic()))
        worker.turn(channel.messages(decoder), time.monotonic())
        due_s = max(due_s + TURN_S, time.monotonic())
    if worker.axis is not None:
        with contextlib.suppress(AlpacaRefusalError, NoAnswerError):
            worker.axis.halt()
    return 0


def parse_focuser(url: str) -> FocuserConfig:
    """Read one focuser's address. Raises BadInputError with the fault."""
    try:
        parts = urlsplit(url)
        options = parse_qs(parts.query, keep_blank_values=True, strict_parsing=bool(parts.query))
        port, device = parts.port, int(parts.path.removeprefix("/"))
        unknown = [
            name for name, values in options.items() if name not in {"step", "zero"} or len(values) > 1
        ]
        if parts.scheme != "alpaca" or not parts.hostname or port is None or device < 0 or unknown:
            raise ValueError("that is no focuser's address")
        step_um = float(options["step"][0]) if "step" in options else None
        if step_um is not None and not 0.0 < step_um < 1e6:
            raise ValueError("step is out of range")
        zero_step = int(options["zero"][0]) if "zero" in options else 0
    except ValueError as error:
        raise BadInputError(f"--focus {url}: {error}; write a number, or {FORM}") from error
    host = f"[{parts.hostname}]" if ":" in parts.hostname else parts.hostname
    return FocuserConfig(f"{host}:{port}", device, step_um, zero_step)


@dataclass(slots=True)
class FocusAxisProcess:
    """One axis' process, and the axis as the controller sees it."""

    config: FocuserConfig
    running: PipedProcess
    axis: RemoteAxis
    trouble: str = ""

    @property
    def name(self) -> str:
        """The focuser, as text."""
        return f"the focuser at {self.config.address}, device {self.config.device}"

    def exchange(self, to_ns: Callable[[float], int]) -> str | None:
        """Read states, send orders; return a line for the log."""
        states = self.running.channel.messages(_STATES)
        for one in states:
            self.axis.hear(one, to_ns(one.monotonic_s))
        orders, self.axis.orders = self.axis.orders, []
        self.running.channel.send(b"".join(msgspec.json.encode(order) + b"\n" for order in orders))
        trouble = (
            "it has ended" if self.running.channel.ended else states[-1].trouble if states else self.trouble
        )
        if trouble == self.trouble:
            return None
        self.trouble = trouble
        return f"{self.name}: {trouble or 'is heard again'}"

    def close(self) -> None:
        """End it: it stops its focuser first."""
        self.running.close(END_WITHIN_S)


@dataclass(slots=True)
class FocusProcesses:
    """All axes of one antenna's focuser."""

    parts: Sequence[FocusAxisProcess]
    focuser: Focuser = field(init=False)

    def __post_init__(self) -> None:
        """Join the axes to a focuser."""
        self.focuser = Focuser([part.axis for part in self.parts])

    def exchange(self, to_ns: Callable[[float], int]) -> list[str]:
        """Read states and send orders, without waiting; return log lines. `to_ns` dates monotonic seconds."""
        lines = [part.exchange(to_ns) for part in self.parts]
        return [line for line in lines if line is not None]

    def close(self) -> None:
        """Stop and end all of them."""
        for part in self.parts:
            part.close()


def start_focusers(configs: Sequence[FocuserConfig]) -> FocusProcesses:
    """Start a process for each axis. Raises SattrackError where a focuser cannot be used."""
    started: list[FocusAxisProcess] = []
    try:
        for config in configs:
            started.append(_start(config))
    except SattrackError:
        FocusProcesses(started).close()
        raise
    return FocusProcesses(started)


def _start(config: FocuserConfig) -> FocusAxisProcess:
    running = PipedProcess.start(
        "sattrack.servers.antenna.alpaca_focuser", msgspec.json.encode(config).decode()
    )
    part = FocusAxisProcess(config, running, RemoteAxis(0.0, 0.0))
    lines = running.channel.first(START_WITHIN_S)
    first = _STATES.decode(lines[0]) if lines else None
    if first is None or first.mm is None:
        part.close()
        raise SattrackError(f"{part.name}: {first.trouble if first is not None else 'it does not answer'}")
    part.axis = RemoteAxis(first.least_mm, first.most_mm)
    return part


if __name__ == "__main__":
    sys.exit(main(msgspec.json.decode(sys.argv[1], type=FocuserConfig)))
