"""How even the feeder's datagrams are, beside a bare C loop on the same machine at the same time.

python bench/cadence.py [--seconds S | --minutes M] [--around NAME ...] [--feeder KIND ...] [--hogs N]
python bench/cadence.py --footprint

Each run has the feeder follow a satellite that is up, with a simulated mount, over UDP on loopback,
recording; beside it, C loops without and with real-time priority send at the same period. Periods are the
differences of the kernel's own stamps at the sockets that the datagrams come to. Around them: nothing, the
terminal UI drawing on a pseudo-terminal, CPU hogs (as many as the machine has CPUs, or as told), or both; or
a camera: the screen shows its pictures, `track --camera` looks at them, and `sim --camera` renders the sky.
Other programs on the machine count as what they are: disturbance, and the same for all. `--footprint` tells
what the feeder's process holds: modules and memory.
"""

from __future__ import annotations

import argparse
import fcntl
import itertools
import os
import pty
import select
import shutil
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import termios
import time
from collections import Counter
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from programs import free_port, satellite

from sattrack.core.figures import quantile
from sattrack.core.realtime import PRIORITY, VARIABLE

if TYPE_CHECKING:
    from collections.abc import Callable

PERIOD_NS = 50_000_000
SETTLE_S = 12.0
"""From the feeder's first datagram until periods count: by then it is on the satellite."""
START_WITHIN_S = 60.0
END_WITHIN_S = 30.0
LONGEST_MINUTES = 12.0
REVOLUTIONS_A_DAY = 12.5
"""Of a satellite 1500 km high, which is up for longer."""
ROWS, COLUMNS = 40, 120
SO_TIMESTAMPNS = 35
TIMESPEC = struct.Struct("@ll")
REFUSED = 3
KEPT_BYTES = 4000

HOG = "import sys, time\nend = time.monotonic() + float(sys.argv[1])\nwhile time.monotonic() < end: pass"
AROUND = {
    "idle": (False, False),
    "tui": (True, False),
    "hogs": (False, True),
    "both": (True, True),
    "camera": (True, False),
}
USUAL = ("idle", "tui", "hogs", "both")
HALF_BLOCK = "▀".encode()
"""What a picture is drawn with."""


class Spread(NamedTuple):
    """Quantiles of the period, and of how far it is from 50 ms, milliseconds."""

    count: int
    p50: float
    p99: float
    p999: float
    longest: float
    error_p999: float

    @classmethod
    def of(cls, stamps_ns: list[int]) -> Spread:
        periods = sorted((b - a) * 1e-6 for a, b in itertools.pairwise(stamps_ns))
        errors = sorted(abs(p - PERIOD_NS * 1e-6) for p in periods)
        p50, p99, p999 = (quantile(periods, share) for share in (0.5, 0.99, 0.999))
        return cls(len(periods), p50, p99, p999, periods[-1], quantile(errors, 0.999))


@dataclass
class Ear:
    """A socket on loopback that dates what comes by the kernel's stamp, and hands it on if told to."""

    forward_to: int | None = None
    stamps_ns: list[int] = field(default_factory=list)
    bound: socket.socket = field(init=False)

    def __post_init__(self) -> None:
        self.bound = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.bound.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
        self.bound.bind(("127.0.0.1", 0))
        self.bound.setblocking(False)

    @property
    def port(self) -> int:
        return int(self.bound.getsockname()[1])

    def fileno(self) -> int:
        return self.bound.fileno()

    def close(self) -> None:
        self.bound.close()

    def take(self) -> None:
        while True:
            try:
                data, ancillary, _, _ = self.bound.recvmsg(2048, 64)
            except BlockingIOError:
                return
            for level, kind, stamp in ancillary:
                if level == socket.SOL_SOCKET and kind == SO_TIMESTAMPNS:
                    seconds, nanoseconds = TIMESPEC.unpack_from(stamp)
                    self.stamps_ns.append(seconds * 1_000_000_000 + nanoseconds)
            if self.forward_to is not None:
                self.bound.sendto(data, ("127.0.0.1", self.forward_to))


@dataclass
class Screen:
    """The bench's end of a pseudo-terminal; of what is drawn, the last is kept."""

    descriptor: int
    drawn: bytes = b""
    pictured: bool = False
    """Whether a picture was drawn."""

    def fileno(self) -> int:
        return self.descriptor

    def close(self) -> None:
        os.close(self.descriptor)

    def take(self) -> None:
        try:
            data = os.read(self.descriptor, 65536)
            self.drawn = (self.drawn + data)[-KEPT_BYTES:]
            self.pictured |= HALF_BLOCK in data
        except OSError:
            # Linux says so when the other end of a pseudo-terminal has closed.
            return


