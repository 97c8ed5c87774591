"""A schedule's run and its plan on the terminal: lines, JSON lines, the status file and its table."""

from __future__ import annotations

import os
import sys
from typing import TYPE_CHECKING

import click
import msgspec

from sattrack.cli.output import renew, say, tell
from sattrack.core import local_time
from sattrack.core.errors import SattrackError
from sattrack.schedule.night import Planned, Started, SummedUp
from sattrack.schedule.night_folder import OLD_AFTER_S, read_status
from sattrack.schedule.night_processes import facts_of
from sattrack.schedule.summary import limits_text, view_of
from sattrack.views.formatting import iso_clock, iso_unix_s
from tle.errors import printable

if TYPE_CHECKING:
    from pathlib import Path

    from sattrack.cli.common import CommandContext
    from sattrack.schedule.night import Event, Order, Run
    from sattrack.schedule.night_folder import Journal, NightFiles
    from sattrack.schedule.night_processes import Notifier, Service
    from sattrack.views.schedule import (
        EntryOutcome,
        LostPass,
        PlannedPass,
        SchedulePassView,
        SchedulePlan,
        ScheduleView,
    )


FOLLOWS_EVERY_S, STATUS_EVERY_S = 1.0, 1.0


class RunReporter:
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

    def event(self, run: Run, event: Event, order: Order) -> None:
        """Report an event, once it is kept."""
        view = view_of(run, order, event.utc_s, self._schedule, str(self._files.folder))
        view = self._view = msgspec.structs.replace(view, pid=os.getpid(), events=self._journal.count)
        self._write(view)
        if self._json:
            click.echo(msgspec.json.encode(view).decode())
        elif run.message is not None:
            self._wipe()
            tell(f"{local_time.date(event.utc_s)} {local_time.clock(event.utc_s)} {printable(run.message)}")
        if self.notifier is not None:
            self._notify(run, event, self.notifier)
        self.progress(progress_line(view))

    def _notify(self, run: Run, event: Event, notifier: Notifier) -> None:
        """Notify those whom the schedule names, of what they ask for."""
        new = run.message if len(run.results) > self._over and not isinstance(event, Started) else None
        self._over = len(run.results)
        if new is not None:
            place = len(run.results) - 1
            result = run.results[place]
            facts = facts_of(run.passes[place], self._schedule, "over", result)
            notifier.tell("lost" if result.state == "lost" else "pass", new, facts)
        elif run.message is not None:
            facts = {"schedule": self._schedule, "night": run.night}
            if isinstance(event, SummedUp):
                facts["summary"] = str(self._files.folder / (event.file or ""))
            if not isinstance(event, Planned):
                notifier.tell("morning" if isinstance(event, SummedUp) else "trouble", run.message, facts)

    def progress(self, line: str) -> None:
        """Show a line that renews itself, on a terminal only."""
        if sys.stderr.isatty() and not self._json:
            self._line = line
            renew(line)

    def report_waiting(self, utc_s: float) -> None:
        """Renew the countdown, and the status, which shows that the run is alive."""
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
        """Renew the status file; a full disk does not end a night, and is reported once."""
        self._written_utc_s = view.utc_s
        self.service.status(view.doing)
        try:
            self._files.tell(msgspec.structs.replace(view, troubles=tuple(self._troubles.values())))
        except SattrackError as error:
            self._note_trouble("status", str(error))
        else:
            self._note_trouble("status", None)

    def report_trouble(self, what: str, text: str | None) -> None:
        """Report what is wrong with something, None for nothing any more; only where that is new."""
        if self._note_trouble(what, text) and self._view is not None:
            self._write(self._view)

    def _note_trouble(self, what: str, text: str | None) -> bool:
        before = self._troubles.pop(what, None)
        if text is not None:
            self._troubles[what] = text
        if (before is None) == (text is None):
            return False
        text = f"the {what} is all right again" if text is None else text
        self._wipe()
        tell(text)
        if self.notifier is not None:
            self.notifier.tell("trouble", text, {"schedule": self._schedule})
        return True

    def report_progress(self, utc_s: float, on_target_s: float, text: str, silent_s: float = 0.0) -> None:
        """Report how a pass goes, once a second."""
        view = self._view
        if view is None or view.current is None or 0.0 <= utc_s - view.utc_s < FOLLOWS_EVERY_S:
            return
        place = view.current - 1
        one = msgspec.structs.replace(view.passes[place], on_target_s=round(on_target_s, 1))
        passes = (*view.passes[:place], one, *view.passes[place + 1 :])
        doing = f"following {one.number}, {one.name}: {text}"
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
            renew()
            self._line = ""

    def end(self, run: Run) -> None:
        """Tell where the last summary is."""
        if not self._json and run.summary is not None:
            say((self._files.folder / run.summary).read_text(encoding="utf-8").removesuffix("\n"))

    def close(self) -> None:
        """Leave the line, and say in the status that nobody runs it any more."""
        self._wipe()
        self.service.close()
        if self._view is not None:
            self._write(msgspec.structs.replace(self._view, running=False))


