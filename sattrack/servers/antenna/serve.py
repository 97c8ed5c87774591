"""`sattrack serve antenna`: its loop, its TCP port or serial line, and addresses of other controllers.

The server only responds; a position status is latched when its bytes are read. A second caller on TCP is
disconnected before a byte is sent, so that two Field Systems cannot drive one antenna, unless the first has
fallen silent; a serial line has one caller. `--mount antenna://HOST:PORT` and `antenna:///dev/ttyUSB0` name a
controller that sattrack drives.
"""

from __future__ import annotations

import contextlib
import math
import os
import re
import socket
import time
from dataclasses import dataclass, field
from itertools import islice
from typing import TYPE_CHECKING, Any, Protocol, get_args
from urllib.parse import parse_qs, urlsplit

from sattrack.core.errors import BadInputError, LinkLostError, SattrackError, how_to_install
from sattrack.runtime.callers import MOST_WAITING_BYTES, READ_BYTES, CallerLimits, Opening, Seat, TcpChannel
from sattrack.runtime.loop import StationLoop
from sattrack.servers.antenna.protocol import (
    NAK_MEANINGS,
    NS,
    TCP_CHARACTER_TIME_OUT_S,
    Checksum,
    character_time_out_s,
    operator_line,
    program_line,
    refusal_line,
    to_ns,
)
from sattrack.servers.antenna.trajectory import AxisKind
from sattrack.views.run import (
    LONGEST_SHOWN,
    SHOWN_EXCHANGES,
    SHOWN_REFUSALS,
    AntennaView,
    AxesView,
    ExchangeView,
    FocusView,
    RefusalView,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from sattrack.servers.antenna.alpaca_focuser import FocusProcesses
    from sattrack.servers.antenna.controller import AntennaStation

LEAVE = "leave"
WORDS = ("local", "remote", "stop", "reset", "last", LEAVE)
SHOW_EVERY_TICKS = 5
MOST_REFUSALS_LOGGED = 5
"""Refusals logged in one tick; more are counted."""
REOPEN_EVERY_S = 2.0
EMPTY_READS = 10
"""A line that is readable so many times in a row, and gives nothing, is gone."""
BAUDS = (9600, 19200, 38400, 57600, 115200)
DEFAULT_FRAMING = "7E1"
_FRAMING = re.compile(r"([5-8])([NEOMS])(1|1\.5|2)")
ONE_CALLER = CallerLimits(callers=1, elsewhere_s=60.0)
Response = tuple[bytes, bool]
"""The bytes to send, and whether to drop unsent output."""
CONNECT_WITHIN_S = 3.0
FORMS = "antenna://HOST:PORT or antenna:///dev/ttyUSB0, with ?axes=azel, ?rate=10 and the like"
OPTIONS = ("axes", "check", "rate", "timing", "baud", "framing")
MOST_RATE_HZ = 10.0


@dataclass(slots=True)
class AntennaLoop(StationLoop):
    """Serves one station until `stop` is set and the mount is seen at rest.

    `typed_words` returns the operator's words since the last call.
    """

    driver: AntennaStation
    server: AntennaServer
    typed_words: Callable[[], Sequence[str]]
    where: str = ""
    """The address of the server, as text."""
    show: Callable[[AntennaView], None] | None = None
    """Takes a view a few times a second; must not wait."""
    focus: FocusProcesses | None = None
    """The focuser, where it is not simulated."""
    _logged_refusals: int = field(default=0, init=False)
    _logged_caller: bool = field(default=False, init=False)
    _logged_disconnected: int = field(default=0, init=False)
    _logged_foreign: int = field(default=0, init=False)

    def tell(self, words: str) -> None:
        """See StationLoop."""
        self.log(program_line(words))

    def serve(self, ready: list[Any]) -> None:
        """Serve antcn."""
        if self.server.serve(ready, self.connection.now_utc_s, self.driver.receive_command):
            self.driver.controller.hang_up()
            self._logged_caller = False
            self.tell("antcn is gone; the trajectory in force stays")

    def obey(self, now_utc_s: float) -> None:
        """Serve the serial line, the focuser and the operator's words."""
        del now_utc_s
        if self.server.reopen_lost(time.monotonic()):
            self._logged_caller = True
            self.tell("the serial line is there again")
        if self.focus is not None:
            for line in self.focus.exchange(self._at_ns):
                self.tell(line)
        for word in self.typed_words():
            self._handle_word(word)

    def _at_ns(self, monotonic_s: float) -> int:
        """Return an instant by the antenna's clock."""
        return to_ns(self.connection.clock.utc_s(monotonic_s) + self.driver.clock_ahead_s)

    def _handle_word(self, word: str) -> None:
        """Carry out a word typed at the controller's console."""
        controller, now_ns = self.driver.controller, self._at_ns(time.monotonic())
        if word:
            self.log(operator_line(word))
        if word in {"local", "remote"}:
            controller.switch(word == "remote", now_ns)
            self.tell(f"the controller is in {word}")
        elif word == "last":
            for exchange in controller.exchanges:
                self.tell(f"{exchange.received} -> {exchange.answered}")
        elif word == "stop":
            controller.stop(now_ns)
            self.tell("the operator has ended the trajectory; remote lets antcn go on with it")
        elif word == "reset":
            controller.reset()
        elif word == LEAVE:
            self.driver.end(self.connection.now_utc_s())
        elif word:
            self.tell(f"{word!r} is not a word of this console: {', '.join(WORDS)}")

    def _show(self) -> None:
        if self.show is not None:
            self.show(self.view())

    def view(self) -> AntennaView:
        """Return the view of the controller's console."""
        station, controller = self.driver, self.driver.controller
        now_utc_s = self.connection.now_utc_s()
        at_ns = self._at_ns(time.monotonic())
        states = (controller.commanded(at_ns), station.actual(at_ns))
        commanded, actual = (None if s is None else AxesView(s.first_deg, s.second_deg) for s in states)
        return AntennaView(
            utc_s=now_utc_s,
            door=self.where,
            caller=self.server.channel is not None,
            axes=station.antenna.axes,
            mount="sim" if self.connection.simulated is not None else str(self.connection.link.address),
            link_up=station.link_up,
            remote=controller.remote,
            doing=controller.doing.value,
            servo=controller.servo,
            outside_limits=station.outside_limits,
            tripped=station.tripped,
            commanded=commanded,
            actual=actual,
            refused=controller.refused,
            exchanges=tuple(
                ExchangeView(e.utc_ns / NS, e.received[:LONGEST_SHOWN], e.answered[:LONGEST_SHOWN])
                for e in islice(reversed(controller.exchanges), SHOWN_EXCHANGES)
            ),
            refusals=tuple(
                RefusalView(e.utc_ns / NS, e.received[:LONGEST_SHOWN], NAK_MEANINGS[e.refused])
                for e in islice(reversed(controller.refusals), SHOWN_REFUSALS)
                if e.refused is not None
            ),
            focus=self._focus_view(at_ns),
        )

    def _focus_view(self, at_ns: int) -> FocusView | None:
        focuser = self.driver.antenna.focuser
        if focuser is None:
            return None
        report = focuser.report(at_ns)
        return FocusView(tuple(place.actual_mm for place in report.axes), report.moving)

    def report(self) -> None:
        """Log what has changed: refusals, callers, interlocks, the link."""
        self._report_refusals()
        self._report_callers()
        self.report_mount("trajectory", "RESET")
        if self.ticks % SHOW_EVERY_TICKS == 0:
            self._show()

    def _report_refusals(self) -> None:
        controller = self.driver.controller
        count = controller.refused - self._logged_refusals
        if count == 0:
            return
        self._logged_refusals = controller.refused
        recent = [(e, e.refused) for e in controller.refusals if e.refused is not None]
        recent = recent[-min(count, MOST_REFUSALS_LOGGED) :]
        for exchange, why in recent:
            self.log(refusal_line(exchange, why))
        if count > len(recent):
            self.tell(f"{count - len(recent)} more were refused")

    def _report_callers(self) -> None:
        caller = self.server.channel is not None
        if caller and not self._logged_caller:
            self.tell("antcn is there")
        self._logged_caller = caller
        if self.server.disconnected != self._logged_disconnected:
            self._logged_disconnected = self.server.disconnected
            self.tell("a second caller was disconnected: one antenna, one antcn")
        if self.server.foreign != self._logged_foreign:
            self._logged_foreign = self.server.foreign
            self.tell("a caller that speaks HTTP or TLS was disconnected")


@dataclass(slots=True)
class AntennaServer:
    """A listening socket with its caller, or a serial line."""

    listener: socket.socket | None = None
    channel: CallerLine | None = None
    reopen: Callable[[], CallerLine] | None = None
    """Opens the serial line again after its loss."""
    limits: CallerLimits = ONE_CALLER
    disconnected: int = 0
    """Callers that were refused because another was connected."""
    foreign: int = 0
    """Callers that were disconnected because they spoke HTTP or TLS."""
    _seat: Seat | None = None
    """None on a serial line."""
    _opening: Opening = field(default_factory=lambda: Opening(by_lines=True))
    _next_try_s: float = 0.0
    _waiting: bytes = b""

    @property
    def port(self) -> int | None:
        """The TCP port; None on a serial line."""
        return None if self.listener is None else int(self.listener.getsockname()[1])

    def readers(self) -> list[Any]:
        """See StationLoop."""
        return [part for part in (self.listener, self.channel) if part is not None]

    def writers(self) -> list[Any]:
        """See StationLoop."""
        return [self.channel] if self.channel is not None and self._waiting else []

    def serve(
        self, ready: list[Any], now: Callable[[], float], answer: Callable[[bytes, float], Response]
    ) -> bool:
        """Serve what is ready; return whether the caller has gone meanwhile.

        `now` is read as soon as the bytes are here: that is the instant at which their line-feed came.
        """
        gone = False
        if self.channel is not None and self.channel in ready:
            data = self._read(self.channel)
            came_s = now()
            if data is None:
                gone = True
                self._hang_up()
            elif data:
                self._send(*answer(data, came_s))
        if self.listener is not None and self.listener in ready:
            gone = self._accept(self.listener) or gone
        return gone

    def flush(self) -> None:
        """See StationLoop."""
        if self.channel is not None and self._waiting:
            self._waiting = self._waiting[self.channel.write(self._waiting) :]

    def close(self) -> None:
        """Close everything."""
        for part in (self.channel, self.listener):
            if part is not None:
                part.close()
        self.channel = self.listener = None

    def _send(self, data: bytes, drop: bool) -> None:
        if drop and self.channel is not None:
            self._waiting = b""
            self.channel.drop_output()
        self._waiting += data
        self.flush()
        if len(self._waiting) > MOST_WAITING_BYTES:
            self._hang_up()

    def _read(self, channel: CallerLine) -> bytes | None:
        """Return the bytes that have come; None where the caller is gone, or speaks HTTP or TLS."""
        data = channel.read()
        if not data or self._seat is None:
            return data
        self._seat = self._seat._replace(asked_s=time.monotonic())
        accepted = self._opening.take(data)
        self.foreign += accepted is None
        return accepted

    def _accept(self, listener: socket.socket) -> bool:
        """Accept a caller where there is room; return whether another had to go."""
        try:
            connection, (address, *_) = listener.accept()
        except OSError:
            return False
        now_s = time.monotonic()
        seats = {} if self._seat is None else {0: self._seat}
        objection, makes_room = self.limits.admit(address, seats, now_s)
        if objection is not None:
            self.disconnected += 1
            connection.close()
            return False
        if makes_room:
            self._hang_up()
        self.channel, self._seat = TcpChannel(connection), Seat(address, -math.inf, now_s)
        self._opening = Opening(by_lines=True)
        return bool(makes_room)

    def _hang_up(self) -> None:
        assert self.channel is not None
        self.channel.close()
        self._waiting = b""
        self.channel = self._seat = None

    def reopen_lost(self, monotonic_s: float) -> bool:
        """Reopen a lost serial line, now and then; return whether it is open again."""
        if self.channel is not None or self.reopen is None or monotonic_s < self._next_try_s:
            return False
        self._next_try_s = monotonic_s + REOPEN_EVERY_S
        try:
            self.channel = self.reopen()
        except SattrackError:
            return False
        return True


class CallerLine(Protocol):
    """The byte stream of one caller."""

    def fileno(self) -> int:
        """Return the descriptor to wait on."""

    def read(self) -> bytes | None:
        """Return the bytes that have come, without waiting; None where the caller is gone."""

    def write(self, data: bytes) -> int:
        """Send without waiting; return how many bytes were sent."""

    def drop_output(self) -> None:
        """Drop unsent output of the operating system, where possible."""

    def close(self) -> None:
        """Hang up."""


class SerialChannel:
    """A serial line, or anything that is a terminal to the system.

    Raises BadInputError where pyserial is not installed or the settings are wrong, SattrackError where the
    line cannot be opened.
    """

    def __init__(self, device: str, baud: int, framing: str = DEFAULT_FRAMING) -> None:
        try:
            import serial
        except ImportError as error:
            raise BadInputError(f"serial lines need pyserial: {how_to_install('serial')}") from error
        found = _FRAMING.fullmatch(framing)
        if found is None:
            raise BadInputError(f"framing {framing!r}: write bits, parity, stop bits, as 7E1 or 8N1")
        bits, parity, stops = found.groups()
        try:
            self._line: Any = serial.Serial(
                device, baud, int(bits), parity, float(stops), timeout=0, write_timeout=0, exclusive=True
            )
        except ValueError as error:
            raise BadInputError(f"{device}: {error}") from error
        except serial.SerialException as error:
            raise SattrackError(
                f"{device} cannot be opened: {_reason(error)}; check the name and the cable, and that "
                "no other program has it open"
            ) from error
        self._empty = 0
        self._check_parity(parity)

    def _check_parity(self, parity: str) -> None:
        """Turn characters with a wrong parity into zero bytes, which no message holds."""
        if parity == "N":
            return
        try:
            import termios
        except ImportError:
            return
        with contextlib.suppress(termios.error):
            state = termios.tcgetattr(self._line.fileno())
            state[0] = (state[0] | termios.INPCK) & ~(termios.IGNPAR | termios.PARMRK)
            termios.tcsetattr(self._line.fileno(), termios.TCSANOW, state)

    def fileno(self) -> int:
        """See CallerLine."""
        number: int = self._line.fileno()
        return number

    def read(self) -> bytes | None:
        """See CallerLine."""
        try:
            data = os.read(self.fileno(), READ_BYTES)
        except BlockingIOError:
            return b""
        except OSError:
            return None
        self._empty = 0 if data else self._empty + 1
        return data if self._empty < EMPTY_READS else None

    def write(self, data: bytes) -> int:
        """See CallerLine."""
        try:
            return os.write(self.fileno(), data)
        except BlockingIOError:
            return 0
        except OSError:
            return len(data)

    def drop_output(self) -> None:
        """See CallerLine."""
        with contextlib.suppress(OSError):
            self._line.reset_output_buffer()

    def close(self) -> None:
        """See CallerLine."""
        self._line.close()


def _reason(error: Exception) -> str:
    number = getattr(error, "errno", None)
    return str(error) if number is None else os.strerror(number)


@dataclass(frozen=True, slots=True)
class AntennaUrl:
    """One controller's address: `host` and `port`, or `device` with its settings."""

    text: str
    axes: AxisKind
    check: Checksum
    interval_s: float
    """Between trajectory designations."""
    per_character: bool = False
    """Whether every character of a response has its own time-out."""
    host: str = ""
    port: int = 0
    device: str | None = None
    baud: int = BAUDS[0]
    framing: str = DEFAULT_FRAMING

    @property
    def character_s(self) -> float:
        """The character time-out of the line."""
        return TCP_CHARACTER_TIME_OUT_S if self.device is None else character_time_out_s(self.baud)

    def connect(self) -> CallerLine:
        """Return a line to the controller. Raises LinkLostError, SattrackError or BadInputError."""
        if self.device is not None:
            return SerialChannel(self.device, self.baud, self.framing)
        try:
            return TcpChannel(socket.create_connection((self.host, self.port), CONNECT_WITHIN_S))
        except OSError as error:
            raise LinkLostError(
                f"no antenna controller at {self.host}:{self.port}: {error.strerror or error}"
            ) from error


def parse_antenna_url(url: str) -> AntennaUrl:
    """Read `--mount antenna:...`. Raises BadInputError with the fault."""
    try:
        parts = urlsplit(url)
        options = parse_qs(parts.query, keep_blank_values=True, strict_parsing=bool(parts.query))
        host, port = parts.hostname or "", parts.port
    except ValueError as error:
        raise BadInputError(f"--mount {url}: {error}; write {FORMS}") from error
    for name, values in options.items():
        if name not in OPTIONS or len(values) != 1:
            raise BadInputError(
                f"--mount {url}: {name} is not understood; there are {', '.join(OPTIONS)}, once"
            )
    given = {name: values[0] for name, values in options.items()}
    on_line = not host and parts.path not in {"", "/"}
    if not on_line and (not host or not port or parts.path not in {"", "/"}):
        raise BadInputError(f"--mount {url}: write {FORMS}")
    axes = _one_of(url, given, "axes", get_args(AxisKind))
    check = Checksum.CRC16 if _one_of(url, given, "check", ("sum", "crc")) == "crc" else Checksum.SUM
    baud = int(_one_of(url, given, "baud", tuple(str(b) for b in BAUDS)))
    if not on_line and ("baud" in given or "framing" in given):
        raise BadInputError(f"--mount {url}: baud and framing are of serial lines")
    return AntennaUrl(
        text=url.partition("?")[0],
        axes="azel" if axes == "azel" else "hadec",
        check=check,
        interval_s=1.0 / _rate_hz(url, given),
        per_character=_one_of(url, given, "timing", ("transaction", "character")) == "character",
        host=host,
        port=port or 0,
        device=parts.path if on_line else None,
        baud=baud,
        framing=given.get("framing", DEFAULT_FRAMING),
    )


def _one_of(url: str, given: Mapping[str, str], name: str, words: tuple[str, ...]) -> str:
    value = given.get(name, words[0])
    if value not in words:
        raise BadInputError(f"--mount {url}: {name} is {value!r}; it is one of {', '.join(words)}")
    return value


def _rate_hz(url: str, given: Mapping[str, str]) -> float:
    text = given.get("rate", "1")
    try:
        rate_hz = float(text)
    except ValueError:
        rate_hz = 0.0
    if not 0.1 <= rate_hz <= MOST_RATE_HZ:
        raise BadInputError(
            f"--mount {url}: rate is {text!r}; designations a second, 0.1 to {MOST_RATE_HZ:g}"
        )
    return rate_hz
