"""Steady motion at known commanded rates: gain, sign, what is added, the rate limit and the servo's lag."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from sattrack.mount.model import SIDEREAL_RATE_DEG_S

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

FEWEST_SAMPLES = 8
LEAST_SIGMA_DEG_S = 1e-7
RIPPLES = tuple(1e-7 * 1.25**n for n in range(60))
FALLS_SHORT = 0.02
LATE_PART = 0.6
"""How much of the end of a plateau is taken for settled."""
FEWEST_LAGS = 4
LEAST_LAG_SIGMA_S = 0.0007
LARGEST_LAG_SIGMA_S = 0.003
LARGEST_LAG_PART = 0.1
STRAY_S = 0.03
"""A lag that is off by more is of a command that was lost and came with the next datagram."""
SHARES = (0.6, 0.5, 0.4, 0.3)
"""How much of a motion's end is taken for steady, the most that is straight."""
STRAIGHT = 3e-5
"""Part of the rate by which two halves of a steady motion may differ."""
SETTLING_AT_MOST = 0.02
GOES_ON_BY = 2.0
ADDED_WITHIN = 0.2
"""Part of the sidereal rate by which what is added may miss either reading."""

AxisName = Literal["ra", "dec"]


@dataclass(frozen=True, slots=True)
class Stretch:
    """One motion from its first acknowledged status on: the axis' own angle against time.

    Time is ours but for a constant.
    """

    rate_deg_s: float
    seconds: NDArray[np.float64]
    angle_deg: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Steady:
    """The steady part of a stretch."""

    commanded_deg_s: float
    rate_deg_s: float
    sigma_deg_s: float


@dataclass(frozen=True, slots=True)
class AxisResponse:
    """How one axis answers: rate = sign x gain x commanded + added, degrees a second."""

    sign: Literal[-1, 1]
    gain: float
    gain_sigma: float
    added_deg_s: float
    added_sigma_deg_s: float
    fastest_deg_s: float
    """The fastest steady rate seen, either way."""
    rate_limit_reached: bool
    """Whether the axis went no faster than that when commanded to."""
    steady: tuple[Steady, ...]

    @property
    def additive(self) -> bool | None:
        """Whether sidereal tracking goes on beneath MoveAxis; None where the motion fits neither reading."""
        part = self.added_deg_s / SIDEREAL_RATE_DEG_S
        if abs(part - 1.0) < ADDED_WITHIN:
            return True
        return False if abs(part) < ADDED_WITHIN else None

    def rate_deg_s(self, commanded_deg_s: float) -> float:
        """Return the steady rate that comes of a commanded one."""
        return self.sign * self.gain * commanded_deg_s + self.added_deg_s


@dataclass(frozen=True, slots=True)
class Plateau:
    """A stretch of one rate among small changes of it; `seconds` are since the mount read that rate."""

    rate_deg_s: float
    began_s: float
    seconds: NDArray[np.float64]
    angle_deg: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class LagFit:
    """Mean delay of the axis' rate behind the commanded one, after the mount has read that."""

    seconds: float
    sigma_s: float


def steady_part(stretch: Stretch) -> Steady | None:
    """Return the steady motion of a stretch, from its last straight part; None where there is none."""
    t, x = stretch.seconds, stretch.angle_deg
    if len(t) < FEWEST_SAMPLES:
        return None
    length = t[-1] - t[0]
    best: Steady | None = None
    for share in SHARES:
        use = t >= t[-1] - share * length
        if use.sum() < FEWEST_SAMPLES:
            break
        rate, _, sigma = _line(t[use], x[use])
        late_half = t[use] >= t[use].mean()
        early, _, s1 = _line(t[use][~late_half], x[use][~late_half])
        late, _, s2 = _line(t[use][late_half], x[use][late_half])
        bend = abs(late - early)
        # What bends beyond its noise is still settling, and will go on by more than it bends.
        unsettled = max(0.0, bend - 2.0 * math.hypot(s1, s2))
        best = Steady(stretch.rate_deg_s, rate, math.hypot(sigma, GOES_ON_BY * unsettled))
        if bend < max(STRAIGHT * abs(stretch.rate_deg_s), 3.0 * math.hypot(s1, s2)):
            return best
    # What is still settling is worth what it has changed by.
    return (
        best if best is not None and best.sigma_deg_s < SETTLING_AT_MOST * abs(best.commanded_deg_s) else None
    )


def _line(t: NDArray[np.float64], x: NDArray[np.float64]) -> tuple[float, float, float]:
    """Return slope, value at t = 0 and the slope's sigma, by least squares."""
    middle = t.mean()
    spread = ((t - middle) ** 2).sum()
    slope = float(((t - middle) * x).sum() / spread)
    level = float(x.mean() - slope * middle)
    residuals = x - (level + slope * t)
    variance = float((residuals**2).sum()) / max(1, len(t) - 2)
    return slope, level, math.sqrt(variance / spread)


