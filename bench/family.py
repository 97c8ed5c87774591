"""A family of mounts drawn at random, each followed for a minute in virtual time.

python bench/family.py [--draws N] [--first N] [--jobs N] [--told TOLD] [--only KIND] [--oracle] [--all]
    [--stalls S] [--unanswered]

The mounts are those of `bench/strangers`, written from the protocol's paper without sight of this program,
and the package's own simulator. A draw is a satellite, a site, a mount that stands somewhere, its servo,
timer and link, and what the profile says of them: acceleration wrong by up to a factor of two, gain by 3 %,
each delay by up to 20 ms. The judge is the mount's own account of its axes. What the wrong date of the
samples makes is known (rate times its error), and is taken off: no datagram tells it.

With `--oracle` each draw is followed by one that knows the mount as well: delays, gains and acceleration, and
from a pass before this one how the servo answers. It has the same link, timer and encoders, and its statuses
are lost or late as those of the other were. So the ratio is what it costs not to know the mount; it says
nothing of what another control law could do.
"""

from __future__ import annotations

import argparse
import importlib
import math
import multiprocessing
import random
import statistics
import sys
from dataclasses import dataclass, field, replace
from heapq import heappop, heappush
from typing import TYPE_CHECKING, Any, NamedTuple

from acquisition import Moving, least_s
from feeder_harness import Timer as WindowsTimer
from random_passes import airless_facts, drawn_orbit, hour_angle_deg

from sattrack.control.target import TargetState, sky_error
from sattrack.core.angles import wrap180
from sattrack.mount.model import SIDEREAL_RATE_DEG_S, AxisLimits, MountProfile
from sattrack.mount.simulator.mount import SimulatedMount, SimulatedSite, StartPosition
from sattrack.mount.simulator.profile import ServoSettings, SimulatorProfile
from sattrack.mount.xerxes.session import REPEAT_AFTER_PERIODS
from sattrack.runtime.facts import build_engine
from tle.instants import Utc
from tle.propagator import Propagator

if TYPE_CHECKING:
    from collections.abc import Callable

    from tle.site import Site


KINDS = ("velocity_servo", "position_servo", "planner", "own")
FLEXIBLE = "flexible"
"""The fourth of `bench/strangers`, drawn by `--only` alone."""
ALL_KINDS = (*KINDS, FLEXIBLE)
PERIOD_S = 0.05
LASTS_S = 75.0
LOOKS = 30
RISES_AFTER_S = 25.0
LOWEST_DEG = 12.0
SETTLED_S = 10.0
LOST_FOR_S, OFF_ARCSEC = 5.0, 10.0
SOON_S = 5.0
ON_TARGET_ARCSEC = 2.0
BREAKS_LOOSE_DEG = 1.0 / 3600.0
"""Error at which the stiffest stiction that is drawn lets go."""
STAYS_S = 1.0
LEAST_ORACLE_ARCSEC = 0.01
"""About what the encoders that are drawn allow: errors below it are not compared."""


class Axes(NamedTuple):
    """Where a mount's axes really are, and what it would report without noise; degrees."""

    utc_s: float
    hour_angle_deg: float
    dec_axis_deg: float
    hour_angle_rate_deg_s: float
    dec_rate_deg_s: float
    ra_deg: float
    dec_deg: float


@dataclass(frozen=True)
class Hardware:
    """What is drawn of a mount and its link; delays one way, seconds."""

    kind: str
    bandwidth_hz: float
    damping: float
    feedforward: float
    acceleration_deg_s2: float
    gains: tuple[float, float]
    move_axis: str
    additive: bool
    signs: tuple[int, int]
    timer: str
    stiction: float
    ripple: float
    command_delay_s: float
    status_delay_s: float
    jitter_s: float
    loss: float
    told_command_s: float
    told_status_s: float
    told_acceleration_deg_s2: float
    max_rate_deg_s: float = 6.0
    tracking: bool = True
    stall_s: float = 0.0
    acknowledges: bool = True
    """Whether MoveAxis is acknowledged; by no `own` mount it is left unanswered."""


