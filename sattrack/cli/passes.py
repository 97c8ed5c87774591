"""`sattrack passes`: coming passes of one satellite, of some, or of a whole catalogue."""

from __future__ import annotations

import fnmatch
import json
import math
import os
import sys
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import numpy as np

from sattrack.cli.common import (
    PLOT,
    CommandContext,
    common_options,
    given_instant,
    profile_option,
    satellite_names,
)
from sattrack.cli.output import may_colour, renew, say, tell
from sattrack.cli.targets import ephemeris_option, find_targets
from sattrack.core.errors import BadInputError, SattrackError
from tle.elements import Elements
from tle.instants import DAY_S, Utc

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from sattrack.cli.passes_output import PassTable
    from tle.ephemeris import Ephemeris
    from tle.horizon import Horizon
    from tle.passes import CataloguePasses

_DARK_SUN_DEG = -6.0
_FEWEST_FOR_PROGRESS = 2000
_OLD_DAYS = 14.0
_LINES_AT_ONCE = 2000
_SORTS = ("rise", "altitude", "magnitude", "rate", "name")
_NOT_OF_TRANSITS = {
    "sunlit": "--sunlit",
    "dark": "--dark",
    "feasible": "--feasible",
    "judged": "--judged",
    "profile": "--profile",
    "max_rate_deg_s": "--max-rate",
    "faintest": "--magnitude",
    "sort": "--sort",
    "plot": "--plot",
}


@click.command("passes")
@click.argument("targets", nargs=-1, metavar="[TARGET]...", shell_complete=satellite_names)
@ephemeris_option
@click.option("--from", "start", metavar="UTC", help="Start of the search; default: now.")
@click.option(
    "--hours", type=float, default=24.0, show_default=True, metavar="H", help="Length of the search, hours."
)
@click.option("--min-alt", "min_alt_deg", type=float, metavar="DEG", help="Least altitude; 10 if not set.")
@click.option(
    "--horizon",
    "mask_file",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Skyline: azimuth and altitude in degrees on each line.",
)
@click.option("--sunlit", is_flag=True, help="Only passes with the satellite in full sunlight for a while.")
@click.option("--dark", is_flag=True, help="Only while the Sun is 6° below the horizon or lower.")
@click.option("--feasible", is_flag=True, help="Only passes that the mount can follow, by its limits.")
@click.option(
    "--judged", is_flag=True, help="Show for each pass whether the mount can follow it, and why not."
)
@click.option("--transits", is_flag=True, help="Only where a satellite crosses the disc of Sun or Moon.")
@profile_option
@click.option(
    "--max-rate",
    "max_rate_deg_s",
    type=float,
    metavar="DEG/S",
    help="Only where neither axis of an equatorial mount must exceed this rate.",
)
@click.option(
    "--magnitude",
    "faintest",
    type=float,
    metavar="MAG",
    help="Only passes at least this bright; needs --magnitudes.",
)
@click.option(
    "--magnitudes",
    "magnitudes_file",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Catalogue number and intrinsic magnitude (at 1000 km, half lit) on each line.",
)
@click.option("--name", "pattern", metavar="GLOB", help="Only names that match, as 'STARLINK*'.")
@click.option("--sort", type=click.Choice(_SORTS), default="rise", show_default=True, help="Order of passes.")
@click.option(
    "--format",
    "style",
    type=click.Choice(["table", "csv", "json", "ics"]),
    help="A table (the default), csv with the fields of json, or ics, a calendar with one event a pass.",
)
@click.option("--csv", "as_csv", is_flag=True, hidden=True)
@click.option("--ics", "as_ics", is_flag=True, hidden=True)
@click.option("--plot", type=PLOT, help="Sky chart of the passes as an image.")
@common_options("site", "elements", "clock", "json", "utc")
def command(context: CommandContext, targets: tuple[str, ...], **options: Any) -> int:
    """List coming passes of each TARGET, of all satellites if none is named.

    TARGET is a satellite (catalogue number, designator or name), Moon or another body, or RA,DEC; with
    --ephemeris an object of that file.

    \b
    Examples:
      sattrack passes ISS
      sattrack passes --dark --sunlit --min-alt 30 --sort altitude
      sattrack passes ISS --hours 72 --format ics > iss.ics
      sattrack passes ISS --hours 480 --transits
    """
    style = _style(options, context.json)
    _check(options, style)
    start = given_instant("--from", options["start"]) if options["start"] else context.now()
    if targets:
        context.site()  # asked for before the network is
    chosen = _chosen(context, targets, start, options)
    known = _magnitudes(options)
    if options["faintest"] is not None:
        chosen = [e for e in chosen if e.catalog_number in known]
    passes = _search(context, chosen, start, options)
    _tell_age(passes)
    _tell_failures(passes, bool(targets))
    if options["transits"]:
        _show_transits(passes, style)
        return 0
    separations = style in ("json", "csv")
    table = _table(passes, known, separations, options).sorted(options["sort"])
    table = _judged(context, table, options)
    if options["plot"]:
        from sattrack.cli.passes_output import plot_passes

        plot_passes(options["plot"], table)
    _show_passes(table, style, options)
    return 0


