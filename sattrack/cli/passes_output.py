"""Passes as JSON, CSV, a table, a calendar (iCalendar, RFC 5545) and a chart of the sky."""

from __future__ import annotations

import csv
import io
import json
import math
from collections import Counter
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import click
import msgspec
import numpy as np

from sattrack.cli.output import tell
from sattrack.core import local_time
from tle.bodies import Body
from tle.crossings import select
from tle.errors import printable
from tle.facts import NUMBERS
from tle.instants import Utc
from tle.propagator import Propagator
from tle.workers import mapping

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence
    from pathlib import Path

    from icalendar import Event
    from numpy.typing import NDArray

    from sattrack.mount.model import MountProfile
    from sattrack.safety.limits import SafetyLimits
    from sattrack.views.schedule import PlannedPass, SchedulePlan
    from tle.elements import Elements
    from tle.ephemeris import Ephemeris
    from tle.facts import FactColumns, PassFacts
    from tle.horizon import Horizon
    from tle.passes import CataloguePasses, Pass
    from tle.site import Site
    from tle.transits import Transit

    Array = NDArray[np.float64]
    Index = NDArray[np.intp]


_NIGHT_DEG, _HIGH_DEG = -6.0, 60.0
_HIGH, _AT_NIGHT = click.style("%5.1f", bold=True), click.style("%5.0f", fg="blue")
_LIGHT = {
    (light, night): click.style(f"{light:6}", fg=colour)
    for light, colours in (
        ("lit", ("yellow", "green")),
        ("partly", ("yellow", "green")),
        ("dark", ("bright_black", "bright_black")),
        ("-", (None, None)),
    )
    for night, colour in enumerate(colours)
}
"""How the satellite is lit, by whether it is night."""
_HEAD = "Rise      Az°  Top       Az°   Alt°  Set       Az°   HA °/s Dec °/s  Sun°   Mag  Light   Satellite"
_SINGLE = (
    "name",
    "catalog_number",
    "elements_epoch",
    "rise_utc",
    "culminate_utc",
    "set_utc",
    "max_alt_deg",
    "rise_az_deg",
    "culminate_az_deg",
    "set_az_deg",
    "peak_ha_rate_deg_s",
    "peak_dec_rate_deg_s",
    "sunlit_from_utc",
    "sunlit_to_utc",
    "sun_alt_deg",
    "min_sun_separation_deg",
    "min_moon_separation_deg",
    "magnitude",
    "feasible",
    "why_not",
)
_FIELDS = (
    "name",
    "catalog_number",
    "elements_epoch",
    "rise_utc",
    "culminate_utc",
    "set_utc",
    "max_alt_deg",
    "rise_az_deg",
    "set_az_deg",
    "peak_ha_rate_deg_s",
    "peak_dec_rate_deg_s",
    "sunlit_from_utc",
    "sunlit_to_utc",
    "sun_alt_deg",
    "min_sun_separation_deg",
    "min_moon_separation_deg",
    "feasible",
    "why_not",
    "culminate_az_deg",
    "culminations_utc",
    "sunlit_utc",
    "penumbra_utc",
    "magnitude",
)
_JSON_ROW = "{" + ", ".join(f'"{name}": %s' for name in _FIELDS) + "}"
_ROWS_A_BLOCK = 4000
_JUDGED_A_BLOCK = 100


@dataclass(frozen=True, slots=True)
class Row:
    """A pass, whose it is, and its facts; None where SGP4 ends before the pass does."""

    elements: Elements
    seen: Pass
    facts: PassFacts | None
    judged: bool = False
    """Whether the mount's limits were held against it; then `why_not` is what it cannot be followed for."""
    why_not: str | None = None