@dataclass(frozen=True)
class Draw:
    """One run: what is followed from where with what."""

    number: int
    joined: bool
    elements: Any
    site: Site
    begin_s: float
    start_s: float
    stands: tuple[float, float]
    hardware: Hardware


def draw(number: int, kinds: tuple[str, ...] = KINDS) -> Draw:
    """Draw a run; the same number gives the same run."""
    rng = random.Random(f"family {number}")
    hardware = _hardware(rng, kinds[number % len(kinds)])
    joined = rng.random() < 0.5
    while True:
        elements, site, begin_s = drawn_orbit(rng, (13.5, 15.9))
        start_s = begin_s if joined else begin_s + RISES_AFTER_S
        propagator = Propagator(elements, site)
        if _possible(propagator, start_s, start_s + LASTS_S):
            break
    seen = propagator.at(Utc(start_s))
    hour_angle = hour_angle_deg(propagator, start_s) + rng.uniform(-20.0, 20.0)
    dec = max(-80.0, min(80.0, float(seen.dec_deg) + rng.uniform(-20.0, 20.0)))
    return Draw(number, joined, elements, site, begin_s, start_s, (hour_angle, dec), hardware)


def _hardware(rng: random.Random, kind: str) -> Hardware:
    acceleration = math.exp(rng.uniform(math.log(2.0), math.log(20.0)))
    delays = rng.uniform(0.0, 0.08), rng.uniform(0.0, 0.08)
    told = [max(0.0, delay + rng.uniform(-0.02, 0.02)) for delay in delays]
    bandwidth_hz = math.exp(rng.uniform(0.0, math.log(40.0)))
    # An axis that sticks until its servo is off by more than what counts as on target is never held there.
    most_stiction = min(0.3, (2.0 * math.pi * bandwidth_hz) ** 2 * BREAKS_LOOSE_DEG)
    return Hardware(
        kind=kind,
        bandwidth_hz=bandwidth_hz,
        damping=rng.uniform(0.5, 1.2),
        feedforward=rng.uniform(0.0, 1.0),
        acceleration_deg_s2=acceleration,
        gains=(rng.uniform(0.97, 1.03), rng.uniform(0.97, 1.03)),
        move_axis=rng.choice(("held", "held", "edge")),
        additive=rng.random() < 0.7,
        signs=(rng.choice((1, -1)), rng.choice((1, -1))),
        timer=rng.choice(("even", "windows")),
        stiction=rng.choice((0.0, rng.uniform(0.0, most_stiction))),
        ripple=rng.choice((0.0, rng.uniform(0.0, 0.1))),
        command_delay_s=delays[0],
        status_delay_s=delays[1],
        jitter_s=rng.choice((0.0, rng.uniform(0.0, 0.01))),
        loss=rng.choice((0.0, rng.uniform(0.0, 0.03))),
        told_command_s=told[0],
        told_status_s=told[1],
        told_acceleration_deg_s2=acceleration * 2.0 ** rng.uniform(-1.0, 1.0),
    )


def _possible(propagator: Propagator, begin_s: float, end_s: float) -> bool:
    instants = [begin_s + k * (end_s - begin_s) / LOOKS for k in range(LOOKS + 1)]
    seen = [propagator.at(Utc(utc_s)) for utc_s in instants]
    high = all(float(one.alt_deg) > LOWEST_DEG for one in seen)
    # Past the pole no mount is fast enough, and through the lower meridian the cables end.
    rates = [abs(float(one.ra_rate_deg_s)) for one in seen]
    turns = [abs(hour_angle_deg(propagator, utc_s)) for utc_s in instants]
    return high and max(rates) < 3.0 and max(turns) < 150.0


