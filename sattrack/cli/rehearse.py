"""`sattrack rehearse`: the coming pass run against the mount's limits beforehand, as text or a picture."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click
import msgspec
import numpy as np

from sattrack.cli.common import (
    PLOT,
    CommandContext,
    common_options,
    profile_option,
    refraction_option,
    satellite_names,
)
from sattrack.cli.output import renew, share_progress, show, table, tell
from sattrack.cli.targets import Wanted, ephemeris_option, followed
from sattrack.core import local_time
from sattrack.mount.model import whole_title
from sattrack.recording.rendering import INK, PALE, label_times, new_figure, save, sky_axes, times
from sattrack.views.formatting import iso_unix_s, limit_title

if TYPE_CHECKING:
    from datetime import datetime
    from pathlib import Path

    from numpy.typing import NDArray

    from sattrack.runtime.rehearse import Rehearsal

    Array = NDArray[np.float64]
    from rich.table import Table
    from rich.text import Text

    from sattrack.planning.rehearsal import CutMoment, RehearsalReport

    Parts = list[str | Text | Table]

GOOD, BAD, SUN, MOON = "#1f77b4", "#d1495b", "#edae49", "#7d7d8a"


NO_GO = 1
"""The exit code of a pass that is not worth beginning: it could not be done."""
ROWS = 9
"""Moments of the pass for which the time after a cut link is printed."""


@click.command("rehearse")
@click.argument("target", shell_complete=satellite_names)
@ephemeris_option
@click.option(
    "--pass",
    "number",
    type=int,
    default=1,
    show_default=True,
    metavar="N",
    help="1 is the pass in progress, or the next.",
)
@click.option(
    "--mount",
    "mount_url",
    metavar="URL",
    help="Without a profile, assume what is usual of this kind of mount; nothing is sent to it.",
)
@profile_option
@refraction_option("Raise directions by the air's refraction; auto where the mount does not.")
@click.option("--bias-along", type=float, default=0.0, metavar="S", help="Seconds; positive leads.")
@click.option(
    "--bias-cross",
    type=float,
    default=0.0,
    metavar="DEG",
    help="Degrees; positive to your left as you face the way it flies.",
)
@click.option("--min-alt", type=float, metavar="DEG", help="Follow above this altitude (10, or as set).")
@click.option("--fov", "fov_deg", type=float, metavar="DEG", help="Field of view to compare the error with.")
@click.option("--plot", type=PLOT, help="Chart of the pass as an image (PNG).")
@common_options("site", "elements", "clock", "json", "utc")
def command(context: CommandContext, target: str, number: int, **options: Any) -> int:
    """Show before a pass of TARGET what the mount cannot follow: what is lost, when, and to which limit.

    TARGET is a satellite (catalogue number, international designator or name), Moon or a planet, or RA,DEC;
    with --ephemeris an object of that file. Nothing is moved. The exit code is
    0 for a go, and 1 for a no-go or a pass that `track` refuses.

    \b
    Examples:
      sattrack rehearse ISS
      sattrack rehearse ISS --pass 2 --plot pass.png
    """
    from sattrack.cli.running import too_old
    from sattrack.runtime.facts import RunRequest, check_field, prepare
    from sattrack.runtime.rehearse import choose_nth_pass, rehearse
    from sattrack.runtime.system import read_kernel_clock

    fov_deg = options["fov_deg"]
    check_field(fov_deg)
    plot = options["plot"]
    min_alt_deg = context.settings.min_altitude_deg if options["min_alt"] is None else options["min_alt"]
    wanted = Wanted(context.now(), min_alt_deg, number)
    found = followed(context, target, "sim", options["ephemeris"], wanted)
    request = RunRequest(
        satellite=target,
        target=found.target,
        mount_url="sim",
        elements=found.elements,
        site=found.site,
        culminate_utc_s=found.culminate_utc_s,
        clock_option=context.clock_option,
        min_alt_deg=min_alt_deg,
        refraction=options["refraction"],
        bias_along_s=options["bias_along"],
        bias_cross_deg=options["bias_cross"],
        virtual=True,
        profile=context.profile(options["profile"], _checked(options["mount_url"])),
        limits=context.settings.safety.limits(),
    )
    prepared = prepare(request)
    if found.culminate_utc_s is None:
        prepared = choose_nth_pass(prepared, number, min_alt_deg)
    old = None
    if prepared.practising:
        tell("no elements or site set: rehearsing the built-in ISS pass over Leiden")
    elif prepared.facts.elements is not None:
        start_s = prepared.facts.plan.start_utc_s
        old = too_old(prepared.facts.elements, start_s, fov_deg, context.sources())
        if old is not None:
            tell(f"`sattrack track` refuses this pass: {old}")
    clock = read_kernel_clock()
    error_s = clock.estimated_error_s if clock is not None and clock.synchronised else None
    rehearsal = rehearse(prepared, error_s, fov_deg, share_progress())
    renew()
    if plot is not None:
        plot_rehearsal(plot, rehearsal)
    if context.json:
        click.echo(msgspec.json.encode(rehearsal.report).decode())
    else:
        now_utc_s = None if prepared.practising else float(context.now().unix_s)
        show(*_shown(rehearsal.report, now_utc_s, prepared.facts.profile.axis_titles()))
    return 0 if rehearsal.report.go and old is None else NO_GO


def _checked(mount_url: str | None) -> str | None:
    """Return the URL of a mount; raises BadInputError where it can be none."""
    from sattrack.runtime.mounts import is_antenna, mount_address

    if mount_url is not None and not is_antenna(mount_url):
        mount_address(mount_url, resolve=False)
    return mount_url


def _shown(report: RehearsalReport, now_utc_s: float | None, axes: tuple[str, str]) -> Parts:
    """Return the report for a terminal; without `now_utc_s` not how long it is until the pass.

    `axes` are what the mount's axes are called.
    """
    return [
        *_head(report, now_utc_s),
        *_lost(report),
        *_limits(report, axes),
        *_keyholes(report),
        *_sides(report, axes[0]),
        *_link_loss(report, axes),
        *_budget(report),
        *(f"Note: {note}" for note in report.notes),
    ]


def _head(report: RehearsalReport, now_utc_s: float | None) -> Parts:
    from rich.text import Text

    start_s = iso_unix_s(report.start_utc)
    begins = ""
    if now_utc_s is not None:
        word = "begins" if start_s > now_utc_s - 1.0 else "began"
        begins = f"{word} {local_time.until(start_s - now_utc_s)}, "
    return [
        f"{report.name}: {local_time.span(start_s, iso_unix_s(report.end_utc))}, {begins}"
        f"{report.max_alt_deg:.1f}° high at {_clock(report.culminate_utc, report)}, "
        f"with {report.profile}",
        Text(report.verdict, style="bold green" if report.go else "bold red"),
    ]


def _clock(utc: str, report: RehearsalReport, decimals: int = 0) -> str:
    """Return the time of day of an instant, with the day where it is not that of the pass's start."""
    return local_time.moment(iso_unix_s(utc), iso_unix_s(report.start_utc), decimals)


