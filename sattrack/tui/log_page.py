"""The log as a screen: it follows what is said, unless it was scrolled back."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sattrack.tui import words
from sattrack.tui.log import FILTERS, LogBook, Said
from sattrack.tui.look import DIM, SPOKEN
from sattrack.tui.panels import Redrawn, Row, rows_content

if TYPE_CHECKING:
    from textual.content import Content
    from textual.events import MouseScrollDown, MouseScrollUp

WHEEL_ROWS = 3


class LogPage(Redrawn):
    """Draws a part of the log. Scrolled back, it keeps its place whatever is said meanwhile."""

    def __init__(self) -> None:
        super().__init__(id="log")
        self._book = LogBook()
        self._filter = 0
        self._top: Said | None = None
        """The first line shown; None where it follows."""

    def draw(self, book: LogBook) -> None:
        """Take the log; nothing is redrawn where nothing has changed."""
        self._book = book
        self.renew()

    def turn_filter(self) -> None:
        """Go on to the next filter."""
        self._filter = (self._filter + 1) % len(FILTERS)
        self._top = None
        self.refresh()

    def move(self, rows: int) -> None:
        """Scroll by so many rows, down where positive; at the end it follows again."""
        lines = self._book.shown(FILTERS[self._filter])
        first = max(0, min(self._first(lines) + rows, len(lines) - self._room))
        self._top = None if first >= len(lines) - self._room else lines[first]
        self.refresh()

    def page(self, pages: int) -> None:
        """Scroll by so many screens."""
        self.move(pages * max(1, self._room - 1))

    def on_mouse_scroll_up(self, event: MouseScrollUp) -> None:
        """Scroll back."""
        event.stop()
        self.move(-WHEEL_ROWS)

    def on_mouse_scroll_down(self, event: MouseScrollDown) -> None:
        """Scroll on."""
        event.stop()
        self.move(WHEEL_ROWS)

    @property
    def _room(self) -> int:
        return max(1, self.content_size.height - 1)

    def _first(self, lines: list[Said]) -> int:
        if self._top is not None and self._top in lines:
            return lines.index(self._top)
        return max(0, len(lines) - self._room)

    def _content(self) -> Content:
        chosen = FILTERS[self._filter]
        lines = self._book.shown(chosen)
        first = self._first(lines)
        shown = lines[first : first + self._room]
        later = len(lines) - first - len(shown)
        place = "the newest" if later == 0 else f"{later} later ones below"
        head: Row = [("log ", DIM), (chosen, "bold"), (f"   {len(lines)} lines, {place}", DIM)]
        return rows_content([head, *(self._row(one) for one in shown)])

    def _row(self, one: Said) -> Row:
        return [
            (f"{words.clock(one.utc_s)} ", DIM),
            (one.text, SPOKEN[one.tone] if one.source != "run" else ""),
        ]
