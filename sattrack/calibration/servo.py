"""How an axis brakes: how far it goes on, and the largest acceleration that it shows.

A few servo models are fitted to all its stops at once. Each has five parameters. The models differ in
whether the rate wanted falls at once or in a ramp, and in whether the loop holds rates or places. The
acceleration has one meaning in all of them: the largest that the axis does. Its sigma holds how much the
models that fit differ, and how badly the best one fits. An axis that is like none of them is described by its
stopping distance alone.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from collections.abc import Sequence

Array = NDArray[np.float64]

STEPS = 120
LONGEST_S, SHORTEST_S = 2.5, 0.35
SETTLED = 0.003
MODEL_ERROR = 0.002
"""Part of a stopping distance by which no model of a handful is expected to be true."""
NOISE_DEG = 3e-6

WAY_SIGMA = 0.01
COMES_BACK = 0.002
"""An axis that comes back by less, in a part of its way, has not overshot."""
LEAST_TIME_SIGMA_S = 0.0005
FEWEST_SAMPLES = 8
SCOUTING, ITERATIONS = 6, 12
SAME_FIT = 3.0
"""Models whose residuals are so many times the best one's or less are as good as it."""
RESIDUAL_WEIGHT = 25.0
"""How wrong a limit may be, over the part of the distance by which the best model misses the positions. A
drive that jerks from turn to turn is like none of the models, and its limit may be a third off at 0.015."""
UNEVEN_WEIGHT, TURNS_WEIGHT = 3.0, 0.25
"""How wrong a stopping distance may be, over the same, and by how much of the scatter of the mount's turns it
may begin later: such a drive stops a little differently each time."""
LEAST_SIGMA = 0.02
LARGEST_SIGMA = 0.1
MISSED_TURN = 1.5
"""Times the usual interval: a longer one has a lost status in it."""
REACHED = 0.95
REACHED_FOR_S = 0.015
AT_REST = 0.02
"""An axis has stopped where its rate stays below this part of the one it came from."""
FASTEST_SHARE = 0.9
STARTS = tuple(
    (math.log(a), math.log(2.0 * math.pi * f), math.log(0.85), 0.02, 0.005, 0.8)
    for a in (4.0, 14.0)
    for f in (2.0, 7.0, 25.0)
)
USUAL = np.array([math.log(8.0), math.log(50.0), math.log(0.85), 0.0, 0.0, 0.8])
USUALLY_WITHIN = np.array([1.5, 1.5, 0.35, 0.05, 0.05, 0.4])
NUDGES = np.array([1e-3, 1e-3, 1e-3, 1e-4, 1e-4, 1e-3])
INTEGRAL_CORNER = 0.1
"""Of the loop's bandwidth: how fast a loop that holds places learns what is not fed forward of a rate."""


class Model(NamedTuple):
    """One servo: what is wanted of it when it is to stop, and what its loop holds."""

    ramped: bool
    """Whether the rate wanted falls in a ramp, else at once."""
    holds_places: bool


MODELS = (
    Model(ramped=False, holds_places=False),
    Model(ramped=False, holds_places=True),
    Model(ramped=True, holds_places=True),
)


@dataclass(frozen=True, slots=True)
class Transient:
    """One change between rest and a rate: how far the axis is from its place if it had changed at once.

    Against seconds since the mount read the command; positive where it goes on after a stop, or stays behind.
    """

    rate_deg_s: float
    seconds: Array
    moved_deg: Array


@dataclass(frozen=True, slots=True)
class Measured:
    """A change between rest and a rate: how long it lasts, how far the axis is off at most, and sigmas."""

    rate_deg_s: float
    seconds: float
    seconds_sigma: float
    deg: float
    deg_sigma: float


@dataclass(frozen=True, slots=True)
class Braking:
    """How an axis stops from a rate, counted from the mount's reading of the command.

    `acceleration_deg_s2` is what stops may be predicted with: the axis' limit where `limited`, else
    rate^2 / (2 distance), which is lower. Both are None where it stops too quickly to be measured.
    """

    stop: Measured
    acceleration_deg_s2: float | None
    acceleration_sigma_deg_s2: float | None
    limited: bool


@dataclass(frozen=True, slots=True)
class _Fit:
    acceleration_deg_s2: float
    part_sigma: float
    misses_by: float
    """RMS of what is left, as a part of the stopping distance."""
    shown: float
    """The largest acceleration that the model does, in a part of its limit."""


