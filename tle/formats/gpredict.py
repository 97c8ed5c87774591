"""Two-line sets inside gpredict's satellite list: sections of NAME=, TLE1= and TLE2=."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from tle.errors import ElementsError, MissingLineError
from tle.formats import tle

if TYPE_CHECKING:
    from collections.abc import Iterator

    from tle.elements import Elements

_SECTION = re.compile(r"\[\d{1,9}\]", re.ASCII)
_MARK = re.compile(r"^\[\d{1,9}\][ \t\r]*$", re.MULTILINE | re.ASCII)


def looks_like_gpredict(text: str) -> bool:
    """Tell whether a text has section lines such as [25544] and element lines behind TLE1=."""
    return "TLE1=" in text and _MARK.search(text) is not None


def read(text: str, source: str = "") -> Iterator[Elements | ElementsError]:
    """Yield, in the order of the text, the elements of each section or the reason it is refused."""
    section: tle.Line | None = None
    values: dict[str, tle.Line] = {}
    for number, raw in enumerate(text.split("\n"), start=1):
        line = raw.strip()
        if _SECTION.fullmatch(line):
            if section is not None:
                yield _set_or_refusal(section, values)
            section, values = tle.Line(line, source, number), {}
            continue
        key, _, value = line.partition("=")
        if key in ("NAME", "TLE1", "TLE2"):
            values[key] = tle.Line(value.strip(), source, number)
    if section is not None:
        yield _set_or_refusal(section, values)


def _set_or_refusal(section: tle.Line, values: dict[str, tle.Line]) -> Elements | ElementsError:
    name = tle.clean_name(values["NAME"].text) if "NAME" in values else ""
    try:
        for key in ("TLE1", "TLE2"):
            if key not in values:
                raise section.says(MissingLineError, f"the section has no {key}: update the list in gpredict")
        return tle.parse_lines(values["TLE1"], values["TLE2"], name)
    except ElementsError as error:
        error.name, error.catalog_number = name, int(section.text[1:-1])
        return error