def _lost(report: RehearsalReport) -> Parts:
    if not report.lost:
        return []
    lost = table("Lost from", "to", ">seconds", "limit", "why")
    for one in report.lost:
        ends = (_clock(utc, report, 1) for utc in (one.from_utc, one.to_utc))
        lost.add_row(*ends, f"{one.seconds:.1f}", one.limit, one.why)
    return ["", lost]


def _limits(report: RehearsalReport, names: tuple[str, str]) -> Parts:
    peaks = table("Axis", ">asked °/s", ">followed", ">limit", ">asked °/s²", ">limit")
    for name, peak in zip(names, report.peaks, strict=True):
        over = (
            peak.asked_rate_deg_s > peak.limit_rate_deg_s
            or peak.asked_acceleration_deg_s2 > peak.limit_acceleration_deg_s2
        )
        peaks.add_row(
            name,
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
            limit_title(margin.limit, names),
            f"{margin.least_deg:.1f}°",
            _clock(margin.utc, report),
            style="red" if margin.least_deg < 0.0 else None,
        )
    return ["", peaks, "", margins]


def _keyholes(report: RehearsalReport) -> Parts:
    lines = []
    for hole in report.keyholes:
        through = "the mount cannot" if hole.through_pole_s is None else f"{hole.through_pole_s:.1f} s"
        lines.append(
            f"\nKeyhole at {_clock(hole.utc, report)}, {hole.polar_distance_deg:.2f}° from the pole, "
            f"{hole.peak_rate_deg_s:.1f} °/s: {hole.clipped_s:.1f} s lost by clipping, {hole.round_s:.1f} s "
            f"by the best way round, through the pole {through}; it goes {hole.chosen}"
        )
    return ["".join(lines)] if lines else []


