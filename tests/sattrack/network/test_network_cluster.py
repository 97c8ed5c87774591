"""`network passes --cluster` with real schedulers and workers of Dask, on loopback: each of them may die."""

from __future__ import annotations

import json
import logging
import signal
import socket
import subprocess
import sys
import time
from contextlib import ExitStack, contextmanager, suppress
from importlib.util import find_spec
from typing import TYPE_CHECKING

import pytest
from network_builders import START, contents, written
from programs import free_port

from sattrack import __version__
from sattrack.cli.main import run

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

pytest.importorskip("pyarrow")
# Looked for, and not imported: each worker of the suite collects this module, and one runs it.
if find_spec("distributed") is None:
    pytest.skip("distributed is not installed", allow_module_level=True)
WAIT_S = 60.0
LOOK_EVERY_S = 0.02
OTHER_VERSION = "import sattrack; sattrack.__version__ = '0.0.1'; "


@contextmanager
def program(code: str, *words: str) -> Iterator[subprocess.Popen[str]]:
    """Run Python code as a program with arguments; it ends with the test."""
    with subprocess.Popen(
        [sys.executable, "-c", code, *words], stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True
    ) as started:
        try:
            yield started
        finally:
            started.kill()


def ends_within(started: subprocess.Popen[str], seconds: float) -> bool:
    """Wait for a program to end; tell whether it has."""
    with suppress(subprocess.TimeoutExpired):
        started.wait(seconds)
        return True
    return False


@contextmanager
def scheduler(port: int) -> Iterator[subprocess.Popen[str]]:
    with program(
        "from distributed.cli.dask_scheduler import main; main()",
        *("--host", "127.0.0.1", "--port", str(port), "--no-dashboard", "--no-show"),
    ) as started:
        until_s = time.monotonic() + WAIT_S
        while time.monotonic() < until_s:
            try:
                socket.create_connection(("127.0.0.1", port), 1.0).close()
                break
            except OSError:
                assert not ends_within(started, LOOK_EVERY_S)
        yield started


def worker(port: int, before: str = "") -> ExitStack:
    """Start a worker without a nanny, which nobody replaces when it is killed."""
    stack = ExitStack()
    started = stack.enter_context(
        program(
            f"{before}from distributed.cli.dask_worker import main; main()",
            *(f"tcp://127.0.0.1:{port}", "--no-nanny", "--nthreads", "1", "--no-dashboard"),
        )
    )
    stack.process = started  # type: ignore[attr-defined]
    return stack


def command(folder: Path, out: Path, *more: str) -> list[str]:
    elements, stations = folder / "made_up.tle", folder / "stations.toml"
    where = ["--stations", str(stations), "--elements", str(elements), "--out", str(out)]
    return ["network", "passes", *where, "--from", START, "--hours", "96", *more]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("cluster")
    written(folder, low=200)
    assert run(command(folder, folder / "made")) == 0
    return folder


def wait_until(reached: Callable[[], object], started: subprocess.Popen[str]) -> None:
    until_s = time.monotonic() + WAIT_S
    while not reached():
        assert time.monotonic() < until_s
        assert not ends_within(started, LOOK_EVERY_S)


def test_the_files_are_the_same_on_a_cluster_of_which_a_worker_is_killed(
    folder: Path, tmp_path: Path
) -> None:
    port, out = free_port(), tmp_path / "out"
    words = command(folder, out, "--cluster", f"tcp://127.0.0.1:{port}")
    with ExitStack() as stack:
        stack.enter_context(scheduler(port))
        doomed = stack.enter_context(worker(port))
        stack.enter_context(worker(port))
        begun = stack.enter_context(program("from sattrack.cli.main import main; main()", *words))
        wait_until(lambda: list(out.rglob("passes.parquet")), begun)
        doomed.process.send_signal(signal.SIGKILL)  # type: ignore[attr-defined]
        assert begun.wait(WAIT_S) == 0
    assert contents(out) == contents(folder / "made")


@pytest.mark.soak
def test_worker_and_scheduler_and_client_may_each_be_killed(folder: Path, tmp_path: Path) -> None:
    port, out = free_port(), tmp_path / "out"
    words = command(folder, out, "--cluster", f"tcp://127.0.0.1:{port}", "--json")
    client = "from sattrack.cli.main import main; main()"

    def finished() -> int:
        return len(list(out.rglob("passes.parquet")))

    with ExitStack() as stack:
        first = stack.enter_context(scheduler(port))
        doomed = stack.enter_context(worker(port))
        other = stack.enter_context(worker(port))
        begun = stack.enter_context(program(client, *words))
        wait_until(lambda: finished() >= 1, begun)
        doomed.process.send_signal(signal.SIGKILL)  # type: ignore[attr-defined]
        wait_until(lambda: finished() >= 2, begun)
        first.send_signal(signal.SIGKILL)
        other.process.send_signal(signal.SIGKILL)  # type: ignore[attr-defined]
        first.wait()
        stack.enter_context(scheduler(port))
        stack.enter_context(worker(port))
        before = finished()
        if before < 10:
            wait_until(lambda: finished() > before, begun)
        begun.send_signal(signal.SIGKILL)
        begun.wait()
        there = finished()
        answer = subprocess.run(
            [sys.executable, "-c", client, *words], capture_output=True, timeout=WAIT_S, check=True
        )
        totals = json.loads(answer.stdout)
    assert there - 1 <= totals["resumed"] <= there
    assert totals["partitions"] == 10
    assert contents(out) == contents(folder / "made")


def test_a_worker_of_another_version_is_refused_and_both_are_named(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    port = free_port()
    with scheduler(port), worker(port, OTHER_VERSION):
        assert run(command(folder, tmp_path / "out", "--cluster", f"tcp://127.0.0.1:{port}")) == 1
    told = capsys.readouterr().err.splitlines()
    assert f"has sattrack 0.0.1, this computer has {__version__}" in told[-1]
    assert not list((tmp_path / "out").rglob("*.parquet"))


@pytest.mark.parametrize(
    "address", ["tcp://127.0.0.1:{}", pytest.param("tcp://no.such.host.invalid:{}", marks=pytest.mark.soak)]
)
def test_an_unreachable_scheduler_is_one_line_within_seconds(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], address: str
) -> None:
    began_s = time.monotonic()
    assert run(command(folder, tmp_path / "out", "--cluster", address.format(free_port()))) == 1
    assert time.monotonic() - began_s < 20.0
    told = capsys.readouterr().err
    assert told.startswith("sattrack: no Dask scheduler answers at tcp://")
    assert told.count("\n") == 1


@pytest.mark.parametrize("address", ["10.0.0.2", "tcp://host", "http://host:8786", "tcp://:1"])
def test_what_is_no_address_is_refused(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], address: str
) -> None:
    assert run(command(folder, tmp_path / "out", "--cluster", address)) == 2
    assert "is no address of a scheduler: write tcp://HOST:8786" in capsys.readouterr().err


def test_workers_and_cluster_do_not_go_together(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = command(folder, tmp_path / "out", "--cluster", "tcp://127.0.0.1:1", "--workers", "2")
    assert run(words) == 2
    assert "give --workers or --cluster, not both" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_dask_logs_no_lost_connection_beside_our_line() -> None:
    from sattrack.network.cluster import DaskCluster

    DaskCluster("tcp://127.0.0.1:1", print)
    assert not logging.getLogger("distributed.client").isEnabledFor(logging.ERROR)
    assert not logging.getLogger("distributed.core").isEnabledFor(logging.ERROR)
