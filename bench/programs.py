"""Programs of sattrack as a user runs them, each in a process of its own: for measures, and for tests."""

from __future__ import annotations

import itertools
import json
import math
import os
import socket
import subprocess
import sys
import threading
import time
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import erfa
import tomlkit
from sgp4.api import Satrec

from sattrack.core.angles import wrap180
from sattrack.runtime import demo_pass
from tle.elements import Elements
from tle.instants import Utc
from tle.sources import write_elements

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

WHERE = "52.0,4.5,0"
SITE = ("--site", WHERE)
SIDEREAL_DEG_S = 360.0 / 86164.0905
MOVING_DEG_S = 1e-4
TURN_S = 0.05
PATIENCE_S = 60.0
"""For what takes a moment; nothing is measured by it."""


PORTS = range(20000, 32000)
"""Below those that a system gives to whoever asks for any: nobody gets one between our look and its use."""
_first = 1009 * os.getpid() % len(PORTS)
_ports = itertools.cycle([*PORTS[_first:], *PORTS[:_first]])


def free_port() -> int:
    """Return a port of this machine's that nobody has, for UDP or TCP; each process looks from another on."""
    return next(port for port in _ports if _is_free(port))


def _is_free(port: int) -> bool:
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.bind(("127.0.0.1", port))
        socket.create_server(("127.0.0.1", port)).close()
    except OSError:
        return False
    return True


def elements_of_today(**changes: float) -> tuple[str, str]:
    """The ISS' orbit with today as its epoch, so that it is no older in years to come."""
    orbit = Elements.from_tle(demo_pass.LINE_1, demo_pass.LINE_2)
    today = Utc(time.time() // 86400.0 * 86400.0)
    line_1, line_2 = write_elements([replace(orbit, epoch=today, **changes)], "2le").split("\n")[:2]
    return line_1, line_2


def site_below(lines: tuple[str, str], ahead_s: float) -> str:
    """A site over which a satellite passes so many seconds from now."""
    utc_s = time.time() + ahead_s
    jd, fraction = 2440587.5 + utc_s // 86400.0, (utc_s % 86400.0) / 86400.0
    error, r, _ = Satrec.twoline2rv(*lines).sgp4(jd, fraction)
    assert error == 0
    longitude = math.degrees(math.atan2(r[1], r[0]) - erfa.gmst82(jd, fraction))
    latitude = math.degrees(math.atan2(r[2], math.hypot(r[0], r[1])))
    return f"{latitude:.3f},{wrap180(longitude):.3f},0"


def satellite(folder: Path, culminates_after_s: float, **changes: float) -> tuple[Path, str]:
    """Write elements of the ISS, some changed; return the file, and a site that it passes over then."""
    lines = elements_of_today(**changes)
    path = folder / "iss.tle"
    path.write_text("".join(f"{line}\n" for line in lines))
    return path, site_below(lines, culminates_after_s)


def sattrack(*arguments: str, **more: Any) -> subprocess.Popen[str]:
    """Run `sattrack ...`, its pipes ours."""
    pipes = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.PIPE)
    return subprocess.Popen([sys.executable, "-m", "sattrack", *arguments], text=True, **(pipes | more))


@contextmanager
def ended(process: subprocess.Popen[str]) -> Iterator[subprocess.Popen[str]]:
    """Make sure that a process is gone and its pipes are closed."""
    try:
        yield process
    finally:
        process.kill()
        process.wait()
        for pipe in (process.stdin, process.stdout, process.stderr):
            if pipe is not None:
                pipe.close()


def speed_deg_s(truth: dict[str, float]) -> float:
    """How fast the faster axis turns; standing still and turning with the sky both count as rest."""
    ra = truth["ra_rate_deg_s"] if "ra_rate_deg_s" in truth else truth["hour_angle_rate_deg_s"]
    return max(min(abs(ra), abs(ra - SIDEREAL_DEG_S)), abs(truth["dec_rate_deg_s"]))


