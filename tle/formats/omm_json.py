"""Orbit mean-elements messages as JSON: objects of OMM keywords, alone, in an array or one a line."""

from __future__ import annotations

import json
import re
from typing import TYPE_CHECKING

from tle.errors import ElementsError, FormatError
from tle.formats.omm import Place, elements_of, keyword_values, named

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from tle.elements import Elements

_BETWEEN = re.compile(r"[\s,\[\]]*")
_NAME = re.compile(r'"OBJECT_NAME"\s*:\s*"([^"\\]{0,80})"')
_NUMBER = re.compile(r'"NORAD_CAT_ID"\s*:\s*"?(\w{1,9})\b', re.ASCII)
_EXCERPT = 2000
_MOST_BROKEN = 1000


def looks_like_json(text: str) -> bool:
    """Tell whether a text is an object or an array of objects, and no TLE of a satellite named so."""
    if re.match(r"\s*(?:\[\s*)?\{|\s*\[\s*\]\s*\Z", text) is None:
        return False
    return re.match(r"\s*+[^\r\n]++\s++1 [ \dA-Z]{5}", text, re.ASCII) is None


def read(text: str, source: str = "") -> Iterator[Elements | ElementsError]:
    """Yield, in the order of the text, the elements of each object or the reason it is refused.

    Values may be numbers or text (Space-Track's are text). An object that is no JSON does not hide those
    after it; an array that does not end is told as cut off.
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
                yield Place(source, line).says(FormatError, "is no JSON: nothing is read from here on")
                return
            continue
        except RecursionError:
            yield Place(source, line).says(FormatError, "is nested too deep for element sets: fetch it again")
            return
        yield _set_or_refusal(value, Place(source, line))
    place = Place(source, line)
    if not found:
        yield place.says(FormatError, "holds an empty list: no element sets in it")
    elif text.lstrip()[:1] == "[" and text.rstrip()[-1:] != "]":
        yield place.says(FormatError, "the list does not end: the text is cut off, fetch it again")


def write(elements: Iterable[Elements]) -> str:
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


def _set_or_refusal(value: object, place: Place) -> Elements | ElementsError:
    if isinstance(value, list) and value:
        return place.says(FormatError, "gives a keyword twice: correct it")
    if not isinstance(value, dict):
        return place.says(FormatError, "is no object of OMM keywords: remove it")
    try:
        return elements_of(value, place)
    except ElementsError as error:
        return error


def _refusal(text: str, at: int, line: int, error: json.JSONDecodeError, source: str) -> ElementsError:
    line += text.count("\n", at, min(error.pos, at + _EXCERPT))
    end = text.find("}", at, at + _EXCERPT)
    excerpt = text[at : end if end >= 0 else at + _EXCERPT]
    found = {
        key: match.group(1)
        for key, pattern in (("OBJECT_NAME", _NAME), ("NORAD_CAT_ID", _NUMBER))
        if (match := pattern.search(excerpt))
    }
    place = Place(source, line)
    return named(place.says(FormatError, f"is no JSON ({error.msg}): fetch it again"), found)