def _sides(report: RehearsalReport, axis: str) -> Parts:
    cables = report.cables
    return [
        f"\nSide: {local_time.localised(report.sides.words, iso_unix_s(report.start_utc))}\n"
        f"Cables: the {whole_title(axis)} stands between {cables.low_deg:.0f}° and {cables.high_deg:.0f}°, "
        f"of {cables.limit_deg:g}° either way\n"
    ]


def _link_loss(report: RehearsalReport, names: tuple[str, str]) -> Parts:
    from rich.text import Text

    loss = report.link_loss
    end: str | Text
    head = f"If the link is cut and the mount holds its rates: {_cut(loss.worst, report, names)}"
    if loss.watchdog_s is None:
        end = "The mount has no watchdog: with the link cut, only a switch for its power can stop it"
    elif loss.rests_inside:
        end = f"Its watchdog ({loss.watchdog_s:g} s) brings it to rest before any limit, whenever that is"
    else:
        end = Text(f"Its watchdog ({loss.watchdog_s:g} s) comes too late at some moments", style="red")
    return [head, *_cut_table(report, names), end]


def _cut_table(report: RehearsalReport, names: tuple[str, str]) -> Parts:
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
        cuts.add_row(_clock(moment.utc, report), seconds, limit_title(moment.limit or "-", names), *rest)
    return [cuts]


def _cut(moment: CutMoment, report: RehearsalReport, names: tuple[str, str]) -> str:
    if moment.seconds_to_limit is None:
        return f"no limit within {report.link_loss.looked_s / 60.0:.0f} minutes, at any moment"
    return (
        f"at worst {moment.seconds_to_limit:.1f} s to the {limit_title(moment.limit or '', names)} limit "
        f"(cut at {_clock(moment.utc, report)})"
    )


def _budget(report: RehearsalReport) -> Parts:
    budget = report.budget
    at = f"at {_clock(budget.utc, report)}, {budget.alt_deg:.0f}° high"
    parts = table("Error expected, 1σ", ">along ″", ">across ″", at)
    for part in budget.parts:
        parts.add_row(part.name, f"{part.along_arcsec:.2f}", f"{part.across_arcsec:.2f}", part.why)
    text = ""
    if budget.fov_deg is not None:
        inside = "within" if budget.fits else "NOT within"
        text = f"two sigmas are {inside} a field of {budget.fov_deg:g}°"
    sums = (f"{budget.along_arcsec:.2f}", f"{budget.across_arcsec:.2f}")
    parts.add_row("all", *sums, text, style="bold")
    return ["", parts]


LABELS_APART_DEG = 11.0
NEARLY_S = 5.0


COLOURS = {
    "keyhole": "#d1495b",
    "rate": "#e07a1f",
    "acceleration": "#b5651d",
    "altitude": "#6a4c93",
    "hour_angle": "#8338ec",
    "sun": "#edae49",
    "approach": "#2a9d8f",
    "acquisition": "#2a9d8f",
}


