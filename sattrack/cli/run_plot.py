"""A plan as a timeline: what the mount does, and below it the passes that lost; a row of it for each day."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from sattrack.core.errors import BadInputError
from sattrack.safety.bodies import sun_over
from sattrack.schedule.making import SAME
from tle.errors import printable
from tle.instants import Utc

if TYPE_CHECKING:
    from pathlib import Path

    from sattrack.schedule.plan import LostPass, Plan, PlannedPass
    from tle.site import Site

FOLLOW, SHORTENED, SLEW, AROUND = "#1b7f5c", "#58b08f", "#4f5d75", "#d9822b"
LOST = {"conflict": "#c9503f", "infeasible": "#7b4fa3", "elements too old": "#8a8a3a"}
OTHER = "#9a9a9a"
SHADES_DEG = (0.0, -6.0, -12.0, -18.0)
SHADES = ("#fdf6dc", "#ecedf4", "#dfe2ee", "#d3d7e8", "#c8cde1")
"""Colours by the Sun's altitude, from day over the three twilights to night."""
MOST_DAYS, MOST_LANES = 14, 12
MARGIN_S = 900.0
NAMES_APART = 0.018
"""Names stand at least so much of the width apart."""


def plot_plan(path: Path, plan: Plan, site: Site) -> None:
    """Draw a plan as PNG, or whatever the file's ending says. Raises BadInputError where that cannot be."""
    try:
        from matplotlib.figure import Figure
    except ImportError:
        raise BadInputError("--png needs matplotlib: pip install 'sattrack[plot]'") from None
    days = _days(plan)
    lost = [one for one in plan.lost if one.reason != SAME]
    lanes = [_lanes([one for one in lost if low <= _s(one.start_utc) < high]) for low, high in days]
    heights = [2.2 + 0.22 * max((lane for _, lane in packed), default=0) for packed in lanes]
    figure = Figure(figsize=(14.0, 1.1 + sum(heights)), layout="constrained")
    axes = figure.subplots(len(days), 1, squeeze=False, height_ratios=heights)[:, 0]
    for (low, high), packed, axis in zip(days, lanes, axes, strict=True):
        _draw_day(axis, plan, (low, high), packed, site)
    taken = f"{len(plan.passes)} passes, value {plan.value:.0f}, {len(plan.lost)} lost"
    figure.suptitle(f"{printable(plan.schedule.rsplit('/', 1)[-1])}: {taken}", fontsize=12)
    _legend(figure, plan)
    try:
        figure.savefig(path, dpi=110)
    except (OSError, ValueError) as error:
        raise BadInputError(f"{path}: cannot write the timeline: {error}") from None


def _days(plan: Plan) -> list[tuple[float, float]]:
    """Return the spans to draw, of a day at most each, as many as can be read."""
    low, high = _s(plan.from_utc), _s(plan.to_utc)
    count = min(max(1, math.ceil((high - low) / 86400.0 - 1e-9)), MOST_DAYS)
    return [(low + 86400.0 * k, min(low + 86400.0 * (k + 1), high)) for k in range(count)]


def _lanes(lost: list[LostPass]) -> list[tuple[LostPass, int]]:
    """Return lost passes with the lane each is drawn in, so that none cover each other; the rest left out."""
    ends: list[float] = []
    packed = []
    for one in sorted(lost, key=lambda x: x.start_utc):
        start, end = _s(one.start_utc), _s(one.end_utc)
        lane = next((k for k, last in enumerate(ends) if last + 30.0 <= start), len(ends))
        if lane >= MOST_LANES:
            continue
        if lane == len(ends):
            ends.append(end)
        ends[lane] = end
        packed.append((one, lane + 1))
    return packed


def _draw_day(
    axis: Any, plan: Plan, day: tuple[float, float], packed: list[tuple[LostPass, int]], site: Site
) -> None:
    taken = [one for one in plan.passes if day[0] <= _s(one.start_utc) < day[1]]
    shown: list[PlannedPass | LostPass] = [*taken, *(lost for lost, _ in packed)]
    instants = [_s(t) for one in shown for t in (one.start_utc, one.end_utc)]
    low = max(min(instants, default=day[0]) - MARGIN_S, day[0] - MARGIN_S)
    high = max(instants, default=day[1]) + MARGIN_S
    axis.set_xlim(low, high)
    lanes = max((lane for _, lane in packed), default=0)
    axis.set_ylim(-lanes - 0.8, 2.6)
    _draw_sun(axis, (low, high), site)
    for one in taken:
        _draw_pass(axis, one)
    _draw_names(axis, taken, (low, high))
    for lost, lane in packed:
        start, end = _s(lost.start_utc), _s(lost.end_utc)
        axis.barh(
            -lane,
            end - start,
            left=start,
            height=0.62,
            color=LOST.get(lost.reason, OTHER),
            linewidth=0.0,
            zorder=3,
        )
    axis.set_yticks([0.0, *([-0.5 - 0.5 * lanes] if lanes else [])], ["mount", *(["lost"] if lanes else [])])
    axis.tick_params(axis="y", length=0.0)
    _draw_hours(axis, (low, high))
    for side in ("top", "right", "left"):
        axis.spines[side].set_visible(False)


