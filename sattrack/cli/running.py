"""What `track` and `demo` share: progress, the summary, the exit code."""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass
from typing import TYPE_CHECKING

import click
import msgspec

from sattrack.cli.json_lines import JsonLines
from sattrack.cli.screened import can_draw_lines_anew
from sattrack.core.errors import BadInputError
from sattrack.runtime.observers import Observers, check_source
from sattrack.runtime.outcome import failure
from sattrack.views.run import Summary, SummaryLine, TrackView
from sattrack.views.summary_text import summary_lines
from tle.instants import Utc

if TYPE_CHECKING:
    from sattrack.runtime.facts import RunFacts
    from sattrack.views.run import SessionView

SECONDS_BETWEEN_LINES = 5.0
OLD_AFTER_DAYS = 3.0
TELLING_DELAY_S = 0.0005


@dataclass(slots=True)
class Progress:
    """Tells on standard error how a run goes: a line that renews itself on a terminal, else one now and then.

    With `quiet_off_terminal`, nothing is told but on a terminal.
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
            click.echo(f"\r\x1b[K{progress_line(view)}", err=True, nl=False)
        else:
            click.echo(progress_line(view), err=True)

    def end(self) -> None:
        """Leave the renewed line."""
        if can_draw_lines_anew() and self._phase:
            click.echo(err=True)


def announcement(facts: RunFacts) -> list[str]:
    """Return what is to be known before a run begins: which pass, when, and what the elements' age means."""
    plan = facts.plan
    lines = [f"{facts.elements.label} {_when(facts)}"]
    age_days = (plan.start_utc_s - float(facts.elements.epoch.unix_s)) / 86400.0
    if abs(age_days) > OLD_AFTER_DAYS:
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
        click.echo(f"sattrack: {words}", err=True)
    if observers.dropped:
        words = f"{observers.dropped} observations came faster than they can be used, and were dropped"
        click.echo(f"sattrack: {words}", err=True)


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
