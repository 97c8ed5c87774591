"""The antenna interface on the line: commands and responses as one table, their framing, epochs, log lines.

"Ideal Field System Antenna Interface", sections 3.0 and 4.0. Every command has one response. A message is
text, a trailing space, a checksum and a line-feed; fields are separated by blanks, two commas stand for one
that is left out. The table drives the parser, the documentation and the tests. Instants are whole nanoseconds
of UTC since 1970, so that an epoch given to a microsecond stays what it is.

Log lines have the Field System's style: year, day of the year, time, a sign for the kind, text. A program's
text follows its name between two `#`, an operator's follows `;`. Errors begin with `?ERROR`, two letters and
a negative number: here the number after NAK.
"""

from __future__ import annotations

import binascii
import re
from dataclasses import dataclass, field
from datetime import UTC, datetime
from decimal import Decimal
from enum import Enum, IntEnum
from typing import Literal

SYNC = b"#"
END = b"\n"
LONGEST_MESSAGE = 200
"""Characters of a message with its trailing space and check: twice what the longest command takes."""
TIME_OUT_S = 0.5
"""A response must come within this time: section 4.0's upper bound."""
CHARACTER_TIMES = 3.0
"""A character time-out, in times that one character takes on the line: section 4.0, "2-3 times"."""
TCP_CHARACTER_TIME_OUT_S = 0.05
"""The character time-out on a network, where characters come in packets."""
OMITTED = ",,"
UNKNOWN_WORD = "??"
"""The word of a response to a line whose command cannot be read."""
_NUMBER = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]{1,3})?")
NS = 1_000_000_000
DAY_S = 86400
MIDNIGHT_WINDOW_S = 100
LONGEST_SECOND = 1
"""A day that ends with a leap second has an 86400th."""
MOST_EPOCH_DISTANCE_S = 3600
"""An epoch further from now is refused."""
PROGRAM = "antenna"
ERRORS = "AN"


class Nak(IntEnum):
    """The reason of a refusal: the small integer after NAK."""

    TRANSMISSION = 1
    TOO_LONG = 2
    UNKNOWN = 3
    FIELDS = 4
    VALUE = 5
    RANGE = 6
    EPOCH = 7
    LOCAL = 8
    NOT_AVAILABLE = 9
    STATE = 10
    ELEMENTS_LINE = 11
    ELEMENTS_NUMBER = 12
    ELEMENTS_CHECK = 13
    ELEMENTS_USELESS = 14
    ELEMENTS_MISSING = 15


NAK_MEANINGS = {
    Nak.TRANSMISSION: "transmission error: parity, a character that no message may hold, or the check",
    Nak.TOO_LONG: "the line is too long",
    Nak.UNKNOWN: "no such command; commands are in upper case",
    Nak.FIELDS: "a field is missing, or there are too many",
    Nak.VALUE: "a field is no number, not whole where it must be, or none of the words that may stand there",
    Nak.RANGE: "a number is out of its range",
    Nak.EPOCH: "the epoch is further than an hour from now",
    Nak.LOCAL: "the controller is in local, its operator has stopped the antenna, or the service ends",
    Nak.NOT_AVAILABLE: "this antenna does not have that",
    Nak.STATE: "not now: the antenna is stowed (UNSTOW first), a trajectory is in force (STOP first), or the "
    "focuser is not heard",
    Nak.ELEMENTS_LINE: "an element line does not begin with its number",
    Nak.ELEMENTS_NUMBER: "the catalogue number is not that of the elements",
    Nak.ELEMENTS_CHECK: "an element line's own check-sum is wrong",
    Nak.ELEMENTS_USELESS: "the elements cannot be read, or the satellite has decayed",
    Nak.ELEMENTS_MISSING: "no elements, or not all of them, have been sent",
}


@dataclass(frozen=True, slots=True)
class CommandField:
    """One field of a command: a number within bounds, one of some words, or the rest of the message."""

    name: str
    meaning: str
    kind: Literal["number", "word", "text"] = "number"
    least: float = 0.0
    most: float = 0.0
    words: tuple[str, ...] = ()
    whole: bool = False
    """Whether a number must be a whole one."""
    optional: bool = False
    """Whether two commas, or nothing at the end, may stand in its place."""