def progress_line(view: ScheduleView) -> str:
    """Return one line about a schedule's run."""
    clock = local_time.clock(view.utc_s)
    text = f"{clock}  {printable(view.doing)}"
    following = next((one for one in view.passes if one.number == view.next_number), None)
    if following is not None and view.next_in_s is not None and view.next_in_s > 0.0:
        text += f"  {local_time.until(view.next_in_s)}  ({following.max_alt_deg:.0f}° high)"
    over = sum(one.state not in ("waiting", "in progress") for one in view.passes)
    return f"{text}  {over} of {len(view.passes)} over  mount {view.mount}"


def show_status(context: CommandContext, folder: Path) -> int:
    """Show the last status of a run's folder. Raises SattrackError where there is none."""
    view = read_status(folder)
    if view is None:
        raise SattrackError(f"{folder}: this schedule was never run here; --folder names another place")
    if context.json:
        click.echo(msgspec.json.encode(view).decode())
    else:
        click.echo("\n".join(status_lines(view)))
    return 0


def status_lines(view: ScheduleView) -> list[str]:
    """Return the status as lines of text."""
    alive = f"runs, process {view.pid}" if view.running else "does not run"
    as_of = f"as of {local_time.instant(view.utc_s)}"
    if view.old and view.age_s is not None:
        as_of += f", OLD: nothing was heard for {view.age_s:.0f} s; before that"
    lines = [
        f"{printable(view.schedule)} {alive}; {as_of}: {printable(view.doing)}",
        f"night {view.night}: {_span(view.from_utc, view.to_utc)}; mount {view.mount}",
    ]
    if view.stopped_utc is not None:
        at = local_time.instant(iso_unix_s(view.stopped_utc))
        stopped = f"STOPPED BY AN OPERATOR at {at} ({printable(str(view.stopped_by))})"
        lines.append(f"{stopped}: nothing is followed; `{view.resume}` resumes")
    lines += [f"TROUBLE: {printable(text)}" for text in view.troubles]
    if view.weather is not None:
        lines.append(f"weather: {printable(view.weather)}")
    if view.passes:
        lines += ["", "  #  Start      End       Alt°   State        Satellite"]
    lines += [_line(one, view) for one in view.passes]
    if view.not_planned:
        lines.append(f"     {view.not_planned} other passes were seen and are not planned")
    if view.notes:
        lines += ["", *(f"  {printable(note)}" for note in view.notes)]
    if view.summary is not None:
        lines += ["", f"last summary: {view.folder}/{view.summary}"]
    return lines


def _line(one: SchedulePassView, view: ScheduleView) -> str:
    why = f": {one.cause}" + (f": {printable(one.words)}" if one.words else "") if one.cause else ""
    if one.on_target_s and one.rms_arcsec is not None:
        why = f"  {one.on_target_s:.0f} s, {one.rms_arcsec:.2f}″ RMS{why}"
    held = limits_text(one)
    why += f"; {held}" if held else ""
    if not one.on_target_s and one.lost_to:
        why += "  expected: " + ", ".join(f"{lost.seconds:.0f} s to the {lost.limit}" for lost in one.lost_to)
    if one.number == view.next_number and view.next_in_s is not None and view.next_in_s > 0.0:
        why += f"  {local_time.until(view.next_in_s)}"
    return (
        f"{one.number:3d}  {iso_clock(one.start_utc)}   {iso_clock(one.end_utc)}  {one.max_alt_deg:5.1f}  "
        f"{one.state:<11}  {printable(one.name)}{why}"
    )


MOST_LOST = 60
_HEAD = "  #  Start      End             Idle  Slew s  Alt°   Sun°  Useful s  Value     Satellite"
_LOST_HEAD = "     Start      End       Alt°  Value     Why"


