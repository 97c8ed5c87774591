"""Calibration against mounts drawn at random: what it finds against what they are.

python bench/calibration.py [DRAWS [SEED]]

Each draw is a whole run of `sattrack.calibration` against the simulated mount in virtual time, with delays,
a network that scatters and loses, the mount's irregular timer, and a clock that is off and drifts. A second
table is of mounts that were written from the protocol's paper alone (bench/strangers). A mount's truth is
measured on the mount itself, without noise and delays.
"""

from __future__ import annotations

import heapq
import importlib
import math
import sys
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from itertools import pairwise, repeat
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import msgspec
import numpy as np

from sattrack.calibration.calibrator import Calibrator
from sattrack.calibration.findings import Findings, conclude
from sattrack.calibration.guard import CalibrationEndedError, EndKind, Surroundings
from sattrack.mount.model import AxisLimits, MountProfile
from sattrack.mount.simulator.installation import Timer as MountTimer
from sattrack.mount.simulator.installation import Wire, WireLaw
from sattrack.mount.simulator.mount import DOUBTFUL_TYPES, SimulatedMount, SimulatedSite, StartPosition
from sattrack.mount.simulator.profile import ServoSettings, SimulatorProfile
from sattrack.mount.xerxes.datagrams import Command, decode_status, encode_command

if TYPE_CHECKING:
    from collections.abc import Callable

    from sattrack.calibration.motion import AxisMotion

SITE = SimulatedSite(52.0, 4.5, 0.0)
SLICE_S = 0.015625
"""Windows looks for expired timers at multiples of this."""


class Loop(Protocol):
    """A mount: a mailbox and a loop, at instants of true time."""

    def receive(self, data: bytes) -> object: ...

    def tick(self, now_utc_s: float) -> bytes: ...


class Wires(Protocol):
    """Two ways: what arrives of a datagram, as (seconds after it was sent, bytes)."""

    def command(self, data: bytes, rng: np.random.Generator) -> list[tuple[float, bytes]]: ...

    def status(self, data: bytes, rng: np.random.Generator) -> list[tuple[float, bytes]]: ...


class Turns(Protocol):
    """When the mount's loop turns."""

    def after(self, last_s: float, rng: np.random.Generator) -> float: ...


@dataclass
class Network:
    """Two ways with their own least delays; `jitter_s` is the mean of what is added, exponentially."""

    command_s: float = 0.0
    status_s: float = 0.0
    jitter_s: float = 0.0
    loss: float = 0.0

    def command(self, data: bytes, rng: np.random.Generator) -> list[tuple[float, bytes]]:
        return self._carry(self.command_s, data, rng)

    def status(self, data: bytes, rng: np.random.Generator) -> list[tuple[float, bytes]]:
        return self._carry(self.status_s, data, rng)

    def _carry(self, least_s: float, data: bytes, rng: np.random.Generator) -> list[tuple[float, bytes]]:
        if self.loss and rng.random() < self.loss:
            return []
        late_s = float(rng.exponential(self.jitter_s)) if self.jitter_s else 0.0
        return [(least_s + late_s, data)]


@dataclass
class Timer:
    """When the mount's loop turns: "even", "windows" (multiples of 1/64 s) or "loose" (normal scatter)."""

    law: str = "even"
    period_s: float = 0.05
    scatter_s: float = 0.002
    phase_s: float = 0.0

    def after(self, last_s: float, rng: np.random.Generator) -> float:
        if self.law == "windows":
            late = float(rng.uniform(0.0, 0.0005))
            return (math.floor((last_s + self.period_s) / SLICE_S) + 1) * SLICE_S + late
        if self.law == "loose":
            return last_s + max(0.02, self.period_s + float(rng.normal(0.0, self.scatter_s)))
        return last_s + self.period_s


