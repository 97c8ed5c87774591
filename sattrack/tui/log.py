"""The log of runs: phases, warnings, control, ends, a line each; and its screen."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, NamedTuple

from sattrack.tui.look import DIM, SPOKEN
from sattrack.tui.panels import ListPage, Row, rows_content
from sattrack.tui.scene import Tone, why_ended
from sattrack.views import formatting

if TYPE_CHECKING:
    from textual.content import Content

    from sattrack.views.run import SessionView, Summary, TrackView


MOST_LINES = 2000
FILTERS = ("all", "warnings", "people")
"""What is shown: everything, what wanted attention, or what the people before the run did."""
_NUMBERS = re.compile(r"[-+−]?[0-9][0-9.]*")


class LogLine(NamedTuple):
    """One line: when (UTC, POSIX seconds), its tone, its source, and the text."""

    utc_s: float
    tone: Tone
    source: str
    text: str


class LogBook:
    """Lines as they come, a bounded number."""

    def __init__(self) -> None:
        self.lines: list[LogLine] = []
        self.dropped = 0
        """How many old lines were let go."""
        self._phase = self._link = ""
        self._ended_by: str | None = None
        self._warned: set[str] = set()
        self._last_event: str | None = None
        self._utc_s = 0.0

    def take(self, view: TrackView) -> None:
        """Take in a view: what is new in it is a line each."""
        self._utc_s = view.utc_s
        if view.phase != self._phase:
            self._phase = view.phase
            off = "" if view.error is None else f", {formatting.arcsec(view.error.total_arcsec)} off"
            self.say(Tone.CALM, "run", f"{view.name}: {view.phase}{off if view.phase == 'tracking' else ''}")
        if view.link.state != self._link:
            self._link = view.link.state
            tone = Tone.CALM if self._link in {"up", "silent"} else Tone.BAD
            self.say(tone, "warning" if tone is Tone.BAD else "run", f"link {self._link}")
        # A figure that changes in a warning does not make it another one.
        warned = {_NUMBERS.sub("#", text): text for text in view.warnings}
        for key, text in warned.items():
            if key not in self._warned:
                self.say(Tone.NOTICE, "warning", text)
        self._warned = set(warned)
        if view.ended_by != self._ended_by:
            self._ended_by = view.ended_by
            if view.ended_by is not None:
                bad = view.ended_by not in {"set", "operator"}
                self.say(
                    Tone.BAD if bad else Tone.CALM, "warning" if bad else "run", why_ended(view.ended_by)
                )

    def hear(self, session: SessionView) -> None:
        """Take in what happened among the people before the run."""
        if session.said is not None and session.said != self._last_event:
            self.say(Tone.CALM, "people", session.said)
        self._last_event = session.said

    def end(self, summary: Summary) -> None:
        """Take in what a run came to."""
        rms = summary.reported_rms_arcsec
        error = "" if rms is None else f", error {formatting.arcsec(rms)} RMS"
        rest = {True: "at rest", False: "NO STOP CONFIRMED", None: "never heard"}[summary.mount_stopped]
        tone = Tone.BAD if summary.mount_stopped is False else Tone.CALM
        text = f"{summary.name}: {summary.on_target_s:.0f} s on target{error}; mount {rest}"
        self.say(tone, "warning" if tone is Tone.BAD else "run", text)

    def say(self, tone: Tone, source: str, text: str) -> None:
        """Add a line, dated by the last view."""
        self.lines.append(LogLine(self._utc_s, tone, source, text))
        if len(self.lines) > MOST_LINES:
            self.dropped += len(self.lines) - MOST_LINES
            del self.lines[:-MOST_LINES]

    def shown(self, chosen: str) -> list[LogLine]:
        """Return the lines that a filter lets through."""
        source = {"warnings": "warning", "people": "people"}.get(chosen)
        return [one for one in self.lines if source is None or one.source == source]


class LogPage(ListPage):
    """Draws a part of the log. Scrolled back, it keeps its place while lines are added."""

    def __init__(self) -> None:
        super().__init__(id="log")
        self._book = LogBook()
        self._filter = 0
        self._top: LogLine | None = None
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

    def _first(self, lines: list[LogLine]) -> int:
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

    def _row(self, one: LogLine) -> Row:
        return [
            (f"{formatting.clock(one.utc_s)} ", DIM),
            (one.text, SPOKEN[one.tone] if one.source != "run" else ""),
        ]
