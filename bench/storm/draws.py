"""What a storm is made of, drawn from its seed: the pass, the mount, its limits, the faults and the people.

`fair` is the same storm without its faults: the same pass, mount and people on a link that only delays.
"""

from __future__ import annotations

import json
import math
import random
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal

import msgspec
from family import KINDS, Hardware
from random_passes import airless_facts, drawn_orbit, hour_angle_deg
from safety_draws import Judge, drawn_limits

from sattrack.mount.model import AxisLimits, MountProfile, PierZone
from storm import others
from tle.instants import Utc
from tle.propagator import Propagator

if TYPE_CHECKING:
    from sattrack.runtime.facts import RunFacts
    from sattrack.safety import SafetyLimits

QUIET_S = 6.0
"""Before the first fault: the mount is on its way, or there."""
STORM_S = 16.0
AFTER_S = 13.0
"""From the end of the last fault to the end of the pass."""
MOST_HOUR_ANGLE_DEG = 85.0
STEEPEST_DEG = 80.0
LOWEST_DEG = 8.0
CLEAR_DEG = 2.0
STOPS_AFTER_S = 8.0
MAX_RATE_DEG_S = 6.0
LED_FROM_SEED = 1000
"""From this seed on, the pass crosses the floor."""
Program = Literal["track", "rotctld", "console", "alpaca", "antenna", "fight", "night"]
PROGRAMS: dict[int, Program] = {3: "console", 5: "rotctld"}
"""Of seeds, by their remainder of 7; the others are over `track`."""
SERVERS_FROM_SEED = 5000
SERVERS: dict[int, Program] = {1: "alpaca", 6: "antenna"}
"""From this seed on these are others still."""
NIGHTS_FROM_SEED = 300_000
NIGHTS: dict[int, Program] = {4: "night"}
"""From this seed on, these too."""
LATE_MOST_S = 0.5
"""How much later than its fellows a datagram may come: what a stop is safe from (docs/reliability.md)."""


@dataclass(frozen=True)
class Way:
    """How one way of the link treats datagrams all the time: shares, and seconds."""

    delay_s: float = 0.0
    jitter_s: float = 0.0
    loss: float = 0.0
    duplicate: float = 0.0
    late: float = 0.0
    """Share that is held back, by up to LATE_MOST_S."""
    corrupt: float = 0.0


@dataclass(frozen=True)
class Fault:
    """One event: when, seconds after the begin of the run, for how long, and how much."""

    at_s: float
    kind: str
    lasts_s: float = 0.0
    amount: float = 0.0

    @property
    def end_s(self) -> float:
        return self.at_s + self.lasts_s

    def __str__(self) -> str:
        amount = f" {self.amount:+.3f}" if self.amount else ""
        return f"{self.kind}{amount} at {self.at_s:.2f} s" + (
            f" for {self.lasts_s:.2f} s" if self.lasts_s else ""
        )


@dataclass(frozen=True)
class Person:
    """What a person does at an instant: a line to the run, or one of STOPS from elsewhere."""

    at_s: float
    line: str
    channel: str = "starter"
    """"starter", "other" for somebody attached, "camera", or "stop" for `sattrack stop`."""


LINK_KINDS = ("deaf", "silent", "cut", "queue", "burst")
"""Commands lost, statuses lost, both; both held back and delivered at the end; nine of ten lost."""
MOUNT_KINDS = ("freeze", "restart", "drive", "clock", "sync")
HOST_KINDS = ("stall", "halt", "step", "sleep", "kill", "disk", "guardian")
"""The process stands still, the machine, its UTC is set, it sleeps; the process ends; the disk is full; the
guardian ends."""
KINDS_OF_FAULTS = (*LINK_KINDS, *MOUNT_KINDS, *HOST_KINDS)


