"""What the control itself loses: the error on the sky of a simulated mount's true axes, scenario by scenario.

python bench/feeder.py [--seeds N] [--rows GLOB] [--rivals]

Each scenario follows two passes, above 10°, in virtual time: the ISS to 81° over Leiden, and KANOPUS-V 1 to
89.99°. The figures are of the whole pass from ten seconds after its rise, the worst seed of each; the rivals
and the oracle steer the same mount over the same link, each beginning on the satellite.
"""

from __future__ import annotations

import argparse
import dataclasses
import fnmatch
import math
import statistics
from typing import TYPE_CHECKING

import msgspec
import numpy as np
from feeder_harness import Controller, Link, Scenario, World
from feeder_rivals import Compensated, Oracle, Proportional

from sattrack import practice
from sattrack.messages import Nudge
from sattrack.mount import MountProfile
from sattrack.runtime.facts import RunFacts, build_engine, choose_pass, plan_for
from sattrack.safety import SafetyLimits
from sattrack.settings import SiteSettings
from sattrack.xerxes.simulator.mount import SimulatedMount, SimulatedSite, StartPosition, mean_sidereal_deg
from sattrack.xerxes.simulator.settings import ServoSettings, SimulatorProfile
from tle.bias import Bias
from tle.elements import Elements
from tle.instants import Utc
from tle.propagator import Propagator
from tle.refraction import Refraction
from tle.site import Site

if TYPE_CHECKING:
    from collections.abc import Callable

    from tle.direction import Direction

KANOPUS = (
    "1 38707U 12039A   24247.82317651  .00138984  00000-0  16635-2 0  9998",
    "2 38707  97.4945 189.8924 0007050 108.0286 252.1739 15.60479551673427",
)
SETTLED_S = 10.0
BEFORE_S = 8.0
NUDGE_S = 0.5
NUDGE_EVERY_S = 7.0
NUDGE_SETTLED_S = 2.0
RINGING_S = 0.3
"""How long the drives, 5 Hz wide, take to come to rest after what was commanded has."""

ENCODER_NOISE_TICS = 0.5
BANDWIDTH_HZ = 5.0
ROUGH = {
    "friction_a": 0.5,
    "stiction_a": 0.6,
    "friction_feedforward": 0.9,
    "integral_hz": 1.0,
    "ripple_a": 0.05,
    "ripple_per_turn": 60,
}
SCENARIOS = (
    Scenario("2 ms each way", (0.1, 0.6)),
    Scenario("20 ms ± 5 ms each way", (0.3, 1.5), Link(0.020, 0.020, jitter_s=0.005)),
    Scenario(
        "3 % loss, 1 % doubled, 1 % reordered", (0.15, 1.5), Link(loss=0.03, doubled=0.01, held_back=0.01)
    ),
    Scenario("gain off by 1 %", (0.15, 1.0), gain=1.01),
    Scenario("stiction, ripple, 10″/s disturbance", (0.5, 5.0), disturbance_arcsec_s=10.0, servo=ROUGH),
    Scenario("delays 5 and 35 ms, clock true", (0.3, 1.0), Link(0.005, 0.035)),
    Scenario("edge", (0.8, 4.0), move_axis="edge"),
)


NUDGES = "nudges of 0.5 s, settled"


@dataclasses.dataclass(frozen=True)
class Subject:
    """A pass to follow."""

    name: str
    facts: RunFacts
    propagator: Propagator


def subjects() -> list[Subject]:
    return [
        _subject("ISS", practice.elements(), practice.SITE.place(), Utc.parse(practice.BEFORE_PASS)),
        _subject(
            "KANOPUS",
            Elements.from_tle(*KANOPUS, "KANOPUS-V 1"),
            Site(48.6622, 34.8862, 0.0),
            Utc.parse("2024-09-04T23:57:00Z"),
        ),
    ]


