"""What the control itself loses: the error on the sky of a simulated mount's true axes, scenario by scenario.

python bench/feeder.py [--seeds N] [--rows GLOB] [--bandwidths HZ,HZ] [--rivals] [--jobs N]

Each scenario follows two passes, above 10°, in virtual time: the ISS to 81° over Leiden, and KANOPUS-V 1 to
89.99°. The figures are of the whole pass from ten seconds after its rise, the worst seed of each; the rivals
and the oracle steer the same mount over the same link, each beginning on the satellite. A row that misses a
bound says so, and makes the exit code 1.
"""

from __future__ import annotations

import argparse
import fnmatch
import functools
import itertools
import math
import multiprocessing
import statistics
import sys
from typing import TYPE_CHECKING, Any, NamedTuple

import feeder_calibrated
import numpy as np
from feeder_passes import (
    BANDWIDTH_HZ,
    ENCODER_NOISE_TICS,
    ROUGH,
    SCENARIOS,
    SETTLED_S,
    Ours,
    Subject,
    subjects,
    world,
)
from feeder_rivals import Compensated, Oracle, Proportional

from sattrack.views.messages import Nudge
from tle.bias import Bias
from tle.instants import Utc

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from feeder_harness import Controller, Scenario, World

    from tle.direction import Direction

NUDGE_S = 0.5
NUDGE_EVERY_S = 7.0
NUDGE_SETTLED_S = 2.0
RINGING_S = 0.3
"""How long the drives, 5 Hz wide, take to come to rest after what was commanded has."""

NUDGES = "nudges of 0.5 s, settled"
BACK_UNDER_ARCSEC = 1.0
BACK_WITHIN_S = 1.0
BACK_LOOKED_FOR_S = 5.0
ORACLE_ARCSEC, ORACLE_RATIO = 0.05, 1.5
"""How near the oracle the RMS is to be: the larger of so much, and so many times its own."""
LEAST_RATIOS = {
    "FF + P at 10 Hz": 10.0,
    "FF + PI at 5 Hz": 10.0,
    "FF + PI at 20 Hz, delay given": 2.0,
}
"""How many times better than the others, over all rows."""
ORACLE = "oracle"


class Figures(NamedTuple):
    """RMS and peak of a run in arcseconds, and how long after a disturbance the error was last over 1″."""

    rms_arcsec: float
    peak_arcsec: float
    back_s: float


def rivals(subject: Subject, scenario: Scenario) -> dict[str, Callable[[World], Controller]]:
    link = scenario.link
    simple: dict[str, Callable[[World], Controller]] = {
        "FF + P at 10 Hz": lambda _: Proportional(subject.propagator, 0.1, 0.75),
        "FF + PI at 5 Hz": lambda _: Proportional(subject.propagator, 0.2, 1.0, 0.2),
        "FF + PI at 20 Hz, delay given": lambda _: Compensated(
            subject.propagator, link.command_s, link.status_s, 2.0, 1.0
        ),
    }
    # Those do not know what an edge is.
    return {ORACLE: Oracle, **(simple if scenario.move_axis == "held" else {})}


def ours(subject: Subject, scenario: Scenario, seed: int, bandwidth_hz: float = BANDWIDTH_HZ) -> Figures:
    """Return the figures of our own run."""
    run = world(subject, scenario, seed, bandwidth_hz)
    run.run(Ours(subject, scenario))
    return figures(run, subject)


def rival(
    subject: Subject, scenario: Scenario, seed: int, name: str, bandwidth_hz: float = BANDWIDTH_HZ
) -> Figures:
    """Return the figures of a rival's run."""
    run = world(subject, scenario, seed, bandwidth_hz)
    run.run(rivals(subject, scenario)[name](run))
    return figures(run, subject)


def figures(run: World, subject: Subject) -> Figures:
    """Return the figures of a run that is over."""
    plan = subject.facts.plan
    since = [(utc_s - run.disturbed_from_s, error) for utc_s, error in run.errors]
    late = [s for s, error in since if 0.0 <= s < BACK_LOOKED_FOR_S and error > BACK_UNDER_ARCSEC]
    back_s = max(late, default=0.0) if run.scenario.disturbance_arcsec_s else 0.0
    return Figures(*run.figures(plan.start_utc_s + SETTLED_S, plan.end_utc_s - 0.1), back_s)


