"""Fits to a recorded run: smoothed tracks, the satellite's biases, and the mount's gains, delays and ripple.

Tracks and biases are Kalman filters run forwards, then smoothed backwards. Rauch, Tung, Striebel, "Maximum
likelihood estimates of linear dynamic systems", AIAA Journal 3 (1965) 1445; filterpy does the algebra.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import msgspec
import numpy as np

from sattrack.core.errors import SattrackError, how_to_install

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from sattrack.mount.model import MountProfile
    from sattrack.recording.trace import Trace

    Array = NDArray[np.float64]

TRACK_TIME_S = 1.0
"""Over how long a track is smoothed, about."""
GATE_SIGMAS = 4.0
GATE_ROUNDS = 4
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
    count = len(values)
    noise = max(_scatter(values), LEAST_NOISE_ARCSEC)
    steps = np.clip(np.diff(utc_s, prepend=utc_s[0]), 1e-6, None)
    walk = noise**2 / TRACK_TIME_S**3
    kalman = _kalman_filter(2, 1)
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


def _kalman_filter(states: int, measured: int) -> Any:
    """Return a filter with so many states and measured values; raises SattrackError without filterpy."""
    try:
        from filterpy.kalman import KalmanFilter
    except ImportError:
        raise SattrackError(f"fits to observations need filterpy: {how_to_install('plot')}") from None
    return KalmanFilter(dim_x=states, dim_z=measured)


def _scatter(values: Array) -> float:
    """Return one sigma of white noise by second differences, which a smooth track hardly has (MAD)."""
    if len(values) < 5:
        return float(np.std(values)) or 1.0
    second = np.diff(values, 2)
    return float(np.median(np.abs(second - np.median(second)))) * 1.4826 / math.sqrt(6.0)


@dataclass(frozen=True, slots=True)
class ObservedBias:
    """The biases by one observation: seconds along, km across, with one sigma each."""

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
    for _ in range(GATE_ROUNDS):
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
    kalman = _kalman_filter(4, 2)
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


LONGEST_DELAY_S = 0.5
LEAST_SAMPLES = 200
LEAST_PIECE = 100
"""Samples of a piece of the run that counts; shorter ones show little more than their own beginning."""
LEAST_CHANGE_DEG_S = 0.01
"""A rate that changes less than this over the run shows no delay."""
ROUNDS = 6
BLOCKS = 8
"""In so many parts a fit is tried without each: by how much it changes then says how sure it is."""
SURE_SIGMAS = 4.0
UNSURE_DELAY_S = 0.005
LEAST_TURN_DEG = 20.0
"""An axis must go so far one way, a part of a turn, for a spectrum of its error."""
LEAST_PERIODS = 6
"""A line must repeat so often within the angle that was covered."""
STRONG = 5.0
"""How many times the median amplitude of its neighbourhood a line must have.

