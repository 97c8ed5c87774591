"""`sattrack run`: a schedule planned, carried out, or looked at."""

from __future__ import annotations

import os
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from sattrack.cli.common import CommandContext, common_options, profile_option, tell
from sattrack.cli.mount_option import mount_option
from sattrack.core.errors import BadInputError
from tle.errors import EarthOrientationWarning
from tle.instants import Utc

if TYPE_CHECKING:
    from sattrack.mount.profiles import ProfileFile
    from sattrack.schedule.candidates import Situation
    from sattrack.schedule.file import Schedule
    from sattrack.schedule.plan import Plan

DEFAULT_HOURS, MOST_DAYS = 24.0, 31.0


@click.command("run")
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--dry-run", is_flag=True, help="Make the plan and show it; nothing is moved.")
@click.option("--status", is_flag=True, help="Show how the run of this schedule stands.")
@click.option("--check", is_flag=True, help="Read all that a run needs; say what is wrong, and move nothing.")
@click.option(
    "--resume",
    is_flag=True,
    help="Take an operator's stop back, and run on; with --status, take it back and do not run.",
)
@mount_option
@click.option(
    "--folder",
    type=click.Path(path_type=Path, file_okay=False),
    metavar="DIR",
    help="Journal, status, summaries, recordings; else beside FILE, with the ending .run.",
)
@click.option(
    "--virtual",
    is_flag=True,
    help="With --mount sim: in virtual time, one day or to --to.",
)
@click.option("--seed", type=int, metavar="N", help="With --virtual: troubles, drawn from this seed.")
@click.option("--from", "start", metavar="UTC", help="Beginning; as the file says, else now.")
@click.option(
    "--to", "end", metavar="UTC", help="End; as the file says, else of a plan 24 hours later, of a run none."
)
@click.option(
    "--rehearse", is_flag=True, help="Rehearse what is chosen in full, and plan without what is no go."
)
@click.option(
    "--png", type=click.Path(path_type=Path, dir_okay=False), metavar="FILE", help="The plan as a timeline."
)
@click.option(
    "--ics", type=click.Path(path_type=Path, dir_okay=False), metavar="FILE", help="The plan as a calendar."
)
@profile_option
@common_options
def command(context: CommandContext, file: Path, **options: Any) -> int:
    """Run a schedule FILE, night after night, and run it on after whatever interrupted it.

    Each night is planned for the largest value; with --dry-run that is all, and the plan is shown, with why
    other passes lost. Exit code 130 where it was stopped; the mount is at rest then. After `sattrack stop` it
    follows nothing until a person says --resume. 143 where the system ended it: run again, it goes on.
    """
    if options["check"]:
        from sattrack.cli.run_night import show_check

        return show_check(context, file, options)
    if options["status"]:
        from sattrack.cli.run_told import show_status

        if options["resume"]:
            from sattrack.cli.run_night import take_back

            take_back(folder_of(file, options["folder"]))
        return show_status(context, folder_of(file, options["folder"]))
    if not options["dry_run"]:
        from sattrack.cli.run_night import run_schedule

        for name in ("png", "ics"):
            if options[name] is not None:
                raise BadInputError(f"--{name} goes with --dry-run")
        return run_schedule(context, file, folder_of(file, options["folder"]), options)
    from sattrack.schedule.file import load_schedule

    schedule = load_schedule(file)
    for name in ("png", "ics"):
        path = options[name]
        if path is not None and not path.absolute().parent.is_dir():
            raise BadInputError(f"--{name} {path}: there is no such folder to write into")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", EarthOrientationWarning)
        warnings.simplefilter("always", RuntimeWarning)
        plan = _plan(context, schedule, options)
    for words in dict.fromkeys(str(warning.message) for warning in caught):
        click.echo(f"sattrack: warning: {words}", err=True)
    _write(plan, context, options)
    return 0


def folder_of(file: Path, given: Path | None) -> Path:
    """Return where a schedule's run keeps its journal, status, summaries and recordings."""
    return file.with_suffix(".run") if given is None else given


def _plan(context: CommandContext, schedule: Schedule, options: dict[str, Any]) -> Plan:
    from msgspec import structs

    from sattrack.cli.run_plan import loader, progress, why_left, within_half_a_turn
    from sattrack.mount.alpaca.address import parse_alpaca
    from sattrack.schedule.making import make_plan

    url = options["mount_url"] or context.settings.mount.url
    # A plan is made without a network too: a host that cannot be found does not matter.
    address = parse_alpaca(url, resolve=False) if url is not None and url.startswith("alpaca:") else None
    profile = within_half_a_turn(context.profile(options["profile"], url))
    situation = _situation(context, schedule, profile, options)
    rehearse = None
    if options["rehearse"]:
        from sattrack.cli.run_plan import rehearser

        rehearse = rehearser(context, profile, schedule)
    plan = make_plan(schedule, situation, loader(context, schedule), rehearse, progress())
    left = why_left(schedule, profile, address)
    return plan if left is None else structs.replace(plan, park_at_end=False, notes=(*plan.notes, left))


def _situation(
    context: CommandContext, schedule: Schedule, profile: ProfileFile, options: dict[str, Any]
) -> Situation:
    from sattrack.cli.run_plan import said_utc_s, situation_of

    now = float(context.now().unix_s)
    begin = said_utc_s(options["start"], schedule.from_utc_s)
    begin = now if begin is None else begin
    end = said_utc_s(options["end"], schedule.to_utc_s)
    end = begin + DEFAULT_HOURS * 3600.0 if end is None else end
    if not 0.0 < end - begin <= MOST_DAYS * 86400.0:
        raise BadInputError(
            f"the plan goes from {Utc(begin).isoformat('seconds')} to {Utc(end).isoformat('seconds')}: "
            f"give --from and --to in order, {MOST_DAYS:g} days apart at most"
        )
    return situation_of(context, schedule, profile, (begin, end), now)


def _write(plan: Plan, context: CommandContext, options: dict[str, Any]) -> None:
    if options["ics"] is not None:
        from sattrack.cli.run_plan import as_calendar

        try:
            options["ics"].write_bytes(as_calendar(plan, context.now()).encode())
        except OSError as error:
            raise BadInputError(
                f"--ics {options['ics']}: cannot write the calendar: {error.strerror}"
            ) from None
    if options["png"] is not None:
        from sattrack.cli.run_plot import plot_plan

        plot_plan(options["png"], plan, context.site())
    for note in plan.notes:
        tell(note)
    if context.json:
        import msgspec

        click.echo(msgspec.json.encode(plan).decode())
    else:
        from sattrack.cli.run_told import plan_lines

        colour = False if os.environ.get("NO_COLOR") else None
        click.echo("\n".join(plan_lines(plan)), color=colour)