def nudged(
    subject: Subject, seed: int, bandwidth_hz: float = BANDWIDTH_HZ
) -> tuple[float, float, float, float]:
    """Return RMS and peak after each nudge has settled, the worst step of the rates, the longest settling.

    Nudges of half a second along the track, there and back; they settle in two seconds, later only where the
    mount's rate does not allow that. The error is against the propagator with that bias, arcseconds, the step
    a share of what the mount's acceleration allows in a period.
    """
    scenario = SCENARIOS[0]
    run, controller = world(subject, scenario, seed, bandwidth_hz), Ours(subject, scenario)
    plan = subject.facts.plan
    instants = list(np.arange(plan.start_utc_s + SETTLED_S, plan.end_utc_s - NUDGE_EVERY_S, NUDGE_EVERY_S))
    waiting, settled_from_s, given_s = list(instants), list[float](), list[float]()
    steps: list[float] = []

    def command(now_utc_s: float) -> bytes:
        if waiting and now_utc_s >= waiting[0]:
            waiting.pop(0)
            sign = 1.0 if (len(instants) - len(waiting)) % 2 else -1.0
            controller.engine.operate(Nudge(along_s=sign * NUDGE_S), now_utc_s)
            done_s = controller.engine.tracker.steering.biases.offsets["along_s"].ended_utc_s() + RINGING_S
            settled_from_s.append(max(now_utc_s + NUDGE_SETTLED_S, done_s))
            given_s.append(now_utc_s)
        before = controller.engine.tracker.rates
        data = controller.engine.tick(now_utc_s)
        after, limits = controller.engine.tracker.rates, controller.engine.spec.profile
        if now_utc_s > plan.start_utc_s + SETTLED_S:
            for axis, limit in (("ra", limits.ra), ("dec", limits.dec)):
                change = getattr(after, f"{axis}_rate_deg_s") - getattr(before, f"{axis}_rate_deg_s")
                steps.append(abs(change) / (limit.max_acceleration_deg_s2 * limits.period_s))
        return data

    def target(utc_s: float) -> Direction:
        done = sum(utc_s >= instant for instant in instants)
        return subject.propagator.at(Utc(utc_s), Bias(NUDGE_S if done % 2 else 0.0))

    controller.command = command  # type: ignore[method-assign]
    run.target = target
    run.run(controller)
    spans = list(zip(settled_from_s, [*instants[1:], plan.end_utc_s - 0.1], strict=True))
    settled = [e for utc_s, e in run.errors if any(a <= utc_s < b for a, b in spans)]
    longest_s = max(a - given for a, given in zip(settled_from_s, given_s, strict=True))
    return math.sqrt(statistics.fmean(e * e for e in settled)), max(settled), max(steps), longest_s


