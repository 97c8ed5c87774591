"""An hour with everything on, as a user runs it, in real time: does anything grow, and is anything left?

python bench/soak.py [--seconds 3600] [--every 5] [--keep FILE] | --virtual HOURS

Three mounts of `bench/strangers`, programs of their own, over UDP on loopback. `sattrack track` follows a
satellite that stays up, with its screen on a pseudo-terminal, and records; keys are pressed, and `sattrack
attach` looks on now and then. `sattrack serve alpaca rotctld` has a client of each protocol: they slew,
turn, follow, stop, ask, hang up and come back. `sattrack run` carries out a schedule of many short passes.

The kernel tells what each process holds (/proc, Linux). A process is ours if the soak's folder is in its
environment, whoever its parent is. Descriptors and threads are compared by the medians of the first and of
the last quarter, after a warm-up; processes by those that are there all through a half, and memory by the
most in it. At the end each program is interrupted, as by Ctrl-C. Nothing may be left: no process, nothing in
the temporary folder or in /dev/shm, no socket and no lock among the states. Exit code 1 where something grew
or was left.

With --virtual one run follows a geostationary satellite for so many hours of virtual time, without recording.
"""

from __future__ import annotations

import argparse
import contextlib
import fcntl
import http.client
import itertools
import json
import os
import pty
import select
import signal
import socket
import statistics
import struct
import subprocess
import sys
import tempfile
import termios
import threading
import time
from collections import Counter, defaultdict
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple
from urllib.parse import urlencode

from programs import (
    PATIENCE_S,
    elements_of_today,
    ended,
    free_port,
    satellite,
    sattrack,
    site_below,
    stranger,
)

from tle.instants import Utc

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

REVOLUTIONS_A_DAY = 4.0
"""Of satellites 10,000 km high, which are up for two hours."""
FIRST_NUMBER = 70001
ROWS, COLUMNS = 40, 120
KEYS = (b"2", b"3", b"4", b"5", b"1", b"?", b"\x1b", b"t", b"\x1b[C", b"\x1b[D", b"v", b"v", b"u")
"""Every page, help, a theme, a nudge and back, the sky alone and back, undo."""
CTRL_C = b"\x03"
KEY_EVERY_S, ATTACH_EVERY_S, TURN_S = 3.0, 20.0, 24.0
FIRST_PASS_AFTER_S, PASS_S, PASSES_EVERY_S = 20.0, 20.0, 60.0
UNHURRIED_S, QUICKEST = 720.0, 0.25
"""A shorter soak has all that in proportion, to a quarter."""
ON_TERMINAL = (
    "import fcntl, os, sys, termios; "
    "fcntl.ioctl(0, termios.TIOCSCTTY, 0); os.execv(sys.argv[1], sys.argv[1:])"
)
WARM_UP = 0.1
"""The share of the time in which imports, caches and buffers may fill."""
THERE = 0.9
"""The share of the samples in which a process is that was there all the time."""
END_WITHIN_S = 60.0
MB = 1e6
MAY_GROW_MB = 2.0
GEOSTATIONARY = {"mean_motion_rev_day": 1.00273, "inclination_deg": 0.02, "eccentricity": 0.0001}
VIRTUAL_MAY_GROW_MB = 1.0
RECORDED, RECORDED_MB_H = "track: track", 3.0
"""By design, MB an hour: the index of the recording, a row each 0.8 s."""
SEARCH = "track: passes"
"""The screen's search for passes: it fills its tables, and ends; on a slow machine after most of a minute."""
SHARED = Path("/dev/shm")
KEPT = frozenset({"guardian.log", "biases.sqlite3"})
RUNS, AT_REST = "nights", ".rest"
"""What the program keeps among a user's states; the list of schedules' runs that may go on; the end of the
name of a note where a mount was left at rest, kept for a day."""


class Held(NamedTuple):
    """What one process holds."""

    descriptors: int
    threads: int
    resident_mb: float


class Sample(NamedTuple):
    """What was seen at one instant."""

    at_s: float
    held: dict[tuple[str, int], Held]
    """By the process' name and number."""
    temporary: int
    """How many files were in the temporary folder."""


