"""The network's night as pictures: a map of stations and a timeline; PNG, SVG or PDF, or a page of HTML."""

from __future__ import annotations

import base64
import html
import io
from typing import TYPE_CHECKING, Any

import numpy as np

from sattrack.core.angles import wrap180
from sattrack.network.land import coast_lines
from sattrack.recording.rendering import STYLE, label_times, new_figure, save, times
from tle.instants import Utc

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from sattrack.network.night import Mounted, Night

ALONE, TOGETHER, LINK, LAND = "#1b7f5c", "#d9822b", "#e3b27a", "#eceff1"
_LANE_INCH = 0.28


def draw_night(path: Path, night: Night, stations: Sequence[Mounted]) -> None:
    """Draw a night in the format of the file's ending. Raises BadInputError, SattrackError."""
    figure = _figure(night, stations)
    if path.suffix.lower() not in (".html", ".htm"):
        save(figure, path)
        return
    image = io.BytesIO()
    figure.savefig(image, format="png", dpi=110)
    path.write_text(_page(night, stations, image.getvalue()), encoding="utf-8")


def _figure(night: Night, stations: Sequence[Mounted]) -> Any:
    lanes = max(1.5, _LANE_INCH * len(stations))
    figure = new_figure(12.0, 6.2 + lanes)
    chart, gantt = figure.subplots(2, 1, height_ratios=[5.0, lanes])
    _map(chart, night, stations)
    _gantt(gantt, night, stations)
    figure.suptitle(_title(night, stations))
    return figure


def _title(night: Night, stations: Sequence[Mounted]) -> str:
    begin = Utc(night.span[0]).isoformat("seconds")
    figures = night.assigned
    return (
        f"{len(night.worths)} passes over {len(stations)} stations from {begin}: value {figures.value:.0f}, "
        f"at most {figures.bound:.0f}"
    )


def _map(axes: Any, night: Night, stations: Sequence[Mounted]) -> None:
    """Draw land, the stations, larger the more they follow, and lines between those that look at once."""
    from matplotlib.collections import PolyCollection

    longitude = np.array([wrap180(one.station.longitude_deg) for one in stations])
    latitude = np.array([one.station.latitude_deg for one in stations])
    land = [
        line + np.array((turn, 0.0))
        for line in coast_lines()
        for turn in (-360.0, 0.0, 360.0)
        if (np.abs(line[:, 0] + turn) < 180.0).any()
    ]
    # All as one: a patch for each takes ten times as long.
    drawn = PolyCollection(land, facecolor=LAND, edgecolor="0.7", linewidth=0.4, joinstyle="miter")
    axes.add_collection(drawn, autolim=False)
    for pair in sorted(_pairs(night)):
        axes.plot(longitude[list(pair)], latitude[list(pair)], color=LINK, linewidth=0.8, zorder=1)
    counts = np.bincount(night.passes.station, minlength=len(stations))
    axes.scatter(longitude, latitude, 20.0 + 6.0 * counts, color=ALONE, edgecolor="white", zorder=2)
    for k, one in enumerate(stations):
        axes.annotate(
            f"{one.station.name} {counts[k]}",
            (longitude[k], latitude[k]),
            xytext=(6, 5),
            textcoords="offset points",
            fontsize="small",
        )
    axes.set(xlim=(-180.0, 180.0), ylim=(-90.0, 90.0), xlabel="longitude, °", ylabel="latitude, °")
    axes.set_xticks(range(-180, 181, 30))
    axes.set_yticks(range(-90, 91, 30))
    axes.grid(color="0.85", linewidth=0.4)
    axes.set_axisbelow(True)


def _pairs(night: Night) -> set[tuple[int, int]]:
    """Return the pairs of stations that follow one satellite at once."""
    passes, found = night.passes, set()
    for k in np.flatnonzero(night.together).tolist():
        same = (passes.number == passes.number[k]) & (passes.start_s < passes.end_s[k])
        same &= (passes.end_s > passes.start_s[k]) & (passes.station > passes.station[k])
        found |= {(int(passes.station[k]), int(other)) for other in passes.station[same].tolist()}
    return found


def _gantt(axes: Any, night: Night, stations: Sequence[Mounted]) -> None:
    passes = night.passes
    starts, ends = times(passes.start_s), times(passes.end_s)
    for is_shared, colour, label in ((False, ALONE, "alone"), (True, TOGETHER, "two stations at once")):
        some = np.flatnonzero(night.together == is_shared)
        if len(some):
            axes.barh(
                passes.station[some],
                [ends[k] - starts[k] for k in some.tolist()],
                left=[starts[k] for k in some.tolist()],
                height=0.7,
                color=colour,
                edgecolor="white",
                linewidth=0.4,
                label=label,
            )
    axes.set_yticks(range(len(stations)), [one.station.name for one in stations], fontsize="small")
    axes.set_ylim(len(stations) - 0.4, -0.6)
    axes.grid(color="0.92", axis="x")
    axes.set_axisbelow(True)
    if len(passes.value):
        label_times(axes)
        axes.legend(fontsize="small", frameon=False, ncols=2, loc="lower right", bbox_to_anchor=(1.0, 1.0))


def _page(night: Night, stations: Sequence[Mounted], image: bytes) -> str:
    rows = "".join(
        "<tr>" + "".join(f"<td>{html.escape(str(one[key]))}</td>" for key in keys) + "</tr>\n"
        for keys in [("station", "start_utc", "end_utc", "catalog_number", "name", "value")]
        for one in night.document(stations)["assignments"]
    )
    title = html.escape(_title(night, stations))
    picture = base64.b64encode(image).decode()
    return (
        f'<!doctype html>\n<html lang="en"><meta charset="utf-8"><title>{title}</title>\n'
        f"<style>{STYLE}</style>\n<h1>{title}</h1>\n"
        f'<img alt="Map and timeline" src="data:image/png;base64,{picture}">\n<table>\n'
        "<tr><th>station<th>start<th>end<th>number<th>satellite<th>value</tr>\n"
        f"{rows}</table></html>\n"
    )