@dataclass
class VirtualRun:
    """One calibrator and one mount in virtual time: a heap of events, and nothing that waits."""

    calibrator: Calibrator
    mount: Loop
    network: Wires
    timer: Turns
    rng: np.random.Generator
    begin_utc_s: float
    watch: Callable[[float, Calibrator], None] | None = None
    commands: list[tuple[float, bytes]] = field(default_factory=list)
    cut: tuple[float, float] = (math.inf, math.inf)
    """Seconds of the run between which no status arrives."""
    now_utc_s: float = 0.0

    def run(self) -> float:
        """Run to the end; return how long it took, seconds of virtual time."""
        events: list[tuple[float, int, str, bytes]] = []
        count = 0

        def put(at: float, kind: str, data: bytes = b"") -> None:
            nonlocal count
            count += 1
            heapq.heappush(events, (at, count, kind, data))

        put(self.timer.after(self.begin_utc_s, self.rng), "tick")
        while self.calibrator.ending is None:
            due = self.calibrator.due()
            if due <= events[0][0]:
                self.now_utc_s = due = max(due, self.now_utc_s)
                if self.watch is not None:
                    self.watch(due, self.calibrator)
                data = self.calibrator.tick(due)
                self.commands.append((due, data))
                for late_s, arrived in self.network.command(data, self.rng):
                    put(due + late_s, "command", arrived)
                self.calibrator.sent(due)
                continue
            at, _, kind, data = heapq.heappop(events)
            self.now_utc_s = at
            if kind == "tick":
                status = self.mount.tick(at)
                if not self.cut[0] <= at - self.begin_utc_s < self.cut[1]:
                    for late_s, arrived in self.network.status(status, self.rng):
                        put(at + late_s, "status", arrived)
                put(self.timer.after(at, self.rng), "tick")
            elif kind == "command":
                self.mount.receive(data)
            else:
                self.calibrator.receive(data, at)
        return self.now_utc_s - self.begin_utc_s


@dataclass
class SimulatedWires:
    """The simulator's own two ways."""

    out: Wire
    back: Wire

    def command(self, data: bytes, _: np.random.Generator) -> list[tuple[float, bytes]]:
        return self.out.carry(data)

    def status(self, data: bytes, _: np.random.Generator) -> list[tuple[float, bytes]]:
        return self.back.carry(data)


@dataclass
class SimulatedTurns:
    """The simulator's own timer."""

    timer: MountTimer

    def after(self, last_s: float, _: np.random.Generator) -> float:
        return self.timer.next(last_s)


@dataclass
class SimulatedLoop:
    """The simulated mount."""

    mount: SimulatedMount

    def receive(self, data: bytes) -> bool:
        return self.mount.receive(data)

    def tick(self, now_utc_s: float) -> bytes:
        return self.mount.tick(now_utc_s)[0]


@dataclass(frozen=True)
class Drawn:
    """One mount as it is, and where it stands."""

    profile: MountProfile
    hardware: SimulatorProfile
    start: StartPosition
    beyond_pole: bool
    loss: float
    begin_utc_s: float


