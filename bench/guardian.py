"""What becomes of a mount whose feeder is killed or hangs, and what its guardian costs.

python bench/guardian.py [--kills N] [--hangs N] [--moves N] [--seed SEED]
python bench/guardian.py --cost

Feeders follow a satellite through its culmination, at about 1 °/s, with simulated mounts that are programs of
their own, over UDP on loopback, several at a time; `--moves` feeders move a mount by `mount move` instead. At
a random instant each is killed (SIGKILL) or halted (SIGSTOP). Told is how long the true axes move on, and
whether they stay at rest for a second more. `--cost` tells what a guardian takes to start, its memory, and
what a heartbeat takes of the feeder's turn.
"""

from __future__ import annotations

import argparse
import random
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any, NamedTuple

from programs import PATIENCE_S, SITE, Mount, satellite, simulated_mount, speed_deg_s

from sattrack.core.figures import quantile
from sattrack.mount.model import MountProfile
from sattrack.mount.xerxes.client import Address
from sattrack.mount.xerxes.datagrams import Command, encode_command
from sattrack.runtime.connection import owned

AT_A_TIME = 4
CULMINATES_AFTER_S = 21.0
WATCHED_S = 1.0
FAST_DEG_S = 0.3


class Feeder:
    """A `sattrack` command that feeds a mount; its guardian is what its child's command line says it is."""

    def __init__(self, *arguments: str) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-m", "sattrack", *arguments],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )

    def guardian(self) -> int:
        """Return the guardian's process number."""
        children = Path(f"/proc/{self.process.pid}/task/{self.process.pid}/children").read_text().split()
        found = [int(pid) for pid in children if is_guardian(int(pid))]
        assert len(found) == 1, f"{len(found)} guardians"
        return found[0]

    def end(self) -> str:
        """End it if it runs still; return what it, and its guardian, said."""
        if self.process.poll() is None:
            self.process.kill()
        _, said = self.process.communicate()
        return said


def is_guardian(pid: int) -> bool:
    try:
        return b"sattrack.runtime.guardian" in Path(f"/proc/{pid}/cmdline").read_bytes()
    except OSError:
        return False


def gone(pid: int, within_s: float = PATIENCE_S) -> bool:
    """Wait until a process is no more."""
    until_s = time.monotonic() + within_s
    while time.monotonic() < until_s:
        if not is_guardian(pid):
            return True
        time.sleep(0.02)
    return False


class Outcome(NamedTuple):
    """What became of one mount."""

    moved_on_s: float
    speed_deg_s: float
    stays: bool
    clean: bool
    """Whether no guardian was left."""


def of_a_pass(number: int, how: signal.Signals, chance: random.Random, *options: str) -> Outcome:
    """Strike down a feeder that follows a satellite, at a random instant around its culmination."""
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        elements, site = satellite(folder, CULMINATES_AFTER_S)
        simulated = stack.enter_context(simulated_mount(*options, site=site))
        arguments = ["track", "25544", "--mount", simulated.new_url(), "--site", site, "--elements"]
        feeder = Feeder(*arguments, str(elements), "--headless", *profile_of(options))
        stack.callback(feeder.end)
        culmination_s = time.time() + CULMINATES_AFTER_S - 3.0
        simulated.wait_until_faster(FAST_DEG_S)
        strike_utc_s = culmination_s + chance.uniform(-4.0, 10.0)
        simulated.wait_until(strike_utc_s)
        simulated.wait_until_faster(FAST_DEG_S)
        return strike(simulated, feeder, how)


def of_a_move(simulated: Mount, how: signal.Signals, chance: random.Random, *options: str) -> Outcome:
    """Strike down a feeder that moves a mount by hand, at a random instant."""
    rate = chance.choice((-1.0, 1.0))
    feeder = Feeder(
        *("mount", "move", "--ra-rate", f"{rate}", "--dec-rate", f"{chance.uniform(-0.3, 0.3):.3f}"),
        *("--seconds", "20", "--mount", simulated.new_url(), *SITE, *profile_of(options)),
    )
    try:
        simulated.wait_until_faster(FAST_DEG_S)
        simulated.wait_until(time.time() + chance.uniform(0.0, 0.5))
        return strike(simulated, feeder, how)
    finally:
        feeder.end()


def profile_of(options: tuple[str, ...]) -> tuple[str, ...]:
    """Return the options that tell the feeder what mount it is: the same file as the simulated one's."""
    return options[options.index("--profile") :][:2] if "--profile" in options else ()


