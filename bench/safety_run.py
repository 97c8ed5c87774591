"""Random passes with random limits, mounts and faults: how near the true axes come to each limit.

python bench/safety_run.py [--passes 2000] [--seed 1] [--longest 600] [--jobs 1] [--without ROW]

Prints the runs that passed a limit, or did not end at rest, with their seeds, and then the distribution of
the closest approaches. `--without` leaves one row of the table out, or the longest fault (`fault`), to see
that violations are found. `--log FILE` keeps each run as a line of JSON, so that an interrupted series
goes on where it was. Exit code 1 where a limit was passed.
"""

from __future__ import annotations

import argparse
import resource
import sys
from collections import Counter
from multiprocessing import Pool
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec
from safety_draws import LONGEST_S, Judged, draw, fly

from sattrack.safety import bounds, rate_limit
from sattrack.safety.rate_limit import AxisReach

if TYPE_CHECKING:
    from sattrack.safety.rate_limit import Delays

QUANTILES = (0.0, 0.01, 0.05, 0.25, 0.5, 0.75)
LIMITS = ("hour_angle", "declination", "altitude", "horizon", "pier", "sun")


def without(row: str) -> None:
    """Leave a row of the table out of this process."""
    if row == "fault":
        rate_limit.AxisReach = careless_reach  # type: ignore[misc]
        return
    fixed, look = bounds.fixed_regions, bounds.Bounds.look

    def some(*args: object) -> list[object]:
        return [region for region in fixed(*args) if region.name != row]  # type: ignore[arg-type]

    def blind(self: bounds.Bounds, utc_s: float | None, clock_gap_deg: float) -> bool:
        found = look(self, utc_s, clock_gap_deg)
        self._put([cone for cone in self._cones if cone.name != row])
        return found

    bounds.fixed_regions = some
    bounds.Bounds.look = blind  # type: ignore[method-assign]


def careless_reach(
    position_deg: float, now_deg_s: tuple[float, float], delays: Delays, acceleration_deg_s2: float
) -> AxisReach:
    """Look ahead as if every datagram arrived."""
    return AxisReach(position_deg, now_deg_s, delays._replace(fault_s=0.0), acceleration_deg_s2)


def one(work: tuple[int, float, str]) -> tuple[int, str, Judged]:
    seed, longest_s, row = work
    if row and not getattr(one, "done", False):
        without(row)
        one.done = True  # type: ignore[attr-defined]
    drawn = draw(seed, longest_s)
    return seed, drawn.words, fly(drawn)


def report(judged: list[Judged], took_s: float) -> None:
    total_s = sum(run.seconds for run in judged)
    print(f"{len(judged)} runs, {total_s / 3600.0:.1f} hours of virtual time, {took_s:.0f} s of a processor")
    print(f"in daylight: {sum(run.sun_up for run in judged)}")
    print(
        f"held at a limit: {sum(run.held_s > 0.0 for run in judged)}, {sum(r.held_s for r in judged):.0f} s"
    )
    print(
        "ended by: "
        + ", ".join(f"{name} {count}" for name, count in Counter(r.ended_by for r in judged).most_common())
    )
    print("closest approach, degrees inside (quantiles of the runs that have the limit)")
    print(f"{'':>12}" + "".join(f"{100 * q:>9.0f}%" for q in QUANTILES) + "   within 1°  outside")
    for name in LIMITS:
        near = sorted(run.nearest_deg[name] for run in judged if name in run.nearest_deg)
        if not near:
            continue
        row = "".join(f"{near[min(len(near) - 1, int(q * len(near)))]:>10.3f}" for q in QUANTILES)
        within, outside = sum(0.0 <= n < 1.0 for n in near), sum(n < 0.0 for n in near)
        print(f"{name:>12}{row}{within:>12}{outside:>9}")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--passes", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--longest", type=float, default=LONGEST_S)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--without", default="", choices=["", "fault", *LIMITS])
    parser.add_argument("--log", type=Path)
    chosen = parser.parse_args()
    work = [(chosen.seed * 1_000_000 + k, chosen.longest, chosen.without) for k in range(chosen.passes)]
    logged = chosen.log.read_bytes().splitlines() if chosen.log is not None and chosen.log.exists() else []
    judged = [msgspec.json.decode(line, type=Judged) for line in logged]
    failed = sum(bool(run.violated) or not run.at_rest for run in judged)
    work = work[len(judged) :]
    with Pool(chosen.jobs) as pool:
        for done, (seed, words, run) in enumerate(pool.imap(one, work, chunksize=4), start=1):
            judged.append(run)
            if chosen.log is not None:
                with chosen.log.open("ab") as log:
                    log.write(msgspec.json.encode(run) + b"\n")
            if run.violated or not run.at_rest:
                failed += 1
                worst = {name: round(run.nearest_deg[name], 3) for name in run.violated}
                print(f"{words}: {worst or 'not at rest'} (draw({seed}, {chosen.longest:g}))", flush=True)
            if sys.stderr.isatty():
                print(f"\r{done} of {len(work)}", end="", file=sys.stderr, flush=True)
        pool.close()
        pool.join()
    report(judged, sum(resource.getrusage(resource.RUSAGE_CHILDREN)[:2]))
    print(f"passed a limit or did not rest: {failed}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
