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
SURPRISING = SURPRISE_SIGMAS**2
MOST_RATE_DEG_S, MOST_GAIN = 0.1, 0.25
"""No disturbance is larger, and no gain further off: what seems so is a filter that is led astray."""
SMALLEST_NOISE_SHARE, LARGEST_NOISE_SHARE = 0.02, 400.0
"""How far the measurement's variance may go from the expected one: a seventh of the sigma to twenty times."""
NEAR_REST_DEG_S = 0.05
"""Slower than this an axis may stick. How far it stays behind then its servo takes away by itself, so that is
no rate: compensated as one, the axis breaks loose the further."""
PLAUSIBLE_RATE_DEG_S = 40.0 / 3600.0
"""A rate disturbance beyond this was an axis that was stopped: near rest too, it may be over at once."""
Matrix = np.ndarray[tuple[int, int], np.dtype[np.float64]]


class LeanKalmanFilter(KalmanFilter):  # type: ignore[misc]
    """filterpy's filter for one axis, its algebra written out: three numbers of state, one measured.

    `foretell` and `correct` are `predict` and `update` for the transition [[1, dt, d], [0, 1, 0], [0, 0, 1]],
    the input d on the position, and the measurement of the position alone. Floats round alike on every
    processor, which matrix libraries do not, and take a quarter of the time. The covariance is corrected in
    Joseph's form, as filterpy does it. `x` and `P` are filterpy's.
    """

    def __init__(self, position_deg: float, variances: tuple[float, float, float]) -> None:
        super().__init__(dim_x=3, dim_z=1, dim_u=1)
        self.position_deg, self.rate_deg_s, self.gain_error = position_deg, 0.0, 0.0
        self.pp, self.rr, self.gg = variances
        self.pr = self.pg = self.rg = 0.0
        """Covariances of position, rate and gain."""
        self.innovation_deg = 0.0
        self.innovation_variance = 1.0

    @property
    def x(self) -> Matrix:
        """The state: position, rate disturbance, gain's error."""
        return np.array([[self.position_deg], [self.rate_deg_s], [self.gain_error]])

    @x.setter
    def x(self, state: Matrix) -> None:
        (self.position_deg,), (self.rate_deg_s,), (self.gain_error,) = state.tolist()

    @property
    def P(self) -> Matrix:  # noqa: N802 - filterpy's name
        """The state's covariance."""
        rows = (self.pp, self.pr, self.pg), (self.pr, self.rr, self.rg), (self.pg, self.rg, self.gg)
        return np.array(rows)

    @P.setter
    def P(self, covariance: Matrix) -> None:  # noqa: N802
        (self.pp, self.pr, self.pg), (_, self.rr, self.rg), (_, _, self.gg) = covariance.tolist()

    def foretell(
        self, dt: float, moved: float, known: float, noise: tuple[float, float, float, float]
    ) -> None:
        """Predict over `dt` seconds in which commands moved the axis by `moved`, `known` of it by the gain.

        `noise` is the process noise: of the position, of both, of the rate, of the gain.
        """
        self.position_deg += self.rate_deg_s * dt + self.gain_error * known + moved
        to_p = self.pp + dt * self.pr + known * self.pg
        to_r = self.pr + dt * self.rr + known * self.rg
        to_g = self.pg + dt * self.rg + known * self.gg
        self.pp = to_p + dt * to_r + known * to_g + noise[0]
        self.pr, self.pg = to_r + noise[1], to_g
        self.rr += noise[2]
        self.gg += noise[3]

    def correct(self, measured: float, variance: float) -> None:
        """Take one measurement of the position in."""
        self.innovation_deg = left = measured - self.position_deg
        self.innovation_variance = total = self.pp + variance
        pp, pr, pg = self.pp, self.pr, self.pg
        kp, kr, kg = pp / total, pr / total, pg / total
        self.position_deg += kp * left
        self.rate_deg_s += kr * left
        self.gain_error += kg * left
        kept = 1.0 - kp
        self.pp = kept * pp * kept + kp * variance * kp
        self.pr = kept * (pr - pp * kr) + kp * variance * kr
        self.pg = kept * (pg - pp * kg) + kp * variance * kg
        self.rr += kr * (total * kr - 2.0 * pr)
        self.rg += kr * (total * kg - pg) - pr * kg
        self.gg += kg * (total * kg - 2.0 * pg)