def processes_of(folder: Path) -> list[int]:
    """Return the processes that have a folder's name in their environment, however they came to be."""
    mark, found = os.fsencode(folder), []
    for entry in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            if mark in (entry / "environ").read_bytes():
                found.append(int(entry.name))
    return sorted(found)


def end_all(folder: Path) -> None:
    """End by force what is left of a folder's programs."""
    for pid in processes_of(folder):
        with contextlib.suppress(OSError):
            os.kill(pid, signal.SIGKILL)


def wait_until(there: Callable[[], bool], within_s: float = PATIENCE_S) -> bool:
    """Wait until something is so; return whether it is."""
    until_s = time.monotonic() + within_s
    while not (so := there()) and time.monotonic() < until_s:
        select.select([], [], [], 0.02)
    return so


def command_line(pid: int) -> list[str]:
    try:
        return [word.decode() for word in Path(f"/proc/{pid}/cmdline").read_bytes().split(b"\0") if word]
    except OSError:
        return []


def held_by(pid: int) -> Held:
    status = Path(f"/proc/{pid}/status").read_text().split()
    resident_kb = int(status[status.index("VmRSS:") + 1])
    threads = int(status[status.index("Threads:") + 1])
    return Held(len([*Path(f"/proc/{pid}/fd").iterdir()]), threads, resident_kb * 1024 / MB)


def parent_of(pid: int) -> int:
    return int(Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[1])


class Terminal:
    """Our end of a pseudo-terminal of a program's own; what it draws is read all the time."""

    def __init__(self, *arguments: str, **more: Any) -> None:
        self.ours, theirs = pty.openpty()
        fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", ROWS, COLUMNS, 0, 0))
        command = [sys.executable, "-c", ON_TERMINAL, sys.executable, "-m", "sattrack", *arguments]
        pipes = {"stdin": theirs, "stdout": theirs, "stderr": theirs}
        self.process = subprocess.Popen(command, start_new_session=True, **pipes, **more)
        os.close(theirs)
        self._last = b""
        self._changed = threading.Condition()
        self._closing = threading.Event()
        self._reader = threading.Thread(target=self._read)
        self._reader.start()

    def press(self, keys: bytes) -> None:
        """Type keys; what is waited for from now on is drawn after that."""
        with self._changed:
            self._last = b""
        os.write(self.ours, keys)

    def wait_for(self, text: bytes) -> None:
        """Wait until a text was drawn."""
        with self._changed:
            assert self._changed.wait_for(lambda: text in self._last, PATIENCE_S), self._last[-2000:]

    def hang_up(self) -> None:
        """Close it, as one closes a window."""
        self._closing.set()
        self._reader.join()

    def end(self) -> None:
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()
        self.hang_up()

    def _read(self) -> None:
        while not self._closing.is_set():
            if not select.select([self.ours], [], [], 0.05)[0]:
                continue
            try:
                data = os.read(self.ours, 65536)
            except OSError:
                break
            with self._changed:
                self._last = (self._last + data)[-200_000:]
                self._changed.notify_all()
        os.close(self.ours)


