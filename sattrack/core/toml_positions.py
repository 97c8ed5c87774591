"""Where in the text of a TOML file each key and value stands.

The text must be valid TOML, which the parser of the standard library has found already; that one tells no
places of values. Paths are tuples of keys and of indices from 0.
"""

from __future__ import annotations

import re
from typing import NamedTuple

Path = tuple[str | int, ...]

_BARE = re.compile(r"[A-Za-z0-9_-]+")
_PLAIN = re.compile(r"[^,\]}#\n]+")
_STRINGS = (
    ('"""', re.compile(r'"""(?:[^\\]|\\.)*?"{3,5}', re.DOTALL)),
    ("'''", re.compile(r"'''.*?'{3,5}", re.DOTALL)),
    ('"', re.compile(r'"(?:[^"\\\n]|\\.)*"')),
    ("'", re.compile(r"'[^'\n]*'")),
)


class Spot(NamedTuple):
    """Line and column, from 1, of a key and of its value; of the value's first character within quotes."""

    line: int
    column: int
    value_line: int
    value_column: int
    plain: bool
    """Whether the value is text as it stands, so that columns within it can be counted."""


def toml_positions(text: str) -> dict[Path, Spot]:
    """Return where everything stands."""
    return _Scanner(text.replace("\r\n", "\n")).scan()


class _Scanner:
    """One way through the text."""

    def __init__(self, text: str) -> None:
        self._text = text
        self._at = 0
        self._found: dict[Path, Spot] = {}
        self._counts: dict[Path, int] = {}

    def scan(self) -> dict[Path, Spot]:
        table: Path = ()
        while self._skip("\n"):
            if self._peek() == "[":
                table = self._header()
            else:
                self._pair(table)
        return self._found

    def _header(self) -> Path:
        begin = self._at
        many = self._text.startswith("[[", self._at)
        self._at += 2 if many else 1
        keys = self._keys()
        self._at += 2 if many else 1
        path: Path = ()
        for key in keys[:-1]:
            path = self._current((*path, key))
        path = (*path, keys[-1])
        if many:
            number = self._counts.get(path, 0)
            self._counts[path] = number + 1
            self._found.setdefault(path, self._spot(begin, begin, plain=False))
            path = (*path, number)
        self._found[path] = self._spot(begin, begin, plain=False)
        return path

    def _current(self, path: Path) -> Path:
        """Return the path of the latest table of an array of tables, or of a table itself."""
        return (*path, self._counts[path] - 1) if path in self._counts else path

    def _pair(self, table: Path) -> None:
        self._skip("")
        begin = self._at
        path = (*table, *self._keys())
        self._at += 1
        self._skip("")
        self._value(path, begin)

    def _keys(self) -> list[str]:
        keys = []
        while True:
            self._skip("")
            quoted = self._string()
            if quoted is not None:
                keys.append(quoted)
            else:
                match = _BARE.match(self._text, self._at)
                keys.append(match.group() if match else "")
                self._at += len(keys[-1])
            self._skip("")
            if self._peek() != ".":
                return keys
            self._at += 1

    def _value(self, path: Path, begin: int) -> None:
        first = self._at
        opening = self._peek()
        if opening == "[":
            self._found[path] = self._spot(begin, first, plain=False)
            self._array(path)
        elif opening == "{":
            self._found[path] = self._spot(begin, first, plain=False)
            self._inline(path)
        else:
            content = self._string()
            if content is None:
                match = _PLAIN.match(self._text, self._at)
                self._at += len(match.group()) if match else 1
                self._found[path] = self._spot(begin, first, plain=False)
                return
            quotes = 3 if self._text[first : first + 3] in ('"""', "'''") else 1
            inside = first + quotes
            if quotes == 3 and self._text[inside] == "\n":
                inside += 1
            plain = self._text[first] == "'" or "\\" not in content
            self._found[path] = self._spot(begin, inside, plain=plain)

    def _array(self, path: Path) -> None:
        self._at += 1
        number = 0
        while self._skip("\n,") and self._peek() != "]":
            self._value((*path, number), self._at)
            number += 1
        self._at += 1

    def _inline(self, path: Path) -> None:
        self._at += 1
        while self._skip("\n,") and self._peek() != "}":
            self._pair(path)
        self._at += 1

    def _string(self) -> str | None:
        """Pass over a string and return what stands within its quotes; None where none begins here."""
        for quote, pattern in _STRINGS:
            if self._text.startswith(quote, self._at):
                match = pattern.match(self._text, self._at)
                whole = match.group() if match else quote * 2
                self._at += len(whole)
                return whole[len(quote) : -len(quote)]
        return None

    def _skip(self, also: str) -> bool:
        """Pass over blanks, comments and what else is named; tell whether there is more."""
        while self._at < len(self._text):
            character = self._text[self._at]
            if character == "#" and also:
                end = self._text.find("\n", self._at)
                self._at = len(self._text) if end < 0 else end
            elif character in " \t" or character in also:
                self._at += 1
            else:
                return True
        return False

    def _peek(self) -> str:
        return self._text[self._at : self._at + 1]

    def _spot(self, key_at: int, value_at: int, *, plain: bool) -> Spot:
        return Spot(*self._place(key_at), *self._place(value_at), plain)

    def _place(self, at: int) -> tuple[int, int]:
        before = self._text.rfind("\n", 0, at)
        return self._text.count("\n", 0, at) + 1, at - before
