"""The rate to command: the target's mean rate over the interval in which it will act, and what is amiss.

A commanded rate is held until the next one acts, so what counts is the mean over that interval, a difference
of positions, not the instantaneous rate at sending. A servo answers late: the command is the motion that the
target makes a mean lag later, and the error is counted for when everything commanded so far has come out.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from sattrack.control.law import FeederLaw
from sattrack.control.response import TURN_S

if TYPE_CHECKING:
    from sattrack.control.kalman import AxisFilter
    from sattrack.mount.model import AxisLimits

LAW = FeederLaw()


class Way(NamedTuple):
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
    way: Way,
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
