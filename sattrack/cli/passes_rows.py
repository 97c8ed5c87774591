"""Passes as rows: the fields of JSON and CSV, and the lines of a table."""

from __future__ import annotations

import csv
import io
import json
import math
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING

import click
import msgspec
import numpy as np

from tle.crossings import select
from tle.errors import printable
from tle.facts import NUMBERS
from tle.instants import Utc

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from numpy.typing import NDArray

    from sattrack.mount.model import MountProfile
    from sattrack.safety.limits import SafetyLimits
    from tle.catalogue_passes import CataloguePasses
    from tle.elements import Elements
    from tle.facts import FactColumns, PassFacts
    from tle.passes import Pass

    Array = NDArray[np.float64]
    Index = NDArray[np.intp]

_NIGHT_DEG, _HIGH_DEG = -6.0, 60.0
_HEAD = "Rise UTC  Az°  Top       Az°   Alt°  Set       Az°   HA °/s Dec °/s  Sun°   Mag  Light   Satellite"
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
        for first in range(0, len(self), _ROWS_A_BLOCK):
            yield self.take(np.arange(first, min(first + _ROWS_A_BLOCK, len(self))))

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


def judged_table(table: PassTable, profile: MountProfile, limits: SafetyLimits) -> PassTable:
    """Return the rows, each with the verdict on the part of the pass that lies within the search's span."""
    from sattrack.planning.kinematics import ability_at, verdict_on

    task, found = table.passes.task, table.passes.found
    ability = ability_at(task.site, profile, limits)
    begin_s = task.span[0]
    obj = found.obj[table.index].tolist()
    first, last = (begin_s + edge[table.index] for edge in table.passes.search().ends(found))
    why_not = tuple(
        verdict_on(task.elements[o], task.site, ends, ability, task.earth).why_not
        for o, ends in zip(obj, zip(first.tolist(), last.tolist(), strict=True), strict=True)
    )
    return replace(table, judged=True, why_not=why_not)


def write_json(table: PassTable, write: Callable[[str], object]) -> None:
    """Write one JSON array, a block of rows at a time."""
    opening = "["
    for block in table.blocks():
        columns = _texts(block, _json_numbers, "null", '"')
        columns["name"] = _of_objects(block, lambda every: [json.dumps(one.name) for one in every])
        columns["feasible"] = _feasible(block, ("true", "false", "null"))
        columns["why_not"] = [json.dumps(why) for why in block.why_not] or ["null"] * len(block)
        columns.update(_lists(block))
        rows = (_JSON_ROW % row for row in zip(*(columns[key] for key in _FIELDS), strict=True))
        write(opening + ", ".join(rows))
        opening = ", "
    write("[]\n" if opening == "[" else "]\n")


def write_csv(table: PassTable, write: Callable[[str], object]) -> None:
    """Write the fields of JSON that are single values, with a line of titles."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(_SINGLE)
    for block in table.blocks():
        columns = _texts(block, _numbers, "", "")
        columns["name"] = _of_objects(block, lambda every: [one.name for one in every])
        columns["feasible"] = _feasible(block, ("True", "False", ""))
        columns["why_not"] = [why or "" for why in block.why_not] or [""] * len(block)
        writer.writerows(zip(*(columns[key] for key in _SINGLE), strict=True))
        write(out.getvalue())
        out.seek(0)
        out.truncate()
    write(out.getvalue())


def _texts(
    block: PassTable, numbers: Callable[[Array], list[str]], none: str, quote: str
) -> dict[str, list[str]]:
    """Return the fields that are one number or instant, as text by name; `none` where there is none."""
    found, start_s, facts = block.passes.found, block.passes.task.span[0], block.facts

    def instants(since_s: Array) -> list[str]:
        return _instants(start_s + since_s, none, quote)

    def epochs(every: list[Elements]) -> list[str]:
        dated = [one.epoch.unix_s if one.catalog_number else math.nan for one in every]
        return _instants(np.array(dated), none, quote)

    starts = facts.sunlit.starts(len(block))
    some = starts[1:] > starts[:-1]
    lit_from, lit_to = np.full(len(block), np.nan), np.full(len(block), np.nan)
    lit_from[some], lit_to[some] = (
        facts.sunlit.first_s[starts[:-1][some]],
        facts.sunlit.last_s[starts[1:][some] - 1],
    )
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
    return {
        "catalog_number": _of_objects(
            block, lambda every: [str(one.catalog_number) if one.catalog_number else none for one in every]
        ),
        "elements_epoch": _of_objects(block, epochs),
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
    return columns


def _bracketed(items: list[str], starts: Index) -> list[str]:
    return [f"[{', '.join(items[low:high])}]" for low, high in pairwise(starts.tolist())]


def _of_objects(block: PassTable, texts: Callable[[list[Elements]], list[str]]) -> list[str]:
    """Return a text of each row's elements, made once for each object."""
    names, which = np.unique(block.passes.found.obj[block.index], return_inverse=True)
    made = texts([block.passes.elements[o] for o in names.tolist()])
    return [made[k] for k in which.tolist()]


