"""Programs run as a user runs them: a simulated mount, and a track of a satellite that is up just now."""

from __future__ import annotations

import json
import math
import socket
import subprocess
import sys
import threading
import time
from contextlib import contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import erfa
from sgp4.api import Satrec

from sattrack import practice
from tle.elements import Elements
from tle.formats.registry import write_elements
from tle.instants import Utc

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

START_POINT_AHEAD_S = 60.0


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


def elements_of_today() -> tuple[str, str]:
    """The ISS' orbit with today as its epoch, so that it is no older in years to come."""
    orbit = Elements.from_tle(practice.LINE_1, practice.LINE_2)
    today = Utc(time.time() // 86400.0 * 86400.0)
    line_1, line_2 = write_elements([replace(orbit, epoch=today)], "2le").split("\n")[:2]
    return line_1, line_2


def site_on_the_path() -> str:
    """A site over which the ISS will pass a minute from now, so that it is well up already."""
    utc_s = time.time() + START_POINT_AHEAD_S
    jd, fraction = 2440587.5 + utc_s // 86400.0, (utc_s % 86400.0) / 86400.0
    error, r, _ = Satrec.twoline2rv(*elements_of_today()).sgp4(jd, fraction)
    assert error == 0
    longitude = math.degrees(math.atan2(r[1], r[0]) - erfa.gmst82(jd, fraction))
    latitude = math.degrees(math.atan2(r[2], math.hypot(r[0], r[1])))
    return f"{latitude:.3f},{(longitude + 180.0) % 360.0 - 180.0:.3f},0"


def sattrack(*arguments: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "sattrack", *arguments],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


@contextmanager
def ended(process: subprocess.Popen[str]) -> Iterator[subprocess.Popen[str]]:
    """Make sure that a process is gone and its pipes are closed."""
    try:
        yield process
    finally:
        process.kill()
        process.wait()
        for pipe in (process.stdin, process.stdout, process.stderr):
            assert pipe is not None
            pipe.close()


class Mount:
    """A simulated mount that tells where its axes are; what it tells is read as it comes."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        assert process.stdout is not None
        self._process = process
        self.port: int = json.loads(process.stdout.readline())["listening"]
        self._lines: list[str] = []
        self._reader = threading.Thread(target=lambda: self._lines.extend(process.stdout or ()))
        self._reader.start()

    def last_truth(self) -> dict[str, float]:
        """End the mount; return where its axes were last."""
        self.end()
        truth: dict[str, float] = json.loads(self._lines[-1])
        return truth

    def end(self) -> None:
        self._process.terminate()
        self._reader.join()


@contextmanager
def simulated_mount(site: str, *options: str) -> Iterator[Mount]:
    with ended(sattrack("sim", "--port", "0", "--site", site, "--json", *options)) as process:
        mount = Mount(process)
        try:
            yield mount
        finally:
            mount.end()


def track_arguments(folder: Path, site: str, port: int, *options: str) -> list[str]:
    elements = folder / "iss.tle"
    elements.write_text("".join(f"{line}\n" for line in elements_of_today()))
    url = f"xerxes://127.0.0.1:{port}?listen={free_port()}"
    return ["track", "25544", "--mount", url, "--site", site, "--elements", str(elements), *options]


def until(process: subprocess.Popen[str], phase: str) -> dict[str, Any]:
    """Read a stream of views until one shows a phase."""
    assert process.stdout is not None
    for line in process.stdout:
        view: dict[str, Any] = json.loads(line)
        if view.get("phase") == phase:
            return view
    raise AssertionError(f"the run ended before it was {phase}: {process.stderr and process.stderr.read()}")