def parameters_of(hard: Hardware) -> dict[str, Any]:
    """Return what the mounts of `bench/strangers` take of it."""
    return {
        "bandwidth_hz": hard.bandwidth_hz,
        "damping": hard.damping,
        "feedforward": hard.feedforward,
        "acceleration_deg_s2": hard.acceleration_deg_s2,
        "max_rate_deg_s": hard.max_rate_deg_s,
        "ra_gain": hard.gains[0],
        "dec_gain": hard.gains[1],
        "ra_sign": hard.signs[0],
        "dec_sign": hard.signs[1],
        "move_axis": hard.move_axis,
        "move_ack": hard.acknowledges,
        "additive": hard.additive,
        "timer": hard.timer,
        "timer_jitter_s": 0.0005,
        "stall_s": hard.stall_s,
        "stiction": hard.stiction,
        "friction": 0.5 * hard.stiction,
        "ripple": hard.ripple,
    }


def servo_of(hard: Hardware) -> ServoSettings:
    """Return what the package's simulator takes of it."""
    return ServoSettings(
        bandwidth_hz=hard.bandwidth_hz,
        damping=hard.damping,
        integral_hz=0.1 * hard.bandwidth_hz,
        friction_a=0.15 * hard.stiction,
        stiction_a=0.3 * hard.stiction,
        friction_feedforward=hard.feedforward,
        ripple_a=0.15 * hard.ripple,
    )


class Stranger:
    """One of the mounts of `bench/strangers`."""

    def __init__(self, drawn: Draw) -> None:
        hard = drawn.hardware
        module = importlib.import_module(f"strangers.{hard.kind}")
        self._mount = module.Mount(
            module.Parameters(
                latitude_deg=drawn.site.latitude_deg,
                longitude_deg=drawn.site.longitude_deg,
                start_utc_s=drawn.begin_s - 1.0,
                hour_angle_deg=drawn.stands[0],
                dec_deg=drawn.stands[1],
                tracking=hard.tracking,
                seed=drawn.number,
                **parameters_of(hard),
            )
        )

    @property
    def next_turn_s(self) -> float:
        return float(self._mount.next_turn_s)

    def receive(self, data: bytes) -> None:
        self._mount.receive(data)

    def turn(self) -> bytes:
        return bytes(self._mount.turn())

    def truth(self) -> Axes:
        return Axes(*self._mount.truth())


class Own:
    """The package's simulated mount."""

    def __init__(self, drawn: Draw) -> None:
        hard = drawn.hardware
        axis = AxisLimits(max_acceleration_deg_s2=hard.acceleration_deg_s2, slew_rate_deg_s=6.0)
        profile = MountProfile(
            ra=axis,
            dec=axis,
            ra_rate_gain=hard.gains[0],
            dec_rate_gain=hard.gains[1],
            ra_rate_sign=hard.signs[0],
            dec_rate_sign=hard.signs[1],
            move_axis=hard.move_axis,
            additive=hard.additive,
        )
        settings = SimulatorProfile(
            clock_offset_s=0.0, encoder_noise_tics=0.5, servo=servo_of(hard), seed=drawn.number
        )
        site = SimulatedSite(drawn.site.latitude_deg, drawn.site.longitude_deg, 0.0)
        self._mount = SimulatedMount(profile, site, StartPosition(*drawn.stands), settings)
        self._timer = WindowsTimer(drawn.begin_s - 1.0, random.Random(drawn.number))
        self._even = hard.timer == "even"
        self.next_turn_s = drawn.begin_s - 1.0
        self._truth: Any = None

    def receive(self, data: bytes) -> None:
        self._mount.receive(data)

    def turn(self) -> bytes:
        status, self._truth = self._mount.tick(self.next_turn_s)
        self.next_turn_s = self.next_turn_s + PERIOD_S if self._even else self._timer.following()
        return bytes(status)

    def truth(self) -> Axes:
        t = self._truth
        return Axes(
            t.utc_s,
            t.hour_angle_axis_deg,
            t.dec_axis_deg,
            SIDEREAL_RATE_DEG_S - t.ra_rate_deg_s,
            t.dec_rate_deg_s,
            t.ra_deg,
            t.dec_deg,
        )


