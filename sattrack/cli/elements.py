"""`sattrack elements` and `sattrack biases`: element sets, and the biases remembered from earlier passes."""

from __future__ import annotations

import json
import math
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import msgspec
import numpy as np

from sattrack.cli.common import CommandContext, OutputFile, common_options, element_sources, satellite_names
from sattrack.cli.output import say, tell, write_file
from sattrack.cli.targets import Wanted, candidates, ephemeris_files, tell_disagreement, tell_left_out
from sattrack.core import local_time
from sattrack.core.errors import BadInputError
from sattrack.runtime.bias_memory import BiasMemory, KeptBias, describe, memory_file
from sattrack.views.formatting import arcsec, iso_unix_s
from tle.bodies import Body
from tle.elements import expected_along_arcsec, expected_along_s, propagation_error
from tle.errors import PropagationError, TleError
from tle.instants import Utc
from tle.propagator import Propagator
from tle.sources import WRITTEN, ElementSets, find, is_fetched, newest, write_elements

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tle.elements import Elements
    from tle.ephemeris import Ephemeris
    from tle.formats.observations import Observation
    from tle.site import Site

_DAY_S = 86400.0


@click.group("elements")
def command() -> None:
    """Get element sets, show what they say, check whether they are sound.

    \b
    Examples:
      sattrack elements get ISS --output iss.csv
      sattrack elements show ISS
    """


@command.command("get", short_help="Fetch or read element sets, and write the newest of each object.")
@click.argument("sources", nargs=-1, shell_complete=element_sources)
@click.option(
    "--satellite", "satellites", multiple=True, metavar="SAT", help="Only this one; may be repeated."
)
@click.option(
    "--format", "form", type=click.Choice(WRITTEN), help="What to write (csv, or json with --json)."
)
@click.option(
    "--output",
    type=OutputFile(),
    help="Write to this file instead of standard output.",
)
@common_options("elements", "json")
def get(
    context: CommandContext,
    sources: tuple[str, ...],
    satellites: tuple[str, ...],
    form: str | None,
    output: Path | None,
) -> int:
    """Read the SOURCES (--elements if none is named) and write the newest set of each object, as OMM or TLE.

    A source is a file, a folder, - (standard input), a URL, celestrak:GROUP, celestrak:NUMBER,
    spacetrack:all, spacetrack:NUMBER, or a satellite, which is asked of CelesTrak: ISS, 25544, 1998-067A.
    Exits with 1 if any set is refused.

    \b
    Examples:
      sattrack elements get ISS --output iss.csv
      sattrack elements get celestrak:stations --format tle --output stations.tle
    """
    if context.json and form not in (None, "json") and output is None:
        raise BadInputError(f"give only one of --json and --format {form}")
    named = [source for source in sources if _is_satellite(source)]
    others = tuple(source for source in sources if source not in named)
    sets = ElementSets() if named and not others else context.load(_places(context, others), renewing=True)
    sets.accepted.extend(context.fetched(named, renewing=True) if named else ())
    if sets.rejected and not sets.accepted:
        raise sets.rejected[0]
    _tell_refused(sets)
    chosen = newest(sets.accepted)
    if satellites:
        chosen = [find(chosen, key) for key in satellites]
    text = write_elements(
        chosen, form or ("json" if context.json else "csv"), _utc_now().isoformat("seconds"), "SATTRACK"
    )
    if output is None:
        click.echo(text, nl=False)
    else:
        write_file(output, text)
        tell(f"{len(chosen)} element {'set' if len(chosen) == 1 else 'sets'} written to {output}")
    return 1 if sets.rejected else 0


