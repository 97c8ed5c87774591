"""Work on a Dask cluster: workers, scheduler and client may each die and come back."""

from __future__ import annotations

import asyncio
import logging
import time
from concurrent.futures import CancelledError
from contextlib import suppress
from typing import TYPE_CHECKING, Any
from uuid import uuid4

import sattrack
from sattrack.core.errors import BadInputError, SattrackError, how_to_install
from sattrack.network.engine import AHEAD
from sattrack.network.search import elements_sum, search_day, versions

try:
    from distributed import Client, KilledWorker, WorkerPlugin
    from distributed import wait as wait_for
    from distributed.comm.core import CommClosedError
except ImportError:
    raise SattrackError(f"--cluster needs dask and distributed: {how_to_install('cluster')}") from None

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from distributed import Future, Worker

    from sattrack.network.search import Partition, StationDay
    from tle.elements import Elements

    Done = tuple[StationDay, Partition]

CONNECT_S = 5.0
PATIENCE_S = 300.0
"""So long is a scheduler that was lost, or are workers, waited for."""
LOOK_S = 1.0
MOST_DEATHS = 3
"""So many workers may die, or be without the elements, with one piece of work."""


class _LostClusterError(Exception):
    """The scheduler went, or has forgotten what it was asked."""


class VersionError(SattrackError):
    """A worker has another version than this process."""


class NoElementsError(Exception):
    """A worker was not given the elements yet."""


class _Shared:
    """The elements that this worker was given, by their sum."""

    elements: dict[str, Sequence[Elements]] = {}  # noqa: RUF012 - one for the whole process on purpose


class _Carrier(WorkerPlugin):  # type: ignore[misc]
    """Takes the elements to each worker once, also to those that join later."""

    def __init__(self, total: str, elements: Sequence[Elements]) -> None:
        self.name = f"sattrack-{total[:16]}"
        self._total, self._elements = total, elements

    def setup(self, worker: Worker) -> None:
        _Shared.elements[self._total] = self._elements

    def teardown(self, worker: Worker) -> None:
        _Shared.elements.pop(self._total, None)


def _work(total: str, work: StationDay, expected: dict[str, str]) -> Partition:
    _check_versions("a worker", versions(), expected)
    if total not in _Shared.elements:
        raise NoElementsError(total)
    return search_day(_Shared.elements[total], work)


def _check_versions(worker: str, there: dict[str, str], here: dict[str, str]) -> None:
    for name, ours in here.items():
        if there.get(name) != ours:
            raise VersionError(
                f"{worker} has {name} {there.get(name)}, this computer has {ours}: "
                "install the same version there"
            )


class DaskCluster:
    """The workers of a Dask scheduler, `tcp://HOST:PORT`. Raises BadInputError for no address."""

    def __init__(self, address: str, tell: Callable[[str], None]) -> None:
        scheme, _, rest = address.partition("://")
        host, _, port = rest.rpartition(":")
        if scheme not in ("tcp", "tls") or not host or not port.isdecimal():
            raise BadInputError(f"--cluster {address!r} is no address of a scheduler: write tcp://HOST:8786")
        self._address, self._tell = address, tell
        # A line of our own reports lost connections. Dask gives some of its loggers a level of their own.
        for name in [name for name in logging.root.manager.loggerDict if name.startswith("distributed")]:
            logging.getLogger(name).setLevel(logging.CRITICAL)

    def __call__(self, elements: Sequence[Elements], works: Sequence[StationDay]) -> Iterator[Done]:
        """Yield the work done, in any order. Raises SattrackError where the cluster is not there or unfit."""
        left = {work.path: work for work in works}
        client = self._connected(0.0)
        try:
            while left:
                try:
                    for work, partition in _Session(client, elements, self._tell).run(list(left.values())):
                        yield work, partition
                        del left[work.path]
                except (_LostClusterError, CommClosedError, CancelledError, OSError) as error:
                    why = (str(error) or type(error).__name__).splitlines()[0].rstrip(":")
                    self._tell(f"the scheduler at {self._address} is gone ({why}); waiting for it")
                    _close(client)
                    client = self._connected(PATIENCE_S)
        finally:
            _close(client)

    def _connected(self, patience_s: float) -> Client:
        until_s = time.monotonic() + patience_s
        while True:
            try:
                return Client(self._address, timeout=CONNECT_S)
            except (OSError, TimeoutError, ValueError, CommClosedError):
                if time.monotonic() >= until_s:
                    raise SattrackError(
                        f"no Dask scheduler answers at {self._address}: start one with `dask scheduler`, or "
                        "check the address"
                    ) from None


