"""How soon the mount is on a satellite, against the earliest that its limits allow: random skies and starts.

python bench/acquisition.py [DRAWS [SEED]]

Each draw is a satellite, a site beneath its way and a mount that stands somewhere: tracking the sky before
the rise, tracking it in mid-pass, at rest after an abort; or that is on the satellite and thrown off it, or
brought to rest there by half a second of somebody else's abort. The bound is each axis alone, time-optimal
within its rate and acceleration, from how it stands to the place and the rate of the satellite: no handshake,
no rest on the way, and all of the braking. On target is where the true error stays within the 2″ that count
as such.
"""

from __future__ import annotations

import math
import random
import sys
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

from feeder_harness import Scenario, World
from feeder_passes import Ours, Subject, hardware
from random_passes import airless_facts, drawn_orbit, hour_angle_deg

from sattrack.mount.model import SIDEREAL_RATE_DEG_S, AxisLimits, MountProfile
from sattrack.mount.simulator.mount import SimulatedMount, SimulatedSite, StartPosition
from sattrack.mount.xerxes.datagrams import Command, encode_command
from tle.instants import Utc
from tle.propagator import Propagator

if TYPE_CHECKING:
    from collections.abc import Callable

    from tle.direction import Direction

KINDS = ("before the rise", "late start", "after an abort", "thrown off", "aborted on it")
ON_TARGET_ARCSEC = 2.0
STAYS_S = 1.0
LAST_ERRORS = 40
"""More than there are in that."""
LASTS_S = 45.0
RISES_AFTER_S = 50.0
THROWN_AFTER_S = 12.0
ABORTED_FOR_S = 0.5
LOWEST_DEG = 25.0
PAST_NO_POLE_DEG = 85.0
SLIPS, THROWS = (-2.0, -0.7), (0.6, 1.8)
"""Decimal powers of how far, degrees. What lies between looks like axes that run away: safety stops those."""
WITHIN_S = 2.0
STEP_S = 0.005


class Moving(NamedTuple):
    """An axis: where it is, degrees, and how fast it turns, degrees a second."""

    position_deg: float
    rate_deg_s: float


def least_s(begin: Moving, end: Moving, axis: AxisLimits) -> float:
    """Return the least time from one place and rate to another, within a rate and an acceleration.

    Bang-bang with a cruise: full acceleration to a peak, and from there to the end's rate.
    """
    top = max(axis.slew_rate_deg_s, axis.max_rate_deg_s)
    full = axis.max_acceleration_deg_s2
    way, first, last = end.position_deg - begin.position_deg, begin.rate_deg_s, end.rate_deg_s
    straight = 0.5 * (last + first) * abs(last - first) / full
    if way < straight:
        way, first, last = -way, -first, -last
    peak = math.sqrt(max(0.0, full * way + 0.5 * (first * first + last * last)))
    peak = min(top, max(peak, first, last))
    ramps = ((peak * peak - first * first) + (peak * peak - last * last)) / (2.0 * full)
    return (2.0 * peak - first - last) / full + max(0.0, way - ramps) / peak if peak else 0.0


@dataclass(frozen=True)
class Draw:
    """One satellite, site, mount and what happens to it."""

    kind: str
    subject: Subject
    start: StartPosition
    thrown_deg: tuple[float, float]
    seed: int

    @property
    def begin_s(self) -> float:
        return self.subject.facts.started_utc_s


def draw(number: int, seed: int) -> Draw:
    """Draw a geometry whose satellite stays up, and away from the pole's keyhole, for as long as it lasts."""
    rng = random.Random(f"{seed} {number}")
    kind = KINDS[number % len(KINDS)]
    while True:
        orbit = drawn_orbit(rng, (12.5, 15.6))
        begin_s, propagator = orbit[2], Propagator(*orbit[:2])
        begins_s = begin_s + (RISES_AFTER_S if kind == KINDS[0] else 0.0)
        if _stays_up(propagator, begins_s, begins_s + LASTS_S):
            break
    facts = airless_facts(orbit, (begins_s, begins_s + 600.0), MountProfile(), mount_name="sim")
    subject = Subject(kind, facts, propagator)
    start = StartPosition(rng.uniform(-90.0, 90.0), rng.uniform(-30.0, 85.0))
    far = 10.0 ** (rng.uniform(*SLIPS) if rng.random() < 0.5 else rng.uniform(*THROWS))
    turn = rng.uniform(0.0, 2.0 * math.pi)
    dec = float(propagator.at(Utc(begin_s + THROWN_AFTER_S)).dec_deg)
    # Thrown past a pole it would stand on its other side, which is for safety to notice.
    to_dec = max(-PAST_NO_POLE_DEG, min(PAST_NO_POLE_DEG, dec + 0.5 * far * math.sin(turn)))
    return Draw(kind, subject, start, (far * math.cos(turn), to_dec - dec), number)