def draw(number: int, seed: int) -> Drawn:
    """Draw a mount: everything uniform within its bounds, and each choice as likely as the others."""
    rng = np.random.default_rng([seed, number])

    def uniform(low: float, high: float) -> float:
        return float(rng.uniform(low, high))

    def one_of(*choices: Any) -> Any:
        return choices[int(rng.integers(len(choices)))]

    beyond = one_of(True, False)
    hour_angle, dec = uniform(-40.0, 40.0), uniform(10.0, 70.0)
    friction, hunts = uniform(0.2, 1.5), one_of(True, False)
    profile = MountProfile(
        ra=AxisLimits(max_acceleration_deg_s2=uniform(3.0, 20.0)),
        dec=AxisLimits(max_acceleration_deg_s2=uniform(3.0, 20.0)),
        ra_rate_sign=one_of(-1, 1),
        dec_rate_sign=one_of(-1, 1),
        ra_rate_sign_beyond_pole=one_of(-1, 1),
        dec_rate_sign_beyond_pole=one_of(-1, 1),
        ra_rate_gain=uniform(0.9, 1.1),
        dec_rate_gain=uniform(0.9, 1.1),
        additive=one_of(True, False),
        move_axis=one_of("held", "edge"),
        readings={name: one_of("int64", "double") for name in DOUBTFUL_TYPES},
    )
    hardware = SimulatorProfile(
        clock_offset_s=uniform(-10.0, 10.0),
        clock_drift_ppm=uniform(-50.0, 50.0),
        timer=one_of("exact", "windows", "windows_rearmed"),
        timer_drift_ppm=uniform(-200.0, 200.0),
        command_delay_s=uniform(0.0, 0.08),
        command_jitter_s=one_of(0.0, 0.0005, 0.002),
        status_delay_s=uniform(0.0, 0.08),
        status_jitter_s=one_of(0.0, 0.0005, 0.002),
        servo=ServoSettings(
            bandwidth_hz=uniform(3.0, 15.0),
            damping=uniform(0.7, 1.3),
            # With an integral part and friction that is not fed forward, these axes hunt and never rest.
            integral_hz=0.0 if hunts else uniform(0.2, 1.0),
            friction_a=friction,
            stiction_a=friction * uniform(1.0, 1.5),
            friction_feedforward=uniform(0.7, 1.0) if hunts else 1.0,
            ripple_a=uniform(0.0, 0.1),
        ),
        settling_arcsec=uniform(0.0, 2.0),
        encoder_noise_tics=uniform(0.0, 2.0),
        seed=number,
    )
    start = StartPosition(hour_angle, dec)
    if beyond:
        start = StartPosition(hour_angle - 180.0 if hour_angle > 0.0 else hour_angle + 180.0, 180.0 - dec)
    return Drawn(profile, hardware, start, beyond, one_of(0.0, 0.01), 1.79e9 + uniform(0.0, 86400.0))


STEADY_S, STOPS_S, PLATEAU_S = 3.0, 3.0, 8.0
STOPS = 12
LAG_STEPS, LAG_STEPS_LATER_S = 8, 0.0637
REACHED, REACHED_FOR_S = 0.95, 0.015
BEGUN_AGAIN_S = 0.3


@dataclass(frozen=True)
class AxisTruth:
    """What a mount's declination axis does in stops from a rate, and its lag."""

    limit_deg_s2: float
    """The largest acceleration that it does: its limit, or what it comes to where it does not reach that."""
    reached: bool
    """Whether it comes to its limit."""
    by_distance_deg_s2: float
    """rate^2 / (2 distance), of the mean distance."""
    rate_deg_s: float
    farthest_deg: float
    """The longest of the distances."""
    lag_s: float


class Looked(NamedTuple):
    """A look at a mount: when, where its declination axis is, how fast, and whether it tells of an abort."""

    utc_s: float
    deg: float
    deg_s: float
    aborts: bool


