"""Tracks and biases as they look with hindsight: Kalman filters run forwards, then smoothed backwards.

Rauch, Tung, Striebel, "Maximum likelihood estimates of linear dynamic systems", AIAA Journal 3 (1965) 1445;
filterpy does the algebra.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    Array = NDArray[np.float64]

TRACK_TIME_S = 1.0
"""Over how long a track is smoothed, about."""
GATE_SIGMAS = 4.0
ROUNDS = 4
LEAST_NOISE_ARCSEC = 1e-4
PRIOR_SIGMAS = (60.0, 0.003, 20.0, 0.01)
"""Of a satellite's biases before any observation: along s, its drift s/s, across km, its drift km/s."""


class Track(NamedTuple):
    """A smoothed track: values and one sigma of each, and the filter's innovations in their own sigmas."""

    values: Array
    sigmas: Array
    innovations: Array
    noise: float
    """One sigma of a single sample, as the samples themselves show it."""


def smooth_track(utc_s: Array, values: Array) -> Track:
    """Return a track smoothed over about TRACK_TIME_S, for samples in order of time; the unit is theirs.

    A sample's noise is taken from how samples scatter about their neighbours; the model is a rate that walks
    at random, as fast as to forget in TRACK_TIME_S.
    """
    from filterpy.kalman import KalmanFilter

    count = len(values)
    noise = max(_scatter(values), LEAST_NOISE_ARCSEC)
    steps = np.clip(np.diff(utc_s, prepend=utc_s[0]), 1e-6, None)
    walk = noise**2 / TRACK_TIME_S**3
    kalman = KalmanFilter(dim_x=2, dim_z=1)
    kalman.x = np.array([[values[0]], [0.0]])
    kalman.P = np.diag([noise**2, (noise / TRACK_TIME_S) ** 2 * 10.0])
    kalman.H, kalman.R = np.array([[1.0, 0.0]]), np.array([[noise**2]])
    moves = [np.array([[1.0, dt], [0.0, 1.0]]) for dt in steps]
    spreads = [walk * np.array([[dt**3 / 3.0, dt**2 / 2.0], [dt**2 / 2.0, dt]]) for dt in steps]
    means, covariances = np.empty((count, 2, 1)), np.empty((count, 2, 2))
    innovations = np.empty(count)
    for i in range(count):
        kalman.predict(F=moves[i], Q=spreads[i])
        kalman.update(values[i])
        means[i], covariances[i] = kalman.x, kalman.P
        innovations[i] = float(kalman.y[0, 0]) / math.sqrt(float(kalman.S[0, 0]))
    smooth, spread, _, _ = kalman.rts_smoother(means, covariances, Fs=moves, Qs=spreads)
    return Track(smooth[:, 0, 0], np.sqrt(spread[:, 0, 0]), innovations, noise)


def _scatter(values: Array) -> float:
    """Return one sigma of white noise by second differences, which a smooth track hardly has (MAD)."""
    if len(values) < 5:
        return float(np.std(values)) or 1.0
    second = np.diff(values, 2)
    return float(np.median(np.abs(second - np.median(second)))) * 1.4826 / math.sqrt(6.0)


@dataclass(frozen=True, slots=True)
class ObservedBias:
    """What one observation says of the biases: seconds along, km across, with one sigma each."""

    utc_s: float
    along_s: float
    cross_km: float
    along_sigma_s: float
    cross_sigma_km: float


class DriftingBias(NamedTuple):
    """One bias with its drift, each with one sigma; seconds and seconds a second, or km and km a second."""

    value: float
    sigma: float
    drift: float
    drift_sigma: float


@dataclass(frozen=True, slots=True)
class BiasFit:
    """Biases fitted to observations, as of `utc_s`, the mean instant of the observations that were taken."""

    utc_s: float
    along: DriftingBias
    cross: DriftingBias
    taken: int
    rejected: int
    chi_square: float
    """Sum of squared residuals in their sigmas, over twice the number taken."""
    utc_all_s: Array
    along_all: Array
    along_sigma_all: Array
    cross_all: Array
    cross_sigma_all: Array
    observed_along: Array
    observed_along_sigma: Array
    observed_cross: Array
    observed_cross_sigma: Array


