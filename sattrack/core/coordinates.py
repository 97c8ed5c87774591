"""Right ascension and declination as people write them, to degrees."""

from __future__ import annotations

import re

from sattrack.core.errors import BadInputError

RA_FORMS = "5h30m, 5:30:00, 5.5h or degrees as 82.5"
DEC_FORMS = "-12.5, -12:30:00 or -12d30m"
MINUS = "\N{MINUS SIGN}"

_NUMBER = r"([0-9]+(?:\.[0-9]*)?|\.[0-9]+)"
_ANGLE = re.compile(
    rf"""\s* ([+\-{MINUS}]?) \s* {_NUMBER} \s*
    (?: ([hd°:]) \s* (?: {_NUMBER} \s* (?: [m'′:] \s* (?: {_NUMBER} \s* [s"″]? \s* )? )? )? )?""",
    re.VERBOSE,
)


def parse_ra(text: str) -> float:
    """Return a right ascension, degrees from 0 to below 360; with h or colons hours, else degrees.

    Raises BadInputError.
    """
    value, unit = _parse(text, "right ascension", RA_FORMS)
    in_hours = unit in ("h", ":")
    degrees = value * 15.0 if in_hours else value
    if not 0.0 <= degrees < 360.0:
        bounds = "from 0h to below 24h" if in_hours else "from 0 to below 360 degrees (24h)"
        raise BadInputError(f"right ascension {text!r}: it runs {bounds}")
    return degrees


def parse_dec(text: str) -> float:
    """Return a declination, degrees from -90 to 90. Raises BadInputError."""
    value, unit = _parse(text, "declination", DEC_FORMS)
    if unit == "h":
        raise BadInputError(f"declination {text!r}: it is in degrees, not hours; write {DEC_FORMS}")
    if not -90.0 <= value <= 90.0:
        raise BadInputError(f"declination {text!r}: it runs from -90 to 90 degrees")
    return value


def _parse(text: str, what: str, forms: str) -> tuple[float, str]:
    found = _ANGLE.fullmatch(text)
    if found is None or (found[3] == ":" and found[4] is None):
        raise BadInputError(f"{what} {text!r}: write {forms}")
    sign, first, unit, minutes, seconds = found.groups()
    for number, follower, name in ((first, minutes, "minutes"), (minutes, seconds, "seconds")):
        if follower is None:
            continue
        if "." in number:
            raise BadInputError(f"{what} {text!r}: {number} is no whole number, yet {name} follow it")
        if float(follower) >= 60.0:
            raise BadInputError(f"{what} {text!r}: {follower} {name}; there are 60 of them")
    value = float(first) + float(minutes or 0.0) / 60.0 + float(seconds or 0.0) / 3600.0
    return (-value if sign in ("-", MINUS) else value), unit or ""