@dataclass(frozen=True, slots=True)
class PassTable:
    """Some of the passes found, by index and in the order to show, with their facts."""

    passes: CataloguePasses
    index: Index
    facts: FactColumns
    judged: bool = False
    """Whether the mount's limits were held against them; then `why_not` says why they cannot be followed."""
    why_not: tuple[str | None, ...] = ()

    def __len__(self) -> int:
        """Return how many rows there are."""
        return len(self.index)

    def take(self, which: Index) -> PassTable:
        """Return some of the rows, in their order."""
        why_not = tuple(self.why_not[k] for k in which.tolist()) if self.judged else ()
        return PassTable(self.passes, self.index[which], self.facts.take(which), self.judged, why_not)

    def blocks(self) -> Iterator[PassTable]:
        """Go through all rows, many at a time."""
        for rows in _blocks(len(self), _ROWS_A_BLOCK):
            yield self.take(np.array(rows))

    def rows(self) -> list[Row]:
        """Return the rows one by one, as objects."""
        seen = self.passes.take(self.index)
        facts = self.facts.items(self.passes.task.span[0])
        why_not = self.why_not or (None,) * len(self)
        return [
            Row(one.elements, one.seen, fact, self.judged, why)
            for one, fact, why in zip(seen, facts, why_not, strict=True)
        ]

    @property
    def peak_rate_deg_s(self) -> Array:
        """The larger of the two axes' peak rates; infinity where it is not known."""
        peak = np.maximum(self.facts.peak_ha_rate_deg_s, self.facts.peak_dec_rate_deg_s)
        return np.where(np.isnan(peak), np.inf, peak)

    @property
    def magnitude(self) -> Array:
        """The magnitude; infinity where it is not known."""
        return np.where(np.isnan(self.facts.magnitude), np.inf, self.facts.magnitude)

    def sorted(self, by: str) -> PassTable:
        """Return the rows in order of rise (those in progress first), altitude, magnitude, rate or name."""
        found, elements = self.passes.found, self.passes.elements
        obj = found.obj[self.index]
        begins_s = np.nan_to_num(self.passes.task.span[0] + found.rise_s[self.index], nan=-np.inf)
        if by == "name":
            labels = sorted({elements[o].label.casefold() for o in obj.tolist()})
            place = {label: k for k, label in enumerate(labels)}
            names = np.array([place[elements[o].label.casefold()] for o in obj.tolist()], dtype=np.intp)
            return self.take(np.lexsort((begins_s, names)))
        if by == "rise":
            numbers = np.array([elements[o].catalog_number for o in obj.tolist()], dtype=np.intp)
            return self.take(np.lexsort((numbers, begins_s)))
        keys = {"altitude": -found.max_alt_deg[self.index], "rate": self.peak_rate_deg_s}
        return self.take(np.argsort(keys.get(by, self.magnitude), kind="stable"))


def _blocks(count: int, size: int) -> list[range]:
    return [range(count)[first : first + size] for first in range(0, count, size)]


def judged_table(
    table: PassTable,
    profile: MountProfile,
    limits: SafetyLimits,
    progress: Callable[[int, int], None] | None = None,
    workers: int = 1,
) -> PassTable:
    """Return the rows, each with the verdict on the part of the pass that lies within the search's span.

    `progress` takes passes done and all; `workers` share those, see `tle.workers.mapping`.
    """
    from sattrack.planning.kinematics import ability_at, verdict_on

    task, found = table.passes.task, table.passes.found
    ability = ability_at(task.site, profile, limits)
    begin_s = task.span[0]
    obj = found.obj[table.index].tolist()
    first, last = ((begin_s + edge[table.index]).tolist() for edge in table.passes.search.ends(found))

    def judged(rows: range) -> tuple[range, list[str | None]]:
        verdicts = (
            verdict_on(task.elements[obj[k]], task.site, (first[k], last[k]), ability, task.earth)
            for k in rows
        )
        return rows, [verdict.why_not for verdict in verdicts]

    count = len(table)
    blocks = _blocks(count, _JUDGED_A_BLOCK)
    why_not: list[str | None] = [None] * count
    done = 0
    with mapping(min(workers, len(blocks))) as mapped:
        for rows, reasons in mapped(judged, blocks):
            why_not[rows.start : rows.stop] = reasons
            done += len(rows)
            if progress is not None:
                progress(done, count)
    return replace(table, judged=True, why_not=tuple(why_not))