class Mount:
    """A simulated mount in a program of its own; where its axes are is read as it comes."""

    def __init__(self, process: subprocess.Popen[str], listen: int | None = None) -> None:
        assert process.stdout is not None
        self._process = process
        told = json.loads(process.stdout.readline())
        self.port = int(told["listening"] if "listening" in told else told["port"])
        self.url = self.new_url(listen)
        self.truths: list[dict[str, float]] = []
        self._changed = threading.Condition()
        self._reader = threading.Thread(target=self._read)
        self._reader.start()

    def new_url(self, listen: int | None = None) -> str:
        """Return how to reach it from a port, or else from one that nobody has."""
        return f"xerxes://127.0.0.1:{self.port}?listen={listen or free_port()}"

    def wait_until_faster(self, than_deg_s: float, since: int = -1) -> None:
        """Wait until an axis is faster than so much, or was since it had told of its axes so many times."""
        self._wait(
            lambda: any(speed_deg_s(truth) > than_deg_s for truth in self.truths[since:]), "is not so fast"
        )

    def wait_until_moving(self, moving: bool) -> None:
        """Wait until an axis moves otherwise than with the sky, or until none does."""
        if moving:
            self.wait_until_faster(MOVING_DEG_S)
        else:
            self._wait(lambda: speed_deg_s(self.truths[-1]) < MOVING_DEG_S, "moves on")

    def wait_until(self, utc_s: float) -> None:
        """Wait until it has told of an instant."""
        self._wait(lambda: self.truths[-1]["utc_s"] > utc_s, "says no more", utc_s - time.time())

    def moved_on_s(self, since_utc_s: float) -> float:
        """How long after an instant the axes were last seen to move, plus the turn in which they stopped."""
        moving = [truth["utc_s"] for truth in self.truths if speed_deg_s(truth) > MOVING_DEG_S]
        return max(0.0, moving[-1] + TURN_S - since_utc_s) if moving else 0.0

    def last_truth(self) -> dict[str, float]:
        """End it; return where its axes were last."""
        self.end()
        return self.truths[-1]

    @property
    def ended(self) -> bool:
        """Whether it was ended."""
        return self._process.poll() is not None

    def end(self) -> None:
        """End it, and have read what it told."""
        self._process.terminate()
        self._reader.join()

    def _wait(self, there: Callable[[], bool], otherwise: str, more_s: float = 0.0) -> None:
        with self._changed:
            if not self._changed.wait_for(lambda: bool(self.truths) and there(), PATIENCE_S + more_s):
                raise AssertionError(f"the mount {otherwise}: {self.truths[-1:]}")

    def _read(self) -> None:
        for line in self._process.stdout or ():
            with self._changed:
                self.truths.append(json.loads(line))
                self._changed.notify_all()


@contextmanager
def simulated_mount(*options: str, site: str = WHERE) -> Iterator[Mount]:
    """Run `sattrack sim` until the end."""
    quiet = {"stdin": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    with ended(sattrack("sim", "--port", "0", "--json", "--site", site, *options, **quiet)) as process:
        mount = Mount(process)
        try:
            yield mount
        finally:
            mount.end()


@contextmanager
def stranger(site: str, *options: str, kind: str = "velocity_servo") -> Iterator[Mount]:
    """Run a mount of `bench/strangers` until the end, 30° from the zenith; with --truth it tells its axes."""
    latitude_deg, longitude_deg, _ = map(float, site.split(","))
    place = {"latitude_deg": latitude_deg, "longitude_deg": longitude_deg, "dec_deg": latitude_deg}
    program = [sys.executable, str(Path(__file__).parent / "strangers" / f"{kind}.py")]
    listen = free_port()
    given = ["--peer", f"127.0.0.1:{listen}", "--parameters", json.dumps(place | {"hour_angle_deg": -30.0})]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    with ended(subprocess.Popen([*program, *given, *options], **pipes)) as process:
        mount = Mount(process, listen)
        try:
            yield mount
        finally:
            mount.end()


@contextmanager
def simulated_telescope(settings: bytes) -> Iterator[tuple[subprocess.Popen[str], int]]:
    """Run a simulated Alpaca telescope, set by JSON, until the end; give its process and its port."""
    with TemporaryDirectory() as folder:
        telescope, nothing = Path(folder) / "telescope.toml", Path(folder) / "sattrack.toml"
        telescope.write_text(tomlkit.dumps(json.loads(settings)), encoding="utf-8")
        nothing.touch()
        files = ("--config", str(nothing), "--telescope", str(telescope))
        quiet = {"stdin": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        with ended(sattrack("sim", "--alpaca", "--port", "0", "--json", *files, **quiet)) as process:
            assert process.stdout is not None
            yield process, int(json.loads(process.stdout.readline())["listening"])
