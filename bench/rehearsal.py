"""Whether a rehearsal tells what the run that follows comes to, and what it costs.

python bench/rehearsal.py [PASSES] [FIRST] [--jobs N]

Random passes of up to ten minutes, over random sites, with random mounts and limits. Each is rehearsed, then
flown as `track --mount sim --virtual` does it, by a mount that has its own clock, timer, link and noise, and
in every fourth friction and ripple; figures of the run are those of its summary and of its statuses.
"""

from __future__ import annotations

import argparse
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from typing import TYPE_CHECKING, Any, NamedTuple
from unittest.mock import patch

from rehearsal_draws import draw, fly, noisy

from sattrack.planning.kinematics import ability_at, verdict_on
from sattrack.runtime import rehearse as rehearsing

if TYPE_CHECKING:
    from sattrack.planning.rehearsal import RehearsalReport
    from sattrack.planning.trace import Performance
    from sattrack.runtime.facts import Prepared, RunFacts

STICKY_EVERY = 4
LOST_WITHIN_S, PEAKS_WITHIN = 0.5, 0.01
COST_WITHIN_S = 2.0


class Row(NamedTuple):
    seed: int
    pass_s: float
    step_s: float
    cpu_s: float
    flown_s: float
    """Virtual seconds of all its runs: another side of the pier may have been tried too."""
    foretold_lost_s: float
    lost_s: float
    foretold_peaks: tuple[float | None, float | None]
    peaks: tuple[float | None, float | None]
    foretold_end: str
    end: str
    go: bool
    why_not: str | None
    by_sun: bool

    @property
    def off_s(self) -> float:
        return abs(self.foretold_lost_s - self.lost_s)

    @property
    def cost_s(self) -> float:
        """Seconds of a core for each run of ten minutes."""
        return 600.0 * self.cpu_s / self.flown_s

    @property
    def peaks_off(self) -> float:
        """The larger of both axes' peaks' relative differences; 0 where neither run was ever on target."""
        pairs = zip(self.foretold_peaks, self.peaks, strict=True)
        off = 0.0
        for foretold, peak in pairs:
            if foretold is None and peak is None:
                continue
            off = 1.0 if foretold is None or peak is None else max(off, abs(foretold / peak - 1.0))
        return off


def compare(seed: int) -> Row:
    prepared = draw(seed)
    plan = prepared.facts.plan
    begun = time.process_time()
    report, flown_s = rehearsed(prepared)
    cpu_s = time.process_time() - begun
    flown = fly(noisy(prepared, seed, seed % STICKY_EVERY == 0))
    return Row(
        seed,
        plan.end_utc_s - plan.start_utc_s,
        report.step_s,
        cpu_s,
        flown_s,
        report.lost_s,
        flown.lost_s,
        (report.peaks[0].reached_rate_deg_s, report.peaks[1].reached_rate_deg_s),
        (flown.peak_hour_angle_deg_s, flown.peak_dec_deg_s),
        report.ended_by,
        flown.summary.ended_by,
        report.go,
        judged(prepared),
        any(lost.limit == "sun" for lost in report.lost),
    )


def rehearsed(prepared: Prepared) -> tuple[RehearsalReport, float]:
    """Return a rehearsal's report, and the virtual seconds of all its runs."""
    perform, flown = rehearsing.perform, []

    def noted(facts: RunFacts, *rest: Any) -> Performance:
        performance = perform(facts, *rest)
        flown.append(performance.ended_utc_s - facts.started_utc_s)
        return performance

    with patch.object(rehearsing, "perform", noted):
        return rehearsing.rehearse(prepared).report, sum(flown)


def judged(prepared: Prepared) -> str | None:
    """Return what `passes --judged` says of the pass."""
    facts = prepared.facts
    site = facts.site.place()
    span = facts.plan.start_utc_s, facts.plan.end_utc_s
    ability = ability_at(site, facts.profile, facts.limits)
    return verdict_on(facts.elements, site, span, ability, None).why_not


def within(values: list[float], most: float) -> int:
    return sum(value <= most for value in values)


def quantiles(values: list[float]) -> str:
    ordered = sorted(values)
    picked = [ordered[min(len(ordered) - 1, int(share * len(ordered)))] for share in (0.5, 0.9, 0.99)]
    return f"median {picked[0]:.3g}, 90 % {picked[1]:.3g}, 99 % {picked[2]:.3g}, most {ordered[-1]:.3g}"


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("passes", nargs="?", type=int, default=200)
    parser.add_argument("first", nargs="?", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1)
    asked = parser.parse_args()
    seeds = range(asked.first, asked.first + asked.passes)
    with ProcessPoolExecutor(asked.jobs) as pool:
        rows = []
        for row in pool.map(compare, seeds):
            rows.append(row)
            if sys.stderr.isatty():
                print(f"\r{len(rows)} of {asked.passes}", end="", file=sys.stderr, flush=True)
    print_rows(rows)


def print_rows(rows: list[Row]) -> None:
    lossy = sum(row.lost_s > 2.0 for row in rows)
    stopped = sum(row.end != "set" for row in rows)
    print(f"{len(rows)} passes; {lossy} lose more than 2 s, {stopped} are ended by a limit")
    for name, some in (
        ("all", rows),
        ("never at the Sun", [row for row in rows if not row.by_sun]),
        ("held by the Sun", [row for row in rows if row.by_sun]),
    ):
        if not some:
            continue
        lost, peaks = [row.off_s for row in some], [row.peaks_off for row in some]
        print(f"{name}, {len(some)}:")
        print(
            f"  lost seconds differ: {quantiles(lost)}; {within(lost, LOST_WITHIN_S)} to {LOST_WITHIN_S:g} s"
        )
        print(f"  peak rates differ: {quantiles(peaks)}; {within(peaks, PEAKS_WITHIN)} to {PEAKS_WITHIN:.0%}")
    print(f"end differs: {sum(row.foretold_end != row.end for row in rows)}")
    agree = sum(row.go is (row.why_not is None) for row in rows)
    print(f"`passes --judged` and the rehearsal's verdict agree: {agree} of {len(rows)}")
    for step_s in (0.05, 0.1):
        costs = [row.cost_s for row in rows if row.step_s == step_s]
        if costs:
            print(
                f"seconds of a core for each run of ten minutes, at {1.0 / step_s:.0f} Hz ({len(costs)}): "
                f"{quantiles(costs)}; {within(costs, COST_WITHIN_S)} to {COST_WITHIN_S:g} s"
            )
    for row in rows:
        differs = row.off_s > LOST_WITHIN_S or row.peaks_off > PEAKS_WITHIN or row.foretold_end != row.end
        if differs or row.go is not (row.why_not is None):
            print(row)


if __name__ == "__main__":
    main()
