"""`sattrack run`: a schedule planned, carried out, or looked at."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from sattrack.cli.common import CommandContext, common_options, mount_option, profile_option
from sattrack.core.errors import BadInputError


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
    """Run a schedule FILE, night after night, and continue it after any interruption.

    Each night is planned for the largest value; with --dry-run that is all, and the plan is shown, with why
    other passes lost. Exit code 130 where it was stopped; the mount is at rest then. After `sattrack stop` it
    follows nothing until a person says --resume. 143 where the system ended it: run again, it goes on.
    """
    if options["check"]:
        from sattrack.cli.run_night import show_check

        return show_check(context, file, options)
    if options["status"]:
        from sattrack.cli.run_report import show_status

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
    from sattrack.cli.run_plan import show_plan

    return show_plan(context, file, options)


def folder_of(file: Path, given: Path | None) -> Path:
    """Return where a schedule's run keeps its journal, status, summaries and recordings."""
    return file.with_suffix(".run") if given is None else given
