"""The rate to command: the target's mean rate over the interval in which it will act, and what is amiss.

A commanded rate is held until the next one acts, so what counts is the mean over that interval, a difference
of positions, not the instantaneous rate at sending. A servo answers late: the command is the motion that the
target makes a mean lag later, and the error is counted for when everything commanded so far has come out.

What a run learns of a mount while it follows: the lag and the gain of each axis, and how surely.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from sattrack.control.law import FeederLaw
from sattrack.control.response import TURN_S
from sattrack.core.angles import wrap180

if TYPE_CHECKING:
    from sattrack.control.axes import Axes
    from sattrack.control.kalman import AxisFilter
    from sattrack.mount.model import AxisLimits, StatusSample

REST_DEG_S = 3.0 / 3600.0
"""How fast an axis may move beside its commands, one sigma."""
FREE_REST_DEG_S = 60.0 / 3600.0
"""That where nothing is presumed of it."""
LEAST_NOISE_DEG_S = 0.5 / 3600.0
LEAST_RATE_DEG_S = 0.01
"""Slower commands, in the mean, tell nothing of a gain."""
ALIKE_SAMPLES = 40.0
"""Residuals of so many samples in a row count as one: a servo's error lasts."""
LEAST_SAMPLES = 100


class RateLine(NamedTuple):
    """What comes of a commanded rate, divided by it, and what is left, degrees a second; one sigma each."""

    gain: float
    gain_sigma: float
    rest_deg_s: float
    rest_sigma_deg_s: float


class RateFit:
    """A line through the rates seen against those commanded, of one axis.

    While the rate hardly changes, the filter shares a wrong gain out between its gain and its rate
    disturbance. Here both are found from all of a pass.
    """

    def __init__(self) -> None:
        self.samples = 0
        self.fastest_deg_s = self.fastest_told_deg_s = 0.0
        """The fastest rates that were seen and commanded, whichever way."""
        self._sums = [0.0, 0.0, 0.0, 0.0, 0.0]

    def take(self, commanded_deg_s: float, seen_deg_s: float) -> None:
        """Take the mean rates between two samples; the commanded one as the servo answers it."""
        self.samples += 1
        c, m = commanded_deg_s, seen_deg_s
        self.fastest_told_deg_s = max(self.fastest_told_deg_s, abs(c))
        self.fastest_deg_s = max(self.fastest_deg_s, abs(m))
        for place, value in enumerate((c, m, c * c, c * m, m * m)):
            self._sums[place] += value

    @property
    def ratio(self) -> float | None:
        """What came of the commanded rates, over them; None where nearly none were commanded."""
        _, _, cc, cm, _ = self._sums
        small = cc <= self.samples * LEAST_RATE_DEG_S**2
        return None if self.samples < LEAST_SAMPLES or small else cm / cc

    def line(self, rest_deg_s: float = REST_DEG_S) -> RateLine | None:
        """Return the line; None before there are samples enough.

        `rest_deg_s` is how fast the axis may move beside its commands, one sigma.
        """
        n, (c, m, cc, cm, mm) = self.samples, self._sums
        if n < LEAST_SAMPLES or cc == 0.0:
            return None
        variance = LEAST_NOISE_DEG_S**2
        gain = rest = determinant = known = 0.0
        for _ in range(3):
            known = n + variance * ALIKE_SAMPLES / rest_deg_s**2
            determinant = cc * known - c * c
            gain = (cm * known - c * m) / determinant
            rest = (cc * m - c * cm) / determinant
            left = mm - 2.0 * (gain * cm + rest * m) + gain * (gain * cc + 2.0 * rest * c) + n * rest * rest
            variance = max(left / n, LEAST_NOISE_DEG_S**2)
        scale = ALIKE_SAMPLES * variance / determinant
        return RateLine(gain, math.sqrt(scale * known), rest, math.sqrt(scale * cc))


class Learnt(NamedTuple):
    """What is known of one axis; its lag is beyond the command delay and the mount's turn, seconds."""

    lag_s: float
    lag_sigma_s: float
    line: RateLine | None
    """The gain over the profile's; None before it is known."""


