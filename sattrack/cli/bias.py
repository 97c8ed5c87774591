"""`sattrack bias`: what observations say of an element set: its bias, refined elements, a plot."""

from __future__ import annotations

import json
import math
import shlex
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from sattrack.cli.common import (
    PLOT,
    CommandContext,
    OutputFile,
    RenamedOption,
    common_options,
    element_sources,
)
from sattrack.cli.output import say, tell, write_file
from sattrack.core import local_time
from sattrack.core.errors import BadInputError, SattrackError
from sattrack.views.formatting import old
from sattrack.views.messages import FRAMES, check_sigma
from tle.errors import SatelliteNotFoundError, TleError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tle.elements import Elements
    from tle.formats.observations import Observation
    from tle.observed import Frame
    from tle.orbit_fit import ObservedFit, OrbitFit

_SHOWN = 20
_MANY_TIMES = 5.0
"""A scatter of so many times the sigmas is worth a warning: one in 3e7 observations with an honest sigma
lies so far off, and programs give sigmas too small by two or three times. A frame with so much less fits."""
_LIKELY_FRAMES: tuple[Frame, ...] = ("icrf", "of_date", "gcrs")
"""What observations of another frame are tried in, the likeliest first; j2000 is icrf but for 0.02″."""


@click.command("bias")
@click.argument("source", metavar="ELEMENTS", shell_complete=element_sources)
@click.argument("more", nargs=-1, metavar="[FILE]...", shell_complete=element_sources)
@click.option(
    "--observations",
    multiple=True,
    required=True,
    metavar="FILE",
    help="CSV, IOD, CCSDS TDM or JSON lines of RA and Dec; may be repeated, or more files follow.",
)
@click.option("--satellite", metavar="SAT", help="The satellite, where ELEMENTS hold several.")
@click.option(
    "--stations", type=click.Path(path_type=Path, dir_okay=False), help="List of the stations' places."
)
@click.option(
    "--output",
    "--out",
    "out",
    cls=RenamedOption,
    type=OutputFile(),
    metavar="FILE",
    help="Write the refined elements there: OMM (KVN) with their covariance.",
)
@click.option("--plot", type=PLOT, help="Draw the biases there (PNG, SVG, PDF).")
@common_options("site", "json", "utc")
def command(
    context: CommandContext,
    source: str,
    more: tuple[str, ...],
    observations: tuple[str, ...],
    satellite: str | None,
    stations: Path | None,
    out: Path | None,
    plot: Path | None,
) -> int:
    """Fit a satellite's orbit to its OBSERVATIONS, and say by how far the ELEMENTS miss it.

    The bias is that of the instant of the last observation used. Observations that contradict the others
    are left out and named.

    \b
    Examples:
      sattrack bias iss.tle --observations seen.csv --site 52.1541,4.4908,0
      sattrack bias iss.tle --observations seen.jsonl --output refined.kvn
    """
    seen = _read(context, (*observations, *more), stations)
    elements = _chosen(context, source, satellite, seen)
    found = _fitted(elements, _of(elements, seen))
    warnings = _warnings(found)
    for warning in warnings:
        tell(f"warning: {warning}")
    if out is not None:
        _write(out, found.fit)
    if plot is not None:
        _plot(plot, found)
    if context.json:
        click.echo(json.dumps({**_document(found), "warnings": warnings}, allow_nan=False))
    else:
        say("\n".join(_lines(found)))
    return 0


def _read(context: CommandContext, files: Sequence[str], stations: Path | None) -> list[Observation]:
    """Return the observations of all files in order of time, with the sigmas that a run takes.

    Raises ObservationError, SourceError, SiteError, BadInputError.
    """
    from tle.formats.observations import Stations, read_observations, read_stations

    site = context.site() if context.has_site() else None
    known = read_stations(stations, site) if stations else Stations({}, site)
    found = [one for name in files for one in read_observations(name, known)]
    for one in found:
        if one.sigma_arcsec is not None:
            try:
                check_sigma(one.sigma_arcsec)
            except ValueError as error:
                raise one.error(str(error)) from None
    # Files overlap: what stands in two of them was seen once.
    once = {replace(one, source="", line=None): one for one in reversed(found)}
    if len(once) < len(found):
        tell(f"{len(found) - len(once)} of {len(found)} observations are repetitions, and are left out")
    return sorted(once.values(), key=lambda one: float(one.utc.unix_s))