def plot_rehearsal(path: Path, rehearsal: Rehearsal) -> None:
    """Draw a rehearsal; raises BadInputError where that cannot be."""
    report = rehearsal.report
    figure = new_figure(13.0, 8.0)
    grid = figure.add_gridspec(3, 2, width_ratios=(1.0, 1.25), height_ratios=(1.0, 1.0, 0.9))
    _draw_sky(figure.add_subplot(grid[:2, 0], projection="polar"), rehearsal)
    _draw_error(figure.add_subplot(grid[2, 0]), rehearsal)
    rates = figure.add_subplot(grid[0, 1])
    _draw_rates(rates, rehearsal)
    _draw_run(figure.add_subplot(grid[1, 1], sharex=rates), rehearsal)
    _draw_cut(figure.add_subplot(grid[2, 1], sharex=rates), rehearsal)
    figure.suptitle(
        f"{report.name}, {local_time.span(iso_unix_s(report.start_utc), iso_unix_s(report.end_utc))}\n"
        f"{report.verdict}",
        color="#2a7f4f" if report.go else BAD,
        fontsize="medium",
        fontweight="bold",
    )
    save(figure, path)


def _stretches(rehearsal: Rehearsal) -> list[tuple[float, float, str]]:
    return [
        (iso_unix_s(lost.from_utc), iso_unix_s(lost.to_utc), lost.limit) for lost in rehearsal.report.lost
    ]


def _draw_sky(sky: Any, rehearsal: Rehearsal) -> None:
    path = rehearsal.path
    sky_axes(sky)
    azimuths = np.linspace(0.0, 360.0, 721)
    floor = np.clip(rehearsal.skyline_deg(azimuths), 0.0, 90.0)
    sky.fill_between(np.radians(azimuths), 90.0 - floor, 90.0, color="0.86", linewidth=0.0)
    angle, radius = np.radians(path.az_deg), 90.0 - path.alt_deg
    sky.plot(angle, radius, color=GOOD, linewidth=2.5, solid_capstyle="round", label="followed")
    labelled: set[str] = set()
    axes = rehearsal.ability.profile.axis_titles()
    for begin, end, limit in _stretches(rehearsal):
        part = (path.utc_s >= begin - 0.5) & (path.utc_s <= end + 0.5)
        label = None if limit in labelled else f"lost: {limit_title(limit, axes)}"
        labelled.add(limit)
        sky.plot(angle[part], radius[part], color=COLOURS.get(limit, BAD), linewidth=5.0, label=label)
    _mark_minutes(sky, rehearsal)
    pole = abs(rehearsal.ability.latitude_deg)
    azimuth = 0.0 if rehearsal.ability.latitude_deg >= 0.0 else np.pi
    sky.plot([azimuth], [90.0 - pole], "+", color=INK, markersize=11, markeredgewidth=1.5, label="pole")
    for name, colour, place in rehearsal.bodies():
        if place[0] > 0.0:
            sky.plot(
                [np.radians(place[1])],
                [90.0 - place[0]],
                "o",
                color=colour,
                markersize=13,
                markeredgecolor=INK,
                label=name,
            )
            if name == "Sun":
                _draw_cone(sky, place, rehearsal.sun_cone_deg)
    sky.legend(loc="upper left", bbox_to_anchor=(-0.12, 1.08), fontsize="small", frameon=False)
    sky.set_title("the sky from below", color=PALE, fontsize="small", y=-0.13)


def _draw_cone(sky: Any, place: tuple[float, float], cone_deg: float) -> None:
    """Draw the ring of so many degrees about a place of altitude and azimuth."""
    if not cone_deg > 0.0:
        return
    alt, az, cone = np.radians(place[0]), np.radians(place[1]), np.radians(cone_deg)
    round_ = np.linspace(0.0, 2.0 * np.pi, 181)
    sine = np.sin(alt) * np.cos(cone) + np.cos(alt) * np.sin(cone) * np.cos(round_)
    ring = np.arcsin(np.clip(sine, -1.0, 1.0))
    east = np.sin(round_) * np.sin(cone) * np.cos(alt)
    azimuths = az + np.arctan2(east, np.cos(cone) - np.sin(alt) * np.sin(ring))
    sky.plot(azimuths, 90.0 - np.degrees(ring), color=SUN, linewidth=1.5, linestyle="--")


