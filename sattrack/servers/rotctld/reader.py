"""What a client's bytes mean: commands one after the other. The table of commands, and how answers are put.

rotctld does not read lines: a command is a character, or a name behind a backslash; its arguments are words,
which blanks and ends of lines part alike; what follows is the next command. A `+`, or another punctuation
mark, before a command asks for an extended response, parted by that mark. Commands as Hamlib 4.5.4 has them:
`rotctld(1)`, and the output of `??`. Pure: bytes in, requests out.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum, IntEnum
from typing import TypeVar

LONGEST_WORD = 127
"""Bytes of an argument; Hamlib has room for as many."""
LONGEST_NAME = 32
LONGEST_COMMAND = 1024
"""Bytes of one command with all that stands between its words."""
_PUNCTUATION = frozenset(b"!\"#$%&'()*+,-./:;<=>?@[\\]^_`{|}~")
_NO_MARKS = frozenset(b"\\_#")
_ENDS = frozenset(b"\n\r")
_SPACES = frozenset(b" \t\n\v\f\r")
_IN_NAMES = frozenset(b"0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZ_abcdefghijklmnopqrstuvwxyz")
T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class RotctldCommand:
    """One command: its byte, its long name, what it takes, and the labels of what it gives.

    `gives` are those of extended responses; `answers`: there is an answer beside RPRT, after
    which a success is not reported. `whole_line` is of a command whose one argument is the rest of the line.
    """

    byte: int
    name: str
    takes: tuple[str, ...] = ()
    gives: tuple[str, ...] = ()
    answers: bool = False
    whole_line: bool = False


def _asks(letter: str, name: str, takes: tuple[str, ...], gives: tuple[str, ...]) -> RotctldCommand:
    return RotctldCommand(ord(letter), name, takes, gives, answers=True)


def _tells(letter: str, name: str, *takes: str) -> RotctldCommand:
    return RotctldCommand(ord(letter), name, takes)


DUMP_STATE_BYTE = 0x8F
PAUSE_BYTE = 0x8C
COMMANDS = (
    _tells("P", "set_pos", "Azimuth", "Elevation"),
    _asks("p", "get_pos", (), ("Azimuth", "Elevation")),
    _tells("K", "park"),
    _tells("S", "stop"),
    _tells("R", "reset", "Reset"),
    _tells("M", "move", "Direction", "Speed"),
    _tells("V", "set_level", "Level", "Level Value"),
    _asks("v", "get_level", ("Level",), ("Level Value",)),
    _tells("U", "set_func", "Func", "Func Status"),
    _asks("u", "get_func", ("Func",), ("Func Status",)),
    _tells("X", "set_parm", "Parm", "Parm Value"),
    _asks("x", "get_parm", ("Parm",), ("Parm Value",)),
    _tells("C", "set_conf", "Token", "Value"),
    _asks("_", "get_info", (), ("Info",)),
    _asks("s", "get_status", (), ("Status flags",)),
    RotctldCommand(ord("w"), "send_cmd", ("Cmd",), ("Reply",), answers=True, whole_line=True),
    _tells("1", "dump_caps"),
    RotctldCommand(DUMP_STATE_BYTE, "dump_state", answers=True),
    _asks("L", "lonlat2loc", ("Longitude", "Latitude", "Loc Len [2-12]"), ("Locator",)),
    _asks("l", "loc2lonlat", ("Locator",), ("Longitude", "Latitude")),
    _asks("D", "dms2dec", ("Degrees", "Minutes", "Seconds", "S/W"), ("Dec Degrees",)),
    _asks("d", "dec2dms", ("Dec Degrees",), ("Degrees", "Minutes", "Seconds", "S/W")),
    _asks("E", "dmmm2dec", ("Degrees", "Dec Minutes", "S/W"), ("Dec Deg",)),
    _asks("e", "dec2dmmm", ("Dec Deg",), ("Degrees", "Dec Minutes", "S/W")),
    _asks("B", "qrb", ("Lon 1", "Lat 1", "Lon 2", "Lat 2"), ("QRB Distance", "QRB Azimuth")),
    _asks("A", "a_sp2a_lp", ("Short Path Deg",), ("Long Path Deg",)),
    _asks("a", "d_sp2d_lp", ("Short Path km",), ("Long Path km",)),
    RotctldCommand(PAUSE_BYTE, "pause", ("Seconds",)),
)
"""All of them, in the order in which Hamlib lists them."""
BY_BYTE = {command.byte: command for command in COMMANDS}
BY_NAME = {command.name: command for command in COMMANDS}
MOST_TAKEN = 4


def usage() -> str:
    """Return the help that a question mark asks for."""
    lines = ["Commands (some may not be available for this rotator):"]
    for command in COMMANDS:
        letter = chr(command.byte) if 0x20 <= command.byte < 0x7F else "?"
        lines.append(f"{letter}: {command.name:<12}({', '.join(command.takes)})")
    lines += [
        "",
        "",
        "In interactive mode prefix long command names with '\\', e.g. '\\dump_state'",
        "",
        "The special command '-' is used to read further commands from standard input",
        "Commands and arguments read from standard input must be white space separated,",
        "comments are allowed, comments start with the # character and continue to the",
        "end of the line.",
    ]
    return "\n".join(lines) + "\n"


class SpecialRequest(Enum):
    """What a client says beside commands."""

    QUIT = "quit"
    HELP = "help"
    NOTHING = "nothing"
    """An empty line, a comment, or no command at all: rotctld does not answer."""
    TOO_LONG = "too long"


@dataclass(frozen=True, slots=True)
class RotctldRequest:
    """One command as it came; `mark` parts an extended response, and is an end of line in others."""

    command: RotctldCommand
    words: tuple[str, ...] = ()
    extended: bool = False
    mark: str = "\n"


class _More(Exception):  # noqa: N818
    """More bytes are needed before the request can be read."""


@dataclass(slots=True)
class Reader:
    """Cuts one client's bytes into what they say. Nothing that comes can break it, or make it grow."""

    _bytes: bytearray = field(default_factory=bytearray)
    _extended: bool = False
    _mark: str = "\n"
    _after_end: bool = True
    _skipping: bool = False
    """Whether the rest of a line is not looked at: a comment, or what follows something too long."""

    def feed(self, data: bytes) -> None:
        """Take bytes that have come."""
        self._bytes += data

    def next(self) -> RotctldRequest | SpecialRequest | None:
        """Return what is said next; None until more has come."""
        if self._skipping and not self._skip():
            return None
        try:
            said, end = self._read()
        except _More:
            if len(self._bytes) <= LONGEST_COMMAND:
                return None
            end = LONGEST_COMMAND + 1
        if end > LONGEST_COMMAND:
            said, end = SpecialRequest.TOO_LONG, LONGEST_COMMAND
        self._skipping |= said is SpecialRequest.TOO_LONG
        del self._bytes[:end]
        self._extended, self._mark = False, "\n"
        return said

    def _skip(self) -> bool:
        """Pass over the rest of a line; return whether its end has come."""
        ends = [place for end in _ENDS if (place := self._bytes.find(end)) >= 0]
        if not ends:
            self._bytes.clear()
            return False
        del self._bytes[: min(ends) + 1]
        self._skipping = False
        return True

    def _at(self, place: int) -> int:
        try:
            return self._bytes[place]
        except IndexError:
            raise _More from None

    def _read(self) -> tuple[RotctldRequest | SpecialRequest, int]:
        """Return what is said next, and where it ends."""
        while True:
            place, byte = 0, self._at(0)
            extended, mark = self._extended, self._mark
            if byte == ord("+"):
                extended, place = True, place + 1
                byte = self._at(place)
            if byte in _PUNCTUATION and byte not in _NO_MARKS:
                extended, mark, place = True, chr(byte), place + 1
                byte = self._at(place)
            if byte == ord("\\"):
                command, place = self._named(place + 1)
                self._after_end = False
                break
            if byte not in _ENDS:
                self._after_end = False
                special = self._special(byte, place + 1)
                if special is not None:
                    return special
                command, place = BY_BYTE.get(byte), place + 1
                break
            if self._after_end:
                return SpecialRequest.NOTHING, place + 1
            self._after_end = True
            del self._bytes[: place + 1]
            self._extended, self._mark = extended, mark
        if command is None:
            return SpecialRequest.NOTHING, place
        words = self._line(place) if command.whole_line else self._words(command, place)
        if words is None:
            return SpecialRequest.TOO_LONG, place
        return RotctldRequest(command, words[0], extended, mark), words[1]

    def _special(self, byte: int, place: int) -> tuple[SpecialRequest, int] | None:
        if byte == ord("#"):
            self._skipping = True
            return SpecialRequest.NOTHING, place
        if byte in b"qQ":
            return SpecialRequest.QUIT, place
        return (SpecialRequest.HELP, place) if byte == ord("?") else None

    def _named(self, place: int) -> tuple[RotctldCommand | None, int]:
        """Return the command of a name, and where what follows begins, without what ends a name."""
        end = place
        while self._at(end) in _IN_NAMES and end - place < LONGEST_NAME:
            end += 1
        return BY_NAME.get(self._bytes[place:end].decode("ascii")), end + 1

    def _words(self, command: RotctldCommand, place: int) -> tuple[tuple[str, ...], int] | None:
        """Return the arguments; one that begins with a question mark has none after it. None: too long."""
        words: list[str] = []
        for _ in command.takes[:MOST_TAKEN]:
            while self._at(place) in _SPACES:
                place += 1
            end = place
            while end - place <= LONGEST_WORD and self._at(end) not in _SPACES:
                end += 1
            if end - place > LONGEST_WORD:
                return None
            words.append(self._bytes[place:end].decode("latin-1").partition("\0")[0])
            place = end
            if words[0].startswith("?"):
                break
        return tuple(words), place

    def _line(self, place: int) -> tuple[tuple[str, ...], int] | None:
        """Return the rest of the line, or the next line where nothing is left of this one."""
        if self._at(place) == ord("\n"):
            place += 1
        end = self._bytes.find(b"\n", place, place + LONGEST_WORD)
        if end < 0:
            if len(self._bytes) - place >= LONGEST_WORD:
                return None
            raise _More
        text = self._bytes[place:end].decode("latin-1").partition("\0")[0]
        return (text[1:] if text.startswith(" ") else text,), end + 1