@dataclass(frozen=True)
class Storm:
    """One run in its world."""

    seed: int
    hardware: Hardware
    parameters: dict[str, Any]
    """What a mount of `bench/strangers` has besides: which fields of its statuses lie, and how."""
    facts: RunFacts
    stands: tuple[float, float]
    commands: Way
    statuses: Way
    faults: tuple[Fault, ...]
    people: tuple[Person, ...]
    watchdog: bool = False
    program: Program = "track"
    """`sattrack track`, `serve rotctld`, `serve alpaca --rotctld` (as a fight, too), `serve antenna`, the
    manual console, `mount watch`, or `sattrack run`."""
    fault_free: bool = field(default=False)
    late_most_s: float = LATE_MOST_S
    """By how much a datagram that is held back comes late at most."""
    other: others.Other | None = None
    """What sets its mount apart from those of the first seeds."""

    def judge(self) -> Judge:
        """Return who tells how far inside of the limits its axes are."""
        return Judge(self.facts) if self.other is None else others.OtherJudge(self.facts, self.other)

    @property
    def begin_s(self) -> float:
        return self.facts.started_utc_s

    @property
    def storm_ends_s(self) -> float:
        """When the last fault is over, seconds after the begin."""
        return max((fault.end_s for fault in self.faults), default=0.0)

    def overtaken(self, late_s: float, both: bool) -> Storm:
        """Return a short run in which a fifth of the commands comes late, and nothing else is wrong.

        `both`: a fifth of the statuses as well.
        """
        fair = self.fair()
        plan = msgspec.structs.replace(self.facts.plan, end_utc_s=self.begin_s + STOPS_AFTER_S)
        facts = msgspec.structs.replace(self.facts, plan=plan)
        commands, statuses = replace(fair.commands, late=0.2), replace(fair.statuses, late=0.2 * both)
        return replace(fair, facts=facts, commands=commands, statuses=statuses, people=(), late_most_s=late_s)

    def fight(self, hours: float) -> Storm:
        """Return so many hours of two clients that want the same mount, without faults but of the link."""
        plan = msgspec.structs.replace(self.facts.plan, end_utc_s=self.begin_s + 3600.0 * hours)
        facts = msgspec.structs.replace(self.facts, plan=plan)
        return replace(self, facts=facts, faults=(), people=(), program="fight")

    def fair(self) -> Storm:
        """Return the same without faults."""
        clean = [replace(Way(), delay_s=way.delay_s) for way in (self.commands, self.statuses)]
        return replace(self._calm(), commands=clean[0], statuses=clean[1])

    def on_its_link(self, chances: int) -> Storm:
        """Return the same without faults, but on a link that loses as much as this one: by other chances."""
        return replace(self._calm(), seed=self.seed + chances)

    def _calm(self) -> Storm:
        people = tuple(one for one in self.people if one.channel != "stop")
        return replace(self, faults=(), people=people, fault_free=True)


def draw(seed: int) -> Storm:
    """Return the storm of a seed."""
    dice = random.Random(f"storm {seed}")
    kind, what, strange = KINDS[seed % len(KINDS)], None, random.Random(f"other {seed}")
    if seed >= others.OTHERS_FROM_SEED:
        what, kind = others.drawn_what(strange, kind)
    hardware = drawn_hardware(dice, kind)
    if what is not None:
        hardware = others.changed_hardware(hardware, what)
    lies = drawn_lies(strange) if what is not None and kind != "own" else {}
    watchdog = hardware.kind == "own" and dice.random() < 0.3
    faults = drawn_faults(dice, hardware.kind)
    if what == "synced":
        faults = tuple(sorted((*faults, *drawn_syncs(strange)), key=lambda one: one.at_s))
    end_s = max([QUIET_S + STORM_S, *(fault.end_s for fault in faults if fault.lasts_s < 60.0)]) + AFTER_S
    while True:
        facts = drawn_facts(dice, hardware, end_s, watchdog)
        if facts is not None and seed >= LED_FROM_SEED:
            facts = led_at_the_floor(dice, facts)
        other: others.Other | None = None
        stands = None
        if facts is not None and what is not None:
            clock_s = float(lies.get("clock_error_s", 0.0))
            facts, other = others.changed(strange, what, facts, hardware, clock_s) or (None, None)
        if facts is not None:
            stands = drawn_start(dice, facts, other)
        if facts is not None and stands is not None:
            break
    # The order of the draws is part of what a seed means: seeds are kept in tests/storm/regressions.txt.
    if what is None and hardware.kind != "own":
        lies = drawn_lies(dice)
    late_abort = msgspec.structs.replace(facts.profile, abort_delay_s=lies.get("abort_delay_s", 0.0))
    facts = msgspec.structs.replace(facts, profile=late_abort)
    commands = drawn_way(dice, hardware.command_delay_s, 0.0)
    statuses = drawn_way(dice, hardware.status_delay_s, 0.002)
    people = drawn_people(dice, facts)
    programs = PROGRAMS | (SERVERS if seed >= SERVERS_FROM_SEED else {})
    programs |= NIGHTS if seed >= NIGHTS_FROM_SEED else {}
    program = programs.get(seed % 7, "track")
    return Storm(
        seed=seed,
        hardware=hardware,
        parameters=lies,
        facts=facts,
        stands=stands,
        commands=commands,
        statuses=statuses,
        faults=faults,
        people=tuple(one for one in people if one.channel == "stop" or program == "track"),
        watchdog=watchdog,
        program=program,
        other=other,
    )


