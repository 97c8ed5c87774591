"""Where the schedule is that a run belongs to, as a screen."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sattrack.tui.look import DIM, PLATE, SPOKEN
from sattrack.tui.panels import ListPage, Row, fitted, rows_content
from sattrack.tui.scene import Tone
from sattrack.views import formatting
from tle.instants import Utc

if TYPE_CHECKING:
    from textual.content import Content

    from sattrack.views.schedule import SchedulePassView, ScheduleView

NAME_CELLS, SHORT_NAME_CELLS = 24, 18
ROOM_FOR_LONG_NAMES = 100
FOLLOWING, WAITING, IN_PROGRESS = "following", "waiting", "in progress"
TONES = {"done": Tone.GOOD, IN_PROGRESS: Tone.CALM, "partly": Tone.NOTICE, "lost": Tone.BAD}
RESULTS = ("done", "partly", "lost")
OVER = {
    "ended": ("the schedule is over", Tone.CALM),
    "stopped": ("its runner has ended; run it again to go on", Tone.NOTICE),
}
"""The text for a schedule that nobody runs, by its last state."""
NO_SCHEDULE = "this run is of no schedule; `sattrack run FILE` runs one"


class SchedulePage(ListPage):
    """Draws what the runner of a schedule says of it, the passes about the present one."""

    rows_that_stay = 4

    def __init__(self) -> None:
        super().__init__(id="schedule")
        self._view: ScheduleView | None = None
        self._trouble = ""
        self._below = 0
        """How far it was scrolled from where it stands by itself."""

    def draw(self, view: ScheduleView | None, trouble: str) -> None:
        """Take the newest status; nothing is redrawn where nothing has changed."""
        self._view, self._trouble = view, trouble
        self.renew()

    def move(self, rows: int) -> None:
        """Scroll."""
        count = 0 if self._view is None else len(self._view.passes)
        self._below = max(-count, min(count, self._below + rows))
        self.refresh()

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
        # What it does often begins with the very word.
        doing, tone = view.doing.removeprefix(view.state).strip(), Tone.CALM
        if not view.running:
            doing, tone = OVER.get(view.state, ("its runner has ended", Tone.BAD))
            if view.stopped_utc is not None:
                doing = f"by an operator; {view.resume}"
        elif view.old and view.age_s is not None:
            doing, tone = f"{doing}   NO NEWS for {formatting.span(view.age_s)}", Tone.BAD
        state = (f" {view.state.upper()} ", PLATE[tone])
        second: Row = [("night ", DIM), f"{view.night}", "   ", *_count(view)]
        left_s = next_in_s(view)
        if left_s is not None:
            second += [("   next in ", DIM), formatting.span(left_s)]
        second += [("   mount ", DIM), view.mount]
        if view.weather:
            second += [("   ", DIM), view.weather]
        note: Row = [(view.notes[-1], SPOKEN[Tone.NOTICE])] if view.notes else []
        columns = f"  {'from':<9}{'highest':<9}{'to':<9}{'alt':>4}  {'satellite':<{self._name_cells}}  "
        return [[state, " ", (doing, "bold"), (f"   {view.schedule}", DIM)], second, note, [(columns, DIM)]]

    @property
    def _name_cells(self) -> int:
        return NAME_CELLS if self.content_size.width >= ROOM_FOR_LONG_NAMES else SHORT_NAME_CELLS

    def _row(self, view: ScheduleView, one: SchedulePassView) -> Row:
        name = fitted(one.name, self._name_cells)
        times = "".join(
            f"{formatting.iso_clock(utc):<9}" for utc in (one.start_utc, one.culminate_utc, one.end_utc)
        )
        mark = "▶ " if one.number in {view.current, view.next_number} else "  "
        row: Row = [(mark, "bold"), f"{times}{one.max_alt_deg:3.0f}°  {name}  "]
        return [*row, *_state(view, one)]


def schedule_text(view: ScheduleView) -> str:
    """Return what a runner does between two runs, and in how long the next pass begins."""
    left_s = next_in_s(view)
    if view.state == FOLLOWING:
        # It is from the time of the run that is over.
        coming = _coming(view)
        doing = "its schedule goes on" if coming is None else f"next {coming.name}"
    else:
        doing = view.doing
    return doing if left_s is None else f"{doing}, in {formatting.span(left_s)}"


def next_in_s(view: ScheduleView) -> float | None:
    """Return in how many seconds the next pass begins; None where none is to come, or it has begun."""
    coming = _coming(view)
    left_s = 0.0 if coming is None else _utc_s(coming.start_utc) - view.utc_s
    return left_s if view.running and left_s > 0.0 else None


def _coming(view: ScheduleView) -> SchedulePassView | None:
    return next((one for one in view.passes if one.state == WAITING), None)


def _count(view: ScheduleView) -> Row:
    """Return how many passes came to what."""
    states = [one.state for one in view.passes]
    row: Row = [f"{states.count('done')} of {len(states)} done"]
    for state in ("partly", "lost"):
        if state in states:
            row += [", ", (f"{states.count(state)} {state}", SPOKEN[TONES[state]])]
    return row


def _state(view: ScheduleView, one: SchedulePassView) -> Row:
    """Return the outcome of a pass, or the time to its beginning or end."""
    coming_s, left_s = _utc_s(one.start_utc) - view.utc_s, _utc_s(one.end_utc) - view.utc_s
    if not view.running:
        coming_s = left_s = 0.0
    if coming_s > 0.0 and (one.number == view.current or one is _coming(view)):
        return [("in ", DIM), (formatting.span(coming_s), "bold")]
    row: Row = [(one.state, SPOKEN[TONES[one.state]] if one.state in TONES else DIM)]
    if one.state == IN_PROGRESS and left_s > 0.0:
        row.append((f" {formatting.span(left_s)}", "bold"))
    if one.state in RESULTS and one.on_target_s:
        row.append(f" {one.on_target_s:.0f} s")
    if one.rms_arcsec is not None:
        row.append(f"  {formatting.arcsec(one.rms_arcsec)}")
    if one.words or one.cause:
        row.append((f"  {one.words or one.cause}", DIM))
    return row


def _utc_s(utc: str) -> float:
    return float(Utc.parse(utc).unix_s)
