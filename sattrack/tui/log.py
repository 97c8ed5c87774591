"""What was said during runs, line by line: phases, warnings, control, ends. No drawing."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, NamedTuple

from sattrack.tui import words
from sattrack.tui.scene import Tone, why_ended

if TYPE_CHECKING:
    from sattrack.views.run import SessionView, Summary, TrackView

MOST_LINES = 2000
FILTERS = ("all", "warnings", "people")
"""What is shown: everything, what wanted attention, or what the people before the run did."""
_NUMBERS = re.compile(r"[-+−]?[0-9][0-9.]*")


class Said(NamedTuple):
    """One line: when (UTC, POSIX seconds), how loud, who said it, and the words."""

    utc_s: float
    tone: Tone
    source: str
    text: str


class LogBook:
    """Lines as they come, a bounded number."""

    def __init__(self) -> None:
        self.lines: list[Said] = []
        self.dropped = 0
        """How many old lines were let go."""
        self._phase = self._link = ""
        self._ended_by: str | None = None
        self._warned: set[str] = set()
        self._said: str | None = None
        self._utc_s = 0.0

    def take(self, view: TrackView) -> None:
        """Take in a view: what is new in it is a line each."""
        self._utc_s = view.utc_s
        if view.phase != self._phase:
            self._phase = view.phase
            off = "" if view.error is None else f", {words.arcsec(view.error.total_arcsec)} off"
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
        if session.said is not None and session.said != self._said:
            self.say(Tone.CALM, "people", session.said)
        self._said = session.said

    def end(self, summary: Summary) -> None:
        """Take in what a run came to."""
        rms = summary.reported_rms_arcsec
        error = "" if rms is None else f", error {words.arcsec(rms)} RMS"
        rest = {True: "at rest", False: "NO STOP CONFIRMED", None: "never heard"}[summary.mount_stopped]
        tone = Tone.BAD if summary.mount_stopped is False else Tone.CALM
        text = f"{summary.name}: {summary.on_target_s:.0f} s on target{error}; mount {rest}"
        self.say(tone, "warning" if tone is Tone.BAD else "run", text)

    def say(self, tone: Tone, source: str, text: str) -> None:
        """Add a line, dated by the last view."""
        self.lines.append(Said(self._utc_s, tone, source, text))
        if len(self.lines) > MOST_LINES:
            self.dropped += len(self.lines) - MOST_LINES
            del self.lines[:-MOST_LINES]

    def shown(self, chosen: str) -> list[Said]:
        """Return the lines that a filter lets through."""
        source = {"warnings": "warning", "people": "people"}.get(chosen)
        return [one for one in self.lines if source is None or one.source == source]