def _mark_minutes(sky: Any, rehearsal: Rehearsal) -> None:
    path = rehearsal.path
    whole_s = float(path.utc_s[-1] - path.utc_s[0])
    step = 60.0 * max(1, round(whole_s / 60.0 / 8.0))
    first = np.ceil(path.utc_s[0] / 60.0) * 60.0
    labelled: list[Any] = []
    for at in np.arange(first, path.utc_s[-1], step):
        i = int(np.searchsorted(path.utc_s, at))
        angle, radius = np.radians(path.az_deg[i]), 90.0 - path.alt_deg[i]
        here = np.array([radius * np.cos(angle), radius * np.sin(angle)])
        if any(float(np.hypot(*(here - other))) < LABELS_APART_DEG for other in labelled):
            continue
        labelled.append(here)
        sky.plot([angle], [radius], "o", color="white", markersize=5, markeredgecolor=INK, zorder=5)
        sky.annotate(
            local_time.clock(float(at))[:5],
            (angle, radius),
            xytext=(6, 5),
            textcoords="offset points",
            fontsize="x-small",
            color=INK,
        )


def _shade(axes: Any, rehearsal: Rehearsal) -> None:
    for begin, end, limit in _stretches(rehearsal):
        low, high = times(np.array([begin, end]))
        axes.axvspan(low, high, color=COLOURS.get(limit, BAD), alpha=0.18, linewidth=0.0)


def _tidy(axes: Any) -> None:
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    axes.grid(color="0.92")


def _draw_rates(axes: Any, rehearsal: Rehearsal) -> None:
    path, profile = rehearsal.path, rehearsal.ability.profile
    at = times(path.utc_s)
    limits = profile.ra.max_rate_deg_s, profile.dec.max_rate_deg_s
    same = limits[0] == limits[1]
    first, second = profile.axis_titles()
    for name, rate, limit, colour in (
        (first, path.hour_angle_rate_deg_s, limits[0], GOOD),
        (second, path.dec_rate_deg_s, limits[1], "#2a9d8f"),
    ):
        axes.plot(at, np.abs(rate), color=colour, linewidth=1.8, label=f"{name} asked")
        if not same:
            axes.axhline(limit, color=colour, linestyle=(0, (4, 3)), linewidth=1.2, label=f"{name} limit")
    if same:
        axes.axhline(limits[0], color=BAD, linestyle=(0, (4, 3)), linewidth=1.2, label="limit of both")
    trace = rehearsal.performance.trace
    rows = trace.moving
    if rows.any():
        reached = np.where(rows, np.abs(trace.hour_angle_rate_deg_s), np.nan)
        axes.plot(times(trace.utc_s), reached, color=INK, linewidth=0.8, label=f"{first} reached")
    axes.set_yscale("log")
    typical = float(np.median(np.hypot(path.hour_angle_rate_deg_s, path.dec_rate_deg_s)))
    axes.set_ylim(bottom=float(np.clip(0.1 * typical, 1e-5, 0.005)))
    axes.set_xlim(at[0], at[-1])
    axes.set_ylabel("rate, °/s")
    axes.legend(fontsize="x-small", ncols=3, frameon=False, loc="upper right", bbox_to_anchor=(1.0, 1.16))
    _shade(axes, rehearsal)
    _tidy(axes)
    axes.tick_params(labelbottom=False)


def _nearly_end(rehearsal: Rehearsal) -> datetime:
    """Return a little before the end of the pass: what ends sooner was not run to its end."""
    return times(rehearsal.path.utc_s[-1:] - NEARLY_S)[0]


