"""The exceptions a user can meet, with exit codes that scripts rely on; where in a file an error is."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Iterable


class SattrackError(Exception):
    """Something could not be done; the message is one line that says what, where and what to do."""

    exit_code = 1


class BadInputError(SattrackError):
    """What the user gave is wrong: a file, an option, a value."""

    exit_code = 2


class SafetyLimitError(SattrackError):
    """A safety limit ended the run; the mount was stopped."""

    exit_code = 3


class LinkLostError(SattrackError):
    """The mount stopped answering, or never answered."""

    exit_code = 4


class InterruptedRunError(SattrackError):
    """The operator interrupted the run; the mount was stopped first."""

    exit_code = 130


class TerminatedRunError(SattrackError):
    """The system ended the run; the mount was stopped first, and a restart goes on where it was."""

    exit_code = 143


def error_type(ended_by: str) -> type[SattrackError]:
    """Return the error that a run or a request ends with by its cause: "link", "operator", "limit:NAME"."""
    kinds = {"limit": SafetyLimitError, "link": LinkLostError, "operator": InterruptedRunError}
    return kinds.get(ended_by.partition(":")[0], SattrackError)


NO_JSON = (UnicodeDecodeError, RecursionError)
"""What msgspec raises beside its own errors: for text that is no UTF-8, and for what is nested too deep."""


class Origin(NamedTuple):
    """A file's name as it was given, line and column from 1; 0 where they are not known."""

    file: str
    line: int = 0
    column: int = 0

    def __str__(self) -> str:
        """Return FILE:LINE:COLUMN, as far as known."""
        return ":".join([self.file, *(str(n) for n in (self.line, self.column) if n)])

    def moved(self, columns: int) -> Origin:
        """Return the place so many columns on; the same where no column is known."""
        return self._replace(column=self.column + columns) if self.column else self

    def wrong(self, words: str) -> BadInputError:
        """Return the error that says what is wrong here."""
        return BadInputError(f"{self}: {words}")


UNHEARD = "is it on, and set to send here?"
"""What to check where a mount is not heard, whose address is not known."""


def how_to_install(*extras: str) -> str:
    """Return how to install extras. The package index knows another project by our name: not from there."""
    return f"run `pip install '.[{','.join(extras)}]'` in the folder of the clone"


def needed(module: str, what: str, extra: str) -> Any:
    """Import a package of an extra; raises SattrackError, naming what needs it and how to install it."""
    try:
        return importlib.import_module(module)
    except ImportError:
        package = module.partition(".")[0]
        raise SattrackError(f"{what} needs {package}: {how_to_install(extra)}") from None


def refused_key(error: Exception) -> tuple[str, str]:
    """Return what msgspec says is wrong with a value, and its key, dotted; "" where it names none."""
    what, _, key = str(error).removesuffix("`").partition(" - at `$.")
    return what, key


def meant(given: str, known: Iterable[str], ending: str = "") -> str:
    """Return "; did you mean ...?" where something known looks like what was given, else nothing.

    `ending` follows what is known.
    """
    from difflib import get_close_matches

    # The hyphens before options make nothing alike.
    folded = {choice.casefold().lstrip("-"): choice for choice in known}
    near = get_close_matches(given.casefold().lstrip("-"), folded, n=1, cutoff=0.65)
    return f"; did you mean {folded[near[0]] + ending!r}?" if near else ""
