"""The rotctld protocol: the table of commands, requests in a client's bytes, and the form of answers.

rotctld does not read lines: a command is a character, or a name after a backslash; its arguments are words
separated by blanks or line ends; then comes the next command. A `+`, or another punctuation mark, before a
command requests an extended response, separated by that mark. Commands are those of Hamlib 4.5.4:
`rotctld(1)`, and the output of `??`. Pure: bytes in, requests out.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum, IntEnum
from typing import TypeVar

LONGEST_WORD = 127
"""Bytes of an argument, as in Hamlib."""
LONGEST_NAME = 32
LONGEST_COMMAND = 1024
"""Bytes of one command with the space between its words."""
_PUNCTUATION = frozenset(b"!\"#$%&'()*+,-./:;<=>?@[\\]^_`{|}~")
_NO_MARKS = frozenset(b"\\_#")
_ENDS = frozenset(b"\n\r")
_SPACES = frozenset(b" \t\n\v\f\r")
_IN_NAMES = frozenset(b"0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZ_abcdefghijklmnopqrstuvwxyz")
T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class RotctldCommand:
    """One command: its byte, its long name, its arguments, and the labels of its values.

    `gives` are the labels of extended responses; `answers`: there are values, after which success is not
    reported. `whole_line`: the one argument is the rest of the line.
    """

    byte: int
    name: str
    takes: tuple[str, ...] = ()
    gives: tuple[str, ...] = ()
    answers: bool = False
    whole_line: bool = False


def _query(letter: str, name: str, takes: tuple[str, ...], gives: tuple[str, ...]) -> RotctldCommand:
    return RotctldCommand(ord(letter), name, takes, gives, answers=True)


def _order(letter: str, name: str, *takes: str) -> RotctldCommand:
    return RotctldCommand(ord(letter), name, takes)


DUMP_STATE_BYTE = 0x8F
PAUSE_BYTE = 0x8C
COMMANDS = (
    _order("P", "set_pos", "Azimuth", "Elevation"),
    _query("p", "get_pos", (), ("Azimuth", "Elevation")),
    _order("K", "park"),
    _order("S", "stop"),
    _order("R", "reset", "Reset"),
    _order("M", "move", "Direction", "Speed"),
    _order("V", "set_level", "Level", "Level Value"),
    _query("v", "get_level", ("Level",), ("Level Value",)),
    _order("U", "set_func", "Func", "Func Status"),
    _query("u", "get_func", ("Func",), ("Func Status",)),
    _order("X", "set_parm", "Parm", "Parm Value"),
    _query("x", "get_parm", ("Parm",), ("Parm Value",)),
    _order("C", "set_conf", "Token", "Value"),
    _query("_", "get_info", (), ("Info",)),
    _query("s", "get_status", (), ("Status flags",)),
    RotctldCommand(ord("w"), "send_cmd", ("Cmd",), ("Reply",), answers=True, whole_line=True),
    _order("1", "dump_caps"),
    RotctldCommand(DUMP_STATE_BYTE, "dump_state", answers=True),
    _query("L", "lonlat2loc", ("Longitude", "Latitude", "Loc Len [2-12]"), ("Locator",)),
    _query("l", "loc2lonlat", ("Locator",), ("Longitude", "Latitude")),
    _query("D", "dms2dec", ("Degrees", "Minutes", "Seconds", "S/W"), ("Dec Degrees",)),
    _query("d", "dec2dms", ("Dec Degrees",), ("Degrees", "Minutes", "Seconds", "S/W")),
    _query("E", "dmmm2dec", ("Degrees", "Dec Minutes", "S/W"), ("Dec Deg",)),
    _query("e", "dec2dmmm", ("Dec Deg",), ("Degrees", "Dec Minutes", "S/W")),
    _query("B", "qrb", ("Lon 1", "Lat 1", "Lon 2", "Lat 2"), ("QRB Distance", "QRB Azimuth")),
    _query("A", "a_sp2a_lp", ("Short Path Deg",), ("Long Path Deg",)),
    _query("a", "d_sp2d_lp", ("Short Path km",), ("Long Path km",)),
    RotctldCommand(PAUSE_BYTE, "pause", ("Seconds",)),
)
"""All commands, in Hamlib's order."""
BY_BYTE = {command.byte: command for command in COMMANDS}
BY_NAME = {command.name: command for command in COMMANDS}
MOST_TAKEN = 4


def usage() -> str:
    """Return the answer to a question mark."""
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
    """A request that is not a command."""

    QUIT = "quit"
    HELP = "help"
    NOTHING = "nothing"
    """An empty line, a comment, or no command at all: rotctld does not answer."""
    TOO_LONG = "too long"


@dataclass(frozen=True, slots=True)
class RotctldRequest:
    """One command as it came; `mark` separates the values of a response: a line end unless it is extended."""

    command: RotctldCommand
    words: tuple[str, ...] = ()
    extended: bool = False
    mark: str = "\n"


class _More(Exception):  # noqa: N818
    """More bytes are needed before the request can be read."""


@dataclass(slots=True)
class Reader:
    """Cuts one client's bytes into requests. No input raises, or makes it grow."""

    _bytes: bytearray = field(default_factory=bytearray)
    _extended: bool = False
    _mark: str = "\n"
    _after_end: bool = True
    _skipping: bool = False
    """Whether the rest of a line is skipped: a comment, or the end of a command that was too long."""

    def feed(self, data: bytes) -> None:
        """Take received bytes."""
        self._bytes += data

    def next(self) -> RotctldRequest | SpecialRequest | None:
        """Return the next request; None until more has come."""
        if self._skipping and not self._skip():
            return None
        try:
            request, end = self._read()
        except _More:
            if len(self._bytes) <= LONGEST_COMMAND:
                return None
            end = LONGEST_COMMAND + 1
        if end > LONGEST_COMMAND:
            request, end = SpecialRequest.TOO_LONG, LONGEST_COMMAND
        self._skipping |= request is SpecialRequest.TOO_LONG
        del self._bytes[:end]
        self._extended, self._mark = False, "\n"
        return request

    def _skip(self) -> bool:
        """Skip the rest of a line; return whether its end has come."""
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
        """Return the next request, and where it ends."""
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
        """Return the command of a name, and the place after the end of the name."""
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
    """Hamlib's INVALID without its sign."""
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
    """Return a value that must not be None. Raises FailedError."""
    if value is None:
        raise FailedError(Code.INVALID)
    return value


def done(code: Code) -> str:
    """Return the empty answer. Raises FailedError for a code of failure."""
    if code is not Code.OK:
        raise FailedError(code)
    return ""


def given(request: RotctldRequest, *values: str) -> str:
    """Return values, each with its label in an extended response."""
    labels = request.command.gives if request.extended else ()
    named = [f"{label}: " for label in labels] or [""] * len(values)
    return "".join(f"{label}{value}{request.mark}" for label, value in zip(named, values, strict=True))


def words_of(request: RotctldRequest) -> tuple[str, ...]:
    """Return as many words as a command takes; those after a question mark are empty."""
    return (*request.words, *[""] * (len(request.command.takes) - len(request.words)))
