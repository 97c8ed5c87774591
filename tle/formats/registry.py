"""Which formats there are, and which of them a text is in, by its content and never by a file's name."""

from __future__ import annotations

import importlib
import re
from typing import TYPE_CHECKING

from tle.errors import ElementsError, FormatError, SourceError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from tle.elements import Elements

    _Reader = Callable[[str, str], Iterator[Elements | ElementsError]]

# Name, what a text of it cannot be without, and the module, imported only for a text that may be of it.
_READERS: tuple[tuple[str, Callable[[str], bool], str], ...] = (
    ("xml", lambda text: text.lstrip()[:1] == "<", "omm_notations"),
    ("json", lambda text: text.lstrip()[:1] in ("[", "{"), "omm_notations"),
    ("gpredict", lambda text: "TLE1=" in text, "tle"),
    ("csv", lambda text: "MEAN_MOTION" in text or "NORAD_CAT_ID" in text, "omm_notations"),
    ("kvn", lambda text: "=" in text, "omm_notations"),
    ("tle", lambda _: True, "tle"),
)
WRITTEN = ("csv", "json", "xml", "kvn", "tle", "2le")
# Compiled where they are used: a text that can be read needs none of these.
_TDM = r"^\s*CCSDS_TDM_VERS\b|<(?:\w+:)?tdm\b"
# gpredict's categories: a title, then numbers.
_NUMBERS = r"[^\n]{0,200}\n(?:\d{1,9}\r?\n)+\s*"
_HTML = r"\s*<(?:!doctype\s+html|html|head|body)\b"


def _reader(text: str) -> _Reader | None:
    """Return the reader of the format that a text is in."""
    for name, may_be, module_name in _READERS:
        if not may_be(text):
            continue
        module = importlib.import_module(f"tle.formats.{module_name}")
        if getattr(module, f"looks_like_{name}")(text):
            reader: _Reader = getattr(module, f"read_{name}")
            return reader
    return None


def is_html(text: str) -> bool:
    """Tell whether a text is a web page."""
    return re.match(_HTML, text, re.IGNORECASE) is not None


def parse_elements(text: str, source: str = "") -> list[Elements | ElementsError]:
    """Return every set in a text, or the reason it is refused, in order, in a format recognised by content.

    Reads TLE, 3LE, OMM (CSV, JSON, XML, KVN) and gpredict's list. A text without sets gives one FormatError.
    """
    text = text.removeprefix("\ufeff")
    if "\n" not in text:
        text = text.replace("\r", "\n")
    reader = _reader(text)
    if reader is not None:
        found = list(reader(text, source))
        if found:
            return found
    return [FormatError(_nothing(text), source=source or "the text")]


def write_elements(elements: Iterable[Elements], form: str, created: str = "", originator: str = "") -> str:
    """Return element sets as text in one of the formats WRITTEN: OMM as csv, json, xml or kvn; tle or 2le.

    OMM keeps every value exactly; TLE to the precision of its columns, "2le" without names. `created`
    (ISO 8601 UTC) and `originator` go into the headers of XML and KVN. Raises UnwritableError where a TLE
    cannot hold a value, SourceError for an unknown format.
    """
    if form in ("tle", "2le"):
        from tle.formats import tle

        return tle.write_tle(elements, names=form == "tle")
    from tle.formats import omm_notations as omm

    if form in ("csv", "json"):
        return omm.write_csv(elements) if form == "csv" else omm.write_json(elements)
    if form in ("xml", "kvn"):
        return (omm.write_xml if form == "xml" else omm.write_kvn)(elements, created, originator)
    raise SourceError(f"{form!r} is no format of elements: give one of {', '.join(WRITTEN)}")


def _nothing(text: str) -> str:
    """Return what to say of a text without element sets."""
    if not text.strip():
        return "is empty: no element sets in it"
    if is_html(text):
        return "is a web page and holds no element sets: save the data itself, as CSV or JSON"
    if re.search(_TDM, text, re.ASCII):
        return "is a tracking data message (TDM), which holds observations and no element sets"
    if re.fullmatch(_NUMBERS, text, re.ASCII):
        return "is a list of catalogue numbers without element sets: give the sets themselves"
    return "holds no element sets: give a TLE, 3LE or OMM file"
