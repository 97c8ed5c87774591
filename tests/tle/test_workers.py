"""Work shared among processes: the same results, whatever happens to the processes."""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import sys
import threading
from functools import partial
from pathlib import Path

import pytest

from tle.workers import mapping, spawned

ITEMS = range(37)
forks = pytest.mark.skipif(sys.platform != "linux", reason="threads share the work elsewhere")


@pytest.fixture
def forked(monkeypatch):
    """Let processes share the work here too, though the test runner may have a thread."""
    monkeypatch.setattr("tle.workers._may_fork", lambda: True)


@forks
def test_results_are_those_of_one(forked):
    for workers in (1, 2, 5, 100):
        with mapping(workers) as mapped:
            assert sorted(mapped(lambda k: k * k, ITEMS)) == [k * k for k in ITEMS]
        with mapping(workers) as mapped:
            assert list(mapped(lambda k: k, ())) == []


@forks
def test_processes_do_the_work_and_end(forked):
    with mapping(3) as mapped:
        places = set(mapped(lambda _: os.getpid(), ITEMS))
    assert os.getpid() not in places
    assert 1 <= len(places) <= 3
    assert multiprocessing.active_children() == []


def test_a_program_with_threads_is_not_copied():
    done = threading.Event()
    other = threading.Thread(target=done.wait)
    other.start()
    try:
        with mapping(2) as mapped:
            assert set(mapped(lambda _: os.getpid(), ITEMS)) == {os.getpid()}
    finally:
        done.set()
        other.join()


@forks
@pytest.mark.parametrize("workers", [1, 2])
def test_what_work_raises_is_raised_here(workers, forked):
    def work(k: int) -> int:
        if k == 20:
            raise ValueError("the twentieth")
        return k

    with mapping(workers) as mapped, pytest.raises(ValueError, match="the twentieth"):
        list(mapped(work, ITEMS))
    assert multiprocessing.active_children() == []


@forks
@pytest.mark.parametrize("fatal", [lambda k: k == 5, lambda _: True], ids=["one dies", "all die"])
def test_work_of_a_process_that_dies_is_done_all_the_same(fatal, forked):
    own = os.getpid()

    def work(k: int) -> int:
        if fatal(k) and os.getpid() != own:
            os.kill(os.getpid(), signal.SIGKILL)
        return k

    with mapping(2) as mapped:
        assert sorted(mapped(work, ITEMS)) == list(ITEMS)


@forks
def test_a_process_killed_in_the_middle_of_a_long_result_is_replaced(forked):
    """It waits to write more than a pipe holds, since nobody reads: what follows its death is cut short."""
    with mapping(2) as mapped:
        results = mapped(lambda k: bytes([k]) * 1_000_000, ITEMS)
        found = [next(results)[0]]
        for child in multiprocessing.active_children():
            while Path(f"/proc/{child.pid}/stat").read_text().rpartition(")")[2].split()[0] != "S":
                pass
            child.kill()
            child.join()
        found += [result[0] for result in results]
    assert sorted(found) == list(ITEMS)


def test_new_processes_share_the_work_and_those_killed_while_they_start_are_replaced(tmp_path):
    results = spawned(partial(_write_pid, tmp_path), ITEMS, 2)
    found = []
    for result in results:
        found.append(result)
        if len(found) in {1, 10}:
            for child in multiprocessing.active_children():
                child.kill()
    assert sorted(found) == list(ITEMS)
    pids = {int(file.name) for file in tmp_path.iterdir()}
    assert 3 <= len(pids) <= 6
    assert os.getpid() not in pids
    assert multiprocessing.active_children() == []


def _write_pid(folder: Path, k: int) -> int:
    (folder / str(os.getpid())).touch()
    return k


@forks
def test_an_iteration_given_up_leaves_no_process(forked):
    with mapping(2) as mapped:
        results = mapped(lambda k: k, ITEMS)
        next(results)
        results.close()
    assert multiprocessing.active_children() == []


@forks
@pytest.mark.parametrize("end", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
def test_processes_end_with_their_parent(end):
    """Each holds the writing end of this test's pipe: it is at its end when the last of them is gone."""
    program = (
        "import signal, sys\n"
        "from tle.workers import mapping\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "with mapping(2) as mapped:\n"
        "    for k, _ in enumerate(mapped(lambda k: sum(range(20_000)), range(10**6))):\n"
        "        if k == 20:\n"
        "            print('works', flush=True)\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", program], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
    ) as parent:
        assert parent.stdout is not None
        assert parent.stdout.readline() == b"works\n"
        parent.send_signal(end)
        assert parent.stdout.read() == b""


HOSTILE = "open('executed', 'a').write(__name__)\n"
WORKING = """
import os

from tle.workers import spawned

if __name__ == "__main__":
    before = dict(os.environ)
    print(sorted(spawned(abs, [-3, -2, -1], 2)), os.environ == before)
"""


@pytest.mark.parametrize("safe_path", [None, "", "1"], ids=["unset", "empty", "set"])
def test_new_processes_take_no_module_from_the_current_folder(tmp_path, safe_path):
    """As an installed program is run: its own folder is on Python's path, the current one is not."""
    here, there = tmp_path / "here", tmp_path / "there"
    here.mkdir()
    there.mkdir()
    (there / "program.py").write_text(WORKING)
    for name in ("multiprocessing", "signal", "selectors"):
        (here / f"{name}.py").write_text(HOSTILE)
    known = {name: value for name, value in os.environ.items() if name != "PYTHONSAFEPATH"}
    done = subprocess.run(
        [sys.executable, there / "program.py"],
        cwd=here,
        env={**known, **({} if safe_path is None else {"PYTHONSAFEPATH": safe_path})},
        capture_output=True,
        text=True,
        check=False,
    )
    assert not (here / "executed").exists()
    assert done.stdout == "[1, 2, 3] True\n", done.stderr
