"""`sattrack run`: a schedule planned, carried out, or looked at."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from sattrack.cli.common import (
    PLOT,
    CommandContext,
    OutputFile,
    RenamedOption,
    common_options,
    mount_option,
    profile_option,
)
from sattrack.core.errors import BadInputError


@click.command("run")
@click.argument("file", type=click.Path(path_type=Path, dir_okay=False))
@click.option("--dry-run", is_flag=True, help="Make the plan and show it; nothing is moved.")
@click.option("--status", is_flag=True, help="Show the state of this schedule's run.")
@click.option(
    "--check", is_flag=True, help="Read everything a run needs and report what is wrong; move nothing."
)
@click.option(
    "--resume",
    is_flag=True,
    help="Cancel an operator's stop and run on; with --status, cancel it without running.",
)
@mount_option
@click.option(
    "--folder",
    type=click.Path(path_type=Path, file_okay=False),
    metavar="DIR",
    help="Journal, status, summaries, recordings; default: FILE with the ending .run.",
)
@click.option(
    "--virtual",
    is_flag=True,
    help="With --mount sim: in virtual time, one day or to --to.",
)
@click.option("--seed", type=int, metavar="N", help="With --virtual: random troubles from this seed.")
@click.option("--from", "start", metavar="UTC", help="Start; default: as the file says, else now.")
@click.option(
    "--to",
    "end",
    metavar="UTC",
    help="End; default: as the file says, else 24 hours later for a plan, none for a run.",
)
@click.option(
    "--rehearse",
    is_flag=True,
    help="Rehearse the chosen passes in full, and plan without those that are no go.",
)
@click.option(
    "--plot",
    "--png",
    "plot",
    cls=RenamedOption,
    type=PLOT,
    metavar="FILE",
    help="With --dry-run: the plan as a timeline, an image.",
)
@click.option(
    "--ics",
    type=OutputFile(),
    metavar="FILE",
    help="The same as a calendar.",
)
@profile_option
@common_options("site", "elements", "clock", "json", "utc")
def command(context: CommandContext, file: Path, **options: Any) -> int:
    """Run a schedule FILE, night after night, and continue it after any interruption.

    Each night is planned for the largest value. --dry-run only shows the plan, and why other passes are not
    in it. Exit code 130: it was stopped, and the mount is at rest; after `sattrack stop` it follows nothing
    until a person gives --resume. Exit code 143: the system ended it; run it again to continue.

    \b
    Examples:
      sattrack run night.toml --dry-run
      sattrack run night.toml --mount sim --virtual
      sattrack run night.toml --status
    """
    if options["check"]:
        from sattrack.cli.run_night import show_check

        return show_check(context, file, folder_of(file, options["folder"]), options)
    if options["status"]:
        from sattrack.cli.run_report import show_status

        if options["resume"]:
            from sattrack.cli.run_night import take_back

            take_back(folder_of(file, options["folder"]))
        return show_status(context, folder_of(file, options["folder"]))
    if not options["dry_run"]:
        from sattrack.cli.run_night import run_schedule

        for name in ("plot", "ics"):
            if options[name] is not None:
                raise BadInputError(f"--{name} needs --dry-run")
        return run_schedule(context, file, folder_of(file, options["folder"]), options)
    from sattrack.cli.run_plan import show_plan

    return show_plan(context, file, options)


def folder_of(file: Path, given: Path | None) -> Path:
    """Return where a schedule's run keeps its journal, status, summaries and recordings."""
    return file.with_suffix(".run") if given is None else given