class AxisFilter:
    """One axis, in unwrapped degrees."""

    def __init__(self, position_deg: float, noise: Noise | None = None) -> None:
        self._noise = noise = noise or Noise()
        self._rate_walk = noise.rate_walk_deg_s_sqrt_s**2
        self._walk = noise.walk_deg_sqrt_s**2
        self._gain_walk = noise.gain_walk_sqrt_s**2
        self._reading = noise.position_deg**2
        variances = (1e-4, self._noise.first_rate_deg_s**2, self._noise.first_gain**2)
        self._kalman = LeanKalmanFilter(position_deg, variances)
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
        return self._kalman.position_deg

    @property
    def disturbance_deg_s(self) -> float:
        """Rate that is there beside the commanded one, degrees per second."""
        return self._kalman.rate_deg_s

    def expected_sigma_deg(self, jolt_deg_s: float) -> float:
        """Return how far off the next measurement may be, one sigma, after a change of the commanded rate."""
        return math.hypot(self.innovation_sigma_deg, self._noise.response_s * jolt_deg_s)

    @property
    def gain_error(self) -> float:
        """What comes of a commanded rate, divided by it, less one."""
        return self._kalman.gain_error

    @property
    def position_sigma_deg(self) -> float:
        """Uncertainty of the position, one sigma."""
        return math.sqrt(self._kalman.pp)

    def foretold_deg(self, seconds: float, displacement_deg: float) -> float:
        """Return where the axis will be after commands that move it by `displacement_deg`."""
        known = self._kalman
        return known.position_deg + known.rate_deg_s * seconds + displacement_deg * (1.0 + known.gain_error)

    def advance(
        self, seconds: float, displacement_deg: float, commanded: bool = True, jolt_deg_s: float = 0.0
    ) -> None:
        """Predict over an interval in which the axis moved by `displacement_deg`.

        Where that is not what commands made but what was seen, it says nothing of the gain. `jolt_deg_s` is
        by how much the commanded rate has changed: the servo takes its time to follow.
        """
        self._seconds = seconds
        # White noise in rate and in its derivative, integrated over the interval.
        rate_variance = self._rate_walk * seconds
        cross = 0.5 * rate_variance * seconds
        own = self._walk * seconds + rate_variance * seconds * seconds / 3.0
        own += (self._noise.response_s * jolt_deg_s) ** 2
        gain_variance = self._gain_walk * seconds
        gained_deg = displacement_deg if commanded else 0.0
        process = (own, cross, rate_variance, gain_variance)
        self._kalman.foretell(seconds, displacement_deg, gained_deg, process)

    def measure(self, position_deg: float, rate_deg_s: float) -> None:
        """Take in a reported position (any turn) of an axis that moves at about `rate_deg_s`."""
        known = self._kalman
        predicted = known.position_deg
        surprise = wrap180(position_deg - predicted)
        variance = self._noise_share * (self._reading + (rate_deg_s * self._noise.timing_s) ** 2)
        expected = known.pp + variance
        if surprise * surprise > SURPRISING * expected:
            variance += self._weigh_surprise(surprise, expected, rate_deg_s)
        else:
            self._surprised_deg = 0.0
            self._learn_noise(surprise * surprise / expected)
        known.correct(predicted + surprise, variance)
        if abs(known.rate_deg_s) > MOST_RATE_DEG_S:
            known.rate_deg_s = math.copysign(MOST_RATE_DEG_S, known.rate_deg_s)
        if abs(known.gain_error) > MOST_GAIN:
            known.gain_error = math.copysign(MOST_GAIN, known.gain_error)
        self.innovation_sigma_deg = math.sqrt(known.innovation_variance)
        self.innovation_sigmas = known.innovation_deg / self.innovation_sigma_deg

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
        disturbance_deg_s = self._kalman.rate_deg_s
        gone = abs(disturbance_deg_s) > PLAUSIBLE_RATE_DEG_S and disturbance_deg_s * surprise_deg < 0.0
        if abs(rate_deg_s) >= NEAR_REST_DEG_S or gone:
            self._kalman.rr += min(abs(surprise_deg) / self._seconds, MOST_RATE_DEG_S) ** 2
        self._kalman.pp += surprise_deg * surprise_deg
        return 0.0


def wrap180(angle_deg: float) -> float:
    """Return an angle in -180 to 180, degrees."""
    return (angle_deg + 180.0) % 360.0 - 180.0
