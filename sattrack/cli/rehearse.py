"""`sattrack rehearse`: the coming pass run against the mount's limits beforehand."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import msgspec

from sattrack.cli.common import CommandContext, common_options, profile_option, show, table, tell
from sattrack.cli.targets import ephemeris_option, find_target
from sattrack.core.errors import BadInputError
from sattrack.runtime.facts import REFRACTION_MODES
from tle.errors import printable

if TYPE_CHECKING:
    from rich.table import Table

    from sattrack.planning.rehearsal import CutMoment, RehearsalReport

NO_GO = 1
"""The exit code of a pass that is not worth beginning: it could not be done."""
ROWS = 9
"""Moments of the pass for which the time after a cut link is printed."""


@click.command("rehearse")
@click.argument("target")
@ephemeris_option
@click.option(
    "--pass",
    "number",
    type=int,
    default=1,
    show_default=True,
    metavar="N",
    help="1: now in progress, or next.",
)
@profile_option
@click.option("--refraction", type=click.Choice(REFRACTION_MODES), default="auto", show_default=True)
@click.option("--bias-along", type=float, default=0.0, metavar="S", help="Seconds; positive leads.")
@click.option(
    "--bias-cross",
    type=float,
    default=0.0,
    metavar="DEG",
    help="Degrees; positive to the left, seen from below.",
)
@click.option("--min-alt", type=float, metavar="DEG", help="Follow above this altitude (10, or as set).")
@click.option("--fov", "fov_deg", type=float, metavar="DEG", help="Field of view to hold the error against.")
@click.option(
    "--plot", type=click.Path(path_type=Path, dir_okay=False), help="Chart of the pass as an image (PNG)."
)
@common_options
def command(context: CommandContext, target: str, number: int, **options: Any) -> int:
    """Tell before a pass of TARGET what the mount will not manage: what is lost, when, to which limit.

    TARGET is a satellite (catalogue number, international designator or name), Moon or a planet, or RA,DEC;
    with --ephemeris an object of that file. Nothing is moved. The exit code is
    0 for a go and 1 for a no-go.
    """
    from sattrack.runtime.kernel_clock import read_kernel_clock
    from sattrack.runtime.prepare import RunRequest, prepare
    from sattrack.runtime.rehearse import choose_nth_pass, rehearse

    fov_deg = options["fov_deg"]
    if fov_deg is not None and not (math.isfinite(fov_deg) and 0.0 < fov_deg <= 180.0):
        raise BadInputError(f"--fov {fov_deg:g}: give the field's diameter in degrees, above 0")
    plot = options["plot"]
    if plot is not None and not plot.absolute().parent.is_dir():
        raise BadInputError(f"{plot}: there is no such folder to write the chart into")
    min_alt_deg = context.settings.min_altitude_deg if options["min_alt"] is None else options["min_alt"]
    elements = context.elements() if context.sources() else None
    request = RunRequest(
        satellite=target,
        target=find_target(context, target, options["ephemeris"], elements),
        mount_url="sim",
        elements=elements,
        site=context.site() if context.has_site() else None,
        clock_option=context.clock_option,
        min_alt_deg=min_alt_deg,
        refraction=options["refraction"],
        bias_along_s=options["bias_along"],
        bias_cross_deg=options["bias_cross"],
        virtual=True,
        profile=context.profile(options["profile"]),
        limits=context.settings.safety.limits(),
    )
    prepared = choose_nth_pass(prepare(request), number, min_alt_deg)
    if prepared.practising:
        tell("no elements or site set: rehearsing the built-in ISS pass over Leiden")
    clock = read_kernel_clock()
    error_s = clock.estimated_error_s if clock is not None and clock.synchronised else None
    rehearsal = rehearse(prepared, error_s, fov_deg)
    if plot is not None:
        from sattrack.cli.rehearse_plot import plot_rehearsal

        plot_rehearsal(plot, rehearsal)
    if context.json:
        click.echo(msgspec.json.encode(rehearsal.report).decode())
    else:
        show(*_shown(rehearsal.report))
    return 0 if rehearsal.report.go else NO_GO


def _shown(report: RehearsalReport) -> list[str | Table]:
    """Return the report for a terminal."""
    return [
        *_head(report),
        *_lost(report),
        *_limits(report),
        *_keyholes(report),
        *_sides(report),
        *_link_loss(report),
        *_budget(report),
        *(f"Note: {note}" for note in report.notes),
    ]


def _head(report: RehearsalReport) -> list[str | Table]:
    return [
        f"{printable(report.name)} from {report.start_utc[:19]}Z to {_clock(report.end_utc, report)}, "
        f"{report.max_alt_deg:.1f}° high at {_clock(report.culminate_utc, report)}, "
        f"with {printable(report.profile)}",
        click.style(report.verdict, fg="green" if report.go else "red", bold=True),
    ]


def _clock(utc: str, report: RehearsalReport, decimals: int = 0) -> str:
    """Return the time of day of an instant, after month and day where a pass goes on past midnight."""
    first = 11 if report.start_utc[:10] == report.end_utc[:10] else 5
    return utc[first : 19 + (decimals + 1 if decimals else 0)].replace("T", " ")


def _lost(report: RehearsalReport) -> list[str | Table]:
    if not report.lost:
        return []
    lost = table("Lost from", "to", ">seconds", "limit", "why")
    for one in report.lost:
        ends = (_clock(utc, report, 1) for utc in (one.from_utc, one.to_utc))
        lost.add_row(*ends, f"{one.seconds:.1f}", one.limit, one.why)
    return ["", lost]


def _limits(report: RehearsalReport) -> list[str | Table]:
    peaks = table("Axis", ">asked °/s", ">followed", ">limit", ">asked °/s²", ">limit")
    for peak in report.peaks:
        over = (
            peak.asked_rate_deg_s > peak.limit_rate_deg_s
            or peak.asked_acceleration_deg_s2 > peak.limit_acceleration_deg_s2
        )
        peaks.add_row(
            peak.axis.replace("_", " "),
            f"{peak.asked_rate_deg_s:.3f}",
            "-" if peak.reached_rate_deg_s is None else f"{peak.reached_rate_deg_s:.3f}",
            f"{peak.limit_rate_deg_s:g}",
            f"{peak.asked_acceleration_deg_s2:.3f}",
            f"{peak.limit_acceleration_deg_s2:g}",
            style="red" if over else None,
        )
    margins = table("Limit", ">nearest", "at")
    for margin in report.margins:
        margins.add_row(
            margin.limit.replace("_", " "),
            f"{margin.least_deg:.1f}°",
            _clock(margin.utc, report),
            style="red" if margin.least_deg < 0.0 else None,
        )
    return ["", peaks, "", margins]


def _keyholes(report: RehearsalReport) -> list[str | Table]:
    lines = []
    for hole in report.keyholes:
        through = "the mount cannot" if hole.through_pole_s is None else f"{hole.through_pole_s:.1f} s"
        lines.append(
            f"\nKeyhole at {_clock(hole.utc, report)}, {hole.polar_distance_deg:.2f}° from the pole, "
            f"{hole.peak_rate_deg_s:.1f} °/s: {hole.clipped_s:.1f} s lost by clipping, {hole.round_s:.1f} s "
            f"by the best way round, through the pole {through}; it goes {hole.chosen}"
        )
    return ["".join(lines)] if lines else []


def _sides(report: RehearsalReport) -> list[str | Table]:
    cables = report.cables
    return [
        f"\nSide: {report.sides.words}\n"
        f"Cables: the hour angle axis stands between {cables.low_deg:.0f}° and {cables.high_deg:.0f}°, "
        f"of {cables.limit_deg:g}° either way\n"
    ]


def _link_loss(report: RehearsalReport) -> list[str | Table]:
    loss = report.link_loss
    head = f"If the link is cut and the mount holds its rates: {_cut(loss.worst, report)}"
    if loss.watchdog_s is None:
        end = "The mount has no watchdog: nothing on this side can stop it then"
    elif loss.rests_inside:
        end = f"Its watchdog ({loss.watchdog_s:g} s) brings it to rest before any limit, whenever that is"
    else:
        end = click.style(f"Its watchdog ({loss.watchdog_s:g} s) comes too late at some moments", fg="red")
    return [head, *_cut_table(report), end]


def _cut_table(report: RehearsalReport) -> list[str | Table]:
    """Return the time to the first limit from moments of the pass; nothing where none is ever met."""
    loss = report.link_loss
    if loss.worst.seconds_to_limit is None:
        return []
    count = len(loss.curve)
    cuts = table("Cut at", ">to a limit", "limit", *([] if loss.watchdog_s is None else [">at rest"]))
    for k in sorted({round(k * (count - 1) / max(1, ROWS - 1)) for k in range(min(ROWS, count))}):
        moment = loss.curve[k]
        seconds = f"over {loss.looked_s:.0f} s"
        if moment.seconds_to_limit is not None:
            seconds = f"{moment.seconds_to_limit:.1f} s"
        rest = [] if moment.seconds_to_rest is None else [f"{moment.seconds_to_rest:.1f} s"]
        cuts.add_row(_clock(moment.utc, report), seconds, (moment.limit or "-").replace("_", " "), *rest)
    return [cuts]


def _cut(moment: CutMoment, report: RehearsalReport) -> str:
    if moment.seconds_to_limit is None:
        return f"no limit within {report.link_loss.looked_s / 60.0:.0f} minutes, at any moment"
    return (
        f"at worst {moment.seconds_to_limit:.1f} s to the {(moment.limit or '').replace('_', ' ')} limit "
        f"(cut at {_clock(moment.utc, report)})"
    )


def _budget(report: RehearsalReport) -> list[str | Table]:
    budget = report.budget
    at = f"at {_clock(budget.utc, report)}, {budget.alt_deg:.0f}° high"
    parts = table("Error expected, 1σ", ">along ″", ">across ″", at)
    for part in budget.parts:
        parts.add_row(part.name, f"{part.along_arcsec:.2f}", f"{part.across_arcsec:.2f}", part.why)
    words = ""
    if budget.fov_deg is not None:
        inside = "within" if budget.fits else "NOT within"
        words = f"two sigmas are {inside} a field of {budget.fov_deg:g}°"
    sums = (f"{budget.along_arcsec:.2f}", f"{budget.across_arcsec:.2f}")
    parts.add_row("all", *sums, words, style="bold")
    return ["", parts]
