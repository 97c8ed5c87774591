"""`sattrack ephemeris`: directions and rates of a target, as a table, CSV, JSON or a plot."""

from __future__ import annotations

import csv
import json
import sys
from typing import TYPE_CHECKING, Any

import click
import numpy as np

from sattrack.cli.common import PLOT, CommandContext, common_options, given_instant, satellite_names
from sattrack.cli.output import tell
from sattrack.cli.targets import ephemeris_option, find_targets
from sattrack.core import local_time
from sattrack.core.errors import BadInputError
from sattrack.views.formatting import file_error
from tle.bias import Bias
from tle.bodies import Body
from tle.elements import Elements
from tle.ephemeris import TableEphemeris
from tle.errors import PropagationError
from tle.instants import Utc
from tle.propagator import Propagator
from tle.refraction import Refraction

if TYPE_CHECKING:
    from pathlib import Path

    from tle.direction import Direction
    from tle.ephemeris import Ephemeris
    from tle.site import Site

_DEFAULT_SPAN_S = 600.0
_OLD_DAYS = 7.0
FIELDS = (
    "ra_deg",
    "dec_deg",
    "ra_rate_deg_s",
    "dec_rate_deg_s",
    "ha_deg",
    "ha_rate_deg_s",
    "alt_deg",
    "az_deg",
    "alt_rate_deg_s",
    "az_rate_deg_s",
    "range_km",
    "range_rate_km_s",
    "sunlit",
)
# Column titles, widths and decimals of the table: fractions of an arcsecond, and of an arcsecond a second.
_TABLE = (
    ("ra_deg", "RA °", 12, 6),
    ("dec_deg", "Dec °", 12, 6),
    ("ra_rate_deg_s", "dRA °/s", 12, 7),
    ("dec_rate_deg_s", "dDec °/s", 12, 7),
    ("ha_deg", "HA °", 12, 6),
    ("alt_deg", "Alt °", 11, 5),
    ("az_deg", "Az °", 11, 5),
    ("range_km", "Range km", 16, 3),
    ("range_rate_km_s", "km/s", 10, 5),
)


@click.command("ephemeris")
@click.argument("target", shell_complete=satellite_names)
@ephemeris_option
@click.option("--from", "start", metavar="UTC", help="First instant; now if not given.")
@click.option("--to", "stop", metavar="UTC", help="Last instant; ten minutes after the first if not given.")
@click.option("--step", "step_s", type=float, default=10.0, show_default=True, metavar="S", help="Seconds.")
@click.option(
    "--place",
    type=click.Choice(["apparent", "geometric", "astrometric"]),
    default="apparent",
    show_default=True,
    help="With light time and diurnal aberration, with neither, or in the ICRF as a plate solution gives it.",
)
@click.option("--bias-along", type=float, default=0.0, metavar="S", help="Seconds; positive leads.")
@click.option(
    "--bias-cross",
    type=float,
    default=0.0,
    metavar="DEG",
    help="Positive to your left as you face the way it flies.",
)
@click.option("--refraction", is_flag=True, help="Apply refraction; without it, directions are airless.")
@click.option("--pressure", type=float, metavar="HPA", help="At the site; default: by its height.")
@click.option("--temperature", type=float, metavar="C", help="At the site; default: by its height.")
@click.option("--no-diurnal-aberration", is_flag=True, help="Omit this effect of up to 0.3″.")
@click.option(
    "--format",
    "style",
    type=click.Choice(["table", "csv", "json"]),
    default="table",
    show_default=True,
    help="A table of local times, csv, or json.",
)
@click.option("--plot", type=PLOT, help="Sky track and rates as an image.")
@common_options("site", "elements", "clock", "json", "utc")
def command(context: CommandContext, target: str, **options: Any) -> int:
    """Give directions and rates of TARGET.

    TARGET is a satellite (catalogue number, international designator or name), Sun, Moon or a planet, or
    RA,DEC in the ICRS (83.6331,22.0145 or 05:34:31,+22:00:52). With --ephemeris it is an object of that file.

    \b
    Examples:
      sattrack ephemeris ISS --from 2026-10-02T13:04:00Z --to 2026-10-02T13:07:00Z
      sattrack ephemeris Moon --step 60 --refraction --format csv
    """
    if context.json and options["style"] == "csv":
        raise BadInputError("give only one of --json and --format csv")
    start = given_instant("--from", options["start"]) if options["start"] else context.now()
    site = context.site()
    (elements,) = find_targets(context, [target], options["ephemeris"], start)
    stop = given_instant("--to", options["stop"]) if options["stop"] else start.plus(_DEFAULT_SPAN_S)
    times = Utc.range(start, stop, options["step_s"])
    propagator = Propagator(
        elements,
        site,
        Bias(options["bias_along"], options["bias_cross"]),
        refraction=_refraction(site, options),
        place=options["place"],
        diurnal_aberration=not options["no_diurnal_aberration"],
    )
    seen = propagator.at(times)
    _tell_about(elements, propagator, seen)
    if options["plot"]:
        _plot(options["plot"], elements, seen)
    absent = set() if elements.ranged else {"range_km", "range_rate_km_s"}
    if elements.shines if isinstance(elements, Body) else not elements.ranged:
        absent.add("sunlit")
    _print(seen, "json" if context.json else options["style"], frozenset(absent))
    return 0


