"""What `track` and `demo` share: runs one after another, progress, the summary, the exit code."""

from __future__ import annotations

import math
import os
import sys
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

import click
import msgspec

from sattrack.cli.common import JsonLines, renew, tell
from sattrack.cli.screened import can_draw_lines_anew
from sattrack.core.errors import BadInputError, SattrackError
from sattrack.runtime.desk import ControlArbiter, SessionInbox, StdinInbox
from sattrack.runtime.fly import fly_live
from sattrack.runtime.gallery_link import ViewServerLink, open_view_server
from sattrack.runtime.observers import Observers, check_source, open_observers
from sattrack.runtime.outcome import failure
from sattrack.runtime.signals import StopRequest, stopping
from sattrack.views.run import Summary, SummaryLine, TrackView
from sattrack.views.summary_text import summary_lines
from tle.errors import TleError
from tle.instants import Utc

if TYPE_CHECKING:
    from collections.abc import Callable

    from sattrack.runtime.facts import RunFacts
    from sattrack.runtime.prepare import Prepared
    from sattrack.views.run import Armed, SessionView

SECONDS_BETWEEN_LINES = 5.0
OLD_AFTER_DAYS = 3.0
TELLING_DELAY_S = 0.0005
IDLE_S = 0.05


@dataclass(slots=True)
class Progress:
    """Tells on standard error how a run goes: a line that renews itself on a terminal, else one now and then.

    With `quiet_off_terminal`, nothing is shown but on a terminal.
    """

    quiet_off_terminal: bool
    _phase: str = ""
    _told_utc_s: float = float("-inf")

    def show(self, view: TrackView) -> None:
        """Take one state."""
        terminal = can_draw_lines_anew()
        if self.quiet_off_terminal and not sys.stderr.isatty():
            return
        due = view.utc_s - self._told_utc_s >= (1.0 if terminal else SECONDS_BETWEEN_LINES)
        if view.phase == self._phase and not due:
            return
        self._phase, self._told_utc_s = view.phase, view.utc_s
        if terminal:
            renew(progress_line(view))
        else:
            click.echo(progress_line(view), err=True)

    def end(self) -> None:
        """Leave the renewed line."""
        if can_draw_lines_anew() and self._phase:
            click.echo(err=True)


def announcement(facts: RunFacts) -> list[str]:
    """Return what is to be known before a run begins: which pass, when, and what the elements' age means."""
    plan = facts.plan
    target = facts.target
    lines = [f"{target.label} {_when(facts)}"]
    if facts.followed is not None:
        sigma_km = facts.followed.sigma_km
        known = "" if sigma_km is None else f", 1σ {1000.0 * sigma_km:.3g} m by the file"
        lines.append(f"by {target.provenance}{known}")
    age_days = (plan.start_utc_s - float(target.epoch.unix_s)) / 86400.0
    if facts.elements is not None and abs(age_days) > OLD_AFTER_DAYS:
        lines.append(f"the elements are {abs(age_days):.1f} days off the pass: expect it early or late")
    off_s = facts.profile.dated_within_s
    if off_s is not None and off_s > TELLING_DELAY_S:
        what = "delays are" if facts.profile.clock_offset_s is None else "clock is"
        lines.append(
            f"the mount's {what} known to {math.ceil(off_s * 1000.0)} ms: at 1 °/s, up to "
            f"{math.ceil(off_s * 3600.0)}″ along the track that the reported error does not show"
        )
    costs = _uncalibrated(facts)
    return lines if costs is None else [*lines, costs]


def _uncalibrated(facts: RunFacts) -> str | None:
    from sattrack.runtime.pass_scene import uncalibrated

    return uncalibrated(facts)


def _when(facts: RunFacts) -> str:
    """Return from when to when a pass lasts, and how high it comes."""
    # With its facts; the screen's own process has none, and needs nothing of what made them.
    from sattrack.runtime.facts import SEARCH_HOURS

    plan, now_s, high = facts.plan, facts.started_utc_s, f"{facts.max_alt_deg:.1f}° high"
    start, end = (Utc(s).isoformat("seconds") for s in (plan.start_utc_s, plan.end_utc_s))
    # A date that both have is said once.
    end = end[11:] if end[:10] == start[:10] else end
    begins_s = plan.start_utc_s - now_s
    if begins_s >= 60.0:
        return f"from {start} to {end}, {high}, begins in {begins_s / 60.0:.0f} min"
    if begins_s > 0.0:
        return f"from {start} to {end}, {high}, begins in {begins_s:.0f} s"
    if plan.end_utc_s >= now_s + SEARCH_HOURS * 3600.0 - 1.0:
        return f"is up, and stays up for the next {SEARCH_HOURS:g} h and longer, {high}"
    return f"is up now, to {end}, {high}"