def drawn_hardware(dice: random.Random, kind: str) -> Hardware:
    """A mount whose profile is right: what a wrong one does is the family's and the calibration's matter."""
    delays = dice.uniform(0.0, 0.05), dice.uniform(0.0, 0.05)
    acceleration = dice.uniform(3.0, 20.0)
    return Hardware(
        kind=kind,
        bandwidth_hz=math.exp(dice.uniform(math.log(4.0), math.log(30.0))),
        damping=dice.uniform(0.7, 1.2),
        feedforward=dice.uniform(0.7, 1.0),
        acceleration_deg_s2=acceleration,
        gains=(dice.uniform(0.98, 1.02), dice.uniform(0.98, 1.02)),
        move_axis=dice.choice(("held", "held", "edge")),
        additive=dice.random() < 0.7,
        signs=(dice.choice((1, -1)), dice.choice((1, -1))),
        timer=dice.choice(("even", "windows")),
        stiction=dice.choice((0.0, 0.0, dice.uniform(0.0, 0.1))),
        ripple=dice.choice((0.0, dice.uniform(0.0, 0.05))),
        command_delay_s=delays[0],
        status_delay_s=delays[1],
        jitter_s=0.0,
        loss=0.0,
        told_command_s=delays[0],
        told_status_s=delays[1],
        told_acceleration_deg_s2=0.8 * acceleration,
        max_rate_deg_s=MAX_RATE_DEG_S,
    )


def drawn_lies(dice: random.Random) -> dict[str, Any]:
    if dice.random() < 0.5:
        return {}
    return {
        "rate_fields": dice.choice(("true", "constant", "late", "lying", "nan")),
        "slewing_field": dice.choice(("true", "true", "quiet", "false")),
        "move_ack": dice.choice((True, True, False)),
        "abort_delay_s": dice.choice((0.0, 0.0, dice.uniform(0.0, 2.0))),
        "clock_error_s": dice.uniform(-5.0, 5.0),
        "clock_drift_ppm": dice.uniform(-50.0, 50.0),
        "stall_s": dice.choice((0.0, 0.1)),
    }


def drawn_profile(dice: random.Random, hardware: Hardware, watchdog: bool) -> MountProfile:
    axis = AxisLimits(
        max_rate_deg_s=5.0,
        max_acceleration_deg_s2=hardware.told_acceleration_deg_s2,
        slew_rate_deg_s=hardware.max_rate_deg_s,
    )
    zones = []
    if dice.random() < 0.3:
        ha, dec = dice.uniform(-80.0, 80.0), dice.uniform(-20.0, 80.0)
        wide, high = dice.uniform(5.0, 30.0), dice.uniform(5.0, 20.0)
        zones.append(
            PierZone("drawn", ((ha, dec), (ha + wide, dec), (ha + 0.5 * wide, min(89.0, dec + high))))
        )
    return MountProfile(
        name="drawn",
        ra=axis,
        dec=axis,
        ra_rate_sign=hardware.signs[0],
        dec_rate_sign=hardware.signs[1],
        ra_rate_gain=hardware.gains[0],
        dec_rate_gain=hardware.gains[1],
        additive=hardware.additive,
        move_axis=hardware.move_axis,
        command_delay_s=hardware.command_delay_s,
        status_delay_s=hardware.status_delay_s,
        hour_angle_limit_deg=dice.choice((200.0, 120.0, dice.uniform(40.0, 90.0))),
        dec_axis_limits_deg=dice.choice(((-190.0, 190.0), (-60.0, 88.0), (-30.0, 70.0))),
        pier_zones=tuple(zones),
        watchdog_s=2.5 if watchdog else None,
    )