def plan_lines(plan: SchedulePlan) -> list[str]:
    """Return the lines of a table."""
    lines = [
        f"{printable(plan.schedule)}: {_span(plan.from_utc, plan.to_utc)}, "
        f"mount {printable(plan.profile)}; times in the file without a zone are {plan.timezone}"
    ]
    if plan.passes:
        lines += ["", click.style(_HEAD, bold=True)]
    day = local_time.day(iso_unix_s(plan.from_utc))
    for one in plan.passes:
        day = _new_day(lines, one.start_utc, day)
        lines += _pass_lines(one)
    lines += ["", _total(plan)]
    if plan.lost:
        lines += ["", click.style("Not taken", bold=True), click.style(_LOST_HEAD, bold=True)]
        day = local_time.day(iso_unix_s(plan.from_utc))
        for lost in plan.lost[:MOST_LOST]:
            day = _new_day(lines, lost.start_utc, day)
            lines.append(_lost_line(lost))
        if plan.lost[MOST_LOST:]:
            lines.append(f"     and {len(plan.lost) - MOST_LOST} more; --json has them all")
    lines += ["", click.style("Asked for", bold=True)]
    lines += [_asked_line(one) for one in plan.asked]
    lines.append(_conditions(plan))
    return lines


def _new_day(lines: list[str], utc: str, day: str) -> str:
    new = local_time.day(iso_unix_s(utc))
    if new != day:
        lines.append(click.style(new, bold=True))
    return new


def _pass_lines(one: PlannedPass) -> list[str]:
    name = printable(one.name or str(one.catalog_number))
    sun = "-" if one.sun_alt_deg is None else f"{one.sun_alt_deg:.0f}"
    text = name + ("  shortened" if one.shortened else "")
    if one.priority != 1.0:
        text += f"  priority {one.priority:g}"
    lines = [
        f"{one.number:3d}  {iso_clock(one.start_utc)}   {iso_clock(one.end_utc)}  "
        f"{local_time.duration(one.idle_s):>10}  {one.slew_s:6.1f}  {one.max_alt_deg:5.1f}  "
        f"{sun:>4}  {one.useful_s:8.0f}  {one.value:8.0f}  {text}"
    ]
    indent = " " * 5
    extra = [("before", list(one.before)), ("after", list(one.after))]
    if one.bias_along_s or one.bias_cross_deg:
        extra.append(("bias", [f"{one.bias_along_s:g} s along, {one.bias_cross_deg:g}° across"]))
    extra.append(("lost", [f"{lost.seconds:.0f} s to the {lost.limit}: {lost.why}" for lost in one.lost_to]))
    if one.rehearsed is not None:
        extra.append(("rehearsed", [one.rehearsed.verdict]))
    extra.append(("note", list(one.notes)))
    lines += [f"{indent}{what}: {printable('; '.join(parts))}" for what, parts in extra if parts]
    return lines


def _lost_line(one: LostPass) -> str:
    name = printable(one.name or str(one.catalog_number))
    return (
        f"     {iso_clock(one.start_utc)}   {iso_clock(one.end_utc)}  {one.max_alt_deg:5.1f}  "
        f"{one.value:8.0f}  {name}: {click.style(one.reason, fg='yellow')}: {printable(one.why)}"
    )


def _total(plan: SchedulePlan) -> str:
    count = len(plan.passes)
    return (
        f"{count} {'pass' if count == 1 else 'passes'}, {plan.useful_s:.0f} useful seconds, "
        f"value {plan.value:.0f}; {local_time.duration(plan.slew_s)} of slews, "
        f"{local_time.duration(plan.idle_s)} idle before and between; {len(plan.lost)} lost"
    )


def _asked_line(one: EntryOutcome) -> str:
    parts = [f"{one.passes} seen", f"{one.planned} planned", f"{one.lost} lost"]
    parts += [f"{count} {why}" for why, count in one.left_out.items()]
    return f"     {printable(one.asked_at)}: {printable(one.asked_by)}: {', '.join(parts)}"


def _conditions(plan: SchedulePlan) -> str:
    weather = "the weather is not checked" if plan.weather is None else f"weather by {plan.weather}"
    return f"     {printable(weather)}; the mount is {'parked' if plan.park_at_end else 'left'} at the end"


def _span(from_utc: str, to_utc: str) -> str:
    return local_time.span(iso_unix_s(from_utc), iso_unix_s(to_utc))
