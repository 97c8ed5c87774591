"""The constants of the control law that can be tried out: what a replay asks with `--set` or `--law`."""

from __future__ import annotations

import math

import msgspec

from sattrack.control.kalman import Noise


class FeederLaw(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How an error is taken out. Raises ValueError for what no loop can be run with."""

    settling_s: float = 0.1
    """Least time constant with which a small error is taken out."""
    intervals: float = 1.25
    """That time constant over the interval in which a command acts, at least."""
    lags: float = 0.5
    """That time constant over the servo's mean lag, at least."""
    lag_sigmas: float = 4.0
    """That time constant over the uncertainty of the lag, at least."""
    ramp_share: float = 0.5
    """Share of the axis' acceleration with which the commanded rate may change."""
    braking_share: float = 0.35
    """Share of the axis' acceleration that a large error's approach may plan with."""
    tracking_share: float = 0.1
    """Share of the axis' rate that a correction may ask for beyond the target's, once on the target: no more
    comes of wrong samples."""

    def __post_init__(self) -> None:
        """Check the numbers."""
        if not 0.0 < self.settling_s < math.inf:
            raise ValueError(f"settling_s is {self.settling_s:g}; it must be above 0")
        if not 0.0 < self.braking_share <= 1.0:
            raise ValueError(f"braking_share is {self.braking_share:g}; it must be above 0, and 1 at most")
        if not 0.0 < self.tracking_share <= 1.0:
            raise ValueError(f"tracking_share is {self.tracking_share:g}; it must be above 0, and 1 at most")


class ControlLaw(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The feeder's constants, and what the axes' filters expect."""

    feeder: FeederLaw = FeederLaw()
    filter: Noise = Noise()