@dataclass
class Place:
    """A folder with satellites that stay up over its site, settings, and an environment of its own."""

    folder: Path
    seconds: float = 600.0
    satellites: int = 1

    def __post_init__(self) -> None:
        """Write what its programs read."""
        lines = [
            elements_of_today(mean_motion_rev_day=REVOLUTIONS_A_DAY, catalog_number=FIRST_NUMBER + n)
            for n in range(self.satellites)
        ]
        self.site = site_below(lines[0], 0.5 * self.seconds)
        self.state, self.temporary = self.folder / "state", self.folder / "tmp"
        for made in (self.folder, self.state, self.temporary):
            made.mkdir(exist_ok=True)
        self.elements, self.settings = self.folder / "high.tle", self.folder / "sattrack.toml"
        self.elements.write_text("".join(f"{line}\n" for pair in lines for line in pair))
        # Whatever the time of day, the Sun is in nobody's way.
        self.settings.write_text("[safety]\noptical = false\n")
        own = {f"XDG_{name}_HOME": str(self.state) for name in ("STATE", "CACHE", "CONFIG", "DATA")}
        self.environment = {**os.environ, **own, "TMPDIR": str(self.temporary), "TERM": "xterm-256color"}
        where = ("--site", self.site, "--config", str(self.settings))
        self.where = (*where, "--elements", str(self.elements))

    def track(self, mount: str, *options: str) -> tuple[str, ...]:
        return ("track", str(FIRST_NUMBER), "--mount", mount, *self.where, *options)

    def run(self, mount: str) -> tuple[str, ...]:
        return ("run", str(self.folder / "night.toml"), "--mount", mount, "--json", *self.where)

    def write_schedule(self, after_s: float, pass_s: float, every_s: float) -> None:
        """Write a schedule of one short pass of each satellite, one after the other."""
        terms = 'if_sun_up = "run"\nif_infeasible = "run"\nsettle_s = 1\nleast_s = 3\n'
        begin, entries = time.time(), ["park_at_end = false\n"]
        for n in range(self.satellites):
            start = begin + after_s + n * every_s
            at = [Utc(instant).isoformat("milliseconds") for instant in (start, start + pass_s)]
            entries.append(
                f'[[fixed]]\nsatellite = "{FIRST_NUMBER + n}"\n{terms}start = {at[0]}\nend = {at[1]}\n'
            )
        (self.folder / "night.toml").write_text("".join(entries))

    def left(self, within_s: float = END_WITHIN_S) -> list[str]:
        """Wait until no process is left; return those that are, and files that should not be."""
        wait_until(lambda: not processes_of(self.folder), within_s)
        states = (path for path in self.state.rglob("*") if not path.is_dir() and path.parent.name != RUNS)
        files = [*self.temporary.rglob("*"), *states]
        return [
            *(
                f"process: {words}"
                for pid in processes_of(self.folder)
                if (words := " ".join(command_line(pid)))
            ),
            *(
                str(path.relative_to(self.folder))
                for path in files
                if path.name not in KEPT and path.suffix != AT_REST
            ),
        ]


class Server:
    """`sattrack serve alpaca rotctld` at work; its log is read as it comes."""

    def __init__(self, place: Place, mount: str) -> None:
        self.rotctld_port = free_port()
        served = (
            "serve",
            "alpaca",
            f"rotctld:{self.rotctld_port}",
            "--no-discovery",
            "--port",
            "0",
            "--json",
        )
        command = (*served, "--mount", mount, *place.where)
        self.process = sattrack(*command, env=place.environment, stdin=subprocess.DEVNULL)
        self.log: list[str] = []
        self._heard = threading.Event()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        assert line, self.log
        self.port = int(json.loads(line)["listening"])
        assert self._heard.wait(PATIENCE_S), self.log

    def _read(self) -> None:
        for line in self.process.stderr or ():
            self.log = [*self.log[-20:], line]
            if "the mount is heard" in line:
                self._heard.set()


class AlpacaClient:
    """Asks and commands by Alpaca, one request after the other on one connection."""

    def __init__(self, port: int) -> None:
        self._line = http.client.HTTPConnection("127.0.0.1", port, timeout=PATIENCE_S)

    def put(self, member: str, **words: object) -> int:
        """Command something; return the error's number."""
        head = {"Content-Type": "application/x-www-form-urlencoded"}
        return int(self._ask("PUT", member, urlencode({"ClientID": 1, **words}), head)["ErrorNumber"])

    def get(self, member: str) -> object:
        return self._ask("GET", member)["Value"]

    def close(self) -> None:
        self._line.close()

    def _ask(
        self, method: str, member: str, body: str | None = None, head: dict[str, str] | None = None
    ) -> dict:
        self._line.request(method, f"/api/v1/telescope/0/{member}", body, head or {})
        return json.loads(self._line.getresponse().read())


