"""Passes on a chart of the sky."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from sattrack.cli.common import tell
from sattrack.recording.rendering import new_figure, save, sky_axes
from tle.instants import Utc
from tle.propagator import Propagator

if TYPE_CHECKING:
    from pathlib import Path

    from sattrack.cli.passes_rows import PassTable, Row
    from tle.catalogue_passes import CataloguePasses
    from tle.horizon import Horizon

_MOST_PASSES = 12
_LOOKS = 200


def plot_passes(path: Path, table: PassTable) -> None:
    """Draw the first passes as seen from below: north up, east to the left; dashed where not sunlit.

    Raises BadInputError where that cannot be.
    """
    figure = new_figure(10.0, 7.0)
    passes = table.passes
    if len(table) > _MOST_PASSES:
        tell(f"the chart shows the first {_MOST_PASSES} of {len(table)} passes")
    sky = figure.add_subplot(projection="polar")
    sky_axes(sky)
    _draw_horizon(sky, passes.task.horizon)
    for number, row in enumerate(table.take(np.arange(min(len(table), _MOST_PASSES))).rows()):
        _draw_pass(sky, row, passes, f"C{number % 10}")
    until = passes.start.plus(passes.task.span[1]).isoformat("seconds")
    sky.set_title(
        f"Passes from {passes.start.isoformat('seconds')} to {until}, sky seen from below", pad=20.0
    )
    if len(table):
        figure.legend(loc="outside right upper", fontsize="small", title="highest (UTC), dashed: not sunlit")
    save(figure, path)


def _draw_horizon(sky: Any, horizon: Horizon) -> None:
    azimuths = np.linspace(0.0, 360.0, 1441)
    skyline = np.clip(np.broadcast_to(horizon.altitude_deg(azimuths), azimuths.shape), 0.0, 90.0)
    sky.fill_between(np.radians(azimuths), 90.0 - skyline, 90.0, color="0.85", linewidth=0.0)


def _draw_pass(sky: Any, row: Row, passes: CataloguePasses, colour: str) -> None:
    seen = row.seen
    first = seen.rise_utc or passes.start
    last = seen.set_utc or passes.start.plus(passes.task.span[1])
    times = Utc(np.linspace(first.unix_s, last.unix_s, _LOOKS))
    propagator = Propagator(row.elements, passes.task.site, place="geometric", earth=passes.task.earth)
    there = propagator.at(times)
    angle, radius = np.radians(there.az_deg), 90.0 - there.alt_deg
    lit = np.zeros(len(times), dtype=bool)
    for low, high in row.facts.sunlit if row.facts is not None else ():
        lit |= (times.unix_s >= low.unix_s) & (times.unix_s <= high.unix_s)
    label = f"{row.elements.label}  {seen.culminate_utc.isoformat('seconds')[5:16]}  {seen.max_alt_deg:.0f}°"
    sky.plot(angle, radius, color=colour, linewidth=1.0, linestyle=(0, (2, 3)))
    sky.plot(angle, np.where(lit, radius, np.nan), color=colour, linewidth=2.0, label=label)
    # An arrow at the middle tells which way it goes.
    middle = _LOOKS // 2
    sky.annotate(
        "",
        xy=(angle[middle + 3], radius[middle + 3]),
        xytext=(angle[middle], radius[middle]),
        arrowprops={"arrowstyle": "-|>", "color": colour, "mutation_scale": 14.0},
    )
    if seen.rise_utc is not None:
        sky.annotate(
            seen.rise_utc.isoformat("seconds")[11:16],
            xy=(angle[0], radius[0]),
            color=colour,
            fontsize="small",
            annotation_clip=False,
        )
