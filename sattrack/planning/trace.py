"""What a rehearsed run came to, sample by sample."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from sattrack.control.tracker import TrackPlan

    Array = NDArray[np.float64]
    Bools = NDArray[np.bool_]

SETTLED_S = 1.0
"""For so long after it has joined the target, an axis may still be coming to its rate."""


@dataclass(slots=True)
class Trace:
    """One row a status of the mount, in order; POSIX seconds of UTC, degrees, arcseconds on the sky.

    `moving` where the tracker's rates steer the mount, `acquired` from the first acquisition on, `clamping`
    where safety cut them, `holding` the limit at which it holds them. The axes are the mount's true ones,
    turns counted; rates are theirs.
    """

    utc_s: list[float] = field(default_factory=list)
    total_arcsec: list[float] = field(default_factory=list)
    along_arcsec: list[float] = field(default_factory=list)
    across_arcsec: list[float] = field(default_factory=list)
    moving: list[bool] = field(default_factory=list)
    acquired: list[bool] = field(default_factory=list)
    clamping: list[bool] = field(default_factory=list)
    holding: list[str | None] = field(default_factory=list)
    hour_angle_axis_deg: list[float] = field(default_factory=list)
    dec_axis_deg: list[float] = field(default_factory=list)
    hour_angle_rate_deg_s: list[float] = field(default_factory=list)
    dec_rate_deg_s: list[float] = field(default_factory=list)

    def arrays(self) -> TraceArrays:
        """Return the rows as arrays."""
        return TraceArrays(
            np.array(self.utc_s),
            np.array(self.total_arcsec),
            np.array(self.along_arcsec),
            np.array(self.across_arcsec),
            np.array(self.moving, dtype=bool),
            np.array(self.acquired, dtype=bool),
            np.array(self.clamping, dtype=bool),
            tuple(self.holding),
            np.array(self.hour_angle_axis_deg),
            np.array(self.dec_axis_deg),
            np.array(self.hour_angle_rate_deg_s),
            np.array(self.dec_rate_deg_s),
        )


@dataclass(frozen=True, slots=True)
class TraceArrays:
    """The columns of a `Trace`, shape (n,)."""

    utc_s: Array
    total_arcsec: Array
    along_arcsec: Array
    across_arcsec: Array
    moving: Bools
    acquired: Bools
    clamping: Bools
    holding: tuple[str | None, ...]
    hour_angle_axis_deg: Array
    dec_axis_deg: Array
    hour_angle_rate_deg_s: Array
    dec_rate_deg_s: Array

    def on_target(self, within_arcsec: float) -> Bools:
        """Tell of each row whether the mount was on target, as the figures of a run count it."""
        free = np.array([name is None for name in self.holding], dtype=bool)
        on: Bools = self.moving & self.acquired & free & (self.total_arcsec <= within_arcsec)
        return on

    def settled(self, within_arcsec: float) -> Bools:
        """Tell of each row whether the mount has been on target for SETTLED_S: that is following."""
        on = self.on_target(within_arcsec)
        begins = on & ~np.concatenate([[False], on[:-1]])
        rows = np.arange(len(on))
        first = np.maximum.accumulate(np.where(begins, rows, 0))
        settled: Bools = on & (self.utc_s >= self.utc_s[first] + SETTLED_S) if len(rows) else on
        return settled

    def crossings(self) -> Array:
        """Return the instants, POSIX seconds, at which the declination axis came past a pole in following."""
        first = int(np.argmax(self.moving)) if self.moving.any() else len(self.moving)
        beyond = np.abs(self.dec_axis_deg[first:]) > 90.0
        crossed: Array = self.utc_s[first:][1:][beyond[1:] != beyond[:-1]]
        return crossed


@dataclass(frozen=True, slots=True)
class Performance:
    """A rehearsed run as a whole: its rows, and how it went."""

    trace: TraceArrays
    acquired_utc_s: float | None
    followable_utc_s: float | None
    ended_utc_s: float
    ended_by: str
    period_s: float
    message: str | None

    def followed_s(self, plan: TrackPlan, until_utc_s: float = math.inf) -> float:
        """Return the seconds on target within a plan's window, a status standing for the time before it."""
        utc_s = self.trace.utc_s
        if len(utc_s) < 2:
            return 0.0
        end = min(plan.end_utc_s, until_utc_s)
        within = np.clip(utc_s, plan.start_utc_s, end)
        on = self.trace.on_target(plan.on_target_arcsec)[1:]
        return float(np.sum(np.diff(within)[on]))

    def lost_s(self, plan: TrackPlan) -> float:
        """Return the seconds of a plan's window off target."""
        return plan.end_utc_s - plan.start_utc_s - self.followed_s(plan)

    def stands_at(self, utc_s: float) -> tuple[float, float]:
        """Return hour angle and declination of the axes at an instant, POSIX seconds; turns counted."""
        trace = self.trace
        index = max(0, int(np.searchsorted(trace.utc_s, utc_s)) - 1)
        return float(trace.hour_angle_axis_deg[index]), float(trace.dec_axis_deg[index])
