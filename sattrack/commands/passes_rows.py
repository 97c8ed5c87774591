"""Passes as rows: the fields of JSON and CSV, and the lines of a table."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import click

from tle.errors import printable

if TYPE_CHECKING:
    from tle.elements import Elements
    from tle.facts import PassFacts
    from tle.instants import Utc
    from tle.passes import Pass

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


@dataclass(frozen=True, slots=True)
class Row:
    """A pass, whose it is, and its facts; None where SGP4 ends before the pass does."""

    elements: Elements
    seen: Pass
    facts: PassFacts | None
    judged: bool = False
    """Whether the mount's limits were held against it; then `why_not` is what it cannot be followed for."""
    why_not: str | None = None

    @property
    def begins_s(self) -> float:
        """Give the rise, or for a pass in progress minus infinity, in POSIX seconds."""
        return -math.inf if self.seen.rise_utc is None else float(self.seen.rise_utc.unix_s)

    @property
    def peak_rate_deg_s(self) -> float:
        """Give the larger of the two axes' peak rates; infinity where it is not known."""
        if self.facts is None:
            return math.inf
        return max(self.facts.peak_ha_rate_deg_s, self.facts.peak_dec_rate_deg_s)

    @property
    def magnitude(self) -> float:
        """Give the magnitude; infinity where it is not known."""
        if self.facts is None or self.facts.magnitude is None:
            return math.inf
        return self.facts.magnitude

    def document(self) -> dict[str, Any]:
        """Return the fields that scripts rely on, None where there is no value."""
        seen, facts = self.seen, self.facts
        lit = facts.sunlit if facts is not None else ()
        return {
            "name": self.elements.name,
            "catalog_number": self.elements.catalog_number,
            "elements_epoch": _iso(self.elements.epoch),
            "rise_utc": _iso(seen.rise_utc),
            "culminate_utc": _iso(seen.culminate_utc),
            "set_utc": _iso(seen.set_utc),
            "max_alt_deg": seen.max_alt_deg,
            "rise_az_deg": seen.rise_az_deg,
            "set_az_deg": seen.set_az_deg,
            "peak_ha_rate_deg_s": getattr(facts, "peak_ha_rate_deg_s", None),
            "peak_dec_rate_deg_s": getattr(facts, "peak_dec_rate_deg_s", None),
            "sunlit_from_utc": _iso(lit[0][0]) if lit else None,
            "sunlit_to_utc": _iso(lit[-1][1]) if lit else None,
            "sun_alt_deg": getattr(facts, "sun_alt_deg", None),
            "min_sun_separation_deg": getattr(facts, "min_sun_separation_deg", None),
            "min_moon_separation_deg": getattr(facts, "min_moon_separation_deg", None),
            "feasible": self.why_not is None if self.judged else None,
            "why_not": self.why_not,
            "culminate_az_deg": seen.culminate_az_deg,
            "culminations_utc": [_iso(t) for t in seen.culminations_utc],
            "sunlit_utc": [[_iso(a), _iso(b)] for a, b in lit],
            "penumbra_utc": [[_iso(a), _iso(b)] for a, b in facts.penumbra] if facts is not None else [],
            "magnitude": getattr(facts, "magnitude", None),
        }


def as_json(rows: list[Row]) -> str:
    """Return one JSON array."""
    import json

    return json.dumps([row.document() for row in rows], allow_nan=False)


def as_csv(rows: list[Row]) -> str:
    """Return the fields of JSON that are single values, with a line of titles."""
    import csv
    import io

    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(_SINGLE)
    for row in rows:
        document = row.document()
        writer.writerow(["" if document[key] is None else document[key] for key in _SINGLE])
    return out.getvalue()


def table_lines(rows: list[Row], day: str) -> list[str]:
    """Return a table in colours; dates are written where they are not `day` or the line before's."""
    lines = [click.style(_HEAD, bold=True)]
    for row in rows:
        first = row.seen.rise_utc or row.seen.culminate_utc
        date = first.isoformat("seconds")[:10]
        if date != day:
            lines.append(click.style(date, bold=True))
            day = date
        lines.append(_line(row))
    return lines


def _line(row: Row) -> str:
    seen, facts = row.seen, row.facts
    cells = [
        _moment(seen.rise_utc, seen.rise_az_deg),
        _moment(seen.culminate_utc, seen.culminate_az_deg),
        click.style(f"{seen.max_alt_deg:5.1f}", bold=seen.max_alt_deg >= _HIGH_DEG),
        _moment(seen.set_utc, seen.set_az_deg),
    ]
    if facts is None:
        return "  ".join([*cells, f"{'-':>7} {'-':>7} {'-':>5} {'-':>5}  -     ", row.elements.label])
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
            printable(row.elements.label) + ("" if row.why_not is None else f"  NOT: {row.why_not}"),
        ]
    )


def _moment(at: Utc | None, azimuth_deg: float | None) -> str:
    """Return time of day and azimuth in 13 columns; dots where the span's end cuts the pass."""
    if at is None or azimuth_deg is None:
        return "........  ..."
    return f"{at.isoformat('seconds')[11:19]} {azimuth_deg % 360.0:4.0f}"


def _iso(at: Utc | None) -> str | None:
    return None if at is None else at.isoformat()
