"""Numbers as INDI's messages have them: whole, decimal, with an exponent, or sexagesimal.

Source: "INDI: Instrument-Neutral Distributed Interface", protocol 1.7, numberValue: parts of a sexagesimal
number are separated by a blank, a colon or a semicolon, and those that are left out are 0.
"""

from __future__ import annotations

import math
import re

_PART = r"(?:\d+\.?\d*|\.\d+)"
_SEXAGESIMAL = re.compile(rf"([+-]?)({_PART})(?:[:; ]({_PART})?)?(?:[:; ]({_PART})?)?", re.ASCII)
_EXPONENT = re.compile(rf"[+-]?{_PART}[eE][+-]?\d{{1,3}}", re.ASCII)


def read_number(text: str | None) -> float | None:
    """Return the number that a text is, None where it is none or not finite."""
    stripped = (text or "").strip()
    if _EXPONENT.fullmatch(stripped):
        value = float(stripped)
    elif (found := _SEXAGESIMAL.fullmatch(stripped)) is not None:
        size = sum(float(part or 0.0) / 60.0**power for power, part in enumerate(found.groups()[1:]))
        value = -size if found[1] == "-" else size
    else:
        return None
    return value if math.isfinite(value) else None
