"""`sattrack run FILE --status`: how the run of a schedule stands."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click
import msgspec

from sattrack.cli.run_night import folder_of
from sattrack.cli.run_text import duration
from sattrack.core.errors import SattrackError
from sattrack.schedule.night_files import read_status
from sattrack.schedule.results import held_words
from tle.errors import printable
from tle.instants import Utc

if TYPE_CHECKING:
    from pathlib import Path

    from sattrack.cli.common import CommandContext
    from sattrack.views.schedule import PassView, ScheduleView


def show_status(context: CommandContext, file: Path, given: Path | None) -> int:
    """Show the last status. Raises SattrackError where there is none."""
    folder = folder_of(file, given)
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
    as_of = f"as of {Utc(view.utc_s).isoformat('seconds')}"
    if view.old and view.age_s is not None:
        as_of += f", OLD: nothing was heard for {view.age_s:.0f} s; before that"
    lines = [
        f"{printable(view.schedule)} {alive}; {as_of}: {printable(view.doing)}",
        f"night {view.night}: {view.from_utc} to {view.to_utc}; mount {view.mount}",
    ]
    if view.stopped_utc is not None:
        stopped = f"STOPPED BY AN OPERATOR at {view.stopped_utc} ({printable(str(view.stopped_by))})"
        lines.append(f"{stopped}: nothing is followed; `{view.resume}` goes on")
    lines += [f"TROUBLE: {printable(words)}" for words in view.troubles]
    if view.weather is not None:
        lines.append(f"weather: {printable(view.weather)}")
    if view.passes:
        lines += ["", "  #  Start UTC  End       Alt°   State        Satellite"]
    lines += [_line(one, view) for one in view.passes]
    if view.not_planned:
        lines.append(f"     {view.not_planned} other passes were seen and are not planned")
    if view.notes:
        lines += ["", *(f"  {printable(note)}" for note in view.notes)]
    if view.summary is not None:
        lines += ["", f"last summary: {view.folder}/{view.summary}"]
    return lines


def _line(one: PassView, view: ScheduleView) -> str:
    why = f": {one.cause}" + (f": {printable(one.words)}" if one.words else "") if one.cause else ""
    if one.on_target_s and one.rms_arcsec is not None:
        why = f"  {one.on_target_s:.0f} s, {one.rms_arcsec:.2f}″ RMS{why}"
    held = held_words(one)
    why += f"; {held}" if held else ""
    if not one.on_target_s and one.lost_to:
        why += "  foretold: " + ", ".join(f"{lost.seconds:.0f} s to the {lost.limit}" for lost in one.lost_to)
    if one.number == view.next_number and view.next_in_s is not None and view.next_in_s > 0.0:
        why += f"  in {duration(view.next_in_s)}"
    return (
        f"{one.number:3d}  {one.start_utc[11:19]}   {one.end_utc[11:19]}  {one.max_alt_deg:5.1f}  "
        f"{one.state:<11}  {printable(one.name)}{why}"
    )
