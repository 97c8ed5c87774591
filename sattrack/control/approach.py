"""How to get onto a moving target: by rates or by a slew, where to wait for it, and when to begin.

Slews are judged by where they end, tried again, and given up.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum
from functools import partial
from typing import TYPE_CHECKING

import msgspec

from sattrack.core.angles import wrap180
from sattrack.mount.model import Motion, MoveAxes, Slew
from sattrack.safety.slews import THERE_DEG

if TYPE_CHECKING:
    from collections.abc import Callable

    from sattrack.control.following import FeederLaw
    from sattrack.control.target import TargetState
    from sattrack.mount.model import AxisLimits, MountProfile
    from tle.direction import Direction

MARGIN_S = 1.5
"""Time that a plan made long beforehand keeps for a slew's handshake, its settling and the joining."""
HANDSHAKE_S = 0.6
"""Time kept for the handshake of a slew, and for what the estimate of its length leaves out."""
LET_GO_S = 0.3
"""What it takes to end MoveAxis and see the mount stand, before it can slew."""
SETTLES_S = 1.0
"""What a slew by an unknown mount takes beyond its estimate, until it counts as over."""
RATES_WITHIN_DEG = 20.0
"""How far off rates are taken at all: they go straight on, where slews are led round what is in the way."""
ROUNDS = 8

Axes = tuple[float, float]
"""Hour angle within half a turn of the meridian, and declination, degrees: how the axes stand."""
Target = tuple[float, float, float]
"""Right ascension, declination, and the hour angle that the mount would take there, degrees."""


@dataclass(frozen=True, slots=True)
class Intercept:
    """The target comes through this direction at this instant; reached from now on by rates, or by a slew."""

    utc_s: float
    ra_deg: float
    dec_deg: float
    by_rates: bool = False


def slew_time_s(distance_deg: float, axis: AxisLimits) -> float:
    """Return how long an axis takes from rest to rest over a distance, within its rate and acceleration."""
    distance = abs(distance_deg)
    # The mount brakes with half of its acceleration, so the ramps take 1.5 times as long as the formula's.
    ramp_s = 1.5 * axis.slew_rate_deg_s / axis.max_acceleration_deg_s2
    if distance < axis.slew_rate_deg_s * ramp_s:
        return 2.0 * math.sqrt(1.5 * distance / axis.max_acceleration_deg_s2)
    return distance / axis.slew_rate_deg_s + ramp_s


def chase_time_s(distance_deg: float, axis: AxisLimits, law: FeederLaw) -> float:
    """Return how long rates take to close a distance, by the feeder's law, until next to nothing is left."""
    distance, top, acceleration = abs(distance_deg), axis.max_rate_deg_s, axis.max_acceleration_deg_s2
    if not distance:
        return 0.0
    starting, braking = law.ramp_share * acceleration, law.braking_share * acceleration
    peak = min(top, math.sqrt(2.0 * distance * starting * braking / (starting + braking)))
    ramps_deg = 0.5 * peak * peak * (1.0 / starting + 1.0 / braking)
    return peak / starting + peak / braking + max(0.0, distance - ramps_deg) / top + 5.0 * law.settling_s


