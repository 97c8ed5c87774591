"""Slews: each judged by its whole way once, led round what is in it, and watched on it."""

from __future__ import annotations

import math
from itertools import islice
from typing import TYPE_CHECKING

from msgspec.structs import replace

from sattrack.core.angles import separation_deg
from sattrack.mount.model import SIDEREAL_RATE_DEG_S, MountProfile, MoveAxes, Slew
from sattrack.safety.geometry import Box, Place
from sattrack.safety.rate_limit import unheeded_s

if TYPE_CHECKING:
    from sattrack.mount.model import AxisLimits, Seen
    from sattrack.safety.bounds import Bounds
    from sattrack.safety.route import Judge, Route

THERE_DEG = 0.1
"""A slew that ends farther from its goal was not carried out."""
WAITS_S = 70.0
"""How long the mount may wait at the target until it follows, tracking the sky."""
RAMP_SHARE, BRAKING_SHARE, CLOSES_S = 0.5, 0.2, 1.0
"""How a slew by rates begins and ends: shares of the axes' acceleration, and its last time constant."""
TURN_MARGIN_DEG = 2.0
"""How far inside the cables' limit a pass must stay for a turn of the axis to be chosen."""
EDGES_SLOWER = 5.0
"""How much more gently where a rate acts on until the next edge."""
STRAYED_DEG = 1.0
LED_STRAYED_DEG = 6.0
"""The same where rates lead: those of an edge mount may act on for half a second. Each is judged ahead."""
STRAYED_STATUSES = 3
MOST_LEGS = 7
"""A run that would go by more slews to the edge of a limit waits beside it."""
RESTS_DEG = 0.1
"""Axes that come no farther than this until they stand are at rest."""
BEGINS_WITHIN_S = 2.0
"""A mount that rests for longer than this has not taken the slew that it was asked for, or has ended it."""