def _show_transits(passes: CataloguePasses, style: str) -> None:
    """Print what crosses Sun and Moon."""
    from sattrack.cli.passes_output import transit_lines, transit_rows
    from tle.facts import fact_columns
    from tle.transits import find_transits

    progress = _progress("looked at {done} of {total} passes", len(passes))
    found = find_transits(passes, fact_columns(passes, progress=progress, workers=os.cpu_count() or 1))
    if style == "json":
        click.echo(json.dumps(transit_rows(found), allow_nan=False))
    elif found:
        say("\n".join(transit_lines(found)))
    else:
        tell("nothing crosses Sun or Moon in this time")
    if any(one.body == "Sun" for one in found):
        tell("look at the Sun through a solar filter only: without one it blinds, and burns a camera")


def _show_passes(table: PassTable, style: str, options: dict[str, Any]) -> None:
    from sattrack.cli.passes_output import table_lines, write_csv, write_json

    if style == "json":
        write_json(table, sys.stdout.write, os.cpu_count() or 1)
    elif style == "csv":
        write_csv(table, sys.stdout.write, os.cpu_count() or 1)
    elif style == "ics":
        from sattrack.cli.passes_output import passes_calendar

        sys.stdout.write(passes_calendar(table).decode())
    elif len(table):
        now_utc_s = None if options["start"] else float(table.passes.start.unix_s)
        lines = table_lines(table, now_utc_s)
        for some in _batched(lines):
            click.echo("\n".join(some), color=may_colour())
    else:
        tell("no pass in this time meets the criteria")


def _batched(lines: Iterator[str]) -> Iterator[list[str]]:
    """Yield lines many at a time."""
    while some := list(islice(lines, _LINES_AT_ONCE)):
        yield some


def _style(options: dict[str, Any], as_json: bool) -> str:
    """Return how to write the passes; raises BadInputError where several ways are given."""
    flags = {"json": as_json, "csv": options["as_csv"], "ics": options["as_ics"]}
    given = {style for style, flag in flags.items() if flag} | {options["style"] or "table"}
    if options["style"] is None and len(given) > 1:
        given.remove("table")
    if len(given) > 1:
        raise BadInputError("give only one of --format table, csv, json and ics")
    return given.pop()


def _check(options: dict[str, Any], style: str) -> None:
    """Raise BadInputError for options that do not go together or that no pass can meet."""
    if options["transits"]:
        if style not in ("table", "json"):
            raise BadInputError(f"--transits is printed as a table or as json, not as {style}")
        for name, option in _NOT_OF_TRANSITS.items():
            if options[name] not in (None, False, _SORTS[0]):
                raise BadInputError(f"{option} is of passes, and --transits lists none; omit one of them")
    if options["profile"] is not None and not (options["feasible"] or options["judged"]):
        raise BadInputError("--profile is what passes are judged by: give --judged or --feasible too")
    if options["faintest"] is not None and options["magnitudes_file"] is None:
        raise BadInputError(
            "--magnitude needs --magnitudes FILE: element sets do not say how bright things are"
        )
    if options["faintest"] is not None and math.isnan(options["faintest"]):
        raise BadInputError("--magnitude nan: give a number, as 4.5")
    rate = options["max_rate_deg_s"]
    if rate is not None and not rate > 0.0:
        raise BadInputError(f"--max-rate {rate}: give degrees a second above 0")


def _chosen(
    context: CommandContext, keys: Sequence[str], start: Utc, options: dict[str, Any]
) -> Sequence[Elements | Ephemeris]:
    """Return the targets named, or all of the source without names, that match the pattern."""
    pattern = options["pattern"]
    found = find_targets(context, list(dict.fromkeys(keys)), options["ephemeris"], start)
    # Two names may mean one object, whose passes are listed once.
    own = {(one.catalog_number, one.label, one.epoch): one for one in found}
    chosen = list(own.values()) if keys else found
    if pattern is None:
        return chosen
    matching = [e for e in chosen if fnmatch.fnmatchcase(e.name.casefold(), pattern.casefold())]
    if not matching:
        raise SattrackError(
            f"no satellite's name matches {pattern!r}; `sattrack elements show` lists the names"
        )
    return matching


