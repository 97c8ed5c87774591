"""Scenarios, passes and the program's own engine, as `bench/feeder.py` and its tests take them."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import msgspec
from feeder_harness import Link, Scenario, World

from sattrack.core.angles import wrap180
from sattrack.mount.model import MountProfile, mean_sidereal_deg
from sattrack.mount.simulator.mount import SimulatedMount, SimulatedSite, StartPosition
from sattrack.mount.simulator.profile import ServoSettings, SimulatorProfile
from sattrack.runtime import demo_pass
from sattrack.runtime.facts import RunFacts, build_engine, choose_pass, plan_for
from sattrack.safety import SafetyLimits
from sattrack.settings import SiteSettings
from tle.elements import Elements
from tle.instants import Utc
from tle.propagator import Propagator
from tle.refraction import Refraction
from tle.site import Site

if TYPE_CHECKING:
    from tle.passes import Pass

KANOPUS = (
    "1 38707U 12039A   24247.82317651  .00138984  00000-0  16635-2 0  9998",
    "2 38707  97.4945 189.8924 0007050 108.0286 252.1739 15.60479551673427",
)
SETTLED_S = 10.0
BEFORE_S = 8.0

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
    Scenario("edge, 40 ms each way", (0.5, 4.0), Link(0.040, 0.040), move_axis="edge"),
    Scenario("edge, 80 ms each way", (1.5, 8.0), Link(0.080, 0.080), move_axis="edge"),
)


@dataclasses.dataclass(frozen=True)
class Subject:
    """A pass to follow."""

    name: str
    facts: RunFacts
    propagator: Propagator


def subjects(above_deg: float = 10.0) -> list[Subject]:
    """Return the passes, as far as they are above an altitude."""
    return [
        _subject(
            "ISS", demo_pass.elements(), demo_pass.SITE.place(), Utc.parse(demo_pass.BEFORE_PASS), above_deg
        ),
        _subject(
            "KANOPUS",
            Elements.from_tle(*KANOPUS, "KANOPUS-V 1"),
            Site(48.6622, 34.8862, 0.0),
            Utc.parse("2024-09-04T23:57:00Z"),
            above_deg,
        ),
    ]


def _subject(name: str, elements: Elements, site: Site, now: Utc, above_deg: float) -> Subject:
    facts = pass_facts(choose_pass(elements, site, now, above_deg), elements, site, now, BEFORE_S)
    return Subject(name, facts, Propagator(elements, site, refraction=Refraction.standard(site.height_m)))


def pass_facts(found: Pass, elements: Elements, site: Site, now: Utc, before_s: float) -> RunFacts:
    """Return a run of a pass with the usual air, no limits but the default ones, so long before its start."""
    plan = plan_for(found, now, elements)
    air = Refraction.standard(site.height_m)
    return RunFacts(
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
        started_utc_s=plan.start_utc_s - before_s,
    )


class Ours:
    """The program's own engine."""

    period_s = 0.05

    def __init__(self, subject: Subject, scenario: Scenario, profile: MountProfile | None = None) -> None:
        """Begin with a profile, or with one that is told the true delays and clock."""
        link = scenario.link
        profile = profile or msgspec.structs.replace(
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


def hardware(scenario: Scenario, seed: int, bandwidth_hz: float = BANDWIDTH_HZ) -> SimulatorProfile:
    """Return what the simulated mount is made of."""
    return SimulatorProfile(
        clock_offset_s=scenario.clock_offset_s,
        encoder_noise_tics=ENCODER_NOISE_TICS,
        servo=ServoSettings(**{"bandwidth_hz": bandwidth_hz, **scenario.servo}),
        seed=seed,
    )


def world(subject: Subject, scenario: Scenario, seed: int, bandwidth_hz: float = BANDWIDTH_HZ) -> World:
    """Return one run's mount and link, the mount standing where the satellite is as it begins."""
    facts = subject.facts
    begin_s = facts.started_utc_s
    target = subject.propagator.at(Utc(begin_s))
    hour_angle = mean_sidereal_deg(begin_s, facts.site.longitude_deg) - float(target.ra_deg)
    start = StartPosition(wrap180(hour_angle), float(target.dec_deg))
    truth = MountProfile(
        ra_rate_gain=scenario.gain, dec_rate_gain=scenario.gain, move_axis=scenario.move_axis
    )
    site = SimulatedSite(facts.site.latitude_deg, facts.site.longitude_deg, facts.site.height_m)
    mount = SimulatedMount(truth, site, start, hardware(scenario, seed, bandwidth_hz))
    return World(scenario, mount, subject.propagator, (begin_s, facts.plan.end_utc_s), seed)