@command.command("show", short_help="Show elements, and what their age means.")
@click.argument("satellites", nargs=-1, shell_complete=satellite_names)
@common_options("elements", "clock", "json", "utc")
def show(context: CommandContext, satellites: tuple[str, ...]) -> int:
    """Show the elements of the SATELLITES and what their age means; without any, one line for each set.

    \b
    Examples:
      sattrack elements show ISS
      sattrack elements show --elements stations.tle
    """
    elements = context.elements(*satellites)
    now = context.now()
    chosen = [find(elements, key) for key in satellites] if satellites else elements
    rows = [_described(one, now) for one in chosen]
    if context.json:
        click.echo(json.dumps(rows, allow_nan=False))
    elif satellites:
        say("\n\n".join(_description(row) for row in rows))
    else:
        say(f"{'number':>9}  {'designator':<11} {'epoch':<28} {'age d':>8}  name")
        for row in rows:
            say(
                f"{row['catalog_number']:>9}  {row['designator'] or '-':<11} "
                f"{_epoch(row, 3):<28} {row['age_days']:>8.2f}  {row['name'] or '-'}"
            )
    return 0


@command.command("check", short_help="Report which element sets are refused, and why.")
@click.argument("sources", nargs=-1, shell_complete=element_sources)
@click.option(
    "--observations",
    type=click.Path(path_type=Path, dir_okay=False),
    help="CSV, IOD, CCSDS TDM or JSON lines of RA and Dec: lists how far satellites are from the elements.",
)
@click.option(
    "--stations", type=click.Path(path_type=Path, dir_okay=False), help="List of the stations' places."
)
@common_options("site", "elements", "json")
def check(
    context: CommandContext, sources: tuple[str, ...], observations: Path | None, stations: Path | None
) -> int:
    """Read every set of the SOURCES (--elements if none is named) and report which are refused, and why.

    Exits with 1 if any is refused.

    \b
    Examples:
      sattrack elements check stations.tle
    """
    sets = context.load(_places(context, sources))
    residuals = _residuals(context, sets, observations, stations) if observations else None
    if context.json:
        click.echo(json.dumps(_document(sets, residuals), allow_nan=False))
    else:
        for error in sets.rejected:
            say(str(error))
        say(f"{len(sets.accepted)} accepted, {len(sets.rejected)} rejected")
        for row in residuals or []:
            say(_line(row))
    return 1 if sets.rejected else 0


@command.command("compare", short_help="Compare what several sources say of one satellite.")
@click.argument("satellite", shell_complete=satellite_names)
@ephemeris_files
@common_options("site", "elements", "clock", "json")
def compare(context: CommandContext, satellite: str, ephemeris: tuple[Path, ...]) -> int:
    """Compare the ephemerides of SATELLITE that files and element sources have, the best one first.

    They are compared for the pass in progress, else the next, where a site is set; else for now. The angle is
    how far each is seen from the best one when the pass is highest. What has nothing of SATELLITE is left
    out, and named on standard error with the reason.

    \b
    Examples:
      sattrack elements compare ISS --elements old.tle --elements new.tle
      sattrack elements compare lageos1 --ephemeris lageos1.cpf
    """
    site = context.site() if context.has_site() else None
    wanted = Wanted(context.now(), context.settings.min_altitude_deg)
    known, left_out = candidates(context, satellite, ephemeris, wanted, site)
    at = known[0].window.at
    rows = []
    for one in known:
        off = None if site is None else _apart_arcsec(known[0].target, one.target, site, at)
        age_s = None if isinstance(one.target, Body) else at - one.target.epoch
        rows.append(
            {
                "source": one.origin,
                "provenance": one.target.provenance,
                "name": one.target.label,
                "age_days": None if age_s is None else age_s / _DAY_S,
                "expected_error_m": one.error_m,
                "over": one.rank.over,
                "whole_pass": not one.rank.in_part,
                "from_best_arcsec": off,
            }
        )
    tell_left_out(left_out)
    for one in known[1:]:
        tell_disagreement(known[0], one)
    if context.json:
        others = [{"source": one.origin, "reason": one.reason} for one in left_out]
        document = {"utc": at.isoformat("seconds"), "ephemerides": rows, "left_out": others}
        click.echo(json.dumps(document))
    else:
        for one, row in zip(known, rows, strict=True):
            away = (
                "" if row["from_best_arcsec"] is None else f", {row['from_best_arcsec']:.1f}″ from the best"
            )
            say(f"{one.text}{away}")
    return 0


