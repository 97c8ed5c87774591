"""What a loop asks of the system, granted or refused: as the kernel tells it, and undone afterwards."""

from __future__ import annotations

import gc
import json
import os
import re
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from sattrack.cli.output import JsonLines
from sattrack.core.realtime import PRIORITY, how_to_grant, undisturbed, wanted
from sattrack.recording.format import Recording
from sattrack.recording.replay import replay
from sattrack.runtime import system
from sattrack.runtime.facts import build_engine, decode_facts

if TYPE_CHECKING:
    from collections.abc import Iterator

NEVER_IN_THE_FEEDER = ("textual", "rich", "matplotlib", "asyncio", "aiohttp", "skyfield")

linux = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="Linux alone is asked")


def locked_kib() -> int:
    """Locked memory of this process, as the kernel counts it."""
    found = re.search(r"^VmLck:\s+(\d+) kB", Path("/proc/self/status").read_text(), re.MULTILINE)
    assert found is not None
    return int(found[1])


def policy_elsewhere() -> tuple[int, int]:
    """The scheduling of a thread and of a process begun here and now."""
    policies: list[int] = []
    thread = threading.Thread(target=lambda: policies.append(os.sched_getscheduler(0)))
    thread.start()
    thread.join()
    code = "import os; print(os.sched_getscheduler(0))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return policies[0], int(done.stdout)


@linux
def test_what_is_said_to_be_granted_is_in_force_for_this_thread_alone_and_given_back() -> None:
    with undisturbed(ask=True) as grant:
        policy = os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK
        assert (policy == os.SCHED_FIFO) is grant.realtime
        assert os.sched_getparam(0).sched_priority == (PRIORITY if grant.realtime else 0)
        assert (locked_kib() > 0) is grant.memory_locked
        assert policy_elsewhere() == (os.SCHED_OTHER, os.SCHED_OTHER)
        assert bool(grant.refusals) is not (grant.realtime and grant.memory_locked)
    assert os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK == os.SCHED_OTHER
    assert locked_kib() == 0


@linux
def test_where_all_is_refused_the_run_goes_on_and_says_what_it_lacks() -> None:
    code = """
import os, resource
from sattrack.core.realtime import undisturbed
for limit in (resource.RLIMIT_RTPRIO, resource.RLIMIT_MEMLOCK):
    resource.setrlimit(limit, (0, 0))
if os.geteuid() == 0:
    os.setresuid(65534, 65534, 65534)
with undisturbed(ask=True) as grant:
    assert os.sched_getscheduler(0) == os.SCHED_OTHER
    print(grant.realtime, grant.memory_locked)
    print(*grant.refusals, sep="\\n")
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    granted, *refusals = done.stdout.splitlines()
    assert granted == "False False"
    assert [words.partition(":")[0] for words in refusals] == [
        "memory is not locked",
        "no real-time priority",
    ]


@linux
def test_nothing_is_asked_for_where_it_is_not_wanted() -> None:
    before = os.sched_getscheduler(0)
    with undisturbed(ask=False) as grant:
        assert os.sched_getscheduler(0) == before
        assert locked_kib() == 0
    assert not grant.realtime
    assert grant.refusals == ("not asked for: SATTRACK_REALTIME=0",)


@pytest.mark.parametrize(("value", "asked"), [(None, True), ("1", True), ("", True), ("0", False)])
def test_the_environment_can_forbid_to_ask(value: str | None, asked: bool) -> None:
    assert wanted({} if value is None else {"SATTRACK_REALTIME": value}) is asked


@pytest.fixture(params=[False, True])
def frozen(request: pytest.FixtureRequest) -> Iterator[bool]:
    """Whether objects are frozen before a test; after it, those of the collection of tests are again."""
    gc.unfreeze()
    if request.param:
        gc.freeze()
    yield request.param
    gc.freeze()


def test_no_garbage_is_collected_meanwhile_and_all_is_as_before_afterwards(frozen: bool) -> None:
    switch_s = sys.getswitchinterval()
    with undisturbed(ask=False):
        assert not gc.isenabled()
        assert gc.get_freeze_count() > 0
        assert sys.getswitchinterval() < switch_s
    assert gc.isenabled()
    assert (gc.get_freeze_count() > 0) is frozen
    assert sys.getswitchinterval() == switch_s


def test_an_error_gives_everything_back_too() -> None:
    def break_in_the_middle() -> None:
        with undisturbed():
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        break_in_the_middle()
    assert gc.isenabled()
    if sys.platform.startswith("linux"):
        assert os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK == os.SCHED_OTHER


def test_every_way_to_grant_it_is_told() -> None:
    ways = "\n".join(how_to_grant("ada"))
    for word in (
        "ada - rtprio",
        "ada - memlock",
        "prlimit",
        "LimitRTPRIO=",
        "AmbientCapabilities=",
        "setcap",
    ):
        assert word in ways


def test_a_run_is_light_says_that_it_has_no_priority_and_runs_again_to_the_same_bytes(
    tmp_path: Path,
) -> None:
    path = tmp_path / "run.mcap"
    code = f"""
