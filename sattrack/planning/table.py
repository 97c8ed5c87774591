"""A satellite's directions over one pass as a table: what a rehearsal asks for some 30,000 times."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from tle.bias import NO_BIAS, Bias
from tle.instants import Utc
from tle.propagator import Propagator

if TYPE_CHECKING:
    from tle.direction import Direction

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
        )
        self._table_bias = bias
        self._begin_utc_s = begin_utc_s
        count = max(2, math.ceil((end_utc_s - begin_utc_s) / STEP_S) + 2)
        self.seen = super().at(Utc(begin_utc_s + STEP_S * np.arange(count)), bias)
        units, rates = self.seen.unit, self.seen.unit_rate
        self._last = count - 1
        # Of a row with NaN, where SGP4 fails, the instant alone is asked for, which raises.
        self._good = [bool(x) for x in np.all(np.isfinite(units), axis=1).ravel()]
        self._rows: list[list[float]] = np.concatenate([units, rates * STEP_S], axis=1).tolist()

    def at(self, t: Utc, bias: Bias | None = None) -> Direction:
        """See Propagator.at; of a single instant in the table, a `TabledDirection`."""
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