class RotctldClient:
    """Asks and commands by rotctld's lines."""

    def __init__(self, port: int) -> None:
        self._line = socket.create_connection(("127.0.0.1", port), timeout=PATIENCE_S)
        self._file = self._line.makefile("r")

    def command(self, line: str) -> bool:
        self._line.sendall(f"{line}\n".encode())
        return self._file.readline() == "RPRT 0\n"

    def position(self) -> tuple[float, float] | None:
        """Return azimuth and elevation; None where the mount's last status is old."""
        self._line.sendall(b"p\n")
        first = self._file.readline()
        return None if first.startswith("RPRT") else (float(first), float(self._file.readline()))

    def first_position(self) -> tuple[float, float]:
        """Wait until there is one."""
        assert wait_until(lambda: self.position() is not None)
        return self.position() or (0.0, 45.0)

    def close(self) -> None:
        self._file.close()
        self._line.close()


@dataclass
class Clients:
    """One of each protocol. By turns one commands and the other looks on; each turn ends with a hang-up."""

    server: Server
    ending: threading.Event
    counts: Counter[str]
    pace: float

    def work(self, which: Callable[[bool], None], first: bool) -> None:
        for turn in itertools.count():
            which(first is (turn % 2 == 0))
            if self.ending.is_set():
                return

    def alpaca(self, commanding: bool) -> None:
        client = AlpacaClient(self.server.port)
        try:
            client.put("connected", Connected="true")
            if commanding:
                self._command_by_alpaca(client)
            self._look(lambda: self.counts.update(alpaca=len(str(client.get("devicestate"))) > 10), TURN_S)
            client.put("connected", Connected="false")
        finally:
            client.close()

    def _command_by_alpaca(self, client: AlpacaClient) -> None:
        def order(member: str, **words: object) -> None:
            number = client.put(member, **words)
            self.counts.update({"orders by Alpaca" if number == 0 else "refused": 1})

        sidereal_h = float(str(client.get("siderealtime")))
        order("tracking", Tracking="true")
        order(
            "slewtocoordinatesasync",
            RightAscension=(sidereal_h - 0.5) % 24.0,
            Declination=client.get("declination"),
        )
        self._look(lambda: self.counts.update(alpaca=isinstance(client.get("slewing"), bool)), 3.0)
        order("abortslew")
        wait_until(lambda: client.get("slewing") is False)
        order("action", Action="TrackSatellite", Parameters=str(FIRST_NUMBER))
        self._look(lambda: self.counts.update(alpaca=isinstance(client.get("rightascension"), float)), 6.0)
        order("abortslew")

    def rotctld(self, commanding: bool) -> None:
        client = RotctldClient(self.server.rotctld_port)
        try:
            azimuth, elevation = client.first_position()
            began_s = time.monotonic()

            def go_on() -> None:
                if commanding:
                    ahead = 0.1 * (time.monotonic() - began_s)
                    done = client.command(f"P {azimuth + ahead:.2f} {max(20.0, elevation - ahead):.2f}")
                    self.counts.update({"orders by rotctld" if done else "refused": 1})
                client.position()
                self.counts.update(rotctld=1)

            self._look(go_on, TURN_S)
            if commanding:
                client.command("S")
        finally:
            client.close()

    def _look(self, ask: Callable[[], None], seconds: float) -> None:
        """Ask twice a second."""
        until_s = time.monotonic() + self.pace * seconds
        while time.monotonic() < until_s and not self.ending.wait(0.5):
            ask()


