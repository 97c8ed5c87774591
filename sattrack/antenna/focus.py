"""A simulated focuser: axes that move to a place, or sweep between their limits, at uniform rates.

"Ideal Field System Antenna Interface", section 6.0. Positions in mm; instants in nanoseconds of UTC.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from sattrack.antenna.trajectory import NS

if TYPE_CHECKING:
    from collections.abc import Sequence

MOVE_RATE_MM_S = 2.0
LEAST_MM, MOST_MM = -50.0, 50.0


@dataclass(slots=True)
class FocusAxis:
    """One axis: from a place at an instant, on to another, or to and fro between the limits."""

    _from_mm: float = 0.0
    _to_mm: float = 0.0
    _since_ns: int = 0
    _sweep_mm_s: float = 0.0

    def at(self, utc_ns: int) -> tuple[float, bool]:
        """Return where it is at an instant, and whether it moves."""
        seconds = max(0.0, (utc_ns - self._since_ns) / NS)
        if self._sweep_mm_s:
            # As if on a loop: up from the least to the most and down again, begun where it stood.
            span = MOST_MM - LEAST_MM
            way = (self._from_mm - LEAST_MM + self._sweep_mm_s * seconds) % (2.0 * span)
            return LEAST_MM + min(way, 2.0 * span - way), True
        way = self._to_mm - self._from_mm
        gone = min(abs(way), MOVE_RATE_MM_S * seconds)
        return self._from_mm + (gone if way > 0.0 else -gone), gone < abs(way)

    @property
    def commanded_mm(self) -> float | None:
        """Where it is to go; None while it sweeps."""
        return None if self._sweep_mm_s else self._to_mm

    def move(self, to_mm: float, utc_ns: int) -> None:
        """Go to a place, the nearest that there is."""
        self._begin(utc_ns)
        self._to_mm = max(LEAST_MM, min(MOST_MM, to_mm))

    def sweep(self, rate_mm_s: float, utc_ns: int) -> None:
        """Go from limit to limit and back, up first."""
        self._begin(utc_ns)
        self._sweep_mm_s = rate_mm_s

    def stop(self, utc_ns: int) -> None:
        """Stand where it is."""
        self._begin(utc_ns)
        self._to_mm = self._from_mm

    def _begin(self, utc_ns: int) -> None:
        self._from_mm, _ = self.at(utc_ns)
        self._since_ns, self._sweep_mm_s = utc_ns, 0.0


@dataclass(slots=True)
class Focus:
    """All axes of a focuser."""

    axes: Sequence[FocusAxis] = field(default_factory=lambda: (FocusAxis(),))

    def move(self, places_mm: Sequence[float | None], utc_ns: int) -> bool:
        """Send axes to places, None leaving one as it is; False where an axis is named that is not there."""
        if any(place is not None for place in places_mm[len(self.axes) :]):
            return False
        for axis, place_mm in zip(self.axes, places_mm, strict=False):
            if place_mm is not None:
                axis.move(place_mm, utc_ns)
        return True

    def stop(self, utc_ns: int) -> None:
        """Stop all axes."""
        for axis in self.axes:
            axis.stop(utc_ns)
