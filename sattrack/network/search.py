"""The passes of a catalogue over one station on one day, as one Parquet file: the unit of the work.

What a file holds follows from elements, station, day and span alone. A pass belongs to the UTC day in which
it rises, to the first one where it was up already, and is whole there: one in progress at midnight is
followed on. So all files of a station together hold what a search of the whole span finds.
"""

from __future__ import annotations

import hashlib
import math
import warnings
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

import numpy as np

import sattrack
from sattrack.core.errors import needed
from tle.errors import EarthOrientationWarning
from tle.facts import fact_columns
from tle.horizon import Horizon
from tle.instants import DAY_S, Utc
from tle.passes import HOUR_S, find_catalogue_passes

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from sattrack.network.stations import Station
    from tle.elements import Elements
    from tle.horizon import HorizonMask
    from tle.passes import CataloguePasses
    from tle.site import Site

    Index = NDArray[np.intp]
    Columns = dict[str, NDArray[Any]]

PACKAGES = ("numpy", "sgp4", "pyerfa", "astropy-iers-data", "pyarrow")
"""Packages whose version may change the last bit of a file."""
INSTANTS = ("rise_utc", "culminate_utc", "set_utc", "sunlit_from_utc", "sunlit_to_utc")
NUMBERS = (
    "max_alt_deg",
    "rise_az_deg",
    "culminate_az_deg",
    "set_az_deg",
    "peak_ha_rate_deg_s",
    "peak_dec_rate_deg_s",
    "sunlit_s",
    "sun_alt_deg",
    "min_sun_separation_deg",
    "min_moon_separation_deg",
)
_BEYOND_S = (2.0 * HOUR_S, 26.0 * HOUR_S, math.inf)
"""How far past midnight passes are followed: those near the Earth set soon, few others do, the rest later."""
_CLOSE_S = 1e-3


def versions() -> dict[str, str]:
    """Return the versions that a file's bytes may depend on, this package's first."""
    return {"sattrack": sattrack.__version__, **_package_versions()}


@cache
def _package_versions() -> dict[str, str]:
    return {name: version(name) for name in PACKAGES}


@dataclass(frozen=True, slots=True)
class StationDay:
    """A station and a day: POSIX seconds of the part of the day that lies in the span, and of the span."""

    station: str
    day: str
    site: Site
    min_alt_deg: float
    mask: HorizonMask | None
    day_s: tuple[float, float]
    span_s: tuple[float, float]

    @property
    def path(self) -> str:
        """The file's place in the data set."""
        return f"station={self.station}/day={self.day}/passes.parquet"

    @property
    def is_first(self) -> bool:
        """Whether the span begins on this day."""
        return self.day_s[0] == self.span_s[0]


@dataclass(frozen=True, slots=True)
class Partition:
    """A file's content, how many passes it holds, how many objects SGP4 refuses that day, and the first."""

    data: bytes
    passes: int
    refused: int
    first_refusal: str


def station_days(stations: Sequence[Station], start: Utc, hours: float) -> list[StationDay]:
    """Return all work of a span, in order of day and station. Raises SourceError for a bad skyline."""
    first_s = float(start.unix_s)
    last_s = first_s + hours * HOUR_S
    skylines = [(one, one.skyline()) for one in stations]
    found = []
    for number in range(math.floor(first_s / DAY_S), math.ceil(last_s / DAY_S)):
        day_s = (max(first_s, number * DAY_S), min(last_s, (number + 1) * DAY_S))
        day = Utc(number * DAY_S).isoformat("seconds")[:10]
        found += [
            StationDay(one.name, day, one.site, one.min_altitude_deg, sky.mask, day_s, (first_s, last_s))
            for one, sky in skylines
        ]
    return found


def elements_sum(elements: Sequence[Elements]) -> str:
    """Return a sum over all that the elements say, SHA-256 in hexadecimal digits."""
    total = hashlib.sha256()
    for one in elements:
        total.update(repr([getattr(one, name) for name in one.__slots__ if name != "epoch"]).encode())
        total.update(one.epoch.isoformat("microseconds").encode())
    return total.hexdigest()


def search_day(elements: Sequence[Elements], work: StationDay) -> Partition:
    """Return the passes of a day as a Parquet file. Raises SattrackError without pyarrow, TleError."""
    with warnings.catch_warnings():
        # Who asks for the whole span tells of it once.
        warnings.simplefilter("ignore", EarthOrientationWarning)
        parts, whole = _found(elements, work)
        rows = [_columns(passes, index) for passes, index in parts]
    table = {name: np.concatenate([part[name] for part in rows]) for name in rows[0]}
    # lexsort's last key counts first; as whole numbers, what was up before the span comes first.
    order = np.lexsort((table["culminate_utc"], table["catalog_number"], table["rise_utc"].view("i8")))
    table = {name: column[order] for name, column in table.items()}
    failed = whole.failed
    return Partition(_parquet(table), len(order), len(failed), str(failed[0][1]) if failed else "")