def _chosen(
    context: CommandContext, source: str, satellite: str | None, seen: Sequence[Observation]
) -> Elements:
    """Return the elements of the satellite that was named, or that the observations name.

    Of several sets it is the one whose epoch is nearest to the last observation.
    """
    from tle.sources import newest

    sets = context.load((source,))
    if not sets.accepted:
        raise sets.rejected[0]
    elements = newest(sets.accepted, seen[-1].utc)
    if satellite is not None:
        return _find(elements, satellite)
    named = sorted({one.object_key for one in seen if one.object_key})
    if len(named) == 1:
        return _find(elements, named[0])
    if len(elements) == 1:
        return elements[0]
    several = f"the observations name {', '.join(named)}" if named else f"{source} holds {len(elements)} sets"
    raise BadInputError(f"{several}: name one with --satellite")


def _find(elements: Sequence[Elements], key: str) -> Elements:
    """Return a satellite's elements; the error where there are none says how this command takes others.

    Raises SatelliteNotFoundError, AmbiguousSatelliteError.
    """
    from sattrack.elements.downloads import named_source
    from tle.sources import find

    try:
        return find(elements, key)
    except SatelliteNotFoundError as error:
        if str(error).endswith("?"):
            raise
        source = shlex.quote(named_source(key))
        advice = f"check the spelling, or give {source} as ELEMENTS to fetch it"
        raise SatelliteNotFoundError(f"{error}: {advice}") from None


def _of(elements: Elements, seen: Sequence[Observation]) -> list[Observation]:
    """Return the observations of the satellite, and those that name none; the others are reported."""
    from tle.sources import find

    mine = []
    for one in seen:
        try:
            of_it = not one.object_key or find([elements], one.object_key) is elements
        except TleError:
            of_it = False
        if of_it:
            mine.append(one)
    if len(mine) < len(seen):
        tell(f"{len(seen) - len(mine)} of {len(seen)} observations are of other satellites")
    if not mine:
        raise BadInputError(f"no observation is of {elements.label}")
    return mine


def _fitted(elements: Elements, seen: Sequence[Observation]) -> ObservedFit:
    from tle.instants import DAY_S
    from tle.orbit_fit import fit_observations

    found = fit_observations(elements, seen)
    if found is None:
        days = float(seen[-1].utc - seen[0].utc) / DAY_S
        raise SattrackError(
            f"the observations agree on no orbit near the elements of {elements.label}: "
            + (f"they span {days:.1f} days, give those of one; or " if days > 1.0 else "")
            + "check the satellite, the station, the frame and the clock"
        )
    return found


def _warnings(found: ObservedFit) -> list[str]:
    """Return what to tell of a fit whose observations lie much farther off than their sigmas say."""
    if found.fit.scatter < _MANY_TIMES:
        return []
    from tle.formats.observations import DEFAULT_SIGMA_ARCSEC

    said, sigmas = "their sigmas say", "check the sigmas,"
    if not _has_sigmas(found):
        said, sigmas = f"the {DEFAULT_SIGMA_ARCSEC:g}″ that holds without sigmas", "give them, or check"
    return [
        f"the observations lie {found.fit.scatter:.1f} times as far off as {said}: "
        + (_would_fit(found) or f"{sigmas} the satellite, the station, the frame and the clock")
    ]


def _has_sigmas(found: ObservedFit) -> bool:
    return any(one.sigma_arcsec is not None for one in found.observations)


def _would_fit(found: ObservedFit) -> str | None:
    """Say in which frame no fewer observations would fit, with far less scatter; None where in none."""
    from tle.orbit_fit import fit_observations

    names: dict[str, str] = {"gcrs": "gcrs"} | {frame: name for name, frame in FRAMES.items()}
    for given in sorted({one.frame for one in found.observations}):
        same = "icrf" if given == "j2000" else given
        for other in (frame for frame in _LIKELY_FRAMES if frame != same):
            moved = [replace(one, frame=other) if one.frame == given else one for one in found.observations]
            try:
                tried = fit_observations(found.elements, moved)
            except TleError:
                continue
            if (
                tried is not None
                and tried.fit.scatter * _MANY_TIMES <= found.fit.scatter
                and tried.fit.used.sum() >= found.fit.used.sum()
            ):
                return f"in the frame {names[other]}, not {names[given]}, they would fit"
    return None


def _document(found: ObservedFit) -> dict[str, Any]:
    fit = found.fit
    rows = [
        {
            "utc": one.utc.isoformat(),
            "along_s": None if alone is None else alone[0],
            "cross_arcsec": None if alone is None else alone[1],
            "used": bool(taken),
            "off_arcsec": math.hypot(*(float(value) for value in off)),
        }
        for one, alone, taken, off in zip(
            found.observations, found.alone, fit.used, fit.off_arcsec, strict=True
        )
    ]
    return {
        "bias": {**found.document(), "scatter": fit.scatter},
        "observations": rows,
    }


