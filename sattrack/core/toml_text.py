"""TOML to a typed value, every error with file, line and column and what was meant.

The parser of the standard library tells no places of values: a scanner of our own finds where each key and
value stands in text which that parser has found valid. Paths are tuples of keys and of indices from 0.
"""

from __future__ import annotations

import math
import re
import tomllib
from dataclasses import fields, is_dataclass
from datetime import date, datetime, time
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import msgspec

from sattrack.core.errors import BadInputError, Origin, meant

if TYPE_CHECKING:
    from pathlib import Path

KeyPath = tuple[str | int, ...]

_BARE = re.compile(r"[A-Za-z0-9_-]+")
_PLAIN = re.compile(r"[^,\]}#\n]+")
_STRINGS = (
    ('"""', re.compile(r'"""(?:[^\\]|\\.)*?"{3,5}', re.DOTALL)),
    ("'''", re.compile(r"'''.*?'{3,5}", re.DOTALL)),
    ('"', re.compile(r'"(?:[^"\\\n]|\\.)*"')),
    ("'", re.compile(r"'[^'\n]*'")),
)
T = TypeVar("T")
_AT = re.compile(r" - at `\$([^`]*)`$")
_STEP = re.compile(r"\.([^.\[\]]+)|\[(\d+)\]|\[\.\.\.\]")
_SYNTAX = re.compile(r"^(.*?) \(at (?:line (\d+), column (\d+)|end of document)\)$")
_UNKNOWN = re.compile(r"Object contains unknown field `(.*)`")
QUOTED = re.compile(r"'(.*?)'")
_TOML = re.compile(r"^\s*(\[|[\w.\"'-]+\s*=)", re.MULTILINE)
"""What a line of TOML looks like."""
_YES_OR_NO = {"yes", "no", "on", "off", "true", "false"}
_TAG = re.compile(r"Invalid value '(.*)'")
MOST_NESTED = 64
"""Brackets, braces and points of keys in one line that may be why a file is nested too deep to be read."""
_NESTING = re.compile(r"[\[{.]")
_LONG_NUMBER = re.compile(r"[0-9A-Fa-f_]{3000,}")
"""What may have more digits than Python turns into text: 4300, of a hexadecimal number fewer."""
_TOO_DEEP = "arrays and tables are nested too deep to be read; nest them less"


class UnknownKeyError(BadInputError):
    """A key that has no place in a file: `path` leads to it, and `said` is the message without its hint."""

    def __init__(self, said: str, hint: str, path: KeyPath) -> None:
        """Keep the path for callers that know of another file in which the key has a place."""
        super().__init__(said + hint)
        self.said = said
        self.path = path


class TextSpot(NamedTuple):
    """Line and column, from 1, of a key and of its value; of the value's first character within quotes."""

    line: int
    column: int
    value_line: int
    value_column: int
    plain: bool
    """Whether the value is text as it stands, so that columns within it can be counted."""


def toml_positions(text: str) -> dict[KeyPath, TextSpot]:
    """Return where everything stands."""
    return _Scanner(text.replace("\r\n", "\n")).scan()


class _Scanner:
    """One way through the text."""

    def __init__(self, text: str) -> None:
        self._text = text
        self._at = 0
        self._found: dict[KeyPath, TextSpot] = {}
        self._counts: dict[KeyPath, int] = {}

    def scan(self) -> dict[KeyPath, TextSpot]:
        table: KeyPath = ()
        while self._skip("\n"):
            if self._peek() == "[":
                table = self._header()
            else:
                self._pair(table)
        return self._found

    def _header(self) -> KeyPath:
        begin = self._at
        many = self._text.startswith("[[", self._at)
        self._at += 2 if many else 1
        keys = self._keys()
        self._at += 2 if many else 1
        path: KeyPath = ()
        for key in keys[:-1]:
            path = self._current((*path, key))
            self._found.setdefault(path, self._spot(begin, begin, plain=False))
        path = (*path, keys[-1])
        if many:
            number = self._counts.get(path, 0)
            self._counts[path] = number + 1
            self._found.setdefault(path, self._spot(begin, begin, plain=False))
            path = (*path, number)
        self._found[path] = self._spot(begin, begin, plain=False)
        return path

    def _current(self, path: KeyPath) -> KeyPath:
        """Return the path of the latest table of an array of tables, or of a table itself."""
        return (*path, self._counts[path] - 1) if path in self._counts else path

    def _pair(self, table: KeyPath) -> None:
        self._skip("")
        begin = self._at
        path = (*table, *self._keys())
        for length in range(len(table) + 1, len(path)):
            self._found.setdefault(path[:length], self._spot(begin, begin, plain=False))
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

    def _value(self, path: KeyPath, begin: int) -> None:
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

    def _array(self, path: KeyPath) -> None:
        self._at += 1
        number = 0
        while self._skip("\n,") and self._peek() != "]":
            self._value((*path, number), self._at)
            number += 1
        self._at += 1

    def _inline(self, path: KeyPath) -> None:
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

    def _spot(self, key_at: int, value_at: int, *, plain: bool) -> TextSpot:
        return TextSpot(*self._place(key_at), *self._place(value_at), plain)

    def _place(self, at: int) -> tuple[int, int]:
        before = self._text.rfind("\n", 0, at)
        return self._text.count("\n", 0, at) + 1, at - before


