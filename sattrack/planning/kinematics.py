"""What a pass loses to a mount's limits: by kinematics, by sides of the pier and turns of the cables.

No command of the mount's chooses a side; where its rule flips it, where a slew ends decides. So there are
two choices: when to begin, as the side depends on where the satellite is joined, and whether to stop in
mid-pass and follow anew, which lands on the side, and within the half turn of the cables, that the rule has
for that place.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal, NamedTuple

import msgspec
import numpy as np

from sattrack.control.approach import FAR_AND_HELD_FOR_S, FAR_DEG, MARGIN_S, slew_time_s
from sattrack.control.stages import KEYHOLE, RATE
from sattrack.core.angles import wrap180
from sattrack.mount.model import SIDEREAL_RATE_DEG_S, PierRule, beyond_after_slew, horizon_latitude_deg
from sattrack.planning.path import axis_path, find_keyholes, margins_deg, separations_deg, stretches
from sattrack.safety.rate_limit import unheeded_s
from tle.bias import NO_BIAS
from tle.instants import Utc
from tle.propagator import Propagator
from tle.refraction import Refraction

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from sattrack.planning.path import AxisPath, Keyhole

    Bools = NDArray[np.bool_]
    from collections.abc import Sequence

    from sattrack.mount.model import AxisLimits, MountProfile
    from sattrack.safety.limits import SafetyLimits
    from tle.bias import Bias
    from tle.earth import EarthOrientation
    from tle.elements import Elements
    from tle.ephemeris import Ephemeris
    from tle.site import Site

    Array = NDArray[np.float64]

NEAR_DEG = 0.1
"""How near to a limit of place the mount is let."""
NO_LIMIT_DEG = 360.0
CABLES = "hour_angle"
LEADS_ROUND = ("sun", "moon", "pier")
"""Behind these a target goes on, and the mount slews round them to where it comes out."""
ROUND_DEG = 30.0
"""How far each slew round a limit leads at least: places to turn at are 12° apart, and clear of the limit."""
CREEPING_DEG_S = 0.02
"""A target that is slower than this on the sky is not left behind by a mount that goes along an edge."""
LEAST_SHARE = 0.9
"""Share of a pass that must be followed for a "go"."""


@dataclass(frozen=True, slots=True)
class Ability:
    """What is followed with: the mount, the site's limits, and how near counts as on target.

    The latitude is the site's, or that at which an equatorial mount sees the horizon as this one's axes do.
    """

    profile: MountProfile
    limits: SafetyLimits
    latitude_deg: float
    tolerance_deg: float
    detours: bool = False
    """Whether what follows takes the best way past the pole, and does not clip."""


@dataclass(frozen=True, slots=True)
class PredictedLoss:
    """A stretch that is lost: POSIX seconds of UTC, the limit's name, what is asked against what can be.

    Where an axis is too slow, `asked_deg_s` is the most that is asked of it, and `can_deg_s` what it can.
    """

    begin_utc_s: float
    end_utc_s: float
    limit: str
    words: str
    asked_deg_s: float | None = None
    can_deg_s: float | None = None

    @property
    def seconds(self) -> float:
        """How long it is."""
        return self.end_utc_s - self.begin_utc_s


def losses(
    path: AxisPath, ability: Ability, keyholes: list[Keyhole] | None = None, begun: bool = False
) -> list[PredictedLoss]:
    """Return what of a path cannot be followed, in order, not overlapping.

    At a limit of place the mount is held until the target comes back, or it is led round to it. The path
    must hold no NaN; where its keyholes are known already they need not be searched. `begun` as in `outside`.
    """
    found: list[PredictedLoss] = []
    every = [*outside(path, ability, begun), *_too_fast(path, ability, keyholes)]
    for loss in sorted(every, key=lambda one: one.begin_utc_s):
        begin = max([loss.begin_utc_s, *(other.end_utc_s for other in found)])
        if begin < loss.end_utc_s:
            found.append(replace(loss, begin_utc_s=begin))
    return found


def outside(path: AxisPath, ability: Ability, begun: bool = False) -> list[PredictedLoss]:
    """Return the stretches in which a path is past a limit of place, by limit.

    On the way to a limit the axes are held so much sooner that they would stop inside if nothing were heard
    from this side for the longest fault, and an abort acted as late as the profile says. A target that is
    past a limit at the path's beginning is joined when it comes out, unless it was followed there: `begun`
    where the path is the rest of one.
    """
    found = []
    limits = ability.limits
    margins = margins_deg(path.pointing, ability.profile, limits, ability.latitude_deg)
    speed = np.hypot(path.hour_angle_rate_deg_s, path.dec_rate_deg_s) + SIDEREAL_RATE_DEG_S
    ahead_s = unheeded_s(ability.profile, limits.longest_fault_s)
    for name, margin in margins.items():
        finite = np.where(np.isfinite(margin), margin, NO_LIMIT_DEG)
        # A body that comes above the horizon comes no nearer by that.
        closing = np.clip(-np.gradient(finite, path.utc_s), 0.0, 1.1 * speed)
        for first, last in stretches(margin < NEAR_DEG + ahead_s * closing):
            least = float(np.min(margin[first : last + 1]))
            words = f"goes {-least:.1f}° past the limit" if least < 0.0 else f"comes to {least:.1f}° from it"
            speed_deg_s = float(np.max(path.sky_rate_deg_s[first : last + 1])) - SIDEREAL_RATE_DEG_S
            followed_before = first > 0 or begun
            begin_utc_s, end_utc_s = float(path.utc_s[first]), float(path.utc_s[last])
            if name in LEADS_ROUND and speed_deg_s > CREEPING_DEG_S and followed_before:
                leaves_utc_s = _leaves_utc_s(path, first)
                end_utc_s = max(end_utc_s, leaves_utc_s) + _round_s(path, first, last, ability.profile)
            elif name == CABLES:
                end_utc_s = _unwound_utc_s(path, first, last, ability.profile)
            end_utc_s = min(end_utc_s, float(path.utc_s[-1]))
            found.append(PredictedLoss(begin_utc_s, end_utc_s, name, words))
    return found


def _leaves_utc_s(path: AxisPath, first: int) -> float:
    """Return when a mount that is held at one of a path's samples slews after the target, POSIX seconds.

    It does so once the target is far ahead; infinity where that does not come before the path's end.
    """
    p = path.pointing
    ahead_deg = separations_deg(p, p.hour_angle_axis_deg[first], p.dec_axis_deg[first])
    far = np.flatnonzero(ahead_deg[first:] > FAR_DEG)
    return float(path.utc_s[first + far[0]]) + FAR_AND_HELD_FOR_S if len(far) else math.inf


def _round_s(path: AxisPath, first: int, last: int, profile: MountProfile) -> float:
    """Return about how long the mount takes round a limit to a target that has come out: two slews.

    It is held before the limit until then, or begins sooner where that is far; and then it has to join.
    """
    angles = path.pointing.hour_angle_axis_deg, path.pointing.dec_axis_deg
    leg_s = max(
        slew_time_s(max(ROUND_DEG, abs(float(angle[last] - angle[first]))), axis)
        for angle, axis in zip(angles, (profile.ra, profile.dec), strict=True)
    )
    return 2.0 * (2.0 * MARGIN_S + leg_s)


def _unwound_utc_s(path: AxisPath, first: int, last: int, profile: MountProfile) -> float:
    """Return when a mount whose cables end before the target's way is on the target again, POSIX seconds.

    Once it is far behind, it slews back to the other turn, and is there as soon as the target is. What does
    not fit there is lost: where the axis turns less than half a turn either way, what lies between both ends.
    """
    most = profile.hour_angle_limit_deg
    axis, dec = path.pointing.hour_angle_axis_deg[first:], path.pointing.dec_axis_deg[first:]
    utc_s = path.utc_s[first:]
    behind_deg = (np.abs(axis) - most) * np.abs(np.cos(np.radians(dec)))
    far = np.flatnonzero(behind_deg[: last - first + 1] > FAR_DEG)
    if not len(far):
        return float(path.utc_s[last])
    end_deg = math.copysign(most, float(axis[far[0]]))
    there = axis - math.copysign(360.0, end_deg)
    beyond = np.flatnonzero(np.abs(there) > most)
    fits = max(int(far[0]), int(beyond[-1]) + 1 if len(beyond) else 0)
    left_utc_s = float(utc_s[far[0]]) + FAR_AND_HELD_FOR_S + 2.0 * MARGIN_S
    for instant, at_deg in zip(utc_s[fits:].tolist(), there[fits:].tolist(), strict=True):
        if instant >= left_utc_s + slew_time_s(at_deg - end_deg, profile.ra):
            return float(instant)
    return float(path.utc_s[last])


def _too_fast(path: AxisPath, ability: Ability, keyholes: list[Keyhole] | None) -> list[PredictedLoss]:
    profile = ability.profile
    if keyholes is None:
        keyholes = find_keyholes(path, profile, ability.tolerance_deg, ways=ability.detours)
    begin_utc_s, end_utc_s = float(path.utc_s[0]), float(path.utc_s[-1])
    names = profile.axis_names()
    equatorial = profile.geometry is None
    turns = "the pole the hour angle turns" if equatorial else f"the mount's pole {names[0]} turns"
    found = [
        PredictedLoss(
            *_lost_span(k, ability.detours),
            KEYHOLE,
            f"{k.polar_distance_deg:.2f}° from {turns} {k.peak_rate_deg_s:.3g} °/s "
            f"of {profile.ra.max_rate_deg_s:.3g} °/s",
            k.peak_rate_deg_s,
            profile.ra.max_rate_deg_s,
        )
        for k in keyholes
        if begin_utc_s <= k.begin_utc_s < end_utc_s
    ]
    cos_dec = np.abs(np.cos(np.radians(path.pointing.dec_axis_deg)))
    axes = (
        (names[0], path.pointing.hour_angle_axis_deg, path.hour_angle_rate_deg_s, profile.ra, cos_dec),
        (
            names[1],
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
        for first, last in stretches(behind > ability.tolerance_deg):
            begin, end = float(path.utc_s[first]), float(path.utc_s[last])
            if any(begin < loss.end_utc_s and end > loss.begin_utc_s for loss in found):
                continue
            most = float(np.max(np.abs(rate[first : last + 1])))
            words = f"{axis} turns {most:.3g} °/s of {can.max_rate_deg_s:.3g} °/s"
            found.append(PredictedLoss(begin, end, RATE, words, most, can.max_rate_deg_s))
    return sorted(found, key=lambda loss: loss.begin_utc_s)


def _lost_span(keyhole: Keyhole, detours: bool) -> tuple[float, float]:
    """Return from when to when a keyhole is lost, POSIX seconds."""
    if detours and keyhole.detour is not None:
        return keyhole.detour.begin_utc_s, keyhole.detour.end_utc_s
    return keyhole.begin_utc_s, keyhole.begin_utc_s + keyhole.clipped_s


def _follow(place: Array, utc_s: Array, limit_deg_s: float) -> Array:
    """Return where an axis is that follows as fast as it can."""
    at = place.copy()
    most = np.diff(utc_s) * limit_deg_s
    fast = np.flatnonzero(np.abs(np.diff(place)) > most).tolist()
    after = 0
    for first in fast:
        if first < after:
            continue
        # It is there until the place goes too fast, and again once it has caught up.
        here, after = float(place[first]), first
        for there, can in zip(place[first + 1 :].tolist(), most[first:].tolist(), strict=True):
            after += 1
            here += max(-can, min(can, there - here))
            at[after] = here
            if here == there:
                break
    return at


def why_not(lost: Sequence[PredictedLoss], whole_s: float) -> str | None:
    """Return in words what keeps the mount from following enough of so long a pass; None where it can."""
    lost_s = sum(loss.seconds for loss in lost)
    if lost_s <= (1.0 - LEAST_SHARE) * whole_s:
        return None
    worst = max(lost, key=lambda loss: loss.seconds)
    return f"{worst.limit}: {worst.words}; {lost_s:.0f} s of {whole_s:.0f} s lost"


STEP_S, FINE_STEP_S = 1.0, 0.05
FEWEST, MOST = 60, 20_000
BOUND_SHARE = 0.8
"""Share of the hour angle axis' limits that a bound on what is asked may take before fine steps decide."""
ON_TARGET_DEG = 2.0 / 3600.0


