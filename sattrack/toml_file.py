"""A TOML file to a typed value; every error names file, line and key."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, TypeVar

import msgspec

from sattrack.errors import BadInputError

if TYPE_CHECKING:
    from pathlib import Path

T = TypeVar("T")


def read_toml(path: Path, kind: type[T], what: str) -> T:
    """Return what a file says, as a `kind`; `what` names it in errors ("the settings").

    Raises BadInputError, naming file, line and key, where the file is missing, is no TOML, or says something
    that has no place in it.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise BadInputError(f"{path}: cannot read {what}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise BadInputError(f"{path}: cannot read {what}: they are no UTF-8 text") from error
    try:
        return msgspec.toml.decode(text, type=kind)
    except msgspec.ValidationError as error:
        words = str(error)
        # Words of ours name the key themselves; where the decoder's do, its path is what tells it.
        said = re.sub(r" - at `[^`]*`$", "", words) if re.match(r"[a-z_.0-9]+ is ", words) else words
        raise BadInputError(f"{path}{_line_of(text, words)}: {said}") from error
    except msgspec.DecodeError as error:
        raise BadInputError(f"{path}: not a TOML file: {error}") from error


def line_of_key(path: Path, name: str) -> str:
    """Return ':LINE' of a key in a TOML file that was read before, or '' where it does not stand there."""
    return _line_of(path.read_text(encoding="utf-8"), f"{name} is ")


def _line_of(text: str, message: str) -> str:
    """Return ':LINE' of the key that a validation message speaks of, or '' where it cannot be found."""
    keys = [*re.findall(r"`\$?\.?([A-Za-z_.0-9]+)`", message), *re.findall(r"^([a-z_.0-9]+) is ", message)]
    for key in reversed(keys):
        name = key.split(".")[-1]
        for number, line in enumerate(text.splitlines(), start=1):
            if re.match(rf"\s*\[?{re.escape(name)}\b", line):
                return f":{number}"
    return ""