Where the neighbourhood is noise, the line's power over the mean is distributed as F with 2 and twice as many
degrees of freedom as there are neighbours. 5 is 17 times the mean: by chance in about one of a million lines.
"""
SHARES = 6
LEFT_SHARE = 0.5
"""A line must keep so much of its amplitude without any one of the SHARES of the angle: a jolt does not."""
SKIRT = 8.0
"""To so many steps of a spectrum beside a line reaches what a change of its amplitude makes of it."""
GAP_STEPS = 20.0
"""Samples so many times farther apart than they are on the mean leave a gap between them."""


class AxisFit(NamedTuple):
    """Gain and delay of one axis, with one sigma of each.

    The gain is that of the axis over what the command asked for; the delay is from a command's tick to when
    it acted, the wait for the mount's loop included, as statuses are dated: below zero where those dates are
    wrong. The delay is None where the data do not give it; `missing` then says why.
    """

    gain: float
    gain_sigma: float
    delay_s: float | None
    delay_sigma_s: float | None
    residual_arcsec: float
    missing: str | None = None


class NoFit(NamedTuple):
    """Why there is no fit."""

    why: str


class SpectralLine(msgspec.Struct, frozen=True):
    """One line of a spectrum: cycles a turn of the axis, its amplitude in arcseconds."""

    cycles_a_turn: float
    amplitude_arcsec: float


def fit_axes(run: Trace, profile: MountProfile) -> tuple[AxisFit | NoFit, AxisFit | NoFit]:
    """Return gain and delay of both axes, right ascension first, or why there is none.

    Of an axis that takes rates by edges nothing is fitted: which of them acted, the datagrams do not tell.
    """
    if profile.move_axis == "edge":
        edges = NoFit("the mount takes rates by edges, and which of them acted the datagrams do not tell")
        return edges, edges
    return _fit_axis(run, 0, not profile.additive), _fit_axis(run, 1, False)


class _Data(NamedTuple):
    """What a fit is made from: samples in pieces, and the commands as a function of time."""

    at: Array
    angle: Array
    pieces: NDArray[np.intp]
    """The number of the piece that each sample is of."""
    sent_at: Array
    rates: Array
    moved: Array
    """How far the commands had moved the axis by each: their integral, linear between them."""


def _fit_axis(run: Trace, axis: int, drifts: bool) -> AxisFit | NoFit:
    """Fit one axis; `drifts` where rates count from the sky at rest and not from the sky that turns."""
    data = _gathered(run, axis)
    if len(data.at) < LEAST_SAMPLES:
        return NoFit(
            f"the mount followed on target for {len(data.at)} samples in pieces that are long enough; "
            f"a fit takes {LEAST_SAMPLES}"
        )
    changes = float(np.ptp(np.interp(data.at, data.sent_at, data.rates))) > LEAST_CHANGE_DEG_S
    delay_s = 0.0
    for _ in range(ROUNDS):
        columns = _columns(data, delay_s, changes, drifts)
        solution = _solved(columns, data.angle)
        step_s = float(solution[1] / solution[0]) if changes else 0.0
        delay_s = min(LONGEST_DELAY_S, max(-LONGEST_DELAY_S, delay_s + step_s))
        if abs(step_s) < 1e-7:
            break
    residual = data.angle - columns @ solution
    gain_sigma, delay_sigma_s = _sigmas(columns, data.angle, residual, changes)
    missing = _delay_missing(delay_s, delay_sigma_s, changes)
    return AxisFit(
        abs(float(solution[0])),
        gain_sigma,
        delay_s if missing is None else None,
        delay_sigma_s if missing is None else None,
        float(np.std(residual)) * 3600.0,
        missing,
    )


def _gathered(run: Trace, axis: int) -> _Data:
    """Return the samples that show an axis, each piece's own level taken out of their angles.

    Commands do not give the path between two pieces: it may have been a slew, or motion by hand.
    """
    good = ~np.isnan(run.sent[:, axis])
    sent_at, rates = run.sent_utc_s[good], run.sent[good, axis]
    usable = run.fit_for.copy()
    if len(sent_at):
        usable &= (run.utc_s > sent_at[0] + LONGEST_DELAY_S) & (run.utc_s < sent_at[-1])
    whole = [one for one in _stretches(usable) if one.stop - one.start >= LEAST_PIECE and len(sent_at)]
    angle = run.axes_deg[:, axis]
    pieces = np.repeat(np.arange(len(whole)), [one.stop - one.start for one in whole])
    joined = np.concatenate([np.unwrap(angle[one], period=360.0) for one in whole] or [np.empty(0)])
    at = np.concatenate([run.utc_s[one] for one in whole] or [np.empty(0)])
    moved = np.concatenate([[0.0], np.cumsum(rates[:-1] * np.diff(sent_at))])
    return _Data(at, _levelled(joined, pieces), pieces, sent_at, rates, moved)


def _levelled(values: Array, pieces: NDArray[np.intp]) -> Array:
    """Return values with each piece's mean taken out."""
    if not len(values):
        return values
    means = np.bincount(pieces, values) / np.bincount(pieces)
    level: Array = values - means[pieces]
    return level


