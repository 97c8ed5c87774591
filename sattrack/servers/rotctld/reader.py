"""What a client's bytes say: commands one after the other, whatever stands between them.

rotctld does not read lines: a command is a character, or a name behind a backslash; its arguments are words,
which blanks and ends of lines part alike; what follows is the next command. A `+`, or another punctuation
mark, before a command asks for an extended response, parted by that mark. Pure: bytes in, requests out.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum

from sattrack.servers.rotctld.commands import BY_BYTE, BY_NAME, MOST_TAKEN, Command

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


class Said(Enum):
    """What a client says beside commands."""

    QUIT = "quit"
    HELP = "help"
    NOTHING = "nothing"
    """An empty line, a comment, or no command at all: rotctld does not answer."""
    TOO_LONG = "too long"


@dataclass(frozen=True, slots=True)
class Request:
    """One command as it came; `mark` parts an extended response, and is an end of line in others."""

    command: Command
    words: tuple[str, ...] = ()
    extended: bool = False
    mark: str = "\n"


class _More(Exception):  # noqa: N818
    """More bytes are needed before it can be told what was said."""


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

    def next(self) -> Request | Said | None:
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
            said, end = Said.TOO_LONG, LONGEST_COMMAND
        self._skipping |= said is Said.TOO_LONG
        del self._bytes[:end]
        self._extended, self._mark = False, "\n"
        return said

    def _skip(self) -> bool:
        """Pass over the rest of a line; tell whether its end has come."""
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

    def _read(self) -> tuple[Request | Said, int]:
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
                return Said.NOTHING, place + 1
            self._after_end = True
            del self._bytes[: place + 1]
            self._extended, self._mark = extended, mark
        if command is None:
            return Said.NOTHING, place
        words = self._line(place) if command.whole_line else self._words(command, place)
        if words is None:
            return Said.TOO_LONG, place
        return Request(command, words[0], extended, mark), words[1]

    def _special(self, byte: int, place: int) -> tuple[Said, int] | None:
        if byte == ord("#"):
            self._skipping = True
            return Said.NOTHING, place
        if byte in b"qQ":
            return Said.QUIT, place
        return (Said.HELP, place) if byte == ord("?") else None

    def _named(self, place: int) -> tuple[Command | None, int]:
        """Return the command of a name, and where what follows it begins; whatever ends a name is gone."""
        end = place
        while self._at(end) in _IN_NAMES and end - place < LONGEST_NAME:
            end += 1
        return BY_NAME.get(self._bytes[place:end].decode("ascii")), end + 1

    def _words(self, command: Command, place: int) -> tuple[tuple[str, ...], int] | None:
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