def build_peer(folder: Path) -> Path | None:
    """Compile the C loop; None, with words, where there is no compiler."""
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if compiler is None:
        print("no C compiler (cc): the C loops, and the ratios to them, are left out")
        return None
    program = folder / "cadence_peer"
    source = Path(__file__).with_name("cadence_peer.c")
    subprocess.run([compiler, "-O2", "-Wall", "-Wextra", "-o", str(program), str(source)], check=True)
    return program


class Run:
    """One feeder, and the C loops beside it, for some seconds."""

    def __init__(
        self, stack: ExitStack, folder: Path, peer: Path | None, seconds: float, camera: bool
    ) -> None:
        self._stack, self._folder, self._peer, self._seconds = stack, folder, peer, seconds
        self._camera = camera
        self._watched: list[Ear | Screen] = []

    def measure(self, realtime: bool, tui: bool, hogs: int) -> dict[str, Spread]:
        ear = self._ear()
        feeder, screen = self._start_feeder(ear, realtime, tui)
        began_s = time.monotonic()
        self._listen(lambda: not ear.stamps_ns and time.monotonic() < began_s + START_WITHIN_S)
        if not ear.stamps_ns:
            raise SystemExit("the feeder did not start")
        lasts_s = SETTLE_S + self._seconds
        for _ in range(hogs):
            self._start([sys.executable, "-c", HOG, f"{lasts_s + 2.0}"])
        peers = (
            {}
            if self._peer is None
            else {"C": self._start_peer(0), "C, real-time": self._start_peer(PRIORITY)}
        )
        began_s = time.monotonic()
        self._listen(lambda: time.monotonic() < began_s + SETTLE_S)
        if self._camera:
            os.write(screen.descriptor, b"6")
        ears = {name: found for name, (found, _) in peers.items()} | {"feeder": ear}
        for each in ears.values():
            each.stamps_ns.clear()
        self._listen(lambda: time.monotonic() < began_s + lasts_s and feeder.poll() is None)
        if feeder.poll() is not None:
            raise SystemExit(f"the feeder ended before its time: {screen.drawn.decode(errors='replace')}")
        if self._camera and not screen.pictured:
            raise SystemExit("the screen showed no picture")
        for name, (_, process) in peers.items():
            if process.poll() == REFUSED:
                print(f"  {name}: the priority was refused; left out")
        return {name: Spread.of(each.stamps_ns) for name, each in ears.items() if len(each.stamps_ns) > 2}

    def _ear(self) -> Ear:
        ear = Ear()
        self._watch(ear)
        return ear

    def _watch(self, source: Ear | Screen) -> None:
        self._watched.append(source)
        self._stack.callback(source.close)
        self._stack.callback(self._watched.remove, source)

    def _start_peer(self, priority: int) -> tuple[Ear, subprocess.Popen[bytes]]:
        ear = self._ear()
        lasts = f"{SETTLE_S + self._seconds + 2.0}"
        return ear, self._start([str(self._peer), str(ear.port), lasts, str(PERIOD_NS), str(priority)])

    def _start_feeder(self, ear: Ear, realtime: bool, tui: bool) -> tuple[subprocess.Popen[bytes], Screen]:
        elements, site = satellite(
            self._folder, SETTLE_S + 0.5 * self._seconds, mean_motion_rev_day=REVOLUTIONS_A_DAY
        )
        sim_port, listen_port = free_port(), free_port()
        sim = ["sim", "--port", str(sim_port), "--peer", str(listen_port), "--site", site]
        looks = []
        if self._camera:
            camera_port = free_port()
            sim += ["--camera", "--camera-port", str(camera_port), "--elements", str(elements)]
            looks = ["--camera", f"alpaca://127.0.0.1:{camera_port}/0", "--scale", "2.5"]
        self._start([sys.executable, "-m", "sattrack", *sim])
        if self._camera:
            _await_port(camera_port)
        ear.forward_to = sim_port
        recording = self._folder / f"{time.monotonic_ns()}.mcap"
        command = [sys.executable, "-m", "sattrack", "track", "25544", "--site", site]
        command += ["--elements", str(elements), "--record", str(recording)]
        command += ["--mount", f"xerxes://127.0.0.1:{ear.port}?listen={listen_port}", *looks]
        environment = {**os.environ, VARIABLE: "1" if realtime else "0", "TERM": "xterm-256color"}
        controller, terminal = pty.openpty()
        fcntl.ioctl(terminal, termios.TIOCSWINSZ, struct.pack("HHHH", ROWS, COLUMNS, 0, 0))
        screen = Screen(controller)
        self._watch(screen)
        if not tui:
            command.append("--headless")
        process = self._start(command, env=environment, stdin=terminal, stdout=terminal, stderr=terminal)
        os.close(terminal)
        return process, screen

    def _start(self, command: list[str], **options: object) -> subprocess.Popen[bytes]:
        quiet = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.DEVNULL)
        process = subprocess.Popen(command, start_new_session=True, **{**quiet, **options})  # type: ignore[call-overload]
        self._stack.callback(self._end, process)
        return process  # type: ignore[no-any-return]

    def _end(self, process: subprocess.Popen[bytes]) -> None:
        """End a process; what it draws meanwhile is read, so that it can."""
        process.send_signal(signal.SIGTERM)
        end_s = time.monotonic() + END_WITHIN_S
        self._listen(lambda: process.poll() is None and time.monotonic() < end_s)
        if process.poll() is None:
            process.kill()
        process.wait()

    def _listen(self, going: Callable[[], bool]) -> None:
        while going():
            for each in select.select(self._watched, [], [], 0.1)[0]:
                each.take()