def drawn_facts(dice: random.Random, hardware: Hardware, lasts_s: float, watchdog: bool) -> RunFacts | None:
    """Return a run with a random satellite that is high enough at first; None where this one is not."""
    orbit = drawn_orbit(dice, (12.5, 15.7))
    begin_s, propagator = orbit[2], Propagator(*orbit[:2])
    instants = [begin_s + share * lasts_s for share in (0.0, 0.25, 0.5, 0.75, 1.0)]
    seen = [propagator.at(Utc(utc_s)) for utc_s in instants]
    if not (
        all(float(one.alt_deg) > LOWEST_DEG for one in seen)
        and max(abs(hour_angle_deg(propagator, at_s)) for at_s in instants) < MOST_HOUR_ANGLE_DEG
        and max(abs(float(one.ra_rate_deg_s)) for one in seen) < 3.0
    ):
        return None
    limits: SafetyLimits = drawn_limits(dice)
    start_s = begin_s + dice.choice((0.0, 0.0, 4.0))
    profile = drawn_profile(dice, hardware, watchdog)
    return airless_facts(orbit, (start_s, begin_s + lasts_s), profile, limits, "storm")


def led_at_the_floor(dice: random.Random, facts: RunFacts) -> RunFacts:
    """Return a run with a floor that the satellite is above for a part of the pass only."""
    propagator = Propagator(facts.target, facts.site.place())
    ends = (facts.started_utc_s, facts.plan.end_utc_s)
    altitudes = [float(propagator.at(Utc(utc_s)).alt_deg) for utc_s in ends]
    floor_deg = min(60.0, dice.uniform(min(altitudes), max(altitudes)))
    limits = msgspec.structs.replace(
        facts.limits, floor_altitude_deg=floor_deg, horizon=(), sun_cone_deg=None
    )
    return msgspec.structs.replace(facts, limits=limits)


def drawn_start(
    dice: random.Random, facts: RunFacts, other: others.Other | None = None
) -> tuple[float, float] | None:
    """Return where the axes stand at first, clear of all limits, near the target; None where nowhere is."""
    judge = Judge(facts) if other is None else others.OtherJudge(facts, other)
    target_deg = others.target_deg(facts, other)
    for _ in range(30):
        if other is None:
            ha, dec = (angle + dice.uniform(-others.AWAY_DEG, others.AWAY_DEG) for angle in target_deg)
            far = abs(dec) > STEEPEST_DEG or abs(ha) > MOST_HOUR_ANGLE_DEG
        else:
            ha, dec = others.drawn_near(dice, facts, target_deg)
            far = abs(math.remainder(dec, 180.0)) > STEEPEST_DEG
        if not far and judge.least_deg(ha, dec, facts.started_utc_s) > CLEAR_DEG:
            return ha, dec
    return None


def drawn_syncs(dice: random.Random) -> list[Fault]:
    """Return when somebody else tells the mount that it is elsewhere, and by how much."""
    least, most = (math.log(size) for size in others.SYNCED_DEG)
    return [
        Fault(
            dice.uniform(2.0, QUIET_S + STORM_S),
            "sync",
            0.0,
            dice.choice((-1.0, 1.0)) * math.exp(dice.uniform(least, most)),
        )
        for _ in range(dice.choice((1, 1, 2)))
    ]


def drawn_way(dice: random.Random, delay_s: float, corrupt: float) -> Way:
    def share(chance: float, most: float) -> float:
        return dice.uniform(0.0, most) if dice.random() < chance else 0.0

    return Way(
        delay_s=delay_s,
        jitter_s=share(0.5, 0.02),
        loss=share(0.4, 0.2),
        duplicate=share(0.3, 0.1),
        late=share(0.3, 0.03),
        corrupt=share(0.15, corrupt),
    )


def drawn_faults(dice: random.Random, kind: str) -> tuple[Fault, ...]:
    """Return what goes wrong, in order; a fifth of the storms have a bad link only."""
    faults = []
    at_s = QUIET_S + dice.uniform(0.0, 3.0)
    while at_s < QUIET_S + STORM_S and dice.random() < 0.75:
        fault = drawn_fault(dice, at_s, kind)
        faults.append(fault)
        at_s += dice.choice((0.0, min(fault.lasts_s, 10.0))) + dice.uniform(0.1, 8.0)
    return tuple(faults)