@dataclass
class Probe:
    """A mount without noise or delays that is told rates, and looked at after each of its turns."""

    receive: Callable[[bytes], object]
    turn: Callable[[], Looked]
    held: bool = True
    counter: int = 0

    def say(self, seconds: float, **said: Any) -> list[Looked]:
        """Say one thing for so long; return what was seen."""
        self.counter += 1
        self.receive(encode_command(Command(self.counter, **said)))
        seen = [self.turn()]
        while seen[-1].utc_s < seen[0].utc_s + seconds:
            seen.append(self.turn())
        return seen

    def move(self, rate_deg_s: float, seconds: float) -> list[Looked]:
        """Move at a rate, by an edge of the flag where the mount wants that."""
        if not self.held:
            self.say(0.0)
        return self.say(seconds, move_dec=True, move_dec_rate_deg_s=rate_deg_s)

    def stop(self, rate_deg_s: float) -> list[Looked]:
        """Return a stop from a rate, from the turn on that obeyed it, seconds and places from there."""
        self.move(rate_deg_s, STEADY_S)
        seen = self.say(STOPS_S, abort=True)
        self.say(BEGUN_AGAIN_S)
        seen = seen[next(i for i, one in enumerate(seen) if one.aborts) :]
        way = math.copysign(1.0, seen[0].deg_s)
        first = seen[0]
        return [
            one._replace(
                utc_s=one.utc_s - first.utc_s, deg=way * (one.deg - first.deg), deg_s=way * one.deg_s
            )
            for one in seen
        ]

    def lag_s(self) -> float:
        """Return by how much later than told small steps of the rate are taken."""
        lags = []
        before = self.move(0.10, PLATEAU_S)[-1]
        # A loop that turns in a pattern is met at every place of it.
        for number in range(LAG_STEPS):
            for rate in (0.12, 0.10):
                seen = self.move(rate, PLATEAU_S + LAG_STEPS_LATER_S * number)
                # Edges take a turn to lower the flag, in which the old rate goes on.
                began_s = seen[0].utc_s
                there = before.deg + before.deg_s * (began_s - before.utc_s)
                last = seen[-1]
                missed = there + last.deg_s * (last.utc_s - began_s) - last.deg
                lags.append(missed / (last.deg_s - before.deg_s))
                before = last
        self.say(STOPS_S, abort=True)
        return float(np.mean(lags))


def truth_of(probe: Probe, rate_deg_s: float, limit_deg_s2: float) -> AxisTruth:
    """Measure what a mount's declination axis does when it stops from a rate, and in small steps."""
    probe.say(STOPS_S, abort=True)
    probe.say(BEGUN_AGAIN_S)
    lag_s = probe.lag_s()
    probe.say(BEGUN_AGAIN_S)
    stops = [probe.stop(rate_deg_s * (-1.0) ** n) for n in range(STOPS)]
    ways = [_farthest(stop) for stop in stops]
    seen = np.array(sorted((one.utc_s, one.deg_s) for stop in stops for one in stop if one.utc_s < 1.5))
    shown = 0.0
    for i, (t, v) in enumerate(seen):
        k = int(np.searchsorted(seen[:, 0], t + REACHED_FOR_S))
        if i < k < len(seen):
            shown = max(shown, (v - seen[k, 1]) / (seen[k, 0] - t))
    reached = shown >= REACHED * limit_deg_s2
    from_deg_s = stops[0][0].deg_s
    by_distance = from_deg_s**2 / (2.0 * float(np.mean(ways)))
    limit = limit_deg_s2 if reached else shown
    return AxisTruth(limit, bool(reached), by_distance, abs(from_deg_s), max(ways), lag_s)


def _farthest(stop: list[Looked]) -> float:
    """Return the farthest place of a stop, by cubics through places and rates."""
    farthest = 0.0
    for one, other in pairwise(stop):
        h = other.utc_s - one.utc_s
        for u in (0.0, 0.125, 0.25, 0.375, 0.5, 0.625, 0.75, 0.875, 1.0):
            bend = (2 * u**3 - 3 * u**2) * (one.deg - other.deg)
            slopes = h * ((u**3 - 2 * u**2 + u) * one.deg_s + (u**3 - u**2) * other.deg_s)
            farthest = max(farthest, one.deg + bend + slopes)
    return farthest


@dataclass(frozen=True)
class Judged:
    """One axis: what was found, and what is."""

    kind: str
    value: float | None
    sigma: float | None
    limited: bool
    true: AxisTruth
    lag_s: float | None
    lag_sigma_s: float | None

    @property
    def true_deg_s2(self) -> float:
        """What the value should be, by what it is said to mean."""
        return self.true.limit_deg_s2 if self.limited else self.true.by_distance_deg_s2

    @property
    def stops_too_short(self) -> bool:
        """Whether the stop foretold with the value, less two sigma, and the lag is shorter than it was."""
        if self.value is None or self.sigma is None:
            return False
        way = self.true.rate_deg_s**2 / (2.0 * (self.value - 2.0 * self.sigma))
        return way + self.true.rate_deg_s * max(0.0, self.lag_s or 0.0) < self.true.farthest_deg


