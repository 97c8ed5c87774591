"""The plan of a schedule on the command line: made of situation and elements, rehearsed, shown and drawn."""

from __future__ import annotations

import math
import os
import sys
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import msgspec
import numpy as np

from sattrack.cli.common import given_utc_s
from sattrack.cli.output import may_colour, renew, tell
from sattrack.cli.run_report import plan_lines
from sattrack.core import local_time
from sattrack.core.angles import altitude_deg
from sattrack.core.errors import BadInputError, how_to_install
from sattrack.core.toml_text import line_of_key
from sattrack.mount.alpaca.link import parse_alpaca
from sattrack.mount.requests import Park
from sattrack.runtime.facts import check_site
from sattrack.runtime.mounts import GATEWAYS
from sattrack.safety.bodies import sun_over
from sattrack.safety.bounds import Bounds
from sattrack.safety.geometry import Box, Place
from sattrack.safety.route import axes_of, direction_of
from sattrack.safety.table import ROWS
from sattrack.schedule.candidates import Loaded, PlanSituation
from sattrack.schedule.file import load_schedule
from sattrack.schedule.making import SAME, make_plan
from sattrack.views.formatting import counted, iso_unix_s
from tle.errors import SourceError, printable
from tle.facts import read_magnitudes
from tle.instants import Utc
from tle.sources import is_fetched, newest

if TYPE_CHECKING:
    from collections.abc import Callable

    from sattrack.cli.common import CommandContext
    from sattrack.mount.model import MountProfile
    from sattrack.mount.profiles import ProfileFile
    from sattrack.runtime.mounts import MountAddress
    from sattrack.safety.limits import SafetyLimits
    from sattrack.schedule.candidates import Candidate
    from sattrack.schedule.file import Schedule
    from sattrack.views.schedule import LostPass, PlannedPass, Rehearsed, SchedulePlan
    from tle.site import Site

    Span = tuple[float, float]


MOST_HOUR_ANGLE_DEG = 170.0
DEFAULT_HOURS, MOST_DAYS = 24.0, 31.0


def show_plan(context: CommandContext, file: Path, options: dict[str, Any]) -> int:
    """Make the plan of a schedule and show it. Raises BadInputError, SattrackError, TleError."""
    schedule = load_schedule(file)
    plan = _plan(context, schedule, options)
    _write(plan, context, options)
    return 0


def _plan(context: CommandContext, schedule: Schedule, options: dict[str, Any]) -> SchedulePlan:
    url = options["mount_url"] or context.settings.mount.url
    # A plan is made without a network too: a host that cannot be found does not matter.
    behind_gateway = url is not None and url.partition(":")[0] in GATEWAYS
    address = parse_alpaca(url, resolve=False) if url is not None and behind_gateway else None
    profile = within_half_a_turn(context.profile(options["profile"], url))
    situation = _situation(context, schedule, profile, options)
    left = why_left(schedule, profile, address)
    if left is None and schedule.park_at_end:
        check_park(profile.mount, situation.site, situation.limits)
    rehearse = rehearser(context, profile, schedule) if options["rehearse"] else None
    plan, _ = make_plan(schedule, situation, loader(context, schedule), rehearse, progress())
    return (
        plan if left is None else msgspec.structs.replace(plan, park_at_end=False, notes=(*plan.notes, left))
    )


def _situation(
    context: CommandContext, schedule: Schedule, profile: ProfileFile, options: dict[str, Any]
) -> PlanSituation:
    now = float(context.now().unix_s)
    begin = given_utc_s("--from", options["start"], schedule.from_utc_s)
    begin = now if begin is None else begin
    end = given_utc_s("--to", options["end"], schedule.to_utc_s)
    end = begin + DEFAULT_HOURS * 3600.0 if end is None else end
    if not 0.0 < end - begin <= MOST_DAYS * 86400.0:
        raise BadInputError(
            f"the plan goes from {Utc(begin).isoformat('seconds')} to {Utc(end).isoformat('seconds')}: "
            f"give --from and --to in order, {MOST_DAYS:g} days apart at most"
        )
    return situation_of(context, schedule, profile, (begin, end), now)


def _write(plan: SchedulePlan, context: CommandContext, options: dict[str, Any]) -> None:
    if options["ics"] is not None:
        from sattrack.cli.passes_output import plan_calendar

        try:
            options["ics"].write_bytes(plan_calendar(plan, context.now(), context.site()))
        except OSError as error:
            raise BadInputError(
                f"--ics {options['ics']}: cannot write the calendar: {error.strerror}"
            ) from None
    if options["plot"] is not None:
        plot_plan(options["plot"], plan, context.site())
    for note in plan.notes:
        tell(note)
    if context.json:
        click.echo(msgspec.json.encode(plan).decode())
    else:
        click.echo("\n".join(plan_lines(plan)), color=may_colour())