def _draw_run(axes: Any, rehearsal: Rehearsal) -> None:
    trace = rehearsal.performance.trace
    error = np.where(trace.moving, np.maximum(trace.total_arcsec, 1e-3), np.nan)
    axes.plot(times(trace.utc_s), error, color=INK, linewidth=1.0, label="error of the rehearsed run")
    axes.axhline(
        rehearsal.ability.tolerance_deg * 3600.0,
        color=BAD,
        linestyle=(0, (4, 3)),
        linewidth=1.2,
        label="on target below",
    )
    axes.set_yscale("log")
    axes.set_ylabel("error, ″")
    axes.legend(fontsize="x-small", ncols=2, frameon=False, loc="upper right", bbox_to_anchor=(1.0, 1.16))
    _shade(axes, rehearsal)
    run_until = times(trace.utc_s[-1:])
    if run_until and rehearsal.report.ended_by == "set" and run_until[0] < _nearly_end(rehearsal):
        axes.annotate(
            "not run: kinematics tell of the rest",
            (run_until[0], 0.5),
            xycoords=("data", "axes fraction"),
            xytext=(6, 0),
            textcoords="offset points",
            fontsize="small",
            color=PALE,
        )
    _tidy(axes)
    axes.tick_params(labelbottom=False)


def _draw_cut(axes: Any, rehearsal: Rehearsal) -> None:
    loss = rehearsal.report.link_loss
    at = times([iso_unix_s(moment.utc) for moment in loss.curve])
    seconds = [np.nan if m.seconds_to_limit is None else m.seconds_to_limit for m in loss.curve]
    axes.plot(at, seconds, color=BAD, linewidth=1.8, label="to the first limit, rates held")
    if loss.watchdog_s is not None:
        rests = [np.nan if m.seconds_to_rest is None else m.seconds_to_rest for m in loss.curve]
        axes.plot(at, rests, color="#2a9d8f", linewidth=1.5, label="to rest by the mount's watchdog")
    finite = [s for s in seconds if np.isfinite(s)]
    if not finite:
        text = f"no limit is met within {loss.looked_s / 60.0:.0f} minutes"
        axes.annotate(text, (0.5, 0.5), xycoords="axes fraction", ha="center", color=PALE)
    axes.set_ylim(0.0, 1.15 * max(finite, default=loss.looked_s))
    axes.set_ylabel("after a cut link, s")
    axes.legend(fontsize="x-small", frameon=False, loc="upper right")
    label_times(axes)
    axes.tick_params(axis="x", labelsize="small")
    _tidy(axes)


def _draw_error(axes: Any, rehearsal: Rehearsal) -> None:
    from matplotlib.patches import Circle, Ellipse

    budget = rehearsal.report.budget
    along, across = budget.along_arcsec, budget.across_arcsec
    for sigmas, alpha in ((2.0, 0.18), (1.0, 0.35)):
        axes.add_patch(
            Ellipse(
                (0.0, 0.0), 2.0 * sigmas * along, 2.0 * sigmas * across, color=GOOD, alpha=alpha, linewidth=0
            )
        )
    reach = 2.3 * max(along, across)
    if budget.fov_deg is not None:
        half = 0.5 * budget.fov_deg * 3600.0
        axes.add_patch(Circle((0.0, 0.0), half, fill=False, color=BAD, linewidth=1.8))
        axes.annotate(
            f"field of view {budget.fov_deg:g}°", (0.72 * half, 0.72 * half), fontsize="x-small", color=BAD
        )
        reach = max(reach, 1.15 * half)
    axes.set_xlim(-2.4 * reach, 2.4 * reach)
    axes.set_ylim(-reach, reach)
    axes.set_aspect("equal", adjustable="box")
    axes.axhline(0.0, color="0.85", linewidth=0.8)
    axes.axvline(0.0, color="0.85", linewidth=0.8)
    axes.set_xlabel("along the track, ″", fontsize="small")
    axes.set_ylabel("across, ″", fontsize="small")
    axes.set_title(f"error expected, 1σ and 2σ: {along:.0f}″ by {across:.0f}″", fontsize="small", color=INK)
    _tidy(axes)
