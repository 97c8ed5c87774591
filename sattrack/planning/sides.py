"""Sides of the pier and turns of the cables: what the mount will do by itself, and what loses less.

No command of the mount's chooses a side; where its rule flips it, where a slew ends decides. So there are two
choices: from which side to begin, by where the satellite is joined, and whether to stop in mid-pass and slew
on, which lands on the side, and within the half turn of the cables, that the rule has for that place.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import msgspec
import numpy as np

from sattrack.control.acquisition import MARGIN_S, slew_time_s
from sattrack.planning.kinematics import losses
from tle.instants import Utc

if TYPE_CHECKING:
    from sattrack.planning.keyhole import Keyhole
    from sattrack.planning.kinematics import Ability
    from sattrack.planning.path import AxisPath

Rule = Literal["never", "hour_angle"]
SPLITS = 40
STEP_S = 0.25
WORTH_S = 2.0
"""A flip in mid-pass is recommended only where it saves this much."""


class SideOption(msgspec.Struct, frozen=True):
    """One way to take a pass: the side at first, when to flip if at all, and what it loses by kinematics."""

    side: Literal["normal", "beyond_pole"]
    flip_utc: str | None
    lost_s: float
    limit: str | None
    """What most of it is lost to; null where nothing is lost."""


class Sides(msgspec.Struct, frozen=True):
    """What the rule has the mount do, and the best that it lets be chosen."""

    rule: Rule
    by_itself: SideOption
    recommended: SideOption
    words: str


def choose_sides(path: AxisPath, ability: Ability, rule: Rule, keyholes: list[Keyhole]) -> Sides:
    """Return what can be done about sides and cables over a path, seen from the normal side, without NaN.

    The path's keyholes are the same from both sides.
    """
    path = path.thinned(max(1, round(STEP_S / float(path.utc_s[1] - path.utc_s[0]))))
    views = {
        False: path.seen_from(False, ability.latitude_deg),
        True: path.seen_from(True, ability.latitude_deg),
    }
    beyond = _beyond_after_slew(path, 0, rule)
    by_itself = _option(views[beyond], ability, beyond, keyholes)
    best = by_itself
    if by_itself.lost_s > WORTH_S:
        split = _best_split(path, views, ability, rule, keyholes)
        if split is not None and split.lost_s < by_itself.lost_s - WORTH_S:
            best = split
    return Sides(rule, by_itself, best, _words(rule, by_itself, best))


def _beyond_after_slew(path: AxisPath, index: int, rule: Rule) -> bool:
    """Tell on which side a slew to a place of the path ends."""
    hour_angle = (float(path.pointing.hour_angle_axis_deg[index]) + 180.0) % 360.0 - 180.0
    return rule == "hour_angle" and hour_angle > 0.0


def _option(view: AxisPath, ability: Ability, beyond: bool, keyholes: list[Keyhole]) -> SideOption:
    lost = losses(view, ability, keyholes)
    worst = max(lost, key=lambda loss: loss.seconds, default=None)
    return SideOption(
        side="beyond_pole" if beyond else "normal",
        flip_utc=None,
        lost_s=sum(loss.seconds for loss in lost),
        limit=None if worst is None else worst.limit,
    )


def _best_split(
    path: AxisPath, views: dict[bool, AxisPath], ability: Ability, rule: Rule, keyholes: list[Keyhole]
) -> SideOption | None:
    """Return the best way with a stop, a slew on and a new beginning in mid-pass; None without room."""
    first_beyond = _beyond_after_slew(path, 0, rule)
    first = views[first_beyond]
    count = len(path.utc_s)
    best: SideOption | None = None
    for leave in np.unique(np.linspace(2, count - 4, SPLITS).astype(int)).tolist():
        join = _join(path, views, ability, rule, (first, leave))
        if join is None:
            continue
        second = views[_beyond_after_slew(path, join, rule)]
        before = losses(first.part(0, leave + 1), ability, keyholes)
        after = losses(second.part(join, count).wound_anew(), ability, keyholes)
        lost = [*before, *after]
        gap_s = float(path.utc_s[join] - path.utc_s[leave])
        total = gap_s + sum(loss.seconds for loss in lost)
        if best is None or total < best.lost_s:
            worst = max(lost, key=lambda loss: loss.seconds, default=None)
            limit = worst.limit if worst is not None and worst.seconds > gap_s else "flip"
            at = Utc(float(path.utc_s[leave])).isoformat("seconds")
            best = SideOption("beyond_pole" if first_beyond else "normal", at, total, limit)
    return best


def _join(
    path: AxisPath,
    views: dict[bool, AxisPath],
    ability: Ability,
    rule: Rule,
    leaving: tuple[AxisPath, int],
) -> int | None:
    """Return the first sample that a slew from one of the first way's can be at in time; None if none."""
    first, leave = leaving
    count = len(path.utc_s)
    here = first.pointing.hour_angle_axis_deg[leave], first.pointing.dec_axis_deg[leave]
    for join in range(leave + 1, count - 2, max(1, count // 200)):
        second = views[_beyond_after_slew(path, join, rule)].part(join, count).wound_anew()
        there = second.pointing.hour_angle_axis_deg[0], second.pointing.dec_axis_deg[0]
        takes_s = MARGIN_S + max(
            slew_time_s(float(there[0] - here[0]), ability.profile.ra),
            slew_time_s(float(there[1] - here[1]), ability.profile.dec),
        )
        if path.utc_s[join] - path.utc_s[leave] >= takes_s:
            return join
    return None


def _words(rule: Rule, by_itself: SideOption, best: SideOption) -> str:
    side = {"normal": "the normal side", "beyond_pole": "beyond the pole"}[by_itself.side]
    if best is not by_itself:
        return (
            f"the mount begins from {side}; stop at {best.flip_utc} and follow anew from there: "
            f"{best.lost_s:.0f} s lost instead of {by_itself.lost_s:.0f} s"
        )
    if rule == "never":
        return f"the mount follows from {side}; its rule never flips it, and no command chooses"
    return f"the mount follows from {side}, as its rule has it for where the satellite is joined"