@dataclass(frozen=True, slots=True)
class AntennaCommand:
    """One command: its word, its fields, whether it commands the antenna, and its response."""

    word: str
    meaning: str
    fields: tuple[CommandField, ...] = ()
    commands_antenna: bool = True
    """Whether it is refused in local."""
    answer: str = "ACK"


def _angle(name: str, meaning: str) -> CommandField:
    return CommandField(name, meaning, least=-720.0, most=720.0)


def _rate(name: str, meaning: str) -> CommandField:
    return CommandField(name, meaning, least=-100.0, most=100.0, optional=True)


WRAP = CommandField(
    "wrap",
    "number of the first axis' wrap, from -9 to 9, or S for the shortest way (so too where it is left out)",
    kind="word",
    words=("S", *(str(n) for n in range(-9, 10))),
    optional=True,
)
FRAMES = CommandField(
    "frame", "DATE: true equator and equinox of date; J2000: mean ones", "word", words=("DATE", "J2000")
)
RA = CommandField("ra", "right ascension, degrees", least=-360.0, most=360.0)
DEC = CommandField("dec", "declination, degrees", least=-90.0, most=90.0)
CATALOGUE = CommandField("number", "catalogue number", least=0, most=999_999_999, whole=True)
EPOCH = CommandField("epoch", "seconds of the UTC day", least=0.0, most=86401.0, optional=True)
COMMANDS = (
    AntennaCommand(
        "TD",
        "trajectory designate: be at these positions at the epoch, and go on with these rates",
        (
            _angle("first", "position of the first axis, degrees"),
            _angle("second", "position of the second axis, degrees"),
            _rate("first_rate", "rate of the first axis, degrees a second; left out: 0"),
            _rate("second_rate", "rate of the second axis, degrees a second; left out: 0"),
            EPOCH,
            WRAP,
        ),
    ),
    AntennaCommand(
        "PS",
        "position status",
        commands_antenna=False,
        answer="first and second axis commanded, then actual, degrees; their four rates; wraps commanded and "
        "actual; epoch, seconds of the UTC day; REMOTE or LOCAL; IDLE, SLEWING or TRACKING",
    ),
    AntennaCommand(
        "STATUS",
        "status in detail",
        commands_antenna=False,
        answer="REMOTE or LOCAL; what the antenna does; LINK-UP or LINK-DOWN; the interlock that stopped it, "
        "or OK; 1 where the trajectory is outside the limits, else 0; number of the last refusal, or 0",
    ),
    AntennaCommand("STOP", "end the trajectory and bring the antenna to rest"),
    AntennaCommand("STOW", "go to the stow position, and take no trajectory until UNSTOW"),
    AntennaCommand("UNSTOW", "take trajectories again"),
    AntennaCommand("SERVICE", "go to the service position"),
    AntennaCommand("RESET", "be ready again after an interlock has stopped the antenna"),
    AntennaCommand(
        "PINS", "insert or remove the stow pins", (CommandField("do", "", "word", words=("IN", "OUT")),)
    ),
    AntennaCommand(
        "BRAKES", "set or release the brakes", (CommandField("do", "", "word", words=("SET", "RELEASE")),)
    ),
    AntennaCommand(
        "SENSORS",
        "tilt and other sensors",
        commands_antenna=False,
        answer="tilts about both axes, degrees; currents of both axes' drives, A; epoch",
    ),
    AntennaCommand(
        "TIME",
        "the controller's time; with fields, sets it as of the line-feed, while nothing is followed",
        (
            CommandField(
                "day", "day to set, days since 1970-01-01", least=0, most=99999, whole=True, optional=True
            ),
            CommandField("seconds", "seconds of that day to set", least=0.0, most=86400.0, optional=True),
        ),
        commands_antenna=False,
        answer="days since 1970-01-01; seconds of the UTC day, latched; ACK where it was set",
    ),
    AntennaCommand(
        "FOCUS",
        "move the focus, all axes at once",
        tuple(
            CommandField(
                f"axis{n}",
                f"position of axis {n}, mm; left out: as it is",
                least=-1e4,
                most=1e4,
                optional=True,
            )
            for n in (1, 2, 3)
        ),
    ),
    AntennaCommand(
        "FOCSWEEP",
        "move one axis of the focus from limit to limit and back, again and again, at a uniform rate",
        (
            CommandField("axis", "which axis, from 1", least=1, most=3, whole=True),
            CommandField("rate", "mm a second", least=0.001, most=100.0),
        ),
    ),
    AntennaCommand("FOCSTOP", "stop the focus"),
    AntennaCommand(
        "FOCPS",
        "focus position status",
        commands_antenna=False,
        answer="commanded and actual position of each axis, mm; epoch; MOVING or STOPPED",
    ),
    AntennaCommand(
        "RADEC",
        "follow a source: topocentric coordinates of date, or mean ones of J2000 (ICRS)",
        (FRAMES, RA, DEC, WRAP),
    ),
    AntennaCommand(
        "FIXED",
        "stand at a fixed direction of the antenna's own axes",
        (
            _angle("first", "position of the first axis, degrees"),
            _angle("second", "position of the second axis, degrees"),
            WRAP,
        ),
    ),
    AntennaCommand(
        "FIXSKY",
        "stand where a source is, or was, at one instant",
        (FRAMES, RA, DEC, EPOCH, WRAP),
    ),
    AntennaCommand(
        "OFFSET",
        "set the offsets of one kind, added to the coordinates themselves; for all but TD",
        (
            CommandField("kind", "which coordinates", "word", words=("AZEL", "HADEC", "RADEC")),
            CommandField(
                "first", "degrees of azimuth, hour angle or right ascension", least=-10.0, most=10.0
            ),
            CommandField("second", "degrees of elevation or declination", least=-10.0, most=10.0),
        ),
    ),
    AntennaCommand(
        "POINTING",
        "set the pointing model, degrees; for all but TD; all 0 takes it away",
        tuple(
            CommandField(name, meaning, least=-5.0, most=5.0)
            for name, meaning in (
                ("ih", "index error of the hour angle"),
                ("id", "index error of the declination"),
                ("ch", "collimation"),
                ("np", "axes not at right angles"),
                ("ma", "polar axis turned about the vertical"),
                ("me", "polar axis too high or low"),
            )
        ),
    ),
    AntennaCommand(
        "SKY",
        "where on the sky the axes point, by the pointing model turned round",
        commands_antenna=False,
        answer="right ascension and declination of date, azimuth and elevation, degrees; epoch",
    ),
    AntennaCommand(
        "TLE",
        "one line of a satellite's elements: 0 its name, 1 and 2 the element lines",
        (
            CommandField("line", "which line", "word", words=("0", "1", "2")),
            CATALOGUE,
            CommandField("text", "the line", "text"),
        ),
        commands_antenna=False,
    ),
    AntennaCommand(
        "OMM",
        "one value of a satellite's elements, by its keyword in the CCSDS Orbit Mean-elements Message",
        (CATALOGUE, CommandField("keyword", "as EPOCH", "text"), CommandField("value", "its value", "text")),
        commands_antenna=False,
    ),
    AntennaCommand("SAT", "follow the satellite whose elements were sent last", (CATALOGUE, WRAP)),
    AntennaCommand(
        "SATOFF",
        "biases of the satellite",
        (
            CommandField("along", "seconds along the track, positive leads", least=-60.0, most=60.0),
            CommandField(
                "cross", "degrees across, positive to the left as you face its motion", least=-5.0, most=5.0
            ),
            CommandField(
                "mode",
                "TRACK, also where left out, or HOLD: stand where that is now",
                "word",
                words=("TRACK", "HOLD"),
                optional=True,
            ),
        ),
    ),
)
BY_WORD = {command.word: command for command in COMMANDS}


