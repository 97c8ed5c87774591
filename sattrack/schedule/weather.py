"""The weather, as a schedule's source tells it: what cannot be asked, or answers wrongly, is unsafe."""

from __future__ import annotations

import os
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple
from urllib.parse import urlsplit

from sattrack.core.files import open_regular
from sattrack.mount.alpaca.client import AlpacaDevice, AlpacaRefusalError, NoAnswerError
from sattrack.schedule.night_processes import LOOK_EVERY_S, MOST_BYTES, run_program
from tle.errors import printable

if TYPE_CHECKING:
    from collections.abc import Callable

    from sattrack.schedule.schema import Weather


class WeatherReport(NamedTuple):
    """Whether it is safe, and why not."""

    safe: bool
    words: str | None = None


FRESH_S = 3.0
"""An answer that is no older counts for whoever asks just before the mount moves."""


class _WeatherQuestion:
    """One question to a weather source, in a thread of its own: a disk or a network may never answer."""

    def __init__(self, weather: Weather, folder: Path) -> None:
        """Begin to ask. Raises RuntimeError where no thread can be begun."""
        self._weather, self._folder = weather, folder
        self._answer: WeatherReport | None = None
        self._took_s = self._answered_s = float("inf")
        self.begun_s = time.monotonic()
        self.thread = threading.Thread(target=self._ask, name="weather source", daemon=True)
        self.thread.start()

    @property
    def age_s(self) -> float:
        """How old its answer is, seconds; infinite where there is none."""
        return abs(_since_boot_s() - self._answered_s)

    def answer_within(self, timeout_s: float) -> WeatherReport:
        """Return its answer, where that has come within so long."""
        if self._answer is None or self._took_s > timeout_s:
            return WeatherReport(False, f"no answer within {timeout_s:g} s")
        return self._answer

    def _ask(self) -> None:
        answer = _asked(self._weather, self._folder)
        self._took_s, self._answered_s = time.monotonic() - self.begun_s, _since_boot_s()
        self._answer = answer


def _since_boot_s() -> float:
    """Return a clock that nobody sets, and that goes on while the computer sleeps where it has such a one."""
    boot = getattr(time, "CLOCK_BOOTTIME", None)
    return time.monotonic() if boot is None else time.clock_gettime(boot)


def _never() -> bool:
    return False


class WeatherSource:
    """What a schedule asks for the weather. Programs run in `folder`.

    While a question hangs no other is begun, as each would leave a thread behind.
    """

    def __init__(self, weather: Weather, folder: Path) -> None:
        """Ask nothing yet."""
        self.weather, self._folder = weather, folder
        self._last: _WeatherQuestion | None = None
        self._lock = threading.Lock()

    def ask(self, must_end: Callable[[], bool] = _never, fresh_s: float = 0.0) -> WeatherReport:
        """Return its answer, or that none came within the schedule's time limit.

        An answer of the last `fresh_s` counts. Once the caller `must_end`, nothing is waited for: what is
        returned then is no answer.
        """
        cut_off = WeatherReport(False, "it was not waited for")
        if must_end():
            return cut_off
        try:
            question = self._question(fresh_s)
        except RuntimeError as error:
            return WeatherReport(False, f"cannot be asked: {error}")
        timeout_s = self.weather.timeout_s
        until_s = question.begun_s + timeout_s
        while question.thread.is_alive() and (left_s := until_s - time.monotonic()) > 0.0:
            if must_end():
                return cut_off
            question.thread.join(min(left_s, LOOK_EVERY_S))
        return question.answer_within(timeout_s)

    def _question(self, fresh_s: float) -> _WeatherQuestion:
        """Return the question that is under way or fresh, else a new one. Raises RuntimeError."""
        with self._lock:
            last = self._last
            if last is None or not (last.thread.is_alive() or last.age_s < fresh_s):
                last = self._last = _WeatherQuestion(self.weather, self._folder)
            return last


def _asked(weather: Weather, folder: Path) -> WeatherReport:
    if weather.file is not None:
        return _by_file(Path(weather.file), weather.oldest_s)
    if weather.command is not None:
        words = run_program(weather.command, weather.timeout_s, folder, {})
        return WeatherReport(words is None, None if words is None else f"{weather.command[0]}: {words}")
    return _by_alpaca(str(weather.alpaca), weather.timeout_s)


def _by_file(path: Path, oldest_s: float) -> WeatherReport:
    try:
        with open_regular(path, follow_link=True) as file:
            age_s = time.time() - os.fstat(file.fileno()).st_mtime
            found = file.read(MOST_BYTES).decode("utf-8-sig", errors="replace").split()
    except (OSError, ValueError) as error:
        return WeatherReport(False, f"{path}: {getattr(error, 'strerror', None) or error}")
    if age_s > oldest_s:
        return WeatherReport(False, f"{path} was last written {age_s:.0f} s ago, {oldest_s:g} s are allowed")
    if age_s < -oldest_s:
        # By a clock that is wrong, or was: how old it is, nobody can tell.
        return WeatherReport(False, f"{path} was last written {-age_s:.0f} s ahead of this computer's clock")
    word = found[0].casefold() if found else ""
    if word == "safe":
        return WeatherReport(True)
    if word == "unsafe":
        return WeatherReport(False, printable(" ".join(found[1:]))[:200] or "unsafe")
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
    """Asks the weather source at once and then periodically, in its own thread.

    `unsafe` is the reason, once it is unsafe.
    """

    def __init__(self, source: WeatherSource) -> None:
        """Begin to ask."""
        self.unsafe: str | None = None
        self._source = source
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._ask, name="weather", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Ask no more."""
        self._over.set()

    def _ask(self) -> None:
        # Sessions may break off more often than this waits: each is watched from its beginning.
        fresh_s = FRESH_S
        while True:
            answer = self._source.ask(self._over.is_set, fresh_s)
            if not answer.safe and not self._over.is_set():
                self.unsafe = answer.words or "unsafe"
                return
            if self._over.wait(self._source.weather.every_s):
                return
            fresh_s = 0.0