def _stays_up(propagator: Propagator, begin_s: float, end_s: float) -> bool:
    seen = [propagator.at(Utc(t)) for t in (begin_s, 0.5 * (begin_s + end_s), end_s)]
    high = all(float(one.alt_deg) > LOWEST_DEG for one in seen)
    rates = [abs(float(one.ra_rate_deg_s)) for one in seen]
    hour_angles = [hour_angle_deg(propagator, t) for t in (begin_s, end_s)]
    # Not through the lower meridian either, where the cables end.
    return high and max(rates) < 4.0 and abs(hour_angles[0] - hour_angles[1]) < 150.0


class Thrown(World):
    """A world whose mount may be thrown off at an instant: its axes turn at once by so much."""

    def __init__(self, drawn: Draw, mount: SimulatedMount) -> None:
        span = drawn.begin_s, drawn.subject.facts.plan.start_utc_s + LASTS_S
        scenario = Scenario(drawn.kind, (0.0, 0.0))
        super().__init__(scenario, mount, drawn.subject.propagator, span, drawn.seed)
        self._drawn = drawn
        self.target = self._seen
        self.thrown: tuple[float, Moving, Moving] | None = None

    def _seen(self, utc_s: float) -> Direction:
        self._throw(utc_s)
        return self.propagator.at(Utc(utc_s))

    def _throw(self, utc_s: float) -> None:
        drawn = self._drawn
        lasts_s = {KINDS[3]: 0.0, KINDS[4]: ABORTED_FOR_S}.get(drawn.kind, math.inf)
        if self.thrown is not None or utc_s < drawn.begin_s + THROWN_AFTER_S + lasts_s:
            return
        ends = []
        for axis, by_deg in zip((self.mount._ra.axis, self.mount._dec.axis), drawn.thrown_deg, strict=True):
            if drawn.kind == KINDS[3]:
                axis.place(axis.position_deg + by_deg, axis.velocity_deg_s)
            ends.append(Moving(axis.position_deg, axis.velocity_deg_s))
        self.thrown = (utc_s, ends[0], ends[1])

    def _judge(self, truth: Any) -> None:
        """Note the error, and end the run where it has stayed within bounds for long enough."""
        super()._judge(truth)
        since_s = self._drawn.begin_s if self._drawn.kind not in KINDS[3:] else math.inf
        if self.thrown is not None:
            since_s = self.thrown[0]
        if _on_target_s(self.errors[-LAST_ERRORS:], since_s) < math.inf:
            self.end_s = truth.utc_s

    def _disturbed(self, data: bytes, now_s: float) -> bytes:
        """Put somebody else's abort in the place of what is sent while it lasts."""
        since_s = now_s - self._drawn.begin_s - THROWN_AFTER_S
        if self._drawn.kind == KINDS[4] and 0.0 <= since_s < ABORTED_FOR_S:
            return encode_command(Command(1, abort=True))
        return data


@dataclass(frozen=True)
class Outcome:
    """Seconds from the run's beginning (or from being thrown off): the bound, and on target for good."""

    kind: str
    bound_s: float
    on_target_s: float

    @property
    def lost_s(self) -> float:
        return self.on_target_s - self.bound_s