def fit_biases(observed: Sequence[ObservedBias]) -> BiasFit | None:
    """Return biases smoothed over all observations, with drifts; None where none is left.

    Observations that lie GATE_SIGMAS off what the others say are left out. Where the observations show more
    scatter than they claim, the sigmas grow by it.
    """
    ordered = sorted(observed, key=lambda one: one.utc_s)
    if not ordered:
        return None
    keep = np.ones(len(ordered), dtype=bool)
    for _ in range(ROUNDS):
        taken = [one for one, kept in zip(ordered, keep, strict=True) if kept]
        if not taken:
            return None
        fit = _smoothed(taken, len(ordered) - len(taken))
        off = _off(ordered, fit)
        scale = np.maximum(1.0, 1.4826 * np.median(np.abs(off), axis=0))
        now = np.max(np.abs(off) / scale, axis=1) <= GATE_SIGMAS
        if (now == keep).all():
            break
        keep = now
    return fit


def _smoothed(taken: Sequence[ObservedBias], rejected: int) -> BiasFit:
    from filterpy.kalman import KalmanFilter

    kalman = KalmanFilter(dim_x=4, dim_z=2)
    kalman.P = np.diag(np.square(PRIOR_SIGMAS))
    kalman.H = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]])
    middle_utc_s = float(np.mean([one.utc_s for one in taken]))
    # The filter begins in the middle of time: the drift's prior is not to weigh on one end.
    at = [one.utc_s - middle_utc_s for one in taken]
    moves = [_move(dt) for dt in np.diff([0.0, *at])]
    spreads = [np.zeros((4, 4))] * len(taken)
    means, covariances = [], []
    for one, move, spread in zip(taken, moves, spreads, strict=True):
        kalman.predict(F=move, Q=spread)
        kalman.update(
            np.array([[one.along_s], [one.cross_km]]),
            R=np.diag([one.along_sigma_s**2, one.cross_sigma_km**2]),
        )
        means.append(kalman.x.copy())
        covariances.append(kalman.P.copy())
    x, p, _, _ = kalman.rts_smoother(np.array(means), np.array(covariances), Fs=moves, Qs=spreads)
    residuals = np.array([[one.along_s, one.cross_km] for one in taken]) - x[:, [0, 2], 0]
    sigmas = np.array([[one.along_sigma_s, one.cross_sigma_km] for one in taken])
    chi_square = float(np.mean((residuals / sigmas) ** 2))
    grown = math.sqrt(max(1.0, chi_square)) if len(taken) > 8 else 1.0
    back = _move(-at[-1])
    mean, covariance = back @ x[-1], back @ p[-1] @ back.T
    along, cross = (
        DriftingBias(
            float(mean[i, 0]),
            grown * math.sqrt(float(covariance[i, i])),
            float(mean[i + 1, 0]),
            grown * math.sqrt(float(covariance[i + 1, i + 1])),
        )
        for i in (0, 2)
    )
    spread = grown * np.sqrt(np.stack([p[:, 0, 0], p[:, 2, 2]]))
    utc = np.array([one.utc_s for one in taken])
    return BiasFit(
        middle_utc_s,
        along,
        cross,
        len(taken),
        rejected,
        chi_square,
        utc,
        x[:, 0, 0],
        spread[0],
        x[:, 2, 0],
        spread[1],
        np.array([one.along_s for one in taken]),
        sigmas[:, 0],
        np.array([one.cross_km for one in taken]),
        sigmas[:, 1],
    )


def _move(dt: float) -> Array:
    return np.array([[1.0, dt, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, dt], [0.0, 0.0, 0.0, 1.0]])


def _off(ordered: Sequence[ObservedBias], fit: BiasFit) -> Array:
    """Return how far each observation lies from a fit, in its own sigmas: along, across."""
    off = []
    for one in ordered:
        seconds = one.utc_s - fit.utc_s
        along = one.along_s - fit.along.value - fit.along.drift * seconds
        cross = one.cross_km - fit.cross.value - fit.cross.drift * seconds
        off.append((along / one.along_sigma_s, cross / one.cross_sigma_km))
    return np.array(off)