def judge_motion(kind: str, motion: AxisMotion, true: AxisTruth) -> Judged:
    """Put an axis' findings beside its truth."""
    found, lag = motion.braking, motion.lag
    return Judged(
        kind,
        found.acceleration_deg_s2 if found else None,
        found.acceleration_sigma_deg_s2 if found else None,
        bool(found and found.limited),
        true,
        lag.seconds if lag else None,
        lag.sigma_s if lag else None,
    )


STRANGERS = {"velocity servo": "velocity_servo", "position servo": "position_servo", "planner": "planner"}


@dataclass
class StrangerLoop:
    """A mount that keeps its own time."""

    mount: Any

    def receive(self, data: bytes) -> object:
        return self.mount.receive(data)

    def tick(self, _: float) -> bytes:
        status: bytes = self.mount.turn()
        return status


@dataclass
class StrangerTurns:
    """Its turns."""

    mount: Any

    def after(self, _: float, __: np.random.Generator) -> float:
        at: float = self.mount.next_turn_s
        return at


@dataclass(frozen=True)
class Stranger:
    """One drawn stranger: the kind, its parameters, and the way there and back."""

    kind: str
    parameters: dict[str, Any]
    network: Network

    def mount(self, **others: Any) -> Any:
        """Return it, with some parameters set to others."""
        module = importlib.import_module(f"strangers.{STRANGERS[self.kind]}")
        return module.Mount(module.Parameters(**{**self.parameters, **others}))

    def truth(self, rate_deg_s: float) -> AxisTruth:
        """Measure what its declination axis does."""
        # Servos do not know of turns: uneven ones show all of a stop. A planner's turns are its steps.
        uneven = {} if self.kind == "planner" else {"timer": "even", "timer_jitter_s": 0.045}
        mount = self.mount(encoder_noise_deg=0.0, **uneven)

        def turn() -> Looked:
            aborts = decode_status(mount.turn()).ack_abort
            now = mount.truth()
            return Looked(now.utc_s, now.dec_deg, now.dec_rate_deg_s, aborts)

        probe = Probe(mount.receive, turn, self.parameters["move_axis"] == "held")
        return truth_of(probe, rate_deg_s, self.parameters["acceleration_deg_s2"])


def draw_stranger(number: int, seed: int) -> Stranger:
    """Draw one of the mounts that were written from the paper alone."""
    rng = np.random.default_rng([seed, number, 7])

    def uniform(low: float, high: float) -> float:
        return float(rng.uniform(low, high))

    def one_of(*choices: Any) -> Any:
        return choices[int(rng.integers(len(choices)))]

    parameters = {
        "dec_deg": uniform(10.0, 60.0),
        "hour_angle_deg": uniform(-40.0, 40.0),
        "bandwidth_hz": uniform(1.0, 40.0),
        "damping": uniform(0.5, 1.2),
        "feedforward": uniform(0.0, 1.0),
        "acceleration_deg_s2": uniform(2.0, 20.0),
        "timer": one_of("even", "windows"),
        "timer_jitter_s": one_of(0.0, 0.001, 0.005),
        "move_axis": one_of("held", "edge"),
        "encoder_noise_deg": one_of(1e-6, 8e-6),
        "rate_fields": one_of("true", "constant", "late", "lying", "nan"),
        "slewing_field": one_of("true", "false", "quiet", "always"),
        "clock_error_s": uniform(-10.0, 10.0),
        "clock_drift_ppm": uniform(-50.0, 50.0),
        "seed": number,
    }
    # Jitter of a network is exponential here: its largest of some hundred is about five times the mean.
    network = Network(uniform(0.0, 0.08), uniform(0.0, 0.08), one_of(0.0, 0.0005, 0.002))
    return Stranger(list(STRANGERS)[number % len(STRANGERS)], parameters, network)