def _subject(name: str, elements: Elements, site: Site, now: Utc) -> Subject:
    found = choose_pass(elements, site, now, 10.0)
    plan = plan_for(found, now)
    air = Refraction.standard(site.height_m)
    facts = RunFacts(
        elements=elements,
        site=SiteSettings(site.latitude_deg, site.longitude_deg, site.height_m),
        refraction="auto",
        pressure_hpa=air.pressure_hpa,
        temperature_c=air.temperature_c,
        plan=plan,
        culminate_utc_s=float(found.culminate_utc.unix_s),
        max_alt_deg=float(found.max_alt_deg),
        profile=MountProfile(),
        limits=SafetyLimits(),
        bias_along_s=0.0,
        bias_cross_deg=0.0,
        mount_name="sim",
        started_utc_s=plan.start_utc_s - BEFORE_S,
    )
    return Subject(name, facts, Propagator(elements, site, refraction=air))


class Ours:
    """The program's own engine."""

    period_s = 0.05

    def __init__(self, subject: Subject, scenario: Scenario) -> None:
        link = scenario.link
        profile = msgspec.structs.replace(
            subject.facts.profile,
            command_delay_s=link.command_s,
            status_delay_s=link.status_s,
            clock_offset_s=0.0,
            move_axis=scenario.move_axis,
        )
        self.engine = build_engine(msgspec.structs.replace(subject.facts, profile=profile))

    def status(self, data: bytes, arrival_utc_s: float) -> None:
        self.engine.receive(data, arrival_utc_s)

    def command(self, now_utc_s: float) -> bytes:
        return self.engine.tick(now_utc_s)

    def shift_s(self, now_utc_s: float) -> float:
        return self.engine.tracker.send_shift_s(now_utc_s)

    def repeat(self) -> bytes | None:
        return self.engine.repeat()


def world(subject: Subject, scenario: Scenario, seed: int, bandwidth_hz: float = BANDWIDTH_HZ) -> World:
    facts = subject.facts
    begin_s = facts.started_utc_s
    target = subject.propagator.at(Utc(begin_s))
    hour_angle = mean_sidereal_deg(begin_s, facts.site.longitude_deg) - float(target.ra_deg)
    start = StartPosition((hour_angle + 180.0) % 360.0 - 180.0, float(target.dec_deg))
    truth = MountProfile(
        ra_rate_gain=scenario.gain, dec_rate_gain=scenario.gain, move_axis=scenario.move_axis
    )
    hardware = SimulatorProfile(
        clock_offset_s=0.0,
        encoder_noise_tics=ENCODER_NOISE_TICS,
        servo=ServoSettings(**{"bandwidth_hz": bandwidth_hz, **scenario.servo}),
        seed=seed,
    )
    site = SimulatedSite(facts.site.latitude_deg, facts.site.longitude_deg, facts.site.height_m)
    mount = SimulatedMount(truth, site, start, hardware)
    return World(scenario, mount, subject.propagator, (begin_s, facts.plan.end_utc_s), seed)


def rivals(subject: Subject, scenario: Scenario) -> dict[str, Callable[[World], Controller]]:
    link = scenario.link
    return {
        "oracle": Oracle,
        "FF + P at 10 Hz": lambda _: Proportional(subject.propagator, 0.1, 0.75),
        "FF + PI at 5 Hz": lambda _: Proportional(subject.propagator, 0.2, 1.0, 0.2),
        "FF + PI at 20 Hz, delay given": lambda _: Compensated(
            subject.propagator, link.command_s, link.status_s, 2.0, 1.0
        ),
    }


