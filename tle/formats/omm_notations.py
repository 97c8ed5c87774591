"""Orbit mean-elements messages in their four notations: CSV, KVN, JSON and XML.

CSV is a header of OMM keywords and one set a line, as CelesTrak gives them; JSON objects of keywords stand
alone, in an array or one a line; KVN is CCSDS 502.0-B, XML CCSDS 505.0-B. In XML document types and entities
are refused before anything is made of them, so that no text can grow in reading.
"""

from __future__ import annotations

import csv
import io
import json
import re
from dataclasses import dataclass, field
from html import escape
from typing import TYPE_CHECKING
from xml.parsers import expat

from tle.errors import ElementsError, FieldError, FormatError
from tle.formats.omm import (
    FIELDS,
    KEYWORDS,
    METADATA,
    UNITS,
    TextPlace,
    keyword_texts,
    keyword_values,
    named,
    quoted,
    set_or_refusal,
)

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    import numpy as np
    from numpy.typing import NDArray

    from tle.elements import Elements

DOCTYPE_REFUSED = "declares a document type or entities, which no such message needs: refused"
_FIRST_LINE = re.compile(r"(?:[ \t\r]*(?:#[^\n]*)?\n)*([^\n]*)")
_MARKS = ("CCSDS_OMM_VERS", "MEAN_MOTION", "NORAD_CAT_ID")
_MARK = re.compile(rf"^[ \t]*(?:{'|'.join(_MARKS)})[ \t]*=", re.MULTILINE | re.ASCII)
_BETWEEN = re.compile(r"[\s,\[\]]*")
_NAME = re.compile(r'"OBJECT_NAME"\s*:\s*"([^"\\]{0,80})"')
_NUMBER = re.compile(r'"NORAD_CAT_ID"\s*:\s*"?(\w{1,9})\b', re.ASCII)
_EXCERPT = 2000
_MOST_BROKEN = 1000
_DEEPEST = 20
_TLE_PARAMETERS = tuple(field.keyword for field in FIELDS[9:])
_MEAN_ELEMENTS = tuple(field.keyword for field in FIELDS[2:9])


def looks_like_csv(text: str) -> bool:
    """Tell whether the first line that is neither blank nor a comment is a header of OMM keywords."""
    match = _FIRST_LINE.match(text)
    line = match.group(1) if match else ""
    return "," in line and ("MEAN_MOTION" in line or "NORAD_CAT_ID" in line)


def read_csv(text: str, source: str = "") -> Iterator[Elements | ElementsError]:
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
        place = TextPlace(source, number)
        cells = _cells(line)
        if cells is not None and _is_header(cells):
            header = cells
            continue
        yield _row(cells, header, place)


def write_csv(elements: Iterable[Elements]) -> str:
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


def _row(cells: list[str] | None, header: list[str] | None, place: TextPlace) -> Elements | ElementsError:
    if header is None:
        return place.error(FormatError, "stands before any header of keywords: fetch the file again")
    if cells is None:
        return place.error(FieldError, "the quotes do not match, or a cell is too long: fetch the file again")
    values = dict(zip(header, cells, strict=False))
    wrong = None
    if len(cells) != len(header):
        reason = f"{len(cells)} cells under a header of {len(header)}: the line is cut off, fetch it again"
        if len(cells) > len(header):
            reason = f"{len(cells)} cells under a header of {len(header)}: put quotes around commas"
        wrong = place.error(FieldError, reason)
    return set_or_refusal(values, place, wrong)


def looks_like_kvn(text: str) -> bool:
    """Tell whether a text has lines such as an OMM in this notation has."""
    # The plain search is a hundred times as fast over a catalogue of another format.
    return any(keyword in text for keyword in _MARKS) and _MARK.search(text) is not None


@dataclass(slots=True)
class _Message:
    """The keywords of one message, the line it begins in, and the first thing wrong in it."""

    line: int
    values: dict[str, str] = field(default_factory=dict)
    wrong: ElementsError | None = None

    def take(self, keyword: str, value: str) -> str:
        """Take one keyword; return what is wrong with it, or an empty text."""
        if keyword not in KEYWORDS:
            return ""
        if keyword in self.values:
            return f"{keyword} is given twice"
        text, unit = value, ""
        if keyword in UNITS and value.endswith("]"):
            text, _, unit = value[:-1].partition("[")
        self.values[keyword] = text.strip()
        if unit and unit.strip().lower() != UNITS[keyword].lower():
            return f"{keyword} is in {quoted(unit)}, not in {UNITS[keyword]}"
        return ""

    def ended(self, source: str) -> Elements | ElementsError:
        """Return the elements of the message, or the reason it is refused."""
        return set_or_refusal(self.values, TextPlace(source, self.line), self.wrong)