def _apart_arcsec(
    best: Elements | Ephemeris, other: Elements | Ephemeris, site: Site, at: Utc
) -> float | None:
    """Return how far apart two ephemerides of one object are seen; None where the other has no place."""
    try:
        one, two = (Propagator(each, site).at(at).unit for each in (best, other))
    except PropagationError:
        return None
    return math.degrees(2.0 * math.asin(min(1.0, 0.5 * float(np.linalg.norm(one - two))))) * 3600.0


def _places(context: CommandContext, sources: tuple[str, ...]) -> tuple[str, ...]:
    places = sources or context.sources()
    if not places:
        raise BadInputError("no elements: name a file, folder, URL or celestrak:GROUP, or give --elements")
    return places


def _is_satellite(source: str) -> bool:
    """Tell whether a source names a satellite: it is no file that exists, and looks like no path."""
    return not (source == "-" or is_fetched(source) or set("/.:") & set(source) or Path(source).exists())


def _tell_refused(sets: ElementSets) -> None:
    for error in sets.rejected:
        tell(f"refused: {str(error).splitlines()[0]}")


def _utc_now() -> Utc:
    return Utc.of(time.time())


def _described(one: Elements, now: Utc) -> dict[str, Any]:
    return {
        "name": one.name,
        "catalog_number": one.catalog_number,
        "designator": one.designator or None,
        "epoch_utc": one.epoch.isoformat(),
        "age_days": one.age_s(now) / _DAY_S,
        "period_min": one.period_s / 60.0,
        "apogee_km": one.apogee_km,
        "perigee_km": one.perigee_km,
        "inclination_deg": one.inclination_deg,
        "eccentricity": one.eccentricity,
        "mean_motion_rev_day": one.mean_motion_rev_day,
        "bstar_per_earth_radius": one.bstar_per_earth_radius,
        "expected_along_s": expected_along_s(one, now),
        "expected_along_arcsec": expected_along_arcsec(one, now),
        "cannot_be_followed": _why_not(one, now),
    }


def _why_not(one: Elements, now: Utc) -> str | None:
    """Return SGP4's reason where it cannot tell the object's place now."""
    try:
        code, _, _ = one.satrec().sgp4(*now.split())
    except PropagationError as error:
        return str(error)
    if code:
        return str(propagation_error(code, one, now))
    if one.perigee_km < 0.0:
        return f"its perigee is {-one.perigee_km:.0f} km inside the Earth: it is sub-orbital"
    return None


def _epoch(row: dict[str, Any], decimals: int = 0) -> str:
    """Return the epoch as date, local time and zone."""
    utc_s = iso_unix_s(row["epoch_utc"])
    date, clock = local_time.date(utc_s, decimals), local_time.clock(utc_s, decimals)
    return f"{date} {clock} {local_time.zone_name(utc_s)}"


def _description(row: dict[str, Any]) -> str:
    """Return what a person wants to know of an object, several lines."""
    age = f"{abs(row['age_days']):.2f} days {'old' if row['age_days'] >= 0.0 else 'to come'}"
    lines = [
        f"{row['name'] or 'no name'}   {row['catalog_number']}   {row['designator'] or '-'}",
        f"  epoch        {_epoch(row)}, {age}",
        f"  period       {row['period_min']:.2f} min",
        f"  apogee       {row['apogee_km']:.0f} km",
        f"  perigee      {row['perigee_km']:.0f} km",
        f"  inclination  {row['inclination_deg']:.4f}°",
        f"  expect it    within about {row['expected_along_s']:.2g} s along its track: "
        f"{arcsec(row['expected_along_arcsec'])} overhead, if it has not manoeuvred",
    ]
    if row["cannot_be_followed"]:
        lines.append(f"  but          {row['cannot_be_followed']}")
    return "\n".join(lines)