@dataclass(frozen=True, slots=True)
class _Samples:
    """All that is fitted: which of `rates_deg_s` each sample's stop is from."""

    rates_deg_s: Array
    which: NDArray[np.intp]
    seconds: Array
    moved_deg: Array
    sigma_deg: Array
    scale_deg: Array
    """Stopping distances, of slower stops by as much more as less is asked of the fit there."""
    step_s: float


def measured(changes: Sequence[Transient]) -> Measured | None:
    """Return how an axis comes to, or from, the fastest of its rates; None where too little was seen."""
    fastest = _fastest(changes)
    if not fastest:
        return None
    rate = float(np.mean([s.rate_deg_s for s in fastest]))
    ways = np.array([_farthest(s) * (rate / s.rate_deg_s) for s in fastest])
    ends = np.array([_ends_at(s) for s in fastest])
    way = float(ways.mean())
    return Measured(
        rate,
        float(ends[:, 0].mean()),
        math.hypot(float(ends[:, 0].std()), float(ends[:, 1].mean())),
        way,
        math.hypot(
            float(ways.std(ddof=len(ways) > 1)), WAY_SIGMA * abs(way), NOISE_DEG, rate * LEAST_TIME_SIGMA_S
        ),
    )


def turns_sigma_s(seconds: Sequence[Array]) -> float:
    """Return how unevenly the mount's loop turns, by the instants of stretches of its statuses; 0 of none."""
    intervals = np.concatenate([np.diff(one) for one in seconds]) if seconds else np.zeros(0)
    whole = intervals[intervals < MISSED_TURN * np.median(intervals)] if len(intervals) else intervals
    return float(whole.std()) if len(whole) else 0.0


def braking(stops: Sequence[Transient], lag_s: float = 0.0) -> Braking | None:
    """Return how an axis brakes from the fastest of its rates, or None where too little was seen of it.

    A limit is given only if it and `lag_s`, the servo's, predict the stop that was seen, or a longer one.
    """
    stop = measured(stops)
    if stop is None:
        return None
    if stop.deg <= stop.deg_sigma:
        return Braking(stop, None, None, limited=False)
    samples = _samples([s for s in stops if _usable(s)])
    fits = [_fitted(samples, model) for model in MODELS]
    misses_by = min(fit.misses_by for fit in fits)
    late_deg = TURNS_WEIGHT * turns_sigma_s([s.seconds for s in stops]) * stop.rate_deg_s
    part = math.hypot(stop.deg_sigma / stop.deg, UNEVEN_WEIGHT * misses_by, late_deg / stop.deg)
    stop = dataclasses.replace(stop, deg_sigma=part * stop.deg)
    value, limit = stop.rate_deg_s**2 / (2.0 * stop.deg), _limit(fits)
    if limit is not None and limit[0] > (1.0 - LARGEST_SIGMA) * value:
        surely = limit[0] - 2.0 * limit[1]
        if stop.rate_deg_s * (stop.rate_deg_s / (2.0 * surely) + max(0.0, lag_s)) > stop.deg:
            return Braking(stop, *limit, limited=True)
    if part > LARGEST_SIGMA:
        return Braking(stop, None, None, limited=False)
    return Braking(stop, value, part * value, limited=False)


def _fastest(changes: Sequence[Transient]) -> list[Transient]:
    usable = [s for s in changes if _usable(s)]
    top = max((s.rate_deg_s for s in usable), default=0.0)
    return [s for s in usable if s.rate_deg_s > FASTEST_SHARE * top]


def _usable(change: Transient) -> bool:
    return len(change.seconds) >= FEWEST_SAMPLES and float(change.moved_deg.max()) > 0.0


def _farthest(stop: Transient) -> float:
    """Return how far the axis goes at most, by a parabola through the samples about the farthest."""
    k = int(np.argmax(stop.moved_deg))
    if not 0 < k < len(stop.moved_deg) - 1:
        return float(stop.moved_deg[k])
    t, x = stop.seconds[k - 1 : k + 2] - stop.seconds[k], stop.moved_deg[k - 1 : k + 2]
    if x[1] - x[2] < COMES_BACK * x[1]:
        return float(x[1])
    bend, slope, level = np.polyfit(t, x, 2)
    return float(level - slope * slope / (4.0 * bend)) if bend < 0.0 else float(x[1])


def _ends_at(stop: Transient) -> tuple[float, float]:
    """Return when the change is over, and the sigma of that: samples tell it to within their period."""
    t = stop.seconds
    rates = np.diff(stop.moved_deg) / np.diff(t)
    moving = np.flatnonzero(np.abs(rates) > AT_REST * stop.rate_deg_s + 2.0 * NOISE_DEG / np.diff(t))
    k = int(moving[-1]) if len(moving) else 0
    return 0.5 * float(t[k] + t[k + 1]), float(t[k + 1] - t[k]) / math.sqrt(12.0)


