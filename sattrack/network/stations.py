"""The list of a network's stations, as TOML or CSV.

A station has a name, a place, and optionally a least altitude, a skyline and a mount's profile:

    [[stations]]
    name = "leiden"
    latitude_deg = 52.1541
    longitude_deg = 4.4908
    height_m = 0

In CSV the first line names the same fields as columns.
"""

from __future__ import annotations

import csv
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from sattrack.core.errors import BadInputError, Origin, meant
from sattrack.core.toml_text import read_typed, why_unreadable
from sattrack.mount.profiles import no_settings
from tle.horizon import Horizon, HorizonMask
from tle.site import HIGHEST_GROUND_M, LOWEST_GROUND_M, Site

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

NAME = re.compile(r"[A-Za-z][A-Za-z0-9_.-]{0,39}")
REQUIRED = ("name", "latitude_deg", "longitude_deg")


class Station(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One station: WGS 84 degrees, metres above the ellipsoid, files relative to the list.

    `horizon` is a file of the skyline, `profile` one of the mount. The name becomes a folder's and a key of
    data sets. Raises ValueError for a value that no station on the ground has.
    """

    name: str
    latitude_deg: float
    longitude_deg: float
    height_m: float = 0.0
    min_altitude_deg: float = 10.0
    horizon: str | None = None
    profile: str | None = None

    def __post_init__(self) -> None:
        """Check name, place and altitude."""
        if not NAME.fullmatch(self.name):
            raise ValueError(
                f"name is {self.name!r}; begin with a letter, then letters, digits, - _ . (40 at most)"
            )
        _within("latitude_deg", self.latitude_deg, -90.0, 90.0, "degrees north")
        _within("longitude_deg", self.longitude_deg, -180.0, 360.0, "degrees east")
        _within(
            "height_m",
            self.height_m,
            LOWEST_GROUND_M,
            HIGHEST_GROUND_M,
            "metres: no ground on Earth lies outside",
        )
        _within("min_altitude_deg", self.min_altitude_deg, -5.0, 89.0, "degrees")

    @property
    def site(self) -> Site:
        """The place."""
        return Site(self.latitude_deg, self.longitude_deg, self.height_m)

    def skyline(self) -> Horizon:
        """Return what satellites must be above. Raises SourceError for a bad file of the skyline."""
        return Horizon(self.min_altitude_deg, HorizonMask.read(self.horizon) if self.horizon else None)


class _StationList(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    stations: tuple[Station, ...]


def _within(name: str, value: float, low: float, high: float, unit: str) -> None:
    if not low <= value <= high:
        raise ValueError(f"{name} is {value:g}; give {low:g} to {high:g} {unit}")


def read_stations(path: Path) -> list[Station]:
    """Return the stations of a TOML or CSV file in order of name, their files by absolute path.

    Raises BadInputError with file and line for what cannot be read, unknown fields, values that no station
    has, and two stations with one name.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, ValueError) as error:
        raise BadInputError(f"{path}: cannot read the stations: {why_unreadable(error)}") from None
    is_toml = path.suffix.lower() == ".toml" or re.search(r"^\s*\[\[", text, re.MULTILINE) is not None
    placed = list(_from_toml(text, path) if is_toml else _from_csv(text, path))
    if not placed:
        raise BadInputError(f"{path}: lists no station: write [[stations]] tables, or lines of CSV")
    _check_names(placed)
    return sorted((_beside(one, path, where) for one, where in placed), key=lambda one: one.name)


def _from_toml(text: str, path: Path) -> Iterator[tuple[Station, Origin]]:
    with no_settings(path, "not a list of stations: docs/network.md says what stands in one"):
        found, positions = read_typed(text, str(path), _StationList, columns=False)
    for number, one in enumerate(found.stations):
        yield one, positions.key("stations", number)


def _from_csv(text: str, path: Path) -> Iterator[tuple[Station, Origin]]:
    lines = csv.reader(text.splitlines(), skipinitialspace=True, strict=True)
    titles: list[str] = []
    try:
        for row in lines:
            here = Origin(str(path), lines.line_num)
            if not any(field.strip() for field in row) or row[0].startswith("#"):
                continue
            if titles:
                yield _from_row(row, titles, here), here
            else:
                titles = _titles(row, here)
    except csv.Error as error:
        raise Origin(str(path), lines.line_num).wrong(f"no CSV: {error}") from None


def _titles(row: list[str], here: Origin) -> list[str]:
    known = list(Station.__struct_fields__)
    titles = [field.strip() for field in row]
    for number, title in enumerate(titles):
        if title not in known:
            hint = meant(title, known) or f"; there are {', '.join(known)}"
            raise here.wrong(f"unknown column {title!r}{hint}")
        if title in titles[:number]:
            raise here.wrong(f"the column {title!r} is there twice")
    if absent := [name for name in REQUIRED if name not in titles]:
        raise here.wrong(f"the first line names no column {' and '.join(absent)}")
    return titles


def _from_row(row: list[str], titles: list[str], here: Origin) -> Station:
    if len(row) > len(titles):
        raise here.wrong(f"{len(row)} fields for {len(titles)} columns")
    values: dict[str, Any] = {
        title: field.strip() for title, field in zip(titles, row, strict=False) if field.strip()
    }
    if absent := [name for name in REQUIRED if name not in values]:
        raise here.wrong(f"{' and '.join(absent)} is empty")
    for title in titles:
        if title in values and title not in ("name", "horizon", "profile"):
            try:
                values[title] = float(values[title])
            except ValueError:
                raise here.wrong(f"{title} is {values[title]!r}; give a number") from None
    try:
        return Station(**values)
    except ValueError as error:
        raise here.wrong(str(error)) from None


def _check_names(placed: Iterable[tuple[Station, Origin]]) -> None:
    """Raise BadInputError where two names are the same, or differ in upper and lower case only."""
    first: dict[str, Origin] = {}
    for one, where in placed:
        before = first.setdefault(one.name.casefold(), where)
        if before is not where:
            raise where.wrong(
                f"a station {one.name!r} is in line {before.line} already; names differ by more than case"
            )


def _beside(one: Station, path: Path, where: Origin) -> Station:
    """Return a station with its files by absolute path. Raises BadInputError for one that is not there."""
    files = {name: getattr(one, name) for name in ("horizon", "profile")}
    found = {name: str((path.parent / file).resolve()) for name, file in files.items() if file}
    for name, file in found.items():
        if not Path(file).is_file():
            raise where.wrong(f"{name} of {one.name}: there is no file {file}")
    return msgspec.structs.replace(one, **found)


def station_named(stations: Sequence[Station], name: str) -> Station:
    """Return the station of a name. Raises BadInputError with the nearest one."""
    for one in stations:
        if one.name == name:
            return one
    names = [one.name for one in stations]
    raise BadInputError(f"no station is named {name!r}{meant(name, names) or f'; there are {len(names)}'}")
