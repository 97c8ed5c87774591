"""A Kalman filter per axis: where the axis is, which rate nobody asked for, and how much of a rate comes out.

State: position in degrees, rate disturbance in degrees per second, and the gain's error: what comes of a
commanded rate, divided by it, less one. Input: the displacement that the commands made. Measurement: the
reported position at its own instant. filterpy does the algebra.
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
    response_s: float = 0.01
    """Position noise for each change of the commanded rate, over that change: the servo is not instant."""
    first_rate_deg_s: float = 20.0 / 3600.0
    learning: float = 0.01
    """How fast the measurement noise is learnt, a share each sample."""
    first_gain: float = 0.02
    gain_walk_sqrt_s: float = 1e-5
    """Growth of the gain's error with the root of time: it is the mount's own, and stays."""


SURPRISE_SIGMAS = 4.0
MOST_RATE_DEG_S, MOST_GAIN = 0.1, 0.25
"""No disturbance is larger, and no gain further off: what seems so is a filter that is led astray."""
SMALLEST_NOISE_SHARE, LARGEST_NOISE_SHARE = 0.02, 400.0
"""How far the measurement's variance may go from the expected one: a seventh of the sigma to twenty times."""
NEAR_REST_DEG_S = 0.05
"""Slower than this an axis may stick. How far it stays behind then its servo takes away by itself, so that is
no rate: compensated as one, the axis breaks loose the further."""
INPUT = np.array([[1.0], [0.0], [0.0]])
Matrix = np.ndarray[tuple[int, int], np.dtype[np.float64]]


class LeanKalmanFilter(KalmanFilter):  # type: ignore[misc]
    """filterpy's filter without the copies that it keeps of each state, in a third of the time.

    The same operations in the same order, so the same numbers to the last bit. Of its results `x`, `P`, `y`
    and `S` are there.
    """

    x: Matrix
    P: Matrix

    def predict(self, u: Matrix, B: Matrix, F: Matrix, Q: Matrix) -> None:  # noqa: N803 - filterpy's names
        """Predict the next state."""
        self.x = F.dot(self.x) + B.dot(u)
        self.P = F.dot(self.P).dot(F.T) + Q

    def update(self, z: float, R: Matrix) -> None:  # noqa: N803 - filterpy's names
        """Take one measurement in."""
        across = self.H
        self.y = z - across.dot(self.x)
        shared = self.P.dot(across.T)
        self.S = across.dot(shared) + R
        gain = shared.dot(self.inv(self.S))
        self.x = self.x + gain.dot(self.y)
        kept = self._I - gain.dot(across)
        self.P = kept.dot(self.P).dot(kept.T) + gain.dot(R).dot(gain.T)


