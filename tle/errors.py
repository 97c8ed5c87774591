"""The exceptions that elements, instants and directions can raise, each in words a user can act on."""

from __future__ import annotations

from typing import Any

# Columns of a user's line that a message quotes: an element line, and some of what may follow by mistake.
_WIDEST = 100


class TleError(Exception):
    """Base of everything that `tle` raises on purpose; `exit_code` is what a command line should end with.

    It can be pickled: one that a process of a pool raises reaches whoever asked.
    """

    exit_code = 2

    def __reduce__(self) -> tuple[Any, ...]:
        """Leave out how it was made: of that, the message is kept."""
        return _made_again, (type(self), self.args, self.__dict__)


def _made_again(kind: type[TleError], words: tuple[Any, ...], known: dict[str, Any]) -> TleError:
    error = kind.__new__(kind, *words)
    error.args = words
    error.__dict__.update(known)
    return error


class ElementsError(TleError):
    """A set of orbital elements that cannot be used.

    `source` names the file (or "text"), `line` is the 1-based line in it, and `reason` the sentence alone,
    without place, quoted line and mark. Each is None or empty where it does not apply; so are `name` and
    `catalog_number` of the set, as far as they could be read.
    """

    name: str = ""
    catalog_number: int | None = None

    def __init__(
        self,
        reason: str,
        *,
        source: str = "",
        line: int | None = None,
        text: str = "",
        columns: tuple[int, int] | None = None,
    ) -> None:
        """Compose the message: place and reason, then the user's line with `^` under 1-based `columns`."""
        self.reason = reason
        self.source = source
        self.line = line
        self.text = text
        self.columns = columns
        place = f"{source}:{line}: " if source and line else f"{source}: " if source else ""
        message = place + reason
        if text:
            message += f"\n    {printable(text[:_WIDEST])}"
        if text and columns is not None and columns[0] <= _WIDEST:
            first, last = columns[0], min(columns[1], _WIDEST)
            message += "\n    " + " " * (first - 1) + "^" * (last - first + 1)
        super().__init__(message)


class LineLengthError(ElementsError):
    """An element line that is cut off, or goes on too long."""


class MissingLineError(ElementsError):
    """One of the two element lines of a set is not there."""


class SwappedLinesError(ElementsError):
    """Line 2 stands before line 1."""


class ChecksumError(ElementsError):
    """The last digit of a line is not the sum of the others."""


class FieldError(ElementsError):
    """Columns that do not hold what belongs there, such as letters in a number."""


class FieldRangeError(ElementsError):
    """A number that is well formed but that no orbit has."""


class MissingFieldError(ElementsError):
    """A keyword that an orbit mean-elements message must have is not there."""


class UnwritableError(ElementsError):
    """A value that the format asked for cannot hold, such as a seven-digit number in a TLE."""


class MismatchedLinesError(ElementsError):
    """The two lines of a set belong to different objects."""


class FormatError(ElementsError):
    """Text in which no element set could be recognised, or in a format that cannot be read."""


class SourceError(TleError):
    """A file or folder of elements or observations that cannot be read."""


class SatelliteNotFoundError(TleError):
    """No element set answers to the key; `key` is empty where elements were not what was searched."""

    def __init__(self, message: str, key: str = "") -> None:
        """Keep the key for callers that know where else to look."""
        super().__init__(message)
        self.key = key


class AmbiguousSatelliteError(TleError):
    """Several objects answer to the key; `candidates` holds them as text."""

    def __init__(self, message: str, candidates: tuple[str, ...]) -> None:
        """Keep the candidates for callers that want to offer a choice."""
        super().__init__(message)
        self.candidates = candidates


class TimeFormatError(TleError):
    """Text that is no instant."""


class NaiveTimeError(TleError):
    """A datetime without a time zone, which names no instant."""


class TimeRangeError(TleError):
    """An instant that is not finite, or outside the span for which directions are defined."""


class PackageError(TleError):
    """A package that the request needs is not installed."""

    exit_code = 1


class SiteError(TleError):
    """A site that is not on Earth: out of range, not a number, not three numbers.

    `field` names the number that is wrong, as `Site` does; None where it is none of them.
    """

    def __init__(self, message: str, field: str | None = None) -> None:
        """Keep the field for callers that know where its number is from."""
        super().__init__(message)
        self.field = field


class BiasError(TleError):
    """Biases that are not finite, or have a rate without the instant it counts from."""


class RefractionError(TleError):
    """A pressure or temperature that no observatory has."""


class PlaceError(TleError):
    """A kind of place or a frame that is not known."""


class ObservationError(TleError):
    """An observation that cannot be read, or cannot be compared with the elements."""


class PropagationError(TleError):
    """SGP4 cannot tell where the satellite is; `code` is SGP4's own number (Vallado 2006)."""

    exit_code = 1

    def __init__(self, message: str, code: int) -> None:
        """Keep SGP4's error number."""
        super().__init__(message)
        self.code = code


class DecayedError(PropagationError):
    """By these elements the satellite has re-entered before the instant asked for."""


class SubOrbitalError(DecayedError):
    """The satellite is below the ground by elements whose perigee lies inside the Earth: no orbit at all."""


class MeanElementsError(PropagationError):
    """SGP4's mean eccentricity or semi-major axis has left what an orbit can have (SGP4 error 1)."""


class MeanMotionError(PropagationError):
    """SGP4's mean motion has become negative (SGP4 error 2)."""


class PerturbedElementsError(PropagationError):
    """SGP4's eccentricity with lunisolar perturbations has left 0 to 1 (SGP4 error 3)."""


class SemiLatusRectumError(PropagationError):
    """SGP4's semi-latus rectum has become negative (SGP4 error 4)."""


class EphemerisError(TleError):
    """An ephemeris that cannot be used; the message names file and line where there are any."""

    def __init__(self, reason: str, *, source: str = "", line: int | None = None) -> None:
        """Put the place, FILE:LINE, before the reason."""
        self.source = source
        self.line = line
        place = f"{source or 'text'}:{line}: " if line else f"{source}: " if source else ""
        super().__init__(place + reason)


class BodyError(TleError):
    """A body of the Solar System, a star or a direction that is not known, or cannot be placed."""


class EphemerisSpanError(PropagationError):
    """An instant for which an ephemeris has no rows: before its start, after its end, or in a gap."""


class EarthOrientationWarning(UserWarning):
    """UT1 and polar motion were taken from beyond the end of the IERS table."""


def printable(text: str, kept: str = "") -> str:
    """Return text with control characters replaced by `?`, column for column, fit for a terminal.

    Those in `kept` stay, such as a newline.
    """
    return text if text.isprintable() else "".join(c if c.isprintable() or c in kept else "?" for c in text)
