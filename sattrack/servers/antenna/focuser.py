"""What the controller needs of any focuser: places to go to, sweeps, a stop, and where its axes are.

"Ideal Field System Antenna Interface", section 6.0. Positions in mm; instants in nanoseconds of UTC.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, Protocol

if TYPE_CHECKING:
    from collections.abc import Sequence


class AxisPlace(NamedTuple):
    """One axis: where it is to go (None while it sweeps, or nothing was asked), and where it is, if known."""

    commanded_mm: float | None
    actual_mm: float | None


class FocusReport(NamedTuple):
    """All axes of a focuser, the instant at which they were there, and whether any of them moves."""

    axes: tuple[AxisPlace, ...]
    epoch_ns: int
    moving: bool


class Focuser(Protocol):
    """A focuser of one to three axes. No method waits for a motion."""

    @property
    def count(self) -> int:
        """How many axes there are."""

    @property
    def reach_mm(self) -> Sequence[tuple[float, float]]:
        """The least and the greatest place of each axis."""

    def heard(self, utc_ns: int) -> bool:
        """Return whether all of them can be told anything at an instant."""

    def move(self, places_mm: Sequence[float | None], utc_ns: int) -> None:
        """Send axes to places within their reach; None leaves an axis as it is."""

    def sweep(self, axis: int, rate_mm_s: float, utc_ns: int) -> None:
        """Send one axis, counted from 0, from limit to limit and back at a uniform rate, up first."""

    def stop(self, utc_ns: int) -> None:
        """Stop all axes."""

    def report(self, utc_ns: int) -> FocusReport:
        """Return where the axes are, as it is known at an instant."""
