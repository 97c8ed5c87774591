"""Sides of the pier and turns of the cables: what the mount will do by itself, and what loses less.

No command of the mount's chooses a side; where its rule flips it, where a slew ends decides. So there are two
choices: when to begin, as the side depends on where the satellite is joined, and whether to stop in mid-pass
and follow anew, which lands on the side, and within the half turn of the cables, that the rule has for that
place.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, NamedTuple

import msgspec
import numpy as np

from sattrack.control.approach import MARGIN_S, slew_time_s
from sattrack.core.angles import wrap180
from sattrack.planning.kinematics import NEAR_DEG, NO_WAY_ROUND, losses
from sattrack.planning.path import margins_deg
from tle.instants import Utc

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from sattrack.planning.keyhole import Keyhole
    from sattrack.planning.kinematics import Ability, ForetoldLoss
    from sattrack.planning.path import AxisPath

    Bools = NDArray[np.bool_]

Rule = Literal["never", "hour_angle"]
Side = Literal["normal", "beyond_pole"]
SPLITS = 80
SAME_S = 1e-3
STEP_S = 0.25
TOO_FAST = ("rate", "keyhole")
"""Lost to these, a target is lagged behind; lost to limits of place, the mount is held."""
TOLD_TURN_DEG = 178.0
"""A new beginning takes the axes to be within half a turn of the meridian: elsewhere none is recommended."""
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

    rule: Rule
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
    path: AxisPath, ability: Ability, rule: Rule, keyholes: list[Keyhole], known: Lost | None = None
) -> Sides:
    """Return what can be done about sides and cables over a path, seen from the normal side, without NaN.

    The path's keyholes are the same from both sides. What the mount loses by itself is `known`, or follows
    from kinematics.
    """
    thinned = path.thinned(max(1, round(STEP_S / float(path.utc_s[1] - path.utc_s[0]))))
    search = _SideSearch.over(thinned, ability, rule, keyholes)
    own = search.by_itself()
    if known is not None:
        own = msgspec.structs.replace(own, lost_s=known.seconds, limit=known.limit)
    best = search.best_split() if own.lost_s > WORTH_S else None
    return sides_of(rule, own, best)


def sides_of(rule: Rule, own: SideOption, best: SideOption | None) -> Sides:
    """Return both ways, and which of them is worth taking."""
    if best is None or best.lost_s > own.lost_s - WORTH_S:
        best = own
    return Sides(rule, own, best, _words(rule, own, best))


@dataclass(frozen=True, slots=True)
class _SideSearch:
    """The path from both sides, and the samples from which following can begin otherwise than before."""

    path: AxisPath
    ability: Ability
    rule: Rule
    keyholes: list[Keyhole]
    views: dict[bool, AxisPath]
    turns: tuple[int, ...]
    """Samples at which the rule's side or the cables' half turn changes, or that are clear again."""

    @classmethod
    def over(cls, path: AxisPath, ability: Ability, rule: Rule, keyholes: list[Keyhole]) -> _SideSearch:
        views = {beyond: path.seen_from(beyond, ability.latitude_deg) for beyond in (False, True)}
        hour_angle = path.pointing.hour_angle_axis_deg
        lower = np.floor((hour_angle + 180.0) / 360.0)
        changes = [np.flatnonzero(np.diff(lower)) + 1]
        if rule == "hour_angle":
            west: Bools = (hour_angle + 180.0) % 360.0 > 180.0
            changes.append(np.flatnonzero(west[:-1] != west[1:]) + 1)
        for view in views.values():
            margins = margins_deg(view.pointing, ability.profile, ability.limits, ability.latitude_deg)
            for name in NO_WAY_ROUND:
                if name in margins:
                    clear: Bools = margins[name] > NEAR_DEG
                    changes.append(np.flatnonzero(~clear[:-1] & clear[1:]) + 1)
        turns = tuple(np.unique(np.concatenate(changes)).tolist())
        return cls(path, ability, rule, keyholes, views, turns)

    def beyond_after_slew(self, index: int) -> bool:
        """Tell on which side a slew to a place of the path ends."""
        hour_angle = wrap180(float(self.path.pointing.hour_angle_axis_deg[index]))
        return self.rule == "hour_angle" and hour_angle > 0.0

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
        known: dict[int, list[ForetoldLoss]] = {}
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
        return view.part(join, len(self.path.utc_s)).wound_anew()

    def _option(
        self, leave: int, join: int, before: list[ForetoldLoss], after: list[ForetoldLoss]
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

    def _joins(self, first: AxisPath, leave: int, before: list[ForetoldLoss]) -> list[int]:
        """Return the samples to begin anew from that are worth a look: the first in reach, and what turns."""
        last = len(self.path.utc_s) - 4
        later = [turn for turn in self.turns if leave < turn <= last]
        if leave == 0:
            return later
        here = self._stands_at(first, leave, before)
        if abs(here[0]) > TOLD_TURN_DEG:
            return []
        step = max(1, len(self.path.utc_s) // 200)
        soonest = next((j for j in range(leave + 1, last, step) if self._in_reach(here, leave, j)), None)
        reached = [join for join in later if self._in_reach(here, leave, join)]
        return reached if soonest is None else [soonest, *reached]

    def _stands_at(self, first: AxisPath, leave: int, before: list[ForetoldLoss]) -> tuple[float, float]:
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
    when = ", ".join(_clock(utc) for utc in flips_utc)
    words = f"{sides.words}; it goes over to the other side at {when}"
    return msgspec.structs.replace(sides, words=words, flips_utc=flips_utc)


def _side(beyond: bool) -> Side:
    return "beyond_pole" if beyond else "normal"


def _worst(lost: list[ForetoldLoss]) -> str | None:
    worst = max(lost, key=lambda loss: loss.seconds, default=None)
    return None if worst is None else worst.limit


def _iso(utc_s: float) -> str:
    return Utc(utc_s).isoformat("seconds")


def _words(rule: Rule, own: SideOption, best: SideOption) -> str:
    side = SIDE_WORDS[own.side]
    if best is own:
        if rule == "never":
            return f"the mount follows from {side}; no slew flips it, and no command chooses"
        return f"the mount follows from {side}, as its rule has it for where the satellite is joined"
    saves = f"{best.lost_s:.0f} s lost instead of {own.lost_s:.0f} s"
    there = SIDE_WORDS[best.again_side or "normal"]
    if best.stop_utc is None:
        return (
            f"by itself the mount begins from {side}; let it begin only at {_clock(best.again_utc)}, "
            f"from {there}: {saves}"
        )
    return (
        f"the mount begins from {side}; stop it at {_clock(best.stop_utc)} and track again: it is on the "
        f"satellite at {_clock(best.again_utc)}, from {there}: {saves}"
    )


def _clock(utc: str | None) -> str:
    return "" if utc is None else utc[11:19]
