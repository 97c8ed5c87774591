"""The passes to come: a list to choose from, with filters, a cursor and what is armed; and its screen."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from textual.content import Content

from sattrack.tui import words
from sattrack.tui.look import DIM, PLATE, SPOKEN
from sattrack.tui.panels import ListPage, Row, rows_content
from sattrack.tui.scene import Tone
from sattrack.views.messages import Arm, Disarm
from sattrack.views.run import SAME_PASS_S

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from textual.events import Click

    from sattrack.tui.beside import PassRow
    from sattrack.tui.scene import Scene
    from sattrack.views.messages import SessionMessage
    from sattrack.views.run import Armed

HIGH_DEG = 30.0


class Filter(NamedTuple):
    """A label of which passes are shown, and the test."""

    label: str
    lets: Callable[[PassRow], bool]


FILTERS = (
    Filter("all", lambda _: True),
    Filter("go", lambda row: row.feasible is not False),
    Filter(f"above {HIGH_DEG:g}°", lambda row: row.max_alt_deg >= HIGH_DEG),
    Filter(
        "sunlit by night", lambda row: row.sunlit_from_utc is not None and (row.sun_alt_deg or 0.0) < -6.0
    ),
)


class PassList:
    """The passes to come, the one that is pointed at, and what to say to have one followed."""

    def __init__(self) -> None:
        self._all: tuple[PassRow, ...] = ()
        self._filter = 0
        self.rows: tuple[PassRow, ...] = ()
        self.cursor = 0

    @property
    def filter_label(self) -> str:
        """Which passes are shown."""
        return FILTERS[self._filter].label

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

    def point_beside(self, by: int, catalog_number: int | None, culminate_utc_s: float) -> PassRow | None:
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


NAME_CELLS = 24
HEAD_ROWS = 2


class TonightPage(ListPage):
    """Draws the list about its cursor, and details of the pass under it."""

    rows_that_stay = HEAD_ROWS + 2

    def __init__(self) -> None:
        super().__init__(id="tonight")
        self._night: PassList | None = None
        self._scene: Scene | None = None
        self._state = ""
        self._first = 0

    def draw(self, night: PassList, scene: Scene | None, state: str) -> None:
        """Take the list and the run that goes on; `state` says what is going on with the search."""
        self._night, self._scene, self._state = night, scene, state
        self.renew()

    def move(self, rows: int) -> None:
        """Move the cursor by so many rows."""
        if self._night is not None:
            self._night.move(rows)
            self.refresh()

    def turn_filter(self) -> None:
        """Go on to the next filter."""
        if self._night is not None:
            self._night.turn_filter()

    def on_click(self, event: Click) -> None:
        """Point to the row that was clicked."""
        row = event.y - HEAD_ROWS
        if self._night is not None and 0 <= row < self._room:
            self.move(self._first + row - self._night.cursor)

    def _content(self) -> Content:
        night = self._night
        if night is None:
            return Content("")
        last = max(0, len(night.rows) - self._room)
        self._first = min(last, max(night.cursor - self._room + 1, min(self._first, night.cursor)))
        shown = night.rows[self._first : self._first + self._room]
        head: Row = [("passes to come ", DIM), (night.filter_label, "bold")]
        head.append((f"   {len(night.rows)} of {night.count}", DIM))
        if self._state:
            head += ["   ", (self._state, SPOKEN[Tone.NOTICE])]
        else:
            head += ["   ", ("Enter", "bold"), (" arms  ", DIM), ("a", "bold"), (" follows now  ", DIM)]
            head += [("f", "bold"), (" filters", DIM)]
        columns: Row = [
            (f"  {'rise':<9}{'highest':<9}{'set':<9}{'alt':>4}  {'satellite':<{NAME_CELLS}}  ", DIM)
        ]
        rows = [head, columns]
        rows += [self._row(row, self._first + n == night.cursor) for n, row in enumerate(shown)]
        rows += [[] for _ in range(self._room - len(shown))]
        return rows_content([*rows, *_about(night.pointed)])

    def _row(self, row: PassRow, pointed: bool) -> Row:
        style = "reverse" if pointed else ""
        name = words.fitted(row.name, NAME_CELLS)
        rise = "is up" if row.rise_utc is None else words.iso_clock(row.rise_utc)
        times = (rise, words.iso_clock(row.culminate_utc), words.iso_clock(row.set_utc))
        text = "".join(f"{time:<9}" for time in times)
        text += f"{row.max_alt_deg:3.0f}°  {name}"
        return [("▶ " if pointed else "  ", "bold"), (text, style), "  ", *self._verdict(row)]

    def _verdict(self, row: PassRow) -> Row:
        scene = self._scene
        queue: Sequence[Armed] = () if scene is None or scene.session is None else scene.session.queue
        for place, one in enumerate(queue, start=1):
            if row.is_of(one.catalog_number, one.culminate_utc_s):
                return [(f" armed {place} ", PLATE[Tone.CALM])]
        if scene is not None and row.is_of(scene.view.catalog_number, scene.view.culminate_utc_s):
            return [
                (" over " if scene.ended else " this one ", PLATE[Tone.CALM if scene.ended else Tone.GOOD])
            ]
        if row.feasible is None:
            return [(words.NOTHING, DIM)]
        return [("go", SPOKEN[Tone.GOOD])] if row.feasible else [("NO-GO", SPOKEN[Tone.BAD])]


def _about(row: PassRow | None) -> list[Row]:
    """Return details of a pass, in two rows."""
    if row is None:
        return [[], []]
    path: Row = [(f"{row.catalog_number}  ", DIM)]
    if row.rise_az_deg is not None and row.set_az_deg is not None:
        path += [("from ", DIM), words.azimuth(row.rise_az_deg), (" to ", DIM), words.azimuth(row.set_az_deg)]
    lit = "in shadow throughout"
    if row.sunlit_from_utc is not None:
        lit = f"sunlit {words.iso_clock(row.sunlit_from_utc)} to {words.iso_clock(row.sunlit_to_utc)}"
    path.append((f"  {lit}", DIM))
    verdict: Row = [("the mount can follow it", DIM)] if row.feasible else []
    if row.why_not:
        verdict = [("no-go: ", SPOKEN[Tone.BAD]), row.why_not]
    return [path, verdict]