class Learning:
    """Follows the axes' filters through a run."""

    def __init__(self) -> None:
        self.axes: Axes | None = None
        """The filters as of the last sample that was followed with; None before."""
        self.restarts = 0
        """How often filters began anew although they were followed with."""
        self.fits = RateFit(), RateFit()
        """Of right ascension and declination, since the mount was first on target, or before it was."""
        self._before: tuple[float, float, float] | None = None

    def anew(self) -> None:
        """Note that the filters contradict what is seen and must begin anew."""
        self.restarts += 1

    @property
    def times_begun_anew(self) -> int:
        """How often the filters began anew, of themselves or replaced."""
        return self.restarts + self._begun_anew

    @property
    def _begun_anew(self) -> int:
        return 0 if self.axes is None else self.axes.ra.begun_anew + self.axes.dec.begun_anew

    def forget_rates(self) -> None:
        """Fit the rates from now on: what the way onto the target made of them is not the servo's."""
        self.fits, self._before = (RateFit(), RateFit()), None

    def take(self, axes: Axes, sample: StatusSample, utc_s: float) -> None:
        """Take a sample that was followed with and believed."""
        self.axes = axes
        before, self._before = self._before, (utc_s, sample.ra_deg, sample.dec_deg)
        if before is None or not axes.turned_over_s:
            return
        seconds = utc_s - before[0]
        if abs(seconds - axes.turned_over_s) > 1e-6:
            return
        seen = wrap180(sample.ra_deg - before[1]), sample.dec_deg - before[2]
        parts = zip(self.fits, (axes.ra, axes.dec), axes.foretold_deg, seen, strict=True)
        for fit, axis, moved, came in parts:
            fit.take(moved / (1.0 + axis.gain_error) / seconds, came / seconds)

    def pause(self) -> None:
        """Note that the mount does not move by commands."""
        self._before = None

    def learnt(self) -> tuple[Learnt, Learnt] | None:
        """Return what is known of right ascension and declination; None before following began."""
        if self.axes is None:
            return None
        ra, dec = (
            Learnt(axis.lag.mean_s, axis.lag_sigma_s, fit.line())
            for axis, fit in zip((self.axes.ra, self.axes.dec), self.fits, strict=True)
        )
        return ra, dec

    def settling_s(self, interval_s: float, law: FeederLaw) -> float | None:
        """Return the time constant in force, of the slower axis; None before following began."""
        if self.axes is None:
            return None
        axes = (self.axes.ra, self.axes.dec)
        return max(settling_s(interval_s, axis.lag.mean_s, axis.lag_sigma_s, law) for axis in axes)


LAW = FeederLaw()


class AxisPath(NamedTuple):
    """One axis' target over the interval in which a command acts, seen `ahead_s` after the interval.

    Degrees, seconds; `move_deg` is how far it goes in the interval.
    """

    begin_deg: float
    move_deg: float
    interval_s: float
    acceleration_deg_s2: float
    ahead_s: float


def correction_deg_s(
    error_deg: float,
    acceleration_deg_s2: float,
    limit_deg_s: float,
    settling_s: float,
    law: FeederLaw = LAW,
) -> float:
    """Return the rate that takes an error out, against its sign.

    Small errors decay with a time constant; large ones are closed along the curve from which a share of the
    axis' acceleration can still brake, and never faster than `limit_deg_s`.
    """
    size = abs(error_deg)
    braking = math.sqrt(2.0 * law.braking_share * acceleration_deg_s2 * size)
    closing = min(size / settling_s, braking, limit_deg_s)
    return -math.copysign(closing, error_deg)


def settling_s(interval_s: float, lag_s: float, lag_sigma_s: float, law: FeederLaw = LAW) -> float:
    """Return the time constant with which a small error may be taken out.

    A correction acts for a whole interval, and its effect is known only as well as the lag: a faster one
    would be overdone.
    """
    unsure_s = law.intervals * interval_s + law.lag_sigmas * lag_sigma_s
    return max(law.settling_s, law.lags * lag_s, unsure_s)


def rate_deg_s(
    way: AxisPath,
    bound_for_deg: float,
    axis: AxisFilter,
    limits: AxisLimits,
    limit_deg_s: float,
    law: FeederLaw = LAW,
) -> float:
    """Return the rate to command over the acting interval.

    `bound_for_deg` is where what was commanded so far leads the axis, a mean lag after the interval begins.
    """
    late_s = axis.lag.mean_s - way.ahead_s
    rate, bend = way.move_deg / way.interval_s, way.acceleration_deg_s2
    wanted_deg = way.begin_deg + rate * late_s + 0.5 * bend * late_s * (late_s - way.interval_s)
    # A servo that answers over a while cuts the corners of a bent way, and so does a rate that acts for
    # several turns of the mount's loop: the mean error of those turns is made up for.
    chord_s2 = max(0.0, way.interval_s * way.interval_s - TURN_S * TURN_S) / 12.0
    wanted_deg -= (0.5 * axis.lag.variance_s2 + chord_s2) * bend
    takes_s = settling_s(way.interval_s, axis.lag.mean_s, axis.lag_sigma_s, law)
    error_deg = bound_for_deg - wanted_deg
    correction = correction_deg_s(error_deg, limits.max_acceleration_deg_s2, limit_deg_s, takes_s, law)
    asked = rate + bend * late_s - axis.disturbance_deg_s + correction
    return float(asked / (1.0 + axis.gain_error))


def ramped_deg_s(
    wanted_deg_s: float, before_deg_s: float, limits: AxisLimits, interval_s: float, law: FeederLaw = LAW
) -> float:
    """Return a rate that is no further from the one before than a share of the acceleration allows."""
    most = law.ramp_share * limits.max_acceleration_deg_s2 * interval_s
    return max(before_deg_s - most, min(before_deg_s + most, wanted_deg_s))
