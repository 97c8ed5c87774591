"""What the mount made of its commands: gain and delay of each axis, and what repeats with its angle."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import msgspec
import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from sattrack.mount import MountProfile
    from sattrack.recording.trace import Trace

    Array = NDArray[np.float64]

LONGEST_DELAY_S = 0.5
LEAST_SAMPLES = 200
LEAST_CHANGE_DEG_S = 0.01
"""A rate that changes less than this over the run shows no delay."""
ROUNDS = 6
STRONG = 4.0
"""How many times the median amplitude of its neighbourhood a line must have."""


class AxisFit(NamedTuple):
    """Gain and delay of one axis, with one sigma of each; the delay None where the rate hardly changed.

    The gain is that of the axis over what the command asked for; the delay is from a command's tick to when
    it acted, the wait for the mount's loop included, as the mount's clock dates it.
    """

    gain: float
    gain_sigma: float
    delay_s: float | None
    delay_sigma_s: float | None
    residual_arcsec: float


class Line(msgspec.Struct, frozen=True):
    """One line of a spectrum: cycles a turn of the axis, its amplitude in arcseconds."""

    cycles_a_turn: float
    amplitude_arcsec: float


def fit_axes(run: Trace, profile: MountProfile) -> tuple[AxisFit | None, AxisFit | None]:
    """Return gain and delay of both axes, right ascension first; None where there is too little to fit.

    Of an axis that takes rates by edges nothing is fitted: which of them acted, the datagrams do not tell.
    """
    if profile.move_axis == "edge":
        return None, None
    return _fit_axis(run, 0, not profile.additive), _fit_axis(run, 1, False)


def _fit_axis(run: Trace, axis: int, drifts: bool) -> AxisFit | None:
    """Fit one axis; `drifts` where rates count from the sky at rest and not from the sky that turns."""
    # Commands tell nothing of the way between two stretches: it was a slew, or somebody's by hand.
    whole = _longest_stretch(run.following)
    at = run.utc_s[whole]
    angle = (run.ra_deg if axis == 0 else run.dec_deg)[whole]
    unwrapped = np.unwrap(angle, period=360.0)
    good = ~np.isnan(run.sent[:, axis])
    sent_at, rates = run.sent_utc_s[good], run.sent[good, axis]
    if min(len(at), len(rates)) < LEAST_SAMPLES:
        return None
    # What a held rate has moved by any instant: the integral of the commands, linear between their instants.
    moved = np.concatenate([[0.0], np.cumsum(rates[:-1] * np.diff(sent_at))])
    inside = (at > sent_at[0] + LONGEST_DELAY_S) & (at < sent_at[-1])
    at, unwrapped = at[inside], unwrapped[inside]
    if len(at) < LEAST_SAMPLES:
        return None
    changes = float(np.ptp(rates)) > LEAST_CHANGE_DEG_S
    delay_s = 0.0
    for _ in range(ROUNDS):
        base = np.interp(at - delay_s, sent_at, moved)
        terms = [base, np.ones_like(at)]
        if changes:
            terms.append(-np.interp(at - delay_s, sent_at, rates))
        if drifts:
            terms.append(at - at[0])
        columns = np.stack(terms, axis=1)
        solution, _, _, _ = np.linalg.lstsq(columns, unwrapped, rcond=None)
        residual = unwrapped - columns @ solution
        step_s = float(solution[2] / solution[0]) if changes else 0.0
        delay_s = min(LONGEST_DELAY_S, max(-LONGEST_DELAY_S, delay_s + step_s))
        if abs(step_s) < 1e-7:
            break
    noise = float(np.std(residual)) * math.sqrt(_correlated(residual))
    covariance = np.linalg.pinv(columns.T @ columns) * noise**2
    gain = abs(float(solution[0]))
    return AxisFit(
        gain,
        math.sqrt(float(covariance[0, 0])),
        delay_s if changes else None,
        math.sqrt(float(covariance[2, 2])) / gain if changes else None,
        float(np.std(residual)) * 3600.0,
    )


def _longest_stretch(following: NDArray[np.bool_]) -> slice:
    """Return the longest run of samples that follow without a break."""
    edges = np.flatnonzero(np.diff(following.astype(np.int8), prepend=0, append=0))
    if not len(edges):
        return slice(0, 0)
    longest = int(np.argmax(edges[1::2] - edges[::2]))
    return slice(int(edges[2 * longest]), int(edges[2 * longest + 1]))


def _correlated(residual: Array) -> float:
    """Return over how many samples residuals hang together: by so much less do they tell."""
    centred = residual - residual.mean()
    variance = float(centred @ centred)
    if variance == 0.0:
        return 1.0
    first = float(centred[1:] @ centred[:-1]) / variance
    return (1.0 + first) / (1.0 - first) if first < 0.999 else 2000.0


def spectrum(angle_deg: Array, error_arcsec: Array) -> tuple[Array, Array]:
    """Return cycles a turn and amplitudes (arcseconds) of an error as a function of the axis' angle.

    The angle must go one way on the whole; empty where it goes less than twenty degrees. The error is put on
    even steps of the angle, its mean and slope taken out, and tapered (Hann).
    """
    order = np.argsort(angle_deg)
    angle, error = angle_deg[order], error_arcsec[order]
    span = float(np.ptp(angle)) if len(angle) else 0.0
    if span < 20.0 or len(angle) < LEAST_SAMPLES:
        return np.empty(0), np.empty(0)
    even = np.linspace(angle[0], angle[-1], len(angle))
    level = np.interp(even, angle, error)
    level = level - np.polyval(np.polyfit(even, level, 1), even)
    window = np.hanning(len(even))
    amplitude: Array = np.abs(np.fft.rfft(level * window)) * 2.0 / float(window.sum())
    cycles: Array = np.arange(len(amplitude), dtype=np.float64) * 360.0 / span
    return cycles, amplitude


LEAST_LINE_ARCSEC = 0.002
MOST_CYCLES = 2000.0
"""No motor has more poles, and no encoder's error that repeats faster is seen at twenty samples a second."""


def lines(cycles: Array, amplitude: Array, most: int = 3) -> list[Line]:
    """Return the strongest lines of a spectrum that stand out of their neighbourhood."""
    found: list[Line] = []
    if len(amplitude) < 40:
        return found
    for i in np.argsort(amplitude)[::-1]:
        low, high = max(2, i - 20), min(len(amplitude), i + 21)
        background = float(np.median(amplitude[low:high]))
        near = any(abs(cycles[i] - line.cycles_a_turn) < 4.0 * cycles[1] for line in found)
        counts = i >= 3 and amplitude[i] > max(LEAST_LINE_ARCSEC, STRONG * background)
        if counts and not near and cycles[i] < MOST_CYCLES:
            found.append(Line(float(cycles[i]), float(amplitude[i])))
        if len(found) >= most or amplitude[i] < float(np.median(amplitude)):
            break
    return found
