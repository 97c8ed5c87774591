"""Which formats there are, and which of them a text is in; told by the content, never by a file's name."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from tle.errors import ElementsError, FormatError, SourceError
from tle.formats import gpredict, omm_csv, omm_json, omm_kvn, omm_xml, tle, tle_writer

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from tle.elements import Elements

    # Name, whether a text looks like it, and the reader of a text from a named source.
    _Reader = tuple[str, Callable[[str], bool], Callable[[str, str], Iterator[Elements | ElementsError]]]

_READERS: tuple[_Reader, ...] = (
    ("xml", omm_xml.looks_like_xml, omm_xml.read),
    ("json", omm_json.looks_like_json, omm_json.read),
    ("gpredict", gpredict.looks_like_gpredict, gpredict.read),
    ("csv", omm_csv.looks_like_csv, omm_csv.read),
    ("kvn", omm_kvn.looks_like_kvn, omm_kvn.read),
    ("tle", tle.looks_like_tle, tle.read),
)
WRITTEN = ("csv", "json", "xml", "kvn", "tle", "2le")
_TDM = re.compile(r"^\s*CCSDS_TDM_VERS\b|<(?:\w+:)?tdm\b", re.ASCII)
# gpredict's categories: a title, then numbers.
_NUMBERS = re.compile(r"[^\n]{0,200}\n(?:\d{1,9}\r?\n)+\s*", re.ASCII)
_HTML = re.compile(r"\s*<(?:!doctype\s+html|html|head|body)\b", re.IGNORECASE)


def recognise(text: str) -> str | None:
    """Return the format of a text, one of xml, json, gpredict, csv, kvn, tle; None where it is none."""
    return next((name for name, looks_like, _ in _READERS if looks_like(text)), None)


def is_html(text: str) -> bool:
    """Tell whether a text is a web page."""
    return _HTML.match(text) is not None


def parse_elements(text: str, source: str = "") -> list[Elements | ElementsError]:
    """Return every set in a text, or the reason it is refused, in order; the format is told by the content.

    Reads TLE, 3LE, OMM (CSV, JSON, XML, KVN) and gpredict's list. A text without sets gives one FormatError.
    """
    text = text.removeprefix("\ufeff")
    if "\n" not in text:
        text = text.replace("\r", "\n")
    for _, looks_like, read in _READERS:
        if looks_like(text):
            found = list(read(text, source))
            if found:
                return found
            break
    return [FormatError(_nothing(text), source=source or "the text")]


def write_elements(elements: Iterable[Elements], form: str, created: str = "", originator: str = "") -> str:
    """Return element sets as text in one of the formats WRITTEN: OMM as csv, json, xml or kvn; tle or 2le.

    OMM keeps every value exactly; TLE to the precision of its columns, "2le" without names. `created`
    (ISO 8601 UTC) and `originator` go into the headers of XML and KVN. Raises UnwritableError where a TLE
    cannot hold a value, SourceError for an unknown format.
    """
    if form == "csv":
        return omm_csv.write(elements)
    if form == "json":
        return omm_json.write(elements)
    if form == "xml":
        return omm_xml.write(elements, created, originator)
    if form == "kvn":
        return omm_kvn.write(elements, created, originator)
    if form in ("tle", "2le"):
        return tle_writer.write(elements, names=form == "tle")
    raise SourceError(f"{form!r} is no format of elements: give one of {', '.join(WRITTEN)}")


def _nothing(text: str) -> str:
    """Return what to say of a text without element sets."""
    if not text.strip():
        return "is empty: no element sets in it"
    if is_html(text):
        return "is a web page and holds no element sets: save the data itself, as CSV or JSON"
    if _TDM.search(text):
        return "is a tracking data message (TDM), which holds observations and no element sets"
    if _NUMBERS.fullmatch(text):
        return "is a list of catalogue numbers without element sets: give the sets themselves"
    return "holds no element sets: give a TLE, 3LE or OMM file"
