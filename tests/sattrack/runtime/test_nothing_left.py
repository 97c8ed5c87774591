"""However a program ends, its mount comes to rest, and no process, socket or file of it is left."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from guardian import is_guardian
from programs import PATIENCE_S, ended, sattrack, stranger
from soak import (
    CTRL_C,
    FIRST_NUMBER,
    Held,
    Place,
    RotctldClient,
    Sample,
    Server,
    Soak,
    Terminal,
    end_all,
    growth,
    processes_of,
    rows_of,
    wait_until,
)

from sattrack.runtime.mounts import owner_of
from tle.instants import Utc

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from programs import Mount

pytestmark = pytest.mark.skipif(
    not Path("/proc/self/environ").exists(), reason="the kernel tells it in /proc"
)
SOAK_S, ATTACH_EVERY_S = 45.0, 40.0
GROSSLY_MB = 11.0
"""Within that: caches may fill, a leak a second does not stay below."""
FAST_DEG_S = 0.5
ENDS_AFTER_S = 12.0
"""Some seconds after it has begun to follow; on a machine that is very slow, before that."""
IN_PROGRESS = f"""
park_at_end = false
[[passes]]
satellite = "{FIRST_NUMBER}"
shorten = true
if_sun_up = "run"
if_infeasible = "run"
"""
DEFECT = """
import os, sys
from pathlib import Path
from sattrack.control.engine import Engine
tick = Engine.tick
def broken(self, now_utc_s):
    if Path(os.environ["BREAKS_IF"]).exists():
        raise ZeroDivisionError("a defect")
    return tick(self, now_utc_s)