def read_kvn(text: str, source: str = "") -> Iterator[Elements | ElementsError]:
    """Yield, in the order of the text, the elements of each message or the reason it is refused.

    A message begins with CCSDS_OMM_VERS, or where OBJECT_NAME comes again.
    """
    message: _Message | None = None
    for number, raw in enumerate(text.split("\n"), start=1):
        line = raw.strip()
        if not line or line.startswith("#") or line.split(None, 1)[0] == "COMMENT":
            continue
        keyword, equals, value = (piece.strip() for piece in line.partition("="))
        begins = keyword == "CCSDS_OMM_VERS"
        if message is None or begins or (keyword == "OBJECT_NAME" and keyword in message.values):
            if message is not None:
                yield message.ended(source)
            message = _Message(number)
        reason = message.take(keyword, value) if equals else f"{quoted(line)} is no KEYWORD = value"
        if reason and message.wrong is None:
            message.wrong = TextPlace(source, number).error(FieldError, f"{reason}: correct it")
    if message is not None:
        yield message.ended(source)


def write_kvn(elements: Iterable[Elements], created: str = "", originator: str = "") -> str:
    """Return element sets as messages in KVN; every value survives reading it again.

    `created` (ISO 8601 UTC) and `originator` go into each header.
    """
    return "\n".join(_kvn(keyword_texts(one), created, originator) for one in elements)


COVARIANCE = ("X", "Y", "Z", "X_DOT", "Y_DOT", "Z_DOT")


def covariance_kvn(covariance_km2: NDArray[np.float64], frame: str = "TEME") -> str:
    """Return the covariance of position and velocity, shape (6, 6), as the last lines of a message in KVN.

    CCSDS 502.0-B-3, 4.2.4.5: the lower triangle in km², km²/s and km²/s².
    """
    rows = [
        f"C{COVARIANCE[i]}_{COVARIANCE[j]} = {covariance_km2[i, j]:.12e}\n"
        for i in range(6)
        for j in range(i + 1)
    ]
    return f"COV_REF_FRAME = {frame}\n{''.join(rows)}"


def _kvn(texts: dict[str, str], created: str, originator: str) -> str:
    head = {"CCSDS_OMM_VERS": "3.0", "CREATION_DATE": created, "ORIGINATOR": originator}
    names = {key: texts.pop(key) for key in ("OBJECT_NAME", "OBJECT_ID")}
    frame = {key: allowed[0] for key, allowed in METADATA.items()}
    every = head | names | frame | texts
    return "".join(f"{key} = {value}".rstrip() + "\n" for key, value in every.items())


def looks_like_json(text: str) -> bool:
    """Tell whether a text is an object or an array of objects, and no TLE of a satellite named so."""
    if re.match(r"\s*(?:\[\s*)?\{|\s*\[\s*\]\s*\Z", text) is None:
        return False
    return re.match(r"\s*+[^\r\n]++\s++1 [ \dA-Z]{5}", text, re.ASCII) is None


def read_json(text: str, source: str = "") -> Iterator[Elements | ElementsError]:
    """Yield, in the order of the text, the elements of each object or the reason it is refused.

    Values may be numbers or text (Space-Track's are text). An object that is no JSON does not hide those
    after it; an array that does not end is refused as cut off.
    """
    decoder = json.JSONDecoder(object_pairs_hook=_object, parse_int=_whole)
    at, line, counted = 0, 1, 0
    found, broken = False, 0
    while True:
        between = _BETWEEN.match(text, at)
        at = between.end() if between else at
        if at >= len(text):
            break
        line, counted = line + text.count("\n", counted, at), at
        found = True
        try:
            value, at = decoder.raw_decode(text, at)
        except json.JSONDecodeError as error:
            yield _refusal(text, at, line, error, source)
            # OMM objects hold no others: the next one begins at the next brace.
            at = text.find("{", max(error.pos, at + 1))
            broken += 1
            if at < 0:
                return
            if broken == _MOST_BROKEN:
                yield TextPlace(source, line).error(FormatError, "is no JSON: nothing is read from here on")
                return
            continue
        except RecursionError:
            yield TextPlace(source, line).error(
                FormatError, "is nested too deep for element sets: fetch it again"
            )
            return
        if isinstance(value, dict):
            yield set_or_refusal(value, TextPlace(source, line))
        else:
            twice = isinstance(value, list) and value
            wrong = (
                "gives a keyword twice: correct it" if twice else "is no object of OMM keywords: remove it"
            )
            yield TextPlace(source, line).error(FormatError, wrong)
    place = TextPlace(source, line)
    if not found:
        yield place.error(FormatError, "holds an empty list: no element sets in it")
    elif text.lstrip()[:1] == "[" and text.rstrip()[-1:] != "]":
        yield place.error(FormatError, "the list does not end: the text is cut off, fetch it again")