def within_half_a_turn(profile: ProfileFile) -> ProfileFile:
    """Return a profile whose hour angle axis keeps within half a turn, so that nobody needs to count turns.

    Each pass is a session of its own, no status tells how the cables are wound, and a mount at rest may go on
    with the sky. Raises BadInputError for a profile whose park position, or home, lies beyond that.
    """
    try:
        kept = msgspec.structs.replace(
            profile, hour_angle_limit_deg=min(profile.hour_angle_limit_deg, MOST_HOUR_ANGLE_DEG)
        )
        _ = kept.mount
    except ValueError as error:
        raise BadInputError(
            f"the mount profile {profile.name!r}: {error}: in schedules that axis stays within "
            f"{MOST_HOUR_ANGLE_DEG:g}° of its zero, as no status shows how the cables are wound"
        ) from None
    return kept


def situation_of(
    context: CommandContext, schedule: Schedule, profile: ProfileFile, span: Span, now_utc_s: float
) -> PlanSituation:
    """Return where and when a plan is made. Raises BadInputError, naming what does not go together."""

    site = context.site()
    check_site(profile.mount, site)
    limits = context.settings.safety.limits()
    low = [one for one in schedule.entries if one.terms.min_altitude_deg < limits.floor_altitude_deg]
    if low:
        raise low[0].origin.wrong(
            f"follows above {low[0].terms.min_altitude_deg:g}°, and the mount is kept above "
            f"{limits.floor_altitude_deg:g}° (safety.floor_altitude_deg)"
        )
    return PlanSituation(
        span=span,
        now_utc_s=now_utc_s,
        site=site,
        profile=profile.mount,
        limits=limits,
        magnitudes={} if schedule.magnitudes is None else read_magnitudes(schedule.magnitudes),
        workers=os.cpu_count() or 1,
        stars=context.settings.stars,
    )


def check_park(mount: MountProfile, site: Site, limits: SafetyLimits) -> None:
    """Raise BadInputError where a mount's park position is one to which safety lets no slew go, ever."""
    if mount.park is None:
        return
    bounds = Bounds(mount, limits, site.latitude_deg, site.longitude_deg)
    direction = direction_of(Place(mount.park.hour_angle_deg, mount.park.dec_deg))
    place = axes_of(*direction, mount, bounds.horizon_latitude_deg)
    # Sun and Moon, which are not looked for here, move on.
    name = bounds.violated(Box.between(place, place), {}, 0.0, 0.0)
    if name is not None:
        raise BadInputError(
            f"the mount profile {mount.name!r}: its park position is past the {ROWS[name].name} limit "
            f"({ROWS[name].bound}), so that no night could park the mount: change one of the two, or set "
            "park_at_end = false"
        )


def why_left(schedule: Schedule, profile: ProfileFile, address: MountAddress | None) -> str | None:
    """Return why a mount is not parked though its schedule would have it, in words; None otherwise."""
    if not schedule.park_at_end:
        return None
    why_not = "the profile has no park position"
    if profile.mount.park is not None:
        carried = None if address is None else address.not_carried(Park())
        if carried is None:
            return None
        why_not = carried
    return f"{why_not}: the mount will be left where the last pass ends"


def loader(context: CommandContext, schedule: Schedule) -> Callable[[str | None], Loaded]:
    """Return what gives the elements of a source, each read once."""
    known: dict[str | None, Loaded] = {}

    def load(source: str | None) -> Loaded:
        if source not in known:
            sources = (*context.sources(), *schedule.elements) if source is None else (source,)
            if not sources:
                raise BadInputError(
                    f"{schedule.file}: no elements: set elements in it or in sattrack.toml, or give some"
                )
            try:
                sets = context.load(sources)
            except (SourceError, BadInputError) as error:
                raise _by_schedule(schedule, source, error) from None
            if sets.rejected and not sets.accepted:
                raise sets.rejected[0]
            if sets.rejected:
                count, first = len(sets.rejected) + len(sets.accepted), str(sets.rejected[0]).splitlines()[0]
                tell(f"{len(sets.rejected)} of {count} element sets refused, the first: {first}")
            renewable = all(is_fetched(one) for one in sources)
            known[source] = Loaded(newest(sets.accepted, context.now()), renewable, ", ".join(sources))
        return known[source]

    return load


def _by_schedule(schedule: Schedule, source: str | None, error: Exception) -> Exception:
    """Return what is wrong with elements after the place of the schedule that names them, if one does."""
    where = next((f"{one.origin}" for one in schedule.entries if source and one.source == source), "")
    if source is None and str(error).startswith(schedule.elements):
        where = f"{schedule.file}{line_of_key(Path(schedule.file), 'elements')}: elements"
    return type(error)(f"{where}: {error}") if where else error


def progress() -> Callable[[str, int, int], None] | None:
    """Return what shows on the terminal how far long work is, and wipes that at its end; else None."""
    if not sys.stderr.isatty():
        return None

    def show(what: str, done: int, total: int) -> None:
        text = f"{what} {done} of {total}" if done < total else ""
        renew(text)

    return show


