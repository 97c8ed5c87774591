"""Orbit mean-elements messages as CSV: a header of OMM keywords, one set a line, as CelesTrak gives them."""

from __future__ import annotations

import csv
import io
import re
from typing import TYPE_CHECKING

from tle.errors import ElementsError, FieldError, FormatError
from tle.formats.omm import FIELDS, KEYWORDS, Place, elements_of, keyword_values, named

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from tle.elements import Elements

_FIRST_LINE = re.compile(r"(?:[ \t\r]*(?:#[^\n]*)?\n)*([^\n]*)")


def looks_like_csv(text: str) -> bool:
    """Tell whether the first line that is neither blank nor a comment is a header of OMM keywords."""
    match = _FIRST_LINE.match(text)
    line = match.group(1) if match else ""
    return "," in line and ("MEAN_MOTION" in line or "NORAD_CAT_ID" in line)


def read(text: str, source: str = "") -> Iterator[Elements | ElementsError]:
    """Yield, in the order of the text, the elements of each line or the reason it is refused.

    Columns may stand in any order, and others beside them; blank lines, `#` comments and CRLF are accepted.
    A header in the middle, as in files put together, is taken as one.
    """
    header: list[str] | None = None
    for number, raw in enumerate(text.split("\n"), start=1):
        line = raw.strip()
        # A satellite's name may begin with # too: what has the header's number of cells is no comment.
        if not line or (line.startswith("#") and (header is None or line.count(",") != len(header) - 1)):
            continue
        place = Place(source, number)
        cells = _cells(line)
        if cells is not None and _is_header(cells):
            header = cells
            continue
        yield _set_or_refusal(cells, header, place)


def write(elements: Iterable[Elements]) -> str:
    """Return element sets as CSV with CelesTrak's columns; every value survives reading it again."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow([field.keyword for field in FIELDS])
    # Quoted, a name that begins with # is no comment to anybody.
    careful = csv.writer(out, lineterminator="\n", quoting=csv.QUOTE_ALL)
    for one in elements:
        (careful if one.name.startswith("#") else writer).writerow(keyword_values(one).values())
    return out.getvalue()


def _is_header(cells: list[str]) -> bool:
    # A satellite might be named like a keyword, but not in several cells.
    return len(KEYWORDS.intersection(cells)) > 2


def _cells(line: str) -> list[str] | None:
    """Return the cells of one line; None where its quotes do not match."""
    if '"' not in line:
        return line.split(",")
    try:
        return next(csv.reader([line], strict=True))
    except csv.Error:
        return None


def _set_or_refusal(
    cells: list[str] | None, header: list[str] | None, place: Place
) -> Elements | ElementsError:
    if header is None:
        return place.says(FormatError, "stands before any header of keywords: fetch the file again")
    if cells is None:
        return place.says(FieldError, "the quotes do not match, or a cell is too long: fetch the file again")
    values = dict(zip(header, cells, strict=False))
    if len(cells) != len(header):
        reason = f"{len(cells)} cells under a header of {len(header)}: the line is cut off, fetch it again"
        if len(cells) > len(header):
            reason = f"{len(cells)} cells under a header of {len(header)}: put quotes around commas"
        return named(place.says(FieldError, reason), values)
    try:
        return elements_of(values, place)
    except ElementsError as error:
        return error
