"""A simulated focuser: axes that move to a place, or sweep between their limits, at uniform rates.

"Ideal Field System Antenna Interface", section 6.0. Positions in mm; instants in nanoseconds of UTC.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from sattrack.servers.antenna.focuser import AxisPlace, FocusReport
from sattrack.servers.antenna.trajectory import NS

if TYPE_CHECKING:
    from collections.abc import Sequence

MOVE_RATE_MM_S = 2.0
LEAST_MM, MOST_MM = -50.0, 50.0


def swept_mm(from_mm: float, rate_mm_s: float, seconds: float, least_mm: float, most_mm: float) -> float:
    """Return where a sweep is, that began at a place and went up first."""
    # As if on a loop: up from the least to the most and down again.
    span = most_mm - least_mm
    way = (from_mm - least_mm + rate_mm_s * seconds) % (2.0 * span)
    return least_mm + min(way, 2.0 * span - way)


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
            return swept_mm(self._from_mm, self._sweep_mm_s, seconds, LEAST_MM, MOST_MM), True
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
class SimulatedFocuser:
    """All axes of a simulated focuser; see `Focuser`."""

    axes: Sequence[FocusAxis] = field(default_factory=lambda: (FocusAxis(),))

    @property
    def count(self) -> int:
        """See Focuser."""
        return len(self.axes)

    @property
    def reach_mm(self) -> Sequence[tuple[float, float]]:
        """See Focuser."""
        return [(LEAST_MM, MOST_MM)] * self.count

    def heard(self, utc_ns: int) -> bool:
        """See Focuser."""
        del utc_ns
        return True

    def move(self, places_mm: Sequence[float | None], utc_ns: int) -> None:
        """See Focuser."""
        for axis, place_mm in zip(self.axes, places_mm, strict=False):
            if place_mm is not None:
                axis.move(place_mm, utc_ns)

    def sweep(self, axis: int, rate_mm_s: float, utc_ns: int) -> None:
        """See Focuser."""
        self.axes[axis].sweep(rate_mm_s, utc_ns)

    def stop(self, utc_ns: int) -> None:
        """See Focuser."""
        for axis in self.axes:
            axis.stop(utc_ns)

    def report(self, utc_ns: int) -> FocusReport:
        """See Focuser: it knows where it is at any instant."""
        there = [axis.at(utc_ns) for axis in self.axes]
        places = tuple(
            AxisPlace(axis.commanded_mm, place_mm)
            for axis, (place_mm, _) in zip(self.axes, there, strict=True)
        )
        return FocusReport(places, utc_ns, any(moves for _, moves in there))
