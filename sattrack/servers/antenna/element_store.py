"""A satellite's elements as they come, a line or a value at a time, checked as they come.

The checks of lines are those of the Field System's `tle` command: the line's number, the catalogue number,
the check-sum. "Ideal Field System Antenna Interface", section 8.0.
"""

from __future__ import annotations

from sattrack.servers.antenna.transactions import Nak
from tle.elements import Elements, parse_alpha5
from tle.errors import ElementsError, FieldRangeError, MissingFieldError
from tle.formats.omm import KEYWORDS, Place, elements_of
from tle.formats.tle import parse_set
from tle.formats.tle_regular import checksum

HARMLESS = {
    "OBJECT_NAME": "A",
    "EPOCH": "2000-01-01T12:00:00",
    "MEAN_MOTION": "15",
    "ECCENTRICITY": "0",
    "INCLINATION": "0",
    "RA_OF_ASC_NODE": "0",
    "ARG_OF_PERICENTER": "0",
    "MEAN_ANOMALY": "0",
    "NORAD_CAT_ID": "1",
    "BSTAR": "0",
    "MEAN_MOTION_DOT": "0",
    "MEAN_MOTION_DDOT": "0",
}
"""Values that are well formed: among them, one that came is read by itself."""
LINE_LENGTH = 69
NAME_LENGTH = 24


class StoreError(Exception):
    """Elements that cannot be taken, or are not there; `why` is the number of the refusal."""

    def __init__(self, why: Nak) -> None:
        super().__init__(why.name)
        self.why = why


class ElementStore:
    """The elements of one satellite: another's number begins anew, and so does the other format."""

    def __init__(self) -> None:
        self._number: int | None = None
        self._lines: dict[int, str] = {}
        self._values: dict[str, str] = {}

    def take_line(self, line: int, number: int, text: str) -> None:
        """Take a name (line 0) or an element line (1 or 2). Raises StoreError; what was there stays."""
        if line == 0:
            if len(text) > NAME_LENGTH:
                raise StoreError(Nak.RANGE)
        else:
            _check_line(line, number, text)
        self._begin(number, self._values)
        self._lines[line] = text

    def take_value(self, number: int, keyword: str, value: str) -> None:
        """Take the value of one OMM keyword. Raises StoreError; what was there stays."""
        if keyword not in KEYWORDS:
            raise StoreError(Nak.VALUE)
        if keyword == "NORAD_CAT_ID" and value != str(number):
            raise StoreError(Nak.ELEMENTS_NUMBER)
        try:
            elements_of(HARMLESS | {keyword: value}, Place())
        except FieldRangeError as error:
            raise StoreError(Nak.RANGE) from error
        except ElementsError as error:
            raise StoreError(Nak.VALUE) from error
        self._begin(number, self._lines)
        self._values[keyword] = value

    def elements(self, number: int) -> Elements:
        """Return the elements of a satellite. Raises StoreError."""
        if self._number is None:
            raise StoreError(Nak.ELEMENTS_MISSING)
        if number != self._number:
            raise StoreError(Nak.ELEMENTS_NUMBER)
        try:
            if self._values:
                return elements_of({"NORAD_CAT_ID": str(number)} | self._values, Place())
            if 1 not in self._lines or 2 not in self._lines:
                raise StoreError(Nak.ELEMENTS_MISSING)
            return parse_set(self._lines[1], self._lines[2], self._lines.get(0, ""))
        except ElementsError as error:
            missing = isinstance(error, MissingFieldError)
            raise StoreError(Nak.ELEMENTS_MISSING if missing else Nak.ELEMENTS_USELESS) from error

    def _begin(self, number: int, other_format: dict[int, str] | dict[str, str]) -> None:
        if number != self._number:
            self._lines.clear()
            self._values.clear()
        self._number = number
        other_format.clear()


def _check_line(line: int, number: int, text: str) -> None:
    if not text.startswith(f"{line} "):
        raise StoreError(Nak.ELEMENTS_LINE)
    if parse_alpha5(text[2:7].replace(" ", "0")) != number:
        raise StoreError(Nak.ELEMENTS_NUMBER)
    if len(text) != LINE_LENGTH or text[-1] != str(checksum(text)):
        raise StoreError(Nak.ELEMENTS_CHECK)