def ability_at(site: Site, profile: MountProfile, limits: SafetyLimits) -> Ability:
    """Return what passes at a site are judged by."""
    latitude_deg = horizon_latitude_deg(profile, site.latitude_deg)
    return Ability(profile, limits, latitude_deg, ON_TARGET_DEG, profile.through_pole)


class Verdict(NamedTuple):
    """Why a mount cannot follow a pass, in words, None where it can; and what it loses of it."""

    why_not: str | None
    lost: tuple[PredictedLoss, ...] = ()


def verdict_on(
    elements: Elements | Ephemeris,
    site: Site,
    span: tuple[float, float],
    ability: Ability,
    earth: EarthOrientation | None,
) -> Verdict:
    """Return the verdict on a pass, POSIX seconds of UTC.

    Where SGP4 fails within the span the reason says so. Raises TimeRangeError.
    """
    propagator = Propagator(elements, site, earth=earth, refraction=Refraction.standard(site.height_m))
    return verdict_over(propagator, NO_BIAS, span, ability)


def verdict_over(propagator: Propagator, bias: Bias, span: tuple[float, float], ability: Ability) -> Verdict:
    """Return the verdict on a pass whose directions are given; as `verdict_on`."""
    begin, end = span
    if not end > begin:
        return Verdict("the pass has no duration")
    path = axis_path(propagator, bias, _instants(begin, end, STEP_S), ability.profile.frame)
    dec = path.pointing.dec_axis_deg
    if not np.isfinite(dec).all():
        return Verdict("the elements have it come down before the pass ends")
    if _may_be_too_fast(path, ability.profile.ra):
        path = axis_path(propagator, bias, _instants(begin, end, FINE_STEP_S), ability.profile.frame)
    begins_deg = wrap180(float(path.pointing.hour_angle_axis_deg[0]))
    beyond = beyond_after_slew(ability.profile.pier_rule, begins_deg)
    lost = losses(path.seen_from(beyond, ability.latitude_deg).led(ability.profile), ability)
    return Verdict(why_not(lost, end - begin), tuple(lost))


