"""The paper's sections as rows: what is sent when, and what comes back, in literal bytes.

Each row states in our words what a sentence of "Ideal Field System Antenna Interface" asks for, or what
docs/antenna-interface.md makes of it; docs/antenna-conformance.md goes through the sentences one by one.
Instants are seconds after 2026-10-02T12:00:00Z. The antenna stands still at 30° and 40°; its first axis turns
from -200° to 200°.
"""

from __future__ import annotations

from conformance_kinds import Row, Step
from conformance_line import LINE_ROWS
from conformance_trajectory import TRAJECTORY_ROWS
from conformance_usage import USAGE_ROWS

ROWS = (*LINE_ROWS, *TRAJECTORY_ROWS, *USAGE_ROWS)

__all__ = ["ROWS", "Row", "Step"]