def _columns(data: _Data, delay_s: float, changes: bool, drifts: bool) -> Array:
    """Return what the angles are fitted with: commands' integral, their rate for the delay, a drift."""
    then = data.at - delay_s
    terms = [np.interp(then, data.sent_at, data.moved)]
    if changes:
        terms.append(-np.interp(then, data.sent_at, data.rates))
    if drifts:
        terms.append(data.at - data.at[0])
    return np.stack([_levelled(term, data.pieces) for term in terms], axis=1)


def _solved(columns: Array, angle: Array) -> Array:
    return np.asarray(np.linalg.lstsq(columns, angle, rcond=None)[0], dtype=np.float64)


def _sigmas(columns: Array, angle: Array, residual: Array, changes: bool) -> tuple[float, float | None]:
    """Return one sigma of gain and delay: the residuals' scatter's, or the blocks' where that is more.

    What the model lacks is no noise: it shows in that the fit changes where a block is left out (jackknife).
    """
    noise = float(np.std(residual)) * math.sqrt(_correlated(residual))
    covariance = np.linalg.pinv(columns.T @ columns) * noise**2
    blocks = np.arange(len(angle)) * BLOCKS // len(angle)
    without = np.stack([_solved(columns[blocks != k], angle[blocks != k]) for k in range(BLOCKS)])
    gain = float(_solved(columns, angle)[0])
    gain_sigma = max(math.sqrt(float(covariance[0, 0])), _jackknife(without[:, 0]))
    if not changes:
        return gain_sigma, None
    by_scatter = math.sqrt(float(covariance[1, 1])) / abs(gain)
    return gain_sigma, max(by_scatter, _jackknife(without[:, 1] / without[:, 0]))


def _jackknife(without: Array) -> float:
    return math.sqrt((len(without) - 1) * float(np.var(without)))


def _delay_missing(delay_s: float, sigma_s: float | None, changes: bool) -> str | None:
    """Return why a fitted delay is useless; None where it is not."""
    if not changes or sigma_s is None:
        return f"the delay: the rate changed by less than {LEAST_CHANGE_DEG_S:g} °/s"
    if sigma_s > UNSURE_DELAY_S:
        return f"the delay: a fit gives {delay_s * 1000.0:.0f} ± {sigma_s * 1000.0:.0f} ms"
    return None


def _stretches(marked: NDArray[np.bool_]) -> list[slice]:
    """Return the runs of samples that are marked without a break."""
    edges = np.flatnonzero(np.diff(marked.astype(np.int8), prepend=0, append=0))
    return [slice(int(begin), int(end)) for begin, end in zip(edges[::2], edges[1::2], strict=True)]


def _correlated(residual: Array) -> float:
    """Return over how many samples residuals are correlated: by so much less do they count."""
    centred = residual - residual.mean()
    variance = float(centred @ centred)
    if variance == 0.0:
        return 1.0
    first = float(centred[1:] @ centred[:-1]) / variance
    return (1.0 + first) / (1.0 - first) if first < 0.999 else 2000.0


def one_way(angle_deg: Array) -> slice:
    """Return the part in which an axis goes from its lowest angle to its highest, or back."""
    if not len(angle_deg):
        return slice(0, 0)
    ends = sorted((int(np.argmin(angle_deg)), int(np.argmax(angle_deg))))
    return slice(ends[0], ends[1] + 1)