def harness_words(bandwidth_hz: float) -> list[str]:
    """Say what the harness fixes."""
    return [
        f"encoder noise ± {ENCODER_NOISE_TICS:g} tic, axis bandwidth {bandwidth_hz:g} Hz",
        "the mount's timer is due every 50 ms, fires at the next of 64 marks a second, up to 1 ms late",
        "rough drives: " + ", ".join(f"{name} {value:g}" for name, value in ROUGH.items()),
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--rows", default="*")
    parser.add_argument("--bandwidth", type=float, default=BANDWIDTH_HZ, metavar="HZ")
    parser.add_argument("--rivals", action="store_true")
    options = parser.parse_args()
    for words in harness_words(options.bandwidth):
        print(words)
    print(f"seeds 1 to {options.seeds}: the worst of each")
    print(f"{'scenario':40} {'pass':8} {'RMS″':>8} {'peak″':>8}   bounds", flush=True)
    squares: dict[str, float] = {}
    for scenario in SCENARIOS:
        if not fnmatch.fnmatch(scenario.name, options.rows):
            continue
        for subject in subjects():
            _row(scenario, subject, options, squares)
    if fnmatch.fnmatch(NUDGES, options.rows):
        for subject in subjects():
            _nudge_row(subject, options)
    ours = squares.pop("ours", 0.0)
    for name, theirs in squares.items():
        print(f"over all rows, RMS of {name} over ours: {(theirs / ours) ** 0.5:.1f}")


def _row(
    scenario: Scenario, subject: Subject, options: argparse.Namespace, squares: dict[str, float]
) -> None:
    seeds = range(1, options.seeds + 1)
    figures = [ours(subject, scenario, seed, options.bandwidth) for seed in seeds]
    rms, peak = max(f[0] for f in figures), max(f[1] for f in figures)
    bounds = " ".join(f"{bound:g}″" for bound in scenario.bounds_arcsec)
    print(f"{scenario.name:40} {subject.name:8} {rms:8.3f} {peak:8.3f}   {bounds}", flush=True)
    if not options.rivals or scenario.move_axis != "held":
        return
    mean_square = statistics.mean(f[0] ** 2 for f in figures)
    squares["ours"] = squares.get("ours", 0.0) + mean_square
    for name, make in rivals(subject, scenario).items():
        theirs = [rival(subject, scenario, seed, make, options.bandwidth) for seed in seeds]
        t_square, t_peak = statistics.mean(f[0] ** 2 for f in theirs), max(f[1] for f in theirs)
        squares[name] = squares.get(name, 0.0) + t_square
        ratio = (t_square / mean_square) ** 0.5
        print(f"    {name:36} {'':8} {t_square**0.5:8.3f} {t_peak:8.3f}   {ratio:8.1f} ×", flush=True)


def _nudge_row(subject: Subject, options: argparse.Namespace) -> None:
    figures = [nudged(subject, seed, options.bandwidth) for seed in range(1, options.seeds + 1)]
    rms, peak, step, longest_s = (max(numbers) for numbers in zip(*figures, strict=True))
    bounds = " ".join(f"{bound:g}″" for bound in SCENARIOS[0].bounds_arcsec)
    print(f"{NUDGES:40} {subject.name:8} {rms:8.3f} {peak:8.3f}   {bounds}", flush=True)
    words = f"{100.0 * step:.0f} % of what the mount's acceleration allows"
    print(f"    largest step of a rate {words}; settled in {longest_s:.1f} s", flush=True)


def ours(
    subject: Subject, scenario: Scenario, seed: int, bandwidth_hz: float = BANDWIDTH_HZ
) -> tuple[float, float]:
    """Return RMS and peak of our own run, arcseconds."""
    run = world(subject, scenario, seed, bandwidth_hz)
    run.run(Ours(subject, scenario))
    plan = subject.facts.plan
    return run.figures(plan.start_utc_s + SETTLED_S, plan.end_utc_s - 0.1)


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


def rival(
    subject: Subject,
    scenario: Scenario,
    seed: int,
    make: Callable[[World], Controller],
    bandwidth_hz: float = BANDWIDTH_HZ,
) -> tuple[float, float]:
    """Return RMS and peak of a rival's run, arcseconds."""
    run = world(subject, scenario, seed, bandwidth_hz)
    run.run(make(run))
    plan = subject.facts.plan
    return run.figures(plan.start_utc_s + SETTLED_S, plan.end_utc_s - 0.1)


if __name__ == "__main__":
    main()
