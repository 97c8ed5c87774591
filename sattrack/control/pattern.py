"""A search pattern at work: from when to when, and what it adds along and across the track."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from sattrack.control.offset import REST, State
from sattrack.control.search import spiral, sweep_rate, sweep_s

if TYPE_CHECKING:
    from sattrack.control.course import Course

_DIFFERENCE_S = 1e-3


@dataclass(frozen=True, slots=True)
class Pattern:
    """A spiral (degrees, degrees a second) or a sweep (seconds, seconds), between two instants; UTC.

    `how` is "spiral", with its spacing and speed, or "sweep", with its reach and period.
    """

    how: str
    first: float
    second: float
    begins_utc_s: float
    ends_utc_s: float

    def runs(self, utc_s: float) -> bool:
        """Tell whether it acts at an instant."""
        return self.begins_utc_s <= utc_s < self.ends_utc_s

    def ended(self, utc_s: float) -> Pattern:
        """Return the same, ending at an instant."""
        return replace(self, ends_utc_s=utc_s)

    def states(self, utc_s: float, along: State, course: Course) -> tuple[State, State]:
        """Return what it adds, with rates: seconds along and degrees across, to what is in force along.

        Accelerations are left at 0. A spiral keeps its shape on the sky while the satellite's pace changes.
        """
        elapsed_s = utc_s - self.begins_utc_s
        if self.how == "sweep":
            value = sweep_s(elapsed_s, self.first, self.second)
            return State(value, sweep_rate(elapsed_s, self.first, self.second), 0.0), REST
        point = spiral(elapsed_s, self.first, self.second)
        going = course.going(utc_s + along.value)
        pace = going.pace_deg_s
        ahead_s = point.along_deg / pace
        rate = (point.along_deg_s - ahead_s * going.pace_rate * (1.0 + along.rate)) / pace
        return State(ahead_s, rate, 0.0), State(point.cross_deg, point.cross_deg_s, 0.0)

    def full_states(self, utc_s: float, along: State, course: Course) -> tuple[State, State]:
        """Return what it adds, with rates and accelerations."""
        here = self.states(utc_s, along, course)
        later = self.states(utc_s + _DIFFERENCE_S, along, course)
        sooner = self.states(utc_s - _DIFFERENCE_S, along, course)
        ahead, left = (
            State(h.value, h.rate, (n.rate - s.rate) / (2.0 * _DIFFERENCE_S))
            for h, n, s in zip(here, later, sooner, strict=True)
        )
        return ahead, left
