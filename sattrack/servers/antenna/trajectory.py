"""What a trajectory designation means: positions, rates, an epoch, and where that is at any instant.

"Ideal Field System Antenna Interface", section 4.1.1. Instants are whole nanoseconds of UTC since 1970, so
that an epoch given to a microsecond stays what it is; angles are degrees of the antenna's own two axes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from decimal import Decimal
from typing import NamedTuple, Protocol

NS = 1_000_000_000
DAY_S = 86400
MIDNIGHT_WINDOW_S = 100
MOST_EPOCH_DISTANCE_S = 3600
"""An epoch further from now is a mistake, and not a trajectory."""
LONGEST_SECOND = 1
"""A day that ends with a leap second has an 86400th."""


class AxisState(NamedTuple):
    """Where two axes are, degrees, and how fast they turn, degrees a second; turns of the first count."""

    first_deg: float
    second_deg: float
    first_rate_deg_s: float
    second_rate_deg_s: float


class Path(Protocol):
    """A way of the antenna's axes through time."""

    def at(self, utc_ns: int) -> AxisState:
        """Return where the axes must be at an instant."""


class ExactState(NamedTuple):
    """The same as an AxisState, to the last digit that was sent."""

    first_deg: Decimal
    second_deg: Decimal
    first_rate_deg_s: Decimal
    second_rate_deg_s: Decimal


@dataclass(frozen=True, slots=True)
class Straight:
    """A trajectory of constant rates: a position at an epoch, extrapolated to future and past."""

    start: ExactState
    epoch_ns: int

    @classmethod
    def standing(cls, first_deg: float, second_deg: float, since_ns: int) -> Straight:
        """Return the trajectory of axes that stand."""
        zero = Decimal(0)
        return cls(ExactState(Decimal(first_deg), Decimal(second_deg), zero, zero), since_ns)

    def exact(self, utc_ns: int) -> ExactState:
        """Return where it is at an instant, as decimal as it was sent."""
        seconds = Decimal(utc_ns - self.epoch_ns) / NS
        first, second, first_rate, second_rate = self.start
        return ExactState(first + first_rate * seconds, second + second_rate * seconds, *self.start[2:])

    def at(self, utc_ns: int) -> AxisState:
        """Return where it is at an instant."""
        return AxisState(*(float(figure) for figure in self.exact(utc_ns)))

    def turned(self, turns: int) -> Straight:
        """Return the same, so many turns of the first axis further."""
        return Straight(self.start._replace(first_deg=self.start.first_deg + 360 * turns), self.epoch_ns)


def to_ns(utc_s: float) -> int:
    """Return POSIX seconds as whole nanoseconds, at a whole microsecond: floats know no less."""
    return round(utc_s * 1e6) * 1000


def day_start_ns(utc_ns: int) -> int:
    """Return the UTC midnight before an instant."""
    return utc_ns - utc_ns % (DAY_S * NS)


def second_of_day(utc_ns: int) -> Decimal:
    """Return the seconds since the UTC midnight before, exactly."""
    return Decimal(utc_ns % (DAY_S * NS)) / NS


def resolve_epoch(seconds: Decimal, now_ns: int) -> int:
    """Return the instant that seconds of the UTC day mean when they are received at `now_ns`.

    In the first 100 s of a day, the last 100 s are those of the day before; in the last 100 s, the first are
    those of the day after. Raises ValueError for seconds that no day has.
    """
    if not 0 <= seconds < DAY_S + LONGEST_SECOND:
        raise ValueError(f"{seconds} is no second of a day")
    start_ns = day_start_ns(now_ns)
    elapsed_s = second_of_day(now_ns)
    if elapsed_s < MIDNIGHT_WINDOW_S and seconds >= DAY_S - MIDNIGHT_WINDOW_S:
        start_ns -= DAY_S * NS
    elif elapsed_s >= DAY_S - MIDNIGHT_WINDOW_S and seconds < MIDNIGHT_WINDOW_S:
        start_ns += DAY_S * NS
    return start_ns + int((seconds * NS).to_integral_value())


@dataclass(frozen=True, slots=True)
class AxisRange:
    """How far the axes turn, degrees, and from where turns of the first are counted.

    `base_deg` begins wrap 0: a whole turn from there on. A second axis that goes beyond 90° plunges.
    """

    base_deg: float
    first_least_deg: float
    first_most_deg: float
    second_least_deg: float
    second_most_deg: float

    def wrap_of(self, first_deg: float) -> tuple[float, int]:
        """Return a position of the first axis as an angle of wrap 0, and its wrap."""
        turns = math.floor((first_deg - self.base_deg) / 360.0)
        return first_deg - 360.0 * turns, turns

    def turns_to(self, first_deg: float, wrap: int) -> int:
        """Return by how many turns to move a position for it to be in a wrap."""
        return wrap - self.wrap_of(first_deg)[1]

    def shortest_turns(self, first_deg: float, from_deg: float) -> int:
        """Return by how many turns to move a position for the shortest way within the range.

        Where no turn of it is in the range, the one that comes nearest to the range counts.
        """
        nearest = round((from_deg - first_deg) / 360.0)
        candidates = range(nearest - 2, nearest + 3)

        def cost(turns: int) -> tuple[float, float]:
            place = first_deg + 360.0 * turns
            outside = max(0.0, place - self.first_most_deg, self.first_least_deg - place)
            return outside, abs(place - from_deg)

        return min(candidates, key=cost)