def run_stranger(one: Stranger) -> Findings:
    """Calibrate a stranger; raises AssertionError where the run does not come to its end."""
    mount = one.mount()
    begin_utc_s = mount.next_turn_s - 0.01
    around = Surroundings(52.0, 4.5, 170.0, -20.0, 200.0)
    calibrator = Calibrator(around, begin_utc_s)
    rng = np.random.default_rng(one.parameters["seed"])
    VirtualRun(calibrator, StrangerLoop(mount), one.network, StrangerTurns(mount), rng, begin_utc_s).run()
    assert calibrator.ending is not None
    if calibrator.ending.kind is not EndKind.DONE or not calibrator.ending.at_rest:
        raise AssertionError(f"{calibrator.ending}, {one}")
    return conclude(calibrator.seen, 4.5)


def judge_stranger(number: int, seed: int) -> tuple[list[Judged], bool] | str:
    """Return both axes' judgements and whether the status fields were told right, or why the run ended."""
    one = draw_stranger(number, seed)
    try:
        found = run_stranger(one)
    except (AssertionError, CalibrationEndedError) as error:
        return str(error)
    top = max(
        (m.braking.stop.rate_deg_s for m in (found.ra_motion, found.dec_motion) if m.braking), default=0.8
    )
    true = one.truth(min((0.2, 0.4, 0.8, 1.6), key=lambda rate: abs(rate - top)))
    told = (found.rate_fields == "true", found.slewing_field)
    meant = {"true": "true", "quiet": "quiet"}.get(one.parameters["slewing_field"], "meaningless")
    fields = told == (one.parameters["rate_fields"] == "true", meant)
    return [judge_motion(one.kind, m, true) for m in (found.ra_motion, found.dec_motion)], fields


def motion_table(done: list[Judged]) -> list[str]:
    """Return how many accelerations and lags are within two sigma, for each kind of mount."""
    lines = []
    for kind in sorted({one.kind for one in done}):
        some = [one for one in done if one.kind == kind]
        rates = [o for o in some if o.value is not None and o.sigma is not None]
        lags = [o for o in some if o.lag_s is not None and o.lag_sigma_s is not None]
        near = sum(abs(o.value - o.true_deg_s2) <= 2.0 * o.sigma for o in rates)  # type: ignore[operator]
        short = sum(o.stops_too_short for o in rates)
        late = sum(abs(o.lag_s - o.true.lag_s) <= 2.0 * o.lag_sigma_s for o in lags)  # type: ignore[operator]
        widest = max((o.sigma / o.value for o in rates), default=math.nan)  # type: ignore[operator]
        lines += [
            f"{kind}: {len(some)} axes, {sum(o.true.reached for o in some)} reach their limit",
            f"  acceleration told of {len(rates)} ({sum(o.limited for o in rates)} as the limit), within two "
            f"sigma {near}, sigma at most {100.0 * widest:.0f} %, foretold stops too short {short}",
            f"  lag told of {len(lags)}, within two sigma {late}, worst error "
            f"{max((abs(o.lag_s - o.true.lag_s) * 1e3 for o in lags), default=math.nan):.1f} ms",  # type: ignore[operator]
        ]
    return lines


def stranger_tables(draws: int, seed: int) -> list[str]:
    """Calibrate strangers, on all processors, and return the figures, a line each."""
    with ProcessPoolExecutor() as pool:
        results = list(pool.map(judge_stranger, range(draws), repeat(seed)))
    ended = [one for one in results if isinstance(one, str)]
    done = [one for one in results if not isinstance(one, str)]
    judged = [axis for axes, _ in done for axis in axes]
    return [
        f"strangers: {draws}, runs that found out what the mount is: {len(done)}",
        f"rate fields and Slewing told right: {sum(right for _, right in done)}",
        *motion_table(judged),
        *(f"  ended: {words[:100]}" for words in ended),
    ]


