"""Where the schedule is that a run belongs to, as a screen."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sattrack.tui import words
from sattrack.tui.look import DIM, PLATE, SPOKEN
from sattrack.tui.panels import Redrawn, Row, rows_content
from sattrack.tui.scene import Tone
from tle.instants import Utc

if TYPE_CHECKING:
    from textual.content import Content

    from sattrack.schedule_view import PassView, ScheduleView

NAME_CELLS = 24
HEAD_ROWS = 4
TONES = {"done": Tone.GOOD, "in progress": Tone.CALM, "partly": Tone.NOTICE, "lost": Tone.BAD}
NO_SCHEDULE = "this run is of no schedule; `sattrack run FILE` runs one"


class SchedulePage(Redrawn):
    """Draws what the runner of a schedule says of it, the passes about the present one."""

    def __init__(self) -> None:
        super().__init__(id="schedule")
        self._view: ScheduleView | None = None
        self._trouble = ""
        self._below = 0
        """How far it was scrolled from where it stands by itself."""

    def draw(self, view: ScheduleView | None, trouble: str) -> None:
        """Take what was said last; nothing is redrawn where nothing has changed."""
        self._view, self._trouble = view, trouble
        self.renew()

    def move(self, rows: int) -> None:
        """Scroll."""
        count = 0 if self._view is None else len(self._view.passes)
        self._below = max(-count, min(count, self._below + rows))
        self.refresh()

    def page(self, pages: int) -> None:
        """Scroll by screens."""
        self.move(pages * max(1, self._room - 1))

    @property
    def _room(self) -> int:
        return max(1, self.content_size.height - HEAD_ROWS)

    def _content(self) -> Content:
        view = self._view
        if view is None:
            return rows_content([[(self._trouble or NO_SCHEDULE, DIM)]])
        first = self._first(view)
        shown = view.passes[first : first + self._room]
        return rows_content([*self._head(view), *(self._row(view, one) for one in shown)])

    def _first(self, view: ScheduleView) -> int:
        """Return the first pass shown: by itself, one pass before the present or the next one."""
        at = view.current if view.current is not None else view.next_number
        here = next((n for n, one in enumerate(view.passes) if one.number == at), 0)
        last = max(0, len(view.passes) - self._room)
        return max(0, min(last, here - 1 + self._below))

    def _head(self, view: ScheduleView) -> list[Row]:
        state = (f" {view.state.upper()} ", PLATE[Tone.CALM if view.running else Tone.BAD])
        doing = view.doing if view.running else "its runner has ended"
        done = sum(one.state == "done" for one in view.passes)
        second: Row = [
            ("night ", DIM),
            f"{view.night}",
            ("   passes ", DIM),
            f"{done} of {len(view.passes)} done",
        ]
        if view.next_in_s is not None:
            second += [("   next in ", DIM), words.span(view.next_in_s)]
        second += [("   mount ", DIM), view.mount]
        if view.weather:
            second += [("   ", DIM), view.weather]
        note: Row = [(view.notes[-1], SPOKEN[Tone.NOTICE])] if view.notes else []
        columns = f"  {'from':<9}{'highest':<9}{'to':<9}{'alt':>4}  {'satellite':<{NAME_CELLS}}  "
        return [[state, " ", (doing, "bold"), (f"   {view.schedule}", DIM)], second, note, [(columns, DIM)]]

    def _row(self, view: ScheduleView, one: PassView) -> Row:
        name = one.name if len(one.name) <= NAME_CELLS else one.name[: NAME_CELLS - 1] + "…"
        times = "".join(f"{_clock(utc):<9}" for utc in (one.start_utc, one.culminate_utc, one.end_utc))
        mark = "▶ " if one.number in {view.current, view.next_number} else "  "
        row: Row = [(mark, "bold"), f"{times}{one.max_alt_deg:3.0f}°  {name:<{NAME_CELLS}}  "]
        row.append((one.state, SPOKEN[TONES[one.state]] if one.state in TONES else DIM))
        if one.rms_arcsec is not None:
            row.append(f"  {words.arcsec(one.rms_arcsec)}")
        if one.words:
            row.append((f"  {one.words}", DIM))
        return row


def _clock(utc: str) -> str:
    return words.clock(float(Utc.parse(utc).unix_s))
