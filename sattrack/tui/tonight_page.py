"""The passes to come as a screen."""

from __future__ import annotations

from typing import TYPE_CHECKING

from textual.content import Content

from sattrack.tui import words
from sattrack.tui.look import DIM, PLATE, SPOKEN
from sattrack.tui.panels import Redrawn, Row, rows_content
from sattrack.tui.scene import Tone

if TYPE_CHECKING:
    from collections.abc import Sequence

    from textual.events import Click, MouseScrollDown, MouseScrollUp

    from sattrack.tui.scene import Scene
    from sattrack.tui.tonight import Night, PassRow
    from sattrack.views.run import Armed

NAME_CELLS = 24
HEAD_ROWS = 2
FOOT_ROWS = 2
WHEEL_ROWS = 3


class TonightPage(Redrawn):
    """Draws the list about its cursor, and what is to be known of the pass under it."""

    def __init__(self) -> None:
        super().__init__(id="tonight")
        self._night: Night | None = None
        self._scene: Scene | None = None
        self._state = ""
        self._first = 0

    def draw(self, night: Night, scene: Scene | None, state: str) -> None:
        """Take the list and the run that goes on; `state` says what is going on with the search."""
        self._night, self._scene, self._state = night, scene, state
        self.renew()

    def page(self, pages: int) -> None:
        """Move the cursor by so many screens."""
        if self._night is not None:
            self._night.move(pages * max(1, self._room - 1))
            self.refresh()

    def on_click(self, event: Click) -> None:
        """Point to the row that was clicked."""
        row = event.y - HEAD_ROWS
        if self._night is not None and 0 <= row < self._room:
            self._night.move(self._first + row - self._night.cursor)
            self.refresh()

    def on_mouse_scroll_up(self, event: MouseScrollUp) -> None:
        """Move the cursor up."""
        event.stop()
        self._wheel(-WHEEL_ROWS)

    def on_mouse_scroll_down(self, event: MouseScrollDown) -> None:
        """Move the cursor down."""
        event.stop()
        self._wheel(WHEEL_ROWS)

    def _wheel(self, rows: int) -> None:
        if self._night is not None:
            self._night.move(rows)
            self.refresh()

    @property
    def _room(self) -> int:
        return max(1, self.content_size.height - HEAD_ROWS - FOOT_ROWS)

    def _content(self) -> Content:
        night = self._night
        if night is None:
            return Content("")
        last = max(0, len(night.rows) - self._room)
        self._first = min(last, max(night.cursor - self._room + 1, min(self._first, night.cursor)))
        shown = night.rows[self._first : self._first + self._room]
        head: Row = [("passes to come ", DIM), (night.filter_words, "bold")]
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
    """Return what is to be known of a pass, in two rows."""
    if row is None:
        return [[], []]
    way: Row = [(f"{row.catalog_number}  ", DIM)]
    if row.rise_az_deg is not None and row.set_az_deg is not None:
        way += [("from ", DIM), words.azimuth(row.rise_az_deg), (" to ", DIM), words.azimuth(row.set_az_deg)]
    lit = "in shadow throughout"
    if row.sunlit_from_utc is not None:
        lit = f"sunlit {words.iso_clock(row.sunlit_from_utc)} to {words.iso_clock(row.sunlit_to_utc)}"
    way.append((f"  {lit}", DIM))
    verdict: Row = [("the mount can follow it", DIM)] if row.feasible else []
    if row.why_not:
        verdict = [("no-go: ", SPOKEN[Tone.BAD]), row.why_not]
    return [way, verdict]
