"""How a schedule's run is told while it goes on: a line that renews itself, JSON lines, the status file."""

from __future__ import annotations

import os
import sys
from typing import TYPE_CHECKING

import click
import msgspec

from sattrack.cli.common import tell
from sattrack.cli.run_text import duration
from sattrack.core.errors import SattrackError
from sattrack.schedule.night import Planned, Started, SummedUp
from sattrack.schedule.night_commands import facts_of
from sattrack.schedule.night_files import OLD_AFTER_S
from sattrack.schedule.showing import view_of
from tle.errors import printable
from tle.instants import Utc

if TYPE_CHECKING:
    from sattrack.schedule.night import Doing, Happening, Run
    from sattrack.schedule.night_commands import Notifier
    from sattrack.schedule.night_files import NightFiles
    from sattrack.schedule.night_journal import Journal
    from sattrack.schedule.service import Service
    from sattrack.views.schedule import ScheduleView


FOLLOWS_EVERY_S, STATUS_EVERY_S = 1.0, 1.0


class Told:
    """Tells of every event; with `as_json` as lines of JSON on standard output, each the whole view."""

    def __init__(
        self, files: NightFiles, schedule: str, as_json: bool, journal: Journal, service: Service
    ) -> None:
        """Take where the status goes, and the service manager's ear."""
        self._journal, self.service = journal, service
        self._troubles: dict[str, str] = {}
        self._files, self._schedule, self._json = files, schedule, as_json
        self.notifier: Notifier | None = None
        self._line = ""
        self._over = 0
        self._written_utc_s = float("-inf")
        self._view: ScheduleView | None = None

    def event(self, run: Run, event: Happening, doing: Doing) -> None:
        """Hear of an event, once it is kept."""
        view = view_of(run, doing, event.utc_s, self._schedule, str(self._files.folder))
        view = self._view = msgspec.structs.replace(view, pid=os.getpid(), events=self._journal.count)
        self._write(view)
        if self._json:
            click.echo(msgspec.json.encode(view).decode())
        elif run.told is not None:
            self._wipe()
            tell(f"{Utc(event.utc_s).isoformat('seconds')} {printable(run.told)}")
        if self.notifier is not None:
            self._notify(run, event, self.notifier)
        self.progress(progress_line(view))

    def _notify(self, run: Run, event: Happening, notifier: Notifier) -> None:
        """Tell whoever the schedule names, of whatever he wants to hear."""
        new = run.told if len(run.results) > self._over and not isinstance(event, Started) else None
        self._over = len(run.results)
        if new is not None:
            place = len(run.results) - 1
            result = run.results[place]
            facts = facts_of(run.passes[place], self._schedule, "over", result)
            notifier.tell("lost" if result.state == "lost" else "pass", new, facts)
        elif run.told is not None:
            facts = {"schedule": self._schedule, "night": run.night}
            if isinstance(event, SummedUp):
                facts["summary"] = str(self._files.folder / (event.file or ""))
            if not isinstance(event, Planned):
                notifier.tell("morning" if isinstance(event, SummedUp) else "trouble", run.told, facts)

    def progress(self, line: str) -> None:
        """Show a line that renews itself, on a terminal only."""
        if sys.stderr.isatty() and not self._json:
            self._line = line
            click.echo(f"\r\x1b[K{line}", nl=False, err=True)

    def waits(self, utc_s: float) -> None:
        """Hear that time goes by: the countdown is renewed, and the status, which shows that it is alive."""
        if self._view is None:
            return
        view = self._view
        if view.next_in_s is not None:
            view = msgspec.structs.replace(view, next_in_s=round(view.next_in_s - (utc_s - view.utc_s), 1))
        view = self._view = msgspec.structs.replace(view, utc_s=utc_s)
        if not 0.0 <= utc_s - self._written_utc_s < STATUS_EVERY_S:
            self._write(view)
        self.progress(progress_line(view))

    def _write(self, view: ScheduleView) -> None:
        """Renew the status file; a disk that is full is no reason to end a night, and told once."""
        self._written_utc_s = view.utc_s
        self.service.status(view.doing)
        try:
            self._files.tell(msgspec.structs.replace(view, troubles=tuple(self._troubles.values())))
        except SattrackError as error:
            self._hear_trouble("status", str(error))
        else:
            self._hear_trouble("status", None)

    def troubled(self, what: str, words: str | None) -> None:
        """Hear what is wrong with something, or with None that it is not any more; told where that is new."""
        if self._hear_trouble(what, words) and self._view is not None:
            self._write(self._view)

    def _hear_trouble(self, what: str, words: str | None) -> bool:
        before = self._troubles.pop(what, None)
        if words is not None:
            self._troubles[what] = words
        if (before is None) == (words is None):
            return False
        told = f"the {what} is all right again" if words is None else words
        self._wipe()
        tell(told)
        if self.notifier is not None:
            self.notifier.tell("trouble", told, {"schedule": self._schedule})
        return True

    def follows(self, utc_s: float, on_target_s: float, words: str, silent_s: float = 0.0) -> None:
        """Hear how a pass goes; told once a second."""
        view = self._view
        if view is None or view.current is None or 0.0 <= utc_s - view.utc_s < FOLLOWS_EVERY_S:
            return
        place = view.current - 1
        one = msgspec.structs.replace(view.passes[place], on_target_s=round(on_target_s, 1))
        passes = (*view.passes[:place], one, *view.passes[place + 1 :])
        doing = f"following {one.number}, {one.name}: {words}"
        self._view = view = msgspec.structs.replace(
            view,
            utc_s=utc_s,
            passes=passes,
            doing=doing,
            silent_s=round(silent_s, 1),
            age_s=round(silent_s, 1),
            old=silent_s > OLD_AFTER_S,
        )
        self._write(view)
        if self._json:
            click.echo(msgspec.json.encode(view).decode())
        self.progress(progress_line(view))

    def _wipe(self) -> None:
        if self._line:
            click.echo("\r\x1b[K", nl=False, err=True)
            self._line = ""

    def end(self, run: Run) -> None:
        """Tell where the last summary is."""
        if not self._json and run.summary is not None:
            click.echo((self._files.folder / run.summary).read_text(encoding="utf-8"), nl=False)

    def close(self) -> None:
        """Leave the line, and say in the status that nobody runs it any more."""
        self._wipe()
        self.service.close()
        if self._view is not None:
            self._write(msgspec.structs.replace(self._view, running=False))


def progress_line(view: ScheduleView) -> str:
    """Return one line about a schedule's run."""
    clock = Utc(view.utc_s).isoformat("seconds")[11:]
    words = f"{clock}  {printable(view.doing)}"
    following = next((one for one in view.passes if one.number == view.next_number), None)
    if following is not None and view.next_in_s is not None and view.next_in_s > 0.0:
        words += f"  in {duration(view.next_in_s)}  ({following.max_alt_deg:.0f}° high)"
    over = sum(one.state not in ("waiting", "in progress") for one in view.passes)
    return f"{words}  {over} of {len(view.passes)} over  mount {view.mount}"
