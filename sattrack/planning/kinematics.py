"""What a pass loses to a mount's limits by kinematics alone: for lists of passes and choices of side."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sattrack.planning.keyhole import find_keyholes
from sattrack.planning.limits import margins_deg

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from sattrack.mount import MountProfile
    from sattrack.planning.keyhole import Keyhole
    from sattrack.planning.path import AxisPath
    from sattrack.safety.limits import SafetyLimits

    Array = NDArray[np.float64]
    Bools = NDArray[np.bool_]

LEAST_SHARE = 0.9
"""Share of a pass that must be followed for a "go"."""


@dataclass(frozen=True, slots=True)
class Ability:
    """What is followed with: the mount, the site's limits and latitude, and how near counts as on target."""

    profile: MountProfile
    limits: SafetyLimits
    latitude_deg: float
    tolerance_deg: float
    detours: bool = False
    """Whether what follows takes the best way past the pole, and does not clip."""


@dataclass(frozen=True, slots=True)
class Loss:
    """A stretch that is lost: POSIX seconds of UTC, the limit's name, what is asked against what can be."""

    begin_utc_s: float
    end_utc_s: float
    limit: str
    words: str

    @property
    def seconds(self) -> float:
        """How long it is."""
        return self.end_utc_s - self.begin_utc_s


def losses(path: AxisPath, ability: Ability, keyholes: list[Keyhole] | None = None) -> list[Loss]:
    """Return what of a path cannot be followed, in order, not overlapping.

    An interlock that stops the mount loses all that comes after it. The path must hold no NaN; where its
    keyholes are known already they need not be searched.
    """
    found: list[Loss] = []
    stop = first_stop(path, ability)
    end_utc_s = float(path.utc_s[-1]) if stop is None else stop.begin_utc_s
    for loss in _too_fast(path, ability, keyholes):
        if loss.begin_utc_s < end_utc_s:
            found.append(Loss(loss.begin_utc_s, min(loss.end_utc_s, end_utc_s), loss.limit, loss.words))
    if stop is not None:
        found.append(stop)
    return found


def first_stop(path: AxisPath, ability: Ability) -> Loss | None:
    """Return the first limit of place that the path runs into, with all that comes after it; None if none."""
    first: Loss | None = None
    margins = margins_deg(path.pointing, ability.profile, ability.limits, ability.latitude_deg)
    for name, margin in margins.items():
        outside = np.flatnonzero(margin < 0.0)
        if not len(outside):
            continue
        at = float(path.utc_s[outside[0]])
        if first is None or at < first.begin_utc_s:
            worst = float(np.min(margin))
            first = Loss(at, float(path.utc_s[-1]), name, f"it would go {-worst:.1f}° past the limit")
    return first


def _too_fast(path: AxisPath, ability: Ability, keyholes: list[Keyhole] | None) -> list[Loss]:
    profile = ability.profile
    if keyholes is None:
        keyholes = find_keyholes(path, profile, ability.tolerance_deg)
    begin_utc_s, end_utc_s = float(path.utc_s[0]), float(path.utc_s[-1])
    found = [
        Loss(
            *_lost_span(k, ability.detours),
            "keyhole",
            f"{k.polar_distance_deg:.2f}° from the pole the hour angle turns {k.peak_rate_deg_s:.0f} °/s "
            f"of {profile.ra.max_rate_deg_s:g} °/s",
        )
        for k in keyholes
        if begin_utc_s <= k.begin_utc_s < end_utc_s
    ]
    cos_dec = np.abs(np.cos(np.radians(path.pointing.dec_axis_deg)))
    axes = (
        ("hour angle", path.pointing.hour_angle_axis_deg, path.hour_angle_rate_deg_s, profile.ra, cos_dec),
        (
            "declination",
            path.pointing.dec_axis_deg,
            path.dec_rate_deg_s,
            profile.dec,
            np.ones_like(cos_dec),
        ),
    )
    for axis, place, rate, can, scale in axes:
        peak = float(np.max(np.abs(rate)))
        if peak <= can.max_rate_deg_s:
            continue
        behind = np.abs(_follow(place, path.utc_s, can.max_rate_deg_s) - place) * scale
        for first, last in _stretches(behind > ability.tolerance_deg):
            begin, end = float(path.utc_s[first]), float(path.utc_s[last])
            if any(begin < loss.end_utc_s and end > loss.begin_utc_s for loss in found):
                continue
            words = (
                f"{axis} turns {np.max(np.abs(rate[first : last + 1])):.2f} °/s of {can.max_rate_deg_s:g} °/s"
            )
            found.append(Loss(begin, end, "rate", words))
    return sorted(found, key=lambda loss: loss.begin_utc_s)


def _lost_span(keyhole: Keyhole, detours: bool) -> tuple[float, float]:
    """Return from when to when a keyhole is lost, POSIX seconds."""
    if detours and keyhole.detour is not None:
        return keyhole.detour.begin_utc_s, keyhole.detour.end_utc_s
    return keyhole.begin_utc_s, keyhole.begin_utc_s + keyhole.clipped_s


def _follow(place: Array, utc_s: Array, limit_deg_s: float) -> Array:
    """Return where an axis is that follows as fast as it can."""
    at = place.copy()
    most = (np.diff(utc_s) * limit_deg_s).tolist()
    here = float(place[0])
    for i, there in enumerate(place[1:].tolist()):
        here += max(-most[i], min(most[i], there - here))
        at[i + 1] = here
    return at


def _stretches(mask: Bools) -> list[tuple[int, int]]:
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return [(int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def why_not(path: AxisPath, ability: Ability) -> str | None:
    """Return in words what keeps the mount from following enough of a path; None where it can."""
    lost = losses(path, ability)
    whole_s = float(path.utc_s[-1] - path.utc_s[0])
    lost_s = sum(loss.seconds for loss in lost)
    if lost_s <= (1.0 - LEAST_SHARE) * whole_s:
        return None
    worst = max(lost, key=lambda loss: loss.seconds)
    return f"{worst.limit}: {worst.words}; {lost_s:.0f} s of {whole_s:.0f} s lost"