class KeyPositions:
    """Where the keys and values of one file stand."""

    def __init__(self, file: str, spots: dict[KeyPath, TextSpot], columns: bool = True) -> None:
        """Keep what the scanner found; without `columns`, only lines are given."""
        self.file = file
        self._spots = spots
        self.columns = columns

    def key(self, *path: str | int) -> Origin:
        """Return where a key stands, or else the nearest table round it."""
        for length in range(len(path), 0, -1):
            spot = self._spots.get(path[:length])
            if spot is not None:
                return self._origin(spot.line, spot.column)
        return Origin(self.file)

    def value(self, *path: str | int) -> Origin:
        """Return where a value stands, of text its first character; else where its key does."""
        spot = self._spots.get(path)
        if spot is None:
            return self.key(*path)
        return self._origin(spot.value_line, spot.value_column)

    def inside(self, *path: str | int) -> Origin:
        """Return where text begins in which columns can be counted; without a column where they cannot."""
        spot = self._spots.get(path)
        origin = self.value(*path)
        return origin if spot is None or spot.plain else origin._replace(column=0)

    def _origin(self, line: int, column: int) -> Origin:
        return Origin(self.file, line, column if self.columns else 0)

    def has(self, *path: str | int) -> bool:
        """Tell whether a key stands in the file."""
        return path in self._spots


def read_typed(
    text: str, file: str, kind: type[T], columns: bool = True, what: str = "this"
) -> tuple[T, KeyPositions]:
    """Return what a text says, and where; `what` names it in errors ("the settings").

    Raises BadInputError with file, line and column; without `columns`, with file, line and table.
    """
    try:
        return _read_typed(text, file, kind, columns, what)
    except RecursionError:
        raise Origin(file, _nested_line(text)).wrong(_TOO_DEEP) from None
    except ValueError:
        # Python turns no longer number into text or back; all other errors of the parser are caught before.
        line = _long_number_line(text)
        if line == 0:
            raise
        raise Origin(file, line).wrong("a number has too many digits; write a shorter one") from None


def _nested_line(text: str) -> int:
    """Return the line with the most brackets and points, from 1; 0 where the nesting goes over many lines."""
    counts = [len(_NESTING.findall(line)) for line in text.split("\n")]
    most = max(counts)
    return counts.index(most) + 1 if most >= MOST_NESTED else 0


def _long_number_line(text: str) -> int:
    """Return the line of the first number that Python does not read or write, from 1; 0 for none."""
    number = _LONG_NUMBER.search(text)
    return 0 if number is None else text.count("\n", 0, number.start()) + 1


def _read_typed(text: str, file: str, kind: type[T], columns: bool, what: str) -> tuple[T, KeyPositions]:
    try:
        document = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        if _TOML.search(text) is None:
            raise Origin(file).wrong(f"this is not a TOML file, as {what} must be") from None
        raise _syntax(str(error), text, file) from None
    positions = KeyPositions(file, toml_positions(text), columns)
    document = _without_times(document)
    try:
        value = msgspec.convert(document, kind)
    except msgspec.ValidationError as error:
        raise _explained(str(error), document, positions, kind) from None
    odd = _passed_over(value, document)
    if odd is not None:
        table = "".join(f".{key}" for key in odd[:-1])
        said = f"Object contains unknown field `{odd[-1]}` - at `${table}`"
        raise _explained(said, document, positions, kind)
    refused = _refused_in(document)
    if refused is not None:
        path, why = refused
        name = next((part for part in reversed(path) if isinstance(part, str)), "the file")
        raise positions.value(*path).wrong(f"{name} {why}")
    return value, positions