def strike(simulated: Mount, feeder: Feeder, how: signal.Signals) -> Outcome:
    guardian = feeder.guardian()
    speed = speed_deg_s(simulated.truths[-1])
    struck_utc_s = time.time()
    feeder.process.send_signal(how)
    simulated.wait_until(struck_utc_s + 0.1)
    simulated.wait_until_moving(False)
    moved_on_s = simulated.moved_on_s(struck_utc_s)
    simulated.wait_until(time.time() + WATCHED_S)
    stays = simulated.moved_on_s(struck_utc_s) == moved_on_s
    if how == signal.SIGSTOP:
        feeder.process.send_signal(signal.SIGCONT)
        feeder.process.wait(PATIENCE_S)
    return Outcome(moved_on_s, speed, stays, gone(guardian))


def tell(name: str, outcomes: list[Outcome]) -> None:
    if not outcomes:
        return
    times = sorted(outcome.moved_on_s for outcome in outcomes)
    low, mid, high = (quantile(times, share) for share in (0.1, 0.5, 0.9))
    speeds = sorted(outcome.speed_deg_s for outcome in outcomes)
    print(
        f"{name}: {len(outcomes)} at {speeds[0]:.2f} to {speeds[-1]:.2f} °/s; axes at rest after "
        f"{low:.2f} s (10 %), {mid:.2f} s (50 %), {high:.2f} s (90 %), {times[-1]:.2f} s at most; "
        f"{sum(not o.stays for o in outcomes)} moved again, "
        f"{sum(not o.clean for o in outcomes)} guardians left"
    )


def many(count: int, how: signal.Signals, seed: int, *options: str) -> list[Outcome]:
    """Strike down so many feeders in passes, a few at a time."""
    outcomes: list[Outcome] = []
    errors: list[Exception] = []

    def work(numbers: range) -> None:
        for number in numbers:
            try:
                outcomes.append(of_a_pass(number, how, random.Random(f"{seed} {number}"), *options))
            except (AssertionError, OSError) as error:
                errors.append(error)

    workers = [
        threading.Thread(target=work, args=(range(first, count, AT_A_TIME),)) for first in range(AT_A_TIME)
    ]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    for error in errors:
        print(f"a run failed: {error!r}")
    if errors:
        raise errors[0]
    return outcomes


def some_moves(count: int, how: signal.Signals, seed: int, *options: str) -> list[Outcome]:
    """Strike down so many feeders that move one mount by hand, one after the other."""
    chance = random.Random(seed)
    with simulated_mount(*options) as simulated:
        return [of_a_move(simulated, how, chance, *options) for _ in range(count)]


def memory_kb(pid: int) -> dict[str, int]:
    found = {}
    for line in Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()[1:]:
        name, _, rest = line.partition(":")
        found[name] = int(rest.split()[0])
    return found


def cost() -> None:
    starts: list[float] = []
    datagram = encode_command(Command(7, move_ra=True, move_ra_rate_deg_s=1.0))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as nobody:
        nobody.bind(("127.0.0.1", 0))
        for _ in range(10):
            begun_s = time.perf_counter()
            with owned(Address("127.0.0.1", nobody.getsockname()[1], 0), MountProfile()) as (_, guard):
                starts.append(time.perf_counter() - begun_s)
                memory = memory_kb(guard.pid)
                beats = []
                for _ in range(20_000):
                    before_ns = time.perf_counter_ns()
                    guard.beat(datagram)
                    beats.append((time.perf_counter_ns() - before_ns) * 1e-3)
                time.sleep(1.0 if len(starts) == 10 else 0.0)
                guard.release(None)
    beats.sort()
    print(
        f"start, from the claim to the watch: {min(starts) * 1e3:.0f} to {max(starts) * 1e3:.0f} ms\n"
        f"memory: {memory['Rss'] / 1024:.1f} MB resident, {memory['Pss'] / 1024:.1f} MB its share, "
        f"{(memory['Private_Dirty'] + memory['Private_Clean']) / 1024:.1f} MB its own\n"
        f"a heartbeat: {quantile(beats, 0.5):.2f} µs (50 %), {quantile(beats, 0.99):.2f} µs (99 %), "
        f"{quantile(beats, 0.999):.2f} µs (99.9 %), {beats[-1]:.0f} µs at most, of 50000 µs"
    )


def main() -> None:
    assert __doc__ is not None
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--kills", type=int, default=0)
    parser.add_argument("--hangs", type=int, default=0)
    parser.add_argument("--moves", type=int, default=0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--profile", help="the mount's profile, on both sides")
    parser.add_argument("--cost", action="store_true")
    given: Any = parser.parse_args()
    options = () if given.profile is None else ("--profile", given.profile)
    if given.cost or not (given.kills or given.hangs or given.moves):
        cost()
    tell("killed in a pass", many(given.kills, signal.SIGKILL, given.seed, *options))
    tell("halted in a pass", many(given.hangs, signal.SIGSTOP, given.seed, *options))
    tell(
        "killed in a move",
        some_moves(given.moves, signal.SIGKILL, given.seed, *options) if given.moves else [],
    )


if __name__ == "__main__":
    main()
