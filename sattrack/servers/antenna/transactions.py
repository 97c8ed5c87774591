"""Commands and responses as one table: it drives the parser, the documentation and the tests.

"Ideal Field System Antenna Interface", section 4.0: every command has one response. Fields are separated by
blanks; two commas stand for one that is left out.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from decimal import Decimal
from enum import IntEnum
from typing import Literal

OMITTED = ",,"
UNKNOWN_WORD = "??"
"""The word of a response to a line whose command cannot be read."""
_NUMBER = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]{1,3})?")


class Nak(IntEnum):
    """Why a command was refused: the small integer after NAK."""

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
    Nak.LOCAL: "the controller is in local",
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
class Field:
    """One field of a command: a number within bounds, one of some words, or the rest of the message."""

    name: str
    meaning: str
    kind: Literal["number", "word", "text"] = "number"
    least: float = 0.0
    most: float = 0.0
    words: tuple[str, ...] = ()
    whole: bool = False
    """Whether a number has to be a whole one."""
    optional: bool = False
    """Whether two commas, or nothing at the end, may stand in its place."""


@dataclass(frozen=True, slots=True)
class Command:
    """One command: its word, its fields, whether it commands the antenna, and what comes back."""

    word: str
    meaning: str
    fields: tuple[Field, ...] = ()
    commands_antenna: bool = True
    """Whether it is refused in local."""
    answer: str = "ACK"


def _angle(name: str, meaning: str) -> Field:
    return Field(name, meaning, least=-720.0, most=720.0)


def _rate(name: str, meaning: str) -> Field:
    return Field(name, meaning, least=-100.0, most=100.0, optional=True)


WRAP = Field(
    "wrap",
    "number of the first axis' wrap, from -9 to 9, or S for the shortest way (so too where it is left out)",
    kind="word",
    words=("S", *(str(n) for n in range(-9, 10))),
    optional=True,
)
FRAMES = Field(
    "frame", "DATE: true equator and equinox of date; J2000: mean ones", "word", words=("DATE", "J2000")
)
RA = Field("ra", "right ascension, degrees", least=-360.0, most=360.0)
DEC = Field("dec", "declination, degrees", least=-90.0, most=90.0)
CATALOGUE = Field("number", "catalogue number", least=0, most=999_999_999, whole=True)
EPOCH = Field("epoch", "seconds of the UTC day", least=0.0, most=86401.0, optional=True)

COMMANDS = (
    Command(
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
    Command(
        "PS",
        "position status",
        commands_antenna=False,
        answer="first and second axis commanded, then actual, degrees; their four rates; wraps commanded and "
        "actual; epoch, seconds of the UTC day; REMOTE or LOCAL; IDLE, SLEWING or TRACKING",
    ),
    Command(
        "STATUS",
        "status in detail",
        commands_antenna=False,
        answer="REMOTE or LOCAL; what the antenna does; LINK-UP or LINK-DOWN; the interlock that stopped it, "
        "or OK; 1 where the trajectory is outside the limits, else 0; number of the last refusal, or 0",
    ),
    Command("STOP", "end the trajectory and bring the antenna to rest"),
    Command("STOW", "go to the stow position, and take no trajectory until UNSTOW"),
    Command("UNSTOW", "take trajectories again"),
    Command("SERVICE", "go to the service position"),
    Command("RESET", "be ready again after an interlock has stopped the antenna"),
    Command("PINS", "insert or remove the stow pins", (Field("do", "", "word", words=("IN", "OUT")),)),
    Command("BRAKES", "set or release the brakes", (Field("do", "", "word", words=("SET", "RELEASE")),)),
    Command(
        "SENSORS",
        "tilt and other sensors",
        commands_antenna=False,
        answer="tilts about both axes, degrees; currents of both axes' drives, A; epoch",
    ),
    Command(
        "TIME",
        "the controller's time; with fields, sets it as of the line-feed, while nothing is followed",
        (
            Field("day", "day to set, days since 1970-01-01", least=0, most=99999, whole=True, optional=True),
            Field("seconds", "seconds of that day to set", least=0.0, most=86400.0, optional=True),
        ),
        commands_antenna=False,
        answer="days since 1970-01-01; seconds of the UTC day, latched; ACK where it was set",
    ),
    Command(
        "FOCUS",
        "move the focus, all axes at once",
        tuple(
            Field(
                f"axis{n}",
                f"position of axis {n}, mm; left out: as it is",
                least=-1e4,
                most=1e4,
                optional=True,
            )
            for n in (1, 2, 3)
        ),
    ),
    Command(
        "FOCSWEEP",
        "move one axis of the focus from limit to limit and back, again and again, at a uniform rate",
        (
            Field("axis", "which axis, from 1", least=1, most=3, whole=True),
            Field("rate", "mm a second", least=0.001, most=100.0),
        ),
    ),
    Command("FOCSTOP", "stop the focus"),
    Command(
        "FOCPS",
        "focus position status",
        commands_antenna=False,
        answer="commanded and actual position of each axis, mm; epoch; MOVING or STOPPED",
    ),
    Command(
        "RADEC",
        "follow a source: topocentric coordinates of date, or mean ones of J2000 (ICRS)",
        (FRAMES, RA, DEC, WRAP),
    ),
    Command(
        "FIXED",
        "stand at a fixed direction of the antenna's own axes",
        (
            _angle("first", "position of the first axis, degrees"),
            _angle("second", "position of the second axis, degrees"),
            WRAP,
        ),
    ),
    Command(
        "FIXSKY",
        "stand where a source is, or was, at one instant",
        (FRAMES, RA, DEC, EPOCH, WRAP),
    ),
    Command(
        "OFFSET",
        "set the offsets of one kind, added to the coordinates themselves; for all but TD",
        (
            Field("kind", "which coordinates", "word", words=("AZEL", "HADEC", "RADEC")),
            Field("first", "degrees of azimuth, hour angle or right ascension", least=-10.0, most=10.0),
            Field("second", "degrees of elevation or declination", least=-10.0, most=10.0),
        ),
    ),
    Command(
        "POINTING",
        "set the pointing model, degrees; for all but TD; all 0 takes it away",
        tuple(
            Field(name, meaning, least=-5.0, most=5.0)
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
    Command(
        "SKY",
        "where on the sky the axes point, by the pointing model turned round",
        commands_antenna=False,
        answer="right ascension and declination of date, azimuth and elevation, degrees; epoch",
    ),
    Command(
        "TLE",
        "one line of a satellite's elements: 0 its name, 1 and 2 the element lines",
        (
            Field("line", "which line", "word", words=("0", "1", "2")),
            CATALOGUE,
            Field("text", "the line", "text"),
        ),
        commands_antenna=False,
    ),
    Command(
        "OMM",
        "one value of a satellite's elements, by its keyword in the CCSDS Orbit Mean-elements Message",
        (CATALOGUE, Field("keyword", "as EPOCH", "text"), Field("value", "its value", "text")),
        commands_antenna=False,
    ),
    Command("SAT", "follow the satellite whose elements were sent last", (CATALOGUE, WRAP)),
    Command(
        "SATOFF",
        "biases of the satellite",
        (
            Field("along", "seconds along the track, positive leads", least=-60.0, most=60.0),
            Field("cross", "degrees across, positive to the left seen from below", least=-5.0, most=5.0),
            Field(
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
class Request:
    """A command that is well formed: its values by the names of its fields, None where one is left out."""

    command: Command
    values: dict[str, Decimal | str | None]

    def number(self, name: str, otherwise: float = 0.0) -> float:
        """Return a number, or what stands for one that is left out."""
        value = self.values[name]
        return otherwise if value is None else float(value)

    def exact(self, name: str) -> Decimal:
        """Return a number to its last digit; 0 where it is left out."""
        value = self.values[name]
        return value if isinstance(value, Decimal) else Decimal(0)

    def text(self, name: str, otherwise: str = "") -> str:
        """Return a word or a text, or what stands for one that is left out."""
        value = self.values[name]
        return otherwise if value is None else str(value)


@dataclass(frozen=True, slots=True)
class Refusal:
    """A command that is refused: the word that the response begins with, and why."""

    word: str
    why: Nak

    @property
    def message(self) -> str:
        """The response."""
        return f"{self.word} NAK {self.why.value}"


def acknowledge(word: str) -> str:
    """Return the response to a command that was accepted."""
    return f"{word} ACK"


def word_of(message: str) -> str:
    """Return the word of a command that may be faulty, as responses to it begin."""
    first = message.split(" ", 1)[0]
    return first if first in BY_WORD else UNKNOWN_WORD


def parse(message: str) -> Request | Refusal:
    """Return what a message asks for, or why it is refused."""
    parts = message.split(None, 1)
    command = BY_WORD.get(parts[0]) if parts else None
    if command is None:
        return Refusal(UNKNOWN_WORD, Nak.UNKNOWN)
    texts = _fields(parts[1] if len(parts) > 1 else "", command)
    if len(texts) > len(command.fields):
        return Refusal(command.word, Nak.FIELDS)
    values: dict[str, Decimal | str | None] = {}
    for field, text in zip(
        command.fields, texts + [OMITTED] * (len(command.fields) - len(texts)), strict=True
    ):
        value = _value(field, text)
        if isinstance(value, Nak):
            return Refusal(command.word, value)
        values[field.name] = value
    return Request(command, values)


def _fields(text: str, command: Command) -> list[str]:
    if command.fields and command.fields[-1].kind == "text":
        return text.split(None, len(command.fields) - 1)
    return text.split()


def _value(field: Field, text: str) -> Decimal | str | Nak | None:
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