def write_json(table: PassTable, write: Callable[[str], object], workers: int = 1) -> None:
    """Write one JSON array, a block of rows at a time; `workers` share those, see `tle.workers.mapping`."""
    objects = _objects(table, json.dumps, "null", '"')

    def text(block: PassTable) -> str:
        columns = _texts(block, objects, _json_numbers, "null", '"')
        columns["feasible"] = _feasible(block, ("true", "false", "null"))
        columns["why_not"] = [json.dumps(why) for why in block.why_not] or ["null"] * len(block)
        columns.update(_lists(block))
        return ", ".join(_JSON_ROW % row for row in zip(*(columns[key] for key in _FIELDS), strict=True))

    opening = "["
    for rows in _block_texts(table, text, workers):
        write(opening + rows)
        opening = ", "
    write("[]\n" if opening == "[" else "]\n")


def write_csv(table: PassTable, write: Callable[[str], object], workers: int = 1) -> None:
    """Write the fields of JSON that are single values, with a line of titles, shared as by `write_json`."""
    objects = _objects(table, str, "", "")

    def text(block: PassTable) -> str:
        columns = _texts(block, objects, _numbers, "", "")
        columns["feasible"] = _feasible(block, ("True", "False", ""))
        columns["why_not"] = [why or "" for why in block.why_not] or [""] * len(block)
        return _csv_lines(zip(*(columns[key] for key in _SINGLE), strict=True))

    write(_csv_lines([_SINGLE]))
    for rows in _block_texts(table, text, workers):
        write(rows)


def _csv_lines(rows: Iterable[Sequence[str]]) -> str:
    out = io.StringIO()
    csv.writer(out, lineterminator="\n").writerows(rows)
    return out.getvalue()


def _block_texts(table: PassTable, text: Callable[[PassTable], str], workers: int) -> Iterator[str]:
    """Yield the text of each block of rows, in their order."""
    blocks = _blocks(len(table), _ROWS_A_BLOCK)
    early: dict[int, str] = {}
    with mapping(min(workers, len(blocks))) as mapped:
        following = 0
        for number, made in mapped(lambda k: (k, text(table.take(np.array(blocks[k])))), range(len(blocks))):
            early[number] = made
            while following in early:
                yield early.pop(following)
                following += 1


def _objects(
    table: PassTable, text: Callable[[str], str], none: str, quote: str
) -> dict[int, tuple[str, str, str]]:
    """Return name, catalogue number and epoch of each object that has a pass, by index, as text."""
    names = np.unique(table.passes.found.obj[table.index]).tolist()
    every = [table.passes.elements[o] for o in names]
    numbers = [str(one.catalog_number) if one.catalog_number else none for one in every]
    dated = [one.epoch.unix_s if one.catalog_number else math.nan for one in every]
    epochs = _instants(np.array(dated), none, quote)
    return dict(zip(names, zip((text(one.name) for one in every), numbers, epochs, strict=True), strict=True))


def _texts(
    block: PassTable,
    objects: dict[int, tuple[str, str, str]],
    numbers: Callable[[Array], list[str]],
    none: str,
    quote: str,
) -> dict[str, list[str]]:
    """Return the fields that are one number, instant or name, as text; `none` where there is none."""
    found, start_s, facts = block.passes.found, block.passes.task.span[0], block.facts

    def instants(since_s: Array) -> list[str]:
        return _instants(start_s + since_s, none, quote)

    unknown = ~light_known(block)
    lit_from, lit_to = (np.where(unknown, np.nan, ends) for ends in facts.sunlit.ends(len(block)))
    azimuths = {
        "rise_az_deg": np.where(np.isnan(found.rise_s), np.nan, found.rise_az_deg)[block.index],
        "set_az_deg": np.where(np.isnan(found.set_s), np.nan, found.set_az_deg)[block.index],
    }
    columns = {
        **azimuths,
        "max_alt_deg": found.max_alt_deg[block.index],
        "culminate_az_deg": found.culminate_az_deg[block.index],
        **{name: getattr(facts, name) for name in NUMBERS},
    }
    own = [objects[o] for o in found.obj[block.index].tolist()]
    return {
        "name": [name for name, _, _ in own],
        "catalog_number": [number for _, number, _ in own],
        "elements_epoch": [epoch for _, _, epoch in own],
        "rise_utc": instants(found.rise_s[block.index]),
        "culminate_utc": instants(found.culminate_s[block.index]),
        "set_utc": instants(found.set_s[block.index]),
        "sunlit_from_utc": instants(lit_from),
        "sunlit_to_utc": instants(lit_to),
        **{name: numbers(column) for name, column in columns.items()},
    }


