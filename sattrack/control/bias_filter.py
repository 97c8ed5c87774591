"""A Kalman filter of a satellite's biases, along its track and across it, fed by single observations.

State: along-track bias in seconds, as `tle.bias` has it, and how far the satellite is off across its track
in km: what is constant over a pass is a distance, not the angle under which it is seen. A measurement is what
one observation says of both, at its own instant; filterpy does the algebra. The biases are nearly constant:
the process noise is so small that over a pass the sigma falls as that of a mean does.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from filterpy.kalman import KalmanFilter


@dataclass(frozen=True, slots=True)
class BiasNoise:
    """What is expected of elements before and between observations, one sigma."""

    along_s: float = 0.0
    cross_km: float = 0.0
    """What is expected to begin with."""
    first_along_s: float = 30.0
    """Elements are seconds late or early, after a manoeuvre a minute."""
    first_cross_km: float = 1.0
    along_walk_sqrt_s: float = 5e-6
    cross_walk_km_sqrt_s: float = 3e-5
    gate: float = 18.4
    """Squared Mahalanobis distance that one good observation in ten thousand exceeds (two dimensions)."""


class BiasFilter:
    """Estimate of both biases; it changes with accepted observations alone, so it outlasts their end."""

    def __init__(self, noise: BiasNoise | None = None) -> None:
        self._noise = noise or BiasNoise()
        kalman = KalmanFilter(dim_x=2, dim_z=2)
        kalman.P = np.diag([self._noise.first_along_s**2, self._noise.first_cross_km**2])
        kalman.x = np.array([[self._noise.along_s], [self._noise.cross_km]])
        kalman.H = np.eye(2)
        self._kalman = kalman
        self._last_utc_s: float | None = None
        self.accepted = 0
        self.rejected = 0

    @property
    def along_s(self) -> float:
        """Along-track bias, seconds."""
        return float(self._kalman.x[0, 0])

    @property
    def cross_km(self) -> float:
        """Distance across the track, km."""
        return float(self._kalman.x[1, 0])

    @property
    def along_sigma_s(self) -> float:
        """Uncertainty of the along-track bias, one sigma."""
        return math.sqrt(float(self._kalman.P[0, 0]))

    @property
    def cross_sigma_km(self) -> float:
        """Uncertainty of the cross-track bias, one sigma."""
        return math.sqrt(float(self._kalman.P[1, 1]))

    def distance(self, along_s: float, cross_km: float, along_sigma_s: float, cross_sigma_km: float) -> float:
        """Return how far what an observation says lies from the estimate: squared Mahalanobis distance."""
        gap = np.array([along_s - self.along_s, cross_km - self.cross_km])
        spread = self._kalman.P + np.diag([along_sigma_s**2, cross_sigma_km**2])
        return float(gap @ np.linalg.solve(spread, gap))

    def observe(
        self, utc_s: float, along_s: float, cross_km: float, along_sigma_s: float, cross_sigma_km: float
    ) -> bool:
        """Take what one observation at an instant says of both biases; tell whether the gate let it through.

        One that comes late counts like any other: the biases hardly move.
        """
        seconds = 0.0 if self._last_utc_s is None else max(0.0, utc_s - self._last_utc_s)
        noise = self._noise
        walk = np.diag([noise.along_walk_sqrt_s**2, noise.cross_walk_km_sqrt_s**2]) * seconds
        if not self.distance(along_s, cross_km, along_sigma_s, cross_sigma_km) <= noise.gate:
            self.rejected += 1
            return False
        self._kalman.predict(Q=walk)
        self._last_utc_s = utc_s if self._last_utc_s is None else max(utc_s, self._last_utc_s)
        self._kalman.update(
            np.array([[along_s], [cross_km]]), R=np.diag([along_sigma_s**2, cross_sigma_km**2])
        )
        self.accepted += 1
        return True
