"""The sizes of a nudge that the bracket keys step through."""

from __future__ import annotations

from typing import NamedTuple


class Step(NamedTuple):
    """One press of an arrow: seconds along the track, degrees across it."""

    along_s: float
    cross_deg: float


STEPS = (Step(0.01, 0.001), Step(0.05, 0.005), Step(0.1, 0.01), Step(0.5, 0.05), Step(1.0, 0.1))
FIRST_STEP = 2