def _search(
    context: CommandContext, chosen: Sequence[Elements | Ephemeris], start: Utc, options: dict[str, Any]
) -> CataloguePasses:
    """Search by SGP4 for many at a time, where nothing but elements is asked for."""
    horizon = _horizon(context, options)
    elements = [one for one in chosen if isinstance(one, Elements)]
    if len(elements) < len(chosen):
        from tle.passes import find_ephemeris_passes

        return find_ephemeris_passes(chosen, context.site(), start, options["hours"], horizon)
    from tle.passes import find_catalogue_passes

    return find_catalogue_passes(
        elements,
        context.site(),
        start,
        options["hours"],
        horizon,
        workers=os.cpu_count() or 1,
        progress=_progress("searched {done} of {total} objects", len(chosen)),
    )


def _horizon(context: CommandContext, options: dict[str, Any]) -> Horizon:
    from tle.horizon import Horizon, HorizonMask

    least_deg = options["min_alt_deg"]
    if least_deg is None:
        least_deg = context.settings.min_altitude_deg
    mask = HorizonMask.read(options["mask_file"]) if options["mask_file"] else None
    return Horizon(least_deg, mask)


def _progress(text: str, total: int) -> Callable[[int, int], None] | None:
    """Return what shows on the terminal how far long work is, and wipes that at its end; else None."""
    if total < _FEWEST_FOR_PROGRESS or not sys.stderr.isatty():
        return None
    return lambda done, all_: renew(text.format(done=done, total=all_) if done < all_ else "")


def _tell_age(passes: CataloguePasses) -> None:
    """Say where elements are too far from the search for its times to hold."""
    sets = [e for e in passes.elements if isinstance(e, Elements)]
    old = [e for e in sets if abs(passes.start - e.epoch) > _OLD_DAYS * DAY_S]
    if not old:
        return
    days = (passes.start - old[0].epoch) / DAY_S
    side = "before" if days > 0.0 else "after"
    others = f" and {len(old) - 1} more" if old[1:] else ""
    tell(
        f"the elements of {old[0].label} are from {abs(days):.0f} days {side} the search{others}: "
        "passes may come early or late, or not at all"
    )


def _tell_failures(passes: CataloguePasses, named: bool) -> None:
    """Raise what SGP4 says of satellites asked for by name; of a catalogue's, tell how many there are."""
    if not passes.failed:
        return
    if named:
        raise passes.failed[0][1]
    count, first = len(passes.failed), passes.failed[0][1]
    tell(f"{count} of {len(passes.elements)} objects left out, the first: {first}")


def _magnitudes(options: dict[str, Any]) -> dict[int, float]:
    """Return the intrinsic magnitudes of --magnitudes by catalogue number."""
    if options["magnitudes_file"] is None:
        return {}
    from tle.facts import read_magnitudes

    return read_magnitudes(options["magnitudes_file"])


def _table(
    passes: CataloguePasses, known: dict[int, float], separations: bool, options: dict[str, Any]
) -> PassTable:
    """Return the passes with their facts that all filters let through."""
    from sattrack.cli.passes_output import PassTable, light_known
    from tle.facts import fact_columns, sun_altitudes_deg

    index = np.arange(len(passes))
    if options["dark"]:
        # The Sun's altitude is known at once: what it rules out needs no other facts.
        index = np.flatnonzero(sun_altitudes_deg(passes) <= _DARK_SUN_DEG)
    progress = _progress("looked at {done} of {total} passes", len(index))
    facts = fact_columns(passes, index, known, progress, separations, workers=os.cpu_count() or 1)
    table = PassTable(passes, index, facts)
    keep = np.ones(len(table), dtype=bool)
    if options["sunlit"]:
        keep &= (np.diff(table.facts.sunlit.starts(len(table))) > 0) & light_known(table)
    if options["max_rate_deg_s"] is not None:
        keep &= table.peak_rate_deg_s <= options["max_rate_deg_s"]
    if options["faintest"] is not None:
        keep &= table.magnitude <= options["faintest"]
    return table.take(np.flatnonzero(keep))


def _judged(context: CommandContext, table: PassTable, options: dict[str, Any]) -> PassTable:
    """Return the rows with a verdict by the mount's limits where one was asked for, else as they are."""
    if not (options["feasible"] or options["judged"]):
        return table
    from sattrack.cli.passes_output import judged_table

    profile = context.profile(options["profile"]).mount
    progress, workers = _progress("judged {done} of {total} passes", len(table)), os.cpu_count() or 1
    judged = judged_table(table, profile, context.settings.safety.limits(), progress, workers)
    if not options["feasible"]:
        return judged
    return judged.take(np.flatnonzero([why is None for why in judged.why_not]))