def _passed_over(value: Any, document: Any, path: tuple[str, ...] = ()) -> tuple[str, ...] | None:
    """Return where the first key stands that a dataclass in a struct does not have; None where there is none.

    The decoder passes over those.
    """
    if not isinstance(document, dict) or isinstance(value, dict):
        return None
    names = {one.name for one in fields(value)} if is_dataclass(value) else document.keys()
    for key, one in document.items():
        if key not in names:
            return (*path, key)
        found = _passed_over(getattr(value, key, None), one, (*path, key))
        if found is not None:
            return found
    return None


def _refused_in(value: Any, path: KeyPath = ()) -> tuple[KeyPath, str] | None:
    """Return where the first value stands that no key may have, and why; None where there is none."""
    if isinstance(value, dict | list):
        parts = value.items() if isinstance(value, dict) else enumerate(value)
        return next((found for part, one in parts if (found := _refused_in(one, (*path, part)))), None)
    if isinstance(value, float) and math.isnan(value):
        return path, "is nan; give a number"
    if isinstance(value, str) and "\0" in value:
        return path, "has the character U+0000 in it; omit that"
    return None


def _syntax(message: str, text: str, file: str) -> BadInputError:
    match = _SYNTAX.match(message)
    if match is None:
        return Origin(file).wrong(f"not a TOML file: {message}")
    lines = text.split("\n")
    line, column = (int(match[2]), int(match[3])) if match[2] else (len(lines), len(lines[-1]) + 1)
    row = lines[line - 1] if 0 < line <= len(lines) else ""
    slip = _slip(match[1], lines, line, bool(match[2]))
    if slip is not None:
        return Origin(file, slip[0]).wrong(slip[1])
    return Origin(file, line, column).wrong(f"not a TOML file: {match[1]}{_instead(match[1], row)}")


def _instead(message: str, row: str) -> str:
    """Return what to write in place of a value that is none of TOML; nothing where that is not known."""
    pair = re.match(r"\s*[\w.\"'-]+\s*=([^#]*)", row)
    value = '"' if pair is None else pair[1].strip()
    if not value:
        return "; write the value after ="
    if message == "Invalid value" and value[0].isalpha():
        return "; write true or false" if value.casefold() in _YES_OR_NO else "; text stands in quotes"
    if re.fullmatch(r"[+-]?\d+,\d+", value):
        return "; write a decimal point, not a comma"
    if re.match(r"\d{4}-|\d\d?:\d\d$", value):
        return "; times stand in quotes"
    if re.match(r"[+\N{MINUS SIGN}\N{EN DASH}-]?\.?\d", value):
        return "; write one decimal number without a unit, as 52.15 or -4.5"
    return ""


def _slip(message: str, lines: list[str], line: int, inside: bool) -> tuple[int, str] | None:
    """Return line and words for what is commonly wrong; None for anything else.

    `line` is where the parser stopped, `inside` whether that was before the end.
    """
    row = lines[line - 1]
    twice = re.match(r"Cannot declare \((.*?),?\) twice", message)
    if twice is not None:
        return line, f"[{'.'.join(re.findall(QUOTED, twice[1]))}] stands twice: merge them"
    if message == "Cannot overwrite a value":
        return line, f"{row.partition('=')[0].strip()} stands twice: keep one of them"
    if message == 'Expected "\'"':
        line = next((k for k, one in enumerate(lines, start=1) if one.count("'") % 2), line)
    if message == 'Expected "\'"' or ("Illegal character '\\n'" in message and re.search("[\"']", row)):
        return line, "the quote is not closed on this line"
    opened = _unclosed(lines[: line - inside])
    if opened and message in ("Unclosed array", "Invalid value") and not (inside and not _TOML.match(row)):
        return opened, "[ is not closed: write ] after the last value"
    return None


def _unclosed(lines: list[str]) -> int:
    """Return the line, from 1, of the last list in [ ] if it is not closed by then, else 0."""
    depth = 0
    for number in range(len(lines), 0, -1):
        row = lines[number - 1].partition("#")[0]
        depth += row.count("[") - row.count("]")
        if re.search(r"=\s*\[", row):
            return number if depth > 0 else 0
    return 0