def _draw_pass(axis: Any, one: PlannedPass) -> None:
    start, end = _s(one.start_utc), _s(one.end_utc)
    at = _s(one.leave_utc)
    for seconds, colour in ((one.slew_s, SLEW), (one.before_s, AROUND), (one.settle_s, SLEW)):
        axis.barh(0.0, seconds, left=at, height=0.5, color=colour, linewidth=0.0, zorder=3)
        at += seconds
    colour = SHORTENED if one.shortened else FOLLOW
    axis.barh(
        0.0, end - start, left=start, height=0.9, color=colour, edgecolor="white", linewidth=0.5, zorder=4
    )
    axis.barh(0.0, one.after_s, left=end, height=0.5, color=AROUND, linewidth=0.0, zorder=3)


def _draw_names(axis: Any, taken: list[PlannedPass], span: tuple[float, float]) -> None:
    """Write names above the passes, moved aside where they would cover each other, with a line to each."""
    width = span[1] - span[0]
    apart = NAMES_APART * width
    wanted = np.array([0.5 * (_s(one.start_utc) + _s(one.end_utc)) for one in taken])
    if len(taken) * apart > width:
        return
    places = _spread(wanted, apart, span)
    for one, place, middle in zip(taken, places.tolist(), wanted.tolist(), strict=True):
        name = printable(one.name or str(one.catalog_number))
        axis.plot([middle, place], [0.5, 0.85], color="0.55", linewidth=0.7, zorder=2)
        axis.text(
            place,
            0.9,
            f"{one.number}  {name[:18]}",
            rotation=35.0,
            rotation_mode="anchor",
            ha="left",
            va="bottom",
            fontsize=7.5,
            zorder=5,
        )


def _spread(wanted: np.ndarray[Any, Any], apart: float, span: tuple[float, float]) -> np.ndarray[Any, Any]:
    """Return places near those wanted, in their order, none nearer to the next than `apart`."""
    places = wanted.copy()
    for k in range(1, len(places)):
        places[k] = max(places[k], places[k - 1] + apart)
    last = span[1] - 2.0 * apart
    if len(places) and places[-1] > last:
        places[-1] = last
        for k in range(len(places) - 2, -1, -1):
            places[k] = min(places[k], places[k + 1] - apart)
    return places


def _draw_sun(axis: Any, span: tuple[float, float], site: Site) -> None:
    """Shade the background by the Sun's altitude: day, twilight, night."""
    sun = sun_over(site.latitude_deg, site.longitude_deg)
    edges = np.linspace(span[0], span[1], 400)
    p = math.radians(site.latitude_deg)
    heights = []
    for utc_s in edges.tolist():
        there = sun.at(utc_s)
        heights.append(math.degrees(math.asin(math.sin(p) * there.z + math.cos(p) * there.x)))
    shade = np.searchsorted(-np.array(SHADES_DEG), -np.array(heights), side="right")
    changes = [0, *(np.flatnonzero(np.diff(shade)) + 1).tolist(), len(edges) - 1]
    for first, after in pairwise(changes):
        axis.axvspan(
            edges[first],
            edges[after],
            color=SHADES[int(shade[first])],
            linewidth=0.0,
            zorder=0,
            antialiased=False,
        )


def _draw_hours(axis: Any, span: tuple[float, float]) -> None:
    hours = (span[1] - span[0]) / 3600.0
    step_s = next((s for s in (300.0, 600.0, 1800.0, 3600.0, 7200.0) if hours * 3600.0 / s <= 16.0), 10800.0)
    ticks = np.arange(math.ceil(span[0] / step_s) * step_s, span[1], step_s)
    axis.set_xticks(ticks, [Utc(float(t)).isoformat("seconds")[11:16] for t in ticks], fontsize=8)
    axis.set_xlabel(f"{Utc(span[0]).isoformat('seconds')[:10]}, UTC", fontsize=8, loc="left")


def _legend(figure: Any, plan: Plan) -> None:
    from matplotlib.patches import Patch

    reasons = dict.fromkeys(one.reason for one in plan.lost if one.reason != SAME)
    handles = [Patch(color=FOLLOW, label="followed")]
    if any(one.shortened for one in plan.passes):
        handles.append(Patch(color=SHORTENED, label="followed in part"))
    handles.append(Patch(color=SLEW, label="slew and settling"))
    if any(one.before_s or one.after_s for one in plan.passes):
        handles.append(Patch(color=AROUND, label="before and after"))
    handles += [Patch(color=colour, label=f"lost: {why}") for why, colour in LOST.items() if why in reasons]
    if any(why not in LOST for why in reasons):
        handles.append(Patch(color=OTHER, label="lost: otherwise"))
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), fontsize=8, frameon=False)


def _s(utc: str) -> float:
    return float(Utc.parse(utc).unix_s)