def profile_of(hard: Hardware, told: str) -> MountProfile:
    """Return what the program is told of a mount: the default with rough or true delays, or what is true."""
    known, dated = told == "truth", told != "default"
    axis = AxisLimits(
        max_acceleration_deg_s2=hard.acceleration_deg_s2 if known else hard.told_acceleration_deg_s2,
        slew_rate_deg_s=6.0,
    )
    return MountProfile(
        name=told,
        ra=axis,
        dec=axis,
        ra_rate_sign=hard.signs[0],
        dec_rate_sign=hard.signs[1],
        ra_rate_gain=hard.gains[0] if known else 1.0,
        dec_rate_gain=hard.gains[1] if known else 1.0,
        additive=hard.additive,
        move_axis=hard.move_axis,
        command_delay_s=hard.command_delay_s + 0.5 * hard.jitter_s if dated else hard.told_command_s,
        status_delay_s=hard.status_delay_s if dated else hard.told_status_s,
    )


class Error(NamedTuple):
    """The error on the sky at one of the mount's turns, arcseconds, the wrong date's share taken off."""

    utc_s: float
    total_arcsec: float
    raw_arcsec: float


@dataclass
class Run:
    """One draw, run to its end; `profile` in place of what is told, where there is one.

    Statuses are lost and late as in the run `like`, where there is one.
    """

    drawn: Draw
    told: str = "default"
    profile: MountProfile | None = None
    like: Run | None = None
    errors: list[Error] = field(default_factory=list)
    ended_by: str | None = None
    message: str | None = None
    late_s: list[float] = field(default_factory=list)
    """By how much each status came late, beyond the delay; infinite where it was lost."""

    def __post_init__(self) -> None:
        drawn = self.drawn
        self.propagator = Propagator(drawn.elements, drawn.site)
        self.profile = self.profile or profile_of(drawn.hardware, self.told)
        orbit = drawn.elements, drawn.site, drawn.begin_s
        facts = airless_facts(orbit, (drawn.start_s, drawn.start_s + 600.0), self.profile)
        self.engine = build_engine(facts)
        self.mount = Own(drawn) if drawn.hardware.kind == "own" else Stranger(drawn)
        self._rng = random.Random(f"link {drawn.number}")
        self._queue: list[tuple[float, int, Callable[..., None], Any]] = []
        self._order = 0
        # Samples are dated by the fastest arrivals: earlier than they were by what is told too much.
        self.dated_late_s = drawn.hardware.status_delay_s - self.profile.status_delay_s

    def run(self, watch: Callable[[Run, float], None] | None = None, lasts_s: float = LASTS_S) -> Run:
        drawn, end_s = self.drawn, self.drawn.start_s + lasts_s
        self._at(self.mount.next_turn_s, self._mount_turn, None)
        self._at(drawn.begin_s + self._rng.uniform(0.0, PERIOD_S), self._client_turn, None)
        if self.like is not None:
            # Chances that statuses had in the other run must not fall to the commands that follow them here.
            self._rng = random.Random(f"commands {drawn.number}")
        now_s = drawn.begin_s
        while self._queue and now_s < end_s and self.ended_by is None:
            now_s, _, happen, what = heappop(self._queue)
            happen(now_s, what)
            if watch is not None and happen == self._client_turn:
                watch(self, now_s)
        return self

    def _at(self, utc_s: float, happen: Callable[..., None], what: Any) -> None:
        self._order += 1
        heappush(self._queue, (utc_s, self._order, happen, what))

    def _lateness_s(self) -> float:
        """Draw by how much a datagram comes late; infinite where it is lost."""
        hard = self.drawn.hardware
        return self._rng.uniform(0.0, hard.jitter_s) if self._rng.random() >= hard.loss else math.inf

    def _command(self, now_s: float, data: bytes) -> None:
        self._carry(now_s + self.drawn.hardware.command_delay_s + self._lateness_s(), self._arrives, data)

    def _carry(self, utc_s: float, happen: Callable[..., None], data: bytes) -> None:
        if utc_s < math.inf:
            self._at(utc_s, happen, data)

    def _client_turn(self, now_s: float, _: Any) -> None:
        engine = self.engine
        data = engine.tick(now_s)
        self.ended_by, self.message = engine.tracker.ended_by, engine.message
        self._command(now_s, data)
        self._at(now_s + REPEAT_AFTER_PERIODS * PERIOD_S, self._copy, None)
        self._at(now_s + PERIOD_S + engine.send_shift_s(now_s), self._client_turn, None)

    def _copy(self, now_s: float, _: Any) -> None:
        data = self.engine.repeat()
        if data is not None:
            self._command(now_s, data)

    def _arrives(self, _: float, data: bytes) -> None:
        self.mount.receive(data)

    def _mount_turn(self, now_s: float, _: Any) -> None:
        status = self.mount.turn()
        late_s, turn = self._lateness_s(), len(self.late_s)
        if self.like is not None and turn < len(self.like.late_s):
            late_s = self.like.late_s[turn]
        self.late_s.append(late_s)
        self._carry(now_s + self.drawn.hardware.status_delay_s + late_s, self._status, status)
        self._judge(self.mount.truth())
        self._at(self.mount.next_turn_s, self._mount_turn, None)

    def _status(self, now_s: float, data: bytes) -> None:
        self.engine.receive(data, now_s)

    def _judge(self, truth: Axes) -> None:
        fed_s = truth.utc_s + self.dated_late_s
        raw = sky_error(truth.utc_s, truth.ra_deg, truth.dec_deg, self._target(truth.utc_s))
        left = sky_error(truth.utc_s, truth.ra_deg, truth.dec_deg, self._target(fed_s))
        self.errors.append(Error(truth.utc_s, left.total_arcsec, raw.total_arcsec))

    def _target(self, utc_s: float) -> TargetState:
        return TargetState.at(self.propagator.at(Utc(utc_s)))

    def earliest_s(self) -> float:
        """Return the earliest instant at which the mount's rates and acceleration allow it to be there."""
        drawn = self.drawn
        axis = AxisLimits(6.0, drawn.hardware.acceleration_deg_s2, 6.0)
        at = drawn.start_s
        if not drawn.joined:
            return at
        for _ in range(40):
            seen = self.propagator.at(Utc(at))
            ha_rate = SIDEREAL_RATE_DEG_S - float(seen.ra_rate_deg_s)
            ways = (
                least_s(
                    Moving(drawn.stands[0] + SIDEREAL_RATE_DEG_S * (at - drawn.begin_s), SIDEREAL_RATE_DEG_S),
                    Moving(_near(drawn.stands[0], hour_angle_deg(self.propagator, at)), ha_rate),
                    axis,
                ),
                least_s(
                    Moving(drawn.stands[1], 0.0),
                    Moving(float(seen.dec_deg), float(seen.dec_rate_deg_s)),
                    axis,
                ),
            )
            at = drawn.begin_s + max(ways)
        return at

    def outcome(self) -> Outcome:
        acquired = self.engine.tracker.acquired_utc_s
        earliest_s = self.earliest_s()
        if acquired is None:
            return Outcome(self.drawn, None, math.nan, math.nan, math.nan, False, self._why())
        late_s = self._on_target_s() - earliest_s
        settled = [e for e in self.errors if e.utc_s >= acquired + SETTLED_S]
        rms = self.settled_rms_arcsec()
        raw = math.sqrt(statistics.fmean(e.raw_arcsec**2 for e in settled)) if settled else math.nan
        peak = max((e.total_arcsec for e in settled), default=math.nan)
        return Outcome(self.drawn, late_s, rms, peak, raw, _stays_off(settled), self._why())

    def settled_rms_arcsec(self) -> float:
        """Return the RMS of the errors from SETTLED_S after the acquisition; NaN without one."""
        acquired = self.engine.tracker.acquired_utc_s
        settled = [] if acquired is None else [e for e in self.errors if e.utc_s >= acquired + SETTLED_S]
        return math.sqrt(statistics.fmean(e.total_arcsec**2 for e in settled)) if settled else math.nan

    def _on_target_s(self) -> float:
        """Return the first instant from which the error stays within bounds for STAYS_S."""
        since_s = math.inf
        for error in self.errors:
            if error.utc_s < self.drawn.start_s or error.total_arcsec > ON_TARGET_ARCSEC:
                since_s = math.inf
            else:
                since_s = min(since_s, error.utc_s)
                if error.utc_s - since_s >= STAYS_S:
                    break
        return since_s

    def _why(self) -> str:
        return "" if self.ended_by is None else f"{self.ended_by}: {self.message}"


