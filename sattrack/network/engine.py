"""The work of `network passes`: in this process or by local ones; `cluster` has Dask's."""

from __future__ import annotations

import os
import pickle
import threading
import time
from collections import deque
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from multiprocessing import get_context, parent_process
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import msgspec

from sattrack.core.errors import SattrackError
from sattrack.network.dataset import DataSet
from sattrack.network.search import elements_sum, search_day, station_days, versions

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence
    from concurrent.futures import Future

    from sattrack.network.search import Partition, StationDay
    from sattrack.network.stations import Station
    from tle.elements import Elements
    from tle.instants import Utc

    Done = tuple[StationDay, Partition]
    Engine = Callable[[Sequence[Elements], Sequence[StationDay]], Iterable[Done]]
    Progress = Callable[[int, int, int], None]

AHEAD = 2
"""Work handed out beyond what is being done, for each worker: more would only take memory."""
MOST_BREAKS = 3
"""So often in a row may worker processes die without any work finished in between."""


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
        """Yield the work done, in any order. Raises SattrackError where workers die again and again."""
        todo, breaks = deque(works), 0
        # By a file: a process that dies while it is started would leave us writing to its pipe forever.
        with TemporaryDirectory(prefix="sattrack-") as folder:
            file = Path(folder) / "elements"
            file.write_bytes(pickle.dumps(elements))
            while todo:
                try:
                    for done in self._by_one_pool(file, todo):
                        breaks = 0
                        yield done
                except BrokenProcessPool:
                    breaks += 1
                    if breaks >= MOST_BREAKS:
                        raise SattrackError(
                            "worker processes die again and again: they were killed, or memory ran out; "
                            "try fewer --workers"
                        ) from None

    def _by_one_pool(self, file: Path, todo: deque[StationDay]) -> Iterator[Done]:
        """Yield work done and take it off the list. Raises BrokenProcessPool where a process dies."""
        flying: dict[Future[Partition], StationDay] = {}
        pool = ProcessPoolExecutor(
            min(self._count, len(todo)),
            mp_context=get_context("spawn"),
            initializer=_begin_worker,
            initargs=(file,),
        )
        try:
            while todo or flying:
                while todo and len(flying) < self._count + AHEAD:
                    flying[pool.submit(_work, todo[0])] = todo[0]
                    todo.popleft()
                for future in wait(flying, return_when=FIRST_COMPLETED).done:
                    partition = future.result()
                    yield flying.pop(future), partition
        finally:
            todo.extendleft(flying.values())
            pool.shutdown(wait=False, cancel_futures=True)


class _Worker:
    """The elements of this process when it works for another."""

    elements: Sequence[Elements]


def _begin_worker(file: Path) -> None:
    _Worker.elements = pickle.loads(file.read_bytes())
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _work(work: StationDay) -> Partition:
    return search_day(_Worker.elements, work)