class SlewGate:
    """The slew that is asked for, in legs; without `detours` it is one leg or none."""

    def __init__(self, profile: MountProfile, bounds: Bounds, latitude_deg: float, detours: bool) -> None:
        if profile.abort_delay_s:
            # The fault that rates must outlast may as well hold up the abort of a slew.
            profile = replace(profile, abort_delay_s=unheeded_s(profile, bounds.longest_fault_s))
        self._profile, self._bounds, self._latitude_deg = profile, bounds, latitude_deg
        self._judge: Judge = bounds.in_way
        self._detours = detours
        self.target: Slew | None = None
        """The slew that was cleared since anything else was asked for."""
        self._legs: list[Slew] = []
        self._box: Box | None = None
        self._start = Place(0.0, 0.0)
        """Where the leg began."""
        self._astray = 0
        self._led_deg_s = (0.0, 0.0)
        """The rates that led along the leg last."""
        self._rested = 0
        """Periods for which the axes have rested since the leg was asked for."""
        self._waits = False
        """Whether another target waits for the end of the slew under way."""
        self.onward_deg: tuple[float, float] | None = None
        """How far back and on the first axis turns from a slew's target on, where rates lead it there and any
        turn of its cables can be chosen; None where the mount slews by itself."""

    @property
    def on_last_leg(self) -> bool:
        """Whether what is under way goes to the target itself."""
        return len(self._legs) <= 1 and not self._waits

    def forget(self) -> None:
        """Something else is asked for."""
        self._rested, self._waits = 0, False
        self.target, self._legs, self._box, self._astray = None, [], None, 0
        self._led_deg_s = (0.0, 0.0)

    def clear(
        self,
        target: Slew,
        sidereal_deg: float,
        reported: tuple[float, float],
        place: Place,
        braking: Box,
        slewing: bool,
    ) -> Slew | str:
        """Return the slew to ask for now, or the name of the row that it is not clear of.

        `braking` is where axes that move may come until they stand; `slewing` is what the mount reports. It
        begins a slew at rest, and first goes to the end of the one under way: another target is judged from
        there. Until then the leg goes on where legs are asked for one by one; a target that is asked for as
        it is waits in the session.
        """
        under_way = self._is_under_way(reported, braking, slewing)
        self._waits = target != self.target and under_way
        if self._waits:
            return self._legs[0] if self._detours else target
        if target != self.target:
            found = self._legs_to(target, sidereal_deg, place)
            former = self._leg_end(place, sidereal_deg) if self._may_begin(reported) else None
            if former is not None and not isinstance(found, str):
                # Which of the two the mount begins, nobody knows: it may go by the end of the former one.
                found = self.objection(target, sidereal_deg, former) or found
            if isinstance(found, str):
                return found
            self.target, self._legs, self._rested = target, list(found), 0
            self._enter(place, sidereal_deg, braking)
            if former is not None and self._box is not None:
                self._box = self._box.with_box(Box.between(place, former))
        elif not self.on_last_leg and self.is_there(reported):
            self._legs.pop(0)
            self._rested = 0
            name = self.objection(self._legs[0], sidereal_deg, place)
            if name is not None:
                found = self._legs_to(target, sidereal_deg, place)
                if isinstance(found, str):
                    return found
                self._legs = list(found)
            self._enter(place, sidereal_deg, braking)
        return self._legs[0]

    def _is_under_way(self, reported: tuple[float, float], braking: Box, slewing: bool) -> bool:
        """Tell whether the axes move along a leg to its end, or may begin to; call once a period.

        Rates that lead may lead elsewhere at once.
        """
        if not self._legs or self._profile.geometry is not None:
            return False
        wide_deg = max(braking.ha_high_deg - braking.ha_low_deg, braking.dec_high_deg - braking.dec_low_deg)
        self._rested = self._rested + 1 if wide_deg < RESTS_DEG else 0
        # What is asked for as it is, the session begins at rest in place of a leg that has not begun.
        return self._rested == 0 or slewing or (self._detours and self._may_begin(reported))

    def _may_begin(self, reported: tuple[float, float]) -> bool:
        """Tell whether axes at rest may yet begin the leg that was asked for last."""
        begins = bool(self._legs) and self._rested * self._profile.period_s < BEGINS_WITHIN_S
        return begins and self._profile.geometry is None and not self.is_there(reported)

    def _legs_to(self, target: Slew, sidereal_deg: float, place: Place) -> tuple[Slew, ...] | str:
        if self._detours:
            return self.route(target, sidereal_deg, place, waits=True)
        name = self.objection(target, sidereal_deg, place)
        return (target,) if name is None else name

    def route(
        self, target: Slew, sidereal_deg: float, place: Place, waits: bool = False
    ) -> tuple[Slew, ...] | str:
        """Return the legs to a target from a place, or the name of the row that is in the way.

        Where the target itself is past a limit and `waits`, the way is to the nearest place that is not.
        """
        if self.objection(target, sidereal_deg, place) is None:
            return (target,)
        found = self._route_from(place, target, sidereal_deg, waits)
        if isinstance(found, str) and self._bounds.near(place):
            exit_place = self._way_out(place)
            if exit_place is not None:
                leg = _slew_to(exit_place, sidereal_deg)
                onward = self._route_from(exit_place, target, sidereal_deg, waits)
                if not isinstance(onward, str):
                    found = (leg, *onward)
                elif waits and self._bounds.dazzled(place):
                    # Whatever becomes of the target, the telescope does not stay in the Sun.
                    found = (leg,)
        return found

    def way_out(self, sidereal_deg: float, place: Place) -> Slew | None:
        """Return a slew out of the Sun's or the Moon's cone, None where there is none or no need of one."""
        exit_place = self._way_out(place) if self._bounds.dazzled(place) else None
        return None if exit_place is None else _slew_to(exit_place, sidereal_deg)

    def _way_out(self, place: Place) -> Place | None:
        """Return the nearest clear place to which axes get that are past a limit, or too near to one."""
        from sattrack.safety.route import blocked, clear_places

        for beside in clear_places(place, self._latitude_deg, self._profile, self._judge):
            if blocked(place, beside, self._profile, self._judge_leaving(place)) is None:
                return beside
        return None

    def _judge_leaving(self, place: Place) -> Judge:
        def judge(box: Box, seconds: float) -> str | None:
            return self._bounds.in_way(box, seconds, self._bounds.leaving(place, seconds))

        return judge

    def _route_from(
        self, place: Place, target: Slew, sidereal_deg: float, waits: bool
    ) -> tuple[Slew, ...] | str:
        from sattrack.safety.route import Route, can_wait, clear_places, slew_s

        goal = self._goal(target, sidereal_deg, place)
        judge, leaving = self._judge, self._judge_leaving(place)
        # The mount tracks the sky there until it follows.
        drift_deg = SIDEREAL_RATE_DEG_S * (slew_s(place, goal, self._profile) + WAITS_S)
        in_goal = judge(Box.between(goal, goal).grown(0.0, drift_deg if waits else 0.0, 0.0, 0.0), 0.0)
        if in_goal is not None and waits:
            goals = self._beside(place, goal, judge, leaving)
            found = self._first_route(place, goals, judge, leaving) if goals else Route((), in_goal)
            return found.blocked_by or tuple(_slew_to(leg, sidereal_deg) for leg in found.legs)
        found = self._first_route(place, [goal], judge, leaving)
        far_round = found.blocked_by is not None or len(found.legs) > MOST_LEGS
        if waits and far_round and not can_wait(goal, judge):
            # An abort on the way there may lead past what it may not; a little beside it there is room.
            nearest = islice(clear_places(goal, self._latitude_deg, self._profile, judge), 1)
            other = self._first_route(place, list(nearest), judge, leaving)
            if other.legs:
                return tuple(_slew_to(leg, sidereal_deg) for leg in other.legs)
        if found.blocked_by is not None:
            return found.blocked_by
        return *(_slew_to(leg, sidereal_deg) for leg in found.legs[:-1]), target

    def _beside(self, place: Place, goal: Place, judge: Judge, leaving: Judge) -> list[Place]:
        """Return where to wait instead: the nearest place, and the nearest that is reached straight on."""
        from sattrack.safety.route import blocked, clear_places

        found: list[Place] = []
        for beside in clear_places(goal, self._latitude_deg, self._profile, judge):
            if not found:
                found.append(beside)
            if blocked(place, beside, self._profile, leaving) is None:
                return [*found, beside]
        return found

    def _first_route(self, place: Place, goals: list[Place], judge: Judge, leaving: Judge) -> Route:
        from sattrack.safety.route import Route, find_route

        found = Route((), None)
        for goal in goals:
            found = find_route(
                place, goal, self._profile, judge, leaving, self._latitude_deg, self._bounds.closed
            )
            if found.blocked_by is None:
                break
        return found

    def objection(self, target: Slew, sidereal_deg: float, place: Place) -> str | None:
        """Return the name of the row that the straight way to a target is not clear of, or None."""
        return self.path_objection(place, self._goal(target, sidereal_deg, place))

    def _goal(self, target: Slew, sidereal_deg: float, place: Place) -> Place:
        """Return how the axes stand after a slew from a place, on the turn on which it can go on."""
        from sattrack.safety.route import axes_of

        goal = axes_of(sidereal_deg - target.ra_deg, target.dec_deg, self._profile, self._latitude_deg)
        if self.onward_deg is None:
            return goal
        (back, on), limit = self.onward_deg, self._profile.hour_angle_limit_deg - TURN_MARGIN_DEG
        turns = [goal.ha_deg + turn for turn in (0.0, -360.0, 360.0)]
        fit = [ha for ha in turns if -limit <= ha + min(0.0, back) and ha + max(0.0, on) <= limit]
        best = min(fit, key=lambda ha: abs(ha - place.ha_deg), default=goal.ha_deg)
        return Place(best, goal.dec_deg)

    def path_objection(self, place: Place, goal: tuple[float, float]) -> str | None:
        """Return the name of the row that the way between two places is not clear of, or None."""
        from sattrack.safety.route import blocked

        end = Place(*goal)
        at_end = self._judge(Box.between(end, end), 0.0)
        if at_end is not None:
            return at_end
        return blocked(place, end, self._profile, self._judge_leaving(place))

    def strays(self, place: Place, seen: Seen) -> bool:
        """Tell whether the mount has left what its slew was judged by."""
        box = self._box
        if box is None or not seen.slewing:
            self._astray = 0
            return False
        m = STRAYED_DEG if self._profile.geometry is None else LED_STRAYED_DEG
        self._astray = 0 if box.grown(m, m, m, m).holds(place) else self._astray + 1
        return self._astray >= STRAYED_STATUSES

    def takes_other_side(self, place: Place, sidereal_deg: float) -> bool:
        """Tell whether a mount that strays goes to where its slew ends from the other side of the pier."""
        ha_deg, dec_deg = self._leg_end(place, sidereal_deg)
        dec_deg = math.copysign(180.0, self._latitude_deg) - dec_deg
        ways = [Box.between(self._start, (ha_deg + turn, dec_deg)) for turn in (-180.0, 180.0)]
        m = STRAYED_DEG
        return self._profile.geometry is None and any(way.grown(m, m, m, m).holds(place) for way in ways)

    def _enter(self, place: Place, sidereal_deg: float, braking: Box) -> None:
        from sattrack.safety.route import slew_s

        goal = self._leg_end(place, sidereal_deg)
        self._box, self._start, self._astray = Box.between(place, goal), place, 0
        # Axes that still brake go on the old way for a while; that is no disobedience where nothing is near.
        wider = self._box.with_box(braking)
        seconds = slew_s(place, goal, self._profile)
        drifted = wider.grown(0.0, SIDEREAL_RATE_DEG_S * seconds, 0.0, 0.0)
        if self._judge_leaving(place)(drifted, seconds) is None:
            self._box = wider

    def _leg_end(self, place: Place, sidereal_deg: float) -> Place:
        from sattrack.safety.route import axes_of

        leg = self._legs[0]
        if leg == self.target:
            return self._goal(leg, sidereal_deg, place)
        return axes_of(sidereal_deg - leg.ra_deg, leg.dec_deg, self._profile, self._latitude_deg)

    def rates_from(self, place: Place, sidereal_deg: float) -> MoveAxes:
        """Return the rates that lead from a place along the leg under way, each axis in its own time."""
        goal, profile = self._leg_end(place, sidereal_deg), self._profile
        by_edges = profile.move_axis == "edge"
        rates = []
        for to, at, before, axis in zip(goal, place, self._led_deg_s, (profile.ra, profile.dec), strict=True):
            most = RAMP_SHARE * axis.max_acceleration_deg_s2 * profile.period_s
            wanted = _closing_deg_s(to - at, axis, by_edges)
            rates.append(max(before - most, min(before + most, wanted)))
        first, second = self._led_deg_s = (rates[0], rates[1])
        return MoveAxes(-first, second)

    def is_there(self, reported: tuple[float, float]) -> bool:
        """Tell whether the mount reports to be where the leg under way ends."""
        leg = self._legs[0]
        off = separation_deg(reported[0], reported[1], leg.ra_deg, leg.dec_deg)
        return math.isfinite(off) and off < THERE_DEG


def _closing_deg_s(gap_deg: float, axis: AxisLimits, by_edges: bool) -> float:
    """Return the rate that closes a gap, from which a share of the acceleration can still brake."""
    size, slower = abs(gap_deg), EDGES_SLOWER if by_edges else 1.0
    braking = math.sqrt(2.0 * BRAKING_SHARE / slower * axis.max_acceleration_deg_s2 * size)
    fastest = min(axis.slew_rate_deg_s, axis.max_rate_deg_s)
    return math.copysign(min(size / (slower * CLOSES_S), braking, fastest), gap_deg)


def _slew_to(place: Place, sidereal_deg: float) -> Slew:
    from sattrack.safety.route import direction_of

    hour_angle_deg, dec_deg = direction_of(place)
    return Slew((sidereal_deg - hour_angle_deg) % 360.0, dec_deg)
