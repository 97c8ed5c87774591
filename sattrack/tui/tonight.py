"""The passes to come as a list to choose from: filters, a cursor, what is armed. No drawing, no I/O."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import msgspec

from sattrack.views.messages import Arm, Disarm
from tle.instants import Utc

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from sattrack.views.messages import SessionMessage
    from sattrack.views.run import Armed

SAME_PASS_S = 120.0
HIGH_DEG = 30.0


class PassRow(msgspec.Struct, frozen=True):
    """One pass, as `passes --json` tells it."""

    name: str
    catalog_number: int
    rise_utc: str | None
    culminate_utc: str
    set_utc: str | None
    max_alt_deg: float
    rise_az_deg: float | None
    set_az_deg: float | None
    sunlit_from_utc: str | None
    sunlit_to_utc: str | None
    sun_alt_deg: float | None
    feasible: bool | None
    why_not: str | None

    @property
    def culminate_utc_s(self) -> float:
        """When it culminates, POSIX seconds."""
        return float(Utc.parse(self.culminate_utc).unix_s)

    def is_of(self, catalog_number: int, culminate_utc_s: float) -> bool:
        """Tell whether it is the pass that somebody names so."""
        near = abs(self.culminate_utc_s - culminate_utc_s) < SAME_PASS_S
        return self.catalog_number == catalog_number and near


class Filter(NamedTuple):
    """Which passes are shown, in words and as a test."""

    words: str
    lets: Callable[[PassRow], bool]


FILTERS = (
    Filter("all", lambda _: True),
    Filter("go", lambda row: row.feasible is not False),
    Filter(f"above {HIGH_DEG:g}°", lambda row: row.max_alt_deg >= HIGH_DEG),
    Filter(
        "sunlit by night", lambda row: row.sunlit_from_utc is not None and (row.sun_alt_deg or 0.0) < -6.0
    ),
)


class Night:
    """The passes to come, the one that is pointed at, and what to say to have one followed."""

    def __init__(self) -> None:
        self._all: tuple[PassRow, ...] = ()
        self._filter = 0
        self.rows: tuple[PassRow, ...] = ()
        self.cursor = 0

    @property
    def filter_words(self) -> str:
        """Which passes are shown."""
        return FILTERS[self._filter].words

    @property
    def count(self) -> int:
        """How many there are, shown or not."""
        return len(self._all)

    @property
    def pointed(self) -> PassRow | None:
        """The pass under the cursor."""
        return self.rows[self.cursor] if self.rows else None

    def take(self, rows: Sequence[PassRow]) -> None:
        """Take a new list; the cursor stays on its pass."""
        self._all = tuple(rows)
        self._choose()

    def turn_filter(self) -> None:
        """Go on to the next filter."""
        self._filter = (self._filter + 1) % len(FILTERS)
        self._choose()

    def move(self, by: int) -> None:
        """Point to a pass further down, or up where negative."""
        self.cursor = max(0, min(len(self.rows) - 1, self.cursor + by))

    def point_beside(self, by: int, catalog_number: int, culminate_utc_s: float) -> PassRow | None:
        """Point to the next pass but for the one named, or to the one before; None where there is none."""
        later = [n for n, row in enumerate(self.rows) if row.culminate_utc_s > culminate_utc_s + SAME_PASS_S]
        at = next((n for n, row in enumerate(self.rows) if row.is_of(catalog_number, culminate_utc_s)), None)
        here = at if at is not None else (later[0] if later else len(self.rows)) - (1 if by > 0 else 0)
        goal = here + by
        if not 0 <= goal < len(self.rows):
            return None
        self.cursor = goal
        return self.rows[goal]

    def arm(self, queue: Sequence[Armed], now: bool) -> SessionMessage | None:
        """Return what arms the pass under the cursor, or takes it back where it is armed."""
        row = self.pointed
        if row is None:
            return None
        if not now and any(row.is_of(one.catalog_number, one.culminate_utc_s) for one in queue):
            return Disarm(row.catalog_number, row.culminate_utc_s)
        return Arm(row.catalog_number, row.culminate_utc_s, row.name, now)

    def _choose(self) -> None:
        pointed = self.pointed
        self.rows = tuple(row for row in self._all if FILTERS[self._filter].lets(row))
        self.cursor = 0
        if pointed is not None:
            found = (
                n
                for n, row in enumerate(self.rows)
                if row.is_of(pointed.catalog_number, pointed.culminate_utc_s)
            )
            self.cursor = next(found, 0)


def read_passes(data: bytes) -> tuple[PassRow, ...]:
    """Return the passes of `passes --json`; raises msgspec.MsgspecError."""
    return tuple(msgspec.json.decode(data, type=list[PassRow]))