class Code(IntEnum):
    """Hamlib's error codes, as in RPRT."""

    OK = 0
    MALFORMED = 1
    """Hamlib means to say INVALID, and forgets the sign."""
    INVALID = -1
    IO = -6
    REJECTED = -9
    NOT_AVAILABLE = -11


class FailedError(Exception):
    """A request cannot be fulfilled."""

    def __init__(self, code: Code) -> None:
        super().__init__(code)
        self.code = code


def report(code: Code) -> str:
    """Return the line that reports a code."""
    return f"RPRT {code.value}\n"


def need(value: T | None) -> T:
    """Return a value that must be there. Raises FailedError."""
    if value is None:
        raise FailedError(Code.INVALID)
    return value


def done(code: Code) -> str:
    """Return the answer of what has none. Raises FailedError where it failed."""
    if code is not Code.OK:
        raise FailedError(code)
    return ""


def given(request: RotctldRequest, *values: str) -> str:
    """Return values, each with its label in an extended response."""
    labels = request.command.gives if request.extended else ()
    named = [f"{label}: " for label in labels] or [""] * len(values)
    return "".join(f"{label}{value}{request.mark}" for label, value in zip(named, values, strict=True))


def words_of(request: RotctldRequest) -> tuple[str, ...]:
    """Return as many words as a command takes; those that a question mark has cut off are empty."""
    return (*request.words, *[""] * (len(request.command.takes) - len(request.words)))