@dataclass(frozen=True)
class Outcome:
    """One draw's errors: found less true."""

    semantics_right: bool
    gains: tuple[float, float]
    gain_sigmas: tuple[float, float]
    round_trip_s: float
    round_trip_sigma_s: float
    intervals_hold: bool
    widest_excess_s: float
    drift_ppm: float
    drift_sigma_ppm: float
    motions: tuple[Judged, ...]
    seconds: float


def run_drawn(drawn: Drawn) -> tuple[Findings, float]:
    """Calibrate a drawn mount; return what was found and how long it took, seconds."""
    hard = drawn.hardware
    around = Surroundings(SITE.latitude_deg, SITE.longitude_deg, 170.0, -20.0, 200.0)
    calibrator = Calibrator(around, drawn.begin_utc_s)
    wires = SimulatedWires(
        Wire(WireLaw(hard.command_delay_s or 0.0, hard.command_jitter_s, drawn.loss), f"out {hard.seed}"),
        Wire(WireLaw(hard.status_delay_s or 0.0, hard.status_jitter_s, drawn.loss), f"back {hard.seed}"),
    )
    turns = SimulatedTurns(MountTimer(hard.timer, drawn.profile.period_s, hard.timer_drift_ppm, hard.seed))
    loop = SimulatedLoop(SimulatedMount(drawn.profile, SITE, drawn.start, hard))
    run = VirtualRun(calibrator, loop, wires, turns, np.random.default_rng(0), drawn.begin_utc_s)
    seconds = run.run()
    assert calibrator.ending is not None
    if calibrator.ending.kind is not EndKind.DONE or not calibrator.ending.at_rest:
        raise AssertionError(f"{calibrator.ending}, {drawn}")
    return conclude(calibrator.seen, SITE.longitude_deg), seconds


def _simulated_truth(drawn: Drawn, found: Findings) -> AxisTruth:
    """Measure what the declination axis of a drawn mount does."""
    hardware = msgspec.structs.replace(drawn.hardware, encoder_noise_tics=0.0)
    mount = SimulatedMount(drawn.profile, SITE, drawn.start, hardware)
    now_utc_s = drawn.begin_utc_s

    def turn() -> Looked:
        nonlocal now_utc_s
        now_utc_s += 0.01
        status, truth = mount.tick(now_utc_s)
        rate = truth.dec_rate_deg_s * (-1.0 if truth.beyond_pole else 1.0)
        return Looked(now_utc_s, truth.dec_axis_deg, rate, decode_status(status).ack_abort)

    stop = found.dec_motion.braking
    top = stop.stop.rate_deg_s / drawn.profile.dec_rate_gain if stop else 0.8
    rate = min((0.2, 0.4, 0.8, 1.6), key=lambda rate: abs(rate - top))
    probe = Probe(mount.receive, turn, drawn.profile.move_axis == "held")
    return truth_of(probe, rate, drawn.profile.dec.max_acceleration_deg_s2)


