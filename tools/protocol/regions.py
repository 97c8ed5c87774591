"""Text between markers in a file that is otherwise written by hand."""

from __future__ import annotations

import re


class RegionError(ValueError):
    """A file does not have the region that belongs into it, exactly once."""


def replace_region(text: str, name: str, body: str, comment: tuple[str, str] = ("<!-- ", " -->")) -> str:
    """Return `text` with `body` between its lines `BEGIN name` and `END name`.

    Markers are comments of the file's own language, opened and closed by `comment`; words may follow the name
    of the first. Raises RegionError, naming the region, unless it is there exactly once.
    """
    opens, closes = (re.escape(part) for part in comment)
    pattern = re.compile(
        rf"(?P<begin>^{opens}BEGIN {re.escape(name)}\b[^\n]*\n).*?"
        rf"(?P<end>^{opens}END {re.escape(name)}{closes}$)",
        re.DOTALL | re.MULTILINE,
    )
    if len(pattern.findall(text)) != 1:
        raise RegionError(
            f"region {name!r} is there {len(pattern.findall(text))} times; it must be there once"
        )
    return pattern.sub(lambda found: f"{found['begin']}{body.rstrip()}\n{found['end']}", text)
