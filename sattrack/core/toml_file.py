"""A TOML file to a typed value; every error names file, line and key."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeVar

from sattrack.core.errors import BadInputError
from sattrack.core.toml_positions import toml_positions
from sattrack.core.toml_text import read_typed

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
        raise BadInputError(f"{path}: cannot read {what}: it is not UTF-8 text") from error
    return read_typed(text, str(path), kind, columns=False)[0]


def line_of_key(path: Path, name: str) -> str:
    """Return ':LINE' of a key in a TOML file that was read before, or '' where it does not stand there."""
    spots = toml_positions(path.read_text(encoding="utf-8"))
    return next((f":{spot.line}" for where, spot in spots.items() if where[-1] == name), "")