def _may_be_too_fast(path: AxisPath, can: AxisLimits) -> bool:
    """Tell whether the hour angle may turn, or its rate change, too fast between the samples of a path.

    A target at a speed s and a distance p from the pole turns it by s / sin p at most, which changes by no
    more than 2 (s / sin p)², and comes nearer by half a step's way between two samples.
    """
    speed = float(np.max(path.sky_rate_deg_s))
    step_s = float(np.max(np.diff(path.utc_s)))
    polar = 90.0 - float(np.max(np.abs(path.pointing.dec_axis_deg))) - 0.5 * step_s * speed
    if polar <= 0.0:
        return True
    rate = speed / math.sin(math.radians(polar))
    change = 2.0 * rate * math.radians(rate)
    return rate > BOUND_SHARE * can.max_rate_deg_s or change > BOUND_SHARE * can.max_acceleration_deg_s2


def _instants(begin: float, end: float, step_s: float) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    count = max(FEWEST, math.ceil((end - begin) / step_s) + 1)
    return np.linspace(begin, end, min(count, MOST))


Side = Literal["normal", "beyond_pole"]
SPLITS = 80
SAME_S = 1e-3
SAMPLE_S = 0.25
TOO_FAST = ("rate", "keyhole")
"""Lost to these, a target is lagged behind; lost to limits of place, the mount is held."""
TOLD_TURN_DEG = 178.0
"""A new beginning takes the axes to be within half a turn of their middle: elsewhere none is recommended."""
WORTH_S = 2.0
"""Another way than the mount's own is recommended only where it saves this much."""
SIDE_WORDS = {"normal": "the normal side", "beyond_pole": "beyond the pole"}


