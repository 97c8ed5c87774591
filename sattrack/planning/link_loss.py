"""How long a mount may hold its last rates, once its link is cut, before it meets a limit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from sattrack.planning.limits import margins_deg
from sattrack.planning.path import Pointing

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from sattrack.mount.model import MountProfile
    from sattrack.planning.path import AxisPath
    from sattrack.planning.trace import TraceArrays
    from sattrack.safety.limits import SafetyLimits

    Array = NDArray[np.float64]

LOOK_STEP_S, SOON_S, LATER_STEP_S = 0.25, 30.0, 2.0
"""What lies ahead is looked at in short steps at first, and in longer ones later."""
LATER_S, LOOKED_S = 240.0, 900.0
MOMENTS = 400


class HeldWay(NamedTuple):
    """How the axes stand and turn at instants, degrees and degrees a second, shape (n,)."""

    pointing: Pointing
    hour_angle_rate_deg_s: Array
    dec_rate_deg_s: Array


def way_of(path: AxisPath, trace: TraceArrays | None) -> HeldWay:
    """Return how the mount went in a rehearsed run; as the target goes if there is none or it failed."""
    p = path.pointing
    rows = np.zeros(0, dtype=bool) if trace is None else trace.moving
    if trace is None or not rows.any():
        return HeldWay(p, path.hour_angle_rate_deg_s, path.dec_rate_deg_s)
    utc_s = trace.utc_s[rows]
    bodies = (p.sun_hour_angle_deg, p.sun_dec_deg, p.moon_hour_angle_deg, p.moon_dec_deg)
    turned = (np.degrees(np.unwrap(np.radians(column))) for column in bodies)
    there = (np.interp(utc_s, p.utc_s, column) for column in turned)
    pointing = Pointing(utc_s, trace.hour_angle_axis_deg[rows], trace.dec_axis_deg[rows], *there)
    return HeldWay(pointing, trace.hour_angle_rate_deg_s[rows], trace.dec_rate_deg_s[rows])


@dataclass(frozen=True, slots=True)
class LinkLoss:
    """For moments of a pass, how long after a cut of the link the first limit is met, and which; shape (n,).

    `seconds` is infinite where none is met within `LOOKED_S`. With a watchdog in the mount, `rests_s` is when
    the axes are at rest, and `rests_inside` whether that is before the limit; both None without one.
    """

    utc_s: Array
    seconds: Array
    limits: list[str | None]
    rests_s: Array | None
    rests_inside: NDArray[np.bool_] | None

    @property
    def worst(self) -> int:
        """Index of the moment with the least time."""
        return int(np.argmin(self.seconds))


def link_loss(way: HeldWay, profile: MountProfile, limits: SafetyLimits, latitude_deg: float) -> LinkLoss:
    """Return what a cut at moments spread over a way comes to if both axes hold their rates from then on.

    Rates beyond what the axes can do count as their limits. The way must hold no NaN.
    """
    p = way.pointing
    count = len(p.utc_s)
    chosen = np.unique(np.linspace(0, count - 1, min(count, MOMENTS)).astype(int))
    ha_rate = _within(way.hour_angle_rate_deg_s[chosen], profile.ra.max_rate_deg_s)
    dec_rate = _within(way.dec_rate_deg_s[chosen], profile.dec.max_rate_deg_s)
    seconds = np.full(len(chosen), np.inf)
    names: list[str | None] = [None] * len(chosen)
    for k, i in enumerate(chosen.tolist()):
        for ahead in STRETCHES_S:
            held = Pointing(
                p.utc_s[i] + ahead,
                p.hour_angle_axis_deg[i] + ha_rate[k] * ahead,
                p.dec_axis_deg[i] + dec_rate[k] * ahead,
                p.sun_hour_angle_deg[i] + SUN_RATE_DEG_S * ahead,
                p.sun_dec_deg[i],
                p.moon_hour_angle_deg[i] + SUN_RATE_DEG_S * ahead,
                p.moon_dec_deg[i],
            )
            for name, margin in margins_deg(held, profile, limits, latitude_deg).items():
                at = _first_below_zero(margin, ahead)
                if at < seconds[k]:
                    seconds[k], names[k] = at, name
            if names[k] is not None:
                break
    rests = inside = None
    if profile.watchdog_s is not None:
        ha_braking, dec_braking = profile.braking_deg_s2
        braking = np.maximum(np.abs(ha_rate) / ha_braking, np.abs(dec_rate) / dec_braking)
        braking += max(profile.ra.lag_s, profile.dec.lag_s)
        rests = profile.watchdog_s + profile.period_s + braking
        inside = rests < seconds
    return LinkLoss(p.utc_s[chosen], seconds, names, rests, inside)


SUN_RATE_DEG_S = 360.0 / 86400.0
STRETCHES_S = (
    np.append(np.arange(0.0, SOON_S, LOOK_STEP_S), SOON_S),
    np.arange(SOON_S, LATER_S + LATER_STEP_S, LATER_STEP_S),
    np.arange(LATER_S, LOOKED_S + LATER_STEP_S, LATER_STEP_S),
)
"""Most limits are met in the first two; each begins with the end of the one before."""


def _within(rates: Array, limit: float) -> Array:
    return np.clip(rates, -limit, limit)


def _first_below_zero(margin: Array, ahead_s: Array) -> float:
    """Return the seconds after which a margin, seen at some, falls below 0; infinity if never."""
    below = np.flatnonzero(margin < 0.0)
    if not len(below):
        return float("inf")
    i = int(below[0])
    if i == 0:
        return 0.0
    share = float(margin[i - 1] / (margin[i - 1] - margin[i]))
    return float(ahead_s[i - 1] + share * (ahead_s[i] - ahead_s[i - 1]))