def _instants(unix_s: Array, none: str, quote: str) -> list[str]:
    missing = np.isnan(unix_s)
    texts = Utc(np.where(missing, 0.0, unix_s)).isoformats()
    if quote:
        texts = [f"{quote}{text}{quote}" for text in texts]
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


def _feasible(block: PassTable, words: tuple[str, str, str]) -> list[str]:
    yes, no, unknown = words
    return [yes if why is None else no for why in block.why_not] if block.judged else [unknown] * len(block)


def table_lines(table: PassTable, day: str) -> Iterator[str]:
    """Yield a table in colours; dates are written where they are not `day` or the line before's."""
    yield click.style(_HEAD, bold=True)
    for block in table.blocks():
        found, start_s = block.passes.found, block.passes.task.span[0]
        moments = [
            _moments(start_s + since_s[block.index], azimuth_deg[block.index])
            for since_s, azimuth_deg in (
                (found.rise_s, found.rise_az_deg),
                (found.culminate_s, found.culminate_az_deg),
                (found.set_s, found.set_az_deg),
            )
        ]
        first_s = np.where(np.isnan(found.rise_s), found.culminate_s, found.rise_s)[block.index]
        dates = [text[:10] for text in Utc(start_s + first_s).isoformats("seconds")]
        alts_deg = found.max_alt_deg[block.index].tolist()
        facts = block.facts.items(start_s)
        labels = _of_objects(block, lambda every: [one.label for one in every])
        why_not = block.why_not or (None,) * len(block)
        for date, rise, top, end, *rest in zip(
            dates, *moments, alts_deg, facts, labels, why_not, strict=True
        ):
            if date != day:
                yield click.style(date, bold=True)
                day = date
            yield _line((rise, top, end), *rest)


def _line(
    moments: tuple[str, str, str],
    max_alt_deg: float,
    facts: PassFacts | None,
    label: str,
    why_not: str | None,
) -> str:
    rise, top, end = moments
    cells = [rise, top, click.style(f"{max_alt_deg:5.1f}", bold=max_alt_deg >= _HIGH_DEG), end]
    if facts is None:
        return "  ".join([*cells, f"{'-':>7} {'-':>7} {'-':>5} {'-':>5}  -     ", label])
    night = facts.sun_alt_deg <= _NIGHT_DEG
    light = "lit" if facts.sunlit and not facts.penumbra else "partly" if facts.sunlit else "dark"
    bright = "-" if facts.magnitude is None else f"{facts.magnitude:.1f}"
    colour = ("green" if night else "yellow") if facts.sunlit else "bright_black"
    return "  ".join(
        [
            *cells,
            f"{facts.peak_ha_rate_deg_s:7.3f} {facts.peak_dec_rate_deg_s:7.3f} "
            + click.style(f"{facts.sun_alt_deg:5.0f}", fg="blue" if night else None)
            + f" {bright:>5}",
            click.style(f"{light:6}", fg=colour),
            printable(label) + ("" if why_not is None else f"  NOT: {why_not}"),
        ]
    )


def _moments(unix_s: Array, azimuth_deg: Array) -> list[str]:
    """Return time of day and azimuth in 13 columns; dots where the span's end cuts the pass."""
    texts = Utc(np.nan_to_num(unix_s, nan=0.0)).isoformats("seconds")
    rows = zip(texts, azimuth_deg.tolist(), np.isnan(unix_s).tolist(), strict=True)
    return [
        "........  ..." if missing else f"{text[11:19]} {azimuth % 360.0:4.0f}"
        for text, azimuth, missing in rows
    ]