class SideOption(msgspec.Struct, frozen=True):
    """One way to take a pass: the side at first, when to stop and begin anew if at all, and what it loses."""

    side: Side
    stop_utc: str | None
    """Null where the pass is followed in one go."""
    again_utc: str | None
    """When the satellite is followed again; without `stop_utc`, when it is followed first."""
    again_side: Side | None
    lost_s: float
    limit: str | None
    """What most of it is lost to; null where nothing is lost."""


class Sides(msgspec.Struct, frozen=True):
    """What the rule has the mount do, and the best that it lets be chosen."""

    rule: PierRule
    by_itself: SideOption
    recommended: SideOption
    words: str
    flips_utc: tuple[str, ...] = ()
    """When the mount goes over to the other side by itself, as rehearsed."""


class Lost(NamedTuple):
    """What following a path in one go loses, where that is known already: seconds, and to what most."""

    seconds: float
    limit: str | None


def choose_sides(
    path: AxisPath, ability: Ability, rule: PierRule, keyholes: list[Keyhole], known: Lost | None = None
) -> Sides:
    """Return what can be done about sides and cables over a path, seen from the normal side, without NaN.

    The path's keyholes are the same from both sides. What the mount loses by itself is `known`, or follows
    from kinematics.
    """
    thinned = path.thinned(max(1, round(SAMPLE_S / float(path.utc_s[1] - path.utc_s[0]))))
    search = _SideSearch.over(thinned, ability, rule, keyholes)
    own = search.by_itself()
    if known is not None:
        own = msgspec.structs.replace(own, lost_s=known.seconds, limit=known.limit)
    best = search.best_split() if own.lost_s > WORTH_S else None
    return sides_of(rule, own, best)