class Bench:
    """Prints rows, and keeps what is over all of them."""

    def __init__(self, options: argparse.Namespace, bandwidth_hz: float, pool: Any) -> None:
        self._options, self._bandwidth_hz, self._pool = options, bandwidth_hz, pool
        self._squares: dict[str, float] = {}
        self.missed = 0

    def print(self) -> None:
        """Print everything."""
        for words in harness_words(self._bandwidth_hz):
            print(words)
        print(f"seeds 1 to {self._options.seeds}: the worst of each")
        print(f"{'scenario':40} {'pass':8} {'RMS″':>8} {'peak″':>8}   bounds", flush=True)
        for scenario, subject in itertools.product(SCENARIOS, subjects()):
            if self._wanted(scenario.name):
                self._row(scenario, subject)
        for subject in subjects() if self._wanted(NUDGES) else ():
            self._nudge_row(subject)
        for scenario, subject in itertools.product(feeder_calibrated.SCENARIOS, subjects()):
            if self._wanted(scenario.name):
                self._calibrated_row(scenario, subject)
        ours = self._squares.pop("ours", 0.0)
        for name, theirs in self._squares.items():
            ratio = (theirs / ours) ** 0.5
            missed = self._judge(ratio >= LEAST_RATIOS.get(name, 0.0))
            print(f"over all rows, RMS of {name} over ours: {ratio:.1f}{missed}")

    def _wanted(self, name: str) -> bool:
        return fnmatch.fnmatch(name, self._options.rows)

    def _runs(self, function: Callable[..., Any], subject: Subject, *first: Any, last: Any = ()) -> list[Any]:
        seeds: Iterable[int] = range(1, self._options.seeds + 1)
        calls = [(function, subject.name, *first, seed, *last, self._bandwidth_hz) for seed in seeds]
        return list(self._pool.starmap(_run, calls))

    def _judge(self, *held: bool) -> str:
        self.missed += not all(held)
        return "" if all(held) else "   MISSED"

    def _line(
        self, name: str, subject: Subject, rms: float, peak: float, bounds: tuple[float, float]
    ) -> None:
        words = " ".join(f"{bound:g}″" for bound in bounds)
        missed = self._judge(rms <= bounds[0], peak <= bounds[1])
        print(f"{name:40} {subject.name:8} {rms:8.3f} {peak:8.3f}   {words}{missed}", flush=True)

    def _row(self, scenario: Scenario, subject: Subject) -> None:
        figures = self._runs(ours, subject, scenario)
        rms, peak, back_s = (max(numbers) for numbers in zip(*figures, strict=True))
        self._line(scenario.name, subject, rms, peak, scenario.bounds_arcsec)
        if scenario.disturbance_arcsec_s:
            missed = self._judge(back_s <= BACK_WITHIN_S)
            print(f"    last over 1″ {back_s:.2f} s after the disturbance sets in{missed}", flush=True)
        if not self._options.rivals:
            return
        mean_square = statistics.mean(f.rms_arcsec**2 for f in figures)
        compared = scenario.move_axis == "held"
        if compared:
            self._add("ours", mean_square)
        for name in rivals(subject, scenario):
            theirs = self._runs(rival, subject, scenario, last=(name,))
            square, t_peak = (
                statistics.mean(f.rms_arcsec**2 for f in theirs),
                max(f.peak_arcsec for f in theirs),
            )
            if compared:
                self._add(name, square)
            near = mean_square**0.5 <= max(ORACLE_ARCSEC, ORACLE_RATIO * square**0.5)
            missed = self._judge(near or name != ORACLE)
            ratio = (square / mean_square) ** 0.5
            figure = f"{square**0.5:8.3f} {t_peak:8.3f}   {ratio:8.1f} ×{missed}"
            print(f"    {name:36} {'':8} {figure}", flush=True)

    def _add(self, name: str, square: float) -> None:
        self._squares[name] = self._squares.get(name, 0.0) + square

    def _nudge_row(self, subject: Subject) -> None:
        figures = self._runs(nudged, subject)
        rms, peak, step, longest_s = (max(numbers) for numbers in zip(*figures, strict=True))
        self._line(NUDGES, subject, rms, peak, SCENARIOS[0].bounds_arcsec)
        words = f"{100.0 * step:.0f} % of what the mount's acceleration allows"
        print(f"    largest step of a rate {words}; settled in {longest_s:.1f} s", flush=True)

    def _calibrated_row(self, scenario: Scenario, subject: Subject) -> None:
        figures = self._runs(feeder_calibrated.follow, subject, scenario)
        worst = feeder_calibrated.Figures(*(max(numbers) for numbers in zip(*figures, strict=True)))
        missed = self._judge(max(worst.rms_share, worst.peak_share, worst.implied_share) <= 1.0)
        figure = f"{worst.rms_arcsec:8.3f} {worst.peak_arcsec:8.3f}"
        print(f"{scenario.name:40} {subject.name:8} {figure}   as implied")
        share, true = 100.0 * worst.peak_share, 100.0 * worst.implied_share
        print(
            f"    at most {share:.0f} % of what rate and interval imply at each instant, ordinary peak added"
        )
        told = worst.announced_arcsec
        print(
            f"    track said up to {told:.0f}″ at 1 °/s; {true:.0f} % of that came true{missed}", flush=True
        )


def _run(function: Callable[..., Any], name: str, *arguments: Any) -> Any:
    """Make one run in a process of the pool: propagators cannot be sent there."""
    return function(_subject(name), *arguments)


@functools.cache
def _subject(name: str) -> Subject:
    return next(subject for subject in subjects() if subject.name == name)


def harness_words(bandwidth_hz: float) -> list[str]:
    """Say what the harness fixes."""
    return [
        f"encoder noise ± {ENCODER_NOISE_TICS:g} tic, axis bandwidth {bandwidth_hz:g} Hz",
        "the mount's timer is due every 50 ms, fires at the next of 64 marks a second, up to 1 ms late",
        "rough drives: " + ", ".join(f"{name} {value:g}" for name, value in ROUGH.items()),
    ]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--rows", default="*", metavar="GLOB")
    parser.add_argument("--bandwidths", default=f"{BANDWIDTH_HZ:g}", metavar="HZ,HZ")
    parser.add_argument("--rivals", action="store_true")
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help="runs at a time")
    options = parser.parse_args()
    missed = 0
    with multiprocessing.Pool(options.jobs) as pool:
        for bandwidth_hz in map(float, options.bandwidths.split(",")):
            bench = Bench(options, bandwidth_hz, pool)
            bench.print()
            missed += bench.missed
    print(f"bounds missed: {missed}")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