def _lists(block: PassTable) -> dict[str, list[str]]:
    """Return the fields of JSON that are lists, as text."""
    found, start_s = select(block.passes.found, block.index), block.passes.task.span[0]
    tops = _instants(start_s + found.peak_s, "null", '"')
    starts = np.searchsorted(found.peak_run, np.arange(len(block) + 1))
    columns = {"culminations_utc": _bracketed(tops, starts)}
    for key, spans in (("sunlit_utc", block.facts.sunlit), ("penumbra_utc", block.facts.penumbra)):
        edges = (_instants(start_s + part, "null", '"') for part in (spans.first_s, spans.last_s))
        pairs = [f"[{first}, {last}]" for first, last in zip(*edges, strict=True)]
        columns[key] = _bracketed(pairs, spans.starts(len(block)))
        for k in np.flatnonzero(~light_known(block)).tolist():
            columns[key][k] = "null"
    return columns


def light_known(block: PassTable) -> NDArray[np.bool_]:
    """Tell of which passes it is known whether the Sun lights what passes."""
    objects, which = np.unique(block.passes.found.obj[block.index], return_inverse=True)
    known = np.array([_has_a_place(block.passes.elements[o]) for o in objects.tolist()], dtype=bool)
    return known[which]


def _has_a_place(one: Ephemeris) -> bool:
    """Tell whether something is more than a direction; what shines counts as lit."""
    return one.ranged or isinstance(one, Body)


def _bracketed(items: list[str], starts: Index) -> list[str]:
    return [f"[{', '.join(items[low:high])}]" for low, high in pairwise(starts.tolist())]


def _instants(unix_s: Array, none: str, quote: str) -> list[str]:
    missing = np.isnan(unix_s)
    texts = Utc(np.where(missing, 0.0, unix_s)).isoformats(quote=quote)
    for k in np.flatnonzero(missing).tolist():
        texts[k] = none
    return texts


def _json_numbers(column: Array) -> list[str]:
    """Return numbers as Python writes them in JSON, null for NaN."""
    texts = msgspec.json.encode(column.tolist())[1:-1].decode().split(",") if len(column) else []
    size = np.abs(column)
    # msgspec writes the exponents of the very small and the very large in another way.
    for k in np.flatnonzero((size > 0.0) & ((size < 1e-4) | (size >= 1e16))).tolist():
        texts[k] = repr(float(column[k]))
    return texts


def _numbers(column: Array) -> list[str]:
    """Return numbers as Python writes them, nothing for NaN."""
    return ["" if text == "null" else text for text in _json_numbers(column)]


def _feasible(block: PassTable, text: tuple[str, str, str]) -> list[str]:
    yes, no, unknown = text
    return [yes if why is None else no for why in block.why_not] if block.judged else [unknown] * len(block)


def _now_lines(table: PassTable, now_utc_s: float) -> Iterator[str]:
    """Yield what is up at an instant, and how soon the next pass begins."""
    begins_s, found = table.passes.task.span[0], table.passes.found
    rises, sets = begins_s + found.rise_s[table.index], begins_s + found.set_s[table.index]
    coming, over = rises > now_utc_s, sets <= now_utc_s
    # Those that begin before the span, or end after it, have no such instant.
    ends = sets[~coming & ~over]
    if len(ends) == 1 and np.isfinite(ends[0]):
        yield f"A pass is under way: it ends {local_time.until(float(ends[0]) - now_utc_s)}."
    elif len(ends):
        yield "A pass is under way." if len(ends) == 1 else f"{len(ends)} passes are under way."
    if coming.any():
        yield f"The next pass begins {local_time.until(float(rises[coming].min()) - now_utc_s)}."