def _near(about_deg: float, angle_deg: float) -> float:
    return about_deg + wrap180(angle_deg - about_deg)


def _stays_off(errors: list[Error]) -> bool:
    since_s = None
    for error in errors:
        if error.total_arcsec <= OFF_ARCSEC:
            since_s = None
        elif since_s is None:
            since_s = error.utc_s
        elif error.utc_s - since_s > LOST_FOR_S:
            return True
    return False


@dataclass(frozen=True)
class Outcome:
    """What came of one draw; `late_s` None where it was never acquired."""

    drawn: Draw
    late_s: float | None
    rms_arcsec: float
    peak_arcsec: float
    raw_rms_arcsec: float
    lost: bool
    """Whether it left the target for longer than LOST_FOR_S once it was on it."""
    why: str
    oracle_arcsec: float = math.nan
    """RMS of one that knows the mount; NaN where none was asked for."""

    @property
    def ratio(self) -> float:
        """The RMS over the oracle's, no less than what the encoders allow."""
        return self.rms_arcsec / max(self.oracle_arcsec, LEAST_ORACLE_ARCSEC)

    def line(self) -> str:
        hard = self.drawn.hardware
        late = "  never" if self.late_s is None else f"{self.late_s:7.2f}"
        return (
            f"{self.drawn.number:4d} {hard.kind:14s} {hard.move_axis:4s} {hard.timer:7s} "
            f"{hard.bandwidth_hz:5.1f}Hz ζ{hard.damping:.2f} ff{hard.feedforward:.2f} "
            f"a{hard.acceleration_deg_s2:5.1f}/{hard.told_acceleration_deg_s2:5.1f} "
            f"{1e3 * hard.command_delay_s:3.0f}({1e3 * (hard.told_command_s - hard.command_delay_s):+3.0f})"
            f"+{1e3 * hard.status_delay_s:3.0f}({1e3 * (hard.told_status_s - hard.status_delay_s):+3.0f})ms "
            f"j{1e3 * hard.jitter_s:2.0f} l{100 * hard.loss:.0f}% {'join' if self.drawn.joined else 'rise'}"
            f" late{late} rms{self.rms_arcsec:9.3f} peak{self.peak_arcsec:9.2f} raw{self.raw_rms_arcsec:7.1f}"
            f" {self.why}" + ("" if math.isnan(self.oracle_arcsec) else f" oracle{self.oracle_arcsec:8.3f}")
        )


