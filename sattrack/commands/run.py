"""`sattrack run`: the plan of a schedule."""

from __future__ import annotations

import os
import sys
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from sattrack.commands.common import CommandContext, common_options, profile_option, tell
from sattrack.errors import BadInputError
from tle.errors import EarthOrientationWarning
from tle.instants import Utc

if TYPE_CHECKING:
    from collections.abc import Callable

    from sattrack.schedule.candidates import Loaded, Situation
    from sattrack.schedule.file import Schedule
    from sattrack.schedule.plan import Plan

DEFAULT_HOURS, MOST_DAYS = 24.0, 31.0


@click.command("run")
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--dry-run", is_flag=True, help="Make the plan and show it; nothing is moved.")
@click.option("--from", "start", metavar="UTC", help="Beginning of the plan; as the file says, else now.")
@click.option("--to", "end", metavar="UTC", help="Its end; as the file says, else 24 hours later.")
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
    """Plan a schedule FILE: which passes to take for the largest value, and why the others lost."""
    from sattrack.schedule.file import load_schedule

    schedule = load_schedule(file)
    if not options["dry_run"]:
        raise BadInputError(
            f"{file}: only plans are made so far: add --dry-run for the plan; track follows one pass"
        )
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


def _plan(context: CommandContext, schedule: Schedule, options: dict[str, Any]) -> Plan:
    from sattrack.schedule.making import make_plan

    situation = _situation(context, schedule, options)
    rehearse = None
    if options["rehearse"]:
        from sattrack.commands.run_rehearse import rehearser

        rehearse = rehearser(context, context.profile(options["profile"]), schedule)
    return make_plan(schedule, situation, _loader(context, schedule), rehearse, _progress())


def _situation(context: CommandContext, schedule: Schedule, options: dict[str, Any]) -> Situation:
    from sattrack.runtime.prepare import check_site
    from sattrack.schedule.candidates import Situation
    from tle.brightness import read_magnitudes

    now = context.now()
    site, profile = context.site(), context.profile(options["profile"]).mount
    check_site(profile, site)
    begin = float(now.unix_s) if schedule.from_utc_s is None else schedule.from_utc_s
    begin = begin if options["start"] is None else float(Utc.parse(options["start"]).unix_s)
    end = begin + DEFAULT_HOURS * 3600.0 if schedule.to_utc_s is None else schedule.to_utc_s
    end = end if options["end"] is None else float(Utc.parse(options["end"]).unix_s)
    if not 0.0 < end - begin <= MOST_DAYS * 86400.0:
        raise BadInputError(
            f"the plan goes from {Utc(begin).isoformat('seconds')} to {Utc(end).isoformat('seconds')}: "
            f"give --from and --to in order, {MOST_DAYS:g} days apart at most"
        )
    limits = context.settings.safety.limits()
    low = [one for one in schedule.entries if one.terms.min_altitude_deg < limits.floor_altitude_deg]
    if low:
        raise low[0].origin.wrong(
            f"follows above {low[0].terms.min_altitude_deg:g}°, and the mount is kept above "
            f"{limits.floor_altitude_deg:g}° (safety.floor_altitude_deg)"
        )
    return Situation(
        span=(begin, end),
        now_utc_s=float(now.unix_s),
        site=site,
        profile=profile,
        limits=limits,
        magnitudes={} if schedule.magnitudes is None else read_magnitudes(schedule.magnitudes),
        workers=os.cpu_count() or 1,
    )


def _loader(context: CommandContext, schedule: Schedule) -> Callable[[str | None], Loaded]:
    """Return what gives the elements of a source, each read once."""
    from sattrack.schedule.candidates import Loaded
    from tle.sources import is_fetched, newest

    known: dict[str | None, Loaded] = {}

    def load(source: str | None) -> Loaded:
        if source not in known:
            sources = (*context.sources(), *schedule.elements) if source is None else (source,)
            if not sources:
                raise BadInputError(
                    f"{schedule.file}: no elements: set elements in it or in sattrack.toml, or give some"
                )
            sets = context.load(sources)
            if sets.rejected and not sets.accepted:
                raise sets.rejected[0]
            if sets.rejected:
                count, first = len(sets.rejected) + len(sets.accepted), str(sets.rejected[0]).splitlines()[0]
                tell(f"{len(sets.rejected)} of {count} element sets refused, the first: {first}")
            renewable = all(is_fetched(one) for one in sources)
            known[source] = Loaded(newest(sets.accepted), renewable, ", ".join(sources))
        return known[source]

    return load


def _progress() -> Callable[[str, int, int], None] | None:
    """Return what shows on the terminal how far long work is, and wipes that at its end; else None."""
    if not sys.stderr.isatty():
        return None

    def show(what: str, done: int, total: int) -> None:
        words = f"{what} {done} of {total}" if done < total else ""
        click.echo(f"\r\x1b[K{words}", nl=False, err=True)

    return show


def _write(plan: Plan, context: CommandContext, options: dict[str, Any]) -> None:
    if options["ics"] is not None:
        from sattrack.commands.run_calendar import as_calendar

        try:
            options["ics"].write_bytes(as_calendar(plan, context.now()).encode())
        except OSError as error:
            raise BadInputError(
                f"--ics {options['ics']}: cannot write the calendar: {error.strerror}"
            ) from None
    if options["png"] is not None:
        from sattrack.commands.run_plot import plot_plan

        plot_plan(options["png"], plan, context.site())
    for note in plan.notes:
        tell(note)
    if context.json:
        import msgspec

        click.echo(msgspec.json.encode(plan).decode())
    else:
        from sattrack.commands.run_text import plan_lines

        colour = False if os.environ.get("NO_COLOR") else None
        click.echo("\n".join(plan_lines(plan)), color=colour)
