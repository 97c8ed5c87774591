"""Steady motion at known commanded rates: gain, sign, what is added, and the acceleration limit."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from sattrack.mount import SIDEREAL_RATE_DEG_S

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

FEWEST_SAMPLES = 8
LEAST_SIGMA_DEG_S = 1e-7
RIPPLES = tuple(1e-7 * 1.25**n for n in range(60))
FEWEST_LAGS = 4
BEFORE_S = 0.4
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

    `before_*` are statuses before it began, `seconds` and `angle_deg` those while it was commanded; time is
    ours but for a constant, `began_s` the instant at which the mount read the command, None where a status
    was lost just there.
    """

    rate_deg_s: float
    before_s: NDArray[np.float64]
    before_deg: NDArray[np.float64]
    seconds: NDArray[np.float64]
    angle_deg: NDArray[np.float64]
    began_s: float | None


@dataclass(frozen=True, slots=True)
class Steady:
    """The steady part of a stretch."""

    commanded_deg_s: float
    rate_deg_s: float
    sigma_deg_s: float
    change_deg_s: float
    """Rate less the rate before the motion began."""
    lag_s: float | None
    """From the mount's reading of the command to where the lines before and after meet."""


@dataclass(frozen=True, slots=True)
class AxisResponse:
    """How one axis answers: rate = sign x gain x commanded + added, degrees a second."""

    sign: Literal[-1, 1]
    gain: float
    gain_sigma: float
    added_deg_s: float
    added_sigma_deg_s: float
    acceleration_deg_s2: float | None
    """None where ramps are too short to be seen."""
    acceleration_sigma_deg_s2: float | None
    dead_time_s: float | None
    """Lag that does not grow with the rate."""
    steady: tuple[Steady, ...]

    @property
    def additive(self) -> bool | None:
        """Whether sidereal tracking goes on beneath MoveAxis; None where the motion fits neither reading."""
        part = self.added_deg_s / SIDEREAL_RATE_DEG_S
        if abs(part - 1.0) < ADDED_WITHIN:
            return True
        return False if abs(part) < ADDED_WITHIN else None


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
        rate, level, sigma = _line(t[use], x[use])
        late_half = t[use] >= t[use].mean()
        early, _, s1 = _line(t[use][~late_half], x[use][~late_half])
        late, _, s2 = _line(t[use][late_half], x[use][late_half])
        bend = abs(late - early)
        # What bends beyond its noise is still settling, and will go on by more than it bends.
        unsettled = max(0.0, bend - 2.0 * math.hypot(s1, s2))
        best = _with_lag(stretch, rate, level, math.hypot(sigma, GOES_ON_BY * unsettled))
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


def _with_lag(stretch: Stretch, rate: float, level: float, sigma: float) -> Steady:
    lag = None
    before_rate = 0.0
    if len(stretch.before_s) >= FEWEST_SAMPLES // 2:
        before_rate, before_level, _ = _line(stretch.before_s, stretch.before_deg)
        if stretch.began_s is not None and rate != before_rate:
            lag = (before_level - level) / (rate - before_rate) - stretch.began_s
    return Steady(stretch.rate_deg_s, rate, sigma, rate - before_rate, lag)


def axis_response(parts: Sequence[Steady]) -> AxisResponse | None:
    """Fit one axis' steady motions; None where there are too few. Rates of both directions are needed."""
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
    acceleration, acceleration_sigma, dead = _acceleration(parts)
    return AxisResponse(
        sign=1 if slope > 0.0 else -1,
        gain=abs(float(slope)),
        gain_sigma=math.sqrt(covariance[0, 0]),
        added_deg_s=float(added),
        added_sigma_deg_s=math.sqrt(covariance[1, 1]),
        acceleration_deg_s2=acceleration,
        acceleration_sigma_deg_s2=acceleration_sigma,
        dead_time_s=dead,
        steady=tuple(parts),
    )


def _acceleration(parts: Sequence[Steady]) -> tuple[float | None, float | None, float | None]:
    """Return the acceleration limit, its sigma and the dead time.

    The angle by which a motion stays behind is friction / stiffness + dead time x rate + rate^2 / (2 a).
    """
    seen = [(abs(p.change_deg_s), p.lag_s) for p in parts if p.lag_s is not None]
    change = np.array([s[0] for s in seen])
    if len(seen) < FEWEST_LAGS or change.max() < 1.5 * change.min():
        return None, None, None
    behind = change * np.array([s[1] for s in seen])
    terms = 3 if len(seen) > FEWEST_LAGS else 2
    design = np.stack([change**2, change, np.ones_like(change)][:terms], axis=1)
    fit, _, rank, _ = np.linalg.lstsq(design, behind, rcond=None)
    if rank < terms:
        return None, None, None
    residuals = behind - design @ fit
    variance = float((residuals**2).sum()) / max(1, len(seen) - terms)
    slope, sigma = float(fit[0]), math.sqrt(variance * np.linalg.inv(design.T @ design)[0, 0])
    if slope <= 0.0 or slope < 3.0 * sigma:
        return None, None, float(fit[1])
    return 0.5 / slope, 0.5 / slope * sigma / slope, float(fit[1])
