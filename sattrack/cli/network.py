"""`sattrack network`: passes over many stations, who follows what, and what all of them have seen."""

from __future__ import annotations

import json
import math
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from sattrack.cli.common import (
    PLOT_ENDINGS,
    CommandContext,
    OutputFile,
    RenamedOption,
    common_options,
    given_instant,
)
from sattrack.cli.output import renew, say, tell, write_file
from sattrack.core.errors import BadInputError, SattrackError
from sattrack.core.local_time import duration
from tle.instants import Utc

if TYPE_CHECKING:
    from collections.abc import Callable

    from sattrack.network.engine import Engine
    from sattrack.network.night import Begun, Mounted, Wishes
    from sattrack.network.stations import Station

_path = click.Path(path_type=Path)
_stations_option = click.option(
    "--stations",
    "stations_file",
    type=_path,
    required=True,
    metavar="FILE",
    help="The stations, as TOML or CSV.",
)


def _output_option(text: str) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Return the option that names the folder to write."""
    return click.option(
        "--output",
        "--out",
        "out",
        cls=RenamedOption,
        type=_path,
        required=True,
        metavar="DIR",
        help=text,
    )


@click.command("passes")
@_stations_option
@click.option("--from", "start", metavar="UTC", help="Start of the search; default: now.")
@click.option(
    "--hours", type=float, default=24.0, show_default=True, metavar="H", help="Length of the search, hours."
)
@_output_option("The folder of the data set.")
@click.option(
    "--workers", type=click.IntRange(1, 1024), metavar="N", help="Share the work among N local processes."
)
@click.option(
    "--cluster", metavar="URL", help="Share it among the workers of a Dask scheduler, tcp://HOST:PORT."
)
@common_options("elements", "clock", "json")
def passes(
    context: CommandContext,
    stations_file: Path,
    start: str | None,
    hours: float,
    out: Path,
    workers: int | None,
    cluster: str | None,
) -> int:
    """Find the passes of all satellites over all stations, as a partitioned Parquet data set.

    The same command goes on where it was interrupted: finished files are verified and kept.

    \b
    Examples:
      sattrack network passes --stations s.toml --elements v.tle --output passes
      sattrack network passes --stations s.csv --output passes --workers 4
    """
    from sattrack.network.engine import make_data_set
    from sattrack.network.stations import read_stations
    from tle.passes import check_hours

    check_hours(hours)
    engine = _engine(workers, cluster)
    stations = read_stations(stations_file)
    _tell_in_the_sea(stations)
    elements = context.elements()
    begin = given_instant("--from", start) if start else context.now()
    _tell_orientation(stations, begin, hours)
    totals = make_data_set(out, stations, elements, (begin, hours), engine, _progress())
    if totals.refused:
        tell(f"{totals.refused} of {len(elements)} objects left out, the first: {totals.first_refusal}")
    figures = {name: getattr(totals, name) for name in ("partitions", "passes", "resumed", "seconds")}
    if context.json:
        click.echo(json.dumps(figures))
    else:
        there = f", {totals.resumed} of them were there" if totals.resumed else ""
        say(
            f"{totals.passes} passes over {len(stations)} stations in {totals.partitions} files{there}: "
            f"{out} ({totals.seconds:.1f} s)"
        )
    return 0


@click.command("assign")
@_stations_option
@click.option(
    "--passes", "data", type=_path, required=True, metavar="DIR", help="The data set of their passes."
)
@_output_option("The folder of the schedules.")
@click.option("--priorities", type=_path, metavar="FILE", help="Catalogue number and priority on each line.")
@click.option(
    "--seen", type=_path, metavar="FILE", help="Catalogue number and UTC of the last sight on each line."
)
@click.option(
    "--gap",
    "gap_hours",
    default=12.0,
    show_default=True,
    metavar="H",
    help="Once in H hours, a pass of a satellite counts in full.",
)
@click.option(
    "--repeat",
    default=0.25,
    show_default=True,
    metavar="SHARE",
    help="What its other passes count, as a share.",
)
@click.option(
    "--parallax",
    default=0.5,
    show_default=True,
    metavar="SHARE",
    help="What it adds if two stations see a satellite at once, as a share.",
)
@click.option(
    "--baseline",
    "baseline_km",
    default=100.0,
    show_default=True,
    metavar="KM",
    help="How far apart two such stations are at least.",
)
@click.option(
    "--longest",
    "longest_s",
    default=600.0,
    show_default=True,
    metavar="S",
    help="Follow for S seconds at most.",
)
@click.option("--any-light", is_flag=True, help="Take passes by day and in the Earth's shadow, too.")
@click.option(
    "--closed",
    multiple=True,
    metavar="STATION=FROM/TO",
    help="The station takes nothing in that time; may be repeated.",
)
@click.option(
    "--previous",
    type=_path,
    metavar="FILE",
    help="An earlier assignment.json: what has begun by now is kept.",
)
@click.option(
    "--seconds",
    default=60.0,
    show_default=True,
    metavar="S",
    help="Search for the best plan for S seconds at most.",
)
@click.option(
    "--plot",
    type=OutputFile(endings=(*PLOT_ENDINGS, ".html", ".htm")),
    metavar="FILE",
    help="Map and timeline of the night: PNG, SVG, PDF or HTML.",
)
@common_options("elements", "clock", "json")
def assign(
    context: CommandContext,
    stations_file: Path,
    data: Path,
    out: Path,
    closed: tuple[str, ...],
    **options: Any,
) -> int:
    """Assign satellites to stations and times, and write a schedule for each station.

    What a pass is worth: its priority, useful seconds and altitude; less for a satellite that was seen
    lately, more where two stations look at once. The gap to what no plan can exceed is printed.

    \b
    Examples:
      sattrack network assign --stations s.toml --passes passes --output night
    """
    from sattrack.network.night import by_object, data_set_span, plan_night, read_passes
    from sattrack.network.stations import read_stations

    stations = read_stations(stations_file)
    mounted = [_mounted(context, one) for one in stations]
    wishes = _wishes(context, stations, closed, options)
    elements = by_object(context.elements(), tell)
    passes = read_passes(data, mounted, wishes, elements, tell)
    try:
        out.mkdir(parents=True, exist_ok=True)
        span = data_set_span(data)
        progress = _work_progress()
        night = plan_night(passes, mounted, wishes, elements, out, span, options["seconds"], progress)
        document = night.document(mounted)
        write_file(out / "assignment.json", json.dumps(document, indent=1) + "\n")
    except OSError as error:
        raise SattrackError(f"{out}: cannot be written: {error.strerror or error}") from error
    if night.left_out:
        tell(f"{night.left_out} passes left out that the mounts' limits do not allow")
    if options["plot"] is not None:
        from sattrack.network.pictures import draw_night

        draw_night(options["plot"], night, mounted)
    if context.json:
        click.echo(json.dumps(document))
    else:
        figures = night.assigned
        say(
            f"{len(night.worths)} of {len(passes.value)} passes assigned to {len(stations)} stations: value "
            f"{figures.value:.0f}, at most {figures.bound:.0f} ({100.0 * figures.gap:.2f} % above); {out}"
        )
    return 0


def _mounted(context: CommandContext, station: Station) -> Mounted:
    from sattrack.cli.run_plan import within_half_a_turn
    from sattrack.network.night import Mounted

    profile = within_half_a_turn(context.profile(Path(station.profile) if station.profile else None))
    limits = context.settings.safety.limits()
    if station.min_altitude_deg < limits.floor_altitude_deg:
        raise BadInputError(
            f"{station.name}: min_altitude_deg is {station.min_altitude_deg:g}, and the mount is kept above "
            f"{limits.floor_altitude_deg:g}° (safety.floor_altitude_deg)"
        )
    return Mounted(station, profile.mount, limits)


def _wishes(
    context: CommandContext, stations: list[Station], closed: tuple[str, ...], options: dict[str, Any]
) -> Wishes:
    from sattrack.network.night import Wishes, read_closed
    from tle.sources import is_fetched

    for name in ("gap_hours", "longest_s", "seconds"):
        if not options[name] > 0.0:
            raise BadInputError(f"--{name.split('_')[0]} {options[name]:g}: give a number above 0")
    for name in ("repeat", "parallax"):
        if not 0.0 <= options[name] <= 1.0:
            raise BadInputError(f"--{name} {options[name]:g}: give a share from 0 to 1")
    now_s, begun = -math.inf, []
    if options["previous"] is not None:
        now_s = float(context.now().unix_s)
        begun = [one for one in _earlier(options["previous"]) if one.start_s < now_s]
    return Wishes(
        priorities=_numbers(options["priorities"], "the priorities", _priority),
        seen_s=_numbers(
            options["seen"], "when satellites were seen", lambda text: float(Utc.parse(text).unix_s)
        ),
        gap_s=3600.0 * options["gap_hours"],
        repeat=options["repeat"],
        parallax=options["parallax"],
        baseline_km=options["baseline_km"],
        longest_s=options["longest_s"],
        any_light=options["any_light"],
        closed=read_closed(closed, stations),
        now_s=now_s,
        sources=[one if is_fetched(one) else str(Path(one).resolve()) for one in context.sources()],
        begun=begun,
    )


def _earlier(file: Path) -> list[Begun]:
    from sattrack.network.night import Begun
    from sattrack.schedule.night import object_number
    from tle.errors import TleError

    try:
        rows: list[dict[str, Any]] = json.loads(file.read_text(encoding="utf-8"))["assignments"]
        return [
            Begun(
                one["station"],
                object_number(one["catalog_number"], one["name"]),
                *(float(Utc.parse(str(one[key])).unix_s) for key in ("start_utc", "end_utc")),
            )
            for one in rows
        ]
    except OSError as error:
        raise BadInputError(f"{file}: cannot read the assignment: {error.strerror}") from error
    except (ValueError, KeyError, TypeError, TleError):
        raise BadInputError(f"{file}: no assignment; give the assignment.json of an earlier one") from None


def _priority(text: str) -> float:
    value = float(text)
    if not 0.0 < value <= 1e6:
        raise ValueError(text)
    return value


def _numbers(file: Path | None, subject: str, read: Callable[[str], float]) -> dict[int, float]:
    """Return what a file says of satellites by catalogue number."""
    from tle.errors import TleError
    from tle.formats.rows import read_table

    found: dict[int, float] = {}
    for number, line, words in [] if file is None else read_table(file, subject):
        try:
            catalog_number, value = words
            found[int(catalog_number)] = read(value)
        except (ValueError, TleError):
            raise BadInputError(
                f"{file}:{number}: {line!r} does not say {subject}: write catalogue number and value, as "
                "25544 5 or 25544 2026-10-02T20:00:00Z"
            ) from None
    return found


@click.command("collect")
@click.argument("folder", type=_path, metavar="FOLDER")
@_stations_option
@_output_option("The folder of the results.")
@common_options("elements", "json")
def collect(context: CommandContext, folder: Path, stations_file: Path, out: Path) -> int:
    """Gather what the stations have seen, and refine the elements for all of them.

    FOLDER holds a folder of each station's name with its recordings and observations (TDM, CSV, IOD, JSON
    lines).

    \b
    Examples:
      sattrack network collect delivered --stations s.toml --output seen
    """
    from sattrack.network.collect import collect as gather
    from sattrack.network.collect import write_collected
    from sattrack.network.stations import read_stations

    stations, elements = read_stations(stations_file), context.elements()
    found = gather(folder, stations, elements, tell)
    write_collected(out, found, elements)
    figures = {
        "stations": len(found.by_station),
        "observations": found.observations,
        "used": sum(int(one.fit.used.sum()) for one in found.fits.values()),
        "refined": sorted(one.catalog_number for one in found.fits),
    }
    if context.json:
        click.echo(json.dumps(figures))
    else:
        say(
            f"{found.observations} observations of {len(found.by_station)} stations, {figures['used']} used; "
            f"elements of {len(found.fits)} satellites refined: {out}"
        )
    return 0


def _work_progress() -> Callable[[str, int, int], None] | None:
    if not sys.stderr.isatty():
        return None
    return lambda what, done, total: renew(f"{what} {done} of {total}" if done < total else "")


def _engine(workers: int | None, cluster: str | None) -> Engine:
    from sattrack.network.engine import LocalWorkers, in_this_process

    if cluster is not None:
        if workers is not None:
            raise BadInputError("give --workers or --cluster, not both")
        from sattrack.network.cluster import DaskCluster

        return DaskCluster(cluster, tell)
    return in_this_process if workers is None else LocalWorkers(workers)


def _tell_in_the_sea(stations: list[Station]) -> None:
    """Warn of stations whose place is high, and far from land: a sign or two numbers may be exchanged."""
    from sattrack.network.land import offshore_km

    for one in stations:
        if one.height_m > 500.0 and (away_km := offshore_km(one.latitude_deg, one.longitude_deg)) > 50.0:
            tell(
                f"warning: {one.name}: {one.height_m:g} m high at {one.latitude_deg:g}° north, "
                f"{one.longitude_deg:g}° east, which is in the sea, {away_km:.0f} km from land: check its "
                "signs, unless it is on an island of a few kilometres"
            )


def _tell_orientation(stations: list[Station], begin: Utc, hours: float) -> None:
    """Warn once where the Earth's orientation is not known for the whole span."""
    from tle.earth import EarthOrientation, Ground

    Ground(stations[0].site, EarthOrientation.installed(), float(begin.unix_s), hours * 3600.0)


def _progress() -> Callable[[int, int, int], None] | None:
    """Return what shows on a terminal how far the work is and how long the rest may take; else None."""
    if not sys.stderr.isatty():
        return None
    begun: list[tuple[float, int]] = []

    def show(done: int, total: int, count: int) -> None:
        begun.append((time.monotonic(), done))
        passed_s, fresh = begun[-1][0] - begun[0][0], done - begun[0][1]
        del begun[1:]
        left = f", about {duration(passed_s / fresh * (total - done))} left" if fresh else ""
        renew(f"{done} of {total} partitions, {count} passes{left}" if done < total else "")

    return show
