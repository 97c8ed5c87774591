"""What a rehearsed run came to, sample by sample."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]
    Bools = NDArray[np.bool_]


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
        return self.moving & self.acquired & (self.total_arcsec <= within_arcsec)


@dataclass(frozen=True, slots=True)
class Performance:
    """A rehearsed run as a whole: its rows, and how it went."""

    trace: TraceArrays
    on_target_s: float
    acquired_utc_s: float | None
    followable_utc_s: float | None
    ended_utc_s: float
    ended_by: str
    period_s: float
    message: str | None