def _await_port(port: int) -> None:
    """Wait until somebody listens on a TCP port of this machine."""
    until_s = time.monotonic() + START_WITHIN_S
    while True:
        with socket.socket() as door:
            if not door.connect_ex(("127.0.0.1", port)):
                return
        if time.monotonic() > until_s:
            raise SystemExit("the simulated camera did not start")
        time.sleep(0.1)


def footprint() -> None:
    """Run the demonstration, and tell what its process holds while it feeds the mount."""
    command = [sys.executable, "-X", "importtime", "-m", "sattrack", "demo", "--headless", "--seconds", "8"]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    assert process.stderr is not None
    modules: Counter[str] = Counter()
    for line in process.stderr:
        if line.startswith("import time:"):
            modules[line.rpartition("|")[2].strip().partition(".")[0]] += 1
        elif "link up" in line:
            status = Path(f"/proc/{process.pid}/status").read_text()
            names = ("VmSize", "VmRSS", "VmLck", "Threads")
            print(*(line for line in status.splitlines() if line.startswith(names)), sep="\n")
            break
    print(f"{modules.total()} modules: " + ", ".join(f"{name} {n}" for name, n in modules.most_common(8)))
    absent = [name for name in ("textual", "matplotlib", "asyncio", "aiohttp") if name not in modules]
    print(f"not imported: {', '.join(absent)}")
    process.stderr.read()
    process.wait()


def tell(spreads: dict[str, Spread]) -> None:
    for name, spread in spreads.items():
        other = "C, real-time" if name == "feeder, real-time" else "C"
        ratio = ""
        if name not in ("C", "C, real-time") and other in spreads:
            ratio = f"   {spread.p999 / spreads[other].p999:.3f} of {other}'s"
        print(
            f"  {name:<18} {spread.count:>6} {spread.p50:9.3f} {spread.p99:9.3f} {spread.p999:9.3f} "
            f"{spread.longest:9.3f} {spread.error_p999:9.3f}{ratio}",
            flush=True,
        )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seconds", type=float, default=60.0, help="of each run")
    parser.add_argument("--minutes", type=float, help="of each run")
    parser.add_argument("--around", nargs="+", choices=list(AROUND), default=USUAL)
    parser.add_argument("--feeder", nargs="+", choices=["normal", "realtime"], default=["normal", "realtime"])
    parser.add_argument("--hogs", type=int, default=os.cpu_count() or 1, help="how many of them")
    parser.add_argument("--footprint", action="store_true", help="what the feeder's process holds")
    options = parser.parse_args()
    if options.footprint:
        footprint()
        return
    seconds = options.seconds if options.minutes is None else 60.0 * options.minutes
    if not 5.0 <= seconds <= 60.0 * LONGEST_MINUTES:
        parser.error(f"give 5 s to {LONGEST_MINUTES:g} min: the satellite is not up for longer")
    # Whatever ends the bench ends what it started.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))
    print(f"{os.cpu_count()} CPUs, load {os.getloadavg()[0]:.1f} before; {seconds:g} s each; milliseconds")
    print(f"  {'':<18} {'count':>6} {'p50':>9} {'p99':>9} {'p99.9':>9} {'max':>9} {'err p99.9':>9}")
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        peer = build_peer(folder)
        for around in options.around:
            for kind in options.feeder:
                tui, hogs = AROUND[around]
                with ExitStack() as stack:
                    spreads = Run(stack, folder, peer, seconds, around == "camera").measure(
                        kind == "realtime", tui, hogs * options.hogs
                    )
                spreads[f"feeder, {kind}".replace("realtime", "real-time")] = spreads.pop("feeder")
                print(f"{around}, load {os.getloadavg()[0]:.1f}", flush=True)
                tell(spreads)


if __name__ == "__main__":
    main()
