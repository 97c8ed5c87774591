"""The parameters of a request: their names, whose case counts in a PUT alone, and their values.

"ASCOM Alpaca API Reference", Alpaca API contract: names in a query may be of any case, those in a form may
not. What cannot be read as what it is to be is a bad request; what is out of range is an invalid value.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal
from urllib.parse import parse_qsl

from sattrack.servers.alpaca.faults import BadRequest, Fault, Number

if TYPE_CHECKING:
    from collections.abc import Iterable

Kind = Literal["int", "float", "bool", "text"]
Value = int | float | bool | str
MOST_FIELDS = 64
LARGEST_ID = 2**32 - 1
LONGEST_TOLD = 40
_ID = re.compile(r"[0-9]{1,10}")
_INT = re.compile(r"[+-]?[0-9]{1,18}")
_FLOAT = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]{1,3})?")
_WHAT = {"int": "a whole number", "float": "a number", "bool": "True or False", "text": "text"}


@dataclass(frozen=True, slots=True)
class Parameter:
    """A parameter of a member: what it is called, what it is, and between which bounds, both inclusive."""

    name: str
    kind: Kind
    low: float = -math.inf
    high: float = math.inf
    optional: bool = False

    def read(self, text: str) -> Value:
        """Return the value that a text says; raises BadRequest where it says none."""
        value: Value | None = None
        if self.kind == "text":
            value = text
        elif self.kind == "bool":
            value = {"true": True, "false": False}.get(text.lower())
        elif self.kind == "int":
            value = int(text) if _INT.fullmatch(text) else None
        elif _FLOAT.fullmatch(text):
            value = float(text)
        if value is None or (isinstance(value, float) and not math.isfinite(value)):
            raise BadRequest(f"{self.name} is {text[:LONGEST_TOLD]!r}: it must be {_WHAT[self.kind]}")
        return value

    def check(self, value: Value) -> None:
        """Raise Fault where a value is out of range."""
        if isinstance(value, str | bool) or self.low <= value <= self.high:
            return
        span = f"{self.low:g} or more" if self.high == math.inf else f"from {self.low:g} to {self.high:g}"
        raise Fault(Number.INVALID_VALUE, f"{self.name} is {value:g}; it must be {span}")


@dataclass(frozen=True, slots=True)
class Form:
    """What a request says beside its path: names and values as they came, any case, any order."""

    pairs: tuple[tuple[str, str], ...]
    any_case: bool

    def all_of(self, name: str) -> list[str]:
        """Return every value of a name, by the rule for its case."""
        if self.any_case:
            wanted = name.lower()
            return [value for given, value in self.pairs if given.lower() == wanted]
        return [value for given, value in self.pairs if given == name]

    def one_of(self, name: str) -> str | None:
        """Return the value of a name, None where it has none; raises BadRequest where it has several."""
        values = self.all_of(name)
        if len(values) > 1:
            raise BadRequest(f"{name} is given {len(values)} times")
        return values[0] if values else None

    def id_of(self, name: str) -> int:
        """Return a client's number, 0 where it gives none. Raises BadRequest."""
        text = self.one_of(name)
        if text is None:
            return 0
        if not _ID.fullmatch(text) or int(text) > LARGEST_ID:
            raise BadRequest(f"{name} is {text[:LONGEST_TOLD]!r}: it must be a whole number of 32 bits")
        return int(text)

    def values(self, parameters: Iterable[Parameter]) -> dict[str, Value]:
        """Return the values of parameters by name. Raises BadRequest where one is missing or unreadable."""
        found: dict[str, Value] = {}
        for parameter in parameters:
            if parameter.optional:
                # Some clients send a list of parameters as several of one name, and an empty one as none.
                found[parameter.name] = " ".join(self.all_of(parameter.name))
                continue
            text = self.one_of(parameter.name)
            if text is None:
                raise BadRequest(f"{parameter.name} is missing{self._near_miss(parameter.name)}")
            found[parameter.name] = parameter.read(text)
        return found

    def _near_miss(self, name: str) -> str:
        near = [given for given, _ in self.pairs if given.lower() == name.lower()]
        return f": {near[0][:LONGEST_TOLD]} is not the same, case counts in a PUT" if near else ""


def read_form(data: bytes, any_case: bool) -> Form:
    """Return what a query, or a form, says. Raises BadRequest where it is neither."""
    try:
        pairs = parse_qsl(
            data.decode("ascii"),
            keep_blank_values=True,
            errors="strict",
            max_num_fields=MOST_FIELDS,
        )
    except ValueError as error:
        raise BadRequest(f"the parameters cannot be read: {_reason(error)}") from error
    return Form(tuple(pairs), any_case)


def _reason(error: ValueError) -> str:
    if isinstance(error, UnicodeDecodeError):
        return "they are not percent-encoded UTF-8"
    return f"there are more than {MOST_FIELDS}"
