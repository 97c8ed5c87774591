"""A run's log cut into starts, stops and small changes of rate of one axis."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sattrack.calibration.motion import AxisName, AxisResponse, LagFit, Plateau, lag
from sattrack.calibration.servo import FASTEST_SHARE, Braking, Measured, Transient, braking, measured
from sattrack.mount.model import SIDEREAL_RATE_DEG_S

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from sattrack.calibration.clocks import ClockLine
    from sattrack.calibration.script import LegHeard, Observations, StepHeard
    from sattrack.calibration.statuses import HeardStatus

    Array = NDArray[np.float64]

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
    return AxisMotion(measured(starts), braking(stops), lag(motions))


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
