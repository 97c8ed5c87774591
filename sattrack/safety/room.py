"""A box of axis angles found clear of regions: what lies within it need not be judged again.

A stream of rates is judged many times a second, in nearly the same place.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from sattrack.safety.regions import Travel, judge_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from sattrack.safety.geometry import Box
    from sattrack.safety.regions import Region

ROOM_DEG = 4.0
"""How far on each side a box is tried to be grown."""
NEAR_ROOM_DEG = 1.0
"""The same for each region by itself, where one of them is too near for room from all."""
TRY_EVERY = 16
"""Judgements from one try that found no room to the next."""


class ClearRoom:
    """The last box found clear of regions that stay as they are, and by what margin."""

    def __init__(self, room_deg: float = ROOM_DEG) -> None:
        self._room_deg = room_deg
        self._box: Box | None = None
        self._margin_deg = 0.0
        self._wait = 0

    def forget(self) -> None:
        """Let the regions have moved."""
        self._box = None
        self._wait = 0

    def holds(self, box: Box, margin_deg: float) -> bool:
        """Tell whether a box is within the one that is known to be clear by this margin."""
        room = self._box
        return (
            room is not None
            and margin_deg <= self._margin_deg
            and room.ha_low_deg <= box.ha_low_deg
            and box.ha_high_deg <= room.ha_high_deg
            and room.dec_low_deg <= box.dec_low_deg
            and box.dec_high_deg <= room.dec_high_deg
        )

    def widen(self, regions: Iterable[Region], box: Box, margin_deg: float) -> None:
        """Look for room about a box that is clear; where there is none, there is no haste to look again.

        What is held at a limit is judged by boxes that have little in common, so the room that is known is
        kept with the new one where all between is clear.
        """
        if self._wait:
            self._wait -= 1
            return
        wide = self._room_deg
        room = box.grown(wide, wide, wide, wide)
        rooms = [room]
        if self._box is not None and margin_deg <= self._margin_deg:
            rooms.insert(0, room.with_box(self._box))
        for one in rooms:
            if all(region.clearance(one).least_deg >= margin_deg for region in regions):
                self._box, self._margin_deg = one, margin_deg
                return
        self._wait = TRY_EVERY


class Memory:
    """Regions that stay as they are, and what is known to be clear of them."""

    def __init__(self, regions: Sequence[Region]) -> None:
        self._regions = regions
        self._of_all = ClearRoom()
        # The ends of a travel are judged faster than looked up.
        self._each = [
            (region, judge_of(region), None if isinstance(region, Travel) else ClearRoom(NEAR_ROOM_DEG))
            for region in regions
        ]

    def violated(self, box: Box, margins: Mapping[str, float], margin_deg: float) -> str | None:
        """Return the name of the first region of which a box is not clear, or None.

        `margins` are those of single regions, which they only lower; `margin_deg` is that of the others.
        """
        if self._of_all.holds(box, margin_deg):
            return None
        for region, is_clear, room in self._each:
            if room is not None and room.holds(box, margin_deg):
                continue
            if not is_clear(box, margins.get(region.name, margin_deg) if margins else margin_deg):
                return region.name
            if room is not None:
                room.widen((region,), box, margin_deg)
        self._of_all.widen(self._regions, box, margin_deg)
        return None