class AxisFilter:
    """One axis, in unwrapped degrees."""

    def __init__(self, position_deg: float, noise: Noise | None = None) -> None:
        self._noise = noise or Noise()
        kalman = LeanKalmanFilter(dim_x=3, dim_z=1, dim_u=1)
        kalman.x = np.array([[position_deg], [0.0], [0.0]])
        kalman.P = np.diag([1e-4, self._noise.first_rate_deg_s**2, self._noise.first_gain**2])
        kalman.H = np.array([[1.0, 0.0, 0.0]])
        kalman.inv = _invert_scalar
        self._kalman = kalman
        self.innovation_sigmas = 0.0
        """The last measurement's surprise, in its own expected sigma."""
        self.innovation_sigma_deg = 1e-2
        """What the last measurement's surprise was expected to be, one sigma."""
        self._surprised_deg = 0.0
        """The last measurement's surprise where it was too large, else 0."""
        self._seconds = 1.0
        self._noise_share = 1.0
        """Variance of the measurements over the expected one, as innovations show it."""

    @property
    def position_deg(self) -> float:
        """Position at the last sample, degrees, unwrapped."""
        return float(self._kalman.x[0, 0])

    @property
    def disturbance_deg_s(self) -> float:
        """Rate that is there beside the commanded one, degrees per second."""
        return float(self._kalman.x[1, 0])

    def expected_sigma_deg(self, jolt_deg_s: float) -> float:
        """Return how far off the next measurement may be, one sigma, after a change of the commanded rate."""
        return math.hypot(self.innovation_sigma_deg, self._noise.response_s * jolt_deg_s)

    @property
    def gain_error(self) -> float:
        """What comes of a commanded rate, divided by it, less one."""
        return float(self._kalman.x[2, 0])

    @property
    def position_sigma_deg(self) -> float:
        """Uncertainty of the position, one sigma."""
        return math.sqrt(float(self._kalman.P[0, 0]))

    def foretold_deg(self, seconds: float, displacement_deg: float) -> float:
        """Return where the axis will be after commands that move it by `displacement_deg`."""
        x = self._kalman.x
        return float(x[0, 0] + x[1, 0] * seconds + displacement_deg * (1.0 + x[2, 0]))

    def advance(
        self, seconds: float, displacement_deg: float, commanded: bool = True, jolt_deg_s: float = 0.0
    ) -> None:
        """Predict over an interval in which the axis moved by `displacement_deg`.

        Where that is not what commands made but what was seen, it says nothing of the gain. `jolt_deg_s` is
        by how much the commanded rate has changed: the servo takes its time to follow.
        """
        noise = self._noise
        self._seconds = seconds
        # White noise in rate and in its derivative, integrated over the interval.
        rate_variance = noise.rate_walk_deg_s_sqrt_s**2 * seconds
        cross = 0.5 * rate_variance * seconds
        own = noise.walk_deg_sqrt_s**2 * seconds + rate_variance * seconds * seconds / 3.0
        own += (noise.response_s * jolt_deg_s) ** 2
        gain_variance = noise.gain_walk_sqrt_s**2 * seconds
        gained_deg = displacement_deg if commanded else 0.0
        transition = np.array([[1.0, seconds, gained_deg], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
        process = np.array([[own, cross, 0.0], [cross, rate_variance, 0.0], [0.0, 0.0, gain_variance]])
        self._kalman.predict(u=np.array([[displacement_deg]]), B=INPUT, F=transition, Q=process)

    def measure(self, position_deg: float, rate_deg_s: float) -> None:
        """Take in a reported position (any turn) of an axis that moves at about `rate_deg_s`."""
        predicted = self.position_deg
        surprise = wrap180(position_deg - predicted)
        noise = self._noise
        variance = self._noise_share * (noise.position_deg**2 + (rate_deg_s * noise.timing_s) ** 2)
        expected = float(self._kalman.P[0, 0]) + variance
        if surprise * surprise > SURPRISE_SIGMAS**2 * expected:
            variance += self._weigh_surprise(surprise, expected, rate_deg_s)
        else:
            self._surprised_deg = 0.0
            self._learn_noise(surprise * surprise / expected)
        self._kalman.update(predicted + surprise, R=np.array([[variance]]))
        state = self._kalman.x
        state[1, 0] = max(-MOST_RATE_DEG_S, min(MOST_RATE_DEG_S, state[1, 0]))
        state[2, 0] = max(-MOST_GAIN, min(MOST_GAIN, state[2, 0]))
        self.innovation_sigma_deg = math.sqrt(float(self._kalman.S[0, 0]))
        self.innovation_sigmas = float(self._kalman.y[0, 0]) / self.innovation_sigma_deg

    def _learn_noise(self, ratio: float) -> None:
        """Let the measurement noise follow, slowly, what the innovations' squares are against expectation."""
        share = self._noise_share * (1.0 + self._noise.learning * (ratio - 1.0))
        self._noise_share = max(SMALLEST_NOISE_SHARE, min(LARGEST_NOISE_SHARE, share))

    def _weigh_surprise(self, surprise_deg: float, expected: float, rate_deg_s: float) -> float:
        """Return by how much to distrust a surprising measurement, as a variance.

        A single one may be a glitch, and is believed only as far as a large but ordinary one would be; a
        second one to the same side is a rate that has set in, which the filter then learns at once; of an
        axis near rest, that friction may hold, it is where it stands.
        """
        again = surprise_deg * self._surprised_deg > 0.0
        self._surprised_deg = surprise_deg
        if not again:
            return surprise_deg * surprise_deg / SURPRISE_SIGMAS**2 - expected
        if abs(rate_deg_s) >= NEAR_REST_DEG_S:
            self._kalman.P[1, 1] += min(abs(surprise_deg) / self._seconds, MOST_RATE_DEG_S) ** 2
        self._kalman.P[0, 0] += surprise_deg * surprise_deg
        return 0.0


def _invert_scalar(matrix: np.ndarray[tuple[int, int], np.dtype[np.float64]]) -> object:
    # One measurement: its covariance is one number, and a general inverse costs more than the whole update.
    return 1.0 / matrix


def wrap180(angle_deg: float) -> float:
    """Return an angle in -180 to 180, degrees."""
    return (angle_deg + 180.0) % 360.0 - 180.0