def plan_intercept(
    now_utc_s: float,
    not_before_utc_s: float,
    mount: Axes,
    target_at: Callable[[float], Target],
    profile: MountProfile,
    law: FeederLaw | None = None,
    moving: bool = False,
) -> Intercept:
    """Return the earliest point of the target's path that the mount can be on it.

    `target_at` gives the target at an instant. The time of the way depends on where it ends, and that on the
    time, so the two are brought together by iteration. The hour angle turns within half a turn either way of
    the meridian, so the way from one side of the lower meridian to the other is the long one. `moving` where
    the mount is in MoveAxis, which has to end before a slew. Rates by the feeder's law, where one is given,
    are chosen for a target that is there already, and that a slew would not reach much sooner.
    """
    before_s = HANDSHAKE_S + (LET_GO_S if moving else 0.0)
    slew = _meet(now_utc_s, not_before_utc_s, mount, target_at, (profile, slew_time_s, before_s))
    if slew.utc_s <= not_before_utc_s or law is None:
        return slew
    chase = partial(chase_time_s, law=law)
    rates = _meet(now_utc_s, not_before_utc_s, mount, target_at, (profile, chase, 0.0))
    _, dec, hour_angle = target_at(now_utc_s)
    far = max(abs(hour_angle - mount[0]), abs(dec - mount[1])) > RATES_WITHIN_DEG
    if far or rates.utc_s > slew.utc_s + SETTLES_S:
        return slew
    return Intercept(rates.utc_s, rates.ra_deg, rates.dec_deg, by_rates=True)


def _meet(
    now_utc_s: float,
    not_before_utc_s: float,
    mount: Axes,
    target_at: Callable[[float], Target],
    way: tuple[MountProfile, Callable[[float, AxisLimits], float], float],
) -> Intercept:
    profile, time_s, before_s = way
    join = not_before_utc_s
    for _ in range(ROUNDS):
        _, dec, hour_angle = target_at(join)
        travel = max(time_s(hour_angle - mount[0], profile.ra), time_s(dec - mount[1], profile.dec))
        join = max(not_before_utc_s, now_utc_s + travel + before_s)
    ra, dec, _ = target_at(join)
    return Intercept(join, ra, dec)


SLEWS_TRIED = 3
STANDS_FOR_S, STANDS_WITHIN_DEG = 0.25, 0.02
PATIENCE_S, PATIENCE_TIMES = 30.0, 3.0
"""A slew may take this, and so many times what its length asks for: it may go round what is in the way."""
FAR_DEG = 5.0
"""An error on the sky from which on a slew ahead may be worth more than going on with rates."""
FAR_FOR_S, FAR_AND_HELD_FOR_S = 0.5, 5.0
"""How long it must be so. What holds a mount may be over sooner than the slew round it, of some seconds."""
REFUSED_FOR_S = 2.0
"""Not sooner after a slew for which there was no way at all another one is asked for."""
AGAIN_SHARE, LEAST_AGAIN_S, MOST_AGAIN_S = 0.5, 0.5, 20.0
"""After a slew that a limit cut short, the next is asked for when the target has gone so much of what is
missing: sooner, it would hardly lead any nearer."""


class ApproachStep(Enum):
    """The next step of the approach."""

    SLEW = "slew to the intercept, or wait there"
    FOLLOW = "follow by rates"
    PLAN = "plan anew"
    GIVE_UP = "give up"


class MountPlace(msgspec.Struct, frozen=True, gc=False):
    """How the mount stands: its sidereal time, right ascension and declination as reported, degrees."""

    sidereal_deg: float
    ra_deg: float
    dec_deg: float
    beyond_pole: bool = False


