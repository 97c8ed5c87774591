"""Biases of a satellite against its elements: along its track in seconds, across it in degrees on the sky.

The one convention, used everywhere. Along-track: the satellite is evaluated that much later while the
observer stays at the instant asked for; positive leads. Cross-track: the direction is turned towards
n = u x m, with u from the observer to the satellite and m the direction of du/dΔ, the motion that a time bias
makes. For a satellite overhead that moves north, positive shifts it west.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from tle.errors import BiasError
from tle.instants import as_utc

if TYPE_CHECKING:
    from tle.instants import Quantity, Utc


@dataclass(frozen=True, slots=True)
class Bias:
    """Along-track bias in seconds and cross-track bias in degrees, each with a rate of change.

    At an instant t the biases are `along_s + along_rate·(t - epoch)` and, across,
    `cross_deg + cross_rate_deg_s·(t - epoch)`; a rate needs the epoch. Raises BiasError for numbers that are
    not finite, a cross-track bias beyond 90°, and a rate without an epoch.
    """

    along_s: float = 0.0
    cross_deg: float = 0.0
    along_rate: float = 0.0
    cross_rate_deg_s: float = 0.0
    epoch: Utc | None = None

    def __post_init__(self) -> None:
        """Check the numbers; take a datetime or a Time of another package as the epoch."""
        if self.epoch is not None:
            object.__setattr__(self, "epoch", as_utc(self.epoch))
        numbers = (self.along_s, self.cross_deg, self.along_rate, self.cross_rate_deg_s)
        if not all(map(math.isfinite, numbers)):
            raise BiasError("a bias is not a finite number: give seconds along and degrees across the track")
        if abs(self.cross_deg) > 90.0:
            raise BiasError(f"a cross-track bias of {self.cross_deg}° is beyond 90°: give degrees on the sky")
        if self.epoch is None and (self.along_rate or self.cross_rate_deg_s):
            raise BiasError("a bias with a rate needs the instant from which it grows: give its epoch")

    def along_at_s(self, unix_s: Quantity) -> Quantity:
        """Return the along-track bias at POSIX seconds of UTC, in seconds."""
        if self.epoch is None:
            return self.along_s
        return self.along_s + self.along_rate * (unix_s - self.epoch.unix_s)

    def cross_at_deg(self, unix_s: Quantity) -> Quantity:
        """Return the cross-track bias at POSIX seconds of UTC, in degrees."""
        if self.epoch is None:
            return self.cross_deg
        return self.cross_deg + self.cross_rate_deg_s * (unix_s - self.epoch.unix_s)


NO_BIAS = Bias()