def _samples(stops: Sequence[Transient]) -> _Samples:
    kinds = sorted({round(s.rate_deg_s, 2) for s in stops})
    rates = np.array([np.mean([s.rate_deg_s for s in stops if round(s.rate_deg_s, 2) == k]) for k in kinds])
    until = min(LONGEST_S, max(SHORTEST_S, *(_settled_s(s) for s in stops)))
    which, seconds, moved, distance = [], [], [], []
    for stop in stops:
        use = stop.seconds <= until
        kind = kinds.index(round(stop.rate_deg_s, 2))
        which.append(np.full(int(use.sum()), kind))
        seconds.append(stop.seconds[use])
        moved.append(stop.moved_deg[use] * (rates[kind] / stop.rate_deg_s))
        distance.append(np.full(int(use.sum()), stop.moved_deg.max()))
    # Slower stops show less of the limit: a jerk limit or a soft servo comes before it there.
    scale = np.concatenate(distance) * (rates.max() / rates[np.concatenate(which)])
    sigma = np.hypot(NOISE_DEG, MODEL_ERROR * scale)
    return _Samples(
        rates,
        np.concatenate(which),
        np.concatenate(seconds),
        np.concatenate(moved),
        sigma,
        scale,
        until / STEPS,
    )


def _settled_s(stop: Transient) -> float:
    off = np.abs(stop.moved_deg - stop.moved_deg[-1]) > SETTLED * stop.moved_deg.max()
    return float(stop.seconds[np.flatnonzero(off)[-1]] if off.any() else 0.0) + 0.1


def _limit(fits: Sequence[_Fit]) -> tuple[float, float] | None:
    """Return the largest acceleration and its sigma; None where the axis did not come to it."""
    best = min(fits, key=lambda f: f.misses_by)
    good = [f for f in fits if f.misses_by <= SAME_FIT * best.misses_by]
    value = best.acceleration_deg_s2
    spread = 0.5 * float(np.ptp([f.acceleration_deg_s2 for f in good])) / value
    part = math.hypot(best.part_sigma, spread, RESIDUAL_WEIGHT * best.misses_by, LEAST_SIGMA)
    if part > LARGEST_SIGMA or best.shown < REACHED:
        return None
    return value, part * value


def _fitted(samples: _Samples, model: Model) -> _Fit:
    """Fit one model by least squares, from the best of several starts."""
    at = np.array(STARTS)
    at, residuals = _descended(at, SCOUTING, samples, model)
    best = [int(np.argmin((residuals**2).sum(axis=1)))]
    best_at, left = _descended(at[best], ITERATIONS, samples, model)
    slopes = _slopes(best_at, left, samples, model)[0]
    count = len(samples.seconds)
    excess = max(1.0, math.sqrt(float((left[0, :count] ** 2).sum()) / count))
    covariance = np.linalg.inv(slopes.T @ slopes)
    missed = left[0, :count] * samples.sigma_deg / samples.scale_deg
    _, rates, _ = _simulated(best_at, samples, model)
    over = max(1, round(REACHED_FOR_S / samples.step_s))
    shown = np.abs(rates[over:] - rates[:-over]).max() / (over * samples.step_s)
    limit = math.exp(best_at[0, 0])
    return _Fit(
        limit, excess * math.sqrt(covariance[0, 0]), float(np.sqrt((missed**2).mean())), float(shown) / limit
    )


def _descended(at: Array, times: int, samples: _Samples, model: Model) -> tuple[Array, Array]:
    """Return parameters after so many steps of Levenberg-Marquardt, and their residuals, for each start."""
    at = at.copy()
    residuals = _residuals(at, samples, model)
    cost = (residuals**2).sum(axis=1)
    damping = np.full(len(at), 1e-2)
    for _ in range(times):
        slopes = _slopes(at, residuals, samples, model)
        normal = np.einsum("smp,smq->spq", slopes, slopes)
        scale = np.einsum("spp->sp", normal)
        normal += damping[:, None, None] * np.einsum("sp,pq->spq", scale, np.eye(at.shape[1]))
        down = np.einsum("smp,sm->sp", slopes, residuals)
        step = np.clip(np.linalg.solve(normal, down[:, :, None])[:, :, 0], -1.0, 1.0)
        tried = _residuals(at - step, samples, model)
        lower = (tried**2).sum(axis=1)
        better = lower < cost
        at[better] -= step[better]
        residuals[better], cost[better] = tried[better], lower[better]
        damping = np.where(better, 0.3 * damping, 5.0 * damping)
    return at, residuals