def axis_response(parts: Sequence[Steady]) -> AxisResponse | None:
    """Fit one axis' steady motions; None where there are too few. Rates of both directions are needed.

    Motions that a rate limit has cut short are left out.
    """
    free = _free(parts)
    response = _line_through(free)
    if response is None:
        return None
    fastest = max(abs(p.rate_deg_s) for p in parts)
    return replace(response, fastest_deg_s=fastest, rate_limit_reached=len(free) < len(parts))


def _free(parts: Sequence[Steady]) -> list[Steady]:
    """Return the motions without the fastest, where those fall short of what the others foretell."""
    kept = list(parts)
    while kept:
        top = max(abs(p.commanded_deg_s) for p in kept) * 0.99
        slower, fastest = (
            [p for p in kept if (abs(p.commanded_deg_s) > top) == is_top] for is_top in (False, True)
        )
        line = _line_through(slower)
        if line is None or not all(_falls_short(p, line) for p in fastest):
            break
        kept = slower
    return kept


def _falls_short(part: Steady, line: AxisResponse) -> bool:
    expected = line.rate_deg_s(part.commanded_deg_s)
    missing = abs(expected) - abs(part.rate_deg_s)
    return missing > max(FALLS_SHORT * abs(expected), 5.0 * part.sigma_deg_s)


def _line_through(parts: Sequence[Steady]) -> AxisResponse | None:
    if len(parts) < 3 or len({p.commanded_deg_s > 0.0 for p in parts}) < 2:
        return None
    commanded = np.array([p.commanded_deg_s for p in parts])
    rates = np.array([p.rate_deg_s for p in parts])
    own = np.array([max(p.sigma_deg_s, LEAST_SIGMA_DEG_S) for p in parts])
    # Servo ripple makes a line's residuals look better than they are; motions against each other do not. So
    # the same is added to each sigma until the motions agree with one gain.
    for ripple in (0.0, *RIPPLES):
        sigmas = np.hypot(own, ripple)
        design = np.stack([commanded, np.ones_like(commanded)], axis=1) / sigmas[:, None]
        (slope, added), _, _, _ = np.linalg.lstsq(design, rates / sigmas, rcond=None)
        residuals = rates / sigmas - design @ np.array([slope, added])
        variance = float((residuals**2).sum()) / (len(parts) - 2)
        if variance <= 1.0:
            break
    covariance = max(1.0, variance) * np.linalg.inv(design.T @ design)
    return AxisResponse(
        sign=1 if slope > 0.0 else -1,
        gain=abs(float(slope)),
        gain_sigma=math.sqrt(covariance[0, 0]),
        added_deg_s=float(added),
        added_sigma_deg_s=math.sqrt(covariance[1, 1]),
        fastest_deg_s=max(abs(p.rate_deg_s) for p in parts),
        rate_limit_reached=False,
        steady=tuple(parts),
    )


def lag(motions: Sequence[Sequence[Plateau]]) -> LagFit | None:
    """Return an axis' lag from motions whose rate changed by small steps; None where it cannot be measured.

    The lines through two plateaus meet later than the mount read the new rate: by the lag, whatever the servo
    does in between.
    """
    shown = np.array([lag_s for motion in motions for lag_s in _lags_s(motion)])
    if len(shown) < FEWEST_LAGS:
        return None
    kept = shown[np.abs(shown - np.median(shown)) < STRAY_S]
    if len(kept) < FEWEST_LAGS:
        return None
    value = float(kept.mean())
    sigma = math.hypot(float(kept.std(ddof=1)) / math.sqrt(len(kept)), LEAST_LAG_SIGMA_S)
    if sigma > max(LARGEST_LAG_SIGMA_S, LARGEST_LAG_PART * abs(value)):
        return None
    return LagFit(value, sigma)


def _lags_s(motion: Sequence[Plateau]) -> list[float]:
    """Return the lag of each step; plateaus of one rate share one slope."""
    rates = sorted({p.rate_deg_s for p in motion})
    late = [p.seconds >= (1.0 - LATE_PART) * p.seconds[-1] for p in motion]
    if len(rates) < 2 or any(use.sum() < FEWEST_SAMPLES for use in late):
        return []
    rows, places = [], []
    for k, (plateau, use) in enumerate(zip(motion, late, strict=True)):
        design = np.zeros((int(use.sum()), len(motion) + len(rates)))
        design[:, k] = 1.0
        design[:, len(motion) + rates.index(plateau.rate_deg_s)] = plateau.began_s + plateau.seconds[use]
        rows.append(design)
        places.append(plateau.angle_deg[use])
    fit = np.linalg.lstsq(np.concatenate(rows), np.concatenate(places), rcond=None)[0]
    slopes = [fit[len(motion) + rates.index(p.rate_deg_s)] for p in motion]
    lags = []
    for k in range(1, len(motion)):
        change = slopes[k] - slopes[k - 1]
        if change:
            lags.append(float((fit[k - 1] - fit[k]) / change) - motion[k].began_s)
    return lags
