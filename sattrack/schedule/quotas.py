"""Rules that take each satellite once, or so many passes an hour: sets of which only so many are chosen."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from sattrack.schedule.packing import Packing
from tle.instants import DAY_S

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from sattrack.schedule.candidates import Candidate
    from sattrack.schedule.file import Schedule
    from tle.site import Site

ONCE, TAKEN, HOUR_FULL = "once", "taken", "hour full"
HOUR_S, NOON_S, S_PER_DEG = 3600.0, 43200.0, 240.0


def packings_of(schedule: Schedule, candidates: Sequence[Candidate], site: Site) -> list[Packing]:
    """Return the sets of candidates, by number, of which a schedule's rules take only so many."""
    noon_s = NOON_S - S_PER_DEG * site.longitude_deg
    found: list[Packing] = []
    for number, entry in enumerate(schedule.entries):
        c = entry.conditions
        asked = [one for one in candidates if one.entry == number and one.lost is None]
        if c.once_a_run or c.once_a_night:
            found += _once(asked, c.once_a_run, noon_s)
        if c.most_an_hour is not None:
            found += _an_hour(asked, c.most_an_hour)
    return found


def _once(asked: Sequence[Candidate], a_run: bool, noon_s: float) -> Iterator[Packing]:
    """Give the passes of each satellite; nights change at the site's mean noon."""
    sets: dict[tuple[int, int], set[int]] = {}
    for one in asked:
        night = 0 if a_run else math.floor((one.culminate_utc_s - noon_s) / DAY_S)
        sets.setdefault((one.elements.catalog_number, night), set()).add(one.number)
    words = f"the rule takes each satellite once a {'run' if a_run else 'night'}"
    for members in sets.values():
        if len(members) > 1:
            yield Packing(frozenset(members), 1, ONCE, words)


def _an_hour(asked: Sequence[Candidate], most: int) -> Iterator[Packing]:
    """Give the passes that culminate within an hour, for each hour that begins with one of them."""
    ordered = sorted(asked, key=lambda one: one.culminate_utc_s)
    words = f"the rule takes {most} an hour"
    end, before = 0, frozenset[int]()
    for begin, first in enumerate(ordered):
        while end < len(ordered) and ordered[end].culminate_utc_s < first.culminate_utc_s + HOUR_S:
            end += 1
        members = frozenset(one.number for one in ordered[begin:end])
        # An hour whose passes are all of the one before asks for nothing new.
        if len(members) > most and not members <= before:
            yield Packing(members, most, HOUR_FULL, words)
            before = members