def _document(sets: ElementSets, residuals: list[dict[str, Any]] | None) -> dict[str, Any]:
    document: dict[str, Any] = {
        "accepted": len(sets.accepted),
        "rejected": [
            {
                "line": error.line,
                "name": error.name or None,
                "catalog_number": error.catalog_number,
                "reason": f"{error.source}: {error.reason}" if error.source else error.reason,
            }
            for error in sets.rejected
        ],
    }
    if residuals is not None:
        document["residuals"] = residuals
    return document


def _residuals(
    context: CommandContext, sets: ElementSets, observations: Path, stations: Path | None
) -> list[dict[str, Any]]:
    """Return one row for each observation: the biases that it implies, or the reason why it implies none."""
    from tle.formats.observations import Stations, read_observations, read_stations

    site = context.site() if context.has_site() else None
    known = read_stations(stations, site) if stations else Stations({}, site)
    seen = read_observations(observations, known)
    elements = newest(sets.accepted, max(one.utc for one in seen))
    return [_residual(one, elements) for one in seen]


def _residual(observation: Observation, elements: list[Elements]) -> dict[str, Any]:
    row: dict[str, Any] = {
        "line": observation.line,
        "utc": observation.utc.isoformat(),
        "name": None,
        "catalog_number": None,
        "along_s": None,
        "along_sigma_s": None,
        "cross_arcsec": None,
        "cross_sigma_arcsec": None,
        "separation_arcsec": None,
        "reason": None,
    }
    try:
        one = _object(observation, elements)
        estimate = observation.residual(one)
    except TleError as error:
        row["reason"] = str(error).splitlines()[0]
        return row
    row.update(
        name=one.name or None,
        catalog_number=one.catalog_number,
        along_s=estimate.along_s,
        along_sigma_s=estimate.along_sigma_s,
        cross_arcsec=estimate.cross_deg * 3600.0,
        cross_sigma_arcsec=estimate.cross_sigma_deg * 3600.0,
        separation_arcsec=estimate.separation_arcsec,
    )
    return row


def _object(observation: Observation, elements: list[Elements]) -> Elements:
    if observation.object_key:
        return find(elements, observation.object_key)
    if len(elements) == 1:
        return elements[0]
    raise observation.error(f"names no object, and there are {len(elements)}: name it in the observations")


def _line(row: dict[str, Any]) -> str:
    if row["reason"] is not None:
        return f"{row['utc']}  -  {row['reason']}"
    return (
        f"{row['utc']}  {row['along_s']:+10.4f} s ± {row['along_sigma_s']:.4f}  "
        f"{row['cross_arcsec']:+10.2f}″ ± {row['cross_sigma_arcsec']:.2f}  "
        f"{row['separation_arcsec']:9.1f}″ away  {row['name'] or row['catalog_number']}"
    )


@click.command("biases")
@click.option(
    "--drop", "dropped", type=int, multiple=True, metavar="ENTRY", help="Do not offer this one again."
)
@common_options("json", "utc")
def biases(context: CommandContext, dropped: tuple[int, ...]) -> int:
    """Show the biases remembered from earlier passes, the newest first, as they were found.

    Each is offered for passes of its object with the same elements.

    \b
    Examples:
      sattrack biases
      sattrack biases --drop 2
    """
    memory = BiasMemory(memory_file())
    for entry in dropped:
        if not memory.drop(entry):
            raise BadInputError(f"--drop {entry}: there is no such entry; sattrack biases lists them")
    entries = memory.entries()
    if context.json:
        click.echo(msgspec.json.encode(entries).decode())
    elif entries:
        say("\n".join(_bias_lines(entries, time.time())))
    else:
        tell(f"nothing is remembered in {memory.path}")
    return 0


def _bias_lines(entries: Sequence[KeptBias], now_utc_s: float) -> list[str]:
    lines = []
    for one in entries:
        epoch = local_time.instant(one.elements_epoch_utc_s)
        state = "  DROPPED" if one.dropped else ""
        name = one.name or str(one.catalog_number)
        lines.append(f"{one.entry:4d}  {name} ({one.catalog_number}), elements of {epoch}{state}")
        lines.append(
            f"      {local_time.localised(describe(one, now_utc_s))}; by the {one.made_by}, {one.mount}"
        )
    return lines
