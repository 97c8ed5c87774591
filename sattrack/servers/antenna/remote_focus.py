"""A focuser whose axes are driven elsewhere: orders go out, places come in. No I/O.

"Ideal Field System Antenna Interface", section 6.0: the response to a command never waits for the focuser, so
what is told is what was heard last, with the instant at which it was measured.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import msgspec

from sattrack.servers.antenna.focuser import AxisPlace, FocusReport
from sattrack.servers.antenna.trajectory import NS

if TYPE_CHECKING:
    from collections.abc import Sequence

OLDEST_NS = 3 * NS
"""A place heard longer ago says nothing of where the axis is."""


class FocusOrder(msgspec.Struct, frozen=True):
    """What one axis is to do: go to a place, sweep, or, with neither, stop. Serials count up from 1."""

    serial: int
    to_mm: float | None = None
    sweep_mm_s: float | None = None


class FocusNews(msgspec.Struct, frozen=True):
    """What is heard of one axis, with the serial of the last order that it has taken up."""

    monotonic_s: float
    mm: float | None
    """None where it is not heard."""
    moving: bool
    serial: int
    least_mm: float = 0.0
    most_mm: float = 0.0
    trouble: str = ""


@dataclass(slots=True)
class RemoteAxis:
    """One axis elsewhere: `orders` wait to be taken to it."""

    least_mm: float
    most_mm: float
    orders: list[FocusOrder] = field(default_factory=list)
    _serial: int = 0
    _commanded_mm: float | None = None
    _news: FocusNews | None = None
    _at_ns: int = 0

    def order(self, to_mm: float | None = None, sweep_mm_s: float | None = None) -> None:
        """Have an order taken to it."""
        if to_mm is not None:
            to_mm = max(self.least_mm, min(self.most_mm, to_mm))
        self._serial += 1
        self._commanded_mm = to_mm
        self.orders.append(FocusOrder(self._serial, to_mm, sweep_mm_s))

    def hear(self, news: FocusNews, at_ns: int) -> None:
        """Take what was heard of it, measured at an instant."""
        self._news, self._at_ns = news, at_ns

    def known(self, utc_ns: int) -> bool:
        """Return whether its place is known at an instant."""
        news = self._news
        return news is not None and news.mm is not None and utc_ns - self._at_ns <= OLDEST_NS

    @property
    def moving(self) -> bool:
        """Whether it moves, or has not taken up its last order yet."""
        news = self._news
        return news is None or news.moving or news.serial != self._serial

    @property
    def measured_ns(self) -> int:
        """When what is known of it was measured."""
        return self._at_ns

    def place(self, utc_ns: int) -> AxisPlace:
        """Return where it is to go, and where it is as far as that is known."""
        known = self._news if self.known(utc_ns) else None
        return AxisPlace(self._commanded_mm, None if known is None else known.mm)


@dataclass(slots=True)
class RemoteFocuser:
    """All axes of a focuser elsewhere; see `Focuser`."""

    axes: Sequence[RemoteAxis]

    @property
    def count(self) -> int:
        """See Focuser."""
        return len(self.axes)

    @property
    def reach_mm(self) -> Sequence[tuple[float, float]]:
        """See Focuser."""
        return [(axis.least_mm, axis.most_mm) for axis in self.axes]

    def heard(self, utc_ns: int) -> bool:
        """See Focuser."""
        return all(axis.known(utc_ns) for axis in self.axes)

    def move(self, places_mm: Sequence[float | None], utc_ns: int) -> None:
        """See Focuser."""
        del utc_ns
        for axis, place_mm in zip(self.axes, places_mm, strict=False):
            if place_mm is not None:
                axis.order(to_mm=place_mm)

    def sweep(self, axis: int, rate_mm_s: float, utc_ns: int) -> None:
        """See Focuser."""
        del utc_ns
        self.axes[axis].order(sweep_mm_s=rate_mm_s)

    def stop(self, utc_ns: int) -> None:
        """See Focuser."""
        del utc_ns
        for axis in self.axes:
            axis.order()

    def report(self, utc_ns: int) -> FocusReport:
        """See Focuser: the epoch is the oldest instant at which any of its axes was measured.

        An axis whose place is not known has not been seen to stand.
        """
        known = [axis for axis in self.axes if axis.known(utc_ns)]
        places = tuple(axis.place(utc_ns) for axis in self.axes)
        moving = len(known) < self.count or any(axis.moving for axis in known)
        return FocusReport(places, min((axis.measured_ns for axis in known), default=utc_ns), moving)
