"""Observations as CSV: utc, ra_deg, dec_deg and, if known, frame, station, object and uncertainties."""

from __future__ import annotations

import csv
import io
from typing import TYPE_CHECKING, get_args

from tle.errors import ObservationError, SiteError, TimeFormatError
from tle.instants import Utc
from tle.observations import Observation, Stations, placed, site_of
from tle.residuals import Frame
from tle.site import Site

if TYPE_CHECKING:
    from collections.abc import Mapping

NEEDED = ("utc", "ra_deg", "dec_deg")
KNOWN = (
    *NEEDED,
    "frame",
    "station",
    "latitude_deg",
    "longitude_deg",
    "height_m",
    "object",
    "sigma_arcsec",
    "sigma_time_s",
)


def looks_like_csv(text: str) -> bool:
    """Tell whether the first line that is no comment names the columns that are needed."""
    for line in text.splitlines():
        if line.strip() and not line.startswith("#"):
            return set(NEEDED) <= {name.strip() for name in line.split(",")}
    return False


def parse_text(text: str, stations: Stations, source: str) -> list[Observation]:
    """Return the observations; `frame` is icrf (default), j2000 or of_date. Raises ObservationError."""
    lines = text.splitlines()
    kept = [(n, line) for n, line in enumerate(lines, start=1) if line.strip() and not line.startswith("#")]
    header = [name.strip() for name in kept[0][1].split(",")]
    unknown = [name for name in header if name not in KNOWN]
    if unknown:
        raise ObservationError(
            placed(source, kept[0][0], f"column {unknown[0]!r} is not known: use {', '.join(KNOWN)}")
        )
    found = []
    for number, line in kept[1:]:
        try:
            cells = next(csv.reader(io.StringIO(line)))
        except csv.Error as error:
            raise ObservationError(placed(source, number, str(error))) from None
        if len(cells) != len(header):
            raise ObservationError(
                placed(source, number, f"has {len(cells)} columns, the header {len(header)}")
            )
        row = {name: cell.strip() for name, cell in zip(header, cells, strict=True)}
        found.append(_observation(row, stations, source, number))
    return found


def _observation(row: Mapping[str, str], stations: Stations, source: str, line: int) -> Observation:
    frame = row.get("frame") or "icrf"
    if frame not in get_args(Frame):
        raise ObservationError(
            placed(source, line, f"{frame!r} is no frame: use one of {', '.join(get_args(Frame))}")
        )
    try:
        utc = Utc.parse(row["utc"])
    except TimeFormatError as error:
        raise ObservationError(placed(source, line, str(error))) from None
    numbers = {name: _number(row, name, source, line) for name in KNOWN if name.endswith(("_deg", "_m"))}
    ra_deg, dec_deg = numbers["ra_deg"], numbers["dec_deg"]
    if ra_deg is None or dec_deg is None:
        raise ObservationError(placed(source, line, "ra_deg or dec_deg is empty: give both, in degrees"))
    latitude, longitude = numbers["latitude_deg"], numbers["longitude_deg"]
    if latitude is not None and longitude is not None:
        try:
            site = Site(latitude, longitude, numbers["height_m"] or 0.0)
        except SiteError as error:
            raise ObservationError(placed(source, line, str(error))) from None
    else:
        site = site_of(stations, row.get("station", ""), source, line)
    return Observation(
        utc,
        ra_deg,
        dec_deg,
        frame,  # type: ignore[arg-type] # one of the frames, as checked above
        site,
        row.get("object", ""),
        _number(row, "sigma_arcsec", source, line),
        _number(row, "sigma_time_s", source, line),
        source,
        line,
    )


def _number(row: Mapping[str, str], name: str, source: str, line: int) -> float | None:
    text = row.get(name, "")
    if not text:
        return None
    try:
        return float(text)
    except ValueError:
        raise ObservationError(placed(source, line, f"{name} {text!r} is no number")) from None