Engine.tick = broken
from sattrack.cli.main import main
sys.exit(main())
"""


def test_nothing_grows_and_nothing_is_left_with_everything_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("soak.ATTACH_EVERY_S", ATTACH_EVERY_S)
    soak = Soak(SOAK_S, 0.5, tmp_path)
    soak.run()
    assert soak.wrong == []
    assert growth(soak.samples, GROSSLY_MB) == []
    names = {row.name for row in rows_of(soak.samples)}
    assert {"track", "track: track", "serve", "serve: servers.alpaca", "run", "run: track"} <= names
    for what in ("alpaca", "rotctld", "orders by Alpaca", "orders by rotctld", "attached", "keys"):
        assert soak.counts[what] > 0, what


def test_a_process_that_stays_is_growth_and_those_that_follow_one_another_are_none() -> None:
    held = Held(descriptors=5, threads=1, resident_mb=20.0)
    for left_s, words in ((20.0, ["lasting processes 1 → 2"]), (999.0, [])):
        samples = []
        for at_s in range(61):
            # From the middle on two of those overlap at any time.
            passing = {("pass", 100 + (at_s + back) // 5): held for back in (0, 3)[: 1 + (at_s > 30)]}
            left = {("left", 2): held} if at_s >= left_s else {}
            samples.append(Sample(float(at_s), {("run", 1): held, **passing, **left}, 0))
        assert growth(samples) == words


class Case:
    """One program with a mount of its own, in a folder of its own."""

    def __init__(self, folder: Path, stack: ExitStack) -> None:
        self.place, self.stack = Place(folder), stack
        stack.callback(end_all, folder)
        self.mount: Mount = stack.enter_context(stranger(self.place.site, "--truth"))

    def start(self, *arguments: str, **more: Any) -> subprocess.Popen[str]:
        quiet = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.DEVNULL)
        own = {"env": self.place.environment, "start_new_session": True}
        return self.stack.enter_context(ended(sattrack(*arguments, **(quiet | own | more))))

    def on_terminal(self, *arguments: str) -> Terminal:
        terminal = Terminal(*arguments, env=self.place.environment)
        self.stack.callback(terminal.end)
        return terminal

    def wait_until_fast(self) -> None:
        self.mount.wait_until_faster(FAST_DEG_S)
        assert processes_of(self.place.folder), "there is nothing to count"

    def left(self, process: subprocess.Popen[Any]) -> list[str]:
        """Wait for the end; return what is left of it."""
        process.wait(PATIENCE_S)
        left = self.place.left()
        if not self.mount.ended:
            self.mount.wait_until_moving(False)
        owner = owner_of(f"127.0.0.1:{self.mount.port}")
        return left if owner is None else [*left, str(owner)]


@contextmanager
def case(folder: Path) -> Iterator[Case]:
    with ExitStack() as stack:
        yield Case(folder, stack)


def headless(case: Case, *options: str) -> subprocess.Popen[str]:
    process = case.start(*case.place.track(case.mount.url, "--headless", *options))
    case.wait_until_fast()
    return process


def struck(process: subprocess.Popen[Any], number: signal.Signals) -> subprocess.Popen[Any]:
    process.send_signal(number)
    return process


def ended_by_itself(case: Case) -> subprocess.Popen[str]:
    to = Utc(time.time() + ENDS_AFTER_S).isoformat("seconds")
    return case.start(*case.place.track(case.mount.url, "--headless", "--to", to))


def stopped(case: Case, process: subprocess.Popen[Any]) -> subprocess.Popen[Any]:
    """Stop the mount from another process."""
    stop = case.start("stop", "--mount", case.mount.url)
    assert stop.wait(PATIENCE_S) == 0
    return process


def gone(case: Case, process: subprocess.Popen[Any]) -> subprocess.Popen[Any]:
    """Let the mount be gone; the one process that stays is the guardian, until somebody gives up."""
    case.mount.end()
    process.wait(PATIENCE_S)
    (guardian,) = processes_of(case.place.folder)
    assert is_guardian(guardian)
    give_up = case.start("stop", "--mount", case.mount.url, "--give-up")
    assert give_up.wait(PATIENCE_S) == 0
    return process


def with_defect(case: Case) -> subprocess.Popen[Any]:
    breaks = case.place.folder / "breaks"
    words = [sys.executable, "-c", DEFECT, *case.place.track(case.mount.url, "--headless")]
    quiet = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.DEVNULL)
    environment = {**case.place.environment, "BREAKS_IF": str(breaks)}
    process = case.stack.enter_context(ended(subprocess.Popen(words, env=environment, text=True, **quiet)))
    case.wait_until_fast()
    breaks.touch()
    return process


def with_a_mount_of_its_own(case: Case) -> subprocess.Popen[Any]:
    """Kill a run whose simulated mount is a child of its own."""
    process = case.start(*case.place.track("sim", "--headless"))
    assert wait_until(lambda: len(processes_of(case.place.folder)) > 2)
    return struck(process, signal.SIGKILL)


def screen(case: Case) -> Terminal:
    terminal = case.on_terminal(*case.place.track(case.mount.url))
    case.wait_until_fast()
    terminal.wait_for(b"SLEWING")
    return terminal


def pressed(terminal: Terminal, keys: bytes) -> subprocess.Popen[Any]:
    terminal.press(keys)
    return terminal.process


def left_by_question(case: Case, answer: bytes) -> subprocess.Popen[Any]:
    terminal = screen(case)
    terminal.press(b"q")
    terminal.wait_for(b"leave?")
    return pressed(terminal, answer)


def hung_up(terminal: Terminal) -> subprocess.Popen[Any]:
    terminal.hang_up()
    return terminal.process


def left_running(case: Case) -> subprocess.Popen[Any]:
    """Leave the screen with the run going on, and stop the mount from elsewhere."""
    process = left_by_question(case, b"l")
    process.wait(PATIENCE_S)
    assert processes_of(case.place.folder)
    return stopped(case, process)


def server(case: Case) -> subprocess.Popen[Any]:
    served = Server(case.place, case.mount.url)
    case.stack.enter_context(ended(served.process))
    client = RotctldClient(served.rotctld_port)
    case.stack.callback(client.close)
    azimuth, _ = client.first_position()
    assert client.command(f"P {azimuth:.1f} 20")
    case.wait_until_fast()
    return served.process


def night(case: Case) -> tuple[str, ...]:
    (case.place.folder / "night.toml").write_text(IN_PROGRESS)
    return case.place.run(case.mount.url)


def runner(case: Case) -> subprocess.Popen[Any]:
    process = case.start(*night(case))
    case.wait_until_fast()
    return process


def runner_on_terminal(case: Case) -> Terminal:
    terminal = case.on_terminal(*night(case))
    case.wait_until_fast()
    return terminal


INTERRUPT, TERMINATE, HANG_UP, KILL = signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGKILL
ALIKE = "signals handled alike"
"""A screen handles these as it does a closed terminal, other programs as they do SIGTERM."""
ENDS: dict[str, dict[str, Callable[[Case], subprocess.Popen[Any]]]] = {
    "track": {
        "its own end": ended_by_itself,
        "SIGTERM": lambda case: struck(headless(case), TERMINATE),
        "SIGKILL": lambda case: struck(headless(case), KILL),
        "stop": lambda case: stopped(case, headless(case)),
        "a mount that is gone": lambda case: gone(case, headless(case)),
        "a defect": with_defect,
        "SIGKILL, with a simulated mount": with_a_mount_of_its_own,
    },
    "screen": {
        "q": lambda case: left_by_question(case, b"s"),
        "Ctrl-C": lambda case: pressed(screen(case), CTRL_C),
        "a closed terminal": lambda case: hung_up(screen(case)),
        "SIGKILL": lambda case: struck(screen(case).process, KILL),
        "left running": left_running,
    },
    "serve": {
        "SIGTERM": lambda case: struck(server(case), TERMINATE),
        "SIGKILL": lambda case: struck(server(case), KILL),
        "stop": lambda case: stopped(case, server(case)),
    },
    "run": {
        "SIGTERM": lambda case: struck(runner(case), TERMINATE),
        "a closed terminal": lambda case: hung_up(runner_on_terminal(case)),
        "SIGKILL": lambda case: struck(runner(case), KILL),
        "stop": lambda case: stopped(case, runner(case)),
    },
    ALIKE: {
        "track, SIGHUP": lambda case: struck(headless(case), HANG_UP),
        "screen, SIGTERM": lambda case: struck(screen(case).process, TERMINATE),
        "screen, SIGINT": lambda case: struck(screen(case).process, INTERRUPT),
        "serve, SIGHUP": lambda case: struck(server(case), HANG_UP),
    },
}


@pytest.mark.usefixtures("hang_ups")
@pytest.mark.parametrize(
    "program",
    [pytest.param(name, marks=[pytest.mark.soak] * (name == ALIKE)) for name in ENDS],
)
def test_no_process_and_no_file_is_left_after_any_kind_of_end(program: str, tmp_path: Path) -> None:
    """Servers and runners end by Ctrl-C in the test above."""

    def left(number: int, end: Callable[[Case], subprocess.Popen[Any]]) -> list[str]:
        with case(tmp_path / str(number)) as one:
            return one.left(end(one))

    ends = ENDS[program]
    with ThreadPoolExecutor(len(ends)) as at_once:
        found = dict(zip(ends, at_once.map(left, range(len(ends)), ends.values()), strict=True))
    assert {how: what for how, what in found.items() if what} == {}
