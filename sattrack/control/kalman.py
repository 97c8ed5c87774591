"""A Kalman filter per axis: where the axis is, and which rate nobody asked for.

State: position in degrees and rate disturbance in degrees per second. Input: the displacement that the
commands made. Measurement: the reported position at its own instant. filterpy does the algebra.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from filterpy.kalman import KalmanFilter


@dataclass(frozen=True, slots=True)
class Noise:
    """What the filter expects of an axis, one sigma."""

    position_deg: float = 0.03 / 3600.0
    """Encoder and packing noise of one sample."""
    timing_s: float = 30e-6
    """Error in the date of one sample: it acts through the rate."""
    walk_deg_sqrt_s: float = 0.02 / 3600.0
    """Position noise that grows with the root of time: what the servo does within a loop."""
    rate_walk_deg_s_sqrt_s: float = 0.5 / 3600.0
    """Growth of the rate disturbance with the root of time."""
    first_rate_deg_s: float = 20.0 / 3600.0


INPUT = np.array([[1.0], [0.0]])


class AxisFilter:
    """One axis, in unwrapped degrees."""

    def __init__(self, position_deg: float, noise: Noise | None = None) -> None:
        self._noise = noise or Noise()
        kalman = KalmanFilter(dim_x=2, dim_z=1, dim_u=1)
        kalman.x = np.array([[position_deg], [0.0]])
        kalman.P = np.diag([1e-4, self._noise.first_rate_deg_s**2])
        kalman.H = np.array([[1.0, 0.0]])
        kalman.inv = _invert_scalar
        self._kalman = kalman
        self.innovation_sigmas = 0.0
        """The last measurement's surprise, in its own expected sigma."""

    @property
    def position_deg(self) -> float:
        """Position at the last sample, degrees, unwrapped."""
        return float(self._kalman.x[0, 0])

    @property
    def disturbance_deg_s(self) -> float:
        """Rate that is there beside the commanded one, degrees per second."""
        return float(self._kalman.x[1, 0])

    @property
    def position_sigma_deg(self) -> float:
        """Uncertainty of the position, one sigma."""
        return math.sqrt(float(self._kalman.P[0, 0]))

    def advance(self, seconds: float, displacement_deg: float) -> None:
        """Predict over an interval in which the commands moved the axis by `displacement_deg`."""
        noise = self._noise
        # White noise in rate and in its derivative, integrated over the interval.
        rate_variance = noise.rate_walk_deg_s_sqrt_s**2 * seconds
        cross = 0.5 * rate_variance * seconds
        own = noise.walk_deg_sqrt_s**2 * seconds + rate_variance * seconds * seconds / 3.0
        transition = np.array([[1.0, seconds], [0.0, 1.0]])
        process = np.array([[own, cross], [cross, rate_variance]])
        self._kalman.predict(u=np.array([[displacement_deg]]), B=INPUT, F=transition, Q=process)

    def measure(self, position_deg: float, rate_deg_s: float) -> None:
        """Take in a reported position (any turn) of an axis that moves at about `rate_deg_s`."""
        predicted = self.position_deg
        measured = predicted + wrap180(position_deg - predicted)
        noise = self._noise
        variance = noise.position_deg**2 + (rate_deg_s * noise.timing_s) ** 2
        self._kalman.update(measured, R=np.array([[variance]]))
        self.innovation_sigmas = float(self._kalman.y[0, 0]) / math.sqrt(float(self._kalman.S[0, 0]))


def _invert_scalar(matrix: np.ndarray[tuple[int, int], np.dtype[np.float64]]) -> object:
    # One measurement: its covariance is one number, and a general inverse costs more than the whole update.
    return 1.0 / matrix


def wrap180(angle_deg: float) -> float:
    """Return an angle in -180 to 180, degrees."""
    return (angle_deg + 180.0) % 360.0 - 180.0