def table_lines(table: PassTable, now_utc_s: float | None) -> Iterator[str]:
    """Yield a table in colours, its times local, with a line for each day.

    `now_utc_s` is the instant from which the next pass is counted, None where that is of no interest.
    """
    begins_s, span_s = table.passes.task.span
    if now_utc_s is not None:
        yield from _now_lines(table, now_utc_s)
    yield click.style(_HEAD, bold=True)
    day, minute = "", None
    changes = local_time.changes_within(begins_s, begins_s + span_s)
    for block in table.blocks():
        found, start_s = block.passes.found, block.passes.task.span[0]
        moments = [
            _moments(start_s + since_s[block.index], azimuth_deg[block.index], changes)
            for since_s, azimuth_deg in (
                (found.rise_s, found.rise_az_deg),
                (found.culminate_s, found.culminate_az_deg),
                (found.set_s, found.set_az_deg),
            )
        ]
        first_s = start_s + np.where(np.isnan(found.rise_s), found.culminate_s, found.rise_s)[block.index]
        alts_deg = found.max_alt_deg[block.index].tolist()
        facts = block.facts.items(start_s)
        own = [block.passes.elements[o] for o in found.obj[block.index].tolist()]
        why_not = block.why_not or (None,) * len(block)
        for first, rise, top, end, *rest in zip(
            first_s.tolist(), *moments, alts_deg, facts, own, why_not, strict=True
        ):
            # No zone begins a day, or changes, within a minute.
            if minute != (minute := round(first) // 60):
                date = f"{local_time.day(first)}, {local_time.zone_name(first)}"
                if date != day:
                    yield click.style(date, bold=True)
                    day = date
            yield _line((rise, top, end), *rest)


def _line(
    moments: tuple[str, str, str],
    max_alt_deg: float,
    facts: PassFacts | None,
    followed: Ephemeris,
    why_not: str | None,
) -> str:
    label = followed.label
    rise, top, end = moments
    cells = [rise, top, (_HIGH if max_alt_deg >= _HIGH_DEG else "%5.1f") % max_alt_deg, end]
    if facts is None:
        return "  ".join([*cells, f"{'-':>7} {'-':>7} {'-':>5} {'-':>5}  -     ", label])
    night = facts.sun_alt_deg <= _NIGHT_DEG
    light = "lit" if facts.sunlit and not facts.penumbra else "partly" if facts.sunlit else "dark"
    light = light if _has_a_place(followed) else "-"
    bright = "-" if facts.magnitude is None else f"{facts.magnitude:.1f}"
    return "  ".join(
        [
            *cells,
            f"{facts.peak_ha_rate_deg_s:7.3f} {facts.peak_dec_rate_deg_s:7.3f} "
            + (_AT_NIGHT if night else "%5.0f") % facts.sun_alt_deg
            + f" {bright:>5}",
            _LIGHT[light, night],
            printable(label) + ("" if why_not is None else f"  NOT: {why_not}"),
        ]
    )


def _moments(unix_s: Array, azimuth_deg: Array, changes: bool) -> list[str]:
    """Return time of day and azimuth in 13 columns; dots where the span's end cuts the pass.

    `changes` says whether the zone's offset changes within the span: then each instant has its own.
    """
    known_s = np.nan_to_num(unix_s, nan=0.0)
    if changes:
        local_s = known_s + np.array([local_time.offset_s(at) for at in known_s.tolist()])
    else:
        local_s = known_s + (local_time.offset_s(float(known_s.max())) if len(known_s) else 0.0)
    texts = Utc(local_s).isoformats("seconds")
    rows = zip(texts, azimuth_deg.tolist(), np.isnan(unix_s).tolist(), strict=True)
    return [
        "........  ..." if missing else f"{text[11:19]} {azimuth % 360.0:4.0f}"
        for text, azimuth, missing in rows
    ]


def passes_calendar(table: PassTable) -> bytes:
    """Return the events of passes found; one that the span cuts begins or ends with it."""
    start, site = table.passes.start, table.passes.task.site
    end = start.plus(table.passes.task.span[1])
    return calendar_bytes("passes", (_found(row, start, end, site) for row in table.rows()))


def plan_calendar(plan: SchedulePlan, made: Utc, site: Site) -> bytes:
    """Return the passes of a plan for a site as events, made at an instant."""
    return calendar_bytes("schedule", (_planned(one, made, site) for one in plan.passes))


def calendar_bytes(product: str, events: Iterable[Event]) -> bytes:
    """Return a calendar of events as UTF-8, in lines of at most 75 octets that end with CR and LF.

    An event whose UID one before it has gets another, with a count.
    """
    from icalendar import Calendar

    calendar = Calendar()
    calendar.add("version", "2.0")
    calendar.add("prodid", f"-//sattrack//{product}//EN")
    taken: Counter[str] = Counter()
    for event in events:
        uid = str(event.pop("uid"))
        taken[uid] += 1
        event.add("uid", uid if taken[uid] == 1 else f"{taken[uid]}-{uid}")
        calendar.add_component(event)
    text: bytes = calendar.to_ical()
    return text


def event_of(uid: str, made: Utc, span: tuple[Utc, Utc], summary: str, description: str) -> Event:
    """Return one event; instants to the second."""
    from icalendar import Event

    event = Event()
    event.add("uid", uid)
    for name, at in (("dtstamp", made), ("dtstart", span[0]), ("dtend", span[1])):
        event.add(name, Utc(round(at.unix_s)).datetime())
    event.add("summary", summary)
    event.add("description", description)
    return event


def _found(row: Row, start: Utc, end: Utc, site: Site) -> Event:
    seen = row.seen
    top = seen.culminate_utc
    # Where the span cuts a pass off from its top, the highest instant is an end of the span, which moves on.
    cut = top - start < 1.0 or end - top < 1.0
    lasting = (seen.set_utc or seen.rise_utc or top) if cut else top
    text = [f"Highest at {local_time.instant(float(top.unix_s))}, azimuth {seen.culminate_az_deg:.0f}°."]
    if row.facts is not None:
        text.append(f"Sun at {row.facts.sun_alt_deg:.0f}°.")
        if _has_a_place(row.elements):
            text.append("Sunlit." if row.facts.sunlit else "Not sunlit.")
    return event_of(
        _uid(row.elements.catalog_number, row.elements.label, lasting, site),
        start,
        (seen.rise_utc or start, seen.set_utc or end),
        f"{printable(row.elements.label)} {seen.max_alt_deg:.0f}°",
        " ".join(text),
    )


def _planned(one: PlannedPass, made: Utc, site: Site) -> Event:
    text = [
        f"Highest at {local_time.localised(one.culminate_utc)}: {one.max_alt_deg:.0f}°.",
        f"From azimuth {one.start_az_deg:.0f}° to {one.end_az_deg:.0f}°.",
        f"{one.useful_s:.0f} useful seconds, priority {one.priority:g}.",
        f"The mount leaves by {local_time.localised(one.leave_utc)}.",
        *(["Shortened."] if one.shortened else []),
        f"Asked by {printable(one.asked_by)}",
        *([f"Before: {'; '.join(one.before)}"] if one.before else []),
        *([f"After: {'; '.join(one.after)}"] if one.after else []),
    ]
    event = event_of(
        _uid(one.catalog_number, one.name, Utc.parse(one.culminate_utc), site, "-plan"),
        made,
        (Utc.parse(one.start_utc), Utc.parse(one.end_utc)),
        f"{printable(one.name or str(one.catalog_number))} {one.max_alt_deg:.0f}°",
        "\n".join(text),
    )
    event.add("categories", ["satellite pass"])
    return event


def _uid(number: int | None, name: str, at: Utc, site: Site, kind: str = "") -> str:
    """Return what names a pass of an object over a site, the same in every run."""
    stamp = at.isoformat("seconds").replace("-", "").replace(":", "")
    place = f"{site.latitude_deg:+.4f}{site.longitude_deg:+.4f}"
    return f"{number or printable(name)}-{stamp}{place}{kind}@sattrack"


_MOST_PASSES = 12
_LOOKS = 200


def plot_passes(path: Path, table: PassTable) -> None:
    """Draw the first passes as seen from below: north up, east to the left; dashed where not sunlit.

    Raises BadInputError where that cannot be.
    """
    from sattrack.recording.rendering import new_figure, save, sky_axes

    figure = new_figure(10.0, 7.0)
    passes = table.passes
    if len(table) > _MOST_PASSES:
        tell(f"the chart shows the first {_MOST_PASSES} of {len(table)} passes")
    sky = figure.add_subplot(projection="polar")
    sky_axes(sky)
    _draw_horizon(sky, passes.task.horizon)
    for number, row in enumerate(table.take(np.arange(min(len(table), _MOST_PASSES))).rows()):
        _draw_pass(sky, row, passes, f"C{number % 10}")
    begin_s, span_s = passes.task.span
    sky.set_title(f"Passes from {local_time.span(begin_s, begin_s + span_s)}, sky seen from below", pad=20.0)
    if len(table):
        figure.legend(loc="outside right upper", fontsize="small", title="highest at, dashed: not sunlit")
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
    top = local_time.clock(float(seen.culminate_utc.unix_s))[:5]
    label = f"{row.elements.label}  {top}  {seen.max_alt_deg:.0f}°"
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
            local_time.clock(float(seen.rise_utc.unix_s))[:5],
            xy=(angle[0], radius[0]),
            color=colour,
            fontsize="small",
            annotation_clip=False,
        )


