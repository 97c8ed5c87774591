"""The rate to command: the target's mean rate over the interval in which it will act, and what is amiss.

A commanded rate is held until the next one acts, so what counts is the mean over that interval, a difference
of positions, not the instantaneous rate at sending.
"""

from __future__ import annotations

import math

from sattrack.control.law import FeederLaw

LAW = FeederLaw()


def correction_deg_s(
    error_deg: float, acceleration_deg_s2: float, limit_deg_s: float, law: FeederLaw = LAW
) -> float:
    """Return the rate that takes an error out, against its sign.

    Small errors decay with the law's time constant; large ones are closed along the curve from which a share
    of the axis' acceleration can still brake, and never faster than `limit_deg_s`.
    """
    size = abs(error_deg)
    braking = math.sqrt(2.0 * law.braking_share * acceleration_deg_s2 * size)
    closing = min(size / law.settling_s, braking, limit_deg_s)
    return -math.copysign(closing, error_deg)


def rate_deg_s(
    target_move_deg: float,
    interval_s: float,
    disturbance_deg_s: float,
    error_deg: float,
    acceleration_deg_s2: float,
    limit_deg_s: float,
    law: FeederLaw = LAW,
) -> float:
    """Return the rate to command over the acting interval.

    `target_move_deg` is how far the target goes in that interval, `error_deg` how far the axis will be ahead
    of it at the interval's start, `disturbance_deg_s` the rate that the axis has of its own.
    """
    feed_forward = target_move_deg / interval_s
    correction = correction_deg_s(error_deg, acceleration_deg_s2, limit_deg_s, law)
    return feed_forward - disturbance_deg_s + correction
