"""`sattrack network`: passes over many stations, who follows what, and what all of them have seen."""

from __future__ import annotations

import json
import math
import sys
import time
import warnings
from pathlib import Path
from typing import TYPE_CHECKING

import click

from sattrack.cli.common import CommandContext, common_options, renew, tell
from sattrack.core.errors import BadInputError
from tle.errors import EarthOrientationWarning
from tle.instants import Utc

if TYPE_CHECKING:
    from collections.abc import Callable

    from sattrack.network.engine import Engine
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


@click.command("passes")
@_stations_option
@click.option("--from", "start", metavar="UTC", help="Start of the search; default: now.")
@click.option(
    "--hours", type=float, default=24.0, show_default=True, metavar="H", help="Length of the search, hours."
)
@click.option("--out", type=_path, required=True, metavar="DIR", help="The folder of the data set.")
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
      sattrack network passes --stations stations.toml --elements visual.tle --out passes --workers 4
      sattrack network passes --stations stations.csv --hours 72 --out passes --cluster tcp://10.0.0.2:8786
    """
    from sattrack.network.engine import make_data_set
    from sattrack.network.stations import read_stations
    from tle.passes import check_hours

    check_hours(hours)
    engine = _engine(workers, cluster)
    stations = read_stations(stations_file)
    elements = context.elements()
    begin = Utc.parse(start) if start else context.now()
    _tell_orientation(stations, begin, hours)
    totals = make_data_set(out, stations, elements, (begin, hours), engine, _progress())
    if totals.refused:
        tell(f"{totals.refused} of {len(elements)} objects left out, the first: {totals.first_refusal}")
    figures = {name: getattr(totals, name) for name in ("partitions", "passes", "resumed", "seconds")}
    if context.json:
        click.echo(json.dumps(figures))
    else:
        there = f", {totals.resumed} of them were there" if totals.resumed else ""
        click.echo(
            f"{totals.passes} passes over {len(stations)} stations in {totals.partitions} files{there}: "
            f"{out} ({totals.seconds:.1f} s)"
        )
    return 0


def _engine(workers: int | None, cluster: str | None) -> Engine:
    from sattrack.network.engine import LocalWorkers, in_this_process

    if cluster is not None:
        if workers is not None:
            raise BadInputError("give --workers or --cluster, not both")
        from sattrack.network.cluster import DaskCluster

        return DaskCluster(cluster, tell)
    return in_this_process if workers is None else LocalWorkers(workers)


def _tell_orientation(stations: list[Station], begin: Utc, hours: float) -> None:
    """Warn once where the Earth's orientation is not known for the whole span."""
    from tle.earth import EarthOrientation, Ground

    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", EarthOrientationWarning)
        Ground(stations[0].site, EarthOrientation.installed(), float(begin.unix_s), hours * 3600.0)
    for text in dict.fromkeys(str(warning.message) for warning in caught):
        tell(f"warning: {text}")


def _progress() -> Callable[[int, int, int], None] | None:
    """Return what shows on a terminal how far the work is and how long the rest may take; else None."""
    if not sys.stderr.isatty():
        return None
    begun: list[tuple[float, int]] = []

    def show(done: int, total: int, count: int) -> None:
        begun.append((time.monotonic(), done))
        passed_s, fresh = begun[-1][0] - begun[0][0], done - begun[0][1]
        del begun[1:]
        left = f", about {_duration(passed_s / fresh * (total - done))} left" if fresh else ""
        renew(f"{done} of {total} partitions, {count} passes{left}" if done < total else "")

    return show


def _duration(seconds: float) -> str:
    minutes = math.ceil(seconds / 60.0)
    return (
        f"{seconds:.0f} s"
        if seconds < 90.0
        else f"{minutes // 60} h {minutes % 60} min"
        if minutes > 90
        else f"{minutes} min"
    )