def drawn_fault(dice: random.Random, at_s: float, kind: str) -> Fault:
    chance = dice.random()
    brief = math.exp(dice.uniform(math.log(0.05), math.log(2.5)))
    if chance < 0.42:
        return Fault(at_s, dice.choice(LINK_KINDS), brief)
    if chance < 0.43:
        return Fault(at_s, dice.choice(("deaf", "silent", "cut")), dice.uniform(3.0, 15.0))
    if chance < 0.58:
        return Fault(at_s, "freeze", math.exp(dice.uniform(math.log(0.05), math.log(3.0))))
    if chance < 0.63:
        return Fault(at_s, "restart", dice.uniform(0.3, 5.0))
    if chance < 0.65 and kind == "own":
        return Fault(at_s, "drive", 0.0)
    if chance < 0.68:
        return Fault(at_s, "clock", 0.0, dice.choice((-1.0, 1.0)) * math.exp(dice.uniform(-2.0, 5.0)))
    if chance < 0.84:
        return Fault(
            at_s, dice.choice(("stall", "halt")), math.exp(dice.uniform(math.log(0.001), math.log(2.0)))
        )
    if chance < 0.88:
        return Fault(at_s, "step", 0.0, dice.choice((-1.0, 1.0)) * math.exp(dice.uniform(-5.0, 9.0)))
    if chance < 0.90:
        return Fault(at_s, "sleep", math.exp(dice.uniform(math.log(2.0), math.log(600.0))))
    if chance < 0.92:
        return Fault(at_s, "kill")
    if chance < 0.96:
        return Fault(at_s, "disk")
    return Fault(at_s, "guardian")


def drawn_people(dice: random.Random, facts: RunFacts) -> tuple[Person, ...]:
    """Return what operators, onlookers and a camera do."""
    people = []
    lasts_s = facts.plan.end_utc_s - facts.started_utc_s
    busy = dice.choice((0.0, 0.0, 0.1, 0.5))
    at_s = dice.uniform(1.0, 8.0)
    while busy and at_s < lasts_s:
        people.append(Person(at_s, *drawn_line(dice, facts, at_s)))
        at_s += dice.expovariate(busy)
    if dice.random() < 0.25:
        at_s = dice.uniform(1.0, lasts_s)
        people.append(Person(at_s, json.dumps({"type": "pause"})))
        later_s = at_s + dice.uniform(0.1, 6.0)
        if dice.random() < 0.3:
            rate = dice.uniform(-1.0, 1.0)
            people.append(Person(later_s, json.dumps({"type": "jog", "dec_rate_deg_s": rate})))
        people.append(Person(later_s + dice.uniform(0.0, 4.0), json.dumps({"type": "go"})))
    if dice.random() < 0.12:
        people.append(Person(dice.uniform(1.0, lasts_s), json.dumps({"type": "stop"})))
    if dice.random() < 0.08:
        people.append(Person(dice.uniform(1.0, lasts_s), "", "stop"))
    return tuple(sorted(people, key=lambda one: one.at_s))


def drawn_line(dice: random.Random, facts: RunFacts, at_s: float) -> tuple[str, str]:
    """Return one line and the channel by which it comes."""
    utc = Utc(facts.started_utc_s + at_s - dice.uniform(0.0, 1.0)).isoformat("milliseconds")
    what = dice.randrange(9)
    if what <= 2:
        return json.dumps({"type": "nudge", "along_s": dice.uniform(-0.5, 0.5)}), "starter"
    if what == 3:
        offset = {"type": "offset", "what": "cross_deg", "how": "add", "value": dice.uniform(-0.5, 0.5)}
        return json.dumps(offset), dice.choice(("starter", "other"))
    if what == 4:
        size = 10.0 ** dice.uniform(0.0, 4.2)
        seen = {"type": "offset", "utc": utc, "dx_arcsec": dice.uniform(-size, size)}
        seen |= {"dy_arcsec": dice.uniform(-size, size), "sigma_arcsec": dice.uniform(0.5, 60.0)}
        return json.dumps(seen), "camera"
    if what == 5:
        seen = {"type": "observation", "utc": utc, "ra_deg": dice.uniform(0.0, 360.0), "frame": "of_date"}
        seen |= {"dec_deg": dice.uniform(-90.0, 90.0), "sigma_arcsec": dice.uniform(0.1, 600.0)}
        return json.dumps(seen), "camera"
    if what == 6:
        return dice.choice(
            ('{"type":"stop"', "{}", "\x00\xff", "[" * 5000, '{"type":"jog"}', "null")
        ), "other"
    if what == 7:
        return json.dumps({"type": dice.choice(("take_control", "yield_control"))}), "other"
    return json.dumps({"type": "clear_bias"}), "starter"
