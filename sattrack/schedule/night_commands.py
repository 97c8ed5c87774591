"""Programs, addresses and weather sources that a schedule names: asked with a time limit, never longer.

Weather that cannot be asked about, or is not answered as it should be, is unsafe.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import threading
import time
import urllib.error
import urllib.request
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple
from urllib.parse import urlsplit

from sattrack.mount.alpaca.client import AlpacaDevice, AlpacaRefusalError, NoAnswerError
from tle.errors import printable
from tle.instants import Utc

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from sattrack.schedule.night import NightPass, Result
    from sattrack.schedule.schema import Notify, Weather


KILL_AFTER_S = 2.0
MOST_WORDS = 160
PREFIX = "SATTRACK_"
MOST_BYTES = 4096
"""Of an answer about the weather."""


def facts_of(one: NightPass, schedule: str, when: str, result: Result | None = None) -> dict[str, Any]:
    """Return the facts of a pass for a program or an address; names carry units."""
    facts: dict[str, Any] = {
        "schedule": schedule,
        "when": when,
        "number": one.number,
        "name": one.elements.name,
        "catalog_number": one.elements.catalog_number,
        "start_utc": Utc(one.start_utc_s).isoformat("milliseconds"),
        "culminate_utc": Utc(one.culminate_utc_s).isoformat("milliseconds"),
        "end_utc": Utc(one.end_utc_s).isoformat("milliseconds"),
        "max_alt_deg": one.max_alt_deg,
        "priority": one.priority,
    }
    if result is not None:
        facts |= {
            "result": result.state,
            "cause": result.cause,
            "words": result.words,
            "on_target_s": result.on_target_s,
            "rms_arcsec": result.rms_arcsec,
            "recordings": list(result.recordings),
        }
    return facts


def as_environment(facts: dict[str, Any]) -> dict[str, str]:
    """Return facts as variables: `SATTRACK_START_UTC` for `start_utc`; several recordings by colons."""
    found = {}
    for name, value in facts.items():
        words = ":".join(value) if isinstance(value, list) else "" if value is None else str(value)
        # No program can be given a NUL.
        found[PREFIX + name.upper()] = words.replace("\0", "")
    return found


def run_program(
    run: Sequence[str], timeout_s: float, folder: Path, facts: dict[str, Any], given: str | None = None
) -> str | None:
    """Run a program to its end, `timeout_s` at most, in a folder; return what went wrong, None where nothing.

    It and all that it started are ended where they take longer. `given` is written to its standard input.
    """
    try:
        process = subprocess.Popen(
            list(run),
            cwd=folder,
            env={**os.environ, **as_environment(facts)},
            stdin=subprocess.DEVNULL if given is None else subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
    except (OSError, ValueError) as error:
        return f"cannot be run: {getattr(error, 'strerror', None) or error}"
    try:
        process.communicate(None if given is None else given.encode(), timeout=timeout_s)
    except subprocess.TimeoutExpired:
        _end(process)
        return f"not done within {timeout_s:g} s, ended"
    if process.returncode < 0:
        return f"ended by signal {-process.returncode}"
    return None if process.returncode == 0 else f"ended with {process.returncode}"


def _end(process: subprocess.Popen[bytes]) -> None:
    for number in (signal.SIGTERM, signal.SIGKILL):
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(process.pid, number)
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(KILL_AFTER_S)
            if number == signal.SIGTERM:
                continue
            return


def post(url: str, facts: dict[str, Any], timeout_s: float) -> str | None:
    """Post facts as JSON to an address; return what went wrong, None where nothing."""
    request = urllib.request.Request(
        url, json.dumps(facts).encode(), {"Content-Type": "application/json"}, method="POST"
    )
    try:
        with urllib.request.urlopen(request, timeout=timeout_s) as answer:
            answer.read(1)
    except urllib.error.HTTPError as error:
        error.close()
        return f"answered {error.code}"
    except (OSError, ValueError) as error:
        reason = getattr(error, "reason", None) or error
        return f"cannot be posted to: {printable(str(reason))[:MOST_WORDS]}"
    return None


class BackgroundTasks:
    """Tasks beside the run for which nobody waits; `complaints` is called later with what went wrong."""

    def __init__(self, complaints: Callable[[str], None]) -> None:
        """Take what is called with what went wrong."""
        self._complaints = complaints
        self._threads: list[threading.Thread] = []

    def begin(self, words: str, task: Callable[[], str | None]) -> None:
        """Begin a task in a thread of its own."""

        def run() -> None:
            wrong = task()
            if wrong is not None:
                self._complaints(f"{words}: {wrong}")

        self._threads = [thread for thread in self._threads if thread.is_alive()]
        thread = threading.Thread(target=run, name="task", daemon=True)
        self._threads.append(thread)
        thread.start()

    def finish(self, within_s: float) -> None:
        """Wait for tasks that are under way, so long at most: the process is about to end."""
        until_s = time.monotonic() + within_s
        for thread in self._threads:
            thread.join(max(0.0, until_s - time.monotonic()))


class Notifier:
    """Tells whoever the schedule names of what happens."""

    def __init__(self, notify: Sequence[Notify], folder: Path, tasks: BackgroundTasks) -> None:
        """Take whom to tell, and where programs run."""
        self._notify, self._folder, self._tasks = notify, folder, tasks

    def tell(self, notice: str, words: str, facts: dict[str, Any]) -> None:
        """Tell of something, without waiting; programs have it in their environment and on standard input."""
        facts = {"notice": notice, "message": words, **facts}
        for one in self._notify:
            if notice not in one.on:
                continue
            if one.run is not None:
                program = partial(run_program, one.run, one.timeout_s, self._folder, facts, words + "\n")
                self._tasks.begin(f"notify by {one.run[0]}", program)
            elif one.url is not None:
                self._tasks.begin("notify by its address", partial(post, one.url, facts, one.timeout_s))


class WeatherReport(NamedTuple):
    """Whether it is safe, and why not."""

    safe: bool
    words: str | None = None


def ask_weather(weather: Weather, folder: Path) -> WeatherReport:
    """Ask, within the time that the schedule gives for an answer; programs run in `folder`."""
    if weather.file is not None:
        return _by_file(Path(weather.file), weather.oldest_s)
    if weather.command is not None:
        words = run_program(weather.command, weather.timeout_s, folder, {})
        return WeatherReport(words is None, None if words is None else f"{weather.command[0]}: {words}")
    return _by_alpaca(str(weather.alpaca), weather.timeout_s)


def _by_file(path: Path, oldest_s: float) -> WeatherReport:
    try:
        age_s = time.time() - path.stat().st_mtime
        with path.open("rb") as file:
            said = file.read(MOST_BYTES).decode("utf-8", errors="replace").split()
    except OSError as error:
        return WeatherReport(False, f"{path}: {error.strerror}")
    if age_s > oldest_s:
        return WeatherReport(False, f"{path} was last written {age_s:.0f} s ago, {oldest_s:g} s are allowed")
    word = said[0].casefold() if said else ""
    if word == "safe":
        return WeatherReport(True)
    if word == "unsafe":
        return WeatherReport(False, printable(" ".join(said[1:]))[:200] or "unsafe")
    return WeatherReport(
        False, f"{path} says {printable(word)[:40]!r}: its first word must be safe or unsafe"
    )


def _by_alpaca(address: str, timeout_s: float) -> WeatherReport:
    parts = urlsplit(address)
    monitor = AlpacaDevice(parts.netloc, "safetymonitor", int(parts.path[1:]), timeout_s)
    try:
        safe = monitor.get("issafe")
    except (AlpacaRefusalError, NoAnswerError) as error:
        return WeatherReport(False, f"{address}, issafe: {printable(str(error))}")
    if not isinstance(safe, bool):
        return WeatherReport(False, f"{address} gave no Value that is true or false")
    return WeatherReport(safe, None if safe else "the SafetyMonitor says unsafe")


class WeatherWatch:
    """Asks again and again in a thread of its own; `unsafe` says why, once it is."""

    def __init__(self, weather: Weather, folder: Path) -> None:
        """Begin to ask."""
        self.unsafe: str | None = None
        self._weather, self._folder = weather, folder
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._ask, name="weather", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Ask no more."""
        self._over.set()

    def _ask(self) -> None:
        while not self._over.wait(self._weather.every_s):
            answer = ask_weather(self._weather, self._folder)
            if not answer.safe:
                self.unsafe = answer.words or "unsafe"
                return
