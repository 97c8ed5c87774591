"""The planner on random nights: how much better than greed, whether as good as brute force, how fast.

Run it as `python bench/planner.py`; `--nights N` plans N random nights instead of 1,000, `--seed S` others
than those of seed 1. Passes last one to ten minutes, and slews between any two are drawn from 0 to 120 s, so
that they need not obey the triangle inequality. Seconds are of the processor and of this machine;
`--candidates N` times so many instead of 2,000. The plain ways of planning are those of the tests, which know
nothing of ours.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "sattrack" / "schedule"))
from planning_nights import brute_force, can_be_done, greedy, random_night, random_sky

from sattrack.mount.model import AxesPosition, MountProfile
from sattrack.safety.limits import SafetyLimits
from sattrack.schedule.candidates import Loaded, PlanSituation
from sattrack.schedule.file import load_schedule
from sattrack.schedule.making import make_plan
from sattrack.schedule.planner import best_plan
from tle.instants import Utc
from tle.site import Site

NIGHTS, SMALL, CANDIDATES = 1000, 200, 2000
PASSES, HOURS = 60, 4.0
LIMITED = 40
SATELLITES = 700
BEGIN = "2026-10-02T12:00:00Z"


def against_greed(rng: np.random.Generator, nights: int) -> None:
    gains, worse = [], 0
    for _ in range(nights):
        night = random_night(rng, PASSES, HOURS)
        total, chosen = best_plan(night)
        assert can_be_done(night, chosen, {})
        by_greed = greedy(night)
        gains.append(total / by_greed - 1.0)
        worse += total < by_greed - 1e-6
    better = sum(gain > 1e-9 for gain in gains)
    print(
        f"{nights} nights of {PASSES} passes: worse than greed in {worse}, better in {better}; "
        f"{100.0 * float(np.mean(gains)):.1f} % more on average, {100.0 * max(gains):.0f} % at most"
    )


def against_brute_force(rng: np.random.Generator) -> None:
    off = []
    for number in range(SMALL):
        limited = number % 2 == 1
        night = random_night(rng, 11, 2.0, groups=2, longest_slew_s=900.0)
        limits = {0: 1, 1: 2} if limited else {}
        off.append(abs(best_plan(night, limits)[0] - brute_force(night, limits)))
    print(f"{SMALL} small nights, half of them with limits: at most {max(off):.2g} from all subsets' best")


def seconds_for(rng: np.random.Generator, count: int) -> None:
    for groups, limits in ((0, {}), (1, {0: 12}), (2, {0: 12, 1: 12})):
        night = random_night(rng, count, 12.0, groups=groups)
        began = time.process_time()
        _, chosen = best_plan(night, limits)
        taken_s = time.process_time() - began
        print(
            f"{count} candidates, {groups} rules with max 12: {taken_s:.2f} s; {len(chosen)} passes planned"
        )


def whole_plan(shorten: bool, more: str = "", satellites: int = SATELLITES) -> None:
    """Plan a day of a made-up sky with more passes than are weighed, from the file to the plan."""
    begin = float(Utc.parse(BEGIN).unix_s)
    text = f"[defaults]\nif_sun_up = 'run'\nshorten = {str(shorten).lower()}\n"
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "day.toml"
        file.write_text(text + f"[[passes]]\nrule = 'all, above 15°{more}'\n", encoding="utf-8")
        schedule = load_schedule(file)
    profile = MountProfile(park=AxesPosition(0.0, 50.0))
    situation = PlanSituation(
        (begin, begin + 86400.0), begin, Site(52.1541, 4.4908, 0.0), profile, SafetyLimits(), workers=1
    )
    sky = Loaded(random_sky(satellites), False, "made up")
    began = time.process_time()
    plan, _ = make_plan(schedule, situation, lambda source: sky)
    taken_s = time.process_time() - began
    weighed = len(plan.passes) + sum(one.reason not in ("too many", "cut", "too short") for one in plan.lost)
    print(
        f"a day of {satellites} satellites{', shortened' if shorten else ''}: {weighed} passes weighed, "
        f"{len(plan.passes)} planned, in {taken_s:.1f} s"
    )
    if more:
        share = (plan.value_bound or plan.value) / plan.value - 1.0
        print(
            f"the same{more}: " + (f"within {100.0 * share:.2g} % of the bound" if share > 1e-6 else "proven")
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--nights", type=int, default=NIGHTS)
    parser.add_argument("--candidates", type=int, default=CANDIDATES)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    rng = np.random.default_rng(options.seed)
    against_greed(rng, options.nights)
    against_brute_force(rng)
    seconds_for(rng, options.candidates)
    whole_plan(shorten=False)
    whole_plan(shorten=True)
    whole_plan(shorten=False, more=", once a night, at most 6 an hour", satellites=LIMITED)


if __name__ == "__main__":
    main()
