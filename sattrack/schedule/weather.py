"""Whether the weather is safe, by whom a schedule names: a file, a program, an Alpaca SafetyMonitor.

What cannot be asked, or does not answer as it should, is unsafe.
"""

from __future__ import annotations

import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple
from urllib.parse import urlsplit

from sattrack.mount.alpaca.client import AlpacaDevice, Refusal, Unheard
from sattrack.schedule.night_commands import run_program
from tle.errors import printable

if TYPE_CHECKING:
    from sattrack.schedule.actions import Weather

MOST_BYTES = 4096


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
    except (Refusal, Unheard) as error:
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
            told = ask_weather(self._weather, self._folder)
            if not told.safe:
                self.unsafe = told.words or "unsafe"
                return
