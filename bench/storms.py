"""Storms of faults over the whole program in a virtual world: what was tried, and what broke.

python bench/storms.py --seeds 200 [--first 0] [--jobs 1] [--log FILE] [--late SECONDS [--both]]

Prints the violations with their seeds, and the table of docs/reliability.md. `sattrack storm --seed N` runs
one of them again with a trace. With `--log` each verdict is kept as a line of JSON, so that an interrupted
series goes on where it was. With `--late` nothing is wrong but that a fifth of the commands comes late, by up
to so many seconds, and the pass ends after some: is the mount left at rest? With `--both` a fifth of the
statuses does, too. Exit code 1 where an invariant was violated.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from functools import partial
from multiprocessing import Pool
from pathlib import Path

import msgspec
from storm.draws import KINDS_OF_FAULTS, draw
from storm.invariants import NAMES, Verdict, judged


def one(seed: int, late_s: float = 0.0, both: bool = False) -> Verdict:
    begun_s, storm = time.process_time(), draw(seed)
    verdict = judged(storm.overtaken(late_s, both) if late_s else storm)[0]
    verdict.took_s = time.process_time() - begun_s
    return verdict


def report(verdicts: list[Verdict]) -> None:
    tried = Counter(kind for verdict in verdicts for kind in verdict.faults)
    hours = sum(verdict.seconds for verdict in verdicts) / 3600.0
    timed = [verdict for verdict in verdicts if verdict.took_s]
    per_minute = sum(v.seconds for v in timed) / 60.0 / max(1e-9, sum(v.took_s for v in timed))
    print(f"| storms | {len(verdicts)} |")
    print(
        f"| faults | {sum(tried.values())}: " + ", ".join(f"{tried[k]} {k}" for k in KINDS_OF_FAULTS) + " |"
    )
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
    parser.add_argument("--late", type=float, default=0.0, metavar="SECONDS")
    parser.add_argument("--both", action="store_true")
    chosen = parser.parse_args()
    lines = chosen.log.read_bytes().splitlines() if chosen.log is not None and chosen.log.exists() else []
    verdicts = [msgspec.json.decode(line, type=Verdict) for line in lines]
    seeds = range(chosen.first + len(verdicts), chosen.first + chosen.seeds)
    with Pool(chosen.jobs, maxtasksperchild=200) as pool:
        for verdict in pool.imap(partial(one, late_s=chosen.late, both=chosen.both), seeds, chunksize=2):
            verdicts.append(verdict)
            if chosen.log is not None:
                with chosen.log.open("ab") as log:
                    log.write(msgspec.json.encode(verdict) + b"\n")
            for violation in verdict.violations:
                print(f"seed {verdict.seed}: {violation}", flush=True)
        pool.close()
        pool.join()
    report(verdicts)
    return 1 if any(verdict.violations for verdict in verdicts) else 0


if __name__ == "__main__":
    sys.exit(main())
