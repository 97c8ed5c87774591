"""Lines of a log in the Field System's style: year, day of the year, time, a sign for the kind, and words.

A program's own words stand behind its name between two `#`, an operator's behind `;`. Errors begin with
`?ERROR`, two letters and a negative number: here the number after NAK.
"""

from __future__ import annotations

from datetime import UTC, datetime
from typing import TYPE_CHECKING

from sattrack.servers.antenna.transactions import NAK_MEANINGS

if TYPE_CHECKING:
    from sattrack.servers.antenna.controller import Exchange
    from sattrack.servers.antenna.transactions import Nak

PROGRAM = "antenna"
ERRORS = "AN"


def stamp(utc_s: float) -> str:
    """Return an instant (POSIX seconds) to a hundredth of a second, cut off."""
    at = datetime.fromtimestamp(utc_s, UTC)
    return f"{at:%Y.%j.%H:%M:%S}.{at.microsecond // 10000:02d}"


def spoken(words: str, program: str = PROGRAM) -> str:
    """Return the program's own words, without the instant."""
    return f"#{program}#{words}"


def typed(words: str) -> str:
    """Return what the operator said, without the instant."""
    return f";{words}"


def refused(exchange: Exchange, why: Nak) -> str:
    """Return a refusal, without the instant."""
    return f"?ERROR {ERRORS}{-why.value:5d} {NAK_MEANINGS[why]}: {exchange.received}"