def progress_line(view: TrackView) -> str:
    """Return one line about a state."""
    clock = Utc(view.utc_s).isoformat("seconds")[11:]
    error = "" if view.error is None else f"  error {view.error.total_arcsec:.2f}″"
    rms = "" if view.rms_10s_arcsec is None else f"  rms {view.rms_10s_arcsec:.2f}″"
    if view.phase not in {"acquiring", "tracking"}:
        error = rms = ""
    return (
        f"{clock}  {view.name}  {view.phase:<9} "
        f"alt {view.target_alt_deg:5.1f}°  az {view.target_az_deg:5.1f}°{error}{rms}  link {view.link.state}"
    )


class Stream(JsonLines):
    """Writes views as JSON lines; with `tells_session`, who has control of the run as well."""

    def __init__(self, tells_session: bool = False) -> None:
        super().__init__()
        self.tells_session = tells_session

    def tell_scene(self, facts: RunFacts) -> None:
        """Say what does not change during a pass, before it."""
        from sattrack.runtime.kernel_clock import read_kernel_clock
        from sattrack.runtime.pass_scene import pass_scene

        clock = read_kernel_clock()
        known = clock is not None and clock.synchronised
        self.write_whole(pass_scene(facts, clock.estimated_error_s if clock is not None and known else None))

    def tell_session(self, session: SessionView) -> None:
        """Say who has control."""
        if self.tells_session:
            self.write(session)

    def show(self, view: TrackView) -> None:
        """Take one state."""
        self.write(view)


def tell_malformed(observers: Observers) -> None:
    """Say how many lines were no observations, what was wrong with the last, and how many were dropped."""
    if observers.malformed:
        words = f"{observers.malformed} lines were no observations; the last: {observers.complaint}"
        tell(words)
    if observers.dropped:
        words = f"{observers.dropped} observations came faster than they can be used, and were dropped"
        tell(words)


def check_observations(source: str | None, control: bool, elements: tuple[str, ...]) -> None:
    """Refuse an `--observations` that cannot be, or that wants a standard input that is taken."""
    check_source(source)
    if source == "stdin" and control:
        raise BadInputError("--observations stdin: with --control, observations come with the messages")
    if source == "stdin" and "-" in elements:
        raise BadInputError("--observations stdin: the elements come from there; give them as a file")


def finish(summary: Summary, interrupted: bool, as_json: bool) -> int:
    """Tell the summary; raises the error whose exit code the run ends with, else returns 0."""
    if as_json:
        click.echo(msgspec.json.encode(SummaryLine(summary)).decode())
    else:
        click.echo("\n".join(summary_lines(summary)))
    error = failure(summary, interrupted)
    if error is not None:
        raise error
    return 0


class Public:
    """Everybody whom runs are shown to: whoever started them, and those who look on."""

    def __init__(
        self, output: Progress | Stream, desk: ControlArbiter, gallery: ViewServerLink | None
    ) -> None:
        self._output, self._desk, self._gallery = output, desk, gallery
        self._version = -1
        self.left = False
        """Whether whoever started the runs has gone, and nobody reads what is written."""

    @property
    def screened(self) -> bool:
        """Whether whoever started the runs has a screen on them, and is there."""
        return isinstance(self._output, Stream) and self._output.tells_session and not self.left

    def begin(self, facts: RunFacts) -> None:
        """Say what does not change during a run, before it, where it is not the first."""
        if isinstance(self._output, Stream) and self.screened:
            self._output.tell_scene(facts)
        if self._gallery is not None:
            self._gallery.begin(facts)

    def show(self, view: TrackView) -> None:
        """Take one state, and say who has control where that has changed."""
        self.look()
        self._output.show(view)
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
        if isinstance(self._output, Stream) and self.screened:
            self._output.write_whole(SummaryLine(summary))
        if self._gallery is not None:
            self._gallery.tell_end(summary)

    def _tell_session(self) -> bool:
        if self._gallery is None:
            return True
        session = self._desk.view()
        if isinstance(self._output, Stream) and not self.left:
            self._tell_starter(self._output, session)
        return self._gallery.tell(session)

    def _tell_starter(self, output: Stream, session: SessionView) -> None:
        output.tell_session(session)
        if session.left_running:
            # Whoever started the run goes at this word: nothing must be written to nobody.
            self.left = True
            _write_nowhere()


def _write_nowhere() -> None:
    """Send standard output nowhere from now on, so that nobody is waited for."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, sys.stdout.fileno())
    os.close(nowhere)


def fly_and_tell(
    prepared: Prepared,
    output: Progress | Stream,
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
    public = Public(output, desk, gallery)
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
    output.end()
    for words in () if stdin is None else stdin.ignored:
        tell(words)
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