@dataclass(frozen=True, slots=True)
class AntennaRequest:
    """A well-formed command: its values by the names of its fields, None where one is left out."""

    command: AntennaCommand
    values: dict[str, Decimal | str | None]

    def number(self, name: str, otherwise: float = 0.0) -> float:
        """Return a number, or `otherwise` where it is left out."""
        value = self.values[name]
        return otherwise if value is None else float(value)

    def exact(self, name: str) -> Decimal:
        """Return a number to its last digit; 0 where it is left out."""
        value = self.values[name]
        return value if isinstance(value, Decimal) else Decimal(0)

    def text(self, name: str, otherwise: str = "") -> str:
        """Return a word or a text, or `otherwise` where it is left out."""
        value = self.values[name]
        return otherwise if value is None else str(value)


@dataclass(frozen=True, slots=True)
class RefusedCommand:
    """A command that is refused: the first word of the response, and the reason."""

    word: str
    why: Nak

    @property
    def message(self) -> str:
        """The response."""
        return f"{self.word} NAK {self.why.value}"


def parse(message: str) -> AntennaRequest | RefusedCommand:
    """Return the request of a message, or its refusal."""
    parts = message.split(None, 1)
    command = BY_WORD.get(parts[0]) if parts else None
    if command is None:
        return RefusedCommand(UNKNOWN_WORD, Nak.UNKNOWN)
    texts = _fields(parts[1] if len(parts) > 1 else "", command)
    if len(texts) > len(command.fields):
        return RefusedCommand(command.word, Nak.FIELDS)
    values: dict[str, Decimal | str | None] = {}
    left_out = [OMITTED] * (len(command.fields) - len(texts))
    for spec, text in zip(command.fields, texts + left_out, strict=True):
        value = _value(spec, text)
        if isinstance(value, Nak):
            return RefusedCommand(command.word, value)
        values[spec.name] = value
    return AntennaRequest(command, values)


