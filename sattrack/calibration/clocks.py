"""The mount's clock against ours, by its fastest arrivals.

A status sampled at the mount's second m arrives at m + offset + drift m + delay, and a delay has a least
value and no largest. So the fastest arrivals of each stretch of the run lie on a line: its slope is the
drift, and it says for every status when the fastest datagram would have arrived.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from sattrack.calibration.statuses import Heard

STRETCHES = 24
FEWEST_IN_STRETCH = 20
SMALLEST_SIGMA_S = 2e-6
"""What is left of a float's and a kernel stamp's rounding, taken as the least scatter of fast arrivals."""
LARGEST_DRIFT = 1e-3
LARGEST_SCATTER_S = 0.005


@dataclass(frozen=True, slots=True)
class ClockLine:
    """When the fastest status of each second of the mount's clock would have arrived, our UTC."""

    middle_s: float
    arrival_utc_s: float
    """At the mount's second `middle_s`."""
    slope: float
    """Our seconds in a second of the mount's clock, less one."""
    slope_sigma: float
    scatter_s: float
    """Of the fastest arrivals about the line."""
    jitter_s: float
    """Mean lateness of all arrivals against the line."""

    @property
    def drift_ppm(self) -> float:
        """How much faster than ours the mount's clock runs, parts in a million."""
        return -self.slope / (1.0 + self.slope) * 1e6

    def arrival_at(self, mount_s: NDArray[np.float64] | float) -> NDArray[np.float64]:
        """Return the fastest possible arrival, our UTC, of statuses sampled at these seconds."""
        since = np.asarray(mount_s, dtype=np.float64) - self.middle_s
        return self.arrival_utc_s + since * (1.0 + self.slope)

    def objection(self) -> str | None:
        """Say what is wrong with the mount's clock, if it cannot date statuses."""
        if self.scatter_s > LARGEST_SCATTER_S:
            return (
                f"the mount's sidereal clock and the arrivals disagree by {self.scatter_s * 1e3:.0f} ms:"
                " one of the clocks was set during the run, or the network is too uneven"
            )
        if abs(self.slope) > LARGEST_DRIFT:
            return f"the mount's sidereal clock runs {self.drift_ppm:.0f} millionths too fast"
        return None


def clock_line(heard: list[Heard]) -> ClockLine:
    """Return the line of the fastest arrivals. Needs two stretches of FEWEST_IN_STRETCH statuses or more."""
    mount = np.array([h.mount_s for h in heard])
    zero = heard[0].arrival_utc_s
    late = np.array([h.arrival_utc_s - zero for h in heard]) - mount
    stretches = max(2, min(STRETCHES, len(heard) // FEWEST_IN_STRETCH))
    fastest = [part[np.argmin(late[part])] for part in np.array_split(np.arange(len(heard)), stretches)]
    x, y = mount[fastest], late[fastest]
    slope, level, kept = _line_without_strays(x, y)
    middle = float(x[kept].mean())
    residuals = y[kept] - (level + slope * x[kept])
    count = int(kept.sum())
    scatter = max(SMALLEST_SIGMA_S, float(np.sqrt((residuals**2).sum() / max(1, count - 2))))
    spread = float(np.sqrt(((x[kept] - middle) ** 2).sum()))
    return ClockLine(
        middle_s=middle,
        arrival_utc_s=zero + middle + level + slope * middle,
        slope=slope,
        slope_sigma=scatter / spread if spread > 0.0 else float("inf"),
        scatter_s=scatter,
        jitter_s=float(np.mean(late - (level + slope * mount))),
    )


def _line_without_strays(
    x: NDArray[np.float64], y: NDArray[np.float64]
) -> tuple[float, float, NDArray[np.bool_]]:
    """Return slope and level by least squares, stretches without a fast arrival left out."""
    kept = np.ones(len(x), dtype=np.bool_)
    slope = level = 0.0
    for _ in range(4):
        slope, level = (float(c) for c in np.polyfit(x[kept], y[kept], 1))
        residuals = y - (level + slope * x)
        typical = max(SMALLEST_SIGMA_S, 1.4826 * float(np.median(np.abs(residuals[kept]))))
        new = np.abs(residuals) < 4.0 * typical
        if new.sum() < max(3, len(x) // 2) or bool((new == kept).all()):
            break
        kept = new
    return slope, level, kept


@dataclass(frozen=True, slots=True)
class StatusPeriod:
    """How often the mount's loop turns, by its own clock, seconds."""

    mean_s: float
    jitter_s: float
    """Standard deviation of one turn."""


def status_period(heard: list[Heard]) -> StatusPeriod:
    """Return the loop's period; statuses that were lost are counted by the counter."""
    turns = heard[-1].counter - heard[0].counter
    mean = (heard[-1].mount_s - heard[0].mount_s) / turns
    single = [b.mount_s - a.mount_s for a, b in pairwise(heard) if b.counter == a.counter + 1]
    return StatusPeriod(mean, float(np.std(single)) if single else float("nan"))
