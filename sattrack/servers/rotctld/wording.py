"""How answers are put: values with or without their labels, and the codes of what failed."""

from __future__ import annotations

from enum import IntEnum
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from sattrack.servers.rotctld.reader import Request

T = TypeVar("T")


class Code(IntEnum):
    """Hamlib's error codes, as RPRT tells them."""

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
    """Return the line that tells a code."""
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


def given(request: Request, *values: str) -> str:
    """Return values, each with its label in an extended response."""
    labels = request.command.gives if request.extended else ()
    named = [f"{label}: " for label in labels] or [""] * len(values)
    return "".join(f"{label}{value}{request.mark}" for label, value in zip(named, values, strict=True))


def words_of(request: Request) -> tuple[str, ...]:
    """Return as many words as a command takes; those that a question mark has cut off are empty."""
    return (*request.words, *[""] * (len(request.command.takes) - len(request.words)))