def _without_times(value: Any) -> Any:
    """Return a document with its dates and times as text: a zone is theirs only where one was written."""
    if isinstance(value, dict):
        return {key: _without_times(one) for key, one in value.items()}
    if isinstance(value, list):
        return [_without_times(one) for one in value]
    if isinstance(value, datetime):
        return value.isoformat().replace("+00:00", "Z")
    return value.isoformat() if isinstance(value, date | time) else value


def _explained(message: str, document: Any, positions: KeyPositions, kind: type) -> BadInputError:
    """Return the decoder's refusal as an error that names place, key, and what was meant."""
    found = _AT.search(message)
    path: KeyPath = ()
    if found is not None:
        for name, number in _STEP.findall(found[1]):
            # The decoder does not tell which of the names in a table it was whose names are free.
            part = int(number) if number else name or _refused_name(document, path, kind)
            path = (*path, part)
        message = message[: found.start()]
    table = ".".join(str(part) for part in path if isinstance(part, str))
    where = "" if positions.columns or not table else f" in [{table}]"
    unknown, tag = _UNKNOWN.fullmatch(message), _TAG.fullmatch(message)
    if unknown is not None:
        keys = _keys_at(kind, path, document)
        hint = _elsewhere(kind, unknown[1]) or meant(unknown[1], keys) or f"; there are {', '.join(keys)}"
        words = f"{positions.key(*path, unknown[1])}: unknown key {unknown[1]!r}{where}"
        return UnknownKeyError(words, hint, (*path, unknown[1]))
    name = next((str(part) for part in reversed(path) if isinstance(part, str)), "the file")
    if tag is not None or message.startswith("Invalid enum value"):
        given = _value_at(document, path)
        choices = _choices(kind, path, document)
        hint = meant(str(given), choices) or f"; give one of {', '.join(choices)}"
        return positions.value(*path).wrong(f"{name} is {given!r}{hint}")
    said = re.match(r"([a-z0-9_.]+)(?:: | is | and | does )", message)
    named = () if said is None else tuple(said[1].split("."))
    place = positions.key(*path)
    if named and positions.has(*path, *named):
        place = positions.value(*path, *named)
    if message.startswith("Expected"):
        place = positions.value(*path)
        given = _value_at(document, path)
        message = f"{name} is {_shown(given)}; {message[0].lower()}{message[1:].replace('`', '')}"
        message = re.sub(r", got .*$", "", message).replace(" | null", "")
        choices = _choices(kind, path, document)
        if choices:
            message = f"{name} is {_shown(given)}; give one of {', '.join(choices)}"
        if isinstance(given, dict) and _is_of_tables(kind, path, document):
            message = f"{name} is one table; there may be many: write [[{table}]]"
        for word, plain in _PLAIN_WORDS.items():
            message = re.sub(rf"expected {word}\b", f"give {plain.replace('NAME', table)}", message)
    missing = re.fullmatch(r"Object missing required field `(.*)`", message)
    if missing is not None:
        message = f"{missing[1]} is missing{where}"
    return place.wrong(message)


def _elsewhere(kind: type, key: str) -> str:
    """Return in which other tables a key may stand, the end of a message; nothing where in none."""
    names = _keys_at(kind, (), None)
    if key in names:
        return "; it belongs to the top, above the first [ ]"
    tables = [f"[{name}]" for name in names if key in _keys_at(kind, (name,), None)]
    for name in names:
        if key in _keys_at(kind, (name, 0), None):
            tables.append(f"[[{name}]]" if _is_of_tables(kind, (name,), None) else f"[{name}.NAME]")
    return f"; it belongs under {' or '.join(tables)}" if tables else ""


def _is_of_tables(kind: type, path: KeyPath, document: Any) -> bool:
    """Tell whether what may stand at a path is a list of tables, which are written with [[ ]]."""
    kinds = msgspec.inspect
    lists = (
        one for one in _types_at(kind, path, document) if isinstance(one, kinds.VarTupleType | kinds.ListType)
    )
    return any(isinstance(inner, kinds.StructType) for one in lists for inner in _inner(one, 0))


