"""The mounts of `bench/family.py`, each followed with a profile that says the wrong thing of it.

python bench/wrong_profiles.py [--draws N] [--first N] [--jobs N] [--only KIND] [--all]

One field is wrong: the sign of an axis, or held for edge, or the reverse. Counted is how many runs are
stopped within 30 s of virtual time, whether what they say names that field, as the cause or as what it may
be, and how long after the first rates it came. "On target" are those that got there all the same.
"""

from __future__ import annotations

import argparse
import multiprocessing
import statistics
import sys
from typing import NamedTuple

import msgspec
from family import ALL_KINDS, KINDS, Run, draw, profile_of

from sattrack.control.tracker import FOLLOWING

LASTS_S = 30.0
CASES = ("ra_rate_sign", "dec_rate_sign", "edge told for held", "held told for edge")


class Stopped(NamedTuple):
    """What came of one run."""

    number: int
    case: str
    stopped: bool
    named: bool
    """Whether the words name the field that is wrong."""
    perhaps: bool
    """Whether they name it beside others."""
    on_target: bool
    after_s: float
    words: str

    def line(self) -> str:
        seen = "on target" if self.on_target else "off"
        return f"{self.number:5} {self.case:20} {seen:9} {self.after_s:6.2f} s  {self.words or 'goes on'}"


def stopped(number: int, case: str, only: str | None) -> Stopped | None:
    """Follow one draw with one field wrong; None where the case is not of its mount."""
    drawn = draw(number, KINDS if only is None else (only,))
    right = profile_of(drawn.hardware, "default")
    if case.endswith("_sign"):
        field, wrong = case, msgspec.structs.replace(right, **{case: -getattr(right, case)})
    else:
        field, told, real = "move_axis", case[:4], case[-4:]
        if right.move_axis != real:
            return None
        wrong = msgspec.structs.replace(right, move_axis=told)
    run, times = Run(drawn, profile=wrong), []

    def watch(run: Run, now_s: float) -> None:
        if run.engine.tracker.phase in FOLLOWING or times:
            times.append(now_s)

    run.run(watch, lasts_s=LASTS_S)
    words = run.message or ""
    return Stopped(
        number=number,
        case=case,
        stopped=run.ended_by is not None,
        named=field in words,
        perhaps=f"perhaps {field}" in words,
        on_target=run.engine.tracker.acquired_utc_s is not None,
        after_s=times[-1] - times[0] if times else 0.0,
        words=words,
    )


def of_draw(arguments: tuple[int, str | None]) -> list[Stopped]:
    """Follow one draw in each case."""
    number, only = arguments
    return [one for case in CASES if (one := stopped(number, case, only)) is not None]


def row(case: str, some: list[Stopped]) -> str:
    """Return the figures of one case."""
    times = sorted(one.after_s for one in some if one.stopped)
    took = (statistics.median(times), times[int(0.95 * len(times))], times[-1]) if times else ()
    counts = (
        len(some),
        len(times),
        sum(one.stopped and one.named and not one.perhaps for one in some),
        sum(one.stopped and one.perhaps for one in some),
        sum(one.on_target for one in some),
    )
    figures = [*map(str, counts), *(f"{seconds:.1f}" for seconds in took)]
    return f"{case:20}" + "".join(f"{figure:>10}" for figure in figures)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, default=200)
    parser.add_argument("--first", type=int, default=1000, help="number of the first draw: its seed")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--only", choices=ALL_KINDS)
    parser.add_argument("--all", action="store_true", help="a line for each run")
    options = parser.parse_args()
    numbers = range(options.first, options.first + options.draws)
    found: list[Stopped] = []
    with multiprocessing.Pool(options.jobs) as pool:
        for some in pool.imap(of_draw, [(number, options.only) for number in numbers]):
            found += some
            if options.all:
                print("\n".join(one.line() for one in some), flush=True)
            elif sys.stderr.isatty():
                print(f"\rdraw {some[0].number if some else ''}", end="", file=sys.stderr, flush=True)
    print(f"draws {numbers[0]} to {numbers[-1]}")
    heads = ("mounts", "stopped", "named", "perhaps", "on target", "median s", "95 % s", "worst s")
    print(f"{'wrong':20}" + "".join(f"{head:>10}" for head in heads))
    rows = [(case, [one for one in found if one.case == case]) for case in CASES]
    print("\n".join(row(case, some) for case, some in rows if some))
    return 0 if all(one.stopped and one.named for one in found) else 1


if __name__ == "__main__":
    sys.exit(main())
