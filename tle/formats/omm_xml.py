"""Orbit mean-elements messages as XML (CCSDS 505.0-B): one `omm`, or several within an `ndm`.

Document types and entities are refused before anything is made of them, so that no text can grow in reading.
"""

from __future__ import annotations

import re
from html import escape
from typing import TYPE_CHECKING
from xml.parsers import expat

from tle.errors import ElementsError, FieldError, FormatError
from tle.formats.omm import (
    FIELDS,
    KEYWORDS,
    METADATA,
    UNITS,
    Place,
    elements_of,
    keyword_texts,
    named,
    quoted,
)

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from tle.elements import Elements

_DEEPEST = 20
_TLE_PARAMETERS = tuple(field.keyword for field in FIELDS[9:])
_MEAN_ELEMENTS = tuple(field.keyword for field in FIELDS[2:9])


def looks_like_xml(text: str) -> bool:
    """Tell whether a text is XML with a navigation message in it."""
    return text.lstrip()[:1] == "<" and re.search(r"<(?:\w+:)?(?:ndm|omm)\b", text, re.ASCII) is not None


def read(text: str, source: str = "") -> Iterator[Elements | ElementsError]:
    """Yield, in the order of the text, the elements of each segment or the reason it is refused.

    What is no XML from some place on gives one error there, after the sets that came before it.
    """
    reader = _Reader(source)
    yield from reader.run(text)


def write(elements: Iterable[Elements], created: str = "", originator: str = "") -> str:
    """Return element sets as one `ndm`; every value survives reading it again.

    `created` (ISO 8601 UTC) and `originator` go into each header; CelesTrak leaves both empty.
    """
    head = (
        f"<header><CREATION_DATE>{escape(created, quote=False)}</CREATION_DATE>"
        f"<ORIGINATOR>{escape(originator, quote=False)}</ORIGINATOR></header>"
    )
    messages = "".join(_message(keyword_texts(one), head) for one in elements)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n<ndm>\n{messages}</ndm>\n'


def _message(texts: dict[str, str], head: str) -> str:
    def tags(keywords: Iterable[str]) -> str:
        return "".join(f"<{key}>{escape(texts[key], quote=False)}</{key}>" for key in keywords)

    texts = {key: allowed[0] for key, allowed in METADATA.items()} | texts
    return (
        f'<omm id="CCSDS_OMM_VERS" version="3.0">{head}<body><segment>'
        f"<metadata>{tags(('OBJECT_NAME', 'OBJECT_ID', *METADATA))}</metadata>"
        f"<data><meanElements>{tags(_MEAN_ELEMENTS)}</meanElements>"
        f"<tleParameters>{tags(_TLE_PARAMETERS)}</tleParameters></data>"
        "</segment></body></omm>\n"
    )


class _Reader:
    """The state of reading one text: the segment at hand, and the sets found."""

    def __init__(self, source: str) -> None:
        self._source = source
        self._found: list[Elements | ElementsError] = []
        self._values: dict[str, str] = {}
        self._wrong: ElementsError | None = None
        self._line = 0
        self._blank_lines = 0
        self._inside = False
        self._segments = 0
        self._depth = 0
        self._keyword = ""
        self._pieces: list[str] = []
        self._parser = expat.ParserCreate()
        self._parser.buffer_text = True
        self._parser.StartElementHandler = self._start
        self._parser.EndElementHandler = self._end
        self._parser.CharacterDataHandler = self._characters
        self._parser.StartDoctypeDeclHandler = self._refuse_doctype
        self._parser.EntityDeclHandler = self._refuse_doctype

    def run(self, text: str) -> list[Elements | ElementsError]:
        """Read the whole text and return what it holds."""
        # An XML declaration must come first, which blank lines before it would spoil.
        message = text.lstrip()
        self._blank_lines = text.count("\n", 0, len(text) - len(message))
        try:
            self._parser.Parse(message, True)
        except expat.ExpatError as error:
            words = expat.ErrorString(error.code)
            self._stop(f"is no XML from here on ({words}): fetch it again", error.lineno + self._blank_lines)
        except UnicodeEncodeError:
            self._stop("holds characters that no text has: fetch it again", None)
        except ElementsError as error:
            self._found.append(error)
        if not self._found:
            self._stop("holds no orbit mean-elements message (OMM)", None)
        return self._found

    def _stop(self, reason: str, line: int | None) -> None:
        error = Place(self._source, line).says(FormatError, reason)
        self._found.append(named(error, self._values) if self._inside else error)

    def _place(self) -> Place:
        return Place(self._source, self._parser.CurrentLineNumber + self._blank_lines)

    def _refuse_doctype(self, *_: object) -> None:
        raise self._place().says(
            FormatError, "declares a document type or entities, which no orbit message needs: refused"
        )

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        self._depth += 1
        if self._depth > _DEEPEST:
            raise self._place().says(FormatError, "is nested deeper than any orbit message: refused")
        local = tag.rpartition(":")[2]
        if local == "omm":
            self._segments = 0
        if local == "segment":
            self._inside, self._values, self._wrong = True, {}, None
            self._segments += 1
            self._line = self._parser.CurrentLineNumber + self._blank_lines
        self._keyword = local if self._inside and local in KEYWORDS else ""
        self._pieces = []
        unit = attributes.get("units", "").strip().lower()
        if self._keyword and unit and unit != UNITS.get(self._keyword, "").lower():
            wanted = UNITS.get(self._keyword) or "plain numbers"
            self._note(f"{self._keyword} is in {quoted(unit)}, not in {wanted}")

    def _characters(self, text: str) -> None:
        if self._keyword:
            self._pieces.append(text)

    def _end(self, tag: str) -> None:
        self._depth -= 1
        local = tag.rpartition(":")[2]
        if self._keyword and local == self._keyword:
            if local in self._values:
                self._note(f"{local} is given twice")
            self._values[local] = "".join(self._pieces)
        self._keyword = ""
        if local == "segment" and self._inside:
            self._found.append(self._set_or_refusal())
            self._inside = False
        if local == "omm" and not self._segments:
            self._found.append(
                self._place().says(FormatError, "the message holds no segment: fetch it again")
            )

    def _note(self, reason: str) -> None:
        """Keep the first thing wrong in this segment."""
        if self._wrong is None:
            self._wrong = self._place().says(FieldError, f"{reason}: correct it")

    def _set_or_refusal(self) -> Elements | ElementsError:
        if self._wrong is not None:
            return named(self._wrong, self._values)
        try:
            return elements_of(self._values, Place(self._source, self._line))
        except ElementsError as error:
            return error