def repeats(angle_deg: Array, error_arcsec: Array) -> list[SpectralLine] | NoFit:
    """Return what repeats with an axis' angle, or why the data do not show it; the angle must go one way.

    A line counts where it stands out of its neighbourhood, and is there without any sixth of the angle too.
    """
    span = float(np.ptp(angle_deg)) if len(angle_deg) else 0.0
    cycles, amplitude = spectrum(angle_deg, error_arcsec)
    if not len(cycles):
        return NoFit(
            f"what repeats with its angle: on target it turned {span:.1f}° one way in {len(angle_deg)} "
            f"samples; that takes {LEAST_TURN_DEG:g}° and {LEAST_SAMPLES}"
        )
    return [one for one in lines(cycles, amplitude) if _everywhere(one, angle_deg, error_arcsec)]


def _everywhere(line: SpectralLine, angle_deg: Array, error_arcsec: Array) -> bool:
    phase = np.radians(angle_deg * line.cycles_a_turn)
    ramp = angle_deg - angle_deg.mean()
    columns = np.stack([np.sin(phase), np.cos(phase), np.ones_like(phase), ramp], axis=1)
    share = np.minimum((angle_deg - angle_deg.min()) * SHARES / np.ptp(angle_deg), SHARES - 1).astype(int)

    def amplitude(taken: NDArray[np.bool_]) -> float:
        return float(np.hypot(*_solved(columns[taken], error_arcsec[taken])[:2]))

    least = LEFT_SHARE * amplitude(np.ones(len(phase), dtype=bool))
    return all(amplitude(share != k) >= least for k in range(SHARES) if (share == k).any())


def spectrum(angle_deg: Array, error_arcsec: Array) -> tuple[Array, Array]:
    """Return cycles a turn and amplitudes (arcseconds) of an error as a function of the axis' angle.

    The angle must go one way on the whole; empty where it goes less than LEAST_TURN_DEG. The error is put on
    even steps of the angle, its mean and slope taken out, and tapered (Hann); gaps count for nothing.
    """
    order = np.argsort(angle_deg)
    angle, error = angle_deg[order], error_arcsec[order]
    span = float(np.ptp(angle)) if len(angle) else 0.0
    if span < LEAST_TURN_DEG or len(angle) < LEAST_SAMPLES:
        return np.empty(0), np.empty(0)
    even = np.linspace(angle[0], angle[-1], len(angle))
    level = np.interp(even, angle, error)
    steps = np.diff(angle)
    after = np.clip(np.searchsorted(angle, even, side="right") - 1, 0, len(steps) - 1)
    known = steps[after] <= GAP_STEPS * span / len(angle)
    level = level - np.polyval(np.polyfit(even[known], level[known], 1), even)
    window = np.hanning(len(even)) * known
    amplitude: Array = np.abs(np.fft.rfft(level * window)) * 2.0 / float(window.sum())
    cycles: Array = np.arange(len(amplitude), dtype=np.float64) * 360.0 / span
    return cycles, amplitude


LEAST_LINE_ARCSEC = 0.002
MOST_CYCLES = 2000.0
"""No motor has more poles, and no encoder's error that repeats faster is seen at twenty samples a second."""


def lines(cycles: Array, amplitude: Array, most: int = 3) -> list[SpectralLine]:
    """Return the strongest lines of a spectrum that stand out of their neighbourhood.

    The neighbourhood reaches as far down as up, so that errors which only wander make no line.
    """
    found: list[SpectralLine] = []
    if len(amplitude) < 40:
        return found
    for i in np.argsort(amplitude)[::-1]:
        reach = min(20, int(i) // 2)
        background = float(np.median(amplitude[i - reach : i + reach + 1]))
        near = any(abs(cycles[i] - line.cycles_a_turn) < SKIRT * cycles[1] for line in found)
        counts = i >= LEAST_PERIODS and amplitude[i] > max(LEAST_LINE_ARCSEC, STRONG * background)
        if counts and not near and cycles[i] < MOST_CYCLES:
            found.append(SpectralLine(float(cycles[i]), float(amplitude[i])))
        if len(found) >= most or amplitude[i] < float(np.median(amplitude)):
            break
    return found