@dataclass
class Soak:
    """Everything at once, watched."""

    seconds: float
    every_s: float
    folder: Path
    samples: list[Sample] = field(default_factory=list)
    counts: Counter[str] = field(default_factory=Counter)
    wrong: list[str] = field(default_factory=list)
    """What was left, or ended otherwise than it should."""
    _roots: dict[int, str] = field(default_factory=dict)
    """The program that each process belongs to, also where its parent has ended."""
    _feeder: int = 0

    def run(self) -> None:
        """Let it run, and end it."""
        self.pace = min(1.0, max(QUICKEST, self.seconds / UNHURRIED_S))
        self.ending = threading.Event()
        passes = 1 + int(self.seconds / (self.pace * PASSES_EVERY_S))
        self.place = Place(self.folder, self.seconds, passes)
        with ExitStack() as stack:
            stack.callback(end_all, self.folder)
            mounts = [stack.enter_context(stranger(self.place.site)).url for _ in range(3)]
            with ExitStack() as programs:
                self._start(programs, mounts)
                self._watch()
            self.wrong += [f"left: {what}" for what in self.place.left()]

    def _start(self, stack: ExitStack, mounts: list[str]) -> None:
        place, environment = self.place, self.place.environment
        track = place.track(mounts[0], "--record", str(self.folder / "track.mcap"))
        screen = Terminal(*track, env=environment)
        stack.callback(screen.end)
        self._enters(stack, "track", screen.process, lambda: screen.press(CTRL_C))
        server = Server(place, mounts[1])
        stack.enter_context(ended(server.process))
        self._enters(stack, "serve", server.process)
        place.write_schedule(*(self.pace * each for each in (FIRST_PASS_AFTER_S, PASS_S, PASSES_EVERY_S)))
        log = stack.enter_context((self.folder / "run.log").open("w"))
        pipes = {"stdin": subprocess.DEVNULL, "stdout": log, "stderr": log}
        runner = stack.enter_context(ended(sattrack(*place.run(mounts[2]), env=environment, **pipes)))
        self._enters(stack, "run", runner)
        screen.wait_for(b"all is well")
        clients = Clients(server, self.ending, self.counts, self.pace)
        works = (
            lambda: clients.work(clients.alpaca, True),
            lambda: clients.work(clients.rotctld, False),
            lambda: self._press(screen),
            self._attach,
        )
        for work in works:
            thread = threading.Thread(target=self._told, args=(work,))
            thread.start()
            stack.callback(thread.join)
        stack.callback(self.ending.set)

    def _enters(
        self,
        stack: ExitStack,
        name: str,
        process: subprocess.Popen[Any],
        interrupt: Callable[[], None] | None = None,
    ) -> None:
        """Know a program by its name, and interrupt it at the end."""
        self._roots[process.pid] = name
        stack.callback(self._end, name, process, interrupt or (lambda: process.send_signal(signal.SIGINT)))

    def _end(self, name: str, process: subprocess.Popen[Any], interrupt: Callable[[], None]) -> None:
        if process.poll() is not None:
            self.wrong.append(f"{name} ended before its time, with {process.returncode}")
            return
        interrupt()
        try:
            process.wait(END_WITHIN_S)
        except subprocess.TimeoutExpired:
            self.wrong.append(f"{name} did not end")

    def _told(self, work: Callable[[], None]) -> None:
        """Have somebody work; what breaks is told at the end."""
        try:
            work()
        except Exception as error:  # noqa: BLE001
            self.wrong.append(f"{error!r}")

    def _press(self, screen: Terminal) -> None:
        for key in itertools.cycle(KEYS):
            if self.ending.wait(self.pace * KEY_EVERY_S):
                return
            screen.press(key)
            self.counts.update(keys=1)

    def _attach(self) -> None:
        """Look on at the run, and go away again."""
        quiet = {"stdin": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        while not self.ending.wait(self.pace * ATTACH_EVERY_S):
            command = ("attach", "--run", str(self._feeder), "--json", *self.place.where)
            with ended(sattrack(*command, env=self.place.environment, **quiet)) as looking:
                assert looking.stdout is not None
                self.counts.update(attached=bool(looking.stdout.readline()))

    def _watch(self) -> None:
        begun_s = time.monotonic()
        while (at_s := time.monotonic() - begun_s) < self.seconds:
            self.samples.append(self._sample(at_s))
            if sys.stderr.isatty():
                print(f"\r\x1b[K{at_s:.0f} of {self.seconds:.0f} s", end="", file=sys.stderr)
            self.ending.wait(self.every_s)
        if sys.stderr.isatty():
            print("\r\x1b[K", end="", file=sys.stderr)

    def _sample(self, at_s: float) -> Sample:
        held = {}
        for pid in processes_of(self.folder):
            with contextlib.suppress(OSError, ValueError):
                held[self._name(pid), pid] = held_by(pid)
        return Sample(at_s, held, sum(1 for _ in self.place.temporary.rglob("*")))

    def _name(self, pid: int) -> str:
        """Return a process' name: that of the program that it belongs to, and its own."""
        above, words = pid, command_line(pid)
        while above not in self._roots and above > 1:
            above = parent_of(above)
        root = self._roots.get(above, "")
        if above == pid and "-m" not in words[:3]:
            return root
        of = words.index("-m")
        own = words[of + 1].removeprefix("sattrack.").removesuffix(".process")
        if own == "sattrack":
            own = words[of + 2] if words[of + 2] != "mount" else " ".join(words[of + 2 : of + 4])
        if (root, own) == ("track", "track"):
            self._feeder = pid if above != pid or "--stream" in words else self._feeder
        self._roots.setdefault(pid, root)
        if own == root and "--stream" not in words:
            return root
        return f"{root}: {own}" if root else own


class Row(NamedTuple):
    """How what the processes of one name hold went on."""

    name: str
    count: int
    """How many there were, one after the other."""
    lasting: bool
    """Whether it is one that was there all the time."""
    descriptors: tuple[float, float]
    threads: tuple[float, float]
    """Medians of the first and of the last quarter."""
    resident_mb: tuple[float, float]
    """The most in the first half, and in the second."""
    slope_mb_h: float


def rows_of(samples: list[Sample]) -> list[Row]:
    """Return a row for each name that is there in the first quarter after the warm-up, and in the last."""
    first_s, end_s = WARM_UP * samples[-1].at_s, samples[-1].at_s
    seen: dict[str, list[tuple[float, float, int, Held]]] = defaultdict(list)
    steady = sum(sample.at_s >= first_s for sample in samples)
    for sample in samples:
        part = (sample.at_s - first_s) / (end_s - first_s)
        for (name, pid), held in sample.held.items():
            if part >= 0.0:
                seen[name].append((part, sample.at_s, pid, held))
    rows = []
    for name, those in sorted(seen.items()):
        first, last, early, late = (
            [each for each in those if low <= each[0] <= high]
            for low, high in ((0.0, 0.25), (0.75, 1.0), (0.0, 0.5), (0.5, 1.0))
        )
        if first and last:
            pids = {pid for _, _, pid, _ in those}
            rows.append(
                Row(
                    name,
                    len(pids),
                    len(pids) == 1 and len(those) >= THERE * steady,
                    (_median(h.descriptors for *_, h in first), _median(h.descriptors for *_, h in last)),
                    (_median(h.threads for *_, h in first), _median(h.threads for *_, h in last)),
                    (max(h.resident_mb for *_, h in early), max(h.resident_mb for *_, h in late)),
                    3600.0 * slope([(at_s, held.resident_mb) for _, at_s, _, held in late]),
                )
            )
    return rows


def _median(counts: Iterable[int]) -> int:
    return statistics.median_low(counts)


def slope(points: list[tuple[float, float]]) -> float:
    """Return the slope of the straight line by least squares; 0 for a single point."""
    times, values = zip(*points, strict=True)
    return statistics.linear_regression(times, values).slope if len({*times}) > 1 else 0.0


def fewest_processes(samples: list[Sample]) -> tuple[int, int]:
    """Return how many processes there were at least in each half after the warm-up."""
    counts = [len(sample.held) for sample in samples if sample.at_s >= WARM_UP * samples[-1].at_s]
    half = len(counts) // 2
    return min(counts[:half]), min(counts[half:])


def lasting_processes(samples: list[Sample]) -> tuple[int, int]:
    """Return how many processes were there all through each half after the warm-up.

    One that is left over is there all through the second; those that follow one another are in neither,
    however long a busy machine makes them overlap.
    """
    pids = [{pid for _, pid in one.held} for one in samples if one.at_s >= WARM_UP * samples[-1].at_s]
    half = len(pids) // 2
    return len(set.intersection(*pids[:half])), len(set.intersection(*pids[half:]))


def growth(samples: list[Sample], may_grow_mb: float = MAY_GROW_MB) -> list[str]:
    """Return what grew, in words. Of processes that follow one another each begins anew."""
    rows, (before, after) = rows_of(samples), lasting_processes(samples)
    half_h = 0.5 * (1.0 - WARM_UP) * samples[-1].at_s / 3600.0
    found = [f"lasting processes {before} → {after}"] if after > before else []
    for row in rows:
        if row.lasting:
            counts = (("descriptors", row.descriptors), ("threads", row.threads))
            found += [f"{row.name}: {what} {was} → {now}" for what, (was, now) in counts if now > was]
            was_mb, now_mb = row.resident_mb
            by_design_mb = RECORDED_MB_H * half_h if row.name == RECORDED else 0.0
            if now_mb - was_mb > may_grow_mb + by_design_mb and row.name != SEARCH:
                found.append(f"{row.name}: memory {was_mb:.1f} → {now_mb:.1f} MB")
    return found


def virtual(hours: float, every_s: float, folder: Path) -> int:
    """Follow a geostationary satellite in virtual time; tell the run's memory."""
    elements, below = satellite(folder, 0.0, **GEOSTATIONARY)
    _, longitude, _ = below.split(",")
    begin_s = time.time() // 86400.0 * 86400.0
    begin, end = (Utc(at_s).isoformat("seconds") for at_s in (begin_s, begin_s + 3600.0 * hours))
    span = ("--clock", begin, "--from", begin, "--to", end)
    place = ("--elements", str(elements), "--site", f"30,{longitude},0")
    command = ("track", "25544", "--mount", "sim", "--virtual", "--json", *span, *place)
    resident_mb = []
    with ended(sattrack(*command, cwd=folder, stdin=subprocess.DEVNULL)) as run:
        while run.poll() is None:
            with contextlib.suppress(OSError, ValueError):
                resident_mb.append(held_by(run.pid).resident_mb)
            select.select([], [], [], every_s)
        assert run.stdout is not None
        summary = json.loads(run.stdout.read())["summary"]
    # It has loaded what it needs long before that.
    begun = resident_mb[len(resident_mb) // 50 :]
    print(f"{summary['samples']} samples of {hours:g} h: {begun[0]:.2f} MB, then {max(begun):.2f} MB at most")
    return 1 if max(begun) > begun[0] + VIRTUAL_MAY_GROW_MB else 0


def tell(soak: Soak) -> None:
    print("| process | how many | descriptors | threads | memory, MB | MB an hour |")
    print("|---|---|---|---|---|---|")
    for row in rows_of(soak.samples):
        counts = [f"{was}, {now}" for was, now in (row.descriptors, row.threads)]
        memory = f"{row.resident_mb[0]:.1f}, {row.resident_mb[1]:.1f}"
        trend = f"{row.slope_mb_h:+.2f}" if row.lasting else ""
        print(f"| {row.name} | {row.count} | {counts[0]} | {counts[1]} | {memory} | {trend} |")
    before, after = fewest_processes(soak.samples)
    files = max(sample.temporary for sample in soak.samples)
    print(f"\nprocesses: {before} at least in the first half, {after} in the second")
    print(f"temporary files: {files} at most")
    print("; ".join(f"{name}: {count}" for name, count in sorted(soak.counts.items())))


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seconds", type=float, default=3600.0)
    parser.add_argument("--every", type=float, default=5.0, help="seconds from sample to sample")
    parser.add_argument("--keep", type=Path, help="keep the samples there, a line of JSON each")
    parser.add_argument("--virtual", type=float, metavar="HOURS", help="follow one satellite in virtual time")
    given = parser.parse_args()
    # Whatever ends the bench ends what it started.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))
    with tempfile.TemporaryDirectory() as folder:
        if given.virtual is not None:
            return virtual(given.virtual, given.every, Path(folder))
        soak, before = Soak(given.seconds, given.every, Path(folder)), {*SHARED.iterdir()}
        soak.run()
        soak.wrong += [f"left: {path}" for path in {*SHARED.iterdir()} - before]
        if given.keep is not None:
            kept = [
                [s.at_s, s.temporary, [[*who, *held] for who, held in s.held.items()]] for s in soak.samples
            ]
            given.keep.write_text("".join(f"{json.dumps(line)}\n" for line in kept))
    tell(soak)
    wrong = growth(soak.samples) + soak.wrong
    print("\n".join(wrong) or "nothing grew, nothing is left")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
