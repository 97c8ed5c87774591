"""Storms of faults over the whole program in a virtual world: what was tried, and what broke.

python bench/storms.py --seeds 200 [--first 0] [--jobs 1] [--log FILE] [--program NAME]
                       [--move-axis held|edge] [--late SECONDS [--both] | --fight HOURS [--fair]]

Prints the violations with their seeds, and the table of docs/reliability.md. `sattrack storm --seed N` runs
one of them again with a trace. With `--log` each verdict is kept as a line of JSON, so that an interrupted
series goes on where it was. With `--program` only those come that are over one program: `track`, `night`,
`console`, `rotctld`, `alpaca` or `antenna`; with `--move-axis` only those whose mount takes rates so. With
`--late` nothing is wrong but that a fifth of the commands comes late, by up to so many seconds, and the pass
ends after some: is the mount left at rest? With `--both` a fifth of the statuses does, too. With `--fight`
two clients want the same mount for so many hours, on each seed's link, or with `--fair` on one that only
delays: one of rotctld sends positions, one of Alpaca slews, moves, follows and stops. Exit code 1 where an
invariant was violated.
"""

from __future__ import annotations

import argparse
import math
import resource
import sys
import time
from collections import Counter
from functools import partial
from itertools import count, islice
from multiprocessing import Pool
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING

import msgspec
from storm.draws import KINDS_OF_FAULTS, Storm, draw
from storm.invariants import NAMES, Verdict, Watcher, held, judged
from storm.programs import WORLDS, FightWorld

if TYPE_CHECKING:
    from storm.mounts import Axes
    from storm.world import Ended, World

    from sattrack.control.driver import Driver

KEPT_TURNS = 1200
FILLED_S, WEIGHED_EVERY_S, MAY_GROW = 300.0, 60.0, 0.25
"""In a fight: when buffers have filled up, how often the program is weighed from then on, and by which share
the least of the second half may exceed that of the first. Each driver brings its own buffers."""


class LongWatcher(Watcher):
    """Judges hours: keeps the last minute of the path, and bounds what the program holds at the end."""

    def __init__(self, storm: Storm) -> None:
        super().__init__(storm)
        self._weighed_s = math.inf
        self._next_s = FILLED_S
        self._held: list[int] = []
        self._resident_mb: list[float] = []
        self._stops = 0
        self._turned_deg = 0.0

    def turn(self, world: World, axes: Axes) -> None:
        if self.path:
            before = self.path[-1]
            self._turned_deg += abs(axes.hour_angle_deg - before.hour_angle_deg)
            self._turned_deg += abs(axes.dec_axis_deg - before.dec_axis_deg)
        super().turn(world, axes)
        if len(self.path) > KEPT_TURNS:
            del self.path[:-1], self._nearest[:-1]

    def stopping(self, world: World) -> None:
        super().stopping(world)
        self._stops += 1

    def period(self, world: World, driver: Driver, ended_by: str | None) -> None:
        super().period(world, driver, ended_by)
        if world.at_s > self._next_s:
            self._next_s += WEIGHED_EVERY_S
            self._held.append(held(driver))
            self._resident_mb.append(resident_mb())

    def ended(self, world: World, ended: Ended) -> None:
        super().ended(world, ended)
        half = len(self._held) // 2
        least = [min(part, default=0) for part in (self._held[:half], self._held[half:])]
        if half and least[1] > (1.0 + MAY_GROW) * least[0]:
            self.violated("memory", world, f"{least[0]} entries at least, then {least[1]}")
        assert isinstance(world, FightWorld)
        self.verdict.why = (
            f"{world.orders} orders by one client, {world.positions} positions by the other, "
            f"{self._stops} stops; the axes turned {self._turned_deg:.0f}°; "
            f"the program held at least {least[0]} entries, then {least[1]}"
        )
        quarter = len(self._resident_mb) // 4
        if quarter:
            before, after = self._resident_mb[quarter : 2 * quarter], self._resident_mb[-quarter:]
            self.verdict.why += f"; {median(before):.2f} MB resident in the second quarter, "
            self.verdict.why += f"{median(after):.2f} MB in the last"