def _slopes(at: Array, residuals: Array, samples: _Samples, model: Model) -> Array:
    """Return how each start's residuals change with its parameters, shape (starts, residuals, parameters)."""
    starts, count = at.shape
    nudged = (at[:, None, :] + np.diag(NUDGES)[None]).reshape(starts * count, count)
    there = _residuals(nudged, samples, model).reshape(starts, count, -1)
    slopes: Array = np.moveaxis((there - residuals[:, None, :]) / NUDGES[None, :, None], 1, 2)
    return slopes


def _residuals(at: Array, samples: _Samples, model: Model) -> Array:
    """Return model less sample over its sigma, and then parameters less what is usual, for each start."""
    places, rates, forces = _simulated(at, samples, model)
    lanes, which = np.arange(len(at))[:, None], samples.which[None, :]
    dead = at[:, 4:5]
    since = samples.seconds[None, :] - dead
    index = np.clip((since / samples.step_s).astype(np.intp), 0, STEPS - 1)
    part = np.minimum(since, STEPS * samples.step_s) - index * samples.step_s
    there = places[index, lanes, which] + part * rates[index, lanes, which]
    there += np.where(since > 0.0, 0.5 * part**2 * forces[index, lanes, which], 0.0)
    there += samples.rates_deg_s[samples.which][None, :] * dead
    off = (there - samples.moved_deg[None, :]) / samples.sigma_deg[None, :]
    return np.concatenate([off, (at - USUAL) / USUALLY_WITHIN], axis=1)


def _simulated(at: Array, samples: _Samples, model: Model) -> tuple[Array, Array, Array]:
    """Return places, rates and accelerations of stops, shape (time, starts, rates), from 0 at their begin."""
    limit, omega, damping = (np.exp(np.clip(at[:, i : i + 1], -6.0, 9.0)) for i in range(3))
    begin = samples.rates_deg_s[None, :] * np.ones_like(limit)
    h = samples.step_s
    instants = np.arange(STEPS + 1, dtype=np.float64) * h
    smooth_s = np.maximum(np.abs(at[:, 3:4]), 1e-3)
    wanted = _wanted_deg(instants, begin, limit if model.ramped else None, smooth_s)
    rate, force = begin.copy(), np.zeros_like(begin)
    place = wanted[0].copy() if model.holds_places else np.zeros_like(begin)
    first = place.copy()
    places, rates, forces = (np.empty((STEPS + 1, *begin.shape)) for _ in range(3))
    drag, stiffness = 2.0 * damping * omega, omega**2
    share = at[:, 5:6]
    learnt = (1.0 - share) * drag * begin
    asked = np.diff(wanted, axis=0) / h
    middle, shared = 0.5 * (wanted[:-1] + wanted[1:]), share * asked
    integral = h * INTEGRAL_CORNER * omega * stiffness
    resists = 1.0 + 0.5 * h * drag + 0.25 * h * h * stiffness
    follows, slows = h * stiffness, 1.0 + h * drag + h * h * stiffness
    for k in range(STEPS):
        places[k], rates[k] = place, rate
        if model.holds_places:
            behind = middle[k] - place - 0.5 * h * rate
            force = (stiffness * behind + learnt + drag * (shared[k] - rate)) / resists
            learnt = learnt + integral * behind
        else:
            force = (force + follows * (asked[k] - rate)) / slows
        if not model.ramped:
            force = np.minimum(np.maximum(force, -limit), limit)
        forces[k] = force
        place = place + h * (rate + 0.5 * h * force)
        rate = rate + h * force
    places[STEPS], rates[STEPS], forces[STEPS] = place, rate, 0.0
    return places - first, rates, forces


def _wanted_deg(seconds: Array, begin: Array, ramp: Array | None, smooth_s: Array) -> Array:
    """Return where the axis should be: a rate that ends at once or in a ramp, averaged over `smooth_s`."""
    smooth = smooth_s[None]
    t = seconds[:, None, None]

    def area(t: Array) -> Any:
        before = np.minimum(t, 0.0)
        if ramp is None:
            return 0.5 * begin * before**2
        ends = begin / ramp
        within = np.clip(t, 0.0, ends)
        after = np.maximum(t - ends, 0.0)
        return begin * (0.5 * before**2 + 0.5 * within**2 + 0.5 * ends * after) - ramp * within**3 / 6.0

    mean: Array = (area(t) - area(t - smooth)) / smooth
    return mean