def transit_rows(transits: Sequence[Transit]) -> list[dict[str, Any]]:
    """Return transits as JSON has them."""
    return [
        {
            "name": one.target.name,
            "catalog_number": one.target.catalog_number or None,
            "body": one.body,
            "utc": one.utc.isoformat("milliseconds"),
            "begin_utc": one.begin_utc.isoformat("milliseconds"),
            "end_utc": one.end_utc.isoformat("milliseconds"),
            "duration_s": round(one.duration_s, 4),
            "time_sigma_s": one.sigma_s,
            "separation_deg": one.separation_deg,
            "body_diameter_deg": 2.0 * one.radius_deg,
            "alt_deg": one.alt_deg,
            "az_deg": one.az_deg,
            "range_km": one.range_km,
            "sunlit": one.sunlit,
            "path_width_km": one.width_km,
            "path_centre_km": one.off_line_km,
        }
        for one in transits
    ]


def transit_lines(transits: Sequence[Transit]) -> Iterator[str]:
    """Yield the lines of a table of transits, times in the zone that is set."""
    yield "Time          Lasts  Before Alt°  Az°  Off     Size    Path km Middle km Range km  Satellite"
    date = None
    for one in transits:
        unix_s = float(one.utc.unix_s)
        whole_s = math.floor(unix_s)
        if local_time.date(whole_s) != date:
            date = local_time.date(whole_s)
            yield date
        time = f"{local_time.clock(whole_s)}.{math.floor(100.0 * (unix_s - whole_s)):02d}"
        off, size = one.separation_deg * 60.0, one.radius_deg * 120.0
        yield (
            f"{time:<12s}{one.duration_s:6.2f}s  {one.body:<6s}{one.alt_deg:5.0f}{one.az_deg:5.0f}"
            f"{off:6.2f}′{size:7.2f}′{one.width_km:10.1f}{one.off_line_km:10.2f}{one.range_km:9.0f}"
            f"  {printable(one.target.label)}"
        )
