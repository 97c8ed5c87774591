"""Real programs that tests drive; and tests are collected without Python's collector of cycles.

A test that needs one is marked `needs("rotctl")`, or asks the fixture `program` for it; "luac|luac5.4" takes
either. Where it is not installed the test is skipped; where SATTRACK_REAL_PROGRAMS is "required" it fails.
"""

from __future__ import annotations

import gc
import os
import shutil
import signal
import sys
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import settings

if TYPE_CHECKING:
    from collections.abc import Callable, Generator, Iterator

# The same inputs at each run: a verdict is about the code. `--hypothesis-profile default` draws others.
settings.register_profile("same", derandomize=True)
settings.load_profile("same")

# Tests and programs stay compiled, whatever is set: to do it anew is two thirds of each worker's collection,
# and half of what it takes to start a program.
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

# Each worker, and each program that it starts, has one thread for linear algebra: of more, on a machine that
# is busy anyway, each spins while it waits for the other. Read when numpy is loaded.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

REQUIRED = os.environ.get("SATTRACK_REAL_PROGRAMS") == "required"


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, Any, Any]:
    """Look for cycles once, after the collection, and never again among what it made.

    It makes hundreds of thousands of objects that all stay: to look through them took a third of its time,
    and a quarter of a second at each `gc.collect` of a test.
    """
    gc.disable()
    try:
        return (yield)
    finally:
        gc.enable()
        gc.collect()
        gc.freeze()


def path_of(names: str) -> str:
    """Return where the first of some programs is that is installed."""
    for name in names.split("|"):
        found = shutil.which(name)
        if found is not None:
            return found
    missing = f"not installed: {' or '.join(names.split('|'))}"
    if REQUIRED:
        pytest.fail(f"{missing}, and SATTRACK_REAL_PROGRAMS says that it must be", pytrace=False)
    pytest.skip(missing)


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skip, or fail, tests whose programs are not there."""
    for mark in item.iter_markers("needs"):
        for names in mark.args:
            path_of(names)


@pytest.fixture(scope="session")
def program() -> Callable[[str], str]:
    """Return a function that tells where a program is, and skips or fails the test where it is not there."""
    return path_of


@pytest.fixture
def hang_ups() -> Iterator[None]:
    """Let hang-ups have their usual effect, also where the suite was begun by nohup."""
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    yield
    signal.signal(signal.SIGHUP, before)
