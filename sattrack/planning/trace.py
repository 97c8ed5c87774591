"""What a rehearsed run came to, sample by sample; and the table of directions that feeds it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from tle.bias import NO_BIAS, Bias
from tle.instants import Utc, as_utc
from tle.propagator import Propagator

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from sattrack.control.tracker import TrackPlan
    from tle.direction import Direction
    from tle.instants import Instant
    from tle.propagator import Pointing

    Array = NDArray[np.float64]
    Bools = NDArray[np.bool_]


SETTLED_S = 1.0
"""For so long after it has joined the target, an axis may still be coming to its rate."""


@dataclass(slots=True)
class RehearsalTrace:
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
    """The columns of a `RehearsalTrace`, shape (n,)."""

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

    def acquired_after_s(self, plan: TrackPlan) -> float | None:
        """Return the seconds from a plan's start to acquisition; None where there was none."""
        acquired = self.acquired_utc_s
        return None if acquired is None else round(max(0.0, acquired - plan.start_utc_s), 3)

    def lost_s(self, plan: TrackPlan) -> float:
        """Return the seconds of a plan's window off target."""
        return plan.end_utc_s - plan.start_utc_s - self.followed_s(plan)

    def stands_at(self, utc_s: float) -> tuple[float, float]:
        """Return hour angle and declination of the axes at an instant, POSIX seconds; turns counted."""
        trace = self.trace
        index = max(0, int(np.searchsorted(trace.utc_s, utc_s)) - 1)
        return float(trace.hour_angle_axis_deg[index]), float(trace.dec_axis_deg[index])


STEP_S = 0.5
"""Cubic interpolation of the unit vector over such a step leaves the product of the step and the rate of the
direction (rad), to the fourth power, over 384: 0.0001 arcseconds at 2.5°/s."""


class TabledDirection(NamedTuple):
    """The quantities of `tle.direction.Direction` that steering needs, degrees and degrees a second."""

    ra_deg: float
    dec_deg: float
    ra_rate_deg_s: float
    dec_rate_deg_s: float


class TabledPropagator(Propagator):
    """The same directions as a propagator, from a table between two instants, POSIX seconds of UTC.

    Outside them, or with another bias than the table's, it computes them anew. `seen` are those of all steps.
    """

    def __init__(self, real: Propagator, bias: Bias, begin_utc_s: float, end_utc_s: float) -> None:
        """Compute the table; raises what `Propagator.at` raises for one instant."""
        super().__init__(
            real.elements,
            real.site,
            NO_BIAS,
            real.earth,
            real.refraction,
            real.place,
            real.diurnal_aberration,
            real.pointing,
        )
        self._table_bias = bias
        self._begin_utc_s, self._end_utc_s = begin_utc_s, end_utc_s
        count = max(2, math.ceil((end_utc_s - begin_utc_s) / STEP_S) + 2)
        self.seen = super().at(Utc(begin_utc_s + STEP_S * np.arange(count)), bias)
        units, rates = self.seen.unit, self.seen.unit_rate
        self._last = count - 1
        # Of a row with NaN, where SGP4 fails, the instant alone is asked for, which raises.
        self._good = [bool(x) for x in np.all(np.isfinite(units), axis=1).ravel()]
        self._rows: list[list[float]] = np.concatenate([units, rates * STEP_S], axis=1).tolist()

    def pointed(self, pointing: Pointing | None) -> TabledPropagator:
        """See Propagator."""
        return TabledPropagator(
            super().pointed(pointing), self._table_bias, self._begin_utc_s, self._end_utc_s
        )

    def at(self, t: Instant, bias: Bias | None = None) -> Direction:
        """See Propagator.at; of a single instant in the table, a `TabledDirection`."""
        t = as_utc(t)
        unix_s = t.unix_s
        if not isinstance(unix_s, np.ndarray) and (bias is None or bias == self._table_bias):
            steps = (unix_s - self._begin_utc_s) / STEP_S
            index = math.floor(steps)
            if 0 <= index < self._last and self._good[index] and self._good[index + 1]:
                return self._between(index, steps - index)  # type: ignore[return-value]
        return super().at(t, bias)

    def _between(self, index: int, s: float) -> TabledDirection:
        """Return the direction a share `s` of a step after a row: Hermite's cubic through both rows."""
        x0, y0, z0, a0, b0, c0 = self._rows[index]
        x1, y1, z1, a1, b1, c1 = self._rows[index + 1]
        s2 = s * s
        h0, h1 = (2.0 * s - 3.0) * s2 + 1.0, (3.0 - 2.0 * s) * s2
        k0, k1 = ((s - 2.0) * s + 1.0) * s, (s - 1.0) * s2
        dh = 6.0 * (s2 - s)
        d0, d1 = (3.0 * s - 4.0) * s + 1.0, (3.0 * s - 2.0) * s
        x = h0 * x0 + h1 * x1 + k0 * a0 + k1 * a1
        y = h0 * y0 + h1 * y1 + k0 * b0 + k1 * b1
        z = h0 * z0 + h1 * z1 + k0 * c0 + k1 * c1
        dx = (dh * (x0 - x1) + d0 * a0 + d1 * a1) / STEP_S
        dy = (dh * (y0 - y1) + d0 * b0 + d1 * b1) / STEP_S
        dz = (dh * (z0 - z1) + d0 * c0 + d1 * c1) / STEP_S
        xy2 = x * x + y * y + 1e-40
        xy = math.sqrt(xy2)
        return TabledDirection(
            math.degrees(math.atan2(y, x)) % 360.0,
            math.degrees(math.atan2(z, xy)),
            math.degrees((x * dy - y * dx) / xy2),
            math.degrees((dz * xy2 - z * (x * dx + y * dy)) / (xy * (xy2 + z * z))),
        )