def _fields(text: str, command: AntennaCommand) -> list[str]:
    if command.fields and command.fields[-1].kind == "text":
        return text.split(None, len(command.fields) - 1)
    return text.split()


def _value(field: CommandField, text: str) -> Decimal | str | Nak | None:
    if text == OMITTED:
        return None if field.optional else Nak.FIELDS
    if field.kind == "text":
        return text
    if field.kind == "word":
        return text if text in field.words else Nak.VALUE
    if not _NUMBER.fullmatch(text):
        return Nak.VALUE
    number = Decimal(text)
    if not field.least <= number <= field.most:
        return Nak.RANGE
    return Nak.VALUE if field.whole and number != number.to_integral_value() else number


def acknowledge(word: str) -> str:
    """Return the response to a command that was accepted."""
    return f"{word} ACK"


def word_of(message: str) -> str:
    """Return the first word of the response to a command that may be faulty."""
    first = message.split(" ", 1)[0]
    return first if first in BY_WORD else UNKNOWN_WORD


class Checksum(Enum):
    """The check of a message; the value is the number of its hexadecimal digits."""

    SUM = 2
    CRC16 = 4

    def of(self, message: bytes) -> bytes:
        """Return the checksum of a message with its trailing space, in upper case."""
        if self is Checksum.SUM:
            return b"%02X" % (sum(message) & 0xFF)
        return b"%04X" % binascii.crc_hqx(message, 0xFFFF)


class LineFault(Enum):
    """The fault of a line that came."""

    TRANSMISSION = "transmission error"
    TOO_LONG = "too long"


@dataclass(frozen=True, slots=True)
class ReceivedLine:
    """One line that came: its message without the trailing space, or the readable part of a faulty one."""

    message: str
    fault: LineFault | None = None


@dataclass(frozen=True, slots=True)
class Synchronised:
    """The synchronisation character came: unfinished messages in either direction are void."""


@dataclass(slots=True)
class Framer:
    """Cuts received bytes into lines; skips empty ones. No input raises."""

    check: Checksum = Checksum.SUM
    _pending: bytearray = field(default_factory=bytearray)
    _overlong: bool = False

    def receive(self, data: bytes) -> list[ReceivedLine | Synchronised]:
        """Return the complete lines and the synchronisations, in the order of arrival."""
        events: list[ReceivedLine | Synchronised] = []
        for byte in data:
            if byte == SYNC[0]:
                self.reset()
                events.append(Synchronised())
            elif byte == END[0]:
                line = self._finish()
                if line is not None:
                    events.append(line)
            elif len(self._pending) < LONGEST_MESSAGE:
                self._pending.append(byte)
            else:
                self._overlong = True
        return events

    def reset(self) -> None:
        """Forget the unfinished line."""
        self._pending.clear()
        self._overlong = False

    def _finish(self) -> ReceivedLine | None:
        raw, overlong = bytes(self._pending), self._overlong
        self.reset()
        if not raw:
            return None
        if overlong:
            return ReceivedLine(_readable(raw), LineFault.TOO_LONG)
        digits = self.check.value
        body, check = raw[:-digits], raw[-digits:]
        good = body.endswith(b" ") and check.upper() == self.check.of(body)
        if not good or not all(_is_message_byte(b) for b in body):
            return ReceivedLine(_readable(raw), LineFault.TRANSMISSION)
        return ReceivedLine(body[:-1].decode("ascii"))


