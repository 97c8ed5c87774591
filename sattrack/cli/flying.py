"""Runs in real time, one after another, before whoever started them and everybody who looks on."""

from __future__ import annotations

import os
import sys
import time
from typing import TYPE_CHECKING

import click

from sattrack.cli.running import Stream, tell_malformed
from sattrack.core.errors import SattrackError
from sattrack.runtime.desk import ControlArbiter, SessionInbox, StdinInbox
from sattrack.runtime.fly import fly_live
from sattrack.runtime.gallery_link import ViewServerLink, open_view_server
from sattrack.runtime.observers import open_observers
from sattrack.runtime.signals import StopRequest, stopping
from sattrack.views.run import SummaryLine
from tle.errors import TleError

if TYPE_CHECKING:
    from collections.abc import Callable

    from sattrack.cli.running import Progress
    from sattrack.runtime.facts import RunFacts
    from sattrack.runtime.prepare import Prepared
    from sattrack.views.run import Armed, SessionView, Summary, TrackView

IDLE_S = 0.05


class Public:
    """Everybody whom runs are shown to: whoever started them, and those who look on."""

    def __init__(self, told: Progress | Stream, desk: ControlArbiter, gallery: ViewServerLink | None) -> None:
        self._told, self._desk, self._gallery = told, desk, gallery
        self._version = -1
        self.left = False
        """Whether whoever started the runs has gone, and nobody reads what is written."""

    @property
    def screened(self) -> bool:
        """Whether whoever started the runs has a screen on them, and is there."""
        return isinstance(self._told, Stream) and self._told.tells_session and not self.left

    def begin(self, facts: RunFacts) -> None:
        """Say what does not change during a run, before it, where it is not the first."""
        if isinstance(self._told, Stream) and self.screened:
            self._told.tell_scene(facts)
        if self._gallery is not None:
            self._gallery.begin(facts)

    def show(self, view: TrackView) -> None:
        """Take one state, and say who has control where that has changed."""
        self.look()
        self._told.show(view)
        if self._gallery is not None:
            self._gallery.show(view)

    def look(self) -> None:
        """Say who has control where that has changed."""
        version = self._desk.version
        if version != self._version and self._tell_session():
            self._version = version

    def end(self, summary: Summary) -> None:
        """Say what the run came to."""
        self.look()
        if isinstance(self._told, Stream) and self.screened:
            self._told.write_whole(SummaryLine(summary))
        if self._gallery is not None:
            self._gallery.tell_end(summary)

    def _tell_session(self) -> bool:
        if self._gallery is None:
            return True
        session = self._desk.view()
        if isinstance(self._told, Stream) and not self.left:
            self._tell_starter(self._told, session)
        return self._gallery.tell(session)

    def _tell_starter(self, told: Stream, session: SessionView) -> None:
        told.tell_session(session)
        if session.left_running:
            # Whoever started the run goes at this word: nothing must be written to nobody.
            self.left = True
            _write_nowhere()


def _write_nowhere() -> None:
    """Have whatever goes to standard output from now on be lost, and nobody waited for."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, sys.stdout.fileno())
    os.close(nowhere)


def fly_and_tell(
    prepared: Prepared,
    told: Progress | Stream,
    control: bool,
    deadline_s: float = float("inf"),
    observations: str | None = None,
    again: Callable[[Armed, Prepared], Prepared] | None = None,
) -> tuple[Summary, bool]:
    """Fly a run in real time, and what is armed after it; return the last summary, and whether a signal came.

    With `control`, messages come on standard input; which of them did nothing is said at the end. With
    `observations`, what `--observations` takes, observations come from there. `again` prepares a pass that
    was armed during the one before; None where that cannot be. A screen on it is waited for after a run, as
    long as it is there: what is armed then begins at once.
    """
    stop = StopRequest()
    observers = open_observers(observations)
    stdin = StdinInbox(observers) if control else None
    listening = observers if control or observations else None
    gallery = open_view_server(prepared.facts)
    desk = ControlArbiter(control, again is not None)
    public = Public(told, desk, gallery)
    inbox = SessionInbox(desk, stdin, gallery)
    try:
        with stopping(stop):
            summary = fly_live(prepared, public.show, stop, inbox, deadline_s, listening)
            public.end(summary)
            while again is not None and (following := _next(prepared, again, stop, public, inbox, desk)):
                prepared = following
                public.begin(prepared.facts)
                summary = fly_live(prepared, public.show, stop, inbox, deadline_s, listening)
                public.end(summary)
    finally:
        observers.close()
        if gallery is not None:
            gallery.close()
    told.end()
    for words in () if stdin is None else stdin.ignored:
        click.echo(f"sattrack: {words}", err=True)
    tell_malformed(observers)
    return summary, stop.asked


def _next(
    before: Prepared,
    again: Callable[[Armed, Prepared], Prepared],
    stop: StopRequest,
    public: Public,
    inbox: SessionInbox,
    desk: ControlArbiter,
) -> Prepared | None:
    """Return the run that is armed, prepared; where none is, wait for one while there is a screen."""
    while not stop.asked:
        armed = desk.take_next()
        if armed is not None:
            try:
                return again(armed, before)
            except (SattrackError, TleError) as error:
                desk.say(f"{armed.name or armed.catalog_number} cannot be followed: {error}")
        elif not public.screened or _left(inbox):
            return None
        public.look()
        if armed is None:
            time.sleep(IDLE_S)
    return None


def _left(inbox: SessionInbox) -> bool:
    """Hear what is said after a run, and tell whether whoever started it has gone.

    A stop has taken back what was armed; there is nothing else to stop.
    """
    inbox.messages()
    return inbox.ended