def judge(drawn: Drawn, found: Findings, seconds: float, motions: bool = True) -> Outcome:
    """Hold what was found to what is; how an axis moves, which is measured for that, where `motions`."""
    truths = (_simulated_truth(drawn, found),) if motions else ()
    profile, hard, delays = drawn.profile, drawn.hardware, found.delays
    command_s, status_s = hard.command_delay_s or 0.0, hard.status_delay_s or 0.0
    trip_s = command_s + status_s
    passed_s = found.utc_s - drawn.begin_utc_s
    ahead_s = (hard.clock_offset_s or 0.0) + hard.clock_drift_ppm * 1e-6 * passed_s
    intervals = ((delays.command_s, command_s), (delays.status_s, status_s), (delays.clock_offset_s, ahead_s))
    return Outcome(
        semantics_right=(
            (found.ra.sign, found.dec.sign) == profile.signs(drawn.beyond_pole)
            and found.additive == profile.additive
            and found.move_axis == profile.move_axis
            and found.beyond_pole == drawn.beyond_pole
            and all(profile.readings[name] == seen for name, seen in found.readings.items())
        ),
        gains=(found.ra.gain - profile.ra_rate_gain, found.dec.gain - profile.dec_rate_gain),
        gain_sigmas=(found.ra.gain_sigma, found.dec.gain_sigma),
        round_trip_s=delays.round_trip.seconds - trip_s,
        round_trip_sigma_s=delays.round_trip.sigma_s,
        intervals_hold=all(low <= true <= high for (low, high), true in intervals),
        widest_excess_s=max(high - low for (low, high), _ in intervals) - trip_s,
        drift_ppm=found.clock.drift_ppm - hard.clock_drift_ppm,
        drift_sigma_ppm=found.clock.slope_sigma * 1e6,
        motions=tuple(judge_motion("simulated", found.dec_motion, truth) for truth in truths),
        seconds=seconds,
    )


def outcomes(numbers: range, seed: int) -> list[Outcome]:
    """Calibrate the mounts of these numbers."""
    done = []
    for number in numbers:
        drawn = draw(number, seed)
        done.append(judge(drawn, *run_drawn(drawn)))
        if sys.stderr.isatty():
            print(f"\r{len(done)} of {len(numbers)}", end="", file=sys.stderr, flush=True)
    return done


def _rms(values: list[float]) -> float:
    return math.sqrt(sum(v * v for v in values) / len(values)) if values else math.nan


def table(done: list[Outcome]) -> list[str]:
    """Return the figures, a line each."""
    gains = [g for o in done for g in o.gains]
    pulls = [g / s for o in done for g, s in zip(o.gains, o.gain_sigmas, strict=True)]
    trips = [o.round_trip_s * 1e3 for o in done]
    seconds = sorted(o.seconds for o in done)
    excess_ms = max(o.widest_excess_s for o in done) * 1e3
    return [
        f"mounts: {len(done)}",
        f"semantics right: {sum(o.semantics_right for o in done)}",
        f"gain error: {max(map(abs, gains)) * 100:.5f} % worst, {_rms(gains) * 100:.5f} % RMS",
        f"gain error over its sigma: {_rms(pulls):.2f} RMS, {max(map(abs, pulls)):.1f} worst",
        f"round trip error: {max(map(abs, trips)):.2f} ms worst, {_rms(trips):.2f} ms RMS",
        f"round trip sigma told: {_rms([o.round_trip_sigma_s * 1e3 for o in done]):.2f} ms RMS",
        f"intervals hold the truth: {sum(o.intervals_hold for o in done)}",
        f"intervals are wider than the round trip by {excess_ms:.2f} ms at most",
        f"clock drift error: {max(abs(o.drift_ppm) for o in done):.2f} ppm worst, "
        f"{_rms([o.drift_ppm for o in done]):.2f} ppm RMS, "
        f"{_rms([o.drift_ppm / o.drift_sigma_ppm for o in done]):.2f} of its sigma RMS",
        *motion_table([m for o in done for m in o.motions]),
        f"a run takes {seconds[0]:.0f} to {seconds[-1]:.0f} s of the mount's time",
    ]


def main() -> None:
    draws = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    seed = int(sys.argv[2]) if len(sys.argv) > 2 else 1
    done = outcomes(range(draws), seed)
    if sys.stderr.isatty():
        print("\r\x1b[K", end="", file=sys.stderr)
    print("\n".join(table(done)))
    print("\n".join(stranger_tables(draws, seed)))


if __name__ == "__main__":
    main()