def oracle_arcsec(run: Run) -> float:
    """Return the RMS of one that knows the mount of a run, from a run before it with the same mount."""
    before, knows = Run(run.drawn, "truth").run(), Run(run.drawn, "truth", like=run)
    axes = before.engine.tracker.follower.axes
    if axes is not None:
        axes.sample_utc_s = -math.inf
        knows.engine.tracker.follower.axes = axes
    return knows.run().settled_rms_arcsec()


def unanswered(drawn: Draw) -> Draw:
    """Return a draw whose mount takes rates by edges, and acknowledges none."""
    return replace(drawn, hardware=replace(drawn.hardware, move_axis="edge", acknowledges=False))


def follow(arguments: tuple[int, argparse.Namespace]) -> Outcome:
    number, options = arguments
    kinds = (options.only,) if options.only is not None else KINDS
    if options.unanswered:
        kinds = tuple(kind for kind in kinds if kind != "own")
    drawn = draw(number, kinds)
    drawn = replace(drawn, hardware=replace(drawn.hardware, stall_s=options.stalls))
    run = Run(unanswered(drawn) if options.unanswered else drawn, options.told).run()
    outcome = run.outcome()
    return replace(outcome, oracle_arcsec=oracle_arcsec(run)) if options.oracle else outcome


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, default=500)
    parser.add_argument("--first", type=int, default=0, help="number of the first draw: its seed")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--told", choices=tuple(TOLD), default="default")
    parser.add_argument("--only", choices=ALL_KINDS)
    parser.add_argument(
        "--stalls", type=float, default=0.0, help="a turn in 8 s is late by up to so many seconds (strangers)"
    )
    parser.add_argument(
        "--unanswered", action="store_true", help="edges only, and none acknowledged (strangers)"
    )
    parser.add_argument("--oracle", action="store_true", help="the RMS of one that knows the mount, too")
    parser.add_argument("--all", action="store_true", help="a line for each draw")
    options = parser.parse_args()
    if options.unanswered and options.only == "own":
        parser.error("--unanswered: the simulator acknowledges every edge; take one of the strangers")
    numbers = range(options.first, options.first + options.draws)
    outcomes = []
    with multiprocessing.Pool(options.jobs) as pool:
        for outcome in pool.imap(follow, [(number, options) for number in numbers]):
            outcomes.append(outcome)
            if options.all:
                print(outcome.line(), flush=True)
            elif sys.stderr.isatty():
                print(f"\r{len(outcomes)} of {options.draws}", end="", file=sys.stderr, flush=True)
    print(f"draws {numbers[0]} to {numbers[-1]}, told {TOLD[options.told]}")
    print("\n".join(table(outcomes)))
    return 0 if all(outcome.late_s is not None for outcome in outcomes) else 1