def _refraction(site: Site, options: dict[str, Any]) -> Refraction | None:
    """Return the air that the options describe, None for none."""
    given = options["pressure"] is not None or options["temperature"] is not None
    if not options["refraction"]:
        if given:
            raise BadInputError("--pressure and --temperature need --refraction")
        return None
    standard = Refraction.standard(site.height_m)
    return Refraction(
        standard.pressure_hpa if options["pressure"] is None else options["pressure"],
        standard.temperature_c if options["temperature"] is None else options["temperature"],
    )


def _tell_about(elements: Elements | Ephemeris, propagator: Propagator, seen: Direction) -> None:
    """Say on standard error what a reader of the figures should know; raise where SGP4 gives none at all."""
    failed = np.flatnonzero(seen.error)
    if len(failed) == len(seen.utc):
        propagator.at(seen.utc[0])
    if len(failed):
        first = seen.utc[int(failed[0])]
        why = f"SGP4 error {int(seen.error[failed[0]])}, the first at {_instant(first)}"
        if not isinstance(elements, Elements):
            why = _why_none(propagator, first)
        tell(f"{elements.label}: {len(failed)} of {len(seen.utc)} instants have no position ({why})")
    if not isinstance(elements, Elements):
        sigma = ""
        if isinstance(elements, TableEphemeris):
            known = elements.covariance(seen.utc[0])
            sigma = f"; {file_error(None if known is None else known.sigma_km)}"
        tell(f"{elements.label}: {elements.provenance}, {elements.frame}{sigma}")
        return
    age_days = elements.age_s(seen.utc[0]) / 86400.0
    if abs(age_days) > _OLD_DAYS:
        side = "old at" if age_days > 0.0 else "ahead of"
        tell(
            f"elements of {elements.label} are {abs(age_days):.1f} days {side} the first instant: "
            "expect the satellite early or late"
        )


def _why_none(propagator: Propagator, at: Utc) -> str:
    """Return why there is no position at an instant."""
    try:
        propagator.at(at)
    except PropagationError as error:
        return str(error)
    return f"the first at {_instant(at)}"


def _instant(at: Utc) -> str:
    return local_time.instant(float(at.unix_s))


def _columns(seen: Direction, absent: frozenset[str]) -> dict[str, list[Any]]:
    """Return every field as a list of numbers, None where there is none."""
    columns = {}
    for name in FIELDS:
        values = getattr(seen, name)
        none = seen.error.astype(bool) | (name in absent)
        columns[name] = [
            None if missing else value for value, missing in zip(values.tolist(), none.tolist(), strict=True)
        ]
    return columns


def _print(seen: Direction, style: str, absent: frozenset[str]) -> None:
    """Print the rows, with nothing in the fields that are absent."""
    times = [seen.utc[i] for i in range(len(seen.utc))]
    columns = _columns(seen, absent)
    rows = zip(*columns.values(), strict=True)
    if style == "json":
        document = [
            {"utc": t.isoformat(), **dict(zip(FIELDS, row, strict=True))}
            for t, row in zip(times, rows, strict=True)
        ]
        click.echo(json.dumps(document, allow_nan=False))
    elif style == "csv":
        writer = csv.writer(sys.stdout, lineterminator="\n")
        writer.writerow(["utc", *FIELDS])
        for t, row in zip(times, rows, strict=True):
            writer.writerow([t.isoformat(), *("" if v is None else str(v).lower() for v in row)])
    else:
        _print_table(times, columns)


def _print_table(times: list[Utc], columns: dict[str, list[Any]]) -> None:
    """Print a table, its times local, with a line for each day."""
    click.echo("Time".ljust(13) + "".join(title.rjust(width) for _, title, width, _ in _TABLE) + "  Sun")
    day = ""
    for i, t in enumerate(times):
        utc_s = float(t.unix_s)
        date = f"{local_time.day(utc_s, 3)}, {local_time.zone_name(utc_s)}"
        if date != day:
            click.echo(date)
            day = date
        cells = []
        for name, _, width, decimals in _TABLE:
            value = columns[name][i]
            cells.append(("-" if value is None else f"{value:.{decimals}f}").rjust(width))
        lit = columns["sunlit"][i]
        cells.append({None: "  -", True: "  lit", False: "  dark"}[lit])
        click.echo(local_time.clock(utc_s, 3).ljust(13) + "".join(cells))


def _plot(path: Path, elements: Elements | Ephemeris, seen: Direction) -> None:
    """Draw the track on the sky, and the rates against time. Raises BadInputError where that cannot be."""
    from sattrack.recording.rendering import new_figure, save, sky_axes

    minutes = (seen.utc.unix_s - seen.utc.unix_s[0]) / 60.0
    figure = new_figure(11.0, 5.0)
    sky = figure.add_subplot(1, 2, 1, projection="polar")
    rates = figure.add_subplot(1, 2, 2)
    sky_axes(sky)
    up = seen.alt_deg > 0.0
    sky.plot(np.radians(seen.az_deg), np.where(up, 90.0 - seen.alt_deg, np.nan), color="tab:blue")
    sky.set_title("Sky, seen from below")
    rates.plot(minutes, seen.ha_rate_deg_s, label="hour angle")
    rates.plot(minutes, seen.dec_rate_deg_s, label="declination")
    rates.set_xlabel(f"minutes after {_instant(seen.utc[0])}")
    rates.set_ylabel("rate, °/s")
    rates.legend()
    rates.grid(visible=True, alpha=0.3)
    number = f" ({elements.catalog_number})" if elements.catalog_number else ""
    figure.suptitle(f"{elements.label}{number}")
    save(figure, path)