def encode(message: str, check: Checksum = Checksum.SUM) -> bytes:
    """Return a message as it goes on the line. Raises ValueError for a character that no message may hold."""
    if not all(_is_message_byte(ord(c)) for c in message):
        raise ValueError(f"{message!r} holds a character that no message may hold")
    body = message.encode("ascii") + b" "
    return body + check.of(body) + END


def _is_message_byte(byte: int) -> bool:
    return 0x20 <= byte <= 0x7E and byte != SYNC[0]


def _readable(raw: bytes) -> str:
    return "".join(chr(b) if _is_message_byte(b) else "?" for b in raw)


def character_time_out_s(baud: int) -> float:
    """Return the character time-out of a serial line, seconds; a character takes 10 bits, 7E1 or 8N1."""
    return CHARACTER_TIMES * 10 / baud


def idle_time_s(character_s: float) -> float:
    """Return the silence that shows an idle line after a synchronisation: two character time-outs."""
    return 2.0 * character_s


def resolve_epoch(seconds: Decimal, now_ns: int) -> int:
    """Return the instant of seconds of the UTC day that are received at `now_ns`.

    In the first 100 s of a day, the last 100 s are those of the day before; in the last 100 s, the first are
    those of the day after. Raises ValueError for seconds outside a day.
    """
    if not 0 <= seconds < DAY_S + LONGEST_SECOND:
        raise ValueError(f"{seconds} is no second of a day")
    start_ns = day_start_ns(now_ns)
    elapsed_s = second_of_day(now_ns)
    if elapsed_s < MIDNIGHT_WINDOW_S and seconds >= DAY_S - MIDNIGHT_WINDOW_S:
        start_ns -= DAY_S * NS
    elif elapsed_s >= DAY_S - MIDNIGHT_WINDOW_S and seconds < MIDNIGHT_WINDOW_S:
        start_ns += DAY_S * NS
    return start_ns + int((seconds * NS).to_integral_value())


def second_of_day(utc_ns: int) -> Decimal:
    """Return the seconds since the UTC midnight before, exactly."""
    return Decimal(utc_ns % (DAY_S * NS)) / NS


def day_start_ns(utc_ns: int) -> int:
    """Return the UTC midnight before an instant."""
    return utc_ns - utc_ns % (DAY_S * NS)


def to_ns(utc_s: float) -> int:
    """Return POSIX seconds as whole nanoseconds, at a whole microsecond: floats know no less."""
    return round(utc_s * 1e6) * 1000


def log_stamp(utc_s: float) -> str:
    """Return an instant (POSIX seconds) to a hundredth of a second, cut off."""
    at = datetime.fromtimestamp(utc_s, UTC)
    return f"{at:%Y.%j.%H:%M:%S}.{at.microsecond // 10000:02d}"


def program_line(text: str, program: str = PROGRAM) -> str:
    """Return a log line of the program, without the instant."""
    return f"#{program}#{text}"


def operator_line(text: str) -> str:
    """Return a log line of the operator, without the instant."""
    return f";{text}"


@dataclass(frozen=True, slots=True)
class Exchange:
    """One line that came, and its response."""

    utc_ns: int
    received: str
    answered: str
    refused: Nak | None = None


def refusal_line(exchange: Exchange, why: Nak) -> str:
    """Return the log line of a refusal, without the instant."""
    return f"?ERROR {ERRORS}{-why.value:5d} {NAK_MEANINGS[why]}: {exchange.received}"