def run(drawn: Draw) -> Outcome:
    """Run one draw."""
    facts = drawn.subject.facts
    site = SimulatedSite(facts.site.latitude_deg, facts.site.longitude_deg, 0.0)
    start = drawn.start
    if drawn.kind in KINDS[3:]:
        target = drawn.subject.propagator.at(Utc(drawn.begin_s))
        start = StartPosition(hour_angle_deg(drawn.subject.propagator, drawn.begin_s), float(target.dec_deg))
    scenario = Scenario(drawn.kind, (0.0, 0.0))
    mount = SimulatedMount(MountProfile(), site, start, hardware(scenario, drawn.seed))
    if drawn.kind == KINDS[2]:
        _abort(mount, drawn.begin_s)
    world = Thrown(drawn, mount)
    first = (
        Moving(start.hour_angle_deg, 0.0 if drawn.kind == KINDS[2] else SIDEREAL_RATE_DEG_S),
        Moving(start.dec_deg, 0.0),
    )
    world.run(Ours(drawn.subject, scenario))
    begin_s, axes = drawn.begin_s, first
    if world.thrown is not None:
        begin_s, axes = world.thrown[0], world.thrown[1:]
    bound_s = _bound_s(drawn, begin_s, axes)
    return Outcome(drawn.kind, bound_s, _on_target_s(world.errors, begin_s) - begin_s)


def _abort(mount: SimulatedMount, begin_s: float) -> None:
    """Let somebody have stopped the mount before."""
    for turn, stop in enumerate((False, True, True, False, False)):
        mount.receive(encode_command(Command(turn, abort=stop)))
        mount.tick(begin_s - 1.0 + 0.05 * turn)


def _bound_s(drawn: Draw, begin_s: float, axes: tuple[Moving, ...]) -> float:
    """Return the earliest instant after `begin_s` at which both axes can be with the satellite."""
    profile, propagator = drawn.subject.facts.profile, drawn.subject.propagator
    needed_s = max(0.0, drawn.subject.facts.plan.start_utc_s - begin_s)
    while True:
        utc_s = begin_s + needed_s
        seen = propagator.at(Utc(utc_s))
        ends = (
            Moving(hour_angle_deg(propagator, utc_s), SIDEREAL_RATE_DEG_S - float(seen.ra_rate_deg_s)),
            Moving(float(seen.dec_deg), float(seen.dec_rate_deg_s)),
        )
        takes_s = max(
            least_s(first, last, limits)
            for first, last, limits in zip(axes, ends, (profile.ra, profile.dec), strict=True)
        )
        if takes_s <= needed_s:
            return needed_s
        needed_s += max(STEP_S, 0.2 * (takes_s - needed_s))


def _on_target_s(errors: list[tuple[float, float]], begin_s: float) -> float:
    """Return the first instant from which the error stays within bounds for STAYS_S; infinity for none."""
    since_s = math.inf
    for utc_s, error in errors:
        if utc_s < begin_s or error > ON_TARGET_ARCSEC:
            since_s = math.inf
        else:
            since_s = min(since_s, utc_s)
            if utc_s - since_s >= STAYS_S:
                return since_s
    return math.inf


def outcomes(numbers: range, seed: int, progress: Callable[[int], None] = lambda _: None) -> list[Outcome]:
    """Run the draws of these numbers."""
    done = []
    for number in numbers:
        done.append(run(draw(number, seed)))
        progress(len(done))
    return done


def table(done: list[Outcome]) -> list[str]:
    """Return the figures, a line each."""
    lines = [f"{'start':18} {'draws':>5} {'median':>8} {'worst':>8}   within {WITHIN_S:g} s of the earliest"]
    for kind in KINDS:
        lost = sorted(one.lost_s for one in done if one.kind == kind)
        if lost:
            within = sum(seconds <= WITHIN_S for seconds in lost)
            lines.append(f"{kind:18} {len(lost):5} {lost[len(lost) // 2]:7.2f}s {lost[-1]:7.2f}s   {within}")
    return lines


def main() -> None:
    draws = int(sys.argv[1]) if len(sys.argv) > 1 else 400
    seed = int(sys.argv[2]) if len(sys.argv) > 2 else 1

    def tell(done: int) -> None:
        if sys.stderr.isatty():
            print(f"\r{done} of {draws}", end="", file=sys.stderr, flush=True)

    done = outcomes(range(draws), seed, tell)
    if sys.stderr.isatty():
        print("\r\x1b[K", end="", file=sys.stderr)
    print("\n".join(table(done)))


if __name__ == "__main__":
    main()
