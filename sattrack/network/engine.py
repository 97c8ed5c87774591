"""The work of `network passes`: in this process or by local ones; `cluster` has Dask's."""

from __future__ import annotations

import pickle
import time
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, cast

import msgspec

from sattrack.network.dataset import DataSet
from sattrack.network.search import elements_sum, search_day, station_days, versions
from tle.workers import spawned

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    from sattrack.network.search import Partition, StationDay
    from sattrack.network.stations import Station
    from tle.elements import Elements
    from tle.instants import Utc

    Done = tuple[StationDay, Partition]
    Engine = Callable[[Sequence[Elements], Sequence[StationDay]], Iterable[Done]]
    Progress = Callable[[int, int, int], None]

AHEAD = 2
"""Work handed out beyond what is being done, for each worker: more would only take memory."""


@dataclass(slots=True)
class Totals:
    """The outcome: files and passes, files that were there before, objects refused on the first day."""

    partitions: int
    passes: int = 0
    resumed: int = 0
    seconds: float = 0.0
    refused: int = 0
    first_refusal: str = ""


def make_data_set(
    folder: Path,
    stations: Sequence[Station],
    elements: Sequence[Elements],
    span: tuple[Utc, float],
    engine: Engine,
    progress: Progress | None = None,
) -> Totals:
    """Find all passes of a span (start, hours) and keep them in a folder, a file for each station and day.

    Files that are finished already are verified and kept. `progress` is called with partitions done, all, and
    passes. Raises BadInputError for a folder with other settings, SattrackError, TleError.
    """
    begun_s = time.monotonic()
    elements = sorted(elements, key=lambda one: (one.catalog_number, one.name, float(one.epoch.unix_s)))
    works = station_days(stations, *span)
    totals = Totals(len(works))
    with DataSet(folder, manifest_of(stations, elements, span)) as kept:
        done = kept.verified(work.path for work in works)
        totals.resumed, totals.passes = len(done), sum(one.passes for one in done.values())
        todo = [work for work in works if work.path not in done]
        if progress is not None:
            progress(totals.resumed, totals.partitions, totals.passes)
        for work, partition in engine(elements, todo) if todo else ():
            kept.put(work.path, partition.data, partition.passes)
            totals.passes += partition.passes
            if work.is_first and partition.refused > totals.refused:
                totals.refused, totals.first_refusal = partition.refused, partition.first_refusal
            if progress is not None:
                progress(len(kept.done), totals.partitions, totals.passes)
        kept.finish()
    totals.seconds = round(time.monotonic() - begun_s, 3)
    return totals


def manifest_of(
    stations: Sequence[Station], elements: Sequence[Elements], span: tuple[Utc, float]
) -> dict[str, Any]:
    """Return what a data set depends on. Raises SourceError for a bad skyline."""
    start, hours = span
    places = {}
    for one in stations:
        mask = one.skyline().mask
        kept = msgspec.structs.replace(one, horizon=None, profile=None)
        places[one.name] = msgspec.to_builtins(kept) | {
            "horizon": None if mask is None else [mask.azimuths_deg, mask.altitudes_deg]
        }
        del places[one.name]["profile"]
    return {
        "format": 1,
        "settings": {
            "from_utc": start.isoformat("milliseconds"),
            "hours": hours,
            "elements": {"count": len(elements), "sha256": elements_sum(elements)},
            "stations": places,
        },
        "versions": versions(),
    }


def in_this_process(elements: Sequence[Elements], works: Sequence[StationDay]) -> Iterator[Done]:
    """Yield the work done, one after the other."""
    for work in works:
        yield work, search_day(elements, work)


class LocalWorkers:
    """Work shared among processes of this machine; those that die are replaced."""

    def __init__(self, count: int) -> None:
        self._count = count

    def __call__(self, elements: Sequence[Elements], works: Sequence[StationDay]) -> Iterator[Done]:
        """Yield the work done, in any order."""
        # By a file: a process that dies while it is started would leave us writing to its pipe forever.
        with TemporaryDirectory(prefix="sattrack-") as folder:
            file = Path(folder) / "elements"
            file.write_bytes(pickle.dumps(elements))
            yield from spawned(_Searching(file), works, self._count)


class _Searching:
    """The search of one process, which reads the elements once."""

    def __init__(self, file: Path) -> None:
        self._file = file

    @cached_property
    def _elements(self) -> Sequence[Elements]:
        return cast("Sequence[Elements]", pickle.loads(self._file.read_bytes()))

    def __call__(self, work: StationDay) -> Done:
        return work, search_day(self._elements, work)
