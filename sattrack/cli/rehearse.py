"""`sattrack rehearse`: the coming pass run against the mount's limits beforehand."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import click
import msgspec

from sattrack.cli.common import CommandContext, common_options, profile_option, tell
from sattrack.core.errors import BadInputError
from sattrack.runtime.facts import REFRACTION_MODES

NO_GO = 1
"""The exit code of a pass that is not worth beginning: it could not be done."""


@click.command("rehearse")
@click.argument("satellite")
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
def command(context: CommandContext, satellite: str, number: int, **options: Any) -> int:
    """Tell before a pass what the mount will not manage: what is lost, when, to which limit.

    SATELLITE is a catalogue number, an international designator or a name. Nothing is moved. The exit code is
    0 for a go and 1 for a no-go.
    """
    from sattrack.cli.rehearse_text import report_lines
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
    request = RunRequest(
        satellite=satellite,
        mount_url="sim",
        elements=context.elements() if context.sources() else None,
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
        click.echo("\n".join(report_lines(rehearsal.report)))
    return 0 if rehearsal.report.go else NO_GO