def _refused_name(document: Any, path: KeyPath, kind: type) -> str:
    """Return the first name in a table with free names whose value is refused."""
    table = _value_at(document, path)
    for name, value in table.items():
        try:
            msgspec.convert(_with(document, path, {name: value}), kind)
        except msgspec.ValidationError:
            return str(name)
    return str(next(iter(table)))


def _with(document: Any, path: KeyPath, value: Any) -> Any:
    """Return a document with another value at a path."""
    if not path:
        return value
    changed = document.copy()
    changed[path[0]] = _with(document[path[0]], path[1:], value)
    return changed


_PLAIN_WORDS = {
    "str": "text in quotes",
    "float": "a number",
    "int": "a whole number",
    "bool": "true or false",
    "array": "a list in [ ]",
    "object": "a table, [NAME] and its keys below",
}


def _shown(value: Any) -> str:
    text = "true" if value is True else "false" if value is False else repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _value_at(document: Any, path: KeyPath) -> Any:
    for part in path:
        try:
            document = document[part]
        except (KeyError, IndexError, TypeError):
            return None
    return document


def _types_at(kind: Any, path: KeyPath, document: Any) -> list[Any]:
    """Return the types that may stand at a path; of several kinds of table those of the tag there."""
    info: list[Any] = [msgspec.inspect.type_info(kind)]
    for part in path:
        document = _value_at(document, (part,))
        info = [inner for one in info for inner in _inner(one, part)]
        tagged = [one for one in info if isinstance(one, msgspec.inspect.StructType) and one.tag_field]
        if isinstance(document, dict) and tagged:
            info = [one for one in tagged if document.get(one.tag_field or "") == one.tag] or tagged
    return info


def _inner(info: Any, part: str | int) -> list[Any]:
    kinds = msgspec.inspect
    if isinstance(info, kinds.StructType | kinds.DataclassType):
        if isinstance(info, kinds.StructType) and part == info.tag_field:
            return [info]
        found = [field.type for field in info.fields if field.encode_name == part]
    elif isinstance(info, kinds.VarTupleType | kinds.ListType):
        found = [info.item_type]
    elif isinstance(info, kinds.DictType):
        found = [info.value_type]
    else:
        found = []
    return [inner for one in found for inner in (one.types if isinstance(one, kinds.UnionType) else [one])]


def _keys_at(kind: Any, path: KeyPath, document: Any) -> list[str]:
    found: dict[str, None] = {}
    for info in _types_at(kind, path, document):
        if isinstance(info, msgspec.inspect.StructType):
            found |= dict.fromkeys([info.tag_field] if info.tag_field else [])
        if isinstance(info, msgspec.inspect.StructType | msgspec.inspect.DataclassType):
            found |= dict.fromkeys(field.encode_name for field in info.fields)
    return list(found)


def _choices(kind: Any, path: KeyPath, document: Any) -> list[str]:
    found: dict[str, None] = {}
    for info in _types_at(kind, path, document):
        if isinstance(info, msgspec.inspect.StructType) and info.tag is not None:
            found[str(info.tag)] = None
        elif isinstance(info, msgspec.inspect.LiteralType):
            found |= dict.fromkeys(str(value) for value in info.values)
    return list(found)


def read_toml(path: Path, kind: type[T], what: str) -> T:
    """Return what a file says, as a `kind`; `what` names it in errors ("the settings").

    Raises BadInputError, naming file, line and key, where the file is missing, is no TOML, or says something
    that has no place in it.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, ValueError) as error:
        raise BadInputError(f"{path}: cannot read {what}: {why_unreadable(error)}") from error
    return read_typed(text, str(path), kind, columns=False, what=what)[0]


def why_unreadable(error: OSError | ValueError) -> str:
    """Return why a file of text was not read, and what to do where it is written in another encoding."""
    if isinstance(error, UnicodeDecodeError):
        line = error.object[: error.start].count(b"\n") + 1
        return f"line {line} is not UTF-8 text; save the file as UTF-8"
    return getattr(error, "strerror", None) or str(error)


def line_of_key(path: Path, name: str) -> str:
    """Return ':LINE' of a key in a TOML file that was read before, or '' where it does not stand there."""
    spots = toml_positions(path.read_text(encoding="utf-8-sig"))
    return next((f":{spot.line}" for where, spot in spots.items() if where[-1] == name), "")