def sides_of(rule: PierRule, own: SideOption, best: SideOption | None) -> Sides:
    """Return both ways, and which of them is worth taking."""
    if best is None or best.lost_s > own.lost_s - WORTH_S:
        best = own
    return Sides(rule, own, best, _words(rule, own, best))


@dataclass(frozen=True, slots=True)
class _SideSearch:
    """The path from both sides, and the samples from which following can begin otherwise than before."""

    path: AxisPath
    ability: Ability
    rule: PierRule
    keyholes: list[Keyhole]
    views: dict[bool, AxisPath]
    turns: tuple[int, ...]
    """Samples at which the rule's side or the cables' half turn changes, or that are clear again."""

    @classmethod
    def over(cls, path: AxisPath, ability: Ability, rule: PierRule, keyholes: list[Keyhole]) -> _SideSearch:
        sides = {beyond: path.seen_from(beyond, ability.latitude_deg) for beyond in (False, True)}
        views = {beyond: view.led(ability.profile) for beyond, view in sides.items()}
        hour_angle = path.pointing.hour_angle_axis_deg
        lower = np.floor((hour_angle + 180.0) / 360.0)
        changes = [np.flatnonzero(np.diff(lower)) + 1]
        if rule != "never":
            west: Bools = (hour_angle + 180.0) % 360.0 > 180.0
            changes.append(np.flatnonzero(west[:-1] != west[1:]) + 1)
        for view in views.values():
            margins = margins_deg(view.pointing, ability.profile, ability.limits, ability.latitude_deg)
            for name in LEADS_ROUND:
                if name in margins:
                    clear: Bools = margins[name] > NEAR_DEG
                    changes.append(np.flatnonzero(~clear[:-1] & clear[1:]) + 1)
        turns = tuple(np.unique(np.concatenate(changes)).tolist())
        return cls(path, ability, rule, keyholes, views, turns)

    def beyond_after_slew(self, index: int) -> bool:
        """Tell on which side a slew to a place of the path ends."""
        hour_angle = wrap180(float(self.path.pointing.hour_angle_axis_deg[index]))
        return beyond_after_slew(self.rule, hour_angle)

    def by_itself(self) -> SideOption:
        """Return what the mount does by itself."""
        beyond = self.beyond_after_slew(0)
        lost = losses(self.views[beyond], self.ability, self.keyholes)
        return SideOption(_side(beyond), None, None, None, sum(one.seconds for one in lost), _worst(lost))

    def best_split(self) -> SideOption | None:
        """Return the best way with a late beginning, or a stop and a new one; None without room."""
        count = len(self.path.utc_s)
        first = self.views[self.beyond_after_slew(0)]
        before = losses(first, self.ability, self.keyholes)
        begins = [int(np.searchsorted(self.path.utc_s, one.begin_utc_s)) for one in before]
        leaves = np.unique([*np.linspace(0, count - 4, SPLITS).astype(int).tolist(), *begins])
        best: SideOption | None = None
        known: dict[int, list[PredictedLoss]] = {}
        for leave in leaves.tolist():
            for join in self._joins(first, leave, before):
                if join not in known:
                    second = self.from_sample(join)
                    known[join] = losses(second, self.ability, self.keyholes)
                option = self._option(leave, join, before, known[join])
                # Of ways that lose the same the last one is taken: while held, nothing is lost by waiting.
                if best is None or option.lost_s <= best.lost_s + SAME_S:
                    best = option
        return best

    def from_sample(self, join: int) -> AxisPath:
        """Return the rest of the path as a slew to one of its samples lets it be followed."""
        view = self.views[self.beyond_after_slew(join)]
        return view.part(join, len(self.path.utc_s)).wound_anew().led(self.ability.profile)

    def _option(
        self, leave: int, join: int, before: list[PredictedLoss], after: list[PredictedLoss]
    ) -> SideOption:
        utc_s = self.path.utc_s
        begin, end = float(utc_s[leave]), float(utc_s[join])
        lost_s = sum(max(0.0, min(one.end_utc_s, begin) - one.begin_utc_s) for one in before)
        lost_s += end - begin + sum(one.seconds for one in after)
        limit = _worst(after) if sum(one.seconds for one in after) > end - begin else "flip"
        return SideOption(
            side=_side(self.beyond_after_slew(0)),
            stop_utc=None if leave == 0 else _iso(begin),
            again_utc=_iso(end),
            again_side=_side(self.beyond_after_slew(join)),
            lost_s=lost_s,
            limit=limit,
        )

    def _joins(self, first: AxisPath, leave: int, before: list[PredictedLoss]) -> list[int]:
        """Return the samples to begin anew from that are worth a look: the first in reach, and what turns."""
        last = len(self.path.utc_s) - 4
        later = [turn for turn in self.turns if leave < turn <= last]
        if leave == 0:
            return later
        here = self._stands_at(first, leave, before)
        if abs(here[0] - self.ability.profile.first_axis_middle_deg) > TOLD_TURN_DEG:
            return []
        step = max(1, len(self.path.utc_s) // 200)
        soonest = next((j for j in range(leave + 1, last, step) if self._in_reach(here, leave, j)), None)
        reached = [join for join in later if self._in_reach(here, leave, join)]
        return reached if soonest is None else [soonest, *reached]

    def _stands_at(self, first: AxisPath, leave: int, before: list[PredictedLoss]) -> tuple[float, float]:
        """Return where the axes are at a sample: with the target, or where they lost it."""
        at = float(self.path.utc_s[leave])
        held = (one for one in before if one.limit not in TOO_FAST)
        lost = next((one for one in held if one.begin_utc_s <= at <= one.end_utc_s), None)
        index = leave if lost is None else int(np.searchsorted(self.path.utc_s, lost.begin_utc_s))
        p = first.pointing
        return float(p.hour_angle_axis_deg[index]), float(p.dec_axis_deg[index])

    def _in_reach(self, here: tuple[float, float], leave: int, join: int) -> bool:
        """Tell whether a slew that begins at one sample is at another in time."""
        p = self.views[self.beyond_after_slew(join)].pointing
        hour_angle = wrap180(float(p.hour_angle_axis_deg[join]))
        takes_s = MARGIN_S + max(
            slew_time_s(hour_angle - here[0], self.ability.profile.ra),
            slew_time_s(float(p.dec_axis_deg[join]) - here[1], self.ability.profile.dec),
        )
        return float(self.path.utc_s[join] - self.path.utc_s[leave]) >= takes_s


def with_flips(sides: Sides, flips_utc: tuple[str, ...]) -> Sides:
    """Return the same with the instants at which the mount goes over to the other side."""
    if not flips_utc:
        return sides
    when = ", ".join(flips_utc)
    words = f"{sides.words}; it goes over to the other side at {when}"
    return msgspec.structs.replace(sides, words=words, flips_utc=flips_utc)


def _side(beyond: bool) -> Side:
    return "beyond_pole" if beyond else "normal"


def _worst(lost: list[PredictedLoss]) -> str | None:
    worst = max(lost, key=lambda loss: loss.seconds, default=None)
    return None if worst is None else worst.limit


def _iso(utc_s: float) -> str:
    return Utc(utc_s).isoformat("seconds")


def _words(rule: PierRule, own: SideOption, best: SideOption) -> str:
    side = SIDE_WORDS[own.side]
    if best is own:
        if rule == "never":
            return f"the mount follows from {side}; no slew flips it, and no command chooses"
        return f"the mount follows from {side}, as its rule has it for where the satellite is joined"
    saves = f"{best.lost_s:.0f} s lost instead of {own.lost_s:.0f} s"
    there = SIDE_WORDS[best.again_side or "normal"]
    if best.stop_utc is None:
        return (
            f"by itself the mount begins from {side}; let it begin only at {best.again_utc}, "
            f"from {there}: {saves}"
        )
    return (
        f"the mount begins from {side}; stop it at {best.stop_utc} and track again: it is on the "
        f"satellite at {best.again_utc}, from {there}: {saves}"
    )