def write_json(elements: Iterable[Elements]) -> str:
    """Return element sets as a JSON array, one object a line; every value survives reading it again."""
    rows = [json.dumps(keyword_values(one), ensure_ascii=False) for one in elements]
    return "[" + ",\n".join(rows) + "]\n"


def _object(pairs: list[tuple[str, object]]) -> object:
    """Return an object's keywords and values; the bare pairs where a keyword comes twice."""
    values = dict(pairs)
    return values if len(values) == len(pairs) else pairs


def _whole(digits: str) -> int | str:
    # Longer numbers are none of ours, and Python takes quadratic time over thousands of digits.
    return int(digits) if len(digits) <= 20 else digits


def _refusal(text: str, at: int, line: int, error: json.JSONDecodeError, source: str) -> ElementsError:
    line += text.count("\n", at, min(error.pos, at + _EXCERPT))
    end = text.find("}", at, at + _EXCERPT)
    excerpt = text[at : end if end >= 0 else at + _EXCERPT]
    found = {
        key: match.group(1)
        for key, pattern in (("OBJECT_NAME", _NAME), ("NORAD_CAT_ID", _NUMBER))
        if (match := pattern.search(excerpt))
    }
    place = TextPlace(source, line)
    return named(place.error(FormatError, f"is no JSON ({error.msg}): fetch it again"), found)


def looks_like_xml(text: str) -> bool:
    """Tell whether a text is XML with a navigation message in it."""
    return text.lstrip()[:1] == "<" and re.search(r"<(?:\w+:)?(?:ndm|omm)\b", text, re.ASCII) is not None


def read_xml(text: str, source: str = "") -> Iterator[Elements | ElementsError]:
    """Yield, in the order of the text, the elements of each segment or the reason it is refused.

    What is no XML from some place on gives one error there, after the sets that came before it.
    """
    yield from _Xml(source).run(text)


def write_xml(elements: Iterable[Elements], created: str = "", originator: str = "") -> str:
    """Return element sets as one `ndm`; every value survives reading it again.

    `created` (ISO 8601 UTC) and `originator` go into each header; CelesTrak leaves both empty.
    """
    head = (
        f"<header><CREATION_DATE>{escape(created, quote=False)}</CREATION_DATE>"
        f"<ORIGINATOR>{escape(originator, quote=False)}</ORIGINATOR></header>"
    )
    messages = "".join(_xml(keyword_texts(one), head) for one in elements)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n<ndm>\n{messages}</ndm>\n'


def _xml(texts: dict[str, str], head: str) -> str:
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


class _Xml:
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
        error = TextPlace(self._source, line).error(FormatError, reason)
        self._found.append(named(error, self._values) if self._inside else error)

    def _place(self) -> TextPlace:
        return TextPlace(self._source, self._parser.CurrentLineNumber + self._blank_lines)

    def _refuse_doctype(self, *_: object) -> None:
        raise self._place().error(FormatError, DOCTYPE_REFUSED)

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        self._depth += 1
        if self._depth > _DEEPEST:
            raise self._place().error(FormatError, "is nested deeper than any orbit message: refused")
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
            self._found.append(set_or_refusal(self._values, TextPlace(self._source, self._line), self._wrong))
            self._inside = False
        if local == "omm" and not self._segments:
            self._found.append(
                self._place().error(FormatError, "the message holds no segment: fetch it again")
            )

    def _note(self, reason: str) -> None:
        """Keep the first thing wrong in this segment."""
        if self._wrong is None:
            self._wrong = self._place().error(FieldError, f"{reason}: correct it")