class _Session:
    """One connection to a scheduler. Raises _LostClusterError where that is gone."""

    def __init__(self, client: Client, elements: Sequence[Elements], tell: Callable[[str], None]) -> None:
        self._client, self._elements, self._tell = client, elements, tell
        self._total, self._expected = elements_sum(elements), versions()
        self._flying: dict[Future, StationDay] = {}
        self._deaths: dict[str, int] = {}

    def run(self, works: list[StationDay]) -> Iterator[Done]:
        """Yield the work done."""
        self._wait_for_workers()
        self._check_workers()
        carrier = _Carrier(self._total, self._elements)
        self._client.register_plugin(carrier, name=carrier.name)
        works = works[::-1]
        while works or self._flying:
            self._hand_out(works)
            done: set[Future] = set()
            with suppress(TimeoutError, asyncio.TimeoutError):
                done = wait_for(list(self._flying), timeout=LOOK_S, return_when="FIRST_COMPLETED").done
            if self._client.status != "running":
                raise _LostClusterError("no connection")
            for future in done:
                work = self._flying.pop(future)
                partition = self._result(future, work)
                if partition is None:
                    works.append(work)
                else:
                    yield work, partition
                future.release()
        with suppress(Exception):
            self._client.unregister_worker_plugin(carrier.name)

    def _slots(self) -> int:
        return sum(one["nthreads"] for one in self._client.scheduler_info(n_workers=-1)["workers"].values())

    def _wait_for_workers(self) -> None:
        until_s, warned = time.monotonic() + PATIENCE_S, False
        while not self._slots():
            if self._client.status != "running":
                raise _LostClusterError("no connection")
            if not warned and time.monotonic() > until_s - PATIENCE_S + LOOK_S:
                self._tell("the scheduler has no workers yet; waiting")
                warned = True
            if time.monotonic() > until_s:
                raise SattrackError("the scheduler has no workers: start some with `dask worker`")
            with suppress(TimeoutError, asyncio.TimeoutError):
                self._client.wait_for_workers(1, timeout=LOOK_S)

    def _check_workers(self) -> None:
        try:
            found: dict[str, dict[str, str]] = self._client.run(versions)
        except (ModuleNotFoundError, AttributeError) as error:
            raise VersionError(
                f"a worker cannot load sattrack {sattrack.__version__}, which this computer has: {error}"
            ) from None
        for worker, there in sorted(found.items()):
            _check_versions(f"the worker {worker}", there, self._expected)

    def _hand_out(self, works: list[StationDay]) -> None:
        most = self._slots() + AHEAD
        while works and len(self._flying) < most:
            work = works.pop()
            future = self._client.submit(
                _work,
                self._total,
                work,
                self._expected,
                key=f"sattrack-{work.path}-{uuid4().hex[:8]}",
                pure=False,
            )
            self._flying[future] = work

    def _result(self, future: Future, work: StationDay) -> Partition | None:
        """Return what came of a piece of work, None where it must be done again."""
        if future.status == "finished":
            partition: Partition = future.result(timeout=CONNECT_S * 6)
            return partition
        if future.status != "error":
            raise _LostClusterError(f"work {future.status}")
        error: Any = future.exception(timeout=CONNECT_S)
        if not isinstance(error, KilledWorker | NoElementsError):
            raise error
        self._deaths[work.path] = self._deaths.get(work.path, 0) + 1
        if self._deaths[work.path] >= MOST_DEATHS:
            raise SattrackError(f"{work.path}: workers die of it again and again: give them more memory")
        time.sleep(LOOK_S if isinstance(error, NoElementsError) else 0.0)
        return None


def _close(client: Client) -> None:
    with suppress(Exception):
        client.close(timeout=2)