class Approach:
    """Plans ways to one target, and judges how they go. `trouble` says in words why it was given up."""

    def __init__(
        self, profile: MountProfile, target_at: Callable[[float], Direction | TargetState], law: FeederLaw
    ) -> None:
        self._profile = profile
        self._law = law
        self._target_at = target_at
        self._failed = 0
        self._overdue_utc_s = 0.0
        self._far_since_utc_s: float | None = None
        self._not_before_utc_s = 0.0
        self._not_again_before_utc_s = -math.inf
        self.intercept = Intercept(0.0, 0.0, 0.0)
        self._sent: Slew | None = None
        self._came = False
        """Whether the mount was seen away from the goal since the slew was planned."""
        self._stood: tuple[float, float, float] | None = None
        """Since when and where the mount stands at the goal."""
        self._refused = False
        self.trouble: str | None = None

    def plan(
        self,
        now_utc_s: float,
        not_before_utc_s: float,
        stand: MountPlace,
        moving: bool = False,
        held: bool = False,
    ) -> ApproachStep:
        """Choose the way from where the mount stands.

        `moving` where it is in MoveAxis, `held` where a limit is in the way of rates.
        """
        intercept = self._plan(now_utc_s, not_before_utc_s, stand, moving, held)
        self.intercept = intercept
        self._not_before_utc_s = not_before_utc_s
        self._far_since_utc_s = None
        self._refused = False
        self._came, self._stood = False, None
        takes_s = self._slew_s(stand, intercept)
        self._overdue_utc_s = now_utc_s + PATIENCE_TIMES * takes_s + PATIENCE_S
        return ApproachStep.FOLLOW if intercept.by_rates else ApproachStep.SLEW

    def go_on(self, now_utc_s: float, slew_done: bool, stand: MountPlace) -> ApproachStep:
        """Judge a slew that was asked for; `slew_done` where the mount says that it is over."""
        goal, sent = self.intercept, self._sent
        slew_done = slew_done or (goal.utc_s > self._not_before_utc_s and self._stands(now_utc_s, stand))
        if self._refused:
            self._not_again_before_utc_s = now_utc_s + REFUSED_FOR_S
            return ApproachStep.FOLLOW
        if not slew_done or sent is None:
            return (
                self._fail("did not finish it in time")
                if now_utc_s > self._overdue_utc_s
                else ApproachStep.SLEW
            )
        off_deg = _apart_deg(stand.ra_deg, stand.dec_deg, sent.ra_deg, sent.dec_deg)
        if off_deg > THERE_DEG:
            return self._fail(f"stands {off_deg:.1f}° from its goal")
        self._failed = 0
        missing_deg = _apart_deg(goal.ra_deg, goal.dec_deg, sent.ra_deg, sent.dec_deg)
        cut_short = missing_deg > THERE_DEG
        if cut_short:
            self._not_again_before_utc_s = now_utc_s + self._in_vain_s(goal, missing_deg)
        if goal.utc_s <= self._not_before_utc_s:
            return ApproachStep.FOLLOW if now_utc_s >= goal.utc_s - self._lead_s(goal) else ApproachStep.SLEW
        if cut_short:
            # A limit is in between: no slew leads nearer, and rates go on when it lets them.
            return ApproachStep.FOLLOW
        # A target that is there already is gone to meet, or run after; one far gone needs another slew.
        seen = self._target_at(now_utc_s)
        gaps_deg = (abs(wrap180(float(seen.ra_deg) - stand.ra_deg)), abs(float(seen.dec_deg) - stand.dec_deg))
        return ApproachStep.FOLLOW if max(gaps_deg) <= RATES_WITHIN_DEG else ApproachStep.PLAN

    def _stands(self, now_utc_s: float, stand: MountPlace) -> bool:
        """Tell whether the mount has come to a slew's goal and stood there, whatever it says of the slew.

        A soft servo rings there for seconds, and a target that has gone on is not waited for. A mount that
        was at the goal before the slew may be about to leave it, for the other side of the pier.
        """
        sent, before = self._sent, self._stood
        if sent is None or _apart_deg(stand.ra_deg, stand.dec_deg, sent.ra_deg, sent.dec_deg) > THERE_DEG:
            self._came, self._stood = sent is not None, None
            return False
        if not self._came:
            return False
        if before is None or _apart_deg(stand.ra_deg, stand.dec_deg, *before[1:]) > STANDS_WITHIN_DEG:
            self._stood = now_utc_s, stand.ra_deg, stand.dec_deg
            return False
        return now_utc_s - before[0] >= STANDS_FOR_S

    def sent(self, motion: Motion) -> None:
        """Note what was really sent: safety may cut a slew short, or hold the mount by rates instead."""
        self._sent = motion if isinstance(motion, Slew) else None
        self._refused = isinstance(motion, MoveAxes)

    def slew_ahead(
        self, now_utc_s: float, end_utc_s: float, error_deg: float, stand: MountPlace, held: bool
    ) -> bool:
        """Tell whether a mount that follows, and is far off, must slew to where the target will be.

        `end_utc_s` is when following ends; `held` tells whether a limit is in the way of rates.
        """
        if error_deg < FAR_DEG or now_utc_s < self._not_again_before_utc_s:
            self._far_since_utc_s = None
            return False
        if self._far_since_utc_s is None:
            self._far_since_utc_s = now_utc_s
        if now_utc_s - self._far_since_utc_s < (FAR_AND_HELD_FOR_S if held else FAR_FOR_S):
            return False
        self._far_since_utc_s = None
        ahead = self._plan(now_utc_s, now_utc_s, stand, True, held)
        return not ahead.by_rates and ahead.utc_s < end_utc_s

    def _plan(
        self, now_utc_s: float, not_before_utc_s: float, stand: MountPlace, moving: bool, held: bool
    ) -> Intercept:
        def target(utc_s: float) -> tuple[float, float, float]:
            direction = self._target_at(utc_s)
            ra_deg = float(direction.ra_deg)
            return ra_deg, float(direction.dec_deg), wrap180(stand.sidereal_deg - ra_deg)

        here = (wrap180(stand.sidereal_deg - stand.ra_deg), stand.dec_deg)
        # A slew chooses the side of the pier by the mount's own rule; rates would stay on the other one.
        law = None if stand.beyond_pole or held else self._law
        return plan_intercept(now_utc_s, not_before_utc_s, here, target, self._profile, law, moving)

    def _slew_s(self, stand: MountPlace, goal: Intercept) -> float:
        to, here = (wrap180(stand.sidereal_deg - ra_deg) for ra_deg in (goal.ra_deg, stand.ra_deg))
        ra_s = slew_time_s(to - here, self._profile.ra)
        return max(ra_s, slew_time_s(goal.dec_deg - stand.dec_deg, self._profile.dec)) + HANDSHAKE_S

    def _in_vain_s(self, goal: Intercept, missing_deg: float) -> float:
        """Return for how long a slew would be cut short much like one that lacked so much of its goal."""
        target = self._target_at(goal.utc_s)
        cos_dec = math.cos(math.radians(goal.dec_deg))
        rate_deg_s = max(abs(float(target.ra_rate_deg_s)) * cos_dec, abs(float(target.dec_rate_deg_s)))
        takes_s = AGAIN_SHARE * missing_deg / rate_deg_s if rate_deg_s else MOST_AGAIN_S
        return max(LEAST_AGAIN_S, min(MOST_AGAIN_S, takes_s))

    def _fail(self, words: str) -> ApproachStep:
        self._failed += 1
        if self._failed < SLEWS_TRIED:
            return ApproachStep.PLAN
        self.trouble = f"got {SLEWS_TRIED} slew commands, and {words}"
        return ApproachStep.GIVE_UP

    def _lead_s(self, intercept: Intercept) -> float:
        """Return how long before the target comes through the mount must begin, to have its rate then."""
        direction = self._target_at(intercept.utc_s)
        ramp = max(
            abs(float(direction.ra_rate_deg_s)) / self._profile.ra.max_acceleration_deg_s2,
            abs(float(direction.dec_rate_deg_s)) / self._profile.dec.max_acceleration_deg_s2,
        )
        return 0.5 * ramp + self._profile.command_delay_s + 1.5 * self._profile.period_s


def _apart_deg(ra_deg: float, dec_deg: float, other_ra_deg: float, other_dec_deg: float) -> float:
    """Return the larger of the two gaps between directions, along the declination and across it."""
    across = abs(wrap180(ra_deg - other_ra_deg)) * math.cos(math.radians(dec_deg))
    return max(across, abs(dec_deg - other_dec_deg))
