"""Large work shared among processors: by processes where the system forks, by threads elsewhere.

What searches and looks at passes is many short calls of numpy, which threads of one interpreter can hardly
share. Processes that are forked hold all of their parent's memory at once and send back results alone.
"""

from __future__ import annotations

import gc
import os
import signal
import sys
import threading
import warnings
from collections import deque
from contextlib import contextmanager, nullcontext
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from multiprocessing.connection import Connection

    Work = Callable[[Any], Any]

# Elements. Arrays of so long rows meet a single row without copies of it: half the time.
_BUFFER = 512
# Items handed out to a process beyond the one it works on, so that it need not wait for the next.
_AHEAD = 2
# So many processes in a row may die without a result in between.
_MOST_DEATHS = 3


@contextmanager
def mapping(workers: int) -> Iterator[Callable[[Work, Sequence[Any]], Iterator[Any]]]:
    """Give `map` over a sequence, shared by so many workers; results come in any order.

    Processes are used on Linux by a program with one thread that may have children; they end with the
    iteration. One that dies is replaced. Results, and what work raises, must be picklable.
    """
    if workers <= 1:
        yield lambda work, items: map(partial(_in_small_buffers, work), items)
    elif _may_fork():
        yield lambda work, items: _forked(partial(_in_small_buffers, work), items, workers)
    else:
        from concurrent.futures import ThreadPoolExecutor

        with ThreadPoolExecutor(workers) as pool:
            yield lambda work, items: pool.map(partial(_in_small_buffers, work), _by_turns(items))


def _may_fork() -> bool:
    """Tell whether this process can be forked: locks that other threads hold stay locked in the copy."""
    if sys.platform != "linux" or threading.active_count() > 1:
        return False
    import multiprocessing

    return not multiprocessing.current_process().daemon


def _by_turns(items: Sequence[Any]) -> list[Any]:
    """Return the first and last in alternation: deep space comes first, and its SGP4 stops other threads."""
    return [items[k // 2 if k % 2 == 0 else -1 - k // 2] for k in range(len(items))]


def _in_small_buffers(work: Work, item: Any) -> Any:
    """Return what work makes of an item; numpy copies rows into buffers only where these hold several."""
    with np.errstate():
        np.setbufsize(_BUFFER)
        return work(item)


def spawned(work: Work, items: Sequence[Any], workers: int) -> Iterator[Any]:
    """Yield what work makes of each item, in any order, done by so many new processes on any system.

    They end with the iteration. One that dies is replaced; where several in a row die without a result, the
    rest is done here. Work, items, results, and what work raises, must be picklable; work less than 64 kB.
    """
    return _shared(work, items, workers, fork=False)


def _forked(work: Work, items: Sequence[Any], workers: int) -> Iterator[Any]:
    """Yield what work makes of each item, done by copies of this process, which hold the items already."""
    return _shared(lambda k: work(items[k]), range(len(items)), workers, fork=True)


def _shared(work: Work, items: Sequence[Any], workers: int, *, fork: bool) -> Iterator[Any]:
    """Yield what work makes of each item, done by processes. Raises what work raises."""
    # What computes one satellite's place needs none of this.
    import multiprocessing
    from multiprocessing.connection import Connection, wait

    context = multiprocessing.get_context("fork") if fork else multiprocessing.get_context("spawn")
    todo = deque(items)
    given: dict[Connection, deque[Any]] = {}
    started = []
    deaths = 0

    def start() -> None:
        ours, theirs = context.Pipe()
        others = [*given, ours] if fork else []
        process = context.Process(target=_serve, args=(work, theirs, others), daemon=True)
        with warnings.catch_warnings(), nullcontext() if fork else _safe_path():
            # The threads that Python counts here are those of numpy's algebra, which knows of forks.
            warnings.simplefilter("ignore", DeprecationWarning)
            process.start()
        started.append(process)
        theirs.close()
        given[ours] = deque()

    try:
        for _ in range(min(workers, len(items))):
            start()
        for connection in list(given) * _AHEAD:
            _give(connection, given, todo)
        while given:
            for connection in [one for one in wait(list(given)) if isinstance(one, Connection)]:
                try:
                    result = connection.recv()
                except (EOFError, OSError):
                    # At the end of the list: an item that is the death of each process delays no other.
                    todo += given.pop(connection)
                    connection.close()
                    deaths += 1
                    if todo and deaths < _MOST_DEATHS and (_may_fork() or not fork):
                        start()
                        _give(list(given)[-1], given, todo)
                    continue
                deaths = 0
                given[connection].popleft()
                if isinstance(result, Exception):
                    raise result
                _give(connection, given, todo)
                yield result
        while todo:
            yield work(todo.popleft())
    finally:
        for connection in given:
            connection.close()
        for process in started:
            process.terminate()
            process.join()


@contextmanager
def _safe_path() -> Iterator[None]:
    """Let the Pythons that are started meanwhile import nothing from the current folder.

    One is started as `python -c`, and would take a user's `multiprocessing.py` for Python's. It gets this
    process's path before it imports anything else.
    """
    name = "PYTHONSAFEPATH"
    before = os.environ.get(name)
    os.environ[name] = "1"
    try:
        yield
    finally:
        if before is None:
            os.environ.pop(name, None)
        else:
            os.environ[name] = before


def _give(connection: Connection, given: dict[Connection, deque[Any]], todo: deque[Any]) -> None:
    """Hand the next item to a process; one that has nothing left is let go."""
    if todo:
        item = todo.popleft()
        given[connection].append(item)
        try:
            connection.send(item)
        except OSError:
            # It is dead: reading says so, and its items are counted then.
            return
    elif not given[connection]:
        del given[connection]
        connection.close()


def _serve(work: Work, connection: Connection, others: list[Connection]) -> None:
    """Work on the items asked for until the other end is closed."""
    # An interrupt from the keyboard reaches all processes of a terminal: the first of them answers it.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    # What was inherited is not looked through for garbage: that would copy it.
    gc.freeze()
    # Else the parent's end would stay open here, and its death would not be seen.
    for other in others:
        other.close()
    try:
        while True:
            item = connection.recv()
            try:
                result = work(item)
            except Exception as error:  # noqa: BLE001 - it is raised where the work was asked for
                result = error
            connection.send(result)
    except (EOFError, OSError):
        return