def rehearser(
    context: CommandContext, profile: ProfileFile, schedule: Schedule
) -> Callable[[Candidate, float, float], Rehearsed]:
    """Return what rehearses a candidate from one instant to another, POSIX seconds of UTC."""
    from sattrack.control.tracker import TrackPlan
    from sattrack.runtime.facts import Prepared
    from sattrack.runtime.rehearse import READY_S, rehearse
    from sattrack.schedule.virtual_executor import planned_facts
    from sattrack.views.schedule import Rehearsed

    site, clock = context.site(), context.clock()
    limits = context.settings.safety.limits()

    def run(one: Candidate, start_utc_s: float, end_utc_s: float) -> Rehearsed:
        plan = TrackPlan(start_utc_s=start_utc_s, end_utc_s=end_utc_s)
        terms = schedule.entries[one.entry].terms
        started_utc_s = start_utc_s - plan.approach_s - READY_S
        facts = planned_facts(one, terms, plan, started_utc_s, site, profile.mount, limits)
        report = rehearse(Prepared(facts, clock, None, False, profile.simulator)).report
        return Rehearsed(report.go, report.verdict, report.on_target_s, report.lost_s)

    return run


FOLLOW, SHORTENED, SLEW, AROUND = "#1b7f5c", "#58b08f", "#4f5d75", "#d9822b"
LOST = {"conflict": "#c9503f", "infeasible": "#7b4fa3", "elements too old": "#8a8a3a"}
OTHER = "#9a9a9a"
SHADES_DEG = (0.0, -6.0, -12.0, -18.0)
SHADES = ("#fdf6dc", "#ecedf4", "#dfe2ee", "#d3d7e8", "#c8cde1")
"""Colours by the Sun's altitude, from day over the three twilights to night."""
DAYS_DRAWN, MOST_LANES = 14, 12
MARGIN_S = 900.0
NAMES_APART = 0.018
"""Names stand at least so much of the width apart."""


def plot_plan(path: Path, plan: SchedulePlan, site: Site) -> None:
    """Draw a plan as PNG, or in the format of the file's ending. Raises BadInputError."""
    try:
        from matplotlib.figure import Figure
    except ImportError:
        raise BadInputError(f"--plot needs matplotlib: {how_to_install('plot')}") from None
    days = _days(plan)
    if days[-1][1] < iso_unix_s(plan.to_utc):
        tell(f"the timeline shows only the first {counted(len(days), 'day')} of the plan")
    lost = [one for one in plan.lost if one.reason != SAME]
    lanes = [_lanes([one for one in lost if low <= iso_unix_s(one.start_utc) < high]) for low, high in days]
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


def _days(plan: SchedulePlan) -> list[tuple[float, float]]:
    """Return the spans to draw, of a day at most each, as many as can be read."""
    low, high = iso_unix_s(plan.from_utc), iso_unix_s(plan.to_utc)
    count = min(max(1, math.ceil((high - low) / 86400.0 - 1e-9)), DAYS_DRAWN)
    return [(low + 86400.0 * k, min(low + 86400.0 * (k + 1), high)) for k in range(count)]


def _lanes(lost: list[LostPass]) -> list[tuple[LostPass, int]]:
    """Return lost passes with the lane each is drawn in, so that none cover each other; the rest left out."""
    ends: list[float] = []
    packed = []
    for one in sorted(lost, key=lambda x: x.start_utc):
        start, end = iso_unix_s(one.start_utc), iso_unix_s(one.end_utc)
        lane = next((k for k, last in enumerate(ends) if last + 30.0 <= start), len(ends))
        if lane >= MOST_LANES:
            continue
        if lane == len(ends):
            ends.append(end)
        ends[lane] = end
        packed.append((one, lane + 1))
    return packed


def _draw_day(
    axis: Any, plan: SchedulePlan, day: tuple[float, float], packed: list[tuple[LostPass, int]], site: Site
) -> None:
    taken = [one for one in plan.passes if day[0] <= iso_unix_s(one.start_utc) < day[1]]
    shown: list[PlannedPass | LostPass] = [*taken, *(lost for lost, _ in packed)]
    instants = [iso_unix_s(t) for one in shown for t in (one.start_utc, one.end_utc)]
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
        start, end = iso_unix_s(lost.start_utc), iso_unix_s(lost.end_utc)
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
    start, end = iso_unix_s(one.start_utc), iso_unix_s(one.end_utc)
    at = iso_unix_s(one.leave_utc)
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
    wanted = np.array([0.5 * (iso_unix_s(one.start_utc) + iso_unix_s(one.end_utc)) for one in taken])
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
    bodies = (sun.at(utc_s) for utc_s in edges.tolist())
    heights = [altitude_deg(body.hour_angle_deg, body.dec_deg, site.latitude_deg) for body in bodies]
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
    axis.set_xticks(ticks, [local_time.clock(float(t))[:5] for t in ticks], fontsize=8)
    axis.set_xlabel(f"{local_time.day(span[0])}, {local_time.zone_name(span[0])}", fontsize=8, loc="left")


def _legend(figure: Any, plan: SchedulePlan) -> None:
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