import sys
from sattrack.cli.main import run
run(["demo", "--headless", "--json", "--seconds", "5", "--record", {str(path)!r}])
print([name for name in {NEVER_IN_THE_FEEDER!r} if name in sys.modules])
"""
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "SATTRACK_REALTIME": "0"},
    )
    summary, heavy = done.stdout.splitlines()
    assert json.loads(summary)["summary"]["realtime_priority"] is False
    assert heavy == "[]"
    again = replay(Recording(path), lambda spec: build_engine(decode_facts(spec)))
    assert again.divergence is None
    assert again.ticks > 20


def test_json_lines_into_a_full_pipe_do_not_wait(monkeypatch: pytest.MonkeyPatch) -> None:
    """Were the pipe a blocking one, this would never end."""
    reading, writing = os.pipe()
    with os.fdopen(reading, "rb") as reader, os.fdopen(writing, "w") as writer:
        monkeypatch.setattr(sys, "stdout", writer)
        lines = JsonLines()
        for number in range(20_000):
            lines.write({"number": number})
        os.set_blocking(reading, False)
        read = reader.read(1 << 20)
    assert read is not None
    whole = read.splitlines()
    assert 0 < len(whole) < 20_000
    assert [json.loads(line)["number"] for line in whole] == list(range(len(whole)))


def test_of_a_line_that_a_pipe_took_in_part_the_rest_follows(monkeypatch: pytest.MonkeyPatch) -> None:
    """Views of a run that many watch are longer than the 4096 bytes that a pipe takes whole or not at all."""
    reading, writing = os.pipe()
    with os.fdopen(reading, "rb", 0) as reader, os.fdopen(writing, "w") as writer:
        monkeypatch.setattr(sys, "stdout", writer)
        lines, read = JsonLines(), b""
        os.set_blocking(reading, False)
        for first in (0, 100, 200):
            for number in range(first, first + 100):
                lines.write({"number": number, "watching": "x" * 5000})
            read += reader.read(1 << 20) or b""
        lines.end()
        writer.write('{"number": "summary"}\n')
        writer.flush()
        read += reader.read(1 << 20) or b""
    numbers = [json.loads(line)["number"] for line in read.splitlines()]
    assert numbers.pop() == "summary"
    assert {0, 100, 200} < set(numbers)
    assert numbers == sorted(numbers)
    assert len(numbers) < 100


@linux
def test_the_kernel_s_account_of_its_clock_is_read_at_the_right_places() -> None:
    """A tick is 10 ms and may be set to within a tenth of that (adjtimex(2)); the time is the time."""
    before_s = time.time()
    timex = system.read_timex()
    assert timex is not None
    assert int(before_s) <= timex[system.TIME] <= time.time()
    assert 9000 <= timex[system.TICK] <= 11000
    clock = system.read_kernel_clock()
    assert clock is not None
    assert clock.synchronised is not bool(timex[system.STATUS] & 0x40)
    assert clock.largest_error_s >= 0.0
