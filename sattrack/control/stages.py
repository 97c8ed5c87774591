"""What a run does at each status: acquiring, held, paused, on its way back, or following. Pure."""

from __future__ import annotations

from enum import IntEnum
from typing import TYPE_CHECKING, NamedTuple

from sattrack.mount.model import SIDEREAL_RATE_DEG_S

if TYPE_CHECKING:
    from sattrack.control.target import TargetState
    from sattrack.control.tracker import TrackPlan
    from sattrack.mount.model import MountProfile

KEYHOLE, RATE = "keyhole", "rate"
POLE_WITHIN_DEG = 15.0
"""A target that is too fast and so near the celestial pole is in the keyhole."""
LONGEST_STEP_S = 0.5
"""Rates of the target that lie farther apart tell of no acceleration."""


class RunStage(IntEnum):
    """What a run did at a status; only FOLLOWING counts in the figures of the error."""

    OTHER = 0
    """It waited, slewed or stopped."""
    ACQUIRING = 1
    """It followed, and had never been on target yet."""
    HELD = 2
    """A limit kept it from following: one of place, or the target was faster than an axis can turn."""
    PAUSED = 3
    REJOINING = 4
    """It was on its way back to the target, after a pause or a limit."""
    FOLLOWING = 5


class Situation(NamedTuple):
    """What is known of a run at a status; `holding` names the limit of place that holds the mount."""

    following: bool
    tracking: bool
    paused: bool
    acquired: bool
    ended: bool
    holding: str | None
    error_arcsec: float


class Stages:
    """Tells of one status after the other what the run does, and which limit it is held by."""

    def __init__(self, plan: TrackPlan, profile: MountProfile) -> None:
        """Begin before the first status."""
        self._on_target_arcsec = plan.on_target_arcsec
        self._too_fast = _TooFast(plan, profile)
        self._rejoining = False

    def take(self, now: Situation, utc_s: float, target: TargetState) -> tuple[RunStage, str]:
        """Return what the run does, and the limit's name, empty for none."""
        beyond = self._too_fast.limit(utc_s, target)
        if now.paused:
            self._rejoining = now.acquired
            return RunStage.PAUSED, ""
        if now.following and now.holding is not None:
            self._rejoining = now.acquired
            return RunStage.HELD, now.holding
        off = now.error_arcsec > self._on_target_arcsec
        if self._rejoining and now.tracking:
            self._rejoining = off
        if now.following and now.acquired and beyond is not None and off:
            self._rejoining = True
            return RunStage.HELD, beyond
        if self._rejoining and not now.ended:
            return RunStage.REJOINING, ""
        if not now.following:
            return RunStage.OTHER, ""
        return (RunStage.FOLLOWING if now.acquired else RunStage.ACQUIRING), ""


class _TooFast:
    """Where the target turns an axis, or changes its rate, faster than the mount can."""

    def __init__(self, plan: TrackPlan, profile: MountProfile) -> None:
        self._detours, self._axes = plan.detours, (profile.ra, profile.dec)
        self._before: tuple[float, tuple[float, float]] | None = None

    def limit(self, utc_s: float, target: TargetState) -> str | None:
        """Return the limit's name; None where the mount is fast enough."""
        rates = SIDEREAL_RATE_DEG_S - target.ra_rate_deg_s, target.dec_rate_deg_s
        before, self._before = self._before, (utc_s, rates)
        if any(one.begin_utc_s <= utc_s <= one.end_utc_s for one in self._detours):
            return KEYHOLE
        fast = any(abs(rate) > axis.max_rate_deg_s for rate, axis in zip(rates, self._axes, strict=True))
        if before is not None and 0.0 < utc_s - before[0] < LONGEST_STEP_S:
            fast |= any(
                abs(rate - was) > axis.max_acceleration_deg_s2 * (utc_s - before[0])
                for rate, was, axis in zip(rates, before[1], self._axes, strict=True)
            )
        if not fast:
            return None
        return KEYHOLE if abs(abs(target.dec_deg) - 90.0) < POLE_WITHIN_DEG else RATE