def _found(
    elements: Sequence[Elements], work: StationDay
) -> tuple[list[tuple[CataloguePasses, Index]], CataloguePasses]:
    """Return searches, with the passes of each that belong to the day, and the first search."""
    begin, horizon = Utc(work.day_s[0]), Horizon(work.min_alt_deg, work.mask)
    length_s, left_s = (end - work.day_s[0] for end in (work.day_s[1], work.span_s[1]))
    whole = find_catalogue_passes(elements, work.site, begin, length_s / HOUR_S, horizon)
    begun = _begun(whole, work, length_s)
    is_open = begun & np.isnan(whole.found.set_s) if length_s < left_s else np.zeros_like(begun)
    parts = [(whole, np.flatnonzero(begun & ~is_open))]
    objects = [whole.elements[o] for o in np.unique(whole.found.obj[is_open]).tolist()]
    for beyond_s in _BEYOND_S:
        if not objects:
            break
        until_s = min(length_s + beyond_s, left_s)
        more = find_catalogue_passes(objects, work.site, begin, until_s / HOUR_S, horizon)
        # The last pass of each object that begins on this day is the one in progress at its end.
        mine = np.flatnonzero(_begun(more, work, length_s))
        last = mine[np.flatnonzero(np.diff(more.found.obj[mine], append=-1))]
        still = np.isnan(more.found.set_s[last]) & (until_s < left_s)
        parts.append((more, last[~still]))
        objects = [objects[o] for o in more.found.obj[last[still]].tolist()]
    return parts, whole


def _begun(passes: CataloguePasses, work: StationDay, length_s: float) -> NDArray[np.bool_]:
    """Tell which passes belong to the day."""
    rise_s = passes.found.rise_s
    begun: NDArray[np.bool_] = rise_s < length_s + _CLOSE_S
    return begun | np.isnan(rise_s) if work.is_first else begun


def _columns(passes: CataloguePasses, index: Index) -> Columns:
    """Return the passes of an index with their facts: instants in milliseconds, single precision else."""
    facts, found = fact_columns(passes, index), passes.found
    start_s = float(passes.start.unix_s)
    count, obj = len(index), found.obj[index]
    lit = facts.sunlit
    lit_from, lit_to = lit.ends(count)
    lit_s = np.bincount(lit.owner, lit.last_s - lit.first_s, minlength=count)
    seconds = {
        "rise_utc": found.rise_s[index],
        "culminate_utc": found.culminate_s[index],
        "set_utc": found.set_s[index],
        "sunlit_from_utc": lit_from,
        "sunlit_to_utc": lit_to,
    }
    numbers = {
        "max_alt_deg": found.max_alt_deg[index],
        "rise_az_deg": np.where(np.isnan(found.rise_s), np.nan, found.rise_az_deg)[index],
        "culminate_az_deg": found.culminate_az_deg[index],
        "set_az_deg": np.where(np.isnan(found.set_s), np.nan, found.set_az_deg)[index],
        "sunlit_s": np.where(facts.known, lit_s, np.nan),
    } | {name: getattr(facts, name) for name in NUMBERS if hasattr(facts, name)}
    every = passes.elements
    names, which = np.unique(obj, return_inverse=True)
    epochs = np.array([float(every[o].epoch.unix_s) for o in names.tolist()], dtype=np.float64)
    return {
        "catalog_number": np.array([every[o].catalog_number for o in obj.tolist()], dtype=np.int32),
        "name": np.array([every[o].name for o in obj.tolist()], dtype=object),
        "elements_epoch": _instants(epochs)[which],
        **{name: _instants(start_s + seconds[name]) for name in INSTANTS},
        **{name: numbers[name].astype(np.float32) for name in NUMBERS},
    }


def _instants(unix_s: NDArray[np.float64]) -> NDArray[Any]:
    missing = np.isnan(unix_s)
    ms = np.rint(np.where(missing, 0.0, unix_s) * 1000.0).astype(np.int64).astype("datetime64[ms]")
    ms[missing] = np.datetime64("NaT")
    return ms


def parquet_modules() -> tuple[Any, Any]:
    """Import `pyarrow` and `pyarrow.parquet`; raises SattrackError where they are not there."""
    what, extra = "a network's data set", "parquet"
    return needed("pyarrow", what, extra), needed("pyarrow.parquet", what, extra)


def _parquet(table: Columns) -> bytes:
    pyarrow, parquet = parquet_modules()
    instant = pyarrow.timestamp("ms", tz="UTC")
    columns = {}
    for name, column in table.items():
        if column.dtype.kind == "M":
            columns[name] = pyarrow.array(column).cast(pyarrow.timestamp("ms")).cast(instant)
        elif column.dtype.kind == "f":
            columns[name] = pyarrow.array(column, mask=np.isnan(column))
        else:
            columns[name] = pyarrow.array(column, type=pyarrow.string() if name == "name" else None)
    out = pyarrow.BufferOutputStream()
    parquet.write_table(pyarrow.table(columns), out, compression="zstd", version="2.6")
    return bytes(out.getvalue())
