"""The row in which nobody tells the delays: the mount is calibrated, and followed by the profile of that.

The error may then be what the calibration's interval implies at each instant's rate, and beyond that no more
than with delays that are given; `sattrack track` has said so before the pass.
"""

from __future__ import annotations

import math
import random
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import msgspec
import numpy as np
from calibration import SimulatedLoop, VirtualRun
from feeder_harness import Link, Scenario, Timer
from feeder_passes import BANDWIDTH_HZ, SETTLED_S, Ours, Subject, hardware, world

from sattrack.calibration.calibrator import Calibrator
from sattrack.calibration.findings import conclude
from sattrack.calibration.guard import EndKind, Surroundings
from sattrack.calibration.profile import calibrated
from sattrack.cli.running import announcement
from sattrack.mount.model import MountProfile
from sattrack.mount.simulator.mount import SimulatedMount, SimulatedSite, StartPosition
from tle.instants import Utc

if TYPE_CHECKING:
    from sattrack.runtime.facts import RunFacts

ORDINARY_ARCSEC = (0.3, 1.5)
"""Bounds of RMS and peak where the delays are given."""
SCENARIOS = (
    Scenario("20 ms ± 5 ms, as calibrated", ORDINARY_ARCSEC, Link(0.020, 0.020, 0.005), clock_offset_s=0.37),
    Scenario("5 and 35 ms, as calibrated", ORDINARY_ARCSEC, Link(0.005, 0.035), clock_offset_s=-0.21),
)
BEFORE_PASS_S = 1800.0
START = StartPosition(20.0, 45.0)
SUN_FAR_AWAY = (170.0, -20.0)


class Figures(NamedTuple):
    """RMS and peak, arcseconds; the worst shares of what is allowed; what was announced."""

    rms_arcsec: float
    peak_arcsec: float
    rms_share: float
    """RMS, over that of what each instant's rate and the interval imply and the ordinary bound."""
    peak_share: float
    """The largest error over what its own instant's rate and the interval imply and the ordinary bound."""
    announced_arcsec: float
    """At 1 °/s."""
    implied_share: float
    """The largest error, less the ordinary bound, over what was announced at that instant's rate."""


@dataclass
class Wires:
    """The harness' two ways, for the calibration's run."""

    link: Link
    rng: random.Random

    def command(self, data: bytes, _: np.random.Generator) -> list[tuple[float, bytes]]:
        return [(self.link.command_s + self.rng.uniform(-self.link.jitter_s, self.link.jitter_s), data)]

    def status(self, data: bytes, _: np.random.Generator) -> list[tuple[float, bytes]]:
        return [(self.link.status_s + self.rng.uniform(-self.link.jitter_s, self.link.jitter_s), data)]


@dataclass
class Turns:
    """The harness' timer, for the calibration's run."""

    timer: Timer

    def after(self, last_s: float, _: np.random.Generator) -> float:
        due_s = self.timer.following()
        return due_s if due_s > last_s else self.after(last_s, _)


def calibrate(subject: Subject, scenario: Scenario, seed: int) -> MountProfile:
    """Return the profile that a calibration half an hour before the pass writes; nothing is told to it."""
    site = subject.facts.site
    begin_s = subject.facts.started_utc_s - BEFORE_PASS_S
    place = SimulatedSite(site.latitude_deg, site.longitude_deg, site.height_m)
    mount = SimulatedMount(MountProfile(), place, START, hardware(scenario, seed))
    around = Surroundings(site.latitude_deg, site.longitude_deg, *SUN_FAR_AWAY, 200.0)
    rng = random.Random(f"{scenario.name} {subject.name} {seed}")
    calibrator = Calibrator(around, begin_s)
    turns = Turns(Timer(begin_s, rng))
    loop, wires = SimulatedLoop(mount), Wires(scenario.link, rng)
    VirtualRun(calibrator, loop, wires, turns, np.random.default_rng(seed), begin_s).run()
    assert calibrator.ending is not None
    if calibrator.ending.kind is not EndKind.DONE:
        raise AssertionError(calibrator.ending)
    return calibrated(MountProfile(), conclude(calibrator.seen, site.longitude_deg), None, "bench")


def announced_arcsec(facts: RunFacts) -> float:
    """Return how far off `sattrack track` says before the pass that it may be, arcseconds at 1 °/s."""
    found = re.search(r"at 1 °/s, up to (\d+)″", " ".join(announcement(facts)))
    assert found is not None, announcement(facts)
    return float(found[1])


def follow(subject: Subject, scenario: Scenario, seed: int, bandwidth_hz: float = BANDWIDTH_HZ) -> Figures:
    """Calibrate, follow the pass by the profile of that, and hold each instant's error to what it may be."""
    profile = calibrate(subject, scenario, seed)
    off_s = profile.dated_within_s
    assert off_s is not None
    run = world(subject, scenario, seed, bandwidth_hz)
    run.run(Ours(subject, scenario, profile))
    plan = subject.facts.plan
    errors = [(t, e) for t, e in run.errors if plan.start_utc_s + SETTLED_S <= t <= plan.end_utc_s - 0.1]
    implied = [off_s * 3600.0 * _sky_rate_deg_s(subject, t) for t, _ in errors]
    told = announced_arcsec(msgspec.structs.replace(subject.facts, profile=profile))
    rms = _rms([e for _, e in errors])
    pairs = list(zip((e for _, e in errors), implied, strict=True))
    beyond = max((e - scenario.bounds_arcsec[1]) * off_s * 3600.0 / (i * told) for e, i in pairs)
    return Figures(
        rms,
        max(e for e, _ in pairs),
        rms / (_rms(implied) + scenario.bounds_arcsec[0]),
        max(e / (i + scenario.bounds_arcsec[1]) for e, i in pairs),
        told,
        max(0.0, beyond),
    )


def _sky_rate_deg_s(subject: Subject, utc_s: float) -> float:
    seen = subject.propagator.at(Utc(utc_s))
    east = float(seen.ra_rate_deg_s) * math.cos(math.radians(float(seen.dec_deg)))
    return math.hypot(east, float(seen.dec_rate_deg_s))


def _rms(values: list[float]) -> float:
    return math.sqrt(sum(v * v for v in values) / len(values))