TOLD = {
    "default": "signs, meaning of MoveAxis and rough delays; acceleration up to twice or half of it, gain 1",
    "delays": "signs, meaning of MoveAxis and delays; acceleration up to twice or half of it, gain 1",
    "truth": "everything but the servo",
}


def table(outcomes: list[Outcome]) -> list[str]:
    """Return the figures, a line for each kind of mount and reading of MoveAxis."""
    lines = [
        f"{'mount':15} {'draws':>5} {'acquired':>8} {'in 5 s':>7} {'median':>7} {'worst':>7}"
        f" {'lost':>4}   RMS: {'median':>7} {'95 %':>7} {'worst':>7}"
        + (f"   over the oracle's: {'median':>6} {'95 %':>6} {'worst':>6}" if _has_oracle(outcomes) else "")
    ]
    rows = [(f"{kind} {move}", kind, move) for kind in ALL_KINDS for move in ("held", "edge")]
    for name, kind, move in [*rows, ("all", None, None)]:
        some = [
            o
            for o in outcomes
            if kind is None or (o.drawn.hardware.kind == kind and o.drawn.hardware.move_axis == move)
        ]
        if some:
            lines.append(_row(NAMES.get(name, name), some))
    return lines


NAMES = {
    f"{kind} {move}": f"{name}, {move}"
    for kind, name in zip(
        ALL_KINDS, ("velocity", "position", "planner", "simulator", "flexible"), strict=True
    )
    for move in ("held", "edge")
}


def _has_oracle(outcomes: list[Outcome]) -> bool:
    return any(not math.isnan(outcome.oracle_arcsec) for outcome in outcomes)


def _row(name: str, some: list[Outcome]) -> str:
    late = sorted(math.inf if o.late_s is None else o.late_s for o in some)
    rms = sorted(math.inf if math.isnan(o.rms_arcsec) else o.rms_arcsec for o in some)
    acquired = sum(o.late_s is not None for o in some)
    soon = 100.0 * sum(seconds <= SOON_S for seconds in late) / len(some)
    lost = sum(o.lost for o in some)
    ratios = sorted(o.ratio for o in some if not math.isnan(o.ratio))

    def at(values: list[float], share: float) -> float:
        return values[min(len(values) - 1, int(share * len(values)))]

    return (
        f"{name:15} {len(some):5} {acquired:8} {soon:6.0f}% {at(late, 0.5):6.2f}s {late[-1]:6.2f}s {lost:4}"
        f"        {at(rms, 0.5):7.3f} {at(rms, 0.95):7.3f} {rms[-1]:7.3f}"
        + (f"{'':22}{at(ratios, 0.5):6.2f} {at(ratios, 0.95):6.2f} {ratios[-1]:6.2f}" if ratios else "")
    )


if __name__ == "__main__":
    sys.exit(main())