def _lines(found: ObservedFit) -> list[str]:
    fit, last, drift = found.fit, found.last, found.drift_s_min
    used = int(fit.used.sum())
    elements = found.elements
    lines = [
        f"{elements.label} ({elements.catalog_number}), elements {old(elements.age_s(last.utc))}",
        f"  observations {used} used of {len(fit.used)}, "
        f"{local_time.span(float(found.first.utc.unix_s), float(last.utc.unix_s))}",
        f"  along        {last.along_s:+.4f} ± {last.along_sigma_s:.4f} s at the last"
        + ("" if drift is None else f", drifting by {drift:+.4f} s a minute"),
        f"  across       {last.cross_deg:+.5f} ± {last.cross_sigma_deg:.5f}°",
        f"  scatter      {fit.rms_arcsec:.2f}″ RMS, "
        + (f"{fit.scatter:.1f} times what the sigmas say" if _has_sigmas(found) else "no sigmas are given"),
    ]
    out = [
        (one, float(math.hypot(*off)))
        for one, off, taken in zip(found.observations, fit.off_arcsec, fit.used, strict=True)
        if not taken
    ]
    for one, off_arcsec in out[:_SHOWN]:
        where = f"{one.source}:{one.line}" if one.source and one.line else one.source
        at = local_time.instant(float(one.utc.unix_s), 3)
        lines.append(f"  left out     {at}  {off_arcsec:.1f}″ off  {where}".rstrip())
    if len(out) > _SHOWN:
        lines.append(f"  left out     {len(out) - _SHOWN} more")
    lines.append(f"  use          --bias-along {last.along_s:.4f} --bias-cross {last.cross_deg:.5f}")
    return lines


def _write(path: Path, fit: OrbitFit) -> None:
    """Put the refined elements into a file: OMM in KVN, the covariance of their state at the epoch last."""
    from tle.formats.omm_notations import covariance_kvn, write_kvn
    from tle.instants import Utc

    refined = fit.elements
    # The standard asks for a name (CCSDS 502.0-B-3, table 4-2).
    named = replace(refined, name=refined.name or refined.designator or str(refined.catalog_number))
    created = Utc(math.floor(time.time())).isoformat("seconds")
    write_file(path, write_kvn([named], created, "SATTRACK") + covariance_kvn(fit.state_covariance_km2()))
    tell(f"refined elements written to {path}")


def _plot(path: Path, found: ObservedFit) -> None:
    """Draw what each observation says alone, and the fit with twice its sigma."""
    import numpy as np

    from sattrack.recording.rendering import label_times, new_figure, save, times
    from tle.instants import Utc

    figure = new_figure(9.0, 6.0)
    panels = figure.subplots(2, 1, sharex=True)
    first_s, last_s = float(found.first.utc.unix_s), float(found.last.utc.unix_s)
    instants = np.linspace(first_s, last_s, 60) if last_s > first_s else np.array([first_s])
    fits = [found.fit.bias_at(found.believed, Utc(float(t))) for t in instants]
    curves = (
        [(one.along_s, one.along_sigma_s) for one in fits],
        [(one.cross_deg * 3600.0, one.cross_sigma_deg * 3600.0) for one in fits],
    )
    at = times([float(one.utc.unix_s) for one in found.observations])
    for axes, curve, column, label in zip(panels, curves, (0, 1), ("along, s", "across, ″"), strict=True):
        values, sigmas = np.array(curve).T
        axes.fill_between(
            times(instants), values - 2.0 * sigmas, values + 2.0 * sigmas, alpha=0.25, linewidth=0.0
        )
        axes.plot(times(instants), values, linewidth=1.2, label="fitted, ± 2 σ")
        for taken, mark, name in ((True, ".", "used"), (False, "x", "left out")):
            chosen = [
                (t, alone[column])
                for t, alone, used in zip(at, found.alone, found.fit.used, strict=True)
                if alone is not None and bool(used) is taken
            ]
            if chosen:
                axes.plot(*zip(*chosen, strict=True), mark, color="0.4", label=name)
        axes.set_ylabel(label)
        axes.grid(color="0.92")
    low, high = (min(v for v, _ in curves[0]), max(v for v, _ in curves[0]))
    panels[0].margins(y=0.1)
    panels[0].legend(fontsize="small", frameon=False)
    panels[0].set_title(f"{found.elements.label}: {low:+.3f} to {high:+.3f} s along its track")
    label_times(panels[1])
    save(figure, path)