def resident_mb() -> float:
    """Return how much memory this process has, judge and world included (Linux)."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 1e6


def fought(storm: Storm, tracing: bool = False) -> tuple[Verdict, Ended]:
    """Run a fight; return the verdict."""
    watcher = LongWatcher(storm)
    ended = FightWorld(storm, watcher, tracing).run()
    return watcher.verdict, ended


def one(
    seed: int, late_s: float = 0.0, both: bool = False, fight_h: float = 0.0, fair: bool = False
) -> Verdict:
    begun_s, storm = time.process_time(), draw(seed)
    if fight_h:
        verdict = fought((storm.fair() if fair else storm).fight(fight_h))[0]
    else:
        verdict = judged(storm.overtaken(late_s, both) if late_s else storm)[0]
    verdict.took_s = time.process_time() - begun_s
    return verdict


def report(verdicts: list[Verdict]) -> None:
    tried = Counter(kind for verdict in verdicts for kind in verdict.faults)
    hours = sum(verdict.seconds for verdict in verdicts) / 3600.0
    timed = [verdict for verdict in verdicts if verdict.took_s]
    per_minute = sum(v.seconds for v in timed) / 60.0 / max(1e-9, sum(v.took_s for v in timed))
    print(f"| storms | {len(verdicts)} |")
    if tried:
        kinds = ", ".join(f"{tried[kind]} {kind}" for kind in KINDS_OF_FAULTS)
        print(f"| faults | {sum(tried.values())}: {kinds} |")
    ends = Counter(verdict.ended_by for verdict in verdicts)
    print("| runs ended by | " + ", ".join(f"{name} {count}" for name, count in ends.most_common()) + " |")
    broken = Counter(one.invariant for verdict in verdicts for one in verdict.violations)
    print(
        "| violations | "
        + (", ".join(f"{name} {broken[name]}" for name in NAMES if broken[name]) or "0")
        + " |"
    )
    print(f"| at rest at the end | {sum(verdict.left_at_rest for verdict in verdicts)} |")
    stood = sorted(v.standstill_s for v in verdicts if v.standstill_s is not None)
    if stood:
        print(
            f"| stop to standstill, in reach | {stood[len(stood) // 2]:.2f} s (median), "
            f"{stood[-1]:.2f} s (worst) |"
        )
    errors = sorted(v.recovered_arcsec for v in verdicts if v.recovered_arcsec is not None)
    if errors:
        print(
            f"| error 5 s after the storm, against the same run without faults | {len(errors)} runs, "
            f"{errors[len(errors) // 2]:.2f}″ (median), {errors[-1]:.2f}″ (worst) |"
        )
    print(f"| recordings replayed to the last byte | {sum(v.replayed for v in verdicts)} |")
    print(f"| virtual time | {hours:.2f} h, {per_minute:.2f} h a minute of one core |")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=200)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--log", type=Path)
    parser.add_argument("--program", choices=sorted(WORLDS.keys() - {"fight"}))
    parser.add_argument("--move-axis", choices=("held", "edge"))
    parser.add_argument("--late", type=float, default=0.0, metavar="SECONDS")
    parser.add_argument("--both", action="store_true")
    parser.add_argument("--fight", type=float, default=0.0, metavar="HOURS")
    parser.add_argument("--fair", action="store_true")
    chosen = parser.parse_args()
    lines = chosen.log.read_bytes().splitlines() if chosen.log is not None and chosen.log.exists() else []
    verdicts = [msgspec.json.decode(line, type=Verdict) for line in lines]
    every = (
        storm.seed
        for storm in map(draw, count(chosen.first))
        if chosen.program in {None, storm.program} and chosen.move_axis in {None, storm.hardware.move_axis}
    )
    seeds = islice(every, len(verdicts), chosen.seeds)
    with Pool(chosen.jobs, maxtasksperchild=200) as pool:
        run = partial(one, late_s=chosen.late, both=chosen.both, fight_h=chosen.fight, fair=chosen.fair)
        for verdict in pool.imap(run, seeds, chunksize=1 if chosen.fight else 2):
            verdicts.append(verdict)
            if chosen.log is not None:
                with chosen.log.open("ab") as log:
                    log.write(msgspec.json.encode(verdict) + b"\n")
            if chosen.fight:
                print(f"seed {verdict.seed}: {verdict.seconds / 3600.0:.2f} h, {verdict.why}", flush=True)
            for violation in verdict.violations:
                print(f"seed {verdict.seed}: {violation}", flush=True)
        pool.close()
        pool.join()
    report(verdicts)
    return 1 if any(verdict.violations for verdict in verdicts) else 0


if __name__ == "__main__":
    sys.exit(main())
