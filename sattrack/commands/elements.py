"""`sattrack elements`: what the element sets are, whether they are sound, how they fit observations."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from sattrack.commands.common import CommandContext, common_options
from sattrack.errors import BadInputError
from tle.errors import TleError
from tle.sources import find, load_elements, newest

if TYPE_CHECKING:
    from tle.elements import Elements
    from tle.observations import Observation
    from tle.sources import ElementSets

_DAY_S = 86400.0


@click.group("elements")
def command() -> None:
    """Look at element sets: show, check."""


@command.command("show")
@click.argument("satellites", nargs=-1)
@common_options
def show(context: CommandContext, satellites: tuple[str, ...]) -> int:
    """List the element sets in force: all, or those of the SATELLITES named."""
    elements = context.elements()
    chosen = [find(elements, key) for key in satellites] if satellites else elements
    now = context.now()
    rows = [_described(one, one.age_s(now) / _DAY_S) for one in chosen]
    if context.json:
        click.echo(json.dumps(rows))
        return 0
    click.echo(f"{'number':>9}  {'designator':<11} {'epoch UTC':<24} {'age d':>8}  name")
    for row in rows:
        click.echo(
            f"{row['catalog_number']:>9}  {row['designator'] or '-':<11} {row['epoch_utc'][:23] + 'Z':<24} "
            f"{row['age_days']:>8.2f}  {row['name'] or '-'}"
        )
    return 0


@command.command("check")
@click.argument("sources", nargs=-1)
@click.option(
    "--observations",
    type=click.Path(path_type=Path, dir_okay=False),
    help="CSV, IOD or CCSDS TDM of RA and Dec: lists how far the satellites are from the elements.",
)
@click.option(
    "--stations", type=click.Path(path_type=Path, dir_okay=False), help="List of the stations' places."
)
@common_options
def check(
    context: CommandContext, sources: tuple[str, ...], observations: Path | None, stations: Path | None
) -> int:
    """Read every set of the SOURCES (--elements if none is named) and tell which are refused, and why.

    Ends with 2 where any is refused.
    """
    places = sources or context.sources()
    if not places:
        raise BadInputError("no elements: name a file or folder, or give --elements FILE")
    sets = load_elements(*places)
    if not sets.accepted and not sets.rejected:
        raise BadInputError(f"{', '.join(map(str, places))}: no element sets")
    residuals = _residuals(context, sets, observations, stations) if observations else None
    if context.json:
        click.echo(json.dumps(_document(sets, residuals), allow_nan=False))
    else:
        for error in sets.rejected:
            click.echo(str(error))
        click.echo(f"{len(sets.accepted)} accepted, {len(sets.rejected)} rejected")
        for row in residuals or []:
            click.echo(_line(row))
    return 2 if sets.rejected else 0


def _described(one: Elements, age_days: float) -> dict[str, Any]:
    return {
        "name": one.name,
        "catalog_number": one.catalog_number,
        "designator": one.designator or None,
        "epoch_utc": one.epoch.isoformat(),
        "age_days": age_days,
        "inclination_deg": one.inclination_deg,
        "eccentricity": one.eccentricity,
        "mean_motion_rev_day": one.mean_motion_rev_day,
        "bstar_per_earth_radius": one.bstar_per_earth_radius,
    }


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
    from tle.observations import Stations, read_observations, read_stations

    site = context.site() if context.has_site() else None
    known = read_stations(stations, site) if stations else Stations({}, site)
    elements = newest(sets.accepted)
    return [_residual(one, elements) for one in read_observations(observations, known)]


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
