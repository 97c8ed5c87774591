"""Motion at known commanded rates: gain, sign, rate limit and lag where it is steady, and its starts and
stops.

The servo's fit takes the starts, stops and small changes of rate of one axis.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from sattrack.calibration.servo import (
    FASTEST_SHARE,
    FEWEST_SAMPLES,
    TURNS_WEIGHT,
    Braking,
    Measured,
    Transient,
    braking,
    measured,
    turns_sigma_s,
)
from sattrack.mount.model import SIDEREAL_RATE_DEG_S

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from sattrack.calibration.calibrator import AxisName, LegHeard, Observations, StepHeard
    from sattrack.calibration.clocks import ClockLine, HeardStatus

    Array = NDArray[np.float64]
    from collections.abc import Sequence

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
    """Return the motions without the fastest, where those fall short of what the others predict."""
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
    # A drive that plans turn by turn meets the pattern of uneven turns at a few of its places only.
    uneven_s = TURNS_WEIGHT * turns_sigma_s([plateau.seconds for motion in motions for plateau in motion])
    sigma = math.hypot(float(kept.std(ddof=1)) / math.sqrt(len(kept)), LEAST_LAG_SIGMA_S, uneven_s)
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


BEFORE_S = 0.25
AFTER_S = 0.4
FEWEST_BEFORE = 3
STEADY_WITHIN = 0.01
"""Part of the rate by which an axis that is to stop may be off its steady rate."""


@dataclass(frozen=True, slots=True)
class AxisMotion:
    """How one axis starts, stops and follows; None for what could not be measured."""

    starting: Measured | None
    braking: Braking | None
    lag: LagFit | None


@dataclass(frozen=True, slots=True)
class _Log:
    """Statuses of one axis, dated by our clock."""

    heard: list[HeardStatus]
    seconds: Array
    angle_deg: Array

    def unbroken(self, place: int) -> bool:
        """Tell whether the status before this one was heard."""
        return place > 0 and self.heard[place].counter == self.heard[place - 1].counter + 1

    def between(self, first: int, end: int, begin_s: float, end_s: float) -> tuple[Array, Array]:
        """Return instants and angles within places in the log and within instants."""
        seconds = self.seconds[first:end]
        use = (seconds >= begin_s) & (seconds <= end_s)
        return seconds[use], self.angle_deg[first:end][use]


def axis_motion(
    seen: Observations, axis: AxisName, line: ClockLine, response: AxisResponse, fastest_trip_s: float
) -> AxisMotion:
    """Return how an axis starts, stops and follows; `fastest_trip_s` is that of the fastest status."""
    heard = seen.log.heard
    zero = float(line.arrival_at(heard[0].mount_s))
    log = _Log(
        heard,
        line.arrival_at(np.array([h.mount_s for h in heard])) - zero,
        np.array([h.dec_deg if axis == "dec" else h.hour_angle_deg for h in heard]),
    )
    legs = [leg for leg in seen.legs if leg.axis == axis]
    stops = [stop for leg in legs if (stop := _stop(log, leg, response, axis)) is not None]
    starts = [start for leg in legs if (start := _start(log, leg, response, axis)) is not None]
    top = max((s.rate_deg_s for s in stops), default=0.0)
    starts = [s for s in starts if s.rate_deg_s < top / FASTEST_SHARE]
    motions = [_plateaus(log, steps, zero, fastest_trip_s) for steps in seen.steps if steps[0].axis == axis]
    found = lag(motions)
    return AxisMotion(measured(starts), braking(stops, 0.0 if found is None else found.seconds), found)


def _stop(log: _Log, leg: LegHeard, response: AxisResponse, axis: AxisName) -> Transient | None:
    """Return how an axis came to rest; None where it was not steady before, or a status was lost there."""
    if not log.unbroken(leg.end):
        return None
    began_s = log.seconds[leg.end]
    t, x = log.between(leg.first, leg.end + 1, began_s - BEFORE_S, began_s)
    if len(t) < FEWEST_BEFORE:
        return None
    rate, place = (float(c) for c in np.polyfit(t - began_s, x, 1))
    foretold = response.rate_deg_s(leg.rate_deg_s)
    if abs(rate - foretold) > STEADY_WITHIN * abs(leg.rate_deg_s):
        return None
    until = log.seconds[min(leg.rested, len(log.seconds)) - 1] + AFTER_S
    t, x = log.between(leg.end, len(log.seconds), began_s, until)
    rest = _rest_rate(t, x, axis)
    way = 1.0 if rate > rest else -1.0
    t = t - began_s
    return Transient(abs(rate - rest), t, way * (x - place - rest * t))


def _start(log: _Log, leg: LegHeard, response: AxisResponse, axis: AxisName) -> Transient | None:
    """Return how far an axis stayed behind a rate; None where a status was lost there."""
    if not log.unbroken(leg.first):
        return None
    began_s = log.seconds[leg.first]
    t, x = log.between(0, leg.first + 1, began_s - BEFORE_S, began_s)
    if len(t) < FEWEST_BEFORE:
        return None
    rest = _rest_rate(t, x, axis)
    place = float((x - rest * (t - began_s)).mean())
    rate = response.rate_deg_s(leg.rate_deg_s)
    t, x = log.between(leg.first, leg.end + 1, began_s, math.inf)
    t = t - began_s
    way = 1.0 if rate > rest else -1.0
    return Transient(abs(rate - rest), t, way * (rate * t - (x - place)))


def _rest_rate(seconds: Array, angle_deg: Array, axis: AxisName) -> float:
    """Return the rate of an axis at rest: none, or that of the sky where it follows that."""
    if axis == "dec":
        return 0.0
    late = seconds >= seconds[-1] - AFTER_S
    rate = float(np.polyfit(seconds[late] - seconds[-1], angle_deg[late], 1)[0])
    return SIDEREAL_RATE_DEG_S if rate > 0.5 * SIDEREAL_RATE_DEG_S else 0.0


def _plateaus(log: _Log, steps: list[StepHeard], zero_utc_s: float, fastest_trip_s: float) -> list[Plateau]:
    """Return the stretches of one rate each; an empty list where a status was lost at a change."""
    firsts = [_first_of(log, step, zero_utc_s, fastest_trip_s) for step in steps]
    plateaus = []
    for k, (step, first) in enumerate(zip(steps, firsts, strict=True)):
        if first is None:
            return []
        following = firsts[k + 1] if k + 1 < len(firsts) else None
        end = step.end if following is None else following + 1
        began_s = float(log.seconds[first])
        plateaus.append(
            Plateau(step.rate_deg_s, began_s, log.seconds[first:end] - began_s, log.angle_deg[first:end])
        )
    return plateaus


def _first_of(log: _Log, step: StepHeard, zero_utc_s: float, fastest_trip_s: float) -> int | None:
    """Return the place of the status in whose turn the mount read a rate; None where that was lost."""
    first = step.first
    if first is None:
        seen_s = step.sent_utc_s + fastest_trip_s - zero_utc_s
        first = int(np.searchsorted(log.seconds, seen_s))
    return first if first < len(log.seconds) and log.unbroken(first) else None
