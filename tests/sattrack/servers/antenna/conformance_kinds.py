"""What a row of the conformance suite is."""

from __future__ import annotations

from typing import NamedTuple


class Step(NamedTuple):
    at_s: float
    sent: bytes
    received: bytes


class Row(NamedTuple):
    section: str
    claim: str
    steps: tuple[Step, ...]
    local: bool = False
    on_a_line: bool = True
    """False where only bytes that come at once can show it."""
